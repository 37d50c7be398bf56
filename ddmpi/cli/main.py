"""The command line: arguments, logging on rank 0, errors to exit codes."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import gc
import io
import os
import signal
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ddmpi import __version__
from ddmpi.errors import DdmpiError, InputError, OutputError
from ddmpi.system import interrupt, logs

if TYPE_CHECKING:
    from mpi4py import MPI
from ddmpi.cli.arguments import build_parser, split_arguments


def main(arguments: list[str] | None = None) -> None:
    """Entry point of ``python -m ddmpi`` and ``ddmpi``; ends the process with the exit code."""
    interrupt.listen()
    own, petsc = split_arguments(sys.argv[1:] if arguments is None else arguments)
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    try:
        code = _main(world, own, petsc)
    except BaseException as error:
        # One rank may be alone with this, so no rank may wait for it: end them all.
        if isinstance(error, DdmpiError):
            logs.tell_error(f"ddmpi: {error.kind}: {error}")
            world.Abort(error.exit_code)
        if isinstance(error, KeyboardInterrupt) and world.size == 1:
            logs.tell_error("ddmpi: interrupted")
            sys.exit(130)
        text = "".join(traceback.format_exception(error))
        logs.tell_error(f"ddmpi: internal error on rank {world.rank}:\n{text}")
        world.Abort(1)
    interrupt.ignore()
    sys.exit(code)


def _main(world: MPI.Comm, own: list[str], petsc: list[str]) -> int:
    from ddmpi.system.agreement import agreed
    from ddmpi.system.provenance import command, whereabouts

    try:
        with agreed(world), _printing(world):
            try:
                options = build_parser().parse_args(own)
            except SystemExit as end:  # --help and --version
                return end.code
        with agreed(world):
            file = getattr(options, "log", None)
            if file and os.path.realpath(file) == os.path.realpath(options.scene):
                raise InputError(f"--log {file}: is the scene")
            logs.configure(world.rank, getattr(options, "quiet", False), file,
                           f"ddmpi {__version__} on {whereabouts()}: {command()}")
            interrupt.check()
        logs.accept(file)
        COMMANDS[options.command](world, options, petsc)
    except DdmpiError as error:
        if not error.agreed and world.size > 1:
            raise
        if world.rank == 0:
            logs.tell_error(f"ddmpi: {error.kind}: {error}")
        traceback.clear_frames(error.__traceback__)
        return error.exit_code
    finally:
        gc.collect()  # PETSc objects must go before PETSc does
    return 0


@contextlib.contextmanager
def _printing(world: MPI.Comm) -> Iterator[None]:
    """What is printed meanwhile comes out at its end, on rank 0 alone. Not collective. Raises OutputError, there."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        yield
    if world.rank == 0:
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # of which PETSc makes an uproar
        try:
            sys.stdout.write(text.getvalue())
            sys.stdout.flush()
        except BrokenPipeError:  # whoever reads has seen enough
            logs.leave_stdout()
        except OSError as error:
            logs.leave_stdout()
            raise OutputError(f"what was asked for could not be printed: {error.strerror}") from None


def _run(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    from ddmpi.scene.reader import read_scene
    from ddmpi.system.agreement import agreed

    text = _scene_text(world, options)
    with agreed(world):
        scene = read_scene(options.scene, text, options.set)
    _init_petsc(world, scene.petsc, petsc)
    from ddmpi.run.run import run
    from ddmpi.run.verify import verify

    interrupt.listen()
    if options.command == "verify":
        verify(world, scene, options.scene)
    else:
        run(world, scene, options.scene, options.output, figures=scene.output.figures and not options.no_figures,
            restart=options.restart)


def _sweep(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    from ddmpi.sweep.cases import build_cases, choose
    from ddmpi.system.agreement import agreed

    text = _scene_text(world, options)
    with agreed(world):
        cases = build_cases(options.scene, text, options.set, options.vary)
        chosen = choose(cases, options.index)
    tables = [case.scene.petsc for case in cases]
    _init_petsc(world, {name: value for name, value in tables[0].items()
                        if all(table.get(name) == value for table in tables)}, petsc)
    from ddmpi.sweep.sweep import Sweep, gather_sweep, list_cases, run_sweep

    sweep = Sweep(options.scene, Path(options.output), cases, chosen, petsc, options.figures, options.plot)
    if options.list:
        interrupt.leave()
        with agreed(world), _printing(world):
            list_cases(sweep)
    elif options.gather:
        interrupt.leave()
        gather_sweep(world, sweep)
    else:
        interrupt.listen()
        run_sweep(world, sweep)


def _draw(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    interrupt.leave()
    from ddmpi.results.pictures import draw_all
    from ddmpi.sweep.plots import draw_plots
    from ddmpi.system.agreement import agreed

    with agreed(world), _printing(world):
        if world.rank == 0:
            if options.command == "figures":
                draw_all(options.folder)
            else:
                for path in draw_plots(Path(options.folder), options.plots):
                    print(path)


def _info(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    interrupt.leave()
    _init_petsc(world, {}, petsc)
    from ddmpi.cli.info import describe_installation
    from ddmpi.system.agreement import agreed

    with agreed(world), _printing(world):
        if world.rank == 0:
            print(describe_installation(), end="")


COMMANDS = {"run": _run, "verify": _run, "sweep": _sweep, "figures": _draw, "sweep-plot": _draw, "info": _info}


def _scene_text(world: MPI.Comm, options: argparse.Namespace) -> str:
    """The scene as rank 0 reads it. Collective."""
    from ddmpi.scene.reader import read_text
    from ddmpi.system.agreement import agreed

    with agreed(world):
        text = read_text(options.scene) if world.rank == 0 else None
    return world.bcast(text)


def _init_petsc(world: MPI.Comm, table: dict, petsc: list[str]) -> None:
    """Start PETSc with a scene's options and those of the command line, which win. Collective."""
    import petsc4py

    from ddmpi.petsc.options import as_arguments

    petsc4py.init([sys.argv[0], *as_arguments(table), *petsc], comm=world)
    from ddmpi.petsc.options import silence_left

    atexit.register(silence_left)
