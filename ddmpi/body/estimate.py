"""How far is the discrete answer from the exact one? A recovery estimate of the discretization error.

The stress of a finite element solution jumps from element to element. Around every node a polynomial of
the degree of the displacement is fitted to it (superconvergent patch recovery; Zienkiewicz and Zhu, Int. J.
Numer. Meth. Engng. 33, 1992). The recovered stress is continuous and more accurate, so its distance from
the computed one, in the norm of the complementary energy, estimates the error of the mesh. The certificate,
not the estimate, says how well the contact problem is solved.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Mapping
from dataclasses import dataclass, replace
from math import comb

import numpy as np

from ddmpi.body.stress import (
    Composite,
    blocks,
    cell_stress,
    cell_temperature,
    columns_of,
    components,
    energy_density,
    portions,
    stress_at,
    thermal,
)
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import Material
from ddmpi.system.numbers import ALIKE, ROUNDING

SOLVABLE = 1e-8
"""Least eigenvalue of a patch's normal equations, relative to its number of samples, for a fit of full degree."""

REACH = {1: 4, 2: 1}
"""Largest distance, in edges, between a node and the patch whose fit it borrows, by order. Quadratics are extrapolated
badly: in a wall of one element four edges made the estimate eight times the error, one edge makes it 1.3 times."""


@dataclass(frozen=True)
class ErrorEstimate:
    """The estimated discretization error of one body, in the energy norm.

    Attributes
    ----------
    squares : (nt,) squared error of each cell, ∫ (σ* − σ_h) : C⁻¹ (σ* − σ_h) (J; in the plane per metre of depth)
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
    """

    relative: float
    by_body: dict[str, float]
    estimates: dict[str, ErrorEstimate]
    mean: float

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
    return DiscretizationError(relative_error(error, energy), shares, estimates, energy / area)


def estimate_error(
    mesh: Mesh, material: Material | Composite, u: np.ndarray, heat: np.ndarray | None = None
) -> ErrorEstimate:
    """Estimate the discretization error of the displacement `u` (nv, d) in metres. Not collective.

    `heat` (nv,) is the temperature over the state free of stress (K).

    Energy and error are zero if all strains are rounding. Errors of linear cells that lock are nan: they hardly deform,
    so that their stress jumps little however wrong it is. At interfaces of materials the true stress jumps, and is
    recovered from either side.
    """
    cell, points, measures = mesh.cell, mesh.cell.rule[0], mesh.measures()
    shapes = cell.shapes(points)
    spans = [
        cell.derivatives(places).swapaxes(0, 1).reshape(len(places), -1)
        for places in (points, cell.samples[0])
    ]
    # On straight cells σ_h is a combination of the derivatives of shape functions, so its values at the samples give
    # those at the points of quadrature: no second evaluation.
    between = spans[0] @ np.linalg.pinv(
        spans[1]
    )  # stress is a sum of derivatives of shape functions
    split, sampled, recovered = _recovered(mesh, material, u, heat)
    squares: np.ndarray = np.zeros(len(measures))
    energy = 0.0
    for cells, uniform, curved in portions(mesh, material):
        computed, weights = between @ sampled[..., cells], uniform.thickness * cell.rule[1]
        share = weights[:, None] * measures[cells]
        if curved:
            computed = components(cell_stress(mesh, uniform, u, points, cells, curved, heat))
            share = weights[:, None] * mesh.map(cells, points).measures
        # η² = ∫ (σ* − σ_h) : C⁻¹ (σ* − σ_h), with σ* interpolated from the nodes (Zienkiewicz and Zhu).
        difference = shapes @ np.take(recovered, split.triangles[cells].T, axis=1) - computed
        squares[cells] = (share * energy_density(uniform, difference)).sum(axis=0)
        energy += float((share * energy_density(uniform, computed)).sum())
        if heat is not None:  # in plane strain σ_zz has energy as well
            warm = (
                cell_temperature(mesh, heat, points, cells)
                if curved
                else (between @ cell_temperature(mesh, heat, cell.samples[0], cells))
            )
            energy += thermal(uniform, mesh.strains)[3] * float((share * warm**2).sum())
    materials = [material] if isinstance(material, Material) else material.materials
    stiffest = max(one.tensor(mesh.dimension).max() for one in materials)
    if energy <= stiffest * len(measures) * (ROUNDING * np.abs(u).max()) ** 2:  # a rigid motion
        squares, energy = np.zeros(len(measures)), 0.0
    if mesh.cell.linear and any(one.locks for one in materials):
        squares = np.full(len(measures), np.nan)
    return ErrorEstimate(squares, measures, energy, _joined(mesh, material, split, recovered, heat))


def nodal_stress(
    mesh: Mesh, material: Material | Composite, u: np.ndarray, heat: np.ndarray | None = None
) -> np.ndarray:
    """The recovered stress at the nodes (nv, 4), in space (nv, 6), in Pa, with the columns and arguments of `stress`;
    where materials meet, the mean of theirs. Not collective."""
    split, _, recovered = _recovered(mesh, material, u, heat)
    return _joined(mesh, material, split, recovered, heat)


def _recovered(
    mesh: Mesh,
    material: Material | Composite,
    u: np.ndarray,
    heat: np.ndarray | None,
) -> tuple[Mesh, np.ndarray, np.ndarray]:
    """The mesh with separate nodes for every material, stress (n, q, nt) at the samples, and recovered (n, ·)."""
    split = mesh if isinstance(material, Material) else _apart(mesh, material)
    sampled = components(stress_at(mesh, material, u, mesh.cell.samples[0], heat))
    return split, sampled, _recover(split, sampled)


def _joined(
    mesh: Mesh,
    material: Material | Composite,
    split: Mesh,
    recovered: np.ndarray,
    heat: np.ndarray | None,
) -> np.ndarray:
    """The columns of `stress` at the nodes of the mesh, from the recovered stress (n, ·) at those of its `split`."""
    n, columns = mesh.strains, 2 * mesh.dimension
    tensors = np.empty((n, n, recovered.shape[1]))
    i, j = np.triu_indices(n)
    tensors[i, j] = tensors[j, i] = recovered
    if isinstance(material, Material):
        return columns_of(tensors, material, heat)[:columns].T
    node, number = np.empty((2, len(split.points)), int)
    node[split.triangles], number[split.triangles] = mesh.triangles, material.number[:, None]
    total = np.zeros((len(mesh.points), columns))
    for k, uniform in enumerate(material.materials):
        at = node[number == k]
        values = columns_of(tensors[..., number == k], uniform, None if heat is None else heat[at])
        np.add.at(total, at, values[:columns].T)
    return total / np.bincount(node, minlength=len(total))[:, None]


def _apart(mesh: Mesh, material: Composite) -> Mesh:
    """The mesh with separate nodes for every material, so that no patch reaches from one into another."""
    size = len(material.materials)
    keys, cells = np.unique(mesh.triangles * size + material.number[:, None], return_inverse=True)
    return replace(
        mesh, points=mesh.points[keys // size], triangles=cells.reshape(mesh.triangles.shape)
    )


def _recover(mesh: Mesh, sampled: np.ndarray) -> np.ndarray:
    """The recovered stress (n, nv) at all nodes from that (n, q, nt) at the samples, in Pa: fits around the corners; at
    middle nodes the mean of the fits of both corners."""
    x, order, corners, samples = mesh.points, mesh.order, mesh.corners, mesh.cell.samples[0]
    nv, n, k = int(corners.max()) + 1, len(sampled), comb(mesh.dimension + order, order)
    places = samples @ np.take(x.T, corners.T, axis=1)  # (d, q, nt)
    for bent in mesh.summed_blocks():
        places[..., bent] = mesh.map(bent, samples).places.transpose(2, 0, 1)
    # Coordinates relative to the vertex, over the size of its patch, keep the normal equations well conditioned.
    reach = np.zeros(nv)
    for block in blocks(len(corners)):
        np.maximum.at(
            reach,
            corners[block],
            np.linalg.norm(np.ptp(x[corners[block]], axis=1), axis=1)[:, None],
        )
    upper = np.triu_indices(k)
    moments, sums = np.zeros((len(upper[0]), nv)), np.zeros((n * k, nv))  # the normal equations
    for vertex, q in itertools.product(corners.T, range(len(samples))):
        p = _monomials((places[:, q] - x[vertex].T) / reach[vertex], order)
        for c, (a, b) in enumerate(zip(*upper, strict=True)):
            moments[c] += np.bincount(vertex, p[a] * p[b], nv)
        for c, (a, b) in enumerate(np.ndindex(k, n)):
            sums[c] += np.bincount(vertex, p[a] * sampled[b, q], nv)
    del places, p  # large meshes need the memory
    owner, fit = _fits(mesh, moments, sums, upper), sums
    del moments
    value, vertices = np.zeros((n, len(x))), np.flatnonzero(np.bincount(corners.ravel()))
    value[:, vertices] = _evaluate(fit, owner[vertices], x, reach, vertices, order)
    for node, between in zip(
        mesh.triangles.T[mesh.dimension + 1 :], mesh.cell.between, strict=True
    ):
        fits = (
            _evaluate(fit, owner[corner], x, reach, node, order) for corner in corners.T[between]
        )
        value[:, node] = sum(fits) / order
    return value


def _fits(
    mesh: Mesh, moments: np.ndarray, sums: np.ndarray, upper: tuple[np.ndarray, np.ndarray]
) -> np.ndarray:
    """Fit polynomials around the vertices, in the place of `sums`; the number of the one that each vertex uses.

    The normal equations are given by the `upper` triangles of their matrices (k (k+1)/2, nv) and their
    right-hand sides (n k, nv). A boundary node, with cells on one side only, uses the polynomial of a near inner node.
    If none is near, it uses a linear fit to its own cells; if these are too few, their mean.
    """
    corners, nv, first = mesh.corners, sums.shape[1], mesh.dimension + 1
    k = int(upper[0][-1]) + 1
    good, inner = np.zeros(nv, dtype=bool), np.ones(nv, dtype=bool)
    inner[mesh.boundary[0][:, : mesh.dimension]] = False
    for block in blocks(nv):
        M, right = (
            np.empty((len(inner[block]), k, k)),
            sums[:, block].T.reshape(len(inner[block]), k, -1),
        )
        M[:, upper[0], upper[1]] = M[:, upper[1], upper[0]] = moments[:, block].T
        solvable = inner[block] & _well_posed(M)
        fit = np.zeros_like(right)
        fit[solvable] = np.linalg.solve(M[solvable], right[solvable])
        fit[~solvable, 0] = right[~solvable, 0] / np.maximum(M[~solvable, 0, 0], 1.0)[:, None]
        linear = np.flatnonzero(~solvable)
        linear = linear[_well_posed(M[linear, :first, :first])]
        fit[linear, :first] = np.linalg.solve(M[linear, :first, :first], right[linear, :first])
        good[block], sums[:, block] = solvable, fit.reshape(len(fit), -1).T

    owner = np.where(good, np.arange(nv), -1)
    # Breadth first along edges from the vertices with a fit; of several neighbours the nearest gives its fit, as
    # assignments overwrite in the order of falling distance.
    near = corners[~good[corners].all(axis=1)]
    ends = np.concatenate([mesh.cell.edges[:, :2], mesh.cell.edges[:, 1::-1]])
    links = near[:, ends].swapaxes(0, 1).reshape(-1, 2)
    distance = np.linalg.norm(mesh.points[links[:, 0]] - mesh.points[links[:, 1]], axis=1)
    alike = np.round(
        np.log(distance / distance.max(initial=0.0)) / ALIKE
    )  # so that rounding does not choose
    links = links[np.argsort(-alike, kind="stable")]  # the nearest one is assigned last
    for _ in range(REACH[mesh.order]):
        open_links = links[(owner[links[:, 0]] >= 0) & (owner[links[:, 1]] < 0)]
        owner[open_links[:, 1]] = owner[open_links[:, 0]]
    return np.where(owner < 0, np.arange(nv), owner)


def _well_posed(M: np.ndarray) -> np.ndarray:
    """Whether there are enough samples around a vertex (j,) for its normal equations (j, k, k)."""
    return np.linalg.eigvalsh(M)[:, 0] > SOLVABLE * M[:, 0, 0]


def _monomials(x: np.ndarray, order: int) -> np.ndarray:
    """All monomials (k, …) up to the order at the points x (d, …)."""
    factors = (
        chosen for k in range(order) for chosen in itertools.combinations_with_replacement(x, k + 1)
    )
    return np.stack(
        [np.ones_like(x[0]), *(functools.reduce(np.multiply, chosen) for chosen in factors)]
    )


def _evaluate(
    fit: np.ndarray,
    owner: np.ndarray,
    x: np.ndarray,
    reach: np.ndarray,
    nodes: np.ndarray,
    order: int,
) -> np.ndarray:
    """The polynomials `fit` (k n, nv) of the vertices `owner` (j,) at the `nodes` (j,) with coordinates x (nv, d)."""
    values = []
    for block in blocks(len(nodes)):
        vertex = owner[block]
        p = _monomials(((x[nodes[block]] - x[vertex]) / reach[vertex, None]).T, order)
        values.append(
            np.einsum(
                "kj,knj->nj", p, np.take(fit, vertex, axis=1).reshape(len(p), -1, len(vertex))
            )
        )
    return np.concatenate(values, axis=1)
