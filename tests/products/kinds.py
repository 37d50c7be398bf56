"""The kinds of scene of the matrix: their blocks, with areas, volumes and Hooke's law by a few lines of numpy.

Nothing here is the program's: a block is a rectangle or a box with sides that are unlike, off the origin, of materials
without equal constants, and what it does under one stress upwards follows from its compliances.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

LOW = {2: (0.75, 0.375), 3: (0.75, -0.3125, 0.375)}
"""The lowest corner of the first block (m). Binary fractions, so that middles are nodes to the last bit."""

SIZE = {2: (0.625, 0.8125), 3: (0.625, 0.4375, 0.8125)}
"""Its size (m)."""

STILL = {"turns": (0.0, -1.7, 0.6), "grows": (0.0, -0.35, -0.6)}
"""Factors of a history at the times 0, 1 and 2.3: one that changes its sign, and one that only grows."""


@dataclass(frozen=True)
class Stuff:
    """A material by the engineering constants of its axes 1, 2, 3, in the order of the scene's keys."""

    young: tuple[float, float, float]
    poisson: tuple[float, float, float]
    shear: tuple[float, float, float] | None = None
    expansion: tuple[float, float, float] = (1.3e-5, 1.3e-5, 1.3e-5)
    axes: np.ndarray | None = None

    @classmethod
    def isotropic(cls, young: float, poisson: float) -> Stuff:
        return cls((young,) * 3, (poisson,) * 3)

    def strain(self, stress: np.ndarray, warm: float) -> np.ndarray:
        """(3, 3) under a stress (3, 3) and a temperature, along x, y, z: Hooke's law along the axes, turned back."""
        R = np.eye(3) if self.axes is None else self.axes
        s = R.T @ stress @ R
        (E1, E2, E3), (n12, n13, n23) = self.young, self.poisson
        G12, G13, G23 = self.shear or (E1 / 2 / (1 + n12),) * 3
        along = [
            s[0, 0] / E1 - n12 * s[1, 1] / E1 - n13 * s[2, 2] / E1,
            s[1, 1] / E2 - n12 * s[0, 0] / E1 - n23 * s[2, 2] / E2,
            s[2, 2] / E3 - n13 * s[0, 0] / E1 - n23 * s[1, 1] / E2,
        ]
        e = np.diag(along + warm * np.array(self.expansion))
        for i, j, G in ((0, 1, G12), (0, 2, G13), (1, 2, G23)):
            e[i, j] = e[j, i] = s[i, j] / 2 / G
        return R @ e @ R.T


STEEL, BRASS = Stuff.isotropic(7.1e9, 0.31), Stuff.isotropic(2.3e9, 0.18)


@dataclass(frozen=True)
class Kind:
    """A kind of scene, with elements of one order, in one load step or in several with negative factors."""

    name: str
    order: int
    steps: bool

    def __str__(self) -> str:
        return f"{self.name}-{self.order}-{'steps' if self.steps else 'once'}"

    @property
    def d(self) -> int:
        return 3 if self.name == "space" else 2

    @property
    def axis(self) -> bool:
        return self.name == "axis"

    @property
    def thick(self) -> float:
        """What stresses in the plane are times: the thickness of a plate, or a unit of depth."""
        return 0.37 if self.name == "plate" else 1.0

    @property
    def low(self) -> np.ndarray:
        return np.array(LOW[self.d])

    @property
    def size(self) -> np.ndarray:
        return np.array(SIZE[self.d])

    @property
    def up(self) -> np.ndarray:
        return np.eye(self.d)[-1]

    @property
    def aside(self) -> np.ndarray:
        """Along x, which around an axis is the radius."""
        return np.eye(self.d)[0]

    def area(self, to: float | None = None) -> float:
        """Of the face that looks up, as far as x = `to` (m², in the plane m)."""
        begin, end = self.low[0], to or self.low[0] + self.size[0]
        if self.axis:
            return np.pi * (end**2 - begin**2)
        return (end - begin) * (self.size[1] if self.d == 3 else self.thick)

    def middle(self, height: float, to: float | None = None) -> np.ndarray:
        """The centre of a level face, as far as x = `to`."""
        at = self.low + 0.5 * self.size
        at[0] = 0.5 * (self.low[0] + (to or self.low[0] + self.size[0]))
        at[-1] = height
        return at

    def moment(self, at: np.ndarray, force: np.ndarray) -> np.ndarray | float:
        """About the origin; around an axis there is none."""
        return 0.0 if self.axis else np.cross(at, force)

    def state(
        self, stuff: Stuff, pressed: float, warm: float = 0.0
    ) -> tuple[np.ndarray, np.ndarray]:
        """Strains and stresses (3, 3) under one stress upwards; in plane strain what is across cannot strain."""

        def stress(across: float) -> np.ndarray:
            found = np.zeros((3, 3))
            found[2, 2] = across
            found[self.d - 1, self.d - 1] = pressed
            return found

        across = 0.0
        if self.name == "strain":
            none, one = (stuff.strain(stress(by), warm)[2, 2] for by in (0.0, 1.0))
            across = -none / (one - none)
        return stuff.strain(stress(across), warm), stress(across)

    def strains(self, stuff: Stuff, pressed: float, warm: float = 0.0) -> np.ndarray:
        """(d, d), those of `state` that displacements show."""
        return self.state(stuff, pressed, warm)[0][: self.d, : self.d]

    def stored(self, stuff: Stuff, pressed: float, warm: float = 0.0) -> float:
        """The energy per volume, ½ σ : (ε − ε_heat)."""
        stress = self.state(stuff, pressed, warm)[1]
        return 0.5 * float((stress * stuff.strain(stress, 0.0)).sum())

    def modulus(self, stuff: Stuff) -> float:
        """Stress upwards over strain upwards, without stress aside."""
        return 1.0 / self.strains(stuff, 1.0)[-1, -1]

    def confined(self, stuff: Stuff) -> float:
        """The same without strain aside: E (1−ν) / (1+ν) (1−2ν), in plane stress E / (1−ν²)."""
        E, n = stuff.young[0], stuff.poisson[0]
        if self.name in ("stress", "plate"):
            return E / (1 - n**2)
        return E * (1 - n) / (1 + n) / (1 - 2 * n)

    def field(
        self, strain: np.ndarray, shift: np.ndarray | float = 0.0, bottom: float | None = None
    ) -> Callable:
        """The displacement (nv, d) at points (nv, d) of a block that stands on the level `bottom`, on its corner."""
        fixed = self.low.copy()
        if bottom is not None:
            fixed[-1] = bottom
        if self.axis:
            fixed[0] = 0.0
        turn = np.diag(np.diag(strain))
        turn[:-1, -1] = 2.0 * strain[:-1, -1]  # lines that go up turn aside
        if self.d == 3:
            turn[1, 0] = 2.0 * strain[1, 0]
        return lambda points: (points - fixed) @ turn.T + shift

    # scenes

    def block(
        self, name: str = "block", stuff: Stuff = STEEL, bottom: float | None = None, **more: Any
    ) -> dict:
        """A block on the level `bottom`, with as many cells as do; `more` are its other keys."""
        low, size = self.low, self.size
        if bottom is not None:
            low[-1] = bottom
        size[-1] = more.pop("height", size[-1])
        cells = more.pop("cells", {2: (2, 2), 3: (2, 1, 1)}[self.d])
        material: dict[str, Any] = {"young": stuff.young[0], "poisson": stuff.poisson[0]}
        if stuff.shear:
            shear = list(stuff.shear) if self.d == 3 else stuff.shear[0]
            material = {"young": list(stuff.young), "poisson": list(stuff.poisson), "shear": shear}
        if "temperature" in more:
            same = len(set(stuff.expansion)) == 1
            material["expansion"] = stuff.expansion[0] if same else list(stuff.expansion)
        if self.name in ("stress", "plate"):
            material["plane"] = "stress"
        if self.name == "plate":
            material["thickness"] = self.thick
        mesh = {
            "shape": "box" if self.d == 3 else "rectangle",
            "origin": low.tolist(),
            "size": size.tolist(),
            "divisions": list(cells),
            "order": self.order,
        }
        return {"name": name, "mesh": mesh, "material": material | more.pop("more", {})} | more

    def guides(self) -> list[dict]:
        """Clamps of a block that stands on its bottom and is as wide as it wants, but does not move as a whole."""
        aside = [
            {"on": "left & bottom", "x": 0.0},
            {"on": "left & bottom & front", "y": 0.0},
        ]
        return [self.hold("bottom"), *aside[: 0 if self.axis else self.d - 1]]

    def walls(self) -> list[dict]:
        """Clamps of a block that strains upwards alone."""
        walls = [{"on": on, "x": 0.0} for on in ("left", "right")]
        return walls + [{"on": on, "y": 0.0} for on in ("front", "back")] * (self.d == 3)

    def hold(self, on: str, by: float | str = 0.0) -> dict:
        """A clamp along the axis that goes up."""
        return {"on": on, "xyz"[self.d - 1]: by}

    def floor(self, **more: Any) -> dict:
        """A rigid plane on which the first block stands."""
        return {
            "name": "floor",
            "shape": "plane",
            "point": self.low.tolist(),
            "normal": self.up.tolist(),
        } | more

    def scene(self, *bodies: dict, grows: bool = False, **more: Any) -> dict:
        """The scene of some bodies, in load steps that end with the loads that are given."""
        scene = {"body": list(bodies), "output": {"figures": False}} | more
        if self.axis:
            scene["axisymmetric"] = True
        if not self.steps:
            return scene
        factors = STILL["grows" if grows else "turns"]
        return in_steps(scene, factors[-1]) | {
            "history": {"way": {"times": [0.0, 1.0, 2.3], "factors": list(factors)}},
            "time": {"points": [1.0, 2.3], "steps": 2},
        }


def in_steps(scene: dict, last: float) -> dict:
    """The scene whose loads follow a history that ends with the factor `last`; they end as they are given."""

    def over(value: Any) -> Any:
        if isinstance(value, list | tuple):
            return [over(each) for each in value]
        if isinstance(value, str):
            return f"({value}) / ({last})"
        return value / last

    def following(table: dict, *keys: str) -> None:
        given = {key: np.atleast_1d(np.array(table.get(key, 0.0), dtype=object)) for key in keys}
        found = [key for key in keys if (given[key] != 0.0).any()]
        for key in found:
            table[key] = over(table[key])
        if found:
            table["history"] = "way"

    scene = copy.deepcopy(scene)
    for body in scene["body"]:
        for load in body.get("traction", []):
            following(load, "value", "pressure", "force", "moment")
        for clamp in body.get("clamp", []):
            if not isinstance(clamp, str):
                following(clamp, "x", "y", "z", "normal", "value")
        following(body.get("motion", {}), "shift")
        for key in ("volume_force", "temperature"):
            if key in body:
                body[key] = {"value": over(body[key]), "history": "way"}
    for partner in scene.get("rigid", []):
        following(partner, "displacement", "force", "moment")
    for contact in scene.get("contact", []):
        if "gap" in contact:
            contact["gap"] = {"value": over(contact["gap"]), "history": "way"}
        if "pretension" in contact:
            following(contact["pretension"], "force")
    return scene


def in_cycles(scene: dict) -> dict:
    """The scene whose histories go back to their turning point and on to its end, three times, and then to its end."""
    _, turn, end = scene["history"]["way"]["times"]
    back, again = end + turn, 2 * end
    return scene | {
        "history": {
            name: {
                "times": [0.0, turn, end, back, again],
                "factors": [*history["factors"], *history["factors"][1:]],
            }
            for name, history in scene["history"].items()
        },
        "time": scene["time"]
        | {
            "points": [turn, end, back, again],
            "steps": 2,
            "cycle": {"from": turn, "to": back, "repeat": 3},
        },
    }


def turned(degrees: float, about: Sequence[float] = (0.0, 0.0, 1.0)) -> np.ndarray:
    """(3, 3) by Rodrigues' formula."""
    K = np.cross(np.eye(3), np.array(about) / np.linalg.norm(about)).T
    t = np.deg2rad(degrees)
    return np.eye(3) + np.sin(t) * K.T + (1 - np.cos(t)) * K.T @ K.T
