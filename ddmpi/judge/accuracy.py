"""An accuracy target: how fine the meshes must be for the estimated discretization error to meet it.

All shapes and mesh files of a scene are refined by the same whole number, so that matching contacts stay matching. It
follows from the errors on the former meshes: ‖e‖ ∝ refinement^(−rate).

Geometries are meshed anew, with elements as large as their errors allow. If η_e² ∝ h_e^(2p) is the squared error of an
element over its area, with the order p, then a given total takes the fewest elements if all have the same squared
error (Zienkiewicz and Zhu, Int. J. Numer. Meth. Engng. 24, 1987; Li and Bettess, Commun. Numer. Meth. Engng. 11, 1995):
h_new = κ h_e η_e^(−1/(p+1)). In space the exponent is −2/(2p+3).
"""

import logging
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from ddmpi.mesh.mesh import Mesh, signed_measures
from ddmpi.mesh.refine import Sizes, graded
from ddmpi.scene.scene import Settled

log = logging.getLogger("ddmpi")

CAUTION = 0.2
"""A target is met by estimates that are smaller by this fraction of it, over the order: true errors were larger than
estimates by at most as much (docs/understand/tradeoff.md)."""

LADDER = {
    # of all meshes
    "growth": 4,  # largest refinement in one step
    "hopeless": 1.25,  # stop if the goal needs meshes more than so many times finer than `max_unknowns` allows
    # of shapes and mesh files
    "rate": 0.75,  # assumed on the first mesh: corners of clamps and ends of contacts slow down both orders
    "least rate": 0.4,
    "largest rate": 2.0,  # limits of a measured rate
    "aim": 0.95,  # the error that a step aims for, over the goal
    # of geometries
    "meshes": 12,  # largest number of them
    "slowest": 0.5,  # lowest rate, at most the order
    "aim drawn": 0.85,  # the error that a step aims for, over the goal
    "drop": 0.2,  # it aims for at least this fraction of the error: coarse meshes say where the error is, not how large
    "almost": 0.95,  # a step that leaves more than this fraction of the error counts as leaving so much
    "shrink": 0.1,
    "grow": 2.0,  # limits of the new size of an element over its old size
}


class Level(NamedTuple):
    """A mesh that was solved on: refinement, unknowns n, estimated relative error, dofs including clamped ones.

    The refinement is a whole number; where all bodies are geometries the number of dofs grows with its d-th power.
    """

    refinement: float
    n: int
    error: float
    dofs: int


class Demand(NamedTuple):
    """The error of geometries: Σ η_e^(2d/(2p+d)), Σ η_e² (J/m, in space J) and the number of cells."""

    share: float
    square: float
    triangles: int


def demand(squares: np.ndarray, rate: float, dimension: int) -> Demand:
    """The demand of one body with the squared errors (nt,) of its cells, which fall with the `rate` p."""
    return Demand(
        float((squares ** (dimension / (2 * rate + dimension))).sum()),
        float(squares.sum()),
        len(squares),
    )


def finer_sizes(mesh: Mesh, squares: np.ndarray, rate: float, scale: float) -> Sizes:
    """The sizes κ h_e η_e^(−2/(2p+d)) for the squared errors η_e² (nt,) of the cells; `scale` is κ."""
    d = mesh.dimension
    equilateral = (
        math.factorial(d) * 2 ** (d / 2) / math.sqrt(d + 1)
    )  # of the edge's d-th power over the measure
    size = (equilateral * signed_measures(mesh.points, mesh.triangles)) ** (1 / d)
    with np.errstate(divide="ignore"):
        ratio = scale * squares ** (-1 / (2 * rate + d))
    return graded(mesh, size * np.clip(ratio, LADDER["shrink"], LADDER["grow"]))


def next_refinement(
    levels: Sequence[Level], goal: float, most: int, doubling: bool, dimension: int
) -> int | None:
    """How many times finer than the scene's the next meshes are.

    None if they would have too many unknowns, or if the largest meshes are near and would miss the goal by far at the
    measured rate.

    Parameters
    ----------
    levels : the meshes solved on so far; the last one misses the goal
    goal : estimated relative error in the energy norm
    most : largest number of unknowns
    doubling : whether only powers of two can be made (a mesh from a file is halved)
    dimension : d; the number of unknowns grows with the d-th power of the refinement
    """
    last = levels[-1]
    whole = int(last.refinement)
    rate, seen = LADDER["rate"], False
    if len(levels) > 1 and levels[-2].error > last.error > 0.0:
        seen = True
        rate = math.log(levels[-2].error / last.error) / math.log(
            last.refinement / levels[-2].refinement
        )
        rate = min(max(rate, LADDER["least rate"]), LADDER["largest rate"])
    factor = (last.error / (LADDER["aim"] * goal)) ** (1 / rate)  # from ‖e‖ ∝ refinement^(−rate)
    largest = last.refinement * (most / last.dofs) ** (1 / dimension)
    if seen and LADDER["growth"] * last.refinement > largest:
        least = (last.error / goal) ** (
            1 / max(rate, LADDER["rate"])
        )  # rates on coarse meshes are too low
        if last.refinement * least > LADDER["hopeless"] * largest:
            return None
    wanted = last.refinement * (
        factor if factor <= LADDER["growth"] else min(math.sqrt(factor), LADDER["growth"])
    )
    if doubling:
        wanted, largest = 2 ** math.ceil(math.log2(wanted)), 2 ** math.floor(math.log2(largest))
    refinement = min(max(math.ceil(wanted - 1e-9), whole + 1), math.floor(largest))
    return refinement if refinement > whole else None


class MeshLadder:
    """The finer and finer meshes that a run solves on until its target is met.

    Attributes
    ----------
    scene : with the meshes to begin with
    levels : that were solved on
    missed : why this mesh is the last one although it misses the target; empty otherwise
    refinement : of the mesh to solve on now
    sizes : of the elements of this rank's geometries in the mesh to solve on now; none before there is an estimate
    """

    def __init__(self, scene: Settled) -> None:
        self.scene, self.levels, self.missed = scene, list[Level](), ""
        if scene.aimed:
            log.info("%s", scene.aimed)
        self.refinement: float = 1
        self.sizes, self._former = dict[str, Sizes](), dict[str, Sizes]()
        self._scale = self._rate = 0.0
        drawn = [body.mesh.drawn for body in scene.body]
        self._any_drawn, self._all_drawn = any(drawn), all(drawn)  # geometries

    def state(self) -> dict[str, Any]:
        return {
            "levels": tuple(self.levels),
            "missed": self.missed,
            "refinement": self.refinement,
            "sizes": {name: asdict(sizes) for name, sizes in self.sizes.items()},
            "former": {name: asdict(sizes) for name, sizes in self._former.items()},
        }

    def restore(self, state: dict[str, Any]) -> None:
        self.levels, self.missed = [Level(*level) for level in state["levels"]], state["missed"]
        self.refinement = state["refinement"]
        self.sizes, self._former = (
            {name: Sizes(**entry) for name, entry in state[kind].items()}
            for kind in ("sizes", "former")
        )

    @property
    def factor(self) -> int:
        """How many times finer than given shapes and mesh files are now."""
        return 1 if self._all_drawn else int(self.refinement)

    @property
    def meshes(self) -> str:
        """The meshes to solve on now, in words."""
        if self._all_drawn and self.levels:
            n = float(f"{self.levels[0].n * self.refinement**self.scene.dimension:.2g}")
            return f"meshes of about {n:.0f} unknowns that are finest where the error is"
        return f"meshes {self.refinement:.0f} times as fine as at first"

    @property
    def goal(self) -> float:
        """The largest estimate that meets the target."""
        target = self.scene.method.target_error
        return (1.0 - CAUTION / self.scene.body[0].mesh.order) * target if target else math.inf

    def rate(self, error: float) -> float:
        """The rate of geometries: the order of the elements, or less where the `error` on this mesh is larger than was
        aimed for, as with singular stresses at corners."""
        order = float(self.scene.body[0].mesh.order)
        if not self.levels:
            return order
        wanted = max(LADDER["aim drawn"] * self.goal / self.levels[-1].error, LADDER["drop"])
        seen = min(error / self.levels[-1].error, LADDER["almost"])
        return min(max(order * math.log(seen) / math.log(wanted), LADDER["slowest"]), order)

    def proceed(
        self, n: int, error: float, dofs: int, demands: Mapping[str, Demand] | None = None
    ) -> float | None:
        """Note the `error` on this mesh; return the refinement of the next one, or None to stay with this one.

        Parameters
        ----------
        demands : of all geometries, by the names of their bodies
        """
        method = self.scene.method
        if self.missed:
            return None
        if self._all_drawn and self.levels:
            self.refinement = round((dofs / self.levels[0].dofs) ** (1 / self.scene.dimension), 3)
        self._rate = self.rate(error)
        self.levels.append(Level(self.refinement, n, error, dofs))
        if method.target_error is None or error <= self.goal:
            return None
        given = [body.name for body in self.scene.body if not body.mesh.refinable]
        following = None if given else self._next(demands or {})
        if following:
            self.refinement = following
            log.info(
                "estimated discretization error %.2g, at most %.2g is asked for: going on with %s",
                error,
                self.goal,
                self.meshes,
            )
            return following
        reason = (
            f'the mesh of {" and of ".join(given)} is given: allow finer ones by mesh.refine = "as needed"'
            if given
            else f"meshes that meet it would probably exceed method.max_unknowns = {method.max_unknowns}"
        )
        if len(self.levels) >= LADDER["meshes"] and self._any_drawn:
            reason = f"{len(self.levels)} meshes did not reach it"
        self.missed = self._miss(reason)
        return None

    def draw(self, geometries: Mapping[str, tuple[Mesh, np.ndarray]]) -> None:
        """Find the sizes of the next meshes of this rank's geometries from their meshes and squared errors."""
        self._former = self.sizes
        self.sizes = {
            name: finer_sizes(mesh, squares, self._rate, self._scale)
            for name, (mesh, squares) in geometries.items()
        }

    def fall_back(self, reason: str) -> bool:
        """Go back to the last mesh with a certified answer, because of `reason` this one has none.

        Returns whether that is possible: there may be no such mesh, or this is it.
        """
        if not self.levels or self.missed or self.levels[-1].refinement == self.refinement:
            return False
        failed = self.meshes
        self.missed = self._miss(f"{failed} have no certified answer: {reason}")
        self.sizes, self.refinement = self._former, self.levels[-1].refinement
        log.info("no certified answer on %s (%s): back to %s", failed, reason, self.meshes)
        return True

    def _miss(self, reason: str) -> str:
        return (
            f"certified, but the estimated discretization error of {self.levels[-1].error:.2g} misses "
            f"method.target_error = {self.scene.method.target_error:g}, met by an estimate of at most "
            f"{self.goal:.2g}; {reason}"
        )

    def _next(self, demands: Mapping[str, Demand]) -> float | None:
        """The next refinement, and the scale of the sizes of geometries; None if the target is out of reach."""
        if not demands:
            return self._next_grid()
        last, rate = self.levels[-1], self._rate
        d = self.scene.dimension
        share, square, cells = (sum(column) for column in zip(*demands.values(), strict=True))
        # Equal errors of all new elements leave the fraction f of the error if κ^(2p) = f² Σ η_e² / Σ η_e^(2d/(2p+d)),
        # and take κ^(−d) Σ η_e^(2d/(2p+d)) elements, `times` as many as now.
        final = LADDER["aim drawn"] * self.goal / last.error
        scale = [
            (square * fraction**2 / share) ** (0.5 / rate)
            for fraction in (max(final, LADDER["drop"]), final)
        ]
        times = [share / cells / kappa**d for kappa in scale]
        # an element that is not needed is not removed: it grows by "grow" at most
        growth = [
            (ratio + max(1.0 - ratio, 0.0) / LADDER["grow"] ** d) ** (1 / d) for ratio in times
        ]
        largest = (self.scene.method.max_unknowns / last.dofs) ** (1 / d)
        if len(self.levels) >= LADDER["meshes"] or (
            len(self.levels) > 1 and growth[1] > LADDER["hopeless"] * largest
        ):
            return None
        self._scale = scale[0] * max(growth[0] / min(largest, LADDER["growth"]), 1.0)
        if not self._all_drawn:
            return self._next_grid()
        return (
            last.refinement * min(growth[0], largest, LADDER["growth"]) if largest > 1.0 else None
        )

    def _next_grid(self) -> int | None:
        doubling = any(body.mesh.file is not None for body in self.scene.body)
        return next_refinement(
            self.levels, self.goal, self.scene.method.max_unknowns, doubling, self.scene.dimension
        )


def refine_scene(scene: Settled, refinement: int) -> Settled:
    """The scene with shapes meshed `refinement` times finer, and meshes of files halved log2(`refinement`) times."""

    def finer(mesh):
        if mesh.drawn:
            return mesh
        if mesh.file is None:
            return replace(mesh, divisions=tuple(k * refinement for k in mesh.divisions))
        return replace(mesh, refine=mesh.halvings + int(math.log2(refinement)))

    return replace(scene, body=[replace(body, mesh=finer(body.mesh)) for body in scene.body])
