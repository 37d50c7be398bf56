"""Verification problems of bodies that move far."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT

from ddmpi.run.answer import Answer
from problems import Curve, Order, Results, X, Y, problem
from problems.bodies import answer_of, block, body, contact, coulomb, courses, number

FRICTION, SOFT = 0.3, (1000.0, 0.3)
"""μ, and E and ν of all bodies but gears (Pa)."""

SPACING, PRESSED, WAY = 1.0 / 16, 0.004, 20.0
"""The sliding block's spacing of nodes and how deep it is pressed (m), and its way in spacings."""

PRESS = [(0.0, 0.0), (1.0, 1.0)]
GO = [(1.0, 0.0), (2.0, 1.0)]
"""Histories of what acts first, and then."""

EXACT = 1e-9


def far(
    bodies: list[dict],
    contacts: list[dict],
    steps: int,
    points: tuple[float, ...] = (1.0, 2.0),
    rigid: Iterable[dict] = (),
    **histories: list[tuple[float, float]],
) -> dict:
    """A scene of bodies that move far."""
    return {
        "body": bodies,
        "contact": contacts,
        "rigid": list(rigid),
        "history": courses(**histories),
        "time": {"motions": "far", "points": list(points), "steps": steps},
    }


def forces(summary: dict, after: float = 0.0) -> np.ndarray:
    """(k, 1 + d) the time and the force on the first body of the only contact at the steps after a time."""
    return np.array(
        [
            (step["time"], *each["force"])
            for step in summary["steps"]
            if step["time"] > after + 1e-9
            for each in step["contacts"].values()
        ]
    )


# A block slid along a longer one: T = μ N


def sliding(order: int, steps: int, fine: int = 1) -> dict:
    """A block of 1 m × 0.5 m, pressed on a longer one and slid by `WAY` of its spacings."""

    def part(
        name: str, x: float, y: float, size: tuple[float, float], divisions: list[int], clamp: str
    ) -> dict:
        return body(
            name,
            block(x, y, *size, tuple(fine * k // order for k in divisions), order),
            *SOFT,
            [clamp],
        )

    slider = part("slider", 0.0, 0.0, (1.0, 0.5), [16, 8], "top") | {
        "motion": [
            {"shift": [0.0, -PRESSED], "history": "press"},
            {"shift": [WAY * SPACING, 0.0], "history": "slide"},
        ]
    }
    return far(
        [slider, part("base", -1.0, -1.0, (5.0, 1.0), [67, 12], "bottom")],
        [contact("slider", "base", "bottom", "top", friction=coulomb(FRICTION))],
        steps,
        press=PRESS,
        slide=GO,
    )


@problem(
    "A block slid along a longer one", (1, 2, 4), "sixteenths of the block on its contact, × n"
)
def sliding_block(n: int, order: Order, folder: Path) -> Results:
    answer, once = (answer_of(sliding(number(order), steps, n)) for steps in (8, 1))
    found, end = forces(answer.summary, 1.1), forces(once.summary, 1.1)[-1, 1:]
    ratio = np.abs(found[:, 1] / found[:, 2])
    state = answer.contacts["slider-base"]
    closed = state.status != "open"
    x = state.interface.xy[closed, 0]
    rank = np.argsort(x)
    stresses = np.abs(
        state.shear.reshape(len(state.pressure), -1)[closed, 0] / state.pressure[closed]
    )[rank]
    return (
        {
            "T/N": (ratio[np.abs(ratio - FRICTION).argmax()], FRICTION, EXACT),
            "forces at the end, 8 steps and 1": (
                np.abs(found[-1, 1:] - end).max() / found[-1, 2],
                EXACT,
            ),
        },
        answer,
        Curve(
            x[rank],
            stresses,
            x[rank],
            np.full(len(x), FRICTION),
            X.label,
            "tangential over normal stress",
        ),
    )


# Both bodies turned together: nothing changes


def turned(order: int, fine: int, steps: int = 9) -> dict:
    """A ring, pressed on a block and rubbed, and then both of them turned by 90° about another point and shifted."""
    together = {"turn": 90.0, "pivot": [4.0, -3.0], "shift": [7.0, -2.0], "history": "turn"}
    ring = ring_of(
        "ring",
        (0.5, 1.0),
        (240 * fine, 12 * fine),
        order,
        clamp=["inner"],
        motion=[
            {"shift": [0.0, -0.02], "history": "press"},
            {"shift": [0.02, 0.0], "history": "rub"},
            together,
        ],
    )
    cells = 161 * fine // order, 24 * fine // order
    base = body("base", block(-2.0, -2.0, 4.0, 1.0, cells, order), *SOFT, ["bottom"])
    return far(
        [ring, base | {"motion": together}],
        [contact("ring", "base", "outer", "top", friction=coulomb(FRICTION))],
        steps,
        (1.0, 2.0, 3.0),
        press=PRESS,
        rub=GO,
        turn=[(2.0, 0.0), (3.0, 1.0)],
    )


def ring_of(
    name: str,
    radii: tuple[float, float],
    divisions: tuple[int, int],
    order: int,
    low: float = 0.0,
    **more: Any,
) -> dict:
    mesh = {
        "shape": "annulus",
        "center": [0.0, -low],
        "radii": list(radii),
        "angles": [0, 360],
        "divisions": [n // order for n in divisions],
        "order": order,
    }
    return body(name, mesh, *SOFT) | more


def turn_errors(summary: dict) -> tuple[float, float]:
    """By how much the force changes in the quarter turn, over its size; the dissipation, over that of rubbing."""
    found = forces(summary)
    before, end = found[np.isclose(found[:, 0], 2.0)][0, 1:], found[-1, 1:]
    back = np.array([end[1], -end[0]])  # turned back by 90°
    lost = np.array(
        [
            (step["time"], each["dissipated"])
            for step in summary["steps"]
            for each in step["contacts"].values()
        ]
    )
    turning = lost[:, 0] > 2.0 + 1e-9
    return (
        float(np.abs(back - before).max() / np.linalg.norm(before)),
        float(lost[turning, 1].sum() / lost[~turning, 1].sum()),
    )


@problem("Two bodies turned together", (1, 2, 3), "two-hundred-and-fortieths of the ring, × n")
def turned_pair(n: int, order: Order, folder: Path) -> Results:
    answer = answer_of(turned(number(order), n))
    change, lost = turn_errors(answer.summary)
    return (
        {"change of the force": (change, EXACT), "dissipation of the turn": (lost, EXACT)},
        answer,
        after_turn(answer, Y),
    )


def after_turn(answer: Answer, position: Any, near: Any = slice(None)) -> Curve:
    """The pressure of the only contact, which has no closed form."""
    (state,) = answer.contacts.values()
    at = position(state.interface.xy[near])
    rank = np.argsort(at)
    p = state.pressure[near][rank]
    return Curve(at[rank], p, at[rank], p, position.label, known="after the turn")


# Spur gears

PITCH, BASE, CENTRES = 18.0, 30.0 * np.cos(np.radians(20.0)), 60.0
"""The pitch of configs/drawn/spur_gears.toml (degrees), its base radius, and the distance of its shafts (mm)."""


def gear_theory() -> tuple[float, float]:
    """Largest stiffness of a pair of teeth by ISO 6336-1 (N/(mm µm)), without its factor for measured gears, and the
    loss of power over μ by the formula of ISO/TR 14179 (u = 1, ε₁ = ε₂)."""
    z, ra = 20, 33.0
    # The basic rack has a dedendum of 1.25 modules.
    stiff = 0.975 / (0.04723 + 0.15551 / z + 0.25791 / z)
    part = z / (2.0 * np.pi) * (np.sqrt((ra / BASE) ** 2 - 1.0) - np.tan(np.radians(20.0)))  # ε₁
    return stiff, 2.0 * np.pi / z * (1.0 - 2.0 * part + 2.0 * part**2)


def meshing(summary: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """At each step the angle of the driving gear (degrees), the stiffness (N/(mm µm)), and the loss of power: that of
    the driven shaft's moment, as both turn alike. The stiffness is by the mean of both moments."""
    load = 0.234464 - np.degrees(2.0 * 0.05 / 30.0)  # turned back beyond backlash
    t, force, moment = (
        np.array(each)
        for each in zip(
            *(
                (
                    step["time"],
                    step["contacts"]["mesh"]["force"][1],
                    step["contacts"]["mesh"]["moment"],
                )
                for step in summary["steps"]
            ),
            strict=True,
        )
    )
    driven = CENTRES * force - moment
    return (
        PITCH * (t / 40.0 - 0.5),
        (moment + driven) / -2.0 / BASE / (np.radians(load) * BASE * 1e3),
        1.0 - driven / moment,
    )


def alone(angle: np.ndarray) -> np.ndarray:
    """Where the tooth in the middle of the driving gear bears alone, away from where teeth come and go."""
    return (angle > -8.0) & (angle < -1.2)


@problem(
    "Teeth of spur gears in mesh", (1, 2), "twentieths of the pitch as steps, × n", orders=(2,)
)
def spur_gears(n: int, order: Order, folder: Path) -> Results:
    answer = answer_of(
        ROOT / "configs" / "drawn" / "spur_gears.toml",
        {"contact.mesh.friction.coefficient": 0.1, "time.steps": 20 * n, "output.animation": False},
    )
    angle, stiff, loss = meshing(answer.summary)
    exact, factor = gear_theory()
    single = alone(angle)
    return (
        {
            "stiffness of a pair": (stiff[single].max(), exact, 0.06),
            "loss of power": (loss.mean(), 0.1 * factor, 0.1),
        },
        answer,
        Curve(
            angle,
            loss,
            angle[single],
            0.2 * np.abs(np.radians(angle[single] + 4.4045)),
            "angle (degrees)",
            "loss of power",
        ),
    )


# A loose disc in a bore that turns

BORE = 30.0
"""Its turn (degrees)."""


def rolling(order: int, fine: int, steps: int = 10) -> dict:
    """A loose disc of 1 m that lies in a bore of 1.5 m by its weight; the bore turns by `BORE`."""
    disc = ring_of(
        "disc",
        (0.25, 1.0),
        (80 * fine, 7 * fine),
        order,
        0.49,
        volume_force={"value": [0.0, -2.7], "history": "weight"},
    )
    bore = ring_of(
        "bore",
        (1.5, 2.2),
        (116 * fine, 5 * fine),
        order,
        clamp=["outer"],
        motion={"turn": BORE, "history": "turn"},
    )
    return far(
        [disc, bore],
        [contact("disc", "bore", "outer", "inner", friction=coulomb(FRICTION), slave="disc")],
        steps,
        weight=PRESS,
        turn=GO,
    )


def rolled(answer: Answer) -> tuple[float, float, float]:
    """Of the disc: how far it has turned (degrees), N/W − 1 and T/W where they are largest."""
    found, steps = forces(answer.summary), answer.summary["steps"]
    weight = -answer.summary["bodies"]["disc"]["loads"]["volume_force"]["force"][1]
    places = answer.solved.steps.places
    turned = places[steps[-1]["time"]].freed["disc"][-1] - next(
        places[step["time"]].freed["disc"][-1] for step in steps if step["time"] >= 1.0
    )
    late = found[found[:, 0] > 1.0 - 1e-9]
    return (
        float(turned),
        float(np.abs(late[:, 2] / weight - 1.0).max()),
        float(np.abs(late[:, 1] / weight).max()),
    )


@problem("A loose disc that rolls in a bore", (1, 2, 4), "eightieths of the disc, × n")
def rolling_disc(n: int, order: Order, folder: Path) -> Results:
    answer = answer_of(rolling(number(order), n))
    turned, normal, tangential = rolled(answer)
    x, y = answer.contacts["disc-bore"].interface.xy.T
    return (
        {
            "N/W": (1.0 + normal, 1.0, EXACT),
            "T/W": (tangential, EXACT),
            "turn over that of the bore": (turned / BORE, 1.5, 0.03),
        },
        answer,
        after_turn(answer, X, (np.abs(x) < 0.4) & (y < -1.0)),
    )


# Carter's roller

ROLLER = """R = 1.0; r = 0.4; w = 40 * Pi / 180;
Point(1) = {0, 1, 0};
Point(2) = {-r*Sin(w), 1 - r*Cos(w), 0}; Point(3) = {r*Sin(w), 1 - r*Cos(w), 0};
Point(4) = {R*Sin(w), 1 - R*Cos(w), 0}; Point(5) = {-R*Sin(w), 1 - R*Cos(w), 0};
Point(6) = {0, 0, 0}; Point(7) = {0, 1 - r, 0};
Circle(1) = {2, 1, 7}; Circle(6) = {7, 1, 3}; Line(2) = {3, 4}; Circle(3) = {4, 1, 6}; Circle(4) = {6, 1, 5};
Line(5) = {5, 2}; Curve Loop(1) = {1, 6, 2, 3, 4, 5}; Plane Surface(1) = {1};
Physical Curve("inner") = {1, 6}; Physical Curve("outer") = {3, 4}; Physical Surface("roller") = {1};
"""
PLATE = """Point(1) = {-0.4, -1, 0}; Point(2) = {0.8, -1, 0}; Point(3) = {0.8, 0, 0}; Point(4) = {-0.4, 0, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Physical Curve("bottom") = {1}; Physical Curve("top") = {3}; Physical Surface("plate") = {1};
"""
"""A sector of a roller of 1 m, and a plate, for elements that are small along the contact alone."""

WIDTH = 0.035
"""Half the width of the contact (m)."""


def creep(
    share: float, folder: Path, nodes: int, steps: int | None = None
) -> tuple[float, float, float, Answer]:
    """A roller that is turned against a force Q of so much of μP: the creep over its last half-width, the largest
    pressure over Hertz's p₀, Carter's creep, and the answer; with so many nodes and steps on the half-width a."""
    steps = steps or nodes
    a, (young, poisson) = WIDTH, SOFT
    load, turn = np.pi * young / (2.0 * (1.0 - poisson**2)) * a**2 / 4.0, np.degrees(6.0 * a)

    def part(name: str, drawing: str, clamp: str) -> dict:
        (folder / f"{name}.geo").write_text(drawing, encoding="utf-8")
        mesh = {
            "geometry": str(folder / f"{name}.geo"),
            "size": 0.2,
            "contact_size": 2.0 * a / nodes,
            "order": 2,
        }
        return body(name, mesh, *SOFT, [clamp])

    roller = part("roller", ROLLER, "inner") | {
        "motion": [
            {"turn": -turn, "pivot": [0.0, 1.0], "history": "roll"},
            {"free": ["x", "y"], "force": [-share * FRICTION * load, -load], "history": "load"},
        ]
    }
    answer = answer_of(
        far(
            [roller, part("plate", PLATE, "bottom")],
            [
                contact(
                    "roller", "plate", "outer", "top", friction=coulomb(FRICTION), slave="roller"
                )
            ],
            6 * steps,
            load=PRESS,
            roll=GO,
        )
    )
    places, told = answer.solved.steps.places, answer.summary["steps"]
    before, end = (places[told[k]["time"]].freed["roller"][0] for k in (-1 - steps, -1))
    pressure = answer.contacts["roller-plate"].pressure.max() / (2.0 * load / (np.pi * a))
    return (
        1.0 - (end - before) / a,
        float(pressure),
        FRICTION * a * (1.0 - (1.0 - share) ** 0.5),
        answer,
    )


@problem("A roller that drives itself on", (4, 8), "nodes on the half-width", orders=(2,))
def carter(n: int, order: Order, folder: Path) -> Results:
    (still, *_), (driven, pressure, exact, answer) = (
        creep(share, folder, n) for share in (0.0, 0.5)
    )
    state = answer.contacts["roller-plate"]
    x = state.interface.xy[:, 0]
    x = x - (x * state.normal_force).sum() / state.normal_force.sum()
    rank, z = (
        np.argsort(x)[np.abs(np.sort(x)) < 1.5 * WIDTH],
        np.linspace(-1.5 * WIDTH, 1.5 * WIDTH, 200),
    )
    hertz = state.pressure.max() / pressure * np.sqrt(np.maximum(0.0, 1.0 - (z / WIDTH) ** 2))
    creeps, pressures = (0.03, 0.005) if n > 4 else (0.1, 0.02)
    return (
        {"creep": (driven - still, exact, creeps), "p₀": (pressure, 1.0, pressures)},
        answer,
        Curve(x[rank], state.pressure[rank], z, hertz, X.label, known="Hertz"),
    )


# In space: a block that slides and turns


def solid(way: dict, order: int, n: int) -> dict:
    """A block of 1 m × 1 m × 0.4 m that is pressed onto a plate and then goes its way."""

    def part(
        name: str, origin: list[float], size: list[float], divisions: list[int], clamp: str
    ) -> dict:
        return body(
            name,
            {
                "shape": "box",
                "origin": origin,
                "size": size,
                "divisions": divisions,
                "order": order,
            },
            *SOFT,
            [clamp],
        )

    pushed = part("block", [0.0, 0.0, 0.0], [1.0, 1.0, 0.4], [n, n, n // 2], "top") | {
        "motion": [{"shift": [0.0, 0.0, -PRESSED], "history": "press"}, way | {"history": "go"}]
    }
    plate = part(
        "plate", [-1.0, -1.0, -0.4], [3.0, 3.0, 0.4], [2 * n + 1, 2 * n + 1, n // 2], "bottom"
    )
    return far(
        [pushed, plate],
        [contact("block", "plate", "bottom", "top", friction=coulomb(FRICTION))],
        6,
        press=PRESS,
        go=GO,
    )


def torque(order: int, n: int) -> tuple[float, float, Answer]:
    """A block turned by 30°: the moment about its middle over that of μ N of each node at its distance; slid instead:
    how much |T|/N differs from μ at most; the answer of the turn."""
    answer = answer_of(
        solid({"turn": 30.0, "axis": [0.0, 0.0, 1.0], "pivot": [0.5, 0.5, 0.0]}, order, n)
    )
    state = answer.contacts["block-plate"]
    moment = state.moment[2] - np.cross([0.5, 0.5, 0.0], state.force)[2]
    arms = np.linalg.norm(state.interface.geometry.at[0][:, :2] - 0.5, axis=1)
    slid = answer_of(solid({"shift": [0.6, 0.3, 0.0]}, order, n)).summary
    _, x, y, z = forces(slid, 1.2).T
    ratio = float(-moment / (FRICTION * (arms * state.normal_force).sum()))
    return ratio, float(np.abs(np.hypot(x, y) / z - FRICTION).max()), answer
