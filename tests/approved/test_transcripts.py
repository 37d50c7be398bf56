"""Transcripts: all that small, unlike scenes and commands say and write is as somebody has approved of it.

An approved text, in a file of the transcript's name beside this one, proves nothing by itself: it was read once, and
tells of any change. `scripts/study approve` writes it anew; what is right of it, other tests say.
"""

from __future__ import annotations

import gc
import os
import shutil
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import pytest
from mpi4py import MPI
from scenes import call
from transcripts import SHAKEN, compare, entries, page_words, said, written

import ddmpi
from ddmpi.check import check, costs
from ddmpi.errors import InputError
from ddmpi.pictures import draw
from ddmpi.results import checkpoint
from ddmpi.results.summary import plain
from ddmpi.run import answer

TRANSCRIPTS: dict[str, Callable[[], list[str]]] = {}
"""By name; each is made in an empty folder, the present one."""


def transcript(make: Callable[[], list[str]]) -> Callable[[], list[str]]:
    TRANSCRIPTS[make.__name__] = make
    return make


def command(*arguments: str, comm: Any = None) -> list[str]:
    return ["", f"$ ddmpi {' '.join(arguments)}", *said(call(*arguments, comm=comm))]


def put(text: str, name: str = "scene.toml") -> None:
    share = 1.0 + float(os.environ.get(SHAKEN, "0"))
    for young in (2.3e3, 7.1e3, 1.9e3, 5.3e3, 3.7e3, 310.0):
        text = text.replace(f"young = {young:g}", f"young = {young * share!r}")
    Path(name).write_text(text, encoding="utf-8")


def ran(text: str, *more: str) -> list[str]:
    """A scene that is run, with all that it writes."""
    put(text)
    return [
        *command("run", "scene.toml", "--output", "out", "--no-figures", *more),
        *written(Path("out")),
    ]


RUBBED = """
title = "a pad that is rubbed to and fro"
[[body]]
name = "pad"
mesh = { shape = "rectangle", origin = [0.3, 0.45], size = [0.9, 0.4], divisions = [3, 1], order = 2 }
material = { young = 7100, poisson = 0.31, plane = "stress" }
clamp = [{ on = "top", x = 0.004, history = "rub" }, { on = "top", y = -0.0031, history = "press" }]
[[body]]
name = "base"
mesh = { shape = "rectangle", origin = [-0.1, 0.0], size = [1.7, 0.45], divisions = [4, 1], order = 2 }
material = [{ young = 2300, poisson = 0.18, plane = "stress" }]
clamp = ["bottom"]
foundation = [{ on = "left", normal = 170.0, tangential = 60.0 }]
traction = [{ on = "right", value = ["-0.7 * y", 0.9], history = "rub" }]
[[contact]]
name = "wear"
bodies = ["pad", "base"]
on = ["bottom", "top"]
friction = { law = "coulomb", coefficient = "0.2 + 0.1 * x" }
gap = 0.0002
[history.press]
times = [0.0, 1.0]
factors = [0.0, 1.3]
[history.rub]
times = [1.0, 1.7, 2.9]
factors = [0.0, 1.0, -0.6]
[time]
points = [1.0, 1.7, 2.9]
steps = 2
[output]
steps = "all"
length_unit = "mm"
stress_unit = "MPa"
derivatives = ["body.pad.material.young", "contact.wear.gap"]
"""


@transcript
def rubbed_pad() -> list[str]:
    """Load steps with friction, springs and formulas in plane stress, with derivatives; its report, a path and a view."""
    lines = ran(RUBBED)
    lines += command("report", "out", "--step", "1.7", "--output", "report.html")
    lines += command("path", "out", "--from", "0.35,0.6", "--to", "1.1,0.1", "--points", "4")
    lines += command("path", "out", "--from", "0.35,6", "--to", "1.1,5", "--points", "4")
    lines += command("view", "out", "--output", "view.html")
    for name in ("scene.toml",):
        Path(name).unlink()
    shutil.rmtree("out")
    return lines + written(Path("."))


FIT = """
title = "a ring that is shrunk on a shaft"
axisymmetric = true
[[body]]
name = "shaft"
mesh = { shape = "rectangle", origin = [0.0, -0.2], size = [0.5, 1.1], divisions = [2, 4], order = 2 }
material = { young = 5300, poisson = 0.27, expansion = 1.3e-3 }
temperature = 3.0
clamp = [{ on = "bottom", y = 0.0 }]
volume_force = [0.0, -0.9]
[[body]]
name = "ring"
mesh = { shape = "rectangle", origin = [0.5, 0.1], size = [0.3, 0.6], divisions = [1, 3], order = 2 }
material = { young = 1900, poisson = 0.36, expansion = 2.1e-3 }
temperature = "7 * y"
clamp = [{ on = "top", y = 0.0 }]
[[contact]]
bodies = ["ring", "shaft"]
on = ["left", "right"]
pairing = "mortar"
friction = { law = "tresca", slip_bound = 1.7 }
gap = -0.003
[output]
errors = ["contacts.ring-shaft.normal_force", "bodies.shaft.reaction.y", "bodies.ring.von_mises_max"]
mirrored = true
"""


@transcript
def shrunk_ring() -> list[str]:
    """A fit around an axis with heat, mortar and error bars."""
    lines = ran(FIT)
    return [
        *lines,
        *command("report", "out", "--output", "report.html"),
        *written(Path("."), "out/|scene.toml"),
    ]


BOXES = """
title = "two boxes, a bond that is tightened and an orthotropic one"
[[body]]
name = "cover"
mesh = { shape = "box", origin = [0.1, -0.3, 0.5], size = [0.9, 0.7, 0.3], divisions = [2, 1, 1] }
material = { young = [7100, 5300, 3700], poisson = [0.2, 0.17, 0.3], shear = [1700, 900, 1300], axes = [[3, 1, 0], [0, 1, 0]] }
traction = [{ on = "top", pressure = 3.1 }, { on = "right", force = [0.4, 0.0, -0.3] }]
[[body]]
name = "seat"
mesh = { shape = "box", origin = [0.0, -0.4, 0.0], size = [1.2, 0.9, 0.5], divisions = [2, 2, 1], elements = "bricks" }
material = { young = 2300, poisson = 0.18 }
clamp = [{ on = "bottom", z = 0.0 }, { on = "left", along = [1, 0.4, 0], value = 0.002 },
    { on = "right & front & bottom", y = 0.0 }]
[[rigid]]
name = "ball"
shape = "sphere"
center = [0.5, 0.0, 2.1]
radius = 1.3
displacement = [0.0, 0.0, -0.001]
[[contact]]
bodies = ["cover", "seat"]
on = ["bottom", "top"]
friction = { law = "coulomb", coefficient = 0.4 }
[[contact]]
bodies = ["cover", "ball"]
on = ["top"]
softness = 0.0003
"""


@transcript
def boxes() -> list[str]:
    """Space: orthotropy, bricks, a ball, a soft joint; its report from another view."""
    lines = ran(BOXES, "--errors")
    return [
        *lines,
        *command("report", "out", "--output", "report.html"),
        *written(Path("."), "out/|scene.toml"),
    ]


LOOSE = """
title = "loose blocks on a floor"
[[rigid]]
name = "floor"
shape = "plane"
point = [0.0, 0.0]
normal = [0.0, 1.0]
[[body]]
name = "first"
mesh = { shape = "rectangle", origin = [0.0, 0.0], size = [1.0, 0.5], divisions = [3, 1] }
material = { young = 2300, poisson = 0.2 }
volume_force = [0.0, -3.1]
[[body]]
name = "second"
mesh = { shape = "rectangle", origin = [SHIFT, 0.5], size = [1.1, 0.4], divisions = [3, 1] }
material = { young = 1900, poisson = 0.3 }
volume_force = [0.0, -2.7]
[[body]]
name = "apart"
mesh = { shape = "annulus", center = [3.0, 0.5], radii = [0.2, 0.5], angles = [0, 360], divisions = [12, 1] }
material = { young = 5300, poisson = 0.24 }
volume_force = [0.0, -0.4]
[[contact]]
bodies = ["first", "floor"]
on = ["bottom"]
[[contact]]
bodies = ["second", "first"]
on = ["bottom", "top"]
friction = { law = "coulomb", coefficient = 0.3 }
[[contact]]
bodies = ["apart", "floor"]
on = ["outer"]
"""


@transcript
def loose_blocks() -> list[str]:
    """Motions that nothing determines; then a tower that tips, which has no equilibrium; and what check says of both."""
    put(LOOSE.replace("SHIFT", "0.2"))
    lines = command("check", "scene.toml", "--no-figures", "--output", "check")
    lines += ran(LOOSE.replace("SHIFT", "0.2"))
    put(LOOSE.replace("SHIFT", "0.7"), "tips.toml")
    lines += command("run", "tips.toml", "--output", "tips", "--no-figures")
    lines += written(Path("tips"), "result|contact_|summary")
    return [
        *lines,
        *command("report", "tips", "--output", "report.html"),
        *written(Path("."), "/|toml"),
    ]


PUBLISHED = """
[[body]]
name = "upper"
mesh = { shape = "rectangle", origin = [0.0, 0.6], size = [1.0, 0.5], divisions = [3, 2] }
material = { young = 2300, poisson = 0.3 }
clamp = [{ on = "top", x = 0.003, y = -0.005 }]
[[body]]
name = "lower"
mesh = { shape = "rectangle", origin = [0.0, 0.0], size = [1.0, 0.6], divisions = [3, 2] }
material = { young = 7100, poisson = 0.2 }
clamp = ["bottom"]
[[contact]]
bodies = ["upper", "lower"]
on = ["bottom", "top"]
friction = { law = "LAW }
[method]
outer = "relaxation"
MORE
"""


@transcript
def published_method() -> list[str]:
    """The paper's iteration: certified, stopped too early, and with a law that it takes as a fixed point."""
    text = PUBLISHED.replace("LAW", 'tresca", slip_bound = 3.1')
    lines = ran(text.replace("MORE", 'algorithm = "modified"\ntheta = 0.3'))
    put(text.replace("MORE", "max_iterations = 4"))
    lines += command("run", "scene.toml", "--output", "few", "--no-figures")
    lines += written(Path("few"), "result|summary")
    put(
        PUBLISHED.replace("LAW", 'coulomb", coefficient = 0.3').replace(
            "MORE", "max_iterations = 3"
        )
    )
    lines += command(
        "run",
        "scene.toml",
        "--output",
        "less",
        "--set",
        "method.outer=newton",
        "method.max_iterations=1",
    )
    return lines


FAR = """
title = "a block that is pushed far over a table by a tool"
[[body]]
name = "block"
mesh = { shape = "rectangle", origin = [0.2, 0.5], size = [0.6, 0.4], divisions = [2, 1] }
material = { young = 7100, poisson = 0.3 }
volume_force = [0.0, -6.3]
motion = { free = ["y"] }
clamp = [{ on = "left", x = 0.0, y = 0.0 }]
[[body]]
name = "table"
mesh = { shape = "rectangle", size = [2.3, 0.5], divisions = [5, 1] }
material = { young = 1900, poisson = 0.2 }
clamp = ["bottom"]
motion = { shift = [-0.31, 0.0], history = "way" }
[[contact]]
bodies = ["block", "table"]
on = ["bottom", "top"]
friction = { law = "coulomb", coefficient = 0.2 }
[history.way]
times = [0.0, 1.0, 2.1]
factors = [0.0, 1.0, -0.4]
[time]
points = [1.0, 2.1]
steps = 2
motions = "far"
[output]
steps = "all"
"""


@transcript
def far_motion() -> list[str]:
    put(FAR)
    lines = command("check", "scene.toml", "--no-figures", "--output", "check")
    lines += ran(FAR)
    return [
        *lines,
        *command("report", "out", "--output", "report.html"),
        *written(Path("."), "/|toml"),
    ]


WHEEL = """
title = "a third of a wheel, with a slit"
[[body]]
name = "wheel"
mesh = { shape = "annulus", center = [0.0, 0.0], radii = [0.5, 1.2], angles = [10, 130], divisions = [6, 2], order = 2 }
material = { young = 3700, poisson = 0.28 }
volume_force = ["41 * x", "41 * y"]
traction = [{ on = "inner", pressure = 2.3 }]
clamp = [{ on = "inner & start", x = 0.0, y = 0.0 }]
[[contact]]
name = "next"
bodies = ["wheel", "wheel"]
on = ["end", "start"]
kind = "bonded"
image = { turn = 120.0 }
[output]
sectors = true
"""


@transcript
def sectors() -> list[str]:
    lines = ran(WHEEL)
    lines += command("check", "scene.toml", "--no-figures", "--output", "check")
    return [
        *lines,
        *command("report", "out", "--output", "report.html"),
        *written(Path("."), "out/|toml"),
    ]


BOLT = """
title = "plates under a bolt that is tightened, then pulled in cycles"
axisymmetric = true
[[body]]
name = "shank"
mesh = { shape = "rectangle", origin = [0.0, 0.0], size = [0.3, 1.0], divisions = [1, 4] }
material = { young = 7100, poisson = 0.3 }
clamp = [{ on = "bottom", y = 0.0 }]
[[body]]
name = "sleeve"
mesh = { shape = "rectangle", origin = [0.3, 0.1], size = [0.5, 0.8], divisions = [2, 3] }
material = { young = 3700, poisson = 0.25 }
clamp = [{ on = "right", y = 0.0 }]
traction = [{ on = "right", pressure = 1.7, history = "pull" }]
[[contact]]
name = "thread"
bodies = ["shank", "sleeve"]
on = ["right", "left"]
kind = "bonded"
pretension = { force = 3.1, along = [0.0, -1.0], history = "tighten" }
[history.tighten]
times = [0.0, 1.0]
factors = [0.0, 1.0]
[history.pull]
times = [1.0, 1.5, 2.2, 2.5]
factors = [0.0, 1.0, -0.7, 1.0]
[time]
points = [1.0, 1.5, 2.2, 2.5]
steps = 1
cycle = { from = 1.5, to = 2.5, repeat = 2 }
"""


@transcript
def tightened_bolt() -> list[str]:
    """A pretension and cycles around an axis; a run that goes on from its checkpoint."""
    lines = ran(BOLT)
    put(BOLT.replace("to = 2.5, repeat = 2", "to = 2.2, repeat = 2"), "wrong.toml")
    return lines + command("check", "wrong.toml", "--no-figures")


PUSHED = """
[[body]]
name = "block"
mesh = { shape = "rectangle", origin = [0.3, 0.2], size = [0.7, 0.4], divisions = [3, 1] }
material = { young = 5300, poisson = 0.3 }
traction = [{ on = "top", pressure = 4.1 }, { on = "left", force = [0.11, 0.0] }]
[[rigid]]
name = "floor"
shape = "plane"
point = [0.0, 0.2]
normal = [0.0, 1.0]
[[contact]]
bodies = ["block", "floor"]
on = ["bottom"]
friction = { law = "coulomb", coefficient = 0.23 }
"""


@transcript
def limit_and_sweep() -> list[str]:
    """The limit of a load, with its history of factors; a sweep, of which one case fails, its list, table and report."""
    put(PUSHED)
    load = "--load", "body.block.traction.1"
    lines = command("limit", "scene.toml", *load, "--output", "limit", "--no-figures")
    lines += written(Path("limit"), "result|summary")
    vary = "contact.block-floor.friction.coefficient=0.05:0.35:3"
    more = "body.block.traction.1.force=[0.11,0],[0.3,-0.1]"
    sweep = "sweep", "scene.toml", "--vary", vary, "--vary", more, "--output", "sweep"
    lines += command(*sweep, "--list") + command(*sweep, "--index", "2")
    lines += command(*sweep) + command(*sweep, "--list") + command(*sweep, "--gather")
    lines += command("report", "sweep", "--output", "report.html")
    return [*lines, *written(Path("sweep"), "/"), *written(Path("."), "/|toml")]


@transcript
def converged_result() -> list[str]:
    """Meshes that follow the error bar of a result, met and missed."""
    put(FIT.partition("[output]")[0].replace("-0.003", "-0.0031"))
    of = "--of", "contacts.ring-shaft.normal_force"
    lines = command(
        "converge", "scene.toml", *of, "--within", "0.05", "--output", "out", "--no-figures"
    )
    lines += written(Path("out"), "result|contact")
    unmet = "method.max_unknowns=40"
    lines += command(
        "converge",
        "scene.toml",
        *of,
        "--within",
        "1e-5",
        "--set",
        unmet,
        "--output",
        "no",
        "--no-figures",
    )
    return lines


CHECKED = """
title = "parts that nobody has joined yet"
[[body]]
name = "cover"
mesh = { shape = "box", origin = [0.1, -0.3, 0.5], size = [0.9, 0.7, 0.3], divisions = [2, 1, 1] }
material = { young = 7100, poisson = 0.3 }
clamp = [{ on = "left & bottom", x = 0.0, y = 0.0, z = 0.0 }, { on = "right & front", z = 0.001 }]
traction = [{ on = "top", pressure = "3.1 * x" }, { on = "right", moment = [0.1, 0.2, 0.0] }]
[[body]]
name = "seat"
material = { young = 2300, poisson = 0.18 }
clamp = ["bottom"]
[body.mesh]
shape = "hexahedron"
divisions = [2, 2, 1]
elements = "bricks"
corners = [
    [0.0, -0.4, 0.0], [1.2, -0.4, 0.0], [1.2, 0.5, 0.0], [0.0, 0.5, 0.0],
    [0.0, -0.4, 0.4992], [1.2, -0.4, 0.4996], [1.2, 0.5, 0.4994], [0.0, 0.5, 0.499],
]
"""


@transcript
def checked_parts() -> list[str]:
    """A check of parts in space: contacts that are missing, the page of faces, costs; around an axis and in the plane."""
    lines = []
    for name, text in {"parts": CHECKED, "fit": FIT, "rubbed": RUBBED}.items():
        put(text, f"{name}.toml")
        lines += command("check", f"{name}.toml", "--output", name) + written(Path(name))
    return lines


NOTEBOOK = (
    "contacts.cover-seat.normal_force",
    "bodies.seat.reaction.z",
    "contacts.cover-ball.tangential_force",
)


@transcript
def notebook() -> list[str]:
    """What Python has: an answer in words and as a notebook shows it, gradients, and what a model takes again."""
    put(BOXES)
    lines = []
    with ddmpi.prepare("scene.toml", MPI.COMM_SELF) as model:
        for changes in ({}, {"rigid.ball.displacement": [0.0, 0.01, -0.0013]}):
            found = model.solve(changes)
            lines += repr(found).splitlines() + list(page_words(found._repr_html_()))
            lines += [f"reused {name}: {' '.join(stages)}" for name, stages in model.reused.items()]
        for result in NOTEBOOK:
            lines += [f"{result}.{line}" for line in entries(plain(found.gradient(result)))]
        for wrong in ("contacts.cover.force", "bodies.seat.reaction", "bodies.seat"):
            with pytest.raises(InputError) as error:
                found.gradient(wrong)
            lines.append(str(error.value))
        for name in ("to_meshio", "error", "derivative", "meshes"):
            with pytest.raises(InputError) as error:
                getattr(found, name)("seet")
            lines.append(str(error.value))
    return lines


@transcript
def restarted() -> list[str]:
    """A run that goes on from a checkpoint, and one that is refused for another scene."""
    text = RUBBED.partition("derivatives")[0] + "[checkpoint]\niterations = 1\n"
    put(text)
    write, kept = checkpoint.write, Path("kept")

    def keep(target: Path, *given: Any) -> None:
        write(target, *given)
        kept.mkdir(exist_ok=True)
        if len(seen) == 2:
            shutil.copy(target, kept / target.name)
        seen.append(target)

    seen: list[Path] = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(checkpoint, "write", keep)
        lines = command("run", "scene.toml", "--output", "out", "--no-figures")
    again = "run", "scene.toml", "--no-figures", "--restart", "kept"
    lines += command(*again, "--set", "body.pad.material.poisson=0.3")
    return [
        *lines,
        *command(*again),
        *written(kept, "result|contact|summary"),
        f"checkpoints: {len(seen)}",
    ]


WRONG = (
    "contact.wear.friction.coefficient=-0.1",
    "contact.wear.frction=1",
    'contact.wear.on=["botom","top"]',
    'contact.wear.bodies=["pad","bas"]',
    "body.pad.material.young=0",
    "body.pad.material.poisson=0.5",
    "body.pad.mesh.divisions=[0,1]",
    'body.pad.mesh.shape="box"',
    "body.pad.mesh.order=3",
    "body.base.foundation.0.normal=-3",
    'body.base.traction.0.value=["y +",0]',
    'body.base.traction.0.history="rob"',
    "time.points=[1.0,0.5]",
    "time.steps=0",
    "history.rub.factors=[1.0]",
    'output.steps="every"',
    'output.derivatives=["body.pad.young"]',
    'method.outer="newtn"',
    "method.theta=0.3",
    'output.length_unit="inch"',
    "nonsense",
    "body.5.material.young=3",
    "body.pad.clamp=[]",
    'body.pad.mesh.file="none.msh"',
    'output.errors="main"',
)


@transcript
def bad_input() -> list[str]:
    """What is said of keys and values that are wrong, one at a time."""
    put(RUBBED)
    lines = []
    for setting in WRONG:
        lines += command("check", "scene.toml", "--no-figures", "--set", setting)
    for text in ("[[body]", "title = 3\n", '[[body]]\nname = "a b"\n', ""):
        put(text, "broken.toml")
        lines += command("check", "broken.toml", "--no-figures")
    lines += command("run", "none.toml") + command("report", "none") + command("run")
    return (
        lines
        + command("path", "none", "--from", "0,0", "--to", "1,1")
        + command("limit", "scene.toml", "--load", "rib")
    )


DECK = """*HEADING
a punch on a block
*NODE, NSET=ALL
1, 0., 0.
2, 1.3, 0.
3, 2.9, 0.
4, 0., 0.7
5, 1.3, 0.7
6, 2.9, 0.7
11, 0.3, 0.7
12, 1.1, 0.7
13, 0.3, 1.3
14, 1.1, 1.3
*ELEMENT, TYPE=CPS4, ELSET=BLOCK
1, 1, 2, 5, 4
2, 2, 3, 6, 5
*ELEMENT, TYPE=CPS4, ELSET=PUNCH
11, 11, 12, 14, 13
*NSET, NSET=FLOOR
1, 2, 3
*NSET, NSET=TOP
13, 14
*SURFACE, NAME=UNDER
PUNCH, S1
*SURFACE, NAME=OVER
BLOCK, S3
*SURFACE, NAME=ABOVE
PUNCH, S3
*MATERIAL, NAME=SOFT
*ELASTIC
2300., 0.21
*DENSITY
0.7
*EXPANSION, ZERO=20.
1.2e-4
*MATERIAL, NAME=HARD
*ELASTIC
7100., 0.3
*SOLID SECTION, ELSET=BLOCK, MATERIAL=SOFT
0.4
*SOLID SECTION, ELSET=PUNCH, MATERIAL=HARD
0.4
*SURFACE INTERACTION, NAME=RUB
*FRICTION
0.17
*CONTACT PAIR, INTERACTION=RUB, TYPE=SURFACE TO SURFACE
UNDER, OVER
*AMPLITUDE, NAME=SLOW
0., 0., 0.5, 0.3, 1., -0.2
*BOUNDARY
FLOOR, 1, 2
*INITIAL CONDITIONS, TYPE=TEMPERATURE
ALL, 20.
*STEP
*STATIC
0.1, 1.
*BOUNDARY
TOP, 1, 1
*BOUNDARY
TOP, 2, 2, -0.003
*DLOAD, AMPLITUDE=SLOW
2, P2, 0.9
*NODE FILE
U
*END STEP
*STEP
*STATIC
0.1, 1.
*CLOAD
6, 1, 0.31
*END STEP
"""


@transcript
def imported_deck() -> list[str]:
    """A deck of two parts: what is said of its cards, the scene that it becomes, and what that says when it is run."""
    put(DECK, "deck.inp")
    lines = command("import", "deck.inp", "--output", "scene")
    lines += written(Path("scene"))
    lines += command("import", "deck.inp", "--output", "partly", "--partial")
    lines += written(Path("partly"))
    wrong = {
        "0.17": "0.17, 1.",
        "CPS4, ELSET=PUNCH": "CPS9, ELSET=PUNCH",
        "2300.": "-2300.",
        "UNDER, OVER": "UNDER, OWER",
        "FLOOR, 1, 2": "FLOOR, 1, 7",
        "2, P2": "2, P7",
        "*END STEP\n*STEP": "*STEP",
    }
    for old, new in wrong.items():
        put(DECK.replace(old, new), "wrong.inp")
        lines += command("import", "wrong.inp", "--output", "no")
    return lines


def forecast(assembly: Any, measured: Mapping[str, float], drawn: bool) -> costs.Costs:
    """On a machine that is always the same."""
    return costs.forecast(assembly, dict.fromkeys(measured, 1.7), drawn)


@pytest.mark.parametrize("name", TRANSCRIPTS)
def test_a_transcript_is_as_approved(name, tmp_path_factory, monkeypatch):
    """Each word is, and each number but for its last digit."""
    monkeypatch.chdir(tmp_path_factory.mktemp(f"approved-{name}"))
    monkeypatch.setattr(gc, "collect", lambda: 0)  # takes half of the time of a small run
    monkeypatch.setattr(answer, "has_matplotlib", lambda: False)
    monkeypatch.setattr(check, "has_matplotlib", lambda: False)
    monkeypatch.setattr(draw, "draw_all", lambda *_, **__: None)  # no words are in pictures
    monkeypatch.setattr(costs, "measure_speed", lambda: costs.Speed(1.0, 1.3, 0.7))
    monkeypatch.setattr(costs, "peak_memory", lambda: 90.0)
    monkeypatch.setattr(check, "forecast", forecast)
    compare(name, TRANSCRIPTS[name]())


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
def test_a_transcript_of_two_ranks_is_as_approved(comm, tmp_path, monkeypatch):
    """What the first rank says of both, also where a body has several ranks and where bodies are loose."""
    monkeypatch.chdir(comm.bcast(str(tmp_path)))
    lines = []
    for name, text in {
        "fit": FIT,
        "loose": LOOSE.replace("SHIFT", "0.2"),
        "tips": LOOSE.replace("SHIFT", "0.7"),
        "alone": PUSHED,
    }.items():
        if comm.rank == 0:
            put(text, f"{name}.toml")
        comm.barrier()
        lines += command("run", f"{name}.toml", "--output", name, "--no-figures", comm=comm)
        comm.barrier()
        if comm.rank == 0:
            lines += written(Path(name), "csv|result|vtu|summary")
    if comm.rank == 0:
        compare("two_ranks", lines)
