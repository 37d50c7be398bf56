"""PETSc log events for our steps, which -log_view shows beside the stages that `system.clock` makes of the phases."""

from __future__ import annotations

import functools
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from petsc4py import PETSc

NAMES = (
    "LoadResponse",
    "ComplianceForm",
    "ComplianceMult",
    "Exchange",
    "NewtonStep",
    "CoarseSystem",
    "ContactQP",
    "NeumannSolve",
    "Displacement",
    "Certificate",
    "Stress",
    "WriteFields",
    "WriteTables",
    "Figures",
)
"""In the order of registration, which must be the same on all ranks."""


@functools.cache
def event(name: str) -> PETSc.Log.Event:
    """The log event `name`, for a ``with`` statement. The first call initializes PETSc, and registers all events; PETSc
    knows them again by their names. Not collective."""
    from petsc4py import PETSc

    return {title: PETSc.Log.Event(title) for title in NAMES}[name]
