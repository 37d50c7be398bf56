"""Reference cells of order 1 and 2 as data: `CELLS[d, order]` are simplices, `BRICKS[d, order]` quadrilaterals and
hexahedra; integrals over affine and mapped ones.

A shape is a product of simplices, its factors: one of dimension d, or d lines. Points of a cell are given by the hats
of its corners there, which sum to one; on a simplex these are the barycentric coordinates. Their sums over the corners
at each vertex of a factor are the barycentric coordinates λ of the point in the factor. Nodes are the corners, then in
order 2 the middles of the edges. A shape function is one at its node, zero at all others, and a polynomial Σ c_n λ^α_n.
On an affine cell of measure |T| (length, area or volume) the gradients of λ are constant, and every integral is a table
times |T|, by ∫ λ^α = |T| d! α! / (d + |α|)! on a simplex; over products it is a product.

Other cells, as those of order 2 with middles off the midpoints of their chords, are mapped by their shape functions
φ_i, x = Σ φ_i x_i (isoparametric elements), and integrals are sums over the points of rules.

Within loops over cells components come first, as in (d, d, q, t) at q points of t cells: numpy works along the cells.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from math import factorial, prod

import numpy as np

from ddmpi.decks.cards import SIDES
from ddmpi.mesh.rules import Rule, rules_on
from ddmpi.system.numbers import ALIKE


@dataclass(frozen=True)
class Shape:
    """A product of simplices.

    Attributes
    ----------
    kind : its name in files of VTK, with which SIDES has the ends of its edges
    name, names : one and several
    topology : XDMF's name of linear cells; those of others end in the number of their nodes
    factors : the dimensions of the simplices
    corners : the vertex of each factor at each corner
    facets : corners of the facets, counter-clockwise from outside; in the plane the cell lies to their left
    parts : nodes of order 2 at the corners of linear simplices, by which it is cut where they are given
    """

    kind: str
    name: str
    names: str
    topology: str
    factors: tuple[int, ...]
    corners: Sequence[tuple[int, ...]]
    facets: Sequence[tuple[int, ...]]
    parts: Sequence[Sequence[int]] = ()

    @property
    def dimension(self) -> int:
        return sum(self.factors)

    @property
    def edges(self) -> list[tuple[int, int]]:
        return SIDES.get(self.kind, [])

    @property
    def mirrored(self) -> list[int]:
        """The corners of a mirror image, in which the last two vertices of the last factor are exchanged."""
        swap = [*range(self.factors[-1] - 1), self.factors[-1], self.factors[-1] - 1]
        return [self.corners.index((*rest, swap[last])) for *rest, last in self.corners]


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
"""Ways (w, 2^d, d + 1) to cut a simplex with halved edges, by dimension: its nodes of order 2 at the corners of the
parts. In space four parts lie around one of the octahedron's three diagonals, whose ends are the first two nodes of the
last part."""

POINT = Shape("vertex", "point", "points", "", (0,), [(0,)], [])

SIMPLICES = {
    1: Shape("line", "line", "lines", "Polyline", (1,), [(0,), (1,)], [(1,), (0,)], CUTS[1][0]),
    2: Shape(
        "triangle",
        "triangle",
        "triangles",
        "Triangle",
        (2,),
        [(0,), (1,), (2,)],
        [(0, 1), (1, 2), (2, 0)],
        CUTS[2][0],
    ),
    3: Shape(
        "tetra",
        "tetrahedron",
        "tetrahedra",
        "Tetrahedron",
        (3,),
        [(0,), (1,), (2,), (3,)],
        [(1, 2, 3), (0, 3, 2), (0, 1, 3), (0, 2, 1)],
        CUTS[3][0],
    ),
}
"""By dimension."""

PRODUCTS = {
    1: SIMPLICES[1],
    2: Shape(
        "quad",
        "quadrilateral",
        "quadrilaterals",
        "Quadrilateral",
        (1, 1),
        [(0, 0), (1, 0), (1, 1), (0, 1)],
        [(0, 1), (1, 2), (2, 3), (3, 0)],
        [[0, 4, 7], [4, 1, 5], [5, 2, 6], [6, 3, 7], [4, 5, 6], [4, 6, 7]],
    ),
    3: Shape(
        "hexahedron",
        "hexahedron",
        "hexahedra",
        "Hexahedron",
        (1, 1, 1),
        [(i ^ j, j, k) for k in (0, 1) for j in (0, 1) for i in (0, 1)],
        [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)],
    ),
}
"""Products of lines, by dimension."""

ORDERS = ("", "linear", "quadratic")
"""Names of elements, by order."""

REGULAR = {1: 1.0, 2: 3**0.5 / 4, 3: 2**0.5 / 12}
"""Length of the line, area of the triangle, volume of the tetrahedron, with edges of length one."""


LITTLE = 0.001
"""The part of the full rule in reduced integration. Without it hourglass modes have no energy, and single bricks between
contacts no support; with 0.02 stresses of bent plates are off by 2 %, not 0.8 %."""


@dataclass(frozen=True)
class Mapped:
    """Cells of dimension d, straight or curved, at q points of each.

    Attributes
    ----------
    places : (q, t, d) coordinates of the points (m)
    measures : (q, t) ratio of measures to those of the reference cell, of measure one; positive unless the cell folds
    derivatives, inverse : ∂φ_i/∂λ_a (d, q, k), and ∂λ_a/∂x (d, d, q, t) (1/m)
    turned : φ_i (q, k) of axisymmetric cells, else None
    modes : the gradients (d, q, m, t) of m incompatible modes, see `Cell.modes` (1/m)
    """

    places: np.ndarray
    measures: np.ndarray
    derivatives: np.ndarray
    inverse: np.ndarray
    turned: np.ndarray | None = None
    modes: np.ndarray | None = None

    @property
    def slopes(self) -> np.ndarray:
        """The gradients ∂φ_i/∂x (d, q, k, t) (1/m); around an axis (3, q, k, t), the last of them φ_i/r."""
        slopes = self.derivatives.transpose(1, 2, 0) @ self.inverse.transpose(1, 2, 0, 3)
        if self.turned is None:
            return slopes
        return np.concatenate([slopes, [self.turned[:, :, None] / self.places[:, None, :, 0]]])


@dataclass(frozen=True)
class Cell:
    """The reference cell of a shape of dimension d with c corners, and order, with k nodes.

    >>> cell = CELLS[2, 2]  # corners of quadratic triangles carry no constant pressure: ∫ φ_i = 0
    >>> cell.title, cell.bears, cell.mass.sum(axis=1).round(3).tolist()
    ('quadratic triangles', False, [0.0, 0.0, 0.0, 0.333, 0.333, 0.333])

    Attributes
    ----------
    nodes : (k, c) hats of the corners at the nodes, corners first
    between : (k − c, order) the corners with their mean at a node that is none: of order 2 both ends of its edge
    edges : (e, order + 1) nodes of the edges, numbered as in `CELLS[1, order]`
    facets : (f, l) nodes of the facets, numbered as in `facet`, turned outward
    powers, coefficients : (n, v) exponents α of the barycentric coordinates in all factors, and (k, n) integers c of
        φ_i = Σ c_in λ^α_n
    samples : exact to degree 2 order − 2, at points where the stress is more accurate than elsewhere
    rule : exact to degree 2 order
    quadrature : for cells that are not affine: constant stresses and volume forces are exact on curved simplices
    fine : for loads and measures of curved facets, whose integrands are no polynomials
    modes : whether it has incompatible modes λ_0 λ_1, one of each factor and component, which are inner nodes: each cell
        has its own, which minimize its energy (Taylor, Beresford and Wilson, Int. J. Numer. Meth. Engng. 10, 1976)
    """

    shape: Shape
    order: int
    nodes: np.ndarray
    between: np.ndarray
    edges: np.ndarray
    facets: np.ndarray
    powers: np.ndarray
    coefficients: np.ndarray
    samples: Rule
    rule: Rule
    quadrature: Rule
    fine: Rule
    modes: bool = False

    @property
    def dimension(self) -> int:
        return self.shape.dimension

    @property
    def corners(self) -> int:
        """c."""
        return self.nodes.shape[1]

    @property
    def simplex(self) -> bool:
        return len(self.shape.factors) == 1

    @cached_property
    def parts(self) -> np.ndarray:
        """(p, d + 1) nodes at the corners of the linear simplices into which the cell is cut: where its shape gives none,
        the first corner and the parts of the facets that do not have it."""
        if self.order == 2 and len(self.shape.parts):
            return np.asarray(self.shape.parts)
        below = self.facet.parts if self.facets.shape[1] > 1 else np.zeros((1, 1), int)
        opposite = self.facets[~(self.facets == 0).any(axis=1)]
        return np.pad(opposite[:, below].reshape(-1, below.shape[1]), ((0, 0), (1, 0)))

    @property
    def name(self) -> str:
        return self.shape.name

    @property
    def names(self) -> str:
        return self.shape.names

    @property
    def title(self) -> str:
        """Order and name in the plural."""
        return f"{ORDERS[self.order]} {self.names}"

    @property
    def topology(self) -> str:
        """Name in XDMF."""
        return self.shape.topology + f"_{len(self.nodes)}" * (not self.linear)

    @property
    def facet(self) -> Cell:
        """The cell of the facets."""
        return cell_with(self.facets.shape[1], self.dimension - 1)

    @property
    def straight(self) -> Cell:
        """The cell of order 1 with its corners."""
        return self.of_order(1)

    def of_order(self, order: int) -> Cell:
        """The cell of this order with its corners."""
        return (CELLS if self.simplex else BRICKS)[self.dimension, order]

    @property
    def linear(self) -> bool:
        """Whether its shape functions are hats: its edges are straight, and stresses in simplices constant."""
        return self.order == 1

    @property
    def middle(self) -> np.ndarray:
        """(1, c) the centroid, where the stress of a straight simplex is its mean."""
        return np.full((1, self.corners), 1.0 / self.corners)

    @property
    def bears(self) -> bool:
        """Whether a constant pressure acts on all nodes: ∫ φ_i > 0, unlike at corners of quadratic triangles."""
        return bool(
            (self.coefficients @ self._products(self.powers, self.order) > 0.0).all()
        )  # integers

    @property
    def multiple(self) -> int:
        """How often the cell fits into the parallelepiped of its tangents: d! times a simplex."""
        return prod(map(factorial, self.shape.factors))

    @property
    def regular(self) -> float:
        """The measure of a regular cell with edges of length one."""
        return prod(REGULAR[d] for d in self.shape.factors)

    def bends(self, nodes: np.ndarray, least: float = ALIKE) -> np.ndarray:
        """Offsets (…, k − c, D) of all nodes but the corners from the means `between`, of cells with `nodes`
        (…, k, D) (m). Exactly zero up to the fraction `least` of the distance of the corners."""
        corners = nodes[..., self.between, :]
        off = nodes[..., self.corners :, :] - corners.mean(axis=-2)
        bent = np.linalg.norm(off, axis=-1) > least * np.linalg.norm(
            np.ptp(corners, axis=-2), axis=-1
        )
        return np.where(bent[..., None], off, 0.0)

    def warps(self, nodes: np.ndarray) -> np.ndarray:
        """How far (t,) nodes (t, k, D) (m) are from where the affine map with the tangents of the middle has them, over
        the cell's diagonal."""
        away = self.parameters(self.nodes - self.middle)
        tangents = self.tangents(nodes)[:, :, 0]
        affine = self.shapes(self.middle) @ nodes + np.einsum("ka,adt->tkd", away, tangents)
        size = np.linalg.norm(np.ptp(nodes, axis=1), axis=1)
        return np.linalg.norm(nodes - affine, axis=2).max(axis=1) / size

    def split(self, nodes: np.ndarray) -> np.ndarray:
        """The corners (·, d + 1) of the linear simplices in cells with `nodes` (n, k), first parts first."""
        return nodes[:, self.parts].swapaxes(0, 1).reshape(-1, self.parts.shape[1])

    @cached_property
    def _vertices(self) -> np.ndarray:
        """(c, v) hats to barycentric coordinates of all factors: one where a corner is at a factor's vertex."""
        return _vertices(self.shape)

    @cached_property
    def _bases(self) -> tuple[np.ndarray, np.ndarray]:
        """(d,) numbers of the barycentric coordinates λ_1, λ_2, … of all factors, and of the λ_0 of each."""
        starts = np.cumsum([0, *(d + 1 for d in self.shape.factors)])[:-1]
        first = np.repeat(starts, self.shape.factors)
        return np.setdiff1d(np.arange(self.powers.shape[1]), starts), first

    @cached_property
    def mass(self) -> np.ndarray:
        """(k, c) ∫ φ_i times the hats over a cell of measure one."""
        higher = self.powers[:, None] + self._vertices
        return (
            self.coefficients @ self._products(higher, self.order + 1) * self._scale(self.order + 1)
        )

    @cached_property
    def stiffness(self) -> np.ndarray:
        """w (k, k, d, d) with ∫ ∇φ_i ⊗ ∇φ_j = Σ_ab w_ijab ∇λ_a ⊗ ∇λ_b, without λ_0 of each factor, over an affine cell
        of measure one.

        Zeros are exact: all that is summed are integers over the same denominator.
        """
        scaled = (
            self.coefficients[..., None] * self.powers
        )  # ∂φ_i/∂λ_a = Σ_n scaled_ina λ^(α_n − e_a)
        # Products of derivatives are monomials with exponents α_n − e_a + α_m − e_b; where α_na = 0 the factor is zero.
        degree = 2 * self.order - 2 * self.simplex
        products = self._products(self._lower[:, :, None, None] + self._lower, degree)
        w = np.einsum("ina,jmb,namb->ijab", scaled, scaled, products)
        rest, first = self._bases
        w = w[:, :, rest] - w[:, :, first]  # as λ_0 = 1 − λ_1 − …
        return (w[..., rest] - w[..., first]) * self._scale(degree)

    @cached_property
    def _lower(self) -> np.ndarray:
        """α_n − e_a (n, v, v)."""
        return np.maximum(self.powers[:, None] - np.eye(self.powers.shape[1], dtype=int), 0)

    def _products(self, powers: np.ndarray, degree: int) -> np.ndarray:
        """∫ λ^α (…) over a cell of measure one for exponents (…, v), over `_scale`: integers."""
        # On each factor ∫ λ^α = α! d!/(d + |α|)!, with α! = Π α_a!.
        ends = np.cumsum([d + 1 for d in self.shape.factors])[:-1]
        products = FACTORIALS[powers].prod(axis=-1)
        for d, part in zip(self.shape.factors, np.split(powers, ends, axis=-1), strict=True):
            products = products * (FACTORIALS[d + degree] / FACTORIALS[d + part.sum(axis=-1)])
        return products

    def _scale(self, degree: int) -> float:
        """∫ λ^α / α! for exponents that sum up to `degree` on each factor, over a cell of measure one."""
        return prod(factorial(d) / factorial(d + degree) for d in self.shape.factors)

    def coordinates(self, parameters: np.ndarray) -> np.ndarray:
        """The barycentric coordinates (…, v) in all factors at λ_1, λ_2, … (…, d) of each."""
        ends = np.cumsum(self.shape.factors)[:-1]
        parts = np.split(parameters, ends, axis=-1)
        both = [(1.0 - part.sum(axis=-1, keepdims=True), part) for part in parts]
        return np.concatenate([each for pair in both for each in pair], axis=-1)

    def parameters(self, hats: np.ndarray) -> np.ndarray:
        """λ_1, λ_2, … (…, d) of each factor at points given by the hats (…, c) there."""
        return (hats @ self._vertices)[..., self._bases[0]]

    def hats_at(self, coordinates: np.ndarray) -> np.ndarray:
        """The hats (…, c) at points given by the barycentric coordinates (…, v) in all factors."""
        return (coordinates[..., None, :] ** self._vertices).prod(axis=-1)

    def shapes(self, hats: np.ndarray) -> np.ndarray:
        """The shape functions (…, k) at points given by the hats (…, c) there."""
        coordinates = hats @ self._vertices
        return (coordinates[..., None, :] ** self.powers).prod(axis=-1) @ self.coefficients.T

    def derivatives(self, hats: np.ndarray) -> np.ndarray:
        """∂φ_i/∂λ_a (d, q, k) at points (q, c), for λ_1, λ_2, … of each factor with λ_0 = 1 − λ_1 − …."""
        coordinates = hats @ self._vertices
        terms = (coordinates[:, None, None] ** self._lower).prod(axis=-1) * self.powers  # (q, n, v)
        slopes = np.einsum("qna,in->aqi", terms, self.coefficients)
        rest, first = self._bases
        return slopes[rest] - slopes[first]

    @cached_property
    def from_samples(self) -> np.ndarray:
        """(p, q) the values at the p points of the `rule` from those at the q `samples`, of stress on straight cells: σ_h
        is a combination of the derivatives of shape functions there, which needs no second evaluation."""
        spans = [
            self.derivatives(places).swapaxes(0, 1).reshape(len(places), -1)
            for places in (self.rule[0], self.samples[0])
        ]
        return spans[0] @ np.linalg.pinv(spans[1])

    @cached_property
    def central(self) -> np.ndarray:
        """`derivatives` (d, 1, k) in the middle."""
        return self.derivatives(self.middle)

    def tangents(self, nodes: np.ndarray, hats: np.ndarray | None = None) -> np.ndarray:
        """∂x/∂λ_a (d, D, q, t) at points (q, c) of t cells in space of dimension D, with `nodes` (t, k, D) (m); in the
        middle if left out."""
        return _tangents(self.central if hats is None else self.derivatives(hats), nodes)

    def map(self, nodes: np.ndarray, hats: np.ndarray, axisymmetric: bool = False) -> Mapped:
        """Points (q, c) of cells whose `nodes` (t, k, d) need not lie on straight edges (m)."""
        derivatives, shapes = self.derivatives(hats), self.shapes(hats)
        inverse, determinant = invert(_tangents(derivatives, nodes))
        places = np.moveaxis(shapes @ nodes.transpose(2, 1, 0), 0, -1)
        measures = determinant / self.multiple * circumference(places, axisymmetric)
        return Mapped(
            places,
            measures,
            derivatives,
            inverse,
            shapes if axisymmetric else None,
            self._modes(nodes, hats, determinant) if self.modes else None,
        )

    def _modes(self, nodes: np.ndarray, hats: np.ndarray, determinant: np.ndarray) -> np.ndarray:
        """The gradients (d, q, d, t) of λ_0 λ_1 of all factors, by the map of the middle times the ratio of both
        determinants, so that their integrals vanish: constant stresses do no work in them, whatever the cell's shape."""
        inverse, middle = invert(self.tangents(nodes))
        coordinates = hats @ self._vertices
        rest, first = self._bases
        slopes = coordinates[:, first] - coordinates[:, rest]
        return np.einsum("qa,act,qt->cqat", slopes, inverse[:, :, 0], middle / determinant)

    def vectors(self, nodes: np.ndarray, hats: np.ndarray | None = None) -> np.ndarray:
        """Normal vectors (d + 1, q, t) of facets in space of dimension d + 1, with `nodes` (t, k, d + 1) (m), at points
        as for `tangents`.

        Of facets of cells they point outward. Lengths are those of measures over that of the reference cell, one.
        """
        return cross(self.tangents(nodes, hats)) / self.multiple


def _tangents(derivatives: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """`Cell.tangents` (d, D, q, t) of cells with `nodes` (t, k, D) (m), by their `derivatives` (d, q, k)."""
    return derivatives[:, None] @ np.ascontiguousarray(nodes.transpose(2, 1, 0))


FACTORIALS = np.array([float(factorial(k)) for k in range(12)])


def _vertices(shape: Shape) -> np.ndarray:
    """`Cell._vertices`."""
    return np.concatenate(
        [
            np.eye(d + 1, dtype=int)[[corner[k] for corner in shape.corners]]
            for k, d in enumerate(shape.factors)
        ],
        axis=1,
    )


def _means(shape: Shape, order: int) -> list[tuple[int, ...]]:
    """The corners with their mean at a node: a corner itself, then, of order 2, both ends of an edge."""
    return [(k,) * order for k in range(len(shape.corners))] + shape.edges * (order == 2)


def _lagrange(shapes: Mapping[int, Shape], dimension: int, order: int) -> Cell:
    """The cell of one of the shapes, with the nodes of `_means`."""
    shape = shapes[dimension]
    facet = shapes.get(dimension - 1, POINT)
    means = _means(shape, order)
    vertices = _vertices(shape)
    number = {tuple(sorted(mean)): k for k, mean in enumerate(means)}

    def nodes_of(part: Shape, corners: tuple[int, ...]) -> list[int]:
        return [number[tuple(sorted(corners[k] for k in mean))] for mean in _means(part, order)]

    edges, facets = (
        np.array([nodes_of(part, corners) for corners in every])
        for part, every in ((SIMPLICES[1], shape.edges), (facet, shape.facets))
    )
    powers = np.array([vertices[list(mean)].sum(axis=0) for mean in means])
    hats = np.array([np.bincount(mean, minlength=len(vertices)) for mean in means]) / order
    if len(shape.factors) > 1:  # serendipity: quadratic along an edge alone
        powers = np.minimum(powers, 1)
    # Values of the monomials at the nodes; the inverse has the coefficients of the shape functions, which are integers.
    values = ((hats @ vertices)[:, None] ** powers).prod(axis=-1)
    return Cell(
        shape,
        order,
        hats,
        np.array(means[len(vertices) :], int).reshape(-1, order),
        edges,
        facets,
        powers,
        np.round(np.linalg.inv(values)).T,
        *rules_on(shape.factors, order, vertices),
    )


def _integrated(cell: Cell, integration: str) -> Cell:
    """A brick with incompatible modes, or with reduced integration: by `samples`, with a little of the full rule so that
    no mode is without energy."""
    if integration == "reduced" and not cell.linear:
        points, few = cell.samples
        others, many = cell.rule
        weights = np.concatenate([(1.0 - LITTLE) * few, LITTLE * many])
        return replace(cell, quadrature=(np.concatenate([points, others]), weights))
    return replace(cell, modes=True) if integration == "modes" and cell.linear else cell


CELLS, BRICKS = (
    {(d, order): _lagrange(shapes, d, order) for d in shapes for order in (1, 2)}
    for shapes in (SIMPLICES, PRODUCTS)
)
"""Simplices, and products of lines, by dimension and order."""

_WITH = {
    (len(cell.nodes), d, integration): cell if cells is CELLS else _integrated(cell, integration)
    for cells in (BRICKS, CELLS)
    for (d, _), cell in cells.items()
    for integration in ("full", "modes", "reduced")
}


def cell_with(number: int, dimension: int, integration: str = "full") -> Cell:
    """The cell with this number of nodes, of a dimension; if it is a brick, of order 1 with "modes" or of order 2 with
    "reduced" integration."""
    return _WITH[number, dimension, integration]


def cross(rows: Sequence[np.ndarray] | np.ndarray) -> np.ndarray:
    """The vectors c (d, …) with c · v = det [v; rows] for all v, of `rows` (d − 1, d, …); of (x, y) it is (y, −x)."""
    columns = range(len(rows) + 1)
    minors = np.stack(
        [_determinant([[row[m] for m in columns if m != k] for row in rows]) for k in columns]
    )
    minors[1::2] *= -1.0
    return minors


def _determinant(rows: Sequence[Sequence[np.ndarray]]) -> np.ndarray:
    first = rows[0]
    rest = rows[1:]
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
    return cell.vectors(facets)[:, 0].T


def curved_facets(facets: np.ndarray) -> np.ndarray:
    """Which (s,) facets with nodes (s, l, D) are curved."""
    cell = facet_cell(facets)
    return np.zeros(len(facets), bool) if cell.linear else cell.bends(facets).any(axis=(1, 2))


def circumference(places: np.ndarray, axisymmetric: bool) -> np.ndarray | float:
    """The factor of measures in the plane at places (…, d): 2πr (…) around an axis (m), else one."""
    return 2.0 * np.pi * places[..., 0] if axisymmetric else 1.0


def facet_measures(facets: np.ndarray, axisymmetric: bool = False) -> np.ndarray:
    """The lengths or areas (s,) of facets with nodes (s, l, D) (m or m²)."""
    return facet_shares(facets, axisymmetric).sum(axis=1)


def facet_shares(facets: np.ndarray, axisymmetric: bool = False) -> np.ndarray:
    """∫ φ_i (s, l) over facets with nodes (s, l, D) (m or m²)."""
    cell = facet_cell(facets)
    bent = curved_facets(facets) | axisymmetric | (not cell.simplex)
    shares = np.outer(np.linalg.norm(cell.vectors(facets)[:, 0], axis=0), cell.mass.sum(axis=1))
    if not bent.any():
        return shares
    points, weights = cell.fine
    size = np.linalg.norm(cell.vectors(facets[bent], points), axis=0).T
    shapes = cell.shapes(points)
    around = circumference(shapes @ facets[bent], axisymmetric)
    shares[bent] = (size * around * weights) @ shapes
    return shares


def on_line(at: np.ndarray) -> np.ndarray:
    """The barycentric coordinates (…, 2) of places on a line by their parameters (…), from 0 to 1."""
    return np.stack([1.0 - at, at], axis=-1)
