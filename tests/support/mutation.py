"""A mutation study: important lines are made wrong, one at a time, and a test must fail each time.

    scripts/study mutation [--only WORD]
    scripts/study mutation --draw NUMBER --seed SEED [--seconds SECONDS] [--at-once LINES]

Works in a copy of the checkout. First the tests must pass without a mutant. Prints a table. Exit code 1 if a mutant
survives, 2 if the study itself is wrong: a text that is not there exactly once, a test that fails by itself, a mutant
that cannot be imported.

With --draw the wrong lines are drawn by lot (`drawn.py`), the first of those of this seed, and the quick tests that
reach the line are run, those of the cheapest files first, until one fails; with --at-once 2 those of two lines on two
cores. Which tests reach which lines is measured once for all seeds in one run of the quick tests (`reached.py`), and
kept in the folder of temporary files as long as neither the program nor its tests change. Counted are lines that change
an answer: all but those that mutants.py has as equivalent.
"""

import argparse
import ast
import hashlib
import itertools
import json
import os
import re
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from queue import SimpleQueue

from drawn import Drawn, draw
from mutants import EQUIVALENT, MUTANTS, Mutant

ROOT = Path(__file__).resolve().parents[2]

LIMIT = 120.0
"""Seconds after which a test counts as failed; mutants may make it hang."""

ALL = 60 * LIMIT
"""Seconds for all tests of the listed mutants, without a mutant, on a busy machine."""

FEW = 5
"""Tests of a file that are run before those of the next one."""

LEAST = 10
"""Tests that reach a line, below which those of its file are run: what is made once, such as tables, is reached once."""

MEMORY = 6 << 30
"""Bytes that a process may take; mutants may ask for more."""


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
        self._times = itertools.count(int(time.time()))
        self._environment = os.environ | {
            "PYTHONPATH": f"{self.folder}:{self.folder}/tests/support",
            "PYTHONPYCACHEPREFIX": f"{folder}/bytecode",
            "MPLBACKEND": "agg",
            "DDMPI_TEST_LIMIT": str(LIMIT),
        }

    def write(self, path: Path, source: str) -> None:
        """With a second of its own, or bytecode of a mutant of the same size would be taken for that of this one."""
        path.write_text(source, encoding="utf-8")
        second = next(self._times)
        os.utime(path, (second, second))

    def test(
        self,
        names: list[str],
        limit: float = LIMIT,
        more: Iterable[str] = ("-x",),
        **variables: str,
    ) -> tuple[int | None, str]:
        """Exit code of pytest (None where it took too long), and its output; with `more` options and variables."""
        asked = self.folder / "asked.txt"  # thousands are too many for a command
        asked.write_text("\n".join(f"tests/{name}" for name in names), encoding="utf-8")
        options = ["-p", "no:cacheprovider", *more, f"@{asked}"]
        with subprocess.Popen(
            [sys.executable, "-m", "pytest", *options],
            cwd=self.folder,
            env=self._environment | variables,
            start_new_session=True,
            text=True,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
        ) as child:
            resource.prlimit(child.pid, resource.RLIMIT_AS, (MEMORY, MEMORY))
            try:
                output, _ = child.communicate(timeout=limit)
            except subprocess.TimeoutExpired:
                os.killpg(child.pid, signal.SIGKILL)
                return None, child.communicate()[0]
            return child.returncode, output

    def try_mutant(
        self, mutant: Mutant | Drawn, tests: list[str], limit: float = LIMIT
    ) -> tuple[int | None, str]:
        path = self.folder / "ddmpi" / f"{mutant.file}.py"
        original = path.read_text(encoding="utf-8")
        source = mutant.source if isinstance(mutant, Drawn) else mutated(original, mutant)
        self.write(path, source)
        try:
            return self.test(tests, limit)
        finally:
            self.write(path, original)

    def normalize(self) -> None:
        """All modules in their normal form, so that a line that reaches a test has the number that a drawn one has."""
        for path in (self.folder / "ddmpi").rglob("*.py"):
            self.write(path, normal_form(path.read_text(encoding="utf-8")))


def normal_form(source: str) -> str:
    """A module's source without layout and comments."""
    return ast.unparse(ast.parse(source))


def places(normal: str, text: str) -> list[int]:
    """Where a text begins in a source in normal form, whatever the quotes."""
    alike = normal.replace('"', "'")
    return [found.start() for found in re.finditer(re.escape(text.replace('"', "'")), alike)]


def mutated(source: str, mutant: Mutant) -> str:
    """The source of a module, in normal form, with the mutant's wrong line."""
    return replaced(normal_form(source), mutant)


def replaced(normal: str, mutant: Mutant) -> str:
    """The same of a source in normal form."""
    (begin,) = places(normal, mutant.text)
    return normal[:begin] + mutant.replacement + normal[begin + len(mutant.text) :]


def wrong_texts(mutants: list[Mutant]) -> list[str]:
    """What is wrong with the table itself: texts that are not there once, replacements that are no Python."""
    normal = {
        file: normal_form((ROOT / "ddmpi" / f"{file}.py").read_text(encoding="utf-8"))
        for file in {mutant.file for mutant in mutants}
    }
    wrong = []
    for mutant in mutants:
        begins = places(normal[mutant.file], mutant.text)
        if len(begins) != 1:
            where = f"{len(begins)} times in ddmpi/{mutant.file}.py"
            wrong.append(f"{mutant.name}: the text is {where}")
            continue
        if "\n" not in mutant.text + mutant.replacement:
            continue  # its indentation stays, and takes no time to ask
        try:
            ast.parse(replaced(normal[mutant.file], mutant))
        except SyntaxError as error:
            wrong.append(f"{mutant.name}: the wrong line is no Python: {error}")
    return wrong


class Quick:
    """The quick tests by what they reach.

    Attributes
    ----------
    tests : by name (below tests/) its seconds and by file of ddmpi/ the numbers of the lines that it reaches
    """

    def __init__(self, checkout: Checkout, at_once: int) -> None:
        path = Path(tempfile.gettempdir(), f"ddmpi-reached-{self.digest()}.json")
        if not path.exists():
            print("measuring which lines the quick tests reach", file=sys.stderr)
            path.write_text(json.dumps(self.measured(checkout, at_once)), encoding="utf-8")
        self.tests = json.loads(path.read_text(encoding="utf-8"))

    @staticmethod
    def digest() -> str:
        found = hashlib.sha256()
        for folder in ("ddmpi", "tests"):
            for path in sorted((ROOT / folder).rglob("*.py")):
                found.update(f"{path} ".encode() + path.read_bytes())
        return found.hexdigest()[:16]

    @staticmethod
    def measured(checkout: Checkout, at_once: int) -> dict[str, dict]:
        """All quick tests that pass in this checkout; of ranks and processes the longest, and what any reaches."""
        with tempfile.TemporaryDirectory() as folder:
            checkout.test(
                [""],
                more=["-m", "not slow", "-q", *["-n", str(at_once)] * (at_once > 1)],
                limit=LIMIT * 100,
                DDMPI_REACHED=folder,
                PYTEST_PLUGINS="reached",
                DDMPI_TEST_LIMIT=str(20 * LIMIT),
            )
            written = [
                json.loads(path.read_text(encoding="utf-8")) for path in Path(folder).iterdir()
            ]
        found: dict[str, dict] = defaultdict(lambda: {"seconds": 0.0, "lines": {}})
        failed = {name for tests in written for name, test in tests.items() if "failed" in test}
        for tests in written:
            for name, test in tests.items():
                if name in failed or not name.startswith("tests/"):
                    continue
                merged = found[name.removeprefix("tests/")]
                merged["seconds"] = max(merged["seconds"], test["seconds"])
                for file, lines in test["lines"].items():
                    both = {*lines, *merged["lines"].get(file, ())}
                    merged["lines"][file] = sorted(both)
        print("\n".join(["left out, as they fail:", *sorted(failed)]), file=sys.stderr)
        return found

    def of(self, mutant: Drawn, most: float) -> list[str]:
        """Those that reach a line, or where these are few its file, as many as take `most` seconds.

        A few of each file come first, those of the line's own room and of the file whose tests take least before others,
        then the rest of the room, of all files, and last tests of other rooms on several ranks.
        """
        reaching = {
            name: mutant.line in test["lines"][mutant.file]
            for name, test in self.tests.items()
            if mutant.file in test["lines"]
        }
        if not reaching:  # what modules make as they are imported
            reaching = dict.fromkeys(self.tests, False)
        if sum(reaching.values()) >= LEAST:
            reaching = {name: True for name, reaches in reaching.items() if reaches}
        by_file: dict[str, list[str]] = defaultdict(list)
        for name in sorted(reaching, key=lambda name: self.tests[name]["seconds"]):
            by_file[name.partition("::")[0]].append(name)

        def place(name: str) -> tuple[bool, int, bool, float, str]:
            file = name.partition("::")[0]
            few, away = by_file[file][:FEW], not file.startswith(mutant.file.partition("/")[0])
            turn = 3 if away and re.search(r"\[\d\b", name) else (1 + away) * (name not in few)
            seconds = [self.tests[other]["seconds"] for other in few]
            return not reaching[name], turn, away, sum(seconds) / len(seconds), file

        ordered = sorted(reaching, key=place)
        spent = itertools.accumulate(self.tests[name]["seconds"] for name in ordered)
        return [name for name, so_far in zip(ordered, spent, strict=True) if so_far <= most]


def known(mutant: Drawn, of: list[Mutant]) -> Mutant | None:
    """The one of a list that is the same wrong line."""
    for one in of:
        if one.file == mutant.file:
            original = (ROOT / "ddmpi" / f"{one.file}.py").read_text(encoding="utf-8")
            if normal_form(mutated(original, one)) == normal_form(mutant.source):
                return one
    return None


def tried(checkout: Checkout, quick: Quick, mutant: Drawn, most: float) -> tuple[bool | None, str]:
    """Whether a test catches a drawn line, None where it changes no answer, and by which, or how many do not."""
    if one := known(mutant, EQUIVALENT):
        return None, f"the same answers: {one.tests}"
    start, tests = time.monotonic(), quick.of(mutant, most)
    limit = LIMIT + 5 * sum(quick.tests[name]["seconds"] for name in tests)
    code, output = checkout.try_mutant(mutant, tests, limit) if tests else (0, "")
    if code == 0:
        return False, f"SURVIVED of {len(tests)} tests"
    failed = re.findall(r"^(?:FAILED|ERROR) (?:tests/)?(\S+)", output, re.M)
    by = failed[0] if failed else f"pytest ended with {code}"
    return True, f"{time.monotonic() - start:.0f}: {by}"


def drawn_by_lot(number: int, seed: int, most: float, at_once: int) -> int:
    """Prints a row for each drawn line, and how many are caught of those that change an answer; the number of others."""
    print("| in `ddmpi/` | line | becomes | caught in s |", "|---|---|---|---|", sep="\n")
    drawn, found, idle = draw(ROOT / "ddmpi", number, seed), list[bool | None](), SimpleQueue()
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(at_once) as pool:
        for k in range(at_once):
            checkout = Checkout(Path(folder, str(k)))
            checkout.normalize()
            idle.put(checkout)
        quick = Quick(checkout, at_once)

        def one(mutant: Drawn) -> tuple[bool | None, str]:
            checkout = idle.get()
            try:
                return tried(checkout, quick, mutant, most)
            finally:
                idle.put(checkout)

        for mutant, (caught, end) in zip(drawn, pool.map(one, drawn), strict=True):
            found.append(caught)
            cells = [
                f"{mutant.file}.py:{mutant.line}",
                f"`{mutant.text}`",
                f"`{mutant.replacement}`",
            ]
            print("|", " | ".join([*cells, end]), "|", flush=True)
    same, survivors = found.count(None), found.count(False)
    print(
        f"\n{number - same - survivors} of {number - same} wrong lines by the seed {seed} that change an answer are "
        f"caught by quick tests; {same} change none."
    )
    return survivors


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument(
        "--only", default="", metavar="WORD", help="mutants with this word in name, file or tests"
    )
    parser.add_argument("--draw", type=int, metavar="NUMBER", help="wrong lines, drawn by lot")
    parser.add_argument("--seed", type=int, default=0, help="of the draw")
    parser.add_argument(
        "--seconds",
        type=float,
        default=float("inf"),
        help="of quick tests for each drawn line; left out, all",
    )
    parser.add_argument(
        "--at-once", type=int, default=1, metavar="LINES", help="drawn lines that are tried at once"
    )
    options = parser.parse_args()
    if options.draw:
        survivors = drawn_by_lot(options.draw, options.seed, options.seconds, options.at_once)
        return int(survivors > 0)
    return listed(options.only)


def listed(word: str) -> int:
    """Tries the listed mutants that have a word; the exit code."""
    mutants = [
        mutant
        for mutant in MUTANTS
        if any(word in part for part in (mutant.name, mutant.file, mutant.tests))
    ]
    wrong = wrong_texts(mutants) or ([] if mutants else [f"no mutant has the word {word!r}"])
    if wrong:
        print("\n".join(wrong), file=sys.stderr)
        return 2
    survivors = broken = 0
    with tempfile.TemporaryDirectory() as folder:
        checkout = Checkout(Path(folder))
        code, output = checkout.test(sorted({mutant.tests for mutant in mutants}), ALL)
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
            code, output = checkout.try_mutant(mutant, [mutant.tests])
            if code not in (0, 1, None):
                print(output, f"{mutant.name}: pytest ended with {code}", sep="\n", file=sys.stderr)
                broken += 1
                continue
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
    print(f"\n{len(mutants) - survivors - broken} of {len(mutants)} mutants are caught.")
    return 2 if broken else int(survivors > 0)


if __name__ == "__main__":
    sys.exit(main())
