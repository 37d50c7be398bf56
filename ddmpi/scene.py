"""The scene: bodies, materials, loads, contact and method, as frozen data read from TOML.

Validation is msgspec's; what is added here is that a message names the file, the key as a user
would write it after ``--set``, and what would have been right.
"""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from ddmpi.errors import InputError
from ddmpi.keys import explain, nearest, override

Positive = Annotated[float, msgspec.Meta(gt=0)]
NonNegative = Annotated[float, msgspec.Meta(ge=0)]
PositiveInt = Annotated[int, msgspec.Meta(ge=1)]
Name = Annotated[str, msgspec.Meta(min_length=1)]
Point = tuple[float, float]


class _Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A TOML table in which unknown keys are errors."""


class AffineVector(_Table, kw_only=True):
    """A vector that is linear in the coordinates: ``constant + x_slope * x + y_slope * y``."""

    constant: Point = (0.0, 0.0)
    x_slope: Point = (0.0, 0.0)
    y_slope: Point = (0.0, 0.0)


class AffineScalar(_Table, kw_only=True):
    """A number that is linear in the coordinates: ``constant + x_slope * x + y_slope * y``."""

    constant: float = 0.0
    x_slope: float = 0.0
    y_slope: float = 0.0


def evaluate(value: Any, x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """Evaluate a constant or affine scalar or vector at points.

    Parameters
    ----------
    value : float, pair of floats, AffineScalar or AffineVector
    x, y : arrays of one shape (metres)

    Returns
    -------
    Array of that shape for a scalar, ``(2, *shape)`` for a vector; units of `value`.
    """
    if not isinstance(value, AffineVector | AffineScalar):
        value = AffineVector(constant=value) if isinstance(value, tuple) else AffineScalar(constant=value)
    terms = [np.multiply.outer(np.asarray(c), f) for c, f in
             ((value.constant, np.ones_like(x)), (value.x_slope, x), (value.y_slope, y))]
    return sum(terms)


class Profile(_Table, kw_only=True):
    """A number that varies along the interface, linear between points; a repeated point is a jump.

    ``along`` is a coordinate or the arc length from the first contact node, ``points`` its values in
    ascending order. Beyond the ends the end values hold.
    """

    along: Literal["x", "y", "arc"] = "x"
    points: list[float]
    values: list[NonNegative]

    def __post_init__(self) -> None:
        if len(self.points) != len(self.values) or not self.points:
            raise ValueError(f"points and values must be equally many, at least one; "
                             f"got {len(self.points)} points and {len(self.values)} values")
        if any(b < a for a, b in zip(self.points, self.points[1:], strict=False)):
            raise ValueError("points must ascend (equal neighbours make a jump)")

    def at(self, xy: np.ndarray) -> np.ndarray:
        """Values (m,) at the contact nodes `xy` (m, 2), ordered along the interface, in metres."""
        if self.along == "arc":
            position = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
        else:
            position = xy[:, "xy".index(self.along)]
        return np.interp(position, self.points, self.values)


class MeshSpec(_Table, kw_only=True):
    """Either a generated shape (``shape, origin, size, divisions``) or a gmsh ``file``.

    ``order`` is that of the displacement: 1, linear triangles, or 2, straight-sided quadratic ones, with a
    further node on the middle of each side; left out, it is that of the other body, or that of the preset, or 1.
    ``refine`` is how often the sides of a file's mesh are halved, or "as needed" for ``method.target_error``.
    """

    shape: Literal["rectangle"] | None = None
    origin: Point = (0.0, 0.0)
    size: tuple[Positive, Positive] | None = None
    divisions: tuple[PositiveInt, PositiveInt] | None = None
    file: str | None = None
    order: Literal[1, 2] | None = None
    refine: Annotated[int, msgspec.Meta(ge=0, le=8)] | Literal["as needed"] = 0

    @property
    def halvings(self) -> int:
        return self.refine if isinstance(self.refine, int) else 0

    @property
    def refinable(self) -> bool:
        """Whether an accuracy target may make the mesh finer."""
        return self.file is None or self.refine == "as needed"

    def __post_init__(self) -> None:
        if self.file is None and self.refine:
            raise ValueError("refine belongs to a file; a shape has divisions")
        if (self.shape is None) == (self.file is None):
            raise ValueError('a mesh is either { shape = "rectangle", size = …, divisions = … } '
                             'or { file = "….msh" }')
        if self.shape is not None and (self.size is None or self.divisions is None):
            raise ValueError("a rectangle needs size = [width, height] and divisions = [nx, ny]")
        if self.file is not None and (self.size or self.divisions or self.origin != (0.0, 0.0)):
            raise ValueError("origin, size and divisions belong to a shape, not to a file")


LOCKING = 0.48
"""Poisson's ratio up to which estimates below 0.3 have been found right within a fifth for linear triangles."""


class Material(_Table, kw_only=True):
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
        """Whether linear triangles are so much too stiff for it that estimates of their error mean nothing."""
        return self.plane == "strain" and self.poisson > LOCKING

    @property
    def plane_modulus(self) -> float:
        """E / (1 − ν²) in plane strain, E in plane stress (Pa)."""
        return self.young / (1 - self.poisson**2) if self.plane == "strain" else self.young


class Clamp(_Table, kw_only=True):
    """Prescribed displacement (m) on a boundary group; a component that is left out stays free."""

    on: Name
    x: float | AffineScalar | None = None
    y: float | AffineScalar | None = None

    def __post_init__(self) -> None:
        if self.x is None and self.y is None:
            raise ValueError("a clamp prescribes x, y or both (write the bare group name to fix both)")


class Traction(_Table, kw_only=True):
    """Surface traction (Pa) on a boundary group."""

    on: Name
    value: Point | AffineVector


class BodySpec(_Table, kw_only=True):
    """One elastic body."""

    name: Annotated[str, msgspec.Meta(min_length=1, pattern=r"^[^.=]*$")]  # --set body.NAME.key=value
    mesh: MeshSpec
    material: Material
    clamp: list[Name | Clamp] = []
    traction: list[Traction] = []
    volume_force: Point | AffineVector = (0.0, 0.0)

    @property
    def clamps(self) -> list[Clamp]:
        """All clamps in the long form; a bare group name fixes both components."""
        return [Clamp(on=c, x=0.0, y=0.0) if isinstance(c, str) else c for c in self.clamp]


class Coulomb(_Table, kw_only=True, tag_field="law", tag="coulomb"):
    """Slip bound = coefficient × contact pressure."""

    coefficient: NonNegative | Profile


class Tresca(_Table, kw_only=True, tag_field="law", tag="tresca"):
    """Given slip bound (Pa), which holds at every contact node, open or not (as in the slides)."""

    slip_bound: NonNegative | Profile


class NoFriction(_Table, kw_only=True, tag_field="law", tag="none"):
    """Tangential unknowns do not exist."""


class ContactSpec(_Table, kw_only=True):
    """Two boundary groups that may touch; the first body takes role 1."""

    bodies: tuple[Name, Name]
    on: tuple[Name, Name]
    friction: Coulomb | Tresca | NoFriction = NoFriction()


ALGEBRAIC = 0.01
"""The tolerance of the iteration, as a part of the discretization error that is asked for."""

PRESETS = {"fast": {"order": 1, "tolerance": 1e-4},
           "balanced": {"order": 2, "tolerance": 1e-6},
           "accurate": {"order": 2, "tolerance": 1e-8, "target_error": 0.01}}
"""Values of keys that a scene leaves out, by ``method.preset``; measured in docs/tradeoff.md."""


class Method(_Table, kw_only=True):
    """How the iterations run; what is left out is chosen by `resolved`.

    ``outer`` is "newton" (the default, no parameter to tune), "anderson" (the published map, weighted by
    stiffness and accelerated), or "relaxation", the published iteration with fixed theta, which whoever
    names ``algorithm``, ``splitting`` or ``theta`` asks for. ``target_error`` is the estimated discretization
    error, relative in the energy norm, for which meshes are refined, up to ``max_unknowns``; at most 0.3, since
    estimates on coarser meshes mean little. ``preset`` is a name for all of this, see `PRESETS`.
    """

    outer: Literal["newton", "anderson", "relaxation"] | None = None
    algorithm: Literal["original", "modified"] | None = None
    splitting: Literal["none", "step1", "step2", "step1+2"] | None = None
    theta: Positive | None = None
    tolerance: Annotated[float, msgspec.Meta(gt=0, lt=1)] | None = None
    max_iterations: PositiveInt = 500
    target_error: Annotated[float, msgspec.Meta(gt=0, le=0.3)] | None = None
    max_unknowns: PositiveInt = 3_000_000
    preset: Literal["fast", "balanced", "accurate"] | None = None
    compliance: Literal["explicit", "direct", "iterative"] | None = None
    inner_precision: Annotated[float, msgspec.Meta(gt=0, le=1)] | Literal["fixed"] = 0.1

    def __post_init__(self) -> None:
        if self.outer not in (None, "relaxation") and self._published:
            raise ValueError(f'{", ".join(self._published)} belong to outer = "relaxation", not to "{self.outer}"')

    @property
    def _published(self) -> list[str]:
        return [name for name in ("algorithm", "splitting", "theta") if getattr(self, name) is not None]

    def resolved(self) -> Method:
        """With all that was left out filled in, but for what a preset says."""
        enough = ALGEBRAIC * self.target_error if self.target_error else None
        if self.outer != "relaxation" and not self._published:
            return msgspec.structs.replace(self, outer=self.outer or "newton",
                                           tolerance=self.tolerance or enough or 1e-8)
        theta = self.theta or 0.2  # the error that is left is about the last update over theta
        return msgspec.structs.replace(
            self, outer="relaxation", algorithm=self.algorithm or "original", splitting=self.splitting or "none",
            theta=theta, tolerance=self.tolerance or (min(theta, 1.0) * enough if enough else 1e-4))


class Output(_Table, kw_only=True):
    """What is written besides the interface: nothing is computed that nobody asked for.

    The units only label pictures, for scenes in MPa and mm, say: any consistent set gives the same.
    """

    stress: bool = True
    error: bool = False
    figures: bool = True
    length_unit: str = "m"
    stress_unit: str = "Pa"


class Checkpoint(_Table, kw_only=True):
    """When the state of the iteration is written besides at a signal; zero: never for this reason.

    ``seconds`` since the last time, ``iterations``: every so many.
    """

    seconds: NonNegative = 600.0
    iterations: Annotated[int, msgspec.Meta(ge=0)] = 0


class Scene(_Table, kw_only=True):
    """A whole scene; `resolved` gives it back as plain data with all defaults filled in."""

    title: str = ""
    body: list[BodySpec]
    contact: list[ContactSpec]
    method: Method = Method()
    output: Output = Output()
    checkpoint: Checkpoint = Checkpoint()
    petsc: dict[str, str | int | float | bool] = {}

    def __post_init__(self) -> None:
        names = [b.name for b in self.body]
        if len(names) != 2:
            raise ValueError(f"a scene has two [[body]] tables; got {len(names)}")
        if names[0] == names[1]:
            raise ValueError(f"the two bodies are both called {names[0]!r}; give them different names")
        if len(self.contact) != 1:
            raise ValueError(f"a scene has one [[contact]] table; got {len(self.contact)}")
        for name in self.contact[0].bodies:
            if name not in names:
                raise ValueError(f"contact.0.bodies names {name!r}, but the bodies are {', '.join(names)}"
                                 f"{nearest(name, names)}")
        if self.contact[0].bodies[0] == self.contact[0].bodies[1]:
            raise ValueError("contact.0.bodies names one body twice; contact is between two bodies")
        planes = {b.material.plane for b in self.body}
        if len(planes) > 1:
            raise ValueError("one body is in plane strain and the other in plane stress; they cannot touch")
        if len({b.mesh.order for b in self.body} - {None}) > 1:
            raise ValueError("the two bodies have mesh.order 1 and 2; forces at their common nodes would mean "
                             "different pressures, so give both the same")

    def settled(self) -> Scene:
        """With all that was left out filled in: what a preset says, and what follows from other keys.

        Raises ValueError where an accuracy is asked for that the elements named cannot be trusted with.
        """
        preset, method = PRESETS.get(self.method.preset, {}), self.method
        changes = {key: value for key, value in preset.items() if key != "order" and getattr(method, key) is None}
        if not all(b.mesh.refinable for b in self.body):
            changes.pop("target_error", None)  # a preset asks for what the meshes allow
        target = changes.get("target_error", method.target_error)
        if target and "tolerance" in changes:  # at least as tight as the target takes
            by_target = msgspec.structs.replace(method, target_error=target).resolved().tolerance
            changes["tolerance"] = min(changes["tolerance"], by_target)
        locking = [b for b in self.body if target and b.material.locks]
        named = next((b.mesh.order for b in self.body if b.mesh.order), None)
        if locking and named == 1:
            raise ValueError(f"body.{locking[0].name}: linear triangles lock at nu = {locking[0].material.poisson:g}; "
                             "estimates of their error cannot be trusted, and no method.target_error can be met; leave "
                             "mesh.order out or set it to 2")
        order = named or (2 if locking else preset.get("order", 1))
        body = [msgspec.structs.replace(b, mesh=msgspec.structs.replace(b.mesh, order=order)) for b in self.body]
        return msgspec.structs.replace(self, body=body, method=msgspec.structs.replace(method, **changes).resolved())

    def resolved(self) -> dict:
        return msgspec.to_builtins(self)


def read_scene(path: str, text: str, settings: list[str] = ()) -> Scene:
    """Build a scene from TOML text and ``KEY=VALUE`` overrides.

    Parameters
    ----------
    path : the file's name, for messages only
    text : its contents
    settings : as after ``--set``; applied in order, before validation

    Raises
    ------
    InputError
        naming file and key. Not collective: the same input raises the same error on every rank.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    for setting in settings:
        override(data, setting)
    try:
        scene = msgspec.convert(data, Scene)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {explain(str(error), data, Scene)}") from None
    _refuse_non_finite(path, scene.resolved())
    try:
        return scene.settled()
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def read_scene_file(path: str | Path, settings: list[str] = ()) -> Scene:
    """`read_scene` on a file. Not collective."""
    return read_scene(str(path), read_text(path), settings)


def read_text(path: str | Path) -> str:
    """The text of a scene file, or an InputError that names it."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8") from None


def _refuse_non_finite(path: str, value: Any, key: str = "") -> None:
    """TOML knows nan and inf; no key of a scene does."""
    if isinstance(value, dict):
        for name, entry in value.items():
            _refuse_non_finite(path, entry, f"{key}.{name}" if key else name)
    elif isinstance(value, list | tuple):
        for index, entry in enumerate(value):
            label = entry["name"] if isinstance(entry, dict) and "name" in entry else index
            _refuse_non_finite(path, entry, f"{key}.{label}")
    elif isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{path}: {key}: must be a finite number (got {value})")
