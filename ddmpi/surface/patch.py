"""The contact boundary of a body in space, with a smooth surface over its plane triangles."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from ddmpi.mesh.boundary import SHARPEST
from ddmpi.surface.side import Side, dot, neighbours, nodal, unit
from ddmpi.system.numbers import ALIKE, SAME, divisor, spans, together

FEWEST = 5
"""Fewest neighbours of a fit: as many as a quadratic surface through a corner has coefficients."""

FITS = 3
"""Number of fits, each in the frame of the last normal."""


DETERMINED = 1e-4
"""A fit leaves out what its neighbours determine less, as an eigenvalue of its normal equations over the largest: at
corners of grids this is 4e-3 and more, at those of strips 5e-7 and less."""

SMOOTH = 5e-3
"""Greatest slope that corners on a smooth surface leave open, the root mean square of what they are off it over their
spread across a strip."""

LEANS = 0.5
"""Least cosine of the angle by which facets lean out of a smooth surface: beyond, they face no partner on it."""

BENT = 1e-8
"""Weight of the squares of curvatures, times lengths, beside those of what corners are off a quadric."""

SLENDER = 8.0
"""Neighbours that spread further by this factor along one axis than along the other count as if they did not."""


class Patch(Side):
    """The contact boundary of a body in space: triangles, of order 2 with the middles of their edges."""

    TURNS = ("outward", "fans")

    @cached_property
    def fans(self) -> np.ndarray:
        """Normals of a quadratic surface through a corner, fitted to its two rings of neighbours by least squares, also
        at the rim. With too few neighbours, and on both sides of an edge sharper than SHARPEST, the mean of the
        triangles' normals with weights that are exact on spheres (Max, J. Graphics Tools 4, 1999), unless corners are on a
        smooth surface out of which slender triangles lean.
        """
        xy, facets = self.xy, self.simplices
        corners = xy[facets]
        edges = np.roll(corners, -1, axis=1) - corners  # to the next corner
        outward, before = self.flat, -np.roll(edges, 1, axis=1)  # to the one before
        # Max's weight of a triangle at its corner: sin of the angle over the lengths of both edges, times the unit
        # normal.
        weighted = (
            np.cross(edges, before) / ((edges**2).sum(axis=2) * (before**2).sum(axis=2))[..., None]
        )
        node, facet = facets.ravel(), np.repeat(np.arange(len(facets)), 3)
        order = np.argsort(node, kind="stable")
        entry, place = together(node, node[order])
        met = order[place]
        # Triangles at a corner count together only up to SHARPEST, so that a sharp edge keeps a normal for either side.
        smooth = dot(outward[facet[entry]], outward[facet[met]]) > np.cos(SHARPEST)
        mean = unit(nodal(weighted.reshape(-1, 3)[met[smooth]], entry[smooth], len(node)))
        whole = np.ones(len(xy), bool)  # corners without sharp edges
        whole[node[entry[~smooth]]] = False
        if (np.abs(mean - outward[facet]).max(initial=0.0) <= ALIKE) or not whole.any():
            return mean.reshape(-1, 3, 3)
        at_node = np.zeros_like(xy)
        at_node[node] = mean
        fitted = _fitted(xy, facets, at_node, whole)
        others = ~fitted.any(axis=1)
        if others.any():
            outer = unit(nodal(outward[facet], node, len(xy)))
            fitted += _through_corners(xy, facets, outer, others)
        fitted = fitted[node]
        return np.where(fitted.any(axis=1, keepdims=True), fitted, mean).reshape(-1, 3, 3)

    def bulge(self, facets: np.ndarray, at: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The height of a sphere whose curvature κ is the mean of that of the corners' normals: exact on spheres."""
        normals = self.fans
        bent = np.abs(normals - normals.mean(axis=1, keepdims=True)).max(axis=(1, 2)) > ALIKE
        heights, some = np.zeros(len(facets)), np.flatnonzero(bent[facets])
        if not len(some):
            return heights
        facets, weight, ray = (
            facets[some],
            np.maximum(at[some], 0.0),
            direction[some],
        )  # κ is a mean
        x, n = self.xy[self.simplices[facets]], normals[facets]
        apart, turn = (
            np.roll(values, -1, axis=1) - values for values in (x, n)
        )  # to the next corner
        part = weight * np.roll(weight, -1, axis=1)
        # On a sphere Q = Σ w_i w_j |x_i − x_j|² is R² less the squared distance of the point from the centre, and
        # normals differ by κ (x_i − x_j): κ = K/Q, a mean over the edges weighted by the point.
        Q, K = (np.einsum("qc,qcd,qcd->q", part, apart, values) for values in (apart, turn))
        kappa = np.where(Q > 0.0, K / divisor(Q), 0.0)
        square = np.roll((apart**2).sum(axis=2), -1, axis=1)  # of the edge that a corner is not on
        share = square * (square.sum(axis=1, keepdims=True) - 2.0 * square)
        middle = np.einsum(
            "qc,qcd->qd", share / share.sum(axis=1, keepdims=True), x
        )  # of the circle through corners
        # κ times the distance of the plane from the centre, with the circle's radius by the distance of a corner.
        rest = np.sqrt(np.maximum(1.0 - kappa**2 * ((x[:, 0] - middle) ** 2).sum(axis=1), 0.0))
        place = np.einsum("qc,qcd->qd", weight, x) - middle
        beta = dot(ray, kappa[:, None] * place + rest[:, None] * self.flat[facets])
        # κ t² + 2 β t − κ Q = 0 for the distance t along the ray; its small root, without cancellation.
        below = beta + np.sqrt(np.maximum(beta**2 + kappa**2 * Q, 0.0))
        heights[some] = kappa * Q / np.where(below > 0.0, below, np.inf)
        return heights

    def pieces(self, some: np.ndarray) -> np.ndarray:
        """Triangles between corners."""
        return self.cell.straight.split(self.corners[some])


def in_places(
    facets: np.ndarray, points: np.ndarray, places: np.ndarray, _: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The nodes (k,) of facets by the `places` (nv, 3) of all nodes, and no arc lengths (nv,)."""
    nodes = np.unique(facets)
    return nodes[np.lexsort(places[nodes].T[::-1])], np.zeros(len(points))


def _fitted(
    xy: np.ndarray, facets: np.ndarray, normal: np.ndarray, whole: np.ndarray
) -> np.ndarray:
    """Normals (k, 3) of surfaces fitted at the corners marked by `whole` (k,); zero with too few neighbours, and where the
    fit leans more than the facets around do, as it may across a strip of very short ones."""
    nodes, row, other, away = _around(xy, facets, whole, whole, 3)
    normals = np.zeros_like(xy)
    if not len(nodes):
        return normals
    fitted = _surfaces(away, row, normal[nodes])[0]
    among = np.einsum("pd,pd->p", normal[other], normal[nodes[row]])
    least = np.minimum.reduceat(among, np.searchsorted(row, np.arange(len(nodes))))
    leans = np.einsum("nd,nd->n", fitted, normal[nodes]) < least - ALIKE
    normals[nodes] = np.where(leans[:, None], 0.0, fitted)
    return normals


def _around(
    xy: np.ndarray, facets: np.ndarray, some: np.ndarray, whole: np.ndarray, rings: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The corners (n,) among `some` (k,) with neighbours enough; and these: of which corner (p,), their numbers (p,), and the
    way there (p, 3). They are in two rings, of few in up to so many `rings`, which go on at `whole` (k,) corners alone."""
    fewest = FEWEST + 2 * (rings - 3)
    near = neighbours(facets, len(xy))
    ring = near @ sparse.diags(1.0 * whole)
    near = near + ring @ near
    for _ in range(2, rings):
        few = near.getnnz(axis=1) <= fewest
        near = near + sparse.diags(1.0 * few) @ (ring @ near)
    near = (near - sparse.diags(near.diagonal())).tocsr()
    near.eliminate_zeros()
    nodes = np.flatnonzero(some & (near.getnnz(axis=1) >= fewest))
    row, place = spans(near.indptr[nodes], near.indptr[nodes + 1])
    other = near.indices[place]
    return nodes, row, other, xy[other] - xy[nodes[row]]


def _surfaces(
    away: np.ndarray, row: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Surfaces through corners, fitted to the neighbours `away` (p, 3) of the corners `row` (p,) in frames that begin with a
    `normal` (n, 3): their normals (n, 3), the slopes (n,) that neighbours leave open, and the turns (p,) to neighbours."""
    fitted = normal
    for _ in range(FITS):
        axes, spread = _principal(away, row, fitted)
        a, b, c = np.einsum("pd,pid->ip", away, axes[row])
        c = c / (1.0 + c * c / (a * a + b * b))  # a section that is an arc has c = κ (ρ² + c²) / 2
        a, b = a / spread[row, 0], b / spread[row, 1]
        terms = np.stack([a, b, a * a, a * b, b * b], axis=1)
        squares = nodal(terms[:, :, None] * terms[:, None], row, len(normal))
        right = nodal(terms * c[:, None], row, len(normal))
        fit = _least_bent(squares, right, spread)
        slopes = fit[:, :2] / spread
        fitted = unit(
            np.einsum("ni,nid->nd", np.column_stack([-slopes, np.ones(len(normal))]), axes)
        )
    off = c - np.einsum("pi,pi->p", terms, fit[row])
    left = np.sqrt(np.bincount(row, off * off) / np.bincount(row)) / spread.min(axis=1)
    bent = fit[row, 2:]
    turns = np.hypot(
        (2.0 * bent[:, 0] * a + bent[:, 1] * b) / spread[row, 0],
        (bent[:, 1] * a + 2.0 * bent[:, 2] * b) / spread[row, 1],
    )
    return fitted, left, turns


def _through_corners(
    xy: np.ndarray, facets: np.ndarray, normal: np.ndarray, some: np.ndarray
) -> np.ndarray:
    """Normals (k, 3) at `some` (k,) corners of smooth surfaces through them and their neighbours, whichever way facets lean
    out of these: slender ones lean at will, and their `normal` (k, 3), a mean, only tells the outer side. Zero where
    corners are on no such surface: off it by more than SMOOTH, or it turns to a corner beside as at a true edge,
    or the mean leans out of it by more than LEANS."""
    nodes, row, other, away = _around(xy, facets, some, np.ones(len(xy), bool), 4)
    normals = np.zeros_like(xy)
    if not len(nodes):
        return normals
    fitted, left, turns = _surfaces(away, row, _of_quadrics(away, row, normal[nodes]))
    beside = np.asarray(neighbours(facets, len(xy))[nodes[row], other]).ravel() > 0.0
    turn = np.maximum.reduceat(turns * beside, np.searchsorted(row, np.arange(len(nodes))))
    smooth = (left < SMOOTH) & (turn < np.tan(0.75 * SHARPEST))
    smooth &= dot(fitted, normal[nodes]) > LEANS
    normals[nodes[smooth]] = fitted[smooth]
    return normals


def _of_quadrics(away: np.ndarray, row: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """Unit normals n (k, 3), on the side of `normal` (k, 3), of the least bent quadrics n·x = xᵀ S x / 2 through corners and
    their neighbours `away` (p, 3), of node `row` (p,): n is the least eigenvector of what the best S leaves of x xᵀ."""
    size = np.sqrt(np.bincount(row, (away**2).sum(axis=1)) / np.bincount(row))
    x, y, z = (away / size[row, None]).T
    root = np.sqrt(2.0)
    squares = np.stack([x * x, y * y, z * z, root * x * y, root * y * z, root * z * x], axis=1)
    along = np.stack([x, y, z], axis=1)

    def sums(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        return nodal(one[:, :, None] * other[:, None], row, len(normal))

    mixed = sums(squares, along)
    bend = sums(squares, squares) + BENT * np.eye(6)
    left = sums(along, along) - mixed.swapaxes(1, 2) @ np.linalg.solve(bend, mixed)
    found = np.linalg.eigh(left)[1][:, :, 0]
    return np.where(np.einsum("nd,nd->n", found, normal)[:, None] < 0.0, -found, found)


def _principal(
    away: np.ndarray, row: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Axes (k, 3, 3) of frames with a `normal` (k, 3), the first two along which the neighbours `away` (p, 3) of node `row`
    (p,) spread least and most, and their root mean squares (k, 2): a fit in them is the same on slender facets."""
    first = unit(np.cross(normal, np.eye(3)[np.abs(normal).argmin(axis=1)]))
    plane = np.stack([first, np.cross(normal, first)], axis=1)
    along = np.einsum("pd,pid->pi", away, plane[row])
    squares = nodal(along[:, :, None] * along[:, None], row, len(normal))
    values, vectors = np.linalg.eigh(squares / np.bincount(row)[:, None, None])
    axes = np.concatenate([vectors.transpose(0, 2, 1) @ plane, normal[:, None]], axis=1)
    return axes, np.sqrt(np.maximum(values, SAME * values[:, 1:]))


def _least_bent(squares: np.ndarray, right: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """The coefficients (k, 5) of the least bent of the surfaces that fit equally well, by normal equations (k, 5, 5) and
    (k, 5) of a, b, a², ab, b² over `spread` (k, 2): a strip of one facet across does not determine the curvature along it."""
    scale = np.sqrt(np.einsum("nii->ni", squares))
    values, vectors = np.linalg.eigh(squares / (scale[:, :, None] * scale[:, None]))
    known = values > DETERMINED * values[:, -1:]
    parts = np.einsum("nij,ni->nj", vectors, right / scale) / np.where(known, values, np.inf)
    fit = np.einsum("nij,nj->ni", vectors, parts)
    # the root of half the squares of the second derivatives, which does not depend on the axes; along slender facets it
    # would hardly count
    a, none = spread[:, 0], np.zeros(len(spread))
    b = np.minimum(spread[:, 1], SLENDER * a)
    bent = np.stack([none, none, 1 / a**2, 1 / (np.sqrt(2.0) * a * b), 1 / b**2], axis=1) / scale
    free = vectors * ~known[:, None]
    most = bent.max(axis=1)[:, None]
    back = np.linalg.pinv((bent / most)[:, :, None] * free) @ (bent / most * fit)[:, :, None]
    return (fit - (free @ back)[..., 0]) / scale
