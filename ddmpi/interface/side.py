"""The contact boundary of one body."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ddmpi.mesh.boundary import segments, turn_outward
from ddmpi.mesh.elements import ELEMENTS
from ddmpi.mesh.mesh import Mesh


@dataclass(frozen=True)
class Side:
    """Contact boundary of one body, nodes ordered along it.

    Attributes
    ----------
    body : name of the body
    modulus : plane modulus E/(1 − ν²) of the body (Pa)
    nodes : (k,) mesh node numbers
    xy : (k, 2) positions (m)
    normal : (k, 2) outer unit normals, averaged over the adjacent edges with their lengths
    area : (k,) nodal lengths (m): the integral of the node's shape function along the boundary, so that
        a constant stress times them gives its nodal forces. Half the adjacent edges in order 1; in order 2
        two thirds of its edge for a middle, a sixth of the adjacent edges for a corner
    free : (k, 2) bool, components that are not clamped
    middle : (k,) bool, whether a node is the middle of an edge; none in order 1
    joined : (k − 1,) bool, whether a node and the next one are neighbours; where not, another chain begins
    """

    body: str
    modulus: float
    nodes: np.ndarray
    xy: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    free: np.ndarray
    middle: np.ndarray
    joined: np.ndarray


def contact_side(mesh: Mesh, edges: np.ndarray, free: np.ndarray, body: str, modulus: float, key: str) -> Side:
    """The contact boundary made of `edges` (k, 2 or 3), ordered from its first end. Not collective.

    Raises InputError naming `key` when an edge does not lie on the boundary.
    """
    edges = turn_outward(mesh, edges, key)
    neighbours = segments(edges)
    nodes = _order(neighbours, mesh.points)
    along = mesh.points[edges[:, 1]] - mesh.points[edges[:, 0]]
    lengths = np.linalg.norm(along, axis=1)
    outward = np.column_stack([along[:, 1], -along[:, 0]])  # the body lies to the left of an edge
    length, normal = np.zeros(len(mesh.points)), np.zeros_like(mesh.points)
    for column, weight in enumerate(ELEMENTS[mesh.triangles.shape[1]].side_weights):
        np.add.at(length, edges[:, column], weight * lengths)
        np.add.at(normal, edges[:, column], outward)
    normal = normal[nodes] / np.linalg.norm(normal[nodes], axis=1, keepdims=True)
    size = len(mesh.points)
    joined = np.isin(_keys(nodes[:-1], nodes[1:], size), _keys(neighbours[:, 0], neighbours[:, 1], size))
    middle = np.isin(nodes, edges[:, 2:])
    return Side(body, modulus, nodes, mesh.points[nodes], normal, length[nodes], free[nodes], middle, joined)


def _keys(a: np.ndarray, b: np.ndarray, size: int) -> np.ndarray:
    """One number for each pair of nodes, whatever their order."""
    return np.minimum(a, b) * size + np.maximum(a, b)


def _order(pairs: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Nodes of pairs of neighbours, walked chain by chain; each chain starts at its end with the smaller x, y."""
    neighbours: dict[int, list[int]] = {}
    for a, b in pairs.tolist():
        neighbours.setdefault(a, []).append(b)
        neighbours.setdefault(b, []).append(a)
    ranked = sorted(neighbours, key=lambda node: (len(neighbours[node]) != 1, *points[node]))
    ordered: list[int] = []
    seen: set[int] = set()
    node: int | None
    for node in ranked:
        while node is not None and node not in seen:
            seen.add(node)
            ordered.append(node)
            node = next((n for n in neighbours[node] if n not in seen), None)
    return np.array(ordered, dtype=np.int64)
