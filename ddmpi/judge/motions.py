"""Rigid motions of bodies, and the words for them.

A velocity is that of the body's centre, and then the turning: (v_x, v_y, ω), counterclockwise, in the plane, and
(v_x, v_y, v_z, ω_x, ω_y, ω_z), about these axes by the right hand, in space. An axis in words points such that the body
turns about it by the right hand.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from math import factorial

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

TURNS = {2: ((0, 1),), 3: ((1, 2), (2, 0), (0, 1))}
"""By dimension, the axes of each turning: the first turns towards the second."""

SAME = 1e-2
"""Velocities that differ by less than this part of the largest one count as one motion."""

REACH = 3.0
"""A body turns about a point or an axis if that is at most this many sizes away; else it moves and turns."""

INSIDE = 0.1
"""A body turns about a point or axis nearer to its centre than this part of its size; else it tips about it."""

SIDEWAYS = 0.1
"""A body tips to the left or right if the horizontal part of its velocity is at least this part of it."""

TOWARDS = 0.8
"""In space a body tips towards x if this part of its velocity is along x; else towards (0.7, 0, -0.7)."""

NAMED = 2
"""Of more bodies than three, so many are named."""

FLAT = 1e-3
"""A body is at least this part of its size thick."""

LARGEST = 300
"""Of more loose bodies that lean on each other nobody asks which motions nothing resists: it takes too long."""

RESISTED = 3e-4
"""A motion is not resisted by less than this part of what resists others. Round parts turn in round bores against up to
1.5e-4 where meshes do not match, as normals are off by so much; no force stands against it in truth."""


@dataclass(frozen=True)
class MotionsOfBody:
    """The rigid motions that the clamps of a body leave free.

    Attributes
    ----------
    name : of the body
    centre : (d,) centroid of the body's convex hull (m)
    size : distance from the centre to the farthest node (m)
    measure : area or volume of the convex hull (m² or m³)
    spread : (d, d) mean of x xᵀ over the convex hull, with x from the centre (m²)
    outline : (k, d) nodes at the corners of the convex hull: one of them is always the fastest (m)
    basis : (n, j) the free motions as combinations of: along the axes, and the turnings about the centre over the size
    """

    name: str
    centre: np.ndarray
    size: float
    measure: float
    spread: np.ndarray
    outline: np.ndarray
    basis: np.ndarray

    @classmethod
    def of(cls, name: str, points: np.ndarray, motions: np.ndarray) -> MotionsOfBody:
        """From the nodes (nv, d) and the displacements (nv, d, j) that the free motions mean there. Not collective."""
        d = points.shape[1]
        outline, centre, measure, spread = _hull(points)
        size = float(np.linalg.norm(outline - centre, axis=1).max())
        body = cls(name, centre, size, max(measure, FLAT * size ** d), spread, outline, np.eye(d + len(TURNS[d])))
        rigid = np.stack([body.at(body.velocity(unit), points) for unit in body.basis], axis=2)
        fitted = np.linalg.lstsq(rigid.reshape(-1, len(body.basis)), motions.reshape(-1, motions.shape[2]), rcond=None)
        return replace(body, basis=fitted[0])

    @property
    def dimension(self) -> int:
        """d, of the centre and of the velocities of points."""
        return len(self.centre)

    @property
    def inertia(self) -> np.ndarray:
        """(j, j) mass matrix of the free motions for density one (m² or m³)."""
        d = self.dimension
        spins = [_spin(turning) / self.size for turning in np.eye(len(self.basis))[:, d:]]
        mass = np.array([[np.trace(one @ self.spread @ other.T) for other in spins] for one in spins])
        mass[:d, :d] = np.eye(d)
        return self.measure * self.basis.T @ mass @ self.basis

    @property
    def speeds(self) -> np.ndarray:
        """(j,) the largest nodal velocity of each free motion."""
        return np.array([self.speed(self.velocity(unit)) for unit in np.eye(self.basis.shape[1])])

    def velocity(self, coefficients: np.ndarray) -> np.ndarray:
        """(n,) that of the combination (j,) of the free motions."""
        found = self.basis @ coefficients
        return np.append(found[:self.dimension], found[self.dimension:] / self.size)

    def at(self, velocity: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Velocities (k, d) of `points` (k, d) that move with the body."""
        return velocity[:self.dimension] + (points - self.centre) @ _spin(velocity[self.dimension:]).T

    def speed(self, velocity: np.ndarray) -> float:
        """The largest velocity of a node."""
        return float(np.linalg.norm(self.at(velocity, self.outline), axis=1).max())


def describe_motions(bodies: Sequence[MotionsOfBody], velocities: np.ndarray, touching: set[frozenset[str]]) -> str:
    """How the fastest bodies move, and which others move, too: "tower tips to the left about (2, 0)".

    Parameters
    ----------
    velocities : (nb, n) of each body
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


def undetermined(G_active: np.ndarray, bodies: Sequence[MotionsOfBody],
                 friction: np.ndarray | None = None) -> list[str]:
    """The rigid motions that no closed contact resists at a solution, one sentence each. Not collective.

    Bodies that lean on each other are looked at together, unless they are more than `LARGEST`.

    Parameters
    ----------
    G_active : (nc, k) columns of G of the forces that resist: normal ones of closed nodes, tangential ones of
        nodes that stick, all of bonded contacts; or others with the same sums of squares; sparse or dense
    bodies : the loose ones, in the order of the rows
    friction : (2, k) G s and |G||s| of the friction s at its limit (N): a motion against it is held, and the sentence
        names the other way; left out, there is none
    """
    numbers = [body.basis.shape[1] for body in bodies]
    starts, owner = np.cumsum([0, *numbers]), np.repeat(np.arange(len(bodies)), numbers)
    unit = np.concatenate([np.empty(0), *(body.speeds for body in bodies)])
    friction = np.zeros((2, len(owner))) if friction is None else friction
    G = sparse.csr_matrix(sparse.diags(1.0 / unit) @ sparse.csr_matrix(G_active))
    G.eliminate_zeros()
    touches = sparse.csr_matrix((np.ones(starts[-1]), (owner, np.arange(starts[-1])))) @ abs(G)
    number, island = csgraph.connected_components(touches @ touches.T, directed=False)
    found: tuple[list[str], list[str]] = [], []
    for members in np.split(np.argsort(island, kind="stable"), np.cumsum(np.bincount(island, minlength=number))[:-1]):
        rows, some = np.flatnonzero(np.isin(owner, members)), [bodies[k] for k in members]
        if len(some) == 1 and not touches[members].nnz and numbers[members[0]] == len(some[0].basis):
            found[0].append(f"nothing touches {some[0].name}: it can move freely")
        elif len(some) <= LARGEST:
            own = G[rows]
            for motion in _null_space(own[:, np.unique(own.indices)].toarray().T):
                motion = motion / unit[rows]
                work, most = motion @ friction[0, rows], friction[1, rows] / unit[rows]
                driven = abs(work) > SAME * most.max()
                parts = np.split(-motion if work < 0.0 else motion, np.cumsum([numbers[k] for k in members])[:-1])
                found[1].append(_can(some, np.array([body.velocity(part) for body, part in
                                                     zip(some, parts, strict=True)]), driven))
    return [*found[0], *found[1]]


def _null_space(A: np.ndarray) -> np.ndarray:
    """Vectors (q, n) that A (k, n) takes to nothing, each with an entry 1 where the others have zeros."""
    from scipy.linalg import null_space, qr

    if not A.shape[1]:
        return np.empty((0, 0))
    null = null_space(np.linalg.qr(np.vstack([A, np.zeros((1, A.shape[1]))]), mode="r"), RESISTED).T
    if len(null) == 0:
        return null
    pivots = qr(null, mode="r", pivoting=True)[1][:len(null)]
    return np.linalg.solve(null[:, pivots], null)


def _can(bodies: Sequence[MotionsOfBody], velocities: np.ndarray, driven: bool) -> str:
    """What bodies can do: the way that they are `driven`, or of both ways the one along the axes."""
    speeds = np.array([body.speed(v) for body, v in zip(bodies, velocities, strict=True)])
    lead = int(np.argmax(speeds))
    group = _moving_as(lead, bodies, velocities, SAME * speeds[lead])
    v, d = velocities[lead] / speeds[lead], bodies[lead].dimension
    names = _names([bodies[k].name for k in group])
    others = [bodies[k].name for k in np.flatnonzero(speeds > SAME * speeds[lead]) if k not in group]
    if _is_translation(bodies[lead], v):
        how = f"slide along {direction(v[:d] if driven else _forwards(v[:d]))}"
    else:
        turning = _Turning.of([bodies[k] for k in group], bodies[lead], v)
        way = v[d:] if turning.pole else v[:d]
        v = v if driven or _forwards(way) is way else -v
        turning = _Turning.of([bodies[k] for k in group], bodies[lead], v)
        how = (f"turn about {turning.pole}" + f" and move {turning.along} it" * bool(turning.along) if turning.pole else
               f"move along {direction(v[:d])} and turn{turning.axis}")
    return f"{names} can {how}{f', {_names(others)} moving with it,' if others else ''} without any force"


def _would(group: list[int], bodies: Sequence[MotionsOfBody], velocities: np.ndarray,
           touching: set[frozenset[str]]) -> str:
    """What a group of bodies that move as one would do."""
    members, one = [bodies[k] for k in group], len(group) == 1
    lead, v = members[0], velocities[group[0]]
    v, d = v / lead.speed(v), lead.dimension
    own = {body.name for body in members}
    names = _names([body.name for body in members])
    if _is_translation(lead, v):
        if any(len(pair & own) == 1 for pair in touching):
            return f"{names} would slide along {direction(v[:d])}"
        return f"nothing holds {names}: {'it' if one else 'they'} would move along {direction(v[:d])}"
    turning = _Turning.of(members, lead, v)
    if not turning.pole:
        return f"{names} would move along {direction(v[:d])} and turn{turning.sense}{turning.axis}"
    mean = sum(body.measure * lead.at(v, body.centre[None])[0] for body in members)
    mean = mean / sum(body.measure for body in members)
    far = np.linalg.norm(mean) > INSIDE * np.linalg.norm(v[d:]) * max(body.size for body in members)
    verb = ("tip" if far and not turning.along else "turn") + "s" * one
    how = _towards(mean) if verb.startswith("tip") else ""
    also = f" and move{'s' * one} {turning.along} it" if turning.along else ""
    return f"{names} {verb}{how or turning.sense} about {turning.pole}{also}"


def _towards(mean: np.ndarray) -> str:
    """Where a body tips whose centre has this velocity (d,); nothing for one in the plane that goes up or down."""
    size = np.abs(mean) / np.linalg.norm(mean)
    if len(mean) > 2:
        return f" towards {direction(np.where(size == size.max(), mean, 0.0) if size.max() >= TOWARDS else mean)}"
    return f" to the {'right' if mean[0] > 0.0 else 'left'}" if size[0] >= SIDEWAYS else ""


def _forwards(vector: np.ndarray) -> np.ndarray:
    """The vector itself, or its opposite, whichever is more along the axes."""
    parts = vector / np.linalg.norm(vector)
    ways = [each for each in (parts.sum(), *parts) if abs(each) > SAME]
    return vector if ways[0] > 0.0 else -vector


def _moving_as(lead: int, bodies: Sequence[MotionsOfBody], velocities: np.ndarray, least: float) -> list[int]:
    """The bodies that move with the body `lead` as one, and itself; nodes may differ in velocity by `least`."""
    group = [lead]
    for k, body in enumerate(bodies):
        carried = np.append(bodies[lead].at(velocities[lead], body.centre[None])[0], velocities[lead][body.dimension:])
        if k != lead and body.speed(velocities[k] - carried) <= least < body.speed(velocities[k]):
            group.append(k)
    return sorted(group)


def _is_translation(body: MotionsOfBody, v: np.ndarray) -> bool:
    return bool(np.linalg.norm(v[body.dimension:]) * body.size <= SAME * body.speed(v))


def _spin(turning: np.ndarray) -> np.ndarray:
    """(d, d) what takes places to their velocities where a body turns about the origin."""
    (axes,) = (each for each in TURNS.values() if len(each) == len(turning))
    spin = np.zeros((max(map(max, axes)) + 1,) * 2)
    for (first, second), rate in zip(axes, turning, strict=True):
        spin[first, second], spin[second, first] = -rate, rate
    return spin


@dataclass(frozen=True)
class _Turning:
    """Words for how bodies turn that move as one.

    Attributes
    ----------
    pole : about what, if that is in their reach: a point in the plane, an axis in space
    sense : which way, in the plane: " clockwise"
    axis : along what, in space: " about an axis along z"
    along : in space, how they move besides: "along" the axis or "against" it
    """

    pole: str
    sense: str
    axis: str
    along: str

    @classmethod
    def of(cls, members: list[MotionsOfBody], lead: MotionsOfBody, v: np.ndarray) -> _Turning:
        """From the velocity (n,) of the body `lead`, the fastest node of which has velocity one."""
        d, nodes = lead.dimension, np.concatenate([body.outline for body in members])
        middle = (nodes.max(axis=0) + nodes.min(axis=0)) / 2
        size = float(np.linalg.norm(nodes - middle, axis=1).max())
        spin, turning = _spin(v[d:]), v[d:]
        away = spin @ lead.at(v, middle[None])[0] / (turning @ turning)  # no farther than the axis is
        pole = ""
        if np.linalg.norm(away) <= REACH * size:
            pole = f"({', '.join(_rounded(x, min(body.size for body in members)) for x in middle + away)})"
        if lead.dimension == 2:
            return cls(pole, " counterclockwise" if turning[0] > 0.0 else " clockwise", "", "")
        along = turning @ v[:d] / np.linalg.norm(turning)
        return cls(f"the axis through {pole} along {direction(turning)}" if pole else "", "",
                   f" about an axis along {direction(turning)}",
                   "" if abs(along) <= SAME else "along" if along > 0.0 else "against")


def direction(v: np.ndarray) -> str:
    """The direction of a vector (d,) in words: x, -y, or (0.8, 0.6)."""
    parts = np.round(v / np.linalg.norm(v), 2) + 0.0
    (axes,) = np.nonzero(np.abs(parts) >= SAME)
    if len(axes) == 1:
        return ("-" if parts[axes[0]] < 0.0 else "") + "xyz"[axes[0]]
    return f"({', '.join(f'{x:g}' for x in parts)})"


def _rounded(value: float, size: float) -> str:
    """A coordinate to a tenth or hundredth of `size`."""
    digits = 1 - int(np.floor(np.log10(size)))
    return f"{round(float(value), digits) + 0.0:.10g}"


def _names(names: list[str]) -> str:
    shown = names if len(names) <= NAMED + 1 else names[:NAMED]
    if len(shown) < len(names):
        return f"{', '.join(shown)} (and {len(names) - len(shown)} more)"
    return " and ".join([", ".join(shown[:-1]), shown[-1]] if len(shown) > 1 else shown)


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
    """Corners, centroid, measure and spread of the convex hull; the measure is 0 on a line, or a plane in space."""
    from scipy.spatial import ConvexHull, QhullError

    middle, d = points.mean(axis=0), points.shape[1]
    size = np.abs(points - middle).max()
    try:
        hull = ConvexHull((points - middle) / size)
    except QhullError:
        x = points - middle
        return points, middle, 0.0, x.T @ x / len(x) + (FLAT * size) ** 2 * np.eye(d)
    facets = points[hull.simplices] - middle  # (f, d, d), each with the middle a simplex
    measures = np.abs(np.linalg.det(facets)) / factorial(d)
    sums, measure = facets.sum(axis=1), measures.sum()
    shift = measures @ sums / (d + 1) / measure
    squares = np.einsum("f,fki,fkj->ij", measures, facets, facets) + np.einsum("f,fi,fj->ij", measures, sums, sums)
    spread = squares / ((d + 1) * (d + 2)) / measure - np.outer(shift, shift)
    return points[hull.vertices], middle + shift, float(measure), spread
