"""The interface of the outer methods."""

from __future__ import annotations

import inspect
import pkgutil
from collections.abc import Callable
from typing import Any, NamedTuple, Protocol

import numpy as np

from ddmpi.errors import InputError, SolverError


class Step(NamedTuple):
    """One line of the history.

    ``update`` is the relative change of the contact forces, in the published iteration of the contact displacement λ;
    ``residual`` that of the contact equations over the forces, in the published iteration the force mismatch
    ‖s_1 − s_2‖ / ‖s_2‖; ``inner_precision`` the tolerance of GMRES, in the published iteration of the QPs (m); ``n_A``
    the multiplications by A_a⁻¹ of all bodies so far; ``stage`` the stage of a path of Newton's method, in words.
    """

    iteration: int
    update: float
    residual: float
    inner_precision: float
    n_A: int
    stage: str = ""


Report = Callable[[Step], None]
"""Called with every step."""


def no_report(step: Step) -> None:
    """A report that does nothing."""


class Outer(Protocol):
    """An iteration for the contact forces of all interfaces; all ranks run the same lines.

    Attributes
    ----------
    history : all steps so far
    forces : contact forces (N) at the interfaces that this rank owns, which obey all bounds
    bound : slip bounds (N) that the forces at the sliding nodes of these interfaces obey
    inner_steps : iterations of GMRES or steps of the QP solver, by kind
    checkpoint : a method of many iterations calls it before each iteration that can begin from `state`
    """

    history: list[Step]
    inner_steps: dict[str, int]
    checkpoint: Callable[[], None] = staticmethod(lambda: None)

    @property
    def forces(self) -> np.ndarray: ...

    @property
    def bound(self) -> np.ndarray: ...

    @property
    def qp_type(self) -> str:
        """The TAO type that solves QPs."""
        return "none"

    @property
    def mismatch(self) -> np.ndarray:
        """Difference of the forces (N) at the owned interfaces as the two bodies see them."""
        return np.zeros_like(self.forces)

    @property
    def motions(self) -> np.ndarray:
        """Rigid motions (m) of the loose bodies of all ranks."""
        return np.zeros(0)

    def body_forces(self) -> list[np.ndarray]:
        """The contact forces (N) as each body of this rank sees them. Collective."""

    def run(self, tolerance: float) -> str:
        """Iterate until the method's criterion is below `tolerance`; may be called again to go on.

        Returns "converged", "diverged", "max_iterations", "stalled" or "drift". Raises SolverError, and
        InterruptionError when a signal came to a rank; the same on all ranks. Collective.
        """

    def refresh(self, u: list[np.ndarray]) -> None:
        """Take the contact displacements (m) of this rank's bodies, computed anew from `body_forces`."""

    def state(self) -> dict[str, Any]:
        """The numbers, arrays, lists and tables from which the answer and the next load step or iteration follow.

        Arrays in it are not changed afterwards but replaced.
        """

    def restore(self, state: dict[str, Any]) -> None:
        """Go on from what `state` returned."""


ENDS = {
    "converged": "the iteration stopped, but its certificate fails",
    "diverged": "diverged",
    "max_iterations": "not converged: method.max_iterations is reached",
    "stalled": "not converged: Newton's method and its fallbacks stalled",
    "drift": "bodies drift",
    "unsettled": "no equilibrium found: bodies with free motions do not come to rest; they may fall past all "
    "contacts, roll on, or have no stable position",
}
"""Reasons of `Outer.run` to end, in words where no answer is certified."""

REQUIRED = "run", "forces", "bound", "body_forces", "refresh", "state", "restore"
"""What a method must define."""


def outer_from_outside(name: str, kind: Any = None) -> Callable[..., Outer]:
    """The class that `name`, "package.module:Class", stands for, or `kind` if given, if it can be a method.

    Not collective. Raises InputError.
    """
    try:
        kind = pkgutil.resolve_name(name) if kind is None else kind
    except (Exception, SystemExit) as error:  # whatever a module does while it is imported
        raise InputError(
            f'method.outer = "{name}" cannot be imported: {type(error).__name__}: {error}'
        ) from None
    if not isinstance(kind, type) or Outer not in kind.__mro__:
        raise InputError(
            f'method.outer = "{name}" is no class that is based on ddmpi.methods.outer.Outer'
        )
    if missing := [
        needed for needed in REQUIRED if getattr(kind, needed) in (None, getattr(Outer, needed))
    ]:
        raise InputError(
            f'method.outer = "{name}" has no {", ".join(missing)} of its own, see docs/use/methods.md'
        )
    try:
        inspect.signature(kind).bind("assembly", "method", "report")
    except (TypeError, ValueError) as error:
        raise InputError(
            f'method.outer = "{name}" is not made by Class(assembly, method, report): {error}'
        ) from None
    return kind


def check_promises(
    name: str, outer: Outer, stopped: str, sizes: tuple[int, int], reported: int
) -> None:
    """Raise SolverError where the attributes after `Outer.run`, or its reason to end, are not what `Outer` promises.

    `sizes` are those of forces and motions, `reported` the number of reports. Not collective.
    """
    shapes = [np.shape(vector) for vector in (outer.forces, outer.motions)]
    broken = [
        words
        for words, holds in {
            f"its run returns {stopped!r}, none of {', '.join(ENDS)}": stopped in ENDS,
            f"its forces and motions have the shapes {shapes[0]} and {shapes[1]}, not sizes {sizes}": shapes
            == [(size,) for size in sizes],
            "it does not report each step of its history once": len(outer.history) == reported,
            "it reports no step": bool(outer.history),
        }.items()
        if not holds
    ]
    if broken:
        raise SolverError(f'method.outer = "{name}": {"; ".join(broken)}')
