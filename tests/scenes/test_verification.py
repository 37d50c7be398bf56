"""The verification problems on their coarsest meshes."""

import re

import pytest
from experiment import TABLES
from problems import PROBLEMS, around_axis, bricks, curved, flat, images, moving, solids, supports

pytestmark = pytest.mark.slow

ORDERS = {"spur-gears": (), "twisted-balls": (1,)}
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
"""Solids and bodies that move far with quadratic elements alone; the gallery's test solves the spur gears."""


@pytest.mark.parametrize(("name", "order"), RUNS)
def test_problem(name, order, tmp_path):
    """What is computed differs from what is exact by no more than its problem allows."""
    problem = PROBLEMS[name]
    found = problem.measure(problem.meshes[0], order, tmp_path)
    wrong = {
        key: (value.computed, value.exact) for key, value in found.values.items() if not value.met
    }
    assert found.values and not wrong
    assert found.curve is not None and len(found.curve.x) == len(found.curve.computed) > 2


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
