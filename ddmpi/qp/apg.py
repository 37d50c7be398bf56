"""Accelerated projected gradients with restart, as a TAO type in Python: for sets that are easy to project onto.

Nesterov, Soviet Math. Dokl. 27 (1983) 372–376; Beck, Teboulle, SIAM J. Imaging Sci. 2 (2009) 183–202; the momentum is
dropped where it turns uphill, by the gradient scheme of O'Donoghue, Candès, Found. Comput. Math. 15 (2015) 715–732. A
step is 1/‖H‖ long. The gradient follows the iterates by recurrence: every step costs one multiplication by the Hessian,
and one reduction.
"""

from __future__ import annotations

import logging
import math

import numpy as np
from petsc4py import PETSc

from ddmpi.petsc.versions import TaoReason
from ddmpi.qp.box import Box
from ddmpi.qp.mprgp import TELLING, hessian_norm, reduction

log = logging.getLogger("ddmpi")

EPS = float(np.finfo(float).eps)


class APG:
    """``-tao_type python -tao_python_type ddmpi.apg.APG``.

    What `MPRGP` says of Hessian, solution and gradient holds here. Stops at ‖x − P(x − t ∇)‖ / t ≤ gatol, with the
    projection P onto the constraints and t = 1/‖H‖; without constraints this is ‖∇‖.

    Parameters
    ----------
    constraints : the set of feasible points; None stands for the variable bounds of the TAO

    Attributes
    ----------
    steps : number of steps of the last solve, "gradient", and how often their momentum was dropped, "restart"
    """

    def __init__(self, constraints: Box | None = None) -> None:
        self.constraints = constraints
        self.steps = {"gradient": 0}

    def solve(self, tao: PETSc.TAO) -> None:
        """Called by TAOSolve. Collective on the TAO's communicator."""
        X = tao.getSolution()
        feasible = self.constraints or Box(*(bound.array_r for bound in tao.getVariableBounds()))
        H = tao.getHessian()[0]
        tolerance, limit = tao.getTolerances()[0], tao.getMaximumIterations()
        P, HP = X.duplicate(), X.duplicate()
        X.array[:] = feasible.project(X.array_r)
        G = tao.getGradient()[0]
        tao.computeGradient(X, G)
        reduce = reduction(X)
        norm = hessian_norm(H, X, reduce)

        x, g = X.array, G.array
        y, g_y = x.copy(), g.copy()  # the point ahead, from which the next step goes
        change, H_change = np.zeros_like(x), np.zeros_like(x)
        iteration, momentum, restarts = 0, 1.0, 0
        while True:
            left = feasible.reduced(g, x, 1.0 / norm)
            gradient, bent, moved, uphill, size = reduce(left, left, change, H_change, change, change, y - x, change,
                                                         x, x)
            residual = math.sqrt(gradient)
            if not np.isfinite(residual + bent):
                reason = TaoReason.DIVERGED_NAN
                break
            if residual <= tolerance:
                reason = TaoReason.CONVERGED_GATOL
                break
            if iteration >= limit:
                reason = TaoReason.DIVERGED_MAXITS
                break
            if residual <= EPS * norm * math.sqrt(size):  # a step would be rounding
                reason = TaoReason.CONVERGED_STEPTOL
                break
            if moved:
                norm = max(norm, bent / moved)  # an estimate from below
            if uphill > 0.0:
                momentum, ahead = 1.0, 0.0
                restarts += 1
            else:
                before, momentum = momentum, 0.5 + math.sqrt(0.25 + momentum**2)
                ahead = (before - 1.0) / momentum
            y, g_y = x + ahead * change, g + ahead * H_change
            iteration += 1
            if iteration % TELLING == 0:
                log.info("        %d projected gradient steps: residual %.1e, %.1e is asked for", iteration, residual,
                         tolerance)
            change = feasible.project(y - g_y / norm) - x
            P.array[:] = change
            H.mult(P, HP)
            H_change = HP.array_r.copy()
            x += change
            g += H_change
        self.steps = {"gradient": iteration, "restart": restarts}
        tao.setIterationNumber(iteration)
        tao.setConvergedReason(reason)
        P.destroy()
        HP.destroy()
