"""Solve a prepared assembly: iterate, certify, and go on where the certificate fails."""

from __future__ import annotations

import logging
import sys
from dataclasses import dataclass
from typing import Any

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly
from ddmpi.errors import SolverError
from ddmpi.interface.state import ContactState, contact_state
from ddmpi.judge.certificate import Certificate, certificate_limit, contact_residuals
from ddmpi.judge.diagnosis import StatusLog
from ddmpi.methods.anderson import AndersonIteration
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import Outer, Report, Step, no_report
from ddmpi.methods.published import PublishedIteration
from ddmpi.petsc.events import event
from ddmpi.petsc.versions import free_garbage
from ddmpi.run.checkpoint import Checkpoints
from ddmpi.scene.method import SettledMethod
from ddmpi.system.clock import Clock

log = logging.getLogger("ddmpi")

TIGHTER = 0.1
"""By this the outer tolerance shrinks when the iteration stops but its certificate fails."""


USEFUL = 0.9
"""Steps that leave more than this of the certificate's largest residual are the last ones."""


@dataclass(frozen=True)
class Solution:
    """The end of an iteration, as one rank holds it.

    Attributes
    ----------
    stopped : why the iteration ended: "converged", "diverged" or "max_iterations"
    displacement : (nv, d) of the rank's own body (m)
    displacement_max : largest displacement by body (m)
    contacts : state by contact
    certificate : of all contacts and bodies
    limit : largest residual of a certified answer
    outer : the iteration, which can go on
    statuses : of the contact nodes in the last iterations
    given : precision of the solves as -body_ksp_rtol sets it, or zero
    """

    stopped: str
    displacement: np.ndarray
    displacement_max: dict[str, float]
    contacts: dict[str, ContactState]
    certificate: Certificate
    limit: float
    outer: Outer
    statuses: StatusLog
    given: float

    @property
    def unbalanced(self) -> bool:
        """Whether a body's equilibrium fails, which no further outer iteration can improve."""
        return not self.certificate.worst()["equilibrium"][0] <= self.limit

    @property
    def certified(self) -> bool:
        return self.stopped == "converged" and not self.violations

    @property
    def violations(self) -> list[str]:
        """The residuals above the limit, worded."""
        return self.certificate.violations(self.limit)

    @property
    def reason(self) -> str:
        """Why the iteration ended, in words."""
        if self.certified:
            return "converged and certified"
        if self.given and self.unbalanced:
            return (f"no answer can be certified: -body_ksp_rtol {self.given:g} leaves the bodies out of equilibrium; "
                    f"leave that option out, or give at most {0.1 * self.limit:.0e}")
        return {"converged": "the iteration stopped, but its certificate fails", "diverged": "diverged",
                "max_iterations": "not converged: method.max_iterations is reached"}[self.stopped]


@dataclass
class _Goal:
    """The tolerance that the iteration runs to at present; what the certificate said before, after how many steps."""

    tolerance: float
    worst: float = np.inf
    steps: int = 0

    def state(self) -> dict[str, Any]:
        return {"tolerance": self.tolerance, "worst": self.worst, "steps": self.steps}

    def restore(self, state: dict[str, Any]) -> None:
        self.tolerance, self.worst = float(state["tolerance"]), float(state["worst"])
        self.steps = int(state["steps"])

    def is_last(self, worst: float, steps: int) -> bool:
        """Note the `worst` residual after so many `steps` in all; whether a smaller tolerance would not help."""
        useless = steps > self.steps and not worst < USEFUL * self.worst
        self.worst, self.steps = worst, steps
        return useless or self.tolerance < sys.float_info.epsilon


def solve(assembly: Assembly, method: SettledMethod, report: Report = no_report,
          checkpoints: Checkpoints | None = None, clock: Clock | None = None) -> Solution:
    """Solve `assembly` by `method`, from zero or from what `checkpoints` holds.

    Where the iteration stops by its criterion but the certificate fails, it goes on with a tighter
    one. `clock` times the phases outer and recover. Collective. Raises SolverError, and InterruptionError
    when a signal came; the same on all ranks.
    """
    clock = clock or Clock()
    assembly.member.restart()
    statuses = StatusLog(assembly.space)

    def note(step: Step) -> None:
        statuses.record(outer.forces, outer.bound)
        free_garbage()  # a vector for every multiplication
        report(step)

    with clock.phase("outer"):
        outer = choose_outer(assembly, method, note)
    limit, goal = certificate_limit(method.tolerance), _Goal(method.tolerance)
    given = assembly.world.allreduce(assembly.member.C.solver.given, MPI.MAX)
    if checkpoints:
        checkpoints.follow(outer=outer, statuses=statuses, goal=goal)
    while True:
        try:
            with clock.phase("outer"):
                stopped = outer.run(goal.tolerance)
        except SolverError as error:
            if given > method.tolerance:
                error.args = (f"{error}; -body_ksp_rtol {given:g} is too coarse for method.tolerance = "
                              f"{method.tolerance:g}: leave that option out",)
            raise
        with clock.phase("recover"):
            solution = _conclude(assembly, outer, stopped, limit, statuses, given)
        worst = max(value for value, _ in solution.certificate.worst().values())
        hopeless = goal.is_last(worst, len(outer.history)) or solution.unbalanced
        if stopped != "converged" or solution.certified or hopeless:
            return solution
        goal.tolerance *= TIGHTER
        log.info("the certificate fails (%s); going on to an update of %.0e", ", ".join(solution.violations),
                 goal.tolerance)


def choose_outer(assembly: Assembly, method: SettledMethod, report: Report = no_report) -> Outer:
    """The outer method that was asked for. Collective."""
    if method.outer == "relaxation":
        return PublishedIteration(assembly, method, report)
    if method.outer == "anderson":
        return AndersonIteration(assembly, method, report)
    return Newton(assembly.joint(), method.max_iterations, report)


def _conclude(assembly: Assembly, outer: Outer, stopped: str, limit: float, statuses: StatusLog,
              given: float = 0.0) -> Solution:
    """Displacements, contact states and certificate of the forces at hand. Collective."""
    member, exchange, space = assembly.member, assembly.exchange, assembly.space
    u, residual = np.zeros_like(member.elasticity.prescribed), np.nan
    with exchange.deferred():
        u, residual = member.displacement(outer.own_forces)
    own = member.trace(u)
    outer.refresh(own)
    whole = np.concatenate([own, member.fixed_trace(u)])
    both = exchange.swap(whole, "answer")
    numbers = {"equilibrium": residual, "moved": float(np.linalg.norm(u, axis=1).max()),
               "yielding": float(np.abs(member.h - own).max()), "load": member.elasticity.load}
    bodies = dict(assembly.world.allgather((member.name, numbers)))
    load = float(sum(body["load"] for body in bodies.values()))
    moved = max(body["moved"] for body in bodies.values())
    contacts, residuals, start, fixed = {}, {}, 0, space.size
    forces, mismatch, bound = outer.forces, outer.mismatch, outer.bound
    with event("Certificate"):
        for interface, part in space.each():
            stop = start + len(interface.sliding)
            traces = both[0][part], both[1][part]
            state = contact_state(interface, forces[part], bound[start:stop], traces[0] + traces[1])
            yielding = max(bodies[name]["yielding"] for name in interface.bodies)
            pairs = slice(fixed, fixed + interface.dropped)
            fixed_gap, fixed = interface.fixed.gap - both[0][pairs] - both[1][pairs], pairs.stop
            residuals[interface.name] = contact_residuals(state, forces[part], mismatch[part], traces, fixed_gap, load,
                                                          yielding, moved)
            contacts[interface.name], start = state, stop
    names = [body.name for body in assembly.scene.body]
    certificate = Certificate(residuals, {name: bodies[name]["equilibrium"] for name in names})
    return Solution(stopped, u, {name: bodies[name]["moved"] for name in names}, contacts, certificate, limit, outer,
                    statuses, given)
