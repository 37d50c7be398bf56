"""Interface vectors between bodies during the iterations, and agreement on errors; counts what it sends."""

from __future__ import annotations

import contextlib
import itertools
import zlib
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.space import Space
from ddmpi.errors import DdmpiError, SolverError
from ddmpi.petsc.events import event
from ddmpi.system import interrupt
from ddmpi.system.agreement import agree

_PART, _OBJECT = 12, 13


class Ends(NamedTuple):
    """A contact and the ranks of its first and second body; for a rigid partner the first body's rank.

    The first body's rank owns the contact: it holds the vectors of its interface.
    """

    contact: str
    first: int
    second: int


class Exchange:
    """Carries the vectors of interfaces between the ranks that own them and the ranks of their bodies.

    A product with the joint compliance is `spread`, the local products of the bodies, and `total`. At its end all ranks
    agree on errors and signals, so that no rank waits for one that failed. They also compare the purposes of vectors,
    which reveals ranks whose iterations took different branches, as on unlike processors.

    `world` is the communicator of all bodies; `ends` are all contacts of this rank's bodies, in the order of the scene.
    `sent` counts what this rank has sent so far: messages and bytes of interface vectors; reductions over all ranks (of
    flags, scalars and coarse problems) and its reduced_bytes. Reductions within PETSc's Krylov methods are not counted.
    """

    def __init__(self, world: MPI.Comm, ends: Sequence[Ends]) -> None:
        self.world, self.ends = world, tuple(ends)
        self.sent: Counter[str] = Counter(messages=0, bytes=0, reductions=0, reduced_bytes=0)
        self._failure: DdmpiError | None = None

    def connect(self, space: Space, bodies: Sequence[Mapping[str, tuple[slice, int]]]) -> None:
        """Set the layout of vectors: of the owned interfaces by `space`; of the local `bodies` by contact, as the slice
        of the body's vector and the body's side, 0 or 1."""
        sizes = [
            max((entries.stop for entries, _ in contacts.values()), default=0)
            for contacts in bodies
        ]
        self._owned = space.size
        *starts, self._size = np.cumsum([0, *sizes]).tolist()
        self._bodies = [slice(*ends) for ends in itertools.pairwise([*starts, self._size])]
        local: list[np.ndarray] = []
        lent: dict[int, list[np.ndarray]] = {}
        borrowed: dict[int, list[np.ndarray]] = {}
        for contact, first, second in self.ends:
            places = {
                contacts[contact][1]: start + np.arange(sizes[k])[contacts[contact][0]]
                for k, (start, contacts) in enumerate(zip(starts, bodies, strict=True))
                if contact in contacts
            }
            if first != self.world.rank:
                borrowed.setdefault(first, []).append(places[1])
                continue
            entries = np.arange(space.size)[space.parts[contact]]
            local += [
                np.stack([place, entries, np.full_like(entries, side)])
                for side, place in places.items()
            ]
            if second != first:
                lent.setdefault(second, []).append(entries)
        # index arrays: of contacts within this rank, of those lent to the second body's rank, and of those borrowed
        self._local, self._at, self._side = np.hstack(
            [np.zeros((3, 0), int), *local]
        )  # rows of bodies, of owner; side
        self._lent, self._borrowed = (
            {rank: np.concatenate(arrays) for rank, arrays in indices.items()}
            for indices in (lent, borrowed)
        )

    def spread(self, x: np.ndarray) -> list[np.ndarray]:
        """A vector of each local body, from a vector `x` of the owned interfaces. Collective over neighbours."""
        whole = np.zeros(self._size)
        came = self._trade({rank: x[at] for rank, at in self._lent.items()}, self._borrowed)
        whole[self._local] = x[self._at]
        for rank, at in self._borrowed.items():
            whole[at] = came[rank]
        return [whole[entries] for entries in self._bodies]

    def collect(self, vectors: Sequence[np.ndarray], about: str) -> tuple[np.ndarray, np.ndarray]:
        """Contributions of the first and of the second bodies to the owned interfaces, from the local bodies' vectors.

        Those of the second bodies are zero where the partner is rigid. Collective on the world. Raises the error of any
        rank on all, InterruptionError after a signal to one of them, and SolverError if their purposes differ.
        """
        whole, both = np.concatenate(vectors), np.zeros((2, self._owned))
        came = self._trade({rank: whole[at] for rank, at in self._borrowed.items()}, self._lent)
        both[self._side, self._at] = whole[self._local]
        for rank, at in self._lent.items():
            both[1][at] = came[rank]
        self.meet(about)
        return both[0], both[1]

    def total(self, vectors: Sequence[np.ndarray], about: str) -> np.ndarray:
        """The sum of both bodies' contributions to the owned interfaces; otherwise as `collect`."""
        first, second = self.collect(vectors, about)
        return first + second

    def meet(self, about: str) -> None:
        """Agree on errors, signals and the purpose `about`. Collective; raises as `collect` does."""
        self._failure = self._failure or interrupt.interruption()
        if self.world.size == 1:
            if self._failure:
                agree(self.world, self._failure)
            return
        # the maxima of topic and −topic are the largest and the smallest topic: one reduction compares them
        topic = zlib.crc32(about.encode())
        words = np.array([self._failure is not None, topic, -topic], dtype=np.int64)
        self.sent.update(reductions=1, reduced_bytes=words.nbytes)
        with event("Exchange"):
            self.world.Allreduce(MPI.IN_PLACE, words, MPI.MAX)
        lost = words[1] != -words[2]
        if lost:
            self._failure = self._failure or SolverError(
                f"the ranks are at different points of the iteration, one at {about!r}; the processors may differ"
            )
        if words[0] or lost:
            agree(self.world, self._failure)

    def swap(self, mine: np.ndarray, about: str) -> tuple[np.ndarray, np.ndarray]:
        """Equally long vectors of both ranks that hold a body each, that of the first contact's first body first.

        Collective; raises as `collect`.
        """
        self.meet(about)
        _, first, second = self.ends[0]
        partner = second if self.world.rank == first else first
        theirs = self._trade({partner: mine}, {partner: mine})[partner]
        return (mine, theirs) if self.world.rank == first else (theirs, mine)

    def swap_objects(self, mine: Mapping[tuple[str, int], Any]) -> dict[str, tuple]:
        """Objects of both bodies by contact, on the ranks of both, from those of this rank by contact and side.

        For small objects during set-up and output; not counted. None for a rigid partner. Collective over neighbours.
        """
        outgoing: dict[int, dict[tuple[str, int], Any]] = {}
        for contact, first, second in self.ends:
            if first != second:
                side = int(self.world.rank == second)
                outgoing.setdefault(first if side else second, {})[contact, side] = mine[
                    contact, side
                ]
        sending = [self.world.isend(objects, rank, _OBJECT) for rank, objects in outgoing.items()]
        known = dict(mine)
        for rank in outgoing:
            known |= self.world.recv(None, rank, _OBJECT)
        MPI.Request.waitall(sending)
        return {
            contact: (known.get((contact, 0)), known.get((contact, 1))) for contact, *_ in self.ends
        }

    def told(self, mine: Mapping[str, Any]) -> dict[str, Any]:
        """By contact what its owner tells of it, on the ranks of both bodies; else as `swap_objects`."""
        known = {(name, side): mine.get(name) for name, *_ in self.ends for side in (0, 1)}
        return {name: one or other for name, (one, other) in self.swap_objects(known).items()}

    def state(self) -> dict[str, int]:
        return dict(self.sent)

    def restore(self, state: dict[str, int]) -> None:
        for name in self.sent:  # in place, as `Space` counts in it, too
            self.sent[name] = int(state[name])

    @contextlib.contextmanager
    def deferred(self) -> Iterator[None]:
        """Run local work; an error in it is kept and raised on all ranks at the next exchange."""
        try:
            yield
        except DdmpiError as error:
            if error.agreed:
                raise
            self._failure = error

    def _trade(
        self, send: Mapping[int, np.ndarray], like: Mapping[int, np.ndarray]
    ) -> dict[int, np.ndarray]:
        """Send vectors to ranks, and receive vectors of the lengths of `like` from others."""
        if not (send or like):
            return {}
        came = {rank: np.empty(len(vector)) for rank, vector in like.items()}
        with event("Exchange"):
            # receives first, so that messages find their buffers
            requests = [self.world.Irecv(vector, rank, _PART) for rank, vector in came.items()]
            requests += [self.world.Isend(vector, rank, _PART) for rank, vector in send.items()]
            MPI.Request.Waitall(requests)
        self.sent.update(messages=len(send), bytes=sum(vector.nbytes for vector in send.values()))
        return came
