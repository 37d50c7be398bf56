"""Types of values: names, numbers with limits, functions of the coordinates, profiles of contacts, histories."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

import msgspec
import numpy as np

LARGEST = 1e100
"""Largest number: squares and products of larger ones overflow. It also excludes TOML's inf and nan."""

Number = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, msgspec.Meta(gt=0, le=LARGEST)]
NonNegative = Annotated[float, msgspec.Meta(ge=0, le=LARGEST)]
Count = Annotated[int, msgspec.Meta(ge=1, le=10**12)]
Point = Annotated[tuple[Number, ...], msgspec.Meta(min_length=2, max_length=3)]
"""Coordinates or components: two in the plane, three in space."""

WHERE = {2: "in the plane", 3: "in space"}
"""By number of coordinates."""

Side = Literal["front", "back", "left", "right", "top", "bottom", "iso"]
Field = Literal[
    "von_mises",
    "displacement",
    "displacement_x",
    "displacement_y",
    "displacement_z",
    "stress_xx",
    "stress_yy",
    "stress_zz",
    "stress_xy",
    "stress_yz",
    "stress_xz",
    "principal_1",
    "principal_2",
    "principal_3",
    "pressure",
]
"""What an animation may show: fields of bodies by the names of a path's columns, or the pressure of contacts."""

Formula = Annotated[str, msgspec.Meta(min_length=1, max_length=1000)]
"""A number as a formula in the coordinates x, y and, in space, z, such as ``-6e7 * (1 + x/3)``."""

Vector = Annotated[tuple[Number | Formula, ...], msgspec.Meta(min_length=2, max_length=3)]

Group = Annotated[str, msgspec.Meta(min_length=1)]
"""Name of a boundary group of a mesh."""

if TYPE_CHECKING:
    On = str  # once a table is made: `joined`
else:
    On = (
        Group
        | Annotated[int, msgspec.Meta(ge=1)]
        | Annotated[
            tuple[Group | Annotated[int, msgspec.Meta(ge=1)], ...], msgspec.Meta(min_length=1)
        ]
    )
"""A group by name, a numbered curve or face of a drawing, or a list of these, which are one group together."""

Name = Annotated[
    str, msgspec.Meta(min_length=1, max_length=100, pattern=r"^[^.=/\s\x00-\x1f\x7f]*\Z")
]
"""Name of a body or contact; it is a part of keys (``--set body.NAME.key=value``) and of file names."""


def joined(on: Any) -> str:
    """The name of the group that a value of `On` means: "8+27" of [8, 27]. Meshes make it of its parts."""
    return "+".join(map(str, on)) if isinstance(on, tuple) else str(on)


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A TOML table in which unknown keys are errors."""


def tables(table: Table, key: str = "") -> Iterator[tuple[str, Table]]:
    """All tables within a table with their keys, entries of lists by their names."""
    for name in table.__struct_fields__:
        value = getattr(table, name)
        for number, entry in enumerate(value if isinstance(value, list) else [value]):
            if isinstance(entry, Table):
                called = getattr(entry, "called", getattr(entry, "name", number))
                path = f"{key}.{name}".lstrip(".") + f".{called}" * (entry is not value)
                yield path, entry
                yield from tables(entry, path)


def histories(table: Table) -> list[str]:
    """Names of the histories of all tables within a table, without repetition."""
    named = (getattr(entry, "history", None) for _, entry in tables(table))
    return list(dict.fromkeys(name for name in named if name is not None))


AnyTable = TypeVar("AnyTable", bound=Table)


def settle(table: Table, kind: type[AnyTable], **values: Any) -> AnyTable:
    """`table` as a `kind`, its counterpart without optional keys, with `values` for keys that were left out."""
    return kind(**msgspec.structs.asdict(table) | values)


class AffineVector(Table, frozen=True, kw_only=True):
    """A vector that is linear in the coordinates: ``constant + x_slope * x + y_slope * y + z_slope * z``.

    Attributes
    ----------
    constant : value at the origin; left out, zero
    x_slope, y_slope, z_slope : growth per unit of the coordinate; left out, none
    """

    constant: Point | None = None
    x_slope: Point | None = None
    y_slope: Point | None = None
    z_slope: Point | None = None


class AffineScalar(Table, frozen=True, kw_only=True):
    """A number that is linear in the coordinates: ``constant + x_slope * x + y_slope * y + z_slope * z``.

    Attributes
    ----------
    constant : value at the origin
    x_slope, y_slope, z_slope : growth per unit of the coordinate
    """

    constant: Number = 0.0
    x_slope: Number = 0.0
    y_slope: Number = 0.0
    z_slope: Number = 0.0


class VolumeForce(AffineVector, frozen=True, kw_only=True):
    """Force per volume (N/m³): linear in the coordinates, or a ``value``.

    Attributes
    ----------
    value : the force, in place of constant and slopes
    history : [history.NAME] whose factor multiplies the value
    """

    value: Vector | AffineVector | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        affine = (self.constant, self.x_slope, self.y_slope, self.z_slope) != (None,) * 4
        if self.value is not None and affine:
            raise ValueError(
                "value does not go with constant and slopes; write them into it, as in value = "
                "{ constant = …, x_slope = … }"
            )
        if self.value is None and self.history is not None:
            raise ValueError(
                'a volume force with a history has a value: write { value = […], history = "…" }'
            )


class Heat(Table, frozen=True, kw_only=True):
    """Temperature over the state free of stress, with a history.

    Attributes
    ----------
    value : temperature (K)
    history : [history.NAME] whose factor multiplies it
    """

    value: Number | Formula
    history: Name | None = None


class Profile(Table, frozen=True, kw_only=True):
    """A number that varies along the contact: linear between points, constant beyond the first and the last.

    With { along = "x", points = [0, 1, 1, 3], values = [0.1, 0.1, 0.3, 0.3] } it jumps from 0.1 to 0.3 at x = 1.

    The arc length is measured along the first body's boundary in `on`, from its start, with the body to the left:
    counterclockwise around a body, clockwise around a hole. Separate pieces of a boundary have separate starts. A
    closed boundary starts where its mesh does: at the angle where a ring begins, and in files and geometries where the
    first line of the group begins. Clamps and the choice of the slave make no difference: nodes of the second body have
    the arc length of the point that they face.

    Attributes
    ----------
    along : a coordinate, or in the plane the arc length along the first body's boundary
    points : values of it in ascending order; a repeated point is a jump
    values : the number at each point
    """

    along: Literal["x", "y", "z", "arc"] = "x"
    points: list[Number]
    values: list[NonNegative]

    def __post_init__(self) -> None:
        if len(self.points) != len(self.values) or not self.points:
            raise ValueError(
                f"points and values must be equally many, at least one; "
                f"got {len(self.points)} points and {len(self.values)} values"
            )
        if any(b < a for a, b in zip(self.points, self.points[1:], strict=False)):
            raise ValueError("points must ascend (a repeated point is a jump)")

    def position(self, xy: np.ndarray, arc: np.ndarray) -> np.ndarray:
        """Positions (m,) of the contact nodes `xy` (m, d) on the profile, with arc lengths `arc` (m,)."""
        return arc if self.along == "arc" else xy[:, "xyz".index(self.along)]

    def at(self, xy: np.ndarray, arc: np.ndarray) -> np.ndarray:
        """Values (m,) at the contact nodes `xy` (m, d) with arc lengths `arc` (m,)."""
        return np.interp(self.position(xy, arc), self.points, self.values)


class SignedProfile(Profile, frozen=True, kw_only=True):
    """A profile whose values may be negative.

    Attributes
    ----------
    values : the number at each point
    """

    values: list[Number]


class Gap(SignedProfile, frozen=True, kw_only=True):
    """An initial gap: a profile along the contact, or a ``value``, which may follow a history.

    Attributes
    ----------
    points, values : of the profile
    value : a number, a formula or a profile, in place of points and values
    history : [history.NAME] whose factor multiplies the value
    """

    points: list[Number] = []
    values: list[Number] = []
    value: Number | Formula | SignedProfile | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        if self.value is None:
            super().__post_init__()
        elif self.points or self.values:
            raise ValueError(
                "value does not go with points and values; write them into it, as in value = "
                "{ points = […], values = […] }"
            )
        if self.value is None and self.history is not None:
            raise ValueError('a gap with a history has a value: write { value = …, history = "…" }')


class Pretension(Table, frozen=True, kw_only=True):
    """The force of a bolt: it is given while its history goes on; after that the bond keeps its offset.

    Attributes
    ----------
    force : on the first body, along ``along`` (N, in the plane per unit of depth, around an axis of the whole
        circumference); positive pulls it towards where ``along`` points
    along : direction of the force and of the offset, of any length
    history : [history.NAME] whose factor multiplies the force until its last time, from which on the offset stays;
        left out, the force is given throughout
    """

    force: Number
    along: Point
    history: Name | None = None

    def __post_init__(self) -> None:
        if not any(self.along):
            raise ValueError(
                "along must not be zero; it is the direction in which the bond is pulled"
            )


class History(Table, frozen=True, kw_only=True):
    """The factor of loads, clamps and rigid displacements over time: linear between times, constant beyond them.

    Attributes
    ----------
    times : they ascend strictly
    factors : the factor at each time
    """

    times: list[Number]
    factors: list[Number]

    def __post_init__(self) -> None:
        if len(self.times) != len(self.factors) or not self.times:
            raise ValueError(
                f"times and factors must be equally many, at least one; "
                f"got {len(self.times)} times and {len(self.factors)} factors"
            )
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
        return [
            time
            for time, before, after in zip(self.times, slopes, slopes[1:], strict=False)
            if before != after
        ]
