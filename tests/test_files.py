"""Files are whole or absent; what a killed run has left the next one clears away; scripts that were interrupted."""

import os
import signal
import socket
import subprocess
import sys
import time
from pathlib import Path

import pytest
import scenes

from ddmpi.checkpoint import NAME as CHECKPOINT
from ddmpi.errors import InputError, OutputError
from ddmpi.files import clear_unfinished, unfinished, write_atomically
from ddmpi.results import choose_folder

HOST = socket.gethostname()


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


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


def test_hdf5_on_a_full_disk_ends_with_the_error_of_the_system(tmp_path):
    """In a process of its own: HDF5 told of the error would bring it down when it ends."""
    code = """
import resource, sys, h5py, numpy as np
from ddmpi.files import FileOfHDF5
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
        choose_folder(str(tmp_path), None, "scene.toml")
    other = tmp_path / "other"
    other.mkdir()
    with pytest.raises(InputError, match="not completed"):
        choose_folder(str(tmp_path), str(other), "scene.toml")
    assert choose_folder(None, str(tmp_path), "scene.toml") == tmp_path
    assert choose_folder(str(other), str(tmp_path), "scene.toml") == other
    assert (tmp_path / CHECKPOINT).read_text() == "precious"


def test_results_without_a_summary_are_those_of_a_run_that_was_killed_while_it_renamed_them(tmp_path):
    (tmp_path / "result.h5").write_text("renamed already")
    with pytest.raises(InputError, match="there are results already"):
        choose_folder(None, str(tmp_path), "scene.toml")  # whose, nobody knows
    (tmp_path / CHECKPOINT).write_text("precious")
    assert choose_folder(None, str(tmp_path), "scene.toml") == tmp_path
    assert names(tmp_path) == {CHECKPOINT}
    for name in ("result.h5", "summary.json"):
        (tmp_path / name).write_text("whole")
    with pytest.raises(InputError, match="there are results already"):
        choose_folder(None, str(tmp_path), "scene.toml")
    assert names(tmp_path) == {CHECKPOINT, "result.h5", "summary.json"}


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
