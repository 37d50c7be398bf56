"""Which rank holds which bodies."""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from typing import TypeVar

from mpi4py import MPI

from ddmpi.coupling.team import Team
from ddmpi.errors import DdmpiError, InputError
from ddmpi.scene.meshes import MeshSpec
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agree, in_lockstep
from ddmpi.system.memory import give_back

T = TypeVar("T")

NAP = 0.01
"""Seconds between two looks of an idle rank at its messages."""

_TEAM = MPI.Comm.Create_keyval()
"""The attribute of the roots' communicator that holds the team of its rank."""


def on_working_ranks(world: MPI.Comm, scene: Settled, work: Callable[[MPI.Comm], T]) -> T | None:
    """The result of `work(roots)` on the roots of the bodies; the other ranks serve them and return None.

    With at most as many ranks as bodies all are roots. Collective. Raises the errors of `work` on all ranks, and
    InputError where the method needs a rank for each body. An error that cannot reach all ranks of a body is raised on
    one rank only, as one that is not agreed on.
    """
    check_ranks(world, scene)
    if world.size <= len(scene.body):
        return work(world)
    number, beside = place_ranks([count_nodes(body.mesh) for body in scene.body], world.size), ranks_beside(world)
    comm = world.Split(number[world.rank])
    roots = world.Split(0 if comm.rank == 0 else MPI.UNDEFINED)
    if comm.rank == 0:
        roots = in_lockstep(roots)
    team = Team(comm, [rank for rank, body in enumerate(number) if body == number[world.rank]], beside)
    result, failure = None, None
    give_back()  # users ask for several ranks a body where memory is short
    if comm.rank:
        team.serve()
    else:
        roots.Set_attr(_TEAM, team)
        try:
            result = work(roots)
        except DdmpiError as error:
            failure = error
        # Ranks of the team hang in a collective call of PETSc: an error that is not agreed on ends all processes.
        if team.lost and failure:
            failure.agreed = False
            raise failure
        team.stop()
    # Test and sleep: a blocking barrier keeps a core busy for every rank that waits.
    over = world.Ibarrier()
    while not over.Test():
        time.sleep(NAP)
    if comm.rank == 0:
        roots.Free()
    comm.Free()
    agree(world, failure)
    return result


def team_of(world: MPI.Comm) -> Team | None:
    """The team whose root this rank is, where bodies have several ranks; `world` is the communicator of the roots."""
    team = world.Get_attr(_TEAM)
    return team if isinstance(team, Team) else None


def place_ranks(nodes: Sequence[int | None], ranks: int) -> list[int]:
    """The body of every rank, for more ranks than bodies: another rank goes to the body with the most `nodes` of its
    mesh per rank. Bodies count as equal if the nodes of one are unknown."""
    sizes = [1 if None in nodes else size or 1 for size in nodes]
    number = [1] * len(sizes)
    # Every further rank goes to the body with the most nodes a rank.
    for _ in range(ranks - len(sizes)):
        number[max(range(len(sizes)), key=lambda k: sizes[k] / number[k])] += 1
    return [body for body, times in enumerate(number) for _ in range(times)]


def count_nodes(mesh: MeshSpec) -> int | None:
    """The approximate number of nodes of a body's mesh; None if only its file has it."""
    return None if mesh.divisions is None else math.prod((mesh.order or 1) * number + 1 for number in mesh.divisions)


def check_ranks(world: MPI.Comm, scene: Settled) -> None:
    """InputError, on all ranks, where a method of two bodies lacks a rank for each."""
    if scene.method.by_body and world.size < len(scene.body):
        error = InputError(f"method.outer = {scene.method.outer!r} works on two ranks, one for each body; start it "
                           f"with mpirun -n {len(scene.body)} (started on {world.size}), or use the default method")
        error.agreed = True
        raise error


def ranks_beside(world: MPI.Comm) -> int:
    """How many ranks share this machine's memory, this one included. Collective."""
    node = world.Split_type(MPI.COMM_TYPE_SHARED)
    try:
        return node.size
    finally:
        node.Free()


def homes_of(names: Sequence[str], world: MPI.Comm) -> dict[str, int]:
    """The rank of every body: one body a rank, or, with fewer ranks than bodies, neighbours in the scene together."""
    return {name: k * min(world.size, len(names)) // len(names) for k, name in enumerate(names)}
