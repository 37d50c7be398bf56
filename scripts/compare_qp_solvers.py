#!/usr/bin/env bash
"exec" "${0%/*}/on_two_ranks.sh" "$0" "$@"  # to Python, a string

__doc__ = """What each TAO type costs on the quadratic programs of a real run.

Records the programs of role 2 (contact and friction) in a run of the original algorithm: linear term,
bounds, starting point, tolerance. Solves each with every type and prints multiplications by the
inverse stiffness and time; a type that fails is shown with the reason. Writes qp_solvers.md and
qp_solvers.csv to the folder --output.
"""

import argparse
import csv
import time
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from experiment import LAWS, on_two_ranks, prepare_laws, variant
from mpi4py import MPI
from petsc4py import PETSc

from ddmpi.coupling.assembly import Problem
from ddmpi.errors import SolverError
from ddmpi.qp.program import QP
from ddmpi.qp.tao import QPSolver
from ddmpi.run.solve import solve

TYPES = ("python", "gpcg", "tron", "bntr", "bncg", "blmvm", "bqpip")
COLUMNS = ("type", "outer_iteration", "multiplications", "seconds", "problem")


@dataclass(frozen=True)
class Recorded:
    """A program with its starting point s, the product C s and the tolerance (m)."""

    qp: QP
    s: np.ndarray
    Cs: np.ndarray
    tolerance: float


@dataclass
class Recorder(QPSolver):
    """Solves, and keeps what it was given."""

    programs: list[Recorded] = field(default_factory=list)

    def __post_init__(self) -> None:
        super().__init__()

    def solve(self, qp: QP, s: np.ndarray, Cs: np.ndarray, tolerance: float, purpose: str, kept: float = 0.0):
        self.programs.append(Recorded(QP(qp.C, qp.d.copy(), qp.lower.copy(), qp.upper.copy()), s.copy(), Cs.copy(),
                                      tolerance))
        return super().solve(qp, s, Cs, tolerance, purpose, kept)


def record(problem: Problem) -> list[Recorded]:
    """The programs of this rank's body in a run. Collective."""
    problem.body.qp_solver = recorder = Recorder()
    solve(problem, variant(problem.scene, "original", "none"))
    return recorder.programs


def compare(problem: Problem, programs: list[Recorded], types: list[str]) -> list[dict]:
    """Every program by every type; the dense matrix of bqpip is a line of its own, iteration 0."""
    rows, count = [], problem.body.C.count

    def add(kind: str, iteration: int, action) -> None:
        count.clear()
        start, trouble = time.perf_counter(), ""
        try:
            action()
        except SolverError as error:
            trouble = str(error)
        except PETSc.Error as error:
            trouble = " ".join(str(error).split()[-20:])
        rows.append(dict(zip(COLUMNS, (kind, iteration, count.total(), round(time.perf_counter() - start, 5), trouble),
                             strict=True)))

    for kind in types:
        solver = QPSolver()
        solver.type = kind
        if kind == "bqpip":
            add(kind, 0, problem.body.C.dense)
        for iteration, p in enumerate(programs, 1):
            add(kind, iteration, lambda p=p, solver=solver: solver.solve(p.qp, p.s, p.Cs, p.tolerance, "program"))
    return rows


def page(rows: list[dict], shown: list[int], N: int, law: str) -> str:
    """The table, as Markdown."""
    types = list(dict.fromkeys(row["type"] for row in rows))
    number = max(row["outer_iteration"] for row in rows)
    lines = [f"Programs of role 2, original algorithm, {law.capitalize()} friction, N = {N} ({number} programs). "
             "Multiplications by A⁻¹ (milliseconds), each multiplication a solve with the factored stiffness; "
             "`python` is MPRGP.", "",
             "| outer iteration | " + " | ".join(types) + " |", "|---" * (len(types) + 1) + "|"]
    at = {(row["type"], row["outer_iteration"]): row for row in rows}
    lines += [f"| {k} | " + " | ".join(_cell([at[kind, k]]) for kind in types) + " |" for k in shown]
    whole = {kind: [at[kind, k] for k in range(1, number + 1)] for kind in types}
    lines.append(f"| all {number} | " + " | ".join(f"**{_cell(whole[kind])}**" for kind in types) + " |")
    once = [_cell([at[kind, 0]]) if (kind, 0) in at else "–" for kind in types]
    lines.append("| once, for the dense matrix | " + " | ".join(once) + " |")
    lost = {kind: [row for row in whole[kind] if row["problem"]] for kind in types}
    lines += ["", *(f"- {kind} failed on {len(own)} of {number}, first: {own[0]['problem']}"
                    for kind, own in lost.items() if own)]
    if not any(lost.values()):
        lines.append("No type failed on any program.")
    return "\n".join([*lines, ""])


def _cell(rows: list[dict]) -> str:
    """Sums over `rows`, or that something failed."""
    failed = sum(bool(row["problem"]) for row in rows)
    text = f"{sum(row['multiplications'] for row in rows)} ({1e3 * sum(row['seconds'] for row in rows):.0f})"
    if failed:
        return f"failed ({text})" if len(rows) == 1 else f"{failed} failed ({text})"
    return text


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("results/qp_solvers"), metavar="DIR")
    parser.add_argument("--size", type=int, default=22, metavar="N", help="mesh (default: %(default)s)")
    parser.add_argument("--law", default="coulomb", choices=LAWS)
    parser.add_argument("--types", nargs="+", default=TYPES, metavar="TYPE", help="TAO types (default: %(default)s)")
    options = parser.parse_args()

    problem = prepare_laws(world, options.size, [options.law], ["method.compliance=direct"])[options.law]
    programs = record(problem)
    rows = world.bcast(compare(problem, programs, options.types) if problem.body.role == 2 else None,
                       problem.order[1])
    if world.rank == 0:
        options.output.mkdir(parents=True, exist_ok=True)
        with open(options.output / "qp_solvers.csv", "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)
        shown = [k for k in (1, 2, 5, 10, 20, 30, 40) if k <= len(programs)]
        text = page(rows, shown, options.size, options.law)
        (options.output / "qp_solvers.md").write_text(text, encoding="utf-8")
        print(text)


main()
