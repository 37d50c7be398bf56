"""Stress of a computed displacement, and the energy in it.

Components of tensors come first: (d, d, q, t) at q points of t cells.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from msgspec.structs import replace

from ddmpi.mesh.boundary import material_numbers
from ddmpi.mesh.elements import facet_measures, invert, normals
from ddmpi.mesh.mesh import BLOCK, Facets, Mesh, tangents
from ddmpi.scene.bodies import BodySpec, Material

STRAIGHT_BLOCK = 4 * BLOCK
"""Number of straight cells, or nodes, per block of work, so that intermediate results stay in the processor's cache."""

COLUMNS = ((0, 0), (1, 1), (2, 2), (0, 1), (1, 2), (0, 2))
"""The components in the columns of `stress`; in the plane the last two are left out."""


@dataclass(frozen=True)
class Composite:
    """Several materials in one body, in place of a `Material`: with different constants, all in the same plane state.
    `number` (nt,) are those of the cells."""

    materials: Sequence[Material]
    number: np.ndarray

    def apart(self, mesh: Mesh) -> Mesh:
        """The mesh of the body, at home, with separate nodes for every material, made once. Not collective."""
        home, split = vars(self).get("_apart", (None, None))
        if home is not mesh.home:
            home, size = mesh.home, len(self.materials)
            keys, cells = np.unique(
                home.triangles * size + self.number[:, None], return_inverse=True
            )
            split = dataclasses.replace(
                home,
                points=home.points[keys // size],
                triangles=cells.reshape(home.triangles.shape),
            )
            vars(self)["_apart"] = home, split
        return split


def material_of(mesh: Mesh, body: BodySpec) -> Material | Composite:
    """The material of a body, or those of its triangles. Not collective. Raises InputError, see `material_numbers`."""
    if isinstance(body.material, Material):
        return body.material
    constants = [replace(part, on=None) for part in body.material]
    same = np.array(
        [constants.index(entry) for entry in constants]
    )  # entries that differ in their surfaces only
    kept, number = np.unique(same[material_numbers(mesh, body)], return_inverse=True)
    materials = [body.material[k] for k in kept]
    return Composite(materials, number.ravel()) if len(materials) > 1 else materials[0]


def thickness_of(mesh: Mesh, body: BodySpec) -> np.ndarray:
    """The thickness (nt,) of the cells, over the depth."""
    material = (
        material_of(mesh, body)
        if any(one.thickness != 1.0 for one in body.materials)
        else body.materials[0]
    )
    if isinstance(material, Material):
        return np.full(len(mesh.triangles), material.thickness)
    return np.array([one.thickness for one in material.materials])[material.number]


def portions(
    mesh: Mesh, material: Material | Composite
) -> list[tuple[slice | np.ndarray, Material, bool]]:
    """All cells in blocks that stay in cache, with their material, and whether they are `summed` by quadrature."""
    if isinstance(material, Material) and not len(mesh.summed):
        return [(block, material, False) for block in blocks(len(mesh.triangles))]
    number = (
        np.zeros(len(mesh.triangles), int) if isinstance(material, Material) else material.number
    )
    bent = np.zeros(len(number), bool)
    bent[mesh.summed] = True
    pieces: list[tuple[slice | np.ndarray, Material, bool]] = []
    for k, uniform in enumerate(
        [material] if isinstance(material, Material) else material.materials
    ):
        for curved in (False, True):
            cells, size = (
                np.flatnonzero((number == k) & (bent == curved)),
                BLOCK if curved else STRAIGHT_BLOCK,
            )
            pieces += [
                (cells[start : start + size], uniform, curved)
                for start in range(0, len(cells), size)
            ]
    return pieces


def modulus_beside(mesh: Mesh, material: Material | Composite, boundary: Facets) -> float:
    """Plane modulus (Pa) of the cells beside a `boundary`, along its normals: the harmonic mean by measures."""
    if isinstance(material, Material) and material.shear is None:
        return material.plane_modulus
    facets, cells, *_ = boundary
    across = normals(mesh.points[facets[:, : mesh.dimension]])
    across /= np.linalg.norm(across, axis=1)[:, None]
    kinds = material.materials if isinstance(material, Composite) else [material]
    number = (
        material.number[cells] if isinstance(material, Composite) else np.zeros(len(cells), int)
    )
    moduli = np.array([moduli_along(kind, across) for kind in kinds])[number, np.arange(len(cells))]
    measures = facet_measures(mesh.points[facets], mesh.axisymmetric)
    return float(measures.sum() / (measures / moduli).sum())


def moduli_along(material: Material, directions: np.ndarray) -> np.ndarray:
    """Plane moduli (k,) of a material along unit vectors (k, d) (Pa): under stress along them, with the strain in one
    transverse direction constrained. In space the harmonic mean over two such directions; in plane stress none is."""
    if material.shear is None:
        return np.full(len(directions), material.plane_modulus)
    S, (k, d) = material.compliance, directions.shape
    n = np.pad(directions, ((0, 0), (0, 3 - d)))
    strains = np.einsum("ijkl,ni,nj->nkl", S, n, n)
    compliance = np.einsum("nkl,nk,nl->n", strains, n, n)
    across = [np.tile([0.0, 0.0, 1.0], (k, 1))]
    if d == len(S):
        one = np.cross(n, np.eye(3)[np.abs(n).round(6).argmin(axis=1)])  # rounding decides nothing
        across = [
            one / np.linalg.norm(one, axis=1)[:, None],
            np.cross(n, one / np.linalg.norm(one, axis=1)[:, None]),
        ]
    for t in across if material.plane != "stress" else ():
        # With σ_nn = 1 and ε_tt = 0: σ_tt = −S_ttnn/S_tttt, so that 1/E' = S_nnnn − S_nntt²/S_tttt; isotropic, that is
        # (1 − ν²)/E.
        constrained = np.einsum("nkl,nk,nl->n", strains, t, t) ** 2 / np.einsum(
            "ijkl,ni,nj,nk,nl->n", S, t, t, t, t
        )
        compliance = compliance - constrained / len(across)
    return 1.0 / compliance


def thermal(material: Material, dimension: int) -> tuple[np.ndarray, float, float, float]:
    """Effects of a temperature of 1 K under fully constrained strain: β (d, d) of the stress −β (Pa/K); twice the
    elastic energy (J/m³/K²); b of σ_zz = a : σ − b in the plane, where a is `Material.across`; and the energy that a
    body free in the plane keeps in plane strain (J/m³/K²), else zero."""
    # β = C : α. In plane strain ε_zz = 0 as well, so that the tensor in space applies: (1 + ν) α in the plane.
    d, alpha = 2 if material.plane == "stress" else 3, material.expansions
    beta = np.einsum("ijkl,kl->ij", material.tensor(d), alpha[:d, :d])
    out = float(alpha[2, 2])
    across = out * float(material.moduli[2]) * (d > dimension)
    return beta[:dimension, :dimension], float((alpha[:d, :d] * beta).sum()), across, out * across


def stress(
    mesh: Mesh, material: Material | Composite, u: np.ndarray, heat: np.ndarray | None = None
) -> np.ndarray:
    """Mean stress of each cell: (nt, 4) σ_xx, σ_yy, σ_zz, σ_xy in Pa, in space (nt, 6) with σ_yz, σ_xz.

    In the plane σ_zz is that of plane strain, or zero, around an axis the circumferential stress. `u` (nv, d) is the
    displacement (m), `heat` (nv,) the temperature over the state free of stress (K). Not collective.
    """
    means = np.empty((2 * mesh.dimension, len(mesh.triangles)))
    for cells, uniform, curved in portions(mesh, material):
        points, weights = mesh.cell.quadrature if curved else (mesh.cell.middle, np.ones(1))
        sigma, shares = cell_stress(mesh, uniform, u, points, cells, curved, heat), np.ones((1, 1))
        if curved:
            shares = weights[:, None] * mesh.map(cells, points).measures
        mean, warm = (sigma * shares).sum(axis=2) / shares.sum(axis=0), None
        if heat is not None:
            warm = (cell_temperature(mesh, heat, points, cells) * shares).sum(axis=0) / shares.sum(
                axis=0
            )
        means[:, cells] = columns_of(mean, uniform, warm)[: len(means)]
    return np.ascontiguousarray(means.T)


def columns_of(sigma: np.ndarray, material: Material, warm: np.ndarray | None) -> np.ndarray:
    """The columns (4, n) of `stress` from tensors (2, 2, n) in Pa, of larger ones (6, n), with temperatures (n,) in K.

    Around an axis the last two are zero.
    """
    d = len(sigma)
    rows = [sigma[i, j] for i, j in COLUMNS if max(i, j) < d]
    if d == 2:
        rows.insert(
            d,
            np.einsum("kl,kln->n", material.across, sigma)
            - (0.0 if warm is None else thermal(material, d)[2] * warm),
        )
    return np.stack(rows)


def principal(sigma: np.ndarray) -> np.ndarray:
    """Principal stresses (nt, 3) in Pa from `stress`, the largest first; tension is positive."""
    stresses, finite = np.full((len(sigma), 3), np.nan), np.isfinite(sigma).all(axis=1)
    stresses[finite] = np.linalg.eigvalsh(_tensors(sigma[finite]))[:, ::-1]
    return stresses


def turned(sigma: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """`stress` (nt, …) in other axes: T ↦ Q T Qᵀ with a rotation Q (d, d); in the plane σ_zz stays."""
    Q = np.eye(3)
    Q[: len(rotation), : len(rotation)] = rotation
    tensors = Q @ _tensors(sigma) @ Q.T
    return np.column_stack([tensors[:, i, j] for i, j in COLUMNS[: sigma.shape[1]]])


def _tensors(sigma: np.ndarray) -> np.ndarray:
    """The tensors (nt, 3, 3) of `stress`, in the plane with σ_yz = σ_xz = 0."""
    tensors = np.zeros((len(sigma), 3, 3))
    for (i, j), column in zip(COLUMNS, sigma.T, strict=False):
        tensors[:, i, j] = tensors[:, j, i] = column
    return tensors


def von_mises(sigma: np.ndarray) -> np.ndarray:
    """Von Mises stress (nt,) in Pa from `stress`."""
    xx, yy, zz, *shears = sigma.T
    return np.sqrt(
        0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2)
        + 3 * sum(shear**2 for shear in shears)
    )


def cell_stress(
    mesh: Mesh,
    material: Material,
    u: np.ndarray,
    hats: np.ndarray,
    cells: slice | np.ndarray,
    curved: bool,
    heat: np.ndarray | None = None,
) -> np.ndarray:
    """Stress (n, n, q, t) in Pa at points with hats (q, c) of some cells of one material, none of which are `summed` or
    all, `curved`, for a displacement u (nv, d) in metres and a temperature (nv,) in K.

    n is `Mesh.strains`. Not collective.
    """
    n, moved = mesh.strains, np.take(u.T, mesh.triangles[cells].T, axis=1)
    if curved:
        mapped = mesh.map(cells, hats)
        gradient = np.einsum("rqkt,ckt->crqt", mapped.slopes, moved)
        if mapped.modes is not None:
            modes, by_nodes = modes_of(mesh, material, cells, heat), moved.transpose(2, 1, 0)
            alpha = modes.held - np.einsum(
                "tmk,tk->tm", modes.follows, by_nodes.reshape(len(by_nodes), -1)
            )
            alpha = alpha.reshape(len(alpha), -1, len(moved))
            gradient += np.einsum("rqmt,tmc->crqt", mapped.modes, alpha)
    else:
        inverse, _ = invert(tangents(mesh.points, mesh.corners[cells]))
        gradient = np.einsum(
            "acqt,art->crqt", mesh.cell.derivatives(hats)[:, None] @ moved, inverse
        )
    C = by_slopes(mesh, material).reshape(n * n, -1)
    sigma = (C @ gradient.reshape(C.shape[1], -1)).reshape(n, n, *gradient.shape[2:])
    if heat is not None:
        sigma -= np.multiply.outer(
            thermal(material, len(sigma))[0], cell_temperature(mesh, heat, hats, cells)
        )
    return sigma


def elastic(mesh: Mesh, material: Material, products: np.ndarray) -> np.ndarray:
    """Σ t C_rkcl P_kl (d, d, …) for products (n, n, …) of slopes, with the thickness t."""
    d, n = mesh.dimension, mesh.strains
    C = np.einsum("ijrk,ijcl->rckl", gradients(mesh), by_slopes(mesh, material)).reshape(d * d, -1)
    return material.thickness * (C @ products.reshape(n * n, -1)).reshape(d, d, *products.shape[2:])


class Modes(NamedTuple):
    """The m d incompatible modes of t cells with k nodes: α = `held` − `follows` u minimizes the energy.

    Attributes
    ----------
    follows : (t, m d, k d) K_αα⁻¹ K_αu
    beside : (t, m d, k d) K_αu
    held, push : (t, m d) K_αα⁻¹ f_α, in metres, and f_α of a temperature (N)
    """

    follows: np.ndarray
    beside: np.ndarray
    held: np.ndarray
    push: np.ndarray


def modes_of(
    mesh: Mesh,
    material: Material,
    cells: slice | np.ndarray,
    heat: np.ndarray | None = None,
) -> Modes:
    """The incompatible modes of some cells of one material at a temperature (nv,) in K. Not collective."""
    (points, weights), d = mesh.cell.quadrature, mesh.dimension
    mapped = mesh.map(cells, points)
    assert mapped.modes is not None
    shares = weights[:, None] * mapped.measures
    both = np.concatenate([mapped.modes, mapped.slopes], axis=2)
    products = np.einsum("aqmt,bqnt,qt->abmnt", mapped.modes, both, shares, optimize=True)
    K = elastic(mesh, material, products).transpose(4, 2, 0, 3, 1)  # (t, m, d, m + k, d)
    t, m = K.shape[:2]
    K, push = K.reshape(t, m * d, -1), np.zeros((t, m * d))
    if heat is not None:
        warm = material.thickness * shares * cell_temperature(mesh, heat, points, cells)
        beta = thermal(material, d)[0]
        push = np.einsum("rc,cqmt,qt->tmr", beta, mapped.modes, warm).reshape(t, m * d)
    own, beside = np.split(K, [m * d], axis=2)
    solved = np.linalg.solve(own, np.concatenate([beside, push[..., None]], axis=2))
    return Modes(solved[..., :-1], beside, solved[..., -1], push)


def by_slopes(mesh: Mesh, material: Material) -> np.ndarray:
    """C_ijcl (n, n, d, n) in Pa of the stress σ_ij = C_ijcl s_cl, with s as of `gradients`."""
    return np.einsum("ijmn,mncl->ijcl", material.tensor(mesh.strains), gradients(mesh))


def gradients(mesh: Mesh) -> np.ndarray:
    """M (n, n, d, n) of ∇u_ij = M_ijcl s_cl with s_cl = Σ u_c slope_l: the identity, but that around an axis u_r/r is
    the circumferential strain and u_y/r none."""
    n, d = mesh.strains, mesh.dimension
    M = np.eye(n * n).reshape(n, n, n, n)[:, :, :d]
    M[..., d:] = 0.0
    M[d:, d:, 0, d:] = 1.0
    return M


def cell_temperature(
    mesh: Mesh, heat: np.ndarray, hats: np.ndarray, cells: slice | np.ndarray
) -> np.ndarray:
    """Temperature (q, t) at points with hats (q, c) of some cells, from that of the nodes (nv,)."""
    return mesh.cell.shapes(hats) @ heat[mesh.triangles[cells]].T


def components(sigma: np.ndarray) -> np.ndarray:
    """The components (n, …) i ≤ j of symmetric tensors (d, d, …)."""
    return sigma[np.triu_indices(len(sigma))]


def compliance_of(material: Material, dimension: int) -> np.ndarray:
    """C⁻¹ (n, n) of σ : C⁻¹ : τ by the `components` of tensors of this dimension (1/Pa)."""
    i, j = np.triu_indices(dimension)
    return np.linalg.inv(material.tensor(dimension)[i, j][:, i, j])  # by strains ε_ii and 2 ε_ij


def blocks(number: int) -> list[slice]:
    """Slices of STRAIGHT_BLOCK numbers each that cover range(number)."""
    return [slice(start, start + STRAIGHT_BLOCK) for start in range(0, number, STRAIGHT_BLOCK)]
