"""How far is the discrete answer from the exact one? A recovery estimate of the discretization error.

The stress of a finite element solution jumps from element to element. Around every node a polynomial of
the degree of the displacement is fitted to it (superconvergent patch recovery; Zienkiewicz and Zhu, Int. J.
Numer. Meth. Engng. 33, 1992). The recovered stress is continuous and more accurate, so its distance from
the computed one, in the norm of the complementary energy, estimates the error of the mesh. The certificate,
not the estimate, says how well the contact problem is solved.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ddmpi.body.stress import CENTROID, Composite, blocks, curved_stress, energy_density, of_part, stress_at
from ddmpi.mesh.elements import TRIANGLE
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import Material

_INNER = (np.ones((3, 3)) + 3 * np.eye(3)) / 6

_SAMPLES = {1: CENTROID, 2: _INNER}
"""Barycentric points where the stress of an element is more accurate than elsewhere, by order."""

QUADRATURE = {1: (_INNER, np.full(3, 1 / 3)), 2: TRIANGLE}
"""Quadrature (points, weights) exact to degree 2 and 4, by order."""

UNSTRAINED = 1e-12
"""Relative error of a computed displacement. A displacement with smaller strains counts as a rigid motion."""

SOLVABLE = 1e-8
"""Smallest eigenvalue of a patch's normal equations, relative to its number of samples, for which a fit is made."""

REACH = 4
"""How many edges from a node the patch may lie whose fit the node borrows."""

ROUNDING = 1e-9
"""Distances that differ relatively by less than this are the same."""


@dataclass(frozen=True)
class ErrorEstimate:
    """The estimated discretization error of one body, in the energy norm.

    Attributes
    ----------
    squares : (nt,) squared error of each triangle, ∫ (σ* − σ_h) : C⁻¹ (σ* − σ_h) (J per metre of depth)
    areas : (nt,) areas of the triangles (m²)
    energy : squared energy norm ∫ σ_h : C⁻¹ σ_h, twice the strain energy (J per metre of depth)
    """

    squares: np.ndarray
    areas: np.ndarray
    energy: float

    @property
    def area(self) -> float:
        """Area of the body (m²)."""
        return float(self.areas.sum())

    @property
    def total(self) -> float:
        """The squared error of the body."""
        return float(self.squares.sum())


def relative_error(squared_error: float, energy: float) -> float:
    """‖e‖ / ‖u‖ in the energy norm, with ‖u‖² = ‖u_h‖² + ‖e‖²; zero where nothing is strained."""
    size = squared_error + energy
    return float(np.sqrt(squared_error / size)) if size else 0.0


@dataclass(frozen=True)
class DiscretizationError:
    """The estimated discretization error of all bodies together, as one rank holds it.

    Attributes
    ----------
    relative : ‖e‖ / ‖u‖ in the energy norm of all bodies; nan if one of them has no estimate
    by_body : each body's part of ‖e‖, over the same ‖u‖; nan as well
    own : the estimates of the rank's own bodies
    mean : energy norm squared over area, of all bodies (J/m³)
    """

    relative: float
    by_body: dict[str, float]
    own: dict[str, ErrorEstimate]
    mean: float

    def density(self, body: str) -> np.ndarray | None:
        """Error of each triangle (nt,) per area over the mean energy norm per area, without unit; None if unknown."""
        if np.isnan(self.relative):
            return None
        own = self.own[body]
        return np.sqrt(own.squares / own.areas / self.mean) if self.mean else np.zeros(len(own.areas))


def sum_errors(bodies: Mapping[str, tuple[float, float, float]],
               own: dict[str, ErrorEstimate]) -> DiscretizationError:
    """Sum the squared errors, squared energy norms and areas of all bodies, by name. Not collective."""
    errors, energies, areas = (np.array(column) for column in zip(*bodies.values(), strict=True))
    size = errors.sum() + energies.sum()
    parts = np.sqrt(errors / size) if size else np.zeros(len(errors))
    return DiscretizationError(relative_error(errors.sum(), energies.sum()),
                               dict(zip(bodies, parts.tolist(), strict=True)), own,
                               float(energies.sum() / areas.sum()))


def estimate_error(mesh: Mesh, material: Material | Composite, u: np.ndarray) -> ErrorEstimate:
    """Estimate the discretization error of the displacement `u` (nv, 2) in metres. Not collective.

    Energy and error are zero where only rounding strains the body. Errors of linear triangles that lock are nan: they
    hardly deform, so that their stress jumps little however wrong it is. Where materials meet, stress does jump, and is
    recovered from either side.
    """
    cells, order = mesh.triangles, mesh.order
    area, (points, weights) = mesh.areas(), QUADRATURE[order]
    straight = area.copy() if len(mesh.curved) else area
    straight[mesh.curved] = 0.0
    sampled = stress_at(mesh, material, u, _SAMPLES[order])
    between = np.ones((len(points), 1)) if order == 1 else 2 * points - 1 / 3  # constant, or linear between samples
    shapes = mesh.element.shapes(points)
    parts = mesh if isinstance(material, Material) else _apart(mesh, material)
    recovered = _recover(parts, sampled)
    squares = np.zeros(len(cells))
    energy = 0.0
    for block in blocks(len(cells)):
        computed = np.einsum("qs,tsc->qtc", between, sampled[block])
        difference = np.einsum("qi,tic->qtc", shapes, recovered[parts.triangles[block]]) - computed
        own = of_part(material, block)
        for weight, s, e in zip(weights, computed, difference, strict=True):
            squares[block] += weight * straight[block] * energy_density(own, e)
            energy += weight * float(straight[block] @ energy_density(own, s))
    for bent in mesh.curved_blocks():
        computed = curved_stress(mesh, material, u, points, bent).swapaxes(0, 1)
        difference = np.einsum("qi,tic->qtc", shapes, recovered[parts.triangles[bent]]) - computed
        own = of_part(material, bent)
        for part, s, e in zip(weights[:, None] * mesh.map(bent).areas, computed, difference, strict=True):
            squares[bent] += part * energy_density(own, e)
            energy += float(part @ energy_density(own, s))
    first, shear = material.lame
    if energy <= np.max(first + 2 * shear) * len(cells) * (UNSTRAINED * np.abs(u).max()) ** 2:
        squares, energy = np.zeros(len(cells)), 0.0
    if order == 1 and material.locks:
        squares = np.full(len(cells), np.nan)
    return ErrorEstimate(squares, area, energy)


def _apart(mesh: Mesh, material: Composite) -> Mesh:
    """The mesh with nodes of its own for each material, so that no patch reaches from one into another."""
    size = len(material.materials)
    keys, cells = np.unique(mesh.triangles * size + material.number[:, None], return_inverse=True)
    return Mesh(mesh.points[keys // size], cells.reshape(mesh.triangles.shape), {})


def _recover(mesh: Mesh, sampled: np.ndarray) -> np.ndarray:
    """The recovered stress (nv, 3) at all nodes from that at the samples (nt, q, 3), in Pa."""
    cells, xy, order = mesh.triangles, mesh.points, mesh.order
    corners, k = cells[:, :3], (3, 6)[order - 1]
    vertices = np.flatnonzero(np.bincount(corners.ravel()))
    nv = int(vertices[-1]) + 1
    inner = _inner(mesh, nv)
    places = np.einsum("qi,tid->qtd", _SAMPLES[order], xy[corners])
    for bent in mesh.curved_blocks():
        places[:, bent] = mesh.map(bent, _SAMPLES[order]).places
    reach = np.zeros(nv)
    for block in blocks(len(corners)):
        np.maximum.at(reach, corners[block], np.linalg.norm(np.ptp(xy[corners[block]], axis=1), axis=1)[:, None])
    upper = np.triu_indices(k)
    moments, sums = np.zeros((len(upper[0]), nv)), np.zeros((3 * k, nv))  # the normal equations
    for i, place, stress in ((i, p, s) for i in range(3) for p, s in zip(places, sampled.swapaxes(0, 1), strict=True)):
        vertex = corners[:, i]
        p = _monomials((place - xy[vertex]) / reach[vertex, None], order)
        for c, (a, b) in enumerate(zip(*upper, strict=True)):
            moments[c] += np.bincount(vertex, p[:, a] * p[:, b], nv)
        for c, (a, b) in enumerate(itertools.product(range(k), range(3))):
            sums[c] += np.bincount(vertex, p[:, a] * stress[:, b], nv)
    del places, place, stress, p  # large meshes need the memory
    owner, fit = _fits(mesh, moments, sums, upper, inner), sums
    del moments
    value = np.zeros((len(xy), 3))
    value[vertices] = _evaluate(fit, owner[vertices], xy, reach, xy[vertices], order)
    if order == 2:  # at the middle of an edge, the mean of the fits of its two ends
        for i in range(3):
            ends, middle = cells[:, [i, (i + 1) % 3]], cells[:, 3 + i]
            value[middle] = 0.5 * sum(_evaluate(fit, owner[ends[:, e]], xy, reach, xy[middle], order) for e in (0, 1))
    return value


def _fits(mesh: Mesh, moments: np.ndarray, sums: np.ndarray, upper: tuple[np.ndarray, np.ndarray],
          inner: np.ndarray) -> np.ndarray:
    """Fit polynomials around the vertices, in the place of `sums`; the number of the one that each vertex uses.

    The normal equations are given by the `upper` triangles of their matrices (k (k+1)/2, nv) and their
    right-hand sides (3k, nv). A boundary node, not `inner` (nv,), with elements on one side only, uses the polynomial
    of a near inner node. If none is near, it uses a linear fit to its own elements; if these are too few, their mean.
    """
    corners, (nv, k) = mesh.triangles[:, :3], (sums.shape[1], len(sums) // 3)
    good = np.zeros(nv, dtype=bool)
    for block in blocks(nv):
        M, right = np.empty((len(inner[block]), k, k)), sums[:, block].T.reshape(-1, k, 3)
        M[:, upper[0], upper[1]] = M[:, upper[1], upper[0]] = moments[:, block].T
        solvable = inner[block] & _well_posed(M)
        fit = np.zeros_like(right)
        fit[solvable] = np.linalg.solve(M[solvable], right[solvable])
        fit[~solvable, 0] = right[~solvable, 0] / np.maximum(M[~solvable, 0, 0], 1.0)[:, None]
        linear = np.flatnonzero(~solvable)
        linear = linear[_well_posed(M[linear, :3, :3])]
        fit[linear, :3] = np.linalg.solve(M[linear, :3, :3], right[linear, :3])
        good[block], sums[:, block] = solvable, fit.reshape(-1, 3 * k).T

    owner = np.where(good, np.arange(nv), -1)
    near = corners[~good[corners].all(axis=1)]
    links = np.concatenate([near[:, pair] for pair in ([0, 1], [1, 2], [2, 0], [1, 0], [2, 1], [0, 2])])
    distance = np.linalg.norm(mesh.points[links[:, 0]] - mesh.points[links[:, 1]], axis=1)
    alike = np.round(np.log(distance / distance.max(initial=0.0)) / ROUNDING)  # so that rounding does not choose
    links = links[np.argsort(-alike, kind="stable")]  # the nearest one is assigned last
    for _ in range(REACH):
        open_links = links[(owner[links[:, 0]] >= 0) & (owner[links[:, 1]] < 0)]
        owner[open_links[:, 1]] = owner[open_links[:, 0]]
    return np.where(owner < 0, np.arange(nv), owner)


def _well_posed(M: np.ndarray) -> np.ndarray:
    """Whether there are enough samples around a vertex (j,) for its normal equations (j, k, k)."""
    return np.linalg.eigvalsh(M)[:, 0] > SOLVABLE * M[:, 0, 0]


def _inner(mesh: Mesh, nv: int) -> np.ndarray:
    """Whether a node (nv,) has triangles all around it: their angles make a full turn."""
    corners = mesh.triangles[:, :3]
    turn, angle = np.zeros(nv), np.empty(len(corners))
    for i in range(3):
        j, k = (i + 1) % 3, (i + 2) % 3
        for block in blocks(len(corners)):
            x, y = mesh.points[corners[block]].transpose(2, 1, 0)
            ax, ay, bx, by = x[j] - x[i], y[j] - y[i], x[k] - x[i], y[k] - y[i]
            angle[block] = np.arctan2(ax * by - ay * bx, ax * bx + ay * by)
        turn += np.bincount(corners[:, i], angle, nv)
    return turn > 2 * np.pi - 1e-3


def _monomials(x: np.ndarray, order: int) -> np.ndarray:
    """All monomials (…, k) up to the order at the points x (…, 2)."""
    a, b = x[..., 0], x[..., 1]
    terms = [np.ones_like(a), a, b] + ([a * a, a * b, b * b] if order == 2 else [])
    return np.stack(terms, axis=-1)


def _evaluate(fit: np.ndarray, owner: np.ndarray, xy: np.ndarray, reach: np.ndarray, at: np.ndarray,
              order: int) -> np.ndarray:
    """The polynomials `fit` (3k, nv) of the vertices `owner` (j,) at the points `at` (j, 2)."""
    value = np.empty((len(at), 3))
    for block in blocks(len(at)):
        vertex = owner[block]
        p = _monomials((at[block] - xy[vertex]) / reach[vertex, None], order)
        value[block] = np.einsum("jk,jkc->jc", p, np.ascontiguousarray(fit[:, vertex].T).reshape(len(p), -1, 3))
    return value
