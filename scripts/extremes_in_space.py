"""Extremes in space: scenes, what is changed in them, and their runs; a part of `scripts/study extremes`."""

import copy
import tempfile
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from experiment import Row
from mpi4py import MPI
from problems.bodies import QUARTER, plane
from problems.revolved import half_ball
from result_check import violations
from scenes import to_toml
from solid_scenes import HELD, box, two_boxes

from ddmpi.errors import DdmpiError, NotConvergedError
from ddmpi.results.tables import read_results
from ddmpi.run.run import run
from ddmpi.scene.reader import read_scene

SOLIDS = ("outcome", "iterations", "n_A", "residual", "violation", "differs")
Scene = dict[str, Any]
Change = Callable[[Scene], Any]
"""What is changed in a scene of its own."""

DRAWN = tempfile.TemporaryDirectory()
"""Of the ball."""

FLOOR = plane("floor", (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))


def coulomb(coefficient: float) -> dict:
    return {"friction": {"law": "coulomb", "coefficient": coefficient}}


def later(function: Callable) -> Callable[..., Callable]:
    """Decorator: the arguments after the scene, or after `pairs` and `order`, are given first."""
    return lambda *more, **keys: lambda *first: function(*first, *more, **keys)


# Scenes

def clamped(pairs: bool, order: int) -> Scene:
    """Two boxes that are clamped at one end."""
    N = {1: 4, 2: 3}[order]
    return two_boxes(N, None if pairs else N - 1, order)


def loose(pairs: bool, order: int) -> Scene:
    """Three boxes on each other and on a rigid plane, supported by friction alone."""
    names, divisions = ("low", "middle", "top"), ((3, 3, 2), (3, 3, 2) if pairs else (2, 4, 2))
    bodies = [box(name, (0, 0, k), (1, 1, 1), divisions[k % 2], order, traction=[]) for k, name in enumerate(names)]
    bodies[2]["traction"] = [{"on": "top", "value": [5e3, 1.5e3, -1e5]}]
    friction = coulomb(0.5)
    contacts = [{"name": f"{name}-{other}", "bodies": [name, other], "on": ["bottom", "top"]} | friction
                for other, name in pairwise(names)]
    return {"body": bodies, "rigid": [FLOOR], "contact": [
        {"name": "low-floor", "bodies": ["low", "floor"], "on": ["bottom"]} | friction, *contacts]}


@later
def pressed(pairs: bool, order: int, size: tuple, divisions: tuple) -> Scene:
    """Two boxes alike on each other, of which the upper one is moved down by 1e-4 of its height, and along x."""
    across = divisions if pairs else tuple(max(1, n - 1) for n in divisions)
    move = {"on": "top", "x": 1e-5 * size[2], "y": 0.0, "z": -1e-4 * size[2]}
    return {"body": [box("upper", (0, 0, size[2]), size, divisions, order, clamp=[move], traction=[]),
                     box("lower", (0, 0, 0), size, across, order, clamp=[{"on": "bottom"} | HELD], traction=[])],
            "contact": [{"name": "upper-lower", "bodies": ["upper", "lower"], "on": ["bottom", "top"]} | coulomb(0.3)]}


@later
def side_by_side(pairs: bool, order: int, slenderness: float) -> Scene:
    """Two needles that are clamped at their lower ends; one is pressed against the other all along, and sideways."""
    w = 1.0 / slenderness
    scene, load = pressed((w, w, 1.0), (2, 2, 30))(pairs, order), 6e7 * w**3
    upper, lower = scene["body"]
    upper["mesh"]["origin"], upper["clamp"] = [w, 0.0, 0.0], lower["clamp"]
    upper["traction"] = [{"on": "right", "value": [-load, 0.1 * load, 0.0]}]
    scene["contact"][0]["on"] = ["left", "right"]
    return scene


@later
def small_on_large(pairs: bool, order: int, part: float) -> Scene:
    """A cube on another one that is larger by 1/`part`."""
    scene = pressed((1.0, 1.0, 1.0), (3, 3, 3))(pairs, order)
    scene["body"][0]["mesh"] |= {"origin": [0.4, 0.4, 1.0], "size": [part] * 3}
    scene["body"][0]["clamp"] = [{"on": "top", "x": 1e-3 * part, "y": 0.0, "z": -1e-2 * part}]
    return scene


@later
def ball(pairs: bool, order: int, approach: float, modulus: float | None = None) -> Scene:
    """A quarter of a ball that is pressed on a rigid plane, or on a box of this modulus."""
    mesh = half_ball(Path(DRAWN.name) / "ball.msh", 0.1, 0.03, order)
    one = {"name": "ball", "mesh": mesh, "material": {"young": 1.0, "poisson": 0.3},
           "clamp": [*QUARTER, {"on": "top", "z": -approach}]}
    if not modulus:
        return {"body": [one], "rigid": [FLOOR], "contact": [{"bodies": ["ball", "floor"], "on": ["contact"]}]}
    base = box("floor", (0, 0, -1), (1, 1, 1), (8, 8, 8), order, modulus, clamp=[
        {"on": "bottom"} | HELD, {"on": "front", "y": 0.0}, {"on": "left", "x": 0.0}])
    return {"body": [one, base], "contact": [{"bodies": ["ball", "floor"], "on": ["contact", "top"]}]}


def changed(scene: Scene, changes: tuple[Change, ...]) -> Scene:
    scene = copy.deepcopy(scene)
    for change in changes:
        change(scene)
    return scene


@later
def of_bodies(scene: Scene, **keys: Any) -> None:
    """Other constants of the materials: one for all bodies, or one each."""
    for k, each in enumerate(scene["body"]):
        each["material"] |= {key: value[k] if isinstance(value, tuple) else value for key, value in keys.items()}


@later
def stiffer(scene: Scene, factor: float) -> None:
    """The second body."""
    scene["body"][1]["material"]["young"] *= factor


@later
def law(scene: Scene, name: str, **keys: float) -> None:
    """Of all contacts."""
    for each in scene["contact"]:
        each |= {"kind": "bonded", "friction": {"law": "none"}} if name == "bonded" else {
            "friction": {"law": name} | keys}


@later
def units(scene: Scene, length: float = 1.0, stress: float = 1.0) -> None:
    """Lengths and stresses are so many times larger."""
    for each in scene["body"]:
        for key in ("origin", "size"):
            each["mesh"][key] = [length * x for x in each["mesh"][key]]
        each["material"]["young"] *= stress
        for load in each["traction"]:
            load["value"] = [stress * q for q in load["value"]]


@later
def elsewhere(scene: Scene, far: float) -> None:
    for place, key in [*((each["mesh"], "origin") for each in scene["body"]),
                       *((each, "point") for each in scene.get("rigid", []))]:
        place[key] = [x + far for x in place[key]]


@later
def higher(scene: Scene, by: float) -> None:
    """Each body is moved away from the one on which it stands."""
    loose = "rigid" in scene
    for k, each in enumerate(scene["body"] if loose else scene["body"][:1]):
        each["mesh"]["origin"][1 + loose] += (k + 1) * by


@later
def cells(scene: Scene, *divisions: int) -> None:
    """Of both bodies, of the second one fewer along each axis where its nodes do not match."""
    one, other = (each["mesh"] for each in scene["body"])
    fewer = one["divisions"] != other["divisions"]
    one["divisions"], other["divisions"] = list(divisions), [max(1, n - fewer) for n in divisions]


@later
def meshes(scene: Scene, first: int, second: int) -> None:
    """Divisions across the contact."""
    for each, n in zip(scene["body"], (first, second), strict=True):
        each["mesh"]["divisions"] = [n, n, max(1, n // 4)]


@later
def tall(scene: Scene, height: float, shear: float) -> None:
    """Loose boxes of this height, with this part of the shear."""
    for k, each in enumerate(scene["body"]):
        each["mesh"] |= {"origin": [0.0, 0.0, k * height], "size": [1.0, 1.0, height]}
    value = scene["body"][2]["traction"][0]["value"]
    value[:2] = [shear * q for q in value[:2]]


def no_loads(scene: Scene) -> None:
    for each in scene["body"]:
        each["traction"] = []


def solid_cases() -> dict[tuple[str, str], tuple[Callable[..., Scene], tuple[Change, ...], float | None]]:
    """The table of extremes in space, by (group, case): what makes the scene, what is changed, and how many times
    larger displacements should be than without the change, if that is known."""
    made: list[tuple] = [("two boxes, clamped", "as they are", clamped, (), None)]
    made += [("two boxes, clamped", f"E₁/E₂ = {1 / c:g}", clamped, (stiffer(c),), None) for c in (1e-6, 1e-3, 1e3, 1e6)]
    made += [("two boxes, clamped", f"𝓕 = {F:g}", clamped, (law("coulomb", coefficient=F),), None)
             for F in (0.0, 1e-6, 0.05, 1.0, 3.0, 10.0)]
    made += [("two boxes, clamped", f"Tresca, g = {g:g} Pa", clamped, (law("tresca", slip_bound=g),), None)
             for g in (0.0, 1e3, 1e6, 1e20)]
    made += [("two boxes, clamped", f"bonded, E₁/E₂ = {1 / c:g}", clamped, (law("bonded"), stiffer(c)), None)
             for c in (1e-6, 1.0, 1e6)]
    made += [("two boxes, clamped", f"Poisson's ratios {a:g} and {b:g}", clamped, (of_bodies(poisson=(a, b)),), None)
             for a, b in ((0.0, 0.0), (0.49, 0.49), (0.499, 0.499), (0.49999, 0.49999), (0.0, 0.4999), (-0.9, 0.4))]
    made += [("two boxes, clamped", f"unit of length {1 / c:g} m", clamped, (units(c),), c) for c in (1e-9, 1e9)]
    made += [("two boxes, clamped", f"unit of force {1 / c:g} N", clamped, (units(stress=c),), 1.0)
             for c in (1e-9, 1e9)]
    made += [("two boxes, clamped", f"{c:g} m from the origin", clamped, (elsewhere(c),), 1.0) for c in (1e3, 1e6)]
    made += [("two boxes, clamped", f"drawn {g:g} m apart", clamped, (higher(g),), None) for g in (1e-9, -1e-9)]
    made += [("two boxes, clamped", f"upper one {g:g} m above, bent down to touch at its edge", clamped, (
        higher(g), lambda s: s["body"][1].update(traction=[]),
        lambda s: s["body"][0].update(traction=[{"on": "right", "value": [0.0, -3e8, 4e8]}])), None) for g in (0.02,)]
    made += [("two boxes, clamped", f"{' × '.join(map(str, n))} cells", clamped, (cells(*n),), None)
             for n in ((1, 1, 1), (60, 1, 1), (1, 60, 1), (1, 1, 60))]
    made += [("flat and slender bodies", f"pressed flat, 1 : {1 / h:g}", pressed((1.0, 1.0, h), (6, 6, 2)), (), None)
             for h in (1e-2, 1e-3, 1e-4)]
    made += [("flat and slender bodies", f"needles end to end, 1 : {n:g}", pressed((1 / n, 1 / n, 1.0), (3, 3, 30)), (),
              None) for n in (10, 100, 1000)]
    made += [("flat and slender bodies", f"needles side by side, 1 : {n:g}", side_by_side(n), (), None)
             for n in (10, 100, 1000)]
    made += [("meshes and sizes", f"{a} : {b} cells across the contact", pressed((1.0, 1.0, 1.0), (4, 4, 1)),
              (meshes(a, b),), None) for a, b in ((1, 12), (12, 1))]
    made += [("meshes and sizes", f"a cube of {part:g} m on one of 1 m", small_on_large(part), (), None)
             for part in (0.1, 1e-2, 1e-3, 1e-4)]
    made += [("ball, R = 1 m", f"on a plane, approach {a:g} m", ball(a), (), None) for a in (7.5e-3, 1e-4, 1e-9)]
    made += [("ball, R = 1 m", f"on a box, E₁/E₂ = {1 / c:g}", ball(7.5e-3, c), (), None) for c in (1e-6, 1.0, 1e6)]
    made += [("three boxes, loose", "as they are", loose, (), None)]
    made += [("three boxes, loose", f"middle one softer by {1 / c:g}", loose, (stiffer(c),), None)
             for c in (1e-3, 1e3, 1e6)]
    made += [("three boxes, loose", f"𝓕 = {F:g}", loose, (law("coulomb", coefficient=F),), None)
             for F in (0.0, 0.05, 0.053, 10.0)]
    made += [("three boxes, loose", f"Tresca, g = {g:g} Pa", loose, (law("tresca", slip_bound=g),), None)
             for g in (1e3, 1e4, 1e20)]
    made += [("three boxes, loose", f"unit of length {1 / c:g} m", loose, (units(c),), c) for c in (1e-9, 1e9)]
    made += [("three boxes, loose", f"unit of force {1 / c:g} N", loose, (units(stress=c),), 1.0) for c in (1e-9, 1e9)]
    made += [("three boxes, loose", f"{c:g} m from the origin", loose, (elsewhere(c),), 1.0) for c in (1e3, 1e6)]
    made += [("three boxes, loose", f"drawn {g:g} m apart", loose, (higher(g),), None) for g in (1e-9, 1e-3)]
    made += [("three boxes, loose", f"heights of {h:g} m", loose, (tall(h, min(1.0, 1.0 / h)),), None)
             for h in (1e-3, 1e-2, 100.0, 1000.0)]
    made += [("three boxes, loose", "heights of 100 m, so that they tip over", loose, (tall(100.0, 1.0),), None),
             ("three boxes, loose", "no loads", loose, (no_loads,), None)]
    return {(group, case): rest for group, case, *rest in made}


# Runs

def attempt_solid(scene: Scene, base: np.ndarray | None, factor: float | None) -> tuple[Row, np.ndarray | None]:
    """Solve a scene of solids on this rank and check what is written by another program's stiffness.

    ``violation`` is the largest of all laws, ``differs`` the distance of displacements from `factor` times `base`.
    Returns the row and the displacements.
    """
    row, u = dict.fromkeys(SOLIDS, np.nan) | {"iterations": 0, "n_A": 0}, None
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "results"
        try:
            try:
                run(MPI.COMM_SELF, read_scene("scene", to_toml(scene)), "scene", str(folder), False)
                row["outcome"] = "certified"
            except NotConvergedError as error:
                row["outcome"] = str(error).splitlines()[0]
            results = read_results(folder)
            u, summary = results.displacement(), results.summary
            row |= {"iterations": summary["outer_iterations"], "n_A": summary["n_A"]}
            if row["outcome"] == "certified":
                row["residual"] = max(summary["certificate"].values())
                if all("origin" in body["mesh"] for body in scene["body"]):
                    row["violation"] = max(violations(scene, folder).values())
                if base is not None and factor:
                    row["differs"] = float(np.abs(u / factor - base).max() / np.abs(base).max())
        except DdmpiError as error:
            row["outcome"] = f"refused: {str(error).splitlines()[0].removeprefix('scene: ')}"
    return row, u
