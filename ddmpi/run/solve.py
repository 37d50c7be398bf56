"""Solve a prepared problem: iterate, certify, and go on where the certificate fails."""

from __future__ import annotations

import logging
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ddmpi.coupling.assembly import Problem
from ddmpi.interface.state import ContactState, contact_state
from ddmpi.interface.trace import displacement_trace
from ddmpi.judge.certificate import Certificate, certificate_limit, certify
from ddmpi.judge.diagnosis import StatusLog
from ddmpi.methods.anderson import AndersonIteration
from ddmpi.methods.newton import InterfaceNewton
from ddmpi.methods.outer import Step
from ddmpi.methods.published import OuterIteration
from ddmpi.petsc.events import event
from ddmpi.petsc.versions import free_garbage
from ddmpi.run.checkpoint import Checkpoints
from ddmpi.scene.method import Method
from ddmpi.system.clock import Clock

log = logging.getLogger("ddmpi")

TIGHTER = 0.1
"""By this the outer tolerance shrinks when the iteration stops but its certificate fails."""


@dataclass(frozen=True)
class Answer:
    """The end of a run on one rank.

    Attributes
    ----------
    stopped : why the iteration ended: "converged", "diverged" or "max_iterations"
    displacement : (nv, 2) of the own body (m)
    displacement_max : of both bodies (m)
    state, certificate : of the interface
    limit : largest residual of a certified answer
    statuses : of the contact nodes in the last iterations
    """

    stopped: str
    displacement: np.ndarray
    displacement_max: float
    state: ContactState
    certificate: Certificate
    limit: float
    statuses: StatusLog

    @property
    def certified(self) -> bool:
        return self.stopped == "converged" and not self.violations

    @property
    def violations(self) -> list[str]:
        """The residuals above the limit, worded."""
        return self.certificate.violations(self.limit)

    @property
    def reason(self) -> str:
        """Why the run ended, in words."""
        if self.certified:
            return "converged and certified"
        return {"converged": "the iteration stopped, but its certificate fails", "diverged": "diverged",
                "max_iterations": "not converged: method.max_iterations is reached"}[self.stopped]


@dataclass
class _Goal:
    """What the iteration is run to, for the time being."""

    STATE = ("tolerance",)

    tolerance: float


def solve(problem: Problem, method: Method, report: Callable[[Step], None] = lambda step: None,
          checkpoints: Checkpoints | None = None, clock: Clock | None = None,
          ) -> tuple[Answer, OuterIteration | InterfaceNewton]:
    """Solve `problem` by `method`, from zero or from what `checkpoints` holds.

    Where the iteration stops by its criterion but the certificate fails, it goes on with a tighter
    one. `clock` times the phases outer and recover. Collective. Raises SolverError, and InterruptionError
    when a signal came; the same on all ranks.
    """
    clock = clock or Clock()
    problem.body.restart()
    statuses = StatusLog()

    def note(step: Step) -> None:
        statuses.record(problem.interface, outer.forces, outer.g)
        free_garbage()  # a vector for every multiplication
        report(step)

    with clock.phase("outer"):
        outer = _outer(problem, method, note)
    load = float(sum(problem.world.allgather(problem.body.elasticity.load)))
    limit = certificate_limit(method.tolerance)
    goal = _Goal(method.tolerance)
    if checkpoints:
        checkpoints.follow(outer=outer, statuses=statuses, goal=goal)
    while True:
        with clock.phase("outer"):
            stopped = outer.run(goal.tolerance)
        with clock.phase("recover"):
            answer = _conclude(outer, stopped, load, limit, statuses)
        if stopped != "converged" or answer.certified or goal.tolerance < np.finfo(float).eps:
            return answer, outer
        goal.tolerance *= TIGHTER
        log.info("the certificate fails (%s); going on to an update of %.0e", ", ".join(answer.violations),
                 goal.tolerance)


def _outer(problem: Problem, method: Method, report: Callable[[Step], None]) -> OuterIteration | InterfaceNewton:
    """The outer method that was asked for."""
    parts = problem.body, problem.friction, problem.exchange, method
    moduli = [problem.scene.body[rank].material.plane_modulus for rank in problem.order]
    if method.outer == "relaxation":
        return OuterIteration(*parts, report)
    if method.outer == "anderson":
        return AndersonIteration(*parts, report, weights=tuple(E / sum(moduli) for E in moduli))
    return InterfaceNewton(*parts, 1.0 / sum(1.0 / E for E in moduli), report)


def _conclude(outer: OuterIteration | InterfaceNewton, stopped: str, load: float, limit: float,
              statuses: StatusLog) -> Answer:
    """Displacements, contact state and certificate of the forces at hand. Collective."""
    body, exchange, interface = outer.body, outer.exchange, outer.body.interface
    u, residual = np.zeros_like(body.elasticity.prescribed), np.nan
    with exchange.deferred():
        u, residual = body.displacement()
    own = displacement_trace(interface, body.role, u)
    body.Cs = body.h - own  # the product, afresh: the iteration updates it by recurrence
    largest, yielding = np.linalg.norm(u, axis=1).max(), np.abs(body.Cs).max()
    both = exchange.swap(np.append(own, [residual, largest, yielding]), "answer")
    traces = tuple(vector[:-3] for vector in both)
    (r1, u1, y1), (r2, u2, y2) = (vector[-3:] for vector in both)
    with event("Certificate"):
        state = contact_state(interface, outer.friction, outer.forces, outer.g, traces)
        certificate = certify(interface, outer.friction, state, (outer.s1, outer.s2), traces, (r1, r2), load,
                              max(y1, y2), max(u1, u2))
    return Answer(stopped, u, float(max(u1, u2)), state, certificate, limit, statuses)
