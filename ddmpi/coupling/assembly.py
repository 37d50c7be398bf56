"""From a scene to what one rank solves: mesh, matrices, interfaces, and its body among the others."""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI
from scipy.sparse import csgraph

from ddmpi.body.elasticity import Elasticity, assemble
from ddmpi.body.loads import ON_AXIS
from ddmpi.body.stress import Composite, material_of, modulus_beside
from ddmpi.coupling.exchange import Ends, Exchange
from ddmpi.coupling.joint import Joint
from ddmpi.coupling.member import Member
from ddmpi.coupling.ranks import homes_of, ranks_beside, team_of
from ddmpi.coupling.space import Space
from ddmpi.coupling.team import TeamMatrix
from ddmpi.errors import InputError, naming
from ddmpi.interface.interface import Interface, Mover, check_overlap, refuse_contradiction
from ddmpi.interface.matching import face_rigid
from ddmpi.interface.mortar import connect
from ddmpi.interface.rows import holds_along, uncovered_profile
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.refine import Sizes
from ddmpi.scene.bodies import Material, SettledBody
from ddmpi.scene.contacts import SettledContact
from ddmpi.scene.scene import Settled
from ddmpi.surface.boundary import contact_side
from ddmpi.surface.side import Side
from ddmpi.system import interrupt
from ddmpi.system.agreement import agreed, gathered
from ddmpi.system.clock import Clock
from ddmpi.system.memory import free_memory
from ddmpi.system.numbers import in_words

NO_SIZES: Mapping[str, Sizes] = {}


@dataclass(frozen=True)
class Body:
    """One body on its rank: its number in the order of the scene, what was asked for, its mesh, and its contacts."""

    number: int
    spec: SettledBody
    mesh: Mesh
    member: Member

    @property
    def material(self) -> Material | Composite:
        """Its material, or those of its triangles."""
        return material_of(self.mesh, self.spec)


@dataclass(frozen=True)
class Assembly:
    """A scene, discretised and factored, as one rank holds it.

    Attributes
    ----------
    world : communicator of all ranks that hold bodies
    scene : what was asked for
    bodies : of this rank, in the order of the scene
    space : the layout of the vectors of the interfaces that this rank owns
    exchange : between the bodies
    joint : the operator of all bodies together
    n : free dofs of all bodies
    m : contact nodes of all interfaces
    warnings : what a sensible person would ask about the scene; of all bodies and contacts on the first rank
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

    def act(self, time: float) -> None:
        """Let loads, clamps and rigid partners act as their histories have them at `time`. Not collective."""
        factors = self.scene.factors(time)
        self.space.act(factors)
        for body in self.bodies:
            body.member.act(factors)
        self.joint.act(factors)

    @property
    def member(self) -> Member:
        """The only body of this rank, for methods that know but two bodies."""
        (body,) = self.bodies
        return body.member

    @property
    def pushes(self) -> dict[str, float]:
        """Sum of the components (N) of the force on each pushed partner, the largest at the ends of all legs."""
        factors = [self.scene.factors(time) for time in self.scene.legs]
        return {rigid.name: float(np.abs(rigid.force or 0.0).sum()) * max(abs(each[rigid.history]) for each in factors)
                for rigid in self.joint.pushed}

    @property
    def loose(self) -> list[str]:
        """Names of the bodies that clamps do not hold, and of the rigid partners that are pushed."""
        return [name for name, motions in self.joint.slices.items() if motions.stop > motions.start]


def prepare(world: MPI.Comm, scene: Settled, folder: Path = Path("."), clock: Clock | None = None,
            refinement: int = 1, sizes: Mapping[str, Sizes] = NO_SIZES, factor: bool = True) -> Assembly:
    """Mesh, assemble, pair and factor. Collective. Raises InputError, SolverError and InterruptionError, on all ranks.

    Parameters
    ----------
    world : at most as many ranks as the scene has bodies
    folder : where relative mesh files are looked for first
    clock : times the phases mesh, assemble and factor
    refinement : how many times finer the meshes of `scene` are than the given ones, but for geometries
    sizes : of the elements of geometries, by the names of the own bodies, where an accuracy target has led to them
    factor : False for an assembly that is only looked at, see `Member`
    """
    clock = clock or Clock()
    team = team_of(world)
    if team:
        with agreed(world):
            team.do("drop")  # what is left of other meshes
    homes = homes_of([body.name for body in scene.body], world)
    mine = [body for body in scene.body if homes[body.name] == world.rank]
    at_body: dict[str, list[tuple[SettledContact, int]]] = {body.name: [] for body in mine}
    for contact in scene.contact:
        for side, name in enumerate(contact.bodies):
            if name in at_body:
                at_body[name].append((contact, side))
    contacts = [contact for contact in scene.contact if not at_body.keys().isdisjoint(contact.bodies)]
    exchange = Exchange(world, [Ends(contact.name, homes[contact.bodies[0]],
                                     homes.get(contact.bodies[1], homes[contact.bodies[0]])) for contact in contacts])
    meshes: dict[str, Mesh] = {}
    bodies: dict[str, Elasticity] = {}
    sides: dict[tuple[str, int], Side] = {}
    with clock.phase("mesh"), agreed(world):
        for spec in mine:
            own = at_body[spec.name]
            meshes[spec.name] = build_mesh(spec, folder, [contact.on[side] for contact, side in own],
                                           sizes.get(spec.name), scene.dimension, scene.axisymmetric)
            for contact, side in own:
                with naming(f"contact.{contact.name}.on"):
                    meshes[spec.name].facets(contact.on[side])
            interrupt.check()
    with clock.phase("assemble"):
        with agreed(world):
            for spec in mine:
                mesh = meshes[spec.name]
                elasticity = assemble(mesh, spec)
                material = material_of(mesh, spec)
                bodies[spec.name] = elasticity
                own = at_body[spec.name]
                for contact, side in own:
                    others = [(each, which) for each, which in own if each is not contact]
                    boundary = mesh.facets(contact.on[side])
                    sides[contact.name, side] = contact_side(
                        mesh, boundary, elasticity.supports, spec.name, modulus_beside(mesh, material, boundary),
                        _tied(mesh, others, elasticity.supports.free, contact.on[side]),
                        any(contact.on[side] == other.on[which] for other, which in others))
                interrupt.check()
        both = exchange.swap_objects(sides)
        with agreed(world):
            times = scene.legs if scene.time is None or scene.time.steps == 1 else [0.0, *scene.legs]
            specs, factors = {body.name: body for body in scene.body}, {time: scene.factors(time) for time in times}
            found = {contact.name: _join(scene, contact, both[contact.name],
                                         [specs[name] for name in contact.bodies if name in specs], factors, refinement)
                     for contact in contacts}
            _check_method(scene, bodies, [interface for interface, _ in found.values()])
        found = _kept_by_bonds(scene, found, world)
        interfaces = [interface for interface, _ in found.values()]
    memory = free_memory() / (ranks_beside(world) * max(len(mine), 1))
    if team:
        with agreed(world):
            memory = team.do("room")
    members, histories = [], [None, *scene.followed]
    with clock.phase("factor"), agreed(world):
        for spec in mine:
            points = meshes[spec.name].points[bodies[spec.name].nodes]
            if factor and team and team.comm.size > 1:
                A, held = bodies[spec.name].A, bodies[spec.name].held
                bodies[spec.name] = replace(bodies[spec.name], A=TeamMatrix(team, A, points, held))
            ours = [found[contact.name][0] for contact, _ in at_body[spec.name]]
            members.append(Member(spec.name, bodies[spec.name], ours, scene.method.compliance, memory, histories,
                                  points, factor))
            interrupt.check()
    owned = {contact for contact, first, _ in exchange.ends if first == world.rank}
    space = Space([interface for interface in interfaces if interface.name in owned], world, exchange.sent)
    exchange.connect(space, [member.parts for member in members])
    told = _doubts(scene, gathered(world, {name: each.warnings for name, each in bodies.items() if each.warnings}),
                   gathered(world, {name: warnings for name, (_, warnings) in found.items() if warnings}))
    numbers = [body.name for body in scene.body]
    return Assembly(world, scene, tuple(Body(numbers.index(spec.name), spec, meshes[spec.name], member)
                                        for spec, member in zip(mine, members, strict=True)),
                    space, exchange, Joint(members, exchange, space, histories, scene.pushed),
                    world.allreduce(sum(each.n for each in bodies.values())),
                    world.allreduce(sum(interface.m for interface in interfaces if interface.name in owned)), told)


def _kept_by_bonds(scene: Settled, found: Mapping[str, tuple[Interface, list[str]]],
                   world: MPI.Comm) -> dict[str, tuple[Interface, list[str]]]:
    """The interfaces and their warnings of this rank, without overlaps of paired nodes that bonds of other contacts
    hold together, directly or in a chain through other bodies: no force could part them. Collective."""
    if len({contact.kind for contact in scene.contact}) < 2:
        return dict(found)
    pairs = {name: [[(body, int(node)) for body, node in zip(each.bodies, row, strict=True)] for row in np.column_stack(
        [nodes[transfer.indices] for nodes, transfer in zip(each.nodes, each.transfer, strict=True)])]
             for name, (each, _) in found.items() if not each.slave and not each.on_rigid
             and all(len(transfer.indices) == each.m for transfer in each.transfer)}  # no merged nodes on an axis
    shared = Counter(end for ends in pairs.values() for end in {end for row in ends for end in row})
    bonds = {(name, k): row for name, ends in pairs.items() if found[name][0].law.name == "bonded"
             for k, row in enumerate(ends) if max(shared[end] for end in row) > 1 and not found[name][0].gap[k]}
    together = list({key: row for each in world.allgather(bonds) for key, row in each.items()}.values())
    number = {end: k for k, end in enumerate(dict.fromkeys(end for row in together for end in row))}
    links = np.array([[number[end] for end in row] for row in together], int).reshape(-1, 2)
    piece = csgraph.connected_components(sparse.csr_matrix((np.ones(len(links)), links.T), (len(number),) * 2),
                                         directed=False)[1]
    result = dict(found)
    for name, ends in pairs.items():
        interface, warnings = found[name]
        kept = np.array([row[0] in number and row[1] in number and piece[number[row[0]]] == piece[number[row[1]]]
                         for row in ends]) & (interface.gap < 0.0) & (interface.law.name != "bonded")
        if kept.any():
            gap, at = np.where(kept, 0.0, interface.gap), in_words(interface.xy[kept][0])
            result[name] = replace(interface, gap=gap), [
                *warnings, f"contact.{name}: bonds of other contacts hold both sides together at {at}, so that the "
                           f"overlap of {-interface.gap[kept].min():.3g} there is left out"]
    return result


def _doubts(scene: Settled, by_body: Mapping[str, list[str]], by_contact: Mapping[str, list[str]]) -> list[str]:
    """All warnings of a scene, in its order, from those of bodies and contacts that have some."""
    named = {name for contact in scene.contact for name in contact.bodies}
    return [*(warning for body in scene.body for warning in by_body.get(body.name, ())),
            *(f"body.{body.name}: no contact names it; it is solved alone" for body in scene.body
              if body.name not in named),
            *(f"rigid.{rigid.name}: no contact names it; nothing touches it" for rigid in scene.rigid
              if rigid.name not in named),
            *(f"history.{name}: nothing follows it" for name in scene.history if name not in scene.followed),
            *("time: nothing follows a history; the loads are the same in all load steps"
              for _ in [scene.time] if scene.time is not None and not scene.followed),
            *(warning for contact in scene.contact for warning in by_contact.get(contact.name, ()))]


def _tied(mesh: Mesh, others: Sequence[tuple[SettledContact, int]], free: np.ndarray, here: str) -> np.ndarray:
    """Nodes (nv,) bool of a body that clamps hold in all components, or that lie on `others` of its contacts, with its
    side in each, that can hold: bonded or frictional ones; in space on those of other groups than the one `here`."""
    tied = ~free.any(axis=(1, 2))
    for contact, side in others:
        if holds_along(contact) and (free.shape[1] == 2 or contact.on[side] != here):
            tied[mesh.facets(contact.on[side]).nodes] = True
    return tied


def _join(scene: Settled, contact: SettledContact, sides: tuple[Side, Side | None], specs: Sequence[SettledBody],
          factors: Mapping[float, Mapping[str | None, float]], refinement: int) -> tuple[Interface, list[str]]:
    """The interface of two sides, or of one and a rigid partner, of the bodies `specs`, and warnings. `factors` of
    histories are by the times at which loads turn. Raises InputError."""
    (first, second), clamps = sides, {body.name: [*body.clamps, ON_AXIS] for body in specs}
    unit = scene.units["length"]
    if second is None:
        (rigid,) = (each for each in scene.rigid if each.name == contact.bodies[1])
        interface = face_rigid(first, rigid, contact)
        partner = Mover(rigid)
    else:
        if any(body.mesh.geometry for body in specs):
            refinement = 1  # its nodes match by their number alone
        interface = connect(first, second, contact, refinement)
        partner = Mover(second, clamps[second.body])
    overlaps = check_overlap(interface, *(side for side in (first, second) if side),
                             scales=[each[interface.gap_history] for each in factors.values()], unit=unit)
    refuse_contradiction(interface, [Mover(first, clamps[first.body]), partner], factors, unit)
    idle = [] if contact.slave is None or interface.slave else [
        f"contact.{contact.name}.slave: no side is a slave, because nodes match and are paired; pairing = \"mortar\" "
        "makes one of them the slave"]
    if interface.pointwise and interface.law.name == "tresca":
        raise InputError(f"contact.{contact.name}.friction: the bodies meet along an edge or at a vertex only, at "
                         f"{in_words(interface.xy[0])}, where a slip bound, a stress, has no area to act on; law = "
                         '"coulomb" needs none')
    bare = [] if not interface.pointwise else [
        f"contact.{contact.name}: the bodies meet along an edge or at a vertex only, at {in_words(interface.xy[0])}"
        f"{f' and {interface.m - 1} nodes more' * (interface.m > 1)}: there are forces, but no area and no stresses; "
        "stresses in the bodies grow without limit there as meshes get finer"]
    return interface, idle + bare + overlaps + uncovered_profile(interface, contact)


def _check_method(scene: Settled, bodies: Mapping[str, Elasticity], interfaces: Sequence[Interface]) -> None:
    """InputError where a method of two bodies cannot do what is asked of it."""
    if not scene.method.by_body:
        return
    for name, elasticity in bodies.items():
        if not elasticity.held:
            raise InputError(f"method.outer = {scene.method.outer!r}: its clamps do not hold {name!r}, so that its "
                             'Neumann problems have no solution; outer = "newton", the default, can do it')
    if any(interface.one_sided.any() for interface in interfaces):
        raise InputError(f"method.outer = {scene.method.outer!r}: at some contact nodes a clamp holds one body "
                         "only, which this iteration cannot do; the default method can")
