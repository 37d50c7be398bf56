"""The linear problem of a Newton step: GMRES on the unknown forces; prefix ``newton_``."""

from __future__ import annotations

import logging

import numpy as np
from petsc4py import PETSc

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


class _Restricted:
    """IᵀC E as a PETSc matrix, and the preconditioner restricted to the unknown forces."""

    def __init__(self, joint: Joint, preconditioner: HalfPlaneStiffness, linearised: Linearised,
                 size: float) -> None:
        self.joint, self.preconditioner, self.linearised, self.size = joint, preconditioner, linearised, size
        self.ksp = PETSc.KSP().create(PETSc.COMM_SELF)
        self._whole = np.zeros(joint.size)

    def mult(self, _mat: PETSc.Mat, x: PETSc.Vec, y: PETSc.Vec) -> None:
        left = (self.ksp.getResidualNorm() or self.size) / self.size
        relative = STEERING * min(self.ksp.getTolerances()[0] / left, 1.0)
        product = self.joint.product(self.linearised.expand(x.array_r), "newton", relative)
        y.array[:] = product[self.linearised.unknown]

    def apply(self, _pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        self._whole[self.linearised.unknown] = x.array_r
        y.array[:] = self.preconditioner.mult(self._whole)[self.linearised.unknown]


def solve_linearised(joint: Joint, preconditioner: HalfPlaneStiffness, linearised: Linearised,
                     right: np.ndarray) -> tuple[np.ndarray, int]:
    """The unknown forces y with IᵀC E y = `right`, to FORCING, and the number of iterations.

    Parameters
    ----------
    right : (k,) in metres, at the k unknown forces

    Collective on all bodies. Raises SolverError; what the products raise is deferred by the caller.
    """
    if not right.any():
        return np.zeros_like(right), 0
    context = _Restricted(joint, preconditioner, linearised, float(np.linalg.norm(right)))
    ksp = context.ksp
    K = PETSc.Mat().createPython((len(right), len(right)), context=context, comm=PETSc.COMM_SELF)
    K.setUp()
    b = PETSc.Vec().createWithArray(right, comm=PETSc.COMM_SELF)
    y = b.duplicate()
    ksp.setOptionsPrefix("newton_")
    ksp.setOperators(K)
    ksp.setType(PETSc.KSP.Type.GMRES)
    ksp.setGMRESRestart(KRYLOV_LIMIT)
    ksp.setPCSide(PETSc.PC.Side.RIGHT)
    ksp.getPC().setType(PETSc.PC.Type.PYTHON)
    ksp.getPC().setPythonContext(context)
    ksp.setTolerances(rtol=FORCING, atol=0.0, max_it=KRYLOV_LIMIT)
    try:
        ksp.setFromOptions()
        call_solver(ksp.solve, b, y)
    except PETSc.Error as error:
        raise SolverError(f"the linear problem of a Newton step: {petsc_message(error)}") from None
    reason = ksp.getConvergedReason()
    if reason == PETSc.KSP.ConvergedReason.DIVERGED_MAX_IT:
        log.info("GMRES took %d iterations without reaching %.0e; its step is used as it is",
                 ksp.getIterationNumber(), ksp.getTolerances()[0])
    elif reason < 0:
        raise SolverError(f"the linear problem of a Newton step failed with "
                          f"{reason_name(PETSc.KSP.ConvergedReason, reason)}")
    solution, iterations = y.array_r.copy(), ksp.getIterationNumber()
    for thing in (ksp, K, y, b):
        thing.destroy()
    return solution, iterations
