"""The contact compliance C = B A⁻¹ Bᵀ of one body, and the count of its multiplications."""

from __future__ import annotations

import contextlib
import copy
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc
from scipy.linalg.blas import dsymv

from ddmpi.body.solver import LEAST, REMEMBERED, USUAL, StiffnessSolver
from ddmpi.petsc.dissection import elimination_order, layers_of
from ddmpi.petsc.events import event
from ddmpi.petsc.lanczos import estimate_norm
from ddmpi.system import interrupt

SOLVERS = {
    "explicit": "direct solver",
    "direct": "direct solver, compliance direct",
    "iterative": "multigrid",
}
"""Kinds of compliances in words."""

LARGEST_RATIO = 2e6, 5e6
"""In the plane and in space, a dense compliance is the default up to this ratio of k³ to n, with k contact unknowns and
n dofs. Only thin bodies exceed it: condensation costs them more than cheap products save."""

FACTORS, FACTORS_WITH_SCHUR = (55.0, 250.0), (60.0, 285.0)
"""Bytes of MUMPS's factors, without and with the compliance, per n log₂ n in the plane and per n^(4/3) in space.
Measured from n = 45,000 on in the plane, within 4 %, and from 35,000 on in space, where it was up to a third less."""

COARSE, VECTORS = 0.5, 10
"""Entries of multigrid's coarse matrices over those of A, and its vectors beside earlier solutions; in the plane with
80,400 dofs the estimate is 1.2 times what the process grew by."""

MARGIN = 1.5
"""The free memory must exceed the estimated factors by this factor (quadratic elements have denser rows)."""

LARGEST_CONDENSED = 8e4, 2.5e5
"""Dofs of a box of 3 : 1 : 1 in space, of order 1 and 2, up to which a dense compliance is the default; times the
number of load steps, as factors last for all of them. Factors take time with n², multigrid with n. On one rank two
boxes of order 1 take 0.7, 0.9 and 1.1 times the time of multigrid with 28,000, 50,000 and 79,000 dofs each, those of
order 2 0.28 and 0.48 times with 58,000 and 105,000; on two ranks 0.89 times with 212,000."""

SECTION = 9.0
"""Such a box has this many dofs times (nodes in a cross-section)^(3/2)."""

NORM_PRECISION = 1e-3
"""Relative precision of the multiplications that estimate ‖C‖."""


class Compliance:
    """C = B A⁻¹ Bᵀ, by one solve with A per multiplication or as a dense matrix.

    >>> A = PETSc.Mat().createAIJ((2, 2), csr=([0, 1, 2], [0, 1], [4.0, 2.0]))  # two springs
    >>> C = Compliance(A, sparse.csr_matrix([[1.0, 1.0]]), "springs")
    >>> C.dense().tolist(), C.kind
    ([[0.75]], 'explicit')

    Parameters
    ----------
    A : stiffness of the body, positive definite
    B : (size, columns of A) trace on its contact nodes
    name : the body's name, for messages
    kind : "explicit", a dense matrix, from the factorization if it is MUMPS's, else by a solve for every row of B;
        "direct", a solve per multiplication; "iterative", the same by multigrid; None lets `choose_kind`
        decide, with direct instead of explicit if the factorization is not MUMPS's
    memory : free memory (bytes)
    make_solver : constructor of the solver, called as `StiffnessSolver`
    points : (nodes of A, d) their positions, for the order of elimination; without them MUMPS chooses it
    quadratic : whether A is of quadratic elements
    solves : how many problems, such as load steps, C is for

    Attributes
    ----------
    size : length of s, the rows of B
    kind, reason : the kind that was chosen, and why
    solver : solves with A
    accuracy : smallest relative error of a multiplication that can be relied on
    count : multiplications by A⁻¹ so far, by purpose; one by the dense matrix counts as a solve

    Construction factors A. Collective on the body's communicator. Raises SolverError.
    """

    def __init__(
        self,
        A: PETSc.Mat,
        B: sparse.csr_matrix,
        name: str,
        kind: str | None = None,
        memory: float = np.inf,
        make_solver: Callable[..., Any] = StiffnessSolver,
        points: np.ndarray | None = None,
        quadratic: bool = False,
        solves: int = 1,
    ) -> None:
        self.B, self.size = B, B.shape[0]
        self.kind, self.reason = plan_compliance(A, B, kind, memory, quadratic, solves)
        # C = 0: the factors are still needed for the displacement under loads.
        self._rigid = not B.count_nonzero()
        dense = self.kind == "explicit"
        # The Schur complement wants the contact's multipliers last; a nested dissection by positions keeps the fill low
        # under this restriction. Without C MUMPS orders by itself.
        order = elimination_order(A, points) if dense and points is not None else None
        self.solver = make_solver(
            A, name, B if dense else None, order, iterative=self.kind == "iterative"
        )
        self.accuracy = LEAST if self.solver.direct else USUAL
        self.count: Counter[str] = Counter()
        self._u, self._f = A.createVecs()
        self._norm = 0.0
        self._by_solves = False
        self._matrix = self.solver.condensed  # its upper triangle
        self._dense: np.ndarray | None = None  # made by dense
        if dense and self._matrix is None:
            if kind is None:
                self.kind, self.reason = (
                    "direct",
                    f"{self.solver.description} leaves no Schur complement",
                )
            else:
                with event("ComplianceForm"):
                    self._matrix = self.dense().T
        self._made = self.count.copy()

    def seen(self, W: sparse.csr_matrix, C: np.ndarray) -> Compliance:
        """The compliance W C Wᵀ of rows W (k, size) that join those of C (size, size), with the same counts. Not
        collective."""
        other = copy.copy(self)
        other.B, other.size, other._norm = W @ self.B, W.shape[0], 0.0
        other._rigid = not other.B.count_nonzero()
        joined = W @ (W @ C).T
        other._dense = other._matrix = (
            (joined + joined.T) / 2
        ).T  # symmetric; in Fortran's order for `mult`
        return other

    def another(self) -> Compliance:
        """The same on the same factors, for another case or body: without counts and estimates since the construction.
        Not collective."""
        other = copy.copy(self)
        other.count = self._made.copy()
        return other

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x (metres from newtons); both (size,). Collective on the body's communicator.

        An iterative solver may leave the fraction `relative` of the contact forces unbalanced; zero means its
        usual precision. Raises SolverError, and InterruptionError after a signal to this rank.
        """
        interrupt.check()
        if self._rigid or not x.any():
            y[:] = 0.0
            return
        with event("ComplianceMult"):
            if self._matrix is None or self._by_solves:
                self.spread(x, self._f)
                self.solve(self._f, self._u, purpose, relative)
                y[:] = self.B @ self._u.array_r
            else:
                # One triangle of C is read: half the memory traffic of a full product.
                self.count[purpose] += 1
                y[:] = dsymv(1.0, self._matrix, x)

    @contextlib.contextmanager
    def by_solves(self) -> Iterator[None]:
        """Within this context products are by solves, even of a dense C.

        A product with a dense C has the error ε ‖C‖ ‖s‖. C of a slender body is large along bending that the forces s
        hardly excite, and what they do excite is lost in that error. Not collective.
        """
        self._by_solves = True
        try:
            yield
        finally:
            self._by_solves = False

    def state(self) -> dict:
        """Plain values for `restore` of a new Compliance, to go on counting as if uninterrupted."""
        return {"count": dict(self.count), "norm": self._norm}

    def restore(self, state: dict) -> None:
        """Go on from `state`. Not collective."""
        self.count, self._norm = Counter(state["count"]), state["norm"]

    def dense(self) -> np.ndarray:
        """C (size, size) as a dense matrix (m/N); made at the first call, if need be by multiplications. Collective."""
        if self._dense is None:
            if self._matrix is not None:
                C = np.triu(self._matrix) + np.triu(self._matrix, 1).T
            else:
                counted = self.count["explicit"]
                C, unit = np.empty((self.size, self.size)), np.zeros(self.size)
                for k in range(self.size):
                    unit[k] = 1.0
                    self.mult(unit, C[k], "explicit")
                    unit[k] = 0.0
                self.count["explicit"] = (
                    counted or self.count["explicit"]
                )  # a continued run has counted them
            self._dense = (C + C.T) / 2
        return self._dense

    def spread(self, s: np.ndarray, f: PETSc.Vec) -> None:
        """f ← Bᵀ s: the contact forces s (size,) as a load (N). Not collective."""
        f.array[:] = self.B.T @ s

    def solve(self, f: PETSc.Vec, u: PETSc.Vec, purpose: str, relative: float = 0.0) -> None:
        """u ← A⁻¹ f, counted under `purpose`; `relative` as for `mult`. Collective."""
        self.count[purpose] += 1
        self.solver.solve(f, u, relative)

    def solve_all(self, loads: np.ndarray, purpose: str, relative: float = 0.0) -> np.ndarray:
        """A⁻¹ f (k, n) of several loads (k, n), each as of `solve`. Collective."""
        moved = self.solver.at_once(loads) if len(loads) else loads
        if moved is not None:
            self.count[purpose] += len(loads)
            return moved
        moved = np.empty_like(loads)
        for load, one in zip(loads, moved, strict=True):
            self._f.array[:] = load
            self.solve(self._f, self._u, purpose, relative)
            one[:] = self._u.array_r
        return moved

    def norm(self) -> float:
        """A lower bound close to ‖C‖₂ (m/N), estimated at the first call. Collective."""
        if not self._norm:
            self._norm = estimate_norm(
                lambda x, y: self.mult(x, y, "norm", NORM_PRECISION), self.size
            )
        return self._norm


def plan_compliance(
    A: PETSc.Mat,
    B: sparse.csr_matrix,
    kind: str | None,
    memory: float,
    quadratic: bool = False,
    solves: int = 1,
) -> tuple[str, str]:
    """The given `kind`, else that of `choose_kind`, and the reason; direct for a trace B without entries, of a body
    whose contact nodes cannot move. Not collective."""
    if not B.count_nonzero():
        return "direct", "clamps constrain its whole contact: C = 0" if B.shape[
            0
        ] else "it touches nothing"
    n, d = A.size[0], A.getBlockSize()
    if kind:
        return kind, "asked for"
    largest = LARGEST_CONDENSED[quadratic] * solves
    if d == 3 and n > largest:
        # Factors of slender and of flat bodies take less work: n counts as that of a box with this cross-section. A
        # layer of quadratic cells has two layers of nodes.
        largest *= max(n / (SECTION * (n / d / layers_of(A) / (1 + quadratic)) ** 1.5), 1.0)
    return choose_kind(n, B.shape[0], memory, d, largest)


def choose_kind(n: int, k: int, memory: float, d: int, largest: float) -> tuple[str, str]:
    """The kind of compliance for a body with `n` dofs, `d` of a node, and `k` contact unknowns, and the reason.

    A body whose factors exceed the `memory` (bytes) is solved by multigrid; in space also one of more than `largest`
    dofs, and one whose factors fit without the compliance, as hundreds of solves with factors take longer there. Not
    collective.
    """
    solid, dense = d == 3, 8.0 * k**2
    plain, whole = (MARGIN * memory_of_factors(n, d, condensed) for condensed in (False, True))
    whole += dense
    if plain > memory:
        return (
            "iterative",
            f"factors may take {bytes_in_words(plain)}, {bytes_in_words(memory)} are free",
        )
    if solid and n > largest:
        return "iterative", f"multigrid is faster than factors at {n} dofs"
    if k**3 > LARGEST_RATIO[solid] * n:
        return (
            "direct",
            f"a dense matrix of {k} contact unknowns costs more than it saves at {n} dofs",
        )
    if whole > memory:
        return (
            "iterative" if solid else "direct",
            f"factors and a dense matrix may take {bytes_in_words(whole)}, {bytes_in_words(memory)} are free",
        )
    return "explicit", f"a dense matrix of {bytes_in_words(dense)} beside the factors"


def memory_of_factors(n: int, d: int, condensed: bool) -> float:
    """Estimated bytes of MUMPS's factors of `n` dofs, d a node, with the compliance if `condensed`."""
    solid = d == 3
    # Nested dissection: factors grow as n log n in the plane and as n^(4/3) in space.
    growth = n ** (4 / 3) if solid else n * np.log2(max(n, 2))
    return (FACTORS_WITH_SCHUR if condensed else FACTORS)[solid] * growth


def memory_of_multigrid(A: PETSc.Mat) -> float:
    """Estimated bytes that multigrid takes beside A: coarse matrices, and vectors of the iteration, which begins with
    earlier solutions. Not collective."""
    return COARSE * 12.0 * A.getInfo()["nz_used"] + (REMEMBERED + VECTORS) * 8.0 * A.size[0]


def bytes_in_words(size: float) -> str:
    """A number of bytes in words."""
    return f"{size / 2**30:.1f} GiB" if size >= 2**30 else f"{max(size / 2**20, 0.1):.1f} MiB"
