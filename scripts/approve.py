"""Writes the approved records of tests anew: scripts/study approve [--only WORD].

Runs the quick tests that have records twice at once, with Young's moduli that are larger and smaller by 1e-11, in about
a minute on a quiet machine. Numbers that differ then are rounding, and none in the records. Prints what is not as
approved before; `git diff tests/approved` has all of it. Nothing is written if a test fails otherwise. With --only the
tests whose names have the word, as of pytest's -k.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter, defaultdict
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

import approved  # noqa: E402
import transcripts  # noqa: E402

SHARE = 1e-11
"""By which moduli differ between both runs."""


Notes = dict[tuple[str, str], dict]
"""What tests have noted, by folder and test."""


def start(file: Path, share: float, only: str) -> subprocess.Popen:
    """The tests, with moduli that are larger by a share."""
    command = [sys.executable, "-P", "-m", "pytest", "-q", "-m", "not slow", "-k", only]
    command += ["-p", "no:cacheprovider"]
    command += [f"tests/{room}" for room in (*approved.RECORDED, "approved")]
    environment = os.environ | {approved.WRITTEN: str(file), approved.SHAKEN: repr(share)}
    environment |= {"OMP_NUM_THREADS": "1", "MPLBACKEND": "agg", "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, cwd=ROOT, env=environment, text=True, stdout=subprocess.PIPE)


def read(file: Path) -> Notes:
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    return {(line["folder"], line["name"]): line for line in lines}


def facts_of(line: dict) -> approved.Facts:
    groups = {key: tuple(value) for key, value in line["groups"].items()}
    return approved.Facts(groups, line["texts"])


def renew(less: Notes, more: Notes, only: str) -> list[str]:
    """Write the records of two runs; returns what is not as approved before, in words."""
    records: dict[str, dict[str, approved.Facts]] = defaultdict(dict)
    changed: Counter[str] = Counter()
    first: dict[str, str] = {}
    for (folder, name), line in less.items():
        other = more[folder, name]
        if folder == "approved":
            changed.update(transcripts.renew(name, line["text"], other["text"]))
            continue
        facts = records[folder][name] = approved.both(name, facts_of(line), facts_of(other))
        former = approved.former(folder).get(name)
        for told in approved.differences(facts, former) if former else ["tests without a record"]:
            what = told if told.startswith(("new: ", "gone: ")) else told.partition(": ")[0]
            changed[what] += 1
            first.setdefault(what, f"{name}: {told}")
    for folder, tests in records.items():
        text = approved.written(approved.former(folder) | tests if only else tests)
        approved.file_of(folder).write_text(text, encoding="utf-8")
    return [
        f"{times:4} times  {what}   {first.get(what, '')}"
        for what, times in sorted(changed.items())
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.split("\n")[0])
    parser.add_argument("--only", default="", metavar="WORD", help="tests whose names have it")
    only = parser.parse_args().only
    with tempfile.TemporaryDirectory() as folder:
        files = [Path(folder, name) for name in ("less", "more")]
        runs = [start(*each, only) for each in zip(files, (-SHARE, SHARE), strict=True)]
        said = [run.communicate()[0] for run in runs]
        for run, words in zip(runs, said, strict=True):
            if run.returncode:
                sys.exit(f"{words}\nnothing is written: a test fails, and its answer is not right")
        told = renew(read(files[0]), read(files[1]), only)
    print(
        "\n".join(
            [*told, "read git diff tests/approved before you commit it"] if told else ["as before"]
        )
    )


if __name__ == "__main__":
    main()
