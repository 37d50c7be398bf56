"""The brute-force reference of assemblies (tests/support/assemblies.py) against another program and itself.

test_random_assemblies compares it with ddmpi, which is tested by closed forms in test_assemblies and others.
"""

import tomllib
from collections import Counter
from types import SimpleNamespace

import assemblies
import numpy as np
import pytest
import scenes
from assembly_scenes import FAMILIES, random_scene

MATERIAL = {"young": 2.0e10, "poisson": 0.25}
PLANE_MODULUS = 2.0e10 / (1 - 0.25**2)


def block(name: str, x: float, y: float, width: float, height: float, N: int, **more) -> dict:
    divisions = round(width * N), round(height * N)
    return scenes.rectangle(name, (x, y), (width, height), divisions, **{"material": MATERIAL} | more)


def plane(name: str, point: list[float], normal: list[float], **more) -> dict:
    return {"name": name, "shape": "plane", "point": point, "normal": normal} | more


def contact(first: str, second: str, *on: str, friction: dict | None = None, **more) -> dict:
    return {"name": f"{first}-{second}", "bodies": [first, second], "on": list(on)} | (
        {"friction": friction} if friction else {}) | more


def as_answer(solution: assemblies.Solution, change=lambda points, u: u) -> SimpleNamespace:
    """The solution in the form of the package's answer, its nodes in another order."""
    moved = {name: change(solution.points[name], u)[::-1] for name, u in solution.displacement.items()}
    return SimpleNamespace(bodies={name: SimpleNamespace(points=solution.points[name][::-1], displacement=u)
                                   for name, u in moved.items()})


@pytest.mark.parametrize("law, counts, forces, corner", [
    ("coulomb", (4, 45, 17), (1.1499786e8, 8.368861e6), (9.221043e-5, 1.7731729e-4)),
    ("tresca", (4, 42, 20), (1.1493356e8, 5.868415e6), (1.1189385e-4, 1.3447327e-4))])
def test_pinched_blocks(law, counts, forces, corner):
    """Two held blocks have the answers of another independent code, all digits of it."""
    found = assemblies.solve(scenes.pinched_blocks(22, law))
    assert found.converged
    status = Counter(found.status["upper-lower"])
    assert (status["open"], status["slip"], status["stick"]) == counts
    assert found.forces["upper-lower"].sum(axis=0) == pytest.approx(forces, rel=1e-7)
    at = np.abs(found.points["upper"] - [3.0, 2.0]).sum(axis=1).argmin()
    assert found.displacement["upper"][at] == pytest.approx(corner, rel=1e-7)


def test_bars_in_a_row():
    """p = δ / Σ L/E'; without friction each bar is free to move across, and that is told."""
    lengths, youngs, delta = (1.0, 0.5, 1.5), (1e10, 7e10, 3e8), 1e-4
    starts = np.cumsum([0.0, *lengths])
    bars = [block(f"bar{k}", starts[k], 0.0, lengths[k], 0.5, 4, material={"young": youngs[k], "poisson": 0.3})
            for k in range(3)]
    planes = [plane("left", [0.0, 0.0], [2.0, 0.0]),
              plane("right", [3.0, 7.0], [-1.0, 0.0], displacement=[-delta, 5e-5])]
    joints = [contact("bar0", "left", "left"), contact("bar0", "bar1", "right", "left"),
              contact("bar2", "bar1", "left", "right"), contact("bar2", "right", "right")]
    found = assemblies.solve({"body": bars, "rigid": planes, "contact": joints})
    assert found.converged and len(found.undetermined) == 3
    pressure = delta / sum(L * (1 - 0.3**2) / E for L, E in zip(lengths, youngs, strict=True))
    for forces in found.forces.values():
        assert forces[:, 0] == pytest.approx(pressure * np.array([1, 2, 1]) / 8, rel=1e-9)
    moved = as_answer(found, lambda points, u: u + np.array([0.0, 1e-3 * points[:, 0].mean()]))
    assert assemblies.distance(found, moved) < 1e-12
    assert assemblies.distance(found, as_answer(found, lambda points, u: u + np.array([1e-9, 0.0]))) > 1e-6


@pytest.mark.parametrize("weight, stands", [(0.8, True), (1.2, False)])
def test_block_between_walls(weight, stands):
    """Friction holds a squeezed block up to its limit; above it, where the linear program sees nothing, it drifts."""
    squeeze, friction = 1e-4, scenes.COULOMB | {"coefficient": 0.5}
    limit = 2 * 0.5 * squeeze * PLANE_MODULUS  # of an unheld block, roughly
    fallen = {"body": [block("block", 0.0, 0.0, 1.0, 1.0, 4, volume_force=[0.0, -weight * limit])],
              "rigid": [plane("left", [0.0, 0.0], [1.0, 0.0], displacement=[squeeze, 0.0]),
                        plane("right", [1.0, 0.0], [-1.0, 0.0])],
              "contact": [contact("block", "left", "left", friction=friction),
                          contact("block", "right", "right", friction=friction)]}
    found = assemblies.solve(fallen)
    assert found.imbalance < 1e-9
    assert found.converged == stands
    assert stands or found.how == "drift"


def test_clamped_nodes_and_corners():
    """Nodes that clamps hold on both sides carry no row; a corner belongs to every contact that has it."""
    below = [block(f"b{k}", k, 0.0, 1.0, 1.0, 2, clamp=["bottom"]) for k in (0, 1)]
    above = block("lid", 0.0, 1.0, 2.0, 1.0, 2, traction=[{"on": "top", "value": [0.0, -1e6]}])
    joints = [contact("b0", "b1", "right", "left", friction=scenes.COULOMB),
              *(contact("lid", name, "bottom", "top", friction=scenes.COULOMB) for name in ("b0", "b1"))]
    found = assemblies.solve({"body": [*below, above], "contact": joints})
    assert found.converged
    assert [len(forces) for forces in found.forces.values()] == [2, 3, 3]
    assert [pair.length for pair in found.assembly.pairs if pair.contact] == [0.25, 0.5, 0.25] * 2
    total = sum(found.forces[f"lid-b{k}"][:, 0].sum() for k in (0, 1))
    assert total == pytest.approx(2e6)


SEEDS = range(0, 64)


@pytest.fixture(scope="module")
def drawn():
    return {seed: assemblies.solve(random_scene(seed)) for seed in SEEDS}


def test_random_scenes_are_solved_or_have_no_equilibrium(drawn):
    """Every random scene has an answer or certainly none, and some of both."""
    outcomes = Counter("solved" if found.converged else found.reason.split(":")[0] for found in drawn.values())
    assert set(outcomes) == {"solved", "no equilibrium"}
    assert outcomes["solved"] > 0.7 * len(SEEDS) and outcomes["no equilibrium"] > 4
    for found in drawn.values():
        assert not found.converged or max(found.residuals) < 1e-9
    assert {found.assembly.scene["title"].split(",")[0] for found in drawn.values() if found.converged} == set(FAMILIES)


def test_two_methods_agree(drawn):
    """Interior points, from another start, end at the same displacements as Newton; both fulfil the laws."""
    for seed, found in drawn.items():
        if not found.converged:
            continue
        other = assemblies.by_interior_points(found.assembly)
        assert other.solved, seed
        u = found.assembly.displacement(other.u)
        again = SimpleNamespace(bodies={name: SimpleNamespace(points=found.points[name], displacement=u[name])
                                        for name in u})
        assert assemblies.distance(found, again) < 1e-7, seed
        assert assemblies.violation(found, again) < 1e-6, seed


def test_violation_tells_a_wrong_answer(drawn):
    """Displacements that obey no law are no other solution."""
    found = next(found for found in drawn.values() if found.converged and not found.undetermined)
    assert assemblies.violation(found, as_answer(found)) < 1e-6
    wrong = as_answer(found, lambda points, u: 1.01 * u)
    assert assemblies.distance(found, wrong) == pytest.approx(0.01)
    assert assemblies.violation(found, wrong) > 1e-4


def test_random_scenes_survive_toml():
    """A scene's text reads back as the same scene."""
    for seed in SEEDS:
        scene = random_scene(seed)
        assert tomllib.loads(scenes.to_toml(scene)) == scene
        assert random_scene(seed) == scene
