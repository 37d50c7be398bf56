"""Rows of contacts in space, which stand at the nodes of the slave's facets, of order 1 and 2 alike.

With Bernstein's polynomials φ_j of the nodes (hat functions in order 1; λ_i² and 2 λ_i λ_j in order 2), functions ψ_j
dual to them over the covered part of each facet, and the functions θ_j of the rows,

    ∫ ψ_j φ_k = δ_jk ∫ φ_j,   D_j = ∫ θ_j,
    row j: u ↦ n_j · D_j⁻¹ ∫ θ_j (u of the slave − u of what it faces),   gap_j = D_j⁻¹ ∫ θ_j gap

(Wohlmuth, SIAM J. Numer. Anal. 38, 2000). Unlike shape functions of order 2, whose integrals vanish at corners, these
polynomials are positive, so that a pressure acts on all nodes (the purpose of the transformed basis of Popp, Wohlmuth,
Gee, Wall, SIAM J. Sci. Comput. 34, 2012); and as they reproduce linear functions, ∫ ψ_j x = D_j x_j: the force of row j
acts at its node. A node whose constraint would nearly depend on others shares its function among its neighbours,
θ_j = ψ_j + Σ a_dj ψ_d, so that the θ sum to one and constant stresses are exact.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.interface import Lines
from ddmpi.interface.rows import Rows, at_points, between, duals, holds_along, inset, is_held, rows_of
from ddmpi.mesh.boundary import creases, links
from ddmpi.scene.contacts import SettledContact
from ddmpi.surface.cut import Cover
from ddmpi.surface.side import Side, nodal

SLIVER = 1e-6
"""The dual functions of a facet of which a smaller part is covered are constants."""

UNCOVERED = 0.15
"""A vertex, in the plane a node, of which less is covered shares its function; else its gap would be outside of it."""

BARELY = 0.499
"""So does one that clamps let move by less than this, where free ones move by one: alone it would constrain curvature
and carry arbitrary forces. Meshes of 2 : 1 have rows that move by one half, which rounding must not decide."""

FLAT = 1e-3
"""Places within this part of their extent beside a line count as on it."""


def rows_at_vertices(sides: tuple[Side, Side], own: int, over: Cover, looked: Cover, contact: SettledContact) -> Rows:
    """The rows of the slave, `sides[own]`, which faces the other at the points of `over`; `looked` are places where
    overlaps of the answer are looked for. Not collective."""
    side, other = sides[own], sides[1 - own]
    seen, met = np.isin(np.arange(len(side.facets)), over.facet), np.zeros(len(side.nodes), bool)
    count = side.facets.shape[1]
    weighted = duals(side, over, side.cell.bernstein(inset(over, looked)), SLIVER, 1.0 / count)
    psi = at_points(weighted, side.facets[over.facet], len(met))
    full = nodal(np.repeat(side.lengths[:, None] / count, count, axis=1), side.facets, len(met))  # ∫ of the polynomials
    met[side.facets[seen]] = True
    D = np.asarray(psi.sum(axis=0)).ravel()
    shares = (UNCOVERED * full > D) | ~side.free.any(axis=(1, 2))
    also = shares | _meets_others(side, D, full)
    if _spread(side.xy[~also & met]):  # else rows in a line would be a hinge, which the bodies do not have
        shares = also
    shares[~met] = False
    pairs, size = links(side.pieces(seen), 3), len(side.nodes)
    near = sparse.csr_matrix((np.ones(2 * len(pairs)), np.concatenate([pairs, pairs[:, ::-1]]).T), (size, size))
    across = -at_points(over.there, other.corners[over.other], len(other.nodes)) @ other.normal
    if np.isfinite(other.modulus):  # that of a rigid partner counts alone
        across += at_points(over.at, side.corners[over.facet], len(met)) @ side.normal
    rows = rows_of(sides, own, over, psi, _shared(met, shares, near), across)
    held = _hardly_move(rows)
    if holds_along(contact) and np.isfinite(other.modulus):
        held |= _held_along_rim(rows)
    if held.any() and not held.all():
        shares[rows.nodes[held]] = True
        rows = rows_of(sides, own, over, psi, _shared(met, shares, near), across)
    kept = (rows.place[side.facets] >= 0).all(axis=1)
    lines = Lines(np.arange(len(rows.nodes)), side.xy[rows.nodes], rows.area, rows.place[side.pieces(seen & kept)],
                  rows.transfers[own] @ side.xy)
    return replace(rows, whole=rows.whole & kept, lines=lines, points=between(sides, own, looked))


def _meets_others(side: Side, D: np.ndarray, full: np.ndarray) -> np.ndarray:
    """Which vertices (k,) other contacts of the body have as well: on the rim of their group, where another one's
    group begins, and, where other contacts are on the same group, where what this one covers (k,) of all (k,) ends.
    """
    rim = np.zeros(len(side.nodes), bool)
    pieces = side.pieces(np.ones(len(side.facets), bool))
    rim[creases(side.xy, pieces, np.tile(side.outward, (len(side.cell.parts), 1))).rim] = True
    partly = (1.0 - UNCOVERED) * full > D
    return (rim & side.tied) | (partly & side.parted)


def _spread(xy: np.ndarray) -> bool:
    """Whether places (k, 3) are more than a point or a line, so that forces there bear moments about any axis."""
    if len(xy) < 3:
        return False
    sizes = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
    return bool(sizes[1] > FLAT * sizes[0])


def _shared(vertices: np.ndarray, shares: np.ndarray, links: sparse.csr_matrix) -> sparse.csr_matrix:
    """(k, k) the part of each vertex's function that each vertex has: of those that share (k,) bool, their neighbours
    by `links` (k, k), level by level where no neighbour keeps a row. Columns sum to one."""
    keeps = vertices & ~shares
    parts = sparse.diags(1.0 * keeps).tocsr()
    done, left = keeps.copy(), vertices & shares
    while left.any():
        near = (sparse.diags(1.0 * done) @ links).tocsc()  # rows: neighbours that are done
        near.eliminate_zeros()
        number = np.diff(near.indptr)
        now = left & (number > 0)
        if not now.any():  # a contact of vertices none of which can stand alone
            return sparse.diags(1.0 * vertices).tocsr()
        average = near @ sparse.diags(np.where(now, 1.0 / np.maximum(number, 1), 0.0))
        parts = parts + parts @ average
        done, left = done | now, left & ~now
    return parts.tocsr()


def _hardly_move(rows: Rows) -> np.ndarray:
    """Which rows (r,) clamps of a side hardly let move along the normal."""
    moves = [side.moves_with(transfer) for side, transfer in zip(rows.sides, rows.transfers, strict=True)]
    axes = np.linalg.eigh(sum(each + each.swapaxes(1, 2) for each in moves))[1]
    most = np.max([np.linalg.norm(each @ axes, axis=1) for each in moves], axis=0)
    along = np.einsum("rd,rdk->rk", rows.normal, axes)
    return np.linalg.norm(along * np.minimum(most, 1.0), axis=1) < BARELY


def _held_along_rim(rows: Rows) -> np.ndarray:
    """Which rows (r,) have a vertex on an edge of the slave's rim along which one clamp holds both ends: shear goes
    through there, unlike through a plane of symmetry."""
    side = rows.sides[rows.own]
    edges = np.sort(side.pieces(rows.seen)[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, number = np.unique(edges, axis=0, return_counts=True)
    edges = edges[number == 1]
    along = side.xy[edges[:, 1]] - side.xy[edges[:, 0]]
    along /= np.linalg.norm(along, axis=1)[:, None]
    first, second = edges.T
    both = is_held(along, side.free[first]) & is_held(along, side.free[second])
    axis, each = np.abs(along).argmax(axis=1), np.arange(len(edges))  # one cell between two planes is no such edge
    both &= side.clamps[first][each, axis] == side.clamps[second][each, axis]
    return np.isin(rows.nodes, edges[both])
