"""The command in a batch job whose time is up at its tenth iteration: ``python preempted.py -m ddmpi ARGUMENTS``.

At the first start of the job rank 0 has Slurm send the signal that announces the end of the time limit to the
batch script, and waits until it has come through to the process; later starts run as usual.
"""

import itertools
import os
import subprocess
import sys
import time

import scenes


def main() -> None:
    from mpi4py import MPI

    from ddmpi.cli import main as cli
    from ddmpi.published.published import Subproblem
    from ddmpi.system import interrupt

    original, calls = Subproblem.neumann, itertools.count(1)

    def neumann(*arguments):
        if next(calls) == 10 and MPI.COMM_WORLD.rank == 0 and "SLURM_RESTART_COUNT" not in os.environ:
            subprocess.run(["scancel", "--batch", "--signal=USR1", os.environ["SLURM_JOB_ID"]], check=True)
            end = time.monotonic() + scenes.LIMIT
            while not interrupt.interruption() and time.monotonic() < end:
                time.sleep(0.01)
        return original(*arguments)

    Subproblem.neumann = neumann
    cli.main(sys.argv[3:])


if __name__ == "__main__":
    main()
