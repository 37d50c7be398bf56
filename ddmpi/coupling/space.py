"""The layout of the vectors that live on interfaces."""

from __future__ import annotations

import itertools
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from mpi4py import MPI
from scipy.sparse import csgraph

from ddmpi.interface.interface import Interface
from ddmpi.interface.laws import Laws
from ddmpi.scene.contacts import Closure
from ddmpi.scene.scene import Settled
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import concatenated, in_words, norm


class Point(NamedTuple):
    """Forces and rigid motions, with the gaps and the imbalance under them; or a change of a point, as all is linear.

        >>> point, change = Point(*np.ones((4, 1))), Point(*np.ones((4, 1)))
        >>> point.along(change, 0.5).s.tolist()
        [1.5]

    Attributes
    ----------
    s, r : (size,) forces (N) and gaps (m)
    alpha : motions of loose bodies (m)
    left : e − G s − K α, the imbalance: loads along these motions that the forces do not balance (N)
    """

    s: np.ndarray
    r: np.ndarray
    alpha: np.ndarray
    left: np.ndarray

    def along(self, change: Point, length: float) -> Point:
        """This point plus `length` times `change`."""
        return Point(*(value + length * step for value, step in zip(self, change, strict=True)))


class Space:
    """Vectors over interfaces, with the entries of one after the other; each interface of a scene is on one rank.

    Norms, sums and comparisons of such vectors are the methods below, the only places where ranks reduce. Reductions
    are in the order of the ranks and have the same result on all of them.

        >>> space = ddmpi.solve("configs/punch.toml", MPI.COMM_WORLD).solved.assembly.space
        >>> round(space.norm(np.ones(space.size)) ** 2)  # 41 nodes, each with two forces, on any number of ranks
        82

    Parameters
    ----------
    interfaces : owned by this rank, in the order of the parts
    comm : of all ranks that own interfaces
    sent : counter of reductions over several ranks and of the bytes that this rank contributes

    Attributes
    ----------
    parts : slice of a vector by name of the interface
    size : length of this rank's vectors
    petsc_comm : `comm` as PETSc takes it
    laws : of the owned interfaces, on vectors of this space
    opening : (size,) initial gaps at the normal entries (m), times their histories; zero at the tangential ones
    prescribed : (size,) contact displacements of rigid partners (m)
    gap : (size,) `opening` less `prescribed`
    """

    def __init__(
        self,
        interfaces: Sequence[Interface],
        comm: MPI.Comm = MPI.COMM_SELF,
        sent: Counter[str] | None = None,
    ) -> None:
        self.interfaces = tuple(interfaces)
        self.comm = comm
        self.sent = Counter() if sent is None else sent
        self.petsc_comm = MPI.Intracomm(comm)
        self.parts: dict[str, slice] = {}
        start = 0
        for interface in self.interfaces:
            self.parts[interface.name] = slice(start, start + interface.size)
            start += interface.size
        self.size = start
        self.laws = Laws([interface.law for interface in self.interfaces])
        self._drawn = self.interfaces
        self._place()

    def _place(self) -> None:
        self.opening = np.zeros(self.size)
        for interface, entries in self.with_slices():
            self.opening[entries][: interface.m] = interface.opening
        self.prescribed = concatenated(interface.prescribed for interface in self.interfaces)
        self.gap = self.opening - self.prescribed

    def act(self, factors: Mapping[str | None, float]) -> None:
        """Set gaps, friction and rigid partners to these `factors` by history."""
        if any(
            (interface.partner.history, interface.gap_history, interface.rub_history) != (None,) * 3
            for interface in self._drawn
        ):
            self.interfaces = tuple(interface.under(factors) for interface in self._drawn)
            self.laws = Laws([interface.law for interface in self.interfaces])
            self._place()

    def began(self, factors: Mapping[str | None, float]) -> None:
        """Note that the load step began with these factors of friction; after `act`."""
        self.interfaces = tuple(
            replace(interface, former=drawn.under(factors).law) if drawn.rub_history else interface
            for interface, drawn in zip(self.interfaces, self._drawn, strict=True)
        )

    @property
    def layers(self) -> list[Closure]:
        """The laws of soft joints."""
        return [interface.layer for interface in self.interfaces if interface.layer]

    def softness(self, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """D (size,) in m/N and b (size,) in metres of the closures D s + b of soft joints near forces s (size,)."""
        D, offset = np.zeros(self.size), np.zeros(self.size)
        for interface, entries in self.with_slices():
            rows = slice(entries.start, entries.start + interface.m)
            D[rows], offset[rows] = interface.softness(s[rows])
        return D, offset

    def stored(self, s: np.ndarray) -> float:
        """The energy (J) of all soft joints under forces s (size,). Collective."""
        stored = 0.0
        for interface, entries in self.with_slices():
            if interface.layer:
                pressure = s[entries][: interface.m] / interface.area
                stored += float(interface.layer.stored(pressure) @ interface.area)
        return float(self.add(np.array([stored]))[0])

    def with_slices(self) -> list[tuple[Interface, slice]]:
        """The interfaces with the slices of their entries in a vector."""
        return list(zip(self.interfaces, self.parts.values(), strict=True))

    def spread(self, values: Sequence[float]) -> np.ndarray:
        """A vector (size,) that is constant on each interface."""
        return np.repeat(
            np.asarray(values, float), [interface.size for interface in self.interfaces]
        )

    def least(self, x: np.ndarray) -> np.ndarray:
        """The least entry (interfaces,) of a vector (size,) on each interface; inf on those without entries."""
        least = np.full(len(self.interfaces), np.inf)
        sizes = np.array([part.stop - part.start for part in self.parts.values()], int)
        np.minimum.at(least, np.repeat(np.arange(len(sizes)), sizes), x)
        return least

    def at_nodes(self, x: np.ndarray) -> np.ndarray:
        """|v| of each node's entries of a vector (size,), for all owned nodes; independent of the tangents."""
        return concatenated(
            np.sqrt(np.bincount(interface.law.node, x[entries] ** 2, interface.m))
            for interface, entries in self.with_slices()
        )

    def norm(self, x: np.ndarray) -> float:
        """‖x‖₂ of a vector (size,) over all ranks. Collective."""
        return self.norms([x])[0]

    def norms(self, vectors: Sequence[np.ndarray]) -> list[float]:
        """`norm` of several vectors in one reduction. Collective."""
        # hypot neither overflows nor underflows, and sums in the order of the ranks.
        return [math.hypot(*entries) for entries in self._gather([norm(x) for x in vectors]).T]

    def largest(self, x: np.ndarray) -> float:
        """The largest |entry| of a vector (size,) over all ranks. Collective."""
        return float(self._gather([np.abs(x).max(initial=0.0)]).max())

    def any(self, x: np.ndarray) -> bool:
        """Whether an entry of a vector (size,) is not zero on any rank. Collective."""
        return bool(self._gather([float(np.any(x))]).any())

    def add(self, values: np.ndarray) -> np.ndarray:
        """The sum of equally long vectors over the ranks, the same on all of them. Collective."""
        values = np.asarray(
            values, float
        )  # a sum over no contacts is an integer, which MPI would misread
        if self.comm.size == 1:
            return values
        self.sent.update(reductions=1, reduced_bytes=values.nbytes)
        total = np.empty_like(values)
        self.comm.Allreduce(values, total)
        return total

    def solve_first(
        self, values: np.ndarray, solve: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """`solve` on the first rank, applied to the sum of `values` (k,) over the ranks: (k,) on all. Collective."""
        total = self.add(values)
        if self.comm.rank == 0:
            total = solve(total)
        self.comm.Bcast(total)
        return total

    def solve_joined(
        self, values: np.ndarray, solve: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        """This rank's part (k,) of `solve` on the first rank, applied to the `values` (k,) of all ranks. Collective."""
        if self.comm.size == 1:
            return solve(values)
        self.sent.update(reductions=1, reduced_bytes=values.nbytes)
        if vectors := self.comm.gather(values):
            vectors = np.split(
                solve(np.concatenate(vectors)), np.cumsum([len(values) for values in vectors])[:-1]
            )
        return self.comm.scatter(vectors)

    def gather(self, arrays: tuple) -> list[tuple] | None:
        """The `arrays` of all ranks, or other objects, on the first. Collective."""
        if self.comm.size > 1:
            self.sent.update(
                reductions=1, reduced_bytes=sum(getattr(array, "nbytes", 0) for array in arrays)
            )
        return self.comm.gather(arrays)

    def _gather(self, values: Sequence[float]) -> np.ndarray:
        """The values (ranks, k) of all ranks."""
        local = np.array(values, float)
        if self.comm.size == 1:
            return local[None]
        # gathered, not reduced by MPI, so that sums have the same bits on all ranks
        self.sent.update(reductions=1, reduced_bytes=local.nbytes)
        everyone = np.empty((self.comm.size, len(local)))
        self.comm.Allgather(local, everyone)
        return everyone


def kept_by_bonds(
    scene: Settled, joined: Mapping[str, tuple[Interface, list[str]]], world: MPI.Comm
) -> dict[str, tuple[Interface, list[str]]]:
    """The interfaces and warnings of this rank. Overlaps of paired nodes that bonds of other contacts connect, directly
    or in a chain through other bodies, are set to zero, as no force could separate them. Collective."""
    if len({contact.kind for contact in scene.contact}) < 2:
        return dict(joined)
    # A node of a body, at an end of a pair, by one number.
    first = {body.name: number << 32 for number, body in enumerate(scene.body)}
    pairs = {
        name: np.column_stack(
            [
                first[body] + nodes[transfer.indices]
                for body, nodes, transfer in zip(
                    interface.bodies, interface.rows.nodes, interface.rows.transfer, strict=True
                )
            ]
        )
        for name, (interface, _) in joined.items()
        if not interface.slave
        and not interface.on_rigid
        and all(len(move.indices) == interface.m for move in interface.rows.transfer)
    }  # no merged nodes on an axis
    # Only bonds at a node of several contacts can close a chain.
    ends, times = np.unique(concatenated(map(np.unique, pairs.values()), int), return_counts=True)
    bonds = [
        rows[np.isin(rows, ends[times > 1]).any(axis=1) & (joined[name][0].gap == 0.0)]
        for name, rows in pairs.items()
        if joined[name][0].law.name == "bonded"
    ]
    # Chains of bonds are the connected components of a graph: nodes of bodies, and bonds as edges between them.
    together = [[], *itertools.chain(*world.allgather(bonds))]
    bonded, links = np.unique(
        np.concatenate([np.ravel(rows) for rows in together]).astype(int), return_inverse=True
    )
    links = links.reshape(-1, 2)
    piece = csgraph.connected_components(
        sparse.csr_matrix((np.ones(len(links)), links.T), (len(bonded),) * 2), directed=False
    )[1]
    result = dict(joined)
    for name, rows in pairs.items():
        interface, warnings = joined[name]
        kept = (
            np.isin(rows, bonded).all(axis=1)
            & (interface.gap < 0.0)
            & (interface.law.name != "bonded")
        )
        kept[kept] = np.equal(*piece[np.searchsorted(bonded, rows[kept])].T)
        if kept.any():
            gap, at = np.where(kept, 0.0, interface.gap), in_words(interface.xy[kept][0])
            result[name] = (
                replace(interface, rows=replace(interface.rows, gap=gap)),
                [
                    *warnings,
                    Doubt(
                        f"contact.{name}: bonds of other contacts hold both sides together at {at}, so that the "
                        f"overlap of {-interface.gap[kept].min():.3g} there is left out",
                        "bonds",
                        -interface.gap[kept].min(),
                    ),
                ],
            )
    return result
