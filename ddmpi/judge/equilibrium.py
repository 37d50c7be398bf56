"""Whether contact forces can hold the bodies that no clamps hold, and if not, how these would move.

Forces s within the laws, with G s = e, are equilibrium of all rigid motions. A linear program looks for the least
‖G s − e‖₁. If it is not zero, no solution exists, and the program's dual proves it: rigid velocities that press into no
contact and on which the loads do work. With Coulomb friction that dual lifts what slides (associated flow), so the
mechanism that is named and drawn is another one, see `_release`. Serial work on plain arrays.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.interface import Interface
from ddmpi.judge.motions import MotionsOfBody, describe_motions

IMBALANCE = 1e-6
"""Loads of this part of all loads on a body that nothing balances are no rounding: there is no equilibrium."""

ROUNDING = 1e-9
"""Loads on rigid motions below this part of all loads on a body are what rounding leaves of none."""

LIGHTEST = 1e-3
"""Loads of a body are compared with at least this part of the largest loads of any body."""

PROVEN = 1e-7
"""A mechanism may press into a contact with this part of its velocity (the program's tolerance), not more."""

BENT = 1e-7
"""A contact is straight or flat if what its forces do on rigid motions bends by less than this part of it."""

DIGITS = 7
"""Forces whose directions agree in so many digits are parallel."""

HULL = 3
"""Corners are looked for in at most so many dimensions."""

SMALL = 1e-6
"""A motion without lift that is smaller than this part of the one with it is none."""

PRESSES = 1e-6
"""The motion that is shown may press into a contact with this part of its velocity."""

OPENS = 1e-3
"""Contact nodes that part with less than this part of the largest velocity stay together."""

WEIGHT = 1e4
"""Of equations that turn bounds into non-negative unknowns."""

BOUNDED = 1000
"""With more bounded forces, those of Tresca's law where contacts are not straight, the release takes too long."""

ROUNDS = 30
"""So often cones get edges that a motion lacks."""

ITERATIONS = 10
"""At most so many iterations of least squares per unknown."""

SAME = 1e-13
"""Columns whose difference is below this part of them are the same."""

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


def find_mechanism(interfaces: Sequence[Interface], G: sparse.spmatrix, e: np.ndarray, bodies: Sequence[MotionsOfBody],
                   load: np.ndarray | None = None) -> Mechanism | None:
    """The mechanism that shows that no contact forces hold the loose bodies; None where some do.

    None does not prove that there is an equilibrium: with Coulomb friction forces that balance the loads may be out of
    reach of elastic bodies. What the program cannot prove (which has not been seen) is not reported.

    Parameters
    ----------
    G : (nc, size) power of the forces of all interfaces on the rigid motions, body by body
    e : (nc,) power of the loads on them (N, for motions in metres)
    load : (nb,) sum of the sizes of all nodal loads on each body (N), with which rounding is compared; by default
        the largest of its e, which does not see loads that cancel

    Not collective.
    """
    if not bodies:
        return None
    scale = Scale([body.speeds for body in bodies], e, load)
    if scale.idle(e):
        return None
    A, b = scale.rows(G), e / scale.unit / scale.largest
    imbalance, dual = _least_imbalance(Forces.allowed(interfaces, A, scale.largest).program, b, scale)
    if dual is None:
        return None
    inside = Forces.allowed(interfaces, A, scale.largest, inside=True)
    motion = _release(A, inside, b, dual, bodies, scale)
    coefficients = motion / scale.unit
    velocities = np.array([body.velocity(part) for body, part in zip(bodies, scale.split(coefficients), strict=True)])
    fastest = max(body.speed(v) for body, v in zip(bodies, velocities, strict=True))
    return Mechanism(tuple(bodies), velocities / fastest, coefficients / fastest, imbalance,
                     frozenset(_touching(interfaces, A.T @ motion / fastest)))


def prove_imbalance(contacts: Sequence[Program], e: np.ndarray, scale: Scale) -> bool:
    """Whether no forces of the `contacts` balance the loads `e` (nc,), see `find_mechanism`. Not collective."""
    columns, lower, upper = zip(*contacts, strict=True)
    whole = Program(sparse.hstack(columns, format="csc"), np.concatenate(lower), np.concatenate(upper))
    return _least_imbalance(whole, e / scale.unit / scale.largest, scale)[1] is not None


class Scale:
    """What makes the program free of units.

    Parameters
    ----------
    speeds : of each loose body (j,), see `MotionsOfBody`
    e, load : as for `find_mechanism`

    Attributes
    ----------
    unit : (nc,) largest nodal velocity of each motion
    largest : loads (N) of the body that is loaded most
    of_row : (nc,) loads of the row's body (N), but not less than `LIGHTEST` of the largest
    """

    def __init__(self, speeds: Sequence[np.ndarray], e: np.ndarray, load: np.ndarray | None) -> None:
        numbers = [len(each) for each in speeds]
        self._starts = np.cumsum(numbers)[:-1]
        self.unit = np.concatenate(speeds)
        own = np.array([np.abs(part).max(initial=0.0) for part in self.split(e / self.unit)])
        loads = own if load is None else np.maximum(own, load)
        self.largest = float(loads.max())
        self.of_row = np.repeat(np.maximum(loads, LIGHTEST * self.largest), numbers)

    def idle(self, e: np.ndarray) -> bool:
        """Whether the loads e (nc,) are nothing but rounding."""
        return not self.largest or bool((np.abs(e) <= ROUNDING * self.of_row).all())

    def rows(self, G: sparse.spmatrix) -> sparse.csc_matrix:
        """G (nc, ·) for motions whose fastest node has velocity 1."""
        return sparse.csc_matrix(sparse.diags(1.0 / self.unit) @ G)

    def split(self, x: np.ndarray) -> list[np.ndarray]:
        """Parts of a vector (nc,) by body."""
        return np.split(x, self._starts)


class Program(NamedTuple):
    """The forces that contacts allow: combinations of `columns` (nc, k), each with coefficients between two (k,)."""

    columns: sparse.csc_matrix
    lower: np.ndarray
    upper: np.ndarray


@dataclass(frozen=True)
class Forces:
    """The forces that the laws allow.

    Attributes
    ----------
    program : their powers on the rigid motions, and what their coefficients lie between
    node : (k,) the column of G of the normal force of its node
    presses, leans : (k,) bool, whether it has a normal, and a tangential part
    owner : (size,) the column of G of the normal force of each column's node
    slope : (size,) of the cone of a node, at the column of its normal force; zero elsewhere
    """

    program: Program
    node: np.ndarray
    presses: np.ndarray
    leans: np.ndarray
    owner: np.ndarray
    slope: np.ndarray

    @classmethod
    def allowed(cls, interfaces: Sequence[Interface], A: sparse.csc_matrix, unit: float,
                inside: bool = False) -> Forces:
        """Of all interfaces; forces are counted in `unit` (N), and discs are polygons around them, or `inside` them.

        Of a flat piece with the same coefficient only the corners are needed: all nodes between are means of them.
        """
        entries: list[tuple[np.ndarray, ...]] = [(np.empty(0),) * 3]
        others: list[tuple[np.ndarray, ...]] = [(np.empty(0),) * 5]
        owner, slope, start, k = [np.empty(0, int)], np.zeros(A.shape[1]), 0, 0
        for interface in interfaces:
            law, own = interface.law, A[:, start:start + interface.size]
            rows = np.unique(own.indices)
            for forces, lower, upper in law.edges(inside=inside):
                columns = (own[rows] @ forces).toarray()
                if np.isinf(upper).all():
                    keep = np.flatnonzero(_corners(columns, forces.T @ interface.directions))
                    lower, upper = lower[keep], upper[keep]
                else:  # forces along the same line are as good as their sum
                    keep = np.flatnonzero(np.append(True, _length(np.diff(columns)) > SAME * _length(columns[:, 1:])))
                    lower, upper = (np.add.reduceat(each, keep) / unit for each in (lower, upper))
                forces, columns = forces[:, keep], columns[:, keep]
                i, j = np.nonzero(columns)
                entries.append((columns[i, j], rows[i], k + j))
                normal, tangential = (part.getnnz(axis=0) > 0 for part in (forces[:law.m], forces[law.m:]))
                others.append((lower, upper, start + law.node[forces.indices[forces.indptr[:-1]]], normal, tangential))
                k += len(keep)
            owner.append(start + law.node)
            slope[start + law.sliding] = law.slope(np.zeros(law.m))
            start += interface.size
        value, row, column = (np.concatenate(each) for each in zip(*entries, strict=True))
        lower, upper, node, presses, leans = (np.concatenate(each) for each in zip(*others, strict=True))
        columns = sparse.csc_matrix((value, (row.astype(int), column.astype(int))), (A.shape[0], k))
        return cls(Program(columns, lower, upper), node.astype(int), presses.astype(bool), leans.astype(bool),
                   np.concatenate(owner), slope)

    @property
    def tangential(self) -> np.ndarray:
        """(size,) bool, the columns of G of tangential forces."""
        return self.owner != np.arange(len(self.owner))

    def sliding(self, rate: np.ndarray) -> np.ndarray:
        """(size,) how fast nodes slide, at the columns of their normal forces, from all velocities (size,) there."""
        squares = np.where(self.tangential, rate, 0.0) ** 2
        return np.sqrt(np.bincount(self.owner, squares, len(rate)))

    def edges(self, nodes: np.ndarray, rate: np.ndarray) -> sparse.csc_matrix:
        """(size, k) the edges of the cones of `nodes` (k,) that resist the sliding of `rate` (size,) most."""
        size = self.sliding(rate)[self.owner]
        along = np.divide(rate, size, out=np.zeros_like(rate), where=size > 0.0)
        entry, place = np.flatnonzero(np.isin(self.owner, nodes)), np.searchsorted(nodes, self.owner)
        value = np.where(self.tangential, self.slope[self.owner] * along, 1.0)
        return sparse.csc_matrix((value[entry], (entry, place[entry])), (len(rate), len(nodes)))


def _corners(columns: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(k,) bool: which columns are not means of others with the same force `along` (k, d), and not zero.

    What a force does on the motions of a body is linear in its place, so means of places are means of columns.
    """
    from scipy.spatial import ConvexHull

    length = _length(columns)
    keep = np.zeros(len(length), bool)
    if not length.any():
        return keep
    _, group = np.unique(np.round(along, DIGITS), axis=0, return_inverse=True)
    order = np.argsort(group.ravel(), kind="stable")
    for members in np.split(order, np.cumsum(np.bincount(group.ravel()))[:-1]):
        x = columns[:, members] - columns[:, members].mean(axis=1, keepdims=True)
        axes, sizes, _ = np.linalg.svd(x, full_matrices=False)
        rank = int((sizes > BENT * length[members].max(initial=0.0)).sum())
        places = x.T @ axes[:, :rank]
        if rank == 0:
            members = members[:1]
        elif rank == 1:
            members = members[[places.argmin(), places.argmax()]]
        elif rank <= HULL and len(members) > rank + 1:
            members = members[ConvexHull(places / np.abs(places).max(axis=0)).vertices]
        keep[members] = True
    return keep & (length > 0.0)


def _length(columns: np.ndarray) -> np.ndarray:
    return np.linalg.norm(columns, axis=0)


def _least_imbalance(forces: Program, b: np.ndarray, scale: Scale) -> tuple[float, np.ndarray | None]:
    """The least Σ |A x − b| over the loads of the row's body, and its derivative by b, rigid velocities (nc,), if these
    prove that there is no equilibrium."""
    from scipy.optimize import linprog

    n, one, weight = len(b), sparse.identity(len(b)), scale.of_row / scale.largest
    k = len(forces.lower)
    bounds = np.concatenate([np.column_stack([forces.lower, forces.upper]), np.tile([0.0, np.inf], (2 * n, 1))])
    answer = linprog(np.concatenate([np.zeros(k), 1.0 / weight, 1.0 / weight]),
                     A_eq=sparse.hstack([forces.columns, one, -one], format="csc"), b_eq=b, bounds=bounds,
                     method="highs", options={"primal_feasibility_tolerance": 1e-10,
                                              "dual_feasibility_tolerance": 1e-10})
    if answer.status != 0 or not answer.fun > IMBALANCE:
        return 0.0, None
    dual = np.asarray(answer.eqlin.marginals)
    return float(answer.fun), dual if _is_proof(forces, b, dual) else None


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
    inside, get the edges that the motion lacks. Their friction lifts what slides, so another projection follows, on
    the motions that keep together what is pressed and hold what sticks.
    """
    moves = np.concatenate([np.full(len(part), len(bodies) <= MANY or np.abs(part).max() > PROVEN * np.abs(dual).max())
                            for part in scale.split(dual)])
    if moves.sum() > 2 * MANY * len(bodies[0].basis) or np.isfinite(forces.program.upper).sum() > BOUNDED:
        return dual
    measure = max(body.measure for body in bodies)
    W = np.asarray(sparse.block_diag([
        np.linalg.inv(np.linalg.cholesky(body.inertia / np.outer(unit, unit) / measure))
        for body, unit in zip(bodies, scale.split(scale.unit), strict=True)]).todense())[moves]
    nodes = np.unique(forces.node[forces.presses])
    columns, lower, upper = W @ forces.program.columns, forces.program.lower, forces.program.upper
    for _ in range(ROUNDS):
        x = _least_squares(columns, W @ b, lower, upper)
        left = W @ b - columns @ x
        lifted = W.T @ left
        if not np.isfinite(lifted).all() or not b @ lifted > 0.0:
            return dual
        rate, least = A.T @ lifted, PROVEN * np.abs(lifted).max()
        slides = forces.sliding(rate)
        closes = np.where(forces.tangential, 0.0, rate) + forces.slope * slides
        lacking = nodes[closes[nodes] > least]
        if not len(lacking):
            break
        used = (x > lower) | np.isinf(lower) | np.isfinite(upper)
        columns = np.hstack([columns[:, used], W @ (A @ forces.edges(lacking, rate))])
        lower = np.append(lower[used], np.zeros(len(lacking)))
        upper = np.append(upper[used], np.full(len(lacking), np.inf))
    else:
        return dual
    touches = closes >= -least
    sticks = (slides <= least) & (touches | (forces.slope == 0.0))
    stuck = np.flatnonzero(forces.tangential & sticks[forces.owner]
                           & np.isin(forces.owner, forces.node[forces.leans]))
    lower = np.concatenate([np.where(touches[nodes], -np.inf, 0.0), np.full(len(stuck), -np.inf)])
    columns = W @ A[:, np.concatenate([nodes, stuck])]
    y = _least_squares(columns, left, lower, np.full(len(lower), np.inf))
    motion = W.T @ (left - columns @ y)
    size = np.abs(motion).max()
    good = size > SMALL * np.abs(lifted).max() and b @ motion > 0.0 and (A[:, nodes].T @ motion <= PRESSES * size).all()
    return motion if good else lifted


def _least_squares(A: np.ndarray, b: np.ndarray, lower: np.ndarray, upper: np.ndarray) -> np.ndarray:
    """The x between bounds with the least ‖A x − b‖; nan where it is not found.

    Finite bounds [−g, g], Tresca's, become those of non-negative unknowns by rows x + y = 2g of a large weight.
    """
    from scipy.optimize import lsq_linear, nnls

    k, free, boxed = len(lower), np.isinf(lower), np.isfinite(upper)
    if not k:
        return np.zeros(0)  # SciPy 1.17's nnls would free its memory twice
    start = np.where(free, 0.0, lower)
    limits = np.eye(k)[boxed]
    extended = np.block([[A, -A[:, free], np.zeros((len(b), len(limits)))],
                         [WEIGHT * limits, np.zeros((len(limits), free.sum())), WEIGHT * np.eye(len(limits))]])
    right = np.concatenate([b - A @ start, WEIGHT * (upper - start)[boxed]])
    try:
        x, _ = nnls(extended, right, maxiter=ITERATIONS * extended.shape[1])
    except RuntimeError:
        return np.full(k, np.nan)
    gradient = extended.T @ (extended @ x - right)
    if not max(-gradient.min(initial=0.0), np.abs(gradient[x > 0.0]).max(initial=0.0)) <= (
            PROVEN * np.abs(extended.T @ right).max(initial=0.0)):  # SciPy 1.17 has returned what is no minimum
        x = lsq_linear(extended, right, (0.0, np.inf), method="bvls").x
    full = start + x[:k]
    full[free] -= x[k:k + free.sum()]
    return full


def _touching(interfaces: Sequence[Interface], rate: np.ndarray) -> Iterator[frozenset[str]]:
    """Pairs of bodies that have a contact node that does not open, from the velocities (size,) at the contacts."""
    ends = np.cumsum([interface.size for interface in interfaces])[:-1]
    for interface, own in zip(interfaces, np.split(rate, ends), strict=True):
        if (np.abs(own[:interface.m]) <= OPENS).any():
            yield frozenset(interface.bodies)
