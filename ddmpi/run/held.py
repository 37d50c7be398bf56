"""The rigid motions that nothing determines: which they are, where they stay, and what is left along them.

Of all answers the one is taken whose rigid motions are nearest to those before; and balance is asked for only as
exactly as normals are known. A motion v moves the sides of contacts past each other by D v at the nodes, with the
components F v along the forces that contacts may carry, at open nodes as at closed ones. Where |F v| ≤ η |D v|, with
the error η of the normals of meshes, only this error resists v, as on the turn of a round part. Such motions are held
where they were, like by a dry friction of the coefficient η that acts on the body as a whole.

A pair of nodes with a gap has one normal between those of its sides, and so a lever arm about the axes of both. This
arm is one of small displacements alone: where the sides touch in the end they have one normal, and a part moves with
its loads, whose moments about its own axis stay. So F has the normals ν of each side itself, at its own nodes, and

    λ(v) = e·v − Σ s_i ν_i·v,    |λ| ≤ τ(v) = Σ |s_i| η |D_i v|

is what is left of the loads, and its limit. Beyond it there is no equilibrium: forces of facets that balance a larger
load would be thousands of times as large as the load.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.coupling.assembly import Assembly
from ddmpi.judge.equilibrium import IMBALANCE, Mechanism
from ddmpi.judge.motions import (
    COARSE,
    LARGEST,
    RESISTED,
    TURN,
    MotionsOfBody,
    dead,
    describe_motions,
    forwards,
    is_definite,
    loads_beside,
    told_apart,
    unresisted,
)
from ddmpi.methods.outer import Outer
from ddmpi.run.equilibrium import Parts, loads_of_loose, sides_moved, summed, with_partners
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import from_first, gathered
from ddmpi.system.matrices import square

WORST = 3.0
"""Where few nodes bear, the normals of coarse elements are off there by up to this times the mean error COARSE."""

FAINT = 3e-2
"""No motion is held in a group of bodies that resists all motions by more than this, over the root of its forces."""

LEVERS = 2e-2
"""A body turns if its turn moves it by more than this, of what the fastest one moves."""

DRAWN = 0.2
"""Most lever arms of loads about a round partner that are those of a gap as drawn, over the size of a body, and most of
what else than a held turn they drive."""

BESIDE = 0.5
"""A motion counts beside others if the part of it that is none of theirs is longer than this, of the whole."""

WITHOUT = " without any force"  # ends the words for a motion that nothing resists


class HeldMotion(NamedTuple):
    """A motion that is held.

    Attributes
    ----------
    body : that moves most
    motion : in words
    moment, bound : the load that is left along it, and what it may be (N m; where the body does not turn about its
        middle, N along its fastest node)
    coarse : whether only coarse linear elements let it be held
    """

    body: str
    motion: str
    moment: float
    bound: float
    coarse: bool

    def entry(self) -> dict[str, Any]:
        """What stands in the summary."""
        return {
            "body": self.body,
            "motion": self.motion,
            "moment": self.moment,
            "bound": self.bound,
        }


class Passing(NamedTuple):
    """How the motions of a contact's bodies move its sides.

    Attributes
    ----------
    moves : (2, m, d, c) both sides at the nodes
    own : (m, c) by how much more they close along the normals of each side than along those of pairs; zero where sides
        rub, which then turn as one
    """

    moves: np.ndarray
    own: np.ndarray


@dataclass(frozen=True)
class Held:
    """The motions to hold: basis and coarse are the same on all ranks.

    Attributes
    ----------
    basis : (rigid.size, q) the motions, each with an entry 1 where the others have zeros
    coarse, turns : (q,) bool, which of them only coarse linear elements let hold, and which turn bodies
    errors : (q,) η of each, more where sides are not seen to be round
    bodies : on the first rank all that are loose and all that are driven, in the order of their motions
    passing : of each contact of this rank how the motions of its block move its sides
    """

    basis: np.ndarray
    coarse: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    turns: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    errors: np.ndarray = field(default_factory=lambda: np.zeros(0))
    bodies: Sequence[MotionsOfBody] = ()
    passing: Sequence[Passing] = ()

    @property
    def span(self) -> np.ndarray:
        """(rigid.size, q) orthonormal columns."""
        return np.linalg.qr(self.basis)[0] if self.basis.size else self.basis


def motions_to_hold(assembly: Assembly, coarse: bool = True, slight: float = 0.0) -> Held:
    """The motions that no contact resists but by the errors of normals, of those `coarse` ones only if asked, and by
    friction with coefficients up to a `slight` one. Collective."""
    world = assembly.world
    joint = assembly.joint
    scene = assembly.scene
    size = assembly.joint.rigid.size
    none = Held(np.zeros((size, 0)))
    if not assembly.loose:
        return none
    forces = _forces(assembly, slight)
    resisting = gathered(world, {name: (len(F), numbers, F.T @ F) for name, numbers, F in forces})
    # a shape in the plane or of order 2 that is resisted by more than RESISTED is not round
    coarse = coarse and (scene.dimension, scene.body[0].mesh.order) == (3, 1)
    passing, past, own = _passing(assembly, forces), {}, {}
    for (name, numbers, F), (moves, leaning) in zip(forces, passing, strict=True):
        m, d, c = moves[0].shape
        D = (moves[0] - moves[1]).reshape(m * d, c)
        own_rows = F.copy()
        own_rows[: len(leaning)] += leaning
        past[name] = len(D), numbers, D.T @ D
        own[name] = len(F), numbers, own_rows.T @ own_rows
    by_sides = gathered(world, own)

    def touching() -> list[np.ndarray]:
        return islands(resisting, size, joint.stays.bolts, FAINT, by_sides)

    groups = from_first(world, touching)
    if not groups:
        return none
    moving, bodies = gathered(world, past), with_partners(assembly)

    def choose() -> tuple[np.ndarray, ...]:
        sums = [summed(parts, size) for parts in (by_sides, resisting, moving)]
        owner = np.repeat(np.arange(len(bodies)), [body.basis.shape[1] for body in bodies])
        spin = [body.size * np.abs(body.basis[scene.dimension :]).max(axis=0) for body in bodies]
        turned = np.concatenate(spin) > LEVERS
        basis, level = _chosen(groups, sums, joint.K, (owner, turned), coarse)
        turns = [turning(bodies, _velocities(assembly, bodies, v)) for v in basis.T]
        own, _, past = ((basis * (matrix @ basis)).sum(axis=0) for matrix in sums)
        resisted = turns * np.sqrt(np.maximum(own, 0.0) / np.where(past > 0.0, past, 1.0))
        errors = np.maximum(np.where(level, WORST * COARSE, RESISTED), resisted)
        return basis, level, np.array(turns, bool), errors

    basis, level, turns, errors = from_first(world, choose)
    if not basis.size:
        return none
    return Held(basis, level, turns, errors, () if world.rank else bodies, passing)


def _chosen(
    groups: Sequence[np.ndarray],
    sums: Sequence[sparse.csr_matrix],
    K: sparse.csr_matrix,
    of_bodies: tuple[np.ndarray, np.ndarray],
    coarse: bool,
) -> tuple[np.ndarray, np.ndarray]:
    """`Held.basis` and `Held.coarse` of groups of motions, by the `sums` FᵀF of sides and of pairs, and DᵀD; and by
    how loads change, K; `of_bodies` (j,) has the number of the body of each motion, and whether it turns that."""
    chosen, levels = [np.zeros((K.shape[0], 0))], [np.zeros(0, bool)]
    loads, turned = loads_beside(K, of_bodies[0]), of_bodies[1]
    for members in groups:
        own, F, D = (square(matrix, members) for matrix in sums)
        vectors, level = unresisted(own, D, coarse)
        by_pairs, rough = unresisted(F, D, coarse)
        # what is nearly the same turn, but about another axis, is none beside it
        beside, sizes, _ = np.linalg.svd(by_pairs - vectors @ (vectors.T @ by_pairs))
        beside = beside[:, : len(sizes)][:, sizes > BESIDE]
        level |= rough and beside.size > 0
        candidates, errors = np.hstack([vectors, beside]), COARSE if level else RESISTED
        change = _beside_shifts(square(K, members), candidates, turned[members])
        given = change, loads[members], errors
        vectors = dead(candidates, *given)
        if coarse and vectors.shape[1] < candidates.shape[1]:
            straight = dead(_straight(candidates, turned[members]), *given)
            if straight.shape[1] > vectors.shape[1]:
                vectors, level = straight, True
        placed = np.zeros((K.shape[0], vectors.shape[1]))
        placed[members] = vectors
        chosen.append(placed)
        levels.append(np.full(vectors.shape[1], level))
    return np.hstack(chosen), np.concatenate(levels)


def _beside_shifts(K: np.ndarray, vectors: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """By how much loads change, K (j, j), but for pure shifts in the span of `vectors` (j, q), orthonormal columns: where
    contacts resist no shift their forces move along with it, so that lever arms of loads stay. Motions `turned` (j,) bool
    turn bodies."""
    _, values, combinations = np.linalg.svd(vectors[turned])
    shifts = vectors @ combinations[int((values > RESISTED).sum()) :].T
    return K - (K @ shifts) @ np.linalg.pinv(shifts)


def _straight(vectors: np.ndarray, turned: np.ndarray) -> np.ndarray:
    """`vectors` (j, q) told apart, without what shifts turn, motions `turned` (j,) bool, by less than normals of coarse
    elements are off: on a tilt that grows along the way, loads would drive them."""
    vectors = told_apart(vectors.T).T
    shifts = np.abs(vectors[turned]).max(axis=0, initial=0.0) <= COARSE
    vectors[np.ix_(turned, shifts)] = 0.0
    return vectors


def _forces(assembly: Assembly, slight: float) -> list[tuple[str, np.ndarray, np.ndarray]]:
    """Of each contact of this rank its name, the numbers (c,) of motions, and F (k, c): how these move along all forces
    that the contact may carry, but for friction with coefficients up to a `slight` one. Not collective."""
    found = []
    for interface, (_, numbers, block) in zip(
        assembly.space.interfaces, assembly.joint.rigid.blocks, strict=True
    ):
        law, none = interface.law, np.zeros(interface.law.m)
        rubs = (law.slope(none) > slight) | (law.slip_bound(none) > 0.0) | law.two_sided
        rubs = np.broadcast_to(rubs, law.sliding.shape)
        acts = np.concatenate([np.ones(law.m, bool), np.repeat(rubs, law.components)])
        # a body moves both of its own sides alike; what rows see of that are lever arms of gaps
        found.append((interface.name, numbers, block[acts] * (not interface.idle)))
    return found


def _passing(
    assembly: Assembly, forces: Sequence[tuple[str, np.ndarray, np.ndarray]]
) -> list[Passing]:
    """Of each contact of this rank, with its `forces`. Collective over neighbours."""
    found = []
    for interface, (_, _, F), (one, other) in zip(
        assembly.space.interfaces, forces, sides_moved(assembly), strict=True
    ):
        leans = np.einsum("smt,mtd->smd", interface.geometry.tilt, interface.tangents)
        own = np.einsum("md,mdc->mc", leans[0], one) - np.einsum("md,mdc->mc", leans[1], other)
        leans_apart = len(F) == interface.m and not interface.idle
        found.append(Passing(np.stack([one, other]), own if leans_apart else 0.0 * own))
    return found


def islands(
    resisting: Parts, size: int, kept: np.ndarray, least: float, by_sides: Parts | None = None
) -> list[np.ndarray]:
    """The numbers of the motions of each group of bodies that touch in which a motion is resisted by less than `least`
    of the root of the number of forces, or of those along the normals of each side, if given. Groups of more than
    `LARGEST` bodies are left out."""
    F, number = summed(resisting, size), np.zeros(size)
    matrices = [F, *([summed(by_sides, size)] if by_sides else ())]
    for count, numbers, _ in resisting.values():
        number[numbers] += count
    _, island = csgraph.connected_components(F, directed=False)
    found = []
    for label in range(int(island.max(initial=-1)) + 1):
        members = np.flatnonzero((island == label) & ~kept)
        if not len(members) or not number[members].any() or len(members) > 6 * LARGEST:
            continue
        bound = least**2 * number[members].max() * np.eye(len(members))
        if not all(is_definite(square(A, members) - bound) for A in matrices):
            found.append(members)
    return found


class Left(NamedTuple):
    """What is left along held motions.

    Attributes
    ----------
    basis : (rigid.size, q + g) the held motions, and by group the one along which all of its load is left
    loads, bounds : (q + g,) what is left (N), and what errors of normals may bear of it without rounding of loads
    coarse : (q + g,) bool, which of them coarse linear elements alone let hold
    """

    basis: np.ndarray
    loads: np.ndarray
    bounds: np.ndarray
    coarse: np.ndarray


def _left(assembly: Assembly, held: Held, outer: Outer, groups: Sequence[np.ndarray]) -> Left:
    """What the forces of `outer` leave along the held motions, and of `groups` of motions, (rigid.size,) bool each, as
    a whole. Collective."""
    joint, basis = assembly.joint, held.basis
    left = joint.held_back(outer.forces, outer.motions) @ basis
    left -= held.turns * _by_own_normals(assembly, held, outer.forces)
    along = np.linalg.lstsq(basis.T, left, rcond=None)[0] * np.array(groups)
    sizes = np.linalg.norm(along, axis=1)
    wholes = along.T / np.where(sizes > 0.0, sizes, 1.0)
    basis, left = np.hstack([basis, wholes]), np.append(left, sizes)
    members = np.array(groups) @ np.abs(held.basis) > 0.0
    coarse = np.append(held.coarse, (members & held.coarse).any(axis=1))
    errors = np.append(held.errors, (members * held.errors).max(axis=1))
    passing, rounding = _borne(assembly, held, basis, outer.forces)
    bounds = errors * passing + rounding
    slide = passing > 0.0
    joint.stays.share = float((bounds[slide] / passing[slide]).max(initial=RESISTED))
    return Left(basis, left, bounds, coarse)


def driven_turns(
    assembly: Assembly, held: Held, outer: Outer, groups: Sequence[np.ndarray]
) -> np.ndarray:
    """Motions (rigid.size,) of a radian (m) that loads drive though they are held, of each of the `groups`, as of `_left`,
    one that turns bodies; zero elsewhere. Collective."""
    left, loads = _left(assembly, held, outer, groups), loads_of_loose(assembly)

    def drive() -> np.ndarray:
        bodies, driven = held.bodies, np.zeros(len(left.basis))
        for k in np.roll(np.arange(len(left.loads)), len(groups)):  # of whole groups first
            if left.coarse[k]:
                continue
            motion = np.copysign(1.0, left.loads[k]) * left.basis[:, k]
            velocities = _velocities(assembly, bodies, motion)
            speeds = np.array([body.speed(v) for body, v in zip(bodies, velocities, strict=True)])
            bound = left.bounds[k] + IMBALANCE * speeds @ loads
            if abs(left.loads[k]) > bound and turning(bodies, velocities):
                turns = np.linalg.norm(velocities[:, assembly.scene.dimension :], axis=1).max()
                for group in groups:
                    if motion[group].any() and not driven[group].any():
                        driven[group] = motion[group] / turns
        return driven

    return from_first(assembly.world, drive)


def _velocities(
    assembly: Assembly, bodies: Sequence[MotionsOfBody], motion: np.ndarray
) -> np.ndarray:
    """The velocities (nb, n) of all bodies in a motion (rigid.size,)."""
    slices = assembly.joint.slices
    return np.array([body.basis @ motion[slices[body.name]] for body in bodies])


def judge_held(
    assembly: Assembly, held: Held, outer: Outer
) -> tuple[list[HeldMotion], Mechanism | None, bool]:
    """What is left along the held motions under the forces of `outer`; the mechanism where a load drives one by more
    than normals may bear; and whether coarse motions are driven so and have to be released. Collective."""
    # each motion alone, and the one along which all of the load is left
    basis, left, bounds, coarse = _left(assembly, held, outer, [np.ones(len(held.basis), bool)])
    loads = loads_of_loose(assembly)

    def judge() -> tuple[list[HeldMotion], Mechanism | None, bool]:
        bodies, told = held.bodies, list[HeldMotion]()
        for k, motion in enumerate(basis.T):
            velocities = _velocities(assembly, bodies, np.copysign(1.0, left[k]) * motion)
            speeds = np.array([body.speed(v) for body, v in zip(bodies, velocities, strict=True)])
            load, bound = abs(left[k]), float(bounds[k] + IMBALANCE * speeds @ loads)
            one = _told(bodies, velocities, speeds, load, bound, bool(coarse[k]))
            told.append(one)
            if load > bound and coarse[k]:
                return [], None, True
            if load > bound:
                because = _because(one, assembly.scene)
                acting = float((speeds * loads).max() or 1.0)
                mechanism = Mechanism(
                    tuple(bodies),
                    velocities / speeds.max(),
                    load / acting,
                    because,
                    acting / speeds.max(),
                )
                return told, mechanism, False
        # motions that are resisted alike come in any order
        scene = assembly.scene
        named = [each.name for each in (*scene.body, *scene.rigid)]
        order = {name: number for number, name in enumerate(named)}  # pretensions come last
        told = sorted(told[:-1], key=lambda one: (order.get(one.body, len(named)), one.motion))
        return told, None, False

    return from_first(assembly.world, judge)


def slides(held: Sequence[HeldMotion]) -> bool:
    """Whether a load drives a held motion that turns no body. Sides along it are flat, so that no error of normals is
    known to bear the load: then the program of rigid motions decides, however slight the load is."""
    return any(TURN not in one.motion and one.moment > IMBALANCE * one.bound for one in held)


def _by_own_normals(assembly: Assembly, held: Held, s: np.ndarray) -> np.ndarray:
    """What more the normal forces of `s` (size,) do on the held motions (q,) along the normals of each side than along
    those of pairs (N); what a body does on itself counts as nothing. Collective."""
    more, joint = np.zeros(held.basis.shape[1]), assembly.joint
    for interface, (part, numbers, block), (_, own) in zip(
        assembly.space.interfaces, joint.rigid.blocks, held.passing, strict=True
    ):
        own = -block if interface.idle else own
        more += s[part][: len(own)] @ own @ held.basis[numbers]
    return assembly.space.add(more)


def _borne(assembly: Assembly, held: Held, basis: np.ndarray, s: np.ndarray) -> np.ndarray:
    """Σ |s_i| |D_i v| of motions v, the columns of `basis` (·, q), under forces s (size,), and rounding beside all
    forces: (2, q) in newtons. Collective."""
    borne = np.zeros((2, basis.shape[1]))
    for (part, numbers, _), (moves, own) in zip(
        assembly.joint.rigid.blocks, held.passing, strict=True
    ):
        pressing, moved = np.abs(s[part][: len(own)]), moves @ basis[numbers]
        speeds = np.linalg.norm(moved, axis=2).sum(axis=0)
        # the normals of both sides are off, also of those that turn as one
        slide = speeds if own.any() else np.linalg.norm(moved[0] - moved[1], axis=1)
        borne += pressing @ slide, IMBALANCE * pressing @ speeds
    return assembly.space.add(borne.ravel()).reshape(borne.shape)


def _told(
    bodies: Sequence[MotionsOfBody],
    velocities: np.ndarray,
    speeds: np.ndarray,
    load: float,
    bound: float,
    coarse: bool,
) -> HeldMotion:
    """A motion with these `velocities` (nb, n), the `load` that drives it, and its `bound` (N)."""
    lead = int(speeds.argmax())
    if not speeds[lead]:
        return HeldMotion(bodies[lead].name, "", 0.0, 0.0, coarse)
    along = np.copysign(1.0, forwards(bodies, velocities)) * velocities
    way = describe_motions(bodies, along, "can")
    turns = float(np.linalg.norm(along[lead][bodies[lead].dimension :]))
    unit = turns if TURN in way else float(speeds[lead])
    return HeldMotion(bodies[lead].name, f"{way}{WITHOUT}", load / unit, bound / unit, coarse)


def _because(held: HeldMotion, scene: Settled) -> str:
    """Why the motion is a mechanism, after its name."""
    turns = TURN in held.motion
    unit = scene.units["moment" if turns else "force"]
    drives = f": {held.moment:.3g} {unit} drive it, and"
    clamp = f"clamp the {'turn' if turns else 'motion'}"
    if all({*each.bodies} == {held.body} for each in scene.contact if held.body in each.bodies):
        return f"{drives} no contact of {held.body} with itself or its image resists it; {clamp}"
    return (
        f"{drives} only the facets of the meshes resist ({held.bound:.3g} {unit} at most); give the contact friction, "
        f"or {clamp}"
    )


def coarse_words(held: Sequence[HeldMotion]) -> list[str]:
    """A warning for each body with motions that only coarse linear elements let hold."""
    motions: dict[str, list[str]] = {}
    for one in held:
        if one.coarse:
            motions.setdefault(one.body, []).append(one.motion.removesuffix(WITHOUT))
    return [
        f"body.{body}: facets, or a shape as near to a round one, resist a motion of it by about {COARSE:.0%} of its "
        f"forces; it is held as if sides were smooth and round ({'; '.join(ways)}); order 2 tells the two apart"
        for body, ways in motions.items()
    ]


def beyond_meshes(assembly: Assembly, held: Held, mechanism: Mechanism | None) -> Mechanism | None:
    """The mechanism, unless it is nearly a held motion that turns bodies, and the loads drive it by no more than lever
    arms of gaps: what is left along the held motion then decides, see `judge_held`. Not collective."""
    if mechanism is None or not held.basis.size or mechanism.imbalance > DRAWN:
        return mechanism
    alpha = amplitudes(mechanism)
    left = alpha - held.span @ (held.span.T @ alpha)
    turns = turning(mechanism.bodies, mechanism.velocities)
    return None if turns and np.linalg.norm(left) <= DRAWN * np.linalg.norm(alpha) else mechanism


def amplitudes(mechanism: Mechanism) -> np.ndarray:
    """The motions (rigid.size,) of a mechanism, of which the fastest node moves by 1 (m)."""
    moving = zip(mechanism.bodies, mechanism.velocities, strict=True)
    return np.concatenate([np.linalg.lstsq(body.basis, v, rcond=None)[0] for body, v in moving])


def turning(bodies: Sequence[MotionsOfBody], velocities: Iterable[np.ndarray]) -> bool:
    """Whether `velocities` (nb, n) turn a body, by more than LEVERS of what the fastest one moves."""
    moves = [
        (np.linalg.norm(v[body.dimension :]) * body.size, body.speed(v))
        for body, v in zip(bodies, velocities, strict=True)
    ]
    turns, speeds = np.array(moves).max(axis=0)
    return bool(turns > LEVERS * speeds)
