"""Plane linear elasticity of one body: stiffness A, load b, clamped dofs eliminated; stress on request.

Nodes carry two dofs each, interleaved (x of node i is dof 2i). A node with both components clamped
is taken out of the system. A node with one clamped component stays, that component decoupled with
its own diagonal entry, so that the block size of A is two everywhere (GAMG needs that).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from petsc4py import PETSc

from ddmpi.elements import ELEMENTS
from ddmpi.errors import InputError
from ddmpi.mesh import Mesh, boundary_group, signed_double_areas, turn_outward
from ddmpi.scene import BodySpec, Material, evaluate
from ddmpi.stiffness import Stiffness, sum_stiffness


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


def stress(mesh: Mesh, material: Material, u: np.ndarray) -> np.ndarray:
    """Stress of each triangle: its mean, which is that at the centroid.

    Parameters
    ----------
    u : (nv, 2) displacement (m)

    Returns
    -------
    (nt, 4) array of σ_xx, σ_yy, σ_zz, σ_xy in Pa; σ_zz is zero in plane stress. Not collective.
    """
    p, t = mesh.points, mesh.triangles
    e1, e2 = p[t[:, 1]] - p[t[:, 0]], p[t[:, 2]] - p[t[:, 0]]
    mean = ELEMENTS[t.shape[1]].gradients.mean(axis=0)  # of the gradients of the shape functions
    v = [sum(c * u[t[:, i]] for i, c in enumerate(mean[:, a]) if c) for a in range(3)]
    d1, d2 = v[1] - v[0], v[2] - v[0]  # ∇u = Σ_a v_a ∇λ_a
    area2 = (e1[:, 0] * e2[:, 1] - e1[:, 1] * e2[:, 0])[:, None]
    du_dx = (d1 * e2[:, 1:] - d2 * e1[:, 1:]) / area2
    du_dy = (d2 * e1[:, :1] - d1 * e2[:, :1]) / area2
    first, shear = material.lame
    exx, eyy, gxy = du_dx[:, 0], du_dy[:, 1], du_dy[:, 0] + du_dx[:, 1]
    trace = first * (exx + eyy)
    szz = trace if material.plane == "strain" else np.zeros_like(trace)
    return np.column_stack([trace + 2 * shear * exx, trace + 2 * shear * eyy, szz, shear * gxy])


def von_mises(sigma: np.ndarray) -> np.ndarray:
    """Von Mises stress (nt,) in Pa from `stress`."""
    xx, yy, zz, xy = sigma.T
    return np.sqrt(0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3 * xy**2)


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


def _refuse_rigid_motion(mesh: Mesh, K: Stiffness, free: np.ndarray, name: str) -> None:
    """The clamped components must determine both translations and the rotation of each connected piece."""
    pieces, piece = K.connected()
    for k in range(pieces):
        members = piece == k
        centre = mesh.points[members].mean(axis=0)
        members &= ~free.all(axis=1)
        x, y = ((mesh.points[members] - centre) / mesh.extent).T
        modes = np.stack([np.stack([np.ones_like(x), np.zeros_like(x), -y], 1),
                          np.stack([np.zeros_like(x), np.ones_like(x), x], 1)], 1)  # (k, 2, 3)
        held = modes[~free[members]]
        values, vectors = np.linalg.eigh(held.T @ held)
        if values[0] <= 1e-16 * max(values[-1], 1.0) * max(len(held), 1):
            tx, ty, rotation = np.abs(vectors[:, 0])
            loose = "rotate" if rotation > 0.5 else "move along x" if tx > ty else "move along y"
            part = "the body" if pieces == 1 else f"a piece of the body (there are {pieces} that hang not together)"
            raise InputError(f"body.{name}.clamp: {part} is not held: it can still {loose} as a rigid body; "
                             "clamp a boundary group, or more components of one")


def _rigid_motions(points: np.ndarray, free: np.ndarray, comm) -> PETSc.NullSpace:
    """Translations and rotation, orthonormal, for algebraic multigrid."""
    x, y = (points - points.mean(axis=0)).T
    zero, one = np.zeros_like(x), np.ones_like(x)
    modes = np.stack([np.column_stack([one, zero]), np.column_stack([zero, one]), np.column_stack([-y, x])])
    Q, _ = np.linalg.qr((modes * free).reshape(3, -1).T)
    vectors = [PETSc.Vec().createWithArray(np.ascontiguousarray(q), bsize=2, comm=comm) for q in Q.T]
    return PETSc.NullSpace().create(vectors=vectors, comm=comm)
