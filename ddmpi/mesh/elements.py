"""Simplices of any dimension, order 1 and 2, as data: `CELLS[d, order]`; integrals over straight and curved ones.

Points of a cell are given by their barycentric coordinates λ_0 … λ_d. Nodes are the corners, then in order 2 the
middles of the edges. A shape function is one at its node, zero at all others, and a polynomial Σ c_n λ^α_n with
|α_n| = order. On a straight cell of measure |T| (length, area or volume) the gradients of λ are constant, and every
integral is a table times |T|, by ∫ λ^α = |T| d! α! / (d + |α|)!.

A cell of order 2 is curved where middles are off the midpoints of their chords: then its shape functions φ_i map
it, x = Σ φ_i x_i (isoparametric elements), and integrals are sums over the points of RULES and FINE.

Within loops over cells components come first, as in (d, d, q, t) at q points of t cells: numpy works along the cells.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import permutations
from math import factorial

import numpy as np

from ddmpi.system.numbers import ALIKE

Rule = tuple[np.ndarray, np.ndarray]
"""Barycentric coordinates (q, d + 1) of points, and their weights (q,), which sum to one."""

EDGES = {
    1: [(0, 1)],
    2: [(0, 1), (1, 2), (2, 0)],
    3: [(0, 1), (1, 2), (2, 0), (0, 3), (1, 3), (2, 3)],
}
"""Ends of the edges by dimension; their middles are numbered in this order, which is VTK's."""

FACETS: dict[int, list[tuple[int, ...]]] = {
    1: [(1,), (0,)],
    2: [(0, 1), (1, 2), (2, 0)],
    3: [(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)],
}
"""Corners of the facets by dimension, counter-clockwise from outside; in the plane the cell lies to their left."""

CUTS = {
    1: np.array([[[0, 2], [2, 1]]]),
    2: np.array([[[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]]),
    3: np.array(
        [
            [
                [0, 4, 6, 7],
                [4, 1, 5, 8],
                [6, 5, 2, 9],
                [7, 8, 9, 3],
                *([*ends, a, b] for a, b in around),
            ]
            for ends, around in (
                ((4, 9), ((5, 6), (6, 7), (7, 8), (8, 5))),
                ((5, 7), ((6, 4), (9, 6), (8, 9), (4, 8))),
                ((6, 8), ((4, 5), (5, 9), (9, 7), (7, 4))),
            )
        ]
    ),
}
"""Ways (w, 2^d, d + 1) to cut a cell with halved edges, by dimension: its nodes of order 2 at the corners of the parts.
In space four parts lie around one of the octahedron's three diagonals, whose ends are the first two nodes of the last
part."""

NAMES = (
    ("point", "points"),
    ("line", "lines"),
    ("triangle", "triangles"),
    ("tetrahedron", "tetrahedra"),
)
"""One and several, by dimension."""

TOPOLOGY = ("", "Polyline", "Triangle", "Tetrahedron")
"""XDMF's names of linear cells, by dimension; the names of others end in the number of their nodes."""

ORDERS = ("", "linear", "quadratic")
"""Names of elements, by order."""

REGULAR = {2: 3**0.5 / 4, 3: 2**0.5 / 12}
"""Area of the triangle, volume of the tetrahedron, with edges of length one."""


@dataclass(frozen=True)
class Mapped:
    """Cells of dimension d, straight or curved, at q points of each.

    Attributes
    ----------
    places : (q, t, d) coordinates of the points (m)
    measures : (q, t) ratio of measures to those of the reference cell, of measure one; positive unless the cell folds
    derivatives, inverse : ∂φ_i/∂λ_a (d, q, k), and ∂λ_a/∂x (d, d, q, t) (1/m)
    turned : φ_i (q, k) of axisymmetric cells, else None
    """

    places: np.ndarray
    measures: np.ndarray
    derivatives: np.ndarray
    inverse: np.ndarray
    turned: np.ndarray | None = None

    @property
    def slopes(self) -> np.ndarray:
        """The gradients ∂φ_i/∂x (d, q, k, t) (1/m); around an axis (3, q, k, t), the last of them φ_i/r."""
        slopes = self.derivatives.transpose(1, 2, 0) @ self.inverse.transpose(1, 2, 0, 3)
        if self.turned is None:
            return slopes
        return np.concatenate([slopes, [self.turned[:, :, None] / self.places[:, None, :, 0]]])


@dataclass(frozen=True)
class Cell:
    """The reference simplex of one dimension d and order, with k nodes.

    >>> cell = CELLS[2, 2]  # corners of quadratic triangles carry no constant pressure: ∫ φ_i = 0
    >>> cell.title, cell.bears, cell.mass.sum(axis=1).round(3).tolist()
    ('quadratic triangles', False, [0.0, 0.0, 0.0, 0.333, 0.333, 0.333])

    Attributes
    ----------
    nodes : (k, d + 1) barycentric coordinates of the nodes, corners first
    between : (k − d − 1, order) the corners with their mean at a node that is none: of order 2 both ends of its edge
    edges : (e, order + 1) nodes of the edges, numbered as in `CELLS[1, order]`
    facets : (d + 1, l) nodes of the facets, numbered as in `CELLS[d - 1, order]`, turned outward
    parts : (p, d + 1) nodes at the corners of the linear simplices into which the cell is cut
    samples : exact to degree 2 order − 2, at points where the stress is more accurate than elsewhere
    rule : exact to degree 2 order
    powers, coefficients : (n, d + 1) exponents α and (k, n) integers c of φ_i = Σ c_in λ^α_n
    """

    nodes: np.ndarray
    between: np.ndarray
    edges: np.ndarray
    facets: np.ndarray
    parts: np.ndarray
    samples: Rule
    rule: Rule
    powers: np.ndarray
    coefficients: np.ndarray

    @property
    def dimension(self) -> int:
        return self.nodes.shape[1] - 1

    @property
    def order(self) -> int:
        return int(self.powers[0].sum())

    @property
    def name(self) -> str:
        return NAMES[self.dimension][0]

    @property
    def names(self) -> str:
        return NAMES[self.dimension][1]

    @property
    def title(self) -> str:
        """Order and name in the plural."""
        return f"{ORDERS[self.order]} {self.names}"

    @property
    def topology(self) -> str:
        """Name in XDMF."""
        return TOPOLOGY[self.dimension] + f"_{len(self.nodes)}" * (not self.linear)

    @property
    def facet(self) -> Cell:
        """The cell of the facets."""
        return CELLS[self.dimension - 1, self.order]

    @property
    def linear(self) -> bool:
        """Whether its shape functions are linear: its edges are straight, and stresses in it constant."""
        return self.order == 1

    @property
    def bears(self) -> bool:
        """Whether a constant pressure acts on all nodes: ∫ φ_i > 0, unlike at corners of quadratic triangles."""
        return bool((self.coefficients @ _products(self.powers) > 0.0).all())  # integers

    def bends(self, nodes: np.ndarray, least: float = ALIKE) -> np.ndarray:
        """Offsets (…, k − d − 1, D) of all nodes but the corners from the means `between`, of cells with `nodes`
        (…, k, D) (m). Exactly zero up to the fraction `least` of the distance of the corners."""
        corners = nodes[..., self.between, :]
        off = nodes[..., self.dimension + 1 :, :] - corners.mean(axis=-2)
        bent = np.linalg.norm(off, axis=-1) > least * np.linalg.norm(
            np.ptp(corners, axis=-2), axis=-1
        )
        return np.where(bent[..., None], off, 0.0)

    def split(self, nodes: np.ndarray) -> np.ndarray:
        """The corners (·, d + 1) of the linear simplices in cells with `nodes` (n, k), first parts first."""
        return nodes[:, self.parts].swapaxes(0, 1).reshape(-1, self.parts.shape[1])

    @cached_property
    def mass(self) -> np.ndarray:
        """(k, d + 1) ∫ φ_i λ_a over a cell of measure one."""
        # λ_a φ_i = Σ c λ^(α + e_a), and ∫ λ^β = β! d!/(d + |β|)! over a simplex of measure one.
        higher = self.powers[:, None] + np.eye(self.dimension + 1, dtype=int)
        return self.coefficients @ _products(higher) * self._scale(self.order + 1)

    @cached_property
    def stiffness(self) -> np.ndarray:
        """w (k, k, d, d) with ∫ ∇φ_i ⊗ ∇φ_j = Σ_ab w_ijab ∇λ_a ⊗ ∇λ_b, a, b ≥ 1, over a cell of measure one.

        Zeros are exact: all that is summed are integers over the same denominator.
        """
        scaled = (
            self.coefficients[..., None] * self.powers
        )  # ∂φ_i/∂λ_a = Σ_n scaled_ina λ^(α_n − e_a)
        # Products of derivatives are monomials with exponents α_n − e_a + α_m − e_b; where α_na = 0 the factor is zero.
        products = _products(self._lower[:, :, None, None] + self._lower)
        w = np.einsum("ina,jmb,namb->ijab", scaled, scaled, products)
        w = (
            w[:, :, 1:, 1:] - w[:, :, 1:, :1] - w[:, :, :1, 1:] + w[:, :, :1, :1]
        )  # as λ_0 = 1 − λ_1 − …
        return w * self._scale(2 * self.order - 2)

    @property
    def _lower(self) -> np.ndarray:
        """α_n − e_a (n, d + 1, d + 1)."""
        return np.maximum(self.powers[:, None] - np.eye(self.dimension + 1, dtype=int), 0)

    def _scale(self, degree: int) -> float:
        """∫ λ^α / α! for |α| = `degree`, over a cell of measure one."""
        return factorial(self.dimension) / factorial(self.dimension + degree)

    def shapes(self, barycentric: np.ndarray) -> np.ndarray:
        """The shape functions (…, k) at points given by their barycentric coordinates (…, d + 1)."""
        return (barycentric[..., None, :] ** self.powers).prod(axis=-1) @ self.coefficients.T

    def derivatives(self, barycentric: np.ndarray) -> np.ndarray:
        """∂φ_i/∂λ_a (d, q, k) at points (q, d + 1), for a = 1 … d with λ_0 = 1 − λ_1 − …."""
        terms = (barycentric[:, None, None] ** self._lower).prod(
            axis=-1
        ) * self.powers  # (q, n, d + 1)
        slopes = np.einsum("qna,in->aqi", terms, self.coefficients)
        return slopes[1:] - slopes[:1]

    def tangents(self, nodes: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """∂x/∂λ_a (d, D, q, t) at points (q, d + 1) of t cells in space of dimension D, with `nodes` (t, k, D) (m)."""
        return self.derivatives(barycentric)[:, None] @ np.ascontiguousarray(
            nodes.transpose(2, 1, 0)
        )

    def map(self, nodes: np.ndarray, barycentric: np.ndarray, axisymmetric: bool = False) -> Mapped:
        """Points (q, d + 1) of cells whose `nodes` (t, k, d) need not lie on straight edges (m)."""
        inverse, determinant = invert(self.tangents(nodes, barycentric))
        shapes = self.shapes(barycentric)
        places = np.moveaxis(shapes @ nodes.transpose(2, 1, 0), 0, -1)
        measures = determinant / factorial(self.dimension) * circumference(places, axisymmetric)
        return Mapped(
            places,
            measures,
            self.derivatives(barycentric),
            inverse,
            shapes if axisymmetric else None,
        )

    def vectors(self, nodes: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
        """Normal vectors (d + 1, q, t) of facets in space of dimension d + 1, with `nodes` (t, k, d + 1) (m).

        Of facets of `CELLS` they point outward. Lengths are those of measures over that of the reference cell, one.
        """
        return cross(self.tangents(nodes, barycentric)) / factorial(self.dimension)


def _products(powers: np.ndarray) -> np.ndarray:
    """α! = Π α_a! of exponents (…, d + 1)."""
    return np.array([1.0, 1.0, 2.0, 6.0, 24.0])[powers].prod(axis=-1)


def _orbits(dimension: int, *orbits: tuple[float, float, int]) -> Rule:
    """A rule from weights and barycentric coordinates: a value, how often it stands, and equal ones for the rest. All
    permutations of them are points."""
    points = [
        sorted(set(permutations([value] * times + [(1.0 - times * value) / rest] * rest)))
        for _, value, times in orbits
        for rest in [dimension + 1 - times]
    ]
    return np.concatenate(points), np.repeat(
        [weight for weight, *_ in orbits], [len(orbit) for orbit in points]
    )


def _collapsed(dimension: int) -> Rule:
    """Gauss's five points along each edge of a cube mapped to the simplex (Duffy 1982): exact to degree 10 − d."""
    at, weights = (values / 2 for values in np.polynomial.legendre.leggauss(5))
    at, points, weight = 0.5 + at, np.ones((1, 1)), np.ones(1)
    # Split off one coordinate at a time: λ_last → λ_last (1 − t), λ_last t. The Jacobian is t^(rest − 1), and the
    # factor `rest` makes the weights sum to one.
    for rest in range(dimension, 0, -1):
        points, last, t = (
            points[:, :-1].repeat(5, axis=0),
            points[:, -1].repeat(5),
            np.tile(at, len(points)),
        )
        points = np.column_stack([points, last * (1.0 - t), last * t])
        weight = np.outer(weight, weights * rest * at ** (rest - 1)).ravel()
    return points, weight


FIRST = {
    dimension: (np.full((1, dimension + 1), 1.0 / (dimension + 1)), np.ones(1))
    for dimension in EDGES
}
"""The centroid, where the stress of a straight cell is its mean."""

SECOND = {d: _orbits(d, (1.0 / (d + 1), (1.0 - (d + 2) ** -0.5) / (d + 1), d)) for d in EDGES}
"""d + 1 points, exact to degree 2."""

RULES = {
    2: _orbits(
        2, (0.223381589678011, 0.445948490915965, 2), (0.109951743655322, 0.091576213509771, 2)
    ),
    3: _orbits(
        3,
        (0.112687925718015851, 0.310885919263300610, 3),
        (0.0734930431163619495, 0.0927352503108912264, 3),
        (0.0425460207770814664, 0.0455037041256496495, 2),
    ),
}
"""Exact to degree 4 in the plane (Dunavant 1985), 5 in space (Walkington 2000). On curved cells ∫ σ : ε(φ_i) of a
constant stress needs degree d and ∫ φ_i degree d + 2, so that constant stresses and volume forces are exact."""

FINE = {dimension: _collapsed(dimension) for dimension in EDGES}
"""For loads and measures of curved facets, whose integrands are no polynomials."""


def exact_rule(dimension: int, degree: int) -> Rule:
    """The rule with the fewest points among these that is exact to a degree."""
    rules = [FIRST, FIRST, SECOND, RULES, RULES, *[FINE] * 5][degree]
    return rules.get(dimension, FINE[dimension])


def _means(dimension: int, order: int) -> list[tuple[int, ...]]:
    """The corners with their mean at a node: a corner itself, then, of order 2, both ends of an edge."""
    return [(k,) * order for k in range(dimension + 1)] + EDGES.get(dimension, []) * (order == 2)


def _lagrange(dimension: int, order: int) -> Cell:
    """The simplex with the nodes of `_means`."""
    means = _means(dimension, order)
    number = {tuple(sorted(mean)): k for k, mean in enumerate(means)}

    def nodes_of(corners: tuple[int, ...]) -> list[int]:
        return [
            number[tuple(sorted(corners[k] for k in mean))]
            for mean in _means(len(corners) - 1, order)
        ]

    edges, facets = (
        np.array([nodes_of(part) for part in every])
        for every in (EDGES[dimension], FACETS[dimension])
    )
    powers = np.array([np.bincount(mean, minlength=dimension + 1) for mean in means])
    # Values of the monomials at the nodes; the inverse has the coefficients of the shape functions, which are integers.
    values = ((powers[:, None] / order) ** powers).prod(axis=-1)
    return Cell(
        powers / order,
        np.array(means[dimension + 1 :], int).reshape(-1, order),
        edges,
        facets,
        np.arange(dimension + 1)[None] if order == 1 else CUTS[dimension][0],
        exact_rule(dimension, 2 * order - 2),
        exact_rule(dimension, 2 * order),
        powers,
        np.round(np.linalg.inv(values)).T,
    )


CELLS = {(dimension, order): _lagrange(dimension, order) for dimension in EDGES for order in (1, 2)}
"""By dimension and order."""


def cell_with(number: int, dimension: int | None = None) -> Cell:
    """The cell with this number of nodes, of a dimension or else of the largest one."""
    return next(
        cell
        for (d, _), cell in reversed(CELLS.items())
        if len(cell.nodes) == number and dimension in (None, d)
    )


def cross(rows: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """The vectors c (d, …) with c · v = det [v; rows] for all v, of `rows` (d − 1, d, …); of (x, y) it is (y, −x)."""
    columns = range(len(rows) + 1)
    minors = np.stack(
        [_determinant([[row[m] for m in columns if m != k] for row in rows]) for k in columns]
    )
    minors[1::2] *= -1.0
    return minors


def _determinant(rows: Sequence[Sequence[np.ndarray]]) -> np.ndarray:
    first, rest = rows[0], rows[1:]
    if not rest:
        return first[0]
    terms = [
        entry * _determinant([[*row[:k], *row[k + 1 :]] for row in rest])
        for k, entry in enumerate(first)
    ]
    return sum(terms[2::2], terms[0]) - sum(terms[3::2], terms[1])


def invert(tangents: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """∂λ_a/∂x (d, d, …) from ∂x/∂λ_a (d, d, …), and the determinants (…) of the latter."""
    rows = range(len(tangents))
    cofactors = np.stack([cross([tangents[b] for b in rows if b != a]) for a in rows])
    cofactors[1::2] *= -1.0
    determinant = (tangents[0] * cofactors[0]).sum(axis=0)
    return cofactors / determinant, determinant


def facet_cell(facets: np.ndarray) -> Cell:
    """The cell of facets with nodes (s, l, D)."""
    return cell_with(facets.shape[1], facets.shape[2] - 1)


def normals(facets: np.ndarray) -> np.ndarray:
    """Outer normals (s, d) of plane facets by their corners (s, d, d), as long as their measures (m or m²)."""
    cell = facet_cell(facets)
    return cell.vectors(facets, FIRST[cell.dimension][0])[:, 0].T


def curved_facets(facets: np.ndarray) -> np.ndarray:
    """Which (s,) facets with nodes (s, l, D) are curved."""
    return facet_cell(facets).bends(facets).any(axis=(1, 2))


def circumference(places: np.ndarray, axisymmetric: bool) -> np.ndarray | float:
    """The factor of measures in the plane at places (…, d): 2πr (…) around an axis (m), else one."""
    return 2.0 * np.pi * places[..., 0] if axisymmetric else 1.0


def facet_measures(facets: np.ndarray, axisymmetric: bool = False) -> np.ndarray:
    """The lengths or areas (s,) of facets with nodes (s, l, D) (m or m²)."""
    return facet_shares(facets, axisymmetric).sum(axis=1)


def facet_shares(facets: np.ndarray, axisymmetric: bool = False) -> np.ndarray:
    """∫ φ_i (s, l) over facets with nodes (s, l, D) (m or m²)."""
    cell, bent = facet_cell(facets), curved_facets(facets) | axisymmetric
    (centre, _), (points, weights) = FIRST[cell.dimension], FINE[cell.dimension]
    shares = np.outer(
        np.linalg.norm(cell.vectors(facets, centre)[:, 0], axis=0), cell.mass.sum(axis=1)
    )
    size = np.linalg.norm(cell.vectors(facets[bent], points), axis=0).T
    shapes = cell.shapes(points)
    around = circumference(shapes @ facets[bent], axisymmetric)
    shares[bent] = (size * around * weights) @ shapes
    return shares


def on_line(at: np.ndarray) -> np.ndarray:
    """The barycentric coordinates (…, 2) of places on a line by their parameters (…), from 0 to 1."""
    return np.stack([1.0 - at, at], axis=-1)
