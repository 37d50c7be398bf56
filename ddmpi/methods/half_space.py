"""An approximate inverse of the joint contact compliance: the half-space's stiffness on the interface.

Two elastic half-spaces pressed by the stresses σ give way by u = (2/E*) |∂|⁻¹ σ, with 1/E* the sum of (1−ν²)/E of both
(Johnson, Contact Mechanics, 1985, ch. 2 and 3) and |∂| the square root of −Δ along the interface. Normal and tangential
parts decouple when the materials are alike, and nearly so else. Every body looks like a half-space to loads that vary
over a few elements, which is what makes the compliance ill-conditioned; the few smooth modes that see the body's shape
are left to the Krylov method. So the preconditioner needs no second factorization and knows the stiffness contrast.

−Δ is the Laplacian K of the interface's facets over its nodal areas W, so that M = (E*/2) W^½ A^½ W^½ with
A = W^−½ K W^−½ + (1.5/L)²: the longest wave is about the interface itself, whose length is L. The root is a sum over
few shifts, A^½ = Σ w (1 − t²(A + t²)⁻¹) (method 3 of Hale, Higham, Trefethen, SIAM J. Numer. Anal. 46, 2008).
"""

from __future__ import annotations

import copy
from collections.abc import Sequence

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import splu
from scipy.special import ellipj, ellipkm1

from ddmpi.coupling.member import Member
from ddmpi.coupling.space import Space
from ddmpi.interface.interface import Interface

SHIFTS = 6
"""Terms of the root: its relative error is about exp(−2π² SHIFTS/(ln κ + 3)), 1e-3 at a condition κ of A of 1e6."""

MODE_STEPS, MODE_PRECISION = 60, 0.05
"""Most Lanczos steps that look for a body's smooth modes, and their relative error; they only precondition."""


class HalfSpace:
    """M ≈ C⁻¹ (N/m): a block for each interface, which knows nothing of the others. Not collective."""

    def __init__(self, space: Space) -> None:
        self._parts = list(space.parts.values())
        self._blocks = [_Block(interface) for interface in space.interfaces]

    def softened(self, deltas: Sequence[float]) -> HalfSpace:
        """(1 + δ) (M⁻¹ + δ/c)⁻¹: half-spaces behind a layer, δ of each interface, c as `Interface.stiffness`."""
        found = copy.copy(self)
        found._blocks = [block.softened(delta) for block, delta in zip(self._blocks, deltas, strict=True)]
        return found

    def mult(self, x: np.ndarray) -> np.ndarray:
        """M x (size,) in newtons, of x (size,) in metres."""
        y = np.empty_like(x)
        for part, block in zip(self._parts, self._blocks, strict=True):
            y[part] = block.mult(x[part, None])[:, 0]
        return y

    def on_interface(self, number: int, x: np.ndarray) -> np.ndarray:
        """M x (its size, c) in newtons, of columns x in metres on the interface with this number."""
        return self._blocks[number].mult(x)


class _Block:
    """The half-space's stiffness on one interface, normal and tangential parts apart."""

    def __init__(self, interface: Interface) -> None:
        self._sliding, self._components = interface.sliding, interface.law.components * (len(interface.sliding) > 0)
        self._root, self._scale = np.sqrt(interface.area)[:, None], 0.5 * interface.modulus
        self._spacing = float(np.mean(self._scale * interface.area / interface.stiffness[:interface.m]))
        lowest = (1.5 / interface.length) ** 2
        over = sparse.diags(1.0 / self._root[:, 0])
        one = sparse.identity(interface.m)
        A = (over @ interface.laplacian @ over + lowest * one).tocsr()
        modulus = lowest / (2.0 * A.diagonal().max())
        quarter = ellipkm1(modulus)
        sn, cn, dn, _ = ellipj((np.arange(SHIFTS) + 0.5) * quarter / SHIFTS, 1.0 - modulus)
        self._weights = 2.0 * quarter * np.sqrt(lowest) / (np.pi * SHIFTS) * dn / cn**2
        self._shifts, self._lowest, self._sum = lowest * (sn / cn) ** 2, lowest, self._weights.sum()
        self._shifted = splu(sparse.block_diag([A + t * one for t in self._shifts], format="csc"))

    def softened(self, delta: float) -> _Block:
        """With R/(1 + bR) = 2/π ∫ (1 − t²(A + t²)⁻¹) / (1 + b²t²) dt for the root R, b being δ node distances."""
        found, b = copy.copy(self), delta * self._spacing
        found._scale, found._weights = self._scale * (1.0 + delta), self._weights / (1.0 + b**2 * self._shifts)
        found._sum = 1.0 / b if b**2 * self._lowest > 1.0 else found._weights.sum()  # the shifts miss small t
        return found

    def mult(self, x: np.ndarray) -> np.ndarray:
        """M x of columns x (size, c)."""
        m, columns = len(self._root), x.shape[1]
        parts = np.zeros((m, 1 + self._components, columns))  # the normal one, the tangential ones
        parts[:, 0] = x[:m]
        parts[self._sliding, 1:] = x[m:].reshape(len(self._sliding), self._components, columns)
        parts = self._apply(parts.reshape(m, -1)).reshape(parts.shape)
        return np.concatenate([parts[:, 0], parts[self._sliding, 1:].reshape(x[m:].shape)])

    def _apply(self, x: np.ndarray) -> np.ndarray:
        """The root of the operator on columns x (m, c)."""
        if not x.size:
            return x
        shifted = self._shifted.solve(np.tile(self._root * x, (SHIFTS, 1))).reshape(SHIFTS, *x.shape)
        roots = self._sum * self._root * x - np.tensordot(self._weights * self._shifts, shifted, 1)
        return self._scale * self._root * roots


def smooth_modes(member: Member, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Deformations of a body in which it gives way much more than half-spaces do, by Lanczos steps.

    They are v = M⁻¹ x with C_a x = μ M⁻¹ x and the half-spaces of the body's own interfaces (coarse spaces by such
    problems: Spillane, Dolean, Hauret, Nataf, Pechstein, Scheichl, Numer. Math. 126, 2014).

    Parameters
    ----------
    limit : modes with μ above it are returned

    Returns
    -------
    v : (j, size) contact displacements of unit energy vᵀ M v
    mu : (j,)

    Collective on the body's communicator. Raises SolverError.
    """
    half_space, size = HalfSpace(Space(member.interfaces)), member.size
    V, W, H = np.empty((0, size)), np.empty((0, size)), np.empty((0, 0))  # W = M V, H = Wᵀ C W
    v, found = 1.0 + 0.3 * np.random.default_rng(0).standard_normal(size), (np.empty((0, size)), np.empty(0))
    while len(V) < min(MODE_STEPS, size):
        for _ in range(2):
            v = v - V.T @ (W @ v)
        w = half_space.mult(v)
        length = np.sqrt(max(v @ w, 0.0))
        if not length > 0.0:
            break
        V, W, v = np.vstack([V, v / length]), np.vstack([W, w / length]), np.empty(size)
        member.mult(W[-1], v, "modes", MODE_PRECISION)
        column = W @ v
        H = np.block([[H, column[:-1, None]], [column[None, :]]])
        mu, Y = np.linalg.eigh(H)
        left = v - V.T @ column
        error = np.sqrt(max(left @ half_space.mult(left), 0.0)) * np.abs(Y[-1])  # of each Ritz value's vector
        above = mu > limit
        found = Y[:, above].T @ V, mu[above]
        if len(V) > 2 and (error <= MODE_PRECISION * np.maximum(mu, limit))[mu > limit - error].all():
            break
    return found
