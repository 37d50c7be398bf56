"""The gradient of one result by all that a scene can be differentiated by, and by the gap at every node, from one
solve of the transposed equations."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import comb

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.chain import Answered
from ddmpi.derive.entries import ENOUGH, Entry, measures
from ddmpi.derive.parameters import parameter, scaled
from ddmpi.errors import InputError, SolverError, nearest
from ddmpi.interface.state import ContactState
from ddmpi.methods.linear import AIM, PURPOSE
from ddmpi.methods.newton import Newton
from ddmpi.scene.derivable import derivable
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
    """The derivatives of a `result`, such as "contacts.fit.normal_force" or "bodies.shaft.reaction.y", by key, and
    under "gap" by the gap at every node (m,) of each contact; of an answer in one load step.

    Collective. Raises InputError for an unknown result, and SolverError where the equations are not solved precisely.
    """
    world, space, joint = assembly.world, assembly.space, assembly.joint
    if assembly.scene.time:
        raise InputError(
            f"gradient({result!r}): not possible with load steps; set output.derivatives instead"
        )
    with agreed(world):
        wanted = functional(assembly, answer.states, result)
    if wanted.body:  # equilibrium: the reaction is what loads and contact forces on a body leave
        unit = np.eye(assembly.scene.dimension)[wanted.axis]
        wanted.forces = joint.exchange.total(
            [
                member.trace(np.tile(unit, (len(member.motions), 1))) * (member.name == wanted.body)
                for member in joint.members
            ],
            "reaction",
        )
    equations = outer.linearisation()
    j = wanted.forces
    if space.any(wanted.moves):  # d(closed) = ρ + Z dα − C ds
        j = j - joint.product(wanted.moves, PURPOSE, AIM)
    z, beta, residual = equations.adjoint(j, wanted.motions + joint.rigid.sums(wanted.moves))
    if residual > ENOUGH:
        raise SolverError(
            f"gradient({result!r}): GMRES does not solve the equations to {ENOUGH:.0e}"
        )
    # dJ = w·ρ + β·de + q·γ: the work of forces w on changes of gaps, and what forces beyond the law add
    w = z + wanted.moves
    q = j - (joint.product(z, PURPOSE, AIM) if space.any(z) else 0.0) - joint.rigid.spread(beta)
    fields, moved, parts = (
        dict[str, np.ndarray](),
        dict[str, np.ndarray](),
        joint.exchange.spread(w),
    )
    with agreed(world):
        for body, of_body in zip(assembly.bodies, parts, strict=True):
            name, member = (
                body.spec.name,
                body.member.loaded_by(scaled(body.member.elasticity.acting, 0.0)),
            )
            fields[name], *_ = member.displacement(-of_body, beta[joint.slices[name]], PURPOSE)
            moved[name] = -member.pull(of_body)  # Bᵀ w
    found, known = list[float](), list[str]()
    for key in derivable(assembly.scene.resolved()):
        one, lost = None, False
        try:
            one = parameter(assembly, key)
        except InputError:
            lost = True
        if world.allreduce(lost, MPI.LOR):
            continue  # a clamp that cannot change alone
        assert one is not None
        known.append(key)
        bounds = one.bounds(assembly, equations.point.s)
        # what γ and changes of bounds add at given forces; around loads and motions, the work of w
        total = float(q @ equations.along_slip(bounds) + w @ (one.driven - one.opening))
        for name in wanted.bounds.keys() & one.law.keys():
            law, s = one.law[name], equations.point.s[space.parts[name]]
            total += float(wanted.bounds[name] @ (law.bound_at(s) + law.bound_at(0.0 * s)))
        for name, case in one.load(assembly, answer.displacements, 1.0).items():
            total += float(
                (
                    fields[name] * (case.f + case.heat - case.taken) + moved[name] * case.prescribed
                ).sum()
            )
            if name == wanted.body:
                total -= float((case.f + case.heat)[:, wanted.axis].sum())
        if world.rank == 0:
            total += float(beta @ one.force)
            if one.moved and one.moved[0] == wanted.partner:
                total += float(one.moved[1][wanted.axis])
        found.append(total)
    totals = world.allreduce(np.array(found))
    gaps = {
        interface.name: -interface.scale * w[part][: interface.m]
        for interface, part in space.with_slices()
    }
    return Entry(zip(known, totals.tolist(), strict=True), gap=Entry(merged(world, gaps)))


def functional(assembly: Assembly, states: Mapping[str, ContactState], result: str) -> Functional:
    """The derivative of a result by its name, on this rank's contacts. Raises InputError. Not collective."""
    scene, space, joint = assembly.scene, assembly.space, assembly.joint
    kind, name, what, axis = (*result.split("."), "", "", "")[:4]
    axis = axis.translate(str.maketrans("012", "xyz"))
    found = Functional(
        np.zeros(space.size),
        np.zeros(space.size),
        np.zeros(joint.rigid.size),
        axis=max("xyz".find(axis), 0),
    )
    vectors = [
        "force",
        "reaction",
        "displacement",
        *["moment"] * (comb(scene.dimension, 2) > 1),
    ]  # one for a rotation
    able = [
        f"{group}.{entry.name}.{one}{end}"
        for group, entries in (
            ("contacts", scene.contact),
            ("bodies", scene.body),
            ("rigid", scene.rigid),
        )
        for entry in entries
        for one in RESULTS[group]
        for end in (
            [f".{letter}" for letter in "xyz"[: scene.dimension]] if one in vectors else [""]
        )
    ]
    same = f"{kind}.{name}.{what}" + f".{axis}" * bool(axis)
    if same not in able:
        near = nearest(same, able) or f" (such as {able[0]!r})"
        raise InputError(f"gradient({result!r}): there is no such result{near}")
    if kind == "bodies":
        if scene.axisymmetric and found.axis == 0:
            raise InputError(
                f"gradient({result!r}): radial reactions of axisymmetric bodies have none; take y"
            )
        found.body = name
    if kind == "rigid" and what == "displacement":
        found.partner = name
        for each in joint.driven:
            if each.name == name:  # `shift` is linear in the motions
                found.motions[joint.slices[name]] = [
                    each.shift(one)[found.axis] for one in np.eye(len(each.push))
                ]
    for interface, part in space.with_slices():
        if kind == "rigid" and what == "force" and interface.bodies[1] == name:
            found.forces[part] = interface.directions[:, found.axis]
        if kind != "contacts" or interface.name != name:
            continue
        state, law, m = states[name], interface.law, interface.m
        if what != "dissipated":
            found.forces[part] = np.atleast_2d(measures(state)[what])[
                found.axis if what in vectors else 0
            ]
            continue
        # ½ (g + g_0) |slip| of the nodes that rub
        resistance = np.broadcast_to(state.resistance, (m,))[law.sliding]
        slip, s = state.slip[law.sliding], np.append(state.normal_force, np.zeros(law.size - m))
        size = magnitude(slip)
        found.bounds[name] = 0.5 * size * (resistance > 0.0)
        law.split(found.moves[part])[1][:] = (resistance / np.where(size > 0.0, size, 1.0))[
            :, None
        ] * slip
        np.add.at(
            found.forces[part],
            law.sliding,
            found.bounds[name] * law.slope(s[:m]) * (s[:m] > 0.0)[law.sliding],
        )
    return found
