"""The friction law of an interface."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ddmpi.interface.interface import Interface
from ddmpi.scene.contacts import Coulomb, NoFriction, Tresca


def friction_role(algorithm: str) -> int:
    """The role whose program bounds the tangential forces."""
    return 2 if algorithm == "original" else 1


@dataclass(frozen=True)
class Friction:
    """The friction law at the nodes that slide.

    Attributes
    ----------
    law : "coulomb", "tresca" or "none"
    coefficient : (mt,) Coulomb coefficient, or None
    bound : (mt,) Tresca slip bound times nodal length (N), or None
    """

    law: str
    coefficient: np.ndarray | None = None
    bound: np.ndarray | None = None

    def slip_bound(self, normal_force: np.ndarray, interface: Interface) -> np.ndarray:
        """g (mt,) in newtons, given the normal forces (m,)."""
        if self.law == "coulomb":
            return self.coefficient * normal_force[interface.sliding]
        return self.bound


def friction_at(law: Coulomb | Tresca | NoFriction, interface: Interface) -> Friction:
    """Evaluate the law of the scene at the contact nodes. Not collective."""
    s = interface.sliding

    def values(value) -> np.ndarray:
        at_nodes = np.full(interface.m, value) if isinstance(value, float | int) else value.at(interface.xy)
        return at_nodes[s].astype(float)

    if isinstance(law, Coulomb):
        return Friction("coulomb", coefficient=values(law.coefficient))
    if isinstance(law, Tresca):
        return Friction("tresca", bound=values(law.slip_bound) * interface.length[s])
    return Friction("none", bound=np.empty(0))
