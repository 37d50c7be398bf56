"""What tests/conftest.py makes of pytest; test.sh, check.sh and setup.sh of scripts/."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
import scenes

def run(*command: str | Path, cwd: Path, code: int = 0, **environment: str) -> str:
    """What a command prints, without the settings of ddmpi's scripts."""
    clean = {key: value for key, value in scenes.clean_environment().items() if not key.startswith("DDMPI_")}
    done = subprocess.run(command, cwd=cwd, env=clean | environment, timeout=scenes.LIMIT, text=True,
                          stdout=subprocess.PIPE, stderr=subprocess.STDOUT)
    assert done.returncode == code, done.stdout
    return done.stdout


# Tests on several ranks

EXAMPLE = """
import time
import pytest

@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("rank", [0, 1])
def test_bad(comm, mpi_ranks, rank):
    assert comm.rank != rank

@pytest.mark.mpi(ranks=2)
def test_good(comm, mpi_ranks):
    pass

@pytest.mark.mpi(ranks=2)
def test_hangs(comm, mpi_ranks):
    time.sleep(30 if comm.rank else 0)
"""


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """A folder with this conftest.py and tests of two ranks, three of which fail."""
    for name in ("conftest.py", "scenes.py"):
        shutil.copy(scenes.ROOT / "tests" / name, tmp_path)
    (tmp_path / "test_example.py").write_text(EXAMPLE)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n    mpi\n")
    return tmp_path


def test_ranks_report_under_the_name_of_their_test(example):
    """Names can be pasted back, --lf finds failures of any rank, the progress ends at 100 %, and a hang has an end."""
    pytest_ = (sys.executable, "-m", "pytest")
    said = run(*pytest_, cwd=example, code=1, DDMPI_TEST_LIMIT="5")
    names = [f"test_example.py::test_{name}" for name in ("bad[2-0]", "bad[2-1]", "hangs[2]")]
    assert re.findall(r"^FAILED (\S+)", said, re.M) == names
    assert all(f"- on rank {rank} -" in said for rank in (0, 1)) and "time limit of 5.0s" in said
    assert re.findall(r"\[ *(\d+)%\]", said)[-1] == "100"
    listed = run(*pytest_, "--lf", "--collect-only", "-q", cwd=example)
    assert listed.splitlines()[:3] == names
    assert "1 failed, 1 passed" in run(*pytest_, names[0], cwd=example, code=1)


def test_quiet_is_quiet(example):
    """-q leaves out what pytest says at the start, and tests on several ranks run as without it."""
    said = run(sys.executable, "-m", "pytest", "-q", "-k", "good", cwd=example)
    assert said.splitlines()[0].split()[0] == ".." and len(said.splitlines()) == 2


def test_no_test_has_a_time_limit_of_its_own():
    """The limit is to catch what hangs, on any machine, and stands in one place."""
    own = re.compile(r"\b(?:timeout|limit)=\d|monotonic\(\) \+ \d|^LIMIT = \d", re.M)
    found = {path.name: len(own.findall(path.read_text(encoding="utf-8")))
             for path in (scenes.ROOT / "tests").rglob("*.py")}
    found["test_peers.py"] -= 2  # of programs to compare with: what is tested
    found["scenes.py"] -= 1  # until mpirun, which is told to end, is killed
    assert {name: times for name, times in found.items() if times} == {}
