"""The forces that contacts allow on rigid bodies, as cones and discs. Serial work on plain arrays."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.interface.interface import Interface

BENT = 1e-7
"""A contact is flat if its forces on the rigid motions bend by less than this fraction of them."""

DIGITS = 7
"""Directions and coefficients that agree to this many digits are equal."""

HULL = 3
"""Most dimensions in which corners of a convex hull are computed."""


class Forces(NamedTuple):
    """The forces of contacts, as rows (·, nc) of their power on the rigid motions.

    A law with a concave bound allows s_ν ≥ 0 and |s_t| ≤ g(0) + 𝓕 s_ν at most, 𝓕 = dg/ds_ν(0). These forces are sums
    of those in a cone, |s_t| ≤ 𝓕 s_ν (Coulomb), and those in a disc, |s_t| ≤ g(0) (Tresca).

    Attributes
    ----------
    bonded : (b, nc) forces of any size
    normal : (m, nc) normal forces of the cones
    slope : (m,) 𝓕 of the cones
    friction : ((d − 1) m, nc) tangential forces of the cones, node by node
    given : ((d − 1) k, nc) tangential forces of the discs, node by node
    bound : (k,) g(0) of the discs (N)
    """

    bonded: sparse.csr_matrix
    normal: sparse.csr_matrix
    slope: np.ndarray
    friction: sparse.csr_matrix
    given: sparse.csr_matrix
    bound: np.ndarray

    @classmethod
    def of(cls, interface: Interface, G: sparse.csc_matrix) -> Forces:
        """Of one contact, from the columns G (nc, size) of all its forces, of which some are not zero."""
        law, zero, d = interface.law, np.zeros(interface.m), interface.dimension
        motions = np.unique(G.indices)  # few, of two bodies
        powers, n = G[motions].toarray().T, len(motions)

        def rows(x: np.ndarray) -> sparse.csr_matrix:
            k = x.size // n
            return sparse.csr_matrix((x.ravel(), np.tile(motions, k), n * np.arange(k + 1)), (k, G.shape[0]))

        none = rows(powers[:0])
        if law.two_sided:  # forces of any sign: a basis of what they do stands for all
            _, sizes, basis = np.linalg.svd(powers, full_matrices=False)
            return cls(rows(basis[sizes > BENT * sizes.max()]), none, zero[:0], none, none, zero[:0])
        tangential, slope, bound = np.zeros((law.m, d - 1, n)), zero.copy(), zero.copy()
        tangential[law.sliding] = powers[law.m:].reshape(-1, d - 1, n)
        slope[law.sliding], bound[law.sliding] = law.slope(zero), law.slip_bound(zero)
        columns = np.concatenate([powers[:law.m, None], tangential], axis=1).reshape(law.m, -1)
        corners = _corners(columns, np.column_stack([interface.frame.reshape(law.m, -1), slope]))
        # Along a straight contact all nodes have the same tangential forces: one disc with the sum of their bounds.
        given, disc = np.unique(tangential[bound > 0.0].round(DIGITS + 2), axis=0, return_inverse=True)
        return cls(none, rows(powers[corners]), slope[corners], rows(tangential[corners]), rows(given),
                   np.bincount(disc.ravel(), bound[bound > 0.0], len(given)))

    @classmethod
    def together(cls, contacts: Sequence[Forces], n: int) -> Forces:
        """Of all `contacts`, on n rigid motions."""
        rows, numbers = sparse.csr_matrix((0, n)), np.empty(0)
        none = cls(rows, rows, numbers, rows, rows, numbers)
        return cls(*(np.concatenate(arrays) if isinstance(arrays[0], np.ndarray) else
                     sparse.vstack(arrays, format="csr") for arrays in zip(none, *contacts, strict=True)))


def _corners(x: np.ndarray, kinds: np.ndarray) -> np.ndarray:
    """The nodes whose rows of x (m, ·) are not means of those of other nodes of the same kind (m, ·).

    What a force does on a rigid motion is linear in its place. So where normals, tangents and 𝓕 are the same, as on
    a flat contact, forces at the corners of the convex hull are as good as forces at all nodes.
    """
    from scipy.spatial import ConvexHull

    corners = [np.empty(0, int)]
    # the centred rows, along their principal axes: in 0, 1 and few dimensions corners are cheap to find
    _, kind = np.unique(np.round(kinds, DIGITS), axis=0, return_inverse=True)
    order = np.argsort(kind.ravel(), kind="stable")
    for nodes in np.split(order, np.cumsum(np.bincount(kind.ravel()))[:-1]):
        away = x[nodes] - x[nodes].mean(axis=0)
        _, sizes, axes = np.linalg.svd(away, full_matrices=False)
        rank = int((sizes > BENT * np.abs(x[nodes]).max(initial=0.0)).sum())
        places = away @ axes[:rank].T
        if rank == 0:
            nodes = nodes[:1]
        elif rank == 1:
            nodes = nodes[[places.argmin(), places.argmax()]]
        elif rank <= HULL and len(nodes) > rank + 1:
            nodes = nodes[ConvexHull(places / np.abs(places).max(axis=0)).vertices]
        corners.append(nodes)
    return np.sort(np.concatenate(corners))
