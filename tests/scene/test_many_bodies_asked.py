"""Scenes of any number of bodies, contacts and rigid partners: what is read, and what is refused in which words."""

import tomllib
from functools import partial

import pytest
import test_scene
from scenes import to_toml

from ddmpi.errors import InputError
from ddmpi.scene.contacts import Circle, Coulomb, Gap, NoFriction, Plane

TEXT = """
rigid = [{ name = "floor", shape = "plane", point = [0.0, 0.0], normal = [0.0, 1.0] },
         { name = "bore", shape = "circle", center = [0.0, 2.0], radius = 1, inside = true }]

[[contact]]
bodies = ["shaft", "hub"]
on = ["outer", "inner"]
gap = -1e-4
friction = { law = "coulomb", coefficient = 0.3 }

[[contact]]
bodies = ["plate", "floor"]
on = ["bottom"]
kind = "unilateral"

[[contact]]
name = "glue"
bodies = ["hub", "plate"]
on = ["outer", "top"]
kind = "bonded"
gap = { along = "y", points = [0, 1], values = [-1e-3, 1e-3] }

[[contact]]
bodies = ["hub", "bore"]
on = ["outer"]

[[body]]
name = "shaft"
mesh = { shape = "annulus", center = [0.0, 2.0], radii = [0.1, 0.5], angles = [0, 360], divisions = [24, 4] }
material = { young = 2e11, poisson = 0.3 }

[[body]]
name = "hub"
mesh = { shape = "annulus", center = [0.0, 2.0], radii = [0.5, 1.0], angles = [0, 360], divisions = [24, 4] }
material = { young = 1e11, poisson = 0.3 }
volume_force = [0.0, -1e4]

[[body]]
name = "plate"
mesh = { shape = "quadrilateral", corners = [[-1, 0], [1, 0], [1.5, 1], [-1.5, 1]], divisions = [8, 4] }
material = { young = 2e11, poisson = 0.3 }
"""

DATA = tomllib.loads(TEXT)


scene, message = (
    partial(function, text=TEXT) for function in (test_scene.scene, test_scene.message)
)


def test_assembly_is_read():
    """A scene may have any number of bodies, rigid partners and contacts of both kinds."""
    assembly = scene()
    assert [body.name for body in assembly.body] == ["shaft", "hub", "plate"]
    assert assembly.rigid == [
        Plane(name="floor", point=(0.0, 0.0), normal=(0.0, 1.0), displacement=(0.0, 0.0)),
        Circle(name="bore", center=(0.0, 2.0), radius=1.0, inside=True, displacement=(0.0, 0.0)),
    ]
    assert [contact.name for contact in assembly.contact] == [
        "shaft-hub",
        "plate-floor",
        "glue",
        "hub-bore",
    ]
    assert [contact.kind for contact in assembly.contact] == [
        "unilateral",
        "unilateral",
        "bonded",
        "unilateral",
    ]
    assert [len(contact.on) for contact in assembly.contact] == [2, 1, 2, 1]
    # A gap of None is measured.
    assert [contact.gap for contact in assembly.contact] == [
        -1e-4,
        None,
        Gap(along="y", points=[0.0, 1.0], values=[-1e-3, 1e-3]),
        None,
    ]
    assert assembly.contact[0].friction == Coulomb(coefficient=0.3)
    assert assembly.contact[2].friction == NoFriction()


def test_one_body_with_rigid_partners_is_a_scene():
    """One body between rigid partners needs no other body."""
    contacts = [DATA["contact"][1], {"bodies": ["plate", "bore"], "on": ["top"]}]
    alone = scene(
        text=to_toml({"body": DATA["body"][2:], "rigid": DATA["rigid"], "contact": contacts})
    )
    assert [body.name for body in alone.body] == ["plate"] and len(alone.contact) == 2


REFUSED = [
    (
        "rigid=[{name='floor', point=[0, 0], normal=[0, 1]}]",
        "rigid.floor.shape: this key is required and missing",
    ),
    ("rigid.floor.normal=[0, 0]", "rigid.floor: normal must not be zero"),
    (
        "rigid.flor.point=[0, 0]",
        "there is no entry 'flor'; did you mean 'floor'? (entries: floor, bore)",
    ),
    ("rigid.bore.name=hub", "rigid.hub: a [[body]] has this name, too; rename one of them"),
    (
        "contact.1.bodies=['plate', 'flor']",
        "contact.plate-flor.bodies: there is no body or rigid partner 'flor'; did "
        "you mean 'floor'? (bodies: shaft, hub, plate; rigid: floor, bore)",
    ),
    (
        ["contact.0.name=c", "contact.1.name=c_sides"],
        "contact.c_sides: this contact and contact.c would both write "
        'contact_c_sides.csv; rename one of them by name = "…"',
    ),
    (
        ["contact.0.name=c_legs", "contact.1.name=c"],
        "contact.c_legs would both write contact_c_legs.csv;",
    ),
    (
        ["contact.0.name=Éa", "contact.1.name=ÉA"],
        ".csv, which are the same on some file systems; rename",
    ),
    (
        f"contact.0.name={'€' * 100}",
        "is too long for the name of a file|.csv has 312 bytes, and 255 are allowed",
    ),
    (
        [f"body.0.name={'€' * 90}", f"contact.0.bodies=['{'€' * 90}','hub']"],
        'is too long for the name of a file|give the contact a shorter name = "…"',
    ),
    (
        "contact.1.bodies=['floor', 'plate']",
        "contact.floor-plate.bodies: 'floor' is rigid and comes second; write "
        'bodies = ["plate", "floor"], on = ["bottom"]',
    ),
    (
        "contact.1.bodies=['floor', 'bore']",
        "contact.floor-bore.bodies: 'floor' and 'bore' are both rigid; one of them must be a [[body]]",
    ),
    (
        "contact.1.on=['bottom', 'top']",
        "contact.plate-floor.on: 'floor' is rigid and has no boundary groups; write on "
        "= [\"bottom\"], the one of 'plate'",
    ),
    (
        "contact.0.on=['outer']",
        "contact.shaft-hub.on: names a boundary group of 'shaft', and must name one of 'hub', "
        'too; write on = ["outer", "…"]',
    ),
    (
        "contact.0.kind=bonded",
        'contact.shaft-hub: friction does not go with kind = "bonded"|leave one of them out',
    ),
    (
        "body.plate.mesh.corners=[[0,0],[0,1],[1,1],[1,0]]",
        "body.plate.mesh: corners run clockwise; write them "
        "counter-clockwise, as in corners = [[0.0, 0.0], [1.0, "
        "0.0], [1.0, 1.0], [0.0, 1.0]]",
    ),
    (
        "body.plate.mesh.corners=[[0,0],[1,0],[0.2,0.2],[0,1]]",
        "body.plate.mesh: corners must be those of a convex quadrilateral in their order",
    ),
    ("body.plate.mesh.corners=[[0,0],[1,0],[2,0],[0,1]]", "convex|0 or 180 degrees"),
    ("body.plate.mesh.corners=[[0,0],[1,1],[1,0],[0,1]]", "convex|order along its boundary"),
    (
        "body.plate.mesh.size=[1, 1]",
        'size belongs to shape = "rectangle" or "box", not to shape = "quadrilateral"',
    ),
    (
        "body.plate.mesh.origin=[1, 1]",
        'origin belongs to a rectangle or a box, not to shape = "quadrilateral"',
    ),
    (
        'body.hub.mesh={shape="annulus",center=[0,0],radii=[1,2],divisions=[9,1]}',
        "body.hub.mesh: |angles = [start, end]|angles is missing",
    ),
    ("body.hub.mesh.radii=[2, 1]", "body.hub.mesh: radii = [inner, outer] must ascend"),
    (
        'body.hub.mesh={geometry="hub.step", size=1.0, size_on={bore=0.0}}',
        "body.hub.mesh.size_on.bore: expected a number > 0",
    ),
    ("body.hub.clamp=[0]", "body.hub.clamp.0: expected a whole number >= 1"),
    (
        "body.hub.traction=[{on=[], pressure=1.0}]",
        "body.hub.traction.0.on: expected a list of length >= 1",
    ),
    ("body.hub.mesh.radii=[0, 1]", "body.hub.mesh.radii.0: expected a number > 0"),
    ("body.hub.mesh.angles=[90, 0]", "angles = [start, end] must ascend|[90, 0]"),
    ("body.hub.mesh.angles=[0, 361]", "at most 360 degrees"),
    ("body.hub.mesh.divisions=[2, 1]", "2 around make cells of 180 degrees; they must be less"),
]
"""Settings, and what the message has: parts of it, in any order, between bars."""


@pytest.mark.parametrize(
    ("settings", "words"), REFUSED, ids=[str(settings)[:60] for settings, _ in REFUSED]
)
def test_refusal_names_file_key_and_remedy(settings, words):
    """A wrong assembly is refused in one line that names file, key and what would be right."""
    test_scene.refuses(settings, words, TEXT)


FIT = {"bodies": ["shaft", "hub"], "on": ["outer", "inner"]}
TWO = {"body": DATA["body"][:2], "contact": [FIT]}
BEYOND = {
    "three bodies": TWO | {"body": DATA["body"]},
    "a rigid partner": TWO | {"rigid": DATA["rigid"][:1]},
    "two contacts": TWO | {"contact": [FIT, FIT | {"name": "second", "on": ["inner", "outer"]}]},
    "bonded": TWO | {"contact": [FIT | {"kind": "bonded"}]},
}


@pytest.mark.parametrize(
    ("setting", "asks"),
    [
        ("method.outer=relaxation", 'method.outer = "relaxation" is for'),
        ("method.outer=anderson", 'method.outer = "anderson" is for'),
        ("method.theta=0.2", 'method.theta (outer = "relaxation") is for'),
        ("method.algorithm=modified", 'method.algorithm (outer = "relaxation") is for'),
        ("method.splitting=step1", 'method.splitting (outer = "relaxation") is for'),
    ],
)
@pytest.mark.parametrize("beyond", BEYOND)
def test_published_iterations_are_refused_beyond_two_bodies(beyond, setting, asks):
    """Iterations that diverge beyond two bodies in one contact are refused with the reason and what works."""
    text = message(setting, text=to_toml(BEYOND[beyond]))
    for fragment in (
        asks,
        "two supported bodies with one unilateral contact",
        "diverges for theta >= 0.02",
        'outer = "newton", the default',
    ):
        assert fragment in text
    assert scene(text=to_toml(BEYOND[beyond])).method.outer == "newton"
    assert scene(setting, text=to_toml(TWO)).method.outer in ("relaxation", "anderson")


@pytest.mark.parametrize(
    "setting, key",
    [
        (
            'body.hub.clamp=["inner", { on = "outer", x = 1e-3, history = "pul" }]',
            "body.hub.clamp.1",
        ),
        (
            'body.hub.traction=[{ on = "outer", pressure = 1e6, history = "pul" }]',
            "body.hub.traction.0",
        ),
        ('body.hub.volume_force={ value = [0, -1e4], history = "pul" }', "body.hub.volume_force"),
        ("rigid.floor.history=pul", "rigid.floor"),
        ('contact.shaft-hub.gap={ value = -1e-4, history = "pul" }', "contact.shaft-hub.gap"),
    ],
)
def test_what_follows_a_history_names_one_that_there_is(setting, key):
    """Whatever follows a history: a misspelt name is refused with its key."""
    followed = ("time.points=[1.0]", "history.pull.times=[0, 1]", "history.pull.factors=[0, 1]")
    with pytest.raises(
        InputError, match=rf"{key}\.history: there is no \[history.pul\]; did you mean 'pull'"
    ):
        scene(*followed, setting)
    assert scene(*followed, setting.replace("pul", "pull")).followed == ["pull"]
