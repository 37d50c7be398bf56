"""Whether ranks keep in step: what `ddmpi.system.agreement.in_lockstep` makes of communicators in tests.

    DDMPI_LOCKSTEP=tests/support/lockstep.py mpirun -n 2 python -m ddmpi run SCENE.toml

A rank that leaves the others is then an error instead of a hang.
"""

from __future__ import annotations

import functools
import os
import sys
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import ddmpi

COLLECTIVES = (
    "allgather",
    "Allgather",
    "allreduce",
    "Allreduce",
    "barrier",
    "Barrier",
    "bcast",
    "Bcast",
    "gather",
    "Gather",
    "Gatherv",
    "reduce",
    "Reduce",
    "scatter",
    "Scatter",
    "Scatterv",
    "Split",
    "Split_type",
    "Dup",
)

TYPED = ("Allgather", "Allreduce", "Bcast", "Reduce")
"""Those of arrays, which must be of one type on all ranks: MPI takes the bits of integers for those of numbers."""

DEPTH = 12
"""So many calls of this package, the innermost ones, say where a collective is called."""

_PACKAGE = str(Path(ddmpi.__file__).parent) + os.sep


class LockstepError(RuntimeError):
    """Ranks call different collectives: one of them has left a loop, or taken a branch, that the others have not."""


class Lockstep(MPI.Intracomm):
    """A communicator that raises LockstepError, on all ranks, where ranks call different collectives, or with arrays of
    different types.

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
        kinds = (
            {str(each.dtype) for each in arguments if isinstance(each, np.ndarray)}
            if name in TYPED
            else ()
        )
        where = ", ".join((name, _whereabouts(), *sorted(kinds)))
        own = np.array([zlib.crc32(where.encode())])
        everyone = np.empty(self.size, own.dtype)
        self.meeting.Allgather(own, everyone)
        if (everyone != own).any():
            places = self.meeting.allgather(where)
            raise LockstepError(
                "ranks are at different collectives:\n"
                + "\n".join(f"rank {rank}: {place}" for rank, place in enumerate(places))
            )
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
            found.append(f"{code.co_filename[len(_PACKAGE) :]}:{frame.f_lineno} {code.co_name}")
        frame = frame.f_back  # type: ignore[assignment]
    return " < ".join(found)


for _name in COLLECTIVES:
    setattr(Lockstep, _name, _compared(_name))


_meetings: list[MPI.Comm] = []


def compared(comm: MPI.Comm) -> Lockstep:
    """The communicator as a `Lockstep`. Collective."""
    same = (
        each for each in _meetings if MPI.Comm.Compare(each, comm) in (MPI.IDENT, MPI.CONGRUENT)
    )
    found = Lockstep(comm)
    found.meeting = next(same, None) or MPI.Intracomm(comm).Dup()
    if found.meeting not in _meetings:
        _meetings.append(found.meeting)
    return found
