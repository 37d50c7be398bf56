"""Verification problems around an axis: patches, fits, Hertz's balls, a flat punch, a ring on a cone."""

from __future__ import annotations

import functools
from dataclasses import replace
from pathlib import Path

import numpy as np

from problems import (
    Found,
    Order,
    Value,
    along,
    annulus,
    block,
    body,
    contact,
    coulomb,
    draw,
    hertz_values,
    lame_ball,
    lame_fit,
    mean_pressure,
    plane_strain,
    problem,
    solved,
    worst,
)
from problems.flat import EXACT, TIGHT, frames

RADIUS = 1.0
"""Of the balls (m)."""


turned = functools.partial(solved, axisymmetric=True)
"""The answer of an axisymmetric scene."""


def plane(normal: tuple[float, float] = (0.0, 1.0), point: tuple[float, float] = (0.0, 0.0), **more) -> list[dict]:
    return [{"name": "floor", "shape": "plane", "point": list(point), "normal": list(normal)} | more]


def radius(xy: np.ndarray) -> np.ndarray:
    return xy[:, 0]


def height(xy: np.ndarray) -> np.ndarray:
    return xy[:, 1]


# Patch tests

@problem("cgs-1-turned", "NAFEMS CGS-1 around an axis", (1, 2, 4), "times finer than the coarsest mesh",
         shows="Two discs of unlike material, pressed together, slide along their contact as they bulge, and bear the "
               "same pressure everywhere, on the axis as well.",
         scene="Drawn meshes that do not match, of discs of 2 m radius and 1 m height, E = 1 and 10 GPa, ν = 0.3 and "
               "0.2; no friction; the top is moved down by δ = 1 mm. Nothing is said of the axis.",
         source="The plane problem above, turned: p = δ / Σ(H_i/E_i).")
def cgs1_turned(n: int, order: Order, folder: Path) -> Found:
    upper, lower = frames((0.0, 2.0), (0.0, 2.0), 0.3 / n, order, folder)
    exact = 1e-3 / (1 / 1e9 + 1 / 1e10)
    answer = turned([body("upper", upper, 1e9, 0.3, [{"on": "far", "y": -1e-3}]),
                     body("lower", lower, 1e10, 0.2, [{"on": "far", "y": 0.0}])],
                    [contact("upper", "lower", "seam", "seam")], tolerance=TIGHT)
    state = answer.contacts["upper-lower"]
    return Found({"force (N)": Value(float(state.normal_force.sum()), 4 * np.pi * exact, EXACT),
                  "worst node": Value(worst(state, exact), 0.0, EXACT)}, answer,
                 along(state, exact, radius, "r (m)", "pressure (Pa)"))


@problem("cone-patch", "Constant stress through a cone", (1, 2, 4), "times finer than the coarsest mesh",
         shows="Friction and pressure on an inclined contact are exact where the stress is constant.",
         scene="A cone of E = 1 GPa, ν = 0.3 that sticks in a hollow of the same material, 𝓕 = 1; their outer sides "
               "follow u = (a r, b y); 5 : 7 elements.",
         source="σ_r = λ(2a + b) + 2μa, σ_y = λ(2a + b) + 2μb; pressure and friction are their parts on the cone.")
def cone_patch(n: int, order: Order, folder: Path) -> Found:
    a, b, E, nu = -1e-3, -2e-3, 1e9, 0.3
    field = {"x": f"{a} * x", "y": f"{b} * y"}
    shape = {"shape": "quadrilateral", "order": order}
    inner = shape | {"corners": [[0, 0], [1.0, 0], [0.5, 1], [0, 1]], "divisions": [4 * n, 5 * n]}
    outer = shape | {"corners": [[1.0, 0], [2, 0], [2, 1], [0.5, 1]], "divisions": [5 * n, 7 * n]}
    answer = turned([body("cone", inner, E, nu, [{"on": on} | field for on in ("bottom", "top")]),
                     body("hollow", outer, E, nu, [{"on": on} | field for on in ("bottom", "right", "top")])],
                    [contact("cone", "hollow", "right", "left", friction=coulomb(1.0))], tolerance=TIGHT)
    first, shear = E * nu / (1 + nu) / (1 - 2 * nu), E / 2 / (1 + nu)
    stress = np.array([first * (2 * a + b) + 2 * shear * each for each in (a, b)])
    normal = np.array([1.0, 0.5]) / np.hypot(1.0, 0.5)
    tangent = np.array([-normal[1], normal[0]])
    state = answer.contacts["cone-hollow"]
    exact = -float(stress @ normal**2)
    return Found({"worst node": Value(worst(state, exact, -float(stress * normal @ tangent)), 0.0, EXACT)}, answer,
                 along(state, exact, height, "y (m)", "pressure (Pa)"))


# Fits

@problem("tubes-turned", "Two tubes with interference, around an axis", (2, 4, 8), "elements across the wall",
         shows="A fit as engineers draw it: a rectangle beside the axis.",
         scene="Tubes 0.3 – 0.6 – 0.9 m, 0.2 m long, E = 200 and 100 GPa, ν = 0.3 and 0.25, a gap of −60 µm; no "
               "friction; their ends fixed along the axis, or free; elements 4 : 5.",
         source="Lamé: in plane strain with fixed ends, in plane stress with free ones.")
def tubes_turned(n: int, order: Order, folder: Path) -> Found:
    a, b, c, fit, values = 0.3, 0.6, 0.9, 6e-5, {}
    materials = (2e11, 0.3), (1e11, 0.25)
    for ends in ("fixed", "free"):
        clamp = [{"on": on, "y": 0.0} for on in ("bottom", "top")[:1 + (ends == "fixed")]]
        answer = turned([body("inner", block(a, 0.0, b - a, 0.2, (n, n), order), *materials[0], clamp),
                         body("outer", block(b, 0.0, c - b, 0.2, (n, n + n // 2), order), *materials[1], clamp)],
                        [contact("inner", "outer", "right", "left", gap=-fit)])
        exact = lame_fit(a, b, c, fit, *(plane_strain(*each) if ends == "fixed" else each for each in materials))
        state = answer.contacts["inner-outer"]
        values[f"{ends} ends: mean pressure (Pa)"] = Value(mean_pressure(state), exact, {1: 0.05}.get(int(order), 2e-3))
    return Found(values, answer, along(state, exact, height, "y (m)", "pressure (Pa)"))


@problem("spheres-turned", "A ball in a shell with interference, around an axis", (3, 6, 10),
         "elements across the shell",
         shows="The same on arcs that end on the axis.",
         scene="Halves of a shell 0.25 – 0.5 m in a shell 0.5 – 1 m, E = 200 GPa, ν = 0.3, a gap of −50 µm; no "
               "friction; elements 4 : 5.",
         source="Lamé, spheres.")
def spheres_turned(n: int, order: Order, folder: Path) -> Found:
    a, b, c, fit, E, nu = 0.25, 0.5, 1.0, 5e-5, 2e11, 0.3
    half = [{"on": "start", "y": 0.0}]
    answer = turned([body("ball", annulus((a, b), (4 * n, n), order, folder), E, nu, half),
                     body("shell", annulus((b, c), (5 * n, n), order, folder), E, nu, half)],
                    [contact("ball", "shell", "outer", "inner", gap=-fit)])
    state, exact = answer.contacts["ball-shell"], lame_ball(a, b, c, fit, E, nu)
    return Found({"mean pressure (Pa)": Value(mean_pressure(state), exact, {1: 0.06}.get(int(order), 2e-3))}, answer,
                 along(state, exact, lambda xy: np.degrees(np.arctan2(*xy.T[::-1])),
                       "latitude (°)", "pressure (Pa)"))


# Balls and punches

def half_ball(path: Path, a: float, n: int, order: Order, up: float = 1.0) -> dict:
    """Half of a half ball that touches y = 0 in the origin, above (`up` 1) or below (−1), with n elements on a.

    Groups: contact, as far as 1.6 a; top, its flat face.
    """
    reach = np.arcsin(1.6 * a / RADIUS)
    corners = {"pole": (0.0, 0.0), "rim": (RADIUS * np.sin(reach), up * RADIUS * (1 - np.cos(reach))),
               "side": (RADIUS, up * RADIUS), "centre": (0.0, up * RADIUS)}
    lines = {"contact": ("pole", "centre", "rim"), "outer": ("rim", "centre", "side"), "top": ("side", "centre"),
             "axis": ("centre", "pole")}
    h = a / n / int(order)  # quadratic elements are drawn twice as large
    return draw(path, corners, lines, f"min(0.1, {h} + 0.2 * max(0, sqrt(x*x + y*y) - {1.25 * a}))", order)


@problem("hertz-turned", "A ball on a rigid plane, around an axis", (4, 8, 16), "nodes on a",
         shows="Hertz's point contact with an unknown zone, at the cost of a plane problem.",
         scene="Half of a half ball, R = 1 m, E = 1 Pa, ν = 0.3, whose flat face is moved by 2.6 mm; a ≈ 0.05 m.",
         source="Hertz, for the force that was computed: a³ = 3PR/(4E*), p₀ = 3P/(2πa²).")
def hertz_turned(n: int, order: Order, folder: Path) -> Found:
    answer = turned([body("ball", half_ball(folder / "ball.msh", 0.05, n, order), 1.0, 0.3,
                          [{"on": "top", "y": -0.0026}])], [contact("ball", "floor", "contact")], plane())
    values, curve = hertz_values(answer.contacts["ball-floor"], 1, 1.0 / (1.0 - 0.09), RADIUS,
                                 (0.06,) * 2 if n < 8 else (0.02,) * 2)
    return Found(values, answer, curve)


@problem("two-balls-turned", "Two balls of unlike stiffness, around an axis", (4, 8, 16), "nodes on a of the soft ball",
         shows="Two curved surfaces that meet on the axis, on meshes that do not match.",
         scene="Half balls, R = 1 m, E = 1 and 5 Pa, ν = 0.3 and 0.2, elements 4 : 5, approached by 6 mm.",
         source="Hertz, for the force that was computed.")
def two_balls_turned(n: int, order: Order, folder: Path) -> Found:
    soft = half_ball(folder / "soft.msh", 0.055, n, order)
    stiff = half_ball(folder / "stiff.msh", 0.055, n + n // 4, order, up=-1.0)
    answer = turned([body("soft", soft, 1.0, 0.3, [{"on": "top", "y": -0.006}]),
                     body("stiff", stiff, 5.0, 0.2, [{"on": "top", "y": 0.0}])],
                    [contact("soft", "stiff", "contact", "contact")])
    modulus = 1.0 / ((1.0 - 0.09) / 1.0 + (1.0 - 0.04) / 5.0)
    values, curve = hertz_values(answer.contacts["soft-stiff"], 1, modulus, RADIUS / 2,
                                 (0.08,) * 2 if n < 8 else (0.03,) * 2)
    return Found(values, answer, curve)


@problem("flat-punch", "A flat punch", (8, 16, 32), "nodes on a",
         shows="Pressure that grows without limit at the rim of a punch, and the force that it takes.",
         scene="A block of 50 m radius and height, E = 1 Pa, ν = 0.3, on which a rigid disc of a = 1 m is pushed "
               "0.01 m deep without friction.",
         source="Boussinesq: P = 2 a E* δ, p = P/(2πa √(a² − r²)).")
def flat_punch(n: int, order: Order, folder: Path) -> Found:
    size = f"{1.0 / n / int(order)} + 0.25 * max(0, abs(sqrt(x*x + y*y) - 1) - 0.5)"
    mesh = draw(folder / "block.msh", {"o": (0.0, 0.0), "rim": (1.0, 0.0), "edge": (50.0, 0.0), "far": (50.0, -50.0),
                                       "base": (0.0, -50.0)},
                {"axis": ("base", "o"), "seat": ("o", "rim"), "free": ("rim", "edge"), "side": ("edge", "far"),
                 "bottom": ("far", "base")}, size, order)
    answer = turned([body("block", mesh, 1.0, 0.3, [{"on": "bottom", "y": 0.0}])], [contact("block", "floor", "seat")],
                    plane((0.0, -1.0), displacement=[0.0, -0.01]))
    state = answer.contacts["block-floor"]
    force, r = float(state.normal_force.sum()), state.interface.xy[:, 0]

    def pressure(x: np.ndarray) -> np.ndarray:
        return force / (2 * np.pi * np.sqrt(1.0 - x**2))

    near = r < 0.8
    area, exact = state.interface.area[near], pressure(r[near])
    error = np.sqrt(area @ (state.pressure[near] - exact) ** 2 / (area @ exact**2))
    return Found({"force (N)": Value(force, 2.0 / 0.91 * 0.01, 0.08),
                  "pressure up to 0.8 a, in L2": Value(float(error), 0.0, 0.12)}, answer,
                 along(state, pressure, radius, "r (m)", "pressure (Pa)", 0.95))


@problem("ring-on-cone", "A ring that is pushed onto a cone", (1, 2, 4), "times finer than the coarsest mesh",
         shows="Friction on a rigid cone, which is a plane that is turned.",
         scene="A ring 1 – 2 m, E = 1 GPa, ν = 0.3, bored to a rigid cone that leans by 20°, pushed along the axis "
               "by 1 MN; 𝓕 = 0.15.",
         source="Where all slides, radial over axial force is (cos α − 𝓕 sin α)/(sin α + 𝓕 cos α), everywhere.")
def ring_on_cone(n: int, order: Order, folder: Path) -> Found:
    slope, friction = np.radians(20.0), 0.15
    lean = float(np.tan(slope))
    mesh = {"shape": "quadrilateral", "corners": [[1.0, 0.0], [2.0, 0.0], [2.0, 1.0], [1.0 - lean, 1.0]],
            "divisions": [4 * n, 4 * n], "order": order}
    ring = body("ring", mesh, 1e9, 0.3) | {"traction": [{"on": "top", "force": [0.0, -1e6]}]}
    answer = turned([ring], [contact("ring", "floor", "left", friction=coulomb(friction))],
                    plane((float(np.cos(slope)), float(np.sin(slope))), (1.0, 0.0)), tolerance=TIGHT)
    state = answer.contacts["ring-floor"]
    ratio = (np.cos(slope) - friction * np.sin(slope)) / (np.sin(slope) + friction * np.cos(slope))
    forces = state.forces[state.status != "open"]
    return Found({"force along the axis (N)": Value(float(state.force[1]), 1e6, EXACT),
                  "radial over axial force": Value(float(state.force[0] / state.force[1]), float(ratio), EXACT),
                  "the same at the worst node": Value(float(np.abs(forces[:, 0] / forces[:, 1] / ratio - 1).max()), 0.0,
                                                      EXACT)}, answer,
                 replace(along(state, np.zeros_like, height, "y (m)", "pressure (Pa)"), exact=np.empty(0)))
