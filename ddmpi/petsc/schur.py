"""The Schur complement that MUMPS can leave beside its factors (ICNTL(19)).

No version of petsc4py wraps PETSc's MatFactorSetSchurIS and MatFactorGetSchurComplement, so they are called through
ctypes.
"""

from __future__ import annotations

import ctypes

import numpy as np
from petsc4py import PETSc
from scipy.linalg.lapack import dpotrf, dpotri

_POINTER = ctypes.c_void_p


def request_schur(pc: PETSc.PC, dofs: np.ndarray) -> None:
    """Make the next factorization keep the Schur complement on `dofs` (unique, ascending).

    The PC must have its factor solver type, and must not be set up yet. On several ranks the first gives all `dofs`
    and the others none. Collective.
    """
    pc.setFactorSetUpSolverType()
    index = PETSc.IS().createGeneral(dofs.astype(PETSc.IntType), comm=pc.comm)
    _call("MatFactorSetSchurIS", _POINTER(pc.getFactorMatrix().handle), _POINTER(index.handle))
    index.destroy()


def inverted_schur(pc: PETSc.PC, size: int) -> np.ndarray | None:
    """The inverse (size, size) of the Schur complement, after the factorization; None if it is not positive definite.

    PETSc has the lower triangle by columns on one rank, MUMPS by rows on several, in the first one's memory. Only on
    the first rank, not collective.
    """
    S = _schur_array(pc, size)
    S, failed = dpotrf(S if pc.comm.size == 1 else S.T, lower=0)
    if not failed:
        S, failed = dpotri(S, lower=0, overwrite_c=1)
    return None if failed else np.triu(S) + np.triu(S, 1).T


def _schur_array(pc: PETSc.PC, size: int) -> np.ndarray:
    """The Schur complement in PETSc's memory (size, size), by columns of PETSc's matrix."""
    factor, schur, status, data = _POINTER(pc.getFactorMatrix().handle), _POINTER(), ctypes.c_int(), _POINTER()
    _call("MatFactorGetSchurComplement", factor, ctypes.byref(schur), ctypes.byref(status))
    _call("MatDenseGetArrayRead", schur, ctypes.byref(data))
    array = np.ctypeslib.as_array(ctypes.cast(data, ctypes.POINTER(ctypes.c_double)), (size, size))
    _call("MatDenseRestoreArrayRead", schur, ctypes.byref(data))
    _call("MatFactorRestoreSchurComplement", factor, ctypes.byref(schur), status)
    return array


def _call(name: str, *arguments: object) -> None:
    """Call a function of PETSc with arguments that have types of ctypes."""
    code = getattr(ctypes.CDLL(PETSc.__file__), name)(*arguments)
    if code:
        raise PETSc.Error(code)
