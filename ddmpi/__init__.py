"""ddmpi: contact of elastic bodies with Tresca or Coulomb friction by domain decomposition.

The method is that of Haslinger, Kučera, Sassi and Riton: each body lives on its own MPI ranks,
solves with its own stiffness, and exchanges only interface vectors with its neighbour.

    answer = ddmpi.solve("scene.toml")

`ddmpi.run.answer.solve` has the details.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from collections.abc import Mapping
    from pathlib import Path

    from mpi4py import MPI

    from ddmpi.run.answer import Answer

__version__ = "0.6.0"


def solve(scene: str | Path, comm: MPI.Comm | None = None, overrides: Mapping[str, Any] | None = None) -> Answer:
    """Solve a scene; see `ddmpi.run.answer.solve`. Collective."""
    from ddmpi.run.answer import solve  # not before it is needed: MPI and PETSc start with it

    return solve(scene, comm, overrides)
