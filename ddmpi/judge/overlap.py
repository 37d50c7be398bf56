"""Where bodies run through each other, or themselves, although no contact keeps them apart.

A body's boundary is a set of closed polygons, so whether a point lies in the body is decided by counting crossings.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import combinations

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState
from ddmpi.mesh.boundary import outline
from ddmpi.system.agreement import merged
from ddmpi.system.numbers import spans

RESOLVED = 1e-3
"""Overlaps below this part of the largest displacement are not reported."""

DRAWN = 1e-6
"""Nor are those in the drawing below this part of the distance between nodes."""

CORNER, STRAIGHT = 1.0, 1e-6
"""Boundaries that turn by an angle (rad) between these from segment to segment are drawn curved."""

INWARD = 0.25
"""Bodies with a common boundary are looked into at this part of a segment's length from its middle."""

STEPS = 16
"""At most so many positions on the way from the drawing to the answer are looked at."""

ROUNDING = 32 * float(np.finfo(float).eps)
"""Relative error of coordinates after a few operations."""

WIDEN, ADD = "name the whole boundary that may touch in `on`", "add a [[contact]] between them"
"""What helps where bodies run through each other that a contact names, and those that none does."""

PAIRS = 2**20
"""So many pairs of points and segments at a time."""


@dataclass(frozen=True)
class Outline:
    """The whole boundary of a body.

    Attributes
    ----------
    at, moved : (n, 2) its nodes as drawn and in the answer (m)
    segments : (s, 2) pairs of neighbouring nodes, the body to their left
    numbers : (n,) of its nodes in the body's mesh, ascending; needed for `places` only
    """

    at: np.ndarray
    moved: np.ndarray
    segments: np.ndarray
    numbers: np.ndarray = field(default_factory=lambda: np.empty(0, int))

    def places(self, nodes: np.ndarray) -> np.ndarray:
        """Where in the outline `nodes` of the mesh are."""
        return np.searchsorted(self.numbers, nodes)

    def lengths(self) -> np.ndarray:
        """(s,) of the segments as drawn (m)."""
        return np.linalg.norm(np.subtract(*self.at[self.segments.T]), axis=1)

    def gradient(self) -> float:
        """The largest strain or rotation of a segment."""
        u = self.moved - self.at
        return float((np.linalg.norm(np.subtract(*u[self.segments.T]), axis=1) / self.lengths()).max())

    def sagittas(self) -> tuple[np.ndarray, np.ndarray]:
        """How far at most the true boundary lies inside of the body's segments (s,), and of its nodes (n,) (m).

        It does so where it is hollow. Nodes lie on it, but for those in the middle of straight sides.
        """
        along = np.subtract(*self.at[self.segments[:, ::-1].T])
        before, after = np.zeros((2, *self.at.shape))
        before[self.segments[:, 1]], after[self.segments[:, 0]] = along, along
        turn = np.arctan2(_cross(after, before), np.einsum("nd,nd->n", before, after))  # clockwise
        turn[np.abs(turn) > CORNER] = 0.0
        hollow = np.maximum(turn, 0.0)[self.segments].max(axis=1)
        sagitta, bow = self.lengths() * hollow / 4.0, np.zeros(len(self.at))  # an eighth, if neighbours are as long
        np.maximum.at(bow, self.segments, sagitta[:, None])
        return sagitta, np.where(np.abs(turn) > STRAIGHT, 0.0, bow)


@dataclass(frozen=True)
class Polygons:
    """A body's boundary in one position: points (n, 2), segments (s, 2), `Outline.sagittas` of both."""

    points: np.ndarray
    segments: np.ndarray
    sagittas: np.ndarray
    bows: np.ndarray

    @property
    def ends(self) -> np.ndarray:
        """(s, 2, 2) of the segments."""
        return self.points[self.segments]


@dataclass(frozen=True)
class Overlap:
    """The deepest point of one body in another.

    Attributes
    ----------
    depth : distance to the nearest boundary of the body that it lies in (m); zero if there is no such point
    place : (2,)
    """

    depth: float
    place: np.ndarray


NOWHERE = Overlap(0.0, np.zeros(2))


def doubt_overlaps(assembly: Assembly, displacements: Mapping[str, np.ndarray],
                   states: Mapping[str, ContactState]) -> list[str]:
    """Warnings where two bodies run through each other outside their contacts, the same on all ranks.

    Of two bodies on different ranks whose bounding boxes overlap one sends its outline to the other. Collective.
    """
    world, names = assembly.world, [body.name for body in assembly.scene.body]
    own = {body.number: _outline(body, displacements[body.spec.name]) for body in assembly.bodies}
    boxes = merged(world, {number: (world.rank, *_box(each)) for number, each in own.items()})
    near = [(a, b) for a, b in combinations(sorted(boxes), 2) if (boxes[a][1] <= boxes[b][2]).all()
            and (boxes[b][1] <= boxes[a][2]).all()]
    away = sorted({(b, boxes[a][0]) for a, b in near if boxes[a][0] != boxes[b][0]})
    sending = [world.isend(own[number], rank, number) for number, rank in away if number in own]
    at_hand = own | {number: world.recv(None, boxes[number][0], number) for number, rank in away if rank == world.rank}
    MPI.Request.waitall(sending)
    contacts, found = {body.number: body.member.interfaces for body in assembly.bodies}, {}
    for number, each in own.items():
        place = through_itself(each)
        found[number, number] = [] if place is None else [
            f"body.{names[number]} runs through itself, as at ({place[0]:.4g}, {place[1]:.4g}), where nothing keeps "
            "its sides apart; for sides that touch make two bodies of it, bonded where they hang together"]
    for a, b in near:
        if a in own:
            pair = names[a], names[b]
            kept = _kept_apart(contacts[a], pair, (at_hand[a], at_hand[b]))
            overlap, drawn = run_through(at_hand[a], at_hand[b], *kept, _between(pair, states))
            touch = any(set(contact.bodies) == set(pair) for contact in assembly.scene.contact)
            found[a, b] = _name_overlap(*pair, overlap, drawn, touch)
    return [warning for _, warnings in sorted(merged(world, found).items()) for warning in warnings]


def _between(pair: tuple[str, str], states: Mapping[str, ContactState]) -> float:
    """By how much two bodies may overlap where they meet at a corner of others: as these contacts do at some place."""
    met = [{body: state.deepest for state in states.values() for body in state.interface.bodies
            if name in state.interface.bodies and body not in pair} for name in pair]
    return sum(each[body] for each in met for body in met[0].keys() & met[1].keys())


def _kept_apart(interfaces: Sequence[Interface], names: tuple[str, str],
                outlines: tuple[Outline, Outline]) -> tuple[np.ndarray, np.ndarray]:
    """The nodes (2, k) of two outlines that contacts keep apart, and the first one's outer normals there (k, 2)."""
    pairs, normals = [np.empty((2, 0), int)], [np.empty((0, 2))]
    for interface in interfaces:
        if set(interface.bodies) == set(names):
            side = interface.side(names[0])
            *nodes, normal = interface.facing()
            pairs.append(np.stack([each.places(nodes[k]) for each, k in zip(outlines, (side, 1 - side), strict=True)]))
            normals.append((1.0 - 2.0 * side) * normal)
    return np.hstack(pairs), np.vstack(normals)


def _outline(body: Body, u: np.ndarray) -> Outline:
    """The boundary of a body that moved by `u` (nv, 2)."""
    segments = outline(body.mesh)
    nodes = np.unique(segments)
    points = body.mesh.points[nodes]
    return Outline(points, points + u[nodes], np.searchsorted(nodes, segments), nodes)


def _box(each: Outline) -> tuple[np.ndarray, np.ndarray]:
    """The corners of the box around an outline, as drawn and in the answer."""
    both = np.vstack([each.at, each.moved])
    return both.min(axis=0), both.max(axis=0)


def _name_overlap(first: str, second: str, overlap: Overlap, drawn: float, touch: bool) -> list[str]:
    """The warning of an overlap of two bodies, which a contact names or not, if there is one."""
    if not overlap.depth:
        return []
    (x, y), before = overlap.place, f" ({drawn:.3g} as drawn)" if drawn else ""
    return [f"body.{first} and body.{second} run through each other by {overlap.depth:.3g}{before}, as at ({x:.4g}, "
            f"{y:.4g}), where no contact keeps them apart; "
            f"{WIDEN if touch else ADD}"]


def through_itself(body: Outline) -> np.ndarray | None:
    """Where (2,) the boundary of a body crosses itself in the answer, but not as drawn; None if it does not.

    Of two segments that cross, the middle of the shorter one is no farther from that of the longer one than the latter
    is long. Segments with a common node do not count.
    """
    ends, (a, b) = body.moved[body.segments], body.segments.T
    lengths = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
    middles = ends.mean(axis=1)
    near = cKDTree(middles).query_ball_point(middles, lengths)
    one, other = np.repeat(np.arange(len(a)), [len(each) for each in near]), np.concatenate(near).astype(int)
    shorter = (lengths[other] < lengths[one]) | ((lengths[other] == lengths[one]) & (other < one))
    apart = (a[one] != a[other]) & (a[one] != b[other]) & (b[one] != a[other]) & (b[one] != b[other])
    one, other = one[shorter & apart], other[shorter & apart]
    crossed = _cross_over(ends[one], ends[other])
    drawn = body.at[body.segments]
    crossed &= ~_cross_over(drawn[one], drawn[other])
    return middles[other[crossed][0]] if crossed.any() else None


def _cross_over(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(k,) whether segments (k, 2, 2) cross each other by more than rounding."""
    def sides(line: np.ndarray, points: np.ndarray) -> np.ndarray:
        along = line[:, 1] - line[:, 0]
        beside = _cross(along[:, None], points - line[:, :1])
        slack = ROUNDING * np.abs(line).max(axis=(1, 2)) * np.abs(along).max(axis=1)
        return (beside.min(axis=1) < -slack) & (beside.max(axis=1) > slack)

    return sides(first, second) & sides(second, first)


def run_through(first: Outline, second: Outline, pairs: np.ndarray, normal: np.ndarray,
                slack: float = 0.0) -> tuple[Overlap, float]:
    """The deepest overlap beyond rounding, curvature and second-order effects, and how deep the drawing has one.

    Parameters
    ----------
    first, second : outlines of two bodies
    pairs : (2, k) nodes of the first and of the second that contacts keep apart
    normal : (k, 2) outer normals of the first body there
    slack : overlaps of the answer below this do not count (m)

    The answer's overlaps are looked for on the way from the drawing, so that a body which has passed a thin one is
    found. If there are none, those of the drawing count.
    """
    spacing = np.concatenate([first.lengths(), second.lengths()])
    typical = float(np.median(spacing))
    rounding = ROUNDING * float(max(np.abs(each.at).max() for each in (first, second)))
    sagittas = first.sagittas(), second.sagittas()

    def deepest(x: np.ndarray, y: np.ndarray, least: float) -> Overlap:
        apart = y[pairs[1]] - x[pairs[0]]
        gap = np.einsum("kd,kd->k", apart, normal)
        near = gap <= np.linalg.norm(apart - gap[:, None] * normal, axis=1) + rounding
        least += float(max(0.0, -gap.min(initial=0.0)))
        a, b = Polygons(x, first.segments, *sagittas[0]), Polygons(y, second.segments, *sagittas[1])
        return max(deepest_in(a, b, pairs[0][near], least), deepest_in(b, a, pairs[1][near], least), key=_depth)

    drawn = deepest(first.at, second.at, rounding)
    as_drawn = drawn if drawn.depth > DRAWN * typical else NOWHERE
    u, v = first.moved - first.at, second.moved - second.at
    motions, size = np.concatenate([u, v]), max(np.ptp(each.at, axis=0).max() for each in (first, second))
    if not np.abs(motions).max() <= size:  # or is no number
        return as_drawn, as_drawn.depth
    largest = float(np.linalg.norm(motions - motions.mean(axis=0), axis=1).max())
    least = rounding + slack + min(drawn.depth, DRAWN * typical)
    least += max(RESOLVED, first.gradient(), second.gradient()) * largest  # of second order in the displacement
    steps = int(np.clip(np.ceil(largest / spacing.min()), 1, STEPS))
    now = max((deepest(first.at + way * u, second.at + way * v, least) for way in np.linspace(1 / steps, 1.0, steps)),
              key=_depth)
    return now if now.depth else as_drawn, as_drawn.depth


def deepest_in(a: Polygons, b: Polygons, kept: np.ndarray, least: float = 0.0) -> Overlap:
    """The point of the boundary `a` that lies deepest in the body `b`, deeper than `least` and the sagittas.

    Nodes `kept` of `a`, and segments between two of them, are left out.
    """
    free = np.ones(len(a.points), dtype=bool)
    free[kept] = False
    loose = np.flatnonzero(free[a.segments].any(axis=1))
    middles, of = _pieces(a.ends[loose], b.ends)
    inside, under = _within(a.ends[loose], a.ends)
    points = np.concatenate([a.points[free], middles, inside])
    slack = least + np.concatenate([a.bows[free], a.sagittas[loose[of]], a.sagittas[loose[under]]])
    near = np.flatnonzero(((points >= b.points.min(axis=0)) & (points <= b.points.max(axis=0))).all(axis=1))
    near = near[_contains(b.ends, points[near])]
    best, worst = NOWHERE, 0.0
    for block in np.array_split(near, len(near) * len(b.segments) // PAIRS + 1):
        if len(block):
            depth, nearest = _distance(points[block], b.ends)
            excess = depth - slack[block] - b.sagittas[nearest]
            k = int(np.argmax(excess))
            if excess[k] > worst:
                best, worst = Overlap(float(depth[k]), points[block[k]]), float(excess[k])
    return best


def _within(segments: np.ndarray, polygons: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points (k, 2) of a body a little inside of the middles of its segments (s, 2, 2), and of which segments."""
    along = segments[:, 1] - segments[:, 0]
    points = segments.mean(axis=1) + INWARD * np.column_stack([-along[:, 1], along[:, 0]])
    there = np.flatnonzero(_contains(polygons, points))
    return points[there], there


def _contains(polygons: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Whether points (k, 2) lie in the closed polygons made of segments (s, 2, 2): a ray crosses them an odd time."""
    order = np.argsort(points[:, 1])
    height, ends = points[order, 1], polygons[:, :, 1]
    start, stop = np.searchsorted(height, ends.min(axis=1)), np.searchsorted(height, ends.max(axis=1))
    segment, place = spans(start, stop)
    point = order[place]
    (x0, y0), (x1, y1) = polygons[segment].transpose(1, 2, 0)
    left = points[point, 0] < x0 + (points[point, 1] - y0) / (y1 - y0) * (x1 - x0)
    return np.bincount(point[left], minlength=len(points)) % 2 == 1


def _pieces(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middles (k, 2) of the pieces into which segments `second` cut those of `first`, and of which one (k,)."""
    i, j = _meeting(first, second)
    p, r = first[i, 0], first[i, 1] - first[i, 0]
    q, s = second[j, 0] - p, second[j, 1] - second[j, 0]
    with np.errstate(divide="ignore", invalid="ignore"):
        t, w = _cross(q, s) / _cross(r, s), _cross(q, r) / _cross(r, s)
        cut = (t > 0.0) & (t < 1.0) & (w >= 0.0) & (w <= 1.0)
    whole = np.unique(i[cut])
    i = np.concatenate([i[cut], whole, whole])
    t = np.concatenate([t[cut], np.zeros(len(whole)), np.ones(len(whole))])
    order = np.lexsort((t, i))
    i, t = i[order], t[order]
    follows = i[1:] == i[:-1]
    of, t = i[1:][follows], ((t[1:] + t[:-1]) / 2.0)[follows]
    return first[of, 0] + t[:, None] * (first[of, 1] - first[of, 0]), of


def _meeting(first: np.ndarray, second: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of segments (s, 2, 2) whose bounding boxes meet, by their places."""
    (low, high), (low2, high2) = ((each.min(axis=1), each.max(axis=1)) for each in (first, second))
    mine = np.flatnonzero(_box_meets(low, high, low2.min(axis=0, initial=np.inf), high2.max(axis=0, initial=-np.inf)))
    theirs = np.flatnonzero(_box_meets(low2, high2, low[mine].min(axis=0, initial=np.inf),
                                       high[mine].max(axis=0, initial=-np.inf)))
    along = int(np.argmax(np.ptp(low2[theirs], axis=0))) if len(theirs) else 0
    i, j = _overlapping(low[mine, along], high[mine, along], low2[theirs, along], high2[theirs, along])
    i, j = mine[i], theirs[j]
    meet = _box_meets(low[i], high[i], low2[j], high2[j])
    return i[meet], j[meet]


def _box_meets(low: np.ndarray, high: np.ndarray, low2: np.ndarray, high2: np.ndarray) -> np.ndarray:
    return ((low <= high2) & (low2 <= high)).all(axis=1)


def _overlapping(low: np.ndarray, high: np.ndarray, low2: np.ndarray, high2: np.ndarray,
                 ) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of intervals that overlap: the second begins in the first, or the first within the second."""
    order, order2 = np.argsort(low), np.argsort(low2)
    i, j = spans(np.searchsorted(low2[order2], low), np.searchsorted(low2[order2], high, "right"))
    k, m = spans(np.searchsorted(low[order], low2, "right"), np.searchsorted(low[order], high2, "right"))
    return np.concatenate([i, order[m]]), np.concatenate([order2[j], k])


def _distance(points: np.ndarray, segments: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distance of each point (k, 2) to the nearest of the segments (s, 2, 2), and the number of that one."""
    along = segments[:, 1] - segments[:, 0]
    offset = points[:, None] - segments[:, 0]
    t = np.clip(np.einsum("ksd,sd->ks", offset, along) / np.einsum("sd,sd->s", along, along), 0.0, 1.0)
    distance = np.linalg.norm(offset - t[:, :, None] * along, axis=2)
    nearest = np.argmin(distance, axis=1)
    return distance[np.arange(len(points)), nearest], nearest


def _depth(overlap: Overlap) -> float:
    return overlap.depth


def _cross(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
