"""The certificate of an answer: the residuals of the coupled problem, without units, from the final displacements and
forces of the bodies alone. Nothing of the iteration enters."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple, Self

import numpy as np
from mpi4py import MPI

from ddmpi.interface.state import ContactState
from ddmpi.system.numbers import ROUNDING, norm

FACTOR = 50.0
"""All residuals of a certified answer are below FACTOR times the tolerance, which bounds the relative step of the outer
iteration. With a contraction of 0.8 per step the contact displacement is off by four steps, and the contact forces by
three to twenty times that, because the spectrum of the compliance is wide."""

SMALLEST_LIMIT, LARGEST_LIMIT = (
    1e-10,
    0.05,
)  # of the residuals of a certified answer, whatever the tolerance

RESOLVED = 1e-8
"""Contact displacements below this fraction of the bodies' largest displacement are rounding: the usual limit, 5e-7 of
them, is then twenty times the rounding of one number. Solves left up to eight times that."""

AT_REST = 2e-5
"""The same where the forces of a contact are rounding of the displacements, as of parts that heat lets grow together: the
usual limit is then 1e-11 of them."""

NO_FORCE = 1e-6  # contact forces are compared with at least this fraction of the loads, per node

RELEASED = 2e-4
"""Where all forces of a contact became zero, as they were rounding beside those of the load steps before, displacements
are compared with this fraction of what those caused. The usual limit is then 1e-10 of them, which is rounding too."""

EPSILON = float(np.finfo(float).eps)

LITTLE = (
    1e-4  # the forces on a body are compared with at least this fraction of the loads of all bodies
)


class ContactResiduals(NamedTuple):
    """Scaled residuals of one contact.

    Attributes
    ----------
    force_mismatch : ‖s_1 − s_2‖ / ‖s‖, the two bodies' contact forces must cancel
    penetration : largest overlap, if bonded or guided also opening, over the size of the contact displacements (see
        `contact_residuals`)
    complementarity : Σ s_ν |gap| over Σ s_ν times that size, and the largest
        tension over the largest normal force; the larger of both; zero if bonded or guided
    friction : largest distance of s_t from the friction law, P(s_t + ρ u_t) − s_t with the projection
        P on |s_t| ≤ g, over the largest force; it sees forces beyond the bound, slip below it, and
        slip in the wrong direction; if bonded the largest slip over the size of the contact displacements
    """

    force_mismatch: float
    penetration: float
    complementarity: float
    friction: float


@dataclass(frozen=True)
class Certificate:
    """Scaled residuals of the coupled problem.

    Attributes
    ----------
    contacts : residuals by contact, of all on the first rank
    equilibrium : ‖A u + Bᵀ s − b‖ over the loads, by body, of all on the first rank
    known : the result of `worst` on the first rank, if the others have it
    """

    contacts: Mapping[str, ContactResiduals]
    equilibrium: Mapping[str, float]
    known: Mapping[str, tuple[float, str]] | None = None

    def told(self, world: MPI.Comm) -> Self:
        """This certificate, with the `worst` residuals of all contacts and bodies on all ranks. Collective."""
        return replace(self, known=world.bcast(self.worst() if world.rank == 0 else None))

    def worst(self) -> Mapping[str, tuple[float, str]]:
        """The largest residual of each kind, and its contact or body; NaN counts as the largest."""
        if self.known is not None:
            return self.known
        kinds = {
            kind: {name: getattr(residuals, kind) for name, residuals in self.contacts.items()}
            for kind in ContactResiduals._fields
        }
        return {
            kind: _largest(values)
            for kind, values in (kinds | {"equilibrium": self.equilibrium}).items()
        }

    def violations(self, limit: float) -> list[str]:
        """The residuals above `limit` or NaN, in words for a message."""
        return [
            f"{kind.replace('_', ' ')} {value:.1e} of {name}"
            for kind, (value, name) in self.worst().items()
            if not value <= limit
        ]


def certificate_limit(tolerance: float) -> float:
    """The largest residual of a certified answer, for the tolerance asked for."""
    return min(max(FACTOR * tolerance, SMALLEST_LIMIT), LARGEST_LIMIT)


def equilibrium_residual(left: float, acting: float, load: float, moved: float = 0.0) -> float:
    """‖A u + Bᵀ s − b‖ = `left` over max(‖b‖, ‖Bᵀ s‖) = `acting`, or LITTLE of the `load` of all bodies (N).

    It is 0 where all these forces are less than the rounding of displacements makes: EPSILON times `moved`, stiffness
    times displacement (N), as of a body that its partner carries along without force.
    """
    size = max(acting, LITTLE * load)
    return 0.0 if max(left, size) < EPSILON * moved else _ratio(left, size)


def contact_residuals(
    state: ContactState,
    s: np.ndarray,
    mismatch: np.ndarray,
    u: tuple[np.ndarray, np.ndarray],
    load: float,
    everywhere: Sequence[float],
    former: Sequence[float] = (0.0, 0.0),
) -> ContactResiduals:
    """Residuals of one contact. Not collective.

    Parameters
    ----------
    state : of its interface. Displacements are compared with its `yielding` (or the overlap, if that is larger) or with
        the contact displacements, whichever is smaller: a body may move far without strain, or supports may keep it from
        moving. A body alone, on a rigid partner or itself, may not move at all, and displacements are compared with
        yielding
    s : (size,) contact forces that obey the bounds (N)
    mismatch : (size,) difference of the forces (N) as the two bodies see them
    u : contact displacements (size,) of both bodies (m)
    load : sum of the absolute nodal loads of the bodies (N), with which contact forces are compared
        where there are none, and where they are below NO_FORCE of it per node
    everywhere : largest displacement of all bodies, and largest yielding (m). Displacements are compared with at least
        RESOLVED times the first, or AT_REST times it where forces are less than ROUNDING of what it would cause, and at
        least with what half-spaces give way, as where clamps constrain the whole contact. A contact with next to no
        force is compared with the second
    former : the largest of the same in the load steps before; displacements are compared with at least RESOLVED times
        the first and NO_FORCE times the second, or RELEASED times it by a contact without any force
    """
    interface, law = state.interface, state.interface.law
    if not interface.m:  # the sides have left each other
        return ContactResiduals(0.0, 0.0, 0.0, 0.0)
    # S is the size of forces, U that of displacements; the floors keep rounding from being compared with rounding
    floor = (NO_FORCE if s.any() else 1.0) * load / np.sqrt(interface.m)
    gap = state.gap + state.closure  # by how far the law of the joint is missed
    overlap = law.misfit(gap)
    U = np.inf if interface.alone else max(np.abs(trace).max(initial=0.0) for trace in u)
    S = np.abs(s).max(initial=0.0)
    (moved, largest), (moved_before, before) = everywhere, former
    stiffness, farthest = float(interface.stiffness.max()), max(moved, moved_before)
    U = max(
        min(U, max(state.yielding, overlap)),
        RESOLVED * max(farthest, S / stiffness),
        AT_REST * farthest if ROUNDING * stiffness * farthest >= S else 0.0,
        largest if floor >= S else NO_FORCE * largest,
        (NO_FORCE if S else RELEASED) * before,
    )
    work, tension = law.complementarity(state.normal_force, gap)
    # s_ν ≥ 0 and s_ν r_ν = 0: the work of pressure on gaps, over all pressure on gaps of size U; tension
    complementarity = max(
        _ratio(work, np.maximum(state.normal_force, 0.0).sum() * U), _ratio(tension, max(S, floor))
    )
    friction, size = 0.0, S or floor or 1.0
    if len(interface.sliding):
        # ρ = S/U, so that a slip of size U counts as much as a force of size S
        friction = law.violation(
            s, state.slip[interface.sliding], _ratio(size, U) if S or U else 0.0
        )
    return ContactResiduals(
        force_mismatch=_ratio(norm(mismatch), max(norm(s), norm(s + mismatch), floor)),
        penetration=_ratio(overlap, U),
        complementarity=complementarity,
        friction=_ratio(friction, size),
    )


def _largest(values: Mapping[str, float]) -> tuple[float, str]:
    """The largest value, or NaN, and its name; of none, as of a scene without contacts, zero."""
    name = max(
        values, key=lambda name: np.inf if np.isnan(values[name]) else values[name], default=""
    )
    return float(values.get(name, 0.0)), name


def _ratio(a: float, b: float) -> float:
    """a / b; zero if both are, infinite if only b is."""
    return float(a / b) if b else (float("inf") if a else 0.0)
