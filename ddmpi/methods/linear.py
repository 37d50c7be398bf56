"""The equations of contact at an answer, linearised: from them follow the derivatives of the answer.

Where no node is about to change its status, the derivatives by a parameter p of the scene solve Newton's linear system
with the derivative of the equations on its right-hand side:

    ds = E y + γ,    Iᵀ (C ds − ρ − Z dα) + D y = 0,    Zᵀ ds = de

with ρ = ∂d − (∂C) s, the change de of loads along rigid motions, and γ, the change of friction at its bound at given
pressures. A result J with dJ = j·ds + a·dα has, by one solve of the transposed system,

    Eᵀ C I z + D z + Eᵀ Z β = Eᵀ j,    −Zᵀ I z = a,    dJ = (I z)·(ρ − C γ) + β·(de − Zᵀ γ) + j·γ

for all parameters (implicit differentiation; E is `Linearised.expansion`, I its basis).
"""

from __future__ import annotations

import zlib
from collections.abc import Callable, Sequence
from functools import cached_property
from typing import NamedTuple

import numpy as np

from ddmpi.coupling.joint import Joint, Point
from ddmpi.methods.dense import SMALL, Factors, factor
from ddmpi.methods.krylov import Linearised, LinearProblem, Preconditioner, Regularisation
from ddmpi.system.numbers import concatenated, norm

AIM, ROUNDS = 1e-10, 10
"""Relative residual that derivatives aim at, and most solves by GMRES to reach it."""

STEERED = 1e-5
"""With loose bodies one solve by GMRES reduces the residual by this factor at most: the springs that steer them leave
about as much. At 1e-10 a wall and an arch take a quarter more products."""

UNIQUE, CLEAR = 1e-3, 1e-6
"""Of forces drawn at random, those that change no equation are left. All are determined if less than the share UNIQUE
is left; entries below CLEAR times the largest are rounding."""

GAIN = 0.3
"""The solves end after one that leaves more than this fraction of the residual."""

PURPOSE = "derivative"
"""What products are counted for."""

BY = Regularisation(precise=True, exact=True)
"""How the linear problems are solved: what steers is in no equation."""


Solve = Callable[[np.ndarray, np.ndarray, float], tuple[np.ndarray, np.ndarray]]


class Changed(NamedTuple):
    """The derivative of an answer.

    Attributes
    ----------
    s, r : (size,) of forces (N) and gaps (m)
    alpha : of the motions of loose bodies (m)
    residual : relative, of the equations without what steers
    """

    s: np.ndarray
    r: np.ndarray
    alpha: np.ndarray
    residual: float


class Linearisation:
    """The equations at a `point`, linearised for the status that its nodes have there.

        >>> answer = ddmpi.solve("configs/punch.toml", MPI.COMM_WORLD)
        >>> joint, outer = answer.solved.assembly.joint, answer.solved.solution.outer
        >>> outer.run(1e-10)
        'converged'
        >>> change = outer.linearisation().direct(joint.d, joint.e, np.zeros(joint.size))
        >>> apart = joint.space.norm(change.s - outer.forces)
        >>> apart < 1e-6 * joint.space.norm(outer.forces)  # without a gap forces grow like the loads
        True

    Construction and all methods but `along_slip` are collective. They raise SolverError.
    """

    def __init__(self, joint: Joint, preconditioner: Preconditioner, point: Point) -> None:
        self.joint, self.point, self._preconditioner = joint, point, preconditioner
        self._q = point.s - preconditioner.c * point.r
        laws = joint.space.laws
        self.active = [law.active_set(q) for law, q in laws.parts(self._q)]  # of each interface
        self.linearised = Linearised.of(laws.linearise(laws.active_sets(self._q)))
        self._layer = self.linearised.spring / preconditioner.c
        self._problems: dict[bool, LinearProblem] = {}

    def along_slip(self, bounds: Sequence[np.ndarray]) -> np.ndarray:
        """γ (size,): `bounds` (mt,) of each interface along the friction of nodes that slip (N)."""
        vectors = list[np.ndarray]()
        for active, bound in zip(
            self.active, bounds, strict=False
        ):  # a rank without interfaces has an empty law
            vectors += [np.zeros(len(active.closed)), (active.slip * bound[:, None]).ravel()]
        return concatenated(vectors)

    def direct(self, rho: np.ndarray, de: np.ndarray, gamma: np.ndarray) -> Changed:
        """The derivative of the answer by ρ (size,) in metres, de (rigid.size,) and γ (size,) in newtons."""
        joint, rigid = self.joint, self.joint.rigid
        C_gamma = (
            joint.product(gamma, PURPOSE, AIM) if joint.space.any(gamma) else np.zeros_like(gamma)
        )
        y, alpha, C_y, residual = self._solve(
            self.linearised.restrict(rho - C_gamma), de - rigid.sums(gamma)
        )
        return Changed(
            self.linearised.expand(y) + gamma,
            C_y + C_gamma - rho - rigid.spread(alpha),
            alpha,
            residual,
        )

    def yielding(self) -> np.ndarray:
        """∂α/∂e (rigid.size, rigid.size) in m/N: how the motions yield to loads along them."""
        none = np.zeros(self.joint.size)
        return np.array(
            [self.direct(none, along, none).alpha for along in np.eye(self.joint.rigid.size)]
        ).T

    def unseen(self, transposed: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Forces (size,) and motions (rigid.size,), drawn at random of all that change no equation.

        Forces of several contacts at one node may cancel each other: then only their sum is determined, and a result
        is determined where these forces leave it unchanged. Zero where all forces are determined, or where no node has
        several contacts. `transposed`: those of the transposed system, I z and β of `adjoint`. They are what a parameter
        must not work on for an answer to follow it.
        """
        joint, space, lin = self.joint, self.joint.space, self.linearised
        none = np.zeros(self.joint.size), np.zeros(self.joint.rigid.size)
        outward, inward = (lin.place, lin.contract) if transposed else (lin.expand, lin.restrict)
        draws = [  # the same on any ranks
            np.random.default_rng(zlib.crc32(interface.name.encode())).standard_normal(
                part.stop - part.start
            )
            for interface, part in space.with_slices()
        ]
        draw = concatenated(draws)
        y = lin.restrict(np.where(joint.shared(), draw, 0.0))
        size = space.norm(y)
        if not size:
            return none
        f = inward(joint.product(outward(y), PURPOSE, AIM)) + self._layer[lin.unknown] * y
        more, alpha, _, _ = self._solve(-f, -joint.rigid.sums(outward(y)), transposed=transposed)
        if space.norm(y + more) <= UNIQUE * size:
            return none
        left = outward(y + more)
        return np.where(np.abs(left) > CLEAR * space.largest(np.abs(left)), left, 0.0), alpha

    def adjoint(
        self, j: np.ndarray, a: np.ndarray, aim: float = AIM
    ) -> tuple[np.ndarray, np.ndarray, float]:
        """I z (size,) in m/N times the unit of a result J, β (rigid.size,), and the residual, by dJ = j·ds + a·dα; `aim`
        is the residual that ends the solves."""
        f = self.linearised.contract(j)
        z, beta, _, residual = self._solve(f, -a, transposed=True, aim=aim)
        return self.linearised.place(z), -beta, residual

    def _solve(
        self, f: np.ndarray, h: np.ndarray, transposed: bool = False, aim: float = AIM
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        """The unknown forces y (k,), the motions α, C times the forces (size,), and the relative residual."""
        joint, space, rigid = self.joint, self.joint.space, self.joint.rigid
        y, alpha, product = np.zeros(len(f)), np.zeros(rigid.size), np.zeros(space.size)
        h = joint.stays.moving(h)  # no forces are asked of motions that stay where they are
        residual = 0.0 if not (space.any(f) or h.any()) else np.inf
        if not residual or not space.any(np.ones(len(f))):
            return y, alpha, product, residual
        solve = self._approximate(transposed, aim)
        outward, inward = (
            (self.linearised.place, self.linearised.contract)
            if transposed
            else (self.linearised.expand, self.linearised.restrict)
        )
        left, out, pull, layer = f, h, norm(h), self._layer[self.linearised.unknown]
        size = space.norm(f)
        for _ in range(ROUNDS):
            more, turn = solve(left, out, size)
            y, alpha = y + more, alpha + joint.stays.moving(turn)
            # the true equations, without ε and D at nodes of several contacts
            product = joint.product(outward(y), PURPOSE, aim)
            left = f - inward(product - rigid.spread(alpha)) - layer * y
            out = joint.stays.moving(h - rigid.sums(outward(y)) - joint.K @ alpha)
            # relative to the largest so far, as a motion may cancel nearly all of f, and forces may cancel each other
            misfit, moved, now = space.norms([left, inward(rigid.spread(alpha)), y])
            size, pull = max(size, moved), max(pull, now)
            before = residual
            residual = max(misfit / size if size else 0.0, norm(out) / pull if pull else 0.0)
            if residual <= aim or not residual <= GAIN * before:
                break
        return y, alpha, product, residual

    def _approximate(self, transposed: bool, aim: float) -> Solve:
        """A solver of the system with what steers: a function of f (k,), h (rigid.size,) and the size of the first f,
        which returns y and α, for a residual of the size `aim` in the end. By dense factors where one rank has a small
        compliance, else by GMRES."""
        joint = self.joint
        if factors := self._factors:

            def by_factors(f: np.ndarray, h: np.ndarray, _: float) -> tuple[np.ndarray, np.ndarray]:
                # the transposed matrix has −Zᵀ I in its second row, and β = −α beside it
                sign = -1.0 if transposed else 1.0
                unknowns = factors.solve(np.append(f, sign * h), transposed)
                return unknowns[: len(f)], sign * unknowns[len(f) :]

            return by_factors
        if transposed not in self._problems:
            self._problems[transposed] = LinearProblem(
                joint, self._preconditioner, self.linearised, self._layer, BY, transposed, PURPOSE
            )
        problem, least = self._problems[transposed], STEERED if joint.rigid.size else 0.1 * aim

        def by_gmres(f: np.ndarray, h: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray]:
            y, alpha = np.zeros_like(f), np.zeros_like(h)
            if len(h):  # the forces of least energy in half-spaces that balance h
                y, alpha = problem.precondition(y, h)
                f = f - problem.apply(y, alpha, aim)
            now = joint.space.norm(f)
            more, turn, _ = problem.solve(
                f, min(max(0.5 * aim * size / now, least), 0.1) if now else 0.1
            )
            return y + more, alpha + turn

        return by_gmres

    @cached_property
    def _factors(self) -> Factors | None:
        """Dense factors; None where the compliance is not explicit, or they are singular. Collective."""
        C = self.joint.dense(SMALL) if 0 < self.linearised.number <= SMALL else None
        if C is None:
            return None
        return factor(C, self.joint, self._preconditioner, self.linearised, self._layer, BY)

    def until(self, changed: Changed, bounds: Sequence[np.ndarray]) -> tuple[float, float]:
        """By how much the parameter may fall (negative) and rise until a node changes its status, by linear forecast.

        `bounds` (mt,) of each interface are the changes of slip bounds at given pressures. Where a node is just about
        to change its status, one of both is zero, and the derivative is one-sided.
        """
        rates = [np.zeros(2)]  # one over the distance, of fall and rise
        change = changed.s - self._preconditioner.c * changed.r
        for (law, q), (_, dq), (_, ds), active, bound in zip(
            *(self.joint.space.laws.parts(x) for x in (self._q, change, changed.s)),
            self.active,
            bounds,
            strict=False,
        ):
            if law.two_sided:  # nodes of bonds and guides keep their status
                continue
            (normal, t), (dn, dt) = law.split(q), law.split(dq)
            live = np.broadcast_to(law.live, law.size)[: law.m]
            rates.append(_rates(np.where(active.closed, 1.0, -1.0), 0.0 * dn, dn, normal, live))
            # |t|² − g² changes its sign where a node begins or ends to slip, in the plane as in space
            g = active.bound
            dg = law.slope(active.pressure) * (ds[: law.m] * active.closed)[law.sliding] + bound
            rates.append(
                _rates(
                    np.where(active.slip.any(axis=1), 1.0, -1.0),
                    (dt**2).sum(axis=1) - dg**2,
                    2.0 * ((t * dt).sum(axis=1) - g * dg),
                    (t**2).sum(axis=1) - g**2,
                    active.closed[law.sliding] | (g > 0.0),
                )
            )
        fall, rise = np.max(rates, axis=0)
        fall, rise = (self.joint.space.largest(np.array([rate])) for rate in (fall, rise))
        return -1.0 / fall if fall else -np.inf, 1.0 / rise if rise else np.inf


def _rates(
    side: np.ndarray, a: np.ndarray, b: np.ndarray, c: np.ndarray, counts: np.ndarray
) -> np.ndarray:
    """(2,) the largest 1/|x| at which a x² + b x + c loses the sign `side` that it has at x = 0, for x ≤ 0, x ≥ 0."""
    c = side * np.maximum(side * c, 0.0)  # rounding may give it the other sign
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
