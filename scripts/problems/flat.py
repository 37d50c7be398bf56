"""Verification problems whose contacts are straight: patch tests, and bodies whose fields are linear."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ddmpi.interface.state import ContactState
from ddmpi.run.answer import Answer
from problems import (
    Curve,
    Found,
    Order,
    Value,
    along,
    along_x,
    block,
    body,
    contact,
    coulomb,
    draw,
    number,
    problem,
    side_means,
    solved,
    worst,
)

YOUNG, POISSON, PRESSURE = 1e9, 0.3, 1e6
PLANE, SHEAR = YOUNG / (1 - POISSON**2), YOUNG / 2 / (1 + POISSON)
CONFINED = YOUNG * (1 - POISSON) / (1 + POISSON) / (1 - 2 * POISSON)
EXACT = 1e-8
"""What is exact on any mesh may differ by this from its closed form: solvers and rounding."""

LEFT, ROLLERS = [{"on": "left", "x": 0.0}], [{"on": "left", "x": 0.0}, {"on": "bottom", "y": 0.0}]
DOWN, UP = (0.0, -PRESSURE), (0.0, PRESSURE)
TIGHT = 1e-12
"""Tolerance of the method where answers are exact."""


def plain(name: str, mesh: dict, clamp: list, traction: dict | None = None) -> dict:
    return body(name, mesh, YOUNG, POISSON, clamp, traction)


def frames(upper: tuple[float, float], lower: tuple[float, float], size: float, order: Order,
           folder: Path) -> tuple[dict, dict]:
    """Drawn meshes of an upper and a lower block of height one, from x to x each.

    What faces the other block is the group ``covered``, what does not ``open``, both together ``seam``.
    """
    low, high = max(upper[0], lower[0]), min(upper[1], lower[1])
    meshes = []
    for name, (x, X), far, mesh_size in (("upper", upper, 2.0, size), ("lower", lower, 0.0, size / 1.4)):
        places = sorted({x, low, high, X})
        corners = {f"p{k}": (at, 1.0) for k, at in enumerate(places)} | {"a": (places[-1], far), "b": (x, far)}
        pieces = {f"s{k}": (f"p{k}", f"p{k + 1}") for k in range(len(places) - 1)}
        last = f"p{len(places) - 1}"
        covered = [piece for piece, at in zip(pieces, places, strict=False) if low <= at < high]
        free = [piece for piece in pieces if piece not in covered]
        meshes.append(draw(folder / f"{name}.msh", corners,
                           pieces | {"right": (last, "a"), "far": ("a", "b"), "left": ("b", "p0")}, f"{mesh_size}",
                           order, {"seam": list(pieces), "covered": covered} | ({"open": free} if free else {})))
    return meshes[0], meshes[1]


# Patch tests

def unequal(n: int, order: Order, upper: int, lower: int) -> tuple[list, list]:
    return ([plain("upper", block(0, 1, 2, 1, (upper * n, 2 * n), order), LEFT, {"top": DOWN}),
             plain("lower", block(0, 0, 2, 1, (lower * n, 3 * n), order), ROLLERS)],
            [contact("upper", "lower", "bottom", "top", friction=coulomb(0.3))])


def overhanging(n: int, order: Order, folder: Path) -> tuple[list, list]:
    upper, lower = frames((0.31, 2.3), (0.0, 2.0), 0.3 / n, order, folder)
    return ([plain("upper", upper, [], {"far": DOWN, "open": UP}),
             plain("lower", lower, [{"on": "left", "x": 0.0}, {"on": "far", "y": 0.0}], {"open": DOWN})],
            [contact("upper", "lower", "seam", "seam", friction=coulomb(0.3))])


def at_a_joint(n: int, order: Order, joint: float) -> tuple[list, list]:
    return ([plain("below", block(0, 0, 2, 1, (6 * n, 3 * n), order), ROLLERS),
             plain("left", block(0, 1, joint, 1, (4 * n, 3 * n), order), LEFT, {"top": DOWN}),
             plain("right", block(joint, 1, 2 - joint, 1, (5 * n, 3 * n), order), [], {"top": DOWN})],
            [contact(name, "below", "bottom", "top", friction=coulomb(0.3), pairing="mortar")
             for name in ("left", "right")] + [contact("left", "right", "right", "left")])


def inclined(n: int, order: Order, kind: str) -> tuple[list, list]:
    def mesh(corners: list, divisions: tuple[int, int]) -> dict:
        return {"shape": "quadrilateral", "corners": corners, "divisions": list(divisions), "order": number(order)}

    right = {"right": (-PRESSURE, 0.0)}
    return ([plain("upper", mesh([[0, 1], [2, 0.8], [2, 2], [0, 2]], (7 * n, 3 * n)), LEFT, right | {"top": DOWN}),
             plain("lower", mesh([[0, 0], [2, 0], [2, 0.8], [0, 1]], (10 * n, 3 * n)), ROLLERS, right)],
            [contact("upper", "lower", "bottom", "top", kind=kind)])


def sticking(n: int, order: Order) -> tuple[list, list]:
    """All outer sides are clamped, and follow a linear displacement with the pressure and half of it as shear."""
    field = {"x": {"constant": 0.0, "y_slope": PRESSURE / 2 / SHEAR},
             "y": {"constant": 0.0, "y_slope": -PRESSURE / CONFINED}}
    return ([plain("upper", block(0, 1, 2, 1, (6 * n, 3 * n), order), [{"on": on} | field for on in
                                                                       ("left", "right", "top")]),
             plain("lower", block(0, 0, 2, 1, (9 * n, 3 * n), order), [{"on": on} | field for on in
                                                                       ("left", "right", "bottom")])],
            [contact("upper", "lower", "bottom", "top", friction=coulomb(2.0))])


VARIANTS = {
    "7 : 11": lambda n, order, folder: unequal(n, order, 7, 11),
    "3 : 16": lambda n, order, folder: unequal(n, order, 3, 16),
    "both sides overhang": overhanging,
    "three bodies, joint at a node": lambda n, order, folder: at_a_joint(n, order, 1.0),
    "three bodies, joint inside a side": lambda n, order, folder: at_a_joint(n, order, 0.9),
    "inclined, unilateral": lambda n, order, folder: inclined(n, order, "unilateral"),
    "inclined, bonded": lambda n, order, folder: inclined(n, order, "bonded"),
    "clamped sides, sticking": lambda n, order, folder: sticking(n, order),
}


def pressed(answer: Answer) -> list[ContactState]:
    """The contacts that bear the pressure: all but that of the joint."""
    return [state for name, state in answer.contacts.items() if name != "left-right"]


def curve_of(answer: Answer, exact: float = PRESSURE) -> Curve:
    state = pressed(answer)[0]
    return along(state, exact, along_x, "x (m)", "pressure (Pa)")


@problem("patch", "Contact patch tests", (1, 2, 4), "times finer than the coarsest meshes",
         shows="A constant stress is exact wherever the nodes of two bodies lie. The greatest deviation of a nodal "
               "stress, over the pressure, with either body as the slave.",
         scene="Blocks of 2 m × 1 m, E = 1 GPa, ν = 0.3, under 1 MPa. Sides of the upper and the lower body along "
               "the contact: 7 : 11 and 3 : 16; drawn meshes of blocks that overhang on either side, where the "
               "pressure acts on what is not covered; two blocks on a third one; a contact at 1 : 10, under the same "
               "pressure all around; clamps that follow a linear displacement on all outer sides, with friction 2, "
               "at a pressure of 1 MPa and a shear stress of 0.5 MPa.",
         source="The linear displacement of a constant stress is in the space of the elements.")
def patch(n: int, order: Order, folder: Path) -> Found:
    values = {}
    for name, variant in VARIANTS.items():
        largest = 0.0
        for role in (0, 1):
            bodies, contacts = variant(n, order, folder)
            slaves = [each | ({"slave": each["bodies"][role]} if "-".join(each["bodies"]) != "left-right" else {})
                      for each in contacts]
            answer = solved(bodies, slaves, tolerance=TIGHT)
            # where three bodies meet at a node, tangential forces of the three contacts are not unique
            shear = PRESSURE / 2 if name.startswith("clamped") else None if name.startswith("three") else 0.0
            largest = max(largest, *(worst(state, PRESSURE, shear) for state in pressed(answer)))
            if name == "7 : 11" and role == 0:
                drawn = answer
        values[name] = Value(largest, 0.0, EXACT)
    return Found(values, drawn, curve_of(drawn))


@problem("el-abbasi-bathe", "The patch test of El-Abbasi and Bathe", (1, 2, 4), "times finer than the coarsest mesh",
         shows="A block on a wider foundation, both pressed from above, passes the pressure on: also where the "
               "contact ends within the foundation's boundary, and to the stress of all elements.",
         scene="Drawn meshes of a block of 1 m × 1 m on a foundation of 3 m × 1 m, E = 1 GPa, ν = 0.3, no friction; "
               "1 MPa acts on the block and on what it leaves uncovered.",
         source="N. El-Abbasi, K. J. Bathe, Computers & Structures 79, 2001, 1473–1486; dimensions are ours. The "
                "stress is constant.")
def el_abbasi_bathe(n: int, order: Order, folder: Path) -> Found:
    upper, lower = frames((1.0, 2.0), (0.0, 3.0), 0.34 / n, order, folder)
    values = {}
    for slave in ("block", "foundation"):
        answer = solved([plain("block", upper, [], {"far": DOWN}),
                         plain("foundation", lower, [{"on": "left", "x": 0.0}, {"on": "far", "y": 0.0}],
                               {"open": DOWN})],
                        [contact("block", "foundation", "seam", "seam", slave=slave)], tolerance=TIGHT)
        stress = np.concatenate([each.stress for each in answer.bodies.values()])
        off = np.abs(np.column_stack([stress[:, 0], stress[:, 1] + PRESSURE, stress[:, 3]])).max() / PRESSURE
        values |= {f"worst node, slave {slave}": Value(worst(pressed(answer)[0], PRESSURE), 0.0, EXACT),
                   f"worst element, slave {slave}": Value(float(off), 0.0, EXACT)}
    return Found(values, answer, curve_of(answer))


@problem("cgs-1", "NAFEMS CGS-1: contact patch test of unlike bodies", (1, 2, 4), "times finer than the coarsest mesh",
         shows="Two bodies of unlike material, pressed together, slide along their contact as they bulge, and bear "
               "the same pressure everywhere.",
         scene="Drawn meshes that do not match, of blocks of 2 m × 1 m, E = 1 and 10 GPa, ν = 0.3 and 0.2; no "
               "friction; rollers on the left and below; the top is moved down by δ = 1 mm.",
         source="After the first problem of Feng and Prinja, Benchmark Tests for Finite Element Modelling of "
                "Contact, Gapping and Sliding, NAFEMS R0081, 2001. The report was not at hand: its idea is taken, "
                "and all data are ours. p = δ / Σ(H_i/E'_i).")
def cgs1(n: int, order: Order, folder: Path) -> Found:
    upper, lower = frames((0.0, 2.0), (0.0, 2.0), 0.3 / n, order, folder)
    exact = 1e-3 / ((1 - 0.3**2) / 1e9 + (1 - 0.2**2) / 1e10)
    answer = solved([body("upper", upper, 1e9, 0.3, [*LEFT, {"on": "far", "y": -1e-3}]),
                     body("lower", lower, 1e10, 0.2, [*LEFT, {"on": "far", "y": 0.0}])],
                    [contact("upper", "lower", "seam", "seam")], tolerance=TIGHT)
    state = answer.contacts["upper-lower"]
    return Found({"mean pressure (Pa)": Value(float(state.normal_force.sum() / 2.0), exact, EXACT),
                  "worst node": Value(worst(state, exact), 0.0, EXACT)}, answer, curve_of(answer, exact))


# Linear fields

@problem("sheared-stack", "Sheared stack", (1, 2, 4), "times finer than the coarsest meshes",
         shows="A contact sticks up to the bound of friction, then slips by the exact amount, on unlike meshes.",
         scene="A block of 2 m × 1 m on one of 2 m × 0.5 m, E = 210 and 100 GPa, ν = 0.3 and 0.35; the lower one is "
               "clamped, the top moved down and sideways by U; sides follow the linear field. 4 : 6 sides, Coulomb "
               "0.3.",
         source="τ = min(U/(H₁/G₁ + H₂/G₂), 0.3 p), slip = U − τ (H₁/G₁ + H₂/G₂).")
def sheared_stack(n: int, order: Order, folder: Path) -> Found:
    (E1, nu1, H1), (E2, nu2, H2) = (2.1e11, 0.3, 1.0), (1e11, 0.35, 0.5)
    modulus = [E * (1 - nu) / (1 + nu) / (1 - 2 * nu) for E, nu in ((E1, nu1), (E2, nu2))]
    shear = [E / 2 / (1 + nu) for E, nu in ((E1, nu1), (E2, nu2))]
    pressed_by, values = 1e-3, {}
    p = pressed_by / (H1 / modulus[0] + H2 / modulus[1])
    compliance = H1 / shear[0] + H2 / shear[1]
    for name, shift in (("sticks", 0.15 * p * compliance), ("slips", 0.6 * p * compliance)):
        tau = min(shift / compliance, 0.3 * p)
        lower = {"x": {"constant": 0.0, "y_slope": tau / shear[1]}, "y": {"constant": 0.0, "y_slope": -p / modulus[1]}}
        upper = {"x": {"constant": shift - tau / shear[0] * (H1 + H2), "y_slope": tau / shear[0]},
                 "y": {"constant": -pressed_by + p / modulus[0] * (H1 + H2), "y_slope": -p / modulus[0]}}
        answer = solved([body("upper", block(0, H2, 2, H1, (4 * n, 2 * n), order), E1, nu1,
                              [{"on": on} | upper for on in ("left", "right", "top")]),
                         body("lower", block(0, 0, 2, H2, (6 * n, 2 * n), order), E2, nu2,
                              [{"on": on} | lower for on in ("left", "right", "bottom")])],
                        [contact("upper", "lower", "bottom", "top", friction=coulomb(0.3))], tolerance=TIGHT)
        state = answer.contacts["upper-lower"]
        slip = float(np.abs(state.slip[state.interface.sliding]).mean())
        values |= {f"{name}: worst node": Value(worst(state, p, tau), 0.0, EXACT),
                   f"{name}: shear stress (Pa)": Value(float(abs(state.shear[state.interface.sliding].mean())), tau,
                                                       EXACT),
                   f"{name}: slip, of the top's displacement": Value(
                       slip / shift, 1.0 - tau * compliance / shift if name == "slips" else 0.0, EXACT)}
    return Found(values, answer, curve_of(answer, p))


@problem("walls", "Block between walls", (1, 2, 4), "times finer than the coarsest meshes",
         shows="A gap closes before two blocks between rigid walls press each other and, bulging, the walls.",
         scene="Blocks of 2 m × 1 m, E = 1 GPa, ν = 0.3, 0.2 mm apart, between two rigid walls without friction; the "
               "top is moved down by δ = 1 mm. 4 : 7 sides.",
         source="p = (δ − g₀)/(ΣH/M), M = E(1 − ν)/((1 + ν)(1 − 2ν)); the walls bear ν/(1 − ν) p.")
def walls(n: int, order: Order, folder: Path) -> Found:
    gap, approach = 2e-4, 1e-3
    p = (approach - gap) * CONFINED / 2.0
    rigid = [{"name": name, "shape": "plane", "point": [x, 0.0], "normal": [sign, 0.0]}
             for name, x, sign in (("west", 0.0, 1.0), ("east", 2.0, -1.0))]
    answer = solved([plain("upper", block(0, 1 + gap, 2, 1, (4 * n, 3 * n), order), [{"on": "top", "y": -approach}]),
                     plain("lower", block(0, 0, 2, 1, (7 * n, 3 * n), order), [{"on": "bottom", "y": 0.0}])],
                    [contact("upper", "lower", "bottom", "top"),
                     *(contact(name, wall, side) for name in ("upper", "lower")
                       for wall, side in (("west", "left"), ("east", "right")))], rigid, TIGHT)
    wall = POISSON / (1 - POISSON) * p
    return Found({"pressure between the blocks (Pa)": Value(float(answer.contacts["upper-lower"].pressure.mean()), p,
                                                             EXACT),
                  "between the blocks, worst node": Value(worst(answer.contacts["upper-lower"], p), 0.0, EXACT),
                  "pressure of a wall (Pa)": Value(float(answer.contacts["lower-east"].pressure.mean()), wall, EXACT),
                  "at the walls, worst node": Value(max(worst(answer.contacts[f"{name}-{side}"], wall) for name in
                                                        ("upper", "lower") for side in ("west", "east")), 0.0, EXACT)},
                 answer, curve_of(answer, p))


@problem("three-bars", "Three bars in a row, the middle one loose", (1, 2, 4), "times finer than the coarsest meshes",
         shows="Contact forces alone support a body.",
         scene="Bars of 1, 2 and 0.5 m, 0.5 m high, E = 1, 5 and 2 GPa, ν = 0.3, no friction; the first and the last "
               "are fixed at their far ends, which approach by δ = 1 mm. 3 : 4 : 5 sides.",
         source="p = δ / Σ(L_i/E'_i) in both contacts.")
def three_bars(n: int, order: Order, folder: Path) -> Found:
    lengths, moduli = (1.0, 2.0, 0.5), (1e9, 5e9, 2e9)
    p = 1e-3 / sum(L * (1 - POISSON**2) / E for L, E in zip(lengths, moduli, strict=True))
    names, starts = ("first", "middle", "last"), (0.0, 1.0, 3.0)
    held = ([{"on": "left", "x": 1e-3}, {"on": "bottom", "y": 0.0}], [], [{"on": "right", "x": 0.0},
                                                                            {"on": "bottom", "y": 0.0}])
    answer = solved([body(name, block(x, 0, L, 0.5, (round(4 * L * n), (3 + k) * n), order), E, POISSON, clamp)
                     for k, (name, x, L, E, clamp) in enumerate(zip(names, starts, lengths, moduli, held,
                                                                    strict=True))],
                    [contact("first", "middle", "right", "left"), contact("middle", "last", "right", "left")],
                    tolerance=TIGHT)
    states = [answer.contacts[name] for name in ("first-middle", "middle-last")]
    curve = along(states[0], p, lambda xy: xy[:, 1], "y (m)", "pressure (Pa)")
    return Found({f"pressure {name} (Pa)": Value(float(state.normal_force.sum() / 0.5), p, EXACT)
                  for name, state in zip(("first – middle", "middle – last"), states, strict=True)}
                 | {"worst node": Value(max(worst(state, p) for state in states), 0.0, EXACT)}, answer, curve)


@problem("wedge", "Wedge under a block", (1, 2, 4), "times finer than the coarsest meshes",
         shows="A wedge that is driven under a block pushes it at the angle of friction.",
         scene="A wedge of slope 0.1, 2 m long, is driven by 5 mm on a rigid floor without friction; above it a "
               "block of 1 m on rollers at its side and pressed from above; E = 1 GPa, ν = 0.3, Coulomb "
               "0.3. 9 : 5 sides a metre.",
         source="R_x/R_y = (μ + tan α)/(1 − μ tan α) = 0.412371; the value of NAFEMS CGS-4.")
def wedge(n: int, order: Order, folder: Path) -> Found:
    slope, mu = 0.1, 0.3
    low = {"shape": "quadrilateral", "corners": [[0, 0], [2, 0], [2, 0.4], [0, 0.6]], "divisions": [18 * n, 4 * n],
           "order": number(order)}
    high = {"shape": "quadrilateral", "corners": [[0.5, 0.55], [1.5, 0.45], [1.5, 1.5], [0.5, 1.5]],
            "divisions": [5 * n, 5 * n], "order": number(order)}
    floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}
    answer = solved([plain("wedge", low, [{"on": "left", "x": 0.005}]),
                     plain("block", high, [{"on": "right", "x": 0.0}], {"top": DOWN})],
                    [contact("block", "wedge", "bottom", "top", friction=coulomb(mu)),
                     contact("wedge", "floor", "bottom")], [floor])
    x, y = answer.summary["contacts"]["block-wedge"]["force"]
    state = answer.contacts["block-wedge"]
    means = side_means(state)
    order_of = np.argsort(means.xy[:, 0])
    return Found({"R_x/R_y": Value(abs(x / y), (mu + slope) / (1 - mu * slope), 1e-6),
                  "R_y (N)": Value(abs(y), PRESSURE, 1e-6)}, answer,
                 Curve(means.xy[order_of, 0], means.pressure[order_of], np.empty(0), np.empty(0), "x (m)",
                       "pressure (Pa)"))
