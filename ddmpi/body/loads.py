"""Loads and clamps of one body at its nodes."""

from __future__ import annotations

from collections import Counter

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import boundary_group, turn_outward
from ddmpi.mesh.mesh import Mesh, signed_double_areas
from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.values import evaluate

SAME = 1e-9
"""Relative difference up to which two clamps prescribe the same displacement."""

SMALLEST = 1e-150
"""Squares of smaller numbers lose digits or vanish; norms are made of squares."""


def nodal_loads(mesh: Mesh, body: BodySpec, history: str | None = None) -> np.ndarray:
    """Nodal loads (nv, 2) in newtons of the tractions and volume force that follow `history`, None for no history.

    They are exact, as both are affine.
    """
    element = mesh.element
    f = np.zeros_like(mesh.points)
    for traction in body.traction:
        if traction.history != history:
            continue
        key = f"body.{body.name}.traction"
        sides = turn_outward(mesh, boundary_group(mesh, traction.on, key), key)
        x, y = mesh.points[sides[:, :2]].transpose(2, 0, 1)
        length = np.hypot(*(np.diff(c, axis=1)[:, 0] for c in (x, y)))
        np.add.at(f, sides, np.einsum("s,la,csa->slc", length, element.side_mass, evaluate(traction.value, x, y)))
    weight, follows = body.weight
    if follows == history and weight != (0.0, 0.0):
        corners = mesh.triangles[:, :3]
        x, y = mesh.points[corners].transpose(2, 0, 1)
        area = signed_double_areas(mesh.points, corners) / 2
        for component, force in enumerate(evaluate(weight, x, y)):
            parts = (area[:, None] * force) @ element.mass.T
            f[:, component] += np.bincount(mesh.triangles.ravel(), parts.ravel(), len(f))
    return f


def clamp_nodes(mesh: Mesh, body: BodySpec) -> tuple[np.ndarray, dict[str | None, np.ndarray]]:
    """Which components are free (nv, 2) bool, and the displacements (nv, 2) in metres prescribed for the others.

    The latter by the history that they follow, at its factor 1; None stands for those that follow none.

    Not collective. Raises InputError where two clamps prescribe different displacements of one component.
    """
    free = np.ones((len(mesh.points), 2), dtype=bool)
    prescribed = np.zeros((len(mesh.points), 2))
    names = [None, *body.histories]
    followed = np.zeros((len(mesh.points), 2), int)
    for clamp in body.clamps:
        nodes = np.unique(boundary_group(mesh, clamp.on, f"body.{body.name}.clamp"))
        x, y = mesh.points[nodes].T
        for component, value in enumerate((clamp.x, clamp.y)):
            if value is not None:
                wanted, before = evaluate(value, x, y), prescribed[nodes, component]
                size = np.maximum(np.abs(wanted), np.abs(before))
                number = names.index(clamp.history)
                otherwise = (np.abs(wanted - before) > SAME * size) | (
                    (followed[nodes, component] != number) & (size > 0.0))
                clash = np.flatnonzero(~free[nodes, component] & otherwise)
                if len(clash):
                    k = clash[0]
                    raise InputError(f"body.{body.name}.clamp: {'xy'[component]} at ({x[k]:.6g}, {y[k]:.6g}) is "
                                     f"prescribed twice, as {before[k]:.6g} and, on {clamp.on!r}, as {wanted[k]:.6g}"
                                     + (", with another history" if wanted[k] == before[k] else ""))
                free[nodes, component] = False
                prescribed[nodes, component], followed[nodes, component] = wanted, number
    return free, {name: np.where(followed == number, prescribed, 0.0) for number, name in enumerate(names)}


def refuse_underflow(mesh: Mesh, body: BodySpec, f: np.ndarray, prescribed: np.ndarray, stiffest: float) -> None:
    """Raise InputError where something acts that is too small to compute with. Not collective.

    Parameters
    ----------
    f, prescribed : (nv, 2) nodal loads (N), those of prescribed displacements as well, and these (m)
    stiffest : largest entry of the stiffness (N/m)
    """
    groups = [(each.value, mesh.points[boundary_group(mesh, each.on, "").ravel()]) for each in body.traction]
    values = [evaluate(value, *points.T) for value, points in [*groups, (body.weight[0], mesh.points)]]
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
        acts = np.abs(evaluate(traction.value, *mesh.points[nodes].T)).T > 0.0
        for component, axis in enumerate("xy"):
            if acts[:, component].any() and not free[nodes, component].any():
                found.append(f"{key}: the load on {traction.on!r} along {axis} is lost, because clamps hold the whole "
                             "group in this direction")
    for group, number in Counter(traction.on for traction in body.traction).items():
        if number > 1:
            found.append(f"{key}: {group!r} is loaded {number} times; the loads add up")
    return found
