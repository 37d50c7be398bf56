"""Accelerated projected gradients with restart, as a TAO type in Python: for sets that are easy to project onto.

Nesterov, Soviet Math. Dokl. 27 (1983) 372–376; Beck, Teboulle, SIAM J. Imaging Sci. 2 (2009) 183–202; the momentum is
dropped where it turns uphill, by the gradient scheme of O'Donoghue, Candès, Found. Comput. Math. 15 (2015) 715–732. A
step is 1/‖H‖ long. The gradient follows the iterates by recurrence: every step costs one multiplication by the Hessian,
and one reduction.
"""

from __future__ import annotations

import math

import numpy as np

from ddmpi.published.mprgp import Program, TaoType

EPS = float(np.finfo(float).eps)


class APG(TaoType):
    """``-tao_type python -tao_python_type ddmpi.apg.APG``, for any set.

    Stops at ‖x − P(x − t ∇)‖ / t ≤ gatol, with the projection P onto the constraints and t = 1/‖H‖; without constraints
    this is ‖∇‖. Its `steps` are "gradient", and "restart", how often the momentum was dropped.
    """

    title = "projected gradient steps"

    def iterate(self, program: Program) -> int:
        x, g, feasible, multiply, reduce, norm = program
        y, g_y = x.copy(), g.copy()  # the extrapolated point, from which the next step starts
        change, H_change = np.zeros_like(x), np.zeros_like(x)
        self.steps, momentum = {"gradient": 0, "restart": 0}, 1.0
        while True:
            # one reduction: the residual, the curvature along the last step, whether y − x turns uphill, and ‖x‖
            left = feasible.reduced(g, x, 1.0 / norm)
            gradient, bent, moved, uphill, size = reduce(
                left, left, change, H_change, change, change, y - x, change, x, x
            )
            reason = self._ends(math.sqrt(gradient), EPS * norm * math.sqrt(size))
            if reason is not None:
                return reason
            if moved:
                norm = max(norm, bent / moved)  # an estimate from below
            if uphill > 0.0:
                momentum, ahead = 1.0, 0.0
                self.steps["restart"] += 1
            else:
                # t_{k+1} = (1 + √(1 + 4 t_k²))/2, and the next point lies (t_k − 1)/t_{k+1} of the last change ahead
                before, momentum = momentum, 0.5 + math.sqrt(0.25 + momentum**2)
                ahead = (before - 1.0) / momentum
            y, g_y = x + ahead * change, g + ahead * H_change
            self.steps["gradient"] += 1
            change = feasible.project(y - g_y / norm) - x
            H_change = multiply(change)
            x += change
            g += H_change
