"""The sides of a body on all its interfaces: between its displacement and the vectors there, by geometry alone."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, TypeVar

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.elasticity import Elasticity
from ddmpi.interface.interface import Interface
from ddmpi.interface.trace import (
    displacement_trace,
    normal_trace,
    sliding_trace,
    trace,
)
from ddmpi.system.numbers import concatenated

T = TypeVar("T", bound=Any)


class Sides:
    """The sides of a body on its interfaces, in the order of their entries in a vector. Its methods are not collective.

    Attributes
    ----------
    size : length of the body's vectors
    parts : by contact, the slice of its entries in a vector, and the side, 0 or 1, of the body; where it has both sides,
        what it does there is the sum over them, and stands for the first
    began : by contact, displacements (nv, d) from which slip counts (m), of bodies that move far
    """

    def __init__(self, body: str, interfaces: Sequence[Interface]) -> None:
        self.name, self.interfaces, self.began = body, tuple(interfaces), dict[str, np.ndarray]()
        ends = np.cumsum([0, *(interface.size for interface in self.interfaces)]).tolist()
        self.size = ends[-1]
        self._sides = [
            (interface, slice(start, stop), interface.sides(body))
            for interface, (start, stop) in zip(
                self.interfaces, itertools.pairwise(ends), strict=True
            )
        ]
        self.parts = {
            interface.name: (entries, sides[0]) for interface, entries, sides in self._sides
        }

    def rows(self, elasticity: Elasticity) -> sparse.csr_matrix:
        """B (size, columns of A)."""
        none = sparse.csr_matrix((0, elasticity.A.size[1]))
        rows = self._each(lambda met, side: trace(met, side, elasticity))
        return sparse.vstack([none, *rows], format="csr")

    def _each(self, of: Callable[[Interface, int], T]) -> Iterator[T]:
        """What a function of an interface and a side gives on each interface: the sum over the body's sides."""
        for interface, _, sides in self._sides:
            first, *second = (of(interface, side) for side in sides)
            yield sum(second, first)

    def trace(self, u: np.ndarray) -> np.ndarray:
        """B u (size,) in metres, of a displacement (nv, d) of all nodes."""
        rows = self._each(lambda met, side: displacement_trace(met, side, u))
        return concatenated(rows)

    def beside(self, u: np.ndarray) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
        """Displacements (m) that belong to no unknown, by contact and side: normal ones at the interfaces' probes, and
        tangential ones of nodes without friction."""
        between = self._each(lambda met, side: normal_trace(side, met.probes, u))
        along = self._each(
            lambda met, side: sliding_trace(met, side, u - self.began.get(met.name, 0.0))
        )
        keys = [(name, side) for name, (_, side) in self.parts.items()]
        return dict(zip(keys, zip(between, along, strict=True), strict=True))

    def begin(self, began: Mapping[str, np.ndarray]) -> np.ndarray:
        """Displacement (size,) from which slip counts (m), by `began`: those (nv, d) of all nodes, by contact."""
        self.began = dict(began)
        rows = self._each(lambda met, side: displacement_trace(met, side, self.began[met.name]))
        return concatenated(rows)
