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

SLENDER = 8.0
"""Neighbours that spread further by this factor along one axis than along the other count as if they did not."""


class Patch(Side):
    """The contact boundary of a body in space: triangles, of order 2 with the middles of their edges."""

    TURNS = ("outward", "fans")

    @cached_property
    def fans(self) -> np.ndarray:
        """Normals of a quadratic surface through a corner, fitted to its two rings of neighbours by least squares, also
        at the rim. With too few neighbours, and on both sides of an edge sharper than SHARPEST, the mean of the
        triangles' normals with weights that are exact on spheres (Max, J. Graphics Tools 4, 1999).
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
        fitted = _fitted(xy, facets, at_node, whole)[node]
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
    """Normals (k, 3) of surfaces fitted at the corners marked by `whole` (k,); zero with too few neighbours."""
    near = neighbours(facets, len(xy))
    ring = near @ sparse.diags(1.0 * whole)
    near = near + ring @ near
    near = near + sparse.diags(1.0 * (near.getnnz(axis=1) <= FEWEST)) @ (
        ring @ near
    )  # of few, a third ring
    near = (near - sparse.diags(near.diagonal())).tocsr()
    near.eliminate_zeros()
    normals, nodes = np.zeros_like(xy), np.flatnonzero(whole & (near.getnnz(axis=1) >= FEWEST))
    if not len(nodes):
        return normals
    row, place = spans(near.indptr[nodes], near.indptr[nodes + 1])
    away, fitted = xy[near.indices[place]] - xy[nodes[row]], normal[nodes]
    for _ in range(FITS):
        axes, spread = _principal(away, row, fitted)
        a, b, c = np.einsum("pd,pid->ip", away, axes[row])
        c = c / (1.0 + c * c / (a * a + b * b))  # a section that is an arc has c = κ (ρ² + c²) / 2
        a, b = a / spread[row, 0], b / spread[row, 1]
        terms = np.stack([a, b, a * a, a * b, b * b], axis=1)
        squares = nodal(terms[:, :, None] * terms[:, None], row, len(nodes))
        right = nodal(terms * c[:, None], row, len(nodes))
        slopes = _least_bent(squares, right, spread)[:, :2] / spread
        fitted = unit(
            np.einsum("ni,nid->nd", np.column_stack([-slopes, np.ones(len(nodes))]), axes)
        )
    # across a strip of very short facets fits may lean at will: no surface leans more than the facets around do
    among = np.einsum("pd,pd->p", normal[near.indices[place]], normal[nodes[row]])
    least = np.minimum.reduceat(among, np.searchsorted(row, np.arange(len(nodes))))
    leans = np.einsum("nd,nd->n", fitted, normal[nodes]) < least - ALIKE
    normals[nodes] = np.where(leans[:, None], normal[nodes], fitted)
    return normals


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
