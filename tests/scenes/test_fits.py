"""Initial gaps that follow histories, against gaps that are there from the start, and against closed forms."""

import numpy as np
import pytest
from scenes import COULOMB, FLOOR, assert_refused, certified, rectangle
from solid_scenes import box

GROWS = {
    "history": {"fit": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]}},
    "time": {"points": [1.0, 2.0]},
}
QUARTER = [{"on": "start", "y": 0.0}, {"on": "end", "x": 0.0}]


def rings(gap, around: int = 15, **contact) -> dict:
    """Quarters of two rings; their nodes match with 12 sides around."""

    def ring(name: str, radii: list, sides: int) -> dict:
        return {
            "name": name,
            "material": {"young": 2.1e11, "poisson": 0.3},
            "clamp": QUARTER,
            "mesh": {
                "shape": "annulus",
                "center": [0.0, 0.0],
                "radii": radii,
                "angles": [0.0, 90.0],
                "divisions": [sides, 4],
            },
        }

    return {
        "body": [ring("shaft", [0.1, 0.3], 12), ring("hub", [0.3, 0.6], around)],
        "contact": [{"bodies": ["shaft", "hub"], "on": ["outer", "inner"], "gap": gap} | contact],
    }


def boxes(gap, **contact) -> dict:
    """Two boxes in a row between clamps, joined by a bond or not."""
    return {
        "body": [
            box(name, (x, 0, 0), (1, 1, 1), (2, 2, 2), young=1e9, poisson=0.0, clamp=[end])
            for name, x, end in (("first", 0.0, "left"), ("second", 1.0, "right"))
        ],
        "contact": [{"bodies": ["first", "second"], "on": ["right", "left"], "gap": gap} | contact],
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    ("scene", "value"),
    [
        (lambda gap: rings(gap), -1e-4),
        (lambda gap: rings(gap, 12), -1e-4),
        (lambda gap: rings(gap), "-1e-4 * x / 0.3"),
        (lambda gap: rings(gap), {"along": "arc", "points": [0.0, 0.4], "values": [-1e-4, -5e-5]}),
        (lambda gap: rings(gap, kind="bonded"), 1e-4),
        (lambda gap: boxes(gap), -1e-3),
        (lambda gap: boxes(gap, kind="bonded"), -1e-3),
    ],
    ids=["mortar", "nodes", "formula", "profile", "bonded", "boxes", "bonded boxes"],
)
def test_a_gap_follows_its_history(scene, value):
    """Without friction the answer of each step is that of a constant gap, on any pairing; works balance."""
    answer = certified(scene({"value": value, "history": "fit"}) | GROWS)
    (name,) = answer.contacts
    assert [step["time"] for step in answer.summary["steps"]][-1] == 2.0
    if isinstance(value, dict):
        ends = [
            value | {"values": [factor * each for each in value["values"]]} for factor in (1.0, 0.5)
        ]
    elif isinstance(value, str):
        ends = [f"{factor} * ({value})" for factor in (1.0, 0.5)]
    else:
        ends = [value, 0.5 * value]
    for step, gap in zip(
        [each for each in answer.summary["steps"] if each["time"] in (1.0, 2.0)], ends, strict=True
    ):
        expected = certified(scene(gap)).contacts[name]
        force = np.array(step["contacts"][name]["force"])
        assert np.abs(force - expected.force).max() <= 1e-6 * np.abs(expected.force).max() > 0.0
    state = answer.contacts[name]
    assert np.abs(state.gap - expected.gap).max() <= 1e-9 * np.abs(state.interface.gap).max()
    energy = answer.summary["energy"]
    assert energy["residual"] <= 1e-10
    assert energy["external_work"] == pytest.approx(energy["strain_energy"], rel=1e-6)


@pytest.mark.slow
def test_an_overlap_of_clamped_nodes_is_none_of_the_answer():
    """Between clamps a fit stays as it is drawn, also where it follows a history that turns its sign."""
    scene = rings({"value": -1e-4, "history": "fit"}) | GROWS
    scene["history"] = {"fit": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, -1.0]}}
    for body in scene["body"]:
        body["clamp"] = ["start", {"on": "end", "x": 0.0}]
    state = certified(scene).contacts["shaft-hub"]
    assert state.between.max() == pytest.approx(1e-4, rel=1e-6)
    scene["history"]["fit"]["factors"][2] = 1.0
    assert not [each for each in certified(scene).summary["warnings"] if "overlap" in each]


@pytest.mark.slow
def test_a_gap_that_closes_is_a_body_that_is_let_down():
    """While a block is pushed aside it is let down on a plane: by its clamp, or by its gap. The slip is the same."""

    def down(y: dict, gap) -> dict:
        clamp = [{"on": "top"} | y, {"on": "top", "x": 1e-3, "history": "push"}]
        return {
            "body": [rectangle("block", (0, 0), (2, 1), (4, 2), clamp=clamp)],
            "rigid": [FLOOR],
            "contact": [
                {
                    "bodies": ["block", "floor"],
                    "on": ["bottom"],
                    "gap": gap,
                    "friction": COULOMB | {"coefficient": 0.8},
                }
            ],
            "history": {
                "push": {"times": [0.0, 2.0, 3.0], "factors": [0.0, 1.0, 0.0]},
                "lower": {"times": [0.0, 2.0], "factors": [1.0, -1.0]},
                "clamp": {"times": [0.0, 2.0], "factors": [0.0, -2.0]},
            },
            "time": {"points": [2.0, 3.0]},
        }

    ones, others = (
        certified(each).summary
        for each in (
            down({"y": 1e-4, "history": "clamp"}, 1e-4),
            down({"y": 0.0}, {"value": 1e-4, "history": "lower"}),
        )
    )
    assert len(ones["steps"]) == len(others["steps"]) > 4
    for one, other in zip(ones["steps"], others["steps"], strict=True):
        assert one["time"] == other["time"]
        assert np.array(one["contacts"]["block-floor"]["force"]) == pytest.approx(
            np.array(other["contacts"]["block-floor"]["force"]), rel=1e-6, abs=1e-3
        )
    assert ones["energy"] == pytest.approx(others["energy"], rel=1e-6, abs=1e-6)
    assert ones["energy"]["dissipated"] > 0.0


@pytest.mark.parametrize(
    ("gap", "words"),
    [
        (
            {"value": -1e-4, "history": "fti"},
            "shaft-hub.gap.history: there is no [history.fti]; did you mean 'fit'",
        ),
        ({"history": "fit"}, "shaft-hub.gap: points and values must be equally many, at least one"),
        (
            {"value": 1e-4, "points": [0.0], "values": [1.0], "history": "fit"},
            "value does not go with points and values",
        ),
        ({"points": [0.0], "values": [1.0], "history": "fit"}, "what has a history has a value"),
        ({"value": "1e-4 / z", "history": "fit"}, "there is no z in the plane"),
        (
            {"value": "1e-4 / (y - y)", "history": "fit"},
            'gap: the formula "1e-4 / (y - y)" is inf at',
        ),
        ({"value": -5.0, "history": "fit"}, "they face away from each other"),
    ],
)
def test_a_gap_is_refused(gap, words):
    """One message that names the key, before anything is solved."""
    assert_refused(rings(gap) | GROWS, words)
