"""Small helpers with numbers."""

from __future__ import annotations

import numpy as np


def norm(x: np.ndarray) -> float:
    """‖x‖₂ of a vector."""
    return float(np.linalg.norm(x))


def bisect(points: np.ndarray, parts: int) -> np.ndarray:
    """The part (k,) of each of the `points` (k, d): halves along the longest extent, halved again. Not collective.

    Parts are as large as each other to within one point for each halving, and depend on the points alone.
    """
    part = np.zeros(len(points), dtype=np.int64)
    todo = [(np.arange(len(points)), 0, parts)]
    while todo:
        members, first, number = todo.pop()
        part[members] = first
        if number > 1 and len(members):
            axis = int(np.ptp(points[members], axis=0).argmax())
            others = [points[members, k] for k in range(points.shape[1]) if k != axis]
            order = members[np.lexsort((*others, points[members, axis]))]
            cut = len(members) * (number // 2) // number
            todo += [(order[:cut], first, number // 2), (order[cut:], first + number // 2, number - number // 2)]
    return part
