"""The linear problem of a step by a dense factorization, where one rank has all of a small explicit compliance.

It is the system of `ddmpi.methods.krylov`, solved to rounding. With a few hundred unknowns its factors cost less than
ten iterations of GMRES, and between slender bodies GMRES takes a hundred.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from scipy.linalg.lapack import dgetrf, dgetrs

from ddmpi.coupling.joint import Joint, Point
from ddmpi.methods.krylov import Linearised, Preconditioner, Regularisation

SMALL, SMALLER, LONG = 500, 330, 40
"""Most unknown forces for dense factors: SMALL once GMRES has taken more than LONG iterations; SMALLER in load steps,
where it takes about ten. Factors of 130, 260 and 520 unknowns take 0.1, 1.1 and 5.9 ms, an iteration 0.2 to 0.3 ms."""


class Direct:
    """Directions of Newton's method by dense factors.

    Attributes
    ----------
    steps : whether the problem is a load step after the first
    long : whether GMRES has taken more than LONG iterations in a direction
    """

    def __init__(self, joint: Joint, preconditioner: Preconditioner) -> None:
        self._joint, self._preconditioner = joint, preconditioner
        self._C: np.ndarray | None = (
            None  # until it is asked for; without entries where it is not explicit
        )
        self.steps = self.long = False

    def direction(
        self,
        point: Point,
        linearised: Linearised,
        change: np.ndarray,
        wanted: np.ndarray,
        layer: np.ndarray,
        by: Regularisation,
    ) -> Point | None:
        """As `Newton.direction`; None where GMRES is cheaper, the compliance not explicit, or the matrix singular.

        Its two products with C count as multiplications. Its factors do not, as they need no product. Collective.
        Raises SolverError.
        """
        joint, rigid, k = self._joint, self._joint.rigid, linearised.number
        if not 0 < k <= (SMALLER if self.steps else SMALL if self.long else 0):
            return None
        if self._C is None:
            C = joint.dense(SMALL)
            self._C = np.empty((0, 0)) if C is None else C
        if not self._C.size:  # as on several ranks, of which one may have no unknowns
            return None
        C_change = joint.product(change, "newton")
        right = np.append(
            linearised.restrict(wanted - point.r - C_change),
            joint.imbalance(point.s + change, point.alpha),
        )
        factors = factor(self._C, joint, self._preconditioner, linearised, layer, by)
        if factors is None:
            return None
        unknowns = factors.solve(right)
        # one step of iterative refinement removes rounding, which is all that is left of forces in an unloaded step,
        # and what steers, which paths keep
        steers = 0.0 if by.precise else factors.steering * unknowns
        unknowns += factors.solve(right - factors.matrix @ unknowns + steers)
        if not np.isfinite(unknowns).all():
            return None
        dy, alpha = linearised.expand(unknowns[:k]), joint.stays.moving(unknowns[k:])
        change, C_change = change + dy, C_change + joint.product(dy, "newton")
        left = joint.imbalance(point.s + change, point.alpha + alpha) - point.left
        return Point(change, C_change - rigid.spread(alpha), alpha, left)


class Factors(NamedTuple):
    """Dense factors of the linear problem, by k unknown forces and j rigid motions.

    Attributes
    ----------
    matrix : (k + j, k + j)
    steering : (k + j,) the part of its diagonal that only steers
    lu, pivots : as of LAPACK's dgetrf
    """

    matrix: np.ndarray
    steering: np.ndarray
    lu: np.ndarray
    pivots: np.ndarray

    def solve(self, right: np.ndarray, transposed: bool = False) -> np.ndarray:
        """The unknowns (k + j,) for a right-hand side (k + j,)."""
        return dgetrs(self.lu, self.pivots, right, trans=int(transposed))[0]


def factor(
    C: np.ndarray,
    joint: Joint,
    preconditioner: Preconditioner,
    linearised: Linearised,
    layer: np.ndarray,
    by: Regularisation,
) -> Factors | None:
    """Factors of the matrix of a `LinearProblem`, with C (size, size) explicit; None if it is singular. Not collective."""
    shared, springs = by.softly(preconditioner, linearised)
    K = _matrix(C, linearised, joint, (layer + joint.D)[linearised.unknown] + shared, springs)
    lu, pivots, singular = dgetrf(K)
    return None if singular else Factors(K, np.append(shared, springs), lu, pivots)


def _matrix(
    C: np.ndarray, linearised: Linearised, joint: Joint, D: np.ndarray, springs: np.ndarray
) -> np.ndarray:
    """[Iᵀ C E + D, −Iᵀ Z; Zᵀ E, K + springs], of k unknown forces and j rigid motions. Not collective.

    C (size, size) is symmetric, Z (size, j) are the contact displacements of the motions, D (k,) are compliances, and
    `springs` (j,) the stiffnesses ε E* that steer. K is that of loads on bodies that move far. The changes of motions
    that stay are zero, in place of their equilibrium.
    """
    stays = joint.stays
    Z, springs = stays.leave(joint.rigid.Z.toarray()), np.where(stays.bolts, 1.0, springs)
    unknown, turn, size, k = linearised.unknown, linearised.turn, len(C), linearised.number
    both = np.hstack([C, Z])
    follow = np.flatnonzero(linearised.coupling)
    if len(
        follow
    ):  # Eᵀ [C Z] with E = I + F I: friction follows the pressure, one or two entries of a node
        nodes, first = np.unique(linearised.source[follow], return_index=True)
        both[nodes] += np.add.reduceat(
            linearised.coupling[follow, None] * np.hstack([C[follow], Z[follow]]), first
        )
    if turn is not None:
        both, Z = turn.T @ np.hstack([(turn.T @ both[:, :size].T).T, both[:, size:]]), turn.T @ Z
    K = np.empty((k + Z.shape[1],) * 2, order="F")
    K[:, :k] = both[unknown][:, np.append(unknown, np.ones(Z.shape[1], bool))].T
    K[:k, k:], K[k:, k:] = -Z[unknown], joint.K + np.diag(springs)
    K[np.arange(k), np.arange(k)] += D
    return K
