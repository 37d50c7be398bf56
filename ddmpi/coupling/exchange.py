"""Interface vectors between two bodies during the iterations, and agreement on errors; counts what it sends."""

from __future__ import annotations

import contextlib
import zlib
from collections.abc import Callable, Iterator

import numpy as np
from mpi4py import MPI

from ddmpi.errors import DdmpiError, SolverError
from ddmpi.petsc.events import event
from ddmpi.system import interrupt
from ddmpi.system.agreement import agree

_INTERFACE = 11

FAILED, DUE = 1, 2
"""Bits of a message's first word: the sender has met an error; it wants a checkpoint to be written."""


class Exchange:
    """Talks across one interface, between the roots of two bodies.

    Every message starts with two words: how the sender is, so that an error or a signal on one rank reaches
    the other at the next exchange instead of leaving it waiting; and what the message is about, so that
    ranks whose iterations came to different ends (on unlike processors, say) notice it.

    Parameters
    ----------
    world : communicator of all bodies
    partner : rank of the other body's root in `world`
    first : whether this rank's body is the first of the interface

    Attributes
    ----------
    messages, bytes : sent so far by this rank through `swap`
    wants_checkpoint : asked at every `swap`
    checkpoint_due : whether one of the two ranks wanted a checkpoint so far; the same on both
    """

    def __init__(self, world: MPI.Comm, partner: int, first: bool) -> None:
        self.world, self.partner, self.first = world, partner, first
        self.messages = self.bytes = 0
        self.wants_checkpoint: Callable[[], bool] = lambda: False
        self.checkpoint_due = False
        self._failure: DdmpiError | None = None

    def swap(self, mine: np.ndarray, about: str) -> tuple[np.ndarray, np.ndarray]:
        """Exchange equally long vectors `about` the same thing; returns (the first body's, the second body's).

        Collective over both bodies. Raises the error of either side on both, InterruptionError when a signal
        came to one of them, and SolverError when the two sides are about different things.
        """
        self._failure = self._failure or interrupt.interruption()
        send = np.empty(len(mine) + 2)
        send[0] = FAILED * (self._failure is not None) + DUE * self.wants_checkpoint()
        send[1] = zlib.crc32(about.encode())
        send[2:] = mine
        with event("Exchange"):
            sending = self.world.Isend(send, self.partner, _INTERFACE)
            status = MPI.Status()
            self.world.Probe(self.partner, _INTERFACE, status)
            receive = np.empty(status.Get_count(MPI.DOUBLE))  # as long as what comes, also when it is unexpected
            self.world.Recv(receive, self.partner, _INTERFACE)
            sending.Wait()
        self.messages += 1
        self.bytes += send.nbytes
        lost = send[1] != receive[1] or len(send) != len(receive)
        if lost:
            self._failure = self._failure or SolverError(
                f"the two ranks are at different points of the iteration, one at {about!r}; the processors may differ")
        flags = int(send[0]) | int(receive[0])
        self.checkpoint_due |= bool(flags & DUE)
        if flags & FAILED or lost:
            self.agree()
        theirs = receive[2:]
        return (mine, theirs) if self.first else (theirs, mine)

    def total(self, mine: np.ndarray, about: str) -> np.ndarray:
        """The sum of both bodies' vectors, the same bits on both ranks; otherwise as `swap`."""
        first, second = self.swap(mine, about)
        return first + second

    def swap_objects(self, mine: object) -> tuple:
        """As `swap`, for small objects during set-up and output; not counted."""
        theirs = self.world.sendrecv(mine, self.partner, _INTERFACE + 1, None, self.partner, _INTERFACE + 1)
        return (mine, theirs) if self.first else (theirs, mine)

    def state(self) -> dict[str, int]:
        return {"messages": self.messages, "bytes": self.bytes}

    def restore(self, state: dict[str, int]) -> None:
        self.messages, self.bytes = int(state["messages"]), int(state["bytes"])

    @contextlib.contextmanager
    def deferred(self) -> Iterator[None]:
        """Run local work; an error in it is kept and raised on both sides at the next `swap`."""
        try:
            yield
        except DdmpiError as error:
            if error.agreed:
                raise
            self._failure = error

    def agree(self) -> None:
        """Raise the kept error of any body on all ranks. Collective on the world."""
        agree(self.world, self._failure)
