"""The tables of a run: columns, rows and digits of contact_NAME.csv, its sides, history.csv and steps.csv."""

import csv
import dataclasses

import made_up
import numpy as np
import pytest
from documented import NAMES

from ddmpi.results.histories import FRAMES_IN
from ddmpi.results.tables import (
    CYCLE,
    ENERGY,
    HISTORY,
    LEGS_IN,
    PATH,
    SIDES,
    STEPS_IN,
    named,
    write_contact,
    write_sides,
    write_steps,
)


def rows(path) -> list[list[str]]:
    with open(path, newline="", encoding="utf-8") as file:
        return list(csv.reader(file))


def columns(path) -> dict[str, np.ndarray]:
    header, *lines = rows(path)
    return {
        name: np.array(column, str if name in ("status", "contact") else float)
        for name, column in zip(header, zip(*lines, strict=True), strict=True)
    }


def stack(order: int = 1, divisions=(24, 8)):
    """The state of two blocks' contact."""
    upper, lower = (made_up.block(origin, divisions, order) for origin in made_up.STACK.values())
    return made_up.state(made_up.interface("upper-lower", upper, lower, ("bottom", "top")))


@pytest.mark.parametrize(
    ("name", "columns"),
    {
        "contact_NAME_sides.csv": SIDES,
        "contact_NAME_legs.csv": LEGS_IN[2],
        "contact_NAME_legs.csv of solids": LEGS_IN[3],
        "history.csv": HISTORY,
        "steps.csv": STEPS_IN[2] + CYCLE,
        "steps.csv of solids": STEPS_IN[3] + CYCLE,
        "energy.csv": ENERGY + CYCLE,
        "frames.csv": {*FRAMES_IN[2], *FRAMES_IN[3]},
        "path.csv": PATH,
    }.items(),
)
def test_the_reference_has_all_columns(name, columns):
    """What a table holds is what docs/reference/results.md says, in its order."""
    assert NAMES[name] == list(columns) if name != "frames.csv" else set(NAMES[name]) == columns


def test_a_contact_has_a_line_per_node_with_all_digits(tmp_path):
    """contact_NAME.csv has the columns of format 2, and every number can be read back exactly."""
    state = stack()
    write_contact(tmp_path, "upper-lower", state)
    assert rows(tmp_path / "contact_upper-lower.csv")[0] == [
        "x",
        "y",
        "nx",
        "ny",
        "length",
        "normal_force",
        "tangential_force",
        "normal_stress",
        "tangential_stress",
        "gap",
        "slip",
        "slip_total",
        "status",
        "utilisation",
    ]
    table = columns(tmp_path / "contact_upper-lower.csv")
    assert np.array_equal(np.column_stack([table["x"], table["y"]]), state.interface.xy)
    assert np.array_equal(
        np.column_stack([table["nx"], table["ny"]]), np.tile([0.0, -1.0], (25, 1))
    )
    assert table["length"] == pytest.approx([1 / 16, *[1 / 8] * 23, 1 / 16])
    for name, values in {
        "normal_force": state.normal_force,
        "gap": state.gap,
        "status": state.status,
        "tangential_force": state.tangential_force[:, 0],
        "slip": state.slip[:, 0],
        "slip_total": state.slip[:, 0],
        "utilisation": state.utilised,
    }.items():
        assert np.array_equal(table[name], values), name
    for kind in ("normal", "tangential"):
        assert np.array_equal(table[f"{kind}_stress"], table[f"{kind}_force"] / table["length"])


def test_the_total_slip_of_several_steps_is_a_column_of_its_own(tmp_path):
    """`slip` is that of the step, `slip_total` that of all steps."""
    state = stack()
    write_contact(tmp_path, "c", dataclasses.replace(state, before=2.0 * state.slip))
    table = columns(tmp_path / "contact_c.csv")
    assert table["slip"].any() and np.array_equal(table["slip_total"], 3.0 * table["slip"])


def ring():
    """The state of a ring's contact with another one, whose chain of nodes is closed."""
    inner, outer = (made_up.ring(radii, order=2) for radii in ((1.0, 2.0), (2.0, 3.0)))
    return made_up.state(made_up.interface("inner-outer", inner, outer, ("outside", "inside")))


@pytest.mark.parametrize(
    ("state", "length"), [(stack(order=2), 1 / 8), (ring(), 4.0 * np.sin(np.pi / 24))]
)
def test_means_over_sides_carry_the_force_of_quadratic_elements(tmp_path, state, length):
    """contact_NAME_sides.csv has one line per side; length times stress sums up to the resultant of the nodes."""
    write_sides(tmp_path, "c", state)
    table = columns(tmp_path / "contact_c_sides.csv")
    assert list(table) == ["x", "y", "length", "normal_stress", "tangential_stress"]
    assert table["length"] == pytest.approx([length] * 24)
    assert np.array_equal(np.column_stack([table["x"], table["y"]]), state.interface.xy[1::2])
    assert table["length"] @ table["normal_stress"] == pytest.approx(
        state.normal_force.sum(), rel=1e-12
    )
    assert table["length"] @ table["tangential_stress"] == pytest.approx(
        state.tangential_force.sum(), rel=1e-12
    )


def test_steps_has_a_line_per_step_and_contact(tmp_path):
    """steps.csv has what the summary says of each contact at each step; its null is nan."""
    step = {
        "force": [1.0, None],
        "moment": 3.0,
        "normal_force": 4.0,
        "tangential_force": 5.0,
        "open": 6,
        "slip": 7,
        "stick": 8,
        "dissipated": 9.0,
        "utilisation": None,
    }
    write_steps(
        tmp_path,
        [
            {"time": 0.5, "outer_iterations": 3, "contacts": {"a": step, "b": step | {"open": 0}}},
            {"time": 1.0, "outer_iterations": 3, "contacts": {"a": step, "b": step}},
        ],
    )
    header, *lines = rows(tmp_path / "steps.csv")
    assert header == [
        "time",
        "contact",
        "force_x",
        "force_y",
        "moment",
        "normal_force",
        "tangential_force",
        "open",
        "slip",
        "stick",
        "dissipated",
        "utilisation",
    ]
    assert [line[:2] for line in lines] == [["0.5", "a"], ["0.5", "b"], ["1.0", "a"], ["1.0", "b"]]
    assert lines[0][2:] == ["1.0", "nan", "3.0", "4.0", "5.0", "6", "7", "8", "9.0", "nan"]
    assert lines[1][7] == "0"


@pytest.mark.parametrize(("axisymmetric", "called"), [(False, "length"), (True, "area")])
def test_nodal_lengths_around_an_axis_are_areas(axisymmetric, called):
    """In the header of a contact's table; the others have their names."""
    assert named(["x", "length", "gap"], axisymmetric) == ["x", called, "gap"]
