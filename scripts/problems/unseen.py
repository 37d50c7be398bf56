"""Problems on which nothing of the error estimate was chosen, each on coarse meshes and on one for reference.

A scene asks its meshes of `Coarse`, with n cells of equal size across one metre, or of `Fine`, which grades them
towards the places where the stress has no limit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from true_errors import clustered, grid

from problems.bodies import body, contact, coulomb, draw, held

Ends = Sequence[Sequence[float]]
"""By axis the coordinates where a rectangle or box begins and ends, and between them of places without limit."""

SLOPE = 0.15
"""By how much the cells of a reference mesh grow with the distance from a place without limit."""


class Coarse(NamedTuple):
    """Meshes of n cells across one metre."""

    folder: Path
    n: int
    order: int

    def block(self, name: str, ends: Ends) -> dict:
        low, high = (np.array([each[k] for each in ends], float) for k in (0, -1))
        return {
            "shape": "rectangle" if len(ends) == 2 else "box",
            "origin": low.tolist(),
            "size": (high - low).tolist(),
            "divisions": [round(self.n * size) for size in high - low],
            "order": self.order,
        }

    def figure(
        self,
        name: str,
        corners: Mapping[str, tuple[float, float]],
        lines: Mapping[str, str],
        at: str,
    ) -> dict:
        size = f"{1 / (self.n * self.order)}"  # `draw` takes twice as much for quadratic elements
        return draw(
            self.folder / f"{name}{self.n}_{self.order}.msh", corners, lines, size, self.order
        )


class Fine(NamedTuple):
    """Meshes for reference, of order 2, with n cells between two `Ends`, or `least` metres at a corner."""

    folder: Path
    n: int
    least: float
    order: int = 2

    def block(self, name: str, ends: Ends) -> dict:
        power = 3.0 if len(ends) == 2 else 1.8
        return grid(
            self.folder / f"{name}_fine.msh", [clustered(each, self.n, power) for each in ends]
        )

    def figure(
        self,
        name: str,
        corners: Mapping[str, tuple[float, float]],
        lines: Mapping[str, str],
        at: str,
    ) -> dict:
        x, y = corners[at]
        size = f"Min(0.02, {self.least} + {SLOPE} * Sqrt((x - {x})^2 + (y - {y})^2))"
        return draw(self.folder / f"{name}_fine.msh", corners, lines, size, 2)


Meshes = Coarse | Fine


def punch(of: Meshes) -> dict:
    """A stiff punch with sharp edges on a soft block, pressed and pushed."""
    return {
        "body": [
            body(
                "punch",
                of.block("punch", ((-0.5, 0.5), (0.0, 0.5))),
                2e11,
                0.3,
                traction={"top": (1e5, -1e6)},
            ),
            body(
                "block",
                of.block("block", ((-1.5, -0.5, 0.5, 1.5), (-1.0, 0.0))),
                2e9,
                0.3,
                ["bottom"],
            ),
        ],
        "contact": [contact("punch", "block", "bottom", "top", friction=coulomb(0.3))],
    }


def bridge(of: Meshes) -> dict:
    """A loose beam on two loose posts on a floor."""
    posts = [
        body(name, of.block(name, ((x, x + 0.5), (0.0, 1.0))), 2e11, 0.3)
        for name, x in (("left", 0.0), ("right", 2.5))
    ]
    floor = body(
        "floor", of.block("floor", ((0.0, 0.5, 2.5, 3.0), (-0.5, 0.0))), 2e11, 0.3, ["bottom"]
    )
    beam = body(
        "beam",
        of.block("beam", ((0.0, 0.5, 2.5, 3.0), (1.0, 1.5))),
        1e11,
        0.2,
        traction={"top": (1e5, -1e6)},
    )
    return {
        "body": [*posts, floor, beam],
        "contact": [
            contact(*pair, *on, friction=coulomb(0.4))
            for post in ("left", "right")
            for pair, on in (
                ((post, "floor"), ("bottom", "top")),
                (("beam", post), ("bottom", "top")),
            )
        ],
    }


def cantilever(of: Meshes) -> dict:
    """A beam that is clamped at one end and bent at the other."""
    mesh = of.block("beam", ((0.0, 4.0), (0.0, 1.0)))
    return {"body": [body("beam", mesh, 2e11, 0.3, ["left"], {"right": (0.0, 1e6)})]}


def bracket(of: Meshes) -> dict:
    """An angle with a sharp inner corner, whose leg is bent."""
    corners = {"a": (0, 0), "b": (2, 0), "c": (2, 1), "d": (1, 1), "e": (1, 2), "f": (0, 2)}
    lines = {
        "bottom": "a b",
        "end": "b c",
        "over": "c d",
        "beside": "d e",
        "top": "e f",
        "left": "f a",
    }
    mesh = of.figure("bracket", corners, lines, "d")
    return {"body": [body("bracket", mesh, 2e11, 0.3, held(top="xy"), {"end": (0.0, 1e6)})]}


def hole(of: Meshes) -> dict:
    """A quarter of a plate with a hole under tension."""
    corners = {"o": (0, 0), "a": (0.5, 0), "b": (2, 0), "c": (2, 2), "d": (0, 2), "e": (0, 0.5)}
    lines = {"low": "a b", "end": "b c", "top": "c d", "side": "d e", "hole": "e o a"}
    mesh = of.figure("hole", corners, lines, "e")
    return {"body": [body("plate", mesh, 2e11, 0.3, held(low="y", side="x"), {"end": (1e6, 0.0)})]}


def shaft(of: Meshes) -> dict:
    """A stepped shaft around the axis, pulled."""
    corners = {"a": (0, 0), "b": (1, 0), "c": (1, 1), "d": (0.5, 1), "e": (0.5, 2), "f": (0, 2)}
    lines = {"foot": "a b", "rim": "b c", "step": "c d", "neck": "d e", "top": "e f", "axis": "f a"}
    mesh = of.figure("shaft", corners, lines, "d")
    return {
        "axisymmetric": True,
        "body": [body("shaft", mesh, 2e11, 0.3, held(foot="y"), {"top": (0.0, 1e6)})],
    }


def stamp(of: Meshes) -> dict:
    """A stiff cylinder with a sharp edge on a soft one, around the axis."""
    return {
        "axisymmetric": True,
        "body": [
            body(
                "stamp",
                of.block("stamp", ((0.0, 0.5), (0.0, 0.5))),
                2e11,
                0.3,
                traction={"top": (0.0, -1e6)},
            ),
            body("base", of.block("base", ((0.0, 0.5, 1.5), (-1.0, 0.0))), 2e9, 0.3, ["bottom"]),
        ],
        "contact": [contact("stamp", "base", "bottom", "top", friction=coulomb(0.3))],
    }


def pedestal(of: Meshes) -> dict:
    """A cube on a wider plate of its material, pressed and pushed, in space."""
    plate = of.block("plate", ((0.0, 0.5, 1.5, 2.0), (0.0, 0.5, 1.5, 2.0), (0.0, 0.5)))
    cube = of.block("cube", ((0.5, 1.5), (0.5, 1.5), (0.5, 1.5)))
    return {
        "body": [
            body("plate", plate, 2e11, 0.3, ["bottom"]),
            body("cube", cube, 2e11, 0.3, traction={"top": (2e5, 0.0, -1e6)}),
        ],
        "contact": [contact("cube", "plate", "bottom", "top", friction=coulomb(0.4))],
    }


def arm(of: Meshes) -> dict:
    """A bar that is clamped at one end and bent and twisted at the other, in space."""
    mesh = of.block("arm", ((0.0, 3.0), (0.0, 1.0), (0.0, 1.0)))
    load = [{"on": "right", "value": [0.0, 0.0, "1e6 * y"]}]
    return {"body": [body("arm", mesh, 2e11, 0.3, ["left"]) | {"traction": load}]}


class Unseen(NamedTuple):
    """A problem, its words, the meshes to try and how fine that for reference is."""

    scene: Callable[[Meshes], dict]
    title: str
    n: tuple[int, ...]
    fine: int = 32
    least: float = 1e-4
    turned: bool = True  # whether it has cells that can be cut the other way


UNSEEN = {
    each.scene.__name__: each
    for each in (
        Unseen(punch, "A punch on a block", (4, 8)),
        Unseen(bridge, "A bridge of loose blocks", (4, 8), 24),
        Unseen(cantilever, "A bent cantilever", (4, 8)),
        Unseen(bracket, "An angle with a sharp corner", (4, 8), turned=False),
        Unseen(hole, "A plate with a hole", (4, 8), least=5e-3, turned=False),
        Unseen(shaft, "A stepped shaft", (4, 8), turned=False),
        Unseen(stamp, "A stamp, around the axis", (4, 8)),
        Unseen(pedestal, "A cube on a plate", (2, 4), 8),
        Unseen(arm, "A bar, bent and twisted", (2, 4), 10),
    )
}
