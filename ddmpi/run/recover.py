"""How bodies move under the contact forces that are found, and the forces on them by group."""

from collections.abc import Mapping
from typing import Any

import numpy as np

from ddmpi.body.elasticity import clamp_forces
from ddmpi.body.loads import added, loads_by_group, resultants
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.coupling.member import Member
from ddmpi.methods.outer import Outer
from ddmpi.system.numbers import ROUNDING, Frame, norm, without

NOTHING = 1e-10
"""Forces of a contact and displacements of a body below this fraction of the largest in the load steps before are
rounding, and become zero."""

Moved = tuple[
    dict[str, np.ndarray], list[np.ndarray], dict[str, dict[str, Any]], dict[tuple[str, int], tuple]
]
"""How the bodies of a rank move under the outer method's forces: by name their displacements (nv, d); their contact
displacements; by name the sizes for the certificate; by contact and side the motion beside the nodes, and yielding."""


def displaced(
    assembly: Assembly, outer: Outer, largest: np.ndarray, left: np.ndarray | None, lean: bool
) -> Moved:
    """How bodies move, by displacements of all nodes; if `lean`, by products with the compliances, as far as these know
    it. `left` (rigid.size,) are the loads along motions that are not held which the forces leave without balance (N),
    None if none is held. Not collective."""
    moved: Moved = {}, [], {}, {}
    displacements, traces, sizes, beside = moved
    joint, find = assembly.joint, _at_contacts if lean else _at_nodes
    for body, s in zip(assembly.bodies, outer.body_forces(), strict=True):
        member, at = body.member, joint.slices[body.spec.name]
        apart = left[at] if left is not None and joint.stays.held[at].any() else None
        u, trace, near, size = find(assembly, member, s, outer.motions[at], largest, apart)
        if not lean:
            displacements[member.name] = u
        traces.append(trace)
        beside |= near
        sizes[member.name] = size | {"made": member.stiffness * size["moved"], "load": member.load}
    return moved


def _at_nodes(
    assembly: Assembly,
    member: Member,
    s: np.ndarray,
    alpha: np.ndarray,
    largest: np.ndarray,
    apart: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, dict[tuple[str, int], tuple], dict[str, Any]]:
    """Of a body its displacements (nv, d), those at its contacts, the motion beside the nodes, and its sizes."""
    acting = member.elasticity.acting
    u, balance = np.zeros_like(acting.prescribed), [np.nan, 0.0, np.nan]
    with assembly.exchange.deferred():  # an error is raised on all ranks, after the next exchange
        u, *balance = recover(member, s, alpha, largest, apart)
    trace = member.trace(u)
    # C s, by which contact forces move the contacts: all but the free displacement and rigid motions
    yielding = float(np.abs(member.h + member.G.T @ alpha - trace).max(initial=0.0))
    beside = {key: (*motion, yielding) for key, motion in member.beside(u).items()}
    sizes = dict(zip(("left", "acting", "energy"), balance, strict=True)) | {
        "moved": float(np.linalg.norm(u, axis=1).max()),
        "yielding": yielding,
        "confined": acting.confined,
        "work": member.work(u, s),
    }
    return u, trace, beside, sizes


def _at_contacts(
    assembly: Assembly,
    member: Member,
    s: np.ndarray,
    alpha: np.ndarray,
    largest: np.ndarray,
    apart: np.ndarray | None,
) -> tuple[np.ndarray, np.ndarray, dict[tuple[str, int], tuple], dict[str, Any]]:
    """The same by a product with the compliance, whose displacements are those at contacts."""
    force, moved, _ = NOTHING * largest
    u, yielded, energy, work = *np.full((2, member.size), np.nan), np.nan, np.zeros((2, 1))
    with assembly.exchange.deferred():
        u, yielded, energy, work = member.at_contacts(s, alpha)
    acting = max(norm(member.e), norm(s))
    if acting <= force and np.abs(u).max(initial=0.0) <= moved:  # as in `recover`
        u = np.zeros_like(u)  # loads that move no contact store energy all the same
    farthest, yielding = (float(np.abs(array).max(initial=0.0)) for array in (u, yielded))
    beside = {(name, side): (None, None, yielding) for name, (_, side) in member.parts.items()}
    sizes = {
        "left": norm(member.e - member.G @ s if apart is None else apart),
        "acting": acting,
        "energy": energy,
        "moved": farthest,
        "yielding": yielding,
        "confined": 0.0,  # of the ends of legs
        "work": work,
    }
    return u, u, beside, sizes


def recover(
    member: Member,
    s: np.ndarray,
    alpha: np.ndarray,
    largest: np.ndarray,
    apart: np.ndarray | None = None,
) -> tuple[np.ndarray, float, float, float]:
    """`Member.displacement`, but zero where it and its forces are rounding beside the `largest` sizes (3,) so far."""
    u, left, acting, energy = member.displacement(s, alpha, left=apart)
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
    pull = member.pull(s)
    case, size = member.elasticity.acting, member.elasticity.load
    size += sum(float(np.abs(forces).sum()) for forces in (pull, case.heat, case.taken))
    reactions = resultants(mesh, clamp_forces(mesh, body.spec, member.elasticity, u, pull), size)
    if not frame:
        acting = added(
            (group, {kind: factor * value for kind, value in entry.items()})
            for history, factor in factors.items()
            for group, entry in member.elasticity.pushes.get(history, {}).items()
        )
    else:
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
    held = np.array([entry["force"] for entry in reactions.values()]).reshape(-1, mesh.dimension)
    return {
        "reaction": without(held.sum(axis=0), ROUNDING * (size + float(np.abs(held).sum()))),
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
