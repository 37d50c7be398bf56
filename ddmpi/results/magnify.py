"""By which factor a picture enlarges deformations, and where it draws the bodies, so that what touches touches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ddmpi.results.reader import Columns, Results

DRAWN = 0.08
"""Displacements and shifts are drawn as at most this fraction of the bodies' extent."""

INVISIBLE = 0.002
"""Errors of at most this fraction of the bodies' extent cannot be seen in a picture: two pixels."""


@dataclass(frozen=True)
class _Pairs:
    """The nodes of one contact.

    Attributes
    ----------
    bodies : numbers of the first and the second body
    before : (m, 2) from the first to the second body's node along the normal, undeformed (m)
    normal : (m, 2) of the first body
    gap : (m,) deformed (m)
    touching : (m,) bool
    """

    bodies: list[int]
    before: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    touching: np.ndarray

    def distance(self) -> np.ndarray:
        """(2,) mean distance of the undeformed nodes that will touch; of all nodes if none will."""
        return self.before[self.touching if self.touching.any() else slice(None)].mean(axis=0)

    def limits(self, shift: np.ndarray, visible: float) -> Iterator[float]:
        """The largest magnifications at which errors are not `visible` (m), `shift` being per unit of F − 1.

        The nodes are drawn F times as far apart as they are, but for (F − 1) `left`.
        """
        left = self.before - shift
        wrong = np.linalg.norm(left[self.touching], axis=1).max(initial=0.0)
        if wrong:
            yield 1.0 + visible / wrong
        into = np.einsum("ij,ij->i", left, self.normal)
        overlapping = into > self.gap
        yield from (visible + into[overlapping]) / (into - self.gap)[overlapping]


def magnify(results: Results) -> tuple[float, np.ndarray]:
    """The magnification F and a shift (nv, 2) in metres: a node at x that moves by u is drawn at x + shift + F u.

    Each body is shifted as a whole, by F − 1 times the gap that its contact had at first; negative for an overlap.
    Nodes are then drawn F times as far apart as they are, and touch where they touch. If gaps vary, as in rings, this
    holds for their mean only. F is then so small that no error at touching nodes, and no overlap at others, is visible;
    at F = 1 there are none. A scene that gives ``output.magnification`` accepts what it does. Not collective.
    """
    points, u = results.fields["points"][:, :2], results.fields["displacement"][:, :2]
    owner = np.zeros(len(points), int)
    owner[results.fields["cells"]] = results.fields["body"][:, None]
    names = list(results.summary["bodies"])
    pairs = [_pairs(results.contacts[contact["name"]], [names.index(name) for name in contact["bodies"]], owner, points,
                    u) for contact in results.summary["scene"]["contact"]]
    apart = np.zeros((len(pairs), len(names)))
    for row, each in zip(apart, pairs, strict=True):
        row[each.bodies] = -1.0, 1.0
    moved, mobile = np.linalg.norm(u, axis=1), np.zeros(len(names))
    np.maximum.at(mobile, owner, moved)
    distances = np.array([each.distance() for each in pairs]).reshape(-1, 2)
    shifts = mobile[:, None] * (np.linalg.pinv(apart * mobile) @ distances)  # mostly of the body that moves most
    extent, size = np.ptp(points, axis=0).max(), max(moved.max(), np.abs(shifts).max())
    limits = [limit for each, shift in zip(pairs, apart @ shifts, strict=True)
              for limit in each.limits(shift, INVISIBLE * extent)]
    chosen = _round_down(min([DRAWN * extent / size, *limits])) if size else 1.0
    factor = results.summary["scene"]["output"].get("magnification") or max(chosen, 1.0)
    return factor, (factor - 1.0) * shifts[owner]


def _pairs(nodes: Columns, bodies: list[int], owner: np.ndarray, points: np.ndarray, u: np.ndarray) -> _Pairs:
    """The pairs of a contact. The second body's node is the one nearest to where gap and slip say that it has moved."""
    from scipy.spatial import cKDTree

    xy, normal = (np.column_stack([nodes[x], nodes[y]]) for x, y in (("x", "y"), ("nx", "ny")))
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    ours, theirs = (np.flatnonzero(owner == body) for body in bodies)
    moved = xy + u[ours][cKDTree(points[ours]).query(xy)[1]]
    opposite = moved + nodes["gap"][:, None] * normal - nodes["slip"][:, None] * tangent
    partner = theirs[cKDTree(points[theirs] + u[theirs]).query(opposite)[1]]
    before = np.einsum("ij,ij->i", points[partner] - xy, normal)[:, None] * normal
    return _Pairs(bodies, before, normal, nodes["gap"], nodes["status"] != "open")


def _round_down(factor: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed `factor`."""
    power = 10.0 ** np.floor(np.log10(factor))
    return float(power * max(d for d in (1, 2, 5) if d * power <= factor * (1 + 1e-12)))
