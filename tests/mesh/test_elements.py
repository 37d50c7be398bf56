"""Reference cells: what their tables say is what quadrature finds, and what geometry demands."""

from itertools import product
from math import factorial

import numpy as np
import pytest

from ddmpi.mesh.elements import CELLS, FINE, FIRST, RULES, SECOND, facet_measures, facet_shares, invert

every_cell = pytest.mark.parametrize("cell", CELLS.values(), ids=map(str, CELLS))


@every_cell
def test_shape_functions_belong_to_their_nodes(cell):
    """One at its own node, zero at the others, together one everywhere."""
    assert np.array_equal(cell.shapes(cell.nodes), np.eye(len(cell.nodes)))
    points, _ = FINE[cell.dimension]
    assert cell.shapes(points).sum(axis=-1) == pytest.approx(1.0)
    assert cell.derivatives(points).sum(axis=-1) == pytest.approx(0.0, abs=1e-14)


@every_cell
def test_derivatives_are_those_of_shape_functions(cell):
    """By differences, which are exact for polynomials of degree 2."""
    points, step = FINE[cell.dimension][0], 1e-3
    for a, slopes in enumerate(cell.derivatives(points), start=1):
        along = step * (np.eye(cell.dimension + 1)[a] - np.eye(cell.dimension + 1)[0])
        found = (cell.shapes(points + along) - cell.shapes(points - along)) / (2 * step)
        assert found == pytest.approx(slopes, abs=1e-11)


@every_cell
def test_tables_are_integrals(cell):
    """Tables from the formula for powers of barycentric coordinates agree with quadrature."""
    points, weights = FINE[cell.dimension]
    phi, slopes = cell.shapes(points), cell.derivatives(points)
    assert cell.mass == pytest.approx(np.einsum("q,qi,qa->ia", weights, phi, points), abs=1e-14)
    assert cell.stiffness == pytest.approx(np.einsum("q,aqi,bqj->ijab", weights, slopes, slopes), abs=1e-13)


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize("rules, degree", [(FIRST, 1), (SECOND, 2), (RULES, 4), (FINE, 7)], ids=["1", "2", "rule", "7"])
def test_rules_are_exact_to_their_degree(rules, degree, dimension):
    """All monomials of barycentric coordinates; in space the rule for curved cells to degree 5."""
    points, weights = rules.get(dimension, FINE[dimension])
    degree += rules is RULES and dimension == 3
    for powers in product(range(degree + 1), repeat=dimension + 1):
        if sum(powers) == degree:
            exact = factorial(dimension) * np.prod([factorial(p) for p in powers]) / factorial(dimension + degree)
            assert weights @ (points**powers).prod(axis=1) == pytest.approx(exact, rel=1e-13)
    assert (points >= 0.0).all() and (weights > 0.0).all()


@pytest.mark.parametrize("dimension", [2, 3])
@pytest.mark.parametrize("order", [1, 2])
def test_facets_face_outward(dimension, order):
    """Of any cell that is not turned over: normals point away from the opposite corner and close the surface."""
    cell, side = CELLS[dimension, order], CELLS[dimension - 1, order]
    corners = np.random.default_rng(3).normal(size=(dimension + 1, dimension))
    corners = corners if np.linalg.det(corners[1:] - corners[0]) > 0 else corners[[1, 0, *range(2, dimension + 1)]]
    nodes = cell.nodes @ corners
    facets = nodes[cell.facets]
    assert facets == pytest.approx(np.einsum("li,fid->fld", side.nodes, facets[:, :dimension]))  # middles, too
    vectors = side.vectors(facets, side.nodes[:1])[:, 0].T
    assert vectors.sum(axis=0) == pytest.approx(0.0, abs=1e-14)
    assert ((facets.mean(axis=1) - nodes.mean(axis=0)) * vectors).sum(axis=1).min() > 0.0
    volume = np.linalg.det(corners[1:] - corners[0]) / factorial(dimension)
    assert (facets[:, 0] * vectors).sum() == pytest.approx(dimension * volume)
    assert facet_measures(facets) == pytest.approx(np.linalg.norm(vectors, axis=1))
    assert facet_shares(facets) == pytest.approx(np.outer(np.linalg.norm(vectors, axis=1), side.mass.sum(axis=1)))


@pytest.mark.parametrize("dimension", [2, 3])
def test_inverse_of_small_matrices(dimension):
    tangents = np.random.default_rng(5).normal(size=(dimension, dimension, 7))
    inverse, determinant = invert(tangents)
    assert determinant == pytest.approx(np.linalg.det(tangents.transpose(2, 0, 1)))
    assert np.einsum("art,brt->abt", tangents, inverse) == pytest.approx(
        np.repeat(np.eye(dimension)[..., None], 7, axis=2), abs=1e-12)
