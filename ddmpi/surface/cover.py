"""The part of a side that faces another one: rays from the slave, cut where they meet corners of the master."""

from __future__ import annotations

import numpy as np

from ddmpi.mesh.elements import on_line
from ddmpi.sets import magnitude
from ddmpi.surface.curve import Curve
from ddmpi.surface.cut import FACING, Cover, cut
from ddmpi.surface.near import nearest_of_each
from ddmpi.surface.side import Side, cross, dot, unit
from ddmpi.system.numbers import ALIKE, SAME, together

DEEPEST = 0.5
"""Partners deeper than this fraction of the thinner body's depth belong to its far side and are ignored."""

POINTS = 5
"""Gauss points on each piece of a side, between its two ends, which have no weight."""

BLOCK = 32
"""The search for partners tests bounding boxes of this many facets first."""


def cover(slave: Side, master: Side) -> Cover:
    """The part of the slave that faces the master, along its averaged normals, in space along those of its facets.
    Some points have no weight: ends of pieces, in space corners. Not collective.

    Pieces, rays and gaps are computed on chords; a point of a curved facet lies upright on its chord. A piece of the
    slave faces the nearest facet of the master with a normal opposite to its own. Behind the slave, distances up to
    DEEPEST of the thinner body's depth count, as overlaps; ahead of it, any distance.
    """
    outward = slave.outward
    depth = DEEPEST * np.minimum(np.abs(outward) @ slave.extent, np.abs(outward) @ master.extent)
    if isinstance(slave, Curve) and isinstance(master, Curve):
        return _along(slave, master, depth)
    return cut(slave, master, depth)


def corners(over: Cover) -> Cover:
    """The points without weight of a cover in space, without repetition: corners of the common polygons of facets. The
    gap of plane facets has its extremes there. Not collective."""
    some = np.flatnonzero(over.weight == 0.0)
    # corners whose barycentric coordinates are the SAME are one
    key, size = over.facet[some], int(2.0 / SAME)
    for coordinate in over.at[some, :2].T:
        key = size * key + np.round(coordinate / SAME).astype(np.int64)
    return over.only(some[np.unique(key, return_index=True)[1]])


def _along(slave: Curve, master: Curve, depth: np.ndarray) -> Cover:
    """`cover` in the plane, where facets (f,) count up to their `depth` behind the slave."""
    outward = slave.outward
    chords, corners, fans = slave.xy[slave.corners], master.xy[master.corners], slave.fans
    length = magnitude(slave.along)
    # The rays of a facet sweep from its first to its second averaged normal; a master facet outside of this strip faces
    # none of it.
    facet, one = _swept(corners, chords, fans)
    facing = dot(outward[facet], master.outward[one]) < FACING
    facet, one = facet[facing], one[facing]
    # Within a piece no ray meets a corner of the master, so that integrands are smooth and Gauss's rule exact; without
    # cutting, constant pressures fail the patch test.
    on, low, high = _pieces(facet, corners[one], chords, fans)
    middle = (low + high) / 2
    piece, pair = together(on, facet)
    there, distance, _ = _meet(chords, fans, on[piece], middle[piece], corners[one[pair]])
    # One ray from the middle of a piece tells which master facets it meets: no corners lie in between.
    met = (there >= -ALIKE) & (there <= 1.0 + ALIKE) & (distance >= -depth[on[piece]])
    piece, pair, signed = piece[met], pair[met], distance[met]
    nearest = nearest_of_each(piece, np.abs(signed))
    piece, one, distance = piece[nearest], one[pair[nearest]], signed[nearest]
    # A piece whose rays pass through another part of the slave itself does not face the master: ahead of it across a
    # slot, behind it across a tooth, out of whose other flank they leave the slave before they meet the master.
    seen = ~_hidden(chords, fans, on[piece], middle[piece], distance)
    piece, one = piece[seen], np.repeat(one[seen], POINTS + 2)
    facet, low, size = on[piece], low[piece], (high - low)[piece]
    points, weights = (np.pad(rule, 1) for rule in np.polynomial.legendre.leggauss(POINTS))
    # Both ends without weight: there, gaps of straight facets have their extremes, and overlaps are looked for.
    points[[0, -1]] = -1.0, 1.0
    at = (low[:, None] + size[:, None] * (1.0 + points) / 2).ravel()
    weight = ((length[facet] * size)[:, None] * weights / 2).ravel()
    facet = np.repeat(facet, POINTS + 2)
    there, distance, ray = _meet(chords, fans, facet, at, corners[one])
    # The chords of curved boundaries stand off by h²/8R, more than most fits: the gap is between the arcs.
    gap = distance - slave.bulge(facet, at, ray) - master.bulge(one, np.clip(there, 0.0, 1.0), -ray)
    height, ratio = slave.off_chords(facet, at)
    on = slave.parameters(facet, at, outward[facet])
    # A point of a curved facet is `height` off its chord; moved by so much along the chord's normal, its ray meets the
    # master's chord elsewhere.
    there = np.clip(
        there + height * cross(outward[facet], ray) / cross(master.along[one], ray), 0.0, 1.0
    )
    return Cover(
        facet,
        on_line(on),
        one,
        on_line(master.parameters(one, there, ray)),
        weight * ratio,
        ray,
        gap,
    )


def faced_arc(xy: np.ndarray, rows: np.ndarray, over: Cover, master: Side) -> np.ndarray:
    """Arc lengths (m,) of the master's points nearest to `xy` (m, 2), on facets that the rows (q, c) of points face."""
    row, facet = np.unique(np.stack([rows.ravel(), np.repeat(over.other, rows.shape[1])]), axis=1)
    start, end = master.corners[facet].T
    along = master.xy[end] - master.xy[start]
    away = xy[row] - master.xy[start]
    at = np.clip(dot(away, along) / dot(along, along), 0.0, 1.0)
    nearest = nearest_of_each(row, magnitude(away - at[:, None] * along))
    # At the second end its own arc length counts: zero where a closed chain ends in its start.
    arc = np.where(
        at < 1.0 - ALIKE, master.arc[start] + at * master.lengths[facet], master.arc[end]
    )
    return arc[nearest]


def _swept(
    segments: np.ndarray, facets: np.ndarray, fans: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of a facet (·, 2, 2) and a segment (·, 2, 2) that rays from the facet may meet, forward or backward, sorted
    by facets. Rays at its ends have the directions `fans` (·, 2, 2). Boxes of BLOCK segments are tested first."""
    first = np.arange(0, len(segments), BLOCK)
    low, high = (
        np.minimum.reduceat(segments.min(axis=1), first),
        np.maximum.reduceat(segments.max(axis=1), first),
    )
    boxes = np.where([[[0, 0], [1, 0], [0, 1], [1, 1]]], high[:, None], low[:, None])
    facet, box = np.nonzero(_crossed(boxes, facets[:, None], fans[:, None]))
    one = (BLOCK * box[:, None] + np.arange(BLOCK)).ravel()
    facet, one = np.repeat(facet, BLOCK)[one < len(segments)], one[one < len(segments)]
    crossed = _crossed(segments[one], facets[facet], fans[facet])
    return facet[crossed], one[crossed]


def _crossed(points: np.ndarray, facets: np.ndarray, fans: np.ndarray) -> np.ndarray:
    """Whether points (…, c, 2) lie neither all to the left nor all to the right of the lines of both end rays."""
    beside = cross(fans[..., None, :], points[..., None, :, :] - facets[..., None, :])
    slack = ALIKE * magnitude(facets[..., 1, :] - facets[..., 0, :])[..., None, None]
    return ~((beside < -slack).all(axis=(-2, -1)) | (beside > slack).all(axis=(-2, -1)))


def _meet(
    facets: np.ndarray, fans: np.ndarray, facet: np.ndarray, at: np.ndarray, segments: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Parameters on segments (q, 2, 2) where rays from places `at` (q,) on facets meet them, distances, and rays."""
    ray = unit(fans[facet, 0] + at[:, None] * (fans[facet, 1] - fans[facet, 0]))
    away = segments[:, 0] - (facets[facet, 0] + at[:, None] * (facets[facet, 1] - facets[facet, 0]))
    across = segments[:, 1] - segments[:, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        there = -cross(away, ray) / cross(across, ray)
        return there, dot(away + there[:, None] * across, ray), ray


def _hidden(
    facets: np.ndarray, fans: np.ndarray, facet: np.ndarray, at: np.ndarray, distance: np.ndarray
) -> np.ndarray:
    """Whether rays from places `at` (q,) on facets meet another facet on the way to the distances (q,), signed."""
    some = np.unique(facet)
    source, other = _swept(facets, facets[some], fans[some])
    source = some[source]
    source, other = source[source != other], other[source != other]
    point, pair = together(facet, source)
    there, t, _ = _meet(facets, fans, facet[point], at[point], facets[other[pair]])
    slack = ALIKE * magnitude(facets[:, 1] - facets[:, 0])[facet[point]]
    ahead, way = t * np.sign(distance[point]), np.abs(distance[point])
    between = (there > 0.0) & (there < 1.0) & (ahead > slack) & (ahead < way)
    return np.bincount(point, between, len(facet)) > 0


def _pieces(
    facet: np.ndarray, segments: np.ndarray, facets: np.ndarray, fans: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The pieces of facets between the places where rays hit ends of segments (p, 2, 2): facet, start and end, (q,).
    The facets (p,) of the segments are sorted."""
    chords, rays = facets[facet], fans[facet]
    fan, turn, along = rays[:, :1], rays[:, 1:] - rays[:, :1], chords[:, 1:] - chords[:, :1]
    points = segments - chords[:, :1]
    # The ray at t from x_0 + t L with direction f + t w meets p if (p − x_0 − t L) × (f + t w) = 0, a quadratic in t:
    # −L×w t² + (p×w − L×f) t + p×f = 0, with p from x_0.
    a = np.broadcast_to(-cross(along, turn), points.shape[:2])
    b, c = cross(points, turn) - cross(along, fan), cross(points, fan)
    with np.errstate(divide="ignore", invalid="ignore"):
        # Both roots without cancellation: q/a and c/q. Complex ones and those of a = 0 are NaN or infinite.
        q = -(b + np.where(b < 0.0, -1.0, 1.0) * np.sqrt(b * b - 4.0 * a * c)) / 2.0
        roots = np.column_stack([c / q, q / a])
    inside = (roots > ALIKE) & (roots < 1.0 - ALIKE)
    ends = np.unique(facet)
    on = np.concatenate([np.repeat(facet, roots.shape[1])[inside.ravel()], ends, ends])
    cuts = np.concatenate([roots[inside], np.zeros(len(ends)), np.ones(len(ends))])
    order = np.lexsort((cuts, on))
    on, cuts = on[order], cuts[order]
    apart = (
        np.append(True, (np.diff(cuts) > ALIKE) | (np.diff(on) != 0))
        if len(on)
        else np.empty(0, bool)
    )
    on, cuts = on[apart], cuts[apart]
    inner = np.flatnonzero(np.diff(on) == 0)
    return on[inner], cuts[inner], cuts[inner + 1]
