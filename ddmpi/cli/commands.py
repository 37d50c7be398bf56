"""What each command does, from its arguments on. All are collective."""

from __future__ import annotations

import atexit
import contextlib
import io
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ddmpi.errors import OutputError
from ddmpi.system import interrupt, logs
from ddmpi.system.agreement import agreed

if TYPE_CHECKING:
    import argparse

    from mpi4py import MPI


def _run(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    from ddmpi.scene.reader import read_scene

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
    from ddmpi.sweep.cases import base_scene, build_cases, choose

    text = _scene_text(world, options)
    with agreed(world):
        cases = build_cases(options.scene, text, options.set, options.vary)
        chosen = choose(cases, options.index)
    tables = [case.scene.petsc for case in cases]
    _init_petsc(world, {name: value for name, value in tables[0].items()
                        if all(table.get(name) == value for table in tables)}, petsc)
    from ddmpi.sweep.sweep import Sweep, gather_sweep, list_cases, run_sweep

    sweep = Sweep(options.scene, base_scene(text, options.set), Path(options.output), cases, chosen, petsc,
                  options.figures, options.plot)
    if options.list:
        interrupt.leave()
        with agreed(world), printing(world):
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

    with agreed(world), printing(world):
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

    with agreed(world), printing(world):
        if world.rank == 0:
            print(describe_installation(), end="")


COMMANDS = {"run": _run, "verify": _run, "sweep": _sweep, "figures": _draw, "sweep-plot": _draw, "info": _info}


@contextlib.contextmanager
def printing(world: MPI.Comm) -> Iterator[None]:
    """What the block prints appears at its end, on rank 0 alone. Not collective. Raises OutputError on rank 0."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        yield
    if world.rank == 0:
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # PETSc would print pages about it
        try:
            sys.stdout.write(text.getvalue())
            sys.stdout.flush()
        except BrokenPipeError:  # the reader has seen enough
            logs.leave_stdout()
        except OSError as error:
            logs.leave_stdout()
            raise OutputError(f"what was asked for could not be printed: {error.strerror}") from None


def _scene_text(world: MPI.Comm, options: argparse.Namespace) -> str:
    """The scene as rank 0 reads it. Collective."""
    from ddmpi.scene.reader import read_text

    with agreed(world):
        text = read_text(options.scene) if world.rank == 0 else None
    return world.bcast(text)


def _init_petsc(world: MPI.Comm, table: dict, petsc: list[str]) -> None:
    """Start PETSc with a scene's options and those of the command line, which win. Collective."""
    import petsc4py

    from ddmpi.petsc.options import as_arguments, silence_left

    petsc4py.init([sys.argv[0], *as_arguments(table), *petsc], comm=world)
    atexit.register(silence_left)
