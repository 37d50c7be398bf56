"""MPRGP: modified proportioning with reduced gradient projections, as a TAO type in Python.

Dostál, Schöberl: Minimizing quadratic functions over non-negative vectors with the rate of
convergence and finite termination, Comput. Optim. Appl. 30 (2005) 23–43; here for any constraint set
with the methods of `box.Box`. Without constraints it is the conjugate gradient method.

Differences from the paper:

* an expansion, where the conjugate gradient step leaves the set, first tries the *projected conjugate
  gradient step* and keeps it if it lowers the objective; otherwise it takes the projected gradient step
  of fixed length;
* the proportioning step ends at the opposite bound;
* the gradient follows the iterates by recurrence: every step costs one multiplication by the
  Hessian, an expansion two or three.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np
from petsc4py import PETSc

from ddmpi.petsc.lanczos import estimate_norm
from ddmpi.petsc.versions import TaoReason
from ddmpi.qp.box import Box

PROPORTION = 1.0
"""Γ of the paper: a step frees indices when the chopped gradient exceeds Γ times the free one."""

STEP = 1.9
"""Fixed step times ‖H‖; descent needs less than 2, and ‖H‖ is estimated from below."""


class MPRGP:
    """``-tao_type python -tao_python_type ddmpi.mprgp.MPRGP``.

    The Hessian must be a PETSc matrix. If its Python context has ``norm()``, that estimate of ‖H‖₂ is
    used; otherwise Lanczos steps make one. The solution satisfies the constraints exactly, and the TAO's
    gradient vector holds the gradient there. Stops at ‖projected gradient‖ ≤ gatol.

    Parameters
    ----------
    constraints : the set of feasible points; None stands for the variable bounds of the TAO

    Attributes
    ----------
    steps : number of steps of each kind in the last solve
    """

    def __init__(self, constraints: Box | None = None) -> None:
        self.constraints = constraints
        self.steps = {"cg": 0, "expansion": 0, "proportioning": 0}

    def solve(self, tao: PETSc.TAO) -> None:
        """Called by TAOSolve. Collective on the TAO's communicator."""
        X = tao.getSolution()
        feasible = self.constraints or Box(*(bound.array_r for bound in tao.getVariableBounds()))
        H = tao.getHessian()[0]
        tolerance = tao.getTolerances()[0]
        limit = tao.getMaximumIterations()
        P, HP = X.duplicate(), X.duplicate()
        X.array[:] = feasible.project(X.array_r)
        G = tao.getGradient()[0]
        tao.computeGradient(X, G)
        self.steps = dict.fromkeys(self.steps, 0)
        norm, dot, least = _norm(H, X), *_reductions(X)

        def multiply(direction: np.ndarray) -> np.ndarray:
            P.array[:] = direction
            H.mult(P, HP)
            return HP.array_r

        x, g = X.array, G.array
        iteration, restart, p = 0, True, np.empty(0)
        while True:
            free, chopped = feasible.split(g, x)
            residual = math.sqrt(dot(free + chopped, free + chopped))
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
            if dot(chopped, chopped) <= PROPORTION**2 * dot(feasible.reduced(free, x, STEP / norm), free):
                if restart:
                    p, restart = free, False
                Hp = multiply(p).copy()  # the next product overwrites it
                curvature = dot(p, Hp)
                if not curvature > 0.0:  # underflow, or not a number
                    reason = TaoReason.DIVERGED_NAN
                    break
                norm = max(norm, curvature / dot(p, p))
                step = dot(g, p) / curvature
                longest = least(feasible.longest_step(x, p))
                if step <= longest:
                    self.steps["cg"] += 1
                    x -= step * p
                    g -= step * Hp
                    x[:] = feasible.project(x)  # rounding in the last bit
                    free = feasible.split(g, x)[0]
                    p = free - (dot(free, Hp) / curvature) * p
                    continue
                self.steps["expansion"] += 1
                restart = True
                change = feasible.project(x - step * p) - x
                H_change = multiply(change)
                if dot(change, g) + 0.5 * dot(change, H_change) >= 0.0:
                    half_x, half_g = x - longest * p, g - longest * Hp
                    half_free = feasible.split(half_g, half_x)[0]
                    while True:
                        change = feasible.project(half_x - STEP / norm * half_free) - x
                        H_change = multiply(change)
                        if not dot(change, g) + 0.5 * dot(change, H_change) > 0.0:
                            break
                        norm *= 2.0  # the estimate, from below, was too small
            else:
                self.steps["proportioning"] += 1
                restart = True
                H_chopped = multiply(chopped)
                curvature = dot(chopped, H_chopped)
                norm = max(norm, curvature / dot(chopped, chopped))
                step = min(dot(g, chopped) / curvature, least(feasible.longest_step(x, chopped)))
                change, H_change = -step * chopped, step * -H_chopped
            x += change
            g += H_change
            x[:] = feasible.project(x)
        tao.setIterationNumber(iteration)
        tao.setConvergedReason(reason)
        P.destroy()
        HP.destroy()


def _reductions(X: PETSc.Vec) -> tuple[Callable[[np.ndarray, np.ndarray], float], Callable[[float], float]]:
    """The scalar product of local arrays over all ranks of X, and the least of a number of each rank."""
    if X.comm.size == 1:
        return np.dot, lambda value: value
    comm = X.comm.tompi4py()
    return lambda a, b: sum(comm.allgather(float(a @ b))), lambda value: min(comm.allgather(value))


def _norm(H: PETSc.Mat, like: PETSc.Vec) -> float:
    """‖H‖₂ from below, as the context of H knows it or by Lanczos steps on vectors `like` this one."""
    context = H.getPythonContext() if H.getType() == PETSc.Mat.Type.PYTHON else None
    if context is not None and hasattr(context, "norm"):
        return context.norm()
    v, w = like.duplicate(), like.duplicate()

    def mult(x: np.ndarray, y: np.ndarray) -> None:
        v.array[:] = x
        H.mult(v, w)
        y[:] = w.array_r

    return estimate_norm(mult, like.getLocalSize())
