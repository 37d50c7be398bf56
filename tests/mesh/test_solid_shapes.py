"""Boxes and hexahedra: groups, volumes, how cells are cut, and that neighbours match facet by facet."""

from itertools import product

import numpy as np
import pytest

from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.elements import facet_measures
from ddmpi.mesh.mesh import Mesh, boundary_facets, signed_measures
from ddmpi.scene.bodies import BodySpec, Material, MeshSpec

SIZE = {"left": 2.0, "right": 2.0, "front": 6.0, "back": 6.0, "bottom": 3.0, "top": 3.0}
"""Areas of the sides of a box of 3 × 1 × 2."""

CORNERS = ((0, 0, 0), (3, 0, 0), (3, 1, 0), (0, 1, 0), (0, 0, 2), (3, 0, 2), (3, 1, 2), (0, 1, 2))

LEANING = ((0, 0, 0), (3, .1, -.2), (3.3, 1.2, 0), (-.1, 1, .1),
           (.2, .1, 1.9), (3.1, 0, 2.2), (2.9, 1.3, 2), (0, .9, 2.1))


def mesh_of(order: int = 1, **keys) -> Mesh:
    return build_mesh(BodySpec(name="body", mesh=MeshSpec(order=order, **keys),
                               material=Material(young=1.0, poisson=0.3)))


def box(divisions=(3, 2, 4), order=1, size=(3.0, 1.0, 2.0), **keys) -> Mesh:
    return mesh_of(order, shape="box", size=size, divisions=divisions, **keys)


def hexahedron(divisions=(3, 2, 4), corners=LEANING, order=1) -> Mesh:
    corners = tuple(tuple(map(float, corner)) for corner in corners)
    return mesh_of(order, shape="hexahedron", corners=corners, divisions=divisions)


def facets(mesh: Mesh, group: str) -> set:
    """The facets of a group as sets of the points of their nodes."""
    return {frozenset(map(tuple, facet)) for facet in mesh.points[mesh.groups[group]].tolist()}


@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("divisions", [(1, 1, 1), (3, 2, 4)])
def test_box_has_the_volume_and_sides_of_its_size(divisions, order):
    """A box is filled by its cells, and its six groups cover the boundary once."""
    mesh = box(divisions, order, origin=(1.0, -1.0, 0.5))
    assert (mesh.dimension, mesh.order, len(mesh.triangles)) == (3, order, 6 * np.prod(divisions))
    assert mesh.measures() == pytest.approx(np.full(len(mesh.triangles), 1 / np.prod(divisions)), rel=1e-14)
    assert mesh.points.min(axis=0) == pytest.approx([1.0, -1.0, 0.5])
    assert mesh.points.max(axis=0) == pytest.approx([4.0, 0.0, 2.5])
    assert tuple(mesh.groups) == tuple(SIZE)
    for number, (name, area) in enumerate(SIZE.items()):
        own = mesh.groups[name]
        assert own.shape[1] == 3 * order
        assert facet_measures(mesh.points[own]).sum() == pytest.approx(area, rel=1e-14)
        assert np.ptp(mesh.points[own][:, :, number // 2]) == 0.0
        assert np.array_equal(mesh.facets(name).nodes, own)
    everything = np.sort(np.concatenate(list(mesh.groups.values())), axis=1).tolist()
    outer = boundary_facets(mesh.triangles)[0]
    assert sorted(everything) == sorted(np.sort(outer, axis=1).tolist())


def test_all_cells_of_a_box_are_cut_alike():
    """Each cell of the grid has the six tetrahedra around its diagonal from the least to the greatest coordinates."""
    mesh, unit = box((2, 3, 2), size=(2.0, 3.0, 2.0)), box((1, 1, 1), size=(1.0, 1.0, 1.0))

    def cells(of: Mesh, at) -> set:
        return {frozenset(map(tuple, cell)) for cell in (of.points[of.triangles] + at).tolist()}

    assert cells(mesh, 0.0) == set().union(*(cells(unit, at) for at in product(range(2), range(3), range(2))))
    assert all({(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)} <= cell for cell in cells(unit, 0.0))


def test_hexahedron_is_the_trilinear_map_of_a_grid():
    """Nodes lie at equal parameters; those at corners are the corners exactly."""
    mesh, grid = hexahedron(), box(size=(1.0, 1.0, 1.0))
    (x, y, z), at = grid.points.T[:, :, None], np.array(LEANING)
    weights = [(x if c[0] else 1 - x) * (y if c[1] else 1 - y) * (z if c[2] else 1 - z) for c in CORNERS]
    assert mesh.points == pytest.approx(sum(w * a for w, a in zip(weights, at, strict=True)), rel=0, abs=1e-15)
    assert {tuple(map(float, corner)) for corner in LEANING} <= set(map(tuple, mesh.points.tolist()))
    assert (signed_measures(mesh.points, mesh.triangles) > 0).all() and np.array_equal(mesh.triangles, grid.triangles)
    assert all(np.array_equal(mesh.groups[name], grid.groups[name]) for name in SIZE)


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
