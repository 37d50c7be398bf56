"""Agreement of all ranks: an error that one rank meets is raised on all; on request, whether ranks keep in step."""

from __future__ import annotations

import contextlib
import functools
import os
import sys
import zlib
from collections.abc import Callable, Iterator, Mapping
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from mpi4py import MPI

from ddmpi.errors import DdmpiError, SolverError

K = TypeVar("K")
T = TypeVar("T")

LOCKSTEP = "DDMPI_LOCKSTEP"
"""With this variable in the environment of rank 0, every collective call of ours compares first where each rank calls
it. Launchers do not hand the environment on to other hosts."""

COLLECTIVES = ("allgather", "Allgather", "allreduce", "Allreduce", "barrier", "Barrier", "bcast", "Bcast", "gather",
               "Gather", "Gatherv", "reduce", "Reduce", "scatter", "Scatter", "Scatterv", "Split", "Split_type", "Dup")

DEPTH = 12
"""So many calls of this package, the innermost ones, say where a collective is called."""

_PACKAGE = str(Path(__file__).parents[1]) + os.sep


class LockstepError(RuntimeError):
    """Ranks call different collectives: one of them has left a loop, or taken a branch, that the others have not."""


class Lockstep(MPI.Intracomm):
    """A communicator that raises LockstepError, on all ranks, where ranks call different collectives.

    Without it they would wait for each other for ever, or take each other's numbers for their own. All communicators of
    the same ranks compare on the same one, so that a rank that has gone on to another of them is noticed, too. PETSc
    does not take it: hand it ``MPI.Intracomm(comm)``. Its own collectives are not compared, nor are messages.
    """

    meeting: MPI.Comm


def _compared(name: str) -> Callable[..., Any]:
    """The collective `name` of a communicator, after a comparison of where it is called."""
    plain = getattr(MPI.Intracomm, name)

    @functools.wraps(plain)
    def call(self: Lockstep, *arguments: Any, **named: Any) -> Any:
        where = f"{name}, {_whereabouts()}"
        own = np.array([zlib.crc32(where.encode())])
        everyone = np.empty(self.size, own.dtype)
        self.meeting.Allgather(own, everyone)
        if (everyone != own).any():
            places = self.meeting.allgather(where)
            raise LockstepError("ranks are at different collectives:\n" + "\n".join(
                f"rank {rank}: {place}" for rank, place in enumerate(places)))
        result = plain(self, *arguments, **named)
        if isinstance(result, Lockstep):  # a duplicate
            result.meeting = self.meeting
        return result

    return call


def _whereabouts() -> str:
    """The innermost calls of this package, the latest first."""
    frame, found = sys._getframe(2), list[str]()
    while frame and len(found) < DEPTH:
        code = frame.f_code
        if code.co_filename.startswith(_PACKAGE):
            found.append(f"{code.co_filename[len(_PACKAGE):]}:{frame.f_lineno} {code.co_name}")
        frame = frame.f_back  # type: ignore[assignment]
    return " < ".join(found)


for _name in COLLECTIVES:
    setattr(Lockstep, _name, _compared(_name))


_meetings: list[MPI.Comm] = []


def in_lockstep(comm: MPI.Comm) -> MPI.Comm:
    """The communicator, as a `Lockstep` where the environment of its first rank asks for it. Collective."""
    if comm.size == 1 or not comm.bcast(bool(os.environ.get(LOCKSTEP))):
        return comm
    same = (each for each in _meetings if MPI.Comm.Compare(each, comm) in (MPI.IDENT, MPI.CONGRUENT))
    found = Lockstep(comm)
    found.meeting = next(same, None) or MPI.Intracomm(comm).Dup()
    if found.meeting not in _meetings:
        _meetings.append(found.meeting)
    return found


def agree(world: MPI.Comm, error: DdmpiError | None) -> None:
    """Raise the first error that a rank has, if any has one, on all ranks. Collective."""
    for found in world.allgather(error):
        if found is not None:
            found.agreed = True
            raise found


@contextlib.contextmanager
def explained() -> Iterator[None]:
    """Numbers and arrays that are too large for the machine become a SolverError that says so. Not collective."""
    try:
        yield
    except MemoryError as error:
        raise SolverError(": ".join(filter(None, ("not enough memory", str(error))))) from None
    except (OverflowError, FloatingPointError, np.linalg.LinAlgError) as error:
        raise SolverError(f"numbers out of the range of double precision ({error}); choose other units") from None


@contextlib.contextmanager
def agreed(world: MPI.Comm) -> Iterator[None]:
    """Run local work; afterwards all ranks raise the first error that any of them met. Collective."""
    error = None
    try:
        with explained():
            yield
    except DdmpiError as failure:
        error = failure
    agree(world, error)


def from_first(world: MPI.Comm, work: Callable[[], T]) -> T:
    """What `work` returns on rank 0, where alone it is called, on all ranks; so is an error. Collective."""
    result = None
    with agreed(world):
        if world.rank == 0:
            result = work()
    return world.bcast(result)


def merged(world: MPI.Comm, own: Mapping[K, T]) -> dict[K, T]:
    """The tables of all ranks as one, in the order of the ranks. Collective."""
    return {key: value for rank in world.allgather(own) for key, value in rank.items()}
