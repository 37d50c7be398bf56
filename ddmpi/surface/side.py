"""The contact boundary of one body."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from math import factorial

import numpy as np
import scipy.sparse as sparse

from ddmpi.mesh.boundary import links, segments, turn_outward
from ddmpi.mesh.elements import CELLS, FIRST, bends, facet_cell, facet_measures, facet_shares
from ddmpi.mesh.mesh import Mesh
from ddmpi.surface.curved import bulge, normals_at_corners

SHARPEST = np.deg2rad(40.0)
"""Where a boundary turns by more than this from one side of an element to the next, it has a corner; where by less, it
may be a curve."""

STRAIGHT = 1e-9
"""Turns (rad) below this are rounding of a straight boundary."""

FLAT = 1e-3
"""So are turns below this part of that at the other end of an element's side."""

COARSE = 1e-6
"""Nodes are put in order by their places in multiples of this part of the mesh's extent: rounding decides nothing."""

STEEPEST = 0.24
"""Lines that meet a curved facet count as no nearer to its direction at an end than this; at 1/4 they touch it."""


@dataclass(frozen=True)
class Side:
    """Contact boundary of one body, nodes ordered along it, in space by their coordinates.

    Attributes
    ----------
    body : name of the body
    modulus : plane modulus E/(1 − ν²) of the body (Pa)
    nodes : (k,) mesh node numbers
    xy : (k, d) positions (m)
    normal : (k, d) outer unit normals, averaged over the adjacent facets with their measures; of curved facets those at
        the node itself
    area : (k,) nodal lengths or areas (m or m²): the integral of the node's shape function over the boundary, so that
        a constant stress times them gives its nodal forces. Half the adjacent edges in order 1 in the plane; in order 2
        two thirds of its edge for a middle, a sixth of the adjacent edges for a corner, where these are straight
    clamps : (k, d) the number of the clamp that prescribes each component, −1 if none does
    tied : (k,) bool, whether clamps hold a node in all components, or another contact can
    extent : (d,) of the body along the axes (m)
    arc : (k,) arc length from the start of the node's chain, on the way with the body to the left (m). A closed chain
        starts at the first node of the group's first line on it. Zero in space
    facets : (f, l) by the places of their nodes, turned outward as `turn_outward` does; in the order of the last column
    parted : whether another contact is on the same group
    """

    body: str
    modulus: float
    nodes: np.ndarray
    xy: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    clamps: np.ndarray
    tied: np.ndarray
    extent: np.ndarray
    arc: np.ndarray
    facets: np.ndarray
    parted: bool = False

    @property
    def free(self) -> np.ndarray:
        """(k, d) bool, components that are not clamped."""
        return self.clamps < 0

    @property
    def dimension(self) -> int:
        return self.xy.shape[1]

    @property
    def along(self) -> np.ndarray:
        """(f, 2) from the first end of each facet to the second: its chord (m)."""
        return self.xy[self.facets[:, 1]] - self.xy[self.facets[:, 0]]

    @property
    def bends(self) -> np.ndarray:
        """(f, 2) how far the middle of each facet is off that of its chord (m); zero if it is straight."""
        return bends(self.xy[self.facets])

    @property
    def heights(self) -> np.ndarray:
        """(f,) the same, as far as it is outward (m)."""
        return np.einsum("ij,ij->i", self.bends, self.outward)

    @property
    def lengths(self) -> np.ndarray:
        """(f,) lengths or areas of the facets (m or m²)."""
        return facet_measures(self.xy[self.facets])

    @property
    def outward(self) -> np.ndarray:
        """(f, d) outer unit normal of each facet's chord, or of the triangle of its corners."""
        return unit(CELLS[self.dimension - 1, 1].vectors(self.xy[self.facets[:, :self.dimension]],
                                                         FIRST[self.dimension - 1][0])[:, 0].T)

    @property
    def spacing(self) -> np.ndarray:
        """(k,) mean distance of each node to its neighbours (m)."""
        pairs = links(self.facets, self.dimension)
        distance = np.linalg.norm(self.xy[pairs[:, 1]] - self.xy[pairs[:, 0]], axis=1)
        number = np.bincount(pairs.ravel(), minlength=len(self.nodes))
        return np.bincount(pairs.ravel(), np.repeat(distance, 2), len(self.nodes)) / number

    @property
    def slopes(self) -> np.ndarray:
        """(f, 2) angles by which the boundary that is meant leaves each facet outward, at its first and second end.

        Where the boundary turns from one facet to the next, both share the turn as arcs of one circle would: their
        sines go as the lengths. A facet that is straight at its other end leaves all of it to its neighbour; two such
        facets meet in a corner, and so do facets at an angle above SHARPEST. At a sharp corner and at an end of the
        boundary, the slope of the other end counts, mirrored; where both ends are such, that of the facet itself, if it
        is curved.
        """
        return self._slopes()[0]

    @cached_property
    def fans(self) -> np.ndarray:
        """(f, d, d) unit normals at the corners of each facet, the same for all that meet there at less than SHARPEST.
        """
        if self.dimension > 2:
            return normals_at_corners(self.xy, self.facets[:, :3], SHARPEST)
        tilt = np.stack([-self._slopes()[1][:, 0], self._slopes()[1][:, 1]], axis=1)
        cosine, sine = np.cos(tilt), np.sin(tilt)
        (x, y) = self.outward.T[:, :, None]
        return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=2)

    def _slopes(self) -> tuple[np.ndarray, np.ndarray]:
        """The slopes, and the same without corners below SHARPEST."""
        ends, outer = self.facets[:, :2], self.outward
        length = np.linalg.norm(self.along, axis=1)
        before, after = np.full((2, len(self.nodes)), -1)  # the facets that end and begin at a node
        before[ends[:, 1]], after[ends[:, 0]] = np.arange(len(ends)), np.arange(len(ends))
        turns = np.full(len(self.nodes), np.nan)
        node = np.flatnonzero((before >= 0) & (after >= 0))
        b, a = before[node], after[node]
        turn = np.arctan2(outer[b, 0] * outer[a, 1] - outer[b, 1] * outer[a, 0],
                          np.einsum("ij,ij->i", outer[b], outer[a]))
        turns[node] = turn = np.where(np.abs(turn) <= STRAIGHT, 0.0, turn)
        smooth = np.abs(turn) <= SHARPEST
        node, b, a, turn = node[smooth], b[smooth], a[smooth], turn[smooth]
        part = np.arctan2(length[b] * np.sin(turn), length[a] + length[b] * np.cos(turn))
        flat = [np.abs(turns[other]) <= FLAT * np.abs(turn) for other in (ends[b, 0], ends[a, 1])]
        shared, own = np.full((len(ends), 2), np.nan), np.arctan(4.0 * self.heights / length)[:, None]
        shared[b, 1], shared[a, 0] = part, turn - part
        curved = shared.copy()
        curved[b, 1] = np.where(flat[0], 0.0, np.where(flat[1], turn, part))
        curved[a, 0] = np.where(flat[1], 0.0, np.where(flat[0], turn, turn - part))
        curved = np.where(np.isnan(curved), curved[:, ::-1], curved)
        curved = np.where(np.isnan(curved), own, curved)
        return curved, np.where(np.isnan(shared), curved, shared)

    def bulge(self, facets: np.ndarray, at: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """How far (q,) the boundary that is meant stands off its chords, outward (m).

        Over each chord lies the cubic with the slopes at its ends, times what makes the arc of a circle exact. In space
        it is what `curved.bulge` has over triangles.

        Parameters
        ----------
        facets : (q,) on which the points lie
        at : (q,) where on the facet, from 0 at its first end to 1 at the second; in space (q, 3) barycentric
        direction : (q, d) unit vectors along which the distance counts
        """
        if self.dimension > 2:
            return bulge(self.xy[self.facets[:, :3]], self.fans, facets, at, direction)
        slope, along, z = self.slopes[facets], self.along[facets], 2.0 * at - 1.0
        length = np.linalg.norm(along, axis=1)
        first, second = np.tan(slope).T
        cubic = at * (1.0 - at) * (first * (1.0 - at) + second * at)
        rise = first * (1.0 - at) * (1.0 - 3.0 * at) + second * at * (2.0 - 3.0 * at)
        c, s = np.cos(slope.mean(axis=1)), np.sin(slope.mean(axis=1))
        root = np.sqrt(1.0 - (s * z) ** 2)
        arc = 2.0 * c / (root + c)
        rise = rise * arc + cubic * 4.0 * c * s**2 * z / (root * (root + c) ** 2)
        across = np.einsum("qi,qi->q", direction, self.outward[facets])
        return length * cubic * arc / (across - rise * np.einsum("qi,qi->q", direction, along) / length)

    def rise(self, nodes: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """How far (q,) the boundary that is meant stands off some nodes (q,), along vectors (q, 2) (m).

        Corners lie on it, middles on the chord or, if the facet is curved, near it.
        """
        if self.dimension > 2:
            return np.zeros(len(nodes))
        found, facet = np.zeros(len(nodes)), np.full(len(self.nodes), -1)
        facet[self.facets[:, 2:].ravel()] = np.arange(self.facets[:, 2:].size)
        middle = np.flatnonzero(facet[nodes] >= 0)
        facets, direction = facet[nodes[middle]], direction[middle]
        along, bent = self.along[facets], self.bends[facets]
        aside = np.einsum("qi,qi->q", bent, along) / np.einsum("qi,qi->q", along, along)
        across = np.einsum("qi,qi->q", self.outward[facets], direction)
        found[middle] = self.bulge(facets, 0.5 + aside, direction) - self.heights[facets] * across
        return found

    def parameters(self, facets: np.ndarray, at: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The parameters t (q,) where lines through chords meet the facets themselves.

        Parameters
        ----------
        facets : (q,)
        at : (q,) where on the chord, from 0 at its first end to 1 at the second; t is the same on straight facets
        direction : (q, 2) of the line

        The facet is x(t) = chord(t) + 4 t (1 − t) bend; so t + 4 t (1 − t) δ = `at`, δ = bend × line / chord × line.
        """
        bent, along = self.bends[facets], self.along[facets]
        delta = np.clip(cross(bent, direction) / cross(along, direction), -STEEPEST, STEEPEST)
        return 2.0 * at / (1.0 + 4.0 * delta + np.sqrt((1.0 + 4.0 * delta) ** 2 - 16.0 * delta * at))

    def off_chords(self, facets: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far (q,) facets themselves are off their chords (m), and their length over the chord's (q,), at places.

        Upright on the chords of `facets` (q,), at `at` (q,) from 0 to 1.
        """
        outward, along = self.outward[facets], self.along[facets]
        t, length = self.parameters(facets, at, outward), np.linalg.norm(along, axis=1)
        height = 4.0 * np.einsum("qi,qi->q", self.bends[facets], outward)
        aside = 4.0 * np.einsum("qi,qi->q", self.bends[facets], along) / length
        slope = height * (1.0 - 2.0 * t) / (length + aside * (1.0 - 2.0 * t))
        return height * t * (1.0 - t), np.sqrt(1.0 + slope**2)

    def lengths_over(self, some: np.ndarray) -> np.ndarray:
        """Nodal lengths (k,) over some of the facets (f,) bool: integrals of the shape functions (m)."""
        facets = self.facets[some]
        return nodal(facet_shares(self.xy[facets]), facets, len(self.nodes))

    def vertex_areas(self, some: np.ndarray) -> np.ndarray:
        """Integrals (k,) of the vertices' hat functions over some of the facets (f,) bool, in space (m²)."""
        nodes = self.facets[some]
        shares = np.repeat(self.lengths[some][:, None] / 3.0, 3, axis=1)
        return nodal(shares, nodes[:, :3], len(self.nodes))

    def normals_over(self, some: np.ndarray) -> np.ndarray:
        """Outer unit normals (k, d) averaged over some of the facets (f,) bool; those of the side away from these."""
        facets = self.facets[some]
        total = unit(nodal(_across(self.xy[facets]), facets, len(self.nodes)))
        return np.where(total.any(axis=1, keepdims=True), total, self.normal)

    def laplacian(self, some: np.ndarray, row: np.ndarray, m: int) -> sparse.csr_matrix:
        """That of some of the facets (f,) bool, as `laplacian`; of quadratic ones between neighbouring nodes, in space
        between corners."""
        facets = self.facets[some]
        return laplacian(self.xy, segments(facets) if self.dimension == 2 else facets[:, :3], row, m)


def laplacian(xy: np.ndarray, facets: np.ndarray, row: np.ndarray, m: int) -> sparse.csr_matrix:
    """Laplacian (m, m) of the hat functions of rows on facets between nodes at `xy` (k, d), in m^(d − 3).

    Facets (f, d) are straight simplices. The nodes with number j in `row` (k,) move with row j; −1 is held fast.
    """
    along = xy[facets[:, 1:]] - xy[facets[:, :1]]
    gram, order = along @ along.transpose(0, 2, 1), along.shape[1]
    slopes = np.vstack([-np.ones(order), np.eye(order)])
    local = slopes @ np.linalg.inv(gram) @ slopes.T * np.sqrt(np.linalg.det(gram))[:, None, None] / factorial(order)
    one, other = np.broadcast_arrays(row[facets][:, :, None], row[facets][:, None, :])
    moves = (one >= 0) & (other >= 0)
    return sparse.csr_matrix((local[moves], (one[moves], other[moves])), (m, m))


def unit(vectors: np.ndarray) -> np.ndarray:
    """Vectors (…, d) over their lengths; zero stays zero."""
    size = np.linalg.norm(vectors, axis=-1, keepdims=True)
    return vectors / np.where(size > 0.0, size, 1.0)


def frames(normal: np.ndarray) -> np.ndarray:
    """Unit vectors (k, d, d) at places with unit normals (k, d): these, then the tangents.

    In the plane the tangent lies at their left. In space the tangents of the mean normal are turned with it to each
    normal the shortest way, so that neighbours have nearly the same.
    """
    if normal.shape[1] == 2:
        return np.stack([normal, -turn_right(normal)], axis=1)
    mean = unit(normal.sum(axis=0))
    mean = mean if mean.any() else normal[0]
    base = np.linalg.qr(np.column_stack([mean, np.eye(3)[np.argsort(np.abs(mean))[:2]].T]))[0].T
    base *= np.where(base[:1] @ mean < 0.0, -1.0, 1.0)
    half = unit(normal + mean)  # two reflections, in the mean and in this, turn the mean to a normal
    turned = base[1:] - 2.0 * (base[1:] @ half.T).T[:, :, None] * half[:, None]
    return np.concatenate([normal[:, None], turned], axis=1)


def turn_right(vectors: np.ndarray) -> np.ndarray:
    """Vectors (k, 2) turned by −90°: outward, for the way on which the body lies to the left."""
    return np.column_stack([vectors[:, 1], -vectors[:, 0]])


def contact_side(mesh: Mesh, edges: np.ndarray, clamps: np.ndarray, body: str, modulus: float, key: str,
                 tied: np.ndarray | None = None, parted: bool = False) -> Side:
    """The contact boundary made of `edges` (k, l), in the plane ordered from its first end. Not collective.

    `clamps` (nv, d) and `tied` (nv,) as those of a `Side`, of all nodes of the body; without `tied` none is.
    `parted` as of a `Side`.

    Raises InputError naming `key` when an edge does not lie on the boundary.
    """
    origins, edges = edges[:, 0], turn_outward(mesh, edges, key)[0]
    places = np.round((mesh.points - mesh.points.min(axis=0)) / (COARSE * np.ptp(mesh.points, axis=0).max()))
    if mesh.dimension == 2:
        nodes, arc = _order(segments(edges), places), _arc(edges, mesh.points, origins)
    else:
        nodes, arc = np.unique(edges), np.zeros(len(mesh.points))
        nodes = nodes[np.lexsort(places[nodes].T[::-1])]
    place, xy = np.empty(len(mesh.points), int), mesh.points[nodes]
    place[nodes] = np.arange(len(nodes))
    facets = place[edges]
    facets = facets[np.argsort(facets[:, -1])]
    normal, length = (nodal(of(xy[facets]), facets, len(nodes)) for of in (_across, facet_shares))
    return Side(body, modulus, nodes, xy, unit(normal), length, clamps[nodes],
                np.zeros(len(nodes), bool) if tied is None else tied[nodes], np.ptp(mesh.points, axis=0),
                arc[nodes], facets, parted)


def _arc(edges: np.ndarray, points: np.ndarray, origins: np.ndarray) -> np.ndarray:
    """Arc lengths (nv,) of the nodes of turned edges (k, 2 or 3) from the start of their chain.

    Each chain counts from its own start: where no edge ends, else at the first of `origins` (k,) that is on it.
    """
    length = facet_measures(points[edges])
    after = dict(zip(edges[:, 0].tolist(), zip(edges[:, 1].tolist(), length.tolist(), strict=True), strict=True))
    arc = np.full(len(points), np.nan)
    for start in [*np.setdiff1d(edges[:, 0], edges[:, 1]), *origins]:
        node, at = int(start), 0.0
        while np.isnan(arc[node]):
            arc[node] = at
            node, step = after.get(node, (node, 0.0))
            at += step
    arc[edges[:, 2:]] = arc[edges[:, :1]] + length[:, None] / 2
    return arc


def nodal(values: np.ndarray, facets: np.ndarray, size: int) -> np.ndarray:
    """Sums (size, …) at nodes of the values (f, c, …) at the nodes (f, c) of facets."""
    total = np.zeros((size, *values.shape[2:]))
    np.add.at(total, facets, values)
    return total


def _across(facets: np.ndarray) -> np.ndarray:
    """Outer normals (s, l, d) at the nodes of facets (s, l, d), as long as ratios of measures there (m or m²)."""
    cell = facet_cell(facets)
    return cell.vectors(facets, cell.nodes).transpose(2, 1, 0)


def cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """The cross products (…) of vectors (…, 2)."""
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]


def _order(pairs: np.ndarray, places: np.ndarray) -> np.ndarray:
    """Nodes of pairs of neighbours, walked chain by chain; each chain starts at its end with the smaller x, y."""
    neighbours: dict[int, list[int]] = {}
    for a, b in pairs.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    ranked = sorted(neighbours, key=lambda node: (len(neighbours[node]) != 1, *places[node]))
    ordered: list[int] = []
    seen: set[int] = set()
    node: int | None
    for node in ranked:
        while node is not None and node not in seen:
            seen.add(node)
            ordered.append(node)
            node = next((n for n in neighbours[node] if n not in seen), None)
    return np.array(ordered, dtype=np.int64)
