"""check.html: parts that are turned, taken apart and clicked, and the lines that it gives for a scene."""

import json
import re
import tomllib
from unittest import mock

import numpy as np
import pytest
from browser import in_browser, opened, unpacked
from scenes import call, pinched_blocks, run_python, seldom, to_toml, write_scene
from solid_scenes import two_boxes
from test_check import drawn_parts, plug_in_ring

from ddmpi.check import page
from ddmpi.check.faces import describe_face, face_of, pieces_of
from ddmpi.check.nearby import Boundary
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import gmsh_session
from ddmpi.pictures.browser import RIBBON
from ddmpi.pictures.script import digest, our_digest
from meshes import cad, drawn, mesh_of

RING = {
    "center": (0.0, 0.0),
    "radii": (1.0, 2.0),
    "angles": (0.0, 270.0),
    "divisions": (24, 3),
}


def drawn_too(scene: dict, folder) -> tuple[dict, dict]:
    """The head and the arrays of the page of a scene."""
    run = call("check", str(write_scene(scene, folder / "scene.toml")), "--output", f"{folder}/out")
    assert f"to turn, take apart and click: {folder}/out/check.html" in run.stdout, run.messages
    return unpacked(folder / "out" / "check.html")


def checked(scene: dict, folder) -> tuple[dict, dict]:
    """The same without the pictures beside it."""
    with mock.patch("ddmpi.check.check.draw", return_value=[]):
        return drawn_too(scene, folder)


def in_file(folder) -> dict:
    """A box of a mesh file whose groups share facets, and leave some without a name; another of bricks on it."""
    with gmsh_session() as gmsh:
        gmsh.model.occ.addBox(0, 0, 0, 1, 1, 1)
        gmsh.model.occ.synchronize()
        for name, faces in {"left": [1], "sides": [1, 2, 3], "lid": [6]}.items():
            gmsh.model.addPhysicalGroup(2, faces, name=name)
        gmsh.model.addPhysicalGroup(3, [1], name="all")
        gmsh.option.setNumber("Mesh.MeshSizeMax", 0.4)
        gmsh.model.mesh.generate(3)
        gmsh.write(str(folder / "box.msh"))
    scene = two_boxes(2)
    lower, upper = scene["body"]
    lower |= {"mesh": {"file": str(folder / "box.msh")}, "clamp": ["left"], "traction": []}
    mesh = {"shape": "box", "origin": [0, 0, 1], "size": [1, 1, 1], "divisions": [2, 2, 2]}
    upper |= {"mesh": mesh | {"elements": "bricks"}, "clamp": ["top"], "traction": []}
    return {"body": [lower, upper]}


SCENES = {
    "plane": lambda folder: pinched_blocks(4),
    "quadratic": lambda folder: {
        **(made := pinched_blocks(4)),
        "contact": [],
        "method": made["method"],
    },
    "axis": lambda folder: plug_in_ring(),
    "space": lambda folder: two_boxes(2),
    "drawing": lambda folder: {"body": drawn_parts(folder)["body"][:1]},
    "file": in_file,
}


@pytest.mark.slow
@pytest.mark.parametrize("kind", SCENES)
def test_lines_that_are_pasted_are_accepted(kind, tmp_path):
    """Each line, in the place that its words name, makes a scene that check accepts."""
    scene = SCENES[kind](tmp_path)
    head, _ = checked(scene, tmp_path)
    named = [piece for piece in head["pieces"] if piece["paste"]]
    some = (*named[:2], *named[-2:])
    lines = [(piece["body"], *line) for piece in some for line in piece["paste"]]
    assert {words.partition(",")[0] for _, words, _ in lines} >= {"to clamp it", "to load it"}
    for body, words, line in dict.fromkeys(lines):
        data, new = tomllib.loads(to_toml(scene)), tomllib.loads(line)
        if words.endswith("end"):
            data["contact"] = data.get("contact", []) + new["contact"]
        else:
            assert words.endswith(f"in {body}")
            next(each for each in data["body"] if each["name"] == body).update(new)
        run = call("check", str(write_scene(data, tmp_path / "new.toml")), "--no-figures")
        assert run.code in (0, 3), (words, line, run.messages)


def test_a_click_tells_what_a_side_is_and_does(tmp_path):
    """Names, kind, size, supports, loads, contacts, and those that are missing."""
    scene = pinched_blocks(4)
    scene["contact"], scene["body"][1]["clamp"] = [], [{"on": "left", "x": 0.0}]
    head, arrays = checked(scene, tmp_path)
    told = {f"{piece['body']}.{piece['name']}": piece for piece in head["pieces"]}
    assert told["upper.left"]["told"][0].startswith("line, normal -x, ")
    assert "fixed along x, y" in told["upper.left"]["told"]
    assert any(words.startswith("load: force") for words in told["upper.top"]["told"])
    assert dict(told["lower.left"]["paste"])["to clamp it, in lower"] == 'clamp = ["left"]'
    assert dict(told["lower.right"]["paste"])["to clamp it, in lower"] == (
        'clamp = [\n    { on = "left", x = 0.0 },\n    "right",\n]'
    )
    missing = 'bodies = ["upper", "lower"]\non = ["bottom", "top"]'
    assert (
        missing
        in dict(told["upper.bottom"]["paste"])["for a contact of upper and lower, at the end"]
    )
    role = {name: k for k, name in enumerate(page.ROLES)}
    of = {
        name: round(arrays["role0"][arrays["face"] == number].max())
        for number, name in enumerate(told, 1)
    }
    assert of["upper.bottom"] == role["may touch"] and of["upper.left"] == role["held"]
    assert of["upper.top"] == role["loaded"]


def test_a_face_that_is_clamped_by_its_number_is_clamped_once(tmp_path):
    """The line by what it is takes the place of that by its number."""
    scene = SCENES["drawing"](tmp_path)
    scene["body"][0]["clamp"] = [{"on": 1, "x": 0.01}]
    (one,) = (piece for piece in checked(scene, tmp_path)[0]["pieces"] if piece["name"] == "1")
    (line,) = (line for words, line in one["paste"] if words.startswith("to clamp it"))
    assert tomllib.loads(line) == {"clamp": [tomllib.loads(f"on = {one['on']}")["on"]]}


def test_groups_that_share_facets_are_told_of_each(tmp_path):
    """Facets in two groups are a piece of their own, named by the smaller; facets in none say so."""
    head, arrays = checked(in_file(tmp_path), tmp_path)
    mesh = [piece for piece in head["pieces"] if piece["body"] == head["pieces"][0]["body"]]
    told = {piece["name"]: piece["told"] for piece in mesh}
    # sides 2 and 3 are one piece, the two faces without a name are two
    assert sorted(piece["name"] for piece in mesh) == ["left", "lid", *["no name"] * 2, "sides"]
    assert "may touch here: 0 m apart" in told["lid"][-1]
    assert told["left"][0] == "also in sides" and "give it one in the mesh" in told["no name"][0]
    assert told["lid"][0] == "plane, normal +z, 1 m², about (0.5, 0.5, 1)"
    assert not next(piece for piece in mesh if piece["name"] == "no name")["paste"]
    assert len(arrays["points"]) == 3 * len(arrays["face"]) and arrays["face"].min() == 1


@pytest.mark.parametrize("order", [1, seldom(2)])
def test_faces_without_a_drawing_have_a_kind(order, tmp_path):
    """Circles, cylinders and spheres are found by their nodes; what is none of these is curved."""
    ring = mesh_of(order, shape="annulus", **RING)
    path = cad(tmp_path / "pin.step", lambda cad: cad.addCylinder(0, 0, 0, 1, 2, 3, 0.5))
    ball = cad(tmp_path / "ball.step", lambda cad: cad.addSphere(1, 2, 3, 0.7))
    cone = cad(tmp_path / "cone.step", lambda cad: cad.addCone(0, 0, 0, 0, 0, 1, 1.0, 0.5))
    solids = [drawn(each, 0.3, order=order) for each in (path, ball, cone)]
    found = []
    for mesh in (ring, *solids):
        boundary = Boundary.of(mesh)
        groups = [some for name, some in boundary.groups.items() if name in boundary.simple]
        for some in groups:
            face = face_of(boundary, some)
            found.append((face.kind, round(face.radius, 2)))
            assert describe_face(boundary, some, face, "m").startswith(face.kind)
    assert set(found) == {
        ("line", 0.0),
        ("circle", 1.0),
        ("circle", 2.0),
        ("cylinder", 0.5),
        ("plane", 0.0),
        ("sphere", 0.7),
        ("curved", 0.0),
    }


def test_pieces_are_all_of_the_boundary():
    """Each facet is of one piece; a boundary without groups has a piece for each side."""
    mesh = mesh_of(shape="box", origin=(0.0, 0.0, 0.0), size=(1.0, 1.0, 1.0), divisions=(2, 2, 2))
    boundary = Boundary.of(mesh)
    pieces = pieces_of("box", boundary)
    facets = np.sort(np.concatenate([piece.some for piece in pieces]))
    assert len(pieces) == 6 and (facets == np.arange(len(boundary.facets))).all()
    alone = pieces_of("box", Boundary.of(Mesh(mesh.points, mesh.triangles, {})))
    assert len(alone) == 6 and {piece.on for piece in alone} == {None}
    assert [len(piece.some) for piece in alone] == [8] * 6


def test_ribbons_lie_inside_of_bodies_in_the_plane(tmp_path):
    """Along their boundary, as wide as a part of the scene's extent, above the cells."""
    _, arrays = checked(pinched_blocks(4), tmp_path)
    points = np.reshape(arrays["points"], (-1, 3))
    width = RIBBON * 3.0
    on_ribbons = points[:, 2] > 0.0
    assert points[on_ribbons, 2] == pytest.approx(np.full(on_ribbons.sum(), 0.3 * width), rel=1e-2)
    x, y = points[on_ribbons, :2].T
    off = np.minimum.reduce([x, 3.0 - x, y, 2.0 - y, np.abs(1.0 - y)])
    far = np.abs(off - width) < 1e-2 * width
    assert (far | (np.abs(off) < 1e-2 * width)).all()
    # but for both ends of each of eight sides
    assert 2 * (far.sum() + 16) == on_ribbons.sum()


def test_parts_come_apart_in_the_plane_and_around_an_axis(tmp_path):
    """Along the normal of their contact; rings along the axis."""
    (tmp_path / "axis").mkdir()
    upper, lower = checked(pinched_blocks(4), tmp_path)[0]["shifts"]
    assert upper[1] > 0.0 > lower[1] and upper[0] == pytest.approx(0.0) and not upper[2]
    scene = plug_in_ring()
    scene["contact"] = [{"bodies": ["plug", "ring"], "on": ["right", "left"]}]
    plug, ring, *_ = checked(scene, tmp_path / "axis")[0]["shifts"]
    assert plug[1] - ring[1] == pytest.approx(22.0) and plug[0] == ring[0] == 0.0


def test_a_page_of_a_large_mesh_is_coarsened(tmp_path, monkeypatch):
    """It has at most so many triangles, says so, and still has all pieces."""
    monkeypatch.setattr(page, "MOST", 100)
    head, arrays = checked(two_boxes(4), tmp_path)
    assert len(arrays["facets"]) // 3 <= 100 and set(arrays["face"]) == set(range(1, 13))
    assert re.search(r"; coarsened from 896 to \d+ triangles$", head["words"])
    assert len(arrays["face"]) == len(arrays["owner"]) == len(arrays["points"]) // 3


def test_names_in_a_page_are_data(tmp_path):
    """The page has the one script of views, and no tag of a name."""
    scene = pinched_blocks(2) | {"title": "</script><script>alert(1)</script>"}
    scene["body"][0]["name"] = scene["contact"][0]["bodies"][0] = "<img>&lt;\"'"
    checked(scene, tmp_path)
    text = (tmp_path / "out" / "check.html").read_text(encoding="utf-8")
    assert digest(text) == our_digest() and f"script-src {our_digest()}" in text
    assert "<img" not in text and text.count("<script") == 3


@pytest.mark.slow
def test_without_matplotlib_there_is_the_page(tmp_path):
    """It says what to install for pictures."""
    hidden = "import sys; sys.modules['matplotlib'] = None; from ddmpi.cli.main import main; main()"
    scene = write_scene(pinched_blocks(2), tmp_path / "scene.toml")
    run = run_python(
        ["-c", hidden, "check", str(scene), "--output", str(tmp_path / "out")],
        1,
        folder=tmp_path / "out",
    )
    assert run.code == 0 and run.files == {"check.html", "costs.json"}, run.output
    assert "no pictures: matplotlib is not installed" in run.output


@pytest.mark.slow
@in_browser
@pytest.mark.parametrize("kind", ["plane", "axis", "space"])
def test_a_browser_shows_the_face_that_is_clicked(kind, tmp_path):
    """Through the real page: a click, a drag, which is no click, another click, bodies apart."""
    head, _ = checked(SCENES[kind](tmp_path), tmp_path)
    with opened(tmp_path / "out" / "check.html", "#look") as shown:
        before = shown.wait("document.body.dataset.sum")
        box = "document.querySelector('#piece')"
        assert shown.tell(f"{box}.hidden") and "as drawn; click a face" in shown.tell(
            "document.body.innerText"
        )
        where = shown.tell(
            "const [x, y, m] = frame(), t = matrix(), found = {}, w = canvas.clientWidth, h = canvas.clientHeight;"
            "for (let i = 4; i < w - 310; i += 9) for (let j = 80; j < h - 170; j += 9) {"
            "const k = piece_at(i, j); if (k) (found[k] = found[k] || []).push([i, j]); }"
            "return Object.entries(found).map(([k, at]) => [+k, ...at[Math.floor(at.length / 2)]])"
        )
        assert len(where) >= 3
        for number, *at in where[:3]:
            shown.pointer(at)
            piece = head["pieces"][number - 1]
            text = shown.tell(f"{box}.innerText")
            assert text.startswith(f"{piece['body']}: {piece['name']}"), (text, number)
            assert all(words in text for words in piece["told"])
        shown.pointer((100, 400), (160, 400))
        assert shown.tell(f"{box}.innerText") == text
        if kind != "plane":
            assert shown.tell("document.body.dataset.sum") != before
        turned = shown.tell("document.body.dataset.sum")
        shown.set("apart", 1)
        assert shown.tell("document.body.dataset.sum") != turned


@pytest.mark.slow
@in_browser
def test_two_clicks_give_the_lines_of_a_contact(tmp_path):
    """Of the sides that were clicked one after the other, with a name if there is a contact of both bodies."""
    scene = pinched_blocks(4)
    for contact in ([], [scene["contact"][0] | {"on": ["left", "left"]}]):
        (folder := tmp_path / str(len(contact))).mkdir()
        head, _ = checked(scene | {"contact": []}, folder)
        names = [f"{piece['body']}.{piece['name']}" for piece in head["pieces"]]
        with opened(folder / "out" / "check.html") as shown:
            shown.wait("document.querySelector('form label')")
            shown.tell(f"head.names = {json.dumps(['upper-lower'] * len(contact))}; return 0")
            for side in ("upper.bottom", "lower.top"):
                shown.tell(f"look_at({1 + names.index(side)}); return 0")
            line = shown.tell("[...document.querySelectorAll('pre')].pop().innerText")
        (new,) = tomllib.loads(line)["contact"]
        name = {"name": "upper-lower-2"} if contact else {}
        assert new == {"bodies": ["upper", "lower"], "on": ["bottom", "top"]} | name
        path = write_scene(scene | {"contact": [new]}, folder / "new.toml")
        assert call("check", str(path), "--no-figures").code == 0
