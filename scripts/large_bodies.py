"""Two large bodies: seconds and memory by phase, factors against multigrid, and what the program chooses.

    scripts/study large_bodies --millions 0.25 1 4 --solids 0.08 0.2 0.6 --ranks 2 4
    scripts/study large_bodies --millions --solids 2 --ranks 2 --kinds iterative      # two solids of a million each
    scripts/study large_bodies --millions --solids 0.1 0.2 --ranks 1 --kinds explicit iterative --order 2

The scenes are configs/pinched_blocks.toml and, in space, configs/two_boxes.toml with so many million unknowns in
all. `chosen` leaves method.compliance out. A kind that takes more than PATIENCE times as long as the chosen one is
ended. Where explicit and iterative are measured in space, the size at which both take as long follows from the last two
sizes, by a power law. Writes large_bodies.csv and large_bodies.md, and with the default sizes also to docs/tables/.
"""

import json
import math
import os
import tempfile
from pathlib import Path

from experiment import ROOT, Ledger, Row, arguments, number, publish, table, where
from mpi4py import MPI
from scenes import run_command

from ddmpi.system.agreement import LOCKSTEP

MILLIONS, SOLIDS, RANKS = (0.25, 1.0, 4.0), (0.08, 0.2, 0.6), (2, 4)
COMPLIANCES = ("chosen", "explicit", "direct", "iterative")
SPENT = ("mesh", "assemble", "factor", "outer", "recover", "estimate", "output", "total")
PEAKS = ("assemble", "factor", "outer", "output")
PATIENCE = 2.0
"""So many times the seconds of the program's own choice a kind is waited for."""

SLOWEST = 1800.0
"""Seconds after which the program's own choice is given up."""

UNKNOWN: Row = {"n": 0, "n_A": 0} | dict.fromkeys(
    (*SPENT, *(f"peak_{phase}" for phase in PEAKS), "memory", "in_all"), math.nan
)


def measure_large(
    folder: Path, scene: str, millions: float, ranks: int, kind: str, order: int, limit: float
) -> Row:
    # The two bodies have 9 N (N + 1)² unknowns, in the plane 2 (3N + 1) (N + 1).
    solid = scene == "two_boxes"
    N = round(
        ((millions * 1e6 / 18) ** (1 / 3) - 2 / 3 if solid else math.sqrt(millions * 1e6 / 12))
        / order
    )
    divisions = [3 * N, N, N] if solid else [3 * N, N]
    settings = [f"body.{name}.mesh.divisions={divisions}" for name in ("upper", "lower")]
    settings += [f"body.{name}.mesh.order={order}" for name in ("upper", "lower")]
    settings += [f"method.compliance={kind}"] if kind != "chosen" else []
    with tempfile.TemporaryDirectory(dir=folder) as place, tempfile.TemporaryDirectory() as peaks:
        os.environ |= {LOCKSTEP: str(ROOT / "tests" / "support" / "peaks.py"), "PEAKS": peaks}
        try:
            run = run_command(
                ROOT / "configs" / f"{scene}.toml",
                Path(place),
                "--no-figures",
                *(word for each in settings for word in ("--set", each)),
                ranks=ranks,
                limit=limit,
            )
        except AssertionError:
            return UNKNOWN | {"compliance": f"not done in {limit:.0f} s"}
        if run.code:
            return UNKNOWN | {"compliance": f"exit code {run.code}"}
        summary, held = (
            run.summary,
            [json.loads(path.read_text(encoding="utf-8")) for path in Path(peaks).iterdir()],
        )
    memory = [body["memory_mib"] for body in summary["bodies"].values()]
    kinds = {body["compliance"] for body in summary["bodies"].values()}
    return (
        {phase: summary["seconds"].get(phase, 0.0) for phase in SPENT}
        | {
            f"peak_{phase}": max((each.get(phase, math.nan) for each in held), default=math.nan)
            for phase in PEAKS
        }
        | {
            "n": summary["n"],
            "n_A": summary["n_A"],
            "compliance": " ".join(sorted(kinds)),
            "memory": max(memory),
            "in_all": sum(memory),
        }
    )


def crossover(rows: list[Row], ranks: int) -> str:
    """The dofs of a body at which explicit and iterative take as long, from the two sizes whose ratio of times is
    nearest to 1: ratio = c n^p."""
    pairs = [
        (one["n"] / 2, one["total"] / other["total"])
        for one in where(rows, ranks=ranks, kind="explicit")
        for other in where(rows, ranks=ranks, kind="iterative", millions=one["millions"])
        if one["total"] > 0.0 and other["total"] > 0.0
    ]
    if len(pairs) < 2:
        return ""
    (n, ratio), (m, other) = sorted(sorted(pairs, key=lambda pair: abs(math.log(pair[1])))[:2])
    power = math.log(other / ratio) / math.log(m / n)
    if power <= 0.0:
        return f"On {ranks} ranks explicit and iterative keep their ratio, {ratio:.2f}, at the sizes above."
    return (
        f"On {ranks} ranks explicit and iterative take as long at {n * ratio ** (-1 / power):,.0f} dofs a body, by "
        f"the ratios {ratio:.2f} and {other:.2f} at {n:,.0f} and {m:,.0f} dofs."
    )


def main() -> None:
    parser = arguments(__doc__, "large_bodies")
    parser.add_argument(
        "--millions",
        nargs="*",
        type=float,
        default=MILLIONS,
        help="of unknowns in all, in the plane",
    )
    parser.add_argument("--solids", nargs="*", type=float, default=SOLIDS, help="the same in space")
    parser.add_argument("--ranks", nargs="+", type=int, default=RANKS)
    parser.add_argument("--kinds", nargs="+", choices=COMPLIANCES, default=COMPLIANCES)
    parser.add_argument(
        "--order", type=int, choices=(1, 2), default=1, help="of elements; 2 has a CSV of its own"
    )
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    name = "large_bodies.csv" if options.order == 1 else "large_bodies_2.csv"
    ledger = Ledger(
        MPI.COMM_WORLD,
        options.output / name,
        ("scene", "millions", "ranks", "kind"),
        (
            "n",
            "n_A",
            "compliance",
            "memory",
            "in_all",
            *SPENT,
            *(f"peak_{phase}" for phase in PEAKS),
        ),
    )

    def run(scene: str, millions: float, ranks: int, kind: str) -> Row:
        own = where(ledger.rows, scene=scene, millions=millions, ranks=ranks, kind="chosen")
        limit = PATIENCE * own[0]["total"] + 30 if own else SLOWEST
        return measure_large(options.output, scene, millions, ranks, kind, options.order, limit)

    sizes = [("pinched_blocks", each) for each in options.millions] + [
        ("two_boxes", each) for each in options.solids
    ]
    rows = ledger.fill(
        [
            (*size, ranks, kind)
            for size in sizes
            for ranks in options.ranks
            for kind in options.kinds
        ],
        run,
    )
    tables = {}
    for scene, millions in sizes:
        for ranks in options.ranks:
            own = where(rows, scene=scene, millions=millions, ranks=ranks)
            best = min(
                (row["total"] for row in own if row["total"] == row["total"]), default=math.nan
            )
            tables[f"{scene}, {millions:g} million unknowns on {ranks} ranks"] = table(
                ("compliance", "became", "n_A", "memory", "in all", "peak", *SPENT, "total / best"),
                [
                    (
                        row["kind"],
                        row["compliance"],
                        row["n_A"] or "–",
                        *(number(row[name], ".0f") for name in ("memory", "in_all")),
                        ", ".join(number(row[f"peak_{phase}"], ".0f") for phase in PEAKS),
                        *(number(row[phase], ".2f") for phase in SPENT),
                        number(row["total"] / best, ".2f"),
                    )
                    for row in own
                ],
            )
    solids = where(rows, scene="two_boxes")
    crossovers = "\n".join(line for ranks in options.ranks if (line := crossover(solids, ranks)))
    whole = options.order == 1 and all(
        tuple(given) == default
        for given, default in (
            (options.millions, MILLIONS),
            (options.solids, SOLIDS),
            (options.ranks, RANKS),
            (options.kinds, COMPLIANCES),
        )
    )
    publish(
        "large_bodies.md",
        tables,
        options.output,
        whole,
        {r"On \d+ ranks explicit[^|]*": f"{crossovers}\n"},
    )
    print(crossovers)


if __name__ == "__main__":
    main()
