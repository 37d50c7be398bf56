"""Verification problems whose contacts are curved, or whose stresses vary along them."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ddmpi.interface.state import ContactState
from ddmpi.run.answer import Answer
from problems import (
    Found,
    Order,
    Value,
    along,
    along_x,
    annulus,
    body,
    contact,
    degrees,
    distance,
    draw,
    lame_fit,
    number,
    plane_strain,
    problem,
    ring_of,
    side_means,
    solved,
    write,
)

QUARTER = [{"on": "start", "y": 0.0}, {"on": "end", "x": 0.0}]


# Rings

@problem("rings", "Two rings with interference", (12, 24, 48), "sides on a quarter of the inner ring",
         orders=(1, "2 straight", 2),
         shows="Chords of a circle stand off it by far more than rings overlap. The gap between the arcs over the "
               "chords gives the pressure all the same, nearly as well as the interference itself does "
               "(`contact.gap`).",
         scene="Quarters of rings 0.5 – 1 – 1.5 m, E = 1 GPa, ν = 0.3, plane strain, overlapping by δ = 10 µm; no "
               "friction; sides 4 : 5. Errors are of the pressure in L2, of its means over sides and at nodes.",
         source="Lamé; S. Timoshenko, J. N. Goodier, Theory of Elasticity, art. 28: p = δE'/b / ((c² + b²)/(c² − b²) "
                "+ (b² + a²)/(b² − a²)).")
def rings(n: int, order: Order, folder: Path) -> Found:
    a, b, c, fit, E, nu = 0.5, 1.0, 1.5, 1e-5, 1e9, 0.3
    exact = lame_fit(a, b, c, fit, plane_strain(E, nu))
    values = {}
    side, node = {1: (2e-2, 4e-2), "2 straight": (2e-3, 2e-2), 2: (2e-3, 2e-2)}[order]
    for name, gap in (("gap given", {"gap": -fit}), ("gap measured", {})):
        answer = solved([body("shaft", annulus((a, b + fit), (n, n // 2), order, folder), E, nu, QUARTER),
                         body("hub", annulus((b, c), (5 * n // 4, n // 2), order, folder), E, nu, QUARTER)],
                        [contact("shaft", "hub", "outer", "inner", **gap)])
        state = answer.contacts["shaft-hub"]
        means = side_means(state)
        values |= {f"side means, {name}": Value(distance(means.pressure, exact, means.length), 0.0, side),
                   f"nodes, {name}": Value(distance(state.pressure, exact, state.interface.area), 0.0, node),
                   f"mean pressure, {name} (Pa)": Value(float(means.length @ means.pressure / means.length.sum()),
                                                        exact, side)}
    return Found(values, answer, along(state, exact, degrees, "angle (°)", "pressure (Pa)"))


def moved_ring(name: str, radii: tuple[float, float], divisions: tuple[int, int], order: Order, folder: Path,
               rim: str, wave: tuple[float, float, float], young: float, poisson: float) -> dict:
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
        u = np.column_stack([across * np.cos(angle) - around * np.sin(angle),
                             across * np.sin(angle) + around * np.cos(angle)])
        u[np.abs(u) < 1e-15] = 0.0  # on the planes of symmetry
        axis = int(np.argmax(np.abs(b - a)))
        slope = (u[1] - u[0]) / (b - a)[axis]
        near = int(abs(b[axis]) < abs(a[axis]))  # exact where a coordinate is zero
        clamp.append({"on": group} | {component: {
            "constant": float(u[near, i] - slope[i] * (a, b)[near][axis]), f"{'xy'[axis]}_slope": float(slope[i])}
            for i, component in enumerate("xy")})
    return body(name, mesh, young, poisson, clamp)


def waves(angle: np.ndarray, values: np.ndarray) -> tuple[float, float]:
    """The coefficients of 1 and cos 2θ that fit the values best."""
    found = np.linalg.lstsq(np.column_stack([np.ones(len(angle)), np.cos(2 * angle)]), values, rcond=None)[0]
    return float(found[0]), float(found[1])


@problem("oval-rings", "Rings under p₀ + p₂ cos 2θ", (12, 24, 48), "sides on a quarter of the inner ring",
         orders=(1, "2 straight"),
         shows="A pressure that varies along a curved contact.",
         scene="Quarters of rings 0.2 – 0.6 – 1 m, E = 1 GPa, ν = 0.2, plane strain, no friction; both rims are "
               "moved: u_r = −8e-3 − 2.2402739726e-4 cos 2θ, u_θ = 4.9986301370e-5 sin 2θ at 1 m; u_r = −4e-3 − "
               "1.6123287671e-4 cos 2θ, u_θ = 1.5390410959e-4 sin 2θ at 0.2 m. Sides 4 : 5.",
         source="p = 9.25925926e6 + 1.35717910e5 cos 2θ Pa; u_r = −5.33333e-3 − 1.84033486e-4 cos 2θ at 0.6 m: "
                "Michell's solutions of order 0 and 2 in both rings.")
def oval_rings(n: int, order: Order, folder: Path) -> Found:
    b, p0, p2 = 0.6, 9.25925926e6, 1.35717910e5
    answer = solved(
        [moved_ring("small", (0.2, b), (n, n // 2), order, folder, "inner",
                    (-4e-3, -1.6123287671e-4, 1.5390410959e-4), 1e9, 0.2),
         moved_ring("large", (b, 1.0), (5 * n // 4, n // 2), order, folder, "outer",
                    (-8e-3, -2.2402739726e-4, 4.9986301370e-5), 1e9, 0.2)],
        [contact("small", "large", "outer", "inner")])
    state = answer.contacts["small-large"]
    means, small = side_means(state), answer.bodies["small"]
    angle = np.arctan2(*means.xy.T[::-1])
    p = waves(angle, means.pressure)
    at = np.abs(np.hypot(*small.points.T) / b - 1.0) < 1e-9
    angles = np.arctan2(*small.points[at].T[::-1])
    u = waves(angles, (small.displacement[at] * np.column_stack([np.cos(angles), np.sin(angles)])).sum(axis=1))
    return Found({"side means of p": Value(distance(means.pressure, p0 + p2 * np.cos(2 * angle), means.length), 0.0,
                                           3e-2),
                  "p₀ (Pa)": Value(p[0], p0, 2e-2), "p₂ (Pa)": Value(p[1], p2, 0.2),
                  "u₀ at 0.6 m (m)": Value(u[0], -5.33333333e-3, 3e-3),
                  "u₂ at 0.6 m (m)": Value(u[1], -1.84033486e-4, 5e-2)},
                 answer, along(state, lambda x: p0 + p2 * np.cos(np.radians(2 * x)), degrees, "angle (°)",
                               "pressure (Pa)"))


@problem("press-fit", "Press fit in plane stress", (8, 16, 32), "sides on a quarter of the shaft",
         shows="A solid shaft that fills its hub, and the stresses around the bore.",
         scene="A quarter of a shaft of 0.5 m radius, drawn, in a hub of 1 m, E = 2e5 MPa, ν = 0.3, plane stress, no "
               "friction; `gap = -0.6667e-3` m. Sides 4 : 5. Stresses are means of the elements, extrapolated to the "
               "rims by a parabola through the three layers next to them.",
         source="Lamé: p = Eδ(c² − b²)/(2bc²) = 100 MPa; σ_θ of the hub (c² + b²)/(c² − b²) p = 166.68 and 2b²/(c² − "
                "b²) p = 66.67 MPa.")
def press_fit(n: int, order: Order, folder: Path) -> Found:
    b, c, E, fit = 0.5, 1.0, 2e5, 0.6667e-3
    exact = E * fit * (c**2 - b**2) / (2 * b * c**2)
    shaft = draw(folder / "shaft.msh", {"o": (0.0, 0.0), "a": (b, 0.0), "b": (0.0, b)},
                 {"start": ("o", "a"), "outer": ("a", "o", "b"), "end": ("b", "o")},
                 f"{np.pi / 2 * b / n / number(order)}", order)
    layers = max(n // 2, 3)
    answer = solved([body("shaft", shaft, E, 0.3, QUARTER, plane="stress"),
                     body("hub", annulus((b, c), (5 * n // 4, layers), order, folder), E, 0.3, QUARTER,
                          plane="stress")],
                    [contact("shaft", "hub", "outer", "inner", gap=-fit)])
    state, hub = answer.contacts["shaft-hub"], answer.bodies["hub"]
    at = hub.points[hub.triangles[:, :3]].mean(axis=1)
    radius, x, y = np.hypot(*at.T), *at.T
    hoop = (hub.stress[:, 0] * y**2 + hub.stress[:, 1] * x**2 - 2 * hub.stress[:, 3] * x * y) / radius**2

    def on_rim(rim: float) -> float:
        near = np.abs(radius - rim) < 3 * (c - b) / layers
        return float(np.polyval(np.polyfit(radius[near] - rim, hoop[near], 2), 0.0))

    means, loose = side_means(state), (4e-2, 1e-2)[number(order) - 1]
    return Found({"mean pressure (MPa)": Value(float(means.length @ means.pressure / means.length.sum()), exact, loose),
                  "side means": Value(distance(means.pressure, exact, means.length), 0.0, loose),
                  "σ_θ at the bore (MPa)": Value(on_rim(b), exact * (c**2 + b**2) / (c**2 - b**2), 3 * loose),
                  "σ_θ at the outer rim (MPa)": Value(on_rim(c), exact * 2 * b**2 / (c**2 - b**2), 3 * loose)},
                 answer, along(state, exact, degrees, "angle (°)", "pressure (MPa)"))


@problem("torsion", "Shrink fit under torsion", (24, 48, 96), "sides around the inner ring",
         shows="Whole rings, whose contact has neither beginning nor end, stick until their bound is reached, and "
               "then turn in each other.",
         scene="Rings 0.5 – 1 – 1.5 m, E = 1 GPa, ν = 0.3, plane strain, overlapping by 0.1 mm (`gap`); the inner "
               "rim is clamped, the outer one is clamped and turned by φ; Tresca's law with the bound g = 50 kPa. "
               "Sides 4 : 5.",
         source="T = min(4πφ/((1/a² − 1/b²)/G + (1/b² − 1/c²)/G), 2πb²g); p = δ/(b(k_i + k_o)), k = |1 − r²/b²| / "
                "(2(λ + G) + 2G r²/b²) with the radius r of a clamped rim.")
def torsion(n: int, order: Order, folder: Path) -> Found:
    a, b, c, fit, bound, E, nu = 0.5, 1.0, 1.5, 1e-4, 5e4, 1e9, 0.3
    G, lame = E / 2 / (1 + nu), E * nu / (1 + nu) / (1 - 2 * nu)
    p = fit / b / sum(abs(1 - r**2 / b**2) / (2 * (lame + G) + 2 * G * r**2 / b**2) for r in (a, c))
    stiffness = 4 * np.pi * G / ((1 / a**2 - 1 / b**2) + (1 / b**2 - 1 / c**2))
    most, values = 2 * np.pi * b**2 * bound, {}
    loose = (4e-2, 1e-2)[number(order) - 1]
    for name, angle in (("sticks", 0.5 * most / stiffness), ("slips", 1.5 * most / stiffness)):
        turned = {"on": "outer", "x": {"constant": 0.0, "y_slope": -angle}, "y": {"constant": 0.0, "x_slope": angle}}
        answer = solved([body("shaft", annulus((a, b), (n, n // 8), order, folder, (0.0, 360.0)), E, nu, ["inner"]),
                         body("hub", annulus((b, c), (5 * n // 4, n // 8), order, folder, (0.0, 360.0)), E, nu,
                              [turned])],
                        [contact("shaft", "hub", "outer", "inner", gap=-fit,
                                 friction={"law": "tresca", "slip_bound": bound})])
        state, held = answer.contacts["shaft-hub"], answer.summary["contacts"]["shaft-hub"]
        torque = abs(state.moment)
        values[f"{name}: torque (N)"] = Value(torque, min(stiffness * angle, most), loose)
        values[f"{name}: share of nodes that stick"] = Value(held["stick"] / held["m"], float(name == "sticks"), 0.0)
    means = side_means(state)
    values["pressure, side means"] = Value(distance(means.pressure, p, means.length), 0.0, loose)
    return Found(values, answer, along(state, p, degrees, "angle (°)", "pressure (Pa)"))


# Half-planes

RADIUS, LOAD, NU, ROLLER, BLOCK = 50.0, 17500.0, 0.3, 210e3, 70e3
"""Of the NAFEMS roller, half of it: mm, N/mm, MPa."""


OTHERS = 0.94, 0.97, 1.03, 1.06
"""Meshes so many times finer are solved, too: errors depend on where the contact ends between two nodes."""


def hertz() -> tuple[float, float]:
    """Half width a (mm) and largest pressure p₀ (MPa) of Hertz' line contact."""
    a = float(np.sqrt(8 * LOAD * RADIUS / np.pi * (1 - NU**2) * (1 / ROLLER + 1 / BLOCK)))
    return a, 4 * LOAD / (np.pi * a)


def roll(spacing: float, order: Order, folder: Path) -> Answer:
    """A quarter of a roller under its load, on its diameter, and half of a block, with nodes so far apart (mm) near
    the contact, on the block 1.2 times as far."""
    roller_size, block_size = (f"{h} + 0.25 * Max(0, Sqrt(x * x + y * y) - {2 * hertz()[0]})" for h in (
        spacing, 1.2 * spacing))
    roller = draw(folder / "roller.msh", {"o": (0.0, 0.0), "b": (RADIUS, RADIUS), "c": (0.0, RADIUS)},
                  {"arc": ("o", "c", "b"), "diameter": ("b", "c"), "axis": ("c", "o")}, roller_size, order)
    block = draw(folder / "block.msh", {"o": (0.0, 0.0), "a": (0.0, -200.0), "b": (100.0, -200.0), "c": (100.0, 0.0)},
                 {"axis": ("o", "a"), "bottom": ("a", "b"), "side": ("b", "c"), "top": ("c", "o")}, block_size, order)
    axis = {"on": "axis", "x": 0.0}
    return solved([body("roller", roller, ROLLER, NU, [axis], {"diameter": (0.0, -LOAD / RADIUS)}),
                   body("block", block, BLOCK, NU, [axis, {"on": "bottom", "y": 0.0}])],
                  [contact("roller", "block", "arc", "top")])


def ellipse(a: float, p0: float, x: np.ndarray) -> np.ndarray:
    return p0 * np.sqrt(np.maximum(0.0, 1.0 - (x / a) ** 2))


def loads(a: float, p0: float, x: np.ndarray) -> np.ndarray:
    """The integral of the ellipse from 0 to x."""
    t = np.clip(x / a, -1.0, 1.0)
    return p0 * a / 2 * (t * np.sqrt(1.0 - t**2) + np.arcsin(t))


def fitted(state: ContactState, a: float) -> tuple[float, float]:
    """Half width and largest pressure of the line p² over x² through the side means of the inner 80 % of a."""
    means = side_means(state)
    x = np.abs(means.xy[:, 0])
    slope, top = np.polyfit(x[x < 0.8 * a] ** 2, means.pressure[x < 0.8 * a] ** 2, 1)
    return float(np.sqrt(-top / slope)), float(np.sqrt(top))


@problem("hertz", "Hertz: the NAFEMS roller", (4, 8, 16), "nodes on the half width a", view=(0.0, 20.0, -12.0, 12.0),
         shows="The standard example of contact, on meshes that are drawn without a thought of nodes.",
         scene="A roller of 100 mm diameter, E = 210 GPa, on a block of 200 mm × 200 mm, E = 70 GPa, ν = 0.3, plane "
               "strain, 35 kN/mm; a quarter of the roller on half of the block, drawn, nodes 1 : 1.2 apart, the "
               "slave chosen by the program. p₀ and a are those of the line p² over x² through the side means of the "
               "inner 80 %. On the axis of symmetry a node's pressure is not to be read: linear triangles in that "
               "corner change it by up to 12 % either way, by the direction of their diagonals. Five meshes: "
               "also 3 and 6 % finer and coarser, where the contact ends elsewhere between two nodes.",
         source="NAFEMS, Advanced Finite Element Contact Benchmarks (A. Konter, 2006), problem 1: a = √(4PR/πE*) = "
                "6.2146 mm, p₀ = 2P/(πa) = 3585.4 MPa, p = p₀√(1 − x²/a²). Half-planes are meant; a/R = 0.12 leaves "
                "−0.2 % in p₀ and +0.4 % in a.")
def nafems_roller(n: int, order: Order, folder: Path) -> Found:
    a, p0 = hertz()
    answer = roll(a / n, order, folder)
    state = answer.contacts["roller-block"]
    width, top = fitted(state, a) if n > 4 or order == 1 else (np.nan, np.nan)  # two sides of order 2 do not tell
    coarse, loose = {4: (0.1, 0.15), 8: (0.012, 0.06)}.get(n, (0.01, 0.025))
    fits = {} if np.isnan(top) else {"p₀ (MPa)": Value(top, p0, coarse), "a (mm)": Value(width, a, coarse)}
    means, errors = side_means(state), []
    half = np.column_stack([-means.length, means.length]) / 2 + means.xy[:, :1]
    exact = np.diff(loads(a, p0, half), axis=1)[:, 0] / means.length
    for more in (1.0, *(OTHERS if n > 4 else ())):
        each = state if more == 1.0 else roll(a / n / more, order, folder).contacts["roller-block"]
        errors.append(distance(each.pressure, ellipse(a, p0, each.interface.xy[:, 0]), each.interface.area))
    spread = {"pressure, nodes: least of five meshes": Value(min(errors), 0.0, loose),
              "pressure, nodes: greatest of five meshes": Value(max(errors), 0.0, loose)} if n > 4 else {}
    return Found(fits | {"largest nodal pressure (MPa)": Value(float(state.pressure.max()), p0, coarse),
                         "pressure, side means": Value(distance(means.pressure, exact, means.length), 0.0, loose),
                         "pressure, nodes": Value(errors[0], 0.0, loose)} | spread,
                 answer, along(state, lambda x: ellipse(a, p0, x), along_x, "x (mm)", "pressure (MPa)", 1.6 * a))


@problem("tresca-strip", "Tresca strip", (8, 16, 32), "nodes on half the strip", view=(-3.0, 3.0, -2.0, 2.0),
         shows="Slip spreads from the ends of a strip at which two bodies are joined.",
         scene="Half-discs of 20 m, E = 1 GPa, ν = 0.3, plane strain, drawn, touch on the strip |x| < a = 1 m, nodes "
               "1 : 1.2 apart; the lower rim is clamped, the upper one moved down and sideways. Tresca's law with the "
               "bound g.",
         source="c = a√(1 − (Q/2ga)²), q = g on c < |x| < a, q = (2g/π) arctan √((a² − c²)/(c² − x²)) inside, with "
                "the computed Q: half-planes, of which discs differ by (a/R)².")
def tresca_strip(n: int, order: Order, folder: Path) -> Found:
    a, R, bound = 1.0, 20.0, 1e6
    meshes = []
    for name, sign, spacing in (("upper", 1.0, a / n), ("lower", -1.0, 1.2 * a / n)):
        size = f"{spacing} + 0.2 * Max(0, Sqrt(x * x + y * y) - 1.3)"
        points = {"o": (0.0, 0.0), "a": (sign * -a, 0.0), "b": (sign * a, 0.0), "c": (sign * R, 0.0),
                  "d": (0.0, sign * R), "e": (-sign * R, 0.0)}
        meshes.append(draw(folder / f"{name}.msh", points, {
            "strip": ("a", "b"), "one": ("b", "c"), "arc1": ("c", "o", "d"), "arc2": ("d", "o", "e"),
            "two": ("e", "a")}, size, order, {"rim": ["arc1", "arc2"], "flat": ["two", "strip", "one"]}))
    answer = solved([body("upper", meshes[0], 1e9, 0.3, [{"on": "rim", "x": 4.2e-3, "y": -1e-4}]),
                     body("lower", meshes[1], 1e9, 0.3, ["rim"])],
                    [contact("upper", "lower", "strip", "flat", friction={"law": "tresca", "slip_bound": bound})])
    state = answer.contacts["upper-lower"]
    x, q = state.interface.xy[:, 0], np.abs(state.shear[:, 0])
    Q = float(np.abs(state.tangential_force.sum()))
    c = a * np.sqrt(1 - (Q / (2 * bound * a)) ** 2)

    def exact(x: np.ndarray) -> np.ndarray:
        inside = np.abs(x) < c
        return np.where(inside, 2 * bound / np.pi * np.arctan(np.sqrt((a**2 - c**2)
                                                                      / np.where(inside, c**2 - x**2, 1.0))), bound)

    sticks, middle = state.status == "stick", np.abs(x) < 0.5 * c
    share = float(state.interface.area[sticks].sum() / 2)
    return Found({"shear stress, nodes": Value(distance(q, exact(x), state.interface.area), 0.0, 1.2 / n),
                  "mean q from −c/2 to c/2, over g": Value(
                      float(state.interface.area[middle] @ q[middle] / state.interface.area[middle].sum() / bound),
                      float(state.interface.area[middle] @ exact(x[middle]) / state.interface.area[middle].sum()
                            / bound), 0.04),
                  "c (m)": Value(share, c, 1.5 / n)},
                 answer, along(state, exact, along_x, "x (m)", "shear stress (Pa)", values=q))
