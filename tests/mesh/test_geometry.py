"""Geometries: .geo, .step and .brep as gmsh meshes them in the run, how fine, and what is refused."""

import re
from functools import partial

import numpy as np
import pytest
from scenes import seldom

from ddmpi.errors import InputError
from ddmpi.mesh import geometry
from ddmpi.mesh.refine import GRADE, graded
from meshes import cad, lengths, longest, mesh_of, write
from meshes import drawn as drawn_of

PLATE = """
Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 1, 0}; Point(4) = {0, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4};
"""
"""The sides of a plate 2 × 1."""

SURFACE = (
    PLATE
    + """
Plane Surface(1) = {1};
Physical Surface("plate") = {1};
"""
)

GROUPS = """
Physical Curve("bottom") = {1}; Physical Curve("right") = {2};
Physical Curve("top") = {3}; Physical Curve("left") = {4};
"""

HOLE = (
    PLATE
    + """
Point(5) = {1, 0.5, 0}; Point(6) = {1.2, 0.5, 0}; Point(7) = {0.8, 0.5, 0};
Circle(5) = {6, 5, 7}; Circle(6) = {7, 5, 6};
Curve Loop(2) = {5, 6};
Plane Surface(1) = {1, 2};
Physical Surface("plate") = {1};
Physical Curve("hole") = {5, 6};
"""
    + GROUPS
)


drawn = partial(drawn_of, size=0.25)


# How fine


def test_geometry_has_its_groups_and_is_as_fine_as_asked(tmp_path):
    """A .geo is meshed with its physical groups; no side is much longer than `size`; the same file, the same mesh."""
    path = write(tmp_path / "plate.geo", SURFACE + GROUPS)
    meshes = [drawn(path), drawn(path)]
    assert meshes[0].measures().sum() == pytest.approx(2.0, rel=1e-12, abs=0.0)
    assert {name: round(lengths(meshes[0], name).sum(), 12) for name in meshes[0].groups} == {
        "bottom": 2.0,
        "right": 1.0,
        "top": 2.0,
        "left": 1.0,
    }
    assert 0.2 < longest(meshes[0]) < 1.4 * 0.25
    assert all(
        np.array_equal(getattr(meshes[0], key), getattr(meshes[1], key))
        for key in ("points", "triangles")
    )
    assert drawn(path, order=2).triangles.shape == (len(meshes[0].triangles), 6)


@pytest.mark.parametrize(("keys", "finest"), [({}, 0.0625), ({"contact_size": 0.02}, 0.02)])
def test_elements_are_finer_along_contacts(tmp_path, keys, finest):
    """Elements on groups at contacts have contact_size, by default a quarter of size; far away they do not."""
    mesh = drawn(write(tmp_path / "plate.geo", SURFACE + GROUPS), contacts=("bottom",), **keys)
    assert lengths(mesh, "bottom") == pytest.approx(np.full(round(2 / finest), finest), rel=0.05)
    assert lengths(mesh, "top").min() > 3 * finest


def test_sizes_of_the_file_remain(tmp_path):
    """Sizes at points, and the file's own background field, limit sizes beside `size` and contact_size."""
    field = """
    n = 4;
    Field[n] = Box; Field[n].VIn = 0.02; Field[n].VOut = 1; Field[n].XMin = 1.7; Field[n].XMax = 3; Field[n].YMin = 0.7;
    Field[n].YMax = 2;
    Background Field = n;
    """
    fine = drawn(write(tmp_path / "plate.geo", SURFACE + GROUPS + "MeshSize{1, 2} = 0.05;"))
    assert lengths(fine, "bottom").max() < 0.07 < 0.2 < lengths(fine, "top").max()
    both = drawn(write(tmp_path / "both.geo", SURFACE + GROUPS + field), contacts=("bottom",))
    assert lengths(both, "right").min() < 0.03
    assert lengths(both, "bottom").max() < 0.07
    assert lengths(both, "left").max() > 0.15


def test_circles_have_enough_elements(tmp_path):
    """A small hole in a coarse plate is round: its sides turn by 15 degrees, not so much as to be corners."""
    mesh = drawn(write(tmp_path / "hole.geo", HOLE), size=1.0)
    assert 24 <= len(mesh.groups["hole"]) <= 28
    few, many = (drawn(tmp_path / "hole.geo", size=1.0, around=around) for around in (12, 48))
    assert 12 <= len(few.groups["hole"]) <= 14
    assert 48 <= len(many.groups["hole"]) <= 54
    assert mesh.measures().sum() == pytest.approx(2 - np.pi * 0.04, rel=2e-3)


@pytest.mark.slow
def test_given_sizes_are_followed(tmp_path):
    """They replace all others, constraints of the file and nodes on curves as well, but stay below `size`."""
    path = write(
        tmp_path / "hole.geo", HOLE + "Transfinite Curve {1, 2, 3, 4} = 2; MeshSize{:} = 0.01;"
    )
    start = drawn(write(tmp_path / "start.geo", HOLE))
    wanted = np.where(start.points[start.triangles].mean(axis=1)[:, 0] < 1.0, 0.05, 5.0)
    meshes = [drawn(path, sizes=graded(start, wanted), contacts=("top",)) for _ in range(2)]
    assert np.array_equal(meshes[0].points, meshes[1].points)
    assert lengths(meshes[0], "left") == pytest.approx(np.full(20, 0.05), rel=0.1)
    assert 0.15 < lengths(meshes[0], "right").min() < 0.26
    occ = (
        'SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 2, 1}; Physical Curve("bottom") = {1};'
        "Transfinite Curve {1} = 2;"
    )
    mesh = drawn(
        write(tmp_path / "plate.geo", occ), sizes=graded(start, np.full(len(start.triangles), 0.1))
    )
    assert lengths(mesh, "bottom") == pytest.approx(np.full(20, 0.1), rel=0.1)


def test_names_of_groups_are_no_script(tmp_path):
    """Where sizes replace constraints, gmsh reads what it has written itself, whatever the names of groups hold."""
    script = f"""Physical Curve(StrCat('x", 9) = {{1}}; Sys', 'temCall "touch {tmp_path}/touched"; Physical Curve("y'))
    = {{2}}; Transfinite Curve {{2}} = 3;"""
    start = drawn(write(tmp_path / "start.geo", SURFACE + GROUPS))
    path = write(tmp_path / "plate.geo", SURFACE + script)
    with pytest.raises(InputError, match="could start programs or write files"):
        drawn(path, sizes=graded(start, np.full(len(start.triangles), 0.1)))
    assert not (tmp_path / "touched").exists()


def test_sizes_grow_slowly():
    """Sizes at nodes grow by no more than GRADE with the distance, and are the elements' where these vary little."""
    mesh = mesh_of(shape="rectangle", size=(1.0, 1.0), divisions=(20, 20))
    wanted = np.ones(len(mesh.triangles))
    wanted[0] = 1e-3
    found = graded(mesh, wanted)
    links = np.concatenate([found.triangles[:, [0, 1]], found.triangles[:, [1, 2]]])
    far = np.linalg.norm(np.diff(found.points[links], axis=1)[:, 0], axis=1)
    assert (np.abs(np.diff(found.sizes[links], axis=1)[:, 0]) <= GRADE * far * (1 + 1e-9)).all()
    near = np.argmin(found.sizes)
    assert found.sizes[near] < 0.05 and tuple(found.points[near]) == (0.0, 0.0)
    assert np.allclose(graded(mesh, np.full(len(mesh.triangles), 0.3)).sizes, 0.3)


@pytest.mark.parametrize(
    "also",
    [
        "Mesh.ElementOrder = 2; Mesh 2; RefineMesh;",
        seldom("Mesh.RecombineAll = 1;"),
        "Mesh.SaveAll = 1; Mesh.MshFileVersion = 2.2;",
        seldom("Transfinite Surface {1}; Recombine Surface {1};"),
        "General.NumThreads = 2; Mesh.ScalingFactor = 1000;",
    ],
)
def test_scripts_that_also_mesh(tmp_path, also):
    """What a .geo says of meshing, beside sizes, does no harm: there are straight triangles of the right shape."""
    mesh = drawn(write(tmp_path / "plate.geo", SURFACE + GROUPS + also))
    assert mesh.order == 1 and mesh.measures().sum() == pytest.approx(2.0, rel=1e-12, abs=0.0)
    assert longest(mesh) < 0.45


def test_groups_without_names(tmp_path):
    """Physical curves by number are groups of that number; a single surface needs no physical one, a line no end."""
    mesh = drawn(
        write(tmp_path / "plate.geo", PLATE + "Plane Surface(1) = {1}; Physical Curve(7) = {1, 3};")
    )
    assert set(mesh.groups) == {"7"} and lengths(mesh, "7").sum() == pytest.approx(4.0)


@pytest.mark.slow
def test_scripts_of_several_files(tmp_path):
    """A script may include others and merge drawings that lie beside it, wherever the run was started."""
    folder = tmp_path / "my parts"
    folder.mkdir()
    write(folder / "sides.geo", SURFACE)
    mesh = drawn(write(folder / "plate.geo", 'Include "sides.geo";' + GROUPS))
    assert set(mesh.groups) == {"bottom", "right", "top", "left"}
    cad(folder / "part.step", lambda occ: occ.addRectangle(0, 0, 0, 3, 1))
    script = 'SetFactory("OpenCASCADE"); Merge "part.step"; Physical Curve("ends") = {2, 4};'
    mesh = drawn(write(folder / "merged.geo", script))
    assert [mesh.measures().sum(), lengths(mesh, "ends").sum()] == pytest.approx(
        [3.0, 2.0], rel=1e-9
    )


@pytest.mark.parametrize("suffix", [".step", seldom(".brep")])
def test_curves_of_cad_files_are_groups_by_number(tmp_path, suffix):
    """Curves of STEP and BREP files are called by their numbers, which the message about a wrong one explains; broken
    and missing files are refused."""
    path = cad(
        tmp_path / f"plate{suffix}",
        lambda occ: occ.cut(
            [(2, occ.addRectangle(0, 0, 0, 20, 10))], [(2, occ.addDisk(10, 5, 0, 2, 2))]
        ),
    )
    with pytest.raises(
        InputError, match=r"no curve 'left'; it has .*(\d) from \(0, 10\) by \(0, 5\) to \(0, 0\)"
    ):
        drawn(path, size=2.0, clamp=["left"])
    mesh = drawn(path, size=2.0, clamp=["1"])
    assert len(mesh.groups) == 5 and mesh.measures().sum() == pytest.approx(
        200 - 4 * np.pi, rel=2e-3
    )
    assert sorted(round(lengths(mesh, name).sum()) for name in mesh.groups) == [10, 10, 13, 20, 20]
    with pytest.raises(InputError, match=r"cannot be read|has no surface"):
        drawn(write(path, "no drawing"))
    path.unlink()
    with pytest.raises(InputError, match=r"body\.body\.mesh\.geometry: there is no file"):
        drawn(path)


# What is refused


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (PLATE + "Point(9) = {1, 0, 0,};\nfoo bar;\n", "cannot be read (gmsh: "),
        (PLATE + GROUPS, "has no surface"),
        (SURFACE, "has no named physical groups of lines"),
        (SURFACE + GROUPS + "Exit;", "ends gmsh (exit code 0); leave out Exit"),
        (
            SURFACE + GROUPS + 'Physical Curve("plate") = {1};',
            "both a physical curve and a physical surface",
        ),
        (
            SURFACE.replace("{2, 1, 0}", "{2, 1, 1}").replace("{0, 1, 0}", "{0, 1, 1}") + GROUPS,
            "is not plane",
        ),
        (
            SURFACE.replace('Physical Surface("plate") = {1};', "")
            + GROUPS
            + "Point(9) = {5, 0, 0}; Line(9) = {2, 9}; Line(10) = {9, 3}; Curve Loop(2) = {9, 10, -2};"
            + "Plane Surface(2) = {2};",
            "has 2 surfaces and no physical one",
        ),
        (
            PLATE.replace("{1, 2, 3, 4};\n", "{1, 2, 3};\n") + "Plane Surface(1) = {1};" + GROUPS,
            "cannot be ",
        ),
    ],
    ids=[
        "syntax",
        "no surface",
        "no curves",
        "exit",
        "two names",
        "not plane",
        "two surfaces",
        "open loop",
    ],
)
def test_bad_geometries_are_refused(tmp_path, text, words):
    """A geometry that cannot be a plane body is refused with its name and the reason; the next one is not."""
    path = write(tmp_path / "plate.geo", text)
    with pytest.raises(InputError) as error:
        drawn(path)
    assert str(error.value).startswith(f"body.body.mesh.geometry: {path}") and words in str(
        error.value
    )
    assert len(str(error.value).splitlines()) == 1
    assert (
        "Exit" not in text or drawn(write(tmp_path / "good.geo", SURFACE + GROUPS)).triangles.size
    )


def test_any_error_of_gmsh_is_the_drawings(tmp_path, monkeypatch):
    """Also one that comes up between reading and meshing; nothing is said of an Exit that is not there."""
    path = write(tmp_path / "plate.geo", SURFACE + GROUPS)

    def fails(*_):
        raise Exception("Unknown curve 7")

    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(geometry, "_refine_towards", fails)
    monkeypatch.setattr(geometry, "apart", lambda folder, work, *arguments, **_: work(*arguments))
    with pytest.raises(InputError, match=r"plate\.geo cannot be meshed \(gmsh: Unknown curve 7\)$"):
        drawn(path)

    def ends(*_, **__):
        raise ChildProcessError("exit code 1: Unknown curve 7")

    monkeypatch.setattr(geometry, "apart", ends)
    with pytest.raises(InputError, match=r"plate\.geo ends gmsh \(exit code 1: Unknown curve 7\)$"):
        drawn(path)


@pytest.mark.parametrize("key", ["size", "contact_size"])
@pytest.mark.parametrize(
    "text",
    [
        HOLE,
        """SetFactory("OpenCASCADE"); Rectangle(1) = {0, 0, 0, 2, 1};
Disk(2) = {1, 0.5, 0, 0.2}; BooleanDifference(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Physical Curve("hole") = {Curve In BoundingBox{0.7, 0.2, -1, 1.3, 0.8, 1}};""",
    ],
)
def test_a_size_in_other_units_is_refused(tmp_path, text, key):
    """A size that would make millions of elements is refused before gmsh begins, with key, number and extent."""
    path = write(tmp_path / "plate.geo", text)
    triangles = (2 - 0.04 * np.pi if key == "size" else 2e-8 * 0.4 * np.pi) / (
        np.sqrt(3) / 4 * 1e-16
    )
    message = f"plate.geo: {key} = 1e-08 would make {triangles:.1g} triangles of a drawing of 2 by 1; is it in the"
    with pytest.raises(InputError, match=re.escape(message)):
        drawn(path, **{"size": 0.5, key: 1e-8}, contacts=("hole",))
