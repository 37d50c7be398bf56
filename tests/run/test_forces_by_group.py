"""What loads and clamps do to bodies, by group: closed forms, and the equilibrium of each body."""

import numpy as np
import pytest
from scenes import seldom

import ddmpi

SHAPES = {
    2: {
        "upper": {"origin": [-1.5, 0.0], "size": [3.0, 1.0], "divisions": [4, 2]},
        "lower": {"origin": [-2.0, -1.0], "size": [4.0, 1.0], "divisions": [5, 2]},
    },
    3: {
        "upper": {"origin": [-1.5, 0.5, 0.0], "size": [3.0, 2.0, 1.0], "divisions": [4, 3, 2]},
        "lower": {"origin": [-2.0, 0.0, -1.0], "size": [4.0, 3.0, 1.0], "divisions": [5, 3, 2]},
    },
}


def scene(d: int, order: int = 1) -> dict:
    """A block on a wider one whose nodes do not match; at time 2 the history's factor is 0.5."""
    up = [0.0] * (d - 1)
    loads = {
        "upper": {
            "volume_force": {"value": [*up, -7e4], "history": "press"},
            "traction": [
                {"on": "top", "value": [*up, -1e6]},
                {"on": "right", "pressure": 2e5},
                {"on": "top", "pressure": 5e5, "history": "press"},
            ],
        }
    }
    clamps = {
        "upper": [{"on": "left", axis: 0.0} for axis in "xy"[: d - 1]],
        "lower": ["bottom", {"on": "bottom", "x": 0.0}, *[{"on": "front", "y": 0.0}][: d - 2]],
    }
    return {
        "history": {"press": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 2.0, 0.5]}},
        "time": {"points": [1.0, 2.0], "steps": 1},
        "body": [
            {
                "name": name,
                "material": {"young": 2e11, "poisson": 0.3},
                "clamp": clamps[name],
                "mesh": {"shape": "rectangle" if d == 2 else "box", "order": order, **shape},
            }
            | loads.get(name, {})
            for name, shape in SHAPES[d].items()
        ],
        "contact": [
            {
                "bodies": ["upper", "lower"],
                "on": ["bottom", "top"],
                "friction": {"law": "coulomb", "coefficient": 0.3},
            }
        ],
    }


def check(d: int, answer) -> None:
    """Loads are their closed forms, and with contact forces and reactions they balance, in each body."""
    assert answer.certified, answer.reason
    contact = answer.summary["contacts"]["upper-lower"]
    depth, middle = (1.0, []) if d == 2 else (2.0, [1.5])
    expected = {
        "top": ([0.0, *middle, 1.0], [0.0] * (d - 1) + [-3.75e6 * depth]),
        "right": ([1.5, *middle, 0.5], [-2e5 * depth] + [0.0] * (d - 1)),
        "volume_force": ([0.0, *middle, 0.5], [0.0] * (d - 1) + [-1.05e5 * depth]),
    }
    loads = answer.summary["bodies"]["upper"]["loads"]
    assert loads.keys() == expected.keys() and not answer.summary["bodies"]["lower"]["loads"]
    for group, (at, force) in expected.items():
        assert loads[group]["force"] == pytest.approx(force, rel=1e-12, abs=1e-6)
        assert loads[group]["moment"] == pytest.approx(np.cross(at, force), rel=1e-12, abs=1e-6)
    reactions = {name: body["reactions"] for name, body in answer.summary["bodies"].items()}
    assert set(reactions["upper"]) == {"left"} and set(reactions["lower"]) == {
        "bottom",
        *["front"] * (d - 2),
    }
    for (name, body), sign in zip(answer.summary["bodies"].items(), (1.0, -1.0), strict=True):
        for kind, size in (("force", 4e6 * depth), ("moment", 8e6 * depth)):
            held = np.sum([each[kind] for each in reactions[name].values()], axis=0)
            given = np.sum([each[kind] for each in body["loads"].values()], axis=0)
            assert held + given == pytest.approx(-sign * np.array(contact[kind]), abs=1e-9 * size)
        assert np.sum(
            [each["force"] for each in reactions[name].values()], axis=0
        ) == pytest.approx(body["reaction"], abs=1e-9 * size)
    assert reactions["upper"]["left"]["force"][-1] == 0.0  # nothing holds it there
    if d == 3:
        assert (
            reactions["lower"]["front"]["force"][::2]
            == [0.0, 0.0]
            != reactions["lower"]["front"]["force"][1]
        )


@pytest.mark.parametrize("d, order", [seldom(2, 1), (2, 2), seldom(3, 1)])
def test_forces_by_group_balance(d, order):
    """Every clamped group has one entry, each component at a shared node counts once, and bodies are in equilibrium."""
    check(d, ddmpi.solve(scene(d, order)))


@pytest.mark.slow
@pytest.mark.mpi(ranks=3)
@pytest.mark.parametrize("d", [2, 3])
def test_forces_by_group_balance_on_several_ranks(comm, d):
    """So they do where a body has two ranks."""
    check(d, ddmpi.solve(scene(d), comm))


@pytest.mark.slow
def test_the_last_clamp_that_holds_a_component_has_its_force():
    """Two groups that both hold their common node: together they have what a single group of both would have."""
    made = scene(2)
    summaries = []
    for clamps in (
        ["bottom"],
        ["bottom", {"on": "right", "x": 0.0}],
        [{"on": "right", "x": 0.0}, "bottom"],
    ):
        made["body"][1]["clamp"] = clamps
        summaries.append(ddmpi.solve(made).summary["bodies"]["lower"])
    shared = [each["reactions"]["right"]["force"] for each in summaries[1:]]
    assert shared[0][1] == shared[1][1] == 0.0 and shared[0][0] != pytest.approx(
        shared[1][0], rel=1e-3
    )
    for each in summaries:
        total = np.sum([forces["force"] for forces in each["reactions"].values()], axis=0)
        assert total == pytest.approx(each["reaction"], abs=1e-2)
