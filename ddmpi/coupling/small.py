"""Small bodies of one rank, multiplied together: a sparse matrix has the dense compliances of all of them."""

from __future__ import annotations

import contextlib
import itertools
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.sparse as sparse

from ddmpi.coupling.member import Member
from ddmpi.system import interrupt

SMALL, FEWEST = 60, 8
"""Bodies of at most SMALL contact unknowns are multiplied together, if a rank has FEWEST of them. A product by itself takes
about 12 µs beside its operations, which are as many as a sparse product of 100 unknowns takes 10 µs for."""


class SmallBodies:
    """The small ones of some bodies with explicit compliances.

    Parameters
    ----------
    members : all bodies of this rank
    """

    def __init__(self, members: Sequence[Member]) -> None:
        self._numbers: list[int] = []
        if len(members) >= FEWEST:
            small = [k for k, each in enumerate(members) if 0 < each.size <= SMALL and each.known]
            self._numbers = small if len(small) >= FEWEST else []
        self._members, self._aside = [members[k] for k in self._numbers], False
        ends = np.cumsum([0, *(member.size for member in self._members)])
        self._begins, self._parts = ends[:-1], [slice(*pair) for pair in itertools.pairwise(ends)]
        matrices = [member.dense() for member in self._members]
        # of a body without compliance no product is counted
        self._moves = np.array([matrix.any() for matrix in matrices], bool)
        self._C = sparse.block_diag(matrices, "csr") if matrices else None

    def mult(self, vectors: Sequence[np.ndarray], purpose: str) -> list[int]:
        """Put C x (metres) in the place of x (newtons) in the `vectors` of small bodies, out of those of all.

        Returns the numbers of these bodies. Their products are counted one by one. Not collective.
        """
        if self._aside or not self._numbers:
            return []
        interrupt.check()
        x = np.concatenate([vectors[k] for k in self._numbers])
        y = self._C @ x
        counts = self._moves & np.logical_or.reduceat(x != 0.0, self._begins)
        for member in itertools.compress(self._members, counts):
            member.C.count[purpose] += 1
        for k, part in zip(self._numbers, self._parts, strict=True):
            vectors[k][:] = y[part]
        return self._numbers

    @contextlib.contextmanager
    def aside(self) -> Iterator[None]:
        """Within this context all bodies are multiplied one by one. Not collective."""
        self._aside = True
        try:
            yield
        finally:
            self._aside = False
