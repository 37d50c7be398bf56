"""The norm of a symmetric operator by a few Lanczos steps."""

from __future__ import annotations

import numpy as np
from scipy.linalg import eigh_tridiagonal


def estimate_norm(mult, size: int, change: float = 1e-2, limit: int = 30) -> float:
    """Estimate ‖H‖₂ of a symmetric positive definite H by the Lanczos method, from below.

    Parameters
    ----------
    mult : mult(x, y) does y ← H x for (size,) arrays
    change : relative change of the estimate at which it stops
    limit : largest number of multiplications

    Collective where `mult` is. Returns NaN if a product is not finite.
    """
    v = 1.0 + 0.3 * np.random.default_rng(0).standard_normal(size)  # the same in every run, and in no eigenspace
    basis, diagonal = [v / np.linalg.norm(v)], []
    off: list[float] = []
    y = np.empty(size)
    norm = 0.0
    for _ in range(min(limit, size)):
        mult(basis[-1], y)
        if not np.isfinite(y).all():
            return float("nan")
        diagonal.append(basis[-1] @ y)
        V = np.array(basis)
        r = y - V.T @ (V @ y)
        r -= V.T @ (V @ r)
        previous, norm = norm, eigh_tridiagonal(diagonal, off, eigvals_only=True)[-1]
        left = np.linalg.norm(r)
        if abs(norm - previous) <= change * norm or left <= 1e-14 * norm:
            break
        off.append(float(left))
        basis.append(r / left)
    return float(norm)
