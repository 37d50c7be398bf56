"""Files are whole or absent; what a killed run has left the next one clears away; scripts that were interrupted."""

import contextlib
import errno
import fcntl
import os
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
import scenes

from ddmpi.errors import HeldError, InputError, OutputError, TakenError
from ddmpi.results.folder import Staging, choose_folder
from ddmpi.results.tables import write_summary
from ddmpi.run.checkpoint import CHECKPOINT
from ddmpi.system.files import clear_unfinished, locked, unfinished, write_atomically

HOST = socket.gethostname()


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def chosen(wanted: Path | None = None, restart: Path | None = None) -> Path:
    """The folder of a run that ends at once."""
    with choose_folder(wanted and str(wanted), restart and str(restart), "scene.toml") as folder:
        return folder


@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("a bug")])
def test_a_file_that_cannot_be_written_leaves_the_former_one(tmp_path, monkeypatch, step, error):
    path = tmp_path / "file"
    write_atomically(path, b"former", durable=True)

    def fail(*arguments):
        raise error

    monkeypatch.setattr(os, step, fail)
    with pytest.raises(OutputError if isinstance(error, OSError) else RuntimeError, match=r"No space left|a bug"):
        write_atomically(path, b"new", durable=True)
    assert path.read_bytes() == b"former"
    assert names(tmp_path) == {"file"}


def test_an_error_of_writing_names_the_file(tmp_path, monkeypatch):
    """Also where the system does not: only what opens a file knows its name."""
    def full(*arguments, **options):
        raise OSError(28, "No space left on device")

    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(OutputError, match=rf"^results could not be written: {tmp_path}/summary.json: No space left"):
        write_summary(tmp_path, {})


def test_hdf5_on_a_full_disk_ends_with_the_error_of_the_system(tmp_path):
    """In a process of its own: HDF5 told of the error would bring it down when it ends."""
    code = """
import resource, sys, h5py, numpy as np
from ddmpi.system.files import FileOfHDF5
resource.setrlimit(resource.RLIMIT_FSIZE, (5000, resource.RLIM_INFINITY))
try:
    with FileOfHDF5(sys.argv[1], "w+") as storage, h5py.File(storage, "w") as file:
        for k in range(3):
            file[f"data {k}"] = np.arange(1000.0)
except OSError as error:
    print(error.strerror, error.filename)
"""
    child = subprocess.run([sys.executable, "-c", code, str(tmp_path / "x.h5")], capture_output=True, text=True,
                           timeout=60, env=scenes.clean_environment())
    assert child.returncode == 0
    assert child.stdout == f"File too large {tmp_path / 'x.h5'}\n"
    assert child.stderr == ""


def test_only_what_dead_processes_of_this_host_have_left_is_cleared_away(tmp_path):
    dead = subprocess.Popen([sys.executable, "-c", ""])
    zombie = subprocess.Popen([sys.executable, "-c", ""])
    dead.wait()
    os.waitid(os.P_PID, zombie.pid, os.WEXITED | os.WNOWAIT)  # dead, but still there
    for left in (f".unfinished-{HOST}-{dead.pid}-results", f".unfinished-{HOST}-{zombie.pid}-results"):
        (tmp_path / left).mkdir()
        (tmp_path / left / "result.h5").write_text("half")
    (tmp_path / f".unfinished-{HOST}-{dead.pid}-checkpoint.h5").write_text("half")
    stay = {unfinished(tmp_path / "results").name, f".unfinished-elsewhere-{dead.pid}-results", "result.h5"}
    for name in stay:
        (tmp_path / name).write_text("somebody's")
    clear_unfinished(tmp_path)
    zombie.wait()
    assert names(tmp_path) == stay


def test_a_checkpoint_is_not_written_over(tmp_path):
    (tmp_path / CHECKPOINT).write_text("precious")
    with pytest.raises(InputError, match=f"go on from it with --restart {tmp_path}"):
        chosen(tmp_path)
    other = tmp_path / "other"
    for there in (False, True):
        if there:
            other.mkdir()
        with pytest.raises(InputError, match="not completed"):
            chosen(tmp_path, other)
    assert chosen(None, tmp_path) == tmp_path
    assert chosen(other, tmp_path) == other
    assert (tmp_path / CHECKPOINT).read_text() == "precious"


def test_results_without_a_summary_are_those_of_a_run_that_was_killed_while_it_renamed_them(tmp_path):
    (tmp_path / "result.h5").write_text("renamed already")
    with pytest.raises(InputError, match="there are results already"):
        chosen(None, tmp_path)  # whose, nobody knows
    (tmp_path / CHECKPOINT).write_text("precious")
    assert chosen(None, tmp_path) == tmp_path
    assert names(tmp_path) == {CHECKPOINT}
    for name in ("result.h5", "summary.json"):
        (tmp_path / name).write_text("whole")
    with pytest.raises(InputError, match="there are results already"):
        chosen(None, tmp_path)
    assert names(tmp_path) == {CHECKPOINT, "result.h5", "summary.json"}


# Two runs in one folder


LOCKS = [None, errno.EBADF, errno.ENOSYS]
"""What flock says of a folder: yes; no, with NFS; no, with Lustre."""


@pytest.fixture(params=LOCKS)
def locks(request, monkeypatch) -> bool:
    """Whether the file system has locks, with and without."""
    def refuse(*arguments):
        raise OSError(request.param, os.strerror(request.param))

    if request.param:
        monkeypatch.setattr(fcntl, "flock", refuse)
    return request.param is None


def test_two_runs_do_not_have_one_folder(tmp_path):
    (tmp_path / CHECKPOINT).write_text("precious")
    for wanted, restart in ((tmp_path, None), (None, tmp_path)):
        with choose_folder(None, str(tmp_path), "scene.toml"), pytest.raises(HeldError, match="another run is writing"):
            chosen(wanted, restart)
    assert chosen(None, tmp_path) == tmp_path
    assert names(tmp_path) == {CHECKPOINT}


def test_the_files_of_a_run_that_is_publishing_stay(tmp_path, locks):
    """It has put some of them there when another run wants to go on from the same checkpoint."""
    (tmp_path / CHECKPOINT).write_text("precious")
    with choose_folder(None, str(tmp_path), "scene.toml") as folder:
        staging = Staging(folder)
        staging.create()
        (folder / "result.h5").write_text("the first of several")
        with pytest.raises(HeldError, match="another run is writing there" + ("" if locks else ".*killed on another")):
            chosen(None, tmp_path)
        assert (folder / "result.h5").exists()
    staging.discard()
    assert chosen(None, tmp_path) == tmp_path
    assert names(tmp_path) == {CHECKPOINT}


def test_without_a_name_the_first_folder_that_nobody_has(tmp_path, monkeypatch, locks):
    monkeypatch.chdir(tmp_path)
    with choose_folder(None, None, "a/scene.toml") as one, choose_folder(None, None, "b/scene.toml") as two:
        assert [str(one), str(two)] == ["results/scene", "results/scene-2"]
        (two / "result.h5").write_text("")
    assert names(tmp_path / "results") == {"scene-2"}


def test_a_new_folder_that_another_run_has_taken_at_once_is_left_to_it(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    mkdir = Path.mkdir
    with contextlib.ExitStack() as other:
        def overtaken(path, *arguments, **options):
            mkdir(path, *arguments, **options)
            if path == Path("results/scene"):
                other.enter_context(locked(path))

        monkeypatch.setattr(Path, "mkdir", overtaken)
        assert str(chosen()) == "results/scene-2"


def test_a_folder_is_removed_by_whom_it_was_made(tmp_path):
    mine, theirs = tmp_path / "mine", tmp_path / "theirs"
    theirs.mkdir()
    assert [chosen(mine), chosen(theirs)] == [mine, theirs]
    assert names(tmp_path) == {"theirs"}


@pytest.mark.parametrize("links", [True, False])
@pytest.mark.parametrize("in_the_way", ["result.h5", "history.csv", "summary.json"])
def test_publishing_overwrites_nothing(tmp_path, monkeypatch, links, in_the_way):
    def refuse(*arguments):
        raise PermissionError(errno.EPERM, os.strerror(errno.EPERM))

    if not links:
        monkeypatch.setattr(os, "link", refuse)
    (tmp_path / in_the_way).write_text("another's")
    staging = Staging(tmp_path)
    staging.create()
    files = ("result.h5", "history.csv", "summary.json")
    for name in files:
        (staging.path / name).write_text("ours")
    with pytest.raises(TakenError, match=in_the_way):
        staging.publish()
    staging.discard()
    assert names(tmp_path) == {in_the_way} and (tmp_path / in_the_way).read_text() == "another's"
    (tmp_path / in_the_way).unlink()
    staging.create()
    for name in files:
        (staging.path / name).write_text("ours")
    assert [path.name for path in staging.publish()] == ["result.h5", "history.csv", "summary.json"]
    assert names(tmp_path) == set(files)


@pytest.mark.parametrize("command", ["--restart", "--output"])
def test_a_run_that_is_publishing_is_left_alone(tmp_path, command):
    """The command, while another one has put some of its results there; this one ends with all of them."""
    scene = scenes.write_scene(scenes.pinched_blocks(2), tmp_path / "scene.toml")
    folder, at_it, go_on = tmp_path / "out", tmp_path / "at it", tmp_path / "go on"
    hook = tmp_path / "slow.py"
    hook.write_text(f"""
import sys, time
from pathlib import Path
from ddmpi.cli import main as cli
from ddmpi.results import folder as results
original = results.link_new
def link_new(source, target):
    original(source, target)
    Path({str(at_it)!r}).touch()
    while not Path({str(go_on)!r}).exists():
        time.sleep(0.05)
results.link_new = link_new
cli.main(sys.argv[1:])
""")
    with ThreadPoolExecutor() as pool:
        first = pool.submit(scenes.run_python, [str(hook), "run", str(scene), "--output", str(folder), "--no-figures",
                                                "--set", "checkpoint.iterations=1"], limit=120.0, folder=folder)
        end = time.monotonic() + 60
        while not at_it.exists() and time.monotonic() < end:
            time.sleep(0.05)
        before = names(folder)
        second = scenes.run_python(["-m", "ddmpi", "run", str(scene), command, str(folder), "--no-figures"], limit=60.0)
        after = names(folder)
        go_on.touch()
        run = first.result()
    assert second.code == 2 and len(second.messages) == 1, second.output
    assert "another run is writing there" in second.messages[0]
    assert before == after and {"result.h5", CHECKPOINT} < after and "summary.json" not in after
    assert run.code == 0, run.output
    assert run.files == {"result.h5", "result.xdmf", "history.csv", "interface.csv", "summary.json"}


# Folders and files that may not be reached


@pytest.mark.parametrize("case", ["output", "restart", "mesh", "name"])
def test_what_may_not_be_reached_is_refused(tmp_path_factory, case):
    """By a user who is not root, whom permissions do not bind."""
    here = Path(tempfile.mkdtemp(prefix="ddmpi-test-"))  # where others may go, too, which pytest's folders are not
    try:
        here.chmod(0o755)
        (here / "locked" / "x").mkdir(parents=True)
        scene = scenes.pinched_blocks(2)
        if case == "mesh":
            scene["body"][0]["mesh"] = {"file": "locked/m.msh"}
        scenes.write_scene(scene, here / "scene.toml")
        (here / "locked").chmod(0o000 if os.getuid() else 0o700)
        (here / "out").mkdir()
        (here / "out").chmod(0o777)  # the umask takes some of a mode that mkdir is given
        more = {"output": ["--output", "locked/x"], "restart": ["--restart", "locked/x"], "mesh": ["--output", "out"],
                "name": ["--output", "x" * 300]}[case]
        code = f"""
import os, sys
from pathlib import Path
from ddmpi.errors import InputError
from ddmpi.mesh.build import locate_mesh
from ddmpi.results.folder import choose_folder
from ddmpi.scene.reader import read_scene, read_text
if os.getuid() == 0:
    os.setgroups([])
    os.setgid(65534)
    os.setuid(65534)
os.chdir({str(here)!r})
arguments = dict(zip(sys.argv[1::2], sys.argv[2::2]))
scene = read_scene("scene.toml", read_text("scene.toml"))
try:
    with choose_folder(arguments.get("--output"), arguments.get("--restart"), "scene.toml"):
        locate_mesh(scene.body[0], Path())
except InputError as error:
    print(error)
"""
        child = subprocess.run([sys.executable, "-c", code, *more], capture_output=True, text=True, timeout=60,
                               env=scenes.clean_environment())
        assert child.returncode == 0, child.stderr
        assert child.stdout.count("\n") == 1
        word = "File name too long" if case == "name" else "Permission denied"
        assert word in child.stdout and (more[1] if case != "mesh" else "locked/m.msh") in child.stdout
    finally:
        (here / "locked").chmod(0o700)
        shutil.rmtree(here)


# The scripts


def executable(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


@pytest.mark.parametrize(("number", "said"), [(9, "KILL"), (None, "")])
def test_run_sh_says_that_a_signal_has_ended_a_rank(tmp_path, number, said):
    """A quiet mpirun does not."""
    python = executable(tmp_path / "python", f"kill -{number} $$" if number else "exit 3")
    run = subprocess.run([str(scenes.ROOT / "scripts" / "run.sh"), "scene.toml"], capture_output=True, text=True,
                         timeout=60, env=scenes.clean_environment() | {"DDMPI_PYTHON": str(python)})
    ours = [line for line in run.stderr.splitlines() if line.startswith("ddmpi")]
    if number:
        assert run.returncode == 128 + number
        assert ours == [f"ddmpi: error: a rank was ended by signal {number} ({said})"]
    else:
        assert run.returncode == 3
        assert ours == []


def test_run_sh_passes_signals_on(tmp_path):
    python = executable(tmp_path / "python", f'trap "exit 6" USR1; touch {tmp_path}/ready-$$\n'
                                             "for i in $(seq 300); do sleep 0.1; done")
    with subprocess.Popen([str(scenes.ROOT / "scripts" / "run.sh"), "scene.toml"], stderr=subprocess.PIPE, text=True,
                          env=scenes.clean_environment() | {"DDMPI_PYTHON": str(python)}) as run:
        end = time.monotonic() + 30
        while len(list(tmp_path.glob("ready-*"))) < 2 and time.monotonic() < end:
            time.sleep(0.05)
        run.send_signal(signal.SIGUSR1)
        assert run.wait(timeout=30) == 6


def test_a_set_up_that_was_interrupted_is_not_taken_for_a_complete_one(tmp_path):
    """Killed while it looks at the Python it has found; the next one starts anew and ends with one that works."""
    tools = tmp_path / "bin"
    tools.mkdir()
    environment = scenes.clean_environment() | {"DDMPI_VENV": str(tmp_path / "venv")}
    environment["PATH"] = os.pathsep.join([str(tools), environment["PATH"]])
    environment.pop("DDMPI_PYTHON", None)
    command = ["bash", "-c", f'. "{scenes.ROOT}/scripts/setup.sh" && echo "$PYTHON"']

    executable(tools / "python3", f"touch {tmp_path}/looking; exec sleep 60")
    with subprocess.Popen(command, env=environment, start_new_session=True, stdout=subprocess.PIPE) as first:
        end = time.monotonic() + 30
        while not (tmp_path / "looking").exists() and time.monotonic() < end:
            time.sleep(0.05)
        os.killpg(first.pid, signal.SIGKILL)
    assert not (tmp_path / "venv" / "ddmpi-setup").exists()

    (tmp_path / "venv" / "bin").mkdir(parents=True, exist_ok=True)
    executable(tmp_path / "venv" / "bin" / "python", "echo half of a venv; exit 1")
    python = executable(tools / "python3", f'exec {sys.executable} "$@"')
    again = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=60)
    assert again.returncode == 0, again.stderr
    assert again.stdout.strip() == str(python)
    assert (tmp_path / "venv" / "ddmpi-setup").exists()
