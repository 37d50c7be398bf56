"""The command: interrupted by a signal in every phase, gone on with --restart, and refused where it must be.

Also what the results may depend on: not on the run, nor the folder, nor the order of bodies and ranks.
"""

import os
import re
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

pytestmark = pytest.mark.slow

FILES = set(RESULTS)

def solids_in_steps() -> dict:
    """Two boxes that are loaded in four steps and then in the other direction."""
    scene = two_boxes(2) | {"history": {"load": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]}},
                            "time": {"points": [1.0, 2.0], "steps": 2}}
    for body in scene["body"]:
        body["traction"] = [load | {"history": "load"} for load in body["traction"]]
    return scene


METHODS = {
    "newton": pinched_blocks(2),
    "published": pinched_blocks(2, theta=0.2, tolerance=1e-3),
    "two meshes": pinched_blocks(2, target_error=0.17),
    "drawn": scenes.drawn_roller(target_error=0.05),
    "solids": solids_in_steps(), "bolt": bolts.joint(steps=2),
}
FACTOR, MULT, NEUMANN = "ddmpi.body.solver.StiffnessSolver.__init__", "ddmpi.body.compliance.Compliance.mult", \
    "ddmpi.published.subproblem.Subproblem.neumann"
INTERRUPTED = {
    # name: method, signal, rank, target, call (not the last ones: versions of PETSc differ by a few), whether there is
    # a checkpoint then
    "mesh": ("newton", "SIGTERM", 1, "ddmpi.coupling.assembly.build_mesh", 1, False),
    "factorization": ("newton", "SIGUSR1", 0, FACTOR, 1, False),
    "a step of Newton's method": ("newton", "SIGUSR1", 1, MULT, 34, False),
    "certificate": ("newton", "SIGUSR1", 1, "ddmpi.coupling.member.Member.displacement", 1, True),
    "inner solve": ("published", "SIGTERM", 1, MULT, 60, True),
    "Neumann problem": ("published", "SIGUSR1", 0, NEUMANN, 9, True),
    "finer mesh": ("two meshes", "SIGUSR1", 0, FACTOR, 2, True),
    "finer drawn mesh": ("drawn", "SIGUSR1", 0, FACTOR, 2, True),
    "later load step of solids": ("solids", "SIGTERM", 1, MULT, 60, True),
    "offset of a bolt that is kept": ("bolt", "SIGTERM", 1, MULT, 60, True),
    "iteration on a finer drawn mesh": ("drawn", "SIGTERM", 1, MULT, 70, True),
}


@pytest.fixture(scope="module")
def here(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("restart")
    for name, scene in METHODS.items():
        scenes.write_scene(scene, folder / f"{name}.toml")
    return folder


@pytest.fixture(scope="module")
def undisturbed(here) -> dict[str, Run]:
    runs = run_in_one_go([(0, "", 0, "", str(here / f"undisturbed {name}"), [str(here / f"{name}.toml")])
                          for name in METHODS], "run", "--no-figures")
    return dict(zip(METHODS, runs, strict=True))


@pytest.fixture(scope="module")
def interrupted(here) -> dict[str, Run]:
    """By name, the runs that a signal ended."""
    runs = run_in_one_go([(rank, target, call, number, str(here / name), [str(here / f"{method}.toml")])
                          for name, (method, number, rank, target, call, _) in INTERRUPTED.items()],
                         "run", "--no-figures")
    return dict(zip(INTERRUPTED, runs, strict=True))


@pytest.fixture(scope="module")
def files_then(interrupted) -> dict[str, set[str]]:
    """What these have left, before others go on from it."""
    return {name: run.files for name, run in interrupted.items()}


@pytest.fixture(scope="module")
def whole(interrupted) -> bytes:
    """The checkpoint of one of them."""
    return (interrupted["Neumann problem"].folder / "checkpoint.h5").read_bytes()


@pytest.fixture(scope="module")
def continued(here, interrupted, files_then, whole) -> dict[str, Run]:
    """By name, the runs that go on from a checkpoint."""
    names = [name for name, row in INTERRUPTED.items() if row[5]]
    runs = run_in_one_go([(0, "", 0, "", str(here / name),
                           [str(here / f"{INTERRUPTED[name][0]}.toml"), "--restart", str(here / name)])
                          for name in names], "run", "--no-figures")
    return dict(zip(names, runs, strict=True))


@pytest.mark.parametrize("name", INTERRUPTED)
def test_a_signal_ends_the_run_with_its_own_exit_code_and_one_message(interrupted, files_then, name):
    run = interrupted[name]
    number, kept = INTERRUPTED[name][1], INTERRUPTED[name][5]
    assert run.code == 6, run.output
    message = only_message(run)
    assert message.startswith(f"ddmpi: interrupted by {number}: ")
    assert (f"--restart {run.folder}" in message) == kept
    assert kept or "nothing to save" in message
    assert files_then[name] == ({"checkpoint.h5"} if kept else set())


@pytest.mark.parametrize("name", [name for name in INTERRUPTED if INTERRUPTED[name][5]])
def test_restart_ends_with_the_results_of_the_run_that_was_not_interrupted(continued, undisturbed, name):
    run = continued[name]
    assert run.code == 0, run.output
    expected = undisturbed[INTERRUPTED[name][0]]
    between = INTERRUPTED[name][0] in ("two meshes", "drawn")
    assert ("continuing with meshes" if between else "continuing after iteration") in run.stdout
    assert expected.files == FILES or INTERRUPTED[name][0] in ("drawn", "solids", "bolt")
    assert run.files == expected.files  # and no checkpoint any more
    assert contents(run.folder) == contents(expected.folder)


@pytest.fixture(scope="module")
def from_outside(here) -> tuple[Run, Run]:
    """A run on more unknowns than it could solve in time, ended by a signal to mpirun, which passes it on."""
    scene = scenes.write_scene(pinched_blocks(12, theta=0.01, tolerance=1e-9, max_iterations=10**6),
                               here / "endless.toml")
    folder = here / "from outside"
    command = [*os.environ.get("MPIRUN", "mpirun").split(), "-n", "2", sys.executable, "-m", "ddmpi", "run",
               str(scene), "--output", str(folder), "--set", "checkpoint.iterations=5"]
    with subprocess.Popen(command, env=scenes.clean_environment(), text=True, stdin=subprocess.DEVNULL,
                          stdout=subprocess.PIPE, stderr=subprocess.PIPE) as child:
        end = time.monotonic() + scenes.LIMIT
        while not (folder / "checkpoint.h5").exists() and time.monotonic() < end:
            time.sleep(0.1)
        child.send_signal(signal.SIGUSR1)
        stdout, stderr = child.communicate(timeout=scenes.LIMIT)
    run = Run(child.returncode, stdout, stderr, folder)
    k = int(re.search(r"after iteration (\d+)", run.stderr)[1])
    return run, scenes.run_command(scene, folder, "--restart", str(folder), "--set",
                                   f"method.max_iterations={k + 2}", "--no-figures")


def test_a_signal_to_mpirun_is_heard(from_outside):
    """MPICH's mpirun may then return zero instead of the exit code of the ranks."""
    run, _ = from_outside
    assert run.code == 6 or (run.code == 0 and os.environ.get("BARE_SIGNALS"))
    assert only_message(run).startswith("ddmpi: interrupted by SIGUSR1: ")


def test_max_iterations_may_be_another_after_the_restart(from_outside):
    run, more = from_outside
    k = int(re.search(r"after iteration (\d+)", run.stderr)[1])
    assert more.code == 3
    assert more.summary["outer_iterations"] == k + 2
    assert more.files == FILES


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


@pytest.mark.parametrize(("name", "number"), [("ddmpi.cli.main", "SIGUSR1"), ("mpi4py", "SIGTERM"),
                                              ("petsc4py", "SIGUSR1")])
def test_a_signal_while_the_program_is_loaded(here, tmp_path, monkeypatch, name, number):
    run = run_with(START.format(name=name, number=number), tmp_path, monkeypatch, "run", str(here / "newton.toml"),
                   "--output", str(tmp_path / "out"))
    assert run.code == 6, run.output
    assert only_message(run) == f"ddmpi: interrupted by {number}: in the first load step or before it; there was \
nothing to save"
    assert not run.folder.exists()


def test_a_signal_after_the_results_comes_too_late(here, tmp_path, monkeypatch):
    """While the interpreter ends: it has taken its own handlers away then."""
    run = run_with(END, tmp_path, monkeypatch, "run", str(here / "newton.toml"), "--no-figures",
                   "--output", str(tmp_path / "out"))
    assert (run.code, run.own_stderr, run.files) == (0, "", FILES)


def test_what_has_nothing_to_save_is_ended_by_a_signal(tmp_path, monkeypatch):
    run = run_with(START.format(name="ddmpi.cli.info", number="SIGTERM"), tmp_path, monkeypatch, "info", ranks=1)
    assert run.code not in range(7) and run.messages == []


# Refused


@pytest.fixture(scope="module")
def refused(here, whole) -> dict[str, tuple[Run, bool]]:
    """Runs that must not go on from a checkpoint, and whether they have left it as it was."""
    kept = dict.fromkeys(REASONS, whole) | {"a damaged file": whole[:-100] + bytes(byte ^ 1 for byte in whole[-100:])}
    del kept["nothing there"]
    folders = {name: here / f"refused {name}" for name in REASONS}
    for name, data in kept.items():
        folders[name].mkdir()
        (folders[name] / "checkpoint.h5").write_bytes(data)
    more = {name: [str(here / "published.toml"), "--restart", str(folder)] for name, folder in folders.items()}
    more["another scene"] += ["--set", "body.upper.material.young=1e11"]
    more["no restart"], more["nothing there"][-1] = more["no restart"][:1], str(here / "nowhere")
    option = more.pop("another option")  # of PETSc, which reads it once in a process
    runs = dict(zip(more, run_in_one_go([(0, "", 0, "", str(folders[name]), arguments)
                                         for name, arguments in more.items()], "run"), strict=True))
    runs["another option"] = scenes.run_python(["-m", "ddmpi", "run", *option, "-qp_tao_type", "gpcg"],
                                               folder=folders["another option"])
    return {name: (run, name not in kept or (run.folder / "checkpoint.h5").read_bytes() == kept[name])
            for name, run in runs.items()}


REASONS = {
    "another scene": ["checkpoint.h5", "body.upper.material.young is 100000000000.0 here, 211900000000.0 there"],
    "another option": ["checkpoint.h5", "qp_tao_type is 'gpcg' here, not set there"],
    "a damaged file": ["checkpoint.h5: damaged"],
    "no restart": ["there is the checkpoint of a run that was not completed", "--restart"],
    "nothing there": ["nowhere", "there is no checkpoint.h5"],
}


@pytest.mark.parametrize("name", REASONS)
def test_what_is_not_the_same_run_is_refused_with_the_reason(refused, name):
    run, untouched = refused[name]
    assert run.code == 2, run.output
    message = only_message(run)
    for words in REASONS[name]:
        assert words in message
    assert untouched
    assert run.files == (set() if name == "nothing there" else {"checkpoint.h5"})


# The same answer everywhere


def bodies_swapped(scene: dict) -> dict:
    """The other [[body]] table first: the bodies change ranks."""
    return scene | {"body": scene["body"][::-1]}


SAME = {"newton": pinched_blocks(6), "published": pinched_blocks(4, theta=0.2, tolerance=1e-4),
        "stack": scenes.sheared_stack(4, 1e-4, {"law": "coulomb", "coefficient": 0.3}).scene()}


@pytest.fixture(scope="module")
def repeated(here) -> dict[tuple[str, str], Run]:
    """Each scene twice, the second time elsewhere; and with bodies swapped."""
    variants = {(name, what): vary(scene) for name, scene in SAME.items()
                for what, vary in {"first": dict, "again": dict, "bodies swapped": bodies_swapped}.items()}
    for (name, what), scene in variants.items():
        (here / f"{name} {what}").mkdir()
        scenes.write_scene(scene, here / f"{name} {what}" / "scene.toml")

    def job(names: list[tuple[str, str]], cwd: Path) -> list[Run]:
        return run_in_one_go([(0, "", 0, "", str(here / " ".join(name) / "out"), [
            os.path.relpath(here / " ".join(name) / "scene.toml", cwd),
            *([] if name in (("newton", "first"), ("newton", "again")) else ["--no-figures"])]) for name in names],
            "run", cwd=cwd)

    there = [name for name in variants if name[1] == "again"]
    rest = [name for name in variants if name[1] != "again"]
    return dict(zip([*there, *rest], [*job(there, here / "newton again"), *job(rest, here)], strict=True))


def fields(run: Run) -> dict[str, np.ndarray]:
    with h5py.File(run.folder / "result.h5") as file:
        return {name: np.array(data) for name, data in file.items()}


@pytest.mark.parametrize("name", SAME)
def test_a_run_repeats_bit_for_bit(repeated, name):
    """In another folder, from another working folder, with the scene named otherwise."""
    first, again = repeated[name, "first"], repeated[name, "again"]
    assert first.code == again.code == 0, first.output + again.output
    assert contents(first.folder) == contents(again.folder)


def test_pictures_repeat_pixel_for_pixel(repeated):
    """Beside the pixels they carry the name of their run."""
    from matplotlib.image import imread

    first, again = (repeated["newton", what].folder for what in ("first", "again"))
    pictures = sorted(path.name for path in first.glob("*.png"))
    assert len(pictures) >= 3
    for picture in pictures:
        assert np.array_equal(imread(first / picture), imread(again / picture)), picture


@pytest.mark.parametrize("name", SAME)
def test_bodies_that_change_ranks_change_nothing_but_their_order(repeated, name):
    first, swapped = repeated[name, "first"], repeated[name, "bodies swapped"]
    for file in ("history.csv", "steps.csv", "contact_upper-lower.csv"):
        assert (first.folder / file).read_bytes() == (swapped.folder / file).read_bytes()
    one, other = contents(first.folder)["summary"], contents(swapped.folder)["summary"]
    for each in (one, other):
        assert [body.pop("ranks") for body in each["bodies"].values()] == [[0], [1]]
        each["scene"]["body"].sort(key=lambda body: body["name"])
    assert one == other
    was, now = fields(first), fields(swapped)
    for field in ("displacement", "stress", "von_mises", "points"):
        part = was[field]
        cut = np.searchsorted(was["body"], 1) if len(part) == len(was["body"]) else was["cells"][was["body"] == 1].min()
        assert np.array_equal(np.concatenate([part[cut:], part[:cut]]), now[field])
