"""Accuracy targets: how fine the meshes must be for the estimated discretization error, and for bars of results.

A mesh has squared errors in its cells: η² of the energy norm, and |η_K| of a result (`judge.bars`), which fall alike. So
the error of a result is here the root of its bar. Of several targets the squared errors over what is allowed are summed.

All shapes and mesh files of a scene are refined by the same whole number, so that matching contacts stay matching. It
follows from the errors on the former meshes: ‖e‖ ∝ refinement^(−rate).

Geometries are meshed anew, with elements as large as their errors allow. If η_e² ∝ h_e^(2p) is the squared error of an
element over its area, with the order p, then a given total takes the fewest elements if all have the same squared
error (Zienkiewicz and Zhu, Int. J. Numer. Meth. Engng. 24, 1987; Li and Bettess, Commun. Numer. Meth. Engng. 11, 1995):
h_new = κ h_e η_e^(−1/(p+1)). In space the exponent is −2/(2p+3).
"""

import logging
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
from msgspec.structs import replace

from ddmpi.judge.bars import FINAL, LARGEST, UNRESOLVED, Bar
from ddmpi.mesh.mesh import Mesh, signed_measures
from ddmpi.mesh.refine import Sizes, graded
from ddmpi.scene.method import Target, Within
from ddmpi.scene.results import targets
from ddmpi.scene.scene import Settled
from ddmpi.system.numbers import with_error

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
    # of results
    "least": 1e-3,  # squared error of a cell at least, over the mean: the adjoint has to be resolved as well
    "unresolved": 5.0,  # largest error over what is allowed of a largest value that is not resolved
}

GROWTH = {2: (1.15, 1.0, 5000), 3: (1.75, 4.0 / 3.0, 1500)}
"""By dimension the powers of the number of unknowns with which the seconds of factors grow, and the memory; and of how many
unknowns a mesh takes as long as it takes at least. All other seconds grow with the number itself."""

STILL = 0.8
"""A largest value has no limit where two steps to finer meshes leave more than this of how far it differs from those beside
it, and no mesh helps where they leave more of its bar. Those with a limit leave a sixteenth where sizes are halved twice."""

UNLIMITED = 1e30
"""Unknowns of forecasts."""

RATES = {1: 0.75, 2: 0.9}
"""By order the powers of the size with which bars of shapes and files fall from the first mesh to the next one."""

LEAST_SEEN = 0.35
"""Least rate of bars that forecasts take from two meshes, over the order: the power of the size with which they fall."""

ENERGY = ""
"""The name of the target in the energy norm, among those of results."""


class Cost(NamedTuple):
    """What all ranks have used for a mesh: processor seconds, those of factors among them, bytes, and bytes before it."""

    seconds: float = 0.0
    factor: float = 0.0
    bytes: float = 0.0
    idle: float = 0.0

    def of(self, n: int, times: float, dimension: int) -> tuple[float, float]:
        """The seconds and bytes of a mesh with so many `times` the n unknowns of this one."""
        factor, memory, few = GROWTH[dimension]
        rest = (self.seconds - self.factor) * (times * n + few) / (n + few)
        return rest + times**factor * self.factor, self.idle + times**memory * (
            self.bytes - self.idle
        )


class Level(NamedTuple):
    """A mesh that was solved on: refinement, unknowns n, estimated relative error, dofs including clamped ones, the bars of
    results and the cost.

    The refinement is a whole number; where all bodies are geometries the number of dofs grows with its d-th power.
    """

    refinement: float
    n: int
    error: float
    dofs: int
    results: Mapping[str, Bar] = MappingProxyType({})
    cost: Cost = Cost()

    def told(self) -> dict[str, Any]:
        """Its entry in the summary, with results and their cost where errors of some are told."""
        entry = self._asdict()
        results, cost = entry.pop("results"), entry.pop("cost")
        if not results:
            return entry
        bars = {name: bar.told() for name, bar in results.items()}
        return entry | {"results": bars, "seconds": cost.seconds, "bytes": cost.bytes}


class Miss(NamedTuple):
    """An error, and how large it may be; of a result the roots of its bar and of the largest bar."""

    error: float
    goal: float

    @property
    def over(self) -> float:
        return self.error / self.goal


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


def allowed(target: Target, value: float) -> float:
    """The largest bar of a result with this value, in its unit."""
    return target.within if isinstance(target, Within) else target * abs(value)


def weighted(
    parts: Mapping[str, Mapping[str, np.ndarray]],
    sums: Mapping[str, float],
    misses: Mapping[str, Miss],
    cells: int,
) -> dict[str, np.ndarray]:
    """The squared errors (nt,) of bodies, by name, that meshes for several targets are made of. Not collective.

    Parameters
    ----------
    parts : by target the squared errors of its own of the cells of these bodies
    sums : of them over all bodies; targets whose sum is zero do not count
    cells : number of the cells of all bodies
    """
    count = [name for name in misses if sums[name]]
    if not count:
        return dict(parts[next(iter(misses))])
    weights = {name: misses[name].over ** 2 / sums[name] for name in count}
    first, total = weights[count[0]], dict[str, np.ndarray]()
    for name in count:
        for body, squares in parts[name].items():
            total[body] = total.get(body, 0.0) + weights[name] / first * squares
    if [*misses] == [ENERGY]:
        return total
    mean = sum(weights[name] * sums[name] for name in count) / first / cells
    return {body: np.maximum(squares, LADDER["least"] * mean) for body, squares in total.items()}


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


def _growth(times: float, dimension: int) -> float:
    """How many times the elements there are where equal errors take so many `times`: one that is not needed is not
    removed, it grows by "grow" at most."""
    return times + max(1.0 - times, 0.0) / LADDER["grow"] ** dimension


def next_refinement(
    levels: Sequence[Level], goal: float, most: float, doubling: bool, dimension: int
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


def price_in_words(price: Mapping[str, float]) -> str:
    """What meshes for a result take: "about 91,000 unknowns, 6.1 s of processor time and 1.2 GB"."""
    n, seconds, gigabytes = price["unknowns"], price["seconds"], price["bytes"] / 1e9
    digits = max(0, len(str(round(n))) - 2)
    return f"about {round(n, -digits):,} unknowns, {seconds:.2g} s of processor time and {gigabytes:.2g} GB"


class MeshLadder:
    """The finer and finer meshes that a run solves on until its target is met.

    Attributes
    ----------
    scene : with the meshes to begin with
    levels : that were solved on
    missed : why this mesh is the last one although it misses the target; empty otherwise
    targets : of results by name
    refinement : of the mesh to solve on now
    sizes : of the elements of this rank's geometries in the mesh to solve on now; none before there is an estimate
    """

    def __init__(self, scene: Settled) -> None:
        self.scene, self.levels, self.missed = scene, list[Level](), ""
        self.targets: dict[str, Target] = targets(scene)
        if scene.aimed:
            log.info("%s", scene.aimed)
        self.refinement: float = 1
        self.sizes, self._former = dict[str, Sizes](), dict[str, Sizes]()
        self._scale = self._rate = 0.0
        self._alone: Mapping[str, Demand] = {}
        drawn = [body.mesh.drawn for body in scene.body]
        self._any_drawn, self._all_drawn = any(drawn), all(drawn)  # geometries

    def state(self) -> dict[str, Any]:
        return {
            "levels": tuple((*level[:4], dict(level.results), level.cost) for level in self.levels),
            "missed": self.missed,
            "refinement": self.refinement,
            "sizes": {name: asdict(sizes) for name, sizes in self.sizes.items()},
            "former": {name: asdict(sizes) for name, sizes in self._former.items()},
        }

    def restore(self, state: dict[str, Any]) -> None:
        self.levels, self.missed = [], state["missed"]
        for *level, results, cost in state["levels"]:
            bars = {name: Bar(*bar) for name, bar in results.items()}
            self.levels.append(Level(*level)._replace(results=bars, cost=Cost(*cost)))
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

    def _asked(self, level: Level) -> Iterator[tuple[str, Bar, float]]:
        """Of each result with a target its name, its bar on a mesh, and the largest bar that is allowed."""
        for name, target in self.targets.items():
            bar = level.results[name]
            yield name, bar, allowed(target, bar.value or 0.0)

    def misses(self, level: Level) -> dict[str, Miss]:
        """The errors of a mesh by target, that in the energy norm and the bars of results. Where results have targets the
        first is at most so large that there are bars."""
        goal = min(self.goal, LARGEST) if self.targets else self.goal
        found = {ENERGY: Miss(level.error, goal)} if self.scene.method.aimed else {}
        half = 0.5 * self.scene.body[0].mesh.order
        for name, bar, within in self._asked(level):
            most = within**0.5
            if (
                bar.word and bar.excess > 1.0
            ):  # distances of neighbours fall with the square of the size
                rough = most * min(bar.excess, LADDER["unresolved"]) ** half
                found[name] = Miss(max(bar.rough**0.5, rough), most)
            elif most:
                found[name] = Miss(bar.rough**0.5, most)
        return found

    def price(self, result: str, part: float) -> dict[str, float] | None:
        """What meshes for a result take until its bar is this `part` of the present one: the unknowns of the last one,
        and processor seconds and bytes of all ranks, from the first mesh on; None where no mesh does. Not collective."""
        last = self.levels[-1]
        bar = last.results[result]
        times = self._times(result, part) if part * (bar.bar or 0.0) > bar.floor else None
        if times is None:
            return None
        seconds, memory = last.cost.of(last.n, times, self.scene.dimension)
        spent = sum(level.cost.seconds for level in self.levels)
        memory = max(memory, last.cost.bytes)  # the run begins with the first mesh
        return {"unknowns": round(last.n * times), "seconds": spent + seconds, "bytes": memory}

    def _times(self, result: str, part: float) -> float | None:
        """How many times the unknowns of the present mesh that one has on which a bar is this `part` of the present one.

        Meshes of geometries after the first one are made for results, so that they are those of equal errors. Shapes
        and files go from the first mesh as far as rates that were seen lead.
        """
        d, order = self.scene.dimension, self.scene.body[0].mesh.order
        levels = [
            level._replace(error=level.results[result].rough ** 0.5)
            for level in self.levels
            if result in level.results
        ]
        last = levels[-1]
        if len(levels) > 1 and not self._all_drawn:
            return (self._climbed(levels, last.error * part**0.5) / last.refinement) ** d
        if not self._all_drawn:
            finer = max(part ** (-1.0 / RATES[order]), 2.0)  # the next whole number at least
            return finer**d
        if len(levels) > 1:
            return part ** (-0.5 * d / order)
        share, square, cells = self._alone[result]
        left = part * LADDER["aim drawn"] ** 2
        times = share / cells * (square * left / share) ** (-0.5 * d / order) if share else 0.0
        return _growth(times, d) if share else None

    def _climbed(self, levels: Sequence[Level], goal: float) -> float:
        """The refinement of shapes and files at which a run would end whose errors are those of `levels`, and beyond them
        fall as from the last but one to the last."""
        sizes = np.log([level.refinement for level in levels])
        errors = np.log([level.error for level in levels])
        order = self.scene.body[0].mesh.order
        rate = (errors[-2] - errors[-1]) / (sizes[-1] - sizes[-2])
        rate = min(max(rate, 0.5 * LEAST_SEEN * order), order)
        seen = [levels[0]]
        while seen[-1].error > goal and (finer := self._finer(seen, goal, UNLIMITED)):
            size = math.log(finer)
            error = math.exp(np.interp(size, sizes, errors) - rate * max(size - sizes[-1], 0.0))
            dofs = round(levels[0].dofs * (finer / levels[0].refinement) ** self.scene.dimension)
            seen.append(levels[0]._replace(refinement=finer, error=error, dofs=dofs))
        return seen[-1].refinement

    def _worst(self, level: Level) -> Miss:
        """The largest of the errors over what is allowed."""
        found = self.misses(level).values()
        return max(found, key=lambda miss: miss.over, default=Miss(level.error, self.goal))

    def rate(self, level: Level) -> float:
        """The rate of geometries: the order of the elements, or less where the errors on this mesh are larger than was
        aimed for, as with singular stresses at corners. For results a step away from the first mesh, which is not made
        for them, says nothing."""
        order = float(self.scene.body[0].mesh.order)
        if len(self.levels) <= bool(self.targets):
            return order
        before, now = self._worst(self.levels[-1]), self._worst(level)
        wanted = max(LADDER["aim drawn"] * before.goal / before.error, LADDER["drop"])
        seen = min(now.error / before.error * (before.goal / now.goal), LADDER["almost"])
        return min(max(order * math.log(seen) / math.log(wanted), LADDER["slowest"]), order)

    def proceed(
        self,
        level: Level,
        demands: Mapping[str, Demand] = MappingProxyType({}),
        alone: Mapping[str, Demand] = MappingProxyType({}),
    ) -> float | None:
        """Note the errors on this mesh; return the refinement of the next one, or None to stay with this one.

        Parameters
        ----------
        level : this mesh; its refinement is known here
        demands : of all geometries, by the names of their bodies
        alone : of all geometries, by results, the demand of meshes for one of them
        """
        self._alone = alone
        if self.missed:
            return None
        if self._all_drawn and self.levels:
            times = level.dofs / self.levels[0].dofs
            self.refinement = round(times ** (1 / self.scene.dimension), 3)
        self._rate = self.rate(level)
        self.levels.append(level._replace(refinement=self.refinement))
        unmet = self._unmet()
        if not unmet:
            return None
        given = [body.name for body in self.scene.body if not body.mesh.refinable]
        vain = self._vain()
        following = None if given or vain else self._next(demands)
        if following:
            self.refinement = following
            log.info("%s: going on with %s", "; ".join(unmet), self.meshes)
            return following
        reason = (
            f'the mesh of {" and of ".join(given)} is given: allow finer ones by mesh.refine = "as needed"'
            if given
            else "meshes that meet it would probably exceed method.max_unknowns = "
            f"{self.scene.method.max_unknowns}"
        )
        if len(self.levels) >= LADDER["meshes"] and self._any_drawn:
            reason = f"{len(self.levels)} meshes did not reach it"
        self.missed = self._miss(vain or reason + self._dear())
        return None

    def _unmet(self) -> list[str]:
        """The targets that the last mesh misses, in words."""
        level, found = self.levels[-1], list[str]()
        if level.error > self.goal:
            found.append(
                f"estimated discretization error {level.error:.2g}, at most {self.goal:.2g} is asked for"
            )
        for name, bar, most in self._asked(level):
            if bar.bar is None:
                found.append(f"{name}: no bar, {bar.word}")
            elif bar.bar > most:
                told = with_error(bar.value or 0.0, bar.bar)
                found.append(f"{name}: {told}, at most {most:.2g} is asked for")
        return found

    def _dear(self) -> str:
        """What the targets take that the last mesh misses, of which forecasts know, in words."""
        prices = {}
        for name, bar, most in self._asked(self.levels[-1]):
            if bar.bar and bar.bar > most and (price := self.price(name, most / bar.bar)):
                prices[name] = price
        if not prices:
            return ""
        name, price = max(prices.items(), key=lambda item: item[1]["seconds"])
        return f"; {name} takes {price_in_words(price)}"

    def _vain(self) -> str:
        """Why no mesh at all meets the targets; empty otherwise."""
        for name, bar, most in self._asked(self.levels[-1]):
            if bar.word in FINAL:
                return f"{name} has no bar on finer meshes either"
            former = [level.results[name] for level in self.levels[-3:]]
            peaks = [each.excess for each in former if each.word == UNRESOLVED]
            if name.endswith("_max") and len(peaks) == 3 and peaks[2] > STILL * peaks[0]:
                return f"{name} grows with finer meshes: two of them do not bring it nearer to its neighbours"
            if not self._all_drawn and self._stays(former, most):
                return f"the bar of {name} stays as it is on finer meshes, as where straight sides of files have corners"
            if most >= bar.floor:
                continue
            if abs(bar.value or 0.0) < bar.floor:
                return f"{name} is zero but for rounding; ask for {{ within = … }} in its unit"
            return f"the bar of {name} is at least {bar.floor:.2g} on any mesh"
        return ""

    def _stays(self, former: Sequence[Bar], most: float) -> bool:
        """Whether the bar of a result is above `most`, and on the last three meshes of shapes and files as it was where
        divisions grow fourfold."""
        *before, last = [bar.rough for bar in former]
        finer = self.levels[-1].refinement >= 4 * self.levels[-len(former)].refinement
        missed = (former[-1].bar or 0.0) > most
        return missed and finer and len(before) == 2 and last > STILL * max(before)

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
        error, target, words = self.levels[-1].error, self.scene.method.target_error, self._unmet()
        if target and error > self.goal:
            words[0] = (
                f"the estimated discretization error of {error:.2g} misses method.target_error = {target:g}, met by "
                f"an estimate of at most {self.goal:.2g}"
            )
        return f"certified, but {'; '.join([*words, reason])}"

    def _next(self, demands: Mapping[str, Demand]) -> float | None:
        """The next refinement, and the scale of the sizes of geometries; None if the target is out of reach."""
        if not demands:
            return self._next_grid()
        last, rate = self.levels[-1], self._rate
        d = self.scene.dimension
        share, square, cells = (sum(column) for column in zip(*demands.values(), strict=True))
        # Equal errors of all new elements leave the fraction f of the error if κ^(2p) = f² Σ η_e² / Σ η_e^(2d/(2p+d)),
        # and take κ^(−d) Σ η_e^(2d/(2p+d)) elements, `times` as many as now.
        worst = self._worst(last)
        final = LADDER["aim drawn"] * worst.goal / worst.error
        scale = [
            (square * fraction**2 / share) ** (0.5 / rate)
            for fraction in (max(final, LADDER["drop"]), final)
        ]
        times = [share / cells / kappa**d for kappa in scale]
        growth = [_growth(ratio, d) ** (1 / d) for ratio in times]
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
        over = [level._replace(error=self._worst(level).over) for level in self.levels]
        return self._finer(over, 1.0, self.scene.method.max_unknowns)

    def _finer(self, levels: Sequence[Level], goal: float, most: float) -> int | None:
        doubling = any(body.mesh.file is not None for body in self.scene.body)
        return next_refinement(levels, goal, most, doubling, self.scene.dimension)


def refine_scene(scene: Settled, refinement: int) -> Settled:
    """The scene with shapes meshed `refinement` times finer, and meshes of files halved log2(`refinement`) times."""

    def finer(mesh):
        if mesh.drawn:
            return mesh
        if mesh.file is None:
            return replace(mesh, divisions=tuple(k * refinement for k in mesh.divisions))
        return replace(mesh, refine=mesh.halvings + int(math.log2(refinement)))

    return replace(scene, body=[replace(body, mesh=finer(body.mesh)) for body in scene.body])
