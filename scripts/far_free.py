"""Bodies that move far: frames that forces decide, and solids; the second part of `scripts/study far`."""

import tomllib
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, table
from far import FRICTION, POISSON, PRESSED, YOUNG, block, far, forces, solved, summary_of
from problems import contact, coulomb

SOFT = {"young": YOUNG, "poisson": POISSON}
ROLLER = """R = 1.0; r = 0.4; w = 40 * Pi / 180;
Point(1) = {0, 1, 0};
Point(2) = {-r*Sin(w), 1 - r*Cos(w), 0}; Point(3) = {r*Sin(w), 1 - r*Cos(w), 0};
Point(4) = {R*Sin(w), 1 - R*Cos(w), 0}; Point(5) = {-R*Sin(w), 1 - R*Cos(w), 0};
Point(6) = {0, 0, 0}; Point(7) = {0, 1 - r, 0};
Circle(1) = {2, 1, 7}; Circle(6) = {7, 1, 3}; Line(2) = {3, 4}; Circle(3) = {4, 1, 6}; Circle(4) = {6, 1, 5};
Line(5) = {5, 2}; Curve Loop(1) = {1, 6, 2, 3, 4, 5}; Plane Surface(1) = {1};
Physical Curve("inner") = {1, 6}; Physical Curve("outer") = {3, 4}; Physical Surface("roller") = {1};
"""
PLATE = """Point(1) = {-0.4, -1, 0}; Point(2) = {0.8, -1, 0}; Point(3) = {0.8, 0, 0}; Point(4) = {-0.4, 0, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 4}; Line(4) = {4, 1};
Curve Loop(1) = {1, 2, 3, 4}; Plane Surface(1) = {1};
Physical Curve("bottom") = {1}; Physical Curve("top") = {3}; Physical Surface("plate") = {1};
"""
"""A sector of a roller of 1 m, and a plate, for elements that are small along the contact alone."""


def rolling(order: int, turn: float = 120.0, steps: int = 60, fine: int = 2) -> dict:
    """A loose disc of 1 m that lies in a bore of 1.5 m by its weight; the bore turns (degrees)."""
    def ring(name: str, radii: list[float], divisions: list[int], **more) -> dict:
        mesh = {"shape": "annulus", "center": [0.0, (name == "disc") * -0.49], "radii": radii, "angles": [0, 360],
                "divisions": [fine * n // order for n in divisions], "order": order}
        return {"name": name, "mesh": mesh, "material": SOFT} | more
    disc = ring("disc", [0.25, 1.0], [80, 7], volume_force={"value": [0.0, -2.7], "history": "weight"})
    bore = ring("bore", [1.5, 2.2], [116, 5], clamp=["outer"], motion={"turn": turn, "history": "turn"})
    return far([disc, bore], [contact("disc", "bore", "outer", "inner", friction=coulomb(FRICTION), slave="disc")],
               {"weight": [(0.0, 0.0), (1.0, 1.0)], "turn": [(1.0, 0.0), (2.0, 1.0)]}, [1.0, 2.0], steps)


def rolled(answer: Any) -> tuple[float, float, float, float]:
    """Of the disc: how far it has turned (degrees), N/W − 1 and T/W where they are largest, and passes a step."""
    found, steps = forces(answer.summary), answer.summary["steps"]
    weight = -answer.summary["bodies"]["disc"]["loads"]["volume_force"]["force"][1]
    freed = answer.solved.assembly.far.freed
    turned = freed[steps[-1]["time"]]["disc"][-1] - next(freed[step["time"]]["disc"][-1] for step in steps
                                                         if step["time"] >= 1.0)
    late = found[found[:, 0] > 1.0 - 1e-9]
    return (float(turned), float(np.abs(late[:, 2] / weight - 1.0).max()), float(np.abs(late[:, 1] / weight).max()),
            float(np.mean([step["passes"] for step in steps if step["time"] > 1.0])))


def carter(share: float, folder: Path, nodes: int = 8, rolls: float = 6.0) -> tuple[float, float, float, Any]:
    """A roller that is turned against a force Q of so much of μP: the creep over its last half-width, the largest
    pressure over Hertz's p₀, Carter's creep, and the answer; with so many nodes on the half-width a = 0.035 m."""
    a, stiff = 0.035, YOUNG / (2.0 * (1.0 - POISSON**2))
    load, turn = np.pi * stiff * a**2 / 4.0, np.degrees(rolls * a)
    def part(name: str, drawing: str, clamp: str) -> dict:
        (folder / f"{name}.geo").write_text(drawing, encoding="utf-8")
        mesh = {"geometry": str(folder / f"{name}.geo"), "size": 0.2, "contact_size": 2.0 * a / nodes, "order": 2}
        return {"name": name, "mesh": mesh, "material": SOFT, "clamp": [clamp]}
    roller = part("roller", ROLLER, "inner") | {"motion": [
        {"turn": -turn, "pivot": [0.0, 1.0], "history": "roll"},
        {"free": ["x", "y"], "force": [-share * FRICTION * load, -load], "history": "load"}]}
    answer = solved(far([roller, part("plate", PLATE, "bottom")], [
        contact("roller", "plate", "outer", "top", friction=coulomb(FRICTION), slave="roller")],
        {"load": [(0.0, 0.0), (1.0, 1.0)], "roll": [(1.0, 0.0), (2.0, 1.0)]}, [1.0, 2.0], round(rolls * nodes)))
    freed, steps = answer.solved.assembly.far.freed, answer.summary["steps"]
    before, end = (freed[steps[k]["time"]]["roller"][0] for k in (-1 - nodes, -1))
    pressure = answer.contacts["roller-plate"].pressure.max() / (2.0 * load / (np.pi * a))
    return 1.0 - (end - before) / a, float(pressure), FRICTION * a * (1.0 - (1.0 - share) ** 0.5), answer


# In space: a block that slides and turns, a ball that rolls

def solid(way: dict, order: int, n: int, steps: int = 6) -> dict:
    """A block of 1 m × 1 m × 0.4 m that is pressed onto a plate and then goes its way."""
    def box(name: str, origin: list[float], size: list[float], divisions: list[int], **more) -> dict:
        return {"name": name, "material": SOFT, "mesh": {"shape": "box", "origin": origin, "size": size,
                                                          "divisions": divisions, "order": order}} | more
    block = box("block", [0.0, 0.0, 0.0], [1.0, 1.0, 0.4], [n, n, n // 2], clamp=["top"], motion=[
        {"shift": [0.0, 0.0, -PRESSED], "history": "press"}, way | {"history": "go"}])
    plate = box("plate", [-1.0, -1.0, -0.4], [3.0, 3.0, 0.4], [2 * n + 1, 2 * n + 1, n // 2], clamp=["bottom"])
    return far([block, plate], [contact("block", "plate", "bottom", "top", friction=coulomb(FRICTION))],
               {"press": [(0.0, 0.0), (1.0, 1.0)], "go": [(1.0, 0.0), (2.0, 1.0)]}, [1.0, 2.0], steps)


def torque(order: int, n: int) -> tuple[float, float, float, Any]:
    """A block turned by 30°: the moment about its middle over that of μ N of each node at its distance; slid instead:
    how much |T|/N differs from μ at most; what a load step takes over the factorization; the answer of the turn."""
    answer = solved(solid({"turn": 30.0, "axis": [0.0, 0.0, 1.0], "pivot": [0.5, 0.5, 0.0]}, order, n))
    state = answer.contacts["block-plate"]
    moment = state.moment[2] - np.cross([0.5, 0.5, 0.0], state.force)[2]
    arms = np.linalg.norm(state.interface.at[0][:, :2] - 0.5, axis=1)
    slid = solved(solid({"shift": [0.6, 0.3, 0.0]}, order, n))
    found = np.array([each["force"] for step in slid.summary["steps"] if step["time"] > 1.2
                      for each in step["contacts"].values()])
    apart = np.abs(np.linalg.norm(found[:, :2], axis=1) / found[:, 2] - FRICTION).max()
    ratio = float(-moment / (FRICTION * (arms * state.normal_force).sum()))
    return ratio, float(apart), cost(slid.summary), answer


def cost(summary: dict) -> float:
    """Seconds of a load step over those of factors and compliances, of the whole run."""
    spent = summary["seconds"]
    return (spent["outer"] + spent["assemble"] + spent["recover"]) / len(summary["steps"]) / spent["factor"]


def bevel() -> float:
    """How far the driven one of configs/drawn/bevel_wheels.toml turns (degrees)."""
    scene = tomllib.loads((ROOT / "configs" / "drawn" / "bevel_wheels.toml").read_text(encoding="utf-8"))
    for each in scene["body"]:
        each["mesh"]["geometry"] = str(ROOT / "configs" / "drawn" / each["mesh"]["geometry"])
    scene["output"] |= {"animation": False}
    freed = solved(scene).solved.assembly.far.freed
    return float(freed[1.0]["driven"][3] - freed[2.0]["driven"][3])


def ball(n: int = 32, widths: float = 10.0) -> tuple[float, float, float, float]:
    """A rigid ball of 1 m, pressed onto a plate by a force, that rolls by so many contact radii against a tenth of μ N:
    its way over its turn, errors of both forces over N, and passes a step."""
    a = 0.06
    load = 4.0 * YOUNG / (1.0 - POISSON**2) * a**3 / 3.0  # Hertz: a³ = 3 N R / 4 E*
    turn, pull = widths * a, 0.1 * FRICTION * load
    plate = {"name": "plate", "material": SOFT, "clamp": ["bottom"], "mesh": {
        "shape": "box", "origin": [-0.2, -0.2, -0.3], "size": [1.0, 0.4, 0.3], "divisions": [n, 2 * n // 5, n // 4]}}
    scene = far([plate], [contact("plate", "ball", "top", friction=coulomb(FRICTION))],
                {"load": [(0.0, 0.0), (1.0, 1.0)], "roll": [(1.0, 0.0), (2.0, 1.0)]}, [1.0, 2.0], 10,
                rigid=[{"name": "ball", "shape": "sphere", "center": [0.0, 0.0, 1.0], "radius": 1.0, "motion": [
                    {"turn": float(np.degrees(turn)), "axis": [0.0, 1.0, 0.0], "pivot": [0.0, 0.0, 1.0],
                     "history": "roll"},
                    {"free": ["x", "y", "z"], "force": [-pull, 0.0, -load], "history": "load"}]}])
    answer = solved(scene)
    freed, steps = answer.solved.assembly.far.freed, answer.summary["steps"]
    way = freed[steps[-1]["time"]]["ball"][0] - freed[1.0]["ball"][0]
    found = np.array([each["force"] for step in steps if step["time"] > 1.0 for each in step["contacts"].values()])
    return (float(way / turn), float(np.abs(found[:, 2] / load + 1.0).max()),
            float(np.abs(found[:, 0] + pull).max() / load),
            float(np.mean([step["passes"] for step in steps if step["time"] > 1.0])))


def sections(folder: Path) -> list[str]:
    """The lines of far.md on these benchmarks; drawings go to the folder."""
    free = [[str(order), f"{turned:.1f}", f"{normal:.0e}", f"{tangential:.0e}", f"{passes:.1f}"] for order in (1, 2)
            for turned, normal, tangential, passes in [rolled(solved(rolling(order)))]]
    still, *pulled = (carter(share, folder) for share in (0.0, 0.5, 0.75))
    creeps = [[f"{share}", f"{(creep - still[0]) / exact:.3f}", f"{pressure:.4f}"]
              for share, (creep, pressure, exact, _) in zip((0.5, 0.75), pulled, strict=True)]
    turning = [[str(order), str(n), f"{moment:.4f}", f"{apart:.0e}", f"{costs:.2f}"] for order, n in (
        (1, 8), (1, 16), (2, 8)) for moment, apart, costs, _ in [torque(order, n)]]
    rolls = ball()
    plane = [[str(order), str(16 * fine), f"{cost(summary_of(block(order, 40, fine=fine))[0]):.2f}"]
             for order, fine in ((1, 1), (1, 4), (2, 1), (2, 4))]
    return [
        "## A loose disc in a bore that turns", "",
        "The disc has no supports: it lies at the bottom by its weight W and rolls there as the bore turns by 120° in "
        "60 steps. Rigid circles of 1 and 1.5 m would turn by 180°. Passes: a step repeats its pairing until the frame "
        "stays.", "", *table(("order", "turn of the disc (degrees)", "N/W − 1", "T/W", "passes a step"), free),
        "## Carter's roller", "",
        "A roller of 1 m is turned on a plate of the same material against a force Q at its free axle: order 2, 8 "
        "nodes on the half-width a = 0.035 m, 6 a far. Creep: the way that it lacks, less that of Q = 0, over Carter's "
        "μ a/R (1 − √(1 − Q/μP)). The largest pressure over Hertz's.", "",
        *table(("Q/μP", "creep over Carter's", "p over p₀"), creeps),
        "## In space", "",
        "A block of 1 m × 1 m × 0.4 m on a plate is turned by 30° about its axis in 6 steps, or slid. Moment: that of "
        "friction about the axis over Σ μ N r of all nodes. A load step's seconds are those of pairing, Newton's "
        "method and recovery, over those of all factors and compliances.", "",
        *table(("order", "cells of an edge", "moment over Σ μ N r", "|T|/N − μ, slid", "a load step over factors"),
               turning),
        "A rigid ball of 1 m rolls by ten of its contact radii on a plate, its turn prescribed and its place free, "
        f"against a tenth of μN. Its way is {rolls[0]:.4f} of its turn; N is right to {rolls[1]:.0e} of it, T to "
        f"{rolls[2]:.0e}; {rolls[3]:.1f} passes a step.", "",
        "Two bevel wheels, drawn cones of 45° on shafts at a right angle (`configs/drawn/bevel_wheels.toml`): the "
        f"driving one turns by 30°, and friction takes the driven one along by {bevel():.2f}°.", "",
        "## A load step beside a factorization, in the plane", "",
        "The block slid along a longer one, seconds as above.", "",
        *table(("order", "spacings of the block", "a load step over factors"), plane)]
