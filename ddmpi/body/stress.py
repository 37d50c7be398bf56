"""Stress of a computed displacement, and the energy in it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ddmpi.mesh.boundary import material_numbers, turn_outward
from ddmpi.mesh.elements import TRIANGLE, side_lengths
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Material

CENTROID = np.array([[1.0, 1.0, 1.0]]) / 3
"""Barycentric coordinates of the point where the stress of a triangle with straight sides is its mean."""

BLOCK = 8192
"""Triangles, or nodes, that are worked on at once, so that intermediate results stay in the processor's cache."""


@dataclass(frozen=True)
class Composite:
    """Several materials in one body, in the place of a `Material`: its constants are arrays over triangles.

    Attributes
    ----------
    materials : no two of them with the same constants, all in the same plane
    number : (nt,) which one each triangle has
    """

    materials: Sequence[Material]
    number: np.ndarray

    @property
    def plane(self) -> Literal["strain", "stress"]:
        return self.materials[0].plane

    @property
    def poisson(self) -> np.ndarray:
        return np.array([material.poisson for material in self.materials])[self.number]

    @property
    def lame(self) -> tuple[np.ndarray, np.ndarray]:
        """First Lamé constant and shear modulus (nt,) in Pa."""
        first, shear = np.array([material.lame for material in self.materials]).T
        return first[self.number], shear[self.number]

    @property
    def plane_modulus(self) -> np.ndarray:
        """(nt,) in Pa."""
        return np.array([material.plane_modulus for material in self.materials])[self.number]

    @property
    def locks(self) -> bool:
        """Whether one of the materials does."""
        return any(material.locks for material in self.materials)


def material_of(mesh: Mesh, body: BodySpec) -> Material | Composite:
    """The material of a body, or those of its triangles. Not collective. Raises InputError, see `material_numbers`."""
    if isinstance(body.material, Material):
        return body.material
    constants = [(part.young, part.poisson) for part in body.material]
    same = np.array([constants.index(each) for each in constants])  # entries that differ in their surfaces only
    kept, number = np.unique(same[material_numbers(mesh, body)], return_inverse=True)
    materials = [body.material[k] for k in kept]
    return Composite(materials, number.ravel()) if len(materials) > 1 else materials[0]


def of_part(material: Material | Composite, part: slice | np.ndarray) -> Material | Composite:
    """The material of a part of the triangles."""
    return Composite(material.materials, material.number[part]) if isinstance(material, Composite) else material


def modulus_beside(mesh: Mesh, material: Material | Composite, edges: np.ndarray, key: str) -> float:
    """Plane modulus (Pa) of the triangles at boundary edges (k, 2 or 3); of several the harmonic mean by lengths.

    Raises InputError, naming `key`, for an inner edge. Not collective.
    """
    if not isinstance(material, Composite):
        return material.plane_modulus
    edges, size = turn_outward(mesh, edges, key), len(mesh.points)
    around = mesh.triangles[:, [0, 1, 2]] * size + mesh.triangles[:, [1, 2, 0]]
    order = np.argsort(around, axis=None)
    triangle = order[np.searchsorted(around.ravel(), edges[:, 0] * size + edges[:, 1], sorter=order)] // 3
    length = side_lengths(mesh.points[edges])
    return float(length.sum() / (length / material.plane_modulus[triangle]).sum())


def stress(mesh: Mesh, material: Material | Composite, u: np.ndarray) -> np.ndarray:
    """Mean stress of each triangle.

    Parameters
    ----------
    u : (nv, 2) displacement (m)

    Returns
    -------
    (nt, 4) array of σ_xx, σ_yy, σ_zz, σ_xy in Pa; σ_zz is zero in plane stress. Not collective.
    """
    sigma = stress_at(mesh, material, u, CENTROID)[:, 0]
    for cells in mesh.curved_blocks():
        parts = TRIANGLE[1][:, None] * mesh.map(cells).areas
        sigma[cells] = np.einsum("qt,tqc->tc", parts / parts.sum(axis=0),
                                 curved_stress(mesh, material, u, TRIANGLE[0], cells))
    xx, yy, xy = sigma.T
    zz = material.poisson * (xx + yy) if material.plane == "strain" else np.zeros_like(xx)
    return np.column_stack([xx, yy, zz, xy])


def von_mises(sigma: np.ndarray) -> np.ndarray:
    """Von Mises stress (nt,) in Pa from `stress`."""
    xx, yy, zz, xy = sigma.T
    return np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * xy**2)


def stress_at(mesh: Mesh, material: Material | Composite, u: np.ndarray, barycentric: np.ndarray) -> np.ndarray:
    """Stress at the same points of every triangle.

    Parameters
    ----------
    u : (nv, 2) displacement (m)
    barycentric : (q, 3) coordinates of the points

    Returns
    -------
    (nt, q, 3) array of σ_xx, σ_yy, σ_xy in Pa. Not collective.
    """
    table = mesh.element.gradients  # constant, or at the middles of the sides 01, 12, 20 and linear between them
    weights = 1.0 - 2.0 * barycentric[:, [2, 0, 1]] if len(table) == 3 else np.ones((len(barycentric), 1))
    table = np.einsum("qs,sia->qai", weights, table)
    table = (table[:, 1:] - table[:, :1]).reshape(-1, table.shape[2])  # by λ_1 and λ_2; λ_0 = 1 − λ_1 − λ_2
    sigma = np.empty((len(mesh.triangles), len(barycentric), 3))
    for block in blocks(len(sigma)):
        first, shear = of_part(material, block).lame
        t = mesh.triangles[block].T
        a, b, c = mesh.points[t[:3]].swapaxes(1, 2)
        (x1, y1), (x2, y2) = b - a, c - a
        slopes = (table @ u.T[:, t]).reshape(2, len(barycentric), 2, -1) / (x1 * y2 - x2 * y1)
        (u1, u2), (v1, v2) = slopes.swapaxes(1, 2)
        exx, eyy = u1 * y2 - u2 * y1, v2 * x1 - v1 * x2
        gxy = u2 * x1 - u1 * x2 + v1 * y2 - v2 * y1
        trace = first * (exx + eyy)
        for k, component in enumerate((trace + 2 * shear * exx, trace + 2 * shear * eyy, shear * gxy)):
            sigma[block, :, k] = component.T
    for cells in mesh.curved_blocks():
        sigma[cells] = curved_stress(mesh, material, u, barycentric, cells)
    return sigma


def curved_stress(mesh: Mesh, material: Material | Composite, u: np.ndarray, barycentric: np.ndarray,
                  cells: np.ndarray) -> np.ndarray:
    """`stress_at` (t, q, 3) in some triangles, numbers `cells` (t,), curved or not. Not collective."""
    first, shear = of_part(material, cells).lame
    ux, uy = u.T[:, mesh.triangles[cells]].transpose(0, 2, 1)
    slopes = mesh.map(cells, barycentric).slopes
    (exx, exy), (eyx, eyy) = (np.einsum("dqkt,kt->dqt", slopes, each) for each in (ux, uy))
    trace = first * (exx + eyy)
    sigma = trace + 2 * shear * exx, trace + 2 * shear * eyy, shear * (exy + eyx)
    return np.stack(sigma, axis=2).swapaxes(0, 1)


def energy_density(material: Material | Composite, sigma: np.ndarray) -> np.ndarray:
    """σ : C⁻¹ σ (J/m³) of plane stresses (k, 3): σ_xx, σ_yy, σ_xy in Pa; one in each triangle of a Composite."""
    first, shear = material.lame
    xx, yy, xy = sigma.T
    return (xx**2 + yy**2 + 2 * xy**2 - first / (2 * (first + shear)) * (xx + yy) ** 2) / (2 * shear)


def blocks(number: int) -> list[slice]:
    """Slices of BLOCK numbers each that cover range(number)."""
    return [slice(start, start + BLOCK) for start in range(0, number, BLOCK)]
