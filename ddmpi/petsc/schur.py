"""The Schur complement that MUMPS can leave beside its factors (ICNTL(19)).

No version of petsc4py wraps PETSc's MatFactorSetSchurIS, MatFactorInvertSchurComplement and
MatFactorGetSchurComplement, so they are called through ctypes.
"""

from __future__ import annotations

import ctypes

import numpy as np
from petsc4py import PETSc

_POINTER = ctypes.c_void_p


def request_schur(pc: PETSc.PC, dofs: np.ndarray) -> None:
    """Make the next factorization keep the Schur complement on `dofs` (ascending, unique).

    The PC must have its factor solver type, and must not be set up yet. Serial matrices only.
    """
    pc.setFactorSetUpSolverType()
    index = PETSc.IS().createGeneral(dofs.astype(PETSc.IntType), comm=PETSc.COMM_SELF)
    _call("MatFactorSetSchurIS", _POINTER(pc.getFactorMatrix().handle), _POINTER(index.handle))


def inverted_schur(pc: PETSc.PC, size: int) -> np.ndarray:
    """The inverse (size, size) of the Schur complement, after the factorization.

    It is inverted in place, in PETSc's memory: full solves with the factors use the same copy. The array
    is read only, and valid only as long as the PC exists. Raises PETSc.Error if the Schur complement is
    not positive definite.
    """
    factor, schur, status, data = _POINTER(pc.getFactorMatrix().handle), _POINTER(), ctypes.c_int(), _POINTER()
    _call("MatFactorInvertSchurComplement", factor)
    _call("MatFactorGetSchurComplement", factor, ctypes.byref(schur), ctypes.byref(status))
    _call("MatDenseGetArrayRead", schur, ctypes.byref(data))
    array = np.ctypeslib.as_array(ctypes.cast(data, ctypes.POINTER(ctypes.c_double)), (size, size))
    array.flags.writeable = False
    _call("MatDenseRestoreArrayRead", schur, ctypes.byref(data))
    _call("MatFactorRestoreSchurComplement", factor, ctypes.byref(schur), status)
    return array.T  # symmetric; the transpose has the Fortran order that BLAS needs


def _call(name: str, *arguments: object) -> None:
    function = getattr(ctypes.CDLL(PETSc.__file__), name)
    function.argtypes = [ctypes.c_int if isinstance(a, ctypes.c_int) else _POINTER for a in arguments]
    function.restype = ctypes.c_int
    code = function(*arguments)
    if code:
        raise PETSc.Error(code)
