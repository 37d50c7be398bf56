"""The linear problem of a step: GMRES on the unknown forces; prefix ``newton_``.

    [ IᵀCE + D   −G̃ᵀ     ] [ y ]   [ f ]
    [ Ĝ          K + εE* ] [ α ] = [ h ]        Ĝ = G E, G̃ = G I

y are the unknown forces, E y all forces that follow from them, and I y they alone (`Linearised`; I is not the
identity). α are the rigid motions of loose bodies; K resists them where bodies move far. D is a compliance: in space of
springs against which friction turns, on a path of its layer or barrier (`ddmpi.methods.paths`). A small part of D at
nodes of several contacts, and ε times a modulus E*, only steer: they act on changes, which vanish at the answer.

The preconditioner has W M_δ W for (C + D)⁻¹, with W = (1 + Dc)^−½ and M_δ = (1 + δ)(M⁻¹ + δ/c)⁻¹. M is the stiffness of
half-spaces, c that against short waves, and δ the least Dc of each interface: this is exact behind a layer of one
thickness. Its coarse problem is solved exactly. So the second row holds from the first iteration on, and GMRES,
preconditioned from the right, works on the first row alone. It measures the residual times W: D is large at wide
clearances, whose residuals would hide the displacements where bodies touch.
"""

from __future__ import annotations

import logging
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc

from ddmpi.coupling.coarse import CoarseSystem, CrossPoints, Motions
from ddmpi.coupling.joint import Joint
from ddmpi.errors import SolverError
from ddmpi.interface.law import Tangent
from ddmpi.methods.half_space import HalfSpace, modes_of
from ddmpi.petsc.versions import call_solver, petsc_message, reason_name
from ddmpi.system.matrices import on_diagonal
from ddmpi.system.numbers import concatenated, counted

log = logging.getLogger("ddmpi")

FORCING, LOOSEST, SHARE = 1e-3, 1e-2, 0.9
"""GMRES reduces the residual of a step by FORCING, in space by SHARE times the square of the fraction of the residual
that the last step left, between FORCING and LOOSEST (`forcing`). On pinched blocks in the plane 1e-2 takes fewer
iterations a step, but more steps; 1e-3 is the cheapest from N = 54 on, and the most even over the meshes."""

KRYLOV_LIMIT = 300
"""Most GMRES iterations in one Newton step; a step that is not solved to FORCING is used as it is."""

SLENDER = 3e-3
"""Bodies are slender where half-spaces give way by less than this fraction of the bodies: 1e-5 to 1e-7 in needles of
1 : 100, 0.016 to 2 in two boxes."""

HELD_LOOSELY = 1e-6
"""Stiffness of springs that steer rigid motions, over the plane modulus; from 0 to 1e-4 they change no count."""

SHARED = 5e-4
"""Compliance that steers forces at nodes of several contacts, over that of half-spaces there. Without it six of 27
walls fail; in the equations it would change displacements by 1e-2."""

SMOOTH = {1: 0.75, 2: 1.5}
"""A body's coarse modes are deformations in which it gives way by more than this times what half-spaces do, by the
number of tangential components: in the plane a compact body has two to five. At 1, walls take a tenth to a quarter more
multiplications; in space modes from 0.75 on cost more multiplications than they save."""

MANY = 3
"""Coarse modes are used from this number of bodies on, and with loose bodies."""


def forcing(residuals: Sequence[float], in_space: bool) -> float:
    """The factor by which GMRES reduces the residual of the next step, from the `residuals` of all steps so far.

    In space solves are looser after steps that gained little (Eisenstat and Walker, SIAM J. Sci. Comput. 17, 1996,
    choice 2). The first step is always solved to FORCING: if solved to 1e-2, friction turns for long, and two boxes
    with N = 8 take 21 steps instead of 9. So is a step after one without gain, as slender bodies take up to twice the
    steps otherwise. In the plane looser solves cost blocks of unlike stiffness a tenth more products.

    >>> forcing([], True), forcing([0.2], True), forcing([0.2, 0.4], True), forcing([0.2], False)
    (0.001, 0.01, 0.001, 0.001)
    """
    if not residuals or not in_space:
        return FORCING
    if len(residuals) == 1:
        return LOOSEST
    before, left = residuals[-2:]
    return FORCING if left >= before else min(max(SHARE * (left / before) ** 2, FORCING), LOOSEST)


class Linearised(Tangent):
    """The forces x = E y + given that an active set implies, y being the unknown ones, with E = I + F I.

    The columns of I are the directions of the unknown forces, in frames turned to the friction; the coupling F adds the
    friction that follows the pressure, of nodes that slip along q̂ = q_t/|q_t|. In space the force across q̂, along e,
    is unknown: it turns the friction against a spring, r·e = −(κ/c) s·e.

        >>> from ddmpi.interface.law import CoulombLaw
        >>> law = CoulombLaw(1, np.arange(1), 1, np.array([0.25]))
        >>> active = law.active_set(np.array([2.0, 3.0]))  # a node that slips, as 3 is more than a quarter of 2
        >>> Linearised.of(law.linearise(active)).expand(np.array([4.0])).tolist()  # friction follows the pressure
        [4.0, 1.0]
    """

    @classmethod
    def of(cls, tangent: Tangent) -> Linearised:
        """That of a tangent."""
        return cls(**vars(tangent))

    @cached_property
    def number(self) -> int:
        """How many forces are unknown."""
        return int(np.count_nonzero(self.unknown))

    @cached_property
    def basis(self) -> sparse.csr_matrix:
        """I (size, k), with orthonormal columns."""
        size, k = len(self.unknown), self.number
        basis = sparse.csr_matrix(
            (np.ones(k), np.arange(k), np.append(0, np.cumsum(self.unknown))), (size, k)
        )
        return basis if self.turn is None else (self.turn @ basis).tocsr()

    @cached_property
    def expansion(self) -> sparse.csr_matrix:
        """E (size, k)."""
        if not self.coupling.any():
            return self.basis
        size = len(self.unknown)
        follow = sparse.csr_matrix((self.coupling, self.source, np.arange(size + 1)), (size, size))
        return (self.basis + follow @ self.basis).tocsr()

    def place(self, y: np.ndarray) -> np.ndarray:
        """I y (size,): the unknown forces alone."""
        x = np.zeros(len(self.unknown))
        x[self.unknown] = y
        return x if self.turn is None else self.turn @ x

    def expand(self, y: np.ndarray) -> np.ndarray:
        """E y (size,): all forces that follow from the unknown ones."""
        x = self.place(y)
        return x + self.coupling * x[self.source]

    def restrict(self, x: np.ndarray) -> np.ndarray:
        """Iᵀ x (k,): the part of a vector (size,) along the unknown forces."""
        return (x if self.turn is None else self.turn.T @ x)[self.unknown]

    def contract(self, x: np.ndarray) -> np.ndarray:
        """Eᵀ x (k,)."""
        return self.expansion.T @ x

    def move(self, s: np.ndarray) -> np.ndarray:
        """The change (size,) of the forces s that keeps the unknown ones and gives the others their implied values."""
        return self.expand(self.restrict(s)) + self.given - s

    def frozen(self, q: np.ndarray) -> Linearised:
        """The same with slip bounds that are fixed, those of the pressures of q = s − c r (size,)."""
        return replace(
            self,
            coupling=0.0 * self.coupling,
            given=self.given + self.coupling * np.maximum(q, 0.0)[self.source],
        )


class Preconditioner:
    """The half-space stiffness M of all interfaces with the coarse problem of all bodies, for all active sets.

    Attributes
    ----------
    c, hard : (joint.size,) stiffness against short waves (N/m), of soft joints and of half-spaces: half the joint moduli
    in_space : whether friction has two components at any contact
    springs : (rigid.size,) ε E* of rigid motions (N/m)
    shared : (joint.size,) compliances (m/N) that steer at nodes with several contacts, zero elsewhere

    Where bodies move far, half-spaces and coarse problem are made once GMRES asks for them. All is collective.
    """

    def __init__(self, joint: Joint) -> None:
        self._joint, space = joint, joint.space
        stiffness = [interface.stiffness for interface in space.interfaces]
        self.hard = concatenated(stiffness)
        self.c = self.hard / (1.0 + joint.D * self.hard)
        components = np.array([float(law.components) for law in space.laws.laws])
        self.in_space = space.largest(components) > 1.0
        self.springs = HELD_LOOSELY * joint.rigid_moduli
        self.shared = np.where(joint.shared(), SHARED / self.hard, 0.0)
        if not joint.far:  # now, so that a run that continues from a checkpoint does not count their products again
            for made in ("half_space", "coarse", "crossing"):
                getattr(self, made)

    @cached_property
    def half_space(self) -> HalfSpace:
        """The half-spaces."""
        return HalfSpace(self._joint.space, self._joint.local())

    @cached_property
    def coarse(self) -> tuple[Motions, np.ndarray]:
        """Coarse motions, the rigid ones first, and their diagonal of the lower right block (N/m): ε E* of rigid
        motions, 1/(μ − ½) of modes."""
        joint = self._joint
        motions, diagonal = joint.rigid, self.springs
        if (
            joint.bodies >= MANY or motions.size
        ) and not joint.far:  # one pass does not pay for modes
            modes = [(np.empty((0, member.size)), np.empty(0)) for member in joint.members]
            with joint.exchange.deferred():
                modes = modes_of(joint.members, SMOOTH)
            joint.exchange.meet("coarse modes")
            # M⁻¹ is the compliance of two half-spaces, of which a body has ½: a mode gives way by μ − ½ more
            motions, more = joint.add_motions(
                [v for v, _ in modes], [1.0 / (mu - 0.5) for _, mu in modes]
            )
            diagonal = np.append(diagonal, more)
        if motions.size:
            log.log(
                logging.DEBUG if joint.far else logging.INFO,
                "coarse problem: %s and %s of %d bod%s",
                counted(joint.rigid.size, "rigid motion"),
                counted(motions.size - joint.rigid.size, "smooth mode"),
                joint.bodies,
                "ies" if joint.bodies > 1 else "y",
            )
        return motions, diagonal

    @cached_property
    def crossing(self) -> CrossPoints | None:
        """The compliance of nodes at which bodies have several contacts; None in the plane, where the coarse modes see
        to them: with it random assemblies take 12 % more products."""
        return self._joint.cross_points() if self.in_space else None


class Regularisation(NamedTuple):
    """How a linear problem is steered, and how precisely it is solved.

    Attributes
    ----------
    springs, shared : factors on the springs ε that steer rigid motions, and on the compliances that steer shared nodes
    forcing : by which GMRES reduces the residual
    precise : whether forces are solved for as precisely as displacements; those of slender bodies always are
    exact : whether the compliances that steer shared nodes are in the preconditioner of GMRES only
    """

    springs: float = 1.0
    shared: float = 1.0
    forcing: float = FORCING
    precise: bool = False
    exact: bool = False

    def softly(
        self, preconditioner: Preconditioner, linearised: Linearised
    ) -> tuple[np.ndarray, np.ndarray]:
        """What steers the unknown forces (k,) in m/N, and the motions (rigid.size,) in N/m."""
        shared = self.shared * preconditioner.shared[linearised.unknown]
        return shared, self.springs * preconditioner.springs


class LinearProblem:
    """The linear problem for one active set.

    Parameters
    ----------
    joint : the operator of all bodies
    preconditioner : for all active sets
    linearised : the forces that the active set implies
    layer : (joint.size,) compliance D (m/N) of a layer, a barrier, or the springs across friction, in turned frames
    by : what steers, and the precision
    transposed : whether the system is the transposed one, with I and E exchanged; its α has the opposite sign
    purpose : for which products are counted

    Construction is collective.
    """

    def __init__(
        self,
        joint: Joint,
        preconditioner: Preconditioner,
        linearised: Linearised,
        layer: np.ndarray,
        by: Regularisation,
        transposed: bool = False,
        purpose: str = "newton",
    ) -> None:
        self.joint, self.linearised, self._purpose = joint, linearised, purpose
        shared, springs = by.softly(preconditioner, linearised)
        # in `apply` the compliances of soft joints are a part of products
        self._layer = layer[linearised.unknown] + (0.0 if by.exact else shared)
        layer = layer + joint.D
        self._D = shared + layer[linearised.unknown]
        # The transposed of Iᵀ C E is Eᵀ C I: the forces are I y, and rows are tested by E.
        self.expand, self.restrict = (
            (linearised.place, linearised.contract)
            if transposed
            else (linearised.expand, linearised.restrict)
        )
        crossing = preconditioner.crossing
        self._correct = crossing and crossing.corrector(
            linearised.basis, self._D, preconditioner.shared > 0.0
        )
        # M_δ has one δ for each interface, the least one, for the stiffest nodes; W softens the others one by one
        deltas = np.where(linearised.unknown, layer * preconditioner.hard, np.inf)
        least = joint.space.least(deltas)
        self._half_space = preconditioner.half_space.softened(
            np.where(np.isfinite(least), least, 0.0)
        )
        self._weights = 1.0 / np.sqrt(1.0 + layer * preconditioner.hard)[linearised.unknown]
        self._rigid = joint.rigid.size
        self._forcing, self._slender = by.forcing, np.inf if by.precise else SLENDER
        self._coarse: CoarseSystem | None = None
        motions, diagonal = preconditioner.coarse
        if motions.size:
            diagonal = np.append(springs, diagonal[self._rigid :])
            basis, E = linearised.basis, linearised.expansion
            resists, more = on_diagonal(diagonal), len(diagonal) - self._rigid
            if joint.K.nnz:
                resists = resists + sparse.block_diag([joint.K, sparse.csr_matrix((more, more))])
            self._coarse = CoarseSystem(
                motions,
                basis,
                basis if transposed else E,
                self._weights,
                self._half_space.mult,
                resists,
                joint.stays.bolts,
                joint.stays.held,
                E if transposed else None,
            )

    def precondition(
        self, w: np.ndarray, h: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """The unknown forces y (k,) and rigid motions α of the half-space system for w (k,) in metres, h in newtons.

        w is a displacement times W, which `CrossPoints` correct first. `h` (joint.rigid.size,) is zero if left out.
        Collective.
        """
        if self._correct:
            w = self._weights * self._correct(w / self._weights)
        # y = W Iᵀ M_δ I W w, then the coarse problem of rigid motions and smooth modes makes the second row hold
        y = self._weights * self.linearised.restrict(
            self._half_space.mult(self.linearised.place(w))
        )
        if not self._coarse:
            return y, np.zeros(0)
        if h is not None:
            h = np.append(h, np.zeros(self._coarse.size - len(h)))
        y, a = self._coarse.correct(y, h)
        return y, a[: self._rigid]

    def solve(
        self, right: np.ndarray, forcing: float | None = None
    ) -> tuple[np.ndarray, np.ndarray, int]:
        """The unknown forces y (k,), rigid motions α, and number of iterations, for f (k,) in metres and h = 0.

        GMRES ends at `forcing`, or later: a slender body gives way so much that a small residual of displacements says
        little of its forces. Collective on all bodies. Raises SolverError; the caller defers what products raise.
        """
        comm = self.joint.space.petsc_comm
        right = self._weights * right
        size = self.joint.space.norm(right)
        if not size:
            return np.zeros_like(right), np.zeros(self._rigid), 0
        self._size = size
        K = PETSc.Mat().createPython(
            ((len(right), None), (len(right), None)), context=self, comm=comm
        )
        K.setUp()
        w, b = K.createVecs()
        b.array[:] = right
        ksp = self._ksp = PETSc.KSP().create(comm)
        try:
            ksp.setOptionsPrefix("newton_")
            ksp.setOperators(K)
            ksp.setType(PETSc.KSP.Type.GMRES)
            ksp.setGMRESRestart(KRYLOV_LIMIT)  # no restarts: a basis of short vectors costs little
            ksp.getPC().setType(
                PETSc.PC.Type.NONE
            )  # `mult` has it, from the right: the residual is the true one
            ksp.setTolerances(rtol=forcing or self._forcing, atol=0.0, max_it=KRYLOV_LIMIT)
            ksp.setFromOptions()
            ksp.setConvergenceTest(self._converged)
            call_solver(ksp.solve, b, w)
            reason = ksp.getConvergedReason()
            if reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT:
                log.info(
                    "GMRES took %d iterations without reaching %.0e; its step is used as it is",
                    ksp.getIterationNumber(),
                    ksp.getTolerances()[0],
                )
            elif reason < 0:
                raise SolverError(
                    f"the linear problem of a Newton step failed with "
                    f"{reason_name(PETSc.KSP.ConvergedReason, reason)}"
                )
            y, alpha = self.precondition(w.array_r)
            return y, alpha, ksp.getIterationNumber()
        except PETSc.Error as error:
            raise SolverError(
                f"the linear problem of a Newton step: {petsc_message(error)}"
            ) from None
        finally:
            del self._ksp
            for thing in (ksp, K, w, b):
                thing.destroy()

    def mult(self, _mat: PETSc.Mat, x: PETSc.Vec, z: PETSc.Vec) -> None:
        """z ← W times the first row of the system at the forces and motions that `precondition` makes of x."""
        y, alpha = self.precondition(x.array_r)
        z.array[:] = self._weights * self.apply(y, alpha, self._precision)

    @property
    def _precision(self) -> float:
        """Relative precision of the next product."""
        # inexact Krylov methods (Simoncini and Szyld, SIAM J. Sci. Comput. 25, 2003): a product may be the coarser the
        # less is left of the residual
        left = (self._ksp.getResidualNorm() or self._size) / self._size
        return self.joint.steering * min(self._ksp.getTolerances()[0] / left, 1.0)

    def apply(self, y: np.ndarray, alpha: np.ndarray, relative: float = 0.0) -> np.ndarray:
        """The first row (k,) of the system at y (k,) and α, in metres; `relative` as for `Joint.product`. Collective."""
        product = self.joint.product(self.expand(y), self._purpose, relative)
        if self._rigid:
            product -= self.joint.rigid.spread(alpha)
        return self.restrict(product) + self._layer * y

    def _converged(
        self, ksp: PETSc.KSP, iteration: int, residual: float
    ) -> PETSc.KSP.ConvergedReason | None:
        """Whether the residual is small beside the right-hand side, and beside the half-spaces' displacement w."""
        rtol, atol, *_ = ksp.getTolerances()
        if not residual <= max(rtol * self._size, atol):
            return None
        # half-spaces would give way by w, which sets the forces. Bodies are slender where w is far smaller than the
        # right-hand side: a residual that is small beside their displacements need not be small beside w
        w = ksp.buildSolution()
        size = w.norm()
        w.destroy()  # else it stays until PETSc collects garbage
        known = size >= self._slender * self._size or residual <= max(rtol * size, atol)
        return PETSc.KSP.ConvergedReason.CONVERGED_RTOL if known else None
