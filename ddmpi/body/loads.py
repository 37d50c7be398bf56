"""Loads and clamps of one body at its nodes."""

from __future__ import annotations

from collections import Counter
from typing import Any

import numpy as np

from ddmpi.body.stress import blocks
from ddmpi.errors import InputError
from ddmpi.mesh.boundary import boundary_group, group_nodes, turn_outward
from ddmpi.mesh.mesh import Mesh, signed_double_areas
from ddmpi.scene.bodies import BodySpec, Traction
from ddmpi.scene.values import evaluate, varies

SAME = 1e-9
"""Relative difference up to which two clamps prescribe the same displacement."""

ROUNDING = 1e-9
"""A pressure has no component along an axis from which its direction differs by less than this from a right angle."""

SMALLEST = 1e-150
"""Squares of smaller numbers lose digits or vanish; norms are made of squares."""


def nodal_loads(mesh: Mesh, body: BodySpec) -> np.ndarray:
    """Nodal loads (nv, 2) in newtons of tractions, pressures and volume force.

    They are exact where these are affine on straight sides; formulas are integrated by Gauss's rule. Raises InputError
    where a formula is not finite.
    """
    f = np.zeros_like(mesh.points)
    for traction in body.traction:
        key = f"body.{body.name}.traction"
        _values(traction.given, mesh.points[boundary_group(mesh, traction.on, key)], key)
        sides, length, table, stress = _stress(mesh, traction, key)
        np.add.at(f, sides, np.einsum("s,la,csa->slc", length, table, stress))
    if body.volume_force != (0.0, 0.0):
        _add_volume_force(mesh, body, f)
    return f


def _stress(mesh: Mesh, traction: Traction, key: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """What a traction or pressure is on the sides of its group.

    Returns
    -------
    sides (s, 2 or 3), which have the body to their left; their lengths (s,) in metres; table (l, q) of integrals over
    a side of length one; stress (2, s, q) in Pa that acts at the table's points of each side
    """
    sides = turn_outward(mesh, boundary_group(mesh, traction.on, key), key)
    ends = mesh.points[sides[:, :2]]
    along = ends[:, 1] - ends[:, 0]
    length = np.hypot(*along.T)
    table = mesh.element.side_mass
    if varies(traction.given):
        where, table = mesh.element.side_rule()
        ends = np.einsum("qa,sad->sqd", where, ends)
    stress = _values(traction.given, ends, key)
    if traction.pressure is not None:
        inward = np.stack([-along[:, 1], along[:, 0]]) / length
        stress = inward[:, :, None] * stress
    return sides, length, table, stress


def _add_volume_force(mesh: Mesh, body: BodySpec, f: np.ndarray) -> None:
    """Add the nodal loads of the volume force to f (nv, 2)."""
    key, force = f"body.{body.name}.volume_force", body.volume_force
    where, table, parts = np.eye(3), mesh.element.mass, [slice(None)]
    if varies(force):
        _values(force, mesh.points, key)
        (where, table), parts = mesh.element.rule(), blocks(len(mesh.triangles))
    for part in parts:
        triangles = mesh.triangles[part]
        places = mesh.points[triangles[:, :3]]
        area = signed_double_areas(mesh.points, triangles) / 2
        if len(where) > 3:
            places = np.einsum("qa,tad->tqd", where, places)
        for component, density in enumerate(_values(force, places, key)):
            loads = (area[:, None] * density) @ table.T
            f[:, component] += np.bincount(triangles.ravel(), loads.ravel(), len(f))


def _values(value: Any, points: np.ndarray, key: str) -> np.ndarray:
    """`evaluate` at points (…, 2). Raises InputError, naming `key`, where a formula is not finite."""
    x, y = np.moveaxis(points, -1, 0)
    found = evaluate(value, x, y)
    if varies(value) and not np.isfinite(found).all():
        at = np.argwhere(~np.isfinite(found))[0]
        place = tuple(at[-x.ndim:])
        parts = value if isinstance(value, tuple) else (value,)
        raise InputError(f'{key}: the formula "{parts[at[0] if len(at) > x.ndim else 0]}" is {found[tuple(at)]} at '
                         f"({x[place]:.6g}, {y[place]:.6g}); it must be a finite number wherever it acts")
    return found


def clamp_nodes(mesh: Mesh, body: BodySpec) -> tuple[np.ndarray, np.ndarray]:
    """Which components are free (nv, 2) bool, and the displacements (nv, 2) in metres prescribed for the others.

    Not collective. Raises InputError where two clamps prescribe different displacements of one component.
    """
    free = np.ones((len(mesh.points), 2), dtype=bool)
    prescribed = np.zeros((len(mesh.points), 2))
    for clamp in body.clamps:
        key = f"body.{body.name}.clamp"
        nodes = group_nodes(mesh, clamp.on, key)
        x, y = mesh.points[nodes].T
        for component, value in enumerate((clamp.x, clamp.y)):
            if value is not None:
                wanted, before = _values(value, mesh.points[nodes], key), prescribed[nodes, component]
                size = np.maximum(np.abs(wanted), np.abs(before))
                clash = np.flatnonzero(~free[nodes, component] & (np.abs(wanted - before) > SAME * size))
                if len(clash):
                    k = clash[0]
                    raise InputError(f"{key}: {'xy'[component]} at ({x[k]:.6g}, {y[k]:.6g}) is "
                                     f"prescribed twice, as {before[k]:.6g} and, on {clamp.on!r}, as {wanted[k]:.6g}")
                free[nodes, component] = False
                prescribed[nodes, component] = wanted
    return free, prescribed


def refuse_underflow(mesh: Mesh, body: BodySpec, f: np.ndarray, prescribed: np.ndarray, stiffest: float) -> None:
    """Raise InputError where something acts that is too small to compute with. Not collective.

    Parameters
    ----------
    f, prescribed : (nv, 2) nodal loads (N), those of prescribed displacements as well, and these (m)
    stiffest : largest entry of the stiffness (N/m)
    """
    groups = [(each.given, mesh.points[boundary_group(mesh, each.on, "").ravel()]) for each in body.traction]
    values = [evaluate(value, *points.T) for value, points in [*groups, (body.volume_force, mesh.points)]]
    sizes = [float(np.abs(value).max()) for value in (*values, f, prescribed)]
    small = [size for size in (*sizes, float(np.abs(f).max() / stiffest)) if 0.0 < size < SMALLEST]
    if small:
        raise InputError(f"body.{body.name}: loads or prescribed displacements are so small ({min(small):.3g}) that "
                         "their squares are out of the range of double precision; choose other units")


def lost_loads(mesh: Mesh, body: BodySpec, free: np.ndarray) -> list[str]:
    """Warnings of tractions that clamps take up wholly, and of groups that are loaded twice. Not collective."""
    key, found = f"body.{body.name}.traction", []
    for traction in body.traction:
        nodes = np.unique(boundary_group(mesh, traction.on, key))
        size = np.abs(_stress(mesh, traction, key)[3]).max(axis=(1, 2))
        acts = size > (ROUNDING * size.max() if traction.pressure is not None else 0.0)
        for component, axis in enumerate("xy"):
            if acts[component] and not free[nodes, component].any():
                found.append(f"{key}: the load on {traction.on!r} along {axis} is lost, because clamps hold the whole "
                             "group in this direction")
    for group, number in Counter(traction.on for traction in body.traction).items():
        if number > 1:
            found.append(f"{key}: {group!r} is loaded {number} times; the loads add up")
    return found
