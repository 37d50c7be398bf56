"""The stiffness of one body in d × d blocks, summed over its cells without an intermediate matrix.

The blocks of a cell follow from the gradients of its barycentric coordinates by the tables of `elements`, those of
curved cells by quadrature. As K is symmetric, a pair of nodes is stored once, the lower node first. Every step takes
time in proportion to the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.body.stress import Composite, elastic, modes_of, portions
from ddmpi.mesh.elements import invert
from ddmpi.mesh.mesh import Mesh, tangents
from ddmpi.scene.bodies import Material
from ddmpi.system.numbers import ROUNDING, is_touched


@dataclass(frozen=True)
class Stiffness:
    """K of a body with all dofs free, by pairs of nodes.

    Attributes
    ----------
    first, second : (ne,) nodes of the pairs that share a cell, first < second, in lexical order
    upper : (ne, d, d) the block of row `first` and column `second` (N/m per metre of depth)
    diagonal : (nv, d, d) the blocks of the nodes themselves
    """

    first: np.ndarray
    second: np.ndarray
    upper: np.ndarray
    diagonal: np.ndarray

    def mult(self, u: np.ndarray) -> np.ndarray:
        """K u (nv, d) in newtons; cheap if few nodes move."""
        moves = u.any(axis=1)
        y = np.zeros_like(u)
        y[moves] = np.einsum("nij,nj->ni", self.diagonal[moves], u[moves])
        pairs = np.flatnonzero(moves[self.first] | moves[self.second])
        a, b, block = self.first[pairs], self.second[pairs], self.upper[pairs]
        np.add.at(y, a, np.einsum("nij,nj->ni", block, u[b]))
        np.add.at(y, b, np.einsum("nji,nj->ni", block, u[a]))
        return y

    def rows(self, nodes: np.ndarray) -> sparse.csr_matrix:
        """The rows (d k, d nv) of some `nodes` (k,) in N/m."""
        size, d = self.diagonal.shape[:2]
        place = np.full(size, -1)
        place[nodes] = np.arange(len(nodes))
        one, two = (np.flatnonzero(place[ends] >= 0) for ends in (self.first, self.second))
        blocks = np.concatenate(
            [self.diagonal[nodes], self.upper[one], self.upper[two].swapaxes(1, 2)]
        )
        row = d * place[np.concatenate([nodes, self.first[one], self.second[two]])]
        column = d * np.concatenate([nodes, self.second[one], self.first[two]])
        at = np.broadcast_arrays(
            row[:, None, None] + np.arange(d)[:, None], column[:, None, None] + np.arange(d)
        )
        return sparse.csr_matrix(
            (blocks.ravel(), tuple(k.ravel() for k in at)), (d * len(nodes), d * size)
        )

    def connected(self) -> tuple[int, np.ndarray]:
        """The number of connected pieces of the body, and for each node (nv,) the number of its piece."""
        size = len(self.diagonal)
        indptr = np.concatenate([[0], np.cumsum(np.bincount(self.first, minlength=size))])
        pairs = sparse.csr_matrix((np.ones(len(self.second)), self.second, indptr), (size, size))
        return csgraph.connected_components(pairs, directed=False)

    def to_csr(
        self, free: np.ndarray, nodes: np.ndarray, springs: sparse.csr_matrix | None = None
    ) -> sparse.csr_matrix:
        """The rows and columns (d k, d k) of some `nodes` (k,), sorted, plus QᵀQ (N/m) of springs Q (r, d nv).

        Clamped directions, outside of the range of `free` (nv, d, d), are decoupled and keep their diagonal entries.
        """
        loose, (size, d) = free[nodes], (len(nodes), free.shape[1])
        place = np.full(len(free), -1, dtype=np.int32)
        place[nodes] = np.arange(size, dtype=np.int32)
        inside = (place[self.first] >= 0) & (place[self.second] >= 0)
        a, b, diagonals = (
            place[self.first[inside]],
            place[self.second[inside]],
            np.arange(size, dtype=np.int32),
        )
        upper, diagonal = self.upper[inside], self.diagonal[nodes]
        clamped = is_touched(loose)
        pairs = clamped[a] | clamped[b]
        upper[pairs] = loose[a[pairs]] @ upper[pairs] @ loose[b[pairs]]
        P, Q, D = loose[clamped], np.eye(d) - loose[clamped], diagonal[clamped]
        # P D P along the free directions; across them any positive block does, here of the size of the diagonal.
        total = P @ D @ P + Q @ (D * np.eye(d)) @ Q
        diagonal[clamped] = 0.5 * (total + total.swapaxes(1, 2))
        ends = np.concatenate([diagonals, a, b]), np.concatenate([diagonals, b, a])
        order = sparse.csr_matrix(
            (np.arange(len(ends[0]), dtype=np.int32), ends), (size, size)
        )  # sorts
        blocks = np.empty((len(order.data), d, d))
        blocks[:size], blocks[size : size + len(a)], blocks[size + len(a) :] = (
            diagonal,
            upper,
            upper.swapaxes(1, 2),
        )
        blocks = np.take(blocks, order.data, axis=0)
        matrix = sparse.bsr_matrix((blocks, order.indices, order.indptr), (d * size, d * size))
        if springs is not None:
            directions = sparse.bsr_matrix(
                (loose, diagonals, np.arange(size + 1)), (d * size, d * size)
            )
            seen = springs[:, (d * nodes[:, None] + np.arange(d)).ravel()] @ directions
            matrix = matrix + (seen.T @ seen).tobsr((d, d))
            matrix.sort_indices()
        return matrix.tocsr()


def sum_stiffness(mesh: Mesh, material: Material | Composite) -> Stiffness:
    """The stiffness of a body of this mesh and material. Not collective."""
    (size, d), k = mesh.points.shape, mesh.triangles.shape[1]
    upper = np.array(np.triu_indices(k, 1))
    alike = np.arange(k)
    filled = upper[:, mesh.cell.stiffness[tuple(upper)].any(axis=(1, 2))]  # on straight cells
    portioned = [
        (cells, uniform, curved, upper if curved else filled)
        for cells, uniform, curved in portions(mesh, material)
    ]
    number = sum(len(mesh.triangles[cells]) * pairs.shape[1] for cells, _, _, pairs in portioned)
    ends, entries, at = np.empty((2, number), mesh.triangles.dtype), np.empty((d, d, number)), 0
    own_entries = np.empty((d, d, *mesh.triangles.shape[::-1]))
    for cells, uniform, curved, pairs in portioned:
        make = _curved_blocks if curved and not _affine(mesh, cells) else _straight_blocks
        i, j = np.hstack([[alike, alike], pairs])
        blocks = make(mesh, uniform, cells, i, j)
        if mesh.cell.modes:  # inner nodes, which are condensed
            modes = modes_of(mesh, uniform, cells)
            own = modes.beside.swapaxes(1, 2) @ modes.follows
            own = own.reshape(len(own), k, d, k, d)
            blocks -= own[:, i, :, j].transpose(2, 3, 0, 1)
        own_entries[..., cells] = blocks[:, :, :k]
        nodes, to = mesh.triangles[cells].T, slice(at, at + pairs.shape[1] * blocks.shape[3])
        ends[:, to], entries[..., to] = (
            nodes[pairs].reshape(2, -1),
            blocks[:, :, k:].reshape(d, d, -1),
        )
        at = to.stop

    turned, low, high = ends[0] > ends[1], ends.min(axis=0), ends.max(axis=0)
    order = sort_stably(high, size)
    order = order[sort_stably(low[order], size)]
    low, high = low[order], high[order]
    new = np.concatenate(
        [np.ones(min(number, 1), bool), (low[1:] != low[:-1]) | (high[1:] != high[:-1])]
    )
    pair = np.empty(number, dtype=np.int64)
    pair[order] = np.cumsum(new) - 1
    total, diagonal = np.empty((np.count_nonzero(new), d, d)), np.empty((size, d, d))
    node = mesh.triangles.T.ravel()
    for i, j in np.ndindex(d, d):
        diagonal[:, i, j] = np.bincount(node, own_entries[min(i, j), max(i, j)].ravel(), size)
        total[:, i, j] = np.bincount(
            pair, np.where(turned, entries[j, i], entries[i, j]), len(total)
        )
    return Stiffness(low[new], high[new], total, diagonal)


def _straight_blocks(
    mesh: Mesh, material: Material, cells: slice | np.ndarray, i: np.ndarray, j: np.ndarray
) -> np.ndarray:
    """Blocks (d, d, p, t) of pairs i, j (p,) of nodes in straight cells of a plane figure or a solid: ∫ C_rkcl ∂_kφ_i
    ∂_lφ_j."""
    inverse, determinant = invert(tangents(mesh.points, mesh.corners[cells]))
    slopes = (inverse * np.sqrt(determinant / mesh.cell.multiple)).swapaxes(
        0, 1
    )  # ∇λ √|T|, (d, a, t)
    products = elastic(mesh, material, slopes[:, None, :, None] * slopes[:, None])
    table = mesh.cell.stiffness[i, j].reshape(len(i), -1)
    return table @ products.reshape(*products.shape[:2], table.shape[1], -1)


def _curved_blocks(
    mesh: Mesh, material: Material, cells: slice | np.ndarray, i: np.ndarray, j: np.ndarray
) -> np.ndarray:
    """`_straight_blocks` of curved cells, or of those around an axis, by quadrature."""
    points, weights = mesh.cell.quadrature
    mapped = mesh.map(cells, points)
    slopes = (
        mapped.slopes * np.sqrt(weights[:, None] * mapped.measures)[:, None]
    )  # of which products are summed
    one, two = slopes[:, :, i], slopes[:, :, j]
    return elastic(
        mesh,
        material,
        np.stack([np.stack([np.einsum("qpt,qpt->pt", x, y) for y in two]) for x in one]),
    )


def _affine(mesh: Mesh, cells: slice | np.ndarray) -> bool:
    """Whether some bricks are parallelepipeds with integrals that tables have."""
    cell = mesh.cell
    tabled = not cell.simplex and not mesh.axisymmetric and mesh.integration != "reduced"
    return tabled and bool((cell.warps(mesh.points[mesh.triangles[cells]]) <= ROUNDING).all())


def sort_stably(keys: np.ndarray, size: int) -> np.ndarray:
    """The permutation that sorts integers in [0, size) and keeps the order of equals, in linear time."""
    table = sparse.csr_matrix(
        (np.zeros(len(keys), bool), keys, np.arange(len(keys) + 1)), (len(keys), size)
    )
    return table.tocsc().indices
