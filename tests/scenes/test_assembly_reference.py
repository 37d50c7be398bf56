"""The brute-force reference of assemblies (tests/support/assemblies.py) against closed forms and against itself."""

import tomllib
from collections import Counter
from itertools import pairwise
from types import SimpleNamespace

import assemblies
import numpy as np
import pytest
import scenes
from assembly_scenes import FAMILIES, random_scene

MATERIAL = {"young": 2.0e10, "poisson": 0.25}
PLANE_MODULUS = 2.0e10 / (1 - 0.25**2)


def coulomb(coefficient: float) -> dict:
    return {"law": "coulomb", "coefficient": coefficient}


def body(name: str, corners: list, divisions: list[int], **more) -> dict:
    return {"name": name, "mesh": {"shape": "quadrilateral", "corners": corners, "divisions": divisions},
            "material": MATERIAL} | more


def block(name: str, x: float, y: float, width: float, height: float, N: int, **more) -> dict:
    corners = [[x, y], [x + width, y], [x + width, y + height], [x, y + height]]
    return body(name, corners, [round(width * N), round(height * N)], **more)


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


@pytest.mark.parametrize("friction, status", [
    ({"law": "coulomb", "coefficient": 0.9}, "stick"), ({"law": "coulomb", "coefficient": 0.1}, "slip"),
    ({"law": "tresca", "slip_bound": 1e7}, "slip"), ({"law": "tresca", "slip_bound": 3e9}, "stick")])
def test_sheared_stack(friction, status):
    """Stick and slip of a sheared stack are exact: linear fields."""
    stack = scenes.sheared_stack(4, 5e-4, friction)
    assert stack.status == status
    found = assemblies.solve(stack.scene())
    assert found.converged
    for name, points in found.points.items():
        assert found.displacement[name] == pytest.approx(stack.displacement(name, points), abs=1e-12)
    assert found.forces["upper-lower"].sum(axis=0) == pytest.approx(
        [stack.pressure * stack.width, stack.width * stack.shear], rel=1e-10)
    assert set(found.status["upper-lower"]) == {status}


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


@pytest.mark.parametrize("angle", [0.0, 0.7])
@pytest.mark.parametrize("kind", ["bonded", "coulomb"])
def test_patch(kind, angle):
    """Four quadrilaterals with a cross point, pressed from two sides, have one constant stress."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    grid = np.array([[[0, 0], [1.1, 0], [2, 0]], [[0, 0.9], [1.0, 1.05], [2, 1.1]], [[0, 2], [0.95, 2], [2, 2]]])
    p, q, nu, E = 3e6, 2e6, MATERIAL["poisson"], MATERIAL["young"]
    how = {"kind": "bonded"} if kind == "bonded" else {"friction": coulomb(0.5)}
    bodies, joints = [], []
    for j in (0, 1):
        for i in (0, 1):
            name = f"b{i}{j}"
            loads = [{"on": "top", "pressure": p}] if j else []
            loads += [{"on": "right", "value": (turn @ [-q, 0.0]).tolist()}] if i else []
            corners = (grid[[j, j, j + 1, j + 1], [i, i + 1, i + 1, i]] @ turn.T).tolist()
            bodies.append(body(name, corners, [3, 4], traction=loads))
            joints.append(contact(name, f"b0{j}", "left", "right", **how) if i else contact(name, "wall", "left"))
            joints.append(contact(name, f"b{i}0", "bottom", "top", **how) if j else contact(name, "floor", "bottom"))
    rigid = [plane("wall", [0.0, 0.0], turn[:, 0].tolist()), plane("floor", [0.0, 0.0], turn[:, 1].tolist())]
    found = assemblies.solve({"body": bodies, "rigid": rigid, "contact": joints})
    assert found.converged and not found.undetermined
    strain = (1 + nu) / E * np.array([-q * (1 - nu) + nu * p, -p * (1 - nu) + nu * q])
    for name, points in found.points.items():
        assert found.displacement[name] @ turn == pytest.approx(points @ turn * strain, abs=1e-9 * p / E)


def pushed(share: float, N: int = 4) -> dict:
    """A block of 2 × 1 on a floor with friction .5, pushed by `share` of its weight."""
    weight = 1e6
    return {"body": [block("block", 0.0, 0.0, 2.0, 1.0, N, volume_force=[share * weight, -weight])],
            "rigid": [plane("floor", [5.0, 0.0], [0.0, 1.0])],
            "contact": [contact("block", "floor", "bottom", friction=coulomb(0.5))]}


def test_pushed_below_the_limit():
    """Below the limit the floor's forces balance weight and push, and the block does not slide off."""
    found = assemblies.solve(pushed(0.45))
    assert found.converged and not found.undetermined
    assert found.forces["block-floor"].sum(axis=0) == pytest.approx([2e6, 0.9e6])  # t points right: as the push
    assert found.displacement_max < 1e-3


@pytest.mark.parametrize("share", [0.51, 0.6])
def test_pushed_above_the_limit(share):
    """Above the limit the linear program leaves what friction cannot take."""
    found = assemblies.solve(pushed(share))
    assert not found.converged and "no equilibrium" in found.reason
    assert found.imbalance == pytest.approx((share - 0.5) / (1 + share), rel=1e-6)


@pytest.mark.parametrize("shift, stands", [(0.25, True), (0.5, False), (0.75, False)])
def test_tower(shift, stands):
    """A tower stands while the weight above every joint lies over it."""
    blocks = [block(f"b{k}", k * shift, k, 1.0, 1.0, 4, volume_force=[0.0, -1e6], clamp=[] if k else ["bottom"])
              for k in range(3)]
    joints = [contact(f"b{k}", f"b{k - 1}", "bottom", "top", friction=coulomb(0.5)) for k in (1, 2)]
    found = assemblies.solve({"body": blocks, "contact": joints})
    assert found.converged == stands
    assert stands or "no equilibrium" in found.reason
    if stands:
        assert len(found.forces["b1-b0"]) == 4  # nodes that the side above does not cover carry nothing
        assert found.forces["b1-b0"].sum(axis=0) == pytest.approx([2e6, 0.0], abs=1e-3)


@pytest.mark.parametrize("coefficient, stands", [(0.6, True), (0.05, False)])
def test_arch(coefficient, stands):
    """Eleven voussoirs stand on their springings, unless they slide out."""
    angle = np.pi * (1 - np.arange(12) / 11)
    inner, outer = (r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in (4.0, 5.0))
    names = [f"v{k}" for k in range(11)]
    bodies = [body(name, [inner[k].tolist(), inner[k + 1].tolist(), outer[k + 1].tolist(), outer[k].tolist()], [4, 3],
                   volume_force=[0.0, -2e4]) for k, name in enumerate(names)]
    friction = coulomb(coefficient)
    joints = [contact(a, b, "right", "left", friction=friction) for a, b in pairwise(names)]
    joints += [contact("v0", "ground", "left", friction=friction), contact("v10", "ground", "right", friction=friction)]
    found = assemblies.solve({"body": bodies, "rigid": [plane("ground", [0.0, 0.0], [0.0, 1.0])], "contact": joints})
    assert found.converged == stands
    if stands:
        weight = 11 * 2e4 * np.sin(np.pi / 11) / 2 * (5.0**2 - 4.0**2)
        assert sum(found.forces[name][:, 0].sum() for name in ("v0-ground", "v10-ground")) == pytest.approx(weight)
        assert found.displacement["v5"][:, 1].max() < 0.0  # the crown sinks


@pytest.mark.parametrize("weight, stands", [(0.8, True), (1.2, False)])
def test_block_between_walls(weight, stands):
    """Friction holds a squeezed block up to its limit; above it, where the linear program sees nothing, it drifts."""
    squeeze, friction = 1e-4, coulomb(0.5)
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
    joints = [contact("b0", "b1", "right", "left", friction=coulomb(0.3)),
              *(contact("lid", name, "bottom", "top", friction=coulomb(0.3)) for name in ("b0", "b1"))]
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
