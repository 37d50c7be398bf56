"""One body by scikit-fem, in our numbering of the dofs: what the package's own assembly is measured against."""

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc
from scipy.sparse.linalg import spsolve
from skfem import (
    Basis,
    ElementHex1,
    ElementHexS2,
    ElementQuad1,
    ElementQuadS2,
    ElementTetP1,
    ElementTetP2,
    ElementTriP1,
    ElementTriP2,
    ElementVector,
    FacetBasis,
    MeshHex,
    MeshQuad,
    MeshTet,
    MeshTri,
    asm,
)
from skfem.assembly.basis import AbstractBasis
from skfem.models.elasticity import linear_elasticity

from ddmpi.body.elasticity import assemble
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Material

KINDS = {
    (3, 2): (MeshTri, (ElementTriP1, ElementTriP2), slice(None)),
    (4, 2): (MeshQuad, (ElementQuad1, ElementQuadS2), slice(None)),
    (4, 3): (MeshTet, (ElementTetP1, ElementTetP2), slice(None)),
    (8, 3): (MeshHex, (ElementHex1, ElementHexS2), [0, 4, 3, 1, 7, 5, 2, 6]),
}
"""Meshes, elements by order, and our corners in skfem's order, by corners and dimension."""


def basis_of(
    mesh: Mesh, intorder: int = 4, on: np.ndarray | None = None
) -> tuple[AbstractBasis, np.ndarray]:
    """skfem's basis, and the number that each of its dofs has with us (x of node i is d i).

    It is that of the cells, or of the facets `on` with corners (·, d).
    """
    d, size = mesh.dimension, mesh.corners.max() + 1  # the corners are the first nodes
    kind, elements, order = KINDS[mesh.corners.shape[1], d]
    other = kind(mesh.points[:size].T.copy(), mesh.corners[:, order].T.copy())
    element = ElementVector(elements[mesh.order - 1]())
    if on is None:
        basis = Basis(other, element, intorder=intorder)
    else:
        own = {frozenset(facet) for facet in on[:, : len(other.facets)].tolist()}
        facets = [k for k, facet in enumerate(other.facets.T.tolist()) if frozenset(facet) in own]
        basis = FacetBasis(other, element, facets=np.array(facets), intorder=intorder)
    nodes = {"nodal_dofs": np.arange(size)}
    if mesh.order == 2:
        edges = mesh.triangles[:, mesh.cell.edges].reshape(-1, 3).tolist()
        middles = {frozenset((start, end)): middle for start, end, middle in edges}
        kind, ends = ("facet_dofs", other.facets) if d == 2 else ("edge_dofs", other.edges)
        nodes[kind] = np.array([middles[frozenset(pair)] for pair in ends.T.tolist()])
    numbers = np.empty(basis.N, int)
    for kind, members in nodes.items():
        for component, dofs in enumerate(getattr(basis, kind)):
            numbers[dofs] = d * members + component
    assert np.array_equal(np.sort(numbers), np.arange(mesh.points.size))
    return basis, numbers


def stiffness_of(mesh: Mesh, material: Material) -> sparse.csr_matrix:
    """K of the whole body, no dof clamped, by the full rule of its elements."""
    basis, numbers = basis_of(mesh, 2 + mesh.order)
    K = asm(linear_elasticity(*material.lame), basis).tocoo()
    return sparse.csr_matrix((K.data, (numbers[K.row], numbers[K.col])), K.shape)


def default_stiffness_of(mesh: Mesh, material: Material) -> sparse.csr_matrix:
    """K of elements as they are where a scene does not say how to integrate."""
    modes = mesh.order == 1 and not mesh.cell.simplex
    return (stiffness_with_modes if modes else stiffness_of)(mesh, material)


def stiffness_with_modes(mesh: Mesh, material: Material) -> sparse.csr_matrix:
    """K of linear quadrilaterals or hexahedra with incompatible modes 1 − ξ² along each edge, condensed in each cell, by
    Taylor, Beresford and Wilson (Int. J. Numer. Meth. Engrg. 10, 1976)."""
    (lam, mu), cells, d = material.lame, mesh.triangles, mesh.dimension
    corners = 2.0 * np.array(mesh.cell.shape.corners) - 1.0
    places = np.stack(np.meshgrid(*[[-1.0, 1.0]] * d), axis=-1).reshape(-1, d) / np.sqrt(3.0)

    def slopes(at: np.ndarray) -> np.ndarray:
        """∂N_i/∂ξ_a (c, d)."""
        factors = (1.0 + corners * at) / 2.0
        return np.stack(
            [
                corners[:, a] / 2.0 * np.prod(np.delete(factors, a, axis=1), axis=1)
                for a in range(d)
            ],
            axis=1,
        )

    x = mesh.points[cells]
    middle = np.einsum("tid,ia->tda", x, slopes(np.zeros(d)))
    width = len(corners) + d
    local = np.zeros((len(cells), width, d, width, d))
    for at in places:
        jacobian = np.einsum("tid,ia->tda", x, slopes(at))
        size = np.linalg.det(jacobian)
        modes = (np.linalg.det(middle) / size)[:, None, None] * np.linalg.solve(
            middle.transpose(0, 2, 1), np.broadcast_to(np.diag(-2.0 * at), middle.shape)
        )
        nodal = np.einsum("ia,tad->tid", slopes(at), np.linalg.inv(jacobian))
        G = np.concatenate([nodal, modes.transpose(0, 2, 1)], axis=1)
        local += lam * np.einsum("t,tia,tjb->tiajb", size, G, G)
        local += mu * np.einsum("t,tib,tja->tiajb", size, G, G)
        local += mu * np.einsum("t,tic,tjc,ab->tiajb", size, G, G, np.eye(d))
    K, n = local.reshape(len(cells), width * d, -1), len(corners) * d
    K = K[:, :n, :n] - K[:, :n, n:] @ np.linalg.solve(K[:, n:, n:], K[:, n:, :n])
    dofs = (d * cells[:, :, None] + np.arange(d)).reshape(len(cells), n)
    row, column = np.broadcast_arrays(dofs[:, :, None], dofs[:, None, :])
    return sparse.csr_matrix((K.ravel(), (row.ravel(), column.ravel())), (mesh.points.size,) * 2)


def load_of(mesh: Mesh, form, intorder: int = 4, on: np.ndarray | None = None) -> np.ndarray:
    """The load vector (d nv,) of a skfem LinearForm over the body, or over the facets `on` with corners (·, d)."""
    basis, numbers = basis_of(mesh, intorder, on)
    f = np.empty(basis.N)
    f[numbers] = asm(form, basis)
    return f


def solve(mesh: Mesh, spec: BodySpec) -> np.ndarray:
    """The displacement (nv, d) of one body that clamps hold, by SciPy's sparse solver (m)."""
    problem = assemble(mesh, spec)
    u = problem.b.duplicate()
    u.array[:] = spsolve(to_scipy(problem.A).tocsc(), problem.b.array_r)
    return problem.expand(u)


def to_scipy(A: PETSc.Mat) -> sparse.csr_matrix:
    indptr, indices, values = A.getValuesCSR()
    return sparse.csr_matrix((values, indices, indptr), A.size)
