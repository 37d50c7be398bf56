"""Parts of a body that hang on each other by single nodes, or in space by those of one edge.

Cells with a common facet move as one if nothing is strained. So a body is parts, each with its rigid
motions, that common nodes, clamps and springs hold; what these leave free beside the motions of the whole
is a mechanism, along which the stiffness is singular.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sparse

from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh
from ddmpi.system.numbers import in_words

MOST = 300
"""Bodies of more parts are not searched for mechanisms."""

FREE = 1e-13
"""A motion is free if the squares of what it moves that is held are below this fraction of the largest."""


def refuse_hinges(
    mesh: Mesh,
    name: str,
    free: np.ndarray,
    whole: int,
    motions_of: Callable[[np.ndarray, np.ndarray, float], np.ndarray],
    springs: sparse.csr_matrix | None = None,
) -> None:
    """Raise InputError where parts of a body can turn about the nodes that they hang by.

    Parameters
    ----------
    free : (nv, d, d) projections onto the directions that clamps leave free
    whole : how many rigid motions clamps and springs leave the body as a whole
    motions_of : the rigid motions (k, d, j) of points (k, d) about a centre, over a size
    springs : (r, d nv) rows of springs, without units

    Not collective.
    """
    part, d = mesh.parts, mesh.dimension
    number = int(part.max()) + 1
    if (
        not 1 < number <= MOST or mesh.axisymmetric
    ):  # around an axis a part cannot turn without strain
        return
    nodes, owner = _members(mesh, part)
    at = motions_of(mesh.points[nodes], mesh.points.mean(axis=0), mesh.extent)
    j = at.shape[2]

    def moved(motions: np.ndarray, rows: np.ndarray, size: int) -> sparse.csr_matrix:
        """Displacements (d size, number j) at `rows` (k,) of places, by `motions` (k, d, j) of the parts there."""
        row, column = d * rows[:, None, None] + np.arange(d)[:, None], j * owner[:, None, None]
        ends = np.broadcast_arrays(row, column + np.arange(j))
        shape = d * size, number * j
        return sparse.csr_matrix((motions.ravel(), [end.ravel() for end in ends]), shape)

    first = np.append(True, nodes[1:] != nodes[:-1])
    lead = np.flatnonzero(first)[np.cumsum(first) - 1]
    # of each node those of its first part, from which those of the others must not differ
    of_first = moved(at * first[:, None, None], nodes, len(mesh.points))
    every = moved(at, np.arange(len(nodes)), len(nodes))
    apart = every - every[(d * lead[:, None] + np.arange(d)).ravel()]
    held = (np.eye(d) - free[nodes]) @ at * first[:, None, None]
    touched = np.maximum(np.bincount(owner, held.any(axis=(1, 2)), number), 1.0)
    held /= np.sqrt(touched)[owner, None, None]
    rows = [apart, moved(held, nodes, len(mesh.points))]
    if springs is not None:
        rows.append(springs @ of_first)
    values, vectors = np.linalg.eigh(sum((row.T @ row).toarray() for row in rows))
    null = vectors[:, values <= FREE * max(values[-1], 1.0)]
    if null.shape[1] > whole:
        raise InputError(_words(mesh, name, part, nodes, owner, null.reshape(number, -1)))


def _members(mesh: Mesh, part: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """All pairs (k,), sorted, of a node and a part that has it."""
    pairs = mesh.triangles.astype(np.int64) * (int(part.max()) + 1) + part[:, None]
    return np.divmod(np.unique(pairs), int(part.max()) + 1)


def _words(
    mesh: Mesh, name: str, part: np.ndarray, nodes: np.ndarray, owner: np.ndarray, moved: np.ndarray
) -> str:
    """What can turn about which nodes, by how each part is `moved` (p, ·) in the mechanisms."""
    size = np.bincount(part)
    same = np.flatnonzero(nodes[1:] == nodes[:-1])
    pairs = np.sort(np.column_stack([owner[same], owner[same + 1]]), axis=1)
    apart = np.linalg.norm(moved[pairs[:, 0]] - moved[pairs[:, 1]], axis=1)
    pair = pairs[apart.argmax()]
    shared = nodes[same][(pairs == pair).all(axis=1)]
    corners = np.intersect1d(shared, mesh.corners)
    where = "at one node only" if len(corners) == 1 else "along one line of nodes only"
    smaller = int(pair[size[pair].argmin()])
    cells = f"{size[smaller]} {mesh.cell.names if size[smaller] > 1 else mesh.cell.name}"
    return (
        f"body.{name}.mesh: a part of {cells} is connected to the rest {where}, at "
        f"{in_words(mesh.points[corners[0]], 4)}, about which it can turn without any force; connect them "
        f"along sides of cells, or make two bodies of them with a contact between them"
    )
