"""The default outer method: a semi-smooth Newton method on the contact forces of the interface.

Both bodies carry the same forces s, so they cancel from the start; what is sought is the s for which
the gaps r = (C_1 + C_2) s − d fit the forces. The contact and friction laws are the equations

    s_ν = max(0, s_ν − c r_ν),        s_t = P_[−g, g](s_t − c r_t),      g = 𝓕 max(0, s_ν − c r_ν)

(Alart and Curnier 1991; Christensen, Klarbring, Pang and Strömberg 1998), with g given for Tresca. The
Newton step is the primal–dual active set step: guess from the projections which nodes are open, slip and
stick, and solve the linear problem that results, by GMRES preconditioned with the stiffness of a
half-plane. Since r is linear in s, the residual of the equations is known along the whole step without a
further multiplication, and the step is as long as makes it smallest: this stops the active sets from
cycling. Where even that gets nowhere, successive approximations move the iterate: quadratic programs with
the slip bound frozen, which MPRGP always solves; one at first, and twice as many every time that Newton's
steps get nowhere again.

Every multiplication by C_1 + C_2 is one exchange: each body multiplies with its own compliance.
"""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from petsc4py import PETSc

from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.joint import STEERING, Joint
from ddmpi.coupling.member import Body
from ddmpi.errors import SolverError
from ddmpi.interface.law import Friction
from ddmpi.methods.half_plane import HalfPlaneStiffness
from ddmpi.methods.outer import Step
from ddmpi.petsc.events import event
from ddmpi.petsc.messages import petsc_message, reason_name
from ddmpi.petsc.versions import call_solver
from ddmpi.qp.program import QP
from ddmpi.qp.tao import QPSolver
from ddmpi.scene.method import Method

log = logging.getLogger("ddmpi")

FORCING = 1e-3
"""GMRES reduces the residual of a Newton equation by this. Measured on pinched blocks: 1e-2 takes fewer
iterations a step, but more steps; 1e-3 is the cheapest from N = 54 on, and the most even over the meshes."""

LENGTHS = (1.0, 0.8, 0.65, 0.5, 0.4, 0.3, 0.2, 0.15, 0.1, 0.05, 0.02)
"""Lengths of the Newton step that are tried; the full one is taken at once if it gains enough."""

GAIN = 0.7
"""The full step is taken when it reduces the residual to this or less."""

PATIENCE = 6
"""After so many steps without a new smallest residual, successive approximations are made."""

MOST_APPROXIMATIONS = 64
"""Most successive approximations in a row."""

LEAST_RELAXATION = 0.02
"""The slip bound is relaxed by this or more from one successive approximation to the next."""

ERROR = 10.0
"""The forces are converged when the error estimated for them is below this times the tolerance."""

KEPT = 0.01
"""There, the error of a product that is kept, as a share of the error asked for."""

KRYLOV_LIMIT = 300
"""Most GMRES iterations in one Newton step; a step that is not solved to FORCING is used as it is."""


@dataclass
class InterfaceNewton:
    """The iteration, on one rank; the other body's rank runs the same lines.

    Parameters
    ----------
    body, friction, exchange, method : as for `algorithm.OuterIteration`
    modulus : E* of the two materials (Pa)
    report : called with every Step

    Attributes
    ----------
    s1, s2, forces : the one vector of contact forces (N), under the names of the outer iteration
    g : (mt,) slip bound (N)
    history : all steps; `residual` is that of the equations over the forces
    checkpoint : called before every step, when STATE and the body's are whole
    """

    STATE = ("_s", "_r", "_start", "_settled", "_error", "_stalled", "_smallest", "_rescues", "_frozen",
             "_bound", "_relaxation", "_bound_change", "history")
    GROWS = ("history",)

    body: Body
    friction: Friction
    exchange: Exchange
    method: Method
    modulus: float
    report: Callable[[Step], None] = lambda step: None
    history: list[Step] = field(default_factory=list)
    checkpoint: Callable[[], None] = lambda: None

    def __post_init__(self) -> None:
        body, interface = self.body, self.body.interface
        self._m, self._sliding = interface.m, interface.sliding
        h1, h2 = self.exchange.swap(body.h, "free displacement")
        self._d = h1 + h2
        self._d[:self._m] -= interface.gap
        self._c = 0.5 * self.modulus
        self._preconditioner = HalfPlaneStiffness(interface, self.modulus)
        self._s, self._r = np.zeros(body.C.size), -self._d
        self._start, self._settled, self._error = True, False, 0.0
        self._joint = Joint(body, self.exchange)
        self._stalled, self._smallest = 0, np.inf
        self._rescues, self._frozen = 0, 0  # rescues so far; approximations left to make in this one
        self._bound, self._relaxation, self._bound_change = np.empty(0), 1.0, np.inf

    @property
    def forces(self) -> np.ndarray:
        return self._s

    s1 = s2 = forces

    @property
    def g(self) -> np.ndarray:
        return self.friction.slip_bound(np.maximum(self._s[:self._m], 0.0), self.body.interface)

    def run(self, tolerance: float) -> str:
        """Iterate until the residual of the equations is below `tolerance` times the forces, and their error too.

        The residual understates the error where a body is stiffer than a half-plane (a thin incompressible
        layer). So the error is estimated as well: what a step changed, times what it left of the residual.
        May be called again to go on. Returns "converged", "diverged" or "max_iterations". Raises
        SolverError on all ranks, and InterruptionError when a signal came to one of them. Collective.
        """
        self._joint.kept = KEPT * tolerance * self._size()
        if self._settled:  # the forces were moved onto their bounds; the gaps must follow
            self._r = self._joint.product(self._s, "newton") - self._d
            self._settled = False
        while True:
            self.checkpoint()
            residual = self._relative(self._equations(self._s, self._r).residual)
            if not np.isfinite(residual):
                if not self.history:
                    self._note(residual, 0.0)
                return "diverged"
            if (residual <= tolerance and self._error <= ERROR * tolerance
                    and not (self._start and self._d.any() and residual > 0.0)):
                if not self.history:
                    self._note(residual, 0.0)
                break
            if len(self.history) >= self.method.max_iterations:
                self._settle()
                return "max_iterations"
            self._stalled = 0 if residual < self._smallest else self._stalled + 1
            self._smallest = min(self._smallest, residual)
            before = self._s
            self._joint.kept = KEPT * tolerance * self._size()
            if self._stalled >= PATIENCE:
                self._frozen = min(2**self._rescues, MOST_APPROXIMATIONS)
                self._bound, self._relaxation, self._bound_change = self.g, 1.0, np.inf
                self._rescues += 1
                self._stalled, self._smallest = 0, np.inf
            if self._frozen:
                self._approximate(residual)
            else:
                with event("NewtonStep"):
                    self._newton_step()
            self._start = False
            after = self._relative(self._equations(self._s, self._r).residual)
            size = np.linalg.norm(self._s)
            update = float(np.linalg.norm(self._s - before) / size) if size else 0.0
            self._error = update * after / residual if residual else 0.0
            self._note(after, update)
        self._settle()
        return "converged"

    def _settle(self) -> None:
        """Forces that obey all bounds exactly; hand them to the body."""
        s, m = self._s.copy(), self._m
        state = self._equations(s, self._r)
        s[:m] = np.where(state.closed, np.maximum(s[:m], 0.0), 0.0)
        g = self.friction.slip_bound(s[:m], self.body.interface)
        s[m:] = np.where(state.slip != 0, state.slip * g, np.clip(s[m:], -g, g))
        self._s = s
        self.body.s = s
        self._settled = True

    def _note(self, residual: float, update: float) -> None:
        n1, n2 = self.exchange.swap(np.array([float(self.body.C.count.total())]), "count")
        step = Step(len(self.history) + 1, update, residual, FORCING, (int(n1[0]), int(n2[0])))
        self.history.append(step)
        self.report(step)

    def _relative(self, residual: np.ndarray) -> float:
        size = self._size()
        return float(np.linalg.norm(residual) / size) if size else 0.0

    def _size(self) -> float:
        """What forces are compared with (N): themselves, unless they are next to nothing."""
        return max(float(np.linalg.norm(self._s)), 1e-6 * self._c * float(np.linalg.norm(self._d)))

    def _equations(self, s: np.ndarray, r: np.ndarray) -> _State:
        """Residual of the contact and friction equations at s with gaps r, and the active sets there."""
        m = self._m
        q = s - self._c * r
        pressed = np.maximum(q[:m], 0.0)
        g = self.friction.slip_bound(pressed, self.body.interface)
        projected = np.clip(q[m:], -g, g)
        slip = np.where(q[m:] >= g, 1.0, np.where(q[m:] <= -g, -1.0, 0.0))
        return _State(np.concatenate([s[:m] - pressed, s[m:] - projected]), q[:m] > 0.0, slip, g)

    def _newton_step(self) -> None:
        """Solve for the forces that the active sets of the iterate imply, and go there as far as it helps."""
        m, state = self._m, self._equations(self._s, self._r)
        if self._start:  # nothing is known yet: all nodes closed and sticking
            state.closed[:] = True
            state.slip[:] = 0.0
        unknown = np.concatenate([state.closed, state.slip == 0.0])
        coupling, given = np.zeros(len(state.slip)), np.zeros(len(unknown))
        if self.friction.law == "coulomb":
            unknown[m:] &= state.closed[self._sliding]
            coupling = state.slip * self.friction.coefficient
        else:
            given[m:] = state.slip * state.g

        def expand(y: np.ndarray) -> np.ndarray:
            """All forces from the unknown ones; a slipping node's tangential force follows its normal one."""
            x = np.zeros(len(unknown))
            x[unknown] = y
            x[m:] += coupling * x[:m][self._sliding]
            return x

        jump = expand(self._s[unknown]) + given - self._s
        change, C_change = jump, np.zeros_like(jump)
        if jump.any():
            C_change = self._joint.product(jump, "newton")
        if unknown.any():
            y = np.zeros(int(unknown.sum()))
            with self.exchange.deferred():
                y = self._solve(expand, unknown, -(self._r + C_change)[unknown])
            dy = expand(y)
            change, C_change = jump + dy, C_change + self._joint.product(dy, "newton")
        length = 1.0 if self._start else self._length(change, C_change, np.linalg.norm(state.residual))
        self._s = self._s + length * change
        self._r = self._r + length * C_change

    def _length(self, change: np.ndarray, C_change: np.ndarray, now: float) -> float:
        best = (np.inf, 1.0)
        for length in LENGTHS:
            there = np.linalg.norm(self._equations(self._s + length * change, self._r + length * C_change).residual)
            if length == 1.0 and there <= GAIN * now:
                return 1.0
            best = min(best, (there, length))
        return best[1]

    def _solve(self, expand: Callable, unknown: np.ndarray, right: np.ndarray) -> np.ndarray:
        """GMRES on the unknown forces; prefix ``newton_``. Raises SolverError."""
        if not right.any():
            return np.zeros_like(right)
        joint, preconditioner = self._joint, self._preconditioner
        whole, size = np.zeros(len(unknown)), float(np.linalg.norm(right))

        class Restricted:
            def mult(self, _mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
                left = (ksp.getResidualNorm() or size) / size
                relative = STEERING * min(ksp.getTolerances()[0] / left, 1.0)
                y.array[:] = joint.product(expand(x.array_r), "newton", relative)[unknown]

            def apply(self, _pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
                whole[unknown] = x.array_r
                y.array[:] = preconditioner.mult(whole)[unknown]

        context = Restricted()
        K = PETSc.Mat().createPython((len(right), len(right)), context=context, comm=PETSc.COMM_SELF)
        K.setUp()
        b = PETSc.Vec().createWithArray(right, comm=PETSc.COMM_SELF)
        y = b.duplicate()
        ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        ksp.setOptionsPrefix("newton_")
        ksp.setOperators(K)
        ksp.setType(PETSc.KSP.Type.GMRES)
        ksp.setGMRESRestart(KRYLOV_LIMIT)
        ksp.setPCSide(PETSc.PC.Side.RIGHT)
        ksp.getPC().setType(PETSc.PC.Type.PYTHON)
        ksp.getPC().setPythonContext(context)
        ksp.setTolerances(rtol=FORCING, atol=0.0, max_it=KRYLOV_LIMIT)
        try:
            ksp.setFromOptions()
            call_solver(ksp.solve, b, y)
        except PETSc.Error as error:
            raise SolverError(f"the linear problem of a Newton step: {petsc_message(error)}") from None
        reason = ksp.getConvergedReason()
        if reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT:
            log.info("GMRES took %d iterations without reaching %.0e; its step is used as it is",
                     ksp.getIterationNumber(), ksp.getTolerances()[0])
        elif reason < 0:
            raise SolverError(f"the linear problem of a Newton step failed with "
                              f"{reason_name(PETSc.KSP.ConvergedReason, reason)}")
        solution = y.array_r.copy()
        for thing in (ksp, K, y, b):
            thing.destroy()
        return solution

    def _approximate(self, residual: float) -> None:
        """One successive approximation: solve the quadratic program that is left with the slip bound frozen."""
        m, size, g = self._m, self.body.C.size, self._bound
        lower, upper = np.full(size, -np.inf), np.full(size, np.inf)
        lower[:m] = 0.0
        lower[m:], upper[m:] = -g, g
        qp = QP(self._joint, self._d, lower, upper)
        precision = max(0.1 ** (1 + self._rescues) * residual, 1e-10) * self._size() / self._c
        start = qp.project(self._s)
        Cs = self._joint.product(start, "approximation")
        kept = self._joint.kept / self._c
        with self.exchange.deferred():
            solver = QPSolver()
            solver.type = "python"  # the options are meant for the published iteration
            result = solver.solve(qp, start, Cs, precision, "approximation", kept)
            start, Cs = result.s, result.Cs
        self.exchange.swap(np.zeros(1), "approximation made")
        if np.array_equal(start, self._s):
            self._frozen = 1  # nothing comes of more of them
        self._s, self._r = start, Cs - self._d
        change = self.g - g  # the less the bound settles, the less of it is taken
        size = float(np.linalg.norm(change))
        if size > 0.9 * self._bound_change:
            self._relaxation = max(0.7 * self._relaxation, LEAST_RELAXATION)
        self._bound, self._bound_change = g + self._relaxation * change, size
        self._frozen -= 1


@dataclass
class _State:
    """Residual (size,) of the equations; closed (m,) bool; slip (mt,) in −1, 0, 1; bound g (mt,)."""

    residual: np.ndarray
    closed: np.ndarray
    slip: np.ndarray
    g: np.ndarray
