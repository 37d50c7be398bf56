"""Rows of contacts in space, which stand at the vertices of the slave's facets, of order 1 and 2 alike.

With the hat functions φ_j of the vertices, functions ψ_j dual to them over the covered part of each facet, and the
functions θ_j of the rows,

    ∫ ψ_j φ_k = δ_jk ∫ φ_j,   D_j = ∫ θ_j,
    row j: u ↦ n_j · D_j⁻¹ ∫ θ_j (u of the slave − u of what it faces),   gap_j = D_j⁻¹ ∫ θ_j gap

(Wohlmuth, SIAM J. Numer. Anal. 38, 2000; Popp, Wohlmuth, Gee, Wall, SIAM J. Sci. Comput. 34, 2012). As hats reproduce
linear functions, ∫ ψ_j x = D_j x_j: the force of row j acts at its vertex, and where a facet is covered partly at the
place that `inset` gives it. On quadratic sides ψ is smoothed, see `_smoothed`, and a vertex that clamps fix wholly
keeps its row with ψ = φ. Bonds, which have no active set, take φ itself for ψ; where their meshes match they have rows
at all nodes (`matching.by_coefficients`). A vertex whose constraint would nearly depend on others gets no row of its
own: its function is shared among its neighbours, θ_j = ψ_j + Σ a_dj ψ_d, so that the θ sum to one and constant stresses
are exact.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.interface import Lines
from ddmpi.interface.rows import (
    LACKING,
    Rows,
    at_points,
    between,
    duals,
    holds_along,
    inset,
    is_held,
    rows_of,
)
from ddmpi.mesh.boundary import creases
from ddmpi.mesh.elements import facet_shares
from ddmpi.scene.contacts import SettledContact
from ddmpi.sets import magnitude
from ddmpi.surface.cut import Cover
from ddmpi.surface.side import Side, neighbours, nodal
from ddmpi.system.matrices import on_diagonal, scaled
from ddmpi.system.numbers import SAME

UNCOVERED, STRIP = 0.15, 0.35
"""A node shares its function if less than this fraction of it is covered, as its row would nearly depend on others: in
the plane UNCOVERED of its length; in space STRIP of its hat on the facets that face the other side. So a contact that
ends more than about a third into a facet has rows at its end, about which bodies tip. With a STRIP of 0.15 random
scenes take a tenth more products, and below 0.3 Newton's method fails on one of them (217)."""

BARELY = 0.499
"""A vertex also shares its function if its row moves by less than this where free nodes move by one: such a row would
constrain curvature and carry arbitrary forces. On meshes of 2 : 1 rows move by one half, just above this limit."""

SMOOTHING = 8.0
"""The number a of `_smoothed`. Errors of the force of two boxes of 3 and 4 cells, and of the displacement of a stack of
cubes of 3 cells: 0.3 and 2.6 % with ψ itself, 0.04 and 3.0 % with a = 3.6, the smoothest, 0.05 and 0.9 % with a = 8.
With 14 the stack is too soft by 5 %."""

FLAT = 1e-3
"""Places are collinear if they deviate from a line by less than this fraction of their extent."""


def rows_at_vertices(
    sides: tuple[Side, Side], slave: int, over: Cover, looked: Cover, contact: SettledContact
) -> Rows:
    """The rows of the slave, `sides[slave]`, which faces the other side at the points of `over`. At the points `looked`
    the answer will be checked for overlaps. Not collective."""
    side, other, size = sides[slave], sides[1 - slave], len(sides[slave].nodes)
    seen, met = side.among(over.facet), np.zeros(size, bool)
    met[side.corners[seen]] = True
    # A row at a wholly clamped vertex of quadratic facets constrains the middles beside it.
    clamped, quadratic = ~side.free.any(axis=(1, 2)), not (contact.two_sided or side.cell.bears)
    kept, hats = clamped & quadratic, over.at if contact.two_sided else inset(side, over, looked)
    psi = over.weight[:, None] * hats
    if not contact.two_sided:
        psi = duals(side, over, hats, SAME, 1.0 / hats.shape[1], kept[side.corners])
    psi = at_points(psi, side.corners[over.facet], size)
    integrals = np.asarray(psi.sum(axis=0)).ravel()
    dual = mix = sparse.identity(size, format="csr")
    if quadratic:
        psi, dual, mix = _smoothed(side, over, psi, hats, kept)
    shares = met & _sharing(side, over, integrals, met, clamped, kept)
    near = neighbours(side.corners[seen], size)
    across = -at_points(over.there, other.corners[over.other], len(other.nodes)) @ other.normal
    if np.isfinite(other.modulus):  # else the rigid partner's normal alone
        across += at_points(over.at, side.corners[over.facet], size) @ side.normal
    points = between(sides, slave, over)

    def shared() -> Rows:
        coefficients = _shared(met, shares, near)
        return rows_of(
            sides, slave, over, psi, coefficients @ mix, across, points, coefficients @ dual
        )

    rows = shared()
    # The rows tell which of them clamps nearly fix; then they are made again without these vertices.
    fixed = _hardly_move(rows)
    if holds_along(contact) and np.isfinite(other.modulus):
        fixed |= _fixed_along_rim(rows)
    fixed &= ~kept[rows.nodes]
    if fixed.any() and not fixed.all():
        shares[rows.nodes[fixed]] = True
        rows = shared()
    facets = rows.place[side.corners]
    complete = (facets >= 0).all(axis=1)
    row, xy, at = np.arange(len(rows.nodes)), side.xy[rows.nodes], rows.transfers[slave] @ side.xy
    return replace(
        rows,
        whole=rows.whole & complete,
        lines=Lines(row, xy, rows.area, side.cell.straight.split(facets[seen & complete]), at),
        points=between(sides, slave, looked),
        waves=quadratic,
    )


def _sharing(
    side: Side,
    over: Cover,
    integrals: np.ndarray,
    met: np.ndarray,
    clamped: np.ndarray,
    kept: np.ndarray,
) -> np.ndarray:
    """Vertices (k,) that share their functions, if enough rows remain: those with small `integrals` (k,), those that
    are wholly `clamped` (k,), and those of other contacts; none that is `kept` (k,)."""
    corners, size = side.corners, len(met)
    areas = facet_shares(side.xy[corners])
    areas *= (side.lengths / areas.sum(axis=1))[:, None]
    seen = side.among(over.facet)
    # ∫ of hats over all facets, over those that are seen, and over what is covered
    full, faced = nodal(areas, corners, size), nodal(areas[seen], corners[seen], size)
    D = nodal(over.weight[:, None] * over.at, corners[over.facet], size)
    held = clamped & ~kept
    shares = (STRIP * faced > integrals) | held
    if not _spread(side.xy[~shares & met]):
        # the contact is small beside the facets: its own size counts
        shares = (UNCOVERED * integrals.max() > integrals) | held
    also = shares | (_meets_others(side, D, full) & ~kept)
    # rows along a line would be a hinge that the scene does not have
    if _spread(side.xy[~also & met]):
        shares = also
    return shares


def _smoothed(
    side: Side, over: Cover, psi: sparse.csr_matrix, hats: np.ndarray, kept: np.ndarray
) -> tuple[sparse.csr_matrix, sparse.csr_matrix, sparse.csr_matrix]:
    """Functions (q, 3 k) at the points, times the weights; and two matrices (k, 3 k) that make of them the dual
    functions `psi` (q, k) of quadratic facets, and smoother ones, with smaller jumps between facets.

    On the facets that are wholly covered, with the hats φ that are not `kept` (k,), M = ∫ φ φᵀ and D = diag M 1,

        ψ + T (φ − M D⁻¹ ψ),   T = a 1 + (1 − a) M D⁻¹,

    are dual to φ for any a, as ∫ (φ − M D⁻¹ ψ) φᵀ = 0, and sum to one, as ψ, φ and the columns of M D⁻¹ do. T = D M⁻¹
    would make them continuous; this T reaches two rings of neighbours, and needs no inverse. The eigenvalues of M D⁻¹
    lie between 1/4 and 1 on triangles of any shape. Gaps are measured with ψ itself, which is less sensitive to the
    shape of curved sides between vertices.
    """
    one, corners = sparse.identity(len(side.nodes), format="csr"), side.corners[over.facet]
    covered = np.bincount(over.facet, over.weight, len(side.facets))
    inside = (covered >= (1.0 - LACKING) * side.areas)[over.facet]
    phi = at_points(hats * (inside[:, None] & ~kept[corners]), corners, len(side.nodes))
    phi.eliminate_zeros()
    weighted = scaled(phi, over.weight)
    M = (weighted.T @ phi).tocsr()
    D = np.asarray(M.sum(axis=1)).ravel()
    turn = scaled(M, columns=np.divide(1.0, D, out=np.zeros(len(D)), where=D > 0.0))
    T = SMOOTHING * one + (1.0 - SMOOTHING) * turn
    return (
        sparse.hstack([psi, scaled(psi, inside), weighted], format="csr"),
        sparse.hstack([one, sparse.csr_matrix((len(D), 2 * len(D)))], format="csr"),
        sparse.hstack([one, -T @ turn, T], format="csr"),
    )


def _meets_others(side: Side, D: np.ndarray, full: np.ndarray) -> np.ndarray:
    """Vertices (k,) that other contacts of the body use too: those on the rim of the group where another group begins;
    and, if other contacts have the same group, those where the covered part ends (`D` (k,) less than `full` (k,)).
    """
    rim = np.zeros(len(side.nodes), bool)
    rim[creases(side.xy, side.corners, side.outward).rim] = True
    partly = (1.0 - UNCOVERED) * full > D
    return (rim & side.tied) | (partly & side.parted)


def _spread(xy: np.ndarray) -> bool:
    """Whether places (k, 3) span more than a line, so that forces at them balance moments about any axis."""
    if len(xy) < 3:
        return False
    sizes = np.linalg.svd(xy - xy.mean(axis=0), compute_uv=False)
    return bool(sizes[1] > FLAT * sizes[0])


def _shared(
    vertices: np.ndarray, shares: np.ndarray, links: sparse.csr_matrix
) -> sparse.csr_matrix:
    """(k, k) the share that a vertex (row) takes of the functions of all vertices (columns): neighbours by `links`
    (k, k) evenly share those that `shares` (k,) marks, level by level where none keeps a row. Columns sum to one."""
    keeps = vertices & ~shares
    coefficients = on_diagonal(1.0 * keeps)
    done, left = keeps.copy(), vertices & shares
    while left.any():
        near = scaled(links, 1.0 * done).tocsc()  # rows: neighbours that are done
        near.eliminate_zeros()
        number = np.diff(near.indptr)
        now = left & (number > 0)
        if not now.any():  # all vertices would share: then all keep their rows
            return on_diagonal(1.0 * vertices)
        # A vertex of this level gives equal parts to its neighbours of earlier levels, which pass them on.
        average = scaled(near.tocsr(), columns=np.where(now, 1.0 / np.maximum(number, 1), 0.0))
        coefficients = coefficients + coefficients @ average
        done, left = done | now, left & ~now
    return coefficients.tocsr()


def _hardly_move(rows: Rows) -> np.ndarray:
    """Rows (r,) that the clamps of the sides nearly fix along the normal."""
    moves = [
        side.moves_with(transfer) for side, transfer in zip(rows.sides, rows.transfers, strict=True)
    ]
    # A row moves by M e where free nodes move by e. Along each common axis of both M, a row can move as far as the side
    # that moves farther; how far it can move along the normal is compared with BARELY.
    axes = np.linalg.eigh(sum(move + move.swapaxes(1, 2) for move in moves))[1]
    most = np.max([np.linalg.norm(move @ axes, axis=1) for move in moves], axis=0)
    along = np.einsum("rd,rdk->rk", rows.normal, axes)
    return magnitude(along * np.minimum(most, 1.0)) < BARELY


def _fixed_along_rim(rows: Rows) -> np.ndarray:
    """Rows (r,) at an edge of the slave's rim along which one clamp constrains both ends: shear passes through such an
    edge, unlike through a plane of symmetry."""
    side = rows.side
    edges = creases(side.xy, side.corners[rows.seen], side.outward[rows.seen]).rim
    along = side.xy[edges[:, 1]] - side.xy[edges[:, 0]]
    along /= magnitude(along)[:, None]
    first, second = edges.T
    both = is_held(along, side.free[first]) & is_held(along, side.free[second])
    # one cell between two planes is no such edge
    axis, edge = np.abs(along).argmax(axis=1), np.arange(len(edges))
    both &= side.clamps[first][edge, axis] == side.clamps[second][edge, axis]
    return np.isin(rows.nodes, edges[both])
