"""Checkpoints in process: every state is whole, and a run that goes on from one is the run that was not interrupted."""

import copy
import itertools
import logging
import os
import shutil
import signal
import tempfile
from collections import deque
from collections.abc import Iterator
from pathlib import Path

import h5py
import numpy as np
import pytest
import scenes
from mpi4py import MPI
from scenes import pinched_blocks

import ddmpi.run.solve
from ddmpi.body.compliance import Compliance
from ddmpi.errors import InputError, InterruptionError, OutputError, TakenError
from ddmpi.judge.accuracy import MeshLadder
from ddmpi.methods.newton import Newton
from ddmpi.results import checkpoint
from ddmpi.results.checkpoint import Checkpoints, continue_from, identify
from ddmpi.run.solve import Iteration, solve
from ddmpi.scene.reader import read_scene
from ddmpi.system import interrupt
from ddmpi.system.clock import Clock

two_ranks = pytest.mark.mpi(ranks=2)

VERSIONS = {name: "1" for name in ("ddmpi", "petsc", "numpy", "scipy")}

MULT = Compliance.mult
MULTIGRID = 1e-5
"""Relative distance of forces that a restart with multigrid may leave, unless the tolerance is larger."""

RELAXATION = {"theta": 0.2, "tolerance": 1e-3}
KINDS = {
    # name: friction law, method, every which multiplication is interrupted
    "anderson": ("coulomb", {"outer": "anderson", "tolerance": 1e-6}, 37),
    "relaxation": ("tresca", RELAXATION | {"algorithm": "modified", "splitting": "step1+2"}, 23),
}


@pytest.fixture(autouse=True)
def no_signal_yet(monkeypatch):
    monkeypatch.setattr(interrupt, "_received", [])


@pytest.fixture
def shared(comm) -> Iterator[Path]:
    """A folder that both ranks know."""
    folder = comm.bcast(tempfile.mkdtemp() if comm.rank == 0 else None)
    yield Path(folder)
    if comm.rank == 0:
        shutil.rmtree(folder)


def note_signal_at(monkeypatch, number: int | None) -> None:
    """As if SIGTERM came just before the number-th multiplication by this rank's compliance from now on."""
    calls = itertools.count(1)

    def mult(self, *arguments):
        if next(calls) == number:
            interrupt._note(signal.SIGTERM, None)
        return MULT(self, *arguments)

    monkeypatch.setattr(Compliance, "mult", mult)


def start(comm, scene: dict, folder: Path, restart: bool = False) -> tuple:
    """The assembly and its checkpoints, as `ddmpi.run.run` makes them."""
    assembly = scenes.prepare_scene(comm, scene)
    identity = identify(assembly.scene, {}, VERSIONS)
    state = continue_from(comm, str(folder), identity) if restart else None
    return assembly, Checkpoints(
        comm,
        folder if comm.rank == 0 else None,
        identity,
        assembly.scene.checkpoint,
        Clock(),
        MeshLadder(assembly.scene),
        state,
    )


def outcome(assembly, answer) -> dict:
    """All that must be the same, to the last bit."""
    outer, states = answer.outer, answer.states.values()
    arrays = [
        outer.forces,
        outer.mismatch,
        outer.bound,
        *outer.body_forces(),
        *answer.displacements.values(),
        *answer.statuses.state()["recent"],
    ]
    arrays += [
        array
        for state in states
        for array in (state.normal_force, state.tangential_force, state.gap, state.slip)
    ]
    return {
        "arrays": [array.tobytes() for array in arrays],
        "status": [state.status.tolist() for state in states],
        "history": outer.history,
        "stopped": answer.stopped,
        "inner steps": dict(outer.inner_steps),
        "certificate": answer.certificate,
        "counts": [list(body.member.C.count.items()) for body in assembly.bodies],
        "exchange": assembly.exchange.state(),
    }


def run(comm, scene: dict, folder: Path, restart: bool = False) -> dict:
    assembly, checkpoints = start(comm, scene, folder, restart)
    with checkpoints.kept():
        answer = solve(assembly, assembly.scene.method, checkpoints=checkpoints)
    checkpoints.remove()
    assert not there(comm, folder)
    return outcome(assembly, answer)


def alike(one: dict, other: dict, scene: dict) -> bool:
    """Whether outcomes are equal; with multigrid, which starts from solutions before, to its precision."""
    if scene["method"].get("compliance") != "iterative":
        return one == other
    forces, others = (np.frombuffer(each["arrays"][0]) for each in (one, other))
    distance = max(MULTIGRID, scene["method"].get("tolerance", 0.0))
    return (one["stopped"], one["status"]) == (other["stopped"], other["status"]) and bool(
        np.abs(forces - others).max(initial=0.0) <= distance * np.abs(others).max(initial=0.0)
    )


def listing(comm, folder: Path) -> list[str]:
    """The names in a folder, as rank 0 sees them, which does the writing."""
    return comm.bcast([path.name for path in folder.iterdir()] if comm.rank == 0 else None)


def there(comm, folder: Path) -> bool:
    return checkpoint.CHECKPOINT in listing(comm, folder)


def interrupt_everywhere(comm, scene: dict, folder: Path, stride: int, monkeypatch) -> set[int]:
    """Interrupt a run at every stride-th multiplication, on each rank in turn, and go on; the iterations met."""
    note_signal_at(monkeypatch, None)
    reference = run(comm, scene, folder)
    met, number = set(), 1
    while True:
        interrupt._received.clear()
        note_signal_at(monkeypatch, number if comm.rank == number % comm.size else None)
        try:
            result = run(comm, scene, folder)
        except InterruptionError as error:
            assert error.agreed and error.kind == "interrupted by SIGTERM"
            if there(comm, folder):
                met.add(int(str(error).split("iteration ")[1].split()[0]))
                interrupt._received.clear()
                assert alike(run(comm, scene, folder, restart=True), reference, scene)
            else:
                assert "nothing to save" in str(error)
        else:  # it was over before the signal came
            assert result == reference
            return met
        number += stride


@pytest.mark.slow
@two_ranks
@pytest.mark.parametrize("kind", KINDS)
def test_restart_gives_the_same_bits(comm, shared, monkeypatch, kind):
    law, method, stride = KINDS[kind]
    met = interrupt_everywhere(comm, pinched_blocks(2, law, **method), shared, stride, monkeypatch)
    assert len(met) >= 3


@pytest.mark.slow
@two_ranks
def test_restart_where_the_certificate_failed_and_the_tolerance_was_tightened(
    comm, shared, monkeypatch
):
    monkeypatch.setattr(ddmpi.run.solve, "certificate_limit", lambda tolerance: 1e-3 * tolerance)
    monkeypatch.setattr(ddmpi.run.solve, "TIGHTER", 0.3)
    scene = pinched_blocks(2, outer="relaxation", tolerance=1e-2)
    assert len(interrupt_everywhere(comm, scene, shared, 97, monkeypatch)) >= 3


@pytest.mark.slow
@two_ranks
def test_newtons_method_is_not_kept_within_a_load_step(comm, shared, monkeypatch):
    """Also not where it goes on as the certificate has failed: the state of the former end is none of this one."""
    monkeypatch.setattr(ddmpi.run.solve, "certificate_limit", lambda tolerance: 1e-3 * tolerance)
    assert (
        interrupt_everywhere(comm, pinched_blocks(2, tolerance=1e-3), shared, 29, monkeypatch)
        == set()
    )


@pytest.mark.slow
@pytest.mark.mpi(ranks=[1, 2])
def test_a_restored_state_is_the_whole_state(comm, shared):
    """Restored objects hold what the objects held that were noted, and a noted state does not change later: of one method
    on one rank, of the other on two."""
    law, method, _ = KINDS[["relaxation", "anderson"][comm.size - 1]]
    scene = pinched_blocks(2, law, **method)

    def solve_looking(checkpoints: Checkpoints, assembly, look) -> None:
        note = checkpoints.note

        def noted(*arguments) -> None:
            note(*arguments)
            look(checkpoints)

        checkpoints.note = noted
        solve(assembly, assembly.scene.method, checkpoints=checkpoints)

    held, states, copies = [], [], []

    def remember(checkpoints: Checkpoints) -> None:
        held.append({name: data_of(part) for name, part in checkpoints._followed.items()})
        states.append(checkpoints._now)
        copies.append(copy.deepcopy(checkpoints._now))

    assembly, checkpoints = start(comm, scene, shared)
    solve_looking(checkpoints, assembly, remember)
    assert all(same(state, then) for state, then in zip(states, copies, strict=True))
    assert not same(states[2]["outer"], states[3]["outer"])
    for k in (1, 3):
        everyone = comm.gather(states[k])
        if comm.rank == 0:
            checkpoint.write(shared / checkpoint.CHECKPOINT, checkpoints.identity, everyone)
        comm.barrier()
        restored = []
        assembly, again = start(comm, scene, shared, restart=True)
        solve_looking(
            again,
            assembly,
            lambda found, restored=restored: restored.append(
                {name: data_of(part) for name, part in found._followed.items()}
            ),
        )
        assert restored[0].keys() == held[k].keys()
        for name, part in restored[0].items():
            for key, value in part.items():
                assert same(value, held[k][name][key]), (name, key)


def data_of(part: object) -> dict:
    """Copies of the attributes that hold data, also those of parts of the part."""
    found = {}
    for key, value in vars(part).items():
        parts = value if isinstance(value, list) else [value]
        if parts and hasattr(parts[0], "state"):
            for k, inner in enumerate(parts):
                found |= {f"{key}.{k}.{name}": each for name, each in data_of(inner).items()}
        elif isinstance(value, bool | int | float | str | np.ndarray | dict | list | deque):
            found[key] = copy.deepcopy(value)
    return found


def same(one: object, other: object) -> bool:
    if isinstance(one, dict):
        return one.keys() == other.keys() and all(
            same(value, other[key]) for key, value in one.items()
        )
    if isinstance(one, list | tuple | deque):
        return len(one) == len(other) and all(map(same, one, other))
    return np.array_equal(one, other)


# When they are written


def full(number: int) -> None:
    """What writes on a disk without space."""
    raise OSError(28, "No space left on device")


def count_writes(monkeypatch) -> list[int]:
    """Iterations of the checkpoints that this rank writes from now on."""
    written, write = [], checkpoint.write

    def noted(path, identity, states):
        written.append(states[0]["iterations"])
        write(path, identity, states)

    monkeypatch.setattr(checkpoint, "write", noted)
    return written


@pytest.mark.slow
@two_ranks
def test_every_so_many_iterations_and_none_by_default_in_a_short_run(comm, shared, monkeypatch):
    written = count_writes(monkeypatch)
    scene = pinched_blocks(2, **RELAXATION)
    run(comm, scene, shared)
    assert written == []
    scene["checkpoint"] = {"seconds": 0, "iterations": 4}
    result = run(comm, scene, shared)
    assert written == (list(range(4, len(result["history"]) + 1, 4)) if comm.rank == 0 else [])


@pytest.mark.slow
@two_ranks
def test_every_so_many_seconds_by_the_clock_of_rank_0(comm, shared, monkeypatch):
    """The other rank's clock stands still; it is told when a checkpoint is due."""
    scene = pinched_blocks(2, **RELAXATION)
    quiet = run(comm, scene, shared)
    written, ticks = count_writes(monkeypatch), iter(range(10**9))
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: next(ticks) if comm.rank == 0 else 0)
    scene["checkpoint"] = {"seconds": 5}  # a tick an iteration
    result = run(comm, scene, shared)
    assert result == quiet
    if comm.rank == 0:
        assert set(np.diff(written)) == {5}
        assert len(written) >= 2
    else:
        assert written == []


@pytest.mark.parametrize(
    ("when", "written"),
    [
        ({"seconds": 5.0}, [3, 6]),
        ({"seconds": 0.0}, []),
        ({"seconds": 0.0, "iterations": 4}, [4]),
    ],
)
def test_iterations_of_two_seconds_are_kept_when_they_are_due(tmp_path, monkeypatch, when, written):
    """At the first one at which as much time has passed, or as many iterations, since the one before; never by what is
    zero."""
    scene = read_scene("x.toml", scenes.to_toml(pinched_blocks(2) | {"checkpoint": when}))
    now = [100.0]
    monkeypatch.setattr(checkpoint.time, "monotonic", lambda: now[0])
    found = count_writes(monkeypatch)
    checkpoints = Checkpoints(
        MPI.COMM_SELF, tmp_path, {}, scene.checkpoint, Clock(), MeshLadder(scene)
    )
    for iteration in range(1, 8):
        now[0] += 2.0
        checkpoints.note(iteration)
    assert found == written
    if written:
        (state,) = checkpoint.read(tmp_path / checkpoint.CHECKPOINT)[1]
        assert state["iterations"] == written[-1]


@pytest.mark.slow
@two_ranks
def test_a_run_goes_on_without_a_checkpoint_that_cannot_be_written(
    comm, shared, monkeypatch, caplog
):
    monkeypatch.setattr(logging.getLogger("ddmpi"), "propagate", True)
    scene = pinched_blocks(2, **RELAXATION)
    reference = run(comm, scene, shared)
    caplog.clear()
    scene["checkpoint"] = {"iterations": 1}
    monkeypatch.setattr(os, "fsync", full)
    assert run(comm, scene, shared) == reference
    assert listing(comm, shared) == []
    if comm.rank == 0:
        assert all("No space left on device" in message for message in caplog.messages)
        assert len(caplog.messages) == len(reference["history"])


@pytest.mark.slow
@two_ranks
@pytest.mark.parametrize("former", [True, False])
def test_an_interruption_whose_checkpoint_cannot_be_written_says_so(
    comm, shared, monkeypatch, former
):
    note_signal_at(monkeypatch, 60)
    if comm.rank == 0:
        if former:
            (shared / checkpoint.CHECKPOINT).write_text("a periodic one")
        monkeypatch.setattr(os, "fsync", full)
    words = r"^interrupted by SIGTERM; .*checkpoint.h5: cannot be written: No space left on device"
    words += f"; --restart {shared} goes on from the checkpoint before$" if former else "$"
    with pytest.raises(OutputError, match=words) as e:
        run(comm, pinched_blocks(2, **RELAXATION), shared)
    assert e.value.agreed
    assert listing(comm, shared) == [checkpoint.CHECKPOINT] * former


@pytest.mark.slow
@two_ranks
@pytest.mark.parametrize(
    ("kind", "more", "scene"),
    [
        (OutputError, "", pinched_blocks(2, **RELAXATION)),
        (TakenError, " --output OTHER", scenes.tower(3, 2, True)),
    ],
)
def test_results_that_cannot_be_written_leave_a_checkpoint(
    comm, shared, monkeypatch, kind, more, scene
):
    """From which they follow without another iteration, bit for bit."""
    reference = run(comm, scene, shared)
    assembly, checkpoints = start(comm, scene, shared)
    words = rf"^the disk is full; the state after iteration \d+ is kept, --restart {shared}{more} goes on from there$"
    with pytest.raises(OutputError, match=words), checkpoints.kept():
        solve(assembly, assembly.scene.method, checkpoints=checkpoints)
        error = kind("the disk is full")
        error.agreed = True
        raise error
    monkeypatch.setattr(Newton, "_newton_step", None)
    assert run(comm, scene, shared, restart=True) == reference


@pytest.mark.slow
@two_ranks
def test_motions_that_loads_drive_stay_released(comm, shared, monkeypatch):
    """Going on from the end takes no iteration, also where the run held motions at first."""
    judge, left = ddmpi.run.solve.judge_held, Iteration._left_along_held

    def as_if_driven(self, stopped):
        """Until it is released, the turn counts as one that coarse elements let hold and loads drive."""
        monkeypatch.setattr(
            ddmpi.run.solve, "judge_held", judge if self.released else lambda *_: ([], None, True)
        )
        return left(self, stopped)

    monkeypatch.setattr(Iteration, "_left_along_held", as_if_driven)
    rings = [("shaft", [0.0, -0.05], [4.0, 10.0], 40), ("bush", [0.0, 0.0], [10.05, 20.0], 46)]
    shaft, bush = (
        {
            "name": name,
            "mesh": {
                "shape": "annulus",
                "center": centre,
                "radii": radii,
                "angles": [0.0, 360.0],
                "divisions": [around, 3],
            },
            "material": {"young": 2.1e5, "poisson": 0.3},
        }
        for name, centre, radii, around in rings
    )
    scene = {
        "body": [shaft | {"volume_force": [1.0, -3.0]}, bush | {"clamp": ["outer"]}],
        "contact": [{"bodies": ["shaft", "bush"], "on": ["outer", "inner"]}],
        "method": {},
    }
    reference = run(comm, scene, shared)
    assembly, checkpoints = start(comm, scene, shared)
    with pytest.raises(OutputError), checkpoints.kept():
        solve(assembly, assembly.scene.method, checkpoints=checkpoints)
        error = OutputError("the disk is full")
        error.agreed = True
        raise error
    assert checkpoints._now["iteration"]["released"]
    monkeypatch.setattr(Newton, "_newton_step", None)
    assert run(comm, scene, shared, restart=True)["arrays"] == reference["arrays"]


@pytest.mark.slow
@two_ranks
def test_another_mesh_is_refused_on_both_ranks(comm, shared, monkeypatch):
    """The scene names a mesh file; what is in the file may have changed."""
    scene = pinched_blocks(2, **RELAXATION)
    note_signal_at(monkeypatch, 60)
    with pytest.raises(InterruptionError):
        run(comm, scene, shared)
    interrupt._received.clear()
    assembly, checkpoints = start(comm, scene, shared, restart=True)
    if comm.rank == 1:
        assembly.bodies[0].mesh.points[0] += 1e-12
    with pytest.raises(InputError, match="another mesh of body 'lower'"):
        solve(assembly, assembly.scene.method, checkpoints=checkpoints)


# What is refused


def a_checkpoint(folder: Path, options: dict | None = None) -> Path:
    """A file with a made-up state of one rank."""
    identity = identify(
        read_scene("x.toml", scenes.to_toml(pinched_blocks(2))), options or {}, VERSIONS
    )
    state = {"outer": {"lam": np.arange(6.0), "history": []}, "goal": {"tolerance": 1e-8}}
    checkpoint.write(folder / checkpoint.CHECKPOINT, identity, [state])
    return folder / checkpoint.CHECKPOINT


def accept(
    folder: Path, scene: dict | None = None, options: dict | None = None, versions: dict = VERSIONS
) -> dict:
    identity = identify(
        read_scene("x.toml", scenes.to_toml(scene or pinched_blocks(2))), options or {}, versions
    )
    return continue_from(MPI.COMM_SELF, str(folder), identity)


def test_a_file_gives_back_what_was_written(tmp_path):
    """Also once more, as of a run that is interrupted twice; whole numbers stay whole, as in history.csv."""
    from ddmpi.methods.outer import Step

    steps = [
        Step(1, 1.0, np.inf, 1e-300, 7),
        Step(2, 0.1, 0.3, 2.0 / 3.0, np.int64(2**40), "softened"),
    ]
    state = {
        "outer": {"history": tuple(steps)},
        "a": np.array([np.nan, -0.0, 5e-324]),
        "b": np.float64(np.inf),
        "c": True,
        "d": {"z": 3, "a": 1},
        "e": [np.arange(3), np.arange(3)],
        "f": [],
        "g": "text",
        "rows": ((1, 2, 0.5), (2, 3, 0.25)),
        "times": [0.5, 1.0],
    }
    first, second = state, {"a": np.empty(0)}
    for _ in range(2):
        checkpoint.write(tmp_path / "c.h5", {"scene": {"a": 1}}, [first, second])
        identity, (first, second) = checkpoint.read(tmp_path / "c.h5")
    assert identity == {"scene": {"a": 1}}
    assert [Step(*row) for row in first["outer"]["history"]] == steps
    assert first["a"].tobytes() == state["a"].tobytes()
    assert first["b"] == np.inf and first["c"] is True and first["g"] == "text"
    assert list(first["d"].items()) == [("z", 3), ("a", 1)]
    assert np.array_equal(first["e"], [[0, 1, 2]] * 2) and len(first["f"]) == 0
    assert str(first["rows"]) == "[[1, 2, 0.5], [2, 3, 0.25]]" and list(first["times"]) == [
        0.5,
        1.0,
    ]
    assert second["a"].shape == (0,)
    assert [path.name for path in tmp_path.iterdir()] == ["c.h5"]
    with h5py.File(tmp_path / "c.h5") as file:  # a plain HDF5 file for other programs
        assert file["rank 0/a"].shape == (3,)


def test_what_is_not_there_or_no_checkpoint_is_refused(tmp_path):
    with pytest.raises(InputError, match=r"there is no checkpoint\.h5"):
        accept(tmp_path)
    with pytest.raises(InputError, match=r"there is no checkpoint\.h5"):
        accept(tmp_path / "nowhere")
    for content in (b"", b"something else", b"\x89HDF\r\n\x1a\n" + bytes(1000)):
        (tmp_path / checkpoint.CHECKPOINT).write_bytes(content)
        with pytest.raises(InputError, match="not a checkpoint"):
            accept(tmp_path)


def test_every_damaged_byte_is_noticed(tmp_path):
    path = a_checkpoint(tmp_path)
    whole = path.read_bytes()
    identity = checkpoint.read(path)[0]
    assert accept(tmp_path)["outer"]["lam"].tolist() == list(range(6))
    rng = np.random.default_rng(0)
    for place in [*range(0, 560, 9), *rng.integers(560, len(whole), 60)]:
        damaged = bytearray(whole)
        damaged[place] ^= 1 << rng.integers(8)
        path.write_bytes(damaged)
        with pytest.raises(InputError, match=r"damaged|not a checkpoint"):
            continue_from(MPI.COMM_SELF, str(tmp_path), identity)
    for length in [0, 1, 511, 512, 513, len(whole) // 2, len(whole) - 1]:
        path.write_bytes(whole[:length])
        with pytest.raises(InputError, match=r"damaged|not a checkpoint"):
            continue_from(MPI.COMM_SELF, str(tmp_path), identity)
    path.write_bytes(whole + b"\0")
    with pytest.raises(InputError, match="damaged"):
        accept(tmp_path)


@pytest.mark.parametrize(
    ("scene", "options", "words"),
    [
        (
            pinched_blocks(2, "tresca"),
            {},
            "contact.upper-lower.friction.law is 'tresca' here, 'coulomb' there",
        ),
        (None, {"newton_ksp_rtol": "1e-6"}, "newton_ksp_rtol is '1e-6' here, not set there"),
    ],
)
def test_another_run_is_refused_with_the_reason(tmp_path, scene, options, words):
    path = a_checkpoint(tmp_path)
    with pytest.raises(InputError) as error:
        accept(tmp_path, scene, options)
    said = str(error.value)
    assert said.startswith(f"{path}: is of a run with other ") and words in said
    assert said.endswith("; only the same run can be continued")


def test_other_versions_are_a_warning(tmp_path, caplog, monkeypatch):
    """Ten hours of work are not lost to an update: the answer is as good, and the run says what differs."""
    monkeypatch.setattr(logging.getLogger("ddmpi"), "propagate", True)
    a_checkpoint(tmp_path)
    assert accept(tmp_path, versions=VERSIONS | {"petsc": "3.22.0"})["goal"] == {"tolerance": 1e-8}
    assert "petsc is '3.22.0' here, '1' there" in caplog.text


def test_what_changes_no_iterate_may_differ(tmp_path):
    a_checkpoint(tmp_path, options={"log_view": None, "newton_ksp_monitor": None})
    scene = pinched_blocks(2, max_iterations=7) | {
        "title": "another",
        "output": {"figures": False},
        "checkpoint": {"seconds": 1},
    }
    assert accept(tmp_path, scene, {"body_ksp_view": None, "newton_ksp_converged_reason": None})


def test_a_checkpoint_of_more_ranks_is_refused(tmp_path):
    identity = identify(read_scene("x.toml", scenes.to_toml(pinched_blocks(2))), {}, VERSIONS)
    checkpoint.write(tmp_path / checkpoint.CHECKPOINT, identity, [{}, {}, {}])
    words = r"written on 3 ranks that hold bodies, this run has 1; continue it with mpirun -n 3$"
    with pytest.raises(InputError, match=words):
        accept(tmp_path)


# Signals


def test_signals_are_noted_and_not_deadly():
    before = {number: signal.getsignal(number) for number in interrupt.SIGNALS}
    try:
        interrupt.check()
        interrupt.listen()
        os.kill(os.getpid(), signal.SIGUSR1)
        os.kill(os.getpid(), signal.SIGTERM)
        with pytest.raises(InterruptionError) as error:
            interrupt.check()
        assert error.value.kind == "interrupted by SIGUSR1"
    finally:
        interrupt._handlers.clear()
        for number, handler in before.items():
            signal.signal(number, handler)
