"""The Schur complement that MUMPS leaves beside its factors, which petsc4py wraps in no version.

PETSc: MatFactorSetSchurIS, MatFactorCreateSchurComplement (MUMPS ICNTL(19)); called through ctypes.
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


def schur_complement(pc: PETSc.PC, size: int) -> np.ndarray:
    """The symmetric Schur complement (size, size), dense, after the factorization; a copy."""
    schur, status, data = _POINTER(), ctypes.c_int(), _POINTER()
    _call("MatFactorCreateSchurComplement", _POINTER(pc.getFactorMatrix().handle), ctypes.byref(schur),
          ctypes.byref(status))
    _call("MatDenseGetArrayRead", schur, ctypes.byref(data))
    array = np.ctypeslib.as_array(ctypes.cast(data, ctypes.POINTER(ctypes.c_double)), (size, size))
    lower, upper = np.tril(array), np.triu(array)
    if not np.tril(array, -1).any():  # MUMPS may fill one triangle only
        full = upper + np.triu(array, 1).T
    elif not np.triu(array, 1).any():
        full = lower + np.tril(array, -1).T
    else:
        full = (array + array.T) / 2
    _call("MatDenseRestoreArrayRead", schur, ctypes.byref(data))
    _call("MatDestroy", ctypes.byref(schur))
    return full


def _call(name: str, *arguments: object) -> None:
    function = getattr(ctypes.CDLL(PETSc.__file__), name)
    function.argtypes, function.restype = [_POINTER] * len(arguments), ctypes.c_int
    code = function(*arguments)
    if code:
        raise PETSc.Error(code)
