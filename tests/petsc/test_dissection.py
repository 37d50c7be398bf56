"""The order of elimination: separators divide, are as small as can be, and save entries of the factors."""

import itertools

import numpy as np
import pytest
import scipy.sparse as sparse
from petsc4py import PETSc

from ddmpi.petsc.dissection import _cover, dissect, elimination_order, layers_of


def grid(*counts: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Nodes of a grid, and the pairs of those that share a cell."""
    points = np.stack(np.meshgrid(*map(np.arange, counts), indexing="ij"), axis=-1).reshape(
        -1, len(counts)
    )
    near = np.abs(points[:, None] - points).max(axis=2) == 1
    return points.astype(float), *np.argwhere(np.triu(near)).T


def entries(place: np.ndarray, first: np.ndarray, second: np.ndarray) -> int:
    """Entries of the factor that nodes eliminated in this order leave."""
    size = len(place)
    linked = np.zeros((size, size), bool)
    linked[place[first], place[second]] = linked[place[second], place[first]] = True
    for k in range(size):
        later = k + 1 + np.flatnonzero(linked[k, k + 1 :])
        linked[np.ix_(later, later)] = True
    return int(np.triu(linked, 1).sum())


@pytest.mark.parametrize("width", [1, 3])
@pytest.mark.parametrize("counts", [(30, 4), (7, 7), (4, 3, 25), (1, 1)])
def test_layers(counts, width):
    """As many as nodes along the longest side, however the nodes are numbered and however many rows each has."""
    points, first, second = grid(*counts)
    for seed in range(3):
        place = np.random.default_rng(seed).permutation(len(points))
        pairs = sparse.csr_matrix(
            (np.ones(len(first)), (place[first], place[second])), (len(points),) * 2
        )
        blocks = sparse.kron(
            pairs + pairs.T + sparse.identity(len(points)), np.ones((width, width))
        ).tocsr()
        A = PETSc.Mat().createAIJ(
            blocks.shape,
            bsize=width,
            csr=(blocks.indptr, blocks.indices, blocks.data),
            comm=PETSc.COMM_SELF,
        )
        assert layers_of(A) == max(counts)


@pytest.mark.parametrize("counts", [(24, 24), (9, 9, 9)])
def test_order_saves_entries(counts):
    """In the plane and in space, however the nodes are numbered."""
    points, first, second = grid(*counts)
    place = dissect(points, first, second)
    assert sorted(place) == list(range(len(points)))
    own = entries(place, first, second)
    assert own < 0.9 * entries(np.arange(len(points)), first, second)
    number = np.random.default_rng(4).permutation(len(points))
    shuffled = np.empty_like(points)
    shuffled[number] = points
    other = entries(dissect(shuffled, number[first], number[second]), number[first], number[second])
    assert abs(other - own) <= 0.1 * own


def test_nodes_at_one_place_and_few_nodes():
    """What cannot be divided is ordered all the same."""
    everywhere = np.triu_indices(50, 1)
    assert sorted(dissect(np.zeros((50, 2)), *everywhere)) == list(range(50))
    for k in (0, 1, 2):
        assert sorted(dissect(np.zeros((k, 2)), np.zeros(0, int), np.zeros(0, int))) == list(
            range(k)
        )


def test_smallest_cover():
    """As small as the smallest of all sets that touch all pairs."""
    random = np.random.default_rng(5)
    for _ in range(50):
        pairs = np.unique(random.integers(0, 5, (random.integers(1, 12), 2)), axis=0)
        first, second = pairs[:, 0], pairs[:, 1] + 5
        found = _cover(first, second)
        assert (np.isin(first, found) | np.isin(second, found)).all()
        assert not any(
            (np.isin(first, less) | np.isin(second, less)).all()
            for less in itertools.combinations(range(10), len(found) - 1)
        )


def test_dofs_of_a_node_stay_together(monkeypatch):
    """In matrices that are large enough."""
    points, first, second = grid(8, 8)
    size = len(points)
    graph = sparse.coo_array((np.ones(len(first)), (first, second)), (size, size))
    blocks = sparse.kron(graph + graph.T + sparse.identity(size), np.ones((2, 2)), format="csr")
    rows = (blocks.indptr.astype(PETSc.IntType), blocks.indices.astype(PETSc.IntType), blocks.data)
    A = PETSc.Mat().createAIJ(blocks.shape, bsize=2, csr=rows, comm=PETSc.COMM_SELF)
    assert elimination_order(A, points) is None
    monkeypatch.setattr("ddmpi.petsc.dissection.FEWEST", blocks.nnz)
    order = elimination_order(A, points)
    assert np.array_equal(order[::2], 2 * dissect(points, first, second))
    assert np.array_equal(order[1::2], order[::2] + 1)
