"""Random assemblies, the same for the same seed: small scenes of all kinds, some of them without equilibrium.

scene = random_scene(7)             # a dict with the keys of a scene's TOML file
text = scenes.to_toml(scene)
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np

Scene = dict


class Maker:
    """Collects the tables of one scene. Lengths are in units of a block's height, turned by `angle` at the end.

    Parameters
    ----------
    N : divisions of a unit of length
    """

    def __init__(self, rng: np.random.Generator, N: int) -> None:
        self.rng, self.N = rng, N
        turned = rng.random() < 0.4
        self.angle = float(rng.uniform(0, 2 * np.pi)) if turned else 0.0
        self.quadrilaterals = turned or rng.random() < 0.5
        c, s = np.cos(self.angle), np.sin(self.angle)
        self.turn = np.array([[c, -s], [s, c]]) if turned else np.eye(2)
        self.tables: dict[str, list[dict]] = {"body": [], "rigid": [], "contact": []}
        self.law = str(rng.choice(["coulomb"] * 7 + ["tresca", "none"] + ["mixed"]))
        self.coefficient = float(rng.uniform(0.1, 1.0))
        self.stress = float(10 ** rng.uniform(5.5, 7.5))
        """The pressure of loads, in Pa; weights and bounds follow it."""
        self.contrast = float(10 ** rng.uniform(0, 3)) if rng.random() < 0.5 else 1.0
        self.random_contrast = rng.random() < 0.5

    def vector(self, x: float, y: float) -> list[float]:
        return [float(each) for each in self.turn @ np.array([x, y], float)]

    @property
    def aside(self) -> float:
        """Factor of loads along contacts: mostly zero where nothing but chance could hold them."""
        return 0.0 if self.law == "none" and self.rng.random() < 0.7 else 1.0

    def young(self) -> float:
        """Equal, alternating, or random between the limits."""
        share = self.rng.random() if self.random_contrast else len(self.tables["body"]) % 2
        return float(2e10 * self.contrast**share)

    def body(
        self,
        corners: list[tuple[float, float]],
        divisions: tuple[int, int],
        clamp: list | None = None,
        loads: dict[str, tuple[float, float]] | None = None,
        weight: tuple[float, float] = (0.0, 0.0),
    ) -> str:
        """Adds a body; loads by side and weight are in units of `stress`."""
        name = f"body{len(self.tables['body'])}"
        placed = [self.vector(*corner) for corner in corners]
        mesh = {
            "shape": "quadrilateral",
            "corners": placed,
            "divisions": [int(n) for n in divisions],
        }
        (x, y), (X, Y) = corners[0], corners[2]
        if not self.quadrilaterals and list(corners) == [(x, y), (X, y), (X, Y), (x, Y)]:
            mesh = {
                "shape": "rectangle",
                "origin": [float(x), float(y)],
                "size": [float(X - x), float(Y - y)],
                "divisions": [int(n) for n in divisions],
            }
        self.tables["body"].append(
            {
                "name": name,
                "mesh": mesh,
                "clamp": clamp or [],
                "material": {
                    "young": self.young(),
                    "poisson": round(float(self.rng.uniform(0.0, 0.4)), 3),
                },
                "traction": [
                    {"on": on, "value": self.vector(*(self.stress * q for q in load))}
                    for on, load in (loads or {}).items()
                ],
                "volume_force": self.vector(*(self.stress * q for q in weight)),
            }
        )
        return name

    def block(self, x: float, y: float, width: float, height: float = 1.0, **more) -> str:
        return self.body(
            [(x, y), (x + width, y), (x + width, y + height), (x, y + height)],
            (round(width * self.N), round(height * self.N)),
            **more,
        )

    def plane(
        self, x: float, y: float, nx: float, ny: float, moved: tuple[float, float] = (0.0, 0.0)
    ) -> str:
        name = f"plane{len(self.tables['rigid'])}"
        self.tables["rigid"].append(
            {
                "name": name,
                "shape": "plane",
                "point": self.vector(x, y),
                "normal": self.vector(nx, ny),
                "displacement": self.vector(*moved),
            }
        )
        return name

    def contact(
        self,
        first: str,
        second: str,
        on: list[str],
        bonded: bool = False,
        coefficient: float | None = None,
    ) -> None:
        law = (
            str(self.rng.choice(["coulomb", "coulomb", "tresca", "none"]))
            if self.law == "mixed"
            else self.law
        )
        table: dict = {
            "name": f"c{len(self.tables['contact'])}",
            "bodies": [first, second],
            "on": on,
            "kind": "bonded" if bonded else "unilateral",
        }
        if not bonded:
            F = self.coefficient if coefficient is None else coefficient
            table["friction"] = {
                "coulomb": {"law": "coulomb", "coefficient": F},
                "tresca": {"law": "tresca", "slip_bound": F * self.stress},
                "none": {"law": "none"},
            }[law]
        self.tables["contact"].append(table)

    def scene(self, title: str) -> Scene:
        return {
            "title": title,
            **{key: value for key, value in self.tables.items() if value},
            "method": {"tolerance": 1e-9},
        }


def _load(rng: np.random.Generator, F: float, most: float = 1.2) -> tuple[float, float]:
    """A pressure on top with a shear up to `most` times what friction takes."""
    return float(rng.uniform(-1, 1) * most * F), -1.0


def stack(make: Maker) -> None:
    """Loose blocks on a clamped one, shifted against each other, pressed and sheared."""
    rng, N = make.rng, make.N
    K, width = int(rng.integers(2, 6)), int(rng.integers(1, 4))
    shifts = np.r_[0, rng.integers(-1, 2, K - 1)] if rng.random() < 0.5 else np.zeros(K, int)
    x = np.cumsum(shifts) / N
    heavy = rng.random() < 0.3
    shear = _load(rng, min(make.coefficient, width / 2 / K), 1.2 * make.aside)
    held = "sides" if rng.random() < 0.15 else "bottom"
    names = []
    for k in range(K):
        top = k == K - 1
        clamp = ["left"] if held == "sides" else ["bottom"] if k == 0 else []
        weight = (float(rng.uniform(-0.1, 0.1)) * abs(shear[0]), -1.0) if heavy else (0.0, 0.0)
        loads = {"top": shear} if top else {}
        if held == "sides" and k == 0:
            loads["bottom"] = (0.0, float(rng.uniform(0.2, 1.0)))
        names.append(
            make.block(float(x[k]), float(k), float(width), clamp=clamp, loads=loads, weight=weight)
        )
    for a, b in zip(names[1:], names, strict=False):
        make.contact(a, b, ["bottom", "top"])


def wall(make: Maker) -> None:
    """Bricks of 2 × 1 in running bond with half bricks at the ends, on clamped bricks or a rigid floor."""
    rng = make.rng
    columns, rows = int(rng.integers(1, 4)), int(rng.integers(2, 5))
    joints, floor, partly = rng.random() < 0.5, rng.random() < 0.3, rng.random() < 0.2
    aside = make.aside
    weight = (
        (float(rng.uniform(-0.3, 0.3)) * make.coefficient * aside, -float(rng.uniform(0.1, 1)))
        if rng.random() < 0.5
        else (0.0, 0.0)
    )
    shear = _load(rng, min(make.coefficient, columns / rows / 1.5), 0.9 * aside)
    push = float(rng.uniform(0, 0.4)) * make.coefficient * aside if rng.random() < 0.4 else 0.0
    layers = []
    for row in range(rows):
        ends = (
            [0, *range(2, 2 * columns, 2), 2 * columns]
            if row % 2 == 0
            else [0, *range(1, 2 * columns, 2), 2 * columns]
        )
        layer = []
        for left, right in pairwise(ends):
            loads = (
                {"top": shear} if row == rows - 1 and not (partly and rng.random() < 0.5) else {}
            )
            if left == 0 and row == rows - 1 and push:
                loads["left"] = (push, 0.0)
            clamp = ["bottom"] if row == 0 and not floor else []
            layer.append(
                (
                    left,
                    right,
                    make.block(
                        float(left),
                        float(row),
                        float(right - left),
                        clamp=clamp,
                        loads=loads,
                        weight=weight,
                    ),
                )
            )
        layers.append(layer)
    if floor:
        plane = make.plane(float(columns), 0.0, 0.0, 1.0)
        for _, _, name in layers[0]:
            make.contact(name, plane, ["bottom"])
    for row, layer in enumerate(layers):
        if joints:
            for (_, _, a), (_, _, b) in pairwise(layer):
                make.contact(a, b, ["right", "left"])
        for left, right, name in layer if row else []:
            for l, r, below in layers[row - 1]:  # noqa: E741
                if min(r, right) > max(l, left):
                    make.contact(name, below, ["bottom", "top"])


def arch(make: Maker) -> None:
    """Voussoirs between rigid springings, under their weight and a load on one of them."""
    rng = make.rng
    n = int(rng.integers(3, 12))
    half = float(np.radians(rng.choice([45.0, 60.0, 75.0, 90.0])))
    radius, thickness = 4.0, float(rng.choice([0.5, 0.8, 1.0, 1.5]))
    across = max(2, round(thickness * make.N / 2))
    angles = np.pi / 2 + np.linspace(half, -half, n + 1)  # from the left to the right
    inner = [(radius * float(np.cos(a)), radius * float(np.sin(a))) for a in angles]
    outer = [
        ((radius + thickness) * float(np.cos(a)), (radius + thickness) * float(np.sin(a)))
        for a in angles
    ]
    along = max(1, round(radius * 2 * half / n * make.N / 3))
    loaded = int(rng.integers(n))
    names = []
    for k in range(n):
        loads = (
            {"top": (0.0, -float(rng.uniform(0, 1.0)))}
            if k == loaded and rng.random() < 0.7
            else {}
        )
        names.append(
            make.body(
                [inner[k], inner[k + 1], outer[k + 1], outer[k]],
                (along, across),
                loads=loads,
                weight=(float(rng.uniform(-0.02, 0.02)), -1.0),
            )
        )
    for a, b in pairwise(names):
        make.contact(a, b, ["right", "left"])
    for name, side, (x, y), angle, sign in (
        (names[0], "left", inner[0], angles[0], -1.0),
        (names[-1], "right", inner[-1], angles[-1], 1.0),
    ):
        springing = make.plane(x, y, -sign * float(np.sin(angle)), sign * float(np.cos(angle)))
        make.contact(name, springing, [side])
    if make.law in ("none", "mixed"):
        make.law = "coulomb"


def row(make: Maker) -> None:
    """Blocks squeezed between walls that hold them by friction against their weight."""
    rng = make.rng
    K = int(rng.integers(1, 6))
    closing = float(10 ** rng.uniform(-1, 1)) * K * make.stress / 2e10
    left = make.plane(0.0, 0.0, 1.0, 0.0, (closing, 0.0))
    pressed = rng.random() < 0.4
    weight = (
        -float(rng.uniform(0.05, 1.5))
        * min(make.coefficient, 1.0 if make.contrast == 1 else 0.5)
        / K
    )
    names = [
        make.block(
            float(k),
            0.0,
            1.0,
            weight=(0.0, weight),
            loads={"right": (-2.0, 0.0)} if pressed and k == K - 1 else {},
        )
        for k in range(K)
    ]
    rng.random()  # the further numbers stay what they were
    make.contact(names[0], left, ["left"])
    for a, b in pairwise(names):
        make.contact(a, b, ["right", "left"])
    make.contact(names[-1], make.plane(float(K), 0.0, -1.0, 0.0), ["right"])


def checkerboard(make: Maker) -> None:
    """Squares with cross points, bonded, with friction, or some of each; the lowest row clamped."""
    rng = make.rng
    columns, rows = int(rng.integers(2, 5)), int(rng.integers(2, 5))
    kind = rng.choice(["bonded", "contact", "both"])
    shear = _load(rng, make.coefficient if kind == "contact" else 1.0, 0.5)
    side = float(rng.uniform(0, 0.8))
    width = round(float(rng.choice([1.0, 1.5, 2.0])) * make.N) / make.N
    grid = {}
    for j in range(rows):
        for i in range(columns):
            loads = {"top": shear} if j == rows - 1 else {}
            if i == 0 and j:
                loads["left"] = (side, 0.0)
            if i == columns - 1 and j:
                loads["right"] = (-side, 0.0)
            grid[i, j] = make.block(
                i * width, float(j), width, clamp=["bottom"] if j == 0 else [], loads=loads
            )

    def bonded() -> bool:
        return bool(kind == "bonded" or (kind == "both" and rng.random() < 0.5))

    for (i, j), name in grid.items():
        if i + 1 < columns:
            make.contact(name, grid[i + 1, j], ["right", "left"], bonded())
        if j:
            make.contact(name, grid[i, j - 1], ["bottom", "top"], bonded())


def tower(make: Maker) -> None:
    """Blocks on each other, each shifted further to the same side, under their weight; some fall."""
    rng, N = make.rng, make.N
    K, width = int(rng.integers(2, 6)), int(rng.integers(1, 3))
    shift = int(rng.integers(0, N // 2 + 1)) / N
    weight = float(rng.uniform(-0.2, 0.2)) * make.coefficient * make.aside, -1.0
    names = [
        make.block(
            k * shift, float(k), float(width), weight=weight, clamp=["bottom"] if k == 0 else []
        )
        for k in range(K)
    ]
    for a, b in zip(names[1:], names, strict=False):
        make.contact(a, b, ["bottom", "top"])


def pushed(make: Maker) -> None:
    """A block on a rigid plane, level or inclined, pushed from the side; perhaps in a corner of two planes."""
    rng = make.rng
    width = int(rng.integers(1, 4))
    aside = make.aside
    slope = float(rng.uniform(-0.5, 0.5)) * aside if rng.random() < 0.5 else 0.0
    corner = rng.random() < 0.3
    F = make.coefficient
    push = float(rng.uniform(0, 1.3)) * min(F, width / 2) * width * aside
    weight = (-float(np.sin(slope)), -float(np.cos(slope)))  # seen from the plane
    loads = {"left": (push, 0.0)} if rng.random() < 0.8 else {"top": (0.5 * push / width, -0.5)}
    gap = float(rng.choice([0.0, 1e-6])) if rng.random() < 0.3 else 0.0
    block = make.block(0.0, 0.0, float(width), loads=loads, weight=weight)
    make.contact(block, make.plane(0.5, -gap, 0.0, 1.0), ["bottom"])
    if corner:
        make.contact(block, make.plane(float(width), 0.5, -1.0, 0.0), ["right"])


def lintel(make: Maker) -> None:
    """A block over two posts, overhanging or not, pressed eccentrically."""
    rng = make.rng
    post, span = 1, int(rng.integers(1, 4))
    over = int(rng.integers(0, 2))
    floor = rng.random() < 0.4
    names = [
        make.block(x, 0.0, float(post), clamp=[] if floor else ["bottom"], weight=(0.0, -0.5))
        for x in (0.0, float(post + span))
    ]
    if floor:
        plane = make.plane(0.0, 0.0, 0.0, 1.0)
        for name in names:
            make.contact(name, plane, ["bottom"])
    total = 2 * post + span
    lie = make.block(-float(over), 1.0, float(total + 2 * over), weight=(0.0, -0.5))
    for name in names:
        make.contact(lie, name, ["bottom", "top"])
    x = float(rng.integers(-over, total + over))
    top = make.block(
        x,
        2.0,
        1.0,
        loads={"top": _load(rng, make.coefficient, 1.1 * make.aside)},
        weight=(0.0, -0.5),
    )
    make.contact(top, lie, ["bottom", "top"])


FAMILIES = {
    each.__name__: each for each in (stack, wall, arch, row, checkerboard, tower, pushed, lintel)
}


def random_scene(seed: int) -> Scene:
    """The assembly of a seed. Families take turns."""
    rng = np.random.default_rng([13, seed])
    family = list(FAMILIES)[seed % len(FAMILIES)]
    make = Maker(rng, int(rng.integers(3, 6 if family in ("wall", "checkerboard") else 7)))
    FAMILIES[family](make)
    return make.scene(f"{family}, seed {seed}, N = {make.N}, {make.law}")
