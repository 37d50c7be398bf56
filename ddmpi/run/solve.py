"""Solve a prepared assembly: iterate, certify, and go on where the certificate fails."""

import logging
import math
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly
from ddmpi.errors import SolverError
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState, ContactTotals, contact_state
from ddmpi.judge.certificate import (
    FACTOR,
    Certificate,
    ContactResiduals,
    certificate_limit,
    contact_residuals,
    equilibrium_residual,
)
from ddmpi.judge.diagnosis import StatusLog
from ddmpi.judge.equilibrium import SLIGHT, Mechanism, describe
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import ENDS, Outer, Report, Step, check_promises, no_report
from ddmpi.petsc.events import event
from ddmpi.petsc.versions import free_garbage
from ddmpi.results.checkpoint import Checkpoints
from ddmpi.run.equilibrium import describe_drift, look_for_mechanism
from ddmpi.run.held import Held, HeldMotion, beyond_meshes, judge_held, motions_to_hold, slides
from ddmpi.run.least import least_motion
from ddmpi.run.recover import displaced, driven_partners
from ddmpi.scene.contacts import NoFriction
from ddmpi.scene.method import SettledMethod
from ddmpi.system.agreement import agreed, gathered
from ddmpi.system.clock import Clock, now_at
from ddmpi.system.numbers import norm

log = logging.getLogger("ddmpi")

TIGHTER = 0.1  # factor on the outer tolerance when the iteration stops but its certificate fails

USEFUL, USELESS = 0.9, 2
"""Tighter tolerances end after USELESS ones in a row that leave more than USEFUL of the certificate's largest residual.
One is too few: forces that are moved onto their bounds shift a body on soft springs by far more than the residual says,
and a step that meets a tighter tolerance by chance hardly changes that."""

EXPLAINED = 10.0
"""Rounding explains residuals up to this times its bound ε ‖C‖ ‖s‖ in the norm, of which a single node has less or more."""

NO_SIZES = np.zeros(3)  # the `Solution.sizes` of no load step

Beginning = tuple[
    np.ndarray, Callable[[Interface, slice, np.ndarray], np.ndarray], Mapping[str, np.ndarray]
]
"""Of a load step: the displacement (size,) from which slip counts (m); what makes a contact's forces there, with its
part of a vector, of those at the end (N); by contact the `ContactState.slip_total` of those without friction (m)."""


Start = Callable[[], tuple[np.ndarray, np.ndarray, np.ndarray]]
"""Makes the forces (size,) in N, gaps (size,) and motions of loose bodies in m to begin with. Collective."""


class Rounds(NamedTuple):
    """The rounds of tighter tolerances in a load step so far.

    Attributes
    ----------
    least : the least of the largest residuals of their certificates
    useless : rounds since that became smaller
    steps : of the outer method until the last one
    """

    least: float = math.inf
    useless: int = 0
    steps: int = 0


@dataclass(frozen=True)
class Solution:
    """The end of an iteration, as one rank has it.

    Attributes
    ----------
    stopped : why the iteration ended: "converged", "diverged", "max_iterations", "stalled"; "drift" if loose bodies
        moved on and on, "mechanism" if there is no equilibrium
    displacements : (nv, d) of each body of this rank (m), by name; none in a lean solution
    states : by contact, of those that this rank owns
    contacts : each as a whole, on the first rank all, on others those of their bodies
    certificate : of all contacts and bodies
    limit : largest residual of a certified answer
    outer : the iteration, which can go on
    statuses : of the contact nodes in the last iterations
    given : precision of the solves as -body_ksp_rtol sets it, or zero
    moved : (size,) relative displacement of the bodies at the interfaces that this rank owns (m)
    prescribed : (size,) the share of rigid partners in it, driven ones as well (m)
    energy : strain energy of all bodies (J)
    confined : `LoadCase.confined` of all bodies, zero of lean solutions (J)
    sizes : (3,) largest nodal contact force (N), displacement, and displacement by contact forces (m)
    work : (2, cases) of all bodies, as `Member.work`, by history in the order of the scene
    mechanism : that proves that there is no equilibrium, or None
    drift : how loose bodies drift, in words
    held : motions that nothing determines
    time : of the load step, where there are several
    rounding : by body what double precision makes of its contact displacements, where that may be why there is no answer
    """

    stopped: str
    displacements: dict[str, np.ndarray]
    states: dict[str, ContactState]
    contacts: dict[str, ContactTotals]
    certificate: Certificate
    limit: float
    outer: Outer
    statuses: StatusLog
    given: float
    moved: np.ndarray
    prescribed: np.ndarray
    energy: float
    confined: float
    sizes: np.ndarray
    work: np.ndarray
    mechanism: Mechanism | None = None
    drift: str = ""
    held: Sequence[HeldMotion] = ()
    time: float | None = None
    rounding: dict[str, float] = field(default_factory=dict)

    @property
    def unbalanced(self) -> bool:
        """Whether the equilibrium of a body fails, which no outer iteration can improve."""
        return not self.certificate.worst()["equilibrium"][0] <= self.limit

    @property
    def certified(self) -> bool:
        return self.stopped == "converged" and not self.violations

    @property
    def violations(self) -> list[str]:
        """The residuals above the limit, worded."""
        return self.certificate.violations(self.limit)

    @property
    def precision(self) -> tuple[str, float] | None:
        """The body whose rounding explains all residuals above the limit, and the least tolerance whose limit allows
        them; None where rounding does not explain them."""
        name = max(self.rounding, key=lambda name: self.rounding[name], default="")
        worst = max(value for value, _ in self.certificate.worst().values())
        if not name or self.unbalanced or not worst <= EXPLAINED * self.rounding[name]:
            return None
        return name, worst / FACTOR

    @property
    def reason(self) -> str:
        """Why the iteration ended, in words."""
        return self._reason + (
            "" if self.time is None or self.certified else f", in the step to time {self.time:g}"
        )

    @property
    def _reason(self) -> str:
        if self.certified:
            return "converged and certified"
        if self.mechanism:
            return describe(self.mechanism)
        if self.drift:
            return (
                f"no equilibrium found: {self.drift}, as far as the iteration shows; rigid bodies would be in "
                "equilibrium, elastic ones need not be"
            )
        if self.given and self.unbalanced:
            return (
                f"no answer can be certified: -body_ksp_rtol {self.given:g} leaves the bodies out of equilibrium; "
                f"leave that option out, or give at most {0.1 * self.limit:.0e}"
            )
        if self.stopped == "stalled" and not isinstance(self.outer, Newton):
            return "not converged: the method stalled"
        return ENDS[self.stopped]


Judged = tuple[ContactTotals, ContactResiduals]
"""Of a contact."""


class Iteration:
    """The outer iteration of an assembly and its certificate, from one load step to the next.

    Construction is collective.

    Parameters
    ----------
    report : called with every iteration
    clock : times the phases outer and recover
    slight : friction with coefficients up to this resists no motions

    Attributes
    ----------
    outer : the method
    statuses : of the contact nodes in the iterations of the load step
    limit : largest residual of a certified answer
    """

    def __init__(
        self,
        assembly: Assembly,
        method: SettledMethod,
        report: Report,
        clock: Clock,
        slight: float = 0.0,
    ) -> None:
        self.assembly, self.method, self.clock = assembly, method, clock
        self._slight_friction = slight
        for body in assembly.bodies:
            body.member.restart()
        self.statuses = StatusLog(assembly.space)
        self.released = False
        self._bolts = np.zeros(0, bool)
        self.held = Held(np.zeros((assembly.joint.rigid.size, 0)))
        self.hold(np.zeros(assembly.joint.rigid.size))

        def note(step: Step) -> None:
            self.statuses.record(self.outer.forces, self.outer.bound)
            free_garbage()  # a vector for every multiplication
            report(step)
            now_at(f"iteration {step.iteration + 1}", said=True)

        with clock.phase("outer"):
            self.outer = choose_outer(assembly, method, note)
            if isinstance(self.outer, Newton):
                # forces that leave more than the tolerance without balance do not converge
                least = max(SLIGHT, method.tolerance)
                self.outer.hopeless = lambda: self._past_meshes(least) is not None
        self.limit, self._tolerance = certificate_limit(method.tolerance), method.tolerance
        self._rounds = Rounds()
        self._stopped = ""  # why the outer method has ended, until it goes on
        self._checkpoints: Checkpoints | None = None
        self.given = assembly.world.allreduce(
            max(body.member.C.solver.given for body in assembly.bodies), MPI.MAX
        )

    def hold(self, alpha: np.ndarray) -> None:
        """Hold the motions that nothing determines at the amplitudes that they have in α (rigid.size,). Collective."""
        stays, self._before = self.assembly.joint.stays, alpha
        if not np.array_equal(self._bolts, stays.bolts):
            self._bolts = stays.bolts
            self.held = motions_to_hold(self.assembly, not self.released, self._slight_friction)
        stays.hold(self.held.span, alpha)

    def begin(self) -> None:
        """Forget the certificates of the load step before; the outer method begins anew by itself."""
        self._tolerance, self._rounds, self._stopped = self.method.tolerance, Rounds(), ""
        self._refine()
        self.statuses.clear()

    def keep(self, checkpoints: Checkpoints) -> None:
        """Note states in `checkpoints` when the outer method asks for it, and at its end; continue from its state.

        For a run of one load step. Collective. Raises InputError on all ranks when the checkpoint is of other meshes.
        """
        self._checkpoints = checkpoints
        checkpoints.follow(self.assembly, outer=self.outer, iteration=self)
        self.outer.checkpoint = self._note

    def _note(self) -> None:
        if self._checkpoints:
            self._checkpoints.note(len(self.outer.history))

    def state(self) -> dict[str, Any]:
        return {
            "tolerance": self._tolerance,
            "rounds": tuple(self._rounds),
            "stopped": self._stopped,
            "statuses": self.statuses.state(),
            "released": self.released,
        }

    def restore(self, state: dict[str, Any]) -> None:
        self._tolerance = state["tolerance"]
        self._rounds = Rounds(*state["rounds"])
        self._stopped = state["stopped"]
        self.statuses.restore(state["statuses"])
        if state["released"]:
            self.release()
        self._refine()

    def solve(
        self,
        mechanism: Mechanism | None,
        since: Beginning | None = None,
        largest: np.ndarray = NO_SIZES,
        lean: Callable[[], bool] = lambda: False,
    ) -> Solution:
        """Iterate until the answer is certified, or tighter tolerances are useless.

        Where the iteration stops by its criterion but the certificate fails, it goes on with a tighter one.

        Parameters
        ----------
        mechanism : that proves that there is no equilibrium; there is no iteration then
        since : the beginning of the load step; left out, no displacement and no stress
        largest : (3,) `Solution.sizes` of the load steps before
        lean : whether an answer needs no displacements, see `conclude`; asked once its forces are found

        Collective. Raises as the function `solve`.
        """
        while True:
            with self.clock.phase("outer"):
                stopped = "mechanism" if mechanism else self._stopped or self._iterated()
            self._stopped = stopped
            self._note()  # results follow from here, whatever prevents them from being written
            with self.clock.phase("recover"):
                solution = self._concluded(stopped, since, largest, lean)
            held, driven = self._left_along_held(stopped)
            if driven == "released":
                continue
            solution = replace(solution, held=held)
            hopeless = self._hopeless(solution)
            if isinstance(driven, Mechanism):
                return replace(solution, mechanism=driven, stopped="mechanism")
            if stopped != "converged" or solution.certified or hopeless:
                return replace(
                    solution, **{"mechanism": mechanism} | self._why(solution, mechanism)
                )
            self._stopped = ""
            if self._checkpoints:
                self._checkpoints.forget()
            self._tolerance *= TIGHTER
            self._refine()
            log.info(
                "the certificate fails (%s); continuing to a tolerance of %.0e",
                ", ".join(solution.violations),
                self._tolerance,
            )

    def _iterated(self) -> str:
        """Why the outer method has ended, which a checkpoint keeps together with the least motion. Collective."""
        outer, tolerance = self.outer, self.method.tolerance
        now_at(f"iteration {len(outer.history) + 1}")
        try:
            stopped = self._kept(outer.run(self._tolerance))
            if stopped == "converged" and isinstance(outer, Newton):
                least_motion(self.assembly, outer, self._before, self._tolerance)
                outer.even()
        except SolverError as error:
            if self.given > tolerance:
                error.args = (
                    f"{error}; -body_ksp_rtol {self.given:g} is too coarse for method.tolerance = "
                    f"{tolerance:g}: leave that option out",
                )
            raise
        return stopped

    def _hopeless(self, solution: Solution) -> bool:
        """Whether a tighter tolerance is useless after a solution, which is noted."""
        before, now = self._rounds, len(self.outer.history)
        worst = max(value for value, _ in solution.certificate.worst().values())
        gained, went_on = worst < USEFUL * before.least, now > before.steps
        useless = 0 if gained else before.useless + went_on
        self._rounds = Rounds(min(worst, before.least), useless, now)
        return (
            useless >= USELESS
            or self._tolerance < sys.float_info.epsilon
            or (solution.unbalanced and not self.assembly.loose)
        )

    def _concluded(
        self,
        stopped: str,
        since: Beginning | None,
        largest: np.ndarray,
        lean: Callable[[], bool],
    ) -> Solution:
        """`conclude`, a lean one where that is enough, and how loose bodies drift. Collective."""
        solution = None
        if (
            stopped == "converged" and lean()
        ):  # what this certificate doubts is judged by displacements
            solution = self.conclude(stopped, since, largest, lean=True)
        if solution is None or not solution.certified:
            solution = self.conclude(stopped, since, largest)
        if stopped == "drift":
            solution = replace(solution, drift=describe_drift(self.assembly, self.outer.motions))
        return solution

    def _left_along_held(self, stopped: str) -> tuple[Sequence[HeldMotion], Mechanism | str]:
        """The held motions with what is left along them, and the mechanism, if a load drives one; "released" where
        the iteration goes on without those that coarse elements let hold, as loads drive them. Collective."""
        if stopped != "converged" or not self.held.basis.size:
            return (), ""
        held, driven, released = judge_held(self.assembly, self.held, self.outer)
        if not released:
            if not driven and slides(held):
                driven = self._past_meshes(SLIGHT)
            return held, driven or ""
        log.info("a motion that coarse elements hardly resist is driven by loads: it is not held")
        self.release()
        if isinstance(self.outer, Newton):
            steps = self.outer.history
            self.outer.begin()
            self.outer.history = steps
        self._stopped = ""
        return (), "released"

    def release(self) -> None:
        """Hold no longer the motions that coarse elements let hold. Collective."""
        stays, self.released = self.assembly.joint.stays, True
        self.held = motions_to_hold(self.assembly, False, self._slight_friction)
        stays.hold(self.held.span, stays.at)

    def _refine(self) -> None:
        """From a certificate that fails on, let the gaps be those of the bodies to the precision of solves, as in the
        certificate, instead of those of a rounded compliance: iterative refinement."""
        if isinstance(self.outer, Newton):
            self.outer.refined = self._tolerance < self.method.tolerance

    def _why(self, solution: Solution, mechanism: Mechanism | None) -> dict[str, Any]:
        """The entries of a solution that say why it is no answer, which nothing has said so far. Collective."""
        if mechanism or solution.certified or solution.stopped == "diverged":
            return {}
        rounding = self._rounding() if solution.stopped == "converged" else {}
        return {"mechanism": self._slight(SLIGHT), "rounding": rounding}

    def _rounding(self) -> dict[str, float]:
        """By body ε ‖C‖ ‖s‖ / ‖C s‖, the error in double precision of the contact displacements that the forces s
        cause, as a fraction of these. It is large where a body yields far more to other forces than to those of its
        contacts, as a thin layer to bending. The same on all ranks; collective."""
        outer, found = self.outer, dict[str, float]()
        for body, s in zip(self.assembly.bodies, outer.body_forces(), strict=True):
            yielded = np.zeros(body.member.size)
            with self.assembly.exchange.deferred():
                body.member.mult(s, yielded, "certificate")
                most = body.member.C.norm() * norm(s) if s.any() else 0.0
                size = norm(yielded)
                found[body.spec.name] = sys.float_info.epsilon * most / size if size else 0.0
        self.assembly.exchange.meet("rounding")
        return self.assembly.world.bcast(gathered(self.assembly.world, found))

    def _slight(self, least: float) -> Mechanism | None:
        """The mechanism of an imbalance from `least` on, which is too slight to be told before the iteration has
        failed. None for bodies that move far, whose loads change as they move. Collective."""
        return None if self.assembly.joint.far else look_for_mechanism(self.assembly, least)

    def _past_meshes(self, least: float) -> Mechanism | None:
        """The same, unless what is left along a held motion decides. Collective."""
        return beyond_meshes(self.assembly, self.held, self._slight(least))

    def _kept(self, stopped: str) -> str:
        """The end of `Outer.run`, if a method from outside keeps what `Outer` promises, else a SolverError. Collective."""
        assembly = self.assembly
        if assembly.outer is None:
            return stopped
        with agreed(assembly.world):
            check_promises(
                self.method.outer,
                self.outer,
                stopped,
                (assembly.space.size, assembly.joint.rigid.size),
                len(self.statuses.counts),
            )
        return assembly.world.bcast(stopped)

    def conclude(
        self,
        stopped: str,
        since: Beginning | None = None,
        largest: np.ndarray = NO_SIZES,
        lean: bool = False,
    ) -> Solution:
        """Displacements, contact states and certificate of the outer method's forces. Collective.

        A `lean` one has no displacements: contact displacements by a product with C take their place, and the balance
        of loose bodies that of all nodes. Contact states are without openings between the nodes, and without the slip
        of contacts that have no friction.
        """
        assembly, outer = self.assembly, self.outer
        world, joint = assembly.world, assembly.joint
        left = joint.unheld(outer.forces, outer.motions)
        displacements, traces, sizes, motions = displaced(assembly, outer, largest, left, lean)
        outer.refresh(traces)
        both = assembly.exchange.collect(traces, "answer")
        beside = assembly.exchange.swap_objects(motions)
        bodies = gathered(world, sizes) | driven_partners(assembly, outer)
        summed = ("load", "energy", "confined", "work")
        sums = [sum(size[key] for size in bodies.values()) for key in summed]
        now = [max(size[key] for size in bodies.values()) for key in ("moved", "yielding")]
        (load, energy, confined, work), now = world.bcast((sums, now))

        mismatch, interfaces = self._mismatch(), joint.placed(outer.motions)
        shares = [interface.prescribed for interface in interfaces]
        prescribed = np.concatenate([np.empty(0), *shares])
        with event("Certificate"):
            known = load, now, largest[1:].tolist()
            states, judged = self._contacts(interfaces, both, beside, since, known, mismatch)
        forces = [0.0, *(float(np.abs(state.forces).max(initial=0.0)) for state in states.values())]
        force = world.allreduce(max(forces), MPI.MAX)
        contacts = self._told(judged)
        equilibrium = {
            name: equilibrium_residual(size["left"], size["acting"], load, size["made"])
            for name, size in bodies.items()
        }
        residuals = {name: residuals for name, (_, residuals) in contacts.items()}
        return Solution(
            stopped,
            displacements,
            states,
            {name: totals for name, (totals, _) in contacts.items()},
            Certificate(residuals, equilibrium).told(world),
            self.limit,
            outer,
            self.statuses,
            self.given,
            both[0] + both[1] + prescribed,
            prescribed,
            energy,
            confined,
            np.array([force, *now]),
            work,
        )

    def _mismatch(self) -> np.ndarray:
        """The `mismatch` of the outer method; what a method from outside says of itself is no evidence. Collective."""
        assembly, outer = self.assembly, self.outer
        if assembly.outer is None:
            return outer.mismatch
        seen = assembly.exchange.spread(outer.forces)
        apart = [s - mine for s, mine in zip(seen, outer.body_forces(), strict=True)]
        return np.hypot(*assembly.exchange.collect(apart, "mismatch"))

    def _told(self, judged: Mapping[str, Judged]) -> dict[str, Judged]:
        """What the owner of a contact tells of it to the ranks of both bodies, and to the first rank of all, in the
        order of the scene. Collective."""
        assembly = self.assembly
        known = assembly.exchange.told(judged) | gathered(assembly.world, judged)
        names = [contact.name for contact in assembly.scene.contact]
        return {name: known[name] for name in names if name in known}

    def _contacts(
        self,
        interfaces: Sequence[Interface],
        both: Sequence[np.ndarray],
        beside: Mapping[str, tuple],
        since: Beginning | None,
        sizes: tuple[float, list[float], list[float]],
        mismatch: np.ndarray,
    ) -> tuple[dict[str, ContactState], dict[str, Judged]]:
        """State, and totals with residuals, of each contact that this rank owns. Not collective.

        Parameters
        ----------
        both : (2, size) traces of the two bodies
        beside : of both bodies by contact, as of `_displaced`
        sizes : loads, and displacements of this load step and of those before, to which residuals are relative
        mismatch : as of `Outer`
        """
        space, outer = self.assembly.space, self.outer
        nothing: Beginning = np.zeros(space.size), lambda interface, part, s: 0.0 * s, {}
        start, former, slid = since or nothing
        load, now, before = sizes
        states, judged = dict[str, ContactState](), dict[str, Judged]()
        for interface, part, bound in zip(
            interfaces, space.parts.values(), space.laws.bounds(outer.bound), strict=False
        ):
            s, near = outer.forces[part], list(filter(None, beside[interface.name]))
            u1, u2 = both[0][part], both[1][part] + interface.prescribed
            yielding = max(elastic for *_, elastic in near)
            state = contact_state(
                interface,
                s,
                bound,
                u1 + u2,
                self._between(interface, near),
                (start[part], former(interface, part, s)),
                yielding,
                _slides(interface, near, slid.get(interface.name, 0.0)),
            )
            residuals = contact_residuals(state, s, mismatch[part], (u1, u2), load, now, before)
            states[interface.name] = state
            judged[interface.name] = state.totals, residuals
        return states, judged

    def _between(self, interface: Interface, near: Sequence[tuple]) -> np.ndarray | None:
        """(q,) the gap at points between the nodes, where the discrete conditions promise nothing (m); None in a lean
        solution. `near` are the motions of its bodies beside the nodes."""
        if near[0][0] is None:
            return None
        name, probes = interface.bodies[0], interface.probes
        points = next(body.mesh.points for body in self.assembly.bodies if body.spec.name == name)
        beyond = interface.partner.carried(probes.moved(0, points))
        closing = sum(closing for closing, *_ in near)
        return (
            probes.opening(interface.scale) + np.einsum("qd,qd->q", probes.normal, beyond) - closing
        )


def _slides(
    interface: Interface, near: Sequence[tuple], before: np.ndarray | float
) -> tuple[np.ndarray, np.ndarray | float] | None:
    """The slip of a contact without friction, whose unknowns have no tangential part, now and `before` (m): that of the
    bodies beside the nodes. None in a lean solution, and with friction."""
    if near[0][0] is None or not interface.law.frictionless:
        return None
    carried = interface.partner.carried(interface.places)
    gone = np.einsum("mcd,md->mc", interface.tangents, carried)
    return sum(along for _, along, _ in near) - gone, before


def solve(
    assembly: Assembly,
    method: SettledMethod,
    report: Report = no_report,
    checkpoints: Checkpoints | None = None,
    clock: Clock | None = None,
    start: Start | None = None,
) -> Solution:
    """Solve `assembly` by `method` in one load step, from zero, from a `start`, or from the state in `checkpoints`.

    `clock` times the phases outer and recover. Collective. Raises SolverError, and InterruptionError
    when a signal came; the same on all ranks.
    """
    clock = clock or Clock()
    with clock.phase("outer"):
        mechanism = look_for_mechanism(assembly)
    iteration = Iteration(assembly, method, report, clock)
    mechanism = beyond_meshes(assembly, iteration.held, mechanism)
    if start and isinstance(iteration.outer, Newton):
        iteration.outer.begin(start(), foreseen=True)
    if checkpoints:
        iteration.keep(checkpoints)
    return iteration.solve(mechanism)


def lean_steps(assembly: Assembly) -> int:
    """How many load steps at the end of a leg need displacements; zero if all of them do. Collective."""
    scene, time = assembly.scene, assembly.scene.time
    # Displacements are asked for at the end of a leg. Slip without friction is not among the unknowns and counts from
    # the step before, which needs them as well; derivatives may need them at every step. By multigrid a product with C
    # would cost as much.
    rubs = [
        contact.friction != NoFriction() for contact in scene.contact if contact.kind != "bonded"
    ]
    several = time is not None and (
        bool(time.cycle) or (time.steps > 1 if time.steps else any(rubs))
    )
    if (
        not several
        or scene.far
        or assembly.joint.dear
        or scene.output.steps == "all"
        or scene.output.derivatives
    ):
        return 0
    with assembly.exchange.deferred():
        for body in assembly.bodies:
            body.member.prepare_energies()
    return 1 + (not all(rubs))


def choose_outer(assembly: Assembly, method: SettledMethod, report: Report) -> Outer:
    """The outer method that was asked for. Collective."""
    if assembly.outer is not None:
        outer = assembly.outer(assembly, method, report)
        for name, none in {"history": [], "inner_steps": {}, "checkpoint": lambda: None}.items():
            if not hasattr(outer, name):
                setattr(outer, name, none)
        return outer  # type: ignore[return-value]
    if method.outer == "relaxation":
        from ddmpi.published.published import PublishedIteration

        return PublishedIteration(assembly, method, report)
    if method.outer == "anderson":
        from ddmpi.published.anderson import AndersonIteration

        return AndersonIteration(assembly, method, report)
    return Newton(assembly.joint, method.max_iterations, report)
