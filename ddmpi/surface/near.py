"""Which points lie in which boxes and cells, and how far they are from facets; in any dimension."""

from __future__ import annotations

from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from ddmpi.mesh.elements import invert
from ddmpi.sets import magnitude
from ddmpi.system.numbers import nearest_in, spans


def around(
    centres: np.ndarray, reach: np.ndarray | float, points: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of centres (c, d) and points (k, d) up to `reach` (c,) from them: numbers (q,) of both, sorted by
    centres."""
    near = cKDTree(points).query_ball_point(centres, reach)
    number = np.array([len(some) for some in near], int)
    return np.repeat(np.arange(len(centres)), number), np.fromiter(chain.from_iterable(near), int)


def nearest_of_each(some: np.ndarray, distance: np.ndarray) -> np.ndarray:
    """The entry with the least distance (k,) for each of the numbers `some` (k,), in their order."""
    order = np.lexsort((distance, some))
    return order[np.flatnonzero(np.diff(some[order], prepend=-1))]


def contained(
    points: np.ndarray, low: np.ndarray, high: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of points (k, d) and boxes from `low` to `high` (c, d) that contain them: numbers (q,) of both.

    A grid divides space along each axis so that points are spread evenly over its bins. A box looks at the points in
    the bins that it meets; those of a row of bins along the last axis follow each other.
    """
    (k, d), box = points.shape, np.arange(len(low))
    if not k or not len(low):
        return box[:0], box[:0]
    n = int(np.ceil(1.5 * k ** (1 / d)))  # bins along an axis; 1 to 2 are quickest
    walls = np.sort(points, axis=0)[np.arange(n) * k // n]

    def bins(x: np.ndarray) -> list[np.ndarray]:
        return [np.searchsorted(walls[:, axis], x[:, axis], "right") for axis in range(d)]

    number = np.ravel_multi_index(bins(points), (n + 1,) * d)
    order = np.argsort(number, kind="stable")
    starts = np.append(0, np.cumsum(np.bincount(number, minlength=(n + 1) ** d)))
    first, last, row = bins(low), bins(high), np.zeros(len(low), int)
    for axis in range(d - 1):
        owner, place = spans(first[axis][box], last[axis][box] + 1)
        row, box = (n + 1) * row[owner] + place, box[owner]
    row *= n + 1
    owner, place = spans(starts[row + first[-1][box]], starts[row + last[-1][box] + 1])
    point, box = order[place], box[owner]
    inside = ((low[box] <= points[point]) & (points[point] <= high[box])).all(axis=1)
    return point[inside], box[inside]


def most_inside(
    points: np.ndarray, corners: np.ndarray, own: tuple[np.ndarray, np.ndarray] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """The least barycentric coordinate (k,) of points (k, d) in the cell of which each is most inside, by the `corners`
    (d + 1, c, d) of the cells, and the number (k,) of this cell; −∞ and 0 for points that lie in the box of no cell.
    Cells that have a node of what a point is of do not count; `own` are these nodes, of points (k, ·) and cells (c, ·).
    """
    best, number = np.full(len(points), -np.inf), np.zeros(len(points), int)
    point, cell = contained(points, corners.min(axis=0), corners.max(axis=0))
    if own is not None:
        apart = ~(own[0][point, :, None] == own[1][cell, None, :]).any(axis=(1, 2))
        point, cell = point[apart], cell[apart]
    first, away = corners[0, cell], corners[1:, cell] - corners[0, cell]
    with np.errstate(divide="ignore", invalid="ignore"):  # no point is in a flat cell
        inverse = invert(np.ascontiguousarray(away.swapaxes(1, 2)))[0]  # ∂λ/∂x
        part = np.einsum("acp,pc->ap", inverse, points[point] - first)  # λ_1 … λ_d
        least = np.minimum(part.min(axis=0), 1.0 - part.sum(axis=0))
        np.fmax.at(best, point, least)
    most = np.flatnonzero(least == best[point])[::-1]  # of equal ones the first
    number[point[most]] = cell[most]
    return best, number


def distance_to(
    points: np.ndarray, facets: np.ndarray, least: float = 0.0
) -> tuple[np.ndarray, np.ndarray]:
    """The distance of each point (k, d) to the nearest of the facets (f, d, d), and the number of that one; up to
    `least` (m) those of a facet nearby are enough."""
    low, high = facets.min(axis=1), facets.max(axis=1)
    middle, half = (low + high) / 2.0, (high - low).max(axis=0) / 2.0
    stretch = np.maximum(
        half, 1e-3 * half.max()
    )  # of flat facets those are near that are beside a point
    number = cKDTree(middle / stretch).query(points / stretch)[1]
    distance = magnitude(nearest_in(points, facets[number]) - points)
    # The box of the nearest facet meets the one around a point that reaches as far as this facet.
    far = np.flatnonzero(distance > least)
    for block in np.array_split(far, len(far) * len(facets) // 2**20 + 1):  # bounds the memory
        reach = half + (1.0 + 1e-6) * distance[block, None]
        facet, point = contained(middle, points[block] - reach, points[block] + reach)
        point = block[point]
        away = magnitude(nearest_in(points[point], facets[facet]) - points[point])
        order = np.lexsort((-away, point))  # of each point the nearest one comes last and stays
        distance[point[order]], number[point[order]] = away[order], facet[order]
    return distance, number
