"""A semi-smooth Newton method by hand, as an expert writes it in a day: matching nodes, scikit-fem's matrices.

    python -m peers.active_set FOLDER

MUMPS factors the sparse matrix of all bodies anew in each step, in the displacements of the second bodies and those of
the first ones relative to them: touching and sticking are then clamps, and no row has a zero on its diagonal.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc
from skfem import Basis, ElementTetP1, ElementVector, MeshTet, asm
from skfem.models.elasticity import linear_elasticity

from peers import Answer, Case, answer_of, read_case

STEPS = 60
TURN = 1e-8
"""A direction of slip that changes by more has not converged."""

Law = tuple[np.ndarray, np.ndarray, np.ndarray]
"""S (m, 3, 3), E (m, 3, 3) and g (m, 3) of S s + E x = g at each pair, with forces s and relative displacements x in
its frame: the law of contact, linearised. Rows without S, where a pair touches or sticks, have a diagonal E."""


def stiffness(case: Case) -> sparse.csr_matrix:
    mesh = MeshTet(case.points.T.copy(), case.cells.T.copy())
    return asm(
        linear_elasticity(*case.lame), Basis(mesh, ElementVector(ElementTetP1()), intorder=1)
    ).tocsr()


def linearise(
    case: Case, closed: np.ndarray, sticks: np.ndarray, turn: np.ndarray, share: np.ndarray
) -> Law:
    """The law where pairs are closed (m,) and stick (m,); those that slip have the direction q/|q| (m, 2) of
    q = s_t + scale x_t and the share μ s_ν/|q| (m,), which are zero elsewhere."""
    m = len(case.pairs)
    S, E, g, one = np.zeros((m, 3, 3)), np.zeros((m, 3, 3)), np.zeros((m, 3)), np.eye(2)
    S[~closed, 0, 0] = 1.0
    E[closed, 0, 0], g[closed, 0] = case.scale[closed], (case.scale * case.gap)[closed]
    across = share[:, None, None] * (one - turn[:, :, None] * turn[:, None])
    S[:, 1:, 0], S[:, 1:, 1:], E[:, 1:, 1:] = (
        -case.friction * turn,
        one - across,
        -case.scale[:, None, None] * across,
    )
    S[sticks, 1:], E[sticks, 1:, 1:] = 0.0, case.scale[sticks, None, None] * one
    return S, E, g


def iterate(
    case: Case, step: Callable[[np.ndarray, Law], tuple[np.ndarray, np.ndarray]]
) -> tuple[np.ndarray, int]:
    """Semi-smooth Newton on the cones of friction: the forces (3, m) at which the sets no longer change, and the steps.

    `step` takes which pairs are closed (m,), and the law, to forces and relative displacements, both (3, m).
    """
    m, scale, mu = len(case.pairs), case.scale, case.friction
    closed = case.gap <= 0.0
    sticks, turn, share = closed & (mu > 0.0), np.zeros((m, 2)), np.zeros(m)
    for k in range(1, STEPS + 1):
        s, x = step(closed, linearise(case, closed, sticks, turn, share))
        pressed, q = s[0] + scale * (x[0] - case.gap), (s[1:] + scale * x[1:]).T
        size, before = np.linalg.norm(q, axis=1), (closed, sticks, turn)
        closed = pressed > 0.0
        slips = closed & (size > mu * pressed) & (mu > 0.0)
        sticks, size = closed & ~slips & (mu > 0.0), np.where(slips, size, 1.0)
        turn, share = (
            np.where(slips[:, None], q / size[:, None], 0.0),
            np.where(slips, mu * pressed / size, 0.0),
        )
        if (
            np.array_equal(closed, before[0])
            and np.array_equal(sticks, before[1])
            and np.abs(turn - before[2]).max() < TURN
        ):
            return s, k
    raise RuntimeError(f"the active set still changes after {STEPS} steps")


def by_clamps(case: Case) -> Answer:
    size, d, (first, second) = case.load.size, 3, case.pairs.T
    # Relative displacements in the frames replace those along the axes.
    dofs = d * first[:, None] + np.arange(d)
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
    # A clamp holds the component that lies along its axis.
    held[dofs] = (np.isin(dofs, case.clamped)[:, None] & (np.abs(case.frame) > 0.5)).any(axis=2)
    v = np.zeros(size)

    def step(closed: np.ndarray, law: Law) -> tuple[np.ndarray, np.ndarray]:
        S, E, g = law
        given = ~S.any(axis=2)
        known = held.copy()
        known[dofs[given]] = True
        v[:] = 0.0
        v[dofs[given]] = g[given] / np.diagonal(E, axis1=1, axis2=2)[given]
        free, at = (
            np.flatnonzero(~known),
            (np.repeat(dofs, d, axis=1).ravel(), np.tile(dofs, d).ravel()),
        )
        R = sparse.csr_matrix(
            (
                np.concatenate([np.ones(len(others)), S.ravel()]),
                (np.concatenate([others, at[0]]), np.concatenate([others, at[1]])),
            ),
            (size, size),
        )
        R.eliminate_zeros()
        # The step solves S (f − K v) + E v = g.
        M = (R @ K - sparse.csr_matrix((E.ravel(), at), (size, size)))[free]
        v[free] = solve(M[:, free].tocsr(), (R @ f)[free] - M @ v)
        s = np.where(closed[:, None], (f - K @ v)[dofs], 0.0)
        s[:, 1:] *= case.friction > 0.0
        return s.T, v[dofs].T

    s, steps = iterate(case, step)
    return answer_of(case, T @ v, s, steps)


def solve(A: sparse.csr_matrix, b: np.ndarray) -> np.ndarray:
    """A⁻¹ b by MUMPS, with the ordering that it chooses."""
    A.sort_indices()
    matrix = PETSc.Mat().createAIJ(A.shape, csr=(A.indptr, A.indices, A.data), comm=PETSc.COMM_SELF)
    pc, x = PETSc.PC().create(PETSc.COMM_SELF), matrix.createVecRight()
    pc.setOperators(matrix)
    pc.setType("lu")
    pc.setFactorSolverType("mumps")
    pc.setUp()
    pc.apply(PETSc.Vec().createWithArray(b, comm=PETSc.COMM_SELF), x)
    found = x.getArray().copy()
    for thing in (pc, matrix, x):
        thing.destroy()
    return found


if __name__ == "__main__":
    by_clamps(read_case(Path(sys.argv[1]))).save(Path(sys.argv[1]))
