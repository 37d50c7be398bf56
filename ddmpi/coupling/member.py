"""A body at all its interfaces: compliance, free displacement and rigid motions, as other bodies need them."""

from __future__ import annotations

import copy
import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import partial

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc

from ddmpi.body.compliance import Compliance, plan_compliance
from ddmpi.body.elasticity import Elasticity, LoadCase, apply
from ddmpi.body.rigid_motions import Centring, add_springs, support
from ddmpi.body.solver import StiffnessSolver
from ddmpi.coupling.team import TeamMatrix, TeamSolver
from ddmpi.interface.interface import Interface
from ddmpi.interface.trace import (
    components,
    displacement_trace,
    nodal_forces,
    normal_trace,
    sliding_trace,
    trace,
)
from ddmpi.kept.kept import Kept
from ddmpi.petsc.events import event
from ddmpi.petsc.options import ask, asked_for
from ddmpi.system.numbers import ROUNDING, norm


class Member:
    """One body at its interfaces.

    At its interfaces a body moves by B u = h − C s + Gᵀα with its rigid motions α, none if clamps support it. A loose
    body is in equilibrium if G s = e; its C and h are centred: without rigid motions, in the least-squares sense.

    Parameters
    ----------
    name : of the body
    elasticity : A, b of the body
    interfaces : of the body, in the order of their entries in a vector; may be empty
    compliance, memory : kind of the compliance, and the bytes that it may use, see `Compliance`
    histories : of the scene's loads and clamps, None for constant ones
    points : (k, d) positions of the nodes that A acts on, see `Compliance`
    solves : number of problems, such as load steps, to be solved with C
    candidates : nodes that contacts may join; the rows of B are then the components of all of them

    Attributes
    ----------
    kind, reason : of the `Compliance`, as far as they are known before A is factored
    dear : whether its products are by an iterative solver
    began : by contact, displacements (nv, d) from which slip counts (m), of bodies that move far
    C : contact compliance B A⁻¹ Bᵀ with its counts, from `factor` on; not centred, so multiply by `mult`
    h : (size,) B A⁻¹ b, the contact displacement without contact forces (m), zero until `factor`; of a loose body, with
        forces that balance the load
    size : length of the body's vectors
    parts : by contact, the slice of its entries in a vector, and the side, 0 or 1, of the body
    motions : (nv, d, j) the rigid motions that clamps leave free, see `Elasticity`
    G : (j, size) contact displacements of the rigid motions that clamps leave free
    e : (j,) the load along these motions (N); equal to G s in equilibrium

    Methods that use C are collective on the body's communicator, the others are not.
    """

    _acting: Mapping[str | None, float] | None
    _elasticity: Elasticity

    def __init__(
        self,
        name: str,
        elasticity: Elasticity,
        interfaces: Sequence[Interface],
        compliance: str | None = None,
        memory: float = np.inf,
        histories: Sequence[str | None] = (None,),
        points: np.ndarray | None = None,
        solves: int = 1,
        candidates: np.ndarray | None = None,
    ) -> None:
        self.name, self.elasticity, self._histories = name, elasticity, tuple(histories)
        self._join(interfaces)
        A, b = elasticity.A, elasticity.b
        B = self._rows() if candidates is None else components(elasticity, candidates)
        self.motions = elasticity.motions
        motions = self.motions[elasticity.nodes]
        R = motions.reshape(A.size[1], motions.shape[2])
        self.size = B.shape[0]
        # G = Rᵀ Bᵀ and e = Rᵀ b, with the free rigid motions R as columns in A's dofs.
        self.G, self.e = np.ascontiguousarray((B @ R).T), R.T @ b.array_r
        self._R = R
        self._centring: Centring | None = None
        # where contact forces act faintly on motions, with the centring's K: the motions' contact displacements
        # (q, size), B A⁻¹ K (size, q), and Kᵀ A⁻¹ K (q, q)
        self._even: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self.dear = False
        self._B, self._points, self._asked, self._memory = B, points, compliance, memory
        self._for = bool(A.getAttr("coarse")), solves
        self.kind, self.reason = plan_compliance(A, B, compliance, memory, *self._for)
        self._responses = {
            name: (np.zeros(self.size), R.T @ case.b) for name, case in elasticity.cases.items()
        }

    def _join(self, interfaces: Sequence[Interface]) -> None:
        """Take part in these interfaces."""
        self.interfaces, self.began = tuple(interfaces), dict[str, np.ndarray]()
        ends = np.cumsum([0, *(interface.size for interface in self.interfaces)]).tolist()
        self._sides = [
            (interface, slice(start, stop), interface.side(self.name))
            for interface, (start, stop) in zip(
                self.interfaces, itertools.pairwise(ends), strict=True
            )
        ]
        self.parts = {interface.name: (entries, side) for interface, entries, side in self._sides}

    def _rows(self) -> sparse.csr_matrix:
        """B (size, columns of A) of the interfaces."""
        none = sparse.csr_matrix((0, self.elasticity.A.size[1]))
        return sparse.vstack(
            [
                none,
                *(trace(interface, side, self.elasticity) for interface, _, side in self._sides),
            ],
            format="csr",
        )

    def local(self) -> np.ndarray:
        """(size,) the compliance that the diagonal of A alone gives an unknown (m/N). Not collective."""
        return self._B.multiply(self._B) @ (1.0 / self.elasticity.A.getDiagonal().array_r)

    def factor(self, kept: Kept | None = None) -> Member:
        """Factor A and solve for the loads, unless this is `kept`; return self. Collective on the body's communicator.
        Raises SolverError."""
        kept = kept or Kept()
        if not self.elasticity.supported:
            # A is singular. With springs on a few dofs its inverse is a generalised inverse of A; centring removes what
            # depends on the springs: C ← P C P, h ← P h, P = 1 − Gᵀ(G Gᵀ)⁺G; and what `_even` adds.
            self._centring = Centring(self._R, self._B)
        # not kept for another case if the solver is iterative, as it starts from earlier solutions
        self.C, options = kept.get(
            "compliance",
            self.name,
            self.depends(kept),
            self._compliance,
            lambda value: value[0].solver.direct,
        )
        self.C.renew()
        ask(options)
        self.dear = self.C.kind == "iterative"
        if self._centring and self._centring.faint.any():
            K = self._centring.K
            u = kept.get(
                "faint motions",
                self.name,
                (kept.key("compliance", self.name), K),
                lambda: np.array([self._solved(load) for load in K.T]).T,
            )
            self.C.count["faint motions"] += K.shape[1]
            w = K.T @ u
            self._even = self._centring.faint, self._B @ u, (w + w.T) / 2
        self._responses = {
            name: self.response_to(
                case,
                get=partial(
                    kept.get,
                    f"displacement by {name}",
                    self.name,
                    (kept.key("compliance", self.name), case.b),
                ),
            )
            for name, case in self.elasticity.cases.items()
        }
        self.h = sum((h for h, _ in self._responses.values()), np.zeros(1))
        self._set_up = self.C.count.copy()
        return self

    def depends(self, kept: Kept) -> tuple:
        """What C depends on, see `Kept.get`. Not collective."""
        return kept.key("stiffness", self.name), self._B, self.kind, self.reason

    def _compliance(self) -> tuple[Compliance, set[str]]:
        """The compliance, and the options that PETSc was asked for. Collective on the body's communicator."""
        A, shared = self.elasticity.A, isinstance(self.elasticity.A, TeamMatrix)
        with asked_for() as options:
            if not self.elasticity.supported:
                dofs = support(self.motions[self.elasticity.nodes])
                A = A.with_springs(dofs) if shared else add_springs(A, dofs)
            return Compliance(
                A,
                self._B,
                self.name,
                self._asked,
                self._memory,
                TeamSolver if shared else StiffnessSolver,
                self._points,
                *self._for,
            ), options

    def response_to(
        self,
        case: LoadCase,
        purpose: str = "load",
        get: Callable[[Callable[[], np.ndarray]], np.ndarray] = lambda make: make(),
    ) -> tuple[np.ndarray, np.ndarray]:
        """h (size,) and e (j,) of one load case; `get` computes B A⁻¹ b or has kept it. Collective on the body's
        communicator."""
        h = np.zeros(self.C.size)
        if self.C.size and case.b.any():
            self.C.count[purpose] += 1
            h = get(partial(self._free, case.b))
        # B has no entries at clamped dofs, whose prescribed displacements move the contact by a constant
        return h + (
            self.trace(case.prescribed) if case.prescribed.any() else 0.0
        ), self._R.T @ case.b

    def push(self, case: LoadCase) -> np.ndarray:
        """(j,) a load case along the rigid motions (N). Not collective."""
        return self._R.T @ case.b

    def _free(self, load: np.ndarray) -> np.ndarray:
        """B A⁻¹ b (size,) of a load b (d k,). Collective on the body's communicator."""
        b = self.elasticity.b.duplicate()
        b.array[:] = load
        u = self._solved(self._balanced(b).array_r)
        h = self.C.B @ u
        if self._centring is None:
            return h
        h = self._centring.project(h)
        return h - self._centring.faint.T @ (self._centring.K.T @ u) if self._even else h

    def _solved(self, load: np.ndarray) -> np.ndarray:
        """A⁻¹ b (n,) of a load b (n,), which the caller counts. Collective on the body's communicator."""
        b, u = self.elasticity.b.duplicate(), self.elasticity.b.duplicate()
        b.array[:] = load
        with event("LoadResponse"):
            self.C.solver.solve(b, u)
        return u.array_r.copy()

    def response(self, history: str | None) -> tuple[np.ndarray, np.ndarray]:
        """h (size,) and e (j,) of the loads and clamps with this history, at its factor 1; zero if there are none."""
        return self._responses.get(history) or (np.zeros(self.size), np.zeros(len(self.e)))

    @property
    def elasticity(self) -> Elasticity:
        """A and the present b. Not collective."""
        if self._acting is not None:
            self._elasticity, self._acting = self._elasticity.under(self._acting), None
        return self._elasticity

    @elasticity.setter
    def elasticity(self, elasticity: Elasticity) -> None:
        self._elasticity, self._acting = elasticity, None

    @property
    def load(self) -> float:
        """Sum of the absolute nodal loads (N), as of an `Elasticity`."""
        return self._elasticity.load

    def act(self, factors: Mapping[str | None, float]) -> None:
        """Set loads and prescribed displacements to these `factors` by history. Not collective."""
        self._acting = factors  # `elasticity` sums the loads on all nodes when it is asked for
        self._factors = np.array([factors[name] for name in self._histories])
        self.h, self.e = (
            sum(
                (factors[name] * response[k] for name, response in self._responses.items()),
                np.zeros(1),
            )
            for k in (0, 1)
        )

    @property
    def stiffness(self) -> float:
        """The largest E* of its interfaces (N/m²), in space and around an axis times their extent (N/m); without
        interfaces, the largest of A."""
        if any(interface.m for interface in self.interfaces):
            return max(
                interface.modulus * interface.area.sum() / interface.length
                for interface in self.interfaces
                if interface.m
            )
        return float(self.elasticity.A.getDiagonal().array_r.max(initial=0.0))

    def at_cross_points(self) -> tuple[sparse.csr_matrix, np.ndarray]:
        """B times the root of the compliance of nodes at which the body has several contacts (size, k), sparse; and the
        compliance (size,) in m/N that the other nodes of these rows add. Not collective.

        A node's compliance is the mean of those of its rows; each body of a contact has half of a row's compliance.
        """
        B, several = self.C.B.tocoo(), self._several()
        # 1/c is the compliance of both bodies together at a row: each has half of it, on a rigid partner the body has
        # all. A row distributes it by the squares of B over its nodes, with one or with several contacts.
        compliance = np.concatenate(
            [
                np.empty(0),
                *(
                    1.0 / ((2.0 - interface.on_rigid) * interface.stiffness)
                    for interface in self.interfaces
                ),
            ]
        )
        number = np.bincount(B.col, minlength=B.shape[1])
        node = np.bincount(B.col, compliance[B.row], B.shape[1]) / np.maximum(number, 1)
        squares = np.bincount(B.row, B.data**2 * node[B.col], self.size)
        shared = np.bincount(B.row, B.data**2 * (several * node)[B.col], self.size)
        columns = self.C.B @ sparse.diags(np.sqrt(several * node))
        return columns[:, several], (shared > 0.0) * compliance * (
            1.0 - shared / np.where(squares > 0.0, squares, 1.0)
        )

    def shared(self) -> np.ndarray:
        """(size,) bool, the rows of nodes at which the body has several contacts. Not collective."""
        B = self.C.B.tocoo()
        return np.bincount(B.row, self._several()[B.col], self.size) > 0.0

    def _several(self) -> np.ndarray:
        """(columns of B,) bool, the dofs of nodes at which the body has several contacts."""
        B, d = self.C.B.tocoo(), self.motions.shape[1]
        contact = np.repeat(
            np.arange(len(self.parts)), [interface.size for interface in self.interfaces]
        )
        meets, acts = np.zeros((len(self.parts), B.shape[1] // d), bool), B.data != 0.0
        meets[contact[B.row[acts]], B.col[acts] // d] = True
        return np.repeat(meets.sum(axis=0) > 1, d)

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x (metres from newtons), centred; both (size,), `relative` as for `Compliance.mult`. Collective."""
        if self._centring is None:
            self.C.mult(x, y, purpose, relative)
        else:
            # P C P is symmetric, and does not depend on the springs
            centred = self._centring.project(x)
            self.C.mult(centred, y, purpose, relative)
            y[:] = self._centring.project(y)
            if self._even:
                # B Π A⁻¹ Πᵀ Bᵀ with Πᵀ Bᵀ x = Bᵀ P x − K F x and W = B A⁻¹ K: of the faint motions F
                F, W, w = self._even
                along = F @ x
                y += F.T @ (w @ along - W.T @ centred) - self._centring.project(W @ along)

    @property
    def known(self) -> bool:
        """Whether `dense` takes no solve."""
        return self.C.kind == "explicit" or not self.C.B.count_nonzero()

    def dense(self) -> np.ndarray:
        """C (size, size) as a matrix, centred (m/N)."""
        C = self.C.dense()
        if self._centring is None:
            return C
        C = self._centring.project(self._centring.project(C).T)
        if self._even:  # as in `mult`
            F, W, w = self._even
            both = self._centring.project(W) @ F
            C = C - both - both.T + F.T @ w @ F
        return C

    def restart(self) -> None:
        """Count multiplications from the set-up on, for another iteration on the same factors."""
        self.C.count = self._set_up.copy()

    def loaded_by(self, case: LoadCase) -> Member:
        """The same body under another load case alone, on the same factors. Not collective."""
        other, b = copy.copy(self), self.elasticity.b.duplicate()
        b.array[:] = case.b
        other.elasticity = replace(self.elasticity, b=b, acting=case)
        return other

    def need_norm(self) -> None:
        """Estimate ‖C‖ now, as a part of the set-up. Collective on the body's communicator."""
        self.C.norm()
        self._set_up["norm"] = self.C.count["norm"]

    def trace(self, u: np.ndarray) -> np.ndarray:
        """B u (size,) in metres, of a displacement (nv, d) of all nodes. Not collective."""
        return np.concatenate(
            [np.empty(0), *(displacement_trace(met, side, u) for met, _, side in self._sides)]
        )

    def pull(self, s: np.ndarray) -> np.ndarray:
        """−Bᵀ s (nv, d): what contact forces s (size,) do to all nodes of the body (N). Not collective."""
        return sum(
            (
                nodal_forces(interface, side, s[entries], len(self.motions))
                for interface, entries, side in self._sides
            ),
            np.zeros(self.motions.shape[:2]),
        )

    def beside(self, u: np.ndarray) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
        """Displacements (m) that belong to no unknown, by contact and side: normal ones at the interfaces' probes, and
        tangential ones of nodes without friction. Not collective."""
        return {
            (interface.name, side): (
                normal_trace(side, interface.probes, u),
                sliding_trace(interface, side, u - self.began.get(interface.name, 0.0)),
            )
            for interface, _, side in self._sides
        }

    def begin(self, began: Mapping[str, np.ndarray]) -> np.ndarray:
        """Displacement (size,) from which slip counts (m), by `began`: those (nv, d) of all nodes, by contact."""
        self.began = dict(began)
        return np.concatenate(
            [
                np.empty(0),
                *(
                    displacement_trace(met, side, self.began[met.name])
                    for met, _, side in self._sides
                ),
            ]
        )

    def work(self, u: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Work of loads, reactions and heat along displacements: (2, k) in J, by history in the order of the scene.

        The first row is f·u for the loads f of a history, at its factor 1, and the displacement u (nv, d) under the
        present loads and contact forces s (size,); the second R·p − ∫ σ : ε for the reactions R of clamps, with the
        displacements p and thermal strains ε of the history. Not collective.
        """
        joules, acting = np.zeros((2, len(self._histories))), self.elasticity.acting
        for k, name in enumerate(self._histories):
            case = self.elasticity.cases.get(name)
            if case:
                joules[0, k] = (case.f * u).sum()
                # R = K u − f − heat + Bᵀs at clamped dofs, times p, with K p = `taken`. Then ∫ σ : ε with σ = C (ε(u) −
                # ε_heat) is heat·u less the product of the stored roots, exact for one temperature field.
                joules[1, k] = (
                    (u * case.taken).sum()
                    - ((acting.f + acting.heat) * case.prescribed).sum()
                    + s @ self.trace(case.prescribed)
                    - (case.heat * u).sum()
                    + case.stored * acting.stored
                )
        return joules

    def prepare_energies(self) -> None:
        """Compute what `at_contacts` needs of each load case: its displacement without contact forces, and the contact
        displacement of its loads without clamps and heat. Collective on the body's communicator. Raises SolverError.
        """
        now, none = self.elasticity, np.zeros(self.size)
        self._joules = np.zeros((2, len(self._histories), len(self._histories)))
        self._pushed, self._along = np.zeros((2, len(self._histories), self.size))
        for k, (name, case) in enumerate((name, now.cases.get(name)) for name in self._histories):
            if case:
                self.elasticity = now.under({other: float(other == name) for other in now.cases})
                self._joules[:, :, k] = self.work(self.displacement(none)[0], none)
                self._along[k] = self._pushed[k] = self.response(name)[0]
                if case.taken.any() or case.heat.any():
                    loads = apply(
                        self.elasticity.supports.free[now.nodes], case.f[now.nodes]
                    ).ravel()
                    self._pushed[k] = self.response_to(
                        replace(case, b=loads, prescribed=0.0 * case.prescribed)
                    )[0]
        self.elasticity = now

    def at_contacts(
        self, s: np.ndarray, alpha: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, float, np.ndarray]:
        """What `displacement`, `trace` and `work` give under contact forces s (size,) in newtons and motions α (j,) in
        metres, by one product with C. Collective on the body's communicator. Raises SolverError.

        Returns
        -------
        u : (size,) contact displacement B u (m)
        yielded : (size,) C s, the contact displacement by contact forces (m)
        energy : strain energy (J)
        work : (2, k), as `work` (J)
        """
        yielded = np.empty(self.size)
        self.mult(s, yielded, "certificate")
        # A displacement is linear in the factors φ and in s: u = Σ φ_j u_j − A⁻¹Bᵀ s + R α. By Betti f·A⁻¹Bᵀ s is
        # (B A⁻¹ f)·s, so that work needs no displacement of the body.
        work = self._joules @ self._factors
        work[0] -= self._pushed @ s
        work[1] += (self._along - self._pushed) @ s
        # Clapeyron: twice the energy is the work of loads, clamps, heat and contact forces; rigid motions do none in it
        energy = 0.5 * float(self._factors @ work.sum(axis=0) - s @ (self.h - yielded))
        work[0] += np.array([self.response(name)[1] @ alpha for name in self._histories])
        return self.h + self.G.T @ alpha - yielded, yielded, energy, work

    def displacement(
        self,
        s: np.ndarray,
        alpha: np.ndarray | None = None,
        purpose: str = "displacement",
        left: np.ndarray | None = None,
    ) -> tuple[np.ndarray, float, float, float]:
        """Displacement under the load and the contact forces s (size,) in newtons.

        A loose body also moves by the rigid motions α (j,) in metres; without them its displacement is centred, as in
        `h` and `mult`. `left` (j,) are the loads along its motions that are left without balance (N), where some motions
        are held; then what these bear does not count. Collective on the body's communicator. Raises SolverError.

        Returns
        -------
        u : (nv, d) (m)
        left : ‖A u + Bᵀ s − b‖ (N), large where contact forces do not balance the load of a loose body
        acting : max(‖b‖, ‖Bᵀ s‖), to compare `left` with
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
                self.C.solve(load, u, purpose, ROUNDING)  # the certificate checks this solve
            if self._centring:
                u.array[:] = self._centring.centre(u.array_r)
            Au = u.duplicate()
            # A is the stiffness without springs, so the residual has the loads that contact forces do not balance
            A.mult(u, Au)
            energy = 0.5 * u.dot(Au)
            Au.axpy(-1.0, f if left is None else load)
            unbalanced = Au.norm() if left is None else math.hypot(Au.norm(), norm(left))
            full = self.elasticity.expand(u)
            acting = self.elasticity.acting
            # ½ (u_f + p)ᵀ K (u_f + p) = ½ u_fᵀ A u_f + K p · (u − ½ p) for u = u_f + p with the prescribed p.
            energy += float((acting.taken * (full - 0.5 * acting.prescribed)).sum())
            # ½ ∫ (ε − ε_heat) : C : (ε − ε_heat): the square of the heat's own root less the work of its nodal loads.
            energy += 0.5 * acting.stored**2 - float((acting.heat * full).sum())
            return (
                (full if alpha is None else full + self.motions @ alpha),
                unbalanced,
                size,
                energy,
            )

    def _balanced(self, f: PETSc.Vec) -> PETSc.Vec:
        """The load f; of a loose body, f plus contact forces that balance it."""
        if self._centring is None:
            return f
        balanced = f.duplicate()
        balanced.array[:] = self._centring.balance(f.array_r)
        return balanced
