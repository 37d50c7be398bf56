"""MPRGP: modified proportioning with reduced gradient projections, as a TAO type in Python.

Dostál, Schöberl: Minimizing quadratic functions over non-negative vectors with the rate of convergence and finite
termination, Comput. Optim. Appl. 30 (2005) 23–43. Without constraints it is the conjugate gradient method. Differences
from the paper:

* bounds are on both sides (`sets.Box`), and a proportioning step ends at the opposite bound;
* an expansion, where the conjugate gradient step leaves the set, first tries the *projected conjugate gradient step*
  and keeps it if it lowers the objective; otherwise it takes the projected gradient step of fixed length;
* the gradient follows the iterates by recurrence: a step costs one multiplication by the Hessian, an expansion two or
  three.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from petsc4py import PETSc

from ddmpi.petsc.lanczos import estimate_norm
from ddmpi.petsc.versions import TaoReason
from ddmpi.sets import Box
from ddmpi.system.agreement import in_lockstep

log = logging.getLogger("ddmpi")

PROPORTION = 1.0
"""Γ of the paper: a step frees indices when the chopped gradient exceeds Γ times the free one."""

STEP = 1.9
"""Fixed step times ‖H‖; descent needs less than 2, and ‖H‖ is estimated from below."""

TELLING = 1000
"""The log shows the residual after every so many steps."""


class Program(NamedTuple):
    """A program as one rank has it.

    Attributes
    ----------
    x, g : the point, at first where to start, and the gradient there; both change in place
    feasible : the set of feasible points
    multiply : by the Hessian
    reduce : as of `reduction`
    norm : ‖H‖₂ from below
    """

    x: np.ndarray
    g: np.ndarray
    feasible: Box
    multiply: Callable[[np.ndarray], np.ndarray]
    reduce: Callable[..., list[float]]
    norm: float


class TaoType:
    """The base of the TAO types in Python.

    The estimate of ‖H‖₂ is ``norm()`` of the Hessian's Python context if there is one, else from Lanczos steps. The
    solution satisfies the constraints exactly, and the TAO's gradient vector is the gradient at the solution.
    `constraints` is the set of feasible points, by default the variable bounds of the TAO. `steps` is the number of
    steps of each kind in the last solve.
    """

    title: str

    def __init__(self, constraints: Box | None = None) -> None:
        self.constraints = constraints
        self.steps: dict[str, int] = {}

    def solve(self, tao: PETSc.TAO) -> None:
        """Called by TAOSolve. Collective on the TAO's communicator."""
        X, H = tao.getSolution(), tao.getHessian()[0]
        feasible = self.constraints or Box(*(bound.array_r for bound in tao.getVariableBounds()))
        self._tolerance, *_ = tao.getTolerances()
        self._limit, self._iteration = tao.getMaximumIterations(), 0
        P, HP = X.duplicate(), X.duplicate()
        X.array[:] = feasible.project(X.array_r)
        G = tao.getGradient()[0]
        tao.computeGradient(X, G)

        def multiply(direction: np.ndarray) -> np.ndarray:
            P.array[:] = direction
            H.mult(P, HP)
            return HP.array_r.copy()  # the next product overwrites it

        reduce = reduction(X)
        norm = hessian_norm(H, X, reduce)
        reason = self.iterate(Program(X.array, G.array, feasible, multiply, reduce, norm))
        tao.setIterationNumber(self._iteration)
        tao.setConvergedReason(reason)
        P.destroy()
        HP.destroy()

    def iterate(self, program: Program) -> int:
        """Minimize; return the reason of the end."""
        raise NotImplementedError

    def _ends(self, residual: float, rounding: float = 0.0) -> int | None:
        """The reason to end at this residual, or None after counting a step; a residual up to `rounding` ends, too."""
        if not np.isfinite(residual + rounding):
            return TaoReason.DIVERGED_NAN
        if residual <= self._tolerance:
            return TaoReason.CONVERGED_GATOL
        if self._iteration >= self._limit:
            return TaoReason.DIVERGED_MAXITS
        if residual <= rounding:
            return TaoReason.CONVERGED_STEPTOL
        self._iteration += 1
        if self._iteration % TELLING == 0:
            log.info(
                "        %d %s: residual %.1e, %.1e is asked for",
                self._iteration,
                self.title,
                residual,
                self._tolerance,
            )
        return None


class MPRGP(TaoType):
    """``-tao_type python -tao_python_type ddmpi.mprgp.MPRGP``, for bounds. Stops at ‖projected gradient‖ ≤ gatol."""

    title = "steps of MPRGP"

    def iterate(self, program: Program) -> int:
        x, g, feasible, multiply, reduce, norm = program
        self.steps, p = dict.fromkeys(("cg", "expansion", "proportioning"), 0), np.empty(0)
        # with curvature 0 the next conjugate gradient step starts anew
        Hp, curvature = np.zeros_like(x), 0.0

        def along(p: np.ndarray, Hp: np.ndarray) -> list[float]:
            """pᵀ H p, gᵀ p, pᵀ p, and the longest feasible step against p."""
            return reduce(p, Hp, g, p, p, p, least=feasible.longest_step(x, p))

        def rise(change: np.ndarray, H_change: np.ndarray) -> float:
            """By how much a change of x raises the objective ½ xᵀ H x − xᵀ d."""
            slope, bent = reduce(change, g, change, H_change)
            return slope + 0.5 * bent

        while True:
            free, chopped = feasible.split(g, x)
            both, reduced = free + chopped, feasible.reduced(free, x, STEP / norm)
            gradient, leading, gain, beta = reduce(
                both, both, chopped, chopped, reduced, free, free, Hp
            )
            reason = self._ends(math.sqrt(gradient))
            if reason is not None:
                return reason
            # proportional: ‖chopped‖² ≤ Γ² (reduced free)·free, the paper's test of whether the active bounds may stay
            if not leading <= PROPORTION**2 * gain:
                self.steps["proportioning"] += 1
                H_chopped = multiply(chopped)
                bent, slope, size, longest = along(chopped, H_chopped)
                norm, step = max(norm, bent / size), min(slope / bent, longest)
                change, H_change, curvature = -step * chopped, -step * H_chopped, 0.0
            else:
                p = free - (beta / curvature) * p if curvature else free  # β = freeᵀ H p
                Hp = multiply(p)
                curvature, slope, size, longest = along(p, Hp)
                if not curvature > 0.0:  # underflow, or not a number
                    return TaoReason.DIVERGED_NAN
                # Rayleigh quotients improve ‖H‖ from below
                norm, step = max(norm, curvature / size), slope / curvature
                if not step > longest:
                    self.steps["cg"] += 1
                    change, H_change = -step * p, -step * Hp
                else:
                    self.steps["expansion"] += 1
                    # the projected conjugate gradient step, if it lowers the objective
                    curvature, change = 0.0, feasible.project(x - step * p) - x
                    H_change = multiply(change)
                    if rise(change, H_change) >= 0.0:
                        # else the paper's: to the bound, then a step of fixed length
                        half_x, half_g = x - longest * p, g - longest * Hp
                        half_free = feasible.split(half_g, half_x)[0]
                        while True:
                            change = feasible.project(half_x - STEP / norm * half_free) - x
                            H_change = multiply(change)
                            if not rise(change, H_change) > 0.0:
                                break
                            norm *= 2.0  # the estimate, from below, was too small
            x += change
            g += H_change
            x[:] = feasible.project(x)  # removes rounding


def reduction(X: PETSc.Vec) -> Callable[..., list[float]]:
    """A function for the scalar products of pairs of local arrays, summed over all ranks of X, and the least of all
    ranks' `least`, in one reduction; the same on all ranks."""
    comm = in_lockstep(X.comm.tompi4py())

    def reduce(*vectors: np.ndarray, least: float | None = None) -> list[float]:
        products = [float(a @ b) for a, b in zip(vectors[::2], vectors[1::2], strict=True)]
        if comm.size == 1:
            return products if least is None else [*products, least]
        mine = np.array(products if least is None else [*products, least])
        everyone = np.empty((comm.size, len(mine)))
        comm.Allgather(mine, everyone)
        return [
            *everyone[:, : len(products)].sum(axis=0).tolist(),
            *everyone[:, len(products) :].min(axis=0).tolist(),
        ]

    return reduce


def hessian_norm(H: PETSc.Mat, like: PETSc.Vec, reduce: Callable[..., list[float]]) -> float:
    """‖H‖₂ from below, as the context of H knows it or by Lanczos steps on vectors `like` this one."""
    context = H.getPythonContext() if H.getType() == PETSc.Mat.Type.PYTHON else None
    if context is not None and hasattr(context, "norm"):
        return context.norm()
    v, w = like.duplicate(), like.duplicate()

    def mult(x: np.ndarray, y: np.ndarray) -> None:
        v.array[:] = x
        H.mult(v, w)
        y[:] = w.array_r

    def products(V: np.ndarray, y: np.ndarray) -> np.ndarray:
        return np.array(reduce(*(vector for v in V for vector in (v, y))))

    return estimate_norm(mult, like.getLocalSize(), products=products, steps=like.getSize())
