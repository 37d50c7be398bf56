"""The sides of a body on all its interfaces: between its displacement and the vectors there, by geometry alone."""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence

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


class Sides:
    """The sides of a body on its interfaces, in the order of their entries in a vector. Its methods are not collective.

    Attributes
    ----------
    size : length of the body's vectors
    parts : by contact, the slice of its entries in a vector, and the side, 0 or 1, of the body
    began : by contact, displacements (nv, d) from which slip counts (m), of bodies that move far
    """

    def __init__(self, body: str, interfaces: Sequence[Interface]) -> None:
        self.name, self.interfaces, self.began = body, tuple(interfaces), dict[str, np.ndarray]()
        ends = np.cumsum([0, *(interface.size for interface in self.interfaces)]).tolist()
        self.size = ends[-1]
        self._sides = [
            (interface, slice(start, stop), interface.side(body))
            for interface, (start, stop) in zip(
                self.interfaces, itertools.pairwise(ends), strict=True
            )
        ]
        self.parts = {interface.name: (entries, side) for interface, entries, side in self._sides}

    def rows(self, elasticity: Elasticity) -> sparse.csr_matrix:
        """B (size, columns of A)."""
        none = sparse.csr_matrix((0, elasticity.A.size[1]))
        return sparse.vstack(
            [none, *(trace(interface, side, elasticity) for interface, _, side in self._sides)],
            format="csr",
        )

    def trace(self, u: np.ndarray) -> np.ndarray:
        """B u (size,) in metres, of a displacement (nv, d) of all nodes."""
        return np.concatenate(
            [np.empty(0), *(displacement_trace(met, side, u) for met, _, side in self._sides)]
        )

    def beside(self, u: np.ndarray) -> dict[tuple[str, int], tuple[np.ndarray, np.ndarray]]:
        """Displacements (m) that belong to no unknown, by contact and side: normal ones at the interfaces' probes, and
        tangential ones of nodes without friction."""
        return {
            (interface.name, side): (
                normal_trace(side, interface.probes, u),
                sliding_trace(interface, side, u - self.began.get(interface.name, 0.0)),
            )
            for interface, _, side in self._sides
        }

    def begin(self, began: Mapping[str, np.ndarray]) -> np.ndarray:
        """Displacement (size,) from which slip counts (m), by `began`: those (nv, d) of all nodes, by contact."""
        self.began = dict(began)
        return np.concatenate(
            [
                np.empty(0),
                *(
                    displacement_trace(met, side, self.began[met.name])
                    for met, _, side in self._sides
                ),
            ]
        )
