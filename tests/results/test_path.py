"""Values along a straight line through the bodies: `ddmpi path`."""

import csv

import made_up
import numpy as np
import pytest
from scenes import call

from ddmpi.errors import InputError
from ddmpi.results.fields import Fields, write_fields
from ddmpi.results.histories import along
from ddmpi.results.tables import PATH, Results, read_fields, read_results, write_path


def results(tmp_path, meshes, displacement, stress) -> Results:
    """Of some bodies, with a displacement and a nodal stress that are functions of the place."""
    write_fields(
        tmp_path,
        {
            number: Fields(
                mesh.points,
                mesh.triangles,
                displacement(mesh.points),
                np.zeros((len(mesh.triangles), 4)),
                nodal_stress=stress(mesh.points),
            )
            for number, mesh in enumerate(meshes)
        },
    )
    import h5py

    with h5py.File(tmp_path / "result.h5") as file:
        fields = read_fields(file)
    return Results(
        {"bodies": {f"body {k}": {} for k in range(len(meshes))}}, {}, {}, {}, {}, fields
    )


def quadratic(at: np.ndarray) -> np.ndarray:
    x, y = at.T
    return np.column_stack([1.0 + x * y - y**2, x**2 - 3.0 * y])


def tensors(at: np.ndarray) -> np.ndarray:
    x, y = at.T
    return np.column_stack([x, 2.0 * y, 0.5 * x * y, y**2 - x])


def test_quadratic_elements_are_exact_and_bodies_that_touch_have_a_line_each(tmp_path):
    """Fields of degree two along a skew line through two stacked blocks, which also leaves them."""
    meshes = [made_up.block(origin, (6, 2), 2) for origin in made_up.STACK.values()]
    found = results(tmp_path, meshes, quadratic, tensors)
    (upper, lower), (left, high) = (
        (mesh.points.min(axis=0) for mesh in meshes),
        meshes[0].points.max(axis=0),
    )
    left = meshes[0].points[:, 0].min() + 0.3
    start, end = np.array([left, lower[1]]), np.array([left + 0.2, 2.0 * high - lower[1]])
    table = along(found, start, end, 1 + 4 * round((high - lower[1]) / (high - upper[1])))
    at = np.column_stack([table["x"], table["y"]])
    assert table["distance"] == pytest.approx(np.linalg.norm(at - start, axis=1))
    between = np.isclose(at[:, 1], upper[1])
    assert table["body"][between].tolist() == ["body 0", "body 1"] and at[
        :, 1
    ].max() == pytest.approx(high)
    assert ((table["body"] == "body 0") == (at[:, 1] > upper[1] + 1e-9))[~between].all()
    u = np.column_stack([table["displacement_x"], table["displacement_y"]])
    assert u == pytest.approx(quadratic(at), abs=1e-12)
    sigma = np.column_stack([table[f"stress_{each}"] for each in ("xx", "yy", "zz", "xy")])
    assert sigma == pytest.approx(tensors(at), abs=1e-12)
    assert sum(table[f"principal_{k}"] for k in (1, 2, 3)) == pytest.approx(
        sigma[:, :3].sum(axis=1), abs=1e-12
    )
    assert (
        (table["principal_1"] >= table["principal_2"]).all()
        and "z" not in table
        and set(table) < set(PATH)
    )


@pytest.mark.parametrize("order", [1, 2])
def test_a_line_ends_on_a_curved_side(tmp_path, order):
    """Both ends of a radius between two nodes of the circles count as inside, whatever lies between arc and chord."""
    found = results(tmp_path, [made_up.ring((1.0, 2.0), 24, order)], quadratic, tensors)
    way = np.array([np.cos(0.131), np.sin(0.131)])
    table = along(found, way, 2.0 * way, 5)
    assert table["distance"] == pytest.approx([0.0, 0.25, 0.5, 0.75, 1.0])
    at = np.column_stack([table["x"], table["y"]])
    assert np.column_stack([table["displacement_x"], table["displacement_y"]]) == pytest.approx(
        quadratic(at), abs={1: 0.1, 2: 1e-3}[order]
    )


@pytest.mark.parametrize(
    "start, end, number, words",
    [
        ((50.0, 50.0), (60.0, 50.0), 5, r"from \(50, 50\) to \(60, 50\) meets no body"),
        ((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 5, "2 coordinates each"),
        ((0.0, 0.0), (0.0, 0.0), 5, "two different ends"),
        ((0.0, 0.0), (float("nan"), 0.0), 5, "two different ends"),
        ((0.0, 0.0), (1.0, 0.0), 1, "and 2 to"),
        ((0.0, 0.0), (1.0, 0.0), 100_001, "100000 points"),
        ((1e308, 0.0), (-1e308, 0.0), 5, "two different ends"),
    ],
)
def test_lines_that_cannot_be_followed_are_refused(tmp_path, start, end, number, words):
    found = results(tmp_path, [made_up.block()], quadratic, tensors)
    with pytest.raises(InputError, match=words):
        along(found, start, end, number)


def test_the_command_writes_a_table_and_overwrites_no_other_file(tmp_path):
    """`ddmpi path` takes points with a minus, says where the table is, and writes it anew; exit code 2 elsewhere."""
    made_up.results(tmp_path)
    low = read_results(tmp_path).points.min(axis=0)
    ends = ["--from", f"-1,{low[1] + 0.1:g}", "--to", f"4,{low[1] + 0.1:g}"]
    for points in ("11", "26"):
        run = call("path", str(tmp_path), *ends, "--points", points)
        assert run.code == 0 and run.stdout.strip() == str(tmp_path / "path.csv"), run.output
    with open(tmp_path / "path.csv", encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    assert (
        {row["body"] for row in rows} == {"lower"}
        and len(rows) < 26
        and float(rows[0]["von_mises"]) > 0.0
    )
    (tmp_path / "mine.csv").write_text("x,y\n")
    words = r"mine.csv: is there already, and no table of a path; name another file"
    with pytest.raises(InputError, match=words):
        write_path(tmp_path / "mine.csv", {"distance": np.zeros(1)})
    refused = call("path", str(tmp_path), "--from", "0;1", "--to", "1,1")
    assert refused.code == 2 and "'0;1' is no point" in refused.output
