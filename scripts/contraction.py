"""The outer iteration linearised at the solution, as a dense matrix.

Near the solution the contact nodes keep their status, each body's QP is a linear system for its free
forces, and one outer iteration is a linear map. Its spectral radius is the exact factor by which the
error shrinks per iteration in the end, for every variant and every theta.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.linalg

from ddmpi.coupling.assembly import Assembly
from ddmpi.methods.newton import Newton
from ddmpi.methods.subproblem import friction_role

TOLERANCE, MOST = 1e-10, 500
"""Of the solution at which the iteration is linearised: relative residual, and most steps."""

ON_BOUND = 1e-7
"""Relative distance to a bound below which a force counts as lying on it."""


@dataclass(frozen=True)
class Linearisation:
    """What the map depends on; `size` = m normal and m tangential unknowns.

    Attributes
    ----------
    C : compliances (size, size) of role 1's and role 2's body (m/N)
    pressed : (m,) bool, normal force above zero at the solution
    sticking : (m,) bool, tangential force below its bound
    slip : (m,) ±𝓕 where the tangential force follows the normal one at its bound (Coulomb), else zero
    """

    C: tuple[np.ndarray, np.ndarray]
    pressed: np.ndarray
    sticking: np.ndarray
    slip: np.ndarray

    def all_sticking(self) -> np.ndarray:
        """Eigenvalues, ascending, of M = ½ (C_1 + C_2)(C_1⁻¹ + C_2⁻¹): T_θ = I − θ M if all nodes stick."""
        C1, C2 = self.C
        inverse = np.linalg.inv(C1) + np.linalg.inv(C2)
        return scipy.linalg.eigh((inverse + inverse.T) / 4, np.linalg.inv(C1 + C2), eigvals_only=True)

    def response(self, algorithm: str, splitting: str) -> tuple[np.ndarray, np.ndarray]:
        """The map for all theta: the new state is (P + θ Q) times the old one.

        The state is λ and the part of the last forces that enters the next iteration: s_2ν where it sets the
        slip bound, s_αt where the QP of α is split. Returns P and Q (k, k).
        """
        m = len(self.pressed)
        parts = {"lam": 2 * m}
        if self.slip.any():
            parts["s2n"] = m
        split = [splitting in (f"step{role}", "step1+2") for role in (1, 2)]
        parts |= {f"s{role}t": m for role in (1, 2) if split[role - 1]}
        offsets = np.cumsum([0, *parts.values()])
        k = offsets[-1]
        unit = {name: np.eye(k)[start:end]
                for name, start, end in zip(parts, offsets[:-1], offsets[1:], strict=True)}
        bound = self.slip[:, None] * unit.get("s2n", np.zeros((m, k)))
        s1, s2 = (self._forces(role, algorithm, split[role - 1], unit, bound) for role in (1, 2))
        new = {"lam": unit["lam"], "s2n": s2[:m], "s1t": s1[m:], "s2t": s2[m:]}
        P = np.concatenate([new[name] for name in parts])
        Q = np.zeros_like(P)
        Q[:2 * m] = 0.5 * (self.C[0] + self.C[1]) @ (s1 - s2)
        return P, Q

    def _forces(self, role: int, algorithm: str, split: bool, unit: dict, bound: np.ndarray) -> np.ndarray:
        """How the forces (2m, k) that solve the QP of `role` follow the state."""
        m, C = len(self.pressed), self.C[role - 1]
        d = -unit["lam"] if role == 1 else unit["lam"]
        s = np.zeros_like(d)
        s[m:] = unit.get(f"s{role}t", 0.0)
        free = np.ones(2 * m, bool)
        if role == 2:
            free[:m] = self.pressed
        if role == friction_role(algorithm):
            free[m:] = self.sticking
        normal = np.arange(2 * m) < m
        for block in (normal, ~normal) if split else (np.ones(2 * m, bool),):
            tangential = block & ~normal & ~free
            s[tangential] = bound[tangential[m:]]
            inner = block & free
            s[inner] = np.linalg.solve(C[np.ix_(inner, inner)], d[inner] - C[np.ix_(inner, ~inner)] @ s[~inner])
        return s


def linearise(assembly: Assembly) -> Linearisation:
    """Solve `assembly` exactly and linearise there. Collective; all m nodes must be able to slide."""
    newton, (interface,) = Newton(assembly.joint, MOST), assembly.member.interfaces
    ended = newton.run(TOLERANCE)
    if ended != "converged":
        raise RuntimeError(f"the solution at which to linearise: {ended}")
    m, law = interface.m, interface.law
    forces, g = newton.forces, newton.bound
    normal, tangential = forces[:m], forces[m:]
    sticking = np.abs(tangential) < g - ON_BOUND * g.max()
    slip = np.where(sticking, 0.0, np.sign(tangential) * law.slope(normal))
    dense = dict(assembly.world.allgather((interface.side(assembly.member.name), assembly.member.C.dense())))
    return Linearisation((dense[0], dense[1]),
                         normal > ON_BOUND * normal.max(), sticking, slip)


def dominant(P: np.ndarray, Q: np.ndarray, theta: float) -> complex:
    """The eigenvalue of P + θ Q of largest modulus, with imaginary part ≥ 0."""
    values = np.linalg.eigvals(P + theta * Q)
    value = values[np.argmax(np.abs(values))]
    return complex(value.real, abs(value.imag))


def largest_theta(P: np.ndarray, Q: np.ndarray, limit: float = 4.0, precision: float = 1e-3) -> float:
    """The θ at which the spectral radius of P + θ Q first reaches one; `limit` if it stays below."""
    low = high = 0.0
    while high < limit:
        low, high = high, min(high + 0.1, limit)
        if abs(dominant(P, Q, high)) >= 1.0:
            break
    else:
        return limit
    while high - low > precision:
        middle = (low + high) / 2
        low, high = (middle, high) if abs(dominant(P, Q, middle)) < 1.0 else (low, middle)
    return low
