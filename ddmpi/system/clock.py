"""Seconds by phase of a run."""

from __future__ import annotations

import logging
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from threading import Thread
from threading import enumerate as enumerate_threads

from mpi4py import MPI
from petsc4py import PETSc

from ddmpi.system.logs import PROGRESS

log = logging.getLogger(PROGRESS)

LONG = 5.0
"""Seconds after which a phase is told, if it has words; again after twice, four times as many, and so on."""

WORDS = {
    "assemble": "stiffnesses of bodies, and pairs of contact nodes",
    "factor": "factorizations of bodies, and their compliances",
    "outer": "iterations",
    "recover": "displacements under the forces found",
    "estimate": "the estimated error",
    "errors": "errors of results",
    "doubt": "warnings of the answer",
    "output": "files and pictures",
}
"""Of phases; while gmsh works, who waits for it tells so. Iterations are told one by one, and at work if one is long."""


@dataclass
class _Work:
    """What a phase is at, since when it has said nothing, and after how many seconds it does."""

    name: str
    begun: float = field(default_factory=time.perf_counter)
    due: float = field(default_factory=lambda: LONG)
    part: str = ""


_works: list[_Work] = []
"""The phases of this process, the innermost last."""


def now_at(part: str, said: bool = False) -> None:
    """Let the present phase tell this `part` of it, such as a body, if it takes long; from now on if something was
    `said`. Not collective."""
    if _works:
        _works[-1].part = part
        if said:
            _works[-1].begun, _works[-1].due = time.perf_counter(), LONG


def _watch() -> None:
    """Tell what long phases work at, while libraries that let threads run work: MUMPS does, multigrid's set-up does not."""
    while True:
        time.sleep(LONG / 10.0)
        tell(time.perf_counter())


def tell(now: float) -> None:
    """Log what the present phase works at if it is long `now`, by time.perf_counter. Not collective."""
    for work in _works[-1:]:
        if now - work.begun >= work.due:
            part = f", now at {work.part}" * bool(work.part)
            log.info("%s: at work for %g s%s", WORDS[work.name], work.due, part)
            work.due *= 2.0


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
    """Tell what a phase works at, once it takes LONG: by another thread, which the first phase starts."""
    if name not in WORDS or not log.isEnabledFor(logging.INFO):
        yield
        return
    if not any(thread.name == __name__ for thread in enumerate_threads()):
        Thread(target=_watch, name=__name__, daemon=True).start()
    _works.append(_Work(name))
    try:
        yield
    finally:
        _works.pop()
