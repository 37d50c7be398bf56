"""The entry of the command line: it logs on rank 0 and turns errors into exit codes."""

from __future__ import annotations

import contextlib
import fcntl
import gc
import sys
import termios
import time
import traceback
from typing import TYPE_CHECKING

from ddmpi import __version__
from ddmpi.cli.arguments import build_parser, split_arguments
from ddmpi.errors import DdmpiError
from ddmpi.system import interrupt, logs

if TYPE_CHECKING:
    from mpi4py import MPI


def main(arguments: list[str] | None = None) -> None:
    """Entry point of ``python -m ddmpi`` and ``ddmpi``; ends the process with the exit code. Collective."""
    interrupt.listen()
    ours, petsc = split_arguments(sys.argv[1:] if arguments is None else arguments)
    from mpi4py import MPI

    from ddmpi.system.agreement import in_lockstep

    world = in_lockstep(MPI.COMM_WORLD)
    try:
        code = _main(world, ours, petsc)
    except BaseException as error:
        # This rank may be alone with the error, and others wait for it, so it ends them all.
        if isinstance(error, DdmpiError):
            logs.report_error(f"ddmpi: {error.kind}: {error}")
            _abort(world, error.exit_code)
        text = "".join(traceback.format_exception(error))
        logs.report_error(f"ddmpi: internal error on rank {world.rank}:\n{text}")
        _abort(world, 1)
    interrupt.ignore()
    sys.exit(code)


def _abort(world: MPI.Comm, code: int) -> None:
    """End all ranks, once mpirun has read what this one has said, or after a second.

    MPICH's mpirun may otherwise take the wish to abort first, and drop the message with the process.
    """
    late = time.monotonic() + 1.0
    with contextlib.suppress(OSError):  # stderr is no pipe
        while (
            any(fcntl.ioctl(sys.stderr.fileno(), termios.FIONREAD, bytes(4)))
            and time.monotonic() < late
        ):
            time.sleep(0.005)
    world.Abort(code)


def _main(world: MPI.Comm, ours: list[str], petsc: list[str]) -> int:
    from ddmpi.cli.commands import COMMANDS, printing
    from ddmpi.system.agreement import agreed, explained
    from ddmpi.system.provenance import command, whereabouts

    try:
        with agreed(world), printing(world):
            try:
                options = build_parser().parse_args(ours)
            except SystemExit as end:  # --help and --version
                return int(end.code or 0)
        with agreed(world):
            logs.configure(
                world.rank,
                getattr(options, "quiet", False),
                getattr(options, "log", None),
                f"ddmpi {__version__} on {whereabouts()}: {command()}",
            )
            interrupt.check()
        with explained():
            COMMANDS[options.command](world, options, petsc)
    except DdmpiError as error:
        if not error.agreed and world.size > 1:
            raise
        if world.rank == 0:
            logs.report_error(f"ddmpi: {error.kind}: {error}")
        traceback.clear_frames(error.__traceback__)
        return error.exit_code
    finally:
        gc.collect()  # PETSc objects must go before PETSc does
    return 0
