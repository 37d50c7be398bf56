"""Generated shapes: quadrilaterals, annuli and hexahedra against closed forms."""

import numpy as np
import pytest

from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh, refuse_folded, signed_measures
from ddmpi.mesh.refine import bend
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import MeshSpec
from meshes import lengths, mesh_of

SLANTED = ((0.1, -0.2), (3.0, 0.3), (2.5, 1.7), (-0.4, 1.1))


def quadrilateral(divisions, corners=SLANTED, order=1) -> Mesh:
    return mesh_of(order, shape="quadrilateral", corners=corners, divisions=divisions)


def annulus(divisions, angles=(0.0, 90.0), radii=(0.5, 1.25), center=(0.0, 0.0), order=1) -> Mesh:
    return mesh_of(
        order, shape="annulus", center=center, radii=radii, angles=angles, divisions=divisions
    )


def areas(mesh: Mesh) -> np.ndarray:
    return signed_measures(mesh.points, mesh.triangles)


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
    mesh, grid = (
        quadrilateral((nx, ny)),
        generate_rectangle(MeshSpec(shape="rectangle", size=(1.0, 1.0), divisions=(nx, ny))),
    )
    (a, b, c, d), (s, t) = np.array(SLANTED), grid.points.T[:, :, None]
    expected = (1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d
    assert mesh.points == pytest.approx(expected, rel=0, abs=1e-15)
    assert np.array_equal(mesh.triangles, grid.triangles)
    assert {name: edges.tolist() for name, edges in mesh.groups.items()} == {
        name: edges.tolist() for name, edges in grid.groups.items()
    }


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("angles", [(-30.0, 47.0), (100.0, 460.0), (0.0, 359.0)])
def test_annulus_has_area_and_lengths_of_its_polygons(angles, order):
    """The corners of an annulus have the area of the sectors of two regular polygons, chords and radii as sides."""
    around, across, inner, outer = 14, 3, 0.5, 1.25
    mesh = annulus((around, across), angles, (inner, outer), (3.0, -1.0), order)
    step = np.radians(angles[1] - angles[0]) / around
    assert areas(mesh).sum() == pytest.approx(
        around * np.sin(step) * (outer**2 - inner**2) / 2, rel=1e-13
    )
    assert np.all(areas(mesh) > 0)
    ends = {"start", "end"} if angles[1] - angles[0] < 360.0 else set()
    assert mesh.groups.keys() == {"inner", "outer"} | ends
    for name, radius in (("inner", inner), ("outer", outer)):
        assert lengths(mesh, name) == pytest.approx(
            np.full(around, 2 * radius * np.sin(step / 2)), rel=1e-13
        )
        nodes = mesh.points[mesh.groups[name][:, :2]] - (3.0, -1.0)
        assert np.linalg.norm(nodes, axis=2) == pytest.approx(
            np.full((around, 2), radius), rel=1e-14
        )
    for name in ends:
        assert lengths(mesh, name) == pytest.approx(
            np.full(across, (outer - inner) / across), rel=1e-13
        )
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


@pytest.mark.parametrize("angles", [(-30.0, 47.0), (0.0, 360.0)])
def test_annulus_is_curved(angles):
    """The nodes of an annulus of order 2 lie on its circles, also where a ring closes; radial sides stay straight."""
    mesh = annulus((7, 3), angles, order=2)
    distance, inner, outer = np.linalg.norm(mesh.points, axis=1), 0.5, 1.25
    assert distance == pytest.approx(
        (outer - inner) / 6 * np.round((distance - inner) / (outer - inner) * 6) + inner, rel=1e-14
    )
    assert len(mesh.curved) == len(mesh.triangles)
    radial = (
        np.abs(
            np.ptp(distance[mesh.triangles[:, mesh.cell.edges[:, :2]]], axis=2)
            - (outer - inner) / 3
        )
        < 1e-12
    )
    bent = mesh.cell.bends(mesh.points[mesh.triangles]).any(axis=2)
    assert np.count_nonzero(~bent) == 3 * 7 * 2 and radial[~bent].all()
    assert mesh.measures().min() > 0.0
    span = np.radians(angles[1] - angles[0])
    assert mesh.measures().sum() == pytest.approx(
        span / 2 * (outer**2 - inner**2), rel=(span / 7) ** 4 / 400
    )


def test_coarse_rings_do_not_fold():
    """As few cells as a ring may have are mapped one to one, however thin or thick the ring is."""
    for around, angles in ((3, (0.0, 360.0)), (1, (0.0, 170.0))):
        for inner in (0.02, 0.5, 0.99):
            mesh = annulus((around, 2), angles, (inner, 1.0), order=2)
            assert len(mesh.curved) == len(mesh.triangles)


def test_folded_triangle_is_refused():
    """A triangle whose side is bent beyond its opposite corner is refused with its place."""
    bends = np.zeros((2, 3, 2))
    bends[0, 0] = (0.0, 0.6)  # the bottom, up into the lower triangle
    mesh = mesh_of(2, shape="rectangle", size=(1.0, 1.0), divisions=(1, 1))
    refuse_folded(bend(mesh, bends / 4), "mesh")
    with pytest.raises(
        InputError, match=r"body\.body\.mesh: the curved triangle at \(0\.\d+, 0\.\d+\) folds"
    ):
        refuse_folded(bend(mesh, bends), "body.body.mesh")


# In space

CORNERS = ((0, 0, 0), (3, 0, 0), (3, 1, 0), (0, 1, 0), (0, 0, 2), (3, 0, 2), (3, 1, 2), (0, 1, 2))

LEANING = (
    (0, 0, 0),
    (3, 0.1, -0.2),
    (3.3, 1.2, 0),
    (-0.1, 1, 0.1),
    (0.2, 0.1, 1.9),
    (3.1, 0, 2.2),
    (2.9, 1.3, 2),
    (0, 0.9, 2.1),
)


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
    weights = [
        (x if c[0] else 1 - x) * (y if c[1] else 1 - y) * (z if c[2] else 1 - z) for c in CORNERS
    ]
    assert mesh.points == pytest.approx(
        sum(w * a for w, a in zip(weights, at, strict=True)), rel=0, abs=1e-15
    )
    assert {tuple(map(float, corner)) for corner in LEANING} <= set(
        map(tuple, mesh.points.tolist())
    )
    assert (signed_measures(mesh.points, mesh.triangles) > 0).all() and np.array_equal(
        mesh.triangles, grid.triangles
    )
    assert all(np.array_equal(mesh.groups[name], grid.groups[name]) for name in grid.groups)


def test_hexahedra_share_the_nodes_of_a_common_face():
    """Two hexahedra with a face in common, of equal divisions, have the same facets on it."""
    below = [(x, y, z - 2.0 - 0.1 * x) for x, y, z in LEANING[:4]]
    assert facets(hexahedron(), "bottom") == facets(
        hexahedron(corners=(*below, *LEANING[:4])), "top"
    )


def test_too_many_cells_are_refused():
    """A typing error in divisions is found before the memory is gone."""
    with pytest.raises(
        InputError, match=r"^body\.body\.mesh\.divisions: 6e\+27 tetrahedra need more than"
    ):
        box((10**9, 10**9, 10**9))


def test_a_box_without_volume_is_refused():
    """Where a box is so far away that its cells vanish in double precision, the message says so."""
    with pytest.raises(
        InputError, match=r"^body\.body\.mesh: its tetrahedra have no volume in double precision"
    ):
        box(origin=(1e30, 0.0, 0.0))
