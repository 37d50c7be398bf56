"""Bodies of one material, their meshes and drawings, for tests of meshes."""

from __future__ import annotations

from collections.abc import Callable, Collection
from pathlib import Path

import gmsh
import numpy as np

from ddmpi.body.stress import Composite, cell_stress, compliance_of, portions
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.elements import facet_measures
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import gmsh_session
from ddmpi.mesh.refine import Sizes
from ddmpi.scene.bodies import BodySpec, Material, MeshSpec

UNIT = Material(young=1.0, poisson=0.3)

OF_BODIES = ("clamp", "traction", "material")
"""Keys of bodies; others are of their meshes."""


def body_of(order: int = 1, **keys) -> BodySpec:
    """A body called "body" by its keys and those of its mesh."""
    own = {"material": UNIT} | {key: keys.pop(key) for key in OF_BODIES if key in keys}
    return BodySpec(name="body", mesh=MeshSpec(order=order, **keys), **own)


def mesh_of(
    order: int = 1, contacts: Collection[str] = (), sizes: Sizes | None = None, **keys
) -> Mesh:
    """The mesh of such a body, of a drawing with sizes as a run has them."""
    dimension = len(keys.get("divisions", "xyz"))
    return build_mesh(body_of(order, **keys).settled(order, dimension), Path("."), contacts, sizes)


def drawn(path: Path, size: float = 0.5, **keys) -> Mesh:
    """The mesh of a drawing."""
    return mesh_of(geometry=str(path), size=size, **keys)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def cad(path: Path, draw: Callable) -> Path:
    """A STEP or BREP file of what a function draws with gmsh's CAD kernel."""
    with gmsh_session():
        draw(gmsh.model.occ)
        gmsh.model.occ.synchronize()
        gmsh.write(str(path))
    return path


def lengths(mesh: Mesh, group: str) -> np.ndarray:
    """Distances between neighbouring corners of the facets of a group."""
    ends = mesh.points[mesh.groups[group][:, : mesh.dimension]]
    return np.linalg.norm(ends - np.roll(ends, 1, axis=1), axis=2)[:, mesh.dimension == 2 :].ravel()


def area(mesh: Mesh, group: str) -> float:
    """The length or area of a group."""
    return float(facet_measures(mesh.points[mesh.facets(group).nodes]).sum())


def longest(mesh: Mesh) -> float:
    """The longest edge."""
    ends = mesh.points[mesh.triangles[:, mesh.cell.edges[:, :2]]]
    return float(np.linalg.norm(ends[:, :, 1] - ends[:, :, 0], axis=2).max())


def stress_at(
    mesh: Mesh,
    material: Material | Composite,
    u: np.ndarray,
    hats: np.ndarray,
    heat: np.ndarray | None = None,
) -> np.ndarray:
    """Stress (n, n, q, nt) in Pa at points with hats (q, c) of all cells, for a displacement u (nv, d) in metres
    and a temperature (nv,) in K.

    n is `Mesh.strains`.
    """
    sigma = np.empty((mesh.strains, mesh.strains, len(hats), len(mesh.triangles)))
    for cells, uniform, curved in portions(mesh, material):
        sigma[..., cells] = cell_stress(mesh, uniform, u, hats, cells, curved, heat)
    return sigma


def energy_density(material: Material, sigma: np.ndarray) -> np.ndarray:
    """σ : C⁻¹ : σ (…) in J/m³ of stresses (n, …) in Pa, which are `components`."""
    compliance = compliance_of(material, int(np.sqrt(2 * len(sigma))))
    return np.einsum("c...,ce,e...->...", sigma, compliance, sigma)
