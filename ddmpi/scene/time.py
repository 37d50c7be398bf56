"""Types of load steps: histories of loads, cycles, and the times of a scene."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from typing import Annotated, Any, Literal

import msgspec
import numpy as np

from ddmpi.scene.values import Mistakes, NonNegative, Number, Positive, Table, Tolerance, settle
from ddmpi.system.numbers import ALIKE


class History(Table, frozen=True, kw_only=True):
    """The factor of loads, clamps and rigid displacements over time: linear between times, constant beyond them.

    Attributes
    ----------
    times : they ascend strictly
    factors : the factor at each time
    """

    times: list[Number]
    factors: list[Number]

    def __post_init__(self) -> None:
        if len(self.times) != len(self.factors) or not self.times:
            raise ValueError(
                f"times and factors must be equally many, at least one; "
                f"got {len(self.times)} times and {len(self.factors)} factors"
            )
        if any(b <= a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise ValueError("times must ascend strictly")

    def at(self, time: float) -> float:
        """The factor at `time`."""
        return float(np.interp(time, self.times, self.factors))

    @property
    def kinks(self) -> list[float]:
        """The times at which the factor changes its slope."""
        rise = np.diff(self.factors)
        run = np.diff(self.times)
        slopes = np.concatenate([[0.0], rise / run, [0.0]])
        return [
            time
            for time, before, after in zip(self.times, slopes, slopes[1:], strict=False)
            if before != after
        ]


def most_loaded(histories: Iterable[History], times: np.ndarray | Sequence[float]) -> int:
    """Which is the last of the times at which the sum of the factors of all histories, Σ |factor| / max |factor|, is
    largest."""
    loads = np.zeros(len(times))
    for history in histories:
        largest = np.abs(history.factors).max() or 1.0
        loads += np.abs(np.interp(times, history.times, history.factors)) / largest
    return int(np.flatnonzero(loads >= loads.max() - 1e-9)[-1])


class Cycle(Table, frozen=True, kw_only=True, rename={"begin": "from"}):
    """A part of the load steps that is run again and again, as in ``cycle = { from = 1.5, to = 3.5, repeat = 500 }``.

    Later points shift by the time of the cycles run. Both ends of the cycle end legs, too.

    Attributes
    ----------
    from : time at which the cycle begins; all histories have the same factor there and at its end
    to : time at which it ends, at most the last of the points
    repeat : how many times it is run in all
    until : the cycles stop early when the forces at the end of one differ from those at its beginning by less than
        this times the largest; left out, all are run
    """

    begin: NonNegative
    to: Positive
    repeat: Annotated[int, msgspec.Meta(ge=1, le=10**6)]
    until: Tolerance | None = None

    def __post_init__(self) -> None:
        if self.begin >= self.to:
            raise ValueError(f"from: {self.begin:g} must be before to = {self.to:g}")

    @property
    def span(self) -> float:
        """The time that a cycle takes."""
        return self.to - self.begin

    def drawn(self, time: Any, run: int) -> Any:
        """The time in `points` of a `time`, or of an array of times, of a run with `run` cycles."""
        # A time on an end belongs to the cycle before.
        shifts = np.ceil((time - self.to) / self.span - 1e-9)
        return time - np.clip(shifts, 0, max(run - 1, 0)) * self.span


class Time(Table, frozen=True, kw_only=True):
    """Load steps, in which friction has a memory; see docs/use/load_steps.md.

    Attributes
    ----------
    points : turning points of the loads, the ends of legs, as are kinks of histories; the first leg starts at time 0
    steps : load steps per leg
    tolerance : without steps, a leg is solved in 1, 2, 4, … load steps until the forces at its end change by less than
        this, relative to the forces; left out, 0.02
    cycle : a part that is run again and again
    motions : "far": bodies and rigid partners move as their motion says, and meet where they are; left out, "small"
    """

    points: Annotated[list[Number], msgspec.Meta(min_length=1)]
    steps: Annotated[int, msgspec.Meta(ge=1, le=10**6)] | None = None
    tolerance: Tolerance | None = None
    cycle: Cycle | None = None
    motions: Literal["small", "far"] | None = None

    def __post_init__(self) -> None:
        if self.points[0] <= 0.0:
            raise ValueError(
                f"points are ends of legs, the first of which starts at time 0; they must be positive, "
                f"got {self.points[0]:g}"
            )
        if any(b <= a for a, b in zip(self.points, self.points[1:], strict=False)):
            raise ValueError("points must ascend strictly")
        if self.steps is not None and self.tolerance is not None:
            raise ValueError(
                "steps and tolerance do not go together; leave steps out to have as many as tolerance "
                "asks for"
            )
        if self.cycle and self.cycle.to > self.points[-1]:
            raise ValueError(
                f"cycle: to = {self.cycle.to:g} is after the last of the points, {self.points[-1]:g}"
            )

    @property
    def cycle_ends(self) -> tuple[float, ...]:
        """The times at which a cycle begins and ends; none without one."""
        return (self.cycle.begin, self.cycle.to) if self.cycle else ()

    def wrong_cycle(self, histories: Mapping[str, History]) -> Mistakes:
        """How a cycle does not end with the loads with which it begins."""
        if not self.cycle:
            return
        begin, end = self.cycle_ends
        for name, history in histories.items():
            first = history.at(begin)
            last = history.at(end)
            if abs(first - last) > ALIKE * max(map(abs, history.factors)):
                yield (
                    f"time.cycle: history.{name} has the factor {first:g} at from = {begin:g} and "
                    f"{last:g} at to = {end:g}; a cycle ends with the loads with which it begins"
                )

    def settled(self) -> Time:
        """The load steps, with a tolerance if no number of steps is given."""
        return settle(self, Time, tolerance=None if self.steps else self.tolerance or 0.02)
