"""Is this answer right? The residuals of the coupled problem, free of units, from the final displacements and forces of
the bodies alone; nothing of the iteration that found them enters."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from mpi4py import MPI

from ddmpi.interface.state import ContactState
from ddmpi.system.numbers import norm

FACTOR = 50.0
"""A certificate holds when all its residuals are below FACTOR times the tolerance, which bounds the relative step of
the outer iteration: with a contraction of 0.8 per step the contact displacement is off by four steps, and the contact
forces, which a compliance of wide spectrum ties to it, by three to twenty times that."""

SMALLEST_LIMIT, LARGEST_LIMIT = 1e-10, 0.05
"""No certificate asks for less than the first, whatever the tolerance; none allows more than the second."""

RESOLVED = 1e-8
"""Contact displacements below this part of the bodies' largest displacement are lost in rounding: the usual limit, 5e-7
of it, is twenty times the rounding of one number, and solves have been seen to leave eight times that."""

NO_FORCE = 1e-6
"""Contact forces below this part of the loads, per node, are compared with these instead."""

EPSILON = float(np.finfo(float).eps)

LITTLE = 1e-4
"""Forces on a body below this part of the loads of all bodies are compared with these instead."""


class ContactResiduals(NamedTuple):
    """Scaled residuals of one contact.

    Attributes
    ----------
    force_mismatch : ‖s_1 − s_2‖ / ‖s‖, the two bodies' contact forces must cancel
    penetration : largest overlap, if bonded also opening, over the size of the contact displacements (see
        `contact_residuals`)
    complementarity : Σ s_ν |gap| over Σ s_ν times that size, and the largest
        tension over the largest normal force; the larger of both; zero if bonded
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
    known : what `worst` returns, if the first rank has told the others
    """

    contacts: Mapping[str, ContactResiduals]
    equilibrium: Mapping[str, float]
    known: Mapping[str, tuple[float, str]] | None = None

    def told(self, world: MPI.Comm) -> Certificate:
        """This certificate, whose `worst` residuals are those of all contacts and bodies on all ranks. Collective."""
        return replace(self, known=world.bcast(self.worst() if world.rank == 0 else None))

    def worst(self) -> Mapping[str, tuple[float, str]]:
        """The largest residual of each kind, and the contact or body that has it; what is no number is largest."""
        if self.known is not None:
            return self.known
        kinds = zip(ContactResiduals._fields, zip(*self.contacts.values(), strict=True), strict=True)
        found = {kind: _largest(dict(zip(self.contacts, values, strict=True))) for kind, values in kinds}
        return found | {"equilibrium": _largest(self.equilibrium)}

    def violations(self, limit: float) -> list[str]:
        """The residuals above `limit` (or not a number), worded for a message."""
        return [f"{kind.replace('_', ' ')} {value:.1e} of {name}" for kind, (value, name) in self.worst().items()
                if not value <= limit]


def certificate_limit(tolerance: float) -> float:
    """The largest residual of a certified answer, for the tolerance asked for."""
    return min(max(FACTOR * tolerance, SMALLEST_LIMIT), LARGEST_LIMIT)


def equilibrium_residual(left: float, acting: float, load: float, moved: float = 0.0) -> float:
    """‖A u + Bᵀ s − b‖ = `left` over max(‖b‖, ‖Bᵀ s‖) = `acting` (N).

    What acts on a body that others leave alone is rounding; it is compared with LITTLE of the `load` of all bodies.
    Nothing is left where all are less than rounding of displacements makes, EPSILON of `moved`, stiffness times
    displacement (N): a partner carries the body without any force.
    """
    size = max(acting, LITTLE * load)
    return 0.0 if max(left, size) < EPSILON * moved else _ratio(left, size)


def contact_residuals(state: ContactState, s: np.ndarray, mismatch: np.ndarray, u: tuple[np.ndarray, np.ndarray],
                      load: float, yielding: float, everywhere: Sequence[float],
                      former: Sequence[float] = (0.0, 0.0)) -> ContactResiduals:
    """Residuals of one contact. Not collective.

    Parameters
    ----------
    state : of its interface
    s : (size,) contact forces that obey the bounds (N)
    mismatch : (size,) difference of the forces (N) as the two bodies see them
    u : contact displacements (size,) of both bodies (m)
    load : sum of the absolute nodal loads of the bodies (N), with which contact forces are compared
        where there are none, and where they are below NO_FORCE of it per node
    yielding : largest contact displacement that the contact forces cause in a body (m). Displacements
        are compared with this (or the overlap, if that is larger) or with the contact displacements,
        whichever is smaller: a body may move far without being strained, or be held back from moving far. On a rigid
        partner the body may not move at all, and displacements are compared with the first
    everywhere : largest displacement of all bodies, and largest yielding (m). Nothing is compared with less than
        RESOLVED times the first, or than what half-spaces would give way, as where clamps hold all that touches. A
        contact that carries next to no force is compared with the second
    former : the largest of the same in the load steps before. Nothing is compared with less than RESOLVED times the
        first and NO_FORCE times the second
    """
    interface, law = state.interface, state.interface.law
    floor = (NO_FORCE if s.any() else 1.0) * load / np.sqrt(interface.m)
    overlap = law.misfit(state.gap)
    U = np.inf if interface.on_rigid else max(np.abs(each).max(initial=0.0) for each in u)
    S = np.abs(s).max(initial=0.0)
    (moved, largest), (moved_before, before) = everywhere, former
    U = max(min(U, max(yielding, overlap)), RESOLVED * max(moved, moved_before, S / interface.stiffness.max()),
            largest if floor >= S else NO_FORCE * largest, NO_FORCE * before)
    work, tension = law.complementarity(state.normal_force, state.gap)
    complementarity = max(_ratio(work, np.maximum(state.normal_force, 0.0).sum() * U), _ratio(tension, max(S, floor)))
    friction, size = 0.0, S or floor or 1.0
    if len(interface.sliding):
        friction = law.violation(s, state.slip[interface.sliding], _ratio(size, U) if S or U else 0.0)
    return ContactResiduals(
        force_mismatch=_ratio(norm(mismatch), max(norm(s), norm(s + mismatch), floor)),
        penetration=_ratio(overlap, U), complementarity=complementarity, friction=_ratio(friction, size))


def _largest(values: Mapping[str, float]) -> tuple[float, str]:
    name = max(values, key=lambda name: np.inf if np.isnan(values[name]) else values[name])
    return float(values[name]), name


def _ratio(a: float, b: float) -> float:
    """a / b; zero if both are, infinite if only b is."""
    return float(a / b) if b else (float("inf") if a else 0.0)
