"""Files and pictures of solids: vectors in x, y, z, areas, tetrahedra, surfaces."""

import csv
import dataclasses
import itertools
import json

import made_up
import made_up_solids
import meshio
import numpy as np
import pytest
from documented import undocumented
from matplotlib import image

from ddmpi.cli.report import write_report
from ddmpi.results import frame
from ddmpi.results.fields import skin
from ddmpi.results.histories import animate
from ddmpi.results.pictures import draw_all
from ddmpi.results.solids import draw_contact, flatten, rigid_surfaces
from ddmpi.results.tables import read_results

COLUMNS = ["x", "y", "z", "nx", "ny", "nz", "area", "normal_force", "tangential_force", "normal_stress",
           "tangential_stress", "gap", "slip", "slip_total", "status", "force_x", "force_y", "force_z", "slip_x",
           "slip_y", "slip_z"]


def vectors(table, *names: str) -> np.ndarray:
    return np.column_stack([table[name] for name in names])


@pytest.mark.parametrize("order", [1, 2])
def test_tables_have_vectors_in_space(tmp_path, order):
    """contact_NAME.csv has the columns of solids; forces, moments and slips follow from its vectors."""
    bodies, contacts = made_up_solids.stack(order)
    summary = made_up_solids.results(tmp_path, bodies, contacts)
    with open(tmp_path / "contact_upper-lower.csv", encoding="utf-8") as file:
        assert next(csv.reader(file)) == COLUMNS
    results = read_results(tmp_path)
    assert not results.sides and results.dimension == 3
    table, contact = results.contacts["upper-lower"], summary["contacts"]["upper-lower"]
    at, normal, force, slip = (vectors(table, *names) for names in (
        COLUMNS[:3], COLUMNS[3:6], COLUMNS[15:18], COLUMNS[18:]))
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
    assert summary["units"] == {"length": "m", "stress": "Pa", "force": "N", "moment": "N·m", "energy": "J"}
    for k, axis in enumerate("xyz"):
        assert results.steps[f"force_{axis}"] == contact["force"][k]
        assert results.steps[f"moment_{axis}"] == contact["moment"][k]
    with open(tmp_path / "steps.csv", encoding="utf-8") as file:
        assert next(csv.reader(file)) == ["time", "contact", *(f"{what}_{axis}" for what in ("force", "moment")
                                                               for axis in "xyz"),
                                          "normal_force", "tangential_force", "open", "slip", "stick", "dissipated"]


@pytest.mark.parametrize("order", [1, 2])
def test_meshio_and_paraview_read_solids(tmp_path, order):
    """meshio.read takes the tetrahedra and their tensors; contacts are surfaces of triangles, with vectors."""
    bodies, contacts = made_up_solids.stack(order, divisions=(6, 2, 2))
    made_up_solids.results(tmp_path, bodies, contacts, error=True)
    mesh = meshio.read(tmp_path / "result.xdmf")
    assert [cells.type for cells in mesh.cells] == [{1: "tetra", 2: "tetra10"}[order]]
    upper = made_up_solids.fields(bodies["upper"])
    own = mesh.cell_data["body"][0] == 0
    assert np.array_equal(mesh.points[mesh.cells[0].data[own]], upper.points[upper.triangles])
    assert np.array_equal(mesh.cell_data["stress"][0][own], upper.stress[:, [0, 3, 5, 1, 4, 2]])
    assert np.array_equal(mesh.point_data["displacement"][:len(upper.points)], upper.displacement)
    (grid,) = made_up.named_grids(tmp_path)["upper-lower"]
    table = read_results(tmp_path).contacts["upper-lower"]
    a, b, c = grid["Geometry"][grid["Topology"]].transpose(1, 0, 2)
    assert np.linalg.norm(np.cross(b - a, c - a), axis=1).sum() / 2 == pytest.approx(3.0)
    assert np.linalg.norm(grid["friction_vector"], axis=1) == pytest.approx(grid["friction"])
    assert np.array_equal(grid["slip_vector"], vectors(table, "slip_x", "slip_y", "slip_z"))
    for field, column in {"pressure": "normal_stress", "friction": "tangential_stress", "gap": "gap", "slip": "slip",
                          "slip_total": "slip_total"}.items():
        assert np.array_equal(grid[field], table[column]), field


def test_load_steps_of_solids_are_kept(tmp_path):
    """contact_NAME_legs.csv has the vectors of each leg, as contact_NAME.csv has them of the last one."""
    bodies, contacts = made_up_solids.stack(divisions=(6, 2, 2))
    made_up_solids.results(tmp_path, bodies, contacts, times=(1.0, 2.0))
    results = read_results(tmp_path)
    legs, table = results.legs["upper-lower"], results.contacts["upper-lower"]
    last = legs["time"] == 2.0
    for column in set(legs) & set(table):
        assert np.array_equal(legs[column][last], table[column]), column
    assert legs["force_z"][~last] == pytest.approx(0.5 * table["force_z"])


@pytest.mark.parametrize("order", [1, 2])
def test_there_is_a_picture_of_everything(tmp_path, order):
    """Solids have the pictures that plane bodies have, and each shows something."""
    bodies, contacts = made_up_solids.stack(order, divisions=(6, 2, 2))
    made_up_solids.results(tmp_path, bodies, contacts, times=(1.0, 2.0), error=True)
    drawn = draw_all(tmp_path)
    assert undocumented(tmp_path) == []
    assert sorted(path.name for path in drawn) == ["bodies.png", "contact.png", "convergence.png", "error.png",
                                                   "steps.png"]
    for path in drawn:
        pixels = image.imread(path)
        inked = (pixels[..., :3] < 0.99).any(axis=2)
        assert min(pixels.shape[:2]) > 300 and 0.01 < inked.mean() < 0.99, path.name
    assert animate(read_results(tmp_path), tmp_path, "").exists()
    page = write_report(tmp_path).read_text(encoding="utf-8")
    assert all(f"{what} {axis}" in page for what in ("force", "moment", "reaction") for axis in "xyz")


def test_what_is_nearer_hides_what_is_behind(monkeypatch):
    """Every pixel shows the facet nearest to the eye, with the coordinates of its middle, in any order of facets."""
    rng = np.random.default_rng(4)
    corners = rng.uniform(0.0, 20.0, (40, 3, 3))
    edges = corners[:, 1:, :2] - corners[:, :1, :2]
    turned = np.linalg.det(edges) < 0.0
    corners[turned] = corners[turned][:, ::-1]
    monkeypatch.setattr(frame, "CHUNK", 500)
    face, weights, depth = frame.rasterise(corners, (20, 20))
    for row, column in itertools.product(range(20), range(20)):
        a = np.concatenate([corners[..., :2].transpose(0, 2, 1), np.ones((40, 1, 3))], axis=1)
        at = np.linalg.solve(a, np.tile([[column + 0.5], [row + 0.5], [1.0]], (40, 1, 1)))[..., 0]
        z = np.where((at >= 0.0).all(axis=1), (at * corners[..., 2]).sum(axis=1), -np.inf)
        assert depth[row, column] == pytest.approx(z.max())
        assert face[row, column] == (z.argmax() if np.isfinite(z.max()) else -1)
        if face[row, column] >= 0:
            assert weights[row, column] == pytest.approx(at[face[row, column]], abs=1e-9)


def test_edges_are_drawn_where_facets_meet_at_an_angle_and_are_seen():
    """Of a box nine edges are seen from a corner, in pieces as long as they are, and three are hidden."""
    mesh = made_up_solids.box(size=(1.0, 1.0, 1.0), divisions=(2, 2, 2))
    view, facets = frame.View(np.ones(3)), skin(mesh.triangles)[0]
    at = 200.0 * view.place(mesh.points)
    at[:, :2] -= at[:, :2].min(axis=0) - 2.0
    edges = at[frame.outlines(at, facets)]
    assert len(edges) == 24
    seen = np.cross(at[facets[:, 1]] - at[facets[:, 0]], at[facets[:, 2]] - at[facets[:, 0]])[:, 2] > 0.0
    depth = frame.rasterise(at[facets[seen]], np.ceil(at[:, 1::-1].max(axis=0)).astype(int) + 2)[2]
    lines = frame.unhidden(edges, depth)
    length = np.linalg.norm(200.0 * view.place(np.eye(3))[:, :2], axis=1).sum()
    assert np.linalg.norm(lines[:, 1] - lines[:, 0], axis=1).sum() == pytest.approx(3.0 * length, rel=0.03)


def flattened(mesh, group):
    face = made_up_solids.interface("a-b", mesh, group)
    table = {"area": face.area} | {name: column for names, columns in (("xyz", face.xy.T), (("nx", "ny", "nz"),
                                                                                            face.normal.T))
                                   for name, column in zip(names, columns, strict=True)}
    at, labels, along = flatten(table, face.facets)
    a, b, c = at.transpose(1, 0, 2)
    return at, labels, along, np.abs(np.linalg.det(np.stack([b - a, c - a], axis=1))).sum() / 2, face


def test_flat_contacts_are_drawn_in_their_coordinates():
    """A face of a box is drawn over the two coordinates that vary on it; an inclined one keeps its area."""
    mesh = made_up_solids.box((1.0, 2.0, 3.0), (3.0, 1.0, 2.0))
    for group, labels, low, high in (("bottom", ("x", "y"), (1, 2), (4, 3)), ("left", ("y", "z"), (2, 3), (3, 5)),
                                     ("back", ("x", "z"), (1, 3), (4, 5))):
        at, found, _, area, face = flattened(mesh, group)
        assert found == labels and area == pytest.approx(face.area.sum())
        assert at.min(axis=(0, 1)) == pytest.approx(low) and at.max(axis=(0, 1)) == pytest.approx(high)
    turn = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    *_, along, area, face = flattened(dataclasses.replace(mesh, points=mesh.points @ turn.T), "bottom")
    assert area == pytest.approx(face.area.sum()) and along[0] @ face.normal[0] == pytest.approx([0.0, 0.0], abs=1e-12)


def test_contacts_around_an_axis_are_unrolled():
    """A bore is as wide as its circumference, each facet once and whole; slip turns with it."""
    at, labels, along, area, face = flattened(made_up_solids.tube((0.5, 1.0), 2.0), "inner")
    assert labels == ("around the axis", "z") and area == pytest.approx(2.0 * np.pi * 0.5 * 2.0, rel=1e-9)
    assert np.ptp(at, axis=(0, 1)) == pytest.approx([np.pi, 2.0], rel=1e-6)
    assert np.ptp(at[..., 0], axis=1).max() < 0.2
    assert np.einsum("lcd,ld->lc", along, face.normal) == pytest.approx(0.0, abs=0.05)


@pytest.mark.parametrize("inside", [False, True])
def test_rigid_partners_are_drawn_where_bodies_may_touch_them(tmp_path, inside):
    """A part of a rigid surface around the contact, moved as the bodies are, and turned to them."""
    bodies = {"tube": made_up_solids.tube((0.5, 1.0), 2.0)}
    partner = {"shape": "cylinder", "name": "rod", "point": [0.0, 0.0, 0.0], "axis": [0.0, 0.0, 1.0],
               "radius": 1.1 if inside else 0.45, "inside": inside, "displacement": [0.1, 0.0, 0.0]}
    made_up_solids.results(tmp_path, bodies, {"tube-rod": ("tube", "outer" if inside else "inner")}, rigid=[partner])
    results = read_results(tmp_path)
    (drawn,) = rigid_surfaces(results, 2.0)
    off = drawn.at - (0.2, 0.0, 0.0)
    assert np.linalg.norm(off[:, :2], axis=1) == pytest.approx(partner["radius"])
    assert np.ptp(off[:, 2]) == pytest.approx(2.5)
    a, b, c = off[drawn.facets].transpose(1, 0, 2)
    outward = (np.cross(b - a, c - a) * (a + b + c) * (1.0, 1.0, 0.0)).sum(axis=1)
    assert (outward < 0.0).all() if inside else (outward > 0.0).all()
    assert "bodies.png" in [path.name for path in draw_all(tmp_path)]


def test_a_mechanism_of_solids_is_drawn(tmp_path):
    """Bodies move by velocity and turning about their centres, not by more than a tenth of the extent."""
    bodies, contacts = made_up_solids.stack(divisions=(6, 2, 2))
    made_up_solids.results(tmp_path, bodies, contacts)
    (tmp_path / "mechanism.json").write_text(json.dumps({
        "reason": "no equilibrium: upper turns", "imbalance": 0.1,
        "bodies": [{"name": "upper", "centre": [1.5, 0.5, 1.5], "velocity": [0.0, 0.2, 0.0, 0.0, 0.0, 0.6]}]}))
    (drawn,) = draw_all(tmp_path)
    assert drawn.name == "mechanism.png" and image.imread(drawn)[..., :3].std() > 0.05


def test_a_contact_without_friction_has_no_map_of_it(tmp_path):
    """Pressure, zones and gap are left."""
    bodies, contacts = made_up_solids.stack(divisions=(6, 2, 2))
    made_up_solids.results(tmp_path, bodies, contacts, friction=made_up.NoFriction())
    labels = [axes.get_ylabel() for axes in draw_contact(read_results(tmp_path), "upper-lower").axes]
    assert labels[3:] == ["pressure (MPa)", "gap (µm)"]
