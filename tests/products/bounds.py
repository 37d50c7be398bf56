"""Both sides of each bound: what is refused or warned of, in which words, and what just before it is not.

The first tables are of bounds that the reader knows: words of a message, the name of a scene, and two changes of it as
settings, of which a list has several. The last ones are of meshes and answers: functions make both scenes. Limits are
those of the pages and of mechanics, by hand.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from kinds import LOW, SIZE, Kind, Stuff
from promises import BELOW, LOAD

PLANE = """
[[body]]
name = "upper"
mesh = { shape = "rectangle", origin = [0.0, 1.0], size = [3.0, 1.0], divisions = [6, 2] }
material = { young = 2e11, poisson = 0.3 }
clamp = ["left", { on = "right", x = 1e-3 }]
traction = [{ on = "top", value = [0.0, -6.0e7] }]

[[body]]
name = "lower"
mesh = { file = "lower.msh" }
material = { young = 1e11, poisson = 0.25 }
clamp = [{ on = "bottom", x = 0.0, y = 0.0 }]

[[rigid]]
name = "tool"
shape = "circle"
center = [1.5, 3.0]
radius = 1.0

[[contact]]
bodies = ["upper", "lower"]
on = ["bottom", "top"]
friction = { law = "coulomb", coefficient = 0.3 }

[[contact]]
bodies = ["upper", "tool"]
on = ["top"]
"""

STEPS = (
    PLANE
    + """
[history.load]
times = [0.0, 1.0, 2.0]
factors = [0.0, 1.3, 0.4]

[time]
points = [1.0, 2.5]
steps = 2
"""
)

FAR = """
[[body]]
name = "block"
mesh = { shape = "rectangle", size = [3.0, 1.0], divisions = [6, 2] }
material = { young = 2e11, poisson = 0.3 }
clamp = ["left"]
motion = { shift = [0.0, -0.2] }

[[body]]
name = "table"
mesh = { shape = "rectangle", size = [3.0, 1.0], divisions = [6, 2] }
material = { young = 2e11, poisson = 0.3 }
clamp = ["bottom"]

[[rigid]]
name = "tool"
shape = "circle"
center = [1.5, 3.0]
radius = 1.0

[[contact]]
bodies = ["block", "table"]
on = ["bottom", "top"]

[time]
points = [1.0]
steps = 2
motions = "far"
"""

SPACE = """
[[body]]
name = "block"
mesh = { shape = "box", origin = [0.0, 0.0, 1.0], size = [3.0, 2.0, 1.0], divisions = [3, 2, 2] }
material = { young = 2e11, poisson = 0.3 }
clamp = ["left"]

[[rigid]]
name = "tool"
shape = "cylinder"
point = [0.0, 0.0, 5.0]
axis = [0.0, 1.0, 0.0]
radius = 3.0

[[contact]]
bodies = ["block", "tool"]
on = ["top"]
"""

AXIS = """
axisymmetric = true

[[body]]
name = "upper"
mesh = { shape = "rectangle", origin = [0.5, 1.0], size = [3.0, 1.0], divisions = [6, 2] }
material = { young = 2e11, poisson = 0.3 }
clamp = ["top"]

[[body]]
name = "lower"
mesh = { shape = "rectangle", origin = [0.5, 0.0], size = [3.0, 1.0], divisions = [6, 2] }
material = { young = 2e11, poisson = 0.3 }
clamp = ["bottom"]

[[rigid]]
name = "tool"
shape = "circle"
center = [1.5, 3.0]
radius = 1.0

[[contact]]
bodies = ["upper", "lower"]
on = ["bottom", "top"]
"""

PAIR = PLANE[: PLANE.index("[[rigid]]")] + "".join(PLANE.partition("[[contact]]")[1:])
PAIR = PAIR[: PAIR.rindex("[[contact]]")]

SCENES = {"plane": PLANE, "pair": PAIR, "steps": STEPS, "far": FAR, "space": SPACE, "axis": AXIS}


class Bound(NamedTuple):
    """A message, the scene in which it is asked, and settings just past its limit and just before it."""

    words: str
    scene: str
    past: str | list[str]
    before: str | list[str]


ABOVE_HALF, BELOW_HALF = "0.5000000001", "0.4999999999"


def of_a_number(key: str, words: str, past: object, before: object, scene: str = "plane") -> Bound:
    return Bound(f"{key}: {words}", scene, f"{key}={past}", f"{key}={before}")


def mesh(text: str) -> str:
    return f"body.upper.mesh={{{text}}}"


def ring(angles: str, around: int = 8, radii: str = "[1.0, 2.0]") -> str:
    return mesh(
        f'shape="annulus", center=[0, 0], radii={radii}, angles={angles}, divisions=[{around}, 2]'
    )


def corners(last: str) -> str:
    where = f"corners=[[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], {last}]"
    return mesh(f'shape="quadrilateral", {where}, divisions=[2, 2]')


def orthotropic(ratio: float, more: str = "") -> str:
    stiffness = f"young=[9.0, 4.0, 4.0], poisson=[{ratio}, 0.0, 0.0], shear=2.0"
    return f"body.upper.material={{{stiffness}{more}}}"


def bolt(text: str, history: str = "times=[0.0, 1.0], factors=[0.0, 1.0]") -> list[str]:
    """A bond that is pulled, with a history that it may have."""
    return [
        "contact.0.friction={law='none'}",
        "contact.0.kind=bonded",
        f"contact.0.pretension={{force=3.0, along=[0, 1], {text}}}",
        f"history.bolt={{{history}}}",
    ]


def cycle(text: str) -> str:
    return f"time.cycle={{{text}}}"


def tool(text: str) -> str:
    return f"rigid.0={{name='tool', shape='circle', center=[1.5, 3.0], radius=1.0, {text}}}"


def motion(text: str) -> str:
    return f"body.block.motion={{{text}}}"


PROFILE = "contact.upper-lower.friction.coefficient"

YOUNG, POISSON = "body.upper.material.young", "body.upper.material.poisson"

NUMBERS = [
    of_a_number(YOUNG, "expected a number > 0", "0.0", "1e-300"),
    of_a_number(YOUNG, "expected a number <= 1e", "1.001e100", "1e100"),
    of_a_number(POISSON, "expected a number < 0.5", "0.5", BELOW_HALF),
    of_a_number(POISSON, "expected a number > -1", "-1.0", "-0.9999999999"),
    of_a_number(
        "body.upper.traction.0.value.1", "expected a number >= -1e", "-1.001e100", "-1e100"
    ),
    of_a_number(PROFILE, "expected a number >= 0", "-1e-300", "0.0"),
    of_a_number("body.upper.mesh.size.0", "expected a number > 0", "0.0", "1e-300"),
    of_a_number("body.upper.mesh.divisions.1", "expected a whole number >= 1", 0, 1),
    of_a_number("body.upper.mesh.divisions.1", "expected a whole number <= 1", 10**12 + 1, 10**12),
    of_a_number("body.lower.mesh.refine", "expected a whole number >= 0", -1, 0),
    of_a_number("body.lower.mesh.refine", "expected a whole number <= 8", 9, 8),
    of_a_number("rigid.tool.radius", "expected a number > 0", "0.0", "1e-300"),
    of_a_number("method.tolerance", "expected a number > 0", "0.0", "1e-300"),
    of_a_number("method.tolerance", "expected a number < 1", "1.0", "0.9999999999"),
    of_a_number("method.target_error", "expected a number <= 0.3", "0.3000000001", "0.3"),
    of_a_number("method.target_error", "expected a number >= 1e-09", "9.9e-10", "1e-9"),
    of_a_number("method.max_iterations", "expected a whole number >= 1", 0, 1),
    of_a_number("method.max_unknowns", "expected a whole number >= 1", 0, 1),
    of_a_number("method.inner_precision", "expected a number > 0", "0.0", "1e-300"),
    of_a_number("method.inner_precision", "expected a number <= 1", "1.0000000001", "1.0"),
    of_a_number("output.magnification", "expected a number > 0", "0.0", "1e-300"),
    of_a_number("output.magnification", "expected a number <= 1", "1.000001e12", "1e12"),
    of_a_number("checkpoint.iterations", "expected a whole number >= 0", -1, 0),
    of_a_number("checkpoint.seconds", "expected a number >= 0", "-1e-300", "0.0"),
    of_a_number("time.steps", "expected a whole number >= 1", 0, 1, "steps"),
    of_a_number("time.steps", "expected a whole number <= 1", 10**6 + 1, 10**6, "steps"),
    of_a_number("time.points.0", "", "0.0", "1e-300", "steps")._replace(
        words="they must be positive, got 0"
    ),
    of_a_number("output.view.1", "expected a number <= 90", "90.0000001", "90.0", "space")._replace(
        past="output.view=[30.0, 90.0000001]", before="output.view=[30.0, 90.0]"
    ),
    of_a_number("output.view.1", "expected a number >= -90", "", "", "space")._replace(
        past="output.view=[30.0, -90.0000001]", before="output.view=[30.0, -90.0]"
    ),
]
"""Limits of single numbers, whose words are those of types."""

SHAPES = [
    Bound(
        "radii = [inner, outer] must ascend",
        "plane",
        ring("[0, 90]", radii="[2.0, 2.0]"),
        ring("[0, 90]", radii="[1.9999999, 2.0]"),
    ),
    Bound(
        "only a cylinder may have no bore",
        "plane",
        ring("[0, 90]", radii="[0.0, 2.0]"),
        ring("[0, 90]", radii="[1e-300, 2.0]"),
    ),
    Bound(
        "must ascend by at most 360 degrees, which make a whole ring; got [0, 361]",
        "plane",
        ring("[0, 361]"),
        ring("[0, 360]"),
    ),
    Bound(
        "must ascend by at most 360 degrees, which make a whole ring; got [90, 90]",
        "plane",
        ring("[90, 90]"),
        ring("[90, 90.001]"),
    ),
    Bound("expected a number <= 720", "plane", ring("[500, 720.001]"), ring("[500, 720]")),
    Bound(
        "2 around make cells of 180 degrees; they must be less than 180",
        "plane",
        ring("[0, 360]", 2),
        ring("[0, 360]", 3),
    ),
    Bound(
        "corners must be those of a convex quadrilateral",
        "plane",
        corners("[1.0, 1.0]"),
        corners("[0.99, 1.01]"),
    ),
    Bound(
        "corners run clockwise; write them counter-clockwise",
        "plane",
        mesh('shape="quadrilateral", corners=[[0,0],[0,2],[2,2],[2,0]], divisions=[2,2]'),
        corners("[0.0, 2.0]"),
    ),
    Bound(
        "a rectangle has size = [width, height]",
        "plane",
        "body.upper.mesh.size=[1.0, 1.0, 1.0]",
        "body.upper.mesh.size=[1.0, 1.0]",
    ),
    Bound(
        "mesh.around: expected a whole number >= 9",
        "plane",
        mesh('geometry="a.geo", size=0.5, around=8'),
        mesh('geometry="a.geo", size=0.5, around=9'),
    ),
    Bound(
        "around belongs to a geometry, not to a file",
        "plane",
        mesh('file="a.msh", around=12'),
        mesh('geometry="a.geo", size=0.5, around=12'),
    ),
    Bound(
        "contact_size = 0.500001, along contacts, must not exceed size = 0.5",
        "plane",
        mesh('geometry="a.geo", size=0.5, contact_size=0.500001'),
        mesh('geometry="a.geo", size=0.5, contact_size=0.5'),
    ),
    Bound(
        "size_on.hole = 0.500001, along 'hole', must not exceed size = 0.5",
        "plane",
        mesh('geometry="a.geo", size=0.5, size_on={hole=0.500001}'),
        mesh('geometry="a.geo", size=0.5, size_on={hole=0.5}'),
    ),
    Bound(
        "elements belongs to a shape with divisions, not to a geometry",
        "plane",
        mesh('geometry="a.geo", size=0.5, elements="bricks"'),
        "body.upper.mesh.elements=bricks",
    ),
    Bound(
        "cut belongs to a file, not to shape =",
        "plane",
        "body.upper.mesh.cut=true",
        "body.upper.mesh.cut=false",
    ),
    Bound(
        "integration belongs to a file that is not cut, or to a shape with elements",
        "plane",
        "body.upper.mesh.integration=full",
        ["body.upper.mesh.elements=bricks", "body.upper.mesh.integration=full"],
    ),
    Bound(
        "refine belongs to a file; for a shape, raise divisions",
        "plane",
        "body.upper.mesh.refine=1",
        "body.upper.mesh.refine=0",
    ),
    Bound(
        "axis must not be zero; it goes from the bottom of a cylinder to its top",
        "space",
        "body.block.mesh={shape='cylinder', size=1.0, height=1.0, center=[0, 0, 0], axis=[0, 0, 0], radii=[0.0, 2.0]}",
        "body.block.mesh={shape='cylinder', size=1.0, height=1.0, center=[0, 0, 0], axis=[0, 0, 1e-9], radii=[0.0, 2.0]}",
    ),
    Bound(
        "a drawing; write geometry",
        "plane",
        mesh('file="a.geo", size=1.0'),
        mesh('geometry="a.geo", size=1.0'),
    ),
    Bound(
        "geometry = 'a.msh' must end with one of",
        "plane",
        mesh('geometry="a.msh", size=1.0'),
        mesh('geometry="a.brep", size=1.0'),
    ),
]

MATERIALS = [
    # ν12 < √(E1/E2) = 1.5: beyond it the compliance is not positive definite
    Bound("is not positive definite", "plane", orthotropic(1.5001), orthotropic(1.4999)),
    Bound("is not positive definite", "plane", orthotropic(-1.5001), orthotropic(-1.4999)),
    Bound(
        "both are parallel or zero; the second lies beside axis 1",
        "space",
        "body.block.material={young=[9.0,4.0,4.0], poisson=[0.1,0.0,0.0], shear=[2.0,2.0,2.0], "
        "axes=[[1,2,0],[2,4,0]]}",
        "body.block.material={young=[9.0,4.0,4.0], poisson=[0.1,0.0,0.0], shear=[2.0,2.0,2.0], "
        "axes=[[1,2,0],[2,4,0.001]]}",
    ),
    Bound(
        "axes: an isotropic material has no axes; leave it out",
        "space",
        "body.block.material.axes=[[1,0,0],[0,1,0]]",
        "body.block.material={young=[9.0,4.0,4.0], poisson=[0.1,0.0,0.0], shear=[2.0,2.0,2.0], "
        "axes=[[1,0,0],[0,1,0]]}",
    ),
    Bound(
        "expansion: an isotropic material has no axes; write expansion",
        "plane",
        ["body.upper.material.expansion=[1e-5,1e-5,1e-5]", "body.upper.temperature=3.0"],
        ["body.upper.material.expansion=1e-5", "body.upper.temperature=3.0"],
    ),
    Bound(
        "such parts are in plane stress",
        "plane",
        ["contact=[]", "body.upper.material.thickness=1.0000001"],
        ["contact=[]", "body.upper.material.thickness=1.0"],
    ),
    Bound(
        "bodies with contacts or foundations have the depth alone",
        "plane",
        [
            "contact=[]",
            "body.upper.material={young=1.0, poisson=0.3, plane='stress', thickness=2.0}",
            "body.upper.foundation=[{on='top', normal=1.0}]",
        ],
        [
            "contact=[]",
            "body.upper.material={young=1.0, poisson=0.3, plane='stress', thickness=2.0}",
        ],
    ),
    Bound(
        "no body has a temperature, so nothing expands",
        "plane",
        "body.upper.material.expansion=1e-300",
        "body.upper.material.expansion=0.0",
    ),
    Bound(
        "has no effect, because the material has no expansion",
        "plane",
        "body.upper.temperature=3.0",
        ["body.upper.temperature=3.0", "body.upper.material.expansion=0.0"],
    ),
    Bound(
        "linear elements lock at nu",
        "plane",
        ["body.upper.mesh.order=1", "method.target_error=0.1", f"{POISSON}=0.499"],
        ["body.upper.mesh.order=2", "method.target_error=0.1", f"{POISSON}=0.499"],
    ),
]

CONTACTS = [
    Bound(
        "points must ascend (a repeated point is a jump)",
        "plane",
        PROFILE + "={points=[0.0, 1.0, 0.9999999], values=[1, 1, 1]}",
        PROFILE + "={points=[0.0, 1.0, 1.0], values=[1, 1, 2]}",
    ),
    Bound(
        "points and values must be equally many, at least one",
        "plane",
        PROFILE + "={points=[0, 1], values=[1, 1, 1]}",
        PROFILE + "={points=[0], values=[1]}",
    ),
    Bound(
        "expected a number >= 0",
        "plane",
        PROFILE + "={points=[0], values=[-1e-300]}",
        "contact.upper-lower.gap={points=[0], values=[-1e-300]}",
    ),
    Bound(
        "what has a history has a value: write { value = …, history",
        "steps",
        'contact.0.gap={points=[0], values=[1], history="load"}',
        'contact.0.gap={value={points=[0], values=[1]}, history="load"}',
    ),
    Bound(
        "value does not go with points and values",
        "plane",
        "contact.0.gap={value=1.0, points=[0], values=[1]}",
        "contact.0.gap={value=1.0}",
    ),
    Bound(
        "along must not be zero; it is the direction in which the bond is pulled",
        "plane",
        [
            "contact.0.friction={law='none'}",
            "contact.0.kind=bonded",
            "contact.0.pretension={force=3.0, along=[0.0, 0.0]}",
        ],
        [
            "contact.0.friction={law='none'}",
            "contact.0.kind=bonded",
            "contact.0.pretension={force=3.0, along=[0.0, 1e-300]}",
        ],
    ),
    Bound(
        'pretension goes with kind = "bonded"',
        "plane",
        "contact.0.pretension={force=3.0, along=[0, 1]}",
        [
            "contact.0.friction={law='none'}",
            "contact.0.kind=bonded",
            "contact.0.pretension={force=3.0, along=[0, 1]}",
        ],
    ),
    Bound(
        'friction does not go with kind = "bonded"',
        "plane",
        "contact.0.kind=bonded",
        ["contact.0.kind=bonded", "contact.0.friction={law='none'}"],
    ),
    Bound(
        'slave does not go with pairing = "nodes"',
        "plane",
        ["contact.0.slave=upper", "contact.0.pairing=nodes"],
        ["contact.0.slave=upper", "contact.0.pairing=mortar"],
    ),
    Bound(
        "'tool' is not a body of this contact",
        "plane",
        "contact.0.slave=tool",
        "contact.0.slave=upper",
    ),
    Bound(
        "slave: 'tool' is rigid and has no nodes",
        "plane",
        "contact.1.slave=upper",
        "contact.0.slave=upper",
    ),
    Bound(
        "pairing: 'tool' is rigid and has no nodes",
        "plane",
        "contact.1.pairing=nodes",
        "contact.0.pairing=nodes",
    ),
    Bound(
        "an axisymmetric bond is pulled along y only",
        "axis",
        ["contact.0.kind=bonded", "contact.0.pretension={force=3.0, along=[1e-9, 1]}"],
        ["contact.0.kind=bonded", "contact.0.pretension={force=3.0, along=[0, -1]}"],
    ),
    Bound(
        "at time 0, before the first load step, so that the force would never act",
        "steps",
        bolt("history='bolt'", "times=[-1.0, 0.0], factors=[0.0, 1.0]"),
        bolt("history='bolt'", "times=[-1.0, 1e-9], factors=[0.0, 1.0]"),
    ),
    Bound(
        "ends within the cycle from 1 to 2.5",
        "steps",
        [
            *bolt("history='bolt'", "times=[0.0, 1.2, 2.5], factors=[0.0, 1.0, 1.0]"),
            cycle("from=1.0, to=2.5, repeat=2"),
            "history.load.factors=[0.0, 1.3, 1.3]",
            "history.bolt.factors=[1.0, 1.0, 1.0]",
        ],
        [
            *bolt("history='bolt'", "times=[0.0, 0.5, 1.0], factors=[0.0, 1.0, 1.0]"),
            cycle("from=1.0, to=2.5, repeat=2"),
            "history.load.factors=[0.0, 1.3, 1.3]",
        ],
    ),
    Bound(
        "ends within the cycle from 1 to 2.5",
        "steps",
        [
            *bolt("history='bolt'", "times=[0.0, 2.5], factors=[1.0, 1.0]"),
            cycle("from=1.0, to=2.5, repeat=2"),
            "history.load.factors=[0.0, 1.3, 1.3]",
        ],
        [
            *bolt("history='bolt'", "times=[0.0, 2.5], factors=[1.0, 1.0]"),
            cycle("from=1.0, to=2.5, repeat=1"),
            "history.load.factors=[0.0, 1.3, 1.3]",
        ],
    ),
    Bound(
        "too long for the name of a file",
        "plane",
        f"contact.0.name={'€' * 80}",
        f"contact.0.name={'€' * 79}",
    ),
]

PARTNERS = [
    Bound(
        "force must not be zero; leave it out",
        "plane",
        tool("force=[0.0, 0.0]"),
        tool("force=[0.0, 1e-300]"),
    ),
    Bound(
        "moment must not be zero; leave it out",
        "plane",
        tool("moment=0.0, pivot=[1.5, 3.0]"),
        tool("moment=1e-300, pivot=[1.5, 3.0]"),
    ),
    Bound("moment needs pivot", "plane", tool("moment=1.0"), tool("moment=1.0, pivot=[0.0, 0.0]")),
    Bound(
        "pivot goes with a moment, or with turns = true",
        "plane",
        tool("force=[0, 1.0], pivot=[0, 0]"),
        tool("force=[0, 1.0], turns=true, pivot=[0, 0]"),
    ),
    Bound(
        "along y it has both a force and a displacement; it is pushed or moved",
        "plane",
        tool("force=[0.0, 1.0], displacement=[0.0, 1e-9]"),
        tool("force=[0.0, 1.0], displacement=[1e-9, 0.0]"),
    ),
    Bound(
        "along x it has both freedom to move and a displacement",
        "plane",
        tool("free=['x'], displacement=[1e-9, 0.0]"),
        tool("free=['x'], displacement=[0, 1.0]"),
    ),
    Bound("there is no z in the plane", "plane", tool("free=['z']"), tool("free=['y']")),
    Bound(
        "axis must not be zero",
        "space",
        "rigid.tool.axis=[0.0, 0.0, 0.0]",
        "rigid.tool.axis=[0.0, 1e-9, 0.0]",
    ),
    Bound(
        "an axisymmetric partner is pushed along y only",
        "axis",
        tool("force=[1e-9, 1.0]"),
        tool("force=[0.0, 1.0]"),
    ),
    Bound(
        "a cylinder is a shape in space",
        "plane",
        "rigid.0={name='tool', shape='cylinder', point=[0, 0, 0], axis=[0, 0, 1], radius=1.0}",
        "rigid.0={name='tool', shape='plane', point=[0.0, 3.0], normal=[0.0, -1.0]}",
    ),
]

TIMES = [
    Bound(
        "times must ascend strictly",
        "steps",
        "history.load.times=[0.0, 1.0, 1.0]",
        "history.load.times=[0.0, 1.0, 1.0000001]",
    ),
    Bound(
        "times and factors must be equally many, at least one",
        "steps",
        "history.load.factors=[0.0, 1.0]",
        "history.load.factors=[0.0, 1.0, 1.0]",
    ),
    Bound(
        "points must ascend strictly",
        "steps",
        "time.points=[1.0, 1.0]",
        "time.points=[1.0, 1.0000001]",
    ),
    Bound(
        "steps and tolerance do not go together",
        "steps",
        "time.tolerance=0.1",
        ["time={points=[1.0, 2.5], tolerance=0.1}"],
    ),
    Bound(
        "from: 1 must be before to = 1",
        "steps",
        cycle("from=1.0, to=1.0, repeat=1"),
        [cycle("from=0.9999999, to=1.0, repeat=1"), "history.load.factors=[1.0, 1.0, 1.0]"],
    ),
    Bound(
        "to = 2.501 is after the last of the points, 2.5",
        "steps",
        [cycle("from=2.0, to=2.501, repeat=1")],
        [cycle("from=2.0, to=2.5, repeat=1")],
    ),
    # 1e-9 of the largest factor, 1.3, is rounding
    Bound(
        "a cycle ends with the loads with which it begins",
        "steps",
        [cycle("from=1.0, to=2.0, repeat=1"), "history.load.factors=[0.0, 1.3, 1.29999]"],
        [cycle("from=1.0, to=2.0, repeat=1"), "history.load.factors=[0.0, 1.3, 1.3]"],
    ),
    Bound(
        "expected a whole number <= 1",
        "steps",
        cycle(f"from=2.0, to=2.5, repeat={10**6 + 1}"),
        cycle(f"from=2.0, to=2.5, repeat={10**6}"),
    ),
    Bound(
        "a history needs [time]",
        "plane",
        "history.load={times=[0.0], factors=[1.0]}",
        ["history.load={times=[0.0], factors=[1.0]}", "time={points=[1.0]}"],
    ),
    Bound(
        "there is no [history.lod]; did you mean 'load'?",
        "steps",
        "body.upper.traction.0.history=lod",
        "body.upper.traction.0.history=load",
    ),
    Bound(
        "plays load steps, and without [time] there is only one",
        "plane",
        "output.animation=true",
        ["output.animation=true", "time={points=[1.0]}"],
    ),
    Bound(
        "method.target_error is for one load step",
        "steps",
        "method.target_error=0.1",
        "method.tolerance=0.1",
    ),
    Bound(
        "method.target is for one load step",
        "steps",
        "method.target={'bodies.upper.reaction.x' = 0.1}",
        "output.errors=['bodies.upper.reaction.x']",
    ),
]

MOTIONS = [
    Bound(
        "a motion has a shift (m)", "far", motion("pivot=[0, 0]"), motion("turn=0.0, pivot=[0, 0]")
    ),
    Bound(
        "pivot is that of a turn; leave it out",
        "far",
        motion("shift=[0, 1], pivot=[0, 0]"),
        motion("shift=[0, 1], turn=1.0, pivot=[0, 0]"),
    ),
    Bound(
        "free names a component twice", "far", motion("free=['x', 'x']"), motion("free=['x', 'y']")
    ),
    Bound(
        "moment: needs a free turn",
        "far",
        motion("free=['x'], moment=1e-300"),
        motion("free=['x', 'turn'], moment=1e-300"),
    ),
    Bound(
        "force: acts along y, which is not free",
        "far",
        motion("free=['x'], force=[1.0, 1e-300]"),
        motion("free=['x'], force=[1.0, 0.0]"),
    ),
    Bound(
        "has 2 free parts; write one",
        "far",
        "body.block.motion=[{free=['x']}, {free=['turn']}]",
        "body.block.motion=[{free=['x', 'turn']}, {shift=[0.0, 1.0]}]",
    ),
    Bound(
        "prescribes y in one part and frees it in another",
        "far",
        "body.block.motion=[{free=['y']}, {shift=[0.0, 1e-9]}]",
        "body.block.motion=[{free=['y']}, {shift=[1e-9, 0.0]}]",
    ),
    Bound(
        "has both a motion and a displacement",
        "far",
        tool("motion={shift=[0, 1]}, displacement=[0, 1.0]"),
        tool("motion={shift=[0, 1]}"),
    ),
    Bound(
        "a partner moves as its motion says, not by a displacement, forces or moments",
        "far",
        tool("displacement=[0.0, 1e-9]"),
        tool("displacement=[0.0, 0.0]"),
    ),
    Bound(
        "no body and no rigid partner has a motion, and clamps hold all bodies",
        "far",
        [
            "body.0={name='block', clamp=['left'], material={young=1.0, poisson=0.3}, "
            "mesh={shape='rectangle', size=[3.0, 1.0], divisions=[6, 2]}}"
        ],
        [
            "body.0={name='block', material={young=1.0, poisson=0.3}, "
            "mesh={shape='rectangle', size=[3.0, 1.0], divisions=[6, 2]}}"
        ],
    ),
    Bound(
        "cycle: does not go with motions",
        "far",
        cycle("from=0.0, to=1.0, repeat=2"),
        "time.points=[1.0, 2.0]",
    ),
    Bound(
        'friction: does not go with time.motions = "far": profiles along a contact',
        "far",
        "contact.0.friction={law='coulomb', coefficient='0.3 + 0*x'}",
        "contact.0.friction={law='coulomb', coefficient=0.3}",
    ),
    Bound(
        'does not go with time.motions = "far", for which the compliance',
        "far",
        "method.compliance=direct",
        "method.compliance=explicit",
    ),
    Bound(
        "only unilateral contacts slide far",
        "far",
        "contact.0.kind=bonded",
        "contact.0.kind=unilateral",
    ),
    Bound(
        "gaps are measured where the bodies are",
        "far",
        "contact.0.gap=0.0",
        "contact.0.kind=unilateral",
    ),
    Bound(
        "nodes do not stay opposite each other",
        "far",
        "contact.0.pairing=nodes",
        "contact.0.pairing=mortar",
    ),
    Bound(
        "profiles along a contact, formulas and histories are not possible yet",
        "far",
        "contact.0.friction={law='coulomb', coefficient={points=[0], values=[0.3]}}",
        "contact.0.friction={law='coulomb', coefficient=0.3}",
    ),
    Bound(
        'bodies move far with motions = "far" in [time] only',
        "steps",
        "body.upper.motion={shift=[0.0, 1.0]}",
        [
            "time={points=[1.0, 2.0], motions='far'}",
            "contact.0.bodies=['upper', 'lower']",
            "body.upper.motion={shift=[0.0, 1.0]}",
        ],
    ),
    Bound(
        "axisymmetric bodies shift along y only",
        "axis",
        ["time={points=[1.0], motions='far'}", "body.upper.motion={shift=[1e-9, 1.0]}"],
        ["time={points=[1.0], motions='far'}", "body.upper.motion={shift=[0.0, 1.0]}"],
    ),
]


def copy(text: str) -> str:
    return f"body.lower={{name='lower', {text}}}"


BESIDE = copy("copy={of='upper', shift=[0, -1]}")

OWN = ["contact.0.bodies=['upper', 'upper']", "contact.upper-upper.on=['bottom', 'top']"]

ITSELF = [
    Bound(
        "contact.upper-upper.on: both sides are 'top' of 'upper'; a contact of a body with itself has two sides that "
        "face each other",
        "pair",
        [OWN[0], "contact.upper-upper.on=['top', 'top']"],
        OWN,
    ),
    Bound(
        "contact.upper-upper.slave: 'upper' is not a side of this contact (sides: first, second)",
        "pair",
        [*OWN, "contact.upper-upper.slave=upper"],
        [*OWN, "contact.upper-upper.slave=second"],
    ),
    Bound(
        "method.theta",
        "pair",
        [*OWN, "method.theta=0.2"],
        "method.theta=0.2",
    ),
]
"""Limits of contacts of a body with itself."""

SECTOR = [
    "body.upper.mesh={shape='annulus', center=[0, 0], radii=[1, 2], angles=[0, 60], divisions=[4, 2]}",
    "body.upper.clamp=[]",
    "body.upper.traction=[]",
    "contact.0={bodies=['upper', 'upper'], on=['end', 'start'], kind='bonded', image={turn=60.0}}",
]


def seen_at(image: str) -> list[str]:
    return [*SECTOR, f"contact.0.image={image}"]


IMAGES = [
    Bound(
        "turn = 50 does not close: 360/50 = 7.2 is no number of sectors from 2 on; 7 of them turn by 51.4285714286",
        "pair",
        seen_at("{turn=50.0}"),
        seen_at("{turn=51.428571428571}"),
    ),
    Bound("turn = 0 does not close", "pair", seen_at("{turn=0.0}"), seen_at("{turn=-60.0}")),
    Bound(
        "an image is turned or shifted; leave turn or shift out",
        "pair",
        seen_at("{turn=60.0, shift=[1.0, 0.0]}"),
        seen_at("{shift=[1.0, 0.0]}"),
    ),
    Bound(
        "an image is elsewhere; shift must not be zero",
        "pair",
        seen_at("{shift=[0.0, 0.0]}"),
        seen_at("{shift=[0.0, 1e-9]}"),
    ),
    Bound(
        'friction does not go with kind = "bonded"; leave one of them out',
        "pair",
        [*SECTOR, "contact.0.friction={law='coulomb', coefficient=0.1}"],
        [*SECTOR, "contact.0.friction={law='none'}"],
    ),
    Bound(
        "contact.upper-tool.image: 'tool' is rigid, and has none; move the partner to where it is touched",
        "plane",
        "contact.1.image={turn=60.0}",
        "contact.0.image={turn=60.0}",
    ),
    Bound(
        "image: is turned about another axis or by another angle than that of contact.upper-lower",
        "plane",
        [
            "contact.0.image={turn=60.0}",
            "contact.1={bodies=['lower', 'upper'], name='b', on=['left', 'right'], image={turn=90.0}}",
        ],
        [
            "contact.0.image={turn=60.0}",
            "contact.1={bodies=['lower', 'upper'], name='b', on=['left', 'right'], image={turn=-60.0}}",
        ],
    ),
    Bound(
        "image: a bond with a pretension has no image; leave one of them out",
        "pair",
        [*bolt("history='bolt'"), "contact.0.image={turn=60.0}", "time={points=[1.0]}"],
        [*bolt("history='bolt'"), "time={points=[1.0]}"],
    ),
    Bound(
        "image: axisymmetric bodies have images along y only, as in shift = [0.0, 10.0]",
        "axis",
        "contact.0.image={shift=[1e-9, 1.0]}",
        "contact.0.image={shift=[0.0, 1.0]}",
    ),
    Bound(
        'image: does not go with time.motions = "far"; leave one of them out',
        "axis",
        [
            "time={points=[1.0], motions='far'}",
            "body.upper.motion={shift=[0.0, 1.0]}",
            "contact.0.image={shift=[0.0, 1.0]}",
        ],
        ["time={points=[1.0], motions='far'}", "body.upper.motion={shift=[0.0, 1.0]}"],
    ),
    Bound(
        "output.sectors: no contact has a turned image, so that there is one sector only; leave it out",
        "pair",
        "output.sectors=true",
        [*SECTOR, "output.sectors=true"],
    ),
    Bound(
        "output.sectors: does not go with output.cut; leave one of them out",
        "space",
        [
            "contact.0={bodies=['block', 'block'], on=['left', 'front'], image={turn=90.0, axis=[0, 0, 1]}}",
            "output.sectors=true",
            "output.cut={x=0.5}",
        ],
        [
            "contact.0={bodies=['block', 'block'], on=['left', 'front'], image={turn=90.0, axis=[0, 0, 1]}}",
            "output.sectors=true",
        ],
    ),
]
"""Limits of images."""

COPIES = [
    Bound(
        "body.lower.copy: a copy has the mesh of 'upper'; leave mesh out, or copy",
        "plane",
        "body.lower.copy={of='upper', shift=[0, -1]}",
        BESIDE,
    ),
    Bound(
        "body.lower.copy.of: there is no [[body]] 'uper'; did you mean 'upper'? (bodies: upper, lower)",
        "plane",
        copy("copy={of='uper', shift=[0, -1]}"),
        BESIDE,
    ),
    Bound(
        "body.lower.copy.of: 'lower' is a copy itself; one of lower has a mesh and a material of its own",
        "plane",
        copy("copy={of='lower', shift=[0, -1]}"),
        BESIDE,
    ),
    Bound(
        "body.upper.copy.of: 'lower' is a copy itself; one of lower, upper has a mesh and a material of its own",
        "plane",
        [BESIDE, "body.upper={name='upper', copy={of='lower', shift=[0, 1]}}"],
        BESIDE,
    ),
    Bound(
        "it leads somewhere by a shift (m)",
        "plane",
        copy("copy={of='upper'}"),
        copy("copy={of='upper', shift=[0, 0]}"),
    ),
    Bound(
        "body.lower.copy: axisymmetric copies shift along y only",
        "axis",
        copy("copy={of='upper', shift=[1e-9, -1]}, clamp=['bottom']"),
        copy("copy={of='upper', shift=[0, -1]}, clamp=['bottom']"),
    ),
    Bound(
        "body.lower.copy: method.target_error makes the mesh of a drawing, a ball or a cylinder finer",
        "pair",
        [mesh('geometry="a.geo", size=0.5'), BESIDE, "method.target_error=0.1"],
        [BESIDE, "method.target_error=0.1"],
    ),
    Bound(
        "body.lower.copy: method.target makes",
        "pair",
        [mesh('geometry="a.geo", size=0.5'), BESIDE, "method.target={'bodies.upper.energy' = 0.1}"],
        [BESIDE, "method.target={'bodies.upper.energy' = 0.1}"],
    ),
]
"""Limits of copies of bodies."""

WEAR = "contact.0.friction.coefficient={value=0.3, history='wear'}"

ASKED = [
    Bound(
        "value does not go with constant and slopes",
        "plane",
        "body.upper.volume_force={value=[0, 1], constant=[0, 1]}",
        "body.upper.volume_force={constant=[0, 1]}",
    ),
    Bound(
        "a moment is [Mx, My, Mz]",
        "space",
        "body.block.traction=[{on='top', moment=3.0}]",
        "body.block.traction=[{on='top', moment=[0, 0, 3.0]}]",
    ),
    Bound(
        "there is no z in the plane",
        "plane",
        "body.upper.clamp.1={on='right', z=1.0}",
        "body.upper.clamp.1={on='right', y=1.0}",
    ),
    Bound(
        "body.upper.clamp.1.along: the direction must not be zero",
        "plane",
        "body.upper.clamp.1={on='right', along=[0.0, 0.0], value=0.0}",
        "body.upper.clamp.1={on='right', along=[1e-9, 0.0], value=0.0}",
    ),
    Bound(
        "body.upper.clamp.1: a direction and a value go together",
        "plane",
        "body.upper.clamp.1={on='right', along=[0.6, 0.8]}",
        "body.upper.clamp.1={on='right', along=[0.6, 0.8], value=1e-3}",
    ),
    Bound(
        "body.upper.clamp.1.along: [0.6, 0.8, 0.0] is in space",
        "plane",
        "body.upper.clamp.1={on='right', along=[0.6, 0.8, 0.0], value=0.0}",
        "body.upper.clamp.1={on='right', along=[0.6, 0.8], value='1e-3 * y'}",
    ),
    Bound(
        "contact.upper-lower.softness: expected a number >= 0.0",
        "pair",
        "contact.0.softness=-1e-30",
        "contact.0.softness=0.0",
    ),
    Bound(
        "softness: pressure and closure are equally many numbers",
        "pair",
        "contact.0.softness={pressure=[0.0, 1.0], closure=[1e-30, 1.0]}",
        "contact.0.softness={pressure=[0.0, 1.0], closure=[0.0, 1.0]}",
    ),
    Bound(
        "softness: pressure and closure must ascend",
        "pair",
        "contact.0.softness={pressure=[0.0, 1.0, 2.0], closure=[0.0, 1.0, 0.9999999]}",
        "contact.0.softness={pressure=[0.0, 1.0, 2.0], closure=[0.0, 1.0, 1.0]}",
    ),
    Bound(
        "softness: beyond a pressure of 1 the joint gets softer",
        "pair",
        "contact.0.softness={pressure=[0.0, 1.0, 2.0], closure=[0.0, 1.0, 2.0000001]}",
        "contact.0.softness={pressure=[0.0, 1.0, 2.0], closure=[0.0, 1.0, 2.0]}",
    ),
    Bound(
        'softness does not go with kind = "guided"',
        "pair",
        ["contact.0.kind=guided", "contact.0.friction={law='none'}", "contact.0.softness=1e-30"],
        ["contact.0.kind=guided", "contact.0.friction={law='none'}", "contact.0.softness=0.0"],
    ),
    Bound(
        'contact.upper-lower.softness: a soft joint needs outer = "newton"',
        "pair",
        ["method.outer=relaxation", "contact.0.softness=1e-30"],
        ["method.outer=relaxation", "contact.0.softness=0.0"],
    ),
    Bound(
        "contact.upper-lower.friction: [history.wear] has a negative factor",
        "steps",
        [
            "history.wear={times=[0.0, 2.0], factors=[1.0, -1e-30]}",
            "contact.0.friction.coefficient={value=0.3, history='wear'}",
        ],
        [
            "history.wear={times=[0.0, 2.0], factors=[1.0, 0.0]}",
            "contact.0.friction.coefficient={value=0.3, history='wear'}",
        ],
    ),
    Bound(
        "output.derivatives: friction that follows a history, as that of 'upper-lower', has none yet",
        "steps",
        [
            "contact.0.friction.coefficient={value=0.3, history='load'}",
            "output.derivatives=['contact.upper-lower.gap']",
            "contact.0.gap=0.0",
        ],
        ["contact.0.friction.coefficient={value=0.3, history='load'}", "contact.0.gap=0.0"],
    ),
    Bound(
        'contact.upper-lower.friction.coefficient: the formula "0.3 * w" cannot be evaluated',
        "pair",
        "contact.0.friction.coefficient=0.3 * w",
        "contact.0.friction.coefficient=0.3 * x",
    ),
    Bound(
        "there is no z in the plane",
        "pair",
        "contact.0.friction.coefficient=0.3 * z",
        "contact.0.friction.coefficient=0.3 * y",
    ),
    Bound(
        "a foundation has a stiffness per area",
        "plane",
        "body.upper.foundation=[{on='right', normal=0.0}]",
        "body.upper.foundation=[{on='right', normal=1e-300}]",
    ),
    Bound(
        "a chain of comparisons; write (0 < x) * (x < 1)",
        "plane",
        "body.upper.clamp.1.x=0 < x < 1",
        "body.upper.clamp.1.x=(0 < x) * (x < 1)",
    ),
    Bound(
        "it must be made of numbers",
        "plane",
        "body.upper.clamp.1.x=[x]",
        "body.upper.clamp.1.x=(x)",
    ),
    Bound(
        "formulas do not have this operator (FloorDiv)",
        "plane",
        "body.upper.clamp.1.x=x // 3",
        "body.upper.clamp.1.x=x / 3",
    ),
    Bound(
        "it is nested too deeply",
        "plane",
        f"body.upper.clamp.1.x={'+'.join('x' * 201)}",
        f"body.upper.clamp.1.x={'+'.join('x' * 200)}",
    ),
    Bound(
        "length <= 1000",
        "plane",
        f"body.upper.clamp.1.x=x+0.{'1' * 997}",
        f"body.upper.clamp.1.x=x+0.{'1' * 996}",
    ),
    Bound(
        'error = true asks for what only = "contacts" leaves out',
        "plane",
        ["output.only=contacts", "output.error=true"],
        "output.only=contacts",
    ),
    Bound(
        "output.errors: 'bodies.upper.reaction.x' is not valid; expected a list or main",
        "plane",
        "output.errors=bodies.upper.reaction.x",
        "output.errors=['bodies.upper.reaction.x']",
    ),
    Bound(
        "output.errors: there is no result 'contacts.upper-lower.normal_forces'",
        "plane",
        "output.errors=['contacts.upper-lower.normal_forces']",
        "output.errors=['contacts.upper-lower.normal_force']",
    ),
    Bound(
        "stands there 2 times",
        "plane",
        "output.errors=['bodies.upper.displacement_max', 'bodies.upper.displacement_max']",
        "output.errors=['bodies.upper.displacement_max', 'bodies.lower.displacement_max']",
    ),
    Bound(
        "output.errors: 'bodies.upper.von_mises_max' asks for stresses",
        "plane",
        ["output.stress=false", "output.errors=['bodies.upper.von_mises_max']"],
        ["output.stress=false", "output.errors=['bodies.upper.displacement_max']"],
    ),
    Bound(
        'output.errors: need the fields that only = "contacts" leaves out',
        "plane",
        ["output.only=contacts", "output.errors=main"],
        "output.errors=main",
    ),
    Bound(
        'output.errors: need outer = "newton", not "anderson"',
        "pair",
        ["method.outer=anderson", "output.errors=main"],
        "output.errors=main",
    ),
    Bound(
        "method.target: there is no result 'contacts.upper-lower.normal_forces'",
        "plane",
        "method.target={'contacts.upper-lower.normal_forces' = 0.01}",
        "method.target={'contacts.upper-lower.normal_force' = 0.01}",
    ),
    Bound(
        "method.target: 'bodies.upper.reaction.x' stands there 2 times",
        "plane",
        "method.target={'bodies.upper.reaction.x' = 0.1, 'bodies.upper.reaction.0' = 0.1}",
        "method.target={'bodies.upper.reaction.x' = 0.1, 'bodies.upper.reaction.1' = 0.1}",
    ),
    Bound(
        'method.target: need the fields that only = "contacts" leaves out',
        "plane",
        ["output.only=contacts", "method.target={'bodies.upper.reaction.x' = 0.1}"],
        "method.target={'bodies.upper.reaction.x' = 0.1}",
    ),
    Bound(
        'method.target: need outer = "newton", not "anderson"',
        "pair",
        ["method.outer=anderson", "method.target={'bodies.upper.reaction.x' = 0.1}"],
        "method.target={'bodies.upper.reaction.x' = 0.1}",
    ),
    Bound(
        "method.target.bodies.upper.reaction.x: expected a number >= 1e-05",
        "plane",
        "method.target={'bodies.upper.reaction.x' = 0.9e-5}",
        "method.target={'bodies.upper.reaction.x' = 1e-5}",
    ),
    Bound(
        "method.target.bodies.upper.reaction.x: expected a number <= 1.0",
        "plane",
        "method.target={'bodies.upper.reaction.x' = 1.001}",
        "method.target={'bodies.upper.reaction.x' = 1.0}",
    ),
    Bound(
        "within: expected a number > 0",
        "plane",
        "method.target={'bodies.upper.reaction.x' = {within = 0.0}}",
        "method.target={'bodies.upper.reaction.x' = {within = 1e-99}}",
    ),
    Bound(
        'output.errors: there are none with time.motions = "far"',
        "far",
        "output.errors=main",
        "output.error=false",
    ),
    Bound(
        'animation = "von_mises" asks for stresses; drop stress = false',
        "steps",
        ["output.stress=false", "output.animation=von_mises"],
        ["output.stress=true", "output.animation=von_mises"],
    ),
    Bound(
        "shows the other half of axisymmetric bodies",
        "plane",
        "output.mirrored=true",
        "output.mirrored=false",
    ),
    Bound(
        "only pictures of solids have a view and a cut",
        "plane",
        "output.view=[30.0, 30.0]",
        "output.view=true",
    ),
    Bound(
        "a cut has one of x, y and z", "space", "output.cut={x=0.5, y=0.5}", "output.cut={x=0.5}"
    ),
    Bound(
        'belongs to outer = "relaxation", not to "newton"',
        "plane",
        ["method.outer=newton", "method.theta=0.3"],
        "method.outer=newton",
    ),
    Bound(
        "is for two supported bodies with one unilateral contact",
        "plane",
        "method.theta=0.3",
        [
            "method.theta=0.3",
            "rigid=[]",
            "contact.1.kind=unilateral",
            "contact=[{bodies=['upper', 'lower'], on=['bottom', 'top']}]",
        ],
    ),
    Bound(
        'output.derivatives: need outer = "newton", not "anderson"',
        "plane",
        [
            "rigid=[]",
            "contact=[{bodies=['upper', 'lower'], on=['bottom', 'top']}]",
            "method.outer=anderson",
            f"output.derivatives=['{YOUNG}']",
        ],
        f"output.derivatives=['{YOUNG}']",
    ),
    Bound(
        "stands there 2 times",
        "plane",
        f"output.derivatives=['{YOUNG}', '{YOUNG}']",
        f"output.derivatives=['{YOUNG}']",
    ),
]

ASKED += [
    Bound(
        "axis must not be zero; a turn is about it, by the right-hand rule",
        "space",
        [
            "time={points=[1.0], motions='far'}",
            "body.block.motion={turn=1.0, axis=[0.0, 0.0, 0.0]}",
        ],
        [
            "time={points=[1.0], motions='far'}",
            "body.block.motion={turn=1.0, axis=[0.0, 0.0, 1e-9]}",
        ],
    ),
    Bound(
        "it is not a formula: ",
        "plane",
        "body.upper.clamp.1.x=2 * (x",
        "body.upper.clamp.1.x=2 * (x)",
    ),
    Bound(
        "'w' is not known; known are x, y",
        "plane",
        "body.upper.clamp.1.x=w",
        "body.upper.clamp.1.x=x",
    ),
    Bound(
        "; a mesh is given by file = …",
        "plane",
        mesh('geometry="a.msh", size=1.0'),
        mesh('file="a.msh"'),
    ),
    Bound(
        "corners: a quadrilateral has 4 corners, got 5",
        "plane",
        corners("[0.0, 2.0], [-1.0, 1.0]"),
        corners("[0.0, 2.0]"),
    ),
    Bound(
        "2 entries are on 'a'; leave all but one of them out",
        "plane",
        "body.lower.material=[{on='a', young=1.0, poisson=0.3}, {on='a', young=2.0, poisson=0.3}]",
        "body.lower.material=[{on='a', young=1.0, poisson=0.3}, {on='b', young=2.0, poisson=0.3}]",
    ),
    Bound(
        "(entries: none, the list is empty)",
        "plane",
        ["rigid=[]", "contact=[]", "rigid.tool.radius=1.0"],
        ["rigid.tool.radius=1.0"],
    ),
    Bound(
        "or on = [[1, 2]], both",
        "plane",
        "contact.1.on=[1, 2]",
        "contact.1.on=[[1, 2]]",
    ),
    Bound(
        "max takes 2 values, as in max(x, y)",
        "plane",
        "body.upper.clamp.1.x=max(x)",
        "body.upper.clamp.1.x=max(x, y)",
    ),
]

BOUNDS = [
    *NUMBERS,
    *SHAPES,
    *MATERIALS,
    *CONTACTS,
    *PARTNERS,
    *TIMES,
    *MOTIONS,
    *COPIES,
    *ITSELF,
    *IMAGES,
    *ASKED,
]


class Solved(NamedTuple):
    """Words of a warning or a refusal of a mesh or an answer; makes a scene past (True) or before its limit."""

    words: str
    of: Callable[[bool], dict]


STRAIN = Kind("strain", 1, False)

WIDTH, HEIGHT = SIZE[2]

EXTENT = float(np.hypot(WIDTH, HEIGHT))


def alone(**keys: Any) -> dict:
    """A block by itself on its guides, or with other clamps."""
    return STRAIN.scene(STRAIN.block(**{"clamp": STRAIN.guides()} | keys))


def stacked(upper: dict, lower: dict, **contact: Any) -> dict:
    """Two blocks on each other: on a lower one between walls an upper one."""
    below = {"clamp": [*STRAIN.walls(), STRAIN.hold("bottom")], "height": BELOW} | lower
    above = {"clamp": STRAIN.walls()} | upper
    lower_block = STRAIN.block("lower", bottom=below.pop("bottom", LOW[2][1] - BELOW), **below)
    bodies = [STRAIN.block("upper", **above), lower_block]
    sides = {"bodies": ["upper", "lower"], "on": ["bottom", "top"]}
    return STRAIN.scene(*bodies, contact=[sides | contact])


PRESSED = {"traction": [{"on": "top", "pressure": LOAD}]}


FALLING = {"clamp": STRAIN.guides()[:1], "traction": [{"on": "top", "value": [LOAD, 0.0]}]}
"""What a block does not bear: meshes are doubted where there is no answer."""


def thin(past: bool) -> dict:
    """√3 a b / (a² + b²) of a right triangle is 0.05 for b = 0.0289 a: between 44 and 45 rows."""
    return alone(cells=(1, 45 if past else 44), **FALLING)


def slender(past: bool) -> dict:
    return alone(height=WIDTH / (50.1 if past else 49.9), **FALLING)


def carried(past: bool) -> dict:
    """A block that is moved as a whole by a tenth of its size."""
    way = 0.1 * EXTENT * (1.000001 if past else 0.999999)
    return alone(clamp=[STRAIN.hold("bottom", way), {"on": "left & bottom", "x": 0.0}])


def strained(past: bool) -> dict:
    """A block between walls that is made longer by a tenth."""
    way = 0.1 * HEIGHT * (1.000001 if past else 0.999999)
    return alone(clamp=[*STRAIN.walls(), STRAIN.hold("bottom"), STRAIN.hold("top", way)])


def light(past: bool) -> dict:
    """Two loose blocks, of which one bears 1e-8 of what the other one does."""
    blocks = [
        STRAIN.block(name, clamp=[{"on": "left & bottom", "x": 0.0}],
                     traction=[{"on": "top", "pressure": load}])
        for name, load in (("first", LOAD), ("second", LOAD * (0.99e-8 if past else 1.01e-8)))
    ]  # fmt: skip
    contacts = [{"bodies": [block["name"], "floor"], "on": ["bottom"]} for block in blocks]
    return STRAIN.scene(*blocks, rigid=[STRAIN.floor()], contact=contacts)


def lost(past: bool) -> dict:
    held = {"on": "top" if past else "top & left", "x": 0.0}
    load = {"on": "top", "value": [0.3 * LOAD, -LOAD]}
    return alone(clamp=[STRAIN.hold("bottom"), held], traction=[load])


def twice(past: bool) -> dict:
    loads = [{"on": "top", "pressure": LOAD}, {"on": "top" if past else "right", "pressure": LOAD}]
    return alone(traction=loads)


def on_springs(past: bool) -> dict:
    """Springs along the normal twice, or once with springs along the surface."""
    way = "normal" if past else "tangential"
    return alone(foundation=[{"on": "right", "normal": 1e9}, {"on": "right", way: 1e9}])


def profiled(past: bool) -> dict:
    """Friction whose profile ends with the contact, or 1e-5 of its length before."""
    ends = [LOW[2][0], LOW[2][0] + WIDTH * (1.0 - 1e-5 * past)]
    friction = {"law": "coulomb", "coefficient": {"points": ends, "values": [0.2, 0.3]}}
    return stacked(PRESSED, {}, friction=friction)


def locking(past: bool) -> dict:
    return alone(stuff=Stuff.isotropic(7.1e9, 0.48 + 1e-9 * past), traction=PRESSED["traction"])


def idle(past: bool) -> dict:
    scene = stacked(PRESSED, {})
    far = {"name": "far", "shape": "circle", "center": [9.0, 9.0], "radius": 0.3}
    touched = {"bodies": ["upper", "far"], "on": ["right"]}
    return scene | {"rigid": [far], "contact": scene["contact"] + [touched] * (not past)}


def unfollowed(past: bool) -> dict:
    """A history beside the one that a load follows."""
    load = {"on": "top", "value": [0.0, LOAD], "history": "other" if not past else "way"}
    scene = alone(traction=[load, {"on": "right", "value": [0.0, 0.0], "history": "way"}])
    curve = {"times": [0.0, 1.0], "factors": [0.0, 1.0]}
    return scene | {"history": {"way": curve, "other": curve}, "time": {"points": [1.0]}}


def cut_off(past: bool) -> dict:
    """A load whose history goes on after the load steps with another factor, or with the one at their end."""
    load = {"on": "top", "value": [0.0, LOAD], "history": "way"}
    curve = {"times": [0.0, 1.0, 1.5], "factors": [0.0, 0.4, 0.4 + 3e-9 * past]}
    return alone(traction=[load]) | {"history": {"way": curve}, "time": {"points": [1.0]}}


def of_zeros(past: bool) -> dict:
    """A support that follows a history of zeros, or of next to nothing."""
    held = [*STRAIN.guides(), {"on": "top", "y": -1e-5, "history": "way"}]
    curve = {"times": [1.0, 2.0], "factors": [0.0, 0.0 if past else 1e-300]}
    return alone(clamp=held) | {"history": {"way": curve}, "time": {"points": [1.0, 2.0]}}


def constant(past: bool) -> dict:
    """Bodies that move far are in load steps, also without a history; a second step with the same loads is meant for one."""
    scene = few(False)
    return scene | {"time": scene["time"] | {"points": [1.0, 2.0] if past else [1.0]}}


def moved_on(past: bool) -> dict:
    """A block that is pushed along another one by as much as its three nodes are apart in the mean, with halves at ends."""
    way = WIDTH / 3.0 * (1.001 if past else 0.999)
    walls = [{"on": on, "x": way} for on in ("left", "right")]
    return stacked({"clamp": walls} | PRESSED, {})


def around(past: bool) -> dict:
    """A block whose corner is pushed over a round partner by a tenth of its radius."""
    radius = 1.9
    way = 0.1 * radius * (1.001 if past else 0.999)
    walls = [{"on": on, "x": way} for on in ("left", "right")]
    at = STRAIN.low - radius * STRAIN.up
    disc = {"name": "round", "shape": "circle", "center": at.tolist(), "radius": radius}
    contact = {"bodies": ["block", "round"], "on": ["bottom"]}
    block = STRAIN.block(clamp=walls, **PRESSED)
    return STRAIN.scene(block, rigid=[disc], contact=[contact])


def few(past: bool) -> dict:
    """A block that comes from above onto a floor with three nodes, or with five."""
    block = STRAIN.block(cells=(2 if past else 4, 2), clamp=[*STRAIN.walls(), STRAIN.hold("top")])
    block["motion"] = {"shift": (-1.0001 * STRAIN.up).tolist()}
    floor = STRAIN.floor(point=(STRAIN.low - STRAIN.up).tolist())
    contact = {"bodies": ["block", "floor"], "on": ["bottom"]}
    time = {"points": [1.0], "steps": 1, "motions": "far"}
    return STRAIN.scene(block, rigid=[floor], contact=[contact], time=time)


def open_by_rounding(past: bool) -> dict:
    """Sides that are apart by 1e-9 of what their bodies move by along them at one end, and by half of it at the other."""
    way = 0.0371
    walls = [{"on": on, "x": way} for on in ("left", "right")]
    lower = {"clamp": [*walls, STRAIN.hold("bottom")]}
    more = 0.49 if past else 0.51
    gap = f"{1e-9 * way} * (0.5 + {more} * (x - {LOW[2][0]}) / {WIDTH})"
    return stacked({"clamp": [*walls, STRAIN.hold("top")]}, lower, gap=gap)


def clashing(past: bool) -> dict:
    """Clamps that meet at a corner agree to 1e-9 of what they prescribe."""
    ways = 1e-3, 1e-3 * (1.0 + (3e-9 if past else 0.3e-9))
    sides = [{"on": on, "y": way} for on, way in zip(("bottom", "left"), ways, strict=True)]
    return alone(clamp=[*sides, {"on": "left", "x": 0.0}])


def overlapping(past: bool) -> dict:
    """A lower block that overlaps the upper one by its own depth, which is the smaller one."""
    low = LOW[2][1] - BELOW + BELOW * (1.001 if past else 0.999)
    return stacked(PRESSED, {"bottom": low})


def rubbing_backwards(past: bool) -> dict:
    """A coefficient that is negative at the last node of the side, or next to nothing there."""
    formula = f"0.3 * ({LOW[2][0] + WIDTH} - x) {'-' if past else '+'} 1e-9"
    return stacked(PRESSED, {}, friction={"law": "coulomb", "coefficient": formula})


def beyond_the_axis(past: bool) -> dict:
    axis = Kind("axis", 1, False)
    block = axis.block(clamp=axis.guides(), **PRESSED)
    block["mesh"]["origin"][0] = -1e-6 if past else 0.0
    return axis.scene(block)


def of_another_number(past: bool) -> dict:
    lower = {"cells": (3 if past else 2, 1)}
    return stacked(PRESSED, lower, pairing="nodes")


def aside(past: bool) -> dict:
    """A lower block that is moved aside by a hundredth of what a node at an end has of the side, a quarter of it."""
    scene = stacked(PRESSED, {}, pairing="nodes")
    scene["body"][1]["mesh"]["origin"][0] += 0.25 * WIDTH * (1.01e-2 if past else 0.99e-2)
    return scene


def bonded_in_part(past: bool) -> dict:
    """A cell whose image stands aside by a little more, or less, than a hundredth of its sides."""
    shift = [WIDTH, HEIGHT * (1.01e-2 if past else 0.99e-2)]
    bond = {"bodies": ["block", "block"], "on": ["right", "left"], "kind": "bonded"}
    bond |= {"pairing": "mortar", "image": {"shift": shift}}
    block = STRAIN.block(clamp=[STRAIN.hold("bottom"), {"on": "bottom", "x": 0.0}], **PRESSED)
    return STRAIN.scene(block, contact=[bond])


def bonded_to_two(past: bool) -> dict:
    """A lower block that one larger block covers by half, or another one beside it wholly."""
    uppers = [
        STRAIN.block(name, clamp=[*STRAIN.walls(), STRAIN.hold("top", 1e-6)], height=2.0 * HEIGHT)
        for name in ("first", "second")[: 2 - past]
    ]
    lower = STRAIN.block("lower", bottom=LOW[2][1] - BELOW, height=BELOW)
    for upper, aside in zip(uppers, (0.5, -0.7), strict=False):
        upper["mesh"]["origin"][0] += aside * WIDTH
        upper["mesh"]["size"][0] *= 1.2
    bonds = [
        {"bodies": [upper["name"], "lower"], "on": ["bottom", "top"], "kind": "bonded"}
        for upper in uppers
    ]
    return STRAIN.scene(*uppers, lower, contact=bonds)


def not_one_to_one(past: bool) -> dict:
    """A lower block that is moved aside by more than half the distance of nodes: two of them are nearest to one."""
    scene = stacked(PRESSED, {}, pairing="nodes")
    scene["body"][1]["mesh"]["origin"][0] += 0.251 * WIDTH * past
    return scene


def all_clamped(past: bool) -> dict:
    """A side whose normals are all held has no contact to solve."""
    held = [*STRAIN.walls(), STRAIN.hold("bottom" if past else "top")]
    return stacked(
        {"clamp": held}, {"clamp": [*STRAIN.walls(), STRAIN.hold("top" if past else "bottom")]}
    )


def skewed(past: bool) -> dict:
    """The Jacobians of a trapezoid are as its parallel sides, of which one is three times the other."""
    scene = alone(**FALLING)
    (block,) = scene["body"]
    corners = [[0.0, 0.0], [0.3 * (1.01 if past else 0.99), 0.0], [0.1, 0.2], [0.0, 0.2]]
    order = block["mesh"]["order"]
    block["mesh"] = {
        "shape": "quadrilateral",
        "corners": corners,
        "divisions": [1, 1],
        "order": order,
        "elements": "bricks",
    }
    return scene


SOLVED = [
    Solved("are far from parallelepipeds, and bend too stiffly", skewed),
    Solved("of the measure of a regular one; stresses are poor there", thin),
    Solved("50 times as long as it is thick; so slender a body bends", slender),
    Solved("times its size", carried),
    Solved("strains and rotations reach 0.1", strained),
    Solved("are negligible beside those on another body", light),
    Solved("the load on 'top' along x is lost", lost),
    Solved("'top' has 2 loads by pressure; they add up", twice),
    Solved("'right' has 2 foundations; they add up", on_springs),
    Solved("beyond its ends the profile is constant", profiled),
    Solved("linear elements lock at nu = 0.48", locking),
    Solved("rigid.far: no contact names it; nothing touches it", idle),
    Solved("history.other: nothing follows it", unfollowed),
    Solved("they do not reach its factor 0.4 at time 1.5", cut_off),
    Solved("its factor is 0 at the ends of all legs, and with it body.block.clamp.", of_zeros),
    Solved("the loads are the same in all load steps", constant),
    Solved("where they are free, or its image stands elsewhere", bonded_in_part),
    Solved("the bond covers 0.5 of the smaller side", bonded_to_two),
    Solved("times the distance of their neighbours", moved_on),
    Solved("times its radius, as at", around),
    Solved("only 3 closed nodes, too few to resolve the pressure", few),
    Solved("rounding decides that it is open", open_by_rounding),
]  # fmt: skip
"""Warnings, whose scenes are solved on both sides."""

REFUSED = [
    Solved("is prescribed twice, as 0.001 and, on 'left', as 0.001", clashing),
    Solved("they face away from each other", overlapping),
    Solved("; friction is not negative", rubbing_backwards),
    Solved("lies on the other side of the axis", beyond_the_axis),
    Solved("sides have 3 and 4 nodes; their meshes must match node by node", of_another_number),
    Solved("the nodes of the two sides do not lie opposite each other", aside),
    Solved("the nodes of the two sides do not pair off one to one", not_one_to_one),
    Solved("all nodes of the contact are clamped; there is nothing to solve", all_clamped),
]
"""Refusals of a mesh, its clamps and contacts."""
