#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""The default method at the extremes of material, friction, shape, size and load, and what it costs.

Two tables: in the plane, variations of configs/pinched_blocks.toml; in space, of two boxes, of loose boxes on a plane
and of a ball. All at tolerance 1e-8.

Writes to the folder --output: a CSV file per table (a line per run, written at once, so that an interrupted study
continues), robustness_table.md and, for space, extremes_in_space.md; each is also written to docs/tables/.
"""

import functools
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, number, on_two_ranks, publish, table
from extremes_in_space import SOLIDS, Scene, attempt_solid, changed, solid_cases
from mpi4py import MPI
from scenes import everywhere, exact_forces

import ddmpi
from ddmpi.errors import DdmpiError
from ddmpi.run.answer import Answer
from ddmpi.system.agreement import merged

SCENE = ROOT / "configs" / "pinched_blocks.toml"
YOUNG, PRESSED, PULLED, LIFTED = 2.119e11, (0.0, -6.0e7), (2.0e7, 3.0e7), (0.0, 4.0e7)
"""Material and loads of that scene (Pa)."""

LARGEST_COUPLED = 500
"""Most contact unknowns with which the coupled problem is solved by brute force as well."""

EXTREMES = ("n", "m", "outcome", "iterations", "n_A", "residual", "distance", "seconds")
KINDS = {
    (pairs, order): f"{'nodes match' if pairs else 'mortar'}, order {order}"
    for order in (1, 2)
    for pairs in (True, False)
}
"""In space: whether the nodes of both bodies match, and the order of the elements."""

Overrides = dict[str, Any]
"""Changes of the scene, by key, as for `ddmpi.solve`."""


# Variations of the scene


def divisions(nx: int, ny: int) -> Overrides:
    return {f"body.{name}.mesh.divisions": [nx, ny] for name in ("upper", "lower")}


def squares(N: int) -> Overrides:
    """Squares of side 1/N."""
    return divisions(3 * N, N)


def material(
    upper: float = 1.0, lower: float = 1.0, poisson: tuple[float, float] = (0.277, 0.277)
) -> Overrides:
    return {
        f"body.{name}.material": {"young": YOUNG * factor, "poisson": nu}
        for name, factor, nu in (("upper", upper, poisson[0]), ("lower", lower, poisson[1]))
    }


def loads(upper: dict, lower: dict) -> Overrides:
    return {
        f"body.{name}.traction": [{"on": on, "value": value} for on, value in tractions.items()]
        for name, tractions in (("upper", upper), ("lower", lower))
    }


def coulomb(coefficient: float | dict) -> Overrides:
    return {"contact.0.friction": {"law": "coulomb", "coefficient": coefficient}}


def tresca(bound: float | dict) -> Overrides:
    return {"contact.0.friction": {"law": "tresca", "slip_bound": bound}}


NO_FRICTION = {"contact.0.friction": {"law": "none"}}


def size(width: float, height: float) -> Overrides:
    return {
        f"body.{name}.mesh.{key}": [x, y]
        for name, bottom in (("upper", height), ("lower", 0.0))
        for key, x, y in (("origin", 0.0, bottom), ("size", width, height))
    }


def jump(low: float, high: float) -> dict:
    """A profile with a jump in the middle of the contact."""
    return {"along": "x", "points": [1.5, 1.5], "values": [low, high]}


OTHER_ORDER = {"contact.0.bodies": ["lower", "upper"], "contact.0.on": ["top", "bottom"]}
TOP, RIGHT, BOTTOM = {"top": PRESSED}, {"right": PULLED}, {"bottom": LIFTED}
APART = loads({"top": (0.0, 6e7)}, {"bottom": (0.0, -6e7)})
CORNER = {"body.lower.mesh.origin": [0.0, -0.005]} | loads({"right": (0.0, -1e8)}, {})


def cases() -> dict[tuple[str, str], Overrides]:
    """The table of extremes, by (group, case)."""
    found = [("the scene as it is", "N = 22", {})]
    found += [
        (
            "stiffness",
            f"E₁/E₂ = {factor:g}{', the lower body in role 1' if swapped else ''}",
            material(upper=factor) | swapped,
        )
        for factor in (1e-6, 1e-3, 1e3, 1e6)
        for swapped in ({}, OTHER_ORDER)
    ]
    found += [("Coulomb", f"𝓕 = {F:g}", coulomb(F)) for F in (0.0, 1e-6, 0.05, 0.3, 1.0, 3.0, 10.0)]
    found += [
        ("Coulomb", f"𝓕 = {F:g}, N = {N}", coulomb(F) | squares(N))
        for F in (0.1, 10.0)
        for N in (38, 54)
    ]
    found += [
        ("Coulomb", f"𝓕 jumps from {low:g} to {high:g}", coulomb(jump(low, high)))
        for low, high in ((0.0, 1.0), (10.0, 0.01))
    ]
    found += [("Tresca", f"g = {g:g} Pa", tresca(g)) for g in (0.0, 1e3, 1e6, 1.2e7, 1e20)]
    found += [
        ("Tresca", "g jumps from 1e5 to 3e7 Pa", tresca(jump(1e5, 3e7))),
        ("no friction", "", NO_FRICTION),
    ]
    found += [
        ("Poisson's ratios", f"{a:g} and {b:g}", material(poisson=(a, b)))
        for a, b in ((0.0, 0.0), (0.49, 0.49), (0.4999, 0.4999), (0.0, 0.4999), (-0.9, 0.4))
    ]
    found += [
        ("triangles", f"{3 / nx:.3g} m × {1 / ny:.3g} m", divisions(nx, ny))
        for nx, ny in ((66, 1), (300, 3), (3000, 1), (3, 300), (3, 1000))
    ]
    found += [
        ("slender bodies", f"3 m × {height:g} m", size(3.0, height) | divisions(66, 6))
        for height in (0.3, 0.03, 0.003)
    ]
    found += [
        ("contact nodes", "one", divisions(1, 1)),
        ("contact nodes", "three thousand", divisions(3000, 8)),
    ]
    found += [
        ("size of the bodies", f"{width:g} m", size(width, width / 3)) for width in (1e-9, 1e6)
    ]
    found += [
        (
            "unit of force",
            f"{1 / f:g} N",
            material(f, f)
            | loads(
                {"top": [f * q for q in PRESSED], "right": [f * q for q in PULLED]},
                {"bottom": [f * q for q in LIFTED]},
            ),
        )
        for f in (1e-9, 1e9)
    ]
    loaded = {
        "lifted apart": APART,
        "none": loads({}, {}),
        "on the upper body only": loads(TOP | RIGHT, {}),
        "on the lower body only": loads({}, BOTTOM),
        "contact at a corner only": CORNER,
    }
    found += [
        ("loads", f"{case}, {law}", changes | friction)
        for case, changes in loaded.items()
        for law, friction in (("Coulomb", coulomb(0.3)), ("Tresca", tresca(1.2e7)))
    ]
    found += [
        ("unsupported", "no clamp", {"body.upper.clamp": []}),
        ("unsupported", "free along x", {"body.upper.clamp": [{"on": "left", "y": 0}]}),
    ]
    return {(group, case): changes for group, case, changes in found}


# Runs


def attempt(world: MPI.Comm, changes: Overrides) -> Row:
    """Solve a variation of the scene. Collective.

    ``outcome`` is "certified" or the reason why not, ``distance`` that of the contact forces from those of the coupled
    problem, where that is small enough.
    """
    start = time.perf_counter()
    row = dict.fromkeys(EXTREMES, np.nan) | {"n": 0, "m": 0, "iterations": 0, "n_A": 0}
    try:
        answer = ddmpi.solve(SCENE.read_text(encoding="utf-8"), world, changes)
        summary, assembly = answer.summary, answer.solved.assembly
        row |= {
            "outcome": "certified" if answer.certified else answer.reason,
            "n": summary["n"],
            "m": summary["m"],
            "iterations": summary["outer_iterations"],
            "n_A": summary["n_A"],
            "residual": max(
                residual for residual, _ in answer.solved.solution.certificate.worst().values()
            ),
        }
        if (
            not assembly.loose and world.allreduce(assembly.space.size) <= LARGEST_COUPLED
        ):  # brute force
            row["distance"] = distance(answer)
    except DdmpiError as error:
        row["outcome"] = f"refused: {str(error).splitlines()[0].removeprefix('scene: ')}"
    return row | {"seconds": round(world.allreduce(time.perf_counter() - start, MPI.MAX), 2)}


def distance(answer: Answer) -> float:
    """Of the contact forces from those of the coupled problem, relatively; nan if brute force fails. Collective."""
    assembly = answer.solved.assembly
    try:
        exact = exact_forces(assembly)
    except AssertionError:  # on all ranks
        return np.nan
    forces = everywhere(assembly, answer.solved.solution.outer.forces)
    return float(np.linalg.norm(forces - exact) / (np.linalg.norm(exact) or 1.0))


# Tables


def extremes_page(rows: list[Row], folder: Path) -> None:
    done = [row for row in rows if row["outcome"] == "certified"]
    refused = sum(row["outcome"].startswith("refused") for row in rows)
    distances = [row["distance"] for row in done if np.isfinite(row["distance"])]
    body = []
    for row in rows:
        outcome = "yes" if row["outcome"] == "certified" else row["outcome"]
        cells = [
            row["m"],
            outcome,
            row["iterations"],
            row["n_A"],
            number(row["residual"]),
            number(row["distance"]),
        ]
        if not row["m"]:
            cells = ["–", outcome, "–", "–", "–", "–"]
        body.append([row["group"], row["case"], *cells, f"{row['seconds']:.1f}"])
    header = ["what", "case", "m", "certified", "iterations", "n_A", "residual", "distance", "s"]
    publish(
        "robustness_table.md",
        {"The extremes": table(header, body)},
        folder,
        facts={
            r"\d+ scenes: .* not converged": f"{len(rows)} scenes: {len(done)} certified, {refused} refused, "
            f"{len(rows) - len(done) - refused} not converged",
            r"\(\d+ scenes, at most [^)]*": f"({len(distances)} scenes, at most {number(max(distances, default=np.nan))}",
        },
    )


def solids_page(rows: list[Row], folder: Path) -> None:
    at: dict[tuple[str, str], dict[str, Row]] = {}
    for row in rows:
        at.setdefault((row["group"], row["case"]), {})[row["kind"]] = row
    said = list(dict.fromkeys(row["outcome"] for row in rows if row["outcome"] != "certified"))

    def cell(row: Row) -> str:
        return (
            f"{row['iterations']} · {row['n_A']}"
            if row["outcome"] == "certified"
            else f"({said.index(row['outcome']) + 1})"
        )

    def worst(some: dict[str, Row], key: str) -> str:
        return number(
            max((row[key] for row in some.values() if np.isfinite(row[key])), default=np.nan)
        )

    kinds, keys = list(KINDS.values()), ("residual", "violation", "differs")
    body = [
        [
            group,
            case,
            *(cell(some[kind]) if kind in some else "–" for kind in kinds),
            *(worst(some, key) for key in keys),
        ]
        for (group, case), some in at.items()
    ]
    done = [row for row in rows if row["outcome"] == "certified"]
    checked = [row["violation"] for row in done if np.isfinite(row["violation"])]
    publish(
        "extremes_in_space.md",
        {
            "": [
                *table(["what", "case", *kinds, *keys], body),
                *table(["", "message"], enumerate(said, 1)),
            ]
        },
        folder,
        facts={
            r"\d+ scenes: \d+ certified": f"{len(rows)} scenes: {len(done)} certified",
            r"\(\d+ scenes, at most [^)]*": f"({len(checked)} scenes, at most {number(max(checked, default=np.nan))}",
        },
    )


# All of it


def extremes(world: MPI.Comm, folder: Path) -> list[Row]:
    changes = cases()
    ledger = Ledger(world, folder / "extremes.csv", ("group", "case"), EXTREMES)
    return ledger.fill(changes, lambda *key: attempt(world, changes[key]))


def solids(world: MPI.Comm, folder: Path) -> list[Row]:
    ledger, made = (
        Ledger(world, folder / "solids.csv", ("group", "case", "kind"), SOLIDS),
        solid_cases(),
    )
    found: dict[tuple, Row] = {}

    @functools.cache
    def unchanged(make: Callable[..., Scene], which: tuple[bool, int]) -> np.ndarray | None:
        return attempt_solid(make(*which), None, None)[1]

    def solve(group: str, case: str, which: tuple[bool, int]) -> Row:
        make, changes, factor = made[group, case]
        return attempt_solid(
            changed(make(*which), changes), unchanged(make, which) if factor else None, factor
        )[0]

    def measure(group: str, case: str, kind: str) -> Row:
        if (group, case, kind) not in found:  # each rank solves some kinds of a case alone
            own = {
                (group, case, KINDS[which]): solve(group, case, which)
                for which in list(KINDS)[world.rank :: world.size]
            }
            found.update(merged(world, own))
        return found[group, case, kind]

    return ledger.fill([(*key, kind) for key in made for kind in KINDS.values()], measure)


PAGES = {"extremes": (extremes, extremes_page), "solids": (solids, solids_page)}


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = arguments(__doc__, "extremes")
    parser.add_argument(
        "--tables",
        nargs="+",
        default=list(PAGES),
        choices=PAGES,
        metavar="TABLE",
        help="which of %(choices)s (default: all)",
    )
    options = parser.parse_args()
    for measure, page in (PAGES[each] for each in options.tables):
        rows = measure(world, options.output)
        if world.rank == 0:
            page(rows, options.output)


if __name__ == "__main__":
    main()
