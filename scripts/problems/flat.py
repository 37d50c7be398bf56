"""Verification problems whose contacts are straight: patch tests, and bodies whose fields are linear."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from ddmpi.interface.state import ContactState
from ddmpi.run.answer import Answer
from problems import Curve, Order, Results, X, Y, along, problem, side_means, worst
from problems.bodies import between, block, body, contact, coulomb, draw, held, plane, solved
from problems.forms import confined, plane_strain, shear

YOUNG, POISSON, PRESSURE = 1e9, 0.3, 1e6
EXACT = 1e-8
"""What is exact on any mesh may differ by this from its closed form: solvers and rounding."""

LEFT, ROLLERS = held(left="x"), held(left="x", bottom="y")
DOWN, UP = (0.0, -PRESSURE), (0.0, PRESSURE)
TIGHT = 1e-12
"""Tolerance of the method where answers are exact."""


def plain(name: str, mesh: dict, clamp: list, traction: dict | None = None) -> dict:
    return body(name, mesh, YOUNG, POISSON, clamp, traction)


def frames(
    upper: tuple[float, float], lower: tuple[float, float], size: float, order: Order, folder: Path
) -> tuple[dict, dict]:
    """Drawn meshes of an upper and a lower block of height one, from x to x each.

    What faces the other block is the group ``covered``, what does not ``open``, both together ``seam``.
    """
    low, high = max(upper[0], lower[0]), min(upper[1], lower[1])
    meshes = []
    for name, (x, end), far, mesh_size in (
        ("upper", upper, 2.0, size),
        ("lower", lower, 0.0, size / 1.4),
    ):
        places = sorted({x, low, high, end})
        corners = {f"p{k}": (at, 1.0) for k, at in enumerate(places)} | {
            "a": (places[-1], far),
            "b": (x, far),
        }
        pieces = {f"s{k}": f"p{k} p{k + 1}" for k in range(len(places) - 1)}
        covered = [piece for piece, at in zip(pieces, places, strict=False) if low <= at < high]
        free = [piece for piece in pieces if piece not in covered]
        meshes.append(
            draw(
                folder / f"{name}.msh",
                corners,
                pieces | {"right": f"p{len(places) - 1} a", "far": "a b", "left": "b p0"},
                f"{mesh_size}",
                order,
                {"seam": list(pieces), "covered": covered} | ({"open": free} if free else {}),
            )
        )
    return meshes[0], meshes[1]


# Patch tests


def unequal(n: int, order: Order, upper: int, lower: int) -> tuple[list, list]:
    return (
        [
            plain("upper", block(0, 1, 2, 1, (upper * n, 2 * n), order), LEFT, {"top": DOWN}),
            plain("lower", block(0, 0, 2, 1, (lower * n, 3 * n), order), ROLLERS),
        ],
        [contact("upper", "lower", "bottom", "top", friction=coulomb(0.3))],
    )


def overhanging(n: int, order: Order, folder: Path) -> tuple[list, list]:
    upper, lower = frames((0.31, 2.3), (0.0, 2.0), 0.3 / n, order, folder)
    return (
        [
            plain("upper", upper, [], {"far": DOWN, "open": UP}),
            plain("lower", lower, held(left="x", far="y"), {"open": DOWN}),
        ],
        [contact("upper", "lower", "seam", "seam", friction=coulomb(0.3))],
    )


def at_a_joint(n: int, order: Order, joint: float) -> tuple[list, list]:
    return (
        [
            plain("below", block(0, 0, 2, 1, (6 * n, 3 * n), order), ROLLERS),
            plain("left", block(0, 1, joint, 1, (4 * n, 3 * n), order), LEFT, {"top": DOWN}),
            plain("right", block(joint, 1, 2 - joint, 1, (5 * n, 3 * n), order), [], {"top": DOWN}),
        ],
        [
            contact(name, "below", "bottom", "top", friction=coulomb(0.3), pairing="mortar")
            for name in ("left", "right")
        ]
        + [contact("left", "right", "right", "left")],
    )


def inclined(n: int, order: Order, kind: str) -> tuple[list, list]:
    right = {"right": (-PRESSURE, 0.0)}
    upper = between([(0, 1), (2, 0.8), (2, 2), (0, 2)], (7 * n, 3 * n), order)
    lower = between([(0, 0), (2, 0), (2, 0.8), (0, 1)], (10 * n, 3 * n), order)
    return (
        [plain("upper", upper, LEFT, right | {"top": DOWN}), plain("lower", lower, ROLLERS, right)],
        [contact("upper", "lower", "bottom", "top", kind=kind)],
    )


def sticking(n: int, order: Order) -> tuple[list, list]:
    """All outer sides are clamped, and follow a linear displacement with the pressure and half of it as shear."""
    field = {
        "x": {"constant": 0.0, "y_slope": PRESSURE / 2 / shear(YOUNG, POISSON)},
        "y": {"constant": 0.0, "y_slope": -PRESSURE / confined(YOUNG, POISSON)},
    }
    return (
        [
            plain(
                "upper",
                block(0, 1, 2, 1, (6 * n, 3 * n), order),
                held(left=field, right=field, top=field),
            ),
            plain(
                "lower",
                block(0, 0, 2, 1, (9 * n, 3 * n), order),
                held(left=field, right=field, bottom=field),
            ),
        ],
        [contact("upper", "lower", "bottom", "top", friction=coulomb(2.0))],
    )


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
    return along(pressed(answer)[0], exact, X)


@problem("Contact patch tests")
def patch(n: int, order: Order, folder: Path) -> Results:
    values = {}
    for name, variant in VARIANTS.items():
        largest = 0.0
        for role in (0, 1):
            bodies, contacts = variant(n, order, folder)
            slaves = [
                each
                | (
                    {"slave": each["bodies"][role]}
                    if "-".join(each["bodies"]) != "left-right"
                    else {}
                )
                for each in contacts
            ]
            answer = solved(bodies, slaves, tolerance=TIGHT)
            # where three bodies meet at a node, tangential forces of the three contacts are not unique
            tau = (
                PRESSURE / 2
                if name.startswith("clamped")
                else None
                if name.startswith("three")
                else 0.0
            )
            largest = max(largest, *(worst(state, PRESSURE, tau) for state in pressed(answer)))
            if name == "7 : 11" and role == 0:
                drawn = answer
        values[name] = largest, EXACT
    return values, drawn, curve_of(drawn)


@problem("The patch test of El-Abbasi and Bathe")
def el_abbasi_bathe(n: int, order: Order, folder: Path) -> Results:
    upper, lower = frames((1.0, 2.0), (0.0, 3.0), 0.34 / n, order, folder)
    values = {}
    for slave in ("block", "foundation"):
        answer = solved(
            [
                plain("block", upper, [], {"far": DOWN}),
                plain("foundation", lower, held(left="x", far="y"), {"open": DOWN}),
            ],
            [contact("block", "foundation", "seam", "seam", slave=slave)],
            tolerance=TIGHT,
        )
        stress = np.concatenate([each.stress for each in answer.bodies.values()])
        apart = (
            np.abs(np.column_stack([stress[:, 0], stress[:, 1] + PRESSURE, stress[:, 3]])).max()
            / PRESSURE
        )
        values |= {
            f"worst node, slave {slave}": (worst(pressed(answer)[0], PRESSURE), EXACT),
            f"worst element, slave {slave}": (apart, EXACT),
        }
    return values, answer, curve_of(answer)


@problem("NAFEMS CGS-1: contact patch test of unlike bodies")
def cgs_1(n: int, order: Order, folder: Path) -> Results:
    upper, lower = frames((0.0, 2.0), (0.0, 2.0), 0.3 / n, order, folder)
    exact = 1e-3 / ((1 - 0.3**2) / 1e9 + (1 - 0.2**2) / 1e10)
    answer = solved(
        [
            body("upper", upper, 1e9, 0.3, held(left="x", far={"y": -1e-3})),
            body("lower", lower, 1e10, 0.2, held(left="x", far="y")),
        ],
        [contact("upper", "lower", "seam", "seam")],
        tolerance=TIGHT,
    )
    state = answer.contacts["upper-lower"]
    return (
        {
            "mean pressure (Pa)": (state.normal_force.sum() / 2.0, exact, EXACT),
            "worst node": (worst(state, exact), EXACT),
        },
        answer,
        curve_of(answer, exact),
    )


# Linear fields


@problem("Sheared stack")
def sheared_stack(n: int, order: Order, folder: Path) -> Results:
    stack, down, values = (((2.1e11, 0.3), 1.0), ((1e11, 0.35), 0.5)), 1e-3, {}
    p = down / sum(H / confined(*material) for material, H in stack)
    gives = sum(H / shear(*material) for material, H in stack)
    (one, H1), (two, H2) = stack
    for name, shift in (("sticks", 0.15 * p * gives), ("slips", 0.6 * p * gives)):
        tau = min(shift / gives, 0.3 * p)

        def field(x: float, y: float, material: tuple, tau: float = tau) -> dict:
            """Moved so far at its end, the top of the upper body, or the bottom of the lower one."""
            slope, height = (
                (tau / shear(*material), -p / confined(*material)),
                H1 + H2 if material is one else 0.0,
            )
            return {
                axis: {"constant": u - du * height, "y_slope": du}
                for axis, u, du in zip("xy", (x, y), slope, strict=True)
            }

        upper, lower = field(shift, -down, one), field(0.0, 0.0, two)
        answer = solved(
            [
                body(
                    "upper",
                    block(0, H2, 2, H1, (4 * n, 2 * n), order),
                    *one,
                    held(left=upper, right=upper, top=upper),
                ),
                body(
                    "lower",
                    block(0, 0, 2, H2, (6 * n, 2 * n), order),
                    *two,
                    held(left=lower, right=lower, bottom=lower),
                ),
            ],
            [contact("upper", "lower", "bottom", "top", friction=coulomb(0.3))],
            tolerance=TIGHT,
        )
        state = answer.contacts["upper-lower"]
        slides = state.interface.sliding
        values |= {
            f"{name}: worst node": (worst(state, p, tau), EXACT),
            f"{name}: shear stress (Pa)": (abs(state.shear[slides].mean()), tau, EXACT),
            f"{name}: slip, of the top's displacement": (
                np.abs(state.slip[slides]).mean() / shift,
                1.0 - tau * gives / shift if name == "slips" else 0.0,
                EXACT,
            ),
        }
    return values, answer, curve_of(answer, p)


@problem("Block between walls")
def walls(n: int, order: Order, folder: Path) -> Results:
    gap, approach = 2e-4, 1e-3
    p = (approach - gap) * confined(YOUNG, POISSON) / 2.0
    answer = solved(
        [
            plain(
                "upper", block(0, 1 + gap, 2, 1, (4 * n, 3 * n), order), held(top={"y": -approach})
            ),
            plain("lower", block(0, 0, 2, 1, (7 * n, 3 * n), order), held(bottom="y")),
        ],
        [
            contact("upper", "lower", "bottom", "top"),
            *(
                contact(name, wall, side)
                for name in ("upper", "lower")
                for wall, side in (("west", "left"), ("east", "right"))
            ),
        ],
        [plane("west", (0.0, 0.0), (1.0, 0.0)), plane("east", (2.0, 0.0), (-1.0, 0.0))],
        TIGHT,
    )
    wall, between_them = POISSON / (1 - POISSON) * p, answer.contacts["upper-lower"]
    return (
        {
            "pressure between the blocks (Pa)": (between_them.pressure.mean(), p, EXACT),
            "between the blocks, worst node": (worst(between_them, p), EXACT),
            "pressure of a wall (Pa)": (answer.contacts["lower-east"].pressure.mean(), wall, EXACT),
            "at the walls, worst node": (
                max(
                    worst(answer.contacts[f"{name}-{side}"], wall)
                    for name in ("upper", "lower")
                    for side in ("west", "east")
                ),
                EXACT,
            ),
        },
        answer,
        curve_of(answer, p),
    )


@problem("Three bars in a row, the middle one loose")
def three_bars(n: int, order: Order, folder: Path) -> Results:
    bars = (
        ("first", 0.0, 1.0, 1e9, held(left={"x": 1e-3}, bottom="y")),
        ("middle", 1.0, 2.0, 5e9, []),
        ("last", 3.0, 0.5, 2e9, held(right="x", bottom="y")),
    )
    p = 1e-3 / sum(L / plane_strain(E, POISSON)[0] for _, _, L, E, _ in bars)
    answer = solved(
        [
            body(
                name, block(x, 0, L, 0.5, (round(4 * L * n), (3 + k) * n), order), E, POISSON, clamp
            )
            for k, (name, x, L, E, clamp) in enumerate(bars)
        ],
        [contact("first", "middle", "right", "left"), contact("middle", "last", "right", "left")],
        tolerance=TIGHT,
    )
    return (
        {
            f"pressure {name.replace('-', ' – ')} (Pa)": (state.normal_force.sum() / 0.5, p, EXACT)
            for name, state in answer.contacts.items()
        }
        | {"worst node": (max(worst(state, p) for state in answer.contacts.values()), EXACT)},
        answer,
        along(answer.contacts["first-middle"], p, Y),
    )


@problem("Wedge under a block")
def wedge(n: int, order: Order, folder: Path) -> Results:
    slope, mu = 0.1, 0.3
    low = between([(0, 0), (2, 0), (2, 0.4), (0, 0.6)], (18 * n, 4 * n), order)
    high = between([(0.5, 0.55), (1.5, 0.45), (1.5, 1.5), (0.5, 1.5)], (5 * n, 5 * n), order)
    answer = solved(
        [
            plain("wedge", low, held(left={"x": 0.005})),
            plain("block", high, held(right="x"), {"top": DOWN}),
        ],
        [
            contact("block", "wedge", "bottom", "top", friction=coulomb(mu)),
            contact("wedge", "floor", "bottom"),
        ],
        [plane("floor", (0.0, 0.0), (0.0, 1.0))],
    )
    x, y = answer.summary["contacts"]["block-wedge"]["force"]
    means = side_means(answer.contacts["block-wedge"])
    rank, none = np.argsort(means.xy[:, 0]), np.empty(0)
    return (
        {
            "R_x/R_y": (abs(x / y), (mu + slope) / (1 - mu * slope), 1e-6),
            "R_y (N)": (abs(y), PRESSURE, 1e-6),
        },
        answer,
        Curve(means.xy[rank, 0], means.pressure[rank], none, none, X.label),
    )
