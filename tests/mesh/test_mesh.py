"""Meshes: generated rectangles, mesh files of all versions, and what is refused."""

import dataclasses
import subprocess
import sys
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest
from scenes import LIMIT, run_here, write_scene

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import segments
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh, signed_measures, turn_outward
from ddmpi.mesh.read import file_kind, gmsh_session, read_mesh
from ddmpi.mesh.refine import HALVES as HALVED
from ddmpi.mesh.refine import raise_order, shorter_diagonals
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import BodySpec, Clamp, Material, MeshSpec, PartMaterial, Traction

STEEL = Material(young=2.1e11, poisson=0.3)
SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
SIDES = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
NAMES = ("bottom", "right", "top", "left")


def rectangle(divisions, size=(3.0, 1.0), origin=(0.0, 0.0)) -> Mesh:
    return generate_rectangle(MeshSpec(shape="rectangle", origin=origin, size=size, divisions=divisions))


def write_square(path: Path, *, points=SQUARE, triangles=HALVES, lines=SIDES, tags=(1, 2, 3, 4), names=NAMES,
                 extra=()) -> Path:
    """A hand-made mesh in format 2.2; line i carries the physical tag ``tags[i]``, name i the tag i + 1."""
    cells = [("line", np.asarray(lines)), ("triangle", np.asarray(triangles)), *extra]
    physical = [np.array(tags, int)] + [np.full(len(block), 9) for _, block in cells[1:]]
    groups = {name: np.array([i + 1, 1]) for i, name in enumerate(names)} | {"volume": np.array([9, 2])}
    if points.shape[1] == 2:
        points = np.column_stack([points, np.zeros(len(points))])
    mesh = meshio.Mesh(points, cells, cell_data={"gmsh:physical": physical, "gmsh:geometrical": physical},
                       field_data=groups)
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    return path


def write_by_gmsh(path: Path, version: float, binary: bool = False, lines=None, surfaces=("volume",),
                  order: int = 1) -> Path:
    """The unit square as gmsh meshes and saves it; `lines` are named groups of the numbers of its sides."""
    lines = lines or {name: [i] for i, name in enumerate(NAMES)}
    with gmsh_session():
        geometry = gmsh.model.geo
        corners = [geometry.addPoint(x, y, 0.0, 0.4) for x, y in SQUARE]
        sides = [geometry.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        surface = geometry.addPlaneSurface([geometry.addCurveLoop(sides)])
        geometry.synchronize()
        for name, members in lines.items():
            gmsh.model.addPhysicalGroup(1, [sides[i] for i in members], name=name)
        for name in surfaces:
            gmsh.model.addPhysicalGroup(2, [surface], name=name)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(path))
    return path


def write_parts(path: Path, version: float, order: int = 1, overlap: bool = False, binary: bool = False) -> Path:
    """Two unit squares side by side, surfaces `left part` and `right part`, points `heel`, `middle` and `far off`."""
    with gmsh_session():
        geometry = gmsh.model.geo
        corners = [geometry.addPoint(x, y, 0.0, 0.4) for y in (0.0, 1.0) for x in (0.0, 1.0, 2.0)]
        low, high = ([geometry.addLine(corners[i], corners[i + 1]) for i in (k, k + 1)] for k in (0, 3))
        up = [geometry.addLine(corners[i], corners[i + 3]) for i in range(3)]
        parts = [geometry.addPlaneSurface([geometry.addCurveLoop([low[i], up[i + 1], -high[i], -up[i]])])
                 for i in (0, 1)]
        apart = geometry.addPoint(5.0, 5.0, 0.0, 0.4)
        geometry.synchronize()
        gmsh.model.addPhysicalGroup(1, low, name="bottom")
        for name, surfaces in {"left part": parts[:1], "right part": parts[1:], "all": parts * overlap}.items():
            gmsh.model.addPhysicalGroup(2, surfaces, name=name)
        for name, point in (("heel", corners[0]), ("middle", corners[1]), ("far off", apart)):
            gmsh.model.addPhysicalGroup(0, [point], name=name)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(path))
    return path


def write_quadratic_square(path: Path, moves: dict[int, tuple[float, float]] | None = None) -> Path:
    """The square of two quadratic triangles; node 4 + i is on the middle of side i, node 8 on the diagonal."""
    points = np.vstack([SQUARE, (SQUARE + np.roll(SQUARE, -1, axis=0)) / 2, [[0.5, 0.5]]])
    for node, by in (moves or {}).items():
        points[node] += by
    lines = np.column_stack([SIDES, [4, 5, 6, 7]])
    cells = [("line3", lines), ("triangle6", np.array([[0, 1, 2, 4, 5, 8], [0, 2, 3, 8, 6, 7]]))]
    physical = [np.arange(1, 5), np.full(2, 9)]
    groups = {name: np.array([i + 1, 1]) for i, name in enumerate(NAMES)}
    mesh = meshio.Mesh(np.column_stack([points, np.zeros(len(points))]), cells, field_data=groups,
                       cell_data={"gmsh:physical": physical, "gmsh:geometrical": physical})
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    return path


def area(mesh: Mesh) -> float:
    return float(signed_measures(mesh.points, mesh.triangles).sum())


def length(mesh: Mesh, group: str) -> float:
    ends = mesh.points[mesh.groups[group]]
    return float(np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1).sum())


def refused(path: Path) -> str:
    with pytest.raises(InputError) as error:
        read_mesh(path, "upper")
    text = str(error.value)
    assert text.startswith("body.upper.mesh.file: ")
    assert path.name in text
    return text


def body_with(mesh: MeshSpec, **rest) -> BodySpec:
    return BodySpec(name="upper", mesh=mesh, material=STEEL, **rest)


# Rectangles


@pytest.mark.parametrize(("size", "origin"), [
    ((3.0, 1.0), (0.0, 1.0)), ((1e-9, 2e-9), (0.0, 0.0)), ((1e6, 5e5), (-2e6, 3.0)),
    ((1e-9, 1e6), (1e-9, -5e5)), ((1.0, 1.0), (1e6, -1e6))])
def test_rectangle_keeps_size_and_origin(size, origin):
    mesh = rectangle((5, 4), size, origin)
    corner, (width, height) = np.array(origin), size
    assert mesh.points.min(axis=0) == pytest.approx(corner, rel=1e-15, abs=0.0)
    assert mesh.points.max(axis=0) == pytest.approx(corner + size, rel=1e-15, abs=0.0)
    rounding = (np.abs(mesh.points).max(axis=0) / size).max()  # what the offset costs
    assert rounding < 1e7
    assert area(mesh) == pytest.approx(width * height, rel=1e-14 * (1 + rounding), abs=0.0)
    assert signed_measures(mesh.points, mesh.triangles) == \
        pytest.approx(np.full(40, width * height / 40), rel=1e-14 * (1 + rounding), abs=0.0)
    assert mesh.extent == pytest.approx(np.hypot(*size), rel=1e-9, abs=0.0)


def test_the_extent_of_a_body_does_not_depend_on_the_axes():
    mesh = rectangle((5, 4), (3.0, 2.0), (1.0, -1.0))
    turned = mesh.points @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    assert dataclasses.replace(mesh, points=turned).extent == pytest.approx(np.sqrt(13.0), rel=1e-12)


@pytest.mark.parametrize("divisions", [(1, 1), (1, 3), (3, 1), (2, 2), (66, 22)])
def test_rectangle_is_numbered_as_gmsh_does(divisions):
    """Nodes, triangles and lines of a rectangle have the numbers of gmsh's transfinite surface."""
    with gmsh_session():
        geometry = gmsh.model.geo
        corners = [geometry.addPoint(x, y, 0.0) for x, y in SQUARE]
        sides = [geometry.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
        surface = geometry.addPlaneSurface([geometry.addCurveLoop(sides)])
        for side, parts in zip(sides, 2 * divisions, strict=True):
            geometry.mesh.setTransfiniteCurve(side, parts + 1)
        geometry.mesh.setTransfiniteSurface(surface, "Right")
        geometry.synchronize()
        gmsh.model.mesh.generate(2)
        tags, points, _ = gmsh.model.mesh.getNodes()
        triangles = gmsh.model.mesh.getElementsByType(2)[1].reshape(-1, 3)
        lines = [gmsh.model.mesh.getElementsByType(1, side)[1].reshape(-1, 2) for side in sides]
    mesh = rectangle(divisions, (1.0, 1.0))
    assert np.array_equal(tags, np.arange(1, len(tags) + 1))
    assert mesh.points == pytest.approx(points.reshape(-1, 3)[:, :2], rel=0.0, abs=1e-10)
    assert np.array_equal(mesh.triangles + 1, triangles)
    for name, expected in zip(NAMES, lines, strict=True):
        assert np.array_equal(mesh.groups[name] + 1, expected)


def test_rectangles_above_each_other_share_coordinates_exactly():
    lower, upper = rectangle((37, 5), (3.0, 1.0), (0.1, 0.0)), rectangle((37, 3), (3.0, 0.7), (0.1, 1.0))
    x_lower, x_upper = (np.sort(m.points[np.unique(m.groups[name]), 0])
                        for m, name in ((lower, "top"), (upper, "bottom")))
    assert np.array_equal(x_lower, x_upper)


# Files


@pytest.mark.parametrize("binary", [False, True])
@pytest.mark.parametrize("version", [2.2, 4.1])
def test_gmsh_file_is_read(tmp_path, version, binary):
    mesh = read_mesh(write_by_gmsh(tmp_path / "square.msh", version, binary), "upper")
    assert area(mesh) == pytest.approx(1.0, rel=1e-13, abs=0.0)
    assert np.all(signed_measures(mesh.points, mesh.triangles) > 0)
    assert set(mesh.groups) == set(NAMES)
    for name, component, value in (("left", 0, 0.0), ("right", 0, 1.0), ("bottom", 1, 0.0), ("top", 1, 1.0)):
        assert np.all(mesh.points[mesh.groups[name], component] == value)
        assert length(mesh, name) == pytest.approx(1.0, rel=1e-13, abs=0.0)


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_line_in_two_groups_counts_in_both(tmp_path, version):
    lines = {"bottom": [0], "left": [3], "lower corner": [0, 3], "rim": [0, 1, 2, 3]}
    mesh = read_mesh(write_by_gmsh(tmp_path / "square.msh", version, lines=lines), "upper")
    assert {name: round(length(mesh, name), 12) for name in mesh.groups} == \
        {"bottom": 1.0, "left": 1.0, "lower corner": 2.0, "rim": 4.0}


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_surface_in_two_groups_counts_once(tmp_path, version):
    path = write_by_gmsh(tmp_path / "square.msh", version, surfaces=("volume", "steel"))
    assert area(read_mesh(path, "upper")) == pytest.approx(1.0, rel=1e-13, abs=0.0)


OLD = {"1.0": dict(zip(NAMES, "1234", strict=True)), "4.0": dict(zip(NAMES, NAMES, strict=True))}
"""Versions that meshio cannot read, with the names that the groups have in them: MSH 1.0 keeps only numbers."""


@pytest.mark.parametrize("version", OLD)
def test_old_file_is_read_through_gmsh(tmp_path, version):
    """A file of an old version gives the same mesh as one of MSH 4.1."""
    path = write_by_gmsh(tmp_path / "old.msh", float(version))
    with pytest.raises(Exception):  # noqa: B017
        meshio.gmsh.read(path)
    old = read_mesh(path, "upper")
    new = read_mesh(write_by_gmsh(tmp_path / "new.msh", 4.1), "upper")
    assert np.array_equal(old.points[old.triangles], new.points[new.triangles])
    assert set(old.groups) == set(OLD[version].values())
    for name, number in OLD[version].items():
        assert np.array_equal(old.points[old.groups[number]], new.points[new.groups[name]])


@pytest.mark.parametrize("version", OLD)
def test_line_in_two_groups_of_an_old_file_counts_once_in_each(tmp_path, version):
    """Old versions repeat a line for each of its groups; a traction on such a group acts once."""
    lines = {"bottom": [0], "lower corner": [0, 3], "rim": [0, 1, 2, 3]}
    mesh = read_mesh(write_by_gmsh(tmp_path / "old.msh", float(version), lines=lines), "upper")
    assert sorted(round(length(mesh, name), 12) for name in mesh.groups) == [1.0, 2.0, 4.0]


@pytest.mark.parametrize("version", OLD)
@pytest.mark.parametrize("cut", [40, 400])
def test_truncated_old_file(tmp_path, version, cut):
    """An old file that is cut short is refused; the message gives its name, and gmsh's reason."""
    path = write_by_gmsh(tmp_path / "old.msh", float(version))
    path.write_text(path.read_text()[:-cut])
    text = refused(path)
    assert "is not a mesh that meshio or gmsh can read" in text and "gmsh: " in text


@pytest.mark.parametrize("version, binary", [(2.2, False), (2.2, True), (4.0, False), (4.1, False), (4.1, True)])
@pytest.mark.parametrize("order", [1, 2])
def test_surfaces_and_points_of_a_file_are_kept(tmp_path, version, binary, order):
    """Physical surfaces and points of a file are known by their names; halves and order 2 keep them."""
    path = write_parts(tmp_path / "parts.msh", version, order, overlap=True, binary=binary)
    for refine, quadratic in ((0, 1), (1, 2)):
        mesh = build_mesh(body_with(MeshSpec(file=str(path), refine=refine, order=quadratic)))
        middles = mesh.points[mesh.triangles[:, :3]].mean(axis=1)
        assert set(mesh.surfaces) == {"left part", "right part", "all"}
        assert np.array_equal(np.sort(mesh.surfaces["left part"]), np.flatnonzero(middles[:, 0] < 1.0))
        assert np.array_equal(np.sort(mesh.surfaces["right part"]), np.flatnonzero(middles[:, 0] > 1.0))
        assert np.array_equal(np.sort(mesh.surfaces["all"]), np.arange(len(mesh.triangles)))
        assert {name: mesh.points[nodes].tolist() for name, nodes in mesh.vertices.items()} == \
            {"heel": [[0.0, 0.0]], "middle": [[1.0, 0.0]], "far off": []}


@pytest.mark.parametrize("version, binary", [(2.2, False), (4.0, False), (4.1, False), (4.1, True)])
def test_a_name_of_two_dimensions_is_refused(tmp_path, version, binary):
    """A file of gmsh with one name for a curve and a surface is refused: one of them would be lost."""
    path = write_by_gmsh(tmp_path / "twice.msh", version, binary, surfaces=("volume", "left"))
    with pytest.raises(InputError, match=r"^body\.upper\.mesh\.file: .*twice\.msh: 'left' is the name of both a "
                                         r"physical curve and a physical surface; rename one$"):
        build_mesh(body_with(MeshSpec(file=str(path))))


def test_points_may_be_clamped_only(tmp_path):
    """A body may be clamped on its mesh file's points, if they are nodes of triangles, and not loaded there."""
    mesh = MeshSpec(file=str(write_parts(tmp_path / "parts.msh", 4.1)))
    build_mesh(body_with(mesh, clamp=["heel", Clamp(on="middle", y=0.0)]))
    with pytest.raises(InputError, match=r"^body\.upper\.clamp: the physical point 'far off' of the mesh is at none"):
        build_mesh(body_with(mesh, clamp=["far off"]))
    with pytest.raises(InputError, match=r"^body\.upper\.traction: 'heel' is a physical point .*only a clamp"):
        build_mesh(body_with(mesh, traction=[Traction(on="heel", value=(0.0, 1.0))]))
    with pytest.raises(InputError, match=r"^body\.upper\.clamp: 'left part' is a physical surface .* these are bottom"):
        build_mesh(body_with(mesh, clamp=["left part"]))


def test_a_clamp_holds_all_of_a_name():
    """A set of nodes may be a side and a node beside it: a clamp holds both, a load acts on the side."""
    mesh = generate_rectangle(MeshSpec(shape="rectangle", size=(2.0, 1.0), divisions=(2, 1)))
    twice = Mesh(mesh.points, mesh.triangles, mesh.groups, {"left": np.array([1])})
    assert len(mesh.nodes_of("left")) == 2
    assert twice.nodes_of("left").tolist() == [0, 1, 3]
    assert len(twice.facets("left").nodes) == 1


def test_materials_are_those_of_the_files_surfaces(tmp_path):
    """Materials that leave a surface of the file out are refused when the mesh is read."""
    def body(*names: str) -> BodySpec:
        return BodySpec(name="upper", mesh=MeshSpec(file=str(path)),
                        material=[PartMaterial(on=name, young=1.0, poisson=0.3) for name in names])

    path = write_parts(tmp_path / "parts.msh", 4.1)
    build_mesh(body("left part", "right part"))
    with pytest.raises(InputError, match=r"^body\.upper\.material: the triangle at .* surface 'right part', has no"):
        build_mesh(body("left part"))


def test_signals_are_heard_after_gmsh(tmp_path):
    """Signals are noted after gmsh has read a file, though the PETSc within gmsh resets the handler of SIGTERM."""
    path = write_by_gmsh(tmp_path / "old.msh", 4.0)
    code = """
import os, pathlib, signal, sys
from ddmpi.mesh.read import read_mesh
from ddmpi.system import interrupt
signal.signal(signal.SIGINT, signal.SIG_DFL)  # where it is ignored, it stays so
interrupt.listen()
read_mesh(pathlib.Path(sys.argv[1]), "upper")
for number in interrupt.SIGNALS:
    os.kill(os.getpid(), number)
print(*sorted(interrupt._received))
"""
    child = subprocess.run([sys.executable, "-c", code, path], capture_output=True, text=True, timeout=LIMIT)
    assert (child.returncode, child.stdout) == (0, "SIGINT SIGTERM SIGUSR1\n"), child.stderr


def test_hand_made_file_is_read(tmp_path):
    mesh = read_mesh(write_square(tmp_path / "square.msh", tags=(1, 1, 2, 3), names=NAMES[:3]), "upper")
    assert np.array_equal(mesh.points, SQUARE)
    assert np.array_equal(mesh.triangles, HALVES)
    assert {name: edges.tolist() for name, edges in mesh.groups.items()} == \
        {"bottom": [[0, 1], [1, 2]], "right": [[2, 3]], "top": [[3, 0]]}


def test_clockwise_triangles_are_turned(tmp_path):
    mesh = read_mesh(write_square(tmp_path / "square.msh", triangles=[[0, 2, 1], [0, 2, 3]]), "upper")
    assert signed_measures(mesh.points, mesh.triangles) == pytest.approx([0.5, 0.5])
    assert [sorted(t) for t in mesh.triangles.tolist()] == HALVES.tolist()


def test_unused_points_are_dropped(tmp_path):
    points = np.vstack([[[7.0, 7.0]], SQUARE[:2], [[8.0, 8.0]], SQUARE[2:], [[9.0, 9.0]]])
    number = np.array([1, 2, 4, 5])
    mesh = read_mesh(write_square(tmp_path / "square.msh", points=points, triangles=number[HALVES],
                                  lines=number[SIDES]), "upper")
    assert np.array_equal(mesh.points, SQUARE)
    assert np.array_equal(mesh.triangles, HALVES)
    assert np.array_equal(np.vstack([mesh.groups[name] for name in NAMES]), SIDES)


@pytest.mark.parametrize("scale", [1e-9, 1e6])
def test_file_of_any_size_is_read(tmp_path, scale):
    mesh = read_mesh(write_square(tmp_path / "square.msh", points=scale * (SQUARE + 3.0)), "upper")
    assert area(mesh) == pytest.approx(scale**2, rel=1e-12, abs=0.0)


# Order 2


@pytest.mark.parametrize("divisions", [(1, 1), (5, 3)])
def test_middles_of_sides_become_nodes(divisions):
    linear = rectangle(divisions)
    mesh = raise_order(linear, "mesh")
    assert (linear.order, mesh.order, mesh.dimension) == (1, 2, 2)
    (nx, ny), corners = divisions, len(linear.points)
    assert len(mesh.points) == (2 * nx + 1) * (2 * ny + 1)
    assert np.array_equal(mesh.points[:corners], linear.points)
    assert np.array_equal(mesh.triangles[:, :3], linear.triangles)
    ends = mesh.points[linear.triangles]
    assert np.array_equal(mesh.points[mesh.triangles[:, 3:]], (ends + np.roll(ends, -1, axis=1)) / 2)
    assert np.array_equal(np.unique(mesh.triangles[:, 3:]), np.arange(corners, len(mesh.points)))
    for name, edges in linear.groups.items():
        assert np.array_equal(mesh.groups[name][:, :2], edges)
        assert np.array_equal(mesh.points[mesh.groups[name][:, 2]], mesh.points[edges].mean(axis=1))


def test_order_of_the_scene_is_that_of_the_mesh(tmp_path):
    square = MeshSpec(shape="rectangle", size=(1.0, 1.0), divisions=(2, 2), order=2)
    assert build_mesh(body_with(square, clamp=["left"])).triangles.shape == (8, 6)
    write_square(tmp_path / "square.msh")
    for order, nodes in ((1, 4), (2, 9)):
        mesh = build_mesh(body_with(MeshSpec(file="square.msh", order=order)), tmp_path)
        assert (len(mesh.points), mesh.groups["left"].shape[1]) == (nodes, order + 1)


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_second_order_file_gives_its_corners(tmp_path, version):
    linear = read_mesh(write_by_gmsh(tmp_path / "linear.msh", version), "upper")
    mesh = read_mesh(write_by_gmsh(tmp_path / "quadratic.msh", version, order=2), "upper")
    assert np.array_equal(mesh.points, linear.points)
    assert np.array_equal(mesh.triangles, linear.triangles)
    assert all(np.array_equal(mesh.groups[name], linear.groups[name]) for name in NAMES)


@pytest.mark.parametrize("version, binary", [(1.0, False), (2.2, False), (2.2, True), (4.0, False), (4.1, True)])
def test_order_of_a_file(tmp_path, version, binary):
    """The order of a mesh file is known for every version of the format."""
    for order in (1, 2):
        path = write_by_gmsh(tmp_path / f"{order}.msh", version, binary, order=order)
        assert file_kind(path, "upper") == (2, order)


def test_a_scene_is_solved_with_the_elements_of_its_files(tmp_path):
    """A second-order file is solved with quadratic elements, and shapes follow, unless the scene names an order."""
    write_by_gmsh(tmp_path / "lower.msh", 2.2, order=2)
    material = {"young": 2.1e11, "poisson": 0.3}
    scene = {"body": [{"name": "upper", "material": material, "clamp": [{"on": "top", "x": 0.0, "y": -1e-4}],
                       "mesh": {"shape": "rectangle", "origin": [0.0, 1.0], "size": [1.0, 1.0], "divisions": [3, 3]}},
                      {"name": "lower", "material": material, "clamp": ["bottom"], "mesh": {"file": "lower.msh"}}],
             "contact": [{"bodies": ["upper", "lower"], "on": ["bottom", "top"]}], "output": {"figures": False}}
    path = write_scene(scene, tmp_path / "scene.toml")
    quadratic = run_here(path, tmp_path / "quadratic")
    assert quadratic.code == 0, quadratic.output
    assert quadratic.summary["order"] == 2 and quadratic.summary["contacts"]["upper-lower"]["m"] == 7
    assert [body["mesh"]["order"] for body in quadratic.summary["scene"]["body"]] == [2, 2]
    linear = run_here(path, tmp_path / "linear", "--set", "body.upper.mesh.order=1")
    assert linear.summary["order"] == 1 and linear.summary["contacts"]["upper-lower"]["m"] == 4
    (tmp_path / "lower.msh").unlink()
    missing = run_here(path, tmp_path / "missing")
    assert missing.code == 2 and len(missing.messages) == 1
    assert f"{path}: body.lower.mesh.file: there is no file" in missing.messages[0]


def test_second_order_file_by_hand(tmp_path):
    mesh = read_mesh(write_quadratic_square(tmp_path / "square.msh", {4: (1e-9, 0.0)}), "upper")
    assert np.array_equal(mesh.points, SQUARE)
    assert np.array_equal(mesh.triangles, HALVES)
    assert np.array_equal(np.vstack([mesh.groups[name] for name in NAMES]), SIDES)


def test_group_across_triangles_has_no_middles(tmp_path):
    path = write_square(tmp_path / "square.msh", lines=[*SIDES.tolist(), [1, 3]], tags=(1, 2, 3, 4, 5),
                        names=(*NAMES, "across"))
    assert len(read_mesh(path, "upper").points) == 4
    with pytest.raises(InputError, match=r"body\.upper\.mesh: .*'across' has lines that are not sides"):
        build_mesh(body_with(MeshSpec(file=str(path), order=2)))


def test_edges_are_turned_and_walked():
    mesh = raise_order(rectangle((2, 1)), "mesh")
    edges = mesh.groups["top"].copy()
    edges[0] = edges[0][[1, 0, 2]]
    turned, *_ = turn_outward(mesh, edges)
    assert (np.diff(mesh.points[turned][:, :2, 0], axis=1) < 0).all()  # the body lies to the left
    assert np.array_equal(turned[:, 2], edges[:, 2])
    steps = mesh.points[segments(turned)]
    assert steps[:, 1] - steps[:, 0] == pytest.approx(np.tile([-0.75, 0.0], (4, 1)))


# Refusals


def test_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"body\.upper\.mesh\.file: there is no file .*absent\.msh"):
        build_mesh(body_with(MeshSpec(file="absent.msh")), tmp_path)


@pytest.mark.parametrize("content", ["", "not a mesh\n", "$MeshFormat\n9.9 0 8\n$EndMeshFormat\n"])
def test_file_that_is_not_a_mesh(tmp_path, content):
    path = tmp_path / "notes.msh"
    path.write_text(content)
    assert "is not a mesh that meshio or gmsh can read" in refused(path)


@pytest.mark.parametrize("version", [2.2, 4.1])
def test_truncated_file(tmp_path, version):
    path = write_by_gmsh(tmp_path / "square.msh", version)
    path.write_text(path.read_text()[:-400])
    refused(path)


def test_a_file_without_nodes(tmp_path):
    """A section of nodes that has another name is not read; the file is refused, not its elements misread."""
    path = write_by_gmsh(tmp_path / "square.msh", 2.2)
    path.write_text(path.read_text().replace("$Nodes", "$Nodez"))
    assert "is not a mesh that meshio or gmsh can read" in refused(path)


def test_quadrilaterals_are_cut_along_the_shorter_diagonal(tmp_path):
    """Quadrilaterals of a file are cut into triangles, whatever the order of their corners, convex or not."""
    points = np.array([[0, 0], [1, 0], [1, 1], [0, 1], [2, 0], [3, 0.2], [2, 1], [4, -5], [4.5, 1], [4.2, 0],
                       [3.9, 1]], float)
    quads = [[0, 1, 2, 3], [1, 4, 6, 2], [4, 5, 6, 2], [7, 8, 9, 10]]  # two squares, a kite, one with an inner corner
    expected = {(0, 1, 2), (0, 2, 3), (1, 4, 6), (1, 2, 6), (4, 5, 6), (2, 4, 6), (7, 8, 9), (7, 9, 10)}
    for turn in range(4):
        for way in (1, -1):
            turned = np.roll(quads, turn, axis=1)[:, ::way]
            parts = HALVED[shorter_diagonals(points, turned)]
            triangles = np.take_along_axis(turned[:, None], parts, axis=2).reshape(-1, 3)
            assert {tuple(sorted(each)) for each in triangles.tolist()} == expected, (turn, way)


@pytest.mark.parametrize("order", [1, 2])
def test_quadrilaterals_of_a_file(tmp_path, order):
    """A file of quadrilaterals of either order gives the mesh of a rectangle, and says how many were cut."""
    path = tmp_path / "quads.msh"
    with gmsh_session():
        surface = gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 3.0, 1.0)
        gmsh.model.occ.synchronize()
        for curve, name in zip((1, 2, 3, 4), NAMES, strict=True):
            gmsh.model.addPhysicalGroup(1, [curve], name=name)
            gmsh.model.mesh.setTransfiniteCurve(curve, 7 if curve % 2 else 4)
        gmsh.model.addPhysicalGroup(2, [surface], name="plate")
        gmsh.model.mesh.setTransfiniteSurface(surface)
        gmsh.model.mesh.setRecombine(2, surface)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(path))
    mesh, expected = read_mesh(path, "upper"), rectangle((6, 3))
    assert (mesh.cut, mesh.order, file_kind(path, "upper")) == (18, 1, (2, order))

    def places(each):
        return {frozenset(map(tuple, np.round(each.points[t], 9).tolist())) for t in each.triangles}
    assert places(mesh) == places(expected)
    assert np.all(signed_measures(mesh.points, mesh.triangles) > 0)
    spec = body_with(MeshSpec(file=str(path), refine=1, order=2))
    assert build_mesh(spec).cut == 18


@pytest.mark.parametrize(("complete", "version"), [(True, 4.1), (False, 2.2)])
def test_curved_quadrilaterals_of_a_file(tmp_path, complete, version):
    """A quarter of two rings, of nine- or eight-node quadrilaterals: curved along circles, each with its surface."""
    path = tmp_path / "rings.msh"
    with gmsh_session():
        geo, centre = gmsh.model.geo, gmsh.model.geo.addPoint(0.0, 0.0, 0.0)
        ends = [(geo.addPoint(r, 0.0, 0.0), geo.addPoint(0.0, r, 0.0)) for r in (0.5, 0.75, 1.0)]
        arcs = [geo.addCircleArc(a, centre, b) for a, b in ends]
        for inner, name in enumerate(("soft", "hard")):
            (a, b), (c, d) = ends[inner:inner + 2]
            lines = geo.addLine(a, c), geo.addLine(b, d)
            surface = geo.addPlaneSurface([geo.addCurveLoop([lines[0], arcs[inner + 1], -lines[1], -arcs[inner]])])
            for curves, number in (((arcs[inner], arcs[inner + 1]), 7), (lines, 3)):
                for curve in curves:
                    geo.mesh.setTransfiniteCurve(curve, number)
            geo.mesh.setTransfiniteSurface(surface)
            geo.mesh.setRecombine(2, surface)
            geo.addPhysicalGroup(2, [surface], name=name)
        geo.addPhysicalGroup(1, [arcs[2]], name="outer")
        geo.synchronize()
        gmsh.model.mesh.generate(2)
        gmsh.option.setNumber("Mesh.SecondOrderIncomplete", 0 if complete else 1)
        gmsh.model.mesh.setOrder(2)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.write(str(path))
    mesh = build_mesh(body_with(MeshSpec(file=str(path), order=2)))
    assert (mesh.cut, len(mesh.triangles), len(mesh.curved)) == (24, 48, 24)  # inner sides are straight
    for name, radii in (("soft", (0.5, 0.75)), ("hard", (0.75, 1.0))):
        ring = np.pi / 4 * (radii[1]**2 - radii[0]**2)
        assert mesh.measures()[mesh.surfaces[name]].sum() == pytest.approx(ring, rel=3e-5)
    outer = mesh.groups["outer"]
    assert np.linalg.norm(mesh.points[outer], axis=2) == pytest.approx(1.0, abs=1e-9)


def test_third_order_triangles(tmp_path):
    text = refused(write_by_gmsh(tmp_path / "cubic.msh", 4.1, order=3))
    assert "elements of type line4, triangle10" in text


@pytest.mark.parametrize("moved, by", [(4, (0.01, 0.01)), (8, (0.01, 0.01)), (4, (0.1, 0.0))])
def test_curved_triangles(tmp_path, moved, by):
    """The middle of a side on the boundary, that of the diagonal, and one that is off along its side, stay there."""
    path = write_quadratic_square(tmp_path / "curved.msh", {moved: by})
    assert np.array_equal(read_mesh(path, "upper").points, SQUARE)
    mesh, bottom = read_mesh(path, "upper", 2), np.array([0.5, 0.0]) if moved == 4 else np.array([0.5, 0.5])
    middle = mesh.groups[NAMES[0]][0, 2] if moved == 4 else mesh.triangles[0, 5]
    assert mesh.points[middle] == pytest.approx(bottom + by, rel=1e-15)
    assert len(mesh.curved) == (1 if moved == 4 else 2)


def test_no_triangles(tmp_path):
    path = write_square(tmp_path / "lines.msh", triangles=np.empty((0, 3), int))
    text = refused(path)
    assert "has neither triangles nor tetrahedra" in text and 'Physical Surface("' in text


def test_no_named_boundaries(tmp_path):
    text = refused(write_square(tmp_path / "square.msh", names=()))
    assert "no named physical groups of lines" in text and 'Physical Curve("' in text


def test_triangle_without_area(tmp_path):
    points = np.vstack([SQUARE, [[0.5, 0.0]]])
    path = write_square(tmp_path / "flat.msh", points=points, triangles=[[0, 1, 2], [0, 2, 3], [0, 4, 1]])
    assert "triangles without area" in refused(path)


def test_folded_triangles(tmp_path):
    """Refused where a node lies across its neighbours, and where a part lies on another one; not where a part is
    mirrored, which turns its triangles."""
    fan = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
    inside, outside = (np.vstack([SQUARE, [at]]) for at in ([0.5, 0.5], [0.5, 1.5]))
    mirrored = write_square(tmp_path / "mirrored.msh", points=inside, triangles=[each[::-1] for each in fan])
    assert area(read_mesh(mirrored, "upper")) == pytest.approx(1.0)
    folded = write_square(tmp_path / "folded.msh", points=outside, triangles=fan)
    assert "has triangles that overlap at (" in refused(folded)
    twice = write_square(tmp_path / "twice.msh", points=np.vstack([inside, [[0.5, 0.8]]]), triangles=[*fan, [0, 1, 5]])
    assert "has triangles that overlap at (0.5, 0)" in refused(twice)


def test_coordinates_that_are_no_numbers(tmp_path):
    points = SQUARE.copy()
    points[2, 0] = np.nan
    refused(write_square(tmp_path / "nan.msh", points=points))


def test_mesh_in_space(tmp_path):
    points = np.column_stack([SQUARE, [0.0, 0.1, 0.0, 0.0]])
    assert "is not plane" in refused(write_square(tmp_path / "space.msh", points=points))


def test_line_without_triangle(tmp_path):
    points = np.vstack([SQUARE, [[2.0, 2.0]]])
    path = write_square(tmp_path / "square.msh", points=points, lines=[[0, 1], [1, 2], [2, 3], [3, 4]])
    assert "belong to no triangle" in refused(path)


@pytest.mark.parametrize(("rest", "key"), [
    ({"clamp": ["botom"]}, "clamp"),
    ({"clamp": ["left", Clamp(on="botom", x=0.0)]}, "clamp"),
    ({"traction": [Traction(on="botom", value=(1.0, 0.0))]}, "traction")])
def test_group_that_the_mesh_does_not_have(tmp_path, rest, key):
    write_square(tmp_path / "square.msh")
    for spec in (MeshSpec(file="square.msh"), MeshSpec(shape="rectangle", size=(1.0, 1.0), divisions=(1, 1))):
        with pytest.raises(InputError) as error:
            build_mesh(body_with(spec, **rest), tmp_path)
        assert str(error.value).startswith(f"body.upper.{key}: the mesh has no boundary group 'botom'")
        assert "bottom, left, right, top" in str(error.value)


def test_group_without_lines(tmp_path):
    """A name that gmsh kept but whose lines it did not save must not clamp or load nothing in silence."""
    write_square(tmp_path / "square.msh", tags=(1, 1, 1, 1))
    with pytest.raises(InputError, match="right"):
        build_mesh(body_with(MeshSpec(file="square.msh"), clamp=["right"]), tmp_path)


def test_boundary_group():
    mesh = rectangle((2, 1))
    assert np.array_equal(mesh.facets("left").nodes, mesh.groups["left"])
    assert mesh.facets("left") is mesh.facets("left")  # resolved once
    with pytest.raises(InputError, match=r"^the mesh has no boundary group 'lft'; did you mean 'left'\?"):
        mesh.facets("lft")


def test_file_is_looked_for_next_to_the_scene_first(tmp_path, monkeypatch):
    near, here = tmp_path / "near", tmp_path / "here"
    near.mkdir()
    here.mkdir()
    write_square(near / "square.msh")
    write_square(here / "square.msh", points=2 * SQUARE)
    write_square(here / "other.msh", points=3 * SQUARE)
    monkeypatch.chdir(here)
    assert build_mesh(body_with(MeshSpec(file="square.msh")), near).extent == pytest.approx(np.sqrt(2))
    assert build_mesh(body_with(MeshSpec(file="other.msh")), near).extent == pytest.approx(3 * np.sqrt(2))
    absolute = str(here / "square.msh")
    assert build_mesh(body_with(MeshSpec(file=absolute)), near).extent == pytest.approx(2 * np.sqrt(2))
