"""Load steps, for friction that depends on the path of the loads.

Each step is solved like a scene without load steps, but slip counts from the end of the step before. Factors of the
stiffness, compliances and the coarse problem are those of the first step; only right-hand sides change.

A leg is the path from one turning point of the loads to the next. It is solved in 1, 2, 4, … load steps until the
forces at its end change little, unless the scene gives the number. Where the contact grows, the steps are equal in its
growth. The first step of a leg starts from the last forces, with the nodes under pressure closed and sticking; a later
one from the linear extrapolation of the two steps before it.
"""

from __future__ import annotations

import logging
import math
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.chain import Chain
from ddmpi.interface.state import slip_start
from ddmpi.judge.equilibrium import Mechanism
from ddmpi.judge.plausible import doubt_answer
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import Report, no_report
from ddmpi.results.tables import leg_values
from ddmpi.run.checkpoint import Checkpoints
from ddmpi.run.equilibrium import NOTHING, look_for_mechanism, undetermined_motions
from ddmpi.run.gather import StepLog
from ddmpi.run.report import UNDETERMINED
from ddmpi.run.solve import Iteration, Solution, lean_steps, solve
from ddmpi.system.clock import Clock

log = logging.getLogger("ddmpi")

MOST = 1024
"""Most load steps of a leg for ``time.tolerance``."""

SHORT = 0.01
"""Where gaps close along a leg, its first step is divided at this fraction, to learn how fast they close."""

CUTS = 6
"""Most times that a failing step is halved, and that the leg's shortest planned step may be: steps that are halved
again after each success would creep towards a load without equilibrium."""

CURABLE = ("diverged", "max_iterations", "stalled", "drift", "converged")
"""The ends of an iteration that a shorter step may cure; "converged" has a certificate that fails."""

CERTAIN = 0.25
"""Changes below this fraction of ``time.tolerance`` are small enough at any rate. At the slowest one, the root of the
number of steps, as where nodes touch within a step, the error left is 2.4 times the change."""

KEPT = ("iterations", "_leg", "_number", "_coarse", "_changed", "_largest", "_given", "_cuts", "_noted", "_shortest")
"""Attributes of a march that checkpoints keep unchanged."""

MARKS = ("_now", "_before", "_base")
"""Attributes of a march that are marks."""


@dataclass
class _Mark:
    """The end of a load step, from which the next one and its energies count.

    Attributes
    ----------
    time : of the step
    s, alpha : forces (size,) in N and motions of loose bodies in m
    d : (size,) free displacements less gaps, tangentially from the beginning (m)
    moved : (size,) relative displacements (m)
    opening, prescribed : (size,) of a `Space` (m)
    factors : (k,) by history
    work : (2, k), as `Solution.work` (J)
    energy : strain energy (J)
    length : of closed contacts, in space their area (m, m²)
    slid : by contact without friction its slip (m, d − 1) of all load steps (m)
    derived : derivatives, see `ddmpi.derive.chain`
    """

    time: float
    s: np.ndarray
    alpha: np.ndarray
    d: np.ndarray
    moved: np.ndarray
    opening: np.ndarray
    prescribed: np.ndarray
    factors: np.ndarray
    work: np.ndarray
    energy: float
    length: float
    slid: dict[str, np.ndarray]
    derived: dict[str, np.ndarray]

    @property
    def closed(self) -> np.ndarray:
        """(size,) relative displacements less the initial gaps (m)."""
        return self.moved - self.opening

    @classmethod
    def first(cls, assembly: Assembly, derived: dict[str, np.ndarray]) -> _Mark:
        """Time 0, free of stress."""
        space, zero = assembly.space, np.zeros(assembly.space.size)
        touching = sum(float(interface.area[interface.opening <= 0.0].sum()) for interface in space.interfaces)
        still, k = np.zeros(assembly.joint.rigid.size), len(assembly.scene.followed) + 1
        return cls(0.0, zero, still, zero, zero, space.opening, zero, np.zeros(k), np.zeros((2, k)), 0.0,
                   float(space.add(np.array([touching]))[0]), {}, derived)


def march(assembly: Assembly, report: Report = no_report, checkpoints: Checkpoints | None = None,
          clock: Clock | None = None) -> tuple[Solution, StepLog]:
    """Solve `assembly` in the load steps of its scene, without [time] in one; the solution and the record of the steps.

    Parameters and errors as of `solve`. The solution is that of the last step, with the largest residuals of all steps.
    Collective.
    """
    scene, clock = assembly.scene, clock or Clock()
    log = StepLog()
    if scene.time is None:
        chain, time = Chain(assembly, scene.output.derivatives), scene.legs[0]
        solution = solve(assembly, scene.method, report, checkpoints, clock)
        log.note_step(time, solution)
        if solution.certified:
            log.derive(*chain.entries(time, chain.advance(time, solution.outer, solution), solution), several=False)
        return solution, log
    assembly.act(scene.legs[0])
    march = March(assembly, Iteration(assembly, scene.method, no_report, clock), log)
    if checkpoints:
        checkpoints.follow(assembly, outer=march.outer, steps=march)
    return march.run(checkpoints), log


class March:
    """The solution of all legs, step by step. Everything is collective.

    Attributes
    ----------
    iteration, outer : that solve every load step
    log : the record of the steps of accepted subdivisions
    iterations : of all steps before the present one, also of rejected subdivisions
    """

    def __init__(self, assembly: Assembly, iteration: Iteration, log: StepLog) -> None:
        scene = assembly.scene
        assert isinstance(iteration.outer, Newton) and scene.time
        self.assembly, self.iteration, self.outer, self.log = assembly, iteration, iteration.outer, log
        self.iterations = 0
        self._legs, self._steps, self._tolerance = scene.legs, scene.time.steps, scene.time.tolerance or math.inf
        self._safe: bool | None = None
        self._largest = np.zeros(2)  # forces and slip bounds so far (N)
        self._cuts = 0
        factors = [scene.factors(time) for time in (0.0, *self._legs)]
        for body in assembly.bodies:  # forces are compared with the largest loads of all legs
            body.member.elasticity = body.member.elasticity.largest(factors)
        self._leanly = lean_steps(assembly)
        assembly.act(0.0)
        self._sudden = assembly.space.any(assembly.joint.d + assembly.space.opening)  # loads act at time 0
        self._chain = Chain(assembly, scene.output.derivatives)
        self._now = self._before = _Mark.first(assembly, self._chain.first())
        self._ahead: list[float] = []
        self._given = 0.0  # by gaps that are not of time, in the first step: they act at once (J)
        self._leg = -1
        self._next_leg()

    def run(self, checkpoints: Checkpoints | None = None) -> Solution:
        """Solve all load steps; the solution of the last one, or of the one that has none."""
        while True:
            if checkpoints and self.iterations:
                checkpoints.note(self.iterations)
            time = self._ahead[0]
            solution = self._step(time)
            if not solution.certified:
                if self._cut(solution, time):
                    continue
                self.log.note_iterations(solution)
                break
            self._accept(time, solution)
            if not self._ahead and not self._refine():
                if self._leg == len(self._legs) - 1:
                    break
                doubts = doubt_answer(self.assembly, solution.displacements, solution.states, solution.contacts, True)
                loose = undetermined_motions(self.assembly, solution.states)[:UNDETERMINED]
                self.log.doubt(time, [*doubts, *loose])
                self._next_leg()
        worst = self.log.judge(solution.certificate)
        return replace(solution, certificate=worst.told(self.assembly.world))

    def _step(self, time: float) -> Solution:
        """Solve the load step to `time`."""
        assembly, joint = self.assembly, self.assembly.joint
        over = [name for name, end in assembly.scene.tightened.items() if end <= self._now.time]
        joint.keep(over, self._now.alpha)
        mechanism = self._mechanism(time)
        assembly.act(time)
        self._d = joint.d
        span = self._now.time - self._before.time  # zero at a turning point, where _before is _now
        share = (time - self._now.time) / span if span else 0.0
        start = self._slip_begins(share)
        joint.d = joint.d - start
        self._begin(share, start)
        largest = self.log.most["sizes"]
        self.outer.nothing, self.outer.direct.steps = NOTHING * largest[0], self._now.time > 0.0
        solution = self.iteration.solve(mechanism, (start, self._now.s, self._now.slid), largest, self._lean)
        return replace(solution, time=time)

    def _lean(self) -> bool:
        """Whether nobody asks for the displacements of the present step."""
        return 0 < self._leanly < len(self._ahead)

    def _begin(self, share: float, start: np.ndarray) -> None:
        """Begin to iterate for a step whose slip begins at `start` (size,).

        The step is a `share` of the one before, zero at a turning point. There, and after a cut, nothing can be
        extrapolated.
        """
        now, before = self._now, self._before
        self.iteration.begin()
        if now.time == 0.0:
            self.outer.begin()
        elif share and not self._cuts:
            s, closed, alpha = (new + share * (new - old) for new, old in (
                (now.s, before.s), (now.closed, before.closed), (now.alpha, before.alpha)))
            self.outer.begin((s, start - closed, alpha), foreseen=True)  # loads are linear along a leg
        else:
            self.outer.begin((now.s, now.d - self._d - now.closed + start, now.alpha))

    def _slip_begins(self, share: float) -> np.ndarray:
        """Where the slip of the next step, a `share` of the one before, begins (size,) (m)."""
        s, closed = self._now.s, self._now.closed
        gain = closed - self._before.closed
        starts = [slip_start(interface.law, s[part], closed[part], gain[part], share)
                  for interface, part in self.assembly.space.with_slices()]
        return np.concatenate([np.empty(0), *starts])

    def _mechanism(self, time: float) -> Mechanism | None:
        """The mechanism that proves that no contact forces balance the loads at `time`, or None.

        The loads that contact forces can balance are a convex set, and loads are linear in time along a leg. So if
        those at its two ends have an equilibrium, all have.
        """
        assembly = self.assembly
        if not assembly.loose:
            return None

        def look(at: float) -> Mechanism | None:
            assembly.act(at)
            return look_for_mechanism(assembly)

        if self._safe is None:  # all legs but the first begin at a solved step
            self._safe = (self._leg > 0 or look(0.0) is None) and look(self._legs[self._leg]) is None
        return None if self._safe else look(time)

    def _accept(self, time: float, solution: Solution) -> None:
        """Note the step to `time`, whose solution is certified."""
        assembly, now, outer = self.assembly, self._now, self.outer
        space, scene = assembly.space, assembly.scene
        contacts = solution.contacts.values()
        factors = np.array(list(scene.factors(time).values()))
        s, moved = outer.forces, solution.moved
        opened, gone = space.opening - now.opening, solution.prescribed - now.prescribed
        # forces and displacements are taken as linear in time within the step, so work is by the trapezoidal rule
        closing = moved - now.moved - opened
        mean = 0.5 * (s + now.s)
        driven, interface_work = space.add(np.array([mean @ (gone - opened), mean @ closing]))
        if now.time == 0.0:  # an overlap (of bonds and guides also a gap) acts at once, before any load
            sudden = np.concatenate([np.empty(0), *(
                now.opening[part] if interface.law.two_sided else np.minimum(now.opening[part], 0.0)
                for interface, part in space.with_slices())])
            self._given = float(space.add(np.array([mean @ sudden]))[0])
        # loads over displacements, and reactions of clamps over what these prescribe: ΔW = ½ (b_n + b_n−1) Δu
        work = 0.5 * (factors + now.factors) @ (solution.work[0] - now.work[0])
        work += 0.5 * (factors - now.factors) @ (solution.work[1] + now.work[1]) + driven
        lost = work - (solution.energy - now.energy) - interface_work  # ΔW − ΔU − ΔI, zero but for rounding
        dissipated, closed = assembly.world.bcast((sum(contact.dissipated for contact in contacts),
                                                   sum(contact.closed for contact in contacts)))
        _, worked, _, taken, rubbed, _ = self.log.energies[-1] if self.log.energies else np.zeros(6)
        self.log.energies.append([time, worked + work, solution.energy, taken + interface_work, rubbed + dissipated,
                                  lost])
        self.log.note_step(time, solution)
        self.log.judge(solution.certificate)
        derived = self._chain.advance(time, outer, solution, now, self._before)
        if len(self._ahead) == 1:  # the end of a leg
            self.log.derive(*self._chain.entries(time, derived, solution))
        self._now = _Mark(time, s, outer.motions, self._d, moved, space.opening, solution.prescribed, factors,
                          solution.work, solution.energy, closed, {
                              name: state.slip_total for name, state in solution.states.items()
                              if state.interface.law.frictionless}, derived)
        self._before = self._now if self._sudden and now.time == 0.0 else now
        del self._ahead[0]
        if not self._ahead or scene.output.steps == "all":
            self.log.kept.append((time, s, outer.motions, *map(leg_values, solution.states.values())))
        counts = [sum(getattr(contact, status) for contact in contacts) for status in ("open", "slip", "stick")]
        log.info("time %-10.6g %3d iterations; %d open, %d slip, %d stick nodes", time, len(outer.history), *counts)
        self._leave()
        self._cuts = 0

    def _leave(self) -> None:
        """Count the iterations of a step that is over."""
        self.iterations += len(self.outer.history)
        self.outer.history = []

    def _cut(self, solution: Solution, time: float) -> bool:
        """Whether to try again in a step half as long, after the step to `time` has failed."""
        # shorter steps cure neither loads without equilibrium nor solves that -body_ksp_rtol makes too coarse
        if solution.mechanism or solution.stopped not in CURABLE or self._cuts == CUTS or (
                solution.given and solution.unbalanced) or time - self._now.time < 1.5 * self._shortest:
            return False
        self._cuts += 1
        self._ahead.insert(0, (self._now.time + time) / 2)
        log.info("no certified answer at time %g (%s); the step is halved", time, solution.reason)
        self._leave()
        return True

    def _next_leg(self) -> None:
        """Begin the next leg."""
        self._leg += 1
        self._base = self._before = self._now
        self._noted = self.log.state()
        self._safe = None
        self._coarse: np.ndarray | None = None
        self._changed = math.nan
        self._number = self._steps or 1
        self._ahead = self._times()

    def _times(self, length: float = 0.0, closing: bool = False) -> list[float]:
        """The times of the steps of the present leg.

        They are equal in the growth of the contact where the leg's end has a larger closed `length`, whose square is
        taken as linear in the loads, as for a circle on a plane (Hertz). Where gaps are `closing`, the first step is
        divided.
        """
        start, end = self._base.time, self._legs[self._leg]
        x, first = np.arange(1, self._number) / self._number, self._base.length
        # length² = first² + t (length² − first²), solved for the times t at which the length has grown by the shares x
        if length > first:
            x = ((first + x * (length - first)) ** 2 - first**2) / (length**2 - first**2)
        if closing:
            x = np.insert(x, 0, SHORT * x[0])
        times = [*(start + x * (end - start)).tolist(), end]
        self._shortest = 0.5**CUTS * float(np.diff([start, *times]).min())
        return times

    def _refine(self) -> bool:
        """Whether to solve the leg once more in twice as many steps, now that its end is reached."""
        space, s = self.assembly.space, self._now.s
        frictional = [(interface, part) for interface, part in space.with_slices()
                      if len(interface.sliding) and interface.law.name != "bonded"]
        if self._steps or not space.any(np.array([len(frictional)])):
            return False  # without friction there is no memory
        size = space.norm(s)
        # tangential forces are compared with slip bounds: with little friction they are small beside all forces
        bound = space.norm(np.minimum(space.laws.bound_at(s), size))
        self._largest = np.maximum(self._largest, [size, min(bound, size)])
        if self._coarse is not None and self._largest.all():
            change = self._change(s - self._coarse)
            # where changes fall by r = former / change with each doubling, those to come add up to change / (r − 1)
            faster = self._changed / change - 1.0 if change else math.inf
            before, self._changed = self._changed, change
            close = change <= self._tolerance * (1.0 if math.isnan(before) else min(max(faster, CERTAIN), 1.0))
            # forces may agree by chance while slip is coarse: friction then dissipates more than contacts took
            given = self._given if self._base.time == 0.0 else 0.0
            enough = close and self.log.excess(self._noted, given) <= self._tolerance
            log.info("time %g reached: %d and %d steps agree to %.2g, %s", self._legs[self._leg], self._number // 2,
                     self._number, change, "accepted" if enough else "but friction dissipates more than it can"
                     if close else "not enough")
            if enough:
                return False
        if 2 * self._number > MOST or not self._largest.all():
            if self._largest.all():
                log.warning("time %g: forces miss time.tolerance in %d load steps; doubling changed them by %.2g",
                            self._legs[self._leg], self._number, self._changed)
            return False
        # nodes that were open and now carry force: their gaps close within the leg
        closing = space.any(np.array([
            ((s[part][:interface.m] > 0.0) & (self._base.s[part][:interface.m] <= 0.0)
             & (self._base.closed[part][:interface.m] < 0.0)).any() for interface, part in frictional]))
        self._coarse, self._number = s, 2 * self._number
        length, self._now, self._before = self._now.length, self._base, self._base
        self.log.restore(self._noted)
        self._ahead = self._times(length, closing)
        return True

    def _change(self, change: np.ndarray) -> float:
        """The size of a `change` (size,) of forces over all forces, or of its tangential part over slip bounds if
        larger."""
        space = self.assembly.space
        tangential = change.copy()
        for interface, part in space.with_slices():
            tangential[part][:interface.m] = 0.0
        return float((space.norms([change, tangential]) / self._largest).max())

    def state(self) -> dict[str, Any]:
        return {name: getattr(self, name) for name in KEPT} | {name: asdict(getattr(self, name)) for name in MARKS} | {
            "ahead": tuple(self._ahead), "log": self.log.state()}

    def restore(self, state: dict[str, Any]) -> None:
        """Go on with the first of the steps that lie ahead in `state`."""
        vars(self).update({name: state[name] for name in KEPT} | {name: _Mark(**state[name]) for name in MARKS})
        self._ahead, self._safe = list(state["ahead"]), None
        self.log.restore(state["log"])
