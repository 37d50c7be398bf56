"""One quadratic program whose unknowns lie on several ranks, unequally many on each: all ranks do the same steps."""

import numpy as np
import pytest
from mpi4py import MPI
from petsc4py import PETSc
from test_mprgp import bounds, random_matrix

from ddmpi.published.apg import APG
from ddmpi.published.mprgp import MPRGP
from ddmpi.sets import Box, Discs, product

pytestmark = pytest.mark.slow

one_to_three_ranks = pytest.mark.mpi(ranks=[1, 2, 3])
SIZE, CONDITION, PRECISION = 120, 1e3, 1e-7
PARTS = {1: [0, 120], 2: [0, 3, 120], 3: [0, 100, 103, 120]}
"""Where the unknowns of each rank begin."""


class Shared:
    """A dense operator of which each rank has some rows and the unknowns that belong to them."""

    def __init__(self, comm, matrix: np.ndarray) -> None:
        self.comm, self.matrix = comm, matrix
        start, stop = PARTS[comm.size][comm.rank : comm.rank + 2]
        self.own, self.size = slice(start, stop), stop - start

    def whole(self, x: np.ndarray) -> np.ndarray:
        return np.concatenate(self.comm.allgather(x))

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        y[:] = self.matrix[self.own] @ self.whole(x)


def solve_shared(C: Shared, d: np.ndarray, kind, constraints: Box) -> np.ndarray:
    """The solution of a user's own TAO of this kind on all ranks, after the same steps on each."""
    petsc_comm = MPI.Intracomm(C.comm)  # PETSc takes no subclass of it
    H = PETSc.Mat().createDense(
        ((C.size, SIZE), (C.size, SIZE)), array=np.asfortranarray(C.matrix[C.own]), comm=petsc_comm
    )
    H.assemble()
    x, right = H.createVecs()
    right.array[:] = d[C.own]
    solver = PETSc.TAO().create(petsc_comm)
    solver.setType("python")
    context = kind() if type(constraints) is Box else kind(constraints)
    solver.setPythonContext(context)
    low, up = x.duplicate(), x.duplicate()
    low.array[:], up.array[:] = constraints.lower, constraints.upper
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
    steps = C.comm.allgather((solver.getIterationNumber(), context.steps))
    assert steps == [steps[0]] * C.comm.size and steps[0][0] > 50
    return C.whole(x.array_r)


@one_to_three_ranks
def test_mprgp_of_a_users_own_tao_is_solved_on_several_ranks(comm):
    """As a TAO type it serves other programs: it estimates the norm of their matrix on all ranks together."""
    matrix, d = random_matrix(SIZE, CONDITION, 3), np.random.default_rng(4).normal(size=SIZE)
    lower, upper = bounds("contact", np.linalg.solve(matrix, d), 5)
    C = Shared(comm, matrix)
    s = solve_shared(C, d, MPRGP, Box(lower[C.own], upper[C.own]))
    assert (
        np.linalg.norm(Box(lower, upper).projected_gradient(matrix @ s - d, s)) <= 1.1 * PRECISION
    )


@one_to_three_ranks
def test_discs_on_several_ranks_are_solved_by_the_same_steps(comm):
    """Each rank has discs of its own, one rank three unknowns only."""
    matrix, d = random_matrix(SIZE, 100.0, 7), np.random.default_rng(8).normal(size=SIZE)
    radius = np.median(np.abs(np.linalg.solve(matrix, d)))

    def discs(number: int) -> Discs:
        normals, k = np.arange(number) % 3 == 0, number // 3
        return Discs(
            np.where(normals, 0.0, -np.inf),
            np.full(number, np.inf),
            3 * np.arange(k)[:, None] + [1, 2],
            radius * (1 + np.arange(k) % 5) / 5,
        )

    parts = [discs(number) for number in np.diff(PARTS[comm.size])]
    s = solve_shared(Shared(comm, matrix), d, APG, parts[comm.rank])
    assert np.linalg.norm(product(parts).reduced(matrix @ s - d, s, 1.0)) <= 1.1 * PRECISION
