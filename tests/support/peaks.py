"""Notes how much memory each phase of a run has needed until then.

    PEAKS=FOLDER DDMPI_LOCKSTEP=tests/support/peaks.py mpirun -n 2 python -m ddmpi run SCENE.toml

Each rank writes RANK.json into the folder: by phase the most memory (MiB) that it has held until the phase ended.
"""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from mpi4py import MPI

from ddmpi.system.clock import Clock
from ddmpi.system.provenance import peak_memory

_phase, _found = Clock.phase, dict[str, float]()


@contextmanager
def _noted(clock: Clock, name: str) -> Iterator[None]:
    with _phase(clock, name):
        yield
    _found[name] = peak_memory()
    Path(os.environ["PEAKS"], f"{MPI.COMM_WORLD.rank}.json").write_text(
        json.dumps(_found), encoding="utf-8"
    )


def compared(comm: MPI.Comm) -> MPI.Comm:
    Clock.phase = _noted  # type: ignore[method-assign]
    return comm
