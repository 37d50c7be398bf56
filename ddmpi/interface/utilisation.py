"""How much of the friction that a contact could bear it bears."""

from __future__ import annotations

import numpy as np

from ddmpi.sets import magnitude
from ddmpi.system.numbers import divisor

PRECISE = 1e-7
"""Relative distance of the bounds on the factor at which the search ends."""

SPANNED = 1e-10
"""A motion that moves the contact by less than this fraction of what others move it does not move it."""

MOST = 400  # steps; contacts of 20,000 nodes take about 100, most of others 20


def largest_factor(motions: np.ndarray, shares: np.ndarray) -> float:
    """The largest factor α by which the resultants of friction can grow within the bounds of the nodes.

    By the static theorem of limit analysis it is max α subject to Σ gᵢ Vᵢᵀ τᵢ = α Σ gᵢ Vᵢᵀ tᵢ and |τᵢ| ≤ 1, and by the
    kinematic one the least Σ gᵢ |Vᵢ y| of all motions y along which the friction has the power Σ gᵢ tᵢ · Vᵢ y = 1. The
    logarithmic barrier of the discs |τᵢ| ≤ 1 ties the two together in Newton's method for y (Nesterov and Nemirovskii,
    Interior-point polynomial algorithms in convex programming, 1994). Each step bounds α from both sides.

        >>> pulled = np.array([[[1.0]], [[2.0]]])  # two nodes with the bounds 1 and 2, and one motion along them
        >>> round(largest_factor(pulled, np.array([[1.0], [0.25]])), 6)  # of 3 they bear 1.5
        2.0

    Parameters
    ----------
    motions : (n, c, k) bound g times the displacement V along the c tangents of each node, of k rigid motions
    shares : (n, c) friction t of each node over its bound, |t| ≤ 1

    Returns the lower of the two bounds, at least 1; infinite where the friction has no resultants. Not collective.
    """
    vectors, sizes, _ = np.linalg.svd(motions.reshape(shares.size, -1), full_matrices=False)
    basis = vectors[:, sizes > SPANNED * sizes[0]]  # orthonormal: no units
    wanted = basis.T @ shares.ravel()
    if not wanted.any():
        return np.inf
    moves = basis.reshape(*shares.shape, -1)
    y = wanted / (wanted @ wanted)
    barrier, least, most = 0.0, 1.0, np.inf
    for _ in range(MOST):
        speeds = moves @ y
        size = magnitude(speeds)
        most = min(most, size.sum() / (wanted @ y))
        barrier = barrier or size.mean()
        root = np.hypot(barrier, size)
        # maximises τ · V y + barrier log(1 − |τ|²)
        friction = speeds / (root + barrier)[:, None]
        ahead = speeds / divisor(size)[:, None]
        along = np.einsum("ncj,nc->nj", moves, ahead)
        across = (moves - ahead[:, :, None] * along[:, None]).reshape(*basis.shape)
        weight = np.repeat(1.0 / (root + barrier), shares.shape[1])
        bends = (across.T * weight) @ across
        bends += (along.T * (barrier / root / (root + barrier))) @ along
        # along y it bends by rounding alone, but the power of y stays 1
        held = bends + np.trace(bends) / (wanted @ wanted) * np.outer(wanted, wanted)
        resultants = basis.T @ friction.ravel()
        one, other = np.linalg.solve(held, np.column_stack([resultants, wanted])).T
        factor = (wanted @ one) / (wanted @ other)
        # the nearest friction with resultants that are a multiple of the wanted ones, shortened into the discs
        near = friction - moves @ (resultants - factor * wanted)
        least = max(least, factor / max(1.0, magnitude(near).max()))
        if most - least <= PRECISE * most:
            break
        step = factor * other - one
        decrement = np.sqrt(max(step @ bends @ step, 0.0) / barrier)
        close = decrement < 1.0
        y = y + step / (1.0 if close else 1.0 + decrement)
        if close and size.sum() - factor > 0.5 * PRECISE * most:
            barrier *= 0.1
    return float(least)
