"""`ddmpi check`: what it says and draws, the contacts that it proposes, and how it ends."""

import contextlib
import re
import tomllib
from types import SimpleNamespace

import numpy as np
import pytest
from mpi4py import MPI
from scenes import (
    FLOOR,
    ROOT,
    call,
    pinched_blocks,
    rectangle,
    run_python,
    seldom,
    to_toml,
    tower,
    write_scene,
)
from solid_scenes import HELD, box, two_boxes

from ddmpi.body.loads import VOLUME
from ddmpi.check.check import check
from ddmpi.check.drawing import Plan, _point_weights, as_results, draw, draw_contacts
from ddmpi.check.faces import _smooth
from ddmpi.check.nearby import NEAR, Boundary, Missing, _together, find_missing
from ddmpi.coupling.assembly import prepare
from ddmpi.errors import InputError, InterruptionError, NotConvergedError
from ddmpi.mesh.mesh import Face
from ddmpi.mesh.read import gmsh_session
from ddmpi.scene.reader import read_scene
from meshes import mesh_of


@pytest.fixture
def looked_at(tmp_path, caplog):
    """What `check` logs of a scene; with pictures in a folder `name`."""

    def look(scene: dict, name: str = "") -> str:
        caplog.set_level("INFO", "ddmpi")
        caplog.clear()
        with contextlib.suppress(NotConvergedError):
            check(
                MPI.COMM_SELF,
                read_scene("scene.toml", to_toml(scene)),
                str(tmp_path / "scene.toml"),
                str(tmp_path / name),
                bool(name),
            )
        return "\n".join(record.getMessage() for record in caplog.records)

    return look


def proposed(text: str) -> list[dict]:
    """The contacts in what `check` says."""
    lines = re.findall(r'^(?:\[\[contact\]\]|name = "|bodies = \[|on = \[).*', text, re.M)
    return tomllib.loads("\n".join(lines)).get("contact", [])


def sides(contacts: list[dict]) -> set[frozenset]:
    """The sides of contacts in any order: bodies with their groups."""
    return {frozenset(zip(each["bodies"], [*each["on"], ""], strict=False)) for each in contacts}


def boxes_on_floor() -> dict:
    """Three boxes in a row on a rigid plane, of other meshes each, and a box on top of two of them."""
    bodies = [
        box("a", (0, 0, 0), (1, 1, 1), (2, 2, 2)),
        box("b", (1, 0, 0), (1, 1, 1), (3, 3, 3)),
        box("c", (2, 0, 0), (1, 1, 1), (4, 2, 2)),
        box("d", (0.5, 0, 1), (1, 1, 1), (3, 2, 2)),
    ]
    return {
        "body": [each | {"clamp": [{"on": "front"} | HELD]} for each in bodies],
        "rigid": [{"name": "floor", "shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}],
        "contact": [
            *({"bodies": pair, "on": ["right", "left"]} for pair in (["a", "b"], ["b", "c"])),
            *({"bodies": ["d", name], "on": ["bottom", "top"]} for name in "ab"),
            *({"bodies": [name, "floor"], "on": ["bottom"]} for name in "abc"),
        ],
    }


def plug_in_ring() -> dict:
    """Around an axis, a plug on a rigid floor that a rigid stamp pushes, in a ring on springs that no contact names."""

    def turned(name: str, radius: float, **more) -> dict:
        return rectangle(name, (radius, 0), (10, 20), (4, 8), young=2.1e5, **more)

    def plane(name: str, y: float, normal: float, **more) -> dict:
        return {"name": name, "shape": "plane", "point": [0.0, y], "normal": [0.0, normal]} | more

    return {
        "axisymmetric": True,
        "body": [
            turned(
                "plug",
                0.0,
                traction=[{"on": "top", "force": [0.0, -100.0]}],
                volume_force=[0.0, -1e-3],
            ),
            turned("ring", 10.0, foundation=[{"on": "right", "normal": 1e3, "tangential": 10.0}]),
        ],
        "rigid": [plane("floor", 0.0, 1.0), plane("stamp", 20.0, -1.0, force=[0.0, -50.0])],
        "contact": [
            {"bodies": ["plug", "floor"], "on": ["bottom"]},
            {"bodies": ["plug", "stamp"], "on": ["top"]},
        ],
    }


@pytest.mark.slow
@pytest.mark.clarabel
def test_around_an_axis_with_springs_and_pushed_partners(looked_at, tmp_path):
    """Forces are of the whole circumference; what is not clamped is said to be held by springs, or loose."""
    pytest.importorskip("matplotlib")
    text = looked_at(plug_in_ring(), "out")
    for words in (
        "load on top: force (0, -100), moment 0",
        "loose: it can move along y",
        "foundation on right",
        "rigid stamp: pushed by (0, -50)",
        "forces in N,",
    ):
        assert words in text
    assert text.count("loose") == 1
    assert sides(proposed(text)) == {
        frozenset({("plug", "right"), ("ring", "left")}),
        frozenset({("ring", "bottom"), ("floor", "")}),
        frozenset({("ring", "top"), ("stamp", "")}),
    }
    names = {path.name for path in (tmp_path / "out").iterdir()}
    assert names == {"bodies.png", "contacts.png", "check.html", "costs.json"}


def test_nothing_is_factored():
    """A scene is assembled and paired as for a run, but no body can be solved with."""
    scene = read_scene("scene.toml", to_toml(two_boxes(2)))
    whole, seen = (prepare(MPI.COMM_SELF, scene, factor=factor) for factor in (True, False))
    assert not any(hasattr(body.member, "C") for body in seen.bodies)
    assert (seen.n, seen.m) == (whole.n, whole.m)
    assert [body.member.C.kind for body in whole.bodies] == [
        body.member.body.kind for body in seen.bodies
    ]


@pytest.mark.parametrize(
    ("scene", "order", "unit"),
    [
        seldom(tower(4, 3), 1, 1.0),
        seldom(tower(4, 3), -1, 1e-3),
        (boxes_on_floor(), 1, 1e-3),
        seldom(tower(4, 3), 1, 1e-3),
        seldom(tower(4, 3), -1, 1.0),
        seldom(boxes_on_floor(), 1, 1.0),
    ],
)
def test_contacts_that_are_missing_are_proposed(scene, order, unit, looked_at):
    """All but the first, by the names of their groups, in any unit and any order of bodies; none that is there."""
    scene = scene | {
        "body": [
            body
            | {
                "mesh": body["mesh"]
                | {
                    key: (unit * np.array(body["mesh"][key])).tolist()
                    for key in ("corners", "origin", "size")
                    if key in body["mesh"]
                }
            }
            for body in scene["body"]
        ][::order]
    }
    words = " and near it, where no contact names both; where they may touch, add"
    whole, first = (
        looked_at(scene | {"contact": scene["contact"][:number]}) for number in (None, 1)
    )
    assert not proposed(whole) and words not in whole
    assert sides(proposed(first)) == sides(scene["contact"][1:]) and words in first


@pytest.mark.parametrize(
    "gap, found", [(0.9 * NEAR, True), (1.1 * NEAR, False), seldom(-0.9 * NEAR, True)]
)
def test_what_lies_near_is_measured_by_the_smaller_facet(gap, found, looked_at):
    """Also where bodies overlap."""
    scene = tower(3, 4)
    top = scene["body"][2]["mesh"]
    top["corners"] = [[x, y + gap / 8] for x, y in top["corners"]]
    top["divisions"] = [24, 8]
    text = looked_at(scene | {"contact": scene["contact"][:1]})
    assert bool(proposed(text)) == found
    assert (f"block2 and block3 are {gap / 8:.3g} m apart at" in text) == found


def test_contacts_of_bricks_are_proposed(looked_at):
    """Two boxes of hexahedra on each other: the sides that meet, and no others."""
    bodies = [
        box("low", (0, 0, 0), (1, 1, 1), (2, 2, 2)),
        box("high", (0, 0, 1), (1, 1, 1), (3, 3, 3)),
    ]
    for body in bodies:
        body["mesh"]["elements"] = "bricks"
    text = looked_at({"body": bodies})
    assert sides(proposed(text)) == {frozenset({("low", "top"), ("high", "bottom")})}


def test_a_second_contact_of_two_bodies_has_a_name(looked_at):
    """Two contacts of the same bodies must be told apart, and so a scene with the lines is read."""
    scene = {
        "body": [
            box("slot", (0, 0, 0), (3, 1, 1), (6, 2, 2), clamp=[{"on": "bottom"} | HELD]),
            box("block", (0, 1, 0), (3, 1, 1), (6, 2, 2)),
        ],
        "rigid": [{"name": "wall", "shape": "plane", "point": [0, 0, 0], "normal": [1, 0, 0]}],
        "contact": [{"name": "block-wall", "bodies": ["slot", "wall"], "on": ["left"]}],
    }
    new = proposed(looked_at(scene))
    assert [each.get("name") for each in new] == [None, "block-wall-2"]
    assert not proposed(looked_at(scene | {"contact": scene["contact"] + new}))


def test_the_lines_quote_all_names():
    lack, taken = Missing(('a"b', "c"), ("\\x", "é"), np.empty(0), (0.0, 0.0), [{}, {}]), set()
    first, second = proposed(lack.lines(taken) + "\n" + lack.lines(taken))
    assert first == {"bodies": ['a"b', "c"], "on": ["\\x", "é"]} and second == first | {
        "name": 'a"b-c-2'
    }


@pytest.mark.slow
@pytest.mark.clarabel
def test_the_lines_mend_the_scene(tmp_path):
    """Pasted at the end of the file, they make of a scene without equilibrium one that has one."""
    path = ROOT / "configs" / "bolted_plates.toml"
    text = path.read_text(encoding="utf-8")
    start = text.index("[[contact]]", text.index("[[contact]]") + 1)
    broken = text[:start] + text[text.index("[history.tighten]") :]
    (tmp_path / "scene.toml").write_text(broken, encoding="utf-8")
    seen = call("check", str(tmp_path / "scene.toml"), "--no-figures")
    assert seen.code == 3
    lines = re.search(r"^\[\[contact\]\]\n.*\n.*\n", seen.stdout, re.M).group()
    (tmp_path / "scene.toml").write_text(f"{broken}\n{lines}", encoding="utf-8")
    assert call("check", str(tmp_path / "scene.toml"), "--no-figures").code == 0


def test_what_there_is_to_say(looked_at):
    """Resultants of the loads, clamps, what is loose, how contacts are paired, and thin cells."""
    scene = pinched_blocks(6)
    scene["body"][0]["clamp"] = [{"on": "left", "x": 0.0}]
    scene["body"][0]["volume_force"] = [0.0, -1e4]
    scene["body"][1]["mesh"]["divisions"] = [90, 2]
    scene["body"][1]["mesh"]["size"] = [0.3, 1.0]
    scene["contact"][0]["softness"] = 1e-12
    text = looked_at(scene)
    for words in (
        "load on top: force (0, -1.8e+08), moment -2.7e+08",
        "load on volume_force: force (0, -3e+04)",
        "loads in all: force (2e+07, -1.5e+08), moment -2.1e+08",
        "fixed along x on left",
        "loose: it can move along y",
        "fixed along x, y on left",
        "mortar, slave upper, law coulomb, a soft joint; ",
        "body.lower.mesh: 360 of 360 triangles are thin",
        "Newton",
    ):
        assert words in text


def test_clamps_along_normals_and_heat_are_told(looked_at):
    """What slides along its group, and how warm a body is."""
    scene = pinched_blocks(4)
    scene["body"][0]["clamp"] = [
        {"on": "left", "normal": 0.0},
        {"on": "right", "normal": 1e-3, "y": 0.0},
    ]
    scene["body"][1] |= {"temperature": "20 + 10 * x"}
    scene["body"][1]["material"] |= {"expansion": 1.2e-5}
    text = looked_at(scene)
    for words in (
        "fixed along its normal on left",
        "fixed along y, moved along its normal on right",
        "temperature 20 + 10 * x",
    ):
        assert words in text


def drawn_parts(tmp_path) -> dict:
    """A tube on a pin on a block, from one file: the faces of pin and tube are halves, as CAD programs draw them."""
    with gmsh_session() as gmsh:
        gmsh.option.setNumber("Geometry.OCCUnionUnify", 0)
        cad = gmsh.model.occ
        block = cad.addBox(-2, -2, -1, 4, 4, 1)
        pin = [cad.addCylinder(0, 0, 0, 0, 0, 2, 0.5, angle=np.pi) for _ in range(2)]
        tube = [cad.addCylinder(0, 0, 0, 0, 0, 1, r, angle=np.pi) for r in (1.0, 0.5, 1.0, 0.5)]
        cad.rotate([(3, pin[1]), (3, tube[2]), (3, tube[3])], 0, 0, 0, 0, 0, 1, np.pi)
        rings = [cad.cut([(3, tube[k])], [(3, tube[k + 1])])[0][0] for k in (0, 2)]
        cad.fuse([(3, pin[0])], [(3, pin[1])])
        cad.fuse([rings[0]], [rings[1]])
        cad.synchronize()
        gmsh.write(str(tmp_path / "all.step"))
    bodies = [
        {
            "name": name,
            "mesh": {
                "geometry": "all.step",
                "part": k,
                "size": 2.0,
                "contact_size": 1.0,
                "around": 9,
            },
            "material": {"young": 1.0, "poisson": 0.3},
        }
        | ({"clamp": [1]} if k == block else {})
        for k, name in enumerate(("block", "pin", "tube"), 1)
    ]
    return {
        "body": bodies,
        "rigid": [{"name": "wall", "shape": "plane", "point": [0, 0, -1], "normal": [0, 0, 1]}],
        "contact": [{"bodies": ["block", "wall"], "on": [[5]]}],
    }


@pytest.mark.parametrize("smooth, together", [({("1", "2"), ("2", "1")}, [2]), (set(), [1, 1])])
def test_halves_of_a_pin_and_its_bore_are_one_contact(smooth, together):
    """Whether the pin has other faces or none: all meet without a corner; with corners they are two."""
    face = Face("cylinder", 1.0, 1.0, (0.0, 0.0, 0.0))
    empty = np.empty(0)
    pin, block = (
        Boundary(empty, empty, empty, {}, dict.fromkeys(faces, face), smooth)
        for faces in ("12", "123")
    )
    pairs = [("1", "2"), ("2", "1")]
    for bodies in [(pin, block), (block, pin)]:
        assert [len(some) for some in _together(pairs, bodies)] == together


@pytest.mark.slow
def test_numbered_faces_are_told_and_proposed(looked_at, tmp_path):
    """Faces of a drawing without names: number, kind and size; those of one contact are proposed together."""
    scene = drawn_parts(tmp_path)
    text = looked_at(scene)
    for words in (
        r"\n    5: plane, normal -z, 16 m², about \(0, 0, -1\), or 'plane n=\(0, 0, -1\) at \(0, 0, -1\)'\n",
        r"\n    \d+: cylinder, r 1, 3.142 m²",
        r"\n    \d+: cylinder, r 0.5, hollow, 1.571 m²",
        r"; groups by number\n",
    ):
        assert re.search(words, text), words
    lines = text[text.index("# block and pin") :]
    assert len(tomllib.loads(lines.partition("\nbody.")[0])["contact"]) == 3
    new = proposed(lines)
    assert [each["bodies"] for each in new] == [
        ["block", "pin"],
        ["block", "tube"],
        ["pin", "tube"],
    ]
    faces = [[on if isinstance(on, list) else [on] for on in each["on"]] for each in new]
    assert [[len(on) for on in pair] for pair in faces] == [[1, 2], [1, 2], [2, 2]]
    assert not proposed(looked_at(scene | {"contact": scene["contact"] + new}))


@pytest.mark.slow
def test_contacts_are_proposed_for_loose_bodies_without_any(looked_at, tmp_path):
    """The first look at an assembly: no contact yet, and nothing is clamped."""
    scene = drawn_parts(tmp_path)
    scene = {
        "body": [body | {"clamp": [], "volume_force": [0.0, 0.0, 0.0]} for body in scene["body"]]
    }
    text = looked_at(scene)
    assert len(proposed(text)) == 3 and text.count("it can move freely, whatever touches") == 3


@pytest.mark.slow
def test_numbered_faces_are_drawn(looked_at, tmp_path):
    """Each body with numbered faces from both sides; solids are seen from behind as from the front."""
    image = pytest.importorskip("matplotlib.image")
    scene = drawn_parts(tmp_path)
    looked_at(scene | {"body": scene["body"][:1]}, "out")
    names = {path.name for path in (tmp_path / "out").glob("*.png")}
    assert names >= {"bodies.png", "bodies_behind.png", "faces_block.png", "faces_block_behind.png"}
    drawn = {
        name: image.imread(tmp_path / "out" / name)[..., :3] for name in names - {"check.html"}
    }
    for name in drawn.keys() - {"contacts.png"}:
        assert (drawn[name].min(axis=2) < 0.9).mean() > 0.1, name
    # the clamped face x = -2 is on the left, so its marks are seen from behind alone: a green that nothing else has
    green = {
        name: (np.abs(seen - [0.12, 0.435, 0.29]).max(axis=2) < 0.05).sum()
        for name, seen in drawn.items()
    }
    assert green["bodies_behind.png"] > 2 * green["bodies.png"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "scene",
    [
        pinched_blocks(4),
        two_boxes(2, 3),
        two_boxes(2) | {"output": {"cut": {"y": 1.5}, "view": [-60.0, 24.0]}},
    ],
)
def test_pictures(scene, looked_at, tmp_path):
    """They are drawn with missing contacts, too, and nothing is overwritten."""
    pytest.importorskip("matplotlib")
    scene["body"].append(scene["body"][1] | {"name": "third"})
    looked_at(scene, "out")
    solid = {"bodies_behind.png"} if scene["body"][0]["mesh"]["shape"] == "box" else set()
    assert {path.name for path in (tmp_path / "out").iterdir()} == {
        "bodies.png",
        "contacts.png",
        "check.html",
        "costs.json",
    } | solid
    with pytest.raises(InputError, match="name a new folder"):
        looked_at(scene, "out")


def test_a_check_that_is_interrupted_has_nothing_to_save(monkeypatch):
    from ddmpi.cli import commands

    def ends(*_):
        raise InterruptionError("SIGTERM")

    monkeypatch.setattr(commands, "_run", ends)
    with pytest.raises(InterruptionError, match=r"^before the check was done$"):
        commands.COMMANDS["check"](None, SimpleNamespace(output=None), [])


@pytest.mark.slow
def test_ranks_and_ends(tmp_path):
    """On any number of ranks it says the same, but for costs; scenes that are wrong end as a run of them does."""
    path, said = str(write_scene(two_boxes(2, 3), tmp_path / "scene.toml")), {}
    for ranks, run in (
        (1, call("check", path, "--no-figures")),
        (3, run_python(["-m", "ddmpi", "check", path, "--no-figures"], 3)),
    ):
        assert (run.code, run.own_stderr) == (0, "")
        costs = r"^(memory of a run|time of a run|disk for its results|in a batch): .*$|ranks: \d"
        said[ranks], number = re.subn(costs, "", run.stdout, flags=re.M)
        assert number == 5
    assert said[1] == said[3]
    for setting in ('contact.0.on=["front", "nowhere"]', "body.upper.material.poisson=0.7"):
        ends = []
        for command in ("run", "check"):
            run = call(command, path, "--output", str(tmp_path / "out"), "--set", setting)
            ends.append((run.code, run.messages))
        assert ends[0] == ends[1]
        assert ends[0][0] == 2
    assert not (tmp_path / "out").exists()


def facing(unit: float, part: float) -> dict:
    """Two bodies whose facets, 8 and 6 long, are a part of the smaller one apart."""
    sizes = {"lower": (8.0, 5.0), "upper": (6.0, 5.0)}
    low = {"lower": (0.0, 0.0), "upper": (1.0, 5.0 + 6.0 * part)}
    bodies = [
        rectangle(
            name,
            [unit * place for place in low[name]],
            [unit * size for size in sizes[name]],
            (1, 1),
            clamp=["bottom" if name == "lower" else "top"],
        )
        for name in sizes
    ]
    return {"body": bodies}


@pytest.mark.every(5)
@pytest.mark.parametrize("unit", [1.0, 1e3, 1e-3])
@pytest.mark.parametrize("part", [0.2499, 0.2501])
def test_sides_are_proposed_as_far_as_a_quarter_of_the_smaller_facet(unit, part, looked_at):
    """In any unit."""
    both = {frozenset({("lower", "top"), ("upper", "bottom")})}
    assert sides(proposed(looked_at(facing(unit, part)))) == (both if part < 0.25 else set())


@pytest.mark.parametrize(
    "part, words", [(0.2499, ["close enough to touch, in no contact (1)"]), (0.2501, [])]
)
def test_the_picture_of_contacts_counts_those_that_are_missing(part, words, looked_at, monkeypatch):
    """In its legend, which there is only if one is missing."""
    pytest.importorskip("matplotlib")
    figures = []

    def draw(_, scene, bodies, interfaces, missing, *ranks) -> list[str]:
        results = as_results(scene, bodies, interfaces)
        figures.append(draw_contacts(results, interfaces, missing))
        return []

    monkeypatch.setattr("ddmpi.check.check.draw", draw)
    looked_at(facing(1.0, part), "out")
    legends = [axes.get_legend() for axes in figures[0].axes]
    assert [text.get_text() for legend in legends if legend for text in legend.get_texts()] == words


@pytest.mark.parametrize("dimension", [2, 3])
def test_faces_are_numbered_of_drawings_that_are_no_copies(monkeypatch, tmp_path, dimension):
    """A copy has the numbers of its original; those of solids are drawn from both sides."""
    pytest.importorskip("matplotlib")
    monkeypatch.setattr("ddmpi.check.drawing.as_results", lambda *given: None)
    copies = {"shaft": None, "pin": "shaft", "plate": None}
    bodies = {
        name: SimpleNamespace(mesh=SimpleNamespace(faces={1: "a face"} if name != "plate" else {}))
        for name in copies
    }
    scene = SimpleNamespace(
        dimension=dimension,
        contact=[],
        body=[SimpleNamespace(name=name, copy=of) for name, of in copies.items()],
    )
    everything = 99  # the pictures from this one on, which are none
    names = draw(tmp_path, scene, bodies, [], [], everything)
    faces = ["faces_shaft.png", "faces_shaft_behind.png"]
    assert [name for name in names if name.startswith("faces")] == faces[: dimension - 1]


def test_pictures_of_a_check_have_all_bodies_where_they_are():
    """The cells of each body have its own points, and are as large as it is; nothing has moved."""
    settled = read_scene("scene.toml", to_toml(two_boxes(2, 1)))
    assembly = prepare(MPI.COMM_SELF, settled, factor=False)
    bodies = {body.spec.name: SimpleNamespace(mesh=body.mesh) for body in assembly.bodies}
    fields = as_results(settled, bodies, []).fields
    assert not fields["displacement"].any()
    for k, body in enumerate(bodies.values()):
        cells = fields["cells"][fields["body"] == k]
        drawn = fields["points"][cells]
        assert (drawn == body.mesh.points[body.mesh.triangles]).all()


def test_sides_without_names_end_at_hollow_corners_too():
    """The outline of an angle, two facets a side, which turns to either hand at its corners, has six sides."""
    corners = np.array([[0, 0], [4, 0], [4, 1], [1, 1], [1, 3], [0, 3]], float)
    points = np.stack([corners, (corners + np.roll(corners, -1, axis=0)) / 2], axis=1).reshape(
        -1, 2
    )
    facets = np.column_stack([np.arange(12), np.roll(np.arange(12), -1)])
    along = points[facets[:, 1]] - points[facets[:, 0]]
    normal = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    boundary = SimpleNamespace(facets=facets, at=points[facets], normal=normal)
    number = _smooth(boundary, np.ones(12, bool))
    assert (number[::2] == number[1::2]).all() and len(set(number[::2])) == 6


def test_marks_of_supports_stand_where_they_are_seen():
    """By their first two coordinates in the picture."""
    drawn: list[tuple] = []
    axes = SimpleNamespace(plot=lambda *given, **_: drawn.append(given))
    plan = SimpleNamespace(axes=axes, place=lambda at: 2.0 * at, shows=lambda at: at[:, 2] > 0.0)
    Plan.mark(plan, np.array([[1.0, 2.0, 3.0], [4.0, 5.0, -6.0], [7.0, 8.0, 9.0]]), "s")
    ((x, y, marker),) = drawn
    assert (x.tolist(), y.tolist(), marker) == ([2.0, 14.0], [4.0, 16.0], "s")


def test_arrows_of_volume_forces_are_of_one_length():
    """From the middles of bodies along their forces, whatever these are: a small part of the picture's width."""
    drawn: list[tuple] = []
    plan = SimpleNamespace(size=50.0, arrows=lambda *given: drawn.append(given[:2]))
    nodal = np.array([[[0.0, -1e-3], [0.0, -3e-3]], [[1e4, 4e4], [2e4, 0.0]]])  # of two nodes each
    bodies = [SimpleNamespace(loads=[("top", f[::-1] ** 2), (VOLUME, f)]) for f in nodal]
    inside = np.array([[1.0, 2.0], [3.0, 4.0]])
    assert _point_weights(plan, bodies, inside)
    tails, along = (np.concatenate(each) for each in zip(*drawn, strict=True))
    length = np.linalg.norm(along, axis=1)
    assert tails.tolist() == inside.tolist()
    assert along / length[:, None] == pytest.approx(np.array([[0.0, -1.0], [0.6, 0.8]]), abs=1e-9)
    assert length[0] == pytest.approx(length[1]) and 0.02 < length[0] / plan.size < 0.2


ON_A_PLANE = {
    "body": [rectangle("block", (0.0, 0.0), (1.0, 1.0), (1, 1), clamp=["top"])],
    "rigid": [FLOOR],
    "contact": [{"bodies": ["block", "floor"], "on": ["bottom"]}],
}


def test_what_a_contact_leaves_of_two_sides_is_missing():
    """Of two halves that face one side, the one that the contact does not name; whichever body comes first."""
    lower = mesh_of(shape="rectangle", origin=(0.0, 0.0), size=(2.0, 1.0), divisions=(4, 1))
    upper = mesh_of(shape="rectangle", origin=(0.0, 1.0), size=(2.0, 1.0), divisions=(4, 1))
    top = lower.groups["top"]
    left = (lower.points[top][:, :, 0] <= 1.0).all(axis=1)
    groups = {**lower.groups, "left half": top[left], "right half": top[~left]}
    del groups["top"]
    lower = lower.regrouped(groups, lower.curves, lower.vertices)
    boundaries = {"lower": Boundary.of(lower), "upper": Boundary.of(upper)}
    contact = SimpleNamespace(bodies=("upper", "lower"), on=("bottom", "left half"))
    for some in (boundaries, dict(reversed(boundaries.items()))):
        (missing,) = find_missing(some, [], [contact])
        assert {*zip(missing.bodies, missing.on, strict=True)} == {
            ("lower", "right half"),
            ("upper", "bottom"),
        }


def test_a_body_on_the_middle_of_a_large_facet_is_found():
    """No middle of the larger body's facets is before it; whichever body comes first."""
    base = mesh_of(shape="rectangle", origin=(0.0, 0.0), size=(8.0, 1.0), divisions=(2, 1))
    small = mesh_of(shape="rectangle", origin=(1.0, 1.0), size=(0.5, 0.5), divisions=(2, 2))
    boundaries = {"base": Boundary.of(base), "small": Boundary.of(small)}
    for some in (boundaries, dict(reversed(boundaries.items()))):
        (missing,) = find_missing(some, [], [])
        assert {*zip(missing.bodies, missing.on, strict=True)} == {
            ("base", "top"),
            ("small", "bottom"),
        }


def test_the_ends_of_an_open_ring_face_each_other():
    """A contact of a body with itself is missing, with the gap of the ends; it is not where the scene has it."""
    ring = {"center": (3.0, -1.0), "radii": (5.0, 6.0), "angles": (0.0, 359.0)}
    mesh = mesh_of(shape="annulus", divisions=(90, 2), **ring)
    some = {"ring": Boundary.of(mesh)}
    (missing,) = find_missing(some, [], [])
    assert missing.bodies == ("ring", "ring") and {*missing.on} == {"start", "end"}
    # from the middles of the facets of one end to the nearest points of the other, along the normals of the first
    across = np.sin(np.radians(1.0)) * np.cos(np.radians(1.0))
    assert missing.gap == pytest.approx((5.25 * across, 5.75 * across), rel=1e-9)
    contact = SimpleNamespace(bodies=("ring", "ring"), on=("end", "start"))
    assert not [*find_missing(some, [], [contact])]


def test_the_least_and_the_largest_gap_of_a_missing_contact():
    """A block over a plane, whose bottom rises: gaps are those of the middles of its facets, along their normals."""
    corners = ((0.0, 0.01), (1.0, 0.05), (1.0, 1.0), (0.0, 1.0))
    mesh = mesh_of(shape="quadrilateral", corners=corners, divisions=(4, 4))
    settled = read_scene("a scene", to_toml(ON_A_PLANE))
    (missing,) = find_missing({"block": Boundary.of(mesh)}, settled.rigid, [])
    assert missing.bodies == ("block", "floor") and missing.on[0] == "bottom"
    along = 1.0 / np.hypot(1.0, 0.04)  # the normals of the facets
    assert missing.gap == pytest.approx((0.015 * along, 0.045 * along), rel=1e-9)
