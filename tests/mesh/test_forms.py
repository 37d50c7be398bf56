"""Faces and curves of drawings by what they are: found as written, else refused with the nearest."""

import re
from pathlib import Path

import numpy as np
import pytest
from scenes import seldom

from ddmpi.errors import InputError
from ddmpi.mesh.forms import WITHIN
from meshes import area, cad, drawn, lengths, write


def plate(path: Path, holes: tuple[float, ...] = (3.0,), scale: float = 1.0) -> Path:
    """A plate 40 × 20 × 4 with holes along its middle, and a pin of radius 3 in the first hole, in millimetres and a scale."""

    def draw(occ) -> None:
        box = [(3, occ.addBox(*(scale * np.array([0, -10, 0, 40, 20, 4]))))]
        pins = [(10 * k, 0, 0, 0, 0, 4, r) for k, r in enumerate((*holes, 3.0), 1)]
        pins[-1] = (10, *pins[-1][1:])
        *tools, _ = [(3, occ.addCylinder(*(scale * np.array(pin)))) for pin in pins]
        occ.cut(box, tools)

    return cad(path, draw)


@pytest.mark.slow
@pytest.mark.parametrize("scale", [seldom(1.0), 1e-3, seldom(1e3)])
def test_faces_are_found_by_what_they_are(tmp_path, scale):
    """Each face has words that mean it alone, in any unit; a point on a cylinder's axis will do, and so will one that is
    off by less than a thousandth of the body."""
    path = plate(tmp_path / "plate.brep", (3.0, 2.0), scale)
    start = drawn(path, size=10.0 * scale, part=1)
    words = [face.words for face in start.faces.values()]
    off = 0.9 * WITHIN * np.sqrt(40**2 + 20**2 + 4**2)
    others = {
        f"cylinder r={2 * scale} at ({20 * scale}, 0, {2 * scale})": 8 * np.pi * 2,
        f"cylinder at ({20 * scale}, {2 * scale}, {scale})": 8 * np.pi * 2,
        f"plane n=(0, 0, -3) at ({35 * scale}, 0, {-off * scale})": 800 - 13 * np.pi,
        f"face at ({40 * scale}, 0, {scale})": 80.0,
    }
    mesh = drawn(path, size=10.0 * scale, part=1, clamp=[*words, *others], order=2)
    assert len({*words}) == len(start.faces) == 8
    for name, face in start.faces.items():
        assert area(mesh, face.words) == area(mesh, name)
    for name, expected in others.items():
        assert area(mesh, name) / scale**2 == pytest.approx(expected, rel=1e-3), name


def test_a_changed_part_does_not_shift_the_faces_of_others(tmp_path):
    """With one more hole in the plate the pin's faces have other numbers and the same words."""
    before, after = (
        drawn(plate(tmp_path / f"{len(holes)}.step", holes), size=4.0, part=2)
        for holes in ((3.0,), (3.0, 2.0))
    )
    assert before.faces.keys() != after.faces.keys()
    assert [f.words for f in before.faces.values()] == [f.words for f in after.faces.values()]


def test_a_face_that_is_not_there_is_refused_with_the_nearest(tmp_path):
    """Another radius, another direction, another kind, or too far away; of both sides of a thin plate the normal tells."""
    path, most = plate(tmp_path / "plate.step"), WITHIN * np.sqrt(40**2 + 20**2 + 4**2)
    hole, top = "'cylinder r=3 at (7, 0, 2)'", "'plane n=(0, 0, 1) at (20, 0, 4)'"
    for on, nearest in (
        ("cylinder r=3.01 at (10, 0, 2)", hole),
        ("cylinder r=3 at (17, 0, 2)", hole),
        ("sphere at (7, 0, 2)", hole),
        (f"plane n=(0, 0, 1) at (20, 0, {4 + 1.1 * most})", top),
        ("plane n=(0, 0.01, 1) at (20, 0, 4)", top),
    ):
        words = f"has no face {on!r}; the nearest one is {nearest} (face "
        with pytest.raises(InputError, match=re.escape(words)):
            drawn(path, size=10.0, part=1, clamp=[on])
    for on in ("cylinder r=3.002 at (10, 0, 2)", f"plane at (20, 0, {4 + 0.9 * most})"):
        assert on in drawn(path, size=10.0, part=1, clamp=[on]).groups
    with pytest.raises(InputError, match=r"has 2 faces 'plane at \(40, 0, 4\)'; choose one: "):
        drawn(path, size=10.0, part=1, clamp=["plane at (40, 0, 4)"])


@pytest.mark.parametrize(
    "on",
    [
        "plane n=(0, 0, 1) at (20, 0, 1e999)",
        "cylinder r=1e999 at (10, 0, 2)",
        "cylinder r=0 at (10, 0, 2)",
        "plane n=(0, 0, 0) at (20, 0, 4)",
        "plane n=(1e999, 0, 0) at (20, 0, 4)",
    ],
)
def test_numbers_that_no_face_has_are_refused(tmp_path, on):
    """Of one that is too far away any face is the nearest."""
    with pytest.raises(InputError, match="needs finite numbers, a radius above 0 and a normal"):
        drawn(plate(tmp_path / "plate.step"), size=10.0, part=1, clamp=[on])


def test_numbers_may_have_signs_and_any_size(tmp_path):
    """A + of a number puts no names together; normals have any length."""
    path, top = plate(tmp_path / "plate.step"), "plane n=(0, 0, +1e200) at (+2e+1, 0, 4)"
    both, tiny = f"{top}+cylinder at (10, 0, +2)", "plane n=(0, 1e-200, 0) at (20, 10, 2)"
    mesh = drawn(path, size=10.0, part=1, clamp=[top, both, tiny])
    assert area(mesh, top) == pytest.approx(800 - 9 * np.pi, rel=0.02)
    assert area(mesh, both) == pytest.approx(800 + 15 * np.pi, rel=0.02)
    assert area(mesh, tiny) == pytest.approx(160.0)


def test_faces_in_one_plane_are_told_apart(tmp_path):
    """Of a fork the one on which the point lies; between its prongs there is none."""
    path = cad(
        tmp_path / "fork.step",
        lambda occ: occ.cut(
            [(3, occ.addBox(0, 0, 0, 9, 4, 4))], [(3, occ.addBox(4, 0, 2, 3, 4, 2))]
        ),
    )
    left, right = "plane at (2, 1, 4)", "plane at (8, 1, 4)"
    mesh = drawn(path, size=2.0, clamp=[left, right])
    assert [area(mesh, on) for on in (left, right)] == pytest.approx([16.0, 8.0])
    with pytest.raises(InputError, match=r"has no face 'plane at \(6, 1, 4\)'; the nearest one is"):
        drawn(path, size=2.0, clamp=["plane at (6, 1, 4)"])


def test_cylinders_of_other_programs(tmp_path):
    """Some write them as splines, which are cylinders by their curvature; a cone as a spline is none."""

    def draw(occ) -> None:
        occ.cut([(3, occ.addBox(-4, -4, 0, 8, 8, 3))], [(3, occ.addCylinder(0, 0, 0, 0, 0, 3, 1))])
        occ.addCone(20, 0, 0, 0, 0, 3, 2, 1)
        occ.dilate(occ.getEntities(3), 0, 0, 0, 2, 2, 2)  # makes splines of all faces

    path = cad(tmp_path / "splines.step", draw)
    mesh = drawn(path, size=4.0, part=1, order=2, clamp=["cylinder r=2 at (0, 0, 3)"])
    bore, cone = mesh.faces.values(), drawn(path, size=4.0, part=2).faces.values()
    (round_one,) = [face for face in bore if face.kind == "cylinder"]
    assert round_one.radius == pytest.approx(2.0) and round_one.words.startswith("cylinder r=2 at ")
    assert sorted(end[2] for end in round_one.axis) == pytest.approx([0.0, 6.0], abs=1e-9)
    assert np.abs(np.array(round_one.axis)[:, :2]).max() < 1e-9
    assert not [face for face in cone if face.kind == "cylinder"]
    assert area(mesh, "cylinder r=2 at (0, 0, 3)") == pytest.approx(24 * np.pi, rel=1e-3)


def test_a_point_on_the_axis_means_all_around_it(tmp_path):
    """A bore in two halves, as CAD programs draw it, is one group by a point on its axis, and a half by a point on it."""

    def halves(occ) -> None:
        boxes = [occ.addBox(-5, y, 0, 10, 5, 2) for y in (-5, 0)]
        occ.fragment([(3, box) for box in boxes], [])
        occ.cut([(3, box) for box in boxes], [(3, occ.addCylinder(0, 0, 0, 0, 0, 2, 2))])

    path = cad(tmp_path / "halves.brep", halves)
    script = f'SetFactory("OpenCASCADE"); Merge "{path.name}"; Physical Volume("all") = {{1, 2}};'
    geo = write(tmp_path / "halves.geo", script)
    whole, half = "cylinder at (0, 0, 1)", "cylinder r=2 at (0, 2, 1)"
    mesh = drawn(geo, size=3.0, order=2, clamp=[whole, half])
    assert area(mesh, whole) == pytest.approx(8 * np.pi, rel=1e-4)
    assert area(mesh, half) == pytest.approx(4 * np.pi, rel=1e-4)


TWO_BOXES = """SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 2, 2, 1}; Box(2) = {0, 0, 1, 2, 2, 1};
BooleanFragments{ Volume{1, 2}; Delete; }{ }
"""


@pytest.mark.parametrize(
    ("body", "named"), [(1, True), (2, False), seldom(2, True), seldom(1, False)]
)
def test_a_face_between_two_solids_has_the_normal_of_the_body(tmp_path, body, named):
    """Of two boxes with a common face, one of which the script names as the body, or the scene as its part: the normal
    leads out of it, and faces of the other box alone are none of the body's."""
    told, part = (f'Physical Volume("body") = {{{body}}};', {}) if named else ("", {"part": body})
    geo = write(tmp_path / "boxes.geo", TWO_BOXES + told)
    up = 3 - 2 * body
    outer, end = f"plane n=(0, 0, {up}) at (1, 1, 1)", f"plane at (1, 1, {1 - up})"
    mesh = drawn(geo, size=2.0, clamp=[outer, end], **part)
    assert mesh.points[:, 2].mean() == pytest.approx(body - 0.5, abs=0.1)
    assert [area(mesh, on) for on in (outer, end)] == pytest.approx([4.0, 4.0])
    for wrong in (f"plane n=(0, 0, {-up}) at (1, 1, 1)", f"plane at (1, 1, {1 + up})"):
        with pytest.raises(InputError, match="has no face"):
            drawn(geo, size=2.0, clamp=[wrong], **part)


def test_curves_of_plane_drawings(tmp_path):
    """Lines and arcs, an arc also by its centre; gmsh's own kernel has names in their place."""
    path = cad(
        tmp_path / "plate.step",
        lambda occ: occ.cut(
            [(2, occ.addRectangle(0, 0, 7, 20, 10))], [(2, occ.addDisk(8, 5, 7, 2, 2))]
        ),
    )
    start = drawn(path, size=2.0)
    words = [face.words for face in start.faces.values()]
    mesh = drawn(path, size=2.0, clamp=[*words, "arc r=2 at (8, 5)", "curve at (3, 0)"])
    for name, face in start.faces.items():
        assert lengths(mesh, face.words).sum() == lengths(mesh, name).sum()
    assert lengths(mesh, "arc r=2 at (8, 5)").sum() == pytest.approx(4 * np.pi, rel=5e-3)
    assert lengths(mesh, "curve at (3, 0)").sum() == pytest.approx(20.0)
    text = "Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {0, 1, 0}; Line(1) = {1, 2};"
    text += "Line(2) = {2, 3}; Line(3) = {3, 1}; Curve Loop(1) = {1, 2, 3}; Plane Surface(1) = {1};"
    with pytest.raises(InputError, match=r"has no curve 'line at \(1, 0\)': gmsh finds curves by"):
        drawn(write(tmp_path / "own.geo", text), clamp=["line at (1, 0)"])
    text = f'SetFactory("OpenCASCADE"); {text}'
    mesh = drawn(write(tmp_path / "cad.geo", text), clamp=["line at (1, 0)"])
    assert lengths(mesh, "line at (1, 0)").sum() == pytest.approx(2.0)


def test_what_only_looks_like_a_form_is_a_name(tmp_path):
    """Labels of CAD programs may be any words."""
    with pytest.raises(InputError, match="has no face 'plane 3'; it has 1 "):
        drawn(plate(tmp_path / "plate.step"), size=10.0, part=1, clamp=["plane 3"])
