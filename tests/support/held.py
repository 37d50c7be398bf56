"""The command, held at its hundredth product with a compliance until a signal comes: ``python held.py -m ddmpi …``.

At the first start of a batch job rank 0 has Slurm send the signal that announces the end of the time limit to the batch
script; later starts run as usual. Elsewhere it makes the file READY for who sends the signal.
"""

import itertools
import os
import subprocess
import sys
import time
from pathlib import Path

import scenes


def main() -> None:
    from mpi4py import MPI

    from ddmpi.body.compliance import Compliance
    from ddmpi.cli import main as cli
    from ddmpi.system import interrupt

    original, calls = Compliance.mult, itertools.count(1)

    def mult(*arguments):
        if (
            next(calls) == 100
            and MPI.COMM_WORLD.rank == 0
            and "SLURM_RESTART_COUNT" not in os.environ
        ):
            if "SLURM_JOB_ID" in os.environ:
                subprocess.run(
                    ["scancel", "--batch", "--signal=USR1", os.environ["SLURM_JOB_ID"]], check=True
                )
            else:
                Path(os.environ["READY"]).touch()
            end = time.monotonic() + scenes.LIMIT
            while not interrupt.interruption() and time.monotonic() < end:
                time.sleep(0.01)
        return original(*arguments)

    Compliance.mult = mult
    cli.main(sys.argv[sys.argv.index("ddmpi") + 1 :])  # after -P -m ddmpi


if __name__ == "__main__":
    main()
