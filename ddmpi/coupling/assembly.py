"""From a scene to the discrete problem on one rank: meshes, matrices, interfaces, and the joint operator."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import msgspec
import numpy as np
from mpi4py import MPI

from ddmpi.body.elasticity import Elasticity, assemble
from ddmpi.body.loads import ON_AXIS
from ddmpi.body.rigid_motions import FreeFrame
from ddmpi.body.stress import Composite, material_of, modulus_beside
from ddmpi.coupling.exchange import Ends, Exchange
from ddmpi.coupling.joint import Far, FarMember, Joint
from ddmpi.coupling.member import Member
from ddmpi.coupling.ranks import homes_of, ranks_beside, team_of
from ddmpi.coupling.space import Space, kept_by_bonds
from ddmpi.coupling.team import TeamMatrix
from ddmpi.errors import InputError, naming
from ddmpi.interface.contradictions import Mover, refuse_contradiction
from ddmpi.interface.interface import Interface, check_overlap
from ddmpi.interface.law import law_of
from ddmpi.interface.matching import face_rigid
from ddmpi.interface.mortar import connect, with_slave
from ddmpi.interface.rows import holds_along, uncovered_profile
from ddmpi.kept.kept import Kept
from ddmpi.mesh.build import build_mesh, content
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import Sizes
from ddmpi.petsc.options import conditions
from ddmpi.scene.bodies import Material, SettledBody
from ddmpi.scene.contacts import NoFriction, SettledContact
from ddmpi.scene.motions import frames_of, freed_part
from ddmpi.scene.scene import Settled
from ddmpi.surface.boundary import contact_side
from ddmpi.surface.seams import find_seam
from ddmpi.surface.side import Side
from ddmpi.system import interrupt
from ddmpi.system.agreement import agreed, gathered, merged
from ddmpi.system.clock import Clock
from ddmpi.system.doubts import condensed
from ddmpi.system.memory import free_memory
from ddmpi.system.numbers import Frame, in_words

NO_SIZES: Mapping[str, Sizes] = {}

REUSED = {
    "mesh": ["mesh"],
    "stiffness": ["stiffness"],
    "compliance": ["factors", "compliance"],
    "rows": ["rows"],
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
    """One rank's part of a scene, discretised and factored.

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
    start : makes the forces (size,) in N, gaps (size,) and motions of loose bodies in m to begin with, or is None
    outer : the class of an outer method from outside the package, or None
    far, frames : if bodies move far, what they keep, and the frames of all bodies and rigid partners, by name
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
    reused: dict[str, list[str]] = field(default_factory=dict)
    start: Callable[[], tuple[np.ndarray, np.ndarray, np.ndarray]] | None = None
    outer: Callable[..., object] | None = None
    far: Far | None = None
    frames: Mapping[str, Frame] = field(default_factory=dict)

    def meet(self, time: float) -> Assembly:
        """The same bodies where they are at `time`, paired there, under the loads of that time. Collective. Raises
        InputError."""
        far, scene, world = self.far, self.scene, self.world
        assert far
        frames = far.frames(scene, time)
        members, space = far.meet(world, scene, self.exchange, frames, far.reach.get(time, {}))
        bodies = tuple(
            replace(body, member=member) for body, member in zip(self.bodies, members, strict=True)
        )
        placed = replace(
            self,
            bodies=bodies,
            space=space,
            frames=frames,
            joint=Joint(
                members,
                self.exchange,
                space,
                [None, *scene.followed],
                freed=far.driven(scene, frames),
            ),
        )
        placed.act(time)
        return placed

    def in_world(self) -> Assembly:
        """The same with the meshes of bodies that move far where these are now. Not collective."""
        return (
            self
            if not self.far
            else replace(
                self,
                bodies=tuple(
                    replace(
                        body,
                        mesh=replace(
                            body.mesh, points=self.frames[body.spec.name].at(body.mesh.points)
                        ),
                    )
                    for body in self.bodies
                ),
            )
        )

    def along(self, displacements: Mapping[str, np.ndarray]) -> Mapping[str, np.ndarray]:
        """Displacements in the frames of this rank's bodies (nv, d), along the axes of the world. Not collective."""
        return (
            displacements
            if not self.far
            else {name: self.frames[name].along(u) for name, u in displacements.items()}
        )

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

    Parameters
    ----------
    world : at most as many ranks as the scene has bodies
    folder : where relative mesh files are looked for first
    clock : times the phases mesh, assemble and factor
    refinement : the meshes of `scene`, but for geometries, are this many times finer than the given ones
    sizes : of the elements of geometries, by the names of this rank's bodies, once an accuracy target refines them
    factor : False for an assembly that is only checked, see `Member`
    kept : stages of earlier cases, which this case reuses where it does not change them
    """
    clock, team = clock or Clock(), team_of(world)
    if team and not kept:
        with agreed(world):
            team.do("drop")  # matrices of the last mesh
    kept = kept or Kept()
    kept.begin(conditions())
    homes = homes_of([body.name for body in scene.body], world)
    mine = [body for body in scene.body if homes[body.name] == world.rank]
    at_body: dict[str, list[tuple[SettledContact, int]]] = {body.name: [] for body in mine}
    for contact in scene.contact:
        for side, name in enumerate(contact.bodies):
            if name in at_body:
                at_body[name].append((contact, side))
    contacts = [
        contact for contact in scene.contact if not at_body.keys().isdisjoint(contact.bodies)
    ]
    exchange = Exchange(
        world,
        [
            Ends(
                contact.name,
                homes[contact.bodies[0]],
                homes.get(contact.bodies[1], homes[contact.bodies[0]]),
            )
            for contact in contacts
        ],
    )
    meshes: dict[str, Mesh] = {}
    bodies: dict[str, Elasticity] = {}
    sides: dict[tuple[str, int], Side] = {}
    with clock.phase("mesh"), agreed(world):
        for spec in mine:
            touching = at_body[spec.name]
            meshes[spec.name] = _mesh(
                scene,
                spec,
                folder,
                [contact.on[side] for contact, side in touching],
                sizes.get(spec.name),
                kept,
            )
            for contact, side in touching:
                with naming(f"contact.{contact.name}.on"):
                    meshes[spec.name].facets(contact.on[side])
            interrupt.check()
    with clock.phase("assemble"):
        with agreed(world):
            for spec in mine:
                mesh = meshes[spec.name]
                elasticity = _assemble(mesh, spec, at_body[spec.name], kept)
                bodies[spec.name] = elasticity
                touching = at_body[spec.name]
                for contact, side in touching:
                    others = [(other, which) for other, which in touching if other is not contact]
                    depends = (
                        spec.name,
                        kept.key("supports", spec.name),
                        spec.material,
                        contact.on[side],
                        [(other.on[which], holds_along(other)) for other, which in others],
                    )
                    sides[contact.name, side] = kept.get(
                        "side",
                        f"{contact.name}.{side}",
                        depends,
                        partial(_side, mesh, elasticity, spec, contact.on[side], others),
                    )
                interrupt.check()
        # Sides are small. The ranks of both bodies get both of them and compute the same interface, bit for bit.
        both = exchange.swap_objects(sides)
        with agreed(world):
            # Gaps and clamps are linear between turning points, so the worst overlap is at one of them, or at time 0.
            times = (
                scene.legs if scene.time is None or scene.time.steps == 1 else [0.0, *scene.legs]
            )
            specs, factors = (
                {body.name: body for body in scene.body},
                {time: scene.factors(time) for time in times},
            )
            joined = (
                {
                    contact.name: _join(
                        scene,
                        contact,
                        both[contact.name],
                        [specs[name] for name in contact.bodies if name in specs],
                        factors,
                        refinement,
                        kept,
                    )
                    for contact in contacts
                }
                if not scene.far
                else {}
            )
            _check_method(scene, bodies, [interface for interface, _ in joined.values()])
        joined = kept_by_bonds(scene, joined, world)
        interfaces = [interface for interface, _ in joined.values()]
    # the bodies of all ranks on a machine share its memory evenly; a team has the memory of all its machines
    memory = (
        kept.memory(free_memory) / (ranks_beside(world) * max(len(mine), 1)) if not team else 0.0
    )
    if team:
        with agreed(world):
            memory = kept.memory(lambda: team.do("room"))
    members, histories = list[Member](), [None, *scene.followed]
    # time.tolerance takes 1 and 2 load steps at least; iterations of the published method take ten times the products
    solves = (len(scene.legs) * (scene.time.steps or 3) if scene.time else 1) * (
        10 if scene.method.by_body else 1
    )
    with clock.phase("factor"), agreed(world):
        for spec in mine:
            elasticity = bodies[spec.name]
            points = meshes[spec.name].points[elasticity.nodes]
            if factor and team and team.comm.size > 1:
                elasticity = replace(
                    elasticity,
                    A=kept.get(
                        "matrix",
                        spec.name,
                        kept.key("stiffness", spec.name),
                        partial(
                            TeamMatrix,
                            team,
                            elasticity,
                            points,
                            partial(assemble, meshes[spec.name], spec),
                        ),
                    ),
                )
            if scene.far:
                faces = [sides[contact.name, side] for contact, side in at_body[spec.name]]
                members.append(
                    FarMember(elasticity, scene, meshes[spec.name], spec, faces, memory, points)
                )
                continue
            ours = [joined[contact.name][0] for contact, _ in at_body[spec.name]]
            members.append(
                Member(
                    spec.name,
                    elasticity,
                    ours,
                    scene.method.compliance,
                    memory,
                    histories,
                    points,
                    solves,
                )
            )
        # factors are most of the memory: those that are not used again are freed before others are made
        kept.expect("compliance", {member.name: member.depends(kept) for member in members})
        for member in members if factor else ():
            member.factor(kept)
            interrupt.check()
    kept.end()
    # from here on each interface is on its first body's rank only
    owned = {contact for contact, first, _ in exchange.ends if first == world.rank}
    far, frames = None, dict[str, Frame]()
    if scene.far:
        with agreed(world):
            chosen = [
                with_slave(first, second, contact) if second else contact
                for contact in contacts
                for first, second in [both[contact.name]]
            ]
        movers = [member for member in members if isinstance(member, FarMember)]
        free = merged(world, {member.name: member.free for member in movers if member.free})
        facing = world.allgather(
            {
                contact.bodies[1]: first.xy
                for contact in contacts
                for first, second in [both[contact.name]]
                if not second
            }
        )
        free |= {
            rigid.name: FreeFrame.of(
                freed, np.concatenate([at[rigid.name] for at in facing if rigid.name in at])
            )
            for rigid in scene.rigid
            if (freed := freed_part(rigid.motion))
        }
        far, frames = Far(chosen, both, movers, free), frames_of(scene, 0.0)
        met, space = far.meet(world, scene, exchange, frames, {})
        members = list(met)
    else:
        space = Space(
            [interface for interface in interfaces if interface.name in owned], world, exchange.sent
        )
        exchange.connect(space, [member.parts for member in members])
    told = _doubts(
        scene,
        gathered(world, {name: body.warnings for name, body in bodies.items() if body.warnings}),
        gathered(world, {name: warnings for name, (_, warnings) in joined.items() if warnings}),
    )
    numbers = [body.name for body in scene.body]
    return Assembly(
        world,
        scene,
        tuple(
            Body(numbers.index(spec.name), spec, meshes[spec.name], member)
            for spec, member in zip(mine, members, strict=True)
        ),
        space,
        exchange,
        Joint(
            members,
            exchange,
            space,
            histories,
            scene.pushed,
            scene.bolts,
            far.driven(scene, frames) if far else None,
        ),
        world.allreduce(sum(body.n for body in bodies.values())),
        world.allreduce(sum(interface.m for interface in space.interfaces)),
        told,
        {
            name: [word for stage, words in REUSED.items() if stage in stages for word in words]
            for name, stages in kept.found.items()
        },
        far=far,
        frames=frames,
    )


def _mesh(
    scene: Settled,
    spec: SettledBody,
    folder: Path,
    contacts: Sequence[str],
    sizes: Sizes | None,
    kept: Kept,
) -> Mesh:
    """The mesh of a body, which depends on what the scene says of it and on the content of its file, and resolves the
    groups on which something acts. Not collective. Raises InputError."""
    file = content(spec, folder)
    depends = (
        spec.mesh,
        kept.key("file", spec.name) if file is None else file,
        contacts,
        sizes,
        scene.dimension,
        scene.axisymmetric,
        [(name, acting.on) for name, acting in spec.acting],
    )
    return kept.get(
        "mesh",
        spec.name,
        depends,
        lambda: build_mesh(spec, folder, contacts, sizes, scene.dimension, scene.axisymmetric),
    )


def _assemble(
    mesh: Mesh, spec: SettledBody, touching: Sequence[tuple[SettledContact, int]], kept: Kept
) -> Elasticity:
    """The discrete problem of a body, which warns of a mesh, of a file or a drawing, whose cells are not connected as
    they look. `touching` are its contacts. Not collective. Raises InputError."""
    seam = None
    if not spec.mesh.shape:
        groups = {contact.on[side] for contact, side in touching}
        groups |= {acting.on for name, acting in spec.acting if name != "clamp"}
        depends = kept.key("mesh", spec.name), sorted(groups)
        seam = kept.get("seam", spec.name, depends, lambda: find_seam(mesh, groups, spec.name))
    warnings = [seam.words(spec.name)] if seam else []
    try:
        elasticity = assemble(mesh, spec, kept)
    except InputError as error:  # a piece may be loose because of the seam
        raise InputError("; ".join([str(error), *warnings])) from None
    return replace(elasticity, warnings=[*warnings, *elasticity.warnings])


def _doubts(
    scene: Settled, by_body: Mapping[str, list[str]], by_contact: Mapping[str, list[str]]
) -> list[str]:
    """All warnings about a scene, in its order, from those by body and by contact; one line for each kind."""
    named = {name for contact in scene.contact for name in contact.bodies}
    return condensed(
        [
            *(warning for body in scene.body for warning in by_body.get(body.name, ())),
            *(
                f"body.{body.name}: no contact names it; it is solved alone"
                for body in scene.body
                if body.name not in named and (named or len(scene.body) > 1)
            ),
            *(
                f"rigid.{rigid.name}: no contact names it; nothing touches it"
                for rigid in scene.rigid
                if rigid.name not in named
            ),
            *(
                f"history.{name}: nothing follows it"
                for name in scene.history
                if name not in scene.followed
            ),
            *(
                "time: nothing follows a history; the loads are the same in all load steps"
                for _ in [scene.time]
                if scene.time is not None and not scene.followed
            ),
            *(warning for contact in scene.contact for warning in by_contact.get(contact.name, ())),
        ]
    )


def _side(
    mesh: Mesh,
    elasticity: Elasticity,
    spec: SettledBody,
    group: str,
    others: Sequence[tuple[SettledContact, int]],
) -> Side:
    """The side of a body on a contact at `group`; it has the `others`, too. Not collective. Raises InputError."""
    boundary, supports = mesh.facets(group), elasticity.supports
    modulus = modulus_beside(mesh, material_of(mesh, spec), boundary)
    return contact_side(
        mesh,
        boundary,
        supports,
        spec.name,
        modulus,
        _tied(mesh, others, supports.free, group),
        any(group == other.on[which] for other, which in others),
    )


def _tied(
    mesh: Mesh, others: Sequence[tuple[SettledContact, int]], free: np.ndarray, group: str
) -> np.ndarray:
    """Nodes (nv,) bool of a body that are clamped in all components or lie on one of its `others` contacts, given with
    the side, that carries tangential forces; in space only if that has another `group`."""
    tied = ~free.any(axis=(1, 2))
    for contact, side in others:
        if holds_along(contact) and (free.shape[1] == 2 or contact.on[side] != group):
            tied[mesh.facets(contact.on[side]).nodes] = True
    return tied


def _join(
    scene: Settled,
    contact: SettledContact,
    sides: tuple[Side, Side | None],
    specs: Sequence[SettledBody],
    factors: Mapping[float, Mapping[str | None, float]],
    refinement: int,
    kept: Kept,
) -> tuple[Interface, list[str]]:
    """The interface of two sides, or of one and a rigid partner, of the bodies `specs`, and warnings. `factors` are by
    the turning points of loads, and by history. Raises InputError."""
    (first, second), clamps = sides, {body.name: [*body.clamps, ON_AXIS] for body in specs}
    unit = scene.units["length"]
    if second is None:
        (rigid,) = (rigid for rigid in scene.rigid if rigid.name == contact.bodies[1])
        depends: tuple = (rigid,)
        make, partner = partial(face_rigid, first, rigid, contact), Mover(rigid)
    else:
        if any(body.mesh.drawn for body in specs):
            refinement = 1  # its nodes match by their number alone
        depends, make = (second, refinement), partial(connect, first, second, contact, refinement)
        partner = Mover(second, clamps[second.body])
    # rows depend on friction only by whether there is any
    drawn = (
        msgspec.structs.replace(contact, friction=NoFriction()),
        isinstance(contact.friction, NoFriction),
    )
    interface = kept.get("rows", contact.name, (first, depends, drawn), make)
    law = law_of(
        contact.friction,
        interface.xy,
        interface.geometry.arc,
        interface.area,
        interface.law.sliding,
        contact.kind,
        interface.law.live,
    )
    interface = replace(interface, law=law)
    overlaps = check_overlap(
        interface,
        *(side for side in (first, second) if side),
        scales=[now[interface.gap_history] for now in factors.values()],
        unit=unit,
    )
    refuse_contradiction(interface, [Mover(first, clamps[first.body]), partner], factors, unit)
    idle = (
        []
        if contact.slave is None or interface.slave
        else [
            f'contact.{contact.name}.slave: no side is a slave, because nodes match and are paired; pairing = "mortar" '
            "makes one of them the slave"
        ]
    )
    if interface.geometry.pointwise and interface.law.name == "tresca":
        raise InputError(
            f"contact.{contact.name}.friction: the bodies meet along an edge or at a vertex only, at "
            f"{in_words(interface.xy[0])}, where a slip bound, a stress, has no area to act on; law = "
            '"coulomb" needs none'
        )
    bare = (
        []
        if not interface.geometry.pointwise
        else [
            f"contact.{contact.name}: the bodies meet along an edge or at a vertex only, at {in_words(interface.xy[0])}"
            f"{f' and {interface.m - 1} nodes more' * (interface.m > 1)}: there are forces, but no area and no stresses; "
            "stresses in the bodies grow without limit there as meshes get finer"
        ]
    )
    return interface, idle + bare + overlaps + uncovered_profile(interface, contact)


def _check_method(
    scene: Settled, bodies: Mapping[str, Elasticity], interfaces: Sequence[Interface]
) -> None:
    """InputError where a method of two bodies cannot solve the scene."""
    if not scene.method.by_body:
        return
    for name, elasticity in bodies.items():
        if not elasticity.supported:
            raise InputError(
                f"method.outer = {scene.method.outer!r}: the clamps of {name!r} leave a rigid motion "
                'free, so that its Neumann problems have no solution; outer = "newton", the default, '
                "solves it"
            )
    if any(interface.one_sided.any() for interface in interfaces):
        raise InputError(
            f"method.outer = {scene.method.outer!r}: at some contact nodes a clamp constrains one "
            "body only, which this iteration does not support; the default method does"
        )
