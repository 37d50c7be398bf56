"""Types of values: names, numbers with limits, affine functions of the coordinates, profiles along an interface,
histories over time."""

from __future__ import annotations

import sys
from typing import Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np

LARGEST = sys.float_info.max
"""Bounds numbers, because TOML has inf and nan, too."""

Number = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, msgspec.Meta(gt=0, le=LARGEST)]
NonNegative = Annotated[float, msgspec.Meta(ge=0, le=LARGEST)]
Count = Annotated[int, msgspec.Meta(ge=1)]
Point = tuple[Number, Number]

Group = Annotated[str, msgspec.Meta(min_length=1)]
"""Name of a boundary group of a mesh."""

Name = Annotated[str, msgspec.Meta(min_length=1, max_length=100, pattern=r"^[^.=/\s\x00-\x1f\x7f]*\Z")]
"""Name of a body or contact; it is a part of keys (``--set body.NAME.key=value``) and of file names."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A TOML table in which unknown keys are errors."""


AnyTable = TypeVar("AnyTable", bound=Table)


def settle(table: Table, kind: type[AnyTable], **values: Any) -> AnyTable:
    """`table` as a `kind`, its counterpart without optional keys, with `values` for what was left out."""
    return kind(**msgspec.structs.asdict(table) | values)


class AffineVector(Table, frozen=True, kw_only=True):
    """A vector that is linear in the coordinates: ``constant + x_slope * x + y_slope * y``."""

    constant: Point = (0.0, 0.0)
    x_slope: Point = (0.0, 0.0)
    y_slope: Point = (0.0, 0.0)


class AffineScalar(Table, frozen=True, kw_only=True):
    """A number that is linear in the coordinates: ``constant + x_slope * x + y_slope * y``."""

    constant: Number = 0.0
    x_slope: Number = 0.0
    y_slope: Number = 0.0


def evaluate(value: Any, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Evaluate a constant or affine scalar or vector at points.

    Parameters
    ----------
    value : float, pair of floats, AffineScalar or AffineVector
    x, y : arrays of the same shape (metres)

    Returns
    -------
    An array of that shape for a scalar, ``(2, *shape)`` for a vector; units of `value`.
    """
    if not isinstance(value, AffineVector | AffineScalar):
        value = AffineVector(constant=value) if isinstance(value, tuple) else AffineScalar(constant=value)
    terms = [np.multiply.outer(np.asarray(c), f) for c, f in
             ((value.constant, np.ones_like(x)), (value.x_slope, x), (value.y_slope, y))]
    return terms[0] + terms[1] + terms[2]


class Profile(Table, frozen=True, kw_only=True):
    """A number that varies along the interface, linear between points; a repeated point is a jump.

    ``along`` is a coordinate or the arc length from the first contact node; ``points`` are values of it in
    ascending order. Beyond its ends the profile is constant.
    """

    along: Literal["x", "y", "arc"] = "x"
    points: list[Number]
    values: list[NonNegative]

    def __post_init__(self) -> None:
        if len(self.points) != len(self.values) or not self.points:
            raise ValueError(f"points and values must be equally many, at least one; "
                             f"got {len(self.points)} points and {len(self.values)} values")
        if any(b < a for a, b in zip(self.points, self.points[1:], strict=False)):
            raise ValueError("points must ascend (a repeated point is a jump)")

    def position(self, xy: np.ndarray) -> np.ndarray:
        """Where on the profile (m,) the contact nodes `xy` (m, 2) lie, which are ordered along the interface."""
        if self.along == "arc":
            return np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
        return xy[:, "xy".index(self.along)]

    def at(self, xy: np.ndarray) -> np.ndarray:
        """Values (m,) at the contact nodes `xy` (m, 2)."""
        return np.interp(self.position(xy), self.points, self.values)


class History(Table, frozen=True, kw_only=True):
    """The factor of a load, clamp or rigid displacement over time: linear between ``times``, which ascend strictly.

    Before the first time and after the last one it is constant.
    """

    times: list[Number]
    factors: list[Number]

    def __post_init__(self) -> None:
        if len(self.times) != len(self.factors) or not self.times:
            raise ValueError(f"times and factors must be equally many, at least one; "
                             f"got {len(self.times)} times and {len(self.factors)} factors")
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("times must ascend strictly")

    def at(self, time: float) -> float:
        """The factor at `time`."""
        return float(np.interp(time, self.times, self.factors))

    @property
    def kinks(self) -> list[float]:
        """The times at which the factor changes its slope."""
        rise, run = np.diff(self.factors), np.diff(self.times)
        slopes = np.concatenate([[0.0], rise / run, [0.0]])
        return [time for time, before, after in zip(self.times, slopes, slopes[1:], strict=False) if before != after]


class SignedProfile(Profile, frozen=True, kw_only=True):
    """A profile whose values may be negative."""

    values: list[Number]
