"""What happens at the contact nodes of an interface: forces, gap, slip, status."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ddmpi.interface.interface import Interface
from ddmpi.interface.law import Friction

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
