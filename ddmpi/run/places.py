"""Load steps of bodies that move far: each body is factored once in its frame, and meets others where it is.

A step places the frames, pairs the contact sides there, makes W C Wᵀ of the rows W that join contact nodes now, and
solves today's problem once. Strains are small in each frame: a material point X of a body is at c + Q (X + u).

Frames that are free take the rigid motions α of the solution, and the pass repeats until α is nothing. The loads that
move along, K α, are in the equations, so that each pass is a step of Newton's method for the frames.

Friction has no memory on rows, which come and go. What stays of a step are frames and displacements. The slip of a row
is the relative place of the material points that it joins now, less that of the same points a step before, both seen
from the second body's frame. So it does not depend on the pairing, nor on a motion of both bodies together.
"""

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.coupling.far import Placement
from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.mortar import meet
from ddmpi.interface.state import Rows, forces_by_node, rows_of, values_by_node
from ddmpi.judge.motions import RESISTED
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import no_report
from ddmpi.run.frames import began, instability, partners_gone, way_down
from ddmpi.run.gather import StepLog
from ddmpi.run.held import LEVERS, driven_turns
from ddmpi.run.marks import Mark
from ddmpi.run.passes import FARTHEST, NEAR, SETTLED, Group, Passes, groups_of
from ddmpi.run.recover import NOTHING
from ddmpi.run.solve import Iteration, Solution
from ddmpi.run.steps import March
from ddmpi.scene.contacts import Coulomb, SettledContact
from ddmpi.scene.motions import Freed, frames_of, parts_of
from ddmpi.scene.scene import Settled
from ddmpi.surface.cover import DEEPEST
from ddmpi.surface.side import Side
from ddmpi.system.agreement import agreed
from ddmpi.system.numbers import SAME, Frame, norm

log = logging.getLogger("ddmpi")

TOLD = 10  # of so many passes of a step one is told
MOST = 64  # most places on the way of a step at which a body is looked for in its partner


@dataclass(frozen=True)
class Memory:
    """What a step leaves for the next.

    Attributes
    ----------
    time, freed : its end, and how far free frames had gone then
    displacements : (nv, d) of this rank's bodies in their frames (m)
    acting : (2, nv, d) on their nodes, in their frames: loads, and contact forces (N)
    contacts : by contact that this rank owns the arrays of `rows_of`
    moved : how far bodies have moved along the normals of nodes at most (m), by contact of this rank's bodies
    """

    time: float
    freed: Freed
    displacements: Mapping[str, np.ndarray]
    acting: Mapping[str, np.ndarray]
    contacts: Rows
    moved: Mapping[str, float]

    def frames(self, scene: Settled) -> Mapping[str, Frame]:
        """Where the frames of bodies and rigid partners were then."""
        return frames_of(scene, self.time, self.freed)

    def forces_at(self, interface: Interface, part: slice, s: np.ndarray) -> np.ndarray:
        """The forces (size,) of the step before where those of now are `s` (N): the same, with its sum of slip bounds.

        Rows stand at nodes that a contact runs over, so that none of them has a history; of a contact's friction as a
        whole the work ½ (Σ g_n + Σ g_n−1) |u_t| is that of constant pressures and of those that grow alike.
        """
        rows, now = self.contacts.get(interface.name), float(interface.law.bound_at(s).sum())
        return s * (float(rows["bound"][0]) / now if rows and now else 0.0)


class FarMarch(March):
    """The load steps of bodies that move far. Everything is collective."""

    def __init__(self, assembly: Assembly, iteration: Iteration, log: StepLog) -> None:
        still = np.zeros({2: 3, 3: 6}[assembly.scene.dimension])
        first = Memory(0.0, dict.fromkeys(assembly.free, still), {}, {}, {}, _deepest(assembly))
        self._whole = frozenset[str]()  # contacts of which no rows are left out in this step
        self._still = first.freed  # where held motions stay
        self._levers = True  # whether moments of loads change as frames move
        super().__init__(assembly, iteration, log)
        _tell_slight(assembly)
        self._now = self._before = self._base = self._coarse = replace(self._now, memory=first)

    def _step(self, time: float) -> Solution:
        """Solve the load step to `time`; once more, with all rows, where one that was left out as open is not."""
        solution = self._settle(time)
        missed = {
            name
            for name, state in solution.states.items()
            if (state.between[len(state.between) - state.interface.probes.beyond :] < 0.0).any()
        }
        missed = set().union(*self.assembly.world.allgather(missed))
        self._whole = self._whole | missed if missed else frozenset()
        if not missed:
            return solution
        log.info(
            "time %g: more of %s closes than expected; once more with all nodes",
            time,
            ", ".join(sorted(missed)),
        )
        self._leave()
        return self._step(time)

    def _settle(self, time: float) -> Solution:
        """Place the bodies at `time`, and solve, until free frames have settled."""
        memory, free = self._now.memory, self.assembly.free
        passes = Passes(groups_of(self.assembly))
        self._still = memory.freed
        start, stopped = self._passes(time, passes)
        since = start, memory.forces_at, self._now.slid
        largest = self.log.most["sizes"]
        if stopped == "unsettled":
            solution = self.iteration.conclude(stopped, since, largest)
        else:
            solution = self.iteration.solve(None, since, largest)
            if free and solution.stopped == "stalled":
                solution = replace(solution, stopped="unsettled")
        passes.join(self.outer, self.iteration.statuses)
        if stopped == "converged":
            _refuse_passing(self.assembly, memory)
            if free and len(self._ahead) == 1 and not solution.mechanism:  # the end of a leg
                self.log.doubt(time, instability(self.assembly, self.outer, passes.groups))
        self._count()
        self._number_of_passes = passes.number
        states = {
            name: replace(state, before=values_by_node(state.interface, memory.contacts, "slip"))
            for name, state in solution.states.items()
        }
        partners = partners_gone(self.assembly)
        contacts = {
            name: total._replace(rigid=partners.get(total.bodies[1], total.rigid))
            for name, total in solution.contacts.items()
        }
        return replace(solution, time=time, states=states, contacts=contacts)

    def _passes(self, time: float, passes: Passes) -> tuple[np.ndarray, str]:
        """Place the bodies, and where frames are free find forces, until the frames have settled. Where slip begins
        (size,) in m in the last pass, and why it is the last: "converged", "unsettled", or the end of Newton's method.
        """
        rows = self._now.memory.contacts
        carried = _carried(self.assembly.scene, self._now.memory, time, passes.groups)
        start = self._place(time, {**self._ahead_of(time), **carried}, rows)
        if not self.assembly.free:
            return start, "converged"
        if carried and (back := self._back_to_still(self.assembly.placement.freed)).any():
            # what nothing resists does not go along, and takes lever arms of loads with it
            start = self._place(time, self._gone(back), rows)
        if (fall := way_down(self.assembly, passes.groups)).any():
            start = self._place(time, self._gone(fall), rows)
        while True:
            stopped, far_off, sizes = self._pass(time, passes, rows)
            if stopped != "converged":
                return start, stopped
            settled, near = far_off <= SETTLED * norm(sizes), far_off <= NEAR * sizes
            driven = self._driven(passes.groups, settled)
            if self._levers and settled.all() and not driven.any():
                return start, stopped
            step, useless = passes.next(self.outer.motions, driven, far_off, settled, near)
            if useless:
                return start, "unsettled"
            freed = self._gone(step)
            self._note_driven(freed, driven, passes.groups)
            rows = {
                interface.name: forces_by_node(interface, self.outer.forces[part])
                for interface, part in self.assembly.space.with_slices()
            }
            passes.went(self.outer, self.iteration.statuses)
            self._count()
            start = self._place(time, freed, rows, again=True)

    def _pass(self, time: float, passes: Passes, rows: Rows) -> tuple[str, np.ndarray, np.ndarray]:
        """Find forces where the bodies are, which began with those of `rows`: the end of Newton's method, and how far its
        motions move the contacts of each group (groups,) and its forces do (m). Collective."""
        clock, tolerance = self.iteration.clock, self.iteration.method.tolerance
        with clock.phase("outer"):
            stopped = self.outer.run(tolerance)
        if stopped != "converged" and passes.number == 1 and self.assembly.joint.K.nnz:
            # what slides by its own length takes lever arms of loads along, but also those of contact forces
            passes.went(self.outer, self.iteration.statuses)
            self._count()
            self._place(time, self.assembly.placement.freed, rows, levers=False)
            with clock.phase("outer"):
                stopped = self.outer.run(tolerance)
        space, joint, groups = self.assembly.space, self.assembly.joint, passes.groups
        moved = joint.rigid.spread(self.outer.motions)
        given = joint.product(self.outer.forces, "newton")
        own = [space.spread([group.owns(each) for each in space.interfaces]) for group in groups]
        norms = space.norms([x * entries for x in (moved, given) for entries in own])
        far_off, sizes = np.reshape(norms, (2, len(groups)))
        log.log(
            logging.DEBUG if passes.number % TOLD else logging.INFO,
            "time %g, pass %d: bodies are moved by %.1e %s more, contact forces move them by %.1e",
            time,
            passes.number,
            norm(far_off),
            self.assembly.scene.units["length"],
            norm(sizes),
        )
        return stopped, far_off, sizes

    def _note_driven(self, freed: Freed, driven: np.ndarray, groups: Sequence[Group]) -> None:
        """Hold motions from now on where loads have driven them."""
        for group in groups:
            if driven[group.at].any():
                self._still = {**self._still, **{name: freed[name] for name in group.free}}

    def _driven(self, groups: Sequence[Group], settled: np.ndarray) -> np.ndarray:
        """The motions (rigid.size,) along which loads drive held turns of groups that have `settled`, by more than
        normals are off, as far as frames turn in a pass: a weight beside an axis does, until it hangs below.
        Collective."""
        held = self.iteration.held
        asked = [
            group.at
            for group, done in zip(groups, settled, strict=True)
            if done and group.on_its_way and held.basis[group.at].any()
        ]
        if not asked:
            return np.zeros(len(held.basis))
        return np.radians(FARTHEST) * driven_turns(self.assembly, held, self.outer, asked)

    def _accept(self, time: float, solution: Solution) -> None:
        super()._accept(time, solution)
        self.log.places[time] = self.assembly.placement
        if self.assembly.free:
            self.log.steps[-1]["passes"] = self._number_of_passes

    def _place(
        self, time: float, freed: Freed, rows: Rows, again: bool = False, levers: bool = True
    ) -> np.ndarray:
        """Have the bodies meet where their frames are at `time`, and begin with the forces of `rows`; where slip begins
        (size,) (m). Without `levers` moments of loads do not change as frames move."""
        clock, memory, scene = self.iteration.clock, self._now.memory, self.assembly.scene
        then, frames = memory.frames(scene), frames_of(scene, time, freed)
        reach = _reaches(self.assembly, memory, self._whole, frames)
        with clock.phase("assemble"):
            self.assembly = assembly = self.assembly.meet(Placement(time, freed, frames, reach))
        starts = []
        for body in assembly.bodies:
            name = body.spec.name
            u = memory.displacements.get(name, 0.0)
            starts.append(body.member.begin(began(assembly, name, body.mesh.points, u, then)))
        start = assembly.exchange.total(starts, "slip")
        self._now = _seen_now(self._now, assembly, memory, start)
        sliding = start.copy()
        for interface, part in assembly.space.with_slices():
            sliding[part][: interface.m] = 0.0
        joint = assembly.joint
        self._d = joint.d = joint.d - sliding
        self._levers, joint.K = levers, joint.K if levers else 0.0 * joint.K
        self.iteration = Iteration(assembly, self.iteration.method, no_report, clock, RESISTED)
        self.iteration.hold(self._back_to_still(freed))
        outer = self.iteration.outer
        assert isinstance(outer, Newton)
        self.outer = outer
        s, largest = assembly.space.laws.project(_forces_of(assembly, rows)), self.log.most["sizes"]
        if assembly.space.any(s):
            outer.begin(
                (
                    s,
                    joint.product(s, "newton") + joint.offset - joint.d,
                    np.zeros(joint.rigid.size),
                ),
                foreseen=again,
            )
        outer.nothing, outer.direct.steps = NOTHING * largest[0], True
        return sliding

    def _back_to_still(self, freed: Freed) -> np.ndarray:
        """The motions (rigid.size,) that take what nothing determines from `freed` to where it was a step before, or loads
        have driven it since: turns by the angle, whatever a body has moved, others by its way."""
        held, assembly, before = self.iteration.held.span, self.assembly, self._still
        gone, turns = np.zeros(len(held)), np.ones(len(held), bool)
        if not held.size:
            return gone
        for name, frame in assembly.free.items():
            at = assembly.joint.slices[name]
            gone[at] = frame.since(before[name], freed[name])
            turns[at][: len(frame.axes)] = False
        return held @ put_back(held, gone, turns)

    def _count(self) -> None:
        """Have later passes count products on."""
        for body in self.assembly.bodies:
            body.member.body.C.count = body.member.C.count

    def _ahead_of(self, time: float) -> Freed:
        """Where free frames are looked for first: as far as they have gone, and on as in the step before."""
        now, before = self._now.memory, self._before.memory
        span = now.time - before.time
        share = (time - now.time) / span if span and not self._cuts else 0.0
        return _onwards(self.assembly, now, (before.freed, now.freed), share)

    def _gone(self, alpha: np.ndarray) -> Freed:
        """How far free frames have gone after the motions α (rigid.size,)."""
        assembly = self.assembly
        return {
            name: assembly.free[name].gone(
                gone, assembly.frames[name], alpha[assembly.joint.slices[name]]
            )
            for name, gone in assembly.placement.freed.items()
        }

    def _forces(self, mark: Mark) -> np.ndarray:
        return _forces_of(
            self.assembly, mark.memory.contacts
        )  # attempts may have paired other rows at the leg's end

    def _remember(self, solution: Solution) -> Memory:
        assert solution.time is not None
        return Memory(
            solution.time,
            self.assembly.placement.freed,
            solution.displacements,
            {
                body.spec.name: np.stack(
                    [body.member.elasticity.acting.f, body.member.pull(forces)]
                )
                for body, forces in zip(self.assembly.bodies, self.outer.body_forces(), strict=True)
            },
            {name: rows_of(state) for name, state in solution.states.items()},
            {name: total.moved for name, total in solution.contacts.items()},
        )

    def _worked(self, solution: Solution, now: Mark, before: Mark) -> tuple[float, float]:
        """External work, and that of contact forces, by the forces at both ends of the step over the ways of the material
        points on which they act there: whatever rows enter or leave."""
        memory, joules, factors = before.memory, np.zeros(2), now.factors - before.factors
        for name, u in now.memory.displacements.items():
            then = memory.acting.get(name, 0.0), memory.displacements.get(name, 0.0)
            joules += 0.5 * ((now.memory.acting[name] + then[0]) * (u - then[1])).sum(axis=(1, 2))
        loads, contacts = np.sum(self.assembly.world.allgather(joules), axis=0)
        clamps = 0.5 * factors @ (now.work[1] + before.work[1])
        frames = self._by_frames(solution, memory)
        return float(loads + clamps) + frames, frames - float(contacts)

    def _by_frames(self, solution: Solution, memory: Memory) -> float:
        """Work of the motions of frames (J): clamps and loads balance what contact forces do to bodies that move."""
        joules = 0.0
        then, now = memory.frames(self.assembly.scene), self.assembly.frames
        for name, state in solution.states.items():
            # the mean of the forces at both ends, each over the way of the place at which it acts
            ends = [(rows_of(state), 1.0), (memory.contacts.get(name), -1.0)]
            for side, body in enumerate(state.interface.bodies):
                step = now[body].after(then[body].undone)
                for rows, sign in ends:
                    if rows:
                        at = rows[("first", "second")[side]]
                        way = step if sign < 0.0 else step.undone
                        moved = float(((way.at(at) - at) * rows["forces"]).sum())
                        joules += 0.5 * sign * (1.0, -1.0)[side] * moved
        return float(self.assembly.space.add(np.array([joules]))[0])

    def _too_short(self) -> float:
        """The part by which what sticks at the end of a step of this leg, in which sides turn past each other by the angle
        θ, has moved less than θ of a radius: by sin θ. Collective."""
        scene, log, most = self.assembly.scene, self.log, 0.0
        bodies = {contact.name: contact.bodies for contact in scene.contact}
        now = self._base.memory.frames(scene)
        for step in log.steps:
            if step["time"] > self._base.time:
                then, now = now, log.places[step["time"]].frames
                for name, contact in step["contacts"].items():
                    first, second = (now[body].after(then[body].undone) for body in bodies[name])
                    most = max(most, bool(contact["stick"]) * norm(first.after(second.undone).turn))
        # the first rank alone knows what all contacts do
        return self.assembly.world.bcast(float(np.radians(most)) ** 2 / 6.0)

    def _closing(self, s: np.ndarray) -> bool:
        """Nothing is known of gaps that close: rows are those of one step."""
        return False

    def state(self) -> dict[str, Any]:
        places = {
            repr(time): {"freed": dict(place.freed), "reach": dict(place.reach)}
            for time, place in self.log.places.items()
        }
        return super().state() | {"places": places}

    def _recalled(self, state: dict[str, Any]) -> Mark:
        return Mark(**state | {"memory": Memory(**state["memory"])})

    def restore(self, state: dict[str, Any]) -> None:
        super().restore(state)
        for time, place in state["places"].items():
            frames = frames_of(self.assembly.scene, float(time), place["freed"])
            self.log.places[float(time)] = Placement(float(time), frames=frames, **place)


def _onwards(
    assembly: Assembly, memory: Memory, ends: tuple[Freed, Freed], share: float
) -> dict[str, np.ndarray]:
    """How far free frames have gone at the end of a step, and on by a share of the motions between two `ends`: about
    their pivots, so that the origin does not matter."""
    frames, gone = memory.frames(assembly.scene), {}
    for name, far in memory.freed.items():
        free = assembly.free[name]
        motions = free.since(ends[0][name], ends[1][name])
        gone[name] = free.gone(far, frames[name], share * motions)
    return gone


def _carried(
    scene: Settled, memory: Memory, time: float, groups: Sequence[Group]
) -> dict[str, np.ndarray]:
    """How far loose bodies have gone at `time` that lie on such as shift alike since a step before, if they go along."""
    then, now = (frames_of(scene, at, memory.freed) for at in (memory.time, time))
    moving = {each.name for each in (*scene.body, *scene.rigid) if parts_of(each.motion)}
    carried = dict[str, np.ndarray]()
    for group in groups:
        own = group.free.keys()
        pairs = [{*each.bodies} for each in scene.contact]
        beside = set().union(*(pair for pair in pairs if pair & own)) - own
        steps = [now[name].after(then[name].undone) for name in sorted(beside & moving)]
        if moving & own or not steps or beside - moving:
            continue
        shifts, turned = (
            np.array([getattr(step, of) for step in steps]) for of in Frame._fields[:2]
        )
        alike = np.ptp(shifts, axis=0).max() <= SAME * np.abs(shifts).max()
        if alike and np.abs(turned - np.eye(scene.dimension)).max() <= SAME:
            shift = np.append(shifts[0], np.zeros(len(memory.freed[min(own)]) - len(shifts[0])))
            carried |= {name: memory.freed[name] + shift for name in own}
    return carried


def _tell_slight(assembly: Assembly) -> None:
    """Tell of contacts of free bodies whose friction is less than errors of normals."""
    for contact in assembly.scene.contact:
        mu = contact.rubbing[0] if isinstance(contact.friction, Coulomb) else 0.0
        slight = isinstance(mu, float) and 0.0 < mu <= RESISTED
        if slight and not assembly.free.keys().isdisjoint(contact.bodies):
            log.info(
                "contact.%s: friction %g resists less than facets may, %g: motions that it alone resists are held, as "
                "without friction",
                contact.name,
                mu,
                RESISTED,
            )


def put_back(held: np.ndarray, gone: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """The amplitudes (q,) of `held` motions (j, q), orthonormal columns, that undo how far these have `gone` (j,): those
    that turn bodies by their angles, entries `turns` (j,) bool, the others by their ways."""
    U, values, V = np.linalg.svd(held[turns])
    rank = int((values > LEVERS).sum())
    back = -V[:rank].T @ (U[:, :rank].T @ gone[turns] / values[:rank])
    way, rest = held[~turns], V[rank:].T
    left = gone[~turns] + way @ back
    return back - rest @ np.linalg.lstsq(way @ rest, left, rcond=None)[0]


def _deepest(assembly: Assembly) -> dict[str, float]:
    """The deepest overlap of the placed sides (m), by contact of this rank's bodies."""
    return {
        met.name: max(0.0, -float(met.opening.min(initial=0.0)))
        for body in assembly.bodies
        for met in body.member.interfaces
    }


def _refuse_passing(assembly: Assembly, memory: Memory) -> None:
    """InputError, on all ranks, where the motions run a body as drawn through another, where they are placed or on the way
    since a step before. Collective."""
    now, unit, scene = _deepest(assembly), assembly.scene.units["length"], assembly.scene
    time, ends = assembly.placement.time, (memory.freed, assembly.placement.freed)
    rigid = {each.name: each for each in scene.rigid}
    then = memory.frames(scene)
    here = assembly.frames
    with agreed(assembly.world):
        for contact in assembly.contacts:
            both = assembly.sides[contact.name]
            body, thin = min(
                ((side.body, float(side.extent.min())) for side in both if side),
                key=lambda each: each[1],
            )
            deepest = now[contact.name]
            if not deepest:  # apart: it may have passed
                places = min(MOST, 1 + int(4.0 * _way(contact, both[0], then, here) / thin))
                for share in np.linspace(0.0, 1.0, places)[1:-1]:
                    freed = _onwards(assembly, memory, ends, float(share))
                    frames = frames_of(
                        scene, memory.time + float(share) * (time - memory.time), freed
                    )
                    met = meet(contact, both, frames, rigid, (thin, 0.0))
                    deepest = max(deepest, -float(met.opening.min(initial=0.0)))
            if deepest > DEEPEST * thin:
                raise InputError(
                    f"contact.{contact.name}: motions take {contact.bodies[0]!r} and {contact.bodies[1]!r}, as "
                    f"drawn, into each other by {deepest:.3g} {unit} until time {time:g}, more than {DEEPEST:g} "
                    f"of the thickness of {body!r}: they would pass through each other, or bend by as much, "
                    "which is too far to find what touches"
                )


def _way(
    contact: SettledContact, side: Side, then: Mapping[str, Frame], now: Mapping[str, Frame]
) -> float:
    """How far the nodes of the first side move past the second body (m)."""
    first, second = contact.bodies
    old, new = (at[second].undone.after(at[first]).at(side.xy) for at in (then, now))
    return float(np.linalg.norm(new - old, axis=1).max())


def _reaches(
    assembly: Assembly, memory: Memory, whole: Collection[str], now: Mapping[str, Frame]
) -> dict[str, tuple[float, float]]:
    """By contact how deep overlaps may be in frames of `now` (m): as far as bodies moved along normals before, by the motion
    since then, and a facet; and how far they moved, endless where no rows are to be left out: in the first step, of
    `whole` contacts, and where frames are free."""
    then, reach = memory.frames(assembly.scene), {}
    for contact in assembly.contacts:
        side, moved = assembly.sides[contact.name][0], memory.moved[contact.name]
        endless = (
            not memory.time
            or contact.name in whole
            or not assembly.free.keys().isdisjoint(contact.bodies)
        )
        facet = float(side.lengths.max() ** (1.0 / (side.dimension - 1)))
        reach[contact.name] = (
            moved + _way(contact, side, then, now) + facet,
            np.inf if endless else moved,
        )
    return reach


def _seen_now(mark: Mark, assembly: Assembly, memory: Memory, start: np.ndarray) -> Mark:
    """The last step as the rows of now see it: its forces by slave nodes, and the places of what they join now."""
    space, zero = assembly.space, np.zeros(assembly.space.size)
    slid = {
        interface.name: np.zeros((interface.m, interface.dimension - 1))
        for interface in space.interfaces
        if interface.law.frictionless
    }
    return replace(
        mark,
        s=_forces_of(assembly, memory.contacts),
        moved=start,
        opening=space.opening,
        prescribed=zero,
        d=zero,
        slid=slid,
    )


def _forces_of(assembly: Assembly, rows: Rows) -> np.ndarray:
    """The forces (size,) of such rows at the slave nodes of the rows of now (N)."""
    s = np.zeros(assembly.space.size)
    for interface, part in assembly.space.with_slices():
        normal, tangential = (
            values_by_node(interface, rows, what) for what in ("normal", "tangential")
        )
        s[part] = np.concatenate([normal[:, 0], tangential[interface.sliding].ravel()])
    return s
