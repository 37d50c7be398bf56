"""Loads and clamps of one body at its nodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.stress import Composite, blocks, cell_temperature, gradients, portions, thermal
from ddmpi.errors import InputError
from ddmpi.mesh.boundary import SHARPEST, outer_normals
from ddmpi.mesh.elements import FINE, RULES, circumference, curved_facets
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, Traction
from ddmpi.scene.values import AffineVector, Vector, evaluate, histories, varies
from ddmpi.system.numbers import in_words, moment

SAME = 1e-9
"""Relative difference up to which two clamps prescribe the same displacement."""

ALONG, EXACT = 1e-6, 1e-14
"""A direction of which no more than the first is free is held. Of displacements, the second is rounding."""

ROUNDING = 1e-9
"""A load has no component along an axis from which its direction differs by less than this from a right angle."""

SMALLEST = 1e-150
"""Squares of smaller numbers lose digits or vanish; norms are made of squares."""

ON_AXIS = Clamp(on="the axis", x=0.0)
"""Around an axis, the clamp whose number follows those of the body."""


VOLUME = "volume_force"
"""What the volume force is called among the groups that are loaded."""


def nodal_loads(mesh: Mesh, body: BodySpec, history: str | None = None) -> np.ndarray:
    """Nodal loads (nv, d) in newtons of tractions, pressures and volume force that follow `history`, None for none.

    They are exact where these are affine on straight facets and cells; formulas, and what acts on curved ones, are
    integrated by Gauss's rule. Raises InputError where a formula is not finite.
    """
    return sum((f for _, f in loads_by_group(mesh, body, history)), np.zeros_like(mesh.points))


def loads_by_group(mesh: Mesh, body: BodySpec, history: str | None = None) -> Iterator[tuple[str, np.ndarray]]:
    """The parts of `nodal_loads`, each with its group; the volume force is called VOLUME. A group may come again."""
    for traction in body.traction:
        if traction.history == history:
            key = f"body.{body.name}.traction"
            facets = mesh.facets(traction.on).nodes
            values_at(traction.given, mesh.points[facets], key)  # a formula must be finite at the nodes, too
            yield traction.on, _traction(mesh, facets, traction, key)
    force, follows = body.weight
    if follows == history and force != (0.0,) * mesh.dimension:
        yield VOLUME, _volume_force(mesh, force, f"body.{body.name}.volume_force")


def resultants(mesh: Mesh, parts: Iterable[tuple[str, np.ndarray]]) -> dict[str, dict[str, np.ndarray]]:
    """By group the force (d,) in newtons and the moment about the origin (N m), () or (3,), of nodal forces (nv, d)."""
    found: dict[str, dict[str, np.ndarray]] = {}
    for group, f in parts:
        acts = f.any(axis=1)
        now = {"force": f[acts].sum(axis=0), "moment": moment(mesh.points[acts], f[acts], mesh.axisymmetric)}
        found[group] = {kind: now[kind] + value for kind, value in found[group].items()} if group in found else now
    return found


def _traction(mesh: Mesh, facets: np.ndarray, traction: Traction, key: str) -> np.ndarray:
    """Nodal loads (nv, d) in newtons of a traction, a pressure or a force on facets (k, l); by tables where these are
    exact."""
    nodes, cell = mesh.points[facets], mesh.cell.facet
    points, weights = FINE[cell.dimension]
    exact = ~(curved_facets(nodes) | varies(traction.given) | mesh.axisymmetric)
    f, area = np.zeros_like(mesh.points), 0.0
    for part, where, table in ((exact, np.eye(mesh.dimension), cell.mass),
                               (~exact, points, (weights[:, None] * cell.shapes(points)).T)):
        if part.any():
            vectors = cell.vectors(nodes[part], where)
            size = np.linalg.norm(vectors, axis=0)
            places = np.einsum("ql,sld->qsd", cell.shapes(where), nodes[part])
            stress = values_at(traction.given, places, key)
            if traction.pressure is not None:
                stress = -vectors / size * stress
            shares = table[..., None] * size * circumference(places, mesh.axisymmetric)
            area += float(shares.sum())
            np.add.at(f, facets[part], np.einsum("lqs,dqs->sld", shares, stress))
    if traction.force is None:
        return f
    if not area > 0.0:
        raise InputError(f"{key}: the group {traction.on!r} has no area over which a force could be spread")
    return f / area


def temperature(mesh: Mesh, body: BodySpec, history: str | None) -> np.ndarray:
    """Temperature (nv,) in K at the nodes, as far as it follows `history`. Raises InputError where it is not finite."""
    value = body.heat.value if body.heat.history == history else 0.0
    return values_at(value, mesh.points, f"body.{body.name}.temperature")


def _volume_force(mesh: Mesh, force: Vector | AffineVector, key: str) -> np.ndarray:
    """Nodal loads (nv, d) in newtons of a volume force (N/m³)."""
    f = np.zeros_like(mesh.points)
    parts: list[slice] | list[np.ndarray] = mesh.summed_blocks()
    if varies(force):
        values_at(force, mesh.points, key)
        parts = blocks(len(mesh.triangles))
    else:
        measures = mesh.measures()
        measures[mesh.summed] = 0.0
        for component, density in enumerate(values_at(force, mesh.points[mesh.corners], key)):
            loads = (measures[:, None] * density) @ mesh.cell.mass.T
            f[:, component] += np.bincount(mesh.triangles.ravel(), loads.ravel(), len(f))
    where, weights = FINE[mesh.dimension]
    shapes = mesh.cell.shapes(where)
    for part in parts:
        mapped, nodes = mesh.map(part, where), mesh.triangles[part]
        shares = weights[:, None] * mapped.measures
        for component, density in enumerate(values_at(force, mapped.places, key)):
            f[:, component] += np.bincount(nodes.ravel(), ((shares * density).T @ shapes).ravel(), len(f))
    return f


def springs(mesh: Mesh, body: BodySpec) -> Iterator[tuple[str, float, sparse.csr_matrix]]:
    """The foundations of a body: group, stiffness √k (N/m)^½, and rows Q (r, d nv) without units.

    Under a displacement u the springs store ½ k |Q u|², and take the forces k Qᵀ Q u. Not collective.
    """
    for foundation in body.foundation:
        facets = mesh.facets(foundation.on).nodes
        cell, d = mesh.cell.facet, mesh.dimension
        points, weights = FINE[cell.dimension]
        vectors = cell.vectors(mesh.points[facets], points)
        size = np.linalg.norm(vectors, axis=0)
        along = np.einsum("iqs,jqs->qsij", vectors / size, vectors / size)
        places = np.einsum("ql,sld->qsd", cell.shapes(points), mesh.points[facets])
        size = size * circumference(places, mesh.axisymmetric)
        largest, measure = max(foundation.normal, foundation.tangential), float(weights @ size.sum(axis=1))
        normal, tangential = np.sqrt([foundation.normal / largest, foundation.tangential / largest])
        roots = normal * along + tangential * (np.eye(d) - along)
        roots = roots * np.sqrt(weights[:, None] * size / measure)[..., None, None]
        values = np.einsum("qsij,ql->qsilj", roots, cell.shapes(points))
        columns = np.broadcast_to((d * facets[:, :, None] + np.arange(d))[None, :, None], values.shape)
        starts = np.arange(0, values.size + 1, d * facets.shape[1])
        yield foundation.on, float(np.sqrt(largest * measure)), sparse.csr_matrix(
            (values.ravel(), columns.ravel(), starts), (len(starts) - 1, mesh.points.size))


def thermal_loads(mesh: Mesh, material: Material | Composite, heat: np.ndarray) -> tuple[np.ndarray, float]:
    """Nodal loads (nv, d) in newtons by which a temperature (nv,) in K strains a body, ∫ β T : ∇φ; and twice the
    elastic energy where no strain yields to it (J). Not collective.

    The temperature is that of the points where the stress is taken, see `Cell.samples`.
    """
    f, energy = np.zeros_like(mesh.points), 0.0
    for cells, own, curved in portions(mesh, material):
        points, weights = RULES[mesh.dimension] if curved else mesh.cell.samples
        mapped, warm = mesh.map(cells, points), cell_temperature(mesh, heat, points, cells)
        beta, whole, *_ = thermal(own, mesh.strains)
        beta = np.einsum("ij,ijrc->rc", beta, gradients(mesh))
        share = weights[:, None] * mapped.measures * warm
        for component, loads in enumerate(np.einsum("rc,cqit,qt->rti", beta, mapped.slopes, share)):
            f[:, component] += np.bincount(mesh.triangles[cells].ravel(), loads.ravel(), len(f))
        energy += whole * float((share * warm).sum())
    return f, energy


def values_at(value: Any, points: np.ndarray, key: str) -> np.ndarray:
    """`evaluate` at points (…, d). Raises InputError, naming `key`, where a formula is not finite."""
    found = evaluate(value, *np.moveaxis(points, -1, 0))
    if varies(value) and not np.isfinite(found).all():
        at = np.argwhere(~np.isfinite(found))[0]
        parts, where = value if isinstance(value, tuple) else (value,), in_words(points[tuple(at[1 - points.ndim:])])
        raise InputError(f'{key}: the formula "{parts[at[0] if len(at) == points.ndim else 0]}" is '
                         f"{found[tuple(at)]} at {where}; it must be a finite number wherever it acts")
    return found


@dataclass(frozen=True)
class Supports:
    """What clamps hold of a body.

    Attributes
    ----------
    clamps : (nv, d) the number of the clamp that prescribes each component, −1 if none does; a clamp along a normal
        counts for all components that the normal has
    free : (nv, d, d) projections onto the directions in which the nodes can move
    moved : (nv, d) the displacements that clamps prescribe (m), at factor 1 of the history that they follow, None for
        those that follow none
    held : number of a clamp, nodes (k,) and unit vectors (k, d) along which it holds them, in the order of the scene
    """

    clamps: np.ndarray
    free: np.ndarray
    moved: Mapping[str | None, np.ndarray]
    held: Sequence[tuple[int, np.ndarray, np.ndarray]] = ()


def supports(mesh: Mesh, body: BodySpec) -> Supports:
    """What the clamps of a body hold; several at a node hold what they hold together. Not collective.

    Nodes on an axis are held radially as by one clamp more.
    Of two clamps along normals, a node where one surface goes on smoothly in the other has the normal of the first.
    Raises InputError where two clamps prescribe different displacements in one direction, and at a corner inside a
    group that is clamped along its normal.
    """
    (size, d), key, names = mesh.points.shape, f"body.{body.name}.clamp", [None, *histories(body)]
    clamps, free = np.full((size, d), -1), np.tile(np.eye(d), (size, 1, 1))
    moved, outer = np.zeros((len(names), size, d)), np.zeros((size, d))
    clamps[mesh.on_axis, 0], free[mesh.on_axis, 0, 0] = len(body.clamps), 0.0
    held: list[tuple[int, np.ndarray, np.ndarray]] = []
    for which, clamp in enumerate(body.clamps):
        for axis, value, nodes, direction in _held(mesh, clamp, key):
            if axis == "normal":
                smooth = np.einsum("ki,ki->k", direction, outer[nodes]) > np.cos(SHARPEST)
                outer[nodes] = direction = np.where(smooth[:, None], outer[nodes], direction)
            held.append((which, nodes, direction))
            rest = np.einsum("kij,kj->ki", free[nodes], direction)
            new = np.linalg.norm(rest, axis=1) > ALONG
            wanted = np.zeros((len(names), len(nodes)))
            wanted[names.index(clamp.history)] = values_at(value, mesh.points[nodes], key)
            before = np.einsum("hki,ki->hk", moved[:, nodes], direction)
            allowed = SAME * np.maximum(np.abs(wanted), np.abs(before))
            allowed += EXACT * np.linalg.norm(moved[:, nodes], axis=2)
            clash = np.flatnonzero(~new & (np.abs(wanted - before) > allowed).any(axis=0))
            if len(clash):
                one, other, node = before[:, clash[0]].sum(), wanted[:, clash[0]].sum(), nodes[clash[0]]
                where = f"{key}: {axis} at {in_words(mesh.points[node])} is prescribed "
                if mesh.on_axis[node] and axis == "x":
                    raise InputError(f"{where}as {other:.6g}, and what lies on the axis does not move radially; write "
                                     'a formula that is zero there, such as x = "1e-3 * x"')
                raise InputError(f"{where}twice, as {one:.6g} and, on {clamp.on!r}, as {other:.6g}"
                                 + ", with another history" * bool(one == other))
            rows, columns = np.nonzero(np.abs(direction) > ALONG)
            clamps[nodes[rows], columns] = which
            nodes, rest = nodes[new], rest[new]
            squares = (rest**2).sum(axis=1)
            moved[:, nodes] += ((wanted - before)[:, new] / squares)[:, :, None] * rest
            free[nodes] -= rest[:, :, None] * rest[:, None] / squares[:, None, None]
    free[np.einsum("kii->k", free) < 0.5] = 0.0  # nothing but rounding
    return Supports(clamps, free, dict(zip(names, moved, strict=True)), held)


def _held(mesh: Mesh, clamp: Clamp, key: str) -> Iterator[tuple[str, Any, np.ndarray, np.ndarray]]:
    """What a clamp prescribes: the component in words, its value, the nodes (k,) and unit vectors (k, d) there."""
    nodes = mesh.nodes_of(clamp.on)
    for axis, value, unit in zip("xyz", clamp.components, np.eye(3), strict=True):
        if value is not None and unit[:mesh.dimension].any():
            yield axis, value, nodes, np.tile(unit[:mesh.dimension], (len(nodes), 1))
    if clamp.normal is not None:
        if clamp.on not in mesh.groups:
            raise InputError(f"{key}: {clamp.on!r} is no boundary group of the mesh and has no normal; give x, y or z")
        if clamp.on in mesh.vertices:
            at = in_words(mesh.points[mesh.vertices[clamp.on][0]])
            raise InputError(f"{key}: the node of {clamp.on!r} at {at} is on no {mesh.cell.facet.name} of it and has "
                             "no normal; give x, y or z")
        yield "normal", clamp.normal, *outer_normals(mesh, clamp.on, key)


def refuse_underflow(mesh: Mesh, body: BodySpec, f: np.ndarray, prescribed: np.ndarray, stiffest: float) -> None:
    """Raise InputError where something acts that is too small to compute with: loads, nodal loads f (nv, d) in newtons,
    displacements that are `prescribed` (nv, d) in metres, or f over the `stiffest` entry (N/m). Not collective."""
    groups = [(each.given, mesh.points[mesh.facets(each.on).nodes.ravel()]) for each in body.traction]
    values = [evaluate(value, *points.T) for value, points in [*groups, (body.weight[0], mesh.points)]]
    sizes = [float(np.abs(value).max()) for value in (*values, f, prescribed)]
    small = [size for size in (*sizes, float(np.abs(f).max() / stiffest)) if 0.0 < size < SMALLEST]
    if small:
        raise InputError(f"body.{body.name}: loads or prescribed displacements are so small ({min(small):.3g}) that "
                         "their squares are out of the range of double precision; choose other units")


def lost_loads(mesh: Mesh, body: BodySpec, free: np.ndarray) -> list[str]:
    """Warnings of loads on groups that clamps take up wholly, and of groups that are loaded twice. Not collective."""
    key, found, loads = f"body.{body.name}", [], Counter[tuple[str, str | None]]()
    for history in (None, *histories(body)):
        for group, f in loads_by_group(mesh, body, history):
            if group == VOLUME:
                continue
            loads[group, history] += 1
            acts, left = (np.abs(each).max(axis=0) > ROUNDING * np.abs(f).max()
                          for each in (f, np.einsum("kij,kj->ki", free, f)))
            found += [f"{key}: the load on {group!r} along {axis} is lost, because clamps hold the whole group in this "
                      "direction" for axis, lost in zip("xyz", acts & ~left, strict=False) if lost]
    return found + [f"{key}: {group!r} is loaded {number} times; the loads add up"
                    for (group, _), number in loads.items() if number > 1]
