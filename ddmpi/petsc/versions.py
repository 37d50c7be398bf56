"""Errors and reasons of PETSc in words, and differences between the versions of petsc4py (3.18 to 3.26 and later)."""

from __future__ import annotations

import gc
from collections.abc import Callable

from petsc4py import PETSc

TaoReason = PETSc.TAO.ConvergedReason if hasattr(PETSc.TAO, "ConvergedReason") else PETSc.TAO.Reason
"""Why a TAO ended; petsc4py renamed it after 3.22."""


def reason_name(reasons: type, value: int) -> str:
    """PETSc's name of a reason code."""
    names = [n for n in dir(reasons) if n.isupper() and getattr(reasons, n) == value]
    return next((n for n in names if n.startswith(("CONVERGED", "DIVERGED"))), f"reason {value}")


def petsc_message(error: PETSc.Error) -> str:
    """The last line of PETSc's message, which says what went wrong."""
    return " ".join(str(error).split("\n")[-1].split())


def call_solver(solve: Callable[..., None], *arguments: object) -> None:
    """Call a PETSc solver that calls back into Python, and raise an error of the callback unchanged.

    petsc4py 3.18 does so by itself. Later versions raise a PETSc.Error for every level of PETSc between here
    and the callback; the original error ends the chain of causes. Python must not collect garbage while an
    error passes through PETSc: from Python 3.13 on the error would be lost, and petsc4py would crash.
    Collective where `solve` is. Raises what the callback raises, or PETSc.Error.
    """
    collecting = gc.isenabled()
    gc.disable()
    try:
        solve(*arguments)
        return
    except PETSc.Error as error:
        raised: BaseException = error
        while isinstance(raised, PETSc.Error) and raised.__cause__ is not None:
            raised = raised.__cause__
    finally:
        if collecting:
            gc.enable()
    raise raised  # outside the handler: the chain of errors, which holds PETSc objects, is gone


def free_garbage() -> None:
    """Free this process's own PETSc objects that Python has released; PETSc 3.18 does so only when told.

    Objects on communicators of several ranks are not touched. Not collective.
    """
    PETSc.garbage_cleanup(PETSc.COMM_SELF)
