"""What do targets of results cost, and are prices of smaller bars true?

Three scenes with targets of several results are solved on meshes that are made for these results, for the energy norm, and
uniformly fine, until all bars are within. Then each number of other scenes is asked for with half its bar, and with a quarter
of it: the runs are compared with the prices that were told before, from one mesh and from two. It writes
docs/tables/targets.md and takes ten minutes; an interrupted study goes on.
"""

from __future__ import annotations

import json
import logging
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np
from error_scenes import PROBLEMS, body, boxes, contact, drawn, lug, plane, roller, solids
from experiment import Ledger, Row, arguments, publish, table
from mpi4py import MPI
from scenes import run_python, write_scene

import ddmpi
from ddmpi.errors import DdmpiError
from ddmpi.run.answer import Answer

FACTOR = 2.0
"""A price is right if it is off by less than this factor."""

MOST, LARGEST = 60_000, 300_000
"""Prices of more unknowns are not tried; `max_unknowns` of the runs."""

FEW = 5
"""Most numbers of a mesh, each of a kind of its own."""

ASKED = (
    *("boxes", "tresca", "loose", "bonded", "wedge", "rail", "vice", "tubes", "rings", "punch"),
    *("cantilever", "heated", "ball", "roller", "lug", "solids", "hub", "wheel"),
)
"""The problems of which prices are tried."""


def ball(n: int, order: int, off: int) -> dict:
    """A drawn ball on a rigid floor, in space: Hertz."""
    size = 5.7 / n
    mesh = drawn("configs/drawn/ball.geo", order, size=size, contact_size=size)
    sides = [{"on": "side_x", "x": 0.0}, {"on": "side_y", "y": 0.0}]
    press = ({"on": "cut", "value": [0.0, 0.0, -0.00795774715]},)
    return {
        "body": [body("ball", mesh, {"young": 60.0, "poisson": 0.45}, sides, press)],
        "rigid": [plane("floor", [0.0, 0.0, 0.0], [0.0, 0.0, 1.0])],
        "contact": [contact("ball", "floor", "sphere")],
    }


class Goal(NamedTuple):
    """A scene with the largest bars of some results over their values, and the unknowns, clamped ones included, of the
    meshes of the first trial of targets."""

    scene: Callable[[int, int, int], dict]
    results: Sequence[str]
    within: float
    before: int


GOALS = {
    "pin in lug": Goal(
        lug,
        ("contacts.c.normal_force", "contacts.c.pressure_max", "bodies.pin.displacement_max"),
        1e-3,
        5642,
    ),
    "drawn roller": Goal(
        roller,
        (
            "contacts.c.pressure_max",
            "bodies.cylinder.displacement_max",
            "bodies.cylinder.reaction.x",
        ),
        5e-4,
        4350,
    ),
    "drawn ball": Goal(
        ball, ("contacts.c.pressure_max", "bodies.ball.displacement_max"), 2e-2, 9414
    ),
}


MEMORY: dict[str, Callable[[], dict]] = {
    "boxes, fine": lambda: boxes(16, 2, 0),
    "pin in lug, fine": lambda: lug(4, 2, 0),
    "boxes in space": lambda: solids(4, 2, 0),
    "ball, fine": lambda: ball(2, 2, 0),
}
"""Scenes of which the memory is tried."""


def solved(scene: dict, results: Sequence[str], **method: object) -> Answer:
    """The answer with errors of these results, or "main"; files may be refined."""
    for each in scene["body"]:
        if "file" in each["mesh"]:
            each["mesh"]["refine"] = "as needed"
    wanted = results if isinstance(results, str) else list(results)
    scene |= {"output": {"errors": wanted}}
    return ddmpi.solve(scene | {"method": {"tolerance": 1e-8, "max_unknowns": LARGEST} | method})


def levels_of(answer: Answer) -> list[dict]:
    return answer.summary["discretization_error"]["levels"]


def within(answer: Answer, goal: Goal) -> bool:
    entries = (answer.summary["errors"][result] for result in goal.results)
    return all(one["bar"] and one["bar"] <= goal.within * abs(one["value"]) for one in entries)


def on_uniform(goal: Goal) -> Iterator[Answer]:
    for n in (1, 2, 3, 4, 6, 8):
        yield solved(goal.scene(n, 2, 0), goal.results)


def for_energy(goal: Goal) -> Iterator[Answer]:
    first = solved(goal.scene(1, 2, 0), goal.results)
    for k in range(12):
        error = first.summary["discretization_error"]["energy_norm"] * 0.7**k
        yield solved(goal.scene(1, 2, 0), goal.results, target_error=max(error, 1e-9))


def for_results(goal: Goal) -> Iterator[Answer]:
    target = dict.fromkeys(goal.results, goal.within)
    yield solved(goal.scene(1, 2, 0), goal.results, target=target)


MADE = {"results": for_results, "energy": for_energy, "uniform": on_uniform}


def reach(name: str, made: str) -> Row:
    """The last of the meshes that are made so, and what all of them took in the one run that ends there."""
    goal, answer = GOALS[name], None
    for answer in MADE[made](goal):
        if within(answer, goal):
            break
    last = levels_of(answer)[-1]
    told = {result: answer.summary["errors"][result] for result in goal.results}
    seconds = sum(level["seconds"] for level in levels_of(answer))
    found = [last["dofs"], len(levels_of(answer)), round(seconds, 2), within(answer, goal), told]
    return {"told": json.dumps(found)}


def prices(name: str, mesh: str) -> Row:
    """Prices of half the bars on a mesh and on that with half of them, beside the runs that have these bars."""
    n, order, off = map(int, mesh.split())
    scene, found = PROBLEMS[name].scene, list[dict]()
    try:
        first = solved(scene(n, order, off), "main")
    except DdmpiError:
        return {"told": "[]"}
    kinds = dict[str, str]()
    for result, entry in first.summary["errors"].items():
        if entry["half"] and entry["half"]["unknowns"] < MOST:
            kinds.setdefault(".".join(result.split(".")[::2][:2]), result)
    for result in [*kinds.values()][:FEW]:
        before = first
        for meshes in ("one", "two"):
            entry = before.summary["errors"][result]
            price, bar = entry["half"], entry["bar"]
            if not price or price["unknowns"] > MOST:
                break
            try:
                target = {result: {"within": 0.5 * bar}}
                answer = solved(scene(n, order, off), "main", target=target)
            except DdmpiError:
                break
            levels = levels_of(answer)
            if answer.certified:
                seconds = sum(level["seconds"] for level in levels)
                took = {"unknowns": levels[-1]["n"], "seconds": seconds}
                off_by = {key: price[key] / took[key] for key in took}
                found.append({"meshes": meshes, "result": result} | off_by)
            if len(levels) < 2 or not answer.certified:
                break
            before = answer
    return {"told": json.dumps(found)}


def memory(name: str) -> Row:
    """The price of half a bar in bytes, and what a run has that has it, each in a process of its own."""
    scene = MEMORY[name]()
    method: dict[str, object] = {"tolerance": 1e-8}
    with tempfile.TemporaryDirectory() as place:
        told = []
        for number in range(2):
            made = scene | {"output": {"errors": "main"}, "method": method}
            path = write_scene(made, Path(place) / f"{number}.toml")
            folder = Path(place) / str(number)
            run = ["-m", "ddmpi", "run", str(path), "--output", str(folder), "--no-figures"]
            run_python(run, ranks=1)
            told.append(json.loads((folder / "summary.json").read_text(encoding="utf-8")))
            dear = {r: e for r, e in told[0]["errors"].items() if e["half"]}
            result = max(dear, key=lambda r: dear[r]["bar"] / abs(dear[r]["value"]))
            method["target"] = {result: {"within": 0.5 * dear[result]["bar"]}}
    price = told[0]["errors"][result]["half"]
    levels = [summary["discretization_error"]["levels"][-1] for summary in told]
    found = [levels[0]["n"], levels[0]["bytes"], price["unknowns"], price["bytes"]]
    return {"told": json.dumps([*found, levels[1]["n"], levels[1]["bytes"]])}


def pages(rows: Sequence[Row]) -> dict[str, list[str]]:
    """The tables of the page."""
    goals, tried, stored = [], list[dict](), []
    exact = {
        name: {r: e["value"] for r, e in json.loads(row["told"])[4].items()}
        for row in rows
        if (name := row["problem"]) in GOALS and row["mesh"] == "finer"
    }
    for row in rows:
        name, how = row["problem"], row["mesh"]
        told = json.loads(row["told"])
        if how == "memory":
            sizes = [f"{n:,}" if k % 2 == 0 else f"{n / 1e6:.0f}" for k, n in enumerate(told)]
            stored.append([name, *sizes])
        elif name not in GOALS:
            tried += [one | {"problem": name} for one in told]
        elif how != "finer":
            dofs, meshes, seconds, met, errors = told
            off = max(
                abs(entry["value"] - exact[name][result]) / entry["bar"]
                for result, entry in errors.items()
                if entry["bar"]
            )
            before = f"{GOALS[name].before:,}" if how == "results" else ""
            reached = "yes" if met else "no"
            line = [f"{dofs:,}", before, meshes, seconds, reached, f"{off:.2f}"]
            goals.append([f"{name}, {GOALS[name].within:.2%}", how, *line])
    shares = []
    for meshes in ("one", "two"):
        some = [one for one in tried if one["meshes"] == meshes]
        for what in ("unknowns", "seconds"):
            q = np.array([one[what] for one in some] or [np.nan])
            right = f"{100 * np.mean((q < FACTOR) & (q > 1.0 / FACTOR)):.0f} %"
            low, middle, high = np.quantile(q, [0.1, 0.5, 0.9])
            shares.append(
                [meshes, what, len(some), right, *(f"{x:.2f}" for x in (middle, low, high))]
            )
    head = ["unknowns", "first trial", "meshes", "seconds", "met", "error over bar"]
    return {
        "Targets": table(["scene", "meshes for", *head], goals),
        "Prices": table(
            ["from meshes", "of", "prices", "within 2", "median", "10 %", "90 %"], shares
        ),
        "Memory": table(
            ["scene", "unknowns", "MB", "price: unknowns", "MB", "run: unknowns", "MB"], stored
        ),
    }


def finer(name: str) -> Row:
    """The values on uniformly fine meshes, in space on those for a quarter of the bars."""
    goal = GOALS[name]
    if goal.scene is ball:
        target = dict.fromkeys(goal.results, 0.25 * goal.within)
        answer = solved(goal.scene(1, 2, 0), goal.results, target=target)
    else:
        answer = solved(goal.scene(8, 2, 0), goal.results)
    told = {result: answer.summary["errors"][result] for result in goal.results}
    return {"told": json.dumps([levels_of(answer)[-1]["dofs"], 0, 0.0, True, told])}


def main() -> None:
    parser = arguments(__doc__, "targets")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="of the scenes, such as roller")
    options = parser.parse_args()
    logging.getLogger("ddmpi").setLevel(logging.ERROR)
    runs = {(name, how): None for name in GOALS for how in (*MADE, "finer")}
    runs |= {(name, "memory"): None for name in MEMORY}
    for name in ASKED:
        meshes = PROBLEMS[name].meshes[:-1]
        quadratic, linear = ([mesh for mesh in meshes if mesh[1] == order] for order in (2, 1))
        for mesh in (*quadratic[:1], *linear[1:2]):
            runs[name, " ".join(map(str, mesh))] = None
    wanted = {key: None for key in runs if not options.only or key[0] in options.only}
    key = ("problem", "mesh")
    ledger = Ledger(MPI.COMM_WORLD, options.output / "targets.csv", key, ("told",))

    def measure(problem: str, mesh: str) -> Row:
        if mesh == "finer":
            return finer(problem)
        if mesh == "memory":
            return memory(problem)
        return reach(problem, mesh) if problem in GOALS else prices(problem, mesh)

    rows = [row for row in ledger.fill(wanted, measure) if (row["problem"], row["mesh"]) in wanted]
    publish("targets.md", pages(rows), options.output, complete=len(wanted) == len(runs))


if __name__ == "__main__":
    main()
