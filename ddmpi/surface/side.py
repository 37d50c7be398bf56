"""The contact boundary of one body: the common part of `Curve` and `Patch`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from functools import cached_property
from math import factorial, prod
from typing import ClassVar, NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.mesh.boundary import links
from ddmpi.mesh.elements import (
    BRICKS,
    Cell,
    cell_with,
    circumference,
    facet_cell,
    facet_measures,
    facet_shares,
    normals,
)
from ddmpi.sets import magnitude
from ddmpi.system.numbers import ROUNDING, Frame, divisor

NEWTON = 20
"""Most steps to the place of a point in a quadrilateral; parallelograms take one."""


@dataclass(frozen=True)
class Side:
    """Contact boundary of one body: a `Curve` in the plane, with nodes sorted along it, a `Patch` in space.

    Attributes
    ----------
    body : name of the body
    modulus : plane modulus E/(1 − ν²) of the body (Pa)
    nodes : (k,) mesh node numbers
    xy : (k, d) positions (m)
    normal : (k, d) outer unit normals, averaged over the adjacent facets with their measures; of curved facets those at
        the node itself
    area : (k,) nodal lengths or areas (m or m²): the integral of the node's shape function over the boundary, so that
        a constant stress times them gives its nodal forces. Half the adjacent edges in order 1 in the plane; in order 2
        two thirds of its edge for a middle, a sixth of the adjacent edges for a corner, where these are straight
    clamps : (k, d) the number of the clamp that prescribes each component, −1 if none does
    free : (k, d, d) projections onto the directions in which clamps let the nodes move
    moved : (k, d) the displacements that clamps prescribe (m), by their history
    tied : (k,) bool, whether a node is clamped in all components, or on another contact that carries tangential forces
    extent : (d,) of the body along the axes (m)
    arc : (k,) arc length from the start of the node's chain, on the way with the body to the left (m). A closed chain
        starts at the first node of the group's first line on it. Zero in space
    facets : (f, l) indices of their nodes, turned outward, see `Facets`; sorted by the last column
    parted : whether another contact is on the same group
    axisymmetric : whether nodal lengths are areas of revolution around x = 0
    TURNS, KEPT : properties that turn with a frame, and that do not depend on it
    """

    TURNS: ClassVar[tuple[str, ...]] = ("outward",)
    KEPT: ClassVar[tuple[str, ...]] = ("lengths", "areas", "spacing")

    body: str
    modulus: float
    nodes: np.ndarray
    xy: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    clamps: np.ndarray
    free: np.ndarray
    moved: Mapping[str | None, np.ndarray]
    tied: np.ndarray
    extent: np.ndarray
    arc: np.ndarray
    facets: np.ndarray
    parted: bool = False
    axisymmetric: bool = False

    def __getstate__(self) -> dict[str, object]:
        return {
            each.name: vars(self)[each.name] for each in fields(self)
        }  # without what is found from them

    @property
    def dimension(self) -> int:
        return self.xy.shape[1]

    @property
    def cell(self) -> Cell:
        """The reference cell of the facets."""
        return cell_with(self.facets.shape[1], self.dimension - 1)

    @property
    def corners(self) -> np.ndarray:
        """(f, c) the nodes at the corners of the facets."""
        return self.facets[:, : self.cell.corners]

    @property
    def simplices(self) -> np.ndarray:
        """(f', d) the nodes at the corners of the simplices into which the facets are cut, first parts first."""
        return self.cell.straight.split(self.corners)

    def on_facets(self, simplex: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The facets (q,) of some `simplices` (q,), and the hats (q, c) of their corners at points with barycentric
        coordinates `at` (q, d) in these: of a quadrilateral by the inverse of its bilinear map, along its normal."""
        facet = simplex % len(self.facets)
        if self.cell.simplex:
            return facet, at
        place = np.einsum("qc,qcd->qd", at, self.xy[self.simplices[simplex]])
        return facet, bilinear(place, self.xy[self.corners[facet]], self.outward[facet])

    def among(self, numbers: np.ndarray) -> np.ndarray:
        """(f,) bool, which facets are among these `numbers`."""
        among = np.zeros(len(self.facets), bool)
        among[numbers] = True
        return among

    def shifted(self, shift: np.ndarray, body: str) -> Side:
        """The side of a body of this name that is elsewhere, by a shift (d,) in metres."""
        other = replace(self, body=body, xy=shift + self.xy)
        vars(other).update({name: getattr(self, name) for name in (*self.KEPT, *self.TURNS)})
        return other

    def placed(self, frame: Frame, reach: float | None = None) -> Side:
        """The side where a frame has taken its body; overlaps are looked for up to a depth of `reach` (m), or by the
        thickness of bodies."""
        turned, free = frame.turned, frame.turned @ self.free @ frame.turned.T
        # `cover` looks as deep as half of the thinner body's extent
        extent = self.extent if reach is None else np.full(self.dimension, 2.0 * reach)
        placed = replace(
            self,
            xy=frame.at(self.xy),
            normal=self.normal @ turned.T,
            free=free,
            extent=extent,
            moved={name: u @ turned.T for name, u in self.moved.items()},
        )
        # Shapes are found once, in the body's frame; a load step only turns them.
        vars(placed).update(
            {name: getattr(self, name) for name in self.KEPT},
            **{name: getattr(self, name) @ turned.T for name in self.TURNS},
        )
        return placed

    def moves_with(self, transfer: sparse.csr_matrix) -> np.ndarray:
        """M (r, d, d): rows of a transfer (r, k) move by M e where all nodes move by e, projected by their clamps."""
        return (transfer @ self.free.reshape(len(self.free), -1)).reshape(-1, *self.free.shape[1:])

    @cached_property
    def lengths(self) -> np.ndarray:
        """(f,) lengths or areas of the facets (m or m²)."""
        return facet_measures(self.xy[self.facets])

    @property
    def bare(self) -> np.ndarray:
        """(k,) bool, nodes on an axis of revolution with vanishing integrals of their shape functions: of order 2."""
        return (self.xy[:, 0] == 0.0) & (self.axisymmetric and self.cell.mass[0, 1] == 0.0)

    @cached_property
    def areas(self) -> np.ndarray:
        """(f,) lengths or areas of the facets, around an axis areas of revolution (m or m²)."""
        return facet_measures(self.xy[self.facets], self.axisymmetric)

    @cached_property
    def outward(self) -> np.ndarray:
        """(f, d) outer unit normal of each facet's chord, or of the triangle of its corners."""
        return unit(normals(self.xy[self.corners]))

    @property
    def flat(self) -> np.ndarray:
        """(f', d) outer unit normals of the `simplices`."""
        return self.outward if self.cell.simplex else unit(normals(self.xy[self.simplices]))

    @cached_property
    def spacing(self) -> np.ndarray:
        """(k,) mean distance of each node to its neighbours (m)."""
        pairs = links(self.facets, self.dimension)
        distance = magnitude(self.xy[pairs[:, 1]] - self.xy[pairs[:, 0]])
        number = np.bincount(pairs.ravel(), minlength=len(self.nodes))
        return np.bincount(pairs.ravel(), np.repeat(distance, 2), len(self.nodes)) / number

    @property
    def fans(self) -> np.ndarray:
        """(f', d, d) unit normals at the corners of the simplices, shared by all that meet at less than SHARPEST."""
        raise NotImplementedError

    def bulge(self, facets: np.ndarray, at: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Distance (q,) of the smooth boundary from its chords, or plane triangles, outward (m).

        It is measured along unit vectors `direction` (q, d) from places on facets (q,), in space `simplices`: in the
        plane `at` (q,) from 0 at the first end to 1 at the second, in space at barycentric coordinates `at` (q, 3).
        """
        raise NotImplementedError

    def rise(self, nodes: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """Distance (q,) of the smooth boundary from nodes (q,), along vectors (q, d) (m).

        Corners lie on it, and all rows in space are at corners; middles lie on the chord or, if the facet is curved,
        near the smooth boundary.
        """
        return np.zeros(len(nodes))

    def pieces(self, some: np.ndarray) -> np.ndarray:
        """Straight facets (·, d) between the nodes of the facets marked by `some` (f,) bool."""
        raise NotImplementedError

    def lengths_over(self, some: np.ndarray) -> np.ndarray:
        """Nodal lengths (k,) over the facets marked by `some` (f,): integrals of the shape functions (m)."""
        facets = self.facets[some]
        return nodal(facet_shares(self.xy[facets], self.axisymmetric), facets, len(self.nodes))

    def normals_over(self, some: np.ndarray) -> np.ndarray:
        """Outer unit normals (k, d) averaged over the facets marked by `some` (f,); elsewhere those of the side."""
        facets = self.facets[some]
        total = unit(nodal(across(self.xy[facets]), facets, len(self.nodes)))
        return np.where(total.any(axis=1, keepdims=True), total, self.normal)


class Located(NamedTuple):
    """A side that alike bodies have in common, of a body without a name where their mesh is at home; and a body of this
    name that is elsewhere, by a shift (d,) in metres. The key is the same on all ranks for the same side."""

    side: Side
    key: str
    body: str
    shift: np.ndarray

    @property
    def there(self) -> Side:
        """The side of this body."""
        return self.side.shifted(self.shift, self.body)


def laplacian(
    xy: np.ndarray, facets: np.ndarray, row: np.ndarray, m: int, axisymmetric: bool = False
) -> sparse.csr_matrix:
    """Laplacian (m, m) of the hat functions of rows on facets between nodes at `xy` (k, d), in m^(d − 3).

    Facets (f, d) are straight simplices; those with middles, in space, have Bernstein polynomials in place of hats, see
    `by_coefficients` in interface/matching.py. Nodes with number j in `row` (k,) move with row j, those with −1 are fixed.
    Around an axis the integrals are weighted by `circumference`.
    """
    cell = cell_with(facets.shape[1], xy.shape[1] - 1)
    if cell.linear:
        along = xy[facets[:, 1:]] - xy[facets[:, :1]]
        gram, order = along @ along.transpose(0, 2, 1), along.shape[1]
        slopes = np.vstack([-np.ones(order), np.eye(order)])
        measures = (
            np.sqrt(np.linalg.det(gram))
            / factorial(order)
            * circumference(xy[facets].mean(axis=1), axisymmetric)
        )
        # ∫ ∇φ_i · ∇φ_j of linear functions on a simplex: slopes G⁻¹ slopesᵀ |T|, with the Gram matrix G of its edges.
        local = slopes @ np.linalg.inv(gram) @ slopes.T * measures[:, None, None]
    else:
        local = _of_coefficients(xy[facets], cell)
    one, other = np.broadcast_arrays(row[facets][:, :, None], row[facets][:, None, :])
    moves = (one >= 0) & (other >= 0)
    return sparse.csr_matrix((local[moves], (one[moves], other[moves])), (m, m))


def _of_coefficients(points: np.ndarray, cell: Cell) -> np.ndarray:
    """∫ ∇b_i · ∇b_j (f, k, k) over quadratic facets with nodes (f, k, 3): b_i = φ_i + ¼ Σ φ_m of corners with the middles
    beside them, ½ φ_m of middles."""
    change = np.eye(len(cell.nodes))
    for start, end, middle in cell.edges:
        change[[start, end], middle] = 0.25
        change[middle, middle] = 0.5
    where, weights = cell.rule
    slopes = cell.derivatives(where) @ change.T
    along = np.einsum("aqk,fkd->fqad", cell.derivatives(where), points)
    gram = along @ along.transpose(0, 1, 3, 2)
    size = weights * np.sqrt(np.linalg.det(gram)) / prod(map(factorial, cell.shape.factors))
    return np.einsum(
        "fq,aqi,fqab,bqj->fij", size, slopes, np.linalg.inv(gram), slopes, optimize=True
    )


def bilinear(places: np.ndarray, corners: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """The hats (q, 4) at places (q, 3) of quadrilaterals with `corners` (q, 4, 3), seen along a `normal` (q, 3): by
    Newton's method from the middle."""
    cell = BRICKS[2, 1]
    at = np.full((len(places), 2), 0.5)
    for _ in range(NEWTON):
        hats = cell.hats_at(cell.coordinates(at))
        off = places - np.einsum("qc,qcd->qd", hats, corners)
        one, two = np.einsum("aqc,qcd->aqd", cell.derivatives(hats), corners)
        area = dot(normal, np.cross(one, two))
        step = np.stack([np.cross(off, two), np.cross(one, off)], axis=1) @ normal[:, :, None]
        at = at + step[:, :, 0] / area[:, None]
        if np.abs(step[:, :, 0]).max(initial=0.0) <= ROUNDING * np.abs(area).min(initial=np.inf):
            break
    return cell.hats_at(cell.coordinates(at))


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (…, d) over their lengths; zero stays zero."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / divisor(size)


def frames(normal: np.ndarray) -> np.ndarray:
    """Unit vectors (k, d, d) at places with unit normals (k, d): normal, then tangents.

    In the plane the tangent is to the left of the normal. In space the three are right-handed: the shortest rotation of
    the mean normal onto a normal carries the tangents along, so that those of neighbours are nearly equal.
    """
    if normal.shape[1] == 2:
        return np.stack([normal, normal[:, ::-1] * [-1.0, 1.0]], axis=1)
    mean = unit(normal.sum(axis=0))
    mean = mean if mean.any() else normal[0]
    first = unit(np.cross(mean, np.eye(3)[np.abs(mean).argmin()]))
    base, half = np.stack([first, np.cross(mean, first)]), unit(normal + mean)
    turned = (
        base - 2.0 * (base @ half.T).T[:, :, None] * half[:, None]
    )  # by reflections in the mean and in the half
    return np.concatenate([normal[:, None], turned], axis=1)


def nodal(values: np.ndarray, facets: np.ndarray, size: int) -> np.ndarray:
    """Sums (size, …) at nodes of values (f, c, …) at the nodes (f, c) of facets, or (f, …) at one node (f,) of each."""
    total = np.zeros((size, *values.shape[facets.ndim :]))
    np.add.at(total, facets, values)
    return total


def neighbours(facets: np.ndarray, size: int) -> sparse.csr_matrix:
    """(size, size) the neighbours of each node on facets (f, c) in space."""
    pairs = links(facets, 3)
    both = np.concatenate([pairs, pairs[:, ::-1]]).T
    return sparse.csr_matrix((np.ones(both.shape[1]), both), (size, size))


def across(facets: np.ndarray) -> np.ndarray:
    """Outer normals (s, l, d) at the nodes of facets (s, l, d), as long as ratios of measures there (m or m²)."""
    cell = facet_cell(facets)
    return cell.vectors(facets, cell.nodes).transpose(2, 1, 0)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The cross products (…) of vectors (…, 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The scalar products (…) of vectors (…, d)."""
    return np.einsum("...d,...d->...", a, b)
