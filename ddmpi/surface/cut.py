"""The part of a side that faces another one in space: facets intersected with facets in the plane of the slave's.

Both facets are projected along the normal of the slave's, the plane triangle of its corners. Their common polygon is
cut into triangles with Gauss points (Puso and Laursen, Comput. Methods Appl. Mech. Engrg. 193, 2004). On facets of
order 2 the barycentric coordinates in these triangles are the parameters. Quadrilaterals take part as two triangles
each; the parameters of a point are those of their bilinear map.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ddmpi.mesh.elements import CELLS, Cell, facet_measures
from ddmpi.sets import magnitude
from ddmpi.surface.near import around
from ddmpi.surface.side import Side, cross, dot, unit
from ddmpi.system.numbers import ROUNDING, SAME, spans, together

FACING = -0.5
"""Surfaces face each other where the product of their outer normals is below this: up to 60° from opposite."""

CHUNK = 60_000
"""Pairs of facets that are cut at a time."""

PARALLEL = 1e-20
"""Lines with a squared cross product below this fraction of their squared lengths are parallel and do not cross."""


@dataclass(frozen=True)
class Cover:
    """Integration points on one side, the slave, and the points of the other side that they face.

    Attributes
    ----------
    facet, at : (q,) the slave's facet of a point, and (q, c) the hats of its corners there
    other, there : the same for the point of the other side
    weight : (q,) shares in the length or area of the slave's facets, around an axis in areas (m or m²)
    direction : (q, d) unit normal of the slave along which the other side is searched
    gap : (q,) distance of the smooth boundaries along it (m)
    """

    facet: np.ndarray
    at: np.ndarray
    other: np.ndarray
    there: np.ndarray
    weight: np.ndarray
    direction: np.ndarray
    gap: np.ndarray

    def only(self, some: np.ndarray) -> Cover:
        """Some of the points, by their numbers or (q,) bool."""
        return Cover(*(values[some] for values in vars(self).values()))


def cut(slave: Side, master: Side, depth: np.ndarray) -> Cover:
    """`cover` in space, up to a `depth` (f,) behind the slave's facets: Gauss points of the triangles that the facets
    are cut into, and the corners of these, without weight. Not collective."""
    slaves, masters = slave.xy[slave.simplices], master.xy[master.simplices]
    outward, backward = slave.flat, master.flat
    depth = np.tile(depth, len(slaves) // len(depth))
    facet, other = _near(slaves, masters, outward, backward)
    faces = dot(outward[facet], backward[other]) < FACING
    facet, other = facet[faces], other[faces]
    # The product of shape functions of both sides needs the rule of the higher order; of bilinear maps it is rational.
    where, weights = max(slave.cell, master.cell, key=lambda cell: cell.order).rule
    if not (slave.cell.simplex and master.cell.simplex):
        where, weights = CELLS[2, 1].fine
    rule = np.concatenate([where, np.eye(3)]), np.append(weights, np.zeros(3))
    cuts = [
        _cut(
            slaves,
            masters,
            outward,
            facet[start : start + CHUNK],
            other[start : start + CHUNK],
            rule,
        )
        for start in range(0, max(len(facet), 1), CHUNK)
    ]
    facet, other, at, there, weight = (np.concatenate(values) for values in zip(*cuts, strict=True))
    number = len(rule[1])
    distance = dot(
        np.einsum("qc,qcd->qd", there, masters[other]) - np.einsum("qc,qcd->qd", at, slaves[facet]),
        outward[facet],
    )
    keep = distance.reshape(-1, number).mean(axis=1) >= -depth[facet[::number]]
    piece, over, slack = facet[::number], other[::number], SAME * np.sqrt(facet_measures(slaves))
    middle, away = at.reshape(-1, number, 3).mean(axis=1), distance.reshape(-1, number).mean(axis=1)
    # Of several master facets over one place the nearest counts; and none, if another part of the slave lies in
    # between.
    pairs = np.unique(np.stack([piece, over]), axis=1)
    if pairs.shape[1] > len(np.unique(piece)):
        keep &= ~_hidden(slaves, outward, masters, pairs, piece, over, middle, away, slack, -np.inf)
    pairs = _opposite(slaves, outward, piece, away, slack)
    if pairs.size:
        keep &= ~_hidden(slaves, outward, slaves, pairs, piece, piece, middle, away, slack, 0.0)
    keep = np.repeat(keep, number)
    facet, other, at, there, weight, distance = (
        values[keep] for values in (facet, other, at, there, weight, distance)
    )
    ray = outward[facet]
    gap = distance - slave.bulge(facet, at, ray) - master.bulge(other, there, -ray)
    facet, at = slave.on_facets(facet, at)
    return Cover(
        facet, at, *master.on_facets(other, there), weight * stretch(slave, facet, at), ray, gap
    )


def stretch(side: Side, facet: np.ndarray, at: np.ndarray) -> np.ndarray:
    """Ratio (q,) of the areas of curved facets at points (q, c) and of plane ones with their corners."""
    if side.cell.linear:
        return np.ones(len(facet))

    def area(cell: Cell, nodes: np.ndarray) -> np.ndarray:
        one, two = np.einsum("aqk,qkd->aqd", cell.derivatives(at), side.xy[nodes[facet]])
        return magnitude(np.cross(one, two))

    if side.cell.simplex:
        return area(side.cell, side.facets) / 2 / facet_measures(side.xy[side.corners])[facet]
    return area(side.cell, side.facets) / area(side.cell.straight, side.corners)


def _near(
    slaves: np.ndarray, masters: np.ndarray, outward: np.ndarray, backward: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of facets that may lie over each other, sorted by the first. The master's nearest facet sets the distance
    of the search, by classes of equal size, so that a few large facets do not enlarge the search for small ones."""
    centre, far = slaves.mean(axis=1), masters.mean(axis=1)
    radius, reach = (
        magnitude(triangles - triangles.mean(axis=1, keepdims=True)).max(axis=1)
        for triangles in (slaves, masters)
    )
    pairs = []
    classes = np.floor(np.log2(reach))
    nearest = cKDTree(far).query(centre)[1]
    t = dot(far[nearest] - centre, outward)
    # Projected along its normal onto an inclined facet, a facet is up to 1/cos as large; 60° at most, by FACING.
    steep = np.maximum(np.abs(dot(outward, backward[nearest])), 0.5)
    place = centre + t[:, None] * outward
    aside = magnitude(far[nearest] - place)
    for level in np.unique(classes):
        some = np.flatnonzero(classes == level)
        largest = reach[some].max()
        ball = radius / steep + largest + np.maximum(aside - largest, 0.0)
        facet, other = around(place, ball, far[some])
        pairs.append(np.stack([facet, some[other]]))
    first, second = np.concatenate(pairs, axis=1)
    order = np.lexsort((second, first))
    return first[order], second[order]


def _axes(triangles: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """(f, 2, 3) unit vectors along and across the first edge of triangles (f, 3, 3) with normals (f, 3)."""
    first = unit(triangles[:, 1] - triangles[:, 0])
    return np.stack([first, np.cross(outward, first)], axis=1)


def _flat(points: np.ndarray, origin: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Points (p, c, 3) in the coordinates (p, c, 2) of planes with an origin (p, 3) and axes (p, 2, 3)."""
    return np.einsum("pcd,pad->pca", points - origin[:, None], axes)


def _barycentric(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The barycentric coordinates (p, c, 3) of points (p, c, 2) in triangles (p, 3, 2)."""
    a, (u, v) = triangles[:, :1], np.moveaxis(triangles[:, 1:] - triangles[:, :1], 1, 0)[:, :, None]
    away, area = points - a, cross(u, v)
    second, third = cross(away, v) / area, cross(u, away) / area
    return np.stack([1.0 - second - third, second, third], axis=-1)


def _cut(
    slaves: np.ndarray,
    masters: np.ndarray,
    outward: np.ndarray,
    facet: np.ndarray,
    other: np.ndarray,
    rule: tuple[np.ndarray, np.ndarray],
) -> tuple[np.ndarray, ...]:
    """Gauss points of the common polygons of pairs of facets: facets, coordinates on both, weights."""
    axes = _axes(slaves[facet], outward[facet])
    a, b = (_flat(corners, slaves[facet, 0], axes) for corners in (slaves[facet], masters[other]))
    b_in_a, a_in_b = _barycentric(b, a), _barycentric(a, b)
    # Corners of the common polygon of two triangles: corners of the one in the other, and crossings of edges. At most
    # 15 candidates a pair, in arrays, without branches by case.
    start, end = (np.repeat(corners, 3, axis=1) for corners in (a, np.roll(a, -1, axis=1)))
    begin, stop = (np.tile(corners, (1, 3, 1)) for corners in (b, np.roll(b, -1, axis=1)))
    along, across = end - start, stop - begin
    det = cross(along, across)
    crosses = det**2 > PARALLEL * (along**2).sum(axis=2) * (across**2).sum(axis=2)
    safe = np.where(crosses, det, 1.0)
    s, t = cross(begin - start, across) / safe, cross(begin - start, along) / safe
    crosses &= (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    points = np.concatenate([a, b, start + s[..., None] * along], axis=1)
    valid = np.concatenate(
        [(a_in_b >= -ROUNDING).all(axis=2), (b_in_a >= -ROUNDING).all(axis=2), crosses], axis=1
    )
    some = np.flatnonzero(valid.sum(axis=1) >= 3)
    points, valid, a, b, facet, other = (
        values[some] for values in (points, valid, a, b, facet, other)
    )
    # The polygon is convex: sorting by the angle around its middle gives its outline, with invalid points last.
    points = np.where(valid[..., None], points, 0.0)
    middle = points.sum(axis=1) / np.maximum(valid.sum(axis=1), 1)[:, None]
    away = points - middle[:, None]
    order = np.argsort(np.where(valid, np.arctan2(away[..., 1], away[..., 0]), np.inf), axis=1)
    points = np.take_along_axis(points, order[..., None], axis=1)
    last = valid.sum(axis=1)
    # Invalid points become copies of the first one, so that their triangles of the fan are empty.
    points = np.where(
        (np.arange(points.shape[1]) < last[:, None])[..., None], points, points[:, :1]
    )
    fan = np.stack(
        [np.broadcast_to(points[:, :1], points[:, 1:-1].shape), points[:, 1:-1], points[:, 2:]],
        axis=2,
    )
    area = cross(fan[:, :, 1] - fan[:, :, 0], fan[:, :, 2] - fan[:, :, 0]) / 2
    whole = np.abs(cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0])) / 2
    pair, piece = np.nonzero(
        area > ROUNDING * whole[:, None]
    )  # the others are rounding beside the facet
    fan, area, (where, weights) = fan[pair, piece], area[pair, piece], rule
    places = where @ fan
    at, there = _barycentric(places, a[pair]), _barycentric(places, b[pair])
    number = len(weights)
    return (
        np.repeat(facet[pair], number),
        np.repeat(other[pair], number),
        at.reshape(-1, 3),
        there.reshape(-1, 3),
        np.outer(area, weights).ravel(),
    )


def _opposite(
    slaves: np.ndarray,
    outward: np.ndarray,
    facet: np.ndarray,
    distance: np.ndarray,
    slack: np.ndarray,
) -> np.ndarray:
    """Pairs (2, p) of the slave's facets of which the second may lie between pieces (q,) of the first and the master.
    Balls along the normal are searched, up to the bounding box of the slave: a flat one has none."""
    centre, reach = slaves.mean(axis=1), np.zeros(len(slaves))
    radius = magnitude(slaves - centre[:, None]).max(initial=0.0)
    np.maximum.at(reach, facet, distance)
    room = np.where(outward > 0.0, slaves.max(axis=(0, 1)), slaves.min(axis=(0, 1))) - np.moveaxis(
        slaves, 1, 0
    )
    with np.errstate(divide="ignore", invalid="ignore"):
        leaves = np.abs(room / outward)
    # Where the ray from the farthest corner leaves the box of the slave no facet of it can follow.
    reach = np.minimum(reach, np.fmin.reduce(leaves, axis=2).max(axis=0))
    steps = np.where(reach > slack, np.ceil(reach / (2.0 * radius)), 0).astype(int)
    one, step = spans(np.zeros(len(slaves), int), steps)
    # Balls of 3 r at steps of 2 r hold all centres within 2 r of the ray: r for the facet, r for the piece's place.
    ahead = centre[one] + (2 * step[:, None] + 1) * radius * outward[one]
    ball, other = around(ahead, 3.0 * radius, centre)
    one = one[ball]
    opposed = dot(outward[one], outward[other]) < -SAME
    return np.unique(np.stack([one, other])[:, opposed], axis=1)


def _hidden(
    slaves: np.ndarray,
    outward: np.ndarray,
    triangles: np.ndarray,
    pairs: np.ndarray,
    facet: np.ndarray,
    other: np.ndarray,
    at: np.ndarray,
    distance: np.ndarray,
    slack: np.ndarray,
    least: float,
) -> np.ndarray:
    """Which pieces (p,), with middles `at` (p, 3), have one of the `triangles` (·, 3, 3) before the facet that they
    face, farther than `least`. `pairs` (2, r), sorted, are a facet's rivals; `other` (p,) itself does not count."""
    piece, candidate = together(facet, pairs[0])
    rival = pairs[1, candidate]
    on, rival, piece = (
        facet[piece][rival != other[piece]],
        rival[rival != other[piece]],
        piece[rival != other[piece]],
    )
    place = np.einsum("pc,pcd->pd", at[piece], slaves[on])
    axes = _axes(slaves[on], outward[on])
    inside = _barycentric(_flat(place[:, None], place, axes), _flat(triangles[rival], place, axes))[
        :, 0
    ]
    reach = dot(np.einsum("pc,pcd->pd", inside, triangles[rival]) - place, outward[on])
    before = (
        (inside >= -ROUNDING).all(axis=1)
        & (reach > least)
        & (np.abs(reach) < np.abs(distance[piece]) - slack[on])
    )
    return np.bincount(piece, before, len(facet)) > 0
