"""Convex quadratic programs with constraints, solved by a TAO type: by default our MPRGP, on discs our APG; options
prefix ``qp_``."""

from __future__ import annotations

import contextlib
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from petsc4py import PETSc

from ddmpi.body.compliance import Compliance
from ddmpi.errors import SolverError
from ddmpi.petsc.events import event
from ddmpi.petsc.versions import TaoReason, call_solver, petsc_message, reason_name
from ddmpi.published.apg import APG
from ddmpi.published.mprgp import MPRGP
from ddmpi.sets import Box, Discs
from ddmpi.system.numbers import ROUNDING, norm

LEAST_PRECISE = 1e-2
"""Largest relative error of a multiplication."""

FRESH = 1e-11
"""Tolerance, over the displacements, below which a product that MPRGP updated by recurrence is computed anew."""

GRADIENT_ROUNDING = float(8 * np.finfo(float).eps)
"""A projected gradient is rounding below this fraction of C s and d, whose difference it is."""

MOST = 200
"""Most iterations, over the number of unknowns plus one."""

MOST_GRADIENTS = 20_000
"""At least this many iterations are allowed on discs: projected gradients do not end after as many steps as there are
unknowns."""

STRICTER = 0.1
"""Factor on the tolerance after a type of PETSc has stopped too early by its own norm (bncg by Fischer's)."""

ATTEMPTS = 3
"""Most starts of a type of PETSc on one QP. It starts again from its last point, moved exactly onto bounds, after it
stopped too early or its line search failed (blmvm of 3.26 with tiny friction bounds)."""

Product = Callable[[np.ndarray, float], np.ndarray]
"""C x, counted, from x and the size (m) to which its error is relative."""


@dataclass
class QP:
    """min ½ sᵀ C s − sᵀ d over the points s of a constraint set.

    Attributes
    ----------
    C : symmetric positive definite (m/N)
    d : (size,) linear term (m)
    constraints : the set of feasible s (N)
    """

    C: Compliance
    d: np.ndarray
    constraints: Box

    def residual(self, s: np.ndarray, Cs: np.ndarray) -> float:
        """‖projected gradient‖₂ (unit of d) at a feasible s; zero exactly at the solution.

        With discs it is ‖s − P(s − t ∇)‖₂ / t, with the projection P onto them and t = 1/‖C‖₂. Collective where the
        norm of C is not known yet.
        """
        gradient = Cs - self.d
        if isinstance(self.constraints, Discs):
            return norm(self.constraints.reduced(gradient, s, 1.0 / self.C.norm()))
        return norm(self.constraints.projected_gradient(gradient, s))


@dataclass
class QPResult:
    """A solution s with its product C s and its residual; `steps` counts the steps of each kind, `reason` is why TAO
    ended."""

    s: np.ndarray
    Cs: np.ndarray
    residual: float
    iterations: int
    steps: dict[str, int]
    reason: str = ""


class QPSolver:
    """Solves QPs with one TAO type; options prefix ``qp_``.

    Every type gets the same problem without units (Hessian and linear term have norm one), and the same stopping test,
    which is checked afterwards. For PETSc's types, unknowns with two equal bounds are left out, and the unknown is the
    change from the starting point. MPRGP needs neither, and updates the product C s by recurrence. bqpip needs a dense
    Hessian (counted as "explicit"). PETSc's types are for bounds: whatever the type, MPRGP solves QPs without bounds,
    and APG those with discs.
    """

    @cached_property
    def type(self) -> str:
        """The TAO type; can be set. Else the option's value, which then counts as used."""
        return PETSc.Options("qp_").getString("tao_type", "python")

    def solve(
        self,
        qp: QP,
        s: np.ndarray,
        Cs: np.ndarray,
        tolerance: float,
        purpose: str,
        product_error: float = 0.0,
    ) -> QPResult:
        """Solve `qp` from the point `s`, whose product with C is `Cs`. Collective on the body.

        `QP.residual` ends below `tolerance` (m); multiplications are counted under `purpose`. An iterative solver may
        leave the error `product_error` (m) in the returned product; zero means the operator's own precision. Raises
        SolverError if neither the tolerance nor the limit of rounding is reached, whatever TAO reports.
        """

        def multiply(x: np.ndarray, size: float) -> np.ndarray:
            product = np.empty_like(x)
            qp.C.mult(
                x, product, purpose, min(product_error / size, LEAST_PRECISE) if size else 0.0
            )
            return product

        start = qp.constraints.project(s)
        if not np.array_equal(start, s):
            Cs = multiply(start, max(norm(qp.d), norm(Cs)))
        if qp.residual(start, Cs) <= tolerance:
            return QPResult(start, Cs, qp.residual(start, Cs), 0, {})
        feasible = qp.constraints
        bounds = np.isfinite([feasible.lower, feasible.upper]).any() and not isinstance(
            feasible, Discs
        )
        solve = self._petsc if bounds and self.type != "python" else self._python
        with event("ContactQP"):
            result = solve(qp, start, Cs, tolerance, multiply)
        rounding = GRADIENT_ROUNDING * max(norm(qp.d), norm(result.Cs))
        if not result.residual <= max(1.01 * tolerance, rounding):
            raise SolverError(
                f"subproblem for {purpose}: TAO type {self.type} ended with {result.reason} after "
                f"{result.iterations} iterations; projected gradient {result.residual:.2e}, "
                f"needed {tolerance:.2e}"
            )
        return result

    def _python(
        self, qp: QP, s: np.ndarray, Cs: np.ndarray, tolerance: float, multiply: Product
    ) -> QPResult:
        problem = _Scaled(qp, np.arange(qp.C.size), s, Cs, multiply)
        with self._solved(problem, "python", tolerance) as tao:
            s = problem.unscaled(tao.getSolution().array_r, 0.0)
            Cs = problem.displacement * tao.getGradient()[0].array_r + qp.d
            steps = tao.getPythonContext().steps
            iterations = tao.getIterationNumber()
            reason = tao.getConvergedReason()
        if tolerance < FRESH * problem.displacement:  # the recurrence may be off by rounding
            Cs = multiply(s, problem.displacement)
        return QPResult(
            s, Cs, qp.residual(s, Cs), iterations, steps, reason_name(TaoReason, reason)
        )

    def _petsc(
        self, qp: QP, s: np.ndarray, Cs: np.ndarray, tolerance: float, multiply: Product
    ) -> QPResult:
        moving = np.flatnonzero(qp.constraints.lower < qp.constraints.upper)
        asked = tolerance
        iterations = 0
        for _ in range(ATTEMPTS):
            problem = (_Explicit if self.type == "bqpip" else _Scaled)(qp, moving, s, Cs, multiply)
            s = s.copy()
            with self._solved(problem, self.type, asked) as tao:
                iterations += tao.getIterationNumber()
                reason = tao.getConvergedReason()
                # What is near a bound is moved onto it.
                s[moving] = problem.unscaled(tao.getSolution().array_r, ROUNDING)
            Cs = multiply(s, problem.displacement)
            if qp.residual(s, Cs) <= tolerance or (
                reason < 0 and reason != TaoReason.DIVERGED_LS_FAILURE
            ):
                break
            if reason > 0:
                asked *= STRICTER
        return QPResult(s, Cs, qp.residual(s, Cs), iterations, {}, reason_name(TaoReason, reason))

    @contextlib.contextmanager
    def _solved(self, problem: _Scaled, kind: str, tolerance: float) -> Iterator[PETSc.TAO]:
        """A TAO of this kind that has solved the problem. It is destroyed afterwards, as it refers to the body's
        matrices, which PETSc 3.18 would never free."""
        tao = PETSc.TAO().create(PETSc.COMM_SELF)
        try:
            self._set_up(tao, problem, kind, tolerance)
            call_solver(tao.solve)
            yield tao
        finally:
            tao.destroy()

    def _set_up(self, tao: PETSc.TAO, problem: _Scaled, kind: str, tolerance: float) -> None:
        tao.setOptionsPrefix("qp_")
        if kind == "python":
            tao.setType(PETSc.TAO.Type.PYTHON)
            tao.setPythonContext(MPRGP(problem.constraints))
        else:
            _set_type(tao, kind)
        x, lower, upper = problem.vectors()
        tao.setSolution(x)
        tao.setVariableBounds((lower, upper))
        gradient = x.duplicate()
        tao.setObjectiveGradient(problem.objective_gradient, gradient)
        H = problem.hessian()
        tao.setHessian(lambda *_: None, H)
        discs = isinstance(problem.constraints, Discs)
        most = MOST * (x.getSize() + 1)
        tao.setMaximumIterations(max(most, MOST_GRADIENTS) if discs else most)
        tao.setTolerances(gatol=tolerance / problem.displacement, grtol=0.0, gttol=0.0)
        if kind == self.type:  # otherwise the options are meant for another type
            tao.setFromOptions()
        if discs:  # no other type solves these, whatever the options say
            tao.setPythonContext(APG(problem.constraints))
        if kind in ("gpcg", "tron") and not PETSc.Options("qp_").hasName("pc_type"):
            tao.getKSP().getPC().setType(PETSc.PC.Type.NONE)  # the Hessian is a shell


class _Scaled:
    """A QP in scaled unknowns x = s/force on the indices `moving`; Hessian and linear term have norm one.

    The Hessian is applied through the whole operator. The last product is stored, so that objective and gradient at one
    point cost one multiplication.
    """

    def __init__(
        self, qp: QP, moving: np.ndarray, s: np.ndarray, Cs: np.ndarray, multiply: Product
    ) -> None:
        self.moving, self._multiply, self._whole = moving, multiply, np.zeros(qp.C.size)
        self._change = norm(Cs - qp.d)  # a step changes C s by about the gradient
        self._C, self._norm = qp.C, qp.C.norm()
        self.displacement = max(norm(qp.d), norm(Cs)) or 1.0
        self.force = self.displacement / self._norm
        whole = qp.constraints
        self._moving = (
            Box(whole.lower[moving], whole.upper[moving]) if len(moving) < qp.C.size else whole
        )
        self.constraints = self._moving.scaled(self.force)
        # the gradient at x is that at the start, whose product is known, plus H (x − start)
        self._start = s[moving] / self.force
        self._start_gradient = (Cs - qp.d)[moving] / self.displacement
        self._at, self._g = self._start.copy(), self._start_gradient

    def vectors(self) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
        """The starting point, the lower and the upper bounds."""
        arrays = (self._start.copy(), self.constraints.lower.copy(), self.constraints.upper.copy())
        x, lower, upper = (PETSc.Vec().createWithArray(a, comm=PETSc.COMM_SELF) for a in arrays)
        return x, lower, upper

    def unscaled(self, x: np.ndarray, near: float) -> np.ndarray:
        """Forces (N) from scaled unknowns; moved to bounds that are `near`, relative to the largest unknown."""
        return self._moving.unscaled(x, self.force, near * max(np.abs(x).max(initial=0.0), 1e-300))

    def hessian(self) -> PETSc.Mat:
        k = len(self.moving)
        H = PETSc.Mat().createPython(((k, None), (k, None)), context=self, comm=PETSc.COMM_SELF)
        H.setOption(PETSc.Mat.Option.SYMMETRIC, True)
        H.setUp()
        return H

    def norm(self) -> float:
        """‖H‖₂, from below."""
        return 1.0

    def _apply(self, x: np.ndarray) -> np.ndarray:
        self._whole[self.moving] = x
        return self._multiply(self._whole, self._change)[self.moving] / self._norm

    def mult(self, _mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        y.array[:] = self._apply(x.array_r)

    def getDiagonal(self, _mat: PETSc.Mat, v: PETSc.Vec) -> None:
        v.set(1.0)

    def _gradient(self, x: np.ndarray) -> np.ndarray:
        if not np.array_equal(x, self._at):
            self._g = self._start_gradient + self._apply(x - self._start)
            self._at = x.copy()
        return self._g

    def objective_gradient(self, _tao: PETSc.TAO, X: PETSc.Vec, G: PETSc.Vec) -> float:
        x = X.array_r
        G.array[:] = self._gradient(x)
        return float(0.5 * (x - self._start) @ (G.array_r + self._start_gradient))


class _Explicit(_Scaled):
    """A scaled QP with a dense Hessian and finite bounds, as interior-point methods need it."""

    @cached_property
    def _matrix(self) -> np.ndarray:
        return self._C.dense()[np.ix_(self.moving, self.moving)] / self._norm

    def vectors(self) -> tuple[PETSc.Vec, PETSc.Vec, PETSc.Vec]:
        """As of `_Scaled`, but with finite bounds in place of infinite ones, beyond which no point is better than the
        start."""
        vectors = super().vectors()
        # f(x) ≤ f(start) implies ‖x − start‖ ≤ 2 ‖gradient‖/λ_min, so that bounds beyond this distance are never active
        reach = 2 * norm(self._start_gradient) / np.linalg.eigvalsh(self._matrix)[0]
        for bound, sign in zip(vectors[1:], (-1.0, 1.0), strict=True):
            finite = np.isfinite(bound.array_r)
            bound.array[~finite] = self._start[~finite] + sign * 1.1 * reach
        return vectors

    def unscaled(self, x: np.ndarray, near: float) -> np.ndarray:
        """As of `_Scaled`; an unknown that is nearer to its bound than its multiplier to zero is moved there."""
        g, lower, upper = self._gradient(x), self.constraints.lower, self.constraints.upper
        x = np.where(x - lower <= g, lower, np.where(upper - x <= -g, upper, x))
        return super().unscaled(x, near)

    def hessian(self) -> PETSc.Mat:
        H = PETSc.Mat().createDense(
            self._matrix.shape, array=self._matrix.copy(), comm=PETSc.COMM_SELF
        )
        H.setOption(PETSc.Mat.Option.SPD, True)
        return H

    def _apply(self, x: np.ndarray) -> np.ndarray:
        return self._matrix @ x


def _set_type(tao: PETSc.TAO, kind: str) -> None:
    """Set one of PETSc's types; its bounded Newton types must not precondition a shell Hessian, unless options do."""
    try:
        tao.setType(kind)
    except PETSc.Error as error:
        raise SolverError(f"-qp_tao_type {kind}: {petsc_message(error)}") from None
    if kind in ("bnls", "bntr", "bntl"):
        tao.getKSP().getPC().setType(PETSc.PC.Type.NONE)
