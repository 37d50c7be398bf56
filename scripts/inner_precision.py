#!/usr/bin/env bash
"exec" "${0%/*}/on_two_ranks.sh" "$0" "$@"  # to Python, a string

__doc__ = """What the adaptive inner precision saves, and what it costs in reliability.

The inner solves of outer iteration k are as precise as eta times the last outer update. Runs with several eta,
and with one fixed precision, which eta = 0.1 would reach at the end. Each run is repeated with theta changed in
the thirteenth digit: where k changes with it, rounding errors decide. Writes inner_precision.csv (a line per
case, written at once, so that an interrupted study continues) and inner_precision.md to the folder --output.
"""

from experiment import (
    LAWS,
    VARIANTS,
    Ledger,
    Row,
    arguments,
    on_two_ranks,
    one_mesh,
    publish,
    table,
    variant,
    where,
)
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly
from ddmpi.errors import SolverError
from ddmpi.methods.published import PublishedIteration

FIXED = "fixed"
ETAS = (1.0, 0.3, 0.1, 0.05, 0.03, 0.02, 0.01, 0.001, FIXED)
USUAL = 0.1
"""The program's default, with which the others are compared."""

REPEATS = 6
SHOWN = (("original", "none"), ("original", "step1+2"))
MOST = 200
KEY = ("N", "law", "algorithm", "splitting", "eta")


def run_all(assembly: Assembly, algorithm: str, splitting: str, eta: float | str, repeats: int) -> Row:
    """n_A of the first run, and the outer iterations of all, 0 for one that does not converge. Collective."""
    row = {}
    for repeat in range(repeats):
        theta = assembly.scene.method.theta * (1 + repeat * 1e-13)
        method = variant(assembly.scene, algorithm, splitting, theta=theta, max_iterations=MOST, inner_precision=eta)
        assembly.member.restart()
        outer = PublishedIteration(assembly, method)
        try:
            converged = outer.run(method.tolerance) == "converged"
        except SolverError as error:  # the same on both ranks, or the study has to end
            if not error.agreed:
                raise
            converged = False
        row[f"k_{repeat}"] = len(outer.history) if converged else 0
        if repeat == 0:
            row["n_A"] = outer.history[-1].n_A
    return row


def page(rows: list[Row], N: int) -> str:
    """The two tables, as Markdown."""
    rows = where(rows, N=N)
    etas = [eta for eta in ETAS if where(rows, eta=eta)]
    shown = [(law, *kind) for law in LAWS if where(rows, law=law) for kind in SHOWN]
    repeats = len(_iterations(rows[0]))

    def cell(eta: float | str, law: str, algorithm: str, splitting: str) -> str:
        (row,) = where(rows, eta=eta, law=law, algorithm=algorithm, splitting=splitting)
        return f"{_words(_iterations(row))} · {row['n_A']}"

    def together(eta: float | str) -> list[str]:
        own = where(rows, eta=eta)
        ks = [_iterations(row) for row in own]
        cost, base = (sum(row["n_A"] for row in some) for some in (own, where(rows, eta=USUAL)))
        spread = max((max(k) - min(k)) / (max(k) + min(k)) for k in ks if min(k) > 0)
        return [_label(eta), f"{cost / base:.2f}", f"{sum(max(k) > min(k) for k in ks)} of {len(ks)}",
                f"±{spread:.0%}", f"{sum(k.count(0) for k in ks)} of {len(ks) * repeats}"]

    header = [f"{law}, {a}, {'no splitting' if s == 'none' else s}" for law, a, s in shown]
    return "\n".join([
        f"N = {N}, θ = 0.2, tolerance 1e-4. k (range over {repeats} runs whose θ differs in the thirteenth digit, "
        "where they differ) · n_A of the first run.", "",
        *table(["η", *header], ([_label(eta), *(cell(eta, *case) for case in shown)] for eta in etas)),
        "All variants together: multiplications relative to η = 0.1 (sum over the variants), in how "
        "many variants k depends on rounding errors, and by how much at most (half the range over its middle).", "",
        *table(["η", "n_A", "variants whose k depends on rounding", "largest spread", "runs that do not converge"],
               map(together, etas))])


def _iterations(row: Row) -> list[int]:
    return [value for name, value in row.items() if name.startswith("k_")]


def _label(eta: float | str) -> str:
    return "fixed, as η = 0.1 ends" if eta == FIXED else f"{eta:g}"


def _words(k: list[int]) -> str:
    if 0 in k:
        return f"{k.count(0)} of {len(k)} do not converge in {MOST}"
    return f"{k[0]}" + (f" ({min(k)}–{max(k)})" if max(k) > min(k) else "")


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = arguments(__doc__, "inner_precision")
    parser.add_argument("--size", type=int, default=22, metavar="N", help="mesh (default: %(default)s)")
    parser.add_argument("--laws", nargs="+", default=LAWS, choices=LAWS, metavar="LAW")
    parser.add_argument("--etas", nargs="+", default=ETAS, metavar="ETA", type=lambda eta: eta if eta == FIXED else
                        float(eta), help=f"{USUAL} is solved in any case (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=REPEATS, metavar="R", help="default: %(default)s")
    options = parser.parse_args()

    assembly = one_mesh(world, options.laws)
    measured = "n_A", *(f"k_{i}" for i in range(options.repeats))
    rows = Ledger(world, options.output / "inner_precision.csv", KEY, measured).fill(
        [(options.size, law, *kind, eta) for law in options.laws for kind in VARIANTS for eta in ETAS
         if eta in (USUAL, *options.etas)],
        lambda N, law, *case: run_all(assembly(law, N), *case, options.repeats))
    if world.rank == 0:
        text = page(rows, options.size)
        publish("inner_precision.md", text, options.output, complete=False)
        print(text)


main()
