"""The gradient of one result by all that a scene can be differentiated by, and by the gap at every node, from one
solve of the transposed equations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field
from math import comb

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.chain import Answered
from ddmpi.derive.entries import CLEAR, ENOUGH, Entry, measures
from ddmpi.derive.parameters import Parameter, parameter, scaled
from ddmpi.errors import InputError, SolverError, nearest
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState
from ddmpi.methods.linear import AIM, PURPOSE, Linearisation
from ddmpi.methods.newton import Newton
from ddmpi.scene.derivable import derivable
from ddmpi.scene.scene import Settled
from ddmpi.sets import magnitude
from ddmpi.system.agreement import agreed, merged

RESULTS = {
    "contacts": (
        "force",
        "moment",
        "normal_force",
        "tangential_force",
        "pressure_max",
        "dissipated",
    ),
    "bodies": ("reaction",),
    "rigid": ("force", "displacement"),
}
"""The results that have gradients, by their entries in the summary."""


@dataclass
class Functional:
    """The derivative of a result: dJ = forces · ds + moves · d(closed) + motions · dα + Σ bounds · dg + what else acts.

    Attributes
    ----------
    forces, moves : (size,) by contact forces, and by relative displacements less gaps
    motions : (rigid.size,) by motions of loose bodies
    bounds : by contact of this rank, (mt,) by the sum of slip bounds now and at first, at given forces
    body, partner : the body whose reaction it is, or the rigid partner whose displacement; then also the axis
    """

    forces: np.ndarray
    moves: np.ndarray
    motions: np.ndarray
    bounds: dict[str, np.ndarray] = field(default_factory=dict)
    body: str = ""
    partner: str = ""
    axis: int = 0


def gradient(assembly: Assembly, outer: Newton, answer: Answered, result: str) -> Entry:
    """The derivatives of a `result`, such as "contacts.fit.normal_force", by key, and under "gap" by the gap at every
    node (m,) of each contact; of an answer in one load step. By a key None, by a gap NaN, where the answer does not
    follow: where a load drives a motion that is held, or contacts that stick at one node stand against the change.

    Collective. Raises InputError for an unknown result, and SolverError where the equations are not solved precisely.
    """
    world, joint = assembly.world, assembly.joint
    if assembly.scene.time:
        raise InputError(
            f"gradient({result!r}): not possible with load steps; set output.derivatives instead"
        )
    with agreed(world):
        wanted = functional(assembly, answer.states, result)
    if wanted.body:  # equilibrium: the reaction is what loads and contact forces on a body leave
        unit = np.eye(assembly.scene.dimension)[wanted.axis]
        of_bodies = [
            member.trace(np.tile(unit, (len(member.motions), 1))) * (member.name == wanted.body)
            for member in joint.members
        ]
        wanted.forces = joint.exchange.total(of_bodies, "reaction")
    equations = outer.linearisation()
    w, q, beta, fields, moved = _adjoint(assembly, equations, wanted, result)
    barred, _ = equations.unseen(transposed=True)
    hindered = _hindered(assembly, barred)
    found, known = list[float](), list[str]()
    pulls, stops = list[np.ndarray](), list[np.ndarray]()
    for one in _parameters(assembly):
        known.append(one.key)
        # what γ and changes of bounds add at given forces; around loads and motions, the work of w
        along = equations.along_slip(one.bounds(assembly, equations.point.s))
        total = float(q @ along + w @ (one.driven - one.opening))
        for name in wanted.bounds.keys() & one.law.keys():
            law, s = one.law[name], equations.point.s[assembly.space.parts[name]]
            total += float(wanted.bounds[name] @ (law.bound_at(s) + law.bound_at(0.0 * s)))
        for name, case in one.load(assembly, answer.displacements, 1.0).items():
            loads, moves = case.f + case.heat, moved[name] * case.prescribed
            total += float((fields[name] * (loads - case.taken) + moves).sum())
            if name == wanted.body:
                total -= float(loads[:, wanted.axis].sum())
        if world.rank == 0:
            total += float(beta @ one.force)
            if one.moved and one.moved[0] == wanted.partner:
                total += float(one.moved[1][wanted.axis])
        found.append(total)
        pulls.append(_pull(assembly, one, answer))
        stops.append(hindered(one, answer))
    gaps = _by_gaps(assembly, w, barred)
    told = zip(known, _told(assembly, found, pulls, stops), strict=True)
    return Entry(told, gap=Entry(merged(world, gaps)))


def _told(
    assembly: Assembly, found: list[float], pulls: list[np.ndarray], stops: list[np.ndarray]
) -> list[float | None]:
    """The sums of derivatives over the ranks, None where loads drive a motion that is held, and where contacts stand
    against a change. Collective."""
    world, stays = assembly.world, assembly.joint.stays
    totals = world.allreduce(np.array(found)).tolist()
    works, sizes = world.allreduce(np.array(stops).reshape(-1, 2)).T
    barred = np.abs(works) > CLEAR * sizes
    if stays.held.size:
        driving = world.allreduce(np.array(pulls))
        barred |= np.array([bool(stays.drives(pull)) for pull in driving], bool)
    return [None if no else total for no, total in zip(barred, totals, strict=True)]


def _pull(assembly: Assembly, one: Parameter, answer: Answered) -> np.ndarray:
    """The change (rigid.size,) of loads along rigid motions by a parameter, this rank's part (N). Not collective."""
    pull, slices = np.where(assembly.world.rank == 0, 1.0, 0.0) * one.force, assembly.joint.slices
    cases = one.load(assembly, answer.displacements, 1.0)
    for body in assembly.bodies:
        if body.spec.name in cases:
            pull[slices[body.spec.name]] += body.member.body.push(cases[body.spec.name])
    return pull


def _adjoint(
    assembly: Assembly, equations: Linearisation, wanted: Functional, result: str
) -> tuple[np.ndarray, np.ndarray, np.ndarray, dict[str, np.ndarray], dict[str, np.ndarray]]:
    """The answer to the transposed equations, of which dJ = w·ρ + β·de + q·γ: the work of forces w (size,) on changes
    of gaps ρ, and what forces γ beyond the law add; motions β (rigid.size,); and by body of this rank the displacements
    (nv, d) under these, and Bᵀ w. Collective. Raises SolverError where GMRES does not solve them precisely."""
    space, joint = assembly.space, assembly.joint
    j = wanted.forces
    if space.any(wanted.moves):  # d(closed) = ρ + Z dα − C ds
        j = j - joint.product(wanted.moves, PURPOSE, AIM)
    _refuse_vague(equations, j, result)
    z, beta, residual = equations.adjoint(j, wanted.motions + joint.rigid.sums(wanted.moves))
    if residual > ENOUGH:
        raise SolverError(
            f"gradient({result!r}): GMRES does not solve the equations to {ENOUGH:.0e}"
        )
    w = z + wanted.moves
    q = j - (joint.product(z, PURPOSE, AIM) if space.any(z) else 0.0) - joint.rigid.spread(beta)
    fields, moved = dict[str, np.ndarray](), dict[str, np.ndarray]()
    parts = joint.exchange.spread(w)
    with agreed(assembly.world):
        for body, of_body in zip(assembly.bodies, parts, strict=True):
            name = body.spec.name
            member = body.member.loaded_by(scaled(body.member.elasticity.acting, 0.0))
            fields[name], *_ = member.displacement(-of_body, beta[joint.slices[name]], PURPOSE)
            moved[name] = -member.pull(of_body)  # Bᵀ w
    return w, q, beta, fields, moved


def _parameters(assembly: Assembly) -> Iterator[Parameter]:
    """By what the answer can be differentiated, but for clamps that cannot change alone. Collective."""
    for key in derivable(assembly.scene.resolved()):
        one = None
        with suppress(InputError):
            one = parameter(assembly, key)
        if assembly.world.allreduce(one is not None, MPI.LAND):
            assert one is not None
            yield one


def _refuse_vague(equations: Linearisation, j: np.ndarray, result: str) -> None:
    """Raise SolverError, on all ranks, for a result whose derivative j (size,) by forces no equation determines.
    Collective."""
    unseen, _ = equations.unseen()
    change, size = equations.joint.space.add(np.array([j @ unseen, np.abs(j) @ np.abs(unseen)]))
    if abs(change) > CLEAR * size:
        raise SolverError(
            f"gradient({result!r}): it depends on forces of several contacts at one node, of which only the sum is "
            "determined"
        )


def _by_gaps(assembly: Assembly, w: np.ndarray, barred: np.ndarray) -> dict[str, np.ndarray]:
    """By contact of this rank the derivatives (m,) by the gaps of its nodes, of which those `barred` have none."""
    return {
        met.name: np.where(barred[part] == 0.0, -met.scale * w[part], np.nan)[: met.m]
        for met, part in assembly.space.with_slices()
    }


def _hindered(
    assembly: Assembly, barred: np.ndarray
) -> Callable[[Parameter, Answered], np.ndarray]:
    """The work of the forces `barred` (size,) on the motions of a parameter, and the size of its terms (2,), of this
    rank. Where the first is not zero, contacts that stick at one node stand against the change, and the answer does not
    follow it. Not collective, but for the construction."""
    parts = assembly.joint.exchange.spread(barred)
    pulls = {
        body.spec.name: body.member.pull(part)
        for body, part in zip(assembly.bodies, parts, strict=True)
    }

    def hindered(one: Parameter, answer: Answered) -> np.ndarray:
        terms = [barred * (one.driven - one.opening)]
        for name, case in one.load(assembly, answer.displacements, 1.0).items():
            terms.append((pulls[name] * case.prescribed).ravel())
        return np.array(
            [sum(term.sum() for term in terms), sum(np.abs(term).sum() for term in terms)]
        )

    return hindered


def functional(assembly: Assembly, states: Mapping[str, ContactState], result: str) -> Functional:
    """The derivative of a result by its name, on this rank's contacts. Raises InputError. Not collective."""
    space, joint = assembly.space, assembly.joint
    kind, name, what, axis = _parsed(assembly.scene, result)
    forces, moves, motions = np.zeros(space.size), np.zeros(space.size), np.zeros(joint.rigid.size)
    found = Functional(forces, moves, motions, axis=axis)
    if kind == "contacts":
        for interface, part in space.with_slices():
            if interface.name == name and what == "dissipated":
                _dissipate(found, interface, part, states[name])
            elif interface.name == name:
                forces[part] = np.atleast_2d(measures(states[name])[what])[axis]
    elif kind == "bodies":
        found.body = name
    elif what == "displacement":
        found.partner = name
        for each in joint.driven:
            if each.name == name:  # `shift` is linear in the motions
                shifts = [each.shift(one)[axis] for one in np.eye(len(each.push))]
                motions[joint.slices[name]] = shifts
    else:
        for interface, part in space.with_slices():
            if interface.bodies[1] == name:
                forces[part] = interface.directions[:, axis]
    return found


def _parsed(scene: Settled, result: str) -> tuple[str, str, str, int]:
    """Group, name, entry and component of a result. Raises InputError where it has no gradient."""
    kind, name, what, axis = (*result.split("."), "", "", "")[:4]
    axis = axis.translate(str.maketrans("012", "xyz"))
    letters = [f".{letter}" for letter in "xyz"[: scene.dimension]]
    vectors = ["force", "reaction", "displacement"]
    if comb(scene.dimension, 2) > 1:  # else there is one moment, for one rotation
        vectors.append("moment")
    able = [
        f"{group}.{entry.name}.{one}{end}"
        for group, entries in (
            ("contacts", scene.contact),
            ("bodies", scene.body),
            ("rigid", scene.rigid),
        )
        for entry in entries
        for one in RESULTS[group]
        for end in (letters if one in vectors else [""])
    ]
    same = f"{kind}.{name}.{what}" + f".{axis}" * bool(axis)
    if same not in able:
        near = nearest(same, able) or f" (such as {able[0]!r})"
        raise InputError(f"gradient({result!r}): there is no such result{near}")
    if kind == "bodies" and scene.axisymmetric and axis == "x":
        raise InputError(
            f"gradient({result!r}): radial reactions of axisymmetric bodies have none; take y"
        )
    return kind, name, what, max("xyz".find(axis), 0)


def _dissipate(found: Functional, interface: Interface, part: slice, state: ContactState) -> None:
    """Put the derivative of the work of friction on a contact, ½ (g + g_0) |slip| of the nodes that rub."""
    law, m = interface.law, interface.m
    resistance = np.broadcast_to(state.resistance, (m,))[law.sliding]
    slip, s = state.slip[law.sliding], np.append(state.normal_force, np.zeros(law.size - m))
    size = magnitude(slip)
    bounds = 0.5 * size * (resistance > 0.0)
    slopes = law.slope(s[:m]) * (s[:m] > 0.0)[law.sliding]
    along = (resistance / np.where(size > 0.0, size, 1.0))[:, None] * slip
    found.bounds[interface.name] = bounds
    law.split(found.moves[part])[1][:] = along
    np.add.at(found.forces[part], law.sliding, bounds * slopes)
