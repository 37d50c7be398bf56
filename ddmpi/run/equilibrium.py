"""Whether contact forces can balance the loads on loose bodies; how bodies move under those that are found, and what is
remembered of it.

Each rank describes the forces that its contacts allow or resist in a few columns; the first rank does the rest.
"""

import itertools
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from typing import Any, Self

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.elasticity import clamp_forces
from ddmpi.body.loads import added, loads_by_group, resultants
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.coupling.member import Member
from ddmpi.coupling.space import Space
from ddmpi.interface.interface import Interface
from ddmpi.interface.law import across, direction
from ddmpi.interface.state import ContactState
from ddmpi.judge.equilibrium import IMBALANCE, Forces, Mechanism, find_mechanism
from ddmpi.judge.motions import RESISTED, MotionsOfBody, describe_motions, undetermined
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import Outer
from ddmpi.scene.motions import parts_of
from ddmpi.system.agreement import agreed, from_first, gathered
from ddmpi.system.numbers import Frame, RigidMotion, norm
from ddmpi.system.provenance import has_clarabel

LARGEST = 3000  # most loose bodies for the search for a mechanism, which takes 2 to 3 s for a wall of so many bricks

ALONG = 3e-3
"""A motion whose slip is along friction up to this fraction only turns friction that is at its limit: as the body moves
on, friction becomes parallel to the load, and the resistance vanishes."""

NOTHING = 1e-10
"""Forces of a contact and displacements of a body below this fraction of the largest in the load steps before are
rounding, and become zero."""

UNSTABLE = 0.15
"""An equilibrium is not stable if a motion is resisted by less than this times what loads push it on by. Of a disc on a
plane, which nothing holds and nothing pushes on, nodes that open and close make up to 0.12."""

MOST = 10.0
"""Loads push on a motion by less than this times the largest entry of their stiffness K: of six motions |K| is at most
six times that."""

Moved = tuple[
    dict[str, np.ndarray], list[np.ndarray], dict[str, dict[str, Any]], dict[tuple[str, int], tuple]
]
"""How the bodies of a rank move under the outer method's forces: by name their displacements (nv, d); their contact
displacements; by name the sizes for the certificate; by contact and side the motion beside the nodes, and yielding."""


def look_for_mechanism(assembly: Assembly, least: float = IMBALANCE) -> Mechanism | None:
    """The mechanism that proves that no contact forces balance the loads on loose bodies, or None; on all ranks.
    `least` is as for `find_mechanism`.

    Skipped without loose bodies, with more than `LARGEST`, and without clarabel. Collective.
    """
    if not assembly.loose or len(assembly.loose) > LARGEST:
        return None
    world, space, joint, scene = assembly.world, assembly.space, assembly.joint, assembly.scene
    loads = loads_of_loose(assembly)
    moves = sparse.diags(1.0 - joint.stays.bolts)
    with agreed(world):
        allowed = {
            interface.name: Forces.of(interface, G)
            for interface, G in (
                (interface, (moves @ joint.rigid.Z[part].T).tocsc())
                for interface, part in space.with_slices()
            )
            if G.nnz
        }
    forces, bodies = gathered(world, allowed), with_partners(assembly)
    return from_first(
        world,
        lambda: (
            find_mechanism(  # the first rank decides for all
                [forces[contact.name] for contact in scene.contact if contact.name in forces],
                joint.e,
                bodies,
                loads,
                least,
            )
            if has_clarabel()
            else None
        ),
    )


def loads_of_loose(assembly: Assembly) -> np.ndarray:
    """(nb,) the sums of the sizes of all nodal loads on loose bodies and driven partners (N). Collective."""
    return assembly.joint.of_all(
        [np.array([body.member.elasticity.load]) for body in _loose(assembly)],
        [np.array([size]) for size in assembly.pushes.values()],
    )


def motions_without_resistance(assembly: Assembly) -> list[str]:
    """The rigid motions that no force of any contact resists, a sentence each, the same on all ranks. Collective."""
    return _undetermined(
        assembly,
        lambda interface: (
            sparse.identity(interface.size, format="csr"),
            sparse.csr_matrix((1, interface.size)),
        ),
    )


def undetermined_motions(assembly: Assembly, contacts: Mapping[str, ContactState]) -> list[str]:
    """The rigid motions that no contact resists at the solution, a sentence each, the same on all ranks. Collective."""

    def resists(interface: Interface) -> tuple[sparse.csr_matrix, sparse.csr_matrix]:
        """A row (size,) for each force that resists motions: normal ones of closed nodes, tangential ones of sticking
        nodes, and in space those across the friction of slipping nodes, which turn it. And the friction (1, size) of
        slipping nodes (N)."""
        state, law = contacts[interface.name], interface.law
        sticks = state.status[law.sliding] == "stick"
        s = np.concatenate([state.normal_force, state.tangential_force[law.sliding].ravel()])
        bound = law.bound_at(s)
        sticks |= (law.bound_at(0.0 * s) > 0.0) & ~law.reaches_bound(
            s, bound
        )  # open nodes may, as by Tresca's law
        friction = direction(state.tangential_force[law.sliding])
        slips = ~sticks & (bound > 0.0) & (state.status[law.sliding] != "open")
        chosen = np.concatenate([state.status != "open", np.repeat(sticks, law.components)])
        rows = [sparse.identity(law.size, format="csr")[np.flatnonzero(chosen)]]
        if law.components > 1 and slips.any():
            turned = sparse.block_diag(
                [sparse.csr_matrix((0, law.m)), *across(friction)[:, :, 1:].transpose(0, 2, 1)],
                format="csr",
            )
            rows.append(
                RESISTED / ALONG * turned[np.flatnonzero(np.repeat(slips, law.components - 1))]
            )
        slipping = np.append(np.zeros(law.m), np.repeat(slips, law.components) * s[law.m :])
        return sparse.vstack(rows, format="csr"), sparse.csr_matrix(slipping)

    return _undetermined(assembly, resists)


def _undetermined(
    assembly: Assembly, chosen: Callable[[Interface], tuple[sparse.spmatrix, ...]]
) -> list[str]:
    """The rigid motions that none of the `chosen` forces, rows (·, size) by contact, resists, a sentence each.

    `chosen` also returns friction (1, size) at its limit. Collective.
    """
    if not assembly.loose:
        return []
    of_rank, Z, size = {}, assembly.joint.rigid.Z, assembly.joint.rigid.size
    for interface, part in assembly.space.with_slices():
        rows, friction = chosen(interface)
        forces = (rows @ Z[part]).tocsr()
        motions = np.unique(forces.indices)
        # RᵀR = FᵀF: a triangular matrix stands for all forces F of a contact
        R = np.atleast_2d(np.linalg.qr(forces[:, motions].toarray(), mode="r"))
        of_rank[interface.name] = (
            sparse.csr_matrix(
                (R.ravel(), np.tile(motions, len(R)), len(motions) * np.arange(len(R) + 1)),
                (len(R), size),
            ),
            sparse.vstack([friction @ Z[part], abs(friction) @ abs(Z[part])]),
        )
    of_all, bodies = gathered(assembly.world, of_rank), with_partners(assembly)

    def describe() -> list[str]:
        none = (
            sparse.csr_matrix((0, size)),
            sparse.csr_matrix((2, size)),
        )  # of a scene without contacts
        forces, slipping = zip(none, *of_all.values(), strict=True)
        stays = assembly.joint.stays  # as if forces resisted them
        still = sparse.vstack(
            [sparse.identity(size, format="csr")[stays.bolts], sparse.csr_matrix(stays.held.T)]
        )
        return undetermined(sparse.vstack([*forces, still]).T, bodies, sum(slipping).toarray())

    return from_first(assembly.world, describe)


def describe_drift(assembly: Assembly, motions: np.ndarray) -> str:
    """How the loose bodies drift, in words; `motions` as `Outer.motions`. Collective."""
    bodies, slices = with_partners(assembly), assembly.joint.slices
    return from_first(
        assembly.world,
        lambda: (
            describe_motions(
                bodies, np.array([body.basis @ motions[slices[body.name]] for body in bodies])
            )
            or "no body"
        ),
    )


def instability(assembly: Assembly, outer: Newton) -> list[str]:
    """A warning where forces that grow as frames move on push them on. Collective."""
    joint = assembly.joint
    size = np.abs(joint.K).max() if joint.K.nnz else 0.0
    if not size:
        return []
    yields, motions = assembly.world.bcast(np.linalg.eig(outer.linearisation().yielding()))
    # The stiffness against a motion. Contacts resist all, so that loads, which grow by K, cannot make it less than -|K|:
    # what is far below is one over the rounding of a motion that is held.
    with np.errstate(divide="ignore", invalid="ignore"):
        stiffness = 1.0 / yields
    pushed = np.where(np.abs(stiffness) < MOST * size, stiffness.real, 0.0)
    worst = int(pushed.argmin())
    if not pushed[worst] < -UNSTABLE * size:
        return []
    return [
        f"the equilibrium is not stable: {describe_drift(assembly, motions[:, worst].real)}, because the "
        "loads push on"
    ]


def _loose(assembly: Assembly) -> list[Body]:
    """The bodies of this rank that rigid motions move. Not collective."""
    return [body for body in assembly.bodies if len(body.member.e)]


def with_partners(assembly: Assembly) -> list[MotionsOfBody]:
    """On the first rank all loose bodies and driven partners, in the order of their motions. Collective.

    A partner has the outline of the contact nodes that face it.
    """
    placed = {body.spec.name: (body.mesh.points, body.member.motions) for body in _loose(assembly)}
    for name, (points, motions) in placed.items():
        if name in assembly.frames:
            frame = assembly.frames[name]
            placed[name] = frame.at(points), np.einsum("ij,njk->nik", frame.turned, motions)
    all_motions = list(
        gathered(
            assembly.world, {name: MotionsOfBody.of(name, *at) for name, at in placed.items()}
        ).values()
    )
    for each in assembly.joint.driven:
        facing = gathered(
            assembly.world,
            {
                interface.name: [
                    interface.xy + side * interface.spacing[:, None] * axis
                    for axis in np.eye(interface.dimension)
                    for side in (-1.0, 1.0)
                ]
                for interface in assembly.space.interfaces
                if each.acts_on(interface)
            },
        )
        if assembly.world.rank == 0:
            at = np.concatenate([*itertools.chain(*facing.values())])
            all_motions.append(MotionsOfBody.of(each.name, at, each.motions(at)))
    return all_motions


@dataclass
class Mark:
    """The end of a load step, from which the next one and its energies count.

    Attributes
    ----------
    time : of the step
    s, alpha : forces (size,) in N and motions of loose bodies in m
    d : (size,) free displacements less gaps, tangentially from the beginning (m)
    moved : (size,) relative displacements (m)
    opening, prescribed : (size,) of a `Space` (m)
    factors : (k,) by history
    work : (2, k), as `Solution.work` (J)
    energy : strain energy (J)
    length : of closed contacts, in space their area (m, m²)
    slid : by contact without friction its slip (m, d − 1) of all load steps (m)
    derived : derivatives, see `ddmpi.derive.chain`
    memory : of bodies that move far, see `ddmpi.run.places`
    """

    time: float
    s: np.ndarray
    alpha: np.ndarray
    d: np.ndarray
    moved: np.ndarray
    opening: np.ndarray
    prescribed: np.ndarray
    factors: np.ndarray
    work: np.ndarray
    energy: float
    length: float
    slid: dict[str, np.ndarray]
    derived: dict[str, np.ndarray] = field(default_factory=dict)
    memory: Any = field(default_factory=dict)

    @property
    def closed(self) -> np.ndarray:
        """(size,) relative displacements less the initial gaps (m)."""
        return self.moved - self.opening

    def work_since(self, before: Self, space: Space) -> tuple[float, float]:
        """External work and interface work (J) of the step from `before` to here. Collective."""
        # forces and displacements are taken as linear in time within the step, so work is by the trapezoidal rule
        opened, gone = self.opening - before.opening, self.prescribed - before.prescribed
        closing, mean = self.moved - before.moved - opened, 0.5 * (self.s + before.s)
        driven, interface_work = space.add(np.array([mean @ (gone - opened), mean @ closing]))
        # loads over displacements, and reactions of clamps over what these prescribe: ΔW = ½ (b_n + b_n−1) Δu
        work = 0.5 * (self.factors + before.factors) @ (self.work[0] - before.work[0])
        work += 0.5 * (self.factors - before.factors) @ (self.work[1] + before.work[1]) + driven
        return float(work), float(interface_work)

    def change_since(self, s: np.ndarray, largest: np.ndarray, space: Space) -> float:
        """The change of the forces since `s` (size,) over the largest of all, or of its tangential part over the
        largest slip bounds if that is more; `largest` (2,) has both (N). Collective."""
        change = self.s - s
        tangential = change.copy()
        for interface, part in space.with_slices():
            tangential[part][: interface.m] = 0.0
        return float((space.norms([change, tangential]) / largest).max())

    def given(self, before: Self, space: Space) -> float:
        """The work (J) of an overlap, of bonds and guides also of a gap: it acts at once, before any load. Collective."""
        sudden = np.concatenate(
            [
                np.empty(0),
                *(
                    before.opening[part]
                    if interface.law.two_sided
                    else np.minimum(before.opening[part], 0.0)
                    for interface, part in space.with_slices()
                ),
            ]
        )
        return float(space.add(np.array([0.5 * (self.s + before.s) @ sudden]))[0])

    @classmethod
    def first(cls, assembly: Assembly, derived: dict[str, np.ndarray]) -> Self:
        """Time 0, free of stress."""
        space, zero = assembly.space, np.zeros(assembly.space.size)
        touching = sum(
            float(interface.area[interface.opening <= 0.0].sum()) for interface in space.interfaces
        )
        still, k = np.zeros(assembly.joint.rigid.size), len(assembly.scene.followed) + 1
        return cls(
            0.0,
            zero,
            still,
            zero,
            zero,
            space.opening,
            zero,
            np.zeros(k),
            np.zeros((2, k)),
            0.0,
            float(space.add(np.array([touching]))[0]),
            {},
            derived,
        )


def displaced(
    assembly: Assembly, outer: Outer, largest: np.ndarray, left: np.ndarray | None = None
) -> Moved:
    """By displacements of all nodes. `left` (rigid.size,) are the loads along motions that are not held which the forces
    leave without balance (N), None if none is held. Not collective."""
    displacements, traces, sizes = (
        dict[str, np.ndarray](),
        list[np.ndarray](),
        dict[str, dict[str, Any]](),
    )
    beside: dict[tuple[str, int], tuple[np.ndarray, np.ndarray, float]] = {}
    for body, s in zip(assembly.bodies, outer.body_forces(), strict=True):
        member, at = body.member, assembly.joint.slices[body.spec.name]
        alpha = outer.motions[at]
        u, apart, acting, energy = (
            np.zeros_like(member.elasticity.acting.prescribed),
            np.nan,
            0.0,
            np.nan,
        )
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
    traces, sizes, beside = (
        list[np.ndarray](),
        dict[str, dict[str, Any]](),
        dict[tuple[str, int], tuple](),
    )
    for body, s in zip(assembly.bodies, outer.body_forces(), strict=True):
        member, at = body.member, assembly.joint.slices[body.spec.name]
        alpha, apart = outer.motions[at], _of_body(assembly, at, left)
        u, yielded, energy, work = *np.full((2, member.size), np.nan), np.nan, np.zeros((2, 1))
        with assembly.exchange.deferred():
            u, yielded, energy, work = member.at_contacts(s, alpha)
        acting = max(norm(member.e), norm(s))
        if acting <= force and np.abs(u).max(initial=0.0) <= moved:  # as in `recover`
            u, energy = np.zeros_like(u), 0.0
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
            "work": work,
        }
    return {}, traces, sizes, beside


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
            ("yielding", "made", "energy", "work"), 0.0
        ) | {
            "left": norm(unbalanced[at]),
            "acting": acting,
            "moved": norm(outer.motions[at]),
            "load": pushes.get(name, 0.0),
        }
    return sizes


def partners_gone(assembly: Assembly) -> dict[str, RigidMotion]:
    """By rigid partner how far its pivot has gone where bodies move far (m), its turn (rad) if it turns, and where its
    pivot is. Not collective."""
    gone = {}
    for partner in assembly.scene.rigid:
        turning = [
            part for part in parts_of(partner.motion) if part.turn or "turn" in (part.free or ())
        ]
        frame = assembly.frames[partner.name]
        pivot = np.array(
            next((part.pivot for part in turning if part.pivot), (0.0,) * len(frame.shift))
        )
        at = frame.at(pivot)
        gone[partner.name] = RigidMotion(
            at - pivot, np.radians(frame.turn if turning else np.empty(0)), at
        )
    return gone


def began(
    assembly: Assembly,
    name: str,
    points: np.ndarray,
    u: np.ndarray | float,
    then: Mapping[str, Frame],
) -> dict[str, np.ndarray]:
    """Where the points of a body were a step before, with its displacement `u` and the frames of `then`, by contact, as
    displacements (nv, d) in its frame of now (m): seen from the frame of the second body, which is where it is now. Not
    collective."""
    starts, now = {}, assembly.frames
    for contact in assembly.contacts:
        if name in contact.bodies:
            second = contact.bodies[1]
            carried = now[second].after(then[second].undone).after(then[name])
            starts[contact.name] = now[name].undone.after(carried).at(points + u) - points
    return starts


def way_down(assembly: Assembly) -> np.ndarray:
    """The motions (rigid.size,) of free frames along the loads on them, without turns, that bring sides together (m);
    zero where sides on the way touch, or none are there. Collective."""
    joint, space, along, far = (
        assembly.joint,
        assembly.space,
        np.zeros(assembly.joint.rigid.size),
        np.inf,
    )
    for name, frame in assembly.free.items():
        shifts = slice(joint.slices[name].start, joint.slices[name].start + len(frame.axes))
        along[shifts] = joint.e[shifts]
    closing = joint.rigid.spread(along)
    for interface, part in space.with_slices():
        gap, closes = space.gap[part][: interface.m], closing[part][: interface.m]
        far = min(far, (gap[closes > 0.0] / closes[closes > 0.0]).min(initial=np.inf))
    far = min(assembly.world.allgather(far))
    return (far if 0.0 < far < np.inf else 0.0) * along


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
