#!/usr/bin/env bash
"exec" "bash" "-c" '. "${0%/*}/setup.sh"; exec "$PYTHON" "$0" "$@"' "$0" "$@"  # to Python, a string

__doc__ = """Many bodies: iterations, multiplications, ranks, messages.

Sections, each with a table of its own:

  iterations  GMRES iterations per Newton step on the scenes of `named_assemblies`, with and without coarse modes,
              beside those of a dense prototype; multiplications by A⁻¹ per body
  work        multiplications per body of a wall and of two blocks on the same mesh
  ranks       the same scene on different numbers of ranks, each twice: answers compared
  messages    what a rank sends, in rows of blocks with a rank for each
  before      two blocks on two ranks, in turns with an older checkout of this repository (--older DIR, as made by
              `git worktree add DIR COMMIT`): smallest times of all repetitions

Writes to the folder --output a CSV file for each section (a line per measurement, written at once, so that an
interrupted study continues) and assemblies_table.md; once all sections are there, the table is also written to
docs/tables/.
"""

import argparse
import json
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, publish, table, where
from mpi4py import MPI
from named_assemblies import Scene, arch, checkerboard, slabs, stack, wall

import ddmpi
from ddmpi.methods import newton
from ddmpi.results.tables import read_results
from ddmpi.run.solve import solve

sys.path.insert(0, str(ROOT / "tests"))

from scenes import prepare_scene, run_command, run_python, to_toml, write_scene

PAGE = "assemblies_table.md"
COMPARED = ("factor", "outer", "total", "command")
"""Phases of the section before."""

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
SIZES = {22: 10, 86: 6, 160: 3}
"""N of two blocks, and how often both checkouts are measured."""

SECTIONS: dict[str, tuple[tuple[str, ...], tuple[str, ...]]] = {
    "iterations": (("scene", "modes"), ("bodies", "steps", "iterations", "n_A", "certified", "seconds")),
    "work": (("scene", "N"), ("bodies", "n_A")),
    "ranks": (("scene", "ranks"), ("distance", "same_statuses", "repeated", "seconds")),
    "messages": (("blocks",), ("motions", "product_messages", "product_bytes", "products", "messages", "bytes",
                               "reductions", "reduced_bytes", "certified", "seconds")),
    "before": (("N", "repetition"), tuple(f"{phase}_{when}" for phase in COMPARED for when in ("before", "now"))),
}


# Measurements

def measure_iterations(name: str, modes: bool) -> Row:
    """One scene on one rank, with coarse modes or without."""
    kept, start = newton.SMOOTH, time.perf_counter()
    newton.SMOOTH = kept if modes else np.inf
    try:
        answer = ddmpi.solve(to_toml(SCENES[name][0]()), MPI.COMM_SELF)
    finally:
        newton.SMOOTH = kept
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


def measure_before(older: Path, N: int) -> Row:
    """The phases of the slower rank of both checkouts, one after the other."""
    found = {}
    settings = [word for name in ("upper", "lower") for word in ("--set", f"body.{name}.mesh.divisions=[{3 * N}, {N}]")]
    for when, checkout in (("before", older), ("now", ROOT)):
        with tempfile.TemporaryDirectory() as folder:  # Python looks for modules where it is started
            start = time.perf_counter()
            run = run_command(ROOT / "configs" / "pinched_blocks.toml", Path(folder), "--no-figures", *settings,
                              limit=LIMIT, cwd=checkout)
            whole = time.perf_counter() - start
            if run.code:
                sys.exit(run.output)
            seconds = run.summary["seconds"] | {"command": whole}
            found |= {f"{phase}_{when}": round(seconds[phase], 5) for phase in COMPARED}
    return found


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


def before_table(rows: list[Row]) -> list[str]:
    lines = []
    for N in sorted({row["N"] for row in rows}):
        same = where(rows, N=N)
        least = {name: min(row[name] for row in same) for name in SECTIONS["before"][1]}
        lines.append([N, len(same), *(cell for phase in COMPARED for cell in (
            *(f"{least[f'{phase}_{when}']:.3f}" for when in ("before", "now")),
            f"{least[f'{phase}_now'] / least[f'{phase}_before']:.2f}"))])
    return ["## Two blocks on two ranks, before and now", "",
            "`configs/pinched_blocks.toml` in turns on the last commit that knew two bodies only and on this one; the "
            "smallest times (s). `command` is the whole process. `total` now holds loading h5py and the versions of "
            "libraries, which stood before it then.", "",
            *table(["N", "times", *(name for phase in COMPARED for name in (f"{phase} before", "now", "ratio"))],
                   lines)]


def _yes(value: bool) -> str:
    return "yes" if value else "**no**"


def main() -> None:
    parser = arguments(__doc__, "assemblies")
    parser.add_argument("--sections", nargs="+", choices=SECTIONS, default=list(SECTIONS)[:-1], metavar="NAME",
                        help="default: all but before")
    parser.add_argument("--scenes", nargs="+", choices=SCENES, default=list(SCENES), metavar="NAME",
                        help="of the section iterations")
    parser.add_argument("--rows", nargs="+", type=int, default=ROWS, metavar="K", help="of the section messages")
    parser.add_argument("--sizes", nargs="+", type=int, default=list(SIZES), metavar="N", help="of the section before")
    parser.add_argument("--older", type=Path, metavar="DIR", help="checkout for the section before")
    parser.add_argument("--count-messages", type=int, metavar="K", help=argparse.SUPPRESS)  # for the ranks that count
    options = parser.parse_args()
    world = MPI.COMM_WORLD
    if options.count_messages:
        found = count_messages(world, options.count_messages)
        if world.rank == 0:
            print(json.dumps(found))
        return
    if "before" in options.sections and not options.older:
        parser.error("the section before needs --older DIR")
    work: dict[str, tuple[list[tuple], Callable[..., Row]]] = {
        "iterations": ([(name, modes) for name in options.scenes for modes in (True, False)], measure_iterations),
        "work": ([(name, N) for N in DIVISIONS for name in WORK], measure_work),
        "ranks": ([(name, ranks) for name, (_, several) in SPREAD.items() for ranks in several], measure_ranks),
        "messages": ([(K,) for K in options.rows], measure_messages),
        "before": ([(N, k) for N in options.sizes for k in range(SIZES.get(N, 3))],
                   lambda N, _: measure_before(options.older.resolve(), N))}
    tables = {"iterations": iterations_table, "work": work_table, "ranks": ranks_table, "messages": messages_table,
              "before": before_table}
    lines, complete = ["# Assemblies, measured", "", "Generated by `scripts/assembly_study.py`.", ""], True
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
