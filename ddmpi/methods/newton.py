"""The default outer method: a semi-smooth Newton method on the contact forces of the interfaces.

The two bodies at an interface carry the same forces s, so these cancel from the start; what is sought is the s for
which the gaps r = C s − d fit the forces. The laws of contact and friction (`ddmpi.interface.law`) make equations of
this (Alart and Curnier 1991; Christensen, Klarbring, Pang and Strömberg 1998). The Newton step is the primal–dual
active set step: the projections say which nodes are open, slip and stick, and GMRES solves the linear problem that
follows, preconditioned with the stiffness of half-planes. Since r is linear in s, the residual of the equations is
known along the whole step without a further multiplication, and the step is as long as makes it smallest: this
stops the active sets from cycling. Where that gets nowhere, successive approximations move the iterate
(`ddmpi.methods.rescue`).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ddmpi.coupling.joint import Joint
from ddmpi.methods.half_plane import HalfPlaneStiffness
from ddmpi.methods.krylov import FORCING, solve_linearised
from ddmpi.methods.outer import Report, Step, no_report, steps_of
from ddmpi.methods.rescue import Rescue
from ddmpi.petsc.events import event

LENGTHS = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05, 0.02)
"""Lengths of the Newton step that are tried; the full one is taken at once if it gains enough."""

GAIN = 0.7
"""The full step is taken when it reduces the residual to this or less."""

PATIENCE = 6
"""A rescue begins after so many steps without a new smallest residual."""

ERROR = 10.0
"""The forces are converged when the error estimated for them is below this times the tolerance."""

NEGLECTED = 0.01
"""Where the compliance is applied by an iterative solver: the error of a product that is kept, as a share of the error
that is asked for."""

NO_FORCE = 1e-6
"""Forces below this part of those that would close the free gaps in a half-plane are compared with these instead."""


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
    history : all steps; `residual` is that of the equations over the forces
    """

    def __init__(self, joint: Joint, max_iterations: int, report: Report = no_report) -> None:
        self.joint, self.space, self.max_iterations, self.report = joint, joint.space, max_iterations, report
        self.history: list[Step] = []
        self.inner_steps = {"gmres": 0, "mprgp": 0}
        self.checkpoint: Callable[[], None] = lambda: None
        self._laws = self.space.laws
        self._c = self.space.spread([0.5 * interface.modulus for interface in self.space.interfaces])
        self._preconditioner = HalfPlaneStiffness(self.space)
        self._rescue = Rescue(joint, self._c.max())
        self._s, self._r = np.zeros(joint.size), -joint.d
        self._start, self._settled, self._error = True, False, 0.0
        self._stalled, self._smallest = 0, np.inf

    @property
    def forces(self) -> np.ndarray:
        return self._s

    own_forces = forces

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
        self.joint.neglected = NEGLECTED * tolerance * self._size()
        if self._settled:  # the forces were moved onto their bounds; the gaps must follow
            self._r = self.joint.product(self._s, "newton") - self.joint.d
            self._settled = False
        while True:
            self.checkpoint()
            residual = self._relative(self._residual(self._s, self._r))
            done = (residual <= tolerance and self._error <= ERROR * tolerance
                    and not (self._start and self.joint.d.any() and residual > 0.0))
            if (done or not np.isfinite(residual)) and not self.history:
                self._note(residual, 0.0)
            if not np.isfinite(residual):
                return "diverged"
            if done or len(self.history) >= self.max_iterations:
                self._settle()
                return "converged" if done else "max_iterations"
            self._iterate(residual, tolerance)

    def _iterate(self, residual: float, tolerance: float) -> None:
        """One step, of Newton's method or of a rescue."""
        self._stalled = 0 if residual < self._smallest else self._stalled + 1
        self._smallest = min(self._smallest, residual)
        before = self._s
        self.joint.neglected = NEGLECTED * tolerance * self._size()
        if self._stalled >= PATIENCE:
            self._rescue.begin(self._s)
            self._stalled, self._smallest = 0, np.inf
        if self._rescue.left:
            self._s, Cs, iterations = self._rescue.approximate(self._s, residual, self._size())
            self.inner_steps["mprgp"] += iterations
            self._r = Cs - self.joint.d
        else:
            with event("NewtonStep"):
                self._newton_step()
        self._start = False
        after = self._relative(self._residual(self._s, self._r))
        size = self.space.norm(self._s)
        update = self.space.norm(self._s - before) / size if size else 0.0
        self._error = update * after / residual if residual else 0.0
        self._note(after, update)

    def _settle(self) -> None:
        """Move the forces onto their bounds, so that they obey all of them exactly."""
        self._s = self._laws.settle(self._s, self._laws.active_sets(self._s - self._c * self._r))
        self._settled = True

    def _note(self, residual: float, update: float) -> None:
        step = Step(len(self.history) + 1, update, residual, FORCING, self.joint.multiplications())
        self.history.append(step)
        self.report(step)

    def _relative(self, residual: np.ndarray) -> float:
        size = self._size()
        return self.space.norm(residual) / size if size else 0.0

    def _size(self) -> float:
        """What forces are compared with (N): themselves, unless they are next to nothing."""
        return max(self.space.norm(self._s), NO_FORCE * self.space.norm(self._c * self.joint.d))

    def _residual(self, s: np.ndarray, r: np.ndarray) -> np.ndarray:
        """Residual (size,) of the contact and friction equations at forces s with gaps r (N)."""
        return s - self._laws.project(s - self._c * r)

    def _newton_step(self) -> None:
        """Solve for the forces that the active sets of the iterate imply, and go there as far as it helps."""
        joint = self.joint
        active = self._laws.active_sets(self._s - self._c * self._r)
        if self._start:  # nothing is known yet
            for each in active:
                each.close()
        linearised = self._laws.linearise(active)
        jump = linearised.expand(self._s[linearised.unknown]) + linearised.given - self._s
        change, C_change = jump, np.zeros_like(jump)
        if jump.any():
            C_change = joint.product(jump, "newton")
        if linearised.unknown.any():
            y = np.zeros(int(linearised.unknown.sum()))
            with joint.deferred():
                right = -(self._r + C_change)[linearised.unknown]
                y, iterations = solve_linearised(joint, self._preconditioner, linearised, right)
                self.inner_steps["gmres"] += iterations
            dy = linearised.expand(y)
            change, C_change = jump + dy, C_change + joint.product(dy, "newton")
        length = 1.0 if self._start else self._length(change, C_change)
        self._s = self._s + length * change
        self._r = self._r + length * C_change

    def _length(self, change: np.ndarray, C_change: np.ndarray) -> float:
        """The length of the step that makes the residual smallest; the full one if it gains enough."""
        best, now = (np.inf, 1.0), self.space.norm(self._residual(self._s, self._r))
        for length in LENGTHS:
            residual = self._residual(self._s + length * change, self._r + length * C_change)
            there = self.space.norm(residual)
            if length == 1.0 and there <= GAIN * now:
                return 1.0
            best = min(best, (there, length))
        return best[1]

    def refresh(self, u: np.ndarray) -> None:
        """Nothing to do: the gaps are computed afresh where the iteration goes on."""

    def state(self) -> dict[str, Any]:
        return {"s": self._s, "r": self._r, "start": self._start, "settled": self._settled, "error": self._error,
                "stalled": self._stalled, "smallest": self._smallest, "rescue": self._rescue.state(),
                "inner_steps": dict(self.inner_steps), "history": list(self.history)}

    def restore(self, state: dict[str, Any]) -> None:
        self._s, self._r = state["s"], state["r"]
        self._start, self._settled = bool(state["start"]), bool(state["settled"])
        self._error, self._smallest = float(state["error"]), float(state["smallest"])
        self._stalled, self.inner_steps = int(state["stalled"]), dict(state["inner_steps"])
        self._rescue.restore(state["rescue"])
        self.history = steps_of(state["history"])
