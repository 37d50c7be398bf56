"""Errors, signals, broken numbers and full disks on one rank: the whole run ends in time, with one message.

A selection of what `scripts/study fault_injection` tries: every fault in every phase on either rank.
"""

import os
import subprocess
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import fault
import pytest
import scenes
from fault_cases import RESULTS, Ground, Outcome, all_cases, run_in_one_go
from scenes import pinched_blocks

pytestmark = pytest.mark.slow

RELAXATION = ("--set", "method.outer=relaxation")
WHOLE = set(RESULTS)

DEADLY = [
    "outer, published: KeyboardInterrupt on rank 1",
    "factor: SIGSEGV on rank 1",
    "output: RuntimeError on rank 1",
    "writing a checkpoint: SIGKILL",
    "publishing: SIGKILL between two files",
]
ORDERLY = [
    "output: gone on rank 0",
    "NaN in the stiffness on rank 1",
    "zero pivot on rank 0",
    "NaN from a product on rank 1",
    "an error of PETSc on rank 1",
    "conclude: full on rank 0",
]
"""These end on all ranks, one after another in one child; after the last one no file of it grows."""


@pytest.fixture(scope="module")
def outcomes(tmp_path_factory) -> dict[str, Outcome]:
    cases = {case.name: case for case in all_cases()}
    ground = Ground(tmp_path_factory.mktemp("faults"))
    with ThreadPoolExecutor(2) as pool:
        found = dict(
            zip(DEADLY, pool.map(ground.try_case, [cases[name] for name in DEADLY]), strict=True)
        )
    together = ground.try_together([cases[name] for name in ORDERLY])
    found |= dict(zip(ORDERLY, together, strict=True))
    ground.go_on([*found.values()])
    return found


@pytest.mark.parametrize("name", DEADLY + ORDERLY)
def test_the_run_ends_and_nothing_is_lost(outcomes, name):
    outcome = outcomes[name]
    assert not outcome.faults, outcome.output


# Our own errors

RAISED = [
    # rank, target, call, kind, more arguments
    (1, "ddmpi.coupling.parts.build_mesh", 1, "SolverError", ()),
    (0, "ddmpi.coupling.parts.assemble", 1, "OutputError", ()),
    (1, "ddmpi.body.solver.StiffnessSolver.__init__", 1, "SolverError", ()),
    (
        0,
        "ddmpi.body.compliance.Compliance.mult",
        12,
        "SolverError",
        (),
    ),  # within GMRES of the Newton method
    (1, "ddmpi.published.published.Subproblem.neumann", 3, "OutputError", RELAXATION),
    (0, "ddmpi.system.files.put", 1, "SolverError", ()),
    (1, "ddmpi.system.files.put", 1, "OutputError", ()),
    (
        0,
        "ddmpi.run.gather.write_summary",
        1,
        "OutputError",
        (),
    ),  # by rank 0 alone, when all else is there
]
EXIT = {"SolverError": 4, "OutputError": 5}


def test_own_error_on_one_rank_is_raised_on_all(tmp_path):
    """They end in an orderly way, so that one child has them one after another."""
    scene = scenes.write_scene(pinched_blocks(2), tmp_path / "scene.toml")
    runs = run_in_one_go(
        [(*where, str(tmp_path / f"{k}"), more) for k, (*where, more) in enumerate(RAISED)],
        "run",
        str(scene),
        "--no-figures",
    )
    for run, (_, target, _, error, _) in zip(runs, RAISED, strict=True):
        kept = error == "OutputError" and not target.endswith("parts.assemble")
        assert run.code == EXIT[error] and len(run.messages) == 1, (target, run.output)
        assert run.messages[0].startswith(f"ddmpi: error: {fault.MESSAGE}")
        assert scenes.beside_clamps(run.own_stderr.splitlines()) == run.messages
        assert (f"--restart {run.folder} goes on" in run.messages[0]) == kept
        assert run.files == (
            {"checkpoint.h5"} if kept else set()
        )  # nor a folder in which results are made


# A disk that is full


@pytest.fixture
def small_disk(tmp_path) -> Iterator[Path]:
    """A file system of 300 KiB."""
    place = tmp_path / "disk"
    place.mkdir()
    mounted = subprocess.run(
        ["mount", "-t", "tmpfs", "-o", "size=300k", "tmpfs", str(place)],
        capture_output=True,
        text=True,
    )
    if mounted.returncode:
        pytest.skip(f"a small file system cannot be mounted here: {mounted.stderr.strip()}")
    yield place
    subprocess.run(["umount", "--lazy", str(place)], check=True)


def fill(disk: Path, leave: int) -> None:
    """Leave that many pages."""
    room = os.statvfs(disk)
    (disk / "filler").write_bytes(bytes((room.f_bavail - leave) * room.f_frsize))


@pytest.mark.parametrize("leave", [3, 12])  # 3: the disk is full when a case begins to tell its log
def test_a_sweep_on_a_full_disk_ends_in_good_order(small_disk, tmp_path, leave):
    """And when there is room again, the same command goes on."""
    scene = scenes.write_scene(pinched_blocks(2), tmp_path / "scene.toml")
    fill(small_disk, leave)
    sweep = [
        "sweep",
        str(scene),
        "--vary",
        "contact.0.friction.coefficient=0.1:0.4:2",
        "--output",
        str(small_disk / "out"),
        "--set",
        "output.figures=false",
    ]
    run = scenes.run_python(["-m", "ddmpi", *sweep], 1)
    assert run.code in (3, 5), run.output
    assert len(run.messages) == 1 and "Traceback" not in run.output
    for folder in (small_disk / "out").glob("*/"):
        there = {path.name for path in folder.iterdir()}
        assert there >= WHOLE if "summary.json" in there else not there & WHOLE, there
    (small_disk / "filler").unlink()
    again = scenes.call(*sweep)
    assert again.code == 0, again.output


@pytest.mark.parametrize("leave, ranks", [(0, 1), (5, 2)])
def test_a_run_on_a_full_disk_ends_in_good_order(small_disk, tmp_path, leave, ranks):
    scene = scenes.write_scene(pinched_blocks(4), tmp_path / "scene.toml")
    folder = small_disk / "out"
    folder.mkdir()
    fill(small_disk, leave)
    start = scenes.run_command if ranks > 1 else scenes.run_here
    run = start(scene, folder, "--no-figures", "--log", str(small_disk / "run.log"))
    assert run.code == 5 and len(run.messages) == 1 and "Traceback" not in run.output, run.output
    assert "No space left on device" in run.messages[0] and str(folder) in run.messages[0]
    assert run.files <= {"checkpoint.h5"}
    (small_disk / "filler").unlink()
    (small_disk / "run.log").unlink(missing_ok=True)
    again = start(scene, folder, "--no-figures", *(["--restart", str(folder)] if run.files else []))
    assert again.code == 0 and again.files == WHOLE, again.output
