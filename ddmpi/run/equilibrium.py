"""Whether contact forces can hold the bodies that no clamp holds: asked before the iteration and after it."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping
from typing import TypeVar

import numpy as np
import scipy.sparse as sparse

from ddmpi.coupling.assembly import Assembly
from ddmpi.interface.interface import Interface
from ddmpi.interface.law import across, direction
from ddmpi.interface.state import ContactState
from ddmpi.judge.equilibrium import LARGEST, ROUNDING, Mechanism, find_mechanism
from ddmpi.judge.motions import MotionsOfBody, describe_motions, undetermined
from ddmpi.system.agreement import from_first, merged

T = TypeVar("T")


def look_for_mechanism(assembly: Assembly) -> Mechanism | None:
    """The mechanism that shows that no contact forces hold the loose bodies, on all ranks; None where some do.

    A linear program on rank 0. Not asked where clamps hold all bodies, nor of more than `LARGEST` loose ones.
    Collective.
    """
    return _asked(assembly, _all_forces, None, lambda interfaces, G, bodies, load: find_mechanism(
        interfaces, G, assembly.joint.e, bodies, load))


def motions_without_resistance(assembly: Assembly) -> list[str]:
    """The rigid motions that no force of any contact resists, a sentence each, the same on all ranks. Collective."""
    def find(interfaces: list[Interface], G: sparse.csc_matrix, bodies: list[MotionsOfBody], _: object) -> list[str]:
        parts, ends = [np.zeros((G.shape[0], 0))], np.cumsum([0, *(each.size for each in interfaces)])
        for start, stop in itertools.pairwise(ends):  # a few forces are as good as all of a contact
            axes, sizes, _ = np.linalg.svd((own := G[:, start:stop])[np.unique(own.indices)].toarray(), False)
            some = np.flatnonzero(sizes > ROUNDING * sizes.max(initial=0.0))
            parts.append(np.zeros((G.shape[0], len(some))))
            parts[-1][np.unique(own.indices)] = axes[:, some] * sizes[some]
        return undetermined(np.hstack(parts), bodies)

    return _asked(assembly, _all_forces, [], find)


def undetermined_motions(assembly: Assembly, contacts: Mapping[str, ContactState]) -> list[str]:
    """The rigid motions that no contact resists at the solution, a sentence each, the same on all ranks. Collective."""
    def resists(interface: Interface) -> sparse.csr_matrix:
        """Of each force that resists motions a row (size,): of closed nodes, of sticking ones, and where friction can
        turn of slipping ones, across it."""
        state, law = contacts[interface.name], interface.law
        sticks = state.status[law.sliding] == "stick"
        s = np.concatenate([state.normal_force, state.tangential_force[law.sliding].ravel()])
        bound = law.bound_at(s)
        sticks |= (law.slope(state.normal_force) == 0.0) & (bound > 0.0) & ~law.reaches_bound(s, bound)  # Tresca, open
        friction = direction(state.tangential_force[law.sliding])
        slips = ~sticks & (bound > 0.0) & (state.status[law.sliding] != "open")
        chosen = np.concatenate([state.status != "open", np.repeat(sticks, law.components)])
        parts = [sparse.identity(law.size, format="csr")[np.flatnonzero(chosen)]]
        if law.components > 1 and slips.any():
            turned = sparse.block_diag([sparse.csr_matrix((0, law.m)), *across(friction)[:, :, 1:].transpose(0, 2, 1)],
                                       format="csr")
            parts.append(turned[np.flatnonzero(np.repeat(slips, law.components - 1))])
        return sparse.vstack(parts, format="csr")

    return _asked(assembly, resists, [], lambda _, G, bodies, load: undetermined(G.toarray(), bodies))


def describe_drift(assembly: Assembly, motions: np.ndarray) -> str:
    """Where the loose bodies drift to, in words; `motions` as `Outer.motions`. Collective."""
    bodies = [body for body, _ in _loose_bodies(assembly)]
    velocities = np.array([body.velocity(motions[assembly.joint.slices[body.name]]) for body in bodies])
    fastest = max((body.speed(v) for body, v in zip(bodies, velocities, strict=True)), default=0.0)
    return describe_motions(bodies, velocities / fastest, set()) if fastest else "no body"


def _all_forces(interface: Interface) -> sparse.csr_matrix:
    return sparse.identity(interface.size, format="csr")


def _asked(assembly: Assembly, chosen: Callable[[Interface], sparse.spmatrix], otherwise: T,
           find: Callable[[list[Interface], sparse.csc_matrix, list[MotionsOfBody], np.ndarray], T]) -> T:
    """What `find` says on rank 0 of all interfaces in the order of the scene, G of their `chosen` forces, rows
    (·, size), the loose bodies and the sizes of their loads; `otherwise` without loose bodies, or with too many.

    The same on all ranks. Collective.
    """
    if not assembly.loose or len(assembly.loose) > LARGEST:
        return otherwise
    space, Z = assembly.space, assembly.joint.rigid.Z
    own = {interface.name: (interface, (chosen(interface) @ Z[part]).tocsr()) for interface, part in space.each()}
    everyone = merged(assembly.world, own)
    interfaces, rows = zip(*(everyone[contact.name] for contact in assembly.scene.contact), strict=True)
    bodies, loads = zip(*_loose_bodies(assembly), strict=True)
    return from_first(assembly.world, lambda: find(
        list(interfaces), sparse.vstack(rows, format="csr").T.tocsc(), list(bodies), np.array(loads)))


def _loose_bodies(assembly: Assembly) -> list[tuple[MotionsOfBody, float]]:
    """The bodies that clamps do not hold and the partners that are pushed, in the order of their motions, with the
    sizes of their loads. A partner has the shape of what faces it. Collective."""
    own = [(MotionsOfBody.of(body.spec.name, body.mesh.points, body.member.motions), body.member.elasticity.load)
           for body in assembly.bodies if not body.member.elasticity.held]
    found = [each for rank in assembly.world.allgather(own) for each in rank]
    for rigid in assembly.joint.pushed:
        own_parts = {each.name: each for each in assembly.space.interfaces if each.bodies[1] == rigid.name}
        facing = list(merged(assembly.world, own_parts).values())
        at = np.concatenate([each.xy + side * each.spacing[:, None] * axis for each in facing
                             for axis in np.eye(each.dimension) for side in (-1.0, 1.0)])
        motions = np.broadcast_to(np.eye(at.shape[1])[:, rigid.pushed], (*at.shape, len(rigid.pushed)))
        found.append((MotionsOfBody.of(rigid.name, at, motions), assembly.pushes[rigid.name]))
    return found
