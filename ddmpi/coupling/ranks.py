"""Which rank holds which bodies."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from mpi4py import MPI

from ddmpi.coupling.team import Team, wait
from ddmpi.errors import DdmpiError, NotConvergedError
from ddmpi.scene.meshes import MeshSpec
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agree, in_lockstep
from ddmpi.system.memory import give_back

T = TypeVar("T")

_TEAM = MPI.Comm.Create_keyval()
"""The attribute of the roots' communicator that holds the team of its rank."""


class WorkingRanks:
    """The ranks that work on scenes of the same bodies, case by case: a root for each body, and ranks that serve roots.

    With at most as many ranks as bodies all are roots. A case whose meshes need another number of ranks for a body
    begins with new teams. Everything is collective on `world`.
    """

    def __init__(self, world: MPI.Comm) -> None:
        self.world, self._roots, self._left = world, world, list[MPI.Comm]()
        self._number: list[int] = []
        self._team: Team | None = None
        self._failed = self._lost = (
            False  # of the last case: whether it failed, and without an agreement of the ranks
        )

    def work(self, scene: Settled, work: Callable[[MPI.Comm], T]) -> T | None:
        """The result of `work(roots)` on the roots of the bodies, None on the other ranks.

        Raises the errors of `work` on all ranks. An error that cannot reach all ranks of a body is raised on one rank
        only, with `agreed` False.
        """
        self._arrange(scene)
        team, result, failure = self._team, None, None
        if team is not None:
            give_back()  # several ranks a body are used where memory is short; else page faults cost a sixth of a run
        self._failed = self._lost = True  # until it is known how the work ends
        try:
            if team is None or team.comm.rank == 0:
                result = work(self._roots)
            else:
                team.serve()
        except DdmpiError as error:
            failure = error
        if team is None and failure:
            self._lost = not failure.agreed
            self._failed = not isinstance(failure, NotConvergedError)
            raise failure
        if team is not None:
            # ranks of a lost team hang in a collective call of PETSc; an error without agreement ends all processes
            if team.lost and failure:
                failure.agreed = False
                raise failure
            if team.comm.rank == 0:
                team.stop()
            wait(self.world.Ibarrier())
            self._lost = False
            agree(self.world, failure)
        self._failed = self._lost = False
        return result

    def _arrange(self, scene: Settled) -> None:
        """Make teams, where those of the case before are of other numbers of ranks."""
        number = []
        if self.world.size > len(scene.body):
            nodes = [count_nodes(body.mesh) for body in scene.body]
            number = place_ranks(nodes, self.world.size)
        if number != self._number:
            self.end()
            if number:
                self._place(number)
        elif self._failed and self._roots != MPI.COMM_NULL:
            self._left.append(self._roots)
            self._take(self._roots.Dup())  # no message of the case that failed may reach this one

    def _place(self, number: list[int]) -> None:
        """Make teams, for more ranks than bodies; `number` is the body of each rank."""
        beside, comm = ranks_beside(self.world), self.world.Split(number[self.world.rank])
        roots = self.world.Split(0 if comm.rank == 0 else MPI.UNDEFINED)
        self._team = Team(
            comm,
            [rank for rank, body in enumerate(number) if body == number[self.world.rank]],
            beside,
        )
        self._number = number
        self._take(in_lockstep(roots) if comm.rank == 0 else roots)

    def _take(self, roots: MPI.Comm) -> None:
        """Let the roots work on a communicator."""
        self._roots = roots
        if self._team is not None and self._team.comm.rank == 0:
            roots.Set_attr(_TEAM, self._team)

    def end(self) -> None:
        """Free communicators and teams, unless some ranks are lost: then an error ends all processes."""
        if self._lost:
            return
        if self._team is not None:
            self._team.end()
            self._team.comm.Free()
        for comm in (*self._left, self._roots):
            if comm not in (self.world, MPI.COMM_NULL):
                comm.Free()
        self._team, self._roots, self._number = None, self.world, []
        self._left.clear()


def on_working_ranks(world: MPI.Comm, scene: Settled, work: Callable[[MPI.Comm], T]) -> T | None:
    """The result of `work(roots)` on the `WorkingRanks` for one case. Collective."""
    ranks = WorkingRanks(world)
    try:
        return ranks.work(scene, work)
    finally:
        ranks.end()


def team_of(world: MPI.Comm) -> Team | None:
    """The team whose root this rank is, where bodies have several ranks; `world` is the communicator of the roots."""
    team = world.Get_attr(_TEAM)
    return team if isinstance(team, Team) else None


def place_ranks(nodes: Sequence[int | None], ranks: int) -> list[int]:
    """The body of every rank, for more ranks than bodies: each further rank goes to the body with the most `nodes` per
    rank. Bodies count as equal if the nodes of one are unknown.

    >>> place_ranks([100, 10, 90], 5)
    [0, 0, 1, 2, 2]
    """
    sizes = [1 if None in nodes else size or 1 for size in nodes]
    number = [1] * len(sizes)
    for _ in range(ranks - len(sizes)):
        number[max(range(len(sizes)), key=lambda k: sizes[k] / number[k])] += 1
    return [body for body, times in enumerate(number) for _ in range(times)]


def count_nodes(mesh: MeshSpec) -> int | None:
    """The approximate number of nodes of a body's mesh; None if only its file has it."""
    return (
        None
        if mesh.divisions is None
        else math.prod((mesh.order or 1) * number + 1 for number in mesh.divisions)
    )


def ranks_beside(world: MPI.Comm) -> int:
    """How many ranks share this machine's memory, this one included. Collective."""
    node = world.Split_type(MPI.COMM_TYPE_SHARED)
    try:
        return node.size
    finally:
        node.Free()


def homes_of(names: Sequence[str], world: MPI.Comm) -> dict[str, int]:
    """The rank of every body: one body a rank, or, with fewer ranks than bodies, neighbours in the scene together.

    >>> homes_of(["first", "second", "third"], MPI.COMM_SELF)
    {'first': 0, 'second': 0, 'third': 0}
    """
    return {name: k * min(world.size, len(names)) // len(names) for k, name in enumerate(names)}
