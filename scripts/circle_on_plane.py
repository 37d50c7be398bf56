"""A circle pressed on a plane and sheared to and fro: the scene, and the closed forms of Cattaneo and Mindlin.

Two blocks that touch along the x axis, with the gap x²/2R between them, on meshes that gmsh refines towards it.
Lengths in mm, stresses in MPa, forces in N/mm. For `history_study.py`.
"""

import itertools
from pathlib import Path

import numpy as np
from scipy.integrate import quad

import ddmpi
from ddmpi.run.answer import Answer

YOUNG, POISSON, FRICTION = 7.0e4, 0.3, 0.3
RADIUS, HALF = 50.0, 1.0
"""R of the circle, and the half width a of the contact that it is pressed to (mm)."""

FAR = 20.0
"""Blocks reach so many half widths from the contact."""

GROWTH = 0.15
"""Elements grow by this part of the distance from the contact."""


def block_mesh(path: Path, h: float, up: bool, far: float = FAR) -> None:
    """A block above or below the x axis, of `far` half widths, with sides h within 1.4 a of the origin; groups contact
    and end."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        add, sign, size = gmsh.model.geo, 1.0 if up else -1.0, far * HALF
        near = 1.4 * HALF
        corners = [(-size, 0.0), (-near, 0.0), (near, 0.0), (size, 0.0), (size, sign * size), (-size, sign * size)]
        points = [add.addPoint(x, y, 0.0) for x, y in corners]
        lines = [add.addLine(a, b) for a, b in zip(points, points[1:] + points[:1], strict=True)]
        surface = add.addPlaneSurface([add.addCurveLoop(lines)])
        gmsh.model.geo.mesh.setTransfiniteCurve(lines[1], 2 * round(near / h) + 1)
        add.synchronize()
        gmsh.model.addPhysicalGroup(1, lines[1:2], name="contact")
        gmsh.model.addPhysicalGroup(1, lines[4:5], name="end")
        gmsh.model.addPhysicalGroup(2, [surface], name="block")
        away = f"(sqrt(x*x+y*y)-{near})"
        field = gmsh.model.mesh.field.add("MathEval")
        gmsh.model.mesh.field.setString(field, "F", f"{h}+{GROWTH}*0.5*({away}+abs({away}))")
        gmsh.model.mesh.field.setAsBackgroundMesh(field)
        for option in ("MeshSizeExtendFromBoundary", "MeshSizeFromPoints"):
            gmsh.option.setNumber(f"Mesh.{option}", 0)
        gmsh.model.mesh.generate(2)
        gmsh.option.setNumber("Mesh.MshFileVersion", 4.1)
        gmsh.write(str(path))
    finally:
        gmsh.finalize()


def circle_on_plane(folder: Path, nodes: int, order: int, depth: float, histories: dict[str, tuple[list, list]],
                    points: list[float], shift: float = 0.0, soft: tuple[float, float] = (YOUNG, POISSON),
                    extra: str = "", far: float = FAR) -> str:
    """The scene of two blocks pressed by `depth` and sheared by `shift` (mm), with so many `nodes` on a.

    Blocks of `far` half widths instead of FAR are pressed further, as logarithms of both go.
    """
    h = HALF / nodes * order
    for name in ("upper", "lower"):
        block_mesh(folder / f"{name}.msh", h, name == "upper", far)
    depth += HALF**2 / (2 * RADIUS) * float(np.log(far / FAR))
    x = np.linspace(-2.0 * HALF, 2.0 * HALF, 4 * 1401)
    gap = {"along": "x", "points": x.tolist(), "values": (x**2 / (2 * RADIUS)).tolist()}
    history = "\n".join(f"[history.{name}]\ntimes = {times}\nfactors = {factors}"
                        for name, (times, factors) in histories.items())
    shear = f', {{ on = "end", x = {shift!r}, history = "shear" }}' if shift else ', { on = "end", x = 0.0 }'
    return f"""
title = "Circle on a plane"
[[body]]
name = "upper"
mesh = {{ file = "{folder}/upper.msh", order = {order} }}
material = {{ young = {soft[0]!r}, poisson = {soft[1]!r} }}
clamp = [{{ on = "end", y = {-depth!r}, history = "press" }}{shear}]
[[body]]
name = "lower"
mesh = {{ file = "{folder}/lower.msh", order = {order} }}
material = {{ young = {YOUNG!r}, poisson = {POISSON!r} }}
clamp = ["end"]
[[contact]]
name = "seam"
bodies = ["upper", "lower"]
on = ["contact", "contact"]
friction = {{ law = "coulomb", coefficient = {FRICTION} }}
gap = {{ along = "x", points = {gap["points"]}, values = {gap["values"]} }}
{history}
[time]
points = {points}
{extra}
[output]
stress = false
"""


def solve(scene: str, **overrides) -> Answer:
    answer = ddmpi.solve(scene, overrides={key.replace("__", "."): value for key, value in overrides.items()})
    assert answer.certified, answer.reason
    return answer


def stiffness() -> float:
    """E* of two equal bodies."""
    return YOUNG / (1 - POISSON**2) / 2


SHIFT = 0.0093
"""Displacement of the upper end along x (mm), for about 0.6 of the largest tangential force."""

PRESS = 0.0355
"""Approach of the ends (mm) at which the half width is a, for blocks of 20 a."""


def ellipse(x: np.ndarray, c: float) -> np.ndarray:
    """c √(1 − x²/c²), zero outside."""
    return np.sqrt(np.maximum(c**2 - x**2, 0.0))


def cattaneo_stress(x: np.ndarray, turns: list[float], pressed: float, force: float) -> np.ndarray:
    """q of a contact pressed to the half width `pressed` by `force` and then sheared to the `turns` Q/μP in turn.

    Each reversal adds a Cattaneo distribution of twice the size (Mindlin and Deresiewicz, 1953), as long as no turn
    exceeds the ones before.
    """
    peak = FRICTION * 2 * force / (np.pi * pressed) / pressed
    q, before = np.zeros_like(x), 0.0
    for k, turn in enumerate(turns):
        size, sign = (1.0, np.sign(turn)) if k == 0 else (2.0, np.sign(turn - before))
        c = pressed * np.sqrt(1 - abs(turn - before) / size)
        q += sign * size * peak * (ellipse(x, pressed) - ellipse(x, c))
        before = turn
    return q


def sides(contact) -> tuple[np.ndarray, np.ndarray]:
    """The sides of the contact between x[0] and x[1] (2, ns), and their nodes (ns, k): ends, and the middle if any."""
    interface = contact.interface
    ends = interface.xy[interface.facets[:, :2], 0].T
    return ends, interface.facets


SHAPES = {2: lambda t: np.array([1 - t, t]),
          3: lambda t: np.array([(1 - t) * (1 - 2 * t), t * (2 * t - 1), 4 * t * (1 - t)])}
"""Shape functions of sides with so many nodes, over t from 0 to 1."""

FINE = (np.arange(2000) + 0.5) / 2000
"""Points on a side at which q_exact is looked at."""


def errors_of(contact, q: np.ndarray, turns: list[float], pressed: float, force: float) -> dict[str, float]:
    """L2 of q − q_exact over that of μp, of nodal stresses q (m,) after the `turns`.

    "means": of means over sides, which do not swing with quadratic elements; "nodes": at the nodes; "forces": of the
    means that the exact nodal forces ∫ q_exact φ would have; "edges": the part of the squared error of the means
    within one side of where q has a kink or a vertical tangent; "beyond": by how much an exact nodal force exceeds the
    slip bound of the exact pressure at a node under pressure, over its length and the largest μp.
    """
    (start, end), nodes = sides(contact)
    length, shapes = np.abs(end - start), SHAPES[nodes.shape[1]]
    places = start[:, None] + FINE * (end - start)[:, None]
    exact, bound = (cattaneo_stress(places, each, pressed, force) for each in (turns, [1.0]))
    q = q * np.sign(q[nodes[:, 0]] @ exact.mean(axis=1))
    forces, bounds = np.zeros((2, len(q)))
    for sums, values in ((forces, exact), (bounds, bound)):
        np.add.at(sums, nodes, length[:, None] * values @ shapes(FINE).T / len(FINE))
    weights = shapes(FINE).mean(axis=1)
    size = np.sqrt(length @ (bound**2).mean(axis=1))

    def l2(error: np.ndarray, weight: np.ndarray) -> float:
        return float(np.sqrt(weight @ error**2) / size)

    means = q[nodes] @ weights - exact.mean(axis=1)
    kinks = [pressed, *(pressed * np.sqrt(1 - abs(turn - last) / (2 if k else 1))
                        for k, (last, turn) in enumerate(itertools.pairwise([0.0, *turns])))]
    near = np.min([np.abs(np.abs(start + end) / 2 - kink) for kink in kinks], axis=0) <= length
    x, area = contact.interface.xy[:, 0], contact.interface.area
    inside = np.abs(x) < pressed
    return {"means": l2(means, length), "nodes": l2(q - cattaneo_stress(x, turns, pressed, force), area),
            "forces": l2((forces / area)[nodes] @ weights - exact.mean(axis=1), length),
            "edges": l2(means[near], length[near]) ** 2 / l2(means, length) ** 2,
            "beyond": max(float(((np.abs(forces) - bounds) / area)[inside].max() / bound.max()), 0.0)}


def nearest(contact, turns: list[float], pressed: float) -> float:
    """The smallest L2 of q_h − q_exact over that of μp that a continuous function q_h on the sides can have."""
    (start, end), nodes = sides(contact)
    length, shapes = np.abs(end - start), SHAPES[nodes.shape[1]](FINE)
    places = start[:, None] + FINE * (end - start)[:, None]
    exact, bound = cattaneo_stress(places, turns, pressed, 1.0), cattaneo_stress(places, [1.0], pressed, 1.0)
    A, b = np.zeros((nodes.max() + 1,) * 2), np.zeros(nodes.max() + 1)
    np.add.at(A, (nodes[:, :, None], nodes[:, None]), length[:, None, None] * (shapes @ shapes.T) / len(FINE))
    np.add.at(b, nodes, length[:, None] * exact @ shapes.T / len(FINE))
    left = length @ (exact**2).mean(axis=1) - b @ np.linalg.solve(A, b)
    return float(np.sqrt(left / (length @ (bound**2).mean(axis=1))))


def loop_energy(turn: float, pressed: float, force: float) -> float:
    """What a cycle between ± turn μP dissipates (N): twice ∫ μp |Δu_t| over the slip zone of a reversal."""
    peak, c = 2 * force / (np.pi * pressed), pressed * np.sqrt(1 - turn)

    def slip(x: float) -> float:
        return 4 * FRICTION * peak / (stiffness() * pressed) * quad(lambda t: np.sqrt(t * t - c * c), c, x)[0]

    return 2 * 2 * quad(lambda x: FRICTION * peak * np.sqrt(1 - (x / pressed) ** 2) * slip(x), c, pressed)[0]


def shear_forces(answer: Answer) -> list[tuple[float, float, float]]:
    """Time, Q and P of all steps."""
    return [(step["time"], -step["contacts"]["seam"]["tangential_force"], step["contacts"]["seam"]["normal_force"])
            for step in answer.summary["steps"]]


def loop(folder: Path, nodes: int, order: int, turns: list[float], share: float = 1.0, far: float = FAR,
         **values) -> tuple[Answer, dict[float, dict[str, float]], dict[float, float], float]:
    """Pressed by time 1, then sheared to the `turns` (over SHIFT times `share`) at times 2, 3, …

    Returns the answer, `errors_of` the stresses and `nearest` by time, Q/μP by time, and the error of the energy that
    the last leg dissipates, a half of a loop.
    """
    times = [float(k) for k in range(len(turns) + 2)]
    histories = {"press": ([0.0, 1.0], [0.0, 1.0]), "shear": (times, [0.0, 0.0, *turns])}
    answer = solve(circle_on_plane(folder, nodes, order, PRESS, histories, times[1:], shift=share * SHIFT, far=far),
                   **values)
    contact, P = answer.contacts["seam"], answer.contacts["seam"].normal_force.sum()
    pressed = float(np.sqrt(4 * P * RADIUS / (np.pi * stiffness())))
    at = {t: Q / (FRICTION * P) for t, Q, _ in shear_forces(answer)}
    errors = {}
    for t, _, _, stresses in answer.solved.steps.kept[1:]:
        so_far = [at[each] for each in times[2:] if each <= t]
        errors[t] = errors_of(contact, stresses[:, 1], so_far, pressed, P) | {
            "nearest": nearest(contact, so_far, pressed)}
    dissipated = sum(s["contacts"]["seam"]["dissipated"] for s in answer.summary["steps"] if s["time"] > times[-2])
    energy = dissipated / (0.5 * loop_energy(abs(at[times[-1]] - at[times[-2]]) / 2, pressed, P)) - 1
    return answer, errors, at, float(energy)
