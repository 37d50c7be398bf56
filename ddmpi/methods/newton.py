"""The default outer method: a semi-smooth Newton method on the contact forces of the interfaces.

The two bodies at an interface carry the same forces s, so these cancel from the start; what is sought is the s for
which the gaps r = C s − d − Gᵀα fit the forces. The laws of contact and friction (`ddmpi.interface.law`) make
equations of this (Alart and Curnier 1991; Christensen, Klarbring, Pang and Strömberg 1998). The Newton step is the
primal–dual active set step: the projections say which nodes are open, slip and stick, and GMRES solves the linear
problem that follows, preconditioned with the stiffness of half-planes. Since r is linear in s, the residual of the
equations is known along the whole step without a further multiplication, and the step is as long as makes it
smallest: this stops the active sets from cycling. Where that gets nowhere, successive approximations move the iterate
(`ddmpi.methods.rescue`).

Bodies that no clamp holds have rigid motions α: unknowns with an equation each, G s = e, in every step.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Sequence
from typing import Any

import numpy as np

from ddmpi.coupling.joint import Joint
from ddmpi.methods.half_plane import HalfPlaneStiffness, smooth_modes
from ddmpi.methods.krylov import FORCING, LinearProblem, Preconditioner
from ddmpi.methods.outer import Report, Step, no_report, steps_of
from ddmpi.methods.rescue import Rescue
from ddmpi.petsc.events import event
from ddmpi.system.numbers import norm

log = logging.getLogger("ddmpi")

LENGTHS = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05, 0.02)
"""Lengths of the Newton step that are tried; the full one is taken at once if it gains enough."""

GAIN = 0.7
"""The full step is taken when it reduces the residual to this or less."""

PATIENCE, PROGRESS = 6, 0.7
"""A rescue begins after so many steps that together leave more than this of the smallest residual."""

ERROR = 10.0
"""The forces are converged when the error estimated for them is below this times the tolerance."""

NEGLECTED = 0.01
"""Where the compliance is applied by an iterative solver: the error of a product that is kept, as a share of the error
that is asked for."""

NO_FORCE = 1e-6
"""Forces below this part of those that would close the free gaps in a half-plane are compared with these instead."""

HELD_LOOSELY = 1e-6
"""Stiffness of springs that steer rigid motions, over the plane modulus; from 0 to 1e-4 they change no count."""

SHARED = 1e-3
"""Compliance that steers forces at nodes which several contacts share, over that of a half-plane. Without it six of 27
walls fail; it must not be in the equations, where it would change displacements by 1e-2."""

SMOOTH = 0.75
"""Deformations in which a body gives way more than this times what half-planes do are coarse modes: two to five of a
compact body. At 1, walls take a tenth to a quarter more multiplications."""

MANY = 3
"""Coarse modes serve from so many bodies on, and wherever bodies are loose."""


class Newton:
    """The iteration; see `ddmpi.methods.outer.Outer` for what it has in common with others.

    Parameters
    ----------
    joint : the operator of all bodies
    max_iterations : most steps
    report : called with every Step

    Attributes
    ----------
    forces : (size,) contact forces (N)
    history : the steps of the present load step; `residual` is that of the equations over the forces
    nothing : nodal forces that are rounding beside those of the load steps before (N)
    """

    def __init__(self, joint: Joint, max_iterations: int, report: Report = no_report) -> None:
        self.joint, self.space, self.max_iterations, self.report = joint, joint.space, max_iterations, report
        self.inner_steps = {"gmres": 0, "mprgp": 0}
        self.checkpoint: Callable[[], None] = lambda: None
        self._laws = self.space.laws
        self._c = self.space.spread([0.5 * interface.modulus for interface in self.space.interfaces])
        self._preconditioner = precondition(joint, self._c)
        self._stiffness = self.space.largest(self._c)
        self._least = 0.0
        self.nothing = 0.0
        self.begin()

    def begin(self, warm: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None, foreseen: bool = False) -> None:
        """Begin a load step, for the present loads of the joint. Collective.

        The first step of Newton's method takes the nodes under pressure as closed and all of them as sticking, which
        is right at a reversal, where warm starts from slipping nodes cycle; without forces, what `Joint.first_closed`
        says.

        Parameters
        ----------
        warm : forces s (size,), gaps r (size,) and motions α of the step before under the present loads; None for none
        foreseen : they are a guess of this step's, and nodes are closed and slip as they say
        """
        joint = self.joint
        self._s: np.ndarray
        self._r: np.ndarray
        self._alpha: np.ndarray
        self._s, self._r, self._alpha = warm or (np.zeros(joint.size), -joint.d, np.zeros(joint.rigid.size))
        self._warm = warm is not None and self.space.any(self._pressed())
        self._left = joint.imbalance(self._s)
        self._rescue = Rescue(joint, self._stiffness)
        self._measured: tuple[np.ndarray | None, float] = (None, 0.0)
        self._far: float | None = None  # `_distances` of the iterate
        self._least = max(self._least, NO_FORCE * max(self.space.norm(self._c * joint.d), norm(joint.e)))
        self._start, self._settled, self._error = not foreseen, False, math.inf if foreseen else 0.0
        if foreseen:
            self._rescue.remember(self._s, self._alpha)
        self._stalled, self._smallest = 0, np.inf
        self.history: list[Step] = []

    def _pressed(self) -> np.ndarray:
        """The nodes (m,) bool of all interfaces that are under pressure."""
        return np.concatenate([np.empty(0, bool), *(self._s[part][:interface.m] > 0.0
                                                    for interface, part in self.space.each())])

    @property
    def forces(self) -> np.ndarray:
        return self._s

    @property
    def motions(self) -> np.ndarray:
        """Rigid motions α (joint.rigid.size,) of loose bodies (m)."""
        return self._alpha

    qp_type = "python"

    @property
    def mismatch(self) -> np.ndarray:
        """Zero: both bodies carry the same forces."""
        return np.zeros(self.joint.size)

    @property
    def bound(self) -> np.ndarray:
        return self._laws.bound_at(self._s)

    def run(self, tolerance: float) -> str:
        """Iterate until the residual of the equations is below `tolerance` times the forces, and their error too.

        The residual understates the error where a body is stiffer than a half-plane (a thin incompressible
        layer). So the error is estimated as well: what a step changed, times what it left of the residual.
        Otherwise as `Outer.run`.
        """
        if self._settled:  # the forces were moved onto their bounds; the gaps must follow
            self.joint.neglected = NEGLECTED * tolerance * self._size()
            self._follow(self.joint.product(self._s, "newton"))
            self._settled, self._far = False, None
        while True:
            self.checkpoint()
            if self._far is None:
                self._far = self._distances([(self._s, self._r, self._left)])[0]
            far = self._far
            residual = self._relative(far)
            done = (residual <= tolerance and self._error <= ERROR * tolerance
                    and not (self._start and residual > 0.0))
            if (done or not np.isfinite(residual)) and not self.history:
                self._note(residual, 0.0)
            if not np.isfinite(residual):
                return "diverged"
            if self._rescue.drifts:
                return "drift"
            if done or len(self.history) >= self.max_iterations:
                self._settle()
                return "converged" if done else "max_iterations"
            self._far = self._iterate(far, tolerance)

    def _iterate(self, far: float, tolerance: float) -> float:
        """One step, of Newton's method or of a rescue, from and to where `_distances` is `far` and what is returned."""
        residual = self._relative(far)
        gained = residual < PROGRESS * self._smallest
        self._stalled = 0 if gained or self._rescue.left else self._stalled + 1
        self._smallest = residual if gained else self._smallest
        before = self._s
        self.joint.neglected = NEGLECTED * tolerance * self._size()
        if self._stalled >= PATIENCE:
            self._s, self._alpha = self._rescue.begin(self._s, self._alpha)
            self._stalled, self._smallest = 0, np.inf
        if self._rescue.left:
            self._s, Cs, self._alpha, iterations = self._rescue.approximate(self._s, self._alpha, residual,
                                                                            self._size())
            self.inner_steps["mprgp"] += iterations
            self._follow(Cs)
            far = self._distances([(self._s, self._r, self._left)])[0]
        else:
            with event("NewtonStep"):
                far = self._newton_step(far)
        if self._start:
            self._rescue.remember(self._s, self._alpha)
        self._start = False
        after = self._relative(far)
        size = self._size()
        update = self.space.norm(self._s - before) / size if size else 0.0
        self._error = update * after / residual if residual else 0.0
        self._note(after, update)
        return far

    def _follow(self, Cs: np.ndarray) -> None:
        """Take the gaps and the imbalance afresh from the product C s (size,)."""
        self._r = Cs - self.joint.d - self.joint.rigid.spread(self._alpha)
        self._left = self.joint.imbalance(self._s)

    def _settle(self) -> None:
        """Move the forces onto their bounds, so that they obey all of them exactly; what is rounding becomes zero."""
        self._s = self._laws.settle(self._s, self._laws.active_sets(self._s - self._c * self._r))
        for _, part in self.space.each():
            if np.abs(self._s[part]).max(initial=0.0) <= self.nothing:
                self._s[part] = 0.0
        self._settled = True

    def _note(self, residual: float, update: float) -> None:
        step = Step(len(self.history) + 1, update, residual, FORCING, self.joint.multiplications())
        self.history.append(step)
        self.report(step)

    def _relative(self, residual: float) -> float:
        size = self._size()
        return residual / size if size else 0.0

    def _size(self) -> float:
        """What forces are compared with (N): themselves, unless they are next to nothing."""
        return max(self._norm(), self._least)

    def _norm(self) -> float:
        """‖s‖ (N), with one reduction for each iterate."""
        if self._measured[0] is not self._s:
            self._measured = self._s, self.space.norm(self._s)
        return self._measured[1]

    def _distances(self, points: Iterable[tuple[np.ndarray, np.ndarray, np.ndarray]]) -> list[float]:
        """The norms (N) of the residuals of all equations at forces s with gaps r and the imbalance `left`.

        Contact and friction want s = P(s − c r), loose bodies G s = e. All points in one reduction. Collective.
        """
        points = list(points)
        contact = self.space.norms([s - self._laws.project(s - self._c * r) for s, r, _ in points])
        return [math.hypot(each, norm(left)) for each, (_, _, left) in zip(contact, points, strict=True)]

    def _newton_step(self, far: float) -> float:
        """Solve for the forces that the active sets of the iterate imply, and go there as far as it helps.

        It takes and returns `_distances` of the iterate (N).
        """
        joint, rigid = self.joint, self.joint.rigid
        active = self._laws.active_sets(self._s - self._c * self._r)
        if self._start:  # nothing is known yet
            active = self._laws.sticking(self._pressed() if self._warm else joint.first_closed())
        linearised = self._laws.linearise(active)
        change = linearised.expand(self._s[linearised.unknown]) + linearised.given - self._s
        alpha, C_change = np.zeros(rigid.size), np.zeros_like(change)
        problem = None
        if self.space.any(linearised.unknown):
            problem = LinearProblem(joint, self._preconditioner, linearised)
            if rigid.size:  # the nearest forces by half-planes that balance the loads
                y, alpha = problem.precondition(np.zeros(linearised.number), joint.imbalance(self._s + change))
                change = change + linearised.expand(y)
        if self.space.any(change):
            C_change = joint.product(change, "newton")
        if problem:
            y = np.zeros(linearised.number)
            with joint.deferred():
                right = -(self._r + C_change - rigid.spread(alpha))[linearised.unknown]
                y, more, iterations = problem.solve(right)
                alpha = alpha + more
                self.inner_steps["gmres"] += iterations
            dy = linearised.expand(y)
            change, C_change = change + dy, C_change + joint.product(dy, "newton")
        left = joint.imbalance(self._s + change) - self._left
        r_change = C_change - rigid.spread(alpha)
        far, length = self._length(far, change, r_change, left)
        self._s = self._s + length * change
        self._r = self._r + length * r_change
        self._alpha = self._alpha + length * alpha
        self._left = self._left + length * left
        return far

    def _length(self, far: float, change: np.ndarray, r_change: np.ndarray,
                left: np.ndarray) -> tuple[float, float]:
        """The smallest residual (N) and the length of the step to it; the full one if it gains enough on `far`."""
        def there(lengths: Sequence[float]) -> list[float]:
            return self._distances((self._s + length * change, self._r + length * r_change, self._left + length * left)
                                   for length in lengths)

        full = there(LENGTHS[:1])
        if self._start or full[0] <= GAIN * far:
            return full[0], LENGTHS[0]
        return min(zip(full + there(LENGTHS[1:]), LENGTHS, strict=True))

    def body_forces(self) -> list[np.ndarray]:
        return self.joint.spread(self._s)

    def refresh(self, u: list[np.ndarray]) -> None:
        """Nothing to do: the gaps are computed afresh where the iteration goes on."""

    def state(self) -> dict[str, Any]:
        return {"s": self._s, "r": self._r, "alpha": self._alpha, "left": self._left, "start": self._start,
                "warm": self._warm, "least": self._least, "settled": self._settled, "error": self._error,
                "far": self._far, "norm": self._norm(),
                "stalled": self._stalled, "smallest": self._smallest, "rescue": self._rescue.state(),
                "inner_steps": dict(self.inner_steps), "history": list(self.history)}

    def restore(self, state: dict[str, Any]) -> None:
        self._s, self._r, self._alpha, self._left = (state[name] for name in ("s", "r", "alpha", "left"))
        self._start, self._settled = bool(state["start"]), bool(state["settled"])
        self._warm, self._least = bool(state["warm"]), float(state["least"])
        self._error, self._smallest = float(state["error"]), float(state["smallest"])
        self._stalled, self.inner_steps = int(state["stalled"]), dict(state["inner_steps"])
        self._far = None if state["far"] is None else float(state["far"])
        self._measured = self._s, float(state["norm"])
        self._rescue.restore(state["rescue"])
        self.history = steps_of(state["history"])


def precondition(joint: Joint, c: np.ndarray) -> Preconditioner:
    """The preconditioner for all active sets of `joint`, with c (size,) half the joint moduli. Collective."""
    half_plane, rigid = HalfPlaneStiffness(joint.space), joint.rigid
    motions, stiffness = rigid, HELD_LOOSELY * joint.rigid_moduli()
    if joint.bodies >= MANY or rigid.size:
        found = [(np.empty((0, member.size)), np.empty(0)) for member in joint.members]
        with joint.deferred():
            found = [smooth_modes(member, SMOOTH) for member in joint.members]
        joint.meet("coarse modes")
        motions, more = joint.add_motions([v for v, _ in found], [1.0 / (mu - 0.5) for _, mu in found])
        stiffness = np.append(stiffness, more)
    if motions.size:
        log.info("coarse problem: %d rigid motions and %d smooth modes of %d bod%s", rigid.size,
                 motions.size - rigid.size, joint.bodies, "ies" if joint.bodies > 1 else "y")
    return Preconditioner(half_plane, motions, stiffness, np.where(joint.shared, SHARED / (2.0 * c), 0.0))
