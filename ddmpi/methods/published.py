"""The outer iteration: the domain decomposition algorithm (DD)_h in dual matrix form.

Written for one body; its partner runs the same lines with the other role. Both hold the same λ, bit
for bit, because both add the same two vectors.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ddmpi.coupling.exchange import Exchange
from ddmpi.coupling.member import Body
from ddmpi.interface.law import Friction, friction_role
from ddmpi.methods.outer import Step
from ddmpi.scene.method import Method

FIRST_PRECISION = 0.01
"""Inner precision of the first iteration, times max‖h_α‖: there is no earlier step to measure by. Times
‖h_1 + h_2 − gap‖ where that is smaller, as when a body is moved far to touch the other a little."""

FIXED_PRECISION = 0.1
"""η of inner_precision = "fixed", applied to the update that is asked for at the end, from the start."""

KEPT = 1e-3
"""Where the compliance is applied by an iterative solver: the error that a multiplication in a program may leave, as
a share of the inner precision at the end. Programs keep their products by recurrence from one outer iteration to the
next, so what is lost in an early one is missing in the last."""

PASSING = 0.01
"""There, the precision of a Neumann solve, as a share of η; its result only moves λ."""

DIVERGED = 1e8
"""The iteration has diverged when ‖λ‖ exceeds the free contact displacements by this factor."""


@dataclass
class OuterIteration:
    """λ, both bodies' contact forces, and the iteration that improves them.

    Parameters
    ----------
    body, friction, exchange, method : what iterates
    report : called with every Step

    Attributes
    ----------
    lam : (size,) contact displacement (m)
    s1, s2 : (size,) contact forces (N) as role 1 and role 2 see them
    g : (mt,) slip bound (N) of the last iteration
    history : all steps
    checkpoint : called before every iteration, when STATE and the body's are whole
    """

    STATE = ("lam", "s1", "s2", "g", "_step_size", "history")
    GROWS = ("history",)

    body: Body
    friction: Friction
    exchange: Exchange
    method: Method
    report: Callable[[Step], None] = lambda step: None
    history: list[Step] = field(default_factory=list)
    checkpoint: Callable[[], None] = lambda: None

    @property
    def algorithm(self) -> str:
        return self.method.algorithm

    @property
    def splitting(self) -> str:
        return self.method.splitting

    @property
    def precision(self) -> float:
        """η: the inner solves are as precise as η times the last outer update."""
        return FIXED_PRECISION if self.method.inner_precision == "fixed" else self.method.inner_precision

    def __post_init__(self) -> None:
        size = self.body.C.size
        self.lam, self.s1, self.s2 = np.zeros(size), np.zeros(size), np.zeros(size)
        self.g = np.zeros(size - self.body.interface.m)
        with self.exchange.deferred():
            self.body.need_norm()
        h1, h2 = self.exchange.swap(self.body.h, "free displacement")
        approach = h1 + h2
        approach[:self.body.interface.m] -= self.body.interface.gap
        free = max(np.linalg.norm(h1), np.linalg.norm(h2))
        self._scale = max(free, float(np.linalg.norm(self.body.interface.gap)))
        self._tolerance = self.method.tolerance
        self._step_size = FIRST_PRECISION * min(free, float(np.linalg.norm(approach))) / self.precision

    @property
    def forces(self) -> np.ndarray:
        """The contact forces (size,) that obey all bounds (N): each from the role that bounds it."""
        m = self.body.interface.m
        tangential = self.s2 if friction_role(self.algorithm) == 2 else self.s1
        return np.concatenate([self.s2[:m], tangential[m:]])

    @property
    def _split(self) -> bool:
        """Whether this body's program is split; a frictionless one has nothing to split."""
        return len(self.g) > 0 and self.splitting in (f"step{self.body.role}", "step1+2")

    def run(self, tolerance: float) -> str:
        """Iterate until ‖λ_k − λ_{k−1}‖ ≤ tolerance ‖λ_k‖; may be called again to go on.

        Returns
        -------
        "converged", "diverged" or "max_iterations"

        Raises SolverError on all ranks when an inner solve of either body fails, InterruptionError when a
        signal came to one of them. Collective.
        """
        self._tolerance = tolerance
        while len(self.history) < self.method.max_iterations:
            self.checkpoint()
            step = self.iterate()
            self.history.append(step)
            self.report(step)
            size = np.linalg.norm(self.lam)
            if not np.isfinite(size) or size > DIVERGED * max(self._scale, np.finfo(float).tiny):
                return "diverged"
            if self._step_size <= tolerance * size:
                return "converged"
        return "max_iterations"

    def advance(self, w1: np.ndarray, w2: np.ndarray) -> np.ndarray:
        """The update of λ (m), given the contact displacements B w of both bodies' Neumann problems."""
        return self.method.theta * (w1 + w2)

    def iterate(self) -> Step:
        """One step of the algorithm of the slides; both bodies work at the same time. Collective."""
        body, exchange, m = self.body, self.exchange, self.body.interface.m
        self.g = self.friction.slip_bound(self.s2[:m], body.interface)
        size = self._step_size
        if self.method.inner_precision == "fixed":  # as if the last update were this one already
            size = self.method.tolerance * (np.linalg.norm(self.lam) or self._scale)
        precision = float(max(self.precision * size, self.body.C.accuracy * self._scale))
        kept = KEPT * self.precision * self._tolerance * float(np.linalg.norm(self.lam))

        with exchange.deferred():
            body.solve(self.lam, self.g, precision, self.algorithm, self._split, kept)  # Steps 1 and 2
        self.s1, self.s2 = exchange.swap(body.s, "forces")
        w = np.zeros_like(self.lam)
        with exchange.deferred():
            w = body.neumann(self.s1 - self.s2, PASSING * self.precision)  # Steps 3 and 4
        w1, w2 = exchange.swap(np.append(w, body.C.count.total()), "neumann")
        update = self.advance(w1[:-1], w2[:-1])
        self.lam = self.lam + update  # Step 5; not in place, a checkpoint may hold the former one

        self._step_size = float(np.linalg.norm(update))
        mismatch = _ratio(np.linalg.norm(self.s1 - self.s2), np.linalg.norm(self.s2))
        return Step(len(self.history) + 1, _ratio(self._step_size, np.linalg.norm(self.lam)), mismatch,
                    precision, (int(w1[-1]), int(w2[-1])))


def _ratio(a: float, b: float) -> float:
    return float(a / b) if b else float(a > 0)
