"""Straight-sided Lagrange triangles of order 1 and 2: integrals over them as small tables.

On a straight-sided triangle the gradients of the barycentric coordinates λ_a are constant. Every
integral is therefore a table times the area, or times the length of a side. Tables are indexed by the
triangle's nodes (three corners, then in order 2 the midpoints of the sides 01, 12, 20) and by its corners.
The nodes of a side are its two ends, then its midpoint.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

GAUSS = 5
"""Points of the Gauss rules along a line: products of formulas and shape functions are integrated exactly up to degree
9 on sides and 8 on triangles."""


@dataclass(frozen=True)
class Element:
    """Tables of one order, with k nodes to a triangle and l to a side.

    Attributes
    ----------
    gradients : (q, k, 3) coefficients c of ∇φ_i = Σ_a c_ia ∇λ_a at the midpoints of the sides (a
        single point where they are constant); products of two are integrated exactly
    mass : (k, 3) ∫ φ_i λ_a, for a triangle of area one
    side_mass : (l, 2) ∫ φ_i λ_a, for a side of length one
    side_weights : (l,) ∫ φ_i, all positive, for a side of length one
    """

    gradients: np.ndarray
    mass: np.ndarray
    side_mass: np.ndarray

    @property
    def side_weights(self) -> np.ndarray:
        return self.side_mass.sum(axis=1)

    def stiffness_weights(self) -> np.ndarray:
        """w (k, k, 3, 3) with ∫ ∇φ_i ⊗ ∇φ_j = Σ_ab w_ijab ∇λ_a ⊗ ∇λ_b, for a triangle of area one."""
        c = self.gradients
        return np.einsum("qia,qjb->ijab", c, c) / len(c)

    def side_rule(self) -> tuple[np.ndarray, np.ndarray]:
        """Gauss points (q, 2), barycentric, and the table (l, q) whose products with a function's values there are its
        integrals ∫ f φ_i, for a side of length one."""
        at, weights = _gauss()
        ends = np.column_stack([1 - at, at])
        shapes = self.shapes(np.column_stack([ends, np.zeros(len(at))]))[:, [0, 1, 3][:len(self.side_mass)]]
        return ends, (weights[:, None] * shapes).T

    def rule(self) -> tuple[np.ndarray, np.ndarray]:
        """Points (q, 3) and table (k, q) as of `side_rule`, for a triangle of area one (Duffy's map of the square)."""
        at, weights = _gauss()
        a, b = (each.ravel() for each in np.meshgrid(at, at, indexing="ij"))
        points = np.column_stack([1 - a, a * (1 - b), a * b])
        return points, (2 * a * np.outer(weights, weights).ravel() * self.shapes(points).T)

    def shapes(self, barycentric: np.ndarray) -> np.ndarray:
        """The shape functions (…, k) at points given by their barycentric coordinates (…, 3)."""
        if len(self.mass) == 3:
            return barycentric
        return np.concatenate([barycentric * (2 * barycentric - 1), 4 * barycentric * np.roll(barycentric, -1, -1)], -1)


def _gauss() -> tuple[np.ndarray, np.ndarray]:
    """Points and weights of Gauss on a line from 0 to 1."""
    at, weights = np.polynomial.legendre.leggauss(GAUSS)
    return (1 + at) / 2, weights / 2


def _quadratic_gradients() -> np.ndarray:
    """φ_a = λ_a (2 λ_a − 1) at the corners, φ_ab = 4 λ_a λ_b at the midpoints."""
    c = np.zeros((3, 6, 3))
    for point, at in enumerate(np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1]]) / 2):
        for a in range(3):
            b = (a + 1) % 3
            c[point, a, a] = 4 * at[a] - 1
            c[point, 3 + a, a], c[point, 3 + a, b] = 4 * at[b], 4 * at[a]
    return c


ELEMENTS = {
    3: Element(np.eye(3)[None], (np.ones((3, 3)) + np.eye(3)) / 12, np.array([[2, 1], [1, 2]]) / 6),
    6: Element(_quadratic_gradients(),
               np.array([[2, -1, -1], [-1, 2, -1], [-1, -1, 2], [8, 8, 4], [4, 8, 8], [8, 4, 8]]) / 60,
               np.array([[1, 0], [0, 1], [2, 2]]) / 6),
}
"""By the number of nodes of a triangle."""
