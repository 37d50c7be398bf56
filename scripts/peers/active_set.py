"""A semi-smooth Newton method by hand, as an expert writes it in a day: matching nodes, scikit-fem's matrices.

    python -m peers.active_set FOLDER scipy | scipy-dense | petsc | petsc-dense

``scipy`` and ``petsc`` factor the sparse matrix of all bodies anew in each step (SuperLU, MUMPS), in the displacements
of the second bodies and those of the first ones relative to them: touching and sticking are then clamps, and no row
has a zero on its diagonal. ``-dense`` factors the stiffness once, solves with a right-hand side for each contact dof,
and does the steps on this dense compliance; with mpirun -n 2 and MUMPS each process does so for one body.
"""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu
from skfem import Basis, ElementTetP1, ElementTriP1, ElementVector, MeshTet, MeshTri, asm
from skfem.models.elasticity import linear_elasticity

from peers import Answer, Case, answer_of, read_case

STEPS = 60
COLUMNS = 32
"""Right-hand sides at a time."""

TURN = 1e-8
"""A direction of slip that changes by more has not converged."""

Law = tuple[np.ndarray, np.ndarray, np.ndarray]
"""S (m, d, d), E (m, d, d) and g (m, d) of S s + E x = g at each pair, with forces s and relative displacements x in
its frame: the law of contact, linearised. Rows without S, where a pair touches or sticks, have a diagonal E."""

Solve = Callable[[np.ndarray], np.ndarray]


def stiffness(case: Case) -> sparse.csr_matrix:
    make, element = {2: (MeshTri, ElementTriP1), 3: (MeshTet, ElementTetP1)}[case.dimension]
    mesh = make(case.points.T.copy(), case.cells.T.copy())
    return asm(linear_elasticity(*case.lame), Basis(mesh, ElementVector(element()), intorder=1)).tocsr()


def linearise(case: Case, closed: np.ndarray, sticks: np.ndarray, turn: np.ndarray, share: np.ndarray) -> Law:
    """The law where pairs are closed (m,) and stick (m,); those that slip have the direction q/|q| (m, d − 1) of
    q = s_t + scale x_t and the share μ s_ν/|q| (m,), which are zero elsewhere."""
    m, d = len(case.pairs), case.dimension
    S, E, g, one = np.zeros((m, d, d)), np.zeros((m, d, d)), np.zeros((m, d)), np.eye(d - 1)
    S[~closed, 0, 0] = 1.0
    E[closed, 0, 0], g[closed, 0] = case.scale[closed], (case.scale * case.gap)[closed]
    across = share[:, None, None] * (one - turn[:, :, None] * turn[:, None])
    S[:, 1:, 0], S[:, 1:, 1:], E[:, 1:, 1:] = -case.friction * turn, one - across, -case.scale[:, None, None] * across
    S[sticks, 1:], E[sticks, 1:, 1:] = 0.0, case.scale[sticks, None, None] * one
    return S, E, g


def iterate(case: Case, step: Callable[[np.ndarray, Law], tuple[np.ndarray, np.ndarray]]) -> tuple[np.ndarray, int]:
    """Semi-smooth Newton on the cones of friction: the forces (d, m) at which the sets no longer change, and the steps.

    `step` takes which pairs are closed (m,), and the law, to forces and relative displacements, both (d, m).
    """
    m, scale, mu = len(case.pairs), case.scale, case.friction
    closed = case.gap <= 0.0
    sticks, turn, share = closed & (mu > 0.0), np.zeros((m, case.dimension - 1)), np.zeros(m)
    for k in range(1, STEPS + 1):
        s, x = step(closed, linearise(case, closed, sticks, turn, share))
        pressed, q = s[0] + scale * (x[0] - case.gap), (s[1:] + scale * x[1:]).T
        size, before = np.linalg.norm(q, axis=1), (closed, sticks, turn)
        closed = pressed > 0.0
        slips = closed & (size > mu * pressed) & (mu > 0.0)
        sticks, size = closed & ~slips & (mu > 0.0), np.where(slips, size, 1.0)
        turn, share = np.where(slips[:, None], q / size[:, None], 0.0), np.where(slips, mu * pressed / size, 0.0)
        if (np.array_equal(closed, before[0]) and np.array_equal(sticks, before[1])
                and np.abs(turn - before[2]).max() < TURN):
            return s, k
    raise RuntimeError(f"the active set still changes after {STEPS} steps")


# Sparse: touching and sticking are clamps

def by_clamps(case: Case, factor: Callable[[sparse.csr_matrix], Solve]) -> Answer:
    size, d, (first, second) = case.load.size, case.dimension, case.pairs.T
    dofs = d * first[:, None] + np.arange(d)  # of relative displacements in the frames, which replace those along axes
    others, bodily = np.setdiff1d(np.arange(size), dofs), np.flatnonzero(second >= 0)
    parts = [(others, others, np.ones(len(others)))]
    for c in range(d):
        parts += [(dofs[:, c], dofs[:, a], case.frame[:, a, c]) for a in range(d)]
        parts.append((dofs[bodily, c], d * second[bodily] + c, np.ones(len(bodily))))
    rows, columns, values = (np.concatenate(each) for each in zip(*parts, strict=True))
    T = sparse.csr_matrix((values, (rows, columns)), (size, size))
    K, f = (T.T @ stiffness(case) @ T).tocsr(), T.T @ case.load
    held = np.zeros(size, bool)
    held[case.clamped] = True
    held[dofs] = (np.isin(dofs, case.clamped)[:, None] & (np.abs(case.frame) > 0.5)).any(axis=2)  # what lies along
    v = np.zeros(size)

    def step(closed: np.ndarray, law: Law) -> tuple[np.ndarray, np.ndarray]:
        S, E, g = law
        given = ~S.any(axis=2)
        known = held.copy()
        known[dofs[given]] = True
        v[:] = 0.0
        v[dofs[given]] = g[given] / np.diagonal(E, axis1=1, axis2=2)[given]
        free, at = np.flatnonzero(~known), (np.repeat(dofs, d, axis=1).ravel(), np.tile(dofs, d).ravel())
        R = sparse.csr_matrix((np.concatenate([np.ones(len(others)), S.ravel()]),
                               (np.concatenate([others, at[0]]), np.concatenate([others, at[1]]))), (size, size))
        R.eliminate_zeros()
        M = (R @ K - sparse.csr_matrix((E.ravel(), at), (size, size)))[free]  # S (f − K v) + E v = g
        v[free] = factor(M[:, free])((R @ f)[free] - M @ v)
        s = np.where(closed[:, None], (f - K @ v)[dofs], 0.0)
        s[:, 1:] *= case.friction > 0.0
        return s.T, v[dofs].T

    s, steps = iterate(case, step)
    return answer_of(case, T @ v, s, steps)


# Dense: the compliance of all contact dofs

def by_compliance(case: Case, factor: Callable[[sparse.csr_matrix], Solve], comm=None) -> Answer:
    """Each rank of `comm` does the bodies whose numbers it has; all of them without."""
    size, m, d = case.load.size, len(case.pairs), case.dimension
    own = np.zeros(size, bool)
    mine = case.cells if comm is None else case.cells[case.body % comm.size == comm.rank]
    own[np.unique(d * mine.ravel()[:, None] + np.arange(d))] = True
    own[case.clamped] = False
    free = np.flatnonzero(own)
    K = stiffness(dataclasses.replace(case, cells=mine))[free][:, free]
    rows, columns, values = case.relative()
    B = sparse.csr_matrix((values, (rows, columns)), (d * m, size))[:, free]
    t = d if case.friction else 1  # components that have forces
    B, solve = B[:t * m], factor(K)
    u = solve(case.load[free])
    C, h = np.empty((t * m, t * m)), B @ u
    for k in range(0, t * m, COLUMNS):
        C[:, k:k + COLUMNS] = B @ solve(B[k:k + COLUMNS].T.toarray())
    if comm is not None:
        C, h = comm.allreduce(C), comm.allreduce(h)

    def step(closed: np.ndarray, law: Law) -> tuple[np.ndarray, np.ndarray]:
        S, E, g = (each[closed] for each in law)
        at, i = (m * np.arange(t)[:, None] + np.flatnonzero(closed)).ravel(), np.arange(closed.sum())
        A = -np.einsum("iab,bij->aij", E[:, :t, :t], C[np.ix_(at, at)].reshape(t, len(i), -1))
        A.reshape(t, len(i), t, len(i))[:, i, :, i] += S[:, :t, :t]  # S s + E (h − C s) = g
        s = np.zeros((d, m))
        s[:t].ravel()[at] = np.linalg.solve(A.reshape(len(at), -1),
                                            (g.T[:t] - np.einsum("iab,bi->ai", E[:, :t, :t],
                                                                 h[at].reshape(t, -1))).ravel())
        x = np.zeros((d, m))
        x[:t] = (h - C @ s[:t].ravel()).reshape(t, m)
        return s, x

    s, steps = iterate(case, step)
    whole = np.zeros(size)
    whole[free] = u - solve(B.T @ s[:t].ravel())
    if comm is not None:
        whole = comm.allreduce(whole)
    return answer_of(case, whole, s, steps)


# Factors

def superlu(A: sparse.csr_matrix) -> Solve:
    """SuperLU in its symmetric mode, which here is several times faster than its default."""
    return splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True}).solve


def mumps(case: Case, symmetric: bool) -> Callable[[sparse.csr_matrix], Solve]:
    from petsc4py import PETSc

    if case.dimension == 2:  # least fill, here a third faster than what MUMPS would choose, which is best in space
        PETSc.Options().setValue("mat_mumps_icntl_7", 2)
    former = []

    def factor(A: sparse.csr_matrix) -> Solve:
        for thing in former:
            thing.destroy()
        A.sort_indices()
        matrix = PETSc.Mat().createAIJ(A.shape, csr=(A.indptr, A.indices, A.data), comm=PETSc.COMM_SELF)
        if symmetric:
            matrix.setOption(PETSc.Mat.Option.SPD, True)
        pc = PETSc.PC().create(PETSc.COMM_SELF)
        pc.setOperators(matrix)
        pc.setType("cholesky" if symmetric else "lu")
        pc.setFactorSolverType("mumps")
        pc.setUp()
        former[:] = pc, matrix
        factors = pc.getFactorMatrix()

        def solve(b: np.ndarray) -> np.ndarray:
            B = PETSc.Mat().createDense((len(b), b.size // len(b)), array=b.reshape(len(b), -1).copy(order="F"),
                                        comm=PETSc.COMM_SELF)
            X = B.duplicate()
            factors.matSolve(B, X)
            x = X.getDenseArray().reshape(b.shape).copy()
            B.destroy()
            X.destroy()
            return x

        return solve

    return factor


def main(folder: Path, kind: str) -> None:
    case, comm = read_case(folder), None
    if kind == "petsc-dense":
        from mpi4py import MPI
        comm = MPI.COMM_WORLD
        answer = by_compliance(case, mumps(case, True), comm)
    elif kind == "scipy-dense":
        answer = by_compliance(case, superlu)
    else:
        answer = by_clamps(case, superlu if kind == "scipy" else mumps(case, False))
    if comm is None or comm.rank == 0:
        answer.save(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
