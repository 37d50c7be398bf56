"""One scene has one answer on any number of ranks: random scenes, and what the features of tests/products are not."""

import numpy as np
import pytest
import test_cycles
import test_lean_steps
import test_load_steps
import test_pushed_partners
from elsewhere import HERE, Found, assert_same, found
from scenes import COULOMB, rectangle
from test_elsewhere import RANDOM, SCENES

pytestmark = pytest.mark.slow

PLACED = (
    "coulomb",
    "tower",
    "mortar",
    "loose solids",
    "plane 88",
)
EXACT = {"method": {"tolerance": 1e-11}}
"""One rank solves by dense factors, several by GMRES."""


def under_a_ram() -> dict:
    """Two blocks under one ram, in load steps."""
    return EXACT | {
        "body": [
            test_pushed_partners.block(name, 2, (3.0 * k, 0.0), clamp=["bottom"])
            for k, name in enumerate(("one", "two"))
        ],
        "rigid": [
            {
                "name": "ram",
                "shape": "plane",
                "point": [0.0, 1.2],
                "normal": [0.0, -1.0],
                "force": [1e5, -1e6],
                "history": "push",
            }
        ],
        "contact": [
            {"bodies": [name, "ram"], "on": ["top"], "friction": COULOMB | {"coefficient": 0.5}}
            for name in ("one", "two")
        ],
        "history": {"push": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]}},
        "time": {"points": [1.0, 2.0], "steps": 2},
    }


def under_a_head() -> dict:
    """Three blocks under one head that turns."""
    bodies = [
        rectangle(name, (3.0 * k, 0.0), (1.0, 1.0), (3, 3), clamp=["bottom"])
        for k, name in enumerate(("one", "two", "three"))
    ]
    return {
        "body": bodies,
        "rigid": [
            {
                "name": "head",
                "shape": "plane",
                "point": [0.0, 1.0],
                "normal": [0.0, -1.0],
                "force": [0.0, -1e6],
                "pivot": [2.0, 3.0],
                "moment": -2e5,
            }
        ],
        "contact": [{"bodies": [body["name"], "head"], "on": ["top"]} for body in bodies],
    }


MADE = {
    "a ram": (4, under_a_ram),
    "a head": (3, under_a_head),
    "steps by accuracy": (2, lambda: test_load_steps.circle(tolerance=0.5) | EXACT),
    "cycles": (
        2,
        lambda: (
            EXACT
            | test_cycles.rubbed(steps=2, cycle=test_cycles.CYCLE | {"repeat": 20, "until": 1e-6})
        ),
    ),
    "lean steps": (
        3,
        lambda: EXACT | test_lean_steps.stepped(test_lean_steps.loose(), "legs", steps=3),
    ),
}
"""How many ranks, and the scene."""


def alone(comm, scene: dict) -> Found:
    """The answer on one rank, on all of them."""
    return comm.bcast(found(scene) if comm.rank == 0 else None)


def on_some(comm, ranks: int, scene: dict) -> Found | None:
    """The answer on so many of the ranks, on these."""
    part = comm.Split(int(comm.rank >= ranks))
    answer = found(scene, part) if comm.rank < ranks else None
    part.Free()
    return answer


@pytest.mark.mpi(ranks=4)
@pytest.mark.parametrize("name", PLACED)
def test_ranks_do_not_matter(comm, name):
    """The answer on four ranks and on two is that of one; bodies are placed in the order of the scene."""
    scene = (SCENES | RANDOM)[name]()
    one, count = alone(comm, scene), len(scene["body"])
    for ranks in (2, 4):
        if other := on_some(comm, ranks, scene):
            assert_same(one, other, HERE, 1e-9 if name in SCENES else 1e-6, name in SCENES)
            if count >= ranks:
                placed = [other.summary["bodies"][body["name"]]["ranks"] for body in scene["body"]]
                assert placed == [[k * ranks // count] for k in range(count)]


@pytest.mark.mpi(ranks=4)
@pytest.mark.parametrize("name", MADE)
def test_ranks_agree(comm, name):
    """At all load steps, of contacts, pretensions and partners that forces move, too."""
    ranks, make = MADE[name]
    one = alone(comm, make())
    if not (other := on_some(comm, ranks, make())):
        return
    assert_same(one, other)
    energy, found_there = (each.summary.get("energy", {}) for each in (one, other))
    assert found_there == pytest.approx(
        energy, rel=1e-8, abs=1e-9 * energy.get("strain_energy", 1.0)
    )
    for mine, theirs in zip(one.summary["steps"], other.summary["steps"], strict=True):
        assert theirs["time"] == pytest.approx(mine["time"], rel=1e-6)
        for each, same in zip(mine["contacts"].values(), theirs["contacts"].values(), strict=True):
            for key in {"normal_force", "pretension"} & each.keys():
                assert same[key] == pytest.approx(each[key], rel=1e-9), key
        for each, same in zip(
            mine.get("rigid", {}).values(), theirs.get("rigid", {}).values(), strict=True
        ):
            for key, value in each.items():
                assert same[key] == pytest.approx(
                    value, rel=1e-9, abs=1e-9 * np.abs(value).max()
                ), key
