"""Clamps that push the sides of a contact into each other, or pull a bond apart, which no contact force can prevent."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface, Places
from ddmpi.scene.bodies import Clamp
from ddmpi.scene.contacts import Rigid
from ddmpi.sets import magnitude
from ddmpi.surface.side import Side
from ddmpi.system.numbers import SAME, in_words

WRONG = {"bonded": "tear the bond apart", "guided": "take the guided sides off each other"}
"""What clamps that contradict a two-sided law do, by its name."""


@dataclass(frozen=True)
class Mover:
    """What prescribes the motion of a side: the `clamps` of its body, or the rigid partner that is this side."""

    side: Side | Rigid
    clamps: Sequence[Clamp] = ()

    def free(self, places: Places, k: int) -> np.ndarray:
        """M (n, d, d): `places` move by M e with this side, the k-th, where unconstrained nodes move by e."""
        if isinstance(self.side, Side):
            return self.at(places, k, self.side.free)
        axes = np.arange(places.normal.shape[1])
        pushed = np.isin(axes, self.side.pushed) | self.side.turning
        return self.at(places, k, np.diag(1.0 * pushed)[None])

    def moved(self, places: Places, k: int, factors: Mapping[str | None, float]) -> np.ndarray:
        """(n, d) the prescribed displacement of places (m), with these factors by history."""
        u = np.zeros((1, places.normal.shape[1]))
        if not isinstance(self.side, Side):
            u = u + factors[self.side.history] * np.array(self.side.displacement)
        else:
            for history, moved in self.side.moved.items():
                u = u + factors[history] * moved
        return self.at(places, k, u)

    def at(self, places: Places, k: int, values: np.ndarray) -> np.ndarray:
        """(n, …) values at places, from those (j, …) at the nodes of the side, or the one (1, …) of a partner."""
        if not isinstance(self.side, Side):
            return values.repeat(len(places.gap), axis=0)
        whole = np.zeros((self.side.nodes.max() + 1, values[0].size))
        whole[self.side.nodes] = values.reshape(len(values), -1)
        return places.moved(k, whole).reshape(-1, *values.shape[1:])

    def words(self, places: Places, k: int, place: int, axes: Sequence[int], u: np.ndarray) -> str:
        """The clamps or the rigid displacement that prescribe u (d,) of a place along some axes, in words."""
        values = [f"{'xyz'[axis]} = {u[axis] + 0.0:.6g}" for axis in axes]
        if not isinstance(self.side, Side):
            return f"rigid.{self.side.name}.displacement prescribes {', '.join(values)}"
        node = int(np.argmax(abs(places.transfer[k][[place]].toarray())))
        numbers = self.side.clamps[self.side.nodes == places.nodes[k][node]][0, axes]
        return ", ".join(
            f"body.{self.side.body}.clamp.{number} on {self.clamps[number].on!r} prescribes {value}"
            for value, number in zip(values, numbers, strict=True)
            if number >= 0
        )


@dataclass(frozen=True)
class Constrained:
    """Places at which the motions of both sides are prescribed along some axes.

    Attributes
    ----------
    places : on the interface
    axes : (n, d, d) in the columns, directions along which the sides can yield to a force or cannot
    free : (n, d) bool, along which axes one of them can
    along : (n, d) components of the normals along the axes
    """

    places: Places
    axes: np.ndarray
    free: np.ndarray
    along: np.ndarray

    def torn(self, closing: np.ndarray, gap: np.ndarray) -> np.ndarray:
        """(n, d) by how much a closing motion (n, d) goes beyond what a bond with gaps (n, 1) allows, along each axis."""
        # A bond may keep its gap, or close it wholly or in part: the closing motion u_1 − u_2 must lie between 0 and
        # gap n along each constrained direction.
        ends = np.stack([0.0 * self.along, gap * self.along])
        closing = np.einsum("nd,ndk->nk", closing, self.axes)
        beyond = np.maximum(closing - ends.max(axis=0), ends.min(axis=0) - closing)
        beyond[self.free] = 0.0
        return beyond

    def pressed(self, closing: np.ndarray, gap: np.ndarray, guided: bool) -> np.ndarray:
        """(n, 1) by how much a closing motion (n, d) goes beyond gaps (n, 1) along the normals."""
        # A unilateral contact is contradicted if the sides close by more than the gap, and if no direction that can
        # yield has a component along the normal.
        across = (closing * self.places.normal).sum(axis=1, keepdims=True)
        beyond = across - np.maximum(gap, 0.0)
        if guided:  # such sides must not be pulled apart, either
            beyond = np.maximum(beyond, np.minimum(gap, 0.0) - across)
        beyond[(self.free & (np.abs(self.along) > SAME)).any(axis=1)] = 0.0
        return beyond


def refuse_contradiction(
    interface: Interface,
    movers: Sequence[Mover],
    factors: Mapping[float, Mapping[str | None, float]],
    unit: str = "m",
) -> None:
    """InputError where clamps push both sides into each other, which no contact force can prevent. Not collective.

    Bonded sides must not move against each other at all, guided ones not along the normal. An overlap that is
    drawn or given may stay between clamps: an interference fit is no contradiction. `factors` are by time and history;
    displacements are linear in between.
    """
    if any(isinstance(mover.side, Side) and (mover.side.clamps < 0).all() for mover in movers):
        return
    worst, message, law = 0.0, "", interface.law
    bonded = law.two_sided and not law.frictionless
    for held in _constrained(interface, movers):
        places = held.places
        for time, by_history in factors.items():
            gap = by_history[interface.gap_history] * places.gap[:, None]
            u = np.array([mover.moved(places, k, by_history) for k, mover in enumerate(movers)])
            closing, motions = u[0] - u[1], magnitude(u).sum(axis=0)
            beyond = (
                held.torn(closing, gap) if bonded else held.pressed(closing, gap, law.two_sided)
            )
            beyond[beyond <= SAME * (np.abs(gap) + motions[:, None])] = 0.0
            if not beyond.max(initial=0.0) > worst:
                continue
            worst = float(beyond.max())
            place, axis = map(int, np.unravel_index(np.argmax(beyond), beyond.shape))
            direction = held.axes[place, :, axis] if bonded else places.normal[place]
            along = np.flatnonzero(np.abs(direction) > SAME).tolist()
            first, second = (
                mover.words(places, k, place, along, u[k, place]) for k, mover in enumerate(movers)
            )
            assert isinstance(movers[0].side, Side)
            where = in_words(movers[0].at(places, 0, movers[0].side.xy)[place])
            when = f", at time {time:g}," * (len(factors) > 1)
            message = (
                f"contact.{interface.name}: at {where}{when} "
                f"{first}, and {second}: they {WRONG.get(law.name, 'push the bodies into each other')} by "
                f"{worst:.3g} {unit}, and no force can prevent that; prescribe motions that go together"
            )
    if message:
        raise InputError(message)


def _constrained(interface: Interface, movers: Sequence[Mover]) -> Iterator[Constrained]:
    """The places of an interface that show contradictions: rows and fixed nodes, or what lies between the nodes."""
    for places in [interface.probes] if interface.slave else [interface.rows, interface.fixed]:
        # Along eigenvectors of M_1 + M_2 with eigenvalue zero neither side can yield to a force. The sum is positive
        # semi-definite, as projections and means of them are.
        sizes, axes = np.linalg.eigh(sum(mover.free(places, k) for k, mover in enumerate(movers)))
        along = np.einsum("nd,ndk->nk", places.normal, axes)
        yield Constrained(places, axes, np.abs(sizes) > SAME, along)
