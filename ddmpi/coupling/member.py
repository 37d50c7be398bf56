"""A body at all its interfaces: what the others see of it."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc

from ddmpi.body.compliance import Compliance, plan_compliance
from ddmpi.body.elasticity import Elasticity, LoadCase
from ddmpi.body.rigid_motions import Centring, add_springs, support
from ddmpi.body.solver import StiffnessSolver
from ddmpi.coupling.team import TeamMatrix, TeamSolver
from ddmpi.interface.interface import Interface
from ddmpi.interface.trace import displacement_trace, nodal_forces, normal_trace, sliding_trace, trace
from ddmpi.petsc.events import event

PRECISE = 1e-12
"""Relative residual of the last solve, which the certificate looks at, where the solver is iterative."""


class Member:
    """One body at its interfaces.

    A body moves by B u = h − C s + Gᵀα at its interfaces, where α are its rigid motions (none if clamps hold it).
    A loose body is in equilibrium if G s = e, and its C and h are centred: free of rigid motions in the least-squares
    sense.

    Parameters
    ----------
    name : of the body
    elasticity : A, b of the body
    interfaces : at which it takes part, in the order of a vector's parts; may be none
    compliance, memory : kind of the compliance, and the bytes that it may use, see `Compliance`
    histories : that loads and clamps of the scene follow, None for those that follow none
    points : (k, d) positions of the nodes that A acts on, see `Compliance`
    factor : without it the body is only looked at: there is no C, and h is zero

    Attributes
    ----------
    kind, reason : of a body that is only looked at, those that its `Compliance` would have
    dear : whether its products are by an iterative solver
    C : contact compliance B A⁻¹ Bᵀ with its counts; of a loose body before centring, so multiply by `mult`
    h : (size,) B A⁻¹ b, the contact displacement without contact forces (m); of a loose body, with those that
        balance the load
    size : length of the body's vectors
    parts : of its vector by contact, and its side there, 0 or 1
    motions : (nv, d, j) the rigid motions that clamps leave free, see `Elasticity`
    G : (j, size) contact displacements of the rigid motions that clamps leave free
    e : (j,) what the load does along these motions (N); G s does the same if the body is in equilibrium

    Construction factors A, unless told not to, and is collective on the body's communicator. Raises SolverError.
    """

    def __init__(self, name: str, elasticity: Elasticity, interfaces: Sequence[Interface],
                 compliance: str | None = None, memory: float = np.inf,
                 histories: Sequence[str | None] = (None,), points: np.ndarray | None = None,
                 factor: bool = True) -> None:
        self.name, self.elasticity, self.interfaces = name, elasticity, tuple(interfaces)
        self._histories = tuple(histories)
        ends = np.cumsum([0, *(each.size for each in self.interfaces)]).tolist()
        self._sides = [(each, slice(start, stop), each.side(name)) for each, (start, stop) in
                       zip(self.interfaces, itertools.pairwise(ends), strict=True)]
        self.parts = {each.name: (part, side) for each, part, side in self._sides}
        A, b = elasticity.A, elasticity.b
        B = sparse.vstack([sparse.csr_matrix((0, A.size[1])),
                           *(trace(each, side, elasticity) for each, _, side in self._sides)], format="csr")
        self.motions = elasticity.motions
        motions = self.motions[elasticity.nodes]
        R = motions.reshape(A.size[1], motions.shape[2])
        self.size = B.shape[0]
        self.G, self.e = np.ascontiguousarray((B @ R).T), R.T @ b.array_r
        self._R = R
        self._centring: Centring | None = None
        self.dear = False
        if not factor:
            self.kind, self.reason = plan_compliance(A.size[0], B, compliance, memory, A.getBlockSize())
            self._responses = {name: (np.zeros(self.size), R.T @ case.b) for name, case in elasticity.cases.items()}
            return
        shared = isinstance(A, TeamMatrix)
        if not elasticity.held:
            self._centring, dofs = Centring(R, B), support(motions)
            A = A.with_springs(dofs) if shared else add_springs(A, dofs)
        self.C = Compliance(A, B, name, compliance, memory, TeamSolver if shared else StiffnessSolver, points)
        self.dear = self.C.kind == "iterative"
        self._responses = {name: self._response(case) for name, case in elasticity.cases.items()}
        self.h = sum((h for h, _ in self._responses.values()), np.zeros(1))
        self._set_up = self.C.count.copy()

    def _response(self, case: LoadCase) -> tuple[np.ndarray, np.ndarray]:
        """h (size,) and e (j,) of one load case. Collective on the body's communicator."""
        b, u, h = self.elasticity.b.duplicate(), self.elasticity.b.duplicate(), np.zeros(self.C.size)
        b.array[:] = case.b
        if self.C.size and b.norm() > 0.0:
            with event("LoadResponse"):
                self.C.solve(self._balanced(b), u, "load")
            h = self.C.B @ u.array_r
            if self._centring:
                h = self._centring.project(h)
        return h + self.trace(case.prescribed), self._R.T @ case.b

    def response(self, history: str | None) -> tuple[np.ndarray, np.ndarray]:
        """h (size,) and e (j,) of what follows `history`, at its factor 1; zero where nothing does."""
        return self._responses.get(history) or (np.zeros(self.size), np.zeros(len(self.e)))

    def act(self, factors: Mapping[str | None, float]) -> None:
        """Let the loads and prescribed displacements act that have these `factors` by history. Not collective."""
        self.elasticity = self.elasticity.under(factors)
        self.h, self.e = (sum((factors[name] * response[k] for name, response in self._responses.items()), np.zeros(1))
                          for k in (0, 1))

    @property
    def stiffness(self) -> float:
        """The largest E* of its interfaces (N/m²), in space and around an axis times their extent (N/m); without
        interfaces, the largest of A."""
        if self.interfaces:
            return max(each.modulus * each.area.sum() / each.length for each in self.interfaces)
        return float(self.elasticity.A.getDiagonal().array_r.max(initial=0.0))

    def at_cross_points(self) -> tuple[sparse.csr_matrix, np.ndarray]:
        """B of the nodes at which the body has several contacts, times the roots of their compliance (size, k), sparse;
        and the compliance (size,) in m/N by which rows there follow other nodes. Not collective.

        A node's compliance is the mean of its rows', which bodies that meet share alike.
        """
        B, several = self.C.B.tocoo(), self._several()
        own = np.concatenate([np.empty(0), *(1.0 / ((2.0 - each.on_rigid) * each.stiffness)
                                             for each in self.interfaces)])
        number = np.bincount(B.col, minlength=B.shape[1])
        node = np.bincount(B.col, own[B.row], B.shape[1]) / np.maximum(number, 1)
        squares = np.bincount(B.row, B.data**2 * node[B.col], self.size)
        there = np.bincount(B.row, B.data**2 * (several * node)[B.col], self.size)
        found = self.C.B @ sparse.diags(np.sqrt(several * node))
        return found[:, several], (there > 0.0) * own * (1.0 - there / np.where(squares > 0.0, squares, 1.0))

    def shared(self) -> np.ndarray:
        """(size,) bool, the rows of nodes at which the body has several contacts. Not collective."""
        B = self.C.B.tocoo()
        return np.bincount(B.row, self._several()[B.col], self.size) > 0.0

    def _several(self) -> np.ndarray:
        """(columns of B,) bool, the dofs of nodes at which the body has several contacts."""
        B, d = self.C.B.tocoo(), self.motions.shape[1]
        contact = np.repeat(np.arange(len(self.parts)), [each.size for each in self.interfaces])
        meets, acts = np.zeros((len(self.parts), B.shape[1] // d), bool), B.data != 0.0
        meets[contact[B.row[acts]], B.col[acts] // d] = True
        return np.repeat(meets.sum(axis=0) > 1, d)

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x (metres from newtons), centred; both (size,), `relative` as for `Compliance.mult`. Collective."""
        if self._centring is None:
            self.C.mult(x, y, purpose, relative)
        else:
            self.C.mult(self._centring.project(x), y, purpose, relative)
            y[:] = self._centring.project(y)

    def restart(self) -> None:
        """Count multiplications from the set-up on, for another iteration on the same factors."""
        self.C.count = self._set_up.copy()

    def need_norm(self) -> None:
        """Estimate ‖C‖ now, as a part of the set-up. Collective on the body's communicator."""
        self.C.norm()
        self._set_up["norm"] = self.C.count["norm"]

    def trace(self, u: np.ndarray) -> np.ndarray:
        """B u (size,) in metres, of a displacement (nv, d) of all nodes. Not collective."""
        return np.concatenate([np.empty(0), *(displacement_trace(each, side, u) for each, _, side in self._sides)])

    def pull(self, s: np.ndarray) -> np.ndarray:
        """−Bᵀ s (nv, d): what contact forces s (size,) do to all nodes of the body (N). Not collective."""
        return sum((nodal_forces(each, side, s[part], len(self.motions)) for each, part, side in self._sides),
                   np.zeros(self.motions.shape[:2]))

    def beside(self, u: np.ndarray) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
        """What its interfaces have no unknowns for, by contact and side: normal displacements at their probes, and
        tangential ones of nodes without friction (m). Not collective."""
        return {(each.name, side): (normal_trace(side, each.probes, u), sliding_trace(each, side, u))
                for each, _, side in self._sides}

    def work(self, u: np.ndarray, s: np.ndarray) -> np.ndarray:
        """What loads, reactions and heat do along displacements: (2, k) in J, by history in the order of the scene.

        The first is f·u for the loads f that follow it, at its factor 1, and the displacement u (nv, d) under the
        present loads and contact forces s (size,); the second R·p − ∫ σ : ε for the reactions R of clamps, the
        displacements p and the thermal strains ε that follow it. Not collective.
        """
        found, acting = np.zeros((2, len(self._histories))), self.elasticity.acting
        for k, name in enumerate(self._histories):
            case = self.elasticity.cases.get(name)
            if case:
                found[0, k] = (case.f * u).sum()
                found[1, k] = ((u * case.taken).sum() - ((acting.f + acting.heat) * case.prescribed).sum()
                               + s @ self.trace(case.prescribed)
                               - (case.heat * u).sum() + case.stored * acting.stored)
        return found

    def displacement(self, s: np.ndarray, alpha: np.ndarray | None = None) -> tuple[np.ndarray, float, float, float]:
        """Displacement under the load and the contact forces s (size,) in newtons.

        A loose body moves along with the rigid motions α (j,) in metres; without them it moves as `h` and `mult` have
        it. Collective on the body's communicator. Raises SolverError.

        Returns
        -------
        u : (nv, d) (m)
        left : ‖A u + Bᵀ s − b‖ (N), large where contact forces do not balance the load of a loose body
        acting : max(‖b‖, ‖Bᵀ s‖), which it is to be compared with
        energy : strain energy (J): ½ uᵀ K u with the stiffness K of all dofs, without what heat strains freely
        """
        with event("Displacement"):
            A, b = self.elasticity.A, self.elasticity.b
            u, f = A.createVecs()
            self.C.spread(s, f)
            size = max(f.norm(), b.norm())
            f.aypx(-1.0, b)
            load = self._balanced(f)
            if load.norm() > 0.0:
                self.C.solve(load, u, "displacement", PRECISE)
            if self._centring:
                u.array[:] = self._centring.centre(u.array_r)
            Au = u.duplicate()
            A.mult(u, Au)
            energy = 0.5 * u.dot(Au)
            Au.axpy(-1.0, f)
            full = self.elasticity.expand(u)
            acting = self.elasticity.acting
            energy += float((acting.taken * (full - 0.5 * acting.prescribed)).sum())
            energy += 0.5 * acting.stored**2 - float((acting.heat * full).sum())
            return (full if alpha is None else full + self.motions @ alpha), Au.norm(), size, energy

    def _balanced(self, f: PETSc.Vec) -> PETSc.Vec:
        """The load f, of a loose body with contact forces that balance it."""
        if self._centring is None:
            return f
        balanced = f.duplicate()
        balanced.array[:] = self._centring.balance(f.array_r)
        return balanced
