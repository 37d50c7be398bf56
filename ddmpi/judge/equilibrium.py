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

import numpy as np
import scipy.sparse as sparse

from ddmpi.judge.forces import Forces
from ddmpi.judge.motions import MotionsOfBody, describe_motions
from ddmpi.system.numbers import ALIKE

IMBALANCE = 1e-6
"""There is no equilibrium if this fraction of the loads on a body stays without balance. By this fraction of its
velocity a mechanism may press into a contact, the solver's tolerance."""

LIGHTEST = 1e-3, 1e-6
"""Loads and mass of a body count as at least these fractions of the largest loads and of the largest mass."""

ROUNDS, SETTLED = 20, 1e-5
"""Most rounds in which friction bounds follow the pressures; they end when v changes by less than SETTLED."""

TOLERANCES = (1e-16, 1e-12, 1e-12), (1e-13, 1e-9, 1e-9)
"""Tolerances of clarabel for gap, relative gap and feasibility: first strict ones, near a limit looser ones."""


@dataclass(frozen=True)
class Mechanism:
    """How loose bodies move if no contact forces balance their loads.

    Attributes
    ----------
    bodies : the loose ones
    velocities : (nb, n) of each, as of `MotionsOfBody`; the fastest node has velocity 1
    imbalance : least loads that no forces balance, as a fraction of the loads on a body
    """

    bodies: tuple[MotionsOfBody, ...]
    velocities: np.ndarray
    imbalance: float


def describe(mechanism: Mechanism) -> str:
    """The mechanism in words that begin with "no equilibrium". Not collective."""
    motions = describe_motions(mechanism.bodies, mechanism.velocities)
    return f"no equilibrium: {motions}{' (or should its `along` be turned round?)' * ('pretension of' in motions)}"


def find_mechanism(contacts: Sequence[Forces], e: np.ndarray, bodies: Sequence[MotionsOfBody],
                   load: np.ndarray | float = 0.0) -> Mechanism | None:
    """How loose bodies move if no contact forces can balance their loads, else None. Not collective.

    None does not prove that there is an equilibrium: with Coulomb friction forces that balance the loads may be out of
    reach of elastic bodies.

    Parameters
    ----------
    e : (nc,) power of the loads on the rigid motions, body by body (N, for motions in metres)
    load : (nb,) sum of the sizes of all nodal loads on each body (N), with which rounding is compared: e does not see
        loads that cancel
    """
    free = _Free(Forces.together(contacts, len(e)), e, bodies, load)
    if free.idle:
        return None
    slope = free.forces.slope
    none = np.zeros_like(slope)
    v, pressure = free.start(slope, none)
    imbalance = free.imbalance(v, slope)
    if not imbalance > IMBALANCE:
        return None
    for _ in range(ROUNDS * bool(slope.any())):
        before, (v, pressure) = v, free.start(none, slope * pressure)
        if not free.imbalance(v, none) > 0.0:  # friction of these bounds balances the loads, or v was not found
            v = before
            break
        if np.abs(v - before).max() <= SETTLED * np.abs(v).max():
            break
    velocities, speeds = free.velocities(v)
    return Mechanism(tuple(bodies), velocities / speeds.max(), imbalance)


class _Free:
    """Rigid bodies, each with a mass in proportion to its loads, that are let go under the loads e (nc,).

    Attributes
    ----------
    forces : that contacts allow
    idle : whether the loads are nothing but rounding
    """

    def __init__(self, forces: Forces, e: np.ndarray, bodies: Sequence[MotionsOfBody],
                 load: np.ndarray | float) -> None:
        self.forces, self._e, self._bodies = forces, e, bodies
        self._starts = np.cumsum([body.basis.shape[1] for body in bodies])[:-1]
        self._components = bodies[0].dimension - 1
        # v = Wᵀ w with M⁻¹ = Wᵀ W: in w neither the basis of the motions nor units matter, and v·Mv is w·w.
        roots = [np.linalg.inv(np.linalg.cholesky(body.inertia)) for body in bodies]
        net = np.array([np.linalg.norm(root @ of_body) for root, of_body in
                        zip(roots, np.split(e, self._starts), strict=True)])
        loads = np.maximum(net, load)
        self._largest = float(loads.max())
        self._loads = np.maximum(loads, LIGHTEST[0] * self._largest)
        self.idle = bool((net <= ALIKE * self._loads).all())
        masses = np.maximum(loads / (self._largest or 1.0), LIGHTEST[1])
        self._W = sparse.block_diag([root / np.sqrt(mass) for root, mass in zip(roots, masses, strict=True)], "csr")

    def velocities(self, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Of the bodies (nb, n), as of `MotionsOfBody`, and of their fastest nodes (nb,), from coefficients (nc,)."""
        coefficients = np.split(v, self._starts)
        motions = [body.basis @ of_body for body, of_body in zip(self._bodies, coefficients, strict=True)]
        speeds = [body.speed(motion) for body, motion in zip(self._bodies, motions, strict=True)]
        return np.array(motions), np.array(speeds)

    def start(self, slope: np.ndarray, bound: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """The motion v (nc,) with which the bodies start, and the pressures (m,) at the cones' nodes.

        min ½ w·w − We·w + g·τ  so that  v = 0 in bonds, v_ν + 𝓕 τ ≤ 0, |v_t| ≤ τ  (second-order cones). The cones'
        nodes have the `slope` 𝓕 (m,) and the `bound` g (m,) in newtons.
        """
        import clarabel

        forces, W, c = self.forces, self._W, self._components
        rubs = np.flatnonzero((slope > 0.0) | (bound > 0.0))
        tangential = sparse.vstack([forces.friction[(c * rubs[:, None] + np.arange(c)).ravel()], forces.given])
        g = np.concatenate([bound[rubs], forces.bound]) / self._largest
        (bonds, n), m, k = forces.bonded.shape, len(slope), len(g)
        lift = sparse.csr_matrix((slope[rubs], (rubs, np.arange(len(rubs)))), (m, k))
        rows = sparse.bmat([[forces.bonded @ W.T, None], [forces.normal @ W.T, lift],  # and of each disc τ and v_t:
                            [-sparse.kron(sparse.identity(k), np.eye(c + 1, c, -1)) @ tangential @ W.T,
                             -sparse.kron(sparse.identity(k), np.eye(c + 1, 1))]], format="csc")
        square = sparse.block_diag([sparse.identity(n), sparse.csc_matrix((k, k))], format="csc")
        cones = [clarabel.ZeroConeT(bonds), clarabel.NonnegativeConeT(m), *k * [clarabel.SecondOrderConeT(c + 1)]]
        settings = clarabel.DefaultSettings()
        settings.verbose, settings.direct_solve_method = False, "qdldl"  # serial: the same on every machine
        for settings.tol_gap_abs, settings.tol_gap_rel, settings.tol_feas in TOLERANCES:
            solution = clarabel.DefaultSolver(square, np.concatenate([-W @ self._e / self._largest, g]), rows,
                                              np.zeros(rows.shape[0]), cones, settings).solve()
            if solution.status in (clarabel.SolverStatus.Solved, clarabel.SolverStatus.AlmostSolved):
                break
        pressure = np.array(solution.z)[bonds:bonds + m]
        return W.T @ np.array(solution.x)[:n], self._largest * np.maximum(pressure, 0.0)

    def imbalance(self, v: np.ndarray, slope: np.ndarray) -> float:
        """The proof: the work of the loads on v (nc,) that friction of given bounds does not take, over that of all
        loads on a body. 0.0 where v presses into a contact, so that it proves nothing."""
        forces, speeds = self.forces, self.velocities(v)[1]
        slides, given = (np.linalg.norm((tangential @ v).reshape(-1, self._components), axis=1)
                         for tangential in (forces.friction, forces.given))
        presses = max((forces.normal @ v + slope * slides).max(initial=0.0), np.abs(forces.bonded @ v).max(initial=0.0))
        if not presses <= IMBALANCE * speeds.max():
            return 0.0
        return float(self._e @ v - forces.bound @ given) / ((speeds * self._loads).max() or 1.0)
