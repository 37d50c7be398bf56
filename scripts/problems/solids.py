"""Verification problems in space: Hertz, Cattaneo and Mindlin, Lubkin, fits of tubes and spheres, exact stacks."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import far_free
import numpy as np
from mpi4py import MPI
from scenes import to_toml
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

import ddmpi
from ddmpi.interface.state import ContactState
from ddmpi.mesh.read import gmsh_session
from ddmpi.run.answer import Answer
from problems import (
    Curve,
    Found,
    Order,
    Value,
    along,
    along_x,
    body,
    contact,
    coulomb,
    degrees,
    distance,
    hertz_values,
    lame_ball,
    lame_fit,
    mean_pressure,
    plane_strain,
    problem,
    solved,
)

RADIUS = 1.0
"""Of the balls (m)."""

PLANES = [{"on": "start", "y": 0.0}, {"on": "end", "x": 0.0}]
"""How a quarter is held on its planes of symmetry."""

Test = Callable[[np.ndarray], np.ndarray]
"""Which of points (k, 3) lie on a surface."""


# Meshes

def revolved(path: Path, profile: list[tuple[float, float]], arcs: Mapping[int, tuple[float, float]], turn: float,
             groups: Mapping[str, Test], size: Callable[[np.ndarray], float], order: Order) -> dict:
    """The mesh of a body that a profile in the plane y = 0 sweeps as it turns about z, by gmsh.

    Parameters
    ----------
    profile : corners (x, z), around it
    arcs : the centres (x, z) of the sides after some of the corners, by their number
    turn : degrees
    groups : tests of points on the surfaces, the first that holds counts
    size : of the elements at a point
    """
    with gmsh_session() as gmsh:
        occ = gmsh.model.occ
        corners = [occ.addPoint(x, 0.0, z) for x, z in profile]
        lines = []
        for k, (start, end) in enumerate(zip(corners, [*corners[1:], corners[0]], strict=True)):
            centre = occ.addPoint(arcs[k][0], 0.0, arcs[k][1]) if k in arcs else None
            lines.append(occ.addLine(start, end) if centre is None else occ.addCircleArc(start, centre, end))
        occ.revolve([(2, occ.addPlaneSurface([occ.addCurveLoop(lines)]))], 0, 0, 0, 0, 0, 1, np.radians(turn))
        occ.synchronize()
        found: dict[str, list[int]] = {}
        for _, tag in gmsh.model.getBoundary(gmsh.model.getEntities(3), oriented=False):
            low, high = gmsh.model.getParametrizationBounds(2, tag)
            at = [low + part * (high - low) for part in (np.array([0.3, 0.3]), np.array([0.7, 0.5]))]
            points = np.reshape(gmsh.model.getValue(2, tag, np.concatenate(at)), (-1, 3))
            name = next((name for name, test in groups.items() if test(points).all()), None)
            if name:
                found.setdefault(name, []).append(tag)
        for name, tags in found.items():
            gmsh.model.addPhysicalGroup(2, tags, name=name)
        gmsh.model.addPhysicalGroup(3, [tag for _, tag in gmsh.model.getEntities(3)], name="body")
        for option in ("MeshSizeFromPoints", "MeshSizeExtendFromBoundary", "MeshSizeFromCurvature"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        gmsh.option.setNumber("General.NumThreads", 1)
        gmsh.model.mesh.setSizeCallback(lambda dim, tag, x, y, z, size_of: size(np.array([x, y, z])))
        gmsh.model.mesh.generate(3)
        gmsh.model.mesh.setOrder(int(order))
        gmsh.write(str(path))
    return {"file": str(path), "order": int(order)}


def half_ball(path: Path, a: float, h: float, order: Order, turn: float = 90.0, down: bool = False) -> dict:
    """A part of a half ball that touches the plane z = 0 in the origin from above, or from below.

    Groups: contact, as far as 1.6 a; top, its flat face; start (y = 0) and, of a quarter, end (x = 0).
    """
    sign, reach = -1.0 if down else 1.0, np.arcsin(1.6 * a / RADIUS)
    rim = (RADIUS * np.sin(reach), sign * RADIUS * (1.0 - np.cos(reach)))
    profile, middle = [(0.0, 0.0), rim, (RADIUS, sign * RADIUS), (0.0, sign * RADIUS)], (0.0, sign * RADIUS)

    def sphere(p: np.ndarray) -> np.ndarray:
        return np.abs(np.linalg.norm(p - [0.0, 0.0, sign * RADIUS], axis=1) - RADIUS) < 1e-7

    across = {"start": lambda p: (np.abs(p[:, 1]) < 1e-9) & (p[:, 0] > 0.0)}
    across["end"] = (lambda p: np.abs(p[:, 0]) < 1e-9) if turn == 90.0 else (lambda p: np.abs(p[:, 1]) < 1e-9)
    groups = {"top": lambda p: np.abs(p[:, 2] - sign * RADIUS) < 1e-9, **across,
              "contact": lambda p: sphere(p) & (np.hypot(p[:, 0], p[:, 1]) < 1.6 * a + 1e-9), "outer": sphere}
    return revolved(path, profile, {0: middle, 1: middle}, turn, groups,
                    lambda x: min(0.3, h + 0.35 * max(0.0, float(np.linalg.norm(x)) - 1.25 * a)), order)


def tube(path: Path, inner: float, outer: float, h: float, order: Order) -> dict:
    """A quarter of a tube 0.2 m long, with groups inner, outer, bottom, top, start and end."""
    def radius(wanted: float) -> Test:
        return lambda p: np.abs(np.hypot(p[:, 0], p[:, 1]) - wanted) < 1e-7

    groups = {"bottom": lambda p: np.abs(p[:, 2]) < 1e-9, "top": lambda p: np.abs(p[:, 2] - 0.2) < 1e-9,
              "start": lambda p: np.abs(p[:, 1]) < 1e-9, "end": lambda p: np.abs(p[:, 0]) < 1e-9,
              "inner": radius(inner), "outer": radius(outer)}
    profile = [(inner, 0.0), (outer, 0.0), (outer, 0.2), (inner, 0.2)]
    return revolved(path, profile, {}, 90.0, groups, lambda x: h, order)


def shell(path: Path, inner: float, outer: float, h: float, order: Order) -> dict:
    """An octant of a spherical shell, with groups inner, outer, start, end and bottom."""
    def radius(wanted: float) -> Test:
        return lambda p: np.abs(np.linalg.norm(p, axis=1) - wanted) < 1e-7

    groups = {"bottom": lambda p: np.abs(p[:, 2]) < 1e-9, "start": lambda p: np.abs(p[:, 1]) < 1e-9,
              "end": lambda p: np.abs(p[:, 0]) < 1e-9, "inner": radius(inner), "outer": radius(outer)}
    profile = [(inner, 0.0), (outer, 0.0), (0.0, outer), (0.0, inner)]
    return revolved(path, profile, {1: (0.0, 0.0), 3: (0.0, 0.0)}, 90.0, groups, lambda x: h, order)


# Hertz

ALLOWED = {1: (0.1, 0.06), 2: (0.06, 0.06)}
"""Of p₀ and a, by the order."""


def nodal_pressures(state: ContactState, curve: Curve) -> dict[str, Value]:
    """How far the pressures at nodes, D_j⁻¹ ∫ p φ_j, are in L2 from those of Hertz at the nodes, and from what his
    pressure itself has for them, its means with the hats φ_j as weights."""
    xy, facets, K = state.interface.xy[:, :2], state.interface.facets, 12
    i, j = np.divmod(np.arange(K * K), K)
    inner = np.concatenate([np.column_stack([i, j])[i + j < K] + 1 / 3, np.column_stack([i, j])[i + j < K - 1] + 2 / 3])
    hats = np.column_stack([inner / K, 1.0 - inner.sum(axis=1) / K])  # at the middles of K² parts of a facet

    def hertz(places: np.ndarray) -> np.ndarray:
        return np.interp(np.linalg.norm(places, axis=-1), curve.exact_x, curve.exact, right=0.0)

    size = np.abs(np.linalg.det(xy[facets[:, 1:]] - xy[facets[:, :1]])) / 2.0
    integrals, area = np.zeros((2, len(xy)))
    np.add.at(integrals, facets, size[:, None] * (hertz(hats @ xy[facets]) @ hats) / K**2)
    np.add.at(area, facets, size[:, None] / 3.0)
    means = np.divide(integrals, area, out=np.zeros(len(xy)), where=area > 0.0)
    return {f"nodal pressures, from Hertz's {words}": Value(distance(state.pressure, p, state.interface.area), 0.0, 0.2)
            for words, p in (("at nodes", hertz(xy)), ("means about nodes", means))}


@problem("hertz-solid", "A ball on a rigid plane", (3, 5, 8), "elements on a",
         shows="Rows at the vertices of linear and quadratic facets, and gaps of curved ones.",
         scene="A quarter of a half ball, R = 1 m, E = 1 Pa, ν = 0.3, whose flat face is moved by 7.5 mm; a ≈ 0.088 m.",
         source="Hertz, for the force that was computed: a³ = 3PR/(4E*), p₀ = 3P/(2πa²).")
def hertz_solid(n: int, order: Order, folder: Path) -> Found:
    mesh = half_ball(folder / "ball.msh", 0.1, 0.088 / n, order)
    answer = solved([body("ball", mesh, 1.0, 0.3, [*PLANES, {"on": "top", "z": -0.0075}])],
                    [contact("ball", "floor", "contact")],
                    [{"name": "floor", "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}])
    state = answer.contacts["ball-floor"]
    values, curve = hertz_values(state, 4, 1.0 / (1.0 - 0.09), RADIUS, ALLOWED[int(order)])
    return Found(values | nodal_pressures(state, curve), answer, curve)


@problem("two-balls", "Two balls of unlike stiffness", (3, 5, 8), "elements on a of the soft ball",
         shows="Two curved surfaces whose meshes do not match.",
         scene="Quarters of half balls, R = 1 m, E = 1 and 5 Pa, ν = 0.3 and 0.2, elements 4 : 5, approached by 9 mm.",
         source="Hertz, for the force that was computed.")
def two_balls(n: int, order: Order, folder: Path) -> Found:
    soft = half_ball(folder / "soft.msh", 0.08, 0.066 / n, order)
    stiff = half_ball(folder / "stiff.msh", 0.08, 0.053 / n, order, down=True)
    answer = solved([body("soft", soft, 1.0, 0.3, [*PLANES, {"on": "top", "z": -0.009}]),
                     body("stiff", stiff, 5.0, 0.2, [*PLANES, {"on": "top", "z": 0.0}])],
                    [contact("soft", "stiff", "contact", "contact")])
    modulus = 1.0 / ((1.0 - 0.09) / 1.0 + (1.0 - 0.04) / 5.0)
    state = answer.contacts["soft-stiff"]
    values, curve = hertz_values(state, 4, modulus, RADIUS / 2, ALLOWED[int(order)])
    return Found(values | nodal_pressures(state, curve), answer, curve)


# Cattaneo and Mindlin

@problem("cattaneo-mindlin", "A ball that is pressed and rubbed", (4, 8), "elements on a", orders=(1,),
         shows="Friction with a memory in space: slip as vectors, a zone that sticks, energy lost in a loop.",
         scene="Halves of two half balls, R = 1 m, E = 1 Pa, ν = 0, 𝓕 = 0.5, a ≈ 0.03 m; the upper flat face is moved "
               "by 1.8 mm, then along x to and fro, to about ¾ of the sliding force; 8 load steps each way.",
         source="Cattaneo 1938, Mindlin 1949, for the forces that were computed: c = a (1 − Q/𝓕P)^⅓; energy of a loop "
                "by Mindlin and Deresiewicz 1953.")
def cattaneo(n: int, order: Order, folder: Path) -> Found:
    friction, approach, gives = 0.5, 0.0018, 8.0  # the last: Σ (2 − ν)/G
    upper = half_ball(folder / "upper.msh", 0.03, 0.03 / n, order, turn=180.0)
    lower = half_ball(folder / "lower.msh", 0.03, 0.03 / n, order, turn=180.0, down=True)
    plane = [{"on": "start", "y": 0.0}, {"on": "end", "y": 0.0}]
    a = np.sqrt(RADIUS / 2 * approach)
    push = 3.0 / 16.0 * friction * (2.0 / 3.0 * a * approach) / a * gives * (1.0 - 0.25 ** (2 / 3))
    top = [{"on": "top", "y": 0.0, "z": -approach}, {"on": "top", "x": 1.0, "history": "rub"}, *plane]
    scene = {"body": [body("upper", upper, 1.0, 0.0, top), body("lower", lower, 1.0, 0.0, ["top", *plane])],
             "contact": [contact("upper", "lower", "contact", "contact", friction=coulomb(friction))],
             "history": {"rub": {"times": [1.0, 2.0, 3.0, 4.0], "factors": [0.0, push, -push, push]}},
             "time": {"points": [1.0, 2.0, 3.0, 4.0], "steps": 8}}
    answer = ddmpi.solve(to_toml(scene), MPI.COMM_SELF)
    if not answer.certified:
        raise RuntimeError(answer.reason)
    state, steps = answer.contacts["upper-lower"], [step["contacts"]["upper-lower"] for step in answer.summary["steps"]]
    P, Q = 2.0 * steps[31]["normal_force"], 2.0 * abs(steps[31]["force"][0])
    a, share = (3.0 * P * RADIUS / 2 / (4.0 * 0.5)) ** (1 / 3), Q / (friction * P)
    inner = a * (1.0 - share) ** (1 / 3)
    loop = 9.0 * (friction * P) ** 2 / (10.0 * a) * gives * (
        1.0 - (1.0 - share) ** (5 / 3) - 5.0 / 6.0 * share * (1.0 + (1.0 - share) ** (2 / 3)))
    sticks = state.status == "stick"
    values = {"loop of energy (J)": Value(2.0 * sum(step["dissipated"] for step in steps[16:]), loop, 0.3),
              "stick radius (m)": Value(float(np.sqrt(2.0 * state.interface.area[sticks].sum() / np.pi)), inner, 0.25)}
    r = np.hypot(*state.interface.xy[:, :2].T)
    top_pressure = 3.0 * P / (2.0 * np.pi * a**2)

    def shears(x: np.ndarray) -> np.ndarray:
        return friction * top_pressure * (np.sqrt(np.maximum(1.0 - (x / a) ** 2, 0.0))
                                          - inner / a * np.sqrt(np.maximum(1.0 - (x / inner) ** 2, 0.0)))

    x, turn = np.linspace(0.0, 1.3 * a, 300), np.argsort(r)
    turn = turn[r[turn] < 1.3 * a]
    return Found(values, answer, Curve(r[turn], np.linalg.norm(state.shear, axis=1)[turn], x, shears(x), "r (m)",
                                       "friction (Pa)"))


# Lubkin

def twisted(share: float) -> tuple[float, float]:
    """Rotation over ½ 𝓕 p₀ Σ 1/G, and torque over 8/3 𝓕 p₀ a³, of pressed balls that stick up to share · a."""
    def turned(t: float) -> float:
        return float(ellipk(1.0 - t**2) - ellipe(1.0 - t**2))

    return turned(share), share**3 * turned(share) + quad(lambda t: 3.0 * t**2 * turned(t), share, 1.0)[0]


def twisting_friction(x: float, share: float) -> float:
    """Friction over 𝓕 p₀ at x a from the axis."""
    if x >= share:
        return float(np.sqrt(max(1.0 - x**2, 0.0)))
    return 2.0 / np.pi * x * quad(lambda t: ellipe(1.0 - t**2) / (t * np.sqrt(t**2 - x**2)), share, 1.0)[0]


@problem("twisted-balls", "Balls that are pressed and twisted", (3, 5, 8), "elements on a of the coarser ball",
         shows="Friction that turns: a circle that sticks, and a ring around it that slips.",
         scene="Half balls, R = 1 m, E = 1 Pa, ν = 0.3, 𝓕 = 0.5, a ≈ 0.015 m, elements 4 : 5; the upper flat face is "
               "moved by 0.45 mm, then turned about the axis in two steps. Balls are no half-spaces: with a ≈ 0.03 m "
               "the torque is 1 % too low on all meshes.",
         source="Lubkin 1951, for the force that was computed: β = ½ 𝓕 p₀ Σ(1/G) H(c), H = K − E of the modulus "
                "√(1 − c²/a²), M = 8/3 𝓕 p₀ (c³ H(c) + ∫ 3t² H(t) dt) from c to a.")
def twisted_balls(n: int, order: Order, folder: Path) -> Found:
    friction, approach, poisson = 0.5, 0.00045, 0.3
    upper = half_ball(folder / "upper.msh", 0.015, 0.012 / n, order, turn=360.0)
    lower = half_ball(folder / "lower.msh", 0.015, 0.015 / n, order, turn=360.0, down=True)
    a, modulus, gives = np.sqrt(RADIUS / 2 * approach), 0.5 / (1.0 - poisson**2), 4.0 * (1.0 + poisson)
    turns = [0.5 * friction * 2.0 * modulus * a / (np.pi * RADIUS / 2) * gives * twisted(share)[0]
             for share in (0.8, 0.5)]
    top = [{"on": "top", "z": -approach}, {"on": "top", "x": "-y", "y": "x", "history": "turn"}]
    times = [1.0, 2.0, 3.0]
    answer = solved([body("upper", upper, 1.0, poisson, top), body("lower", lower, 1.0, poisson, ["top"])],
                    [contact("upper", "lower", "contact", "contact", friction=coulomb(friction))],
                    history={"turn": {"times": times, "factors": [0.0, *turns]}}, time={"points": times, "steps": 1})
    state, values = answer.contacts["upper-lower"], {}
    for part, turn, step in zip(("a little", "much"), turns, answer.summary["steps"][1:], strict=True):
        held = step["contacts"]["upper-lower"]
        a = (3.0 * held["normal_force"] * RADIUS / 2 / (4.0 * modulus)) ** (1 / 3)
        bound = friction * 3.0 * held["normal_force"] / (2.0 * np.pi * a**2)
        share = brentq(lambda c, over: twisted(c)[0] - over, 1e-3, 1.0 - 1e-9, (2.0 * turn / (bound * gives),))
        values[f"turned {part}: torque (N m)"] = Value(
            abs(held["moment"][2]), 8.0 / 3.0 * bound * a**3 * twisted(share)[1], 0.05)
    sticks = state.status == "stick"
    values["stick radius (m)"] = Value(float(np.sqrt(state.interface.area[sticks].sum() / np.pi)), share * a, 0.25)
    r, x = np.hypot(*state.interface.xy[:, :2].T), np.linspace(0.0, 1.3, 150)
    turn = np.argsort(r)[:np.count_nonzero(r < 1.3 * a)]
    exact = bound * np.array([twisting_friction(each, share) for each in x])
    return Found(values, answer, Curve(r[turn], np.linalg.norm(state.shear, axis=1)[turn], x * a, exact, "r (m)",
                                       "friction (Pa)"))


# Fits

def fitted(answer: Answer, exact: float, order: Order, angle: Callable[[np.ndarray], np.ndarray],
           xlabel: str) -> Found:
    """The mean pressure of the only contact, and how far nodal ones are from the exact one in L2."""
    (state,) = answer.contacts.values()
    area, (mean, nodes) = state.interface.area, {1: (0.12, 0.6), 2: (0.03, 0.25)}[order]
    values = {"mean pressure (Pa)": Value(mean_pressure(state), exact, mean),
              "nodes, in L2": Value(distance(state.pressure, exact, area), 0.0, nodes)}
    return Found(values, answer, along(state, exact, angle, xlabel, "pressure (Pa)"))


@problem("tubes", "Two tubes with interference", (3, 6, 10), "elements across the wall",
         shows="Gaps between the surfaces that are meant: polygons overlap by less than the interference.",
         scene="Quarters of tubes 0.3 – 0.6 – 0.9 m, fixed at both ends, E = 200 GPa, ν = 0.3, overlapping by 60 µm as "
               "drawn; no friction; elements 4 : 5.",
         source="Lamé, plane strain.")
def tubes(n: int, order: Order, folder: Path) -> Found:
    a, b, c, fit, E, nu = 0.3, 0.6, 0.9, 6e-5, 2e11, 0.3
    ends = [*PLANES, {"on": "bottom", "z": 0.0}, {"on": "top", "z": 0.0}]
    answer = solved([body("inner", tube(folder / "inner.msh", a, b + fit, 0.3 / n, order), E, nu, ends),
                     body("outer", tube(folder / "outer.msh", b, c, 0.24 / n, order), E, nu, ends)],
                    [contact("inner", "outer", "outer", "inner")])
    return fitted(answer, lame_fit(a, b, c, fit, plane_strain(E, nu)), order, degrees, "angle (°)")


@problem("spheres", "A ball in a shell with interference", (3, 6, 10), "elements across the shell",
         shows="The same on a surface that is curved in both directions.",
         scene="Octants of a shell 0.25 – 0.5 m in a shell 0.5 – 1 m, E = 200 GPa, ν = 0.3, overlapping by 50 µm as "
               "drawn; no friction; elements 4 : 5.",
         source="Lamé, spheres.")
def spheres(n: int, order: Order, folder: Path) -> Found:
    a, b, c, fit, E, nu = 0.25, 0.5, 1.0, 5e-5, 2e11, 0.3
    octant = [*PLANES, {"on": "bottom", "z": 0.0}]
    answer = solved([body("ball", shell(folder / "ball.msh", a, b + fit, 0.4 / n, order), E, nu, octant),
                     body("shell", shell(folder / "shell.msh", b, c, 0.5 / n, order), E, nu, octant)],
                    [contact("ball", "shell", "outer", "inner")])
    return fitted(answer, lame_ball(a, b, c, fit, E, nu), order,
                  lambda xy: np.degrees(np.arcsin(xy[:, 2] / np.linalg.norm(xy, axis=1))), "latitude (°)")


# Exact stacks

def box(x: float, z: float, height: float, divisions: tuple[int, int, int], order: Order) -> dict:
    """One metre square, from (x, 0, z) on."""
    return {"shape": "box", "origin": [x, 0.0, z], "size": [1.0, 1.0, height], "divisions": list(divisions),
            "order": int(order)}


SIDES = ("left", "right", "front", "back")
"""Of a box, the upright ones."""


def off(values: np.ndarray, exact: np.ndarray | float) -> Value:
    """The largest difference of values (·) or vectors from exact ones, relative to the largest of these."""
    return Value(float(np.abs(values - exact).max() / np.abs(exact).max()), 0.0, 1e-7)


@problem("sheared-solids", "Sheared stack of boxes", (1, 2, 4), "times finer than the coarsest meshes",
         shows="A contact sticks up to the bound of the friction vector, then slips by the exact amount.",
         scene="Boxes of 1 m × 1 m, 1 and 0.5 m high, E = 210 and 100 GPa, ν = 0.3 and 0.35; the lower one is clamped, "
               "the top moved down, and by U at 37° to x; sides follow the linear field. 3 : 4 cells, Coulomb 0.3.",
         source="τ = min(U/(H₁/G₁ + H₂/G₂), 0.3 p) and slip = U − τ (H₁/G₁ + H₂/G₂), both along U.")
def sheared_solids(n: int, order: Order, folder: Path) -> Found:
    stack = np.array([[2.1e11, 0.3, 1.0], [1e11, 0.35, 0.5]])
    young, poisson, height = stack.T
    modulus, shear = young * (1 - poisson) / (1 + poisson) / (1 - 2 * poisson), young / 2 / (1 + poisson)
    down, way, values = 1e-3, np.array([0.8, 0.6]), {}
    p, gives = down / (height / modulus).sum(), (height / shear).sum()
    for name, shift in (("sticks", 0.15 * p * gives), ("slips", 0.6 * p * gives)):
        tau = min(shift / gives, 0.3 * p)

        def field(k: int, at: float, moved: np.ndarray, tau: float = tau) -> dict:
            """Of a box, `moved` at the height `at`."""
            slope = np.append(tau / shear[k] * way, -p / modulus[k])
            return {axis: {"constant": float(u - at * du), "z_slope": float(du)}
                    for axis, u, du in zip("xyz", moved, slope, strict=True)}

        upper, lower = field(0, 1.5, np.append(shift * way, -down)), field(1, 0.0, np.zeros(3))
        answer = solved([body("upper", box(0.0, 0.5, 1.0, (3 * n, 3 * n, n), order), young[0], poisson[0],
                              [{"on": on} | upper for on in (*SIDES, "top")]),
                         body("lower", box(0.0, 0.0, 0.5, (4 * n, 4 * n, n), order), young[1], poisson[1],
                              [{"on": on} | lower for on in (*SIDES, "bottom")])],
                        [contact("upper", "lower", "bottom", "top", friction=coulomb(0.3))], tolerance=1e-12)
        state = answer.contacts["upper-lower"]
        frame = state.interface.frame[state.interface.sliding, 1:]
        friction, slip = (np.einsum("ktd,kt->kd", frame, each[state.interface.sliding]) for each in (
            state.shear, state.slip))
        values |= {f"{name}: worst pressure": off(state.pressure, p),
                   f"{name}: worst friction": off(friction, tau * np.append(way, 0.0))}
        left = (shift - tau * gives) * np.append(way, 0.0)
        values[f"{name}: worst slip, over U"] = Value(float(np.abs(slip - left).max() / shift), 0.0, 1e-7)
    return Found(values, answer, along(state, tau, along_x, "x (m)", "friction (Pa)",
                                       values=np.linalg.norm(state.shear, axis=1)))


@problem("cubes", "Cubes that overlap, and cubes side by side", (1, 2, 4), "times finer than the coarsest meshes",
         shows="An interference is shared by two bodies, drawn or given. Neighbours that only touch do not press.",
         scene="Cubes of 1 m, E = 1 GPa, ν = 0, between planes of symmetry, that overlap by 10 mm as drawn, or by "
               "`gap`; two on one rigid floor beside each other, whose tops are moved down by 1 and 2 mm. 2 : 3 cells.",
         source="p = E δ/2 and each of two cubes gives way by δ/2; p = E × 1 mm/m and E × 2 mm/m, and 0 between them.")
def cubes(n: int, order: Order, folder: Path) -> Found:
    young, overlap, values = 1e9, 0.01, {}
    planes = [{"on": "left", "x": 0.0}, {"on": "front", "y": 0.0}]
    coarse, fine = (2 * n,) * 3, (3 * n,) * 3
    for name, drawn in (("drawn", overlap), ("given", 0.0)):
        answer = solved([body("lower", box(0.0, 0.0, 1.0, coarse, order), young, 0.0,
                              [*planes, {"on": "bottom", "z": 0.0}]),
                         body("upper", box(0.0, 1.0 - drawn, 1.0, fine, order), young, 0.0,
                              [*planes, {"on": "top", "z": 0.0}])],
                        [contact("upper", "lower", "bottom", "top", **({} if drawn else {"gap": -overlap}))],
                        tolerance=1e-12)
        z, u = answer.bodies["lower"].points[:, 2], answer.bodies["lower"].displacement
        values |= {f"overlap as {name}: worst pressure": off(answer.contacts["upper-lower"].pressure,
                                                             young * overlap / 2.0),
                   f"overlap as {name}: worst displacement": off(u[:, 2], -overlap / 2.0 * z)}
    pushes = {"a": 1e-3, "b": 2e-3}
    answer = solved([body(name, box(x, 0.0, 1.0, divisions, order), young, 0.0,
                          [{"on": "top", "x": 0.0, "y": 0.0, "z": -pushes[name]}])
                     for name, x, divisions in (("a", 0.0, coarse), ("b", 1.0, fine))],
                    [contact("a", "floor", "bottom"), contact("b", "floor", "bottom"),
                     contact("a", "b", "right", "left")],
                    [{"name": "floor", "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}],
                    tolerance=1e-12)
    for name, push in pushes.items():
        values[f"side by side, {name}: worst pressure"] = off(answer.contacts[f"{name}-floor"].pressure, young * push)
    state = answer.contacts["b-floor"]
    values["side by side: worst pressure between them"] = Value(
        float(np.abs(answer.contacts["a-b"].pressure).max() / young / 1e-3), 0.0, 1e-7)
    return Found(values, answer, along(state, 2e-3 * young, along_x, "x (m)", "pressure (Pa)"))


@problem("heated-cubes", "Heated cubes on inclined planes", (1, 2, 4), "times finer than the coarsest meshes",
         shows="Heat, orthotropic materials and clamps along normals in space.",
         scene="Two cubes of 1 m on each other, turned by 40° about z, on planes of symmetry on all sides; the lower "
               "one is heated by 60 K, α = 12e-6/K, with 0.1 mm between them. E = 210 GPa, ν = 0.3, as constants of an "
               "orthotropic material in the upper cube.",
         source="p = ((1 + ν)/(1 − ν) α T H − g)/Σ(H/M), M = E(1 − ν)/((1 + ν)(1 − 2ν)).")
def heated_cubes(n: int, order: Order, folder: Path) -> Found:
    young, poisson, gap = 2.1e11, 0.3, 1e-4
    modulus, shear, turn = young * (1 - poisson) / (1 + poisson) / (1 - 2 * poisson), young / 2 / (1 + poisson), 0.7
    c, s = np.cos(turn), np.sin(turn)

    def cube(name: str, low: float, end: str, across: int) -> dict:
        corners = [[float(c * x - s * y), float(s * x + c * y), z] for z in (low, low + 1.0)
                   for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))]
        mesh = {"shape": "hexahedron", "corners": corners, "divisions": [across * n, across * n, n], "order": order}
        return body(name, mesh, young, poisson, [{"on": on, "normal": 0.0} for on in (
            "left", "right", "front", "back", end)])

    lower, upper = cube("lower", 0.0, "bottom", 2), cube("upper", 1.0 + gap, "top", 3)
    lower["material"] |= {"expansion": 1.2e-5}
    upper["material"] = {"young": [young] * 3, "poisson": [poisson] * 3, "shear": [shear] * 3}
    answer = solved([lower | {"temperature": 60.0}, upper], [contact("lower", "upper", "top", "bottom")])
    exact = ((1 + poisson) / (1 - poisson) * 1.2e-5 * 60.0 - gap) * modulus / 2
    state = answer.contacts["lower-upper"]
    return Found({"worst pressure": Value(float(np.abs(state.pressure / exact - 1).max()), 0.0, 1e-7)}, answer,
                 along(state, exact, lambda xy: xy @ [c, s, 0.0], "along a side (m)", "pressure (Pa)"))


@problem("turned-solid", "A block turned on a plate", (1, 2), "fours of cells along an edge, × n", orders=(1, 2),
         shows="Bodies that move far in space: friction under a turn, and under a slide.",
         scene="A block of 1 m × 1 m × 0.4 m, E = 1 kPa, ν = 0.3, is pressed 4 mm into a plate and turned by 30° about "
               "its axis in 6 load steps; or slid by 0.67 m. μ = 0.3.",
         source="Coulomb's law: the moment about the axis is Σ μ N r of the nodes, and |T| = μ N of the block that "
                "slides.")
def turned_solid(n: int, order: Order, folder: Path) -> Found:
    moment, apart, _, answer = far_free.torque(int(order), 4 * n)
    state = answer.contacts["block-plate"]
    ratio = np.linalg.norm(state.tangential_force, axis=1) / state.normal_force
    return Found({"moment over Σ μ N r": Value(moment, 1.0, 0.02), "|T|/N − μ, slid": Value(apart, 0.0, 1e-4)}, answer,
                 along(state, far_free.FRICTION, lambda xy: np.linalg.norm(xy[:, :2] - 0.5, axis=1), "r (m)",
                       "tangential over normal force", values=ratio))
