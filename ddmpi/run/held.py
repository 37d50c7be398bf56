"""The rigid motions that nothing determines: which they are, where they stay, and what is left along them.

Of all answers the one is taken whose rigid motions are nearest to those before; and balance is asked for only as
exactly as normals and gaps are known. A motion v moves the sides of contacts past each other by D v at the nodes, with
the components F v along the forces that contacts may carry, at open nodes as at closed ones. Where |F v| ≤ η |D v|,
with the error η of the normals of meshes, only this error resists v, as on the turn of a round part. Such motions are
held where they were, like by a dry friction of the coefficient η that acts on the body as a whole; λ = v·(e − G s) is
what this leaves of the loads. Its limit is

    |λ| ≤ τ(v) = Σ |s_i| (η |D_i v| + |gap_i| |ω(v)|),

the second part being the lever arms of gaps. Beyond it there is no equilibrium: forces of facets that balance a larger
load would be thousands of times as large as the load.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sparse
from scipy.linalg import eigh, qr
from scipy.sparse import csgraph

from ddmpi.coupling.assembly import Assembly
from ddmpi.interface.interface import Interface
from ddmpi.judge.equilibrium import IMBALANCE, Mechanism
from ddmpi.judge.motions import LARGEST, RESISTED, TURN, MotionsOfBody, describe_motions, forwards
from ddmpi.methods.outer import Outer
from ddmpi.run.equilibrium import loads_of_loose, with_partners
from ddmpi.system.agreement import from_first, gathered

COARSE, APART = 1e-2, 30.0
"""Normals of coarse linear elements in space are off by up to COARSE: motions that are resisted by so little are held as
well, with a warning, if all others are resisted by APART times as much."""

WORST = 3.0
"""Where few nodes bear, the normals of coarse elements are off there by up to this times the mean error COARSE."""

FAINT = 3.0 * COARSE
"""No motion is held in a group of bodies that resists all motions by more than this, over the root of its forces."""

RIGID = 1e-6
"""The square of a motion past contacts counts as this fraction of that of the bodies at least: rounding of squares, 1e-8
of a motion, is then far below `RESISTED` of what it is compared with."""

LEVERS = 2e-2
"""Most errors of lever arms of loads, over the size of a body, and of the turn that they drive."""

WITHOUT = " without any force"  # ends the words for a motion that nothing resists

FOLLOWS = 1e-6
"""Loads that change by more than this fraction of the most as frames move determine a motion."""


Parts = Mapping[str, tuple[int, np.ndarray, np.ndarray]]
"""By contact the number of forces, the numbers (c,) of motions, and FᵀF or DᵀD of these (c, c)."""


class HeldMotion(NamedTuple):
    """A motion that is held.

    Attributes
    ----------
    body : that moves most
    motion : in words
    moment, bound : the load that is left along it, and what it may be (N m; where the body does not turn about its
        middle, N along its fastest node)
    coarse : whether only coarse linear elements let it be held
    velocities : (nb, n) of all loose and driven bodies, the way that the load drives them
    unit : of the velocities (m or 1), by which loads along them are divided
    """

    body: str
    motion: str
    moment: float
    bound: float
    coarse: bool
    velocities: np.ndarray
    unit: float

    def entry(self) -> dict[str, Any]:
        """What stands in the summary."""
        return {
            "body": self.body,
            "motion": self.motion,
            "moment": self.moment,
            "bound": self.bound,
        }


@dataclass(frozen=True)
class Held:
    """The motions to hold: basis and coarse are the same on all ranks.

    Attributes
    ----------
    basis : (rigid.size, q) the motions, each with an entry 1 where the others have zeros
    coarse : (q,) bool, which of them only coarse linear elements let hold
    bodies : on the first rank all that are loose and all that are driven, in the order of their motions
    near : those of them that move a side of a contact of this rank, in the same order
    """

    basis: np.ndarray
    coarse: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    bodies: Sequence[MotionsOfBody] = ()
    near: Sequence[MotionsOfBody] = ()

    @property
    def span(self) -> np.ndarray:
        """(rigid.size, q) orthonormal columns."""
        return np.linalg.qr(self.basis)[0] if self.basis.size else self.basis


def motions_to_hold(assembly: Assembly, coarse: bool = True) -> Held:
    """The motions that no contact resists but by the errors of normals, of those `coarse` ones only if asked. Collective."""
    joint, size = assembly.joint, assembly.joint.rigid.size
    none = Held(np.zeros((size, 0)))
    if not assembly.loose:
        return none
    resisting = gathered(
        assembly.world, {name: (len(F), numbers, F.T @ F) for name, numbers, F in _forces(assembly)}
    )
    if not from_first(
        assembly.world, lambda: bool(islands(resisting, size, joint.stays.bolts, FAINT))
    ):
        return none
    bodies = with_partners(assembly)
    near = _near(assembly, bodies)
    past = {}
    for interface, (_, numbers, _) in zip(
        assembly.space.interfaces, joint.rigid.blocks, strict=True
    ):
        D = _past(assembly, interface, near)[:, :, numbers]
        D = D.reshape(interface.m * interface.dimension, len(numbers))
        past[interface.name] = len(D), numbers, D.T @ D
    moving = gathered(assembly.world, past)

    def choose() -> tuple[np.ndarray, list[bool]] | None:
        F, D = (_summed(parts, size) for parts in (resisting, moving))
        chosen, levels = [np.zeros((size, 0))], [np.zeros(0, bool)]
        for members in islands(resisting, size, joint.stays.bolts, FAINT):
            vectors, level = _unresisted(
                F[members][:, members].toarray(), D[members][:, members].toarray(), coarse
            )
            vectors = _dead(vectors, joint.K[members][:, members].toarray())
            if vectors.shape[1] < len(level):
                level = np.full(vectors.shape[1], level.any())
            placed = np.zeros((size, vectors.shape[1]))
            placed[members] = vectors
            chosen.append(placed)
            levels.append(level)
        basis = np.hstack(chosen)
        return (basis, np.concatenate(levels).tolist()) if basis.size else None

    found = from_first(assembly.world, choose)
    if found is None:
        return none
    basis, level = found
    return Held(basis, np.array(level, bool), () if assembly.world.rank else bodies, near)


def _near(assembly: Assembly, bodies: Sequence[MotionsOfBody]) -> list[MotionsOfBody]:
    """Those of all `bodies`, which the first rank has, that move a side of a contact of this rank; centres and bases
    alone are sent, without outlines. Collective."""
    world, slices, none = assembly.world, assembly.joint.slices, np.zeros((0, 0))
    wanted = sorted(
        {name for interface in assembly.space.interfaces for name in _movers(assembly, interface)}
        & {name for name, at in slices.items() if at.stop > at.start}
    )
    of_ranks = world.gather(wanted) or []
    known = {body.name: np.append(body.centre, body.basis).tobytes() for body in bodies}
    told = world.scatter([b"".join(known[name] for name in names) for names in of_ranks] or None)
    numbers, near, d = np.frombuffer(told), list[MotionsOfBody](), assembly.scene.dimension
    for name in wanted:
        columns = slices[name].stop - slices[name].start
        size = d + (d + d * (d - 1) // 2) * columns  # a velocity, and turns about the axes
        of_body, numbers = np.split(numbers, [size])
        basis = of_body[d:].reshape(-1, columns)
        near.append(MotionsOfBody(name, of_body[:d], 0.0, none, basis, none))
    return near


def _movers(assembly: Assembly, interface: Interface) -> set[str]:
    """The names of the bodies and driven partners of a contact. Not collective."""
    driven = assembly.joint.driven
    return {*interface.bodies, *(each.name for each in driven if each.acts_on(interface))}


def _forces(assembly: Assembly) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Of each contact of this rank its name, the numbers (c,) of motions, and F (k, c): how these move along all forces
    that the contact may carry. Not collective."""
    found = []
    for interface, (_, numbers, block) in zip(
        assembly.space.interfaces, assembly.joint.rigid.blocks, strict=True
    ):
        law, none = interface.law, np.zeros(interface.law.m)
        rubs = (law.slope(none) > 0.0) | (law.slip_bound(none) > 0.0) | law.two_sided
        rubs = np.broadcast_to(rubs, law.sliding.shape)
        acts = np.concatenate([np.ones(law.m, bool), np.repeat(rubs, law.components)])
        found.append((interface.name, numbers, block[acts]))
    return found


def _past(assembly: Assembly, interface: Interface, bodies: Sequence[MotionsOfBody]) -> np.ndarray:
    """D (m, d, rigid.size): how motions move the sides of a contact past each other at its nodes. Not collective."""
    joint = assembly.joint
    D = np.zeros((interface.m, interface.dimension, joint.rigid.size))
    for body, sign in _sides(assembly, interface, bodies):
        at = joint.slices[body.name]
        D[:, :, at] += sign * np.stack(
            [body.at(velocity, interface.xy) for velocity in body.basis.T], axis=2
        )
    return D


def _sides(
    assembly: Assembly, interface: Interface, bodies: Sequence[MotionsOfBody]
) -> list[tuple[MotionsOfBody, float]]:
    """The bodies and driven partners that move the sides of a contact, with 1 for the first side and −1 for the second.
    Not collective."""
    movers = _movers(assembly, interface)
    return [
        (body, 1.0 if body.name == interface.bodies[0] else -1.0)
        for body in bodies
        if body.name in movers
    ]


def _summed(parts: Parts, size: int) -> sparse.csr_matrix:
    """The sum (size, size) of the blocks of all contacts."""
    rows, columns, values = [np.zeros(0, int)], [np.zeros(0, int)], [np.zeros(0)]
    for _, numbers, block in parts.values():
        rows.append(np.repeat(numbers, len(numbers)))
        columns.append(np.tile(numbers, len(numbers)))
        values.append(block.ravel())
    return sparse.csr_matrix(
        (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (size, size)
    )


def islands(resisting: Parts, size: int, kept: np.ndarray, least: float) -> list[np.ndarray]:
    """The numbers of the motions of each group of bodies that touch in which a motion is resisted by less than `least`
    of the root of the number of forces. Groups of more than `LARGEST` bodies are left out."""
    F, number = _summed(resisting, size), np.zeros(size)
    for count, numbers, _ in resisting.values():
        number[numbers] += count
    touching = _summed(
        {
            name: (count, numbers, np.ones_like(F))
            for name, (count, numbers, F) in resisting.items()
        },
        size,
    )
    _, island = csgraph.connected_components(touching, directed=False)
    found = []
    for label in range(int(island.max(initial=-1)) + 1):
        members = np.flatnonzero((island == label) & ~kept)
        if not len(members) or not number[members].any() or len(members) > 6 * LARGEST:
            continue
        smallest = np.linalg.eigvalsh(F[members][:, members].toarray())[0]
        if smallest <= least**2 * number[members].max():
            found.append(members)
    return found


def _unresisted(F: np.ndarray, D: np.ndarray, coarse: bool) -> tuple[np.ndarray, np.ndarray]:
    """The motions (j, q) with |F v| ≤ η |D v|, by FᵀF and DᵀD, each with an entry 1 where the others have zeros; and
    which are above `RESISTED` (q,) bool."""
    sizes = D.diagonal()
    own = RIGID * np.where(sizes > 0.0, sizes, 1.0)
    squares, vectors = eigh(F, D + np.diag(own))
    ratios = np.sqrt(np.maximum(squares, 0.0))
    few = int((ratios <= RESISTED).sum())
    many = int((ratios <= COARSE).sum())
    if (
        not coarse
        or many == few
        or (many < len(ratios) and ratios[many] < APART * ratios[many - 1])
    ):
        many = few
    chosen = vectors[:, :many] / np.linalg.norm(vectors[:, :many], axis=0)
    return _told_apart(chosen), np.full(many, many > few)


def _told_apart(vectors: np.ndarray) -> np.ndarray:
    """A basis (j, q) of the span of `vectors` (j, q), each with an entry 1 where the others have zeros."""
    if not vectors.size:
        return vectors
    null = np.linalg.qr(vectors)[0].T
    pivots = qr(null, mode="r", pivoting=True)[1][: len(null)]
    return np.linalg.solve(null[:, pivots], null).T


def _dead(vectors: np.ndarray, K: np.ndarray) -> np.ndarray:
    """The part of the span of `vectors` (j, q) along which loads do not change, by K (j, j)."""
    size = np.abs(K).max(initial=0.0)
    if not size or not vectors.size:
        return vectors
    span = np.linalg.qr(vectors)[0]
    _, values, turn = np.linalg.svd(K @ span)
    return _told_apart(span @ turn[values <= FOLLOWS * size].T)


def judge_held(
    assembly: Assembly, held: Held, outer: Outer
) -> tuple[list[HeldMotion], Mechanism | None, bool]:
    """What is left along the held motions under the forces of `outer`; the mechanism where a load drives one by more
    than facets and gaps may bear; and whether coarse motions are driven so and have to be released. Collective."""
    joint = assembly.joint
    left = joint.held_back(outer.forces, outer.motions)
    # each motion alone, and the one along which all of the load is left
    size = float(np.linalg.norm(left))
    basis = np.column_stack([held.basis, left / size if size else left])
    coarse = np.append(held.coarse, held.coarse.any())
    error = np.where(coarse, WORST * COARSE, RESISTED)
    levers, passing = _borne(assembly, held.near, basis, outer.forces)
    bounds = levers + error * passing
    joint.stays.share = float(
        (bounds[passing > 0.0] / passing[passing > 0.0]).max(initial=RESISTED)
    )
    loads = loads_of_loose(assembly)

    def judge() -> tuple[list[HeldMotion], Mechanism | None, bool]:
        moved = []
        for k, motion in enumerate(basis.T):
            velocities = np.array(
                [body.basis @ motion[joint.slices[body.name]] for body in held.bodies]
            )
            bound = float(bounds[k] + IMBALANCE * _speeds(held, velocities) @ loads)
            load = float(left @ motion)
            moved.append(_told(held, np.copysign(1.0, load) * velocities, abs(load), bound, k))
        driven = [k for k, motion in enumerate(moved) if motion.moment > motion.bound]
        told = moved[: held.basis.shape[1]]
        if not driven or coarse[driven[0]]:
            return told, None, bool(driven)
        worst = moved[driven[0]]
        speeds = _speeds(held, worst.velocities)
        mechanism = Mechanism(
            tuple(held.bodies),
            worst.velocities / speeds.max(),
            worst.moment * worst.unit / float((speeds * loads).max() or 1.0),
            _because(worst, assembly.scene.units),
        )
        return told, mechanism, False

    return from_first(assembly.world, judge)


def _speeds(held: Held, velocities: np.ndarray) -> np.ndarray:
    """(nb,) the most speed of each body with these `velocities` (nb, n). Only on the first rank."""
    return np.array([body.speed(v) for body, v in zip(held.bodies, velocities, strict=True)])


def slides(held: Sequence[HeldMotion]) -> bool:
    """Whether a load drives a held motion that turns no body. Sides along it are flat, so that no error of normals is
    known to bear the load: then the program of rigid motions decides, however slight the load is."""
    return any(TURN not in one.motion and one.moment > IMBALANCE * one.bound for one in held)


def _borne(
    assembly: Assembly, bodies: Sequence[MotionsOfBody], basis: np.ndarray, s: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Σ |s_i| |gap_i| |ω| and Σ |s_i| |D_i v| (q,) of motions v, the columns of `basis`, under forces s (size,) in newtons.
    Collective."""
    space, slices = assembly.space, assembly.joint.slices
    sums, forces = np.zeros((2, basis.shape[1])), space.at_nodes(s)
    ends = np.cumsum([0, *(interface.m for interface in space.interfaces)])
    for interface, start, stop in zip(space.interfaces, ends, ends[1:], strict=False):
        at_node = forces[start:stop]
        turns = np.zeros((1, basis.shape[1]))
        for body, sign in _sides(assembly, interface, bodies):
            turns = turns + sign * body.basis[body.dimension :] @ basis[slices[body.name]]
        sums[0] += (at_node @ np.abs(interface.opening)) * np.linalg.norm(turns, axis=0)
        sums[0] += IMBALANCE * at_node.sum() * np.linalg.norm(basis, axis=0)  # rounding
        sums[1] += at_node @ np.linalg.norm(_past(assembly, interface, bodies) @ basis, axis=1)
    levers, passing = space.add(sums.ravel()).reshape(sums.shape)
    return levers, passing


def _told(held: Held, velocities: np.ndarray, load: float, bound: float, k: int) -> HeldMotion:
    """The k-th motion with these `velocities` (nb, n), the `load` that drives it, and its `bound` (N)."""
    speeds = [body.speed(v) for body, v in zip(held.bodies, velocities, strict=True)]
    lead = int(np.argmax(speeds))
    body = held.bodies[lead]
    if not speeds[lead]:
        return HeldMotion(body.name, "", 0.0, 0.0, False, velocities, 1.0)
    along = velocities if forwards(held.bodies, velocities) > 0.0 else -velocities
    way = describe_motions(held.bodies, along, "can")
    turning = float(np.linalg.norm(velocities[lead][body.dimension :]))
    unit = turning if TURN in way else speeds[lead]
    coarse = bool(np.append(held.coarse, False)[k])
    return HeldMotion(
        body.name, f"{way}{WITHOUT}", load / unit, bound / unit, coarse, velocities, unit
    )


def _because(held: HeldMotion, units: Mapping[str, str]) -> str:
    """Why the motion is a mechanism, after its name."""
    turns = TURN in held.motion
    unit = units["moment" if turns else "force"]
    return (
        f": {held.moment:.3g} {unit} drive it, and only the facets of the meshes resist ({held.bound:.3g} {unit} at "
        f"most); give the contact friction, or clamp the {'turn' if turns else 'motion'}"
    )


def coarse_words(held: Sequence[HeldMotion]) -> list[str]:
    """A warning for each body with motions that only coarse linear elements let hold."""
    motions: dict[str, list[str]] = {}
    for one in held:
        if one.coarse:
            motions.setdefault(one.body, []).append(one.motion.removesuffix(WITHOUT))
    return [
        f"body.{body}: facets resist a motion of it by about {COARSE:.0%} of its forces, which smooth sides would not; "
        f"it is held ({'; '.join(ways)}); take order 2 or a finer mesh"
        for body, ways in motions.items()
    ]


def beyond_meshes(assembly: Assembly, held: Held, mechanism: Mechanism | None) -> Mechanism | None:
    """The mechanism, unless it is a held motion that turns bodies and that the loads drive by little more than the
    errors of lever arms: what is left along it then decides, see `judge_held`. Not collective."""
    if mechanism is None or not held.basis.size or mechanism.imbalance > LEVERS:
        return mechanism
    alpha, slices = np.zeros(len(held.basis)), assembly.joint.slices
    turns = False
    for body, v in zip(mechanism.bodies, mechanism.velocities, strict=True):
        alpha[slices[body.name]] = np.linalg.lstsq(body.basis, v, rcond=None)[0]
        turns |= bool(np.linalg.norm(v[body.dimension :]) * body.size > LEVERS)
    left = alpha - held.span @ (held.span.T @ alpha)
    return None if turns and np.linalg.norm(left) <= LEVERS * np.linalg.norm(alpha) else mechanism
