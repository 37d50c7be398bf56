"""Generated shapes: quadrilaterals and annuli against closed forms, and against each other where they meet."""

import numpy as np
import pytest

from ddmpi.judge.accuracy import refine_scene
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh, signed_measures
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import BodySpec, Material, MeshSpec
from ddmpi.scene.reader import read_scene

SLANTED = ((0.1, -0.2), (3.0, 0.3), (2.5, 1.7), (-0.4, 1.1))
NAMES = ("bottom", "right", "top", "left")


def mesh_of(order: int = 1, **keys) -> Mesh:
    return build_mesh(BodySpec(name="body", mesh=MeshSpec(order=order, **keys),
                               material=Material(young=1.0, poisson=0.3)))


def quadrilateral(divisions, corners=SLANTED, order=1) -> Mesh:
    return mesh_of(order, shape="quadrilateral", corners=corners, divisions=divisions)


def annulus(divisions, angles=(0.0, 90.0), radii=(0.5, 1.25), center=(0.0, 0.0), order=1) -> Mesh:
    return mesh_of(order, shape="annulus", center=center, radii=radii, angles=angles, divisions=divisions)


def areas(mesh: Mesh) -> np.ndarray:
    return signed_measures(mesh.points, mesh.triangles)


def lengths(mesh: Mesh, group: str) -> np.ndarray:
    ends = mesh.points[mesh.groups[group][:, :2]]
    return np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)


def check_boundary(mesh: Mesh) -> None:
    """The groups cover the boundary once, and the body lies to the left of their edges."""
    t = mesh.triangles
    around = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    whole = {tuple(edge) for edge in around.tolist()}
    boundary = {edge for edge in whole if edge[::-1] not in whole}
    edges = [edge for group in mesh.groups.values() for edge in map(tuple, group[:, :2].tolist())]
    assert len(edges) == len(set(edges)) and set(edges) == boundary
    for name, group in mesh.groups.items():
        assert np.array_equal(mesh.facets(name).nodes, group)


# Quadrilaterals


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("divisions", [(1, 1), (1, 3), (6, 4)])
def test_quadrilateral_has_area_and_lengths_of_its_corners(divisions, order):
    """A quadrilateral has the area and sides of its corners, and its groups go around counter-clockwise."""
    mesh, corners = quadrilateral(divisions, order=order), np.array(SLANTED)
    x, y = corners.T
    shoelace = (x @ np.roll(y, -1) - y @ np.roll(x, -1)) / 2
    assert areas(mesh).sum() == pytest.approx(shoelace, rel=1e-14)
    assert np.all(areas(mesh) > 0)
    assert tuple(mesh.groups) == NAMES
    for k, name in enumerate(NAMES):
        start, end = corners[k], corners[(k + 1) % 4]
        parts = divisions[k % 2]
        assert lengths(mesh, name) == pytest.approx(np.full(parts, np.linalg.norm(end - start) / parts), rel=1e-13)
        assert np.array_equal(mesh.points[mesh.groups[name][[0, -1], [0, 1]]], [start, end])
    check_boundary(mesh)


def test_quadrilateral_is_the_bilinear_map_of_a_grid():
    """Nodes lie at equal parameters of the bilinear map; cells are cut from their first to their third corner."""
    nx, ny = 5, 3
    mesh, grid = quadrilateral((nx, ny)), generate_rectangle(
        MeshSpec(shape="rectangle", size=(1.0, 1.0), divisions=(nx, ny)))
    (a, b, c, d), (s, t) = np.array(SLANTED), grid.points.T[:, :, None]
    expected = (1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d
    assert mesh.points == pytest.approx(expected, rel=0, abs=1e-15)
    assert np.array_equal(mesh.triangles, grid.triangles)
    assert {name: edges.tolist() for name, edges in mesh.groups.items()} == \
        {name: edges.tolist() for name, edges in grid.groups.items()}


# Annuli


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("angles", [(0.0, 90.0), (-30.0, 47.0), (0.0, 360.0), (100.0, 460.0), (0.0, 359.0)])
def test_annulus_has_area_and_lengths_of_its_polygons(angles, order):
    """The corners of an annulus have the area of the sectors of two regular polygons, chords and radii as sides."""
    around, across, inner, outer = 14, 3, 0.5, 1.25
    mesh = annulus((around, across), angles, (inner, outer), (3.0, -1.0), order)
    step = np.radians(angles[1] - angles[0]) / around
    assert areas(mesh).sum() == pytest.approx(around * np.sin(step) * (outer**2 - inner**2) / 2, rel=1e-13)
    assert np.all(areas(mesh) > 0)
    closed = angles[1] - angles[0] == 360
    assert set(mesh.groups) == {"inner", "outer"} | ({"start", "end"} if not closed else set())
    for name, radius in (("inner", inner), ("outer", outer)):
        assert lengths(mesh, name) == pytest.approx(np.full(around, 2 * radius * np.sin(step / 2)), rel=1e-13)
        ends = mesh.points[mesh.groups[name][:, :2]] - (3.0, -1.0)
        assert np.linalg.norm(ends, axis=2) == pytest.approx(np.full((around, 2), radius), rel=1e-14)
    for name in set(mesh.groups) - {"inner", "outer"}:
        assert lengths(mesh, name) == pytest.approx(np.full(across, (outer - inner) / across), rel=1e-13)
    check_boundary(mesh)


def test_ring_is_closed_in_spite_of_rounding():
    """Angles that are 360 degrees apart but for rounding close the ring."""
    for end in np.nextafter(360.0, 0.0), np.nextafter(360.0, 720.0):
        assert set(annulus((12, 2), (0.0, float(end))).groups) == {"inner", "outer"}


def test_annulus_is_exact_on_the_axes_and_symmetric():
    """Nodes at multiples of 90 degrees lie on the axes, and a quarter turn of a ring gives the same nodes."""
    points = annulus((32, 2), (0.0, 360.0)).points
    turned = np.column_stack([-points[:, 1], points[:, 0]])
    assert {tuple(p) for p in points + 0.0} == {tuple(p) for p in turned + 0.0}
    assert np.count_nonzero(points == 0.0) == 4 * 3


# Order 2 and refinement


SCENE = """
[[body]]
name = "plate"
mesh = { shape = "quadrilateral", corners = [[-1, 0], [1, 0], [1.5, 1], [-1.5, 1]], divisions = [3, 2] }
material = { young = 2e11, poisson = 0.3 }

[[body]]
name = "ring"
mesh = { shape = "annulus", center = [0, 2], radii = [0.5, 1], angles = [0, 360], divisions = [12, 2] }
material = { young = 2e11, poisson = 0.3 }

[[contact]]
bodies = ["ring", "plate"]
on = ["outer", "top"]
"""


def test_accuracy_targets_refine_all_shapes():
    """An accuracy target divides quadrilaterals and annuli as it divides rectangles."""
    fine = refine_scene(read_scene("case.toml", SCENE), 3)
    assert [body.mesh.divisions for body in fine.body] == [(9, 6), (36, 6)]
    coarse = [build_mesh(body) for body in read_scene("case.toml", SCENE).body]
    for body, mesh in zip(fine.body, coarse, strict=True):
        finer = {tuple(p) for p in build_mesh(body).points.round(12) + 0.0}
        assert {tuple(p) for p in mesh.points.round(12) + 0.0} <= finer
