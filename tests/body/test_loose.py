"""Bodies that clamps do not hold: springs that make them solvable, and centring that takes the springs out again."""

import numpy as np
import pytest
import scipy.sparse as sparse
from boundaries import rectangle
from by_skfem import to_scipy
from petsc4py import PETSc

from ddmpi.body.elasticity import Elasticity, assemble
from ddmpi.body.rigid_motions import Centring, add_springs, support
from ddmpi.body.solver import StiffnessSolver
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, Traction

CLAMPS = {
    "nothing": [],
    "y on a side": [Clamp(on="bottom", y=0.0)],
    "x on a side": [Clamp(on="left", x=0.0)],
    "sides along themselves": [Clamp(on="bottom", x=0.0), Clamp(on="left", y=0.0)],
    "x along a side": [Clamp(on="bottom", x=0.0)],
}
"""3, 1, 1, 1 and 2 motions are left."""


def dense(A: PETSc.Mat) -> np.ndarray:
    return to_scipy(A).toarray()


def elastic(mesh: Mesh, clamp=(), young=2e11) -> Elasticity:
    return assemble(
        mesh,
        BodySpec(
            name="block",
            mesh=MeshSpec(file="unused.msh"),
            clamp=list(clamp),
            material=Material(young=young, poisson=0.3),
            traction=[Traction(on="right", value=(3e6, -1e6))],
        ),
    )


def along(mesh: Mesh, group: str) -> np.ndarray:
    """Nodes of a group in the order of x + y."""
    nodes = np.unique(mesh.groups[group])
    return nodes[np.argsort(mesh.points[nodes].sum(axis=1))]


def with_springs(problem: Elasticity) -> PETSc.Mat:
    return add_springs(problem.A, support(problem.motions[problem.nodes]))


@pytest.mark.parametrize(
    ("size", "young"), [((3e-6, 1e-6), 2e11), ((3e6, 1e6), 1e-6), ((100.0, 1.0), 2e11)], ids=str
)
def test_springs_leave_the_conditioning_of_the_body(size, young):
    """With springs a body is hardly worse than clamped on a short side, in all units."""
    mesh = rectangle((15, 5), size)
    held = np.linalg.cond(dense(elastic(mesh, ["left"], young).A))
    for clamp in CLAMPS.values():
        assert np.linalg.cond(dense(with_springs(elastic(mesh, clamp, young)))) <= 1.1 * held


def test_multigrid_solves_a_loose_body_as_fast_as_a_held_one():
    """The rigid motions are kept as near null space, so that iterations hardly grow with the mesh."""
    taken = []
    for divisions in ((24, 8), (96, 32)):
        mesh = rectangle(divisions, (3.0, 1.0))
        for A in (with_springs(elastic(mesh)), elastic(mesh, ["left"]).A):
            solver, f = StiffnessSolver(A, "block", iterative=True), A.createVecLeft()
            f.array[:] = np.random.default_rng(0).standard_normal(f.size)
            solver.solve(f, f.duplicate())
            taken.append(solver.ksp.getIterationNumber())
    loose, held, loose_fine, held_fine = taken
    assert loose <= held + 5
    assert loose_fine <= held_fine + 5


@pytest.mark.parametrize("angle", [0.0, 0.3, 1e-9])
def test_contact_that_does_not_see_a_motion(angle):
    """Without friction, a flat contact does not see what slides along it, whatever rounding makes of its normals."""
    mesh = rectangle((9, 3), (3.0, 1.0))
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    turned = Mesh(mesh.points @ turn.T + 100.0, mesh.triangles, mesh.groups)
    problem, top = elastic(turned), along(mesh, "top")
    normals = turn @ np.array([0.0, 1.0]) + 1e-14 * np.random.default_rng(0).standard_normal(
        (len(top), 2)
    )
    B = sparse.csr_matrix(
        (normals.ravel(), (np.repeat(np.arange(len(top)), 2), (2 * top[:, None] + [0, 1]).ravel())),
        (len(top), problem.b.size),
    )
    R = problem.motions.reshape(-1, 3)
    centring = Centring(R, B)
    along_it = np.tile(turn @ np.array([1.0, 0.0]), len(mesh.points))
    x = np.random.default_rng(1).standard_normal(len(top))
    y = np.linspace(-1.0, 1.0, len(top))
    linear = np.column_stack([np.ones(len(y)), y])
    assert centring.project(x) == pytest.approx(
        x - linear @ np.linalg.lstsq(linear, x, rcond=None)[0], abs=1e-10
    )
    assert np.abs(centring.centre(along_it)).max() <= 1e-10
