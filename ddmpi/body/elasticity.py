"""Plane linear elasticity of one body: stiffness A, load b, clamped dofs eliminated; stress on request.

Nodes carry two dofs each, interleaved (x of node i is dof 2i). A node with both components clamped
is taken out of the system. A node with one clamped component stays, that component decoupled with
its own diagonal entry, so that the block size of A is two everywhere (GAMG needs that).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from ddmpi.body.rigid import _refuse_rigid_motion, _rigid_motions
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.errors import InputError
from ddmpi.mesh.elements import ELEMENTS
from ddmpi.mesh.mesh import Mesh, boundary_group, signed_double_areas, turn_outward
from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.values import evaluate


@dataclass(frozen=True)
class Elasticity:
    """The discrete problem of one body, ``A u = b`` on its dofs that are not eliminated.

    Attributes
    ----------
    A : PETSc AIJ matrix (2k, 2k), symmetric positive definite, block size 2 (N/m per metre of depth)
    b : PETSc vector (2k,) (N per metre of depth)
    n : number of free dofs; differs from 2k by the components that are clamped alone
    nodes : (k,) the mesh nodes that A acts on
    free : (nv, 2) bool, dofs that are not prescribed
    prescribed : (nv, 2) displacement (m) of the prescribed dofs, zero elsewhere
    load : sum of the absolute nodal loads (N), tractions and volume forces; where a displacement is
        prescribed, at least a thousandth of the forces that it would take
    """

    A: PETSc.Mat
    b: PETSc.Vec
    n: int
    nodes: np.ndarray
    free: np.ndarray
    prescribed: np.ndarray
    load: float = 0.0

    def expand(self, u: PETSc.Vec) -> np.ndarray:
        """The displacement (nv, 2) of all nodes from the solution `u` of the reduced system (m)."""
        full = self.prescribed.copy()
        full[self.nodes] += u.array_r.reshape(-1, 2) * self.free[self.nodes]
        return full


def assemble(mesh: Mesh, body: BodySpec, comm=PETSc.COMM_SELF) -> Elasticity:
    """Assemble stiffness and load of `body` and eliminate its clamped dofs symmetrically.

    Collective on `comm`. Raises InputError if the clamps leave a rigid-body motion free.
    """
    K = sum_stiffness(mesh, body.material)
    f = _load(mesh, body)
    free, prescribed = _clamps(mesh, body)
    _refuse_rigid_motion(mesh, K, free, body.name)
    nodes = np.flatnonzero(free.any(axis=1))
    loose = free[nodes]
    total = float(np.abs(f).sum())
    if prescribed.any():
        forces = K.mult(prescribed)
        f -= forces
        total = max(total, 1e-3 * float(np.abs(forces).sum()))
    b = (f[nodes] * loose).ravel()
    indptr, indices, data = K.to_csr(free)
    if not (np.isfinite(data).all() and np.isfinite(b).all() and K.diagonal[nodes][:, [0, 1], [0, 1]].min() > 0.0):
        raise InputError(f"body.{body.name}: material, loads and lengths give numbers out of the range of "
                         "double precision; choose other units")

    matrix = PETSc.Mat().createAIJWithArrays(
        (len(b), len(b)), (indptr.astype(PETSc.IntType), indices.astype(PETSc.IntType, copy=False), data), bsize=2,
        comm=comm)
    matrix.setBlockSize(2)  # the creation with arrays passes it over
    matrix.setOption(PETSc.Mat.Option.SPD, True)
    matrix.setNearNullSpace(_rigid_motions(mesh.points[nodes], loose, comm))
    load = PETSc.Vec().createWithArray(b, bsize=2, comm=comm)
    load.setBlockSize(2)
    return Elasticity(matrix, load, int(loose.sum()), nodes, free, prescribed, total)


def _load(mesh: Mesh, body: BodySpec) -> np.ndarray:
    """Nodal loads (nv, 2) in newtons of tractions and volume force; exact, as both are affine."""
    element = ELEMENTS[mesh.triangles.shape[1]]
    f = np.zeros_like(mesh.points)
    for traction in body.traction:
        key = f"body.{body.name}.traction"
        sides = turn_outward(mesh, boundary_group(mesh, traction.on, key), key)
        x, y = mesh.points[sides[:, :2]].transpose(2, 0, 1)
        length = np.hypot(*(np.diff(c, axis=1)[:, 0] for c in (x, y)))
        np.add.at(f, sides, np.einsum("s,la,csa->slc", length, element.side_mass, evaluate(traction.value, x, y)))
    if body.volume_force != (0.0, 0.0):
        corners = mesh.triangles[:, :3]
        x, y = mesh.points[corners].transpose(2, 0, 1)
        area = signed_double_areas(mesh.points, corners) / 2
        for component, force in enumerate(evaluate(body.volume_force, x, y)):
            parts = (area[:, None] * force) @ element.mass.T
            f[:, component] += np.bincount(mesh.triangles.ravel(), parts.ravel(), len(f))
    return f


def _clamps(mesh: Mesh, body: BodySpec) -> tuple[np.ndarray, np.ndarray]:
    free = np.ones((len(mesh.points), 2), dtype=bool)
    prescribed = np.zeros((len(mesh.points), 2))
    for clamp in body.clamps:
        nodes = np.unique(boundary_group(mesh, clamp.on, f"body.{body.name}.clamp"))
        x, y = mesh.points[nodes].T
        for component, value in enumerate((clamp.x, clamp.y)):
            if value is not None:
                free[nodes, component] = False
                prescribed[nodes, component] = evaluate(value, x, y)
    return free, prescribed
