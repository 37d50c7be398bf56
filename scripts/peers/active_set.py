"""A primal-dual active set by hand, as an expert writes it in a day: matching nodes, scikit-fem's matrices.

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
from skfem import Basis, ElementTriP1, ElementVector, MeshTri, asm
from skfem.models.elasticity import linear_elasticity

from peers import Answer, Case, answer_of, read_case

STEPS = 60
COLUMNS = 32
"""Right-hand sides at a time."""

Step = Callable[[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""From closed (m,) and the sign of the slip (m,), zero where a node sticks, to forces and relative displacements, both
(2, m) by normal and tangential part."""

Solve = Callable[[np.ndarray], np.ndarray]


def stiffness(case: Case) -> sparse.csr_matrix:
    mesh = MeshTri(case.points.T.copy(), case.triangles.T.copy())
    return asm(linear_elasticity(*case.lame), Basis(mesh, ElementVector(ElementTriP1()), intorder=1)).tocsr()


def iterate(case: Case, step: Step) -> tuple[np.ndarray, int]:
    """The forces (2, m) at which the sets no longer change, and the number of steps."""
    scale, mu = case.young / 2 / (1 - case.poisson**2), case.friction
    closed, sign = case.gap <= 0.0, np.zeros(len(case.gap))
    for k in range(1, STEPS + 1):
        s, d = step(closed, sign)
        pressed = s[0] + scale * (d[0] - case.gap)
        pushed = s[1] + scale * d[1]
        sliding = np.where(np.abs(pushed) > mu * pressed, np.sign(pushed), 0.0)
        now = pressed > 0.0, np.where(pressed > 0.0, sliding, 0.0)
        if np.array_equal(now[0], closed) and np.array_equal(now[1], sign):
            return s, k
        closed, sign = now
    raise RuntimeError(f"the active set still changes after {STEPS} steps")


# Sparse: touching and sticking are clamps

def by_clamps(case: Case, factor: Callable[[sparse.csr_matrix], Solve]) -> Answer:
    size, (first, second) = case.load.size, case.pairs.T
    normal, tangential = 2 * first, 2 * first + 1  # dofs of relative displacements, which replace those in x and y
    others, bodily = np.setdiff1d(np.arange(size), [normal, tangential]), np.flatnonzero(second >= 0)
    parts = [(others, others, np.ones(len(others)))]
    for c in range(2):
        parts += [(2 * first + c, normal, case.normal[:, c]), (2 * first + c, tangential, case.tangent[:, c]),
                  (2 * first[bodily] + c, 2 * second[bodily] + c, np.ones(len(bodily)))]
    rows, columns, values = (np.concatenate(each) for each in zip(*parts, strict=True))
    T = sparse.csr_matrix((values, (rows, columns)), (size, size))
    K, f = (T.T @ stiffness(case) @ T).tocsr(), T.T @ case.load
    held = np.zeros(size, bool)
    held[case.clamped] = True
    for c in range(2):  # a clamp in x or y holds the part of a pair that lies along it
        along = np.where(np.abs(case.normal[:, c]) > 0.5, normal, tangential)
        held[along] = np.isin(2 * first + c, case.clamped)
    v = np.zeros(size)

    def step(closed: np.ndarray, sign: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        slips = closed & ((sign != 0.0) | (case.friction == 0.0)) & ~held[tangential]
        known = held.copy()
        known[normal[closed]] = True
        known[tangential[closed & ~slips]] = True
        v[:] = 0.0
        v[normal[closed]] = case.gap[closed]
        free = np.flatnonzero(~known)
        at = np.searchsorted(free, tangential[slips])
        R = sparse.csr_matrix((np.concatenate([np.ones(len(free)), -case.friction * sign[slips]]),  # s_t = ±μ s_ν
                               (np.concatenate([np.arange(len(free)), at]),
                                np.concatenate([free, normal[slips]]))), (len(free), size))
        M = R @ K
        v[free] = factor(M[:, free])(R @ f - M @ v)
        force = f - K @ v
        s = np.where(closed, np.stack([force[normal], force[tangential] * (case.friction > 0.0)]), 0.0)
        return s, np.stack([v[normal], v[tangential]])

    s, steps = iterate(case, step)
    return answer_of(case, T @ v, s, steps)


# Dense: the compliance of all contact dofs

def by_compliance(case: Case, factor: Callable[[sparse.csr_matrix], Solve], comm=None) -> Answer:
    """Each rank of `comm` does the bodies whose numbers it has; all of them without."""
    nv, m = len(case.points), len(case.pairs)
    own = np.zeros(2 * nv, bool)
    mine = case.triangles if comm is None else case.triangles[case.body % comm.size == comm.rank]
    own[np.unique(2 * mine.ravel()[:, None] + np.arange(2))] = True
    own[case.clamped] = False
    free = np.flatnonzero(own)
    K = stiffness(dataclasses.replace(case, triangles=mine))[free][:, free]
    B = sparse.vstack([sparse.csr_matrix((values, (rows, columns)), (m, 2 * nv)) for rows, columns, values in
                       map(case.relative, (case.normal, case.tangent))]).tocsr()[:, free]
    if case.friction == 0.0:
        B = B[:m]
    size, solve = B.shape[0], factor(K)
    u = solve(case.load[free])
    C, h = np.empty((size, size)), B @ u
    for k in range(0, size, COLUMNS):
        C[:, k:k + COLUMNS] = B @ solve(B[k:k + COLUMNS].T.toarray())
    if comm is not None:
        C, h = comm.allreduce(C), comm.allreduce(h)

    def step(closed: np.ndarray, sign: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        sticks = closed & (sign == 0.0) & (size > m)
        unknown = np.concatenate([closed, sticks] if size > m else [closed])
        P = np.zeros((size, unknown.sum()))
        P[np.flatnonzero(unknown), np.arange(unknown.sum())] = 1.0
        if size > m:
            P[m + np.flatnonzero(closed), np.arange(closed.sum())] = case.friction * sign[closed]
        rest = h - np.concatenate([case.gap, np.zeros(size - m)])
        s = P @ np.linalg.solve((C @ P)[unknown], rest[unknown])
        d = h - C @ s
        return tuple(np.stack([part[:m], part[m:] if size > m else np.zeros(m)]) for part in (s, d))

    s, steps = iterate(case, step)
    whole = np.zeros(2 * nv)
    whole[free] = u - solve(B.T @ s.ravel()[:size])
    if comm is not None:
        whole = comm.allreduce(whole)
    return answer_of(case, whole, s, steps)


# Factors

def superlu(A: sparse.csr_matrix) -> Solve:
    """SuperLU in its symmetric mode, which here is several times faster than its default."""
    return splu(A.tocsc(), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.01, options={"SymmetricMode": True}).solve


def mumps(symmetric: bool) -> Callable[[sparse.csr_matrix], Solve]:
    from petsc4py import PETSc

    PETSc.Options().setValue("mat_mumps_icntl_7", 2)  # least fill, here a third faster than what MUMPS would choose
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
        answer = by_compliance(case, mumps(True), comm)
    elif kind == "scipy-dense":
        answer = by_compliance(case, superlu)
    else:
        answer = by_clamps(case, superlu if kind == "scipy" else mumps(False))
    if comm is None or comm.rank == 0:
        answer.save(folder)


if __name__ == "__main__":
    main(Path(sys.argv[1]), sys.argv[2])
