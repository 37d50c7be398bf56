"""The errors of results by the meshes: their adjoints, and what cells, ends of contacts and straight sides add."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from ddmpi.body.estimate import nodal_stress
from ddmpi.body.loads import values_at
from ddmpi.body.stress import Composite, stress, thickness_of, von_mises
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.derive.adjoint import Adjoint, VagueError, displaced, solve_adjoint
from ddmpi.derive.entries import CLEAR
from ddmpi.derive.results import functional
from ddmpi.errors import SolverError
from ddmpi.interface.state import Answered
from ddmpi.judge.bars import (
    RUBS,
    UNDETERMINED,
    UNSOLVED,
    Dual,
    Measured,
    arcs_of,
    corner_of_pressure,
    corners_of,
    ends_of_contact,
    kink_of_pressure,
    kink_of_stress,
    parts_of,
    straight_sides,
)
from ddmpi.mesh.elements import facet_measures
from ddmpi.methods.linear import Linearisation
from ddmpi.methods.newton import Newton
from ddmpi.results.summary import quantity_of
from ddmpi.scene.bodies import Material
from ddmpi.scene.results import Named, named
from ddmpi.sets import magnitude
from ddmpi.system.agreement import agreed
from ddmpi.system.numbers import ROUNDING, norm

AIM, DEAR = 1e-6, 1e-2
"""Relative residual of the adjoint equations, and where products are by an iterative solver: at 1e-2 bars change by 0.1 to
2 % in space, on blocks in the plane by up to 4 %, and near the least bar, where Σ η_K is a thousandth of ‖e_u‖ ‖e_z‖, by a
third. A number costs a quarter of what it does at 1e-4."""

SUMS = (
    "signed",
    "stars",
    "own",
    "square",
    "size",
    "straight",
    "moved",
    "rubbed",
    "left",
    "rounded",
    "terms",
)
"""What of `Measured` are sums over bodies and contacts."""

OF_STRAINS = ("von_mises_max", "energy")
"""Results that no rigid motion changes, so that their derivatives by motions are rounding."""

TURNED = 0.03
"""A result that held motions change by at most this fraction of what motions do has the bar of the answer in which they
are held: as the largest displacement of a wheel that widens, and may turn."""

TOGETHER = 8
"""How many results share a recovery of stresses, whose arrays grow with their number."""


def measure_errors(
    assembly: Assembly,
    outer: Newton,
    answer: Answered,
    wanted: Sequence[str],
    factors: Mapping[str | None, float],
) -> dict[str, Measured]:
    """What is known of the errors of results by their names, with the cells of this rank's bodies; of the present load
    step, with the `factors` of its loads by history, given the steps before. Collective."""
    equations, found = outer.linearisation(), dict[str, Measured]()
    forces = {body.spec.name: _force(body, factors) for body in assembly.bodies}
    for start in range(0, len(wanted), TOGETHER):
        some = {result: named(result) for result in wanted[start : start + TOGETHER]}
        found |= _together(assembly, equations, answer, some, forces)
    return found


def _together(
    assembly: Assembly,
    equations: Linearisation,
    answer: Answered,
    wanted: Mapping[str, Named],
    forces: Mapping[str, np.ndarray],
) -> dict[str, Measured]:
    """`measure_errors` of results that share a recovery, with the `_force` of each body. Collective."""
    adjoints, found = dict[str, Adjoint](), dict[str, Measured]()
    aim = DEAR if assembly.joint.dear else AIM
    for result, one in wanted.items():
        wants = functional(assembly, answer.states, answer.displacements, one)
        try:
            adjoint = solve_adjoint(assembly, equations, wants, result, aim)
        except SolverError as error:  # the same on all ranks
            vague = isinstance(error, VagueError)
            found[result] = Measured(word=UNDETERMINED if vague else UNSOLVED)
            continue
        if _turns(assembly, one, adjoint.along):
            found[result] = Measured(word=UNDETERMINED)
            continue
        adjoints[result] = adjoint
    some = {result: wanted[result] for result in adjoints}
    fields = displaced(assembly, [*adjoints.values()], aim)
    duals = {result: z for result, (z, _) in zip(adjoints, fields, strict=True)}
    own, cells = _of_bodies(assembly, answer, some, duals, forces)
    sums = [
        [*row, *_at_ends(assembly, equations, adjoint, some[result].what == "moment")]
        for row, (result, adjoint) in zip(own, adjoints.items(), strict=True)
    ]
    areas = _areas(assembly) if any(one.what == "pressure_mean" for one in some.values()) else {}
    sharp, noise = _corners(assembly, some), _noise(assembly, answer)
    mine = [
        (
            *_largest(assembly, answer, sharp, one),
            _area_lost(areas, one),
            noise[quantity_of(result)],
        )
        for result, one in some.items()
    ]
    totals = assembly.world.allreduce(np.array(sums))
    largest = np.array(assembly.world.allgather(mine)).max(axis=0)
    for result, row, here, of_cells in zip(adjoints, totals, largest, cells, strict=True):
        kink, peak, corner, area, least = here.tolist()
        known = dict(zip(SUMS, row.tolist(), strict=True))
        known |= {"kink": kink, "peak": peak, "corner": corner, "area": area, "noise": least}
        found[result] = Measured(**known, cells=of_cells)
    return {result: found[result] for result in wanted}


def _turns(assembly: Assembly, wanted: Named, along: np.ndarray) -> bool:
    """Whether a result changes with held motions, by its derivatives `along` all (rigid.size,)."""
    held, least = assembly.joint.stays.held, TURNED if "displacement" in wanted.what else CLEAR
    return wanted.what not in OF_STRAINS and norm(held.T @ along) > least * norm(along)


def _of_bodies(
    assembly: Assembly,
    answer: Answered,
    wanted: Mapping[str, Named],
    duals: Mapping[str, Mapping[str, np.ndarray]],
    forces: Mapping[str, np.ndarray],
) -> tuple[np.ndarray, list[dict[str, np.ndarray]]]:
    """The first six of SUMS (k, 6) of k results over the bodies of this rank, and by body their cells, from their
    displacements by body. Collective."""
    sums, cells = np.zeros((len(wanted), 6)), [dict[str, np.ndarray]() for _ in wanted]
    with agreed(assembly.world):
        for body in assembly.bodies if wanted else ():
            name = body.spec.name
            parts = parts_of(
                body.mesh,
                body.material,
                (answer.displacements[name], body.member.elasticity.acting.heated),
                [_dual(one, name, duals[result][name]) for result, one in wanted.items()],
                straight_sides(body.mesh, thickness_of(body.mesh, body.spec), _parts(body)),
                forces[name],
                body.member.elasticity.acting.f,
            )
            for of_cells, row in zip(cells, parts.cells, strict=True):
                of_cells[name] = row
            signed = parts.cells.sum(axis=1)
            sums += np.column_stack([signed, parts.stars, parts.squares, parts.straight])
    return sums, cells


def _dual(result: Named, body: str, z: np.ndarray) -> Dual:
    """The adjoint displacement z (nv, d) of a body, with what else the result makes of it."""
    own, taken = result.kind == "bodies" and result.name == body, np.zeros(z.shape[1])
    taken[result.axis] = own and result.what == "reaction"
    return Dual(z, own and result.what == "energy", taken)


def _force(body: Body, factors: Mapping[str | None, float]) -> np.ndarray:
    """The volume force (f, d) at the facets of a body's boundary (N/m³)."""
    mesh, (force, history) = body.mesh, body.spec.weight
    places = mesh.points[mesh.boundary[0]].mean(axis=1)
    values = values_at(force, places, f"body.{body.spec.name}.volume_force")
    parts = [np.broadcast_to(value, len(places)) for value in values]
    return factors[history] * np.column_stack(parts)


def _at_ends(
    assembly: Assembly, equations: Linearisation, adjoint: Adjoint, turns: bool
) -> np.ndarray:
    """The sums (5,) of `ends_of_contact` over the contacts of this rank, of a moment if it `turns`."""
    total, s = np.zeros(5), equations.point.s
    # gaps between quadratic sides are those of parabolas, but where they are given; linear sides have arcs over them
    quadratic = assembly.scene.body[0].mesh.order == 2
    drawn = {each.name for each in assembly.scene.contact if quadratic and each.gap is None}
    for (interface, part), active in zip(
        assembly.space.with_slices(), equations.active, strict=False
    ):
        q, by_forces = adjoint.q[part], adjoint.by_forces[part]
        parabolas = interface.name in drawn and interface.slave is not None
        by_gaps = adjoint.w[part] if parabolas else np.zeros_like(q)
        arms = magnitude(interface.places) * (turns and not interface.axisymmetric)
        total += ends_of_contact(interface, active, s[part], q, by_forces, by_gaps, arms)
    return total


def _noise(assembly: Assembly, answer: Answered) -> dict[str, float]:
    """By quantity `ROUNDING` of the largest in bodies of this rank: of the forces of their stiffness and loads, and what
    these mean as stress on a facet, as moment and as displacement. Not collective."""
    noise = dict.fromkeys(assembly.scene.units, 0.0)
    for body in assembly.bodies:
        mesh, elasticity, u = (
            body.mesh,
            body.member.elasticity,
            answer.displacements[body.spec.name],
        )
        farthest, stiffness = float(np.abs(u).max()), elasticity.stiffest
        force = ROUNDING * max(stiffness * farthest, elasticity.load)
        facets = facet_measures(mesh.points[mesh.boundary[0]], mesh.axisymmetric)
        of_body = {
            "force": force,
            "moment": force * float(np.abs(mesh.points).max()),
            "stress": force / float(np.median(facets)),
            "length": max(ROUNDING * farthest, force / stiffness),
        }
        for quantity, size in of_body.items():
            noise[quantity] = max(noise[quantity], size)
    return noise


def _areas(assembly: Assembly) -> dict[str, float]:
    """By contact of this rank how much the area of its nodes differs from that of the smaller side, over itself.
    Collective."""
    arcs = {
        (contact.name, side): arcs_of(body.mesh, contact.on[side])
        for body in assembly.bodies
        for contact in assembly.scene.contact
        for side, name in enumerate(contact.bodies)
        if name == body.spec.name
    }
    both, lost = assembly.exchange.swap_objects(arcs), dict[str, float]()
    for met in assembly.space.interfaces:
        least = min(arc for arc in both[met.name] if arc is not None)
        lost[met.name] = abs(1.0 - least / met.area.sum()) if met.m else 0.0
    return lost


def _area_lost(areas: Mapping[str, float], result: Named) -> float:
    """Of `_areas`, for a mean pressure; zero for other results and on other ranks."""
    return areas.get(result.name, 0.0) if result.what == "pressure_mean" else 0.0


def _parts(body: Body) -> int:
    """How many parts halvings have made of each side of a body's mesh."""
    return 2**body.spec.mesh.halvings


def _corners(assembly: Assembly, wanted: Mapping[str, Named]) -> dict[str, list[np.ndarray]]:
    """By contact of this rank, of both bodies: (k, d + 2) the nodes of the side (m), `corners_of` them, and the plane
    modulus of a cell there (Pa); none where no largest pressure is wanted. Collective."""
    mine = dict[tuple[str, int], np.ndarray | None]()
    if not any(one.what == "pressure_max" for one in wanted.values()):
        return {}
    for body in assembly.bodies:
        mesh, (facets, beside) = body.mesh, body.mesh.boundary
        moduli = np.zeros(len(mesh.points))
        moduli[facets] = _moduli(body.material, beside)[:, None]
        table = np.column_stack([mesh.points, corners_of(mesh, _parts(body)), moduli])
        for contact in assembly.scene.contact:
            for side, name in enumerate(contact.bodies):
                if name == body.spec.name:
                    nodes = np.unique(mesh.facets(contact.on[side]).nodes)
                    mine[contact.name, side] = table[nodes]
    both, found = assembly.exchange.swap_objects(mine), {}
    for met in assembly.space.interfaces:
        found[met.name] = [one for one in both[met.name] if one is not None]
        if met.image:
            seen, d = found[met.name][1], met.dimension
            found[met.name][1] = np.column_stack([met.image.at(seen[:, :d]), seen[:, d:]])
    return found


def _moduli(material: Material | Composite, cells: np.ndarray) -> np.ndarray:
    """(k,) the plane moduli of some cells (Pa)."""
    if isinstance(material, Material):
        return np.full(len(cells), material.plane_modulus)
    return np.array([one.plane_modulus for one in material.materials])[material.number[cells]]


def _largest(
    assembly: Assembly, answer: Answered, sharp: Mapping[str, list[np.ndarray]], result: Named
) -> tuple[float, float, float]:
    """How far a largest value differs from those beside it, over itself, and by how much `sharp` corners raise it; zero for
    others and on other ranks."""
    state = answer.states.get(result.name)
    if result.what == "pressure_max" and state:
        return kink_of_pressure(state), 0.0, corner_of_pressure(state, sharp[result.name])
    if result.what == "dissipated" and state and len(state.interface.sliding):
        few = state.count("slip") < RUBS and not state.interface.law.two_sided
        return 2.0 * few, 0.0, 0.0
    for body in assembly.bodies:
        if result.what == "von_mises_max" and body.spec.name == result.name:
            u, heat = answer.displacements[result.name], body.member.elasticity.acting.heated
            cells = von_mises(stress(body.mesh, body.material, u, heat))
            nodes = von_mises(nodal_stress(body.mesh, body.material, u, heat))
            return *kink_of_stress(body.mesh, cells, nodes), 0.0
    return 0.0, 0.0, 0.0


def shares(assembly: Assembly, measured: Mapping[str, Measured]) -> dict[str, np.ndarray]:
    """By body of this rank, (nt,) where the errors of results are made: |η_K| over the measure of each cell, over the mean
    of all, and of these the mean over the results. Empty where no result has such. Collective."""
    found = [known.cells for known in measured.values() if known.signed or known.stars]
    measures = {body.spec.name: body.mesh.measures() for body in assembly.bodies}
    mine = [
        sum(float(np.abs(each).sum()) for each in values.values()) for values in (measures, *found)
    ]
    whole, *totals = assembly.world.allreduce(np.array(mine))
    each = [(cells, total) for cells, total in zip(found, totals, strict=True) if total]
    return {
        name: sum(np.abs(cells[name]) / total for cells, total in each) * whole / len(each) / sizes
        for name, sizes in measures.items()
        if each
    }
