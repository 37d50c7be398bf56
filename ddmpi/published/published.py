"""The published outer iteration: the domain decomposition algorithm (DD)_h of two bodies in dual matrix form.

The code is that of one body; the rank of the other body runs the same lines in the other role, and a rank that has both
runs them twice. Ranks have the same λ, bit for bit, because both add the same two vectors.

Each body solves a QP and a Neumann problem, its `Subproblem`. Role 1 has the contact displacement λ prescribed, role 2
the contact condition; only the bounds differ:

                 role 1                     role 2
    original     none                       s_ν ≥ 0 and |s_t| ≤ g
    modified     |s_t| ≤ g                  s_ν ≥ 0
"""

from __future__ import annotations

import sys
from typing import Any

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.coupling.member import Member
from ddmpi.coupling.space import Space
from ddmpi.interface.interface import Interface
from ddmpi.methods.outer import Outer, Report, Step, no_report
from ddmpi.petsc.events import event
from ddmpi.published.tao import QP, QPSolver
from ddmpi.scene.method import SettledMethod
from ddmpi.sets import Box
from ddmpi.system.numbers import norm

FIRST_PRECISION = 0.01
"""Inner precision of the first iteration, which has no update before it, over max‖h_α‖, or over ‖h_1 + h_2 − gap‖ if
that is smaller, as where a body is moved far to touch the other a little."""

FIXED_PRECISION = 0.1
"""η of inner_precision = "fixed": inner precision over the last update that the tolerance allows."""

NEGLECTED = 1e-3
"""Error of a multiplication by an iterative solver in a QP, over the inner precision at the end: QPs update their
products by recurrence over all outer iterations, and so keep the errors of early ones."""

PASSING = 0.01
"""Precision of a Neumann solve by an iterative solver, over η; its result only updates λ."""

DIVERGED = 1e8
"""The iteration has diverged when ‖λ‖ exceeds the free contact displacements by this factor."""


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
    algorithm : "original" or "modified", which say whose QP bounds the tangential forces
    splitting : "none", "step1", "step2" or "step1+2": the QPs of which roles are one Gauss–Seidel sweep, the normal
        forces with fixed tangential ones and then the tangential ones, instead of all at once

    Attributes
    ----------
    s, Cs : (size,) contact forces (N) of the last QP and their product with C (m)
    steps : steps of MPRGP and APG by kind
    solver : of the QPs
    """

    def __init__(
        self,
        member: Member,
        interface: Interface,
        role: int,
        algorithm: str = "original",
        splitting: str = "none",
    ) -> None:
        self.member, self.interface, self.role = member, interface, role
        self._bounds_friction = role == friction_role(algorithm)
        m = interface.m
        self._normal, self._blocks = slice(0, m), [slice(None)]
        if splitting in (f"step{role}", "step1+2") and interface.size > m:
            self._blocks = [self._normal, slice(m, None)]
        self._sign = 1.0 if role == 1 else -1.0
        self.solver = QPSolver()
        self.s, self.Cs = np.zeros(interface.size), np.zeros(interface.size)
        self.steps: dict[str, int] = {}

    def constraints(self, bound: np.ndarray) -> Box:
        """The set of forces that the role allows, for the slip bound (mt,)."""
        most = bound if self._bounds_friction else np.full_like(bound, np.inf)
        allowed = self.interface.law.cone(most)
        if self.role == 1:
            allowed.lower[self._normal] = -np.inf
        return allowed

    def solve(
        self, lam: np.ndarray, bound: np.ndarray, tolerance: float, neglected: float = 0.0
    ) -> np.ndarray:
        """Contact forces s (size,) for the contact displacement `lam` (m) and the slip bound (N).

        Parameters
        ----------
        tolerance : largest norm of the projected gradient (m)
        neglected : largest error (m) that a multiplication may leave in C s, see `QPSolver.solve`

        Raises SolverError. Collective on the body's communicator. Slides: Steps 1 and 2 of (DD)_h,
        and "Further modifications".
        """
        C = self.member.C
        d = self.member.h - self._sign * lam
        allowed = self.constraints(bound)
        if self.role == 2:  # body 2 has the contact condition, with the initial gap
            d[self._normal] -= self.interface.gap
        # a block is the whole QP with the other forces held: the product C s contains C_νt s_t or C_tν s_ν
        for block in self._blocks:
            qp = QP(C, d, allowed.holding(self.s, block))
            result = self.solver.solve(
                qp, self.s, self.Cs, tolerance, f"step{self.role}", neglected
            )
            self.s, self.Cs = result.s, result.Cs
            for kind, number in result.steps.items():
                self.steps[kind] = self.steps.get(kind, 0) + number
        return self.s

    def neumann(self, jump: np.ndarray, relative: float) -> np.ndarray:
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


class PublishedIteration(Outer):
    """The iteration for λ and the contact forces of both bodies.

    Parameters
    ----------
    assembly : of two bodies with one interface
    method : variant of the iteration, theta, tolerance, limits
    report : called with every Step
    lead : side of the interface whose body takes role 1
    precision : η; inner solves are as precise as η times the last outer update. The method's if left out

    Attributes
    ----------
    lam : (size,) contact displacement (m)
    s1, s2 : (size,) contact forces (N) as role 1 and role 2 see them
    history : all steps
    """

    def __init__(
        self,
        assembly: Assembly,
        method: SettledMethod,
        report: Report = no_report,
        lead: int = 0,
        precision: float | None = None,
    ) -> None:
        self.exchange, self.method, self.report = assembly.exchange, method, report
        self.algorithm = method.algorithm or "original"
        self._precision = precision or (
            FIXED_PRECISION if method.inner_precision == "fixed" else method.inner_precision
        )
        self.history: list[Step] = []
        members = [body.member for body in assembly.bodies]
        (self.interface,) = members[0].interfaces
        space = Space([self.interface])
        self._laws, self._lead, self._owned = space.laws, lead, slice(assembly.space.size)
        self.subproblems = []
        for member in members:
            role = 1 if self.interface.bodies[lead] == member.name else 2
            ways = self.algorithm, method.splitting or "none"
            self.subproblems.append(Subproblem(member, self.interface, role, *ways))
        self.inner_steps = self.subproblems[0].steps
        for body in self.subproblems:
            body.steps = self.inner_steps  # those of this rank
        self.lam, self.s1, self.s2 = (np.zeros(space.size) for _ in range(3))
        self._bound = np.zeros(len(self.interface.sliding))
        with self.exchange.deferred():
            for member in members:
                member.need_norm()
        h1, h2 = self._swap([member.h for member in members], "free displacement")
        free, gap = max(norm(h1), norm(h2)), space.gap
        self._scale = max(free, norm(gap))
        self._tolerance = method.tolerance
        self._step_size = FIRST_PRECISION * min(free, norm(h1 + h2 - gap)) / self._precision

    @property
    def forces(self) -> np.ndarray:
        """The contact forces that obey all bounds (N): each component from the role that bounds it."""
        m = self.interface.m
        tangential = self.s2 if friction_role(self.algorithm) == 2 else self.s1
        return np.concatenate([self.s2[:m], tangential[m:]])[self._owned]

    @property
    def bound(self) -> np.ndarray:
        return self._bound[self._owned]

    def body_forces(self) -> list[np.ndarray]:
        return [body.s for body in self.subproblems]

    @property
    def mismatch(self) -> np.ndarray:
        return (self.s1 - self.s2)[self._owned]

    @property
    def qp_type(self) -> str:
        return self.subproblems[0].solver.type

    def run(self, tolerance: float) -> str:
        """Iterate until ‖λ_k − λ_{k−1}‖ ≤ tolerance ‖λ_k‖; otherwise as `Outer.run`."""
        self._tolerance = tolerance
        while len(self.history) < self.method.max_iterations:
            self.checkpoint()
            step = self.iterate()
            self.history.append(step)
            self.report(step)
            size = norm(self.lam)
            if not np.isfinite(size) or size > DIVERGED * max(self._scale, sys.float_info.min):
                return "diverged"
            if self._step_size <= tolerance * size:
                return "converged"
        return "max_iterations"

    def advance(self, w1: np.ndarray, w2: np.ndarray) -> np.ndarray:
        """The update of λ (m), given the contact displacements B w of both roles' Neumann problems."""
        return self.method.theta * (w1 + w2)

    def iterate(self) -> Step:
        """One step of the algorithm of the slides; both bodies work at the same time. Collective."""
        exchange = self.exchange
        self._bound = self._laws.bound_at(self.s2)
        size = self._step_size
        if self.method.inner_precision == "fixed":  # the last update that the tolerance allows
            size = self.method.tolerance * (norm(self.lam) or self._scale)
        # inner solves are as precise as η ‖λ_{k−1} − λ_{k−2}‖: both are displacements, so that η has no units; a rule
        # relative to the subproblem's right-hand side stalls
        accuracy = max(body.member.C.accuracy for body in self.subproblems)
        precision = float(max(self._precision * size, accuracy * self._scale))
        neglected = NEGLECTED * self._precision * self._tolerance * norm(self.lam)

        with exchange.deferred():
            # Steps 1 and 2.
            for body in self.subproblems:
                body.solve(self.lam, self._bound, precision, neglected)
        self.s1, self.s2 = self._swap(self.body_forces(), "forces")
        w = [np.zeros(len(self.lam) + 1) for _ in self.subproblems]
        with exchange.deferred():
            for moved, body in zip(w, self.subproblems, strict=True):  # Steps 3 and 4
                moved[:-1] = body.neumann(self.s1 - self.s2, PASSING * self._precision)
                moved[-1] = body.member.C.count.total()
        w1, w2 = self._swap(w, "neumann")
        update = self.advance(w1[:-1], w2[:-1])
        # Step 5. It is not in place, as a checkpoint may refer to the former λ.
        self.lam = self.lam + update

        self._step_size = norm(update)
        mismatch = _ratio(norm(self.s1 - self.s2), norm(self.s2))
        return Step(
            len(self.history) + 1,
            _ratio(self._step_size, norm(self.lam)),
            mismatch,
            precision,
            int(w1[-1]) + int(w2[-1]),
        )

    def _swap(self, mine: list[np.ndarray], about: str) -> tuple[np.ndarray, np.ndarray]:
        """The vectors of both roles, from those of this rank's bodies. Collective."""
        if len(mine) == 1:
            both = self.exchange.swap(mine[0], about)
            return both[self._lead], both[1 - self._lead]
        self.exchange.meet(about)
        first, second = sorted(range(2), key=lambda k: self.subproblems[k].role)
        return mine[first], mine[second]

    def refresh(self, u: list[np.ndarray]) -> None:
        """Take the product C s from `u`; the iteration updates it by recurrence."""
        for body, moved in zip(self.subproblems, u, strict=True):
            body.Cs = body.member.h - moved

    def state(self) -> dict[str, Any]:
        return {
            "lam": self.lam,
            "s1": self.s1,
            "s2": self.s2,
            "bound": self._bound,
            "step_size": self._step_size,
            "subproblems": {str(body.role): body.state() for body in self.subproblems},
            "history": tuple(self.history),
        }

    def restore(self, state: dict[str, Any]) -> None:
        self.lam, self.s1, self.s2, self._bound = (
            state[name] for name in ("lam", "s1", "s2", "bound")
        )
        self._step_size = state["step_size"]
        for body in self.subproblems:
            body.restore(state["subproblems"][str(body.role)])
        self.history = [Step(*row) for row in state["history"]]


def _ratio(a: float, b: float) -> float:
    return float(a / b) if b else float(a > 0)
