"""The work of one body in the published iteration: its QP and its Neumann problem.

Role 1 has the contact displacement λ prescribed, role 2 the contact condition; only the bounds differ:

                 role 1                     role 2
    original     none                       s_ν ≥ 0 and |s_t| ≤ g
    modified     |s_t| ≤ g                  s_ν ≥ 0
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ddmpi.coupling.member import Member
from ddmpi.interface.interface import Interface
from ddmpi.petsc.events import event
from ddmpi.published.tao import QP, QPSolver
from ddmpi.sets import Box


def friction_role(algorithm: str) -> int:
    """The role whose QP bounds the tangential forces."""
    return 2 if algorithm == "original" else 1


class Subproblem:
    """The QP min ½ sᵀ C s − sᵀ d, d = h ∓ λ, of one body in its role at one interface.

    Parameters
    ----------
    member : the body
    interface : where it meets the other body
    role : 1 or 2

    Attributes
    ----------
    s, Cs : (size,) contact forces (N) of the last QP and their product with C (m)
    steps : steps of MPRGP and APG by kind
    solver : of the QPs
    """

    def __init__(self, member: Member, interface: Interface, role: int) -> None:
        self.member, self.interface, self.role = member, interface, role
        m = interface.m
        self._normal, self._tangential, self._whole = slice(0, m), slice(m, None), slice(None)
        self._sign = 1.0 if role == 1 else -1.0
        self.solver = QPSolver()
        self.s, self.Cs = np.zeros(interface.size), np.zeros(interface.size)
        self.steps: dict[str, int] = {}

    def constraints(self, bound: np.ndarray, algorithm: str) -> Box:
        """The set of forces that the role allows in the algorithm, for the slip bound (mt,)."""
        slides = self.role != friction_role(algorithm)
        allowed = self.interface.law.cone(np.full_like(bound, np.inf) if slides else bound)
        if self.role == 1:
            allowed.lower[self._normal] = -np.inf
        return allowed

    def solve(self, lam: np.ndarray, bound: np.ndarray, tolerance: float, algorithm: str = "original",
              split: bool = False, neglected: float = 0.0) -> np.ndarray:
        """Contact forces s (size,) for the contact displacement `lam` (m) and the slip bound (N).

        Parameters
        ----------
        tolerance : largest norm of the projected gradient (m)
        algorithm : "original" or "modified"
        split : one Gauss–Seidel sweep, the normal forces with fixed tangential ones and then the
            tangential ones, instead of all at once
        neglected : largest error (m) that a multiplication may leave in C s, see `QPSolver.solve`

        Raises SolverError. Collective on the body's communicator. Slides: Steps 1 and 2 of (DD)_h,
        and "Further modifications".
        """
        C, d, allowed = self.member.C, self.member.h - self._sign * lam, self.constraints(bound, algorithm)
        if self.role == 2:  # body 2 has the contact condition, with the initial gap
            d[self._normal] -= self.interface.gap
        # a block is the whole QP with the other forces held: the product C s contains C_νt s_t or C_tν s_ν
        for block in (self._normal, self._tangential) if split else (self._whole,):
            qp = QP(C, d, allowed.holding(self.s, block))
            result = self.solver.solve(qp, self.s, self.Cs, tolerance, f"step{self.role}", neglected)
            self.s, self.Cs = result.s, result.Cs
            for kind, number in result.steps.items():
                self.steps[kind] = self.steps.get(kind, 0) + number
        return self.s

    def neumann(self, jump: np.ndarray, relative: float = 0.0) -> np.ndarray:
        """B w (size,) with A w = ½ Bᵀ `jump`: the displacement (m) that the force jump (N) causes.

        `relative` as for `Compliance.mult`. Collective on the body's communicator. Slides: Steps 3 and 4.
        """
        Bw = np.empty(len(jump))
        with event("NeumannSolve"):
            self.member.C.mult(0.5 * jump, Bw, "neumann", relative)
        return Bw

    def state(self) -> dict[str, Any]:
        return {"s": self.s, "Cs": self.Cs, "steps": dict(self.steps)}

    def restore(self, state: dict[str, Any]) -> None:
        self.s, self.Cs = state["s"], state["Cs"]
        self.steps.update(state["steps"])
