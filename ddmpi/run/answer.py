"""The Python interface: a scene solved from a program, and what the answer holds."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.ranks import on_working_ranks
from ddmpi.errors import InputError
from ddmpi.interface.state import ContactState
from ddmpi.mesh.build import order_of_files
from ddmpi.petsc.options import RunOptions
from ddmpi.run.run import Solved, compute
from ddmpi.scene.reader import read_scene, read_text
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import from_first, in_lockstep
from ddmpi.system.clock import Clock


@dataclass(frozen=True)
class BodyAnswer:
    """The fields of one body.

    Attributes
    ----------
    points : (nv, 2) nodes (m)
    triangles : (nt, 3 or 6) nodes of the triangles
    displacement : (nv, 2) in metres
    stress : (nt, 4) σ_xx, σ_yy, σ_zz, σ_xy in Pa, or None where the scene asks for no stress
    von_mises : (nt,) in Pa, or None
    """

    points: np.ndarray
    triangles: np.ndarray
    displacement: np.ndarray
    stress: np.ndarray | None
    von_mises: np.ndarray | None


@dataclass(frozen=True)
class Answer:
    """An answer as one rank holds it.

    Attributes
    ----------
    summary : what a run writes as summary.json; the same on all ranks
    contacts : state by contact: normal_force, pressure, shear, gap, slip, status, force, …; the same on all ranks
    bodies : fields of the bodies that live on this rank, by name
    solved : everything else that was computed, for studies of the method; None on ranks without a body; not a stable
        interface
    """

    summary: dict[str, Any]
    contacts: Mapping[str, ContactState]
    bodies: Mapping[str, BodyAnswer]
    solved: Solved | None

    @property
    def certified(self) -> bool:
        """Whether the certificate and, if the scene asks for one, the accuracy target are met."""
        return self.summary["converged"]

    @property
    def reason(self) -> str:
        """How the run ended, in words."""
        return self.summary["reason"]


def solve(scene: str | Path, comm: MPI.Comm | None = None, overrides: Mapping[str, Any] | None = None) -> Answer:
    """Solve a scene; nothing is written.

    Parameters
    ----------
    scene : a scene's file, or its text where it has several lines
    comm : any number of ranks; MPI.COMM_WORLD if left out. PETSc starts on all ranks of
        MPI.COMM_WORLD together: where `comm` is a part of it, call ``petsc4py.init()`` on all ranks before
    overrides : values by key, as after ``--set``: ``{"contact.upper-lower.friction.coefficient": 0.5}``

    Returns
    -------
    An answer, also where it is not certified: look at ``answer.certified``.

    Raises
    ------
    InputError, SolverError, InterruptionError
        the same on all ranks. Collective on `comm`.
    """
    world = in_lockstep(MPI.COMM_WORLD if comm is None else comm)
    path, text = ("scene", str(scene)) if "\n" in str(scene) else (str(scene), None)

    def read() -> Settled:
        settings = [f"{key}={_toml(value)}" for key, value in (overrides or {}).items()]
        return read_scene(path, text or read_text(path), settings, order_of_files(path))

    settled, clock, options = from_first(world, read), Clock(), RunOptions()
    options.use(settled.petsc)
    try:
        computed = on_working_ranks(world, settled, lambda part: compute(part, settled, path, clock, write=False))
    finally:
        options.use({})
    seconds, solved = clock.largest(world), computed[0] if computed else None
    found = (solved.summary | {"seconds": seconds}, solved.solution.contacts) if solved else None
    summary, contacts = world.bcast(found)
    own = {name: BodyAnswer(each.points, each.triangles, each.displacement, each.stress, each.von_mises)
           for name, each in (solved.fields.items() if solved else ())}
    return Answer(summary, contacts, own, solved)


def _toml(value: Any) -> str:
    """The value as TOML has it on one line. Raises InputError."""
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{_toml(key)} = {_toml(entry)}" for key, entry in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(_toml, value)) + "]"
    if isinstance(value, bool | str):
        return json.dumps(value, ensure_ascii=False)
    if isinstance(value, int | float):
        return repr(value)
    raise InputError(f"overrides: {value!r} is no value of a scene; give numbers, words, lists or tables")
