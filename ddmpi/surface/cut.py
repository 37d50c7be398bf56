"""Which part of a side faces another one, in space: facets cut by facets in the plane of the slave's.

Both are projected along the normal of the slave's facet, which is a plane triangle of its corners; the polygon that
they have in common is cut into triangles with Gauss's points (Puso and Laursen, Comput. Methods Appl. Mech. Engrg. 193,
2004). Facets of order 2 have the barycentric coordinates of these triangles for their parameters.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial import cKDTree

from ddmpi.mesh.elements import facet_measures
from ddmpi.surface.side import Side, cross, unit
from ddmpi.system.numbers import spans, together

FACING = -0.5
"""Surfaces face each other where the product of their outer normals is below this: up to 60° from opposite."""

CHUNK = 60_000
"""Pairs of facets that are cut at a time."""

PARALLEL = 1e-20
"""Lines whose cross product squared is below this part of their lengths squared are parallel and have no crossing."""

INSIDE = 1e-12
"""Corners lie in a triangle up to this part of its coordinates."""

SMALLEST = 1e-14
"""Triangles below this part of their facet's area are rounding."""

BEHIND = 1e-6
"""What lies nearer by more than this part of a facet's size hides what lies behind it."""


@dataclass(frozen=True)
class Cover:
    """Points on one side, the slave, that face the other one, at which integrals are taken.

    Attributes
    ----------
    facet, at : (q,) the slave's facet of each point, and (q, d) where on it, by barycentric coordinates
    other, there : the same of the point that it faces
    weight : (q,) parts of the length or area of the slave's facets, around an axis of their areas (m or m²)
    direction : (q, d) unit normal along which the other side is looked for
    gap : (q,) distance along it of the boundaries that are meant (m)
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
        return Cover(*(each[some] for each in vars(self).values()))


def cut(slave: Side, master: Side, depth: np.ndarray) -> Cover:
    """`cover` in space, where facets (f,) count up to their `depth` behind the slave: Gauss's points in the triangles
    that its facets are cut into, and the corners of these, without weight. Not collective."""
    own, others = slave.xy[slave.corners], master.xy[master.corners]
    outward, backward = slave.outward, master.outward
    facet, other = _near(own, others, outward, backward)
    faces = np.einsum("pd,pd->p", outward[facet], backward[other]) < FACING
    facet, other = facet[faces], other[faces]
    where, weights = max(slave.cell, master.cell, key=lambda cell: cell.order).rule
    rule = np.concatenate([where, np.eye(3)]), np.append(weights, np.zeros(3))
    found = [_cut(own, others, outward, facet[start:start + CHUNK], other[start:start + CHUNK], rule)
             for start in range(0, max(len(facet), 1), CHUNK)]
    facet, other, at, there, weight = (np.concatenate(each) for each in zip(*found, strict=True))
    number = len(rule[1])
    distance = np.einsum("qd,qd->q", np.einsum("qc,qcd->qd", there, others[other])
                         - np.einsum("qc,qcd->qd", at, own[facet]), outward[facet])
    keep = distance.reshape(-1, number).mean(axis=1) >= -depth[facet[::number]]
    piece, over, slack = facet[::number], other[::number], BEHIND * np.sqrt(facet_measures(own))
    middle, away = at.reshape(-1, number, 3).mean(axis=1), distance.reshape(-1, number).mean(axis=1)
    pairs = np.unique(np.stack([piece, over]), axis=1)
    if pairs.shape[1] > len(np.unique(piece)):
        keep &= ~_hidden(own, outward, others, pairs, piece, over, middle, away, slack, -np.inf)
    pairs = _opposite(own, outward, piece, away, slack)
    if pairs.size:
        keep &= ~_hidden(own, outward, own, pairs, piece, piece, middle, away, slack, 0.0)
    keep = np.repeat(keep, number)
    facet, other, at, there, weight, distance = (
        each[keep] for each in (facet, other, at, there, weight, distance))
    ray = outward[facet]
    return Cover(facet, at, other, there, weight * stretch(slave, facet, at), ray,
                 distance - slave.bulge(facet, at, ray) - master.bulge(other, there, -ray))


def stretch(side: Side, facet: np.ndarray, at: np.ndarray) -> np.ndarray:
    """The area of facets at points (q, 3), over that of their plane triangles."""
    if side.cell.linear:
        return np.ones(len(facet))
    slopes, flat = side.cell.derivatives(at), facet_measures(side.xy[side.corners])
    slopes = np.einsum("aqk,qkd->aqd", slopes, side.xy[side.facets[facet]])
    return np.linalg.norm(np.cross(slopes[0], slopes[1]), axis=1) / 2 / flat[facet]


def _near(own: np.ndarray, others: np.ndarray, outward: np.ndarray, backward: np.ndarray) \
        -> tuple[np.ndarray, np.ndarray]:
    """Pairs of facets of which one may lie over the other, in the order of the first. The nearest of the master's gives
    the distance at which others are looked for; those of one size at a time, so that large ones are not dear."""
    centre, far = own.mean(axis=1), others.mean(axis=1)
    radius, reach = (np.linalg.norm(each - each.mean(axis=1, keepdims=True), axis=2).max(axis=1)
                     for each in (own, others))
    facet, other = [np.empty(0, int)], [np.empty(0, int)]
    classes = np.floor(np.log2(reach))
    nearest = cKDTree(far).query(centre)[1]
    t = np.einsum("fd,fd->f", far[nearest] - centre, outward)
    steep = np.maximum(np.abs(np.einsum("fd,fd->f", outward, backward[nearest])), 0.5)
    place = centre + t[:, None] * outward
    aside = np.linalg.norm(far[nearest] - place, axis=1)
    for each in np.unique(classes):
        some = np.flatnonzero(classes == each)
        largest = reach[some].max()
        ball = radius / steep + largest + np.maximum(aside - largest, 0.0)
        members = cKDTree(far[some]).query_ball_point(place, ball)
        facet.append(np.repeat(np.arange(len(own)), [len(found) for found in members]))
        other.append(some[np.concatenate([np.empty(0, int), *map(np.asarray, filter(len, members))]).astype(int)])
    first, second = np.concatenate(facet), np.concatenate(other)
    order = np.lexsort((second, first))
    return first[order], second[order]


def _axes(triangles: np.ndarray, outward: np.ndarray) -> np.ndarray:
    """(f, 2, 3) unit vectors along the first edge of triangles (f, 3, 3) with normals (f, 3), and across it."""
    first = unit(triangles[:, 1] - triangles[:, 0])
    return np.stack([first, np.cross(outward, first)], axis=1)


def _flat(points: np.ndarray, origin: np.ndarray, axes: np.ndarray) -> np.ndarray:
    """Points (p, c, 3) in the coordinates (p, c, 2) of planes with an origin (p, 3) and axes (p, 2, 3)."""
    return np.einsum("pcd,pad->pca", points - origin[:, None], axes)


def _barycentric(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """The coordinates (p, c, 3) of points (p, c, 2) in triangles (p, 3, 2)."""
    a, (u, v) = triangles[:, :1], np.moveaxis(triangles[:, 1:] - triangles[:, :1], 1, 0)[:, :, None]
    away, area = points - a, cross(u, v)
    second, third = cross(away, v) / area, cross(u, away) / area
    return np.stack([1.0 - second - third, second, third], axis=-1)


def _cut(own: np.ndarray, others: np.ndarray, outward: np.ndarray, facet: np.ndarray, other: np.ndarray,
         rule: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, ...]:
    """Gauss's points of the polygons that pairs of facets have in common: facets, coordinates on both, weights."""
    axes = _axes(own[facet], outward[facet])
    a, b = (_flat(each, own[facet, 0], axes) for each in (own[facet], others[other]))
    b_in_a, a_in_b = _barycentric(b, a), _barycentric(a, b)
    start, end = (np.repeat(each, 3, axis=1) for each in (a, np.roll(a, -1, axis=1)))
    begin, stop = (np.tile(each, (1, 3, 1)) for each in (b, np.roll(b, -1, axis=1)))
    along, across = end - start, stop - begin
    det = cross(along, across)
    crosses = det**2 > PARALLEL * (along**2).sum(axis=2) * (across**2).sum(axis=2)
    safe = np.where(crosses, det, 1.0)
    s, t = cross(begin - start, across) / safe, cross(begin - start, along) / safe
    crosses &= (s >= 0.0) & (s <= 1.0) & (t >= 0.0) & (t <= 1.0)
    points = np.concatenate([a, b, start + s[..., None] * along], axis=1)
    valid = np.concatenate([(a_in_b >= -INSIDE).all(axis=2), (b_in_a >= -INSIDE).all(axis=2), crosses], axis=1)
    some = np.flatnonzero(valid.sum(axis=1) >= 3)
    points, valid, a, b, facet, other = (each[some] for each in (points, valid, a, b, facet, other))
    points = np.where(valid[..., None], points, 0.0)
    middle = points.sum(axis=1) / np.maximum(valid.sum(axis=1), 1)[:, None]
    away = points - middle[:, None]
    order = np.argsort(np.where(valid, np.arctan2(away[..., 1], away[..., 0]), np.inf), axis=1)
    points = np.take_along_axis(points, order[..., None], axis=1)
    last = valid.sum(axis=1)
    points = np.where((np.arange(points.shape[1]) < last[:, None])[..., None], points, points[:, :1])
    fan = np.stack([np.broadcast_to(points[:, :1], points[:, 1:-1].shape), points[:, 1:-1], points[:, 2:]], axis=2)
    area = cross(fan[:, :, 1] - fan[:, :, 0], fan[:, :, 2] - fan[:, :, 0]) / 2
    whole = np.abs(cross(a[:, 1] - a[:, 0], a[:, 2] - a[:, 0])) / 2
    pair, piece = np.nonzero(area > SMALLEST * whole[:, None])
    fan, area, (where, weights) = fan[pair, piece], area[pair, piece], rule
    places = where @ fan
    at, there = _barycentric(places, a[pair]), _barycentric(places, b[pair])
    number = len(weights)
    return (np.repeat(facet[pair], number), np.repeat(other[pair], number), at.reshape(-1, 3), there.reshape(-1, 3),
            np.outer(area, weights).ravel())


def _opposite(own: np.ndarray, outward: np.ndarray, facet: np.ndarray, distance: np.ndarray,
              slack: np.ndarray) -> np.ndarray:
    """Pairs (2, p) of the slave's facets of which the second may lie before what pieces (q,) of the first face. They
    are looked for in balls along the normal, no farther than the box around the slave: a flat one has none."""
    centre, reach = own.mean(axis=1), np.zeros(len(own))
    radius = np.linalg.norm(own - centre[:, None], axis=2).max(initial=0.0)
    np.maximum.at(reach, facet, distance)
    room = np.where(outward > 0.0, own.max(axis=(0, 1)), own.min(axis=(0, 1))) - np.moveaxis(own, 1, 0)
    with np.errstate(divide="ignore", invalid="ignore"):
        leaves = np.abs(room / outward)
    reach = np.minimum(reach, np.fmin.reduce(leaves, axis=2).max(axis=0))
    one, step = spans(np.zeros(len(own), int), np.where(reach > slack, np.ceil(reach / (2.0 * radius)), 0).astype(int))
    ahead = centre[one] + (2 * step[:, None] + 1) * radius * outward[one]
    found = cKDTree(centre).query_ball_point(ahead, 3.0 * radius)
    one = np.repeat(one, [len(each) for each in found])
    other = np.concatenate([np.empty(0, int), *map(np.asarray, filter(len, found))]).astype(int)
    opposed = np.einsum("pd,pd->p", outward[one], outward[other]) < -BEHIND
    return np.unique(np.stack([one, other])[:, opposed], axis=1)


def _hidden(own: np.ndarray, outward: np.ndarray, triangles: np.ndarray, pairs: np.ndarray, facet: np.ndarray,
            other: np.ndarray, at: np.ndarray, distance: np.ndarray, slack: np.ndarray, least: float) -> np.ndarray:
    """Which pieces (p,), with middles at (p, 3), have another of the `triangles` (·, 3, 3) before what they face, from
    the distance `least` on. `pairs` (2, r), sorted, has each facet's rivals, `other` (p,) what is none of them."""
    piece, candidate = together(facet, pairs[0])
    rival = pairs[1, candidate]
    on, rival, piece = facet[piece][rival != other[piece]], rival[rival != other[piece]], piece[rival != other[piece]]
    place = np.einsum("pc,pcd->pd", at[piece], own[on])
    axes = _axes(own[on], outward[on])
    inside = _barycentric(_flat(place[:, None], place, axes), _flat(triangles[rival], place, axes))[:, 0]
    reach = np.einsum("pd,pd->p", np.einsum("pc,pcd->pd", inside, triangles[rival]) - place, outward[on])
    before = (inside >= -INSIDE).all(axis=1) & (reach > least) & (np.abs(reach) < np.abs(distance[piece]) - slack[on])
    return np.bincount(piece, before, len(facet)) > 0
