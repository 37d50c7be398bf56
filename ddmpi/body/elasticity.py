"""Linear elasticity of one body: stiffness A and load b, with clamped dofs eliminated.

Nodes carry d dofs each, interleaved (x of node i is dof d i). A node with all components clamped is taken out of the
system. A node that clamps let move in some directions stays, with the blocks P K P of the projection P onto these; the
directions across them are decoupled and keep diagonal entries, so that the block size of A is d everywhere, as GAMG
needs it, and all vectors are along the axes, whatever the angle of a clamp.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc

from ddmpi.body.loads import (
    ALONG,
    Supports,
    lost_loads,
    nodal_loads,
    refuse_underflow,
    springs,
    supports,
    temperature,
    thermal_loads,
)
from ddmpi.body.rigid_motions import body_motions, near_null_space
from ddmpi.body.stiffness import forces_at, sum_stiffness
from ddmpi.body.stress import material_of
from ddmpi.errors import InputError
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec

PRESCRIBED_SHARE = 1e-3
"""Prescribed displacements count as a load of this fraction of the forces K u that they take by themselves, and
temperatures of the forces that would undo what they strain."""


@dataclass(frozen=True)
class LoadCase:
    """The loads and prescribed displacements of a body that follow one history, at its factor 1.

    Attributes
    ----------
    f : (nv, d) nodal loads of tractions and volume force (N)
    warm : (nv,) temperature over the state free of stress (K)
    heat : (nv, d) nodal loads by which it strains the body (N)
    stored : root of twice the elastic energy where no strain yields to it (√J)
    prescribed : (nv, d) displacements of clamped dofs (m), zero elsewhere
    taken : (nv, d) the forces K u of the prescribed displacements alone (N)
    b : (d k,) what stands on the right of the system (N)
    """

    f: np.ndarray
    warm: np.ndarray
    heat: np.ndarray
    stored: float
    prescribed: np.ndarray
    taken: np.ndarray
    b: np.ndarray

    @property
    def size(self) -> float:
        """Sum of the absolute nodal loads (N), as for `Elasticity.load`."""
        return float(max(np.abs(self.f).sum(), *(PRESCRIBED_SHARE * np.abs(each).sum() for each in
                                                 (self.taken, self.heat))))

    @property
    def heated(self) -> np.ndarray | None:
        """`warm`, or None if the body is as warm as where it is free of stress."""
        return self.warm if self.warm.any() else None


@dataclass(frozen=True)
class Elasticity:
    """The discrete problem of one body, ``A u = b`` on its dofs that are not eliminated.

    Its loads and prescribed displacements are those at present; `under` gives them at another time.

    Attributes
    ----------
    A : PETSc AIJ matrix (d k, d k), symmetric, block size d (N/m; in the plane per metre of depth); positive definite
        if the body is held, else its null space are the motions
    b : PETSc vector (d k,) (N; in the plane per metre of depth)
    n : number of free dofs: d k less the clamped directions of nodes that stay
    nodes : (k,) the mesh nodes that A acts on, in the order of its rows
    supports : what clamps hold
    acting : the load case at present
    motions : (nv, d, j) the rigid motions that clamps leave free, see `body_motions`; zero in prescribed directions
    load : sum of the absolute nodal loads (N), tractions and volume forces; where displacements are prescribed or the
        body is heated, at least PRESCRIBED_SHARE of the forces that these take
    warnings : loads that come to nothing, or are given twice
    cases : what the loads and prescribed displacements consist of, by history
    softest : stiffness of its softest foundation, k times the area (N/m); infinite without
    """

    A: PETSc.Mat
    b: PETSc.Vec
    n: int
    nodes: np.ndarray
    supports: Supports
    acting: LoadCase
    motions: np.ndarray
    load: float
    warnings: list[str]
    cases: Mapping[str | None, LoadCase]
    softest: float = np.inf

    @property
    def free(self) -> np.ndarray:
        """(nv, d) bool, components that can move."""
        return self.supports.free.diagonal(axis1=1, axis2=2) > ALONG

    def under(self, factors: Mapping[str | None, float]) -> Elasticity:
        """The same body under its load cases times `factors`. `load` stays what forces are compared with."""
        case = _sum_cases([(factors[name], case) for name, case in self.cases.items()])
        b = self.b.duplicate()
        b.array[:] = case.b
        return replace(self, b=b, acting=case)

    def largest(self, factors: Sequence[Mapping[str | None, float]]) -> Elasticity:
        """The same body with the largest `load` of its cases times any of `factors`."""
        sums = (_sum_cases([(each[name], case) for name, case in self.cases.items()]) for each in factors)
        return replace(self, load=max(case.size for case in sums))

    @property
    def held(self) -> bool:
        """Whether clamps leave no rigid motion free."""
        return self.motions.shape[2] == 0

    def expand(self, u: PETSc.Vec) -> np.ndarray:
        """The displacement (nv, d) of all nodes from the solution `u` of the reduced system (m)."""
        full = self.acting.prescribed.copy()
        full[self.nodes] += apply(self.supports.free[self.nodes], u.array_r.reshape(-1, full.shape[1]))
        return full


def assemble(mesh: Mesh, body: BodySpec) -> Elasticity:
    """Assemble stiffness and load of `body` and eliminate its clamped dofs symmetrically.

    Not collective. Raises InputError if the clamps contradict each other, or leave a part of the body loose
    that is not connected to the rest.
    """
    material = material_of(mesh, body)
    K = sum_stiffness(mesh, material)
    held, found = supports(mesh, body), list(springs(mesh, body))
    rows = sparse.vstack([Q for *_, Q in found], format="csr") if found else None
    motions = body_motions(mesh, K, held.free, body.name, rows)
    sprung = sparse.vstack([root * Q for _, root, Q in found], format="csr") if found else None
    nodes = np.flatnonzero(held.free.any(axis=(1, 2)))
    loose = held.free[nodes]
    cases = {}
    for history, moved in held.moved.items():
        f, warm = nodal_loads(mesh, body, history), temperature(mesh, body, history)
        heat, energy = thermal_loads(mesh, material, warm) if warm.any() else (np.zeros_like(f), 0.0)
        taken = K.mult(moved)
        if sprung is not None:
            taken += (sprung.T @ (sprung @ moved.ravel())).reshape(moved.shape)
        right = f + heat - taken
        refuse_underflow(mesh, body, right, moved, float(K.diagonal.max()))
        cases[history] = LoadCase(f, warm, heat, energy**0.5, moved, taken, apply(loose, right[nodes]).ravel())
    case = _sum_cases([(1.0, each) for each in cases.values()])
    whole, d = K.to_csr(held.free, nodes, sprung), mesh.dimension
    if not (np.isfinite(whole.data).all() and np.isfinite(case.b).all()
            and K.diagonal[nodes].diagonal(axis1=1, axis2=2).min(initial=np.inf) > 0.0):
        raise InputError(f"body.{body.name}: material, loads and lengths give numbers out of the range of "
                         "double precision; choose other units")

    matrix = PETSc.Mat().createAIJWithArrays(
        whole.shape, (whole.indptr.astype(PETSc.IntType, copy=False), whole.indices.astype(PETSc.IntType, copy=False),
                      whole.data), bsize=d, comm=PETSc.COMM_SELF)
    matrix.setBlockSize(d)  # createAIJWithArrays ignores its bsize
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC if motions.size else PETSc.Mat.Option.SPD, True)
    matrix.setNearNullSpace(near_null_space(mesh.points[nodes], loose))
    load = PETSc.Vec().createWithArray(case.b, bsize=d, comm=PETSc.COMM_SELF)
    load.setBlockSize(d)
    return Elasticity(matrix, load, round(np.einsum("kii->", loose)), nodes, held, case, motions, case.size,
                      lost_loads(mesh, body, held.free), cases, min((root**2 for _, root, _ in found), default=np.inf))


def clamp_forces(mesh: Mesh, body: BodySpec, elasticity: Elasticity, u: np.ndarray,
                 pull: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """What each clamp and foundation does to the body: its group, and nodal forces (nv, d) in newtons. Not collective.

    The force of a node is the sum of those along the directions in which its clamps hold it. A direction that clamps
    hold together is the last one's. `u` (nv, d) is the displacement under the present loads (m), `pull` (nv, d) are the
    contact forces on the body (N).
    """
    held = np.flatnonzero((elasticity.supports.clamps >= 0).any(axis=1))
    forces, given = np.zeros_like(u), elasticity.acting.f + elasticity.acting.heat + pull
    for on, root, Q in springs(mesh, body):
        pressed = -root**2 * (Q.T @ (Q @ u.ravel())).reshape(u.shape)
        given = given + pressed
        yield on, pressed
    if len(held):
        forces[held] = forces_at(mesh, material_of(mesh, body), u, held) - given[held]
    forces[mesh.on_axis, 0] = 0.0  # what is left of integrals
    free, parts = np.tile(np.eye(mesh.dimension), (len(u), 1, 1)), []
    for which, nodes, direction in reversed(elasticity.supports.held):
        direction = np.where(mesh.on_axis[nodes, None] & (np.arange(mesh.dimension) == 0), 0.0, direction)
        rest = apply(free[nodes], direction)
        squares = np.where((rest**2).sum(axis=1) > ALONG**2, (rest**2).sum(axis=1), np.inf)
        free[nodes] -= rest[:, :, None] * rest[:, None] / squares[:, None, None]
        parts.append((body.clamps[which].on, nodes, direction, rest / squares[:, None]))
    for on, nodes, direction, rest in reversed(parts):  # `rest` is at right angles to what comes after
        share = np.zeros_like(u)
        share[nodes] = (forces[nodes] * rest).sum(axis=1)[:, None] * direction
        forces -= share
        yield on, share


def apply(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """The products (k, d) of matrices (k, d, d) with vectors (k, d)."""
    return np.einsum("kij,kj->ki", matrices, vectors)


def _sum_cases(parts: Sequence[tuple[float, LoadCase]]) -> LoadCase:
    """The sum of load cases, each times a factor."""
    return LoadCase(*(np.sum([factor * getattr(case, each.name) for factor, case in parts], axis=0)
                      for each in fields(LoadCase)))
