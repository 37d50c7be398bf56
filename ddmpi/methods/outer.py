"""What all outer methods have in common."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from ddmpi.coupling.space import Space


class Step(NamedTuple):
    """One line of the history.

    ``update`` is the relative change of the unknown (the contact forces; in the published iteration the contact
    displacement λ), ``residual`` that of the contact equations over the forces (there the force mismatch
    ‖s_1 − s_2‖ / ‖s_2‖), ``inner_precision`` the tolerance of the subproblems (m; for Newton, of GMRES), ``n_A`` the
    multiplications by A_a⁻¹ of all bodies so far.
    """

    iteration: int
    update: float
    residual: float
    inner_precision: float
    n_A: int


Report = Callable[[Step], None]
"""Called with every step."""


def no_report(step: Step) -> None:
    """A report that goes nowhere."""


class Outer(Protocol):
    """An iteration for the contact forces of all interfaces; every rank runs the same lines.

    Attributes
    ----------
    space : the layout of the vectors
    history : all steps so far
    forces : (size,) contact forces that obey all bounds (N)
    bound : slip bounds (N) of all sliding nodes, for which the forces are meant
    own_forces : (size,) the forces (N) as this rank's body sees them
    mismatch : (size,) difference of the forces (N) as the two bodies of an interface see them
    inner_steps : iterations of GMRES or steps of the QP solver, by kind
    qp_type : TAO type that solves QPs
    checkpoint : called before every iteration, when `state` is whole
    """

    space: Space
    history: list[Step]
    checkpoint: Callable[[], None]

    @property
    def qp_type(self) -> str: ...

    @property
    def inner_steps(self) -> dict[str, int]: ...

    @property
    def forces(self) -> np.ndarray: ...

    @property
    def bound(self) -> np.ndarray: ...

    @property
    def own_forces(self) -> np.ndarray: ...

    @property
    def mismatch(self) -> np.ndarray: ...

    def run(self, tolerance: float) -> str:
        """Iterate until the method's criterion is below `tolerance`; may be called again to go on.

        Returns "converged", "diverged" or "max_iterations". Raises SolverError, and InterruptionError when a signal
        came to a rank; the same on all ranks. Collective.
        """

    def refresh(self, u: np.ndarray) -> None:
        """Take the contact displacement u (size,) of this rank's body (m), computed afresh from `own_forces`."""

    def state(self) -> dict[str, Any]:
        """Everything that the next iteration depends on: numbers, arrays, lists and tables of them.

        Arrays in it are not changed afterwards but replaced.
        """

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what `state` returned."""


def steps_of(rows: Any) -> list[Step]:
    """A history out of the rows of numbers that a checkpoint keeps."""
    return [Step(int(k), float(update), float(residual), float(precision), int(n_A))
            for k, update, residual, precision, n_A in rows]
