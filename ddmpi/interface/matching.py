"""Pairing of two sides whose nodes lie opposite each other."""

from __future__ import annotations

import numpy as np
from scipy.spatial import cKDTree

from ddmpi.errors import InputError
from ddmpi.interface.interface import Interface
from ddmpi.interface.side import Side

PAIRING_TOLERANCE = 1e-2
"""Largest tangential offset of two paired nodes, as a fraction of the distance to their neighbours."""

ROUNDING = 1e-9
"""Gaps below this fraction of the distance to the neighbours are rounding of the mesh, and count as zero."""


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
