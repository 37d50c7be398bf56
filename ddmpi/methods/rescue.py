"""Successive approximations, which move Newton's iterate where its own steps lead nowhere.

Each one freezes the slip bounds and solves the convex QP that is left, which MPRGP always does. The first rescue
makes one of them, and every further one twice as many as the one before.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ddmpi.coupling.joint import Joint
from ddmpi.qp.program import QP
from ddmpi.qp.tao import QPSolver

MOST_APPROXIMATIONS = 64
"""Most successive approximations in a row."""

LEAST_RELAXATION = 0.02
"""The slip bound is relaxed by this or more from one successive approximation to the next."""

MOST_PRECISE = 1e-10
"""No QP is solved to less than this, relative to the forces."""


class Rescue:
    """The rescues of one Newton iteration.

    Parameters
    ----------
    joint : the operator
    stiffness : c (N/m), which turns forces into displacements

    Attributes
    ----------
    left : approximations still to be made in the present rescue
    """

    def __init__(self, joint: Joint, stiffness: float) -> None:
        self._joint, self._laws, self._stiffness = joint, joint.space.laws, stiffness
        self.left = 0
        self._number = 0
        self._bound, self._relaxation, self._change = np.empty(0), 1.0, np.inf

    def begin(self, s: np.ndarray) -> None:
        """A further rescue, from the forces s (size,)."""
        self.left = min(2**self._number, MOST_APPROXIMATIONS)
        self._bound, self._relaxation, self._change = self._laws.bound_at(s), 1.0, np.inf
        self._number += 1

    def approximate(self, s: np.ndarray, residual: float, size: float) -> tuple[np.ndarray, np.ndarray, int]:
        """One successive approximation from the forces s.

        Parameters
        ----------
        residual : of the contact equations, relative
        size : norm that forces are compared with (N)

        Returns
        -------
        s, Cs : (size,) new forces (N) and their product with C (m)
        iterations : of MPRGP

        Collective. Raises SolverError on all ranks.
        """
        joint, bound = self._joint, self._bound
        qp = QP(joint, joint.d, self._laws.frozen(bound))
        precision = max(0.1 ** (1 + self._number) * residual, MOST_PRECISE) * size / self._stiffness
        start, iterations = qp.constraints.project(s), 0
        Cs = joint.product(start, "approximation")
        with joint.deferred():
            solver = QPSolver()
            solver.type = "python"  # the options are meant for the published iteration
            result = solver.solve(qp, start, Cs, precision, "approximation", joint.neglected / self._stiffness)
            start, Cs, iterations = result.s, result.Cs, result.iterations
        joint.meet("approximation made")
        if np.array_equal(start, s):
            self.left = 1  # more of them would change nothing
        change = self._laws.bound_at(start) - bound  # the less the bound settles, the less of it is taken
        norm = float(np.linalg.norm(change))
        if norm > 0.9 * self._change:
            self._relaxation = max(0.7 * self._relaxation, LEAST_RELAXATION)
        self._bound, self._change = bound + self._relaxation * change, norm
        self.left -= 1
        return start, Cs, iterations

    def state(self) -> dict[str, Any]:
        return {"number": self._number, "left": self.left, "bound": self._bound, "relaxation": self._relaxation,
                "change": self._change}

    def restore(self, state: dict[str, Any]) -> None:
        self._number, self.left, self._bound = int(state["number"]), int(state["left"]), state["bound"]
        self._relaxation, self._change = float(state["relaxation"]), float(state["change"])
