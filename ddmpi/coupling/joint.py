"""The joint compliance of all bodies, an operator on the vectors of the interfaces."""

from __future__ import annotations

import numpy as np

from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.member import Body

STEERING = 0.1
"""Where the compliance is applied by an iterative solver: a product in GMRES need only be as precise as this times
what GMRES has left to do (Bouras and Frayssé, SIAM J. Matrix Anal. Appl. 26, 2005), since it steers, no more."""


class Joint:
    """C_1 + C_2, an operator in the sense of `qp`; collective on both bodies.

    Attributes
    ----------
    kept : forces (N) that do not matter in a product that is kept
    """

    def __init__(self, body: Body, exchange: Exchange) -> None:
        self.body, self.exchange, self.size = body, exchange, body.C.size
        self.kept = 0.0
        self._own = np.empty(self.size)

    def product(self, x: np.ndarray, purpose: str, relative: float | None = None) -> np.ndarray:
        """(C_1 + C_2) x, as a new vector, precise enough to be kept, or `relative` as for `Compliance.mult`."""
        y, size = np.empty(self.size), np.linalg.norm(x)
        if relative is None:
            relative = min(self.kept / size, STEERING) if size else 0.0
        self.mult(x, y, purpose, relative)
        return y

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← (C_1 + C_2) x; `relative` as for `Compliance.mult`."""
        with self.exchange.deferred():
            self.body.C.mult(x, self._own, purpose, relative)
        first, second = self.exchange.swap(self._own, purpose)
        np.add(first, second, out=y)

    def norm(self) -> float:
        """‖C_1‖ + ‖C_2‖, an estimate of the norm of the sum."""
        own = np.zeros(1)
        with self.exchange.deferred():
            own[0] = self.body.C.norm()
        return float(sum(n[0] for n in self.exchange.swap(own, "norm")))
