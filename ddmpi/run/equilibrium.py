"""Whether contact forces can balance the loads on loose bodies; which motions nothing resists.

Each rank describes the forces that its contacts allow or resist in a few columns; the first rank does the rest.
"""

import itertools
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sparse

from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.coupling.joint import Joint
from ddmpi.interface.interface import Interface
from ddmpi.interface.law import across, direction
from ddmpi.interface.state import ContactState
from ddmpi.judge.equilibrium import IMBALANCE, Forces, Mechanism, among_all, find_mechanism
from ddmpi.judge.motions import RESISTED, MotionsOfBody, describe_motions, undetermined
from ddmpi.system.agreement import agreed, from_first, gathered
from ddmpi.system.provenance import has_clarabel

LARGEST = 3000  # most loose bodies for the search for a mechanism, which takes 2 to 3 s for a wall of so many bricks

_PARTNERS: WeakKeyDictionary[Joint, list[MotionsOfBody]] = WeakKeyDictionary()

Parts = Mapping[str, tuple[int, np.ndarray, np.ndarray]]
"""By contact the number of forces, the numbers (c,) of motions, and FᵀF or DᵀD of these (c, c)."""

ALONG = 3e-3
"""A motion whose slip is along friction up to this fraction only turns friction that is at its limit: as the body moves
on, friction becomes parallel to the load, and the resistance vanishes."""


def look_for_mechanism(assembly: Assembly, least: float = IMBALANCE) -> Mechanism | None:
    """The mechanism that proves that no contact forces balance the loads on loose bodies, or None; on all ranks.
    `least` is as for `find_mechanism`.

    Skipped without loose bodies or loads on them, with more than `LARGEST`, and without clarabel. Collective.
    """
    if not assembly.loose or len(assembly.loose) > LARGEST or not assembly.joint.e.any():
        return None
    world, joint, scene = assembly.world, assembly.joint, assembly.scene
    loads = loads_of_loose(assembly)
    with agreed(world):
        allowed = {
            interface.name: Forces.of(interface, motions, powers, joint.rigid.size)
            for interface, motions, powers in _powers(assembly, ~joint.stays.bolts)
            if len(motions)
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


def _powers(
    assembly: Assembly, moves: np.ndarray | None = None
) -> Iterator[tuple[Interface, np.ndarray, np.ndarray]]:
    """Each owned interface with the numbers (n,) of the rigid motions on which its forces have power, of those that
    move where `moves` (rigid.size,) bool says which do; and these powers (its size, n). Not collective."""
    joint = assembly.joint
    for interface, (_, numbers, block) in zip(
        assembly.space.interfaces, joint.rigid.blocks, strict=True
    ):
        # what a body does on itself has no power on its motions; lever arms of gaps are none
        acts = block.any(axis=0) & (not interface.idle)
        if moves is not None:
            acts &= moves[numbers]
        some = np.flatnonzero(acts)
        some = some[np.argsort(numbers[some])]
        yield interface, numbers[some], block[:, some]


def loads_of_loose(assembly: Assembly) -> np.ndarray:
    """(nb,) the sums of the sizes of all nodal loads on loose bodies and driven partners (N). Collective."""
    return assembly.joint.of_all(
        [np.array([body.member.elasticity.load]) for body in _loose(assembly)],
        [np.array([size]) for size in assembly.pushes.values()],
    )


def motions_without_resistance(assembly: Assembly) -> list[str]:
    """The rigid motions that no force of any contact resists, a sentence each, the same on all ranks. Collective."""
    return _undetermined(assembly, lambda interface, powers: (powers, np.zeros(interface.size)))


def undetermined_motions(assembly: Assembly, contacts: Mapping[str, ContactState]) -> list[str]:
    """The rigid motions that no contact resists at the solution, a sentence each, the same on all ranks. Collective."""

    def resists(interface: Interface, powers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the forces that resist motions: normal ones of closed nodes, tangential ones of sticking nodes, and in space
        those across the friction of slipping nodes, which turn it. And the friction of slipping nodes (size,) in newtons."""
        state, law = contacts[interface.name], interface.law
        sticks = state.status[law.sliding] == "stick"
        s = np.concatenate([state.normal_force, state.tangential_force[law.sliding].ravel()])
        bound = law.bound_at(s)
        # open nodes may, as by Tresca's law
        sticks |= (law.bound_at(0.0 * s) > 0.0) & ~law.reaches_bound(s, bound)
        slips = ~sticks & (bound > 0.0) & (state.status[law.sliding] != "open")
        chosen = np.concatenate([state.status != "open", np.repeat(sticks, law.components)])
        resisting = powers[chosen]
        if law.components > 1 and slips.any():
            aside = across(direction(state.tangential_force[law.sliding][slips]))[:, :, 1:]
            tangential = powers[law.m :].reshape(len(slips), law.components, -1)[slips]
            turning = np.concatenate(np.einsum("kci,kcn->kin", aside, tangential))
            resisting = np.vstack([resisting, RESISTED / ALONG * turning])
        slipping = np.append(np.zeros(law.m), np.repeat(slips, law.components) * s[law.m :])
        return resisting, slipping

    return _undetermined(assembly, resists)


def _undetermined(
    assembly: Assembly,
    chosen: Callable[[Interface, np.ndarray], tuple[np.ndarray, np.ndarray]],
) -> list[str]:
    """The rigid motions that none of the `chosen` forces resists, a sentence each.

    Of the powers (size, n) of a contact's forces `chosen` returns those (k, n) that resist, and friction (size,) at its
    limit (N). Collective.
    """
    if not assembly.loose:
        return []
    of_rank, by_contact, size = {}, {}, assembly.joint.rigid.size
    for interface, motions, powers in _powers(assembly):
        resisting, slipping = chosen(interface, powers)
        # RᵀR = FᵀF: a triangular matrix stands for all forces F of a contact
        R = np.atleast_2d(np.linalg.qr(resisting, mode="r"))
        friction = np.vstack([slipping @ powers, np.abs(slipping) @ np.abs(powers)])
        of_rank[interface.name] = (
            among_all(R, motions, size),
            among_all(friction, motions, size),
        )
    for interface, (one, other), (_, motions, _) in zip(
        assembly.space.interfaces, sides_moved(assembly), assembly.joint.rigid.blocks, strict=True
    ):
        D = (one - other).reshape(interface.xy.size, len(motions))
        by_contact[interface.name] = len(D), motions, D.T @ D
    of_all, bodies = gathered(assembly.world, of_rank), with_partners(assembly)
    past = gathered(assembly.world, by_contact)

    def describe() -> list[str]:
        stays = assembly.joint.stays  # as if forces resisted them
        bolts = np.flatnonzero(stays.bolts)
        forces = [
            among_all(np.eye(len(bolts)), bolts, size),
            sparse.csr_matrix(stays.held.T),
            *(resisting for resisting, _ in of_all.values()),
        ]
        resisting = sparse.vstack(forces, "csr").T
        slips = sum((slipping.toarray() for _, slipping in of_all.values()), np.zeros((2, size)))
        return undetermined(resisting, bodies, summed(past, size), slips, assembly.joint.K)

    return from_first(assembly.world, describe)


def sides_moved(assembly: Assembly) -> list[tuple[np.ndarray, np.ndarray]]:
    """By how much the motions (c,) of each block of `joint.rigid` move both sides of its contact, (m, d, c) each, at its
    nodes; of the contacts of this rank. Collective over neighbours."""
    joint, mine = assembly.joint, {}
    for body in assembly.bodies:
        member, frame = body.member, assembly.frames.get(body.spec.name)
        motions = member.motions
        if frame:  # of a body that moves far, in whose axes they are
            motions = np.einsum("ij,njk->nik", frame.turned, motions)
        for interface in member.interfaces:
            for side in interface.sides(body.spec.name):
                mine[interface.name, side] = interface.rows.moved(side, motions)
    both, found = assembly.exchange.swap_objects(mine), []
    for interface in assembly.space.interfaces:
        first, second = both[interface.name]
        seconds = [] if second is None else [second]
        # in the order of the columns of a block of `joint.rigid`
        seconds += [
            partner.motions(interface.places)
            for partner in joint.driven
            if partner.acts_on(interface)
        ]
        # a body that has both sides moves both by the same motions
        firsts = [] if interface.itself else [0.0 * first]
        other = np.concatenate([*firsts, *seconds], axis=2)
        one = np.zeros_like(other)
        one[:, :, : first.shape[2]] = first
        found.append((one, other))
    return found


def summed(parts: Parts, size: int) -> sparse.csr_matrix:
    """The sum (size, size) of the blocks of all contacts."""
    rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    for _, numbers, block in parts.values():
        rows.append(np.repeat(numbers, len(numbers)))
        columns.append(np.tile(numbers, len(numbers)))
        values.append(block.ravel())
    return sparse.csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (size, size)
    )


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


def _loose(assembly: Assembly) -> list[Body]:
    """The bodies of this rank that rigid motions move. Not collective."""
    return [body for body in assembly.bodies if len(body.member.e)]


def with_partners(assembly: Assembly) -> list[MotionsOfBody]:
    """On the first rank all loose bodies and driven partners, in the order of their motions; found once for a placement.
    Collective.

    A partner has the outline of the contact nodes that face it.
    """
    if assembly.joint not in _PARTNERS:
        _PARTNERS[assembly.joint] = _with_partners(assembly)
    return _PARTNERS[assembly.joint]


def _motions_of(assembly: Assembly) -> dict[str, MotionsOfBody]:
    """The loose bodies of this rank, of which alike ones are found once. Not collective."""
    found, alike = dict[str, MotionsOfBody](), dict[int, tuple[np.ndarray, MotionsOfBody]]()
    for body in _loose(assembly):
        name, mesh, motions = body.spec.name, body.mesh, body.member.motions
        if name in assembly.frames:
            frame = assembly.frames[name]
            turned = np.einsum("ij,njk->nik", frame.turned, motions)
            found[name] = MotionsOfBody.of(name, frame.at(mesh.points), turned)
            continue
        if id(motions) not in alike:  # bodies have these in common if they have the mesh
            alike[id(motions)] = motions, MotionsOfBody.of(name, mesh.home.points, motions)
        shift = mesh.points[0] - mesh.home.points[0]
        found[name] = alike[id(motions)][1].shifted(name, shift)
    return found


def _with_partners(assembly: Assembly) -> list[MotionsOfBody]:
    wheel, contacts = assembly.scene.wheel, assembly.scene.contact
    alone = {contact.bodies[0] for contact in contacts if len({*contact.bodies}) == 1}
    hub = np.array(wheel.pivot or (0.0,) * assembly.scene.dimension) if wheel else None
    all_motions = [
        replace(body, pivot=hub, touches_itself=name in alone)
        for name, body in gathered(assembly.world, _motions_of(assembly)).items()
    ]
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
