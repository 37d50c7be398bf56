"""From a scene to what one rank solves: mesh, matrices, interface, friction and body."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from ddmpi.body.elasticity import assemble
from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.member import Body
from ddmpi.coupling.ranks import _ranks_beside, check_ranks
from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.law import Friction, friction_at
from ddmpi.interface.matching import pair
from ddmpi.interface.side import contact_side
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh, boundary_group
from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.contacts import NoFriction
from ddmpi.scene.scene import Scene
from ddmpi.system import interrupt
from ddmpi.system.agreement import agreed
from ddmpi.system.clock import Clock
from ddmpi.system.memory import free_memory


@dataclass(frozen=True)
class Problem:
    """A scene, discretised and factored, as one rank holds it.

    Attributes
    ----------
    world : communicator of all bodies
    spec, mesh, body : of the rank's own body
    interface, friction : of the contact; the same on both sides
    exchange : to the other body
    n : free dofs of all bodies
    order : the ranks of role 1 and role 2
    """

    world: MPI.Comm
    scene: Scene
    spec: BodySpec
    mesh: Mesh
    interface: Interface
    friction: Friction
    body: Body
    exchange: Exchange
    n: int
    order: tuple[int, int]


def prepare(world: MPI.Comm, scene: Scene, folder: Path = Path("."), clock: Clock | None = None) -> Problem:
    """Mesh, assemble, pair and factor.

    Parameters
    ----------
    world : as many ranks as the scene has bodies; body number r of the scene lives on rank r
    folder : where relative mesh files are looked for first
    clock : times the phases mesh, assemble and factor

    Raises
    ------
    InputError, SolverError, InterruptionError
        the same on all ranks. Collective.
    """
    clock = clock or Clock()
    check_ranks(world, scene)
    contact = scene.contact[0]
    names = [body.name for body in scene.body]
    sides = list(zip(contact.bodies, contact.on, strict=True))
    if scene.method.outer == "anderson":  # the stiffer body takes role 1; forces and slip read the same
        sides.sort(key=lambda side: -scene.body[names.index(side[0])].material.plane_modulus)
    order = tuple(names.index(name) for name, _ in sides)
    role = order.index(world.rank) + 1
    spec = scene.body[world.rank]
    exchange = Exchange(world, partner=order[2 - role], role=role)

    with clock.phase("mesh"), agreed(world):
        mesh = build_mesh(spec, folder)
        edges = boundary_group(mesh, sides[role - 1][1], "contact.0.on")
        interrupt.check()
    with clock.phase("assemble"):
        with agreed(world):
            elasticity = assemble(mesh, spec)
            side = contact_side(mesh, edges, elasticity.free)
            interrupt.check()
        both = exchange.swap_objects(side)
        with agreed(world):
            interface = pair(*both, friction=not isinstance(contact.friction, NoFriction), label="contact.0")
            if scene.method.outer != "newton" and interface.one_sided.any():
                raise InputError(f"method.outer = {scene.method.outer!r}: at some contact nodes a clamp holds one body "
                                 "only, which this iteration cannot do; the default method can")
    friction = friction_at(contact.friction, interface)
    memory = free_memory() / _ranks_beside(world)
    with clock.phase("factor"), agreed(world):
        body = Body(spec.name, role, interface, elasticity, scene.method.compliance, memory)
        interrupt.check()
    return Problem(world, scene, spec, mesh, interface, friction, body, exchange, world.allreduce(elasticity.n), order)
