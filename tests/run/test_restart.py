"""The command: interrupted by a signal in every phase, gone on with --restart, and refused where it must be.

Also what the results may depend on: not on the run, nor the folder, nor the order of bodies and ranks.
"""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import bolts
import h5py
import numpy as np
import pytest
import scenes
from fault_cases import RESULTS, contents, run_in_one_go
from scenes import Run, pinched_blocks
from solid_scenes import two_boxes
from test_failures import only_message

from ddmpi.results.tables import read_fields

pytestmark = pytest.mark.slow

FILES = set(RESULTS)


def solids_in_steps() -> dict:
    """Two boxes that are loaded in four steps and then in the other direction."""
    scene = two_boxes(2) | {
        "history": {"load": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]}},
        "time": {"points": [1.0, 2.0], "steps": 2},
    }
    for body in scene["body"]:
        body["traction"] = [load | {"history": "load"} for load in body["traction"]]
    return scene


METHODS = {
    "newton": pinched_blocks(2),
    "published": pinched_blocks(2, theta=0.2, tolerance=1e-3),
    "drawn": scenes.drawn_roller(target_error=0.05),
    "solids": solids_in_steps(),
    "bolt": bolts.joint(steps=2),
}
FACTOR, MULT = "ddmpi.body.solver.StiffnessSolver.__init__", "ddmpi.body.compliance.Compliance.mult"
INTERRUPTED = {
    # name: method, signal, rank, target, call (not the last ones: versions of PETSc differ by a few), whether there is
    # a checkpoint then
    "mesh": ("newton", "SIGTERM", 1, "ddmpi.coupling.parts.build_mesh", 1, False),
    "a step of Newton's method": ("newton", "SIGUSR1", 1, MULT, 34, False),
    "certificate": ("newton", "SIGUSR1", 1, "ddmpi.coupling.member.Member.displacement", 1, True),
    "inner solve": ("published", "SIGTERM", 1, MULT, 60, True),
    "finer drawn mesh": ("drawn", "SIGUSR1", 0, FACTOR, 2, True),
    "later load step of solids": ("solids", "SIGTERM", 1, MULT, 60, True),
    "offset of a bolt that is kept": ("bolt", "SIGTERM", 1, MULT, 60, True),
}


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("restart")
    for name, scene in METHODS.items():
        scenes.write_scene(scene, folder / f"{name}.toml")
    return folder


@pytest.fixture(scope="module")
def first(here) -> dict[str, Run]:
    """By name, the runs that a signal ended; by method, those that nothing disturbed."""
    faults = {
        name: (rank, target, call, number, str(here / name), [str(here / f"{method}.toml")])
        for name, (method, number, rank, target, call, _) in INTERRUPTED.items()
    } | {
        name: (0, "", 0, "", str(here / f"undisturbed {name}"), [str(here / f"{name}.toml")])
        for name in METHODS
    }
    runs = run_in_one_go([*faults.values()], "run", "--no-figures")
    return dict(zip(faults, runs, strict=True))


@pytest.fixture(scope="module")
def undisturbed(first) -> dict[str, Run]:
    return {name: first[name] for name in METHODS}


@pytest.fixture(scope="module")
def interrupted(first) -> dict[str, Run]:
    return {name: first[name] for name in INTERRUPTED}


@pytest.fixture(scope="module")
def files_then(interrupted) -> dict[str, set[str]]:
    """What these have left, before others go on from it."""
    return {name: run.files for name, run in interrupted.items()}


@pytest.fixture(scope="module")
def whole(interrupted) -> bytes:
    """The checkpoint of one of them."""
    return (interrupted["inner solve"].folder / "checkpoint.h5").read_bytes()


SAME = ("newton", "published")
"""Methods of which all runs have one answer."""


@pytest.fixture(scope="module")
def second(here, interrupted, files_then, whole) -> dict[str, Run]:
    """In other processes, which work in another folder: by name, the runs that go on from a checkpoint; for each of
    `SAME` "again" and, with the other body first, "swapped"."""
    given = {
        name: [str(here / f"{row[0]}.toml"), "--restart", str(here / name)]
        for name, row in INTERRUPTED.items()
        if row[5]
    }
    place = here / "another folder"
    for name in SAME:
        for what, way in {"again": 1, "swapped": -1}.items():
            scene = METHODS[name] | {"body": METHODS[name]["body"][::way]}
            (place / f"{name} {what}").mkdir(parents=True)
            scenes.write_scene(scene, place / f"{name} {what}" / "scene.toml")
            given[f"{name} {what}"] = [os.path.join("..", f"{name} {what}", "scene.toml")]
    runs = run_in_one_go(
        [(0, "", 0, "", str(here / name), more) for name, more in given.items()],
        "run",
        "--no-figures",
        cwd=place / f"{SAME[0]} again",
    )
    return dict(zip(given, runs, strict=True))


@pytest.mark.parametrize("name", INTERRUPTED)
def test_a_signal_ends_the_run_with_its_own_exit_code_and_one_message(
    interrupted, files_then, name
):
    run = interrupted[name]
    number, kept = INTERRUPTED[name][1], INTERRUPTED[name][5]
    assert run.code == 6, run.output
    message = only_message(run)
    assert message.startswith(f"ddmpi: interrupted by {number}: ")
    assert (f"--restart {run.folder}" in message) == kept
    assert kept or "nothing to save" in message
    assert files_then[name] == ({"checkpoint.h5"} if kept else set())


@pytest.mark.parametrize("name", [name for name in INTERRUPTED if INTERRUPTED[name][5]])
def test_restart_ends_with_the_results_of_the_run_that_was_not_interrupted(
    second, undisturbed, name
):
    run = second[name]
    assert run.code == 0, run.output
    expected = undisturbed[INTERRUPTED[name][0]]
    drawn = INTERRUPTED[name][0] == "drawn"
    assert ("continuing with meshes" if drawn else "continuing after iteration") in run.stdout
    assert expected.files == FILES or INTERRUPTED[name][0] in ("drawn", "solids", "bolt")
    assert run.files == expected.files  # and no checkpoint any more
    assert contents(run.folder) == contents(expected.folder)


def test_a_signal_to_mpirun_is_heard(here):
    """It passes the signal on to a run that would not end in time. MPICH's mpirun may then return zero."""
    scene = scenes.write_scene(
        pinched_blocks(12, theta=0.01, tolerance=1e-9, max_iterations=10**6), here / "endless.toml"
    )
    folder = here / "from outside"
    command = [
        *os.environ.get("MPIRUN", "mpirun").split(),
        "-n",
        "2",
        sys.executable,
        "-m",
        "ddmpi",
        "run",
        str(scene),
        "--output",
        str(folder),
        "--set",
        "checkpoint.iterations=5",
    ]
    with subprocess.Popen(
        command,
        env=scenes.clean_environment(),
        text=True,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
    ) as child:
        end = time.monotonic() + scenes.LIMIT
        while not (folder / "checkpoint.h5").exists() and time.monotonic() < end:
            time.sleep(0.1)
        child.send_signal(signal.SIGUSR1)
        run = Run(child.returncode, *child.communicate(timeout=scenes.LIMIT), folder)
    assert child.returncode == 6 or (child.returncode == 0 and os.environ.get("BARE_SIGNALS"))
    assert only_message(run).startswith("ddmpi: interrupted by SIGUSR1: ")
    assert f"--restart {folder}" in run.messages[0] and run.files == {"checkpoint.h5"}


START = """
import os, signal, sys

class Finder:
    def find_spec(self, name, path=None, target=None):
        if name == {name!r}:
            sys.meta_path.remove(self)
            os.kill(os.getpid(), signal.{number})

sys.meta_path.insert(0, Finder())
"""
END = """
import os, signal

class Last:
    def __del__(self, kill=os.kill, process=os.getpid(), number=signal.SIGTERM):
        kill(process, number)

last = Last()
"""


def run_with(hook: str, here: Path, monkeypatch, *arguments: str, ranks: int = 2) -> Run:
    """The command in a Python that runs `hook` when it starts."""
    folder = here / "hook"
    folder.mkdir()
    (folder / "sitecustomize.py").write_text(hook)
    monkeypatch.setenv("PYTHONPATH", str(folder))
    return scenes.run_python(["-m", "ddmpi", *arguments], ranks, here / "out")


@pytest.mark.parametrize(
    ("name", "number"), [("ddmpi.cli.main", "SIGUSR1"), ("petsc4py", "SIGTERM")]
)
def test_a_signal_while_the_program_is_loaded(here, tmp_path, monkeypatch, name, number):
    run = run_with(
        START.format(name=name, number=number),
        tmp_path,
        monkeypatch,
        "run",
        str(here / "newton.toml"),
        "--output",
        str(tmp_path / "out"),
    )
    assert run.code == 6, run.output
    assert (
        only_message(run)
        == f"ddmpi: interrupted by {number}: in the first load step or before it; there was \
nothing to save"
    )
    assert not run.folder.exists()


def test_a_signal_after_the_results_comes_too_late(here, tmp_path, monkeypatch):
    """While the interpreter ends: it has taken its own handlers away then."""
    run = run_with(
        END,
        tmp_path,
        monkeypatch,
        "run",
        str(here / "newton.toml"),
        "--no-figures",
        "--output",
        str(tmp_path / "out"),
    )
    said = scenes.beside_clamps(run.own_stderr.splitlines())
    assert (run.code, said, run.files) == (0, [], FILES)


def test_what_has_nothing_to_save_is_ended_by_a_signal(tmp_path, monkeypatch):
    run = run_with(
        START.format(name="ddmpi.cli.info", number="SIGTERM"),
        tmp_path,
        monkeypatch,
        "info",
        ranks=1,
    )
    assert run.code not in range(7) and run.messages == []


# Refused


def test_what_is_not_the_same_run_is_refused_with_the_reason(here, whole, tmp_path):
    """Another option of PETSc; test_checkpoint and test_files have further reasons."""
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "checkpoint.h5").write_bytes(whole)
    run = scenes.run_command(
        here / "published.toml",
        tmp_path / "out",
        "--restart",
        "out",
        "-qp_tao_type",
        "gpcg",
        cwd=tmp_path,
    )
    assert run.code == 2 and "qp_tao_type is 'gpcg' here, not set there" in only_message(run), (
        run.output
    )
    assert run.files == {"checkpoint.h5"} and (run.folder / "checkpoint.h5").read_bytes() == whole


# The same answer everywhere


def fields(run: Run) -> dict[str, np.ndarray]:
    with h5py.File(run.folder / "result.h5") as file:
        return read_fields(file)


@pytest.mark.parametrize("name", SAME)
def test_a_run_has_one_answer(undisturbed, second, name):
    """Bit for bit from another folder; with the other body first, on other ranks, all but the order is the same."""
    first, again, swapped = undisturbed[name], second[f"{name} again"], second[f"{name} swapped"]
    assert first.code == again.code == swapped.code == 0, first.output + again.output
    assert contents(first.folder) == contents(again.folder)
    for file in ("history.csv", "steps.csv", "contact_upper-lower.csv"):
        assert (first.folder / file).read_bytes() == (swapped.folder / file).read_bytes()
    one, other = contents(first.folder)["summary"], contents(swapped.folder)["summary"]
    for each in (one, other):
        assert [body.pop("ranks") for body in each["bodies"].values()] == [[0], [1]]
        each["scene"]["body"].sort(key=lambda body: body["name"])
    assert one == other
    was, now = fields(first), fields(swapped)
    for field in ("displacement", "stress", "von_mises", "points"):
        part, start = was[field], was["cells"][was["body"] == 1].min()
        cut = np.searchsorted(was["body"], 1) if len(part) == len(was["body"]) else start
        assert np.array_equal(np.concatenate([part[cut:], part[:cut]]), now[field])
