"""The arguments of the command line."""

import argparse
import re
from collections.abc import Callable
from typing import Any, NoReturn

from ddmpi import __version__
from ddmpi.errors import InputError

EPILOG = """exit codes: 0 certified answer, 2 bad input, 3 not converged, 4 a solver failed,
5 results could not be written, 6 interrupted (--restart goes on), 1 anything else.

Everything that starts with one dash is a PETSc option: -body_ksp_type cg -body_pc_type gamg for the
solves with a body's stiffness, -qp_tao_type gpcg for the contact subproblems, -log_view for times."""

IMPORT = (
    "Write scene.toml and its meshes from an Abaqus or CalculiX deck, and list by lines what was "
    "taken, what was changed and what is lost. Where a load, a support or a contact would be "
    "lost, nothing is written. From an assembly (.step, .brep) it writes an incomplete scene: the"
    " parts, and contacts where they touch."
)

VIEW = (
    "Write a view of a run: one HTML file that turns the bodies in a browser, with stresses, "
    "displacements and contact pressures, load steps and a cut. It needs no other file and no "
    "network."
)

REPORT = (
    "Write a report of a run, converged or not, or of a sweep: one HTML file with its verdict, "
    "warnings, pictures, numbers, certificate, scene and versions. It needs no other file and no "
    "network, so it can be mailed."
)

REPEATED = ("--set=", "--vary=")  # they may be followed by several KEY=VALUE

SIGNED = ("--from=", "--to=", "--view=", "--cut=")  # their values may begin with a minus


class _Parser(argparse.ArgumentParser):
    """Raises InputError instead of printing on every rank."""

    def error(self, message: str) -> NoReturn:
        raise InputError(f"{message}\n{self.format_usage().strip()}")


def _named(word: str) -> str:
    if not word:
        raise argparse.ArgumentTypeError("an empty name (a variable of the shell that is not set?)")
    return word


def _point(word: str) -> list[float]:
    try:
        return [float(coordinate) for coordinate in word.split(",")]
    except ValueError:
        raise argparse.ArgumentTypeError(
            f"{word!r} is no point; write it as 0,0.5 or 0,0,1"
        ) from None


def _view(word: str) -> str | list[float]:
    return _point(word) if "," in word else word


def _cut(word: str) -> dict[str, float]:
    axis, _, at = word.partition("=")
    try:
        return {axis: float(at)}
    except ValueError:
        raise argparse.ArgumentTypeError(f"{word!r} is no cut; write it as x=0.5") from None


def build_parser() -> argparse.ArgumentParser:
    """The parser of everything that is not a PETSc option."""
    parser = _Parser(
        prog="ddmpi",
        description="Frictional contact of linear elastic bodies, 3D, axisymmetric or plane, by domain "
        "decomposition on MPI.",
        epilog=EPILOG,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"ddmpi {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    def command(name: str, words: str, *parents: _Parser, **more: Any) -> _Parser:
        return commands.add_parser(name, help=words, parents=parents, allow_abbrev=False, **more)

    _add_solving(command)
    _add_import(command)
    _add_reading(command)
    command("info", "print versions and the available solvers")
    command("schema", "print the JSON schema of scenes, for editors")
    return parser


def _add_solving(command: Callable[..., _Parser]) -> None:
    """Add the commands that read a scene."""
    scene, written = _Parser(add_help=False), _Parser(add_help=False)
    scene.add_argument("scene", metavar="SCENE.toml", help="the scene")
    scene.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="override any key of the scene, as in body.upper.material.young=1e9",
    )
    scene.add_argument("--quiet", action="store_true", help="print nothing but errors and warnings")
    scene.add_argument(
        "--log",
        type=_named,
        metavar="FILE",
        help="append all messages to FILE, with time stamps, "
        "also those that --quiet keeps off the screen",
    )
    written.add_argument(
        "--output",
        type=_named,
        metavar="DIR",
        help="folder for what is written (default: a new one in results/)",
    )
    written.add_argument("--no-figures", action="store_true", help="draw no pictures")
    solving = {"epilog": EPILOG, "formatter_class": argparse.RawDescriptionHelpFormatter}
    run = command(
        "run", "solve a scene, best on as many ranks as it has bodies", scene, written, **solving
    )
    run.add_argument(
        "--errors",
        action="store_true",
        help='tell the errors of the main results by the mesh: output.errors = "main"',
    )
    run.add_argument(
        "--restart",
        type=_named,
        metavar="DIR",
        help="continue the interrupted run in DIR from its "
        "checkpoint, with the same scene and options; results go to DIR, too, or to --output",
    )
    converge = command(
        "converge",
        "solve a scene on finer and finer meshes until the error bar of a result is small",
        scene,
        written,
        **solving,
    )
    _add_target(converge)
    words = "find the factor of a load at which equilibrium ends, and how the bodies then move"
    _add_load(command("limit", words, scene, written, **solving))
    command("check", "describe and draw a scene without solving it", scene, written, **solving)
    _add_sweep(
        command("sweep", "run a scene for all combinations of some values", scene, **solving)
    )


def _add_load(limit: _Parser) -> None:
    limit.add_argument(
        "--load",
        required=True,
        metavar="LOAD",
        help="a history, whose factors are multiplied, or the key of a load, as in body.foot.traction.0",
    )


def _add_target(converge: _Parser) -> None:
    converge.add_argument(
        "--of",
        required=True,
        metavar="NAME",
        help="the result, as in contacts.fit.normal_force: method.target has no other one then",
    )
    converge.add_argument(
        "--within",
        type=float,
        default=0.01,
        metavar="PART",
        help="largest error bar over the value (default: 0.01)",
    )


def _add_import(command: Callable[..., _Parser]) -> None:
    deck = command(
        "import",
        "write a scene from an Abaqus or CalculiX deck, or a first one from an assembly (.step, .brep)",
        description=IMPORT,
    )
    deck.add_argument(
        "deck", type=_named, metavar="FILE", help="a deck (.inp) or an assembly (.step, .brep)"
    )
    deck.add_argument(
        "--output",
        type=_named,
        metavar="FOLDER",
        required=True,
        help="folder for the scene and its meshes; nothing is overwritten",
    )
    deck.add_argument(
        "--amplitude",
        action="append",
        default=[],
        metavar="NAME=TIME,FACTOR,…",
        help="times and factors of an *AMPLITUDE, such as one by a user routine",
    )
    deck.add_argument(
        "--partial", action="store_true", help="write the scene without the cards that are lost"
    )


def _add_reading(command: Callable[..., _Parser]) -> None:
    """Add the commands that read a folder of results."""
    results = _Parser(add_help=False)
    results.add_argument("folder", type=_named, metavar="DIR", help="folder of results")
    results.add_argument(
        "--step",
        type=float,
        metavar="TIME",
        help="time of the load step to show, of those whose "
        "fields are written (default: the one of the largest load)",
    )
    _add_figures(command("figures", "draw the pictures of saved results anew", results))
    view = command(
        "view",
        "write one HTML file in which the results turn in a browser",
        description=VIEW,
    )
    view.add_argument("folder", type=_named, metavar="DIR", help="folder of results")
    _add_file(view, "DIR/view.html", "an earlier view")
    path = command(
        "path",
        "write displacements and stresses along a straight line through the bodies as a table",
        results,
    )
    for name, words in ("from", "first point, as in 0,0.5 or 0,0,1"), ("to", "last point"):
        path.add_argument(
            f"--{name}", type=_point, metavar="X,Y", dest=name, required=True, help=words
        )
    path.add_argument(
        "--points",
        type=int,
        metavar="N",
        default=101,
        help="number of points, equally spaced (default: 101)",
    )
    _add_file(path, "DIR/path.csv", "the table of an earlier path")
    plot = command("sweep-plot", "draw a result of a sweep against a parameter")
    plot.add_argument("folder", type=_named, metavar="DIR", help="folder of the sweep")
    plot.add_argument(
        "plots", nargs="+", metavar="RESULT:KEY", help="two columns of its table, as in n_A:theta"
    )
    report = command(
        "report",
        "write one HTML file that reports a run or a sweep",
        results,
        description=REPORT,
    )
    _add_file(report, "DIR/report.html", "an earlier report")


def _add_figures(figures: _Parser) -> None:
    figures.add_argument(
        "--view",
        type=_view,
        metavar="VIEW",
        help="viewpoint of 3D pictures: front, back, left, "
        "right, top, bottom, iso, or azimuth and elevation in degrees, as in -60,24",
    )
    figures.add_argument(
        "--cut",
        type=_cut,
        action="append",
        metavar="AXIS=COORDINATE",
        help="cut 3D bodies open, as in x=0.5",
    )
    figures.add_argument(
        "--magnification",
        type=float,
        metavar="F",
        help="enlargement of displacements (default: automatic)",
    )


def _add_file(parser: _Parser, default: str, earlier: str) -> None:
    """Add the argument of a command that writes one file, by default `default`, over an `earlier` one alone."""
    parser.add_argument(
        "--output",
        type=_named,
        metavar="FILE",
        help=f"file to write (default: {default}); {earlier} is overwritten, any other file is not",
    )


def _add_sweep(sweep: _Parser) -> None:
    sweep.add_argument(
        "--vary",
        action="append",
        default=[],
        metavar="KEY=VALUES",
        help="values of a key of the scene: first:last:number, the same with :log at the end, or "
        "value,value,…; KEY,KEY=VALUES vary together",
    )
    sweep.add_argument(
        "--output",
        type=_named,
        metavar="DIR",
        required=True,
        help="folder of the sweep; finished cases are not run again",
    )
    sweep.add_argument(
        "--index",
        metavar="I",
        help="run case number I only, or as I/N every N-th case from I on "
        "(of a job array: --index $SLURM_ARRAY_TASK_ID)",
    )
    only = sweep.add_mutually_exclusive_group()
    only.add_argument(
        "--list", action="store_true", help="run nothing; list the cases and how they ended"
    )
    only.add_argument(
        "--gather", action="store_true", help="run nothing; write the table of finished cases"
    )
    sweep.add_argument(
        "--plot",
        action="append",
        default=[],
        metavar="RESULT:KEY",
        help="draw one column of the table against another, as in n_A:theta",
    )
    sweep.add_argument("--figures", action="store_true", help="draw the pictures of every case")


def split_arguments(arguments: list[str]) -> tuple[list[str], list[str]]:
    """The arguments of ddmpi, and PETSc's: those with one dash and a letter, each with its value.

    One ``--set`` or ``--vary`` may be followed by several KEY=VALUE.
    """
    ours: list[str] = []
    petsc: list[str] = []
    words = list(arguments)
    while words:
        word = words.pop(0)
        if re.match(r"-[A-Za-z]", word) and word != "-h":
            petsc.append(word)
            if words and not re.match(r"--?[A-Za-z]", words[0]):
                petsc.append(words.pop(0))
        elif f"{word}=" in REPEATED + SIGNED and words:
            ours.append(f"{word}={words.pop(0)}")
        elif "=" in word and word[0] != "-" and ours and ours[-1].startswith(REPEATED):
            ours.append(f"{ours[-1].partition('=')[0]}={word}")
        else:
            ours.append(word)
    return ours, petsc
