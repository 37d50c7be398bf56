"""Files of solids: vectors in x, y, z, areas, tetrahedra, surfaces."""

import csv

import made_up
import made_up_solids
import meshio
import numpy as np
import pytest
from made_up_solids import stacked

COLUMNS = [
    "x",
    "y",
    "z",
    "nx",
    "ny",
    "nz",
    "area",
    "normal_force",
    "tangential_force",
    "normal_stress",
    "tangential_stress",
    "gap",
    "slip",
    "slip_total",
    "status",
    "force_x",
    "force_y",
    "force_z",
    "slip_x",
    "slip_y",
    "slip_z",
    "utilisation",
]


def vectors(table, *names: str) -> np.ndarray:
    return np.column_stack([table[name] for name in names])


@pytest.mark.parametrize("order", [1, 2])
def test_tables_have_vectors_in_space(tmp_path, order):
    """contact_NAME.csv has the columns of solids; forces, moments and slips follow from its vectors."""
    results = stacked(tmp_path, order)
    with open(tmp_path / "contact_upper-lower.csv", encoding="utf-8") as file:
        assert next(csv.reader(file)) == COLUMNS
    assert not results.sides and results.dimension == 3
    table, contact = results.contacts["upper-lower"], results.summary["contacts"]["upper-lower"]
    at, normal, force, slip = (
        vectors(table, *names)
        for names in (COLUMNS[:3], COLUMNS[3:6], COLUMNS[15:18], COLUMNS[18:21])
    )
    assert table["area"].sum() == pytest.approx(3.0)
    assert force.sum(axis=0) == pytest.approx(contact["force"])
    assert np.cross(at, force).sum(axis=0) == pytest.approx(contact["moment"])
    assert -(force * normal).sum(axis=1) == pytest.approx(table["normal_force"])
    friction = force + table["normal_force"][:, None] * normal
    assert np.linalg.norm(friction, axis=1) == pytest.approx(table["tangential_force"])
    assert np.linalg.norm(friction.sum(axis=0)) == pytest.approx(contact["tangential_force"])
    assert contact["tangential_force"] < 0.9 * table["tangential_force"].sum()
    assert np.linalg.norm(slip, axis=1) == pytest.approx(table["slip"]) and table["slip"].any()
    assert (friction * slip).sum() < 0.0  # friction on the first body acts against its slip
    assert table["normal_stress"] == pytest.approx(table["normal_force"] / table["area"])
    assert results.summary["units"] == {
        "length": "m",
        "stress": "Pa",
        "force": "N",
        "moment": "N·m",
        "energy": "J",
    }
    for k, axis in enumerate("xyz"):
        assert results.steps[f"force_{axis}"] == contact["force"][k]
        assert results.steps[f"moment_{axis}"] == contact["moment"][k]
    with open(tmp_path / "steps.csv", encoding="utf-8") as file:
        assert next(csv.reader(file)) == [
            "time",
            "contact",
            *(f"{what}_{axis}" for what in ("force", "moment") for axis in "xyz"),
            "normal_force",
            "tangential_force",
            "open",
            "slip",
            "stick",
            "dissipated",
            "utilisation",
        ]


@pytest.mark.parametrize("order", [1, 2])
def test_meshio_and_paraview_read_solids(tmp_path, order):
    """meshio.read takes the tetrahedra and their tensors; contacts are surfaces of triangles, with vectors."""
    table = stacked(tmp_path, order, error=True).contacts["upper-lower"]
    mesh = meshio.read(tmp_path / "result.xdmf")
    assert [cells.type for cells in mesh.cells] == [{1: "tetra", 2: "tetra10"}[order]]
    upper = made_up_solids.fields(
        made_up_solids.box((0.0, 0.0, 1.0), divisions=(6, 2, 2), order=order)
    )
    own = mesh.cell_data["body"][0] == 0
    assert np.array_equal(mesh.points[mesh.cells[0].data[own]], upper.points[upper.triangles])
    assert np.array_equal(mesh.cell_data["stress"][0][own], upper.stress[:, [0, 3, 5, 1, 4, 2]])
    assert np.array_equal(mesh.point_data["displacement"][: len(upper.points)], upper.displacement)
    (grid,) = made_up.named_grids(tmp_path)["upper-lower"]
    a, b, c = grid["Geometry"][grid["Topology"]].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(3.0)
    assert np.linalg.norm(grid["friction_vector"], axis=1) == pytest.approx(grid["friction"])
    assert np.array_equal(grid["slip_vector"], vectors(table, "slip_x", "slip_y", "slip_z"))
    for field, column in {
        "pressure": "normal_stress",
        "friction": "tangential_stress",
        "gap": "gap",
        "slip": "slip",
        "slip_total": "slip_total",
        "utilisation": "utilisation",
    }.items():
        assert np.array_equal(grid[field], table[column]), field


def test_load_steps_of_solids_are_kept(tmp_path):
    """contact_NAME_legs.csv has the vectors of each leg, as contact_NAME.csv has them of the last one; forces of open
    nodes are 0, without a sign."""
    results = stacked(tmp_path, times=(1.0, 2.0))
    legs, table = results.legs["upper-lower"], results.contacts["upper-lower"]
    last = legs["time"] == 2.0
    for column in set(legs) & set(table):
        assert np.array_equal(legs[column][last], table[column]), column
    assert legs["force_z"][~last] == pytest.approx(0.5 * table["force_z"])
    for columns in (table, legs):
        vector = vectors(columns, *COLUMNS[15:21])
        assert not vector[columns["status"] == "open", :3].any()
        assert not np.signbit(vector[vector == 0.0]).any()
