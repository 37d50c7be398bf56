"""PETSc's error messages and reason codes in words."""

from __future__ import annotations

from petsc4py import PETSc


def reason_name(reasons: type, value: int) -> str:
    """PETSc's name of a reason code."""
    names = [n for n in dir(reasons) if n.isupper() and getattr(reasons, n) == value]
    return next((n for n in names if n.startswith(("CONVERGED", "DIVERGED"))), f"reason {value}")


def petsc_message(error: PETSc.Error) -> str:
    """The last line of PETSc's message, which says what went wrong."""
    return " ".join(str(error).split("\n")[-1].split())
