"""Seconds by phase of a run."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Timer

from mpi4py import MPI
from petsc4py import PETSc

log = logging.getLogger("ddmpi")

LONG = 5.0  # seconds after which a phase is told, if it has words

WORDS = {
    "assemble": "stiffnesses of bodies, and pairs of contact nodes",
    "factor": "factorizations of bodies, and their compliances",
    "estimate": "the estimated error",
    "errors": "errors of results",
    "doubt": "warnings of the answer",
    "output": "files and pictures",
}
"""Of phases that say nothing by themselves; meshes and iterations do."""


@dataclass
class Clock:
    """Seconds by phase. Each phase is also a PETSc log stage, for -log_view."""

    seconds: dict[str, float] = field(default_factory=dict)
    started: float = field(default_factory=time.perf_counter)
    _lap: tuple[float, float] = field(default_factory=lambda: (time.process_time(), 0.0))

    def lap(self, phase: str) -> tuple[float, float]:
        """Processor seconds of this rank since the last lap, and those of a phase among them, which are at most all. Not
        collective."""
        before, self._lap = self._lap, (time.process_time(), self.seconds.get(phase, 0.0))
        spent, of_phase = (now - then for now, then in zip(self._lap, before, strict=True))
        return spent, min(spent, of_phase)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        with PETSc.Log.Stage(name), _told(name):
            yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def largest(self, world: MPI.Comm) -> dict[str, float]:
        """Seconds of the slowest rank, by phase and in total. Collective."""
        seconds = self.seconds | {"total": time.perf_counter() - self.started}
        everyone = world.allgather(seconds)
        names = dict.fromkeys(
            name for phases in everyone for name in phases
        )  # a rank without a body has no phases
        return {name: round(max(phases.get(name, 0.0) for phases in everyone), 6) for name in names}


@contextmanager
def _told(name: str) -> Iterator[None]:
    """Log what a phase works at, once it takes LONG: by another thread, while libraries work."""
    if name not in WORDS or not log.isEnabledFor(logging.INFO):
        yield
        return
    timer = Timer(LONG, log.info, ["%s: at work for %g s", WORDS[name], LONG])
    timer.daemon = True
    timer.start()
    try:
        yield
    finally:
        timer.cancel()
