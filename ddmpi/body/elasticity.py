"""Plane linear elasticity of one body: stiffness A and load b, with clamped dofs eliminated.

Nodes carry two dofs each, interleaved (x of node i is dof 2i). A node with both components clamped
is taken out of the system. A node with one clamped component stays; that component is decoupled and keeps
its own diagonal entry, so that the block size of A is two everywhere, as GAMG needs it.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from ddmpi.body.loads import clamp_nodes, lost_loads, nodal_loads, refuse_underflow
from ddmpi.body.rigid_motions import body_motions, near_null_space
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.body.stress import material_of
from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec

PRESCRIBED_SHARE = 1e-3
"""Prescribed displacements count as a load of this fraction of the forces K u that they take by themselves."""


@dataclass(frozen=True)
class Elasticity:
    """The discrete problem of one body, ``A u = b`` on its dofs that are not eliminated.

    Attributes
    ----------
    A : PETSc AIJ matrix (2k, 2k), symmetric, block size 2 (N/m per metre of depth); positive definite if the body
        is held, else its null space are the motions
    b : PETSc vector (2k,) (N per metre of depth)
    n : number of free dofs: 2k less the clamped components of nodes that stay
    nodes : (k,) the mesh nodes that A acts on
    free : (nv, 2) bool, dofs that are not prescribed
    prescribed : (nv, 2) displacement (m) of the prescribed dofs, zero elsewhere
    motions : (nv, 2, j) the rigid motions that clamps leave free, see `body_motions`; zero at prescribed dofs
    load : sum of the absolute nodal loads (N), tractions and volume forces; where displacements are
        prescribed, at least PRESCRIBED_SHARE of the forces that these take
    resultant : (2,) sum of the loads (N), those on clamped nodes too
    warnings : loads that come to nothing, or are given twice
    """

    A: PETSc.Mat
    b: PETSc.Vec
    n: int
    nodes: np.ndarray
    free: np.ndarray
    prescribed: np.ndarray
    motions: np.ndarray
    load: float
    resultant: np.ndarray
    warnings: list[str]

    @property
    def held(self) -> bool:
        """Whether clamps leave no rigid motion free."""
        return self.motions.shape[2] == 0

    def expand(self, u: PETSc.Vec) -> np.ndarray:
        """The displacement (nv, 2) of all nodes from the solution `u` of the reduced system (m)."""
        full = self.prescribed.copy()
        full[self.nodes] += u.array_r.reshape(-1, 2) * self.free[self.nodes]
        return full


def assemble(mesh: Mesh, body: BodySpec, comm=PETSc.COMM_SELF) -> Elasticity:
    """Assemble stiffness and load of `body` and eliminate its clamped dofs symmetrically.

    Collective on `comm`. Raises InputError if the clamps contradict each other, or leave a part of the body loose
    that is not connected to the rest.
    """
    K = sum_stiffness(mesh, material_of(mesh, body))
    f = nodal_loads(mesh, body)
    free, prescribed = clamp_nodes(mesh, body)
    motions = body_motions(mesh, K, free, body.name)
    nodes = np.flatnonzero(free.any(axis=1))
    loose = free[nodes]
    total, resultant = float(np.abs(f).sum()), f.sum(axis=0)
    if prescribed.any():
        forces = K.mult(prescribed)
        f -= forces
        total = max(total, PRESCRIBED_SHARE * float(np.abs(forces).sum()))
    refuse_underflow(mesh, body, f, prescribed, float(K.diagonal.max()))
    b = (f[nodes] * loose).ravel()
    indptr, indices, data = K.to_csr(free)
    if not (np.isfinite(data).all() and np.isfinite(b).all() and K.diagonal[nodes][:, [0, 1], [0, 1]].min() > 0.0):
        raise InputError(f"body.{body.name}: material, loads and lengths give numbers out of the range of "
                         "double precision; choose other units")

    matrix = PETSc.Mat().createAIJWithArrays(
        (len(b), len(b)), (indptr.astype(PETSc.IntType), indices.astype(PETSc.IntType, copy=False), data), bsize=2,
        comm=comm)
    matrix.setBlockSize(2)  # createAIJWithArrays ignores its bsize
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC if motions.size else PETSc.Mat.Option.SPD, True)
    matrix.setNearNullSpace(near_null_space(mesh.points[nodes], loose, comm))
    load = PETSc.Vec().createWithArray(b, bsize=2, comm=comm)
    load.setBlockSize(2)
    return Elasticity(matrix, load, int(loose.sum()), nodes, free, prescribed, motions, total, resultant,
                      lost_loads(mesh, body, free))
