"""scripts/run.sh: how many ranks it starts, with a launcher that notes its arguments; and Ctrl-C."""

import contextlib
import os
import pty
import re
import shutil
import signal
import sys
from pathlib import Path

import pytest
import scenes
from commands import attended, await_that, executable, run

pytestmark = pytest.mark.slow

BODY = '[[body]]\nname = "a"\n[[body.clamp]]\non = "left"\n'


@pytest.fixture
def root(tmp_path: Path) -> Path:
    """A checkout of which only run.sh is real, on a machine of eight cores."""
    (tmp_path / "scripts").mkdir()
    for name in ("run.sh", "attend.sh"):
        shutil.copy(scenes.ROOT / "scripts" / name, tmp_path / "scripts")
    (tmp_path / "scripts" / "setup.sh").write_text(
        f"ROOT={tmp_path} MPIRUN=mpirun PYTHON=python OMP_NUM_THREADS=1\n"
    )
    programs = {
        "mpirun": "printf '%s\\n' \"$@\" >calls\nexit 3",
        "nproc": "echo ${OMP_NUM_THREADS:-${CORES:-8}}",
    }
    for name, text in programs.items():
        executable(tmp_path / "bin" / name, text)
    (tmp_path / "configs").mkdir()
    (tmp_path / "configs" / "pinched_blocks.toml").write_text(2 * BODY)
    for number in (1, 2, 3, 5, 12):
        (tmp_path / f"{number}.toml").write_text(f"# [[body]] {number} times\n" + number * BODY)
    (tmp_path / "blanks.toml").write_text(3 * "  [[ body ]] # one\r\n")
    (tmp_path / "inline.toml").write_text("body = [{}, {}, {}]\n")
    return tmp_path


def start(root: Path, *arguments: str, **environment: str) -> list[str]:
    """What run.sh gives to mpirun."""
    environment = {
        "OMP_NUM_THREADS": "1",
        **environment,
        "PATH": f"{root / 'bin'}:{os.environ['PATH']}",
    }
    assert (
        run("bash", root / "scripts" / "run.sh", *arguments, cwd=root, code=3, **environment) == ""
    )
    return (root / "calls").read_text().splitlines()


RANKS = {
    # arguments of run.sh: ranks
    ("1.toml",): 1,
    ("2.toml",): 2,
    ("5.toml",): 5,
    ("run", "5.toml"): 5,
    ("12.toml",): 8,
    (): 2,
    ("--quiet",): 2,
    ("--help",): 2,
    ("info",): 2,
    ("absent.toml",): 2,
    ("blanks.toml",): 3,
    ("inline.toml",): 2,
    ("run", "--set", "title=1.toml", "5.toml"): 5,
    ("sweep", "3.toml", "--vary", "a=1,2"): 3,
    ("run", "-options_file", "inline.toml", "3.toml"): 3,
}


@pytest.mark.parametrize("arguments", RANKS)
def test_one_rank_per_body_up_to_the_cores(root, arguments):
    """A scene gets one rank per body, at most the number of cores."""
    launcher, ranks, python, *_ = start(root, *arguments)
    assert (launcher, ranks, python) == ("-n", str(RANKS[arguments]), "python")


def test_arguments_are_handed_on(root):
    """The command gets its arguments as they are; several bodies have two ranks at least, or DDMPI_RANKS."""
    assert (
        start(root, "5.toml", CORES="1")[1] == "2"
        and start(root, "5.toml", DDMPI_RANKS="11")[1] == "11"
    )
    assert start(root, "5.toml", "--set", "title=a b")[2:] == [
        "python",
        "-P",
        "-m",
        "ddmpi",
        "run",
        "5.toml",
        "--set",
        "title=a b",
    ]
    assert start(root, "report", "out")[2:] == ["python", "-P", "-m", "ddmpi", "report", "out"]
    assert start(root)[2:] == [
        "python",
        "-P",
        "-m",
        "ddmpi",
        "run",
        f"{root}/configs/pinched_blocks.toml",
    ]


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
    said = run(
        "bash", tmp_path / "scripts" / "setup.sh", cwd=tmp_path, code=1, DDMPI_VENV=str(place)
    )
    assert place.exists() == (name == "thesis.txt")
    assert ("no virtual environment; name another folder in DDMPI_VENV" in said) == place.exists()


DEAF = """
import os, signal, time
from mpi4py import MPI
path = os.environ["READY"] + MPI.COMM_WORLD.rank * "1"
signal.signal(signal.SIGUSR1, lambda *_: open(path + " heard", "w").close())
with open(path + " number", "w") as file:
    file.write(str(os.getpid()))
MPI.COMM_WORLD.Barrier()
open(path, "w").close()
end = 1200 + time.monotonic()
while time.monotonic() < end:
    time.sleep(0.1)
"""
"""A program that goes on at SIGUSR1, as one that factorizes. Once one rank is ready, all have told their numbers."""


def in_terminal(program: Path, here: Path, command: list[str], *ready: str) -> tuple[int, str]:
    """Start a command in a terminal of its own, press Ctrl-C when a file is there; its exit code and what it has said.

    Once for each of the files `ready`. The program takes the place of Python.
    """
    python = executable(here / "python", f'exec {sys.executable} {program} "$@"')
    said = b""
    environment = scenes.clean_environment() | {
        "DDMPI_PYTHON": str(python),
        "READY": f"{here}/ready",
        "TERM": "dumb",
    }
    process, terminal = pty.fork()
    if process == 0:
        signal.signal(signal.SIGINT, signal.SIG_DFL)  # a shell's job in the background ignores it
        os.execve(command[0], command, environment)
    try:
        for name in ready:
            await_that((here / name).exists, f"no file {name!r}")
            os.write(terminal, b"\x03")
        with contextlib.suppress(OSError):  # Linux says so that the other end has gone
            while piece := os.read(terminal, 4096):
                said += piece
    finally:
        os.close(terminal)
    return os.waitstatus_to_exitcode(os.waitpid(process, 0)[1]), said.decode()


@pytest.mark.parametrize("alone", [False, True], ids=["run.sh", "one rank, no mpirun"])
def test_ctrl_c_leaves_a_checkpoint_and_one_message(tmp_path, alone):
    """Ctrl-C, which a terminal sends to all that runs in it, ends a run with a checkpoint, its name, and code 6."""
    scene, folder = scenes.pinched_blocks(2), tmp_path / "out"
    scene |= {
        "history": {"load": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.0]}},
        "time": {"points": [1.0, 2.0], "steps": 9},
    }
    for body in scene["body"]:
        body["traction"] = [load | {"history": "load"} for load in body["traction"]]
    scenes.write_scene(scene, tmp_path / "scene.toml")
    arguments = ["run", str(tmp_path / "scene.toml"), "--no-figures", "--output", str(folder)]
    command = (
        [str(tmp_path / "python"), "-m", "ddmpi"]
        if alone
        else [str(scenes.ROOT / "scripts" / "run.sh")]
    )
    code, said = in_terminal(
        scenes.ROOT / "tests" / "support" / "held.py", tmp_path, [*command, *arguments], "ready"
    )
    assert code == 6, said
    (message,) = re.findall(r"ddmpi: .*", said)
    kept = rf"ddmpi: interrupted by SIGINT: the state after iteration \d+ is kept, --restart {folder} goes on"
    assert re.match(kept, message)
    assert [path.name for path in folder.iterdir()] == ["checkpoint.h5"]


def test_a_second_ctrl_c_does_not_wait(tmp_path):
    """Ctrl-C twice ends also what hears no signal, all ranks of it; the exit code is a shell's."""
    command = [str(scenes.ROOT / "scripts" / "run.sh"), "scene.toml"]
    (tmp_path / "deaf.py").write_text(DEAF)
    code, said = in_terminal(tmp_path / "deaf.py", tmp_path, command, "ready1", "ready heard")
    assert (code, said.count("ddmpi: ")) == (130, 1), said
    assert "ending at once" in said
    for rank in ("", "1"):
        number = (tmp_path / f"ready{rank} number").read_text()
        await_that(
            lambda number=number: not scenes.is_alive(number), f"process {number} is still there"
        )


ATTEND = f'. {scenes.ROOT}/scripts/attend.sh; attend bash -c "$1"; explain; exit "$code"'


@pytest.mark.parametrize("name", ["TERM", "HUP", "INT", "USR1"])
def test_the_name_of_a_signal_is_handed_on(tmp_path, name):
    """What run.sh hands on as SIGUSR1 is called by its own name; the file that has the name does not stay."""
    waits = 'trap "echo heard $(cat $DDMPI_SIGNAL); exit 6" USR1\ntouch ready; while :; do sleep 0.02; done'
    waits = waits.replace("$", "\\$", 1)  # read when the signal comes
    assert attended(ATTEND, waits, name, tmp_path, TMPDIR=str(tmp_path)) == (
        6,
        f"heard SIG{name}\n",
    )
    assert [path.name for path in tmp_path.iterdir()] == ["ready"]


def test_what_hears_no_signal_is_said_to_be_interrupted(tmp_path):
    """As `ddmpi path`, which has nothing to keep: by the signal that came, not by the one that was handed on."""
    assert attended(ATTEND, "touch ready; exec sleep 600", "TERM", tmp_path) == (
        128 + signal.SIGUSR1,
        "ddmpi: error: interrupted by SIGTERM\n",
    )
