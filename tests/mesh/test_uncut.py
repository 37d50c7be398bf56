"""Bodies of quadrilaterals: read whole, cut where they are not convex, and their integration."""

from pathlib import Path

import meshio
import numpy as np
import pytest

from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh, refuse_overlaps
from ddmpi.scene.bodies import BodySpec, Material
from ddmpi.scene.meshes import MeshSpec

SQUARE = [[0, 0], [1, 0], [2, 0], [0, 1], [1, 1], [2, 1]]
QUADS = [[0, 1, 4, 3], [1, 2, 5, 4]]


def written(path: Path, points=SQUARE, cells=(("quad", QUADS),)) -> Path:
    """A file with the edges from node 0 to 3, and from 2 to 5, as groups left and right."""
    lines = np.array([[0, 3], [5, 2]])
    kinds = [*((kind, np.array(nodes)) for kind, nodes in cells), ("line", lines)]
    tags = [*(np.full(len(nodes), 9) for _, nodes in kinds[:-1]), np.array([1, 2])]
    meshio.write(
        path,
        meshio.Mesh(
            np.pad(np.array(points, float), ((0, 0), (0, 1))),
            kinds,
            cell_data={"gmsh:physical": tags, "gmsh:geometrical": tags},
            field_data={
                "left": np.array([1, 1]),
                "right": np.array([2, 1]),
                "body": np.array([9, 2]),
            },
        ),
        file_format="gmsh22",
        binary=False,
    )
    return path


def built(path: Path, axisymmetric: bool = False, **keys) -> Mesh:
    spec = BodySpec(
        name="plate",
        mesh=MeshSpec(file=str(path), **keys),
        material=Material(young=1.0, poisson=0.3),
    )
    return build_mesh(spec, axisymmetric=axisymmetric)


def test_quadrilaterals_stay_whole_unless_they_are_cut(tmp_path):
    """Of either direction around; with modes, and around an axis without."""
    turned = [QUADS[0], QUADS[1][::-1]]
    for cells in (QUADS, turned):
        path = written(tmp_path / "plate.msh", cells=[("quad", cells)])
        mesh = built(path, order=1)
        assert (mesh.cell.title, mesh.cut, mesh.cell.modes) == ("linear quadrilaterals", 0, True)
        assert mesh.measures() == pytest.approx([1.0, 1.0]) and len(mesh.facets("left").nodes) == 1
        second = built(path, order=2)
        assert len(second.points) == 13 and second.groups["right"].shape == (1, 3)
        assert not built(path, True, order=1).cell.modes
        cut = built(path, order=1, cut=True)
        assert (cut.cell.name, cut.cut, len(cut.triangles)) == ("triangle", 2, 4)


def test_what_is_not_convex_or_mixed_is_cut(tmp_path):
    """A quadrilateral with a corner of more than 180 degrees has no map; a triangle beside it has another cell."""
    dent = [*SQUARE[:4], [0.2, 0.2], SQUARE[5]]
    assert built(written(tmp_path / "dent.msh", points=dent), order=1).cell.name == "triangle"
    mixed = [("triangle", [[0, 1, 4], [4, 3, 0]]), ("quad", [QUADS[1]])]
    mesh = built(written(tmp_path / "mixed.msh", cells=mixed), order=1)
    assert mesh.cell.name == "triangle" and mesh.cut == 1


def test_an_integration_fits_cells_order_and_axis(tmp_path):
    path = written(tmp_path / "plate.msh")
    for keys, axis, words in (
        (
            {"order": 2, "integration": "modes"},
            False,
            '= "modes" belongs to order = 1; leave it out, or write "full"',
        ),
        ({"order": 1, "integration": "reduced"}, False, '= "reduced" belongs to order = 2'),
        (
            {"order": 1, "integration": "modes"},
            True,
            '= "modes" is not for axisymmetric bodies, in which constant',
        ),
    ):
        with pytest.raises(InputError, match=r"body\.plate\.mesh\.integration") as refused:
            built(path, axis, **keys)
        assert words in str(refused.value)
        assert built(path, axis, **keys | {"integration": "full"}).cell.name == "quadrilateral"
    path = written(tmp_path / "cut.msh", cells=[("triangle", [[0, 1, 4], [4, 3, 0], [1, 2, 5]])])
    with pytest.raises(
        InputError,
        match="integration belongs to bodies of quadrilaterals or hexahedra alone, all of them convex; this one has triangles",
    ):
        built(path, order=1, integration="full")


def test_bricks_on_the_same_side_of_a_side_are_refused():
    """One that lies on another one; beside it, it is not."""
    points, other = np.array([*SQUARE, [0.5, 0.2]], float), [1, 4, 3, 6]
    refuse_overlaps(Mesh(points[:6], np.array(QUADS), {}), "it")
    with pytest.raises(InputError, match="it has quadrilaterals that overlap"):
        refuse_overlaps(Mesh(points, np.array([QUADS[0], other]), {}), "it")
