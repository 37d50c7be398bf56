"""The ranks of one body: the root commands, the others serve.

The roots do all work between bodies, with the same code as single ranks: a root has a `TeamMatrix` in place of its
stiffness and a `TeamSolver` in place of its solver. Their methods send commands, which all ranks of the body carry out
on their `Share`, the rows of the stiffness that they hold. Between commands the other ranks sleep.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI
from petsc4py import PETSc

from ddmpi.body.elasticity import Elasticity
from ddmpi.body.rigid_motions import stiffen
from ddmpi.body.solver import StiffnessSolver
from ddmpi.errors import DdmpiError, SolverError
from ddmpi.system.memory import free_memory
from ddmpi.system.numbers import bisect
from ddmpi.system.provenance import peak_memory

SHORTEST, LONGEST, PATIENCE = 1e-3, 5e-2, 1e-2
"""Shortest and longest sleep (s) of a rank that waits, and its length over the time waited so far."""

GRACE = 5.0
"""Seconds that a rank with an error waits for its team to end the command. Ranks that have not ended it by then wait
for this rank in a collective call of PETSc, and all processes must end."""


class Share:
    """One rank's share of a body: rows of the stiffness, and of a solver.

    Methods are commands, collective on the team: the first argument comes from the root, None elsewhere, the others are
    the same on all ranks; they return a value on the root only. `beside` is as of `Team`.
    """

    def __init__(self, comm: MPI.Comm, beside: int) -> None:
        self.comm, self._beside = comm, beside
        self._since = time.process_time()
        self._A: PETSc.Mat | None = None
        self._springs: tuple[np.ndarray, float] = (
            np.zeros(0, int),
            0.0,
        )  # rows of this rank with springs; stiffness
        self.solver: StiffnessSolver | None = None

    def drop(self, given: None = None) -> None:
        """Free the body's matrices and vectors; those that ranks share, PETSc frees only once all ranks ask for it."""
        if self._A is None:
            return
        for item in (self.solver, self._A, self._f, self._u, self._whole, self._deal):
            if item is not None:
                item.destroy()
        self._A = self.solver = None
        PETSc.garbage_cleanup(self.comm)

    def factor(
        self, given: tuple | None, supported: bool, condensed: bool, name: str, iterative: bool
    ) -> StiffnessSolver | None:
        """Distribute the rows of a stiffness over the ranks, and make the solver with them.

        All rows of a node go to one rank, and a rank has a region of the body. Where MUMPS factors, the root gets no
        rows: it has the mesh, and MUMPS distributes its work by itself.

        Parameters
        ----------
        given : the stiffness, which is destroyed, the positions of its nodes, the dofs of springs that support a loose
            body (`rigid_motions.add_springs`), and a trace and an order as for `StiffnessSolver`, in the root's numbers
        supported : whether clamps support the body
        condensed : whether there is a trace
        """
        self.drop()
        pieces, width, near, dofs = None, 1, [], np.zeros(0, int)
        rows: tuple[np.ndarray, ...] = (
            np.zeros(1, PETSc.IntType),
            np.zeros(0, PETSc.IntType),
            np.zeros(0),
        )
        if given is not None:
            A, points, dofs, trace, eliminated = given
            first, width, rows = int(not iterative), A.getBlockSize(), A.getValuesCSR()
            near = [vector.array_r.copy() for vector in A.getNearNullSpace().getVecs()]
            A.destroy()
            # Recursive bisection of the nodes' positions: few entries of A couple the rows of different ranks.
            owner = first + bisect(points, self.comm.size - first)
            order = (width * np.argsort(owner, kind="stable")[:, None] + np.arange(width)).ravel()
            pieces = np.split(
                order, width * np.cumsum(np.bincount(owner, minlength=self.comm.size))[:-1]
            )
        indices = self.comm.scatter(pieces)
        width, number, dofs = self.comm.bcast((width, len(near), dofs))
        mine = PETSc.IS().createGeneral(indices.astype(PETSc.IntType), comm=self.comm)
        mine.setBlockSize(width)
        layout = (len(rows[0]) - 1, None)  # all rows on the root at first
        whole = PETSc.Mat().createAIJ((layout, layout), bsize=width, csr=rows, comm=self.comm)
        del rows
        self._A = whole.createSubMatrix(mine, mine)
        self._A.setOption(PETSc.Mat.Option.SPD if supported else PETSc.Mat.Option.SYMMETRIC, True)
        self._u, self._f = self._A.createVecs()
        self._whole = whole.createVecRight()  # all entries on the root, in the root's order
        self._deal = PETSc.Scatter().create(self._whole, mine, self._f, None)
        motions = [
            self._scatter(near[k] if near else None, self._A.createVecRight())
            for k in range(number)
        ]
        space = PETSc.NullSpace().create(vectors=motions, comm=self.comm)
        self._A.setNearNullSpace(space)
        for item in (*motions, space, mine, whole):
            item.destroy()  # the matrix keeps its own reference
        # `mult` subtracts the springs: residuals and energies are those of A without them
        sprung = np.flatnonzero(np.isin(indices, dofs))
        self._springs = sprung, stiffen(self._A, sprung) if len(dofs) else 0.0
        if given is None or not condensed:
            trace, eliminated = sparse.csr_matrix((0, self._A.size[1])) if condensed else None, None
        else:
            trace, eliminated = trace[:, order], None if eliminated is None else eliminated[order]
        self.solver = StiffnessSolver(self._A, name, trace, eliminated, iterative)
        return self.solver if self.comm.rank == 0 else None

    def solve(self, given: np.ndarray | None, relative: float) -> np.ndarray | None:
        """A⁻¹ f of the root's vector."""
        assert self.solver is not None
        self.solver.solve(self._scatter(given, self._f), self._u, relative)
        return self._gather(self._u)

    def mult(self, given: np.ndarray | None) -> np.ndarray | None:
        """A u of the root's vector, without springs."""
        assert self._A is not None
        self._A.mult(self._scatter(given, self._u), self._f)
        dofs, stiffness = self._springs
        self._f.array[dofs] -= stiffness * self._u.array_r[dofs]
        return self._gather(self._f)

    def room(self, given: None = None) -> float:
        """Free memory of all ranks together (bytes)."""
        return self.comm.allreduce(free_memory() / self._beside)

    def machine(self, given: None = None) -> tuple[float, list[str]]:
        """The peak memory (MiB) of the ranks, and their hosts."""
        peaks, hosts = zip(
            *self.comm.allgather((peak_memory(), MPI.Get_processor_name())), strict=True
        )
        return max(peaks), list(hosts)

    def used(self, given: None = None) -> tuple[float, float]:
        """Processor seconds of all ranks since this was last asked, and the sum of their peak memories (MiB)."""
        now = time.process_time()
        spent, self._since = now - self._since, now
        seconds, memory = self.comm.allreduce(np.array([spent, peak_memory()]))
        return seconds, memory

    def _scatter(self, x: np.ndarray | None, to: PETSc.Vec) -> PETSc.Vec:
        """Fill `to` from a vector of the root."""
        if x is not None:
            self._whole.array[:] = x
        self._deal.scatter(self._whole, to)
        return to

    def _gather(self, vector: PETSc.Vec) -> np.ndarray | None:
        """The vector in the root's order, on the root."""
        self._deal.scatter(vector, self._whole, mode=PETSc.ScatterMode.REVERSE)
        return self._whole.array_r.copy() if self.comm.rank == 0 else None


class Team:
    """The ranks of one body. The first is the root, which calls `do` and in the end `stop`; the others `serve`.

    Parameters
    ----------
    comm : communicator of the body
    ranks : their numbers in the world
    beside : how many ranks share this machine's memory

    `lost` : whether an error left ranks in a collective call that will never end.
    """

    def __init__(self, comm: MPI.Comm, ranks: list[int], beside: int) -> None:
        self.comm, self.ranks, self.lost = comm, ranks, False
        self._share: Share | None = Share(comm, beside)
        self._votes = comm.Dup()  # not `comm`, on which others may still carry out a command

    def do(self, command: str, given: Any = None, *arguments: Any) -> Any:
        """Call a method of `Share` on all ranks, and return the root's result. Root only.

        Raises the error of any rank, with `agreed` False: other roots do not know of it yet.
        """
        if self._share is None:
            raise SolverError("the ranks of this body have ended their work")
        self._send((command, arguments))
        return self._perform(command, given, arguments)

    def holds(self, solver: StiffnessSolver) -> bool:
        """Whether the root's share has this solver. Root only."""
        return self._share is None or self._share.solver is solver

    def stop(self) -> None:
        """End `serve` on the other ranks; they keep their shares until `end`, and may serve again. Root only."""
        self._send(None)

    def end(self) -> None:
        """Free all shares, once no rank serves. Collective on the team."""
        if self._share is not None:
            self._share.drop()
            self._share = None
            self._votes.Free()

    def serve(self) -> None:
        """Carry out the root's commands until it stops. Not on the root.

        The root reports errors; only one that leaves other ranks in a collective call is raised here.
        """
        while (order := self._receive()) is not None:
            command, arguments = order
            try:
                self._perform(command, None, arguments)
            except DdmpiError:
                if self.lost:
                    raise

    def _perform(self, command: str, given: Any, arguments: tuple) -> Any:
        """The result of a command on this rank's share. Raises the error of any rank on all of them."""
        result, failure = None, None
        try:
            result = getattr(self._share, command)(given, *arguments)
        except DdmpiError as error:
            failure = error
        # All ranks vote after a command. A rank that failed polls: if the vote does not end in time, the others wait
        # for it in a collective call of PETSc.
        failed, deadline = np.array([failure is not None]), time.monotonic() + GRACE
        request = self._votes.Iallreduce(MPI.IN_PLACE, failed, MPI.LOR)
        while failure and not request.Test():
            if time.monotonic() > deadline:
                self.lost = True
                raise failure
            time.sleep(SHORTEST)
        request.Wait()
        if failed[0]:
            raise next(error for error in self._votes.allgather(failure) if error)
        return result

    def _send(self, order: tuple | None) -> None:
        # The ranks sleep and poll for this message; the command follows in a blocking broadcast.
        self.comm.Ibcast(np.zeros(1)).Wait()
        self.comm.bcast(order)

    def _receive(self) -> tuple | None:
        wait(self.comm.Ibcast(np.zeros(1)))
        return self.comm.bcast(None)


def wait(request: MPI.Request) -> None:
    """Test a request and sleep until it is complete; to wait in Open MPI would keep a core busy."""
    start = time.monotonic()
    while not request.Test():
        time.sleep(min(max(SHORTEST, PATIENCE * (time.monotonic() - start)), LONGEST))


class TeamMatrix:
    """The root's view of a stiffness whose rows are on the ranks of the team once there is a solver.

    Until then the root has all of A, with a block of rows for each of the nodes at `points` (k, d). `again` makes the
    body for another solver. Methods with PETSc's names are those of its matrices.
    """

    def __init__(
        self, team: Team, body: Elasticity, points: np.ndarray, again: Callable[[], Elasticity]
    ) -> None:
        A = self._whole = body.A
        self.team = team
        self.size = A.getSize()
        self._width = A.getBlockSize()
        self._diagonal = A.getDiagonal()
        self._again, self.points, self._coarse = again, points, A.getAttr("coarse")
        self.supported, self.springs = body.supported, np.zeros(0, int)

    @property
    def whole(self) -> PETSc.Mat:
        """All of A, on the root; made again where a solver has distributed and destroyed it."""
        if not self._whole:
            self._whole = self._again().A
        return self._whole

    def getDiagonal(self) -> PETSc.Vec:
        return self._diagonal

    def getRowIJ(self) -> tuple[np.ndarray, np.ndarray]:
        return self.whole.getRowIJ()

    def getAttr(self, name: str) -> Any:
        return self._coarse if name == "coarse" else self.whole.getAttr(name)

    def getBlockSize(self) -> int:
        return self._width

    def mult(self, u: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array[:] = self.team.do("mult", u.array_r)

    def createVecs(self) -> tuple[PETSc.Vec, PETSc.Vec]:
        return tuple(PETSc.Vec().createSeq(size, self._width) for size in self.size)

    def with_springs(self, dofs: np.ndarray) -> TeamMatrix:
        """The same with springs on `dofs` that support a loose body in solves."""
        self.springs = dofs
        return self


class TeamSolver:
    """A `StiffnessSolver` of a `TeamMatrix`, on the root. Construction distributes the rows of A."""

    def __init__(
        self,
        A: TeamMatrix,
        name: str,
        trace: sparse.csr_matrix | None = None,
        order: np.ndarray | None = None,
        iterative: bool = False,
    ) -> None:
        given, self._team = (A.whole, A.points, A.springs, trace, order), A.team
        self._solver = solver = self._team.do(
            "factor", given, A.supported, trace is not None, name, iterative
        )
        self.direct, self.given, self.description = solver.direct, solver.given, solver.description
        self.condensed, self.refused = solver.condensed, solver.refused

    def at_once(self, loads: np.ndarray) -> None:
        """The ranks solve for one load after the other."""

    def solve(self, f: PETSc.Vec, u: PETSc.Vec, relative: float = 0.0) -> None:
        """u ← A⁻¹ f, see `StiffnessSolver.solve`. Raises SolverError where other factors have replaced these."""
        if not self._team.holds(self._solver):
            raise SolverError(
                "the ranks of this body hold the factors of a later solve of the model"
            )
        u.array[:] = self._team.do("solve", f.array_r, relative)
