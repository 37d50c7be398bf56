"""Random assemblies of solids, the same for the same seed.

The boxes of a scene are loose or clamped, offset, of unlike stiffness, on meshes that match or not, held together by
friction, bonds or nothing but chance.
"""

from __future__ import annotations

from itertools import pairwise

import numpy as np
from solid_scenes import HELD, NORMALS, box

Scene = dict
FAMILIES = ("tower", "row", "bench", "wall")


class Maker:
    """Collects the tables of a scene. Lengths are those of a box, about one."""

    def __init__(self, seed: int) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.order = int(rng.choice([1, 1, 2]))
        self.stress = float(10 ** rng.uniform(4, 6))
        self.contrast = 10 ** rng.uniform(0, 3) if rng.random() < 0.6 else 1.0
        self.matching = rng.random() < 0.3
        self.most = 3 if self.order == 2 else 4
        self.law = str(
            rng.choice(
                ["coulomb", "coulomb", "mixed", "tresca", "none"], p=[0.4, 0.25, 0.2, 0.1, 0.05]
            )
        )
        self.coefficient = float(10 ** rng.uniform(-1, np.log10(2.0)))
        self.steps = rng.random() < 0.35
        self.tables: dict[str, list[dict]] = {"body": [], "rigid": [], "contact": []}

    def body(self, origin, size, held: str | None = None, weight: bool = True) -> str:
        """Adds a box; held at one of its faces."""
        rng, name = self.rng, f"b{len(self.tables['body'])}"
        n = (2, 2, 2) if self.matching else rng.integers(1, self.most + 1, 3)
        young = 1e4 * self.stress * self.contrast ** rng.random()
        clamp = {"clamp": [{"on": held} | HELD]} if held else {}
        load = (
            {"volume_force": [0.0, 0.0, -float(self.stress * rng.uniform(0.05, 0.3))]}
            if weight
            else {}
        )
        self.tables["body"].append(
            box(
                name,
                origin,
                size,
                n,
                self.order,
                young,
                float(rng.uniform(0.0, 0.4)),
                traction=[],
                **clamp,
                **load,
            )
        )
        return name

    def load(self, name: str, on: str, normal: float, shear: float) -> None:
        """Pressure and shear of random direction, in units of `stress`, with a history in scenes of steps."""
        n, turn = np.array(NORMALS[on], float), self.rng.uniform(0, 2 * np.pi)
        first = np.roll(n, 1)
        along = np.cos(turn) * first + np.sin(turn) * np.cross(n, first)
        (body,) = (each for each in self.tables["body"] if each["name"] == name)
        body["traction"].append({"on": on, "value": (-normal * self.stress * n).tolist()})
        body["traction"].append(
            {"on": on, "value": (shear * self.stress * along).tolist()}
            | ({"history": "shear"} if self.steps else {})
        )

    def contact(
        self, first: str, second: str, on: str, other: str | None = None, bonds: bool = True
    ) -> None:
        law = (
            str(self.rng.choice(["coulomb", "tresca", "none", "bonded" if bonds else "coulomb"]))
            if self.law == "mixed"
            else self.law
        )
        laws = {
            "bonded": {"kind": "bonded"},
            "none": {},
            "coulomb": {"friction": {"law": "coulomb", "coefficient": self.coefficient}},
            "tresca": {
                "friction": {
                    "law": "tresca",
                    "slip_bound": float(self.stress * self.rng.uniform(0.05, 0.5)),
                }
            },
        }
        pairing = {"pairing": "mortar"} if self.rng.random() < 0.2 and other else {}
        self.tables["contact"].append(
            {
                "name": f"c{len(self.tables['contact'])}",
                "bodies": [first, second],
                "on": [on, *([other] if other else [])],
            }
            | laws[law]
            | pairing
        )

    def floor(self, at: float = 0.0) -> str:
        self.tables["rigid"].append(
            {"name": "floor", "shape": "plane", "point": [0.0, 0.0, at], "normal": [0.0, 0.0, 1.0]}
        )
        return "floor"

    def base(self, lower: str, size: tuple[float, float]) -> tuple[str, str | None]:
        """What stands below: a rigid floor, or a clamped slab; and its face."""
        if self.rng.random() < 0.5:
            return self.floor(), None
        return self.body((-0.5, -0.5, -0.5), (size[0] + 1.0, size[1] + 1.0, 0.5), "bottom"), "top"

    def scene(self, title: str) -> Scene:
        tables: dict = {"title": title} | {
            key: value for key, value in self.tables.items() if value
        }
        if self.steps:
            tables["history"] = {
                "shear": {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 0.0, 1.0, -0.5]}
            }
            tables["time"] = {"points": [1.0, 2.0, 3.0], "steps": 2}
        return tables


def random_scene(seed: int) -> Scene:
    """A scene as a dict with the keys of its TOML file; its title begins with its family."""
    make, family = Maker(seed), FAMILIES[seed % len(FAMILIES)]
    rng = make.rng

    def shift() -> float:
        return 0.0 if make.matching else float(rng.uniform(-0.3, 0.3))

    shear = float(rng.uniform(0.0, 0.3)) * (0.05 if make.law == "none" else 1.0)
    if family == "tower":
        below, face = make.base("", (1.0, 1.0))
        z, x, y = 0.0, 0.0, 0.0
        for _ in range(rng.integers(2, 5)):
            height = 0.5 if make.matching else float(rng.uniform(0.4, 1.0))
            name = make.body((x, y, z), (1.0, 1.0, height))
            make.contact(name, below, "bottom", face)
            below, face, z, x, y = name, "top", z + height, x + shift(), y + shift()
        make.load(name, "top", float(rng.uniform(0.2, 1.0)), shear)
    elif family == "row":
        count = int(rng.integers(2, 5))
        names = []
        for k in range(count):
            held = {0: "left", count - 1: None if rng.random() < 0.7 else "right"}.get(k)
            names.append(
                make.body(
                    (float(k), shift(), shift()), (1.0, 1.0, 1.0), held, weight=rng.random() < 0.3
                )
            )
        for a, b in pairwise(names):
            make.contact(a, b, "right", "left")
        if len(make.tables["body"][-1].get("clamp", [])) == 0:
            make.load(names[-1], "right", float(rng.uniform(0.5, 1.5)), shear)
        else:
            make.load(names[count // 2], "top", 0.3, shear)
    elif family == "bench":
        slab, face = make.base("", (2.0, 1.0))
        split = 1.0 if make.matching else float(rng.uniform(0.7, 1.3))
        legs = [
            make.body((0.0, 0.0, 0.0), (split, 1.0, 1.0)),
            make.body((split, 0.0, 0.0), (2.0 - split, 1.0, 1.0)),
        ]
        top = make.body((shift(), shift(), 1.0), (2.0, 1.0, 0.5))
        for leg in legs:
            make.contact(leg, slab, "bottom", face)
            make.contact(top, leg, "bottom", "top")
        make.contact(*legs, "right", "left")
        make.load(top, "top", float(rng.uniform(0.2, 1.0)), shear)
    else:
        floor = make.floor()
        lower = [make.body((k, 0.0, 0.0), (1.0, 1.0, 0.6)) for k in range(2)]
        upper = [
            make.body((0.5 * k + min(0.0, shift()), 0.0, 0.6), (1.0 - 0.5 * k, 1.0, 0.6))
            for k in range(1)
        ]
        upper.append(make.body((1.0, 0.0, 0.6), (1.0 if make.matching else 0.9, 1.0, 0.6)))
        for name in lower:
            make.contact(name, floor, "bottom")
        make.contact(lower[0], lower[1], "right", "left")
        make.contact(upper[0], lower[0], "bottom", "top")
        make.contact(upper[1], lower[1], "bottom", "top")
        for name in upper:
            make.load(name, "top", float(rng.uniform(0.2, 1.0)), shear / 2)
    return make.scene(f"{family} {seed}, {make.law}, order {make.order}")
