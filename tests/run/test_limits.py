"""Runs of loose bodies near the limit of what contacts can bear."""

import pytest
from scenes import COULOMB, FLOOR, certified, rectangle, seldom

import ddmpi

pytestmark = pytest.mark.clarabel


def block(push: float, friction: dict, order: int = 1) -> dict:
    """A block, as high as two widths, on a floor; it tips when pushed by half its weight."""
    return {
        "body": [
            rectangle(
                "block",
                (0.0, 0.0),
                (1.0, 2.0),
                (2, 4),
                order,
                young=2.1e11,
                volume_force=[1e6 * push, -1e6],
            )
        ],
        "rigid": [FLOOR],
        "contact": [{"bodies": ["block", "floor"], "on": ["bottom"], "friction": friction}],
    }


@pytest.mark.parametrize(
    "limit, friction, words",
    [
        (0.5, COULOMB | {"coefficient": 1.0}, "would move most at (0, 2)"),
        (0.3, COULOMB, "would move along x"),
        seldom(0.3, {"law": "tresca", "slip_bound": 6e5}, "would move along x"),
    ],
    ids=["tips", "slides", "slides by Tresca"],
)
@pytest.mark.parametrize("order", [1, seldom(2)])
def test_a_run_just_past_a_limit_says_so(limit, friction, words, order):
    """By 1e-6 of the load there is no equilibrium, which motion it lacks is said, and no path is followed in vain."""
    answer = ddmpi.solve(block(limit * (1.0 + 1e-6), friction, order))
    assert not answer.certified
    assert answer.reason.startswith("no equilibrium: block " + words)
    assert "as nothing balances" in answer.reason
    assert answer.summary["outer_iterations"] < 30
    certified(block(limit * (1.0 - 1e-6), friction, order))
