"""Successive approximations, which move Newton's iterate where its own steps lead nowhere.

Each one freezes the slip bounds and solves the convex QP that is left, which MPRGP always does. The first rescue
makes one of them, and every further one twice as many as the one before.

Bodies that nothing holds hang on springs about where they are, and move on with every approximation (the augmented
Lagrangian method with their motions α as multipliers). The springs get weaker from rescue to rescue. The first one
begins where Newton's method began, the next where the last one ended: its iterate may have carried bodies off.
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


LOOSE_APPROXIMATIONS, LOOSE_PRECISE = 5, 1e-3
"""With loose bodies the first rescue makes so many approximations, each to this precision or better."""

SPRUNG_ROUNDING = 1e-12
"""Relative rounding of displacements that springs of loose bodies cause."""

WEAKER = 10.0
"""From rescue to rescue the springs get weaker by this."""

UNSEEN = 1e-20
"""Squares of motions at contacts below this part of the largest are rounding."""

DRIFT, PROGRESS, BACK = 1e-4, 0.97, 5
"""Loose bodies drift in a rescue when their imbalance, over the loads, stays above the first and has not come below the
second times what it was so many approximations before."""

CLOSING = 1e-3
"""Bodies on the way to each other faster than this part of the largest velocity at a contact do not drift for ever."""

DRIFTS = 2
"""After so many rescues in a row in which bodies drift no equilibrium is to be expected."""


class Rescue:
    """The rescues of one Newton iteration.

    Parameters
    ----------
    joint : the operator
    stiffness : c (N/m), which turns forces into displacements

    Attributes
    ----------
    left : approximations still to be made in the present rescue
    drifts : whether loose bodies go on and on, so that no equilibrium is to be expected: a finding, not a proof
    """

    def __init__(self, joint: Joint, stiffness: float) -> None:
        self._joint, self._space, self._stiffness = joint, joint.space, stiffness
        self._laws, self._loose = joint.space.laws, joint.rigid.size > 0
        self.left = 0
        self._number = 0
        self._bound, self._relaxation, self._change = np.empty(0), 1.0, np.inf
        self._home = np.zeros(joint.size), np.zeros(joint.rigid.size)
        self._imbalances: list[float] = []
        self._drifting = 0
        self._coulomb = self._space.largest(np.array([self._laws.largest_slope])) > 0.0  # else there is an equilibrium

    @property
    def drifts(self) -> bool:
        return self._drifting >= DRIFTS

    def remember(self, s: np.ndarray, alpha: np.ndarray) -> None:
        """Note the forces s and motions α with which a rescue of loose bodies begins."""
        self._home = s, alpha

    def begin(self, s: np.ndarray, alpha: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """A further rescue, from the forces s (size,) and motions α; returns where it begins."""
        if self._loose:
            s, alpha = self._home
        first = LOOSE_APPROXIMATIONS if self._loose else 1
        self.left = min(first * 2**self._number, MOST_APPROXIMATIONS)
        self._bound, self._relaxation, self._change = self._laws.bound_at(s), 1.0, np.inf
        self._number += 1
        self._imbalances = []
        return s, alpha

    def approximate(self, s: np.ndarray, alpha: np.ndarray, residual: float, size: float,
                    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, int]:
        """One successive approximation from the forces s and the motions α.

        Parameters
        ----------
        residual : of the contact equations, relative
        size : norm that forces are compared with (N)

        Returns
        -------
        s, Cs : (size,) new forces (N) and their product with C (m)
        alpha : new motions (m)
        iterations : of MPRGP

        Collective. Raises SolverError on all ranks.
        """
        joint, rigid, bound = self._joint, self._joint.rigid, self._bound
        hung = _Hung(joint, WEAKER ** (self._number - 1)) if self._loose else joint
        d = self._linear_term(hung, alpha)
        qp = QP(hung, d, self._laws.frozen(bound), self._space.norm,
                self._space.petsc_comm if self._space.comm.size > 1 else None)
        precision = max(0.1 ** (1 + self._number) * residual, MOST_PRECISE)
        precision = (min(precision, LOOSE_PRECISE) if self._loose else precision) * size / self._stiffness
        if self._loose:  # springs add and subtract large displacements
            precision = max(precision, SPRUNG_ROUNDING * self._space.norm(d))
        start, iterations = qp.constraints.project(s), 0
        Cs = hung.product(start, "approximation")
        with joint.deferred():
            solver = QPSolver()
            solver.type = "python"  # the options are meant for the published iteration
            result = solver.solve(qp, start, Cs, precision, "approximation", joint.neglected / self._stiffness)
            start, Cs, iterations = result.s, result.Cs, result.iterations
        joint.meet("approximation made")
        if isinstance(hung, _Hung):
            Cs = Cs - rigid.spread(hung.compliance * rigid.sums(start))
            left = joint.imbalance(start)
            way = hung.compliance * left
            alpha = alpha + way
            self._watch(float(np.linalg.norm(left)), start, way)
            self._home = start, alpha
        elif not self._space.any(start != s):
            self.left = 1  # more of them would change nothing
        change = self._laws.bound_at(start) - bound  # the less the bound settles, the less of it is taken
        norm = self._space.norm(change)
        if norm > 0.9 * self._change and not self._loose:  # with loose bodies the bound follows their way
            self._relaxation = max(0.7 * self._relaxation, LEAST_RELAXATION)
        self._bound, self._change = bound + self._relaxation * change, norm
        self.left -= 1
        return start, Cs, alpha, iterations

    def _watch(self, imbalance: float, s: np.ndarray, way: np.ndarray) -> None:
        """Note the imbalance (N) that an approximation leaves; at the end of a rescue, whether bodies drift.

        Parameters
        ----------
        s : (size,) its forces (N)
        way : (joint.rigid.size,) its motions (m); what they close will hold the bodies sooner or later

        Collective.
        """
        self._imbalances.append(imbalance)
        if self.left > 1 or len(self._imbalances) <= BACK:
            return
        large = imbalance > DRIFT * float(np.linalg.norm(self._joint.e))
        drifts = self._coulomb and large and imbalance > PROGRESS * self._imbalances[-1 - BACK]
        self._drifting = self._drifting + 1 if drifts and not self._closes(s, way) else 0

    def _closes(self, s: np.ndarray, way: np.ndarray) -> bool:
        """Whether the motions `way` (m) bring bodies nearer to each other where the forces s leave them open."""
        closing = self._joint.rigid.spread(way)
        largest = self._space.largest(closing)
        for interface, part in self._space.each():
            normal = slice(part.start, part.start + interface.m)
            closing[part.start + interface.m:part.stop] = 0.0
            closing[normal][s[normal] != 0.0] = 0.0
        return self._space.any(closing > CLOSING * largest)

    def _linear_term(self, hung: Joint | _Hung, alpha: np.ndarray) -> np.ndarray:
        """d (size,) of the QP (m): what the loads and the springs, stretched from where the bodies are, do."""
        joint = self._joint
        if not isinstance(hung, _Hung):
            return joint.d
        return joint.d + joint.rigid.spread(alpha + hung.compliance * joint.e)

    def state(self) -> dict[str, Any]:
        return {"number": self._number, "left": self.left, "bound": self._bound, "relaxation": self._relaxation,
                "change": self._change, "s": self._home[0], "alpha": self._home[1],
                "imbalances": list(self._imbalances),
                "drifting": self._drifting}

    def restore(self, state: dict[str, Any]) -> None:
        self._number, self.left, self._bound = int(state["number"]), int(state["left"]), state["bound"]
        self._relaxation, self._change = float(state["relaxation"]), float(state["change"])
        self._home = state["s"], state["alpha"]
        self._imbalances, self._drifting = [float(each) for each in state["imbalances"]], int(state["drifting"])


class _Hung:
    """C + Gᵀ κ G: the joint compliance of bodies whose rigid motions hang on springs of compliance κ.

    Parameters
    ----------
    weakness : κ over the compliances of bodies that are pressed

    Attributes
    ----------
    compliance : κ (joint.rigid.size,) in m/N
    """

    def __init__(self, joint: Joint, weakness: float) -> None:
        self._joint, self.size = joint, joint.size
        ones = joint.space.add(np.asarray(joint.rigid.Z.multiply(joint.rigid.Z).sum(axis=0)).ravel())
        self._norm = joint.norm()
        seen = ones > UNSEEN * ones.max(initial=0.0)  # the others are motions that no contact resists
        self.compliance = np.where(seen, weakness * self._norm / np.where(seen, ones, 1.0), 0.0)
        self._norm *= 1.0 + 6.0 * weakness  # at most three motions of two bodies

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        rigid = self._joint.rigid
        self._joint.mult(x, y, purpose, relative)
        y += rigid.spread(self.compliance * rigid.sums(x))

    def product(self, x: np.ndarray, purpose: str) -> np.ndarray:
        rigid = self._joint.rigid
        return self._joint.product(x, purpose) + rigid.spread(self.compliance * rigid.sums(x))

    def norm(self) -> float:
        return self._norm
