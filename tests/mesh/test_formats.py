"""Mesh files of other programs: their sets of elements and nodes are groups."""

import gmsh
import meshio
import numpy as np
import pytest
from test_mesh import HALVES, NAMES, SIDES, SQUARE, area, body_with, length, refused

from ddmpi.body.loads import supports
from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.elements import facet_measures
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import file_kind, gmsh_session, read_mesh
from ddmpi.scene.bodies import Clamp, MeshSpec

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


@pytest.mark.parametrize("kind", ["CPS6", "CPS8"])
def test_a_set_of_a_side_and_other_nodes_is_held_whole(tmp_path, kind):
    """Nodes beside the sides of a set are held, in the middle of an edge as well, unless linear elements have none."""
    more = "*NSET, NSET=mixed\n4, 1, 6\n*NSET, NSET=middle\n6\n*NSET, NSET=side\n4, 1, 8"
    path = write_inp(tmp_path / "square.inp", kind, more=more)
    mesh, straight = (read_mesh(path, "upper", order) for order in (2, 1))

    def held(name: str, of: Mesh = mesh) -> list[list[float]]:
        return sorted(of.points[of.nodes_of(name)].tolist())

    side = [[0.0, 0.0], [0.0, 0.5], [0.0, 1.0]]
    assert held("side") == side and held("mixed") == [*side, [1.0, 0.5]] and held("middle") == [[1.0, 0.5]]
    assert "side" not in mesh.vertices and len(mesh.facets("mixed").nodes) == 1
    assert held("side", straight) == side[::2]
    for name in ("mixed", "middle"):
        with pytest.raises(InputError, match=f"^'{name}' has nodes in the middle of edges, .* order = 2"):
            held(name, straight)
    with pytest.raises(InputError, match=r"the node of 'mixed' at \(1, 0.5\) is on no line of it and has no normal"):
        supports(mesh, body_with(MeshSpec(file=str(path)), clamp=[Clamp(on="mixed", normal=0.0)]))


def test_a_plane_part_is_moved_by_two_coordinates(tmp_path):
    """An instance of a plane part may be shifted by x and y alone."""
    path = write_inp(tmp_path / "square.inp", "CPS3", more="*INSTANCE, NAME=one\n2., 3.\n*END INSTANCE")
    mesh = read_mesh(path, "upper")
    assert np.array_equal([mesh.points.min(axis=0), mesh.points.max(axis=0)], [[2.0, 3.0], [3.0, 4.0]])


CAE = """*Heading
** as Abaqus/CAE writes it
*Part, name=Block
*Node
      1,           0.,           0.,           0.
      2,           1.,           0.,           0.
      3,           1.,           1.,           0.
      4,           0.,           1.,           0.
      5,           0.,           0.,           1.
      6,           1.,           0.,           1.
      7,           1.,           1.,           1.
      8,           0.,           1.,           1.
      9,           0.,           0.,           2.
     10,           1.,           0.,           2.
     11,           1.,           1.,           2.
     12,           0.,           1.,           2.
*Element, type=C3D8R
1, 1, 2, 3, 4, 5, 6, 7, 8
2, 5, 6, 7, 8, 9, 10, 11, 12
*Nset, nset=Whole, generate
  1,  12,   1
*Elset, elset=Lower
 1,
*Elset, elset=Upper
 2,
*Solid Section, elset=Lower, material=Steel
,
*End Part
*Assembly, name=Assembly
*Instance, name=Block-1, part=Block
         10.,           0.,           0.
         10.,           0.,           0.,          10.,           0.,           1.,          90.
*End Instance
*Node
      1,           0.,           5.,           9.
*Nset, nset=_PickedSet4, internal
 1,
*Nset, nset="Fixed end", instance=Block-1
 1, 2, 3, 4
*Nset, nset=edge, instance=Block-1
 9, 10
*Elset, elset=_Side_S3, internal, instance=Block-1, generate
 1,  2,  1
*Elset, elset=_Side_S4, internal, instance=Block-1
 2,
*Surface, type=ELEMENT, name=Side
_SIDE_S3, S3
_Side_S4, S4
*Surface, type=ELEMENT, name=Top
Block-1.Upper, S2
*Surface, type=NODE, name=Corners
Fixed end, 1.
*Element, type=MASS, elset=mass
9, 1
*End Assembly
*Material, name=Steel
*Elastic
210000., 0.3
"""


def test_input_of_an_assembly(tmp_path):
    """A part that stands in an assembly, moved and turned: sets of the instance, surfaces of faces, no internal set."""
    path = tmp_path / "Job-1.inp"
    path.write_text(CAE)
    mesh = build_mesh(body_with(MeshSpec(file=str(path)), clamp=["Fixed end", "edge"]))
    assert sorted(mesh.groups) == ["Corners", "Fixed end", "Side", "Top", "Whole"] and list(mesh.curves) == ["edge"]
    assert {name: len(cells) for name, cells in mesh.surfaces.items()} == {"Lower": 6, "Upper": 6}
    assert mesh.cut == 2 and mesh.measures().sum() == pytest.approx(2.0)
    assert mesh.points.min(axis=0) == pytest.approx([9.0, 0.0, 0.0])  # a quarter turn about x = 10, y = 0
    assert mesh.points.max(axis=0) == pytest.approx([10.0, 1.0, 2.0])
    areas = {name: facet_measures(mesh.points[facets]).sum() for name, facets in mesh.groups.items()}
    assert areas == pytest.approx({"Corners": 1.0, "Fixed end": 1.0, "Side": 3.0, "Top": 1.0, "Whole": 10.0})
    assert np.all(mesh.points[mesh.groups["Top"], 2] == 2.0)


FACES = {
    "C3D4": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 1]], [0.5, 0.5, 3**0.5 / 2, 0.5]),
    "C3D6": ([[0, 0, 0], [1, 0, 0], [0, 1, 0], [0, 0, 2], [1, 0, 2], [0, 1, 2]], [0.5, 0.5, 2.0, 8**0.5, 2.0]),
    "C3D5": ([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0], [0, 0, 1]], [2.0, 0.5, 2**0.5, 5**0.5 / 2, 1.0]),
    "C3D8I": ([[0, 0, 0], [1, 0, 0], [1, 2, 0], [0, 2, 0], [0, 0, 3], [1, 0, 3], [1, 2, 3], [0, 2, 3]],
              [2.0, 2.0, 3.0, 6.0, 3.0, 6.0]),
    "CAX3": ([[0, 0], [3, 0], [0, 4]], [3.0, 5.0, 4.0]),
    "CPE4": ([[0, 0], [3, 0], [3, 4], [0, 5]], [3.0, 4.0, 10**0.5, 5.0])}
"""An element of each kind: its nodes, and how large its faces S1, S2, … are."""


@pytest.mark.parametrize("kind", FACES)
def test_faces_of_elements(tmp_path, kind):
    """Faces of elements in surfaces are numbered as Abaqus and CalculiX do, in the plane and in space."""
    (points, sizes), path = FACES[kind], tmp_path / "one.inp"
    lines = ["*NODE", *(", ".join(map(str, (10 * k, *at))) for k, at in enumerate(points, 1)), f"*ELEMENT, TYPE={kind}",
             ", ".join(map(str, [7, *(10 * k for k in range(1, len(points) + 1))]))]
    for k in range(1, len(sizes) + 1):
        lines += [f"*SURFACE, NAME=face{k}", f"7, S{k}"]
    path.write_text("\n".join(lines))
    mesh = read_mesh(path, "upper")
    assert {name: facet_measures(mesh.points[own]).sum() for name, own in mesh.groups.items()} == pytest.approx(
        {f"face{k}": size for k, size in enumerate(sizes, 1)})


def test_sets_of_sets_and_parts_of_a_file(tmp_path):
    """Sets may name others, be continued, and be spelt in any case; what is included belongs to the file."""
    path = write_inp(tmp_path / "square.inp", "CPS3", more="*NSET, NSET=rim\nBottom, RIGHT\ntop\n*NSET, NSET=Rim\nleft")
    whole = tmp_path / "whole.inp"
    whole.write_text("*INCLUDE,\nINPUT=square.inp\n*ELSET, ELSET=one\n1\n*ELSET, ELSET=two\none,\n2,")
    mesh = read_mesh(whole, "upper")
    assert length(mesh, "rim") == pytest.approx(4.0)
    assert {name: sorted(own.tolist()) for name, own in mesh.surfaces.items()} == {"volume": [0, 1], "one": [0],
                                                                                   "two": [0, 1]}
    same_square(Mesh(mesh.points, mesh.triangles, {name: mesh.groups[name] for name in NAMES}))
    assert path.exists()


def test_input_of_gmsh(tmp_path):
    """gmsh writes lines as trusses, and physical groups as sets of elements; nodes of the groups add nothing."""
    with gmsh_session():
        surface = gmsh.model.occ.addRectangle(0, 0, 0, 1, 1)
        gmsh.model.occ.synchronize()
        for curve, name in zip((1, 2, 3, 4), NAMES, strict=True):
            gmsh.model.addPhysicalGroup(1, [curve], name=name)
        gmsh.model.addPhysicalGroup(2, [surface], name="volume")
        gmsh.option.setNumber("Mesh.SaveGroupsOfNodes", 1)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "square.inp"))
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
    ("*ELEMENT, TYPE=CPS3\n9, 1, 2, 77", "that can be read: an element has node 77, which is not there"),
    ("*ELEMENT, TYPE=CPS3\n9, 1, 2", "that can be read: cannot reshape"),
    ("*ELEMENT, TYPE=UNKNOWN\n9, 1, 2, 3", "that can be read: the element type UNKNOWN is not known"),
    ("*ELEMENT\n9, 1, 2, 3", "that can be read (KeyError 'TYPE')"),
    ("*ELGEN\n9, 1, 2, 3", "that can be read: *ELGEN is not supported; write all nodes and elements"),
    ("*PART, NAME=one\n*END PART\n*PART, NAME=two", "it has several parts; each body needs a file of its own"),
    ("*INSTANCE, NAME=one\n*END INSTANCE\n*INSTANCE, NAME=two", "it has several instances"),
    ("*NSET, NSET=a\nb\n*NSET, NSET=b\na", "the set a contains itself"), ("*ELSET, ELSET=a\nb", "there is no set b"),
    ("*NSET, NSET=a, GENERATE\n1, 999999999999", "the set a has more than 100000000 members"),
    ("*SURFACE, NAME=rim\nvolume", "the surface rim has no face of a triangle; these are S1 to S3"),
    ("*SURFACE, NAME=rim\nvolume, S4", "the surface rim has S4 face of a triangle"),
    ("*INCLUDE, INPUT=none.inp", "No such file"), ("*INCLUDE, INPUT=square.inp", "square.inp includes itself")])
def test_refused_input(tmp_path, monkeypatch, more, words):
    """What cannot be read is refused with the reason."""
    monkeypatch.chdir(tmp_path)
    assert words in refused(write_inp(tmp_path / "square.inp", "CPS3", more=more))


def test_input_without_groups(tmp_path):
    """A mesh without sets has no boundary to clamp."""
    square().write(tmp_path / "square.vtu")
    with pytest.raises(InputError, match="has no named physical groups of lines"):
        read_mesh(tmp_path / "square.vtu", "upper")
