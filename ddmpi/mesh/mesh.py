"""The mesh of one body: nodes, cells and named groups.

Cells are triangles in the plane and tetrahedra in space. Those of order 2 also have a node at the middle of each edge.
Where it is off the midpoint of the chord, the edge is curved: the parabola through its three nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import NamedTuple, TypeVar

import numpy as np
import scipy.sparse as sparse
from scipy.sparse import csgraph

from ddmpi.errors import InputError, nearest
from ddmpi.mesh.elements import Cell, Mapped, cell_with, cross
from ddmpi.system.numbers import Frame, in_words

T = TypeVar("T")

Groups = dict[str, np.ndarray]
"""By name the members of groups: facets, lines or cells, by their nodes or numbers, or nodes."""

MEASURE = ("", "length", "area", "volume")
"""Measure of cells, by dimension."""

PHYSICAL = ("physical point", "physical curve", "physical surface", "physical volume")
"""Gmsh's names of groups, by dimension."""

BLOCK = 2048
"""Number of curved cells per block of work, so that their data stay in the processor's cache."""


Outer = tuple[np.ndarray, np.ndarray]
"""The facets (f, l) of a boundary, turned outward, and their cells (f,)."""


class Facets(NamedTuple):
    """A part of a body's boundary, such as a group.

    Attributes
    ----------
    nodes : (k, l) of the facets, turned outward: in the plane the body lies to their left, in space they are
        counter-clockwise from outside
    cells : (k,) the cell of each
    starts : (k,) the node that each began with before it was turned
    numbers : (k,) of each in the boundary of the mesh
    """

    nodes: np.ndarray
    cells: np.ndarray
    starts: np.ndarray
    numbers: np.ndarray


class Face(NamedTuple):
    """A numbered curve, or face of a solid, of a drawing.

    Attributes
    ----------
    kind : gmsh's word, such as "plane", "cylinder" or "line"
    radius : of a circle, a cylinder, a sphere, and of the tube of a torus (m); of others 0
    measure : its length (m) or area (m²)
    place : the middle of its box (m)
    words : by which a scene names it, see `forms.FORM`; of a copy those of its original
    axis : of a cylinder the ends of its axis (m), else empty
    """

    kind: str
    radius: float
    measure: float
    place: tuple[float, ...]
    words: str = ""
    axis: tuple[tuple[float, ...], ...] = ()


Faces = dict[str, Face]
"""Numbered curves or faces by their names."""


@dataclass(frozen=True)
class Mesh:
    """Triangles or tetrahedra of one body. Not distributed; every array is local to the body.

    Attributes
    ----------
    points : (nv, d) float, metres
    triangles : (nt, k) int, the nodes of the cells in the order of `elements.CELLS`; triangles are counter-clockwise,
        and so are the first three corners of a tetrahedron, seen from inside
    groups : name → (·, l) int, the facets of each physical group of the boundary
    vertices : name → (k,) int, the nodes of each physical point
    surfaces : name → (k,) int, the cells of each physical surface or volume
    cut : how many cells of a file were cut into triangles or tetrahedra
    curves : name → (·, 2 or 3) int, in space the lines of each physical curve
    axisymmetric : whether integrals are over the rings of revolution of the cells around x = 0
    faces : name → what the drawing says of the groups that are numbered curves or faces of it
    integration : of bricks, "full", "modes" or "reduced", see `cell_with`; by default with modes, around an axis full

    >>> mesh = Mesh(np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]]), np.array([[0, 1, 2]]), {"base": np.array([[0, 1]])})
    >>> mesh.cell.title, mesh.measures().tolist(), mesh.boundary[0].tolist()
    ('linear triangles', [1.0], [[0, 1], [1, 2], [2, 0]])
    """

    points: np.ndarray
    triangles: np.ndarray
    groups: Groups
    vertices: Groups = field(default_factory=dict)
    surfaces: Groups = field(default_factory=dict)
    cut: int = 0
    curves: Groups = field(default_factory=dict)
    axisymmetric: bool = False
    faces: Faces = field(default_factory=dict)
    integration: str = ""

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point."""
        return self.points.shape[1]

    @property
    def order(self) -> int:
        """1, linear, or 2, quadratic elements."""
        return self.cell.order

    @property
    def cell(self) -> Cell:
        """The reference cell."""
        usual = "full" if self.axisymmetric else "modes"
        return cell_with(self.triangles.shape[1], self.dimension, self.integration or usual)

    @property
    def corners(self) -> np.ndarray:
        """(nt, c) the nodes at the corners of the cells."""
        return self.triangles[:, : self.cell.corners]

    @cached_property
    def curved(self) -> np.ndarray:
        """(nc,) the numbers of the cells that are curved."""
        # Nearly all edges of most meshes are straight to the last bit; only the others need the tolerance.
        off = np.zeros(len(self.triangles), bool)
        for first in range(0, len(off), BLOCK):
            nodes = self.triangles[first : first + BLOCK].T
            for x in self.points.T:
                straight = x[nodes[self.cell.between]].mean(axis=1)
                off[first : first + BLOCK] |= (x[nodes[self.cell.corners :]] != straight).any(
                    axis=0
                )
        cells = np.flatnonzero(off)
        return cells[self.cell.bends(self.points[self.triangles[cells]]).any(axis=(1, 2))]

    @cached_property
    def _sides(self) -> tuple[Outer, np.ndarray]:
        alone, beside = _facets(self.triangles, self.dimension)
        return alone, connected(beside, len(self.triangles))

    @property
    def boundary(self) -> Outer:
        """`boundary_facets` of all cells."""
        return self._sides[0]

    @property
    def parts(self) -> np.ndarray:
        """(nt,) the number of the part that each cell is of: those of a part are connected by common facets."""
        return self._sides[1]

    @cached_property
    def pieces(self) -> int:
        """How many pieces have no node in common."""
        links = self.corners[:, [[k, k + 1] for k in range(self.cell.corners - 1)]].reshape(-1, 2)
        return len(np.unique(connected(links, len(self.points))[self.corners]))

    @cached_property
    def _resolved(self) -> dict[str, Facets]:
        return {}

    @property
    def home(self) -> Mesh:
        """The mesh that this one is a shift of, by which bodies are alike; by default itself."""
        return vars(self).get("_home", self)

    def shifted(self, shift: Sequence[float]) -> Mesh:
        """The same mesh elsewhere, by a shift (d,) in metres. What no shift changes is found once for all."""
        other = self._moved(Frame.of(shift))
        vars(other).update(_home=self.home)
        return other

    def turned(self, turned: np.ndarray) -> Mesh:
        """The same mesh after a rotation (d, d) about the origin, itself where it is none. What no motion changes is
        found once for all."""
        return (
            self
            if (turned == np.eye(self.dimension)).all()
            else self._moved(Frame(np.zeros(self.dimension), turned))
        )

    def _moved(self, frame: Frame) -> Mesh:
        """The mesh where a frame takes it."""
        faces = {
            name: face._replace(
                place=tuple(frame.at(np.array(face.place)).tolist()),
                axis=tuple(tuple(frame.at(np.array(end)).tolist()) for end in face.axis),
            )
            for name, face in self.faces.items()
        }
        other = replace(self, points=frame.at(self.points), faces=faces)
        vars(other).update(
            {name: getattr(self, name) for name in ("_sides", "_resolved", "curved")}
        )
        return other

    def regrouped(self, groups: Groups, curves: Groups, vertices: Groups) -> Mesh:
        """The same cells with other groups of the boundary, which is not looked for again."""
        other = replace(self, groups=groups, curves=curves, vertices=vertices)
        found = vars(self)
        vars(other).update({name: found[name] for name in ("_sides", "curved") if name in found})
        return other

    def once(self, find: Callable[[Mesh], T]) -> T:
        """What a function finds of a mesh and no shift changes: found at home, once for all shifts."""
        found = vars(self.home).setdefault("_found", {})
        if find not in found:
            found[find] = find(self.home)
        return found[find]

    def facets(self, name: str) -> Facets:
        """The boundary group `name`, resolved at the first call. Raises InputError where there is no such group, where
        it has no facets, or inner ones."""
        if name not in self._resolved:
            self._resolved[name] = turn_outward(self, self._group(name))
        return self._resolved[name]

    def _group(self, name: str) -> np.ndarray:
        """The facets (k, l) of a boundary group as the mesh has them. Raises InputError."""
        d = self.dimension
        of = ", ".join(sorted(self.groups))
        if name not in self.groups:
            for what, names in zip(PHYSICAL, (self.vertices, self.curves), strict=False):
                if name in names:
                    raise InputError(
                        f"{name!r} is a {what} of the mesh, which only a clamp may name; where a force "
                        "acts on it, the displacement has no limit as the mesh gets finer"
                    )
            if name in self.surfaces:
                raise InputError(
                    f"{name!r} is a {PHYSICAL[d]} of the mesh, not a boundary group; these are {of} "
                    f"(a boundary needs a name that no {PHYSICAL[d]} has)"
                )
            raise InputError(
                f"the mesh has no boundary group {name!r}{nearest(name, list(self.groups))} (it has {of})"
            )
        if len(self.groups[name]) == 0:
            raise InputError(
                f"the boundary group {name!r} of the mesh has a name, but no {self.cell.facet.names}"
            )
        return self.groups[name]

    def nodes_of(self, name: str) -> np.ndarray:
        """Nodes (k,) of the boundary group, physical curve or point `name`, or of a set of nodes, which may be of all
        three kinds. Raises InputError where it is none, or has nodes that the elements have not."""
        kinds = (PHYSICAL[1], self.curves), (PHYSICAL[0], self.vertices)
        found = [(what, names[name].ravel()) for what, names in kinds if name in names]
        if not found or name in self.groups:
            found.append(("", self._group(name).ravel()))
        nodes = np.unique(np.concatenate([members for _, members in found]))
        if len(nodes) == 0:
            raise InputError(
                f"the {found[0][0]} {name!r} of the mesh is at none of its {self.cell.names}"
            )
        if nodes[0] < 0:
            raise InputError(
                f"{name!r} has nodes in the middle of edges, which linear elements do not have; give the "
                "mesh order = 2"
            )
        return nodes

    @property
    def summed(self) -> np.ndarray:
        """(nc,) the cells whose integrals need quadrature: curved ones, around an axis all, and all that are no simplices."""
        affine = self.cell.simplex and not self.axisymmetric
        return self.curved if affine else np.arange(len(self.triangles))

    @property
    def on_axis(self) -> np.ndarray:
        """(nv,) bool, nodes on an axis of revolution, which cannot move radially."""
        return (self.points[:, 0] == 0.0) & self.axisymmetric

    @property
    def strains(self) -> int:
        """n, of the tensors (n, n) of strain and stress: 3 around an axis, with the circumferential ones, else d."""
        return self.dimension + self.axisymmetric

    def summed_blocks(self) -> list[np.ndarray]:
        """The numbers of the `summed` cells, BLOCK at a time."""
        cells = self.summed
        return [cells[start : start + BLOCK] for start in range(0, len(cells), BLOCK)]

    def map(self, cells: np.ndarray | slice, hats: np.ndarray) -> Mapped:
        """Cells (numbers or a slice), curved or not, at their points with `hats` (q, c)."""
        return self.cell.map(self.points[self.triangles[cells]], hats, self.axisymmetric)

    def measures(self) -> np.ndarray:
        """(nt,) areas or volumes of the cells, around an axis those of rings (m² or m³)."""
        measures = signed_measures(self.points, self.corners)
        points, weights = self.cell.quadrature
        for cells in self.summed_blocks():
            measures[cells] = weights @ self.map(cells, points).measures
        return measures

    @property
    def extent(self) -> float:
        """The largest distance between two nodes, or nearly so (m); of a box its diagonal."""
        far = self.points[np.linalg.norm(self.points - self.points.mean(axis=0), axis=1).argmax()]
        return float(np.linalg.norm(self.points - far, axis=1).max())


def bare(mesh: Mesh) -> Mesh:
    """The mesh without names, of which others are made with cells alike."""
    return Mesh(
        mesh.points,
        mesh.triangles,
        {},
        axisymmetric=mesh.axisymmetric,
        integration=mesh.integration,
    )


def boundary_facets(cells: np.ndarray, dimension: int) -> Outer:
    """The facets (f, l) that belong to only one of the cells (nt, k), turned outward, and their cells (f,)."""
    return _facets(cells, dimension)[0]


def _facets(cells: np.ndarray, dimension: int) -> tuple[Outer, np.ndarray]:
    """What `boundary_facets` gives, and the pairs (i, 2) of cells that have a facet in common."""
    cell = cell_with(cells.shape[1], dimension)
    facets = cells[:, cell.facets].reshape(-1, cell.facets.shape[1])
    corners = np.sort(facets[:, : cell.straight.facets.shape[1]], axis=1).T
    order = np.lexsort(corners)
    new = (np.diff(corners[:, order], prepend=-1, append=-1) != 0).any(axis=0)
    alone = np.sort(order[new[:-1] & new[1:]])
    beside = np.flatnonzero(~new[1:-1])
    pairs = np.stack([order[beside], order[beside + 1]], axis=1) // len(cell.facets)
    return (facets[alone], alone // len(cell.facets)), pairs


def connected(links: np.ndarray, count: int) -> np.ndarray:
    """(count,) the number of the component that each node of a graph with these `links` (k, 2) is of."""
    graph = sparse.coo_matrix((np.ones(len(links), np.int8), links.T), (count, count))
    return csgraph.connected_components(graph, directed=False)[1]


def turn_outward(mesh: Mesh, facets: np.ndarray) -> Facets:
    """Facets (k, l) on the boundary of a mesh. Raises InputError for inner ones."""
    outer, owners = mesh.boundary
    corners = mesh.cell.straight.facets.shape[1]
    marked = np.zeros(len(mesh.points), dtype=bool)
    marked[facets] = True
    near = np.flatnonzero(marked[outer].all(axis=1))
    outer = outer[near]
    owners = owners[near]
    # a facet is found on the boundary by the set of its corners, whatever their order
    _, number = np.unique(
        np.sort(np.concatenate([outer[:, :corners], facets[:, :corners]])),
        axis=0,
        return_inverse=True,
    )
    place = np.full(len(number), -1)
    place[number.ravel()[: len(outer)]] = np.arange(len(outer))
    at = place[number.ravel()[len(outer) :]]
    if (at < 0).any():
        inner = in_words(mesh.points[facets[at < 0][0, :corners]].mean(axis=0))
        raise InputError(
            f"the group has {mesh.cell.facet.names} that are not on the body's boundary, as at {inner}"
        )
    return Facets(outer[at], owners[at], facets[:, 0], near[at])


def signed_measures(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """The areas or volumes (nt,) of straight `cells` (nt, k) with `points` (nv, d) (m² or m³), negative for inverted
    ones; of hexahedra that are no parallelepipeds those of the tangents at their middles."""
    edges = tangents(points, cells)
    multiple = cell_with(cells.shape[1], points.shape[1]).multiple
    return (edges[0] * cross(edges[1:])).sum(axis=0) / multiple


def tangents(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """∂x/∂λ_a (d, d, nt) at the middles of straight cells as in `signed_measures` (m)."""
    cell = cell_with(cells.shape[1], points.shape[1]).straight
    x = np.take(points.T, cells[:, : cell.corners].T, axis=1)
    return (cell.central[:, None] @ x)[:, :, 0]


def refuse_overlaps(mesh: Mesh, label: str) -> None:
    """Raise InputError, after `label`, where two cells lie on the same side of a facet. Not collective."""
    of_cell = mesh.cell.straight.facets
    facets = mesh.corners[:, of_cell].reshape(-1, of_cell.shape[1])
    # Two cells on either side of a facet traverse it in opposite directions. Equal corners with equal direction, from the
    # lowest node to the lower or the higher one beside it, are two cells on the same side.
    lowest = facets.argmin(axis=1)
    number = facets.shape[1]
    after, before = (facets[np.arange(len(facets)), (lowest + k) % number] for k in (1, -1))
    odd = lowest if number == 2 else after > before
    keys = np.vstack([np.sort(facets, axis=1).T, odd])
    order = np.lexsort(keys)
    twice = order[:-1][(np.diff(keys[:, order]) == 0).all(axis=0)]
    if len(twice):
        place = in_words(mesh.points[facets[twice.min()]].mean(axis=0))
        raise InputError(
            f"{label} has {mesh.cell.names} that overlap at {place}: the mesh folds there, or two of its "
            "parts lie on each other"
        )


def refuse_folded(mesh: Mesh, key: str) -> None:
    """Raise InputError, naming `key`, where a curved cell is not mapped one to one. Not collective."""
    points = np.concatenate([mesh.cell.quadrature[0], np.eye(mesh.cell.corners)])
    for cells in mesh.summed_blocks():
        least = mesh.map(cells, points).measures.min(axis=0)
        if (least <= 0.0).any():
            place = in_words(mesh.points[mesh.triangles[cells[np.argmin(least)]]].mean(axis=0))
            raise InputError(
                f"{key}: the curved {mesh.cell.name} at {place} folds: its sides are bent too much for "
                "its size (gmsh: a smaller size there, or Mesh.HighOrderOptimize = 2)"
            )
