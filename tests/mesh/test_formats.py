"""Mesh files of other programs: their sets of elements and nodes are groups."""

import gmsh
import meshio
import numpy as np
import pytest
from test_mesh import HALVES, NAMES, SIDES, SQUARE, area, body_with, length, refused

from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import file_kind, read_mesh
from ddmpi.scene.bodies import MeshSpec

MIDDLES = (SQUARE + np.roll(SQUARE, -1, axis=0)) / 2

ELEMENTS = {
    "CPE3": [[1, 2, 3], [1, 3, 4]], "CPS3": [[1, 2, 3], [1, 3, 4]], "S3": [[1, 2, 3], [1, 3, 4]],
    "CPS4R": [[1, 2, 3, 4]], "CPS6": [[1, 2, 3, 5, 6, 9], [1, 3, 4, 9, 7, 8]],
    "CPE6M": [[1, 2, 3, 5, 6, 9], [1, 3, 4, 9, 7, 8]], "CPS8": [[1, 2, 3, 4, 5, 6, 7, 8]]}
"""The square by Abaqus's names of elements; nodes 5 to 8 are the middles of its sides, 9 is that of the diagonal."""


def write_inp(path, kind: str, elements=None, more: str = ""):
    """The square as a program for Abaqus or CalculiX writes it, its sides as sets of nodes."""
    points = np.vstack([SQUARE, MIDDLES, [[0.5, 0.5]]])
    lines = ["*HEADING", "** a square", "*NODE, NSET=all", *(f"{k}, {x}, {y}" for k, (x, y) in enumerate(points, 1)),
             f"*ELEMENT, TYPE={kind}, ELSET=volume",
             *(f"{k}, {', '.join(map(str, nodes))}" for k, nodes in enumerate(elements or ELEMENTS[kind], 1)),
             "*NSET, NSET=bottom, GENERATE", "1, 2, 1", "*NSET, NSET=right", "2, 3,", "6", "*Nset, nset=top", "3, 4",
             "*NSET, NSET=left", "4, 1", "*NSET, NSET=corner", "1", "*NSET, NSET=volume", "1, 2, 3, 4", more,
             "*MATERIAL, NAME=steel", "*ELASTIC", "210000., 0.3", "*STEP", "*STATIC", "*BOUNDARY", "bottom, 1, 2",
             "*NODE FILE", "U", "*END STEP"]
    path.write_text("\n".join(line for line in lines if line) + "\n")
    return path


def same_square(mesh: Mesh, names=NAMES) -> None:
    """The mesh is the square, its boundary groups are the four sides."""
    assert area(mesh) == pytest.approx(1.0, rel=1e-13) and set(mesh.groups) == set(names)
    for name, component, value in zip(names, (1, 0, 1, 0), (0.0, 1.0, 1.0, 0.0), strict=True):
        assert length(mesh, name) == pytest.approx(1.0, rel=1e-13)
        assert np.all(mesh.points[mesh.groups[name], component] == value)


@pytest.mark.parametrize("kind", ELEMENTS)
def test_abaqus_input(tmp_path, kind):
    """Sets of nodes are the sides between them, sets of elements are surfaces; quadrilaterals are cut."""
    path = write_inp(tmp_path / "square.inp", kind)
    corners = len(ELEMENTS[kind][0])
    order = 2 if corners > 4 else 1
    mesh = build_mesh(body_with(MeshSpec(file=str(path), order=order), clamp=["left", "corner"]))
    same_square(mesh)
    assert (file_kind(path, "upper"), mesh.cut) == ((2, order), int(corners in (4, 8)))
    assert mesh.surfaces.keys() == {"volume"} and len(mesh.surfaces["volume"]) == len(mesh.triangles)
    assert np.array_equal(mesh.points[mesh.vertices["corner"]], [[0.0, 0.0]])


def test_input_of_gmsh(tmp_path):
    """gmsh writes lines as trusses, and physical groups as sets of elements; nodes of the groups add nothing."""
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        surface = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        for curve, name in zip((1, 2, 3, 4), NAMES, strict=True):
            gmsh.model.addPhysicalGroup(1, [curve], name=name)
        gmsh.model.addPhysicalGroup(2, [surface], name="volume")
        gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", 1)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "square.inp"))
    finally:
        gmsh.finalize()
    mesh = read_mesh(tmp_path / "square.inp", "upper")
    same_square(Mesh(mesh.points, mesh.triangles, {name: mesh.groups[name] for name in NAMES}))
    assert not mesh.vertices and len(mesh.surfaces["volume"]) == len(mesh.triangles)


def square(**data) -> meshio.Mesh:
    points = np.column_stack([SQUARE, np.zeros(4)])
    return meshio.Mesh(points, [("line", SIDES), ("triangle", HALVES)], **data)


def test_med_groups_have_no_blanks(tmp_path):
    """MED pads names with blanks; a family of elements may belong to several groups, and a group have several."""
    made = square(cell_data={"cell_tags": [np.array([-1, -2, -3, -4]), np.array([-5, -5])]},
                  point_data={"point_tags": np.array([2, 0, 0, 0])})
    made.cell_tags = {-k: [f"{name:<80}", "rim".ljust(80, "\0")] for k, name in enumerate(NAMES, 1)} | {-5: ["volume"]}
    made.point_tags = {2: ["corner" + 74 * " "]}
    made.write(tmp_path / "square.med")
    mesh = read_mesh(tmp_path / "square.med", "upper")
    assert length(mesh, "rim") == pytest.approx(4.0) and mesh.vertices["corner"].tolist() == [0]
    del mesh.groups["rim"]
    same_square(mesh)


@pytest.mark.parametrize("ending", [".vtu", ".vtk"])
def test_groups_by_number(tmp_path, ending):
    """VTK's formats number groups, as gmsh does there; 0 is none."""
    numbers = [np.array([1, 2, 3, 4]), np.array([0, 9])]
    path = tmp_path / f"square{ending}"
    square(cell_data={"CellEntityIds": numbers}).write(path)
    mesh = read_mesh(path, "upper")
    same_square(mesh, "1234")
    assert {name: each.tolist() for name, each in mesh.surfaces.items()} == {"9": [1]}


@pytest.mark.parametrize(("more", "words"), [
    ("*ELEMENT, TYPE=C3D4\n9, 1, 2, 3, 4", "has tetrahedra without volume"),
    ("*ELEMENT, TYPE=CPS3\n9, 1, 2, 77", "is not a mesh that meshio can read (KeyError 77)"),
    ("*ELEMENT, TYPE=UNKNOWN\n9, 1, 2, 3", "is not a mesh that meshio can read (ReadError"),
    ("*NODE\n1, 0, 0", "elements of nodes that are not there"),
    ("*INCLUDE, INPUT=square.inp", "is not a mesh that meshio can read (Rec")])
def test_refused_input(tmp_path, monkeypatch, more, words):
    """What meshio cannot read, or reads wrong, is refused with the reason."""
    monkeypatch.chdir(tmp_path)
    assert words in refused(write_inp(tmp_path / "square.inp", "CPS3", more=more))


def test_input_without_groups(tmp_path):
    """A mesh without sets has no boundary to clamp."""
    square().write(tmp_path / "square.vtu")
    with pytest.raises(InputError, match="has no named physical groups of lines"):
        read_mesh(tmp_path / "square.vtu", "upper")
