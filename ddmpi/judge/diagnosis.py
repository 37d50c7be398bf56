"""What a user is told of a run that ends without a certified answer."""

from collections import deque
from collections.abc import Collection
from itertools import chain
from typing import Any, Self

import numpy as np

from ddmpi.coupling.space import Space
from ddmpi.methods.outer import Step
from ddmpi.scene.contacts import NoFriction
from ddmpi.scene.method import SettledMethod
from ddmpi.scene.scene import Settled
from ddmpi.system.numbers import in_words

LOOK_BACK = 10  # number of iterations by which convergence is judged
NO_PROGRESS = 0.98  # from this factor per iteration on the iteration does not converge
FEW = 5  # nodes that bear, below which a finer mesh may help
SMALLEST = 1e-15  # a residual below this cannot become smaller
LARGE_FRICTION = (
    1.0  # from this friction coefficient on a message says that a solution need not be unique
)


class StatusLog:
    """Which nodes are open, slip or stick: their number in each iteration, and every node's status in the last ones.

    Attributes
    ----------
    counts : open, slipping and sticking nodes of all contacts, by iteration
    xy : positions (d,) of the m nodes (m)
    largest_slope : largest friction coefficient
    frictionless : whether no node slides with friction
    """

    def __init__(self, space: Space) -> None:
        self._space = space
        self.xy = [place for interface in space.interfaces for place in interface.xy]
        self.largest_slope = space.laws.largest_slope
        self.frictionless = all(
            interface.law.frictionless or interface.law.two_sided for interface in space.interfaces
        )
        self.counts: list[tuple[int, int, int]] = []
        self._recent: deque[np.ndarray] = deque(maxlen=LOOK_BACK)

    def record(self, s: np.ndarray, bound: np.ndarray) -> None:
        """Note the status of each node under forces s (size,) and slip bounds of all sliding nodes (N). Collective."""
        laws = self._space.laws
        codes, counts = np.empty(laws.m, int), np.zeros(3, int)
        for law, entries, nodes, sliding in laws.kinds:
            forces = s[entries]
            closed, on_bound = law.closed(forces), law.reaches_bound(forces, bound[sliding])
            slipping = np.full(law.m, not len(sliding))  # without friction all closed nodes slip
            slipping[law.sliding] = on_bound
            # one number for each state: open 0, stick 1, slip 1 + 10 × the signs of the friction as digits to base 3
            code = closed.astype(int)
            towards = np.sign(law.split(forces)[1]).astype(int) @ 3 ** np.arange(law.components)
            code[law.sliding] += 10 * np.where(on_bound, towards, 0)
            codes[nodes] = code
            counts += (~closed).sum(), (closed & slipping).sum(), (closed & ~slipping).sum()
        self._recent.append(codes)
        opened, slips, sticks = self._space.add(counts).astype(int).tolist()
        self.counts.append((opened, slips, sticks))

    def whole(self) -> Self:
        """The log of the nodes of all ranks. Collective."""
        whole, comm = type(self)(Space([])), self._space.comm
        everyone = comm.allgather(
            (list(self._recent), self.xy, self.largest_slope, self.frictionless)
        )
        recent, places, slopes, smooth = zip(*everyone, strict=True)
        whole._recent.extend(np.concatenate(codes) for codes in zip(*recent, strict=True))
        whole.frictionless = all(smooth)
        whole.xy, whole.largest_slope, whole.counts = list(chain(*places)), max(slopes), self.counts
        return whole

    def clear(self) -> None:
        """Forget the iterations so far."""
        self.counts = []
        self._recent.clear()

    def state(self) -> dict[str, Any]:
        return {"recent": list(self._recent), "counts": tuple(self.counts)}

    def restore(self, state: dict[str, Any]) -> None:
        self._recent = deque(state["recent"], LOOK_BACK)
        self.counts = [tuple(row) for row in state["counts"]]

    def unsettled(self) -> np.ndarray:
        """Nodes whose status changed during the last iterations."""
        if len(self._recent) < 2:
            return np.empty(0, int)
        codes = np.array(self._recent)
        return np.flatnonzero((codes != codes[-1]).any(axis=0))

    def cycles(self) -> bool:
        """Whether the last status has been there before, with another one between."""
        codes = list(self._recent)
        same = [k for k, c in enumerate(codes[:-1]) if np.array_equal(c, codes[-1])]
        return bool(same) and any(not np.array_equal(c, codes[-1]) for c in codes[same[-1] :])


def contraction(history: list[Step], quantity: str = "update") -> float:
    """The factor by which `quantity` shrank per iteration lately, a geometric mean; nan if unknown."""
    values = np.array([getattr(step, quantity) for step in history[-LOOK_BACK - 1 :]])
    if len(values) < 3 or not (np.isfinite(values) & (values > 0)).all():
        return float("nan")
    return float(np.exp(np.polyfit(np.arange(len(values)), np.log(values), 1)[0]))


def helpful(scene: Settled, options: Collection[str] = (), slender: bool = False) -> set[str]:
    """Changes that the scene allows where no answer is found; `diagnose` tells those that fit how the run has ended.

    "friction": a contact slides with friction, so that there may be less of it. "anderson": that method takes the scene:
    two supported bodies, in one load step, with one contact that has friction; without, Newton's steps are those of an
    active set, and another path leads nowhere else. Neither helps a body so `slender` that rounding hides its answer,
    of which a warning tells. "precision": the PETSc `options` in force set -newton_ksp_rtol. Not collective.
    """
    rubs = [
        contact.kind == "unilateral" and contact.friction != NoFriction()
        for contact in scene.contact
    ]
    changes = {
        "friction": any(rubs) and not slender,
        "anderson": rubs == [True]
        and not slender
        and len(scene.body) == 2
        and not scene.rigid
        and not scene.time
        and all(body.clamps for body in scene.body),
        "precision": "newton_ksp_rtol" in options,
    }
    return {name for name, can in changes.items() if can}


def fitting(
    able: Collection[str], stopped: str, history: list[Step], factor: float, log: StatusLog
) -> set[str]:
    """Of the changes that a scene allows those that fit how its run has ended; and "iterations", "mesh". Not collective.

    Parameters
    ----------
    able : as of `helpful`
    stopped : the reason of `Outer.run`
    factor : by which the criterion shrinks per iteration, nan if unknown
    """
    changing, falls = len(log.unsettled()) > 0, not factor > NO_PROGRESS
    closed = sum(log.counts[-1][1:]) if log.counts else 0
    fits = {
        "iterations": stopped == "max_iterations" and falls,
        # states that go on changing are a matter of friction; a residual that stays with settled states is not
        "friction": "friction" in able and changing and not log.frictionless,
        "anderson": "anderson" in able and changing and bool(history[-1].update),
        "precision": "precision" in able and not changing,
        # few nodes that open and close in turn cannot share a force
        "mesh": stopped == "stalled" and changing and 0 < closed < FEW,
    }
    return {name for name, fit in fits.items() if fit}


def _in_words(factor: float) -> str:
    """How an iteration converges whose criterion shrinks by a factor."""
    if factor > 1.02:
        return "growth"
    if factor > NO_PROGRESS:
        return "no progress"
    return "slow convergence" if factor > 0.7 else "convergence"


def diagnose(
    reason: str,
    stopped: str,
    violations: list[str],
    method: SettledMethod,
    history: list[Step],
    log: StatusLog,
    able: Collection[str] = (),
    precision: tuple[str, float] | None = None,
) -> str:
    """A message: how the run ended, what was seen, what to try. `log` is of all nodes; `able` as of
    `helpful`; `precision` the body whose rounding is the reason, and the tolerance that allows it. Without a change
    that fits there is no advice. Not collective."""
    last = history[-1]
    lines = [
        f"{reason} (iteration {last.iteration}, update {last.update:.1e}, residual {last.residual:.1e}, "
        f"asked for {method.tolerance:.0e})"
    ]
    if violations:
        lines.append(f"the certificate fails: {', '.join(violations)}")
    factor = contraction(history, method.criterion)
    rounding = last.residual <= SMALLEST
    if stopped == "diverged":
        lines.append(f"seen: {method.diverging}")
    elif rounding or last.update == 0.0:
        lines.append("seen: the forces no longer change" + ", rounding is reached" * rounding)
    elif np.isfinite(factor):
        lines.append(
            f"seen: {_in_words(factor)}, a factor of {factor:.3f} per iteration over the last "
            f"{min(LOOK_BACK, len(history) - 1)}"
        )
    nodes = log.unsettled()
    if len(nodes):
        places = ", ".join(in_words(place, 4) for place in (log.xy[node] for node in nodes[:4]))
        lines.append(
            f"{len(nodes)} of {len(log.xy)} nodes changed between open, slip and stick"
            f"{' in a cycle' if log.cycles() else ''}, at {places}{' …' if len(nodes) > 4 else ''}"
        )
    if log.largest_slope >= LARGE_FRICTION:
        lines.append(
            f"with a friction coefficient of {log.largest_slope:g} a solution need not be unique, and "
            "there may be none near the first guess"
        )
    if precision:
        body, tolerance = precision
        lines += [
            f"double precision is the reason: {body} yields so much more when it bends than at its contacts that no more "
            "is known of its gaps",
            f"try: method.tolerance = {1.5 * tolerance:.1e}, the least that double precision allows here",
        ]
        return "\n  ".join(lines)
    fits = fitting(able, stopped, history, factor, log)
    advice = (
        "a larger method.tolerance; double precision allows no smaller one"
        if rounding
        else method.advice(stopped, factor, last.iteration, last.update, fits)
    )
    if advice:
        lines.append(f"try: {advice}")
    return "\n  ".join(lines)
