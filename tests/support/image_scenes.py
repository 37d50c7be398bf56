"""Random scenes of bodies that touch themselves, of sectors and cells, and of skew supports, alike for the same seed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from slits import Slit, write

Scene = dict
FAMILIES = ("slit", "sector", "cell", "ramp")

LAWS = ("bonded", "guided", "none", "tresca", "coulomb", "coulomb", "coulomb")


class Maker:
    """Collects the tables of a scene. Lengths are about one."""

    def __init__(self, seed: int, folder: Path) -> None:
        self.rng = rng = np.random.default_rng(seed)
        self.folder = folder
        self.d = int(rng.choice([2, 2, 3]))
        self.order = int(rng.choice([1, 2]))
        self.stress = float(10 ** rng.uniform(4, 6))
        self.steps = rng.random() < 0.35
        self.tables: dict[str, list[dict]] = {"body": [], "rigid": [], "contact": []}

    def body(self, mesh: dict, **keys: Any) -> str:
        name = f"b{len(self.tables['body'])}"
        material = {
            "young": float(1e4 * self.stress * 10 ** self.rng.uniform(0, 1)),
            "poisson": float(self.rng.uniform(0.0, 0.4)),
        }
        self.tables["body"].append(
            {"name": name, "mesh": mesh | {"order": self.order}, "material": material} | keys
        )
        return name

    def block(self, origin: list[float], size: list[float], **keys: Any) -> str:
        """A rectangle, or a box."""
        n = self.rng.integers(2, 6 if self.d == 2 else 4, self.d).tolist()
        shape = "rectangle" if self.d == 2 else "box"
        return self.body({"shape": shape, "origin": origin, "size": size, "divisions": n}, **keys)

    def pull(self, normal: float, shear: float) -> list[float]:
        """A load on a top in units of `stress`: pressure, and shear of random direction."""
        turn = self.rng.uniform(0, 2 * np.pi)
        along = [np.cos(turn)] if self.d == 2 else [np.cos(turn), np.sin(turn)]
        return [*(float(self.stress * shear * each) for each in along), -normal * self.stress]

    def load(self, on: str, normal: float, shear: float) -> list[dict]:
        """Pressure, and shear that load steps turn back."""
        history = {"history": "shear"} if self.steps else {}
        return [
            {"on": on, "value": self.pull(normal, 0.0)},
            {"on": on, "value": self.pull(0.0, shear)} | history,
        ]

    def law(self, *without: str) -> dict[str, Any]:
        """Bonded, guided or with some friction, which may change or stand on a soft joint."""
        rng, name = self.rng, str(self.rng.choice([law for law in LAWS if law not in without]))
        soft = {"softness": float(rng.uniform(0.1, 3.0) * 1e-5 / self.stress)}
        if name in ("bonded", "guided"):
            return {"kind": name}
        coefficient: Any = float(rng.uniform(0.1, 1.2))
        if self.steps and rng.random() < 0.4:
            coefficient = {"value": coefficient, "history": "wear"}
        bound = float(self.stress * rng.uniform(0.05, 0.5))
        friction = {
            "none": {},
            "tresca": {"friction": {"law": "tresca", "slip_bound": bound}},
            "coulomb": {"friction": {"law": "coulomb", "coefficient": coefficient}},
        }[name]
        return friction | (soft if rng.random() < 0.25 else {})

    def contact(self, first: str, second: str, *on: str, **keys: Any) -> None:
        self.tables["contact"].append(
            {"name": f"c{len(self.tables['contact'])}", "bodies": [first, second], "on": [*on]}
            | keys
        )

    def floor(self) -> str:
        up = [0.0] * (self.d - 1) + [1.0]
        self.tables["rigid"].append(
            {"name": "floor", "shape": "plane", "point": [0.0] * self.d, "normal": up}
        )
        return "floor"

    def skew(self, near: list[float]) -> list[float]:
        """A direction of any length that is not far from another."""
        return (np.array(near) + self.rng.uniform(-0.4, 0.4, self.d)).tolist()

    def held(self, on: str, aside: str | None = None) -> list[Any]:
        """Clamps: of all components, or along skew directions, which hold the body as well."""
        if self.rng.random() < 0.4:
            return [on]
        axes = np.eye(self.d)[::-1]
        skew = [{"on": on, "along": self.skew(axis.tolist()), "value": 0.0} for axis in axes]
        if aside:
            skew[-1]["on"] = aside
            skew[0]["value"] = float(self.rng.choice([0.0, 1e-5]))
        return skew

    def scene(self, title: str) -> Scene:
        tables: dict = {"title": title}
        tables |= {key: value for key, value in self.tables.items() if value}
        if self.steps:
            tables["history"] = {
                "shear": {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 0.0, 1.0, -0.5]},
                "wear": {"times": [0.0, 1.0, 3.0], "factors": [1.0, 1.0, 0.5]},
            }
            tables["time"] = {"points": [1.0, 2.0, 3.0], "steps": 2}
        return tables


def slit(make: Maker) -> None:
    """A block with a slit, open or closed, whose sides match or not."""
    rng, flat = make.rng, make.d == 2
    cut = Slit(2) if flat else Slit(3, (8, 2, 2))
    cut = cut._replace(gap=float(rng.choice([0.0, 1e-5, 1e-4])))
    if flat:
        cut = cut._replace(aside=float(rng.choice([0.0, 0.03])))
    file = write(make.folder / "slit.msh", cut.welded())
    pushed = float(rng.uniform(-0.5, 1.0)), float(rng.uniform(0.0, 0.5))
    name = make.body(
        {"file": file}, clamp=make.held("bottom", "right"), traction=make.load("top", *pushed)
    )
    make.contact(name, name, "low", "up", **make.law())


def segment(make: Maker, start: float, end: float, pivot: np.ndarray) -> dict:
    """A part of a ring of straight sides about a pivot; its flanks are left and right, in space front and back."""
    angles = np.radians([start, end])
    ends = np.column_stack([np.cos(angles), np.sin(angles)])
    n = make.rng.integers(2, 5 if make.d == 2 else 4, make.d).tolist()
    plane = [*(r * ends[0] for r in (1.0, 2.0)), *(r * ends[1] for r in (2.0, 1.0))]
    plane = [(pivot + each).tolist() for each in plane]
    if make.d == 2:
        return {"shape": "quadrilateral", "corners": plane, "divisions": n}
    corners = [[*at, z] for z in (0.0, 0.8) for at in plane]
    return {"shape": "hexahedron", "corners": corners, "divisions": n}


def sector(make: Maker) -> None:
    """A sector of one or two parts; loose, or held at its hub; in space on a floor or a clamp."""
    rng, count = make.rng, int(make.rng.choice([3, 4, 6, 12]))
    turn = 360.0 / count
    pivot = rng.uniform(-1.0, 1.0, 2) if rng.random() < 0.5 else np.zeros(2)
    image: dict[str, Any] = {"turn": turn, "pivot": pivot.tolist()}
    spin = make.stress * rng.uniform(0.0, 0.5)
    force: list = [f"{spin} * ({axis} - ({at}))" for axis, at in zip("xy", pivot, strict=True)]
    names = {"start": "bottom", "end": "top", "outer": "right", "hub": "left"}
    if make.d == 3:
        image |= {"axis": [0.0, 0.0, 1.0], "pivot": [*pivot.tolist(), 0.0]}
        force.append(-make.stress * float(rng.uniform(0.0, 0.3)))
        names = {"start": "front", "end": "back", "outer": "right", "hub": "left"}
    half = turn * float(rng.uniform(0.3, 0.7)) if rng.random() < 0.5 else turn
    angles = [(0.0, half), (half, turn)][: 1 if half == turn else 2]
    holds = rng.choice(["all", "around", "none"])
    around = [f"-(y - ({pivot[1]}))", f"x - ({pivot[0]})", 0.0][: make.d]
    clamps = {
        "all": [names["hub"]],
        "around": [{"on": names["hub"], "along": around, "value": 0.0}],
        "none": [],
    }[str(holds)]
    parts = []
    for start, end in angles:
        mesh = segment(make, start, end, pivot)
        middle = np.radians(0.5 * (start + end))
        inward = -make.stress * float(rng.uniform(0.2, 1.0))
        value = [inward * np.cos(middle), inward * np.sin(middle), 0.0][: make.d]
        load = [{"on": names["outer"], "value": [float(each) for each in value]}]
        if rng.random() < 0.5:
            aside = float(inward * rng.uniform(0.0, 0.3))
            shear = [-aside * np.sin(middle), aside * np.cos(middle), 0.0][: make.d]
            history = {"history": "shear"} if make.steps else {}
            load.append({"on": names["outer"], "value": [float(each) for each in shear]} | history)
        parts.append(make.body(mesh, traction=load, clamp=clamps, volume_force=force))
    if make.d == 3 and rng.random() < 0.7:
        floor, law = make.floor(), make.law("bonded", "guided")
        for part in parts:
            make.contact(part, floor, "bottom", **law)
    if len(parts) == 2:
        make.contact(*parts, names["end"], names["start"], **make.law("guided"))
    make.contact(
        parts[-1], parts[0], names["end"], names["start"], image=image, **make.law("guided")
    )


def cell(make: Maker) -> None:
    """A layer of equal cells on a floor, a clamp or skew supports; of one body, two beside each other, or two layers."""
    rng = make.rng
    kind = str(rng.choice(["one", "beside", "above"]))
    deep = [1.0] if make.d == 3 else []
    length = 2.0 if kind == "beside" else 1.0
    shift = {"shift": [length, *[0.0] * (make.d - 1)]}
    origin = [[0.0] * make.d]
    if kind == "beside":
        origin.append([1.0, *[0.0] * (make.d - 1)])
    elif kind == "above":
        origin.append([0.0] * (make.d - 1) + [1.0])
    names = [make.block(each, [1.0, *deep, 1.0]) for each in origin]
    bodies = {body["name"]: body for body in make.tables["body"]}
    for name in names[1:] if kind == "above" else names:
        shear = float(rng.uniform(0.0, 0.4))
        bodies[name]["traction"] = make.load("top", float(rng.uniform(0.2, 1.0)), shear)
    low = names[:1] if kind == "above" else names
    base = str(rng.choice(["floor", "held"]))
    law = make.law("bonded", "guided")
    if base == "floor":
        make.floor()
    for name in low:
        if base == "floor":
            make.contact(name, "floor", "bottom", **law)
        else:
            bodies[name]["clamp"] = make.held("bottom")
    if kind == "beside":
        make.contact(*names, "right", "left", **make.law("guided"))
        make.contact(names[1], names[0], "right", "left", image=shift, **make.law("guided"))
        return
    if kind == "above":
        make.contact(names[1], names[0], "bottom", "top", **make.law("guided"))
    for name in names:
        make.contact(name, name, "right", "left", image=shift, **make.law("guided"))


def ramp(make: Maker) -> None:
    """Blocks that skew supports hold, on each other."""
    rng = make.rng
    deep = [1.0] if make.d == 3 else []
    lower = make.block([0.0] * make.d, [2.0, *deep, 1.0], clamp=make.held("bottom", "left"))
    start = [float(rng.uniform(0.0, 0.8)), *[0.0] * (make.d - 1)]
    start[-1] = 1.0
    aside = {"on": "right", "along": make.skew(np.eye(make.d)[0].tolist()), "value": 0.0}
    upper = make.block(
        start,
        [1.0, *deep, 1.0],
        traction=make.load("top", float(rng.uniform(0.2, 1.0)), float(rng.uniform(0.0, 0.4))),
        clamp=[aside] if rng.random() < 0.7 else [],
    )
    make.contact(upper, lower, "bottom", "top", **make.law())


def random_scene(seed: int, folder: Path) -> Scene:
    """A scene as a dict with the keys of its TOML file, whose mesh, if it has one, is written to the folder.

    Its title begins with its family.
    """
    make, family = Maker(seed, folder), FAMILIES[seed % len(FAMILIES)]
    {"slit": slit, "sector": sector, "cell": cell, "ramp": ramp}[family](make)
    laws = {
        contact.get("kind") or contact.get("friction", {"law": "none"})["law"]
        for contact in make.tables["contact"]
    }
    words = f"{family} {seed}, {' '.join(sorted(laws))}, {make.d}D, order {make.order}"
    return make.scene(words)
