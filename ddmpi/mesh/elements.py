"""Lagrange triangles of order 1 and 2: integrals over them as small tables, over curved ones by quadrature.

On a straight-sided triangle the gradients of the barycentric coordinates λ_a are constant. Every
integral is therefore a table times the area, or times the length of a side. Tables are indexed by the
triangle's nodes (three corners, then in order 2 the middles of the sides 01, 12, 20) and by its corners.
The nodes of a side are its two ends, then its middle.

A triangle of order 2 is curved where middles are off the midpoints of their chords: then its shape functions φ_i map
it, x = Σ φ_i x_i (isoparametric elements), and integrals are sums over the points of TRIANGLE and LINE.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

_A, _B = 0.445948490915965, 0.091576213509771

TRIANGLE = (np.array([np.roll([1 - 2 * a, a, a], k) for a in (_A, _B) for k in range(3)]),
            np.repeat([0.223381589678011, 0.109951743655322], 3))
"""Barycentric points and weights, exact to degree 4 (Dunavant 1985). On curved triangles ∫ σ : ε(φ_i) of a constant
stress needs degree 2 and ∫ φ_i degree 4, so that constant stresses and constant volume forces are exact."""

_POINTS, _WEIGHTS = np.polynomial.legendre.leggauss(5)

LINE = ((1.0 + _POINTS) / 2, _WEIGHTS / 2)
"""Points from 0 to 1 along a side, and weights: Gauss's, exact to degree 9. Arc lengths are no polynomials."""


def _collapsed() -> tuple[np.ndarray, np.ndarray]:
    at, weights = LINE
    a, b = (each.ravel() for each in np.meshgrid(at, at, indexing="ij"))
    return np.column_stack([1 - a, a * (1 - b), a * b]), 2 * a * np.outer(weights, weights).ravel()


FINE = _collapsed()
"""Barycentric points and weights for loads, exact to degree 8: Gauss's on a square that is mapped (Duffy 1982)."""

BENT = 1e-9
"""A side is curved if its middle is off the midpoint of its chord by more than this part of the chord's length."""


@dataclass(frozen=True)
class Mapped:
    """Curved triangles at q points of each.

    Attributes
    ----------
    places : (q, t, 2) where the points lie (m)
    areas : (q, t) ratio of areas to those of the reference triangle, of area one (m²); positive unless it folds
    slopes : (2, q, k, t) ∂φ_i/∂x and ∂φ_i/∂y (1/m)
    """

    places: np.ndarray
    areas: np.ndarray
    slopes: np.ndarray


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

    def map(self, nodes: np.ndarray, barycentric: np.ndarray) -> Mapped:
        """Points (q, 3) of triangles whose `nodes` (t, k, 2) need not lie on straight sides."""
        table = _gradients(barycentric) if len(self.mass) == 6 else np.repeat(self.gradients, len(barycentric), axis=0)
        table = (table[:, :, 1:] - table[:, :, :1]).transpose(2, 0, 1)  # by λ_1 and λ_2; λ_0 = 1 − λ_1 − λ_2
        x, y = np.ascontiguousarray(nodes.transpose(2, 1, 0))
        (x1, x2), (y1, y2) = table @ x, table @ y
        doubled = x1 * y2 - y1 * x2
        first, second = table[..., None]
        (x1, x2), (y1, y2) = ((each / doubled)[:, :, None] for each in ((x1, x2), (y1, y2)))
        slopes = np.empty((2, *first.shape[:2], len(nodes)))
        np.subtract(first * y2, second * y1, out=slopes[0])
        np.subtract(second * x1, first * x2, out=slopes[1])
        phi = self.shapes(barycentric)
        return Mapped(np.stack([phi @ x, phi @ y], axis=2), doubled / 2, slopes)

    def shapes(self, barycentric: np.ndarray) -> np.ndarray:
        """The shape functions (…, k) at points given by their barycentric coordinates (…, 3)."""
        if len(self.mass) == 3:
            return barycentric
        return np.concatenate([barycentric * (2 * barycentric - 1), 4 * barycentric * np.roll(barycentric, -1, -1)], -1)


def _gradients(barycentric: np.ndarray) -> np.ndarray:
    """Of φ_a = λ_a (2 λ_a − 1) at the corners, φ_ab = 4 λ_a λ_b at the middles: coefficients (q, 6, 3) at points."""
    c = np.zeros((len(barycentric), 6, 3))
    for a in range(3):
        b = (a + 1) % 3
        c[:, a, a] = 4 * barycentric[:, a] - 1
        c[:, 3 + a, a], c[:, 3 + a, b] = 4 * barycentric[:, b], 4 * barycentric[:, a]
    return c


ELEMENTS = {
    3: Element(np.eye(3)[None], (np.ones((3, 3)) + np.eye(3)) / 12, np.array([[2, 1], [1, 2]]) / 6),
    6: Element(_gradients(np.array([[1, 1, 0], [0, 1, 1], [1, 0, 1]]) / 2),
               np.array([[2, -1, -1], [-1, 2, -1], [-1, -1, 2], [8, 8, 4], [4, 8, 8], [8, 4, 8]]) / 60,
               np.array([[1, 0], [0, 1], [2, 2]]) / 6),
}
"""By the number of nodes of a triangle."""


def shapes_on_side(at: np.ndarray, number: int) -> np.ndarray:
    """The shape functions (q, 2 or 3) of a side's ends and middle at its parameters (q,), from 0 to 1."""
    if number == 2:
        return np.column_stack([1.0 - at, at])
    return np.column_stack([(1.0 - at) * (1.0 - 2.0 * at), at * (2.0 * at - 1.0), 4.0 * at * (1.0 - at)])


def bends(sides: np.ndarray) -> np.ndarray:
    """How far (…, 2) the middles of sides with nodes (…, 2 or 3, 2) are off the midpoints of their chords (m).

    Exactly zero for straight sides, the only ones of order 1.
    """
    if sides.shape[-2] == 2:
        return np.zeros_like(sides[..., 0, :])
    start, end, middle = np.moveaxis(sides, -2, 0)
    off = middle - (start + end) / 2
    bent = np.linalg.norm(off, axis=-1) > BENT * np.linalg.norm(end - start, axis=-1)
    return np.where(bent[..., None], off, 0.0)


def tangents(sides: np.ndarray, at: np.ndarray) -> np.ndarray:
    """dx/dt (s, q, 2) at the parameters t (q,) of sides with nodes (s, 2 or 3, 2) (m)."""
    return (sides[:, 1] - sides[:, 0])[:, None] + 4.0 * (1.0 - 2.0 * at)[:, None] * bends(sides)[:, None]


def side_lengths(sides: np.ndarray) -> np.ndarray:
    """The arc lengths (s,) of sides with nodes (s, 2 or 3, 2) (m)."""
    found, bent = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1), bends(sides).any(axis=1)
    found[bent] = np.linalg.norm(tangents(sides[bent], LINE[0]), axis=2) @ LINE[1]
    return found


def side_shares(sides: np.ndarray) -> np.ndarray:
    """∫ φ_i (s, 2 or 3) along sides with nodes (s, 2 or 3, 2) (m)."""
    number, bent = sides.shape[1], bends(sides).any(axis=1)
    found = np.linalg.norm(sides[:, 1] - sides[:, 0], axis=1)[:, None] * ELEMENTS[3 * number - 3].side_weights
    ratio = np.linalg.norm(tangents(sides[bent], LINE[0]), axis=2)
    found[bent] = (ratio * LINE[1]) @ shapes_on_side(LINE[0], number)
    return found
