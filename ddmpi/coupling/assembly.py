"""From a scene to the discrete problem on one rank: meshes, matrices, interfaces, and the joint operator."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from mpi4py import MPI

from ddmpi.body.compliance import SOLVERS
from ddmpi.body.elasticity import assemble
from ddmpi.body.loads import ON_AXIS
from ddmpi.body.rigid_motions import FreeFrame
from ddmpi.body.stress import Composite, material_of
from ddmpi.coupling.coarse import Driven
from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.factored import Factored
from ddmpi.coupling.far import BothSides, Framed, Placement, free_frames, meet_far, with_slaves
from ddmpi.coupling.joint import Joint
from ddmpi.coupling.member import Member
from ddmpi.coupling.parts import Share, assemble_bodies, mesh_bodies
from ddmpi.coupling.ranks import ranks_beside, team_of
from ddmpi.coupling.sides import Sides
from ddmpi.coupling.space import Space, kept_by_bonds
from ddmpi.coupling.team import Team, TeamMatrix
from ddmpi.errors import InputError
from ddmpi.interface.contradictions import Mover, refuse_contradiction
from ddmpi.interface.interface import Interface, check_overlap
from ddmpi.interface.law import law_of
from ddmpi.interface.matching import face_rigid
from ddmpi.interface.mortar import connect
from ddmpi.interface.rows import uncovered_profile
from ddmpi.interface.trace import placed
from ddmpi.kept.kept import Kept
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import Sizes
from ddmpi.petsc.options import conditions
from ddmpi.scene.bodies import Material, SettledBody
from ddmpi.scene.contacts import PAIR, Coulomb, Friction, SettledContact, Tresca
from ddmpi.scene.motions import frames_of
from ddmpi.scene.scene import Settled
from ddmpi.scene.values import tables
from ddmpi.surface.side import Located, Side
from ddmpi.system import interrupt
from ddmpi.system.agreement import agreed, gathered
from ddmpi.system.clock import Clock, now_at
from ddmpi.system.doubts import Doubt, condensed
from ddmpi.system.logs import PROGRESS
from ddmpi.system.memory import free_memory
from ddmpi.system.numbers import ALIKE, Frame, in_words

NO_SIZES: Mapping[str, Sizes] = {}

Drawn = tuple[Interface, list[str]]
"""An interface as drawn, with warnings."""

BothLocated = tuple[Located, Located | None]
"""The sides of a contact; None for a rigid partner."""

ASIDE = 3e-2
"""An image stands where its bond is if sides are apart by at most this fraction of the way that it is moved: two chords of
an arc that do not match three are by 2 %, a wheel of n sectors that is taken for one of n + 1 by 1/n."""

FLAT, ASIDE_FLAT = 1e-3, 2e-3
"""Sides whose unit normals differ by at most FLAT are flat; then meshes that do not match meet, but for the digits of a
file, and ASIDE_FLAT takes the place of ASIDE."""

UNCOVERED = 1e-2
"""A bond may leave this part of its smaller side free without a word: digits of files and chords of arcs do."""

LARGE = 300_000
"""Dofs of a body whose multigrid takes 5 s to set up."""

REUSED = {
    "mesh": ["mesh"],
    "stiffness": ["stiffness"],
    "compliance": ["factors", "compliance"],
    "pair": ["rows"],
}
"""What the summary calls the stages that a `Kept` has reused; the others take next to no time."""


@dataclass(frozen=True)
class Body:
    """One body on its rank: its number in the scene, its specification, its mesh, and its contacts (`member`)."""

    number: int
    spec: SettledBody
    mesh: Mesh
    member: Member

    @property
    def material(self) -> Material | Composite:
        """The material of the body, or those of its cells."""
        return material_of(self.mesh, self.spec)


@dataclass(frozen=True)
class Assembly:
    """One rank's part of a scene, discretised and factored, at a placement.

    Attributes
    ----------
    world : communicator of all ranks with bodies
    scene : the scene with all defaults
    bodies : of this rank, in the order of the scene
    space : the layout of the vectors of the interfaces that this rank owns
    exchange : between the bodies
    joint : the operator of all bodies together
    n : free dofs of all bodies
    m : contact nodes of all interfaces
    warnings : warnings about the scene; of all bodies and contacts on the first rank
    reused : stages of this rank's bodies and contacts that were reused, by the names of these
    contacts, sides : of this rank's bodies, those that move far each with its slave; and the sides of both bodies in
        their frames, by contact, None for a rigid partner
    free : the free components of the frames of all bodies and rigid partners, by name
    placement : where the bodies are
    outer : the class of an outer method from outside the package, or None
    """

    world: MPI.Comm
    scene: Settled
    bodies: tuple[Body, ...]
    space: Space
    exchange: Exchange
    joint: Joint
    n: int
    m: int
    warnings: list[str]
    reused: dict[str, list[str]]
    contacts: Sequence[SettledContact]
    sides: Mapping[str, BothSides]
    free: Mapping[str, FreeFrame]
    placement: Placement
    outer: Callable[..., object] | None = None

    def meet(self, placement: Placement) -> Assembly:
        """The same bodies at a placement, paired there, under the loads of its time. Collective. Raises InputError."""
        met = meet_far(self.world, self.scene, self.contacts, self.sides, placement)
        factored = [body.member.body for body in self.bodies]
        joint = _couple(self.scene, self.exchange, factored, met, placement.frames, self.free)
        bodies = (
            replace(body, member=member)
            for body, member in zip(self.bodies, joint.members, strict=True)
        )
        placed = replace(
            self, bodies=tuple(bodies), space=joint.space, joint=joint, placement=placement
        )
        placed.act(placement.time)
        return placed

    @property
    def frames(self) -> Mapping[str, Frame]:
        """The frames of all bodies and rigid partners, by name; none where they do not move far."""
        return self.placement.frames

    def in_world(self) -> Assembly:
        """The same with the meshes of bodies that move far where these now are. Not collective."""
        if not self.frames:
            return self
        bodies = []
        for body in self.bodies:
            at = self.frames[body.spec.name].at(body.mesh.points)
            bodies.append(replace(body, mesh=replace(body.mesh, points=at)))
        return replace(self, bodies=tuple(bodies))

    def along(self, displacements: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """Displacements in the frames of this rank's bodies (nv, d), along the axes of the world. Not collective."""
        return {
            name: self.frames[name].along(u) if self.frames else u
            for name, u in displacements.items()
        }

    def act(self, time: float) -> None:
        """Set loads, clamps and rigid partners to their values at `time`. Not collective."""
        factors = self.scene.factors(time)
        self.space.act(factors)
        for body in self.bodies:
            body.member.act(factors)
        self.joint.act(factors)

    @property
    def member(self) -> Member:
        """The only body of this rank, for methods of two bodies."""
        (body,) = self.bodies
        return body.member

    @property
    def pushes(self) -> dict[str, float]:
        """Sum of the forces (N) along the motions of each driven partner, the largest over all turning points."""
        factors = [self.scene.factors(time) for time in self.scene.legs]
        return {
            partner.name: float(np.abs(partner.push).sum())
            * max(abs(at[partner.history]) for at in factors)
            for partner in self.joint.driven
        }

    @property
    def loose(self) -> list[str]:
        """Names of the bodies without sufficient clamps, and of the driven rigid partners."""
        return [name for name, motions in self.joint.slices.items() if motions.stop > motions.start]


def _tell(body: Factored) -> None:
    """Let the phase tell the body that is factored. The set-up of multigrid lets no thread tell anything, so that of a
    large body is told before. Not collective."""
    now_at(f"body.{body.name}, {SOLVERS[body.kind]}")
    n = body.elasticity.A.size[0]
    if body.kind == "iterative" and n >= LARGE:
        logging.getLogger(PROGRESS).info(
            "body.%s: multigrid is set up for %d unknowns", body.name, n
        )


def prepare(
    world: MPI.Comm,
    scene: Settled,
    folder: Path = Path("."),
    clock: Clock | None = None,
    refinement: int = 1,
    sizes: Mapping[str, Sizes] = NO_SIZES,
    factor: bool = True,
    kept: Kept | None = None,
) -> Assembly:
    """Mesh, assemble, pair and factor. Collective. Raises InputError, SolverError and InterruptionError, on all ranks.

    Bodies that move far are factored on all nodes that contacts may join, and meet afterwards, wherever they are. Others
    meet as drawn before they are factored, on the rows of their contacts alone.

    Parameters
    ----------
    world : at most as many ranks as the scene has bodies
    folder : where relative mesh files are looked for first
    clock : times the phases mesh, assemble and factor
    refinement : the meshes of `scene`, but for geometries, are this many times finer than the given ones
    sizes : of the elements of geometries, by the names of this rank's bodies, once an accuracy target refines them
    factor : False for an assembly that is only checked, of which no body is factored
    kept : stages of earlier cases, which this case reuses where it does not change them
    """
    clock = clock or Clock()
    if (team := team_of(world)) and not kept:
        with agreed(world):
            team.do("drop")  # matrices of the last mesh
    kept = kept or Kept()
    kept.begin(conditions())
    share = Share.of(world, scene, kept)
    with clock.phase("mesh"), agreed(world):
        mesh_bodies(share, folder, sizes)
    with clock.phase("assemble"):
        with agreed(world):
            mine = assemble_bodies(share)
        # Sides are small. The ranks of both bodies get both of them and compute the same interface, bit for bit.
        located = share.exchange.swap_objects(mine)
        drawn = {} if scene.far else meet_as_drawn(share, located, refinement)
    sides = dict(zip(located, map(_there, located.values()), strict=True))
    with clock.phase("factor"):
        bodies = plan_bodies(share, drawn, team if factor else None)
        with agreed(world):
            # factors are most of the memory: those that are not used again are freed before others are made
            kept.expect("compliance", {body.name: body.depends(kept) for body in bodies})
            for body in bodies if factor else ():
                _tell(body)
                body.factor(kept)
                interrupt.check()
    kept.end()
    met = {name: interface for name, (interface, _) in drawn.items()}
    contacts, free, placement = share.contacts, dict[str, FreeFrame](), Placement()
    if scene.far:
        contacts, free = with_slaves(contacts, sides), free_frames(world, scene, bodies, sides)
        placement = Placement(frames=frames_of(scene, 0.0))
        met = meet_far(world, scene, contacts, sides, placement)
    joint = _couple(scene, share.exchange, bodies, met, placement.frames, free)
    return Assembly(
        world,
        scene,
        tuple(
            Body(part.number, part.spec, part.mesh, member)
            for part, member in zip(share.parts, joint.members, strict=True)
        ),
        joint.space,
        share.exchange,
        joint,
        world.allreduce(sum(part.problem.n for part in share.parts)),
        world.allreduce(sum(interface.m for interface in joint.space.interfaces)),
        _doubts(share, drawn),
        _reused(kept),
        contacts,
        sides,
        free,
        placement,
    )


def meet_as_drawn(
    share: Share, sides: Mapping[str, BothLocated], refinement: int
) -> dict[str, Drawn]:
    """The interfaces of this rank's contacts where bodies are drawn, with warnings. Collective. Raises InputError."""
    scene, world = share.scene, share.exchange.world
    with agreed(world):
        # Gaps and clamps are linear between turning points, so the worst overlap is at one of them, or at time 0.
        times = scene.legs if scene.time is None or scene.time.steps == 1 else [0.0, *scene.legs]
        factors = {time: scene.factors(time) for time in times}
        specs = {body.name: body for body in scene.body}
        joined = {}
        for contact in share.contacts:
            bodies = [specs[name] for name in contact.bodies if name in specs]
            joined[contact.name] = _join(
                scene, contact, sides[contact.name], bodies, factors, refinement, share.kept
            )
        _check_method(share, [interface for interface, _ in joined.values()])
    return kept_by_bonds(scene, joined, world)


def plan_bodies(share: Share, drawn: Mapping[str, Drawn], team: Team | None) -> list[Factored]:
    """This rank's bodies with their candidates, before any is factored, by the ranks of a `team` if there is one: of
    those that move far all nodes of their sides, of others the rows of their interfaces as `drawn`. Collective. Raises
    InputError."""
    scene, kept, world = share.scene, share.kept, share.exchange.world
    bodies, histories = list[Factored](), [None, *scene.followed]
    memory = _memory(share, team_of(world))
    # time.tolerance takes 1 and 2 load steps at least; iterations of the published method take ten times the products
    steps = len(scene.legs) * (scene.time.steps or 3) if scene.time else 1
    solves = steps * (10 if scene.method.by_body else 1)
    with agreed(world):
        for part in share.parts:
            name, mesh, problem = part.spec.name, part.mesh, part.problem
            points = mesh.home.points[problem.nodes]
            if team and team.comm.size > 1:
                whole = partial(assemble, mesh, part.spec)
                make = partial(TeamMatrix, team, problem, points, whole)
                matrix = kept.get("matrix", name, kept.key("stiffness", name), make)
                problem = replace(problem, A=matrix)
            if scene.far:
                faces = [located.side for located in part.sides]
                bodies.append(Framed(problem, scene, mesh, part.spec, faces, memory))
                continue
            met = dict.fromkeys(contact.name for contact, _ in part.touching)
            ours = Sides(name, [drawn[contact][0] for contact in met])
            rows = [(kept.key("pair", contact.name), side) for contact, side in part.touching]
            depends = kept.key("stiffness", name), rows
            B = kept.get("candidates", name, depends, partial(ours.rows, problem))
            kind = scene.method.compliance
            bodies.append(Factored(name, problem, B, kind, memory, histories, points, solves))
    return bodies


def _memory(share: Share, team: Team | None) -> float:
    """The memory (bytes) that each body of this rank may take. Collective."""
    # the bodies of all ranks on a machine share its memory evenly; a team has the memory of all its machines
    world, kept = share.exchange.world, share.kept
    if team:
        with agreed(world):
            return kept.memory(lambda: team.do("room"))
    return kept.memory(free_memory) / (ranks_beside(world) * max(len(share.parts), 1))


def _couple(
    scene: Settled,
    exchange: Exchange,
    bodies: Sequence[Factored],
    met: Mapping[str, Interface],
    frames: Mapping[str, Frame],
    free: Mapping[str, FreeFrame],
) -> Joint:
    """The operator of all bodies on the interfaces where they have `met`; `bodies` are those of this rank. Collective."""
    ours: dict[str, list[Interface]] = {body.name: [] for body in bodies}
    for interface in met.values():
        for name in ours.keys() & set(interface.bodies):
            ours[name].append(interface)
    members = [Member(body, ours[body.name], frames.get(body.name)) for body in bodies]
    # from here on each interface is on its first body's rank only
    owned = [met[name] for name, first, _ in exchange.ends if first == exchange.world.rank]
    space = Space(owned, exchange.world, exchange.sent)
    exchange.connect(space, [member.parts for member in members])
    driven = [Driven.of(rigid, space) for rigid in scene.pushed]
    driven += map(Driven.of_bond, scene.bolts)
    driven += [
        Driven.of_frame(rigid.name, free[rigid.name], frames[rigid.name])
        for rigid in scene.rigid
        if rigid.name in free
    ]
    return Joint(members, exchange, space, [None, *scene.followed], driven, scene.far)


def _reused(kept: Kept) -> dict[str, list[str]]:
    """The stages that this case has reused, in words, by body or contact."""
    return {
        name: [word for stage, words in REUSED.items() if stage in stages for word in words]
        for name, stages in kept.found.items()
    }


def _doubts(share: Share, drawn: Mapping[str, Drawn]) -> list[str]:
    """All warnings about a scene, those of bodies first; one line for each kind. Collective."""
    scene, world = share.scene, share.exchange.world
    by_body = {
        part.spec.name: part.problem.warnings for part in share.parts if part.problem.warnings
    }
    by_contact = {name: warnings for name, (_, warnings) in drawn.items() if warnings}
    of_bodies, of_contacts = gathered(world, by_body), gathered(world, by_contact)
    told = [warning for body in scene.body for warning in of_bodies.get(body.name, ())]
    told += _idle(scene)
    told += (doubt for contact in scene.contact for doubt in of_contacts.get(contact.name, ()))
    return condensed(told)


def _idle(scene: Settled) -> list[str]:
    """Warnings of what nothing touches or follows."""
    named = {name for contact in scene.contact for name in contact.bodies}
    idle = []
    if named or len(scene.body) > 1:
        idle += [
            f"body.{body.name}: no contact names it; it is solved alone"
            for body in scene.body
            if body.name not in named
        ]
    idle += [
        f"rigid.{rigid.name}: no contact names it; nothing touches it"
        for rigid in scene.rigid
        if rigid.name not in named
    ]
    idle += [
        f"history.{name}: nothing follows it"
        for name in scene.history
        if name not in scene.followed
    ]
    idle += _unreached(scene)
    needed = scene.far and len(scene.legs) == 1  # bodies that move far are in load steps
    if scene.time is not None and not scene.followed and not needed:
        idle.append("time: nothing follows a history; the loads are the same in all load steps")
    return idle


def _unreached(scene: Settled) -> Iterator[str]:
    """Warnings of histories that the load steps cut off, or in which they meet nothing but zeros."""
    if scene.time is None:
        return
    end = scene.time.points[-1]
    for name in scene.followed:
        history = scene.history[name]
        most, last = max(map(abs, history.factors)), history.at(end)
        later = [
            factor - last if time > end else 0.0
            for time, factor in zip(history.times, history.factors, strict=True)
        ]
        k = int(np.argmax(np.abs(later)))
        if abs(later[k]) > ALIKE * most:
            yield Doubt(
                f"history.{name}: the load steps end at time {end:g} with its factor {last:g}; they do not reach its "
                f"factor {history.factors[k]:g} at time {history.times[k]:g}",
                "history that goes on",
                abs(later[k]) / most,
            )
        elif not any(map(history.at, scene.legs)):
            keys = (key for key, table in tables(scene) if getattr(table, "history", None) == name)
            yield Doubt(
                f"history.{name}: its factor is 0 at the ends of all legs, and with it {', '.join(keys)}",
                "history of zeros",
            )


def _join(
    scene: Settled,
    contact: SettledContact,
    sides: BothLocated,
    specs: Sequence[SettledBody],
    factors: Mapping[float, Mapping[str | None, float]],
    refinement: int,
    kept: Kept,
) -> Drawn:
    """The interface of two sides, or of one and a rigid partner, of the bodies `specs`, and warnings. `factors` are by
    the turning points of loads, and by history. Raises InputError."""
    (one, other), clamps = sides, {body.name: [*body.clamps, ON_AXIS] for body in specs}
    unit, (first, second) = scene.units["length"], _there(sides)
    second = second and _seen(second, contact)
    if other is None or second is None:
        rigid = next(rigid for rigid in scene.rigid if rigid.name == contact.bodies[1])
        depends, partner = (first, rigid, _bare(contact)), Mover(rigid)
        interface = kept.get("pair", contact.name, depends, partial(face_rigid, *depends))
    else:
        if any(body.mesh.drawn for body in specs):
            refinement = 1  # its nodes match by their number alone
        interface = _connected(contact, one, other, refinement, kept)
        partner = Mover(second, clamps[second.body])
    law = law_of(
        contact.friction,
        interface.xy,
        interface.geometry.arc,
        interface.area,
        interface.law.sliding,
        contact.kind,
        interface.law.live,
        contact.name,
    )
    interface = replace(interface, law=law, layer=contact.layer, rub_history=contact.rubbing[1])
    overlaps = check_overlap(
        interface,
        *(side for side in (first, second) if side),
        scales=[now[interface.gap_history] for now in factors.values()],
        unit=unit,
    )
    refuse_contradiction(interface, [Mover(first, clamps[first.body]), partner], factors, unit)
    warnings = [*_of_pairing(interface, contact), *_partly(interface, contact, first, second)]
    warnings += overlaps
    return _imaged(interface, contact, unit), warnings + uncovered_profile(interface, contact)


def _of_pairing(interface: Interface, contact: SettledContact) -> list[str]:
    """Warnings of a slave that is none, and of bodies that have no area in common. Raises InputError where laws of
    stresses meet such bodies."""
    warnings = []
    if contact.slave is not None and not interface.slave:
        warnings.append(
            f'contact.{contact.name}.slave: no side is a slave, because nodes match and are paired; pairing = "mortar" '
            "makes one of them the slave"
        )
    if interface.geometry.pointwise:
        _refuse_stresses(interface)
        others = f" and {interface.m - 1} nodes more" * (interface.m > 1)
        warnings.append(
            f"contact.{contact.name}: the bodies meet along an edge or at a vertex only, at "
            f"{in_words(interface.xy[0])}{others}: there are forces, but no area and no stresses; "
            "stresses in the bodies grow without limit there as meshes get finer"
        )
    return warnings


def _partly(interface: Interface, contact: SettledContact, *sides: Side | None) -> Iterator[str]:
    """A warning of a bond that leaves some of both sides free, unless other contacts are on them."""
    facing = [side for side in sides if side]
    if contact.kind != "bonded" or interface.geometry.pointwise or len(facing) < 2:
        return
    smaller = min(facing, key=lambda side: side.areas.sum())
    part = interface.geometry.covered / smaller.areas.sum()
    if part < 1.0 - UNCOVERED and not smaller.parted:
        elsewhere = ", or its image stands elsewhere" * bool(contact.image)
        yield Doubt(
            f"contact.{interface.name}: the bond covers {part:.3g} of the smaller side, and both sides go on beyond it, "
            f"where they are free{elsewhere}",
            "bond of a part",
            1.0 - part,
        )


def _refuse_stresses(interface: Interface) -> None:
    """InputError where laws of stresses meet sides that have no area in common."""
    at = f"the bodies meet along an edge or at a vertex only, at {in_words(interface.xy[0])}, where"
    if interface.law.name == "tresca":
        raise InputError(
            f"contact.{interface.name}.friction: {at} a slip bound, a stress, has no area to act on; law = "
            '"coulomb" needs none'
        )
    if interface.layer:
        raise InputError(f"contact.{interface.name}.softness: {at} a joint has no area to be soft")


def _there(sides: BothLocated) -> BothSides:
    """The sides of a contact where its bodies are. Not collective."""
    first, second = sides
    return first.there, second.there if second else None


def _bare(contact: SettledContact) -> SettledContact:
    """What rows depend on: of friction the law, and not where its numbers are those of a place; of softness nothing."""
    laws: dict[type, Friction] = {Coulomb: Coulomb(coefficient=0.0), Tresca: Tresca(slip_bound=0.0)}
    friction = laws.get(type(contact.friction), contact.friction)
    return msgspec.structs.replace(contact, friction=friction, softness=None)


def _connected(
    contact: SettledContact, one: Located, other: Located, refinement: int, kept: Kept
) -> Interface:
    """The interface of two bodies, which pairs of alike bodies that are alike to each other have in common: without
    names, and as far from the origin as the first body's home. Not collective. Raises InputError."""
    slave = dict(zip(contact.roles, PAIR, strict=True)).get(contact.slave or "")
    bodies = ("", "") if contact.itself else PAIR
    alike = _bare(msgspec.structs.replace(contact, name="", bodies=bodies, slave=slave))
    # a gap that varies is that of the place, and so is an image
    anywhere = contact.opening[0] is None or isinstance(contact.opening[0], float)
    anywhere &= not contact.image
    start = one.shift if anywhere else np.zeros_like(one.shift)
    shifts = [located.shift - start for located in (one, other)]

    def make() -> Interface:
        first, second = map(Side.shifted, (one.side, other.side), shifts, PAIR)
        return connect(first, _seen(second, contact), alike, refinement)

    depends = (one.key, other.key, shifts, refinement, alike)
    try:
        found = kept.get("pair", contact.name, depends, make)
    except InputError:
        _connect_there(contact, one.there, other.there, refinement)  # which says where
        raise
    slave = dict(zip(PAIR, contact.roles, strict=True)).get(found.slave or "")

    def place() -> Interface:
        called = replace(found, name=contact.name, bodies=contact.bodies, slave=slave)
        return placed(called, Frame.of(start))

    where = kept.key("pair", contact.name), contact.bodies, start
    return kept.get("rows", contact.name, where, place)


def _seen(second: Side, contact: SettledContact) -> Side:
    """The second side of a contact where its first one faces it: an image where that is."""
    return second.placed(contact.image.frame(1.0, second.dimension)) if contact.image else second


def _imaged(interface: Interface, contact: SettledContact, unit: str) -> Interface:
    """The interface of sides of which the second is an image, if it is one. Raises InputError where a bond would bridge
    the distance of an image that stands elsewhere."""
    if not contact.image:
        return interface
    frame = contact.image.frame(1.0, interface.dimension)
    one, other = interface.geometry.at
    ways = [np.linalg.norm(other - place, axis=1).mean() for place in (one, frame.undone.at(other))]
    flat = np.ptp(interface.normal, axis=0).max(initial=0.0) <= FLAT
    if contact.two_sided and ways[0] > (ASIDE_FLAT if flat else ASIDE) * ways[1]:
        raise _misplaced(
            contact, f"both sides are {ways[0]:.3g} {unit} apart, and a bond holds sides that meet"
        )
    return interface.imaged(frame)


def _connect_there(
    contact: SettledContact, first: Side, second: Side, refinement: int
) -> Interface:
    """The interface of two sides where they are. Raises InputError, which names an image."""
    try:
        return connect(first, _seen(second, contact), contact, refinement)
    except InputError as error:
        if not contact.image:
            raise
        raise _misplaced(contact, str(error).removeprefix(f"contact.{contact.name}: ")) from None


def _misplaced(contact: SettledContact, why: str) -> InputError:
    """What is wrong with sides of which the second is an image."""
    assert contact.image
    seen = f"{contact.bodies[1]}.{contact.on[1]}, {contact.image.words}"
    advice = ". A turn the other way is negative" * bool(contact.image.turn)
    return InputError(f"contact.{contact.name}.image: with {seen}, {why}{advice}")


def _check_method(share: Share, interfaces: Sequence[Interface]) -> None:
    """InputError where a method of two bodies cannot solve the scene."""
    method = share.scene.method
    if not method.by_body:
        return
    for part in share.parts:
        if not part.problem.supported:
            raise InputError(
                f"method.outer = {method.outer!r}: the clamps of {part.spec.name!r} leave a rigid motion "
                'free, so that its Neumann problems have no solution; outer = "newton", the default, '
                "solves it"
            )
    if any(interface.one_sided.any() for interface in interfaces):
        raise InputError(
            f"method.outer = {method.outer!r}: at some contact nodes a clamp constrains one "
            "body only, which this iteration does not support; the default method does"
        )
