"""The equations of contact at an answer, linearised: from them follow the derivatives of the answer.

Where no node is about to change its status, the forces follow a parameter p of the scene by Newton's own linear system,
now with the change of the equations on its right-hand side:

    ds = E y + γ,    Iᵀ (C ds − ρ − Z dα) + D y = 0,    Zᵀ ds = de

with ρ = ∂d − (∂C) s, the imbalance de along rigid motions, and γ, the change of slip bounds at given pressures, along
the slip. A result with dJ = j·ds + a·dα has, by one solve of the transposed system,

    Eᵀ C I z + D z + Eᵀ Z β = Eᵀ j,    −Zᵀ I z = a,    dJ = (I z)·(ρ − C γ) + β·(de − Zᵀ γ) + j·γ

for all parameters (implicit differentiation; E is `Linearised.expansion`, I its basis).
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ddmpi.coupling.joint import Joint, Point
from ddmpi.methods.krylov import Linearised, LinearProblem, Preconditioner
from ddmpi.system.numbers import norm

AIM, ROUNDS = 1e-10, 10
"""Relative residual at which derivatives are aimed, and most solves by GMRES to reach it."""

STEERED = 1e-5
"""With loose bodies GMRES reduces the residual by no more than this in one solve, as the springs that steer them leave
about as much. At 1e-10 a wall and an arch take a quarter more products."""

GAIN = 0.3
"""Solves end when one leaves more than this fraction of the residual."""

PURPOSE = "derivative"
"""What products are counted for."""


class Changed(NamedTuple):
    """The derivative of an answer.

    Attributes
    ----------
    s, r : (size,) of forces (N) and gaps (m)
    alpha : of the motions of loose bodies (m)
    residual : relative, of the equations without anything that steers
    """

    s: np.ndarray
    r: np.ndarray
    alpha: np.ndarray
    residual: float


class Linearisation:
    """The equations at a `point`, linearised for the status that its nodes have there.

    `c` (size,) is the stiffness of s − c r (N/m). Construction and all methods but `along_slip`
    are collective. They raise SolverError.
    """

    def __init__(self, joint: Joint, preconditioner: Preconditioner, point: Point, c: np.ndarray) -> None:
        self.joint, self.point, self._preconditioner, self._c = joint, point, preconditioner, c
        self._q = point.s - c * point.r
        self.active = joint.space.laws.active_sets(self._q)
        self.linearised = Linearised.of(joint.space.laws.linearise(self.active))
        self._layer = self.linearised.spring / c
        self._forcing = STEERED if joint.rigid.size else 0.1 * AIM
        self._problems: dict[bool, LinearProblem] = {}

    def along_slip(self, bounds: Sequence[np.ndarray]) -> np.ndarray:
        """γ (size,): `bounds` (mt,) of each interface along the friction of nodes that slip (N)."""
        parts = [np.empty(0)]
        for active, bound in zip(self.active, bounds, strict=False):  # a rank without interfaces has an empty law
            parts += [np.zeros(len(active.closed)), (active.slip * bound[:, None]).ravel()]
        return np.concatenate(parts)

    def direct(self, rho: np.ndarray, de: np.ndarray, gamma: np.ndarray) -> Changed:
        """The derivative of the answer by ρ (size,) in metres, de (rigid.size,) and γ (size,) in newtons."""
        joint, rigid = self.joint, self.joint.rigid
        C_gamma = joint.product(gamma, PURPOSE, AIM) if joint.space.any(gamma) else np.zeros_like(gamma)
        y, alpha, C_y, residual = self._solve(self.linearised.restrict(rho - C_gamma), de - rigid.sums(gamma))
        return Changed(self.linearised.expand(y) + gamma, C_y + C_gamma - rho - rigid.spread(alpha), alpha, residual)

    def adjoint(self, j: np.ndarray, a: np.ndarray) -> tuple[np.ndarray, np.ndarray, float]:
        """I z (size,) in m/N times the unit of a result J, β (rigid.size,), and the residual, by dJ = j·ds + a·dα."""
        z, beta, _, residual = self._solve(self.linearised.contract(j), -a, transposed=True)
        return self.linearised.place(z), -beta, residual

    def _solve(self, f: np.ndarray, h: np.ndarray,
               transposed: bool = False) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """The unknown forces y (k,), the motions α, C times the forces (size,), and the relative residual."""
        joint, space, rigid = self.joint, self.joint.space, self.joint.rigid
        y, alpha, product = np.zeros(len(f)), np.zeros(rigid.size), np.zeros(space.size)
        h = np.where(joint.kept, 0.0, h)  # no forces are asked of motions that stay where they are
        residual = 0.0 if not (space.any(f) or h.any()) else np.inf
        if not residual or not space.any(np.ones(len(f))):
            return y, alpha, product, residual
        if transposed not in self._problems:
            self._problems[transposed] = LinearProblem(
                joint, self._preconditioner, self.linearised, self._layer, precise=True, exact=True,
                transposed=transposed, purpose=PURPOSE)
        problem = self._problems[transposed]
        left, out, pull, layer = f, h, norm(h), self._layer[self.linearised.unknown]
        for _ in range(ROUNDS):
            if rigid.size:  # the nearest forces by half-spaces that balance what is left
                dy, turn = problem.precondition(np.zeros_like(f), out)
                y, alpha, left = y + dy, alpha + turn, left - problem.apply(dy, turn, AIM)
            size, now = space.norms([f, left])
            size = max(size, space.norm(problem.restrict(rigid.spread(alpha))))
            more, turn, _ = problem.solve(left, min(max(0.5 * AIM * size / now, self._forcing), 0.1) if now else 0.1)
            y, alpha = y + more, alpha + turn
            # the true equations: neither ε nor D at nodes of several contacts stands in them
            product = joint.product(problem.expand(y), PURPOSE, AIM)
            left = f - problem.restrict(product - rigid.spread(alpha)) - layer * y
            out = np.where(joint.kept, 0.0, h - rigid.sums(problem.expand(y)))
            misfit, size, now = space.norms([left, f, y])
            size, pull = max(size, space.norm(problem.restrict(rigid.spread(alpha)))), max(pull, now)
            before, residual = residual, max(misfit / size if size else 0.0, norm(out) / pull if pull else 0.0)
            if residual <= AIM or not residual <= GAIN * before:
                break
        return y, alpha, product, residual

    def until(self, changed: Changed, bounds: Sequence[np.ndarray]) -> tuple[float, float]:
        """By how much the parameter may fall (negative) and rise until a node changes its status, if all is linear.

        `bounds` (mt,) of each interface are the changes of slip bounds at given pressures. Where a node is just about
        to change its status, one of both is zero: the derivative is that of the other side.
        """
        rates = [np.zeros(2)]  # one over the distance, of a fall and of a rise
        change = changed.s - self._c * changed.r
        for (law, q), (_, dq), (_, ds), active, bound in zip(
                *(self.joint.space.laws.parts(x) for x in (self._q, change, changed.s)), self.active, bounds,
                strict=False):
            if law.name == "bonded":  # whose nodes keep their status
                continue
            (normal, t), (dn, dt) = law.split(q), law.split(dq)
            live = np.broadcast_to(law.live, law.size)[:law.m]
            rates.append(_rates(np.where(active.closed, 1.0, -1.0), 0.0 * dn, dn, normal, live))
            # |t|² − g² changes its sign where a node begins or ends to slip, in the plane as in space
            g, dg = active.bound, law.slope(active.pressure) * (ds[:law.m] * active.closed)[law.sliding] + bound
            rates.append(_rates(np.where(active.slip.any(axis=1), 1.0, -1.0), (dt**2).sum(axis=1) - dg**2,
                                2.0 * ((t * dt).sum(axis=1) - g * dg), (t**2).sum(axis=1) - g**2,
                                active.closed[law.sliding] | (g > 0.0)))
        fall, rise = np.max(rates, axis=0)
        fall, rise = (self.joint.space.largest(np.array([rate])) for rate in (fall, rise))
        return -1.0 / fall if fall else -np.inf, 1.0 / rise if rise else np.inf


def _rates(side: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray, counts: np.ndarray) -> np.ndarray:
    """(2,) the largest 1/|x| at which a x² + b x + c loses the sign `side` that it has at x = 0, for x ≤ 0, x ≥ 0."""
    c = side * np.maximum(side * c, 0.0)  # rounding may have put it on the other side
    with np.errstate(all="ignore"):
        root = np.sqrt(b**2 - 4.0 * a * c)
        up = np.where(b < 0.0, -1.0, 1.0)
        half = -0.5 * (b + up * root)
        rates = np.zeros(2)
        for x, slope in ((half / a, -up * root), (c / half, up * root)):  # and the derivative there
            for k, sign in enumerate((-1.0, 1.0)):
                lost = (sign * x >= 0.0) & (sign * side * slope < 0.0) & np.isfinite(x) & counts
                rates[k] = max(rates[k], (1.0 / np.abs(x[lost])).max(initial=0.0))
    return rates
