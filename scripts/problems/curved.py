"""Verification problems whose contacts are curved, or whose stresses vary along them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ddmpi.interface.state import ContactState
from ddmpi.run.answer import Answer
from problems import ANGLE, Order, Results, X, along, distance, nodes_off, problem, side_means
from problems.bodies import (
    QUARTER,
    annulus,
    body,
    contact,
    draw,
    held,
    number,
    ring_of,
    solved,
    tresca,
    write,
)
from problems.forms import clamped_fit, lame_fit, plane_strain, shear

# Rings


@problem(
    "Two rings with interference",
    (12, 24, 48),
    "sides on a quarter of the inner ring",
    (1, "2 straight", 2),
)
def rings(n: int, order: Order, folder: Path) -> Results:
    a, b, c, fit, E, nu = 0.5, 1.0, 1.5, 1e-5, 1e9, 0.3
    exact = lame_fit(a, b, c, fit, plane_strain(E, nu))
    values, (side, node) = {}, (2e-2, 4e-2) if order == 1 else (2e-3, 2e-2)
    for name, gap in (("gap given", {"gap": -fit}), ("gap measured", {})):
        answer = solved(
            [
                body("shaft", annulus((a, b + fit), (n, n // 2), order, folder), E, nu, QUARTER),
                body("hub", annulus((b, c), (5 * n // 4, n // 2), order, folder), E, nu, QUARTER),
            ],
            [contact("shaft", "hub", "outer", "inner", **gap)],
        )
        state = answer.contacts["shaft-hub"]
        means = side_means(state)
        values |= {
            f"side means, {name}": (means.off(exact), side),
            f"nodes, {name}": (nodes_off(state, exact), node),
            f"mean pressure, {name} (Pa)": (means.mean, exact, side),
        }
    return values, answer, along(state, exact, ANGLE)


def moved_ring(
    name: str,
    radii: tuple[float, float],
    divisions: tuple[int, int],
    order: Order,
    folder: Path,
    rim: str,
    wave: tuple[float, float, float],
) -> dict:
    """A quarter of a ring, one rim of which is moved by u_r = wave[0] + wave[1] cos 2θ, u_θ = wave[2] sin 2θ.

    Each side of the rim is a group, on which the displacement is linear between its nodes.
    """
    made = ring_of(radii, divisions, (0.0, 90.0))
    edges = {f"{rim}{k}": edge[None] for k, edge in enumerate(made.groups[rim])}
    mesh = write(folder / f"{name}.msh", made, made.groups | edges, order)
    clamp = list(QUARTER)
    for group, ((start, end),) in edges.items():
        a, b = made.points[start], made.points[end]
        angle = np.arctan2(*made.points[[start, end]].T[::-1])
        across, around = wave[0] + wave[1] * np.cos(2 * angle), wave[2] * np.sin(2 * angle)
        u = np.column_stack(
            [
                across * np.cos(angle) - around * np.sin(angle),
                across * np.sin(angle) + around * np.cos(angle),
            ]
        )
        u[np.abs(u) < 1e-15] = 0.0  # on the planes of symmetry
        axis = int(np.argmax(np.abs(b - a)))
        slope = (u[1] - u[0]) / (b - a)[axis]
        near = int(abs(b[axis]) < abs(a[axis]))  # exact where a coordinate is zero
        clamp.append(
            {"on": group}
            | {
                component: {
                    "constant": float(u[near, i] - slope[i] * (a, b)[near][axis]),
                    f"{'xy'[axis]}_slope": float(slope[i]),
                }
                for i, component in enumerate("xy")
            }
        )
    return body(name, mesh, 1e9, 0.2, clamp)


def waves(angle: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """The coefficients of 1 and cos 2θ that fit the values best."""
    found = np.linalg.lstsq(
        np.column_stack([np.ones(len(angle)), np.cos(2 * angle)]), values, rcond=None
    )[0]
    return float(found[0]), float(found[1])


@problem(
    "Rings under p₀ + p₂ cos 2θ",
    (12, 24, 48),
    "sides on a quarter of the inner ring",
    (1, "2 straight"),
)
def oval_rings(n: int, order: Order, folder: Path) -> Results:
    b, p0, p2 = 0.6, 9.25925926e6, 1.35717910e5
    answer = solved(
        [
            moved_ring(
                "small",
                (0.2, b),
                (n, n // 2),
                order,
                folder,
                "inner",
                (-4e-3, -1.6123287671e-4, 1.5390410959e-4),
            ),
            moved_ring(
                "large",
                (b, 1.0),
                (5 * n // 4, n // 2),
                order,
                folder,
                "outer",
                (-8e-3, -2.2402739726e-4, 4.9986301370e-5),
            ),
        ],
        [contact("small", "large", "outer", "inner")],
    )
    state, small = answer.contacts["small-large"], answer.bodies["small"]
    means = side_means(state)
    angle = np.arctan2(*means.xy.T[::-1])
    p = waves(angle, means.pressure)
    at = np.abs(np.hypot(*small.points.T) / b - 1.0) < 1e-9
    angles = np.arctan2(*small.points[at].T[::-1])
    u = waves(
        angles,
        (small.displacement[at] * np.column_stack([np.cos(angles), np.sin(angles)])).sum(axis=1),
    )
    return (
        {
            "side means of p": (means.off(p0 + p2 * np.cos(2 * angle)), 3e-2),
            "p₀ (Pa)": (p[0], p0, 2e-2),
            "p₂ (Pa)": (p[1], p2, 0.2),
            "u₀ at 0.6 m (m)": (u[0], -5.33333333e-3, 3e-3),
            "u₂ at 0.6 m (m)": (u[1], -1.84033486e-4, 5e-2),
        },
        answer,
        along(state, lambda x: p0 + p2 * np.cos(np.radians(2 * x)), ANGLE),
    )


@problem("Press fit in plane stress", (8, 16, 32), "sides on a quarter of the shaft")
def press_fit(n: int, order: Order, folder: Path) -> Results:
    b, c, E, fit = 0.5, 1.0, 2e5, 0.6667e-3
    exact = E * fit * (c**2 - b**2) / (2 * b * c**2)
    shaft = draw(
        folder / "shaft.msh",
        {"o": (0.0, 0.0), "a": (b, 0.0), "b": (0.0, b)},
        {"start": "o a", "outer": "a o b", "end": "b o"},
        f"{np.pi / 2 * b / n / number(order)}",
        order,
    )
    layers = max(n // 2, 3)
    hub_mesh = annulus((b, c), (5 * n // 4, layers), order, folder)
    answer = solved(
        [
            body("shaft", shaft, E, 0.3, QUARTER, plane="stress"),
            body("hub", hub_mesh, E, 0.3, QUARTER, plane="stress"),
        ],
        [contact("shaft", "hub", "outer", "inner", gap=-fit)],
    )
    state, hub = answer.contacts["shaft-hub"], answer.bodies["hub"]
    at = hub.points[hub.triangles[:, :3]].mean(axis=1)
    radius, x, y = np.hypot(*at.T), *at.T
    hoop = (
        hub.stress[:, 0] * y**2 + hub.stress[:, 1] * x**2 - 2 * hub.stress[:, 3] * x * y
    ) / radius**2

    def on_rim(rim: float) -> float:
        near = np.abs(radius - rim) < 3 * (c - b) / layers
        return float(np.polyval(np.polyfit(radius[near] - rim, hoop[near], 2), 0.0))

    means, loose = side_means(state), (4e-2, 1e-2)[number(order) - 1]
    return (
        {
            "mean pressure (MPa)": (means.mean, exact, loose),
            "side means": (means.off(exact), loose),
            "σ_θ at the bore (MPa)": (on_rim(b), exact * (c**2 + b**2) / (c**2 - b**2), 3 * loose),
            "σ_θ at the outer rim (MPa)": (on_rim(c), exact * 2 * b**2 / (c**2 - b**2), 3 * loose),
        },
        answer,
        along(state, exact, ANGLE, "pressure (MPa)"),
    )


@problem("Shrink fit under torsion", (24, 48, 96), "sides around the inner ring")
def torsion(n: int, order: Order, folder: Path) -> Results:
    a, b, c, fit, bound, E, nu = 0.5, 1.0, 1.5, 1e-4, 5e4, 1e9, 0.3
    p, whole = clamped_fit(a, b, c, fit, E, nu), (0.0, 360.0)
    stiffness = 4 * np.pi * shear(E, nu) / ((1 / a**2 - 1 / b**2) + (1 / b**2 - 1 / c**2))
    most, values, loose = 2 * np.pi * b**2 * bound, {}, (4e-2, 1e-2)[number(order) - 1]
    for name, angle in (("sticks", 0.5 * most / stiffness), ("slips", 1.5 * most / stiffness)):
        turned = {
            "x": {"constant": 0.0, "y_slope": -angle},
            "y": {"constant": 0.0, "x_slope": angle},
        }
        answer = solved(
            [
                body("shaft", annulus((a, b), (n, n // 8), order, folder, whole), E, nu, ["inner"]),
                body(
                    "hub",
                    annulus((b, c), (5 * n // 4, n // 8), order, folder, whole),
                    E,
                    nu,
                    held(outer=turned),
                ),
            ],
            [contact("shaft", "hub", "outer", "inner", gap=-fit, friction=tresca(bound))],
        )
        state, told = answer.contacts["shaft-hub"], answer.summary["contacts"]["shaft-hub"]
        values |= {
            f"{name}: torque (N)": (abs(state.moment), min(stiffness * angle, most), loose),
            f"{name}: share of nodes that stick": (
                told["stick"] / told["m"],
                name == "sticks",
                0.0,
            ),
        }
    values["pressure, side means"] = side_means(state).off(p), loose
    return values, answer, along(state, p, ANGLE)


# Half-planes

RADIUS, LOAD, NU, ROLLER, BLOCK = 50.0, 17500.0, 0.3, 210e3, 70e3
"""Of the NAFEMS roller, half of it: mm, N/mm, MPa."""

OTHERS = 0.94, 0.97, 1.03, 1.06
"""Meshes so many times finer are solved, too: errors depend on where the contact ends between two nodes."""

HALF = float(np.sqrt(8 * LOAD * RADIUS / np.pi * (1 - NU**2) * (1 / ROLLER + 1 / BLOCK)))
TOP = 4 * LOAD / (np.pi * HALF)
"""Half width a (mm) and largest pressure p₀ (MPa) of Hertz' line contact."""


def roll(spacing: float, order: Order, folder: Path) -> Answer:
    """A quarter of a roller under its load, on its diameter, and half of a block, with nodes so far apart (mm) near
    the contact, on the block 1.2 times as far."""
    roller_size, block_size = (
        f"{h} + 0.25 * Max(0, Sqrt(x * x + y * y) - {2 * HALF})" for h in (spacing, 1.2 * spacing)
    )
    roller = draw(
        folder / "roller.msh",
        {"o": (0.0, 0.0), "b": (RADIUS, RADIUS), "c": (0.0, RADIUS)},
        {"arc": "o c b", "diameter": "b c", "axis": "c o"},
        roller_size,
        order,
    )
    block = draw(
        folder / "block.msh",
        {"o": (0.0, 0.0), "a": (0.0, -200.0), "b": (100.0, -200.0), "c": (100.0, 0.0)},
        {"axis": "o a", "bottom": "a b", "side": "b c", "top": "c o"},
        block_size,
        order,
    )
    return solved(
        [
            body("roller", roller, ROLLER, NU, held(axis="x"), {"diameter": (0.0, -LOAD / RADIUS)}),
            body("block", block, BLOCK, NU, held(axis="x", bottom="y")),
        ],
        [contact("roller", "block", "arc", "top")],
    )


def ellipse(x: np.ndarray) -> np.ndarray:
    return TOP * np.sqrt(np.maximum(0.0, 1.0 - (x / HALF) ** 2))


def loads(x: np.ndarray) -> np.ndarray:
    """The integral of the ellipse from 0 to x."""
    t = np.clip(x / HALF, -1.0, 1.0)
    return TOP * HALF / 2 * (t * np.sqrt(1.0 - t**2) + np.arcsin(t))


def fitted(state: ContactState) -> tuple[float, float]:
    """Half width and largest pressure of the line p² over x² through the side means of the inner 80 % of a."""
    means = side_means(state)
    x = np.abs(means.xy[:, 0])
    slope, top = np.polyfit(x[x < 0.8 * HALF] ** 2, means.pressure[x < 0.8 * HALF] ** 2, 1)
    return float(np.sqrt(-top / slope)), float(np.sqrt(top))


@problem(
    "Hertz: the NAFEMS roller",
    (4, 8, 16),
    "nodes on the half width a",
    view=(0.0, 20.0, -12.0, 12.0),
)
def hertz(n: int, order: Order, folder: Path) -> Results:
    answer = roll(HALF / n, order, folder)
    state = answer.contacts["roller-block"]
    coarse, loose = {4: (0.1, 0.15), 8: (0.012, 0.06)}.get(n, (0.01, 0.025))
    values: dict[str, tuple] = {}
    if n > 4 or order == 1:  # two sides of order 2 do not tell
        width, top = fitted(state)
        values = {"p₀ (MPa)": (top, TOP, coarse), "a (mm)": (width, HALF, coarse)}
    means, errors = side_means(state), [nodes_off(state, ellipse(state.interface.xy[:, 0]))]
    half = np.column_stack([-means.length, means.length]) / 2 + means.xy[:, :1]
    exact = np.diff(loads(half), axis=1)[:, 0] / means.length
    values |= {
        "largest nodal pressure (MPa)": (state.pressure.max(), TOP, coarse),
        "pressure, side means": (means.off(exact), loose),
        "pressure, nodes": (errors[0], loose),
    }
    if n > 4:
        for more in OTHERS:
            other = roll(HALF / n / more, order, folder).contacts["roller-block"]
            errors.append(nodes_off(other, ellipse(other.interface.xy[:, 0])))
        values |= {
            f"pressure, nodes: {words} of five meshes": (some(errors), loose)
            for words, some in (("least", min), ("greatest", max))
        }
    return (
        values,
        answer,
        along(state, ellipse, X._replace(label="x (mm)"), "pressure (MPa)", 1.6 * HALF),
    )


@problem("Tresca strip", (8, 16, 32), "nodes on half the strip", view=(-3.0, 3.0, -2.0, 2.0))
def tresca_strip(n: int, order: Order, folder: Path) -> Results:
    a, R, bound = 1.0, 20.0, 1e6
    meshes = []
    for name, sign, spacing in (("upper", 1.0, a / n), ("lower", -1.0, 1.2 * a / n)):
        points = {
            "o": (0.0, 0.0),
            "a": (sign * -a, 0.0),
            "b": (sign * a, 0.0),
            "c": (sign * R, 0.0),
            "d": (0.0, sign * R),
            "e": (-sign * R, 0.0),
        }
        meshes.append(
            draw(
                folder / f"{name}.msh",
                points,
                {"strip": "a b", "one": "b c", "arc1": "c o d", "arc2": "d o e", "two": "e a"},
                f"{spacing} + 0.2 * Max(0, Sqrt(x * x + y * y) - 1.3)",
                order,
                {"rim": ["arc1", "arc2"], "flat": ["two", "strip", "one"]},
            )
        )
    answer = solved(
        [
            body("upper", meshes[0], 1e9, 0.3, held(rim={"x": 4.2e-3, "y": -1e-4})),
            body("lower", meshes[1], 1e9, 0.3, ["rim"]),
        ],
        [contact("upper", "lower", "strip", "flat", friction=tresca(bound))],
    )
    state = answer.contacts["upper-lower"]
    x, q, area = state.interface.xy[:, 0], np.abs(state.shear[:, 0]), state.interface.area
    c = a * np.sqrt(1 - (np.abs(state.tangential_force.sum()) / (2 * bound * a)) ** 2)

    def exact(x: np.ndarray) -> np.ndarray:
        inside = np.abs(x) < c
        return np.where(
            inside,
            2
            * bound
            / np.pi
            * np.arctan(np.sqrt((a**2 - c**2) / np.where(inside, c**2 - x**2, 1.0))),
            bound,
        )

    middle = np.abs(x) < 0.5 * c
    means = [
        area[middle] @ each / area[middle].sum() / bound for each in (q[middle], exact(x[middle]))
    ]
    return (
        {
            "shear stress, nodes": (distance(q, exact(x), area), 1.2 / n),
            "mean q from −c/2 to c/2, over g": (*means, 0.04),
            "c (m)": (area[state.status == "stick"].sum() / 2, c, 1.5 / n),
        },
        answer,
        along(state, exact, X, "shear stress (Pa)", values=q),
    )
