"""The recovered stress: polynomials fitted around the vertices of a body to the stress at samples in the cells.

Around every vertex a polynomial of the degree of the displacement is fitted (superconvergent patch recovery; Zienkiewicz
and Zhu, Int. J. Numer. Meth. Engng. 33, 1992). At the boundary polynomials are those of the inner vertices beside: a fit
to the few cells there would follow their errors. All of that is linear in the stress, and depends on the mesh alone.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterable, Iterator
from math import comb
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.stress import STRAIGHT_BLOCK
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import Mesh

SOLVABLE = 1e-5
"""Least eigenvalue of a patch's normal equations, relative to its number of samples, for a fit of full degree."""

EDGES = 2
"""How many edges away a vertex of the boundary borrows polynomials at most."""


class Vertices(NamedTuple):
    """The m vertices of a body.

    Attributes
    ----------
    number : (m,) of the nodes
    corners : (nt, c) the numbers of the cells' vertices among these m
    at, reach : (m, d) and (m,) places of the vertices and sizes of the cells around them (m)
    order : of the polynomials, in distances from the vertices over `reach`
    """

    number: np.ndarray
    corners: np.ndarray
    at: np.ndarray
    reach: np.ndarray
    order: int

    def monomials(self, vertex: np.ndarray, places: np.ndarray) -> np.ndarray:
        """The terms (k, …, t) of the polynomials of vertices (t,) at places (d, …, t)."""
        centre = self.at[vertex].T.reshape(len(places), *[1] * (places.ndim - 2), -1)
        return _monomials((places - centre) / self.reach[vertex], self.order)


class Recovery(NamedTuple):
    """The recovered stress (Pa) of a body with nv nodes.

    Attributes
    ----------
    nodes : (n, nv) its components at the nodes
    fits : (k, n, m) of the polynomials around the `vertices`, of k terms
    """

    nodes: np.ndarray
    fits: np.ndarray
    vertices: Vertices

    def around(self, vertex: np.ndarray, places: np.ndarray) -> np.ndarray:
        """The polynomials (n, …, t) of vertices (t,) at places (d, …, t)."""
        p = self.vertices.monomials(vertex, places)
        return np.einsum("k...t,knt->n...t", p, np.take(self.fits, vertex, axis=2))


class Patches(NamedTuple):
    """What makes polynomials of k terms of the stress at q samples in each cell of a body.

    Attributes
    ----------
    vertices : around which they are
    weights : of all vertices in their order, k matrices (·, nt q), by cell and sample
    borrowed : one after the other, numbers (j,) of vertices and the matrix (j k, m k) of their terms from those of others
    at_nodes : (nv, m k) values at the nodes from the terms
    """

    vertices: Vertices
    weights: Iterable[list[sparse.csr_matrix]]
    borrowed: list[tuple[np.ndarray, sparse.bsr_matrix]]
    at_nodes: sparse.csr_matrix

    def recover(self, sampled: np.ndarray) -> Recovery:
        """The recovered stress from that (n, q, nt) at the samples (Pa). Not collective."""
        n, m = len(sampled), len(self.vertices.at)
        values = np.ascontiguousarray(sampled.transpose(2, 1, 0).reshape(-1, n))
        fits, done = np.empty((m, self.at_nodes.shape[1] // m, n)), 0
        for terms in self.weights:
            some = slice(done, done + terms[0].shape[0])
            fits[some], done = np.stack([each @ values for each in terms], axis=1), some.stop
        for vertex, means in self.borrowed:
            fits[vertex] = (means @ fits.reshape(-1, n)).reshape(-1, *fits.shape[1:])
        nodes = self.at_nodes @ fits.reshape(-1, n)
        return Recovery(nodes.T, np.ascontiguousarray(fits.transpose(1, 2, 0)), self.vertices)


def patches_of(mesh: Mesh, keep: bool = True) -> Patches:
    """The patches of a mesh, found once; or for one recovery, which then takes less memory. Cells of several materials
    must have no node in common. Not collective."""
    return mesh.once(_kept) if keep else _patches(mesh.home)


def _kept(mesh: Mesh) -> Patches:
    found = _patches(mesh)
    return found._replace(weights=list(found.weights))


def _patches(mesh: Mesh) -> Patches:
    """Polynomials are fitted or, at the boundary, `_borrowed`; at middle nodes they are the mean of those of both
    corners."""
    is_vertex = np.zeros(len(mesh.points), bool)
    is_vertex[mesh.corners] = True
    number, corners = np.flatnonzero(is_vertex), (np.cumsum(is_vertex) - 1)[mesh.corners]
    at, ends = mesh.points[number], np.arange(0, corners.size + 1, corners.shape[1])
    vertices_of = sparse.csr_matrix((np.ones(corners.size), corners.ravel(), ends))  # (nt, m)
    around = vertices_of.T.tocsr()
    # Coordinates relative to the vertex, over the size of its cells, keep the normal equations well conditioned.
    sizes = np.linalg.norm(np.ptp(np.take(at.T, corners.T, axis=1), axis=1), axis=0)
    reach = np.maximum.reduceat(sizes[around.indices], around.indptr[:-1])
    vertices = Vertices(number, corners, at, reach, mesh.order)
    outer = np.searchsorted(number, np.unique(mesh.boundary[0][:, : mesh.cell.facet.corners]))
    near = around[outer] @ vertices_of  # (j, m), those at the boundary with all that share cells
    # At the boundary cells count as often as they are around the vertex or one beside it.
    ends = np.zeros(1 + len(at), near.indptr.dtype)
    ends[1 + outer] = np.diff(near.indptr)
    beside = sparse.csr_matrix((np.ones(near.nnz), near.indices, ends.cumsum()), (len(at),) * 2)
    points = CELLS[mesh.dimension, mesh.order].nodes[:, 1:]
    return Patches(
        vertices,
        _fitted(vertices, around + beside @ around, sample_places(mesh)),
        [*_borrowed(vertices, near, outer, points)],
        _at_nodes(mesh, vertices),
    )


def sample_places(mesh: Mesh) -> np.ndarray:
    """The places (d, q, nt) of the samples of all cells (m)."""
    samples = mesh.cell.samples[0]
    places = samples @ np.take(mesh.points.T, mesh.corners.T, axis=1)
    for bent in mesh.summed_blocks():
        places[..., bent] = mesh.map(bent, samples).places.transpose(2, 0, 1)
    return places


def _fitted(
    vertices: Vertices, patches: sparse.csr_matrix, places: np.ndarray
) -> Iterator[list[sparse.csr_matrix]]:
    """`Patches.weights` of samples at `places` (d, q, nt) in fits to the `patches` (m, nt)."""
    d, q, _ = places.shape
    ends = np.arange(0, patches.nnz + STRAIGHT_BLOCK, STRAIGHT_BLOCK)
    ends = np.unique(np.searchsorted(patches.indptr, ends).clip(max=len(vertices.at)))
    for first, last in itertools.pairwise(ends):
        some = patches[first:last]
        vertex = first + np.repeat(np.arange(last - first), np.diff(some.indptr))
        p = vertices.monomials(vertex, np.take(places, some.indices, axis=2))
        columns = (q * some.indices[:, None] + np.arange(q, dtype=some.indices.dtype)).ravel()
        shape = last - first, q * patches.shape[1]
        yield [
            sparse.csr_matrix((weights.T.ravel(), columns, q * some.indptr), shape)
            for weights in _fits(p, some, d + 1)
        ]


def _fits(p: np.ndarray, patches: sparse.csr_matrix, first: int) -> np.ndarray:
    """The weights (k, q, i) in polynomials fitted to samples in the i cells in the rows of `patches` (j, nt), with
    monomials p (k, q, i). With too few samples they are linear, with `first` terms, or the mean."""
    k, starts = len(p), patches.indptr[:-1]
    M, weighted = np.empty((len(starts), k, k)), patches.data * p
    for a in range(k):
        for b in range(a, k):
            M[:, a, b] = M[:, b, a] = np.add.reduceat((weighted[a] * p[b]).sum(axis=0), starts)
    inverse, left = np.zeros_like(M), np.arange(len(starts))
    for terms in (k, first, 1):
        posed = _well_posed(M[left, :terms, :terms])
        solvable, left = left[posed], left[~posed]
        inverse[solvable, :terms, :terms] = np.linalg.inv(M[solvable, :terms, :terms])
        if not len(left):
            break
    of_cells = np.repeat(inverse.transpose(1, 2, 0), np.diff(patches.indptr), axis=2)
    return np.einsum("abi,bqi->aqi", of_cells, weighted)


def _well_posed(M: np.ndarray) -> np.ndarray:
    """Whether there are enough samples around a vertex (j,) for its normal equations (j, k, k)."""
    return np.linalg.eigvalsh(M)[:, 0] > SOLVABLE * M[:, 0, 0]


def _borrowed(
    vertices: Vertices, near: sparse.csr_matrix, lonely: np.ndarray, points: np.ndarray
) -> Iterator[tuple[np.ndarray, sparse.bsr_matrix]]:
    """`Patches.borrowed` by `lonely` vertices (j,): the mean of the polynomials of the others `near` them (j, m), with
    which they share cells.

    With few cells, all on one side, a fit follows their errors. First those beside others borrow, then those beside
    these, as at corners of one cell. Where there are none, as in walls of one element, fits stay. A polynomial is known
    by its values at as many `points` (·, d) as it has terms.
    """
    inverse = np.linalg.inv(_monomials(points.T, vertices.order).T)
    k, others = len(inverse), np.ones(len(vertices.at), bool)
    others[lonely] = False
    borrower, lender = np.repeat(lonely, np.diff(near.indptr)), near.indices
    for _ in range(EDGES):
        lends = others[lender] & ~others[borrower]
        to, by = borrower[lends], lender[lends]
        some, starts, counts = np.unique(to, return_index=True, return_counts=True)
        if not len(some):
            return
        places = vertices.at[to].T[:, None] + vertices.reach[to] * points.T[:, :, None]
        values = vertices.monomials(by, places)
        means = np.einsum("kq,jqt->tkj", inverse, values / np.repeat(counts, counts))
        matrix = sparse.bsr_matrix(
            (means, by, np.append(starts, len(by))), shape=(k * len(some), k * len(others))
        )
        yield some, matrix
        others[some] = True


def _at_nodes(mesh: Mesh, vertices: Vertices) -> sparse.csr_matrix:
    """`Patches.at_nodes`."""
    d, order, m = mesh.dimension, vertices.order, len(vertices.at)
    k = comb(d + order, d)
    rows, columns, values = [vertices.number], [k * np.arange(m)], [np.ones(m)]
    middles, where = np.unique(mesh.triangles[:, mesh.cell.corners :].T, return_index=True)
    between, cell = np.divmod(where, len(mesh.triangles))
    for ends in np.array(mesh.cell.between, int)[between].T if len(middles) else ():
        vertex = vertices.corners[cell, ends]
        rows += [np.tile(middles, k)]
        columns += [(k * vertex + np.arange(k)[:, None]).ravel()]
        values += [vertices.monomials(vertex, mesh.points[middles].T).ravel() / order]
    entries = np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))
    return sparse.csr_matrix(entries, (len(mesh.points), k * m))


def _monomials(x: np.ndarray, order: int) -> np.ndarray:
    """All monomials (k, …) up to the order at the points x (d, …)."""
    factors = (
        chosen for k in range(order) for chosen in itertools.combinations_with_replacement(x, k + 1)
    )
    return np.stack(
        [np.ones_like(x[0]), *(functools.reduce(np.multiply, chosen) for chosen in factors)]
    )
