"""Verification problems around an axis: patches, fits, Hertz's balls, a flat punch, a ring on a cone."""

from __future__ import annotations

import functools
from pathlib import Path

import numpy as np

from problems import (
    ANGLE,
    AROUND,
    Order,
    Results,
    Y,
    along,
    distance,
    mean_pressure,
    problem,
    worst,
)
from problems.bodies import (
    RADIUS,
    annulus,
    between,
    block,
    body,
    contact,
    coulomb,
    draw,
    held,
    plane,
    solved,
)
from problems.flat import EXACT, TIGHT, frames
from problems.forms import hertz_values, lame_ball, lame_fit, plane_strain, shear

turned = functools.partial(solved, axisymmetric=True)
"""The answer of an axisymmetric scene."""


# Patch tests


@problem("NAFEMS CGS-1 around an axis")
def cgs_1_turned(n: int, order: Order, folder: Path) -> Results:
    upper, lower = frames((0.0, 2.0), (0.0, 2.0), 0.3 / n, order, folder)
    exact = 1e-3 / (1 / 1e9 + 1 / 1e10)
    answer = turned(
        [
            body("upper", upper, 1e9, 0.3, held(far={"y": -1e-3})),
            body("lower", lower, 1e10, 0.2, held(far="y")),
        ],
        [contact("upper", "lower", "seam", "seam")],
        tolerance=TIGHT,
    )
    state = answer.contacts["upper-lower"]
    return (
        {
            "force (N)": (state.normal_force.sum(), 4 * np.pi * exact, EXACT),
            "worst node": (worst(state, exact), EXACT),
        },
        answer,
        along(state, exact, AROUND),
    )


@problem("Constant stress through a cone")
def cone_patch(n: int, order: Order, folder: Path) -> Results:
    strain, E, nu = np.array([-1e-3, -2e-3]), 1e9, 0.3
    field = {axis: f"{each} * {axis}" for axis, each in zip("xy", strain.tolist(), strict=True)}
    inner = between([(0, 0), (1.0, 0), (0.5, 1), (0, 1)], (4 * n, 5 * n), order)
    outer = between([(1.0, 0), (2, 0), (2, 1), (0.5, 1)], (5 * n, 7 * n), order)
    answer = turned(
        [
            body("cone", inner, E, nu, held(bottom=field, top=field)),
            body("hollow", outer, E, nu, held(bottom=field, right=field, top=field)),
        ],
        [contact("cone", "hollow", "right", "left", friction=coulomb(1.0))],
        tolerance=TIGHT,
    )
    stress = E * nu / (1 + nu) / (1 - 2 * nu) * (strain @ [2, 1]) + 2 * shear(E, nu) * strain
    normal = np.array([1.0, 0.5]) / np.hypot(1.0, 0.5)
    tangent = np.array([-normal[1], normal[0]])
    state, exact = answer.contacts["cone-hollow"], -float(stress @ normal**2)
    return (
        {"worst node": (worst(state, exact, -float(stress * normal @ tangent)), EXACT)},
        answer,
        along(state, exact, Y),
    )


# Fits


@problem("Two tubes with interference, around an axis", (2, 4, 8), "elements across the wall")
def tubes_turned(n: int, order: Order, folder: Path) -> Results:
    a, b, c, fit, values = 0.3, 0.6, 0.9, 6e-5, {}
    materials = (2e11, 0.3), (1e11, 0.25)
    for ends, clamp in (("fixed", held(bottom="y", top="y")), ("free", held(bottom="y"))):
        answer = turned(
            [
                body("inner", block(a, 0.0, b - a, 0.2, (n, n), order), *materials[0], clamp),
                body(
                    "outer", block(b, 0.0, c - b, 0.2, (n, n + n // 2), order), *materials[1], clamp
                ),
            ],
            [contact("inner", "outer", "right", "left", gap=-fit)],
        )
        exact = lame_fit(
            a, b, c, fit, *(plane_strain(*each) if ends == "fixed" else each for each in materials)
        )
        state = answer.contacts["inner-outer"]
        values[f"{ends} ends: mean pressure (Pa)"] = (
            mean_pressure(state),
            exact,
            0.05 if order == 1 else 2e-3,
        )
    return values, answer, along(state, exact, Y)


@problem(
    "A ball in a shell with interference, around an axis", (3, 6, 10), "elements across the shell"
)
def spheres_turned(n: int, order: Order, folder: Path) -> Results:
    a, b, c, fit, material = 0.25, 0.5, 1.0, 5e-5, (2e11, 0.3)
    answer = turned(
        [
            body("ball", annulus((a, b), (4 * n, n), order, folder), *material, held(start="y")),
            body("shell", annulus((b, c), (5 * n, n), order, folder), *material, held(start="y")),
        ],
        [contact("ball", "shell", "outer", "inner", gap=-fit)],
    )
    state, exact = answer.contacts["ball-shell"], lame_ball(a, b, c, fit, *material)
    return (
        {"mean pressure (Pa)": (mean_pressure(state), exact, 0.06 if order == 1 else 2e-3)},
        answer,
        along(state, exact, ANGLE._replace(label="latitude (°)")),
    )


# Balls and punches


def half_ball(path: Path, a: float, n: int, order: Order, up: float = 1.0) -> dict:
    """Half of a half ball that touches y = 0 in the origin, above (`up` 1) or below (−1), with n elements on a.

    Groups: contact, as far as 1.6 a; top, its flat face.
    """
    reach = np.arcsin(1.6 * a / RADIUS)
    corners = {
        "pole": (0.0, 0.0),
        "rim": (RADIUS * np.sin(reach), up * RADIUS * (1 - np.cos(reach))),
        "side": (RADIUS, up * RADIUS),
        "centre": (0.0, up * RADIUS),
    }
    lines = {
        "contact": "pole centre rim",
        "outer": "rim centre side",
        "top": "side centre",
        "axis": "centre pole",
    }
    h = a / n / int(order)  # quadratic elements are drawn twice as large
    return draw(
        path, corners, lines, f"min(0.1, {h} + 0.2 * max(0, sqrt(x*x + y*y) - {1.25 * a}))", order
    )


@problem("A ball on a rigid plane, around an axis", (4, 8, 16), "nodes on a")
def hertz_turned(n: int, order: Order, folder: Path) -> Results:
    ball = body(
        "ball", half_ball(folder / "ball.msh", 0.05, n, order), 1.0, 0.3, held(top={"y": -0.0026})
    )
    answer = turned(
        [ball], [contact("ball", "floor", "contact")], [plane("floor", (0.0, 0.0), (0.0, 1.0))]
    )
    values, curve = hertz_values(
        answer.contacts["ball-floor"],
        1,
        plane_strain(1.0, 0.3)[0],
        RADIUS,
        (0.06,) * 2 if n < 8 else (0.02,) * 2,
    )
    return values, answer, curve


@problem("Two balls of unlike stiffness, around an axis", (4, 8, 16), "nodes on a of the soft ball")
def two_balls_turned(n: int, order: Order, folder: Path) -> Results:
    soft = half_ball(folder / "soft.msh", 0.055, n, order)
    stiff = half_ball(folder / "stiff.msh", 0.055, n + n // 4, order, up=-1.0)
    answer = turned(
        [
            body("soft", soft, 1.0, 0.3, held(top={"y": -0.006})),
            body("stiff", stiff, 5.0, 0.2, held(top="y")),
        ],
        [contact("soft", "stiff", "contact", "contact")],
    )
    modulus = 1.0 / ((1.0 - 0.09) / 1.0 + (1.0 - 0.04) / 5.0)
    values, curve = hertz_values(
        answer.contacts["soft-stiff"], 1, modulus, RADIUS / 2, (0.08,) * 2 if n < 8 else (0.03,) * 2
    )
    return values, answer, curve


@problem("A flat punch", (8, 16, 32), "nodes on a")
def flat_punch(n: int, order: Order, folder: Path) -> Results:
    size = f"{1.0 / n / int(order)} + 0.25 * max(0, abs(sqrt(x*x + y*y) - 1) - 0.5)"
    corners = {
        "o": (0.0, 0.0),
        "rim": (1.0, 0.0),
        "edge": (50.0, 0.0),
        "far": (50.0, -50.0),
        "base": (0.0, -50.0),
    }
    lines = {
        "axis": "base o",
        "seat": "o rim",
        "free": "rim edge",
        "side": "edge far",
        "bottom": "far base",
    }
    mesh = draw(folder / "block.msh", corners, lines, size, order)
    answer = turned(
        [body("block", mesh, 1.0, 0.3, held(bottom="y"))],
        [contact("block", "floor", "seat")],
        [plane("floor", (0.0, 0.0), (0.0, -1.0), displacement=[0.0, -0.01])],
    )
    state = answer.contacts["block-floor"]
    force, r = float(state.normal_force.sum()), state.interface.xy[:, 0]

    def pressure(x: np.ndarray) -> np.ndarray:
        return force / (2 * np.pi * np.sqrt(1.0 - x**2))

    near = r < 0.8
    error = distance(state.pressure[near], pressure(r[near]), state.interface.area[near])
    return (
        {
            "force (N)": (force, 2.0 / 0.91 * 0.01, 0.08),
            "pressure up to 0.8 a, in L2": (error, 0.12),
        },
        answer,
        along(state, pressure, AROUND, limit=0.95),
    )


@problem("A ring that is pushed onto a cone")
def ring_on_cone(n: int, order: Order, folder: Path) -> Results:
    slope, friction = np.radians(20.0), 0.15
    c, s = float(np.cos(slope)), float(np.sin(slope))
    mesh = between(
        [(1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0 - np.tan(slope), 1.0)], (4 * n, 4 * n), order
    )
    ring = body("ring", mesh, 1e9, 0.3) | {"traction": [{"on": "top", "force": [0.0, -1e6]}]}
    answer = turned(
        [ring],
        [contact("ring", "floor", "left", friction=coulomb(friction))],
        [plane("floor", (1.0, 0.0), (c, s))],
        tolerance=TIGHT,
    )
    state, ratio = answer.contacts["ring-floor"], (c - friction * s) / (s + friction * c)
    forces = state.forces[state.status != "open"]
    return (
        {
            "force along the axis (N)": (state.force[1], 1e6, EXACT),
            "radial over axial force": (state.force[0] / state.force[1], ratio, EXACT),
            "the same at the worst node": (
                np.abs(forces[:, 0] / forces[:, 1] / ratio - 1).max(),
                EXACT,
            ),
        },
        answer,
        along(state, np.zeros_like, Y)._replace(exact=np.empty(0)),
    )
