"""An accuracy target: how fine the meshes must be for the estimated discretization error to meet it.

All meshes of a scene are refined by the same whole number, so that the two sides of a contact go on matching.
The number follows from the errors on the meshes before: ‖e‖ ∝ refinement^(−rate).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any, NamedTuple

from msgspec.structs import replace

from ddmpi.scene.scene import Settled

FIRST_RATE = 0.75
"""Rate of convergence expected until two meshes have shown theirs: corners of clamps and ends of contacts hold
both orders back."""

RATES = (0.4, 2.0)
"""Limits of a rate that is believed."""

GROWTH = 4
"""Largest refinement in one step; a larger one is done in two."""

AIM = 0.95
"""The error that a step aims for, as a part of the goal."""

CAUTION = {1: 0.8, 2: 0.9}
"""The largest estimate that meets a target, as a part of it, by order. True errors were at most larger than the
estimate by the inverse (docs/tradeoff.md)."""

HOPELESS = 1.25
"""If the goal takes meshes finer than the largest ones by more than this factor, the last steps are not made."""


class Level(NamedTuple):
    """A mesh that was solved on: refinement, unknowns n, estimated relative error, dofs including clamped ones."""

    refinement: int
    n: int
    error: float
    dofs: int


def next_refinement(levels: Sequence[Level], goal: float, most: int, doubling: bool) -> int | None:
    """How much finer than the scene's own the next meshes are.

    None if they would have too many unknowns, or if the next step would be one of the last and the largest meshes
    would miss the goal by far at the rate seen so far.

    Parameters
    ----------
    levels : the meshes solved on so far; the last one misses the goal
    goal : estimated relative error in the energy norm
    most : largest number of unknowns
    doubling : whether only powers of two can be made (a mesh from a file is halved)
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
class MeshLadder:
    """The finer and finer meshes that a run solves on until its target is met.

    Parameters
    ----------
    scene : with the meshes as given
    done : (refinement, n, error, dofs) of the levels that an interrupted run has finished

    Attributes
    ----------
    refinement : of the mesh to solve on now
    missed : why this mesh is the last one although it misses the target; empty otherwise
    """

    scene: Settled
    done: list = field(default_factory=list)
    missed: str = ""
    refinement: int = field(init=False)

    def __post_init__(self) -> None:
        self.restore({"done": self.done, "missed": self.missed})

    def state(self) -> dict[str, Any]:
        """The state of an interrupted run, in plain numbers."""
        return {"done": [list(level) for level in self.levels], "missed": self.missed}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from `state`."""
        self.done, self.missed = list(state["done"]), state["missed"]
        self.refinement = self.levels[-1].refinement if self.missed else (self.done and self._next()) or 1

    @property
    def levels(self) -> list[Level]:
        return [Level(int(refinement), int(n), float(error), int(dofs)) for refinement, n, error, dofs in self.done]

    @property
    def goal(self) -> float:
        """The largest estimate that meets the target."""
        target = self.scene.method.target_error
        return CAUTION[self.scene.body[0].mesh.order] * target if target else math.inf

    def proceed(self, n: int, error: float, dofs: int) -> int | None:
        """Note the `error` on this mesh; return the refinement of the next one, or None to stay with this one."""
        method = self.scene.method
        if self.missed:
            return None
        self.done.append((self.refinement, n, error, dofs))
        if method.target_error is None or error <= self.goal:
            return None
        given = [body.name for body in self.scene.body if not body.mesh.refinable]
        following = None if given else self._next()
        if following:
            self.refinement = following
            return following
        reason = (f"the mesh of {' and of '.join(given)} is given: allow finer ones by mesh.refine = \"as needed\""
                  if given else
                  f"meshes that meet it would probably exceed method.max_unknowns = {method.max_unknowns}")
        self.missed = self._miss(reason)
        return None

    def fall_back(self, reason: str) -> bool:
        """Go back to the last mesh with a certified answer, because of `reason` this one has none.

        Returns whether that is possible: there may be no such mesh, or this is it.
        """
        if not self.done or self.levels[-1].refinement == self.refinement:
            return False
        reason = f"meshes {self.refinement} times as fine as given have no certified answer: {reason}"
        self.restore({"done": self.done, "missed": self._miss(reason)})
        return True

    def _miss(self, reason: str) -> str:
        return (f"certified, but the estimated discretization error of {self.levels[-1].error:.2g} misses "
                f"method.target_error = {self.scene.method.target_error:g}, which takes an estimate of "
                f"{self.goal:.2g}; {reason}")

    def _next(self) -> int | None:
        doubling = any(body.mesh.file is not None for body in self.scene.body)
        return next_refinement(self.levels, self.goal, self.scene.method.max_unknowns, doubling)


def refine_scene(scene: Settled, refinement: int) -> Settled:
    """The scene with shapes meshed `refinement` times finer, and meshes of files halved log2(`refinement`) times."""
    def finer(mesh):
        if mesh.file is None:
            return replace(mesh, divisions=tuple(k * refinement for k in mesh.divisions))
        return replace(mesh, refine=mesh.halvings + int(math.log2(refinement)))

    return replace(scene, body=[replace(body, mesh=finer(body.mesh)) for body in scene.body])
