"""Where petsc4py differs from version to version (3.18 to 3.26 and after), in one place."""

from __future__ import annotations

import gc
from collections.abc import Callable

from petsc4py import PETSc

TaoReason = PETSc.TAO.ConvergedReason if hasattr(PETSc.TAO, "ConvergedReason") else PETSc.TAO.Reason
"""Why a TAO ended; renamed after 3.22."""


def call_solver(solve: Callable[..., None], *arguments: object) -> None:
    """Call a PETSc solver that calls back into Python; an error of the callback comes out as it was raised.

    petsc4py 3.18 lets it through. Later ones raise a PETSc.Error, and one more for every further level
    of PETSc between here and the callback; what was raised stands at the end of the chain of causes.
    Python must not collect garbage while an error passes through PETSc: from Python 3.13 on it then loses
    the error, and petsc4py crashes.
    Collective where `solve` is; raises what the callback raises, or PETSc.Error.
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
    raise raised  # here, where the chain that led to it is gone and holds no PETSc objects any longer


def free_garbage() -> None:
    """Free the PETSc objects of this process alone that Python has let go of: PETSc 3.18 keeps them till it is told.

    Others, on a communicator of several ranks, are not touched. Not collective.
    """
    PETSc.garbage_cleanup(PETSc.COMM_SELF)
