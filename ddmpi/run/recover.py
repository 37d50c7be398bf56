"""How bodies move under the contact forces that are found, and the forces on them by group."""

from collections.abc import Mapping
from functools import partial
from typing import Any

import numpy as np

from ddmpi.body.elasticity import clamp_forces
from ddmpi.body.loads import added, loads_by_group, resultants
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.coupling.member import Member
from ddmpi.methods.outer import Outer
from ddmpi.system.numbers import Frame, norm

NOTHING = 1e-10
"""Forces of a contact and displacements of a body below this fraction of the largest in the load steps before are
rounding, and become zero."""

Moved = tuple[
    dict[str, np.ndarray], list[np.ndarray], dict[str, dict[str, Any]], dict[tuple[str, int], tuple]
]
"""How the bodies of a rank move under the outer method's forces: by name their displacements (nv, d); their contact
displacements; by name the sizes for the certificate; by contact and side the motion beside the nodes, and yielding."""


def displaced(
    assembly: Assembly, outer: Outer, largest: np.ndarray, left: np.ndarray | None = None
) -> Moved:
    """By displacements of all nodes. `left` (rigid.size,) are the loads along motions that are not held which the forces
    leave without balance (N), None if none is held. Not collective."""
    displacements = dict[str, np.ndarray]()
    traces = list[np.ndarray]()
    sizes = dict[str, dict[str, Any]]()
    beside: dict[tuple[str, int], tuple[np.ndarray, np.ndarray, float]] = {}
    for body, s in zip(assembly.bodies, outer.body_forces(), strict=True):
        member, at = body.member, assembly.joint.slices[body.spec.name]
        alpha = outer.motions[at]
        u = np.zeros_like(member.elasticity.acting.prescribed)
        apart = np.nan
        acting = 0.0
        energy = np.nan
        with (
            assembly.exchange.deferred()
        ):  # an error is raised on all ranks, after the next exchange
            u, apart, acting, energy = recover(
                member, s, alpha, largest, _of_body(assembly, at, left)
            )
        traces.append(member.trace(u))
        # C s, by which contact forces move the contacts: all but the free displacement and rigid motions
        yielding = float(np.abs(member.h + member.G.T @ alpha - traces[-1]).max(initial=0.0))
        displacements[member.name] = u
        beside |= {key: (*motion, yielding) for key, motion in member.beside(u).items()}
        farthest = float(np.linalg.norm(u, axis=1).max())
        sizes[member.name] = {
            "left": apart,
            "acting": acting,
            "moved": farthest,
            "yielding": yielding,
            "made": member.stiffness * farthest,
            "load": member.elasticity.load,
            "energy": energy,
            "confined": member.elasticity.acting.confined,
            "work": member.work(u, s),
        }
    return displacements, traces, sizes, beside


def _of_body(assembly: Assembly, at: slice, left: np.ndarray | None) -> np.ndarray | None:
    """The part of `left` of the body with the motions `at`, None if none of these is held. Not collective."""
    return left[at] if left is not None and assembly.joint.stays.held[at].any() else None


def at_contacts(
    assembly: Assembly, outer: Outer, largest: np.ndarray, left: np.ndarray | None = None
) -> Moved:
    """The same by products with the compliances, as far as these know it. Not collective."""
    force, moved, _ = NOTHING * largest
    traces = list[np.ndarray]()
    sizes = dict[str, dict[str, Any]]()
    beside = dict[tuple[str, int], tuple]()
    for body, s in zip(assembly.bodies, outer.body_forces(), strict=True):
        member, at = body.member, assembly.joint.slices[body.spec.name]
        alpha, apart = outer.motions[at], _of_body(assembly, at, left)
        u, yielded, energy, work = *np.full((2, member.size), np.nan), np.nan, np.zeros((2, 1))
        with assembly.exchange.deferred():
            u, yielded, energy, work = member.at_contacts(s, alpha)
        acting = max(norm(member.e), norm(s))
        if acting <= force and np.abs(u).max(initial=0.0) <= moved:  # as in `recover`
            u = np.zeros_like(u)  # loads that move no contact store energy all the same
        traces.append(u)
        farthest, yielding = (float(np.abs(array).max(initial=0.0)) for array in (u, yielded))
        beside |= {(name, side): (None, None, yielding) for name, (_, side) in member.parts.items()}
        apart = member.e - member.G @ s if apart is None else apart
        sizes[member.name] = {
            "left": norm(apart),
            "acting": acting,
            "moved": farthest,
            "yielding": yielding,
            "made": member.stiffness * farthest,
            "load": member.load,
            "energy": energy,
            "confined": 0.0,  # of the ends of legs
            "work": work,
        }
    return {}, traces, sizes, beside


def recover(
    member: Member,
    s: np.ndarray,
    alpha: np.ndarray,
    largest: np.ndarray,
    apart: np.ndarray | None = None,
) -> tuple[np.ndarray, float, float, float]:
    """`Member.displacement`, but zero where it and its forces are rounding beside the `largest` sizes (3,) so far."""
    solve = member.displacement if apart is None else partial(member.displacement, left=apart)
    u, left, acting, energy = solve(s, alpha)
    force, moved, _ = NOTHING * largest
    if acting <= force and np.abs(u).max() <= moved:
        u, energy = np.zeros_like(u), 0.0
    return u, left, acting, energy


def forces_by_group(
    body: Body,
    u: np.ndarray,
    s: np.ndarray,
    factors: Mapping[str | None, float],
    frames: Mapping[str, Frame] | None = None,
) -> dict:
    """The applied loads and the forces of clamps, by group, and the resultant of the latter, under the displacement u
    (nv, d) and contact forces s (size,); of a body that moves far, where its frame is. Not collective."""
    mesh, member, frame = body.mesh, body.member, (frames or {}).get(body.spec.name)
    reactions = resultants(
        mesh, clamp_forces(mesh, body.spec, member.elasticity, u, member.pull(s))
    )
    acting = added(
        (group, {kind: factor * value for kind, value in entry.items()})
        for history, factor in factors.items()
        for group, entry in member.elasticity.pushes.get(history, {}).items()
    )
    if frame:
        acting = resultants(
            mesh,
            (
                (group, factor * f)
                for history, factor in factors.items()
                for group, f in loads_by_group(mesh, body.spec, history, frame.turned)
            ),
        )
        reactions, acting = (
            {group: _in_world(entry, frame) for group, entry in entries.items()}
            for entries in (reactions, acting)
        )
    return {
        "reaction": sum(
            (reaction["force"] for reaction in reactions.values()), np.zeros(mesh.dimension)
        ),
        "loads": acting,
        "reactions": reactions,
    }


def _in_world(entry: dict, frame: Frame) -> dict:
    """Resultants of a body where its frame is: M_0 of a force at c + Q X is Q M + c × Q F."""
    force, moment = frame.along(entry["force"]), entry["moment"]
    turned = frame.along(moment) if np.ndim(moment) else moment
    return entry | {"force": force, "moment": turned + np.cross(frame.shift, force)}


def driven_partners(assembly: Assembly, outer: Outer) -> dict[str, dict[str, float]]:
    """The sizes of driven partners, and of free frames with clamps, which are bodies without elasticity. Collective."""
    joint, pushes = assembly.joint, assembly.pushes
    # what clamps hold in a free frame balances by itself; the whole of it, with its clamps, by contacts and loads
    held = {
        name: lambda interface, name=name: name in interface.bodies
        for name, frame in assembly.free.items()
        if frame.part and name not in pushes
    }
    unbalanced = joint.imbalance(outer.forces, outer.motions) if joint.driven or held else joint.e
    sizes = {}
    for name, acts_on in ({each.name: each.acts_on for each in joint.driven} | held).items():
        at = joint.slices[name]
        # contact forces may cancel, as on a partner that moves freely without a force
        squares = [
            float(outer.forces[part] @ outer.forces[part])
            for interface, part in assembly.space.with_slices()
            if acts_on(interface)
        ]
        contact = float(np.sqrt(assembly.space.add(np.array([sum(squares)]))[0]))
        acting = max(norm(joint.e[at]), norm(joint.e[at] - unbalanced[at]), contact)
        sizes[f"frame of {name}" if name in held else name] = dict.fromkeys(
            ("yielding", "made", "energy", "confined", "work"), 0.0
        ) | {
            "left": norm(unbalanced[at]),
            "acting": acting,
            "moved": norm(outer.motions[at]),
            "load": pushes.get(name, 0.0),
        }
    return sizes
