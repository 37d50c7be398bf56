"""Drawings of solids: .geo, .step and .brep as gmsh meshes them in the run, how fine, and what is refused."""

import numpy as np
import pytest
from scenes import to_toml

from ddmpi.errors import InputError
from ddmpi.mesh.build import build_mesh, kind_of_files
from ddmpi.mesh.mesh import signed_measures
from ddmpi.scene.bodies import Traction
from ddmpi.scene.reader import read_scene
from meshes import area, body_of, cad, drawn, longest, write

BLOCK = """
SetFactory("OpenCASCADE");
Box(1) = {0, 0, 0, 2, 1, 1};
Cylinder(2) = {1, 0, 0.5, 0, 1, 0, 0.25};
BooleanDifference(3) = { Volume{1}; Delete; }{ Volume{2}; Delete; };
"""
"""A block 2 × 1 × 1 with a bore along y."""

GROUPS = """
left() = Surface In BoundingBox {-.1, -.1, -.1, .1, 1.1, 1.1}; Physical Surface("left") = left();
top() = Surface In BoundingBox {-.1, -.1, .9, 2.1, 1.1, 1.1}; Physical Surface("top") = top();
bore() = Surface In BoundingBox {.7, -.1, .2, 1.3, 1.1, .8}; Physical Surface("bore") = bore();
edge() = Curve In BoundingBox {-.1, -.1, -.1, .1, 1.1, .1}; Physical Curve("edge") = edge();
corner() = Point In BoundingBox {-.1, -.1, -.1, .1, .1, .1}; Physical Point("corner") = corner();
"""

EXTRUDED = """
Point(1) = {0, 0, 0}; Point(2) = {2, 0, 0}; Point(3) = {2, 1, 0}; Point(4) = {0, 1, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
out[] = Extrude {0, 0, 1} { Surface{1}; %s };
Physical Surface("bottom") = {1}; Physical Surface("top") = {out[0]};
Physical Surface(7) = {out[2]};
"""
"""A block of gmsh's own kernel, without a physical volume."""


@pytest.mark.slow
def test_solid_has_its_groups_and_is_as_fine_as_asked(tmp_path):
    """A .geo with volumes is meshed with tetrahedra, its groups and materials, curved in order 2."""
    path = write(tmp_path / "block.geo", BLOCK + GROUPS + 'Physical Volume("steel") = {3};')
    mesh, volume = drawn(path, order=2, clamp=["left", "edge", "corner"]), 2.0 - np.pi * 0.25**2
    assert (mesh.dimension, mesh.order, mesh.groups.keys()) == (3, 2, {"left", "top", "bore"})
    assert longest(mesh) < 2 * 0.5 and len(mesh.surfaces["steel"]) == len(mesh.triangles)
    assert mesh.measures().sum() == pytest.approx(volume, rel=1e-4)
    assert area(mesh, "bore") == pytest.approx(np.pi * 0.5, rel=1e-4)
    assert len(mesh.groups["bore"]) >= 24  # elements around
    for name, group in mesh.groups.items():
        assert len(mesh.facets(name).nodes) == len(group)
    assert (mesh.points[mesh.nodes_of("edge")][:, [0, 2]] == 0.0).all()
    assert mesh.points[mesh.nodes_of("corner")].tolist() == [[0.0, 0.0, 0.0]]


@pytest.mark.parametrize("layers", ["", "Layers{3};", "Layers{3}; Recombine;"])
def test_solids_of_gmshs_own_kernel(tmp_path, layers):
    """A body is all volumes where no group says so; groups without a name have a number; prisms are cut."""
    mesh = drawn(write(tmp_path / "block.geo", EXTRUDED % layers))
    assert mesh.groups.keys() == {"bottom", "top", "7"} and bool(mesh.cut) == (
        "Recombine" in layers
    )
    assert mesh.measures().sum() == pytest.approx(2.0, rel=1e-12)
    assert (signed_measures(mesh.points, mesh.triangles) > 0).all()


@pytest.mark.slow
def test_faces_curves_and_points_of_cad_files_have_numbers(tmp_path):
    """They are called "5", "curve 5" and "point 3"; what asks for others is refused with what there is."""
    path = cad(tmp_path / "block.step", lambda occ: occ.addBox(0, 0, 0, 2, 1, 0.5))
    for asked, words in (
        ("left", r"has no face 'left'; it has .*(\d) \(0, 0, 0\) to \(2, 1, 0\)"),
        ("curve 99", r"'curve 99'; it has curve 1 from \(.*\) by .* to .*; curve 2(.*; curve){10}"),
        ("point 99", r"has no point 'point 99'; .*point (\d) \(2, 1, 0.5\)"),
    ):
        with pytest.raises(InputError, match=words):
            drawn(path, clamp=[asked])
    mesh = drawn(path, order=2, clamp=["curve 3", "point 2", "5"])
    ends = mesh.points[mesh.nodes_of("curve 3")]
    assert np.count_nonzero(np.ptp(ends, axis=0) > 1e-9) == 1 and len(mesh.vertices["point 2"]) == 1
    with pytest.raises(
        InputError, match="'curve 3' is a physical curve of the mesh, which only a clamp may name"
    ):
        drawn(path, traction=[Traction(on="curve 3", pressure=1.0)])


def test_curves_and_points_are_groups_where_they_are_asked_for(tmp_path):
    """All faces are, by their numbers."""
    path = cad(tmp_path / "block.step", lambda occ: occ.addBox(0, 0, 0, 2, 1, 0.5))
    mesh = drawn(path, clamp=["curve 3", "point 2", "5"])
    assert list(mesh.curves) == ["curve 3"] and list(mesh.vertices) == ["point 2"]
    assert mesh.groups.keys() == {
        str(k) for k in range(1, 7)
    } and mesh.measures().sum() == pytest.approx(1.0)
    areas = sorted(area(mesh, name) for name in mesh.groups)
    assert areas == pytest.approx([0.5, 0.5, 1.0, 1.0, 2.0, 2.0])


@pytest.mark.slow
def test_drawings_say_the_dimension(tmp_path):
    """A drawing with volumes makes the scene solid, where nothing else says what it is."""
    solid, flat = (
        write(tmp_path / "solid.geo", EXTRUDED % ""),
        write(
            tmp_path / "flat.geo",
            (EXTRUDED % "").split("out[]")[0] + 'Physical Curve("bottom") = {1};',
        ),
    )
    kind = kind_of_files(tmp_path / "scene.toml")
    assert [kind(body_of(geometry=str(path), size=0.5)) for path in (solid, flat)] == [
        (3, 1),
        (2, 1),
    ]

    def dimension(*files: str, **more) -> int:
        bodies = [
            {
                "name": f"block{k}",
                "mesh": {"geometry": file, "size": 0.5},
                "clamp": ["bottom"],
                "material": {"young": 1.0, "poisson": 0.3},
            }
            for k, file in enumerate(files)
        ]
        contact = {"bodies": ["block0", "block1"], "on": ["bottom", "bottom"]}
        return read_scene(
            "scene.toml", to_toml({"body": bodies, "contact": [contact]} | more), (), kind
        ).dimension

    floor = {"name": "floor", "shape": "plane", "point": [0, 0, 1], "normal": [0, 0, 1]}
    assert (
        dimension(
            "solid.geo", rigid=[floor], contact=[{"bodies": ["block0", "floor"], "on": ["bottom"]}]
        )
        == 3
    )
    assert dimension("solid.geo", "solid.geo") == 3
    with pytest.raises(
        InputError, match=r"geometry: flat.geo is in the plane, and .* = solid.geo is in space"
    ):
        dimension("solid.geo", "flat.geo")
    with pytest.raises(InputError, match="the mesh is in space, and the scene is in the plane"):
        build_mesh(body_of(geometry=str(solid), size=0.5), dimension=2)
