"""The default outer method: a semi-smooth Newton method on the contact forces of the interfaces.

The unknowns are the contact forces s, equal and opposite on the two bodies, and the rigid motions α of loose bodies.
The gaps are r = C s − d − Gᵀα (see `Joint`). With the projection P of the laws of contact and friction
(`ddmpi.interface.law`), the equations are

    s = P(s − c r) for any c > 0,        G s + K α = e

(Alart and Curnier 1991; Christensen, Klarbring, Pang and Strömberg 1998). A step is that of the primal–dual active set
method: P says which nodes are open, slip and stick, and GMRES solves the linear problem of these active sets
(`ddmpi.methods.krylov`). r is linear in s, so the residual along the step costs no multiplication; the length of the
step minimizes it, which stops the active sets from cycling. Where steps stall, a path of easier problems leads to a
point from which they converge (`ddmpi.methods.paths`).
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from ddmpi.coupling.joint import Joint, Point
from ddmpi.methods.dense import LONG, Direct
from ddmpi.methods.half_space import MODEL_STEPS, Model, Modelled
from ddmpi.methods.krylov import (
    Linearised,
    LinearProblem,
    Preconditioner,
    Regularisation,
    forcing,
)
from ddmpi.methods.linear import Linearisation
from ddmpi.methods.outer import Outer, Report, Step, no_report
from ddmpi.methods.paths import DRIFT, NEAR, STOPPED, InteriorPoints, Path, Softening
from ddmpi.petsc.events import event
from ddmpi.system.numbers import norm

log = logging.getLogger("ddmpi")

LENGTHS = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05, 0.02)
"""Lengths of a Newton step; the others are tried only if the full one gains too little, see GAIN."""

GAIN = 0.7
"""The full step is taken if it leaves at most this fraction of the residual."""

PATIENCE, PROGRESS = 3, 0.7
"""A path begins after PATIENCE steps in a row that leave more than PROGRESS of the smallest residual. Newton's steps
from a point of a path go on as long as each leaves at most PROGRESS of the residual."""

PATHS: tuple[type[Path], ...] = InteriorPoints, Softening
"""The paths in the order in which they are tried with loose bodies. Without loose bodies the reversed order takes
half the steps."""

FULL_STEPS, GIVEN_STEPS, GROWTH = 12, 3, 3.0
"""The first FULL_STEPS steps in space skip the line search unless the residual grows by GROWTH: while friction turns, a
line search takes a quarter more steps. In the plane without Coulomb friction the first GIVEN_STEPS skip it, as full
steps seldom cycle there. With a model of the compliance no step does."""

ERROR = 10.0
"""The forces have converged when their estimated error is below this times the tolerance."""

NEGLECTED = 0.01
"""Error of a product by an iterative solver that is kept, over the error that the tolerance allows."""

NO_FORCE = 1e-6
"""Forces are compared with at least this fraction of those that would close the free gaps of half-planes, and of the
loads on a loose body, whose resultant e may be rounding. Without any contact they are compared with these loads."""

SPLIT, SOFTER, SOFTEST, NEARLY = 20.0, 1e-3, 1e-6, 1e-3
"""Contacts at one node share a force in many ways, or where meshes nearly match in one way, with parts that are much
larger than the force. Once nothing else changes, any way is taken that leaves a residual of SPLIT times the tolerance.
Where more is left, but less than NEARLY, the compliances that steer these parts get softer by SOFTER, down to SOFTEST."""


class Newton(Outer):
    """The semi-smooth Newton method.

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
        self.joint, self.space, self.max_iterations, self.report = (
            joint,
            joint.space,
            max_iterations,
            report,
        )
        self.inner_steps = {"gmres": 0}
        self.checkpoint: Callable[[], None] = lambda: None
        self.hopeless: Callable[[], bool] = lambda: False
        self.refined = False
        self._laws = self.space.laws
        self._c = np.concatenate(
            [np.empty(0), *(interface.stiffness for interface in self.space.interfaces)]
        )
        self._coulomb = self.space.largest(np.array([self._laws.largest_slope])) > 0.0
        self._in_space = (
            self.space.largest(np.array([float(law.components) for law in self._laws.laws])) > 1.0
        )
        self._preconditioner = preconditioner or Preconditioner(joint, self._c, self._in_space)
        self._shares = self.space.any(self._preconditioner.shared > 0.0)
        self._full = FULL_STEPS if self._in_space else 0 if self._coulomb else GIVEN_STEPS
        self._modelled: Modelled | None = None
        if joint.dear:
            self._full, model = (
                0,
                Newton(Model(joint), MODEL_STEPS, preconditioner=self._preconditioner),
            )
            self._modelled, model.inner_steps = Modelled(joint, model), self.inner_steps
        self._wanted = self._least_size = self.nothing = 0.0
        self.direct = Direct(joint, self._preconditioner)
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
        joint = self.joint
        if warm:
            s, r, alpha = warm
            if joint.rigid.size and joint.stays.held.size:  # a prediction may have moved them
                before, alpha = alpha, joint.stays.settled(alpha)
                r = r - joint.rigid.spread(alpha - before)
            self._at = Point(s, r, alpha, joint.imbalance(s, alpha))
        else:
            self._at = joint.at_rest()
        self._measured: tuple[np.ndarray | None, float] = (None, 0.0)
        self._before = self._norm()
        self._warm = warm is not None and self.space.any(self._pressed())
        self._path: Path | None = None
        self._paths = list(PATHS if len(joint.e) else PATHS[::-1])  # not tried yet
        self._ends: list[Point] = []  # of the paths that failed
        self._trying = False  # whether steps are Newton's own, from the path's point
        self._misfit: float | None = None  # `_misfits` of the iterate
        wanted = NO_FORCE * max(self.space.norm(self._c * joint.d), norm(joint.e))
        touching = self.space.any(np.ones(joint.size))
        loads = (NO_FORCE if touching else 1.0) * joint.load
        self._wanted = max(self._wanted, wanted)
        self._least_size = max(self._wanted, loads)  # a load may be small after a large one
        # from guessed active sets (_start) the iteration cannot end; from a prediction one step must estimate the error
        self._start, self._settled, self._error = not foreseen, False, math.inf if foreseen else 0.0
        self._stalled, self._smallest, self._full_until = 0, np.inf, self._full
        self._shared, self._splits = 1.0, False  # see `_see_to_shares`
        self._asked = False
        self.history: list[Step] = []

    def _pressed(self) -> np.ndarray:
        """The nodes (m,) bool of all interfaces that are under pressure."""
        return np.concatenate(
            [
                np.empty(0, bool),
                *(
                    self._at.s[entries][: interface.m] > 0.0
                    for interface, entries in self.space.with_slices()
                ),
            ]
        )

    def _first_guess(self) -> tuple[np.ndarray, np.ndarray]:
        """The nodes (m,) bool that the first step takes as closed, and those onto which a body falls. Collective.

        A warm start closes the nodes under pressure. Contacts of loose bodies that have none, as where a body lay
        without a load, begin as without a warm start: else nothing but springs would hold the body in this step.
        """
        pressed = self._pressed()
        if not self._warm:
            return self.joint.first_closed()
        if not self.joint.rigid.size:
            return pressed, np.zeros(len(pressed), bool)
        closed, falls = self.joint.first_closed()
        begin = 0
        for interface in self.space.interfaces:
            nodes = slice(begin, begin + interface.m)
            if pressed[nodes].any():
                closed[nodes], falls[nodes] = pressed[nodes], False
            begin += interface.m
        return closed, falls

    @property
    def forces(self) -> np.ndarray:
        return self._at.s

    @property
    def motions(self) -> np.ndarray:
        return self._at.alpha

    @property
    def bound(self) -> np.ndarray:
        return self._laws.bound_at(self._at.s)

    def run(self, tolerance: float) -> str:
        """Iterate until the residual of the equations is below `tolerance` times the forces, and their error too.

        The residual understates the error where a body is stiffer than a half-plane, as a thin incompressible layer.
        The estimated error is the change of a step times the fraction of the residual that it left. Otherwise as
        `Outer.run`.
        """
        if self._settled:  # the forces were moved onto their bounds; the gaps must follow
            self.joint.neglected = NEGLECTED * tolerance * self._size()
            self._settled, self._misfit = False, self._look()
        while not (end := self._end(tolerance)):
            self._iterate(tolerance)
            if self._is_hopeless():
                return "stalled"
        return end

    def _end(self, tolerance: float) -> str:
        """Why the iteration ends at the iterate, as `run` returns it; empty where it goes on. Collective."""
        residual, done = self._judge(tolerance)
        finite = bool(np.isfinite(residual))
        if not self.history and (done or not finite):
            self._note(residual, 0.0)
        if not finite:
            return "diverged"
        balanced = done and self.joint.balances(self._at.left, self._size())
        if balanced or len(self.history) >= self.max_iterations:
            self._settle()
            return "converged" if done else "max_iterations"
        if self._path and not self._trying and self._path.failed and not self._next_path():
            return "drift" if self._drifts() else "stalled"
        return ""

    def _judge(self, tolerance: float) -> tuple[float, bool]:
        """The residual of the iterate, its misfit over the forces, and whether the iterate is an answer. Collective."""
        while True:
            if self._misfit is None:
                self._misfit = self._misfits([self._at])[0]
            residual = self._relative(self._misfit)
            done = self._is_done(residual, tolerance)
            if not (done and self._rough):
                return residual, done
            self._misfit = self._look()  # the gaps were only as precise as the step needed

    def _is_done(self, residual: float, tolerance: float) -> bool:
        """Whether residual and estimated error are small; guessed active sets may fit by chance."""
        guessed = self._start and residual > 0.0
        exact = residual <= tolerance and self._error <= ERROR * tolerance and not guessed
        return exact or (self._splits and residual <= SPLIT * tolerance)

    def _is_hopeless(self) -> bool:
        """Whether a path has begun that cannot lead to an answer, as there is none; asked once. Collective."""
        begins = self._path is not None and not self._asked
        self._asked |= begins
        return begins and self.hopeless()

    def _drifts(self) -> bool:
        """Whether bodies move on and on under loads that friction does not balance, and not into a partner."""
        if not self._coulomb or norm(self._at.left) <= DRIFT * norm(self.joint.e):
            return False
        moved = self.joint.rigid.spread(self._at.alpha)
        closing = [
            moved[entries][: interface.m].max(initial=0.0)
            for interface, entries in self.space.with_slices()
        ]
        return self.space.largest(np.array(closing)) <= STOPPED * self.space.largest(np.abs(moved))

    @property
    def _rough(self) -> bool:
        """Whether the gaps of the iterate are only as precise as a step by the model needs."""
        return self._modelled is not None and self._modelled.rough

    def _look(self) -> float:
        """Compute the gaps of the iterate anew; return its `_misfits` then (N). Collective."""
        product = self.joint.solved if self.refined else self.joint.product
        r = product(self._at.s, "newton") - self.joint.d - self.joint.rigid.spread(self._at.alpha)
        self._at = self._at._replace(r=r, left=self.joint.imbalance(self._at.s, self._at.alpha))
        if self._modelled:
            self._modelled.refine()
        return self._misfits([self._at])[0]

    def _iterate(self, tolerance: float) -> None:
        """One step of Newton's method or of a path. Collective."""
        assert self._misfit is not None
        residual = self._relative(self._misfit)
        self._count_gains(residual)
        before = self._at
        self.joint.neglected = NEGLECTED * tolerance * self._size()
        if self._stalled >= PATIENCE and not self._path:  # active sets cycle
            self._next_path()
        path = None if self._trying else self._path
        stage = path.stage if path else ""
        with event("NewtonStep"):
            self._misfit = self._follow(path) if path else self._newton_step(self._misfit)
        self._start = False
        after, size = self._relative(self._misfit), self._size()
        update = self.space.norm(self._at.s - before.s) / size if size else 0.0
        self._splits = False
        if self._shares and not self._path and after > PROGRESS * residual:
            self._see_to_shares(before, after, tolerance)
        if not update:
            self._stalled = PATIENCE  # the next step would be the same
        # as if the next step shrank like the residual
        self._error = update * after / residual if residual else 0.0
        self._note(after, update, stage)
        if self._trying and not stage and not after <= PROGRESS * residual:
            self._go_back()

    def _see_to_shares(self, before: Point, residual: float, tolerance: float) -> None:
        """After a step from `before` that gained little: see whether nothing has changed but how contacts share the
        forces of nodes; where the `residual` is more than that may leave, soften what steers these. Collective."""
        at, shared = self._at, self._preconditioner.shared > 0.0
        # of forces that contacts share counts what they do to gaps
        change = np.where(shared, self._c * (at.r - before.r), at.s - before.s)
        self._splits = self.space.norm(change) <= SPLIT * tolerance * self._size()
        if SPLIT * tolerance < residual < NEARLY and self._shared > SOFTEST:
            self._shared *= SOFTER
            # the parts may be large on the way, so that full steps gain nothing at first
            self._stalled, self._full_until = 0, len(self.history) + 1 + PATIENCE

    def _count_gains(self, residual: float) -> None:
        """Count Newton's steps that gain little, but neither full steps nor steps of a path."""
        if residual < PROGRESS * self._smallest:
            self._stalled, self._smallest = 0, residual
        elif self._path:
            self._stalled = 0
        elif not self._takes_full_steps:
            self._stalled += 1

    def _follow(self, path: Path) -> float:
        """One step of the `path`; returns `_misfits` of its point, of the equations without layer or barrier (N)."""
        path.step(self.direction)
        self._at = path.point
        misfit = self._misfits([self._at])[0]
        near = path.kind == "softening" or self._relative(misfit) < NEAR
        self._trying = path.ready and near and not path.failed
        return misfit

    def _go_back(self) -> None:
        """Go back to where the path was left, and go on along it, as Newton's own steps do not converge. Collective."""
        assert self._path
        self._trying, self._at = False, self._path.point
        self._path.go_on()
        self._misfit = self._misfits([self._at])[0]

    @property
    def _takes_full_steps(self) -> bool:
        """Whether steps are full even if they gain nothing."""
        return not self._path and not self._stalled and len(self.history) < self._full_until

    def _next_path(self) -> bool:
        """Begin the next path and return True. If none is left, go to the end of the path on which bodies moved
        farthest, whose imbalance shows which bodies drift, and return False. Collective."""
        if self._path:
            self._ends.append(self._path.point)
        if not self._paths:
            self._at = max(
                self._ends, key=lambda end: self.space.largest(self.joint.rigid.spread(end.alpha))
            )
            return False
        self._path = self._paths.pop(0)(self.joint, self._c, self._before)
        return True

    def _settle(self) -> None:
        """Move the forces onto their bounds, so that they obey all of them exactly; forces that are rounding become
        zero."""
        s, r, *_ = self._at
        s = self._laws.settle(s, self._laws.active_sets(s - self._c * r))
        for _, entries in self.space.with_slices():
            if np.abs(s[entries]).max(initial=0.0) <= self.nothing:
                s[entries] = 0.0
        self._at = self._at._replace(s=s)
        self._settled = True

    @property
    def _by(self) -> Regularisation:
        """How the linear problem of the next step is steered, and how precisely it is solved."""
        if self._path:
            return self._path.by
        return Regularisation(
            shared=self._shared,
            forcing=forcing([step.residual for step in self.history], self._in_space),
        )

    def _note(self, residual: float, update: float, stage: str = "") -> None:
        step = Step(
            len(self.history) + 1,
            update,
            residual,
            self._by.forcing,
            self.joint.multiplications(),
            stage,
        )
        self.history.append(step)
        self.report(step)

    def _relative(self, residual: float) -> float:
        size = self._size()
        return residual / size if size else 0.0

    def _size(self) -> float:
        """The size (N) with which forces are compared: their own, or the least."""
        return max(self._norm(), self._least_size)

    def _norm(self) -> float:
        """‖s‖ (N), with one reduction for each iterate."""
        if self._measured[0] is not self._at.s:
            self._measured = self._at.s, self.space.norm(self._at.s)
        return self._measured[1]

    def _misfits(self, points: Iterable[Point]) -> list[float]:
        """The norms (N) of the residuals of all equations at some points.

        The residuals are s − P(s − c r) and e − G s − K α. All points in one reduction. Collective.
        """
        points = list(points)
        contact = self.space.norms([s - self._laws.project(s - self._c * r) for s, r, *_ in points])
        return [
            math.hypot(of_laws, norm(point.left))
            for of_laws, point in zip(contact, points, strict=True)
        ]

    def _newton_step(self, misfit: float) -> float:
        """Solve for the forces that the active sets of the iterate imply, and go towards them as far as it helps.

        It takes and returns `_misfits` of the iterate (N).
        """
        change = None
        if (
            self._modelled and not self._path and not self._stalled % 2
        ):  # every other stalled step has no model
            change = self._modelled.step(
                self._at, self._relative(misfit), self._size(), self._start, self._warm
            )
        if change is None:
            if self._rough:  # which may be why the model failed
                misfit = self._look()
            s, r, *_ = self._at
            active = self._laws.active_sets(s - self._c * r)
            if self._start:  # guess the active sets
                active = self._laws.sticking(*self._first_guess())
            linearised = Linearised.of(self._laws.linearise(active))
            if self._start:  # slip bounds do not follow guessed pressures
                linearised = linearised.frozen(0.0 * s)
            # Nodes that slip in space turn their friction against springs κ/c: r + (κ/c) s = 0 across it, for the new
            # forces s + move + E y. Both tangents of a node have the same κ/c, so it needs no turning.
            move, layer = linearised.move(s), linearised.spring / self._c
            change = self.direction(self._at, linearised, move, -layer * (s + move), layer)
        misfit, length = self._length(misfit, change)
        self._at = self._at.along(change, length)
        return misfit

    def direction(
        self,
        point: Point,
        linearised: Linearised,
        change: np.ndarray,
        wanted: np.ndarray,
        layer: np.ndarray,
    ) -> Point:
        """The change of `point` with which r + D y = `wanted` along unknown forces, and G s + K α = e.

        Parameters
        ----------
        linearised : all forces by the unknown ones y
        change : (size,) first change of the forces (N); y comes on top of it
        wanted : (size,) right-hand side (m): μ/s of a barrier μ, −D s of springs
        layer : D (size,) in m/N, in the turned frames of the unknown forces

        Collective. Raises SolverError.
        """
        joint, rigid, space = self.joint, self.joint.rigid, self.space
        alpha, C_change = np.zeros(rigid.size), np.zeros_like(change)
        problem, y = None, np.zeros(linearised.number)
        if (self._path and rigid.size) or space.any(
            np.ones(linearised.number)
        ):  # springs let free bodies move
            by = self._by
            direct = self.direct.direction(point, linearised, change, wanted, layer, by)
            if direct is not None:
                return direct
            problem = LinearProblem(joint, self._preconditioner, linearised, layer, by)
            if (
                rigid.size
            ):  # forces that balance the loads with the least energy of half-spaces; then h = 0
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

    def _length(self, misfit: float, change: Point) -> tuple[float, float]:
        """The smallest misfit (N) and the length of the step to it; those of the full step if it gains enough."""

        def misfits(lengths: Sequence[float]) -> list[float]:
            return self._misfits(self._at.along(change, length) for length in lengths)

        full = misfits(
            LENGTHS[:1]
        )  # r is linear in s, so that no length takes another product with C
        if self._start or full[0] <= (GROWTH if self._takes_full_steps else GAIN) * misfit:
            return full[0], LENGTHS[0]
        return min(zip(full + misfits(LENGTHS[1:]), LENGTHS, strict=True))

    def body_forces(self) -> list[np.ndarray]:
        return self.joint.exchange.spread(self._at.s)

    def linearisation(self) -> Linearisation:
        """The equations at the present forces, for the derivatives of the answer. Collective."""
        return Linearisation(self.joint, self._preconditioner, self._at, self._c)

    @property
    def gaps(self) -> np.ndarray:
        """(size,) the gaps under the present forces (m)."""
        return self._at.r

    def negligible(self, fraction: float, tolerance: float) -> float:
        """This fraction of the largest force, or what the `tolerance` allows forces that are smaller than the least
        size to be wrong (N). Collective.

        Forces that would close the gaps themselves tell nothing: stiff bodies far apart have small forces beside them.
        """
        return max(fraction * self.space.largest(self._at.s), tolerance * self._least_size)

    def shift(self, way: np.ndarray, tolerance: float) -> None:
        """Move the bodies on by the motions `way` (rigid.size,), which no force resists; stay where the equations would
        hold neither to the `tolerance` nor as well as before. Collective."""
        s, r, alpha, _ = self._at
        alpha = alpha + way
        moved = Point(s, r - self.joint.rigid.spread(way), alpha, self.joint.imbalance(s, alpha))
        before, after = self._misfits([self._at, moved])
        if after <= max(before, tolerance * self._size()):
            self._at, self._misfit = moved, None

    def refresh(self, u: list[np.ndarray]) -> None:
        """Nothing to do: the gaps are computed afresh where the iteration goes on."""

    def state(self) -> dict[str, Any]:
        return self._at._asdict() | {
            "least": (self._wanted, self._least_size),
            "inner_steps": dict(self.inner_steps),
            "long": self.direct.long,
            "history": tuple(self.history),
        }

    def restore(self, state: dict[str, Any]) -> None:
        self._at = Point(*(state[name] for name in Point._fields))
        self._wanted, self._least_size = state["least"]
        self.direct.long = state["long"]
        self.inner_steps.update(state["inner_steps"])  # in which the model counts, too
        self.history = [Step(*row) for row in state["history"]]
