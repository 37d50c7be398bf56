#!/usr/bin/env bash
"exec" "${0%/*}/on_two_ranks.sh" "$0" "$@"  # to Python, a string

__doc__ = """What checkpoints cost: the share of a long run that goes into noting and writing its state.

Solves the pinched blocks with each outer method for --seconds, with a checkpoint every --every seconds,
and adds up the time for them: noting the state before every iteration (processor time), and gathering,
writing and fsync (time on the clock). The larger sum of the two ranks counts. No run without checkpoints is
compared with it, because two runs on one machine differ by more than that.
"""

import argparse
import signal
import tempfile
import time
from pathlib import Path

from experiment import Row, on_two_ranks, pinched_blocks
from mpi4py import MPI

from ddmpi.coupling.assembly import prepare
from ddmpi.errors import InterruptionError
from ddmpi.judge.accuracy import MeshLadder
from ddmpi.run.checkpoint import CHECKPOINT, Checkpoints, identify
from ddmpi.run.solve import solve
from ddmpi.system import interrupt
from ddmpi.system.clock import Clock
from ddmpi.system.provenance import versions

METHODS = {"relaxation": "theta = 0.002",  # too slow to converge in the time that it has
           "anderson": 'outer = "anderson"', "newton": 'outer = "newton"'}
OUT_OF_REACH = 1e-14
"""The tolerance; a method that reaches it starts again."""


class Measured(Checkpoints):
    """Checkpoints that time themselves."""

    noting = writing = spent = 0.0
    iterations = written = 0

    def _note(self, *arguments) -> None:
        start, before = time.process_time(), self.spent
        super()._note(*arguments)
        self.noting += time.process_time() - start - (self.spent - before)
        self.iterations += 1

    def _write(self) -> None:
        start, clock = time.process_time(), time.perf_counter()
        super()._write()
        self.spent += time.process_time() - start
        self.writing += time.perf_counter() - clock
        self.written += 1


def measure(world: MPI.Comm, method: str, N: int, seconds: float, every: float, folder: Path) -> Row:
    """Iterations, checkpoints and seconds of a run that is stopped after `seconds`. Collective."""
    scene = pinched_blocks("coulomb", N, f"checkpoint.seconds={every}", f"method={{ {METHODS[method]}, "
                           f"tolerance = {OUT_OF_REACH}, max_iterations = 1000000 }}")
    interrupt._received.clear()
    assembly = prepare(world, scene)
    checkpoints = Measured(world, folder if world.rank == 0 else None, identify(scene, {}, versions()),
                           scene.checkpoint, Clock(), MeshLadder(scene))
    if world.rank == 0:
        signal.signal(signal.SIGALRM, interrupt._note)
        signal.setitimer(signal.ITIMER_REAL, seconds)
    start = time.perf_counter()
    try:
        while True:
            solve(assembly, scene.method, checkpoints=checkpoints)
    except InterruptionError:
        total = time.perf_counter() - start
    noting, writing, both = (world.allreduce(value, MPI.MAX) for value in (
        checkpoints.noting, checkpoints.writing, checkpoints.noting + checkpoints.writing))
    return {"m": assembly.m, "seconds": total, "iterations": checkpoints.iterations,
            "written": checkpoints.written, "noting": noting, "writing": writing, "cost": both}


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--size", type=int, nargs="+", default=[22, 86], metavar="N")
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--every", type=float, default=10.0)
    options = parser.parse_args()
    folder = Path(world.bcast(tempfile.mkdtemp() if world.rank == 0 else None))
    if world.rank == 0:
        print(f"a checkpoint every {options.every:g} s")
        print("method        m  seconds  iterations  µs to note  written  ms each   KiB  share of the run")
    for N in options.size:
        for method in METHODS:
            row = measure(world, method, N, options.seconds, options.every, folder)
            if world.rank == 0:
                size = (folder / CHECKPOINT).stat().st_size / 1024 if row["written"] else 0.0
                print(f"{method:11}{row['m']:4}{row['seconds']:9.1f}{row['iterations']:12}"
                      f"{1e6 * row['noting'] / row['iterations']:12.0f}{row['written']:9}"
                      f"{1e3 * row['writing'] / max(row['written'], 1):9.1f}{size:6.0f}"
                      f"{100 * row['cost'] / row['seconds']:16.3f} %", flush=True)
            world.barrier()
    if world.rank == 0:
        (folder / CHECKPOINT).unlink(missing_ok=True)
        folder.rmdir()


main()
