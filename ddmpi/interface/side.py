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
    extent : (2,) width and height of the body (m)
    beyond : (e, 3) for each end of a chain: its node, the next node of the body's boundary, and 1 where the body lies
        to the left on the way from the one to the other, else 0
    joined : (k − 1,) bool, whether a node and the next one are neighbours; where not, another chain begins
    edges : (ns, 3) quadratic edges by the places of their ends and middle, in the order of the middles; none in order 1
    """

    body: str
    modulus: float
    nodes: np.ndarray
    xy: np.ndarray
    normal: np.ndarray
    area: np.ndarray
    free: np.ndarray
    extent: np.ndarray
    beyond: np.ndarray
    joined: np.ndarray
    edges: np.ndarray


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
    place = np.empty(size, int)
    place[nodes] = np.arange(len(nodes))
    quadratic = place[edges] if mesh.order == 2 else np.empty((0, 3), int)
    return Side(body, modulus, nodes, mesh.points[nodes], normal, length[nodes], free[nodes],
                np.ptp(mesh.points, axis=0), _beyond(mesh, neighbours), joined, quadratic[np.argsort(quadratic[:, 2])])


def _beyond(mesh: Mesh, pairs: np.ndarray) -> np.ndarray:
    """`Side.beyond` of the chains of neighbours `pairs` (k, 2)."""
    number = np.bincount(pairs.ravel(), minlength=len(mesh.points))
    found, size = [], len(mesh.points)
    chain = set(_keys(pairs[:, 0], pairs[:, 1], size).tolist())
    for end in np.flatnonzero(number == 1).tolist():
        near = mesh.triangles[(mesh.triangles[:, :3] == end).any(axis=1)]
        walk = np.column_stack([near[:, :3], near[:, 3:]])[:, [0, 3, 1, 4, 2, 5] if near.shape[1] == 6 else [0, 1, 2]]
        directed = {(int(a), int(b)) for a, b in zip(walk.ravel(), np.roll(walk, -1, axis=1).ravel(), strict=True)}
        for a, b in directed:  # of boundary edges the way back is missing
            if end in (a, b) and (b, a) not in directed and int(_keys(np.array(a), np.array(b), size)) not in chain:
                found.append((end, b if a == end else a, int(a == end)))
    return np.array(found, dtype=np.int64).reshape(-1, 3)


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
