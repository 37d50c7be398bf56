"""Pairing of two sides whose nodes lie opposite each other, everywhere or in the part that they have in common.

A rigid surface, which has neither nodes nor compliance, lies opposite every node that faces it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface, Lines
from ddmpi.interface.rows import Rows, build, without_rounding
from ddmpi.interface.vertices import rows_at_vertices
from ddmpi.mesh.boundary import links
from ddmpi.mesh.elements import circumference, facet_measures
from ddmpi.scene.contacts import Rigid, SettledContact
from ddmpi.surface.cover import DEEPEST, cover
from ddmpi.surface.cut import FACING, Cover, stretch
from ddmpi.surface.side import Side, unit
from ddmpi.system.numbers import across, in_words, together

LARGEST_OFFSET = 1e-2
"""Largest tangential offset of two paired nodes, as a fraction of the distance to their neighbours in the meshes as
given: finer versions of the same boundaries are offset as much."""


def pairs(sides: tuple[Side, Side], here: np.ndarray, there: np.ndarray, normal: np.ndarray, area: np.ndarray,
          gap: np.ndarray, seen: np.ndarray) -> Rows:
    """The rows of nodes `here` (r,) of the first side and their partners. `Side.bare` nodes share those of middles."""
    side = sides[0]
    place, lengths = np.full(len(side.nodes), -1), np.zeros(len(side.nodes))
    place[here], lengths[here] = np.arange(len(here)), area
    for facet in side.facets[side.bare[side.facets].any(axis=1) & (place[side.facets] >= 0).all(axis=1)]:
        place[facet[side.bare[facet]]] = place[facet[2]]
    kept, row = np.unique(place[here], return_inverse=True)
    total = np.bincount(row, area)
    transfers = [sparse.csr_matrix((area / total[row], (row, nodes)), (len(kept), len(each.nodes)))
                 for each, nodes in zip(sides, (here, there), strict=True)]
    place[here], here = row, here[kept]
    lines = Lines(place, side.xy, lengths, side.pieces(seen)).only(place >= 0)
    return Rows(sides, 0, here, place, seen, (transfers[0], transfers[1]), normal[kept], total, gap[kept],
                side.arc[here], np.zeros(len(place), bool), seen, lines)


def pair(first: Side, second: Side, contact: SettledContact, refinement: int = 1) -> Interface:
    """The interface of two sides, whose nodes are paired by position.

    Where the sides do not match as a whole, they may cover each other partly: then all nodes of either side that face
    the other one have a partner, and the others carry no row.

    A `gap` of the contact takes the place of the measured one. The meshes are `refinement` times finer than the given
    ones, whose spacing the tolerance follows. Not collective. Raises InputError where nodes do not match.
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
    partner's displacement gives `Interface.prescribed`. Not collective. Raises InputError when the body's boundary
    does not face the surface. In space quadratic elements have rows at vertices, see `vertices`.
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
    clamps = np.zeros_like(side.clamps)
    clamps[:, rigid.pushed] = -1
    partner = replace(side, body=rigid.name, modulus=np.inf, xy=side.xy - measured[:, None] * outward, normal=outward,
                      clamps=clamps, free=(clamps < 0)[:, :, None] * np.eye(side.dimension))
    if not side.cell.bears:
        over, looked = (_over_rigid(side, rigid, np.flatnonzero(towards), *rule) for rule in (
            side.cell.rule, (side.cell.nodes, np.zeros(len(side.cell.nodes)))))
        rows = rows_at_vertices((side, partner), 0, over, looked, contact)
    else:
        rows = pairs((side, partner), here, here, -outward[here], side.lengths_over(towards)[here], measured[here],
                     towards)
    found = build(rows, contact)
    U, none = np.array(rigid.displacement or np.zeros(side.dimension)), np.empty(0, int)
    fixed, probes = (replace(each, nodes=(each.nodes[0], none)) for each in (found.fixed, found.probes))
    return replace(found, nodes=(found.nodes[0], none), modulus=side.modulus, fixed=fixed, probes=probes, slave=None,
                   transfer=(found.transfer[0], sparse.csr_matrix((found.m, 0))), history=rigid.history,
                   displacement=U)


def _over_rigid(side: Side, rigid: Rigid, some: np.ndarray, where: np.ndarray, weights: np.ndarray) -> Cover:
    """Points `where` (p, 3), with weights (p,), on some facets (n,) of a side in space that face a rigid surface."""
    facet, at = np.repeat(some, len(where)), np.tile(where, (len(some), 1))
    outward, gap = rigid.facing(np.einsum("qc,qcd->qd", at, side.xy[side.corners[facet]]))
    outward = np.where(outward.any(axis=1, keepdims=True), outward, -side.outward[facet])
    weight = np.tile(weights, len(some)) * facet_measures(side.xy[side.corners])[facet]
    return Cover(facet, at, facet, at, weight * stretch(side, facet, at), -outward,
                 gap - side.bulge(facet, at, -outward))


def _match_whole(first: Side, second: Side, name: str, refinement: int) -> Rows:
    """All nodes of both sides, one to one. Raises InputError."""
    if len(first.nodes) != len(second.nodes):
        raise InputError(f"contact.{name}: the two sides have {len(first.nodes)} and {len(second.nodes)} nodes; "
                         "their meshes must match node by node")
    here, match = np.arange(len(first.nodes)), cKDTree(second.xy).query(first.xy)[1]
    if len(np.unique(match)) != len(match):
        raise InputError(f"contact.{name}: the nodes of the two sides do not pair off one to one"
                         f"{_worst(first, second, match)}; their meshes must match node by node")
    normal = first.normal - second.normal[match]
    size = np.linalg.norm(normal, axis=1)
    if (size < 1.0).any():  # the outer normals must face each other (an angle above 120°)
        raise InputError(f"contact.{name}: near {in_words(first.xy[np.argmin(size)])} the two boundaries do not face "
                         "each other")
    normal /= size[:, None]
    gap, aside, spacing = _offset(first, second, here, match, normal)
    if (aside > LARGEST_OFFSET * refinement * spacing).any():
        raise InputError(f"contact.{name}: the nodes of the two sides do not lie opposite each other"
                         f"{_worst(first, second, match)}; their meshes must match node by node")
    return pairs((first, second), here, match, normal, (first.area + second.area[match]) / 2, gap,
                 np.ones(len(first.facets), bool))


def _match_partly(first: Side, second: Side, refinement: int) -> Rows | None:
    """The nodes of the part that two sides have in common, or nodes at which they meet; None unless each facet
    that faces the other side faces one facet, whose nodes are the partners of its own."""
    offset = LARGEST_OFFSET * refinement
    ours = _faced(first, second, offset)
    if any(len(np.unique(each)) < len(each) for each in ours):
        return None
    theirs = _faced(second, first, offset)[::-1]
    if not np.array_equal(ours, theirs[:, np.argsort(theirs[0], kind="stable")]):
        return None
    if ours.size:
        a, b = first.facets[ours[0]], second.facets[ours[1]]
        nearest = np.linalg.norm(first.xy[a][:, :, None] - second.xy[b][:, None], axis=3).argmin(axis=2)
        here, there = np.unique(np.stack([a.ravel(), np.take_along_axis(b, nearest, axis=1).ravel()]), axis=1)
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
        if not fits.any() or _unmatched(first, second, here[fits], there[fits]):
            return None
        here, there, normal, gap = here[fits], there[fits], normal[fits], gap[fits]
        area = (first.spacing[here] + second.spacing[there]) / 2
        area = area * circumference(np.maximum(first.xy[here], area[:, None] / 4), first.axisymmetric)
    elif not fits.all() or any(len(np.unique(each)) < len(each) for each in (here, there)):
        return None
    found = pairs((first, second), here, there, normal, area, gap, common[0])
    return replace(found, pointwise=not ours.size)


def _unmatched(first: Side, second: Side, here: np.ndarray, there: np.ndarray) -> bool:
    """Whether a neighbour of a paired node has no partner and lies on a facet at that node's partner, so that the two
    sides touch along an edge on which their nodes do not match. Nodes `here` and `there` (k,) are pairs."""
    for side, other, own, partner in ((first, second, here, there), (second, first, there, here)):
        edges, match = links(side.facets, side.dimension), np.full(len(side.nodes), -1)
        edges, match[own] = np.concatenate([edges, edges[:, ::-1]]), partner
        start, end = edges[(match[edges[:, 0]] >= 0) & (match[edges[:, 1]] < 0)].T
        corners = other.corners.ravel()
        order = np.argsort(corners, kind="stable")
        edge, place = together(match[start], corners[order])  # an edge, and a facet at its start's partner
        facet = other.xy[other.corners[order[place] // side.dimension]]
        away = side.xy[end] - side.xy[start] + other.xy[match[start]]
        off, along = across(away[edge] - facet[:, 0], facet)
        inside = (along > -LARGEST_OFFSET).all(axis=1) & (along.sum(axis=1) < 1.0 + LARGEST_OFFSET)
        size = np.linalg.norm(side.xy[end] - side.xy[start], axis=1)[edge]
        if (inside & (np.linalg.norm(off, axis=1) < LARGEST_OFFSET * size)).any():
            return True
    return False


def _faced(side: Side, other: Side, least: float) -> np.ndarray:
    """Facets of a side and those of the other one that they face (2, n), in the order of the first. A facet of which no
    more than the part `least` is covered does not count: by so much an end may stand aside."""
    over = cover(side, other)
    facets, point = np.unique(np.stack([over.facet, over.other]), axis=1, return_inverse=True)
    covered = np.bincount(point.ravel(), over.weight, facets.shape[1])
    return facets[:, covered > least * side.areas[facets[0]]]


def _offset(first: Side, second: Side, here: np.ndarray, there: np.ndarray,
            normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Each (k,): gaps along normals between the arcs over chords, how far partners lie aside, and the spacing there."""
    ends, offset = links(first.facets, first.dimension), second.xy[there] - first.xy[here]
    half = np.linalg.norm(first.xy[ends[:, 1]] - first.xy[ends[:, 0]], axis=1) / 2 / (first.dimension - 1)
    spacing = np.bincount(ends.ravel(), np.repeat(half, 2), len(first.nodes))[here]
    gap = np.einsum("ij,ij->i", offset, normal)
    aside = np.linalg.norm(offset - gap[:, None] * normal, axis=1)
    gap = gap - first.rise(here, normal) - second.rise(there, -normal)
    return without_rounding(gap, spacing), aside, spacing


def _worst(first: Side, second: Side, match: np.ndarray) -> str:
    distance = np.linalg.norm(second.xy[match] - first.xy, axis=1)
    k = int(np.argmax(distance))
    return f" (worst: {in_words(first.xy[k])} against {in_words(second.xy[match[k]])})"
