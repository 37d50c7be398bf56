"""Errors of Python code that PETSc calls come out as they were raised, and what it has made is freed, in all
versions."""

import gc

import pytest
from petsc4py import PETSc

from ddmpi.errors import SolverError
from ddmpi.petsc.versions import TaoReason, call_solver, free_garbage


class Faulty:
    """A matrix, and a preconditioner that solves with it in turn: what it raises passes two levels of PETSc."""

    def __init__(self, error: BaseException) -> None:
        self.error = error

    def mult(self, _mat: PETSc.Mat, _x: PETSc.Vec, _y: PETSc.Vec) -> None:
        raise self.error

    def apply(self, _pc: PETSc.PC, x: PETSc.Vec, y: PETSc.Vec) -> None:
        solver(self, PETSc.PC.Type.NONE).solve(x, y)


def solver(context: Faulty, preconditioner: str) -> PETSc.KSP:
    A = PETSc.Mat().createPython((3, 3), context=context, comm=PETSc.COMM_SELF)
    A.setUp()
    ksp = PETSc.KSP().create(PETSc.COMM_SELF)
    ksp.setOperators(A)
    ksp.setType(PETSc.KSP.Type.GMRES)
    ksp.getPC().setType(preconditioner)
    if preconditioner == PETSc.PC.Type.PYTHON:
        ksp.getPC().setPythonContext(context)
    return ksp


def ones() -> PETSc.Vec:
    b = PETSc.Vec().createSeq(3)
    b.set(1.0)
    return b


@pytest.mark.parametrize("preconditioner", ["none", "python"])
@pytest.mark.parametrize(
    "kind", [SolverError, ValueError, RuntimeError, MemoryError, KeyboardInterrupt]
)
def test_error_of_a_callback_comes_out_as_it_was_raised(kind, preconditioner):
    error = kind("mine")
    b = ones()
    with pytest.raises(kind, match="mine") as caught:
        call_solver(solver(Faulty(error), preconditioner).solve, b, b.duplicate())
    assert caught.value is error
    assert error.__context__ is None  # no PETSc.Error with the solver's frames hangs on to it


@pytest.mark.parametrize("preconditioner", ["none", "python"])
def test_error_of_a_callback_survives_the_garbage_collector(preconditioner):
    """Python 3.13 collects between two steps of an error through PETSc, loses it, and petsc4py crashes."""
    b = ones()
    solve = solver(Faulty(ValueError("mine")), preconditioner).solve
    thresholds = gc.get_threshold()
    gc.set_threshold(1)
    try:
        with pytest.raises(ValueError, match="mine"):
            call_solver(solve, b, b.duplicate())
        assert gc.isenabled()
    finally:
        gc.set_threshold(*thresholds)


def test_error_of_petsc_stays_one():
    ksp = solver(Faulty(ValueError("not reached")), "none")
    with pytest.raises(PETSc.Error):
        call_solver(ksp.solve, ones(), PETSc.Vec().createSeq(4))


def test_reasons_have_their_names():
    assert TaoReason.CONVERGED_GATOL > 0 > TaoReason.DIVERGED_MAXITS


def test_what_python_lets_go_of_is_freed():
    """Two hundred vectors of a mebibyte, one after another; PETSc 3.18 keeps them all by itself."""
    import resource

    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    for _ in range(200):
        PETSc.Vec().createSeq(2**17, comm=PETSc.COMM_SELF).set(1.0)
        free_garbage()
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - peak < 50 * 1024  # KiB
