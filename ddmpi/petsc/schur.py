"""The Schur complement that MUMPS can leave beside its factors (ICNTL(19)).

No version of petsc4py wraps PETSc's MatFactorSetSchurIS, MatFactorInvertSchurComplement and
MatFactorGetSchurComplement, so they are called through ctypes.
"""

from __future__ import annotations

import ctypes
import functools

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


def inverted_schur(pc: PETSc.PC, size: int) -> np.ndarray:
    """The inverse (size, size) of the Schur complement, after the factorization.

    It is inverted in place, in PETSc's memory: full solves with the factors use the same copy. The array is read only,
    and valid only as long as the PC exists. Raises PETSc.Error if the Schur complement is not positive definite.
    """
    _call("MatFactorInvertSchurComplement", _POINTER(pc.getFactorMatrix().handle))
    array = _schur_array(pc, size)
    array.flags.writeable = False
    return array.T  # symmetric; the transpose has the Fortran order that BLAS needs


def invert_on_first(pc: PETSc.PC, size: int) -> np.ndarray | None:
    """The inverse (size, size) of the Schur complement of a factorization on several ranks, on the first of them.

    MUMPS gives the lower triangle by rows, in the first rank's memory. None if it is not positive definite. Only on
    the first rank, not collective.
    """
    S, failed = dpotrf(_schur_array(pc, size).T, lower=0, overwrite_a=1)
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


@functools.cache
def _petsc() -> ctypes.CDLL:
    return ctypes.CDLL(PETSc.__file__)


def _call(name: str, *arguments: object) -> None:
    function = getattr(_petsc(), name)
    function.argtypes = [ctypes.c_int if isinstance(a, ctypes.c_int) else _POINTER for a in arguments]
    function.restype = ctypes.c_int
    code = function(*arguments)
    if code:
        raise PETSc.Error(code)
