"""From a scene to what one rank solves: mesh, matrices, interface, friction and body."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

from ddmpi import interrupt
from ddmpi.body import Body, Friction, friction_at
from ddmpi.elasticity import assemble
from ddmpi.errors import InputError
from ddmpi.exchange import Exchange, agreed
from ddmpi.interface import Interface, contact_side, pair
from ddmpi.memory import free_memory
from ddmpi.mesh import Mesh, boundary_group, build_mesh
from ddmpi.scene import BodySpec, NoFriction, Scene


@dataclass
class Clock:
    """Seconds by phase; each phase is also a PETSc log stage, for -log_view."""

    seconds: dict[str, float] = field(default_factory=dict)
    started: float = field(default_factory=time.perf_counter)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        with PETSc.Log.Stage(name):
            yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def largest(self, world: MPI.Comm) -> dict[str, float]:
        """The slowest rank's seconds of each phase, and of the whole. Collective."""
        own = self.seconds | {"total": time.perf_counter() - self.started}
        everyone = world.allgather(own)
        return {name: round(max(each[name] for each in everyone), 6) for name in own}


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


def check_ranks(world: MPI.Comm, scene: Scene) -> None:
    """InputError, on all ranks, unless there is a rank for each body."""
    if world.size != len(scene.body):
        error = InputError(f"this scene has {len(scene.body)} bodies, each on a rank of its own; start it with "
                           f"mpirun -n {len(scene.body)} (started on {world.size})")
        error.agreed = True
        raise error


def _ranks_beside(world: MPI.Comm) -> int:
    """How many ranks share this machine's memory, this one counted. Collective."""
    node = world.Split_type(MPI.COMM_TYPE_SHARED)
    try:
        return node.size
    finally:
        node.Free()
