"""One body at its interface: its quadratic program and its Neumann problem.

A body knows its role only through the bounds of its program (design, section 2), so that bodies
are interchangeable. It works on its own communicator, never on the world.
"""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from ddmpi.body.compliance import Compliance
from ddmpi.body.elasticity import Elasticity
from ddmpi.interface.interface import Interface
from ddmpi.interface.law import friction_role
from ddmpi.interface.trace import displacement_trace, trace
from ddmpi.petsc.events import event
from ddmpi.qp.program import QP
from ddmpi.qp.tao import QPSolver

PURPOSE = {1: "step1", 2: "step2"}
"""Under which the multiplications of the program of a role are counted."""

PRECISE = 1e-12
"""Relative residual of the last solve, which the certificate looks at, where it is an iterative one."""


class Body:
    """One body at one interface.

    Parameters
    ----------
    name, role : the body's name and its role (1 or 2) at the interface
    interface : the paired contact nodes
    elasticity : A, b of the body
    compliance, memory : kind of the compliance, and the bytes it may use, see `Compliance`

    Attributes
    ----------
    C : contact compliance
    h : (size,) B A⁻¹ b, the contact displacement without contact forces (m)
    s, Cs : (size,) contact forces (N) of the last program and their product with C
    steps : inner steps by kind

    Construction factors A and is collective on the body's communicator.
    """

    STATE = ("s", "Cs", "steps")

    def __init__(self, name: str, role: int, interface: Interface, elasticity: Elasticity,
                 compliance: str | None = None, memory: float = np.inf) -> None:
        self.name, self.role, self.interface, self.elasticity = name, role, interface, elasticity
        m = interface.m
        self.normal, self.tangential, self.whole = slice(0, m), slice(m, None), slice(None)
        self.sigma = 1.0 if role == 1 else -1.0
        self.C = Compliance(elasticity.A, trace(interface, role, elasticity), name, compliance, memory)
        self.qp_solver = QPSolver()
        self.h = np.zeros(self.C.size)
        if elasticity.b.norm() > 0.0:
            with event("LoadResponse"):
                self.C.free_response(elasticity.b, self.h, "load")
        self.h += displacement_trace(interface, role, elasticity.prescribed)
        self._set_up = self.C.count.copy()
        self.restart()

    def need_norm(self) -> None:
        """Estimate ‖C‖, which programs are scaled with; once, and counted as set-up. Collective."""
        before = self.C.count["norm"]
        self.C.norm()
        self._set_up["norm"] += self.C.count["norm"] - before

    def restart(self) -> None:
        """Back to no contact forces; counts keep what the set-up cost."""
        self.s, self.Cs = np.zeros(self.C.size), np.zeros(self.C.size)
        self.C.count = self._set_up.copy()
        self.steps: dict[str, int] = {}

    def bounds(self, g: np.ndarray, algorithm: str) -> tuple[np.ndarray, np.ndarray]:
        """Lower and upper bounds (size,) that the role has in the algorithm (design, section 2).

        Contact, s_ν ≥ 0, is role 2's; friction, |s_t| ≤ g, is role 2's in the original algorithm and
        role 1's in the modified one.
        """
        upper = np.full(self.C.size, np.inf)
        lower = -upper
        if self.role == 2:
            lower[self.normal] = 0.0
        if self.role == friction_role(algorithm):
            lower[self.tangential], upper[self.tangential] = -g, g
        return lower, upper

    def solve(self, lam: np.ndarray, g: np.ndarray, tolerance: float, algorithm: str = "original",
              split: bool = False, kept: float = 0.0) -> np.ndarray:
        """Contact forces s (size,) for the contact displacement `lam` and the slip bound `g` (N).

        Parameters
        ----------
        tolerance : largest norm of the projected gradient (m)
        algorithm : "original" or "modified"
        split : one Gauss–Seidel sweep, the normal forces with the tangential ones held and then the
            tangential ones, instead of all at once
        kept : largest error (m) that a multiplication may leave in Cs, see `QPSolver.solve`

        Raises SolverError. Collective on the body's communicator. Slides: Steps 1 and 2 of (DD)_h,
        and "Further modifications".
        """
        d = self.h - self.sigma * lam
        if self.role == 2:
            d[self.normal] -= self.interface.gap
        lower, upper = self.bounds(g, algorithm)
        for block in (self.normal, self.tangential) if split else (self.whole,):
            held_lower, held_upper = self.s.copy(), self.s.copy()
            held_lower[block], held_upper[block] = lower[block], upper[block]
            result = self.qp_solver.solve(QP(self.C, d, held_lower, held_upper), self.s, self.Cs,
                                          tolerance, PURPOSE[self.role], kept)
            self.s, self.Cs = result.s, result.Cs
            for kind, number in result.steps.items():
                self.steps[kind] = self.steps.get(kind, 0) + number
        return self.s

    def neumann(self, jump: np.ndarray, relative: float = 0.0) -> np.ndarray:
        """B w (size,) with A w = ½ Bᵀ `jump`: the displacement (m) that the force jump (N) causes.

        `relative` as for `Compliance.mult`. Collective on the body's communicator. Slides: Steps 3 and 4.
        """
        Bw = np.empty(self.C.size)
        with event("NeumannSolve"):
            self.C.mult(0.5 * jump, Bw, "neumann", relative)
        return Bw

    def displacement(self) -> tuple[np.ndarray, float]:
        """Displacement (nv, 2) in metres under the load and the contact forces s.

        Returns
        -------
        u : (nv, 2)
        residual : ‖A u + Bᵀ s − b‖ / max(‖b‖, ‖Bᵀ s‖), zero where nothing acts

        Collective on the body's communicator.
        """
        with event("Displacement"):
            return self._displacement()

    def _displacement(self) -> tuple[np.ndarray, float]:
        A, b = self.elasticity.A, self.elasticity.b
        u, f = A.createVecs()
        self.C.B.multTranspose(PETSc.Vec().createWithArray(self.s, comm=PETSc.COMM_SELF), f)
        size = max(f.norm(), b.norm())
        f.aypx(-1.0, b)
        if f.norm() > 0.0:
            self.C.solve(f, u, "displacement", PRECISE)
        Au = u.duplicate()
        A.mult(u, Au)
        Au.axpy(-1.0, f)
        return self.elasticity.expand(u), (Au.norm() / size if size else 0.0)
