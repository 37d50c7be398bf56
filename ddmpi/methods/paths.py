"""Two paths to where Newton's own steps converge: a barrier that gets lower, and a layer that gets harder.

Where whole bodies hinge, jam or slide, a few closed nodes support them, and Newton's steps stall if they start from a
wrong guess of these nodes. Both paths solve a series of easier problems, each from the answer of the one before, by the
same linear problem with a diagonal D added (`ddmpi.methods.krylov`).

Interior points replace each bound by a barrier μ: s w = μ for forces s and gaps w; g y + s_t·v = 2μ and
g v + y s_t = 0 for friction s_t below its bound g, which follows the pressure, and the slip v below its bound y
(Alizadeh and Goldfarb, Second-order cone programming, Math. Program. 95, 2003, for convex problems). Bodies can cross
clearances on this path, and slide as wholes.

Softening puts a layer of compliance D = δ/c between the bodies, so that many nodes carry load: s = P(−r/D). As δ falls,
hinges and zones that stick shrink gradually, and the active sets of one stage nearly fit the next.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.coupling.coarse import CoarseSystem
from ddmpi.coupling.joint import Joint, Point
from ddmpi.interface.law import across, direction
from ddmpi.methods.krylov import Linearised, Regularisation
from ddmpi.petsc.events import event
from ddmpi.sets import cone_exit, cone_room, dots, magnitude
from ddmpi.system.numbers import norm

SOFTEST, HARDEST, HARDER = 1e3, 1e-7, 0.1
"""δ of the first and the last stage, and of each stage over that of the one before."""

LATE, SETTLED, SETTLED_LATE = 0.2, 0.2, 0.02
"""A stage ends when a step leaves a residual below SETTLED of the forces, from δ = LATE on below SETTLED_LATE or δ
of them, whichever is less."""

MOST_STEPS = 15
"""Most steps of a stage."""

STUCK, GAIN = 8, 0.9
"""A stage fails after STUCK steps in a row that leave more than GAIN of the least residual."""

STIFF = 0.011
"""Newton's own steps are tried after each stage from this δ on."""

SLOPE, ZERO = 0.5, 0.1
"""The full step is taken if the slope of the energy at its end is at most SLOPE times the descent at its start.
Otherwise the length with the least energy is searched for, up to a slope of ZERO times that descent."""

SHORTEST, LENGTHS, CLOSER, REFINEMENTS = 1e-9, 46, 12, 3
"""Shortest step, number of lengths from it to the full step, of lengths between two neighbours among them, and of such
refinements; each set of lengths takes one reduction."""

DRIFT, STOPPED = 1e-4, 0.01
"""Bodies drift if both paths fail and leave an imbalance above DRIFT of the loads, unless they move into a partner by
more than STOPPED of their motion (below 1e-4 in drifts, above 0.3 in falls into wedges)."""

TO_BOUND = 0.99
"""A step of interior points goes this fraction of the way to the nearest bound."""

LOOSELY = 0.02
"""Factor on the compliance SHARED of `krylov` for interior points. Without this factor steps are slow where forces at
edges are nearly free: a step leaves 0.4 to 0.9 of the residual."""

LOWER = ((0.9, 0.1), (0.5, 0.2), (0.2, 0.5), (0.0, 0.8))
"""Pairs: if the last step was at least as long as the first number, the barrier falls to the second times its mean."""

NEAR = 1e-2
"""Newton's own steps are tried from interior points whose residual is smaller than this."""

INEXACT = 1e-2
"""Factor by which GMRES reduces the residual of a step of interior points; 1e-3 takes a twentieth fewer steps and a
tenth more products."""

MOST_POINTS, IDLE, LONG, LOWEST = 60, 8, 0.2, 1e-18
"""Interior points fail after MOST_POINTS steps, after IDLE steps in a row that are neither longer than LONG nor longer
than all before, or if the barrier is below LOWEST of the first."""

SPARE = 1.1
"""The first bound y of the slip v is at least this times |v|, so that v lies inside its cone."""

UNSEEN = 1e-10
"""Added to the diagonal of ZᵀZ (no unit), which rigid motions that move no contact would make singular."""


Solve = Callable[..., Point]
"""`Newton.direction` with the `by` of a path: solve(point, linearised, change, wanted, layer)."""


class Station(NamedTuple):
    """A point of a path after a step.

    Attributes
    ----------
    stage : of the step, in words
    near : Newton's own steps are worth trying where the residual is below this
    """

    point: Point
    stage: str
    near: float


class Path:
    """A path of easier problems.

        >>> from functools import partial
        >>> from ddmpi.methods.newton import Newton
        >>> joint = ddmpi.solve("configs/punch.toml", MPI.COMM_WORLD).solved.assembly.joint
        >>> newton = Newton(joint, max_iterations=20)
        >>> path = Softening(joint, newton.preconditioner.c)
        >>> stations = path.points(partial(newton.direction, by=path.by))
        >>> [next(stations).stage for _ in range(3)]
        ['layer 1e+03', 'layer 1e+03', 'layer 1e+02']

    Parameters
    ----------
    joint : the operator
    c : (size,) half the joint moduli, which turn gaps into forces
    before : the norm of the forces at which the load step begins (N)

    Attributes
    ----------
    by : how its linear problems are steered, and how precisely they are solved
    point : the iterate
    stage : of the next step, in words
    near : as of `Station`
    failed : whether the path leads no farther
    """

    by: Regularisation
    _joint: Joint
    point: Point
    near: float
    failed: bool

    @property
    def stage(self) -> str:
        raise NotImplementedError

    def step(self, solve: Solve) -> None:
        """One step. Collective; raises what `solve` raises."""

    def go_on(self) -> None:
        """Begin what comes next, where Newton's own steps have not converged from the point of the last step."""

    def points(self, solve: Solve) -> Iterator[Station]:
        """The stations, one after each step. Collective; raises what `solve` raises."""
        while not self.failed:
            stage = self.stage
            with event("NewtonStep"):
                self._joint.take(self.point.s)
                self.step(solve)
                self.point = self._joint.soften(self.point)
            yield Station(self.point, stage, 0.0 if self.failed else self.near)
            self.go_on()


class Softening(Path):
    """The path of a layer that gets harder; it begins at zero forces."""

    by = Regularisation(forcing=1e-4, precise=True)
    """With a forcing of 1e-3 slender bodies would go where errors push them."""

    def __init__(self, joint: Joint, c: np.ndarray, before: float = 0.0) -> None:
        self._joint, self._space, self._laws, self._c = joint, joint.space, joint.space.laws, c
        self._two_sided = (
            joint.space.spread([interface.law.two_sided for interface in joint.space.interfaces])
            > 0
        )
        self.point = joint.at_rest()
        self._delta, self._last_delta = SOFTEST, 0.0  # δ of this stage, and of the last step
        self._begin()

    def _begin(self) -> None:
        """Begin a stage."""
        self._steps = self._idle = 0
        self._residual = self._smallest = np.inf
        self._settled, self.near, self.failed = False, 0.0, False

    @property
    def stage(self) -> str:
        return f"layer {self._delta:.0e}"

    def go_on(self) -> None:
        if self._settled:  # the next stage
            self._delta *= HARDER
            self._begin()
            self.failed = self._delta < 0.5 * HARDEST

    def step(self, solve: Solve) -> None:
        point, first = self.point, not self._last_delta
        if first:  # nodes that are closed at first stick
            active, q = self._laws.sticking(self._joint.first_closed()[0]), point.s
        else:
            q = self._pressed(point, self._last_delta)
            active = self._laws.active_sets(q)
        # s = P(−r/D), linearised: r + D s = 0 along the forces that P leaves free, with D = δ/c
        linearised = Linearised.of(self._laws.linearise(active))
        layer = np.where(self._two_sided, 0.0, self._delta / self._c)
        change = self._towards(solve, linearised, layer)
        length = 1.0 if first else self._length(change, None)
        if not length:  # with fixed slip bounds the energy is convex, and falls along the step
            change = self._towards(solve, linearised.frozen(q), layer)
            length = self._length(change, self._laws.bound_at(q)) or 1.0
        self.point = point.along(change, length)
        self._judge(change)

    def _towards(self, solve: Solve, linearised: Linearised, layer: np.ndarray) -> Point:
        s = self.point.s
        # friction at its bound is g q̂: across q̂ the layer gives way by D |q_t|/g = D (1 + κ)
        change, layer = linearised.move(s), layer * (1.0 + linearised.spring)
        return solve(self.point, linearised, change, -layer * (s + change), layer)

    def _pressed(self, point: Point, delta: float) -> np.ndarray:
        """q (size,) whose projection are the forces of a layer of δ = `delta`; of bonded rows s − c r."""
        pressed = -self._c / delta * point.r
        return (
            np.where(self._two_sided, point.s - self._c * point.r, pressed)
            if self._two_sided.any()
            else pressed
        )

    def _slopes(self, change: Point, lengths: np.ndarray, bound: np.ndarray | None) -> np.ndarray:
        """Derivatives (k,) of the energy (J) by the length of the step, at the `lengths` (k,), in one reduction.

        φ' = dr·(s − P(−r/D)) − dα·(e − G s): the energy of bodies and layer less the work of the loads. Bonded rows
        stay closed. `bound` (mt,) are fixed slip bounds, None where they follow the pressure.
        """
        way, slopes = np.where(self._two_sided, 0.0, change.r), []
        project = self._laws.project if bound is None else self._laws.cone(bound).project
        for t in lengths:
            ahead = self.point.along(change, t)
            slopes.append(way @ (ahead.s - project(self._pressed(ahead, self._delta))))
        rigid = change.alpha @ self.point.left + lengths * (change.alpha @ change.left)
        return self._space.add(np.array(slopes)) - rigid

    def _length(self, change: Point, bound: np.ndarray | None) -> float:
        """The length of the step; zero where the energy does not fall along it."""
        t = np.concatenate([[0.0], np.geomspace(SHORTEST, 1.0, LENGTHS)])
        slopes = self._slopes(change, t, bound)
        falls = -slopes[0]
        if not falls > 0.0:
            return 0.0
        if slopes[-1] <= SLOPE * falls:
            return 1.0
        # the energy is least where its slope changes sign: refine between the two lengths around that place
        for _ in range(REFINEMENTS):
            k = max(int(np.argmax(slopes > 0.0)), 1)
            t = np.linspace(t[k - 1], t[k], CLOSER)
            slopes = self._slopes(change, t, bound)
            best = int(np.argmin(np.abs(slopes)))
            if abs(slopes[best]) <= ZERO * falls:
                return float(t[best])
        return float(t[best])

    def _judge(self, change: Point) -> None:
        """Decide after a step whether the stage is settled, or the path has failed. Collective."""
        point = self.point
        misfit = point.s - self._laws.project(self._pressed(point, self._delta))
        contact, size, moved = self._space.norms([misfit, point.s, change.s])
        self._residual, self._last_delta = float(np.hypot(contact, norm(point.left))), self._delta
        self._steps += 1
        gained = self._residual <= GAIN * self._smallest
        self._idle, self._smallest = (
            (0, self._residual) if gained else (self._idle + 1, self._smallest)
        )
        # early stages need only lead near the next one; in late ones few nodes decide where a body goes
        late = self._delta <= LATE
        share = min(SETTLED_LATE, self._delta) if late else SETTLED
        self._settled = self._residual <= share * size
        if not self._settled:
            # all nodes are open, and loose bodies fall onto nothing
            still = not (moved or norm(change.alpha))
            self.failed = still or self._idle >= STUCK or self._steps >= MOST_STEPS
        elif self._delta <= STIFF:
            self.near = np.inf


class InteriorPoints(Path):
    """The path of interior points. It begins at equal normal forces, together as large as `_first_force`.

    The start is inside all bounds and has the gaps and slips of its forces, so that a belt that a clamp drags along
    slides from the first step on. Collective.
    """

    near = NEAR
    by = Regularisation(springs=1e-6, shared=LOOSELY, forcing=INEXACT, precise=True)
    """With the springs of Newton's method bodies would cross wide clearances too slowly: a step moves them by imbalance
    over spring. The barrier of each contact supports bodies, too."""

    def __init__(self, joint: Joint, c: np.ndarray, before: float = 0.0) -> None:
        self._joint, self._space, size = joint, joint.space, joint.size
        self._kinds = [kind for kind in joint.space.laws.kinds if not kind.law.two_sided]
        self._normal, self._source = np.zeros(size, bool), np.arange(size)
        rows = np.empty((0, max((kind.law.components for kind in self._kinds), default=1)), int)
        for law, entries, *_ in self._kinds:
            self._normal[entries[: law.m]] = True
            self._source[entries] = entries[law.node]
            rows = np.append(rows, entries[law.m :].reshape(-1, law.components), axis=0)
        # equal forces at all nodes, whose norm is the first force
        number = float(self._space.add(np.array([float(np.count_nonzero(self._normal))]))[0])
        force = self._first_force(c, before) / np.sqrt(max(number, 1.0))
        s = np.where(self._normal, force, 0.0)
        self._rubbing = np.ones(len(rows), bool)
        self._unknown, self._rubbing = np.ones(size, bool), self._bounds(s)[0, :, 0] > 0.0
        self._unknown[rows[~self._rubbing]] = False  # no friction force at all
        self._rows = rows[self._rubbing]
        r = joint.product(s, "newton") + joint.offset - joint.d - joint.rigid.spread(joint.still)
        alpha = joint.still.copy()
        if joint.rigid.size:  # least squares: α = (ZᵀZ)⁻¹Zᵀr leaves the smallest gaps |r − Zα|
            identity = sparse.identity(size, format="csr")
            r, motions = CoarseSystem(
                joint.rigid,
                identity,
                identity,
                np.ones(size),
                lambda columns: columns,
                UNSEEN * sparse.identity(joint.rigid.size),
                joint.stays.bolts,
                joint.stays.held,
            ).correct(r)
            alpha -= motions
        # each gap w begins at the largest of: the widest clearance, what the first force closes, and its r
        w = self._space.largest(np.maximum(joint.space.opening, force / c))
        self._w, self._slip = np.where(self._normal, np.maximum(w, r), 0.0), r[self._rows]
        # inside |v| < y; without slip g y + s_t·v = 2μ, as s_t = 0; this μ is the mean of s w
        mu = float(self._space.add(np.array([s @ self._w]))[0]) / max(number, 1.0)
        self._most = SPARE * magnitude(self._slip)[:, None] + 2.0 * mu / self._bounds(s)[0]
        self._barrier = self._first = self._mean(s)
        self.point = Point(s, r, alpha, joint.imbalance(s, alpha))
        self._last, self._longest, self._steps, self._idle, self.failed = 1.0, 0.0, 0, 0, False

    def _first_force(self, c: np.ndarray, before: float) -> float:
        """The norm of the first forces (N): the largest of those of the loads, of forces that close the free gaps d, and
        of those `before`, as a tightened bolt that keeps its offset is neither load nor gap.

        Clearances are left out of d. These forces are the fraction, at most 1, of c d with the least energy, because a
        slender body bends far under small forces.
        """
        gaps = self._joint.d + np.maximum(self._space.opening, 0.0)
        closing = np.where(self._normal, np.maximum(gaps, 0.0), 0.0)
        gaps = closing if self._space.any(closing) else gaps  # slips say nothing of pressures
        forces = c * gaps
        given, stored = self._space.add(
            np.array([forces @ gaps, forces @ self._joint.product(forces, "newton")])
        )
        fraction = given / stored if stored > given else 1.0
        return max(norm(self._joint.e), fraction * self._space.norm(forces), before)

    @property
    def stage(self) -> str:
        return f"barrier {self._barrier:.0e}"

    def _bounds(self, s: np.ndarray) -> np.ndarray:
        """Slip bounds (N) and their slopes (2, k, 1) at the nodes with friction, under the forces s (size,)."""
        bounds = [
            (law.bound_at(s[entries]), law.slope(np.maximum(s[entries][: law.m], 0.0)))
            for law, entries, *_ in self._kinds
        ]
        return np.concatenate([np.empty((2, 0)), *bounds], axis=1)[:, self._rubbing, None]

    def _turn(self, axes: np.ndarray) -> sparse.csr_matrix | None:
        """Frames (size, size) with tangential `axes` (k, d − 1) at the nodes with friction; None in the plane."""
        if axes.shape[1] == 1:
            return None
        rows, straight = self._rows, np.setdiff1d(np.arange(len(self._unknown)), self._rows)
        row, column = np.broadcast_arrays(rows[:, :, None], rows[:, None, :])
        return sparse.csr_matrix(
            (
                np.append(np.ones(len(straight)), across(axes)),
                (np.append(straight, row), np.append(straight, column)),
            )
        )

    def _mean(self, s: np.ndarray) -> float:
        """The barrier μ (J) that s with its gaps and slips has on average. Collective."""
        # on the path s w = μ for each normal force, and g y + s_t·v = 2μ for each friction force
        work = (
            s @ self._w
            + (self._bounds(s)[0] * self._most).sum()
            + (s[self._rows] * self._slip).sum()
        )
        number = np.count_nonzero(self._normal) + 2 * len(self._rows)
        work, number = self._space.add(np.array([work, float(number)]))
        return float(work / max(number, 1.0))

    def step(self, solve: Solve) -> None:
        normal, rows, w = self._normal, self._rows, self._w
        point, s = self.point, self.point.s
        mean, (g, slope), v, y = self._mean(s), self._bounds(s), self._slip, self._most
        s_t, under = s[rows], self._source[rows[:, :1]]
        room = cone_room(g, s_t)
        least = np.concatenate([s[normal], w[normal], *room, *cone_room(y, v)]).min(initial=np.inf)
        if self._space.any(np.array([not least > 0.0])) or not mean > LOWEST * self._first:
            self.failed = True
            return
        mu = self._barrier = mean * next(factor for least, factor in LOWER if self._last >= least)
        # friction s_t below g and slip v below y: g y + s_t·v = 2μ and g v + y s_t = 0. Without y, this is the slip
        # v = −2μ s_t/(g² − |s_t|²); linearised, this is one compliance along s_t and another one across it
        axes, size = direction(s_t), magnitude(s_t)[:, None]
        ahead = dots(axes, v)
        power, across_slip = g * y - size * ahead, v - ahead * axes
        along = power / room
        aside = y / g  # leaves out how slip across friction changes slip along it
        turns = (size * y - g * ahead) / power * axes - across_slip / y  # ds_t/dg at a fixed slip
        # s w = μ, linearised, where the new gap r takes the place of the new w: r + (w/s) ds = μ/s
        pressure = np.where(normal, s, 1.0)
        layer = w / pressure
        coupling = np.zeros(len(s))
        wanted = np.where(normal, mu / pressure, 0.0)
        layer[rows], coupling[rows], wanted[rows] = aside, slope * turns, -2.0 * mu / room * s_t
        layer[rows[:, :1]] = along
        none = np.zeros(len(s))
        linearised = Linearised(self._unknown, self._source, coupling, none, none, self._turn(axes))
        change = solve(point, linearised, none, wanted, layer)
        dg, ds_t = slope * change.s[under], change.s[rows]
        # the changes of v, y and w, from those of s_t and g
        beyond = ds_t - dg * turns  # without the part that follows the bound
        straight = dots(axes, beyond) * axes
        dv = wanted[rows] - along * straight - aside * (beyond - straight) - v
        dy = (2.0 * mu - dots(s_t, v + dv) - dots(v, ds_t) - y * dg) / g - y
        dw = np.where(normal, (mu - w * change.s) / pressure - w, 0.0)
        # TO_BOUND of the way to the nearest place where a force, a gap, or the room below a bound becomes zero
        nears = np.concatenate(
            [
                -change.s[normal] / s[normal],
                -dw[normal] / w[normal],
                *cone_exit(g, s_t, dg, ds_t),
                *cone_exit(y, v, dy, dv),
            ]
        )
        fastest = self._space.largest(np.maximum(nears, 0.0))
        length = min(1.0, TO_BOUND / fastest) if fastest else 1.0
        self._w, self._slip, self._most = w + length * dw, v + length * dv, y + length * dy
        self.point, self._last, self._steps = point.along(change, length), length, self._steps + 1
        self._idle = 0 if length > min(self._longest, LONG) else self._idle + 1
        self._longest = max(self._longest, length)
        self.failed = self._steps >= MOST_POINTS or self._idle >= IDLE or not np.isfinite(fastest)
