"""Bounds and discs as constraint sets: all that a solver asks of the set of feasible points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

SHORT = float(1 - 4 * np.finfo(float).eps)
"""Vectors are shortened to this fraction of their limit, so that none exceeds it by rounding and is shortened again."""


@dataclass
class Box:
    """The points x with lower ≤ x ≤ upper, (size,) each, infinite for no bound and equal where x is given.

    Gradients are those of the function that is minimized, so steps go along their negatives.
    """

    lower: np.ndarray
    upper: np.ndarray

    def project(self, x: np.ndarray) -> np.ndarray:
        """The feasible point nearest to x."""
        return np.clip(x, self.lower, self.upper)

    def projected_gradient(self, g: np.ndarray, x: np.ndarray) -> np.ndarray:
        """The part of the gradient g that the bounds do not hold at x: the free plus the chopped gradient."""
        p = np.where(x <= self.lower, np.minimum(g, 0.0), g)
        return np.where(x >= self.upper, np.maximum(p, 0.0), p)

    def split(self, g: np.ndarray, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The free gradient, of components between their bounds, and the chopped one, which leads off a bound."""
        inside = (x > self.lower) & (x < self.upper)
        return np.where(inside, g, 0.0), np.where(inside, 0.0, self.projected_gradient(g, x))

    def reduced(self, g: np.ndarray, x: np.ndarray, step: float) -> np.ndarray:
        """The gradient, cut so that x − step · reduced is the feasible point nearest to x − step · g."""
        return np.clip(g, (x - self.upper) / step, (x - self.lower) / step)

    def longest_step(self, x: np.ndarray, p: np.ndarray) -> float:
        """The largest t for which x − t p is feasible."""
        with np.errstate(divide="ignore", invalid="ignore"):
            room = np.where(
                p > 0, (x - self.lower) / p, np.where(p < 0, (x - self.upper) / p, np.inf)
            )
        return float(room.min(initial=np.inf))

    def holding(self, x: np.ndarray, free: slice) -> Box:
        """The points of the set whose components other than the `free` ones are those of x."""
        lower, upper = x.copy(), x.copy()
        lower[free], upper[free] = self.lower[free], self.upper[free]
        return Box(lower, upper)

    def scaled(self, unit: float) -> Box:
        """The box of x / unit."""
        return Box(self.lower / unit, self.upper / unit)

    def unscaled(self, x: np.ndarray, unit: float, near: float) -> np.ndarray:
        """The point unit · x of this box from x in the scaled one; within `near` of a bound it lies on it, exactly."""
        scaled, point = self.scaled(unit), self.project(unit * x)
        point = np.where(x <= scaled.lower + near, self.lower, point)
        return np.where(x >= scaled.upper - near, self.upper, point)


@dataclass
class Discs(Box):
    """A box, some of whose points' components are vectors in discs (balls) about zero, of `radius` (k,) ≥ 0.

    `entries` (k, c) are the indices of the components of the vectors, which the box leaves free. What MPRGP asks of a
    box (`split`, `projected_gradient`, `longest_step`) knows nothing of discs.
    """

    entries: np.ndarray
    radius: np.ndarray

    def project(self, x: np.ndarray) -> np.ndarray:
        y = super().project(x)
        y[self.entries] = shorten(y[self.entries], self.radius)
        return y

    def reduced(self, g: np.ndarray, x: np.ndarray, step: float) -> np.ndarray:
        cut, moved = super().reduced(g, x, step), (x - step * g)[self.entries]
        leaves = magnitude(moved) > self.radius
        discs = self.entries[leaves]
        cut[discs] = (x[discs] - shorten(moved[leaves], self.radius[leaves])) / step
        return cut

    def holding(self, x: np.ndarray, free: slice) -> Box:
        """As of a box; no disc is held in part. Without a disc that bounds what is free, it is a box."""
        box, moves = super().holding(x, free), np.zeros(len(x), bool)
        moves[free] = True
        bounds = moves[self.entries].all(axis=1) & np.isfinite(self.radius)
        return (
            Discs(box.lower, box.upper, self.entries[bounds], self.radius[bounds])
            if bounds.any()
            else box
        )

    def scaled(self, unit: float) -> Discs:
        return Discs(self.lower / unit, self.upper / unit, self.entries, self.radius / unit)


def product(sets: Sequence[Box]) -> Box:
    """The points whose parts, one after the other, lie in the `sets`. Their discs have equally many components."""
    lower, upper = (
        np.concatenate([getattr(box, name) for box in sets]) for name in ("lower", "upper")
    )
    starts = np.cumsum([0, *(len(box.lower) for box in sets)])
    discs = [
        (box.entries + start, box.radius)
        for box, start in zip(sets, starts, strict=False)
        if isinstance(box, Discs)
    ]
    if not discs:
        return Box(lower, upper)
    return Discs(lower, upper, *(np.concatenate(arrays) for arrays in zip(*discs, strict=True)))


def magnitude(vectors: np.ndarray) -> np.ndarray:
    """|v| (…) of vectors (…, c)."""
    return np.abs(vectors[..., 0]) if vectors.shape[-1] == 1 else np.linalg.norm(vectors, axis=-1)


def shorten(vectors: np.ndarray, limit: np.ndarray) -> np.ndarray:
    """The nearest vectors (k, c) that are no longer than the limits (k,), also after rounding."""
    if vectors.shape[1] == 1:
        return np.minimum(
            np.maximum(vectors, -limit[:, None]), limit[:, None]
        )  # np.clip takes twice the time
    size = magnitude(vectors)
    return (
        vectors
        * np.where(size > limit, SHORT * limit / np.where(size > limit, size, 1.0), 1.0)[:, None]
    )


def dots(v: np.ndarray, w: np.ndarray) -> np.ndarray:
    """v·w (k, 1) of vectors (k, c)."""
    return (v * w).sum(axis=1, keepdims=True)


def cone_room(limit: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """limit² − |v|² (k, 1) of vectors (k, c) and limits (k, 1)."""
    size = magnitude(vectors)[:, None]
    return (limit - size) * (limit + size)


def cone_exit(
    limit: np.ndarray, vectors: np.ndarray, more: np.ndarray, change: np.ndarray
) -> np.ndarray:
    """1/t (k, 1) for the least t > 0 with |v + t `change`| = limit + t `more`; zero where there is none.

    Vectors (k, c) are inside their limits (k, 1).
    """
    room, b, a = (
        cone_room(limit, vectors),
        limit * more - dots(vectors, change),
        more**2 - dots(change, change),
    )
    root = np.sqrt(np.maximum(b**2 - a * room, 0.0))
    return np.where(root > b, (root - b) / room, 0.0)
