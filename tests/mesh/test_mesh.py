"""Meshes: generated rectangles, mesh files of all versions, and what is refused."""

import dataclasses
import re
import subprocess
import sys
from pathlib import Path

import gmsh
import meshio
import numpy as np
import pytest
from scenes import LIMIT

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import segments
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.mesh import Mesh, signed_measures, turn_outward
from ddmpi.mesh.read import gmsh_session, read_mesh
from ddmpi.mesh.refine import HALVES as HALVED
from ddmpi.mesh.refine import halve, raise_order, shorter_diagonals
from ddmpi.mesh.shapes import generate_rectangle
from ddmpi.scene.bodies import MeshSpec
from meshes import body_of

SQUARE = np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])
HALVES = np.array([[0, 1, 2], [0, 2, 3]])
SIDES = np.array([[0, 1], [1, 2], [2, 3], [3, 0]])
NAMES = ("bottom", "right", "top", "left")


def rectangle(divisions, size=(3.0, 1.0), origin=(0.0, 0.0)) -> Mesh:
    return generate_rectangle(
        MeshSpec(shape="rectangle", origin=origin, size=size, divisions=divisions)
    )


def write_square(
    path: Path, *, points=SQUARE, triangles=HALVES, lines=SIDES, tags=(1, 2, 3, 4), names=NAMES
) -> Path:
    """A hand-made mesh in format 2.2; line i carries the physical tag ``tags[i]``, name i the tag i + 1. With lines of
    three nodes and triangles of six, elements of order 2."""
    lines, triangles = np.asarray(lines), np.asarray(triangles)
    cells = [
        ("line" if lines.shape[1] == 2 else "line3", lines),
        ("triangle" if triangles.shape[1] == 3 else "triangle6", triangles),
    ]
    physical = [np.array(tags, int), np.full(len(triangles), 9)]
    groups = {name: np.array([i + 1, 1]) for i, name in enumerate(names)} | {
        "volume": np.array([9, 2])
    }
    points = np.pad(points, ((0, 0), (0, 3 - points.shape[1])))
    mesh = meshio.Mesh(
        points,
        cells,
        cell_data={"gmsh:physical": physical, "gmsh:geometrical": physical},
        field_data=groups,
    )
    meshio.write(path, mesh, file_format="gmsh22", binary=False)
    return path


def draw_square(size: float) -> tuple[list[int], int]:
    """The sides and the surface of the unit square in gmsh's own kernel."""
    geometry = gmsh.model.geo
    corners = [geometry.addPoint(x, y, 0.0, size) for x, y in SQUARE]
    sides = [geometry.addLine(corners[i], corners[(i + 1) % 4]) for i in range(4)]
    return sides, geometry.addPlaneSurface([geometry.addCurveLoop(sides)])


def write_by_gmsh(
    path: Path, version: float, binary: bool = False, surfaces=("volume",), order: int = 1
) -> Path:
    """The unit square as gmsh meshes and saves it."""
    with gmsh_session():
        sides, surface = draw_square(0.4)
        gmsh.model.geo.synchronize()
        for name, side in zip(NAMES, sides, strict=True):
            gmsh.model.addPhysicalGroup(1, [side], name=name)
        for name in surfaces:
            gmsh.model.addPhysicalGroup(2, [surface], name=name)
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.option.setNumber("Mesh.MshFileVersion", version)
        gmsh.option.setNumber("Mesh.Binary", binary)
        gmsh.write(str(path))
    return path


def refused(path: Path) -> str:
    with pytest.raises(InputError) as error:
        read_mesh(path, "upper")
    text = str(error.value)
    assert text.startswith("body.upper.mesh.file: ")
    assert path.name in text
    return text


# Rectangles


@pytest.mark.parametrize(
    ("size", "origin"),
    [((3.0, 1.0), (0.0, 1.0)), ((1e-9, 1e6), (1e-9, -5e5)), ((1.0, 1.0), (1e6, -1e6))],
)
def test_rectangle_keeps_size_and_origin(size, origin):
    mesh = rectangle((5, 4), size, origin)
    corner, (width, height) = np.array(origin), size
    assert mesh.points.min(axis=0) == pytest.approx(corner, rel=1e-15, abs=0.0)
    assert mesh.points.max(axis=0) == pytest.approx(corner + size, rel=1e-15, abs=0.0)
    rounding = (np.abs(mesh.points).max(axis=0) / size).max()  # what the offset costs
    assert signed_measures(mesh.points, mesh.triangles) == pytest.approx(
        np.full(40, width * height / 40), rel=1e-14 * (1 + rounding), abs=0.0
    )
    assert mesh.extent == pytest.approx(np.hypot(*size), rel=1e-9, abs=0.0)


def test_the_extent_of_a_body_does_not_depend_on_the_axes():
    mesh = rectangle((5, 4), (3.0, 2.0), (1.0, -1.0))
    turned = mesh.points @ np.array([[0.8, 0.6], [-0.6, 0.8]])
    assert dataclasses.replace(mesh, points=turned).extent == pytest.approx(
        np.sqrt(13.0), rel=1e-12
    )


@pytest.mark.parametrize("divisions", [(1, 3), (66, 22)])
def test_rectangle_is_numbered_as_gmsh_does(divisions):
    """Nodes, triangles and lines of a rectangle have the numbers of gmsh's transfinite surface."""
    with gmsh_session():
        (sides, surface), geometry = draw_square(1.0), gmsh.model.geo
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


# Files


@pytest.mark.parametrize("version, binary", [(2.2, False), (4.0, False), (4.1, True)])
def test_a_name_of_two_dimensions_is_refused(tmp_path, version, binary):
    """A file of gmsh with one name for a curve and a surface is refused: one of them would be lost."""
    path = write_by_gmsh(tmp_path / "twice.msh", version, binary, surfaces=("volume", "left"))
    with pytest.raises(
        InputError,
        match=r"^body\.body\.mesh\.file: .*twice\.msh: 'left' is the name of both a "
        r"physical curve and a physical surface; rename one$",
    ):
        build_mesh(body_of(file=str(path)))


@pytest.mark.slow
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
    child = subprocess.run(
        [sys.executable, "-c", code, path], capture_output=True, text=True, timeout=LIMIT
    )
    assert (child.returncode, child.stdout) == (0, "SIGINT SIGTERM SIGUSR1\n"), child.stderr


def test_clockwise_triangles_are_turned(tmp_path):
    mesh = read_mesh(
        write_square(tmp_path / "square.msh", triangles=[[0, 2, 1], [0, 2, 3]]), "upper"
    )
    assert signed_measures(mesh.points, mesh.triangles) == pytest.approx([0.5, 0.5])
    assert [sorted(t) for t in mesh.triangles.tolist()] == HALVES.tolist()


def test_unused_points_are_dropped(tmp_path):
    points = np.vstack([[[7.0, 7.0]], SQUARE[:2], [[8.0, 8.0]], SQUARE[2:], [[9.0, 9.0]]])
    number = np.array([1, 2, 4, 5])
    mesh = read_mesh(
        write_square(
            tmp_path / "square.msh", points=points, triangles=number[HALVES], lines=number[SIDES]
        ),
        "upper",
    )
    assert np.array_equal(mesh.points, SQUARE)
    assert np.array_equal(mesh.triangles, HALVES)
    assert np.array_equal(np.vstack([mesh.groups[name] for name in NAMES]), SIDES)


# Order 2


def test_straight_second_order_file_is_that_of_first_order(tmp_path):
    """Straight second-order elements are the same to the last bit as those made from their corners, halved or not."""
    linear = read_mesh(write_by_gmsh(tmp_path / "linear.msh", 2.2), "upper")
    path = write_by_gmsh(tmp_path / "quadratic.msh", 4.1, order=2)
    read = read_mesh(path, "upper", 2)
    for ours, theirs in (
        (read_mesh(path, "upper"), linear),
        (read, raise_order(linear, "mesh")),
        (halve(read, "mesh"), raise_order(halve(linear, "mesh"), "mesh")),
    ):
        assert np.array_equal(ours.points, theirs.points) and np.array_equal(
            ours.triangles, theirs.triangles
        )
        assert all(
            np.array_equal(ours.groups[name], theirs.groups[name]) for name in NAMES
        ) and not len(ours.curved)


def test_group_across_triangles_has_no_middles(tmp_path):
    path = write_square(
        tmp_path / "square.msh",
        lines=[*SIDES.tolist(), [1, 3]],
        tags=(1, 2, 3, 4, 5),
        names=(*NAMES, "across"),
    )
    assert len(read_mesh(path, "upper").points) == 4
    with pytest.raises(
        InputError, match=r"body\.body\.mesh: .*'across' has lines that are not sides"
    ):
        build_mesh(body_of(2, file=str(path)))


def test_edges_are_turned_and_walked():
    mesh = raise_order(rectangle((2, 1)), "mesh")
    edges = mesh.groups["top"].copy()
    edges[0] = edges[0][[1, 0, 2]]
    turned, *_ = turn_outward(mesh, edges)
    assert (np.diff(mesh.points[turned][:, :2, 0], axis=1) < 0).all()  # the body lies to the left
    assert np.array_equal(turned[:, 2], edges[:, 2])
    steps = mesh.points[segments(turned)]
    assert steps[:, 1] - steps[:, 0] == pytest.approx(np.tile([-0.75, 0.0], (4, 1)))


@pytest.mark.parametrize("moved, by", [(4, (0.01, 0.01)), (8, (0.01, 0.01)), (4, (0.1, 0.0))])
def test_curved_triangles(tmp_path, moved, by):
    """The middle of a side on the boundary, that of the diagonal, and one that is off along its side, stay there."""
    points = np.vstack([SQUARE, (SQUARE + np.roll(SQUARE, -1, axis=0)) / 2, [[0.5, 0.5]]])
    points[moved] += by
    path = write_square(
        tmp_path / "curved.msh",
        points=points,
        triangles=[[0, 1, 2, 4, 5, 8], [0, 2, 3, 8, 6, 7]],
        lines=np.column_stack([SIDES, [4, 5, 6, 7]]),
    )
    straight, mesh = (read_mesh(path, "upper", order) for order in (1, 2))
    assert np.array_equal(straight.points, SQUARE) and np.array_equal(straight.triangles, HALVES)
    middle = mesh.groups[NAMES[0]][0, 2] if moved == 4 else mesh.triangles[0, 5]
    assert np.array_equal(mesh.points[middle], points[moved])
    assert len(mesh.curved) == (1 if moved == 4 else 2)


def test_quadrilaterals_are_cut_along_the_shorter_diagonal():
    """Quadrilaterals of a file are cut into triangles, whatever the order of their corners, convex or not."""
    points = np.array(
        [
            [0, 0],
            [1, 0],
            [1, 1],
            [0, 1],
            [2, 0],
            [3, 0.2],
            [2, 1],
            [4, -5],
            [4.5, 1],
            [4.2, 0],
            [3.9, 1],
        ],
        float,
    )
    quads = [
        [0, 1, 2, 3],
        [1, 4, 6, 2],
        [4, 5, 6, 2],
        [7, 8, 9, 10],
    ]  # two squares, a kite, one with an inner corner
    expected = {
        (0, 1, 2),
        (0, 2, 3),
        (1, 4, 6),
        (1, 2, 6),
        (4, 5, 6),
        (2, 4, 6),
        (7, 8, 9),
        (7, 9, 10),
    }
    for turn in range(4):
        for way in (1, -1):
            turned = np.roll(quads, turn, axis=1)[:, ::way]
            parts = HALVED[shorter_diagonals(points, turned)]
            triangles = np.take_along_axis(turned[:, None], parts, axis=2).reshape(-1, 3)
            assert {tuple(sorted(each)) for each in triangles.tolist()} == expected, (turn, way)


# Refusals


def test_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match=r"body\.body\.mesh\.file: there is no file .*absent\.msh"):
        build_mesh(body_of(file="absent.msh"), tmp_path)


UNREADABLE = {
    "empty": lambda text: "",
    "words": lambda text: "not a mesh\n",
    "version": lambda text: "$MeshFormat\n9.9 0 8\n$EndMeshFormat\n",
    "end": lambda text: text[:-40],
    "half": lambda text: text[:-400],
    "nodes": lambda text: text.replace("$Nodes", "$Nodez"),
}
"""What spoils the text of a file."""


@pytest.mark.parametrize(
    ("version", "spoilt"),
    [
        *((2.2, spoilt) for spoilt in UNREADABLE if spoilt != "end"),
        (4.1, "half"),
        (4.0, "half"),
        (1.0, "end"),
    ],
)
def test_file_that_is_not_a_mesh(tmp_path, version, spoilt):
    """A file that is cut short or something else is refused with its name, and with gmsh's reason where it reads it."""
    path = write_by_gmsh(tmp_path / "notes.msh", version)
    path.write_text(UNREADABLE[spoilt](path.read_text()))
    text = refused(path)
    known = spoilt not in ("empty", "words")
    why = "(meshio: " if known else ": it does not begin with $MeshFormat"
    assert f"is not a mesh that meshio or gmsh can read {why}".replace(" :", ":") in text
    assert "gmsh: " in text or version in (2.2, 4.1)


def test_third_order_triangles(tmp_path):
    text = refused(write_by_gmsh(tmp_path / "cubic.msh", 4.1, order=3))
    assert "elements of type line4, triangle10" in text


FAN = [[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]
FIVE = [*SQUARE.tolist(), [0.5, 0.5]]

REFUSED = {
    "no triangles": (
        {"triangles": np.empty((0, 3), int)},
        "has neither triangles nor tetrahedra.*Physical Surface",
    ),
    "no names": (
        {"names": ()},
        r"no named physical groups of lines; clamps, tractions and contacts refer to boundaries by such names: "
        r'Physical Curve\("',
    ),
    "no area": (
        {"points": [*FIVE[:4], [0.5, 0.0]], "triangles": [*HALVES.tolist(), [0, 4, 1]]},
        "triangles without area",
    ),
    "folded": (
        {"points": [*FIVE[:4], [0.5, 1.5]], "triangles": FAN},
        r"has triangles that overlap at \(",
    ),
    "twice": (
        {"points": [*FIVE, [0.5, 0.8]], "triangles": [*FAN, [0, 1, 5]]},
        r"that overlap at \(0.5, 0\)",
    ),
    "no number": (
        {"points": [[np.nan, 0.0], *FIVE[1:4]]},
        "has coordinates that are not numbers, or above 1e",
    ),
    "not plane": (
        {"points": np.column_stack([SQUARE, [0.0, 0.1, 0.0, 0.0]])},
        r"is not plane \(its z coordinates differ\), and has no tetrahedra; a solid needs its cells: Phys",
    ),
    "line apart": (
        {"points": [*FIVE[:4], [2.0, 2.0]], "lines": [[0, 1], [1, 2], [2, 3], [3, 4]]},
        "belong to no triangle",
    ),
}


@pytest.mark.parametrize(("changes", "words"), REFUSED.values(), ids=REFUSED)
def test_file_without_a_sound_mesh(tmp_path, changes, words):
    """What is no plane body with a boundary is refused in one message that says why, and what lacks."""
    if "points" in changes:
        changes = changes | {"points": np.asarray(changes["points"])}
    assert re.search(words, refused(write_square(tmp_path / "square.msh", **changes)))


def test_group_without_lines(tmp_path):
    """A name that gmsh kept but whose lines it did not save must not clamp or load nothing in silence."""
    write_square(tmp_path / "square.msh", tags=(1, 1, 1, 1))
    words = "the boundary group 'right' of the mesh has a name, but no lines"
    with pytest.raises(InputError, match=words):
        build_mesh(body_of(file="square.msh", clamp=["right"]), tmp_path)
    write_square(tmp_path / "square.msh")
    build_mesh(body_of(file="square.msh", clamp=["right"]), tmp_path)


def test_file_is_looked_for_next_to_the_scene_first(tmp_path, monkeypatch):
    near, here = tmp_path / "near", tmp_path / "here"
    near.mkdir()
    here.mkdir()
    write_square(near / "square.msh")
    write_square(here / "square.msh", points=2 * SQUARE)
    write_square(here / "other.msh", points=3 * SQUARE)
    monkeypatch.chdir(here)
    assert build_mesh(body_of(file="square.msh"), near).extent == pytest.approx(np.sqrt(2))
    assert build_mesh(body_of(file="other.msh"), near).extent == pytest.approx(3 * np.sqrt(2))
    absolute = str(here / "square.msh")
    assert build_mesh(body_of(file=absolute), near).extent == pytest.approx(2 * np.sqrt(2))
