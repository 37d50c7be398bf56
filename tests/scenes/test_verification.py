"""The verification problems on their coarsest meshes."""

import re

import pytest
from experiment import TABLES
from problems import PROBLEMS, around_axis, bricks, curved, flat, images, moving, solids, supports
from problems.bodies import answer_of

pytestmark = pytest.mark.slow

IN_FEWER_STEPS = ("carter", "rolling-disc", "turned-pair", "turned-solid")
ORDERS = {"spur-gears": (), "bolted-sector": (), "twisted-balls": (1,), "patch": (2,)}
ORDERS |= dict.fromkeys(IN_FEWER_STEPS, ())
RUNS = [
    (name, order)
    for name, each in PROBLEMS.items()
    for order in ORDERS.get(
        name,
        (
            each.orders[-1:]
            if each.in_space or each.measure.__module__ == moving.__name__
            else each.orders
        ),
    )
]
"""Solids and bodies that move far with quadratic elements alone, and so the many patches: interface/test_mortar.py and
other problems ask linear ones. The gallery's test solves the spur gears, test_sectors.py a bolted sector; motions in
fewer steps than those of the page stand below."""


@pytest.mark.parametrize(("name", "order"), RUNS)
def test_problem(name, order, tmp_path):
    """What is computed differs from what is exact by no more than its problem allows."""
    problem = PROBLEMS[name]
    found = problem.measure(problem.tested, order, tmp_path)
    wrong = {
        key: (value.computed, value.exact) for key, value in found.values.items() if not value.met
    }
    assert found.values and not wrong
    assert found.curve is not None and len(found.curve.x) == len(found.curve.computed) > 2


# In fewer steps than those of the page


def test_a_driven_roller_creeps(tmp_path):
    """By Carter's creep, which is as much as it lacks of its way; without a force it lacks a 25th of that."""
    found, pressure, exact, _ = moving.creep(0.5, tmp_path, 4, 2)
    assert found == pytest.approx(exact, rel=0.05) and pressure == pytest.approx(1.0, abs=0.02)


def test_a_loose_disc_rolls_in_a_bore():
    """Without a force aside, and its turn is the bore's over the radius of the disc."""
    turned, normal, tangential = moving.rolled(answer_of(moving.rolling(2, 1, 3)))
    assert normal <= moving.EXACT and tangential <= moving.EXACT
    assert turned == pytest.approx(1.5 * moving.BORE, rel=0.015)


def test_a_pair_that_is_turned_together_keeps_its_forces():
    """Nothing slides in the quarter turn."""
    summary = answer_of(moving.turned(2, 1, 3)).summary
    assert max(map(abs, moving.turn_errors(summary))) <= moving.EXACT
    (rubbed,) = summary["contacts"].values()
    assert rubbed["slip"] > 0


def test_a_block_that_turns_on_a_plate_is_resisted_by_friction():
    """By μ N at each node's distance from its middle; one that slides by μ N."""
    moment, apart, _ = moving.torque(2, 2)
    assert moment == pytest.approx(1.0, abs=0.02) and apart <= 1e-4


def test_all_problems_are_there():
    """Those of all modules, each under its name, on ascending meshes, and with its section in the page."""
    page = (TABLES / "verification.md").read_text(encoding="utf-8")
    sections = re.findall(
        r"^## (.*)\n\n\*\*Shows\.\*\* .*\n\n\*\*Scene\.\*\* .*\n\n\*\*Exact\.\*\* ", page, re.M
    )
    assert sorted(sections) == sorted(each.title for each in PROBLEMS.values())
    assert {each.measure.__module__ for each in PROBLEMS.values()} == {
        module.__name__
        for module in (flat, curved, supports, images, around_axis, moving, solids, bricks)
    }
    assert len(PROBLEMS) == 56
    for name, each in PROBLEMS.items():
        assert each.name == name and sorted(set(each.meshes)) == list(each.meshes)
