"""MUMPS called directly: the structure of each version, and how a version is found out before anything is read."""

import contextlib
import ctypes
from types import SimpleNamespace

import numpy as np
import pytest
import scipy.sparse as sparse
from petsc4py import PETSc

from ddmpi.petsc.mumps import (
    _SPACE,
    _STRUCTURES,
    TOO_SMALL,
    VERSIONS,
    Factors,
    MumpsError,
    RefusedError,
    _end,
    _function,
)

OFFSETS = {  # in bytes, by a C compiler from the headers in Debian's libmumps-headers-dev
    "5.5.1": {
        "n": 5416,
        "irn": 5440,
        "a_loc": 5496,
        "perm_in": 5552,
        "rhs": 5600,
        "irhs_ptr": 5648,
        "lrhs": 5676,
        "nz_rhs": 5684,
        "infog": 6048,
        "rinfog": 6688,
        "size_schur": 7032,
        "schur": 7048,
        "version_number": 7072,
    },
    "5.7.3": {
        "n": 5416,
        "irn": 5440,
        "a_loc": 5496,
        "perm_in": 5552,
        "rhs": 5640,
        "irhs_ptr": 5696,
        "lrhs": 5740,
        "nz_rhs": 5748,
        "infog": 6120,
        "rinfog": 6760,
        "size_schur": 7112,
        "schur": 7128,
        "version_number": 7144,
    },
    "5.9.0": {
        "n": 5416,
        "irn": 5440,
        "a_loc": 5496,
        "perm_in": 5552,
        "rhs": 5640,
        "irhs_ptr": 5696,
        "lrhs": 5740,
        "nz_rhs": 5748,
        "infog": 6120,
        "rinfog": 6760,
        "size_schur": 7108,
        "schur": 7120,
        "version_number": 7136,
    },
}


def started(version: str, number: int) -> SimpleNamespace:
    """What is left by a MUMPS that writes this version where structure `number` has it."""
    memory = ctypes.create_string_buffer(_SPACE)
    _STRUCTURES[number].from_buffer(memory).version_number = version.encode()
    return SimpleNamespace(_memory=memory, destroy=lambda: None)


@pytest.mark.skipif(ctypes.sizeof(ctypes.c_void_p) != 8, reason="the offsets are those of 64 bits")
@pytest.mark.parametrize("number", range(len(VERSIONS)))
def test_structure_of_the_headers(number):
    for version in set(VERSIONS[number]) & set(OFFSETS):
        assert {
            name: getattr(_STRUCTURES[number], name).offset for name in OFFSETS[version]
        } == OFFSETS[version]


def test_a_version_is_known_where_its_structure_has_it():
    """Elsewhere it is another MUMPS's."""
    for number, versions in enumerate(VERSIONS):
        for version in versions:
            assert isinstance(Factors._known(started(version, number)), _STRUCTURES[number])
            with pytest.raises(RefusedError, match=f"version {version} is not among"):
                Factors._known(started(version, (number + 1) % len(VERSIONS)))
    with pytest.raises(RefusedError, match=r"version 9\.9\.9 is not among"):
        Factors._known(started("9.9.9", 0))
    with pytest.raises(RefusedError, match="version unknown is not among"):
        Factors._known(started("", 0))


def condensed(*values: float) -> tuple[Factors, np.ndarray]:
    """Factors of a chain of springs with rows that have these values at its middle, and C = B A⁻¹ Bᵀ by numpy."""
    S, B = sparse.diags([-1.0, 2.5, -1.0], [-1, 0, 1], (9, 9), "csr"), np.zeros((2, 9))
    B[:, 4] = values
    A = PETSc.Mat().createAIJ(S.shape, csr=(S.indptr, S.indices, S.data), comm=PETSc.COMM_SELF)
    A.setOption(PETSc.Mat.Option.SPD, True)
    try:
        return Factors(A, sparse.csr_matrix(B), None), B @ np.linalg.solve(S.toarray(), B.T)
    except RefusedError as reason:
        if "agree" in str(reason):
            raise
        pytest.skip(str(reason))


def test_rows_that_cancel_are_no_error():
    """The compliance is checked by the sum of all rows, of which MUMPS refuses half a sparse solve if it is zero."""
    factors, C = condensed(1.0, -1.0)
    assert factors.condensed is not None and not factors.solve(np.zeros(9)).any()
    assert np.triu(factors.condensed) == pytest.approx(np.triu(C))
    factors.destroy()


def test_a_library_without_mumps_is_refused(monkeypatch):
    """PETSc's solver is used then."""
    monkeypatch.setattr(ctypes, "CDLL", lambda path: SimpleNamespace())
    with pytest.raises(RefusedError, match="its library does not offer dmumps_c"):
        _function.__wrapped__()
    monkeypatch.setattr(ctypes, "CDLL", lambda path: SimpleNamespace(dmumps_c=SimpleNamespace()))
    assert _function.__wrapped__().restype is None


def test_mumps_ends_in_silence():
    """Also one whose version was refused, that has MUMPS's own defaults."""
    memory, told = ctypes.create_string_buffer(_SPACE), []
    _STRUCTURES[0].from_buffer(memory).icntl[2] = 6
    _end(lambda given: told.append(_STRUCTURES[0].from_buffer(given)), memory)
    (data,) = told
    assert data.job == -2 and data.icntl[2] < 0


def test_a_compliance_that_solves_contradict_is_refused(monkeypatch):
    """A structure that is misread may give numbers all the same."""
    condensed(1.0, 2.0)[0].destroy()
    solve = Factors.solve
    monkeypatch.setattr(Factors, "solve", lambda self, f: 1.01 * solve(self, f))
    with pytest.raises(RefusedError, match="does not agree with a solve"):
        condensed(1.0, 2.0)


@pytest.mark.parametrize("code", TOO_SMALL)
def test_a_factorization_short_of_memory_gets_more(code):
    """Each try has twice the reserve of the one before; other errors end it at once."""

    def factor(code: int, enough: int) -> list[int]:
        data, tried = SimpleNamespace(icntl=dict.fromkeys(range(60), 20), infog=[code]), []

        def do(job: int) -> None:
            tried.append(data.icntl[13])
            if tried[-1] < enough:
                raise MumpsError

        with contextlib.suppress(MumpsError):
            Factors._factor(SimpleNamespace(_data=data, _do=do))
        return tried

    assert (
        factor(code, 20) == [20]
        and factor(code, 100) == [20, 40, 80, 160]
        and factor(-10, 100) == [20]
    )
    assert factor(code, 10**9) == [20, 40, 80, 160, 320]
