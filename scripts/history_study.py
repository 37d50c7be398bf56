#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Load steps against closed forms: the numbers of docs/use/load_steps.md.

    scripts/study history_study [SECTION ...]

A section is one of STUDIES; all of them take about ten minutes, on one rank. Lengths in mm, stresses in MPa, forces in
N/mm.
"""

import itertools
import logging
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from experiment import arguments
from problems import annulus, body, contact, coulomb
from scenes import to_toml
from scipy.integrate import quad

import ddmpi
from ddmpi.mesh.read import gmsh_session
from ddmpi.run.answer import Answer

# A circle pressed on a plane and sheared to and fro: two blocks that touch along the x axis, with the gap x²/2R, on
# meshes that gmsh refines towards it; and the closed forms of Cattaneo and Mindlin

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
    with gmsh_session() as gmsh:
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


def circle_on_plane(folder: Path, nodes: int, order: int, depth: float, histories: dict[str, tuple[list, list]],
                    points: list[float], shift: float = 0.0, soft: tuple[float, float] = (YOUNG, POISSON),
                    far: float = FAR) -> dict:
    """The scene of two blocks pressed by `depth` and sheared by `shift` (mm), with so many `nodes` on a.

    Blocks of `far` half widths instead of FAR are pressed further, as logarithms of both go.
    """
    h = HALF / nodes * order
    for name in ("upper", "lower"):
        block_mesh(folder / f"{name}.msh", h, name == "upper", far)
    depth += HALF**2 / (2 * RADIUS) * float(np.log(far / FAR))
    x = np.linspace(-2.0 * HALF, 2.0 * HALF, 4 * 1401)
    gap = {"along": "x", "points": x.tolist(), "values": (x**2 / (2 * RADIUS)).tolist()}
    press = {"on": "end", "y": -depth, "history": "press"}
    shear = {"on": "end", "x": shift} | ({"history": "shear"} if shift else {})
    return {"title": "Circle on a plane", "body": [
        body("upper", {"file": f"{folder}/upper.msh", "order": order}, *soft, [press, shear]),
        body("lower", {"file": f"{folder}/lower.msh", "order": order}, YOUNG, POISSON, ["end"])],
        "contact": [contact("upper", "lower", "contact", "contact", name="seam", friction=coulomb(FRICTION), gap=gap)],
        "history": {name: history(*each) for name, each in histories.items()}} | timed(points)


def history(times: list[float], factors: list[float]) -> dict:
    return {"times": times, "factors": factors}


def timed(points: list[float], **more) -> dict:
    """The ends of the legs of a scene, whose files need no stress."""
    return {"time": {"points": points} | more, "output": {"stress": False}}


def solve(scene: str | dict, **overrides) -> Answer:
    text = scene if isinstance(scene, str) else to_toml(scene)
    answer = ddmpi.solve(text, overrides={key.replace("__", "."): value for key, value in overrides.items()})
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


# Studies

def cattaneo(folder: Path, nodes: int = 16) -> None:
    """Pressed, sheared to Q, to −Q, to Q again and to none: stresses, and the energy of a loop."""
    print(f"Cattaneo and Mindlin, {nodes} nodes on a: L2 of q − q_exact over that of μp, means over sides (at nodes)")
    for order in (1, 2):
        _, errors, at, _ = loop(folder, nodes, order, [1.0, -1.0, 1.0, 0.0])
        answer, _, _, energy = loop(folder, nodes, order, [1.0, -1.0, 1.0])
        found = ", ".join(f"{each['means']:.2%} ({each['nodes']:.2%})" for each in errors.values())
        print(f"  order {order}: Q/μP = {abs(at[2.0]):.3f}, after loading, reversal, reloading, unloading: {found}; "
              f"energy of the loop {energy:+.2%}, steps {len(answer.summary['steps'])}, n = {answer.summary['n']}, "
              f"residual of energy {answer.summary['energy']['residual']:.0e}", flush=True)


def edges(folder: Path) -> None:
    """Sheared, let go, and sheared to and fro, by seven shifts, so that the edges of slip lie elsewhere in a side."""
    print("By seven shifts: L2 of q − q_exact over that of μp after unloading; energy of a loop")
    for nodes, far in ((16, FAR), (32, FAR), (64, FAR), (64, 2 * FAR)):
        for order in (1, 2) if far == FAR else (2,):
            found, energies = [], []
            for share in (0.8, 0.85, 0.9, 0.95, 1.0, 1.05, 1.1):
                _, errors, _, energy = loop(folder, nodes, order, [1.0, 0.0, 1.0, -1.0], share, far, time__steps=1)
                found.append(errors[3.0])
                energies.append(energy)

            def row(values: list[float], digits: str = ".1%") -> str:
                return f"{', '.join(f'{value:{digits}}' for value in values)}; mean {np.mean(values):{digits}}"

            def of(kind: str, found: list[dict[str, float]] = found) -> list[float]:
                return [each[kind] for each in found]

            print(f"  {nodes} nodes on a, blocks of {far:.0f} a, order {order}: means over sides {row(of('means'))}\n"
                  f"    at nodes {row(of('nodes'))}\n    means of the exact nodal forces {row(of('forces'))}\n"
                  f"    nearest function on the sides {row(of('nearest'))}\n"
                  f"    within a side of the edges {np.mean(of('edges')):.0%} of the squared error of the means; exact "
                  f"nodal forces beyond the bound by {max(of('beyond')):.1%} of the largest μp at most\n"
                  f"    energy {row(energies, '+.1%')}", flush=True)


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
    a, b, c, overlap = 20.0, 40.0, 60.0, 0.02
    shear = YOUNG / (2 * (1 + POISSON))
    bulk = 2 * shear / (1 - 2 * POISSON)  # 2 (λ + G); both rims are held, so that u = A (r − rim²/r) in each ring
    pressure = overlap / sum(abs(b - rim**2 / b) / (bulk + 2 * shear * rim**2 / b**2) for rim in (a, c))
    limit = 2 * np.pi * b**2 * FRICTION * pressure
    spring = 4 * np.pi / ((1 / a**2 - 1 / b**2) / shear + (1 / b**2 - 1 / c**2) / shear)
    angle = limit / spring
    print(f"Shrink fit: p = {pressure:.3f} MPa, largest torque {limit:.5g} N at {angle:.3e}")
    for order, around in ((1, 96), (2, 48)):
        def ring(name: str, radii: tuple[float, float], clamp: dict, around: int = around, order: int = order) -> dict:
            mesh = annulus(radii, (around, around // 6), order, folder, (0.0, 360.0))
            return body(name, mesh, YOUNG, POISSON, [clamp])

        turned = {"on": "outer", "x": {"y_slope": -angle}, "y": {"x_slope": angle}, "history": "turn"}
        scene = {"body": [ring("shaft", (a, b), {"on": "inner", "x": 0.0, "y": 0.0}), ring("hub", (b, c), turned)],
                 "contact": [contact("shaft", "hub", "outer", "inner", name="fit", friction=coulomb(FRICTION),
                                     gap=-overlap)],
                 "history": {"turn": history([0.0, 1.0, 2.0, 3.0, 4.0], [0.0, 0.5, 1.5, -1.5, 0.0])},
                 } | timed([1.0, 2.0, 3.0, 4.0])
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
    block = body("block", {"shape": "rectangle", "origin": [0.0, 0.0], "size": [80.0, 40.0], "divisions": [48, 24]},
                 13e3, 0.2, [], {"top": (0.0, -5.0), "right": (10.0, -5.0)})
    block["traction"][1]["history"] = "pull"
    scene = {"body": [block], "rigid": [FLOOR], "history": {"pull": history([0.0, 1.0, 2.0], [0.0, 1.0, 0.0])},
             "contact": [contact("block", "floor", "bottom", name="foot", friction=coulomb(1.0))],
             "time": {"points": [1.0, 2.0]}}
    print("Block on a rigid plane, pressed by 5 MPa, pulled by 10 MPa and let go")
    answer = solve(scene)
    state, total = answer.contacts["foot"], solve(scene, history__pull__factors=[0.0, 0.0, 0.0]).contacts["foot"]
    for text, each in (("history", state), ("without it", total)):
        print(f"  {text}: Σ|T|/N {np.abs(each.tangential_force).sum() / each.normal_force.sum():.3f}, "
              f"{each.count('slip')} slip, {each.count('stick')} stick")
    apart = np.linalg.norm(state.tangential_force - total.tangential_force) / np.linalg.norm(total.normal_force)
    print(f"  forces apart by {apart:.1%} of the pressure; energy residual {answer.summary['energy']['residual']:.0e}")


def steps(folder: Path) -> None:
    """Sheared to and fro at constant pressure in 1, 2, …, 16 steps a leg: how far apart forces are at the end."""
    histories = {"press": ([0.0, 1.0], [0.0, 1.0]), "shear": ([0.0, 1.0, 2.0, 3.0], [0.0, 0.0, 1.0, -0.6])}
    scene = circle_on_plane(folder, 16, 1, PRESS, histories, [1.0, 2.0, 3.0], shift=SHIFT)
    runs = {k: solve(scene, time__steps=k, method__tolerance=1e-13).contacts["seam"] for k in (1, 2, 4, 8, 16)}
    apart = {k: np.abs(each.forces - runs[1].forces).max() / np.abs(runs[1].forces).max() for k, each in runs.items()}
    print(f"Constant pressure, {runs[1].count('slip')} slip, {runs[1].count('stick')} stick: forces apart from those "
          f"of one step a leg by {', '.join(f'{k}: {value:.0e}' for k, value in apart.items() if k > 1)}")


def paths(folder: Path) -> None:
    """Random paths of the tangential load: iterations by step, and that none cycles."""
    histories = {"press": ([0.0, 1.0], [0.0, 1.0])}
    scene = circle_on_plane(folder, 8, 1, PRESS, histories | {"shear": ([0.0], [1.0])}, [1.0], shift=SHIFT)
    for number, split in ((100, 4), (100, 1), (20, 16)):
        rng, found, sizes, cold = np.random.default_rng(0), [], [], []
        for _ in range(number):
            turns = [0.0, 0.0, *rng.uniform(-1.2, 1.2, 6).tolist()]
            times = [float(k) for k in range(8)]
            answer = solve(scene, history__shear__times=times, history__shear__factors=turns, time__points=times[1:],
                           time__steps=split)
            iterations = [step["outer_iterations"] for step in answer.summary["steps"]]
            P = answer.contacts["seam"].normal_force.sum()
            Q = np.array([0.0, *(Q for _, Q, _ in shear_forces(answer))])
            cold.append(iterations[0])
            found += iterations[split:]
            sizes += (np.abs(np.diff(Q))[split:] / (FRICTION * P)).tolist()
        counts, changes = np.array(found).reshape(-1, split), np.array(sizes).reshape(-1, split)
        many = np.sort(changes[counts >= 5])
        print(f"{number} random paths of 6 turns, {split} steps a leg: {counts.size} sheared steps, "
              f"{counts.mean():.2f} steps of Newton's method on average (first of a leg {counts[:, 0].mean():.2f}, "
              f"others {counts[:, 1:].mean() if split > 1 else np.nan:.2f}), at most {counts.max()}; ΔQ/μP median "
              f"{np.median(changes):.2f}; {len(many)} took 5 or more" + (f", with ΔQ/μP {many[0]:.2f} to {many[-1]:.2f}"
              if len(many) else "") + f"; the first step {np.mean(cold):.1f}", flush=True)


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
    """What a later step costs beside the first run, at N = 86 of the pinched blocks; the least of three times each."""
    scene = Path(__file__).resolve().parents[1] / "configs" / "pinched_blocks.toml"
    text = scene.read_text(encoding="utf-8").replace("value = [2.0e7, 3.0e7]",
                                                     'value = [2.0e7, 3.0e7], history = "pull"')
    text = text.replace("divisions = [66, 22]", "divisions = [258, 86]") + """
[history.pull]
times = [0.0, 10.0]
factors = [1.0, 0.0]
[time]
points = [10.0]
steps = 1
"""
    spent: dict[str, list[float]] = {name: [] for name in ("run", "outer", "recover", "files", "all")}
    (folder / "scene.toml").write_text(text, encoding="utf-8")
    for _ in range(3):
        phases = {}
        for steps in (1, 41):
            begin = time.perf_counter()
            answer = solve(text, time__steps=steps)
            phases[steps] = answer.summary["seconds"]
            if steps == 1:
                spent["run"].append(time.perf_counter() - begin)
        for name in ("outer", "recover"):
            spent[name].append((phases[41][name] - phases[1][name]) / 40)
        for name, options in (("files", ["--no-figures"]), ("all", [])):
            begin = time.perf_counter()
            subprocess.run([sys.executable, "-m", "ddmpi", "run", str(folder / "scene.toml"), "--output",
                            tempfile.mkdtemp(dir=folder) + "/run", *options], check=True, capture_output=True)
            spent[name].append(time.perf_counter() - begin)
    least = {name: min(values) for name, values in spent.items()}
    later = least["outer"] + least["recover"]
    iterations = [step["outer_iterations"] for step in answer.summary["steps"]]
    print(f"N = 86, n = {answer.summary['n']}, one rank: a later step {1e3 * least['outer']:.0f} ms of Newton steps "
          f"({np.mean(iterations[1:]):.1f} of them) and {1e3 * least['recover']:.0f} ms of recovery: "
          f"{later / least['all']:.1%} of the whole first run ({least['all']:.1f} s, the command), "
          f"{later / least['files']:.1%} of it without pictures ({least['files']:.1f} s), "
          f"{later / least['run']:.1%} of it without files and the start of Python ({least['run']:.2f} s)")


class Watch(logging.Handler):
    """Notes CPU seconds and resident memory (MiB) after each load step, of which the run's log has a line."""

    def __init__(self) -> None:
        super().__init__(logging.INFO)
        self.seconds, self.memory = [time.process_time()], [0.0]

    def emit(self, record: logging.LogRecord) -> None:
        if record.getMessage().startswith("time "):
            self.seconds.append(time.process_time())
            pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[1])
            self.memory.append(pages * resource.getpagesize() / 2**20)


def long(folder: Path, number: int = 10_000) -> None:
    """Two small blocks rubbed to and fro, ten steps a leg: seconds and memory on the way."""
    del folder

    def block(name: str, y: float, clamp: list) -> dict:
        mesh = {"shape": "rectangle", "origin": [0.0, y], "size": [3.0, 1.0], "divisions": [12, 4]}
        return body(name, mesh, YOUNG, POISSON, clamp)

    legs = number // 10
    times = [float(k) for k in range(legs + 1)]
    rubbed = [{"on": "top", "y": -1e-3}, {"on": "top", "x": 3e-3, "history": "rub"}]
    scene = {"body": [block("upper", 1.0, rubbed), block("lower", 0.0, ["bottom"])],
             "contact": [contact("upper", "lower", "bottom", "top", name="seam", friction=coulomb(FRICTION))],
             "history": {"rub": history(times, [1.0 if k % 2 else -0.6 for k in range(legs + 1)])},
             } | timed(times[1:], steps=10)
    watch, log = Watch(), logging.getLogger("ddmpi")
    log.addHandler(watch)
    level = log.level
    log.setLevel(logging.INFO)
    try:
        answer = solve(scene)
    finally:
        log.removeHandler(watch)
        log.setLevel(level)
    each = np.diff(watch.seconds[::1000])
    at = ", ".join(f"{k}: {watch.memory[k]:.1f} MiB" for k in (1000, 5000, number))
    state = answer.contacts["seam"]
    print(f"{len(answer.summary['steps'])} steps of two small blocks, n = {answer.summary['n']}, at last "
          f"{state.count('slip')} slip, {state.count('stick')} stick: CPU seconds by thousand "
          f"{', '.join(f'{value:.1f}' for value in each)}; resident memory after {at}; "
          f"{np.mean([step['outer_iterations'] for step in answer.summary['steps']]):.1f} steps of Newton's method on "
          "average")


FLOOR = {"name": "floor", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}

SOFT = (7.0e4 / 3.0, 0.3)
"""Young's modulus and Poisson's ratio of the softer body, for Dundurs' β = 1/7."""


STUDIES = ("cattaneo", "edges", "dissimilar", "torsion", "steps", "raous", "paths", "fretting", "cost", "long")


if __name__ == "__main__":
    parser = arguments(__doc__)
    parser.add_argument("sections", nargs="*", metavar="SECTION", help=f"of {', '.join(STUDIES)}")
    with tempfile.TemporaryDirectory() as path:
        for name in parser.parse_args().sections or STUDIES:
            start = time.time()
            globals()[name](Path(path))
            print(f"  ({time.time() - start:.0f} s)\n", flush=True)
