"""The contact boundary of a body in the plane, with smooth arcs over its chords."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ddmpi.mesh.boundary import SHARPEST, segments
from ddmpi.mesh.elements import cell_with, circumference, facet_measures, on_line
from ddmpi.sets import magnitude
from ddmpi.surface.side import Side, cross, dot
from ddmpi.system.numbers import ALIKE

FLAT = 1e-3
"""Turns below this fraction of the turn at the other end of the facet are those of a straight boundary."""

STEEPEST = 0.24
"""Largest |δ| of `Curve.parameters`; at 1/4 a line is tangent to the facet at an end."""


class Curve(Side):
    """The contact boundary of a body in the plane: chains of chords, of order 2 with their middles."""

    TURNS, KEPT = (
        ("outward", "along", "bends", "fans"),
        ("lengths", "areas", "spacing", "slopes", "_angles"),
    )

    @cached_property
    def along(self) -> np.ndarray:
        """(f, 2) from the first end of each facet to the second: its chord (m)."""
        return self.xy[self.facets[:, 1]] - self.xy[self.facets[:, 0]]

    @cached_property
    def bends(self) -> np.ndarray:
        """(f, 2) offset of the middle of a facet from the middle of its chord (m); zero if it is straight."""
        return self.cell.bends(self.xy[self.facets]).sum(axis=1)

    @cached_property
    def slopes(self) -> np.ndarray:
        """(f, 2) angles between the arc and its chord, positive outward, at the first and the second end of facets.

        Two facets share the turn between them as chords of one circle do: the sines of the angles are in the ratio of
        the lengths. A facet that is straight at its other end leaves the whole turn to its neighbour; two such facets,
        and facets at an angle above SHARPEST, meet in a corner. At corners and ends of the boundary the slope of the
        other end is mirrored; where both ends are such, a curved facet has its own slope, a straight one none.
        """
        return self._angles[0]

    @cached_property
    def fans(self) -> np.ndarray:
        tilt = self._angles[1] * [-1.0, 1.0]
        cosine, sine = np.cos(tilt), np.sin(tilt)
        (x, y) = self.outward.T[:, :, None]
        return np.stack([cosine * x - sine * y, sine * x + cosine * y], axis=2)

    @cached_property
    def _angles(self) -> tuple[np.ndarray, np.ndarray]:
        """The slopes; and for rays the same with every turn below SHARPEST shared, corners between flats included."""
        ends, outer = self.corners, self.outward
        length = magnitude(self.along)
        before, after = np.full((2, len(self.nodes)), -1)  # the facets that end and begin at a node
        before[ends[:, 1]], after[ends[:, 0]] = np.arange(len(ends)), np.arange(len(ends))
        turns = np.full(len(self.nodes), np.nan)
        node = np.flatnonzero((before >= 0) & (after >= 0))
        b, a = before[node], after[node]
        turn = np.arctan2(cross(outer[b], outer[a]), dot(outer[b], outer[a]))
        turns[node] = turn = np.where(np.abs(turn) <= ALIKE, 0.0, turn)
        smooth = np.abs(turn) <= SHARPEST
        node, b, a, turn = node[smooth], b[smooth], a[smooth], turn[smooth]
        # Chords of one circle that turn by τ = α_b + α_a with sin α_b / sin α_a = L_b / L_a: tan α_b = L_b sin τ / (L_a
        # + L_b cos τ). This is exact on circles of any grading.
        part = np.arctan2(length[b] * np.sin(turn), length[a] + length[b] * np.cos(turn))
        flat = [np.abs(turns[other]) <= FLAT * np.abs(turn) for other in (ends[b, 0], ends[a, 1])]
        shared, height = np.full((len(ends), 2), np.nan), dot(self.bends, outer)
        shared[b, 1], shared[a, 0] = part, turn - part
        curved = shared.copy()
        curved[b, 1] = np.where(flat[0], 0.0, np.where(flat[1], turn, part))
        curved[a, 0] = np.where(flat[1], 0.0, np.where(flat[0], turn, turn - part))
        curved = np.where(np.isnan(curved), curved[:, ::-1], curved)
        # The slope of a parabola of height h over a chord of length L at its end is 4 h / L.
        curved = np.where(np.isnan(curved), np.arctan(4.0 * height / length)[:, None], curved)
        return curved, np.where(np.isnan(shared), curved, shared)

    def bulge(self, facets: np.ndarray, at: np.ndarray, direction: np.ndarray) -> np.ndarray:
        height, steps = self._upright(facets, at, direction)
        return height / steps

    def _upright(
        self, facets: np.ndarray, at: np.ndarray, direction: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Height (q,) of the arcs upright over places on their chords (m), and how much nearer to them, upright, a step
        along unit vectors (q, d) comes.

        Over each chord lies the cubic with the slopes at its ends, times what makes the arc of a circle exact.
        """
        slope, along, z = self.slopes[facets], self.along[facets], 2.0 * at - 1.0
        length = magnitude(along)
        first, second = np.tan(slope).T
        # Hermite's cubic with the slopes tan α at both ends, over the chord's length.
        cubic = at * (1.0 - at) * (first * (1.0 - at) + second * at)
        # Its derivative. For a circle, arc/parabola = 2 cos α / (√(1 − sin²α z²) + cos α), z from −1 to 1.
        rise = first * (1.0 - at) * (1.0 - 3.0 * at) + second * at * (2.0 - 3.0 * at)
        c, s = np.cos(slope.mean(axis=1)), np.sin(slope.mean(axis=1))
        root = np.sqrt(1.0 - (s * z) ** 2)
        arc = 2.0 * c / (root + c)
        rise = rise * arc + cubic * 4.0 * c * s**2 * z / (root * (root + c) ** 2)
        across = dot(direction, self.outward[facets])
        # Along a ray aslant to the chord a height is, to first order, height / (cos φ − y' sin φ) away.
        return length * cubic * arc, across - rise * dot(direction, along) / length

    def rise(self, nodes: np.ndarray, direction: np.ndarray) -> np.ndarray:
        # Only middles of quadratic facets are off the arc, by its height less their own over the chord.
        rise, facet = np.zeros(len(nodes)), np.full(len(self.nodes), -1)
        facet[self.facets[:, 2:]] = np.arange(len(self.facets))[:, None]
        inner = np.flatnonzero(facet[nodes] >= 0)
        if not len(inner):
            return rise
        facets, direction = facet[nodes[inner]], direction[inner]
        along, outward = self.along[facets], self.outward[facets]
        away = self.xy[nodes[inner]] - self.xy[self.facets[facets, 0]]
        at = dot(away, along) / dot(along, along)
        height, steps = self._upright(facets, at, direction)
        # what is left upright between node and arc, along the ray: nothing where the node lies on the arc
        rise[inner] = (height - dot(away, outward)) / steps
        return rise

    def parameters(self, facets: np.ndarray, at: np.ndarray, direction: np.ndarray) -> np.ndarray:
        """The parameters t (q,) at which lines with a direction (q, 2) through places `at` (q,) on chords, from 0 to 1,
        meet the facets (q,); `at` for straight ones.

        The facet is x(t) = chord(t) + 4 t (1 − t) bend; so t + 4 t (1 − t) δ = `at`, δ = bend × line / chord × line.
        """
        bent, along = self.bends[facets], self.along[facets]
        delta = np.clip(cross(bent, direction) / cross(along, direction), -STEEPEST, STEEPEST)
        # The root that tends to `at` for δ → 0, without cancellation.
        return (
            2.0 * at / (1.0 + 4.0 * delta + np.sqrt((1.0 + 4.0 * delta) ** 2 - 16.0 * delta * at))
        )

    def off_chords(self, facets: np.ndarray, at: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Height (q,) of facets over their chords (m), and the ratio of lengths of facet and chord times the
        `circumference` (q,), upright over places `at` (q,) from 0 to 1 on the chords."""
        outward, along, nodes = (
            self.outward[facets],
            self.along[facets],
            self.xy[self.facets[facets]],
        )
        t = on_line(self.parameters(facets, at, outward))
        places, tangent = (
            np.einsum("ql,qli->qi", table, nodes)
            for table in (self.cell.shapes(t), self.cell.derivatives(t)[0])
        )
        ratio = magnitude(along) * magnitude(tangent) / (along * tangent).sum(axis=1)
        return ((places - nodes[:, 0]) * outward).sum(axis=1), ratio * circumference(
            places, self.axisymmetric
        )

    def pieces(self, some: np.ndarray) -> np.ndarray:
        """Segments between neighbouring nodes, two of a quadratic facet, `in_order`."""
        return in_order(segments(self.facets[some]))


def in_order(pairs: np.ndarray) -> np.ndarray:
    """Pairs (f, 2) sorted along the chain, the earlier node first; of a closed chain also (last, first)."""
    pairs = np.sort(pairs, axis=1)
    closing = np.diff(pairs, axis=1)[:, 0] > 1
    pairs[closing] = pairs[closing, ::-1]
    return pairs[np.argsort(pairs[:, 0])]


def in_chains(
    facets: np.ndarray, points: np.ndarray, places: np.ndarray, origins: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The nodes (k,) of turned facets chain by chain, by `places` (nv, 2) of all nodes, and their `_arc` (nv,)."""
    return _chained(segments(facets), places), _arc(facets, points, origins)


def _arc(edges: np.ndarray, points: np.ndarray, origins: np.ndarray) -> np.ndarray:
    """Arc lengths (nv,) of the nodes of turned edges (k, 2 or 3) from the start of their chain: a node at which no edge
    ends, or the first of `origins` (k,) on a closed chain."""
    length = facet_measures(points[edges])
    after = dict(
        zip(
            edges[:, 0].tolist(),
            zip(edges[:, 1].tolist(), length.tolist(), strict=True),
            strict=True,
        )
    )
    arc = np.full(len(points), np.nan)
    for start in [*np.setdiff1d(edges[:, 0], edges[:, 1]), *origins]:
        node, at = int(start), 0.0
        while np.isnan(arc[node]):
            arc[node] = at
            node, step = after.get(node, (node, 0.0))
            at += step
    arc[edges[:, 2:]] = (
        arc[edges[:, :1]] + length[:, None] * cell_with(edges.shape[1], 1).nodes[2:, 1]
    )
    return arc


def _chained(pairs: np.ndarray, places: np.ndarray) -> np.ndarray:
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
