"""Agreement of all ranks: an error that one rank meets is raised on all."""

from __future__ import annotations

import contextlib
import importlib
import os
import sys
import time
import traceback
from collections.abc import Callable, Iterator, Mapping
from typing import TypeVar

import numpy as np
from mpi4py import MPI

from ddmpi.errors import DdmpiError, InternalError, SolverError

K = TypeVar("K")
T = TypeVar("T")

LOCKSTEP = "DDMPI_LOCKSTEP"
"""With this variable in the environment of rank 0, the file of Python code that it names compares where each rank calls
a collective; tests/support/lockstep.py does. Launchers do not hand the environment on to other hosts."""

PATIENCE = 20.0
"""How long a rank with a mistake of the program waits for the others to meet it, too (s)."""


def in_lockstep(comm: MPI.Comm) -> MPI.Comm:
    """The communicator, wrapped by the code in `LOCKSTEP` if there is one. Collective."""
    path = comm.bcast(os.environ.get(LOCKSTEP)) if comm.size > 1 else None
    if not path:
        return comm
    folder, name = os.path.split(path)
    if folder not in sys.path:
        sys.path.append(folder)
    return importlib.import_module(name.removesuffix(".py")).compared(comm)


def agree(world: MPI.Comm, error: DdmpiError | None) -> None:
    """Raise the first error of any rank on all ranks. Collective."""
    failed = np.array([error is not None])
    world.Allreduce(MPI.IN_PLACE, failed, MPI.LOR)
    for failure in world.allgather(error) if failed[0] else ():
        if failure is not None:
            failure.agreed = True
            raise failure


def agree_on_mistake(world: MPI.Comm, error: Exception) -> InternalError | None:
    """The mistake of the program that all ranks have met at the same line, as an error that they agree on.

    None where another rank has met none within `PATIENCE`, or another one: it may wait in a call for this rank, so that
    nothing but an end of all processes is left. Collective on the ranks that have met one.

    Parameters
    ----------
    world : a communicator for nothing else, since calls of ranks without a mistake must not meet these
    """
    frame = traceback.extract_tb(error.__traceback__)[-1]
    seen, request, end = (
        (type(error).__name__, frame.filename, frame.lineno),
        world.Ibarrier(),
        time.monotonic(),
    )
    while not request.Test():
        if time.monotonic() > end + PATIENCE:
            return None
        time.sleep(0.01)
    if len(set(world.allgather(seen))) > 1:
        return None
    agreed_on = InternalError(f"{seen[0]}: {error} ({os.path.basename(seen[1])}:{seen[2]})")
    agreed_on.agreed = True
    return agreed_on


@contextlib.contextmanager
def explained() -> Iterator[None]:
    """Numbers and arrays that are too large for the machine become a SolverError that says so. Not collective."""
    try:
        yield
    except MemoryError as error:
        raise SolverError(": ".join(filter(None, ("not enough memory", str(error))))) from None
    except (OverflowError, FloatingPointError, np.linalg.LinAlgError) as error:
        raise SolverError(
            f"numbers out of the range of double precision ({error}); choose other units"
        ) from None


@contextlib.contextmanager
def agreed(world: MPI.Comm, asleep: bool = False) -> Iterator[None]:
    """Run local work; afterwards all ranks raise the first error that any of them met. Collective.

    Ranks that wait long for others should do so `asleep`: in calls of MPI they take as much processor time as to work.
    """
    error = None
    try:
        with explained():
            yield
    except DdmpiError as failure:
        error = failure
    if asleep:
        done = world.Ibarrier()
        while not done.Test():
            time.sleep(0.002)
    agree(world, error)


def from_first(world: MPI.Comm, work: Callable[[], T]) -> T:
    """Call `work` on rank 0 only; all ranks return its result or raise its error. Collective."""
    result = None
    with agreed(world):
        if world.rank == 0:
            result = work()
    return world.bcast(result)


def gathered(world: MPI.Comm, entries: Mapping[K, T]) -> dict[K, T]:
    """One table from those of all ranks on the first rank, in their order; on the others their own. Collective.

    Tables that grow with the number of bodies are gathered, not `merged`: the first rank judges and writes them, and
    sends the others a few numbers.
    """
    of_ranks = world.gather(entries) if world.size > 1 else None
    return (
        dict(entries)
        if of_ranks is None
        else {key: value for rank in of_ranks for key, value in rank.items()}
    )


def merged(world: MPI.Comm, entries: Mapping[K, T]) -> dict[K, T]:
    """One table from those of all ranks, in the order of the ranks. Collective."""
    of_ranks = world.allgather(entries) if world.size > 1 else [entries]
    return {key: value for rank in of_ranks for key, value in rank.items()}
