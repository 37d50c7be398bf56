"""The contact compliance C = B A⁻¹ Bᵀ of one body, and the count of its multiplications."""

from __future__ import annotations

from collections import Counter

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc
from scipy.linalg import lapack

from ddmpi import interrupt
from ddmpi.errors import SolverError
from ddmpi.mprgp import estimate_norm
from ddmpi.solvers import StiffnessSolver

LARGEST_EXPLICIT = 4000
"""Most contact unknowns for which the compliance is kept as a dense matrix unless asked for (128 MB)."""

BLOCK = 64
"""Right-hand sides solved for at once where a dense compliance has to be made by solves."""


class Compliance:
    """C = B A⁻¹ Bᵀ, by one solve with A per multiplication or as a dense matrix.

    Parameters
    ----------
    A : stiffness of the body
    B : trace on its contact nodes
    name : the body's name, for messages
    kind : "explicit", a dense matrix, out of the factorization where MUMPS does it, else by blocks of
        solves; "direct", a solve per multiplication; "iterative", the same by multigrid; None chooses
        explicit where MUMPS gives it and it is small, else direct

    Attributes
    ----------
    size : length of s, the rows of B
    kind : what was chosen
    solver : solves with A
    count : multiplications by A⁻¹ so far, by purpose; one by the dense matrix counts like a solve

    Construction factors A. Collective on the body's communicator. Raises SolverError.
    """

    STATE = ("count", "_norm")

    def __init__(self, A: PETSc.Mat, B: PETSc.Mat, name: str, kind: str | None = None) -> None:
        self.B, self.size = B, B.size[0]
        indptr, columns, values = B.getValuesCSR()
        trace = sparse.csr_matrix((values, columns, indptr), shape=B.size)
        dofs = np.unique(columns[values != 0.0])
        wanted = kind == "explicit" or (kind is None and self.size <= LARGEST_EXPLICIT)
        self.solver = StiffnessSolver(A, name, dofs if wanted else None, iterative=kind == "iterative")
        schur = self.solver.schur_complement
        self.kind = kind or ("direct" if schur is None else "explicit")
        self.count: Counter[str] = Counter()
        self._u, self._f = B.createVecs()[0], B.createVecs()[0]
        self._norm = 0.0
        self._dense: np.ndarray | None = None  # what mult uses
        self._columns: np.ndarray | None = None  # what dense made of its results
        if schur is not None:
            self._dense = _condensed(schur, trace[:, dofs], name)
            self.solver.schur_complement = None
        elif self.kind == "explicit":
            self._dense = self._by_blocks(trace)

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str) -> None:
        """y ← C x (metres from newtons); both (size,). Collective on the body's communicator.

        Raises SolverError, and InterruptionError when a signal came to this rank.
        """
        interrupt.check()
        if not x.any():
            y[:] = 0.0
        elif self._dense is not None:
            self.count[purpose] += 1
            np.dot(self._dense, x, out=y)
        else:
            self.B.multTranspose(_vector(x), self._f)
            self.free_response(self._f, y, purpose)

    def dense(self) -> np.ndarray:
        """C (size, size) as a dense matrix (m/N); where there is none, once by multiplications. Collective."""
        if self._dense is not None:
            return self._dense
        if self._columns is None:
            counted = self.count["explicit"]
            C, unit = np.empty((self.size, self.size)), np.zeros(self.size)
            for k in range(self.size):
                unit[k] = 1.0
                self.mult(unit, C[k], "explicit")
                unit[k] = 0.0
            self._columns = (C + C.T) / 2
            self.count["explicit"] = counted or self.count["explicit"]  # a run that is continued has counted them
        return self._columns

    def _by_blocks(self, trace: sparse.csr_matrix) -> np.ndarray:
        """C by solves with blocks of right-hand sides, each counted."""
        C = np.empty((self.size, self.size))
        for start in range(0, self.size, BLOCK):
            rows = trace[start:start + BLOCK]
            C[:, start:start + rows.shape[0]] = trace @ self.solver.solve_block(rows.T.toarray())
            self.count["explicit"] += rows.shape[0]
        return (C + C.T) / 2

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
            self._norm = estimate_norm(lambda x, y: self.mult(x, y, "norm"), self.size)
        return self._norm


def _condensed(schur: np.ndarray, trace: sparse.csr_matrix, name: str) -> np.ndarray:
    """B S⁻¹ Bᵀ of the Schur complement S on the contact dofs and the trace B on them."""
    factor, info = lapack.dpotrf(schur, lower=1)
    if info == 0:
        inverse, info = lapack.dpotri(factor, lower=1)
    if info:
        raise SolverError(f"body {name!r}: the Schur complement on the contact nodes is not positive definite")
    inverse = np.tril(inverse) + np.tril(inverse, -1).T
    half = trace @ inverse
    return np.ascontiguousarray((trace @ half.T).T)


def _vector(x: np.ndarray) -> PETSc.Vec:
    return PETSc.Vec().createWithArray(x, comm=PETSc.COMM_SELF)
