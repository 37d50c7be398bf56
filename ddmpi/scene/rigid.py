"""Types of a rigid partner: a surface without mesh, material and rank, which bodies may touch."""

from __future__ import annotations

from ddmpi.scene.values import Name, Point, Positive, Table


class Plane(Table, frozen=True, kw_only=True, tag_field="shape", tag="plane"):
    """A straight surface through ``point``; its ``normal`` points towards the bodies and has any length."""

    name: Name
    point: Point
    normal: Point
    displacement: Point = (0.0, 0.0)
    history: Name | None = None

    def __post_init__(self) -> None:
        if self.normal == (0.0, 0.0):
            raise ValueError("normal must not be zero; it points towards the bodies")


class Circle(Table, frozen=True, kw_only=True, tag_field="shape", tag="circle"):
    """A disc that bodies touch from outside, or with ``inside = true`` a bore that they touch from inside."""

    name: Name
    center: Point
    radius: Positive
    inside: bool = False
    displacement: Point = (0.0, 0.0)
    history: Name | None = None


Rigid = Plane | Circle
