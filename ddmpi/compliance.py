"""The contact compliance C = B A⁻¹ Bᵀ of one body, and the count of its multiplications."""

from __future__ import annotations

from collections import Counter

import numpy as np
from petsc4py import PETSc

from ddmpi.mprgp import power_norm
from ddmpi.solvers import StiffnessSolver


class Compliance:
    """C = B A⁻¹ Bᵀ, applied by one solve with A per multiplication.

    Attributes
    ----------
    size : length of s, the rows of B
    count : multiplications by A⁻¹ so far, by purpose
    """

    def __init__(self, solver: StiffnessSolver, B: PETSc.Mat) -> None:
        self.solver, self.B = solver, B
        self.size = B.size[0]
        self.count: Counter[str] = Counter()
        self._u, self._f = B.createVecs()[0], B.createVecs()[0]
        self._norm = 0.0

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str) -> None:
        """y ← C x (metres from newtons); both (size,). Collective on the body's communicator."""
        y[:] = 0.0
        if x.any():
            self.B.multTranspose(_vector(x), self._f)
            self.free_response(self._f, y, purpose)

    def free_response(self, f: PETSc.Vec, y: np.ndarray, purpose: str) -> None:
        """y ← B A⁻¹ f; counts as one multiplication. Collective."""
        self.solve(f, self._u, purpose)
        self.B.mult(self._u, _vector(y))

    def solve(self, f: PETSc.Vec, u: PETSc.Vec, purpose: str) -> None:
        """u ← A⁻¹ f, counted under `purpose`. Collective."""
        self.count[purpose] += 1
        self.solver.solve(f, u)

    def norm(self) -> float:
        """‖C‖₂ from below (m/N), estimated at the first call. Collective."""
        if not self._norm:
            self._norm = power_norm(lambda x, y: self.mult(x, y, "norm"), self.size)
        return self._norm


def _vector(x: np.ndarray) -> PETSc.Vec:
    return PETSc.Vec().createWithArray(x, comm=PETSc.COMM_SELF)
