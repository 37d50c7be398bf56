"""Types of how a scene is solved and what is written."""

from __future__ import annotations

from typing import Annotated, Literal

import msgspec

from ddmpi.scene.values import NonNegative, Positive, PositiveInt, Table

ALGEBRAIC = 0.01
"""The tolerance of the iteration, as a part of the discretization error that is asked for."""

PRESETS = {"fast": {"order": 1, "tolerance": 1e-4},
           "balanced": {"order": 2, "tolerance": 1e-6},
           "accurate": {"order": 2, "tolerance": 1e-8, "target_error": 0.01}}
"""Values of keys that a scene leaves out, by ``method.preset``; measured in docs/tradeoff.md."""


class Method(Table, kw_only=True):
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


class Output(Table, kw_only=True):
    """What is written besides the interface: nothing is computed that nobody asked for.

    The units only label pictures, for scenes in MPa and mm, say: any consistent set gives the same.
    """

    stress: bool = True
    error: bool = False
    figures: bool = True
    length_unit: str = "m"
    stress_unit: str = "Pa"


class Checkpoint(Table, kw_only=True):
    """When the state of the iteration is written besides at a signal; zero: never for this reason.

    ``seconds`` since the last time, ``iterations``: every so many.
    """

    seconds: NonNegative = 600.0
    iterations: Annotated[int, msgspec.Meta(ge=0)] = 0
