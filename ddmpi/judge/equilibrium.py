"""Whether contact forces can hold the bodies that no clamps hold, and if not, how these would move.

Forces s within the laws, with G s = e, are equilibrium of all rigid motions. A linear program looks for the least
‖G s − e‖₁. If it is not zero, no solution exists, and the program's dual proves it: rigid velocities that press into no
contact and on which the loads do work. With Coulomb friction that dual lifts what slides (associated flow), so the
mechanism that is named and drawn is another one, see `_release`. Serial work on plain arrays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.interface import Interface
from ddmpi.judge.forces import Forces, Program, Scale
from ddmpi.judge.motions import MotionsOfBody, describe_motions

IMBALANCE = 1e-6
"""Loads of this part of all loads on a body that nothing balances are no rounding: there is no equilibrium."""

PROVEN = 1e-7
"""A mechanism may press into a contact with this part of its velocity (the program's tolerance), not more."""

SMALL = 1e-6
"""A motion without lift that is smaller than this part of the one with it is none."""

PRESSES = 1e-6
"""The motion that is shown may press into a contact with this part of its velocity."""

OPENS = 1e-3
"""Contact nodes that part with less than this part of the largest velocity stay together."""

WEIGHT = 1e3
"""Of equations that bound sums of unknowns."""

CONVERGED = 1e-5
"""The motion may differ from the true one by this part of it, in the norm of its energy."""

ROUNDS = 50
"""So often contacts get forces that a motion lacks."""

ITERATIONS = 10
"""At most so many iterations of least squares per unknown."""

MANY = 40
"""With more bodies only those that the linear program moves take part in the release, at most twice as many."""


@dataclass(frozen=True)
class Mechanism:
    """How loose bodies move if no contact forces hold them.

    Attributes
    ----------
    bodies : the loose ones
    velocities : (nb, n) of each, as of `MotionsOfBody`; the fastest node has velocity 1
    coefficients : (nc,) the same as a combination of the rigid motions, in the order of the rows of G
    imbalance : the least ‖G s − e‖₁ there is, in parts of the bodies' loads
    touching : pairs of names of bodies, or rigid partners, that stay in contact
    """

    bodies: tuple[MotionsOfBody, ...]
    velocities: np.ndarray
    coefficients: np.ndarray
    imbalance: float
    touching: frozenset[frozenset[str]]


def describe(mechanism: Mechanism) -> str:
    """The mechanism in words that begin with "no equilibrium". Not collective."""
    return f"no equilibrium: {describe_motions(mechanism.bodies, mechanism.velocities, set(mechanism.touching))}"


def prove_imbalance(contacts: Sequence[Program], e: np.ndarray, scale: Scale) -> tuple[float, np.ndarray] | None:
    """The least imbalance that forces of the `contacts` leave of the loads `e` (nc,), Σ |G s − e| over the loads of the
    row's body, and its derivative by e, rigid velocities (nc,), if these prove that there is no equilibrium.

    None does not prove that there is one: with Coulomb friction forces that balance the loads may be out of reach of
    elastic bodies. What the program cannot prove (which has not been seen) is not reported. Not collective.
    """
    from scipy.optimize import linprog

    columns, lower, upper = zip(*contacts, strict=True)
    forces = Program(sparse.hstack(columns, format="csc"), np.concatenate(lower), np.concatenate(upper))
    b, weight, k, n = e / scale.unit / scale.largest, scale.of_row / scale.largest, len(forces.lower), len(e)
    one = sparse.identity(n)
    bounds = np.concatenate([np.column_stack([forces.lower, forces.upper]), np.tile([0.0, np.inf], (2 * n, 1))])
    answer = linprog(np.concatenate([np.zeros(k), 1.0 / weight, 1.0 / weight]),
                     A_eq=sparse.hstack([forces.columns, one, -one], format="csc"), b_eq=b, bounds=bounds,
                     method="highs", options={"primal_feasibility_tolerance": 1e-10,
                                              "dual_feasibility_tolerance": 1e-10})
    if answer.status != 0 or not answer.fun > IMBALANCE:
        return None
    dual = np.asarray(answer.eqlin.marginals)
    return (float(answer.fun), dual) if _is_proof(forces, b, dual) else None


def find_mechanism(interfaces: Sequence[Interface], G: sparse.spmatrix, e: np.ndarray, bodies: Sequence[MotionsOfBody],
                   scale: Scale, imbalance: float, dual: np.ndarray) -> Mechanism:
    """How loose bodies move that no contact forces hold, as `prove_imbalance` has shown. Not collective.

    Parameters
    ----------
    G : (nc, size) power of the forces of all interfaces on the rigid motions, body by body
    e : (nc,) power of the loads on them (N, for motions in metres)
    """
    A, b = scale.rows(G), e / scale.unit / scale.largest
    inside = Forces.allowed(interfaces, A, scale.largest, inside=True)
    motion = _release(A, inside, b, dual, bodies, scale)
    coefficients = motion / scale.unit
    velocities = np.array([body.velocity(part) for body, part in zip(bodies, scale.split(coefficients), strict=True)])
    fastest = max(body.speed(v) for body, v in zip(bodies, velocities, strict=True))
    return Mechanism(tuple(bodies), velocities / fastest, coefficients / fastest, imbalance,
                     frozenset(_touching(interfaces, A.T @ motion / fastest)))


def _is_proof(forces: Program, b: np.ndarray, motion: np.ndarray) -> bool:
    """Whether the loads do more work on the motion (nc,) than all allowed forces together could take."""
    size = np.abs(motion).max()
    if not size:
        return False
    rate = forces.columns.T @ (motion / size)
    rate[np.abs(rate) <= PROVEN] = 0.0
    bound = np.where(rate > 0.0, forces.upper, forces.lower)
    return bool(b @ motion / size > (rate[rate != 0.0] * bound[rate != 0.0]).sum())


def _release(A: sparse.csc_matrix, forces: Forces, b: np.ndarray, dual: np.ndarray, bodies: Sequence[MotionsOfBody],
             scale: Scale) -> np.ndarray:
    """The motion (nc,) with which the bodies would start if they were let go; `dual` where that is not found.

    By Gauss's principle of least constraint the accelerations of bodies of density one leave the least residual
    M^-½ (b − A x) there is. Unlike the dual, this does not depend on the axes; Coulomb's cones, at first polygons
    inside, get the edges that the motion lacks. Friction of given bounds is a mean of those that each contact bore
    against the motions of all rounds; it lacks what would take more power of the last one. Coulomb's friction lifts
    what slides, so another projection follows, on the motions that keep together what is pressed and hold what sticks.
    """
    moves = np.concatenate([np.full(len(part), len(bodies) <= MANY or np.abs(part).max() > PROVEN * np.abs(dual).max())
                            for part in scale.split(dual)])
    if moves.sum() > 2 * MANY * len(bodies[0].basis):
        return dual
    measure = max(body.measure for body in bodies)
    W = np.asarray(sparse.block_diag([
        np.linalg.inv(np.linalg.cholesky(body.inertia / np.outer(unit, unit) / measure))
        for body, unit in zip(bodies, scale.split(scale.unit), strict=True)]).todense())[moves]
    nodes = np.unique(forces.node[forces.presses])
    cones = np.isinf(forces.program.upper)
    columns, free = W @ forces.program.columns[:, cones], np.isinf(forces.program.lower[cones])
    share = np.zeros((forces.bound.shape[1], len(free)))
    for _ in range(ROUNDS):
        x = _least_squares(columns, W @ b, free, share)
        left = W @ b - columns @ x
        lifted = W.T @ left
        if not np.isfinite(lifted).all() or not b @ lifted > 0.0:
            return dual
        rate, least = A.T @ lifted, PROVEN * np.abs(lifted).max()
        slides = forces.sliding(rate)
        closes = np.where(forces.tangential, 0.0, rate) + forces.slope * slides
        lacking, friction = nodes[closes[nodes] > least], forces.friction(rate)
        held = (share * (left @ columns)).max(axis=1, initial=0.0)
        power = rate @ friction - held
        weak = np.flatnonzero(power > 0.0)
        if not len(lacking) and power.sum() <= CONVERGED ** 2 / 2 * (left @ left):
            break
        used = (x > 0.0) | free
        more = sparse.hstack([forces.edges(lacking, rate), friction[:, weak]], format="csc")
        columns = np.hstack([columns[:, used], W @ (A @ more)])
        free = np.append(free[used], np.zeros(len(lacking) + len(weak), bool))
        share = np.hstack([share[:, used], np.zeros((len(share), len(lacking))), np.eye(len(share))[:, weak]])
    if len(lacking):
        return dual
    if not forces.slope.any():
        return lifted
    touches = closes >= -least
    sticks = (slides <= least) & (touches | (forces.slope == 0.0))
    stuck = np.flatnonzero(forces.tangential & sticks[forces.owner]
                           & np.isin(forces.owner, forces.node[forces.leans]))
    free = np.append(touches[nodes], np.ones(len(stuck), bool))
    columns = W @ A[:, np.concatenate([nodes, stuck])]
    y = _least_squares(columns, left, free, np.empty((0, len(free))))
    motion = W.T @ (left - columns @ y)
    size = np.abs(motion).max()
    good = size > SMALL * np.abs(lifted).max() and b @ motion > 0.0 and (A[:, nodes].T @ motion <= PRESSES * size).all()
    return motion if good else lifted


def _least_squares(A: np.ndarray, b: np.ndarray, free: np.ndarray, share: np.ndarray) -> np.ndarray:
    """The x with the least ‖A x − b‖, not negative where not `free`, and share x ≤ 1; nan where it is not found."""
    from scipy.optimize import lsq_linear, nnls

    k, weight = len(free), WEIGHT * (share * np.linalg.norm(A, axis=0)).max(axis=1, initial=0.0)
    if not k:
        return np.zeros(0)  # SciPy 1.17's nnls would free its memory twice
    extended = np.block([[A, -A[:, free], np.zeros((len(b), len(share)))],
                         [weight[:, None] * share, np.zeros((len(share), free.sum())), np.diag(weight)]])
    right = np.append(b, weight)
    try:
        x, _ = nnls(extended, right, maxiter=ITERATIONS * extended.shape[1])
    except RuntimeError:
        return np.full(k, np.nan)
    gradient = extended.T @ (extended @ x - right)
    if not max(-gradient.min(initial=0.0), np.abs(gradient[x > 0.0]).max(initial=0.0)) <= (
            PROVEN * np.abs(A.T @ b).max(initial=0.0)):  # SciPy 1.17 has returned what is no minimum
        x = lsq_linear(extended, right, (0.0, np.inf), method="bvls").x
    full = x[:k].copy()
    full[free] -= x[k:k + free.sum()]
    return full


def _touching(interfaces: Sequence[Interface], rate: np.ndarray) -> Iterator[frozenset[str]]:
    """Pairs of bodies that have a contact node that does not open, from the velocities (size,) at the contacts."""
    ends = np.cumsum([interface.size for interface in interfaces])[:-1]
    for interface, own in zip(interfaces, np.split(rate, ends), strict=True):
        if (np.abs(own[:interface.m]) <= OPENS).any():
            yield frozenset(interface.bodies)
