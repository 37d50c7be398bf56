"""What tests/conftest.py makes of pytest; test.sh, check.sh and setup.sh of scripts/."""

import re
import shutil
import sys
from pathlib import Path

import pytest
import scenes
from commands import executable, run

pytestmark = pytest.mark.slow

SCRIPTS = scenes.ROOT / "scripts"


# Tests on several ranks

EXAMPLE = """
import os
import time
import pytest

@pytest.mark.mpi(ranks=2)
def test_alone(comm, mpi_ranks, request):
    assert len(request.session.items) == 1

@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("rank", [0, 1])
def test_bad(comm, mpi_ranks, rank):
    assert comm.rank != rank

@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("part", "ab")
def test_good(comm, mpi_ranks, part):
    open(f"mpirun-{os.getppid()}", "a").close()

@pytest.mark.mpi(ranks=2)
def test_hangs(comm, mpi_ranks):
    time.sleep(30 if comm.rank else 0)
"""


@pytest.fixture
def example(tmp_path: Path) -> Path:
    """A folder with this conftest.py and tests of two ranks, four of which fail."""
    shutil.copy(scenes.ROOT / "tests" / "conftest.py", tmp_path)
    shutil.copytree(scenes.ROOT / "tests" / "support", tmp_path / "support")
    (tmp_path / "test_example.py").write_text(EXAMPLE)
    (tmp_path / "pytest.ini").write_text("[pytest]\nmarkers =\n    mpi\n")
    return tmp_path


def test_a_run_has_temporary_folders_of_its_own(example, tmp_path):
    """On all ranks, not those of another session, whose retention would take them away; they go with the run."""
    (example / "test_example.py").write_text(
        "import pytest\n\n@pytest.mark.mpi(ranks=2)\ndef test_on_ranks(comm, mpi_ranks, mpi_tmp_path):\n"
        "    print(f'<{mpi_tmp_path}>')\n\ndef test_alone(tmp_path):\n    print(f'<{tmp_path}>')\n"
    )
    said = run(sys.executable, "-m", "pytest", "-rP", cwd=example)
    folders = {Path(name) for name in re.findall(r"^<(.*)>$", said, re.M)}
    roots = {
        next(up for up in each.parents if up.name.startswith("ddmpi-tests-")) for each in folders
    }
    assert len(folders) == 2 and len(roots) == 1
    assert not roots & {*tmp_path.parents}
    assert not any(root.exists() for root in roots)


def test_ranks_report_under_the_name_of_their_test(example):
    """Names can be pasted back, --lf finds failures of any rank, the progress ends at 100 %, and a hang has an end.

    So has a failure beside other tests that does not come again.
    """
    pytest_ = (sys.executable, "-m", "pytest")
    said = run(*pytest_, cwd=example, code=1, DDMPI_TEST_LIMIT="5")
    names = [
        f"test_example.py::test_{name}" for name in ("alone[2]", "bad[2-0]", "bad[2-1]", "hangs[2]")
    ]
    assert re.findall(r"^FAILED (\S+)", said, re.M) == names
    assert all(f"- on rank {rank} -" in said for rank in (0, 1)) and "time limit of 5.0s" in said
    assert re.findall(r"\[ *(\d+)%\]", said)[-1] == "100"
    assert re.search(r"= slowest files =+\n *\d+\.\d s  test_example\.py\n", said)
    listed = run(*pytest_, "--lf", "--collect-only", "-q", cwd=example)
    assert listed.splitlines()[:4] == names
    assert "1 failed, 1 passed" in run(*pytest_, names[1], cwd=example, code=1)


def test_a_shared_mpirun_that_ends_without_a_word_is_a_failure(example):
    """Of the test in which it ended, though that passes alone."""
    ends = "    if len(request.session.items) > 1 and comm.rank:\n        os.kill(os.getpid(), 9)\n"
    tests = "".join(
        f"@pytest.mark.mpi(ranks=2)\ndef test_{name}(comm, mpi_ranks, request):\n{body}\n"
        for name, body in (("first", "    pass\n"), ("ends", ends), ("last", "    pass\n"))
    )
    (example / "test_example.py").write_text(f"import os\nimport pytest\n\n{tests}")
    said = run(sys.executable, "-m", "pytest", cwd=example, code=1)
    assert re.findall(r"^FAILED (\S+)", said, re.M) == ["test_example.py::test_ends[2]"]
    assert "the mpirun that it shares ended in it" in said


def test_with_workers_tests_on_as_many_ranks_share_an_mpirun(example):
    """They go to one worker of pytest-xdist, in whatever file and folder they are."""
    pytest.importorskip("xdist")
    test = (
        "import os\nimport pytest\n\n@pytest.mark.mpi(ranks=2)\ndef test(comm, mpi_ranks):\n"
        '    open(f"mpirun-{os.getppid()}", "a").close()\n'
    )
    (example / "more").mkdir()
    for name in ("test_a", "test_b", "test_example", "more/test_c"):
        (example / f"{name}.py").write_text(test)
    assert "8 passed" in run(sys.executable, "-m", "pytest", "-n", "2", cwd=example)
    assert len([*example.glob("**/mpirun-*")]) == 1


def test_no_test_has_a_time_limit_of_its_own():
    """The limit is to catch what hangs, on any machine, and stands in one place."""
    own = re.compile(r"\b(?:timeout|limit)=\d|monotonic\(\) \+ \d|^LIMIT = \d", re.M)
    found = {
        path.name: len(own.findall(path.read_text(encoding="utf-8")))
        for path in (scenes.ROOT / "tests").rglob("*.py")
    }
    found["test_peers.py"] -= 3  # of programs to compare with: what is tested
    found["mutation.py"] -= 1  # of a mutant, which may hang
    found["test_belts.py"] -= 3  # of friction
    found["scenes.py"] -= 1  # until mpirun, which is told to end, is killed
    assert {name: times for name, times in found.items() if times} == {}


# The scripts


def test_test_sh_runs_tests_and_nothing_else(tmp_path):
    """Neither types nor style stand before the tests of a user, on a machine whose python notes how it was called."""
    shutil.copytree(SCRIPTS, tmp_path / "scripts")
    (tmp_path / "scripts" / "setup.sh").write_text(
        'ROOT=$PWD PYTHON=$PWD/bin/python; say() { echo "$@"; }; install_packages() { echo installs >>calls; }\n'
    )
    executable(tmp_path / "bin" / "python", 'echo "$*" >>calls')
    executable(tmp_path / "bin" / "apt-get", "true")
    for name in ("bash", "dirname", "cat", "mktemp", "env"):
        (tmp_path / "bin" / name).symlink_to(shutil.which(name))
    run(tmp_path / "scripts" / "test.sh", "-x", "a test", cwd=tmp_path, PATH=str(tmp_path / "bin"))
    *before, last = (tmp_path / "calls").read_text().splitlines()
    asked = "-P -m pytest --collect-only -x a test"
    assert last == "-P -m pytest -x a test" and before in ([], [asked])


def test_a_checkout_of_somebody_else_asks_for_a_folder(tmp_path):
    """Who cannot write where the set-up would go is told of DDMPI_VENV."""
    said = run("bash", SCRIPTS / "run.sh", cwd=tmp_path, code=1, DDMPI_VENV="/dev/null/venv")
    assert (
        said == "ddmpi set-up: cannot write /dev/null/venv; name a folder of yours in DDMPI_VENV\n"
    )
