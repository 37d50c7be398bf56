"""Edges on the boundary of a mesh: groups by name, their direction, their pieces between nodes."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse

from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.keys import nearest


def boundary_group(mesh: Mesh, name: str, key: str) -> np.ndarray:
    """Edges (k, 2 or 3) of the group `name`. Raises InputError, naming `key`, if the mesh has no such group."""
    if name not in mesh.groups:
        raise InputError(f"{key}: the mesh has no boundary group {name!r}{nearest(name, list(mesh.groups))}; it has "
                         f"{', '.join(sorted(mesh.groups))}")
    if len(mesh.groups[name]) == 0:
        raise InputError(f"{key}: the boundary group {name!r} of the mesh has a name, but no lines")
    return mesh.groups[name]


def turn_outward(mesh: Mesh, edges: np.ndarray, key: str) -> np.ndarray:
    """The edges, turned so that the body lies to their left. Raises InputError, naming `key`, for an inner edge."""
    size = len(mesh.points)
    marked = np.zeros(size, dtype=bool)
    marked[edges] = True
    t = mesh.triangles[np.count_nonzero(marked[mesh.triangles], axis=1) > 1]  # no other triangle has such an edge
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


def outline(mesh: Mesh) -> np.ndarray:
    """Pairs (·, 2) of neighbouring nodes all around the body, which lies to their left."""
    walk = mesh.triangles if mesh.order == 1 else mesh.triangles[:, [0, 3, 1, 4, 2, 5]]
    a, b, size = walk.ravel(), np.roll(walk, -1, axis=1).ravel(), len(mesh.points)
    steps = sparse.csr_matrix((np.ones(len(a)), (a, b)), shape=(size, size))
    alone = (steps - steps.T).tocoo()  # inside, two triangles walk along a side, there and back
    return np.column_stack([alone.row, alone.col])[alone.data > 0.0].astype(np.int64)
