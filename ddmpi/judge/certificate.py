"""Is this answer right? The state of the interface and the residuals of the coupled problem.

Computed from the final displacements and forces of both bodies alone; nothing of the iteration that
found them enters. All residuals are free of units.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from ddmpi.interface.interface import Interface
from ddmpi.interface.law import Friction
from ddmpi.interface.state import ContactState

FACTOR = 50.0
"""A certificate holds when all its residuals are below FACTOR times the tolerance asked for.

The tolerance bounds the relative step of the outer iteration, which is not an error: with a
contraction of 0.8 per step the contact displacement is off by four steps, and the contact forces,
which a compliance of wide spectrum ties to it, by three to twenty times that.
"""

ROUNDING = 1e-10
"""No certificate asks for more than this."""

RESOLVED = 1e-9
"""Contact displacements below this part of the bodies' largest displacement are lost in rounding."""

LARGEST_LIMIT = 0.05
"""No residual above this is certified, whatever the tolerance."""


@dataclass(frozen=True)
class Certificate:
    """Scaled residuals of the coupled problem.

    Attributes
    ----------
    force_mismatch : ‖s_1 − s_2‖ / ‖s‖, the bodies' contact forces must cancel
    penetration : largest overlap over the size of the contact displacements (see `certify`)
    complementarity : Σ s_ν |gap| over Σ s_ν times that size, and the largest
        tension over the largest normal force; the larger of both
    friction : largest distance of s_t from the friction law, P(s_t + ρ u_t) − s_t with the projection
        P on |s_t| ≤ g, over the largest force; it sees forces beyond the bound, slip below it, and
        slip in the wrong direction
    equilibrium : ‖A u + Bᵀ s − b‖ over the loads, the larger of both bodies
    """

    force_mismatch: float
    penetration: float
    complementarity: float
    friction: float
    equilibrium: float

    def violations(self, limit: float) -> list[str]:
        """The residuals above `limit` (or not a number), worded for a message."""
        return [f"{name.replace('_', ' ')} {value:.1e}" for name, value in asdict(self).items() if not value <= limit]


def certificate_limit(tolerance: float) -> float:
    """The largest residual of a certified answer, for the tolerance asked for."""
    return min(max(FACTOR * tolerance, ROUNDING), LARGEST_LIMIT)


def certify(interface: Interface, friction: Friction, state: ContactState, forces: tuple[np.ndarray, np.ndarray],
            traces: tuple[np.ndarray, np.ndarray], equilibrium: tuple[float, float], load: float,
            yielding: float, moved: float) -> Certificate:
    """Residuals of the coupled problem.

    Parameters
    ----------
    forces : contact forces s_1, s_2 (size,) as the two bodies see them (N)
    traces : contact displacements (size,) of both bodies (m)
    equilibrium : relative residual of each body
    load : sum of the absolute nodal loads of both bodies (N), with which contact forces are compared
        where there are none (all of role 2's are zero), and where they are below a millionth of it per node
    yielding : largest contact displacement that the contact forces cause in a body (m). Displacements
        are compared with this (or the overlap, if that is larger) or with the contact displacements,
        whichever is smaller: a body may move far without being strained, or be held back from moving far
    moved : largest displacement of both bodies (m); nothing is compared with less than RESOLVED times it

    Not collective.
    """
    m, sliding = interface.m, interface.sliding
    floor = (1e-6 if forces[1].any() else 1.0) * load / np.sqrt(m)
    U = max(np.abs(t).max(initial=0.0) for t in traces)
    overlap = np.maximum(-state.gap, 0.0).max()
    U = max(min(U, max(yielding, overlap)), RESOLVED * moved)
    S = max(np.abs(f).max(initial=0.0) for f in forces)
    mismatch = np.linalg.norm(forces[0] - forces[1])
    pressed = np.maximum(state.normal_force, 0.0)
    complementarity = max(_ratio(pressed @ np.abs(state.gap), pressed.sum() * U),
                          _ratio(np.maximum(-state.normal_force, 0.0).max(), max(S, floor)))
    law = 0.0
    if friction.law != "none" and len(sliding):
        g, st, ut = friction.slip_bound(pressed, interface), state.tangential_force[sliding], state.slip[sliding]
        law = np.abs(np.clip(st + (_ratio(S, U) * ut if S else 0.0), -g, g) - st).max()
    return Certificate(
        force_mismatch=_ratio(mismatch, max(np.linalg.norm(forces[0]), np.linalg.norm(forces[1]), floor)),
        penetration=_ratio(overlap, U),
        complementarity=complementarity,
        friction=_ratio(law, S),
        equilibrium=float(max(equilibrium)))


def _ratio(a: float, b: float) -> float:
    """a / b; zero if both are, infinite if only b is."""
    return float(a / b) if b else (float("inf") if a else 0.0)
