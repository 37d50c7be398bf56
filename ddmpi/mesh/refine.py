"""Finer meshes, and meshes of order 2."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import segments
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import Mesh


def raise_order(mesh: Mesh, key: str) -> Mesh:
    """The mesh of order 2 whose first nodes are those of `mesh`, which has order 1.

    Not collective. Raises InputError, naming `key`, where lines of a group are not sides of triangles.
    """
    size = len(mesh.points)

    def keys(cells: np.ndarray, dimension: int) -> np.ndarray:
        edges = cells[:, CELLS[dimension, 1].edges]
        return edges.min(axis=-1) * size + edges.max(axis=-1)

    of_cells = keys(mesh.triangles, mesh.dimension)
    edges, number = np.unique(of_cells, return_inverse=True)
    groups = {}
    for name, facets in mesh.groups.items():
        wanted = keys(facets, mesh.dimension - 1)
        place = np.minimum(np.searchsorted(edges, wanted), len(edges) - 1)
        if not np.array_equal(edges[place], wanted):
            raise InputError(f"{key}: the boundary group {name!r} has lines that are not sides of triangles")
        groups[name] = np.column_stack([facets, size + place])
    ends = np.divmod(edges, size)
    points = np.concatenate([mesh.points, (mesh.points[ends[0]] + mesh.points[ends[1]]) / 2])
    return Mesh(points, np.column_stack([mesh.triangles, size + number.reshape(of_cells.shape)]), groups, mesh.vertices,
                mesh.surfaces)


def bend(mesh: Mesh, bends: np.ndarray) -> Mesh:
    """The mesh of order 2 with the middles of sides off the midpoints of their chords by `bends` (nt, 3, 2) (m).

    Where both triangles at a side give it, they give the same; zero means that the other one's counts.
    """
    bent, points = bends.any(axis=2), mesh.points.copy()
    sides = mesh.triangles[:, mesh.cell.edges][bent]
    points[sides[:, 2]] = (points[sides[:, 0]] + points[sides[:, 1]]) / 2 + bends[bent]
    return replace(mesh, points=points)


def halve(mesh: Mesh, key: str) -> Mesh:
    """The mesh of the same order with every side halved and every triangle cut into four.

    Curved triangles are cut where the map of the triangle has them; new middles are at the quarters of old sides. There
    the parabola is a quarter of its height off the chords of its halves, and so are the sides inside of a triangle that
    are opposite. Not collective. Raises InputError as `raise_order` does.
    """
    fine = raise_order(mesh, key) if mesh.order == 1 else mesh
    a, b, c, ab, bc, ca = fine.triangles.T
    parts = np.stack([[a, ab, ca], [ab, b, bc], [ca, bc, c], [ab, bc, ca]])
    triangles = parts.transpose(2, 0, 1).reshape(-1, 3)
    surfaces = {name: (4 * members[:, None] + np.arange(4)).ravel() for name, members in mesh.surfaces.items()}
    halved = Mesh(fine.points, triangles, {name: segments(edges) for name, edges in fine.groups.items()}, mesh.vertices,
                  surfaces)
    if mesh.order == 1:
        return halved
    old = mesh.bends
    return bend(raise_order(halved, key), np.stack([old, old, old, old[:, [2, 0, 1]]], axis=1).reshape(-1, 3, 2) / 4)
