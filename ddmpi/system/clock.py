"""Seconds by phase of a run."""

from __future__ import annotations

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field

from mpi4py import MPI
from petsc4py import PETSc


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
        with PETSc.Log.Stage(name):
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
