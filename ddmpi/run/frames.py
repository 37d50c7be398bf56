"""Bodies and partners whose frames move far: where they are, how they begin, and whether loads push them on."""

import itertools
from collections.abc import Mapping, Sequence

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.judge.rolls import has_corner
from ddmpi.methods.newton import Newton
from ddmpi.run.equilibrium import describe_drift
from ddmpi.run.passes import Group
from ddmpi.scene.motions import parts_of
from ddmpi.system.numbers import Frame, RigidMotion

UNSTABLE = 0.15
"""An equilibrium is not stable if a motion is resisted by less than this times what loads push it on by. Of a disc on a
plane, which nothing holds and nothing pushes on, nodes that open and close make up to 0.12."""

MOST = 10.0
"""Loads push on a motion by less than this times the largest entry of their stiffness K: of six motions |K| is at most
six times that."""


def instability(assembly: Assembly, outer: Newton, groups: Sequence[Group]) -> list[str]:
    """A warning for each of the `groups` whose frames forces, which grow as they move on, push on. Collective."""
    joint, told = assembly.joint, list[str]()
    if not joint.K.nnz:
        return []
    compliance = outer.linearisation().yielding()
    blunt = _on_curves(assembly, outer, groups)
    for group in itertools.compress(groups, ~blunt):
        at = np.flatnonzero(group.at)
        size = float(np.abs(joint.K[at][:, at]).max())
        if not size:
            continue
        yields, motions = assembly.world.bcast(np.linalg.eig(compliance[np.ix_(at, at)]))
        # The stiffness against a motion. Contacts resist all, so that loads, which grow by K, cannot make it less than -|K|:
        # what is far below is one over the rounding of a motion that is held.
        with np.errstate(divide="ignore", invalid="ignore"):
            stiffness = 1.0 / yields
        pushed = np.where(np.abs(stiffness) < MOST * size, stiffness.real, 0.0)
        worst = int(pushed.argmin())
        if pushed[worst] < -UNSTABLE * size:
            drift = np.zeros(joint.rigid.size)
            drift[at] = motions[:, worst].real
            way = describe_drift(assembly, drift)
            told.append(f"the equilibrium is not stable: {way}, because the loads push on")
    return told


def _on_curves(assembly: Assembly, outer: Newton, groups: Sequence[Group]) -> np.ndarray:
    """(groups,) bool, which have a contact on so few nodes of a curve that these do not show how it rolls: on one node a
    round disc stands as on a corner. Collective."""
    found = np.zeros(len(groups), bool)
    for interface, part in assembly.space.with_slices():
        closed = np.flatnonzero(outer.forces[part][: interface.m] > 0.0)
        few = 0 < len(closed) < interface.dimension and not interface.law.two_sided
        if few and not has_corner(interface, closed, ends=True):
            found |= [group.owns(interface) for group in groups]
    return np.any(assembly.world.allgather(found), axis=0)


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


def way_down(assembly: Assembly, groups: Sequence[Group]) -> np.ndarray:
    """The motions (rigid.size,) of free frames along the loads on them, without turns, that bring sides of each of the
    `groups` together (m); zero where sides on the way touch, or none are there. Collective."""
    joint, space = assembly.joint, assembly.space
    along, far = np.zeros(joint.rigid.size), np.full(len(groups), np.inf)
    for name, frame in assembly.free.items():
        shifts = slice(joint.slices[name].start, joint.slices[name].start + len(frame.axes))
        along[shifts] = joint.e[shifts]
    closing = joint.rigid.spread(along)
    for interface, part in space.with_slices():
        gap, closes = space.gap[part][: interface.m], closing[part][: interface.m]
        nearest = (gap[closes > 0.0] / closes[closes > 0.0]).min(initial=np.inf)
        own = [group.owns(interface) for group in groups]
        far[own] = np.minimum(far[own], nearest)
    far = np.min(assembly.world.allgather(far), axis=0)
    falls = np.where((far > 0.0) & (far < np.inf), far, 0.0)
    return np.dot(falls, [group.at for group in groups]) * along
