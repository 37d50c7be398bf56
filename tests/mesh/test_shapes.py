"""Generated shapes: quadrilaterals, annuli and hexahedra against closed forms."""

import numpy as np
import pytest

from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh, signed_measures
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import BodySpec, Material, MeshSpec

SLANTED = ((0.1, -0.2), (3.0, 0.3), (2.5, 1.7), (-0.4, 1.1))
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


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("angles", [(-30.0, 47.0), (100.0, 460.0), (0.0, 359.0)])
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


# In space

CORNERS = ((0, 0, 0), (3, 0, 0), (3, 1, 0), (0, 1, 0), (0, 0, 2), (3, 0, 2), (3, 1, 2), (0, 1, 2))

LEANING = ((0, 0, 0), (3, .1, -.2), (3.3, 1.2, 0), (-.1, 1, .1),
           (.2, .1, 1.9), (3.1, 0, 2.2), (2.9, 1.3, 2), (0, .9, 2.1))


def box(divisions=(3, 2, 4), order=1, size=(3.0, 1.0, 2.0), **keys) -> Mesh:
    return mesh_of(order, shape="box", size=size, divisions=divisions, **keys)


def hexahedron(divisions=(3, 2, 4), corners=LEANING, order=1) -> Mesh:
    corners = tuple(tuple(map(float, corner)) for corner in corners)
    return mesh_of(order, shape="hexahedron", corners=corners, divisions=divisions)


def facets(mesh: Mesh, group: str) -> set:
    """The facets of a group as sets of the points of their nodes."""
    return {frozenset(map(tuple, facet)) for facet in mesh.points[mesh.groups[group]].tolist()}


def test_hexahedron_is_the_trilinear_map_of_a_grid():
    """Nodes lie at equal parameters; those at corners are the corners exactly."""
    mesh, grid = hexahedron(), box(size=(1.0, 1.0, 1.0))
    (x, y, z), at = grid.points.T[:, :, None], np.array(LEANING)
    weights = [(x if c[0] else 1 - x) * (y if c[1] else 1 - y) * (z if c[2] else 1 - z) for c in CORNERS]
    assert mesh.points == pytest.approx(sum(w * a for w, a in zip(weights, at, strict=True)), rel=0, abs=1e-15)
    assert {tuple(map(float, corner)) for corner in LEANING} <= set(map(tuple, mesh.points.tolist()))
    assert (signed_measures(mesh.points, mesh.triangles) > 0).all() and np.array_equal(mesh.triangles, grid.triangles)
    assert all(np.array_equal(mesh.groups[name], grid.groups[name]) for name in grid.groups)


def test_hexahedra_share_the_nodes_of_a_common_face():
    """Two hexahedra with a face in common, of equal divisions, have the same facets on it."""
    below = [(x, y, z - 2.0 - 0.1 * x) for x, y, z in LEANING[:4]]
    assert facets(hexahedron(), "bottom") == facets(hexahedron(corners=(*below, *LEANING[:4])), "top")


def test_too_many_cells_are_refused():
    """A typing error in divisions is found before the memory is gone."""
    with pytest.raises(InputError, match=r"^body\.body\.mesh\.divisions: 6e\+27 tetrahedra need more than"):
        box((10**9, 10**9, 10**9))


def test_a_box_without_volume_is_refused():
    """Where a box is so far away that its cells vanish in double precision, the message says so."""
    with pytest.raises(InputError, match=r"^body\.body\.mesh: its tetrahedra have no volume in double precision"):
        box(origin=(1e30, 0.0, 0.0))
