#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Bodies that move far against closed forms, their cost, and a block slid by CalculiX, where that is installed.

Writes far.md to the folder --output and to docs/tables/. Seconds are processor time on one rank, without pictures.
"""

import json
import os
import re
import shutil
import subprocess
import sys
import time
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, arguments, processor, publish, table
from mpi4py import MPI
from problems import body, contact, coulomb
from scenes import to_toml

import ddmpi

FRICTION, YOUNG, POISSON = 0.3, 1000.0, 0.3
SPACING, PRESSED, WAY = 1.0 / 16, 0.004, 20.0
"""The block's spacing of nodes and how deep it is pressed (m), and its way in spacings."""

STIFF, TOUCHES = 1e5, 1e4
"""CalculiX's penalties, normal and tangential (N/m³)."""


def far(bodies: list[dict], contacts: list[dict], histories: Mapping[str, list], points: list[float], steps: int,
        **more) -> dict:
    """A scene of bodies that move far; histories by name as pairs of a time and a factor."""
    courses = {name: dict(zip(("times", "factors"), map(list, zip(*course, strict=True)), strict=True))
               for name, course in histories.items()}
    return more | {"body": bodies, "contact": contacts, "history": courses,
                   "time": {"motions": "far", "points": points, "steps": steps}}


def solved(scene: dict) -> Any:
    """The answer of a scene, in this process. RuntimeError where it is not certified."""
    answer = ddmpi.solve(to_toml(scene), MPI.COMM_SELF)
    if not answer.certified:
        raise RuntimeError(answer.reason)
    return answer


def summary_of(scene: dict) -> tuple[dict, float]:
    """The summary of a scene's run, and its processor time."""
    begun = time.process_time()
    return solved(scene).summary, time.process_time() - begun


def forces(summary: dict, after: float = 0.0) -> np.ndarray:
    """(k, 3) the time and the force on the first body of the only contact at the steps after a time."""
    return np.array([(step["time"], *each["force"]) for step in summary["steps"] if step["time"] > after + 1e-9
                     for each in step["contacts"].values()])


# A block slid along a longer one: T = μ N

def block(order: int, steps: int, way: float = WAY, fine: int = 1) -> dict:
    """A block of 1 m × 0.5 m, pressed on a longer one and slid by `way` of its spacings."""
    def box(name: str, origin: list[float], size: list[float], divisions: list[int], clamp: str) -> dict:
        mesh = {"shape": "rectangle", "origin": origin, "size": size, "order": order,
                "divisions": [fine * n // order for n in divisions]}
        return body(name, mesh, YOUNG, POISSON, [clamp])
    slider = box("slider", [0.0, 0.0], [1.0, 0.5], [16, 8], "top") | {"motion": [
        {"shift": [0.0, -PRESSED], "history": "press"}, {"shift": [way * SPACING, 0.0], "history": "slide"}]}
    base = box("base", [-1.0, -1.0], [5.0, 1.0], [67, 12], "bottom")
    return far([slider, base], [contact("slider", "base", "bottom", "top", friction=coulomb(FRICTION))],
               {"press": [(0.0, 0.0), (1.0, 1.0)], "slide": [(1.0, 0.0), (2.0, 1.0)]}, [1.0, 2.0], steps)


def ripple(found: np.ndarray) -> float:
    """Peak to peak of N about a quartic trend of its steady part, over its mean."""
    t, _, N = found[found[:, 0] > 1.2].T
    return float(np.ptp(N - np.polyval(np.polyfit(t, N, 4), t)) / N.mean())


def sliding(steps: int = 80) -> Iterator[list[str]]:
    """Rows of both orders: |T/N − μ|, ends against the number of steps, ripple, Newton steps, times."""
    for order, fine in ((1, 1), (1, 2), (2, 1), (2, 2)):
        summary, seconds = summary_of(block(order, steps, fine=fine))
        found = forces(summary, 1.2)
        apart = np.abs(np.abs(found[:, 1] / found[:, 2]) - FRICTION).max()
        ends = [forces(summary_of(block(order, few, fine=fine))[0])[-1, 1:] for few in (1, 4, 16)]
        differ = max(np.abs(end - found[-1, 1:]).max() for end in ends) / found[-1, 2]
        _, half = summary_of(block(order, steps // 2, fine=fine))
        yield [f"{order}", f"{16 * fine}", f"{found[:, 2].mean():.4f}", f"{apart:.0e}", f"{differ:.0e}",
               f"{ripple(forces(summary, 1.0)):.1e}", f"{summary['outer_iterations'] / len(summary['steps']):.1f}",
               f"{1e3 * (seconds - half) / steps:.0f}"]


# Both bodies turned together: nothing changes

def turned(order: int, steps: int = 9, fine: int = 1) -> dict:
    """A ring, pressed on a block and rubbed, and then both of them turned by 90° about another point and shifted."""
    together = {"turn": 90.0, "pivot": [4.0, -3.0], "shift": [7.0, -2.0], "history": "turn"}
    ring = body("ring", {"shape": "annulus", "center": [0.0, 0.0], "radii": [0.5, 1.0], "angles": [0, 360],
                         "divisions": [240 * fine // order, 12 * fine // order], "order": order}, YOUNG, POISSON,
                ["inner"])
    base = body("base", {"shape": "rectangle", "origin": [-2.0, -2.0], "size": [4.0, 1.0], "order": order,
                         "divisions": [161 * fine // order, 24 * fine // order]}, YOUNG, POISSON, ["bottom"])
    ring["motion"] = [{"shift": [0.0, -0.02], "history": "press"}, {"shift": [0.02, 0.0], "history": "rub"}, together]
    base["motion"] = together
    return far([ring, base], [contact("ring", "base", "outer", "top", friction=coulomb(FRICTION))],
               {"press": [(0.0, 0.0), (1.0, 1.0)], "rub": [(1.0, 0.0), (2.0, 1.0)], "turn": [(2.0, 0.0), (3.0, 1.0)]},
               [1.0, 2.0, 3.0], steps)


def turn_errors(summary: dict) -> tuple[float, float]:
    """By how much the force changes in the quarter turn, over its size; the dissipation, over that of rubbing."""
    found = forces(summary)
    before, end = found[np.isclose(found[:, 0], 2.0)][0, 1:], found[-1, 1:]
    back = np.array([end[1], -end[0]])  # turned back by 90°
    lost = np.array([(step["time"], each["dissipated"]) for step in summary["steps"]
                     for each in step["contacts"].values()])
    turning = lost[:, 0] > 2.0 + 1e-9
    return (float(np.abs(back - before).max() / np.linalg.norm(before)),
            float(lost[turning, 1].sum() / lost[~turning, 1].sum()))


# A pin pushed into a hub

def pin_theory(depth: float, lead: float = 3.0) -> tuple[float, float, float]:
    """Force on the pin of configs/drawn/pushed_pin.toml at a depth by strip theory, by μ p A, and Lamé's pressure.

    In a strip the fit is that of the drawing, widened by the pin's axial compression and narrowed by the hub's.
    """
    E, nu, mu, a, outer, fit = 2.1e5, 0.3, 0.15, 10.0, 20.0, 0.01
    stiff = E / a * (outer**2 - a**2) / (2.0 * outer**2)  # Lamé: pressure over fit of a full pin in a hub
    pressed = depth - lead / 2.0  # the lead is as wide as the bore in its middle
    z = np.linspace(0.0, pressed, 800)
    force, total = np.zeros(len(z)), 0.0
    for _ in range(60):
        here = fit * np.minimum(1.0, z / (lead / 2.0)) + nu * a / E * (
            force / (np.pi * a**2) - (total - force) / (np.pi * (outer**2 - a**2)))
        force = np.concatenate([[0.0], np.cumsum(2.0 * np.pi * a * mu * stiff * (here[1:] + here[:-1]) / 2.0
                                                 * np.diff(z))])
        total = float(force[-1])
    return total, 2.0 * np.pi * a * mu * stiff * fit * depth, stiff * fit


def pin(steps: int = 40) -> tuple[list[list[str]], tuple[float, float, float], float]:
    """Rows: depth, force, theories, growths; least and largest pressure in the middle, and Lamé's (MPa); by how much
    the axial force differs from μ N at most, over μ N."""
    scene = tomllib.loads((ROOT / "configs" / "drawn" / "pushed_pin.toml").read_text(encoding="utf-8"))
    scene["body"][0]["mesh"]["geometry"] = str(ROOT / "configs" / "drawn" / "tapered_pin.geo")
    scene["time"] |= {"points": [1.0], "steps": steps}
    scene["output"] |= {"animation": False}
    answer = solved(scene)
    rows, before = [], np.full(3, np.nan)
    for at, _, axial in forces(answer.summary):
        if 20.0 * at in (8.0, 12.0, 16.0, 20.0):
            strips, simple, lame = pin_theory(20.0 * at)
            now = np.array([20.0 * at, axial, strips])
            growth = (now - before)[1:] / (now - before)[0]
            rows.append([f"{20.0 * at:g}", f"{axial:.0f}", f"{strips:.0f}", f"{simple:.0f}",
                         *("–" if np.isnan(rate) else f"{rate:.0f}" for rate in growth)])
            before = now
    state = answer.contacts["fit"]
    p = state.pressure[(state.interface.xy[:, 1] > 6.0) & (state.interface.xy[:, 1] < 16.0)]
    apart = max(abs(abs(step["contacts"]["fit"]["force"][1]) / step["contacts"]["fit"]["normal_force"] / 0.15 - 1.0)
                for step in answer.summary["steps"] if step["contacts"]["fit"]["normal_force"] > 0.0)
    return rows, (float(p.min()), float(p.max()), lame), apart


# Spur gears

PITCH, BASE, CENTRES = 18.0, 30.0 * np.cos(np.radians(20.0)), 60.0
"""The pitch of configs/drawn/spur_gears.toml (degrees), its base radius, and the distance of its shafts (mm)."""


def gear_theory() -> tuple[float, float]:
    """Largest stiffness of a pair of teeth by ISO 6336-1 (N/(mm µm)), without its factor for measured gears, and the
    loss of power over μ by the formula of ISO/TR 14179 (u = 1, ε₁ = ε₂)."""
    z, ra = 20, 33.0
    stiff = 0.975 / (0.04723 + 0.15551 / z + 0.25791 / z)  # basic rack with a dedendum of 1.25 modules
    part = z / (2.0 * np.pi) * (np.sqrt((ra / BASE) ** 2 - 1.0) - np.tan(np.radians(20.0)))  # ε₁
    return stiff, 2.0 * np.pi / z * (1.0 - 2.0 * part + 2.0 * part**2)


def meshing(summary: dict) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """At each step the angle of the driving gear (degrees), the stiffness (N/(mm µm)), and the loss of power: that of
    the driven shaft's moment, as both turn alike. The stiffness is by the mean of both moments."""
    load = 0.234464 - np.degrees(2.0 * 0.05 / 30.0)  # turned back beyond backlash
    t, force, moment = (np.array(each) for each in zip(*(
        (step["time"], step["contacts"]["mesh"]["force"][1], step["contacts"]["mesh"]["moment"])
        for step in summary["steps"]), strict=True))
    driven = CENTRES * force - moment
    return (PITCH * (t / 40.0 - 0.5), (moment + driven) / -2.0 / BASE / (np.radians(load) * BASE * 1e3),
            1.0 - driven / moment)


def alone(angle: np.ndarray) -> np.ndarray:
    """Where the tooth in the middle of the driving gear bears alone, away from where teeth come and go."""
    return (angle > -8.0) & (angle < -1.2)


def gears(friction: float = 0.1, steps: int = 40) -> dict:
    """configs/drawn/spur_gears.toml."""
    scene = tomllib.loads((ROOT / "configs" / "drawn" / "spur_gears.toml").read_text(encoding="utf-8"))
    for each in scene["body"]:
        each["mesh"]["geometry"] = str(ROOT / "configs" / "drawn" / each["mesh"]["geometry"])
    scene["contact"][0]["friction"]["coefficient"] = friction
    scene["time"]["steps"] = steps
    scene["output"] |= {"animation": False}
    return scene


def gear_rows() -> list[list[str]]:
    """Stiffness, loss, cost of the gears with and against their formulas."""
    summary, seconds = summary_of(gears())
    _, half = summary_of(gears(steps=20))
    angle, stiff, loss = meshing(summary)
    exact, factor = gear_theory()
    single = stiff[alone(angle)]
    return [["stiffness of a pair of teeth, largest (N/(mm µm))", f"{single.max():.2f}", f"{exact:.2f}",
             f"{single.max() / exact - 1.0:+.1%}"],
            ["loss of power, mean of a pitch", f"{loss.mean():.4f}", f"{0.1 * factor:.4f}",
             f"{loss.mean() / (0.1 * factor) - 1.0:+.1%}"],
            ["Newton steps a load step", f"{summary['outer_iterations'] / len(summary['steps']):.1f}", "", ""],
            ["ms a load step", f"{1e3 * (seconds - half) / 20:.0f}", "", ""]]


# CalculiX

def deck(path: Path, steps: int) -> None:
    """The block as a deck of CalculiX: bricks of one layer without displacement across, finite sliding, penalties."""
    lines, ids, number = ["*NODE, NSET=ALL"], [], 0
    boxes = (((0.0, 0.0), (1.0, 0.5), (16, 8)), ((-1.0, -1.0), (5.0, 1.0), (67, 12)))
    for (x, y), (width, height), (nx, ny) in boxes:
        ids.append({})
        for i, j, k in ((i, j, k) for k in (0, 1) for j in range(ny + 1) for i in range(nx + 1)):
            number += 1
            ids[-1][i, j, k] = number
            lines.append(f"{number}, {x + width * i / nx:.12g}, {y + height * j / ny:.12g}, {k}")
    lines.append("*ELEMENT, TYPE=C3D8, ELSET=ALL")
    count, faces = 0, ([], [])
    for which, (_, _, (nx, ny)) in enumerate(boxes):
        for i, j in ((i, j) for j in range(ny) for i in range(nx)):
            count += 1
            lines.append(", ".join(map(str, [count, *(ids[which][i + a, j + b, k] for k in (0, 1)
                                                     for a, b in ((0, 0), (1, 0), (1, 1), (0, 1)))])))
            if j == (0, ny - 1)[which]:
                faces[which].append(f"{count}, {('S3', 'S5')[which]}")
    lines += ["*SURFACE, NAME=FIRST", *faces[0], "*SURFACE, NAME=SECOND", *faces[1], "*NSET, NSET=HELD",
              *(str(n) for (_, j, _), n in ids[0].items() if j == 8), "*NSET, NSET=FOOT",
              *(str(n) for (_, j, _), n in ids[1].items() if j == 0),
              "*MATERIAL, NAME=STUFF", "*ELASTIC", f"{YOUNG}, {POISSON}", "*SOLID SECTION, ELSET=ALL, MATERIAL=STUFF",
              "*SURFACE INTERACTION, NAME=TOUCH", "*SURFACE BEHAVIOR, PRESSURE-OVERCLOSURE=LINEAR", f"{STIFF:g}",
              "*FRICTION", f"{FRICTION}, {TOUCHES:g}",
              "*CONTACT PAIR, INTERACTION=TOUCH, TYPE=SURFACE TO SURFACE", "FIRST, SECOND", "*BOUNDARY", "ALL, 3, 3",
              "FOOT, 1, 2"]
    for increment, x in ((1.0, 0.0), (1.0 / steps, WAY * SPACING)):
        lines += ["*STEP, NLGEOM, INC=10000", "*STATIC", f"{increment}, 1., 1e-6, {increment}", "*BOUNDARY",
                  f"HELD, 1, 1, {x}", f"HELD, 2, 2, {-PRESSED}", "*NODE PRINT, NSET=HELD, TOTALS=ONLY", "RF",
                  "*END STEP"]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")


def calculix(folder: Path, steps: int = 80) -> list[str] | None:
    """A row of the block by CalculiX, in as many increments; None where it is not installed."""
    if not shutil.which("ccx"):
        return None
    deck(folder / "block.inp", steps)
    before = os.times()
    subprocess.run(["ccx", "block"], cwd=folder, check=True, capture_output=True,
                   env=dict(os.environ) | {"OMP_NUM_THREADS": "1"})
    after = os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    found = np.array(re.findall(r"total force.*time +(\S+)\n\n +(\S+) +(\S+)", (folder / "block.dat").read_text()),
                     float)
    iterations = [int(line.split()[3]) for line in (folder / "block.sta").read_text().splitlines()[1:]
                  if line.split()[:1] and line.split()[0].isdigit()]
    late = found[found[:, 0] > 1.2]
    return ["CalculiX, bricks, face to face", f"{-late[:, 2].mean():.4f}",
            f"{np.abs(np.abs(late[:, 1] / late[:, 2]) - FRICTION).max():.0e}", f"{ripple(found * [1, 1, -1]):.1e}",
            f"{np.mean(iterations):.1f}", f"{spent:.1f}"]


def ours(folder: Path, order: int, steps: int = 80) -> list[str]:
    """The same by ddmpi, as a command of its own without pictures."""
    path, out = folder / f"block_{order}.toml", folder / f"block_{order}"
    path.write_text(to_toml(block(order, steps)), encoding="utf-8")
    shutil.rmtree(out, ignore_errors=True)
    before = os.times()
    subprocess.run([sys.executable, "-m", "ddmpi", "run", str(path), "--output", str(out), "--no-figures"], cwd=ROOT,
                   check=True, capture_output=True)
    after = os.times()
    spent = after.children_user + after.children_system - before.children_user - before.children_system
    summary = json.loads((out / "summary.json").read_text(encoding="utf-8"))
    late = forces(summary, 1.2)
    return [f"ddmpi, order {order}", f"{late[:, 2].mean():.4f}",
            f"{np.abs(np.abs(late[:, 1] / late[:, 2]) - FRICTION).max():.0e}", f"{ripple(forces(summary, 1.0)):.1e}",
            f"{summary['outer_iterations'] / len(summary['steps']):.1f}", f"{spent:.1f}"]


def main() -> None:
    options = arguments(__doc__, "far").parse_args()
    from far_free import sections  # which has the scenes of this module

    options.output.mkdir(parents=True, exist_ok=True)
    rows, (least, most, lame), apart = pin()
    pressure = (f"Pressure between 6 and 16 mm of 20 mm: {least:.1f} to {most:.1f} MPa, Lamé {lame:.2f} MPa. The axial "
                f"force differs from μ N by {apart:.1%} at most, as the lead is inclined by 0.4°.")
    turns = [(order, *turn_errors(summary_of(turned(order))[0])) for order in (1, 2)]
    peers = [row for row in (ours(options.output, 1), ours(options.output, 2), calculix(options.output)) if row]
    lines = [
        "# Bodies that move far", "", f"Generated by `scripts/study far` with version {ddmpi.__version__} on one rank, "
        f"{re.sub(' +', ' ', processor())}. Seconds are processor time. [far.md](../use/far.md) explains such scenes.",
        "", "## A block slid along a longer one", "", f"A block of 1 m × 0.5 m is pressed {PRESSED} m into a longer "
        f"one of the same material and slid by {WAY * SPACING:g} m in 80 steps; μ = {FRICTION}. Ends: the largest "
        "difference of a force at the end between 80 and 1, 4 or 16 steps, over N. Ripple: of N about a quartic trend, "
        "peak to peak over the mean. Each load step pairs the surfaces once.", "",
        *table(("order", "spacings of the block", "N (N/m)", "T/N − μ", "ends", "ripple", "Newton steps a load step",
                "ms a load step"), sliding()),
        "## The same block by CalculiX", "", "Both on 16 spacings and in 80 steps, from the start of the command to "
        f"its end; CalculiX with bricks of one layer, penalties of {STIFF:g} and {TOUCHES:g} N/m³, and NLGEOM. For "
        "ddmpi all result files but pictures.", "",
        *table(("", "N (N/m)", "T/N − μ", "ripple", "iterations a step", "seconds"), peers),
        "## Both bodies turned by 90°", "", "A ring is pressed on a block and rubbed; then both are turned about a "
        "point beside them and shifted, in 9 steps. Forces turn with the bodies, and friction dissipates nothing.", "",
        *table(("order", "change of the force", "dissipation of the turn over that of rubbing"),
               [[str(order), f"{change:.0e}", f"{lost:.0e}"] for order, change, lost in turns]),
        "## A pin pushed into a hub", "", "`configs/drawn/pushed_pin.toml`. Strip theory: Lamé's pressure of each "
        "strip, with the fit that axial compression of pin and hub leaves; the peaks of pressure at the mouth and "
        "behind the lead, which it lacks, add a constant. μ p A takes one pressure all over the depth.", "",
        *table(("depth (mm)", "force (N)", "strip theory (N)", "μ p A (N)", "growth since the line above (N/mm)",
                "by strip theory"), rows), pressure, "",
        "## Spur gears", "", "`configs/drawn/spur_gears.toml`: 20 : 20 teeth, module 3 mm, μ = 0.1, turned by one "
        "pitch in 40 steps with a deflection of 21.4 µm along the line of action. The stiffness is the moment over "
        "base radius and deflection where one tooth in the middle bears alone; the loss is by the moments of both "
        "shafts, averaged over the pitch.", "",
        *table(("", "found", "formula", "difference"), gear_rows()),
        "The stiffness is by ISO 6336-1 without its factor 0.8 for measured gears, the loss by ISO/TR 14179.", "",
        *sections(options.output)]
    publish("far.md", "\n".join(lines), options.output, True)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
