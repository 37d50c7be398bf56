"""Types of the method: how a scene is solved, and how accurately."""

from __future__ import annotations

import math
from collections.abc import Collection
from typing import Annotated, Any, ClassVar, Literal

import msgspec

from ddmpi.scene.values import Count, Positive, Table, Tolerance, settle

ALGEBRAIC = 0.01
"""Tolerance of the outer iteration as a part of ``target_error``."""

PRESETS: dict[str, dict[str, Any]] = {
    "fast": {"order": 1, "tolerance": 1e-4},
    "balanced": {"order": 2, "tolerance": 1e-6},
    "accurate": {"order": 2, "tolerance": 1e-8, "target_error": 0.01},
}
"""Values of keys that a scene leaves out, by ``method.preset``; measured in docs/understand/tradeoff.md."""

Algorithm = Literal["original", "modified"]
Splitting = Literal["none", "step1", "step2", "step1+2"]
OuterName = Annotated[str, msgspec.Meta(pattern=r"^(newton|anderson|relaxation|[^\s:]+:[^\s:]+)\Z")]


class Within(Table, frozen=True, kw_only=True):
    """A target in the unit of the result, as in ``{ within = 3.0 }``.

    Attributes
    ----------
    within : largest error bar, in the unit of the result
    """

    within: Positive


Target = Annotated[float, msgspec.Meta(ge=1e-5, le=1.0)] | Within
"""Largest error bar of a result, over its value or in its unit."""


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
        a preset the preset's, with target_error a hundredth of it (in the published iteration times theta), also of
        targets that are parts of values, with several of these the smallest one
    max_iterations : most outer iterations of a load step
    target_error : estimated relative discretization error in the energy norm; meshes are refined until the estimate is
        safely below it
    target : largest error bars of results, over the value or in its unit, as in { "contacts.fit.normal_force" = 0.01,
        "bodies.shaft.reaction.y" = { within = 3.0 } }; meshes are refined where these results have their errors until
        all bars are within. The results are those of output.errors, and are told with them
    max_unknowns : largest mesh for target_error and target
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
    target: dict[str, Target] = {}
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
        published = self._kind == "relaxation"
        theta = self.theta or 0.2
        # of the published iteration the remaining error is about the last update over theta
        part = ALGEBRAIC * (min(theta, 1.0) if published else 1.0)
        relative = [one for one in (target, *self.target.values()) if isinstance(one, float)]
        tolerances = [part * one for one in relative]
        if preset:
            tolerances.append(preset["tolerance"])
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

    @property
    def aimed(self) -> str:
        """The key of an accuracy target, for messages; empty without one."""
        return "target_error" if self.target_error else "target" * bool(self.target)

    by_body: ClassVar[bool] = (
        True  # whether two supported bodies solve problems of their own, on a rank each
    )
    title: ClassVar[str]  # in logs and reports, with keys in braces
    # Of the history, in pictures.
    curves: ClassVar[tuple[str, str]] = (
        "λ",
        "force mismatch  ‖s$_1$ − s$_2$‖ / ‖s‖",
    )
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
