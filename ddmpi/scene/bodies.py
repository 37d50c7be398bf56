"""Types of one body: mesh, material, clamps and loads."""

from __future__ import annotations

import math
from typing import Annotated, Literal

import msgspec

from ddmpi.scene.values import AffineScalar, AffineVector, Count, Group, Name, Number, Point, Positive, Table, settle

SHAPES = {"rectangle": {"size": "[width, height]", "divisions": "[nx, ny]"},
          "quadrilateral": {"corners": "[[x, y], …]", "divisions": "[nx, ny]"},
          "annulus": {"center": "[x, y]", "radii": "[inner, outer]", "angles": "[start, end]",
                      "divisions": "[around, across]"}}
"""The keys that each shape needs, and how to write them. A rectangle may have an ``origin``, too."""

CORNER = 1e-8
"""Smallest sine of a corner of a quadrilateral; the triangles at a flatter one have almost no area."""

CLOSED = 1e-9
"""How far from 360 the angle (degrees) of a closed ring may be, because of rounding."""

Angle = Annotated[float, msgspec.Meta(ge=-720, le=720)]


class MeshSpec(Table, frozen=True, kw_only=True):
    """Either a generated ``shape`` with its keys and ``divisions``, or a gmsh ``file``.

    A rectangle has ``origin`` and ``size``, a convex quadrilateral four ``corners`` (counter-clockwise), an annulus
    ``center``, ``radii`` (inner, outer) and ``angles`` (start, end, in degrees; it is closed if they are 360 apart)
    with ``divisions`` around and across.
    ``order`` 1 means linear triangles; 2 means straight-sided quadratic triangles, with a further node in the
    middle of each side. Left out, the order follows another body that names one, then the preset, then the files;
    otherwise it is 1.
    ``refine`` is how often the sides of a file's mesh are halved, or "as needed" for ``method.target_error``.
    """

    shape: Literal["rectangle", "quadrilateral", "annulus"] | None = None
    origin: Point = (0.0, 0.0)
    size: tuple[Positive, Positive] | None = None
    corners: tuple[Point, Point, Point, Point] | None = None
    center: Point | None = None
    radii: tuple[Positive, Positive] | None = None
    angles: tuple[Angle, Angle] | None = None
    divisions: tuple[Count, Count] | None = None
    file: str | None = None
    order: Literal[1, 2] | None = None
    refine: Annotated[int, msgspec.Meta(ge=0, le=8)] | Literal["as needed"] = 0

    @property
    def halvings(self) -> int:
        """How often the sides of the file's mesh are halved."""
        return self.refine if isinstance(self.refine, int) else 0

    @property
    def refinable(self) -> bool:
        """Whether an accuracy target may make the mesh finer."""
        return self.file is None or self.refine == "as needed"

    @property
    def closed(self) -> bool:
        """Whether an annulus is a whole ring, without start and end."""
        return self.angles is not None and abs(self.angles[1] - self.angles[0] - 360) <= CLOSED

    def __post_init__(self) -> None:
        if self.file is None and self.refine:
            raise ValueError("refine belongs to a file; for a shape, raise divisions")
        if (self.shape is None) == (self.file is None):
            raise ValueError(f'a mesh is either {{ file = "….msh" }} or has a shape, one of {", ".join(SHAPES)}, as in '
                             '{ shape = "rectangle", size = …, divisions = … }')
        if self.origin != (0.0, 0.0) and self.shape != "rectangle":
            raise ValueError(f"origin belongs to a rectangle, not to {self._what}")
        self._check_keys(SHAPES.get(self.shape or "", {}))
        if self.corners:
            _check_corners(self.corners)
        if self.radii and self.angles and self.divisions:
            self._check_ring(self.radii, self.angles, self.divisions[0])

    @property
    def _what(self) -> str:
        return "a file" if self.shape is None else f'shape = "{self.shape}"'

    def _check_keys(self, needed: dict[str, str]) -> None:
        """Raise ValueError unless all the `needed` keys are given, and those of no other shape."""
        for shape, keys in SHAPES.items():
            for key in keys:
                if getattr(self, key) is None and key in needed:
                    how = ", ".join(f"{key} = {form}" for key, form in needed.items())
                    raise ValueError(f"{self._what} needs {how}; {key} is missing")
                if getattr(self, key) is not None and key not in needed:
                    owner = "a shape" if key == "divisions" else f'shape = "{shape}"'
                    raise ValueError(f"{key} belongs to {owner}, not to {self._what}")

    def _check_ring(self, radii: tuple[float, float], angles: tuple[float, float], around: int) -> None:
        if radii[0] >= radii[1]:
            raise ValueError(f"radii = [inner, outer] must ascend, got [{radii[0]:g}, {radii[1]:g}]")
        span = angles[1] - angles[0]
        if not 0 < span <= 360 + CLOSED:
            raise ValueError(f"angles = [start, end] must ascend by at most 360 degrees, which make a whole ring; got "
                             f"[{angles[0]:g}, {angles[1]:g}]")
        if span / around >= 180:
            raise ValueError(f"divisions = [around, across]: {around} around make cells of {span / around:g} degrees; "
                             "they must be less than 180")


def _check_corners(corners: tuple[Point, ...]) -> None:
    """Raise ValueError unless the corners are those of a convex quadrilateral, counter-clockwise."""
    sides = [(b[0] - a[0], b[1] - a[1]) for a, b in zip(corners, corners[1:] + corners[:1], strict=True)]
    units = [(x / length, y / length) if (length := math.hypot(x, y)) else (0.0, 0.0) for x, y in sides]
    sines = [a[0] * b[1] - a[1] * b[0] for a, b in zip(units, units[1:] + units[:1], strict=True)]
    if all(sine < -CORNER for sine in sines):
        turned = ", ".join(f"[{x!r}, {y!r}]" for x, y in (corners[0], *corners[:0:-1]))
        raise ValueError(f"corners run clockwise; write them counter-clockwise, as in corners = [{turned}]")
    if not all(sine > CORNER for sine in sines):
        raise ValueError("corners must be those of a convex quadrilateral in their order along its boundary, without "
                         "corners of 0 or 180 degrees")


class SettledMesh(MeshSpec, frozen=True, kw_only=True):
    """A mesh of known order; a shape has no ``file`` and no keys of another shape, a file has neither."""

    order: Literal[1, 2]


LOCKING = 0.48
"""Largest Poisson's ratio at which the error estimate of linear triangles can be trusted: measured values below 0.3
are right to within a fifth."""


class Material(Table, frozen=True, kw_only=True):
    """Isotropic linear elasticity; ``young`` in Pa."""

    young: Positive
    poisson: Annotated[float, msgspec.Meta(gt=-1, lt=0.5)]
    plane: Literal["strain", "stress"] = "strain"

    @property
    def lame(self) -> tuple[float, float]:
        """First Lamé constant and shear modulus (Pa) of the plane problem."""
        E, nu = self.young, self.poisson
        shear = E / (2 * (1 + nu))
        first = E * nu / ((1 + nu) * (1 - 2 * nu))
        if self.plane == "stress":
            first = E * nu / (1 - nu**2)
        return first, shear

    @property
    def locks(self) -> bool:
        """Whether linear triangles are so much too stiff for this material that error estimates mean nothing."""
        return self.plane == "strain" and self.poisson > LOCKING

    @property
    def plane_modulus(self) -> float:
        """E / (1 − ν²) in plane strain, E in plane stress (Pa)."""
        return self.young / (1 - self.poisson**2) if self.plane == "strain" else self.young


class Clamp(Table, frozen=True, kw_only=True):
    """Prescribed displacement (m) on a boundary group; a component that is left out stays free.

    Where there is a ``history``, it is times the factor of that name in ``[history]``; so are loads.
    """

    on: Group
    x: Number | AffineScalar | None = None
    y: Number | AffineScalar | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        if self.x is None and self.y is None:
            raise ValueError(f'a clamp prescribes x, y or both; to fix both, write clamp = ["{self.on}"]')


class Traction(Table, frozen=True, kw_only=True):
    """Surface traction (Pa) on a boundary group."""

    on: Group
    value: Point | AffineVector
    history: Name | None = None


class VolumeForce(AffineVector, frozen=True, kw_only=True):
    """Force per volume (N/m³), either linear in the coordinates or a ``value``, which may follow a ``history``."""

    value: Point | AffineVector | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        affine = (self.constant, self.x_slope, self.y_slope) != ((0.0, 0.0),) * 3
        if self.value is not None and affine:
            raise ValueError("value does not go with constant, x_slope and y_slope; write them into it, as in value = "
                             "{ constant = …, x_slope = … }")
        if self.value is None and self.history is not None:
            raise ValueError('a volume force with a history has a value: write { value = […], history = "…" }')


class BodySpec(Table, frozen=True, kw_only=True):
    """One elastic body."""

    name: Name
    mesh: MeshSpec
    material: Material
    clamp: list[Group | Clamp] = []
    traction: list[Traction] = []
    volume_force: Point | VolumeForce = (0.0, 0.0)

    @property
    def clamps(self) -> list[Clamp]:
        """All clamps in the long form; a bare group name fixes both components."""
        return [Clamp(on=c, x=0.0, y=0.0) if isinstance(c, str) else c for c in self.clamp]

    @property
    def weight(self) -> tuple[Point | AffineVector, str | None]:
        """The volume force (N/m³), and the history that it follows."""
        force = self.volume_force
        if isinstance(force, VolumeForce) and force.value is not None:
            return force.value, force.history
        return force, None

    @property
    def histories(self) -> list[str]:
        """Names of the histories that its loads and clamps follow, each once."""
        named = [*(clamp.history for clamp in self.clamps), *(load.history for load in self.traction), self.weight[1]]
        return list(dict.fromkeys(name for name in named if name is not None))

    def settled(self, order: Literal[1, 2]) -> SettledBody:
        """This body with elements of `order`."""
        return settle(self, SettledBody, mesh=settle(self.mesh, SettledMesh, order=order))


class SettledBody(BodySpec, frozen=True, kw_only=True):
    """One elastic body without optional keys."""

    mesh: SettledMesh

    @property
    def locking(self) -> str:
        """Why the discretization error of this body cannot be estimated; empty if it can."""
        return (f"{self.name}: no estimate: linear triangles lock at nu = {self.material.poisson:g}; mesh.order = 2 "
                "would be right") if self.mesh.order == 1 and self.material.locks else ""
