"""The joint compliance of all bodies, an operator on the vectors of the interfaces."""

from __future__ import annotations

from contextlib import AbstractContextManager

import numpy as np

from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.member import Member
from ddmpi.coupling.space import Space

STEERING = 0.1
"""Where the compliance is applied by an iterative solver: a product in GMRES need only be as precise as this times
what GMRES has left to do (Bouras and Frayssé, SIAM J. Matrix Anal. Appl. 26, 2005), since it steers, no more."""


class Joint:
    """C = Σ C_a over the bodies a, and the free gaps d = Σ h_a − gap; an operator in the sense of `qp`.

    What stands above this class works on vectors of the `space` and never hears of a body. All methods that
    multiply or add up are collective on all bodies, and raise what any of them raises.

    Attributes
    ----------
    space : the layout of the vectors
    size : their length
    d : (size,) how far the bodies would overlap without contact forces (m); r = C s − d are the gaps under forces s
    neglected : forces (N) that do not matter in a product that is kept
    """

    def __init__(self, member: Member, exchange: Exchange, space: Space) -> None:
        self.space, self.size = space, space.size
        self.neglected = 0.0
        self._member, self._exchange = member, exchange
        self._own = np.empty(self.size)
        self.d = exchange.total(member.h, "free displacement") - space.gap

    def product(self, x: np.ndarray, purpose: str, relative: float | None = None) -> np.ndarray:
        """C x (size,), as a new vector, precise enough to be kept, or `relative` as for `Compliance.mult`."""
        y, size = np.empty(self.size), self.space.norm(x)
        if relative is None:
            relative = min(self.neglected / size, STEERING) if size else 0.0
        self.mult(x, y, purpose, relative)
        return y

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x (metres from newtons), both (size,); `relative` as for `Compliance.mult`."""
        with self.deferred():
            self._member.C.mult(x, self._own, purpose, relative)
        y[:] = self._exchange.total(self._own, purpose)

    def norm(self) -> float:
        """Σ ‖C_a‖ (m/N), an estimate of the norm of the sum."""
        own = np.zeros(1)
        with self.deferred():
            own[0] = self._member.C.norm()
        return float(self._exchange.total(own, "norm")[0])

    def dense(self) -> np.ndarray:
        """C (size, size) as a dense matrix (m/N)."""
        own = np.empty((0, 0))
        with self.deferred():
            own = self._member.C.dense()
        self.meet("dense matrix")
        first, second = self._exchange.swap_objects(own)
        return first + second

    def multiplications(self) -> int:
        """Multiplications by A_a⁻¹ so far, of all bodies."""
        return int(self._exchange.total(np.array([float(self._member.C.count.total())]), "count")[0])

    def deferred(self) -> AbstractContextManager[None]:
        """Run local work; an error in it is raised on all ranks at the next product or `meet`."""
        return self._exchange.deferred()

    def meet(self, about: str) -> None:
        """Raise a deferred error of any rank on all of them."""
        self._exchange.swap(np.zeros(1), about)
