"""The command line: arguments, logging on rank 0, errors to exit codes."""

from __future__ import annotations

import argparse
import atexit
import contextlib
import gc
import io
import os
import re
import signal
import sys
import traceback
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, NoReturn

from ddmpi import __version__, interrupt, logs
from ddmpi.errors import DdmpiError, InputError, OutputError

if TYPE_CHECKING:
    from mpi4py import MPI

EPILOG = """exit codes: 0 certified answer, 2 bad input, 3 not converged, 4 a solver failed,
5 results could not be written, 6 interrupted by SIGTERM or SIGUSR1 (--restart goes on), 1 anything else.

Everything that starts with one dash is a PETSc option: -body_ksp_type cg -body_pc_type gamg for the
solves with a body's stiffness, -qp_tao_type gpcg for the contact subproblems, -log_view for times."""


REPEATED = ("--set=", "--vary=")
"""Arguments that may be followed by several KEY=VALUE."""


class _Parser(argparse.ArgumentParser):
    """Raises InputError instead of printing on every rank."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}\n{self.format_usage().strip()}")


def _named(word: str) -> str:
    if not word:
        raise argparse.ArgumentTypeError("an empty name (a variable of the shell that is not set?)")
    return word


def build_parser() -> argparse.ArgumentParser:
    """The parser of everything that is not a PETSc option."""
    parser = _Parser(
        prog="ddmpi", description="Contact of elastic bodies with friction, by domain decomposition on MPI.",
        epilog=EPILOG, formatter_class=argparse.RawDescriptionHelpFormatter, allow_abbrev=False)
    parser.add_argument("--version", action="version", version=f"ddmpi {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    scene = argparse.ArgumentParser(add_help=False)
    scene.add_argument("scene", metavar="SCENE.toml")
    scene.add_argument("--set", action="append", default=[], metavar="KEY=VALUE",
                       help="override any key of the scene, as in body.upper.material.young=1e9")
    scene.add_argument("--quiet", action="store_true", help="say nothing but errors")
    scene.add_argument("--log", type=_named, metavar="FILE", help="append everything that is said to FILE, with time "
                       "stamps, also what --quiet keeps off the screen")
    formats = {"epilog": EPILOG, "formatter_class": argparse.RawDescriptionHelpFormatter, "allow_abbrev": False}
    run = commands.add_parser("run", help="solve a scene, on as many ranks as it has bodies",
                              parents=[scene], **formats)
    run.add_argument("--output", type=_named, metavar="DIR",
                     help="folder for the results (default: a new one in results/)")
    run.add_argument("--restart", type=_named, metavar="DIR", help="go on from the checkpoint of an interrupted run in "
                     "DIR, with the same scene and options; results go there too unless --output says otherwise")
    run.add_argument("--no-figures", action="store_true", help="draw no pictures")
    commands.add_parser("verify", help="solve a small scene twice, also as the coupled problem by brute force, "
                        "and compare", parents=[scene], **formats)
    _add_sweep(commands, scene, formats)
    figures = commands.add_parser("figures", help="draw the pictures of saved results anew", allow_abbrev=False)
    figures.add_argument("folder", type=_named, metavar="DIR")
    plot = commands.add_parser("sweep-plot", help="draw a result of a sweep against a parameter", allow_abbrev=False)
    plot.add_argument("folder", type=_named, metavar="DIR", help="folder of the sweep")
    plot.add_argument("plots", nargs="+", metavar="RESULT:KEY", help="two columns of its table, as in n_A:theta")
    commands.add_parser("info", help="print versions and which solvers are there", allow_abbrev=False)
    return parser


def _add_sweep(commands: argparse._SubParsersAction, scene: argparse.ArgumentParser, formats: dict) -> None:
    sweep = commands.add_parser("sweep", help="run a scene for all combinations of some values",
                                parents=[scene], **formats)
    sweep.add_argument("--vary", action="append", default=[], metavar="KEY=VALUES",
                       help="values of a key of the scene: first:last:number, the same with :log at the end, or "
                       "value,value,…; KEY,KEY=VALUES vary together")
    sweep.add_argument("--output", type=_named, metavar="DIR", required=True,
                       help="folder of the sweep; cases that are finished there are not run again")
    sweep.add_argument("--index", metavar="I", help="run case number I only, or as I/N every N-th case from I on "
                       "(of a job array: --index $SLURM_ARRAY_TASK_ID)")
    only = sweep.add_mutually_exclusive_group()
    only.add_argument("--list", action="store_true", help="run nothing, list the cases and how they ended")
    only.add_argument("--gather", action="store_true", help="run nothing, write the table of what is there")
    sweep.add_argument("--plot", action="append", default=[], metavar="RESULT:KEY",
                       help="draw one column of the table against another, as in n_A:theta")
    sweep.add_argument("--figures", action="store_true", help="draw the pictures of every case")


def split_arguments(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Our own arguments, and PETSc's: those with one dash and a letter, each with its value.

    One ``--set`` or ``--vary`` may be followed by several KEY=VALUE.
    """
    own, petsc = [], []
    i = 0
    while i < len(arguments):
        if re.match(r"-[A-Za-z]", arguments[i]) and arguments[i] != "-h":
            petsc.append(arguments[i])
            if i + 1 < len(arguments) and not re.match(r"--?[A-Za-z]", arguments[i + 1]):
                i += 1
                petsc.append(arguments[i])
        elif "=" in arguments[i] and arguments[i][0] != "-" and own and own[-1].startswith(REPEATED):
            own.append(f"{own[-1].partition('=')[0]}={arguments[i]}")
        elif f"{arguments[i]}=" in REPEATED and i + 1 < len(arguments):
            i += 1
            own.append(f"{arguments[i - 1]}={arguments[i]}")
        else:
            own.append(arguments[i])
        i += 1
    return own, petsc


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
    from ddmpi.exchange import agreed
    from ddmpi.provenance import command, whereabouts

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
    from ddmpi.exchange import agreed
    from ddmpi.scene import read_scene

    text = _scene_text(world, options)
    with agreed(world):
        scene = read_scene(options.scene, text, options.set)
    _init_petsc(world, scene.petsc, petsc)
    from ddmpi.run import run, verify

    interrupt.listen()
    if options.command == "verify":
        verify(world, scene, options.scene)
    else:
        run(world, scene, options.scene, options.output, figures=scene.output.figures and not options.no_figures,
            restart=options.restart)


def _sweep(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    from ddmpi.cases import build_cases, choose
    from ddmpi.exchange import agreed

    text = _scene_text(world, options)
    with agreed(world):
        cases = build_cases(options.scene, text, options.set, options.vary)
        chosen = choose(cases, options.index)
    tables = [case.scene.petsc for case in cases]
    _init_petsc(world, {name: value for name, value in tables[0].items()
                        if all(table.get(name) == value for table in tables)}, petsc)
    from ddmpi.sweep import Sweep, gather_sweep, list_cases, run_sweep

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
    from ddmpi.exchange import agreed
    from ddmpi.figures import draw_all
    from ddmpi.sweep_figures import draw_plots

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
    from ddmpi.exchange import agreed
    from ddmpi.info import describe_installation

    with agreed(world), _printing(world):
        if world.rank == 0:
            print(describe_installation(), end="")


COMMANDS = {"run": _run, "verify": _run, "sweep": _sweep, "figures": _draw, "sweep-plot": _draw, "info": _info}


def _scene_text(world: MPI.Comm, options: argparse.Namespace) -> str:
    """The scene as rank 0 reads it. Collective."""
    from ddmpi.exchange import agreed
    from ddmpi.scene import read_text

    with agreed(world):
        text = read_text(options.scene) if world.rank == 0 else None
    return world.bcast(text)


def _init_petsc(world: MPI.Comm, table: dict, petsc: list[str]) -> None:
    """Start PETSc with a scene's options and those of the command line, which win. Collective."""
    import petsc4py

    from ddmpi.petsc_options import as_arguments

    petsc4py.init([sys.argv[0], *as_arguments(table), *petsc], comm=world)
    from ddmpi.petsc_options import silence_left

    atexit.register(silence_left)
