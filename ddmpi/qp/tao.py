"""How quadratic programs are solved: a TAO type on one, by default our MPRGP; prefix ``qp_``."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from ddmpi.errors import SolverError
from ddmpi.petsc.events import event
from ddmpi.petsc.messages import petsc_message, reason_name
from ddmpi.petsc.versions import TaoReason, call_solver
from ddmpi.qp.mprgp import MPRGP
from ddmpi.qp.program import QP, QPResult

LEAST_PRECISE = 1e-2
"""No multiplication in a quadratic program is asked to be less precise than this, relatively."""

FRESH = 1e-11
"""Below this precision, relative to the displacements, a product kept by recurrence is computed anew."""

ROUNDING = 8 * np.finfo(float).eps
"""A projected gradient of this size, relative to the displacements whose difference it is, is rounding."""

ON_BOUND = 1e-12
"""So near a bound, relative to the largest unknown, PETSc's TAO types leave what they mean to be on it."""

STRICTER = 0.1
"""By this the tolerance shrinks when a type of PETSc, by its own norm (bncg: Fischer's), stops too early."""

ATTEMPTS = 3
"""So often is a type of PETSc started on one program: again when it stopped too early, or when its line search
failed (blmvm of 3.26, where friction bounds are tiny): from there, on the bounds exactly and without memory."""


class QPSolver:
    """Solves quadratic programs with one TAO type; prefix ``qp_``.

    Every type sees the same problem, scaled free of units (the Hessian has norm one, the linear
    term norm one), has the same stopping test and is rechecked afterwards by the same measure.
    Unknowns whose two bounds coincide are taken out, and the program is posed for the change from
    the starting point. MPRGP (the default) does both by itself and keeps the product C s on its way.
    bqpip needs the Hessian as a dense matrix (counted as "explicit").
    """

    def __init__(self) -> None:
        self._type = ""
        self._tao: PETSc.TAO | None = None

    @property
    def type(self) -> str:
        """The TAO type; its option is asked for (and so counts as used) by whoever solves a program."""
        if not self._type:
            self._type = PETSc.Options("qp_").getString("tao_type", "python")
        return self._type

    @type.setter
    def type(self, value: str) -> None:
        self._type = value

    def solve(self, qp: QP, s: np.ndarray, Cs: np.ndarray, tolerance: float, purpose: str,
              kept: float = 0.0) -> QPResult:
        """Solve `qp` from the point `s`, whose product with C is `Cs`.

        Parameters
        ----------
        tolerance : largest ‖projected gradient‖₂, in the unit of d (m)
        purpose : under which the multiplications are counted
        kept : largest error, in the unit of d (m), that a multiplication may leave in the product that is
            returned, where C is applied by an iterative solver; zero leaves it to the operator

        Raises
        ------
        SolverError
            when neither the precision nor the limit of rounding is reached, whatever TAO says. Collective on the body.
        """
        start = qp.project(s)
        whole = _share(kept, max(np.linalg.norm(qp.d), np.linalg.norm(Cs)))
        if not np.array_equal(start, s):
            Cs = np.empty_like(start)
            qp.C.mult(start, Cs, purpose, whole)
        if qp.residual(start, Cs) <= tolerance:
            return QPResult(start, Cs, qp.residual(start, Cs), 0, {})
        bounded = np.isfinite(qp.lower).any() or np.isfinite(qp.upper).any()
        solve = self._mprgp if self.type == "python" or not bounded else self._petsc
        try:
            with event("ContactProgram"):
                result = solve(qp, start, Cs, tolerance, purpose, kept)
            rounding = ROUNDING * max(np.linalg.norm(qp.d), np.linalg.norm(result.Cs))
            if not result.residual <= max(1.01 * tolerance, rounding):
                raise SolverError(f"subproblem for {purpose}: TAO type {self.type} ended with {self._reason()} after "
                                  f"{result.iterations} iterations; projected gradient {result.residual:.2e} m, "
                                  f"needed {tolerance:.2e} m")
        finally:
            self._release()
        return result

    def _mprgp(self, qp: QP, s: np.ndarray, Cs: np.ndarray, tolerance: float, purpose: str, kept: float) -> QPResult:
        problem = _Scaled(qp, np.arange(qp.C.size), s, Cs, purpose, kept)
        tao = self._create(problem, "python", tolerance)
        call_solver(tao.solve)
        x, g = tao.getSolution().array_r, tao.getGradient()[0].array_r
        s = problem.unscaled(x, 0.0)
        Cs = problem.displacement * g + qp.d
        if tolerance < FRESH * problem.displacement:  # the recurrence may have lost what is asked for
            qp.C.mult(s, Cs, purpose, _share(kept, problem.displacement))
        steps = dict(tao.getPythonContext().steps)
        return QPResult(s, Cs, qp.residual(s, Cs), tao.getIterationNumber(), steps)

    def _petsc(self, qp: QP, s: np.ndarray, Cs: np.ndarray, tolerance: float, purpose: str, kept: float) -> QPResult:
        moving = np.flatnonzero(qp.lower < qp.upper)
        kind, iterations = _Explicit if self.type == "bqpip" else _Scaled, 0
        asked = tolerance
        for _ in range(ATTEMPTS):
            problem = kind(qp, moving, s, Cs, purpose, kept)
            tao = self._create(problem, self.type, asked)
            call_solver(tao.solve)
            iterations += tao.getIterationNumber()
            s = s.copy()
            s[moving] = problem.unscaled(tao.getSolution().array_r, ON_BOUND)
            Cs = np.empty_like(s)
            qp.C.mult(s, Cs, purpose, _share(kept, problem.displacement))
            reason = tao.getConvergedReason()
            if qp.residual(s, Cs) <= tolerance or (reason < 0 and reason != TaoReason.DIVERGED_LS_FAILURE):
                break
            if reason > 0:
                asked *= STRICTER
        return QPResult(s, Cs, qp.residual(s, Cs), iterations, {})

    def _create(self, problem: _Scaled, kind: str, tolerance: float) -> PETSc.TAO:
        self._release()
        tao = self._tao = PETSc.TAO().create(PETSc.COMM_SELF)
        tao.setOptionsPrefix("qp_")
        if kind == "python":
            tao.setType(PETSc.TAO.Type.PYTHON)
            tao.setPythonContext(MPRGP())
        else:
            _set_type(tao, kind)
        x, lower, upper = problem.vectors()
        tao.setSolution(x)
        tao.setVariableBounds((lower, upper))
        gradient = x.duplicate()
        tao.setObjectiveGradient(problem.objective_gradient, gradient)
        tao.setGradient(problem.gradient, gradient)
        tao.setObjective(problem.objective)
        H = problem.hessian()
        tao.setHessian(lambda *_: None, H)
        tao.setMaximumIterations(20 * len(problem.moving) + 200)
        tao.setTolerances(gatol=tolerance / problem.displacement, grtol=0.0, gttol=0.0)
        if kind == self.type:  # else the options are meant for another type
            tao.setFromOptions()
        if kind in ("gpcg", "tron") and not PETSc.Options("qp_").hasName("pc_type"):
            tao.getKSP().getPC().setType(PETSc.PC.Type.NONE)  # the Hessian is a shell
        return tao

    def _release(self) -> None:
        """Let the TAO go at once: it holds the body's matrices, and would hold them for ever in PETSc 3.18."""
        if self._tao is not None:
            self._tao.destroy()
            self._tao = None

    def _reason(self) -> str:
        return reason_name(TaoReason, self._tao.getConvergedReason()) if self._tao else "nothing done"


class _Scaled:
    """A QP in scaled unknowns x = s/force on the indices `moving`, with unit Hessian and linear term.

    The Hessian is applied through the whole operator; the product at the last point is kept, so that
    objective and gradient at one point cost one multiplication.
    """

    def __init__(self, qp: QP, moving: np.ndarray, s: np.ndarray, Cs: np.ndarray, purpose: str, kept: float) -> None:
        self.qp, self.moving, self.purpose = qp, moving, purpose
        self._relative = _share(kept, np.linalg.norm(Cs - qp.d))  # a step changes C s by about the gradient
        norm = qp.C.norm()
        self.displacement = max(np.linalg.norm(qp.d), np.linalg.norm(Cs)) or 1.0
        self.force = self.displacement / norm
        self._norm = norm
        self._whole, self._product = np.zeros(qp.C.size), np.empty(qp.C.size)
        # gradient = H x − d̂ with d̂ so that it is right at the start, whose product is known
        self._start = s[moving] / self.force
        self._start_gradient = (Cs - qp.d)[moving] / self.displacement
        self._at, self._g = self._start.copy(), self._start_gradient

    def vectors(self) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
        arrays = (self._start.copy(), self.qp.lower[self.moving] / self.force, self.qp.upper[self.moving] / self.force)
        return tuple(PETSc.Vec().createWithArray(a, comm=PETSc.COMM_SELF) for a in arrays)

    def unscaled(self, x: np.ndarray, near: float) -> np.ndarray:
        """Forces (N) from scaled unknowns; what is as `near` a bound lies on it, exactly."""
        lower, upper = self.qp.lower[self.moving], self.qp.upper[self.moving]
        s = np.clip(self.force * x, lower, upper)
        size = near * max(np.abs(x).max(initial=0.0), 1e-300)
        s = np.where(x <= lower / self.force + size, lower, s)
        return np.where(x >= upper / self.force - size, upper, s)

    def hessian(self) -> PETSc.Mat:
        k = len(self.moving)
        H = PETSc.Mat().createPython((k, k), context=self, comm=PETSc.COMM_SELF)
        H.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        H.setUp()
        return H

    def norm(self) -> float:
        """‖H‖₂, from below."""
        return 1.0

    def _apply(self, x: np.ndarray) -> np.ndarray:
        self._whole[self.moving] = x
        self.qp.C.mult(self._whole, self._product, self.purpose, self._relative)
        return self._product[self.moving] / self._norm

    def mult(self, _mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array[:] = self._apply(x.array_r)

    def getDiagonal(self, _mat: PETSc.Mat, v: PETSc.Vec) -> None:
        v.set(1.0)

    def _gradient(self, x: np.ndarray) -> np.ndarray:
        if not np.array_equal(x, self._at):
            self._g = self._start_gradient + self._apply(x - self._start)
            self._at = x.copy()
        return self._g

    def objective(self, _tao: PETSc.TAO, X: PETSc.Vec) -> float:
        x = X.array_r
        return float(0.5 * (x - self._start) @ (self._gradient(x) + self._start_gradient))

    def gradient(self, _tao: PETSc.TAO, X: PETSc.Vec, G: PETSc.Vec) -> None:
        G.array[:] = self._gradient(X.array_r)

    def objective_gradient(self, tao: PETSc.TAO, X: PETSc.Vec, G: PETSc.Vec) -> float:
        self.gradient(tao, X, G)
        return self.objective(tao, X)


class _Explicit(_Scaled):
    """A scaled QP with a dense Hessian and finite bounds, as interior-point methods want it."""

    def __init__(self, qp: QP, moving: np.ndarray, s: np.ndarray, Cs: np.ndarray, purpose: str, kept: float) -> None:
        super().__init__(qp, moving, s, Cs, purpose, kept)
        self._matrix = qp.C.dense()[np.ix_(moving, moving)] / self._norm

    def vectors(self) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
        """As before, but infinite bounds give way to what no point that is better than the start exceeds."""
        vectors = super().vectors()
        reach = 2 * np.linalg.norm(self._start_gradient) / np.linalg.eigvalsh(self._matrix)[0]
        for bound, sign in zip(vectors[1:], (-1.0, 1.0), strict=True):
            finite = np.isfinite(bound.array_r)
            bound.array[~finite] = self._start[~finite] + sign * 1.1 * reach
        return vectors

    def unscaled(self, x: np.ndarray, near: float) -> np.ndarray:
        """As before; an interior point is moved to a bound that is nearer to it than its multiplier to zero."""
        g = self._gradient(x)
        lower, upper = self.qp.lower[self.moving] / self.force, self.qp.upper[self.moving] / self.force
        x = np.where(x - lower <= g, lower, np.where(upper - x <= -g, upper, x))
        return super().unscaled(x, near)

    def hessian(self) -> PETSc.Mat:
        H = PETSc.Mat().createDense(self._matrix.shape, array=self._matrix.copy(), comm=PETSc.COMM_SELF)
        H.setOption(PETSc.Mat.Option.SPD, True)
        return H

    def _apply(self, x: np.ndarray) -> np.ndarray:
        return self._matrix @ x


def _share(error: float, size: float) -> float:
    """The relative precision of a product of this size that may have this error."""
    return min(error / size, LEAST_PRECISE) if size else 0.0


def _set_type(tao: PETSc.TAO, kind: str) -> None:
    """Set one of PETSc's types; the bounded Newton types must not precondition a shell Hessian."""
    options = PETSc.Options("qp_")
    try:
        tao.setType(kind)
    except PETSc.Error as error:
        raise SolverError(f"-qp_tao_type {kind}: {petsc_message(error)}") from None
    if kind.startswith("bn") and not options.hasName("tao_bnk_pc_type"):
        options.setValue("tao_bnk_pc_type", "none")
