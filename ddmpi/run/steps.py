"""Load steps, for friction that depends on the path of the loads.

Each step is solved like a scene without load steps, but slip counts from the end of the step before. Factors of the
stiffness, compliances and the coarse problem are those of the first step; only right-hand sides change.

A leg is the path from one turning point of the loads to the next. It is solved in 1, 2, 4, … load steps until the
forces at its end change little, unless the scene gives the number. Where the contact grows, the steps are equal in its
growth. The first step of a leg starts from the last forces, with the nodes under pressure closed and sticking; a later
one from the linear extrapolation of the two steps before it.
"""

import logging
import math
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.chain import Chain
from ddmpi.interface.state import slip_start
from ddmpi.judge.equilibrium import Mechanism
from ddmpi.judge.plausible import doubt_answer
from ddmpi.methods.newton import Newton
from ddmpi.results.checkpoint import Checkpoints
from ddmpi.results.summary import count
from ddmpi.results.tables import leg_values
from ddmpi.run.equilibrium import look_for_mechanism, undetermined_motions
from ddmpi.run.gather import StepLog
from ddmpi.run.held import beyond_meshes
from ddmpi.run.marks import Mark
from ddmpi.run.recover import NOTHING
from ddmpi.run.report import NAMED
from ddmpi.run.solve import Iteration, Solution, lean_steps
from ddmpi.scene.time import most_loaded
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import counted

log = logging.getLogger("ddmpi")

MOST = 1024  # most load steps of a leg for ``time.tolerance``
ROLLED = 0.1  # error of rolled ways, over `time.tolerance`
SHORT = 0.01  # where gaps close along a leg, its first step is divided at this fraction, to learn how fast they close

EXCESS = 0.1
"""Given load steps are too long if `StepLog.excess` is larger: if friction dissipates this much more than contacts take."""

CUTS = 6
"""Most times that a failing step is halved, and that the leg's shortest planned step may be: steps that are halved
again after each success would creep towards a load without equilibrium."""

CURABLE = ("diverged", "max_iterations", "stalled", "drift", "unsettled", "converged")
"""The ends of an iteration that a shorter step may cure; "converged" has a certificate that fails."""

CERTAIN = 0.25
"""Changes below this fraction of ``time.tolerance`` are small enough at any rate. At the slowest one, the root of the
number of steps, as where nodes touch within a step, the error left is 2.4 times the change."""

KEPT = (
    "iterations",
    "_leg",
    "_number",
    "_changed",
    "_largest",
    "_given",
    "_cuts",
    "_noted",
    "_shortest",
    "_began",
    "_planned",
    "_plans",
)
"""Attributes of a march that checkpoints keep unchanged."""

MARKS = ("_now", "_before", "_base", "_coarse")  # attributes of a march that are marks


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
        self.assembly, self.iteration, self.log = assembly, iteration, log
        self.outer = iteration.outer
        self.iterations = 0
        self._legs = scene.legs
        self._shown = most_loaded(scene.history.values(), self._legs)  # by report and pictures
        self._steps = scene.time.steps
        self._tolerance = scene.time.tolerance or math.inf
        self._cycle = scene.time.cycle
        self._in_cycle = range(0)  # the legs of the cycle
        if self._cycle:
            ends = self._cycle.begin, self._cycle.to
            self._in_cycle = range(*(self._legs.index(end) + 1 if end else 0 for end in ends))
        self._began = np.zeros(
            assembly.space.size
        )  # forces at the beginning of the present cycle (N)
        self._plans: dict[
            str, tuple[float, ...]
        ] = {}  # the ends of steps in the first cycle, by leg
        self._safe: bool | None = None
        self._largest = np.zeros(2)  # forces and slip bounds so far (N)
        self._cuts = 0
        factors = [scene.factors(time) for time in (0.0, *self._legs)]
        for body in assembly.bodies:  # forces are compared with the largest loads of all legs
            body.member.elasticity = body.member.elasticity.largest(factors)
        self._leanly = lean_steps(assembly)
        assembly.act(0.0)
        self._sudden = assembly.space.any(
            assembly.joint.d + assembly.space.opening
        )  # loads act at time 0
        self._chain = Chain(assembly, scene.output.derivatives)
        self._now = self._before = Mark.first(assembly, self._chain.first())
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
                again = self._again()
                if self._leg == len(self._legs) - 1 and not again:
                    break
                if solution.displacements:
                    doubts = doubt_answer(self.assembly, solution, self._leg != self._shown)
                    loose = undetermined_motions(self.assembly, solution.states)[:NAMED]
                    self.log.doubt(time, [*doubts, *loose])
                self._next_leg(again)
        self.log.doubt(self._now.time, self._too_long())
        worst = self.log.judge(solution.certificate)
        return replace(solution, certificate=worst.told(self.assembly.world))

    def _step(self, time: float) -> Solution:
        """Solve the load step to `time`."""
        assembly, joint = self.assembly, self.assembly.joint
        over = [
            name
            for name, end in assembly.scene.tightened.items()
            if end <= self._drawn(self._now.time)
        ]
        joint.keep(over, self._now.alpha)
        self.iteration.hold(self._now.alpha)
        mechanism = self._mechanism(time)
        assembly.act(self._drawn(time))
        assembly.space.began(assembly.scene.factors(self._drawn(self._now.time)))
        self._d = joint.d
        span = self._now.time - self._before.time  # zero at a turning point, where _before is _now
        share = (time - self._now.time) / span if span else 0.0
        start = self._slip_begins(share)
        joint.d = joint.d - start
        self._begin(share, start)
        largest = self.log.most["sizes"]
        self.outer.nothing, self.outer.direct.steps = NOTHING * largest[0], self._now.time > 0.0
        before = self._now.s
        since = start, lambda interface, part, s: before[part], self._now.slid
        solution = self.iteration.solve(mechanism, since, largest, self._lean)
        return replace(solution, time=time)

    def _lean(self) -> bool:
        """Whether nobody asks for the displacements of the present step.

        Of cycles they are asked for at the ends of legs in the first and in the last one, as far as it is known to be
        the last, and at the end of the last one. Collective.
        """
        if not self._leanly or len(self._ahead) > self._leanly:
            return bool(self._leanly)
        return (
            self._leanly == 1
            and self._cycle is not None
            and self._repeated
            and (self._leg < self._in_cycle.stop - 1 or not self._steady())
            and self.log.run < self._cycle.repeat
        )

    @property
    def _repeated(self) -> bool:
        """Whether the present leg was run before, in the cycle before."""
        return self.log.run > 1 and self._leg in self._in_cycle

    def _steady(self) -> bool:
        """Whether the forces that are found end the cycles, as they are those at the cycle's beginning. Collective."""
        assert self._cycle
        space, s = self.assembly.space, self.outer.forces
        change, largest = (space.largest(space.at_nodes(x)) for x in (s - self._began, s))
        self.log.change = change / largest if largest else 0.0
        return self.log.change < (self._cycle.until or 0.0)

    def _again(self) -> bool:
        """Whether a cycle ends here, and the next one begins. Collective."""
        if self._cycle is None or self._leg != self._in_cycle.stop - 1:
            return False
        steady = self._steady()
        log.info(
            "cycle %d to time %g: forces at its end changed by %.2g of the largest",
            self.log.run,
            self._now.time,
            self.log.change,
        )
        return not steady and self.log.run < self._cycle.repeat

    @property
    def _shift(self) -> float:
        """By how much the present leg is later than in the scene."""
        return (
            (self.log.run - 1) * self._cycle.span
            if self._cycle and self._leg >= self._in_cycle.start
            else 0.0
        )

    def _drawn(self, time: float) -> float:
        """The time in the scene's histories."""
        return self.assembly.scene.drawn(time, self.log.run)

    def _begin(self, share: float, start: np.ndarray) -> None:
        """Begin to iterate for a step whose slip begins at `start` (size,).

        The step is a `share` of the one before, zero at a turning point. There, and after a cut, nothing can be
        extrapolated.
        """
        now, before, joint = self._now, self._before, self.assembly.joint
        self.iteration.begin()
        if now.time == 0.0:
            self.outer.begin()
        elif share and not self._cuts:
            s, closed, alpha = (
                new + share * (new - old)
                for new, old in (
                    (now.s, before.s),
                    (now.closed, before.closed),
                    (now.alpha, before.alpha),
                )
            )
            joint.take(s)  # loads are linear along a leg
            self.outer.begin((s, start - closed + joint.D * s + joint.offset, alpha), foreseen=True)
        else:
            joint.take(now.s)
            gaps = now.d - self._d - now.closed + joint.D * now.s + joint.offset
            self.outer.begin((now.s, gaps + start, now.alpha))

    def _slip_begins(self, share: float) -> np.ndarray:
        """Where the slip of the next step, a `share` of the one before, begins (size,) (m)."""
        s, closed = self._now.s, self._now.closed
        gain = closed - self._before.closed
        starts = [
            slip_start(interface.law, s[part], closed[part], gain[part], share)
            for interface, part in self.assembly.space.with_slices()
        ]
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
            assembly.act(self._drawn(at))
            return beyond_meshes(assembly, self.iteration.held, look_for_mechanism(assembly))

        if any(contact.rubbing[1] for contact in assembly.scene.contact):
            return look(time)  # loads that can be balanced now are not those of the leg's ends
        if self._safe is None:  # all legs but the first begin at a solved step
            self._safe = self._repeated or (
                (self._leg > 0 or look(0.0) is None) and look(self._end) is None
            )
        return None if self._safe else look(time)

    def _accept(self, time: float, solution: Solution) -> None:
        """Note the step to `time`, whose solution is certified."""
        world, before, scene = self.assembly.world, self._now, self.assembly.scene
        contacts = solution.contacts.values()
        rubbed, closed = world.bcast(
            [sum(getattr(each, what) for each in contacts) for what in ("dissipated", "closed")]
        )
        self._now = now = self._marked(time, solution, closed)
        self._note_energy(now, before, rubbed, *self._worked(solution, now, before))
        self.log.note_step(time, solution)
        self.log.judge(solution.certificate)
        drawn = self._drawn(time)
        derived = self._chain.advance(time, self.outer, solution, before, self._before, drawn)
        if len(self._ahead) == 1:  # the end of a leg
            self.log.derive(*self._chain.entries(drawn, derived, solution))
        self._now = replace(now, derived=derived)
        self._before = self._now if self._sudden and before.time == 0.0 else before
        del self._ahead[0]
        if not self._ahead or scene.output.steps == "all":
            self.log.kept.append(
                (time, now.s, now.alpha, *map(leg_values, solution.states.values()))
            )
        log.log(
            logging.DEBUG if self._repeated else logging.INFO,
            "time %-10.6g %14s%s",
            time,
            counted(len(self.outer.history), "iteration"),
            f"; {count(contact.resultants for contact in contacts)} nodes" * bool(contacts),
        )
        self._leave()
        self._cuts = 0

    def _marked(self, time: float, solution: Solution, closed: float) -> Mark:
        """The end of the step to `time`, with so much of the contacts closed."""
        factors = self._drives(time)
        return Mark(
            time,
            self.outer.forces,
            self.outer.motions,
            self._d,
            solution.moved,
            self.assembly.space.opening,
            solution.prescribed,
            np.array(list(factors.values())),
            solution.work,
            solution.energy,
            closed,
            {
                name: state.slip_total
                for name, state in solution.states.items()
                if state.interface.law.frictionless
            },
            memory=self._remember(solution),
        )

    def _note_energy(
        self, now: Mark, before: Mark, rubbed: float, work: float, taken: float
    ) -> None:
        """Note the line of energy.csv of a step: external `work`, what contacts have `taken`, and what friction dissipates,
        `rubbed` (J)."""
        space = self.assembly.space
        if before.time == 0.0:
            self._given = now.given(before, space)
        lost = work - (now.energy - before.energy) - taken  # ΔW − ΔU − ΔI, zero but for rounding
        soft = self.assembly.joint.soft
        stored = space.stored(now.s) if soft else 0.0
        taken -= stored - space.stored(before.s) if soft else 0.0
        _, worked, _, took, lately, _ = self.log.energies[-1] if self.log.energies else np.zeros(6)
        self.log.energies.append(
            [now.time, worked + work, now.energy + stored, took + taken, lately + rubbed, lost]
        )

    def _leave(self) -> None:
        """Count the iterations of a step that is over."""
        self.iterations += len(self.outer.history)
        self.outer.history = []

    def _cut(self, solution: Solution, time: float) -> bool:
        """Whether to try again in a step half as long, after the step to `time` has failed."""
        half = (self._now.time + time) / 2
        # shorter steps cure neither loads without equilibrium nor solves that -body_ksp_rtol makes too coarse, nor loads that
        # act at once, from the drawing on
        if (
            solution.mechanism
            or (self._now.time == 0.0 and self._drives(half) == self._drives(time))
            or solution.stopped not in CURABLE
            or self._cuts == CUTS
            or (solution.given and solution.unbalanced)
            or time - self._now.time < 1.5 * self._shortest
        ):
            return False
        self._cuts += 1
        self._ahead.insert(0, half)
        log.info("no certified answer at time %g (%s); the step is halved", time, solution.reason)
        self._leave()
        return True

    def _drives(self, time: float) -> dict[str | None, float]:
        """The factors of all histories at a time of the run."""
        return self.assembly.scene.factors(self._drawn(time))

    def _next_leg(self, again: bool = False) -> None:
        """Begin the next leg, or the cycle `again`."""
        if self._leg in self._in_cycle:
            self._plans.setdefault(
                str(self._leg), tuple(np.subtract(self._planned, self._shift).tolist())
            )
        self._leg = self._in_cycle.start if again else self._leg + 1
        if self._cycle and self._leg == self._in_cycle.start:
            self.log.begin_cycle(self._cycle.begin)
            self._began = self._now.s
        if self._cycle:
            self.log.cycle = self.log.run if self._leg in self._in_cycle else 0
        self._base = self._before = self._coarse = (
            self._now
        )  # the last: the leg's end in half as many steps
        self._noted = {} if self._steps or self._repeated else self.log.state()
        self._safe = None
        self._changed = math.nan
        self._number = self._steps or 1
        self._ahead = self._times()

    def _times(self, length: float = 0.0, closing: bool = False) -> list[float]:
        """The times of the steps of the present leg.

        They are equal in the growth of the contact where the leg's end has a larger closed `length`, whose square is
        taken as linear in the loads, as for a circle on a plane (Hertz). Where gaps are `closing`, the first step is
        divided.
        """
        if self._repeated:  # in the steps of the first cycle, so that only slip makes a difference
            ahead = [time + self._shift for time in self._plans[str(self._leg)]]
            return self._plan([*ahead[:-1], self._end])
        start, end = self._base.time, self._end
        x, first = np.arange(1, self._number) / self._number, self._base.length
        # length² = first² + t (length² − first²), solved for the times t at which the length has grown by the shares x
        if length > first:
            x = x * (2.0 * first + x * (length - first)) / (length + first)  # also by rounding
        if closing:
            x = np.insert(x, 0, SHORT * x[0])
        return self._plan([*(start + x * (end - start)).tolist(), end])

    @property
    def _end(self) -> float:
        """The time at which the present leg ends."""
        return self._legs[self._leg] + self._shift

    def _plan(self, times: list[float]) -> list[float]:
        self._planned = tuple(times)
        self._shortest = 0.5**CUTS * float(np.diff([self._base.time, *times]).min())
        return times

    def _refine(self) -> bool:
        """Whether to solve the leg once more in twice as many steps, now that its end is reached."""
        space, s = self.assembly.space, self._now.s
        if self._steps or self._repeated or not space.any(np.array([len(self._frictional)])):
            return False  # without friction there is no memory
        size = space.norm(s)
        # tangential forces are compared with slip bounds: with little friction they are small beside all forces
        bound = space.norm(np.minimum(space.laws.bound_at(s), size))
        self._largest = np.maximum(self._largest, [size, min(bound, size)])
        if self._number > 1 and self._largest.all() and self._agree():
            return False
        if 2 * self._number > MOST or not self._largest.all():
            if self._largest.all():
                self.log.doubt(self._end, [self._missed()])
            return False
        # nodes that were open and now carry force: their gaps close within the leg
        closing = self._closing(s)
        self._coarse, self._number = self._now, 2 * self._number
        length, self._now, self._before = self._now.length, self._base, self._base
        self.log.restore(self._noted)
        self._ahead = self._times(length, closing)
        return True

    def _missed(self) -> Doubt:
        """What the most load steps of a leg do not resolve."""
        least, off = ROLLED * self._tolerance, self._changed
        missed = (
            f"time.tolerance: forces miss it in {self._number} load steps; doubling changed them by "
            f"{off:.2g}"
        )
        if off <= self._tolerance and (short := self._too_short()) > least:
            off = short
            missed = (
                f"time.tolerance: sides turn so far past each other in each of {self._number} load steps that wheels "
                f"roll by {short:.2g} of their way too little"
            )
        return Doubt(missed, "time.tolerance", off)

    def _agree(self) -> bool:
        """Whether half as many steps lead to the same forces at the end of the leg, which is noted."""
        change = self._now.change_since(
            self._forces(self._coarse), self._largest, self.assembly.space
        )
        # where changes fall by r = former / change with each doubling, those to come add up to change / (r − 1)
        faster = self._changed / change - 1.0 if change else math.inf
        before, self._changed = self._changed, change
        close = change <= self._tolerance * (
            1.0 if math.isnan(before) else min(max(faster, CERTAIN), 1.0)
        )
        # forces may agree by chance while slip is coarse: friction then dissipates more than contacts took
        given = self._given if self._base.time == 0.0 else 0.0
        enough = close and self.log.excess(self._noted, given) <= self._tolerance
        words = "but friction dissipates more than contacts take" if close else "not enough"
        if enough and self._too_short() > ROLLED * self._tolerance:
            enough, words = False, "but sides turn far past each other in a step"
        log.info(
            "time %g reached: %d and %d steps agree to %.2g, %s",
            self._end,
            self._number // 2,
            self._number,
            change,
            "accepted" if enough else words,
        )
        return enough

    def _too_long(self) -> list[str]:
        """A warning where energies show that given steps are too long. Collective."""
        rubs = self.assembly.space.any(np.array([len(self._frictional)]))
        excess = self.log.excess({"energies": ()}, self._given) if self._steps and rubs else 0.0
        if excess <= EXCESS:
            return []
        words = (
            f"energy: friction dissipates more than contacts take, by {100.0 * excess:.2g} % of what it dissipates, or of a "
            "tenth of the largest energy if that is more: load steps are too long for energies to be true; give more than "
            f"steps = {self._steps}, or leave steps out"
        )
        return [Doubt(words, "energy", excess)]

    def _too_short(self) -> float:
        """The part of their way by which wheels roll too little, as their steps turn them by an angle. Collective."""
        return 0.0

    @property
    def _frictional(self) -> list[slice]:
        """Of this rank's contacts with friction the parts of vectors with the normal components."""
        return [
            slice(part.start, part.start + interface.m)
            for interface, part in self.assembly.space.with_slices()
            if len(interface.sliding) and interface.law.name != "bonded"
        ]

    def _closing(self, s: np.ndarray) -> bool:
        """Whether nodes with friction carry forces `s` that were open where the leg began. Collective."""
        space, base = self.assembly.space, self._base
        return space.any(
            np.array(
                [
                    (
                        (s[normal] > 0.0) & (base.s[normal] <= 0.0) & (base.closed[normal] < 0.0)
                    ).any()
                    for normal in self._frictional
                ]
            )
        )

    def _forces(self, mark: Mark) -> np.ndarray:
        """The forces (size,) of a mark on the rows of now (N)."""
        return mark.s

    def _worked(self, solution: Solution, now: Mark, before: Mark) -> tuple[float, float]:
        """External work, and that of contact forces (J), of a step. Collective."""
        return now.work_since(before, self.assembly.space)

    def _remember(self, solution: Solution) -> Any:
        """What the next step needs of this one, where bodies move far."""
        return {}

    def _recalled(self, state: dict[str, Any]) -> Mark:
        """A mark as it comes out of a checkpoint."""
        return Mark(**state)

    def state(self) -> dict[str, Any]:
        return (
            {name: getattr(self, name) for name in KEPT}
            | {name: asdict(getattr(self, name)) for name in MARKS}
            | {"ahead": tuple(self._ahead), "log": self.log.state()}
            | {"released": self.iteration.released}
        )

    def restore(self, state: dict[str, Any]) -> None:
        """Go on with the first of the steps that lie ahead in `state`."""
        vars(self).update(
            {name: state[name] for name in KEPT}
            | {name: self._recalled(state[name]) for name in MARKS}
        )
        self._ahead, self._safe = list(state["ahead"]), None
        if state["released"]:
            self.iteration.release()
        self.log.restore(state["log"])
