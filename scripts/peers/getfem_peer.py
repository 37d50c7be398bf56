"""GetFEM (python3-getfem): its nodal contact condition with friction, Alart and Curnier's augmented Lagrangian.

    python -m peers.getfem_peer FOLDER

Bodies share a mesh, so that one contact brick holds all contacts; as GetFEM merges nodes at the same place, the bodies
are moved apart in it. Multipliers of the bricks are nodal forces.
"""

from __future__ import annotations

import sys
from pathlib import Path

import getfem
import numpy as np

from peers import Answer, Case, answer_of, read_case

ITERATIONS = 100
RESIDUAL = 1e-12
"""In units in which E is one: GetFEM adds forces and gaps."""


def solve(case: Case) -> Answer:
    moved, d, m = case.apart, case.dimension, len(case.pairs)
    size = np.ptp(moved)
    mesh = getfem.Mesh("empty", d)
    mesh.add_convex(getfem.GeoTrans(f"GT_PK({d},1)"), moved[case.cells].transpose(2, 1, 0))
    fem = getfem.MeshFem(mesh, d)
    fem.set_fem(getfem.Fem(f"FEM_PK({d},1)"))
    integration = getfem.MeshIm(mesh, getfem.Integ({2: "IM_TRIANGLE(1)", 3: "IM_TETRAHEDRON(1)"}[d]))
    order = np.lexsort(np.round(fem.basic_dof_nodes()[:, ::d] / size, 10))
    dofs = np.empty(len(moved), int)  # of each node's first component
    dofs[np.lexsort(np.round(moved.T / size, 10))] = d * order
    dofs = (dofs[:, None] + np.arange(d)).ravel()

    def matrix(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, count: int) -> getfem.Spmat:
        found = getfem.Spmat("empty", count, fem.nbdof())
        for row, column, value in zip(rows.tolist(), dofs[columns].tolist(), values.tolist(), strict=True):
            found[row, column] = value
        return found

    load = np.zeros(fem.nbdof())
    load[dofs] = case.load / case.young
    held = len(case.clamped)
    model = getfem.Model("real")
    model.add_fem_variable("u", fem)
    for name, value in zip(("lambda", "mu"), case.lame, strict=True):
        model.add_initialized_data(name, value / case.young)
    model.add_isotropic_linearized_elasticity_brick(integration, "u", "lambda", "mu")
    model.add_explicit_rhs("u", load)
    model.add_variable("clamps", held)
    model.add_constraint_with_multipliers("u", "clamps", matrix(np.arange(held), case.clamped, np.ones(held), held),
                                          np.zeros(held))
    model.add_variable("normal", m)
    model.add_initialized_data("r", 1.0)
    model.add_initialized_data("gap", case.gap)
    model.add_initialized_data("alpha", case.area ** ((d - 2) / (d - 1)))  # in space forces are E times areas
    rows, columns, values = case.relative()
    along = rows < m
    BN = matrix(rows[along], columns[along], values[along], m)
    if case.friction:
        component, pair = np.divmod(rows[~along] - m, m)
        BT = matrix((d - 1) * pair + component, columns[~along], values[~along], (d - 1) * m)
        model.add_variable("tangential", (d - 1) * m)
        model.add_initialized_data("friction", case.friction)
        model.add_basic_contact_brick("u", "normal", "tangential", "r", BN, BT, "friction", "gap", "alpha", 1)
    else:
        model.add_basic_contact_brick("u", "normal", "r", BN, "gap", "alpha", 1)
    _, level, count = np.unique(np.round(np.einsum("mc,mc->m", case.normal, case.points[case.pairs[:, 0]]) / size
                                         + case.gap / size, 9), return_inverse=True, return_counts=True)
    guess = np.abs(case.load.reshape(-1, d) @ case.axis).sum() / case.young / count[level]
    model.set_variable("normal", -guess)  # the load on each joint: without it friction holds nothing at first
    steps, converged = model.solve("max_res", RESIDUAL, "max_iter", ITERATIONS, "lsolver", "mumps")
    if not converged:
        raise RuntimeError(f"Newton's method has not converged in {ITERATIONS} iterations")
    t = model.variable("tangential").reshape(m, -1).T if case.friction else np.zeros((d - 1, m))
    s = np.vstack([model.variable("normal"), t])
    return answer_of(case, model.variable("u")[dofs], -case.young * s, int(steps))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    solve(read_case(folder)).save(folder)
