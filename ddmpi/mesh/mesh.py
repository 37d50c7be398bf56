"""The mesh of one body: nodes, triangles and named boundary groups, from gmsh or through meshio.

Triangles have straight sides. Those of order 2 have a node on the middle of each side besides, which
`raise_order` puts there; all else is the same for both orders.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ddmpi.errors import InputError


@dataclass(frozen=True)
class Mesh:
    """Triangles of one body. Not distributed; every array is local to the body.

    Attributes
    ----------
    points : (nv, 2) float, metres
    triangles : (nt, 3) int, corners counter-clockwise; of order 2 (nt, 6), then the middles of the sides
        01, 12, 20
    groups : name → (k, 2) int, the boundary edges of each physical group by their ends; of order 2
        (k, 3), then their middles
    """

    points: np.ndarray
    triangles: np.ndarray
    groups: dict[str, np.ndarray]

    @property
    def extent(self) -> float:
        """Diagonal of the bounding box (m)."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


def boundary_group(mesh: Mesh, name: str, key: str) -> np.ndarray:
    """Edges (k, 2 or 3) of the group `name`; InputError naming `key` if the mesh has no such group."""
    if name not in mesh.groups:
        raise InputError(f"{key}: the mesh has no boundary group {name!r}; it has {', '.join(sorted(mesh.groups))}")
    if len(mesh.groups[name]) == 0:
        raise InputError(f"{key}: the boundary group {name!r} of the mesh has a name, but no lines")
    return mesh.groups[name]


def turn_outward(mesh: Mesh, edges: np.ndarray, key: str) -> np.ndarray:
    """The edges turned so that the body lies to their left; InputError naming `key` for one inside the body."""
    size = len(mesh.points)
    marked = np.zeros(size, dtype=bool)
    marked[edges] = True
    t = mesh.triangles[np.count_nonzero(marked[mesh.triangles], axis=1) > 1]  # all others are out of the question
    around = np.concatenate([t[:, [0, 1]], t[:, [1, 2]], t[:, [2, 0]]])
    keys = around[:, 0] * size + around[:, 1]
    forward = np.isin(edges[:, 0] * size + edges[:, 1], keys)
    backward = np.isin(edges[:, 1] * size + edges[:, 0], keys)
    if not (forward ^ backward).all():
        raise InputError(f"{key}: the group has lines that are not on the body's boundary")
    return np.where(forward[:, None], edges, edges[:, [1, 0, *range(2, edges.shape[1])]])


def segments(edges: np.ndarray) -> np.ndarray:
    """Pairs (·, 2) of neighbouring nodes on edges (k, 2 or 3), in the edges' direction."""
    walk = np.column_stack([edges[:, 0], edges[:, 2:], edges[:, 1]])
    return np.concatenate([walk[:, i:i + 2] for i in range(walk.shape[1] - 1)])


def signed_double_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the signed area (nt,) of each triangle (m²)."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
