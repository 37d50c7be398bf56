"""The linear problem of a step: GMRES on the unknown forces; prefix ``newton_``.

    [ IᵀCE + D  −G̃ᵀ ] [ y ]   [ f ]
    [ Ĝ          εE* ] [ α ] = [ h ]        Ĝ = G E, G̃ = G I

with the rigid motions α of bodies that nothing holds. D is that of a layer between the bodies, or of a barrier
(`ddmpi.methods.paths`); of Newton's method itself it is zero but for a part that steers, as ε does, and biases
nothing. The preconditioner is the same system with W M W in the place of (C + D)⁻¹, M being the half-plane stiffness
and W = (1 + D c)^−½, whose coarse problem is solved exactly. The second row then holds from the first iteration on, and
GMRES, preconditioned from the right, works on the first row alone. It measures the residual times W, as wide clearances
would otherwise hide the displacements where bodies touch.
"""

from __future__ import annotations

import logging

import numpy as np
from petsc4py import PETSc

from ddmpi.coupling.coarse import CoarseSystem, Motions
from ddmpi.coupling.joint import STEERING, Joint
from ddmpi.errors import SolverError
from ddmpi.interface.law import Linearised
from ddmpi.methods.half_plane import HalfPlaneStiffness
from ddmpi.petsc.messages import petsc_message, reason_name
from ddmpi.petsc.versions import call_solver

log = logging.getLogger("ddmpi")

FORCING = 1e-3
"""GMRES reduces the residual of a Newton equation by this. Measured on pinched blocks: 1e-2 takes fewer
iterations a step, but more steps; 1e-3 is the cheapest from N = 54 on, and the most even over the meshes."""

KRYLOV_LIMIT = 300
"""Most GMRES iterations in one Newton step; a step that is not solved to FORCING is used as it is."""


class Preconditioner:
    """The half-plane stiffness M of all interfaces with the coarse problem of all bodies.

    Parameters
    ----------
    space : of the interfaces
    motions : coarse motions, the rigid ones first
    diagonal : (motions.size,) what stands for them in the lower right block (N/m): ε E* of rigid motions,
        1/(μ − ½) of modes
    shared : (space.size,) compliances (m/N) that steer at nodes that several interfaces share, zero elsewhere
    c : (space.size,) stiffness of half-planes against short waves (N/m)
    """

    def __init__(self, half_plane: HalfPlaneStiffness, motions: Motions, diagonal: np.ndarray,
                 shared: np.ndarray, c: np.ndarray) -> None:
        self.half_plane, self.motions, self.diagonal, self.shared, self.c = half_plane, motions, diagonal, shared, c


class LinearProblem:
    """The linear problem for one active set.

    Parameters
    ----------
    joint : the operator of all bodies
    preconditioner : for all active sets
    linearised : the forces that the active set implies
    layer : (joint.size,) compliance D (m/N) of a layer or a barrier; None for none
    precise : whether the forces are to be known as well as the displacements, which slender bodies need
    held : part of the springs ε that steer rigid motions

    Construction is collective.
    """

    def __init__(self, joint: Joint, preconditioner: Preconditioner, linearised: Linearised,
                 layer: np.ndarray | None = None, precise: bool = False, held: float = 1.0) -> None:
        self.joint, self.linearised, self._half_plane = joint, linearised, preconditioner.half_plane
        self._unknown, self._whole = linearised.unknown, np.zeros(joint.size)
        D = np.zeros(joint.size) if layer is None else layer
        self._D = (preconditioner.shared + D)[linearised.unknown]
        self._weight = 1.0 / np.sqrt(1.0 + D * preconditioner.c)
        self._rigid = joint.rigid.size
        self._precise = precise or self._rigid > 0
        self._coarse: CoarseSystem | None = None
        if preconditioner.motions.size:
            weights = [self._weight[part, None] for part in joint.space.parts.values()]

            def stiffness(number: int, x: np.ndarray) -> np.ndarray:
                return weights[number] * self._half_plane.on_interface(number, weights[number] * x)

            diagonal = preconditioner.diagonal.copy()
            diagonal[:self._rigid] *= held
            self._coarse = CoarseSystem(preconditioner.motions, linearised.expansion, self._unknown, stiffness,
                                        diagonal)

    def precondition(self, w: np.ndarray, h: np.ndarray | None = None) -> tuple[np.ndarray, np.ndarray]:
        """The unknown forces y (k,) and rigid motions α of the half-plane system for w (k,) in metres, h in newtons.

        w is a displacement times W. `h` (joint.rigid.size,) is zero if left out. Collective.
        """
        self._whole[self._unknown] = w
        y = (self._weight * self._half_plane.mult(self._whole))[self._unknown]
        if not self._coarse:
            return y, np.zeros(0)
        if h is not None:
            h = np.append(h, np.zeros(len(self._coarse) - len(h)))
        y, a = self._coarse.correct(y, h)
        return y, a[:self._rigid]

    def solve(self, right: np.ndarray) -> tuple[np.ndarray, np.ndarray, int]:
        """The unknown forces y (k,) and rigid motions α for the right-hand side f (k,) in metres and h = 0.

        To FORCING, or less where y is not known well enough then: a slender body gives way so much that a small
        residual of displacements says little of its forces. Returns them and the number of iterations. Collective on
        all bodies. Raises SolverError; what the products raise is deferred by the caller.
        """
        comm = self.joint.space.petsc_comm
        right = self._weight[self._unknown] * right
        size = self.joint.space.norm(right)
        if not size:
            return np.zeros_like(right), np.zeros(self._rigid), 0
        self._size = size
        K = PETSc.Mat().createPython(((len(right), None), (len(right), None)), context=self, comm=comm)
        K.setUp()
        w, b = K.createVecs()
        b.array[:] = right
        ksp = self._ksp = PETSc.KSP().create(comm)
        try:
            ksp.setOptionsPrefix("newton_")
            ksp.setOperators(K)
            ksp.setType(PETSc.KSP.Type.GMRES)
            ksp.setGMRESRestart(KRYLOV_LIMIT)
            ksp.getPC().setType(PETSc.PC.Type.NONE)
            ksp.setTolerances(rtol=FORCING, atol=0.0, max_it=KRYLOV_LIMIT)
            ksp.setFromOptions()
            if self._precise:
                ksp.setConvergenceTest(self._converged)
            call_solver(ksp.solve, b, w)
            reason = ksp.getConvergedReason()
            if reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT:
                log.info("GMRES took %d iterations without reaching %.0e; its step is used as it is",
                         ksp.getIterationNumber(), ksp.getTolerances()[0])
            elif reason < 0:
                raise SolverError(f"the linear problem of a Newton step failed with "
                                  f"{reason_name(PETSc.KSP.ConvergedReason, reason)}")
            y, alpha = self.precondition(w.array_r)
            return y, alpha, ksp.getIterationNumber()
        except PETSc.Error as error:
            raise SolverError(f"the linear problem of a Newton step: {petsc_message(error)}") from None
        finally:
            del self._ksp
            for thing in (ksp, K, w, b):
                thing.destroy()

    def mult(self, _mat: PETSc.Mat, x: PETSc.Vec, z: PETSc.Vec) -> None:
        """The first row of the system at the preconditioned point; called by PETSc."""
        left = (self._ksp.getResidualNorm() or self._size) / self._size
        relative = STEERING * min(self._ksp.getTolerances()[0] / left, 1.0)
        y, alpha = self.precondition(x.array_r)
        product = self.joint.product(self.linearised.expand(y), "newton", relative)
        if self._rigid:
            product -= self.joint.rigid.spread(alpha)
        z.array[:] = self._weight[self._unknown] * (product[self._unknown] + self._D * y)

    def _converged(self, ksp: PETSc.KSP, iteration: int, residual: float) -> PETSc.KSP.ConvergedReason | None:
        """Whether the residual is small beside the right-hand side and beside the half-planes' displacement w."""
        rtol, atol = ksp.getTolerances()[:2]
        if not residual <= max(rtol * self._size, atol):
            return None
        w = ksp.buildSolution()
        return PETSc.KSP.ConvergedReason.CONVERGED_RTOL if residual <= max(rtol * w.norm(), atol) else None
