"""Writes the approved transcripts of tests anew: scripts/study approve [--only WORD].

Runs the tests of tests/approved twice at once, in about half a minute on a quiet machine: with Young's moduli that are
larger and smaller by 1e-11, and with the kernels of BLAS and numpy of this processor and of an old one. Numbers that
differ then are rounding, and ~ in the transcripts. Nothing is written if a test fails otherwise. Prints which are not as
approved before; `git diff tests/approved` has all of it. With --only the tests whose names have the word, as of pytest's
-k.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests" / "support"))

import transcripts  # noqa: E402

SHARE = 1e-11
"""By which moduli differ between both runs."""

OLD = {
    "OPENBLAS_CORETYPE": "Prescott",
    "NPY_DISABLE_CPU_FEATURES": "AVX2 FMA3 AVX512F AVX512CD AVX512_SKX AVX512_CLX AVX512_CNL AVX512_ICL",
}
"""What has the sums of another processor."""


def start(file: Path, share: float, only: str) -> subprocess.Popen:
    """The tests, with moduli that are larger by a share, and then with kernels of an old processor."""
    command = [sys.executable, "-P", "-m", "pytest", "-q", "-m", "not slow", "-k", only]
    command += ["-p", "no:cacheprovider", "tests/approved"]
    environment = os.environ | {transcripts.WRITTEN: str(file), transcripts.SHAKEN: repr(share)}
    if share > 0.0:
        environment |= OLD
    environment |= {"OMP_NUM_THREADS": "1", "MPLBACKEND": "agg", "PYTHONPATH": str(ROOT)}
    return subprocess.Popen(command, cwd=ROOT, env=environment, text=True, stdout=subprocess.PIPE)


def read(file: Path) -> dict[str, list[str]]:
    lines = [json.loads(line) for line in file.read_text(encoding="utf-8").splitlines()]
    return {line["name"]: line["text"] for line in lines}


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
        less, more = map(read, files)
    told = [line for name in less for line in transcripts.renew(name, less[name], more[name])]
    if told:
        told.append("read git diff tests/approved before you commit it")
    print("\n".join(told or ["as before"]))


if __name__ == "__main__":
    main()
