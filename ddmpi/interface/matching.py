"""Pairing of two sides whose nodes lie opposite each other, everywhere or in their common part.

A rigid surface has neither nodes nor compliance; every node that faces it is paired with the surface.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface, Lines, Partner
from ddmpi.interface.rows import Rows, build, without_rounding
from ddmpi.interface.vertices import rows_at_vertices
from ddmpi.mesh.boundary import links
from ddmpi.mesh.elements import CELLS, circumference, facet_measures, facet_shares
from ddmpi.scene.contacts import Rigid, SettledContact
from ddmpi.sets import magnitude
from ddmpi.surface.cover import DEEPEST, cover
from ddmpi.surface.cut import FACING, Cover, stretch
from ddmpi.surface.side import Side, dot, nodal, unit
from ddmpi.system.numbers import RigidMotion, across, in_words, together

LARGEST_OFFSET = 1e-2
"""Largest tangential offset of two paired nodes, as a fraction of the distance to their neighbours in the given meshes:
refinement keeps the offset."""


def pairs(
    sides: tuple[Side, Side],
    nodes: np.ndarray,
    partners: np.ndarray,
    normal: np.ndarray,
    area: np.ndarray,
    gap: np.ndarray,
    seen: np.ndarray,
) -> Rows:
    """The rows of `nodes` (r,) of the first side and their `partners`; `seen` (f,) marks its facets of the contact."""
    side = sides[0]
    place, lengths = np.full(len(side.nodes), -1), np.zeros(len(side.nodes))
    place[nodes], lengths[nodes] = np.arange(len(nodes)), area
    # A corner on the axis has ∫ φ r = 0 at order 2 (D = h r/6 with r = 0): its pressure would be 0/0. It shares the row
    # of the middle beside it.
    for facet in side.facets[
        side.bare[side.facets].any(axis=1) & (place[side.facets] >= 0).all(axis=1)
    ]:
        place[facet[side.bare[facet]]] = place[facet[2]]
    kept, row = np.unique(place[nodes], return_inverse=True)
    total = np.bincount(row, area)
    # Weights area/total sum to one: rigid translations open no gap, and nodal forces are pressure × length.
    transfers = [
        sparse.csr_matrix((area / total[row], (row, numbers)), (len(kept), len(one.nodes)))
        for one, numbers in zip(sides, (nodes, partners), strict=True)
    ]
    place[nodes], nodes = row, nodes[kept]
    used = np.flatnonzero(place >= 0)
    lines = Lines(place, side.xy, lengths, side.pieces(seen)).only(place >= 0)
    return Rows(
        sides,
        0,
        nodes,
        place,
        seen,
        (transfers[0], transfers[1]),
        normal[kept],
        total,
        gap[kept],
        side.arc[nodes],
        seen,
        sparse.csr_matrix((np.ones(len(used)), (used, place[used])), (len(place), len(kept))),
        lines,
    )


def pair(first: Side, second: Side, contact: SettledContact, refinement: int = 1) -> Interface:
    """The interface of two sides whose nodes are paired by position.

    Sides that do not match as a whole may match in their common part: then every node that faces the other side has a
    partner, and the other nodes carry no row.

    A `gap` of the contact overrides the measured one. The meshes are `refinement` times finer than the given ones,
    whose spacing sets the tolerance. Not collective. Raises InputError where nodes do not match.
    """
    try:
        rows = _match_whole(first, second, contact.name, refinement)
    except InputError:
        partly = _match_partly(first, second, refinement)
        if partly is None:
            raise
        rows = partly
    return build(rows if first.cell.bears else by_coefficients(rows), contact)


def by_coefficients(rows: Rows) -> Rows:
    """Rows at all nodes of quadratic facets in space that match: of the coefficients of their Bernstein polynomials.

    Displacements are Σ β_j b_j, along edges with λ_i² of corners and 2 λ_i λ_j of middles for b: β is the displacement
    u_i of a corner, and 2 u_m − ½ (u_i + u_j) of a middle. Over a triangle all b have a sixth of its area as integral;
    over a rectangle with 0 ≤ ξ, η ≤ 1 they are (1 − ξ)(1 − η)(1 − ξ − η) of the first corner, with a twelfth, and
    2 ξ (1 − ξ)(1 − η) of the first middle, with a sixth. So forces are pressures times areas, unlike those of nodes,
    which are zero or negative at corners.
    """
    side, size = rows.side, len(rows.nodes)
    edges = side.facets[rows.seen][:, side.cell.edges].reshape(-1, 3)
    ends, middles = rows.place[edges[:, :2]], rows.place[edges[:, 2]]
    first = np.unique(middles, return_index=True)[1]
    ends, middles = ends[first], middles[first]
    change = sparse.identity(size, format="lil")
    change[middles, middles] = 2.0
    for end in ends.T:
        change[middles, end] = -0.5
    change = change.tocsr()
    one, other = (change @ transfer for transfer in rows.transfers)
    return replace(rows, transfers=(one, other), gap=change @ rows.gap, bernstein=True)


def faces_rigid(side: Side, rigid: Rigid) -> bool:
    """Whether a facet of a side faces a rigid partner. Not collective."""
    outward = rigid.facing(side.xy)[0]
    return bool(
        (np.einsum("icj,ij->ic", outward[side.facets], side.outward) < FACING).all(axis=1).any()
    )


def face_rigid(
    side: Side, rigid: Rigid, contact: SettledContact, moved: float = np.inf
) -> Interface:
    """The interface of a body, which is the first, and a rigid partner.

    Normals and gaps are those of the rigid surface at the body's nodes, exactly. Nodes that do not face it, such as
    the far side of a roller, carry no row; where the surface has no normal, the body's is taken. The second side has no
    nodes: the partner's displacement gives `Interface.prescribed`. Quadratic tetrahedra have mortar rows, see
    `vertices`. `moved` is as for `build`. Not collective. Raises InputError where the body's boundary does not face
    the surface.
    """
    outward, measured = rigid.facing(side.xy)
    outward = np.where(outward.any(axis=1, keepdims=True), outward, -side.normal)
    # middles of straight quadratic sides lie h²/8R inside the arc, so the gap is that of the arc over the chord
    rise = side.rise(np.arange(len(measured)), -outward)
    measured = without_rounding(measured - rise, side.spacing)
    towards = (np.einsum("icj,ij->ic", outward[side.facets], side.outward) < FACING).all(axis=1)
    facing = np.unique(side.facets[towards])
    if len(facing) == 0:
        place = in_words(side.xy[np.argmin(dot(outward, side.normal))])
        raise InputError(
            f"contact.{contact.name}: near {place} the boundary of {side.body!r} does not face "
            f"{rigid.name!r}; {rigid.turned}"
        )
    clamps = np.zeros_like(side.clamps)
    clamps[:, slice(None) if rigid.turning else rigid.pushed] = -1
    # A second side stands for the partner, with a node opposite to each of the body's. Its compliance is zero (modulus
    # ∞), and all directions are clamped but those in which it is pushed; none if it turns.
    both = (
        side,
        replace(
            side,
            body=rigid.name,
            modulus=np.inf,
            xy=side.xy - measured[:, None] * outward,
            normal=outward,
            clamps=clamps,
            free=(clamps < 0)[:, :, None] * np.eye(side.dimension),
        ),
    )
    if not side.cell.bears:
        cell, some = CELLS[2, side.cell.order], np.flatnonzero(towards)
        over = _over_rigid(side, rigid, some, *(cell.rule if side.cell.simplex else cell.fine))
        looked = _over_rigid(side, rigid, some, cell.nodes, np.zeros(len(cell.nodes)))
        rows = rows_at_vertices(both, 0, over, looked, contact)
    else:
        normal, lengths = -outward[facing], side.lengths_over(towards)[facing]
        rows = pairs(both, facing, facing, normal, lengths, measured[facing], towards)
    interface = build(rows, contact, moved)
    motion = RigidMotion(
        np.array(rigid.displacement or np.zeros(side.dimension)), pivot=np.array(rigid.pivot or ())
    )
    return replace(
        interface,
        modulus=side.modulus,
        rows=interface.rows.on_rigid(),
        fixed=interface.fixed.on_rigid(),
        probes=interface.probes.on_rigid(),
        slave=None,
        partner=Partner(motion, rigid.history),
    )


def _over_rigid(
    side: Side, rigid: Rigid, some: np.ndarray, where: np.ndarray, weights: np.ndarray
) -> Cover:
    """The cover of some facets (n,) that face a rigid surface in space, at points `where` (p, 3) of the triangles into
    which they are cut, with weights (p,)."""
    triangles, parts = side.xy[side.simplices], len(side.cell.straight.parts)
    cut = (some[:, None] + len(side.facets) * np.arange(parts)).ravel()
    cut, where = np.repeat(cut, len(where)), np.tile(where, (len(cut), 1))
    facet, at = side.on_facets(cut, where)
    outward, gap = rigid.facing(np.einsum("qc,qcd->qd", where, triangles[cut]))
    outward = np.where(outward.any(axis=1, keepdims=True), outward, -side.outward[facet])
    weight = np.tile(weights, len(cut) // len(weights)) * facet_measures(triangles)[cut]
    gap = gap - side.bulge(cut, where, -outward)
    return Cover(facet, at, facet, at, weight * stretch(side, facet, at), -outward, gap)


def _match_whole(first: Side, second: Side, name: str, refinement: int) -> Rows:
    """The rows of sides whose nodes all match one to one. Raises InputError."""
    if len(first.nodes) != len(second.nodes):
        raise InputError(
            f"contact.{name}: the two sides have {len(first.nodes)} and {len(second.nodes)} nodes; "
            "their meshes must match node by node"
        )
    nodes, match = np.arange(len(first.nodes)), cKDTree(second.xy).query(first.xy)[1]
    if len(np.unique(match)) != len(match):
        raise InputError(
            f"contact.{name}: the nodes of the two sides do not pair off one to one"
            f"{_worst(first, second, match)}; their meshes must match node by node"
        )
    normal = first.normal - second.normal[match]
    size = magnitude(normal)
    # |n_1 − n_2| = 2 sin(angle/2): 2 for opposite normals; below 1 the angle between them is below 60°.
    if (size < 1.0).any():
        raise InputError(
            f"contact.{name}: near {in_words(first.xy[np.argmin(size)])} the two boundaries do not face "
            "each other"
        )
    normal /= size[:, None]
    gap, aside, spacing = _offset(first, second, nodes, match, normal)
    if (aside > LARGEST_OFFSET * refinement * spacing).any():
        raise InputError(
            f"contact.{name}: the nodes of the two sides do not lie opposite each other"
            f"{_worst(first, second, match)}; their meshes must match node by node"
        )
    return pairs(
        (first, second),
        nodes,
        match,
        normal,
        (_lengths(first) + _lengths(second)[match]) / 2,
        gap,
        np.ones(len(first.facets), bool),
    )


def _match_partly(first: Side, second: Side, refinement: int) -> Rows | None:
    """The rows of the common part of two sides, or of the nodes at which they meet along an edge or at a vertex. None
    unless facets face each other one to one, with matching nodes."""
    offset = LARGEST_OFFSET * refinement
    ours = _faced(first, second, offset)
    # facets must pair off in both directions: from one side alone, a facet that faces half of a larger one would pass
    if any(len(np.unique(numbers)) < len(numbers) for numbers in ours):
        return None
    theirs = _faced(second, first, offset)[::-1]
    if not np.array_equal(ours, theirs[:, np.argsort(theirs[0], kind="stable")]):
        return None
    if ours.size:
        a, b = first.facets[ours[0]], second.facets[ours[1]]
        nearest = magnitude(first.xy[a][:, :, None] - second.xy[b][:, None]).argmin(axis=2)
        nodes, partners = np.unique(
            np.stack([a.ravel(), np.take_along_axis(b, nearest, axis=1).ravel()]), axis=1
        )
    else:
        # No facet faces one of the other side. The bodies can still meet along an edge or at a vertex: candidates are
        # nodes that are each other's nearest.
        nearest, back = cKDTree(second.xy).query(first.xy)[1], cKDTree(first.xy).query(second.xy)[1]
        nodes = np.flatnonzero(back[nearest] == np.arange(len(nearest)))
        partners = nearest[nodes]
    common = first.among(ours[0]), second.among(ours[1])
    outward, other = first.normals_over(common[0])[nodes], second.normals_over(common[1])[partners]
    normal = unit(outward - other)
    # normals that cancel, at edges where one surface continues the other: the first side's counts
    normal = np.where(normal.any(axis=1, keepdims=True), normal, outward)
    gap, aside, spacing = _offset(first, second, nodes, partners, normal)
    area = (_lengths(first, common[0])[nodes] + _lengths(second, common[1])[partners]) / 2
    fits = aside <= offset * spacing
    if not ours.size:
        # candidates must have normals that face each other, and not lie on the far sides of the bodies
        deepest = -DEEPEST * np.minimum(
            np.abs(normal) @ first.extent, np.abs(normal) @ second.extent
        )
        fits &= (dot(outward, other) < FACING) & (gap > deepest)
        if not fits.any() or _unmatched(first, second, nodes[fits], partners[fits]):
            return None
        nodes, partners, normal, gap = nodes[fits], partners[fits], normal[fits], gap[fits]
        # Edges and vertices have no area; only the iteration uses it, and the spacing takes its place. On the axis the
        # circumference is that at a quarter of the spacing.
        area = (first.spacing[nodes] + second.spacing[partners]) / 2
        area = area * circumference(
            np.maximum(first.xy[nodes], area[:, None] / 4), first.axisymmetric
        )
    elif not fits.all() or any(
        len(np.unique(numbers)) < len(numbers) for numbers in (nodes, partners)
    ):
        return None
    rows = pairs((first, second), nodes, partners, normal, area, gap, common[0])
    return replace(rows, pointwise=not ours.size)


def _lengths(side: Side, some: np.ndarray | None = None) -> np.ndarray:
    """Nodal lengths (k,) over `some` facets (f,) bool or all, of `by_coefficients` on quadratic ones in space."""
    if side.cell.bears:
        return side.area if some is None else side.lengths_over(some)
    facets = side.facets if some is None else side.facets[some]
    shares = facet_shares(side.xy[facets])
    for start, end, middle in side.cell.edges:
        shares[:, middle] /= 2.0
        shares[:, [start, end]] += shares[:, [middle]] / 2.0
    return nodal(shares, facets, len(side.nodes))


def _unmatched(first: Side, second: Side, nodes: np.ndarray, partners: np.ndarray) -> bool:
    """Whether the sides touch along an edge on which their nodes do not match: a neighbour of a paired node then has no
    partner but lies on a facet at that node's partner. `nodes` and `partners` (k,) are the pairs."""
    for side, other, matched, partner in (
        (first, second, nodes, partners),
        (second, first, partners, nodes),
    ):
        edges, match = links(side.facets, side.dimension), np.full(len(side.nodes), -1)
        edges, match[matched] = np.concatenate([edges, edges[:, ::-1]]), partner
        start, end = edges[(match[edges[:, 0]] >= 0) & (match[edges[:, 1]] < 0)].T
        corners = other.simplices.ravel()
        order = np.argsort(corners, kind="stable")
        # Each edge meets the facets at its start's partner.
        edge, place = together(match[start], corners[order])
        facet = other.xy[other.simplices[order[place] // side.dimension]]
        away = side.xy[end] - side.xy[start] + other.xy[match[start]]
        # the neighbour, shifted with its paired node onto the partner, in barycentric coordinates of a facet there
        off, along = across(away[edge] - facet[:, 0], facet)
        inside = (along > -LARGEST_OFFSET).all(axis=1) & (along.sum(axis=1) < 1.0 + LARGEST_OFFSET)
        size = magnitude(side.xy[end] - side.xy[start])[edge]
        if (inside & (magnitude(off) < LARGEST_OFFSET * size)).any():
            return True
    return False


def _faced(side: Side, other: Side, least: float) -> np.ndarray:
    """Facets of a side and of the other one that face each other (2, n), in the order of the first. A facet covered by
    at most the fraction `least` does not count: ends may be offset by as much."""
    over = cover(side, other)
    facets, point = np.unique(np.stack([over.facet, over.other]), axis=1, return_inverse=True)
    covered = np.bincount(point.ravel(), over.weight, facets.shape[1])
    return facets[:, covered > least * side.areas[facets[0]]]


def _offset(
    first: Side, second: Side, nodes: np.ndarray, partners: np.ndarray, normal: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of all pairs (k,): gap along the normal between the arcs over the chords, tangential offset, spacing of nodes."""
    ends, offset = links(first.facets, first.dimension), second.xy[partners] - first.xy[nodes]
    half = magnitude(first.xy[ends[:, 1]] - first.xy[ends[:, 0]]) / 2 / (first.dimension - 1)
    spacing = np.bincount(ends.ravel(), np.repeat(half, 2), len(first.nodes))[nodes]
    gap = dot(offset, normal)
    aside = magnitude(offset - gap[:, None] * normal)
    gap = gap - first.rise(nodes, normal) - second.rise(partners, -normal)
    return without_rounding(gap, spacing), aside, spacing


def _worst(first: Side, second: Side, match: np.ndarray) -> str:
    distance = magnitude(second.xy[match] - first.xy)
    k = int(np.argmax(distance))
    return f" (worst: {in_words(first.xy[k])} against {in_words(second.xy[match[k]])})"
