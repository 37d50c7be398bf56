"""Load steps of bodies that move far: each body is factored once in its frame, and meets others where it is.

A step places the frames, pairs the contact sides there, makes W C Wᵀ of the rows W that join contact nodes now, and
solves today's problem once. Strains are small in each frame: a material point X of a body is at c + Q (X + u).

Friction has no memory on rows, which come and go. What stays of a step are frames and displacements. The slip of a row
is the relative place of the material points that it joins now, less that of the same points a step before, both seen
from the second body's frame. So it does not depend on the pairing, nor on a motion of both bodies together.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.chain import Chain
from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.mortar import meet
from ddmpi.interface.state import ContactState
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import Report, no_report
from ddmpi.results.checkpoint import Checkpoints
from ddmpi.run.equilibrium import NOTHING, Mark
from ddmpi.run.gather import StepLog
from ddmpi.run.solve import Iteration, Solution, solve
from ddmpi.run.steps import MARKS, March
from ddmpi.scene.contacts import SettledContact
from ddmpi.scene.meshes import frames_of
from ddmpi.surface.cover import DEEPEST
from ddmpi.surface.side import Side
from ddmpi.system.agreement import agreed
from ddmpi.system.clock import Clock
from ddmpi.system.numbers import Frame

MOST = 64
"""Most places on the way of a step at which a body is looked for in its partner."""

MARGIN = 1.0
"""Overlaps are looked for as deep as those of the step before and the motion of this one, and this many facets."""


@dataclass(frozen=True)
class Memory:
    """What a step leaves for the next.

    Attributes
    ----------
    time : its end
    displacements : (nv, d) of this rank's bodies in their frames (m)
    contacts : by contact that this rank owns the arrays of `_rows_of`
    deepest : overlap of the sides without displacements (m), by contact of this rank's bodies
    """

    time: float
    displacements: Mapping[str, np.ndarray]
    contacts: Mapping[str, Mapping[str, np.ndarray]]
    deepest: Mapping[str, float]

    def forces_at(self, interface: Interface, part: slice, s: np.ndarray) -> np.ndarray:
        """The forces (size,) of the step before where those of now are `s` (N): the same, with its sum of slip bounds.

        Rows stand at nodes that a contact runs over, so that none of them has a history; of a contact's friction as a
        whole the work ½ (Σ g_n + Σ g_n−1) |u_t| is that of constant pressures and of those that grow alike.
        """
        rows, now = self.contacts.get(interface.name), float(interface.law.bound_at(s).sum())
        return s * (float(rows["bound"][0]) / now if rows and now else 0.0)


def _rows_of(state: ContactState) -> dict[str, np.ndarray]:
    """The rows of a contact as the next step needs them: their slave nodes; forces along the normal and the tangents
    (N); the slip so far (m); the forces on the first body, and where they act on both (N, m); the sum of bounds."""
    one, other = state.interface.at or np.zeros((2, 0, state.interface.dimension))
    law = state.interface.law
    s = np.concatenate([state.normal_force, state.tangential_force[law.sliding].ravel()])
    return {"node": _slave_nodes(state.interface), "normal": state.normal_force[:, None],
            "tangential": state.tangential_force, "slip": state.slip_total, "forces": state.forces, "first": one,
            "second": other, "bound": np.array([law.bound_at(s).sum()])}


class FarMarch(March):
    """The load steps of bodies that move far. Everything is collective."""

    def __init__(self, assembly: Assembly, iteration: Iteration, log: StepLog) -> None:
        self._first = Memory(0.0, {}, {}, _deepest(assembly))  # nothing but where the bodies are
        self._compared: Memory | None = None  # the last attempt at the present leg
        super().__init__(assembly, iteration, log)

    def _step(self, time: float) -> Solution:
        """Place the bodies at `time`, and solve."""
        memory, far, clock = self._memory(self._now), self.assembly.far, self.iteration.clock
        assert far
        frames = frames_of(self.assembly.scene, memory.time)
        far.reach[time] = _reaches(self.assembly, frames, memory.deepest, time)
        with clock.phase("assemble"):
            self.assembly = assembly = self.assembly.meet(time)
        _refuse_passing(assembly, memory.time, time)
        start = assembly.exchange.total([body.member.begin(_began(
            assembly, body.spec.name, body.mesh.points, memory.displacements.get(body.spec.name, 0.0), frames))
            for body in assembly.bodies], "slip")
        self._now = _seen_now(self._now, assembly, memory, start)
        sliding = start.copy()
        for interface, part in assembly.space.with_slices():
            sliding[part][:interface.m] = 0.0
        joint = assembly.joint
        self._d = joint.d = joint.d - sliding
        self.iteration = Iteration(assembly, self.iteration.method, no_report, clock)
        outer = self.iteration.outer
        assert isinstance(outer, Newton)
        self.outer = outer
        s, largest = assembly.space.laws.project(self._now.s), self.log.most["sizes"]
        if assembly.space.any(s):
            outer.begin((s, joint.product(s, "newton") - joint.d, np.zeros(0)))
        outer.nothing, outer.direct.steps = NOTHING * largest[0], True
        solution = self.iteration.solve(None, (sliding, memory.forces_at, self._now.slid), largest)
        for member, body in zip(far.members, assembly.bodies, strict=True):
            member.C.count = body.member.C.count
        states = {name: replace(state, before=_by_node(state.interface, memory, "slip"))
                  for name, state in solution.states.items()}
        return replace(solution, time=time, states=states)

    def _memory(self, mark: Mark) -> Memory:
        return mark.memory or self._first

    def _refine(self) -> bool:
        # attempts may have paired other rows at the end of the leg
        if self._coarse is not None and self._compared:
            self._coarse = _forces_of(self.assembly, self._compared)
        self._compared = self._memory(self._now)
        again = super()._refine()
        if not again:
            self._compared = None
        return again

    def _remember(self, solution: Solution) -> Memory:
        assert solution.time is not None
        return Memory(solution.time, solution.displacements, {
            name: _rows_of(state) for name, state in solution.states.items()}, _deepest(self.assembly))

    def _by_frames(self, solution: Solution, before: Mark) -> float:
        """Work of the motions of frames (J): clamps balance what contact forces do to bodies that move."""
        memory, joules = self._memory(before), 0.0
        then, now = (frames_of(self.assembly.scene, time) for time in (memory.time, solution.time or 0.0))
        for name, state in solution.states.items():
            for side, body in enumerate(state.interface.bodies):
                step = now[body].after(then[body].undone)
                # the mean of the forces at both ends, each over the way of the place at which it acts
                for rows, way, sign in ((_rows_of(state), step.undone, -1.0), (memory.contacts.get(name), step, 1.0)):
                    if rows:
                        at = rows[("first", "second")[side]]
                        joules -= 0.5 * sign * (1.0, -1.0)[side] * float(((way.at(at) - at) * rows["forces"]).sum())
        return float(self.assembly.space.add(np.array([joules]))[0])

    def _closing(self, s: np.ndarray) -> bool:
        """Nothing is known of gaps that close: rows are those of one step."""
        return False

    def state(self) -> dict[str, Any]:
        assert self.assembly.far
        reach = {repr(time): dict(depths) for time, depths in self.assembly.far.reach.items()}
        return super().state() | {"reach": reach}

    def restore(self, state: dict[str, Any]) -> None:
        super().restore(state)
        assert self.assembly.far
        self.assembly.far.reach.update({float(time): depths for time, depths in state["reach"].items()})
        for name in MARKS:
            mark = getattr(self, name)
            if mark.memory:
                setattr(self, name, replace(mark, memory=Memory(**mark.memory)))


def _deepest(assembly: Assembly) -> dict[str, float]:
    """The deepest overlap of the placed sides (m), by contact of this rank's bodies."""
    return {met.name: max(0.0, -float(met.opening.min(initial=0.0))) for body in assembly.bodies
            for met in body.member.interfaces}


def _refuse_passing(assembly: Assembly, since: float, time: float) -> None:
    """InputError, on all ranks, where the motions run a body through another, at `time` or on the way. Collective."""
    now, unit, scene = _deepest(assembly), assembly.scene.units["length"], assembly.scene
    rigid, (then, here) = {each.name: each for each in scene.rigid}, (frames_of(scene, at) for at in (since, time))
    with agreed(assembly.world):
        assert assembly.far
        for contact in assembly.far.contacts:
            both = assembly.far.sides[contact.name]
            body, thin = min(((side.body, float(side.extent.min())) for side in both if side), key=lambda each: each[1])
            deepest = now[contact.name]
            if not deepest:  # apart: it may have passed
                places = min(MOST, 1 + int(4.0 * _way(contact, both[0], then, here) / thin))
                for at in np.linspace(since, time, places)[1:-1]:
                    met = meet(contact, both, frames_of(scene, float(at)), rigid, thin)
                    deepest = max(deepest, -float(met.opening.min(initial=0.0)))
            if deepest > DEEPEST * thin:
                raise InputError(f"contact.{contact.name}: the motions push {contact.bodies[0]!r} and "
                                 f"{contact.bodies[1]!r} into each other by {deepest:.3g} {unit} until time {time:g}, "
                                 f"more than {DEEPEST:g} of the thickness of {body!r}: one would run through the other")


def _way(contact: SettledContact, side: Side, then: Mapping[str, Frame], now: Mapping[str, Frame]) -> float:
    """How far the nodes of the first side move past the second body (m)."""
    first, second = contact.bodies
    old, new = (at[second].undone.after(at[first]).at(side.xy) for at in (then, now))
    return float(np.linalg.norm(new - old, axis=1).max())


def _reaches(assembly: Assembly, frames: Mapping[str, Frame], deepest: Mapping[str, float],
             time: float) -> dict[str, float]:
    """How deep overlaps may be at `time` (m), by contact: as the last ones, where `frames` were, by the motion since,
    and a facet."""
    now, reach = frames_of(assembly.scene, time), {}
    assert assembly.far
    for contact in assembly.far.contacts:
        side = assembly.far.sides[contact.name][0]
        reach[contact.name] = deepest[contact.name] + _way(contact, side, frames, now) + MARGIN * float(
            side.lengths.max())
    return reach


def _began(assembly: Assembly, name: str, points: np.ndarray, u: np.ndarray | float,
           then: Mapping[str, Frame]) -> dict[str, np.ndarray]:
    """Where the points of a body were a step before, with its displacement `u` and the frames of `then`, by contact, as
    displacements (nv, d) in its frame of now (m): seen from the frame of the second body, which is where it is now."""
    began, now = {}, assembly.frames
    assert assembly.far
    for contact in assembly.far.contacts:
        if name in contact.bodies:
            second = contact.bodies[1]
            carried = now[second].after(then[second].undone).after(then[name])
            began[contact.name] = now[name].undone.after(carried).at(points + u) - points
    return began


def _seen_now(mark: Mark, assembly: Assembly, memory: Memory, start: np.ndarray) -> Mark:
    """The last step as the rows of now see it: its forces by slave nodes, and the places of what they join now."""
    space, zero = assembly.space, np.zeros(assembly.space.size)
    slid = {interface.name: np.zeros((interface.m, interface.dimension - 1)) for interface in space.interfaces
            if interface.law.frictionless}
    return replace(mark, s=_forces_of(assembly, memory), moved=start, opening=space.opening, prescribed=zero, d=zero,
                   slid=slid)


def _forces_of(assembly: Assembly, memory: Memory) -> np.ndarray:
    """The forces (size,) that are remembered, at the slave nodes of the rows of now (N)."""
    s = np.zeros(assembly.space.size)
    for interface, part in assembly.space.with_slices():
        normal, tangential = (_by_node(interface, memory, what) for what in ("normal", "tangential"))
        s[part] = np.concatenate([normal[:, 0], tangential[interface.sliding].ravel()])
    return s


def _by_node(interface: Interface, memory: Memory, what: str) -> np.ndarray:
    """Values (m, ·) of the step before at the slave's nodes of the rows; zero where there was no row."""
    number, rows = _slave_nodes(interface), memory.contacts.get(interface.name)
    if rows is None or not len(rows["node"]):
        return np.zeros((interface.m, 1))
    whole = np.zeros((max(number.max(initial=0), rows["node"].max()) + 1, rows[what].shape[1]))
    whole[rows["node"]] = rows[what]
    return whole[number]


def _slave_nodes(interface: Interface) -> np.ndarray:
    """(m,) the node that a row stands at, by its number in the mesh."""
    side = interface.side(interface.slave) if interface.slave else 0
    if not interface.m:
        return np.empty(0, int)
    return interface.nodes[side][np.asarray(interface.transfer[side].argmax(axis=1)).ravel()]


def march(assembly: Assembly, report: Report = no_report, checkpoints: Checkpoints | None = None,
          clock: Clock | None = None) -> tuple[Solution, StepLog, Assembly]:
    """Solve `assembly` in the load steps of its scene, without [time] in one; the solution, the record of the steps,
    and the assembly at the end.

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
        return solution, log, assembly
    assembly.act(scene.legs[0])
    march = (FarMarch if scene.far else March)(assembly, Iteration(assembly, scene.method, no_report, clock), log)
    if checkpoints:
        checkpoints.follow(assembly, outer=march.outer, steps=march)
    return march.run(checkpoints), log, march.assembly
