#!/usr/bin/env bash
"exec" "${0%/*}/on_two_ranks.sh" "$0" "$@"  # to Python, a string

__doc__ = """What the adaptive inner precision saves, and what it costs in reliability.

The inner solves of outer iteration k are as precise as eta times the last outer update. Runs with
several eta, and with one fixed precision, the one that eta = 0.1 would end with. Each run is repeated
with theta changed in the thirteenth digit: where k changes with it, rounding errors decide. Writes
inner_precision.csv (resumable) and inner_precision.md to the folder --output.
"""

import argparse
from pathlib import Path

from experiment import LAWS, VARIANTS, Ledger, on_two_ranks, prepare_laws, progress, variant
from mpi4py import MPI

from ddmpi.coupling.assembly import Problem
from ddmpi.errors import SolverError
from ddmpi.methods.published import OuterIteration

ETAS = (1.0, 0.3, 0.1, 0.05, 0.03, 0.02, 0.01, 0.001)
FIXED = "fixed"
REPEATS = 6
SHOWN = (("original", "none"), ("original", "step1+2"))
MOST = 200
KEY = ("N", "law", "algorithm", "splitting", "eta")
COLUMNS = (*KEY, "n_A", *(f"k_{i}" for i in range(REPEATS)))


def run_all(problem: Problem, kind: tuple[str, str], eta: float | str) -> tuple[int, list[int]]:
    """n_A of the first run, and the outer iterations of all, 0 for one that does not converge. Collective."""
    n_A, iterations = 0, []
    for repeat in range(REPEATS):
        theta = problem.scene.method.theta * (1 + repeat * 1e-13)
        method = variant(problem.scene, *kind, theta=theta, max_iterations=MOST, inner_precision=eta)
        problem.body.restart()
        outer = OuterIteration(problem.body, problem.friction, problem.exchange, method)
        try:
            converged = outer.run(method.tolerance) == "converged"
        except SolverError as error:  # the same on both ranks, or the run has to end
            if not error.agreed:
                raise
            converged = False
        iterations.append(len(outer.history) if converged else 0)
        if repeat == 0:
            n_A = sum(outer.history[-1].n_A)
    return n_A, iterations


def page(rows: list[dict], N: int) -> str:
    """The two tables, as Markdown."""
    etas = [*ETAS, FIXED]
    row_of = {(r["law"], r["algorithm"], r["splitting"], r["eta"]): r for r in rows if r["N"] == N}

    def k(row: dict) -> list[int]:
        return [row[f"k_{i}"] for i in range(REPEATS)]

    cases = [(law, *kind) for law in LAWS for kind in SHOWN]
    lines = [f"N = {N}, θ = 0.2, tolerance 1e-4. k (range over {REPEATS} runs whose θ differs in the thirteenth digit, "
             "where they differ) · n_A of the first run.", "",
             "| η | " + " | ".join(f"{law}, {a}, {'no splitting' if s == 'none' else s}" for law, a, s in cases) + " |",
             "|---" * (len(cases) + 1) + "|"]
    for eta in etas:
        cells = []
        for case in cases:
            row = row_of[(*case, eta)]
            found = k(row)
            cells.append(f"{_words(found)} · {row['n_A']}")
        lines.append(f"| {_label(eta)} | " + " | ".join(cells) + " |")
    lines += ["", "All sixteen variants together: multiplications relative to η = 0.1 (sum over the variants), in how "
              "many variants k depends on rounding errors, and by how much at most (half the range over its middle).",
              "", "| η | n_A | variants whose k depends on rounding | largest spread | runs that do not converge |",
              "|---|---|---|---|---|"]
    everything = [(law, *kind) for law in LAWS for kind in VARIANTS]
    base = sum(row_of[(*case, 0.1)]["n_A"] for case in everything)
    for eta in etas:
        ks = [k(row_of[(*case, eta)]) for case in everything]
        spread = max((max(v) - min(v)) / (max(v) + min(v)) for v in ks if min(v) > 0)
        n_A = sum(row_of[(*case, eta)]["n_A"] for case in everything)
        lines.append(f"| {_label(eta)} | {n_A / base:.2f} | {sum(max(v) > min(v) for v in ks)} of {len(ks)} "
                     f"| ±{spread:.0%} | {sum(v.count(0) for v in ks)} of {len(ks) * REPEATS} |")
    return "\n".join([*lines, ""])


def _label(eta: float | str) -> str:
    return "fixed, as η = 0.1 ends" if eta == FIXED else f"{eta:g}"


def _words(k: list[int]) -> str:
    if 0 in k:
        return f"{k.count(0)} of {len(k)} do not converge in {MOST}"
    return f"{k[0]}" + (f" ({min(k)}–{max(k)})" if max(k) > min(k) else "")


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("results/inner_precision"), metavar="DIR")
    parser.add_argument("--size", type=int, default=22, metavar="N", help="mesh (default: %(default)s)")
    options = parser.parse_args()

    ledger = Ledger(world, options.output / "inner_precision.csv", KEY, COLUMNS)
    work = [(options.size, law, *kind, eta) for law in LAWS for kind in VARIANTS for eta in (*ETAS, FIXED)
            if not ledger.find(options.size, law, *kind, eta)]
    problems = prepare_laws(world, options.size) if work else {}
    for N, law, algorithm, splitting, eta in progress(world, work, "inner precision"):
        n_A, iterations = run_all(problems[law], (algorithm, splitting), eta)
        ledger.add(dict(zip(COLUMNS, (N, law, algorithm, splitting, eta, n_A, *iterations), strict=True)))
    if world.rank == 0:
        text = page(ledger.rows, options.size)
        (options.output / "inner_precision.md").write_text(text, encoding="utf-8")
        print(text)


main()
