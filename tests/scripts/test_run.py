"""scripts/run.sh: how many ranks it starts, with a launcher that notes its arguments."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest
import scenes

BODY = '[[body]]\nname = "a"\n[[body.clamp]]\non = "left"\n'


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A checkout of which only run.sh is real, on a machine of eight cores."""
    (tmp_path / "scripts").mkdir()
    (tmp_path / "bin").mkdir()
    for name in ("run.sh", "attend.sh"):
        shutil.copy(scenes.ROOT / "scripts" / name, tmp_path / "scripts")
    (tmp_path / "scripts" / "setup.sh").write_text(f"ROOT={tmp_path} MPIRUN=mpirun PYTHON=python OMP_NUM_THREADS=1\n")
    programs = {"mpirun": "printf '%s\\n' \"$@\" >calls\nexit 3\n", "nproc": "echo ${OMP_NUM_THREADS:-${CORES:-8}}\n"}
    for name, text in programs.items():
        (tmp_path / "bin" / name).write_text(f"#!/bin/sh\n{text}")
        (tmp_path / "bin" / name).chmod(0o755)
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "pinched_blocks.toml").write_text(2 * BODY)
    for number in (1, 2, 3, 5, 12):
        (tmp_path / f"{number}.toml").write_text(f"# [[body]] {number} times\n" + number * BODY)
    (tmp_path / "blanks.toml").write_text(3 * "  [[ body ]] # one\r\n")
    (tmp_path / "inline.toml").write_text("body = [{}, {}, {}]\n")
    return tmp_path


def start(root: Path, *arguments: str, **environment: str) -> list[str]:
    """What run.sh gives to mpirun."""
    environment = {"OMP_NUM_THREADS": "1", **environment, "PATH": f"{root / 'bin'}:{os.environ['PATH']}"}
    clean = {key: value for key, value in scenes.clean_environment().items() if not key.startswith("DDMPI_")}
    done = subprocess.run(["bash", root / "scripts" / "run.sh", *arguments], env=clean | environment, cwd=root,
                          capture_output=True, text=True, timeout=scenes.LIMIT)
    assert (done.returncode, done.stdout, done.stderr) == (3, "", "")
    return (root / "calls").read_text().splitlines()


RANKS = {
    # arguments of run.sh: ranks
    ("1.toml",): 1, ("2.toml",): 2, ("5.toml",): 5, ("run", "5.toml"): 5, ("12.toml",): 8,
    (): 2, ("--quiet",): 2, ("--help",): 2, ("info",): 2, ("absent.toml",): 2, ("blanks.toml",): 3,
    ("inline.toml",): 2, ("run", "--set", "title=1.toml", "5.toml"): 5, ("sweep", "3.toml", "--vary", "a=1,2"): 3,
    ("verify", "3.toml"): 3, ("run", "-options_file", "inline.toml", "3.toml"): 3,
}


@pytest.mark.parametrize("arguments", RANKS)
def test_one_rank_per_body_up_to_the_cores(root, arguments):
    """A scene gets one rank per body, at most the number of cores."""
    launcher, ranks, python, *_ = start(root, *arguments)
    assert (launcher, ranks, python) == ("-n", str(RANKS[arguments]), "python")


@pytest.mark.parametrize(("cores", "ranks"), [("1", "2"), ("2", "2"), ("4", "4")])
def test_at_least_two_ranks_for_several_bodies(root, cores, ranks):
    """On a single core several bodies have two ranks, one body one."""
    assert start(root, "5.toml", CORES=cores)[1] == ranks
    assert start(root, "1.toml", CORES=cores)[1] == "1"


def test_ranks_can_be_chosen(root):
    """DDMPI_RANKS says otherwise."""
    assert start(root, "5.toml", DDMPI_RANKS="11")[1] == "11"


def test_arguments_are_handed_on(root):
    """The command gets its arguments as they are."""
    assert start(root, "5.toml", "--set", "title=a b")[2:] == \
        ["python", "-m", "ddmpi", "run", "5.toml", "--set", "title=a b"]
    assert start(root, "report", "out")[2:] == ["python", "-m", "ddmpi", "report", "out"]
    assert start(root)[2:] == ["python", "-m", "ddmpi", "run", f"{root}/configs/pinched_blocks.toml"]


@pytest.mark.parametrize("name", ["thesis.txt", "pyvenv.cfg"])
def test_a_set_up_removes_no_folder_of_others(tmp_path, name):
    """DDMPI_VENV names a folder that is new, empty or a virtual environment; any other is left alone."""
    place = tmp_path / "mine"
    place.mkdir()
    (place / name).write_text("years of work")
    script = (scenes.ROOT / "scripts" / "setup.sh").read_text()
    script = script.replace("\nchoose_python\n", "\nLOG=/dev/null; make_venv\n")
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "setup.sh").write_text(script.replace("/usr/bin/python3", "false"))
    done = subprocess.run(["bash", tmp_path / "scripts" / "setup.sh"], capture_output=True, text=True, timeout=60,
                          env=scenes.clean_environment() | {"DDMPI_VENV": str(place)})
    assert done.returncode == 1 and place.exists() == (name == "thesis.txt")
    assert ("no virtual environment; name another folder in DDMPI_VENV" in done.stderr) == place.exists()
