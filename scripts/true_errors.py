"""True errors in the energy norm: by quadrature against the stress of a much finer mesh, or of a closed form.

Nothing here knows of the estimate. Reference meshes are finest where the stress has no limit, so that their own errors
are small beside those of the meshes that are measured.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import numpy as np
from scipy.spatial import cKDTree

from ddmpi.body.stress import compliance_of, components
from ddmpi.mesh.elements import invert
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.run.answer import Answer
from ddmpi.scene.bodies import Material, MeshSpec
from meshes import stress_at

CANDIDATES = {2: 24, 3: 80}
"""Of how many cells, by the distance from their centres, one holds a place."""

Stress = Callable[[np.ndarray], np.ndarray]
"""Tensors (d, d, k) of an exact stress at places (k, d) (Pa)."""


def energy_density(material: Material, sigma: np.ndarray) -> np.ndarray:
    """σ : C⁻¹ : σ (…) in J/m³ of stresses (n, …) in Pa, which are `components`."""
    compliance = compliance_of(material, int(np.sqrt(2 * len(sigma))))
    return np.einsum("c...,cd,d...->...", sigma, compliance, sigma)


def clustered(ends: Sequence[float], n: int, power: float) -> np.ndarray:
    """Coordinates of n cells between each two of the `ends`, clustered towards these with a `power`."""
    part = np.linspace(0.0, 1.0, n + 1)
    part = np.where(part < 0.5, 0.5 * (2 * part) ** power, 1 - 0.5 * (2 - 2 * part) ** power)
    steps = [a + (b - a) * part[1:] for a, b in itertools.pairwise(ends)]
    return np.concatenate([[ends[0]], *steps])


def grid(path: Path, lines: Sequence[np.ndarray]) -> dict:
    """The file of a rectangle or box with cells between the coordinates `lines` of each axis, as quadratic elements;
    groups are those of the shape."""
    import meshio

    d = len(lines)
    divisions = tuple(len(line) - 1 for line in lines)
    shape = "rectangle" if d == 2 else "box"
    mesh = generate_rectangle(
        MeshSpec(shape=shape, size=tuple(map(float, divisions)), divisions=divisions)
    )
    points = np.zeros((len(mesh.points), 3))
    for k, line in enumerate(lines):
        points[:, k] = line[np.round(mesh.points[:, k]).astype(int)]
    kinds = ("line", "triangle", "tetra")[d - 2 :]
    cells = [*((kinds[0], facets) for facets in mesh.groups.values()), (kinds[1], mesh.triangles)]
    tags = [np.full(len(each), k + 1) for k, (_, each) in enumerate(cells)]
    meshio.write(
        path,
        meshio.Mesh(
            points,
            cells,
            cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data={name: np.array([k + 1, d - 1]) for k, name in enumerate(mesh.groups)},
        ),
        file_format="gmsh22",
        binary=False,
    )
    return {"file": str(path), "order": 2}


def stress_in(mesh: Mesh, material: Material, u: np.ndarray, places: np.ndarray) -> np.ndarray:
    """The stress (d, d, k) of a displacement u (nv, d) at places (k, d) in a mesh, or just outside its boundary."""
    d, x = mesh.dimension, mesh.points[mesh.triangles]
    corners = x[:, : d + 1]
    inverse = np.linalg.inv((corners[:, 1:] - corners[:, :1]).swapaxes(1, 2))
    _, near = cKDTree(corners.mean(axis=1)).query(places, min(CANDIDATES[d], len(x)))
    cell, least = near[:, 0].copy(), np.full(len(places), -np.inf)
    for candidate in near.T:
        left = np.flatnonzero(least < -1e-9)
        some = candidate[left]
        at = np.einsum("kij,kj->ki", inverse[some], places[left] - corners[some, 0])
        depth = np.minimum(at.min(axis=1), 1.0 - at.sum(axis=1))
        better = depth > least[left]
        cell[left[better]], least[left[better]] = some[better], depth[better]
    at = np.einsum("kij,kj->ki", inverse[cell], places - corners[cell, 0])
    for _ in range(8):  # curved cells: corrections by the straight ones
        shapes = mesh.cell.shapes(np.column_stack([1.0 - at.sum(axis=1), at]))
        off = places - np.einsum("ki,kic->kc", shapes, x[cell])
        at += np.einsum("kij,kj->ki", inverse[cell], off)
    slopes = mesh.cell.derivatives(np.column_stack([1.0 - at.sum(axis=1), at]))  # (d, k, i)
    tangents = np.einsum("aki,kic->ack", slopes, x[cell])
    gradient = np.einsum(
        "aki,kic,ajk->cjk", slopes, u[mesh.triangles[cell]], invert(tangents)[0], optimize=True
    )
    if mesh.axisymmetric:  # the strain around the axis, u_r / r, has no shear
        turned = np.zeros((3, 3, len(places)))
        shapes = mesh.cell.shapes(np.column_stack([1.0 - at.sum(axis=1), at]))
        turned[:2, :2] = gradient
        turned[2, 2] = (shapes * u[mesh.triangles[cell], 0]).sum(axis=1) / places[:, 0]
        gradient = turned
    return np.einsum("ijmn,mnk->ijk", material.tensor(len(gradient)), gradient)


def against_mesh(answer: Answer, fine: Answer) -> float:
    """The error of an answer in the energy norm, relative to that of the answer on a finer mesh."""
    off = whole = 0.0
    coarse = {body.spec.name: body for body in answer.solved.assembly.bodies}
    for body in fine.solved.assembly.bodies:
        name, mesh, material = body.spec.name, body.mesh, body.spec.material
        points, weights = mesh.cell.quadrature
        places = mesh.map(slice(None), points)
        exact = stress_at(mesh, material, fine.bodies[name].displacement, points)
        found = stress_in(
            coarse[name].mesh,
            material,
            answer.bodies[name].displacement,
            places.places.reshape(-1, mesh.dimension),
        ).reshape(exact.shape)
        shares = weights[:, None] * places.measures
        off += float((shares * energy_density(material, components(found - exact))).sum())
        whole += float((shares * energy_density(material, components(exact))).sum())
    return float(np.sqrt(off / whole))


def against_form(answer: Answer, exact: Mapping[str, Stress]) -> float:
    """The error of an answer in the energy norm, relative to that of the exact stresses by bodies."""
    off = whole = 0.0
    for body in answer.solved.assembly.bodies:
        name, mesh, material = body.spec.name, body.mesh, body.spec.material
        points, weights = mesh.cell.fine
        mapped = mesh.map(slice(None), points)
        found = stress_at(mesh, material, answer.bodies[name].displacement, points)
        sigma = exact[name](mapped.places.reshape(-1, mesh.dimension)).reshape(found.shape)
        shares = weights[:, None] * mapped.measures
        off += float((shares * energy_density(material, components(found - sigma))).sum())
        whole += float((shares * energy_density(material, components(sigma))).sum())
    return float(np.sqrt(off / whole))


def turned_stress(answer: Answer, name: str) -> Stress:
    """The stress in space around z of a body of an axisymmetric answer, whose axis is y."""
    mesh = next(body.mesh for body in answer.solved.assembly.bodies if body.spec.name == name)
    u, material = answer.bodies[name].displacement, answer.solved.assembly.scene.body[0].material

    def stress(places: np.ndarray) -> np.ndarray:
        radius = np.hypot(places[:, 0], places[:, 1])
        flat = stress_in(mesh, material, u, np.column_stack([radius, places[:, 2]]))
        x, y = places[:, :2].T / radius
        zero, one = np.zeros_like(x), np.ones_like(x)
        axes = np.array([[x, zero, -y], [y, zero, x], [zero, one, zero]])  # of r, z and around
        return np.einsum("iak,jbk,abk->ijk", axes, axes, flat)

    return stress


def ring_stress(
    inside: float, outside: float, pressures: tuple[float, float], poisson: float
) -> Stress:
    """Lamé's stress in a ring or tube around z under pressures at its radii, without strain along z."""

    def stress(places: np.ndarray) -> np.ndarray:
        d, radius = places.shape[1], np.hypot(places[:, 0], places[:, 1])
        p, q = pressures
        width = outside**2 - inside**2
        mean = (p * inside**2 - q * outside**2) / width
        deviation = (q - p) * (inside * outside) ** 2 / width / radius**2
        normal = np.stack([places[:, 0], places[:, 1]]) / radius
        along = normal[:, None] * normal
        plane = np.eye(2)[..., None] * (mean - deviation) + 2 * deviation * along
        sigma = np.zeros((d, d, len(places)))
        sigma[:2, :2] = plane
        sigma[2:, 2:] = 2 * poisson * mean
        return sigma

    return stress
