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
"""A rank that has nothing to do looks up every so many seconds."""

_TEAM = MPI.Comm.Create_keyval()
"""Under this the communicator of the roots carries the team of its rank."""


def on_working_ranks(world: MPI.Comm, scene: Settled, work: Callable[[MPI.Comm], T]) -> T | None:
    """What `work` returns on the roots of the bodies, which it is given; the others serve them, and return None.

    With as many ranks as bodies or fewer all are roots. Collective. Raises what `work` raises, on all ranks, and
    InputError where the method needs a rank for each body. An error that not all ranks of a body can be told of is
    raised on one rank only, as one that is not agreed on.
    """
    check_ranks(world, scene)
    if world.size <= len(scene.body):
        return work(world)
    number, beside = place_ranks([count_nodes(body.mesh) for body in scene.body], world.size), ranks_beside(world)
    own = world.Split(number[world.rank])
    roots = world.Split(0 if own.rank == 0 else MPI.UNDEFINED)
    if own.rank == 0:
        roots = in_lockstep(roots)
    team = Team(own, [rank for rank, body in enumerate(number) if body == number[world.rank]], beside)
    result, failure = None, None
    give_back()  # several ranks are asked for where memory counts
    if own.rank:
        team.serve()
    else:
        roots.Set_attr(_TEAM, team)
        try:
            result = work(roots)
        except DdmpiError as error:
            failure = error
        if team.lost and failure:
            failure.agreed = False
            raise failure
        team.stop()
    over = world.Ibarrier()
    while not over.Test():
        time.sleep(NAP)
    if own.rank == 0:
        roots.Free()
    own.Free()
    agree(world, failure)
    return result


def team_of(world: MPI.Comm) -> Team | None:
    """The team that this rank is the root of, where bodies have several ranks; `world` is that of the roots."""
    team = world.Get_attr(_TEAM)
    return team if isinstance(team, Team) else None


def place_ranks(nodes: Sequence[int | None], ranks: int) -> list[int]:
    """The body of each rank, of more ranks than bodies: each one goes where a rank has the most `nodes` of a body's
    mesh. Bodies count as equal where not all are known."""
    sizes = [1 if None in nodes else size or 1 for size in nodes]
    number = [1] * len(sizes)
    for _ in range(ranks - len(sizes)):
        number[max(range(len(sizes)), key=lambda k: sizes[k] / number[k])] += 1
    return [body for body, times in enumerate(number) for _ in range(times)]


def count_nodes(mesh: MeshSpec) -> int | None:
    """Roughly the nodes of a body's mesh; None where only its file knows."""
    return None if mesh.divisions is None else math.prod((mesh.order or 1) * each + 1 for each in mesh.divisions)


def check_ranks(world: MPI.Comm, scene: Settled) -> None:
    """InputError, on all ranks, where a method of two bodies has not two ranks, one for each."""
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
    """The rank of each body: one body a rank, or, with fewer ranks than bodies, neighbours in the scene together."""
    return {name: k * min(world.size, len(names)) // len(names) for k, name in enumerate(names)}
