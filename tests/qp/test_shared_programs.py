"""One quadratic program whose unknowns lie on several ranks, unequally many on each: all ranks do the same steps."""

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from test_mprgp import bounds, random_matrix

from ddmpi.errors import SolverError
from ddmpi.petsc.lanczos import estimate_norm
from ddmpi.qp import tao
from ddmpi.qp.box import Box, Discs, product
from ddmpi.qp.mprgp import MPRGP
from ddmpi.qp.program import QP
from ddmpi.qp.tao import QPSolver

pytestmark = pytest.mark.slow

one_to_three_ranks = pytest.mark.mpi(ranks=[1, 2, 3])
SIZE, CONDITION, PRECISION = 120, 1e6, 1e-9
PARTS = {1: [0, 120], 2: [0, 3, 120], 3: [0, 100, 103, 120]}
"""Where the unknowns of each rank begin."""


class Shared:
    """A dense operator of which each rank has some rows and the unknowns that belong to them."""

    def __init__(self, comm, matrix: np.ndarray) -> None:
        self.comm, self.matrix = comm, matrix
        start, stop = PARTS[comm.size][comm.rank:comm.rank + 2]
        self.own, self.size, self.products = slice(start, stop), stop - start, 0

    def whole(self, x: np.ndarray) -> np.ndarray:
        return np.concatenate(self.comm.allgather(x))

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        self.products += 1
        y[:] = self.matrix[self.own] @ self.whole(x)

    def norm(self) -> float:
        return 1.0


def shared_program(comm) -> tuple[QP, np.ndarray, np.ndarray, np.ndarray]:
    """A QP that takes hundreds of steps, the own part of it; and matrix, lower and upper bounds of the whole."""
    matrix = random_matrix(SIZE, CONDITION, 3)
    d = np.random.default_rng(4).normal(size=SIZE)
    lower, upper = bounds("contact", np.linalg.solve(matrix, d), 5)
    C = Shared(comm, matrix)
    petsc_comm = MPI.Intracomm(comm)  # PETSc takes no subclass of it
    qp = QP(C, d[C.own], Box(lower[C.own], upper[C.own]), lambda x: float(np.linalg.norm(C.whole(x))),
            petsc_comm if comm.size > 1 else None)
    return qp, d, lower, upper


@one_to_three_ranks
def test_a_program_of_hundreds_of_steps_ends_on_all_ranks_alike(comm):
    """The limit of steps is that of all unknowns: a rank with three of them does not leave before the others."""
    qp, d, lower, upper = shared_program(comm)
    zero = np.zeros(qp.C.size)
    result = QPSolver().solve(qp, zero, zero.copy(), PRECISION, "program")
    steps = comm.allgather((result.iterations, result.steps, qp.C.products))
    assert steps == [steps[0]] * comm.size
    assert result.iterations > 20 * 3 + 200  # what 0.6.0 allowed a rank with three unknowns
    s = qp.C.whole(result.s)
    assert Box(lower, upper).projected_gradient(qp.C.matrix @ s - d, s) == pytest.approx(np.zeros(SIZE), abs=PRECISION)


@one_to_three_ranks
def test_discs_on_several_ranks_are_solved_by_the_same_steps(comm):
    """Each rank has discs of its own, one rank three unknowns only."""
    matrix, d = random_matrix(SIZE, 100.0, 7), np.random.default_rng(8).normal(size=SIZE)
    radius = np.median(np.abs(np.linalg.solve(matrix, d)))

    def discs(number: int) -> Discs:
        normals, k = np.arange(number) % 3 == 0, number // 3
        return Discs(np.where(normals, 0.0, -np.inf), np.full(number, np.inf), 3 * np.arange(k)[:, None] + [1, 2],
                     radius * (1 + np.arange(k) % 5) / 5)

    parts = [discs(number) for number in np.diff(PARTS[comm.size])]
    C = Shared(comm, matrix)
    qp = QP(C, d[C.own], parts[comm.rank], lambda x: float(np.linalg.norm(C.whole(x))),
            MPI.Intracomm(comm) if comm.size > 1 else None)
    zero = np.zeros(C.size)
    result = QPSolver().solve(qp, zero, zero.copy(), PRECISION, "program")
    steps = comm.allgather((result.iterations, result.steps, C.products))
    assert steps == [steps[0]] * comm.size
    s = C.whole(result.s)
    assert np.linalg.norm(product(parts).reduced(matrix @ s - d, s, 1.0)) <= 1.1 * PRECISION


@one_to_three_ranks
def test_a_program_that_is_given_up_is_given_up_by_all_ranks(comm, monkeypatch):
    """At the limit all ranks raise the same error, after the same number of steps."""
    monkeypatch.setattr(tao, "MOST", 1)
    qp, *_ = shared_program(comm)
    zero = np.zeros(qp.C.size)
    with pytest.raises(SolverError, match=f"DIVERGED_MAXITS after {SIZE + 1} iterations"):
        QPSolver().solve(qp, zero, zero.copy(), PRECISION, "program")
    assert comm.allgather(qp.C.products) == [qp.C.products] * comm.size


@one_to_three_ranks
def test_a_start_that_only_one_rank_has_to_move_is_followed_by_all(comm):
    """One rank's start lies outside its bounds: all ranks make the product that this costs."""
    qp, *_ = shared_program(comm)
    start = np.zeros(qp.C.size)
    start[:1] = -1.0 if comm.rank == comm.size - 1 and qp.constraints.lower[0] == 0.0 else 0.0
    start[-1:] = 1e9 if comm.rank == comm.size - 1 else 0.0
    product = np.empty_like(start)
    qp.C.mult(start, product, "program")
    result = QPSolver().solve(qp, start, product, 1e-3, "program")
    assert result.residual <= 1e-3
    assert comm.allgather(qp.C.products) == [qp.C.products] * comm.size


@one_to_three_ranks
def test_mprgp_of_a_users_own_tao_is_solved_on_several_ranks(comm):
    """As a TAO type it serves other programs: it estimates the norm of their matrix on all ranks together."""
    qp, d, lower, upper = shared_program(comm)
    C, petsc_comm = qp.C, MPI.Intracomm(comm)
    H = PETSc.Mat().createDense(((C.size, SIZE), (C.size, SIZE)), array=np.asfortranarray(C.matrix[C.own]),
                                comm=petsc_comm)
    H.assemble()
    x, right = H.createVecs()
    right.array[:] = qp.d
    solver = PETSc.TAO().create(petsc_comm)
    solver.setType("python")
    solver.setPythonContext(MPRGP())
    low, up = x.duplicate(), x.duplicate()
    low.array[:], up.array[:] = qp.constraints.lower, qp.constraints.upper
    solver.setSolution(x)
    solver.setVariableBounds((low, up))

    def gradient(_tao, X, G):
        H.mult(X, G)
        G.axpy(-1.0, right)

    solver.setGradient(gradient, x.duplicate())
    solver.setHessian(lambda *_: None, H)
    solver.setMaximumIterations(100 * SIZE)
    solver.setTolerances(gatol=PRECISION, grtol=0.0, gttol=0.0)
    solver.solve()
    s = C.whole(x.array_r)
    assert np.linalg.norm(Box(lower, upper).projected_gradient(C.matrix @ s - d, s)) <= 1.1 * PRECISION


@one_to_three_ranks
def test_the_norm_of_a_shared_operator_is_that_of_the_whole(comm):
    """Lanczos steps on parts of vectors find the largest eigenvalue of all of it."""
    C = Shared(comm, random_matrix(SIZE, 100.0, 6))

    def products(V, y):
        return comm.allreduce(V @ y)

    found = estimate_norm(lambda x, y: C.mult(x, y, "norm"), C.size, products=products, steps=SIZE)
    assert 0.95 <= found <= 1.0 + 1e-12
    assert comm.allgather(found) == [found] * comm.size
