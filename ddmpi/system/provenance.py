"""Where a result comes from: versions, host, time, command, and the job of a batch system."""

from __future__ import annotations

import contextlib
import functools
import importlib
import os
import re
import resource
import shlex
import sys
import time
from importlib.util import find_spec
from typing import Any

from mpi4py import MPI

import ddmpi
from ddmpi.errors import InputError
from ddmpi.system.logs import utc

SLURM = {
    "job_id": "SLURM_JOB_ID",
    "job_name": "SLURM_JOB_NAME",
    "array_job_id": "SLURM_ARRAY_JOB_ID",
    "array_task_id": "SLURM_ARRAY_TASK_ID",
    "restarts": "SLURM_RESTART_COUNT",
    "cluster": "SLURM_CLUSTER_NAME",
    "nodes": "SLURM_JOB_NODELIST",
}
"""Environment variables in which Slurm describes the job."""

NO_CLARABEL = "clarabel is not installed: pip install clarabel"
NO_MATPLOTLIB = (
    "matplotlib is not installed: pip install matplotlib, or Debian's python3-matplotlib"
)


@functools.cache
def versions() -> dict[str, str]:
    """Versions of the software that a result depends on. After petsc4py.init only: importing PETSc starts it."""
    from petsc4py import PETSc

    table = {
        "ddmpi": ddmpi.__version__,
        "python": sys.version.split()[0],
        "petsc": ".".join(str(v) for v in PETSc.Sys.getVersion()),
        "mpi": " ".join(MPI.Get_library_version().split("\n")[0].split(",")[0].strip("\0").split()),
    }
    installed = _installed()
    for name in ("petsc4py", "mpi4py", "numpy", "scipy", "gmsh", "meshio", "h5py", "clarabel"):
        try:
            if name in sys.modules or name not in installed:  # Debian's h5py carries no metadata
                installed[name] = getattr(importlib.import_module(name), "__version__", "unknown")
        except (ImportError, OSError):  # the second one where gmsh lacks a library
            installed[name] = "not there"
        table[name] = installed[name]
    return table


def _installed() -> dict[str, str]:
    """Versions of packages by name, from the names of their metadata. To import importlib.metadata takes 20 ms."""
    packages: dict[str, str] = {}
    for folder in reversed(sys.path):
        with contextlib.suppress(OSError):  # zip files, folders that nobody may read
            names = [
                re.fullmatch(r"(\w+)-(\d[^-]*).*\.(?:dist|egg)-info", name)
                for name in os.listdir(folder or ".")
            ]
            packages |= {name[1].lower(): name[2] for name in names if name}
    return packages


def has_matplotlib() -> bool:
    """Whether pictures can be drawn. Not collective."""
    return find_spec("matplotlib") is not None


def optional(name: str, what: str) -> Any:
    """A module that is not needed for a run. Raises InputError where it is not installed."""
    try:
        return importlib.import_module(name)
    except ImportError:
        raise InputError(f"{what}: {name} is not installed: pip install {name}") from None


def has_clarabel() -> bool:
    """Whether a run can ask if there is an equilibrium. Not collective."""
    return find_spec("clarabel") is not None


def provenance(started: float, hosts: list[str]) -> dict:
    """What leads from a result back to its run: the run's name, start, command, folder, batch job, hosts and versions.

    `started` is the run's start by time.perf_counter, `hosts` are those of all ranks; "run" names start, host, process
    and job of this rank, the first. Not collective.
    """
    seconds = time.time() - (time.perf_counter() - started)
    name = f"{utc(seconds)[:-1]}.{int(seconds % 1 * 1000):03d}Z {whereabouts()}"
    return {
        "run": name,
        "started": utc(seconds),
        "command": command(),
        "working_folder": os.getcwd(),
        "slurm": batch_job(),
        "hosts": hosts,
        "versions": versions(),
    }


def identity(summary: dict) -> dict[str, str]:
    """Metadata of a picture (PNG text chunks) that name its run. Not collective."""
    version = summary.get("versions", {}).get("ddmpi", "of unknown version")
    run = (
        f"run {summary['run']}: {summary['command']}, in {summary['working_folder']}"
        if "run" in summary
        else "unknown run"
    )
    return {"Title": summary["title"], "Software": f"ddmpi {version}", "Description": run}


def peak_memory() -> float:
    """The most memory that this process has held so far (MiB). Not collective."""
    return round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1)


def command() -> str:
    """The command line, as it would be typed."""
    return shlex.join(["ddmpi", *sys.argv[1:]])


def whereabouts() -> str:
    """Host, process and batch job: "HOST PROCESS" or "HOST PROCESS job NUMBER"."""
    job = batch_job()
    in_array = {"array_job_id", "array_task_id"} <= job.keys()
    number = f"{job['array_job_id']}_{job['array_task_id']}" if in_array else job.get("job_id")
    return f"{MPI.Get_processor_name()} {os.getpid()}" + (f" job {number}" if number else "")


def batch_job() -> dict[str, str]:
    """The batch job as Slurm describes it; empty without one."""
    if "SLURM_JOB_ID" not in os.environ:
        return {}
    return {
        name: os.environ[variable] for name, variable in SLURM.items() if variable in os.environ
    }
