"""Drawings of several bodies and without names: parts, numbered faces, sizes by group; edges; balls and cylinders."""

import re
from pathlib import Path

import numpy as np
import pytest

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import combined
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.bodies import Clamp, MeshSpec, Traction
from meshes import area, cad, lengths, mesh_of


def assembly(path: Path, names: tuple[str, ...] = ("base", "bolt", "bolt")) -> Path:
    """A STEP file of a block 4 × 4 × 1, and of two pins of radius 0.5 on it, called by `names`."""
    cad(
        path,
        lambda occ: [
            occ.addBox(0, 0, 0, 4, 4, 1),
            *(occ.addCylinder(x, x, 1, 0, 0, 1, 0.5) for x in (1, 3)),
        ],
    )
    text = re.sub(
        r"'Open CASCADE STEP translator [\d.]+ \d+\.(\d)'",
        lambda m: f"'{names[int(m[1]) - 1]}'",
        path.read_text(),
    )
    path.write_text(text)
    return path


@pytest.mark.slow
def test_a_part_of_an_assembly_by_name_and_number(tmp_path):
    """A body is one part of a STEP file, alone; its faces keep the numbers that they have in the whole file."""
    path = str(assembly(tmp_path / "all.step"))
    base, pin = (
        mesh_of(geometry=path, size=2.0, part="base"),
        mesh_of(geometry=path, size=0.5, part=3, order=2),
    )
    assert base.measures().sum() == pytest.approx(16.0) and pin.measures().sum() == pytest.approx(
        np.pi / 4, rel=1e-3
    )
    assert base.groups.keys() == {str(k) for k in range(1, 7)} and pin.groups.keys() == {
        "10",
        "11",
        "12",
    }
    assert pin.points[:, 0].min() == pytest.approx(2.5)
    kinds = {
        name: (face.kind, round(face.radius, 9), round(face.measure, 9))
        for name, face in pin.faces.items()
    }
    assert sorted(kinds.values()) == [
        ("cylinder", 0.5, round(np.pi, 9)),
        *[("plane", 0.0, round(np.pi / 4, 9))] * 2,
    ]
    again = mesh_of(geometry=path, size=0.25, part=3)
    assert again.faces == pin.faces and area(again, "11") == pytest.approx(
        pin.faces["11"].measure, rel=0.05
    )


@pytest.mark.parametrize(
    ("part", "words"),
    [
        (
            "nut",
            "has no part 'nut'; it has 1 'base' (0, 0, 0) to (4, 4, 1); 2 'bolt' (0.5, 0.5, 1) to (1.5, 1.5, 2); 3 ",
        ),
        (4, "has no part 4; it has 1 'base'"),
        (
            "bolt",
            "has 2 parts 'bolt'; take one by its number: 2 'bolt' (0.5, 0.5, 1) to (1.5, 1.5, 2); 3 'bolt' (2.5",
        ),
    ],
)
def test_a_part_that_is_not_there_is_refused_with_what_there_is(tmp_path, part, words):
    """A name without a part, or of several, leads to one message with the numbers, names and places of parts."""
    path = str(assembly(tmp_path / "all.step"))
    with pytest.raises(InputError, match=re.escape(words)):
        mesh_of(geometry=path, size=1.0, part=part)


def test_parts_of_a_script(tmp_path):
    """A .geo of several bodies gives one by the name of a physical volume, with the groups that it has."""
    path = tmp_path / "two.geo"
    path.write_text(
        'SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 1, 1, 1}; Box(2) = {0, 0, 1, 1, 1, 2};\n'
        'Physical Volume("low") = {1}; Physical Volume("high") = {2};\n'
        'Physical Surface("floor") = {5}; Physical Surface("roof") = {12};'
    )
    mesh = mesh_of(geometry=str(path), size=1.0, part="high", contacts=("11", "roof"))
    assert mesh.measures().sum() == pytest.approx(2.0) and mesh.groups.keys() == {"roof", "11"}
    assert mesh.surfaces.keys() == {"high"} and area(mesh, "11") == pytest.approx(1.0)


@pytest.mark.slow
def test_numbered_faces_are_groups_of_clamps_loads_and_contacts(tmp_path):
    """on = [8, 27] is one group of both faces, wherever a group may stand; in a .geo without names, too."""
    path = tmp_path / "box.geo"
    path.write_text('SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 1, 2, 3};')
    mesh = mesh_of(
        geometry=str(path),
        size=1.0,
        clamp=[1, Clamp(on=(1, 3), x=0.0)],
        traction=[Traction(on=(3, 5), pressure=1.0)],
        contacts=("2+6",),
    )
    assert [area(mesh, name) for name in ("1", "1+3", "3+5", "2+6")] == pytest.approx(
        [6.0, 9.0, 5.0, 8.0]
    )
    assert mesh.faces["6"].measure == pytest.approx(2.0)
    with pytest.raises(
        InputError, match=r"has no face '7'; it has 1 \(0, 0, 0\) to \(0, 2, 3\); 2 "
    ):
        mesh_of(geometry=str(path), size=1.0, clamp=[(1, 7)])
    path.write_text(path.read_text() + 'Physical Surface("left") = {1};')
    mesh = mesh_of(geometry=str(path), size=1.0, clamp=[("left", 3), "curve 9"])
    assert mesh.groups.keys() == {"left", "3", "left+3"} and area(mesh, "left+3") == pytest.approx(
        9.0
    )
    with pytest.raises(
        InputError, match="'curve 9' is a physical curve of the mesh, which only a clamp may name"
    ):
        mesh_of(
            geometry=str(path), size=1.0, traction=[Traction(on=("left", "curve 9"), pressure=1.0)]
        )


def test_sizes_by_group(tmp_path):
    """Elements have the sizes of size_on along its groups, also where these are parts of a contact."""
    path = tmp_path / "box.geo"
    path.write_text('SetFactory("OpenCASCADE"); Box(1) = {0, 0, 0, 6, 2, 2};')
    mesh = mesh_of(
        geometry=str(path), size=1.0, contact_size=0.25, size_on={"2": 1.0}, contacts=("1+2",)
    )
    assert np.median(lengths(mesh, "1")) < 0.3 and np.median(lengths(mesh, "2")) > 0.4
    mesh = mesh_of(
        geometry=str(path), size=1.0, contact_size=0.25, size_on={"1": 0.5}, clamp=[1, 2]
    )
    assert 0.3 < np.median(lengths(mesh, "1")) < 0.6 and np.median(lengths(mesh, "5")) > 0.5
    path.write_text(path.read_text() + 'Physical Surface("left") = {1};')
    with pytest.raises(
        InputError,
        match=r"mesh.size_on: the drawing has no boundary group 'lef'; did you mean 'left'",
    ):
        mesh_of(geometry=str(path), size=1.0, size_on={"lef": 0.5})
    with pytest.raises(
        ValueError, match=r"size_on.left = 2, along 'left', must not exceed size = 1"
    ):
        MeshSpec(geometry="box.geo", size=1.0, size_on={"left": 2.0})


def test_edges_and_corners_of_any_body_may_be_clamped():
    """What groups have in common is a group for clamps, in the plane and in space; loads and nothing are refused."""
    box = {"shape": "box", "size": (1.0, 2.0, 3.0), "divisions": (1, 2, 3)}
    mesh = mesh_of(clamp=["left & bottom", "left & bottom & front"], order=2, **box)
    edge, corner = (
        mesh.points[mesh.nodes_of(name)] for name in ("left & bottom", "left & bottom & front")
    )
    assert (
        (edge[:, [0, 2]] == 0.0).all() and len(edge) == 5 and corner.tolist() == [[0.0, 0.0, 0.0]]
    )
    plate = mesh_of(clamp=["left & bottom"], shape="rectangle", size=(1.0, 1.0), divisions=(2, 2))
    assert plate.points[plate.nodes_of("left & bottom")].tolist() == [[0.0, 0.0]]
    with pytest.raises(
        InputError, match=r"body.body.clamp: 'left' and 'right' have no node in common"
    ):
        mesh_of(clamp=["left & right"], **box)
    with pytest.raises(
        InputError, match=r"body.body.traction: 'left & bottom' is a physical curve .* only a clamp"
    ):
        mesh_of(traction=[Traction(on="left & bottom", pressure=1.0)], **box)
    with pytest.raises(
        InputError,
        match=r"body.body.clamp: the mesh has no boundary group 'botom'; did you mean 'bot",
    ):
        mesh_of(clamp=["left & botom"], **box)


def test_a_group_whose_name_has_signs_is_itself():
    """A mesh's own group "a+b" is not taken apart, and a facet of two groups counts once in both together."""
    mesh = mesh_of(shape="box", size=(1.0, 1.0, 1.0), divisions=(1, 1, 1))
    named = Mesh(
        mesh.points,
        mesh.triangles,
        mesh.groups | {"a+b": mesh.groups["left"], "twice": mesh.groups["left"]},
    )
    assert combined(named, "a+b") is named
    assert len(combined(named, "left+twice").groups["left+twice"]) == 2


@pytest.mark.slow
def test_balls_and_cylinders_have_their_volume_and_groups():
    """A ball, a pin and a tube in any direction have the groups and, as fine as asked, the volumes of their sizes."""
    near, order = 1e-3, 2
    ball = mesh_of(
        shape="ball", center=(1, 2, 3), radius=2.0, size=1.0, order=order, contacts=("surface",)
    )
    assert ball.groups.keys() == {"surface"}
    assert ball.measures().sum() == pytest.approx(32 / 3 * np.pi, rel=near)
    assert np.linalg.norm(
        ball.points[ball.nodes_of("surface")] - [1, 2, 3], axis=1
    ) == pytest.approx(2.0)
    place = {
        "shape": "cylinder",
        "center": (1, 0, 0),
        "axis": (0, 3, 4),
        "height": 2.0,
        "size": 0.5,
        "order": order,
    }
    pin, tube = mesh_of(radii=(0.0, 0.5), **place), mesh_of(radii=(0.4, 0.5), **place)
    assert pin.groups.keys() == {
        "bottom",
        "top",
        "outer",
    } and tube.groups.keys() == pin.groups.keys() | {"inner"}
    assert pin.measures().sum() == pytest.approx(np.pi / 2, rel=near)
    assert tube.measures().sum() == pytest.approx(0.18 * np.pi, rel=near)
    along = np.array([0.0, 0.6, 0.8])
    assert (tube.points[tube.nodes_of("bottom")] - [1, 0, 0]) @ along == pytest.approx(
        0.0, abs=1e-12
    )
    assert (tube.points[tube.nodes_of("top")] - [1, 0, 0]) @ along == pytest.approx(2.0)
    assert area(tube, "inner") == pytest.approx(1.6 * np.pi, rel=near)


BALL, BOX = (
    {"shape": "ball", "center": (0, 0, 0)},
    {"shape": "box", "size": (1, 1, 1), "divisions": (1, 1, 1)},
)
CYLINDER = {
    "shape": "cylinder",
    "center": (0, 0, 0),
    "axis": (0, 0, 1),
    "radii": (0, 1),
    "height": 1,
    "size": 1.0,
}


@pytest.mark.parametrize(
    ("keys", "words"),
    [
        (BALL | {"size": 1.0}, 'shape = "ball" needs center = .*; radius is missing'),
        (BALL | {"radius": 1.0, "size": (1.0, 1.0)}, "a ball has size = h, the largest"),
        (CYLINDER | {"axis": (0, 0, 0)}, "axis must not be zero"),
        (CYLINDER | {"radii": (2, 1)}, "must ascend"),
        (BOX | {"size_on": {"left": 1.0}}, 'size_on belongs to a geometry, not to shape = "box"'),
        (BOX | {"part": "a"}, "part belongs to a "),
        (BOX | {"radius": 1.0}, 'radius belongs to shape = "ball"'),
    ],
)
def test_keys_of_other_shapes_are_refused(keys, words):
    """A ball or a cylinder needs its keys, and no other shape has them."""
    with pytest.raises(ValueError, match=words):
        MeshSpec(**keys)
