"""Verification problems of what loads and supports bodies beyond stresses and clamps along x and y: fits that change,
foundations, pushed and turned partners, bolts, heat, inclined planes, and orthotropic materials."""

from __future__ import annotations

from pathlib import Path

import msgspec
import numpy as np
import scipy.sparse as sparse
from by_skfem import stiffness_of
from scipy.sparse.linalg import spsolve

from ddmpi.mesh.build import build_mesh
from ddmpi.run.answer import Answer
from ddmpi.scene.bodies import BodySpec, Material
from problems import ANGLE, AROUND, Order, Results, X, Y, along, mean_pressure, off, problem
from problems.bodies import (
    annulus,
    between,
    block,
    body,
    contact,
    coulomb,
    courses,
    held,
    plane,
    solved,
)
from problems.forms import clamped_fit, confined, plane_strain, shear

STEEL = 2.1e11, 0.3
PLY = {
    "young": [1.4e11, 1.0e10, 2.0e10],
    "poisson": [0.3, 0.25, 0.4],
    "shear": 5.0e9,
    "angle": 30.0,
}


@problem("A ram on two bars")
def ram(n: int, order: Order, folder: Path) -> Results:
    young, force, heights, lift, names = 1e9, 3e6, np.array([1.0, 0.999]), 0.2, ("one", "two")
    stiffness, lower = young / heights, heights[0] - heights
    down = (force + stiffness @ lower) / stiffness.sum()
    answer = solved(
        [
            body(
                name,
                block(2.0 * k, 0, 1.0, heights[k].item(), ((3 + k) * n, 2 * n), order),
                young,
                0.0,
                held(left="x", bottom="y"),
            )
            for k, name in enumerate(names)
        ],
        [contact(name, "ram", "top") for name in names],
        [plane("ram", (0.0, 1.0 + lift), (0.0, -1.0), force=[0.0, -force])],
        1e-12,
    )
    place, borne = (
        answer.summary["rigid"]["ram"],
        dict(zip(names, stiffness * (down - lower), strict=True)),
    )
    return (
        {
            "displacement (m)": (place["displacement"][1], -lift - down, 1e-10),
            "balance of the ram (N/m)": (place["force"][1], force, 1e-10),
        }
        | {
            f"force on {name} (N/m)": (
                answer.summary["contacts"][f"{name}-ram"]["normal_force"],
                value,
                1e-8,
            )
            for name, value in borne.items()
        },
        answer,
        along(answer.contacts["one-ram"], borne["one"], X),
    )


@problem("A cantilever under a remote moment", orders=(2,))
def remote_moment(n: int, order: Order, folder: Path) -> Results:
    young, length, moment = 1e9, 10.0, 1e3
    answer = solved(
        [body("beam", block(0, 0, length, 1.0, (10 * n, n), order), young, 0.0, ["left"])],
        [contact("beam", "head", "right", kind="bonded")],
        [plane("head", (length, 0.0), (-1.0, 0.0), pivot=[length + 100.0, 50.0], moment=moment)],
        1e-12,
    )
    head, turn = answer.summary["rigid"]["head"], moment * length / (young / 12)
    at_clamp = answer.summary["bodies"]["beam"]["reactions"]["left"]
    return (
        {
            "turn (rad)": (head["turn"], turn, 1e-8),
            "deflection (m)": (head["displacement"][1] - turn * 100.0, turn * length / 2, 1e-6),
            "moment of the face about the pivot (N·m/m)": (-head["moment"], moment, 1e-9),
            "force of the face, over M/L": (np.abs(head["force"]).max() * length / moment, 1e-9),
            "moment at the clamp (N·m/m)": (-at_clamp["moment"], moment, 1e-8),
        },
        answer,
        along(answer.contacts["beam-head"], lambda y: 12.0 * moment * (y - 0.5), Y),
    )


@problem("A bolted joint")
def bolted_joint(n: int, order: Order, folder: Path) -> Results:
    return bolt(n, order)


def bolt(n: int, order: Order, **elements: str) -> Results:
    """A bolt around an axis that holds a tube under a head."""
    steel, aluminium = 2.1e5, 7e4  # MPa

    def piece(name: str, inner: float, low: float, outer: float, high: float, across: int) -> dict:
        mesh = block(
            inner, low, outer - inner, high - low, (across * n, (high - low) * n // 10), order
        )
        young = aluminium if name == "tube" else steel
        return body(name, mesh | elements, young, 0.0, held(bottom="y") if low == 0.0 else [])

    shank, tube = steel * np.pi * 100.0 / 100.0, aluminium * np.pi * (400.0 - 121.0) / 100.0
    pieces = [
        piece("lower", 0.0, 0, 10.0, 50, 3),
        piece("upper", 0.0, 50, 10.0, 100, 4),
        piece("tube", 11.0, 0, 20.0, 100, 2),
    ]
    values, answer = tightened(pieces, plane("head", (0.0, 100.0), (0.0, -1.0)), shank, tube)
    return (
        values,
        answer,
        along(
            answer.contacts["cut"],
            -5.0 * LOAD / np.pi / 100.0,
            AROUND._replace(label="r (mm)"),
            "pressure (MPa)",
        ),
    )


FORCE, LOAD = 20e3, 10e3
"""To which a bolt is tightened, and which then pulls at its head (N)."""


def tightened(
    pieces: list[dict], head: dict, shank: float, tube: float
) -> tuple[dict[str, tuple], Answer]:
    """A bolt of two pieces, "lower" and "upper", that holds a "tube" under a head, with their stiffness (N/mm), is
    tightened, pulled by a load, and by five."""
    up = [-each for each in head["normal"]]
    pretension = {"force": FORCE, "along": up, "history": "tighten"}
    cut = contact(
        "lower", "upper", "top", "bottom", name="cut", kind="bonded", pretension=pretension
    )
    answer = solved(
        pieces,
        [cut, contact("upper", "head", "top", kind="bonded"), contact("tube", "head", "top")],
        [head | {"force": [LOAD * each for each in up], "history": "work"}],
        1e-12,
        axisymmetric=len(up) == 2,
        time={"points": [1.0, 2.0, 3.0], "steps": 1},
        history=courses(
            tighten=[(0.0, 0.0), (1.0, 1.0)], work=[(1.0, 0.0), (2.0, 1.0), (3.0, 5.0)]
        ),
    )
    steps = [step["contacts"]["cut"]["pretension"] for step in answer.summary["steps"]]
    exact = [FORCE, FORCE + LOAD * shank / (shank + tube), 5.0 * LOAD]
    whens = "tightened", "under 10 kN", "under 50 kN"
    return {
        f"force {when} (N)": (step["force"], value, 1e-8)
        for when, step, value in zip(whens, steps, exact, strict=True)
    } | {
        f"offset {when} (mm)": (step["offset"], FORCE / shank + FORCE / tube, 1e-8)
        for when, step in zip(whens[::2], steps[::2], strict=True)
    }, answer


@problem("A block on springs")
def mat(n: int, order: Order, folder: Path) -> Results:
    material, p, height, values = (1e9, 0.3), 1e6, 1.0, {}
    for stiffness in (1e3, 1e6, 1e9):
        made = body(
            "block",
            block(0, 0, 2, height, (4 * n, 3 * n), order),
            *material,
            [],
            {"top": (0.0, -p)},
        )
        answer = solved(
            [made | {"foundation": [{"on": "bottom", "normal": stiffness}]}],
            [contact("block", "west", "left"), contact("block", "east", "right")],
            [plane("west", (0.0, 0.0), (1.0, 0.0)), plane("east", (2.0, 0.0), (-1.0, 0.0))],
        )
        fields = answer.bodies["block"]
        low, high = (
            -fields.displacement[np.isclose(fields.points[:, 1], y), 1] for y in (0.0, height)
        )
        values |= {
            f"below, k = {stiffness:g} (m)": (low.mean(), p / stiffness, 1e-7),
            f"above less below, k = {stiffness:g} (m)": (
                high.mean() - low.mean(),
                p * height / confined(*material),
                1e-7,
            ),
            f"worst node below, k = {stiffness:g}": (np.ptp(low) * stiffness / p, 1e-7),
        }
    return (
        values,
        answer,
        along(answer.contacts["block-east"], p * 0.3 / 0.7, Y, "pressure of a wall (Pa)"),
    )


@problem("A block on a soft joint", orders=(1,))
def soft_joint(n: int, order: Order, folder: Path) -> Results:
    material, load = {"young": 1e9, "poisson": 0.3}, (2e5, -1e6)
    made = body(
        "block",
        between([(1.5, 0), (3, 0), (3, 1), (1.5, 1)], (9 * n, 4 * n), order),
        *material.values(),
        held(left="x"),
        {"right": load},
    )
    spec = msgspec.convert(made, BodySpec)
    mesh = build_mesh(spec)
    bottom = np.unique(mesh.groups["bottom"])
    bottom = bottom[np.argsort(mesh.points[bottom, 0])]
    length = np.full(len(bottom), 1.5 / (9 * n))
    length[[0, -1]] /= 2.0
    K, f = stiffness_of(mesh, Material(**material)).tocsc(), np.zeros(mesh.points.shape)
    np.add.at(f, mesh.groups["right"], 0.5 / (4 * n) * np.array(load))
    free = np.setdiff1d(np.arange(f.size), 2 * np.unique(mesh.groups["left"]))
    values = {}
    for name, pressure, closure in (
        ("one stiffness", [0.0, 1e9], [0.0, 1e-1]),
        ("a table", [0.0, 5e5, 2e6, 1e9], [0.0, 2e-3, 4e-3, 1e-1]),
    ):
        u, down = np.zeros(f.size), 2 * bottom + 1
        u[down] = -1e-3
        for _ in range(
            40
        ):  # springs as stiff as the law is at their closures w, and what they bear there
            w, slope = -u[down], np.diff(pressure) / np.diff(closure)
            stiff = slope[np.searchsorted(closure[1:-1], w)] * (w > 0.0)
            pressed, springs, borne = (
                np.interp(w, closure, pressure),
                np.zeros(f.size),
                f.ravel().copy(),
            )
            springs[down], borne[down] = (
                length * stiff,
                borne[down] + length * (pressed - stiff * w),
            )
            u[free] = spsolve((K + sparse.diags(springs))[free][:, free], borne[free])
        table = {"pressure": pressure, "closure": closure}
        joint = contact("block", "floor", "bottom", softness=1e-10 if len(pressure) < 3 else table)
        answer = solved([made], [joint], [plane("floor", (0, 0), (0, 1))], 1e-12)
        state = answer.contacts["block-floor"]
        state_order = np.argsort(state.interface.xy[:, 0])
        values |= {
            f"worst pressure, {name}": (off(state.pressure[state_order], pressed), 1e-8),
            f"worst displacement, {name}": (
                off(answer.bodies["block"].displacement, u.reshape(-1, 2)),
                1e-8,
            ),
            f"worst closure less the law's, {name}": (
                np.abs(
                    np.interp(state.pressure, pressure, closure) + np.minimum(state.gap, 0.0)
                ).max()
                / w.max(),
                1e-8,
            ),
        }
    return values, answer, along(state, lambda x: np.interp(x, mesh.points[bottom, 0], pressed), X)


@problem("A fit that loosens under a torque", (24, 48, 96), "sides around")
def loosened_fit(n: int, order: Order, folder: Path) -> Results:
    a, b, c, fit, steel, mu, whole = 20.0, 40.0, 60.0, 0.02, (2.1e5, 0.3), 0.3, (0.0, 360.0)
    p = clamped_fit(a, b, c, fit, *steel)
    limit = 2 * np.pi * b**2 * mu * p
    angle = float(limit * (1 / a**2 - 1 / c**2) / (4 * np.pi * shear(*steel)))
    turned = {"x": f"-{angle!r} * y", "y": f"{angle!r} * x", "history": "turn"}
    answer = solved(
        [
            body("shaft", annulus((a, b), (n, n // 4), order, folder, whole), *steel, ["inner"]),
            body(
                "hub",
                annulus((b, c), (5 * n // 4, n // 4), order, folder, whole),
                *steel,
                held(outer=turned),
            ),
        ],
        [
            contact(
                "shaft",
                "hub",
                "outer",
                "inner",
                friction=coulomb(mu),
                gap={"value": -fit, "history": "tighten"},
            )
        ],
        history=courses(
            tighten=[(0.0, 0.0), (1.0, 1.0), (2.0, 1.0), (3.0, 0.5)], turn=[(1.0, 0.0), (2.0, 0.8)]
        ),
        time={"points": [1.0, 2.0, 3.0], "steps": 2},
    )
    moments = {
        step["time"]: step["contacts"]["shaft-hub"]["moment"] for step in answer.summary["steps"]
    }
    near = {1: 5e-2, 2: 3e-3}[order]
    return (
        {
            "torque turned (N mm/mm)": (moments[2.0], 0.8 * limit, near),
            "torque loosened (N mm/mm)": (moments[3.0], 0.5 * limit, near),
            "residual of energies": (answer.summary["energy"]["residual"], 1e-9),
        },
        answer,
        along(answer.contacts["shaft-hub"], p / 2, ANGLE, "pressure (MPa)"),
    )


@problem("Free and constrained expansion")
def expansion(n: int, order: Order, folder: Path) -> Results:
    poisson, alpha, warm = STEEL[1], 1.2e-5, 80.0

    def pair(sides: list[dict], top: list[dict]) -> list[dict]:
        return [
            body("upper", block(0, 1, 2, 1, (3 * n, 2 * n), order), *STEEL, sides + top),
            body(
                "lower",
                block(0, 0, 2, 1, (4 * n, 2 * n), order),
                *STEEL,
                sides + held(bottom="y"),
                expansion=alpha,
            )
            | {"temperature": warm},
        ]

    weight = {"volume_force": [0.0, -1.0]}  # holds the upper block down, and is nothing beside heat
    upper, lower = pair(held(left="x"), [])
    free = solved([upper | weight, lower], [contact("upper", "lower", "bottom", "top")]).bodies[
        "lower"
    ]
    answer = solved(
        pair(held(left="x", right="x"), held(top="y")), [contact("upper", "lower", "bottom", "top")]
    )
    exact = (1 + poisson) / (1 - poisson) * alpha * warm * confined(*STEEL) / 2
    state = answer.contacts["upper-lower"]
    return (
        {
            "free: worst displacement": (
                off(free.displacement, (1 + poisson) * alpha * warm * free.points),
                1e-7,
            ),
            "constrained: worst pressure": (off(state.pressure, exact), 1e-7),
        },
        answer,
        along(state, exact, X),
    )


@problem("A shrink fit by heat", (24, 48, 96), "sides around")
def heated_shaft(n: int, order: Order, folder: Path) -> Results:
    (E, nu), a, c, fit, whole = plane_strain(*STEEL), 0.6, 1.5, 1.3 * 1.25e-5 * 8.0, (0.0, 360.0)
    exact = (
        fit
        * E
        / ((c**2 - 1) * (1 - nu**2) / (1 + nu + (1 - nu) * c**2) + (1 + a**2) / (1 - a**2) - nu)
    )
    found = []
    for material, heat, gap in (
        ({"expansion": 1.25e-5}, {"temperature": 8.0}, {}),
        ({}, {}, {"gap": -fit}),
    ):
        shaft = (
            body("shaft", annulus((a, 1.0), (n, n // 8), order, folder, whole), *STEEL, **material)
            | heat
        )
        ring = body("ring", annulus((1.0, c), (n, n // 8), order, folder, whole), *STEEL, ["outer"])
        found.append(
            solved(
                [shaft, ring],
                [contact("shaft", "ring", "outer", "inner", friction=coulomb(0.2), **gap)],
                tolerance=1e-10,
            )
        )
    heated, large = (answer.contacts["shaft-ring"] for answer in found)
    return (
        {
            "mean pressure (Pa)": (mean_pressure(heated), exact, 0.02 if order == 1 else 2e-3),
            "worst node, heated less too large": (
                np.abs(heated.pressure / large.pressure - 1).max(),
                1e-7,
            ),
        },
        found[0],
        along(heated, exact, ANGLE),
    )


@problem("A sector on inclined planes of symmetry")
def sector(n: int, order: Order, folder: Path) -> Results:
    angle = np.radians(33.0)
    turn, found = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]]), []
    for to in (np.eye(2), turn):

        def part(
            name: str,
            low: float,
            high: float,
            divisions: tuple[int, int],
            loads: dict,
            to: np.ndarray = to,
            **more: dict,
        ) -> dict:
            corners = np.array([(0, low), (2, low), (2, high), (0, high)]) @ to.T
            return body(
                name,
                between(corners, divisions, order),
                *STEEL,
                held(left={"normal": 0.0}, **more),
                {on: (to @ value).tolist() for on, value in loads.items()},
            )

        found.append(
            solved(
                [
                    part("lower", 0, 1, (6 * n, 3 * n), {}, bottom={"normal": 0.0}),
                    part(
                        "upper", 1, 1.5, (8 * n, 2 * n), {"top": (3e7, -1e8), "right": (5e6, 1e6)}
                    ),
                ],
                [contact("lower", "upper", "top", "bottom", friction=coulomb(0.2))],
                tolerance=1e-11,
            )
        )
    one, other = (answer.contacts["lower-upper"] for answer in found)
    u, v = (answer.bodies["upper"].displacement for answer in found)
    return (
        {
            "worst contact force, inclined less upright": (
                off(other.normal_force, one.normal_force),
                1e-9,
            ),
            "worst displacement, inclined less upright": (off(v @ turn, u), 1e-9),
        },
        found[1],
        along(
            one,
            lambda x: np.interp(x, one.interface.xy[:, 0], one.pressure),
            X,
            values=other.pressure,
        ),
    )


@problem("Blocks on a skew roller")
def skew_roller(n: int, order: Order, folder: Path) -> Results:
    way, wall, found = np.array([0.6, 0.8]), np.array([1.0, 0.0]), []
    turn = np.array([[0.8, -0.6], [0.6, 0.8]])  # takes the roller's way to y

    def part(name: str, low: float, cells: tuple[int, int], to: np.ndarray, roller: dict) -> dict:
        corners = np.array([(0, low), (2, low), (2, low + 1), (0, low + 1)]) @ to.T
        clamps = held(left={"along": (to @ wall).tolist(), "value": 0.0}, **roller)
        load = {"right": (to @ [-5e6, -2e7]).tolist()}
        return body(name, between(corners, cells, order), *STEEL, clamps, load)

    for to, lower, upper in (
        (np.eye(2), *({"along": (3.0 * way).tolist(), "value": by} for by in (1e-4, -3e-4))),
        (turn, {"y": 1e-4}, {"y": -3e-4}),
    ):
        bodies = [
            part("lower", 0, (6 * n, 3 * n), to, {"bottom": lower}),
            part("upper", 1, (8 * n, 3 * n), to, {"top": upper}),
        ]
        joint = contact("lower", "upper", "top", "bottom", friction=coulomb(0.2))
        found.append(solved(bodies, [joint], tolerance=1e-12))
    one, other = (answer.contacts["lower-upper"] for answer in found)
    u, v = (answer.bodies["upper"].displacement for answer in found)
    skew, plain = (
        np.array(answer.summary["bodies"]["lower"]["reactions"]["bottom"]["force"])
        for answer in found
    )
    size = np.linalg.norm(plain)
    return (
        {
            "worst contact force, skew less turned": (
                off(one.normal_force, other.normal_force),
                1e-12,
            ),
            "worst displacement, skew less turned": (off(v @ turn, u), 1e-12),
            "force of the roller, skew less turned": (off(turn @ skew, plain), 1e-12),
            "force of the roller across its way, over the force": (
                (skew @ [0.8, -0.6] / size).item(),
                1e-12,
            ),
        },
        found[0],
        along(
            one,
            lambda x: np.interp(x, one.interface.xy[:, 0], other.pressure),
            X,
        ),
    )


@problem("Orthotropic plies at an angle")
def plies(n: int, order: Order, folder: Path) -> Results:
    (E1, E2, E3), (n12, n13, n23), c, s, values = PLY["young"], PLY["poisson"], 3**0.5 / 2, 0.5, {}
    for plane_of, strain in (("stress", 0), ("strain", 1)):
        S11, S22 = 1 / E1 - strain * n13**2 * E3 / E1**2, 1 / E2 - strain * n23**2 * E3 / E2**2
        S12 = -n12 / E1 - strain * n13 * n23 * E3 / E1 / E2
        exact = 1e-3 / 2 / (s**4 * S11 + c**4 * S22 + s**2 * c**2 * (2 * S12 + 1 / PLY["shear"]))
        answer = solved(
            [
                {
                    "name": name,
                    "mesh": block(0, y, 2, 1, (across * n, 2 * n), order),
                    "clamp": clamp,
                    "material": PLY | {"plane": plane_of},
                }
                for name, y, across, clamp in (
                    ("upper", 1, 3, held(top={"normal": -1e-3})),
                    ("lower", 0, 4, held(bottom={"normal": 0.0})),
                )
            ],
            [contact("upper", "lower", "bottom", "top", friction=coulomb(0.3))],
        )
        state = answer.contacts["upper-lower"]
        values[f"worst pressure, plane {plane_of}"] = off(state.pressure, exact), 1e-7
    return values, answer, along(state, exact, X)
