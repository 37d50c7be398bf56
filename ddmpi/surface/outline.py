"""What a side faces, to its true outline: the straight cells in which contacts are written and drawn."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.mesh.elements import curved_facets, facet_measures
from ddmpi.surface.cut import Cover
from ddmpi.surface.side import Side
from ddmpi.system.numbers import ALIKE, ROUNDING

HALVED = {
    2: np.array([[[2, 0], [1, 1]], [[1, 1], [0, 2]]]) / 2,
    3: np.array(
        [
            [[2, 0, 0], [1, 1, 0], [1, 0, 1]],
            [[1, 1, 0], [0, 2, 0], [0, 1, 1]],
            [[1, 0, 1], [0, 1, 1], [0, 0, 2]],
            [[1, 1, 0], [0, 1, 1], [1, 0, 1]],
        ]
    )
    / 2,
}
"""Coordinates of the corners of the parts of a line or triangle with halved edges, by the dimension of space."""

ROUNDS, MOST_MOVED = 8, 0.5
"""Secant steps for places on curved facets, and by which part of its height over the chord a corner may move."""


@dataclass(frozen=True)
class Outline:
    """What faces the other side, to its true outline: whole facets of the slave, and pieces of others.

    Attributes
    ----------
    xy, cells : (n, d) points (m), the nodes of the `lines` first, and (c, d) the lines or triangles between them
    shares : (n, m) sparse, values at the points from those of the rows; its rows sum to one
    """

    xy: np.ndarray
    cells: np.ndarray
    shares: sparse.csr_matrix


class Outlined(NamedTuple):
    """Straight cells of what a side covers: the facet (c,) of each, the hats (c, d, ·) of the facet's corners at its
    own, and their `hats` (c, d, ·), by which values are interpolated; and what they should measure in all (m or m²)."""

    facet: np.ndarray
    at: np.ndarray
    hats: np.ndarray
    measure: float


def outlined(side: Side, over: Cover, hats: np.ndarray) -> Outlined:
    """What a cover with its corners covers, to its true outline: facets that are whole, and of others the pieces. The
    `hats` (q, d) belong to the points of the cover. Not collective."""
    d, ends = side.dimension, np.flatnonzero(over.weight == 0.0)
    facet, at, hats = (
        over.facet[ends[::d]],
        over.at[ends].reshape(-1, d, over.at.shape[1]),
        hats[ends].reshape(-1, d, hats.shape[1]),
    )
    # the determinant of a piece's coordinates is its part of the facet, negative if it is turned inward
    parameters = side.cell.parameters(at)
    parts = (
        np.linalg.det(at)
        if side.cell.simplex
        else np.linalg.det(parameters[:, 1:] - parameters[:, :1]) / 2
    )
    at[parts < 0.0], hats[parts < 0.0] = at[parts < 0.0, ::-1], hats[parts < 0.0, ::-1]
    share = np.bincount(facet, np.abs(parts), len(side.facets))
    pieces = ~(np.abs(share - 1.0) <= ALIKE)[facet]
    whole, corners = _whole(side, np.setdiff1d(facet, facet[pieces]))
    facet = np.append(whole, facet[pieces])
    order = np.argsort(facet, kind="stable")
    return Outlined(
        facet[order],
        np.concatenate([corners, at[pieces]])[order],
        np.concatenate([corners, hats[pieces]])[order],
        float(over.weight.sum()),
    )


def whole_facets(side: Side, some: np.ndarray) -> Outlined:
    """`outlined` facets of a side that are whole, marked by `some` (f,) bool."""
    facet, corners = _whole(side, np.flatnonzero(some))
    return Outlined(facet, corners, corners, float(side.areas[some].sum()))


def _whole(side: Side, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The facets (n,) as simplices: the facet of each, and the hats (·, d, c) at its corners."""
    corners = np.eye(side.corners.shape[1])[side.cell.straight.parts]
    return np.repeat(facets, len(corners)), np.tile(corners, (len(facets), 1, 1))


def drawn_cells(side: Side, covered: Outlined) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The corners of straight cells that are fine enough to be drawn, d of each cell one by one: the facet (q,),
    the place (q, d) (m), and the hats (q, d) of each, none negative. Not collective."""
    facet, at, hats, measure = covered
    d = side.dimension
    # In the plane rows stand at middles, too, and cells end there; in space curved facets make sixteen.
    curved = curved_facets(side.xy[side.facets])
    for halved in (
        () if side.cell.linear else (curved | side.cell.bears, curved & (not side.cell.bears))
    ):
        fine = halved[facet]
        halves = [
            (HALVED[d] @ values[fine, None]).reshape(-1, *values.shape[1:]) for values in (at, hats)
        ]
        number = np.where(fine, len(HALVED[d]), 1)
        facet, at, hats = (np.repeat(values, number, axis=0) for values in (facet, at, hats))
        at[np.repeat(fine, number)], hats[np.repeat(fine, number)] = halves
    facet, at, hats = (
        np.repeat(facet, d),
        *(values.reshape(-1, values.shape[2]) for values in (at, hats)),
    )
    hats = np.maximum(hats, 0.0)
    return facet, _of_measure(side, facet, at, measure), hats / hats.sum(axis=1, keepdims=True)


def _of_measure(side: Side, facet: np.ndarray, at: np.ndarray, measure: float) -> np.ndarray:
    """Places (q, d) at coordinates `at` (q, d) on facets (q,), corners of straight cells one after the other. Cells on
    curved facets cut the arcs short: their corners move outward a little, so that all cells together `measure` as much
    as the arcs."""
    d = side.dimension
    flat = np.einsum("qc,qcd->qd", at, side.xy[side.corners[facet]])
    arc = np.einsum("qc,qcd->qd", side.cell.shapes(at), side.xy[side.facets[facet]]) - flat

    def excess(factor: float) -> float:
        return (
            float(facet_measures((flat + factor * arc).reshape(-1, d, d), side.axisymmetric).sum())
            - measure
        )

    last, factor = (0.0, excess(0.0)), 1.0
    for _ in range(
        ROUNDS if (np.abs(arc) > ROUNDING * np.ptp(side.xy, axis=0).max()).any() else 0
    ):  # secants
        now = excess(factor)
        if abs(now) <= ROUNDING * measure or now == last[1]:
            break
        last, factor = (factor, now), factor - now * (factor - last[0]) / (now - last[1])
    return flat + (factor if abs(factor - 1.0) < MOST_MOVED else 1.0) * arc
