"""An approximate inverse of the joint contact compliance: the half-plane's stiffness on the interface.

Two elastic half-planes pressed by the stresses σ give way by u = (2/E*) |∂|⁻¹ σ, with 1/E* the sum of
the plane compliances (1−ν²)/E (Johnson, Contact Mechanics, 1985, ch. 2) and |∂| the square root of −d²/ds²
along the interface, with nothing moving where a clamp holds the next node; normal and tangential parts
decouple when the materials are alike, and nearly so else. Every body looks like a half-plane to loads that
vary over a few elements, which is what makes the compliance ill-conditioned; the few smooth modes that see
the body's shape are left to the Krylov method. So the preconditioner needs no second factorization, knows
the stiffness contrast, and costs O(m).

The root is taken of the discrete operator by quadrature of its integral,
    A^½ = A · (2/π) ∫₀^∞ (A + t²)⁻¹ dt,
with the trapezoidal rule in log t (exponentially convergent; Hale, Higham, Trefethen, SIAM J. Numer.
Anal. 46, 2008). All shifted systems are tridiagonal and solved in one call.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import lapack

from ddmpi.coupling.space import Space
from ddmpi.interface.interface import Interface

STEP = 1.0
"""Step of the quadrature in log t: its relative error is about 2 exp(−π²/STEP), here 1e-4."""

TAIL = 8.0
"""How far the quadrature goes beyond the spectrum, in log t: cuts off about exp(−TAIL)."""


class HalfPlaneStiffness:
    """P ≈ C⁻¹ (N/m): a block for each interface, which knows nothing of the others. Not collective."""

    def __init__(self, space: Space) -> None:
        self._blocks = [(part, _Block(interface)) for interface, part in space.each()]

    def mult(self, x: np.ndarray) -> np.ndarray:
        """P x (size,) in newtons, of x (size,) in metres."""
        y = np.empty_like(x)
        for part, block in self._blocks:
            y[part] = block.mult(x[part])
        return y


class _Block:
    """The half-plane's stiffness on one interface, normal and tangential parts apart."""

    def __init__(self, interface: Interface) -> None:
        self._sliding, self._law = interface.sliding, interface.law
        length = interface.area
        distance = np.linalg.norm(np.diff(interface.xy, axis=0), axis=1)
        link = np.where(interface.joined, 1.0 / np.where(distance > 0, distance, 1.0), 0.0)
        total = length.sum()
        diagonal = (1.5 / total) ** 2 + interface.held / length  # the longest wave is about the interface itself
        diagonal[1:] += link / length[1:]
        diagonal[:-1] += link / length[:-1]
        self._diagonal = diagonal
        self._off = -link / np.sqrt(length[1:] * length[:-1])
        self._root = np.sqrt(length)
        self._scale = 0.5 * interface.modulus

        lowest = 1.5 / total
        spread = 0.5 * np.log(2 * diagonal.max() / lowest**2)  # of the spectrum's root, free of units
        t = lowest * np.exp(np.arange(-TAIL, spread + TAIL + STEP, STEP))
        self._weights = (2 / np.pi) * STEP * t
        d = (diagonal + t[:, None] ** 2).ravel()
        e = np.tile(np.append(self._off, 0.0), len(t))[:-1]
        self._d, self._e, info = lapack.dpttrf(d, e)
        if info:
            raise ValueError("the shifted interface operators are not positive definite")

    def mult(self, x: np.ndarray) -> np.ndarray:
        y = np.empty_like(x)
        (normal, tangential), (to_normal, to_tangential) = self._law.split(x), self._law.split(y)
        to_normal[:] = self._apply(normal)
        if len(self._sliding):
            for component in range(self._law.components):
                spread = np.zeros(len(self._root))
                spread[self._sliding] = tangential[:, component]
                to_tangential[:, component] = self._apply(spread)[self._sliding]
        return y

    def _apply(self, x: np.ndarray) -> np.ndarray:
        y = self._root * x
        shifted, _ = lapack.dpttrs(self._d, self._e, np.tile(y, len(self._weights)))
        z = self._weights @ shifted.reshape(len(self._weights), -1)
        Az = self._diagonal * z
        Az[1:] += self._off * z[:-1]
        Az[:-1] += self._off * z[1:]
        return self._scale * self._root * Az
