"""Types of the method, the load steps and the output."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from typing import Annotated, Any, ClassVar, Literal

import msgspec
import numpy as np

from ddmpi.scene.values import (
    Count,
    Field,
    History,
    NonNegative,
    Number,
    Positive,
    Side,
    Table,
    settle,
)
from ddmpi.system.numbers import ALIKE

ALGEBRAIC = 0.01
"""Tolerance of the outer iteration as a part of ``target_error``."""

PRESETS: dict[str, dict[str, Any]] = {
    "fast": {"order": 1, "tolerance": 1e-4},
    "balanced": {"order": 2, "tolerance": 1e-6},
    "accurate": {"order": 2, "tolerance": 1e-8, "target_error": 0.01},
}
"""Values of keys that a scene leaves out, by ``method.preset``; measured in docs/understand/tradeoff.md."""

Elevation = Annotated[float, msgspec.Meta(ge=-90, le=90)]
Tolerance = Annotated[float, msgspec.Meta(gt=0, lt=1)]
Algorithm = Literal["original", "modified"]
Splitting = Literal["none", "step1", "step2", "step1+2"]
OuterName = Annotated[str, msgspec.Meta(pattern=r"^(newton|anderson|relaxation|[^\s:]+:[^\s:]+)\Z")]


class Method(Table, frozen=True, kw_only=True):
    """How the scene is solved, and how accurately; see docs/use/methods.md and docs/use/accuracy.md.

    Attributes
    ----------
    outer : "newton", without parameters to tune; for two supported bodies with one contact also "anderson", the
        published map, weighted by stiffness and accelerated, and "relaxation", the published iteration. Left out,
        "relaxation" where algorithm, splitting or theta is given, else "newton". A method of your own, "package.module:Class",
        is given by --set or in Python alone, see docs/use/methods.md
    algorithm : of the published iteration; left out, "original"
    splitting : of the published iteration, in which step Gauss-Seidel sweeps replace QPs; left out, "none"
    theta : relaxation of the published iteration; left out, 0.2
    tolerance : of the outer iteration: Newton's relative residual, the relative update of other methods; the residuals
        of the certificate must lie below 50 times it. Left out, 1e-8, in the published iteration 1e-4, with
        a preset the preset's, with target_error a hundredth of it (in the published iteration times theta), with both
        the smaller one
    max_iterations : most outer iterations of a load step
    target_error : estimated relative discretization error in the energy norm; meshes are refined until the estimate is
        safely below it
    max_unknowns : largest mesh for target_error
    preset : order, tolerance and target_error where they are left out, see below
    compliance : how C = B A⁻¹ Bᵀ of each body is applied: "explicit", a dense matrix; "direct", a solve for each
        multiplication; "iterative", the same by multigrid. Left out, sizes and free memory decide
    inner_precision : of the published iteration: inner solves are as precise as this times the last outer update, or
        with "fixed" always as precise as the last one needs
    """

    outer: OuterName | None = None
    algorithm: Algorithm | None = None
    splitting: Splitting | None = None
    theta: Positive | None = None
    tolerance: Tolerance | None = None
    max_iterations: Count = 500
    target_error: Annotated[float, msgspec.Meta(ge=1e-9, le=0.3)] | None = None
    max_unknowns: Count = 3_000_000
    preset: Literal["fast", "balanced", "accurate"] | None = None
    compliance: Literal["explicit", "direct", "iterative"] | None = None
    inner_precision: Annotated[float, msgspec.Meta(gt=0, le=1)] | Literal["fixed"] = 0.1

    def __post_init__(self) -> None:
        if self.outer not in (None, "relaxation") and self._published:
            raise ValueError(
                f"{', '.join(self._published)} belong{'s' * (len(self._published) == 1)} to outer = "
                f'"relaxation", not to "{self.outer}"'
            )

    @property
    def _published(self) -> list[str]:
        return [
            name for name in ("algorithm", "splitting", "theta") if getattr(self, name) is not None
        ]

    @property
    def _kind(self) -> str:
        return self.outer or ("relaxation" if self._published else "newton")

    @property
    def for_two(self) -> str:
        """The keys that choose a method of two bodies with one contact, for messages; empty for other methods."""
        if not method_of(self._kind).by_body:
            return ""
        return (
            f'outer = "{self.outer}"'
            if self.outer
            else f'{", ".join(self._published)} (outer = "relaxation")'
        )

    @property
    def outside(self) -> bool:
        """Whether it is a method from outside the package."""
        return self._kind not in METHODS

    @property
    def for_one(self) -> str:
        """The keys that choose a method of one load step, for messages; empty for other methods."""
        return self.for_two or (f'outer = "{self.outer}"' if self.outside else "")

    def settled(self, refinable: bool = True) -> SettledMethod:
        """The method with all defaults; a preset sets a ``target_error`` only if the meshes are `refinable`."""
        preset = PRESETS.get(self.preset or "", {})
        target = self.target_error or (preset.get("target_error") if refinable else None)
        published, theta = self._kind == "relaxation", self.theta or 0.2
        enough = ALGEBRAIC * target if target else None
        if enough and published:  # the remaining error is about the last update over theta
            enough *= min(theta, 1.0)
        tolerances = [value for value in (preset.get("tolerance"), enough) if value]
        values: dict[str, Any] = {
            "target_error": target,
            "tolerance": self.tolerance or min(tolerances, default=1e-4 if published else 1e-8),
        }
        if published:
            values |= {
                "algorithm": self.algorithm or "original",
                "splitting": self.splitting or "none",
                "theta": theta,
            }
        return settle(self, method_of(self._kind), outer=self._kind, **values)


class SettledMethod(Method, frozen=True, kw_only=True):
    """A method without optional keys, with its titles, labels and advice.

    None means: no ``target_error``; no ``preset``; a ``compliance`` chosen by the size of a body. ``algorithm``,
    ``splitting`` and ``theta`` are None but for `Published`.
    """

    outer: OuterName
    tolerance: Tolerance

    by_body: ClassVar[bool] = (
        True  # whether two supported bodies solve problems of their own, on a rank each
    )
    title: ClassVar[str]  # in logs and reports, with keys in braces
    curves: ClassVar[tuple[str, str]] = (
        "λ",
        "force mismatch  ‖s$_1$ − s$_2$‖ / ‖s‖",
    )  # of its history, in pictures
    criterion: ClassVar[Literal["update", "residual"]] = "update"  # what `tolerance` bounds
    diverging: ClassVar[str] = (
        "divergence, the contact displacement grew beyond all bounds"  # in words
    )

    @property
    def plan(self) -> str:
        """The method and its criterion, in words."""
        title = self.title.format_map(msgspec.structs.asdict(self))
        return f"{title}, {self.criterion} below {self.tolerance:g}"

    def advice(
        self, stopped: str, factor: float, iteration: int, update: float, able: Collection[str]
    ) -> str:
        """Advice where no answer is certified. `stopped` is the reason of `Outer.run`, `factor` the reduction of the
        criterion per iteration, nan if unknown; `iteration` and `update` are the last ones; `able` are the changes of
        `ddmpi.judge.diagnosis.fitting`. Empty where none fits."""
        return 'method.outer = "newton", the default'


class Newton(SettledMethod, frozen=True, kw_only=True):
    """The default, outer = "newton"."""

    by_body = False
    title = "semi-smooth Newton, GMRES with half-plane preconditioner"
    curves = "s", "contact equations"
    criterion = "residual"
    diverging = (
        "a residual that is not a number; a solve with the stiffness of a body must have failed"
    )

    def advice(
        self, stopped: str, factor: float, iteration: int, update: float, able: Collection[str]
    ) -> str:
        advice = {
            "iterations": "a larger method.max_iterations",
            "precision": "a run without -newton_ksp_rtol, which each step chooses by itself",
            "anderson": 'method.outer = "anderson"',
            "friction": "less friction, to see where the trouble begins",
            "mesh": "a finer mesh where few nodes bear",
        }
        return ", or ".join(words for name, words in advice.items() if name in able)


class Anderson(SettledMethod, frozen=True, kw_only=True):
    """The published map, weighted and accelerated, outer = "anderson"."""

    title = "Anderson acceleration of the published iteration"


class Published(SettledMethod, frozen=True, kw_only=True):
    """The published iteration, outer = "relaxation"."""

    algorithm: Algorithm
    splitting: Splitting
    theta: Positive

    title = "published iteration, {algorithm} algorithm, splitting {splitting}, theta = {theta:g}"

    def advice(
        self, stopped: str, factor: float, iteration: int, update: float, able: Collection[str]
    ) -> str:
        default = (
            'the default method, method.outer = "newton" without algorithm, splitting and theta'
        )
        if stopped == "diverged":
            return f"{default}; or a smaller method.theta than {self.theta:g}"
        if not factor < 0.98:
            return default
        wanted = iteration + 1.5 * max(math.log(self.tolerance / update) / math.log(factor), 1.0)
        return f"method.max_iterations of {wanted:.0f} or more; or {default}, which is faster"


METHODS: dict[str, type[SettledMethod]] = {
    "newton": Newton,
    "anderson": Anderson,
    "relaxation": Published,
}
"""The outer methods of the package by the name in ``method.outer``."""


class External(SettledMethod, frozen=True, kw_only=True):
    """A method from outside the package, outer = "package.module:Class"."""

    by_body = False
    title = "{outer}, not of ddmpi"
    curves = "s", "as the method says"
    diverging = "divergence, as the method says"


def method_of(outer: str) -> type[SettledMethod]:
    """The kind of a method by its name in ``method.outer``."""
    return METHODS.get(outer, External)


class Cycle(Table, frozen=True, kw_only=True, rename={"begin": "from"}):
    """A part of the load steps that is run again and again, as in ``cycle = { from = 1.5, to = 3.5, repeat = 500 }``.

    Later points shift by the time of the cycles run. Both ends of the cycle end legs, too.

    Attributes
    ----------
    from : time at which the cycle begins; all histories have the same factor there and at its end
    to : time at which it ends, at most the last of the points
    repeat : how many times it is run in all
    until : the cycles stop early when the forces at the end of one differ from those at its beginning by less than
        this times the largest; left out, all are run
    """

    begin: NonNegative
    to: Positive
    repeat: Annotated[int, msgspec.Meta(ge=1, le=10**6)]
    until: Tolerance | None = None

    def __post_init__(self) -> None:
        if self.begin >= self.to:
            raise ValueError(f"from: {self.begin:g} must be before to = {self.to:g}")

    @property
    def span(self) -> float:
        """The time that a cycle takes."""
        return self.to - self.begin

    def drawn(self, time: Any, run: int) -> Any:
        """The time in `points` of a `time`, or of an array of times, of a run with `run` cycles."""
        shifts = np.ceil(
            (time - self.to) / self.span - 1e-9
        )  # a time on an end belongs to the cycle before
        return time - np.clip(shifts, 0, max(run - 1, 0)) * self.span


class Time(Table, frozen=True, kw_only=True):
    """Load steps, in which friction has a memory; see docs/use/load_steps.md.

    Attributes
    ----------
    points : turning points of the loads, the ends of legs, as are kinks of histories; the first leg starts at time 0
    steps : load steps per leg
    tolerance : without steps, a leg is solved in 1, 2, 4, … load steps until the forces at its end change by less than
        this, relative to the forces; left out, 0.02
    cycle : a part that is run again and again
    motions : "far": bodies and rigid partners move as their motion says, and meet where they are; left out, "small"
    """

    points: Annotated[list[Number], msgspec.Meta(min_length=1)]
    steps: Annotated[int, msgspec.Meta(ge=1, le=10**6)] | None = None
    tolerance: Tolerance | None = None
    cycle: Cycle | None = None
    motions: Literal["small", "far"] | None = None

    def __post_init__(self) -> None:
        if self.points[0] <= 0.0:
            raise ValueError(
                f"points are ends of legs, the first of which starts at time 0; they must be positive, "
                f"got {self.points[0]:g}"
            )
        if any(b <= a for a, b in zip(self.points, self.points[1:], strict=False)):
            raise ValueError("points must ascend strictly")
        if self.steps is not None and self.tolerance is not None:
            raise ValueError(
                "steps and tolerance do not go together; leave steps out to have as many as tolerance "
                "asks for"
            )
        if self.cycle and self.cycle.to > self.points[-1]:
            raise ValueError(
                f"cycle: to = {self.cycle.to:g} is after the last of the points, {self.points[-1]:g}"
            )

    @property
    def cycle_ends(self) -> tuple[float, ...]:
        """The times at which a cycle begins and ends; none without one."""
        return (self.cycle.begin, self.cycle.to) if self.cycle else ()

    def check_cycle(self, histories: Mapping[str, History]) -> None:
        """Raise ValueError unless a cycle ends with the loads with which it begins."""
        for name, history in histories.items() if self.cycle else ():
            first, last = map(history.at, self.cycle_ends)
            if abs(first - last) > ALIKE * max(map(abs, history.factors)):
                begin, end = self.cycle_ends
                raise ValueError(
                    f"time.cycle: history.{name} has the factor {first:g} at from = {begin:g} and "
                    f"{last:g} at to = {end:g}; a cycle ends with the loads with which it begins"
                )

    def settled(self) -> Time:
        """The load steps, with a tolerance if no number of steps is given."""
        return settle(self, Time, tolerance=None if self.steps else self.tolerance or 0.02)


VIEWS = {
    "front": (-90.0, 0.0),
    "back": (90.0, 0.0),
    "left": (180.0, 0.0),
    "right": (0.0, 0.0),
    "top": (-90.0, 90.0),
    "bottom": (-90.0, -90.0),
    "iso": (-45.0, 35.264),
}
"""Views of solids by name: azimuth and elevation (degrees)."""


class Cut(Table, frozen=True, kw_only=True):
    """A plane at which pictures cut solids open, as in ``cut = { x = 0.5 }``, in coordinates before bodies move.

    Attributes
    ----------
    x, y, z : coordinate of the plane; exactly one of them
    """

    x: Number | None = None
    y: Number | None = None
    z: Number | None = None

    def __post_init__(self) -> None:
        if (self.x, self.y, self.z).count(None) != 2:
            raise ValueError("a cut has one of x, y and z, as in { x = 0.5 }")


class Output(Table, frozen=True, kw_only=True):
    """Fields and pictures that are written beside the tables; others are not computed.

    Attributes
    ----------
    only : "contacts": certificate, contacts, reactions and rigid partners alone, in tables and summary.json; no fields,
        stresses, pictures, estimate of the discretization error, nor warnings that need fields. Left out, all
    stress : stress and von Mises stress of the bodies
    error : field and picture of the estimated discretization error
    figures : pictures
    steps : load steps whose fields are written: ends of legs, or all
    animation : animation.gif plays the load steps with fields: von Mises stress or what it names
    length_unit, stress_unit : labels in pictures, summary and messages; numbers are in the scene's own units
    magnification : of displacements and gaps in bodies.png; left out, it suits the picture
    mirrored : bodies.png of an axisymmetric scene also shows the other half
    view : true for view.html, in which a browser turns the bodies; or the side from which pictures show solids: front,
        back (along y), left, right (x), bottom, top (z), iso, or [azimuth, elevation] in degrees, about z from x on
        and above the plane of x and y; left out, a corner that suits them
    cut : plane at which pictures cut solids open; left out, none
    derivatives : keys by which the answer is differentiated; see docs/use/derivatives.md
    """

    only: Literal["contacts"] | None = None
    stress: bool = True
    error: bool = False
    figures: bool = True
    steps: Literal["legs", "all"] = "legs"
    animation: bool | Field = False
    length_unit: str = "m"
    stress_unit: str = "Pa"
    magnification: Annotated[float, msgspec.Meta(gt=0.0, le=1e12)] | None = None
    mirrored: bool = False
    view: bool | Side | tuple[Number, Elevation] | None = None
    cut: Cut | None = None
    derivatives: list[str] = []

    def __post_init__(self) -> None:
        for key in ("error", "animation", "view"):
            if self.only and (
                getattr(self, key) is True or (key == "animation" and self.animation)
            ):
                raise ValueError(
                    f'{key} = true asks for what only = "{self.only}" leaves out; drop one of the two'
                )
        if not self.stress and str(self.animation).startswith(("von", "stress", "principal")):
            raise ValueError(
                f'animation = "{self.animation}" asks for stresses; drop stress = false'
            )


class Checkpoint(Table, frozen=True, kw_only=True):
    """Intervals at which the state of the run is written, apart from signals; see docs/use/restart.md.

    Attributes
    ----------
    seconds : least time between checkpoints (s); zero for never
    iterations : least number of outer iterations between checkpoints; zero for never
    """

    seconds: NonNegative = 600.0
    iterations: Annotated[int, msgspec.Meta(ge=0)] = 0


def units(scene: dict, dimension: int = 2) -> dict[str, str]:
    """Labels of lengths, stresses, forces, moments and energies; in the plane the last three are per unit of depth."""
    length, stress = scene["output"]["length_unit"], scene["output"]["stress_unit"]
    product = f"{stress}·{length}"
    if dimension == 3 or scene.get("axisymmetric"):
        named = {"Pa·m": ("N", "N·m", "J"), "MPa·mm": ("N", "N·mm", "mJ")}
        force, moment, energy = named.get(product, (f"{product}²", f"{product}³", f"{product}³"))
        return {
            "length": length,
            "stress": stress,
            "force": force,
            "moment": moment,
            "energy": energy,
        }
    force = {"Pa·m": "N/m", "MPa·mm": "N/mm"}.get(product, product)
    moment, energy = {"N/m": ("N·m/m", "J/m"), "N/mm": ("N·mm/mm", "mJ/mm")}.get(
        force, (f"{force}·{length}",) * 2
    )
    return {"length": length, "stress": stress, "force": force, "moment": moment, "energy": energy}
