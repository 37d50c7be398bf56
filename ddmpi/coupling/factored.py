"""One body by itself, factored once on the rows at which contacts may act."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc

from ddmpi.body.compliance import Compliance, plan_compliance
from ddmpi.body.elasticity import Elasticity, LoadCase
from ddmpi.body.rigid_motions import Centring, FreeFrame, add_springs, support
from ddmpi.body.solver import StiffnessSolver
from ddmpi.coupling.sides import Sides
from ddmpi.coupling.team import TeamMatrix, TeamSolver
from ddmpi.kept.kept import Kept
from ddmpi.petsc.events import event
from ddmpi.petsc.options import ask, asked_for
from ddmpi.system.numbers import Frame


@dataclass(frozen=True)
class Placed:
    """A body in a frame where this is now, at the rows of its interfaces; otherwise as of a `Factored`.

    Attributes
    ----------
    motions, G : the rigid motions that are free there
    C : contact compliance, centred; None until the body is factored
    resisting : K (j, j) of its loads by history, see `FreeFrame.resists` (N/m)
    """

    elasticity: Elasticity
    motions: np.ndarray
    G: np.ndarray
    C: Compliance | None
    responses: Mapping[str | None, tuple[np.ndarray, np.ndarray]]
    resisting: Mapping[str | None, np.ndarray]


class Factored:
    """One body with the rows at which contacts may act, its candidates: all of it that no placement changes.

    A loose body is in equilibrium if G s = e; its C and h are centred: without rigid motions, in the least-squares
    sense.

    Parameters
    ----------
    name : of the body
    elasticity : A and the load cases of the body
    B : (size, columns of A) the candidates
    compliance, memory : kind of the compliance, and the bytes that it may use, see `Compliance`
    histories : of the scene's loads and clamps, None for constant ones
    points : (k, d) positions of the nodes that A acts on, see `Compliance`
    solves : number of problems, such as load steps, to be solved with C

    Attributes
    ----------
    kind, reason : of the `Compliance`, as far as they are known before A is factored
    dear : whether its products are by an iterative solver
    C : contact compliance B A⁻¹ Bᵀ with its counts, from `factor` on; not centred, so multiply by `mult`
    responses : by history h (size,) and e (j,) at the factor 1: B A⁻¹ b, the displacement without contact forces (m),
        zero until `factor`, of a loose body with forces that balance the load; and the load along the motions (N)
    motions : (nv, d, j) the rigid motions that clamps leave free, see `Elasticity`
    G : (j, size) displacements of these motions at the candidates
    centring : of a loose body, from `factor` on
    free : the free components of its frame, if it moves far and has some
    resisting : by history how the loads resist the motions; empty, as they do in frames that move alone

    Methods that use C are collective on the body's communicator, the others are not.
    """

    C: Compliance
    centring: Centring | None = None
    free: FreeFrame | None = None
    resisting: Mapping[str | None, np.ndarray] = {}
    dear = False
    _even: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
    """Where contact forces act faintly on motions, with the centring's K: the motions' contact displacements (q, size),
    B A⁻¹ K (size, q), and Kᵀ A⁻¹ K (q, q)."""

    def __init__(
        self,
        name: str,
        elasticity: Elasticity,
        B: sparse.csr_matrix,
        compliance: str | None = None,
        memory: float = np.inf,
        histories: Sequence[str | None] = (None,),
        points: np.ndarray | None = None,
        solves: int = 1,
    ) -> None:
        A = elasticity.A
        self.name, self.elasticity, self.B = name, elasticity, B
        self.histories, self.motions = tuple(histories), elasticity.motions
        motions = self.motions[elasticity.nodes]
        # G = Rᵀ Bᵀ and e = Rᵀ b, with the free rigid motions R as columns in A's dofs.
        self._R = motions.reshape(A.size[1], motions.shape[2])
        self.G = np.ascontiguousarray((B @ self._R).T)
        self._asked, self._memory, self._points = compliance, memory, points
        self._for = bool(A.getAttr("coarse")), solves
        self.kind, self.reason = plan_compliance(A, B, compliance, memory, *self._for)
        self.responses = {
            name: (np.zeros(B.shape[0]), self.push(case)) for name, case in elasticity.cases.items()
        }

    def factor(self, kept: Kept) -> None:
        """Factor A and solve for the loads, unless this is `kept`. Collective on the body's communicator. Raises
        SolverError."""
        if not self.elasticity.supported:
            # A is singular. With springs on a few dofs its inverse is a generalised inverse of A; centring removes what
            # depends on the springs: C ← P C P, h ← P h, P = 1 − Gᵀ(G Gᵀ)⁺G; and what `_even` adds.
            self.centring = kept.get(
                "centring", self.name, self.depends(kept), lambda: Centring(self._R, self.B)
            )
        # not kept for another case if the solver is iterative, as it starts from earlier solutions
        whole, options = kept.get(
            "compliance",
            self.name,
            self.depends(kept),
            self._compliance,
            lambda value: value[0].solver.direct,
        )
        self.C = whole.another()
        ask(options)
        self.dear = self.C.kind == "iterative"
        if self.centring and self.centring.faint.any():
            K = self.centring.K
            u = kept.get(
                "faint motions",
                self.name,
                (kept.key("compliance", self.name), K),
                lambda: np.array([self._solved(load) for load in K.T]).T,
            )
            self.C.count["faint motions"] += K.shape[1]
            w = K.T @ u
            self._even = self.centring.faint, self.B @ u, (w + w.T) / 2
        self.responses = {
            name: (
                self.response_to(
                    case.b,
                    get=partial(
                        kept.get,
                        f"displacement by {name}",
                        self.name,
                        (kept.key("compliance", self.name), case.b),
                    ),
                ),
                self.push(case),
            )
            for name, case in self.elasticity.cases.items()
        }

    def placed(self, sides: Sides, frame: Frame | None) -> Factored | Placed:
        """The body at the rows of its sides, where its frame is: as drawn, where these are its candidates, itself. Not
        collective."""
        return self

    def depends(self, kept: Kept) -> tuple:
        """What C depends on, see `Kept.get`. Not collective."""
        return kept.key("stiffness", self.name), self.B, self.kind, self.reason

    def _compliance(self) -> tuple[Compliance, set[str]]:
        """The compliance, and the options that PETSc was asked for. Collective on the body's communicator."""
        A, shared = self.elasticity.A, isinstance(self.elasticity.A, TeamMatrix)
        with asked_for() as options:
            if not self.elasticity.supported:
                dofs = support(self.motions[self.elasticity.nodes])
                A = A.with_springs(dofs) if shared else add_springs(A, dofs)
            return Compliance(
                A,
                self.B,
                self.name,
                self._asked,
                self._memory,
                TeamSolver if shared else StiffnessSolver,
                self._points,
                *self._for,
            ), options

    def response_to(
        self,
        load: np.ndarray,
        purpose: str = "load",
        get: Callable[[Callable[[], np.ndarray]], np.ndarray] = lambda make: make(),
    ) -> np.ndarray:
        """h (size,) of a load b (d k,); `get` computes B A⁻¹ b or has kept it. Collective on the body's
        communicator."""
        if not (self.C.size and load.any()):
            return np.zeros(self.C.size)
        self.C.count[purpose] += 1
        return get(partial(self._free, load))

    def push(self, case: LoadCase) -> np.ndarray:
        """(j,) a load case along the rigid motions (N): heat and prescribed displacements have no part along them, of
        which rounding would be left. Not collective."""
        return np.einsum("nij,ni->j", self.motions, case.f)

    def _free(self, load: np.ndarray) -> np.ndarray:
        """B A⁻¹ b (size,) of a load b (d k,). Collective on the body's communicator."""
        b = self.elasticity.b.duplicate()
        b.array[:] = load
        u = self._solved(self.balanced(b).array_r)
        h = self.C.B @ u
        if self.centring is None:
            return h
        h = self.centring.project(h)
        return h - self.centring.faint.T @ (self.centring.K.T @ u) if self._even else h

    def _solved(self, load: np.ndarray) -> np.ndarray:
        """A⁻¹ b (n,) of a load b (n,), which the caller counts. Collective on the body's communicator."""
        b, u = self.elasticity.b.duplicate(), self.elasticity.b.duplicate()
        b.array[:] = load
        with event("LoadResponse"):
            self.C.solver.solve(b, u)
        return u.array_r.copy()

    def balanced(self, f: PETSc.Vec) -> PETSc.Vec:
        """The load f; of a loose body, f plus contact forces that balance it."""
        if self.centring is None:
            return f
        balanced = f.duplicate()
        balanced.array[:] = self.centring.balance(f.array_r)
        return balanced

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        """y ← C x (metres from newtons), centred; both (size,), `relative` as for `Compliance.mult`. Collective."""
        if self.centring is None:
            self.C.mult(x, y, purpose, relative)
        else:
            # P C P is symmetric, and does not depend on the springs
            centred = self.centring.project(x)
            self.C.mult(centred, y, purpose, relative)
            y[:] = self.centring.project(y)
            if self._even:
                # B Π A⁻¹ Πᵀ Bᵀ with Πᵀ Bᵀ x = Bᵀ P x − K F x and W = B A⁻¹ K: of the faint motions F
                F, W, w = self._even
                along = F @ x
                y += F.T @ (w @ along - W.T @ centred) - self.centring.project(W @ along)

    def dense(self) -> np.ndarray:
        """C (size, size) as a matrix, centred (m/N)."""
        C = self.C.dense()
        if self.centring is None:
            return C
        C = self.centring.project(self.centring.project(C).T)
        if self._even:  # as in `mult`
            F, W, w = self._even
            both = self.centring.project(W) @ F
            C = C - both - both.T + F.T @ w @ F
        return C
