"""Anderson acceleration of the published outer map, with weights for unlike bodies.

The map of the slides, λ ↦ λ + θ (B_1 w_1 + B_2 w_2), converges slowly or diverges when the bodies differ in stiffness.
So the Neumann displacement of a body has the square of its share of the stiffness as a weight (weighted
Neumann–Neumann), and the stiffer body takes role 1. With Anderson acceleration (Anderson 1965; Walker and Ni, SIAM J.
Numer. Anal. 49, 2011) θ matters little, but inner solves must be more precise than in the published iteration.
"""

from __future__ import annotations

from statistics import harmonic_mean
from typing import Any

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.methods.outer import Report, no_report
from ddmpi.published.published import PublishedIteration
from ddmpi.scene.method import SettledMethod
from ddmpi.system.numbers import norm

DEPTH = 10
"""Number of earlier steps in the memory."""

MIXING = 0.5
"""θ of the accelerated map."""

PRECISION = 1e-3
"""η, the precision of inner solves over the last outer update."""

GROWTH = 2.0
"""The memory is dropped when the residual exceeds the smallest so far by this factor."""


class AndersonIteration(PublishedIteration):
    """As `PublishedIteration`, for the original algorithm without splitting.

    The weights are the bodies' shares of the sum of their plane moduli; of several materials, the harmonic mean counts.
    """

    def __init__(
        self, assembly: Assembly, method: SettledMethod, report: Report = no_report
    ) -> None:
        (interface,) = assembly.bodies[0].member.interfaces
        bodies = {body.name: body for body in assembly.scene.body}
        moduli = [
            harmonic_mean([material.plane_modulus for material in bodies[name].materials])
            for name in interface.bodies
        ]
        lead = int(moduli[1] > moduli[0])  # with the softer body in role 1 convergence is slow
        super().__init__(assembly, method, report, lead, PRECISION)
        self._weights = moduli[lead] / sum(moduli), moduli[1 - lead] / sum(moduli)
        self._lams: list[np.ndarray] = []
        self._residuals: list[np.ndarray] = []
        self._smallest = np.inf

    def advance(self, w1: np.ndarray, w2: np.ndarray) -> np.ndarray:
        """The accelerated update of λ (m)."""
        # weighted Neumann–Neumann; the factor 4 makes equal weights ½ the published map
        a1, a2 = self._weights
        f = 4.0 * (a1**2 * w1 + a2**2 * w2)
        size = norm(f)
        if size > GROWTH * self._smallest:
            self._lams, self._residuals, self._smallest = [], [], np.inf
        self._smallest = min(self._smallest, size)
        self._lams.append(self.lam.copy())
        self._residuals.append(f)
        del self._lams[: -DEPTH - 1], self._residuals[: -DEPTH - 1]
        if len(self._lams) == 1:
            return MIXING * f
        # the combination of earlier steps with the least residual f − F γ; then a step of the map from there
        X = np.diff(np.array(self._lams), axis=0).T
        F = np.diff(np.array(self._residuals), axis=0).T
        gamma = np.linalg.lstsq(F, f, rcond=1e-12)[0]
        return MIXING * f - (X + MIXING * F) @ gamma

    def state(self) -> dict[str, Any]:
        return super().state() | {
            "lams": list(self._lams),
            "residuals": list(self._residuals),
            "smallest": self._smallest,
        }

    def restore(self, state: dict[str, Any]) -> None:
        super().restore(state)
        self._lams, self._residuals = list(state["lams"]), list(state["residuals"])
        self._smallest = state["smallest"]
