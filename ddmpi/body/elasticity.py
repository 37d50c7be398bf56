"""Linear elasticity of one body: stiffness A and load b, with clamped dofs eliminated.

Nodes carry d dofs each, interleaved (x of node i is dof d i). Nodes with all components clamped are eliminated. A node
with some free directions stays, with the blocks P K P of the projection P onto these; the clamped directions are
decoupled and keep diagonal entries, so that the block size of A is d everywhere, as GAMG needs it, and all vectors are
along the axes, whatever the angle of a clamp.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from functools import partial

import numpy as np
import scipy.sparse as sparse
from petsc4py import PETSc

from ddmpi.body.loads import (
    Supports,
    loads_by_group,
    lost_loads,
    refuse_underflow,
    resultants,
    springs,
    supports,
    temperature,
    thermal_loads,
)
from ddmpi.body.rigid_motions import body_motions, near_null_space
from ddmpi.body.singular import causes
from ddmpi.body.stiffness import sum_stiffness
from ddmpi.body.stress import material_of
from ddmpi.errors import InputError
from ddmpi.kept.kept import Kept
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec
from ddmpi.scene.values import histories
from ddmpi.system.numbers import SAME, is_touched

PRESCRIBED_SHARE = 1e-3
"""Prescribed displacements count as a load of this fraction of the forces K u that they alone need, and temperatures of
the forces that would undo their strains."""


@dataclass(frozen=True)
class LoadCase:
    """The loads and prescribed displacements of a body with the same history, at its factor 1.

    Attributes
    ----------
    f : (nv, d) nodal loads of tractions and volume force (N)
    warm : (nv,) temperature over the state free of stress (K)
    heat : (nv, d) nodal loads of the thermal strains (N)
    stored : root of twice the elastic energy of fully constrained thermal strains (√J)
    prescribed : (nv, d) displacements of clamped dofs (m), zero elsewhere
    taken : (nv, d) the forces K u of the prescribed displacements alone (N)
    b : (d k,) right-hand side of the system (N)
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
        return float(
            max(
                np.abs(self.f).sum(),
                *(PRESCRIBED_SHARE * np.abs(forces).sum() for forces in (self.taken, self.heat)),
            )
        )

    @property
    def confined(self) -> float:
        """The energy (J) that heat and prescribed displacements would store where nothing else gave way."""
        return 0.5 * (self.stored**2 + float(np.abs(self.taken * self.prescribed).sum()))

    @property
    def heated(self) -> np.ndarray | None:
        """`warm`, or None without a difference of temperature."""
        return self.warm if self.warm.any() else None


@dataclass(frozen=True)
class Supported:
    """What follows from the stiffness K of a body and the directions of its clamps, without loads.

    Attributes
    ----------
    A : PETSc AIJ matrix (d k, d k), symmetric, block size d (N/m; in the plane per metre of depth); positive definite
        if clamps support the body, else its null space are the motions
    n : number of free dofs: d k less the clamped directions of nodes that stay
    nodes : (k,) the mesh nodes that A acts on, in the order of its rows
    motions : (nv, d, j) the rigid motions that clamps leave free, see `body_motions`; zero in prescribed directions
    softest : stiffness of the softest foundation, k times the area (N/m); infinite without one
    sprung : (r, d nv) the rows √k Q of the foundations, or None
    stiffest : the largest entry of the stiffness of single nodes (N/m)
    clamped : (c,) nodes with clamped directions
    rows : (d c, d nv) the rows of K at these nodes, without foundations
    """

    A: PETSc.Mat
    n: int
    nodes: np.ndarray
    motions: np.ndarray
    softest: float
    sprung: sparse.csr_matrix | None
    stiffest: float
    clamped: np.ndarray
    rows: sparse.csr_matrix

    def forces(self, u: np.ndarray) -> np.ndarray:
        """K u (nv, d) in newtons at clamped nodes, zero elsewhere, for a displacement u (nv, d) in metres."""
        forces = np.zeros_like(u)
        forces[self.clamped] = (self.rows @ u.ravel()).reshape(-1, u.shape[1])
        return forces


@dataclass(frozen=True)
class Elasticity(Supported):
    """The discrete problem of one body, ``A u = b`` on its dofs that are not eliminated.

    Loads and prescribed displacements are the present ones; `under` sets those of another time.

    Attributes
    ----------
    b : PETSc vector (d k,) (N; in the plane per metre of depth)
    supports : the clamped directions of nodes
    acting : the present load case
    load : sum of the absolute nodal loads (N), tractions and volume forces; with prescribed displacements or
        temperatures, at least PRESCRIBED_SHARE of their forces
    warnings : loads without effect, and groups with a load or springs twice
    cases : loads and prescribed displacements, by history
    pushes : by history force and moment of the loads of each group, at its factor 1, as of `resultants`
    """

    b: PETSc.Vec
    supports: Supports
    acting: LoadCase
    load: float
    warnings: list[str]
    cases: Mapping[str | None, LoadCase]
    pushes: Mapping[str | None, dict[str, dict[str, np.ndarray]]]

    @property
    def free(self) -> np.ndarray:
        """(nv, d) bool, components that can move."""
        return self.supports.free.diagonal(axis1=1, axis2=2) > SAME

    def under(self, factors: Mapping[str | None, float]) -> Elasticity:
        """The same body under its load cases times `factors`; `load`, the scale of forces, stays."""
        case = _sum_cases([(factors[name], case) for name, case in self.cases.items()])
        b = self.b.duplicate()
        b.array[:] = case.b
        return replace(self, b=b, acting=case)

    def largest(self, factors: Sequence[Mapping[str | None, float]]) -> Elasticity:
        """The same body with the largest `load` of its cases times any of `factors`."""
        sums = (
            _sum_cases([(now[name], case) for name, case in self.cases.items()]) for now in factors
        )
        return replace(self, load=max(case.size for case in sums))

    @property
    def supported(self) -> bool:
        """Whether clamps and springs leave no rigid motion free."""
        return self.motions.shape[2] == 0

    def expand(self, u: PETSc.Vec) -> np.ndarray:
        """The displacement (nv, d) of all nodes from the solution `u` of the reduced system (m)."""
        full = self.acting.prescribed.copy()
        full[self.nodes] += apply(
            self.supports.free[self.nodes], u.array_r.reshape(-1, full.shape[1])
        )
        return full


def assemble(mesh: Mesh, body: BodySpec, kept: Kept | None = None) -> Elasticity:
    """Assemble stiffness and load of `body` and eliminate its clamped dofs symmetrically.

    >>> from ddmpi.mesh.build import build_mesh
    >>> from ddmpi.scene.reader import read_scene_file
    >>> spec = read_scene_file("configs/pinched_blocks.toml").body[0]
    >>> elasticity = assemble(build_mesh(spec), spec)
    >>> elasticity.n, elasticity.supported, elasticity.A.getSize()
    (3036, True, (3036, 3036))

    What is `kept` of the same body, or of one alike, is taken: its stiffness depends on its mesh, wherever this is, on
    material, foundations and the directions of clamps, not on their values, nor on loads. Not collective. Raises
    InputError if the clamps contradict each other, or leave a part of the body loose that is not connected to the rest.
    """
    kept, name = kept or Kept(), body.name
    clamped = kept.get(
        "supports",
        name,
        (kept.key("mesh", name), body.clamp, histories(body)),
        lambda: supports(mesh, body),
    )
    stiff = kept.get(
        "stiffness",
        name,
        (kept.key("shape", name), body.material, body.foundation, clamped.free),
        lambda: _stiffness(mesh, body, clamped.free),
    )
    return kept.get(
        "load cases",
        name,
        (kept.key("stiffness", name), body),
        lambda: load_cases(mesh, body, clamped, stiff),
    )


def load_cases(mesh: Mesh, body: BodySpec, clamped: Supports, stiff: Supported) -> Elasticity:
    """The body with its loads. Not collective. Raises InputError."""
    material = material_of(mesh, body)
    loose, sprung, acting, cases = clamped.free[stiff.nodes], stiff.sprung, {}, {}
    for history, moved in clamped.moved.items():
        acting[history] = [*loads_by_group(mesh, body, history)]
        f, warm = (
            sum((f for _, f in acting[history]), np.zeros_like(moved)),
            temperature(mesh, body, history),
        )
        heat, energy = (
            thermal_loads(mesh, material, warm) if warm.any() else (np.zeros_like(f), 0.0)
        )
        # K (u + p) = f + heat for the free part u and the prescribed p: the right-hand side is f + heat − K p.
        # Only clamped nodes are moved, and the columns of K are its rows.
        taken = (stiff.rows.T @ moved[stiff.clamped].ravel()).reshape(moved.shape)
        if sprung is not None:
            taken += (sprung.T @ (sprung @ moved.ravel())).reshape(moved.shape)
        right = f + heat - taken
        refuse_underflow(mesh, body, right, moved, stiff.stiffest)
        cases[history] = LoadCase(
            f, warm, heat, energy**0.5, moved, taken, apply(loose, right[stiff.nodes]).ravel()
        )
    case = _sum_cases([(1.0, loads) for loads in cases.values()])
    if not np.isfinite(case.b).all():
        raise _out_of_range(body)
    load = PETSc.Vec().createWithArray(case.b, bsize=mesh.dimension, comm=PETSc.COMM_SELF)
    load.setBlockSize(mesh.dimension)
    known = {
        entry.name: getattr(stiff, entry.name) for entry in fields(Supported)
    }  # derivatives give an Elasticity
    return Elasticity(
        **known,
        b=load,
        supports=clamped,
        acting=case,
        load=case.size,
        warnings=lost_loads(body, clamped.free, acting),
        cases=cases,
        pushes={history: resultants(mesh, groups) for history, groups in acting.items()},
    )


def _stiffness(mesh: Mesh, body: BodySpec, free: np.ndarray) -> Supported:
    """The stiffness of a body on the directions that its clamps leave `free` (nv, d, d). Raises InputError."""
    explain = partial(causes, mesh, body, free)
    mesh = mesh.home  # which bodies have in common that are alike
    K, foundations = sum_stiffness(mesh, material_of(mesh, body)), list(springs(mesh, body))
    rows = sparse.vstack([Q for *_, Q in foundations], format="csr") if foundations else None
    motions = body_motions(mesh, K, free, body.name, rows)
    sprung = (
        sparse.vstack([root * Q for _, root, Q in foundations], format="csr")
        if foundations
        else None
    )
    nodes, clamped = np.flatnonzero(free.any(axis=(1, 2))), np.flatnonzero(is_touched(free))
    loose, d = free[nodes], mesh.dimension
    whole = K.to_csr(free, nodes, sprung)
    # Overflow shows as inf, underflow as a zero on the diagonal: both end in wrong answers if PETSc meets them.
    if not (
        np.isfinite(whole.data).all()
        and K.diagonal[nodes].diagonal(axis1=1, axis2=2).min(initial=np.inf) > 0.0
    ):
        raise _out_of_range(body)

    matrix = PETSc.Mat().createAIJWithArrays(
        whole.shape,
        (
            whole.indptr.astype(PETSc.IntType, copy=False),
            whole.indices.astype(PETSc.IntType, copy=False),
            whole.data,
        ),
        bsize=d,
        comm=PETSc.COMM_SELF,
    )
    matrix.setBlockSize(d)  # createAIJWithArrays ignores its bsize
    matrix.setOption(PETSc.Mat.Option.SYMMETRIC if motions.size else PETSc.Mat.Option.SPD, True)
    matrix.setNearNullSpace(near_null_space(mesh.points[nodes], loose))
    matrix.setAttr("causes", partial(explain, sprung))
    if not mesh.cell.linear:
        matrix.setAttr("coarse", partial(_linear_elements, mesh, nodes, loose))
    return Supported(
        matrix,
        round(np.einsum("kii->", loose)),
        nodes,
        motions,
        min((root**2 for _, root, _ in foundations), default=np.inf),
        sprung,
        float(K.diagonal.max()),
        clamped,
        K.rows(clamped),
    )


def _out_of_range(body: BodySpec) -> InputError:
    return InputError(
        f"body.{body.name}: material, loads and lengths give numbers out of the range of double "
        "precision; choose other units"
    )


def _linear_elements(
    mesh: Mesh, nodes: np.ndarray, loose: np.ndarray
) -> tuple[PETSc.Mat, PETSc.NullSpace]:
    """For multigrid on quadratic elements: the displacements (k d, j d) of the `nodes` (k,) by those of the corners
    among them as linear elements have them, and the rigid motions of these corners. `loose` (k, d, d) as of A."""
    first, size = mesh.cell.corners, len(mesh.points)
    middles, cells = np.unique(mesh.triangles[:, first:], return_index=True)
    ends = mesh.triangles[:, mesh.cell.between].reshape(-1, 2)[cells]
    corners, half = np.unique(mesh.corners), np.full(2 * len(middles), 0.5)
    rows, columns = (
        np.concatenate([corners, middles.repeat(2)]),
        np.concatenate([corners, ends.ravel()]),
    )
    means = sparse.csr_matrix(
        (np.append(np.ones(len(corners)), half), (rows, columns)), (size, size)
    )
    kept = np.isin(nodes, corners)
    P = sparse.kron(means[nodes][:, nodes[kept]], sparse.identity(mesh.dimension), "csr")
    indices = (P.indptr.astype(PETSc.IntType), P.indices.astype(PETSc.IntType))
    matrix = PETSc.Mat().createAIJ(P.shape, csr=(*indices, P.data), comm=PETSc.COMM_SELF)
    return matrix, near_null_space(mesh.points[nodes[kept]], loose[kept])


def clamp_forces(
    mesh: Mesh, body: BodySpec, elasticity: Elasticity, u: np.ndarray, pull: np.ndarray
) -> Iterator[tuple[str, np.ndarray]]:
    """The forces of all clamps and foundations on the body: group, and nodal forces (nv, d) in newtons. Not collective.

    A node's reaction is split along the directions of its clamps; a direction that several of them constrain goes to
    the last. `u` (nv, d) is the displacement under the present loads (m), `pull` (nv, d) are the contact forces on the
    body (N).
    """
    given = elasticity.acting.f + elasticity.acting.heat + pull
    for on, root, Q in springs(mesh, body):
        pressed = -(root**2) * (Q.T @ (Q @ u.ravel())).reshape(u.shape)
        given = given + pressed
        yield on, pressed
    forces, clamped = elasticity.forces(u), elasticity.clamped
    # Reaction = K u − (loads + contact forces): what equilibrium at the clamped nodes lacks.
    forces[clamped] -= given[clamped]
    forces[mesh.on_axis, 0] = 0.0  # rounding of integrals that vanish
    free, shares = np.tile(np.eye(mesh.dimension), (len(u), 1, 1)), []
    # Clamps of one node may be oblique to each other. The part of a direction orthogonal to those of later clamps
    # measures its share of the reaction; the remainder is left to the later ones.
    for which, nodes, direction in reversed(elasticity.supports.constrained):
        direction = np.where(
            mesh.on_axis[nodes, None] & (np.arange(mesh.dimension) == 0), 0.0, direction
        )
        rest = apply(free[nodes], direction)
        squares = np.where((rest**2).sum(axis=1) > SAME**2, (rest**2).sum(axis=1), np.inf)
        free[nodes] -= rest[:, :, None] * rest[:, None] / squares[:, None, None]
        shares.append((body.clamps[which].on, nodes, direction, rest / squares[:, None]))
    for on, nodes, direction, rest in reversed(
        shares
    ):  # `rest` is orthogonal to the directions of later clamps
        share = np.zeros_like(u)
        share[nodes] = (forces[nodes] * rest).sum(axis=1)[:, None] * direction
        forces -= share
        yield on, share


def apply(matrices: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """The products (k, d) of matrices (k, d, d) with vectors (k, d)."""
    return np.einsum("kij,kj->ki", matrices, vectors)


def _sum_cases(summands: Sequence[tuple[float, LoadCase]]) -> LoadCase:
    """The sum of load cases, each times a factor."""
    return LoadCase(
        *(
            sum(factor * getattr(case, entry.name) for factor, case in summands)
            for entry in fields(LoadCase)
        )
    )
