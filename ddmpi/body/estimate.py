"""How far is the discrete answer from the exact one? A recovery estimate of the discretization error.

The stress of a finite element solution jumps from element to element. The recovered stress (`body.recovery`)
is continuous and more accurate, so its distance from the computed one, in the norm of the complementary
energy, estimates the error of the mesh. The recovered stress of linear cells, with one sample each, is no
nearer to the true one than these are to the polynomials, so that a part of their scatter is added: it is
small where the stress is smooth, and counts at corners and ends of contacts. The certificate, not the
estimate, says how well the contact problem is solved.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple

import numpy as np

from ddmpi.body.recovery import Recovery, patches_of, sample_places
from ddmpi.body.stress import (
    Composite,
    cell_stress,
    cell_temperature,
    columns_of,
    compliance_of,
    components,
    portions,
    thermal,
)
from ddmpi.mesh.mesh import Mesh, bare, signed_measures
from ddmpi.scene.bodies import Material
from ddmpi.system.numbers import ROUNDING

SCATTER = 0.6
"""The part of the squared distances of the samples of linear cells, one in each, from the polynomials around them that
counts as error. Without it estimates are 0.68 to 1 of true errors."""


SMALL, TOGETHER = 200, 1000
"""Bodies of at most so many cells are estimated together, so many of them at most."""


class Deformed(NamedTuple):
    """A body with its displacement `u` (nv, d) in metres, and the temperature `heat` (nv,) over the state free of
    stress (K), or None."""

    mesh: Mesh
    material: Material | Composite
    u: np.ndarray
    heat: np.ndarray | None = None


Moved = tuple[np.ndarray, np.ndarray | None]
"""Displacements (nv, d) of a body (m), and temperatures (nv,) over the state free of stress (K), or None."""


class Difference(NamedTuple):
    """How far recovered stresses are from computed ones, in some cells of one material, for k displacements of a body.

    Stresses are Lᵀ σ of their components, with L Lᵀ = C⁻¹: products of these are σ : C⁻¹ : τ.

    Attributes
    ----------
    cells, material, curved : the numbers of the t cells, their material, and whether they are `summed`
    share : (q, t) the measures of the points of quadrature (m² or m³; in the plane times the thickness)
    computed, off : (k, n, q, t) σ_h and σ* − σ_h there (√(J/m³))
    scattered : (k, n, j, t) of linear cells, the distances of the samples from the polynomials of the cells' vertices;
        j is 0 for others
    """

    cells: slice | np.ndarray
    material: Material
    curved: bool
    share: np.ndarray
    computed: np.ndarray
    off: np.ndarray
    scattered: np.ndarray

    def products(self, one: int | None = None) -> np.ndarray:
        """(k, q, t) the shares of ∫ e_one : C⁻¹ : e of the points, of linear cells with a part of the scatter (J), with
        the number `one` of a displacement; without, those of each with itself."""
        density = _dots(self.off, one)
        if self.scattered.shape[2]:
            scatter = _dots(self.scattered, one).mean(axis=1, keepdims=True)
            density += SCATTER * scatter
        return self.share * density

    def energies(self) -> np.ndarray:
        """(k, q, t) the shares of ∫ σ_h : C⁻¹ : σ_h of the points (J)."""
        return self.share * _dots(self.computed)


def _dots(x: np.ndarray, one: int | None = None) -> np.ndarray:
    """Products (k, q, t) of x (k, n, q, t) with themselves, or with those of the number `one`."""
    of_one = x if one is None else x[one : one + 1]
    return np.einsum("kcqt,kcqt->kqt", np.broadcast_to(of_one, x.shape), x)


@dataclass(frozen=True)
class ErrorEstimate:
    """The estimated discretization error of one body, in the energy norm.

    Attributes
    ----------
    squares : (nt,) squared error of each cell, ∫ (σ* − σ_h) : C⁻¹ (σ* − σ_h), of linear cells with a part of the
        scatter of σ_h about the polynomials (J; in the plane per metre of depth)
    areas : (nt,) areas or volumes of the cells (m² or m³)
    energy : squared energy norm ∫ σ_h : C⁻¹ σ_h, twice the strain energy (J)
    stress : (nv, 4) or (nv, 6) the recovered stress at the nodes, as of `nodal_stress` (Pa)
    """

    squares: np.ndarray
    areas: np.ndarray
    energy: float
    stress: np.ndarray

    @property
    def area(self) -> float:
        """Area or volume of the body (m² or m³)."""
        return float(self.areas.sum())

    @property
    def total(self) -> float:
        """The squared error of the body."""
        return float(self.squares.sum())


def relative_error(squared_error: float, energy: float) -> float:
    """‖e‖ / ‖u‖ in the energy norm, with ‖u‖² = ‖u_h‖² + ‖e‖² (Galerkin orthogonality); zero without strains."""
    size = squared_error + energy
    return float(np.sqrt(squared_error / size)) if size else 0.0


@dataclass(frozen=True)
class DiscretizationError:
    """The estimated discretization error of all bodies together, with the estimates of one rank's bodies.

    Attributes
    ----------
    relative : ‖e‖ / ‖u‖ in the energy norm of all bodies; nan if one of them has no estimate
    by_body : ‖e‖ of single bodies over the same ‖u‖; nan as well; of all bodies on the first rank only
    estimates : the estimates of this rank's bodies
    mean : energy norm squared over area, of all bodies (J/m³)
    own : ‖e‖ / ‖u‖ of single bodies, on the first rank only
    """

    relative: float
    by_body: dict[str, float]
    estimates: dict[str, ErrorEstimate]
    mean: float
    own: Mapping[str, float] = field(default_factory=dict)

    def density(self, body: str) -> np.ndarray | None:
        """Error of all cells (nt,) per area over the mean energy norm per area, without unit; None if unknown."""
        if np.isnan(self.relative):
            return None
        estimate = self.estimates[body]
        return (
            np.sqrt(estimate.squares / estimate.areas / self.mean)
            if self.mean
            else np.zeros(len(estimate.areas))
        )


def sum_errors(
    bodies: Mapping[str, tuple[float, float, float]],
    estimates: dict[str, ErrorEstimate],
    sums: np.ndarray,
) -> DiscretizationError:
    """The error from squared errors, squared energy norms and areas of `bodies` by name, and their `sums` (3,). Not
    collective."""
    error, energy, area = sums.tolist()
    shares = {
        name: relative_error(square, error + energy - square)
        for name, (square, *_) in bodies.items()
    }
    own = {name: relative_error(square, size) for name, (square, size, _) in bodies.items()}
    whole = relative_error(error, energy)
    return DiscretizationError(whole, shares, estimates, energy / area, own)


def estimate_error(
    mesh: Mesh, material: Material | Composite, u: np.ndarray, heat: np.ndarray | None = None
) -> ErrorEstimate:
    """The estimate of one body, as of `estimate_errors`. Not collective."""
    return estimate_errors([Deformed(mesh, material, u, heat)])[0]


def estimate_errors(bodies: Sequence[Deformed], keep: bool = False) -> list[ErrorEstimate]:
    """Estimate the discretization errors of bodies, of small ones with a common material together; `keep` the patches
    of the others for more recoveries. Not collective.

    Energy and error are zero if all strains are rounding. Errors of linear cells that lock are nan: they hardly deform,
    so that their stress jumps little however wrong it is. At interfaces of materials the true stress jumps, and is
    recovered from either side.
    """
    kinds = dict[tuple, list[int]]()
    for k, body in enumerate(bodies):
        mesh, material, _, heat = body
        small = len(mesh.triangles) <= SMALL and isinstance(material, Material)
        nodes = mesh.triangles.shape[1], mesh.dimension, mesh.axisymmetric, mesh.integration
        kind = (repr(material), *nodes, heat is None) if small else (k,)
        kinds.setdefault(kind, []).append(k)
    found: dict[int, ErrorEstimate] = {}
    for numbers in kinds.values():
        for first in range(0, len(numbers), TOGETHER):
            some = numbers[first : first + TOGETHER]
            found |= zip(some, _estimates([bodies[k] for k in some], keep), strict=True)
    return [found[k] for k in range(len(bodies))]


def _together(bodies: Sequence[Deformed]) -> Deformed:
    """Bodies of one material as one, in pieces."""
    if len(bodies) == 1:
        return bodies[0]
    meshes, materials, moved, heats = zip(*bodies, strict=True)
    starts = itertools.accumulate(map(len, moved), initial=0)
    cells = [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
    points = np.concatenate([mesh.points for mesh in meshes])
    whole = replace(bare(meshes[0]), points=points, triangles=np.concatenate(cells))
    heat = None if heats[0] is None else np.concatenate(heats)
    return Deformed(whole, materials[0], np.concatenate(moved), heat)


def _estimates(bodies: Sequence[Deformed], keep: bool) -> Iterator[ErrorEstimate]:
    """The estimates of bodies of one material."""
    mesh, material, u, heat = _together(bodies)
    squares, energies, stress = _by_cells(mesh, material, (u, heat), keep)
    measures = mesh.measures()
    materials = [material] if isinstance(material, Material) else material.materials
    stiffest = max(one.tensor(mesh.dimension).max() for one in materials)
    # strains of rounding are those of displacements over the size of a cell
    sizes = signed_measures(mesh.points, mesh.corners) ** (1.0 / mesh.dimension)
    stiffness = stiffest * measures / sizes**2
    locked = mesh.cell.linear and any(one.locks for one in materials)
    node = cell = 0
    for body in bodies:
        of_cells, nodes = (
            slice(cell, cell + len(body.mesh.triangles)),
            slice(node, node + len(body.u)),
        )
        cell, node = of_cells.stop, nodes.stop
        areas, energy, own = measures[of_cells], float(energies[of_cells].sum()), squares[of_cells]
        rounding = ROUNDING * np.abs(body.u).max()
        if energy <= stiffness[of_cells].sum() * rounding**2:  # a rigid motion
            own, energy = np.zeros(len(areas)), 0.0
        if locked:
            own = np.full(len(areas), np.nan)
        yield ErrorEstimate(own, areas, energy, stress[nodes])


def _by_cells(
    mesh: Mesh, material: Material | Composite, moved: Moved, keep: bool
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Squared errors and squared energy norms (nt,) of the cells, and the recovered stress at the nodes."""
    found = split, _, recovered = _recovered(mesh, material, [moved], keep)
    heat, (squares, energies) = moved[1], np.zeros((2, len(mesh.triangles)))
    for part in differences(mesh, material, [moved], found):
        squares[part.cells] = part.products()[0].sum(axis=0)
        energies[part.cells] = part.energies()[0].sum(axis=0)
        if heat is not None:  # in plane strain σ_zz has energy as well
            at = mesh.cell.rule[0] if part.curved else mesh.cell.samples[0]
            warm = cell_temperature(mesh, heat, at, part.cells)
            warm = warm if part.curved else mesh.cell.from_samples @ warm
            density = thermal(part.material, mesh.strains)[3] * warm**2
            energies[part.cells] += (part.share * density).sum(axis=0)
    return squares, energies, _joined(mesh, material, split, recovered.nodes, heat)


def differences(
    mesh: Mesh,
    material: Material | Composite,
    moved: Sequence[Moved],
    found: tuple[Mesh, np.ndarray, Recovery] | None = None,
) -> Iterator[Difference]:
    """How far the recovered stresses of several displacements of a body are from the computed ones, in parts that cover
    all cells. One recovery serves all displacements. `found` is what `_recovered` gives. Not collective."""
    split, sampled, recovered = found or _recovered(mesh, material, moved)
    cell, points, measures = mesh.cell, mesh.cell.rule[0], mesh.measures()
    shapes, k = cell.shapes(points), len(moved)
    between, places = cell.from_samples, sample_places(mesh.home)
    for cells, uniform, curved in portions(mesh, material):
        computed, weights = between @ sampled[..., cells], uniform.thickness * cell.rule[1]
        share = weights[:, None] * measures[cells]
        if curved:
            of_all = [
                cell_stress(mesh, uniform, u, points, cells, curved, heat) for u, heat in moved
            ]
            computed = _rooted(uniform, of_all)
            share = weights[:, None] * mesh.map(cells, points).measures
        # η² = ∫ (σ* − σ_h) : C⁻¹ (σ* − σ_h), with σ* interpolated from the nodes (Zienkiewicz and Zhu).
        off = shapes @ np.take(recovered.nodes, split.triangles[cells].T, axis=1) - computed
        fits = [
            recovered.around(vertex, places[..., cells]) - sampled[..., cells]
            for vertex in recovered.vertices.corners[cells].T
        ]
        scattered = np.concatenate(fits if cell.linear else [sampled[:, :0, cells]], axis=1)
        of_each = (x.reshape(k, len(x) // k, *x.shape[1:]) for x in (computed, off, scattered))
        yield Difference(cells, uniform, curved, share, *of_each)


def nodal_stress(
    mesh: Mesh, material: Material | Composite, u: np.ndarray, heat: np.ndarray | None = None
) -> np.ndarray:
    """The recovered stress at the nodes (nv, 4), in space (nv, 6), in Pa, with the columns and arguments of `stress`;
    where materials meet, the mean of theirs. Not collective."""
    split, _, recovered = _recovered(mesh, material, [(u, heat)], keep=False)
    return _joined(mesh, material, split, recovered.nodes, heat)


def _recovered(
    mesh: Mesh, material: Material | Composite, moved: Sequence[Moved], keep: bool = True
) -> tuple[Mesh, np.ndarray, Recovery]:
    """The mesh with separate nodes for every material, stresses (k n, q, nt) of all displacements at the samples as
    those of a `Difference`, and the recovered ones."""
    split, samples = (
        mesh if isinstance(material, Material) else material.apart(mesh),
        mesh.cell.samples[0],
    )
    n = len(np.triu_indices(mesh.strains)[0])
    sampled = np.empty((n * len(moved), len(samples), len(mesh.triangles)))
    for cells, uniform, curved in portions(mesh, material):
        of_all = [cell_stress(mesh, uniform, u, samples, cells, curved, heat) for u, heat in moved]
        sampled[..., cells] = _rooted(uniform, of_all)
    return split, sampled, patches_of(split, keep).recover(sampled)


def _root(material: Material, n: int) -> np.ndarray:
    """Lᵀ, with L Lᵀ = C⁻¹ of tensors (n, n)."""
    return np.linalg.cholesky(compliance_of(material, n)).T


def _rooted(material: Material, stresses: Sequence[np.ndarray]) -> np.ndarray:
    """Lᵀ σ (k n, q, t) of k stresses (n, n, q, t) (Pa), one after the other."""
    root = _root(material, len(stresses[0]))
    of_each = [np.tensordot(root, components(sigma), 1) for sigma in stresses]
    return np.concatenate(of_each)


def _joined(
    mesh: Mesh,
    material: Material | Composite,
    split: Mesh,
    recovered: np.ndarray,
    heat: np.ndarray | None,
) -> np.ndarray:
    """The columns of `stress` at the nodes of the mesh, from the recovered one (n, ·) at those of its `split`."""

    def of(uniform: Material, values: np.ndarray, warm: np.ndarray | None) -> np.ndarray:
        n = mesh.strains
        tensors, (i, j) = np.empty((n, n, values.shape[1])), np.triu_indices(n)
        tensors[i, j] = tensors[j, i] = np.linalg.solve(_root(uniform, n), values)
        return columns_of(tensors, uniform, warm)[: 2 * mesh.dimension].T

    if isinstance(material, Material):
        return of(material, recovered, heat)
    node, number = np.empty((2, len(split.points)), int)
    node[split.triangles], number[split.triangles] = mesh.triangles, material.number[:, None]
    total = np.zeros((len(mesh.points), 2 * mesh.dimension))
    for k, uniform in enumerate(material.materials):
        at = node[number == k]
        values = of(uniform, recovered[:, number == k], None if heat is None else heat[at])
        np.add.at(total, at, values)
    return total / np.bincount(node, minlength=len(total))[:, None]
