"""Where a body's mesh is not connected as it looks: nodes that are not merged, nodes on sides of cells that have no
node there, and sides within other cells.

A seam is where two facets of the boundary lie on each other, turned against each other, or on one curve or smooth
surface. Bodies that only touch themselves in a corner or along an edge have none.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy.sparse as sparse

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import SHARPEST, corner_normals
from ddmpi.mesh.elements import normals
from ddmpi.mesh.mesh import Mesh, connected
from ddmpi.sets import magnitude
from ddmpi.surface.near import contained, most_inside
from ddmpi.surface.side import dot, unit
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import SAME, across, in_words, nearest_in

AGAINST = 0.7
"""Facets are turned against each other if the cosine of the angle of their normals is below this,
negative."""

INNER = 0.8
"""Points of a facet that are looked at: its centre, and one near each corner, with this share of it."""

SINGLE, WIDE = 2.0**-22, 1e-3
"""Coordinates in single precision are equal up to this fraction of the largest one; but no more than this fraction of
a side."""

FIT = 0.25
"""Two curved facets lie on one curve up to this fraction of how far it is from them."""

BELOW = 0.01
"""How far below the middle of a facet its cell is looked at, as a part of the way to the centre."""


@dataclass(frozen=True)
class Seam:
    """Where a body's mesh is not connected as it looks.

    Attributes
    ----------
    doubled : how many nodes at corners of cells lie where another one does: of two in one place one counts
    hanging : how many of these lie on a facet that has no node there
    within : how many facets have their middle within another cell
    place : (d,) of one of these (m)
    """

    doubled: int
    hanging: int
    within: int
    place: np.ndarray

    def words(self, name: str) -> Doubt:
        """A warning of it, for a body of this name."""
        said = []
        for count, one, several, where in (
            (
                self.doubled,
                "node lies",
                "nodes lie",
                "in one place with another and not merged with it",
            ),
            (self.hanging, "node lies", "nodes lie", "on a side of a cell that has no node there"),
            (self.within, "side of a cell lies", "sides of cells lie", "within another cell"),
        ):
            if count:
                said.append(f"{count} {one if count == 1 else several} {where}")
        text = (
            f"body.{name}.mesh: {' and '.join(said)}, as at {in_words(self.place, 4)}: the sides that "
            "meet there are not connected, and may open or pass through each other; connect them in "
            "the mesh (gmsh: Coherence, or BooleanFragments before meshing), or, where the body may "
            "open, name both in a contact of the body with itself"
        )
        return Doubt(text, "seam", self.doubled + self.hanging + self.within)


class Skin:
    """Facets (f, d) of a boundary, which stand for the smooth surface through their corners.

    Attributes
    ----------
    ends : (f, d, d) their corners (m)
    normal : (f, d) outer unit normals
    close : (f,) what lies apart by less is in one place (m)
    """

    def __init__(self, points: np.ndarray, facets: np.ndarray) -> None:
        self.points, self.facets, self.ends = points, facets, points[facets]
        self.normal = unit(normals(self.ends))
        sides = magnitude(self.ends - np.roll(self.ends, 1, axis=1)).min(axis=1)
        rounding = SINGLE * magnitude(self.ends).max()
        self.close = np.clip(rounding, SAME * sides, WIDE * sides)
        self._pairs = np.triu_indices(facets.shape[1], 1)

    @cached_property
    def _bulge(self) -> np.ndarray:
        """(f, e) the curvature along the edges times half of their squared lengths (m), positive where convex."""
        count, d = self.facets.shape
        ends = np.arange(0, count * d + 1, d)
        nodes = sparse.csr_matrix((np.ones(count * d), self.facets.ravel(), ends))
        pairs = np.stack((nodes @ nodes.T).nonzero(), axis=1)
        turned = dot(*self.normal[pairs.T])
        patch = connected(pairs[turned > np.cos(SHARPEST)], count)
        # a node has a normal in each smooth patch that it is of
        corners = np.stack(np.broadcast_arrays(self.facets, patch[:, None]), axis=2).reshape(-1, 2)
        own, number = np.unique(corners, axis=0, return_inverse=True)
        number = number.reshape(self.facets.shape)
        normal = corner_normals(self.points[own[:, 0]], number)[number]
        i, j = self._pairs
        along = self.ends[:, j] - self.ends[:, i]
        return 0.5 * np.einsum("fed,fed->fe", normal[:, j] - normal[:, i], along)

    @cached_property
    def room(self) -> np.ndarray:
        """(f,) at most so far is the smooth surface from the facets (m)."""
        return np.abs(self._bulge).sum(axis=1) / 4.0

    @property
    def hollow(self) -> np.ndarray:
        """(f,) at most so far is the smooth surface inside of the facets (m)."""
        return np.maximum(-self._bulge, 0.0).sum(axis=1) / 4.0

    def height(self, facet: np.ndarray, part: np.ndarray) -> np.ndarray:
        """(k, d) from some facets (k,) to the smooth surface, at barycentric coordinates (k, d − 1) of all corners but
        the first (m).

        Of a sphere of radius R it is Σ λ_i λ_j |x_i − x_j|² / 2 R along the normal.
        """
        whole = np.column_stack([1.0 - part.sum(axis=1), part])
        i, j = self._pairs
        size = (whole[:, i] * whole[:, j] * self._bulge[facet]).sum(axis=1)
        return size[:, None] * self.normal[facet]


def find_seam(mesh: Mesh, groups: Collection[str] = (), name: str = "") -> Seam | None:
    """Where the boundary of a mesh lies on itself or in other cells, or None. Not collective.

    Facets do not count if these and those that lie on them belong to `groups`, as the lips of a crack that contacts or
    loads name; a group of both lips only where it is of nothing else. Raises InputError, naming the body, for cells
    that lie on each other.
    """
    straight = mesh.cell.facet.straight
    facets = straight.split(mesh.boundary[0])
    skin = Skin(mesh.points, facets)
    near = _lying(skin, mesh, name)
    named, seam = np.zeros(len(facets), bool), np.zeros(len(facets), bool)
    seam[near] = True
    for group in groups:
        own = np.zeros(len(mesh.boundary[0]), bool)
        own[mesh.facets(group).numbers] = True
        own = np.tile(own, len(straight.parts))
        if seam[own].all() or not own[near].all(axis=1).any():
            named |= own
    near = near[~named[near].all(axis=1)]
    doubled, hanging, nodes = _nodes_of(skin, np.concatenate([near, near[:, ::-1]]))
    within = _within(mesh, skin)
    places = np.concatenate([mesh.points[nodes], within])
    return Seam(doubled, hanging, len(within), places[0]) if len(places) else None


def _lying(skin: Skin, mesh: Mesh, name: str) -> np.ndarray:
    """Pairs (p, 2) of facets, the first of which lies on the second, turned against it. Raises InputError for facets
    that lie on each other and are turned alike."""
    d = skin.facets.shape[1]
    shares = np.vstack(
        [np.full(d, 1.0 / d), np.eye(d) * INNER + (1.0 - np.eye(d)) * (1.0 - INNER) / (d - 1)]
    )
    own, share = (each.ravel() for each in np.indices((len(skin.ends), len(shares))))
    points = np.einsum("pk,pkd->pd", shares[share], skin.ends[own])
    points += skin.height(own, shares[share, 1:])
    reach = (skin.close + (1.0 + FIT) * skin.room)[:, None]
    point, other = contained(points, skin.ends.min(axis=1) - reach, skin.ends.max(axis=1) + reach)
    own, points = own[point], points[point]
    turned = dot(skin.normal[own], skin.normal[other])
    some = np.flatnonzero((own != other) & (np.abs(turned) > AGAINST))
    own, other, points, turned = own[some], other[some], points[some], turned[some]
    aside, part = across(points - skin.ends[other, 0], skin.ends[other])
    away = magnitude(aside - skin.height(other, part))
    lies = (part >= -SAME).all(axis=1) & (part.sum(axis=1) <= 1.0 + SAME)
    near = np.minimum(skin.close[own], skin.close[other])
    alike = lies & (turned > 0.0) & (away <= near)
    if alike.any():
        raise InputError(
            f"body.{name}.mesh has {mesh.cell.names} that lie on each other, as at "
            f"{in_words(points[alike.argmax()], 4)}: two of its parts are in one place, and not merged"
        )
    against = lies & (turned < 0.0) & (away <= near + FIT * (skin.room[own] + skin.room[other]))
    return np.unique(np.column_stack([own, other])[against], axis=0)


def _nodes_of(skin: Skin, pairs: np.ndarray) -> tuple[int, int, np.ndarray]:
    """How many nodes of a seam are doubled, how many hang, and all of them, by `pairs` (p, 2) of facets that lie on
    each other, each in both orders."""
    x, (one, two) = skin.points, skin.facets[pairs].swapaxes(0, 1)
    close = skin.close[pairs].min(axis=1)
    away = magnitude(x[one][:, :, None] - x[two][:, None])  # (p, d, d)
    same = one[:, :, None] == two[:, None]
    equal = (away <= close[:, None, None]) & ~same
    i, j = (nodes[equal] for nodes in np.broadcast_arrays(one[:, :, None], two[:, None]))
    doubled = np.unique(np.concatenate([i, j]))
    places = np.unique(connected(np.column_stack([i, j]), len(x))[doubled])
    rest = np.flatnonzero(~np.isin(one, doubled) & ~same.any(axis=2))
    pair, node = rest // one.shape[1], one.ravel()[rest]
    facet = pairs[pair, 1]
    place = nearest_in(x[node], skin.ends[facet])
    part = across(place - skin.ends[facet, 0], skin.ends[facet])[1]
    off = magnitude(place + skin.height(facet, part) - x[node])
    hanging = np.unique(node[off <= close[pair] + FIT * skin.room[pairs[pair]].sum(axis=1)])
    return len(doubled) - len(places), len(hanging), np.concatenate([doubled, hanging])


def _within(mesh: Mesh, skin: Skin) -> np.ndarray:
    """(k, d) the middles of facets that lie within cells that have no node of them, deeper than curvature explains."""
    middle, cells = skin.ends.mean(axis=1), mesh.cell.straight.split(mesh.corners)
    # what lies on sides of other cells lies in one of them a little further inward, not along a side
    corners = mesh.corners[mesh.boundary[1]]
    inner = np.average(mesh.points[corners], axis=1, weights=1.0 + np.arange(corners.shape[1]))
    inner = np.tile(inner, (len(middle) // len(inner), 1))
    inward = inner - middle
    places, around = np.concatenate([middle, middle + BELOW * inward]), np.tile(skin.facets, (2, 1))
    share, cell = most_inside(places, mesh.points[cells.T], (around, cells))
    some = np.flatnonzero(share > SAME)
    x = mesh.points[cells[cell[some]]]
    slopes = np.linalg.inv(x[:, 1:] - x[:, :1])  # ∇λ of all corners but the first
    slopes = np.concatenate([slopes, slopes.sum(axis=2, keepdims=True)], axis=2)
    height = 1.0 / np.linalg.norm(slopes, axis=1).max(axis=1)  # the least of the cell
    own = some % len(middle)
    deep = share[some] * height > skin.close[own] + 2.0 * skin.room[own]
    return middle[np.unique(own[deep])]
