"""Pairing of two sides whose nodes lie opposite each other."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from ddmpi.errors import InputError
from ddmpi.interface.interface import FixedPairs, Interface
from ddmpi.interface.law import law_of
from ddmpi.interface.side import Side
from ddmpi.scene.contacts import Coulomb, NoFriction, Tresca

LARGEST_OFFSET = 1e-2
"""Largest tangential offset of two paired nodes, as a fraction of the distance to their neighbours in the meshes as
given: finer versions of the same boundaries are offset as much."""

NO_GAP = 1e-9
"""Gaps below this fraction of the distance to the neighbours are rounding of the mesh, and count as zero."""


def pair(first: Side, second: Side, friction: Coulomb | Tresca | NoFriction, name: str,
         refinement: int = 1) -> Interface:
    """The interface of two sides, whose nodes are paired by position.

    Parameters
    ----------
    first, second : the sides
    friction : the law that the scene asks for; without friction there are no tangential unknowns
    name : of the contact
    refinement : how many times finer the meshes are than the given ones, whose spacing the tolerance follows

    Raises
    ------
    InputError
        when the two sides do not match node by node. Not collective.
    """
    match = _opposite(first, second, name)
    area = (first.area + second.area[match]) / 2
    normal = first.normal - second.normal[match]
    size = np.linalg.norm(normal, axis=1)
    if (size < 1.0).any():  # the outer normals must face each other (an angle above 120°)
        x, y = first.xy[np.argmin(size)]
        raise InputError(f"contact.{name}: near ({x:.6g}, {y:.6g}) the two boundaries do not face each other")
    normal /= size[:, None]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    distance = np.linalg.norm(np.diff(first.xy, axis=0), axis=1)
    gap = _gap(first, second, match, normal, tangent, distance, name, refinement)

    free = first.free, second.free[match]
    stays = [np.array([_is_held(direction, each) for each in free]) for direction in (normal, tangent)]
    held_normal, held_tangential = (by_body.all(axis=0) for by_body in stays)  # where one body can move, they touch
    one_sided = [by_body.any(axis=0) for by_body in stays]
    keep = np.flatnonzero(~held_normal)
    if len(keep) == 0:
        raise InputError(f"contact.{name}: all nodes of the contact are clamped; there is nothing to solve")
    has_friction = not isinstance(friction, NoFriction)
    sliding = np.flatnonzero(~held_tangential[keep]) if has_friction else np.empty(0, int)
    held = np.zeros(len(area))
    for node, neighbour in ((slice(1, None), slice(-1)), (slice(-1), slice(1, None))):
        to_held = first.joined & held_normal[neighbour]
        held[node][to_held] += 1.0 / distance[to_held]
    place = np.full(len(area), -1)
    place[keep] = np.arange(len(keep))
    edges = place[first.edges]
    alone = sparse.identity(len(keep), format="csr")
    return Interface(
        name=name, bodies=(first.body, second.body), xy=first.xy[keep],
        frame=np.stack([normal[keep], tangent[keep]], axis=1), area=area[keep], gap=gap[keep],
        nodes=(first.nodes[keep], second.nodes[match][keep]), transfer=(alone, alone),
        law=law_of(friction, first.xy[keep], area[keep], sliding),
        modulus=1.0 / (1.0 / first.modulus + 1.0 / second.modulus),
        joined=first.joined[keep[:-1]] & (np.diff(keep) == 1), edges=edges[(edges >= 0).all(axis=1)],
        held=held[keep],
        one_sided=np.concatenate([one_sided[0][keep], one_sided[1][keep][sliding]]),
        fixed=FixedPairs((first.nodes[held_normal], second.nodes[match][held_normal]), normal[held_normal],
                         gap[held_normal]),
        beyond=_common_ends(first, second, match))


def _common_ends(first: Side, second: Side, match: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ends (e, 3) that both sides have in common, in the same order."""
    partner = dict(zip(first.nodes.tolist(), second.nodes[match].tolist(), strict=True))
    place = {int(end): k for k, end in enumerate(second.beyond[:, 0])}
    common = [k for k, end in enumerate(first.beyond[:, 0].tolist()) if partner[end] in place]
    return first.beyond[common], second.beyond[[place[partner[int(end)]] for end in first.beyond[common, 0]]]


def _opposite(first: Side, second: Side, name: str) -> np.ndarray:
    """The place on the second side (m,) of the node nearest to each node of the first."""
    if len(first.nodes) != len(second.nodes):
        raise InputError(f"contact.{name}: the two sides have {len(first.nodes)} and {len(second.nodes)} nodes; "
                         "their meshes must match node by node")
    match = cKDTree(second.xy).query(first.xy)[1]
    if len(np.unique(match)) != len(match):
        raise InputError(f"contact.{name}: the nodes of the two sides do not pair off one to one"
                         f"{_worst(first, second, match)}; their meshes must match node by node")
    return match


def _gap(first: Side, second: Side, match: np.ndarray, normal: np.ndarray, tangent: np.ndarray,
         distance: np.ndarray, name: str, refinement: int) -> np.ndarray:
    """The initial gap (m,) along the normals; InputError where two nodes lie too far aside of each other."""
    spacing = np.zeros(len(match))
    spacing[1:] += np.where(first.joined, distance / 2, 0.0)
    spacing[:-1] += np.where(first.joined, distance / 2, 0.0)
    offset = second.xy[match] - first.xy
    gap = np.einsum("ij,ij->i", offset, normal)
    aside = np.abs(np.einsum("ij,ij->i", offset, tangent))
    if (aside > LARGEST_OFFSET * refinement * spacing).any():
        raise InputError(f"contact.{name}: the nodes of the two sides do not lie opposite each other"
                         f"{_worst(first, second, match)}; their meshes must match node by node")
    gap[np.abs(gap) <= NO_GAP * spacing] = 0.0
    return gap


def _is_held(direction: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Whether a clamp takes the motion along `direction` (m, 2).

    With one component free, the unknown along the direction nearest to it stays.
    """
    return np.linalg.norm(direction * free, axis=1) < np.where(free.all(axis=1), 0.0, np.sqrt(0.5) - 1e-9)


def _worst(first: Side, second: Side, match: np.ndarray) -> str:
    distance = np.linalg.norm(second.xy[match] - first.xy, axis=1)
    k = int(np.argmax(distance))
    (x, y), (X, Y) = first.xy[k], second.xy[match[k]]
    return f" (worst: ({x:.6g}, {y:.6g}) against ({X:.6g}, {Y:.6g}))"
