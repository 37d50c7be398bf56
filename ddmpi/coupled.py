"""The coupled problem by brute force, as a check: both compliances dense, in one process.

Shares nothing with the iterations: a Tresca problem is one bounded least-squares problem, solved by
scipy's BVLS (an exact active-set method); a Coulomb problem a fixed point of such.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg import cholesky, solve_triangular

from ddmpi.body import Body, Friction
from ddmpi.errors import InputError, NotConvergedError
from ddmpi.exchange import Exchange, agreed
from ddmpi.interface import Interface

LARGEST = 2000
"""Most contact unknowns that are solved this way; BVLS is cubic in them, and worse."""

FIXED_POINT = 1e-12
"""Relative change of the slip bound at which the fixed point of Coulomb friction is reached."""


def check_size(interface: Interface) -> None:
    """InputError when the interface is too large to be solved this way."""
    if interface.size > LARGEST:
        raise InputError(f"the coupled problem has {interface.size} contact unknowns; by brute force {LARGEST} are "
                         "the most")


def solve_coupled(body: Body, friction: Friction, exchange: Exchange) -> np.ndarray:
    """The contact forces (size,) of the coupled problem (N).

    Collective on both bodies; both solve the same problem. Raises NotConvergedError when the fixed
    point of Coulomb friction is not found, InputError for too large an interface; on both.
    """
    C, h, s = np.empty((0, 0)), body.h, np.empty(0)
    with agreed(exchange.world):
        check_size(body.interface)
        C = body.C.dense()
    C, d = sum(exchange.swap_objects(C)), sum(exchange.swap_objects(h))
    d[:body.interface.m] -= body.interface.gap
    with agreed(exchange.world):
        s = solve_dense(C, d, body.interface, friction)
    return s


def solve_dense(C: np.ndarray, d: np.ndarray, interface: Interface, friction: Friction) -> np.ndarray:
    """min ½ sᵀCs − sᵀd with s_ν ≥ 0, |s_t| ≤ g, and g = 𝓕 s_ν at the solution for Coulomb friction.

    C (size, size), d (size,). Not collective.
    """
    m = interface.m
    if friction.law != "coulomb":
        return _bounded(C, d, m, friction.bound)
    g, s = np.zeros(len(interface.sliding)), np.zeros(len(d))
    relaxation, last = 1.0, np.inf
    for _ in range(500):
        s = _bounded(C, d, m, g)
        change = friction.slip_bound(s[:m], interface) - g
        size = np.linalg.norm(change)
        if size <= FIXED_POINT * np.linalg.norm(s):
            return s
        if size > 0.9 * last:
            relaxation = max(0.7 * relaxation, 0.02)
        last = size
        g = g + relaxation * change
    raise NotConvergedError("brute force: the successive approximations of the slip bound do not converge "
                            f"(last change {size / np.linalg.norm(s):.1e}); for a large friction coefficient "
                            "a solution need not be unique")


def _bounded(C: np.ndarray, d: np.ndarray, m: int, g: np.ndarray) -> np.ndarray:
    """The QP with bounds by BVLS, scaled free of units; zero-width bounds are taken out."""
    from scipy.optimize import lsq_linear

    force = np.linalg.norm(d) / np.linalg.norm(C, 2) or 1.0
    lower, upper = np.zeros(len(d)), np.full(len(d), np.inf)
    lower[m:], upper[m:] = -g / force, g / force
    moving = upper > lower
    scale = 1.0 / np.sqrt(np.diag(C)[moving])
    K = scale[:, None] * C[np.ix_(moving, moving)] * scale
    U = cholesky(K)
    right = solve_triangular(U, scale * d[moving] / force, trans="T")
    bounds = (lower[moving] / scale, upper[moving] / scale)
    found = lsq_linear(U, right, bounds, method="bvls", tol=1e-15, max_iter=20 * len(d))
    s = np.zeros(len(d))
    s[moving] = np.clip(scale * found.x, lower[moving], upper[moving])
    return force * s
