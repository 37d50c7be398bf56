"""Many bodies: iterations, multiplications, ranks, messages.

Sections, each with a table of its own:

  iterations  GMRES iterations per Newton step on the scenes of SCENES, with and without coarse modes, beside those of
              a dense prototype; multiplications by A⁻¹ per body
  work        multiplications per body of a wall and of two blocks on the same mesh
  ranks       the same scene on different numbers of ranks, each twice: answers compared
  messages    what a rank sends, in rows of blocks with a rank for each
  bricks      iterations and products of bricks in space, by pairs of nodes and by mortar

Writes to the folder --output a CSV file for each section (a line per measurement, written at once, so that an
interrupted study continues) and assemblies_table.md; once all sections are there, the table is also written to
docs/tables/. The scenes are dictionaries with the keys of a scene's TOML file, for
other studies as well.
"""

import argparse
import json
import math
import sys
import tempfile
import time
from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
from experiment import Ledger, Row, arguments, publish, table, where
from mpi4py import MPI
from scenes import prepare_scene, run_command, run_python, to_toml, write_scene

import ddmpi
from ddmpi.methods import krylov
from ddmpi.results.tables import read_results
from ddmpi.run.solve import solve

# Scenes. N is the number of divisions of a unit of length. Blocks are steel and one unit high, pressed by PRESSURE
# from above.

Scene = dict

STEEL, STONE = {"young": 2.119e11, "poisson": 0.277}, {"young": 2.0e10, "poisson": 0.2}
PRESSURE = 6e7


class Maker:
    """Collects the tables of one scene; bodies are named in the order in which they come, contacts likewise."""

    def __init__(self, title: str, friction: float | None) -> None:
        self.scene: Scene = {"title": title, "rigid": [], "body": [], "contact": [], "method": {"tolerance": 1e-8}}
        self._law = {"kind": "bonded"} if friction is None else {
            "kind": "unilateral", "friction": {"law": "coulomb", "coefficient": friction}}

    def body(self, corners: list[tuple[float, float]], divisions: tuple[int, int], clamp: list[str] | None = None,
             loads: dict[str, tuple[float, float]] | None = None, weight: float = 0.0,
             material: dict[str, float] = STEEL) -> str:
        name = f"body{len(self.scene['body'])}"
        self.scene["body"].append({
            "name": name, "mesh": {"shape": "quadrilateral", "corners": [list(each) for each in corners],
                                   "divisions": list(divisions)},
            "material": material, "clamp": clamp or [],
            "traction": [{"on": on, "value": list(value)} for on, value in (loads or {}).items()],
            "volume_force": [0.0, -weight]})
        return name

    def block(self, N: int, x: float, y: float, width: float, **more) -> str:
        X, Y = x + width, y + 1.0
        return self.body([(x, y), (X, y), (X, Y), (x, Y)], (round(width * N), N), **more)

    def contact(self, first: str, second: str, *on: str) -> None:
        self.scene["contact"].append({"name": f"i{len(self.scene['contact'])}", "bodies": [first, second],
                                      "on": list(on)} | self._law)

    def on_top(self, upper: str, lower: str) -> None:
        self.contact(upper, lower, "bottom", "top")

    def beside(self, left: str, right: str) -> None:
        self.contact(left, right, "right", "left")

    def plane(self, x: float, y: float) -> str:
        """A rigid plane that looks up."""
        name = f"rigid{len(self.scene['rigid'])}"
        self.scene["rigid"].append({"name": name, "shape": "plane", "point": [x, y], "normal": [0.0, 1.0]})
        return name


def stack(K: int, clamped: bool, N: int = 8, width: float = 3.0, shear: float = 0.05) -> Scene:
    """K blocks on each other, Coulomb 0.3: all of them clamped on the left and pulled and pushed at the right, or the
    lowest alone clamped, at its bottom, and the highest sheared by `shear` of the pressure."""
    maker = Maker(f"{K} {'clamped' if clamped else 'loose'} blocks on each other", 0.3)
    for k in range(K):
        if clamped:
            loads = {"bottom": (0.0, PRESSURE / 1.5)} if k == 0 else {"right": (1e7 * (-1) ** k, 5e6)}
            if k == K - 1:
                loads = {"top": (0.0, -PRESSURE), "right": (2e7, 3e7)}
        else:
            loads = {"top": (shear * PRESSURE, -PRESSURE)} if k == K - 1 else {}
        clamp = ["left"] if clamped else ["bottom"] if k == 0 else []
        block = maker.block(N, 0.0, float(k), width, clamp=clamp, loads=loads)
        if k:
            maker.on_top(block, f"body{k - 1}")
    return maker.scene


def slabs(K: int, length: float, N: int = 3) -> Scene:
    """A loose stack of K slender slabs."""
    return stack(K, False, N, length, 0.02) | {"title": f"{K} slabs {length:g} : 1 on each other"}


def wall(rows: int, columns: int, N: int = 8) -> Scene:
    """A wall in running bond, Coulomb 0.5: bricks of two units, half ones at the ends of every other row."""
    maker, below = Maker(f"Wall of {rows} rows in running bond", 0.5), []
    for row in range(rows):
        joints = list(range(0, 2 * columns + 1, 2)) if row % 2 == 0 else [0, *range(1, 2 * columns, 2), 2 * columns]
        loads = {"top": (3e6, -2e7)} if row == rows - 1 else {}
        here = [(x, X, maker.block(N, float(x), float(row), float(X - x), clamp=[] if row else ["bottom"],
                                   loads=loads)) for x, X in pairwise(joints)]
        for k, (x, X, brick) in enumerate(here):
            for u, U, lower in below:
                if min(U, X) > max(u, x):
                    maker.on_top(brick, lower)
            if k + 1 < len(here):
                maker.beside(brick, here[k + 1][2])
        below = here
    return maker.scene


def arch(number: int, N: int = 8) -> Scene:
    """A half-circle of voussoirs between the radii 4 and 5 on two rigid springings, under its weight, Coulomb 0.6."""
    maker = Maker(f"Arch of {number} voussoirs", 0.6)
    left, right = maker.plane(-5.0, 0.0), maker.plane(4.0, 0.0)
    angles = [math.pi * (1 - k / number) for k in range(number + 1)]
    names = []
    for start, end in pairwise(angles):
        corners = [(r * math.cos(angle), r * math.sin(angle)) for r, angle in ((4, start), (4, end), (5, end),
                                                                                (5, start))]
        names.append(maker.body(corners, (round(4.5 * math.pi / number * N), N), weight=2e4, material=STONE))
    for one, other in pairwise(names):
        maker.beside(one, other)
    maker.contact(names[0], left, "left")
    maker.contact(names[-1], right, "right")
    return maker.scene


def checkerboard(side: int, bonded: bool, N: int = 8) -> Scene:
    """Squares, clamped on the left and pressed from above; bonded and pulled up, or Coulomb 0.3 and pressed from the
    right, too."""
    maker = Maker(f"{side * side} {'bonded' if bonded else 'loose'} squares", None if bonded else 0.3)
    at = {}
    for i in range(side):
        for j in range(side):
            loads = {"top": (0.0, -1e7)} if j == side - 1 else {}
            if i == side - 1:
                loads |= {"right": (0.0 if bonded else -5e7, 2e6)}
            at[i, j] = maker.block(N, float(i), float(j), 1.0, clamp=[] if i else ["left"], loads=loads)
    for i in range(side - 1):
        for j in range(side):
            maker.beside(at[i, j], at[i + 1, j])
    for i in range(side):
        for j in range(side - 1):
            maker.on_top(at[i, j + 1], at[i, j])
    return maker.scene


def in_space(scene: Scene, N: int, pairing: str) -> Scene:
    """Blocks of the plane as boxes one unit thick, sheared sideways as well; with mortar every other one is finer."""
    for number, body in enumerate(scene["body"]):
        (x, z), (X, Z) = body["mesh"]["corners"][::2]
        fine = N + (number % 2 if pairing == "mortar" else 0)
        body["mesh"] = {"shape": "box", "origin": [x, 0.0, z], "size": [X - x, 1.0, Z - z],
                        "divisions": [round((X - x) * fine), fine, round((Z - z) * fine)]}
        for load in body["traction"]:
            along, upwards = load["value"]
            load["value"] = [along, 0.3 * along, upwards]
        body["volume_force"].insert(1, 0.0)
    scene["contact"] = [contact | {"pairing": pairing} for contact in scene["contact"]]
    return scene


def cube(side: int, N: int, pairing: str) -> Scene:
    """Loose cubes in rows, columns and layers on a rigid floor, Coulomb 0.5; by mortar every other one is finer."""
    law = {"friction": {"law": "coulomb", "coefficient": 0.5}}
    scene: Scene = {"rigid": [{"name": "floor", "shape": "plane", "point": [0, 0, 0], "normal": [0, 0, 1]}], "body": [],
                    "contact": [], "method": {"tolerance": 1e-8}}
    for x, y, z in np.ndindex(side, side, side):
        fine = N + ((x + y + z) % 2 if pairing == "mortar" else 0)
        loads = [{"on": "top", "value": [0.0, 0.0, -1e5]}] * (z == side - 1)
        scene["body"].append({
            "name": f"b{x}{y}{z}", "mesh": {"shape": "box", "origin": [x, y, z], "size": [1, 1, 1],
                                            "divisions": [fine, fine, fine]},
            "material": {"young": 2e9, "poisson": 0.3}, "volume_force": [0.0, 0.0, -25e3],
            "traction": loads + [{"on": "left", "value": [2e3, 0.0, 0.0]}] * (x == 0)})
        if z == 0:
            scene["contact"].append({"bodies": [f"b{x}{y}0", "floor"], "on": ["bottom"]} | law)
        for X, Y, Z, *on in ((x + 1, y, z, "right", "left"), (x, y + 1, z, "back", "front"),
                             (x, y, z + 1, "top", "bottom")):
            if max(X, Y, Z) < side:
                scene["contact"].append({"bodies": [f"b{x}{y}{z}", f"b{X}{Y}{Z}"], "on": on, "pairing": pairing} | law)
    return scene


# What is measured

PAGE = "assemblies_table.md"
ALLOWED = 1.2
"""Iterations may be those of the prototype times this."""

LIMIT = 550.0
"""Seconds after which a run is given up."""

SCENES: dict[str, tuple[Callable[[], Scene], float | None, float]] = {
    # the prototype's iterations per step with coarse modes, where it was measured, and without
    **{f"{K} blocks, clamped": (lambda K=K: stack(K, True), *found) for K, found in
       {2: (None, 6.0), 4: (6.1, 10.7), 8: (None, 15.7), 16: (9.6, 23.5)}.items()},
    **{f"{K} blocks, loose": (lambda K=K: stack(K, False), *found) for K, found in
       {2: (None, 5.0), 4: (5.7, 7.2), 8: (None, 10.0), 16: (5.3, 9.1)}.items()},
    "wall 4 x 3": (lambda: wall(4, 3), 9.1, 12.9),
    "wall 6 x 4, N = 6": (lambda: wall(6, 4, 6), 9.1, 14.2),
    "arch of 11": (lambda: arch(11), 5.8, 6.0),
    "4 x 4 squares, bonded": (lambda: checkerboard(4, True), 7.3, 10.3),
    "4 x 4 squares, Coulomb": (lambda: checkerboard(4, False), 7.5, 10.2),
    "4 slabs 10 : 1": (lambda: slabs(4, 10.0), 15 / 3, 44 / 3),
    "2 slabs 20 : 1": (lambda: slabs(2, 20.0), 14 / 3, 33 / 3),
    "4 slabs 20 : 1": (lambda: slabs(4, 20.0), 19 / 3, 66 / 3),
    "4 slabs 40 : 1": (lambda: slabs(4, 40.0), 15 / 3, 170 / 6),
}
WORK = {"wall": lambda N: wall(6, 4, N), "two clamped blocks": lambda N: stack(2, True, N),
        "two blocks, one loose": lambda N: stack(2, False, N)}
RANKS = (1, 2, 3, 5, 8, 16)
SPREAD = {"16 blocks, clamped": (SCENES["16 blocks, clamped"][0], RANKS),
          "wall 4 x 3, N = 4": (lambda: wall(4, 3, 4), RANKS),
          "wall 14 x 14, N = 4": (lambda: wall(14, 14, 4), (1, 2, 4, 16))}
ROWS, DIVISIONS = (4, 16, 64), (6, 8)
BRICKS: dict[str, Callable[[int, str], Scene]] = {
    "two boxes, clamped": lambda N, pairing: in_space(stack(2, True), N, pairing),
    "16 boxes, clamped": lambda N, pairing: in_space(stack(16, True), N, pairing),
    "wall of 27 bricks": lambda N, pairing: in_space(wall(6, 4), N, pairing),
    "27 loose cubes": lambda N, pairing: cube(3, N, pairing)}
FINE = 4
"""Divisions of a unit of length of bricks in space."""

SECTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "iterations": (("scene", "modes"), ("bodies", "steps", "iterations", "n_A", "certified", "seconds")),
    "work": (("scene", "N"), ("bodies", "n_A")),
    "ranks": (("scene", "ranks"), ("distance", "same_statuses", "repeated", "seconds")),
    "messages": (("blocks",), ("motions", "product_messages", "product_bytes", "products", "messages", "bytes",
                               "reductions", "reduced_bytes", "certified", "seconds")),
    "bricks": (("scene", "pairing"), ("bodies", "steps", "iterations", "n_A", "certified", "seconds")),
}


# Measurements

def measure_iterations(name: str, modes: bool) -> Row:
    """One scene on one rank, with coarse modes or without."""
    kept = krylov.SMOOTH
    krylov.SMOOTH = kept if modes else dict.fromkeys(kept, np.inf)
    try:
        return count_iterations(SCENES[name][0]())
    finally:
        krylov.SMOOTH = kept


def measure_bricks(name: str, pairing: str) -> Row:
    return count_iterations(BRICKS[name](FINE, pairing))


def count_iterations(scene: Scene) -> Row:
    start = time.perf_counter()
    answer = ddmpi.solve(to_toml(scene), MPI.COMM_SELF)
    outer, summary = answer.solved.solution.outer, answer.summary
    return {"bodies": len(summary["bodies"]), "steps": len(outer.history), "iterations": outer.inner_steps["gmres"],
            "n_A": summary["n_A"], "certified": answer.certified, "seconds": round(time.perf_counter() - start, 2)}


def measure_work(name: str, N: int) -> Row:
    summary = ddmpi.solve(to_toml(WORK[name](N)), MPI.COMM_SELF).summary
    return {"bodies": len(summary["bodies"]), "n_A": summary["n_A"]}


def run_on(folder: Path, scene: Scene, ranks: int) -> Path:
    """The folder of results of a run of the command."""
    output = Path(tempfile.mkdtemp(dir=folder)) / "out"
    run = run_command(write_scene(scene, folder / "scene.toml"), output, "--no-figures", ranks=ranks, limit=LIMIT)
    if run.code:
        sys.exit(run.output)
    return output


def measure_ranks(name: str, ranks: int) -> Row:
    """Two runs on so many ranks, compared with one on one rank and with each other."""
    with tempfile.TemporaryDirectory() as place:
        folder, scene = Path(place), SPREAD[name][0]()
        one, start = read_results(run_on(folder, scene, 1)), time.perf_counter()
        paths = [run_on(folder, scene, ranks) for _ in range(2)]
        end, found = time.perf_counter(), read_results(paths[0])
        u, reference = found.fields["displacement"], one.fields["displacement"]
        return {"distance": float(f"{np.abs(u - reference).max() / np.abs(reference).max():.1e}"),
                "same_statuses": all((found.contacts[contact]["status"] == columns["status"]).all()
                                     for contact, columns in one.contacts.items()),
                "repeated": all(path.read_bytes() == (paths[1] / path.name).read_bytes() for path in
                                [paths[0] / "result.h5", *sorted(paths[0].glob("*.csv"))]),
                "seconds": round((end - start) / 2, 2)}


def count_messages(world: MPI.Comm, K: int) -> Row:
    """What K ranks do for `measure_messages`: a product, and then all of a run; the most that a rank sends."""
    assembly = prepare_scene(world, stack(K, True, 4))
    exchange, joint = assembly.exchange, assembly.joint
    before = exchange.state()
    joint.product(np.ones(joint.size), "test", 0.0)
    product = {name: count - before[name] for name, count in exchange.state().items()}
    solution = solve(assembly, assembly.scene.method)
    found = {f"product_{name}": product[name] for name in ("messages", "bytes")} | exchange.state() | {
        "products": assembly.member.C.count["newton"],
        "motions": joint.rigid.size + solution.outer._preconditioner.motions.size}
    return {name: world.allreduce(value, MPI.MAX) for name, value in found.items()} | {"certified": solution.certified}


def measure_messages(K: int) -> Row:
    start = time.perf_counter()
    child = run_python(["-m", "mpi4py", __file__, "--count-messages", str(K)], ranks=K, limit=LIMIT)
    if child.code:
        sys.exit(child.output)
    return json.loads(child.stdout.splitlines()[-1]) | {"seconds": round(time.perf_counter() - start, 1)}


# Tables

def iterations_table(rows: list[Row]) -> list[str]:
    lines = []
    for row in where(rows, modes=True):
        _, known, plain = SCENES[row["scene"]]
        without = where(rows, scene=row["scene"], modes=False)
        aim, each = ALLOWED * (known or plain), row["iterations"] / row["steps"]
        lines.append([row["scene"], row["steps"], f"{each:.1f}", "–" if known is None else f"{known:.1f}",
                      f"{each / (known or plain):.2f}", "yes" if each <= aim and row["certified"] else "**no**",
                      *(f"{other['iterations'] / other['steps']:.1f}" for other in without), f"{plain:.1f}",
                      f"{row['n_A'] / row['bodies']:.0f}"])
    return ["## Iterations per Newton step", "",
            "On one rank, N = 8 but where said (slabs: 3). Beside them the numbers of a dense prototype. Aim: with "
            f"coarse modes at most {ALLOWED} times the prototype's with modes; where it was measured without only, "
            "those. Two bodies that clamps hold have no coarse modes.", "",
            *table(["scene", "steps", "iterations a step", "prototype", "ratio", "aim met", "without modes",
                    "prototype without", "n_A a body"], lines)]


def work_table(rows: list[Row]) -> list[str]:
    lines = []
    for N in sorted({row["N"] for row in rows}):
        each = {row["scene"]: row["n_A"] / row["bodies"] for row in where(rows, N=N)}
        if set(each) == set(WORK):
            lines.append([N, *(f"{each[name]:.1f}" for name in WORK),
                          *(f"{each['wall'] / each[name]:.2f}" for name in list(WORK)[1:])])
    return ["## Multiplications by A⁻¹ for each body", "",
            "A wall of 27 bricks beside two blocks of the same mesh size: both clamped, as in "
            "`configs/pinched_blocks.toml`, or the lower one alone. Aim: at most 1.5 times the former.", "",
            *table(["N", *WORK, "wall / two clamped", "wall / one loose"], lines)]


def ranks_table(rows: list[Row]) -> list[str]:
    return ["## Numbers of ranks", "",
            "Largest difference of displacements from those on one rank, over the largest displacement; whether all "
            "contact nodes have the same status; whether a second run writes the same bytes (`result.h5`, all tables). "
            "Aim: 1e-9, yes, yes.", "",
            *table(["scene", "ranks", "distance", "same statuses", "same bytes again", "seconds"],
                   [[row["scene"], row["ranks"], f"{row['distance']:.1e}", _yes(row["same_statuses"]),
                     _yes(row["repeated"]), row["seconds"]] for row in rows])]


def messages_table(rows: list[Row]) -> list[str]:
    return ["## What a rank sends", "",
            "Clamped blocks in a row (N = 4), a rank for each; the most of all ranks. To neighbours for one product "
            "with the joint compliance, and in all of a run for each product; reductions over all ranks of flags, "
            "scalars and the coarse problem, without those of PETSc's GMRES. The coarse problem has so many unknowns, "
            "8 bytes each in every iteration.", "",
            *table(["blocks", "messages a product", "bytes a product", "products", "bytes to neighbours / products",
                    "reductions / products", "reduced bytes / products", "coarse unknowns", "seconds"],
                   [[row["blocks"], row["product_messages"], row["product_bytes"], row["products"],
                     *(f"{row[name] / row['products']:.{digits}f}" for name, digits in
                       (("bytes", 0), ("reductions", 1), ("reduced_bytes", 0))), row["motions"], row["seconds"]]
                    for row in rows])]


def bricks_table(rows: list[Row]) -> list[str]:
    boxes = {row["pairing"]: row["n_A"] / row["bodies"] for row in where(rows, scene="two boxes, clamped")}
    return ["## Bricks in space", "",
            f"Boxes of tetrahedra of order 1, {FINE} cells a unit, on one rank: matching ones by pairs of nodes, and "
            "by mortar where every other one has a cell more. Aim: at most 10 iterations a step, and at most 1.5 times "
            "the products a body of two boxes that clamps hold.", "",
            *table(["scene", "pairing", "steps", "iterations a step", "products a body", "over two boxes'",
                    "certified"],
                   [[row["scene"], row["pairing"], row["steps"], f"{row['iterations'] / row['steps']:.1f}",
                     f"{row['n_A'] / row['bodies']:.0f}",
                     f"{row['n_A'] / row['bodies'] / boxes[row['pairing']]:.2f}" if row["pairing"] in boxes else "–",
                     _yes(row["certified"])] for row in rows])]


def _yes(value: bool) -> str:
    return "yes" if value else "**no**"


def main() -> None:
    parser = arguments(__doc__, "assemblies")
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS), metavar="NAME",
                        help="default: all")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES), metavar="NAME",
                        help="of the section iterations")
    parser.add_argument("--rows", nargs="+", type=int, default=ROWS, metavar="K", help="of the section messages")
    parser.add_argument("--count-messages", type=int, metavar="K", help=argparse.SUPPRESS)  # for the ranks that count
    options = parser.parse_args()
    world = MPI.COMM_WORLD
    if options.count_messages:
        found = count_messages(world, options.count_messages)
        if world.rank == 0:
            print(json.dumps(found))
        return
    work: dict[str, tuple[list[tuple], Callable[..., Row]]] = {
        "iterations": ([(name, modes) for name in options.scenes for modes in (True, False)], measure_iterations),
        "work": ([(name, N) for N in DIVISIONS for name in WORK], measure_work),
        "ranks": ([(name, ranks) for name, (_, several) in SPREAD.items() for ranks in several], measure_ranks),
        "messages": ([(K,) for K in options.rows], measure_messages),
        "bricks": ([(name, pairing) for name in BRICKS for pairing in ("nodes", "mortar")], measure_bricks)}
    tables = {"iterations": iterations_table, "work": work_table, "ranks": ranks_table, "messages": messages_table,
              "bricks": bricks_table}
    lines, complete = ["# Assemblies, measured", "", "Generated by `scripts/study assembly_study`.", ""], True
    for section, (key, others) in SECTIONS.items():
        path = options.output / f"{section}.csv"
        if section in options.sections or path.exists():
            keys, measure = work[section]
            rows = Ledger(world, path, key, others).fill(keys if section in options.sections else (), measure)
            lines += tables[section](rows)
        complete &= path.exists()
    complete &= options.scenes == list(SCENES)
    text = "\n".join(lines)
    publish(PAGE, text, options.output, complete)
    print(text)


if __name__ == "__main__":
    main()
