"""MPRGP: modified proportioning with reduced gradient projections, as a TAO type in Python.

Dostál, Schöberl: Minimizing quadratic functions over non-negative vectors with the rate of
convergence and finite termination, Comput. Optim. Appl. 30 (2005) 23–43; here for bounds on both
sides. Without bounds it is the conjugate gradient method.

What differs from the paper:

* a step to the boundary in the direction of the conjugate gradient is first tried as a *projected
  conjugate gradient step* and kept when it lowers the objective; only else the projected gradient
  step of fixed length is taken;
* the proportioning step is clipped at the opposite bound;
* the gradient follows the iterates by recurrence: every step costs one multiplication by the
  Hessian, an expansion two.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from ddmpi.petsc.lanczos import estimate_norm
from ddmpi.petsc.versions import TaoReason
from ddmpi.qp.program import projected_gradient

PROPORTION = 1.0
"""Γ of the paper: a step frees indices when the chopped gradient exceeds Γ times the free one."""

STEP = 1.9
"""Fixed step times ‖H‖; below 2, because ‖H‖ is estimated from below."""


class MPRGP:
    """``-tao_type python -tao_python_type ddmpi.mprgp.MPRGP``.

    The Hessian must be a PETSc matrix; where its Python context has ``norm()``, that estimate of
    ‖H‖₂ is used, else Lanczos steps supply one. The solution lies within the bounds exactly,
    and the TAO's gradient vector holds the gradient there. Stops at ‖projected gradient‖ ≤ gatol.

    Attributes
    ----------
    steps : how often each kind of step was taken in the last solve
    """

    def __init__(self) -> None:
        self.steps = {"cg": 0, "expansion": 0, "proportioning": 0}

    def solve(self, tao: PETSc.TAO) -> None:
        """Called by TAOSolve. Collective on the TAO's communicator."""
        X, (L, U) = tao.getSolution(), tao.getVariableBounds()
        H = tao.getHessian()[0]
        tolerance = tao.getTolerances()[0]
        limit = tao.getMaximumIterations()
        P, HP = X.duplicate(), X.duplicate()
        lower, upper = L.array_r, U.array_r
        X.array[:] = np.clip(X.array_r, lower, upper)
        G = tao.getGradient()[0]
        tao.computeGradient(X, G)
        self.steps = dict.fromkeys(self.steps, 0)
        norm = _norm(H, X)

        def multiply(direction: np.ndarray) -> np.ndarray:
            P.array[:] = direction
            H.mult(P, HP)
            return HP.array_r

        x, g = X.array, G.array
        iteration, restart, p = 0, True, None
        while True:
            pg = projected_gradient(g, x, lower, upper)
            residual = np.linalg.norm(pg)
            if not np.isfinite(residual):
                reason = TaoReason.DIVERGED_NAN
                break
            if residual <= tolerance:
                reason = TaoReason.CONVERGED_GATOL
                break
            if iteration >= limit:
                reason = TaoReason.DIVERGED_MAXITS
                break
            iteration += 1
            inside = (x > lower) & (x < upper)
            free = np.where(inside, g, 0.0)
            chopped = np.where(inside, 0.0, pg)
            fixed_step = STEP / norm
            reduced = np.clip(free, (x - upper) / fixed_step, (x - lower) / fixed_step)

            if chopped @ chopped <= PROPORTION**2 * (reduced @ free):
                if restart:
                    p, restart = free, False
                Hp = multiply(p).copy()  # the next product takes its place
                curvature = p @ Hp
                if not curvature > 0.0:  # underflow, or not a number
                    reason = TaoReason.DIVERGED_NAN
                    break
                norm = max(norm, curvature / (p @ p))
                step = (g @ p) / curvature
                longest = _longest(x, p, lower, upper)
                if step <= longest:
                    self.steps["cg"] += 1
                    x -= step * p
                    g -= step * Hp
                    np.clip(x, lower, upper, out=x)  # rounding in the last bit
                    free = np.where((x > lower) & (x < upper), g, 0.0)
                    p = free - ((free @ Hp) / curvature) * p
                    continue
                self.steps["expansion"] += 1
                restart = True
                change = np.clip(x - step * p, lower, upper) - x
                H_change = multiply(change)
                if change @ g + 0.5 * (change @ H_change) >= 0.0:
                    half_x, half_g = x - longest * p, g - longest * Hp
                    half_free = np.where((half_x > lower) & (half_x < upper), half_g, 0.0)
                    while True:
                        change = np.clip(half_x - STEP / norm * half_free, lower, upper) - x
                        H_change = multiply(change)
                        if not change @ g + 0.5 * (change @ H_change) > 0.0:
                            break
                        norm *= 2.0  # its estimate, from below, was too small
            else:
                self.steps["proportioning"] += 1
                restart = True
                H_chopped = multiply(chopped)
                norm = max(norm, (chopped @ H_chopped) / (chopped @ chopped))
                step = min((g @ chopped) / (chopped @ H_chopped), _longest(x, chopped, lower, upper))
                change, H_change = -step * chopped, step * -H_chopped
            x += change
            g += H_change
            np.clip(x, lower, upper, out=x)
        tao.setIterationNumber(iteration)
        tao.setConvergedReason(reason)
        P.destroy()
        HP.destroy()


def _longest(x: np.ndarray, p: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> float:
    """The longest step t for which x − t p stays within the bounds."""
    with np.errstate(divide="ignore", invalid="ignore"):
        room = np.where(p > 0, (x - lower) / p, np.where(p < 0, (x - upper) / p, np.inf))
    return float(room.min())


def _norm(H: PETSc.Mat, like: PETSc.Vec) -> float:
    context = H.getPythonContext() if H.getType() == PETSc.Mat.Type.PYTHON else None
    if hasattr(context, "norm"):
        return context.norm()
    v, w = like.duplicate(), like.duplicate()

    def mult(x: np.ndarray, y: np.ndarray) -> None:
        v.array[:] = x
        H.mult(v, w)
        y[:] = w.array_r

    return estimate_norm(mult, like.getLocalSize())
