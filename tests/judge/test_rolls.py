"""Round bodies that roll to where a few nodes bear them: the warning, beside the roll of a rigid polygon."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scenes import certified, rectangle, seldom

from ddmpi.judge.rolls import KIND, free_to_roll
from ddmpi.system.doubts import Doubt

RADIUS = 10.0


def roller(
    around: int, tilt: float = 20.0, order: int = 1, slope: float = 0.0, young: float = 2.1e8
) -> dict:
    """A ring on a rigid plane, with friction; its lowest point is `tilt` degrees beside a node, and its load leans by
    `slope` degrees."""

    def down(angle: float) -> np.ndarray:
        return np.array([np.sin(np.radians(angle)), -np.cos(np.radians(angle))])

    body = {
        "name": "roller",
        "mesh": {
            "shape": "annulus",
            "center": [0.0, 0.0],
            "radii": [6.0, RADIUS],
            "angles": [0.0, 360.0],
            "divisions": [around, 2],
            "order": order,
        },
        "material": {"young": young, "poisson": 0.3},
        "volume_force": (5.0 * down(tilt + slope)).tolist(),
    }
    floor = {
        "name": "floor",
        "shape": "plane",
        "point": (RADIUS * down(tilt)).tolist(),
        "normal": (-down(tilt)).tolist(),
    }
    return {"body": [body], "rigid": [floor], "contact": [rubs("roller", "floor", "outer")]}


def rubs(*bodies_and_sides: str) -> dict:
    return {
        "bodies": [*bodies_and_sides[:2]],
        "on": [*bodies_and_sides[2:]],
        "friction": {"law": "coulomb", "coefficient": 0.3},
    }


def rolls(scene: dict) -> list[str]:
    found = certified(scene).summary["warnings"]
    return [warning for warning in found if "roll on each other" in warning]


def degrees_of(answer) -> float:
    """The mean turn of the roller."""
    x, u = answer.bodies["roller"].points, answer.bodies["roller"].displacement
    x, u = x - x.mean(axis=0), u - u.mean(axis=0)
    return float(np.degrees((x[:, 0] * u[:, 1] - x[:, 1] * u[:, 0]).sum() / (x**2).sum()))


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("around", "order"), [(48, 1), (64, 1), (48, 2)], ids=["48 sides", "64 sides", "order 2"]
)
def test_a_roll_to_the_nodes_of_a_stiff_ring_is_that_of_a_polygon(around, order):
    """A rigid polygon rests on the two corners around the foot of its load: their gaps over their distance."""
    angles = np.arange(-180.0, 180.0, 360.0 / (around * order)) - 20.0
    after = np.searchsorted(angles, 0.0)
    phi = np.radians(angles[after - 1 : after + 1])
    turn = -np.diff(RADIUS * (1.0 - np.cos(phi))) / np.diff(RADIUS * np.sin(phi))
    answer = certified(roller(around, order=order))
    # by the angle of small motions, counterclockwise
    assert abs(degrees_of(answer)) == pytest.approx(abs(np.degrees(turn[0])), rel=0.01)
    (told,) = [w for w in answer.summary["warnings"] if "roll on each other" in w]
    by, most = map(float, re.findall(r"(\S+) (?:degrees|either)", told))
    assert by == pytest.approx(abs(np.degrees(turn[0])), rel=0.06)  # two digits
    assert most == pytest.approx(180.0 / (around * order), rel=0.06)


@pytest.mark.every(2)
@pytest.mark.parametrize(
    ("scene", "told"),
    [
        (roller(48, tilt=0.0), False),  # the foot is at a node
        (roller(96, young=2.1e5), True),
        (roller(96, tilt=19.0, young=2e4), False),  # deforms by more than a facet
        (roller(96, slope=5.0), True),
        (roller(96, slope=8.0), False),  # rolls by 8 degrees, less than a quarter by facets
    ],
    ids=["at a node", "steel", "soft", "gentle slope", "steep slope"],
)
def test_a_roll_is_told_where_nodes_decide_it(scene, told):
    assert len(rolls(scene)) == told


@pytest.mark.parametrize(("clamp", "told"), [([], True), ([{"on": "inner", "x": 0.0}], False)])
def test_a_roll_is_one_that_clamps_leave_free(clamp, told):
    """A floor that is dragged takes a loose ring along, which should not roll; a hub that cannot turn only twists."""
    scene = roller(48, tilt=0.0, young=2.1e5)
    scene["rigid"][0]["displacement"] = [0.5, 0.0]
    scene["body"][0]["clamp"] = clamp
    assert len(rolls(scene)) == told


def test_many_nodes_decide_a_roll_better():
    """The resultant is where the load meets the floor: a round body rolls by tan of the slope, in small motions."""
    answer = certified(roller(192, tilt=20.3, slope=3.0, young=2e4))
    assert degrees_of(answer) == pytest.approx(-np.degrees(np.tan(np.radians(3.0))), rel=0.05)
    assert not any("roll on each other" in warning for warning in answer.summary["warnings"])


def test_a_flat_side_is_no_round_one():
    """A kite on its tip falls onto its side, by the angle between it and the floor."""
    mesh = {
        "shape": "quadrilateral",
        "corners": [[0.0, 0.0], [3.0, 1.4], [0.0, 4.0], [-3.0, 1.4]],
        "divisions": [1, 1],
    }
    lean = np.radians(10.0)
    kite = {
        "name": "roller",
        "mesh": mesh,
        "material": {"young": 2.1e5, "poisson": 0.3},
        "volume_force": [np.sin(lean), -np.cos(lean)],
    }
    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    scene = {"body": [kite], "rigid": [floor], "contact": [rubs("roller", "floor", "bottom+left")]}
    answer = certified(scene)
    assert degrees_of(answer) == pytest.approx(-np.degrees(1.4 / 3.0), rel=0.01)
    assert not any("roll on each other" in warning for warning in answer.summary["warnings"])


def on_a_block() -> dict:
    """The roller on an elastic block with nodes 1 apart, one of them below its load."""
    scene = roller(48, tilt=0.0, young=2.1e5)
    wheel = scene["body"][0]
    wheel["mesh"]["angles"] = [20.0, 380.0]
    block = rectangle("block", (-12.0, -16.0), (24.0, 6.0), (24, 2), young=2.1e5, clamp=["bottom"])
    return {"body": [wheel, block], "contact": [rubs("roller", "block", "outer", "top")]}


@pytest.mark.parametrize("first", ["roller", seldom("block")])
def test_a_wheel_on_an_elastic_block_rolls_to_its_nodes(first):
    scene = on_a_block()
    if first == "block":
        scene["contact"] = [rubs("block", "roller", "top", "outer")]
    scene["contact"][0]["slave"] = "roller"
    (told,) = rolls(scene)
    assert f"contact.{first}" in told and " roll on each other by 1.1 degrees" in told


def test_a_wheel_above_a_node_of_a_block_does_not_roll():
    scene = on_a_block()
    scene["contact"][0]["slave"] = "block"
    assert rolls(scene) == []


@pytest.mark.slow
def test_a_cylinder_in_space_rolls_to_lines_of_nodes():
    """Many nodes bear, but along its axis: across it they are within a facet."""
    lean = np.radians(11.0)
    down = np.array([np.sin(lean), 0.0, -np.cos(lean)])
    body = {
        "name": "roller",
        "mesh": {
            "shape": "cylinder",
            "center": [0.0, 0.0, 0.0],
            "axis": [0.0, 1.0, 0.0],
            "radii": [0.0, RADIUS],
            "height": 6.0,
            "size": 6.0,
        },
        "material": {"young": 2.1e5, "poisson": 0.3},
        "volume_force": (0.5 * down).tolist(),
    }
    floor = {
        "name": "floor",
        "shape": "plane",
        "point": (RADIUS * down).tolist(),
        "normal": (-down).tolist(),
    }
    scene = {"body": [body], "rigid": [floor], "contact": [rubs("roller", "floor", "outer")]}
    (told,) = rolls(scene)
    assert "contact.roller-floor: roller and floor roll on each other by" in told


def test_bodies_with_other_supports_do_not_roll():
    told = [Doubt("contact.a: rolls", KIND), Doubt("contact.b: rolls", KIND), "something else"]

    def touching(one: str, other: str, acting: float = 1.0) -> SimpleNamespace:
        return SimpleNamespace(bodies=(one, other), acting=acting)

    contacts = {
        "a": touching("wheel", "floor"),
        "b": touching("block", "floor"),
        "c": touching("block", "wall"),
        "d": touching("wheel", "wall", 0.0),
    }
    assert free_to_roll(told, contacts, {"wheel", "block"}) == [told[0], told[2]]
    assert free_to_roll(told, contacts, {"block"}) == [told[2]]
