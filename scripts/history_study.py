"""Load steps against closed forms: the numbers of docs/load_steps.md.

    OMP_NUM_THREADS=1 python scripts/history_study.py [cattaneo dissimilar torsion raous paths fretting cost ...]

On one rank. Lengths in mm, stresses in MPa, forces in N/mm. Contacts of circles are blocks that touch along the x axis,
with the gap x²/2R between them, on meshes that gmsh refines towards the contact.
"""

from __future__ import annotations

import sys
import tempfile
import time
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


def block_mesh(path: Path, h: float, up: bool) -> None:
    """A block above or below the x axis with sides h within 1.4 a of the origin; groups contact and end."""
    import gmsh

    gmsh.initialize(interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        add, sign, size = gmsh.model.geo, 1.0 if up else -1.0, FAR * HALF
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
                    extra: str = "") -> str:
    """The scene of two blocks pressed by `depth` and sheared by `shift` (mm), with so many `nodes` on a."""
    h = HALF / nodes * order
    for name in ("upper", "lower"):
        block_mesh(folder / f"{name}.msh", h, name == "upper")
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


def stress_error(contact, turns: list[float], pressed: float, force: float) -> float:
    """L2 of q − q_exact over that of μp; with quadratic elements of means over sides, which do not swing."""
    interface, q = contact.interface, contact.shear[:, 0]
    edges, x, weight = interface.edges, interface.xy[:, 0], interface.area
    exact = cattaneo_stress(x, turns, pressed, force)
    if len(edges):
        start, end, middle = edges.T
        q, weight = (q[start] + 4 * q[middle] + q[end]) / 6, np.abs(x[end] - x[start])
        places = x[start][:, None] + np.linspace(0.0, 1.0, 201) * (x[end] - x[start])[:, None]
        exact, x = cattaneo_stress(places, turns, pressed, force).mean(axis=1), x[middle]
    bound = FRICTION * 2 * force / (np.pi * pressed) * ellipse(x, pressed) / pressed
    return float(np.sqrt(weight @ (np.sign(q @ exact) * q - exact) ** 2 / (weight @ bound**2)))


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


def cattaneo(folder: Path, nodes: int = 16) -> None:
    """Pressed, sheared to Q, to −Q, to Q again and to none: stresses and the energy of the loop."""
    print(f"Cattaneo and Mindlin, {nodes} nodes on a: L2 of q − q_exact over that of μp")
    times = [0.0, 1.0, 2.0, 3.0, 4.0, 5.0]
    histories = {"press": ([0.0, 1.0], [0.0, 1.0]), "shear": (times, [0.0, 0.0, 1.0, -1.0, 1.0, 0.0])}
    for order in (1, 2):
        scene = circle_on_plane(folder, nodes, order, PRESS, histories, times[1:], shift=SHIFT)
        errors, rows = [], None
        for last in (2.0, 3.0, 4.0, 5.0):
            points = [point for point in times[1:] if point <= last]
            answer = solve(scene, time__points=points)
            rows, contact = shear_forces(answer), answer.contacts["seam"]
            at = {t: (Q, P) for t, Q, P in rows}
            P = at[last][1]
            pressed = np.sqrt(4 * P * RADIUS / (np.pi * stiffness()))
            turns = [at[t][0] / (FRICTION * P) for t in points[1:]]
            errors.append(stress_error(contact, turns, pressed, P))
            if last == 4.0:
                dissipated = {s["time"]: s["contacts"]["seam"]["dissipated"] for s in answer.summary["steps"]}
                loop = sum(value for t, value in dissipated.items() if 2.0 < t <= 4.0)
                exact_loop = loop_energy(abs(turns[-1]), pressed, P)
                turn = abs(turns[-1])
        print(f"  order {order}: a = {pressed:.4f}, Q/μP = {turn:.3f}, errors after loading, reversal, reloading, "
              f"unloading: {', '.join(f'{each:.2%}' for each in errors)}; energy of the loop "
              f"{loop / exact_loop - 1:+.2%}, steps {len(rows)}, n = {answer.summary['n']}, residual of energy "
              f"{answer.summary['energy']['residual']:.0e}",
              flush=True)


def edges(folder: Path, nodes: int = 16) -> None:
    """Sheared and let go, by several shifts: q after unloading over where the edge of back slip lies between nodes."""
    histories = {"press": ([0.0, 1.0], [0.0, 1.0]), "shear": ([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 1.0, 0.0])}
    for order in (1, 2):
        errors = []
        for share in (0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1):
            scene = circle_on_plane(folder, nodes, order, PRESS, histories, [1.0, 2.0, 3.0], shift=share * SHIFT)
            answer = solve(scene, time__steps=1)
            at = {t: (Q, P) for t, Q, P in shear_forces(answer)}
            P = at[3.0][1]
            pressed = np.sqrt(4 * P * RADIUS / (np.pi * stiffness()))
            errors.append(stress_error(answer.contacts["seam"], [at[t][0] / (FRICTION * P) for t in (2.0, 3.0)],
                                       pressed, P))
        print(f"order {order}, after unloading, by shift: {', '.join(f'{each:.1%}' for each in errors)}; mean "
              f"{np.mean(errors):.1%}", flush=True)


def dissimilar(folder: Path, nodes: int = 16) -> None:
    """Pressed only, with unlike materials, so that nodes slip as they touch: error of a run to time.tolerance."""
    histories = {"press": ([0.0, 1.0], [0.0, 1.0])}
    scene = circle_on_plane(folder, nodes, 1, PRESS, histories, [1.0], soft=SOFT)
    fine = solve(scene, time__steps=512).contacts["seam"]
    size = np.hypot(np.linalg.norm(fine.normal_force), np.linalg.norm(fine.tangential_force))
    print("P alone, dissimilar bodies: forces against a run with 512 steps")
    for text, values in [*((f"{k} equal steps", {"time__steps": k}) for k in (1, 8, 32)),
                         *((f"tolerance {t}", {"time__tolerance": t}) for t in (0.02, 0.01))]:
        start = time.time()
        answer = solve(scene, **values)
        contact = answer.contacts["seam"]
        error = np.hypot(np.linalg.norm(contact.normal_force - fine.normal_force),
                         np.linalg.norm(contact.tangential_force - fine.tangential_force)) / size
        shear = np.linalg.norm(contact.tangential_force - fine.tangential_force)
        print(f"  {text}: {error:.2%} of all forces, {shear / np.linalg.norm(fine.tangential_force):.2%} of the "
              f"tangential ones, {len(answer.summary['steps'])} steps, {time.time() - start:.1f} s", flush=True)


def torsion(folder: Path) -> None:
    """A shrink fit turned to 0.5, 1.5, −1.5 and 0 of the angle at which it slips: torque and energy."""
    del folder
    a, b, c, overlap = 20.0, 40.0, 60.0, 0.02
    shear = YOUNG / (2 * (1 + POISSON))
    bulk = 2 * shear / (1 - 2 * POISSON)  # 2 (λ + G); both rims are held, so that u = A (r − rim²/r) in each ring
    pressure = overlap / sum(abs(b - rim**2 / b) / (bulk + 2 * shear * rim**2 / b**2) for rim in (a, c))
    limit = 2 * np.pi * b**2 * FRICTION * pressure
    spring = 4 * np.pi / ((1 / a**2 - 1 / b**2) / shear + (1 / b**2 - 1 / c**2) / shear)
    angle = limit / spring
    print(f"Shrink fit: p = {pressure:.3f} MPa, largest torque {limit:.5g} N at {angle:.3e}")
    for order, around in ((1, 96), (2, 48)):
        def ring(name: str, radii: list[float], clamp: str, around: int = around, order: int = order) -> str:
            return (f'[[body]]\nname = "{name}"\nmesh = {{ shape = "annulus", center = [0.0, 0.0], radii = {radii}, '
                    f'angles = [0.0, 360.0], divisions = [{around}, {around // 6}], order = {order} }}\n'
                    f"material = {{ young = {YOUNG}, poisson = {POISSON} }}\nclamp = [{clamp}]\n")

        turned = (f'{{ on = "outer", x = {{ y_slope = {-angle} }}, y = {{ x_slope = {angle} }}, history = "turn" }}')
        scene = (ring("shaft", [a, b], '{ on = "inner", x = 0.0, y = 0.0 }') + ring("hub", [b, c], turned) + f"""
[[contact]]
name = "fit"
bodies = ["shaft", "hub"]
on = ["outer", "inner"]
friction = {{ law = "coulomb", coefficient = {FRICTION} }}
gap = {-overlap}
[history.turn]
times = [0.0, 1.0, 2.0, 3.0, 4.0]
factors = [0.0, 0.5, 1.5, -1.5, 0.0]
[time]
points = [1.0, 2.0, 3.0, 4.0]
[output]
stress = false
""")
        answer = solve(scene)
        steps = {step["time"]: step["contacts"]["fit"] for step in answer.summary["steps"]}
        torques = [steps[t]["moment"] for t in (1.0, 2.0, 3.0, 4.0)]
        dissipated = sum(step["dissipated"] for step in steps.values())
        print(f"  order {order}: p {steps[1.0]['normal_force'] / (2 * np.pi * b) / pressure - 1:+.2%}, torques over "
              f"the limit {[round(t / limit, 4) for t in torques]}, dissipated "
              f"{dissipated / (1.5 * limit * angle) - 1:+.2%}, "
              f"steps {len(answer.summary['steps'])}, residual {answer.summary['energy']['residual']:.0e}", flush=True)


def raous(folder: Path) -> None:
    """A block on a rigid plane, pressed, pulled and let go: what is left of the tangential forces."""
    del folder
    scene = """
[[body]]
name = "block"
mesh = { shape = "rectangle", origin = [0.0, 0.0], size = [80.0, 40.0], divisions = [48, 24] }
material = { young = 13e3, poisson = 0.2 }
traction = [{ on = "top", value = [0.0, -5.0] }, { on = "right", value = [10.0, -5.0], history = "pull" }]
[[rigid]]
name = "floor"
shape = "plane"
point = [0.0, 0.0]
normal = [0.0, 1.0]
[[contact]]
name = "foot"
bodies = ["block", "floor"]
on = ["bottom"]
friction = { law = "coulomb", coefficient = 1.0 }
[history.pull]
times = [0.0, 1.0, 2.0]
factors = [0.0, 1.0, 0.0]
[time]
points = [1.0, 2.0]
"""
    print("Block on a rigid plane, pressed by 5 MPa, pulled by 10 MPa and let go")
    answer = solve(scene)
    contact, total = answer.contacts["foot"], solve(scene, history__pull__factors=[0.0, 0.0, 0.0]).contacts["foot"]
    for text, each in (("history", contact), ("without it", total)):
        print(f"  {text}: Σ|T|/N {np.abs(each.tangential_force).sum() / each.normal_force.sum():.3f}, "
              f"{each.count('slip')} slip, {each.count('stick')} stick")
    apart = np.linalg.norm(contact.tangential_force - total.tangential_force) / np.linalg.norm(total.normal_force)
    print(f"  forces apart by {apart:.1%} of the pressure; energy residual {answer.summary['energy']['residual']:.0e}")


def steps(folder: Path) -> None:
    """Sheared to and fro at constant pressure in 1, 2, …, 16 steps a leg: how far apart forces are at the end."""
    histories = {"press": ([0.0, 1.0], [0.0, 1.0]), "shear": ([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 1.0, -0.6])}
    scene = circle_on_plane(folder, 16, 1, PRESS, histories, [1.0, 2.0, 3.0], shift=SHIFT)
    runs = {k: solve(scene, time__steps=k, method__tolerance=1e-13).contacts["seam"] for k in (1, 2, 4, 8, 16)}
    apart = {k: np.abs(each.forces - runs[1].forces).max() / np.abs(runs[1].forces).max() for k, each in runs.items()}
    print(f"Constant pressure, {runs[1].count('slip')} slip, {runs[1].count('stick')} stick: forces apart from those "
          f"of one step a leg by {', '.join(f'{k}: {value:.0e}' for k, value in apart.items() if k > 1)}")


def paths(folder: Path, number: int = 100) -> None:
    """Random paths of the tangential load: iterations by step, and that none cycles."""
    histories = {"press": ([0.0, 1.0], [0.0, 1.0])}
    scene = circle_on_plane(folder, 8, 1, PRESS, histories | {"shear": ([0.0], [1.0])}, [1.0], shift=SHIFT)
    rng, found, cold = np.random.default_rng(0), [], []
    for _ in range(number):
        turns = [0.0, 0.0, *rng.uniform(-1.2, 1.2, 6).tolist()]
        times = [float(k) for k in range(8)]
        answer = solve(scene, history__shear__times=times, history__shear__factors=turns, time__points=times[1:],
                       time__steps=4)
        iterations = [step["outer_iterations"] for step in answer.summary["steps"]]
        cold.append(iterations[0])
        found += iterations[4:]
    counts = np.array(found)
    print(f"{number} random paths of 6 turns, 4 steps a leg: {len(counts)} sheared steps, {counts.mean():.1f} steps "
          f"on average, {np.percentile(counts, 95):.0f} in 95 %, {counts.max()} at most; the first step "
          f"{np.mean(cold):.1f}")


def fretting(folder: Path, cycles: int = 8) -> None:
    """Cycles of shear under unlike materials: what each cycle dissipates, and whether it settles."""
    turns = [0.0, 0.0, *[1.0, -1.0] * cycles]
    times = [float(k) for k in range(len(turns))]
    histories = {"press": ([0.0, 1.0], [0.0, 1.0]), "shear": (times, turns)}
    scene = circle_on_plane(folder, 16, 1, PRESS, histories, times[1:], shift=SHIFT, soft=SOFT)
    answer = solve(scene)
    by_leg = np.zeros(len(turns))
    for step in answer.summary["steps"]:
        by_leg[int(np.ceil(step["time"] - 1e-9))] += step["contacts"]["seam"]["dissipated"]
    each = by_leg[3:-1].reshape(-1, 2).sum(axis=1)
    print(f"Fretting, unlike materials: dissipated by cycle {[float(f'{value:.4g}') for value in each]} N, "
          f"{len(answer.summary['steps'])} steps")


def cost(folder: Path) -> None:
    """What a later step costs beside the first run, at N = 86 of the pinched blocks."""
    scene = Path(__file__).resolve().parents[1] / "configs" / "pinched_blocks.toml"
    del folder
    text = scene.read_text(encoding="utf-8").replace("value = [2.0e7, 3.0e7]",
                                                     'value = [2.0e7, 3.0e7], history = "pull"')
    text += """
[history.pull]
times = [0.0, 10.0]
factors = [1.0, 0.0]
[time]
points = [10.0]
steps = 1
"""
    seconds, phases = {}, {}
    for steps in (1, 41):
        begin = time.time()
        answer = solve(text, time__steps=steps, body__upper__mesh__divisions=[258, 86],
                       body__lower__mesh__divisions=[258, 86])
        seconds[steps], phases[steps] = time.time() - begin, answer.summary["seconds"]
    later = {name: (phases[41][name] - phases[1][name]) / 40 for name in ("outer", "recover")}
    iterations = [step["outer_iterations"] for step in answer.summary["steps"]]
    print(f"N = 86, n = {answer.summary['n']}: one step {seconds[1]:.2f} s in all; a later step "
          f"{1e3 * later['outer']:.0f} ms of Newton steps ({np.mean(iterations[1:]):.1f} of them) and "
          f"{1e3 * later['recover']:.0f} ms of recovery, {sum(later.values()) / seconds[1]:.1%} of the first run")


SOFT = (7.0e4 / 3.0, 0.3)
"""Young's modulus and Poisson's ratio of the softer body, for Dundurs' β = 1/7."""


SHIFT = 0.0093
"""Displacement of the upper end along x (mm), for about 0.6 of the largest tangential force."""


if __name__ == "__main__":
    studies = sys.argv[1:] or ["cattaneo", "edges", "dissimilar", "torsion", "steps", "raous", "paths", "fretting",
                                "cost"]
    with tempfile.TemporaryDirectory() as path:
        for name in studies:
            start = time.time()
            globals()[name](Path(path))
            print(f"  ({time.time() - start:.0f} s)\n", flush=True)
