"""Answers that mean nothing are refused, not certified, or come with a warning that has the number in it."""

import re
from pathlib import Path
from types import SimpleNamespace

import made_up_solids
import numpy as np
import pytest
import scenes
import solid_scenes
from boundaries import elastic, rectangle, write_msh
from mpi4py import MPI
from scenes import (
    CLAMP_END,
    COULOMB,
    FLOOR,
    beside_clamps,
    certified,
    confined_blocks,
    pinched_blocks,
    sheared_stack,
)

import ddmpi
from ddmpi.errors import InputError
from ddmpi.judge.plausible import _held_through_air, _singular
from ddmpi.mesh.mesh import Mesh
from ddmpi.mesh.read import read_mesh
from ddmpi.scene.bodies import Clamp, Material, Traction

STEEL = {"young": 2e11, "poisson": 0.3}


def doubts(scene: dict, about: str = "") -> list[str]:
    """The warnings of the certified answer to a scene that match a pattern."""
    found = certified(scene).summary["warnings"]
    found = found if about == CLAMP_END else beside_clamps(found)
    return [warning for warning in found if re.search(about, warning)]


def block(name: str, x: float, y: float, size, clamp, traction=(), divisions=(8, 8)) -> dict:
    return scenes.rectangle(
        name, (x, y), size, divisions, young=2e11, clamp=clamp, traction=list(traction)
    )


def pair_of(upper: dict, lower: dict, friction: dict = COULOMB) -> dict:
    return {
        "body": [upper, lower],
        "contact": [
            {
                "bodies": [upper["name"], lower["name"]],
                "on": ["bottom", "top"],
                "friction": friction,
            }
        ],
    }


# Before anything is computed


def turned_backs() -> dict:
    """Names of `on` in the wrong order mean two metres of overlap in blocks of one metre."""
    scene = pinched_blocks(6)
    scene["contact"][0]["on"] = ["top", "bottom"]
    return scene


def clamped_twice() -> dict:
    scene = pinched_blocks(4)
    scene["body"][0]["clamp"] = ["left", {"on": "top", "x": 1e-3}]
    return scene


def contradicting_history() -> dict:
    """Clamps push bodies into each other in the midst of a history, though they agree at its ends."""
    upper = block(
        "upper", 0.0, 1.0, (2, 1), [{"on": "left", "x": 0.0, "y": 1e-4, "history": "swing"}]
    )
    swing = {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 1.0, -1.0, 0.0]}
    return pair_of(upper, block("lower", 0.0, 0.0, (2, 1), ["bottom", "left"])) | {
        "time": {"points": [3.0]},
        "history": {"swing": swing},
    }


@pytest.mark.parametrize(
    ("scene", "words"),
    [
        (
            turned_backs,
            (
                "contact.upper-lower: the sides overlap by 2 m, and the depth of 'upper' is 1 m",
                "order of `bodies`",
            ),
        ),
        (
            clamped_twice,
            ("body.upper.clamp: x at (0, 2) is prescribed twice, as 0 and, on 'top', as 0.001",),
        ),
        (
            contradicting_history,
            (
                "at (0, 1), at time 2, body.upper.clamp.0 on 'left' prescribes y = -0.0001",
                "body.lower.clamp.1 on 'left' prescribes y = 0",
                "into each other by 0.0001",
            ),
        ),
    ],
)
def test_what_no_contact_can_mean_is_refused(scene, words):
    with pytest.raises(InputError) as error:
        ddmpi.solve(scene(), MPI.COMM_SELF)
    assert all(each in str(error.value) for each in words)


@pytest.mark.slow
def test_a_large_initial_overlap_is_a_warning_and_every_one_is_in_the_plan(tmp_path):
    """A warning stands once on stderr and once in the summary."""
    for overlap, warned in ((0.5, True), (0.001, False)):
        scene = pair_of(
            block("upper", 0.0, 1.0 - overlap, (1, 1), ["top"]),
            block("lower", 0.0, 0.0, (1, 1), ["bottom"]),
        )
        done = scenes.run_here(
            scenes.write_scene(scene, tmp_path / "scene.toml"),
            tmp_path / str(overlap),
            "--no-figures",
        )
        assert f"upper-lower: initial overlap up to {overlap:g} m\n" in done.stdout
        found = done.summary["warnings"]
        assert (
            sum(
                "overlap by 0.5 m at first, 50.0% of the thinner one's depth" in each
                for each in found
            )
            == warned
        )
        assert done.stderr.count("ddmpi: warning: ") == len(found)
        assert all(
            done.stderr.count(f"ddmpi: warning: {each}\n") == 1 and each not in done.stdout
            for each in found
        )


@pytest.mark.parametrize("below", [8, 7], ids=["pairs", "mortar"])
def test_a_fit_that_clamps_keep_is_certified(below):
    upper = block(
        "upper", 0.0, 1.0, (2, 1), [{"on": on, "x": 0.0, "y": 0.0} for on in ("top", "left")]
    )
    scene = pair_of(
        upper, block("lower", 0.0, 0.0, (2, 1), ["bottom", "left"], divisions=(below, 8))
    )
    scene["contact"][0]["gap"] = -1e-5
    answer = certified(scene)
    assert beside_clamps(answer.summary["warnings"]) == []
    assert (
        below == 7 or answer.summary["contacts"]["upper-lower"]["m"] == 8
    )  # one of nine pairs is clamped


def test_lost_and_doubled_loads_are_warnings():
    """A load on a group that is clamped in its direction acts on nothing; one of its components may act."""
    scene = pinched_blocks(4)
    scene["body"][0]["clamp"] = ["left", {"on": "right", "x": 0.0}]
    scene["body"][1]["traction"] *= 2
    lost, doubled = doubts(scene)
    assert (
        "the load on 'right' along x is lost" in lost
        and "body.lower: 'bottom' has 2 loads by value; they add up" in doubled
    )


@pytest.mark.parametrize(("more", "grows"), [(0.0, False), (1e3, True)])
def test_stresses_of_rounding_grow_nowhere(more, grows):
    """Under pressure all around two discs have no von Mises stress where the upper one ends on the lower one; with a
    thousandth more on the top they have."""
    upper = scenes.rectangle("upper", (0, 1), (1, 1), (3, 3), young=2e11)
    lower = scenes.rectangle("lower", (0, 0), (2, 1), (8, 4), young=2e11)
    for body, covered in ((upper, "1e6"), (lower, "1e6 * (x > 0.99999)")):
        loads = {"right": 1e6, "top": covered}
        body["traction"] = [{"on": on, "pressure": load} for on, load in loads.items()]
    lower["clamp"] = [{"on": "bottom", "y": 0.0}]
    upper["traction"][1]["pressure"] = 1e6 + more
    scene = {"axisymmetric": True} | pair_of(upper, lower, {"law": "none"})
    found = ddmpi.solve(scene, MPI.COMM_SELF).summary["warnings"]
    assert any("grows without limit" in warning for warning in found) is grows


@pytest.mark.parametrize(
    ("order", "pull", "lift", "told"),
    [
        (1, 0.0, 0.0, "the estimated discretization error is 0.81, of which this body has 0.81"),
        (1, 1e7, 0.0, "its estimated discretization error is 0.81 of its own energy norm, and 0.0"),
        (1, 1e6, 0.01, "its estimated discretization error is 0.81 of its own energy norm, and 0."),
        (1, 1e7, 0.01, ""),
        (1, 1e10, 0.0, ""),
        (2, 1e7, 0.0, ""),
    ],
)
def test_linear_elements_are_too_stiff_beside_other_bodies_too(order, pull, lift, told):
    """A beam of one element across, beside a block that has most of the energy, or nearly all of it; not where it is
    lifted by far more than it bends, and its stress is little beside that of the block."""
    down, along = {"on": "right", "value": [0.0, -1e4]}, {"on": "right", "value": [pull, 0.0]}
    held = [{"on": "left", "x": 0.0, "y": lift}]
    beam = block("beam", 0.0, 0.0, (10, 1), held, [down], (10, 1))
    pulled = block("pulled", 20.0, 0.0, (1, 1), [{"on": "left", "x": 0.0}], [along], (1, 1))
    pulled["clamp"].append({"on": "left & bottom", "y": 0.0})
    beam["mesh"]["order"] = pulled["mesh"]["order"] = order
    summary = ddmpi.solve({"body": [beam, pulled]}, MPI.COMM_SELF).summary
    found = [warning for warning in summary["warnings"] if "too stiff" in warning]
    assert len(found) == bool(told) and all(re.search(told, each) for each in found), found


def test_parts_that_grow_together_are_certified_without_stress():
    """Two plates in plane stress that are bonded, heated alike and held where they do not grow: forces are rounding."""
    bodies = []
    for name, y, height, across in (("plate", 0.0, 0.02, 4), ("lid", 0.02, 0.01, 3)):
        mesh = {"shape": "rectangle", "origin": [0.0, y], "size": [0.2, height], "order": 2}
        mesh["divisions"] = [5 * across, across]
        material = {"young": 2.1e11, "poisson": 0.3, "expansion": 1.2e-5, "plane": "stress"}
        body = {"name": name, "mesh": mesh, "material": material, "temperature": 80.0}
        bodies.append(body | {"clamp": [{"on": "left", "x": 0.0}]})
    bodies[0]["clamp"].append({"on": "bottom", "y": 0.0})
    bond = {"bodies": ["lid", "plate"], "on": ["bottom", "top"], "kind": "bonded"}
    summary = ddmpi.solve({"body": bodies, "contact": [bond]}, MPI.COMM_SELF).summary
    assert summary["converged"]
    for body in summary["bodies"].values():
        assert body["reaction"] == [0.0, 0.0]
        assert body["von_mises_max"] == body["energy"] == 0.0


def test_resultants_of_a_bond_in_balance_are_zero():
    """Of a strip of two metals that bends as it gets warm: its bond bears stresses, and no force along any axis."""
    bodies = []
    for name, y, expansion in (("steel", 0.0, 1.2e-5), ("brass", 0.2, 1.9e-5)):
        body = block(name, 0.0, y, (2, 0.2), [], divisions=(20, 2))
        body["material"] |= {"expansion": expansion}
        bodies.append(body | {"temperature": 100.0})
    bodies[0]["clamp"] = [{"on": "left", "x": 0.0}, {"on": "left & bottom", "y": 0.0}]
    bond = {"bodies": ["brass", "steel"], "on": ["bottom", "top"], "kind": "bonded"}
    found = ddmpi.solve({"body": bodies, "contact": [bond]}, MPI.COMM_SELF).summary["contacts"]
    bond = found["brass-steel"]
    assert bond["force"] == [0.0, 0.0] and bond["pressure_max"] > 1e6
    assert bond["moment"] == bond["normal_force"] == bond["tangential_force"] == 0.0


def test_heat_alone_presses_no_lid():
    """A lid that lies on a plate without friction, and that heat lets grow: heat has no resultant, not even of rounding,
    which took the lid off, so that there was no equilibrium."""
    bodies = []
    for name, y, height, cells in (("plate", 0.0, 0.02, [8, 4]), ("lid", 0.02, 0.01, [5, 3])):
        mesh = {"shape": "rectangle", "origin": [0.0, y], "size": [0.2, height], "order": 2}
        mesh["divisions"] = cells
        body = {"name": name, "mesh": mesh, "material": STEEL | {"expansion": 1.2e-5}}
        bodies.append(body | {"clamp": [{"on": "left", "x": 0.0}]})
    bodies[0]["clamp"].append({"on": "bottom", "y": 0.0})
    bodies[1]["temperature"] = 80.0
    lies = {"bodies": ["lid", "plate"], "on": ["bottom", "top"]}
    answer = certified({"body": bodies, "contact": [lies]})
    assert not answer.solved.assembly.joint.e.any()
    assert np.abs(answer.contacts["lid-plate"].normal_force).max() < 1e-8
    assert answer.summary["bodies"]["lid"]["displacement_max"] == pytest.approx(2.5e-4, rel=0.01)


def test_reactions_of_rounding_are_zero():
    """Of a plate that heat lets grow; of a weight 1e-9 times as large as what its supports bear they are not."""
    plate = block("plate", 0.0, 0.0, (1, 1), [{"on": "bottom", "y": 0.0}, {"on": "left", "x": 0.0}])
    plate["material"] |= {"plane": "stress", "expansion": 1.2e-5}
    warm = {"body": [plate | {"temperature": 77.0}]}
    summary = ddmpi.solve(warm, MPI.COMM_SELF).summary
    reactions = summary["bodies"]["plate"]["reactions"]
    assert all(reactions[on]["force"] == [0.0, 0.0] for on in ("bottom", "left"))
    loads = [{"on": "right", "value": [1e9, 0.0]}, {"on": "top", "value": [0.0, -1.0]}]
    pulled = {"body": [plate | {"traction": loads, "material": STEEL}]}
    summary = ddmpi.solve(pulled, MPI.COMM_SELF).summary
    assert summary["bodies"]["plate"]["reactions"]["bottom"]["force"][1] == pytest.approx(1.0, 1e-3)


SHEAR, PRESS = {"value": (1e6, 0.0)}, {"pressure": 1e6}
PUSH, ACROSS, ALSO = ({"force": force} for force in ((3e5, 4e5), (-4e5, 3e5), (1e5, 0.0)))


@pytest.mark.parametrize(
    ("given", "words"),
    [
        ((PRESS, SHEAR, PUSH, {"moment": 2e5}), ""),
        ((PUSH, ACROSS), ""),
        ((PRESS, {"pressure": 0.0}), ""),
        ((PRESS, PRESS | {"history": "way"}), ""),
        ((PUSH, PRESS, ACROSS, ALSO), "'top' has 2 loads by force; they add up"),
        ((PRESS, {"pressure": -2e6}, PRESS), "'top' has 3 loads by pressure; they add up"),
    ],
)
def test_loads_of_one_kind_along_each_other_are_told(given, words):
    """Those of two kinds are meant, and so are two across each other."""
    mesh = rectangle((1, 1), (1.0, 1.0))
    loads = tuple(Traction(on="top", **load) for load in given)
    told = elastic(mesh, (Clamp(on="bottom", x=0.0, y=0.0),), traction=loads).warnings
    assert [doubt for doubt in told if "add up" in doubt] == [f"body.body: {words}"] * bool(words)


@pytest.mark.parametrize(("degrees", "way"), [(0.0, "y"), (90.0, "x"), (37.0, r"(0.6, -0.8)")])
def test_loads_on_clamps_are_told_however_the_scene_lies(degrees, way):
    """A block on two points with a pull aside, which one of them bears, and a face that is held in one direction; a
    load across that is not lost."""
    c, s = np.cos(np.deg2rad(degrees)), np.sin(np.deg2rad(degrees))
    Q = np.array([[c, s], [-s, c]])
    unit, (right, up) = np.array([[0, 0], [1, 0], [1, 1], [0, 1]]), Q.tolist()
    mesh = {"shape": "quadrilateral", "corners": (unit @ Q).tolist(), "divisions": [2, 2]}
    clamp = [{"on": on, "along": up, "value": 0.0} for on in ("bottom & left", "top")]
    clamp.append({"on": "bottom & left", "along": right, "value": 0.0})
    load = {"on": "top", "value": (np.array([3e5, -1e6]) @ Q).tolist()}
    block = {"name": "block", "mesh": mesh, "material": STEEL, "clamp": clamp, "traction": [load]}
    summary = ddmpi.solve({"body": [block]}, MPI.COMM_SELF).summary
    found = [each for each in summary["warnings"] if "lost" in each or "the point" in each]
    assert found[0].startswith(f"body.block: the load on 'top' along {way} is lost, as clamps")
    assert found[1].startswith(
        "body.block.clamp: the point 'bottom & left' carries a force of 3.49e+05"
    )
    assert len(found) == 2


# Of the answer: one warning with these words, or none where there are no words


def agreeing_clamps() -> dict:
    """Clamps of one group that fix different components, or give one the same value."""
    scene = pinched_blocks(4)
    scene["body"][0]["clamp"] = [{"on": "left", "x": 0.0}, {"on": "left", "y": 0.0}, "left"]
    return scene


def profile(first: float) -> dict:
    """Of friction, from `first` to x = 4; the contact goes from 0.25 to 3."""
    scene = pinched_blocks(4)
    scene["contact"][0]["friction"]["coefficient"] = {
        "along": "x",
        "points": [first, 4.0],
        "values": [0.2, 0.4],
    }
    return scene


def ineffective_slave(**how) -> dict:
    """Where nodes match and are paired there is no slave."""
    scene = pinched_blocks(4)
    scene["contact"][0] |= {"slave": "lower"} | how
    return scene


def pressed_layer() -> dict:
    """A strain of 500 % in a layer, however small the displacement beside the body's length."""
    layer = block("layer", 0.0, 0.0, (3.0, 0.01), ["bottom"], divisions=(12, 4))
    layer["material"]["young"] = 1e6
    upper = block(
        "upper", 0.0, 0.01, (3.0, 1.0), [{"on": "top", "x": 0.0, "y": -0.05}], divisions=(12, 4)
    )
    return pair_of(upper, layer, {"law": "none"})


def beams(order: int) -> dict:
    """A slender beam of linear triangles is ten times too stiff, and its estimated error is 0.8."""
    beam = block(
        "beam", 0.0, 1.001, (100, 1), ["left"], [{"on": "top", "value": [0.0, -1e-4]}], (30, 1)
    )
    base = block("base", 0.0, 0.0, (100, 1), ["bottom"], divisions=(30, 1))
    for body in (beam, base):
        body["mesh"]["order"] = order
    return pair_of(beam, base)


def punch(order: int, n: int) -> dict:
    """With one quadratic element on half its width a flat punch bears 11 % too little in its inner half."""
    mirror = {"on": "left", "x": 0.0}
    upper = scenes.rectangle(
        "punch",
        (0, 0),
        (0.5, 0.5),
        (n, n),
        order,
        2.1e11,
        clamp=[mirror],
        traction=[{"on": "top", "pressure": 1e8}],
    )
    return pair_of(
        upper,
        scenes.rectangle(
            "base",
            (0, -0.75),
            (1.5, 0.75),
            (3 * n, (3 * n) // 2),
            order,
            7e10,
            0.33,
            clamp=["bottom", mirror],
        ),
        {"law": "none"},
    )


def stop(**partner) -> dict:
    """Another body's rigid partner does not stop a block; a plane drawn through a body ends before it."""
    pushed = block(
        "block", 0.0, 0.0, (2, 1), [{"on": "left", "x": 1e-3, "y": 0.0}], divisions=(8, 4)
    )
    on, at = (
        ("right", (partner["point"][0] - 0.8, 3.0))
        if "point" in partner
        else ("bottom", (2.0, 1.0))
    )
    if "inside" in partner:
        on, at = "top", (-0.4, partner["radius"] - 0.6)
    other = block("other", *at, (0.8, 0.5), ["bottom" if on == "top" else "top"], divisions=(4, 4))
    return {
        "body": [pushed, other],
        "rigid": [{"name": "stop", **partner}],
        "contact": [{"bodies": ["other", "stop"], "on": [on]}],
    }


def light_beside_heavy(weight: float) -> dict:
    """What acts on a light body is below what the convex program and the certificate resolve."""
    bodies = [
        block(name, x, 0.0, (1, 1), [], [{"on": "top", "value": [0.0, -w]}], (4, 4))
        for name, x, w in (("light", 0.0, weight), ("heavy", 3.0, 1e8))
    ]
    return {
        "body": bodies,
        "rigid": [FLOOR],
        "contact": [
            {"bodies": [name, "floor"], "on": ["bottom"], "friction": COULOMB}
            for name in ("light", "heavy")
        ],
    }


def around_a_knob(push: float) -> dict:
    """Nodes that slide far around a small rigid circle meet it where its normal is another."""
    slope = scenes.rectangle(
        "slope", (-10, 1), (20, 4), (40, 4), young=1.0, clamp=[{"on": "top", "x": push, "y": -0.05}]
    )
    return {
        "body": [slope],
        "rigid": [{"name": "knob", "shape": "circle", "center": [0.0, 0.0], "radius": 1.0}],
        "contact": [{"bodies": ["slope", "knob"], "on": ["bottom"]}],
    }


def wheel(around: int, order: int) -> dict:
    """A contact that is narrower than its elements has a force, but no pressure."""
    body = {
        "name": "wheel",
        "material": STEEL | {"young": 1e9},
        "clamp": [{"on": "inner", "x": 0, "y": -0.01}],
        "mesh": {
            "shape": "annulus",
            "center": [0.0, 1.0],
            "radii": [0.5, 1.0],
            "angles": [180, 360],
            "divisions": [around, 4],
            "order": order,
        },
    }
    return {
        "body": [body],
        "rigid": [FLOOR],
        "contact": [{"bodies": ["wheel", "floor"], "on": ["outer"]}],
    }


def half_a_wheel(around: int, order: int) -> dict:
    """The same, cut at a plane of symmetry through the zone."""
    half = wheel(around // 2, order)
    half["body"][0]["mesh"]["angles"] = [270, 360]
    half["body"][0]["clamp"] = [{"on": "inner", "y": -0.01}, {"on": "start", "x": 0.0}]
    return half


def ball(approach: float, divisions: tuple[int, ...]) -> dict:
    """In space a zone is as wide as a few nodes where it has their square; strains are found in tetrahedra."""
    box = solid_scenes.box("box", (0, 0, 0), (1, 1, 1), divisions, clamp=["bottom"])
    partner = {
        "name": "ball",
        "shape": "sphere",
        "center": [0.5, 0.5, 2.0],
        "radius": 1.0,
        "displacement": [0, 0, -approach],
    }
    return {
        "body": [box],
        "rigid": [partner],
        "contact": [{"bodies": ["box", "ball"], "on": ["top"]}],
    }


def small_disc(radius: float) -> dict:
    """Nodes alone touch a rigid partner, so a small disc passes between them."""
    upper = block(
        "upper", 0.0, 0.0, (2, 1), [{"on": "top", "x": 0.0, "y": -0.08}], divisions=(4, 2)
    )
    disc = {"name": "disc", "shape": "circle", "center": [0.75, -radius], "radius": radius}
    return {
        "body": [upper],
        "rigid": [disc],
        "contact": [{"bodies": ["upper", "disc"], "on": ["bottom"]}],
    }


def cubes_on_planes() -> dict:
    """At the corner of a free face where two planes of symmetry meet, rollers hold all nodes of a facet that no clamp
    names; the largest stress is there, as a load grows towards the planes."""
    planes = [{"on": "left", "x": 0.0}, {"on": "front", "y": 0.0}]
    one, two = (
        solid_scenes.box(
            name, (0, 0, z), (1, 1, 1), (n, n, n), young=125, clamp=[{"on": on, "z": 0.0}, *planes]
        )
        for name, z, n, on in (("one", 0.0, 2, "bottom"), ("two", 0.99, 3, "top"))
    )
    one["traction"] = [{"on": "right", "pressure": "10 * (1 - y)"}]
    return {"body": [one, two], "contact": [{"bodies": ["one", "two"], "on": ["top", "bottom"]}]}


def tipped(divisions: int, begin: float = 0.9) -> dict:
    """A block that turns on a rigid floor would reach it from x = `begin` on; it yields, and touches from later on."""
    turn = {"on": "top", "x": 0.0, "y": f"-1e-3 * (x - {begin})"}
    upper = block("upper", 0.0, 0.0, (1, 1), [turn], divisions=(divisions, 8))
    contact = {"bodies": ["upper", "floor"], "on": ["bottom"]}
    return {"body": [upper], "rigid": [FLOOR], "contact": [contact]}


def carried_along() -> dict:
    """What is bonded to a body that moves has forces of rounding, which say nothing of its supports."""
    upper = block("upper", 0.0, 0.0, (1, 1), [{"on": "top", "x": 0.1, "y": -0.1}], divisions=(4, 4))
    lower = block("lower", 0.0, -1.0, (1, 1), [], divisions=(5, 5))
    contact = {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "kind": "bonded"}
    return {"body": [upper, lower], "contact": [contact]}


def missing_contact() -> dict:
    """A row of blocks slides over the edge of the row below; no boundary of a contact is too short."""
    ll, lr, ul, ur = bodies = [
        block(name, x, y, (1, 1), ["bottom"] if y == 0.0 else [], [], divisions)
        for name, x, y, divisions in (
            ("ll", 0.0, 0.0, (4, 4)),
            ("lr", 1.0, 0.0, (5, 6)),
            ("ul", 0.0, 1.0, (7, 5)),
            ("ur", 1.0, 1.0, (6, 7)),
        )
    ]
    for each in (ul, ur):
        each["traction"] = [{"on": "top", "value": [4e7, -2e8]}]
    ul["traction"] += [{"on": "left", "pressure": 2e8}]
    ll["traction"] = [{"on": "left", "pressure": 2e8}]
    lr["traction"] = [{"on": "right", "pressure": 1e8}]
    ur["traction"] += [{"on": "right", "pressure": 1e8}]
    return {
        "body": bodies,
        "contact": [
            {"bodies": list(pair), "on": list(on), "friction": COULOMB | {"coefficient": 0.5}}
            for pair, on in (
                (("ll", "lr"), ("right", "left")),
                (("ul", "ur"), ("right", "left")),
                (("ul", "ll"), ("bottom", "top")),
                (("ur", "lr"), ("bottom", "top")),
            )
        ],
    }


APART = "no contact keeps them apart"

WARNED = [
    (agreeing_clamps(), "", ()),
    (confined_blocks(3, gap=4e-4).scene(), "", ()),
    (sheared_stack(3, 1e-4, COULOMB).scene(), "", ()),
    (profile(0.0), "", ()),
    (profile(1.0), "", ("covers x from 1 to 4, the contact goes from 0.25 to 3",)),
    (ineffective_slave(), "contact.upper-lower.slave", ("no side is a slave",)),
    (ineffective_slave(pairing="mortar"), "contact.upper-lower.slave", ()),
    (pressed_layer(), "", ("body.layer: strains and rotations reach 5",)),
    (
        beams(1),
        "",
        (
            "body.beam: linear elements make it too stiff",
            "error is 0.8",
            "quadratic elements (mesh.order",
        ),
    ),
    (beams(2), "linear|coarse", ()),
    (beams(2), "", ("body.beam: the largest von Mises stress, 0.8262 Pa, is a mean over a cell",)),
    (punch(1, 1), "coarse", ()),
    (punch(2, 4), "coarse", ()),
    (
        punch(2, 1),
        "coarse",
        (
            "its mesh is coarse: the estimated discretization error is 0.2,",
            "; use a finer mesh",
        ),
    ),
    (
        stop(shape="plane", point=[2.0005, 0.0], normal=[-1.0, 0.0]),
        "penetrates",
        (
            "no contact keeps them apart: block penetrates stop by 0.0005",
            "add a [[contact]] between them",
        ),
    ),
    (stop(shape="plane", point=[1.0, 0.0], normal=[-1.0, 0.0]), "penetrates", ()),
    (
        stop(shape="circle", center=[2.4, 0.5], radius=0.4),
        "penetrates",
        (f"{APART}: block penetrates stop by 0.00",),
    ),
    (
        stop(shape="circle", center=[0.0, 0.0], radius=5**0.5, inside=True),
        "penetrates",
        (f"{APART}: block penetrates stop by 0.00",),
    ),
    (stop(shape="circle", center=[0.0, 0.0], radius=2.1, inside=True), "penetrates", ()),
    (light_beside_heavy(1e-3), "negligible beside those on", ("body.light",)),
    (light_beside_heavy(1e3), "negligible beside those on", ()),
    (around_a_knob(0.05), "slid around", ()),
    (around_a_knob(0.6), "slid around", ("nodes slid around 'knob'",)),
    (wheel(16, 1), "too few nodes", ("contact.wheel-floor", "at (")),
    (wheel(160, 1), "too few nodes", ()),
    (wheel(16, 2), "too few nodes", ("contact.wheel-floor", "at (")),
    (wheel(96, 2), "too few nodes", ()),
    (half_a_wheel(16, 1), "too few nodes", ("contact.wheel-floor", "resolve it, 1:")),
    (half_a_wheel(160, 1), "too few nodes", ()),
    (
        ball(0.01, (6, 6, 6)),
        "too few|strains",
        ("at (0.5, 0.5, 1) is on too few nodes to resolve it, 1:",),
    ),
    (ball(0.1, (14, 14, 4)), "too few|strains", ("strains and rotations reach 0.29",)),
    (
        small_disc(0.3),
        "between two of them",
        ("contact.upper-disc: disc is small", "penetrates it by"),
    ),
    (small_disc(2.0), "between two of them", ()),
    (cubes_on_planes(), "von Mises", ()),
    (
        missing_contact(),
        "",
        ("body.lr and body.ul penetrate each other", "add a [[contact]] between them"),
    ),
    (tipped(8), "single node", ("contact.upper-floor: at (1, 0)", "take the force")),
    (tipped(16, 0.2), "single node", ()),
    (carried_along(), "negligible", ()),
]


@pytest.mark.parametrize(("scene", "about", "words"), WARNED)
def test_warnings(scene, about, words):
    found = doubts(scene, about)
    assert len(found) == bool(words), found
    assert all(each in found[0] for each in words)


@pytest.mark.parametrize(("around", "factors"), [(16, [1.0, -0.1]), (160, [0.01, 1.0])])
def test_pressures_of_the_step_that_is_shown_are_doubted(around, factors):
    """The report shows the step of the largest load: a zone on few nodes there has a warning, one on the way has none."""
    scene = wheel(around, 1)
    scene["body"][0]["clamp"][0]["history"] = "way"
    history = {"times": [0.0, 1.0, 2.0], "factors": [0.0, *factors]}
    scene |= {"history": {"way": history}, "time": {"points": [1.0, 2.0]}}
    found = doubts(scene, "too few nodes")
    assert len(found) == (around == 16)
    assert all("time 1" in words for words in found)


@pytest.mark.slow
def test_large_displacements_and_far_slips_are_warnings():
    """Small-strain theory carries neither a body that moves by its size nor pairs that slide past their neighbours."""
    scene = pinched_blocks(6, "none")
    for body in scene["body"]:
        body["material"]["young"] = 2e8
    moved, *_, slid = doubts(scene)
    assert "body.upper" in moved and "largest displacement" in moved and "times its size" in moved
    assert "node pairs slid up to" in slid
    assert doubts(pinched_blocks(6)) == []


# Meshes of files


def split_bottom(path: Path, mirror: bool = False) -> str:
    """A block 2 × 1 with groups top, bottom and part, the left half of the bottom; mirrored it lies below y = 0."""
    mesh = rectangle((16, 8), (2.0, 1.0))
    groups = {
        "bottom": mesh.groups["bottom"],
        "part": mesh.groups["bottom"][:8],
        "top": mesh.groups["top"],
    }
    return write_msh(
        path, Mesh(mesh.points * [1.0, -1.0 if mirror else 1.0], mesh.triangles, groups)
    )


@pytest.mark.parametrize("on", ["bottom", "part"])
def test_contact_that_reaches_the_end_of_its_group_is_a_warning(tmp_path, on):
    """Beyond the end of a group the surfaces may go on into each other; no unknown keeps them apart there."""
    upper = {
        "name": "upper",
        "mesh": {"file": split_bottom(tmp_path / "block.msh")},
        "material": STEEL,
        "clamp": [{"on": "top", "x": 0.0, "y": -1e-4}],
    }
    base = {
        "name": "lower",
        "mesh": {"file": split_bottom(tmp_path / "base.msh", mirror=True)},
        "material": STEEL,
        "clamp": ["top"],
    }
    found = doubts(
        {
            "body": [upper, base],
            "contact": [{"bodies": ["upper", "lower"], "on": [on, on], "friction": COULOMB}],
        }
    )
    assert len(found) == (on == "part"), found
    assert all(
        "body.upper and body.lower penetrate each other by 0.000106" in each
        and "name the whole" in each
        for each in found
    ), found


@pytest.mark.parametrize("on", ["bottom", "part"])
def test_a_plane_that_is_penetrated_beside_its_contact_is_a_warning(tmp_path, on):
    """A part of a flat side is pressed on a plane, and the rest is pulled through it."""
    mesh = {"file": split_bottom(tmp_path / "block.msh")}
    block = {"name": "upper", "mesh": mesh, "material": STEEL}
    block["clamp"] = [{"on": "top", "x": 0.0, "y": -1e-4}]
    level = read_mesh(Path(mesh["file"]), "block").points[:, 1].min()
    floor = scenes.FLOOR | {"point": [0.0, float(level)]}
    contact = {"bodies": ["upper", "floor"], "on": [on]}
    found = doubts({"body": [block], "rigid": [floor], "contact": [contact]})
    words = "contact.upper-floor: beside the contact upper penetrates floor by 0.0001"
    assert any(each.startswith(words) for each in found) == (on == "part"), found


@pytest.mark.parametrize("on", ["bottom", "part"])
def test_the_largest_stress_at_the_end_of_a_clamp_is_a_warning(tmp_path, on):
    """A clamp that ends on a straight boundary, or at the corners of a block."""
    base = {
        "name": "base",
        "mesh": {"file": split_bottom(tmp_path / "base.msh")},
        "clamp": [on],
        "material": STEEL,
    }
    upper = block(
        "upper",
        0.0,
        1.0,
        (2, 1),
        [{"on": "left", "x": 0.0}],
        [{"on": "top", "value": [0.0, -1e6]}],
        (16, 8),
    )
    (found,) = doubts(pair_of(upper, base), CLAMP_END)
    assert "body.base" in found
    assert ("is at the end of a clamp at (1, 0)" in found) == (on == "part")


def squares(path: Path, filled: set[tuple[int, int]]) -> str:
    """A mesh file of the squares (i, j) of side 0.25 in `filled`; groups bottom, y = 0, and top, y = 1, x <= 3."""
    mesh = rectangle((14, 8), (3.5, 2.0))
    places = np.floor(mesh.points[mesh.triangles].mean(axis=1) / 0.25).astype(int).tolist()
    triangles = mesh.triangles[[tuple(place) in filled for place in places]]
    at = np.lexsort(mesh.points.T).reshape(9, 15)
    groups = {"bottom": mesh.groups["bottom"], "top": np.column_stack([at[4, :12], at[4, 1:13]])}
    return write_msh(path, Mesh(mesh.points, triangles, groups))


WALL = {(i, j) for i in range(14) for j in range(4)} | {
    (i, j) for i in (12, 13) for j in range(4, 8)
}
ROOF = WALL | {(i, 6) for i in range(8, 12)}


@pytest.mark.parametrize(
    ("filled", "traction", "depth"),
    [
        (WALL, (-1e7, 0.0), None),
        (WALL, (0.0, 3e7), "by 0.00299"),
        (WALL, (1e9, 3e7), "by 0.0166"),
        (ROOF, (0.0, 3e7), "by 0.493 m (0.5 m as drawn)"),
    ],
)
def test_bodies_that_run_through_each_other_beside_an_open_contact_are_a_warning(
    tmp_path, filled, traction, depth
):
    """A wall beside the upper block and a roof within it belong to the lower body, but not to the contact."""
    upper = block(
        "upper", 0.0, 1.0, (3, 1), ["left"], [{"on": "right", "value": traction}], (12, 4)
    )
    lower = {
        "name": "lower",
        "mesh": {"file": squares(tmp_path / "wall.msh", filled)},
        "clamp": ["bottom"],
        "material": STEEL,
    }
    found = doubts(pair_of(upper, lower))
    assert len(found) == (depth is not None), found
    assert all(f"penetrate each other {depth}" in each for each in found), found


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


@pytest.mark.slow
@pytest.mark.parametrize(
    ("rounding", "size", "order"), [("", 0.2, 1), ("", 0.1, 2), (FILLET, 0.1, 1), (FILLET, 0.1, 2)]
)
def test_the_largest_stress_at_a_sharp_corner_is_a_warning(tmp_path, rounding, size, order):
    """A bracket, bent open: at its inner corner no mesh has the stress, and with a fillet every fine one has."""
    path = tmp_path / "bracket.geo"
    path.write_text(BRACKET % rounding)
    bracket = {
        "name": "bracket",
        "mesh": {"geometry": str(path), "size": size, "order": order},
        "material": STEEL,
        "clamp": ["end"],
        "traction": [{"on": "top", "value": [-1e6, 0.0]}],
    }
    base = block("base", 0.0, 0.0, (2, 1), ["bottom"])
    base["mesh"]["order"] = order
    found = doubts(pair_of(bracket, base), "von Mises")
    assert len(found) == (not rounding), found
    for words in (
        "body.bracket: the largest von Mises stress, ",
        "at a re-entrant corner at (0.5, 1.5), where it",
    ):
        assert all(words in each for each in found)


# Warnings by numbers


EITHER = "its forces are (rounding|uncertain by about)|rounding decides that it is open"


@pytest.mark.parametrize(
    ("press", "pull", "words"),
    [
        (-1e-11, 0.0, ""),
        (-1e-11, 1e-5, ""),
        (-1e-11, 1e3, "its forces are uncertain by about 0.1 of the largest"),
        (-1e-11, 1e7, EITHER),
        (-1e-11, -1e7, EITHER),
        (0.0, -1e7, EITHER),
    ],
)
def test_forces_that_rounding_makes_are_a_warning(press, pull, words):
    """A sideways pull moves no node of a body with nu = 0 across, but its rounding does, one way or the other.

    Which way, depends on the processor (scripts/kernels.sh); that there is a warning does not.
    """
    scene = pinched_blocks(4, "none")
    upper, lower = scene["body"]
    for body in (upper, lower):
        body["material"]["poisson"] = 0.0
    upper["traction"] = [
        {"on": "top", "value": [0.0, press]},
        {"on": "right", "value": [pull, 0.0]},
    ]
    lower |= {"traction": [], "clamp": ["bottom"]}
    found = doubts(scene)
    assert len(found) == bool(words)
    assert all(re.match(f"contact.upper-lower: ({words})", each) for each in found), found


@pytest.mark.parametrize(
    ("pull", "words"), [(0.0, "the largest pressure, "), (1e5, "its forces are uncertain by about")]
)
def test_pressures_that_rounding_makes_are_not_said_to_be_infinite(pull, words):
    """At the corner of a shorter block they grow without limit, as is told of those that are more than rounding."""
    load = [{"on": "top", "value": [0.0, -1e-7]}, {"on": "right", "value": [pull, 0.0]}]
    upper = block("upper", 0.0, 1.0, (2, 1), ["left"], load, (4, 2))
    lower = block("lower", 0.0, 0.0, (4, 1), ["bottom"], divisions=(8, 2))
    for body in (upper, lower):
        body["material"]["poisson"] = 0.0
    found = doubts(pair_of(upper, lower, {"law": "none"}), r"^contact\.")
    assert [each.startswith(f"contact.upper-lower: {words}") for each in found] == [True], found


@pytest.mark.parametrize("order", [1, 2])
def test_a_box_on_planes_of_symmetry_has_no_end_of_a_clamp(order):
    """At a corner a triangle of a free face may have all its nodes on clamped ones; its side is no end of a clamp."""
    mesh = made_up_solids.box(divisions=(2, 2, 2), order=order)

    def warned(groups: list[str], stress: np.ndarray) -> bool:
        spec = SimpleNamespace(
            name="box",
            clamps=[SimpleNamespace(on=on) for on in groups],
            mesh=SimpleNamespace(drawn=False),
        )
        free = np.tile(np.eye(3), (len(mesh.points), 1, 1))
        for on in groups:
            axis = {"left": 0, "front": 1}.get(on, 2)
            free[np.unique(mesh.groups[on]), axis, axis] = 0.0
        elasticity = SimpleNamespace(supports=SimpleNamespace(free=free))
        member = SimpleNamespace(interfaces=[], elasticity=elasticity)
        body = SimpleNamespace(mesh=mesh, spec=spec, member=member, material=Material(**STEEL))
        return bool(_singular(body, stress, "Pa"))

    mesh.groups["part"] = mesh.groups["bottom"][:4]
    cells = np.eye(len(mesh.triangles))
    assert not any(warned(["left", "front", "bottom"], cell) for cell in cells)
    assert any(warned(["part"], cell) for cell in cells)
    assert not warned(["part"], np.ones(len(cells)))  # it stands everywhere


@pytest.mark.parametrize("more", [-1e-15, 0.0, 1e-15])
def test_rounding_does_not_choose_where_friction_crosses_air(more):
    """Nodes that slip all bear their bound; the one whose gap is widest is named."""
    interface = SimpleNamespace(name="c", law=SimpleNamespace(name="tresca"), xy=np.eye(3, 2))
    state = SimpleNamespace(
        interface=interface,
        status=np.array(["slip", "open", "open"]),
        gap=np.array([0.0, 0.2, 0.1]),
        forces=np.array([[0, 3], [1, 0], [1 + more, 0]]),
    )
    (found,) = _held_through_air(state, 0.0, "m")
    assert "at (0, 1), where the gap is 0.2 m" in found


@pytest.mark.parametrize(
    ("friction", "warned"),
    [
        ({"law": "tresca", "slip_bound": 1e5}, True),
        ({"law": "tresca", "slip_bound": 1e3}, True),
        ({"law": "coulomb", "coefficient": 0.3}, False),
    ],
)
def test_friction_across_air_is_a_warning(friction, warned, capfd):
    """Tresca's bound, as it is published, holds a block half a metre from the wall; a clamp bears it, too."""
    held = block("block", 0.5, 0.0, (1, 1), [{"on": "right", "x": 0.0, "y": 0.0}])
    held["volume_force"] = [0.0, -1e4]
    scene = {
        "body": [held],
        "rigid": [{"name": "wall", "shape": "plane", "point": [0, 0], "normal": [1, 0]}],
        "contact": [{"bodies": ["block", "wall"], "on": ["left"], "friction": friction}],
    }
    answer = ddmpi.solve(scene, MPI.COMM_SELF, progress=True)
    found = beside_clamps(answer.summary["warnings"])
    assert len(found) == warned, found
    assert all(
        "contact.block-wall: friction of open nodes bears 100% of its forces, as at (0.5, " in each
        and "the gap is 0.5 m:" in each
        for each in found
    )
    assert "closed nowhere: block-wall (at least 0.5 m apart)\n" in capfd.readouterr().out


@pytest.mark.parametrize(
    ("friction", "factors", "said"),
    [
        ({"law": "tresca", "slip_bound": 1e6}, [0, 1, 0], ""),
        ({"law": "none"}, [0, -1, -2], "closed nowhere at any time: upper-lower (at least 0.000"),
    ],
)
def test_a_contact_that_was_closed_before_is_not_said_to_be_open(friction, factors, said, capfd):
    """Nor is its friction worth a warning, when at last it holds nothing."""
    upper = block(
        "upper", 0.0, 1.0, (2, 1), [{"on": "top", "x": 0.0, "y": -1e-4, "history": "press"}]
    )
    scene = pair_of(upper, block("lower", 0.0, 0.0, (2, 1), ["bottom"]), friction)
    scene |= {
        "time": {"points": [1.0, 2.0]},
        "history": {"press": {"times": [0.0, 1.0, 2.0], "factors": factors}},
    }
    answer = ddmpi.solve(scene, MPI.COMM_SELF, progress=True)
    assert answer.certified and not any("open nodes" in each for each in answer.summary["warnings"])
    told = capfd.readouterr().out
    assert ("closed nowhere" in told) == bool(said) and said in told


@pytest.mark.parametrize(("slave", "scale"), [("base", 1.0), ("base", 1e-3), ("layer", 1.0)])
def test_a_deep_overlap_between_nodes_is_a_warning(slave, scale):
    """Rows at the nodes of a coarse base do not see the ripples of a layer that is pressed on it."""
    base = block("base", 0.0, 0.0, (2 * scale, scale), ["bottom"], divisions=(2, 2))
    layer = block(
        "layer",
        0.1 * scale,
        scale,
        (1.8 * scale, 0.1 * scale),
        [{"on": "top", "x": 0.0, "y": f"-{1e-5 * scale} * cos(6 * pi * x / {scale})"}],
        divisions=(32, 4),
    )
    scene = pair_of(layer, base, {"law": "none"})
    scene["contact"][0]["slave"] = slave
    summary = certified(scene).summary
    found = [each for each in summary["warnings"] if "between nodes" in each]
    assert len(found) == (slave == "base")
    assert all(
        "contact.layer-base: the bodies overlap by" in each and "slave = 'layer'" in each
        for each in found
    )
    assert (summary["contacts"]["layer-base"]["pointwise_penetration"] > 0.5e-5 * scale) == (
        slave == "base"
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("order", "rigid", "moved"), [(1, False, -1e-3), (2, False, 1e-3), (2, True, -1e-3)]
)
def test_a_tip_that_no_row_feels_is_a_warning(order, rigid, moved, capfd):
    """A corner of a hexahedron sinks by 1 mm into a base whose rows, or into a plane that its own rows, feel only a
    mean of the gaps: the answer says so, and not that the two stand apart."""
    corners = [
        [0.3, 0.3, 0.0],
        [0.8, 0.2, 0.1],
        [0.8, 0.8, 0.1],
        [0.2, 0.8, 0.1],
        [0.2, 0.2, 0.8],
        [0.8, 0.2, 0.8],
        [0.8, 0.8, 0.8],
        [0.2, 0.8, 0.8],
    ]
    tip = {
        "name": "tip",
        "clamp": [{"on": "top", "x": 0.0, "y": 0.0, "z": moved}],
        "mesh": {"shape": "hexahedron", "corners": corners, "divisions": [4, 4, 4], "order": order},
        "material": {"young": 1e9, "poisson": 0.3},
    }
    base = solid_scenes.box(
        "base", (0, 0, -1), (1, 1, 1), (5, 5, 5), order, young=1e9, clamp=["bottom"]
    )
    floor = {"name": "floor", "shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}
    scene = {"body": [tip, base], "contact": [{"bodies": ["tip", "base"], "on": ["bottom", "top"]}]}
    if rigid:
        scene = {
            "body": [tip],
            "rigid": [floor],
            "contact": [{"bodies": ["tip", "floor"], "on": ["bottom"]}],
        }
    answer = ddmpi.solve(scene, MPI.COMM_SELF, progress=True)
    (state,), found = (
        answer.contacts.values(),
        [each for each in answer.summary["warnings"] if "overlap by" in each],
    )
    assert answer.certified and not state.normal_force.any() and len(found) == (moved < 0.0)
    assert all(
        "by 0.001 m between nodes that bear forces, as at (0.3, 0.3, " in each for each in found
    )
    assert state.deepest == pytest.approx(max(-moved, 0.0), rel=1e-9, abs=1e-15)
    assert f"(at least {'0' if moved < 0 else '0.001'} m apart)" in capfd.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("order", [1, 2])
@pytest.mark.parametrize("around", [(60, 52), (24, 90)])
def test_a_shaft_in_a_bush_of_its_radius_overlaps_by_nothing(around, order):
    """Without any load, arcs through the nodes of two meshes overlap by 1e-8 of the radius: no mesh need be finer."""

    def ring(name: str, radii: tuple[float, float], number: int, **more) -> dict:
        shape = {"shape": "annulus", "center": [0.0, 0.0], "radii": list(radii)}
        mesh = shape | {"angles": [0.0, 360.0], "divisions": [number, 6], "order": order}
        return {"name": name, "mesh": mesh, "material": {"young": 2.1e11, "poisson": 0.3}, **more}

    shaft = ring("shaft", (4.0, 10.0), around[0])
    bush = ring("bush", (10.0, 20.0), around[1], clamp=["outer"])
    answer = certified(
        {
            "body": [shaft, bush],
            "contact": [{"bodies": ["shaft", "bush"], "on": ["outer", "inner"]}],
        }
    )
    (contact,) = answer.contacts.values()
    assert 0.0 < contact.deepest < 1e-6
    assert not any("overlap" in warning for warning in answer.summary["warnings"])
