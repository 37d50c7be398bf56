"""The mesh of one body: nodes, triangles and named groups.

Triangles of order 2 also have a node at the middle of each side (`refine.raise_order` adds them). Where it is off the
midpoint of the chord, the side is curved: the parabola through its three nodes.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.elements import ELEMENTS, TRIANGLE, Element, Mapped, bends

SIDES = np.array([[0, 1, 3], [1, 2, 4], [2, 0, 5]])
"""Ends and middles of the sides of a triangle of order 2."""

BLOCK = 2048
"""Triangles that are worked on at a time, so that their data stay in the processor's cache."""


@dataclass(frozen=True)
class Mesh:
    """Triangles of one body. Not distributed; every array is local to the body.

    Attributes
    ----------
    points : (nv, 2) float, metres
    triangles : (nt, 3) int, corners counter-clockwise; of order 2 (nt, 6), the corners followed by the middles
        of the sides 01, 12, 20
    groups : name → (k, 2) int, the boundary edges of each physical group by their ends; of order 2
        (k, 3), the ends followed by the middle
    vertices : name → (k,) int, the nodes of each physical point
    surfaces : name → (k,) int, the triangles of each physical surface
    cut : how many quadrilaterals of a file were cut into triangles
    """

    points: np.ndarray
    triangles: np.ndarray
    groups: dict[str, np.ndarray]
    vertices: dict[str, np.ndarray] = field(default_factory=dict)
    surfaces: dict[str, np.ndarray] = field(default_factory=dict)
    cut: int = 0

    @property
    def dimension(self) -> int:
        """Number of coordinates of a point."""
        return self.points.shape[1]

    @property
    def order(self) -> int:
        """1, linear, or 2, quadratic elements."""
        return 1 if self.triangles.shape[1] == self.dimension + 1 else 2

    @property
    def element(self) -> Element:
        """The tables of integrals over one of the elements."""
        return ELEMENTS[self.triangles.shape[1]]

    @property
    def bends(self) -> np.ndarray:
        """(nt, 3, 2) how far the middles of the sides are off the midpoints of the chords (m); zero if straight."""
        return self._bends(np.arange(len(self.triangles)))

    def _bends(self, cells: np.ndarray) -> np.ndarray:
        return bends(self.points[self.triangles[cells][:, SIDES[:, :self.order + 1]]])

    @cached_property
    def curved(self) -> np.ndarray:
        """(nc,) the numbers of the triangles that have a curved side."""
        if self.order == 1:
            return np.empty(0, int)
        off = np.zeros(len(self.triangles), bool)  # as nearly all sides of most meshes are straight to the last bit
        for start in range(0, len(off), BLOCK):
            nodes = self.triangles[start:start + BLOCK].T
            for x in self.points.T:
                off[start:start + BLOCK] |= (x[nodes[3:]] != (x[nodes[:3]] + x[nodes[[1, 2, 0]]]) / 2).any(axis=0)
        cells = np.flatnonzero(off)
        return cells[self._bends(cells).any(axis=(1, 2))]

    def curved_blocks(self) -> list[np.ndarray]:
        """The numbers of the curved triangles, BLOCK at a time."""
        return [self.curved[start:start + BLOCK] for start in range(0, len(self.curved), BLOCK)]

    def map(self, cells: np.ndarray | slice, barycentric: np.ndarray = TRIANGLE[0]) -> Mapped:
        """Some triangles, numbers or a slice of them, at the points `barycentric` (q, 3) of each, curved or not."""
        return self.element.map(self.points[self.triangles[cells]], barycentric)

    def areas(self) -> np.ndarray:
        """(nt,) of the triangles (m²)."""
        found = signed_double_areas(self.points, self.triangles) / 2
        for cells in self.curved_blocks():
            found[cells] = TRIANGLE[1] @ self.map(cells).areas
        return found

    @property
    def extent(self) -> float:
        """Diagonal of the bounding box (m)."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


def signed_double_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the signed area (nt,) of each triangle (m²)."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])


def refuse_folded(mesh: Mesh, key: str) -> None:
    """Raise InputError, naming `key`, where a curved triangle is not mapped one to one. Not collective."""
    for cells in mesh.curved_blocks():
        least = mesh.map(cells, np.concatenate([TRIANGLE[0], np.eye(3)])).areas.min(axis=0)
        if (least <= 0.0).any():
            x, y = mesh.points[mesh.triangles[cells[np.argmin(least)]]].mean(axis=0)
            raise InputError(f"{key}: the curved triangle at ({x:.6g}, {y:.6g}) folds: its sides are bent too much for "
                             "its size (gmsh: a smaller size there, or Mesh.HighOrderOptimize = 2)")
