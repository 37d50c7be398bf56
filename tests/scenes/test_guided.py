"""Guided contacts: forces of both signs along the normal, none along the surface."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import certified, rectangle, seldom
from solid_scenes import box

import ddmpi
from ddmpi.errors import InputError

PULL = 1e6


def block(
    name: str, d: int, bottom: float, n: int, order: int, sides: tuple[str, ...], **more
) -> dict:
    """A block 2 × 1 (× 1) on rollers along its `sides`."""
    clamp = [{"on": side, "normal": 0.0} for side in sides]
    if d == 2:
        return rectangle(name, (0.0, bottom), (2.0, 1.0), (2 * n, n), order, clamp=clamp, **more)
    return box(
        name, (0.0, 0.0, bottom), (2.0, 1.0, 1.0), (n, n, n), order, 1e9, clamp=clamp, **more
    )


def up(d: int, value: float) -> list[float]:
    return [0.0] * (d - 1) + [value]


@pytest.mark.parametrize(
    ("d", "order", "n", "swapped"),
    [
        (2, 2, 3, True),
        (3, 1, 2, False),
        *(seldom(*one) for one in ((2, 1, 4, False), (3, 2, 3, False), (3, 1, 3, True))),
    ],
)
def test_pulled_blocks_stay_together_and_slide(d, order, n, swapped):
    """The tension is the pull at every node, on meshes that match and others; the blocks get thinner by themselves."""
    sides = ("left", "front")[: d - 1]
    upper = block("upper", d, 1.0, n, order, sides, traction=[{"on": "top", "value": up(d, PULL)}])
    lower = block("lower", d, 0.0, 4 if d == 2 else 2, order, (*sides, "bottom"))
    scene = {
        "body": [upper, lower],
        "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"], "kind": "guided"}],
    }
    if swapped:
        scene["contact"][0] |= {"bodies": ["lower", "upper"], "on": ["top", "bottom"]}
    upper["material"]["young"] = 2e9  # it gets thinner by half as much, so that the sides slide
    answer = certified(scene)
    (state,), summary = answer.contacts.values(), answer.summary
    assert state.pressure == pytest.approx(np.full(len(state.pressure), -PULL), rel=1e-6)
    assert set(state.status) == {"slip"} and not state.tangential_force.any()
    # The lower block gets thinner by ν p/E, in plane strain by (1 + ν) ν p/E.
    thinner = PULL * (0.3 * 1.3 if d == 2 else 0.3) / 1e9
    assert np.abs(answer.bodies["lower"].displacement[:, 0]).max() == pytest.approx(
        2.0 * thinner, rel=1e-6
    )
    assert np.abs(answer.bodies["upper"].displacement[:, 0]).max() == pytest.approx(
        thinner, rel=1e-6
    )
    assert np.abs(state.slip).max() > 0.8 * thinner
    assert (
        summary["contacts"][state.interface.name]["friction"] == "guided"
        and summary["undetermined"] == []
    )


@pytest.mark.parametrize("d", [2, 3])
def test_a_guide_is_a_roller(d):
    """A face guided at a rigid plane bends nowhere, as with a clamp along its normal, under bending loads too."""
    load = [{"on": "right", "value": [*up(d - 1, 0.0), 2e5]}]
    scene = {
        "body": [block("beam", d, 0.0, 3, 1, ("top",), traction=load)],
        "rigid": [{"name": "guide", "shape": "plane", "point": up(d, 0.0), "normal": up(d, 1.0)}],
        "contact": [{"bodies": ["beam", "guide"], "on": ["bottom"], "kind": "guided"}],
    }
    scene["body"][0]["clamp"] = [{"on": "left", "x": 0.0} | ({"y": 0.0} if d == 3 else {})]
    guided = certified(scene)
    (state,) = guided.contacts.values()
    assert state.pressure.min() < -1e4 and state.pressure.max() > 1e4
    scene["body"][0]["clamp"].append({"on": "bottom", "normal": 0.0})
    scene |= {
        "contact": [{"bodies": ["beam", "guide"], "on": ["top"]}],
        "rigid": [scene["rigid"][0] | {"point": up(d, 2.0), "normal": up(d, -1.0)}],
    }
    held = certified(scene).bodies["beam"].displacement
    assert np.abs(guided.bodies["beam"].displacement - held).max() <= 1e-9 * np.abs(held).max()


def pushed(force: float, **more) -> dict:
    """A loose block guided at a floor, between two pulls that differ by a force along the floor."""
    return {
        "body": [
            rectangle(
                "block",
                (0.0, 0.0),
                (2.0, 1.0),
                (4, 2),
                traction=[{"on": "top", "value": [force, PULL]}],
            )
        ],
        "rigid": [{"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}],
        "contact": [{"bodies": ["block", "floor"], "on": ["bottom"], "kind": "guided"} | more],
    }


@pytest.mark.clarabel
def test_a_guide_holds_against_a_pull_and_not_along_itself():
    """The block hangs on its guide, moments too; pushed along the guide it slides away, which is said."""
    answer = certified(pushed(0.0))
    assert answer.summary["contacts"]["block-floor"]["force"] == pytest.approx(
        [0.0, -2.0 * PULL], rel=1e-9, abs=1e-3
    )
    (held,) = answer.summary["held_motions"]
    assert (
        held["motion"] == "block can move along x without any force"
        and answer.summary["undetermined"] == []
    )
    answer = ddmpi.solve(pushed(1.0), MPI.COMM_SELF)
    assert answer.reason.startswith("no equilibrium: block would move along x")


def test_a_gap_is_closed_and_steps_balance():
    """A given gap of a guide is closed or opened, as that of a bond; the works of load steps balance."""
    for gap in (2e-3, -2e-3):
        scene = pushed(0.0, gap={"value": gap, "history": "fit"}) | {
            "history": {"fit": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]}},
            "time": {"points": [1.0, 2.0], "steps": 2},
        }
        answer = certified(scene)
        bottom = answer.bodies["block"].points[:, 1] == 0.0
        assert answer.bodies["block"].displacement[bottom, 1] == pytest.approx(
            np.full(5, -0.5 * gap), rel=1e-9
        )
        assert answer.summary["energy"]["residual"] <= 1e-10


@pytest.mark.parametrize("y", [1e-3, -1e-3])
def test_clamps_that_contradict_a_guide(y):
    """Clamps that move a guided face off its guide, or into it, are refused; along the guide they may move it."""
    scene = pushed(0.0)
    scene["body"][0]["clamp"] = [{"on": "left", "x": 1e-3, "y": y}]
    with pytest.raises(InputError, match=r"they take the guided sides off each other by 0\.001 m"):
        ddmpi.solve(scene, MPI.COMM_SELF)
    scene["body"][0]["clamp"] = [{"on": "left", "x": 1e-3}]
    assert certified(scene).bodies["block"].displacement[:, 0].max() == pytest.approx(1e-3)


def test_friction_of_a_guide_is_refused():
    with pytest.raises(InputError, match='friction does not go with kind = "guided"'):
        ddmpi.solve(pushed(0.0, friction={"law": "coulomb", "coefficient": 0.3}), MPI.COMM_SELF)
