#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""The default method at the extremes, and what it costs.

Four tables: the extremes of material, friction, shape, size and load; multiplications by the inverse
stiffness over meshes and stiffness contrasts; the default method against the other two; what the elements
do in nearly incompressible material. All on variations of configs/pinched_blocks.toml, at
tolerance 1e-8.

Writes to the folder --output: a CSV file per table (a line per run, written at once, so that an interrupted
study continues) and robustness_table.md; once all tables are done, the page is also written to docs/tables/.
"""

import time
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, on_two_ranks, publish, table
from mpi4py import MPI
from scenes import everywhere, exact_forces

import ddmpi
from ddmpi.errors import DdmpiError, NotConvergedError
from ddmpi.run.answer import Answer

SCENE = ROOT / "configs" / "pinched_blocks.toml"
PAGE = "robustness_table.md"
YOUNG, PRESSED, PULLED, LIFTED = 2.119e11, (0.0, -6.0e7), (2.0e7, 3.0e7), (0.0, 4.0e7)
"""Material and loads of that scene (Pa)."""

LARGEST_COUPLED = 500
"""Most contact unknowns with which the coupled problem is solved by brute force as well."""

MESHES, CONTRASTS = (22, 54, 86), (1e-4, 1e-2, 1.0, 1e2, 1e4)
PURPOSES = ("load", "norm", "newton", "approximation", "displacement")
METHODS = ("newton", "anderson", "relaxation")
POISSONS, LOCKING_MESHES = (0.277, 0.49, 0.499, 0.4999), {1: (11, 22, 44, 88), 2: (11, 22, 44)}
FINEST = 88

EXTREMES = ("n", "m", "outcome", "iterations", "n_A", "residual", "distance", "seconds")
NUMBERS = ("certified", "iterations", "n_A", "dirichlet", "seconds",
           *(f"{body}_{purpose}" for body in ("upper", "lower") for purpose in PURPOSES))
COMPARISON = ("outcome", "iterations", "n_A", "seconds")
LOCKING = ("outcome", "iterations", "n_A", "energy", "tangential_force", "corner_x")

Overrides = dict[str, Any]
"""Changes of the scene, by key, as for `ddmpi.solve`."""


# Variations of the scene

def divisions(nx: int, ny: int) -> Overrides:
    return {f"body.{name}.mesh.divisions": [nx, ny] for name in ("upper", "lower")}


def squares(N: int) -> Overrides:
    """Squares of side 1/N."""
    return divisions(3 * N, N)


def material(upper: float = 1.0, lower: float = 1.0, poisson: tuple[float, float] = (0.277, 0.277)) -> Overrides:
    return {f"body.{name}.material": {"young": YOUNG * factor, "poisson": nu}
            for name, factor, nu in (("upper", upper, poisson[0]), ("lower", lower, poisson[1]))}


def loads(upper: dict, lower: dict) -> Overrides:
    return {f"body.{name}.traction": [{"on": on, "value": value} for on, value in tractions.items()]
            for name, tractions in (("upper", upper), ("lower", lower))}


def coulomb(coefficient: float | dict) -> Overrides:
    return {"contact.0.friction": {"law": "coulomb", "coefficient": coefficient}}


def tresca(bound: float | dict) -> Overrides:
    return {"contact.0.friction": {"law": "tresca", "slip_bound": bound}}


NO_FRICTION = {"contact.0.friction": {"law": "none"}}


def size(width: float, height: float) -> Overrides:
    return {f"body.{name}.mesh.{key}": [x, y] for name, bottom in (("upper", height), ("lower", 0.0))
            for key, x, y in (("origin", 0.0, bottom), ("size", width, height))}


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
    found += [("stiffness", f"E₁/E₂ = {factor:g}{', the lower body in role 1' if swapped else ''}",
               material(upper=factor) | swapped)
              for factor in (1e-6, 1e-3, 1e3, 1e6) for swapped in ({}, OTHER_ORDER)]
    found += [("Coulomb", f"𝓕 = {F:g}", coulomb(F)) for F in (0.0, 1e-6, 0.05, 0.3, 1.0, 3.0, 10.0)]
    found += [("Coulomb", f"𝓕 = {F:g}, N = {N}", coulomb(F) | squares(N))
              for F in (0.1, 10.0) for N in (38, 54)]
    found += [("Coulomb", f"𝓕 jumps from {low:g} to {high:g}", coulomb(jump(low, high)))
              for low, high in ((0.0, 1.0), (10.0, 0.01))]
    found += [("Tresca", f"g = {g:g} Pa", tresca(g)) for g in (0.0, 1e3, 1e6, 1.2e7, 1e20)]
    found += [("Tresca", "g jumps from 1e5 to 3e7 Pa", tresca(jump(1e5, 3e7))), ("no friction", "", NO_FRICTION)]
    found += [("Poisson's ratios", f"{a:g} and {b:g}", material(poisson=(a, b)))
              for a, b in ((0.0, 0.0), (0.49, 0.49), (0.4999, 0.4999), (0.0, 0.4999), (-0.9, 0.4))]
    found += [("triangles", f"{3 / nx:.3g} m × {1 / ny:.3g} m", divisions(nx, ny))
              for nx, ny in ((66, 1), (300, 3), (3000, 1), (3, 300), (3, 1000))]
    found += [("slender bodies", f"3 m × {height:g} m", size(3.0, height) | divisions(66, 6))
              for height in (0.3, 0.03, 0.003)]
    found += [("contact nodes", "one", divisions(1, 1)), ("contact nodes", "three thousand", divisions(3000, 8))]
    found += [("size of the bodies", f"{width:g} m", size(width, width / 3)) for width in (1e-9, 1e6)]
    found += [("unit of force", f"{1 / f:g} N", material(f, f) | loads(
        {"top": [f * q for q in PRESSED], "right": [f * q for q in PULLED]}, {"bottom": [f * q for q in LIFTED]}))
        for f in (1e-9, 1e9)]
    loaded = {"lifted apart": APART, "none": loads({}, {}), "on the upper body only": loads(TOP | RIGHT, {}),
              "on the lower body only": loads({}, BOTTOM), "contact at a corner only": CORNER}
    found += [("loads", f"{case}, {law}", changes | friction) for case, changes in loaded.items()
              for law, friction in (("Coulomb", coulomb(0.3)), ("Tresca", tresca(1.2e7)))]
    found += [("not held", "no clamp", {"body.upper.clamp": []}),
              ("not held", "free along x", {"body.upper.clamp": [{"on": "left", "y": 0}]})]
    return {(group, case): changes for group, case, changes in found}


def comparison_cases() -> dict[str, Overrides]:
    """The cases on which the methods are compared."""
    found = [("the scene as it is", {}), ("Tresca", tresca(1.2e7)), ("no friction", NO_FRICTION)]
    found += [(f"E₁/E₂ = {c:g}", material(upper=c)) for c in (1e-4, 0.1, 10.0, 1e4)]
    found += [(f"𝓕 = {F:g}", coulomb(F)) for F in (0.05, 1.0, 3.0)]
    found += [("Poisson's ratio 0.4999", material(poisson=(0.4999, 0.4999))),
              ("slender, 3 m × 0.3 m", size(3.0, 0.3) | divisions(66, 6)),
              ("load on the upper body only", loads(TOP | RIGHT, {})), ("contact at a corner only", CORNER)]
    return dict(found)


# Runs

def attempt(world: MPI.Comm, changes: Overrides, compare: bool = False) -> Row:
    """Solve a variation of the scene. Collective.

    Returns a row with the columns of all tables. ``outcome`` is "certified" or the reason why not, ``energy`` the
    strain energy of both bodies (J per metre of depth), ``corner_x`` the displacement along x (m) of the upper body's
    upper right corner. With `compare`, ``distance`` is that of the contact forces from those of the coupled problem.
    """
    start = time.perf_counter()
    row = dict.fromkeys((*EXTREMES, *NUMBERS, *LOCKING), np.nan)
    row |= {"certified": False, "n": 0, "m": 0, "iterations": 0, "n_A": 0}
    try:
        answer = ddmpi.solve(SCENE.read_text(encoding="utf-8"), world, changes)
        row |= describe(world, answer)
        assembly = answer.solved.assembly  # brute force is for held bodies
        if compare and not assembly.loose and world.allreduce(assembly.space.size) <= LARGEST_COUPLED:
            row["distance"] = distance(answer)
    except DdmpiError as error:
        row["outcome"] = f"refused: {str(error).splitlines()[0].removeprefix('scene: ')}"
    return row | {"seconds": round(world.allreduce(time.perf_counter() - start, MPI.MAX), 2)}


def describe(world: MPI.Comm, answer: Answer) -> Row:
    """The entries of a row for a run that came to its end. Collective."""
    summary, own = answer.summary, next(iter(answer.bodies.values()))
    corner = own.displacement[np.argmax(own.points.sum(axis=1)), 0]
    counts = {f"{name}_{purpose}": body["n_A_by_purpose"].get(purpose, 0)
              for name, body in summary["bodies"].items() for purpose in PURPOSES}
    return counts | {
        "outcome": "certified" if answer.certified else answer.reason, "certified": answer.certified,
        "n": summary["n"], "m": summary["m"], "iterations": summary["outer_iterations"], "n_A": summary["n_A"],
        "dirichlet": summary["n_A"] - sum(counts.values()),  # nothing else is counted, so nothing else is solved
        "residual": max(residual for residual, _ in answer.solved.solution.certificate.worst().values()),
        "energy": sum(body["energy"] for body in summary["bodies"].values()),
        "tangential_force": sum(contact["tangential_force"] for contact in summary["contacts"].values()),
        "corner_x": world.bcast(float(corner))}


def distance(answer: Answer) -> float:
    """Of the contact forces from those of the coupled problem, relatively; nan if brute force fails. Collective."""
    assembly = answer.solved.assembly
    try:
        exact = exact_forces(assembly)
    except NotConvergedError:
        return np.nan
    forces = everywhere(assembly, answer.solved.solution.outer.forces)
    return float(np.linalg.norm(forces - exact) / (np.linalg.norm(exact) or 1.0))


# Tables

def number(value: float, form: str = ".0e") -> str:
    return "–" if not np.isfinite(value) else "0" if value == 0 else format(value, form)


def extremes_table(rows: list[Row]) -> list[str]:
    done = [row for row in rows if row["outcome"] == "certified"]
    refused = sum(row["outcome"].startswith("refused") for row in rows)
    distances = [row["distance"] for row in done if np.isfinite(row["distance"])]
    body = []
    for row in rows:
        outcome = "yes" if row["outcome"] == "certified" else row["outcome"]
        cells = [row["m"], outcome, row["iterations"], row["n_A"], number(row["residual"]), number(row["distance"])]
        if not row["m"]:
            cells = ["–", outcome, "–", "–", "–", "–"]
        body.append([row["group"], row["case"], *cells, f"{row['seconds']:.1f}"])
    return ["## The extremes", "",
            f"{len(rows)} scenes: {len(done)} certified, {refused} refused, {len(rows) - len(done) - refused} not "
            "converged. Residual: the largest of the certificate. Distance: of the contact forces from those of the "
            f"coupled problem, relatively, where that was solved ({len(distances)} scenes, at most "
            f"{number(max(distances, default=np.nan))}).", "",
            *table(["what", "case", "m", "certified", "iterations", "n_A", "residual", "distance", "s"], body)]


def numbers_table(rows: list[Row]) -> list[str]:
    at = {(row["contrast"], row["N"]): row for row in rows}
    contrasts, meshes = sorted({c for c, _ in at}), sorted({N for _, N in at})
    body, spreads = [], {}
    for c in contrasts:
        own = [at[c, N] for N in meshes if (c, N) in at]
        n_A = [row["n_A"] for row in own]
        spreads[c] = (max(n_A) - min(n_A)) / (max(n_A) + min(n_A))
        cells = [f"{row['iterations']} · {row['n_A']}{'' if row['certified'] else ' (not certified)'}" for row in own]
        body.append([f"{c:g}", *cells, f"±{spreads[c]:.0%}"])
    columns = [[at[c, N]["n_A"] for c in contrasts if (c, N) in at] for N in meshes]
    factors = [max(column) / min(column) for column in columns]
    body.append(["factor over the contrasts", *(f"{factor:.2f}" for factor in factors), ""])
    purposes = [[f"{row['contrast']:g}", row["N"], *(f"{row[f'upper_{p}']} + {row[f'lower_{p}']}" for p in PURPOSES),
                 row["dirichlet"], f"{row['seconds']:.1f}"] for _, row in sorted(at.items())]
    return ["## Multiplications over meshes and stiffness contrasts", "",
            "Pinched blocks with Coulomb friction, matrix-free: every multiplication is a solve with A of one body. "
            "Dirichlet solves: none, the preconditioner is a formula. In each cell: iterations · n_A.", "",
            *table(["E₁/E₂", *(f"N = {N}" for N in meshes), "over the meshes"], body),
            f"Most: {max(row['n_A'] for row in rows)}. Over the meshes at equal stiffness "
            f"±{spreads.get(1.0, np.nan):.0%}, at other contrasts at most ±{max(spreads.values()):.0%}; over the "
            f"contrasts at most a factor {max(factors):.2f}.", "", "What they were for, upper + lower body:", "",
            *table(["E₁/E₂", "N", *PURPOSES, "Dirichlet", "s"], purposes)]


def comparison_table(rows: list[Row]) -> list[str]:
    at = {(row["case"], row["method"]): row for row in rows}
    return ["## Methods", "", "To 1e-8 on N = 22, at most 1000 iterations: iterations · n_A, or how the run ended. "
            "`newton` is the default, `anderson` the published map, weighted and accelerated, `relaxation` the "
            "published iteration with θ = 0.2.", "",
            *table(["scene", *METHODS], ([case, *(_cell(at.get((case, method))) for method in METHODS)]
                                         for case in dict.fromkeys(row["case"] for row in rows)))]


def _cell(row: Row | None) -> str:
    if row is None:
        return "not run"
    cost = f"{row['iterations']} · {row['n_A']}"
    return cost if row["outcome"] == "certified" else f"{row['outcome']}, {cost}"


def locking_table(rows: list[Row]) -> list[str]:
    at = {(row["poisson"], row["order"], row["N"]): row for row in rows}
    meshes = sorted({N for _, _, N in at})
    quantities = (("energy", "strain energy (kJ)", 1e-3), ("tangential_force", "tangential resultant (MN)", 1e-6),
                  ("corner_x", "u_x at (3, 2) m (mm)", 1e3))
    body = []
    for nu, order in sorted({(nu, order) for nu, order, _ in at}):
        for key, label, unit in quantities:
            values = [unit * at[nu, order, N][key] if (nu, order, N) in at else np.nan for N in meshes]
            body.append([f"{nu:g}", order, label, *(number(value, ".3f") for value in values)])
    return ["## Nearly incompressible material", "",
            "Both bodies alike, per metre of depth. All answers are certified: they are those of the discrete problem, "
            "which is too stiff with linear triangles (order 1).", "",
            *table(["Poisson's ratio", "order", "", *(f"N = {N}" for N in meshes)], body)]


# All of it

def extremes(world: MPI.Comm, folder: Path, most: int) -> list[str]:
    changes = cases()
    ledger = Ledger(world, folder / "extremes.csv", ("group", "case"), EXTREMES)
    return extremes_table(ledger.fill(changes, lambda *key: attempt(world, changes[key], compare=True)))


def numbers(world: MPI.Comm, folder: Path, most: int) -> list[str]:
    ledger = Ledger(world, folder / "numbers.csv", ("contrast", "N"), NUMBERS)
    return numbers_table(ledger.fill(
        [(contrast, N) for N in MESHES if most >= N for contrast in CONTRASTS],
        lambda contrast, N: attempt(world, material(upper=contrast) | squares(N) | {"method.compliance": "direct"})))


def comparison(world: MPI.Comm, folder: Path, most: int) -> list[str]:
    ledger, changes = Ledger(world, folder / "methods.csv", ("case", "method"), COMPARISON), comparison_cases()

    def measure(case: str, method: str) -> Row:
        named = {"method.theta": 0.2} if method == "relaxation" else {"method.outer": method}
        return attempt(world, changes[case] | named | {"method.tolerance": 1e-8, "method.max_iterations": 1000})

    return comparison_table(ledger.fill([(case, method) for case in changes for method in METHODS], measure))


def locking(world: MPI.Comm, folder: Path, most: int) -> list[str]:
    ledger = Ledger(world, folder / "locking.csv", ("poisson", "order", "N"), LOCKING)
    return locking_table(ledger.fill(
        [(nu, order, N) for order, meshes in LOCKING_MESHES.items() for N in meshes if most >= N for nu in POISSONS],
        lambda nu, order, N: attempt(world, material(poisson=(nu, nu)) | squares(N) | {
            "body.upper.mesh.order": order})))


TABLES = {"extremes": extremes, "numbers": numbers, "methods": comparison, "locking": locking}


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = arguments(__doc__, "extremes")
    parser.add_argument("--tables", nargs="+", default=list(TABLES), choices=TABLES, metavar="TABLE",
                        help="which of %(choices)s (default: all)")
    parser.add_argument("--most", type=int, default=FINEST, choices=(*MESHES, FINEST), metavar="N",
                        help="finest mesh of the tables numbers and locking (default: %(default)s)")
    options = parser.parse_args()

    lines = ["# The default method at the extremes", "",
             "Generated by `scripts/study extremes`; what it means is in [robustness.md](../understand/robustness.md). "
             "Default method, tolerance 1e-8, variations of `configs/pinched_blocks.toml`. n_A: all multiplications by "
             "A⁻¹ of both bodies. Seconds are of two ranks on two shared cores, mesh and factorization included: an "
             "aside.", ""]
    for name in options.tables:
        lines += TABLES[name](world, options.output, options.most)
    if world.rank == 0:
        text, complete = "\n".join(lines), list(options.tables) == list(TABLES) and options.most >= FINEST
        publish(PAGE, text, options.output, complete)
        print(text)


if __name__ == "__main__":
    main()
