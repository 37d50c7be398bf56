"""Rigid motions of bodies in the plane, and the words for them.

A velocity is (v_x, v_y, ω): that of the body's centre, and the turning, counterclockwise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SAME = 1e-2
"""Velocities that differ by less than this part of the largest one count as one motion."""

REACH = 3.0
"""A body turns about a point if that is at most this many sizes away; else it moves and turns."""

INSIDE = 0.1
"""A body turns about a point nearer to its centre than this part of its size; else it tips about it."""

SIDEWAYS = 0.1
"""A body tips to the left or right if the horizontal part of its velocity is at least this part of it."""

NAMED = 2
"""Of more bodies than three, so many are named."""

FLAT = 1e-3
"""The area of a body is at least this part of its size squared."""


@dataclass(frozen=True)
class MotionsOfBody:
    """The rigid motions that the clamps of a body leave free.

    Attributes
    ----------
    name : of the body
    centre : (2,) centroid of the body's convex hull (m)
    size : distance from the centre to the farthest node (m)
    area : of the convex hull (m²)
    gyration : radius of gyration of the convex hull (m)
    outline : (k, 2) nodes at the corners of the convex hull: one of them is always the fastest (m)
    basis : (3, j) the free motions as combinations of: along x, along y, rotation about the centre over the size
    """

    name: str
    centre: np.ndarray
    size: float
    area: float
    gyration: float
    outline: np.ndarray
    basis: np.ndarray

    @classmethod
    def of(cls, name: str, points: np.ndarray, motions: np.ndarray) -> MotionsOfBody:
        """From the nodes (nv, 2) and the displacements (nv, 2, j) that the free motions mean there. Not collective."""
        outline, centre, area, gyration = _hull(points)
        size = float(np.linalg.norm(outline - centre, axis=1).max())
        x, y = (points - centre).T / size
        one, zero = np.ones(len(points)), np.zeros(len(points))
        rigid = np.stack([np.column_stack([one, zero]), np.column_stack([zero, one]), np.column_stack([-y, x])], axis=2)
        basis = np.linalg.lstsq(rigid.reshape(-1, 3), motions.reshape(-1, motions.shape[2]), rcond=None)[0]
        return cls(name, centre, size, max(area, FLAT * size ** 2), gyration, outline, basis)

    @property
    def inertia(self) -> np.ndarray:
        """(j, j) mass matrix of the free motions for density one (m²)."""
        return self.area * (self.basis.T * (1.0, 1.0, (self.gyration / self.size) ** 2)) @ self.basis

    def velocity(self, coefficients: np.ndarray) -> np.ndarray:
        """(v_x, v_y, ω) of the combination (j,) of the free motions."""
        return (self.basis @ coefficients) / (1.0, 1.0, self.size)

    def at(self, velocity: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Velocities (k, 2) of `points` (k, 2) that move with the body."""
        x, y = (points - self.centre).T
        return velocity[:2] + velocity[2] * np.column_stack([-y, x])

    def speed(self, velocity: np.ndarray) -> float:
        """The largest velocity of a node."""
        return float(np.linalg.norm(self.at(velocity, self.outline), axis=1).max())


def describe_motions(bodies: Sequence[MotionsOfBody], velocities: np.ndarray, touching: set[frozenset[str]]) -> str:
    """How the fastest bodies move, and which others move, too: "tower tips to the left about (2, 0)".

    Parameters
    ----------
    velocities : (nb, 3) of each body
    touching : pairs of names of bodies, or rigid partners, that stay in contact
    """
    speeds = np.array([body.speed(v) for body, v in zip(bodies, velocities, strict=True)])
    top = speeds.max()
    said: set[int] = set()
    lines: list[str] = []
    for lead in np.flatnonzero(speeds >= (1.0 - SAME) * top):
        if lead not in said and len(lines) < NAMED:
            group = _moving_as(int(lead), bodies, velocities, SAME * top)
            said |= set(group)
            lines.append(_would(group, bodies, velocities, touching))
    others = [bodies[k].name for k in np.flatnonzero(speeds > SAME * top) if k not in said]
    if others:
        lines.append(f"{_names(others)} {'moves' if len(others) == 1 else 'move'}, too")
    return "; ".join(lines)


def undetermined(G_active: np.ndarray, bodies: Sequence[MotionsOfBody]) -> list[str]:
    """The rigid motions that no closed contact resists at a solution, one sentence each.

    Parameters
    ----------
    G_active : (nc, k) columns of G of the forces that resist: normal ones of closed nodes, tangential ones of
        nodes that stick, all of bonded contacts; sparse or dense
    bodies : the loose ones, in the order of the rows

    Not collective.
    """
    starts = np.cumsum([0, *(body.basis.shape[1] for body in bodies)])
    dense = np.asarray(G_active.todense() if hasattr(G_active, "todense") else G_active, dtype=float)
    unit = np.concatenate([_speeds(body) for body in bodies]) if bodies else np.empty(0)
    dense = dense / unit[:, None]
    length = np.linalg.norm(dense, axis=0)
    dense = dense[:, length > 0.0] / length[length > 0.0]
    alone = [k for k, body in enumerate(bodies)
             if body.basis.shape[1] == 3 and not dense[starts[k]:starts[k + 1]].any()]
    lines = [f"nothing touches {bodies[k].name}: it can move freely" for k in alone]
    rows = np.concatenate([np.arange(starts[k], starts[k + 1]) for k in range(len(bodies)) if k not in alone] or
                          [np.empty(0, int)]).astype(int)
    for motion in _null_space(dense[rows].T):
        coefficients = np.zeros(starts[-1])
        coefficients[rows] = motion / unit[rows]
        velocities = np.array([body.velocity(coefficients[a:b])
                               for body, a, b in zip(bodies, starts[:-1], starts[1:], strict=True)])
        lines.append(_can(bodies, velocities))
    return lines


def _null_space(A: np.ndarray, rounding: float = 1e-9) -> np.ndarray:
    """Vectors (q, n) that A (k, n) takes to nothing, each with an entry 1 where the others have zeros."""
    from scipy.linalg import qr

    n = A.shape[1]
    if n == 0:
        return np.empty((0, 0))
    R = np.linalg.qr(A, mode="r") if len(A) > n else A
    _, values, vectors = np.linalg.svd(R) if len(R) else (None, np.empty(0), np.eye(n))
    null = vectors[int((values > rounding * max(values[0], 1.0)).sum()) if len(values) else 0:]
    if len(null) == 0:
        return null
    pivots = qr(null, mode="r", pivoting=True)[1][:len(null)]
    return np.linalg.solve(null[:, pivots], null)


def _can(bodies: Sequence[MotionsOfBody], velocities: np.ndarray) -> str:
    speeds = np.array([body.speed(v) for body, v in zip(bodies, velocities, strict=True)])
    lead = int(np.argmax(speeds))
    group = _moving_as(lead, bodies, velocities, SAME * speeds[lead])
    v = velocities[lead] / speeds[lead]
    if np.sum(v[:2]) < 0.0:  # both ways are possible; name the one along the axes
        v = -v
    names = _names([bodies[k].name for k in group])
    others = [bodies[k].name for k in np.flatnonzero(speeds > SAME * speeds[lead]) if k not in group]
    pole = _pole([bodies[k] for k in group], bodies[lead], v)
    how = (f"slide along {direction(v[:2])}" if _is_translation(bodies[lead], v) else
           f"turn about {pole}" if pole else f"move along {direction(v[:2])} and turn")
    return f"{names} can {how}{f', {_names(others)} moving with it,' if others else ''} without any force"


def _would(group: list[int], bodies: Sequence[MotionsOfBody], velocities: np.ndarray,
           touching: set[frozenset[str]]) -> str:
    """What a group of bodies that move as one would do."""
    members, one = [bodies[k] for k in group], len(group) == 1
    lead, v = members[0], velocities[group[0]]
    v = v / lead.speed(v)
    own = {body.name for body in members}
    names = _names([body.name for body in members])
    if _is_translation(lead, v):
        if any(len(pair & own) == 1 for pair in touching):
            return f"{names} would slide along {direction(v[:2])}"
        return f"nothing holds {names}: {'it' if one else 'they'} would move along {direction(v[:2])}"
    pole = _pole(members, lead, v)
    sense = "counterclockwise" if v[2] > 0.0 else "clockwise"
    if not pole:
        return f"{names} would move along {direction(v[:2])} and turn {sense}"
    area = sum(body.area for body in members)
    mean = sum(body.area * lead.at(v, body.centre[None])[0] for body in members) / area
    far = np.linalg.norm(mean) > INSIDE * abs(v[2]) * max(body.size for body in members)
    if far and abs(mean[0]) >= SIDEWAYS * np.linalg.norm(mean):
        return f"{names} {'tips' if one else 'tip'} to the {'right' if mean[0] > 0.0 else 'left'} about {pole}"
    return f"{names} {'tips' if far and one else 'tip' if far else 'turns' if one else 'turn'} {sense} about {pole}"


def _moving_as(lead: int, bodies: Sequence[MotionsOfBody], velocities: np.ndarray, least: float) -> list[int]:
    """The bodies that move with the body `lead` as one, and itself; nodes may differ in velocity by `least`."""
    group = [lead]
    for k, body in enumerate(bodies):
        carried = np.append(bodies[lead].at(velocities[lead], body.centre[None])[0], velocities[lead][2])
        if k != lead and body.speed(velocities[k] - carried) <= least < body.speed(velocities[k]):
            group.append(k)
    return sorted(group)


def _is_translation(body: MotionsOfBody, v: np.ndarray) -> bool:
    return bool(abs(v[2]) * body.size <= SAME * body.speed(v))


def _pole(members: list[MotionsOfBody], lead: MotionsOfBody, v: np.ndarray) -> str:
    """The point about which the bodies turn, in words; nothing where it is out of their reach."""
    if not v[2]:
        return ""
    pole = lead.centre + np.array([-v[1], v[0]]) / v[2]
    nodes = np.concatenate([body.outline for body in members])
    middle = (nodes.max(axis=0) + nodes.min(axis=0)) / 2
    size = float(np.linalg.norm(nodes - middle, axis=1).max())
    if np.linalg.norm(pole - middle) > REACH * size:
        return ""
    return f"({', '.join(_rounded(value, min(body.size for body in members)) for value in pole)})"


def direction(v: np.ndarray) -> str:
    """The direction of a vector (2,) in words: x, -y, or (0.8, 0.6)."""
    x, y = np.round(v / np.linalg.norm(v), 2) + 0.0
    if min(abs(x), abs(y)) < SAME:
        return ("-" if x + y < 0.0 else "") + ("x" if abs(x) > abs(y) else "y")
    return f"({x:g}, {y:g})"


def _rounded(value: float, size: float) -> str:
    """A coordinate to a tenth or hundredth of `size`."""
    digits = 1 - int(np.floor(np.log10(size)))
    return f"{round(float(value), digits) + 0.0:.10g}"


def _names(names: list[str]) -> str:
    shown = names if len(names) <= NAMED + 1 else names[:NAMED]
    if len(shown) < len(names):
        return f"{', '.join(shown)} (and {len(names) - len(shown)} more)"
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


def _speeds(body: MotionsOfBody) -> np.ndarray:
    """(j,) the largest nodal velocity of each free motion."""
    return np.array([body.speed(body.velocity(unit)) for unit in np.eye(body.basis.shape[1])])


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, float]:
    """Corners, centroid, area and radius of gyration of the convex hull; nodes on a line have no area."""
    from scipy.spatial import ConvexHull, QhullError

    middle = points.mean(axis=0)
    size = np.abs(points - middle).max()
    try:
        corners = points[ConvexHull((points - middle) / size).vertices]  # counterclockwise
    except QhullError:
        return points, middle, 0.0, float(np.sqrt(((points - middle) ** 2).sum(axis=1).mean()))
    a = corners - middle
    b = np.roll(a, -1, axis=0)
    twice = a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]
    area = twice.sum() / 2
    shift = (twice[:, None] * (a + b)).sum(axis=0) / (6 * area)
    polar = (twice * (a * a + a * b + b * b).sum(axis=1)).sum() / 12
    return corners, middle + shift, float(area), float(np.sqrt(max(polar / area - shift @ shift, 0.0)))
