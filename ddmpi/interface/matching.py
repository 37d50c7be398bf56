"""Pairing of two sides whose nodes lie opposite each other, everywhere or in the part that they have in common.

A rigid surface, which has neither nodes nor compliance, lies opposite every node that faces it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from ddmpi.errors import InputError
from ddmpi.interface.cover import DEEPEST, FACING, cover
from ddmpi.interface.interface import SAME, Interface, Lines, Places
from ddmpi.interface.law import law_of
from ddmpi.interface.side import Side, frames, unit
from ddmpi.mesh.boundary import links
from ddmpi.scene.contacts import NoFriction, Rigid, SettledContact
from ddmpi.scene.values import Profile
from ddmpi.system.numbers import in_words

LARGEST_OFFSET = 1e-2
"""Largest tangential offset of two paired nodes, as a fraction of the distance to their neighbours in the meshes as
given: finer versions of the same boundaries are offset as much."""

NO_GAP = 1e-9
"""Gaps below this fraction of the distance to the neighbours are rounding of the mesh, and count as zero."""


@dataclass(frozen=True)
class Rows:
    """The rows of a contact as geometry has them: clamps and laws do not count yet.

    Attributes
    ----------
    sides : the first and the second
    own : 0 or 1, the side at whose nodes the rows stand
    nodes : (r,) which of its nodes
    place : (k,) the row with which each of its nodes moves, or −1
    seen : (f,) bool, whether its facets face the other side
    transfers : of each side (r, ·), sparse: a row moves as its entries say that all nodes of the side move
    normal : (r, d) unit normals of the contact, out of the first body
    area : (r,) nodal lengths of the part that both sides have in common (m)
    gap : (r,) along the normals, between the arcs over the chords (m)
    arc : (r,) arc lengths along the first body's boundary (m)
    bound : (k,) bool, nodes that share another one's row because clamps or other contacts hold them
    whole : (f,) bool, whether facets wholly face the other side, each of their nodes with a row to itself
    lines : the nodes of the rows; None where each row has one
    points : between the nodes, with their gaps; None where there are none
    """

    sides: tuple[Side, Side]
    own: int
    nodes: np.ndarray
    place: np.ndarray
    seen: np.ndarray
    transfers: tuple[sparse.csr_matrix, sparse.csr_matrix]
    normal: np.ndarray
    area: np.ndarray
    gap: np.ndarray
    arc: np.ndarray
    bound: np.ndarray
    whole: np.ndarray
    lines: Lines | None = None
    points: Places | None = None

    def held(self, direction: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Whether clamps hold all nodes of each side (2, r) that a row moves with along its direction (r, d); and how
        far it moves where free nodes of a side move by one, the larger of both (r,)."""
        held, most = np.empty((2, len(direction)), bool), np.zeros(len(direction))
        for number, (side, transfer) in enumerate(zip(self.sides, self.transfers, strict=True)):
            entries = transfer.tocoo()
            moves = ~is_held(direction[entries.row], side.free[entries.col])
            held[number] = np.bincount(entries.row, moves, len(direction)) == 0
            most = np.maximum(most, np.abs(np.bincount(entries.row, entries.data * moves, len(direction))))
        return held, most


def pairs(sides: tuple[Side, Side], here: np.ndarray, there: np.ndarray, normal: np.ndarray, area: np.ndarray,
          gap: np.ndarray, seen: np.ndarray) -> Rows:
    """The rows of nodes `here` (r,) of the first side and their partners; otherwise as `Rows`."""
    place = np.full(len(sides[0].nodes), -1)
    place[here] = np.arange(len(here))
    transfers = [sparse.csr_matrix((np.ones(len(here)), (np.arange(len(here)), nodes)), (len(here), len(side.nodes)))
                 for side, nodes in zip(sides, (here, there), strict=True)]
    return Rows(sides, 0, here, place, seen, (transfers[0], transfers[1]), normal, area, gap, sides[0].arc[here],
                np.zeros(len(place), bool), seen)


def build(rows: Rows, contact: SettledContact) -> Interface:
    """The interface of those rows that a body can move. Not collective. Raises InputError if there are none."""
    sides, side, bonded = rows.sides, rows.sides[rows.own], contact.kind == "bonded"
    frame, xy = _along_clamps(rows, frames(rows.normal)), side.xy[rows.nodes]
    start = initial_gap(contact, rows.gap, xy, rows.arc)
    held = np.stack([rows.held(direction)[0] for direction in frame.swapaxes(0, 1)], axis=-1)  # (2, r, d)
    live = ~held.all(axis=0)
    dropped = ~live.any(axis=1) if bonded else ~live[:, 0]  # a bond also holds what slides
    keep = np.flatnonzero(~dropped)
    if len(keep) == 0:
        raise InputError(f"contact.{contact.name}: all nodes of the contact are clamped; there is nothing to solve")
    start[~live[:, 0] & ~dropped] = 0.0
    sliding = np.flatnonzero(live[keep, 1:].any(axis=1) & holds_along(contact))

    def of_rows(values: np.ndarray) -> np.ndarray:
        """The values (r, d) as a vector of the interface."""
        return np.concatenate([values[keep, 0], values[keep[sliding], 1:].ravel()])

    number = np.append(np.where(dropped, -1, np.cumsum(~dropped) - 1), -1)  # of the rows that are kept
    facets = number[rows.place[side.facets[rows.whole]]]
    row = number[np.where(rows.bound, -1, rows.place)]
    lines = rows.lines and replace(rows.lines, row=number[rows.lines.row]).only(~dropped[rows.lines.row])
    nodes, transfers = zip(*(_used(each, transfer[keep]) for each, transfer in zip(sides, rows.transfers, strict=True)),
                           strict=True)
    xy, arc, area = xy[keep], rows.arc[keep], rows.area[keep]
    return Interface(
        name=contact.name, bodies=(sides[0].body, sides[1].body), xy=xy, frame=frame[keep], area=area, gap=start[keep],
        arc=arc, nodes=nodes, transfer=transfers,
        law=law_of(contact.friction, xy, arc, area, sliding, contact.kind, of_rows(live)),
        modulus=1.0 / (1.0 / sides[0].modulus + 1.0 / sides[1].modulus),
        facets=facets[(facets >= 0).all(axis=1)], laplacian=side.laplacian(rows.seen, row, len(keep)),
        one_sided=of_rows(held.any(axis=0)), prescribed=of_rows(np.zeros(live.shape)),
        displacement=np.zeros(xy.shape[1]), slave=side.body if rows.points else None, lines=lines,
        at=(rows.transfers[0][keep] @ sides[0].xy, rows.transfers[1][keep] @ sides[1].xy),
        fixed=_at_rows(rows, dropped, start), probes=_probes(rows, contact, dropped, start))


def _along_clamps(rows: Rows, frame: np.ndarray) -> np.ndarray:
    """The frames (r, d, d), in space with tangents along which clamps of both sides hold a row, the free one first."""
    if frame.shape[2] == 2:
        return frame
    moves = np.zeros(rows.normal.shape)
    for side, transfer in zip(rows.sides, rows.transfers, strict=True):
        moves += abs(transfer) @ (1.0 * side.free)
    some = (moves == 0.0).any(axis=1)
    tangents, free = frame[some, 1:], 1.0 * (moves[some] > 0.0)
    turns = np.linalg.eigh(np.einsum("rid,rd,rjd->rij", tangents, free, tangents))[1][:, :, ::-1]
    frame[some, 1:] = turns.transpose(0, 2, 1) @ tangents
    return frame


def _at_rows(rows: Rows, some: np.ndarray, gap: np.ndarray) -> Places:
    """The places of some of the rows (r,) bool, with gaps from those of all (r,)."""
    (first, own), (second, other) = (_used(side, transfer[some]) for side, transfer in
                                     zip(rows.sides, rows.transfers, strict=True))
    return Places((first, second), rows.normal[some], gap[some], (own, other))


def _probes(rows: Rows, contact: SettledContact, dropped: np.ndarray, start: np.ndarray) -> Places:
    """Places between the nodes; else those dropped rows which can still move a little.

    What overlaps between clamps at first stays, and is no overlap of the answer.
    """
    if rows.points is None:
        free = [transfer @ (1.0 * side.free) for side, transfer in zip(rows.sides, rows.transfers, strict=True)]
        moves = sum(np.abs(rows.normal * each).max(axis=1) for each in free) > SAME
        return _at_rows(rows, dropped & moves, np.maximum(start, 0.0))
    points, gap = rows.points, rows.points.gap
    if contact.gap is not None or contact.kind == "bonded":
        gap = points.transfer[rows.own] @ np.append(start, 0.0)[rows.place]
    if contact.kind != "bonded":
        stays = [each @ is_held(side.normal, side.free) for each, side in zip(points.transfer, rows.sides, strict=True)]
        gap = gap - np.clip(np.min(stays, axis=0), 0.0, 1.0) * np.minimum(gap, 0.0)
    return replace(points, gap=gap)


def _used(side: Side, transfer: sparse.csr_matrix) -> tuple[np.ndarray, sparse.csr_matrix]:
    """The nodes of a side that a transfer has entries of, in the order of its rows, and the transfer to these."""
    columns, first = np.unique(transfer.indices, return_index=True)
    columns = columns[np.argsort(first)]
    return side.nodes[columns], transfer[:, columns]


def holds_along(contact: SettledContact) -> bool:
    """Whether a contact may hold bodies along it: by friction or a bond."""
    return contact.kind == "bonded" or not isinstance(contact.friction, NoFriction)


def pair(first: Side, second: Side, contact: SettledContact, refinement: int = 1) -> Interface:
    """The interface of two sides, whose nodes are paired by position.

    Where the sides do not match as a whole, they may cover each other partly: then all nodes of either side that face
    the other one have a partner, and the others carry no row.

    Parameters
    ----------
    first, second : the sides
    contact : what the scene asks for. A `gap` takes the place of the measured one; without friction there are no
        tangential unknowns
    refinement : how many times finer the meshes are than the given ones, whose spacing the tolerance follows

    Raises
    ------
    InputError
        when the two sides do not match node by node. Not collective.
    """
    try:
        rows = _match_whole(first, second, contact.name, refinement)
    except InputError:
        partly = _match_partly(first, second, refinement)
        if partly is None:
            raise
        rows = partly
    return build(rows, contact)


def face_rigid(side: Side, rigid: Rigid, contact: SettledContact) -> Interface:
    """The interface of a body, which is the first, and a rigid partner.

    Normals and gaps are those of the rigid surface at the body's nodes, exactly. Nodes that do not face it, such as
    the far side of a roller, carry no row; where it has no normal, the body's counts. The second side has no nodes: the
    partner's displacement U gives `Interface.prescribed`. Not collective. Raises InputError when the body's boundary
    does not face the surface.
    """
    outward, measured = rigid.facing(side.xy)
    outward = np.where(outward.any(axis=1, keepdims=True), outward, -side.normal)
    measured = without_rounding(measured - side.rise(np.arange(len(measured)), -outward), side.spacing)
    towards = (np.einsum("icj,ij->ic", outward[side.facets], side.outward) < FACING).all(axis=1)
    here = np.unique(side.facets[towards])
    if len(here) == 0:
        place = in_words(side.xy[np.argmin(np.einsum("ij,ij->i", outward, side.normal))])
        raise InputError(f"contact.{contact.name}: near {place} the boundary of {side.body!r} does not face "
                         f"{rigid.name!r}; {rigid.turned}")
    partner = replace(side, body=rigid.name, modulus=np.inf, xy=side.xy - measured[:, None] * outward, normal=outward,
                      clamps=np.zeros_like(side.clamps))
    found = build(pairs((side, partner), here, here, -outward[here], side.lengths_over(towards)[here], measured[here],
                        towards), contact)
    U, none = np.array(rigid.displacement or np.zeros(side.dimension)), np.empty(0, int)
    fixed, probes = (replace(each, nodes=(each.nodes[0], none)) for each in (found.fixed, found.probes))
    return replace(found, nodes=(found.nodes[0], none), modulus=side.modulus, fixed=fixed, probes=probes,
                   transfer=(found.transfer[0], sparse.csr_matrix((found.m, 0))), history=rigid.history).displaced(U)


def initial_gap(contact: SettledContact, measured: np.ndarray, xy: np.ndarray, arc: np.ndarray) -> np.ndarray:
    """The initial gap (k,) at nodes `xy` (k, d), at arc lengths (k,): given, else measured, or zero of a bond."""
    if isinstance(contact.gap, Profile):
        return contact.gap.at(xy, arc).astype(float)
    if contact.gap is not None:
        return np.full(len(xy), float(contact.gap))
    return np.zeros(len(xy)) if contact.kind == "bonded" else measured


def _match_whole(first: Side, second: Side, name: str, refinement: int) -> Rows:
    """All nodes of both sides, one to one. Raises InputError."""
    match = _opposite(first, second, name)
    normal = first.normal - second.normal[match]
    size = np.linalg.norm(normal, axis=1)
    if (size < 1.0).any():  # the outer normals must face each other (an angle above 120°)
        raise InputError(f"contact.{name}: near {in_words(first.xy[np.argmin(size)])} the two boundaries do not face "
                         "each other")
    normal /= size[:, None]
    gap, aside, spacing = _offset(first, second, np.arange(len(match)), match, normal)
    if (aside > LARGEST_OFFSET * refinement * spacing).any():
        raise InputError(f"contact.{name}: the nodes of the two sides do not lie opposite each other"
                         f"{_worst(first, second, match)}; their meshes must match node by node")
    here = np.arange(len(match))
    return pairs((first, second), here, match, normal, (first.area + second.area[match]) / 2, gap,
                 np.ones(len(first.facets), bool))


def _match_partly(first: Side, second: Side, refinement: int) -> Rows | None:
    """The nodes of the part that two sides have in common, or nodes at which they meet; None unless each facet
    that faces the other side faces one facet, whose nodes are the partners of its own."""
    offset, size = LARGEST_OFFSET * refinement, first.facets.shape[1]
    if second.facets.shape[1] != size or first.dimension > 2:
        return None
    ours = _faced(first, second, offset)
    if any(len(np.unique(each)) < len(each) for each in ours):
        return None
    theirs = _faced(second, first, offset)[::-1]
    if not np.array_equal(ours, theirs[:, np.argsort(theirs[0], kind="stable")]):
        return None
    if ours.size:
        nodes = first.facets[ours[0]].ravel(), second.facets[ours[1]][:, [1, 0, 2][:size]].ravel()
        here, there = np.unique(np.stack(nodes), axis=1)
    else:
        nearest, back = cKDTree(second.xy).query(first.xy)[1], cKDTree(first.xy).query(second.xy)[1]
        here = np.flatnonzero(back[nearest] == np.arange(len(nearest)))
        there = nearest[here]
    common = [np.isin(np.arange(len(side.facets)), some) for side, some in zip((first, second), ours, strict=True)]
    own, other = first.normals_over(common[0])[here], second.normals_over(common[1])[there]
    normal = unit(own - other)
    normal = np.where(normal.any(axis=1, keepdims=True), normal, own)
    gap, aside, spacing = _offset(first, second, here, there, normal)
    area = (first.lengths_over(common[0])[here] + second.lengths_over(common[1])[there]) / 2
    fits = aside <= offset * spacing
    if not ours.size:
        deepest = -DEEPEST * np.minimum(np.abs(normal) @ first.extent, np.abs(normal) @ second.extent)
        fits &= (np.einsum("ij,ij->i", own, other) < FACING) & (gap > deepest)
        if not fits.any():
            return None
        here, there, normal, gap = here[fits], there[fits], normal[fits], gap[fits]
        area = (first.spacing[here] + second.spacing[there]) / 2
    elif not fits.all() or any(len(np.unique(each)) < len(each) for each in (here, there)):
        return None
    return pairs((first, second), here, there, normal, area, gap, common[0])


def _faced(side: Side, other: Side, least: float) -> np.ndarray:
    """Facets of a side and those of the other one that they face (2, n), in the order of the first.

    A facet of which no more than the part `least` is covered does not count: by so much an end may stand aside.
    """
    over = cover(side, other)
    facets, point = np.unique(np.stack([over.facet, over.other]), axis=1, return_inverse=True)
    covered = np.bincount(point.ravel(), over.weight, facets.shape[1])
    return facets[:, covered > least * side.lengths[facets[0]]]


def _opposite(first: Side, second: Side, name: str) -> np.ndarray:
    """The place on the second side (m,) of the node nearest to each node of the first."""
    if len(first.nodes) != len(second.nodes):
        raise InputError(f"contact.{name}: the two sides have {len(first.nodes)} and {len(second.nodes)} nodes; "
                         "their meshes must match node by node")
    match = cKDTree(second.xy).query(first.xy)[1]
    if len(np.unique(match)) != len(match):
        raise InputError(f"contact.{name}: the nodes of the two sides do not pair off one to one"
                         f"{_worst(first, second, match)}; their meshes must match node by node")
    return match


def _offset(first: Side, second: Side, here: np.ndarray, there: np.ndarray,
            normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The gap along the normals between the arcs over the chords, how far partners lie aside of each other, and the
    spacing there, each (k,)."""
    ends, offset = links(first.facets, first.dimension), second.xy[there] - first.xy[here]
    half = np.linalg.norm(first.xy[ends[:, 1]] - first.xy[ends[:, 0]], axis=1) / 2 / (first.dimension - 1)
    spacing = np.bincount(ends.ravel(), np.repeat(half, 2), len(first.nodes))[here]
    gap = np.einsum("ij,ij->i", offset, normal)
    aside = np.linalg.norm(offset - gap[:, None] * normal, axis=1)
    gap = gap - first.rise(here, normal) - second.rise(there, -normal)
    return without_rounding(gap, spacing), aside, spacing


def without_rounding(gap: np.ndarray, spacing: np.ndarray) -> np.ndarray:
    """Gaps (r,) without what is rounding beside the distance between nodes (r,)."""
    return np.where(np.abs(gap) <= NO_GAP * spacing, 0.0, gap)


def is_held(direction: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Whether a clamp takes the motion along `direction` (m, 2).

    With one component free, the unknown along the direction nearest to it stays.
    """
    return np.linalg.norm(direction * free, axis=1) < np.where(free.all(axis=1), 0.0, np.sqrt(0.5) - 1e-9)


def _worst(first: Side, second: Side, match: np.ndarray) -> str:
    distance = np.linalg.norm(second.xy[match] - first.xy, axis=1)
    k = int(np.argmax(distance))
    return f" (worst: {in_words(first.xy[k])} against {in_words(second.xy[match[k]])})"
