"""Bodies without forces: of all places that the forces allow them, the one nearest to where they were before.

At a solution some rigid motions may change no gap of a node that bears a force, as those of a lid without load. Any of
them is an answer as long as no open node closes. The one taken is

    min ‖α − α₀‖²  over α with r ≥ 0 at open nodes, and r unchanged at nodes that bear,

with the motions α₀ before the load step. It is a least distance problem with few unknowns (Lawson and Hanson, Solving
Least Squares Problems, 1974, chapter 23).
"""

from __future__ import annotations

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.methods.newton import Newton
from ddmpi.run.held import islands
from ddmpi.system.agreement import from_first, gathered

NO_FORCE = 1e-9
"""Nodes bear a force above this fraction of the largest, and above what the tolerance allows forces to be wrong."""

UNCHANGED = 1e-6
"""Motions that change the gaps of nodes that bear by less than this fraction of themselves leave them as they are."""

ROUNDING, CLOSER = 1e-12, 1e-9
"""Gaps are met to the fraction ROUNDING of the way. A way by less than the fraction CLOSER of a motion is not gone."""

AT_ONCE, MOST = 50, 100
"""Open nodes that are added in a round, the nearest ones, and most rounds."""


def least_motion(assembly: Assembly, outer: Newton, before: np.ndarray, tolerance: float) -> None:
    """Move loose bodies, without a change of the forces of `outer`, to the motions nearest to those `before`
    (rigid.size,) in metres, if the equations hold there to the `tolerance` too. Collective."""
    joint, size = assembly.joint, assembly.joint.rigid.size
    if not assembly.loose:
        return
    free = ~joint.stays.bolts
    for partner in joint.driven:
        free[joint.slices[partner.name]] = False
    bears, opens = _rows(assembly, outer, tolerance)
    bearing = gathered(assembly.world, bears)

    def find() -> list[tuple[np.ndarray, np.ndarray]]:
        found = []
        for members in islands(
            {name: (count, numbers, R.T @ R) for name, (count, numbers, R) in bearing.items()},
            size,
            ~free,
            UNCHANGED,
        ):
            N = _null_space(bearing.values(), members, joint.stays.held)
            if N.size:
                found.append((members, N))
        return found

    freedoms = from_first(assembly.world, find)
    if not freedoms:
        return
    opening = gathered(assembly.world, opens)

    def choose() -> np.ndarray:
        way = np.zeros(size)
        for members, N in freedoms:
            rows, room = _rooms(opening.values(), members, N)
            wanted = N.T @ (before - outer.motions)[members]
            way[members] = N @ nearest(wanted, rows, room)
        return way

    way = from_first(assembly.world, choose)
    if np.abs(way).max() > CLOSER * max(np.abs(outer.motions).max(), np.abs(before).max()):
        outer.shift(way, tolerance)


def _rows(assembly: Assembly, outer: Newton, tolerance: float) -> tuple[dict, dict]:
    """By contact of this rank: the number of its nodes, the numbers (c,) of motions, and the triangle R (c, c) of
    how they move along these forces; and for open nodes their displacements (k, c) by motions, and gaps (k,). Not
    collective."""
    joint, space, bears, opens = assembly.joint, assembly.space, {}, {}
    s, r, nothing = outer.forces, outer.gaps, outer.negligible(NO_FORCE, tolerance)
    for interface, (part, numbers, block) in zip(space.interfaces, joint.rigid.blocks, strict=True):
        law, forces = interface.law, s[part]
        closed = (forces[: law.m] > nothing) | law.two_sided
        rubs = np.repeat(closed[law.sliding], law.components)
        acts = np.concatenate([closed, rubs])
        R = np.linalg.qr(np.vstack([block[acts], np.zeros((1, len(numbers)))]), mode="r")
        bears[interface.name] = law.m, numbers, R
        open_rows = block[: law.m][~closed]
        opens[interface.name] = numbers, open_rows, np.maximum(r[part][: law.m][~closed], 0.0)
    return bears, opens


def _null_space(bearing, members: np.ndarray, held: np.ndarray) -> np.ndarray:
    """N (j, q): the motions `members` that no force that bears resists, and that are not held; orthonormal columns."""
    rows = [held[members].T]
    for _, numbers, R in bearing:
        if np.isin(numbers, members).any():
            placed = np.zeros((len(R), held.shape[0]))
            placed[:, numbers] = R
            rows.append(placed[:, members])
    stacked = np.vstack([np.zeros((1, len(members))), *rows])
    _, values, vectors = np.linalg.svd(stacked)
    values = np.append(values, np.zeros(len(members) - len(values)))
    return vectors[values <= UNCHANGED * max(values.max(), 1e-300)].T


def _rooms(opening, members: np.ndarray, N: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rows (k, q) and room (k,) of the open nodes that the motions N x close."""
    rows, room = [np.zeros((0, N.shape[1]))], [np.zeros(0)]
    place = {number: k for k, number in enumerate(members.tolist())}
    for numbers, block, gaps in opening:
        ours = [k for k, number in enumerate(numbers.tolist()) if number in place]
        if ours:
            closing = block[:, ours] @ N[[place[number] for number in numbers[ours].tolist()]]
            rows.append(closing)
            room.append(gaps)
    return np.vstack(rows), np.concatenate(room)


def nearest(wanted: np.ndarray, rows: np.ndarray, room: np.ndarray) -> np.ndarray:
    """x (q,) with rows (k, q) · x ≤ room (k,) ≥ 0 that is nearest to `wanted` (q,)."""
    scale = float(np.linalg.norm(wanted))
    if not scale:
        return wanted
    start, limit = wanted / scale, room / scale
    chosen, x = np.zeros(0, int), start
    for _ in range(MOST):
        beyond = rows @ x - limit
        beyond[chosen] = 0.0
        new = np.argsort(-beyond, kind="stable")[:AT_ONCE]
        new = new[beyond[new] > ROUNDING]
        if not len(new):
            break
        chosen = np.append(chosen, new)
        x = start + _least_distance(-rows[chosen], rows[chosen] @ start - limit[chosen])
    most = float(np.max((rows @ x) / np.maximum(limit, 1e-300), initial=0.0))
    return scale * x if most <= 1.0 + 1e-6 or not (rows @ x - limit > 1e-9).any() else 0.0 * wanted


def _least_distance(G: np.ndarray, g: np.ndarray) -> np.ndarray:
    """The least y (q,) with G y ≥ g, by nonnegative least squares; exact on the rows that it touches."""
    from scipy.optimize import nnls

    target = np.append(np.zeros(G.shape[1]), 1.0)
    u, _ = nnls(np.vstack([G.T, g]), target)
    touched = u > 0.0
    if not touched.any():
        return np.zeros(G.shape[1])
    return np.linalg.lstsq(G[touched], g[touched], rcond=None)[0]
