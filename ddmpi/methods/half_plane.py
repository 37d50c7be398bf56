"""An approximate inverse of the joint contact compliance: the half-plane's stiffness on the interface.

Two elastic half-planes pressed by the stresses σ give way by u = (2/E*) |∂|⁻¹ σ, with 1/E* the sum of
the plane compliances (1−ν²)/E (Johnson, Contact Mechanics, 1985, ch. 2) and |∂| the square root of −d²/ds²
along the interface, which goes on from the end of a closed chain to its beginning, with nothing moving where a clamp
holds the next node; normal and tangential parts
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

from ddmpi.coupling.member import Member
from ddmpi.coupling.space import Space
from ddmpi.interface.interface import Interface

STEP = 1.0
"""Step of the quadrature in log t: its relative error is about 2 exp(−π²/STEP), here 1e-4."""

TAIL = 8.0
"""How far the quadrature goes beyond the spectrum, in log t: cuts off about exp(−TAIL)."""

MODE_STEPS, MODE_PRECISION = 60, 0.05
"""Most Lanczos steps that look for a body's smooth modes, and their relative error; they only precondition."""


class HalfPlaneStiffness:
    """M ≈ C⁻¹ (N/m): a block for each interface, which knows nothing of the others. Not collective."""

    def __init__(self, space: Space) -> None:
        self._parts = list(space.parts.values())
        self._blocks = [_Block(interface) for interface in space.interfaces]

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
        last, first = interface.closings.T
        inverse = 1.0 / np.linalg.norm(interface.xy[last] - interface.xy[first], axis=1)
        self._around = np.zeros((len(length), len(last)))
        for node, sign in ((last, 1.0), (first, -1.0)):
            self._around[node, np.arange(len(node))] = sign * np.sqrt(inverse / length[node])
        self._diagonal = diagonal
        self._off = -link / np.sqrt(length[1:] * length[:-1])
        self._root = np.sqrt(length)
        self._scale = 0.5 * interface.modulus

        lowest = 1.5 / total
        highest = 2 * (diagonal + (self._around**2).sum(axis=1)).max()
        spread = 0.5 * np.log(highest / lowest**2)  # of the spectrum's root, free of units
        t = lowest * np.exp(np.arange(-TAIL, spread + TAIL + STEP, STEP))
        self._weights = (2 / np.pi) * STEP * t
        d = (diagonal + t[:, None] ** 2).ravel()
        e = np.tile(np.append(self._off, 0.0), len(t))[:-1]
        self._d, self._e, info = lapack.dpttrf(d, e)
        if info:
            raise ValueError("the shifted interface operators are not positive definite")
        self._turned = self._solve(self._around.T)
        self._joint = np.linalg.inv(np.eye(len(last)) + np.einsum("mi,jtm->tij", self._around, self._turned))

    def mult(self, x: np.ndarray) -> np.ndarray:
        """M x of columns x (size, c)."""
        y, m, mt = np.empty_like(x), len(self._root), len(self._sliding)
        rows = np.zeros((1 + self._law.components * bool(mt), x.shape[1], m))  # the normal one, the tangential ones
        rows[0] = x[:m].T
        rows[1:, :, self._sliding] = x[m:].reshape(mt, len(rows) - 1, x.shape[1]).transpose(1, 2, 0)
        rows = self._apply(rows.reshape(-1, m)).reshape(rows.shape)
        y[:m] = rows[0].T
        y[m:] = rows[1:, :, self._sliding].transpose(2, 0, 1).reshape(x[m:].shape)
        return y

    def _apply(self, x: np.ndarray) -> np.ndarray:
        """The root of the operator on rows x (c, m)."""
        shifted = self._solve(self._root * x)
        if self._around.size:  # closed chains, by Sherman, Morrison and Woodbury
            shifted -= np.einsum("jtm,tji,cti->ctm", self._turned, self._joint, shifted @ self._around, optimize=True)
        z = self._weights @ shifted
        Az = self._diagonal * z
        Az[:, 1:] += self._off * z[:, :-1]
        Az[:, :-1] += self._off * z[:, 1:]
        if self._around.size:
            Az += (z @ self._around) @ self._around.T
        return self._scale * self._root * Az

    def _solve(self, y: np.ndarray) -> np.ndarray:
        """The solutions (c, t, m) of all shifted tridiagonal systems for the same rows y (c, m)."""
        each = np.repeat(y[:, None], len(self._weights), axis=1)
        if not each.size:
            return each
        shifted, _ = lapack.dpttrs(self._d, self._e, each.reshape(len(y), -1).T, overwrite_b=True)
        return shifted.T.reshape(each.shape)


def smooth_modes(member: Member, limit: float) -> tuple[np.ndarray, np.ndarray]:
    """Deformations of a body in which it gives way much more than half-planes do, by Lanczos steps.

    They are v = M⁻¹ x with C_a x = μ M⁻¹ x and the half-planes of the body's own interfaces (coarse spaces by such
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
    half_plane, size = HalfPlaneStiffness(Space(member.interfaces)), member.size
    V, W, H = np.empty((0, size)), np.empty((0, size)), np.empty((0, 0))  # W = M V, H = Wᵀ C W
    v, found = 1.0 + 0.3 * np.random.default_rng(0).standard_normal(size), (np.empty((0, size)), np.empty(0))
    while len(V) < min(MODE_STEPS, size):
        for _ in range(2):
            v = v - V.T @ (W @ v)
        w = half_plane.mult(v)
        length = np.sqrt(max(v @ w, 0.0))
        if not length > 0.0:
            break
        V, W, v = np.vstack([V, v / length]), np.vstack([W, w / length]), np.empty(size)
        member.mult(W[-1], v, "modes", MODE_PRECISION)
        column = W @ v
        H = np.block([[H, column[:-1, None]], [column[None, :]]])
        mu, Y = np.linalg.eigh(H)
        left = v - V.T @ column
        error = np.sqrt(max(left @ half_plane.mult(left), 0.0)) * np.abs(Y[-1])  # of each Ritz value's vector
        above = mu > limit
        found = Y[:, above].T @ V, mu[above]
        if len(V) > 2 and (error <= MODE_PRECISION * np.maximum(mu, limit))[mu > limit - error].all():
            break
    return found
