"""A body at all its interfaces: compliance, free displacement and rigid motions, as other bodies need them."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.compliance import Compliance
from ddmpi.body.elasticity import Elasticity, LoadCase, apply
from ddmpi.coupling.factored import Factored
from ddmpi.coupling.sides import Sides
from ddmpi.interface.interface import Interface
from ddmpi.interface.trace import nodal_forces, seen
from ddmpi.petsc.events import event
from ddmpi.system.numbers import ROUNDING, Frame, concatenated, divisor, norm

RANK = 1e-9
"""Singular values below this fraction of the largest are rounding: of ties that say one thing twice."""

MOST = 3000
"""Forces of more ties are not shared evenly: the dense algebra of so many takes half a minute."""


class Member(Sides):
    """One body at its interfaces.

    At its interfaces a body moves by B u = h − C s + Gᵀα with its rigid motions α, none if clamps support it. A loose
    body is in equilibrium if G s = e.

    Parameters
    ----------
    body : whose candidates these interfaces join
    interfaces : of the body; may be empty
    frame : in which it moves far; without one it is met as drawn, and its candidates are the rows of its interfaces

    Attributes
    ----------
    C : contact compliance with its counts, once the body is factored; multiply by `mult`
    h : (size,) B A⁻¹ b, the contact displacement without contact forces (m), as of `Factored`, and that of clamps
    motions, G, e, dear, resisting : as of `Factored`, under the present loads

    Methods that use C are collective on the body's communicator, the others are not.
    """

    C: Compliance
    _acting: Mapping[str | None, float] | None
    _elasticity: Elasticity

    def __init__(
        self, body: Factored, interfaces: Sequence[Interface], frame: Frame | None = None
    ) -> None:
        met = [seen(interface, frame) for interface in interfaces] if frame else interfaces
        super().__init__(body.name, met)
        at = body.placed(self, frame)
        self.body, self.name, self.dear = body, body.name, body.dear
        self.elasticity, self.motions, self.G = at.elasticity, at.motions, at.G
        self.resisting = at.resisting
        # B has no entries at clamped dofs, whose prescribed displacements move the contact by a constant
        self._responses = {
            history: (h + self.trace(self.elasticity.cases[history].prescribed), e)
            for history, (h, e) in at.responses.items()
        }
        self._respond(dict.fromkeys(self._responses, 1.0))
        if C := getattr(at, "C", None):
            self.C, self._set_up = C, C.count.copy()
            self._operator = C if frame else body

    def local(self) -> np.ndarray:
        """(size,) the compliance that the diagonal of A alone gives an unknown (m/N). Not collective."""
        return self.C.B.multiply(self.C.B) @ (1.0 / self.elasticity.A.getDiagonal().array_r)

    def response_to(self, case: LoadCase, purpose: str) -> tuple[np.ndarray, np.ndarray]:
        """h (size,) and e (j,) of one load case. Collective on the body's communicator."""
        h = self.body.response_to(case.b, purpose)
        return h + self.trace(case.prescribed), self.body.push(case)

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

    def load_of(self, history: str | None) -> float:
        """Sum of the absolute nodal loads (N) with this history, at its factor 1. Not collective."""
        case = self._elasticity.cases.get(history)
        return case.size if case else 0.0

    def act(self, factors: Mapping[str | None, float]) -> None:
        """Set loads and prescribed displacements to these `factors` by history. Not collective."""
        self._acting = factors  # `elasticity` sums the loads on all nodes when it is asked for
        self._factors = np.array([factors[name] for name in self.body.histories])
        self._respond(factors)

    def _respond(self, factors: Mapping[str | None, float]) -> None:
        """Set h and e."""
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

        A node's compliance is the mean of those of its rows; each body of a contact has half of a row's compliance, and
        all where it is alone.
        """
        B, several = self.C.B.tocoo(), self._several()
        # 1/c is the compliance of both bodies together at a row: each has half of it, a body alone has all. A row
        # distributes it by the squares of B over its nodes, with one or with several contacts.
        compliance = concatenated(
            1.0 / ((2.0 - interface.alone) * interface.stiffness) for interface in self.interfaces
        )
        number = np.bincount(B.col, minlength=B.shape[1])
        node = np.bincount(B.col, compliance[B.row], B.shape[1]) / np.maximum(number, 1)
        squares = np.bincount(B.row, B.data**2 * node[B.col], self.size)
        shared = np.bincount(B.row, B.data**2 * (several * node)[B.col], self.size)
        columns = self.C.B @ sparse.diags(np.sqrt(several * node))
        return columns[:, several], (shared > 0.0) * compliance * (1.0 - shared / divisor(squares))

    def shared(self) -> np.ndarray:
        """(size,) bool, the rows of nodes at which the body has several contacts. Not collective."""
        if len(self.parts) < 2:
            return np.zeros(self.size, bool)
        B = self.C.B.tocoo()
        return np.bincount(B.row, self._several()[B.col], self.size) > 0.0

    def at_body(self, s: np.ndarray) -> np.ndarray:
        """B Bᵀ s (size,) beside its diagonal, what forces do to the body's nodes, told at rows. Not collective."""
        B = self.C.B
        return B @ (B.T @ s) / divisor(B.multiply(B).sum(axis=1).A1)

    def _several(self) -> np.ndarray:
        """(columns of B,) bool, the dofs of nodes at which the body has several contacts."""
        B, d = self.C.B.tocoo(), self.motions.shape[1]
        contact = np.repeat(
            np.arange(len(self.parts)), [interface.size for interface in self.interfaces]
        )
        meets, acts = np.zeros((len(self.parts), B.shape[1] // d), bool), B.data != 0.0
        meets[contact[B.row[acts]], B.col[acts] // d] = True
        return np.repeat(meets.sum(axis=0) > 1, d)

    def even(self, forces: Mapping[str, np.ndarray]) -> None:
        """Share the `forces` of the body's bonds with its images, by contact, evenly at nodes that several of these have.

        Four images of a node have four ties, of which three suffice: of all forces with the same effect on the body those
        are taken for which Σ s²/area is least, as a constant stress has them. Not collective.
        """
        bonds = [each for each in self._sides if each[0].itself and each[0].law.two_sided]
        if len(bonds) < 2:
            return
        moves = self.C.B.multiply(self.C.B).sum(axis=1).A1 > 0.0  # no row of clamped nodes alone
        shared, found, rows, areas = self.shared() & moves, list[tuple[str, np.ndarray]](), [], []
        for interface, entries, _ in bonds:
            law = interface.law
            some = np.flatnonzero(shared[entries] & law.live)
            area = np.append(interface.area, np.repeat(interface.area[law.sliding], law.components))
            found.append((interface.name, some))
            rows.append(entries.start + some)
            areas.append(area[some])
        root = np.sqrt(np.concatenate(areas))
        if len(root) > MOST:
            return
        B = self.C.B[np.concatenate(rows)]
        B = root[:, None] * B[:, B.getnnz(axis=0) > 0].toarray()
        s = np.concatenate([forces[name][some] for name, some in found])
        s = root * (B @ np.linalg.lstsq(B, s / root, rcond=RANK)[0])
        ends = np.cumsum([len(some) for _, some in found])[:-1]
        for (name, some), own in zip(found, np.split(s, ends), strict=True):
            forces[name][some] = own

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x (metres from newtons), centred; both (size,), `relative` as for `Compliance.mult`. Collective."""
        self._operator.mult(x, y, purpose, relative)

    @property
    def known(self) -> bool:
        """Whether `dense` takes no solve."""
        return self.C.kind == "explicit" or not self.C.B.count_nonzero()

    def dense(self) -> np.ndarray:
        """C (size, size) as a matrix, centred (m/N)."""
        return self._operator.dense()

    def restart(self) -> None:
        """Count multiplications from the set-up on, for another iteration on the same factors."""
        self.C.count = self._set_up.copy()

    def loaded_by(self, case: LoadCase) -> Member:
        """The same body, drawn and not moved, under another load case alone, on the same factors. Not collective."""
        other, b = Member(self.body, self.interfaces), self.elasticity.b.duplicate()
        b.array[:] = case.b
        other.elasticity = replace(self.elasticity, b=b, acting=case)
        return other

    def need_norm(self) -> None:
        """Estimate ‖C‖ now, as a part of the set-up. Collective on the body's communicator."""
        self.C.norm()
        self._set_up["norm"] = self.C.count["norm"]

    def pull(self, s: np.ndarray) -> np.ndarray:
        """−Bᵀ s (nv, d): what contact forces s (size,) do to all nodes of the body (N). Not collective."""
        return sum(
            (
                nodal_forces(interface, side, s[entries], len(self.motions))
                for interface, entries, sides in self._sides
                for side in sides
            ),
            np.zeros(self.motions.shape[:2]),
        )

    def work(self, u: np.ndarray, s: np.ndarray) -> np.ndarray:
        """Work of loads, reactions and heat along displacements: (2, k) in J, by history in the order of the scene.

        The first row is f·u for the loads f of a history, at its factor 1, and the displacement u (nv, d) under the
        present loads and contact forces s (size,); the second R·p − ∫ σ : ε for the reactions R of clamps, with the
        displacements p and thermal strains ε of the history. Not collective.
        """
        joules, acting = np.zeros((2, len(self.body.histories))), self.elasticity.acting
        for k, name in enumerate(self.body.histories):
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
        self._joules = np.zeros((2, len(self.body.histories), len(self.body.histories)))
        self._pushed, self._along = np.zeros((2, len(self.body.histories), self.size))
        for k, (name, case) in enumerate(
            (name, now.cases.get(name)) for name in self.body.histories
        ):
            if case:
                self.elasticity = now.under({other: float(other == name) for other in now.cases})
                self._joules[:, :, k] = self.work(self.displacement(none)[0], none)
                self._along[k] = self._pushed[k] = self.response(name)[0]
                if case.taken.any() or case.heat.any():
                    loads = apply(
                        self.elasticity.supports.free[now.nodes], case.f[now.nodes]
                    ).ravel()
                    self._pushed[k] = self.body.response_to(loads)
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
        work[0] += np.array([self.response(name)[1] @ alpha for name in self.body.histories])
        return self.h + self.G.T @ alpha - yielded, yielded, energy, work

    def displacements(
        self,
        cases: Sequence[LoadCase],
        s: Sequence[np.ndarray],
        alpha: Sequence[np.ndarray],
        purpose: str,
        relative: float,
    ) -> list[np.ndarray]:
        """Displacements (nv, d) in metres under k load cases alone, which prescribe what this one does, with contact
        forces (size,) and motions (j,) of each; the rest as of `displacement`. Collective on the body's communicator.
        Raises SolverError."""
        f, u = self.elasticity.A.createVecs()
        loads = np.empty((len(cases), f.local_size))
        for load, case, forces in zip(loads, cases, s, strict=True):
            f.array[:] = case.b - self.C.B.T @ forces
            load[:] = self.body.balanced(f).array_r
        found = []
        for one, motion in zip(self.C.solve_all(loads, purpose, relative), alpha, strict=True):
            u.array[:] = self.body.centring.centre(one) if self.body.centring else one
            found.append(self.elasticity.expand(u) + self.motions @ motion)
        return found

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
            load = self.body.balanced(f)
            if load.norm() > 0.0:
                self.C.solve(load, u, purpose, ROUNDING)  # the certificate checks this solve
            if self.body.centring:
                u.array[:] = self.body.centring.centre(u.array_r)
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
