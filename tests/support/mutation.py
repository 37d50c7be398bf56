"""A mutation study: important lines are made wrong, one at a time, and a test must fail each time.

    scripts/study mutation [--only WORD]

Works in a copy of the checkout. First the tests must pass without a mutant. Prints a table. Exit code 1 if a mutant
survives, 2 if the study itself is wrong: a text that is not there exactly once, a test that fails by itself, a mutant
that cannot be imported.
"""

import argparse
import ast
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from mutants import MUTANTS, Mutant

ROOT = Path(__file__).resolve().parents[2]

LIMIT = 120.0
"""Seconds after which a test counts as failed; mutants may make it hang."""


class Checkout:
    """A copy of the checkout in `folder`, in which tests run one after another."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder / "ddmpi"
        for name in ("ddmpi", "tests", "scripts", "configs", "meshes", "docs"):
            shutil.copytree(
                ROOT / name, self.folder / name, ignore=shutil.ignore_patterns("__pycache__")
            )
        for file in ROOT.glob("*.*"):
            if file.is_file():
                shutil.copy(file, self.folder)
        # Without bytecode: a mutant of the same size, made in the same second, would not be noticed.
        self._environment = os.environ | {
            "PYTHONPATH": str(self.folder),
            "PYTHONDONTWRITEBYTECODE": "1",
            "MPLBACKEND": "agg",
        }

    def test(self, names: list[str], limit: float = LIMIT) -> tuple[int | None, str]:
        """Exit code of pytest (None where it took too long), and its output."""
        command = [
            sys.executable,
            "-m",
            "pytest",
            "-x",
            "-p",
            "no:cacheprovider",
            *(f"tests/{name}" for name in names),
        ]
        with subprocess.Popen(
            command,
            cwd=self.folder,
            env=self._environment,
            start_new_session=True,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        ) as child:
            try:
                output, _ = child.communicate(timeout=limit)
            except subprocess.TimeoutExpired:
                os.killpg(child.pid, signal.SIGKILL)
                return None, child.communicate()[0]
            return child.returncode, output

    def try_mutant(self, mutant: Mutant) -> tuple[int | None, str]:
        path = self.folder / "ddmpi" / f"{mutant.file}.py"
        original = path.read_text(encoding="utf-8")
        path.write_text(mutated(original, mutant), encoding="utf-8")
        try:
            return self.test([mutant.tests])
        finally:
            path.write_text(original, encoding="utf-8")


def normal_form(source: str) -> str:
    """A module's source without layout and comments."""
    return ast.unparse(ast.parse(source))


def places(normal: str, text: str) -> list[int]:
    """Where a text begins in a source in normal form, whatever the quotes."""
    alike = normal.replace('"', "'")
    return [found.start() for found in re.finditer(re.escape(text.replace('"', "'")), alike)]


def mutated(source: str, mutant: Mutant) -> str:
    """The source of a module, in normal form, with the mutant's wrong line."""
    normal = normal_form(source)
    (begin,) = places(normal, mutant.text)
    return normal[:begin] + mutant.replacement + normal[begin + len(mutant.text) :]


def wrong_texts(mutants: list[Mutant]) -> list[str]:
    """What is wrong with the table itself."""
    files = {mutant.file for mutant in mutants}
    normal = {
        file: normal_form((ROOT / "ddmpi" / f"{file}.py").read_text(encoding="utf-8"))
        for file in files
    }
    counts = [len(places(normal[mutant.file], mutant.text)) for mutant in mutants]
    return [
        f"{mutant.name}: the text is {count} times in ddmpi/{mutant.file}.py"
        for mutant, count in zip(mutants, counts, strict=True)
        if count != 1
    ]


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--only", default="", metavar="WORD", help="mutants with this word in name, file or tests"
    )
    word = parser.parse_args().only
    mutants = [
        mutant
        for mutant in MUTANTS
        if any(word in part for part in (mutant.name, mutant.file, mutant.tests))
    ]
    wrong = wrong_texts(mutants) or ([] if mutants else [f"no mutant has the word {word!r}"])
    if wrong:
        print("\n".join(wrong), file=sys.stderr)
        return 2
    survivors = 0
    with tempfile.TemporaryDirectory() as folder:
        checkout = Checkout(Path(folder))
        code, output = checkout.test(sorted({mutant.tests for mutant in mutants}), 10 * LIMIT)
        if code != 0:
            print(output, "these tests fail without a mutant", sep="\n", file=sys.stderr)
            return 2
        print(
            "| in `ddmpi/` | mutant | test in `tests/` | caught in s |",
            "|---|---|---|---|",
            sep="\n",
            flush=True,
        )
        for mutant in mutants:
            start = time.monotonic()
            code, output = checkout.try_mutant(mutant)
            if code not in (0, 1, None):
                print(output, f"{mutant.name}: pytest ended with {code}", sep="\n", file=sys.stderr)
                return 2
            survivors += code == 0
            end = (
                "SURVIVED"
                if code == 0
                else f"{time.monotonic() - start:.1f}" + " (time limit)" * (code is None)
            )
            print(
                f"| {mutant.file}.py | {mutant.name} | {mutant.tests.replace('::', ': ')} | {end} |",
                flush=True,
            )
    print(f"\n{len(mutants) - survivors} of {len(mutants)} mutants are caught.")
    return int(survivors > 0)


if __name__ == "__main__":
    sys.exit(main())
