"""A convex quadratic program with constraints, and the residual of a point."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ddmpi.body.compliance import Compliance
from ddmpi.sets import Box, Discs
from ddmpi.system.numbers import norm


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
    """A solution s with its product C s and its residual; `steps` counts the steps of each kind."""

    s: np.ndarray
    Cs: np.ndarray
    residual: float
    iterations: int
    steps: dict[str, int]
