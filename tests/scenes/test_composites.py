"""Runs with bodies of several materials, pressures, formulas and clamped points."""

import meshio
import numpy as np
import pytest
from boundaries import rectangle as generate
from boundaries import write_msh
from scenes import BRASS, FLOOR, STEEL, certified, rectangle, seldom

RUBBER = {"young": 1.0e9, "poisson": 0.4}
LOADS = {
    "traction": [
        {"on": "top", "pressure": "1e6 * (2 - x)"},
        {"on": "top", "value": ["2e5 * x**2", 0.0]},
    ]
}


def write_layers(path) -> str:
    """A unit square of 8 × 8 cells; surface `upper` above y = 1/2, `lower` below."""
    mesh = generate((8, 8), (1.0, 1.0))
    upper = mesh.points[mesh.triangles, 1].mean(axis=1) > 0.5
    return write_msh(path, mesh, {"upper": upper, "lower": ~upper})


@pytest.mark.slow
@pytest.mark.parametrize("order", [seldom(1), 2])
def test_a_body_of_two_materials_is_two_bonded_bodies(tmp_path, order):
    """A block of two layers slides on a base just as two bonded blocks do: the same forces and displacements."""

    def body(name: str, y: float, material: dict, **more) -> dict:
        clamp = {"clamp": [{"on": "left", "x": 0.0}]}
        return rectangle(name, (0, y), (1, 0.5), (8, 4), order, **material, **clamp | more)

    block = {
        "name": "block",
        "mesh": {"file": write_layers(tmp_path / "layers.msh"), "order": order},
        "material": [{"on": "lower", **RUBBER}, STEEL],
        "clamp": [{"on": "left", "x": 0.0}],
    }
    base = body("base", -0.5, BRASS, clamp=["bottom"])
    contact = {
        "bodies": ["block", "base"],
        "on": ["bottom", "top"],
        "friction": {"law": "coulomb", "coefficient": 0.2},
    }
    bonded = {"bodies": ["block", "steel"], "on": ["top", "bottom"], "kind": "bonded"}
    one = certified({"body": [block | LOADS, base], "contact": [contact]})
    two = certified(
        {
            "body": [body("block", 0.0, RUBBER), body("steel", 0.5, STEEL, **LOADS), base],
            "contact": [contact, bonded],
        }
    )
    mine, theirs = one.contacts["block-base"], two.contacts["block-base"]
    assert {"slip", "stick"} <= set(mine.status.tolist())
    for name in ("normal_force", "tangential_force", "slip"):
        a, b = getattr(mine, name), getattr(theirs, name)
        assert np.abs(a - b).max() <= 1e-6 * np.abs(b).max(), name
    corner = [1.0, 1.0]
    moved = [
        answer.bodies[name].displacement[(answer.bodies[name].points == corner).all(axis=1)][0]
        for answer, name in ((one, "block"), (two, "steel"))
    ]
    assert moved[0] == pytest.approx(moved[1], rel=1e-6)


@pytest.mark.parametrize("where, warned", [(["left", "right"], False), (["left"], True)])
def test_points_that_carry_forces_are_warned_of(tmp_path, where, warned):
    """A point that carries a force gives way without limit; one that only fixes the position does not."""
    path = write_layers(tmp_path / "layers.msh")
    mesh = meshio.gmsh.read(path)
    (corner,) = np.flatnonzero((mesh.points[:, :2] == (1.0, 1.0)).all(axis=1))
    mesh.cells.append(meshio.CellBlock("vertex", [[corner]]))
    for data in mesh.cell_data.values():
        data.append(np.array([21]))
    mesh.field_data["corner"] = np.array([21, 0])
    mesh.write(path, file_format="gmsh22", binary=False)
    block = {
        "name": "block",
        "mesh": {"file": path},
        "material": STEEL,
        "clamp": [{"on": "corner", "x": 0.0}],
        "traction": [{"on": "top", "pressure": 1e6}]
        + [{"on": on, "pressure": 1e5} for on in where],
    }
    contact = {"bodies": ["block", "floor"], "on": ["bottom"]}
    warnings = certified({"body": [block], "rigid": [FLOOR], "contact": [contact]}).summary[
        "warnings"
    ]
    assert len(warnings) == warned
    assert not warned or warnings[0].startswith(
        "body.block.clamp: the point 'corner' carries a force of 1e+05 N/m; it"
    )
