"""The contact compliance C = B A⁻¹ Bᵀ of one body, and the count of its multiplications."""

from __future__ import annotations

from collections import Counter

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc
from scipy.linalg.blas import dsymv

from ddmpi.body.solver import StiffnessSolver
from ddmpi.petsc.events import event
from ddmpi.petsc.lanczos import estimate_norm
from ddmpi.system import interrupt

LARGEST_RATIO = 2e6
"""A dense compliance is the default up to this ratio of k³ to n, with k contact dofs and n dofs in all: to invert
k × k costs k³, and saves hundreds of solves that cost a multiple of n each. Measured on blocks thin and thick, k from
600 to 4000: faster than a solve per product in all of them, up to a ratio of 1.8e6."""

FACTORS, FACTORS_WITH_SCHUR = 55.0, 75.0
"""Bytes per n log₂ n of MUMPS' factors, measured on pinched blocks up to n = 616,000 (both grow with n within 3 %)."""

MARGIN = 1.5
"""By this the memory that is free must exceed the estimate (quadratic elements have denser rows)."""

NORM_PRECISION = 1e-3
"""Relative precision of the multiplications that ‖C‖ is estimated with."""

ROUNDING, ITERATED = 1e-13, 1e-10
"""Relative errors of a multiplication that nothing can be asked to fall below: by factors, by an iterative solver."""

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
        solves; "direct", a solve per multiplication; "iterative", the same by multigrid; None leaves it
        to `choose_kind`, and takes direct where MUMPS gives no dense matrix
    memory : bytes that may be used

    Attributes
    ----------
    size : length of s, the rows of B
    kind, reason : what was chosen, and why
    solver : solves with A
    accuracy : smallest relative error of a multiplication that one may count on
    count : multiplications by A⁻¹ so far, by purpose; one by the dense matrix counts like a solve

    Construction factors A. Collective on the body's communicator. Raises SolverError.
    """

    STATE = ("count", "_norm")

    def __init__(self, A: PETSc.Mat, B: PETSc.Mat, name: str, kind: str | None = None,
                 memory: float = np.inf) -> None:
        self.B, self.size = B, B.size[0]
        indptr, columns, values = B.getValuesCSR()
        trace = sparse.csr_matrix((values, columns, indptr), shape=B.size)
        dofs = np.unique(columns[values != 0.0])
        self.kind, self.reason = (kind, "asked for") if kind else choose_kind(A.size[0], len(dofs), memory)
        if not len(dofs):
            self.kind, self.reason = "direct", "clamps hold its whole contact, which does not yield: C = 0"
        self._rigid = not len(dofs)
        self.solver = StiffnessSolver(A, name, dofs if self.kind == "explicit" else None,
                                      iterative=self.kind == "iterative")
        self.accuracy = ROUNDING if self.solver.direct else ITERATED
        self.count: Counter[str] = Counter()
        self._u, self._f = B.createVecs()[0], B.createVecs()[0]
        self._norm = 0.0
        self._matrix = self.solver.inverse  # what mult uses: C = trace · matrix · traceᵀ, or C itself
        self._trace: sparse.csr_matrix | None = None
        self._dense: np.ndarray | None = None  # what dense made of them
        if self._matrix is not None:
            self._trace = trace[:, dofs]
            self._spread = self._trace.T.tocsr()
        elif self.kind == "explicit" and kind is None:
            self.kind, self.reason = "direct", f"{self.solver.description} leaves no Schur complement"
        elif self.kind == "explicit":
            with event("ComplianceForm"):
                self._matrix = self._by_blocks(trace)

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x (metres from newtons); both (size,). Collective on the body's communicator.

        An iterative solver may leave the share `relative` of the contact forces unbalanced in the body;
        zero is its usual precision. Raises SolverError, and InterruptionError when a signal came to this rank.
        """
        interrupt.check()
        if self._rigid or not x.any():
            y[:] = 0.0
            return
        with event("ComplianceMult"):
            if self._matrix is None:
                self.B.multTranspose(_vector(x), self._f)
                self.solve(self._f, self._u, purpose, relative)
                self.B.mult(self._u, _vector(y))
            else:
                self.count[purpose] += 1
                y[:] = self._multiplied(x)

    def _multiplied(self, x: np.ndarray) -> np.ndarray:
        if self._trace is None:
            return dsymv(1.0, self._matrix, x)
        return self._trace @ dsymv(1.0, self._matrix, self._spread @ x)

    def dense(self) -> np.ndarray:
        """C (size, size) as a dense matrix (m/N); made once, by multiplications where there is none. Collective."""
        if self._dense is None:
            if self._trace is not None:
                C = self._trace @ (self._trace @ self._matrix).T
            elif self._matrix is not None:
                C = self._matrix
            else:
                counted = self.count["explicit"]
                C, unit = np.empty((self.size, self.size)), np.zeros(self.size)
                for k in range(self.size):
                    unit[k] = 1.0
                    self.mult(unit, C[k], "explicit")
                    unit[k] = 0.0
                self.count["explicit"] = counted or self.count["explicit"]  # a run that is continued has counted them
            self._dense = (C + C.T) / 2
        return self._dense

    def _by_blocks(self, trace: sparse.csr_matrix) -> np.ndarray:
        """C by solves with blocks of right-hand sides, each counted."""
        C = np.empty((self.size, self.size))
        for start in range(0, self.size, BLOCK):
            interrupt.check()
            rows = trace[start:start + BLOCK]
            C[:, start:start + rows.shape[0]] = trace @ self.solver.solve_block(rows.T.toarray())
            self.count["explicit"] += rows.shape[0]
        return np.asfortranarray((C + C.T) / 2)

    def free_response(self, f: PETSc.Vec, y: np.ndarray, purpose: str) -> None:
        """y ← B A⁻¹ f; counts as one multiplication. Collective."""
        self.solve(f, self._u, purpose)
        self.B.mult(self._u, _vector(y))

    def solve(self, f: PETSc.Vec, u: PETSc.Vec, purpose: str, relative: float = 0.0) -> None:
        """u ← A⁻¹ f, counted under `purpose`; `relative` as for `mult`. Collective."""
        self.count[purpose] += 1
        self.solver.solve(f, u, relative)

    def norm(self) -> float:
        """‖C‖₂ from below (m/N), estimated at the first call. Collective."""
        if not self._norm:
            self._norm = estimate_norm(lambda x, y: self.mult(x, y, "norm", NORM_PRECISION), self.size)
        return self._norm


def choose_kind(n: int, k: int, memory: float) -> tuple[str, str]:
    """The kind of the compliance of a body with `n` dofs, `k` of them at the contact, and why.

    Parameters
    ----------
    memory : bytes that may be used

    Returns
    -------
    "explicit", "direct" or "iterative", and the reason in words. Not collective.
    """
    growth = n * np.log2(max(n, 2))
    explicit, direct = FACTORS_WITH_SCHUR * growth + 8.0 * k**2, FACTORS * growth
    if MARGIN * direct > memory:
        return "iterative", f"factors would take about {_worded(direct)}, {_worded(memory)} are free"
    if k**3 > LARGEST_RATIO * n:
        return "direct", f"a dense matrix of {k} contact dofs costs more than it saves at {n} dofs"
    if MARGIN * explicit > memory:
        return "direct", f"a dense matrix would take about {_worded(explicit)}, {_worded(memory)} are free"
    return "explicit", f"a dense matrix of {_worded(8.0 * k**2)} beside the factors"


def _worded(size: float) -> str:
    return f"{size / 2**30:.1f} GiB" if size >= 2**30 else f"{max(size / 2**20, 0.1):.1f} MiB"


def _vector(x: np.ndarray) -> PETSc.Vec:
    return PETSc.Vec().createWithArray(x, comm=PETSc.COMM_SELF)
