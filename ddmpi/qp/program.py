"""What is solved: a convex quadratic problem with constraints, and how far a point is from solving it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from ddmpi.qp.box import Box, Discs
from ddmpi.system.numbers import norm


class Operator(Protocol):
    """A symmetric positive definite matrix that counts its multiplications by purpose."""

    size: int

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x. An iterative solver may leave the relative error `relative` in y; zero means its usual one."""

    def norm(self) -> float:
        """An estimate of ‖C‖₂ from below, by a few per cent at most."""

    def dense(self) -> np.ndarray:
        """C (size, size) as a dense matrix, for solvers that take no other."""


@dataclass
class QP:
    """min ½ sᵀ C s − sᵀ d over the points s of a constraint set.

    Attributes
    ----------
    C : the operator (m/N for a contact compliance)
    d : (size,) linear term (m)
    constraints : the set of feasible s (N)
    norm : ‖·‖₂ of vectors (size,), over all ranks where they share vectors
    comm : MPI communicator of these ranks; None where every rank has a problem of its own
    """

    C: Operator
    d: np.ndarray
    constraints: Box
    norm: Callable[[np.ndarray], float] = norm
    comm: Any = None

    def residual(self, s: np.ndarray, Cs: np.ndarray) -> float:
        """‖projected gradient‖₂ (unit of d) at a feasible s; zero exactly at the solution.

        With discs it is ‖s − P(s − t ∇)‖₂ / t, with the projection P onto them and t = 1/‖C‖₂. Collective where the
        norm of C is not known yet.
        """
        gradient = Cs - self.d
        if isinstance(self.constraints, Discs):
            return self.norm(self.constraints.reduced(gradient, s, 1.0 / self.C.norm()))
        return self.norm(self.constraints.projected_gradient(gradient, s))


@dataclass
class QPResult:
    """A solution s with its product C s and its residual; `steps` counts the steps of each kind."""

    s: np.ndarray
    Cs: np.ndarray
    residual: float
    iterations: int
    steps: dict[str, int]
