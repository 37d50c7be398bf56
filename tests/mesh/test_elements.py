"""Reference cells: quadrature, tables, facets and parts."""

from itertools import product
from math import factorial

import numpy as np
import pytest

from ddmpi.mesh.elements import BRICKS, CELLS
from ddmpi.mesh.mesh import boundary_facets, signed_measures
from ddmpi.mesh.rules import FINE, FIRST, RULES, SECOND


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize(
    "rules, degree", [(FIRST, 1), (SECOND, 2), (RULES, 4), (FINE, 7)], ids=["1", "2", "rule", "7"]
)
def test_rules_are_exact_to_their_degree(rules, degree, dimension):
    """All monomials of barycentric coordinates; in space the rule for curved cells to degree 5."""
    points, weights = rules.get(dimension, FINE[dimension])
    degree += rules is RULES and dimension == 3
    for powers in product(range(degree + 1), repeat=dimension + 1):
        if sum(powers) == degree:
            exact = (
                factorial(dimension)
                * np.prod([factorial(p) for p in powers])
                / factorial(dimension + degree)
            )
            assert weights @ (points**powers).prod(axis=1) == pytest.approx(exact, rel=1e-13)
    assert (points >= 0.0).all() and (weights > 0.0).all()


BRICK = [(d, order) for d in (2, 3) for order in (1, 2)]


@pytest.mark.parametrize("d, order", BRICK)
def test_tables_of_bricks_are_their_integrals(d, order):
    """Shape functions are one at their node and zero at the others; serendipity has all monomials of its order and those
    that are linear but along one edge. Mass and stiffness are those of Gauss's rule with five points along each axis."""
    cell = BRICKS[d, order]
    assert cell.shapes(cell.nodes) == pytest.approx(np.eye(len(cell.nodes)), abs=1e-14)
    points, weights = cell.fine
    xi = points @ np.array(cell.shape.corners)
    for powers in product(range(order + 1), repeat=d):
        if sum(p for p in powers if p > 1) <= order:
            at_nodes = (cell.nodes @ np.array(cell.shape.corners))[:, None] ** np.array(powers)
            values = at_nodes.prod(axis=-1)[:, 0]
            assert cell.shapes(points) @ values == pytest.approx((xi**powers).prod(axis=1))
            exact = 1.0 / np.prod([p + 1 for p in powers])
            for at, shares in (cell.rule, cell.quadrature, cell.fine):
                assert shares @ cell.shapes(at) @ values == pytest.approx(exact, rel=1e-13)
    shapes, slopes = cell.shapes(points), cell.derivatives(points)
    mass = np.einsum("q,qi,qc->ic", weights, shapes, points)
    assert cell.mass == pytest.approx(mass, abs=1e-15)
    stiffness = np.einsum("q,aqi,bqj->ijab", weights, slopes, slopes)
    assert cell.stiffness == pytest.approx(stiffness, abs=1e-14)
    h = 1e-6
    for a, vertex in enumerate(np.eye(d)):
        both = [cell.shapes(_hats(cell, xi + sign * h * vertex)) for sign in (1, -1)]
        assert slopes[a] == pytest.approx((both[0] - both[1]) / (2 * h), abs=1e-8)


def _hats(cell, xi):
    """Products of ξ and 1 − ξ, written out."""
    corners = np.array(cell.shape.corners)
    return np.prod(np.where(corners, xi[:, None], 1.0 - xi[:, None]), axis=2)


@pytest.mark.parametrize("d, order", BRICK)
def test_facets_and_parts_of_bricks_enclose_them(d, order):
    """By Gauss's theorem ∫ x · n over the facets is d times the volume; linear parts are positive and fill the cell; the
    facets of facets are their edges."""
    cell = BRICKS[d, order]
    x = cell.nodes @ np.array(cell.shape.corners) + 1.0  # no facet through the origin
    facet = cell.facet
    points, weights = facet.fine
    nodes = x[cell.facets]
    flux = np.einsum(
        "q,cqs,qsc->",
        weights,
        facet.vectors(nodes, points),
        np.einsum("qk,skc->qsc", facet.shapes(points), nodes),
    )
    assert flux == pytest.approx(d)
    volumes = signed_measures(x, cell.parts)
    assert (volumes > 0.0).all() and volumes.sum() == pytest.approx(1.0)
    corners = 0.5 * (x[cell.edges[:, 0]] + x[cell.edges[:, 1]])
    assert order == 1 or x[cell.edges[:, 2]] == pytest.approx(corners)


def test_a_grid_of_bricks_has_the_boundary_of_its_box():
    """Two cells see a common quadrilateral from different corners; only facets of one cell are outer ones."""
    number = np.arange(27).reshape(3, 3, 3)
    corners = np.array(BRICKS[3, 1].shape.corners)
    starts = np.stack(np.indices((2, 2, 2)).reshape(3, -1), axis=1)
    cells = number[tuple(np.moveaxis(starts[:, None] + corners, -1, 0))]
    x = np.stack(np.unravel_index(np.arange(27), (3, 3, 3)), axis=1) / 2.0
    facets, owner = boundary_facets(cells, 3)
    assert len(facets) == 24 and np.array_equal(np.sort(np.unique(owner)), np.arange(8))
    normals = BRICKS[3, 1].facet.vectors(x[facets], np.full((1, 4), 0.25))[:, 0].T
    middle = x[facets].mean(axis=1) - 0.5
    assert (
        np.abs(normals).sum() == pytest.approx(6.0) and ((normals * middle).sum(axis=1) > 0.0).all()
    )
    assert signed_measures(x, cells) == pytest.approx(np.full(8, 0.125))
    assert CELLS[3, 1].facet.names == "triangles"
