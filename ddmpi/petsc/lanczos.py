"""The norm of a symmetric operator by a few Lanczos steps."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from scipy.linalg import eigh_tridiagonal

CHANGE, MOST = 1e-2, 30
"""Relative change of the estimate at which it stops, and most multiplications."""

Product = Callable[[np.ndarray, np.ndarray], None]


def estimate_norm(
    mult: Product,
    size: int,
    products: Callable[[np.ndarray, np.ndarray], np.ndarray] = np.matmul,
    steps: int | None = None,
) -> float:
    """Estimate ‖H‖₂ of a symmetric positive definite H by the Lanczos method, from below.

    Parameters
    ----------
    mult : mult(x, y) does y ← H x for (size,) arrays, of which each rank has a part
    products : of the rows of a matrix (k, size) with a vector, over all ranks
    steps : length of the vectors of all ranks together

    Collective where `mult` is. Returns NaN if a product is not finite.
    """

    def length(x: np.ndarray) -> float:
        return float(np.sqrt(products(x[None], x)[0]))

    v = 1.0 + 0.3 * np.random.default_rng(0).standard_normal(
        size
    )  # the same in every run, with all eigenvectors
    basis, diagonal = [v / length(v)], []
    off: list[float] = []
    y = np.empty(size)
    norm = 0.0
    for _ in range(min(MOST, size if steps is None else steps)):
        mult(basis[-1], y)
        if not np.isfinite(length(y)):
            return float("nan")
        V = np.array(basis)
        along = products(V, y)
        diagonal.append(float(along[-1]))
        # Full reorthogonalisation: without it Lanczos vectors lose orthogonality once an eigenvalue has converged.
        r = y - V.T @ along
        r -= V.T @ products(V, r)
        previous, norm = norm, eigh_tridiagonal(diagonal, off, eigvals_only=True)[-1]
        left = length(r)
        if abs(norm - previous) <= CHANGE * norm or left <= 1e-14 * norm:
            break
        off.append(float(left))
        basis.append(r / left)
    return float(norm)
