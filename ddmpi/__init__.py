"""ddmpi: contact between linear elastic parts, with Tresca or Coulomb friction, by domain decomposition.

The method is that of Haslinger, Kučera, Sassi and Riton: each body lives on its own MPI ranks,
solves with its own stiffness, and exchanges only interface vectors with its neighbours.

    answer = ddmpi.solve("scene.toml")

`help(ddmpi.solve)` has the details.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from mpi4py import MPI

    from ddmpi.run.answer import Answer

__version__ = "0.14.0"


def solve(scene: str | Path | Mapping[str, Any], comm: MPI.Comm | None = None,
          overrides: Mapping[str, Any] | None = None, progress: bool = False) -> Answer:
    """Solve a scene; nothing is written. Collective on `comm`.

        answer = ddmpi.solve("scene.toml", overrides={"contact.upper-lower.friction.coefficient": 0.5})
        print(answer)                       # certified or not, forces, largest displacement
        answer.contacts["upper-lower"].pressure.max(), answer.bodies["upper"].displacement

    Parameters
    ----------
    scene : a scene's file; or its text, of several lines; or a dict with the same keys, whose mesh files are looked for
        in the current folder
    comm : any number of ranks; MPI.COMM_WORLD if left out. PETSc starts on all ranks of
        MPI.COMM_WORLD together: where `comm` is a part of it, call ``petsc4py.init()`` on all ranks before
    overrides : values by key, as after ``--set``: ``{"contact.upper-lower.friction.coefficient": 0.5}``
    progress : whether rank 0 prints what the command prints; if not, the logger ``ddmpi`` of the module logging has it
        there: ``logging.basicConfig(level="INFO")`` shows it

    Returns
    -------
    An answer, also where it is not certified: look at ``answer.certified``.

    Raises
    ------
    InputError, SolverError, InterruptionError
        of `ddmpi.errors`, the same on all ranks
    """
    from ddmpi.run.answer import solve  # not before it is needed: MPI and PETSc start with it

    return solve(scene, comm, overrides, progress)
