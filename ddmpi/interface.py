"""The interface of two bodies: paired contact nodes, normals, nodal lengths, initial gap, traces.

Serial work on the two sides' boundary nodes; who sends which side to whom is `exchange`'s business.
Both sides compute the same pairing from the same data, so nothing more has to be agreed on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc
from scipy.spatial import cKDTree

from ddmpi.elasticity import Elasticity
from ddmpi.elements import ELEMENTS
from ddmpi.errors import InputError
from ddmpi.mesh import Mesh, segments, turn_outward

PAIRING_TOLERANCE = 1e-2
"""Largest tangential offset of two paired nodes, as a fraction of the distance to their neighbours."""

ROUNDING = 1e-9
"""Gaps below this fraction of the distance to the neighbours are rounding of the mesh, and count as zero."""


@dataclass(frozen=True)
class Side:
    """Contact boundary of one body, nodes ordered along it.

    Attributes
    ----------
    nodes : (k,) mesh node numbers
    xy : (k, 2) positions (m)
    normal : (k, 2) outer unit normals, averaged over the adjacent edges with their lengths
    length : (k,) nodal lengths (m): the integral of the node's shape function along the boundary, so that
        a constant stress times them gives its nodal forces. Half the adjacent edges in order 1; in order 2
        two thirds of its edge for a middle, a sixth of the adjacent edges for a corner
    free : (k, 2) bool, components that are not clamped
    middle : (k,) bool, whether a node is the middle of an edge; none in order 1
    joined : (k − 1,) bool, whether a node and the next one are neighbours; where not, another chain begins
    """

    nodes: np.ndarray
    xy: np.ndarray
    normal: np.ndarray
    length: np.ndarray
    free: np.ndarray
    middle: np.ndarray
    joined: np.ndarray


@dataclass(frozen=True)
class Interface:
    """Contact node pairs in role order; index 0 is role 1's side, index 1 role 2's.

    Attributes
    ----------
    nodes : pair of (m,) mesh node numbers
    xy : (m, 2) positions on role 1's side (m)
    normal, tangent : (m, 2) of role 1's body; ν² = −ν¹, t² = −t¹
    length : (m,) nodal lengths (m)
    gap : (m,) initial gap along the normal (m); negative for an initial overlap
    sliding : (mt,) the nodes that carry a tangential unknown; all m unless some are held by a clamp,
        none in a frictionless scene
    dropped : how many node pairs of the boundary carry no unknown because both bodies clamp them
    joined : (m − 1,) bool, whether a node and the next one are neighbours
    middle : (m,) bool, whether a node is the middle of an edge; none in order 1
    one_sided : (size,) bool, unknowns along which only one of the bodies can move
    held : (m,) inverse distances to the dropped neighbours, summed (1/m); zero where there are none
    """

    nodes: tuple[np.ndarray, np.ndarray]
    xy: np.ndarray
    normal: np.ndarray
    tangent: np.ndarray
    length: np.ndarray
    gap: np.ndarray
    sliding: np.ndarray
    dropped: int
    joined: np.ndarray
    middle: np.ndarray
    held: np.ndarray
    one_sided: np.ndarray

    @property
    def m(self) -> int:
        return len(self.length)

    @property
    def size(self) -> int:
        """Length of λ and s: m normal unknowns, then the tangential ones."""
        return self.m + len(self.sliding)

    @property
    def middles(self) -> np.ndarray:
        """(ns,) the middles of quadratic edges whose ends carry unknowns, too: k − 1 and k + 1 of k."""
        return 1 + np.flatnonzero(self.middle[1:-1] & self.joined[:-1] & self.joined[1:])


def contact_side(mesh: Mesh, edges: np.ndarray, free: np.ndarray) -> Side:
    """The contact boundary made of `edges` (k, 2 or 3), ordered from its first end. Not collective.

    Raises InputError when an edge does not lie on the boundary.
    """
    edges = turn_outward(mesh, edges, "contact.0.on")
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
    joined = np.isin(_keys(nodes[:-1], nodes[1:], size), _keys(*neighbours.T, size))
    middle = np.isin(nodes, edges[:, 2:])
    return Side(nodes, mesh.points[nodes], normal, length[nodes], free[nodes], middle, joined)


def pair(first: Side, second: Side, friction: bool, label: str) -> Interface:
    """Pair the nodes of two sides by position.

    Parameters
    ----------
    first, second : the sides of role 1 and role 2
    friction : whether tangential unknowns exist
    label : the key of the contact, for messages

    Raises
    ------
    InputError
        when the two sides do not match node by node. Not collective.
    """
    if len(first.nodes) != len(second.nodes):
        raise InputError(f"{label}: the two sides have {len(first.nodes)} and {len(second.nodes)} nodes; "
                         "their meshes must match node by node")
    match = cKDTree(second.xy).query(first.xy)[1]
    if len(np.unique(match)) != len(match):
        raise InputError(f"{label}: the nodes of the two sides do not pair off one to one"
                         f"{_worst(first, second, match)}; their meshes must match node by node")
    other = Side(*(getattr(second, field)[match] for field in ("nodes", "xy", "normal", "length", "free", "middle")),
                 first.joined)

    normal = first.normal - other.normal
    size = np.linalg.norm(normal, axis=1)
    length = (first.length + other.length) / 2
    if (size < 1.0).any():  # the outer normals must face each other (an angle above 120°)
        x, y = first.xy[np.argmin(size)]
        raise InputError(f"{label}: near ({x:.6g}, {y:.6g}) m the two boundaries do not face each other")
    normal /= size[:, None]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    distance = np.linalg.norm(np.diff(first.xy, axis=0), axis=1)
    spacing = np.zeros(len(length))
    spacing[1:] += np.where(first.joined, distance / 2, 0.0)
    spacing[:-1] += np.where(first.joined, distance / 2, 0.0)
    offset = other.xy - first.xy
    gap = np.einsum("ij,ij->i", offset, normal)
    aside = np.abs(np.einsum("ij,ij->i", offset, tangent))
    if (aside > PAIRING_TOLERANCE * spacing).any():
        raise InputError(f"{label}: the nodes of the two sides do not lie opposite each other"
                         f"{_worst(first, second, match)}; their meshes must match node by node")
    gap[np.abs(gap) <= ROUNDING * spacing] = 0.0

    sides = (first.free, other.free)
    fast = [np.array([_held(direction, free) for free in sides]) for direction in (normal, tangent)]
    held_normal, held_tangential = (by_body.all(axis=0) for by_body in fast)  # where one can move, they touch
    one_sided = [by_body.any(axis=0) for by_body in fast]
    keep = np.flatnonzero(~held_normal)
    if len(keep) == 0:
        raise InputError(f"{label}: all nodes of the contact are clamped; there is nothing to solve")
    sliding = np.flatnonzero(~held_tangential[keep]) if friction else np.empty(0, int)
    held = np.zeros(len(length))
    for node, neighbour in ((slice(1, None), slice(-1)), (slice(-1), slice(1, None))):
        to_held = first.joined & held_normal[neighbour]
        held[node][to_held] += 1.0 / distance[to_held]
    joined = first.joined[keep[:-1]] & (np.diff(keep) == 1)
    return Interface((first.nodes[keep], other.nodes[keep]), first.xy[keep], normal[keep], tangent[keep],
                     length[keep], gap[keep], sliding, len(length) - len(keep), joined, first.middle[keep], held[keep],
                     np.concatenate([one_sided[0][keep], one_sided[1][keep][sliding]]))


def trace(interface: Interface, role: int, body: Elasticity) -> PETSc.Mat:
    """B = [N; T] of the body in `role` (1 or 2) as a PETSc matrix (m + mt, columns of A).

    Collective on A's communicator. Components that are clamped have no entry; what they contribute
    to the trace is constant, and `displacement_trace` of the prescribed displacement gives it.
    """
    sign, nodes = _role(interface, role)
    place = np.full(len(body.free), -1, dtype=PETSc.IntType)
    place[body.nodes] = np.arange(len(body.nodes))
    s = interface.sliding
    directions = sign * np.concatenate([interface.normal, interface.tangent[s]])
    rows = np.concatenate([nodes, nodes[s]])
    columns = (2 * np.maximum(place[rows], 0)[:, None] + [0, 1]).astype(PETSc.IntType)  # clamped: no entry anywhere
    values = np.where(body.free[rows], directions, 0.0)
    indptr = 2 * np.arange(len(rows) + 1, dtype=PETSc.IntType)
    return PETSc.Mat().createAIJWithArrays((len(rows), body.A.size[1]), (indptr, columns.ravel(), values.ravel()),
                                           comm=body.A.comm)


def displacement_trace(interface: Interface, role: int, u: np.ndarray) -> np.ndarray:
    """[N; T] u (m + mt,) in metres, of a displacement (nv, 2) of all nodes. Not collective."""
    sign, nodes = _role(interface, role)
    s = interface.sliding
    return sign * np.concatenate([np.einsum("ij,ij->i", u[nodes], interface.normal),
                                  np.einsum("ij,ij->i", u[nodes[s]], interface.tangent[s])])


def _role(interface: Interface, role: int) -> tuple[int, np.ndarray]:
    return (1 if role == 1 else -1), interface.nodes[role - 1]


def _held(direction: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Whether a clamp takes the motion along `direction` (m, 2).

    With one component free, the unknown along the direction nearest to it stays.
    """
    return np.linalg.norm(direction * free, axis=1) < np.where(free.all(axis=1), 0.0, np.sqrt(0.5) - 1e-9)


def _worst(first: Side, second: Side, match: np.ndarray) -> str:
    distance = np.linalg.norm(second.xy[match] - first.xy, axis=1)
    k = int(np.argmax(distance))
    (x, y), (X, Y) = first.xy[k], second.xy[match[k]]
    return f" (worst: ({x:.6g}, {y:.6g}) m against ({X:.6g}, {Y:.6g}) m)"


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
    ordered, seen = [], set()
    for start in ranked:
        node = start
        while node is not None and node not in seen:
            seen.add(node)
            ordered.append(node)
            node = next((n for n in neighbours[node] if n not in seen), None)
    return np.array(ordered, dtype=np.int64)
