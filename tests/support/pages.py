"""Runs the commands of a page as its reader would, and compares what they print with what the page shows.

    scripts/study pages docs/start/tutorial.md            # says what differs
    scripts/study pages docs/start/tutorial.md --write    # also writes its pictures, docs/figures/tutorial_*.png

Three things in a page count. A block whose first line is a comment with a file name (``# bracket.toml``) is that file.
In a block of the language ``console`` lines after ``$`` are commands; the other lines are what they print, ``…`` in the
place of what is left out. A command ends with exit code 0, unless the next one is ``echo $?``. An image
``![words](../figures/PICTURE.png "FILE")`` is made from FILE, a result of these commands.

All run in order in one shell, in a folder that has the parts of this repository which a reader uses. Where a page says
``gmsh 4.15.2``, numbers agree in all digits that it shows, but for one unit of the last, if gmsh is of that version;
others make other meshes, and numbers agree to a fifth.
"""

from __future__ import annotations

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from decimal import Decimal
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]

FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.M | re.S)
NAME = re.compile(r"(?://|#) ([\w./-]+\.\w+)$")
IMAGE = re.compile(r'!\[[^\]]*\]\(((?:\.\./)*figures/[\w.-]+) "([^"]+)"\)')
NUMBER = re.compile(r"(?<![\w.])[-+]?\d+(?:\.\d+)?(?:e[-+]?\d+)?(?![\w])")

ROUNDING = 1e-6
"""Numbers below this, such as residuals, are what rounding has left, and all the same."""

ELSEWHERE = 0.2
"""How far, in part of themselves, numbers may differ where gmsh is of another version than that of the page."""

SBATCH = """#!/usr/bin/env bash
# Runs the job at once, as a Slurm of one node would
SLURM_SUBMIT_DIR=$PWD SLURM_JOB_ID=1 SLURM_JOB_NODELIST=here bash "$@" >ddmpi-1.out 2>&1 && echo "Submitted batch job 1"
"""


@dataclass(frozen=True)
class File:
    """A file that the reader writes."""

    name: str
    text: str


@dataclass(frozen=True)
class Command:
    """A command, and the lines that the page shows below it."""

    text: str
    shown: tuple[str, ...]


@dataclass(frozen=True)
class Outcome:
    """What became of a command."""

    command: Command
    code: int
    printed: tuple[str, ...]


def blocks(page: str) -> list[File | Command]:
    """The files and commands of a page, in order."""
    found: list[File | Command] = []
    for language, text in FENCE.findall(page):
        name = NAME.match(text.splitlines()[0])
        if language == "console":
            for part in re.split(r"^\$ ", text, flags=re.M)[1:]:
                command, *shown = part.replace("\\\n", "\\\0").splitlines()
                found.append(
                    Command(
                        command.replace("\0", "\n"), tuple(line for line in shown if line.strip())
                    )
                )
        elif name:
            found.append(File(name[1], text))
    return found


def run(
    page: str, folder: Path, environment: dict[str, str], limit: float = 600.0
) -> list[Outcome]:
    """Write the files and run the commands of a page in an empty `folder`, in `limit` seconds."""
    for part in ("configs", "ddmpi", "meshes", "pyproject.toml", "scripts"):
        (folder / part).symlink_to(ROOT / part)
    programs, printed = folder / ".venv" / "bin", folder / ".printed"
    programs.mkdir(parents=True)
    printed.mkdir()
    for name, text in (
        ("python", f'#!/bin/sh\nexec {shlex.quote(sys.executable)} "$@"\n'),
        ("sbatch", SBATCH),
    ):
        (programs / name).write_text(text, encoding="utf-8")
        (programs / name).chmod(0o755)
    lines, commands = ["code=0"], []
    for block in blocks(page):
        if isinstance(block, File):
            lines.append(f"cat >{block.name} <<'END OF FILE'\n{block.text}END OF FILE")
        else:
            here = shlex.quote(f"{printed}/{len(commands)}")
            lines.append(
                f"(exit $code)\n{{ {block.text}\n}} >{here} 2>&1\ncode=$?\necho $code >{here}.code"
            )
            commands.append(block)
    (folder / ".page.sh").write_text("\n".join([*lines, "exit 0"]), encoding="utf-8")
    variables = environment | {
        "PATH": f"{programs}:{environment['PATH']}",
        "DDMPI_PYTHON": sys.executable,
    }
    subprocess.run(
        ["timeout", "-k", "5", str(limit), "bash", ".page.sh"],
        cwd=folder,
        env=variables,
        check=True,
    )
    return [
        Outcome(
            command,
            int((printed / f"{k}.code").read_text()),
            tuple((printed / str(k)).read_text(encoding="utf-8").splitlines()),
        )
        for k, command in enumerate(commands)
    ]


def differences(outcomes: list[Outcome], slack: float = 0.0) -> list[str]:
    """What a page says of its commands and what they did not do."""
    found = []
    for k, outcome in enumerate(outcomes):
        asked = k + 1 < len(outcomes) and outcomes[k + 1].command.text == "echo $?"
        said = "\n".join(outcome.printed)
        if outcome.code and not asked:
            found.append(f"$ {outcome.command.text}\nends with exit code {outcome.code}:\n{said}")
        found += [
            f"$ {outcome.command.text}\ndoes not print\n{line}\nbut\n{said}"
            for line in outcome.command.shown
            if line.strip() != "…"
            and not any(agrees(line, other, slack) for other in outcome.printed)
        ]
    return found


def agrees(shown: str, printed: str, slack: float = 0.0) -> bool:
    """Whether a printed line is the one that is shown."""
    pattern, at = "", 0
    for number in NUMBER.finditer(shown):
        pattern += _words(shown[at : number.start()]) + f"({NUMBER.pattern})"
        at = number.end()
    match = re.fullmatch(pattern + _words(shown[at:]), printed.strip())
    return match is not None and all(
        _equal(one[0], other, slack)
        for one, other in zip(NUMBER.finditer(shown), match.groups(), strict=True)
    )


def _words(text: str) -> str:
    """The pattern of what stands between numbers: any blanks for blanks, anything for …"""
    parts = re.split(r"(…|\s+)", text)
    return "".join(
        ".*" if part == "…" else r"\s*" if part.isspace() else re.escape(part) for part in parts
    )


def _equal(shown: str, printed: str, slack: float) -> bool:
    a, b = Decimal(shown), Decimal(printed)
    if max(abs(a), abs(b)) < ROUNDING:
        return True
    unit = 0 if shown.lstrip("+-").isdigit() else Decimal(1).scaleb(int(a.as_tuple().exponent))
    return abs(a - b) <= unit + Decimal(slack) * abs(a)


def slack(page: str) -> float:
    """How far numbers may differ from those of a page: not at all with its version of gmsh."""
    import gmsh

    named = re.search(r"gmsh (\d+\.\d+\.\d+)", page)
    return 0.0 if named and named[1] == gmsh.__version__ else ELSEWHERE


def write_pictures(page: str, made: Path, docs: Path) -> list[str]:
    """Write the pictures of a page from the folder in which its commands ran, without the names of folders and hosts
    that a run leaves in them; their names."""
    from PIL import Image

    names = [(docs / picture, made / result) for picture, result in IMAGE.findall(page)]
    for picture, result in names:
        with Image.open(result) as drawn:
            drawn.save(picture, optimize=True)
    return [str(picture) for picture, _ in names]


def main() -> int:
    """The command above."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("page", type=Path)
    parser.add_argument("--write", action="store_true", help="write the pictures of the page")
    chosen = parser.parse_args()
    page = chosen.page.read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory() as folder:
        outcomes = run(page, Path(folder), dict(os.environ))
        found = differences(outcomes, slack(page))
        print("\n\n".join([*found, f"{len(outcomes)} commands, {len(found)} differences"]))
        if chosen.write:
            print("\n".join(write_pictures(page, Path(folder), chosen.page.parent)))
    return 1 if found else 0


if __name__ == "__main__":
    sys.exit(main())
