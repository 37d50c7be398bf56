"""Small helpers with numbers."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import NamedTuple

import numpy as np

ROUNDING, ALIKE, SAME = 1e-12, 1e-9, 1e-6
"""Relative differences up to which numbers are equal: results of the same computation; lengths, places and directions
of a mesh, which files round; and what a user draws or prescribes."""

SI = ("m", "Pa", "N/m", "N·m/m", "J/m", "N", "N·m", "J")
"""Units that take a prefix."""

PREFIXES = (
    (1e9, "G"),
    (1e6, "M"),
    (1e3, "k"),
    (1.0, ""),
    (1e-3, "m"),
    (1e-6, "µ"),
    (1e-9, "n"),
    (1e-12, "p"),
)


QUARTER = np.array([[0.0, 1.0], [-1.0, 0.0]])
"""Rows are turned by 90 degrees, counterclockwise."""


def norm(x: np.ndarray) -> float:
    """‖x‖₂ of a vector."""
    return math.sqrt(x @ x)


def divisor(sizes: np.ndarray) -> np.ndarray:
    """Sizes (…) to divide by: 1 where they are zero, as what they divide is zero, too, or does not count."""
    return np.where(sizes > 0.0, sizes, 1.0)


def counted(number: int, what: str) -> str:
    """A number of things in words: "1 rank", "2 ranks"."""
    return f"{number} {what}{'s' * (number != 1)}"


def without(values: np.ndarray, least: float) -> np.ndarray:
    """The values, zero where they are up to `least`."""
    return np.where(np.abs(values) <= least, 0.0, values)[()]  # no array without axes


def moment(at: np.ndarray, forces: np.ndarray, axisymmetric: bool = False) -> np.ndarray:
    """The moment about the origin, () or (3,), of forces (m, d) at places (m, d); around an axis they have none."""
    return np.ascontiguousarray(moments(at, forces, axisymmetric).T).sum(axis=-1)


def moments(at: np.ndarray, forces: np.ndarray, axisymmetric: bool = False) -> np.ndarray:
    """The `moment`, (m,) or (m, 3), of each force."""
    at = at * (not axisymmetric)
    return ((at @ QUARTER) * forces).sum(axis=1) if at.shape[1] == 2 else np.cross(at, forces)


def crossed(turning: np.ndarray, at: np.ndarray) -> np.ndarray:
    """ω × x (k, d) of rotations ω (k, 1 or 3) and places x (k, d)."""
    if at.shape[1] == 2:
        return turning * at[:, ::-1] * [-1.0, 1.0] + 0.0
    if turning.shape[1] == 1:  # about z
        turning = turning * [0.0, 0.0, 1.0]
    one, other = [1, 2, 0], [2, 0, 1]
    return turning[:, one] * at[:, other] - turning[:, other] * at[:, one]


class RigidMotion(NamedTuple):
    """A small rigid motion: the displacement (d,) of a pivot (m), and the turn about it (rad), one number in the plane
    and three in space; without a turn it is empty, and any point is the pivot."""

    displacement: np.ndarray
    turn: np.ndarray = np.empty(0)
    pivot: np.ndarray | float = 0.0

    def at(self, points: np.ndarray) -> np.ndarray:
        """The displacements (k, d) of points (k, d)."""
        moved = np.zeros_like(points) + self.displacement
        return moved + crossed(self.turn[None], points - self.pivot) if len(self.turn) else moved

    def undone(self, points: np.ndarray) -> np.ndarray:
        """The places (k, d) from which the motion takes something to `points` (k, d)."""
        if not len(self.turn):
            return points - self.displacement
        axes = np.eye(points.shape[1])
        # rows e_i + θ × e_i: (x − p) times them is x − p + θ × (x − p)
        return self.pivot + (points - self.displacement - self.pivot) @ np.linalg.inv(
            axes + crossed(self.turn[None], axes)
        )


class Frame(NamedTuple):
    """A rigid motion of any size, x ↦ shift + turned x: where something drawn at x is, or what a frame's axes are.

        >>> quarter = Frame.of((0.0, 0.0), 90.0, (1.0, 0.0))
        >>> quarter.at(np.array([[2.0, 0.0]])).round(12).tolist()
        [[1.0, 1.0]]

    Attributes
    ----------
    shift : (d,) where the origin goes (m)
    turned : (d, d) rotation
    angle : in the plane that of the rotation (degrees), of several turns the sum
    """

    shift: np.ndarray
    turned: np.ndarray
    angle: float = 0.0

    @classmethod
    def of(
        cls,
        shift: Sequence[float] | np.ndarray,
        turn: float | np.ndarray = 0.0,
        pivot: Sequence[float] | np.ndarray | None = None,
    ) -> Frame:
        """A turn about a pivot (m), and then a shift (m). The turn is in degrees, counterclockwise; in space it is a
        vector (3,), along its axis."""
        about, turn = (
            np.zeros(len(shift)) if pivot is None else np.array(pivot, float),
            np.atleast_1d(turn),
        )
        angle = float(turn[0]) if len(turn) == 1 else norm(turn)
        # multiples of 90° without rounding
        sine, cosine = (
            math.sin(math.radians(part))
            if part % 90.0
            else float(np.sin(np.pi / 180.0 * part).round())
            for part in (angle, angle + 90.0)
        )
        turned = np.eye(len(shift))
        if angle:
            # Rodrigues: x ↦ cos φ x + sin φ k × x + (1 − cos φ) k (k·x) with the unit vector k of the axis
            axis = turn / angle if len(turn) == 3 else np.ones(1)
            turned = cosine * turned + sine * crossed(axis[None], turned).T
            turned += (1.0 - cosine) * np.outer(axis, axis) if len(axis) == 3 else 0.0
        return cls(about + shift - turned @ about, turned, angle if len(turn) == 1 else 0.0)

    @property
    def turn(self) -> np.ndarray:
        """Its turn in degrees (1,), in space (3,) along its axis, by at most 180."""
        if len(self.shift) == 2:
            return np.array([self.angle])
        from scipy.spatial.transform import Rotation

        return Rotation.from_matrix(self.turned).as_rotvec(degrees=True)

    def at(self, points: np.ndarray) -> np.ndarray:
        """The places (…, d) of points (…, d)."""
        return self.shift + points @ self.turned.T

    def along(self, vectors: np.ndarray) -> np.ndarray:
        """Vectors (…, d), turned with it."""
        return vectors @ self.turned.T

    def after(self, other: Frame) -> Frame:
        """This motion after another one."""
        return Frame(self.at(other.shift), self.turned @ other.turned, self.angle + other.angle)

    @property
    def undone(self) -> Frame:
        """The inverse."""
        return Frame(-self.shift @ self.turned, self.turned.T, -self.angle)


def in_words(point: np.ndarray, digits: int = 6) -> str:
    """A point (d,) in words, such as (1.5, 2); coordinates that are rounding beside the largest are 0."""
    least = ROUNDING * np.abs(point).max(initial=0.0)
    return f"({', '.join(f'{0.0 if abs(x) <= least else x:.{digits}g}' for x in point)})"


def with_error(value: float, bar: float) -> str:
    """A value and the half width of its interval: "3.51e+04 ± 4e+02", "162.0 ± 1.3". The bar is rounded up, to its first
    digit, or to two where that is 1, and the value to the same place."""
    if not bar:
        return f"{value:.6g} ± 0"
    last = math.floor(math.log10(bar / 2.0))
    up, places = math.ceil(bar / 10.0**last) * 10.0**last, max(-last, 0)
    if 1e-3 <= max(abs(value), up) < 1e4:
        return f"{round(value, -last) + 0.0:.{places}f} ± {up:.{places}f}"
    digits = math.floor(math.log10(abs(value))) - last + 1 if value else 1
    return f"{value:.{min(max(digits, 1), 12)}g} ± {up:.2g}"


def place_of_largest(values: np.ndarray, places: np.ndarray) -> np.ndarray | None:
    """The place (d,) in `places` (n, d) where a value (n,) is largest; None where none is positive or negative.

    Of values that are equal but for rounding, or for the end of an iteration (`SAME`), it is that of the smallest x,
    of these that of the smallest y and so on: an order of bodies, nodes or ranks does not matter, nor the last bit.

        >>> place_of_largest(np.array([1.0, 3.0, 3.0]), np.array([[0.0, 0.0], [2.0, 1.0], [1.0, 5.0]])).tolist()
        [1.0, 5.0]
    """
    values, places = np.asarray(values, float), np.asarray(places, float)
    finite = np.isfinite(values)
    if not finite.any() or not values[finite].any():
        return None
    largest = values[finite].max()
    best = places[finite & (values >= largest - SAME * abs(largest))]
    near = ALIKE * np.abs(places).max()
    for axis in range(places.shape[1]):
        best = best[best[:, axis] <= best[:, axis].min() + near]
    return without(best[0], ROUNDING * float(np.abs(places).max()))


def scaled_unit(value: float, unit: str) -> tuple[float, str]:
    """A factor and a unit with a prefix in which `value` is easy to read. Units beside SI and % stay as they are."""
    if unit == "%":
        return 0.01, unit
    if unit not in SI or not value or not np.isfinite(value):
        return 1.0, unit
    factor, prefix = next(((f, p) for f, p in PREFIXES if value >= f), (1.0, ""))
    return factor, prefix + unit


def concatenated(arrays: Iterable[np.ndarray], kind: type = float) -> np.ndarray:
    """Vectors one after the other; an empty one of this kind where there are none."""
    return np.concatenate([np.empty(0, kind), *arrays])


def spans(start: np.ndarray, stop: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The members of ranges from `start` to `stop` (s,): the number of their range, and the members themselves."""
    count = np.maximum(stop - start, 0)
    owner = np.repeat(np.arange(len(count)), count)
    return owner, np.arange(len(owner)) + np.repeat(start - np.cumsum(count) + count, count)


def together(one: np.ndarray, other: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs of places of equal numbers in `one` (q,) and the sorted `other` (p,), in the order of `one`.

    >>> [places.tolist() for places in together(np.array([7, 5]), np.array([5, 5, 7]))]
    [[0, 1, 1], [2, 0, 1]]
    """
    return spans(np.searchsorted(other, one), np.searchsorted(other, one, "right"))


def bisect(points: np.ndarray, parts: int) -> np.ndarray:
    """The parts (k,) of `points` (k, d) by recursive bisection along the longest extent. Not collective.

    Sizes of parts differ by at most one point per bisection, and depend on the points alone.
    """
    part = np.zeros(len(points), np.int64)
    if parts > 1 and len(points):
        axis = int(np.ptp(points, axis=0).argmax())
        order = np.lexsort((*np.delete(points, axis, axis=1).T, points[:, axis]))
        first, second = np.split(order, [len(points) * (parts // 2) // parts])
        part[first] = bisect(points[first], parts // 2)
        part[second] = parts // 2 + bisect(points[second], parts - parts // 2)
    return part


def nearest_in(points: np.ndarray, simplices: np.ndarray) -> np.ndarray:
    """The nearest places (k, d) in simplices (k, j, d) of any dimension to points (k, d), or to one point."""
    points = np.broadcast_to(points, simplices[:, 0].shape)
    aside, part = across(points - simplices[:, 0], simplices)
    places, beside = points - aside, (part < 0.0).any(axis=1) | (part.sum(axis=1) > 1.0)
    # Outside of the simplex the nearest place is on one of its facets, simplices of one dimension less.
    if beside.any():
        sides = np.stack(
            [
                nearest_in(points[beside], np.delete(simplices[beside], k, axis=1))
                for k in range(simplices.shape[1])
            ]
        )
        nearest = np.argmin(np.linalg.norm(sides - points[beside], axis=2), axis=0)
        places[beside] = sides[nearest, np.arange(len(nearest))]
    return places


def is_touched(free: np.ndarray) -> np.ndarray:
    """Which (k,) of the projections (k, d, d) onto free directions are not the identity: nodes with clamps."""
    return (free != np.eye(free.shape[1])).any(axis=(1, 2))


def across(v: np.ndarray, simplices: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The parts of vectors (k, d) orthogonal to simplices (k, j, d), and the coordinates (k, j − 1) of the rest."""
    along = simplices[:, 1:] - simplices[:, :1]
    metric = np.einsum("kid,kjd->kij", along, along) + np.finfo(float).tiny * np.eye(along.shape[1])
    part = np.linalg.solve(metric, np.einsum("kid,kd->ki", along, v)[:, :, None])[:, :, 0]
    return v - np.einsum("ki,kid->kd", part, along), part
