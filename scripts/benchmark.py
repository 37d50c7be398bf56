#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""What a run costs, beside one plain factorization and solve of one body.

Pinched blocks with Coulomb friction, default method, tolerance 1e-8, on meshes of 6072 to 1.2 million unknowns. For
each mesh, several times over, on two ranks:

  run      the command, without pictures: its time from start to end, its phases, its peak memory
  pair     the same phases and then, in the same two processes and at the same time in both, a plain MUMPS Cholesky
           factorization (no Schur complement) and a solve with the body's stiffness: in the ordering that MUMPS
           chooses, and in that of least fill, which the program uses where it needs no Schur complement
  plain    two processes that mesh, assemble, factor and solve, and do nothing else: their peak memory

The smallest time and the largest memory of all repetitions count. Writes to the folder --output benchmark.csv (a line
per repetition, written at once, so that an interrupted study continues) and benchmark_table.md; once all meshes are
done, the table is also written to docs/tables/.
"""

import argparse
import gc
import json
import resource
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, processor, publish, save_figures, seconds, table
from mpi4py import MPI
from petsc4py import PETSc
from scenes import run_command, run_python

from ddmpi.body.elasticity import assemble
from ddmpi.coupling.assembly import prepare
from ddmpi.mesh.build import build_mesh
from ddmpi.run.solve import solve
from ddmpi.scene.reader import read_scene_file
from ddmpi.system.clock import Clock
from ddmpi.system.provenance import versions

SCENE = ROOT / "configs" / "pinched_blocks.toml"
PAGE = "benchmark_table.md"
SIZES = {22: 5, 54: 5, 86: 5, 140: 3, 200: 3, 320: 2}
"""N, and how often it is measured."""

FITTED = 86
"""From this N on, the growth with the number of unknowns is fitted."""

LIMIT = 900.0
"""Seconds after which two processes are given up."""

ORDERINGS = {"chosen": 7, "least_fill": 2}
"""MUMPS's ICNTL(7)."""

PHASES = ("mesh", "assemble", "factor", "outer", "recover", "estimate", "output")
PLAIN = tuple(f"{ordering}_{step}" for ordering in ORDERINGS for step in ("factor", "solve"))
KEY = ("N", "repetition")
MEASURED = ("n", "m", "iterations", "n_A", "whole", *PHASES, "memory", "pair_assemble", "pair_factor", "pair_outer",
            *PLAIN, *(f"{ordering}_memory" for ordering in ORDERINGS))


# Two processes that measure

def divisions(N: int) -> list[str]:
    return [f"body.{name}.mesh.divisions=[{3 * N}, {N}]" for name in ("upper", "lower")]


def factor_and_solve(world: MPI.Comm, A: PETSc.Mat, b: PETSc.Vec, ordering: str) -> tuple[float, float]:
    """Seconds of a plain factorization and of one solve, the slower rank's; both start together. Collective."""
    PETSc.Options().setValue("plain_mat_mumps_icntl_7", ORDERINGS[ordering])
    ksp, u = PETSc.KSP().create(PETSc.COMM_SELF), b.duplicate()
    ksp.setOptionsPrefix("plain_")
    ksp.setOperators(A)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
    ksp.getPC().setFactorSolverType("mumps")
    ksp.setFromOptions()
    seconds = []
    for step in (ksp.setUp, lambda: ksp.solve(b, u)):
        world.Barrier()
        start = time.perf_counter()
        step()
        seconds.append(world.allreduce(time.perf_counter() - start, MPI.MAX))
    for thing in (ksp, u):
        thing.destroy()
    return tuple(seconds)


def measure_pair(world: MPI.Comm, N: int) -> dict[str, float]:
    scene, clock = read_scene_file(SCENE, divisions(N)), Clock()
    assembly = prepare(world, scene, clock=clock)
    solution = solve(assembly, scene.method, clock=clock)
    if not solution.certified:
        raise RuntimeError(solution.reason)
    found = {f"pair_{phase}": value for phase, value in clock.largest(world).items()
             if phase in ("assemble", "factor", "outer")}
    (body,) = assembly.bodies
    elasticity = assemble(body.mesh, body.spec)  # in the mesh's order, which is the better one here
    A, b = elasticity.A, elasticity.b
    for ordering in ORDERINGS:
        found |= dict(zip((f"{ordering}_factor", f"{ordering}_solve"), factor_and_solve(world, A, b, ordering),
                          strict=True))
    return found


def measure_plain(world: MPI.Comm, N: int, ordering: str) -> dict[str, float]:
    body = read_scene_file(SCENE, divisions(N)).body[world.rank]
    elasticity = assemble(build_mesh(body), body)
    factor_and_solve(world, elasticity.A, elasticity.b, ordering)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {f"{ordering}_memory": world.allreduce(peak, MPI.MAX)}


def measure(what: str, N: int, *more: str) -> None:
    """What the two processes do; rank 0 prints the result as JSON."""
    world = MPI.COMM_WORLD
    found = {"pair": measure_pair, "plain": measure_plain}[what](world, N, *more)
    gc.collect()
    if world.rank == 0:
        print(json.dumps(found))


# The process that starts them

def repeat(N: int) -> dict[str, float]:
    """All measurements of one repetition."""
    settings = [word for setting in divisions(N) for word in ("--set", setting)]
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        run = run_command(SCENE, Path(folder), "--no-figures", *settings, limit=LIMIT)
        whole = time.perf_counter() - start
        if run.code:
            sys.exit(run.output)
        summary = run.summary
    found = {"n": summary["n"], "m": summary["m"], "iterations": summary["outer_iterations"], "n_A": summary["n_A"],
             "whole": whole, "memory": max(body["memory_mib"] for body in summary["bodies"].values())}
    found |= {phase: summary["seconds"][phase] for phase in PHASES}
    for what in (["pair", N], *(["plain", N, ordering] for ordering in ORDERINGS)):
        child = run_python(["-m", "mpi4py", __file__, "--measure", *map(str, what)], limit=LIMIT)
        if child.code:
            sys.exit(child.output)
        found |= json.loads(child.stdout.splitlines()[-1])
    return {name: round(value, 7) for name, value in found.items()}


def best(rows: list[Row]) -> dict[int, dict]:
    """By N: the smallest times and the largest memory of all repetitions."""
    found = {}
    for N in sorted({row["N"] for row in rows}):
        same = [row for row in rows if row["N"] == N]
        found[N] = {name: (max if "memory" in name else min)(row[name] for row in same) for name in (*KEY, *MEASURED)}
        found[N]["repetitions"] = len(same)
    return found


# Tables

def times_table(found: dict[int, dict]) -> list[str]:
    rows = [[N, f"{row['n']:,}", row["iterations"], row["n_A"], *(seconds(row[phase]) for phase in PHASES),
             seconds(row["whole"]), f"{row['memory']:.0f}"] for N, row in found.items()]
    return ["## Where the time goes", "",
            "Seconds of the slower rank; `whole` is the command from start to end, start-up of Python and MPI "
            "included. `factor` has the Schur complement, its inverse and the load's displacement, `recover` the "
            "displacement, the certificate and the stress, `estimate` the discretization error. Memory: peak of the "
            "larger rank, MiB.", "",
            *table(["N", "n", "iterations", "n_A", *PHASES, "whole", "memory"], rows)]


def ratios_table(found: dict[int, dict]) -> list[str]:
    rows = []
    for N, row in found.items():
        whole = row["pair_factor"] + row["pair_outer"]
        cells = [N, seconds(row["pair_factor"]), seconds(row["pair_outer"])]
        for ordering in ORDERINGS:
            plain = row[f"{ordering}_factor"] + row[f"{ordering}_solve"]
            cells += [f"{seconds(row[f'{ordering}_factor'])} + {seconds(row[f'{ordering}_solve'])}",
                      f"{whole / plain:.2f}", f"{row['pair_assemble'] / row[f'{ordering}_factor']:.2f}",
                      f"{row['memory'] / row[f'{ordering}_memory']:.2f}"]
        rows.append(cells)
    columns = ["plain factor + solve", "(factor + outer) / plain", "assemble / plain factor", "memory / plain"]
    return ["## Beside one plain factorization and solve of one body", "",
            "Measured in the same two processes, in both at the same time. First with the ordering that MUMPS "
            "chooses, then with the one of least fill (ICNTL(7) = 2), which is faster here; a Schur complement leaves "
            "MUMPS without METIS no choice but AMD. Aims: (factor + outer) / plain at most 2, better 1.5, at N = 86, "
            "200 and 320; outer below 0.1 s at N = 86; assemble / plain factor below 0.5 at N = 320; memory at most "
            "1.5 times; the whole command below 2 s at N = 86 and 10 s at N = 320.", "",
            *table(["N", "factor", "outer", *columns, *(f"{name}, least fill" for name in columns)], rows)]


def growth_table(found: dict[int, dict]) -> list[str]:
    fitted = {N: row for N, row in found.items() if N >= FITTED}
    if len(fitted) < 2:
        return []
    n = np.log([row["n"] for row in fitted.values()])
    names = (*PHASES, "whole", "memory", *PLAIN)
    slopes = [np.polyfit(n, np.log([row[name] for row in fitted.values()]), 1)[0] for name in names]
    return ["## Growth", "",
            f"Exponents p of seconds ~ n^p (memory ~ n^p), fitted from N = {FITTED} on; 1 is linear, 1.5 is what the "
            "operations of a sparse factorization in the plane grow with.", "",
            *table([name.replace("_", " ") for name in names], [[f"{slope:.2f}" for slope in slopes]])]


def page(rows: list[Row]) -> str:
    found, have = best(rows), versions()
    return "\n".join([
        "# What a run costs", "",
        "Generated by `scripts/study benchmark`: `configs/pinched_blocks.toml` (two blocks, Coulomb friction, default "
        "method, tolerance 1e-8) with squares of side 1/N, two ranks. The smallest time of "
        f"{min(r['repetitions'] for r in found.values())} to {max(r['repetitions'] for r in found.values())} "
        f"repetitions. {processor()}, PETSc {have['petsc']}, {have['mpi']}.", "",
        *times_table(found), "![Phases of a run over its size](figures/benchmark_phases.png)", "",
        *ratios_table(found), *growth_table(found)])


def draw_phases(found: dict[int, dict]):
    """The phases of a whole command over the number of unknowns, stacked: in seconds, and as parts; a figure."""
    import matplotlib.pyplot as plt

    n = [row["n"] for row in found.values()]
    phases = {phase: np.array([row[phase] for row in found.values()]) for phase in PHASES}
    whole = np.array([row["whole"] for row in found.values()])
    phases = {"start, checks, the rest": np.maximum(whole - sum(phases.values()), 0.0)} | phases
    figure, (seconds_axes, parts) = plt.subplots(1, 2, figsize=(10.0, 4.0))
    colours = ["#b9bec6", *plt.get_cmap("viridis")(np.linspace(0.0, 0.95, len(PHASES)))]
    seconds_axes.stackplot(n, list(phases.values()), labels=list(phases), colors=colours)
    parts.stackplot(n, [100 * each / whole for each in phases.values()], colors=colours)
    for axes, label in ((seconds_axes, "seconds of the whole command"), (parts, "per cent")):
        axes.margins(x=0)
        axes.set(xscale="log", xlabel="unknowns of both bodies", ylabel=label)
        axes.grid(False)
    parts.set_ylim(0, 100)
    figure.legend(*seconds_axes.get_legend_handles_labels(), loc="upper center", ncols=4, bbox_to_anchor=(0.5, 0.0))
    return figure


def main() -> None:
    parser = arguments(__doc__, "benchmark")
    parser.add_argument("--sizes", nargs="+", type=int, default=list(SIZES), metavar="N", help="default: %(default)s")
    parser.add_argument("--repeats", type=int, metavar="R", help="default: 2 to 5, by size")
    parser.add_argument("--measure", nargs="+", help=argparse.SUPPRESS)  # for the processes that measure
    options = parser.parse_args()
    if options.measure:
        what, N, *more = options.measure
        measure(what, int(N), *more)
        return

    ledger = Ledger(MPI.COMM_WORLD, options.output / "benchmark.csv", KEY, MEASURED)
    rows = ledger.fill([(N, k) for N in options.sizes for k in range(options.repeats or SIZES.get(N, 2))],
                       lambda N, _: repeat(N))
    text = page(rows)
    publish(PAGE, text, options.output, set(SIZES) <= {row["N"] for row in rows},
            lambda folder: save_figures(folder, {"benchmark_phases": lambda: draw_phases(best(rows))}, dpi=110))
    print(text)


if __name__ == "__main__":
    main()
