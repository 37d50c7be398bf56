"""Types of values: names, numbers with limits, functions of the coordinates; and tables of them."""

from collections.abc import Iterator
from typing import TYPE_CHECKING, Annotated, Any, TypeVar

import msgspec

LARGEST = 1e100
"""Largest number: squares and products of larger ones overflow. It also excludes TOML's inf and nan."""

Number = Annotated[float, msgspec.Meta(ge=-LARGEST, le=LARGEST)]
Positive = Annotated[float, msgspec.Meta(gt=0, le=LARGEST)]
NonNegative = Annotated[float, msgspec.Meta(ge=0, le=LARGEST)]
Tolerance = Annotated[float, msgspec.Meta(gt=0, lt=1)]
Count = Annotated[int, msgspec.Meta(ge=1, le=10**12)]
Point = Annotated[tuple[Number, ...], msgspec.Meta(min_length=2, max_length=3)]
"""Coordinates or components: two in the plane, three in space."""

WHERE = {2: "in the plane", 3: "in space"}
"""By number of coordinates."""

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
"""A group by name, a curve or face of a drawing by number or by what it is (`mesh.forms`), or a list of these, which are
one group together."""

CONTROLS = (
    r"\x00-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069"  # of a screen, and those that turn words round
)

Name = Annotated[
    str, msgspec.Meta(min_length=1, max_length=100, pattern=rf"^[^.=/\s{CONTROLS}]*\Z")
]
"""Name of a body or contact; it is a part of keys (``--set body.NAME.key=value``) and of file names."""


def joined(on: Any) -> str:
    """The name of the group that a value of `On` means: "8+27" of [8, 27]. Meshes make it of its parts."""
    return "+".join(map(str, on)) if isinstance(on, tuple) else str(on)


Mistakes = Iterator[str]
"""What is wrong, a sentence each."""

Misplaced = Iterator[tuple[int, str, str]]
"""Of keys that belong to one dimension only: the dimension, the key, and the reason."""


def no_z(axisymmetric: bool) -> str:
    """Why a key has nothing to say beyond the plane."""
    return "nothing is twisted around the axis" if axisymmetric else "there is no z in the plane"


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A TOML table in which unknown keys are errors."""

    def of_one_dimension(self, axisymmetric: bool) -> Misplaced:
        """Those of its keys that belong to one dimension only."""
        if getattr(self, "z", None) is not None:
            yield 3, "z", no_z(axisymmetric)
        if getattr(self, "z_slope", None):
            yield 3, "z_slope", no_z(axisymmetric)


def tables(table: Table, key: str = "") -> Iterator[tuple[str, Table]]:
    """All tables within a table with their keys, entries of lists by their names."""
    for name in table.__struct_fields__:
        value = getattr(table, name)
        if not isinstance(value, list | Table):
            continue
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


Scalar = Number | Formula | AffineScalar
"""A number, or one that depends on the place."""
