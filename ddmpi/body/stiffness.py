"""The stiffness of one body in 2 × 2 blocks, summed over its triangles without an intermediate matrix.

The blocks of an element follow from the gradients of its barycentric coordinates by the tables of `elements`, those of
curved triangles by quadrature.
As K is symmetric, a pair of nodes is stored once, the lower node first. Sums go straight to their places,
and the rows of the matrix come out sorted. Every step takes time in proportion to the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.body.stress import Composite, of_part
from ddmpi.mesh.elements import TRIANGLE
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import Material

CHUNK = 4096
"""Triangles that are worked on at a time, so that their data stay in the processor's cache."""


@dataclass(frozen=True)
class Stiffness:
    """K of a body with all dofs free, by pairs of nodes.

    Attributes
    ----------
    first, second : (ne,) nodes of the pairs that share a triangle, first < second, in lexical order
    upper : (ne, 2, 2) the block of row `first` and column `second` (N/m per metre of depth)
    diagonal : (nv, 2, 2) the blocks of the nodes themselves
    """

    first: np.ndarray
    second: np.ndarray
    upper: np.ndarray
    diagonal: np.ndarray

    def mult(self, u: np.ndarray) -> np.ndarray:
        """K u (nv, 2) in newtons; cheap if few nodes move."""
        moves = u.any(axis=1)
        y = np.zeros_like(u)
        y[moves] = np.einsum("nij,nj->ni", self.diagonal[moves], u[moves])
        pairs = np.flatnonzero(moves[self.first] | moves[self.second])
        a, b, block = self.first[pairs], self.second[pairs], self.upper[pairs]
        np.add.at(y, a, np.einsum("nij,nj->ni", block, u[b]))
        np.add.at(y, b, np.einsum("nji,nj->ni", block, u[a]))
        return y

    def connected(self) -> tuple[int, np.ndarray]:
        """The number of connected pieces of the body, and for each node (nv,) the number of its piece."""
        number, piece = csgraph.connected_components(self._links(np.empty(0, int)), directed=False)
        return number - 1, piece[:-1]

    def steps(self, nodes: np.ndarray) -> np.ndarray:
        """How many pairs lie between each node (nv,) and the nearest of `nodes`; nv where nothing connects them."""
        size = len(self.diagonal)
        order, before = csgraph.breadth_first_order(self._links(nodes), size, directed=False)
        place = np.empty(size + 1, dtype=int)
        place[order] = np.arange(len(order))
        parents, ends = place[before[order[1:]]], [0, 1]  # the parents ascend; a step ends with the last one's children
        while ends[-1] < len(order):
            ends.append(1 + int(np.searchsorted(parents, ends[-1])))
        found = np.full(size + 1, size)
        found[order] = np.repeat(np.arange(len(ends) - 1), np.diff(ends)) - 1
        return found[:-1]

    def _links(self, nodes: np.ndarray) -> sparse.csr_matrix:
        """The graph (nv + 1, nv + 1) of the pairs, with one more node that is linked to `nodes`."""
        size = len(self.diagonal)
        indptr = np.concatenate([[0], np.cumsum(np.bincount(self.first, minlength=size))])
        second = np.concatenate([self.second, nodes])
        return sparse.csr_matrix((np.ones(len(second)), second, np.append(indptr, len(second))), (size + 1, size + 1))

    def to_csr(self, free: np.ndarray, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """The rows and columns of some nodes, as sorted CSR arrays.

        Parameters
        ----------
        free : (nv, 2) bool; if one component of a node is held, it is decoupled and keeps its diagonal entry
        nodes : (k,) in the order of the rows

        Returns
        -------
        indptr, indices, data of the (2k, 2k) matrix
        """
        loose, size = free[nodes], len(nodes)
        place = np.full(len(free), -1, dtype=np.int32)
        place[nodes] = np.arange(size)
        inside = (place[self.first] >= 0) & (place[self.second] >= 0)
        a, b = place[self.first[inside]], place[self.second[inside]]
        upper, diagonal = self.upper[inside], self.diagonal[nodes]
        if (nodes[1:] < nodes[:-1]).any():  # pairs as they are in the mesh's order have to be sorted again
            turned = a > b
            a, b = np.where(turned, b, a), np.where(turned, a, b)
            upper[turned] = upper[turned].swapaxes(1, 2)
            order = sort_stably(b, size)
            order = order[sort_stably(a[order], size)]
            a, b, upper = a[order], b[order], upper[order]
        if not loose.all():
            upper *= loose[a][:, :, None] & loose[b][:, None, :]
            diagonal *= (loose[:, :, None] & loose[:, None, :]) | np.eye(2, dtype=bool)

        after, before = np.bincount(a, minlength=size), np.bincount(b, minlength=size)
        count = before + 1 + after
        start = np.concatenate([[0], np.cumsum(count)])
        columns = np.empty(2 * start[-1], dtype=np.int32)  # one for each two entries
        data = np.empty((len(columns), 2))

        def put(rows: np.ndarray, rank: np.ndarray, column: np.ndarray, blocks: np.ndarray) -> None:
            at = 2 * start[rows] + rank
            for i in (0, 1):
                columns[at] = column
                data[at] = blocks[:, i]
                at += count[rows]

        own = np.arange(size)
        put(own, before, own, diagonal)
        numbers = np.arange(len(a))
        put(a, before[a] + 1 + numbers - (np.cumsum(after) - after)[a], b, upper)
        lower = sort_stably(b, size)
        row = b[lower]
        put(row, numbers - (np.cumsum(before) - before)[row], a[lower], upper[lower].swapaxes(1, 2))
        indptr = np.append(np.column_stack([4 * start[:-1], 4 * start[:-1] + 2 * count]).ravel(), 4 * start[-1])
        return indptr, (2 * columns[:, None] + np.array([0, 1], np.int32)).ravel(), data.ravel()


def sum_stiffness(mesh: Mesh, material: Material | Composite) -> Stiffness:
    """The stiffness of a body of this mesh and material. Not collective."""
    weights = mesh.element.stiffness_weights()
    k, size, nodes = len(weights), len(mesh.points), mesh.triangles
    i, j = np.array([(i, i) for i in range(k)]
                    + [(i, j) for i in range(k) for j in range(i + 1, k) if weights[i, j].any()]).T
    own, pairs = slice(k), slice(k, None)
    entries = _element_entries(mesh, material, weights[i, j])
    one, two = nodes[:, i[pairs]].T.ravel(), nodes[:, j[pairs]].T.ravel()
    xx, yy, xy, yx = (each[pairs].ravel() for each in entries)
    if len(mesh.curved):  # where pairs without an entry in straight triangles have one, too
        rest = np.array([(a, b) for a in range(k) for b in range(a + 1, k) if not weights[a, b].any()]).T
        bent = _curved_entries(mesh, material, *np.hstack([[i, j], rest]))
        entries[:, :, mesh.curved] = bent[:, :len(i)]
        one, two = (np.append(each, nodes[mesh.curved][:, ends].T) for each, ends in zip((one, two), rest, strict=True))
        xx, yy, xy, yx = (np.append(each[pairs], more[len(i):]) for each, more in zip(entries, bent, strict=True))

    turned = one > two
    low, high = np.where(turned, two, one), np.where(turned, one, two)
    order = sort_stably(high, size)
    order = order[sort_stably(low[order], size)]
    low, high = low[order], high[order]
    new = np.concatenate([[True], (low[1:] != low[:-1]) | (high[1:] != high[:-1])])
    first, second = low[new], high[new]
    pair = np.empty(len(order), dtype=np.int64)
    pair[order] = np.cumsum(new) - 1

    diagonal, upper = np.empty((size, 2, 2)), np.empty((len(first), 2, 2))
    node = nodes[:, i[own]].T.ravel()
    for (r, c), values in {(0, 0): entries[0], (1, 1): entries[1], (0, 1): entries[2]}.items():
        diagonal[:, r, c] = diagonal[:, c, r] = np.bincount(node, values[own].ravel(), size)
    for (r, c), values in {(0, 0): xx, (1, 1): yy,
                           (0, 1): np.where(turned, yx, xy), (1, 0): np.where(turned, xy, yx)}.items():
        upper[:, r, c] = np.bincount(pair, values, len(first))
    return Stiffness(first, second, upper, diagonal)


def forces_at(mesh: Mesh, material: Material | Composite, u: np.ndarray, nodes: np.ndarray) -> np.ndarray:
    """K u (k, 2) in newtons at a few `nodes` (k,), for a displacement u (nv, 2) in metres. Not collective."""
    near = np.isin(mesh.triangles, nodes).any(axis=1)
    if isinstance(material, Composite):
        material = Composite(material.materials, material.number[near])
    return sum_stiffness(Mesh(mesh.points, mesh.triangles[near], {}), material).mult(u)[nodes]


def _element_entries(mesh: Mesh, material: Material | Composite, weights: np.ndarray) -> np.ndarray:
    """Entries xx, yy, xy, yx of the blocks of p pairs of nodes in all triangles, (4, p, nt).

    The blocks are `weights` (p, 3, 3) times those of the corners a, b as a linear triangle has them,
    |T| (λ g_a g_bᵀ + μ g_b g_aᵀ + μ (g_a · g_b) I) with g_a = ∇λ_a.
    """
    weights = weights.reshape(-1, 9)
    used = np.flatnonzero(weights.any(axis=0))
    one, two = np.divmod(used, 3)
    weights = weights[:, used]
    entries = np.empty((4, len(weights), len(mesh.triangles)))
    for start in range(0, len(mesh.triangles), CHUNK):
        part = slice(start, start + CHUNK)
        corners = mesh.points[mesh.triangles[part, :3].T].transpose(2, 0, 1)  # (2, 3, chunk)
        side = corners[:, [2, 0, 1]] - corners[:, [1, 2, 0]]  # opposite each corner
        doubled = side[0, 0] * side[1, 1] - side[1, 0] * side[0, 1]
        x, y = np.stack([-side[1], side[0]]) / np.sqrt(2 * doubled)  # ∇λ √|T|
        xx, yy, xy, yx = x[one] * x[two], y[one] * y[two], x[one] * y[two], y[one] * x[two]
        for entry, block in zip(entries, _blocks(of_part(material, part), xx, yy, xy, yx), strict=True):
            entry[:, part] = weights @ block
    return entries


def _curved_entries(mesh: Mesh, material: Material | Composite, i: np.ndarray, j: np.ndarray) -> np.ndarray:
    """Entries xx, yy, xy, yx of the blocks of pairs i, j (p,) of nodes in the curved triangles, (4, p, nc)."""
    found = []
    for cells in mesh.curved_blocks():
        mapped = mesh.map(cells)
        x, y = mapped.slopes * np.sqrt(TRIANGLE[1][:, None] * mapped.areas)[:, None]  # of which products are summed
        products = (np.einsum("qpt,qpt->pt", one[:, i], two[:, j]) for one, two in ((x, x), (y, y), (x, y), (y, x)))
        found.append(_blocks(of_part(material, cells), *products))
    return np.concatenate(found, axis=2)


def _blocks(material: Material | Composite, xx: np.ndarray, yy: np.ndarray, xy: np.ndarray, yx: np.ndarray) -> tuple:
    """Entries xx, yy, xy, yx of λ g hᵀ + μ h gᵀ + μ (g · h) I by those of the products g hᵀ."""
    first, shear = material.lame
    return ((first + 2 * shear) * xx + shear * yy, (first + 2 * shear) * yy + shear * xx,
            first * xy + shear * yx, first * yx + shear * xy)


def sort_stably(keys: np.ndarray, size: int) -> np.ndarray:
    """The permutation that sorts integers in [0, size) and keeps the order of equals, in linear time."""
    table = sparse.csr_matrix((np.zeros(len(keys), bool), keys, np.arange(len(keys) + 1)), (len(keys), size))
    return table.tocsc().indices
