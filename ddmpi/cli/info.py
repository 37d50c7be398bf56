"""What this installation has: versions, and which solvers."""

from __future__ import annotations

import os
import platform
import re

from petsc4py import PETSc

from ddmpi.body.solver import offers_cholesky
from ddmpi.system.provenance import batch_job, versions

CHOLESKY = ("mumps", "cholmod", "mkl_pardiso", "petsc")

PRECONDITIONERS = ("gamg", "hypre", "ml", "bddc")

QP_TYPES = ("gpcg", "tron", "blmvm", "bncg", "bnls", "bntr", "bntl", "bqnls", "bqnktr", "bqpip", "pdipm")
"""PETSc's types for QPs with bounds; ours, MPRGP, is always there."""


def describe_installation() -> str:
    """Lines of text. Not collective."""
    found = versions()
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    job = batch_job()
    lines = {
        **found,
        "gmsh": _gmsh(found["gmsh"]),
        "BLAS": ", ".join(_blas()) or "unknown",
        "HDF5": _hdf5(),
        "Cholesky factorizations": _listed(CHOLESKY, _cholesky_packages()),
        "multigrid and others": _listed(PRECONDITIONERS, [name for name in PRECONDITIONERS if _has_type("PC", name)]),
        "contact subproblems (TAO)":
            "python (MPRGP), " + _listed(QP_TYPES, [name for name in QP_TYPES if _has_type("TAO", name)]),
        "machine": f"{platform.node()}, {platform.system()} {platform.machine()}, {cores} cores for this process, "
                   f"OMP_NUM_THREADS {os.environ.get('OMP_NUM_THREADS', 'not set (1 is best)')}",
        "Slurm job": ", ".join(f"{name} {value}" for name, value in job.items()) or "none",
    }
    width = max(map(len, lines))
    return "".join(f"{name:{width}}  {value}\n" for name, value in lines.items())


def _listed(wanted: tuple[str, ...], there: list[str]) -> str:
    missing = [name for name in wanted if name not in there]
    return (", ".join(there) or "none") + (f" (not: {', '.join(missing)})" if missing else "")


def _cholesky_packages() -> list[str]:
    A = PETSc.Mat().createAIJ((1, 1), nnz=1, comm=PETSc.COMM_SELF)
    A.setValue(0, 0, 1.0)
    A.assemble()
    A.setOption(PETSc.Mat.Option.SPD, True)
    packages = [package for package in CHOLESKY if offers_cholesky(A, package)]
    A.destroy()
    return packages


def _has_type(kind: str, name: str) -> bool:
    solver = getattr(PETSc, kind)().create(PETSc.COMM_SELF)
    try:
        solver.setType(name)
    except PETSc.Error:
        return False
    finally:
        solver.destroy()
    return True


def _gmsh(version: str) -> str:
    """The version; gmsh may be installed without the X libraries that it needs."""
    try:
        import gmsh  # noqa: F401
    except (ImportError, OSError) as error:
        return f"{version}, but it does not start: {error}"
    return version


def _hdf5() -> str:
    try:
        import h5py
    except ImportError as error:
        return f"no h5py: {error}"
    return (f"{h5py.version.hdf5_version} by h5py{' (parallel)' if h5py.get_config().mpi else ''}; PETSc with"
            f"{'' if PETSc.Sys.hasExternalPackage('hdf5') else 'out'} HDF5")


def _blas() -> list[str]:
    """The BLAS libraries that are loaded; nothing where the system does not list them."""
    try:
        with open("/proc/self/maps", encoding="utf-8") as file:
            paths = {line.split()[-1] for line in file if "/" in line}
    except OSError:
        return []
    name = re.compile(r"/[^/]*(openblas|blas\.so|libmkl_(core|rt)|blis|atlas)[^/]*$")
    return sorted(path for path in paths if name.search(path))
