"""The rows of a contact by geometry alone, and the interface that `build` makes of them with clamps and the law."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.loads import values_at
from ddmpi.errors import InputError
from ddmpi.interface.interface import Drawing, Geometry, Interface, Lines, Partner, Places
from ddmpi.interface.law import law_of
from ddmpi.scene.contacts import NoFriction, Profile, SettledContact, Tresca
from ddmpi.sets import magnitude
from ddmpi.surface.cut import Cover
from ddmpi.surface.outline import Outline, Outlined, drawn_cells, whole_facets
from ddmpi.surface.side import Side, dot, frames, laplacian, nodal, unit
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import ALIKE, ROUNDING, SAME, in_words, is_touched

HELD = np.sqrt(0.5) - ALIKE
"""A unit vector is clamped if its projection onto the free directions is shorter than this, cos 45°: if a node can move
along one line only, the one of normal and tangent that is nearer to this line is free."""

LEAST = 1e-2
"""A triangle, or the integral of a hat over it, below this fraction of the covered part is a sliver."""

WIDER = 2.0
"""Rows are left out as open where the gap exceeds this times the last motion along normals and any overlap now."""

END = 1e-2
"""Corners of a covered part this near to its end, as a fraction of its extent, are part of its end."""

LACKING = 1e-3
"""A facet counts as wholly covered up to this fraction of its area."""


@dataclass(frozen=True)
class Rows:
    """The rows of a contact by geometry alone, without clamps and laws.

    Attributes
    ----------
    sides : the first and the second
    slave : 0 or 1, the side whose nodes carry the rows
    nodes : (r,) the nodes of the slave with a row
    place : (k,) the row that each node of the slave uses, or −1
    seen : (f,) bool, whether facets of the slave face the other side
    transfers : of both sides (r, ·), sparse: displacements of the rows from those of all nodes of the side
    normal : (r, d) unit normals of the contact, out of the first body
    area : (r,) nodal lengths over the common part of both sides (m)
    gap : (r,) along the normals, between the arcs over the chords (m)
    arc : (r,) arc lengths along the first body's boundary (m)
    whole : (f,) bool, facets that wholly face the other side and whose nodes, but for `bare` ones, do not share rows
    interpolation : (k, r) sparse, values at all nodes of the slave from those of the rows
    lines : the nodes of the rows
    bound : (k,) bool, nodes that share a neighbour's row because clamps or other contacts constrain them
    covered : the part that faces the other side, up to its outline; None for all facets that are `seen`
    points : places between the nodes, with their gaps, or None
    bernstein : whether rows are those of `matching.by_coefficients`
    pointwise, waves : as of a `Geometry`
    """

    sides: tuple[Side, Side]
    slave: int
    nodes: np.ndarray
    place: np.ndarray
    seen: np.ndarray
    transfers: tuple[sparse.csr_matrix, sparse.csr_matrix]
    normal: np.ndarray
    area: np.ndarray
    gap: np.ndarray
    arc: np.ndarray
    whole: np.ndarray
    interpolation: sparse.csr_matrix
    lines: Lines = Drawing.lines
    bound: np.ndarray | bool = False
    covered: Outlined | None = None
    points: Places | None = None
    bernstein: bool = False
    pointwise: bool = False
    waves: bool = False

    @property
    def side(self) -> Side:
        """The slave."""
        return self.sides[self.slave]

    @property
    def other(self) -> Side:
        """The side that the slave faces."""
        return self.sides[1 - self.slave]

    @property
    def hats(self) -> np.ndarray:
        """Facets, as `laplacian` takes them."""
        return self.side.facets[self.seen] if self.bernstein else self.side.pieces(self.seen)

    @cached_property
    def entries(self) -> tuple[sparse.coo_matrix, sparse.coo_matrix]:
        """Those of `transfers`."""
        one, other = self.transfers
        return one.tocoo(), other.tocoo()

    def clamped(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whether clamps constrain all nodes of a row on each side (2, r) in its direction (r, d); and how far (r,) the
        row moves if the free nodes of one side move by one, the larger of both sides."""
        clamped, most = np.empty((2, len(direction)), bool), np.zeros(len(direction))
        for number, (side, entries) in enumerate(zip(self.sides, self.entries, strict=True)):
            moves = ~is_held(direction[entries.row], side.free[entries.col])
            clamped[number] = np.bincount(entries.row, moves, len(direction)) == 0
            most = np.maximum(
                most, np.abs(np.bincount(entries.row, entries.data * moves, len(direction)))
            )
        return clamped, most

    def moves(self, direction: np.ndarray, turned: np.ndarray | None = None) -> np.ndarray:
        """(r,) bool, whether the body that has both sides, the second `turned` (d, d), moves a row in its direction (r,
        d): not where the row is at a node of both, as at the tip of a crack."""
        d, columns, values, numbers = direction.shape[1], [], [], []
        own = direction, -direction if turned is None else -direction @ turned
        for side, entries, along in zip(self.sides, self.entries, own, strict=True):
            values.append(entries.data[:, None] * along[entries.row])
            columns.append(d * side.nodes[entries.col][:, None] + np.arange(d))
            numbers.append(np.repeat(entries.row[:, None], d, axis=1))
        along = tuple(np.concatenate(each).ravel() for each in (values, numbers, columns))
        moved = sparse.csr_matrix((along[0], along[1:]))
        return np.sqrt(moved.power(2).sum(axis=1).A1) > SAME


def rows_of(
    sides: tuple[Side, Side],
    slave: int,
    over: Cover,
    psi: sparse.csr_matrix,
    coefficients: sparse.csr_matrix,
    across: np.ndarray,
    points: Places,
    measure: sparse.csr_matrix | None = None,
) -> Rows:
    """The rows of the slave, `sides[slave]`, which faces the other side at the points of `over`. Not collective.

    Parameters
    ----------
    psi : (q, j) sparse, w ψ: functions at the points, times the points' weights
    coefficients : (k, j) sparse, of the functions θ = coefficients ψ of the slave's nodes; an empty row is none
    across : (q, d) normals at the points, of any length, out of the slave
    points : those of `over`, `between` the sides
    measure : (k, j) coefficients of functions with the same integrals that measure gaps, of the first k of `psi`, those
        of the nodes; θ if left out
    """
    nodes = np.flatnonzero(np.diff(coefficients.indptr))
    place = np.full(coefficients.shape[0], -1)
    place[nodes] = np.arange(len(nodes))
    coefficients, psi = coefficients[nodes], psi.T.tocsr()
    measure = coefficients if measure is None else measure[nodes]
    # D_j = ∫ θ_j, the nodal length; n_j ∝ ∫ θ_j n.
    area = coefficients @ (psi @ np.ones(len(over.facet)))
    normal = unit(coefficients @ (psi @ across))
    # the cover measures gaps along the slave's normals; by the cosine they are along the row's normal
    turned = dot(unit(measure @ (psi @ over.direction)), normal)
    gap = measure @ (psi @ over.gap) / area * turned
    side = sides[slave]
    share = np.bincount(over.facet, over.weight, len(side.facets))
    seen = side.among(over.facet)
    # P = D⁻¹ ∫ θ φ for both sides; for the slave it is the identity unless rows are merged.
    one, other = (means(coefficients @ (psi @ transfer), area) for transfer in points.transfer)
    return Rows(
        sides,
        slave,
        nodes,
        place,
        seen,
        (one, other),
        normal if slave == 0 else -normal,
        area,
        without_rounding(gap, side.spacing[nodes]),
        np.zeros(len(nodes)),
        seen & (share >= (1.0 - LACKING) * side.areas),
        measure[:, : len(place)].T.tocsr(),
        points=points,
    )


def between(sides: tuple[Side, Side], slave: int, over: Cover) -> Places:
    """The points at which the slave, `sides[slave]`, faces the other side, interpolated on both facets."""
    side, other = sides[slave], sides[1 - slave]
    at = (
        at_points(side.cell.shapes(over.at), side.facets[over.facet], len(side.nodes)),
        at_points(other.cell.shapes(over.there), other.facets[over.other], len(other.nodes)),
    )
    first, sign = (1, 1.0) if slave == 0 else (-1, -1.0)
    gap = without_rounding(over.gap, side.spacing[side.facets[over.facet]].min(axis=1))
    return Places((sides[0].nodes, sides[1].nodes), sign * over.direction, gap, at[::first])


def build(rows: Rows, contact: SettledContact, moved: float = np.inf) -> Interface:
    """The interface of the rows that a body can move. Not collective. Raises InputError where all are clamped.

    `moved` (m) is how far bodies have moved along normals at most before. Rows with gaps far larger than that, and than
    overlaps now, become probes, without forces unless one of them closes.
    """
    sides, side = rows.sides, rows.side
    (frame, across), xy = _along_clamps(rows, frames(rows.normal)), side.xy[rows.nodes]
    start = initial_gap(contact, rows.gap, xy, rows.arc)
    clamped, live = _live(rows, contact, frame, across)
    # a bond also carries tangential forces alone
    dropped = ~live.any(axis=1) if contact.kind == "bonded" else ~live[:, 0]
    if dropped.all():
        raise InputError(
            f"contact.{contact.name}: all nodes of the contact are clamped; there is nothing to solve"
        )
    # a bond whose normal motion is clamped on both sides can never close its gap
    start[~live[:, 0] & ~dropped] = 0.0
    beyond = _far(contact, start, ~dropped, moved)
    left = dropped | beyond
    keep = np.flatnonzero(~left)
    sliding = np.flatnonzero(live[keep, 1:].any(axis=1) & holds_along(contact))

    def of_rows(values: np.ndarray) -> np.ndarray:
        """The values (r, d) as a vector of the interface."""
        return np.concatenate([values[keep, 0], values[keep[sliding], 1:].ravel()])

    row, facets, lines = _numbered(rows, left)
    pull = _pull(contact, frame, live, xy)
    xy, arc, area = xy[keep], rows.arc[keep], rows.area[keep]
    return Interface(
        name=contact.name,
        bodies=(sides[0].body, sides[1].body),
        geometry=Geometry(
            xy=xy,
            tangents=frame[keep, 1:],
            area=area,
            at=((rows.transfers[0] @ sides[0].xy)[keep], (rows.transfers[1] @ sides[1].xy)[keep]),
            facets=facets,
            laplacian=laplacian(side.xy, rows.hats, row, len(keep), side.axisymmetric),
            arc=arc,
            stands=side.nodes[rows.nodes[keep]],
            axisymmetric=side.axisymmetric,
            pointwise=rows.pointwise,
            waves=rows.waves,
            tilt=_tilt(rows, keep, frame[keep]),
            covered=rows.covered.measure if rows.covered else float(side.areas[rows.seen].sum()),
        ),
        rows=_at_rows(rows, keep, start),
        law=law_of(
            contact.friction, xy, arc, area, sliding, contact.kind, of_rows(live), contact.name
        ),
        modulus=1.0 / (1.0 / sides[0].modulus + 1.0 / sides[1].modulus),
        one_sided=of_rows(clamped.any(axis=0)),
        slave=contact.roles[rows.slave] if rows.points else None,
        partner=Partner(pull=pull),
        fixed=_at_rows(rows, np.flatnonzero(dropped), start),
        probes=_probes(rows, contact, dropped, np.flatnonzero(beyond), start),
        layer=contact.layer,
        gap_history=contact.opening[1],
        rub_history=contact.rubbing[1],
        drawing=Drawing(lines, partial(_outline, rows, keep)),
    )


def _tilt(rows: Rows, keep: np.ndarray, frame: np.ndarray) -> np.ndarray:
    """The `Geometry.tilt` (2, m, d − 1) of the rows `keep` (m,) with `frame` (m, d, d)."""
    own = []
    for side, transfer in zip(rows.sides, rows.transfers, strict=True):
        normal = side.normal
        # at corners those of smooth arcs, exact on circles and spheres; curved facets in space have their own
        if np.isfinite(side.modulus) and side.cell.bears:
            smooth = unit(nodal(side.fans, side.simplices, len(side.nodes)))
            normal = np.where(smooth.any(axis=1, keepdims=True), smooth, normal)
        own.append((transfer @ normal)[keep])
    across, *along = np.einsum("rtd,srd->tsr", frame, np.stack([own[0], -own[1]]))
    leans = np.stack(along, axis=-1)
    # at a corner that is paired along one of its sides the mean normal may lie across: that is no lean
    known = np.abs(across)[:, :, None] > SAME
    return np.divide(leans, across[:, :, None], out=np.zeros_like(leans), where=known)


def _far(contact: SettledContact, start: np.ndarray, some: np.ndarray, moved: float) -> np.ndarray:
    """Rows (r,) among `some` (r,) whose gaps `start` (r,) do not close. With Tresca's law open rows have forces, too."""
    least = start[some].min()  # the nearest row stays
    far = start > max(least, WIDER * max(moved, -least))
    return some & far & (not isinstance(contact.friction, Tresca))


def _numbered(rows: Rows, left: np.ndarray) -> tuple[np.ndarray, np.ndarray, Lines]:
    """The rows of the slave's nodes (k,), those of facets (f, l) and the lines, by new numbers that leave out the rows
    `left` (r,); −1 for none."""
    side = rows.side
    number = np.append(np.where(left, -1, np.cumsum(~left) - 1), -1)  # −1 stays −1
    nodes = (side.facets if side.cell.bears else side.corners)[rows.whole]
    nodes = nodes if side.cell.simplex else side.cell.straight.split(nodes)
    facets = number[rows.place[nodes]]
    area = rows.lines.area * (not rows.pointwise)
    lines = replace(rows.lines, row=number[rows.lines.row], area=area)
    return (
        number[np.where(rows.bound, -1, rows.place)],
        facets[(facets >= 0).all(axis=1)],
        lines.only(~left[rows.lines.row]),
    )


def _pull(
    contact: SettledContact, frame: np.ndarray, live: np.ndarray, xy: np.ndarray
) -> np.ndarray:
    """The direction (d,) of a pretension, or none. Raises InputError where clamps hold both sides along it."""
    if not contact.pretension:
        return np.empty(0)
    pull = unit(np.array([contact.pretension.along]))[0]
    held = magnitude(np.einsum("rcd,d->rc", frame, pull) * ~live)
    if held.max() > SAME:
        raise InputError(
            f"contact.{contact.name}.pretension: at {in_words(xy[held.argmax()])} clamps hold both sides "
            f"along {in_words(pull, 3)}, so that the bond cannot be pulled; leave one side free there"
        )
    return pull


def _along_clamps(rows: Rows, frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The frames (r, d, d) with tangents turned along the clamps of a row's node, the freest first; and which tangents
    (r, d − 1) both sides constrain: at the row's node, and at a node of the other side that it meets.

    Such a tangent carries no force: on a plane of symmetry there is no friction across the plane. A row for it would
    constrain the curvature of the other side, of which only the nodes beside the plane move. A node that is clamped
    along the normal too has a row only for the nodes that share it, and these slide.
    """
    side, other = rows.side, rows.other
    transfer = rows.transfers[1 - rows.slave]
    free, mean, tangents = side.free[rows.nodes], other.moves_with(transfer), frame[:, 1:]
    # a tangent t moves by M t: the quadratic forms tᵀ Mᵀ M t of both sides, in the basis of the tangents
    turns = sum(tangents @ M.swapaxes(1, 2) @ M @ tangents.swapaxes(1, 2) for M in (free, mean))
    turns = np.linalg.eigh(turns)[1][:, :, ::-1].swapaxes(1, 2)
    turns[~is_touched(free)] = np.eye(tangents.shape[1])
    tangents, entries = turns @ tangents, rows.entries[1 - rows.slave]
    constrained = np.empty(tangents.shape[:2], bool)
    moves = ~is_held(frame[:, 0], free)
    for k, t in enumerate(tangents.swapaxes(0, 1)):
        met = np.bincount(entries.row, is_held(t[entries.row], other.free[entries.col]), len(t))
        constrained[:, k] = is_held(t, free) & (met > 0) & moves & bool(np.isfinite(other.modulus))
    return np.concatenate([frame[:, :1], tangents], axis=1), constrained


def _outline(rows: Rows, keep: np.ndarray) -> Outline:
    """The covered part of the contact, with values from those of the rows `keep` (m,). Cells without a share of these
    rows, as all their nodes are clamped, are left out. Nodes without a cell, at corners of bodies, are points."""
    side, lines = rows.side, rows.lines
    facet, xy, hats = drawn_cells(side, rows.covered or whole_facets(side, rows.seen))
    # in space pressures are linear between corners, in the plane order 2 has rows at middles
    functions, nodes = hats, side.corners
    if side.cell.bears:
        functions, nodes = side.cell.shapes(hats), side.facets
    of_lines = sparse.identity(len(rows.nodes), format="csr")[lines.row]
    at_cells = at_points(functions, nodes[facet], len(side.nodes)) @ rows.interpolation
    shares = sparse.vstack([of_lines, at_cells])[:, keep]
    # Corners of cells at the same place are one point with their mean value, as pieces of two facets differ a little;
    # points at nodes come first.
    xy = np.vstack([lines.xy, xy])
    place = np.round((xy - xy.min(axis=0)) / (ALIKE * np.ptp(xy, axis=0).max() or 1.0))
    _, first, point = np.unique(place, axis=0, return_index=True, return_inverse=True)
    point = np.argsort(np.argsort(first))[point.ravel()]
    xy = xy[np.sort(first)]
    same = sparse.csr_matrix((np.ones(len(point)), (point, np.arange(len(point)))))
    shares = means(same, np.ones(len(xy))) @ shares
    # Points of which no row is kept take the mean of their neighbours.
    cells, known = point[len(lines.row) :].reshape(-1, side.dimension), shares.getnnz(axis=1) > 0
    cells = cells[known[cells].any(axis=1)]
    near = at_points(np.ones(cells.shape), cells, len(xy))
    shares = (shares + sparse.diags(1.0 * ~known) @ (near.T @ near) @ shares).tocsr()
    if rows.pointwise:
        alone = np.setdiff1d(point[: len(lines.row)][np.isin(lines.row, keep)], cells)
        cells = np.vstack([cells, alone[:, None].repeat(side.dimension, axis=1)])
    used, cells = np.unique(cells, return_inverse=True)
    return Outline(
        xy[used], cells.reshape(-1, side.dimension), means(shares[used], np.ones(len(used)))
    )


def _live(
    rows: Rows, contact: SettledContact, frame: np.ndarray, across: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(2, r, d) bool, along which unit vectors (r, d, d) clamps hold each side, and (r, d) which are unknowns. Not
    collective."""
    directions = frame.swapaxes(0, 1)
    clamped = np.stack([rows.clamped(each)[0] for each in directions], axis=-1)
    # an unknown that both sides clamp would be a zero row of C; tangents `across` planes of symmetry carry no force
    live = ~clamped.all(axis=0)
    live[:, 1:] &= ~across
    if contact.itself:
        turned = contact.image.frame(1.0, frame.shape[2]).turned if contact.image else None
        live &= np.stack([rows.moves(each, turned) for each in directions], axis=-1)
    return clamped, live


def _at_rows(rows: Rows, some: np.ndarray, gap: np.ndarray) -> Places:
    """The places of `some` rows (k,), with their entries of `gap` (r,)."""
    if not len(some):
        return Places(normal=rows.normal[some])
    (first, one), (second, other) = (
        _used(side, transfer[some])
        for side, transfer in zip(rows.sides, rows.transfers, strict=True)
    )
    return Places((first, second), rows.normal[some], gap[some], (one, other))


def _probes(
    rows: Rows, contact: SettledContact, dropped: np.ndarray, beyond: np.ndarray, start: np.ndarray
) -> Places:
    """Places between the nodes, or dropped rows that can still move a little, with overlaps that clamps preserve;
    followed by the rows `beyond`."""
    if rows.points is None:
        moves = np.zeros(len(start))
        for side, transfer in zip(rows.sides, rows.transfers, strict=True):
            along = np.einsum("rij,rj->ri", side.moves_with(transfer), rows.normal)
            moves += np.abs(along).max(axis=1)
        some = np.append(np.flatnonzero(dropped & (moves > SAME)), beyond)
        return replace(_at_rows(rows, some, start), stays=1.0, beyond=len(beyond))
    points, stays = rows.points, [np.zeros(1)]
    if len(beyond):
        one, other = (
            sparse.vstack([move, more[beyond]], "csr")
            for move, more in zip(points.transfer, rows.transfers, strict=True)
        )
        points = replace(
            points,
            transfer=(one, other),
            normal=np.vstack([points.normal, rows.normal[beyond]]),
            gap=np.append(points.gap, start[beyond]),
        )
    gap = points.gap
    if contact.gap is not None or contact.two_sided:
        # A given gap, or none of a bond or a guide, overrides the geometry between the nodes too.
        gap = points.transfer[rows.slave] @ np.append(start, 0.0)[rows.place]
    if not contact.two_sided:
        stays = [
            move @ is_held(side.normal, side.free)
            for move, side in zip(points.transfer, rows.sides, strict=True)
        ]
    stays = np.clip(np.min(stays, axis=0), 0.0, 1.0)
    return replace(points, gap=gap, stays=stays, beyond=len(beyond))


def _used(side: Side, transfer: sparse.csr_matrix) -> tuple[np.ndarray, sparse.csr_matrix]:
    """The nodes of a side with entries in a transfer, in the order of its rows, and the transfer restricted to them."""
    columns, first, number = np.unique(transfer.indices, return_index=True, return_inverse=True)
    order = np.argsort(first)
    shape = transfer.shape[0], len(columns)
    restricted = (transfer.data, np.argsort(order)[number], transfer.indptr)
    return side.nodes[columns[order]], sparse.csr_matrix(restricted, shape)


def holds_along(contact: SettledContact) -> bool:
    """Whether a contact can carry tangential forces: by friction or a bond."""
    return contact.kind == "bonded" or not isinstance(contact.friction, NoFriction)


def initial_gap(
    contact: SettledContact, measured: np.ndarray, xy: np.ndarray, arc: np.ndarray
) -> np.ndarray:
    """The initial gap (k,) at nodes `xy` (k, d), at arc lengths (k,): given, else measured; zero for bonds and
    guides."""
    given, _ = contact.opening
    if isinstance(given, Profile):
        return given.at(xy, arc).astype(float)
    if given is not None:
        return values_at(given, xy, f"contact.{contact.name}.gap")
    return np.zeros(len(xy)) if contact.two_sided else measured


def without_rounding(gap: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Gaps (r,), zero where they are rounding beside the distance between nodes (r,)."""
    return np.where(np.abs(gap) <= ALIKE * spacing, 0.0, gap)


def is_held(direction: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Whether clamps with projections `free` (m, d, d) constrain nodes (m,) along directions (m, d), see HELD."""
    left = np.einsum("kij,kj->ki", free, direction)
    return magnitude(left) < np.where(is_touched(free), HELD, 0.0)


def at_points(phi: np.ndarray, nodes: np.ndarray, size: int) -> sparse.csr_matrix:
    """The matrix (q, size) of the functions (q, c) of `nodes` (q, c) at points."""
    starts = phi.shape[1] * np.arange(len(phi) + 1)
    matrix = sparse.csr_matrix((phi.ravel(), nodes.ravel(), starts), (len(phi), size), copy=True)
    matrix.sum_duplicates()
    return matrix


def duals(
    side: Side,
    over: Cover,
    phi: np.ndarray,
    sliver: float,
    alone: np.ndarray | float,
    kept: np.ndarray | None = None,
) -> np.ndarray:
    """w ψ (q, c) at the points with weights w: ∫ ψ_j φ_k = δ_jk ∫ φ_j over the covered part of each facet, for the
    functions φ (q, c) of a side. Facets covered by less than the fraction `sliver` get ψ = `alone`. Functions that
    `kept` (f, c) marks are ψ = φ; the others are dual among themselves, so that all ψ still sum to one."""
    covered, place = np.unique(over.facet, return_inverse=True)
    # ψ = D_e M_e⁻¹ φ with D_e = diag ∫ φ_j and M_e = ∫ φ_i φ_j over the covered part of facet e (Wohlmuth 2000).
    integrals = nodal(over.weight[:, None] * phi, place, len(covered))
    mass = nodal(np.einsum("q,qi,qj->qij", over.weight, phi, phi), place, len(covered))
    if kept is not None:
        # With N the others: ψ_N = diag(M_NN 1) M_NN⁻¹ φ_N.
        its = kept[covered]
        mass[its[:, :, None] | its[:, None]] = 0.0
        integrals = np.where(its, 1.0, mass.sum(axis=2))
        mass += its[:, :, None] * np.eye(phi.shape[1])
    thin = np.bincount(place, over.weight, len(covered)) < sliver * side.areas[covered]
    # Over a sliver M_e is nearly singular; its inverse is not used.
    mass[thin] = np.eye(phi.shape[1])
    psi = np.einsum("qi,qij->qj", phi, np.linalg.inv(mass)[place]) * integrals[place]
    return over.weight[:, None] * np.where(thin[place, None], alone, psi)


def inset(side: Side, over: Cover, corners: Cover) -> np.ndarray:
    """Coordinates (q, d) of the points of a cover in the triangle, or length, of each facet that reaches as far as its
    covered part: a vertex λ_i = 1 that is not covered moves to the farthest of the covered part's `corners`.

    The dual functions of shape functions in these coordinates have their centres in the covered part, so that contact
    forces reach no farther than the contact does. Facets that are wholly covered keep their own coordinates, and so do
    those with no such triangle: slivers (LEAST), or separate covered parts, over which a hat has no integral.
    """
    if not side.cell.simplex:
        return _inset_rectangles(side, over, corners)
    facets, place = np.unique(over.facet, return_inverse=True)
    kept = np.isin(corners.facet, facets)
    at = corners.at[kept]
    number = np.searchsorted(facets, corners.facet[kept])
    d = corners.at.shape[1]
    most, least = np.zeros((len(facets), d)), np.ones((len(facets), d))
    np.maximum.at(most, number, at)
    np.minimum.at(least, number, at)
    # The mean of the corners within END of the farthest one, by weights that fall to zero: where the cover ends
    # parallel to an edge there are several such corners, and a small turn of the end must move the vertex little.
    near = np.maximum(
        1.0 - (most[number] - at) / np.maximum(END * (most - least), ALIKE)[number], 0.0
    )
    ends = nodal(near[:, :, None] * at[:, None, :], number, len(facets))
    total = nodal(near, number, len(facets))
    ends /= np.maximum(total, ROUNDING)[:, :, None]
    # from this mean towards the vertex, until λ_i is the largest in the covered part
    reached = np.einsum("fii->fi", ends)
    shift = np.where(
        reached < 1.0, (most - reached) / np.where(reached < 1.0, 1.0 - reached, 1.0), 0.0
    )
    ends += shift[:, :, None] * (np.eye(d) - ends)
    covered = np.bincount(place, over.weight, len(facets))
    ends[np.abs(np.linalg.det(ends)) < LEAST * covered / side.areas[facets]] = np.eye(d)
    hats = np.einsum("qi,qij->qj", over.at, np.linalg.inv(ends)[place])
    integrals = nodal(over.weight[:, None] * hats, place, len(facets))
    return np.where((integrals.min(axis=1) > LEAST * covered)[place, None], hats, over.at)


def _inset_rectangles(side: Side, over: Cover, corners: Cover) -> np.ndarray:
    """`inset` of quadrilaterals: the hats of the smallest rectangle of their parameters that holds the covered part."""
    cell, count = side.cell.straight, len(side.facets)
    ends = cell.parameters(corners.at)
    low, high = np.ones((count, ends.shape[1])), np.zeros((count, ends.shape[1]))
    np.minimum.at(low, corners.facet, np.where(ends < SAME, 0.0, ends))
    np.maximum.at(high, corners.facet, np.where(ends > 1.0 - SAME, 1.0, ends))
    at = (cell.parameters(over.at) - low[over.facet]) / np.maximum(high - low, SAME)[over.facet]
    hats = cell.hats_at(cell.coordinates(at))
    covered = np.bincount(over.facet, over.weight, count)
    integrals = nodal(over.weight[:, None] * hats, over.facet, count)
    fits = integrals.min(axis=1) > LEAST * covered
    return np.where(fits[over.facet, None], hats, over.at)


def means(integrals: sparse.csr_matrix, area: np.ndarray) -> sparse.csr_matrix:
    """∫ ψ φ (r, k) without entries that are rounding beside the areas (r,), scaled so that rows sum to one: rigid
    translations then open no gap, and forces on both bodies balance exactly."""
    transfer = integrals.tocsr()
    transfer.data[np.abs(transfer.data) <= ROUNDING * area.repeat(np.diff(transfer.indptr))] = 0.0
    transfer.eliminate_zeros()
    transfer.data *= (1.0 / np.asarray(transfer.sum(axis=1)).ravel()).repeat(
        np.diff(transfer.indptr)
    )
    return transfer


def uncovered_profile(interface: Interface, contact: SettledContact) -> list[str]:
    """A warning where a profile of friction or of the gap ends before the contact does. Not collective."""
    warnings = list[str]()
    for key, values in (
        ("friction", contact.rubbing[0]),
        ("gap", contact.opening[0]),
    ):
        if not isinstance(values, Profile) or len(values.points) < 2:
            continue
        along = values.position(interface.xy, interface.geometry.arc)
        low, high, slack = values.points[0], values.points[-1], SAME * float(np.ptp(along))
        if along.min() < low - slack or along.max() > high + slack:
            warnings.append(
                Doubt(
                    f"contact.{interface.name}.{key}: the profile covers {values.along} from {low:g} to {high:g}, the "
                    f"contact goes from {along.min():g} to {along.max():g}; beyond its ends the profile is constant",
                    "profile",
                )
            )
    return warnings
