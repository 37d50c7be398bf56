"""Verification problems of what presses and supports bodies: fits that change, foundations,
and rigid partners that are pushed."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from problems import Found, Order, Value, along, annulus, block, body, contact, coulomb, degrees, problem, solved


@problem("ram", "A ram on two bars", (1, 2, 4), "times finer than the coarsest meshes",
         shows="A rigid partner that is pushed finds its place, across a clearance, and shares the force out.",
         scene="Bars of 1 m and 0.999 m height, 1 m wide, E = 1 GPa, ν = 0, on rollers; 0.2 m above them a rigid ram "
               "that is pushed down by 3 MN/m; no friction.",
         source="Springs side by side: δ = (F + k₂ g)/(k₁ + k₂), k = E/H, g = 1 mm.")
def ram(n: int, order: Order, folder: Path) -> Found:
    young, force, heights, lift = 1e9, 3e6, (1.0, 0.999), 0.2
    rollers = [{"on": "left", "x": 0.0}, {"on": "bottom", "y": 0.0}]
    stiffness = young / np.array(heights)
    down = (force + stiffness[1] * (heights[0] - heights[1])) / stiffness.sum()
    borne = stiffness * (down - np.array([0.0, heights[0] - heights[1]]))
    answer = solved([body(name, block(2.0 * k, 0, 1.0, height, ((3 + k) * n, 2 * n), order), young, 0.0, rollers)
                     for k, (name, height) in enumerate(zip(("one", "two"), heights, strict=True))],
                    [contact(name, "ram", "top") for name in ("one", "two")],
                    [{"name": "ram", "shape": "plane", "point": [0.0, heights[0] + lift], "normal": [0.0, -1.0],
                      "force": [0.0, -force]}], 1e-12)
    place = answer.summary["rigid"]["ram"]
    values = {"displacement (m)": Value(place["displacement"][1], -lift - down, 1e-10),
              "balance of the ram (N/m)": Value(place["force"][1], force, 1e-10)}
    values |= {f"force on {name} (N/m)": Value(answer.summary["contacts"][f"{name}-ram"]["normal_force"],
                                               float(value), 1e-8) for name, value in zip(("one", "two"), borne,
                                                                                           strict=True)}
    return Found(values, answer, along(answer.contacts["one-ram"], lambda x: np.full(len(x), borne[0]),
                                       lambda xy: xy[:, 0], "x (m)", "pressure (Pa)"))


@problem("mat", "A block on springs", (1, 2, 4), "times finer than the coarsest mesh",
         shows="A foundation holds a body that nothing else holds, also where it is a million times softer.",
         scene="A block of 2 m × 1 m between rigid walls on springs of 1 GN/m³, 1 MN/m³ and 1 kN/m³, pressed by "
               "1 MPa from above; E = 1 GPa, ν = 0.3, no friction.",
         source="u = p/k below, and pH/M more above, M = E(1 − ν)/((1 + ν)(1 − 2ν)); the walls bear ν/(1 − ν) p.")
def mat(n: int, order: Order, folder: Path) -> Found:
    young, poisson, p, height = 1e9, 0.3, 1e6, 1.0
    confined = young * (1 - poisson) / (1 + poisson) / (1 - 2 * poisson)
    walls = [{"name": name, "shape": "plane", "point": [x, 0.0], "normal": [sign, 0.0]}
             for name, x, sign in (("west", 0.0, 1.0), ("east", 2.0, -1.0))]
    values = {}
    for stiffness in (1e3, 1e6, 1e9):
        made = body("block", block(0, 0, 2, height, (4 * n, 3 * n), order), young, poisson, [], {"top": (0.0, -p)})
        answer = solved([made | {"foundation": [{"on": "bottom", "normal": stiffness}]}],
                        [contact("block", wall, side) for wall, side in (("west", "left"), ("east", "right"))], walls)
        fields = answer.bodies["block"]
        down = -fields.displacement[:, 1]
        low, high = (down[np.isclose(fields.points[:, 1], y)] for y in (0.0, height))
        values |= {f"below, k = {stiffness:g} (m)": Value(float(low.mean()), p / stiffness, 1e-7),
                   f"above less below, k = {stiffness:g} (m)": Value(float(high.mean() - low.mean()),
                                                                      p * height / confined, 1e-7),
                   f"worst node below, k = {stiffness:g}": Value(float(np.ptp(low) * stiffness / p), 0.0, 1e-7)}
    return Found(values, answer, along(answer.contacts["block-east"],
                                       lambda y: np.full(len(y), p * poisson / (1 - poisson)), lambda xy: xy[:, 1],
                                       "y (m)", "pressure of a wall (Pa)"))


@problem("loosened-fit", "A fit that loosens under a torque", (24, 48, 96), "sides around",
         shows="An interference that follows a history: tightened, turned, and let loose until it slips.",
         scene="Rings 20 – 40 – 60 mm, E = 210 GPa, ν = 0.3, plane strain, Coulomb 0.3, sides 4 : 5. The interference "
               "grows to 0.02 mm; the rim is turned to 0.8 of what friction bears; the interference falls to a half.",
         source="p = δ/Σ |b − R²/b|/(2G/(1 − 2ν) + 2GR²/b²) with the interference δ of the time and the rims R, which "
                "are held; M = 2πb²μp.")
def loosened_fit(n: int, order: Order, folder: Path) -> Found:
    a, b, c, fit, E, nu, mu = 20.0, 40.0, 60.0, 0.02, 2.1e5, 0.3, 0.3
    G = E / 2 / (1 + nu)
    p = fit / sum(abs(b - rim**2 / b) / (2 * G / (1 - 2 * nu) + 2 * G * rim**2 / b**2) for rim in (a, c))
    limit = 2 * np.pi * b**2 * mu * p
    angle = limit * (1 / a**2 - 1 / c**2) / (4 * np.pi * G)

    def ring(name: str, radii: tuple[float, float], around: int, clamp: list) -> dict:
        return body(name, annulus(radii, (around, n // 4), order, folder, (0.0, 360.0)), E, nu, clamp)

    turned = {"on": "outer", "x": f"-{angle!r} * y", "y": f"{angle!r} * x", "history": "turn"}
    answer = solved([ring("shaft", (a, b), n, ["inner"]), ring("hub", (b, c), 5 * n // 4, [turned])],
                    [contact("shaft", "hub", "outer", "inner", friction=coulomb(mu),
                             gap={"value": -fit, "history": "tighten"})],
                    history={"tighten": {"times": [0.0, 1.0, 2.0, 3.0], "factors": [0.0, 1.0, 1.0, 0.5]},
                             "turn": {"times": [1.0, 2.0], "factors": [0.0, 0.8]}},
                    time={"points": [1.0, 2.0, 3.0], "steps": 2})
    moments = {step["time"]: step["contacts"]["shaft-hub"]["moment"] for step in answer.summary["steps"]}
    state, near = answer.contacts["shaft-hub"], {1: 5e-2, 2: 3e-3}[order]
    values = {"torque turned (N mm/mm)": Value(moments[2.0], 0.8 * limit, near),
              "torque loosened (N mm/mm)": Value(moments[3.0], 0.5 * limit, near),
              "residual of energies": Value(answer.summary["energy"]["residual"], 0.0, 1e-9)}
    return Found(values, answer, along(state, lambda x: np.full(len(x), p / 2), degrees, "angle (°)",
                                       "pressure (MPa)"))
