"""Views of bodies: direction, cut, and hidden surfaces. The plane is seen from the front."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import SHARPEST
from ddmpi.mesh.elements import facet_measures, normals
from ddmpi.mesh.mesh import boundary_facets
from ddmpi.results.fields import boundary_of, linear_parts
from ddmpi.scene.output import VIEWS
from ddmpi.sets import magnitude
from ddmpi.surface.near import around
from ddmpi.surface.side import cross, unit
from ddmpi.system.numbers import ALIKE, nearest_in, spans

CORNER, ABOVE = (-60.0, 24.0), 40.0
"""Default azimuth and elevation (degrees) of solids: half the azimuth for those longer along y than along x or cut
across x; the second elevation for those cut across z."""

CROSSED = {
    1: [[(0, 1), (0, 2), (0, 3)]],
    2: [[(0, 2), (0, 3), (1, 3)], [(0, 2), (1, 3), (1, 2)]],
    3: [[(0, 3), (1, 3), (2, 3)]],
}
"""Triangles in which a plane cuts a tetrahedron, as edges between its corners, by the number of corners behind the
plane; these come first."""

MEETING = 0.02  # edges of cells meet if they are this near to each other, over their length
CHUNK = 100_000  # number of candidate pixels per block of work

Paint = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""The colours (p, 3 or 4) of places on facets (p,), with barycentric coordinates (p, 3)."""


def _corner(points: np.ndarray, across: Collection[int]) -> tuple[float, float]:
    """The azimuth and elevation (degrees) of solids with points (nv, 3) that are cut `across` some axes; see CORNER."""
    extent = np.ptp(points, axis=0)
    low = (extent[0] < 0.99 * extent[1] and 1 not in across) or 0 in across
    return CORNER[0] / (1 + low), ABOVE if 2 in across else CORNER[1]


def _axes(angles: Sequence[float]) -> np.ndarray:
    """The axes (3, 3) of an orthogonal projection: the third points to azimuth and elevation, the first is level."""
    (c, up), (s, high) = np.cos(np.deg2rad(angles)), np.sin(np.deg2rad(angles))
    return np.array([[-s, c, 0.0], [-c * high, -s * high, up], [c * up, s * up, high]])


def angles_of(eye: np.ndarray) -> list[float]:
    """The azimuth and elevation (degrees) of a unit vector (3,)."""
    up = np.arcsin(np.clip(eye[2], -1.0, 1.0))
    return np.degrees([np.arctan2(eye[1], eye[0]), up]).tolist()


class View:
    """The direction of an orthogonal projection of bodies, and the plane that cuts them open.

    Attributes
    ----------
    axes : (3, 3) unit vectors to the right, upwards, and towards the eye
    solid : whether bodies are solids
    cut : (3,) unit normal, towards the eye, of a plane in front of which nothing is drawn, and its distance from the
        origin (m); or None
    """

    def __init__(self, points: np.ndarray, output: Mapping[str, Any] | None = None) -> None:
        """Of nodes (nv, d), as the table `output` of a scene asks for. Raises InputError where a cut meets no body."""
        self.solid, self.axes, self.cut = points.shape[1] > 2, np.eye(3), None
        asked, cut = (output or {}).get("view"), (output or {}).get("cut") or {}
        asked = None if isinstance(asked, bool) else asked  # whether there is a view.html
        across = {k: cut[axis] for k, axis in enumerate("xyz") if cut.get(axis) is not None}
        if not self.solid:
            if asked or across:
                raise InputError("only pictures of solids have a view and a cut; leave them out")
            return
        self.axes = _axes(
            VIEWS[asked] if isinstance(asked, str) else asked or _corner(points, across)
        )
        for k, at in across.items():
            low, high = points[:, k].min(), points[:, k].max()
            if not 2.0 * ALIKE * (high - low) < min(at - low, high - at):
                raise InputError(
                    f"a cut at {'xyz'[k]} = {at:g} meets no body; they reach from {low:g} to {high:g}"
                )
            sign = 1.0 if self.axes[2, k] > -1e-9 else -1.0
            self.cut = sign * np.eye(3)[k], sign * at

    def place(self, at: np.ndarray) -> np.ndarray:
        """Coordinates of points (…, d) to the right, upwards, and towards the eye."""
        return at @ self.axes[:, : at.shape[-1]].T

    def beyond(self, at: np.ndarray) -> np.ndarray:
        """Distance of points (k, d) in front of the cut (m); zero without a cut."""
        distance = np.zeros(len(at)) if self.cut is None else at @ self.cut[0] - self.cut[1]
        return np.where(np.abs(distance) > ALIKE * np.ptp(distance), distance, 0.0)


class Skin:
    """The triangles of bodies in a picture: in the plane all of them, in space those of boundaries and of a cut.

    Attributes
    ----------
    facets : (f, 3) nodes, counter-clockwise as seen from outside; on a cut they go on after the last node
    cell, of : (f,) the cell of each, and its facet of the boundary, in the plane its cell again; −1 on a cut
    beyond : (k,) how far nodes are in front of the cut, before the bodies move (m)
    """

    def __init__(self, view: View, points: np.ndarray, cells: np.ndarray) -> None:
        """Of cells (nt, j) with nodes at `points` (nv, d)."""
        outer, cell = boundary_of(cells, 3) if view.solid else (cells, np.arange(len(cells)))
        self.facets, self.of = linear_parts(outer, 2)
        self.cell, self.beyond = cell[self.of], view.beyond(points)
        self._ends, self._share = np.zeros([0, 2], int), np.zeros(0)
        if view.cut is None:
            return
        facets, cell = self._cap(points, cells, view.cut[0])
        # boundary facets behind the cut, of cells that are not wholly in front of it, and the cap
        kept = ((self.beyond[cells] < 0.0) & (cells >= 0)).any(
            axis=1
        )  # others are in front of the cut
        seen = kept[self.cell] & (self.beyond[self.facets] <= 0.0).any(axis=1)
        self.beyond = np.append(self.beyond, np.zeros(len(self._ends)))
        self.facets, self.of, self.cell = (
            np.concatenate([old[seen], new])
            for old, new in (
                (self.facets, facets),
                (self.of, np.full(len(cell), -1)),
                (self.cell, cell),
            )
        )

    def _cap(
        self, points: np.ndarray, cells: np.ndarray, normal: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Triangles (t, 3) in which the cut crosses cells, and the cell (t,) of each."""
        corners, owner = linear_parts(cells, 3)
        some = self.beyond[corners].min(axis=1) < 0.0
        some &= self.beyond[corners].max(axis=1) >= 0.0
        corners, owner = corners[some], owner[some]
        # the corners behind the cut first; CROSSED has the edges that cross it
        order = np.argsort(self.beyond[corners] >= 0.0, axis=1, kind="stable")
        kept = (self.beyond[corners] < 0.0).sum(axis=1)
        corners = np.take_along_axis(corners, order, axis=1)
        edges = np.concatenate(
            [corners[kept == n][:, crossed].reshape(-1, 3, 2) for n, crossed in CROSSED.items()]
        )
        cell = np.concatenate(
            [np.repeat(owner[kept == n], len(crossed)) for n, crossed in CROSSED.items()]
        )
        key, number = np.unique(
            edges.min(axis=2) * len(points) + edges.max(axis=2), return_inverse=True
        )
        self._ends = np.column_stack(np.divmod(key, len(points)))
        # nodes of the cut, one for each edge that crosses it, by linear interpolation of the distance to the plane
        first, second = self.beyond[self._ends].T
        self._share = first / (first - second)
        triangles, at = number.reshape(-1, 3), self.extended(points)[len(points) :]
        # counter-clockwise as seen from the front
        turned = normals(at[triangles]) @ normal < 0.0
        triangles[turned] = triangles[turned][:, ::-1]
        return len(points) + triangles, cell

    def extended(self, values: np.ndarray) -> np.ndarray:
        """Values at nodes (nv, …) with those on a cut (k, …)."""
        share = self._share.reshape(-1, *(1,) * (values.ndim - 1))
        return np.concatenate(
            [values, (1.0 - share) * values[self._ends[:, 0]] + share * values[self._ends[:, 1]]]
        )

    def areas(self, points: np.ndarray) -> np.ndarray:
        """The shares (k,) of nodes in the area of the triangles (m²)."""
        at = in_space(self.extended(points))
        shares = facet_measures(at[self.facets]).repeat(3) / 3.0
        return np.bincount(self.facets.ravel(), shares, len(at))


def in_space(vectors: np.ndarray) -> np.ndarray:
    """Vectors (k, 3) of those in the plane or in space (k, d)."""
    return np.pad(vectors, ((0, 0), (0, 3 - vectors.shape[1])))


@dataclass(frozen=True)
class Surface:
    """Triangles that a picture shows.

    Attributes
    ----------
    at : (k, d) places (m)
    facets : (f, 3) of them, counter-clockwise as seen from outside; none of a rigid line
    paint : their colours
    beyond : (k,) how far they are in front of the cut (m), which hides them; None where that is as they are drawn
    thin : whether they are seen from inside, too
    plain : whether the light does not change their colours, which are values
    edges : colour of their outlines; none are drawn if it is empty
    """

    at: np.ndarray
    facets: np.ndarray
    paint: Paint
    beyond: np.ndarray | None = None
    thin: bool = False
    plain: bool = False
    edges: str = "black"


def rasterise(
    corners: np.ndarray, shape: tuple[int, int]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The z-buffer of an image (h, w): the facet nearest to the eye at all pixels, or −1; barycentric coordinates (p,
    3) of the pixels with a facet, row by row; and the depth (h, w), larger towards the eye.

    Parameters
    ----------
    corners : (f, 3, 4) of the facets; x to the right, y upwards, in pixels from the image's corner, z towards the eye,
        and how far they are beyond a cut
    """
    # b and c, barycentric coordinates of a facet's second and third corner, depth and distance to the cut are linear in
    # x and y, so each row of pixels of a facet is an interval: a, b, c ≥ 0, and not beyond the cut
    face, nearest, last = (
        np.full(shape[0] * shape[1], value) for value in (np.int32(-1), -np.inf, np.int32(-1))
    )
    x, y, z, cut = corners[:, 0].T
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    double = cross(one, two)
    double = np.where(np.abs(double) > 1e-12, double, np.inf)
    # gradients
    of_b = np.stack([two[:, 1], -two[:, 0]]) / double
    of_c = np.stack([-one[:, 1], one[:, 0]]) / double
    of_z, of_cut = (of_b * one[:, k] + of_c * two[:, k] for k in (2, 3))
    low, high = (
        np.ceil(extreme(corners[..., 1], axis=1) - 0.5).astype(int) for extreme in (np.min, np.max)
    )
    facet, row = spans(
        np.maximum(low, 0), np.where(np.isfinite(double), np.minimum(high, shape[0]), low)
    )
    up = row + 0.5 - y[facet]
    left, right = (
        extreme(corners[..., 0], axis=1)[facet] - x[facet] for extreme in (np.min, np.max)
    )
    not_negative = (0.0, of_b), (0.0, of_c), (1.0, -of_b - of_c), (-cut[facet], -of_cut)
    for start, gradient in not_negative:
        slope, rest = gradient[0, facet], start + gradient[1, facet] * up + 1e-9
        end = -rest / np.where(slope == 0.0, 1.0, slope)
        left = np.where(slope > 0.0, np.maximum(left, end), left)
        right = np.where((slope == 0.0) & (rest < 0.0), -np.inf, right)
        right = np.where(slope < 0.0, np.minimum(right, end), right)
    first = np.maximum(np.ceil(left + x[facet] - 0.5), 0).astype(int)
    stop = np.clip(np.floor(right + x[facet] + 0.5), 0, shape[1]).astype(int)
    base, ends = z[facet] + of_z[1, facet] * up, np.cumsum(np.maximum(stop - first, 0))
    # the z-buffer: pixels of all intervals in blocks, of each pixel the nearest facet so far
    for some in np.split(
        np.arange(len(facet)), np.searchsorted(ends, np.arange(CHUNK, ends[-1:].sum(), CHUNK))
    ):
        line, column = spans(first[some], stop[some])
        line = some[line]
        at = row[line] * shape[1] + column
        depth = base[line] + of_z[0, facet[line]] * (column + 0.5 - x[facet[line]])
        order = np.argsort(depth, kind="stable")
        last[at[order]] = order  # what is nearest is written last
        shown = np.flatnonzero((last[at] == np.arange(len(at))) & (depth > nearest[at]))
        face[at[shown]], nearest[at[shown]] = facet[line[shown]], depth[shown]
    covered = np.flatnonzero(face >= 0)
    weights = np.empty((len(covered), 3))
    for some in blocks(len(covered)):
        facet, (up, across) = face[covered[some]], np.divmod(covered[some], shape[1])
        up, across = up + 0.5 - y[facet], across + 0.5 - x[facet]
        b, c = (gradient[0, facet] * across + gradient[1, facet] * up for gradient in (of_b, of_c))
        weights[some] = np.column_stack([1.0 - b - c, b, c])
    return face.reshape(shape), weights, nearest.reshape(shape)


def blocks(number: int) -> Iterator[slice]:
    """The slices of a `number` of pixels that are worked at one after the other."""
    return (slice(start, start + CHUNK) for start in range(0, number, CHUNK))


def outlines(at: np.ndarray, facets: np.ndarray, beyond: np.ndarray) -> np.ndarray:
    """Ends (e, 2, 3) of the edges of facets (f, 3) that are drawn; `at` (k, 3) as placed by a view.

    They are those between facets that meet at more than SHARPEST, at the end of a surface, and where it turns away from
    the eye; without what is `beyond` (k,) a cut.
    """
    pairs = sharp_edges(at, facets, silhouette=True)
    pairs = pairs[(beyond[pairs] <= 0.0).any(axis=1)]
    pairs = np.take_along_axis(pairs, np.argsort(beyond[pairs], axis=1), axis=1)
    # what is beyond the cut goes: the edge ends where the distance, linear along it, is zero
    low, high = beyond[pairs].T
    share = np.where(high > 0.0, low / np.where(high > 0.0, low - high, 1.0), 1.0)[:, None]
    return np.stack(
        [at[pairs[:, 0]], (1.0 - share) * at[pairs[:, 0]] + share * at[pairs[:, 1]]], axis=1
    )


def sharp_edges(at: np.ndarray, facets: np.ndarray, silhouette: bool = False) -> np.ndarray:
    """Edges (e, 2) of facets (f, 3) between places (k, 3): where facets meet at more than SHARPEST, at the end of a
    surface and, as a `silhouette`, where it turns away from the third axis."""
    normal = unit(normals(at[facets]))
    pairs = np.sort(facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    key = pairs[:, 0] * len(at) + pairs[:, 1]
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    a, b = (normal[order[np.minimum(first + k, len(order) - 1)] // 3] for k in (0, 1))
    # a silhouette: one of two facets faces the eye; facets without area have no direction
    flat = ~a.any(axis=1) | ~b.any(axis=1)
    turns = silhouette & ((a[:, 2] > 0.0) != (b[:, 2] > 0.0))
    return pairs[
        order[first[(count != 2) | ~flat & (((a * b).sum(axis=1) < np.cos(SHARPEST)) | turns)]]
    ]


def rim(points: np.ndarray, cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (e, 2) where cells (c, 3) between `points` end, and the cell (e,) of each. Within a surface, too, there are
    cells with points of others along their edges: an edge is none of the rim if its middle lies on another one."""
    edges, owner = boundary_facets(cells, 2)
    ends = points[edges]
    middle, length = ends.mean(axis=1), magnitude(ends[:, 1] - ends[:, 0])
    other, one = around(middle, 0.51 * length, middle)
    one, other = one[one != other], other[one != other]
    away = magnitude(nearest_in(middle[one], ends[other]) - middle[one])
    met = away < MEETING * length[one]
    inner = np.bincount(one, met, len(edges)) > 0
    return edges[~inner], owner[~inner]


def unhidden(edges: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """The visible segments (s, 2, 2) of edges (e, 2, 3) in an image with `depth` (h, w), all in pixels.

    An edge is sampled once a pixel; visible samples that follow each other make a segment.
    """
    number = np.ceil(np.abs(np.diff(edges[..., :2], axis=1)).max(axis=(1, 2))).astype(int) + 2
    edge, place = spans(np.zeros(len(edges), int), number)
    t = (place / (number[edge] - 1))[:, None]
    shown = is_seen((1.0 - t) * edges[edge, 0] + t * edges[edge, 1], depth)
    at = (1.0 - t) * edges[edge, 0, :2] + t * edges[edge, 1, :2]
    begins = shown & ~np.append(False, shown[:-1] & (edge[1:] == edge[:-1]))
    stops = shown & ~np.append(shown[1:] & (edge[1:] == edge[:-1]), False)
    return np.stack([at[begins], at[stops]], axis=1)


def is_seen(at: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """Whether points (k, 3) are visible in an image with `depth` (h, w), all in pixels."""
    from scipy.ndimage import minimum_filter

    column, row = np.clip(at[:, :2].astype(int), 0, np.array(depth.shape)[::-1] - 1).T
    # the least depth around, less one pixel: an edge is as deep as the facets that it bounds
    return at[:, 2] >= minimum_filter(depth, 3, mode="constant", cval=-np.inf)[row, column] - 1.0
