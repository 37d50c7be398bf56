"""Sectors of wheels and periodic cells: the answers of the whole, on meshes that are images of each other."""

from copy import deepcopy
from typing import Any

import numpy as np
import pytest
from mpi4py import MPI
from scenes import assert_refused, by_name, certified, rectangle

import ddmpi

FRICTION = {"law": "coulomb", "coefficient": 0.3}

STEEL = {"young": 2.1e11, "poisson": 0.3}

SWIRL = "1e8 * (1 + 0.2*x*y*(x**2 - y**2))"
"""A pressure that is alike in each quarter, and not alike in its two halves."""


def segment(name: str, start: float, end: float, order: int, cells: int = 4, **keys: Any) -> dict:
    """A part of a ring from 1 to 2."""
    mesh = {"shape": "annulus", "center": [0.0, 0.0], "radii": [1.0, 2.0], "order": order}
    mesh |= {"angles": [start, end], "divisions": [cells, 4]}
    return {"name": name, "mesh": mesh, "material": STEEL} | keys


def wedge(
    name: str, low: float, radii: tuple[float, float] = (1.0, 2.0), cells: int = 3, **keys: Any
) -> dict:
    """A quarter of a square ring, one high."""
    inner, outer = radii
    plane = [[inner, 0.0], [outer, 0.0], [0.0, outer], [0.0, inner]]
    corners = [[*at, z] for z in (low, low + 1.0) for at in plane]
    mesh = {"shape": "hexahedron", "corners": corners, "divisions": [cells, 3, 2]}
    return {"name": name, "mesh": mesh, "material": STEEL} | keys


def wheel(bodies: list[dict], contacts: list[dict], **more: Any) -> tuple[dict, dict]:
    """A sector, and the whole of it: its bodies and three copies of each, turned by quarters.

    A contact with an image is one with the copy that is next.
    """
    axis = {"axis": [0.0, 0.0, 1.0]} if "corners" in bodies[0]["mesh"] else {}
    image = {"turn": 90.0} | axis
    sector = {"body": bodies, "contact": deepcopy(contacts)} | more
    whole: dict[str, Any] = {"body": [], "contact": []} | deepcopy(more)
    for k in range(4):
        for body in bodies:
            own = dict(body)
            if k:
                del own["mesh"], own["material"]
                own |= {"copy": {"of": f"{body['name']}0", "turn": 90.0 * k} | axis}
            whole["body"].append(own | {"name": f"{body['name']}{k}"})
        for contact in contacts:
            next_one = (k + 1) % 4 if contact.get("image") else k
            first, second = contact["bodies"]
            rigid = second in {partner["name"] for partner in more.get("rigid", ())}
            both = [f"{first}{k}", second if rigid else f"{second}{next_one}"]
            own = {key: value for key, value in contact.items() if key != "image"}
            whole["contact"].append(own | {"name": f"{contact['name']}{k}", "bodies": both})
    for contact in sector["contact"]:
        if contact.get("image"):
            contact["image"] = image
    return sector, whole


def flanks(*bodies: str, **keys: Any) -> dict:
    first, second = bodies if len(bodies) > 1 else bodies * 2
    on = keys.pop("on", ["end", "start"])
    return {"name": f"{first}-{second}", "bodies": [first, second], "on": on, "image": True} | keys


BOND = {"kind": "bonded"}

SPIN = ["1e7 * x", "1e7 * y"]


def rings(order: int, **keys: Any) -> tuple[dict, dict]:
    """A ring that turns, heated, under a pressure that twists it."""
    loads = {"traction": [{"on": "outer", "pressure": SWIRL}], "temperature": "40 * (x**2 + y**2)"}
    ring = segment("ring", 0.0, 90.0, order, volume_force=SPIN, **loads)
    ring["material"] = STEEL | {"expansion": 1.2e-5}
    return wheel([ring], [flanks("ring", **keys)])


def two_parts(order: int) -> tuple[dict, dict]:
    """Two segments a quarter, of which the second meets the next first with friction."""
    loads = {"traction": [{"on": "outer", "pressure": SWIRL}]}
    parts = [
        segment("one", 0.0, 30.0, order, 2, **loads),
        segment("two", 30.0, 90.0, order, 4, **loads),
    ]
    inner = {"name": "inner", "bodies": ["one", "two"], "on": ["end", "start"]}
    return wheel(parts, [inner | {"friction": FRICTION}, flanks("two", "one", friction=FRICTION)])


def flanges() -> tuple[dict, dict]:
    """Two square rings on each other, that a plate presses together and that turn."""
    spin = {"volume_force": [*SPIN, 0.0]}
    bodies = [
        wedge("lower", 0.0, clamp=["bottom"], **spin),
        wedge("upper", 1.0, **spin),
    ]
    on = ["back", "front"]
    contacts = [
        {"name": "joint", "bodies": ["upper", "lower"], "on": ["bottom", "top"]}
        | {"friction": FRICTION},
        {"name": "plate", "bodies": ["upper", "plate"], "on": ["top"], "friction": FRICTION},
        flanks("lower", on=on, **BOND),
        flanks("upper", on=on, friction=FRICTION),
    ]
    plate = {
        "name": "plate",
        "shape": "plane",
        "point": [0.0, 0.0, 2.0],
        "normal": [0.0, 0.0, -1.0],
    }
    sector, whole = wheel(bodies, contacts, rigid=[plate | {"force": [0.0, 0.0, -4e8]}])
    whole["rigid"][0]["force"] = [0.0, 0.0, -16e8]
    return sector, whole


WHEELS = {
    "bonded": rings(1, **BOND),
    "bonded and quadratic": rings(2, **BOND),
    "with friction": rings(1, friction=FRICTION),
    "quadratic with friction": rings(2, friction=FRICTION),
    "of two parts": two_parts(1),
    "of two quadratic parts": two_parts(2),
    "flanges": flanges(),
}


def strained(answer: Any, name: str) -> np.ndarray:
    """The displacement (nv, d) of a body, in the plane without its mean turn about the origin."""
    body = answer.bodies[name]
    u, x = body.displacement, body.points
    if x.shape[1] > 2:
        return u
    around = x[:, ::-1] * (-1.0, 1.0)
    return u - (u * around).sum() / (around**2).sum() * around


@pytest.mark.parametrize("wheel", by_name(WHEELS, "quadratic with friction"))
def test_a_sector_is_a_part_of_its_wheel(wheel):
    """Displacements, forces, slip and statuses are those of each quarter, and those of all sectors the sums."""
    sector, whole = wheel
    tight = {"method": {"tolerance": 1e-11}}
    one, all_of_it = certified(sector | tight), certified(whole | tight)
    for body in sector["body"]:
        name = body["name"]
        found, right = strained(one, name), strained(all_of_it, f"{name}0")
        assert found == pytest.approx(right, abs=1e-8 * np.abs(right).max())
        mises = all_of_it.bodies[f"{name}0"].von_mises
        assert one.bodies[name].von_mises == pytest.approx(mises, abs=1e-8 * mises.max())
    sums = one.summary["whole"]
    assert sums["sectors"] == 4
    for contact in sector["contact"]:
        name = contact["name"]
        image = one.summary["contacts"][name].get("image")
        assert image == ({"turn": 90.0, "sectors": 4} if contact.get("image") else None)
        mine = one.contacts[name]
        numbered = [all_of_it.contacts[f"{name}{k}"] for k in range(4)]
        if mine.interface.dimension == 3:
            # forces at an edge of several contacts are shared in more than one way
            pressed = sums["contacts"]["plate"]["normal_force"]
            assert pressed == pytest.approx(16e8, rel=1e-7)
            continue
        size = np.abs(numbered[0].forces).max()
        assert mine.normal_force == pytest.approx(numbered[0].normal_force, abs=1e-7 * size)
        assert (mine.status == numbered[0].status).all()
        told = [all_of_it.summary["contacts"][f"{name}{k}"] for k in range(4)]
        force = np.sum([each["force"] for each in told], axis=0)
        assert sums["contacts"][name]["force"] == pytest.approx(force, abs=1e-6 * size)
        total = sum(each["normal_force"] for each in told)
        assert sums["contacts"][name]["normal_force"] == pytest.approx(total, rel=1e-7)
    for body in sector["body"]:
        energies = (all_of_it.summary["bodies"][f"{body['name']}{k}"]["energy"] for k in range(4))
        assert sums["bodies"][body["name"]]["energy"] == pytest.approx(sum(energies), rel=1e-7)


@pytest.mark.slow
def test_a_bolt_of_a_sector_is_one_of_those_of_the_whole():
    """A ring of shanks holds a flange that turns, under a plate that a load lifts: displacements, and what all bear."""
    bolt, load, spin = 2e8, 2e7, {"volume_force": [*SPIN, 0.0]}
    bodies = [
        wedge("lower", 0.0, clamp=["bottom"]),
        wedge("flange", 1.0, (1.0, 1.5), 2, **spin),
        wedge("shank", 1.0, (1.6, 2.0), 1),
    ]
    thread = {"name": "thread", "bodies": ["shank", "lower"], "on": ["bottom", "top"]} | BOND
    contacts = [
        thread | {"pretension": {"force": bolt, "along": [0.0, 0.0, -1.0]}},
        {"name": "head", "bodies": ["shank", "plate"], "on": ["top"]} | BOND,
        {"name": "above", "bodies": ["flange", "plate"], "on": ["top"], "friction": FRICTION},
        {"name": "below", "bodies": ["flange", "lower"], "on": ["bottom", "top"]}
        | {"friction": FRICTION},
        *(flanks(each["name"], on=["back", "front"], **BOND) for each in bodies),
    ]
    plate = {"name": "plate", "shape": "plane", "point": [0.0, 0.0, 2.0]}
    plate |= {"normal": [0.0, 0.0, -1.0], "force": [0.0, 0.0, load]}
    sector, whole = wheel(bodies, contacts, rigid=[plate])
    whole["rigid"][0]["force"] = [0.0, 0.0, 4.0 * load]
    tight = {"method": {"tolerance": 1e-11}}
    one, all_of_it = certified(sector | tight), certified(whole | tight)
    size = max(np.abs(body.displacement).max() for body in one.bodies.values())
    for name, body in one.bodies.items():
        right = all_of_it.bodies[f"{name}0"].displacement
        assert body.displacement == pytest.approx(right, abs=1e-8 * size)
    sums = one.summary["whole"]["contacts"]
    assert -sums["thread"]["force"][2] == pytest.approx(4.0 * bolt, rel=1e-8)
    for name in ("above", "below"):
        assert sums[name]["normal_force"] == pytest.approx(4.0 * (bolt - load), rel=1e-6)


@pytest.mark.slow
def test_forces_that_slide_around_a_wheel_are_those_of_its_sectors():
    """With little friction some flanks slip, and slip by as much as in the whole."""
    sector, whole = rings(1, friction={"law": "coulomb", "coefficient": 0.25})
    one, all_of_it = certified(sector), certified(whole)
    mine, right = one.contacts["ring-ring"], all_of_it.contacts["ring-ring0"]
    assert (mine.status == "slip").any()
    assert mine.slip == pytest.approx(right.slip, abs=1e-6 * np.abs(right.slip).max())


@pytest.mark.every(3)
@pytest.mark.parametrize("around", [(6, 9), (9, 6)])
@pytest.mark.parametrize("law", [BOND, {"friction": FRICTION}])
def test_flanks_that_do_not_match_are_those_of_a_ring(around, law):
    """Two parts of a quarter with other cells along the flank bear the hoop force of a ring under pressure."""
    p = 1e8
    parts = []
    for name, start, end, across in ("one", 0.0, 40.0, around[0]), ("two", 40.0, 90.0, around[1]):
        part = segment(name, start, end, 2, 6, traction=[{"on": "outer", "pressure": p}])
        part["mesh"]["divisions"] = [6, across]
        parts.append(part)
    inner = {"name": "inner", "bodies": ["one", "two"], "on": ["end", "start"]} | law
    sector, _ = wheel(parts, [inner, flanks("two", "one", **law)])
    answer = certified(sector)
    # Lamé, plane strain
    a, b, E, nu = 1.0, 2.0, STEEL["young"], STEEL["poisson"]
    for name in ("one", "two"):
        body = answer.bodies[name]
        r = np.linalg.norm(body.points, axis=1)
        moved = (body.displacement * body.points).sum(axis=1) / r
        right = -p * b**2 / (b**2 - a**2) * (1 + nu) / E * ((1 - 2 * nu) * r + a**2 / r)
        assert moved == pytest.approx(right, rel=4e-4)
    for name in ("inner", "two-one"):
        total = answer.summary["contacts"][name]["normal_force"]
        assert total == pytest.approx(p * b, rel=1e-9)


def cell(cells: int, start: float = 0.0, **flank: Any) -> dict:
    """So many cells of a layer, 2 wide and 1 high, that waves press onto a floor, each cell alike."""
    body = rectangle("layer", [start, 0.0], [2.0 * cells, 1.0], [8 * cells, 4])
    body["traction"] = [
        {"on": "top", "value": ["2e4 * sin(pi * x)", "-1e5 * (1 + 0.9 * cos(pi * x))"]}
    ]
    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    image = {"shift": [-2.0 * cells, 0.0]}
    contacts = [
        {"name": "flank", "bodies": ["layer"] * 2, "on": ["left", "right"], "image": image} | flank,
        {"name": "base", "bodies": ["layer", "floor"], "on": ["bottom"], "friction": FRICTION},
    ]
    return {"body": [body], "rigid": [floor], "contact": contacts, "method": {"tolerance": 1e-10}}


@pytest.mark.parametrize(
    "flank", by_name({"bonded": BOND, "with friction": {"friction": FRICTION}}, "with friction")
)
def test_a_periodic_cell_is_one_of_many(flank):
    """One cell has the displacements of each of two, and of one that begins elsewhere."""
    if "friction" in flank:  # warm, so that flanks are pressed
        flank = flank | {"gap": -1e-7}
    one = certified(cell(1, **flank))
    at = {tuple(np.round(x, 9)): u for x, u in _of("layer", one)}
    size = max(np.abs(u).max() for u in at.values())
    assert one.summary["contacts"]["flank"]["image"] == {"shift": [-2.0, 0.0], "sectors": None}
    assert "whole" not in one.summary
    if "friction" not in flank:  # a joint of cells is none
        for other in (certified(cell(2, **flank)), certified(cell(1, 0.5, **flank))):
            for x, u in _of("layer", other):
                place = np.round([x[0] % 2.0, x[1]], 9)
                assert u == pytest.approx(at[tuple(place)], abs=1e-7 * size)


def _of(name: str, answer: Any) -> Any:
    return zip(answer.bodies[name].points, answer.bodies[name].displacement, strict=True)


def test_a_cell_that_is_pressed_is_confined():
    """A bonded cell under a uniform pressure cannot strain aside: p ν / (1 − ν) across its flanks."""
    pressed = cell(1, **BOND)
    pressed["body"][0]["traction"] = [{"on": "top", "pressure": 1e5}]
    pressed["contact"][1]["friction"] = {"law": "none"}
    answer = certified(pressed)
    nu = pressed["body"][0]["material"]["poisson"]
    flank = answer.contacts["flank"]
    assert flank.pressure == pytest.approx(nu / (1 - nu) * 1e5 * np.ones(5), rel=1e-7)


@pytest.mark.every(3)
@pytest.mark.parametrize("elements", [{}, {"elements": "bricks"}], ids=["tetrahedra", "bricks"])
@pytest.mark.parametrize("order", [1, 2])
def test_shifts_of_a_cell_in_space_are_held(order, elements):
    """A layer of cells in two directions is confined along both, evenly, and nothing holds its shifts, but to rounding."""
    mesh = {"shape": "box", "size": [2.0, 2.0, 1.0], "divisions": [4, 4, 2], "order": order}
    layer = {"name": "layer", "mesh": mesh | elements, "material": STEEL}
    layer |= {"clamp": [{"on": "bottom", "z": 0.0}], "traction": [{"on": "top", "pressure": 1e6}]}
    sides = {"x": (["right", "left"], [2.0, 0.0, 0.0]), "y": (["back", "front"], [0.0, 2.0, 0.0])}
    flanks = [
        {"name": name, "bodies": ["layer"] * 2, "on": on, "image": {"shift": shift}} | BOND
        for name, (on, shift) in sides.items()
    ]
    answer = certified({"body": [layer], "contact": flanks})
    moved = [motion["motion"] for motion in answer.summary["held_motions"]]
    assert moved == [f"layer can move along {axis} without any force" for axis in "xy"]
    assert answer.summary["undetermined"] == []
    nu = STEEL["poisson"]
    for contact in answer.contacts.values():
        # at the edges four images of a node are tied four times
        assert contact.pressure == pytest.approx(nu / (1 - nu) * 1e6, rel=1e-6)
        assert np.abs(contact.shear).max() < 1.0
    heights = answer.bodies["layer"].points[:, 2]
    sinks = -1e6 * (1 + nu) * (1 - 2 * nu) / (STEEL["young"] * (1 - nu)) * heights
    found = answer.bodies["layer"].displacement
    assert found[:, 2] == pytest.approx(sinks, abs=1e-7 * np.abs(sinks).max())


@pytest.mark.mpi(ranks=2)
def test_an_image_is_of_a_body_of_another_rank():
    """Two parts of a sector on two ranks have the answer of one rank."""
    sector = two_parts(1)[0] | {"method": {"tolerance": 1e-10}}
    one, two = certified(sector), certified(sector, MPI.COMM_WORLD)
    for name, contact in one.contacts.items():
        size = np.abs(contact.forces).max()
        assert two.contacts[name].forces == pytest.approx(contact.forces, abs=1e-9 * size)
    assert two.summary["whole"]["bodies"].keys() == {"one", "two"}


def test_a_sector_turns_freely_and_does_not_slide():
    """Of the motions of a ring in the plane only the turn about its axis is free; a moment has no equilibrium."""
    sector = rings(1, **BOND)[0]
    held = certified(sector).summary["held_motions"]
    turns = "turn counterclockwise about (0, 0)"
    assert [motion["motion"] for motion in held] == [f"ring can {turns} without any force"]
    twisted = deepcopy(sector)
    twisted["body"][0]["traction"].append({"on": "inner", "value": ["-1e6 * y", "1e6 * x"]})
    reason = ddmpi.solve(twisted, MPI.COMM_SELF).reason
    assert reason.startswith(f"no equilibrium: ring would {turns}: ")
    assert reason.endswith("no contact of ring with itself or its image resists it; clamp the turn")
    pivot = {"turn": 90.0, "pivot": [3.0, -2.0]}
    aside = segment("ring", 0.0, 90.0, 1)
    aside["mesh"]["center"] = pivot["pivot"]
    scene = {"body": [aside], "contact": [flanks("ring", **BOND) | {"image": pivot}]}
    (held,) = certified(scene).summary["held_motions"]
    assert held["motion"] == "ring can turn counterclockwise about (3, -2) without any force"


def test_what_an_image_would_not_have_is_refused():
    """Weight is not alike in all sectors, nor is a force that grows along a periodic layer."""
    sector = rings(1, **BOND)[0]
    sector["body"][0]["volume_force"] = [0.0, -7.8e4]
    assert_refused(sector, "body.ring.volume_force: is not alike in the image of contact.ring-ring")
    layer = cell(1, **BOND)
    layer["body"][0]["volume_force"] = [0.0, "-1e3 * x"]
    assert_refused(layer, "body.layer.volume_force: is not alike", "shifted by (-2, 0)")
    layer["body"][0]["volume_force"] = [0.0, "-1e3 * (1 + y)"]
    certified(layer)


def test_clamps_of_flanks_agree_where_the_image_is():
    """Both flanks move outwards: along x the one, along y the other; by unlike ways a bond would be torn apart."""

    def ring(outwards: float) -> dict:
        clamp = [{"on": "start", "x": 1e-4}, {"on": "end", "y": outwards}]
        sector, _ = wheel([segment("ring", 0.0, 90.0, 1, clamp=clamp)], [flanks("ring", **BOND)])
        return sector

    moved = certified(ring(1e-4)).bodies["ring"]
    radius = np.hypot(*moved.points.T)
    outwards = (moved.points * moved.displacement).sum(axis=1) / radius
    on_flanks = moved.points.min(axis=1) < 1e-9
    assert on_flanks.sum() == 10
    assert outwards[on_flanks] == pytest.approx(np.full(10, 1e-4), abs=1e-12)
    torn = "contact.ring-ring: at (0, 1)", "y = 0.0002", "tear the bond apart by 0.0001 m"
    assert_refused(ring(2e-4), *torn)


def test_an_image_that_does_not_face_is_refused():
    """The end of a sector faces the start that is turned forwards, not backwards; a bond does not bridge the gap of a
    turn too far, nor the overlap of one too short."""
    sector = rings(1, **BOND)[0]
    for turn, why in (
        (-90.0, "the boundaries of 'ring' and 'ring'"),
        (120.0, "both"),
        (72.0, "both"),
    ):
        sector["contact"][0]["image"] = {"turn": turn}
        words = f"contact.ring-ring.image: with ring.start, turned by {turn:g} degrees, {why} "
        assert_refused(sector, words, ". A turn the other way is negative")
    thin = {"body": [segment("ring", 0.0, 3.6, 1, 2)], "contact": [flanks("ring", **BOND)]}
    for count, fits in (100, True), (101, False), (99, False):
        thin["contact"][0]["image"] = {"turn": 360.0 / count}
        if fits:
            certified(thin)
        else:
            assert_refused(thin, "both sides are 0.0", "and a bond holds sides that meet")
    layer = cell(1, **BOND)
    for shift, fits in (-2.003, True), (-2.005, False):  # by 0.2 % of the way, as sides are flat
        layer["contact"][0]["image"] = {"shift": [shift, 0.0]}
        if fits:
            certified(layer)
        else:
            assert_refused(
                layer,
                "contact.flank.image: with layer.right, shifted by (-2.005, 0), both sides are 0.005 m",
            )


def test_ends_without_an_image_are_refused():
    """The flanks of a cell face away from each other, bonded or not."""
    layer = cell(1)
    del layer["contact"][0]["image"]
    words = "they face away from each other. Ends of a sector or of a periodic cell have an image"
    for kind in "unilateral", "bonded":
        layer["contact"][0]["kind"] = kind
        assert_refused(layer, words)


@pytest.mark.slow
def test_a_prepared_model_knows_an_image():
    """Cases of a model with other turns, laws and sectors have the answers of runs by themselves."""
    sector = rings(1, **BOND)[0]
    with ddmpi.prepare(sector, MPI.COMM_SELF) as model:
        for change in (
            {},
            {"contact.ring-ring.kind": "unilateral", "contact.ring-ring.friction": FRICTION},
            {
                "contact.ring-ring.image.turn": 60.0,
                "body.ring.mesh.angles": [0.0, 60.0],
                "body.ring.traction.0.pressure": 1e8,
            },
            {"contact.ring-ring.image.pivot": [0.0, 0.0]},
        ):
            case, alone = model.solve(change), ddmpi.solve(sector, MPI.COMM_SELF, change)
            assert case.certified
            assert case.contacts["ring-ring"].forces == pytest.approx(
                alone.contacts["ring-ring"].forces, rel=1e-9
            )


def test_a_sector_is_told(caplog):
    """The log says of how many sectors a scene is one, and what turns with it."""
    with caplog.at_level("INFO"):
        certified(rings(1, **BOND)[0])
    assert "one of 4 sectors, the next one turned by 90 degrees" in caplog.text


@pytest.mark.parametrize("order", [1, 2])
def test_a_sector_that_may_turn_has_bars_and_no_corners(order):
    """A fifth of a disc that is shrunk on a rigid shaft (Lamé): its turn is held, and its flanks cut no corner into it."""
    inner, outer, wide, n = 10.0, 25.0, 0.01, 8
    mesh = {"shape": "annulus", "center": [0.0, 0.0], "radii": [inner, outer], "angles": [10, 82]}
    mesh |= {"divisions": [2 * n, n], "order": order}
    material = {"young": 2e5, "poisson": 0.3, "plane": "stress"}
    flanks = {"bodies": ["disc", "disc"], "on": ["end", "start"], "name": "flank"}
    displaced, stressed = "bodies.disc.displacement_max", "bodies.disc.von_mises_max"
    scene = {
        "body": [{"name": "disc", "mesh": mesh, "material": material}],
        "rigid": [{"name": "shaft", "shape": "circle", "center": [0.0, 0.0], "radius": inner}],
        "contact": [
            flanks | {"kind": "bonded", "image": {"turn": 72.0}},
            {"bodies": ["disc", "shaft"], "on": ["inner"], "gap": -wide},
        ],
        "output": {"errors": [displaced, stressed]},
    }
    answer = certified(scene)
    errors = answer.summary["errors"]
    assert "turn" in answer.summary["held_motions"][0]["motion"]
    assert abs(errors[displaced]["value"] - wide) <= errors[displaced]["bar"] < 1e-3 * wide
    assert "no limit" not in errors[stressed]["word"]
