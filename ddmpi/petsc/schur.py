"""The Schur complement that MUMPS leaves beside its factors, which petsc4py wraps in no version.

PETSc: MatFactorSetSchurIS, MatFactorInvertSchurComplement, MatFactorGetSchurComplement (MUMPS ICNTL(19));
called through ctypes.
"""

from __future__ import annotations

import ctypes

import numpy as np
from petsc4py import PETSc

_POINTER = ctypes.c_void_p


def request_schur(pc: PETSc.PC, dofs: np.ndarray) -> None:
    """Make the coming factorization keep the Schur complement on `dofs` (ascending, unique).

    The PC must have its factor solver type and not be set up. Serial matrices only.
    """
    pc.setFactorSetUpSolverType()
    index = PETSc.IS().createGeneral(dofs.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
    _call("MatFactorSetSchurIS", _POINTER(pc.getFactorMatrix().handle), _POINTER(index.handle))


def inverted_schur(pc: PETSc.PC, size: int) -> np.ndarray:
    """The inverse (size, size) of the Schur complement, after the factorization.

    It is inverted where it lies, in PETSc's memory: there is one copy of it, which full solves with the
    factors use as well. The array must not be written to, nor used after the PC has gone. Raises
    PETSc.Error where the Schur complement is not positive definite.
    """
    factor, schur, status, data = _POINTER(pc.getFactorMatrix().handle), _POINTER(), ctypes.c_int(), _POINTER()
    _call("MatFactorInvertSchurComplement", factor)
    _call("MatFactorGetSchurComplement", factor, ctypes.byref(schur), ctypes.byref(status))
    _call("MatDenseGetArrayRead", schur, ctypes.byref(data))
    array = np.ctypeslib.as_array(ctypes.cast(data, ctypes.POINTER(ctypes.c_double)), (size, size))
    array.flags.writeable = False
    _call("MatDenseRestoreArrayRead", schur, ctypes.byref(data))
    _call("MatFactorRestoreSchurComplement", factor, ctypes.byref(schur), status)
    return array.T  # symmetric; so it is in the order of Fortran, as BLAS wants it


def _call(name: str, *arguments: object) -> None:
    function = getattr(ctypes.CDLL(PETSc.__file__), name)
    function.argtypes = [ctypes.c_int if isinstance(a, ctypes.c_int) else _POINTER for a in arguments]
    function.restype = ctypes.c_int
    code = function(*arguments)
    if code:
        raise PETSc.Error(code)
