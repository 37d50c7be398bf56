#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""The default method at the extremes of material, friction, shape, size and load, and what it costs.

Two tables: in the plane, variations of configs/pinched_blocks.toml; in space, of two boxes, of loose boxes on a plane
and of a ball. All at tolerance 1e-8.

Writes to the folder --output: a CSV file per table (a line per run, written at once, so that an interrupted study
continues), robustness_table.md and, for space, extremes_in_space.md; each is also written to docs/tables/.
"""

import copy
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, on_two_ranks, publish, table
from mpi4py import MPI
from problems.solids import PLANES, half_ball
from result_check import violations
from scenes import everywhere, exact_forces, to_toml
from solid_scenes import HELD, box, two_boxes

import ddmpi
from ddmpi.errors import DdmpiError, NotConvergedError
from ddmpi.results.tables import read_results
from ddmpi.run.answer import Answer
from ddmpi.run.run import run
from ddmpi.scene.reader import read_scene
from ddmpi.system.agreement import merged

SCENE = ROOT / "configs" / "pinched_blocks.toml"
YOUNG, PRESSED, PULLED, LIFTED = 2.119e11, (0.0, -6.0e7), (2.0e7, 3.0e7), (0.0, 4.0e7)
"""Material and loads of that scene (Pa)."""

LARGEST_COUPLED = 500
"""Most contact unknowns with which the coupled problem is solved by brute force as well."""

EXTREMES = ("n", "m", "outcome", "iterations", "n_A", "residual", "distance", "seconds")
SOLIDS = ("outcome", "iterations", "n_A", "residual", "violation", "differs")
KINDS = {(pairs, order): f"{'nodes match' if pairs else 'mortar'}, order {order}"
         for order in (1, 2) for pairs in (True, False)}
"""In space: whether the nodes of both bodies match, and the order of the elements."""

Scene = dict[str, Any]

Overrides = dict[str, Any]
"""Changes of the scene, by key, as for `ddmpi.solve`."""


# Variations of the scene

def divisions(nx: int, ny: int) -> Overrides:
    return {f"body.{name}.mesh.divisions": [nx, ny] for name in ("upper", "lower")}


def squares(N: int) -> Overrides:
    """Squares of side 1/N."""
    return divisions(3 * N, N)


def material(upper: float = 1.0, lower: float = 1.0, poisson: tuple[float, float] = (0.277, 0.277)) -> Overrides:
    return {f"body.{name}.material": {"young": YOUNG * factor, "poisson": nu}
            for name, factor, nu in (("upper", upper, poisson[0]), ("lower", lower, poisson[1]))}


def loads(upper: dict, lower: dict) -> Overrides:
    return {f"body.{name}.traction": [{"on": on, "value": value} for on, value in tractions.items()]
            for name, tractions in (("upper", upper), ("lower", lower))}


def coulomb(coefficient: float | dict) -> Overrides:
    return {"contact.0.friction": {"law": "coulomb", "coefficient": coefficient}}


def tresca(bound: float | dict) -> Overrides:
    return {"contact.0.friction": {"law": "tresca", "slip_bound": bound}}


NO_FRICTION = {"contact.0.friction": {"law": "none"}}


def size(width: float, height: float) -> Overrides:
    return {f"body.{name}.mesh.{key}": [x, y] for name, bottom in (("upper", height), ("lower", 0.0))
            for key, x, y in (("origin", 0.0, bottom), ("size", width, height))}


def jump(low: float, high: float) -> dict:
    """A profile with a jump in the middle of the contact."""
    return {"along": "x", "points": [1.5, 1.5], "values": [low, high]}


OTHER_ORDER = {"contact.0.bodies": ["lower", "upper"], "contact.0.on": ["top", "bottom"]}
TOP, RIGHT, BOTTOM = {"top": PRESSED}, {"right": PULLED}, {"bottom": LIFTED}
APART = loads({"top": (0.0, 6e7)}, {"bottom": (0.0, -6e7)})
CORNER = {"body.lower.mesh.origin": [0.0, -0.005]} | loads({"right": (0.0, -1e8)}, {})


def cases() -> dict[tuple[str, str], Overrides]:
    """The table of extremes, by (group, case)."""
    found = [("the scene as it is", "N = 22", {})]
    found += [("stiffness", f"E₁/E₂ = {factor:g}{', the lower body in role 1' if swapped else ''}",
               material(upper=factor) | swapped)
              for factor in (1e-6, 1e-3, 1e3, 1e6) for swapped in ({}, OTHER_ORDER)]
    found += [("Coulomb", f"𝓕 = {F:g}", coulomb(F)) for F in (0.0, 1e-6, 0.05, 0.3, 1.0, 3.0, 10.0)]
    found += [("Coulomb", f"𝓕 = {F:g}, N = {N}", coulomb(F) | squares(N))
              for F in (0.1, 10.0) for N in (38, 54)]
    found += [("Coulomb", f"𝓕 jumps from {low:g} to {high:g}", coulomb(jump(low, high)))
              for low, high in ((0.0, 1.0), (10.0, 0.01))]
    found += [("Tresca", f"g = {g:g} Pa", tresca(g)) for g in (0.0, 1e3, 1e6, 1.2e7, 1e20)]
    found += [("Tresca", "g jumps from 1e5 to 3e7 Pa", tresca(jump(1e5, 3e7))), ("no friction", "", NO_FRICTION)]
    found += [("Poisson's ratios", f"{a:g} and {b:g}", material(poisson=(a, b)))
              for a, b in ((0.0, 0.0), (0.49, 0.49), (0.4999, 0.4999), (0.0, 0.4999), (-0.9, 0.4))]
    found += [("triangles", f"{3 / nx:.3g} m × {1 / ny:.3g} m", divisions(nx, ny))
              for nx, ny in ((66, 1), (300, 3), (3000, 1), (3, 300), (3, 1000))]
    found += [("slender bodies", f"3 m × {height:g} m", size(3.0, height) | divisions(66, 6))
              for height in (0.3, 0.03, 0.003)]
    found += [("contact nodes", "one", divisions(1, 1)), ("contact nodes", "three thousand", divisions(3000, 8))]
    found += [("size of the bodies", f"{width:g} m", size(width, width / 3)) for width in (1e-9, 1e6)]
    found += [("unit of force", f"{1 / f:g} N", material(f, f) | loads(
        {"top": [f * q for q in PRESSED], "right": [f * q for q in PULLED]}, {"bottom": [f * q for q in LIFTED]}))
        for f in (1e-9, 1e9)]
    loaded = {"lifted apart": APART, "none": loads({}, {}), "on the upper body only": loads(TOP | RIGHT, {}),
              "on the lower body only": loads({}, BOTTOM), "contact at a corner only": CORNER}
    found += [("loads", f"{case}, {law}", changes | friction) for case, changes in loaded.items()
              for law, friction in (("Coulomb", coulomb(0.3)), ("Tresca", tresca(1.2e7)))]
    found += [("unsupported", "no clamp", {"body.upper.clamp": []}),
              ("unsupported", "free along x", {"body.upper.clamp": [{"on": "left", "y": 0}]})]
    return {(group, case): changes for group, case, changes in found}


# Variations in space

DRAWN = tempfile.TemporaryDirectory()
"""Of the ball."""

Change = Callable[[Scene], Any]
"""What is changed in a scene of its own."""


def clamped(pairs: bool, order: int) -> Scene:
    """Two boxes that are clamped at one end."""
    N = {1: 4, 2: 3}[order]
    return two_boxes(N, None if pairs else N - 1, order)


def loose(pairs: bool, order: int) -> Scene:
    """Three boxes on each other and on a rigid plane, supported by friction alone."""
    names, divisions = ("low", "middle", "top"), ((3, 3, 2), (3, 3, 2) if pairs else (2, 4, 2))
    bodies = [box(name, (0, 0, k), (1, 1, 1), divisions[k % 2], order, traction=[]) for k, name in enumerate(names)]
    bodies[2]["traction"] = [{"on": "top", "value": [5e3, 1.5e3, -1e5]}]
    friction = {"friction": {"law": "coulomb", "coefficient": 0.5}}
    contacts = [{"name": f"{name}-{other}", "bodies": [name, other], "on": ["bottom", "top"]} | friction
                for other, name in pairwise(names)]
    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
    return {"body": bodies, "rigid": [floor], "contact": [
        {"name": "low-floor", "bodies": ["low", "floor"], "on": ["bottom"]} | friction, *contacts]}


def pressed(size: tuple, divisions: tuple) -> Callable[..., Scene]:
    """Two boxes alike on each other, of which the upper one is moved down by 1e-4 of its height, and along x."""
    def made(pairs: bool, order: int) -> Scene:
        across = divisions if pairs else tuple(max(1, n - 1) for n in divisions)
        move = {"on": "top", "x": 1e-5 * size[2], "y": 0.0, "z": -1e-4 * size[2]}
        return {"body": [
            box("upper", (0, 0, size[2]), size, divisions, order, clamp=[move], traction=[]),
            box("lower", (0, 0, 0), size, across, order, clamp=[{"on": "bottom"} | HELD], traction=[])],
            "contact": [{"name": "upper-lower", "bodies": ["upper", "lower"], "on": ["bottom", "top"],
                         "friction": {"law": "coulomb", "coefficient": 0.3}}]}
    return made


def side_by_side(slenderness: float) -> Callable[..., Scene]:
    """Two needles that are clamped at their lower ends; one is pressed against the other all along, and sideways."""
    w = 1.0 / slenderness

    def made(pairs: bool, order: int) -> Scene:
        scene, load = pressed((w, w, 1.0), (2, 2, 30))(pairs, order), 6e7 * w**3
        upper, lower = scene["body"]
        upper["mesh"]["origin"], upper["clamp"] = [w, 0.0, 0.0], lower["clamp"]
        upper["traction"] = [{"on": "right", "value": [-load, 0.1 * load, 0.0]}]
        scene["contact"][0]["on"] = ["left", "right"]
        return scene
    return made


def small_on_large(part: float) -> Callable[..., Scene]:
    """A cube on another one that is larger by 1/`part`."""
    def made(pairs: bool, order: int) -> Scene:
        scene = pressed((1.0, 1.0, 1.0), (3, 3, 3))(pairs, order)
        scene["body"][0]["mesh"] |= {"origin": [0.4, 0.4, 1.0], "size": [part] * 3}
        scene["body"][0]["clamp"] = [{"on": "top", "x": 1e-3 * part, "y": 0.0, "z": -1e-2 * part}]
        return scene
    return made


def ball(approach: float, modulus: float | None = None) -> Callable[..., Scene]:
    """A quarter of a ball that is pressed on a rigid plane, or on a box of this modulus."""
    def made(pairs: bool, order: int) -> Scene:
        mesh = half_ball(Path(DRAWN.name) / "ball.msh", 0.1, 0.03, order)
        one = {"name": "ball", "mesh": mesh, "material": {"young": 1.0, "poisson": 0.3},
               "clamp": [*PLANES, {"on": "top", "z": -approach}]}
        floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
        scene = {"body": [one], "rigid": [floor], "contact": [{"bodies": ["ball", "floor"], "on": ["contact"]}]}
        if modulus:
            base = box("floor", (0, 0, -1), (1, 1, 1), (8, 8, 8), order, modulus, clamp=[
                {"on": "bottom"} | HELD, {"on": "front", "y": 0.0}, {"on": "left", "x": 0.0}])
            scene = {"body": [one, base], "contact": [{"bodies": ["ball", "floor"], "on": ["contact", "top"]}]}
        return scene
    return made


def changed(scene: Scene, changes: tuple[Change, ...]) -> Scene:
    scene = copy.deepcopy(scene)
    for change in changes:
        change(scene)
    return scene


def of_bodies(**keys: Any) -> Change:
    """Other constants of the materials: one for all bodies, or one each."""
    def change(scene: Scene) -> None:
        for k, each in enumerate(scene["body"]):
            each["material"] |= {key: value[k] if isinstance(value, tuple) else value for key, value in keys.items()}
    return change


def stiffer(factor: float) -> Change:
    """The second body."""
    return lambda scene: scene["body"][1]["material"].update(young=factor * scene["body"][1]["material"]["young"])


def law(name: str, **keys: float) -> Change:
    """Of all contacts."""
    other = {"kind": "bonded", "friction": {"law": "none"}} if name == "bonded" else {"friction": {"law": name} | keys}
    return lambda scene: [each.update(other) for each in scene["contact"]]


def units(length: float = 1.0, stress: float = 1.0) -> Change:
    """Lengths and stresses are so many times larger."""
    def change(scene: Scene) -> None:
        for each in scene["body"]:
            for key in ("origin", "size"):
                each["mesh"][key] = [length * x for x in each["mesh"][key]]
            each["material"]["young"] *= stress
            for load in each["traction"]:
                load["value"] = [stress * q for q in load["value"]]
    return change


def elsewhere(far: float) -> Change:
    def change(scene: Scene) -> None:
        for each in scene["body"]:
            each["mesh"]["origin"] = [x + far for x in each["mesh"]["origin"]]
        for each in scene.get("rigid", []):
            each["point"] = [x + far for x in each["point"]]
    return change


def higher(by: float) -> Change:
    """Each body is moved away from the one on which it stands."""
    def change(scene: Scene) -> None:
        loose = "rigid" in scene
        for k, each in enumerate(scene["body"] if loose else scene["body"][:1]):
            each["mesh"]["origin"][1 + loose] += (k + 1) * by
    return change


def cells(*divisions: int) -> Change:
    """Of both bodies, of the second one fewer along each axis where its nodes do not match."""
    def change(scene: Scene) -> None:
        one, other = (each["mesh"] for each in scene["body"])
        fewer = one["divisions"] != other["divisions"]
        one["divisions"], other["divisions"] = list(divisions), [max(1, n - fewer) for n in divisions]
    return change


def meshes(first: int, second: int) -> Change:
    """Divisions across the contact."""
    def change(scene: Scene) -> None:
        for each, n in zip(scene["body"], (first, second), strict=True):
            each["mesh"]["divisions"] = [n, n, max(1, n // 4)]
    return change


def tall(height: float, shear: float) -> Change:
    """Loose boxes of this height, with this part of the shear."""
    def change(scene: Scene) -> None:
        for k, each in enumerate(scene["body"]):
            each["mesh"] |= {"origin": [0.0, 0.0, k * height], "size": [1.0, 1.0, height]}
        value = scene["body"][2]["traction"][0]["value"]
        value[:2] = [shear * q for q in value[:2]]
    return change


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

def attempt(world: MPI.Comm, changes: Overrides) -> Row:
    """Solve a variation of the scene. Collective.

    ``outcome`` is "certified" or the reason why not, ``energy`` the strain energy (J per metre of depth), ``distance``
    that of the contact forces from those of the coupled problem, where that is small enough.
    """
    start = time.perf_counter()
    row = dict.fromkeys(EXTREMES, np.nan) | {"n": 0, "m": 0, "iterations": 0, "n_A": 0}
    try:
        answer = ddmpi.solve(SCENE.read_text(encoding="utf-8"), world, changes)
        summary, assembly = answer.summary, answer.solved.assembly
        row |= {"outcome": "certified" if answer.certified else answer.reason, "n": summary["n"], "m": summary["m"],
                "iterations": summary["outer_iterations"], "n_A": summary["n_A"],
                "residual": max(residual for residual, _ in answer.solved.solution.certificate.worst().values()),
                "energy": sum(body["energy"] for body in summary["bodies"].values())}
        if not assembly.loose and world.allreduce(assembly.space.size) <= LARGEST_COUPLED:  # brute force
            row["distance"] = distance(answer)
    except DdmpiError as error:
        row["outcome"] = f"refused: {str(error).splitlines()[0].removeprefix('scene: ')}"
    return row | {"seconds": round(world.allreduce(time.perf_counter() - start, MPI.MAX), 2)}


def distance(answer: Answer) -> float:
    """Of the contact forces from those of the coupled problem, relatively; nan if brute force fails. Collective."""
    assembly = answer.solved.assembly
    try:
        exact = exact_forces(assembly)
    except NotConvergedError:
        return np.nan
    forces = everywhere(assembly, answer.solved.solution.outer.forces)
    return float(np.linalg.norm(forces - exact) / (np.linalg.norm(exact) or 1.0))


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


# Tables

def number(value: float, form: str = ".0e") -> str:
    return "–" if not np.isfinite(value) else "0" if value == 0 else format(value, form)


def extremes_table(rows: list[Row]) -> list[str]:
    done = [row for row in rows if row["outcome"] == "certified"]
    refused = sum(row["outcome"].startswith("refused") for row in rows)
    distances = [row["distance"] for row in done if np.isfinite(row["distance"])]
    body = []
    for row in rows:
        outcome = "yes" if row["outcome"] == "certified" else row["outcome"]
        cells = [row["m"], outcome, row["iterations"], row["n_A"], number(row["residual"]), number(row["distance"])]
        if not row["m"]:
            cells = ["–", outcome, "–", "–", "–", "–"]
        body.append([row["group"], row["case"], *cells, f"{row['seconds']:.1f}"])
    return ["## The extremes", "",
            f"{len(rows)} scenes: {len(done)} certified, {refused} refused, {len(rows) - len(done) - refused} not "
            "converged. Residual: the largest of the certificate. Distance: of the contact forces from those of the "
            f"coupled problem, relatively, where that was solved ({len(distances)} scenes, at most "
            f"{number(max(distances, default=np.nan))}).", "",
            *table(["what", "case", "m", "certified", "iterations", "n_A", "residual", "distance", "s"], body)]


def solids_table(rows: list[Row]) -> list[str]:
    at: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        at.setdefault((row["group"], row["case"]), {})[row["kind"]] = row
    said: list[str] = []

    def cell(row: Row) -> str:
        if row["outcome"] == "certified":
            return f"{row['iterations']} · {row['n_A']}"
        said.append(row["outcome"]) if row["outcome"] not in said else None
        return f"({said.index(row['outcome']) + 1})"

    def worst(some: dict[str, Row], key: str) -> str:
        found = [row[key] for row in some.values() if np.isfinite(row[key])]
        return number(max(found)) if found else "–"

    kinds = list(KINDS.values())
    body = [[group, case, *(cell(some[kind]) if kind in some else "–" for kind in kinds),
             *(worst(some, key) for key in ("residual", "violation", "differs"))]
            for (group, case), some in at.items()]
    done = [row for row in rows if row["outcome"] == "certified"]
    checked = [row["violation"] for row in done if np.isfinite(row["violation"])]
    return [f"{len(rows)} scenes: {len(done)} certified. Cells: iterations · n_A, or the number of the message below. "
            "Residual: the largest of the certificates. Violation: the largest of all laws of the result files, by "
            "another program's stiffness, relatively: of contact, friction, and the equilibrium of all nodes and "
            f"bodies ({len(checked)} scenes, at most {number(max(checked, default=np.nan))}). Differs: displacements "
            "from those of the scene in its own units and place, relatively.", "",
            *table(["what", "case", *kinds, "residual", "violation", "differs"], body),
            *(f"({k}) {text}\n" for k, text in enumerate(said, 1))]


# All of it

def extremes(world: MPI.Comm, folder: Path) -> list[str]:
    changes = cases()
    ledger = Ledger(world, folder / "extremes.csv", ("group", "case"), EXTREMES)
    return extremes_table(ledger.fill(changes, lambda *key: attempt(world, changes[key])))


def solids(world: MPI.Comm, folder: Path) -> list[str]:
    ledger, made = Ledger(world, folder / "solids.csv", ("group", "case", "kind"), SOLIDS), solid_cases()
    bases: dict[tuple, np.ndarray | None] = {}
    found: dict[tuple, Row] = {}

    def solve(group: str, case: str, which: tuple[bool, int]) -> Row:
        make, changes, factor = made[group, case]
        if factor and (make, which) not in bases:
            bases[make, which] = attempt_solid(make(*which), None, None)[1]
        return attempt_solid(changed(make(*which), changes), bases.get((make, which)), factor)[0]

    def measure(group: str, case: str, kind: str) -> Row:
        if (group, case, kind) not in found:  # each rank solves some kinds of a case alone
            own = {(group, case, KINDS[which]): solve(group, case, which)
                   for which in list(KINDS)[world.rank::world.size]}
            found.update(merged(world, own))
        return found[group, case, kind]

    return solids_table(ledger.fill([(*key, kind) for key in made for kind in KINDS.values()], measure))


TABLES = {"extremes": extremes, "solids": solids}
PAGES = {"extremes": ("robustness_table.md", "The default method at the extremes",
                      "Default method, tolerance 1e-8, variations of `configs/pinched_blocks.toml`. n_A: all "
                      "multiplications by A⁻¹ of both bodies. Seconds are of two ranks on two shared cores, mesh and "
                      "factorization included: an aside."),
         "solids": ("extremes_in_space.md", "The default method at the extremes in space",
                    "Default method, tolerance 1e-8. n_A: all multiplications by A⁻¹ of all bodies.")}
"""File, title and first words of the page of each table."""


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = arguments(__doc__, "extremes")
    parser.add_argument("--tables", nargs="+", default=list(TABLES), choices=TABLES, metavar="TABLE",
                        help="which of %(choices)s (default: all)")
    options = parser.parse_args()
    for name in options.tables:
        page, title, words = PAGES[name]
        lines = [f"# {title}", "", "Generated by `scripts/study extremes`; [robustness.md](../understand/robustness.md)"
                 f" discusses it. {words}", "", *TABLES[name](world, options.output)]
        if world.rank == 0:
            text = "\n".join(lines)
            publish(page, text, options.output, complete=True)
            print(text)


if __name__ == "__main__":
    main()
