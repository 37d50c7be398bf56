"""From a scene to what one rank solves: mesh, matrices, interfaces, and its body among the others."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI

from ddmpi.body.elasticity import assemble
from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.joint import Joint
from ddmpi.coupling.member import Member
from ddmpi.coupling.ranks import check_ranks, ranks_beside
from ddmpi.coupling.space import Space
from ddmpi.errors import InputError
from ddmpi.interface.matching import pair
from ddmpi.interface.plausible import check_overlap, uncovered_profile
from ddmpi.interface.side import contact_side
from ddmpi.mesh.boundary import boundary_group
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import SettledBody
from ddmpi.scene.scene import Settled
from ddmpi.system import interrupt
from ddmpi.system.agreement import agreed
from ddmpi.system.clock import Clock
from ddmpi.system.memory import free_memory


@dataclass(frozen=True)
class Assembly:
    """A scene, discretised and factored, as one rank holds it.

    Attributes
    ----------
    world : communicator of all bodies
    scene : what was asked for
    spec, mesh, member : of the rank's own body
    space : the layout of the interfaces' vectors, with the interfaces
    exchange : with the other body
    n : free dofs of all bodies
    warnings : what a sensible person would ask about the scene; the same on all ranks
    """

    world: MPI.Comm
    scene: Settled
    spec: SettledBody
    mesh: Mesh
    member: Member
    space: Space
    exchange: Exchange
    n: int
    warnings: list[str]

    def joint(self) -> Joint:
        """The operator of all bodies together. Collective."""
        return Joint(self.member, self.exchange, self.space)


def prepare(world: MPI.Comm, scene: Settled, folder: Path = Path("."), clock: Clock | None = None,
            refinement: int = 1) -> Assembly:
    """Mesh, assemble, pair and factor.

    Parameters
    ----------
    world : as many ranks as the scene has bodies; body number r of the scene lives on rank r
    folder : where relative mesh files are looked for first
    clock : times the phases mesh, assemble and factor
    refinement : how many times finer the meshes of `scene` are than the given ones

    Raises
    ------
    InputError, SolverError, InterruptionError
        the same on all ranks. Collective.
    """
    clock = clock or Clock()
    check_ranks(world, scene)
    spec, contact = scene.body[world.rank], scene.contact[0]
    names = [body.name for body in scene.body]
    own = contact.bodies.index(spec.name)
    exchange = Exchange(world, names.index(contact.bodies[1 - own]), own == 0)
    key = f"contact.{contact.name}.on"

    with clock.phase("mesh"), agreed(world):
        mesh = build_mesh(spec, folder)
        edges = boundary_group(mesh, contact.on[own], key)
        interrupt.check()
    with clock.phase("assemble"):
        with agreed(world):
            elasticity = assemble(mesh, spec)
            side = contact_side(mesh, edges, elasticity.free, spec.name, spec.material.plane_modulus, key)
            interrupt.check()
        sides = exchange.swap_objects(side)
        with agreed(world):
            interface = pair(sides[0], sides[1], contact.friction, contact.name, refinement)
            found = check_overlap(interface, *sides) + uncovered_profile(interface, contact.friction)
            if scene.method.outer != "newton" and interface.one_sided.any():
                raise InputError(f"method.outer = {scene.method.outer!r}: at some contact nodes a clamp holds one body "
                                 "only, which this iteration cannot do; the default method can")
    memory = free_memory() / ranks_beside(world)
    with clock.phase("factor"), agreed(world):
        member = Member(spec.name, elasticity, [interface], scene.method.compliance, memory)
        interrupt.check()
    warnings = [*itertools.chain(*world.allgather(elasticity.warnings)), *found]
    return Assembly(world, scene, spec, mesh, member, Space([interface]), exchange, world.allreduce(elasticity.n),
                    warnings)
