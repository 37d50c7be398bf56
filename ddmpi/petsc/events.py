"""What -log_view calls our steps: PETSc log events, beside the stages that `problem.Clock` makes of the phases."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from petsc4py import PETSc



NAMES = ("LoadResponse", "ComplianceForm", "ComplianceMult", "Exchange", "NewtonStep", "ContactProgram",
         "NeumannSolve", "Displacement", "Certificate", "Stress", "WriteFields", "WriteTables", "Figures")
"""In the order in which they are registered: PETSc wants the same on all ranks."""


def event(name: str) -> PETSc.Log.Event:
    """The log event `name`, for a ``with`` statement. Not collective; PETSc is initialised by the first."""
    return _registered()[name]


@functools.cache
def _registered() -> dict[str, PETSc.Log.Event]:
    from petsc4py import PETSc

    return {name: PETSc.Log.Event(name) for name in NAMES}
