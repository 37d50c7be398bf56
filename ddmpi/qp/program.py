"""What is solved: a convex quadratic program with bounds, and how far a point is from solving it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np


class Operator(Protocol):
    """A symmetric positive definite matrix that counts its multiplications by purpose."""

    size: int

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x. `relative` is the error that y may have, where C is applied by an iterative solver; zero
        for the usual one."""

    def norm(self) -> float:
        """An estimate of ‖C‖₂ from below, by a few per cent at most."""

    def dense(self) -> np.ndarray:
        """C (size, size) as a dense matrix; asked for only by solvers that cannot do without."""


@dataclass
class QP:
    """min ½ sᵀ C s − sᵀ d subject to lower ≤ s ≤ upper.

    Attributes
    ----------
    C : the operator (m/N for a contact compliance)
    d : (size,) linear term (m)
    lower, upper : (size,) bounds (N); infinite where there is none, equal where s is given
    """

    C: Operator
    d: np.ndarray
    lower: np.ndarray
    upper: np.ndarray

    def gradient(self, Cs: np.ndarray) -> np.ndarray:
        """C s − d, given the product C s."""
        return Cs - self.d

    def project(self, s: np.ndarray) -> np.ndarray:
        """The feasible point nearest to s."""
        return np.clip(s, self.lower, self.upper)

    def residual(self, s: np.ndarray, Cs: np.ndarray) -> float:
        """‖projected gradient‖₂ (unit of d) at a feasible s; zero exactly at the solution."""
        return float(np.linalg.norm(projected_gradient(self.gradient(Cs), s, self.lower, self.upper)))


@dataclass
class QPResult:
    """A solution s with its product C s and its residual; `steps` counts the kinds of step taken."""

    s: np.ndarray
    Cs: np.ndarray
    residual: float
    iterations: int
    steps: dict[str, int]


def projected_gradient(g: np.ndarray, x: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """The part of the gradient g that the bounds at x do not hold (free plus chopped gradient)."""
    p = np.where(x <= lower, np.minimum(g, 0.0), g)
    return np.where(x >= upper, np.maximum(p, 0.0), p)
