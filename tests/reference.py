"""One body by scikit-fem, in our numbering of the dofs: what the package's own assembly is measured against."""

import numpy as np
import scipy.sparse as sparse
from scipy.sparse.linalg import spsolve
from skfem import Basis, ElementTriP1, ElementTriP2, ElementVector, MeshTri, asm
from skfem.models.elasticity import linear_elasticity

from ddmpi.body.elasticity import assemble
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Material


def basis_of(mesh: Mesh, intorder: int = 4) -> tuple[Basis, np.ndarray]:
    """skfem's basis, and the number that each of its dofs has with us (x of node i is 2i)."""
    t = mesh.triangles
    corners = t[:, :3].max() + 1  # the first nodes
    element = ElementTriP1() if t.shape[1] == 3 else ElementTriP2()
    basis = Basis(MeshTri(mesh.points[:corners].T.copy(), t[:, :3].T.copy()), ElementVector(element), intorder=intorder)
    nodes = {"nodal_dofs": np.arange(corners)}
    if t.shape[1] == 6:
        middles = {frozenset(side): middle for row in t.tolist()
                   for side, middle in zip((row[0:2], row[1:3], (row[2], row[0])), row[3:], strict=True)}
        nodes["facet_dofs"] = np.array([middles[frozenset(ends)] for ends in basis.mesh.facets.T.tolist()])
    numbers = np.empty(basis.N, int)
    for kind, members in nodes.items():
        for component, dofs in enumerate(getattr(basis, kind)):
            numbers[dofs] = 2 * members + component
    assert np.array_equal(np.sort(numbers), np.arange(2 * len(mesh.points)))
    return basis, numbers


def stiffness_of(mesh: Mesh, material: Material) -> sparse.csr_matrix:
    """K of the whole body, no dof clamped."""
    basis, numbers = basis_of(mesh)
    K = asm(linear_elasticity(*material.lame), basis).tocoo()
    return sparse.csr_matrix((K.data, (numbers[K.row], numbers[K.col])), K.shape)


def load_of(mesh: Mesh, form, intorder: int = 4) -> np.ndarray:
    """The load vector (2 nv,) of a skfem LinearForm over the body."""
    basis, numbers = basis_of(mesh, intorder)
    f = np.empty(basis.N)
    f[numbers] = asm(form, basis)
    return f


def solve(mesh: Mesh, spec: BodySpec) -> np.ndarray:
    """The displacement (nv, 2) of one body that clamps hold, by SciPy's sparse solver (m)."""
    problem = assemble(mesh, spec)
    indptr, indices, data = problem.A.getValuesCSR()
    u = problem.b.duplicate()
    u.array[:] = spsolve(sparse.csr_matrix((data, indices, indptr)).tocsc(), problem.b.array_r)
    return problem.expand(u)
