"""Whether contact forces can balance the loads on loose bodies, those without enough clamps, and how they move if not.

Contact forces s within the laws with G s = e are an equilibrium of all rigid motions. By Gauss's principle of least
constraint, rigid bodies at rest that are let go start with the velocities v that minimise, in Moreau's form,

    ½ v·Mv − e·v + Σ g |v_t|    over all v that press into no contact, with friction: v_ν + 𝓕 |v_t| ≤ 0 at each node

(J. J. Moreau, Unilateral contact and dry friction in finite freedom dynamics, 1988). The pressures are the multipliers
of the conditions, and M v = e − G s is what the forces leave of the loads. So v = 0 if there is an equilibrium. If not,
e·v > Σ g |v_t|: v proves that no allowed forces balance the loads, as it presses into no contact, and the loads do
more work on it than friction of given bounds takes. The proof is checked apart, whatever status the solver returns.

The condition with 𝓕 lifts what slides (associated flow). So the motion that is named has v_ν ≤ 0 and g = 𝓕 s_ν, which
follows the pressures of the solution before: the paper's fixed point, for rigid bodies as in V. Acary, B. Brogliato,
Numerical Methods for Nonsmooth Dynamical Systems, 2008. Serial work on plain arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.interface import Interface
from ddmpi.judge.motions import MotionsOfBody, describe_motions
from ddmpi.system.numbers import ALIKE

IMBALANCE = 1e-6
"""There is no equilibrium if this fraction of the loads on a body stays without balance. By this fraction of its
velocity a mechanism may press into a contact, the solver's tolerance."""

SLOWEST = 1e-4  # rows that meet slower motions than this fraction of the fastest are compared with this fraction
SLIGHT = 1e-9
"""Near a limit less than IMBALANCE stays without balance. Of a run that finds no answer, from this fraction on it is the
reason: the program tells 1e-7 beyond tipping and sliding from 1e-7 before."""

LEAK = 10.0
"""A slight imbalance is proved if its work is more than this times what the contacts that a mechanism presses into by
rounding may do, under the pressures of the program and all loads."""

LIGHTEST = (
    1e-3,
    1e-6,
)  # loads and mass of a body count as at least these fractions of the largest ones
ROUNDS, SETTLED = (
    20,
    1e-5,
)  # most rounds in which bounds follow pressures, until v changes by less than SETTLED

TOLERANCES = (1e-16, 1e-12, 1e-12), (1e-13, 1e-9, 1e-9)
"""Tolerances of clarabel for gap, relative gap and feasibility: first strict ones, near a limit looser ones."""

BENT = 1e-7  # a contact is flat if its forces on the rigid motions bend by less than this fraction of them
DIGITS = 7  # directions and coefficients that agree to this many digits are equal
NEAR = 1e-3  # from this imbalance on it needs no word
HULL = 3  # most dimensions in which corners of a convex hull are computed


@dataclass(frozen=True)
class Mechanism:
    """How loose bodies move if no contact forces balance their loads.

    Attributes
    ----------
    bodies : the loose ones
    velocities : (nb, n) of each, as of `MotionsOfBody`; the fastest node has velocity 1
    imbalance : least loads that no forces balance, as a fraction of the loads on a body
    load : the loads of which it is the fraction, for this motion (N)
    because : what follows the motion in words, where only the facets of meshes resist it
    """

    bodies: tuple[MotionsOfBody, ...]
    velocities: np.ndarray
    imbalance: float
    because: str = ""
    load: float = 0.0


def describe(mechanism: Mechanism) -> str:
    """The mechanism in words that begin with "no equilibrium". Not collective."""
    motions = describe_motions(mechanism.bodies, mechanism.velocities)
    if mechanism.imbalance <= NEAR:
        motions += f", as nothing balances {mechanism.imbalance:.0e} of the loads"
    doubt = " (or should its `along` be turned round?)" * ("pretension of" in motions)
    return f"no equilibrium: {motions}{mechanism.because}{doubt}"


def find_mechanism(
    contacts: Sequence[Forces],
    e: np.ndarray,
    bodies: Sequence[MotionsOfBody],
    load: np.ndarray | float = 0.0,
    least: float = IMBALANCE,
) -> Mechanism | None:
    """How loose bodies move if no contact forces can balance their loads, else None. Not collective.

    None does not prove that there is an equilibrium: with Coulomb friction forces that balance the loads may be out of
    reach of elastic bodies.

    Parameters
    ----------
    e : (nc,) power of the loads on the rigid motions, body by body (N, for motions in metres)
    load : (nb,) sum of the sizes of all nodal loads on each body (N), with which rounding is compared: e does not see
        loads that cancel
    least : smallest imbalance that counts
    """
    free = _Free(Forces.together(contacts, len(e)), e, bodies, load)
    if free.idle:
        return None
    slope = free.forces.slope
    none = np.zeros_like(slope)
    v, pressure = free.start(slope, none)
    imbalance = free.imbalance(v, slope)
    if not imbalance > least or (
        imbalance <= IMBALANCE and not free.proves(v, slope, pressure.sum(), imbalance)
    ):
        return None
    for _ in range(ROUNDS * bool(slope.any())):
        before, (v, pressure) = v, free.start(none, slope * pressure)
        if not free.imbalance(v, none) > (
            0.0 if imbalance > IMBALANCE else least
        ):  # friction of these bounds balances the loads, or v was not found
            v = before
            break
        if np.abs(v - before).max() <= SETTLED * np.abs(v).max():
            break
    velocities, speeds = free.velocities(v)
    acting = float((speeds * free.loads).max() / speeds.max())
    return Mechanism(tuple(bodies), velocities / speeds.max(), imbalance, load=acting)


class _Free:
    """Rigid bodies, each with a mass in proportion to its loads, that are let go under the loads e (nc,).

    Attributes
    ----------
    forces : that contacts allow
    idle : whether the loads are nothing but rounding
    """

    def __init__(
        self,
        forces: Forces,
        e: np.ndarray,
        bodies: Sequence[MotionsOfBody],
        load: np.ndarray | float,
    ) -> None:
        self.forces, self._e, self._bodies = forces, e, bodies
        self._starts = np.cumsum([body.basis.shape[1] for body in bodies])[:-1]
        self._components = bodies[0].dimension - 1
        # v = Wᵀ w with M⁻¹ = Wᵀ W: in w neither the basis of the motions nor units matter, and v·Mv is w·w.
        roots = [np.linalg.inv(np.linalg.cholesky(body.inertia)) for body in bodies]
        net = np.array(
            [
                np.linalg.norm(root @ of_body)
                for root, of_body in zip(roots, np.split(e, self._starts), strict=True)
            ]
        )
        loads = np.maximum(net, load)
        self._largest = float(loads.max())
        self.loads = np.maximum(loads, LIGHTEST[0] * self._largest)
        self.idle = bool((net <= ALIKE * self.loads).all())
        masses = np.maximum(loads / (self._largest or 1.0), LIGHTEST[1])
        self._W = sparse.block_diag(
            [root / np.sqrt(mass) for root, mass in zip(roots, masses, strict=True)], "csr"
        )

    def velocities(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the bodies (nb, n), as of `MotionsOfBody`, and of their fastest nodes (nb,), from coefficients (nc,)."""
        coefficients = np.split(v, self._starts)
        motions = [
            body.basis @ of_body for body, of_body in zip(self._bodies, coefficients, strict=True)
        ]
        speeds = [body.speed(motion) for body, motion in zip(self._bodies, motions, strict=True)]
        return np.array(motions), np.array(speeds)

    def start(self, slope: np.ndarray, bound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The motion v (nc,) with which the bodies start, and the pressures (m,) at the cones' nodes.

        min −We·w + g·τ  so that  |w| ≤ 1, v = 0 in bonds, v_ν + 𝓕 τ ≤ 0, |v_t| ≤ τ  (second-order cones). The cones'
        nodes have the `slope` 𝓕 (m,) and the `bound` g (m,) in newtons. Moreau's form has ½ w·w in place of the bound
        on |w|: its v is the same but for its length, as all else is homogeneous. But that length falls with the
        imbalance, until near a limit the solver's tolerances hide it.
        """
        import clarabel

        forces, W, c = self.forces, self._W, self._components
        rubs = np.flatnonzero((slope > 0.0) | (bound > 0.0))
        tangential = forces.friction[(c * rubs[:, None] + np.arange(c)).ravel()]
        g = np.concatenate([bound[rubs], forces.bound]) / self._largest
        (bonds, n), m, k = forces.bonded.shape, len(slope), len(g)
        parts = [forces.bonded, forces.normal, -tangential, -forces.given]
        powers = (sparse.vstack(parts, "csr") @ W.T).tocoo()
        first = bonds + m  # where rows of discs begin
        ball = first + (c + 1) * k  # and those of |w| ≤ 1
        discs, w = np.arange(k), np.arange(n)
        disc, along = np.divmod(powers.row - first, c)
        # rows of bonds, normals, of each disc τ and v_t, and of w; columns of w and τ
        row = np.where(powers.row < first, powers.row, first + (c + 1) * disc + 1 + along)
        rows = np.concatenate([row, bonds + rubs, first + (c + 1) * discs, ball + 1 + w])
        columns = np.concatenate([powers.col, n + discs[: len(rubs)], n + discs, w])
        values = np.concatenate([powers.data, slope[rubs], np.full(k + n, -1.0)])
        A = sparse.csc_matrix((values, (rows, columns)), (ball + 1 + n, n + k))
        linear = sparse.csc_matrix((n + k, n + k))
        right = np.zeros(A.shape[0])
        right[ball] = 1.0
        cones = [
            clarabel.ZeroConeT(bonds),
            clarabel.NonnegativeConeT(m),
            *k * [clarabel.SecondOrderConeT(c + 1)],
            clarabel.SecondOrderConeT(n + 1),
        ]
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.direct_solve_method = (
            False,
            "qdldl",
        )  # serial: the same on every machine
        for settings.tol_gap_abs, settings.tol_gap_rel, settings.tol_feas in TOLERANCES:
            solution = clarabel.DefaultSolver(
                linear,
                np.concatenate([-W @ self._e / self._largest, g]),
                A,
                right,
                cones,
                settings,
            ).solve()
            if solution.status in (
                clarabel.SolverStatus.Solved,
                clarabel.SolverStatus.AlmostSolved,
            ):
                break
        pressure = np.array(solution.z)[bonds : bonds + m]
        return W.T @ np.array(solution.x)[:n], self._largest * np.maximum(pressure, 0.0)

    def proves(self, v: np.ndarray, slope: np.ndarray, pressure: float, imbalance: float) -> bool:
        """Whether a slight imbalance is more than what rounding of v (nc,) lets contacts do, whose pressures have the
        sum `pressure` (N)."""
        forces = self.forces
        slides = np.linalg.norm((forces.friction @ v).reshape(-1, self._components), axis=1)
        into = np.append(forces.normal @ v + slope * slides, np.abs(forces.bonded @ v))
        work = imbalance * (self.velocities(v)[1] * self.loads).max()
        return bool(work > LEAK * into.max(initial=0.0) * (pressure + self.loads.sum()))

    def imbalance(self, v: np.ndarray, slope: np.ndarray) -> float:
        """The proof: the work of the loads on v (nc,) that friction of given bounds does not take, over that of all
        loads on a body. 0.0 where v presses into a contact, so that it proves nothing."""
        forces, speeds = self.forces, self.velocities(v)[1]
        slides, given = (
            np.linalg.norm((tangential @ v).reshape(-1, self._components), axis=1)
            for tangential in (forces.friction, forces.given)
        )
        # what a row presses is compared with the motions that meet there, and what a bond tears with the bodies that it
        # joins, not with the fastest of all bodies: one that carries nothing is by far the fastest in rounding
        least = SLOWEST * speeds.max()
        by_motion = np.repeat(speeds, [body.basis.shape[1] for body in self._bodies])
        presses = forces.normal @ v + slope * slides > IMBALANCE * np.maximum(
            abs(forces.normal) @ np.abs(v) + slope * slides, least
        )
        joined = (forces.bonded != 0.0).multiply(by_motion).tocsr().max(axis=1).toarray().ravel()
        tears = np.abs(forces.bonded @ v) > IMBALANCE * np.maximum(joined, least)
        if presses.any() or tears.any():
            return 0.0
        return float(self._e @ v - forces.bound @ given) / ((speeds * self.loads).max() or 1.0)


class Forces(NamedTuple):
    """The forces of contacts, as rows (·, nc) of their power on the rigid motions.

    A law with a concave bound allows s_ν ≥ 0 and |s_t| ≤ g(0) + 𝓕 s_ν at most, 𝓕 = dg/ds_ν(0). These forces are sums
    of those in a cone, |s_t| ≤ 𝓕 s_ν (Coulomb), and those in a disc, |s_t| ≤ g(0) (Tresca).

    Attributes
    ----------
    bonded : (b, nc) forces of any size
    normal : (m, nc) normal forces of the cones
    slope : (m,) 𝓕 of the cones
    friction : ((d − 1) m, nc) tangential forces of the cones, node by node
    given : ((d − 1) k, nc) tangential forces of the discs, node by node
    bound : (k,) g(0) of the discs (N)
    """

    bonded: sparse.csr_matrix
    normal: sparse.csr_matrix
    slope: np.ndarray
    friction: sparse.csr_matrix
    given: sparse.csr_matrix
    bound: np.ndarray

    @classmethod
    def of(cls, interface: Interface, motions: np.ndarray, powers: np.ndarray, nc: int) -> Forces:
        """Of one contact, from the powers (size, n) of its forces on some `motions` (n,) of all nc, in their order."""
        law, zero, d = interface.law, np.zeros(interface.m), interface.dimension
        n = len(motions)

        def rows(x: np.ndarray) -> sparse.csr_matrix:
            return among_all(x.reshape(-1, n), motions, nc)

        none = rows(powers[:0])
        if law.two_sided:  # forces of any sign: a basis of what they do stands for all
            _, sizes, basis = np.linalg.svd(powers, full_matrices=False)
            return cls(
                rows(basis[sizes > BENT * sizes.max()]), none, zero[:0], none, none, zero[:0]
            )
        tangential, slope, bound = np.zeros((law.m, d - 1, n)), zero.copy(), zero.copy()
        tangential[law.sliding] = powers[law.m :].reshape(-1, d - 1, n)
        slope[law.sliding], bound[law.sliding] = law.slope(zero), law.slip_bound(zero)
        columns = np.concatenate([powers[: law.m, None], tangential], axis=1).reshape(law.m, -1)
        corners = _corners(columns, np.column_stack([interface.frame.reshape(law.m, -1), slope]))
        # Along a straight contact all nodes have the same tangential forces: one disc with the sum of their bounds.
        given, disc = np.unique(
            tangential[bound > 0.0].round(DIGITS + 2), axis=0, return_inverse=True
        )
        return cls(
            none,
            rows(powers[corners]),
            slope[corners],
            rows(tangential[corners]),
            rows(given),
            np.bincount(disc.ravel(), bound[bound > 0.0], len(given)),
        )

    @classmethod
    def together(cls, contacts: Sequence[Forces], n: int) -> Forces:
        """Of all `contacts`, on n rigid motions."""
        rows, numbers = sparse.csr_matrix((0, n)), np.empty(0)
        none = cls(rows, rows, numbers, rows, rows, numbers)
        return cls(
            *(
                np.concatenate(arrays)
                if isinstance(arrays[0], np.ndarray)
                else sparse.vstack(arrays, format="csr")
                for arrays in zip(none, *contacts, strict=True)
            )
        )


def among_all(x: np.ndarray, motions: np.ndarray, nc: int) -> sparse.csr_matrix:
    """Rows (k, n) on some `motions` (n,) as rows (k, nc) on all."""
    ends = len(motions) * np.arange(len(x) + 1)
    return sparse.csr_matrix((x.ravel(), np.tile(motions, len(x)), ends), (len(x), nc))


def _corners(x: np.ndarray, kinds: np.ndarray) -> np.ndarray:
    """The nodes whose rows of x (m, ·) are not means of those of other nodes of the same kind (m, ·).

    What a force does on a rigid motion is linear in its place. So where normals, tangents and 𝓕 are the same, as on
    a flat contact, forces at the corners of the convex hull are as good as forces at all nodes.
    """
    from scipy.spatial import ConvexHull

    corners = [np.empty(0, int)]
    # the centred rows, along their principal axes: in 0, 1 and few dimensions corners are cheap to find
    _, kind = np.unique(np.round(kinds, DIGITS), axis=0, return_inverse=True)
    order = np.argsort(kind.ravel(), kind="stable")
    for nodes in np.split(order, np.cumsum(np.bincount(kind.ravel()))[:-1]):
        away = x[nodes] - x[nodes].mean(axis=0)
        _, sizes, axes = np.linalg.svd(away, full_matrices=False)
        rank = int((sizes > BENT * np.abs(x[nodes]).max(initial=0.0)).sum())
        places = away @ axes[:rank].T
        if rank == 0:
            nodes = nodes[:1]
        elif rank == 1:
            nodes = nodes[[places.argmin(), places.argmax()]]
        elif rank <= HULL and len(nodes) > rank + 1:
            nodes = nodes[ConvexHull(places / np.abs(places).max(axis=0)).vertices]
        corners.append(nodes)
    return np.sort(np.concatenate(corners))
