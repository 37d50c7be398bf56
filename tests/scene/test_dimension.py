"""Scenes in the plane and in space: what says which, what is filled in, and what belongs to the other one."""

import numpy as np
import pytest
from scenes import rectangle, to_toml
from test_scene import message

from ddmpi.errors import InputError
from ddmpi.scene.reader import read_scene, write_toml
from ddmpi.scene.scene import Settled

SOLID = """
rigid = [{ name = "ball", shape = "sphere", center = [0, 0, 9], radius = 1 },
         { name = "shaft", shape = "cylinder", point = [0, 0, -1], axis = [0, 1, 0], radius = 1, inside = true },
         { name = "floor", shape = "plane", point = [0, 0, -1], normal = [0, 0, 1] }]

[[contact]]
bodies = ["upper", "lower"]
on = ["bottom", "top"]
friction = { law = "coulomb", coefficient = { along = "z", points = [0], values = [1] } }

[[body]]
name = "upper"
mesh = { shape = "box", origin = [0, 0, 1], size = [3, 1, 1], divisions = [6, 2, 2] }
material = { young = 2e11, poisson = 0.3 }
clamp = ["left", { on = "right", z = "1e-3 * z" }]
traction = [{ on = "top", value = [0.0, 0.0, "-6e7 * (1 + x * y)"] }]

[[body]]
name = "lower"
mesh.shape = "hexahedron"
mesh.corners = [[0, 0, 0], [3, 0, 0], [3, 1, 0], [0, 1, 0], [0, 0, 1], [3, 0, 1], [3, 1, 1], [0, 1, 1]]
mesh.divisions = [6, 2, 2]
material = { young = 2e11, poisson = 0.3 }
"""

PLANE = """
rigid = [{ name = "floor", shape = "plane", point = [0, -1], normal = [0, 1] }]
contact = [{ bodies = ["upper", "floor"], on = ["bottom"] }]

[[body]]
name = "upper"
mesh = { shape = "rectangle", origin = [0, 1], size = [3, 1], divisions = [6, 2] }
material = { young = 2e11, poisson = 0.3 }
traction = [{ on = "top", pressure = "1e6 * x" }]
"""

FILES = """
contact = [{ bodies = ["upper", "lower"], on = ["bottom", "top"] }]

[[body]]
name = "upper"
mesh = { file = "upper.msh" }
material = { young = 2e11, poisson = 0.3 }

[[body]]
name = "lower"
mesh = { geometry = "lower.step", size = 1 }
material = { young = 2e11, poisson = 0.3 }
"""


def scene(text: str, *settings: str, **kinds: tuple) -> Settled:
    return read_scene(
        "case.toml", text, settings, (lambda body: kinds[body.name]) if kinds else None
    )


@pytest.mark.parametrize("more, size", [("", 0.25), (", contact_size = 0.1", 0.1)])
def test_drawn_bodies_are_finer_along_contacts(more, size):
    """A quarter of the size where nothing else is given; bodies from files have none."""
    upper, lower = scene(
        FILES.replace("size = 1", f"size = 1{more}"), upper=(2, 1), lower=(2, 1)
    ).body
    assert lower.mesh.contact_size == size and upper.mesh.contact_size is None


def test_solid_scene_is_filled_in():
    """What a solid scene leaves out has three components, and it has neither plane strain nor plane stress."""
    solid = scene(SOLID, "body.upper.mesh={shape='box', size=[3, 1, 1], divisions=[6, 2, 2]}")
    assert solid.dimension == 3
    assert [body.volume_force for body in solid.body] == [(0.0,) * 3] * 2
    assert [rigid.displacement for rigid in solid.rigid] == [(0.0,) * 3] * 3
    assert [body.material.plane for body in solid.body] == [None] * 2
    assert [body.mesh.origin for body in solid.body] == [(0.0,) * 3, None]
    assert solid.body[0].clamps[0].components == (0.0, 0.0, 0.0)
    assert "dimension" not in solid.resolved() and scene(write_toml(solid.resolved())) == solid


def test_files_say_the_dimension_where_nothing_else_does():
    """Shapes come first, then places and vectors, then files; these are only asked where they must be."""
    assert scene(FILES, upper=(3, 1), lower=(3, 1)).dimension == 3
    # Older versions wrote it with any mesh.
    assert scene(FILES, "body.upper.mesh.origin=[0.0, 0.0]") == scene(FILES)
    assert scene(FILES, upper=(2, 1), lower=(2, 1)).dimension == scene(FILES).dimension == 2
    assert (
        scene(FILES, "body.upper.volume_force=[0, 0, -1]", "body.upper.mesh.order=1").dimension == 3
    )
    with pytest.raises(
        InputError,
        match=r"^case\.toml: body\.lower\.mesh\.geometry: lower\.step is in the plane, and "
        r"body\.upper\.mesh\.file = upper\.msh is in space",
    ):
        scene(FILES, upper=(3, 1), lower=(2, 1))


AROUND = f"axisymmetric = true\n{PLANE}"


def test_scene_around_an_axis_is_filled_in():
    """It is a plane scene in neither plane strain nor plane stress, and is read again as it is written."""
    turned = scene(AROUND, "output.mirrored=true")
    assert turned.axisymmetric and turned.dimension == 2 and turned.body[0].material.plane is None
    assert scene(write_toml(turned.resolved())) == turned
    assert not scene(PLANE).axisymmetric


BOTTOM, TOP = (
    "[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]",
    "[0, 0, 1], [1, 0, 1], [1, 1, 1], [0, 1, 1]",
)

REFUSED = [
    (
        SOLID,
        "body.lower.mesh={shape='rectangle', size=[1, 1], divisions=[1, 1]}",
        "body.lower.mesh.shape: rectangle is in the plane, and body.upper.mesh.shape = box is in space; a scene has "
        "plane shapes and lists [x, y], or solid ones and lists [x, y, z]",
    ),
    (SOLID, "body.upper.mesh.origin=[0, 0]", "body.upper.mesh.origin: [0.0, 0.0] is in the plane"),
    (
        SOLID,
        "body.lower.volume_force={constant=[0, 0, 1], x_slope=[0, 1]}",
        "body.lower.volume_force.x_slope: [0.0, 1.0] is in the plane",
    ),
    (PLANE, "rigid.floor.normal=[0, 1, 0]", "rigid.floor.normal: [0.0, 1.0, 0.0] is in space"),
    (
        PLANE,
        "body.upper.clamp=[{on='left', z=0.0}]",
        "body.upper.clamp.0.z: there is no z in the plane; this scene is in the plane, as body.upper.mesh.shape = "
        "rectangle",
    ),
    (
        PLANE,
        "body.upper.clamp=[{on='left', x={z_slope=1}}]",
        "body.upper.clamp.0.x.z_slope: there is no z",
    ),
    (
        PLANE,
        "contact.0.gap={along='z', points=[0], values=[1]}",
        "contact.upper-floor.gap.along: there is no z in the plane",
    ),
    (
        SOLID,
        "contact.0.gap={along='arc', points=[0], values=[1]}",
        "contact.upper-lower.gap.along: surfaces have no arc length; take a coordinate",
    ),
    (
        SOLID,
        "body.upper.material.plane=strain",
        "body.upper.material.plane: solids and axisymmetric bodies are neither in plane strain nor in plane stress; "
        "leave it out",
    ),
    (
        SOLID,
        "body.upper.material={young=[3e9, 2e9, 1e9], poisson=[0.3, 0.3, 0.3], shear=[1e9, 1e9, 1e9], angle=30}",
        "body.upper.material.angle: the axes 1, 2, 3 of solids are x, y, z; leave it out",
    ),
    (
        SOLID,
        "body.upper.material={young=[3e9, 2e9, 1e9], poisson=[0.3, 0.3, 0.3], shear=1e9}",
        "body.upper.material.shear: solids have shear = [G12, G13, G23]",
    ),
    (
        SOLID,
        "rigid.0={name='ball', shape='circle', center=[0, 0, 0], radius=1}",
        "rigid.ball.shape: a circle is a shape in the plane; in space there are plane, sphere, cylinder; this scene is "
        "in space, as body.upper.mesh.shape = box",
    ),
    (
        PLANE,
        "rigid.0={name='floor', shape='sphere', center=[0, 0, 0], radius=1}",
        "rigid.floor.shape: a sphere is a shape in space; in the plane there are plane, circle",
    ),
    (
        SOLID,
        "axisymmetric=true",
        "axisymmetric: axisymmetric bodies are drawn in the half-plane x >= 0; this scene is in space, as "
        "body.upper.mesh.shape = box",
    ),
    (
        AROUND,
        "body.upper.clamp=[{on='left', z=0.1}]",
        "body.upper.clamp.0.z: nothing is twisted around the axis; this scene is around an axis, as axisymmetric = true",
    ),
    (
        PLANE,
        "rigid.0={name='floor', shape='plane', point=[0, -1], normal=[0, 1], displacement=[0, 0], force=[0, 0, 1]}",
        "rigid.floor.force: [0.0, 0.0, 1.0] is in space",
    ),
    (PLANE, "output.mirrored=true", "output.mirrored: shows the other half of axisymmetric bodies"),
    (SOLID, "rigid.shaft.axis=[0, 0, 0]", "rigid.shaft: axis must not be zero"),
    (
        SOLID,
        "body.upper.mesh.size=[3, 1]",
        "body.upper.mesh.size: a box has size = [length, depth, height], got [3.0, 1.0]",
    ),
    (
        SOLID,
        f"body.lower.mesh.corners=[{TOP}, {BOTTOM}]",
        "body.lower.mesh: corners make a hexahedron that is turned inside out",
    ),
    (
        SOLID,
        f"body.lower.mesh.corners=[{BOTTOM}, [1, 1, 1], [0, 1, 1], [0, 0, 1], [1, 0, 1]]",
        "body.lower.mesh: corners must be those of a convex hexahedron",
    ),
]


@pytest.mark.parametrize(
    "text, setting, words", REFUSED, ids=[setting[:60] for _, setting, _ in REFUSED]
)
def test_what_belongs_to_the_other_dimension_is_refused(text, setting, words):
    """One message with the key says what does not belong into this scene."""
    assert message(setting, text=text).startswith(f"case.toml: {words}")


def test_expansions_along_three_axes_are_no_place_in_space():
    """An orthotropic material has three of them, in the plane as well."""
    material = (
        "material={young=[3, 2, 1], poisson=[0.3, 0.2, 0.1], shear=1, expansion=[1e-5, 2e-5, 3e-5]}"
    )
    warm = scene(PLANE, f"body.upper.{material}", "body.upper.temperature=10.0").body[0]
    assert np.diag(warm.material.expansions) == pytest.approx([1e-5, 2e-5, 3e-5])


def test_copies_around_an_axis_shift_along_it():
    """Along y alone, or not at all; nothing turns."""

    def shifted(**copy) -> dict:
        ring = rectangle("ring", (0.5, 0.0), (1.0, 1.0), (1, 1), clamp=["bottom"])
        other = {"name": "other", "copy": {"of": "ring"} | copy, "clamp": ["bottom"]}
        return {"axisymmetric": True, "body": [ring, other]}

    for shift in ([0.0, 2.0], [0.0, -2.0]):
        settled = read_scene("a scene", to_toml(shifted(shift=shift)))
        assert list(settled.body[1].copy.shift) == shift
    for wrong in ({"shift": [0.1, 2.0]}, {"turn": 90.0}):
        with pytest.raises(InputError, match="axisymmetric copies shift along y only"):
            read_scene("a scene", to_toml(shifted(**wrong)))
