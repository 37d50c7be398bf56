"""Answers that mean nothing are refused, not certified, or come with a warning that has the number in it."""

import re
from pathlib import Path
from types import SimpleNamespace

import made_up_solids
import numpy as np
import pytest
import scenes
import solid_scenes
from boundaries import rectangle, write_msh
from mpi4py import MPI
from scenes import COULOMB, FLOOR, Run, confined_blocks, pinched_blocks, sheared_stack

import ddmpi
from ddmpi.judge import plausible
from ddmpi.judge.plausible import LIMIT, _held_through_air, _singular
from ddmpi.mesh.mesh import Mesh

pytestmark = pytest.mark.slow


def run(scene: dict, folder, *arguments: str) -> Run:
    path = scenes.write_scene(scene, folder / "scene.toml")
    return scenes.run_here(path, folder / "out", "--no-figures", *arguments)


def warnings_of(done: Run) -> list[str]:
    """The warnings of a certified run, which stand once on stderr and once in the summary."""
    assert done.code == 0, done.output
    found = done.summary["warnings"]
    for warning in found:
        assert done.stderr.count(f"ddmpi: warning: {warning}\n") == 1
        assert warning not in done.stdout
    assert done.stderr.count("ddmpi: warning: ") == len(found)
    return found


def block(name: str, x: float, y: float, size, clamp, traction=(), divisions=(8, 8)) -> dict:
    return scenes.rectangle(name, (x, y), size, divisions, young=2e11, clamp=clamp, traction=list(traction))


def pair_of(upper: dict, lower: dict, friction: dict = COULOMB) -> dict:
    return {"body": [upper, lower], "contact": [{"bodies": [upper["name"], lower["name"]], "on": ["bottom", "top"],
                                                 "friction": friction}]}


# Before anything is computed


def test_sides_that_turn_their_backs_are_refused(tmp_path):
    """Names of `on` in the wrong order mean two metres of overlap in blocks of one metre: no contact can mean that."""
    done = run(pinched_blocks(6), tmp_path, "--set", 'contact.0.on=["top", "bottom"]')
    assert done.code == 2
    assert len(done.messages) == 1
    for words in ("contact.upper-lower", "overlap by 2 m,", "'upper' (1 m)", "order of `bodies`"):
        assert words in done.messages[0]


@pytest.mark.parametrize(("overlap", "warned"), [(0.5, True), (0.05, True), (0.001, False)])
def test_a_large_initial_overlap_is_a_warning_and_every_one_is_in_the_plan(tmp_path, overlap, warned):
    """A body placed half inside the other is solved, but not without a word."""
    scene = pair_of(block("upper", 0.0, 1.0 - overlap, (1, 1), ["top"]), block("lower", 0.0, 0.0, (1, 1), ["bottom"]))
    done = run(scene, tmp_path)
    assert f"upper-lower: initial overlap up to {overlap:g} m\n" in done.stdout
    found = [warning for warning in warnings_of(done) if "at first" in warning]
    assert len(found) == warned
    assert all(f"overlap by {overlap:g} m at first, {overlap:.1%} of the thinner one's depth" in each for each in found)


def test_a_component_that_is_clamped_twice_differently_is_refused(tmp_path):
    """Two clamps of one group that fix different components, or give one the same value, are fine."""
    scene = pinched_blocks(4)
    scene["body"][0]["clamp"] = [{"on": "left", "x": 0.0}, {"on": "left", "y": 0.0}, "left"]
    assert warnings_of(run(scene, tmp_path)) == []
    scene["body"][0]["clamp"] = ["left", {"on": "top", "x": 1e-3}]
    done = scenes.run_here(scenes.write_scene(scene, tmp_path / "twice.toml"), tmp_path / "twice")
    assert done.code == 2
    assert "body.upper.clamp: x at (0, 2) is prescribed twice, as 0 and, on 'top', as 0.001" in done.messages[0]


@pytest.mark.parametrize("below", [8, 7], ids=["pairs", "mortar"])
@pytest.mark.parametrize(("approach", "gap"), [(0.0, None), (0.05, None), (0.0, -1e-5)])
def test_clamps_that_push_bodies_into_each_other_are_refused(tmp_path, below, approach, gap):
    """No force can keep apart what clamps of both bodies move; a fit that they keep is certified."""
    upper = block("upper", 0.0, 1.0, (2, 1), [{"on": on, "x": 0.0, "y": -approach} for on in ("top", "left")])
    scene = pair_of(upper, block("lower", 0.0, 0.0, (2, 1), ["bottom", "left"], divisions=(below, 8)))
    scene["contact"][0] |= {} if gap is None else {"gap": gap}
    done = run(scene, tmp_path)
    if not approach:
        assert warnings_of(done) == []
        assert below == 7 or done.summary["contacts"]["upper-lower"]["m"] == 8  # one of nine pairs is clamped
        return
    assert done.code == 2 and len(done.messages) == 1
    for words in ("scene.toml: contact.upper-lower: at (0, 1) body.upper.clamp.1 on 'left' prescribes y = -0.05",
                  "body.lower.clamp.1 on 'left' prescribes y = 0", "into each other by 0.05"):
        assert words in done.messages[0]


def test_clamps_that_contradict_each_other_on_the_way_are_refused(tmp_path):
    """In the midst of a history, though they agree at its ends."""
    upper = block("upper", 0.0, 1.0, (2, 1), [{"on": "left", "x": 0.0, "y": 1e-4, "history": "swing"}])
    scene = pair_of(upper, block("lower", 0.0, 0.0, (2, 1), ["bottom", "left"]))
    scene |= {"time": {"points": [3.0]}, "history": {"swing": {"times": [0.0, 1.0, 2.0, 3.0],
                                                               "factors": [0.0, 1.0, -1.0, 0.0]}}}
    done = run(scene, tmp_path)
    assert done.code == 2 and "at (0, 1), at time 2, body.upper.clamp.0" in done.messages[0], done.output


def test_lost_and_doubled_loads_are_warnings(tmp_path):
    """A load on a group that is clamped in its direction acts on nothing; one of its components may act."""
    scene = pinched_blocks(4)
    scene["body"][0]["clamp"] = ["left", {"on": "right", "x": 0.0}]
    scene["body"][1]["traction"] *= 2
    found = warnings_of(run(scene, tmp_path))
    assert len(found) == 2
    assert "the load on 'right' along x is lost" in found[0]
    assert "body.lower: 'bottom' is loaded 2 times" in found[1]


@pytest.mark.parametrize(("points", "warned"), [([0.0, 3.0], False), ([0.0, 2.0], True), ([1.0, 4.0], True)])
def test_a_profile_that_does_not_cover_the_contact_is_a_warning(tmp_path, points, warned):
    scene = pinched_blocks(4)
    scene["contact"][0]["friction"]["coefficient"] = {"along": "x", "points": points, "values": [0.2, 0.4]}
    found = warnings_of(run(scene, tmp_path))
    assert len(found) == warned
    words = f"covers x from {points[0]:g} to {points[1]:g}, the contact goes from 0.25 to 3"
    assert all(words in each for each in found)


def test_each_limit_in_the_table_is_asked_for():
    """No warning has gone without its limit."""
    source = Path(plausible.__file__).read_text(encoding="utf-8")
    for name in LIMIT.keys() - {"linear", "quadratic"}:
        assert f'LIMIT["{name}"]' in source, name


# Of the answer


def test_large_displacements_and_far_slips_are_warnings(tmp_path):
    """Small-strain theory carries neither a body that moves by its size nor pairs that slide past their neighbours."""
    scene = pinched_blocks(6, "none")
    for body in scene["body"]:
        body["material"]["young"] = 2e8
    moved, *_, slid = warnings_of(run(scene, tmp_path))
    assert "body.upper" in moved and "largest displacement" in moved and "times its size" in moved
    assert "node pairs slid up to" in slid
    assert warnings_of(scenes.run_here(scenes.write_scene(pinched_blocks(6), tmp_path / "fine.toml"),
                                       tmp_path / "fine", "--no-figures")) == []


def test_a_layer_pressed_through_itself_is_a_warning(tmp_path):
    """A strain of 500 % in a layer is no small one, however small the displacement beside the body's length."""
    layer = block("layer", 0.0, 0.0, (3.0, 0.01), ["bottom"], divisions=(12, 4))
    layer["material"]["young"] = 1e6
    upper = block("upper", 0.0, 0.01, (3.0, 1.0), [{"on": "top", "x": 0.0, "y": -0.05}], divisions=(12, 4))
    (strained,) = warnings_of(run(pair_of(upper, layer, {"law": "none"}), tmp_path))
    assert "body.layer: strains and rotations reach 5" in strained


@pytest.mark.parametrize("whole", [True, False])
def test_contact_that_reaches_the_end_of_its_group_is_a_warning(tmp_path, whole):
    """Beyond the end of a group the surfaces may go on into each other; no unknown keeps them apart there."""
    mesh = split_bottom(tmp_path / "block.msh")
    upper = {"name": "upper", "mesh": {"file": mesh}, "material": {"young": 2e11, "poisson": 0.3},
             "clamp": [{"on": "top", "x": 0.0, "y": -1e-4}]}
    base = {"name": "lower", "mesh": {"file": split_bottom(tmp_path / "base.msh", mirror=True)},
            "material": {"young": 2e11, "poisson": 0.3}, "clamp": ["top"]}
    on = "bottom" if whole else "part"
    scene = {"body": [upper, base], "contact": [{"bodies": ["upper", "lower"], "on": [on, on], "friction": COULOMB}]}
    found = warnings_of(run(scene, tmp_path))
    assert len(found) == (not whole)
    assert all("body.upper and body.lower penetrate each other by 0.000106" in each and "name the whole" in each
               for each in found), found


def squares(path, filled) -> str:
    """A mesh file of the squares (i, j) of side 0.25 in `filled`; groups bottom, y = 0, and top, y = 1, x <= 3."""
    mesh = rectangle((14, 8), (3.5, 2.0))
    places = np.floor(mesh.points[mesh.triangles].mean(axis=1) / 0.25).astype(int).tolist()
    triangles = mesh.triangles[[tuple(place) in filled for place in places]]
    at = np.lexsort(mesh.points.T).reshape(9, 15)
    groups = {"bottom": mesh.groups["bottom"], "top": np.column_stack([at[4, :12], at[4, 1:13]])}
    return write_msh(path, Mesh(mesh.points, triangles, groups))


WALL = {(i, j) for i in range(14) for j in range(4)} | {(i, j) for i in (12, 13) for j in range(4, 8)}
ROOF = WALL | {(i, 6) for i in range(8, 12)}


@pytest.mark.parametrize(("filled", "traction", "depth"), [
    (WALL, (0.0, 0.0), None), (WALL, (-1e7, 0.0), None), (WALL, (0.0, 3e7), "by 0.00299"),
    (WALL, (1e9, 3e7), "by 0.0166"), (ROOF, (0.0, 0.0), "by 0.5 m (0.5 m as drawn)"),
    (ROOF, (0.0, 3e7), "by 0.493 m (0.5 m as drawn)")])
def test_bodies_that_run_through_each_other_beside_an_open_contact_are_a_warning(tmp_path, filled, traction, depth):
    """A wall beside the upper block and a roof within it belong to the lower body, but not to the contact."""
    upper = block("upper", 0.0, 1.0, (3, 1), ["left"], [{"on": "right", "value": traction}], (12, 4))
    lower = {"name": "lower", "mesh": {"file": squares(tmp_path / "wall.msh", filled)}, "clamp": ["bottom"],
             "material": {"young": 2e11, "poisson": 0.3}}
    found = warnings_of(run(pair_of(upper, lower), tmp_path))
    assert len(found) == (depth is not None), found
    assert all(f"penetrate each other {depth}" in each for each in found), found


EITHER = "its forces are uncertain by about|rounding decides that it is open"


@pytest.mark.parametrize(("pull", "words"), [
    (0.0, ""), (1e6, ""), (1e14, "its forces are uncertain by about 0.1 of the largest"), (1e18, EITHER),
    (-1e18, EITHER)])
def test_forces_that_rounding_makes_are_a_warning(tmp_path, pull, words):
    """A sideways pull moves no node of a body with nu = 0 across, but its rounding does, one way or the other.

    Which way, depends on the processor; that there is a warning does not.
    """
    scene = pinched_blocks(4, "none")
    upper, lower = scene["body"]
    for body in (upper, lower):
        body["material"]["poisson"] = 0.0
    upper["traction"] = [{"on": "top", "value": [0.0, -1e-11]}, {"on": "right", "value": [1e-11 * pull, 0.0]}]
    lower |= {"traction": [], "clamp": ["bottom"]}
    found = warnings_of(run(scene, tmp_path))
    assert len(found) == bool(words)
    assert all(re.match(f"contact.upper-lower: ({words})", each) for each in found), found


@pytest.mark.parametrize(("processor", "needs"), [("SkylakeX", "avx512dq"), ("Haswell", "avx2"), ("Zen", "avx2"),
                                                  ("Sandybridge", "avx")])
@pytest.mark.parametrize("divisions", [4, 24])
def test_rounding_is_told_on_every_processor(tmp_path, monkeypatch, processor, needs, divisions):
    """Whatever the kernels of OpenBLAS make of gaps that are nothing beside the displacements."""
    if needs not in Path("/proc/cpuinfo").read_text().split():
        pytest.skip(f"this processor has no {needs}")
    monkeypatch.setenv("OPENBLAS_CORETYPE", processor)
    scene = pinched_blocks(divisions, "none")
    for body in scene["body"]:
        body["traction"], body["material"]["poisson"] = [], 0.0
    scene["body"][0]["traction"] = [{"on": "right", "value": [-1e7, 0.0]}]
    scene["body"][1]["clamp"] = ["bottom"]
    path = scenes.write_scene(scene, tmp_path / "scene.toml")
    (found,) = warnings_of(scenes.run_command(path, tmp_path / "out", "--no-figures", ranks=1))
    assert re.match(f"contact.upper-lower: ({EITHER})", found), found


@pytest.mark.parametrize(("order", "warned"), [(1, True), (2, False)])
def test_a_mesh_that_says_little_is_a_warning(tmp_path, order, warned):
    """A slender beam of linear triangles is ten times too stiff, and its estimated error is 0.8."""
    beam = block("beam", 0.0, 1.001, (100, 1), ["left"], [{"on": "top", "value": [0.0, -1e-4]}], (30, 1))
    base = block("base", 0.0, 0.0, (100, 1), ["bottom"], divisions=(30, 1))
    for body in (beam, base):
        body["mesh"]["order"] = order
    found = warnings_of(run(pair_of(beam, base), tmp_path))
    assert len(found) == warned
    for words in ("body.beam: linear elements make it too stiff", "error is 0.8", "quadratic elements (mesh.order"):
        assert all(words in each for each in found)


def split_bottom(path, mirror: bool = False) -> str:
    """A block 2 × 1 with groups top, bottom and part, the left half of the bottom; mirrored it lies below y = 0."""
    mesh = rectangle((16, 8), (2.0, 1.0))
    groups = {"bottom": mesh.groups["bottom"], "part": mesh.groups["bottom"][:8], "top": mesh.groups["top"]}
    return write_msh(path, Mesh(mesh.points * [1.0, -1.0 if mirror else 1.0], mesh.triangles, groups))


@pytest.mark.parametrize("scene", [confined_blocks(3, gap=4e-4), sheared_stack(3, 1e-4, COULOMB)], ids=["gap", "shear"])
def test_scenes_with_closed_forms_do_not_warn(tmp_path, scene):
    assert warnings_of(run(scene.scene(), tmp_path)) == []


@pytest.mark.parametrize(("partner", "words"), [
    ({"shape": "plane", "point": [2.0005, 0.0], "normal": [-1.0, 0.0]}, "block penetrates stop by 0.0005"),
    ({"shape": "plane", "point": [1.0, 0.0], "normal": [-1.0, 0.0]}, ""),
    ({"shape": "circle", "center": [2.4, 0.5], "radius": 0.4}, "block penetrates stop by 0.00"),
    ({"shape": "circle", "center": [0.0, 0.0], "radius": 5**0.5, "inside": True}, "block penetrates stop by 0.00"),
    ({"shape": "circle", "center": [0.0, 0.0], "radius": 2.1, "inside": True}, "")])
def test_a_body_that_moves_through_a_rigid_partner_of_another_is_a_warning(tmp_path, partner, words):
    """A stop that only another body touches does not stop this one; a plane drawn through a body ends before it."""
    pushed = block("block", 0.0, 0.0, (2, 1), [{"on": "left", "x": 1e-3, "y": 0.0}], divisions=(8, 4))
    on, at = ("right", (partner["point"][0] - 0.8, 3.0)) if "point" in partner else ("bottom", (2.0, 1.0))
    if "inside" in partner:
        on, at = "top", (-0.4, partner["radius"] - 0.6)
    other = block("other", *at, (0.8, 0.5), ["bottom" if on == "top" else "top"], divisions=(4, 4))
    scene = {"body": [pushed, other], "rigid": [{"name": "stop", **partner}],
             "contact": [{"bodies": ["other", "stop"], "on": [on]}]}
    found = [each for each in warnings_of(run(scene, tmp_path)) if "penetrates" in each]
    assert all("no contact keeps them apart" in each and "add a [[contact]] between them" in each for each in found)
    assert len(found) == bool(words), found
    assert all(f"no contact keeps them apart: {words}" in each for each in found), found


@pytest.mark.parametrize(("weight", "warned"), [(1e-3, True), (1e3, False)])
def test_a_light_loose_body_beside_a_heavy_one_is_a_warning(tmp_path, weight, warned):
    """What acts on it is below what the convex program and the certificate resolve, so nothing is known of it."""
    light = block("light", 0.0, 0.0, (1, 1), [], [{"on": "top", "value": [0.0, -weight]}], (4, 4))
    heavy = block("heavy", 3.0, 0.0, (1, 1), [], [{"on": "top", "value": [0.0, -1e8]}], (4, 4))
    scene = {"body": [light, heavy], "rigid": [FLOOR],
             "contact": [{"bodies": [name, "floor"], "on": ["bottom"], "friction": COULOMB}
                         for name in ("light", "heavy")]}
    found = [each for each in warnings_of(run(scene, tmp_path)) if "negligible beside the loads" in each]
    assert len(found) == warned, found
    assert all(each.startswith("warning: body.light") or "body.light" in each for each in found)


@pytest.mark.parametrize(("push", "warns"), [(0.05, False), (0.6, True)])
def test_slip_around_a_rigid_circle_warns(tmp_path, push, warns):
    """Nodes that slide far around a small rigid circle meet it where its normal is another; the run says so."""
    slope = scenes.rectangle("slope", (-10, 1), (20, 4), (40, 4), young=1.0,
                             clamp=[{"on": "top", "x": push, "y": -0.05}])
    scene = {"body": [slope], "rigid": [{"name": "knob", "shape": "circle", "center": [0.0, 0.0], "radius": 1.0}],
             "contact": [{"bodies": ["slope", "knob"], "on": ["bottom"]}]}
    done = run(scene, tmp_path)
    assert done.code == 0, done.output
    assert any("nodes slid around 'knob'" in warning for warning in done.summary["warnings"]) == warns


@pytest.mark.parametrize(("around", "order", "warned"),
                         [(16, 1, True), (160, 1, False), (16, 2, True), (96, 2, False)])
def test_pressure_on_too_few_nodes_is_a_warning(tmp_path, around, order, warned):
    """A wheel on a plane whose contact is narrower than its elements has a force, but no pressure."""
    wheel = {"name": "wheel", "material": {"young": 1e9, "poisson": 0.3},
             "clamp": [{"on": "inner", "x": 0, "y": -0.01}],
             "mesh": {"shape": "annulus", "center": [0.0, 1.0], "radii": [0.5, 1.0], "angles": [180, 360],
                      "divisions": [around, 4], "order": order}}
    scene = {"body": [wheel], "rigid": [FLOOR],
             "contact": [{"bodies": ["wheel", "floor"], "on": ["outer"]}]}
    found = [each for each in warnings_of(run(scene, tmp_path)) if "too few nodes" in each]
    assert len(found) == warned, found
    assert all("contact.wheel-floor" in each and "at (" in each for each in found)


@pytest.mark.parametrize(("approach", "divisions", "few", "large"),
                         [(0.01, (6, 6, 6), True, False), (0.1, (14, 14, 4), False, True)])
def test_a_ball_on_a_box_is_doubted(tmp_path, approach, divisions, few, large):
    """In space a zone is as wide as a few nodes where it has their square; strains are found in tetrahedra."""
    box = solid_scenes.box("box", (0, 0, 0), (1, 1, 1), divisions, clamp=["bottom"])
    ball = {"name": "ball", "shape": "sphere", "center": [0.5, 0.5, 2.0], "radius": 1.0,
            "displacement": [0, 0, -approach]}
    done = run({"body": [box], "rigid": [ball], "contact": [{"bodies": ["box", "ball"], "on": ["top"]}]}, tmp_path)
    found = " ".join(warnings_of(done))
    assert ("at (0.5, 0.5, 1) is on too few nodes to resolve it, 1:" in found) == few
    assert ("strains and rotations reach 0.29" in found) == large


BRACKET = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, 1, 0, 2, 0.5};
Rectangle(2) = {0, 1, 0, 0.5, 3};
BooleanUnion(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
%s
Physical Curve("bottom") = {Curve In BoundingBox{-0.1, 0.9, -1, 2.1, 1.1, 1}};
Physical Curve("end") = {Curve In BoundingBox{1.9, 0.9, -1, 2.1, 1.6, 1}};
Physical Curve("top") = {Curve In BoundingBox{-0.1, 3.9, -1, 0.6, 4.1, 1}};
"""
FILLET = """Disk(9) = {0.8, 1.8, 0, 0.3};
Rectangle(8) = {0.5, 1.5, 0, 0.3, 0.3};
BooleanDifference(7) = { Surface{8}; Delete; }{ Surface{9}; Delete; };
BooleanUnion(6) = { Surface{3}; Delete; }{ Surface{7}; Delete; };"""


@pytest.mark.parametrize(("rounding", "size", "warned"), [("", 0.2, True), ("", 0.1, True), (FILLET, 0.1, False)])
@pytest.mark.parametrize("order", [1, 2])
def test_the_largest_stress_at_a_sharp_corner_is_a_warning(tmp_path, rounding, size, warned, order):
    """A bracket, bent open: at its inner corner no mesh has the stress, and with a fillet every fine one has."""
    (tmp_path / "bracket.geo").write_text(BRACKET % rounding)
    bracket = {"name": "bracket", "mesh": {"geometry": "bracket.geo", "size": size, "order": order},
               "material": {"young": 2e11, "poisson": 0.3}, "clamp": ["end"],
               "traction": [{"on": "top", "value": [-1e6, 0.0]}]}
    base = block("base", 0.0, 0.0, (2, 1), ["bottom"])
    base["mesh"]["order"] = order
    found = [each for each in warnings_of(run(pair_of(bracket, base), tmp_path)) if "von Mises" in each]
    assert len(found) == warned, found
    for words in ("body.bracket: the largest von Mises stress, ", "at a re-entrant corner at (0.5, 1.5), where it"):
        assert all(words in each for each in found)


@pytest.mark.parametrize(("on", "warned"), [("part", True), ("bottom", False)])
def test_the_largest_stress_at_the_end_of_a_clamp_is_a_warning(tmp_path, on, warned):
    """A clamp that ends on a straight boundary; at the corners of a block it does what it does in all scenes."""
    base = {"name": "base", "mesh": {"file": split_bottom(tmp_path / "base.msh")}, "clamp": [on],
            "material": {"young": 2e11, "poisson": 0.3}}
    upper = block("upper", 0.0, 1.0, (2, 1), [], [{"on": "top", "value": [0.0, -1e6]}], (16, 8))
    upper["clamp"] = [{"on": "left", "x": 0.0}]
    found = [each for each in warnings_of(run(pair_of(upper, base), tmp_path)) if "von Mises" in each]
    assert len(found) == warned, found
    assert all("body.base: the largest von Mises stress, " in each and "is at the end of a clamp at (1, 0)" in each
               for each in found)


@pytest.mark.parametrize("pressed", ["constant", "growing"])
def test_planes_of_symmetry_are_no_ends_of_clamps(pressed, tmp_path):
    """At the corner of a free face where two planes meet, rollers hold all nodes of a facet that no clamp names."""
    planes = [{"on": "left", "x": 0.0}, {"on": "front", "y": 0.0}]
    one, two = (solid_scenes.box(name, (0, 0, z), (1, 1, 1), (n, n, n), young=125,
                                 clamp=[{"on": on, "z": 0.0}, *planes])
                for name, z, n, on in (("one", 0.0, 2, "bottom"), ("two", 0.99, 3, "top")))
    if pressed == "growing":  # towards the free faces beside the planes
        one["traction"] = [{"on": "right", "pressure": "10 * (1 - y)"}]
    done = run({"body": [one, two], "contact": [{"bodies": ["one", "two"], "on": ["top", "bottom"]}]}, tmp_path)
    assert [each for each in warnings_of(done) if "von Mises" in each] == []


@pytest.mark.parametrize(("order", "n", "warned"), [(1, 1, False), (2, 1, True), (2, 4, False)])
def test_quadratic_elements_too_coarse_for_a_punch_are_a_warning(tmp_path, order, n, warned):
    """With one on half its width a flat punch bears 11 % too little in its inner half, and the estimate is 0.19."""
    mirror = {"on": "left", "x": 0.0}
    punch = scenes.rectangle("punch", (0, 0), (0.5, 0.5), (n, n), order, 2.1e11, clamp=[mirror],
                             traction=[{"on": "top", "pressure": 1e8}])
    base = scenes.rectangle("base", (0, -0.75), (1.5, 0.75), (3 * n, (3 * n) // 2), order, 7e10, 0.33,
                            clamp=["bottom", mirror])
    found = [each for each in warnings_of(run(pair_of(punch, base, {"law": "none"}), tmp_path)) if "coarse" in each]
    assert len(found) == warned
    assert all("forces at the edges of contacts are uncertain: the estimated discretization error is 0.19" in each
               and each.endswith("; use a finer mesh") for each in found)


@pytest.mark.parametrize("order", [1, 2])
def test_a_box_on_planes_of_symmetry_has_no_end_of_a_clamp(order):
    """At a corner a triangle of a free face may have all its nodes on clamped ones; its side is no end of a clamp."""
    mesh = made_up_solids.box(divisions=(2, 2, 2), order=order)

    def warned(groups: list[str], stress: np.ndarray) -> bool:
        spec = SimpleNamespace(name="box", clamps=[SimpleNamespace(on=on) for on in groups])
        return bool(_singular(SimpleNamespace(mesh=mesh, spec=spec), stress, "Pa"))

    mesh.groups["part"] = mesh.groups["bottom"][:4]
    cells = np.eye(len(mesh.triangles))
    assert not any(warned(["left", "front", "bottom"], cell) for cell in cells)
    assert any(warned(["part"], cell) for cell in cells)
    assert not warned(["part"], np.ones(len(cells)))  # it stands everywhere


def test_bodies_without_a_contact_need_one(tmp_path):
    """A row of blocks slides over the edge of the row below; no boundary of a contact is too short."""
    ll, lr, ul, ur = bodies = [
        block(name, x, y, (1, 1), ["bottom"] if y == 0.0 else [], [], divisions) for name, x, y, divisions in (
            ("ll", 0.0, 0.0, (4, 4)), ("lr", 1.0, 0.0, (5, 6)), ("ul", 0.0, 1.0, (7, 5)), ("ur", 1.0, 1.0, (6, 7)))]
    for each in (ul, ur):
        each["traction"] = [{"on": "top", "value": [4e7, -2e8]}]
    ul["traction"] += [{"on": "left", "pressure": 2e8}]
    ll["traction"] = [{"on": "left", "pressure": 2e8}]
    lr["traction"] = [{"on": "right", "pressure": 1e8}]
    ur["traction"] += [{"on": "right", "pressure": 1e8}]
    contacts = [{"bodies": list(pair), "on": list(on), "friction": COULOMB | {"coefficient": 0.5}} for pair, on in (
        (("ll", "lr"), ("right", "left")), (("ul", "ur"), ("right", "left")), (("ul", "ll"), ("bottom", "top")),
        (("ur", "lr"), ("bottom", "top")))]
    (found,) = warnings_of(run({"body": bodies, "contact": contacts}, tmp_path))
    assert "body.lr and body.ul penetrate each other" in found and "add a [[contact]] between them" in found


@pytest.mark.parametrize("more", [-1e-15, 0.0, 1e-15])
def test_rounding_does_not_choose_where_friction_crosses_air(more):
    """Nodes that slip all bear their bound; the one whose gap is widest is named."""
    interface = SimpleNamespace(name="c", law=SimpleNamespace(name="tresca"), xy=np.eye(3, 2))
    state = SimpleNamespace(interface=interface, status=np.array(["slip", "open", "open"]),
                            gap=np.array([0.0, 0.2, 0.1]), forces=np.array([[0, 3], [1, 0], [1 + more, 0]]))
    (found,) = _held_through_air(state, 0.0, "m")
    assert "at (0, 1), where the gap is 0.2 m" in found


@pytest.mark.parametrize(("law", "bound", "warned"), [
    ("tresca", 1e5, True), ("tresca", 1e3, True), ("coulomb", 0.3, False)])
def test_friction_across_air_is_a_warning(tmp_path, law, bound, warned):
    """Tresca's bound, as it is published, holds a block half a metre from the wall; a clamp bears it, too."""
    held = block("block", 0.5, 0.0, (1, 1), [{"on": "right", "x": 0.0, "y": 0.0}])
    held["volume_force"] = [0.0, -1e4]
    scene = {"body": [held], "rigid": [{"name": "wall", "shape": "plane", "point": [0, 0], "normal": [1, 0]}],
             "contact": [{"bodies": ["block", "wall"], "on": ["left"], "friction": {
                 "law": law, "slip_bound" if law == "tresca" else "coefficient": bound}}]}
    done = run(scene, tmp_path)
    found = warnings_of(done)
    assert len(found) == warned, found
    assert all("contact.block-wall: friction of open nodes bears 100% of its forces, as at (0.5, " in each
               and "the gap is 0.5 m:" in each for each in found)
    assert "closed nowhere: block-wall (at least 0.5 apart)\n" in done.stdout


def test_a_contact_that_was_closed_before_is_not_said_to_be_open(tmp_path):
    """Nor is its friction worth a warning, when at last it holds nothing."""
    upper = block("upper", 0.0, 1.0, (2, 1), [{"on": "top", "x": 0.0, "y": -1e-4, "history": "press"}])
    scene = pair_of(upper, block("lower", 0.0, 0.0, (2, 1), ["bottom"]), {"law": "tresca", "slip_bound": 1e6})
    scene |= {"time": {"points": [1.0, 2.0]}, "history": {"press": {"times": [0.0, 1.0, 2.0], "factors": [0, 1, 0]}}}
    done = run(scene, tmp_path)
    assert "closed nowhere" not in done.stdout
    assert not any("open nodes" in each for each in warnings_of(done))
    scene["contact"][0]["friction"], scene["history"]["press"]["factors"] = {"law": "none"}, [0, -1, -2]
    done = scenes.run_here(scenes.write_scene(scene, tmp_path / "up.toml"), tmp_path / "up", "--no-figures")
    assert "closed nowhere at any time: upper-lower (at least 0.000" in done.stdout, done.output[-2000:]


@pytest.mark.parametrize(("slave", "scale", "warned"), [("base", 1.0, True), ("base", 1e-3, True),
                                                       ("layer", 1.0, False)])
def test_a_deep_overlap_between_nodes_is_a_warning(tmp_path, slave, scale, warned):
    """Rows at the nodes of a coarse base do not see the ripples of a layer that is pressed on it."""
    base = block("base", 0.0, 0.0, (2 * scale, scale), ["bottom"], divisions=(2, 2))
    layer = block("layer", 0.1 * scale, scale, (1.8 * scale, 0.1 * scale), [
        {"on": "top", "x": 0.0, "y": f"-{1e-5 * scale} * cos(6 * pi * x / {scale})"}], divisions=(32, 4))
    scene = pair_of(layer, base, {"law": "none"})
    scene["contact"][0]["slave"] = slave
    done = run(scene, tmp_path)
    found = [each for each in warnings_of(done) if "between nodes" in each]
    assert len(found) == warned
    assert all("contact.layer-base: the bodies overlap by" in each and "slave = 'layer'" in each for each in found)
    deepest = done.summary["contacts"]["layer-base"]["pointwise_penetration"]
    assert (deepest > 0.5e-5 * scale) == warned


@pytest.mark.parametrize(("order", "rigid"), [(1, False), (2, False), (2, True)])
@pytest.mark.parametrize("moved", [-1e-3, 1e-3])
def test_a_tip_that_no_row_feels_is_a_warning(order, rigid, moved, capfd):
    """A corner of a hexahedron sinks by 1 mm into a base whose rows, or into a plane that its own rows, feel only a
    mean of the gaps: the answer says so, and not that the two stand apart."""
    corners = [[0.3, 0.3, 0.0], [0.8, 0.2, 0.1], [0.8, 0.8, 0.1], [0.2, 0.8, 0.1],
               [0.2, 0.2, 0.8], [0.8, 0.2, 0.8], [0.8, 0.8, 0.8], [0.2, 0.8, 0.8]]
    tip = {"name": "tip", "clamp": [{"on": "top", "x": 0.0, "y": 0.0, "z": moved}],
           "mesh": {"shape": "hexahedron", "corners": corners, "divisions": [4, 4, 4], "order": order},
           "material": {"young": 1e9, "poisson": 0.3}}
    base = solid_scenes.box("base", (0, 0, -1), (1, 1, 1), (5, 5, 5), order, young=1e9, clamp=["bottom"])
    floor = {"name": "floor", "shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}
    scene = {"body": [tip, base], "contact": [{"bodies": ["tip", "base"], "on": ["bottom", "top"]}]}
    if rigid:
        scene = {"body": [tip], "rigid": [floor], "contact": [{"bodies": ["tip", "floor"], "on": ["bottom"]}]}
    answer = ddmpi.solve(scene, MPI.COMM_SELF, progress=True)
    (state,), found = answer.contacts.values(), [each for each in answer.summary["warnings"] if "overlap by" in each]
    assert answer.certified and not state.normal_force.any() and len(found) == (moved < 0.0)
    assert all("by 0.001 m between nodes that bear forces, as at (0.3, 0.3, " in each for each in found)
    assert state.deepest == pytest.approx(max(-moved, 0.0), rel=1e-9, abs=1e-15)
    assert f"(at least {'0' if moved < 0 else '0.001'} apart)" in capfd.readouterr().out


@pytest.mark.parametrize(("radius", "warned"), [(0.3, True), (2.0, False)])
def test_a_rigid_circle_between_two_nodes_is_a_warning(tmp_path, radius, warned):
    """Nodes alone touch a rigid partner, so a small disc passes between them."""
    upper = block("upper", 0.0, 0.0, (2, 1), [{"on": "top", "x": 0.0, "y": -0.08}], divisions=(4, 2))
    disc = {"name": "disc", "shape": "circle", "center": [0.75, -radius], "radius": radius}
    scene = {"body": [upper], "rigid": [disc], "contact": [{"bodies": ["upper", "disc"], "on": ["bottom"]}]}
    found = [each for each in warnings_of(run(scene, tmp_path)) if "between two of them" in each]
    assert len(found) == warned, found
    assert all("contact.upper-disc: disc is small" in each and "penetrates it by" in each for each in found)


@pytest.mark.parametrize(("pairing", "warned"), [(None, True), ("mortar", False)])
def test_a_slave_that_is_none_is_a_warning(tmp_path, pairing, warned):
    """Where nodes match and are paired there is no slave; what the scene names has no effect."""
    scene = pinched_blocks(4)
    scene["contact"][0] |= {"slave": "lower"} | ({"pairing": pairing} if pairing else {})
    done = run(scene, tmp_path)
    found = [each for each in warnings_of(done) if "contact.upper-lower.slave" in each]
    assert len(found) == warned, found
    assert done.summary["contacts"]["upper-lower"]["slave"] == (None if warned else "lower")
