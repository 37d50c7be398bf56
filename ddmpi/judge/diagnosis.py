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
    """

    def __init__(self, space: Space) -> None:
        self._space = space
        self.xy = [place for interface in space.interfaces for place in interface.xy]
        self.largest_slope = space.laws.largest_slope
        self.counts: list[tuple[int, int, int]] = []
        self._recent: deque[np.ndarray] = deque(maxlen=LOOK_BACK)

    def record(self, s: np.ndarray, bound: np.ndarray) -> None:
        """Note the status of each node under forces s (size,) and slip bounds of all sliding nodes (N). Collective."""
        codes, counts, laws = [], np.zeros(3, int), self._space.laws
        for interface, (law, forces), limit in zip(
            self._space.interfaces, laws.parts(s), laws.bounds(bound), strict=False
        ):
            closed = law.closed(forces)
            on_bound = law.reaches_bound(forces, limit)
            slipping = np.full(
                interface.m, not len(interface.sliding)
            )  # without friction all closed nodes slip
            slipping[interface.sliding] = on_bound
            # one number for each state: open 0, stick 1, slip 1 + 10 × the signs of the friction as digits to base 3
            code = closed.astype(int)
            towards = np.sign(law.split(forces)[1]).astype(int) @ 3 ** np.arange(law.components)
            code[interface.sliding] += 10 * np.where(on_bound, towards, 0)
            codes.append(code)
            counts += (~closed).sum(), (closed & slipping).sum(), (closed & ~slipping).sum()
        self._recent.append(np.concatenate([np.empty(0, int), *codes]))
        opened, slips, sticks = self._space.add(counts).astype(int).tolist()
        self.counts.append((opened, slips, sticks))

    def whole(self) -> Self:
        """The log of the nodes of all ranks. Collective."""
        whole, comm = type(self)(Space([])), self._space.comm
        everyone = comm.allgather((list(self._recent), self.xy, self.largest_slope))
        recent, places, slopes = zip(*everyone, strict=True)
        whole._recent.extend(np.concatenate(codes) for codes in zip(*recent, strict=True))
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


def helpful(scene: Settled) -> set[str]:
    """Changes that may help where no answer is found: less "friction", or the method "anderson", for two supported
    bodies with one contact that is not bonded, in one load step."""
    two = (
        len(scene.body) == 2
        and [contact.kind for contact in scene.contact] == ["unilateral"]
        and not scene.time
    )
    changes = {
        "friction": any(contact.friction != NoFriction() for contact in scene.contact),
        "anderson": two and all(body.clamps for body in scene.body),
    }
    return {name for name, can in changes.items() if can}


def diagnose(
    reason: str,
    stopped: str,
    violations: list[str],
    method: SettledMethod,
    history: list[Step],
    log: StatusLog,
    able: Collection[str] = (),
) -> str:
    """A message: how the run ended, what was seen, what to try. `log` is of all nodes; `able` as of
    `helpful`. Not collective."""
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
        seen = (
            "growth"
            if factor > 1.02
            else "no progress"
            if factor > 0.98
            else "slow convergence"
            if factor > 0.7
            else "convergence"
        )
        lines.append(
            f"seen: {seen}, a factor of {factor:.3f} per iteration over the last "
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
    lines.append(
        "try: "
        + (
            "a larger method.tolerance; double precision allows no smaller one"
            if rounding
            else method.advice(stopped, factor, last.iteration, last.update, able)
        )
    )
    return "\n  ".join(lines)
