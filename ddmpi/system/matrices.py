"""Sparse matrices by their parts: small bodies take hundreds of them, and what SciPy checks of each is most of the time."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse


def scaled(
    A: sparse.csr_matrix, rows: np.ndarray | None = None, columns: np.ndarray | None = None
) -> sparse.csr_matrix:
    """diag(rows) A diag(columns) of a matrix (m, n) and factors (m,) and (n,), one if left out. Where entries are is
    shared with A, zeros among them stay.

    >>> scaled(sparse.csr_matrix([[1.0, 2.0], [0.0, 3.0]]), np.array([2.0, 1.0]), np.array([1.0, 10.0])).toarray()
    array([[ 2., 40.],
           [ 0., 30.]])
    """
    data = A.data
    if rows is not None:
        data = data * rows.repeat(np.diff(A.indptr))
    if columns is not None:
        data = data * columns[A.indices]
    return sparse.csr_matrix((data, A.indices, A.indptr), A.shape)


def on_diagonal(values: np.ndarray) -> sparse.csr_matrix:
    """The matrix (m, m) with these values (m,) on its diagonal."""
    number = np.arange(len(values) + 1)
    return sparse.csr_matrix((values, number[:-1], number), (len(values),) * 2)


def square(A: sparse.csr_matrix, some: np.ndarray) -> np.ndarray:
    """The rows and columns `some` (k,), in rising order, of a matrix, dense (k, k)."""
    part = A if len(some) == A.shape[0] else A[some][:, some]
    return part.toarray()
