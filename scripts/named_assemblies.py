"""Assemblies that the studies share, as dictionaries with the keys of a scene's TOML file.

    scene = stack(16, clamped=True)
    text = scenes.to_toml(scene)

N is the number of divisions of a unit of length. Blocks are steel and one unit high, pressed by `PRESSURE` from above.
"""

from __future__ import annotations

import math
from itertools import pairwise

Scene = dict

STEEL, STONE = {"young": 2.119e11, "poisson": 0.277}, {"young": 2.0e10, "poisson": 0.2}
PRESSURE = 6e7


class Maker:
    """Collects the tables of one scene; bodies are named in the order in which they come, contacts likewise."""

    def __init__(self, title: str, friction: float | None) -> None:
        self.scene: Scene = {"title": title, "rigid": [], "body": [], "contact": [], "method": {"tolerance": 1e-8}}
        self._law = {"kind": "bonded"} if friction is None else {
            "kind": "unilateral", "friction": {"law": "coulomb", "coefficient": friction}}

    def body(self, corners: list[tuple[float, float]], divisions: tuple[int, int], clamp: list[str] | None = None,
             loads: dict[str, tuple[float, float]] | None = None, weight: float = 0.0,
             material: dict[str, float] = STEEL) -> str:
        name = f"body{len(self.scene['body'])}"
        self.scene["body"].append({
            "name": name, "mesh": {"shape": "quadrilateral", "corners": [list(each) for each in corners],
                                   "divisions": list(divisions)},
            "material": material, "clamp": clamp or [],
            "traction": [{"on": on, "value": list(value)} for on, value in (loads or {}).items()],
            "volume_force": [0.0, -weight]})
        return name

    def block(self, N: int, x: float, y: float, width: float, **more) -> str:
        X, Y = x + width, y + 1.0
        return self.body([(x, y), (X, y), (X, Y), (x, Y)], (round(width * N), N), **more)

    def contact(self, first: str, second: str, *on: str) -> None:
        self.scene["contact"].append({"name": f"i{len(self.scene['contact'])}", "bodies": [first, second],
                                      "on": list(on)} | self._law)

    def on_top(self, upper: str, lower: str) -> None:
        self.contact(upper, lower, "bottom", "top")

    def beside(self, left: str, right: str) -> None:
        self.contact(left, right, "right", "left")

    def plane(self, x: float, y: float) -> str:
        """A rigid plane that looks up."""
        name = f"rigid{len(self.scene['rigid'])}"
        self.scene["rigid"].append({"name": name, "shape": "plane", "point": [x, y], "normal": [0.0, 1.0]})
        return name


def stack(K: int, clamped: bool, N: int = 8, width: float = 3.0, shear: float = 0.05) -> Scene:
    """K blocks on each other, Coulomb 0.3: all of them clamped on the left and pulled and pushed at the right, or the
    lowest alone clamped, at its bottom, and the highest sheared by `shear` of the pressure."""
    maker = Maker(f"{K} {'clamped' if clamped else 'loose'} blocks on each other", 0.3)
    for k in range(K):
        if clamped:
            loads = {"bottom": (0.0, PRESSURE / 1.5)} if k == 0 else {"right": (1e7 * (-1) ** k, 5e6)}
            if k == K - 1:
                loads = {"top": (0.0, -PRESSURE), "right": (2e7, 3e7)}
        else:
            loads = {"top": (shear * PRESSURE, -PRESSURE)} if k == K - 1 else {}
        clamp = ["left"] if clamped else ["bottom"] if k == 0 else []
        block = maker.block(N, 0.0, float(k), width, clamp=clamp, loads=loads)
        if k:
            maker.on_top(block, f"body{k - 1}")
    return maker.scene


def slabs(K: int, length: float, N: int = 3) -> Scene:
    """A loose stack of K slender slabs."""
    return stack(K, False, N, length, 0.02) | {"title": f"{K} slabs {length:g} : 1 on each other"}


def wall(rows: int, columns: int, N: int = 8) -> Scene:
    """A wall in running bond, Coulomb 0.5: bricks of two units, half ones at the ends of every other row."""
    maker, below = Maker(f"Wall of {rows} rows in running bond", 0.5), []
    for row in range(rows):
        joints = list(range(0, 2 * columns + 1, 2)) if row % 2 == 0 else [0, *range(1, 2 * columns, 2), 2 * columns]
        loads = {"top": (3e6, -2e7)} if row == rows - 1 else {}
        here = [(x, X, maker.block(N, float(x), float(row), float(X - x), clamp=[] if row else ["bottom"],
                                   loads=loads)) for x, X in pairwise(joints)]
        for k, (x, X, brick) in enumerate(here):
            for u, U, lower in below:
                if min(U, X) > max(u, x):
                    maker.on_top(brick, lower)
            if k + 1 < len(here):
                maker.beside(brick, here[k + 1][2])
        below = here
    return maker.scene


def arch(number: int, N: int = 8) -> Scene:
    """A half-circle of voussoirs between the radii 4 and 5 on two rigid springings, under its weight, Coulomb 0.6."""
    maker = Maker(f"Arch of {number} voussoirs", 0.6)
    left, right = maker.plane(-5.0, 0.0), maker.plane(4.0, 0.0)
    angles = [math.pi * (1 - k / number) for k in range(number + 1)]
    names = []
    for start, end in pairwise(angles):
        corners = [(r * math.cos(angle), r * math.sin(angle)) for r, angle in ((4, start), (4, end), (5, end),
                                                                                (5, start))]
        names.append(maker.body(corners, (round(4.5 * math.pi / number * N), N), weight=2e4, material=STONE))
    for one, other in pairwise(names):
        maker.beside(one, other)
    maker.contact(names[0], left, "left")
    maker.contact(names[-1], right, "right")
    return maker.scene


def checkerboard(side: int, bonded: bool, N: int = 8) -> Scene:
    """Squares, clamped on the left and pressed from above; bonded and pulled up, or Coulomb 0.3 and pressed from the
    right, too."""
    maker = Maker(f"{side * side} {'bonded' if bonded else 'loose'} squares", None if bonded else 0.3)
    at = {}
    for i in range(side):
        for j in range(side):
            loads = {"top": (0.0, -1e7)} if j == side - 1 else {}
            if i == side - 1:
                loads |= {"right": (0.0 if bonded else -5e7, 2e6)}
            at[i, j] = maker.block(N, float(i), float(j), 1.0, clamp=[] if i else ["left"], loads=loads)
    for i in range(side - 1):
        for j in range(side):
            maker.beside(at[i, j], at[i + 1, j])
    for i in range(side):
        for j in range(side - 1):
            maker.on_top(at[i, j + 1], at[i, j])
    return maker.scene
