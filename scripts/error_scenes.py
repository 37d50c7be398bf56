"""The scenes on which the rule for errors of results was made: parts in contact of all kinds, each on several meshes.

A scene is a function (n, order, off) of the fineness of its mesh, the order of its elements, and by how much finer other
bodies are meshed, so that nodes do not match.
"""

from __future__ import annotations

import os
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import NamedTuple

from experiment import ROOT

MeshOf = tuple[int, int, int]
"""n, order, off."""

STEEL = {"young": 2.1e5, "poisson": 0.3}
ALUMINIUM = {"young": 7e4, "poisson": 0.33}
BOX = {"young": 2.119e11, "poisson": 0.277}


class Problem(NamedTuple):
    """A scene, its meshes with the finest one, whose answer is the truth, last; and the names that are asked for."""

    scene: Callable[[int, int, int], dict]
    meshes: Sequence[MeshOf]
    only: Sequence[str] = ()


PROBLEMS: dict[str, Problem] = {}
"""On which the rule was made."""

FRESH: dict[str, Problem] = {}
"""Made after the last change of the rule."""


def on(*meshes: MeshOf, only: Sequence[str] = (), among: dict[str, Problem] = PROBLEMS) -> Callable:
    """Decorator: puts a scene into a set of problems under its name."""

    def register(scene: Callable[[int, int, int], dict]) -> Callable[[int, int, int], dict]:
        among[scene.__name__] = Problem(scene, meshes, only)
        return scene

    return register


def body(name: str, mesh: dict, material: dict, clamp=(), traction=(), **more) -> dict:
    sides = {"clamp": list(clamp), "traction": list(traction)}
    return {"name": name, "mesh": mesh, "material": material} | sides | more


def contact(first: str, second: str, *sides: str, name: str = "c", **more) -> dict:
    return {"name": name, "bodies": [first, second], "on": list(sides)} | more


def rubbing(coefficient: float) -> dict:
    return {"friction": {"law": "coulomb", "coefficient": coefficient}}


def rectangle(x: float, y: float, w: float, h: float, nx: int, ny: int, order: int) -> dict:
    shape = {"shape": "rectangle", "origin": [x, y], "size": [w, h]}
    return shape | {"divisions": [nx, ny], "order": order}


def ring(r1: float, r2: float, angles: list[float], nx: int, ny: int, order: int) -> dict:
    shape = {"shape": "annulus", "center": [0.0, 0.0], "radii": [r1, r2], "angles": angles}
    return shape | {"divisions": [nx, ny], "order": order}


def drawn(path: str, order: int, **sizes: float) -> dict:
    return {"geometry": str(ROOT / path), "order": order} | sizes


def plane(name: str, point: list[float], normal: list[float], **more) -> dict:
    return {"name": name, "shape": "plane", "point": point, "normal": normal} | more


def shipped(name: str) -> dict:
    """A scene of configs/."""
    return tomllib.loads((ROOT / "configs" / f"{name}.toml").read_text(encoding="utf-8"))


BLOCKS = (8, 1, 0), (8, 1, 2), (16, 1, 0), (16, 1, 2), (4, 2, 0), (4, 2, 2), (8, 2, 2), (32, 2, 2)


@on(*BLOCKS)
def boxes(n: int, order: int, off: int) -> dict:
    push = {"on": "top", "value": [0.0, -6e7]}, {"on": "right", "value": [2e7, 3e7]}
    lift = ({"on": "bottom", "value": [0.0, 4e7]},)
    m = n + off
    return {
        "body": [
            body("upper", rectangle(0, 1, 3, 1, 3 * n, n, order), BOX, ["left"], push),
            body("lower", rectangle(0, 0, 3, 1, 3 * m, m, order), BOX, ["left"], lift),
        ],
        "contact": [contact("upper", "lower", "bottom", "top", **rubbing(0.3))],
    }


@on(*BLOCKS)
def tresca(n: int, order: int, off: int) -> dict:
    scene = boxes(n, order, off)
    scene["contact"][0]["friction"] = {"law": "tresca", "slip_bound": 1e7}
    return scene


@on((8, 1, 0), (16, 1, 2), (4, 2, 2), (8, 2, 2), (32, 2, 2))
def loose(n: int, order: int, off: int) -> dict:
    scene = boxes(n, order, off)
    scene["body"][0]["clamp"] = []
    scene["body"][0]["traction"][1]["value"] = [2e6, 1e6]
    return scene


@on((2, 1, 0), (4, 1, 0), (1, 2, 0), (2, 2, 0), (8, 2, 0), only=("c0", "c5", "v5", "v3"))
def arch(n: int, order: int, off: int) -> dict:
    scene = shipped("arch")
    for each in scene["body"]:
        each["mesh"] |= {"divisions": [3 * n, 2 * n], "order": order}
    return scene | {"contact": [c | {"name": f"c{k}"} for k, c in enumerate(scene["contact"])]}


@on(
    (2, 1, 0),
    (4, 1, 0),
    (1, 2, 0),
    (2, 2, 0),
    (6, 2, 0),
    only=("c0", "c1", "c9", "a4", "d4", "b2"),
)
def wall(n: int, order: int, off: int) -> dict:
    scene = shipped("wall")
    for each in scene["body"]:
        divisions = [k * n // 2 for k in each["mesh"]["divisions"]]
        each["mesh"] |= {"divisions": divisions, "order": order}
    return scene | {"contact": [c | {"name": f"c{k}"} for k, c in enumerate(scene["contact"])]}


@on((8, 1, 0), (8, 1, 2), (16, 1, 2), (4, 2, 0), (4, 2, 2), (8, 2, 2), (24, 2, 4))
def bonded(n: int, order: int, off: int) -> dict:
    scene = shipped("bonded_block")
    for k, each in enumerate(scene["body"]):
        m = n + off * (k % 2)
        each["mesh"] |= {"divisions": [2 * m, m], "order": order}
    scene["body"][1]["material"] = {"young": 7e10, "poisson": 0.33}
    return scene


@on((1, 1, 0), (2, 1, 0), (2, 1, 1), (4, 1, 0), (1, 2, 0), (2, 2, 0), (6, 2, 0))
def bolt(n: int, order: int, off: int) -> dict:
    scene = shipped("tightened_bolt")
    del scene["history"], scene["time"]
    cells = [3, 2], [2, 9], [1, 3], [6, 3], [6, 3]
    for each, divisions in zip(scene["body"], cells, strict=True):
        m = n + off * (each["name"] == "lower")
        each["mesh"] |= {"divisions": [k * m for k in divisions], "order": order}
        for traction in each.get("traction", []):
            traction.pop("history", None)
    for each in scene["contact"]:
        each.get("pretension", {}).pop("history", None)
    return scene


@on((2, 1, 0), (4, 1, 0), (8, 1, 0), (1, 2, 0), (2, 2, 0), (4, 2, 0), (16, 2, 0))
def tongue(n: int, order: int, off: int) -> dict:
    pull = ({"on": "right", "value": [60.0, 0.0]},)
    mesh = rectangle(0, 0, 40, 5, 8 * n, n, order)
    return {
        "body": [body("tongue", mesh, STEEL, [{"on": "bottom", "y": 0.0}], pull)],
        "rigid": [plane("slot", [0.0, 5.0], [0.0, -1.0])],
        "contact": [contact("tongue", "slot", "top", gap=-0.005, **rubbing(0.1))],
    }


@on((2, 1, 0), (4, 1, 0), (1, 2, 0), (2, 2, 0), (6, 2, 0))
def hub(n: int, order: int, off: int) -> dict:
    m, whole = n + off, [0, 360]
    turn = {"constant": [0.0, 0.0], "x_slope": [0.0, 4e7], "y_slope": [-4e7, 0.0]}
    shaft = ring(0.02, 0.05, whole, 24 * n, 2 * n, order)
    bush = ring(0.05, 0.065, whole, 24 * m, m, order)
    hole = {"shape": "circle", "center": [0.0, 0.0], "radius": 0.065, "inside": True}
    return {
        "rigid": [{"name": "hub"} | hole],
        "body": [
            body(
                "shaft",
                shaft,
                {"young": 2.1e11, "poisson": 0.3},
                (),
                [{"on": "inner", "value": turn}],
                volume_force=[0.0, -7.58e7],
            ),
            body("bush", bush, {"young": 1.1e11, "poisson": 0.34}),
        ],
        "contact": [
            contact("shaft", "bush", "outer", "inner", name="s", gap=1.7e-5, **rubbing(0.2)),
            contact("bush", "hub", "outer", name="h", gap=-1.5e-5, **rubbing(0.15)),
        ],
    }


PLANES = [{"on": "start", "normal": 0.0}, {"on": "end", "normal": 0.0}]


@on((1, 1, 0), (2, 1, 0), (2, 1, 1), (4, 1, 0), (1, 2, 0), (2, 2, 0), (2, 2, 1), (6, 2, 0))
def heated(n: int, order: int, off: int) -> dict:
    m, part = n + off, [30, 120]
    bush = {"young": 1.1e5, "poisson": 0.34, "plane": "stress", "expansion": 1.8e-5}
    laminate = {
        "young": [1.4e5, 1e4, 1e4],
        "poisson": [0.3, 0.3, 0.4],
        "shear": 5e3,
        "angle": 30.0,
        "plane": "stress",
        "expansion": 2e-6,
    }
    inner = ring(15.0, 20.0, part, 12 * n, 2 * n, order)
    outer = ring(20.0, 40.0, part, 12 * m, 5 * m, order)
    return {
        "body": [
            body("bush", inner, bush, PLANES, temperature=120.0),
            body("laminate", outer, laminate, PLANES, temperature=120.0),
        ],
        "contact": [contact("bush", "laminate", "outer", "inner", gap=0.01, **rubbing(0.15))],
    }


@on((2, 1, 0), (4, 1, 1), (8, 1, 0), (2, 2, 0), (2, 2, 1), (4, 2, 0), (12, 2, 1))
def wedge(n: int, order: int, off: int) -> dict:
    m = n + off
    corners = [[-10.0, 0.0], [0.0, 0.0], [0.0, 60.0], [-26.077, 60.0]]
    skew = {"shape": "quadrilateral", "corners": corners, "divisions": [3 * n, 9 * n]}
    press = ({"on": "top", "force": [0.0, -2000.0]},)
    slope = [{"on": "left", "normal": 0.0}]
    block = rectangle(0, -10, 40, 80, 5 * m, 12 * m, order)
    return {
        "body": [
            body("wedge", skew | {"order": order}, STEEL, slope, press),
            body("block", block, ALUMINIUM, ["right"]),
        ],
        "contact": [contact("wedge", "block", "right", "left", **rubbing(0.1))],
    }


@on((2, 1, 0), (4, 1, 0), (1, 2, 0), (2, 2, 0), (8, 2, 0))
def rail(n: int, order: int, off: int) -> dict:
    mesh = rectangle(0, 0, 1300, 100, 26 * n, 2 * n, order)
    bed = [{"on": "bottom", "normal": 0.5}]
    held = [{"on": "left", "x": 0.0}]
    wheel = {"shape": "circle", "center": [0.0, 2560.0], "radius": 2460.0}
    return {
        "body": [body("rail", mesh, STEEL | {"plane": "stress"}, held, foundation=bed)],
        "rigid": [{"name": "wheel", "displacement": [0.0, -2.0]} | wheel],
        "contact": [contact("rail", "wheel", "top")],
    }


@on((2, 1, 0), (4, 1, 0), (8, 1, 0), (1, 2, 0), (2, 2, 0), (4, 2, 0), (16, 2, 0))
def vice(n: int, order: int, off: int) -> dict:
    mesh = rectangle(0, 0, 60, 40, 6 * n, 4 * n, order)
    lift = ({"on": "top", "force": [0.0, 150.0]},)
    return {
        "body": [body("part", mesh, ALUMINIUM, (), lift)],
        "rigid": [
            plane("fixed", [0.0, 0.0], [1.0, 0.0]),
            plane("moving", [60.5, 0.0], [-1.0, 0.0], force=[-1000.0, 0.0]),
        ],
        "contact": [
            contact("part", "fixed", "left", name="f", **rubbing(0.15)),
            contact("part", "moving", "right", name="m", **rubbing(0.15)),
        ],
    }


@on((2, 1, 0), (4, 1, 0), (4, 1, 1), (8, 1, 0), (1, 2, 0), (2, 2, 0), (2, 2, 1), (16, 2, 0))
def tubes(n: int, order: int, off: int) -> dict:
    m, press = n + off, ({"on": "top", "value": [0.0, -2e6]},)
    inner, outer = (
        rectangle(0.3, 0, 0.3, 0.2, 3 * n, 2 * n, order),
        rectangle(0.6, 0, 0.3, 0.3, 3 * m, 3 * m, order),
    )
    stands = [{"on": "bottom", "y": 0.0}]
    return {
        "axisymmetric": True,
        "body": [
            body("inner", inner, {"young": 2e11, "poisson": 0.3}, stands, press),
            body("outer", outer, {"young": 1e11, "poisson": 0.25}, stands),
        ],
        "contact": [contact("inner", "outer", "right", "left", gap=-6e-5, **rubbing(0.2))],
    }


@on((4, 1, 0), (8, 1, 0), (8, 1, 3), (4, 2, 0), (4, 2, 1), (24, 2, 0))
def rings(n: int, order: int, off: int) -> dict:
    m = n + off
    inner = ring(0.3, 0.6, [0, 90], 4 * n, n, order)
    outer = ring(0.6, 0.9, [0, 90], 4 * m, m, order)
    return {
        "body": [
            body("inner", inner, {"young": 2e11, "poisson": 0.3}, PLANES),
            body("outer", outer, {"young": 1e11, "poisson": 0.25}, PLANES),
        ],
        "contact": [contact("inner", "outer", "outer", "inner", gap=-6e-5)],
    }


@on((2, 1, 0), (4, 1, 1), (8, 1, 1), (1, 2, 0), (2, 2, 1), (4, 2, 1), (12, 2, 4))
def punch(n: int, order: int, off: int) -> dict:
    m = n + off
    press = [{"on": "top", "x": 0.01, "y": -0.02}]
    base = rectangle(-40, 0, 80, 40, 12 * m, 6 * m, order)
    return {
        "body": [
            body("punch", rectangle(-10, 40, 20, 20, 4 * n, 4 * n, order), STEEL, press),
            body("base", base, ALUMINIUM, ["bottom"]),
        ],
        "contact": [contact("punch", "base", "bottom", "top", **rubbing(0.25))],
    }


@on((2, 1, 0), (4, 1, 2), (8, 1, 0), (1, 2, 0), (2, 2, 1), (4, 2, 0), (16, 2, 2))
def cantilever(n: int, order: int, off: int) -> dict:
    m, material = n + off, STEEL | {"plane": "stress"}
    bend = ({"on": "right", "value": [0.0, -5.0]},)
    return {
        "body": [
            body("a", rectangle(0, 0, 40, 5, 8 * n, n, order), material, ["left"], bend),
            body("b", rectangle(0, 5, 40, 5, 8 * m, m, order), material, ["left"], bend),
        ],
        "contact": [contact("a", "b", "top", "bottom", kind="bonded")],
    }


@on((1, 1, 0), (2, 1, 0), (1, 2, 0), (2, 2, 0), (6, 2, 0))
def roller(n: int, order: int, off: int) -> dict:
    sizes = {"size": 10.0 / n, "contact_size": 1.5 / n}
    cylinder = drawn("meshes/roller_cylinder.geo", order, **sizes)
    base = drawn("meshes/roller_block.geo", order, size=20.0 / n, contact_size=2.0 / n)
    axis, press = {"on": "axis", "x": 0.0}, ({"on": "cut", "value": [0.0, -350.0]},)
    soft = {"young": 7e4, "poisson": 0.3}
    return {
        "body": [
            body("cylinder", cylinder, STEEL, [axis], press),
            body("block", base, soft, [axis, {"on": "bottom", "y": 0.0}]),
        ],
        "contact": [contact("cylinder", "block", "rim", "top")],
    }


@on((1, 1, 0), (2, 1, 0), (4, 1, 0), (1, 2, 0), (2, 2, 0), (8, 2, 0))
def lug(n: int, order: int, off: int) -> dict:
    part = drawn("configs/drawn/lug.geo", order, size=8.0 / n)
    pin = drawn("configs/drawn/pin.geo", order, size=4.0 / n)
    return {
        "body": [
            body("lug", part, ALUMINIUM, ["end"]),
            body("pin", pin, STEEL, volume_force=[6.36619772367581, 0.0]),
        ],
        "contact": [contact("pin", "lug", "shank", "hole", **rubbing(0.2))],
    }


@on((1, 1, 0), (2, 1, 0), (1, 2, 0), (2, 2, 0), (5, 2, 0))
def ball(n: int, order: int, off: int) -> dict:
    mesh = ring(0.5, 1.0, [-90, -60], 16 * n, 12 * n, order) | {"center": [0.0, 1.0]}
    down = [{"on": "inner", "x": 0.0, "y": -0.004}]
    return {
        "axisymmetric": True,
        "body": [body("ball", mesh, {"young": 1.0, "poisson": 0.3}, down)],
        "rigid": [plane("floor", [0.0, 0.0], [0.0, 1.0])],
        "contact": [contact("ball", "floor", "outer")],
    }


def box(x: float, z: float, size: list[float], divisions: list[int], order: int) -> dict:
    return {
        "shape": "box",
        "origin": [x, 0.0, z],
        "size": size,
        "divisions": divisions,
        "order": order,
    }


@on((3, 1, 0), (3, 1, 1), (6, 1, 0), (6, 1, 1), (2, 2, 0), (2, 2, 1), (6, 2, 1))
def solids(n: int, order: int, off: int) -> dict:
    m, size = n + off, [3.0, 1.0, 1.0]
    push = {"on": "top", "value": [0.0, 0.0, -6e7]}, {"on": "right", "value": [2e7, 1e7, 3e7]}
    lift = ({"on": "bottom", "value": [0.0, 0.0, 4e7]},)
    return {
        "body": [
            body("upper", box(0.0, 1.0, size, [3 * n, n, n], order), BOX, ["left"], push),
            body("lower", box(0.0, 0.0, size, [3 * m, m, m], order), BOX, ["left"], lift),
        ],
        "contact": [contact("upper", "lower", "bottom", "top", **rubbing(0.3))],
    }


@on((0, 1, 0), (1, 1, 0), (3, 1, 0), (0, 2, 0), (1, 2, 0), (2, 2, 0), (3, 2, 0), (2, 2, 1))
def wheel(n: int, order: int, off: int) -> dict:
    """With straight sides, which halvings leave as they are; off = 1 is round."""
    scene = shipped("lined_wheel")
    mesh = {"file": str(ROOT / "meshes" / "lined_wheel.msh"), "order": order, "refine": n}
    if off:
        mesh |= {"file": str(Path(tempfile.gettempdir()) / f"wheel-{os.getpid()}.msh"), "refine": 0}
        maker = str(ROOT / "meshes" / "lined_wheel.py")
        subprocess.run([sys.executable, maker, mesh["file"], str(order), str(n)], check=True)
    scene["body"][0]["mesh"] = mesh
    scene["contact"][0]["name"] = "c"
    return scene


@on((1, 1, 0), (2, 1, 0), (3, 1, 0), (1, 2, 0), (3, 2, 0))
def stack(n: int, order: int, off: int) -> dict:
    push = ({"on": "top", "value": [2e4, 1e4, -2e5]},)
    concrete = {"young": 2e10, "poisson": 0.2}
    bodies = [
        body(
            name,
            box(0.05 * k, 0.5 * k, [1.0, 1.0, 0.5], [4 * n, 4 * n, 2 * n], order),
            concrete,
            (),
            push if k == 2 else (),
            volume_force=[0.0, 0.0, -2e4],
        )
        for k, name in enumerate(("low", "mid", "top"))
    ]
    return {
        "body": bodies,
        "rigid": [plane("floor", [0.0, 0.0, 0.0], [0.0, 0.0, 1.0])],
        "contact": [
            contact("low", "floor", "bottom", name="f", **rubbing(0.5)),
            contact("mid", "low", "bottom", "top", name="a", **rubbing(0.5)),
            contact("top", "mid", "bottom", "top", name="b", **rubbing(0.5)),
        ],
    }


FEW = (2, 1, 0), (4, 1, 1), (1, 2, 1), (2, 2, 1), (8, 2, 1)


@on(*FEW, among=FRESH)
def cushion(n: int, order: int, off: int) -> dict:
    """A soft disc under a rigid ball, on a rough plane."""
    disc = rectangle(0.0, 0.0, 30.0, 12.0, 10 * n, 4 * n, order)
    ball = {"shape": "circle", "center": [0.0, 52.0], "radius": 40.0, "displacement": [0.0, -0.6]}
    return {
        "axisymmetric": True,
        "body": [body("disc", disc, {"young": 12.0, "poisson": 0.42})],
        "rigid": [{"name": "ball"} | ball, plane("floor", [0.0, 0.0], [0.0, 1.0])],
        "contact": [
            contact("disc", "ball", "top", name="t"),
            contact("disc", "floor", "bottom", name="f", **rubbing(0.3)),
        ],
    }


@on(*FEW, among=FRESH)
def bearing(n: int, order: int, off: int) -> dict:
    """A loaded shaft in a bore of nearly its radius, whose gap is that of the meshes."""
    m, whole = n + off, [0, 360]
    return {
        "body": [
            body(
                "shaft",
                ring(6.0, 14.99, whole, 16 * n, 2 * n, order),
                STEEL,
                (),
                [{"on": "inner", "value": [0.0, -40.0]}],
            ),
            body("bore", ring(15.0, 30.0, whole, 16 * m, 3 * m, order), ALUMINIUM, ["outer"]),
        ],
        "contact": [contact("shaft", "bore", "outer", "inner", **rubbing(0.1))],
    }


@on((2, 1, 0), (3, 1, 0), (1, 2, 0), (2, 2, 0), (4, 2, 0), among=FRESH)
def collar(n: int, order: int, off: int) -> dict:
    """Two tubes in space, whose overlap is that of the meshes."""
    ends = [{"on": "bottom", "normal": 0.0}, {"on": "top", "normal": 0.0}]

    def tube(name: str, radii: list[float], size: float) -> dict:
        mesh = {"shape": "cylinder", "center": [0.0] * 3, "axis": [0.0, 0.0, 1.0], "height": 3.0}
        return body(name, mesh | {"radii": radii, "size": size, "order": order}, STEEL, ends)

    inner, outer = tube("inner", [6.0, 10.02], 8.0 / n), tube("outer", [10.0, 15.0], 10.0 / n)
    return {"body": [inner, outer], "contact": [contact("inner", "outer", "outer", "inner")]}


@on(*FEW, among=FRESH)
def bilayer(n: int, order: int, off: int) -> dict:
    """Two plates of plane stress that expand unlike, joined by Tresca's friction under pressure."""
    m = n + off

    def plate(name: str, y: float, number: int, material: dict, **more) -> dict:
        spec = material | {"plane": "stress"}
        mesh = rectangle(0.0, y, 30.0, 4.0, 12 * number, 2 * number, order)
        hold = [{"on": "left", "x": 0.0}]
        return body(name, mesh, spec, hold + more.pop("hold", []), temperature=80.0, **more)

    press = [{"on": "top", "pressure": 30.0}]
    upper = plate("upper", 4.0, n, ALUMINIUM | {"expansion": 2.3e-5}, traction=press)
    support = [{"on": "bottom", "y": 0.0}]
    lower = plate("lower", 0.0, m, STEEL | {"expansion": 1.2e-5}, hold=support)
    joint = {"friction": {"law": "tresca", "slip_bound": 6.0}}
    return {
        "body": [upper, lower],
        "contact": [contact("upper", "lower", "bottom", "top", **joint)],
    }


@on(*FEW, among=FRESH)
def slider(n: int, order: int, off: int) -> dict:
    """A trapezoid that is pushed along a rough slope of an elastic base, with a bonded cap."""
    m = n + off
    base = {"shape": "quadrilateral", "corners": [[0, 0], [60, 0], [60, 12], [0, 24]]}
    part = {"shape": "quadrilateral", "corners": [[15, 21], [40, 16], [40, 30], [15, 30]]}
    push = [{"on": "left", "value": [25.0, 0.0]}, {"on": "top", "pressure": 60.0}]
    cap = rectangle(40.0, 16.0, 8.0, 14.0, 2 * m, 4 * m, order)
    return {
        "body": [
            body(
                "base", base | {"divisions": [12 * n, 4 * n], "order": order}, ALUMINIUM, ["bottom"]
            ),
            body("part", part | {"divisions": [6 * m, 3 * m], "order": order}, STEEL, (), push),
            body("cap", cap, ALUMINIUM, [{"on": "right", "x": 0.0}]),
        ],
        "contact": [
            contact("part", "base", "bottom", "top", name="s", **rubbing(0.2)),
            contact("part", "cap", "right", "left", name="b", kind="bonded"),
        ],
    }


@on((2, 1, 0), (3, 1, 1), (1, 2, 0), (1, 2, 1), (3, 2, 1), among=FRESH)
def pedestal(n: int, order: int, off: int) -> dict:
    """A twisted block of aluminium on a base of steel, with Tresca's friction, in space."""
    m, turn = n + off, {"constant": [3.0, -4.5, -40.0], "x_slope": [0.0, 0.3, 0.0]}
    top = box(5.0, 10.0, [20.0, 20.0, 10.0], [4 * n, 4 * n, 2 * n], order)
    base = box(0.0, 0.0, [30.0, 20.0, 10.0], [6 * m, 4 * m, 2 * m], order)
    joint = {"friction": {"law": "tresca", "slip_bound": 4.0}}
    load = [{"on": "top", "value": turn | {"y_slope": [-0.3, 0.0, 0.0]}}]
    return {
        "body": [
            body("block", top, ALUMINIUM, (), load),
            body("base", base, STEEL, ["bottom"]),
        ],
        "contact": [contact("block", "base", "bottom", "top", **joint)],
    }


REDUCED = "-reduced"
"""Ends names of problems with the reduced rule in elements of order 2, and without modes in those of order 1."""

BRICKS = (
    *("boxes", "bonded", "cantilever", "heated", "wedge", "hub", "punch", "tongue", "rings"),
    *("slider", "bearing", "tubes", "bolt", "cushion", "solids", "stack", "pedestal"),
    *(name + REDUCED for name in ("cantilever", "wedge", "tubes", "solids")),
)
"""Problems of bricks."""


def of_bricks(name: str) -> Problem:
    """A problem whose bodies are meshed with quadrilaterals or hexahedra."""
    own = (PROBLEMS | FRESH)[name.removesuffix(REDUCED)]

    def scene(n: int, order: int, off: int) -> dict:
        made, rule = own.scene(n, order, off), {}
        if name.endswith(REDUCED):
            rule = {"integration": "reduced" if order == 2 else "full"}
        for each in made["body"]:
            each["mesh"] |= {"elements": "bricks"} | rule
        return made

    return own._replace(scene=scene)
