"""Round bodies that roll to where a few nodes bear them: the warning, beside the roll of a rigid polygon."""

import re

import numpy as np
import pytest
from scenes import certified, rectangle, seldom

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


def degrees_of(answer, name: str = "roller") -> float:
    """The mean turn of the roller."""
    x, u = answer.bodies[name].points, answer.bodies[name].displacement
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


def in_a_groove(start: float, coefficient: float, angle: float = 45.0) -> dict:
    """The roller in a groove of two planes at an `angle`, its first node at `start` degrees."""
    scene = roller(48, tilt=0.0)
    scene["body"][0]["mesh"]["angles"] = [start, start + 360.0]
    scene["rigid"], scene["contact"] = [], []
    for name, turn in (("left", angle), ("right", -angle)):
        normal = np.array([np.sin(np.radians(turn)), np.cos(np.radians(turn))])
        plane = {"name": name, "shape": "plane", "normal": normal.tolist()}
        scene["rigid"].append(plane | {"point": (-RADIUS * normal).tolist()})
        scene["contact"].append(rubs("roller", name, "outer"))
        scene["contact"][-1]["friction"]["coefficient"] = coefficient
    return scene


@pytest.mark.every(2)
@pytest.mark.parametrize("start", [1.0, 3.0])
@pytest.mark.parametrize(("coefficient", "rolls_by"), [(0.3, 0.0), (0.01, 3.75)])
def test_friction_that_sticks_in_a_groove_leaves_no_roll(start, coefficient, rolls_by):
    """Both sides of a symmetric groove hold a smooth cylinder, whatever the friction. One that slips on facets rolls to
    where two nodes bear on either plane; one that sticks only goes down onto its nodes."""
    answer = certified(in_a_groove(start, coefficient))
    told = [w for w in answer.summary["warnings"] if "roll on each other" in w]
    assert len(told) == bool(rolls_by)
    if rolls_by:
        assert abs(degrees_of(answer)) == pytest.approx(rolls_by - start, abs=0.01)
        assert "decide up to 3.8 either way" in told[0] and "worst of 2 such" in told[0]
    else:
        assert abs(degrees_of(answer)) < 0.1


def on_two_rollers(starts: tuple[float, float], held: bool = False) -> dict:
    """A plate on rollers with their first nodes at `starts` degrees; it may be `held` along the floor."""
    scene = roller(48, tilt=0.0)
    (first,), contacts = (
        scene["body"],
        [rubs("one", "floor", "outer"), rubs("two", "floor", "outer")],
    )
    first |= {"volume_force": [0.0, 0.0]}
    rollers = [
        first
        | {
            "name": name,
            "mesh": first["mesh"] | {"center": [x, 0.0], "angles": [start, start + 360.0]},
        }
        for name, x, start in zip(("one", "two"), (0.0, 30.0), starts, strict=True)
    ]
    plate = rectangle("plate", (-20.0, RADIUS), (70.0, 6.0), (70, 2), young=2.1e8)
    plate |= {"traction": [{"on": "top", "value": [0.0, -20.0]}]}
    plate |= {"clamp": [{"on": "left", "x": 0.0}]} if held else {"clamp": []}
    contacts += [
        rubs(name, "plate", "outer", "bottom") | {"slave": name} for name in ("one", "two")
    ]
    return scene | {"body": [*rollers, plate], "contact": contacts}


@pytest.mark.slow
@pytest.mark.parametrize(("held", "turn"), [(False, 1.75), (True, 0.0)])
def test_a_plate_on_rollers_rolls_to_their_nodes(held, turn):
    """A plate that is held along the floor holds its rollers; another one rolls with them to where two nodes bear at
    each, 2 and 5.5 degrees beside the foot."""
    answer = certified(on_two_rollers((2.0, 2.0), held))
    for name in ("one", "two"):
        assert degrees_of(answer, name) == pytest.approx(turn, abs=0.1)
    told = [w for w in answer.summary["warnings"] if "roll on each other" in w]
    assert len(told) == (not held)
    assert held or ("worst of 4 such" in told[0] and "decide up to 3.8 either way" in told[0])


@pytest.mark.parametrize(
    ("coefficient", "told"), [(0.02, 1), pytest.param(0.3, 0, marks=pytest.mark.slow)]
)
def test_a_roller_that_moves_far_rolls_to_its_nodes(coefficient, told):
    """Its turn is that since it was drawn."""
    scene = in_a_groove(2.0, coefficient) | {"time": {"motions": "far", "points": [1.0]}}
    answer = certified(scene)
    assert abs(degrees_of(answer)) == pytest.approx(1.75 if told else 0.0, abs=0.1)
    found = [re.search(r"roll on each other by 1.[78] deg", w) for w in answer.summary["warnings"]]
    assert sum(map(bool, found)) == told
