"""The coupled problem by brute force, as a check: both compliances dense, in one process.

Shares nothing with the iterations: a Tresca problem is one bounded least-squares problem, solved by
scipy's BVLS (an exact active-set method); a Coulomb problem a fixed point of such.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, solve_triangular
from scipy.optimize import lsq_linear

from ddmpi.coupling.assembly import Assembly
from ddmpi.coupling.member import Member
from ddmpi.interface.law import Law
from ddmpi.sets import Box
from ddmpi.system.numbers import norm

PRECISE, USABLE, ROUNDS = 1e-12, 1e-6, 3
"""Projected gradient, of normal and of tangential unknowns by themselves, over the displacements there, below which
a program is solved, and below which it will do; and how often the problem that is left is solved to get there."""

FIXED_POINT = 1e-12
"""Relative change of the slip bound at which the fixed point of Coulomb friction is reached."""


def dense(member: Member) -> np.ndarray:
    """C (size, size) of a body (m/N), centred if it is loose, by multiplications. Collective on its communicator."""
    C = np.empty((member.C.size, member.C.size))
    for unit, row in zip(np.eye(len(C)), C, strict=True):
        member.mult(unit, row, "dense")
    return (C + C.T) / 2


def solve_coupled(assembly: Assembly) -> np.ndarray:
    """The contact forces of the coupled problem (N), on the rank that owns the interface; empty on another.

    For two bodies in the plane that clamps hold, with one contact. Collective on both bodies.
    """
    assert assembly.joint.bodies == 2 and len(assembly.scene.contact) == 1 and not assembly.loose
    C = sum(assembly.world.allgather(sum(dense(body.member) for body in assembly.bodies)))
    try:
        s = (
            solve_dense(C, assembly.joint.d, assembly.space.laws.laws[0])
            if assembly.space.interfaces
            else np.empty(0)
        )
        failed = ""
    except AssertionError as error:
        failed = str(error) or "brute force fails"
    # All ranks look at it: it fails on both bodies, not on one alone.
    assert not (told := "".join(assembly.world.allgather(failed))), told
    return s


def solve_dense(C: np.ndarray, d: np.ndarray, law: Law) -> np.ndarray:
    """min ½ sᵀCs − sᵀd with s_ν ≥ 0, |s_t| ≤ g, and g = 𝓕 s_ν at the solution for Coulomb friction.

    C (size, size), d (size,). Not collective.
    """
    m, s = law.m, np.zeros(len(d))
    g = law.bound_at(s)
    relaxation, last = 1.0, np.inf
    for _ in range(500):
        s = _bounded(C, d, m, g)
        change = law.bound_at(s) - g
        size = norm(change)
        if size <= FIXED_POINT * np.linalg.norm(
            s
        ):  # at once, where the bound does not follow the normal forces
            assert _error(C, d, m, g, s) <= USABLE, (
                "rounding hides the normal or the tangential part of the answer"
            )
            return s
        if size > 0.9 * last:
            relaxation = max(0.7 * relaxation, 0.02)
        last = size
        g = g + relaxation * change
    raise AssertionError(
        "the fixed point of the slip bound is not found; a solution need not be unique"
    )


def _bounded(C: np.ndarray, d: np.ndarray, m: int, g: np.ndarray) -> np.ndarray:
    """The QP with bounds |s_t| ≤ g.

    BVLS judges by the cost as a whole, which may hide one kind of unknown behind the other. So the problem
    that is left is solved again, in its own scale.
    """
    lower, upper, s = np.zeros(len(d)), np.full(len(d), np.inf), np.zeros(len(d))
    lower[m:], upper[m:] = -g, g
    for _ in range(ROUNDS):
        change, bound = _least_squares(C, d - C @ s, lower - s, upper - s)
        s = np.where(bound < 0, lower, np.where(bound > 0, upper, s + change))  # exactly on them
        if _error(C, d, m, g, s) <= PRECISE:
            break
    return s


def _error(C: np.ndarray, d: np.ndarray, m: int, g: np.ndarray, s: np.ndarray) -> float:
    """Projected gradient over the displacements at hand, of normal or tangential unknowns, the larger."""
    box = Box(np.append(np.zeros(m), -g), np.append(np.full(m, np.inf), g))
    left, size = box.projected_gradient(C @ s - d, s), np.abs(C) @ np.abs(s) + np.abs(d)
    parts = slice(m), slice(m, None)
    return max(norm(left[part]) / (norm(size[part]) or 1.0) for part in parts)


def _least_squares(
    C: np.ndarray,
    d: np.ndarray,
    lower: np.ndarray,
    upper: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """min ½ sᵀCs − sᵀd within bounds by BVLS, scaled free of units; s, and where it is on a bound: −1, 0, 1."""
    force = np.linalg.norm(d) / np.linalg.norm(C, 2) or 1.0
    lower, upper = lower / force, upper / force
    moving = upper > lower
    scale = 1.0 / np.sqrt(np.diag(C)[moving])
    K = scale[:, None] * C[np.ix_(moving, moving)] * scale
    U = cholesky(K)
    right = solve_triangular(U, scale * d[moving] / force, trans="T")
    bounds = (lower[moving] / scale, upper[moving] / scale)
    found = lsq_linear(U, right, bounds, method="bvls", tol=1e-15, max_iter=20 * len(d))
    s, bound = np.zeros(len(d)), np.ones(len(d), int)
    s[moving], bound[moving] = scale * found.x, found.active_mask
    return force * s, bound
