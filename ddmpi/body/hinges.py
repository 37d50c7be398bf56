"""Parts of a body that hang on each other by single nodes, or in space by those of one edge.

Cells with a common facet move as one if nothing is strained. So a body is parts, each with its rigid
motions, that common nodes, clamps and springs hold; what these leave free beside the motions of the whole
is a mechanism, along which the stiffness is singular.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.errors import InputError
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import Mesh
from ddmpi.system.numbers import in_words

MOST = 300
"""Bodies of more parts are not searched for mechanisms."""

FREE = 1e-13
"""A motion is free if the squares of what it moves that is held are below this fraction of the largest."""


def parts(mesh: Mesh) -> np.ndarray:
    """(nt,) the number of the part that each cell is of: cells of one part are connected by common facets. One for all
    where no node or edge of the boundary shows that there are several. Not collective."""
    count = len(mesh.triangles)
    if not _pinched(mesh):
        return np.zeros(count, int)
    d = mesh.dimension
    sides = np.sort(mesh.corners[:, CELLS[d, 1].facets].reshape(-1, d), axis=1)
    order = np.lexsort(sides.T)
    equal = (sides[order[1:]] == sides[order[:-1]]).all(axis=1)
    one, two = order[:-1][equal] // (d + 1), order[1:][equal] // (d + 1)
    links = sparse.coo_matrix((np.ones(len(one), np.int8), (one, two)), (count, count))
    return csgraph.connected_components(links, directed=False)[1]


def _pinched(mesh: Mesh) -> bool:
    """Whether more than one sheet of the boundary meets at some node, or more than two facets at an edge."""
    d, facets = mesh.dimension, mesh.boundary[0][:, : mesh.dimension]
    if d == 2:
        return bool((np.bincount(facets.ravel()) > 2).any())
    edges = np.sort(facets[:, CELLS[2, 1].edges[:, :2]], axis=2).reshape(-1, 2)
    order = np.lexsort(edges.T)
    new = np.append(True, (edges[order[1:]] != edges[order[:-1]]).any(axis=1))
    number = np.empty(len(edges), int)
    number[order] = np.cumsum(new) - 1
    if (np.bincount(number) > 2).any():
        return True
    # the corners of facets, linked across edges at the same node: of a closed surface one ring a node
    ends, nodes = CELLS[2, 1].edges[:, :2], facets.ravel()
    one, other = order[new], order[np.append(np.flatnonzero(new)[1:], len(order)) - 1]
    corners = [3 * (side // 3) + ends[side % 3].T for side in (one, other)]  # (2, e) of each
    crossed = (
        nodes[corners[0][0]] != nodes[corners[1][0]]
    )  # neighbours mostly walk an edge in opposite ways
    a, b = corners[0].ravel(), np.where(crossed, corners[1][::-1], corners[1]).ravel()
    size = facets.size
    rings = csgraph.connected_components(
        sparse.coo_matrix((np.ones(len(a), np.int8), (a, b)), (size, size)), directed=False
    )[0]
    return rings > len(np.unique(facets))


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
    part = parts(mesh)
    number = int(part.max()) + 1
    if (
        not 1 < number <= MOST or mesh.axisymmetric
    ):  # around an axis a part cannot turn without strain
        return
    nodes, owner = _members(mesh, part)
    first = np.append(True, nodes[1:] != nodes[:-1])
    start = np.flatnonzero(first)[np.cumsum(first) - 1]
    centre, size = mesh.points.mean(axis=0), mesh.extent
    at = motions_of(mesh.points[nodes], centre, size)
    j = at.shape[2]
    squares = np.zeros((number, number, j, j))
    a, b, moved = owner[start[~first]], owner[~first], at[~first]
    products = np.einsum("kim,kin->kmn", moved, moved)
    for i, k, sign in (
        (a, a, 1.0),
        (b, b, 1.0),
        (a, b, -1.0),
        (b, a, -1.0),
    ):  # common nodes move as one
        np.add.at(squares, (i, k), sign * products)
    lead = np.flatnonzero(first)
    held = np.einsum("kij,kjm->kim", np.eye(mesh.dimension) - free[nodes[lead]], at[lead])
    touched = np.maximum(np.bincount(owner[lead], held.any(axis=(1, 2)), number), 1.0)
    products = np.einsum("kim,kin->kmn", held, held) / touched[owner[lead], None, None]
    np.add.at(squares, (owner[lead], owner[lead]), products)
    if springs is not None:
        columns = np.zeros((number, springs.shape[0], j))
        for one in range(number):
            moved = np.zeros((*mesh.points.shape, j))
            moved[nodes[lead]] = at[lead] * (owner[lead] == one)[:, None, None]
            columns[one] = springs @ moved.reshape(-1, j)
        squares += np.einsum("arm,brn->abmn", columns, columns)
    values, vectors = np.linalg.eigh(squares.swapaxes(1, 2).reshape(number * j, number * j))
    null = vectors[:, values <= FREE * max(values[-1], 1.0)]
    if null.shape[1] <= whole:
        return
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
