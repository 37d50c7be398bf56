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
    moved = case.apart
    size = np.ptp(moved)
    mesh = getfem.Mesh("empty", 2)
    mesh.add_convex(getfem.GeoTrans("GT_PK(2,1)"), moved[case.triangles].transpose(2, 1, 0))
    fem = getfem.MeshFem(mesh, 2)
    fem.set_fem(getfem.Fem("FEM_PK(2,1)"))
    integration = getfem.MeshIm(mesh, getfem.Integ("IM_TRIANGLE(1)"))
    order = np.lexsort(np.round(fem.basic_dof_nodes()[:, ::2] / size, 10))
    dofs = np.empty(len(moved), int)  # of each node's first component
    dofs[np.lexsort(np.round(moved.T / size, 10))] = 2 * order

    def matrix(rows: np.ndarray, columns: np.ndarray, values: np.ndarray, count: int) -> getfem.Spmat:
        found = getfem.Spmat("empty", count, fem.nbdof())
        for row, column, value in zip(rows.tolist(), (dofs[columns // 2] + columns % 2).tolist(), values.tolist(),
                                      strict=True):
            found[row, column] = value
        return found

    load = np.zeros(fem.nbdof())
    load[dofs], load[dofs + 1] = (case.load[c::2] / case.young for c in range(2))
    held, m = len(case.clamped), len(case.pairs)
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
    model.add_initialized_data("alpha", np.ones(m))
    BN = matrix(*case.relative(case.normal), m)
    if case.friction:
        model.add_variable("tangential", m)
        model.add_initialized_data("friction", case.friction)
        model.add_basic_contact_brick("u", "normal", "tangential", "r", BN, matrix(*case.relative(case.tangent), m),
                                      "friction", "gap", "alpha", 1)
    else:
        model.add_basic_contact_brick("u", "normal", "r", BN, "gap", "alpha", 1)
    guess = np.abs(case.load[1::2].sum()) / case.young / np.bincount(case.contact)[case.contact]
    model.set_variable("normal", -guess)  # the load on each contact: without it friction holds nothing at first
    steps, converged = model.solve("max_res", RESIDUAL, "max_iter", ITERATIONS, "lsolver", "mumps")
    if not converged:
        raise RuntimeError(f"Newton's method has not converged in {ITERATIONS} iterations")
    values, u = model.variable("u"), np.empty(2 * len(moved))
    for c in range(2):
        u[c::2] = values[dofs + c]
    s = [model.variable("normal"), model.variable("tangential") if case.friction else np.zeros(m)]
    return answer_of(case, u, -case.young * np.array(s), int(steps))


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    solve(read_case(folder)).save(folder)
