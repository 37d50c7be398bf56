"""Results are whole or absent; nothing is overwritten; a killed run's leavings do no harm; interrupted scripts."""

import os
import shlex
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
import scenes
from documented import FILES

from ddmpi.errors import InputError, OutputError, TakenError
from ddmpi.mesh.build import locate_mesh
from ddmpi.results.folder import MOVED, Staging, choose_folder, running
from ddmpi.results.summary import write_summary
from ddmpi.results.tables import reading
from ddmpi.scene.reader import read_scene
from ddmpi.system import logs
from ddmpi.system.files import CHECKPOINT, RECORD, UNFINISHED, contact_files, write_atomically
from ddmpi.system.provenance import whereabouts

HOST = whereabouts().split()[0]


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def full(*arguments, **options):
    """What writes on a disk without space."""
    raise OSError(28, "No space left on device")


def chosen(wanted: Path | None = None, restart: Path | None = None) -> Path:
    """The folder of a run that ends at once."""
    with choose_folder(wanted and str(wanted), restart and str(restart), "scene.toml") as folder:
        return folder


@pytest.mark.slow
def test_the_files_of_a_contact_are_known():
    """What is refused where two contacts would have one file is all that a contact may write."""
    assert set(contact_files("NAME")) == {name for name in FILES if "NAME" in name}


@pytest.mark.parametrize("step", ["fsync", "replace"])
@pytest.mark.parametrize("error", [OSError(28, "No space left on device"), RuntimeError("a bug")])
def test_a_file_that_cannot_be_written_leaves_the_former_one(tmp_path, monkeypatch, step, error):
    path = tmp_path / "file"
    write_atomically(path, b"former", durable=True)

    def fail(*arguments):
        raise error

    monkeypatch.setattr(os, step, fail)
    with pytest.raises(
        OutputError if isinstance(error, OSError) else RuntimeError, match=r"No space left|a bug"
    ):
        write_atomically(path, b"new", durable=True)
    assert path.read_bytes() == b"former"
    assert names(tmp_path) == {"file"}


@pytest.mark.slow
def test_an_error_of_writing_names_the_file(tmp_path, monkeypatch):
    """Also where the system does not: only what opens a file knows its name."""
    monkeypatch.setattr(Path, "write_text", full)
    with pytest.raises(
        OutputError, match=rf"^results could not be written: {tmp_path}/summary.json: No space left"
    ):
        write_summary(tmp_path, {})


@pytest.mark.slow
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
    child = subprocess.run(
        [sys.executable, "-c", code, str(tmp_path / "x.h5")],
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
        env=scenes.clean_environment(),
    )
    assert child.returncode == 0
    assert child.stdout == f"File too large {tmp_path / 'x.h5'}\n"
    assert scenes.own_lines(child.stderr) == ""


# The folder of a run


def dead_process() -> int:
    """One that its parent has not asked for its exit code, as where nobody takes over from a killed mpirun."""
    child = subprocess.Popen([sys.executable, "-c", ""])
    os.waitid(os.P_PID, child.pid, os.WEXITED | os.WNOWAIT)
    dead.append(child)
    return child.pid


dead: list[subprocess.Popen] = []


def fill(claim: Path, moved: bool = False) -> Path:
    """What a run has left that was killed while it wrote its results, or while it moved them."""
    claim.mkdir(parents=True)
    for name in ("history.csv", "summary.json"):
        (claim / name).write_text("half")
    if moved:
        (claim / MOVED).write_text("result.h5\nhistory.csv\nsummary.json")
        (claim.parents[1] / "result.h5").write_text("moved already")
    return claim


@pytest.mark.slow
@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize("restart", [False, True])
def test_what_a_killed_run_has_left_goes(tmp_path, moved, restart):
    """A run or a restart removes what a killed run has left, also results that it had moved, and nothing else."""
    fill(tmp_path / UNFINISHED / f"{HOST} {dead_process()}", moved)
    (tmp_path / ".unfinished-elsewhere-1-checkpoint.h5").write_text("half")
    (tmp_path / ".hidden").write_text("the user's")
    if restart:
        (tmp_path / CHECKPOINT).write_text("precious")
        (tmp_path / "notes").write_text("the user's")
        assert chosen(None, tmp_path) == tmp_path
    else:
        assert chosen(tmp_path) == tmp_path
    assert names(tmp_path) == ({".hidden", CHECKPOINT, "notes"} if restart else {".hidden"})


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
    (tmp_path / "summary.json").write_text("whole")
    with pytest.raises(InputError, match="there are results already"):
        chosen(None, tmp_path)


def test_a_folder_that_holds_anything_is_refused(tmp_path):
    """A run makes its folder or finds it empty, but for its own log and the record of its sweep."""
    for name in (RECORD, "notes"):
        (tmp_path / name).write_text("")
    logs.configure(
        0, quiet=True, file=str(tmp_path / "run.log"), heading="ddmpi 0 on h 1: ddmpi run"
    )
    try:
        with pytest.raises(
            InputError, match=rf"--output {tmp_path}: is not empty \(it holds notes\)"
        ):
            chosen(tmp_path)
        (tmp_path / "notes").unlink()
        assert chosen(tmp_path) == tmp_path
    finally:
        logs.configure(0)
    with pytest.raises(InputError, match=r"it holds run\.log"):
        chosen(tmp_path)
    assert names(tmp_path) == {RECORD, "run.log"}


def test_a_claim_that_is_a_link_is_refused(tmp_path):
    """Nothing is written where it leads; a folder that a killed run has left there is taken."""
    (tmp_path / "out").mkdir()
    (tmp_path / "theirs").mkdir()
    claim = tmp_path / "out" / UNFINISHED
    claim.symlink_to(tmp_path / "theirs")
    with pytest.raises(InputError, match=rf"{claim} is a link; remove it"):
        chosen(tmp_path / "out")
    assert names(tmp_path / "theirs") == set()
    claim.unlink()
    claim.mkdir()
    assert chosen(tmp_path / "out") == tmp_path / "out"


@pytest.mark.slow
@pytest.mark.parametrize("restart", [False, True])
def test_two_runs_do_not_have_one_folder(tmp_path, restart):
    """A folder in which a run is at work, or may be on another host, is refused, with what to remove."""
    with subprocess.Popen([sys.executable, "-c", "input()"], stdin=subprocess.PIPE) as other:
        claim = fill(tmp_path / UNFINISHED / f"{HOST} {other.pid}", moved=True)
        if restart:
            (tmp_path / CHECKPOINT).write_text("precious")
        before = names(tmp_path)
        assert running(tmp_path) == f"{HOST} {other.pid}"
        with pytest.raises(
            InputError, match=rf"at work there \({HOST} {other.pid}\).*remove {claim.parent}"
        ):
            chosen(None if restart else tmp_path, tmp_path if restart else None)
        assert names(tmp_path) == before
        other.communicate()
    assert running(tmp_path) == ""
    chosen(None if restart else tmp_path, tmp_path if restart else None)


def test_a_run_on_another_host(tmp_path, monkeypatch):
    """It counts as running, unless it is of the same batch job."""
    claim = tmp_path / UNFINISHED / "elsewhere 7 job 12"
    claim.mkdir(parents=True)
    with pytest.raises(
        InputError, match=r"another run is at work there .elsewhere 7 job 12.*remove"
    ):
        chosen(tmp_path)
    assert running(tmp_path) == claim.name
    monkeypatch.setenv("SLURM_JOB_ID", "12")
    assert running(tmp_path) == "" and chosen(tmp_path) == tmp_path and not claim.exists()


@pytest.mark.slow
def test_runs_that_start_at_once_do_not_share_a_folder(tmp_path):
    """Of several that name the folder of a killed run one gets it."""
    (tmp_path / "out" / UNFINISHED / f"{HOST} {dead_process()}").mkdir(parents=True)
    code = """
import sys
from ddmpi.errors import InputError
from ddmpi.results.folder import choose_folder
print("ready", flush=True)
input()
try:
    with choose_folder(sys.argv[1], None, "scene.toml"):
        print("mine", flush=True)
        input()
except InputError as error:
    print(error, flush=True)
"""
    runs = [
        subprocess.Popen(
            [sys.executable, "-c", code, str(tmp_path / "out")],
            stdin=subprocess.PIPE,
            text=True,
            stdout=subprocess.PIPE,
            env=scenes.clean_environment(),
        )
        for _ in range(4)
    ]
    for run in runs:
        assert run.stdout.readline() == "ready\n"
    for run in runs:
        run.stdin.write("\n")
        run.stdin.flush()
    said = [run.stdout.readline() for run in runs]
    for run, line in zip(
        runs, said, strict=True
    ):  # PETSc would die of writing to one that has ended
        run.communicate("\n" if line == "mine\n" else None, timeout=scenes.LIMIT)
    assert said.count("mine\n") == 1, said
    assert all("another run is at work there" in line for line in said if line != "mine\n"), said


@pytest.mark.slow
def test_without_a_name_the_first_new_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    with (
        choose_folder(None, None, "a/scene.toml") as one,
        choose_folder(None, None, "b/scene.toml") as two,
    ):
        assert [str(one), str(two)] == ["results/scene", "results/scene-2"]
        (two / "result.h5").write_text("")
    assert names(tmp_path / "results") == {"scene-2"}


@pytest.mark.slow
def test_a_folder_is_removed_by_the_run_that_made_it(tmp_path):
    mine, theirs = tmp_path / "mine", tmp_path / "theirs"
    theirs.mkdir()
    assert [chosen(mine), chosen(theirs)] == [mine, theirs]
    assert names(tmp_path) == {"theirs"}


def staged(folder: Path) -> Staging:
    staging = Staging(folder)
    staging.path.mkdir(parents=True)
    for name in ("summary.json", "what nobody has heard of.csv", "bodies.png"):
        (staging.path / name).write_text("ours")
    return staging


def test_what_is_written_is_published(tmp_path):
    """No list of names decides: every file appears, the summary last."""
    staging = staged(tmp_path)
    assert [path.name for path in staging.publish()] == [
        "bodies.png",
        "what nobody has heard of.csv",
        "summary.json",
    ]
    assert names(tmp_path) == {"bodies.png", "what nobody has heard of.csv", "summary.json"}


def test_files_of_another_host_are_published_before_they_are_listed(tmp_path, monkeypatch):
    """A host may list a shared folder late; what it is told that another one may have written it asks for by name."""
    staging = staged(tmp_path)
    monkeypatch.setattr(os, "listdir", lambda folder: ["summary.json"])
    assert [path.name for path in staging.publish(["bodies.png", "contact_a-b_legs.csv"])] == [
        "bodies.png",
        "summary.json",
    ]


@pytest.mark.parametrize("in_the_way", ["bodies.png", "summary.json"])
def test_publishing_overwrites_nothing(tmp_path, in_the_way):
    (tmp_path / in_the_way).write_text("another's")
    staging = staged(tmp_path)
    with pytest.raises(TakenError, match=f"{in_the_way}: is there already"):
        staging.publish()
    staging.discard()
    assert names(tmp_path) == {in_the_way} and (tmp_path / in_the_way).read_text() == "another's"


def test_publishing_that_fails_leaves_nothing(tmp_path, monkeypatch):
    rename = os.rename

    def fails(source, target):
        if target.name == "summary.json":
            raise OSError(5, "Input/output error")
        rename(source, target)

    monkeypatch.setattr(os, "rename", fails)
    staging = staged(tmp_path)
    with pytest.raises(OutputError, match=r"results could not be written: .*Input/output error"):
        staging.publish()
    staging.discard()
    assert names(tmp_path) == set()


@pytest.mark.slow
def test_a_full_disk_at_the_start_is_an_error_of_writing(tmp_path, monkeypatch):
    (tmp_path / "out").mkdir()
    monkeypatch.setattr(
        Path, "mkdir", lambda path, **options: full() if UNFINISHED in str(path) else os.mkdir(path)
    )
    with pytest.raises(OutputError, match=f"{tmp_path}/out: cannot write there: No space left"):
        chosen(tmp_path / "out")


# Folders and files that may not be reached


def test_what_may_not_be_reached_is_refused(tmp_path):
    """Such as a name that is too long."""
    name, scene = "x" * 300, scenes.pinched_blocks(2)
    with pytest.raises(InputError, match=rf"{name}: cannot be made: File name too long"):
        chosen(tmp_path / name)
    scene["body"][0]["mesh"] = {"file": f"{name}.msh"}
    body, _ = read_scene("scene.toml", scenes.to_toml(scene)).body
    with pytest.raises(
        InputError, match=r"body\.upper\.mesh\.file: there is no file .*\(File name too long\)"
    ):
        locate_mesh(body, tmp_path)


# The scripts


def executable(path: Path, text: str) -> Path:
    path.write_text(f"#!/bin/sh\n{text}\n")
    path.chmod(0o755)
    return path


@pytest.mark.slow
@pytest.mark.parametrize(("number", "said"), [(9, "KILL"), (None, "")])
def test_run_sh_says_that_a_signal_has_ended_a_rank(tmp_path, number, said):
    """A quiet mpirun does not. The rank has begun MPI: before that MPICH's mpirun may itself fail, with 255."""
    dies = f"import os; from mpi4py import MPI; MPI.COMM_WORLD.Barrier(); os.kill(os.getpid(), {number})"
    python = executable(
        tmp_path / "python",
        f"exec {shlex.quote(sys.executable)} -c '{dies}'" if number else "exit 3",
    )
    run = subprocess.run(
        [str(scenes.ROOT / "scripts" / "run.sh"), "scene.toml"],
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
        env=scenes.clean_environment() | {"DDMPI_PYTHON": str(python)},
    )
    ours = [line for line in run.stderr.splitlines() if line.startswith("ddmpi")]
    if number:
        assert run.returncode == 128 + number
        assert ours == [f"ddmpi: error: a rank was ended by signal {number} ({said})"]
    else:
        assert run.returncode == 3
        assert ours == []


@pytest.mark.slow
@pytest.mark.parametrize(
    ("number", "answer", "code"),
    [(signal.SIGUSR1, "exit 6", 6), (signal.SIGTERM, "", 0), (signal.SIGINT, "exit 6", 6)],
)
def test_run_sh_returns_the_exit_code_of_an_interrupted_run(tmp_path, number, answer, code):
    """Of one that a signal ended, or whose results were complete; also where SIGINT is ignored, as in background."""
    python = executable(
        tmp_path / "python",
        f'trap "{answer}" USR1 TERM; touch {tmp_path}/ready-$$\n'
        f"until [ -e {tmp_path}/complete ]; do sleep 0.1; done",
    )
    with subprocess.Popen(
        [str(scenes.ROOT / "scripts" / "run.sh"), "scene.toml"],
        stderr=subprocess.PIPE,
        text=True,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
        env=scenes.clean_environment() | {"DDMPI_PYTHON": str(python)},
    ) as run:
        end = time.monotonic() + scenes.LIMIT
        while len(list(tmp_path.glob("ready-*"))) < 2 and time.monotonic() < end:
            time.sleep(0.05)
        run.send_signal(number)
        if not answer:
            (tmp_path / "complete").touch()
        assert run.wait(timeout=scenes.LIMIT) == code


@pytest.mark.slow
def test_a_set_up_that_was_interrupted_is_not_taken_for_a_complete_one(tmp_path):
    """Killed while it looks at the Python it has found; the next one starts anew and ends with one that works."""
    tools = tmp_path / "bin"
    tools.mkdir()
    environment = scenes.clean_environment() | {"DDMPI_VENV": str(tmp_path / "venv")}
    environment["PATH"] = os.pathsep.join([str(tools), environment["PATH"]])
    environment.pop("DDMPI_PYTHON", None)
    command = [
        "bash",
        "-c",
        f'. {shlex.quote(str(scenes.ROOT))}/scripts/setup.sh && echo "$PYTHON"',
    ]

    executable(tools / "python3", f"touch {tmp_path}/looking; exec sleep 60")
    with subprocess.Popen(
        command, env=environment, start_new_session=True, stdout=subprocess.PIPE
    ) as first:
        end = time.monotonic() + scenes.LIMIT
        while not (tmp_path / "looking").exists() and time.monotonic() < end:
            time.sleep(0.05)
        os.killpg(first.pid, signal.SIGKILL)
    assert not (tmp_path / "venv" / "ddmpi-setup").exists()

    (tmp_path / "venv" / "bin").mkdir(parents=True, exist_ok=True)
    executable(tmp_path / "venv" / "bin" / "python", "echo half of a venv; exit 1")
    python = executable(tools / "python3", f'exec {shlex.quote(sys.executable)} "$@"')
    again = subprocess.run(
        command, env=environment, capture_output=True, text=True, timeout=scenes.LIMIT
    )
    assert again.returncode == 0, again.stderr
    assert again.stdout.strip() == str(python)
    assert (tmp_path / "venv" / "ddmpi-setup").exists()


def test_a_file_is_no_folder_of_results(tmp_path):
    """By words, not by the name of an error; nor is it one of a run to go on from."""
    file = tmp_path / "summary.json"
    file.write_text("{}")
    with (
        pytest.raises(InputError, match="not a complete folder of results: it is no folder"),
        reading(file),
    ):
        (file / "summary.json").read_text()
    with (
        pytest.raises(InputError, match=r"--restart .*summary\.json: is no folder"),
        choose_folder(None, str(file), "scene.toml"),
    ):
        pass
