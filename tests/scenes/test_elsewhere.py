"""One scene has one answer: in any units, turned, mirrored, its tables in any order; on any ranks in test_ranks."""

import functools

import assembly_scenes
import numpy as np
import pytest
import solid_assemblies
from elsewhere import Elsewhere, Found, assert_same, corners, found
from scenes import COULOMB, FLOOR, pinched_blocks, rectangle, tower
from solid_scenes import PUBLIC, two_boxes

TIGHT = {"method": {"tolerance": 1e-12}}
TURN, ROUND = (
    q * np.sign(np.linalg.det(q)) ** (len(q) == 3)
    for q in (
        np.array([[0.8, -0.6], [0.6, 0.8]]),
        np.linalg.qr(np.random.default_rng(3).standard_normal((3, 3)))[0],
    )
)
TRESCA = {"law": "tresca", "slip_bound": 1.2e7}


def discs(seed: int) -> dict:
    """A stack of discs and rings around an axis, of any stiffness, mesh and law, held or loose on a floor."""
    rng = np.random.default_rng(seed)
    order, number, scene = (
        int(rng.integers(1, 3)),
        int(rng.integers(2, 5)),
        {"axisymmetric": True} | TIGHT,
    )
    laws = [
        {"friction": COULOMB},
        {"friction": {"law": "none"}},
        {"friction": {"law": "tresca", "slip_bound": 1e5}},
        {"kind": "bonded"},
    ]
    inner = rng.choice([0.0, 0.4, 0.8], number).tolist()
    scene["body"] = [
        rectangle(
            f"b{k}",
            (a, float(k)),
            (2.0 - a, 1.0),
            rng.integers(2, 8, 2).tolist(),
            order,
            1e9 * 10 ** rng.uniform(-1.5, 1.5),
            rng.uniform(0.0, 0.45),
        )
        for k, a in enumerate(inner)
    ]
    scene["body"][-1]["traction"] = [{"on": "top", "pressure": 1e6}]
    scene["contact"] = [
        {"bodies": [f"b{k}", f"b{k + 1}"], "on": ["top", "bottom"], **laws[rng.integers(4)]}
        for k in range(number - 1)
    ]
    if rng.random() < 0.5:
        scene["body"][0]["clamp"] = ["bottom"]
    else:
        scene["rigid"] = [FLOOR]
        scene["contact"].append(
            {"bodies": ["b0", "floor"], "on": ["bottom"], **laws[rng.integers(3)]}
        )
    return scene


SCENES = {
    # contacts that share no nodes, so that all of their forces are unique
    **{
        law: lambda law=law: pinched_blocks(6, law) | TIGHT for law in ("coulomb", "tresca", "none")
    },
    "tower": lambda: tower(4, 3) | TIGHT,
    "held tower": lambda: tower(4, 2, loose=False) | TIGHT,
    "pairs": lambda: two_boxes(3) | TIGHT,
    "mortar": lambda: two_boxes(3, 2) | TIGHT,
    "order 2": lambda: two_boxes(2, order=2) | TIGHT,
    "Tresca in space": lambda: two_boxes(3, law=TRESCA) | TIGHT,
    "loose solids": lambda: PUBLIC["two loose boxes on a plane"]["scene"] | TIGHT,
    **{f"discs {seed}": lambda seed=seed: discs(seed) for seed in (0, 1, 4, 6)},
}
RANDOM = {
    **{
        f"plane {seed}": lambda seed=seed: assembly_scenes.random_scene(seed)
        for seed in (80, 9, 170, 12, 189, 88, 70)
    },
    **{
        f"solids {seed}": lambda seed=seed: solid_assemblies.random_scene(seed) | TIGHT
        for seed in (3, 10)
    },
}
QUICK = ("coulomb", "plane 88")


@functools.cache
def as_it_is(name: str) -> Found:
    """The answer on one rank."""
    return found((SCENES | RANDOM)[name]())


def elsewhere(scene: dict) -> Elsewhere:
    """All of what must not matter at once; of the scenes of tests/products also the turns without a mirror."""
    changes = {"shift": -3.0, "length": 1e-3, "stress": 1e6, "order": -1, "role": -1}
    if "axisymmetric" not in scene:
        d = corners(scene["body"][0]["mesh"]).shape[1]
        changes["Q"] = np.diag([-1.0, 1.0, 1.0][:d]) @ (TURN, ROUND)[d - 2]
    return Elsewhere(**changes)


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(name, marks=[] if name in QUICK else pytest.mark.slow)
        for name in SCENES | RANDOM
    ],
)
def test_units_places_and_orders_do_not_matter(name):
    """The answer of a scene that is turned, mirrored, in other units, with its tables and roles in another order."""
    scene, one = (SCENES | RANDOM)[name](), as_it_is(name)
    assert one.certified or "no equilibrium" in one.reason, one.reason
    where = elsewhere(scene)
    assert_same(
        one, found(where.scene(scene)), where, 1e-9 if name in SCENES else 1e-6, name in SCENES
    )


@pytest.mark.slow
@pytest.mark.parametrize("name", ["coulomb", "loose solids", "discs 1"])
@pytest.mark.parametrize(
    "change",
    [{"length": 1e9}, {"length": 1e-9}, {"stress": 1e9}, {"stress": 1e-9}, {"shift": 1e5}],
    ids=str,
)
def test_very_small_and_very_large_numbers(name, change):
    """They cost no steps, change no digit, but for what rounding takes of places, and are not warned of."""
    where = Elsewhere(**change)
    one, other = as_it_is(name), found(where.scene(SCENES[name]()))
    assert_same(one, other, where, 1e-8 if "shift" in change else 1e-9)
    assert [*map(len, (one.summary["warnings"], one.summary["steps"]))] == [
        *map(len, (other.summary["warnings"], other.summary["steps"]))
    ]
    assert abs(one.summary["n_A"] - other.summary["n_A"]) <= 0.02 * one.summary["n_A"]
