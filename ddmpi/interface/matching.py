"""Pairing of two sides whose nodes lie opposite each other, everywhere or in the part that they have in common.

A rigid surface, which has neither nodes nor compliance, lies opposite every node that faces it.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sparse
from scipy.spatial import cKDTree

from ddmpi.errors import InputError
from ddmpi.interface.interface import SAME, Interface, Places
from ddmpi.interface.law import law_of
from ddmpi.interface.side import Side
from ddmpi.scene.contacts import Circle, Coulomb, NoFriction, Plane, Tresca
from ddmpi.scene.values import Profile

LARGEST_OFFSET = 1e-2
"""Largest tangential offset of two paired nodes, as a fraction of the distance to their neighbours in the meshes as
given: finer versions of the same boundaries are offset as much."""

NO_GAP = 1e-9
"""Gaps below this fraction of the distance to the neighbours are rounding of the mesh, and count as zero."""

FACING = -0.5
"""Surfaces face each other where the product of their outer normals is below this: up to 60° from opposite."""

DEEPEST = 0.5
"""Sides that cover each other partly do not face each other where they overlap by more than this part of the thinner
body's depth: a body's far side is no partner."""


@dataclass(frozen=True)
class Opposite:
    """Nodes of two sides that lie opposite each other, as geometry has it: clamps and laws do not count yet.

    Attributes
    ----------
    sides : the two
    place : of each side (k,), which of its nodes; those of the first are in its order
    normal : (k, 2) unit normals of the contact, out of the first body
    area : (k,) nodal lengths of the part that both sides have in common (m)
    gap : (k,) measured along the normals, between the arcs over the sides' chords (m)
    common : (ns,) bool, which of the first side's links the common part has
    """

    sides: tuple[Side, Side]
    place: tuple[np.ndarray, np.ndarray]
    normal: np.ndarray
    area: np.ndarray
    gap: np.ndarray
    common: np.ndarray


def pair(first: Side, second: Side, friction: Coulomb | Tresca | NoFriction, name: str, refinement: int = 1,
         gap: float | Profile | None = None, kind: str = "unilateral") -> Interface:
    """The interface of two sides, whose nodes are paired by position.

    Where the sides do not match as a whole, they may cover each other partly: then all nodes of either side that face
    the other one have a partner, and the others carry no row.

    Parameters
    ----------
    first, second : the sides
    friction : the law that the scene asks for; without friction there are no tangential unknowns
    name : of the contact
    refinement : how many times finer the meshes are than the given ones, whose spacing the tolerance follows
    gap : initial gap (m) in the place of the measured one; positive is open, negative an interference
    kind : "unilateral", or "bonded", whose gap is zero unless given

    Raises
    ------
    InputError
        when the two sides do not match node by node. Not collective.
    """
    try:
        opposite = _match_whole(first, second, name, refinement)
    except InputError:
        partly = _match_partly(first, second, refinement)
        if partly is None:
            raise
        opposite = partly
    return carry(opposite, friction, name, gap, kind)


def touch(side: Side, rigid: Plane | Circle, friction: Coulomb | Tresca | NoFriction, name: str,
          gap: float | Profile | None = None, kind: str = "unilateral") -> Interface:
    """The interface of a body, which is the first, and a rigid partner.

    Normals and gaps are those of the rigid surface at the body's nodes, exactly. Nodes that do not face it, such as
    the far side of a roller, carry no row. The second side has no nodes: the partner's displacement U gives
    `Interface.prescribed`.

    Parameters
    ----------
    side : of the body
    friction, name, gap, kind : as for `pair`

    Raises
    ------
    InputError
        when the body's boundary does not face the surface. Not collective.
    """
    outward, measured = _surface(rigid, side)
    measured = measured - _bulge(side, outward)
    measured[np.abs(measured) <= NO_GAP * side.spacing] = 0.0
    towards = (np.einsum("icj,ij->ic", outward[side.links], side.outward) < FACING).all(axis=1)  # links that face it
    here = np.unique(side.links[towards])
    if len(here) == 0:
        x, y = side.xy[np.argmin(np.einsum("ij,ij->i", outward, side.normal))]
        raise InputError(f"contact.{name}: near ({x:.6g}, {y:.6g}) the boundary of {side.body!r} does not face "
                         f"{rigid.name!r}" + ("; a plane's normal points towards the bodies" if isinstance(rigid, Plane)
                                              else "; bodies touch a circle from outside, unless inside = true"))
    partner = replace(side, body=rigid.name, modulus=np.inf, xy=side.xy - measured[:, None] * outward, normal=outward,
                      clamps=np.zeros_like(side.clamps))
    opposite = Opposite((side, partner), (here, here), -outward[here], side.lengths_over(towards)[here],
                        measured[here], towards)
    found = carry(opposite, friction, name, gap, kind)
    U, none = np.array(rigid.displacement), np.empty(0, int)
    fixed, probes = (replace(each, nodes=(each.nodes[0], none)) for each in (found.fixed, found.probes))
    return replace(found, nodes=(found.nodes[0], none), modulus=side.modulus, prescribed=-(found.directions @ U),
                   transfer=(found.transfer[0], sparse.csr_matrix((found.m, 0))), fixed=fixed, probes=probes,
                   displacement=U, history=rigid.history)


def carry(opposite: Opposite, friction: Coulomb | Tresca | NoFriction, name: str, gap: float | Profile | None,
          kind: str) -> Interface:
    """The interface whose rows stand at those nodes that a body can move. Otherwise as `pair`."""
    (first, second), (here, there) = opposite.sides, opposite.place
    normal = opposite.normal
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    start = initial_gap(gap, kind, opposite.gap, first.xy[here], first.arc[here])
    bonded = kind == "bonded"

    free = first.free[here], second.free[there]
    stays = [np.array([is_held(direction, each) for each in free]) for direction in (normal, tangent)]
    held_normal, held_tangential = (by_body.all(axis=0) for by_body in stays)  # where one body can move, they touch
    one_sided = [by_body.any(axis=0) for by_body in stays]
    dropped = held_normal & held_tangential if bonded else held_normal  # a bond also holds what slides
    keep = np.flatnonzero(~dropped)
    if len(keep) == 0:
        raise InputError(f"contact.{name}: all nodes of the contact are clamped; there is nothing to solve")
    has_tangents = bonded or not isinstance(friction, NoFriction)
    sliding = np.flatnonzero(~held_tangential[keep]) if has_tangents else np.empty(0, int)
    row = np.full(len(first.nodes), -1)
    row[here[keep]] = np.arange(len(keep))
    facets = row[first.links[opposite.common]]
    alone = sparse.identity(len(keep), format="csr")
    moves = sum(np.abs(normal * each).max(axis=1) for each in free) > SAME
    fixed, probes = (Places((first.nodes[here][at], second.nodes[there][at]), normal[at], gap_of[at])
                     for at, gap_of in ((dropped, start), (dropped & moves, np.maximum(start, 0.0))))
    xy, arc, area = first.xy[here][keep], first.arc[here][keep], opposite.area[keep]
    return Interface(
        name=name, bodies=(first.body, second.body), xy=xy, frame=np.stack([normal[keep], tangent[keep]], axis=1),
        area=area, gap=start[keep], arc=arc, nodes=(first.nodes[here][keep], second.nodes[there][keep]),
        transfer=(alone, alone), law=law_of(friction, xy, arc, area, sliding, kind),
        modulus=1.0 / (1.0 / first.modulus + 1.0 / second.modulus),
        facets=facets[(facets >= 0).all(axis=1)], laplacian=first.laplacian(opposite.common, row, len(keep)),
        one_sided=np.concatenate([one_sided[0][keep], one_sided[1][keep][sliding]]),
        prescribed=np.zeros(len(keep) + len(sliding)), at=(xy, second.xy[there][keep]),
        fixed=fixed, probes=probes)


def initial_gap(gap: float | Profile | None, kind: str, measured: np.ndarray, xy: np.ndarray,
                arc: np.ndarray) -> np.ndarray:
    """The initial gap (k,) at nodes `xy` (k, 2), at arc lengths (k,): given, else measured, or zero of a bond."""
    if isinstance(gap, Profile):
        return gap.at(xy, arc).astype(float)
    if gap is not None:
        return np.full(len(xy), float(gap))
    return np.zeros(len(xy)) if kind == "bonded" else measured


def _match_whole(first: Side, second: Side, name: str, refinement: int) -> Opposite:
    """All nodes of both sides, one to one. Raises InputError."""
    match = _opposite(first, second, name)
    normal = first.normal - second.normal[match]
    size = np.linalg.norm(normal, axis=1)
    if (size < 1.0).any():  # the outer normals must face each other (an angle above 120°)
        x, y = first.xy[np.argmin(size)]
        raise InputError(f"contact.{name}: near ({x:.6g}, {y:.6g}) the two boundaries do not face each other")
    normal /= size[:, None]
    gap, aside, spacing = _offset(first, second, np.arange(len(match)), match, normal)
    if (aside > LARGEST_OFFSET * refinement * spacing).any():
        raise InputError(f"contact.{name}: the nodes of the two sides do not lie opposite each other"
                         f"{_worst(first, second, match)}; their meshes must match node by node")
    here = np.arange(len(match))
    return Opposite((first, second), (here, match), normal, (first.area + second.area[match]) / 2,
                    _over_arcs(gap, first, second, here, match, normal), np.ones(len(first.links), bool))


def _match_partly(first: Side, second: Side, refinement: int) -> Opposite | None:
    """The nodes of the part that two sides have in common; None unless all nodes that face the other side pair off."""
    if first.links.shape[1] != second.links.shape[1]:
        return None
    nearest = cKDTree(second.xy).query(first.xy)[1]
    back = cKDTree(first.xy).query(second.xy)[1]
    here = np.flatnonzero(back[nearest] == np.arange(len(nearest)))  # nearest to each other
    there = nearest[here]
    common = _common_links(first, second, here, there)
    normal, apart = _common_normal(first, second, here, there, common)
    gap, aside, spacing = _offset(first, second, here, there, normal)
    deepest = -DEEPEST * np.minimum(np.abs(normal) @ first.extent, np.abs(normal) @ second.extent)
    fits = (aside <= LARGEST_OFFSET * refinement * spacing) & (apart < FACING) & (gap > deepest)
    here, there = here[fits], there[fits]
    if len(here) == 0:
        return None
    slack = 0.5 * LARGEST_OFFSET * refinement / (first.links.shape[1] - 1)  # the tolerance at an end, over the edge
    if any(_is_faced(side, np.setdiff1d(np.arange(len(side.nodes)), paired), other, slack)
           for side, paired, other in ((first, here, second), (second, there, first))):
        return None
    common = _common_links(first, second, here, there)
    normal, _ = _common_normal(first, second, here, there, common)
    gap, _, _ = _offset(first, second, here, there, normal)
    area = (first.lengths_over(common[0])[here] + second.lengths_over(common[1])[there]) / 2
    alone = area == 0.0  # no common edge: a contact of one node
    area[alone] = ((first.spacing[here] + second.spacing[there]) / 2)[alone]
    return Opposite((first, second), (here, there), normal, area,
                    _over_arcs(gap, first, second, here, there, normal), common[0])


def _common_links(first: Side, second: Side, here: np.ndarray, there: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Of each side (ns,) bool: links whose nodes are the partners of the nodes of a link of the other side."""
    partner = np.full(len(first.nodes), -1)
    partner[here] = there
    found = {tuple(sorted(link[:2])) + tuple(link[2:]): k for k, link in enumerate(second.links.tolist())}
    common = np.zeros(len(first.links), bool), np.zeros(len(second.links), bool)
    for k, link in enumerate(partner[first.links].tolist()):
        other = found.get(tuple(sorted(link[:2])) + tuple(link[2:]))
        if other is not None:
            common[0][k] = common[1][other] = True
    return common


def _common_normal(first: Side, second: Side, here: np.ndarray, there: np.ndarray,
                   common: tuple[np.ndarray, np.ndarray]) -> tuple[np.ndarray, np.ndarray]:
    """Unit normals (k, 2) of the common part, and the products (k,) of both sides' normals there."""
    own, other = first.normals_over(common[0])[here], second.normals_over(common[1])[there]
    normal = own - other
    size = np.linalg.norm(normal, axis=1, keepdims=True)
    return np.where(size > 0.0, normal / np.where(size > 0.0, size, 1.0), own), np.einsum("ij,ij->i", own, other)


def _is_faced(side: Side, places: np.ndarray, other: Side, slack: float) -> bool:
    """Whether one of the nodes at `places` has a part of the other side on its normal.

    The ends of the other side reach `slack` of an edge less far: so much an end may stand aside of its partner.
    """
    ends = np.bincount(other.links[:, :2].ravel(), minlength=len(other.nodes)) == 1
    low, high = (np.where(ends[column], slack, -NO_GAP) for column in other.links.T[:2])
    start, along, outward = other.xy[other.links[:, 0]], other.along, other.outward
    for xy, normal in zip(side.xy[places], side.normal[places], strict=True):
        towards = np.flatnonzero(outward @ normal < FACING)
        tangent = np.array([-normal[1], normal[0]])
        where = ((xy - start[towards]) @ tangent) / (along[towards] @ tangent)
        distance = (start[towards] + where[:, None] * along[towards] - xy) @ normal
        deepest = -DEEPEST * min(np.abs(normal) @ side.extent, np.abs(normal) @ other.extent)
        if ((where >= low[towards]) & (where <= 1.0 - high[towards]) & (distance > deepest)).any():
            return True
    return False


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


def _offset(first: Side, second: Side, here: np.ndarray, there: np.ndarray,
            normal: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The initial gap along the normals, how far partners lie aside of each other, and the spacing there, each (k,)."""
    distance = np.linalg.norm(np.diff(first.xy, axis=0), axis=1)
    spacing = np.zeros(len(first.nodes))
    spacing[1:] += np.where(first.joined, distance / 2, 0.0)
    spacing[:-1] += np.where(first.joined, distance / 2, 0.0)
    spacing = spacing[here]
    tangent = np.column_stack([-normal[:, 1], normal[:, 0]])
    offset = second.xy[there] - first.xy[here]
    gap = np.einsum("ij,ij->i", offset, normal)
    aside = np.abs(np.einsum("ij,ij->i", offset, tangent))
    gap[np.abs(gap) <= NO_GAP * spacing] = 0.0
    return gap, aside, spacing


def _over_arcs(gap: np.ndarray, first: Side, second: Side, here: np.ndarray, there: np.ndarray,
               normal: np.ndarray) -> np.ndarray:
    """The gap (k,) between the boundaries that are meant, where `gap` is that between the nodes.

    Corners lie on these boundaries, middles of quadratic sides on their chords or, if they are curved, near them.
    """
    found = gap.copy()
    for side, places, outward in ((first, here, normal), (second, there, -normal)):
        place = np.full(len(side.nodes), -1)
        place[places] = np.arange(len(places))
        links = np.flatnonzero(place[side.links[:, -1]] >= 0) if len(side.edges) else np.empty(0, int)
        node = place[side.links[links, -1]]
        found[node] -= side.rises(links, outward[node])
    found[np.abs(found) <= NO_GAP * first.spacing[here]] = 0.0
    return found


def is_held(direction: np.ndarray, free: np.ndarray) -> np.ndarray:
    """Whether a clamp takes the motion along `direction` (m, 2).

    With one component free, the unknown along the direction nearest to it stays.
    """
    return np.linalg.norm(direction * free, axis=1) < np.where(free.all(axis=1), 0.0, np.sqrt(0.5) - 1e-9)


def _worst(first: Side, second: Side, match: np.ndarray) -> str:
    distance = np.linalg.norm(second.xy[match] - first.xy, axis=1)
    k = int(np.argmax(distance))
    (x, y), (X, Y) = first.xy[k], second.xy[match[k]]
    return f" (worst: ({x:.6g}, {y:.6g}) against ({X:.6g}, {Y:.6g}))"


def _surface(rigid: Plane | Circle, side: Side) -> tuple[np.ndarray, np.ndarray]:
    """The surface's unit normal (k, 2), which points to the bodies, and the distance along it (k,), at a side's nodes.

    In the centre of a circle, which has no normal, it is the body's.
    """
    if isinstance(rigid, Plane):
        normal = np.array(rigid.normal) / np.linalg.norm(rigid.normal)
        return np.tile(normal, (len(side.xy), 1)), (side.xy - rigid.point) @ normal
    away = side.xy - np.array(rigid.center)
    distance = np.linalg.norm(away, axis=1)
    sign = -1.0 if rigid.inside else 1.0
    outward = np.where(distance[:, None] > 0.0, sign * away / np.where(distance > 0.0, distance, 1.0)[:, None],
                       -side.normal)
    return outward, sign * (distance - rigid.radius)


def _bulge(side: Side, outward: np.ndarray) -> np.ndarray:
    """How far (k,) a curved boundary stands closer to the surface than the middles of its sides do.

    Corners lie on the boundary that is meant, middles on the chord or, if the side is curved, near that boundary. The
    slopes at the ends of a chord give its arc, exactly where the boundary is a circle. At an end of the boundary, or a
    sharp corner, the other end's slope counts.
    """
    found = np.zeros(len(side.nodes))
    if not len(side.edges):
        return found
    middle, outer = side.links[:, 2], side.outward
    arrow = 0.5 * np.linalg.norm(side.along, axis=1) * np.tan(side.slopes.sum(axis=1) / 4)
    found[middle] = (side.heights - arrow) * np.einsum("ij,ij->i", outer, outward[middle])
    return found
