"""The factor of a load at which equilibrium ends, in scenes where statics tells it."""

import errno
import json

import pytest
from mpi4py import MPI
from scenes import FLOOR, by_name, call, rectangle, write_scene
from solid_scenes import box

from ddmpi.errors import InputError, OutputError
from ddmpi.sweep import limit
from ddmpi.sweep.limit import find_limit


def on_floor(push: list[float], friction: float, weight: float = 1e5, **more) -> dict:
    """A block of 2 m by 1 m on a plane, pushed on its left side."""
    block = rectangle("block", (0.0, 0.0), (2.0, 1.0), (8, 4))
    block |= {
        "volume_force": {"value": [0.0, -weight]},
        "traction": [{"on": "left", "value": push}],
    }
    block.pop("clamp", None)
    contact = {"bodies": ["block", "floor"], "on": ["bottom"]}
    contact["friction"] = {"law": "coulomb", "coefficient": friction}
    return {"body": [block], "rigid": [FLOOR], "contact": [contact]} | more


def in_steps() -> dict:
    scene = on_floor([1e4, 0.0], 0.3)
    block = scene["body"][0]
    block["traction"][0]["history"], block["volume_force"]["history"] = "push", "weight"
    history = {
        "push": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 0.0, 1.0]},
        "weight": {"times": [0.0, 1.0], "factors": [0.0, 1.0]},
    }
    return scene | {"history": history, "time": {"points": [1.0, 2.0]}}


def in_small_steps() -> dict:
    """In four steps a leg it slides in an early one, the earlier the larger the load is."""
    scene = in_steps()
    scene["body"][0]["traction"][0]["value"] = [2e6, 0.0]
    scene["time"]["steps"] = 4
    return scene


def in_space() -> dict:
    """A box of 4 m³ that is pushed aslant by 5 kN."""
    part = box("box", (0, 0, 0), (2, 2, 1), (4, 4, 2), young=2.1e11, poisson=0.3)
    part.pop("clamp", None)
    part |= {
        "volume_force": [0.0, 0.0, -1e5],
        "traction": [{"on": "top", "force": [3e3, 4e3, 0.0]}],
    }
    floor = {"name": "floor", "shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}
    contact = {"bodies": ["box", "floor"], "on": ["bottom"]}
    contact["friction"] = {"law": "coulomb", "coefficient": 0.3}
    return {"body": [part], "rigid": [floor], "contact": [contact]}


def in_bricks() -> dict:
    """The block of quadratic bricks on a soft joint, pulled back."""
    scene = on_floor([-1e4, 0.0], 0.3)
    scene["body"][0]["mesh"] |= {"order": 2, "elements": "bricks", "divisions": [4, 2]}
    scene["contact"][0]["softness"] = 2e-9
    return scene


def by_tresca() -> dict:
    """A bound that grows from zero to 6e4 Pa over 2 m."""
    scene = on_floor([1e4, 0.0], 0.3)
    scene["contact"][0]["friction"] = {"law": "tresca", "slip_bound": "3e4 * x"}
    return scene


TRACTION = "body.block.traction.0"

KNOWN = {
    # μ W = 0.3 · 2e5 over 1e4
    "slides": (on_floor([1e4, 0.0], 0.3), TRACTION, 6.0, "along x"),
    # it tips over its front edge when Q / 2 = W · 1
    "tips": (on_floor([1e4, 0.0], 3.0), f"{TRACTION}.value", 40.0, "would move most"),
    # the load lifts with half of what it pushes: Q = μ (W − Q/2)
    "is lifted": (on_floor([1e4, 5e3], 0.3), TRACTION, 6.0 / 1.15, "would move"),
    "slides in load steps": (in_steps(), "push", 6.0, "in the step to time 2"),
    # 0.3 · 4e5 over 5e3
    "slides aslant": (in_space(), "body.box.traction.0.force", 24.0, "along (0.6, 0.8, 0)"),
    "slides in bricks": (in_bricks(), TRACTION, 6.0, "along -x"),
    # ∫ 3e4 x dx = 6e4
    "slides by Tresca": (by_tresca(), TRACTION, 6.0, "along x"),
    # more than it bears at first
    "slides already": (on_floor([3e5, 0.0], 0.3), TRACTION, 0.2, "along x"),
    "slides in small steps": (in_small_steps(), "push", 0.03, "in the step to time 2"),
    "slides, load by 1e8": (on_floor([1e12, 0.0], 0.3), TRACTION, 6e-8, "along x"),
    "slides, load by 1e-8": (on_floor([1e-4, 0.0], 0.3), TRACTION, 6e8, "along x"),
    "tips, load by 1e-6": (on_floor([1e-2, 0.0], 3.0), TRACTION, 4e7, "would move most"),
    "tips, load by 1e6": (on_floor([1e10, 0.0], 3.0), TRACTION, 4e-5, "would move most"),
}


@pytest.mark.parametrize(
    "case",
    by_name(KNOWN, "slides aslant"),
)
def test_a_limit_is_that_of_statics(tmp_path, case):
    """Within 1e-3, between an answer and none, in 12 solves, with the mechanism; beside it is the run just past it."""
    scene, load, exact, words = case
    folder = tmp_path / "out"
    path = str(write_scene(scene, tmp_path / "scene.toml"))
    find_limit(MPI.COMM_SELF, path, [], load, str(folder))
    found = json.loads((folder / "limit.json").read_text(encoding="utf-8"))
    assert found["factor"] == pytest.approx(exact, rel=1e-3)
    below, above = found["interval"]
    assert below <= exact * (1 + 1e-6) and above >= exact * (1 - 1e-6)
    assert above - below <= 1e-3 * above
    assert found["solves"] <= 12
    assert words in found["mechanism"]
    mechanism = json.loads((folder / "mechanism.json").read_text(encoding="utf-8"))
    assert mechanism["reason"] in found["mechanism"]


def test_the_command_draws_the_mechanism_and_counts_settings(tmp_path):
    """With half of the friction the limit is half as large; a part that clamps hold has none, which is no failure."""
    scene = on_floor([1e4, 0.0], 0.3)
    path = write_scene(scene, tmp_path / "scene.toml")
    arguments = ["--load", TRACTION, "--set", "contact.block-floor.friction.coefficient=0.15"]
    folder = tmp_path / "out"
    run = call("limit", str(path), "--output", str(folder), *arguments, folder=folder)
    assert run.code == 0 and "equilibrium ends at the factor 3 " in run.output
    assert {"limit.json", "mechanism.png"} <= run.files
    scene["body"][0]["clamp"] = ["right"]
    path = write_scene(scene, tmp_path / "held.toml")
    folder = tmp_path / "none"
    run = call("limit", str(path), "--output", str(folder), *arguments[:2], folder=folder)
    found = json.loads((run.folder / "limit.json").read_text(encoding="utf-8"))
    assert run.code == 0 and run.files == {"limit.json"}
    assert found["factor"] is None and found["interval"] == [1000.0, None]
    assert found["mechanism"] is None and found["solves"] <= 15


def test_a_limit_of_zero_is_none_by_rounding(tmp_path):
    """Without friction any load drives the block along; of 1e-9 of it nothing would be seen in the loads."""
    path = str(write_scene(on_floor([1e4, 0.0], 0.0), tmp_path / "scene.toml"))
    find_limit(MPI.COMM_SELF, path, [], TRACTION, str(tmp_path / "out"))
    found = json.loads((tmp_path / "out/limit.json").read_text(encoding="utf-8"))
    assert found["factor"] == found["interval"][0] == 0.0 < found["interval"][1] < 1e-4


@pytest.mark.slow
def test_where_nothing_ends_equilibrium_there_is_no_limit(tmp_path):
    """A loose block that is pressed on the floor bears any multiple."""
    path = str(write_scene(on_floor([0.0, -1e4], 0.3), tmp_path / "scene.toml"))
    find_limit(MPI.COMM_SELF, path, [], TRACTION, str(tmp_path / "out"))
    found = json.loads((tmp_path / "out/limit.json").read_text(encoding="utf-8"))
    assert found["factor"] is found["mechanism"] is None and found["interval"][0] >= 1e3


def test_a_full_disk_leaves_the_limit_in_the_log(tmp_path, monkeypatch, caplog):
    def full(path, text):
        raise OSError(errno.ENOSPC, "No space left on device")

    path = str(write_scene(on_floor([1e4, 0.0], 0.3), tmp_path / "scene.toml"))
    monkeypatch.setattr(limit, "write_atomically", full)
    caplog.set_level("INFO", "ddmpi")
    with pytest.raises(OutputError):
        find_limit(MPI.COMM_SELF, path, [], TRACTION, str(tmp_path / "out"))
    assert "equilibrium ends at the factor 6 " in caplog.text


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_the_limit_is_the_same_on_two_ranks(comm, tmp_path):
    folder = comm.bcast(str(tmp_path))
    path = f"{folder}/scene.toml"
    if comm.rank == 0:
        write_scene(on_floor([1e4, 0.0], 0.3), tmp_path / "scene.toml")
    comm.barrier()
    find_limit(comm, path, [], TRACTION, f"{folder}/out")
    if comm.rank == 0:
        found = json.loads((tmp_path / "out/limit.json").read_text(encoding="utf-8"))
        assert found["factor"] == pytest.approx(6.0, rel=1e-3)


@pytest.mark.parametrize(
    ("load", "words"),
    [
        ("push", "--load push: the scene has no 'push' there"),
        ("body.block.traction.2", "there is no entry '2'"),
        ("body.block.traction.0.on", "is neither a history nor a load with numbers that a factor"),
        ("contact.0.friction.coefficient", "is neither a history nor a load with numbers"),
        ("body.block.material", "is neither a history nor a load with numbers"),
        ("body.block.clamp", "is neither a history nor a load with numbers"),
        ("body.block.clamp.0", "is neither a history nor a load with numbers"),
        ("body.block.traction.1", "is zero, and so are all multiples of it"),
        ("body.block.volume_force.value.0", "is zero, and so are all multiples of it"),
        ("rest", "history.rest.factors: is zero, and so are all multiples of it"),
    ],
)
def test_what_is_no_load_is_refused(tmp_path, load, words):
    scene = on_floor([1e4, 0.0], 0.3)
    scene["body"][0]["clamp"] = ["right"]
    scene["body"][0]["traction"].append({"on": "top", "force": [0.0, 0.0]})
    scene["history"] = {"rest": {"times": [0.0, 1.0], "factors": [0.0, 0.0]}}
    path = str(write_scene(scene, tmp_path / "scene.toml"))
    with pytest.raises(InputError) as refused:
        find_limit(MPI.COMM_SELF, path, [], load, str(tmp_path / "out"))
    assert words in str(refused.value)
    assert not (tmp_path / "out").exists()
