"""Why a body's stiffness is too singular for double precision: the cause that is named is the one that is there."""

import meshio
import numpy as np
import pytest
from scenes import COULOMB, rectangle

import ddmpi
from ddmpi.body.singular import _thin_cells
from ddmpi.errors import SolverError
from ddmpi.mesh.mesh import Mesh


def block(size=(1.0, 1.0), divisions=(3, 3), **more) -> dict:
    """A block under a rigid plane; its other keys."""
    body = {"clamp": ["bottom"], "traction": [{"on": "top", "value": [0.0, -1e5]}]} | more
    return {
        "body": [rectangle("block", (0.0, 0.0), size, divisions, **body)],
        "rigid": [
            {"name": "lid", "shape": "plane", "point": [0.0, size[1]], "normal": [0.0, -1.0]}
        ],
        "contact": [{"bodies": ["block", "lid"], "on": ["top"], "friction": COULOMB}],
    }


WEAK = {"on": "bottom", "normal": 0.3, "tangential": 0.3}
CAUSES = {
    "a solver that does not solve": (
        block() | {"petsc": {"body_pc_type": "none"}},
        "without -body_pc_type none it leaves",
    ),
    "weak foundations": (
        block(clamp=[], foundation=[WEAK]),
        "its foundations alone resist a rigid motion",
    ),
    "no volume change": (
        block(poisson=0.49999999999),
        "with Poisson's ratio 0.49999999999 it resists changes of volume",
    ),
    "slender": (
        block((1.0, 2e-4), (400, 1), clamp=["left"]),
        "times as long as it is thick, and bends that much to the fourth power more than its cells",
    ),
}


@pytest.mark.parametrize("name", CAUSES)
def test_the_true_cause_is_named(name):
    """Options, foundations, Poisson's ratio and shape are told apart, each by what it does to the stiffness."""
    scene, words = CAUSES[name]
    with pytest.raises(SolverError, match=words) as caught:
        ddmpi.solve(scene)
    others = {other for _, other in CAUSES.values()} - {words}
    assert not [other for other in others if other in str(caught.value)]
    assert str(caught.value).endswith(": leave that out") == ("without" in words)


def test_materials_that_differ_too_much_are_named(tmp_path):
    """A stiff half on a soft one moves as if nothing held it."""
    points = np.array([[0, 0], [1, 0], [0, 0.5], [1, 0.5], [0, 1], [1, 1]])
    cells = np.array([[0, 1, 3], [0, 3, 2], [2, 3, 5], [2, 5, 4]])
    tags = [np.array([1, 2]), np.array([3, 3, 4, 4])]
    meshio.Mesh(
        np.pad(points, ((0, 0), (0, 1))),
        [("line", np.array([[0, 1], [4, 5]])), ("triangle", cells)],
        cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
        field_data={
            name: np.array([k, 1 + (k > 2)])
            for k, name in enumerate(("bottom", "top", "low", "up"), 1)
        },
    ).write(tmp_path / "two.msh", file_format="gmsh22", binary=False)
    halves = [{"on": "low", "young": 0.02}, {"on": "up", "young": 2e11}]
    scene = block(material=[half | {"poisson": 0.3} for half in halves])
    scene["body"][0]["mesh"] = {"file": str(tmp_path / "two.msh")}
    with pytest.raises(SolverError, match=r"Young's modulus is 1e\+13 times the smallest"):
        ddmpi.solve(scene)


def test_the_thinnest_cell_is_named():
    """By its place, and by its length over its mean height: of three cells that of 1e-9."""
    points = 3.0 * np.array([[0, 0], [1, 0], [1, 1], [0, 1], [0.5, 1.0 + 1e-9]])
    mesh = Mesh(points, np.array([[0, 1, 2], [0, 2, 3], [3, 2, 4]]), {})
    size, words = _thin_cells(mesh)
    assert "the cell at (1.5, 3) is 2e+09 times as long as it is thick" in words
    assert size == pytest.approx(4e18)
