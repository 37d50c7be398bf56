"""The quick ones of the studies' scripts, on tiny meshes: that they still fit the program that they measure."""

import subprocess
import sys
from pathlib import Path

import pytest
from scenes import clean_environment

ROOT = Path(__file__).resolve().parents[2]
STUDIES = {
    "compare_qp_solvers": (["--size", "6", "--types", "python", "bntr"], "No type failed on any program."),
    "reproduce_tables": (["--sizes", "6", "--laws", "tresca"], "step1+2"),
}


@pytest.mark.parametrize("name", STUDIES)
def test_study(tmp_path, name):
    arguments, word = STUDIES[name]
    done = subprocess.run([ROOT / f"scripts/{name}.py", "--output", tmp_path / "out", *arguments], text=True,
                          capture_output=True, timeout=200, cwd=tmp_path,
                          env=clean_environment() | {"DDMPI_PYTHON": sys.executable})
    assert done.returncode == 0, done.stdout + done.stderr
    written = "".join(path.read_text(encoding="utf-8") for path in (tmp_path / "out").glob("*.md"))
    assert word in written
    assert any((tmp_path / "out").glob("*.csv"))
