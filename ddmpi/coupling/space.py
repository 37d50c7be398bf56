"""The layout of the vectors that live on interfaces."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ddmpi.interface.interface import Interface
from ddmpi.interface.law import Laws
from ddmpi.system.numbers import norm


class Space:
    """Vectors over all interfaces of a scene, one interface's part after the other.

    Every rank holds all parts, so norms need no communication. What adds entries of such vectors goes through
    `norm`, the only place that would have to reduce if ranks held different parts.

    Parameters
    ----------
    interfaces : in the order of the parts

    Attributes
    ----------
    parts : slice of a vector by name of the interface
    size : length of a vector
    laws : of all interfaces, on vectors of this space
    gap : (size,) initial gaps at the normal entries (m), zero at the tangential ones
    """

    def __init__(self, interfaces: Sequence[Interface]) -> None:
        self.interfaces = tuple(interfaces)
        self.parts: dict[str, slice] = {}
        start = 0
        for interface in self.interfaces:
            self.parts[interface.name] = slice(start, start + interface.size)
            start += interface.size
        self.size = start
        self.laws = Laws([interface.law for interface in self.interfaces])
        self.gap = np.zeros(start)
        for interface, part in self.each():
            self.gap[part][:interface.m] = interface.gap

    @property
    def m(self) -> int:
        """Contact nodes of all interfaces."""
        return sum(interface.m for interface in self.interfaces)

    def each(self) -> list[tuple[Interface, slice]]:
        """The interfaces with their parts of a vector."""
        return list(zip(self.interfaces, self.parts.values(), strict=True))

    def spread(self, values: Sequence[float]) -> np.ndarray:
        """A vector (size,) that is constant on each interface."""
        return np.repeat(np.asarray(values, float), [interface.size for interface in self.interfaces])

    def norm(self, x: np.ndarray) -> float:
        """‖x‖₂ of a vector (size,)."""
        return norm(x)
