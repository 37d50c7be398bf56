#!/usr/bin/env bash
"exec" "${0%/*}/on_two_ranks.sh" "$0" "$@"  # to Python, a string

__doc__ = """What each TAO type costs on the QPs of a real run.

Records the QPs of role 2 (contact and friction) in a run of the original algorithm. Solves each with every
type and prints multiplications by the inverse stiffness and time; where a type fails, the page says why.
Writes qp_solvers.md and qp_solvers.csv to the folder --output.
"""

import csv
import time
from collections.abc import Callable

from experiment import LAWS, Row, arguments, on_two_ranks, pinched_blocks, publish, table, variant, where
from mpi4py import MPI
from petsc4py import PETSc

from ddmpi.coupling.assembly import Assembly, prepare
from ddmpi.errors import SolverError
from ddmpi.methods.published import PublishedIteration
from ddmpi.qp.program import QPResult
from ddmpi.qp.tao import QPSolver

TYPES = ("python", "gpcg", "tron", "bntr", "bncg", "blmvm", "bqpip")
COLUMNS = ("type", "outer_iteration", "multiplications", "seconds", "failure")


class Recorder(QPSolver):
    """Solves QPs, and keeps with what arguments `solve` was called."""

    def __init__(self) -> None:
        super().__init__()
        self.calls: list[tuple] = []

    def solve(self, *call) -> QPResult:
        self.calls.append(call)
        return super().solve(*call)


def record(assembly: Assembly) -> tuple[list[tuple], int]:
    """The QPs of this rank's body in a run, as arguments of `QPSolver.solve`, and its role. Collective."""
    method = variant(assembly.scene, "original", "none")
    outer = PublishedIteration(assembly, method)
    outer.subproblem.solver = recorder = Recorder()
    ended = outer.run(method.tolerance)
    if ended != "converged":
        raise RuntimeError(f"the run to record ended with: {ended}")
    return recorder.calls, outer.subproblem.role


def compare(assembly: Assembly, calls: list[tuple], types: list[str]) -> list[Row]:
    """Every QP by every type; making the dense matrix of bqpip is a row of its own, iteration 0."""
    rows, count = [], assembly.member.C.count

    def add(kind: str, iteration: int, action: Callable[[], object]) -> None:
        count.clear()
        start, failure = time.perf_counter(), ""
        try:
            action()
        except SolverError as error:
            failure = str(error)
        except PETSc.Error as error:
            failure = " ".join(str(error).split()[-20:])
        seconds = round(time.perf_counter() - start, 5)
        rows.append(dict(zip(COLUMNS, (kind, iteration, count.total(), seconds, failure), strict=True)))

    for kind in types:
        solver = QPSolver()
        solver.type = kind
        if kind == "bqpip":
            add(kind, 0, assembly.member.C.dense)
        for iteration, call in enumerate(calls, 1):
            add(kind, iteration, lambda call=call, solver=solver: solver.solve(*call))
    return rows


def page(rows: list[Row], N: int, law: str) -> str:
    """The table, as Markdown."""
    types = list(dict.fromkeys(row["type"] for row in rows))
    number = max(row["outer_iteration"] for row in rows)
    whole = {kind: [row for row in where(rows, type=kind) if row["outer_iteration"]] for kind in types}

    def line(k: int) -> list[str]:
        return [_cell(where(rows, type=kind, outer_iteration=k)) for kind in types]

    lines = [f"QPs of role 2, original algorithm, {law.capitalize()} friction, N = {N} ({number} QPs). "
             "Multiplications by A⁻¹ (milliseconds), each multiplication a solve with the factored stiffness; "
             "`python` is MPRGP.", "",
             *table(["outer iteration", *types], [
                 *([k, *line(k)] for k in (1, 2, 5, 10, 20, 30, 40) if k <= number),
                 [f"all {number}", *(f"**{_cell(whole[kind])}**" for kind in types)],
                 ["once, for the dense matrix", *line(0)]])]
    failed = {kind: [row for row in own if row["failure"]] for kind, own in whole.items()}
    lines += [f"- {kind} failed on {len(own)} of {number}, first: {own[0]['failure']}"
              for kind, own in failed.items() if own]
    if not any(failed.values()):
        lines.append("No type failed on any QP.")
    return "\n".join([*lines, ""])


def _cell(rows: list[Row]) -> str:
    """Sums over `rows`, or that something failed."""
    if not rows:
        return "–"
    failed = sum(bool(row["failure"]) for row in rows)
    text = f"{sum(row['multiplications'] for row in rows)} ({1e3 * sum(row['seconds'] for row in rows):.0f})"
    if failed:
        return f"failed ({text})" if len(rows) == 1 else f"{failed} failed ({text})"
    return text


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = arguments(__doc__, "qp_solvers")
    parser.add_argument("--size", type=int, default=22, metavar="N", help="mesh (default: %(default)s)")
    parser.add_argument("--law", default="coulomb", choices=LAWS)
    parser.add_argument("--types", nargs="+", default=TYPES, metavar="TYPE", help="TAO types (default: %(default)s)")
    options = parser.parse_args()

    assembly = prepare(world, pinched_blocks(options.law, options.size, "method.compliance=direct"))
    calls, role = record(assembly)
    (rows,) = filter(None, world.allgather(compare(assembly, calls, options.types) if role == 2 else None))
    if world.rank == 0:
        options.output.mkdir(parents=True, exist_ok=True)
        with open(options.output / "qp_solvers.csv", "w", newline="", encoding="utf-8") as file:
            writer = csv.DictWriter(file, COLUMNS)
            writer.writeheader()
            writer.writerows(rows)
        text = page(rows, options.size, options.law)
        publish("qp_solvers.md", text, options.output, complete=False)
        print(text)


main()
