"""The command line: arguments, logging on rank 0, errors to exit codes."""

from __future__ import annotations

import argparse
import contextlib
import gc
import io
import logging
import re
import sys
import traceback
from typing import TYPE_CHECKING, NoReturn

from ddmpi import __version__
from ddmpi.errors import DdmpiError, InputError

if TYPE_CHECKING:
    from mpi4py import MPI

EPILOG = """exit codes: 0 certified answer, 2 bad input, 3 not converged, 4 a solver failed,
5 results could not be written, 6 interrupted by SIGTERM or SIGUSR1 (--restart goes on), 1 anything else.

Everything that starts with one dash is a PETSc option: -body_ksp_type cg -body_pc_type gamg for the
solves with a body's stiffness, -qp_tao_type gpcg for the contact subproblems, -log_view for times."""


class _Parser(argparse.ArgumentParser):
    """Raises InputError instead of printing on every rank."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}\n{self.format_usage().strip()}")


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
    formats = {"epilog": EPILOG, "formatter_class": argparse.RawDescriptionHelpFormatter, "allow_abbrev": False}
    run = commands.add_parser("run", help="solve a scene, on as many ranks as it has bodies",
                              parents=[scene], **formats)
    run.add_argument("--output", metavar="DIR", help="folder for the results (default: a new one in results/)")
    run.add_argument("--restart", metavar="DIR", help="go on from the checkpoint of an interrupted run in DIR, with "
                     "the same scene and options; results go there too unless --output says otherwise")
    run.add_argument("--no-figures", action="store_true", help="draw no pictures")
    commands.add_parser("verify", help="solve a small scene twice, also as the coupled problem by brute force, "
                        "and compare", parents=[scene], **formats)
    figures = commands.add_parser("figures", help="draw the pictures of saved results anew", allow_abbrev=False)
    figures.add_argument("folder", metavar="DIR")
    return parser


def split_arguments(arguments: list[str]) -> tuple[list[str], list[str]]:
    """Our own arguments, and PETSc's: those with one dash and a letter, each with its value.

    One ``--set`` may be followed by several KEY=VALUE.
    """
    own, petsc = [], []
    i = 0
    while i < len(arguments):
        if re.match(r"-[A-Za-z]", arguments[i]) and arguments[i] != "-h":
            petsc.append(arguments[i])
            if i + 1 < len(arguments) and not re.match(r"--?[A-Za-z]", arguments[i + 1]):
                i += 1
                petsc.append(arguments[i])
        elif "=" in arguments[i] and own and own[-1].startswith("--set="):
            own.append(f"--set={arguments[i]}")
        elif arguments[i] == "--set" and i + 1 < len(arguments):
            i += 1
            own.append(f"--set={arguments[i]}")
        else:
            own.append(arguments[i])
        i += 1
    return own, petsc


def main(arguments: list[str] | None = None) -> None:
    """Entry point of ``python -m ddmpi`` and ``ddmpi``; ends the process with the exit code."""
    own, petsc = split_arguments(sys.argv[1:] if arguments is None else arguments)
    from mpi4py import MPI

    world = MPI.COMM_WORLD
    try:
        code = _main(world, own, petsc)
    except BaseException as error:
        # One rank may be alone with this, so no rank may wait for it: end them all.
        if isinstance(error, DdmpiError):
            print(f"ddmpi: {error.kind}: {error}", file=sys.stderr, flush=True)
            world.Abort(error.exit_code)
        text = "".join(traceback.format_exception(error))
        print(f"ddmpi: internal error on rank {world.rank}:\n{text}", file=sys.stderr, flush=True)
        world.Abort(1)
    sys.exit(code)


def _main(world: MPI.Comm, own: list[str], petsc: list[str]) -> int:
    from ddmpi.exchange import agreed

    try:
        with agreed(world), contextlib.redirect_stdout(sys.stdout if world.rank == 0 else io.StringIO()):
            try:
                options = build_parser().parse_args(own)
            except SystemExit as end:  # --help and --version
                return end.code
        _configure_logging(world, getattr(options, "quiet", False))
        if options.command == "figures":
            from ddmpi.figures import draw_all
            draw_all(options.folder)
        else:
            _run(world, options, petsc)
    except DdmpiError as error:
        if not error.agreed and world.size > 1:
            raise
        if world.rank == 0:
            print(f"ddmpi: {error.kind}: {error}", file=sys.stderr, flush=True)
        traceback.clear_frames(error.__traceback__)
        return error.exit_code
    finally:
        gc.collect()  # PETSc objects must go before PETSc does
    return 0


def _run(world: MPI.Comm, options: argparse.Namespace, petsc: list[str]) -> None:
    from ddmpi.exchange import agreed
    from ddmpi.scene import read_scene, read_text

    with agreed(world):
        text = read_text(options.scene) if world.rank == 0 else None
    text = world.bcast(text)
    with agreed(world):
        scene = read_scene(options.scene, text, options.set)

    import petsc4py

    from ddmpi.petsc_options import as_arguments

    petsc4py.init([sys.argv[0], *as_arguments(scene.petsc), *petsc], comm=world)
    from ddmpi import interrupt
    from ddmpi.run import run, verify

    interrupt.listen()
    if options.command == "verify":
        verify(world, scene, options.scene)
    else:
        run(world, scene, options.scene, options.output, figures=scene.output.figures and not options.no_figures,
            restart=options.restart)


def _configure_logging(world: MPI.Comm, quiet: bool) -> None:
    """A handler on rank 0 only; other ranks are silent."""
    logger = logging.getLogger("ddmpi")
    logger.propagate = False
    handler: logging.Handler = logging.NullHandler()
    if world.rank == 0:
        handler = logging.StreamHandler(sys.stdout)
        handler.setFormatter(logging.Formatter("%(message)s"))
    logger.handlers = [handler]
    logger.setLevel(logging.ERROR if quiet or world.rank else logging.INFO)
