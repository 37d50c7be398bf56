"""Nested dissection of a mesh: the order in which a direct solver eliminates its nodes."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc
from scipy.sparse import csgraph

LEAF = 30
"""Largest number of nodes in an undivided part; parts have 15 to 30. With 20 or 40 factorizations of plane bodies took
as long or up to 3 % longer, with 8, 10 or 60 up to a tenth."""

FEWEST = 300_000
"""Fewest entries of a matrix for this order, as of 10,000 nodes of linear triangles or 2,000 of linear tetrahedra.
Below, MUMPS's own order, minimum degree, costs no more."""

SAMPLE = 16
"""The mean lengths of pairs of nodes are those of every SAMPLE-th pair."""

TILT = 1e-4
"""Weight of the other coordinates in a cut, which sort nodes of equal coordinates along its axis."""


def elimination_order(A: PETSc.Mat, points: np.ndarray) -> np.ndarray | None:
    """The place (n,) int32 of each row of A in the order of elimination; None for few entries. Not collective.

    A has a block of rows for each of the nodes at `points` (k, d), all on this rank; only its pattern is read.
    """
    starts, _ = A.getRowIJ()
    if starts[-1] < FEWEST:
        return None
    width, (ends, second) = A.getBlockSize(), neighbours(A)
    first = np.repeat(np.arange(len(points), dtype=second.dtype), np.diff(ends))
    pairs = first < second
    place = dissect(points, first[pairs], second[pairs])
    return (width * place[:, None] + np.arange(width)).ravel().astype(np.int32)


def neighbours(A: PETSc.Mat) -> tuple[np.ndarray, np.ndarray]:
    """The nodes that share an entry of A with each node, itself included: in a CSR matrix, starts of rows and columns.
    Not collective, see `elimination_order`."""
    width = A.getBlockSize()
    starts, columns = A.getRowIJ()
    count = np.diff(starts)[::width] // width
    ends = np.cumsum(np.append(0, count), dtype=columns.dtype)
    at = np.repeat(starts[:-1:width] - width * ends[:-1], count) + width * np.arange(
        ends[-1], dtype=columns.dtype
    )
    return ends, columns[at] // width


def layers_of(A: PETSc.Mat) -> int:
    """The number of layers of neighbours, about the largest, from a node at one end of the body to the other end. Not
    collective."""
    ends, nodes = neighbours(A)
    graph = sparse.csr_matrix((np.ones(len(nodes), np.int8), nodes, ends), (len(ends) - 1,) * 2)
    node = 0
    for _ in range(2):  # from any node to the farthest one, and from there
        order, before = csgraph.breadth_first_order(graph, node)
        node = at = order[-1]
        number = 1
        while before[at] >= 0:
            at, number = before[at], number + 1
    return number


def dissect(points: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The place (k,) of each node in the order of elimination by nested dissection. Not collective.

    Parts are halved at the median of their longest extent, counted in mean lengths of the pairs along each axis, until
    they have at most LEAF nodes. The separator of two halves is the smallest set of nodes that touches all pairs
    between them, and follows them in the order. The nodes are at `points` (k, d); `first` and `second` (e,) are the
    pairs of them that share an entry of the matrix, each once.
    """
    depth = max(0, int(np.ceil(np.log2(max(len(points), 1) / LEAF))))
    step = (
        np.abs(points[first[::SAMPLE]] - points[second[::SAMPLE]]).mean(axis=0)
        if len(first)
        else np.ones(1)
    )
    part = _bisect(points / np.where(step > 0.0, step, 1.0), depth)
    one, two = part[first], part[second]
    between = np.flatnonzero(one != two)
    turned = one[between] > two[between]
    lower = np.where(turned, second[between], first[between])
    upper = np.where(turned, first[between], second[between])
    level = (depth - np.frexp((one ^ two)[between].astype(float))[1]).astype(
        np.int16
    )  # the first bit that differs
    order = np.argsort(level, kind="stable")
    lower, upper, ends = (
        lower[order],
        upper[order],
        np.cumsum([0, *np.bincount(level, minlength=depth)]),
    )
    cut = np.full(len(points), depth)  # the level of the separator that has the node
    for k in range(depth):
        a, b = lower[ends[k] : ends[k + 1]], upper[ends[k] : ends[k + 1]]
        left = (cut[a] == depth) & (cut[b] == depth)
        if left.any():
            cut[_cover(a[left], b[left])] = k
    # A separator of level k follows all parts with its k leading bits, and separators of finer levels before it.
    last = part | ((1 << (depth - cut)) - 1)
    place = np.empty(len(points), np.int32)
    place[np.argsort((depth + 1) * last + depth - cut, kind="stable")] = np.arange(len(points))
    return place


def _bisect(points: np.ndarray, depth: int) -> np.ndarray:
    """The numbers (k,) of the nodes' parts, of 2**depth: the bits say in which half of each bisection a node is.

    Nodes are sorted along each axis once; the sorted lists are then split. Some nodes are doubled at first, so that all
    parts have equally many.
    """
    k, d = points.shape
    width = -(-k // 2**depth)
    spare = (width << depth) - k
    node = np.concatenate([np.arange(k), np.arange(spare) * k // max(spare, 1)])
    x = (points + TILT * points.sum(axis=1)[:, None])[node]
    lists = [
        np.argsort(x[:, axis], kind="stable").astype(np.int32).reshape(1, -1) for axis in range(d)
    ]
    for level in range(depth):
        extent = [x[nodes[:, -1], axis] - x[nodes[:, 0], axis] for axis, nodes in enumerate(lists)]
        longest, half = np.argmax(extent, axis=0), lists[0].shape[1] // 2
        upper = np.zeros(len(node), bool)
        upper[np.stack(lists)[longest, np.arange(1 << level), half:]] = True
        lists = [
            np.stack(
                [nodes[~above].reshape(-1, half), nodes[above].reshape(-1, half)], axis=1
            ).reshape(-1, half)
            for nodes, above in ((nodes, upper[nodes]) for nodes in lists)
        ]
    part = np.empty(k, np.int32)
    part[node[lists[0]]] = np.arange(1 << depth, dtype=np.int32)[:, None]
    return part


def _cover(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """The smallest set of nodes that touches all pairs from `first` to `second`, two disjoint sets of nodes.

    By Kőnig's theorem, from a largest matching.
    """
    (left, row), (right, column) = (
        np.unique(nodes, return_inverse=True) for nodes in (first, second)
    )
    m, source = len(left), len(left) + len(right)
    pairs = sparse.csr_matrix((np.ones(len(row), np.int8), (row, column)), (m, len(right)))
    match = csgraph.maximum_bipartite_matching(
        pairs, perm_type="column"
    )  # the column of each row, or −1
    matched, single = np.flatnonzero(match >= 0), np.flatnonzero(match < 0)
    ways = sparse.csr_matrix(
        (
            np.ones(len(row) + m, np.int8),
            (
                np.concatenate([np.full(len(single), source), row, m + match[matched]]),
                np.concatenate([single, m + column, matched]),
            ),
        ),
        (source + 1, source + 1),
    )
    reached = np.zeros(source + 1, bool)  # by alternating paths from rows that are not matched
    reached[csgraph.breadth_first_order(ways, source, return_predecessors=False)] = True
    # Kőnig: rows that alternating paths from unmatched rows do not reach, and columns that they reach.
    return np.concatenate([left[~reached[:m]], right[reached[m:-1]]])
