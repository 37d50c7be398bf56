"""How far is the discrete answer from the exact one? A recovery estimate of the discretization error.

The stress of a finite element solution jumps from element to element. Around every vertex a polynomial of
the degree of the displacement is fitted to it (superconvergent patch recovery; Zienkiewicz and Zhu, Int. J.
Numer. Meth. Engng. 33, 1992). The recovered stress is continuous and more accurate, so its distance from
the computed one, in the norm of the complementary energy, estimates the error of the mesh. At the boundary
polynomials are those of the inner vertices beside: a fit to the few cells there would follow their errors.
The recovered stress of linear cells, with one sample each, is no nearer to the true one than these are to
the polynomials, so that a part of their scatter is added: it is small where the stress is smooth, and counts
at corners and ends of contacts. The certificate, not the estimate, says how well the contact problem is
solved.
"""

from __future__ import annotations

import functools
import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from math import comb
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse

from ddmpi.body.stress import (
    STRAIGHT_BLOCK,
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
from ddmpi.mesh.elements import CELLS
from ddmpi.mesh.mesh import Mesh, bare
from ddmpi.scene.bodies import Material
from ddmpi.system.numbers import ROUNDING

SOLVABLE = 1e-5
"""Least eigenvalue of a patch's normal equations, relative to its number of samples, for a fit of full degree."""

EDGES = 2
"""How many edges away a vertex of the boundary borrows polynomials at most."""

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


class Recovery(NamedTuple):
    """The recovered stress of a body with nv nodes of which m are vertices, with polynomials of k terms (Pa).

    Attributes
    ----------
    nodes : (n, nv) its components at the nodes
    fits : (k, n, m) of the polynomials around the vertices, in distances from them over `reach`
    corners : (nt, c) the numbers of the cells' vertices among these m
    at, reach : (m, d) and (m,) places of the vertices and sizes of the cells around them (m)
    order : of the polynomials
    """

    nodes: np.ndarray
    fits: np.ndarray
    corners: np.ndarray
    at: np.ndarray
    reach: np.ndarray
    order: int

    def around(self, vertex: np.ndarray, places: np.ndarray) -> np.ndarray:
        """The polynomials (n, …, t) of vertices (t,) at places (d, …, t)."""
        centre = self.at[vertex].T.reshape(len(places), *[1] * (places.ndim - 2), -1)
        p = _monomials((places - centre) / self.reach[vertex], self.order)
        return np.einsum("k...t,knt->n...t", p, self.fits[..., vertex])


Moved = tuple[np.ndarray, np.ndarray | None]
"""Displacements (nv, d) of a body (m), and temperatures (nv,) over the state free of stress (K), or None."""


class Difference(NamedTuple):
    """How far recovered stresses are from computed ones, in some cells of one material, for k displacements of a body.

    Attributes
    ----------
    cells, material, curved : the numbers of the t cells, their material, and whether they are `summed`
    share : (q, t) the measures of the points of quadrature (m² or m³; in the plane times the thickness)
    computed, off : (k, n, q, t) components of σ_h and of σ* − σ_h there (Pa)
    scattered : (k, n, j, t) of linear cells, the distances of the samples from the polynomials of the cells' vertices
        (Pa); j is 0 for others
    """

    cells: slice | np.ndarray
    material: Material
    curved: bool
    share: np.ndarray
    computed: np.ndarray
    off: np.ndarray
    scattered: np.ndarray

    def product(self, one: int, other: int) -> np.ndarray:
        """(q, t) the shares of ∫ e_one : C⁻¹ : e_other of the points, of linear cells with a part of the scatter (J);
        `one` and `other` are numbers of displacements."""
        density = energy_density(self.material, self.off[one], self.off[other])
        if self.scattered.shape[2]:
            scatter = energy_density(self.material, self.scattered[one], self.scattered[other])
            density = density + SCATTER * scatter.mean(axis=0)
        return self.share * density

    def energies(self, one: int) -> np.ndarray:
        """(q, t) the shares of ∫ σ_h : C⁻¹ : σ_h of the points, of displacement `one` (J)."""
        return self.share * energy_density(self.material, self.computed[one])


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
    """The estimate of one body, as of `estimate_errors`. Not collective."""
    return estimate_errors([Deformed(mesh, material, u, heat)])[0]


def estimate_errors(bodies: Sequence[Deformed]) -> list[ErrorEstimate]:
    """Estimate the discretization errors of bodies, of small ones with a common material together. Not collective.

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
            found |= zip(some, _estimates([bodies[k] for k in some]), strict=True)
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


def _estimates(bodies: Sequence[Deformed]) -> Iterator[ErrorEstimate]:
    """The estimates of bodies of one material."""
    mesh, material, u, heat = _together(bodies)
    squares, energies, stress = _by_cells(mesh, material, u, heat)
    measures = mesh.measures()
    materials = [material] if isinstance(material, Material) else material.materials
    stiffest = max(one.tensor(mesh.dimension).max() for one in materials)
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
        if energy <= stiffest * len(areas) * rounding**2:  # a rigid motion
            own, energy = np.zeros(len(areas)), 0.0
        if locked:
            own = np.full(len(areas), np.nan)
        yield ErrorEstimate(own, areas, energy, stress[nodes])


def _by_cells(
    mesh: Mesh, material: Material | Composite, u: np.ndarray, heat: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Squared errors and squared energy norms (nt,) of the cells, and the recovered stress at the nodes."""
    moved = [(u, heat)]
    found = split, _, recovered = _recovered(mesh, material, moved)
    squares, energies = np.zeros((2, len(mesh.triangles)))
    for part in differences(mesh, material, moved, found):
        squares[part.cells] = part.product(0, 0).sum(axis=0)
        energies[part.cells] = part.energies(0).sum(axis=0)
        if heat is not None:  # in plane strain σ_zz has energy as well
            at = mesh.cell.rule[0] if part.curved else mesh.cell.samples[0]
            warm = cell_temperature(mesh, heat, at, part.cells)
            warm = warm if part.curved else _between(mesh) @ warm
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
    shapes = cell.shapes(points)
    between, places = _between(mesh), sample_places(mesh)
    for cells, uniform, curved in portions(mesh, material):
        computed, weights = between @ sampled[..., cells], uniform.thickness * cell.rule[1]
        share = weights[:, None] * measures[cells]
        if curved:
            of_all = (
                cell_stress(mesh, uniform, u, points, cells, curved, heat) for u, heat in moved
            )
            computed = np.concatenate([components(sigma) for sigma in of_all])
            share = weights[:, None] * mesh.map(cells, points).measures
        # η² = ∫ (σ* − σ_h) : C⁻¹ (σ* − σ_h), with σ* interpolated from the nodes (Zienkiewicz and Zhu).
        off = shapes @ np.take(recovered.nodes, split.triangles[cells].T, axis=1) - computed
        fits = [
            recovered.around(vertex, places[..., cells]) - sampled[..., cells]
            for vertex in recovered.corners[cells].T
        ]
        scattered = np.concatenate(fits if cell.linear else [sampled[:, :0, cells]], axis=1)
        k, n = len(moved), len(computed) // len(moved)
        of_each = (x.reshape(k, n, *x.shape[1:]) for x in (computed, off, scattered))
        yield Difference(cells, uniform, curved, share, *of_each)


def _between(mesh: Mesh) -> np.ndarray:
    """(p, q) the values at the p points of quadrature from those at the q samples, of stress on straight cells: σ_h is a
    combination of the derivatives of shape functions there, which needs no second evaluation."""
    spans = [
        mesh.cell.derivatives(places).swapaxes(0, 1).reshape(len(places), -1)
        for places in (mesh.cell.rule[0], mesh.cell.samples[0])
    ]
    return spans[0] @ np.linalg.pinv(spans[1])


def nodal_stress(
    mesh: Mesh, material: Material | Composite, u: np.ndarray, heat: np.ndarray | None = None
) -> np.ndarray:
    """The recovered stress at the nodes (nv, 4), in space (nv, 6), in Pa, with the columns and arguments of `stress`;
    where materials meet, the mean of theirs. Not collective."""
    split, _, recovered = _recovered(mesh, material, [(u, heat)])
    return _joined(mesh, material, split, recovered.nodes, heat)


def _recovered(
    mesh: Mesh, material: Material | Composite, moved: Sequence[Moved]
) -> tuple[Mesh, np.ndarray, Recovery]:
    """The mesh with separate nodes for every material, stress (k n, q, nt) of all displacements at the samples, and the
    recovered one."""
    split = mesh if isinstance(material, Material) else _apart(mesh, material)
    samples = mesh.cell.samples[0]
    stresses = [components(stress_at(mesh, material, u, samples, heat)) for u, heat in moved]
    sampled = np.concatenate(stresses)
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


def sample_places(mesh: Mesh) -> np.ndarray:
    """The places (d, q, nt) of the samples of all cells (m)."""
    samples = mesh.cell.samples[0]
    places = samples @ np.take(mesh.points.T, mesh.corners.T, axis=1)
    for bent in mesh.summed_blocks():
        places[..., bent] = mesh.map(bent, samples).places.transpose(2, 0, 1)
    return places


def _recover(mesh: Mesh, sampled: np.ndarray) -> Recovery:
    """The recovered stress from that (n, q, nt) at the samples, in Pa: polynomials around the vertices, fitted or, at
    the boundary, `_borrowed`; at middle nodes the mean of those of both corners."""
    order, places = mesh.order, sample_places(mesh)
    vertices, corners = np.unique(mesh.corners, return_inverse=True)
    corners, at = corners.reshape(mesh.corners.shape), mesh.points[vertices]
    # Coordinates relative to the vertex, over the size of its cells, keep the normal equations well conditioned.
    reach = np.zeros(len(at))
    for block in blocks(len(corners)):
        np.maximum.at(
            reach,
            corners[block],
            np.linalg.norm(np.ptp(at[corners[block]], axis=1), axis=1)[:, None],
        )
    outer = np.searchsorted(vertices, np.unique(mesh.boundary[0][:, : mesh.cell.facet.corners]))
    cells = np.repeat(np.arange(len(corners)), corners.shape[1])
    around = sparse.csr_matrix((np.ones(corners.size), (corners.ravel(), cells)))  # (m, nt)
    # At the boundary cells count as often as they are around the vertex or one beside it.
    at_boundary = np.zeros(len(at))
    at_boundary[outer] = 1.0
    beside = sparse.diags(at_boundary) @ around @ around.T > 0.0
    patches = sparse.csr_matrix(around + beside.astype(float) @ around)
    fits = np.empty((comb(mesh.dimension + order, order), len(sampled), len(at)))
    ends = np.arange(0, patches.nnz + STRAIGHT_BLOCK, STRAIGHT_BLOCK)
    ends = np.unique(np.searchsorted(patches.indptr, ends).clip(max=len(at)))
    for first, last in itertools.pairwise(ends):
        some = patches[first:last]
        vertex = first + np.repeat(np.arange(last - first), np.diff(some.indptr))
        p = _monomials((places[..., some.indices] - at[vertex].T[:, None]) / reach[vertex], order)
        fits[..., first:last] = _fits(p, sampled[..., some.indices], some, mesh.dimension + 1)
    found = Recovery(np.zeros((len(sampled), len(mesh.points))), fits, corners, at, reach, order)
    _borrow(found, around, outer, CELLS[mesh.dimension, order].nodes[:, 1:])
    found.nodes[:, vertices] = fits[0]
    for node, between in zip(mesh.triangles.T[mesh.cell.corners :], mesh.cell.between, strict=True):
        for block in blocks(len(node)):
            found.nodes[:, node[block]] = (
                sum(
                    found.around(corner, mesh.points[node[block]].T)
                    for corner in corners[block].T[between]
                )
                / order
            )
    return found


def _borrow(
    found: Recovery, around: sparse.csr_matrix, lonely: np.ndarray, points: np.ndarray
) -> None:
    """Give `lonely` vertices (k,) the mean of the polynomials of the others that share cells `around` them (m, nt).

    With few cells, all on one side, a fit follows their errors. First those beside others borrow, then those beside
    these, as at corners of one cell. Where there are none, as in walls of one element, fits stay. A polynomial is known
    by its values at as many `points` (·, d) as it has terms.
    """
    inverse = np.linalg.inv(_monomials(points.T, found.order).T)
    others = np.ones(len(found.at))
    others[lonely] = 0.0
    for _ in range(EDGES):
        lenders = sparse.csr_matrix(around[lonely] @ around.T @ sparse.diags(others))
        lenders.eliminate_zeros()
        some = np.flatnonzero(np.diff(lenders.indptr))
        for block in blocks(len(some)):
            borrower, lender = lonely[some[block]], lenders[some[block]]
            counts = np.diff(lender.indptr)
            to = np.repeat(borrower, counts)
            places = found.at[to].T[:, None] + found.reach[to] * points.T[:, :, None]
            values = found.around(lender.indices, places)
            means = np.add.reduceat(values, lender.indptr[:-1], axis=-1) / counts
            found.fits[..., borrower] = np.einsum("kq,nqj->knj", inverse, means)
        others[lonely[some]] = 1.0
        lonely = np.delete(lonely, some)


def _fits(p: np.ndarray, sampled: np.ndarray, patches: sparse.csr_matrix, first: int) -> np.ndarray:
    """Polynomials (k, n, j) fitted to the samples (n, q, i) of the i cells in the rows of `patches`
    (j, nt), with monomials p (k, q, i). With too few samples they are linear, with `first` terms,
    or their mean."""
    k, n, starts = len(p), len(sampled), patches.indptr[:-1]
    M, right = np.empty((len(starts), k, k)), np.empty((len(starts), k, n))
    for a, weighted in enumerate(patches.data * p):
        for b in range(a, k):
            M[:, a, b] = M[:, b, a] = np.add.reduceat((weighted * p[b]).sum(axis=0), starts)
        right[:, a] = np.add.reduceat((weighted * sampled).sum(axis=1), starts, axis=1).T
    fit, left = np.zeros_like(right), np.arange(len(starts))
    for terms in (k, first, 1):
        solvable = left[_well_posed(M[left, :terms, :terms])]
        fit[solvable, :terms] = np.linalg.solve(
            M[solvable, :terms, :terms], right[solvable, :terms]
        )
        left = np.setdiff1d(left, solvable)
    return fit.transpose(1, 2, 0)


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
