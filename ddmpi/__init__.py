"""ddmpi: contact of elastic bodies with Tresca or Coulomb friction by domain decomposition.

The method is that of Haslinger, Kučera, Sassi and Riton: each body lives on its own MPI ranks,
solves with its own stiffness, and exchanges only interface vectors with its neighbour.

    answer = ddmpi.solve("scene.toml")

`ddmpi.run.answer.solve` has the details.
"""

from typing import Any

__version__ = "0.1.0"


def solve(*arguments: Any, **named: Any) -> Any:
    """Solve a scene; see `ddmpi.run.answer.solve`. Collective."""
    from ddmpi.run.answer import solve  # not before it is needed: MPI and PETSc start with it

    return solve(*arguments, **named)
