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

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.chain import Chain
from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactState
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import Report, no_report
from ddmpi.results.checkpoint import Checkpoints
from ddmpi.run.equilibrium import Mark
from ddmpi.run.gather import StepLog
from ddmpi.run.solve import Iteration, Solution, solve
from ddmpi.run.steps import March
from ddmpi.scene.meshes import frames_of
from ddmpi.surface.cover import DEEPEST
from ddmpi.system.agreement import agreed
from ddmpi.system.clock import Clock
from ddmpi.system.numbers import Frame

MARGIN = 1.0
"""Overlaps are looked for as deep as those of the step before and the motion of this one, and this many facets."""


@dataclass(frozen=True)
class Memory:
    """What a step leaves for the next.

    Attributes
    ----------
    frames : of bodies and rigid partners, by name
    displacements : (nv, d) of this rank's bodies in their frames (m)
    states : of the contacts that this rank owns
    deepest : overlap of the sides without displacements (m), by contact of this rank's bodies
    """

    frames: Mapping[str, Frame]
    displacements: Mapping[str, np.ndarray]
    states: Mapping[str, ContactState]
    deepest: Mapping[str, float]


class FarMarch(March):
    """The load steps of bodies that move far. Everything is collective."""

    def _step(self, time: float) -> Solution:
        """Place the bodies at `time`, and solve."""
        memory = self._now.memory or Memory(frames_of(self.assembly.scene, 0.0), {}, {}, _deepest(self.assembly))
        far, clock = self.assembly.far, self.iteration.clock
        assert far
        for member, body in zip(far.members, self.assembly.bodies, strict=True):
            member.C.count = body.member.C.count
        far.reach[time] = _reaches(self.assembly, memory, time)
        with clock.phase("assemble"):
            self.assembly = assembly = self.assembly.meet(time)
        _refuse_passing(assembly)
        start = assembly.exchange.total([body.member.begin(_began(assembly, body.member.name, body.mesh.points, memory))
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
            self.outer.begin((s, joint.product(s, "newton") - joint.d, np.zeros(0)))
        self.outer.direct.steps = True
        solution = self.iteration.solve(None, (sliding, self._now.s, self._now.slid), largest)
        states = {name: replace(state, before=_by_node(state.interface, memory.states.get(name), "slip_total"))
                  for name, state in solution.states.items()}
        return replace(solution, time=time, states=states)

    def _remember(self, solution: Solution) -> Memory:
        return Memory(self.assembly.frames, solution.displacements, solution.states, _deepest(self.assembly))

    def _by_frames(self, solution: Solution, before: Mark) -> float:
        """Work of the motions of frames (J): clamps balance what contact forces do to bodies that move."""
        states = before.memory.states if before.memory else {}
        frames, joules = before.memory.frames if before.memory else frames_of(self.assembly.scene, 0.0), 0.0
        for name, state in solution.states.items():
            for side, body in enumerate(state.interface.bodies):
                step = self.assembly.frames[body].after(frames[body].undone)
                for now, there in ((state, step.undone), (states.get(name), step)):
                    if now is not None and now.interface.at is not None and now.interface.m:
                        at, sign = now.interface.at[side], (1.0, -1.0)[side] * (1.0 if there is step else -1.0)
                        joules -= 0.5 * sign * float(((there.at(at) - at) * now.forces).sum())
        return float(self.assembly.space.add(np.array([joules]))[0])

    def _closing(self, s: np.ndarray) -> bool:
        """Nothing is known of gaps that close: rows are those of one step."""
        return False


def _deepest(assembly: Assembly) -> dict[str, float]:
    """The deepest overlap of the placed sides (m), by contact of this rank's bodies."""
    return {met.name: max(0.0, -float(met.opening.min(initial=0.0))) for body in assembly.bodies
            for met in body.member.interfaces}


def _refuse_passing(assembly: Assembly) -> None:
    """InputError, on all ranks, where the motions run a body through another. Collective."""
    deepest, unit = _deepest(assembly), assembly.scene.units["length"]
    with agreed(assembly.world):
        assert assembly.far
        for contact in assembly.far.contacts:
            sides = [side for side in assembly.far.sides[contact.name] if side]
            thin = min(sides, key=lambda side: float(side.extent.min()))
            if deepest[contact.name] > DEEPEST * float(thin.extent.min()):
                raise InputError(f"contact.{contact.name}: the motions push {contact.bodies[0]!r} and "
                                 f"{contact.bodies[1]!r} into each other by {deepest[contact.name]:.3g} {unit}, more "
                                 f"than {DEEPEST:g} of the thickness of {thin.body!r}: one would run through the other")


def _reaches(assembly: Assembly, memory: Memory, time: float) -> dict[str, float]:
    """How deep overlaps may be at `time` (m), by contact: as the last ones, by the motion since, and a facet."""
    frames, reach = frames_of(assembly.scene, time), {}
    assert assembly.far
    for contact in assembly.far.contacts:
        first, second = contact.bodies
        side = assembly.far.sides[contact.name][0]
        old, new = (at[second].undone.after(at[first]).at(side.xy) for at in (memory.frames, frames))
        reach[contact.name] = memory.deepest[contact.name] + float(np.linalg.norm(new - old, axis=1).max()) + (
            MARGIN * float(side.lengths.max()))
    return reach


def _began(assembly: Assembly, name: str, points: np.ndarray, memory: Memory) -> dict[str, np.ndarray]:
    """Where the points of a body were a step before, as displacements (nv, d) in its frame of now (m), by contact: seen
    from the frame of the second body, which is taken to be where it is now."""
    began, frame = {}, assembly.frames[name]
    u = memory.displacements.get(name, np.zeros_like(points))
    assert assembly.far
    for contact in assembly.far.contacts:
        if name in contact.bodies:
            second = contact.bodies[1]
            carried = assembly.frames[second].after(memory.frames[second].undone).after(memory.frames[name])
            began[contact.name] = frame.undone.after(carried).at(points + u) - points
    return began


def _seen_now(mark: Mark, assembly: Assembly, memory: Memory, start: np.ndarray) -> Mark:
    """The last step as the rows of now see it: its forces by slave nodes, and the places of what they join now."""
    space, zero = assembly.space, np.zeros(assembly.space.size)
    s, slid = zero.copy(), {}
    for interface, part in space.with_slices():
        before = memory.states.get(interface.name)
        normal, tangential = (_by_node(interface, before, what) for what in ("normal_force", "tangential_force"))
        s[part] = np.concatenate([normal[:, 0], tangential[interface.sliding].ravel()])
        if interface.law.frictionless:
            slid[interface.name] = np.zeros((interface.m, interface.dimension - 1))
    return replace(mark, s=s, moved=start, opening=space.opening, prescribed=zero, d=zero, slid=slid)


def _by_node(interface: Interface, before: ContactState | None, what: str) -> np.ndarray:
    """Values (m, ·) of the state before at the slave's nodes of the rows; zero where there was no row."""
    number = _slave_nodes(interface)
    if before is None or not before.interface.m:
        return np.zeros((interface.m, 1))
    values = getattr(before, what).reshape(before.interface.m, -1)
    nodes = _slave_nodes(before.interface)
    whole = np.zeros((max(number.max(initial=0), nodes.max()) + 1, values.shape[1]))
    whole[nodes] = values
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
    if scene.far:
        checkpoints = None  # rows differ from step to step
    if checkpoints:
        checkpoints.follow(assembly, outer=march.outer, steps=march)
    return march.run(checkpoints), log, march.assembly
