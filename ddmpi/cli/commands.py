"""What each command does, from its arguments on. All are collective."""

from __future__ import annotations

import atexit
import contextlib
import io
import json
import signal
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

from ddmpi.errors import InputError, InterruptionError, OutputError
from ddmpi.system import interrupt, logs
from ddmpi.system.agreement import agreed, from_first
from ddmpi.system.files import writing
from ddmpi.system.memory import loading

if TYPE_CHECKING:
    import argparse

    from mpi4py import MPI


Command = Callable[["MPI.Comm", "argparse.Namespace", list[str]], None]


def _run(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    """The commands run, converge and check, which read a scene alike."""
    with loading():
        from ddmpi.mesh.build import kind_of_files
        from ddmpi.scene.reader import read_scene_file

    asked = ['output.errors="main"'] * getattr(options, "errors", False)
    if options.command == "converge":
        asked.append(f"method.target={{ {json.dumps(options.of)} = {options.within!r} }}")
    scene = from_first(
        world,
        lambda: read_scene_file(
            options.scene, [*options.set, *asked], kind_of_files(options.scene)
        ),
    )
    _init_petsc(world, scene.petsc, petsc)
    with loading():
        from ddmpi.run.run import run

    interrupt.listen()
    figures = scene.output.figures and not options.no_figures
    given = world, scene, options.scene, options.output, figures
    if options.command == "check":
        from ddmpi.check.check import check

        check(*given)
    else:
        run(*given, getattr(options, "restart", None))


def _check(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    try:
        _run(world, options, petsc)
    except InterruptionError as error:
        error.args = ("before the check was done",)
        raise


def _sweep(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    from ddmpi.mesh.build import kind_of_files
    from ddmpi.scene.reader import read_data, read_text
    from ddmpi.sweep.cases import build_cases, choose

    scene = from_first(
        world, lambda: read_data(options.scene, read_text(options.scene), options.set)
    )
    cases = from_first(
        world, lambda: build_cases(options.scene, scene, options.vary, kind_of_files(options.scene))
    )
    with agreed(world):
        chosen = choose(cases, options.index)
    _init_petsc(world, {}, petsc)
    with loading():
        from ddmpi.sweep.sweep import Sweep, gather_sweep, list_cases, run_sweep
        from ddmpi.sweep.table import identify

    identity = from_first(world, lambda: identify(scene, petsc, cases, Path(options.scene).parent))
    sweep = Sweep(
        options.scene, identity, Path(options.output), cases, chosen, options.figures, options.plot
    )
    if options.list or options.gather:
        interrupt.leave()
        with agreed(world), printing(world):
            if world.rank == 0:
                (list_cases if options.list else gather_sweep)(sweep)
    else:
        interrupt.listen()
        run_sweep(world, sweep)


def _limit(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    _init_petsc(world, {}, petsc)
    with loading():
        from ddmpi.sweep.limit import find_limit

    interrupt.listen()
    find_limit(
        world,
        options.scene,
        options.set,
        options.load,
        options.output,
        figures=not options.no_figures,
    )


def _probe(folder: str | Path) -> None:
    """Refuse a folder, which may be anybody's, with pipes and devices, which have no end, or with fields that this
    process could not read without a crash."""
    from ddmpi.system.hdf5 import probe

    for path in (*Path(folder).glob("*"), *Path(folder).glob("*/*.json")):
        if path.exists() and not (path.is_file() or path.is_dir()):
            raise InputError(f"{path}: is no file")
    probe(Path(folder) / "result.h5")


def _figures(options: argparse.Namespace) -> None:
    from ddmpi.pictures.draw import draw_all

    _probe(options.folder)
    cut, *more = options.cut or [None]
    if more:
        raise InputError("argument --cut: pictures have one cut, and it is given twice")
    draw_all(
        options.folder,
        time=options.step,
        view=options.view,
        cut=cut,
        magnification=options.magnification,
    )


def _plot(options: argparse.Namespace) -> None:
    from ddmpi.sweep.plots import draw_plot

    _probe(options.folder)
    for plot in options.plots:
        print(draw_plot(Path(options.folder), plot))


def _path(options: argparse.Namespace) -> None:
    from ddmpi.results.histories import along, at_step
    from ddmpi.results.tables import read_results, reading, write_path

    folder = Path(options.folder)
    _probe(folder)
    with reading(folder):
        results = at_step(read_results(folder), folder, options.step)
        columns = along(results, getattr(options, "from"), options.to, options.points)
    path = Path(options.output or folder / "path.csv")
    write_path(path, columns)
    print(path)


def _view(options: argparse.Namespace) -> None:
    from ddmpi.pictures.browser import write_view

    _probe(options.folder)
    print(write_view(options.folder, options.output))


def _import(options: argparse.Namespace) -> None:
    from ddmpi.scene.meshes import GEOMETRIES

    with writing(Path(options.output)):  # it may be a file, or closed to us
        if options.deck.lower().endswith(GEOMETRIES[1:]):  # an assembly; a .geo is a script
            from ddmpi.check.draft import draft_scene

            print(draft_scene(options.deck, options.output))
            return
        from ddmpi.decks.scene import import_deck

        print(import_deck(options.deck, options.output, options.partial, options.amplitude))


def _report(options: argparse.Namespace) -> None:
    from ddmpi.cli.report import write_report

    _probe(options.folder)
    print(write_report(options.folder, options.output, options.step))


def _info(options: argparse.Namespace) -> None:
    from ddmpi.cli.info import describe_installation

    print(describe_installation(), end="")


def _schema(options: argparse.Namespace) -> None:
    from ddmpi.scene.scene import Scene
    from ddmpi.scene.schema import json_schema

    print(json.dumps(json_schema(Scene), indent=1, ensure_ascii=False))


ALONE = {
    "figures": _figures,
    "import": _import,
    "path": _path,
    "sweep-plot": _plot,
    "report": _report,
    "view": _view,
    "info": _info,
    "schema": _schema,
}


def _alone(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    """What the first rank does without the others."""
    interrupt.leave()
    if options.command == "info":
        _init_petsc(world, {}, petsc)
    with agreed(world), printing(world):
        if world.rank == 0:
            ALONE[options.command](options)


def _keeping(work: Command) -> Command:
    """A command that keeps meshes of drawings beside its results."""

    def keeping(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
        with loading():
            from ddmpi.mesh.cache import beside

        with beside(options.output or getattr(options, "restart", None)):
            work(world, options, petsc)

    return keeping


COMMANDS = {
    "run": _keeping(_run),
    "converge": _keeping(_run),
    "check": _keeping(_check),
    "sweep": _keeping(_sweep),
    "limit": _keeping(_limit),
} | dict.fromkeys(ALONE, _alone)


@contextlib.contextmanager
def printing(world: MPI.Comm) -> Iterator[None]:
    """What the block prints appears at its end, on rank 0 alone. Not collective. Raises OutputError on rank 0."""
    text = io.StringIO()
    with contextlib.redirect_stdout(text):
        yield
    if world.rank == 0:
        signal.signal(signal.SIGPIPE, signal.SIG_IGN)  # PETSc would print pages about it
        try:
            sys.stdout.write(logs.encodable(logs.printable(text.getvalue()), sys.stdout))
            sys.stdout.flush()
        except BrokenPipeError:  # the reader has seen enough
            logs.leave_stdout()
        except OSError as error:
            logs.leave_stdout()
            raise OutputError(
                f"what was asked for could not be printed: {error.strerror}"
            ) from None


def _init_petsc(world: MPI.Comm, table: dict, petsc: list[str]) -> None:
    """Start PETSc with a scene's options and those of the command line, which win. Collective."""
    import petsc4py
    from mpi4py import MPI

    from ddmpi.petsc.options import as_arguments, forget, instead_of_here, silence_left

    own = world.bcast(instead_of_here() if world.rank == 0 else None)
    petsc4py.init([sys.argv[0], *own, *as_arguments(table), *petsc], comm=MPI.Intracomm(world))
    if own:
        forget(own[0])
    # PETSc would end a run whose reader, such as head, has gone.
    signal.signal(signal.SIGPIPE, signal.SIG_IGN)
    atexit.register(silence_left)
