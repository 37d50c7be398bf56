"""contact_NAME.vtu: what a contact covers, to its true outline."""

import meshio
import numpy as np
import pytest
from scenes import FLOOR, Run, certified, pinched_blocks, rectangle, run_here, write_scene
from scipy import sparse
from solid_scenes import box

from ddmpi.interface.interface import Lines
from ddmpi.mesh.elements import facet_measures
from ddmpi.results.fields import by_kind, contact_fields, drawn_facets, shared_out
from ddmpi.results.tables import write_contact
from ddmpi.results.xdmf import write_surface
from ddmpi.surface.outline import Outline


def surface(answer, name: str, folder) -> tuple[np.ndarray, np.ndarray, np.ndarray, object]:
    """Points and cells of the contact's file, the measures of its cells, and its state."""
    state = answer.contacts[name]
    write_surface(folder, name, contact_fields(state))
    mesh = meshio.read(folder / f"contact_{name}.vtu")
    at, cells = mesh.points[:, : state.interface.dimension], mesh.cells[0].data
    return mesh, cells, facet_measures(at[cells], state.interface.axisymmetric), state


@pytest.mark.parametrize("order", [1, 2])
def test_a_face_that_ends_within_facets_is_drawn_as_it_is(tmp_path, order):
    """A block covers facets of a wider base partly: the surface is its face, with values between those of the rows."""
    answer = certified(
        {
            "body": [
                box(
                    "block",
                    (0.31, 0.42, 0),
                    (1.0, 0.9, 0.5),
                    (3, 3, 2),
                    order=order,
                    clamp=[{"on": "top", "x": 0.0, "y": 0.0, "z": -1e-4}],
                ),
                box("base", (0, 0, -0.5), (2, 2, 0.5), (4, 4, 2), order=order, clamp=["bottom"]),
            ],
            "contact": [
                {
                    "name": "foot",
                    "bodies": ["block", "base"],
                    "on": ["bottom", "top"],
                    "slave": "base",
                    "friction": {"law": "coulomb", "coefficient": 0.3},
                }
            ],
        }
    )
    mesh, cells, areas, state = surface(answer, "foot", tmp_path)
    assert areas.sum() == pytest.approx(
        0.9, rel=1e-9
    ) and state.interface.area.sum() == pytest.approx(0.9, rel=1e-9)
    used = mesh.points[np.unique(cells)]
    assert used.min(axis=0) == pytest.approx((0.31, 0.42, 0.0)) and used.max(
        axis=0
    ) == pytest.approx((1.31, 1.32, 0.0))
    pressure = mesh.point_data["pressure"]
    assert (
        state.pressure.min() - 1.0 <= pressure.min()
        and pressure.max() <= state.pressure.max() + 1.0
    )
    assert (areas * pressure[cells].mean(axis=1)).sum() == pytest.approx(
        state.normal_force.sum(), rel=0.03
    )
    assert set(mesh.point_data["status"]) <= {0, 1, 2}
    # The lines, nodes that share rows at the rim, have the contact's moment.
    write_contact(tmp_path, "foot", state)
    lines = Run(0, "", "", tmp_path).table("contact_foot.csv")
    at, force = (
        np.column_stack([lines[f"{what}{axis}"] for axis in "xyz"]) for what in ("", "force_")
    )
    assert np.cross(at, force).sum(axis=0) == pytest.approx(state.moment, abs=1e-3)


def test_cells_of_clamped_nodes_alone_are_left_out(tmp_path):
    """Nodes that both bodies clamp bear no row. A cell with one row has its value everywhere; one with none is none."""
    clamp = [{"on": "left", "x": 0.0, "y": 0.0, "z": 0.0}]
    answer = certified(
        {
            "body": [
                box(
                    "upper",
                    (0, 0, 1),
                    (2, 1, 1),
                    (4, 2, 2),
                    clamp=clamp,
                    traction=[{"on": "top", "value": [0.0, 0.0, -1e6]}],
                ),
                box("lower", (0, 0, 0), (2, 1, 1), (4, 2, 2), clamp=[*clamp, "bottom"]),
            ],
            "contact": [{"name": "seam", "bodies": ["upper", "lower"], "on": ["bottom", "top"]}],
        }
    )
    mesh, _, areas, state = surface(answer, "seam", tmp_path)
    assert areas.sum() == pytest.approx(2.0) and state.interface.xy[:, 0].min() > 0.4
    at_wall = mesh.points[:, 0] == 0.0
    assert at_wall.sum() == 3 and (mesh.point_data["pressure"][at_wall] > 0.0).all()


@pytest.mark.parametrize("order", [1, 2])
def test_a_line_ends_where_the_other_side_does(tmp_path, order):
    """In the plane as well: a punch ends within a facet of the base, the slave."""
    answer = certified(
        {
            "body": [
                rectangle(
                    "punch",
                    (0.33, 1.0),
                    (1.0, 0.5),
                    (5, 3),
                    order,
                    clamp=[{"on": "top", "x": 0.0, "y": -1e-4}],
                ),
                rectangle("base", (0.0, 0.0), (2.0, 1.0), (6, 4), order, clamp=["bottom"]),
            ],
            "contact": [
                {
                    "name": "foot",
                    "bodies": ["punch", "base"],
                    "on": ["bottom", "top"],
                    "slave": "base",
                }
            ],
        }
    )
    mesh, cells, lengths, _ = surface(answer, "foot", tmp_path)
    assert lengths.sum() == pytest.approx(1.0, rel=1e-9)
    assert np.ptp(mesh.points[np.unique(cells), 0]) == pytest.approx(1.0, rel=1e-9)


def test_arcs_have_their_length_in_straight_cells(tmp_path):
    """Cells on curved facets are straight and measure as much as the arcs; their corners hardly leave these."""

    def half(name: str, radii: list[float], n: int, **more) -> dict:
        return {
            "name": name,
            "material": {"young": 1e9, "poisson": 0.3},
            "mesh": {
                "shape": "annulus",
                "center": [0.0, 0.0],
                "radii": radii,
                "angles": [0, 180],
                "divisions": [n, 2],
                "order": 2,
            },
            "clamp": [{"on": side, "y": 0.0} for side in ("start", "end")],
        } | more

    answer = certified(
        {
            "body": [half("tube", [1.0, 1.5], 9), half("core", [0.5, 1.0], 7)],
            "contact": [
                {"name": "fit", "bodies": ["tube", "core"], "on": ["inner", "outer"], "gap": -1e-4}
            ],
        },
        **{"method.tolerance": 1e-8},
    )
    mesh, _, lengths, state = surface(answer, "fit", tmp_path)
    assert lengths.sum() == pytest.approx(state.interface.area.sum(), rel=1e-9)
    assert np.linalg.norm(mesh.points, axis=1) == pytest.approx(1.0, abs=0.01)
    assert mesh.point_data["pressure"] == pytest.approx(state.pressure.mean(), rel=0.1)


def solid_scene(order: int) -> dict:
    """A block that covers facets of a wider base partly, pressed and pushed aside."""
    block = box("block", (0.31, 0.42, 0), (1.0, 0.9, 0.5), (3, 3, 2), order=order)
    block["clamp"] = [{"on": "top", "x": 1e-5, "y": 0.0, "z": -1e-4}]
    base = box("base", (0, 0, -0.5), (2, 2, 0.5), (4, 4, 2), order=order, clamp=["bottom"])
    contact = {"name": "foot", "bodies": ["block", "base"], "on": ["bottom", "top"]}
    return {
        "body": [block, base],
        "contact": [contact | {"friction": {"law": "coulomb", "coefficient": 0.3}}],
    }


def plane_scene(order: int, slave: str) -> dict:
    """A block that ends within facets of a wider one, either side as the slave."""
    upper = rectangle("upper", (0.37, 1.0), (1.3, 1.0), (7, 3))
    upper["clamp"] = [{"on": "top", "x": 1e-5, "y": -1e-4}]
    lower = rectangle("lower", (0.0, 0.0), (2.0, 1.0), (9, 4), clamp=["bottom"])
    for body in (upper, lower):
        body["mesh"]["order"] = order
    contact = {"name": "foot", "bodies": ["upper", "lower"], "on": ["bottom", "top"]}
    contact |= {"slave": slave, "friction": {"law": "coulomb", "coefficient": 0.3}}
    return {"body": [upper, lower], "contact": [contact]}


def ring_scene(order: int) -> dict:
    """A ring around an axis on a rigid floor."""
    ring = rectangle("ring", (1.0, 0.0), (0.5, 0.5), (4, 3))
    ring["mesh"]["order"] = order
    ring["traction"] = [{"on": "top", "pressure": 1e6}]
    contact = {"name": "foot", "bodies": ["ring", "floor"], "on": ["bottom"]}
    return {"axisymmetric": True, "body": [ring], "rigid": [FLOOR], "contact": [contact]}


SUMMED = {
    **{f"solid {order}": solid_scene(order) for order in (1, 2)},
    **{
        f"plane {order}, {slave}": plane_scene(order, slave)
        for order in (1, 2)
        for slave in ("upper", "lower")
    },
    **{f"ring {order}": ring_scene(order) for order in (1, 2)},
}


@pytest.mark.every(3)
@pytest.mark.parametrize("scene", SUMMED.values(), ids=SUMMED)
def test_forces_at_the_points_add_up_to_those_of_the_summary(scene, tmp_path):
    """To rounding, where the integral of the interpolated pressure is about the normal force."""
    answer = certified(scene)
    mesh, cells, areas, state = surface(answer, "foot", tmp_path)
    told, d = answer.summary["contacts"]["foot"], state.interface.dimension
    size = abs(told["normal_force"])
    assert mesh.point_data["normal_force"].sum() == pytest.approx(told["normal_force"], rel=1e-9)
    assert mesh.point_data["force"].sum(axis=0)[:d] == pytest.approx(told["force"], abs=1e-9 * size)
    integral = (areas * mesh.point_data["pressure"][cells].mean(axis=1)).sum()
    assert integral == pytest.approx(size, rel=0.1)
    # where: the moment of the forces at the points is nearly that of the nodes
    if d == 3:
        moment = np.cross(mesh.points, mesh.point_data["force"]).sum(axis=0)
        assert moment == pytest.approx(told["moment"], abs=0.05 * np.abs(told["moment"]).max())


def test_forces_at_the_points_of_earlier_load_steps_add_up_too(tmp_path):
    """In result.h5, by the steps' resultants."""
    import h5py

    scene = pinched_blocks(4) | {
        "history": {"press": {"times": [0.0, 1.0, 2.0], "factors": [0.0, 1.0, 0.5]}},
        "time": {"points": [1.0, 2.0], "steps": 1},
    }
    for body in scene["body"]:
        for load in body.get("traction", []):
            load["history"] = "press"
    run = run_here(write_scene(scene, tmp_path / "s.toml"), tmp_path / "out", "--no-figures")
    assert run.code == 0, run.output
    first, last = run.summary["steps"]
    with h5py.File(run.folder / "result.h5", "r") as file:
        for group, step in ((file["step_000000"], first), (file, last)):
            told, surfaces = step["contacts"]["upper-lower"], group["surfaces"]
            size = told["normal_force"]
            assert surfaces["normal_force"][()].sum() == pytest.approx(size, rel=1e-9)
            force = surfaces["force"][()].sum(axis=0)
            assert force == pytest.approx([*told["force"], 0.0], abs=1e-9 * size)


@pytest.mark.parametrize(("axisymmetric", "first"), [(True, [[0, 1]]), (False, [])])
def test_a_facet_at_the_axis_is_drawn_though_a_node_has_no_area(axisymmetric, first):
    """Elsewhere one whose nodes share a row, one of them with next to no length, is left out."""
    xy = np.array([[0.0, 0.3], [0.1, 0.3], [0.2, 0.3]])
    lines = Lines(np.array([0, 0, 1]), xy, np.array([1e-9, 0.1, 0.1]), np.array([[0, 1], [1, 2]]))
    assert drawn_facets(lines, axisymmetric).tolist() == [*first, [1, 2]]


def test_cells_of_several_kinds_among_each_other():
    """Rows of triangles and quadrilaterals, and of tetrahedra and bricks, are filled up by −1."""
    mixed = np.array([[0, 1, 2, -1], [2, 3, 4, 5], [5, 6, 0, -1]])
    assert [(some.tolist(), own.tolist()) for _, some, own in by_kind(mixed, 2)] == [
        ([0, 2], [[0, 1, 2], [5, 6, 0]]),
        ([1], [[2, 3, 4, 5]]),
    ]
    filled = np.vstack([np.arange(8), [*range(4), -1, -1, -1, -1]])
    assert [own.shape for _, _, own in by_kind(filled, 3)] == [(1, 4), (1, 8)]


def test_forces_go_to_points_by_share_and_measure():
    """Of a row with two points of unlike cells, of one with a negative share, and of one whose point is of no cell."""
    xy, cells = (
        np.array([[0.0, 0.0], [1.0, 0.0], [4.0, 0.0], [9.0, 0.0]]),
        np.array([[0, 1], [1, 2]]),
    )
    shares = np.array([[1.0, 0.0, 0.0], [0.5, 0.5, 0.0], [-0.25, 1.25, 0.0], [0.0, 0.0, 1.0]])
    forces = np.array([[2.0, -6.0], [3.0, 1.0], [5.0, 7.0]])
    found = shared_out(Outline(xy, cells, sparse.csr_matrix(shares)), forces)
    # lengths of the cells at the points are 1, 4, 3
    weights = np.array([[1.0, 0.0, 0.0], [2.0, 2.0, 0.0], [0.0, 3.75, 0.0], [0.0, 0.0, 1.0]])
    assert found == pytest.approx(weights / weights.sum(axis=0) @ forces, rel=1e-12)
