"""The mesh of one body: nodes, triangles and named boundary groups.

Triangles have straight sides. Triangles of order 2 also have a node at the middle of each side
(`refine.raise_order` adds them).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ddmpi.mesh.elements import ELEMENTS, Element


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
    cut : how many quadrilaterals of a file were cut into triangles
    """

    points: np.ndarray
    triangles: np.ndarray
    groups: dict[str, np.ndarray]
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
    def extent(self) -> float:
        """Diagonal of the bounding box (m)."""
        return float(np.linalg.norm(np.ptp(self.points, axis=0)))


def signed_double_areas(points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
    """Twice the signed area (nt,) of each triangle (m²)."""
    a, b, c = (points[triangles[:, i]] for i in range(3))
    return (b[:, 0] - a[:, 0]) * (c[:, 1] - a[:, 1]) - (b[:, 1] - a[:, 1]) * (c[:, 0] - a[:, 0])
