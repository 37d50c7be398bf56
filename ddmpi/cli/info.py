"""What this installation has: versions, and which solvers."""

import os
import platform
from collections.abc import Iterable

from petsc4py import PETSc

from ddmpi.system.provenance import versions

CHOLESKY = {"mumps": "mumps", "cholmod": "suitesparse", "mkl_pardiso": "mkl_pardiso"}
"""Cholesky factorizations beside PETSc's own, with the packages that have them."""

PRECONDITIONERS = ("gamg", "hypre", "ml", "bddc")

QP_TYPES = (
    "gpcg",
    "tron",
    "blmvm",
    "bncg",
    "bnls",
    "bntr",
    "bntl",
    "bqnls",
    "bqnktr",
    "bqpip",
    "pdipm",
)
"""PETSc's types for QPs with bounds; ours, MPRGP, is always there."""


def describe_installation() -> str:
    """Lines of text. Not collective."""
    lines = {
        **versions(),
        "Cholesky factorizations": _listed(
            [
                *(
                    name
                    for name, package in CHOLESKY.items()
                    if PETSc.Sys.hasExternalPackage(package)
                ),
                "petsc",
            ]
        ),
        "multigrid and others": _listed(name for name in PRECONDITIONERS if _has_type("PC", name)),
        "contact subproblems (TAO)": "python (MPRGP), "
        + _listed(name for name in QP_TYPES if _has_type("TAO", name)),
        "machine": f"{platform.node()}, {platform.system()} {platform.machine()}, {os.cpu_count()} cores, "
        f"OMP_NUM_THREADS {os.environ.get('OMP_NUM_THREADS', 'not set (1 is best)')}",
    }
    width = max(map(len, lines))
    return "".join(f"{name:{width}}  {value}\n" for name, value in lines.items())


def _listed(names: Iterable[str]) -> str:
    return ", ".join(names) or "none"


def _has_type(kind: str, name: str) -> bool:
    solver = getattr(PETSc, kind)().create(PETSc.COMM_SELF)
    try:
        solver.setType(name)
    except PETSc.Error:
        return False
    finally:
        solver.destroy()
    return True
