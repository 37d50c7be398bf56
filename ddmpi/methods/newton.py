"""The default outer method: a semi-smooth Newton method on the contact forces of the interfaces.

The unknowns are the contact forces s, equal and opposite on the two bodies, and the rigid motions α of loose bodies.
The gaps are r = (C + D) s + b − d − Gᵀα (see `Joint`). With the projection P of the laws of contact and friction
(`ddmpi.interface.law`), the equations are

    s = P(s − c r) for any c > 0,        G s + K α = e

(Alart and Curnier 1991; Christensen, Klarbring, Pang and Strömberg 1998). A step is that of the primal–dual active set
method: P says which nodes are open, slip and stick, and GMRES solves the linear problem of these active sets
(`ddmpi.methods.krylov`). r is linear in s, so the residual along the step costs no multiplication; the length of the
step minimizes it, which stops the active sets from cycling. Where steps stall, a path of easier problems leads to a
point from which they converge (`ddmpi.methods.paths`).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Sequence
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ddmpi.coupling.joint import Joint, Point
from ddmpi.methods.dense import LONG, Direct
from ddmpi.methods.half_space import MODEL_STEPS, Model, Modelled
from ddmpi.methods.krylov import (
    FORCING,
    Linearised,
    LinearProblem,
    Preconditioner,
    Regularisation,
    forcing,
)
from ddmpi.methods.linear import Linearisation
from ddmpi.methods.outer import Outer, Report, Step, no_report
from ddmpi.methods.paths import DRIFT, STOPPED, InteriorPoints, Path, Softening
from ddmpi.petsc.events import event
from ddmpi.system.numbers import concatenated, norm

LENGTHS = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05, 0.02)
"""Lengths of a Newton step; the others are tried only if the full one gains too little, see GAIN."""

GAIN = 0.7
"""The full step is taken if it leaves at most this fraction of the residual."""

PATIENCE, PROGRESS = 3, 0.7
"""A path begins after PATIENCE steps in a row that leave more than PROGRESS of the smallest residual. Newton's steps
from a point of a path go on as long as each leaves at most PROGRESS of the residual."""

PATHS: tuple[Callable[[Joint, np.ndarray, float], Path], ...] = InteriorPoints, Softening
"""The paths in the order in which they are tried with loose bodies. Without loose bodies the reversed order takes
half the steps."""

FULL_STEPS, GIVEN_STEPS, GROWTH = 12, 3, 3.0
"""The first FULL_STEPS steps in space skip the line search unless the residual grows by GROWTH: while friction turns, a
line search takes a quarter more steps. In the plane without Coulomb friction the first GIVEN_STEPS skip it, as full
steps seldom cycle there. With a model of the compliance no step does."""

ERROR = 10.0
"""The forces have converged when their estimated error is below this times the tolerance; of forces that contacts share
at a node, that of what they do to bodies."""

NEGLECTED = 0.01
"""Error of a product by an iterative solver that is kept, over the error that the tolerance allows."""

NO_FORCE = 1e-6
"""Forces are compared with at least this fraction of those that would close the free gaps of half-planes, and of the
loads on a loose body, whose resultant e may be rounding. Without any contact they are compared with these loads."""

SOFT, NEARLY = 1e-6, 1e-3
"""Contacts at one node share a force in many ways, or where normals differ a little in one way, up to that in which one
of them opens. The compliances that steer their parts let steps creep there. Once a step gains little, and less than
NEARLY is left, they get softer by SOFT, and steps as much more precise: else errors of one close what the last opened."""


class Iterate(NamedTuple):
    """An iterate of Newton's method.

    Attributes
    ----------
    point : the forces with their gaps, motions and imbalance
    size : with which forces are compared (N): their norm, or the least size
    misfit : the norm of what is left of all equations (N); None where forces were moved and the gaps must follow
    error : the estimated error of the forces over the size
    guess : where the first step guesses the status of nodes, "warm" from forces before, else "rest"
    """

    point: Point
    size: float
    misfit: float | None
    error: float = 0.0
    guess: str = ""

    @property
    def residual(self) -> float:
        """The misfit over the size."""
        assert self.misfit is not None
        return self.misfit / self.size if self.size else 0.0

    def is_answer(self, tolerance: float) -> bool:
        """Whether residual and estimated error are small; guessed active sets may fit by chance."""
        guessed = self.guess and self.residual > 0.0
        return self.residual <= tolerance and self.error <= ERROR * tolerance and not guessed

    def creeps(self, before: Iterate) -> bool:
        """Whether a step from `before` has gained little of the little that was left; those from a guess tell nothing."""
        return not before.guess and PROGRESS * before.residual < self.residual < NEARLY


class Newton(Outer):
    """The semi-smooth Newton method.

        >>> joint = ddmpi.solve("configs/punch.toml", MPI.COMM_WORLD).solved.assembly.joint
        >>> newton = Newton(joint, max_iterations=20)
        >>> newton.run(1e-8), len(newton.history), newton.history[-1].residual < 1e-8
        ('converged', 7, True)

    Parameters
    ----------
    joint : the operator of all bodies
    max_iterations : most steps
    report : called with every Step
    preconditioner : for all active sets; made if left out

    Attributes
    ----------
    forces : (size,) contact forces (N)
    history : the steps of the present load step; `residual` is that of the equations over the forces
    nothing : nodal forces up to this are rounding, beside those of the load steps before (N)
    refined : whether gaps that are computed anew are by solves with the bodies, even where C is dense
    hopeless : collective; whether no forces balance the loads, asked once steps stall. Then no path is followed
    direct : dense factors, in place of GMRES where they are cheaper
    """

    def __init__(
        self,
        joint: Joint,
        max_iterations: int,
        report: Report = no_report,
        preconditioner: Preconditioner | None = None,
    ) -> None:
        self.joint, self.max_iterations, self.report = joint, max_iterations, report
        self.inner_steps = {"gmres": 0}
        self.hopeless: Callable[[], bool] = lambda: False
        self.refined, self.nothing, self._shares = False, 0.0, False
        self.preconditioner = preconditioner or Preconditioner(joint)
        in_space, laws = self.preconditioner.in_space, joint.space.laws
        coulomb = joint.space.largest(np.array([laws.largest_slope])) > 0.0
        self._full = FULL_STEPS if in_space else 0 if coulomb else GIVEN_STEPS
        self._modelled: Modelled | None = None
        if joint.dear:
            model = Newton(Model(joint), MODEL_STEPS, preconditioner=self.preconditioner)
            self._full, model.inner_steps = 0, self.inner_steps
            self._modelled = Modelled(joint, model)
        self._wanted = 0.0  # by the gaps and resultants of all load steps so far, see NO_FORCE (N)
        self._least = 0.0  # the least size of forces in this load step (N)
        self.direct = Direct(joint, self.preconditioner)
        self.begin()

    def begin(
        self, warm: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None, foreseen: bool = False
    ) -> None:
        """Begin a load step, for the present loads of the joint. Collective.

        The first step takes the nodes under pressure as closed and sticking, which is right at a reversal, where starts
        with slipping nodes cycle; without forces, the nodes of `Joint.first_closed`, see `_first_guess`.

        Parameters
        ----------
        warm : forces s (size,), gaps r (size,) under the present loads, and motions α, of the step before; or None
        foreseen : whether `warm` predicts this load step, so that its gaps tell the first status of nodes
        """
        joint, space = self.joint, self.joint.space
        if warm is None:
            point = joint.at_rest()
        else:
            s, r, alpha = warm
            if joint.rigid.size and joint.stays.held.size:  # a prediction may have moved them
                before, alpha = alpha, joint.stays.settled(alpha)
                r = r - joint.rigid.spread(alpha - before)
            point = Point(s, r, alpha, joint.imbalance(s, alpha))
        closing = space.norm(self.preconditioner.c * joint.d)
        # a load may be small after a large one
        self._wanted = max(self._wanted, NO_FORCE * max(closing, norm(joint.e)))
        touching = space.any(np.ones(joint.size))
        self._least = max(self._wanted, (NO_FORCE if touching else 1.0) * joint.load)
        guess = "warm" if warm and space.any(self._pressed(point.s)) else "rest"
        # from guessed active sets the iteration cannot end; from a prediction one step must estimate the error
        self._at = self._measured(point)._replace(
            error=math.inf if foreseen else 0.0, guess="" if foreseen else guess
        )
        self.history: list[Step] = []

    def _pressed(self, s: np.ndarray) -> np.ndarray:
        """The nodes (m,) bool of all interfaces that forces s (size,) press."""
        parts = self.joint.space.with_slices()
        pressed = [s[entries][: interface.m] > 0.0 for interface, entries in parts]
        return concatenated(pressed, bool)

    def _first_guess(self, at: Iterate) -> tuple[np.ndarray, np.ndarray]:
        """The nodes (m,) bool that the first step takes as closed, and those onto which a body falls. Collective.

        A warm start closes the nodes under pressure. Contacts of loose bodies that have none, as where a body lay
        without a load, begin as without a warm start: else nothing but springs would hold the body in this step.
        """
        pressed = self._pressed(at.point.s)
        if at.guess == "rest":
            return self.joint.first_closed()
        if not self.joint.rigid.size:
            return pressed, np.zeros(len(pressed), bool)
        closed, falls = self.joint.first_closed()
        begin = 0
        for interface in self.joint.space.interfaces:
            nodes = slice(begin, begin + interface.m)
            if pressed[nodes].any():
                closed[nodes], falls[nodes] = pressed[nodes], False
            begin += interface.m
        return closed, falls

    @property
    def forces(self) -> np.ndarray:
        return self._at.point.s

    @property
    def motions(self) -> np.ndarray:
        return self._at.point.alpha

    def even(self) -> None:
        """Share the forces of bonds evenly where their ties say one thing twice, see `Joint.evened`. Not collective."""
        point = self._at.point
        self._at = self._at._replace(point=point._replace(s=self.joint.evened(point.s)))

    @property
    def gaps(self) -> np.ndarray:
        """(size,) the gaps under the present forces (m)."""
        return self._at.point.r

    @property
    def bound(self) -> np.ndarray:
        return self.joint.space.laws.bound_at(self.forces)

    def run(self, tolerance: float) -> str:
        """Iterate until the residual of the equations is below `tolerance` times the forces, and their error too.

        The residual understates the error where a body is stiffer than a half-plane, as a thin incompressible layer.
        The estimated error is the change of a step times the fraction of the residual that it left. Otherwise as
        `Outer.run`.
        """
        joint, at, ends, asked = self.joint, self._at, list[Point](), False
        before = joint.space.norm(at.point.s)
        if at.misfit is None:  # the forces were moved onto their bounds; the gaps must follow
            joint.neglected = NEGLECTED * tolerance * at.size
            at = self._look(at)
        if at.guess and at.residual <= tolerance:  # as where loads stay; a guess leads away
            at = at._replace(guess="", error=math.inf)
        self._shares = joint.space.any(self.preconditioner.shared)
        at, end = self._own_steps(at, tolerance, PATIENCE)
        for kind in PATHS if len(joint.e) else PATHS[::-1]:
            if end:
                return end
            path = kind(joint, self.preconditioner.c, before)
            for station in path.points(partial(self.direction, by=path.by)):
                at = self._took(at, self._measured(station.point), path.by, station.stage)
                if not asked and self.hopeless():
                    return "stalled"
                asked = True
                patience = 1 if at.residual < station.near else 0  # then the point is only judged
                _, end = self._own_steps(at, tolerance, patience, path.by)
                if end:
                    return end
                joint.neglected = NEGLECTED * tolerance * at.size
            ends.append(at.point)
        return end or self._gave_up(ends)

    def _own_steps(
        self, at: Iterate, tolerance: float, patience: int, of_path: Regularisation | None = None
    ) -> tuple[Iterate, str]:
        """Newton's own steps, until `patience` of them in a row gain little.

        From a point of a path their linear problems are those `of_path`. Returns the last iterate, and why the
        iteration ends there, as `run` does; empty where it goes on. Collective.
        """
        stalled, smallest = 0, math.inf
        full_until, shared = 0 if of_path else self._full, 1.0
        softens = not of_path and self._shares
        while True:
            at, end = self._judged(at, tolerance)
            if at.residual < PROGRESS * smallest:
                stalled, smallest = 0, at.residual
            elif stalled or len(self.history) >= full_until:
                stalled += 1  # full steps need gain nothing
            self.joint.neglected = NEGLECTED * tolerance * at.size
            if end or stalled >= patience:
                return at, end
            residuals = [step.residual for step in self.history]
            precision = forcing(residuals, self.preconditioner.in_space)
            by = of_path or Regularisation(shared=shared, forcing=precision * shared)
            full, before = not stalled and len(self.history) < full_until, at
            with event("NewtonStep"):
                at = self._took(at, self._newton_step(at, by, stalled, full, tolerance), by)
            if not self.history[-1].update:
                stalled = patience  # the next step would be the same
            if softens and at.creeps(before):
                # the parts may be large on the way, so that full steps gain nothing at first
                softens, shared, stalled, full_until = False, SOFT, 0, len(self.history) + PATIENCE

    def _judged(self, at: Iterate, tolerance: float) -> tuple[Iterate, str]:
        """The iterate, with precise gaps if it is an answer, and why the iteration ends there. Collective."""
        done = at.is_answer(tolerance)
        if done and self._modelled and self._modelled.rough:
            at = self._look(at)  # the gaps were only as precise as the step needed
            done = at.is_answer(tolerance)
        self._at, finite = at, bool(np.isfinite(at.residual))
        if not self.history and (done or not finite):
            self._note(at.residual, 0.0, FORCING)
        if not finite:
            return at, "diverged"
        balanced = done and self.joint.balances(at.point.left, at.size)
        if balanced or len(self.history) >= self.max_iterations:
            self._settle()
            return at, "converged" if done else "max_iterations"
        return at, ""

    def _took(
        self, before: Iterate, after: Iterate, by: Regularisation, stage: str = ""
    ) -> Iterate:
        """Note a step; returns the iterate after it with its estimated error. Collective."""
        moved = before.point.along(after.point, -1.0)
        update, determined = self._sizes(moved) / after.size if after.size else (0.0, 0.0)
        # as if the next step shrank like the residual
        error = determined * after.residual / before.residual if before.residual else 0.0
        self._at = after._replace(error=max(error, after.error))
        self._note(after.residual, update, by.forcing, stage)
        return self._at

    def _sizes(self, change: Point) -> np.ndarray:
        """The norms (2,) of a change of forces, and of what it does to bodies (N). Collective.

        Forces around a loop of contacts that stick at a node do nothing to bodies, so that any of them are an answer.
        """
        acting = change.s
        if self._shares:
            acting = self.joint.at_bodies(change.s, self.preconditioner.shared > 0.0)
        return np.array(self.joint.space.norms([change.s, acting]))

    def _note(self, residual: float, update: float, precision: float, stage: str = "") -> None:
        number, products = len(self.history) + 1, self.joint.multiplications()
        self.history.append(Step(number, update, residual, precision, products, stage))
        self.report(self.history[-1])

    def _gave_up(self, ends: Sequence[Point]) -> str:
        """Go to the end of the path on which bodies moved farthest, whose imbalance shows which bodies drift; returns
        why the iteration ends. Collective."""
        joint = self.joint
        end = max(ends, key=lambda end: joint.space.largest(joint.rigid.spread(end.alpha)))
        self._at = self._measured(end)
        return "drift" if self._drifts(end) else "stalled"

    def _drifts(self, end: Point) -> bool:
        """Whether bodies move on and on under loads that friction does not balance, and not into a partner."""
        space = self.joint.space
        coulomb = space.largest(np.array([space.laws.largest_slope])) > 0.0
        if not coulomb or norm(end.left) <= DRIFT * norm(self.joint.e):
            return False
        moved = self.joint.rigid.spread(end.alpha)
        closing = [
            moved[entries][: interface.m].max(initial=0.0)
            for interface, entries in space.with_slices()
        ]
        return space.largest(np.array(closing)) <= STOPPED * space.largest(np.abs(moved))

    def _look(self, at: Iterate) -> Iterate:
        """The same forces with gaps that are computed anew. Collective."""
        s, _, alpha, _ = at.point
        product = self.joint.solved if self.refined else self.joint.product
        self.joint.take(s)
        r = product(s, "newton") + self.joint.offset - self.joint.d - self.joint.rigid.spread(alpha)
        if self._modelled:
            self._modelled.refine()
        looked = self._measured(Point(s, r, alpha, self.joint.imbalance(s, alpha)))
        return looked._replace(error=at.error, guess=at.guess)

    def _settle(self) -> None:
        """Move the forces onto their bounds, so that they obey all of them exactly; forces that are rounding become
        zero. Collective."""
        space, (s, r, *_) = self.joint.space, self._at.point
        s = space.laws.settle(s, space.laws.active_sets(s - self.preconditioner.c * r))
        for _, entries in space.with_slices():
            if np.abs(s[entries]).max(initial=0.0) <= self.nothing:
                s[entries] = 0.0
        self._move(self._at.point._replace(s=s))

    def _move(self, point: Point) -> None:
        """Go to a point whose gaps must still follow. Collective."""
        self._at = self._at._replace(point=point, size=self._size(point.s), misfit=None)

    def _measured(self, point: Point) -> Iterate:
        """The iterate at a point. Collective."""
        point = self.joint.soften(point)
        return Iterate(point, self._size(point.s), self._misfits([point])[0])

    def _size(self, s: np.ndarray) -> float:
        """The size (N) with which forces are compared: their own, or the least. Collective."""
        return max(self.joint.space.norm(s), self._least)

    def _misfits(self, points: Iterable[Point]) -> list[float]:
        """The norms (N) of the residuals of all equations at some points.

        The residuals are s − P(s − c r) and e − G s − K α. All points in one reduction. Collective.
        """
        space = self.joint.space
        c = self.preconditioner.c
        points = [*map(self.joint.closed, points)]
        contact = space.norms([s - space.laws.project(s - c * r) for s, r, *_ in points])
        return [
            math.hypot(of_laws, norm(point.left))
            for of_laws, point in zip(contact, points, strict=True)
        ]

    def _newton_step(
        self, at: Iterate, by: Regularisation, stalled: int, full: bool, tolerance: float
    ) -> Iterate:
        """Go towards the forces that the active sets of the iterate imply, as far as it helps, or `full` steps; stay
        where the step only tells that the iterate is an answer. Collective."""
        model, change = self._modelled, None
        if (
            model and by.shared == 1.0 and not by.precise and not stalled % 2
        ):  # every other stalled step has no model
            change = model.step(at.point, at.residual, at.size, at.guess)
        if change is None:
            if model and model.rough:  # which may be why the model failed
                at = self._look(at)
            change = self.direction(at.point, *self._linearised(at), by=by)
        misfit, length = self._length(at, change, GROWTH / by.shared if full else GAIN)
        point = self.joint.soften(at.point.along(change, length))
        after = Iterate(point, self._size(point.s), misfit)
        if after.residual <= at.residual or at.residual > tolerance:
            return after
        # Around a loop of sticking contacts gaps sum up to what the tolerance has left of them in the load step before.
        # No force closes this sum, so that each step moves the forces farther along the loop. The full step is the error
        # of the iterate.
        stays = at._replace(error=self._sizes(change)[1] / (at.size or 1.0))
        return stays if stays.is_answer(tolerance) else after

    def _linearised(self, at: Iterate) -> tuple[Linearised, np.ndarray, np.ndarray, np.ndarray]:
        """What `direction` takes, for the status of nodes that the iterate has. Collective."""
        space, c, (s, r, *_) = self.joint.space, self.preconditioner.c, at.point
        if at.guess:  # slip bounds do not follow guessed pressures
            active = space.laws.sticking(*self._first_guess(at))
            linearised = Linearised.of(space.laws.linearise(active)).frozen(0.0 * s)
        else:
            active = space.laws.active_sets(s - c * r)
            linearised = Linearised.of(space.laws.linearise(active))
        # Nodes that slip in space turn their friction against springs κ/c: r + (κ/c) s = 0 across it, for the new
        # forces s + move + E y. Both tangents of a node have the same κ/c, so it needs no turning.
        move, layer = linearised.move(s), linearised.spring / c
        return linearised, move, -layer * (s + move), layer

    def direction(
        self,
        point: Point,
        linearised: Linearised,
        change: np.ndarray,
        wanted: np.ndarray,
        layer: np.ndarray,
        by: Regularisation,
    ) -> Point:
        """The change of `point` with which r + D y = `wanted` along unknown forces, and G s + K α = e.

        Parameters
        ----------
        linearised : all forces by the unknown ones y
        change : (size,) first change of the forces (N); y comes on top of it
        wanted : (size,) right-hand side (m): μ/s of a barrier μ, −D s of springs
        layer : D (size,) in m/N, in the turned frames of the unknown forces
        by : what steers, and the precision

        Collective. Raises SolverError.
        """
        joint, rigid, space = self.joint, self.joint.rigid, self.joint.space
        alpha, C_change = np.zeros(rigid.size), np.zeros_like(change)
        problem, y = None, np.zeros(linearised.number)
        # springs let free bodies move
        if (by.precise and rigid.size) or space.any(np.ones(linearised.number)):
            direct = self.direct.direction(point, linearised, change, wanted, layer, by)
            if direct is not None:
                return direct
            problem = LinearProblem(joint, self.preconditioner, linearised, layer, by)
            if rigid.size:
                # forces that balance the loads with the least energy of half-spaces; then h = 0
                y, alpha = problem.precondition(
                    np.zeros_like(y), joint.imbalance(point.s + change, point.alpha)
                )
                change = change + linearised.expand(y)
        if space.any(change):
            C_change = joint.product(change, "newton")
        if problem:
            more = np.zeros_like(y)
            with joint.exchange.deferred():
                # Iᵀ (C Δs − Gᵀ Δα) + D y = Iᵀ (wanted − r), less the parts of `change`, y and α so far
                right = linearised.restrict(wanted - point.r - C_change + rigid.spread(alpha))
                right -= layer[linearised.unknown] * y
                more, turn, iterations = problem.solve(right)
                alpha = alpha + turn
                self.inner_steps["gmres"] += iterations
                self.direct.long |= iterations > LONG
            dy = linearised.expand(more)
            change, C_change = change + dy, C_change + joint.product(dy, "newton")
        left = joint.imbalance(point.s + change, point.alpha + alpha) - point.left
        return Point(change, C_change - rigid.spread(alpha), alpha, left)

    def _length(self, at: Iterate, change: Point, most: float) -> tuple[float, float]:
        """The smallest misfit (N) and the length of the step to it; those of the full step if this leaves at most the
        fraction `most`."""

        def misfits(lengths: Sequence[float]) -> list[float]:
            return self._misfits(at.point.along(change, length) for length in lengths)

        assert at.misfit is not None
        # r is linear in s, so that no length takes another product with C
        full = misfits(LENGTHS[:1])
        if at.guess or full[0] <= most * at.misfit:
            return full[0], LENGTHS[0]
        return min(zip(full + misfits(LENGTHS[1:]), LENGTHS, strict=True))

    def body_forces(self) -> list[np.ndarray]:
        return self.joint.exchange.spread(self.forces)

    def linearisation(self) -> Linearisation:
        """The equations at the present forces, for the derivatives of the answer. Collective."""
        return Linearisation(self.joint, self.preconditioner, self._at.point)

    def negligible(self, fraction: float, tolerance: float) -> float:
        """This fraction of the largest force, or what the `tolerance` allows forces that are smaller than the least
        size to be wrong (N). Collective.

        Forces that would close the gaps themselves tell nothing: stiff bodies far apart have small forces beside them.
        """
        return max(fraction * self.joint.space.largest(self.forces), tolerance * self._least)

    def shift(self, way: np.ndarray, tolerance: float) -> None:
        """Move the bodies on by the motions `way` (rigid.size,), which no force resists; stay where the equations would
        hold neither to the `tolerance` nor as well as before. Collective."""
        at, (s, r, alpha, _) = self._at, self._at.point
        alpha = alpha + way
        moved = Point(s, r - self.joint.rigid.spread(way), alpha, self.joint.imbalance(s, alpha))
        before, after = self._misfits([at.point, moved])
        if after <= max(before, tolerance * at.size):
            self._move(moved)

    def refresh(self, u: list[np.ndarray]) -> None:
        """Nothing to do: the gaps are computed afresh where the iteration goes on."""

    def state(self) -> dict[str, Any]:
        return self._at.point._asdict() | {
            "wanted": self._wanted,
            "least": self._least,
            "error": self._at.error,
            "inner_steps": dict(self.inner_steps),
            "long": self.direct.long,
            "history": tuple(self.history),
        }

    def restore(self, state: dict[str, Any]) -> None:
        self._wanted, self._least = state["wanted"], state["least"]
        self._at = self._at._replace(error=state["error"], guess="")
        self._move(Point(*(state[name] for name in Point._fields)))
        self.direct.long = state["long"]
        self.inner_steps.update(state["inner_steps"])  # in which the model counts, too
        self.history = [Step(*row) for row in state["history"]]
