"""Anderson acceleration of the published outer map, with weights for unlike bodies.

The map of the slides, λ ↦ λ + θ (B_1 w_1 + B_2 w_2), crawls or diverges when the bodies differ in
stiffness. Two cures: each body's Neumann displacement is weighted with the square of its share of the
stiffness (weighted Neumann–Neumann), and the stiffer body takes role 1 (the caller's business). Anderson
acceleration (Anderson 1965; Walker and Ni, SIAM J. Numer. Anal. 49, 2011) makes the relaxation harmless.
It needs inner solves that are more precise than the published rule asks for.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ddmpi.methods.published import OuterIteration

DEPTH = 10
"""How many earlier steps are remembered."""

MIXING = 0.5
"""θ of the accelerated map."""

PRECISION = 1e-3
"""η: inner solves are as precise as this times the last outer update."""

GROWTH = 2.0
"""The memory is dropped when the residual exceeds the smallest so far by this factor."""


@dataclass
class AndersonIteration(OuterIteration):
    """As `OuterIteration`, for the original algorithm without splitting.

    Parameters
    ----------
    weights : shares of role 1's and role 2's body in the sum of their moduli; they add up to one
    """

    STATE = (*OuterIteration.STATE, "_lams", "_residuals", "_smallest")

    weights: tuple[float, float] = (0.5, 0.5)
    algorithm = "original"
    splitting = "none"
    precision = PRECISION

    def __post_init__(self) -> None:
        super().__post_init__()
        self._lams: list[np.ndarray] = []
        self._residuals: list[np.ndarray] = []
        self._smallest = np.inf

    def advance(self, w1: np.ndarray, w2: np.ndarray) -> np.ndarray:
        """The accelerated update of λ (m)."""
        a1, a2 = self.weights
        f = 4.0 * (a1**2 * w1 + a2**2 * w2)
        size = np.linalg.norm(f)
        if size > GROWTH * self._smallest:
            self._lams, self._residuals, self._smallest = [], [], np.inf
        self._smallest = min(self._smallest, size)
        self._lams.append(self.lam.copy())
        self._residuals.append(f)
        del self._lams[:-DEPTH - 1], self._residuals[:-DEPTH - 1]
        if len(self._lams) == 1:
            return MIXING * f
        X = np.diff(np.array(self._lams), axis=0).T
        F = np.diff(np.array(self._residuals), axis=0).T
        gamma = np.linalg.lstsq(F, f, rcond=1e-12)[0]
        return MIXING * f - (X + MIXING * F) @ gamma
