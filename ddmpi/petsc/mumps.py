"""MUMPS called directly: factors of A that solve with A and give C = B A⁻¹ Bᵀ without an inverse.

In [A Bᵀ; B 0] the rows of B are the variables of a Schur complement, which is −C. MUMPS eliminates A alone, so that
Cholesky factors do, in any order of A's rows. PETSc has no way to such a solver. The library is the one that PETSc has
loaded; the structure is that of its public header `dmumps_c.h`.
"""

from __future__ import annotations

import ctypes
import functools
import re
import weakref
from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI
from petsc4py import PETSc
from scipy.linalg.blas import dsymv

from ddmpi.petsc.options import in_force

VERSIONS = (
    ("5.5.0", "5.5.1", "5.6.0", "5.6.1", "5.6.2"),
    ("5.7.0", "5.7.1", "5.7.2", "5.7.3", "5.8.0", "5.8.1", "5.8.2"),
    ("5.9.0",),
)
"""Versions of MUMPS by the structure in their header, which changed with 5.7.0 and 5.9.0. docs/developers/versions.md
says which of them ran here."""

KNOWN = ("body_ksp_type", "body_pc_type", "body_pc_factor_mat_solver_type")
"""Options of a body's solver that take effect before MUMPS is called."""

SETTINGS = (4, 6, 7, 8, 13, 14, 22, 23, 27, 29, 35, 36, 38, 48, 56, 58)
"""The ICNTL that a user may set; all others are PETSc's to set, or change what is computed."""

TOO_SMALL, RETRIES = (-8, -9), 4
"""INFOG(1) of a memory estimate of MUMPS that was too small, and how often its margin is doubled then."""

AGREEMENT = 1e-3
"""Largest relative difference of C·1 and a solve. Misread structures differ by orders of magnitude."""

_INT, _LONG, _REAL, _POINTER, _CHAR = (
    ctypes.c_int32,
    ctypes.c_int64,
    ctypes.c_double,
    ctypes.c_void_p,
    ctypes.c_char,
)

_ALL, _OLD, _NEW, _NEWEST, _TO_58 = (0, 1, 2), (0,), (1, 2), (2,), (0, 1)

_LAYOUT: tuple[tuple[tuple[int, ...], Any, str], ...] = (
    (_ALL, _INT, "sym par job comm_fortran icntl:60 keep:500"),
    (_ALL, _REAL, "cntl:15 dkeep:230"),
    (_ALL, _LONG, "keep8:150"),
    (_ALL, _INT, "n nblk nz_alloc nz"),
    (_ALL, _LONG, "nnz"),
    (_ALL, _POINTER, "irn jcn a"),
    (_ALL, _INT, "nz_loc"),
    (_ALL, _LONG, "nnz_loc"),
    (_ALL, _POINTER, "irn_loc jcn_loc a_loc"),
    (_ALL, _INT, "nelt"),
    (_ALL, _POINTER, "eltptr eltvar a_elt blkptr blkvar perm_in sym_perm uns_perm colsca rowsca"),
    (_ALL, _INT, "colsca_from_mumps rowsca_from_mumps"),
    (_NEW, _POINTER, "colsca_loc rowsca_loc rowind colind pivots"),
    (_ALL, _POINTER, "rhs redrhs rhs_sparse sol_loc rhs_loc"),
    (_NEW, _POINTER, "rhsintr"),
    (_ALL, _POINTER, "irhs_sparse irhs_ptr isol_loc irhs_loc"),
    (_NEW, _POINTER, "glob2loc_rhs glob2loc_sol"),
    (_ALL, _INT, "nrhs lrhs lredrhs nz_rhs lsol_loc nloc_rhs lrhs_loc"),
    (_NEW, _INT, "nsol_loc"),
    (_ALL, _INT, "schur_mloc schur_nloc schur_lld mblock nblock nprow npcol"),
    (_NEW, _INT, "ld_rhsintr"),
    (_ALL, _INT, "info:80 infog:80"),
    (_ALL, _REAL, "rinfo:40 rinfog:40"),
    (_TO_58, _INT, "deficiency"),
    (_ALL, _POINTER, "pivnul_list mapping"),
    (_NEW, _POINTER, "singular_values"),
    (_NEWEST, _INT, "nb_singular_values"),
    (_ALL, _INT, "size_schur"),
    (_ALL, _POINTER, "listvar_schur schur"),
    (_OLD, _INT, "instance_number"),
    (_ALL, _POINTER, "wk_user"),
    (_ALL, _CHAR, "version_number:32"),
)
"""Entries of the structures up to the last one in use: versions that have them, type, and names with array lengths."""

_SPACE = 2**16
"""Bytes for the structure of any version; the largest known has 11,000."""


def _structure(number: int) -> type[ctypes.Structure]:
    fields = [
        (name, kind * int(length) if length else kind)
        for those, kind, names in _LAYOUT
        if number in those
        for name, _, length in (word.partition(":") for word in names.split())
    ]
    return type(f"Structure{number}", (ctypes.Structure,), {"_fields_": fields})


_STRUCTURES = [_structure(number) for number in range(len(VERSIONS))]


class MumpsError(Exception):
    """MUMPS reports an error."""


class RefusedError(Exception):
    """Why MUMPS is not called directly."""


class Factors:
    """Cholesky factors of A, on the ranks of its communicator.

    Parameters
    ----------
    A : (n, n) symmetric, positive definite
    B : (k, n) on the first rank; the others give one without rows
    order : (n,) int32 the place of each row in the order of elimination, on the first rank; None leaves it to MUMPS

    The first rank has C = B A⁻¹ Bᵀ (k, k) as `condensed`, in Fortran order, of which only the upper triangle counts.
    Construction and all methods are collective. Raises RefusedError if this MUMPS, or an option, is not known here;
    MumpsError if the factorization fails.
    """

    def __init__(self, A: PETSc.Mat, B: sparse.csr_matrix, order: np.ndarray | None) -> None:
        settings, comm = _settings(), A.comm.tompi4py()
        k, n = B.shape
        self._size, self._run = k, _function()
        self._memory = ctypes.create_string_buffer(_SPACE)
        self._data = data = self._started(comm)
        # messages if asked for; whose entries; a Schur complement
        data.icntl[0], data.icntl[2], data.icntl[3] = -1, 6 if settings.get(4) else -1, 0
        data.icntl[17], data.icntl[18] = 3 * (comm.size > 1), 1
        local = "_loc" * (comm.size > 1)
        irn, jcn, a = _entries(A, B)
        arrays = {"irn" + local: irn, "jcn" + local: jcn, "a" + local: a}
        setattr(data, "nnz" + local, len(a))
        data.n, data.size_schur = comm.bcast((n + k, k))
        schur, self._listed = np.zeros((k, k)), np.arange(n + 1, n + k + 1, dtype=np.int32)
        data.listvar_schur, data.schur = self._listed.ctypes.data, schur.ctypes.data
        if order is not None:  # symbolically, by counting columns
            arrays["perm_in"] = np.concatenate([order + np.int32(1), self._listed])
            data.icntl[6], data.icntl[57] = 1, 2
        for name, array in arrays.items():
            setattr(data, name, array.ctypes.data)
        for number, value in settings.items():
            data.icntl[number - 1] = value
        try:
            self._do(1)
            self._factor()
        except MumpsError:
            self.destroy()
            raise
        for name in arrays:  # MUMPS needs them no more
            setattr(data, name, None)
        # MUMPS leaves 0 − B A⁻¹ Bᵀ = −C on the variables of the Schur complement.
        self.condensed = np.negative(schur, out=schur).T if comm.rank == 0 else None
        self._check(B, comm)

    def _started(self, comm: MPI.Comm) -> ctypes.Structure:
        """The structure of a new instance of MUMPS. Raises RefusedError for an unknown version."""
        head = _STRUCTURES[0].from_buffer(self._memory)  # the same in all versions
        head.sym, head.par, head.job, head.comm_fortran = 1, 1, -1, comm.py2f()
        self._run(self._memory)
        self._end = weakref.finalize(self, _end, self._run, self._memory)
        self._end.atexit = False
        return self._known()

    def solve(self, f: np.ndarray | None) -> np.ndarray | None:
        """A⁻¹ f (n,), both on the first rank; None elsewhere. There also of several loads (k, n)."""
        # the end of each is ignored
        loads = np.zeros((1, 0)) if f is None else np.atleast_2d(f)
        work = np.hstack([loads, np.zeros((len(loads), self._size if loads.size else 0))])
        self._data.nrhs, self._data.lrhs = work.shape
        self._data.rhs = work.ctypes.data
        self._do(3)
        return None if f is None else work[:, : loads.shape[1]].reshape(f.shape)

    def destroy(self) -> None:
        """Free MUMPS's memory, once."""
        self._end()

    def _known(self) -> ctypes.Structure:
        """The structure of this version. Raises RefusedError if none of those known has a known version in it."""
        for structure, versions in zip(_STRUCTURES, VERSIONS, strict=True):
            data = structure.from_buffer(self._memory)
            if data.version_number in [version.encode() for version in versions]:
                return data
        self.destroy()
        found = re.search(rb"\d+\.\d+\.\d+", self._memory.raw)
        raise RefusedError(
            f"version {found[0].decode() if found else 'unknown'} is not among those that ddmpi knows"
        )

    def _check(self, B: sparse.csr_matrix, comm: MPI.Comm) -> None:
        """RefusedError unless C and a solve agree on the displacement by equal forces."""
        solved, agrees = self.solve(B.T @ np.ones(B.shape[0]) if comm.rank == 0 else None), True
        if solved is not None and self.condensed is not None:
            moved = dsymv(1.0, self.condensed, np.ones(B.shape[0]))
            # sums of rows may nearly cancel
            size = max(np.linalg.norm(moved), self.condensed.diagonal().max())
            agrees = bool(np.linalg.norm(B @ solved - moved) <= AGREEMENT * size)
        if not comm.bcast(agrees):
            self.destroy()
            raise RefusedError("the compliance does not agree with a solve")

    def _factor(self) -> None:
        for _ in range(RETRIES):
            try:
                return self._do(2)
            except MumpsError:
                if self._data.infog[0] not in TOO_SMALL:
                    raise
                self._data.icntl[13] *= 2
        return self._do(2)

    def _do(self, job: int) -> None:
        self._data.job = job
        self._run(self._memory)
        if self._data.infog[0] < 0:
            raise MumpsError(
                f"MUMPS: INFOG(1) = {self._data.infog[0]}, INFOG(2) = {self._data.infog[1]}"
            )


def _entries(A: PETSc.Mat, B: sparse.csr_matrix) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Rows, columns (from one on) and values of the upper triangle of [A Bᵀ; B 0], of this rank's rows of A and B."""
    start, _ = A.getOwnershipRange()
    indptr, columns, values = A.getValuesCSR()
    rows = np.repeat(np.arange(start, start + len(indptr) - 1, dtype=np.int32), np.diff(indptr))
    upper, trace = np.flatnonzero(columns >= rows), B.tocoo()
    ends = len(upper), len(upper) + trace.nnz
    irn, jcn, a = np.empty(ends[1], np.int32), np.empty(ends[1], np.int32), np.empty(ends[1])
    for array, of_A, of_B in (
        (irn, rows, trace.col),
        (jcn, columns, A.size[0] + trace.row),
        (a, values, trace.data),
    ):
        np.take(of_A, upper, out=array[: ends[0]], mode="clip")  # without a copy
        array[ends[0] :] = of_B
    irn += 1
    jcn += 1
    return irn, jcn, a


def _settings() -> dict[int, int]:
    """The ICNTL among the options for bodies. Raises RefusedError if there are options that only PETSc can obey."""
    values = {}
    for name in in_force():
        if name.startswith("body_") and name not in KNOWN:
            number = re.fullmatch(r"body_mat_mumps_icntl_(\d+)", name)
            if not number or int(number[1]) not in SETTINGS:
                raise RefusedError(f"-{name} is an option of PETSc's")
            values[int(number[1])] = PETSc.Options().getInt(name)
    return values


@functools.cache
def _function() -> Callable[[Any], None]:
    """`dmumps_c` of the library that PETSc has loaded. Raises RefusedError if there is none."""
    try:
        function = ctypes.CDLL(PETSc.__file__).dmumps_c
    except AttributeError:
        raise RefusedError("its library does not offer dmumps_c") from None
    function.argtypes, function.restype = [ctypes.c_char_p], None
    return function


def _end(run: Callable[[Any], None], memory: ctypes.Array) -> None:
    if not PETSc.Sys.isFinalized():
        data = _STRUCTURES[0].from_buffer(memory)
        data.job, data.icntl[2] = -2, -1  # in silence, where the version was refused as well
        run(memory)
