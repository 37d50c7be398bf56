"""Where a body's mesh is not connected as it looks: nodes that are not merged, and nodes on sides of cells
that have no node there.

A seam is where two facets of the boundary lie on each other, turned against each other. Bodies that
only touch themselves in a corner or along an edge have none.
"""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.errors import InputError
from ddmpi.mesh.elements import normals
from ddmpi.mesh.mesh import Mesh
from ddmpi.surface.near import contained
from ddmpi.system.numbers import SAME, across, in_words, nearest_in

AGAINST = 0.7
"""Facets are turned against each other if the cosine of the angle of their normals is below this,
negative."""

INNER = 0.8
"""Points of a facet that are looked at: its centre, and one near each corner, with this share of it."""


@dataclass(frozen=True)
class Seam:
    """Where facets of a body's boundary lie on each other.

    Attributes
    ----------
    doubled : how many nodes lie where another one does: of two nodes in one place one counts
    hanging : how many nodes lie on a facet that has no node there
    place : (d,) of one of these nodes (m)
    """

    doubled: int
    hanging: int
    place: np.ndarray

    def words(self, name: str) -> str:
        """A warning of it, for a body of this name."""
        said = []
        if self.doubled:
            lie = "node lies" if self.doubled == 1 else "nodes lie"
            said.append(f"{self.doubled} {lie} in one place with another and not merged with it")
        if self.hanging:
            lie = "node lies" if self.hanging == 1 else "nodes lie"
            said.append(f"{self.hanging} {lie} on a side of a cell that has no node there")
        return (
            f"body.{name}.mesh: {' and '.join(said)}, as at {in_words(self.place, 4)}: the sides that "
            "meet there are not connected, and may open or pass through each other; connect them in "
            "the mesh (gmsh: Coherence, or BooleanFragments before meshing), or, where the body may "
            "open, make two bodies of it with a contact between them"
        )


def find_seam(mesh: Mesh, groups: Collection[str] = (), name: str = "") -> Seam | None:
    """Where the boundary of a mesh lies on itself, or None. Not collective.

    Facets do not count if these and those that lie on them belong to `groups`, as the lips of a crack
    that contacts or loads name. Raises InputError, naming the body, for cells that lie on each other.
    """
    d, cell = mesh.dimension, mesh.cell.facet
    facets = cell.split(mesh.boundary[0])
    ends = mesh.points[facets]
    normal = normals(ends)
    normal /= np.linalg.norm(normal, axis=1)[:, None]
    sides = np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2)
    close, room = SAME * sides.min(axis=1), _sagittas(mesh, facets, ends, normal)
    surface = surfaces(facets, len(mesh.points)) if room.any() else np.zeros(len(facets), int)
    shares = np.vstack(
        [np.full(d, 1.0 / d), np.eye(d) * INNER + (1.0 - np.eye(d)) * (1.0 - INNER) / (d - 1)]
    )
    points = np.einsum("qk,fkd->fqd", shares, ends).reshape(-1, d)
    reach = (close + room)[:, None]
    point, other = contained(points, ends.min(axis=1) - reach, ends.max(axis=1) + reach)
    own = point // len(shares)
    turned = np.einsum("pd,pd->p", normal[own], normal[other])
    apart = surface[own] != surface[other]
    near = np.minimum(close[own], close[other]) + np.where(apart, room[own] + room[other], 0.0)
    some = (own != other) & (np.abs(turned) > AGAINST)
    away = np.abs(np.einsum("pd,pd->p", points[point] - ends[other, 0], normal[other]))
    some = np.flatnonzero(some & (away <= near))
    point, other, own, turned, away = (part[some] for part in (point, other, own, turned, away))
    part = across(points[point] - ends[other, 0], ends[other])[1]
    lies = (part >= -SAME).all(axis=1) & (part.sum(axis=1) <= 1.0 + SAME)
    alike = lies & (turned > 0.0) & (away <= close[own])
    _refuse_doubled(points[point], alike, mesh, name)
    pairs = np.unique(np.column_stack([own, other])[lies & (turned < 0.0)], axis=0)
    if not len(pairs):
        return None
    named = np.zeros(len(mesh.points), bool)
    for group in groups:
        named[mesh.facets(group).nodes] = True
    pairs = pairs[~named[facets[pairs]].all(axis=(1, 2))]
    pairs = np.unique(np.concatenate([pairs, pairs[:, ::-1]]), axis=0)
    return _nodes_of(
        mesh,
        facets,
        pairs,
        close,
        np.where(surface[pairs[:, 0]] != surface[pairs[:, 1]], room[pairs].sum(axis=1), 0.0),
    )


def _nodes_of(
    mesh: Mesh, facets: np.ndarray, pairs: np.ndarray, close: np.ndarray, room: np.ndarray
) -> Seam | None:
    """The nodes of a seam, by `pairs` (p, 2) of facets that lie on each other, each in both orders; they may be
    farther apart than `close` (f,) by `room` (p,)."""
    x, (one, two) = mesh.points, facets[pairs].swapaxes(0, 1)
    near = close[pairs].min(axis=1)
    away = np.linalg.norm(x[one][:, :, None] - x[two][:, None], axis=3)  # (p, d, d)
    same = one[:, :, None] == two[:, None]
    equal = (away <= near[:, None, None]) & ~same
    i, j = (nodes[equal] for nodes in np.broadcast_arrays(one[:, :, None], two[:, None]))
    doubled = np.unique(np.concatenate([i, j]))
    links = sparse.coo_matrix((np.ones(len(i)), (i, j)), (len(x), len(x)))
    clusters = (
        len(np.unique(csgraph.connected_components(links, directed=False)[1][doubled]))
        if len(i)
        else 0
    )
    rest = np.flatnonzero(~np.isin(one, doubled) & ~same.any(axis=2))
    k, node = rest // one.shape[1], one.ravel()[rest]
    on = np.linalg.norm(nearest_in(x[node], x[two[k]]) - x[node], axis=1) <= near[k] + room[k]
    hanging = np.unique(node[on])
    if not len(doubled) and not len(hanging):
        return None
    return Seam(
        len(doubled) - clusters, len(hanging), x[doubled[0] if len(doubled) else hanging[0]]
    )


def _refuse_doubled(points: np.ndarray, wrong: np.ndarray, mesh: Mesh, name: str) -> None:
    """Raise InputError where facets lie on each other and are turned alike, at some `points` (p, d)."""
    if wrong.any():
        raise InputError(
            f"body.{name}.mesh has {mesh.cell.names} that lie on each other, as at "
            f"{in_words(points[wrong.argmax()], 4)}: two of its parts are in one place, and not merged"
        )


def _sagittas(mesh: Mesh, facets: np.ndarray, ends: np.ndarray, normal: np.ndarray) -> np.ndarray:
    """(f,) how far a curved boundary may be from its facets (m), zero where it is plane or has a corner."""
    mean = np.zeros_like(mesh.points)
    for corner in facets.T:
        np.add.at(mean, corner, normal)
    mean = mean[facets]
    mean /= np.maximum(np.linalg.norm(mean, axis=2), np.finfo(float).tiny)[:, :, None]
    smooth = np.einsum("fkd,fd->fk", mean, normal) > np.cos(0.5)  # (rad)
    along = ends.mean(axis=1)[:, None] - ends
    off = np.abs(np.einsum("fkd,fkd->fk", mean - normal[:, None], along))
    off = np.where(smooth, off, 0.0).max(axis=1)
    return np.where(off > SAME * np.linalg.norm(along, axis=2).max(axis=1), off, 0.0)


def surfaces(facets: np.ndarray, size: int) -> np.ndarray:
    """(f,) the number of the connected surface that each facet (f, d) belongs to, or piece, of cells (f, d + 1), with
    nodes below `size`."""
    i, j = facets[:, :-1].ravel(), facets[:, 1:].ravel()
    links = sparse.coo_matrix((np.ones(len(i)), (i, j)), (size, size))
    return csgraph.connected_components(links, directed=False)[1][facets[:, 0]]
