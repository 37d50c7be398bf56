"""Verification problems of what loads and supports bodies beyond stresses and clamps along x and y: fits that change,
foundations, pushed and turned partners, bolts, heat, inclined planes, and orthotropic materials."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from problems import (
    Found,
    Order,
    Value,
    along,
    along_x,
    annulus,
    block,
    body,
    contact,
    coulomb,
    degrees,
    mean_pressure,
    number,
    plane_strain,
    problem,
    solved,
)

STEEL = 2.1e11, 0.3
PLY = {"young": [1.4e11, 1.0e10, 2.0e10], "poisson": [0.3, 0.25, 0.4], "shear": 5.0e9, "angle": 30.0}


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
    return Found(values, answer, along(answer.contacts["one-ram"], float(borne[0]), along_x, "x (m)",
                                       "pressure (Pa)"))


@problem("remote-moment", "A cantilever under a remote moment", (1, 2, 4), "times finer than the coarsest mesh",
         orders=(2,), shows="A rigid partner brings a moment to a bonded face, from a pivot 100 m away, and no force.",
         scene="A beam of 10 m × 1 m, E = 1 GPa, ν = 0, clamped on the left; its right side is bonded to a rigid plane "
               "that turns about (110, 50) m under 1 kN·m/m.",
         source="Turn ML/EI, deflection ML²/2EI, and stress −M y/I; quadratic elements have this field.")
def remote_moment(n: int, order: Order, folder: Path) -> Found:
    young, length, moment, stiff = 1e9, 10.0, 1e3, 1e9 / 12
    answer = solved([body("beam", block(0, 0, length, 1.0, (10 * n, n), order), young, 0.0, ["left"])],
                    [contact("beam", "head", "right", kind="bonded")],
                    [{"name": "head", "shape": "plane", "point": [length, 0.0], "normal": [-1.0, 0.0],
                      "pivot": [length + 100.0, 50.0], "moment": moment}], 1e-12)
    head, turn = answer.summary["rigid"]["head"], moment * length / stiff
    at_clamp = answer.summary["bodies"]["beam"]["reactions"]["left"]
    state = answer.contacts["beam-head"]
    return Found({"turn (rad)": Value(head["turn"], turn, 1e-8),
                  "deflection (m)": Value(head["displacement"][1] - turn * 100.0, turn * length / 2, 1e-6),
                  "moment of the face about the pivot (N·m/m)": Value(-head["moment"], moment, 1e-9),
                  "force of the face, over M/L": Value(float(np.abs(head["force"]).max()) * length / moment, 0.0, 1e-9),
                  "moment at the clamp (N·m/m)": Value(-at_clamp["moment"], moment, 1e-8)}, answer,
                 along(state, lambda y: 12.0 * moment * (y - 0.5), lambda xy: xy[:, 1], "y (m)", "pressure (Pa)"))


@problem("bolted-joint", "A bolted joint", (1, 2, 4), "times finer than the coarsest meshes",
         shows="A tightened bolt has its force, then bears its part of a load, and all of it once the joint opens.",
         scene="Around an axis: a shank of 10 mm radius, cut at half its height of 100 mm, in a tube of 11 – 20 mm, "
               "E = 210 GPa and 70 GPa, ν = 0, under a rigid head; the cut has a pretension of 20 kN. Then the head is "
               "lifted by 10 kN, and by 50 kN. 3 : 4 elements across the cut.",
         source="F, then F + P k_b/(k_b + k_s) with k = EA/L, then P; the offset is F/k_b + F/k_s.")
def bolted_joint(n: int, order: Order, folder: Path) -> Found:
    force, load, steel, aluminium = 20e3, 10e3, 2.1e5, 7e4  # N, mm, MPa
    rollers = [{"on": "bottom", "y": 0.0}]
    bodies = [body("lower", block(0.0, 0.0, 10.0, 50.0, (3 * n, 5 * n), order), steel, 0.0, rollers),
              body("upper", block(0.0, 50.0, 10.0, 50.0, (4 * n, 5 * n), order), steel, 0.0),
              body("tube", block(11.0, 0.0, 9.0, 100.0, (2 * n, 8 * n), order), aluminium, 0.0, rollers)]
    head = {"name": "head", "shape": "plane", "point": [0.0, 100.0], "normal": [0.0, -1.0], "force": [0.0, load],
            "history": "work"}
    answer = solved(bodies, [contact("lower", "upper", "top", "bottom", name="cut", kind="bonded", pretension={
        "force": force, "along": [0.0, 1.0], "history": "tighten"}), contact("upper", "head", "top", kind="bonded"),
        contact("tube", "head", "top")], [head], 1e-12, axisymmetric=True, history={
            "tighten": {"times": [0.0, 1.0], "factors": [0.0, 1.0]},
            "work": {"times": [1.0, 2.0, 3.0], "factors": [0.0, 1.0, 5.0]}},
        time={"points": [1.0, 2.0, 3.0], "steps": 1})
    shank, tube = steel * np.pi * 100.0 / 100.0, aluminium * np.pi * (400.0 - 121.0) / 100.0
    bolt = [step["contacts"]["cut"]["pretension"] for step in answer.summary["steps"]]
    exact = [force, force + load * shank / (shank + tube), 5.0 * load]
    values = {f"force {when} (N)": Value(step["force"], float(value), 1e-8) for when, step, value in
              zip(("tightened", "under 10 kN", "under 50 kN"), bolt, exact, strict=True)}
    values |= {f"offset {when} (mm)": Value(step["offset"], force / shank + force / tube, 1e-8) for when, step in
               zip(("tightened", "under 50 kN"), bolt[::2], strict=True)}
    return Found(values, answer, along(answer.contacts["cut"], -5.0 * load / np.pi / 100.0, along_x, "r (mm)",
                                       "pressure (MPa)"))


@problem("mat", "A block on springs", (1, 2, 4), "times finer than the coarsest mesh",
         shows="A foundation is the only support of a body, also if it is a million times softer.",
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
    return Found(values, answer, along(answer.contacts["block-east"], p * poisson / (1 - poisson),
                                       lambda xy: xy[:, 1], "y (m)", "pressure of a wall (Pa)"))


@problem("loosened-fit", "A fit that loosens under a torque", (24, 48, 96), "sides around",
         shows="An interference that follows a history: tightened, turned, and let loose until it slips.",
         scene="Rings 20 – 40 – 60 mm, E = 210 GPa, ν = 0.3, plane strain, Coulomb 0.3, sides 4 : 5. The interference "
               "grows to 0.02 mm; the rim is turned to 0.8 of what friction bears; the interference falls to a half.",
         source="p = δ/Σ |b − R²/b|/(2G/(1 − 2ν) + 2GR²/b²) with the interference δ of the time and the rims R, which "
                "are clamped; M = 2πb²μp.")
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
    return Found(values, answer, along(state, p / 2, degrees, "angle (°)", "pressure (MPa)"))


@problem("expansion", "Free and constrained expansion", (1, 2, 4), "times finer than the coarsest meshes",
         shows="A temperature strains a body freely, or presses it.",
         scene="Two blocks of 2 m × 1 m on each other with rollers below; the lower one is heated by 80 K. First "
               "nothing is above them, then rollers on all other sides constrain them. E = 210 GPa, ν = 0.3, α = "
               "12e-6/K, no friction; 3 : 4 sides.",
         source="Free: u = (1 + ν) α T x, no stress. Constrained: the lower one would grow by (1 + ν)/(1 − ν) α T H, "
                "which the compliances H/M of both take up, M = E(1 − ν)/((1 + ν)(1 − 2ν)).")
def expansion(n: int, order: Order, folder: Path) -> Found:
    (young, poisson), alpha, warm = STEEL, 1.2e-5, 80.0
    left, sides = [{"on": "left", "x": 0.0}], [{"on": "left", "x": 0.0}, {"on": "right", "x": 0.0}]

    def pair(held: Sequence[dict], top: Sequence[dict]) -> list[dict]:
        return [body("upper", block(0, 1, 2, 1, (3 * n, 2 * n), order), young, poisson, [*held, *top]),
                body("lower", block(0, 0, 2, 1, (4 * n, 2 * n), order), young, poisson,
                     [*held, {"on": "bottom", "y": 0.0}], expansion=alpha) | {"temperature": warm}]

    weight = {"volume_force": [0.0, -1.0]}  # holds the upper block down, and is nothing beside heat
    upper, lower = pair(left, [])
    free = solved([upper | weight, lower], [contact("upper", "lower", "bottom", "top")]).bodies["lower"]
    grown = (1 + poisson) * alpha * warm * free.points
    answer = solved(pair(sides, [{"on": "top", "y": 0.0}]), [contact("upper", "lower", "bottom", "top")])
    modulus = young * (1 - poisson) / (1 + poisson) / (1 - 2 * poisson)
    exact = (1 + poisson) / (1 - poisson) * alpha * warm * modulus / 2
    state = answer.contacts["upper-lower"]
    return Found({"free: worst displacement": Value(float(np.abs(free.displacement - grown).max() / grown.max()), 0.0,
                                                    1e-7),
                  "constrained: worst pressure": Value(float(np.abs(state.pressure / exact - 1).max()), 0.0, 1e-7)},
                 answer, along(state, exact, along_x, "x (m)", "pressure (Pa)"))


@problem("heated-shaft", "A shrink fit by heat", (24, 48, 96), "sides around",
         shows="A shaft that is heated fits like one that is too large.",
         scene="Hollow shaft of 0.6 – 1 m in a ring of 1 – 1.5 m whose rim is clamped, both of steel, plane strain, "
               "Coulomb 0.2. The shaft is heated by 8 K, α = 12.5e-6/K; or its radius is 0.13 mm too large.",
         source="p = (1 + ν) α T / (u_o/p + u_i/p), Lamé in plane strain, with the outer ring's rim clamped.")
def heated_shaft(n: int, order: Order, folder: Path) -> Found:
    young, poisson = STEEL
    (E, nu), a, c, fit = plane_strain(young, poisson), 0.6, 1.5, 1.3 * 1.25e-5 * 8.0
    exact = fit * E / ((c**2 - 1) * (1 - nu**2) / (1 + nu + (1 - nu) * c**2) + (1 + a**2) / (1 - a**2) - nu)

    def fitted(heat: float | None) -> tuple:
        shaft = body("shaft", annulus((a, 1.0), (n, n // 8), order, folder, (0.0, 360.0)), young, poisson,
                     **({"expansion": 1.25e-5} if heat else {})) | ({"temperature": heat} if heat else {})
        ring = body("ring", annulus((1.0, c), (n, n // 8), order, folder, (0.0, 360.0)), young, poisson, ["outer"])
        answer = solved([shaft, ring], [contact("shaft", "ring", "outer", "inner", friction=coulomb(0.2),
                                                **({} if heat else {"gap": -fit}))], tolerance=1e-10)
        return answer, answer.contacts["shaft-ring"]

    (answer, heated), (_, large) = fitted(8.0), fitted(None)
    return Found({"mean pressure (Pa)": Value(mean_pressure(heated), exact, 0.02 if order == 1 else 2e-3),
                  "worst node, heated less too large": Value(
                      float(np.abs(heated.pressure / large.pressure - 1).max()), 0.0, 1e-7)},
                 answer, along(heated, exact, degrees, "angle (°)", "pressure (Pa)"))


@problem("sector", "A sector on inclined planes of symmetry", (1, 2, 4), "times finer than the coarsest meshes",
         shows="Clamps along normals act at any angle like clamps along the axes.",
         scene="Two blocks of 2 m × 1 m and 2 m × 0.5 m on planes of symmetry at the left and below, pressed and "
               "sheared, Coulomb 0.2; the same turned by 33°.",
         source="The scene along the axes, computed.")
def sector(n: int, order: Order, folder: Path) -> Found:
    def turned(angle: float):
        c, s = np.cos(np.radians(angle)), np.sin(np.radians(angle))

        def turn(x: float, y: float) -> list[float]:
            return [float(c * x - s * y), float(s * x + c * y)]

        def part(name: str, low: float, high: float, divisions: tuple[int, int], clamp: list, loads: dict) -> dict:
            mesh = {"shape": "quadrilateral", "divisions": list(divisions), "order": number(order),
                    "corners": [turn(*at) for at in ((0, low), (2, low), (2, high), (0, high))]}
            return body(name, mesh, *STEEL, clamp, {on: turn(*value) for on, value in loads.items()})

        plane = [{"on": "left", "normal": 0.0}]
        return solved([part("lower", 0, 1, (6 * n, 3 * n), [*plane, {"on": "bottom", "normal": 0.0}], {}),
                       part("upper", 1, 1.5, (8 * n, 2 * n), plane, {"top": (3e7, -1e8), "right": (5e6, 1e6)})],
                      [contact("lower", "upper", "top", "bottom", friction=coulomb(0.2))], tolerance=1e-11), turn

    (upright, _), (inclined, turn) = turned(0.0), turned(33.0)
    one, other = (each.contacts["lower-upper"] for each in (upright, inclined))
    u, v = (each.bodies["upper"].displacement for each in (upright, inclined))
    back = v @ np.array([turn(1, 0), turn(0, 1)]).T
    return Found({"worst contact force, inclined less upright": Value(
        float(np.abs(other.normal_force - one.normal_force).max() / one.normal_force.max()), 0.0, 1e-9),
        "worst displacement, inclined less upright": Value(float(np.abs(back - u).max() / np.abs(u).max()), 0.0, 1e-9)},
        inclined, along(one, lambda x: np.interp(x, *one.interface.xy.T[:1], one.pressure), along_x,
                        "x (m)", "pressure (Pa)", values=other.pressure))


@problem("plies", "Orthotropic plies at an angle", (1, 2, 4), "times finer than the coarsest meshes",
         shows="The stiffness of an orthotropic strip off its axes, in plane stress and plane strain.",
         scene="Two plies of 2 m × 1 m with fibres at 30° and free sides, pressed by 1 mm; E = 140, 10, 20 GPa, "
               "ν = 0.3, 0.25, 0.4, G12 = 5 GPa, Coulomb 0.3; 3 : 4 sides.",
         source="p = δ/(S_yy Σ H), S_yy = s⁴S₁₁ + c⁴S₂₂ + s²c²(2S₁₂ + 1/G₁₂); in plane strain S_ij less S_i3 S_j3/S₃₃.")
def plies(n: int, order: Order, folder: Path) -> Found:
    (E1, E2, E3), (n12, n13, n23), c, s = PLY["young"], PLY["poisson"], 3**0.5 / 2, 0.5
    values = {}
    for plane in ("stress", "strain"):
        S11, S22, S12, held = 1 / E1, 1 / E2, -n12 / E1, plane == "strain"
        S11, S22 = S11 - held * n13**2 * E3 / E1**2, S22 - held * n23**2 * E3 / E2**2
        S12 -= held * n13 * n23 * E3 / E1 / E2
        exact = 1e-3 / 2 / (s**4 * S11 + c**4 * S22 + s**2 * c**2 * (2 * S12 + 1 / PLY["shear"]))

        def ply(name: str, y: int, across: int, clamp: dict, plane: str = plane) -> dict:
            return {"name": name, "mesh": block(0, y, 2, 1, (across * n, 2 * n), order), "clamp": [clamp],
                    "material": PLY | {"plane": plane}}

        answer = solved([ply("upper", 1, 3, {"on": "top", "normal": -1e-3}),
                         ply("lower", 0, 4, {"on": "bottom", "normal": 0.0})],
                        [contact("upper", "lower", "bottom", "top", friction=coulomb(0.3))])
        state = answer.contacts["upper-lower"]
        values[f"worst pressure, plane {plane}"] = Value(float(np.abs(state.pressure / exact - 1).max()), 0.0, 1e-7)
    return Found(values, answer, along(state, exact, along_x, "x (m)", "pressure (Pa)"))
