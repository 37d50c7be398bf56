"""GetFEM (python3-getfem): contact with friction, Alart and Curnier's augmented Lagrangian.

    python -m peers.getfem_peer FOLDER

At order 1 its nodal brick, whose multipliers are nodal forces: bodies share a mesh, so that one brick holds all
contacts; as GetFEM merges nodes at the same place, the bodies are moved apart in it. At order 2 its integral brick
between meshes that need not match, a mesh for each body, with linear multipliers, which are stresses.
"""

from __future__ import annotations

import sys
from pathlib import Path

import getfem
import numpy as np

from peers import Answer, Case, along_and_across, answer_of, read_case

ITERATIONS = 100
RESIDUAL = 1e-12
"""In units in which E is one: GetFEM adds forces and gaps."""


def dofs_of(fem: getfem.MeshFem, points: np.ndarray, size: float) -> np.ndarray:
    """The dofs (d n,) of points (n, d), which are the nodes of the elements and no two of which are at one place."""
    d = points.shape[1]
    first = np.empty(len(points), int)
    order = np.lexsort(np.round(fem.basic_dof_nodes()[:, ::d] / size, 10))
    first[np.lexsort(np.round(points.T / size, 10))] = d * order
    return (first[:, None] + np.arange(d)).ravel()


def matrix(
    rows: np.ndarray, columns: np.ndarray, values: np.ndarray, shape: tuple[int, int]
) -> getfem.Spmat:
    found = getfem.Spmat("empty", *shape)
    for row, column, value in zip(rows.tolist(), columns.tolist(), values.tolist(), strict=True):
        found[row, column] = value
    return found


def add_body(
    model: getfem.Model, case: Case, cells: np.ndarray, points: np.ndarray, name: str
) -> tuple:
    """A variable of the model with stiffness, loads and clamps; returns its mesh, integration, nodes and their dofs."""
    d, order, nodes = 3, 2 if cells.shape[1] == 10 else 1, np.unique(cells)
    mesh = getfem.Mesh("empty", d)
    mesh.add_convex(getfem.GeoTrans(f"GT_PK({d},1)"), points[cells[:, : d + 1]].transpose(2, 1, 0))
    fem = getfem.MeshFem(mesh, d)
    fem.set_fem(getfem.Fem(f"FEM_PK({d},{order})"))
    integration = getfem.MeshIm(mesh, getfem.Integ(f"IM_TETRAHEDRON({1 if order == 1 else 5})"))
    dofs, own = (
        dofs_of(fem, points[nodes], np.ptp(points)),
        (d * nodes[:, None] + np.arange(d)).ravel(),
    )
    load, held = np.zeros(fem.nbdof()), dofs[np.isin(own, case.clamped)]
    load[dofs] = case.load[own] / case.young
    model.add_fem_variable(name, fem)
    model.add_isotropic_linearized_elasticity_brick(integration, name, "lambda", "mu")
    model.add_explicit_rhs(name, load)
    if len(held):
        rows = matrix(np.arange(len(held)), held, np.ones(len(held)), (len(held), fem.nbdof()))
        model.add_variable(f"clamps_{name}", len(held))
        model.add_constraint_with_multipliers(name, f"clamps_{name}", rows, np.zeros(len(held)))
    return mesh, integration, nodes, dofs


def start(case: Case) -> getfem.Model:
    model = getfem.Model("real")
    for name, value in zip(("lambda", "mu"), case.lame, strict=True):
        model.add_initialized_data(name, value / case.young)
    model.add_initialized_data("friction", case.friction)
    return model


def iterate(model: getfem.Model) -> int:
    steps, converged = model.solve("max_res", RESIDUAL, "max_iter", ITERATIONS, "lsolver", "mumps")
    if not converged:
        raise RuntimeError(f"Newton's method has not converged in {ITERATIONS} iterations")
    return int(steps)


def at_nodes(case: Case) -> Answer:
    d, m, size, model = 3, len(case.pairs), np.ptp(case.points), start(case)
    body = add_body(model, case, case.cells, case.apart, "u")
    dofs = body[-1]
    model.add_variable("normal", m)
    model.add_initialized_data("r", 1.0)
    model.add_initialized_data("gap", case.gap)
    model.add_initialized_data("alpha", np.sqrt(case.area))  # forces are E times areas
    rows, columns, values = case.relative()
    along, columns = rows < m, dofs[columns]
    BN = matrix(rows[along], columns[along], values[along], (m, len(dofs)))
    if case.friction:
        component, pair = np.divmod(rows[~along] - m, m)
        BT = matrix(
            (d - 1) * pair + component, columns[~along], values[~along], ((d - 1) * m, len(dofs))
        )
        model.add_variable("tangential", (d - 1) * m)
        model.add_basic_contact_brick(
            "u", "normal", "tangential", "r", BN, BT, "friction", "gap", "alpha", 1
        )
    else:
        model.add_basic_contact_brick("u", "normal", "r", BN, "gap", "alpha", 1)
    height = np.einsum("mc,mc->m", case.normal, case.points[case.pairs[:, 0]]) + case.gap
    _, level, count = np.unique(np.round(height / size, 9), return_inverse=True, return_counts=True)
    guess = np.abs(case.load.reshape(-1, d) @ case.axis).sum() / case.young / count[level]
    # The load on each joint: without it friction holds nothing at first.
    model.set_variable("normal", -guess)
    steps = iterate(model)
    t = model.variable("tangential").reshape(m, -1).T if case.friction else np.zeros((d - 1, m))
    return answer_of(
        case,
        model.variable("u")[dofs],
        -case.young * np.vstack([model.variable("normal"), t]),
        steps,
    )


def by_integrals(case: Case) -> Answer:
    d, model = 3, start(case)
    bodies = [
        add_body(model, case, case.cells[case.body == k], case.points, f"u{k}")
        for k in range(int(case.body.max()) + 1)
    ]
    model.add_initialized_data("r", 1.0 / case.spacing)
    total, pressure, along, stresses = np.zeros(d), 0.0, np.abs(case.axis), []
    section = np.prod(np.ptp(case.points, axis=0)[along < 0.5])
    guess = np.abs(case.load.reshape(-1, d) @ along).sum() / case.young / section
    for number in np.unique(case.side[:, 0]).tolist():
        pair = []
        for which in (0, 1):
            corners = np.unique(case.facets[(case.side == (number, which)).all(axis=1), :d])
            pair.append(next(k for k, (_, _, nodes, _) in enumerate(bodies) if corners[0] in nodes))
            mesh = bodies[pair[-1]][0]
            away = np.abs(mesh.pts().T[:, None] - case.points[corners]).max(axis=2).min(axis=1)
            outer = set(map(tuple, mesh.outer_faces().T.tolist()))
            faces = mesh.faces_from_pid(
                np.flatnonzero(away < 1e-9 * np.ptp(case.points))
            ).T.tolist()
            mesh.set_region(
                number + 1, np.array([each for each in faces if tuple(each) in outer]).T
            )
        fem = getfem.MeshFem(bodies[pair[0]][0], d)
        fem.set_fem(getfem.Fem(f"FEM_PK({d},1)"))
        model.add_filtered_fem_variable(f"stress{number}", fem, number + 1)
        model.add_integral_contact_between_nonmatching_meshes_brick(
            bodies[pair[0]][1],
            f"u{pair[0]}",
            f"u{pair[1]}",
            f"stress{number}",
            "r",
            "friction",
            number + 1,
            number + 1,
            1,
        )
        model.set_variable(
            f"stress{number}", np.tile(guess * along, len(model.variable(f"stress{number}")) // d)
        )
        stresses.append((number, bodies[pair[0]][1]))
    steps = iterate(model)
    for number, integration in stresses:
        if number < case.compared:
            total += [
                getfem.asm_generic(integration, 0, f"stress{number}({c + 1})", number + 1, model)
                for c in range(d)
            ]
        pressure = max(
            pressure, np.abs(model.variable(f"stress{number}").reshape(-1, d) @ along).max()
        )
    u = np.zeros(case.points.shape)
    for k, (_, _, nodes, dofs) in enumerate(bodies):
        u[nodes] = model.variable(f"u{k}")[dofs].reshape(-1, d)
    return Answer(
        u, case.young * along_and_across(case, total), float(case.young * pressure), steps
    )


if __name__ == "__main__":
    folder = Path(sys.argv[1])
    case = read_case(folder)
    (at_nodes if case.cells.shape[1] == 4 else by_integrals)(case).save(folder)
