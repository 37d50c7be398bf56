"""Verification problems in space: Hertz, Cattaneo and Mindlin, Lubkin, fits of tubes and spheres, exact stacks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.integrate import quad
from scipy.optimize import brentq
from scipy.special import ellipe, ellipk

from ddmpi.interface.state import ContactState
from ddmpi.run.answer import Answer
from problems import (
    ANGLE,
    AWAY,
    Curve,
    Order,
    Position,
    Results,
    X,
    along,
    mean_pressure,
    nodes_off,
    off,
    problem,
)
from problems.bodies import (
    FLOOR,
    QUARTER,
    RADIUS,
    between,
    body,
    box,
    contact,
    coulomb,
    courses,
    held,
    solved,
)
from problems.forms import confined, hertz_values, lame_ball, lame_fit, plane_strain, shear
from problems.moving import FRICTION, torque
from problems.revolved import half_ball, shell, tube

EXACT, TIGHT = 1e-7, 1e-12


# Hertz

ALLOWED = {1: (0.1, 0.06), 2: (0.06, 0.06)}
"""Of p₀ and a, by the order."""


def with_nodes(
    state: ContactState, modulus: float, radius: float, order: Order
) -> tuple[dict, Curve]:
    """`hertz_values` of a quarter, and how far the pressures at nodes, D_j⁻¹ ∫ p φ_j, are in L2 from those of Hertz at
    the nodes, and from what his pressure itself has for them, its means with the hats φ_j as weights."""
    values, curve = hertz_values(state, 4, modulus, radius, ALLOWED[int(order)])
    xy, facets, K = state.interface.xy[:, :2], state.interface.geometry.facets, 12
    i, j = np.divmod(np.arange(K * K), K)
    inner = np.concatenate(
        [np.column_stack([i, j])[i + j < K] + 1 / 3, np.column_stack([i, j])[i + j < K - 1] + 2 / 3]
    )
    # Values are taken at the middles of K² parts of a facet.
    hats = np.column_stack([inner / K, 1.0 - inner.sum(axis=1) / K])

    def hertz(places: np.ndarray) -> np.ndarray:
        return np.interp(np.linalg.norm(places, axis=-1), curve.exact_x, curve.exact, right=0.0)

    size = np.abs(np.linalg.det(xy[facets[:, 1:]] - xy[facets[:, :1]])) / 2.0
    integrals, area = np.zeros((2, len(xy)))
    np.add.at(integrals, facets, size[:, None] * (hertz(hats @ xy[facets]) @ hats) / K**2)
    np.add.at(area, facets, size[:, None] / 3.0)
    means = np.divide(integrals, area, out=np.zeros(len(xy)), where=area > 0.0)
    return values | {
        f"nodal pressures, from Hertz's {words}": (nodes_off(state, p), 0.2)
        for words, p in (("at nodes", hertz(xy)), ("means about nodes", means))
    }, curve


@problem("A ball on a rigid plane", (3, 5, 8), "elements on a")
def hertz_solid(n: int, order: Order, folder: Path) -> Results:
    mesh = half_ball(folder / "ball.msh", 0.1, 0.088 / n, order)
    answer = solved(
        [body("ball", mesh, 1.0, 0.3, [*QUARTER, *held(top={"z": -0.0075})])],
        [contact("ball", "floor", "contact")],
        [FLOOR],
    )
    values, curve = with_nodes(answer.contacts["ball-floor"], 1.0 / (1.0 - 0.09), RADIUS, order)
    return values, answer, curve


@problem("Two balls of unlike stiffness", (3, 5, 8), "elements on a of the soft ball")
def two_balls(n: int, order: Order, folder: Path) -> Results:
    soft = half_ball(folder / "soft.msh", 0.08, 0.066 / n, order)
    stiff = half_ball(folder / "stiff.msh", 0.08, 0.053 / n, order, down=True)
    answer = solved(
        [
            body("soft", soft, 1.0, 0.3, [*QUARTER, *held(top={"z": -0.009})]),
            body("stiff", stiff, 5.0, 0.2, [*QUARTER, *held(top="z")]),
        ],
        [contact("soft", "stiff", "contact", "contact")],
    )
    modulus = 1.0 / ((1.0 - 0.09) / 1.0 + (1.0 - 0.04) / 5.0)
    values, curve = with_nodes(answer.contacts["soft-stiff"], modulus, RADIUS / 2, order)
    return values, answer, curve


# Cattaneo and Mindlin


@problem("A ball that is pressed and rubbed", (4, 8), "elements on a", orders=(1,))
def cattaneo_mindlin(n: int, order: Order, folder: Path) -> Results:
    friction, approach, gives = 0.5, 0.0018, 8.0  # the last: Σ (2 − ν)/G
    upper = half_ball(folder / "upper.msh", 0.03, 0.03 / n, order, turn=180.0)
    lower = half_ball(folder / "lower.msh", 0.03, 0.03 / n, order, turn=180.0, down=True)
    a, symmetry = np.sqrt(RADIUS / 2 * approach), held(start="y", end="y")
    push = 3.0 / 16.0 * friction * (2.0 / 3.0 * a * approach) / a * gives * (1.0 - 0.25 ** (2 / 3))
    top = [
        *held(top={"y": 0.0, "z": -approach}),
        *held(top={"x": 1.0, "history": "rub"}),
        *symmetry,
    ]
    answer = solved(
        [body("upper", upper, 1.0, 0.0, top), body("lower", lower, 1.0, 0.0, ["top", *symmetry])],
        [contact("upper", "lower", "contact", "contact", friction=coulomb(friction))],
        history=courses(rub=[(1.0, 0.0), (2.0, push), (3.0, -push), (4.0, push)]),
        time={"points": [1.0, 2.0, 3.0, 4.0], "steps": 8},
    )
    state, steps = (
        answer.contacts["upper-lower"],
        [step["contacts"]["upper-lower"] for step in answer.summary["steps"]],
    )
    P, Q = 2.0 * steps[31]["normal_force"], 2.0 * abs(steps[31]["force"][0])
    a, share = (3.0 * P * RADIUS / 2 / (4.0 * 0.5)) ** (1 / 3), Q / (friction * P)
    inner = a * (1.0 - share) ** (1 / 3)
    loop = (
        9.0
        * (friction * P) ** 2
        / (10.0 * a)
        * gives
        * (1.0 - (1.0 - share) ** (5 / 3) - 5.0 / 6.0 * share * (1.0 + (1.0 - share) ** (2 / 3)))
    )
    x, bound = np.linspace(0.0, 1.3 * a, 300), friction * 3.0 * P / (2.0 * np.pi * a**2)
    shears = bound * (
        np.sqrt(np.maximum(1.0 - (x / a) ** 2, 0.0))
        - inner / a * np.sqrt(np.maximum(1.0 - (x / inner) ** 2, 0.0))
    )
    sticks = state.interface.area[state.status == "stick"].sum()
    return (
        {
            "loop of energy (J)": (2.0 * sum(step["dissipated"] for step in steps[16:]), loop, 0.3),
            "stick radius (m)": (np.sqrt(2.0 * sticks / np.pi), inner, 0.25),
        },
        answer,
        friction_curve(state, a, x, shears),
    )


def friction_curve(state: ContactState, a: float, x: np.ndarray, exact: np.ndarray) -> Curve:
    """Friction over the distance from the axis, up to 1.3 a."""
    r = AWAY(state.interface.xy)
    order = np.argsort(r)[: np.count_nonzero(r < 1.3 * a)]
    return Curve(
        r[order], np.linalg.norm(state.shear, axis=1)[order], x, exact, AWAY.label, "friction (Pa)"
    )


# Lubkin


def twisted(share: float) -> tuple[float, float]:
    """Rotation over ½ 𝓕 p₀ Σ 1/G, and torque over 8/3 𝓕 p₀ a³, of pressed balls that stick up to share · a."""

    def turned(t: float) -> float:
        return float(ellipk(1.0 - t**2) - ellipe(1.0 - t**2))

    return turned(share), share**3 * turned(share) + quad(
        lambda t: 3.0 * t**2 * turned(t), share, 1.0
    )[0]


def twisting_friction(x: float, share: float) -> float:
    """Friction over 𝓕 p₀ at x a from the axis."""
    if x >= share:
        return float(np.sqrt(max(1.0 - x**2, 0.0)))
    return (
        2.0
        / np.pi
        * x
        * quad(lambda t: ellipe(1.0 - t**2) / (t * np.sqrt(t**2 - x**2)), share, 1.0)[0]
    )


@problem(
    "Balls that are pressed and twisted",
    (3, 5, 8),
    "elements on a of the coarser ball",
    tested=2,
)
def twisted_balls(n: int, order: Order, folder: Path) -> Results:
    friction, approach, poisson = 0.5, 0.00045, 0.3
    upper = half_ball(folder / "upper.msh", 0.015, 0.012 / n, order, turn=360.0)
    lower = half_ball(folder / "lower.msh", 0.015, 0.015 / n, order, turn=360.0, down=True)
    a, modulus, gives = (
        np.sqrt(RADIUS / 2 * approach),
        0.5 / (1.0 - poisson**2),
        4.0 * (1.0 + poisson),
    )
    turns = [
        0.5 * friction * 2.0 * modulus * a / (np.pi * RADIUS / 2) * gives * twisted(share)[0]
        for share in (0.8, 0.5)
    ]
    top = [*held(top={"z": -approach}), *held(top={"x": "-y", "y": "x", "history": "turn"})]
    times = [1.0, 2.0, 3.0]
    answer = solved(
        [body("upper", upper, 1.0, poisson, top), body("lower", lower, 1.0, poisson, ["top"])],
        [contact("upper", "lower", "contact", "contact", friction=coulomb(friction))],
        history=courses(turn=zip(times, [0.0, *turns], strict=True)),
        time={"points": times, "steps": 1},
    )
    state, values = answer.contacts["upper-lower"], {}
    for part, turn, step in zip(
        ("a little", "much"), turns, answer.summary["steps"][1:], strict=True
    ):
        told = step["contacts"]["upper-lower"]
        a = (3.0 * told["normal_force"] * RADIUS / 2 / (4.0 * modulus)) ** (1 / 3)
        bound = friction * 3.0 * told["normal_force"] / (2.0 * np.pi * a**2)
        share = brentq(
            lambda c, over: twisted(c)[0] - over, 1e-3, 1.0 - 1e-9, (2.0 * turn / (bound * gives),)
        )
        values[f"turned {part}: torque (N m)"] = (
            abs(told["moment"][2]),
            8.0 / 3.0 * bound * a**3 * twisted(share)[1],
            0.05,
        )
    sticks, x = state.interface.area[state.status == "stick"].sum(), np.linspace(0.0, 1.3, 150)
    values["stick radius (m)"] = np.sqrt(sticks / np.pi), share * a, 0.25
    exact = bound * np.array([twisting_friction(each, share) for each in x])
    return values, answer, friction_curve(state, a, x * a, exact)


# Fits


def fitted(answer: Answer, exact: float, order: Order, position: Position) -> Results:
    (state,), (mean, nodes) = answer.contacts.values(), {1: (0.12, 0.6), 2: (0.03, 0.25)}[order]
    return (
        {
            "mean pressure (Pa)": (mean_pressure(state), exact, mean),
            "nodes, in L2": (nodes_off(state, exact), nodes),
        },
        answer,
        along(state, exact, position),
    )


@problem("Two tubes with interference", (3, 6, 10), "elements across the wall")
def tubes(n: int, order: Order, folder: Path) -> Results:
    a, b, c, fit, E, nu = 0.3, 0.6, 0.9, 6e-5, 2e11, 0.3
    ends = [*QUARTER, *held(bottom="z", top="z")]
    answer = solved(
        [
            body("inner", tube(folder / "inner.msh", a, b + fit, 0.3 / n, order), E, nu, ends),
            body("outer", tube(folder / "outer.msh", b, c, 0.24 / n, order), E, nu, ends),
        ],
        [contact("inner", "outer", "outer", "inner")],
    )
    return fitted(answer, lame_fit(a, b, c, fit, plane_strain(E, nu)), order, ANGLE)


@problem("A ball in a shell with interference", (3, 6, 10), "elements across the shell")
def spheres(n: int, order: Order, folder: Path) -> Results:
    a, b, c, fit, E, nu = 0.25, 0.5, 1.0, 5e-5, 2e11, 0.3
    octant = [*QUARTER, *held(bottom="z")]
    answer = solved(
        [
            body("ball", shell(folder / "ball.msh", a, b + fit, 0.4 / n, order), E, nu, octant),
            body("shell", shell(folder / "shell.msh", b, c, 0.5 / n, order), E, nu, octant),
        ],
        [contact("ball", "shell", "outer", "inner")],
    )
    return fitted(
        answer,
        lame_ball(a, b, c, fit, E, nu),
        order,
        Position(
            lambda xy: np.degrees(np.arcsin(xy[:, 2] / np.linalg.norm(xy, axis=1))), "latitude (°)"
        ),
    )


# Exact stacks


@problem("Sheared stack of boxes")
def sheared_solids(n: int, order: Order, folder: Path) -> Results:
    materials, height, sides = (
        ((2.1e11, 0.3), (1e11, 0.35)),
        np.array([1.0, 0.5]),
        ("left", "right", "front", "back"),
    )
    modulus, stiff = (np.array([form(*each) for each in materials]) for form in (confined, shear))
    down, way, values = 1e-3, np.array([0.8, 0.6, 0.0]), {}
    p, gives = down / (height / modulus).sum(), (height / stiff).sum()
    for name, shift in (("sticks", 0.15 * p * gives), ("slips", 0.6 * p * gives)):
        tau, clamps = min(shift / gives, 0.3 * p), []
        for k, (end, at, moved) in enumerate(
            (("top", 1.5, shift * way - [0, 0, down]), ("bottom", 0.0, 0.0 * way))
        ):
            slope = tau / stiff[k] * way - [0.0, 0.0, p / modulus[k]]
            field = {
                axis: {"constant": float(u - at * du), "z_slope": float(du)}
                for axis, u, du in zip("xyz", moved, slope, strict=True)
            }
            clamps.append(held(**dict.fromkeys((*sides, end), field)))
        answer = solved(
            [
                body(
                    "upper", box(0.0, 0.5, 1.0, (3 * n, 3 * n, n), order), *materials[0], clamps[0]
                ),
                body(
                    "lower", box(0.0, 0.0, 0.5, (4 * n, 4 * n, n), order), *materials[1], clamps[1]
                ),
            ],
            [contact("upper", "lower", "bottom", "top", friction=coulomb(0.3))],
            tolerance=TIGHT,
        )
        state = answer.contacts["upper-lower"]
        tangents = state.interface.tangents[state.interface.sliding]
        friction, slip = (
            np.einsum("ktd,kt->kd", tangents, each[state.interface.sliding])
            for each in (state.shear, state.slip)
        )
        values |= {
            f"{name}: worst pressure": (off(state.pressure, p), EXACT),
            f"{name}: worst friction": (off(friction, tau * way), EXACT),
            f"{name}: worst slip, over U": (
                np.abs(slip - (shift - tau * gives) * way).max() / shift,
                EXACT,
            ),
        }
    return (
        values,
        answer,
        along(state, tau, X, "friction (Pa)", values=np.linalg.norm(state.shear, axis=1)),
    )


@problem("Cubes that overlap, and cubes side by side")
def cubes(n: int, order: Order, folder: Path) -> Results:
    young, overlap, values = 1e9, 0.01, {}
    coarse, fine, symmetry = (2 * n,) * 3, (3 * n,) * 3, held(left="x", front="y")
    for name, drawn, gap in (("drawn", overlap, {}), ("given", 0.0, {"gap": -overlap})):
        answer = solved(
            [
                body(
                    "lower",
                    box(0.0, 0.0, 1.0, coarse, order),
                    young,
                    0.0,
                    symmetry + held(bottom="z"),
                ),
                body(
                    "upper",
                    box(0.0, 1.0 - drawn, 1.0, fine, order),
                    young,
                    0.0,
                    symmetry + held(top="z"),
                ),
            ],
            [contact("upper", "lower", "bottom", "top", **gap)],
            tolerance=TIGHT,
        )
        lower, pressure = answer.bodies["lower"], answer.contacts["upper-lower"].pressure
        values |= {
            f"overlap as {name}: worst pressure": (off(pressure, young * overlap / 2.0), EXACT),
            f"overlap as {name}: worst displacement": (
                off(lower.displacement[:, 2], -overlap / 2.0 * lower.points[:, 2]),
                EXACT,
            ),
        }
    pushes = {"a": 1e-3, "b": 2e-3}
    answer = solved(
        [
            body(
                name,
                box(x, 0.0, 1.0, divisions, order),
                young,
                0.0,
                held(top={"x": 0.0, "y": 0.0, "z": -pushes[name]}),
            )
            for name, x, divisions in (("a", 0.0, coarse), ("b", 1.0, fine))
        ],
        [
            contact("a", "floor", "bottom"),
            contact("b", "floor", "bottom"),
            contact("a", "b", "right", "left"),
        ],
        [FLOOR],
        tolerance=TIGHT,
    )
    values |= {
        f"side by side, {name}: worst pressure": (
            off(answer.contacts[f"{name}-floor"].pressure, young * push),
            EXACT,
        )
        for name, push in pushes.items()
    }
    values["side by side: worst pressure between them"] = (
        np.abs(answer.contacts["a-b"].pressure).max() / young / 1e-3,
        EXACT,
    )
    return values, answer, along(answer.contacts["b-floor"], 2e-3 * young, X)


@problem("Heated cubes on inclined planes")
def heated_cubes(n: int, order: Order, folder: Path) -> Results:
    (young, poisson), gap, turn = (2.1e11, 0.3), 1e-4, 0.7
    c, s = np.cos(turn), np.sin(turn)

    def cube(name: str, low: float, end: str, across: int) -> dict:
        corners = [
            (c * x - s * y, s * x + c * y, z)
            for z in (low, low + 1.0)
            for x, y in ((0, 0), (1, 0), (1, 1), (0, 1))
        ]
        return body(
            name,
            between(corners, (across * n, across * n, n), order),
            young,
            poisson,
            [{"on": on, "normal": 0.0} for on in ("left", "right", "front", "back", end)],
        )

    lower, upper = cube("lower", 0.0, "bottom", 2), cube("upper", 1.0 + gap, "top", 3)
    lower["material"] |= {"expansion": 1.2e-5}
    upper["material"] = {
        "young": [young] * 3,
        "poisson": [poisson] * 3,
        "shear": [shear(young, poisson)] * 3,
    }
    answer = solved(
        [lower | {"temperature": 60.0}, upper], [contact("lower", "upper", "top", "bottom")]
    )
    exact = ((1 + poisson) / (1 - poisson) * 1.2e-5 * 60.0 - gap) * confined(young, poisson) / 2
    state = answer.contacts["lower-upper"]
    return (
        {"worst pressure": (off(state.pressure, exact), EXACT)},
        answer,
        along(state, exact, Position(lambda xy: xy @ [c, s, 0.0], "along a side (m)")),
    )


@problem("A block turned on a plate", (1, 2), "fours of cells along an edge, × n")
def turned_solid(n: int, order: Order, folder: Path) -> Results:
    moment, apart, answer = torque(int(order), 4 * n)
    state = answer.contacts["block-plate"]
    ratio = np.linalg.norm(state.tangential_force, axis=1) / state.normal_force
    return (
        {"moment over Σ μ N r": (moment, 1.0, 0.02), "|T|/N − μ, slid": (apart, 1e-4)},
        answer,
        along(
            state,
            FRICTION,
            Position(lambda xy: np.linalg.norm(xy[:, :2] - 0.5, axis=1), "r (m)"),
            "tangential over normal force",
            values=ratio,
        ),
    )


def quarters(bodies: list[dict], contacts: list[dict]) -> tuple[list[dict], list[dict]]:
    """The bodies of four sectors, and their contacts; one with an image is with the body of the next sector."""
    axis = {"axis": [0.0, 0.0, 1.0]}
    pieces, joints = [], []
    for k in range(4):
        for piece in bodies:
            own = dict(piece)
            if k:
                del own["mesh"], own["material"]
                own["copy"] = {"of": f"{piece['name']}0", "turn": 90.0 * k} | axis
            pieces.append(own | {"name": f"{piece['name']}{k}"})
        for joint in contacts:
            first, second = joint["bodies"]
            other = (k + 1) % 4 if "image" in joint else k
            own = {key: value for key, value in joint.items() if key != "image"}
            joints.append(
                own | {"name": f"{joint['name']}{k}", "bodies": [f"{first}{k}", f"{second}{other}"]}
            )
    return pieces, joints


OUTWARD = Position(lambda xyz: xyz[:, 0] + xyz[:, 1], "x + y (m)")
"""From the inner to the outer edge of a quarter of a square."""


def across_flange(state: ContactState) -> tuple[np.ndarray, np.ndarray]:
    """Places from edge to edge of a flange, and the mean pressure there."""
    at, row = np.unique(np.round(OUTWARD(state.interface.xy), 9), return_inverse=True)
    return at, np.bincount(row.ravel(), state.pressure) / np.bincount(row.ravel())


@problem("A bolted flange as a sector", (1, 2, 3), orders=(1,))
def bolted_sector(n: int, order: Order, folder: Path) -> Results:
    force = 2e8

    def wedge(name: str, inner: float, outer: float, low: float, high: float, **keys: Any) -> dict:
        plane_of = [(inner, 0.0), (outer, 0.0), (0.0, outer), (0.0, inner)]
        corners = [(*at, z) for z in (low, high) for at in plane_of]
        along_radius = max(round(5 * (outer - inner)), 1) * n
        mesh = between(corners, (along_radius, 3 * n, 2 * n), order)
        return body(name, mesh, 2e11, 0.3) | keys

    spin = {"volume_force": ["1e7 * x", "1e7 * y", 0.0]}
    bodies = [
        wedge("lower", 1.0, 2.0, 0.0, 1.0, clamp=["bottom"]),
        wedge("inner", 1.0, 1.4, 1.0, 2.0, **spin),
        wedge("outer", 1.6, 2.0, 1.0, 2.0, **spin),
        wedge("shank", 1.4, 1.6, 1.0, 2.0),
        wedge("head", 1.0, 2.0, 2.0, 2.4),
    ]
    friction = coulomb(0.15)
    joints = [
        contact("shank", "lower", "bottom", "top", kind="bonded", name="thread"),
        contact("head", "shank", "bottom", "top", kind="bonded", name="neck"),
    ]
    joints[0]["pretension"] = {"force": force, "along": [0.0, 0.0, -1.0]}
    for part in ("inner", "outer"):
        joints.append(
            contact(part, "lower", "bottom", "top", friction=friction, name=f"{part}-below")
        )
        joints.append(
            contact("head", part, "bottom", "top", friction=friction, name=f"{part}-above")
        )
    image = {"turn": 90.0, "axis": [0.0, 0.0, 1.0]}
    for piece in bodies:
        name = piece["name"]
        joints.append(
            contact(name, name, "back", "front", kind="bonded", name=f"flank-{name}", image=image)
        )
    one = solved(bodies, joints, tolerance=1e-12)
    whole = solved(*quarters(bodies, joints), tolerance=1e-12)
    names = [piece["name"] for piece in bodies]
    size = max(np.abs(whole.bodies[f"{name}0"].displacement).max() for name in names)
    apart = max(
        np.abs(one.bodies[name].displacement - whole.bodies[f"{name}0"].displacement).max()
        for name in names
    )
    lifted = one.summary["whole"]["contacts"]
    pressed = sum(lifted[f"{part}-below"]["normal_force"] for part in ("inner", "outer"))
    state = one.contacts["inner-below"]
    return (
        {
            "worst displacement, sector less whole": (apart / size, 1e-8),
            "force of all bolts (N)": (-lifted["thread"]["force"][2], 4.0 * force, 1e-8),
            "force under the flange (N)": (pressed, 4.0 * force, 1e-6),
        },
        one,
        along(
            state, lambda x: np.interp(x, *across_flange(whole.contacts["inner-below0"])), OUTWARD
        ),
    )
