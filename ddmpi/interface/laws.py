"""The laws of several interfaces as one, on vectors with the entries of one interface after the other."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.law import ActiveSet, Law, Tangent
from ddmpi.sets import Box, Discs, product


class Kind(NamedTuple):
    """The laws of one class as one law, and where its parts are among those of all laws.

    Attributes
    ----------
    law : of all their nodes
    entries : (law.size,) of a vector
    nodes, sliding : (law.m,) and (mt,) numbers of its nodes, and of those that slide
    """

    law: Law
    entries: np.ndarray
    nodes: np.ndarray
    sliding: np.ndarray


class Laws:
    """Laws of interfaces as one.

    Attributes
    ----------
    laws : one for each interface; without interfaces an empty one
    kinds : the same by their classes, so that a thousand contacts cost as much as one
    size, m : entries of a vector, and nodes
    """

    def __init__(self, laws: Sequence[Law]) -> None:
        self.laws = tuple(laws) or (Law(0, np.empty(0, int), 1),)
        sizes = np.array([(law.size, law.m, len(law.sliding)) for law in self.laws])
        self.size, self.m, self._sliders = sizes.sum(axis=0).tolist()
        begins = np.cumsum(sizes, axis=0) - sizes
        self._parts, self._sliding = (
            [slice(*ends) for ends in zip(begins[:, k], begins[:, k] + sizes[:, k], strict=True)]
            for k in (0, 2)
        )
        numbers: dict[tuple, list[int]] = {}
        for number, law in enumerate(self.laws):
            of_class = type(law), law.components, len(law.sliding) > 0
            numbers.setdefault(of_class, []).append(number)
        self.kinds = tuple(self._kind(alike, begins[alike]) for alike in numbers.values())

    def _kind(self, numbers: list[int], begins: np.ndarray) -> Kind:
        """The laws with these numbers, whose entries, nodes and sliding nodes begin at `begins` (k, 3)."""
        laws = [self.laws[number] for number in numbers]
        law = laws[0].joined(laws)
        m, mt = np.transpose([(each.m, len(each.sliding)) for each in laws])
        entry, node, sliding = begins.T
        tangential = _ranges(entry + m, mt * law.components)
        entries = np.concatenate([_ranges(entry, m), tangential])
        return Kind(law, entries, _ranges(node, m), _ranges(sliding, mt))

    @property
    def largest_slope(self) -> float:
        return max(kind.law.largest_slope for kind in self.kinds)

    def parts(self, x: np.ndarray) -> list[tuple[Law, np.ndarray]]:
        """The laws with their interfaces' entries of a vector (size,)."""
        return [(law, x[entries]) for law, entries in zip(self.laws, self._parts, strict=True)]

    def bounds(self, bound: np.ndarray) -> list[np.ndarray]:
        """The slip bounds of each interface, out of those of all sliding nodes."""
        return [bound[entries] for entries in self._sliding]

    def project(self, q: np.ndarray) -> np.ndarray:
        """The forces (size,) that the laws assign to q = s − c r."""
        s = np.empty(self.size)
        for kind in self.kinds:
            s[kind.entries] = kind.law.project(q[kind.entries])
        return s

    def active_sets(self, q: np.ndarray) -> list[ActiveSet]:
        """Which nodes of each kind are closed and which slip at q = s − c r (size,)."""
        return [kind.law.active_set(q[kind.entries]) for kind in self.kinds]

    def sticking(self, closed: np.ndarray, falls: np.ndarray | None = None) -> list[ActiveSet]:
        """Active sets with the nodes `closed` (m,) closed and sticking, unless they fall, and all others open."""
        falls = np.zeros_like(closed) if falls is None else falls
        return [kind.law.sticking(closed[kind.nodes], falls[kind.nodes]) for kind in self.kinds]

    def linearise(self, active: Sequence[ActiveSet]) -> Tangent:
        """The tangent of all laws at the active sets of each kind."""
        tangents = [kind.law.linearise(each) for kind, each in zip(self.kinds, active, strict=True)]
        unknown, source = np.empty(self.size, bool), np.empty(self.size, int)
        coupling, given, spring = np.empty((3, self.size))
        for (_, entries, *_), tangent in zip(self.kinds, tangents, strict=True):
            unknown[entries], source[entries] = tangent.unknown, entries[tangent.source]
            coupling[entries], given[entries] = tangent.coupling, tangent.given
            spring[entries] = tangent.spring
        return Tangent(unknown, source, coupling, given, spring, self._turned(tangents))

    def _turned(self, tangents: Sequence[Tangent]) -> sparse.csr_matrix | None:
        """The frames (size, size) of the tangents of each kind; None where none is turned."""
        if all(tangent.turn is None for tangent in tangents):
            return None
        rows, columns, values = [], [], []
        for (law, entries, *_), tangent in zip(self.kinds, tangents, strict=True):
            turn = sparse.identity(law.size) if tangent.turn is None else tangent.turn
            turn = turn.tocoo()
            rows.append(entries[turn.row])
            columns.append(entries[turn.col])
            values.append(turn.data)
        places = np.concatenate(rows), np.concatenate(columns)
        return sparse.csr_matrix((np.concatenate(values), places), (self.size, self.size))

    def settle(self, s: np.ndarray, active: Sequence[ActiveSet]) -> np.ndarray:
        """The forces (size,) next to s that obey all bounds exactly, given the active sets of each kind."""
        settled = np.empty(self.size)
        for kind, each in zip(self.kinds, active, strict=True):
            settled[kind.entries] = kind.law.settle(s[kind.entries], each)
        return settled

    def bound_at(self, s: np.ndarray) -> np.ndarray:
        """The slip bounds of all sliding nodes under the forces s (size,), in newtons."""
        bound = np.empty(self._sliders)
        for kind in self.kinds:
            bound[kind.sliding] = kind.law.bound_at(s[kind.entries])
        return bound

    def cone(self, bound: np.ndarray) -> Box | Discs:
        """The forces that are allowed while the slip bounds of all sliding nodes stay `bound`."""
        return product(
            [law.cone(limits) for law, limits in zip(self.laws, self.bounds(bound), strict=True)]
        )


def _ranges(begins: np.ndarray, sizes: np.ndarray) -> np.ndarray:
    """The numbers from each of `begins` (k,) on, as many as `sizes` (k,) says."""
    shifts = begins - (np.cumsum(sizes) - sizes)
    return np.arange(sizes.sum()) + np.repeat(shifts, sizes)
