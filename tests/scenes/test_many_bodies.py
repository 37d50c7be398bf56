"""Any number of bodies on any number of ranks: one answer, however bodies are placed, ordered, turned and measured."""

import copy
import csv
import json
from collections.abc import Callable
from pathlib import Path

import fault
import numpy as np
import pytest
import scenes
from fault_cases import run_in_one_go
from scenes import pinched_blocks, tower
from scipy.spatial import cKDTree

from ddmpi.run.answer import solve  # starts PETSc, on all ranks together

pytestmark = pytest.mark.slow

SAME = 1e-9
"""Distance of displacements, over the largest one, that the accuracy of the iteration allows between two runs."""


def close(one: dict, other: dict) -> bool:
    """Whether displacements by body, in the same order of nodes, differ by no more than SAME."""
    largest = max(np.abs(u).max() for u in other.values())
    return one.keys() == other.keys() and all(np.abs(one[name] - u).max() <= SAME * largest
                                              for name, u in other.items())


def solved(comm, scene: dict, ranks: int | None = None) -> dict:
    """Points and displacements by body, statuses by contact; solved on the first ranks, known on all. Collective."""
    ranks = ranks or comm.size
    part, found = comm.Split(int(comm.rank >= ranks)), None
    if comm.rank < ranks:
        answer = solve(scenes.to_toml(scene), part)
        assert answer.certified, answer.reason
        assert answer.bodies
        bodies = {name: each for own in part.allgather(dict(answer.bodies)) for name, each in own.items()}
        found = {"u": {name: each.displacement for name, each in bodies.items()},
                 "points": {name: each.points for name, each in bodies.items()}, "summary": answer.summary,
                 "status": {name: state.status.tolist() for name, state in answer.contacts.items()},
                 "force": {name: state.normal_force for name, state in answer.contacts.items()}}
    part.Free()
    return comm.bcast(found)


# Ranks

@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("law", ["coulomb", "tresca", "none"])
def test_two_bodies_have_one_answer_on_one_and_two_ranks(comm, law):
    """More ranks than bodies are tested in test_team.py."""
    first, found = (solved(comm, pinched_blocks(6, law), ranks) for ranks in (1, 2))
    assert close(found["u"], first["u"])
    assert found["status"] == first["status"]
    assert found["summary"]["ranks"] == 2
    assert found["summary"]["outer_iterations"] == first["summary"]["outer_iterations"]


@pytest.mark.mpi(ranks=4)
@pytest.mark.parametrize("loose", [True, False])
def test_a_tower_has_one_answer_on_any_number_of_ranks(comm, loose):
    """Four blocks, those above the lowest held by friction alone or by clamps, on one to four ranks."""
    first = solved(comm, tower(4, 3, loose), 1)
    assert {status for each in first["status"].values() for status in each} >= {"stick"}
    for ranks in (2, 3, 4):
        found = solved(comm, tower(4, 3, loose), ranks)
        assert close(found["u"], first["u"]), ranks
        assert found["status"] == first["status"], ranks
        assert found["summary"]["ranks"] == ranks
        placed = [body["ranks"] for body in found["summary"]["bodies"].values()]
        assert placed == [[k * ranks // 4] for k in range(4)], ranks


@pytest.mark.mpi(ranks=[1, 3])
@pytest.mark.parametrize("kind", ["direct", "iterative"])
def test_a_tower_has_one_answer_with_any_compliance(comm, kind):
    exact = solved(comm, tower(3, 3))
    found = solved(comm, tower(3, 3, compliance=kind))
    largest = max(np.abs(u).max() for u in exact["u"].values())
    assert max(np.abs(found["u"][name] - u).max() for name, u in exact["u"].items()) <= 1e-7 * largest
    assert found["status"] == exact["status"]


# What must not matter

def permuted(scene: dict) -> dict:
    """Bodies and contacts in another order."""
    changed = copy.deepcopy(scene)
    for key in ("body", "contact"):
        first, *others = changed[key]
        changed[key] = [others[1], first, *others[2:], others[0]]
    return changed


def other_sides(scene: dict) -> dict:
    """The other body of each second contact is its first one."""
    changed = copy.deepcopy(scene)
    for contact in changed["contact"]:
        contact.setdefault("name", "-".join(contact["bodies"]))
    for contact in changed["contact"][::2]:
        contact["bodies"].reverse()
        contact["on"].reverse()
    return changed


def mapped(scene: dict, Q: np.ndarray, length: float = 1.0, stress: float = 1.0) -> dict:
    """Turned by Q, and measured in other units; mirrored if det Q < 0, with the same triangles."""
    changed = copy.deepcopy(scene)
    turned = {"bottom": "left", "left": "bottom", "top": "right", "right": "top"} if np.linalg.det(Q) < 0 else {}
    for body in changed["body"]:
        corners = [(length * Q @ corner).tolist() for corner in body["mesh"]["corners"]]
        if turned:  # counter-clockwise again, from the same corner
            corners = [corners[k] for k in (0, 3, 2, 1)]
            body["mesh"]["divisions"].reverse()
        body["mesh"]["corners"] = corners
        body["material"]["young"] *= stress
        body["clamp"] = [turned.get(on, on) for on in body["clamp"]]
        body["traction"] = [{"on": turned.get(each["on"], each["on"]), "value": (stress * Q @ each["value"]).tolist()}
                            for each in body["traction"]]
    for contact in changed["contact"]:
        contact["on"] = [turned.get(on, on) for on in contact["on"]]
    return changed


def turn(angle: float) -> np.ndarray:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


CHANGES: dict[str, tuple[Callable[[dict], dict], np.ndarray, float]] = {
    # what: the change, how it turns vectors, in which unit of length it measures
    "permuted": (permuted, np.eye(2), 1.0), "other sides": (other_sides, np.eye(2), 1.0),
    "kilometres": (lambda scene: mapped(scene, np.eye(2), 1e-3), np.eye(2), 1e-3),
    "micrometres and gigapascals": (lambda scene: mapped(scene, np.eye(2), 1e6, 1e-9), np.eye(2), 1e6),
    "turned": (lambda scene: mapped(scene, turn(0.7)), turn(0.7), 1.0),
    "turned by a right angle": (lambda scene: mapped(scene, turn(np.pi / 2)), turn(np.pi / 2), 1.0),
    "mirrored": (lambda scene: mapped(scene, np.diag([-1.0, 1.0])), np.diag([-1.0, 1.0]), 1.0),
}


@pytest.mark.parametrize("loose", [True, False])
def test_order_units_and_position_do_not_matter(comm, loose):
    scene = tower(4, 2, loose)
    usual = solved(comm, scene)
    for name, (change, Q, length) in CHANGES.items():
        found = solved(comm, change(scene))
        back = {}
        for body, points in usual["points"].items():
            apart, order = cKDTree(found["points"][body]).query(length * points @ Q.T)
            assert apart.max() <= 1e-9 * length
            back[body] = found["u"][body][order] @ Q / length
        assert close(back, usual["u"]), name
        statuses = [{status: each.count(status) for status in each} for each in usual["status"].values()]
        for each in found["status"].values():
            statuses.remove({status: each.count(status) for status in each})
        assert not statuses, name


# Bytes, and bits

@pytest.mark.mpi(ranks=8)
def test_what_an_inner_rank_sends_does_not_grow_with_the_number_of_bodies(comm):
    """A multiplication by the joint compliance is a message to each neighbour, in a row of four blocks or eight."""
    sent = {}
    for blocks in (4, 8):
        part = comm.Split(int(comm.rank >= blocks))
        if comm.rank < blocks:
            assembly = scenes.prepare_scene(part, tower(blocks, 2))
            exchange, x = assembly.exchange, np.ones(assembly.space.size)
            before = exchange.sent["messages"], exchange.sent["bytes"]
            for _ in range(5):
                assembly.joint.product(x, "newton")
            sent[blocks] = exchange.sent["messages"] - before[0], exchange.sent["bytes"] - before[1]
        part.Free()
        if comm.rank == 1:
            assert sent[blocks] == (5 * 2, 5 * 2 * 8 * 2 * 7)  # up and down, m = 7 nodes with two unknowns each


@pytest.mark.parametrize("ranks", [2, 3])
def test_the_same_run_gives_the_same_bits(tmp_path, ranks):
    """Where every body lives on one rank, sums are taken in one order."""
    scene = scenes.write_scene(tower(3, 3), tmp_path / "scene.toml")
    first, second = (scenes.run_command(scene, tmp_path / name, "--no-figures", ranks=ranks)
                     for name in ("first", "second"))
    assert first.code == second.code == 0, first.output + second.output
    files = first.files - {"summary.json", "result.h5", "result.xdmf"}
    assert files == {"history.csv", "steps.csv"} | {
        f"contact_{name}.{ending}" for name in ("block2-block1", "block3-block2") for ending in ("csv", "vtu")}
    for name in files:
        assert (first.folder / name).read_bytes() == (second.folder / name).read_bytes(), name
    assert bits(first.folder) == bits(second.folder)


def bits(folder: Path) -> dict[str, bytes]:
    import h5py

    with h5py.File(folder / "result.h5") as file:
        return {name: np.array(data).tobytes() for name, data in file.items()}


# Faults on a rank that is not next to rank 0

KINDS = {"SolverError": 4, "OutputError": 5, "InputError": 2, "SIGTERM": 6}
PLACES = {"mesh": ("ddmpi.coupling.assembly.build_mesh", 1), "assemble": ("ddmpi.coupling.assembly.assemble", 1),
          "factor": ("ddmpi.body.solver.StiffnessSolver.__init__", 1),
          "outer": ("ddmpi.body.compliance.Compliance.mult", 12),
          "conclude": ("ddmpi.coupling.member.Member.displacement", 1)}
ITERATES = ("outer", "conclude")


@pytest.fixture(scope="module")
def undisturbed(tmp_path_factory):
    """The run of a tower of three on three ranks, without a fault."""
    folder = tmp_path_factory.mktemp("undisturbed")
    scene = scenes.write_scene(tower(3, 2) | {"output": {"figures": False}}, folder / "scene.toml")
    return scenes.run_command(scene, folder / "usual", ranks=3)


@pytest.mark.parametrize("rank", [1, 2])
def test_a_fault_on_any_of_three_ranks_ends_them_all_with_one_message(tmp_path, undisturbed, rank):
    """And a signal after the last iteration leaves a checkpoint, from which the run goes on to the same results."""
    scene = scenes.write_scene(tower(3, 2) | {"output": {"figures": False}}, tmp_path / "scene.toml")
    cases = [(place, kind) for place in PLACES for kind in KINDS if kind != "OutputError" or place in ITERATES]
    runs = run_in_one_go([(rank, *PLACES[place], kind, str(tmp_path / f"{place} {kind}"), []) for place, kind in cases],
                         "run", str(scene), ranks=3)
    for (place, kind), run in zip(cases, runs, strict=True):
        assert run.code == KINDS[kind], (place, kind, run.output)
        assert len(run.messages) == 1, (place, kind, run.output)
        kept = place == "conclude" and kind in ("OutputError", "SIGTERM")
        assert run.files == ({"checkpoint.h5"} if kept else set()), (place, kind)
    (interrupted,) = (run for case, run in zip(cases, runs, strict=True) if case == ("conclude", "SIGTERM"))
    refused = scenes.run_command(scene, interrupted.folder, "--restart", str(interrupted.folder), ranks=rank)
    assert refused.code == 2 and "mpirun -n 3" in refused.messages[0]
    again = scenes.run_command(scene, interrupted.folder, "--restart", str(interrupted.folder), ranks=3)
    assert again.code == undisturbed.code == 0, again.output
    assert bits(again.folder) == bits(undisturbed.folder)
    for name in ("history.csv", "contact_block2-block1.csv", "contact_block3-block2.csv"):
        assert (again.folder / name).read_bytes() == (undisturbed.folder / name).read_bytes()


def test_an_internal_error_on_the_last_of_three_ranks_is_reported_once(tmp_path):
    scene = scenes.write_scene(tower(3, 2), tmp_path / "scene.toml")
    faults = [[2, *PLACES["outer"], "RuntimeError", str(tmp_path / "out"), []]]
    run = scenes.run_python([fault.__file__, json.dumps(faults), "run", str(scene)], 3, tmp_path / "out")
    assert run.code == 1
    assert run.messages == ["ddmpi: internal error on rank 2:"]
    assert run.files <= {".unfinished"}  # rank 0 has no time to clear up


# Sweeps

def test_a_sweep_over_three_bodies(tmp_path):
    """A key of one contact is varied; each case is as if it had run alone."""
    scene = scenes.write_scene(tower(3, 2) | {"output": {"figures": False}}, tmp_path / "scene.toml")
    key = "contact.block3-block2.friction.coefficient"
    run = scenes.run_python(["-m", "ddmpi", "sweep", str(scene), "--vary", f"{key}=0.2,0.4", "--output",
                             str(tmp_path / "sweep")], 2, tmp_path / "sweep")
    assert run.code == 0, run.output
    with open(run.folder / "sweep.csv", newline="", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert [row["exit"] for row in rows] == ["0", "0"]
    for value, row in zip((0.2, 0.4), rows, strict=True):
        assert float(row[key]) == value
        alone = scenes.run_command(scene, tmp_path / f"alone {value}", "--set", f"{key}={value}", ranks=2)
        assert bits(run.folder / row["folder"]) == bits(alone.folder)
        assert alone.summary["scene"]["contact"][1]["friction"]["coefficient"] == value
