"""The forces that contacts allow on rigid bodies, as programs that are free of units.

Serial work on plain arrays.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.interface import Interface
from ddmpi.interface.law import NO_BOUND

ROUNDING = 1e-9
"""Loads on rigid motions below this part of all loads on a body are what rounding leaves of none."""

LIGHTEST = 1e-3
"""Loads of a body are compared with at least this part of the largest loads of any body."""

BENT = 1e-7
"""A contact is straight or flat if what its forces do on rigid motions bends by less than this part of it."""

DIGITS = 7
"""Forces whose directions agree in so many digits are parallel."""

HULL = 3
"""Corners are looked for in at most so many dimensions."""

SAME = 1e-13
"""Columns whose difference is below this part of them are the same."""


class Scale:
    """What makes the program free of units.

    Parameters
    ----------
    speeds : of each loose body (j,), see `MotionsOfBody`
    e : (nc,) power of the loads on the motions (N, for motions in metres)
    load : (nb,) sum of the sizes of all nodal loads on each body (N), with which rounding is compared: e does not see
        loads that cancel

    Attributes
    ----------
    unit : (nc,) largest nodal velocity of each motion
    largest : loads (N) of the body that is loaded most
    of_row : (nc,) loads of the row's body (N), but not less than `LIGHTEST` of the largest
    """

    def __init__(self, speeds: Sequence[np.ndarray], e: np.ndarray, load: np.ndarray) -> None:
        numbers = [len(each) for each in speeds]
        self._starts = np.cumsum(numbers)[:-1]
        self.unit = np.concatenate(speeds)
        own = np.array([np.abs(part).max(initial=0.0) for part in self.split(e / self.unit)])
        loads = np.maximum(own, load)
        self.largest = float(loads.max())
        self.of_row = np.repeat(np.maximum(loads, LIGHTEST * self.largest), numbers)

    def idle(self, e: np.ndarray) -> bool:
        """Whether the loads e (nc,) are nothing but rounding."""
        return not self.largest or bool((np.abs(e) <= ROUNDING * self.of_row).all())

    def rows(self, G: sparse.spmatrix) -> sparse.csc_matrix:
        """G (nc, ·) for motions whose fastest node has velocity 1."""
        return sparse.csc_matrix(sparse.diags(1.0 / self.unit) @ G)

    def split(self, x: np.ndarray) -> list[np.ndarray]:
        """Parts of a vector (nc,) by body."""
        return np.split(x, self._starts)


class Program(NamedTuple):
    """The forces that contacts allow: combinations of `columns` (nc, k), each with coefficients between two (k,)."""

    columns: sparse.csc_matrix
    lower: np.ndarray
    upper: np.ndarray


@dataclass(frozen=True)
class Forces:
    """The forces that the laws allow.

    Attributes
    ----------
    program : their powers on the rigid motions, and what their coefficients lie between
    node : (k,) the column of G of the normal force of its node
    presses, leans : (k,) bool, whether it has a normal, and a tangential part
    owner : (size,) the column of G of the normal force of each column's node
    slope : (size,) of the cone of a node, at the column of its normal force; zero elsewhere
    bound : (size, c) of the friction that needs no pressure, at tangential columns, by contact that has any
    """

    program: Program
    node: np.ndarray
    presses: np.ndarray
    leans: np.ndarray
    owner: np.ndarray
    slope: np.ndarray
    bound: sparse.csr_matrix

    @classmethod
    def allowed(cls, interfaces: Sequence[Interface], A: sparse.csc_matrix, unit: float,
                inside: bool = False) -> Forces:
        """Of all interfaces; forces are counted in `unit` (N), and discs are polygons around them, or `inside` them.

        Of a flat piece with the same coefficient only the corners are needed: all nodes between are means of them.
        """
        entries: list[tuple[np.ndarray, ...]] = [(np.empty(0),) * 3]
        others: list[tuple[np.ndarray, ...]] = [(np.empty(0),) * 5]
        bounds = [sparse.csc_matrix((A.shape[1], 0))]
        owner, slope, start, k = [np.empty(0, int)], np.zeros(A.shape[1]), 0, 0
        for interface in interfaces:
            law, own = interface.law, A[:, start:start + interface.size]
            rows = np.unique(own.indices)
            for forces, lower, upper in law.edges(inside=inside):
                columns = (own[rows] @ forces).toarray()
                if np.isinf(upper).all():
                    keep = np.flatnonzero(_corners(columns, forces.T @ interface.directions))
                    lower, upper = lower[keep], upper[keep]
                else:  # forces along the same line are as good as their sum
                    keep = np.flatnonzero(np.append(True, _length(np.diff(columns)) > SAME * _length(columns[:, 1:])))
                    lower, upper = (np.add.reduceat(each, keep) / unit for each in (lower, upper))
                forces, columns = forces[:, keep], columns[:, keep]
                i, j = np.nonzero(columns)
                entries.append((columns[i, j], rows[i], k + j))
                normal, tangential = (part.getnnz(axis=0) > 0 for part in (forces[:law.m], forces[law.m:]))
                others.append((lower, upper, start + law.node[forces.indices[forces.indptr[:-1]]], normal, tangential))
                k += len(keep)
            owner.append(start + law.node)
            slope[start + law.sliding] = law.slope(np.zeros(law.m))
            bound = law.slip_bound(np.zeros(law.m))
            holds = np.flatnonzero(np.repeat((bound > 0.0) & (bound < NO_BOUND), law.components))
            if len(holds):
                bounds.append(sparse.csc_matrix((np.repeat(bound / unit, law.components)[holds], (
                    start + law.m + holds, np.zeros_like(holds))), (A.shape[1], 1)))
            start += interface.size
        value, row, column = (np.concatenate(each) for each in zip(*entries, strict=True))
        lower, upper, node, presses, leans = (np.concatenate(each) for each in zip(*others, strict=True))
        columns = sparse.csc_matrix((value, (row.astype(int), column.astype(int))), (A.shape[0], k))
        return cls(Program(columns, lower, upper), node.astype(int), presses.astype(bool), leans.astype(bool),
                   np.concatenate(owner), slope, sparse.hstack(bounds, format="csr"))

    @property
    def tangential(self) -> np.ndarray:
        """(size,) bool, the columns of G of tangential forces."""
        return self.owner != np.arange(len(self.owner))

    def sliding(self, rate: np.ndarray) -> np.ndarray:
        """(size,) how fast nodes slide, at the columns of their normal forces, from all velocities (size,) there."""
        squares = np.where(self.tangential, rate, 0.0) ** 2
        return np.sqrt(np.bincount(self.owner, squares, len(rate)))

    def edges(self, nodes: np.ndarray, rate: np.ndarray) -> sparse.csc_matrix:
        """(size, k) the edges of the cones of `nodes` (k,) that resist the sliding of `rate` (size,) most."""
        entry, place = np.flatnonzero(np.isin(self.owner, nodes)), np.searchsorted(nodes, self.owner)
        value = np.where(self.tangential, self.slope[self.owner] * self._along(rate), 1.0)
        return sparse.csc_matrix((value[entry], (entry, place[entry])), (len(rate), len(nodes)))

    def friction(self, rate: np.ndarray) -> sparse.csc_matrix:
        """(size, c) by contact the friction on its bound that resists the sliding of `rate` (size,) most."""
        return sparse.csc_matrix(sparse.diags(self._along(rate)) @ self.bound)

    def _along(self, rate: np.ndarray) -> np.ndarray:
        """(size,) the directions in which nodes slide, at the columns of tangential forces."""
        size = self.sliding(rate)[self.owner]
        return np.divide(rate, size, out=np.zeros_like(rate), where=size > 0.0)


def _corners(columns: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(k,) bool: which columns are not means of others with the same force `along` (k, d), and not zero.

    What a force does on the motions of a body is linear in its place, so means of places are means of columns.
    """
    from scipy.spatial import ConvexHull

    length = _length(columns)
    keep = np.zeros(len(length), bool)
    if not length.any():
        return keep
    _, group = np.unique(np.round(along, DIGITS), axis=0, return_inverse=True)
    order = np.argsort(group.ravel(), kind="stable")
    for members in np.split(order, np.cumsum(np.bincount(group.ravel()))[:-1]):
        x = columns[:, members] - columns[:, members].mean(axis=1, keepdims=True)
        axes, sizes, _ = np.linalg.svd(x, full_matrices=False)
        rank = int((sizes > BENT * length[members].max(initial=0.0)).sum())
        places = x.T @ axes[:, :rank]
        if rank == 0:
            members = members[:1]
        elif rank == 1:
            members = members[[places.argmin(), places.argmax()]]
        elif rank <= HULL and len(members) > rank + 1:
            members = members[ConvexHull(places / np.abs(places).max(axis=0)).vertices]
        keep[members] = True
    return keep & (length > 0.0)


def _length(columns: np.ndarray) -> np.ndarray:
    return np.linalg.norm(columns, axis=0)
