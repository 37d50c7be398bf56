"""Types of one body: mesh, material, clamps and loads."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec

from ddmpi.scene.values import (
    AffineScalar,
    AffineVector,
    Count,
    Formula,
    Group,
    Name,
    Number,
    Point,
    Positive,
    Table,
    Vector,
    check_formulas,
    settle,
)

SHAPES = {"rectangle": {"size": "[width, height]", "divisions": "[nx, ny]"},
          "quadrilateral": {"corners": "[[x, y], …]", "divisions": "[nx, ny]"},
          "annulus": {"center": "[x, y]", "radii": "[inner, outer]", "angles": "[start, end]",
                      "divisions": "[around, across]"}}
"""The keys that each shape needs, and how to write them. A rectangle may have an ``origin``, too."""

CORNER = 1e-8
"""Smallest sine of a corner of a quadrilateral; the triangles at a flatter one have almost no area."""

GEOMETRIES = (".geo", ".step", ".stp", ".brep", ".brp")
"""Endings of the files of geometries."""

TOWARDS_CONTACTS = 0.25
"""The size of elements at contacts as a part of ``size``, if a geometry has no ``contact_size``."""

CLOSED = 1e-9
"""How far from 360 the angle (degrees) of a closed ring may be, because of rounding."""

TwoOrOne = Annotated[tuple[Positive, ...], msgspec.Meta(min_length=2, max_length=2)] | Positive
"""A pair, or one number. Beside tuple[Positive, Positive], msgspec 0.22 crashes at such a number."""

Angle = Annotated[float, msgspec.Meta(ge=-720, le=720)]


class MeshSpec(Table, frozen=True, kw_only=True):
    """Either a generated ``shape`` with its keys and ``divisions``, a gmsh ``file``, or a ``geometry``.

    A rectangle has ``origin`` and ``size``, a convex quadrilateral four ``corners`` (counter-clockwise), an annulus
    ``center``, ``radii`` (inner, outer) and ``angles`` (start, end, in degrees; it is closed if they are 360 apart)
    with ``divisions`` around and across.
    A ``geometry`` (.geo, .step, .brep) is meshed by gmsh in the run: ``size`` is the largest size of an element (m),
    ``contact_size`` that along contacts, a quarter of it if left out. Smaller sizes in a .geo remain.
    ``order`` 1 means linear triangles; 2 means quadratic triangles, with a further node in the middle of each side.
    Their sides are curved along the circles of an annulus, along the curves of a geometry, and where those of a
    second-order file are. Left out, the order follows another body that names one, then the preset, then the files;
    otherwise it is 1.
    ``refine`` is how often the sides of a file's mesh are halved, or "as needed" for ``method.target_error``.
    """

    shape: Literal["rectangle", "quadrilateral", "annulus"] | None = None
    origin: Point = (0.0, 0.0)
    size: TwoOrOne | None = None
    corners: tuple[Point, Point, Point, Point] | None = None
    center: Point | None = None
    radii: tuple[Positive, Positive] | None = None
    angles: tuple[Angle, Angle] | None = None
    divisions: tuple[Count, Count] | None = None
    file: str | None = None
    geometry: str | None = None
    contact_size: Positive | None = None
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
            raise ValueError("refine belongs to a file; for a shape, raise divisions, for a geometry, lower size")
        if sum(each is not None for each in (self.shape, self.file, self.geometry)) != 1:
            raise ValueError('a mesh is either { file = "….msh" } or { geometry = "….geo", size = … } or has a shape, '
                             f'one of {", ".join(SHAPES)}, as in {{ shape = "rectangle", size = …, divisions = … }}')
        if self.origin != (0.0, 0.0) and self.shape != "rectangle":
            raise ValueError(f"origin belongs to a rectangle, not to {self._what}")
        if self.geometry is not None:
            self._check_sizes()
        elif self.contact_size is not None:
            raise ValueError(f"contact_size belongs to a geometry, not to {self._what}")
        self._check_keys(SHAPES.get(self.shape or "", {}))
        if self.shape == "rectangle" and not isinstance(self.size, tuple):
            raise ValueError(f"a rectangle has size = [width, height], got {self.size!r}")
        if self.corners:
            _check_corners(self.corners)
        if self.radii and self.angles and self.divisions:
            self._check_ring(self.radii, self.angles, self.divisions[0])

    @property
    def _what(self) -> str:
        return f'shape = "{self.shape}"' if self.shape else "a file" if self.file else "a geometry"

    @property
    def largest(self) -> float:
        """The largest size of an element of a geometry (m)."""
        assert isinstance(self.size, float)
        return self.size

    def _check_sizes(self) -> None:
        """Raise ValueError unless file and sizes are those of a geometry."""
        if not str(self.geometry).lower().endswith(GEOMETRIES):
            mesh = "; a mesh is given by file = …" * str(self.geometry).endswith(".msh")
            raise ValueError(f"geometry = {self.geometry!r} must end with one of {', '.join(GEOMETRIES)}{mesh}")
        if not isinstance(self.size, float):
            got = f", got {list(self.size)}" if self.size else ""
            raise ValueError(f"a geometry needs size = h, the largest size of an element{got}")
        if self.contact_size is not None and self.contact_size > self.size:
            raise ValueError(f"contact_size = {self.contact_size:g}, along contacts, must not exceed size = "
                             f"{self.size:g}, which is the largest")

    def _check_keys(self, needed: dict[str, str]) -> None:
        """Raise ValueError unless all the `needed` keys are given, and those of no other shape."""
        for shape, keys in SHAPES.items():
            for key in keys:
                if getattr(self, key) is None and key in needed:
                    how = ", ".join(f"{key} = {form}" for key, form in needed.items())
                    raise ValueError(f"{self._what} needs {how}; {key} is missing")
                if getattr(self, key) is not None and key not in needed and not (key == "size" and self.geometry):
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
    """A mesh of known order; a shape has no ``file`` and no keys of another shape, a file has neither.

    A geometry has all of its own keys.
    """

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


class PartMaterial(Material, frozen=True, kw_only=True):
    """The material of the physical surface ``on`` of a mesh file; without ``on``, that of all triangles left."""

    on: Group | None = None


class Clamp(Table, frozen=True, kw_only=True):
    """Prescribed displacement (m) on a boundary group or physical point; a component that is left out stays free.

    Where there is a ``history``, it is times the factor of that name in ``[history]``; so are loads.
    """

    on: Group
    x: Number | Formula | AffineScalar | None = None
    y: Number | Formula | AffineScalar | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        if self.x is None and self.y is None:
            raise ValueError(f'a clamp prescribes x, y or both; to fix both, write clamp = ["{self.on}"]')
        check_formulas("x", self.x)
        check_formulas("y", self.y)


class Traction(Table, frozen=True, kw_only=True):
    """Surface traction (Pa) on a boundary group: a ``value``, or a ``pressure`` along the inner normal."""

    on: Group
    value: Vector | AffineVector | None = None
    pressure: Number | Formula | AffineScalar | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        if (self.value is None) == (self.pressure is None):
            raise ValueError("a traction has either a value, as in value = [0.0, -6e7], or a pressure along the inner "
                             "normal, as in pressure = 1e6")
        check_formulas("value", self.value)
        check_formulas("pressure", self.pressure)

    @property
    def given(self) -> Vector | AffineVector | Number | Formula | AffineScalar:
        """The value or the pressure, whichever there is."""
        found = self.pressure if self.value is None else self.value
        assert found is not None
        return found


class VolumeForce(AffineVector, frozen=True, kw_only=True):
    """Force per volume (N/m³), either linear in the coordinates or a ``value``, which may follow a ``history``."""

    value: Vector | AffineVector | None = None
    history: Name | None = None

    def __post_init__(self) -> None:
        affine = (self.constant, self.x_slope, self.y_slope) != ((0.0, 0.0),) * 3
        if self.value is not None and affine:
            raise ValueError("value does not go with constant, x_slope and y_slope; write them into it, as in value = "
                             "{ constant = …, x_slope = … }")
        if self.value is None and self.history is not None:
            raise ValueError('a volume force with a history has a value: write { value = […], history = "…" }')
        check_formulas("value", self.value)


class BodySpec(Table, frozen=True, kw_only=True):
    """One elastic body."""

    name: Name
    mesh: MeshSpec
    material: Material | Annotated[list[PartMaterial], msgspec.Meta(min_length=1)]
    clamp: list[Group | Clamp] = []
    traction: list[Traction] = []
    volume_force: Vector | VolumeForce = (0.0, 0.0)

    def __post_init__(self) -> None:
        check_formulas("volume_force", self.volume_force)
        if isinstance(self.material, Material):
            return
        surfaces = [part.on for part in self.material]
        named = [on for on in surfaces if on is not None]
        for on in surfaces:
            if surfaces.count(on) > 1:
                raise ValueError(f"material: {surfaces.count(on)} entries are "
                                 + ("without on; one may leave it out, and has what the others leave" if on is None
                                    else f"on {on!r}; leave all but one of them out"))
        if named and self.mesh.shape:
            raise ValueError(f'material: on = "{named[0]}" names a physical surface of a mesh file, and a '
                             f'{self.mesh.shape} has none; leave on out, or make a body of each part and join them by '
                             'contacts with kind = "bonded"')
        if len({part.plane for part in self.material}) > 1:
            raise ValueError("material: entries are in plane strain, the default, and in plane stress; a body is in "
                             "one of them, so give all entries the same plane")

    @property
    def materials(self) -> Sequence[Material]:
        """All materials of the body."""
        return [self.material] if isinstance(self.material, Material) else self.material

    @property
    def plane(self) -> Literal["strain", "stress"]:
        """Whether the body is in plane strain or plane stress."""
        return self.materials[0].plane

    @property
    def plane_modulus(self) -> float:
        """E / (1 − ν²), or E in plane stress (Pa); of several materials the harmonic mean."""
        if isinstance(self.material, Material):
            return self.material.plane_modulus
        return len(self.material) / sum(1.0 / part.plane_modulus for part in self.material)

    @property
    def locking_ratio(self) -> float | None:
        """Poisson's ratio of a material in which linear triangles lock; None if there is none."""
        return max((material.poisson for material in self.materials if material.locks), default=None)

    @property
    def clamps(self) -> list[Clamp]:
        """All clamps in the long form; a bare group name fixes both components."""
        return [Clamp(on=c, x=0.0, y=0.0) if isinstance(c, str) else c for c in self.clamp]

    @property
    def weight(self) -> tuple[Vector | AffineVector, str | None]:
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
        mesh = self.mesh
        finest = mesh.contact_size or TOWARDS_CONTACTS * mesh.largest if mesh.geometry is not None else None
        return settle(self, SettledBody, mesh=settle(mesh, SettledMesh, order=order, contact_size=finest))


class SettledBody(BodySpec, frozen=True, kw_only=True):
    """One elastic body without optional keys."""

    mesh: SettledMesh

    @property
    def locking(self) -> str:
        """Why the discretization error of this body cannot be estimated; empty if it can."""
        return (f"{self.name}: no estimate: linear triangles lock at nu = {self.locking_ratio:g}; mesh.order = 2 "
                "would be right") if self.mesh.order == 1 and self.locking_ratio else ""
