#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Bodies that move far against closed forms, and their cost.

Writes far.md to the folder --output and to docs/tables/. Seconds are processor time on one rank, without pictures. The
scenes stand in problems/moving.py.
"""

import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from experiment import arguments, cells, processor, publish, refilled, table
from problems import moving
from problems.bodies import answer_of, contact, coulomb
from problems.moving import FRICTION, GO, PRESS, SOFT, far, forces, shipped, sliding

import ddmpi


def summary_of(scene: dict) -> tuple[dict, float]:
    """The summary of a scene's run in this process, and its processor time."""
    begun = time.process_time()
    return answer_of(scene).summary, time.process_time() - begun


def ripple(found: np.ndarray) -> float:
    """Peak to peak of N about a quartic trend of its steady part, over its mean."""
    t, _, N = found[found[:, 0] > 1.2].T
    return float(np.ptp(N - np.polyval(np.polyfit(t, N, 4), t)) / N.mean())


def steady(found: np.ndarray) -> tuple[float, float]:
    """The mean of N while a block slides, and how much T/N differs from μ at most."""
    _, T, N = found[found[:, 0] > 1.2].T
    return float(N.mean()), float(np.abs(np.abs(T / N) - FRICTION).max())


def newton_steps(summary: dict) -> float:
    """A load step."""
    return summary["outer_iterations"] / len(summary["steps"])


def cost(summary: dict) -> float:
    """Seconds of a load step over those of factors and compliances, of the whole run."""
    spent = summary["seconds"]
    return (spent["outer"] + spent["assemble"] + spent["recover"]) / len(summary["steps"]) / spent["factor"]


def slid(steps: int = 80) -> Iterator[list[str]]:
    """Rows of the block of both orders."""
    for order, fine in ((1, 1), (1, 2), (2, 1), (2, 2)):
        summary, seconds = summary_of(sliding(order, steps, fine))
        found = forces(summary, 1.0)
        ends = [forces(summary_of(sliding(order, few, fine))[0])[-1, 1:] for few in (1, 4, 16)]
        differ = max(np.abs(end - found[-1, 1:]).max() for end in ends) / found[-1, 2]
        _, half = summary_of(sliding(order, steps // 2, fine))
        yield cells("{} | {} | {:.4f} | {:.0e} | {:.0e} | {:.1e} | {:.1f} | {:.0f}", order, 16 * fine, *steady(found),
                    differ, ripple(found), newton_steps(summary), 1e3 * (seconds - half) / steps)


# A pin pushed into a hub

def pin_theory(depth: float, lead: float = 3.0) -> tuple[float, float, float]:
    """Force on the pin of configs/drawn/pushed_pin.toml at a depth by strip theory, by μ p A, and Lamé's pressure.

    In a strip the fit is that of the drawing, widened by the pin's axial compression and narrowed by the hub's.
    """
    E, nu, mu, a, outer, fit = 2.1e5, 0.3, 0.15, 10.0, 20.0, 0.01
    stiff = E / a * (outer**2 - a**2) / (2.0 * outer**2)  # Lamé: pressure over fit of a full pin in a hub
    z = np.linspace(0.0, depth - lead / 2.0, 800)  # the lead is as wide as the bore in its middle
    force, total = np.zeros(len(z)), 0.0
    for _ in range(60):
        here = fit * np.minimum(1.0, z / (lead / 2.0)) + nu * a / E * (
            force / (np.pi * a**2) - (total - force) / (np.pi * (outer**2 - a**2)))
        force = np.concatenate([[0.0], np.cumsum(2.0 * np.pi * a * mu * stiff * (here[1:] + here[:-1]) / 2.0
                                                 * np.diff(z))])
        total = float(force[-1])
    return total, 2.0 * np.pi * a * mu * stiff * fit * depth, stiff * fit


def pin(steps: int = 40) -> tuple[np.ndarray, tuple[float, float, float], float]:
    """Depths, forces, and both theories; least and largest pressure in the middle, and Lamé's (MPa); by how much the
    axial force differs from μ N at most, over μ N."""
    scene = shipped("pushed_pin")
    scene["time"] |= {"points": [1.0], "steps": steps}
    answer = answer_of(scene)
    rows = np.array([(20.0 * at, axial, *pin_theory(20.0 * at)[:2]) for at, _, axial in forces(answer.summary)
                     if 20.0 * at in (8.0, 12.0, 16.0, 20.0)])
    state = answer.contacts["fit"]
    p = state.pressure[(state.interface.xy[:, 1] > 6.0) & (state.interface.xy[:, 1] < 16.0)]
    fits = [step["contacts"]["fit"] for step in answer.summary["steps"]]
    apart = max(abs(abs(fit["force"][1]) / fit["normal_force"] / 0.15 - 1.0) for fit in fits if fit["normal_force"])
    return rows, (float(p.min()), float(p.max()), pin_theory(20.0)[2]), apart


def gear_rows() -> list[list[str]]:
    """Stiffness, loss, cost of the gears with and against their formulas."""
    summary, seconds = summary_of(moving.gears())
    _, half = summary_of(moving.gears(steps=20))
    angle, stiff, loss = moving.meshing(summary)
    (exact, factor), largest = moving.gear_theory(), stiff[moving.alone(angle)].max()
    return [cells("stiffness of a pair of teeth, largest (N/(mm µm)) | {:.2f} | {:.2f} | {:+.1%}", largest, exact,
                  largest / exact - 1.0),
            cells("loss of power, mean of a pitch | {:.4f} | {:.4f} | {:+.1%}", loss.mean(), 0.1 * factor,
                  loss.mean() / (0.1 * factor) - 1.0),
            [*cells("Newton steps a load step | {:.1f}", newton_steps(summary)), "", ""],
            [*cells("ms a load step | {:.0f}", 1e3 * (seconds - half) / 20), "", ""]]


# Free bodies in space

def bevel() -> float:
    """How far the driven one of configs/drawn/bevel_wheels.toml turns (degrees)."""
    freed = answer_of(shipped("bevel_wheels")).solved.assembly.far.freed
    return float(freed[1.0]["driven"][3] - freed[2.0]["driven"][3])


def ball(n: int = 32, widths: float = 10.0) -> tuple[float, float, float, float]:
    """A rigid ball of 1 m, pressed onto a plate by a force, that rolls by so many contact radii against a tenth of μ N:
    its way over its turn, errors of both forces over N, and passes a step."""
    a, (young, poisson) = 0.06, SOFT
    load = 4.0 * young / (1.0 - poisson**2) * a**3 / 3.0  # Hertz: a³ = 3 N R / 4 E*
    turn, pull = widths * a, 0.1 * FRICTION * load
    plate = {"name": "plate", "material": {"young": young, "poisson": poisson}, "clamp": ["bottom"], "mesh": {
        "shape": "box", "origin": [-0.2, -0.2, -0.3], "size": [1.0, 0.4, 0.3], "divisions": [n, 2 * n // 5, n // 4]}}
    rolls = {"turn": float(np.degrees(turn)), "axis": [0.0, 1.0, 0.0], "pivot": [0.0, 0.0, 1.0], "history": "roll"}
    answer = answer_of(far([plate], [contact("plate", "ball", "top", friction=coulomb(FRICTION))], 10, rigid=[
        {"name": "ball", "shape": "sphere", "center": [0.0, 0.0, 1.0], "radius": 1.0, "motion": [
            rolls, {"free": ["x", "y", "z"], "force": [-pull, 0.0, -load], "history": "load"}]}], load=PRESS, roll=GO))
    freed, steps = answer.solved.assembly.far.freed, answer.summary["steps"]
    way = freed[steps[-1]["time"]]["ball"][0] - freed[1.0]["ball"][0]
    _, x, _, z = forces(answer.summary, 1.0).T
    return (float(way / turn), float(np.abs(z / load + 1.0).max()), float(np.abs(x + pull).max() / load),
            float(np.mean([step["passes"] for step in steps if step["time"] > 1.0])))


# The page

def page(folder: Path) -> str:
    """All of far.md."""
    pushed, (least, most, lame), apart = pin()
    rates = np.diff(pushed, axis=0)[:, 1:3] / np.diff(pushed, axis=0)[:, :1]
    grown = [["–", "–"], *(cells("{:.0f} | {:.0f}", *each) for each in rates)]
    still, *pulled = (moving.creep(share, folder) for share in (0.0, 0.5, 0.75))
    sections = {
        "A block slid along a longer one": (
            "order | spacings of the block | N (N/m) | T/N − μ | ends | ripple | Newton steps a load step | "
            "ms a load step", slid()),
        "Both bodies turned by 90°": (
            "order | change of the force | dissipation of the turn over that of rubbing",
            [cells("{} | {:.0e} | {:.0e}", order, *moving.turn_errors(summary_of(moving.turned(order))[0]))
             for order in (1, 2)]),
        "A pin pushed into a hub": (
            "depth (mm) | force (N) | strip theory (N) | μ p A (N) | growth since the line above (N/mm) | "
            "by strip theory", [cells("{:g} | {:.0f} | {:.0f} | {:.0f}", *row) + since
                                for row, since in zip(pushed, grown, strict=True)]),
        "Spur gears": (" | found | formula | difference", gear_rows()),
        "A loose disc in a bore that turns": (
            "order | turn of the disc (degrees) | N/W − 1 | T/W | passes a step",
            [cells("{} | {:.1f} | {:.0e} | {:.0e} | {:.1f}", order, *moving.rolled(answer_of(moving.rolling(order))))
             for order in (1, 2)]),
        "Carter's roller": (
            "Q/μP | creep over Carter's | p over p₀",
            [cells("{} | {:.3f} | {:.4f}", share, (way - still[0]) / exact, pressure)
             for share, (way, pressure, exact, _) in zip((0.5, 0.75), pulled, strict=True)]),
        "In space": (
            r"order | cells of an edge | moment over Σ μ N r | \|T\|/N − μ, slid | a load step over factors",
            [cells("{} | {} | {:.4f} | {:.0e} | {:.2f}", order, n, moment, off, cost(summary))
             for order, n in ((1, 8), (1, 16), (2, 8)) for moment, off, summary, _ in [moving.torque(order, n)]]),
        "A load step beside a factorization, in the plane": (
            "order | spacings of the block | a load step over factors",
            [cells("{} | {} | {:.2f}", order, 16 * fine, cost(summary_of(sliding(order, 40, fine))[0]))
             for order in (1, 2) for fine in (1, 4)])}
    return refilled("far.md", {title: table(header.split(" | "), rows) for title, (header, rows) in sections.items()},
                    True, {
        r"version [\d.]+ on one rank, .+?(?=\. Seconds)": f"version {ddmpi.__version__} on one rank, {processor()}",
        r"[\d.]+ to [\d.]+ MPa, Lamé [\d.]+": f"{least:.1f} to {most:.1f} MPa, Lamé {lame:.2f}",
        r"μ N by [\d.]+%": f"μ N by {apart:.1%}", r"along by [\d.]+°": f"along by {bevel():.2f}°",
        "Its way is .* passes": "Its way is {:.4f} of its turn; N is right to {:.0e} of it, T to {:.0e}; {:.1f} passes"
                                .format(*ball())})


def main() -> None:
    options = arguments(__doc__, "far").parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    publish("far.md", page(options.output), options.output, True)


if __name__ == "__main__":
    main()
