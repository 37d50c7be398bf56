"""What happens at the contact nodes of an interface: forces, gap, slip, status."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ddmpi.interface.interface import Interface

CLOSED = 1e-8
"""A node whose normal force is this part of the largest one, or less, counts as open, unless it is bonded."""


@dataclass(frozen=True)
class ContactState:
    """The state of an interface. Forces and directions are those of its first body.

    Attributes
    ----------
    normal_force : (m,) positive under pressure, negative under tension, which bonded nodes may bear (N)
    tangential_force, slip : (m, d − 1) in N and m; zero at nodes without tangential unknowns
    gap : (m,) opening (m)
    status : (m,) "open", "slip" or "stick"
    """

    interface: Interface
    normal_force: np.ndarray
    tangential_force: np.ndarray
    gap: np.ndarray
    slip: np.ndarray
    status: np.ndarray

    @property
    def pressure(self) -> np.ndarray:
        """(m,) normal stress (Pa)."""
        return self.normal_force / self.interface.area

    @property
    def shear(self) -> np.ndarray:
        """(m, d − 1) tangential stress (Pa)."""
        return self.tangential_force / self.interface.area[:, None]

    @property
    def forces(self) -> np.ndarray:
        """(m, d) force on the first body at each node (N): −(s_ν ν + s_t t)."""
        components = np.column_stack([self.normal_force, self.tangential_force])
        return -np.einsum("mc,mcd->md", components, self.interface.frame)

    @property
    def force(self) -> np.ndarray:
        """(d,) resultant of the forces on the first body (N)."""
        return self.forces.sum(axis=0)

    @property
    def moment(self) -> float:
        """x F_y − y F_x of the forces on the first body about the origin, summed over its nodes (N m), in the plane."""
        (x, y), (fx, fy) = self.interface.xy.T, self.forces.T
        return float((x * fy - y * fx).sum())

    def count(self, status: str) -> int:
        return int((self.status == status).sum())


def contact_state(interface: Interface, s: np.ndarray, bound: np.ndarray, u: np.ndarray) -> ContactState:
    """The state of the contact nodes. Not collective.

    Parameters
    ----------
    s : (size,) contact forces that obey the bounds (N)
    bound : (mt,) slip bound that held for them (N)
    u : (size,) relative displacement, the sum of both bodies' traces (m)
    """
    law, m, sliding = interface.law, interface.m, interface.sliding
    normal, moved = s[:m].copy(), law.split(u)
    tangential, slip = np.zeros((2, m, law.components))
    tangential[sliding], slip[sliding] = law.split(s)[1], moved[1]
    status = np.full(m, "slip" if law.name == "none" else "stick", dtype="U5")
    status[sliding[law.reaches_bound(s, bound)]] = "slip"
    status[~law.closed(s, CLOSED)] = "open"
    return ContactState(interface, normal, tangential, interface.gap - moved[0], slip, status)
