"""The passes of a load step in which free frames settle, and groups of bodies that settle by themselves.

A group is what contacts join by way of free frames. It moves, settles and is given up as in a scene of its own, so that
the number of groups does not matter. A pass turns none of its bodies by more than `FARTHEST`. What has to turn farther
is on its way, and makes progress, until it has gone round once: then everything is as it was, and loads would drive it
on for ever.
"""

from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.body.rigid_motions import FreeFrame
from ddmpi.coupling.assembly import Assembly
from ddmpi.interface.interface import Interface
from ddmpi.judge.diagnosis import StatusLog
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import Step
from ddmpi.system.numbers import SAME, norm

PASSES, SETTLED, SHRINKS, PATIENCE = 40, 1e-8, 0.7, 6
"""Most passes of a group beside those on its way. Frames have settled once α moves contacts by less than SETTLED of what
forces do, and do not settle if PATIENCE passes together leave more than SHRINKS of what was left before."""

NEAR, DEPTH, BACK = 0.3, 3, 0.9
"""Once α moves contacts by less than NEAR of what forces do, up to DEPTH passes before make the next motion of the
frames, see `_mixed`. Earlier than that, bodies may leave each other, unless α goes back the way it came: where the cosine
of this is above BACK, the pass before makes the next motion, which is then less than α."""

FARTHEST, ROUND = 15.0, 360.0
"""The largest turn of a frame in a pass, and once round (degrees)."""


class Group:
    """Bodies and partners with free frames that contacts join, and their passes so far.

    Parameters
    ----------
    free : their frames, by name
    at : (rigid.size,) bool, their motions
    slices : of these by name, as of a `Joint`

    Attributes
    ----------
    far : whether it would turn farther than frames do in a pass
    """

    def __init__(
        self, free: Mapping[str, FreeFrame], at: np.ndarray, slices: Mapping[str, slice]
    ) -> None:
        self.free, self.at, self._slices = free, at, slices
        self._turned = dict.fromkeys(free, 0.0)  # since the step began (degrees)
        self._number, self._least, self._idle, self.far = 0, np.inf, 0, False
        self._changes = list[tuple[np.ndarray, np.ndarray]]()

    def owns(self, interface: Interface) -> bool:
        """Whether it moves the sides of a contact."""
        return not self.free.keys().isdisjoint(interface.bodies)

    @property
    def on_its_way(self) -> bool:
        """Whether turning far is progress: no body has gone round."""
        return max(self._turned.values()) < ROUND

    def useless(self, far_off: float) -> bool:
        """Whether another pass is useless, after one whose α moves contacts by `far_off` (m), which has not settled."""
        self._number += 1
        if far_off <= SHRINKS * self._least:
            self._least, self._idle = far_off, 0
        else:
            self._idle += 1
        return self._idle == PATIENCE or self._number >= PASSES

    def next(self, alpha: np.ndarray, near: bool) -> np.ndarray:
        """How its frames move after a pass with the motions α (rigid.size,) by what the passes before say if they are
        `near` to where they settle, or α goes back: (rigid.size,), zero for others."""
        own, before = alpha * self.at, self._changes[-DEPTH:]
        if not near:
            before = [
                each for each in before[-1:] if own @ each[0] < -BACK * norm(own) * norm(each[0])
            ]
        step = self._limited(_mixed(before, own))
        self._changes = [] if self.far else [*before, (own, step)]
        return step

    def drive(self, turn: np.ndarray) -> np.ndarray:
        """How its frames move along a held `turn` (rigid.size,) that loads drive. What the passes before left is
        forgotten."""
        self._changes, self._least, self._idle = [], np.inf, 0
        return self._limited(turn * self.at)

    def _limited(self, step: np.ndarray) -> np.ndarray:
        """The share of a step that turns no frame too far; noted."""
        turns = {name: each.turn(step[self._slices[name]]) for name, each in self.free.items()}
        most = max(turns.values())
        share, self.far = FARTHEST / max(most, FARTHEST), most > FARTHEST
        if self.far and self.on_its_way:
            self._number, self._least, self._idle = self._number - 1, np.inf, 0
        for name, turn in turns.items():
            self._turned[name] += share * turn
        return share * step


class Passes:
    """The passes of a step so far.

    Attributes
    ----------
    groups : that settle by themselves
    number : of the present one
    steps, counts : of all passes before the present one, as of `Outer` and `StatusLog`
    """

    def __init__(self, groups: Sequence[Group]) -> None:
        self.groups, self.number = groups, 1
        self.steps, self.counts = list[Step](), list[tuple[int, int, int]]()

    def next(
        self,
        alpha: np.ndarray,
        driven: np.ndarray,
        far_off: np.ndarray,
        settled: np.ndarray,
        near: np.ndarray,
    ) -> tuple[np.ndarray, bool]:
        """How frames move next (rigid.size,), and whether another pass is useless.

        Parameters
        ----------
        alpha, driven : (rigid.size,) the motions after this pass, and held ones that loads drive
        far_off, settled, near : (groups,) how far α moves the contacts of each (m), and whether that is little
        """
        step, useless = np.zeros(len(alpha)), False
        for group, off, done, close in zip(self.groups, far_off, settled, near, strict=True):
            useless |= not done and group.useless(off)
            turn = driven * group.at
            step += group.drive(turn) if turn.any() else group.next(alpha, not done and close)
        return step, useless

    def went(self, outer: Newton, statuses: StatusLog) -> None:
        """Note that one more pass begins."""
        self.number += 1
        self.steps += outer.history
        self.counts += statuses.counts

    def join(self, outer: Newton, statuses: StatusLog) -> None:
        """Let the record of the last pass have the steps of all."""
        rows = [*self.steps, *outer.history]
        outer.history[:] = [row._replace(iteration=k) for k, row in enumerate(rows, 1)]
        statuses.counts[:0] = self.counts


def groups_of(assembly: Assembly) -> list[Group]:
    """The groups of a scene, the same on all ranks."""
    free, slices = assembly.free, assembly.joint.slices
    numbers = {name: number for number, name in enumerate(free)}
    pairs = [each.bodies for each in assembly.scene.contact if numbers.keys() >= {*each.bodies}]
    links = np.array([[numbers[name] for name in pair] for pair in pairs], int).reshape(-1, 2)
    graph = sparse.csr_matrix((np.ones(len(links)), links.T), (len(numbers),) * 2)
    count, labels = csgraph.connected_components(graph, directed=False)
    groups = []
    for label in range(count if numbers else 0):
        own = {name: free[name] for name, number in numbers.items() if labels[number] == label}
        at = np.zeros(assembly.joint.rigid.size, bool)
        for name in own:
            at[slices[name]] = True
        groups.append(Group(own, at, slices))
    return groups


def _mixed(changes: Sequence[tuple[np.ndarray, np.ndarray]], alpha: np.ndarray) -> np.ndarray:
    """How the frames move next (Anderson, J. ACM 12, 1965): by α, less what the passes before say of it, whose α and
    steps are `changes`."""
    if not changes:
        return alpha
    alphas = np.diff([*(former for former, _ in changes), alpha], axis=0)
    return alpha - np.linalg.lstsq(alphas.T, alpha, rcond=SAME)[0] @ (
        np.array([step for _, step in changes]) + alphas
    )
