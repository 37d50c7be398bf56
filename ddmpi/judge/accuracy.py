"""An accuracy target: how fine the meshes must be for the estimated discretization error to meet it.

All meshes of a scene are refined by one whole number, so that the two sides of a contact go on matching.
Which one follows from the errors of the meshes before: ‖e‖ ∝ refinement^(−rate).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

from msgspec.structs import replace

from ddmpi.scene.scene import Scene

FIRST_RATE = 0.75
"""Rate of convergence that is expected before two meshes have shown it: corners of clamps and ends of contacts
hold both orders back."""

RATES = (0.4, 2.0)
"""Rates that are believed."""

GROWTH = 4
"""The meshes become at most this much finer at once; what takes more is done in two steps."""

AIM = 0.95
"""What is aimed for, as a part of the largest estimate that will do."""

CAUTION = {1: 0.8, 2: 0.9}
"""The largest estimate that meets a target, as a part of it, by order: so much too small have estimates been
found (docs/tradeoff.md)."""

HOPELESS = 1.25
"""Where meshes would have to be finer than the largest ones by more than this, the last steps are not made."""


class Level(NamedTuple):
    """One mesh that was solved on: its refinement, unknowns n, estimated relative error, and dofs with the clamped
    ones."""

    refinement: int
    n: int
    error: float
    dofs: int


def next_refinement(levels: Sequence[Level], goal: float, most: int, doubling: bool) -> int | None:
    """How much finer than the scene's own the next meshes are; None if they would have too many unknowns.

    That is also so where the next step would be one of the last, and at the rate that was seen the largest meshes
    would miss the goal by far.

    Parameters
    ----------
    levels : what was solved so far; the last one misses the goal
    goal : estimated relative error in the energy norm
    most : largest number of unknowns
    doubling : only powers of two can be made (a given mesh is halved)
    """
    last = levels[-1]
    rate, seen = FIRST_RATE, False
    if len(levels) > 1 and levels[-2].error > last.error > 0.0:
        seen = True
        rate = math.log(levels[-2].error / last.error) / math.log(last.refinement / levels[-2].refinement)
        rate = min(max(rate, RATES[0]), RATES[1])
    factor = (last.error / (AIM * goal)) ** (1 / rate)
    largest = last.refinement * math.sqrt(most / last.dofs)
    if seen and GROWTH * last.refinement > largest:
        least = (last.error / goal) ** (1 / max(rate, FIRST_RATE))  # coarse meshes hide their rate
        if last.refinement * least > HOPELESS * largest:
            return None
    wanted = last.refinement * (factor if factor <= GROWTH else min(math.sqrt(factor), GROWTH))
    if doubling:
        wanted, largest = 2 ** math.ceil(math.log2(wanted)), 2 ** math.floor(math.log2(largest))
    refinement = min(max(math.ceil(wanted - 1e-9), last.refinement + 1), math.floor(largest))
    return refinement if refinement > last.refinement else None


@dataclass
class Course:
    """The meshes that a run goes through.

    Parameters
    ----------
    scene : as given
    done : (refinement, n, error, dofs) of the levels that an interrupted run has been through
    """

    STATE = ("done",)

    scene: Scene
    done: list = field(default_factory=list)
    missed: str = ""

    def __post_init__(self) -> None:
        self.done = list(self.done)
        self._refinement = 1
        if self.done:
            self._refinement = self._next() or 1

    @property
    def levels(self) -> list[Level]:
        return [Level(int(refinement), int(n), float(error), int(dofs)) for refinement, n, error, dofs in self.done]

    @property
    def refinement(self) -> int:
        """Of the mesh that is solved on."""
        return self._refinement

    @property
    def goal(self) -> float:
        """The largest estimate that meets the target."""
        return CAUTION[self.scene.body[0].mesh.order] * self.scene.method.target_error

    def proceed(self, n: int, error: float, dofs: int) -> int | None:
        """Note the error on the mesh; the refinement of the next one, None to stay here.

        Where the target is missed and no finer mesh may be made, `missed` says why.
        """
        target = self.scene.method.target_error
        self.done.append((self._refinement, n, error, dofs))
        if target is None or error <= self.goal:
            return None
        given = [body.name for body in self.scene.body if not body.mesh.refinable]
        following = None if given else self._next()
        if following is None:
            reason = (f"the mesh of {' and of '.join(given)} is given: allow finer ones by mesh.refine = \"as needed\""
                      if given else
                      "meshes that meet it would probably exceed method.max_unknowns = "
                      f"{self.scene.method.max_unknowns}")
            self.missed = (f"certified, but the estimated discretization error of {error:.2g} misses "
                           f"method.target_error = {target:g}, which takes an estimate of {self.goal:.2g}; {reason}")
        else:
            self._refinement = following
        return following

    def _next(self) -> int | None:
        doubling = any(body.mesh.file is not None for body in self.scene.body)
        method = self.scene.method
        return next_refinement(self.levels, self.goal, method.max_unknowns, doubling)


def refine_scene(scene: Scene, refinement: int) -> Scene:
    """The scene with its generated meshes `refinement` times finer and those of files halved as often as that takes."""
    def finer(mesh):
        if mesh.file is None:
            return replace(mesh, divisions=tuple(k * refinement for k in mesh.divisions))
        return replace(mesh, refine=mesh.halvings + int(math.log2(refinement)))

    return replace(scene, body=[replace(body, mesh=finer(body.mesh)) for body in scene.body])
