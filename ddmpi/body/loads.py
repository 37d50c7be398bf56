"""Loads and clamps of one body at its nodes."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.stress import (
    Composite,
    cell_temperature,
    gradients,
    modes_of,
    portions,
    thermal,
    thickness_of,
)
from ddmpi.errors import InputError
from ddmpi.mesh.boundary import SHARPEST, outer_normals
from ddmpi.mesh.elements import circumference
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, Traction
from ddmpi.scene.formulas import evaluate, varies
from ddmpi.scene.values import LARGEST, AffineVector, Vector, histories
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import ALIKE, ROUNDING, SAME, in_words, moment, without

EXACT = 1e-14
"""The rounding of displacements."""

SMALLEST = 1e-150
"""Squares of smaller numbers, as in norms, lose digits or vanish."""

ON_AXIS = Clamp(on="the axis", x=0.0)
"""The radial clamp of nodes on an axis, numbered after those of the body."""

VOLUME = "volume_force"
"""The name of the volume force among loaded groups."""


def nodal_loads(
    mesh: Mesh, body: BodySpec, history: str | None = None, turned: np.ndarray | None = None
) -> np.ndarray:
    """Nodal loads (nv, d) in newtons of tractions, pressures and volume force of a `history`, None for constant ones.

    In the axes of a frame that is `turned` (d, d), in which loads that keep their direction turn back; a matrix of
    zeros leaves the loads that follow the body. Loads are integrated by Gauss's rule, affine ones on straight
    facets and cells exactly. Raises InputError where a formula is not finite.
    """
    return sum(
        (f for _, f in loads_by_group(mesh, body, history, turned)), np.zeros_like(mesh.points)
    )


def loads_by_group(
    mesh: Mesh, body: BodySpec, history: str | None = None, turned: np.ndarray | None = None
) -> Iterator[tuple[str, np.ndarray]]:
    """The summands of `nodal_loads` with their groups; the volume force is called VOLUME. A group may appear twice."""
    back, thick = np.eye(mesh.dimension) if turned is None else turned, thickness_of(mesh, body)
    for traction in body.traction:
        if traction.history == history:
            key = f"body.{body.name}.traction"
            facets, cells, *_ = mesh.facets(traction.on)
            values_at(
                traction.given, mesh.points[facets], key
            )  # a formula must be finite at the nodes, too
            load = _traction if traction.moment is None else _moment
            f = load(mesh, facets, traction, key, thick[cells])
            follows = (
                traction.follows or traction.pressure is not None or traction.moment is not None
            )
            yield traction.on, f if follows else f @ back
    force, named = body.weight
    if named == history and force != (0.0,) * mesh.dimension:
        yield (
            VOLUME,
            _volume_force(mesh, body.materials[0], force, f"body.{body.name}.volume_force", thick)
            @ back,
        )


def resultants(
    mesh: Mesh, groups: Iterable[tuple[str, np.ndarray]], size: float = 0.0
) -> dict[str, dict[str, np.ndarray]]:
    """Force (d,) in newtons and moment about the origin (N m), () or (3,), by group, of nodal forces (nv, d).

    What is rounding beside the sum of these forces, or beside their `size` (N), is zero.
    """
    return added((group, _resultant(mesh, f, size)) for group, f in groups)


def _resultant(mesh: Mesh, f: np.ndarray, size: float) -> dict[str, np.ndarray]:
    """One of the `resultants`."""
    acts = f.any(axis=1)
    at, f = mesh.points[acts], f[acts]
    least = ROUNDING * max(size, float(np.abs(f).sum()))
    arm = float(np.abs(at).max(initial=0.0))
    return {
        "force": without(f.sum(axis=0), least),
        "moment": without(moment(at, f, mesh.axisymmetric), least * arm),
    }


def added(entries: Iterable[tuple[str, dict[str, np.ndarray]]]) -> dict[str, dict[str, np.ndarray]]:
    """The sums of such resultants by group."""
    totals: dict[str, dict[str, np.ndarray]] = {}
    for group, now in entries:
        totals[group] = (
            {kind: now[kind] + value for kind, value in totals[group].items()}
            if group in totals
            else now
        )
    return totals


def _traction(
    mesh: Mesh, facets: np.ndarray, traction: Traction, key: str, thick: np.ndarray
) -> np.ndarray:
    """Nodal loads (nv, d) in newtons of a traction, a pressure or a force on facets (k, l) of thickness (k,)."""
    nodes, cell, f = mesh.points[facets], mesh.cell.facet, np.zeros_like(mesh.points)
    points, weights = cell.fine
    # ∫ φ_l t by Gauss's rule; `vectors` are outer normals as long as the ratio of measures
    vectors, shapes = cell.vectors(nodes, points), cell.shapes(points)
    size, places = np.linalg.norm(vectors, axis=0), np.einsum("ql,sld->qsd", shapes, nodes)
    stress = values_at(traction.given, places, key)
    if traction.pressure is not None:  # against the outer normal
        stress = -vectors / size * stress
    measures = weights[:, None] * size * thick * circumference(places, mesh.axisymmetric)
    np.add.at(f, facets, np.einsum("qs,ql,dqs->sld", measures, shapes, stress))
    if traction.force is None:
        return f
    if not measures.sum() > 0.0:
        raise InputError(
            f"{key}: the group {traction.on!r} has no area over which a force could be spread"
        )
    return f / measures.sum()


def _moment(
    mesh: Mesh, facets: np.ndarray, traction: Traction, key: str, thick: np.ndarray
) -> np.ndarray:
    """Nodal loads (nv, d) in newtons of the moment of a traction on facets (k, l)."""
    d = mesh.dimension
    slopes = {
        f"{axis}_slope": tuple(row) for axis, row in zip("xyz", np.eye(d).tolist(), strict=False)
    }
    # ∫ φ and ∫ φ x, then ∫ φ (x − c) about the middle c of the group
    share, first = (
        _traction(mesh, facets, Traction(on=traction.on, value=value), key, thick)
        for value in ((1.0,) * d, AffineVector(constant=(0.0,) * d, **slopes))
    )
    arms = np.pad(first - share * (first.sum(axis=0) / share[:, 0].sum()), ((0, 0), (0, 3 - d)))
    # t = ω × (x − c) has no resultant, and the moment (tr S − S) ω with S = ∫ (x − c)(x − c)ᵀ
    S = np.pad(mesh.points, ((0, 0), (0, 3 - d))).T @ arms
    given = np.atleast_1d(np.array(traction.moment, float))
    turn = np.linalg.pinv(np.trace(S) * np.eye(3) - S, hermitian=True) @ np.pad(
        given, (3 - len(given), 0)
    )
    return np.cross(turn, arms)[:, :d]


def temperature(mesh: Mesh, body: BodySpec, history: str | None) -> np.ndarray:
    """Temperature (nv,) in K at the nodes, zero for another history. Raises InputError where it is not finite."""
    value = body.heat.value if body.heat.history == history else 0.0
    return values_at(value, mesh.points, f"body.{body.name}.temperature")


def _volume_force(
    mesh: Mesh, material: Material, force: Vector | AffineVector, key: str, thick: np.ndarray
) -> np.ndarray:
    """Nodal loads (nv, d) in newtons of a volume force (N/m³) in cells of thickness (nt,)."""
    f = np.zeros_like(mesh.points)
    values_at(force, mesh.points, key)  # a formula must be finite at the nodes, too
    for cells, _, curved in portions(mesh, material):
        # affine forces times shape functions on straight cells, by a rule that is exact for these
        where, weights = mesh.cell.fine if curved or varies(force) else mesh.cell.rule
        mapped, nodes, shapes = (
            mesh.map(cells, where),
            mesh.triangles[cells],
            mesh.cell.shapes(where),
        )
        shares = weights[:, None] * mapped.measures * thick[cells]
        for component, density in enumerate(values_at(force, mapped.places, key)):
            f[:, component] += np.bincount(
                nodes.ravel(), ((shares * density).T @ shapes).ravel(), len(f)
            )
    return f


def springs(mesh: Mesh, body: BodySpec) -> Iterator[tuple[str, float, sparse.csr_matrix]]:
    """The foundations of a body: group, stiffness √k (N/m)^½, and rows Q (r, d nv) without units.

    Under a displacement u the springs store ½ k |Q u|², and their forces are −k Qᵀ Q u. Not collective.
    """
    for foundation in body.foundation:
        facets = mesh.facets(foundation.on).nodes
        cell, d = mesh.cell.facet, mesh.dimension
        points, weights = cell.fine
        vectors = cell.vectors(mesh.points[facets], points)
        size = np.linalg.norm(vectors, axis=0)
        along = np.einsum("iqs,jqs->qsij", vectors / size, vectors / size)
        places = np.einsum("ql,sld->qsd", cell.shapes(points), mesh.points[facets])
        size = size * circumference(places, mesh.axisymmetric)
        largest, measure = (
            max(foundation.normal, foundation.tangential),
            float(weights @ size.sum(axis=1)),
        )
        normal, tangential = np.sqrt([foundation.normal / largest, foundation.tangential / largest])
        # The root of k_n n nᵀ + k_t (I − n nᵀ), as n nᵀ and I − n nᵀ are orthogonal projections; a row of Q a Gauss
        # point.
        roots = normal * along + tangential * (np.eye(d) - along)
        roots = roots * np.sqrt(weights[:, None] * size / measure)[..., None, None]
        values = np.einsum("qsij,ql->qsilj", roots, cell.shapes(points))
        columns = np.broadcast_to(
            (d * facets[:, :, None] + np.arange(d))[None, :, None], values.shape
        )
        starts = np.arange(0, values.size + 1, d * facets.shape[1])
        yield (
            foundation.on,
            float(np.sqrt(largest * measure)),
            sparse.csr_matrix(
                (values.ravel(), columns.ravel(), starts), (len(starts) - 1, mesh.points.size)
            ),
        )


def thermal_loads(
    mesh: Mesh, material: Material | Composite, heat: np.ndarray
) -> tuple[np.ndarray, float]:
    """Nodal loads ∫ β T : ∇φ (nv, d) in newtons of a temperature (nv,) in K; and twice the elastic energy of the fully
    constrained thermal strains (J). Not collective.

    The temperature is evaluated where stresses are, see `Cell.samples`.
    """
    f, energy = np.zeros_like(mesh.points), 0.0
    for cells, uniform, curved in portions(mesh, material):
        points, weights = mesh.cell.quadrature if curved else mesh.cell.samples
        mapped, warm = mesh.map(cells, points), cell_temperature(mesh, heat, points, cells)
        beta, whole, *_ = thermal(uniform, mesh.strains)
        beta = np.einsum("ij,ijrc->rc", beta, gradients(mesh))
        share = uniform.thickness * weights[:, None] * mapped.measures * warm
        loads = np.einsum("rc,cqit,qt->rti", beta, mapped.slopes, share)
        energy += whole * float((share * warm).sum())
        if mesh.cell.modes:
            modes = modes_of(mesh, uniform, cells, heat)
            by_modes = np.einsum("tm,tmk->tk", modes.push, modes.follows)
            loads -= by_modes.reshape(len(by_modes), -1, mesh.dimension).transpose(2, 0, 1)
            energy -= float((modes.push * modes.held).sum())
        for component, load in enumerate(loads):
            f[:, component] += np.bincount(mesh.triangles[cells].ravel(), load.ravel(), len(f))
    return f, energy


def values_at(value: Any, points: np.ndarray, key: str) -> np.ndarray:
    """`evaluate` at points (…, d). Raises InputError, naming `key`, where a formula is not finite."""
    values = evaluate(value, *np.moveaxis(points, -1, 0))
    finite = np.abs(values) <= LARGEST
    if varies(value) and not finite.all():
        at = np.argwhere(~finite)[0]
        formulas, where = (
            value if isinstance(value, tuple) else (value,),
            in_words(points[tuple(at[1 - points.ndim :])]),
        )
        raise InputError(
            f'{key}: the formula "{formulas[at[0] if len(at) == points.ndim else 0]}" is '
            f"{values[tuple(at)]} at {where}; it must be a finite number, up to {LARGEST:g}, wherever it acts"
        )
    return values


@dataclass(frozen=True)
class Supports:
    """The clamped directions of all nodes of a body.

    Attributes
    ----------
    clamps : (nv, d) the number of the clamp that prescribes each component, −1 if none does; a clamp along a
        direction counts for all components that this has
    free : (nv, d, d) projections onto the free directions
    moved : (nv, d) the displacements that clamps prescribe (m), by history, at its factor 1; None for constant ones
    constrained : number of a clamp, its nodes (k,) and unit vectors (k, d) of the clamped directions, in the scene's
        order
    """

    clamps: np.ndarray
    free: np.ndarray
    moved: Mapping[str | None, np.ndarray]
    constrained: Sequence[tuple[int, np.ndarray, np.ndarray]] = ()


def supports(mesh: Mesh, body: BodySpec) -> Supports:
    """The clamped directions of a body: at a node the span of those of all its clamps. Not collective.

    Nodes on an axis have one more clamp, a radial one. Where two surfaces clamped along their normals continue each
    other smoothly, a common node has the normal of the first. Raises InputError where two clamps prescribe different
    displacements in one direction, and at a corner inside a group that is clamped along its normal.
    """
    (size, d), key, names = mesh.points.shape, f"body.{body.name}.clamp", [None, *histories(body)]
    clamps, free = np.full((size, d), -1), np.tile(np.eye(d), (size, 1, 1))
    moved, outer = np.zeros((len(names), size, d)), np.zeros((size, d))
    clamps[mesh.on_axis, 0], free[mesh.on_axis, 0, 0] = len(body.clamps), 0.0
    directions: list[tuple[int, np.ndarray, np.ndarray]] = []
    for which, clamp in enumerate(body.clamps):
        for axis, value, nodes, direction in _constrained(mesh, clamp, key):
            if axis == "normal":
                smooth = np.einsum("ki,ki->k", direction, outer[nodes]) > np.cos(SHARPEST)
                outer[nodes] = direction = np.where(smooth[:, None], outer[nodes], direction)
            directions.append((which, nodes, direction))
            # Gram and Schmidt: the free part of the new direction. If nothing of it is free, earlier clamps prescribe
            # the displacement along it, and both values must agree.
            rest = np.einsum("kij,kj->ki", free[nodes], direction)
            new = np.linalg.norm(rest, axis=1) > SAME
            wanted = np.zeros((len(names), len(nodes)))
            wanted[names.index(clamp.history)] = values_at(value, mesh.points[nodes], key)
            before = np.einsum("hki,ki->hk", moved[:, nodes], direction)
            allowed = ALIKE * np.maximum(np.abs(wanted), np.abs(before))
            allowed += EXACT * np.linalg.norm(moved[:, nodes], axis=2)
            clash = np.flatnonzero(~new & (np.abs(wanted - before) > allowed).any(axis=0))
            if len(clash):
                one, other, node = (
                    before[:, clash[0]].sum(),
                    wanted[:, clash[0]].sum(),
                    nodes[clash[0]],
                )
                where = f"{key}: {axis} at {in_words(mesh.points[node])} is prescribed "
                if mesh.on_axis[node] and axis == "x":
                    raise InputError(
                        f"{where}as {other:.6g}, and what lies on the axis does not move radially; write "
                        'a formula that is zero there, such as x = "1e-3 * x"'
                    )
                raise InputError(
                    f"{where}twice, as {one:.6g} and, on {clamp.on!r}, as {other:.6g}"
                    + ", with another history" * bool(one == other)
                )
            rows, columns = np.nonzero(np.abs(direction) > SAME)
            clamps[nodes[rows], columns] = which
            nodes, rest = nodes[new], rest[new]
            squares = (rest**2).sum(axis=1)
            # The change along `rest` that makes u · direction = wanted, without touching the directions clamped before.
            moved[:, nodes] += ((wanted - before)[:, new] / squares)[:, :, None] * rest
            free[nodes] -= rest[:, :, None] * rest[:, None] / squares[:, None, None]
    free[np.einsum("kii->k", free) < 0.5] = 0.0  # the trace is the number of free directions
    return Supports(clamps, free, dict(zip(names, moved, strict=True)), directions)


def _constrained(
    mesh: Mesh, clamp: Clamp, key: str
) -> Iterator[tuple[str, Any, np.ndarray, np.ndarray]]:
    """The components of a clamp: name, value, nodes (k,), and unit vectors (k, d) at them."""
    nodes = mesh.nodes_of(clamp.on)
    for axis, value, unit in zip("xyz", clamp.components, np.eye(3), strict=True):
        if value is not None and unit[: mesh.dimension].any():
            yield axis, value, nodes, np.tile(unit[: mesh.dimension], (len(nodes), 1))
    if clamp.normal is not None:
        if clamp.on not in mesh.groups:
            raise InputError(
                f"{key}: {clamp.on!r} is no boundary group of the mesh and has no normal; give x, y or z, or along"
            )
        if clamp.on in mesh.vertices:
            at = in_words(mesh.points[mesh.vertices[clamp.on][0]])
            raise InputError(
                f"{key}: the node of {clamp.on!r} at {at} is on no {mesh.cell.facet.name} of it and has "
                "no normal; give x, y or z, or along"
            )
        yield "normal", clamp.normal, *outer_normals(mesh, clamp.on, key)
    if clamp.along is not None:
        ways = values_at(clamp.along, mesh.points[nodes], key).T
        length = np.linalg.norm(ways, axis=1)
        nowhere = length <= ALIKE * length.max()
        if nowhere.any():
            at = in_words(mesh.points[nodes[nowhere][0]])
            raise InputError(
                f"{key}: along has no direction at {at}, on {clamp.on!r}: it is zero there"
            )
        yield "along", clamp.value, nodes, ways / length[:, None]


def refuse_underflow(
    mesh: Mesh, body: BodySpec, f: np.ndarray, prescribed: np.ndarray, stiffest: float
) -> None:
    """Raise InputError for numbers too small to compute with: loads, nodal loads f (nv, d) in newtons, `prescribed`
    displacements (nv, d) in metres, or f over the `stiffest` entry (N/m). Not collective."""
    groups = [
        (load.given, mesh.points[mesh.facets(load.on).nodes.ravel()]) for load in body.traction
    ]
    values = [
        evaluate(value, *points.T) for value, points in [*groups, (body.weight[0], mesh.points)]
    ]
    sizes = [float(np.abs(value).max()) for value in (*values, f, prescribed)]
    small = [size for size in (*sizes, float(np.abs(f).max() / stiffest)) if 0.0 < size < SMALLEST]
    if small:
        raise InputError(
            f"body.{body.name}: loads or prescribed displacements are so small ({min(small):.3g}) that "
            "their squares are out of the range of double precision; choose other units"
        )


def lost_loads(
    body: BodySpec, free: np.ndarray, acting: Mapping[str | None, Sequence[tuple[str, np.ndarray]]]
) -> list[str]:
    """Warnings of loads that act on clamps alone, and of groups that have a load or springs twice; `acting` are the
    loads by history, as of `loads_by_group`. Not collective."""
    key = f"body.{body.name}"
    warnings: list[str] = [
        Doubt(
            f"{key}: the load on {group!r} along {way} is lost, as clamps constrain the whole group in this direction",
            "lost",
            np.abs(f).sum(),
        )
        for group, f in (each for groups in acting.values() for each in groups)
        if group != VOLUME and f.any()
        for way in _lost_along(f, free)
    ]
    given = Counter(_given_twice(body, acting))
    return warnings + [
        Doubt(f"{key}: {group!r} has {1 + more} {what}; they add up", "twice", 1 + more)
        for (group, what, _), more in given.items()
    ]


def _lost_along(f: np.ndarray, free: np.ndarray) -> Iterator[str]:
    """The axes, or else the direction, along which nodal forces (nv, d) act on clamps alone."""
    loaded = f.any(axis=1)
    share, ways = np.linalg.eigh(free[loaded].mean(axis=0))
    clamped = ways[:, share <= SAME]  # directions, at all loaded nodes
    held = clamped @ clamped.T
    lost, least = f[loaded] @ held, ALIKE * np.linalg.norm(f, axis=1).max()
    for axis, name in enumerate("xyz"[: len(held)]):
        if held[axis, axis] > 1.0 - SAME:
            if np.abs(lost[:, axis]).max() > least:
                yield name
            lost[:, axis] = 0.0
    sizes = np.linalg.norm(lost, axis=1)
    if sizes.max() > least:
        yield in_words(lost[sizes.argmax()] / sizes.max(), 2)


def _given_twice(
    body: BodySpec, acting: Mapping[str | None, Sequence[tuple[str, np.ndarray]]]
) -> Iterator[tuple[str, str, str | None]]:
    """Group, words and history of each load and foundation that does what an earlier one does. Loads of two kinds are
    meant, such as a pressure and a shear, a force and a moment; so are two of one kind across each other."""
    former = dict[tuple[str, str, str | None], list[np.ndarray]]()
    for history, groups in acting.items():
        tractions = [load for load in body.traction if load.history == history]
        # the volume force is the last one of the groups, and has no traction
        for load, (_, f) in zip(tractions, groups, strict=False):
            like = load.on, f"loads by {load.kind}", history
            before = former.setdefault(like, [])
            if any(
                abs(np.vdot(f, g)) > ALIKE * np.linalg.norm(f) * np.linalg.norm(g) for g in before
            ):
                yield like
            before.append(f)
    springs = set[tuple[str, str]]()
    for foundation in body.foundation:
        ways = {
            (foundation.on, way) for way in ("normal", "tangential") if getattr(foundation, way)
        }
        if ways & springs:
            yield foundation.on, "foundations", None
        springs |= ways
