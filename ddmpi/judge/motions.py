"""Rigid motions of bodies, and the words for them.

A velocity (n,) is that of the body's centre, then its rotation: (v_x, v_y, ω), counterclockwise, in the plane, and
(v_x, v_y, v_z, ω_x, ω_y, ω_z), by the right-hand rule, in space.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.body.rigid_motions import rigid_motions
from ddmpi.system.matrices import scaled, square
from ddmpi.system.numbers import crossed, in_words

SAME = 1e-2  # velocities that differ by less than this fraction of the largest count as one motion
TURNS_ABOUT = (
    0.25  # a body turns about its middle if that moves by at most this fraction of the fastest node
)
NAMED = 2  # of more than NAMED + 1 bodies, this many are named
DIGITS = 6  # places that agree to this many digits of a body's size are equal
FLAT = 1e-3  # least thickness of a body over its size
LARGEST = 300  # skip the search for free motions in larger groups of bodies

TURN = " can turn "  # in the words for a motion with a moment along it

RESISTED = 3e-4
"""Resistance below this fraction of how far a motion moves sides past each other counts as none. Meshes that do not match
resist turning of a round part in a round bore by up to 1.5e-4, because their normals are off; the true resistance is zero.
A long stack that sways moves its sides by as little as it is resisted."""

COARSE, APART = 1e-2, 30.0
"""Normals of coarse linear elements in space are off by up to COARSE: motions that are resisted by so little are held as
well, with a warning, if all others are resisted by APART times as much."""

RIGID = 1e-6
"""The square of a motion past contacts counts as this fraction of that of the bodies at least: rounding of squares, 1e-8
of a motion, is then far below `RESISTED` of what it is compared with."""

NONE = 1e-20
"""Squares below this are rounding: motions move the farthest node of their body by 1."""

CLEAR = 1.01
"""Motions that are resisted by more than so many times a limit are so for any rounding."""


@dataclass(frozen=True)
class MotionsOfBody:
    """The rigid motions that the clamps of a body leave free.

    Attributes
    ----------
    name : of the body
    centre : (d,) centroid of the body's convex hull (m)
    size : distance from the centre to the farthest node (m)
    outline : (k, d) nodes at the corners of the convex hull: one of them is always the fastest (m)
    basis : (n, j) the velocities of the free motions
    inertia : (j, j) mass matrix of the free motions of the convex hull, if its mass is one
    pivot : (d,) of a sector, on the axis of its wheel (m)
    touches_itself : or its image
    """

    name: str
    centre: np.ndarray
    size: float
    outline: np.ndarray
    basis: np.ndarray
    inertia: np.ndarray
    pivot: np.ndarray | None = None
    touches_itself: bool = False

    @classmethod
    def of(cls, name: str, points: np.ndarray, motions: np.ndarray) -> Self:
        """From the nodes (nv, d) and the displacements (nv, d, j) that the free motions mean there. Not collective."""
        outline, places, weights = _hull(points)
        centre = weights @ places
        size = float(np.linalg.norm(outline - centre, axis=1).max())
        rigid = rigid_motions(points, centre, size).reshape(motions[..., 0].size, -1)
        basis = np.linalg.lstsq(rigid, motions.reshape(len(rigid), -1), rcond=None)[0]
        moved = rigid_motions(places, centre, size) @ basis
        inertia = np.einsum("k,kdi,kdj->ij", weights, moved, moved) + FLAT**2 * basis.T @ basis
        basis[len(centre) :] /= size
        return cls(name, centre, size, outline, basis, inertia)

    def shifted(self, name: str, shift: np.ndarray) -> Self:
        """Those of a body of this name that is elsewhere, by a shift (d,) in metres."""
        return replace(self, name=name, centre=shift + self.centre, outline=shift + self.outline)

    @property
    def dimension(self) -> int:
        """d, of the centre and of the velocities of points."""
        return len(self.centre)

    @property
    def speeds(self) -> np.ndarray:
        """(j,) the largest nodal velocity of each free motion."""
        return np.array([self.speed(velocity) for velocity in self.basis.T])

    @property
    def freely(self) -> str:
        """That no other body touches it, in words."""
        if self.touches_itself:
            return f"{self.name} can move freely without any force"
        return f"nothing touches {self.name}: it can move freely"

    def at(self, velocity: np.ndarray, points: np.ndarray) -> np.ndarray:
        """Velocities (k, d) of `points` (k, d) that move with the body."""
        return velocity[: self.dimension] + crossed(
            velocity[None, self.dimension :], points - self.centre
        )

    def speed(self, velocity: np.ndarray) -> float:
        """The largest velocity of a node."""
        return float(np.linalg.norm(self.at(velocity, self.outline), axis=1).max())


def describe_motions(
    bodies: Sequence[MotionsOfBody], velocities: np.ndarray, verb: str = "would"
) -> str:
    """How the fastest bodies "would" or "can" move with the velocities (nb, n), and which others; "" if none moves."""
    speeds = np.array([body.speed(v) for body, v in zip(bodies, velocities, strict=True)])
    top = speeds.max(initial=0.0)
    moving = [int(k) for k in np.flatnonzero(speeds > SAME * top)]
    sentences: list[str] = []
    for lead in np.flatnonzero(speeds >= (1.0 - SAME) * top):
        if lead in moving and len(sentences) < NAMED:
            group = _moving_as(int(lead), bodies, velocities, SAME * top)
            moving = [k for k in moving if k not in group]
            way = _way([bodies[k] for k in group], velocities[group[0]])
            sentences.append(f"{_names(bodies, group)} {verb} {way}")
    if moving:
        sentences.append(f"{_names(bodies, moving)} {verb} move, too")
    return "; ".join(sentences)


def undetermined(
    G_active: np.ndarray,
    bodies: Sequence[MotionsOfBody],
    past: sparse.csr_matrix | None = None,
    friction: np.ndarray | None = None,
    changes: sparse.csr_matrix | None = None,
) -> list[str]:
    """The rigid motions that neither a closed contact resists at a solution nor loads, one sentence each. Not collective.

    Bodies that touch form a group, which is skipped if it has more than `LARGEST`.

    Parameters
    ----------
    G_active : (nc, k) columns of G of the forces that resist: normal ones of closed nodes, tangential ones of
        nodes that stick, all of bonded contacts; or others with the same sums of squares; sparse or dense
    bodies : the loose ones, in the order of the rows
    past : (nc, nc) DᵀD of how far motions move the sides of contacts past each other; none without contacts
    friction : (2, k) G s and |G||s| of the friction s at its limit (N), zero if left out: it resists a motion against
        it, so that the sentence names the other direction
    changes : (nc, nc) K, by which loads that do not follow bodies that move far resist
    """
    numbers = [body.basis.shape[1] for body in bodies]
    starts, owner = np.cumsum([0, *numbers]), np.repeat(np.arange(len(bodies)), numbers)
    unit = np.concatenate([np.empty(0), *(body.speeds for body in bodies)])
    friction = np.zeros((2, len(owner))) if friction is None else friction
    none = sparse.csr_matrix((len(owner),) * 2)
    G = scaled(sparse.csr_matrix(G_active, copy=True), 1.0 / unit)
    D, K = (
        none if given is None else scaled(given, 1.0 / unit, 1.0 / unit)
        for given in (past, changes)
    )
    loads = loads_beside(K, owner)
    G.eliminate_zeros()
    of_bodies = sparse.csr_matrix((np.ones(starts[-1]), np.arange(starts[-1]), starts))
    touches = of_bodies @ abs(G)
    number, island = csgraph.connected_components(touches @ touches.T, directed=False)
    untouched, sliding = list[str](), list[str]()
    for members in np.split(
        np.argsort(island, kind="stable"), np.cumsum(np.bincount(island, minlength=number))[:-1]
    ):
        rows, some = np.flatnonzero(np.isin(owner, members)), [bodies[k] for k in members]
        if (
            len(some) == 1
            and not touches[members].nnz
            and numbers[members[0]] == len(some[0].basis)
        ):
            untouched.append(some[0].freely)
        elif len(some) <= LARGEST:
            squares = (G[rows] @ G[rows].T).toarray()
            vectors = unresisted(squares, square(D, rows))[0]
            for motion in dead(vectors, square(K, rows), loads[rows], RESISTED).T:
                velocities = np.array(
                    [
                        body.basis @ (motion / unit[rows])[owner[rows] == k]
                        for k, body in zip(members, some, strict=True)
                    ]
                )
                works, most = friction[:, rows] / unit[rows]
                way = _free_way(some, velocities, motion @ works, most.max())
                sliding.append(f"{way} without any force")
    return untouched + sliding


def _free_way(
    bodies: Sequence[MotionsOfBody], velocities: np.ndarray, work: float, most: float
) -> str:
    """How bodies can move along `velocities` (nb, n) or against them: as friction pushes, by its `work` along them and
    what that may be at `most`, else along the axes."""
    if not abs(work) > SAME * most:
        work = forwards(bodies, velocities)
    return describe_motions(bodies, -velocities if work < 0.0 else velocities, "can")


def unresisted(F: np.ndarray, D: np.ndarray, coarse: bool = False) -> tuple[np.ndarray, bool]:
    """A basis (j, q), orthonormal columns, of the motions with |F v| ≤ η |D v|, by FᵀF and DᵀD; and whether some are
    above `RESISTED`, of `coarse` elements alone."""
    from scipy.linalg import eigh

    sizes = D.diagonal()
    own = RIGID * np.where(sizes > NONE, sizes, 1.0)
    D = D + np.diag(own)
    most = COARSE if coarse else RESISTED
    if is_definite(F - (CLEAR * most) ** 2 * D):  # all are resisted by more
        return np.empty((len(F), 0)), False
    squares, vectors = eigh(F, D)
    ratios = np.sqrt(np.maximum(squares, 0.0))
    few, many = (int((ratios <= least).sum()) for least in (RESISTED, COARSE))
    apart = many == len(ratios) or ratios[many] >= APART * ratios[many - 1]
    if not coarse or not apart:
        many = few
    return np.linalg.qr(vectors[:, :many])[0], many > few


def is_definite(A: np.ndarray) -> bool:
    """Whether a symmetric matrix is positive definite; of 3,000 rows in a hundredth of the time of its eigenvalues."""
    try:
        np.linalg.cholesky(A)
    except np.linalg.LinAlgError:
        return False
    return True


def told_apart(vectors: np.ndarray) -> np.ndarray:
    """A basis (q, n) of the span of `vectors` (q, n), each with an entry 1 where the others have zeros."""
    from scipy.linalg import qr

    if not vectors.size:
        return vectors
    # the entries that tell the vectors apart best
    pivots = qr(vectors, mode="r", pivoting=True)[1][: len(vectors)]
    return np.linalg.solve(vectors[:, pivots], vectors)


def loads_beside(K: sparse.spmatrix, owner: np.ndarray) -> np.ndarray:
    """(j,) the largest entries of K (j, j), by which loads change, for the body of each motion, whose numbers `owner`
    has."""
    entries, most = K.tocoo(), np.zeros(K.shape[0])
    np.maximum.at(most, owner[entries.row], np.abs(entries.data))
    return most[owner]


def dead(vectors: np.ndarray, K: np.ndarray, loads: np.ndarray, errors: float) -> np.ndarray:
    """Of the span of `vectors` (j, q) the part along which loads do not change, by K (j, j), by more than the `errors` of
    normals, beside `loads_beside` (j,): by less the mass centre of a mesh is off its axis. Each with an entry 1 where the
    others have zeros."""
    vectors = told_apart(vectors.T).T
    sizes = loads @ np.abs(vectors)
    scaled = vectors / np.sqrt(np.where(sizes > 0.0, sizes, 1.0))
    _, values, turn = np.linalg.svd(scaled.T @ K @ scaled)
    if (values <= errors).all():
        return vectors
    return told_apart((scaled @ turn[values <= errors].T).T).T


def forwards(bodies: Sequence[MotionsOfBody], velocities: np.ndarray) -> float:
    """Whether the fastest body moves, or turns, along the axes (positive) or against them (negative)."""
    lead = int(np.argmax([body.speed(v) for body, v in zip(bodies, velocities, strict=True)]))
    v, d = velocities[lead], bodies[lead].dimension
    vector = v[:d] if _is_translation(bodies[lead], v) else v[d:]
    rounded = np.round(vector / np.linalg.norm(vector), 2)
    return rounded.sum() or rounded[rounded != 0.0][0]


def _way(members: list[MotionsOfBody], v: np.ndarray) -> str:
    """How bodies move that move as one, with the velocity v (n,) of the first of them."""
    first, d = members[0], members[0].dimension
    if _is_translation(first, v):
        return f"move along {direction(v[:d])}"
    nodes, size = (
        np.concatenate([body.outline for body in members]),
        min(body.size for body in members),
    )
    speeds = np.linalg.norm(first.at(v, nodes), axis=1)
    middle = (nodes.max(axis=0) + nodes.min(axis=0)) / 2
    turning, mean = v[d:], first.at(v, middle[None])[0]
    hub = first.pivot
    of_wheel = hub is not None and np.linalg.norm(first.at(v, hub[None])) <= SAME * speeds.max()
    if of_wheel or np.linalg.norm(mean) <= TURNS_ABOUT * speeds.max():
        # The axis comes nearest to the middle at ω × v / ω·ω from it.
        axis = middle + crossed(turning[None], mean[None])[0] / (turning @ turning)
        place = _place(hub if of_wheel and hub is not None else axis, size)
        return (
            f"turn {'counter' * bool(turning[0] > 0.0)}clockwise about {place}"
            if d == 2
            else f"turn about the axis through {place} along {direction(turning)}"
        )
    fastest = nodes[speeds >= (1.0 - SAME) * speeds.max()]
    at = (
        np.array(max(np.round(fastest / size, DIGITS).tolist())) * size
    )  # of nodes as fast always the same one
    return f"move most at {_place(at, size)}, along {direction(first.at(v, at[None])[0])}"


def _moving_as(
    lead: int, bodies: Sequence[MotionsOfBody], velocities: np.ndarray, least: float
) -> list[int]:
    """The bodies that move with the body `lead` as one, and itself; nodes may differ in velocity by `least`."""
    group = [lead]
    for k, body in enumerate(bodies):
        carried = np.append(
            bodies[lead].at(velocities[lead], body.centre[None])[0],
            velocities[lead][body.dimension :],
        )
        if k != lead and body.speed(velocities[k] - carried) <= least < body.speed(velocities[k]):
            group.append(k)
    return sorted(group)


def _is_translation(body: MotionsOfBody, v: np.ndarray) -> bool:
    """Whether the turning moves no node by more than `SAME` of the fastest one."""
    return bool(np.linalg.norm(v[body.dimension :]) * body.size <= SAME * body.speed(v))


def direction(v: np.ndarray) -> str:
    """The direction of a vector (d,) in words: x, -y, or (0.8, 0.6)."""
    rounded = np.round(v / np.linalg.norm(v), 2)
    (axes,) = np.nonzero(np.abs(rounded) >= SAME)
    if len(axes) == 1:
        return ("-" if rounded[axes[0]] < 0.0 else "") + "xyz"[axes[0]]
    return in_words(rounded)


def _place(x: np.ndarray, size: float) -> str:
    """The coordinates x (d,) to a tenth or hundredth of `size`."""
    return in_words(np.round(x, 1 - int(np.floor(np.log10(size)))), 10)


def _names(bodies: Sequence[MotionsOfBody], chosen: Sequence[int]) -> str:
    """The names of the `chosen` bodies; of more than three, the first and how many more."""
    names = [bodies[k].name for k in chosen]
    if len(names) > NAMED + 1:
        return f"{', '.join(names[:NAMED])} (and {len(names) - NAMED} more)"
    return " and ".join(filter(None, [", ".join(names[:-1]), names[-1]]))


def _hull(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Corners of the convex hull; places (k, d) in it with weights (k,), with which means of quadratic functions are
    exact. Nodes on a line, or on a plane in space, stand for themselves.

    A simplex has 1 / (d + 1)(d + 2) of its weight at each corner, and the rest at its centroid.
    """
    from scipy.spatial import ConvexHull, QhullError

    middle, d = points.mean(axis=0), points.shape[1]
    try:
        hull = ConvexHull((points - middle) / np.abs(points - middle).max())
    except QhullError:
        return points, points, np.full(len(points), 1.0 / len(points))
    facets = points[hull.simplices] - middle  # (f, d, d), each with the middle a simplex
    corners = np.concatenate([facets, np.zeros((len(facets), 1, d))], axis=1)
    measures = np.abs(np.linalg.det(facets))
    weights = np.concatenate([np.repeat(measures, d + 1) / (d + 1), (d + 1) * measures]) / (d + 2)
    places = np.concatenate([corners.reshape(-1, d), corners.mean(axis=1)])
    return points[hull.vertices], middle + places, weights / measures.sum()
