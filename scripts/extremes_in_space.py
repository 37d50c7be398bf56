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
from problems.bodies import FLOOR, QUARTER, coulomb, tresca
from problems.revolved import half_ball
from result_check import violations
from reused import places
from scenes import to_toml
from solid_scenes import HELD, box, two_boxes

from ddmpi.errors import DdmpiError, NotConvergedError
from ddmpi.results.tables import read_results
from ddmpi.run.run import run
from ddmpi.scene.keys import override
from ddmpi.scene.reader import read_scene

SOLIDS = ("outcome", "iterations", "n_A", "residual", "violation", "differs")
Scene = dict[str, Any]
Changes = dict[str, Any]
"""By keys, in which * is any name or number: a value, or a function of what stands there."""

DRAWN = tempfile.TemporaryDirectory()
"""Of the ball."""


def later(function: Callable[..., Scene]) -> Callable[..., Callable[[bool, int], Scene]]:
    """Decorator: the arguments after `pairs` and `order` are given first."""
    return lambda *more: lambda pairs, order: function(pairs, order, *more)


def fewer(divisions: tuple[int, ...], pairs: bool) -> list[int]:
    """Of the second of two boxes, if their nodes do not match."""
    return [n if pairs else max(1, n - 1) for n in divisions]


# Scenes


def clamped(pairs: bool, order: int) -> Scene:
    """Two boxes that are clamped at one end."""
    N = {1: 4, 2: 3}[order]
    return two_boxes(N, None if pairs else N - 1, order)


@later
def of_cells(pairs: bool, order: int, cells: tuple[int, int, int]) -> Scene:
    """The same boxes with other cells."""
    return changed(
        clamped(pairs, order),
        {"body.0.mesh.divisions": [*cells], "body.1.mesh.divisions": fewer(cells, pairs)},
    )


def loose(pairs: bool, order: int) -> Scene:
    """Three boxes on each other and on a rigid plane, supported by friction alone."""
    names, divisions = ("low", "middle", "top"), ((3, 3, 2), (3, 3, 2) if pairs else (2, 4, 2))
    bodies = [
        box(name, (0, 0, k), (1, 1, 1), divisions[k % 2], order, traction=[])
        for k, name in enumerate(names)
    ]
    bodies[2]["traction"] = [{"on": "top", "value": [5e3, 1.5e3, -1e5]}]
    friction = {"friction": coulomb(0.5)}
    contacts = [
        {"name": f"{name}-{other}", "bodies": [name, other], "on": ["bottom", "top"]} | friction
        for other, name in pairwise(names)
    ]
    return {
        "body": bodies,
        "rigid": [FLOOR],
        "contact": [
            {"name": "low-floor", "bodies": ["low", "floor"], "on": ["bottom"]} | friction,
            *contacts,
        ],
    }


@later
def pressed(pairs: bool, order: int, size: tuple, divisions: tuple) -> Scene:
    """Two boxes alike on each other, of which the upper one is moved down by 1e-4 of its height, and along x."""
    move = {"on": "top", "x": 1e-5 * size[2], "y": 0.0, "z": -1e-4 * size[2]}
    return {
        "body": [
            box("upper", (0, 0, size[2]), size, divisions, order, clamp=[move], traction=[]),
            box(
                "lower",
                (0, 0, 0),
                size,
                fewer(divisions, pairs),
                order,
                clamp=[{"on": "bottom"} | HELD],
                traction=[],
            ),
        ],
        "contact": [
            {
                "name": "upper-lower",
                "bodies": ["upper", "lower"],
                "on": ["bottom", "top"],
                "friction": coulomb(0.3),
            }
        ],
    }


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
    one = {
        "name": "ball",
        "mesh": mesh,
        "material": {"young": 1.0, "poisson": 0.3},
        "clamp": [*QUARTER, {"on": "top", "z": -approach}],
    }
    if not modulus:
        return {
            "body": [one],
            "rigid": [FLOOR],
            "contact": [{"bodies": ["ball", "floor"], "on": ["contact"]}],
        }
    base = box(
        "floor",
        (0, 0, -1),
        (1, 1, 1),
        (8, 8, 8),
        order,
        modulus,
        clamp=[{"on": "bottom"} | HELD, {"on": "front", "y": 0.0}, {"on": "left", "x": 0.0}],
    )
    return {
        "body": [one, base],
        "contact": [{"bodies": ["ball", "floor"], "on": ["contact", "top"]}],
    }


# What is changed


def changed(scene: Scene, changes: Changes) -> Scene:
    scene = copy.deepcopy(scene)
    for pattern, value in changes.items():
        found = places(scene, pattern) or ({} if callable(value) else {pattern: None})
        for key, old in found.items():
            override(scene, key, value(old) if callable(value) else value)
    return scene


def times(factor: Any) -> Callable[[Any], Any]:
    return lambda value: np.multiply(value, factor).tolist()


def plus(term: Any) -> Callable[[Any], Any]:
    return lambda value: np.add(value, term).tolist()


def stiffer(factor: float) -> Changes:
    """The second body."""
    return {"body.1.material.young": times(factor)}


def law(friction: dict) -> Changes:
    """Of all contacts."""
    return {"contact.*.friction": friction}


def poisson(upper: float, lower: float) -> Changes:
    return {"body.0.material.poisson": upper, "body.1.material.poisson": lower}


def units(length: float = 1.0, stress: float = 1.0) -> Changes:
    """Lengths and stresses are so many times larger."""
    return {
        "body.*.mesh.origin": times(length),
        "body.*.mesh.size": times(length),
        "body.*.material.young": times(stress),
        "body.*.traction.*.value": times(stress),
    }


def tall(height: float, shear: float) -> Changes:
    """Loose boxes of this height, with this part of the shear."""
    return {f"body.{k}.mesh.origin": [0.0, 0.0, k * height] for k in range(3)} | {
        "body.*.mesh.size": [1.0, 1.0, height],
        "body.2.traction.0.value": times([shear, shear, 1.0]),
    }


def solid_cases() -> dict[tuple[str, str], tuple[Callable[..., Scene], Changes, float | None]]:
    """The table of extremes in space, by (group, case): what makes the scene, what is changed, and how many times
    larger displacements should be than without the change, if that is known."""
    boxes, slender, sizes, balls, stack = (
        "two boxes, clamped",
        "flat and slender bodies",
        "meshes and sizes",
        "ball, R = 1 m",
        "three boxes, loose",
    )
    bonded = {"contact.0.kind": "bonded", "contact.0.friction": {"law": "none"}}
    bent = {"body.1.traction": [], "body.0.traction": [{"on": "right", "value": [0.0, -3e8, 4e8]}]}

    def unchanged(group: str, make: Callable[..., Scene]) -> list[tuple]:
        """What only scales or moves a scene."""
        return [
            *((group, f"unit of length {1 / c:g} m", make, units(c), c) for c in (1e-9, 1e9)),
            *(
                (group, f"unit of force {1 / c:g} N", make, units(stress=c), 1.0)
                for c in (1e-9, 1e9)
            ),
            *(
                (
                    group,
                    f"{c:g} m from the origin",
                    make,
                    {"body.*.mesh.origin": plus(c), "rigid.*.point": plus(c)},
                    1.0,
                )
                for c in (1e3, 1e6)
            ),
        ]

    made: list[tuple] = [
        (boxes, "as they are", clamped),
        *((boxes, f"E₁/E₂ = {1 / c:g}", clamped, stiffer(c)) for c in (1e-6, 1e-3, 1e3, 1e6)),
        *(
            (boxes, f"𝓕 = {F:g}", clamped, law(coulomb(F)))
            for F in (0.0, 1e-6, 0.05, 1.0, 3.0, 10.0)
        ),
        *((boxes, f"Tresca, g = {g:g} Pa", clamped, law(tresca(g))) for g in (0.0, 1e3, 1e6, 1e20)),
        *(
            (boxes, f"bonded, E₁/E₂ = {1 / c:g}", clamped, bonded | stiffer(c))
            for c in (1e-6, 1.0, 1e6)
        ),
        *(
            (boxes, f"Poisson's ratios {a:g} and {b:g}", clamped, poisson(a, b))
            for a, b in (
                (0.0, 0.0),
                (0.49, 0.49),
                (0.499, 0.499),
                (0.49999, 0.49999),
                (0.0, 0.4999),
                (-0.9, 0.4),
            )
        ),
        *unchanged(boxes, clamped),
        *(
            (boxes, f"drawn {g:g} m apart", clamped, {"body.0.mesh.origin": plus([0.0, g, 0.0])})
            for g in (1e-9, -1e-9)
        ),
        (
            boxes,
            "upper one 0.02 m above, bent down to touch at its edge",
            clamped,
            {"body.0.mesh.origin": plus([0.0, 0.02, 0.0])} | bent,
        ),
        *(
            (boxes, f"{' × '.join(map(str, n))} cells", of_cells(n))
            for n in ((1, 1, 1), (60, 1, 1), (1, 60, 1), (1, 1, 60))
        ),
        *(
            (slender, f"pressed flat, 1 : {1 / h:g}", pressed((1.0, 1.0, h), (6, 6, 2)))
            for h in (1e-2, 1e-3, 1e-4)
        ),
        *(
            (slender, f"needles end to end, 1 : {n:g}", pressed((1 / n, 1 / n, 1.0), (3, 3, 30)))
            for n in (10, 100, 1000)
        ),
        *((slender, f"needles side by side, 1 : {n:g}", side_by_side(n)) for n in (10, 100, 1000)),
        *(
            (
                sizes,
                f"{a} : {b} cells across the contact",
                pressed((1.0, 1.0, 1.0), (4, 4, 1)),
                {f"body.{k}.mesh.divisions": [n, n, max(1, n // 4)] for k, n in enumerate((a, b))},
            )
            for a, b in ((1, 12), (12, 1))
        ),
        *(
            (sizes, f"a cube of {part:g} m on one of 1 m", small_on_large(part))
            for part in (0.1, 1e-2, 1e-3, 1e-4)
        ),
        *((balls, f"on a plane, approach {a:g} m", ball(a)) for a in (7.5e-3, 1e-4, 1e-9)),
        *((balls, f"on a box, E₁/E₂ = {1 / c:g}", ball(7.5e-3, c)) for c in (1e-6, 1.0, 1e6)),
        (stack, "as they are", loose),
        *((stack, f"middle one softer by {1 / c:g}", loose, stiffer(c)) for c in (1e-3, 1e3, 1e6)),
        *((stack, f"𝓕 = {F:g}", loose, law(coulomb(F))) for F in (0.0, 0.05, 0.053, 10.0)),
        *((stack, f"Tresca, g = {g:g} Pa", loose, law(tresca(g))) for g in (1e3, 1e4, 1e20)),
        *unchanged(stack, loose),
        *(
            (
                stack,
                f"drawn {g:g} m apart",
                loose,
                {f"body.{k}.mesh.origin": plus([0.0, 0.0, (k + 1) * g]) for k in range(3)},
            )
            for g in (1e-9, 1e-3)
        ),
        *(
            (stack, f"heights of {h:g} m", loose, tall(h, min(1.0, 1.0 / h)))
            for h in (1e-3, 1e-2, 100.0, 1000.0)
        ),
        (stack, "heights of 100 m, so that they tip over", loose, tall(100.0, 1.0)),
        (stack, "no loads", loose, {"body.*.traction": []}),
    ]
    return {
        (group, case): (make, *rest, *({}, None)[len(rest) :]) for group, case, make, *rest in made
    }


# Runs


def attempt_solid(
    scene: Scene, base: np.ndarray | None, factor: float | None
) -> tuple[Row, np.ndarray | None]:
    """Solve a scene of solids on this rank and check what is written by another program's stiffness.

    ``violation`` is the largest of all laws, ``differs`` the distance of displacements from `factor` times `base`.
    Returns the row and the displacements.
    """
    row = dict.fromkeys(SOLIDS, np.nan) | {"outcome": "certified", "iterations": 0, "n_A": 0}
    with tempfile.TemporaryDirectory() as scratch:
        folder = Path(scratch) / "results"
        try:
            run(MPI.COMM_SELF, read_scene("scene", to_toml(scene)), "scene", str(folder), False)
        except NotConvergedError as error:
            row["outcome"] = str(error).splitlines()[0]
        except DdmpiError as error:
            return row | {
                "outcome": f"refused: {str(error).splitlines()[0].removeprefix('scene: ')}"
            }, None
        results = read_results(folder)
        u, summary = results.displacement(), results.summary
        row |= {"iterations": summary["outer_iterations"], "n_A": summary["n_A"]}
        if row["outcome"] == "certified":
            row["residual"] = max(summary["certificate"].values())
            if all("origin" in body["mesh"] for body in scene["body"]):
                row["violation"] = max(violations(scene, folder).values())
            if base is not None and factor:
                row["differs"] = float(np.abs(u / factor - base).max() / np.abs(base).max())
        return row, u
