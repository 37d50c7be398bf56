"""Is this answer right? The state of the interface and the residuals of the coupled problem.

Computed from the final displacements and forces of both bodies alone; nothing of the iteration that
found them enters. All residuals are free of units.
"""

from __future__ import annotations

from dataclasses import asdict, dataclass

import numpy as np

from ddmpi.body import Friction
from ddmpi.interface import Interface

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

ON_BOUND = 1e-8
"""Relative distance to a bound below which a node counts as lying on it (exact for MPRGP)."""


@dataclass(frozen=True)
class ContactState:
    """What happens at the contact nodes; all (m,), forces as role 1's body defines their directions.

    ``normal_force`` and ``tangential_force`` in N, ``gap`` (opening) and ``slip`` in m, ``status``
    one of "open", "slip", "stick". Nodes without a tangential unknown have neither force nor slip.
    """

    normal_force: np.ndarray
    tangential_force: np.ndarray
    gap: np.ndarray
    slip: np.ndarray
    status: np.ndarray

    def count(self, status: str) -> int:
        return int((self.status == status).sum())


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


def contact_state(interface: Interface, friction: Friction, s: np.ndarray, g: np.ndarray,
                  traces: tuple[np.ndarray, np.ndarray]) -> ContactState:
    """The state of the contact nodes.

    Parameters
    ----------
    s : (size,) contact forces that obey the bounds (N)
    g : (mt,) slip bound that held for them (N)
    traces : contact displacements [N; T] u (size,) of role 1's and role 2's body (m)

    Not collective.
    """
    m, sliding = interface.m, interface.sliding
    normal = s[:m].copy()
    tangential, slip = np.zeros(m), np.zeros(m)
    tangential[sliding], slip[sliding] = s[m:], traces[0][m:] + traces[1][m:]
    gap = interface.gap - traces[0][:m] - traces[1][:m]
    status = np.full(m, "slip" if friction.law == "none" else "stick")
    status[sliding[reaches_bound(s[m:], g)]] = "slip"
    status[normal <= ON_BOUND * normal.max(initial=0.0)] = "open"
    return ContactState(normal, tangential, gap, slip, np.char.strip(status))


def reaches_bound(tangential: np.ndarray, g: np.ndarray) -> np.ndarray:
    """Where tangential forces (mt,) are on their slip bound g (mt,), up to rounding. Not collective."""
    largest = np.abs(tangential).max(initial=0.0)
    return np.abs(tangential) >= g - ON_BOUND * np.minimum(g, largest or np.inf)


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
