"""Finer meshes, sizes of their elements, and meshes of order 2."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.errors import InputError
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import Mesh, signed_measures

CORNERS_CUT = {1: [[0, 2], [2, 1]], 2: [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
               3: [[0, 4, 6, 7], [4, 1, 5, 8], [6, 5, 2, 9], [7, 8, 9, 3]]}
"""Parts of a cell of order 2 with halved edges, by dimension: its nodes at their corners. In space an octahedron is
left over."""

INSIDE = {3: np.array([[[4, 9, a, b] for a, b in ((5, 6), (6, 7), (7, 8), (8, 5))],
                         [[5, 7, a, b] for a, b in ((6, 4), (9, 6), (8, 9), (4, 8))],
                         [[6, 8, a, b] for a, b in ((4, 5), (5, 9), (9, 7), (7, 4))]])}
"""The four tetrahedra around each of its three diagonals."""

EQUAL = 1e-6
"""Diagonals whose lengths differ by less than this part of them are equally long; the first of them is taken."""

GRADE = 0.3
"""By how much the size of elements grows with the distance, at most."""


@dataclass(frozen=True)
class Sizes:
    """The sizes that the elements of a body shall have, linear on the cells of an earlier mesh.

    Attributes
    ----------
    points, triangles : (k, d) in metres and (t, d + 1)
    sizes : (k,) lengths of sides (m)
    """

    points: np.ndarray
    triangles: np.ndarray
    sizes: np.ndarray


def raise_order(mesh: Mesh, key: str) -> Mesh:
    """The mesh of order 2 whose first nodes are those of `mesh`, which has order 1.

    Not collective. Raises InputError, naming `key`, where lines or triangles of a group are not sides of cells.
    """
    size = len(mesh.points)

    def keys(cells: np.ndarray) -> np.ndarray:
        edges = cells[:, CELLS[cells.shape[1] - 1, 1].edges]
        return edges.min(axis=-1) * size + edges.max(axis=-1)

    def raised(groups: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        found = {}
        for name, facets in groups.items():
            wanted = keys(facets)
            place = np.minimum(np.searchsorted(edges, wanted), len(edges) - 1)
            if not np.array_equal(edges[place], wanted):
                raise InputError(f"{key}: the group {name!r} has {CELLS[facets.shape[1] - 1, 1].names} that are not "
                                 f"sides of {mesh.cell.names}")
            found[name] = np.column_stack([facets, size + place])
        return found

    of_cells = keys(mesh.triangles)
    edges, number = np.unique(of_cells, return_inverse=True)
    ends = np.divmod(edges, size)
    points = np.concatenate([mesh.points, (mesh.points[ends[0]] + mesh.points[ends[1]]) / 2])
    cells = np.column_stack([mesh.triangles, size + number.reshape(of_cells.shape)])
    return replace(mesh, points=points, triangles=cells, groups=raised(mesh.groups), curves=raised(mesh.curves))


def bend(mesh: Mesh, bends: np.ndarray) -> Mesh:
    """The mesh of order 2 with the middles of edges off the midpoints of their chords by `bends` (nt, e, d) (m).

    Where several cells at an edge give it, they give the same; zero means that another one's counts.
    """
    bent, points = bends.any(axis=2), mesh.points.copy()
    sides = mesh.triangles[:, mesh.cell.edges][bent]
    points[sides[:, 2]] = (points[sides[:, 0]] + points[sides[:, 1]]) / 2 + bends[bent]
    return replace(mesh, points=points)


def halve(mesh: Mesh, key: str) -> Mesh:
    """The mesh of the same order with every edge halved: every triangle cut into four, every tetrahedron into eight.

    What is left of a tetrahedron without its corners is cut around its shortest diagonal (Bey 1995). Curved cells are
    cut where their maps have them. Not collective. Raises InputError as `raise_order` does.
    """
    fine = raise_order(mesh, key) if mesh.order == 1 else mesh
    parts = _parts(fine)
    number, d = parts.shape[1], mesh.dimension
    halved = replace(
        mesh, points=fine.points,
        triangles=np.take_along_axis(fine.triangles[:, None], parts, axis=2).reshape(-1, d + 1),
        groups={name: cut(facets) for name, facets in fine.groups.items()},
        curves={name: cut(lines) for name, lines in fine.curves.items()},
        surfaces={name: (number * members[:, None] + np.arange(number)).ravel()
                  for name, members in mesh.surfaces.items()})
    if mesh.order == 1:
        return halved
    # in the middle of a step v, the map's 4 λ_i λ_j of an edge is off its chord by −v_i v_j
    (i, j), bends = fine.cell.edges[:, :2].T, np.zeros((len(parts), number, len(fine.cell.edges), d))
    for cells in mesh.summed_blocks():
        steps = np.diff(fine.cell.nodes[parts[cells][:, :, fine.cell.edges[:, :2]]], axis=3)[:, :, :, 0]
        bends[cells] = np.einsum("tpef,tfd->tped", -steps[..., i] * steps[..., j], mesh.bends[cells])
    return bend(raise_order(halved, key), bends.reshape(-1, *bends.shape[2:]))


def cut(facets: np.ndarray) -> np.ndarray:
    """Facets or lines (k, l) of order 2 cut into those of order 1 between their nodes: first parts come first."""
    dimension = 1 if facets.shape[1] == 3 else 2
    return facets[:, CORNERS_CUT[dimension]].swapaxes(0, 1).reshape(-1, dimension + 1)


def _parts(mesh: Mesh) -> np.ndarray:
    """(nt, 2^d, d + 1) which nodes of each cell of order 2 its halves have for corners."""
    outer = np.array(CORNERS_CUT[mesh.dimension])
    outer = np.broadcast_to(outer, (len(mesh.triangles), *outer.shape))
    inside = INSIDE.get(mesh.dimension)
    if inside is None:
        return outer
    ends = mesh.points[mesh.triangles[:, inside[:, 0, :2]]]
    lengths = np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2)
    shortest = (lengths <= (1.0 + EQUAL) * lengths.min(axis=1, keepdims=True)).argmax(axis=1)
    return np.concatenate([outer, inside[shortest]], axis=1)


def graded(mesh: Mesh, sizes: np.ndarray) -> Sizes:
    """`sizes` (nt,) of the cells as sizes at the corners, which grow by no more than GRADE with the distance.

    Not collective.
    """
    measure, n = signed_measures(mesh.points, mesh.corners), mesh.dimension + 1
    used, corners = np.unique(mesh.corners, return_inverse=True)
    corners, points, k = corners.reshape(-1, n), mesh.points[used], len(used)
    weight = np.bincount(corners.ravel(), np.repeat(measure, n))
    nodal = np.exp(np.bincount(corners.ravel(), np.repeat(measure * np.log(sizes), n)) / weight)
    links = np.concatenate([corners[:, edge] for edge in mesh.cell.edges[:, :2]])
    far = GRADE * np.linalg.norm(points[links[:, 0]] - points[links[:, 1]], axis=1)
    ends = np.concatenate([links.T, [np.full(k, k), np.arange(k)]], axis=1)  # the shortest way from an outer node
    _, first = np.unique(np.sort(ends, axis=0), axis=1, return_index=True)
    graph = sparse.csr_matrix((np.concatenate([far, nodal])[first], ends[:, first]), shape=(k + 1, k + 1))
    return Sizes(points, corners, csgraph.dijkstra(graph, directed=False, indices=k)[:k])
