#!/usr/bin/env bash
"exec" "${0%/*}/on_two_ranks.sh" "$0" "$@"  # to Python, a string

__doc__ = """The default method at the extremes, and what it costs.

Four tables: the extremes of material, friction, shape, size and load; multiplications by the inverse
stiffness over meshes and stiffness contrasts; the default method against the other two; what the elements
do in nearly incompressible material. All on variations of configs/pinched_blocks.toml, at
tolerance 1e-8.

Writes to the folder --output: a CSV file per table (a line per run, written at once: an interrupted sweep
goes on where it was) and robustness_table.md, which with all tables done also goes to docs/.
"""

import argparse
import dataclasses
import time
from collections import Counter
from pathlib import Path

import numpy as np
from experiment import ROOT, Ledger, on_two_ranks, progress
from mpi4py import MPI

from ddmpi.body.estimate import estimate_error
from ddmpi.coupling.assembly import Problem, prepare
from ddmpi.errors import DdmpiError, NotConvergedError
from ddmpi.judge.brute_force import solve_coupled
from ddmpi.judge.diagnosis import diagnose
from ddmpi.run.solve import solve
from ddmpi.scene.reader import read_scene_file
from ddmpi.scene.scene import Scene

SCENE = ROOT / "configs" / "pinched_blocks.toml"
PAGE = "robustness_table.md"
YOUNG, PRESSED, PULLED, LIFTED = 2.119e11, (0.0, -6.0e7), (2.0e7, 3.0e7), (0.0, 4.0e7)
"""Material and loads of that scene (Pa)."""

LARGEST_COUPLED = 500
"""Up to so many contact unknowns the coupled problem is solved by brute force as well."""

MESHES, CONTRASTS = (22, 54, 86), (1e-4, 1e-2, 1.0, 1e2, 1e4)
PURPOSES = ("load", "norm", "newton", "approximation", "displacement")
METHODS = ("newton", "anderson", "relaxation")
POISSONS, LOCKING_MESHES = (0.277, 0.49, 0.499, 0.4999), {1: (11, 22, 44, 88), 2: (11, 22, 44)}

EXTREMES = ("group", "case", "n", "m", "outcome", "iterations", "n_A", "residual", "distance", "seconds")
NUMBERS = ("contrast", "N", "certified", "iterations", "n_A", "dirichlet", "seconds",
           *(f"{body}_{purpose}" for body in ("upper", "lower") for purpose in PURPOSES))
COMPARISON = ("case", "method", "outcome", "iterations", "n_A", "seconds")
LOCKING = ("poisson", "order", "N", "outcome", "iterations", "n_A", "energy", "tangential_force", "corner_x")


# Variations of the scene, as a user would write them after --set

def divisions(nx: int, ny: int) -> list[str]:
    return [f"body.{name}.mesh.divisions=[{nx}, {ny}]" for name in ("upper", "lower")]


def material(upper: float = 1.0, lower: float = 1.0, poisson: tuple[float, float] = (0.277, 0.277)) -> list[str]:
    return [f"body.{name}.material={{ young = {YOUNG * factor!r}, poisson = {nu!r} }}"
            for name, factor, nu in (("upper", upper, poisson[0]), ("lower", lower, poisson[1]))]


def loads(upper: dict, lower: dict) -> list[str]:
    def listed(tractions: dict) -> str:
        return ", ".join(f"{{ on = {on!r}, value = {list(value)} }}" for on, value in tractions.items())

    return [f"body.{name}.traction=[{listed(tractions)}]" for name, tractions in (("upper", upper), ("lower", lower))]


def coulomb(coefficient: float | str) -> list[str]:
    return [f'contact.0.friction={{ law = "coulomb", coefficient = {coefficient} }}']


def tresca(bound: float | str) -> list[str]:
    return [f'contact.0.friction={{ law = "tresca", slip_bound = {bound} }}']


NO_FRICTION = ['contact.0.friction={ law = "none" }']


def size(width: float, height: float) -> list[str]:
    return [f"body.{name}.mesh.{key}=[{x!r}, {y!r}]" for name, bottom in (("upper", height), ("lower", 0.0))
            for key, x, y in (("origin", 0.0, bottom), ("size", width, height))]


def other_order() -> list[str]:
    return ['contact.0.bodies=["lower", "upper"]', 'contact.0.on=["top", "bottom"]']


def jump(low: float, high: float) -> str:
    return f'{{ along = "x", points = [1.5, 1.5], values = [{low!r}, {high!r}] }}'


TOP, RIGHT, BOTTOM = {"top": PRESSED}, {"right": PULLED}, {"bottom": LIFTED}
APART = loads({"top": (0.0, 6e7)}, {"bottom": (0.0, -6e7)})
CORNER = ["body.lower.mesh.origin=[0.0, -0.005]", *loads({"right": (0.0, -1e8)}, {})]


def cases() -> list[tuple[str, str, list[str]]]:
    """(group, case, settings) of the table of extremes."""
    found = [("the scene as it is", "N = 22", [])]
    found += [("stiffness", f"E₁/E₂ = {factor:g}{', the lower body in role 1' if swapped else ''}",
               material(upper=factor) + swapped)
              for factor in (1e-6, 1e-3, 1e3, 1e6) for swapped in ([], other_order())]
    found += [("Coulomb", f"𝓕 = {F:g}", coulomb(F)) for F in (0.0, 1e-6, 0.05, 0.3, 1.0, 3.0, 10.0)]
    found += [("Coulomb", f"𝓕 = {F:g}, N = {N}", coulomb(F) + divisions(3 * N, N))
              for F in (0.1, 10.0) for N in (38, 54)]
    found += [("Coulomb", f"𝓕 jumps from {low:g} to {high:g}", coulomb(jump(low, high)))
              for low, high in ((0.0, 1.0), (10.0, 0.01))]
    found += [("Tresca", f"g = {g:g} Pa", tresca(g)) for g in (0.0, 1e3, 1e6, 1.2e7, 1e20)]
    found += [("Tresca", "g jumps from 1e5 to 3e7 Pa", tresca(jump(1e5, 3e7))), ("no friction", "", NO_FRICTION)]
    found += [("Poisson's ratios", f"{a:g} and {b:g}", material(poisson=(a, b)))
              for a, b in ((0.0, 0.0), (0.49, 0.49), (0.4999, 0.4999), (0.0, 0.4999), (-0.9, 0.4))]
    found += [("triangles", f"{3 / nx:.3g} m × {1 / ny:.3g} m", divisions(nx, ny))
              for nx, ny in ((66, 1), (300, 3), (3000, 1), (3, 300), (3, 1000))]
    found += [("slender bodies", f"3 m × {height:g} m", size(3.0, height) + divisions(66, 6))
              for height in (0.3, 0.03, 0.003)]
    found += [("contact nodes", "one", divisions(1, 1)), ("contact nodes", "three thousand", divisions(3000, 8))]
    found += [("size of the bodies", f"{width:g} m", size(width, width / 3)) for width in (1e-9, 1e6)]
    found += [("unit of force", f"{1 / f:g} N", material(f, f) + loads(
        {"top": [f * q for q in PRESSED], "right": [f * q for q in PULLED]}, {"bottom": [f * q for q in LIFTED]}))
        for f in (1e-9, 1e9)]
    loaded = {"lifted apart": APART, "none": loads({}, {}), "on the upper body only": loads(TOP | RIGHT, {}),
              "on the lower body only": loads({}, BOTTOM), "contact at a corner only": CORNER}
    found += [("loads", f"{case}, {law}", settings + friction) for case, settings in loaded.items()
              for law, friction in (("Coulomb", coulomb(0.3)), ("Tresca", tresca(1.2e7)))]
    found += [("not held", "no clamp", ["body.upper.clamp=[]"]),
              ("not held", "free along x", ['body.upper.clamp=[{ on = "left", y = 0 }]'])]
    return found


def comparison_cases() -> list[tuple[str, list[str]]]:
    """(case, settings) on which the methods are compared."""
    found = [("the scene as it is", []), ("Tresca", tresca(1.2e7)), ("no friction", NO_FRICTION)]
    found += [(f"E₁/E₂ = {c:g}", material(upper=c)) for c in (1e-4, 0.1, 10.0, 1e4)]
    found += [(f"𝓕 = {F:g}", coulomb(F)) for F in (0.05, 1.0, 3.0)]
    found += [("Poisson's ratio 0.4999", material(poisson=(0.4999, 0.4999))),
              ("slender, 3 m × 0.3 m", size(3.0, 0.3) + divisions(66, 6)),
              ("load on the upper body only", loads(TOP | RIGHT, {})), ("contact at a corner only", CORNER)]
    return found


def method_settings(method: str) -> list[str]:
    named = ["method.theta=0.2"] if method == "relaxation" else [f"method.outer={method}"]
    return [*named, "method.tolerance=1e-8", "method.max_iterations=1000"]


# Runs

@dataclasses.dataclass
class Found:
    """What became of a run; `outcome` is "certified" or the reason why not.

    ``energy`` is the strain energy of both bodies (J per metre of depth), ``corner_x`` the displacement along x
    (m) of the upper body's upper right corner.
    """

    outcome: str
    n: int = 0
    m: int = 0
    iterations: int = 0
    count: list[Counter] = dataclasses.field(default_factory=lambda: [Counter(), Counter()])
    residual: float = float("nan")
    distance: float = float("nan")
    energy: float = float("nan")
    tangential_force: float = float("nan")
    corner_x: float = float("nan")
    seconds: float = 0.0

    @property
    def certified(self) -> bool:
        return self.outcome == "certified"

    @property
    def n_A(self) -> int:
        return sum(count.total() for count in self.count)


def attempt(world: MPI.Comm, settings: list[str], compare: bool = False) -> Found:
    """Solve a variation of the scene; what goes wrong with a reason becomes the outcome. Collective."""
    start = time.perf_counter()
    try:
        found = run(world, read_scene_file(SCENE, settings), compare)
    except DdmpiError as error:
        found = Found(f"refused: {str(error).splitlines()[0]}")
    found.seconds = round(world.allreduce(time.perf_counter() - start, MPI.MAX), 2)
    return found


def run(world: MPI.Comm, scene: Scene, compare: bool) -> Found:
    problem = prepare(world, scene)
    answer, outer = solve(problem, scene.method)
    outcome = "certified"
    if not answer.certified:
        outcome = diagnose(answer.reason, answer.stopped, answer.violations, scene.method, outer.history,
                           answer.statuses, problem.interface, problem.friction).replace("\n", ";")
    at = int(np.argmax(problem.mesh.points.sum(axis=1)))
    own = estimate_error(problem.mesh, problem.spec.material, answer.displacement).energy / 2
    found = Found(outcome, problem.n, problem.interface.m, len(outer.history),
                  world.allgather(problem.body.C.count.copy()),
                  max(dataclasses.asdict(answer.certificate).values()), energy=world.allreduce(own),
                  tangential_force=float(answer.state.tangential_force.sum()),
                  corner_x=world.bcast(float(answer.displacement[at, 0]), root=0))
    if compare and problem.interface.size <= LARGEST_COUPLED:
        found.distance = distance(problem, outer.forces)
    return found


def distance(problem: Problem, forces: np.ndarray) -> float:
    """Of the contact forces from those of the coupled problem, relatively; nan if brute force fails. Collective."""
    try:
        exact = solve_coupled(problem.body, problem.friction, problem.exchange)
    except NotConvergedError:
        return float("nan")
    return float(np.linalg.norm(forces - exact) / (np.linalg.norm(exact) or 1.0))


# Tables

def table(header: str, rows: list[str]) -> list[str]:
    return [header, "|---" * (header.count("|") - 1) + "|", *rows, ""]


def number(value: float, form: str = ".0e") -> str:
    return "–" if not np.isfinite(value) else "0" if value == 0 else format(value, form)


def extremes_table(rows: list[dict]) -> list[str]:
    done = [row for row in rows if row["outcome"] == "certified"]
    refused = sum(row["outcome"].startswith("refused") for row in rows)
    distances = [row["distance"] for row in done if np.isfinite(row["distance"])]
    lines = ["## The extremes", "",
             f"{len(rows)} scenes: {len(done)} certified, {refused} refused, {len(rows) - len(done) - refused} not "
             "converged. Residual: the largest of the certificate. Distance: of the contact forces from those of the "
             f"coupled problem, relatively, where that was solved ({len(distances)} scenes, at most "
             f"{number(max(distances, default=np.nan))}).", ""]
    body = []
    for row in rows:
        outcome = "yes" if row["outcome"] == "certified" else row["outcome"]
        cells = [row["m"], outcome, row["iterations"], row["n_A"], number(row["residual"]), number(row["distance"])]
        if not row["m"]:
            cells = ["–", outcome, "–", "–", "–", "–"]
        body.append(f"| {row['group']} | {row['case']} | {' | '.join(map(str, cells))} | {row['seconds']:.1f} |")
    return lines + table("| what | case | m | certified | iterations | n_A | residual | distance | s |", body)


def numbers_table(rows: list[dict]) -> list[str]:
    at = {(row["contrast"], row["N"]): row for row in rows}
    contrasts, meshes = sorted({c for c, _ in at}), sorted({N for _, N in at})
    body, spreads = [], {}
    for c in contrasts:
        row = [at[c, N] for N in meshes if (c, N) in at]
        n_A = [r["n_A"] for r in row]
        spreads[c] = (max(n_A) - min(n_A)) / (max(n_A) + min(n_A))
        cells = [f"{r['iterations']} · {r['n_A']}{'' if r['certified'] else ' (not certified)'}" for r in row]
        body.append(f"| {c:g} | {' | '.join(cells)} | ±{spreads[c]:.0%} |")
    columns = [[at[c, N]["n_A"] for c in contrasts if (c, N) in at] for N in meshes]
    factors = [max(column) / min(column) for column in columns]
    body.append("| factor over the contrasts | " + " | ".join(f"{f:.2f}" for f in factors) + " | |")
    purposes = []
    for row in sorted(rows, key=lambda row: (row["contrast"], row["N"])):
        cells = [f"{row[f'upper_{p}']} + {row[f'lower_{p}']}" for p in PURPOSES]
        purposes.append(f"| {row['contrast']:g} | {row['N']} | {' | '.join(cells)} | {row['dirichlet']} | "
                        f"{row['seconds']:.1f} |")
    return ["## Multiplications over meshes and stiffness contrasts", "",
            "Pinched blocks with Coulomb friction, matrix-free: every multiplication is a solve with A of one body. "
            "Dirichlet solves: none, the preconditioner is a formula. In each cell: iterations · n_A.", "",
            *table(f"| E₁/E₂ | {' | '.join(f'N = {N}' for N in meshes)} | over the meshes |", body),
            f"Most: {max(row['n_A'] for row in rows)}. Over the meshes at equal stiffness "
            f"±{spreads.get(1.0, np.nan):.0%}, at other contrasts at most ±{max(spreads.values()):.0%}; over the "
            f"contrasts at most a factor {max(factors):.2f}.", "", "What they were for, upper + lower body:", "",
            *table(f"| E₁/E₂ | N | {' | '.join(PURPOSES)} | Dirichlet | s |", purposes)]


def comparison_table(rows: list[dict]) -> list[str]:
    at = {(row["case"], row["method"]): row for row in rows}
    body = [f"| {case} | " + " | ".join(_cell(at.get((case, method))) for method in METHODS) + " |"
            for case in dict.fromkeys(row["case"] for row in rows)]
    return ["## Methods", "", "To 1e-8 on N = 22, at most 1000 iterations: iterations · n_A, or how the run ended. "
            "`newton` is the default, `anderson` the published map, weighted and accelerated, `relaxation` the "
            "published iteration with θ = 0.2.", "",
            *table(f"| scene | {' | '.join(METHODS)} |", body)]


def _cell(row: dict | None) -> str:
    if row is None:
        return "not run"
    cost = f"{row['iterations']} · {row['n_A']}"
    return cost if row["outcome"] == "certified" else f"{row['outcome'].split(';')[0].split(' (iteration')[0]}, {cost}"


def locking_table(rows: list[dict]) -> list[str]:
    at = {(row["poisson"], row["order"], row["N"]): row for row in rows}
    meshes = sorted({N for _, _, N in at})
    quantities = (("energy", "strain energy (kJ)", 1e-3), ("tangential_force", "tangential resultant (MN)", 1e-6),
                  ("corner_x", "u_x at (3, 2) m (mm)", 1e3))
    body = []
    for nu, order in sorted({(nu, order) for nu, order, _ in at}):
        for key, label, unit in quantities:
            values = [number(unit * at[nu, order, N][key] if (nu, order, N) in at else np.nan, ".3f") for N in meshes]
            body.append(f"| {nu:g} | {order} | {label} | " + " | ".join(values) + " |")
    return ["## Nearly incompressible material", "",
            "Both bodies alike, per metre of depth. All answers are certified: they are those of the discrete problem, "
            "which is too stiff with linear triangles (order 1).", "",
            *table("| Poisson's ratio | order | | " + " | ".join(f"N = {N}" for N in meshes) + " |", body)]


# All of it

def extremes(world: MPI.Comm, folder: Path) -> list[str]:
    ledger = Ledger(world, folder / "extremes.csv", ("group", "case"), EXTREMES)
    settings = {(group, case): changes for group, case, changes in cases()}
    work = [key for key in settings if not ledger.find(*key)]
    for group, case in progress(world, work, "extremes"):
        found = attempt(world, settings[group, case], compare=True)
        ledger.add(dict(zip(EXTREMES, (group, case, found.n, found.m, found.outcome, found.iterations, found.n_A,
                                       found.residual, found.distance, found.seconds), strict=True)))
    return extremes_table(ledger.rows)


def numbers(world: MPI.Comm, folder: Path) -> list[str]:
    ledger = Ledger(world, folder / "numbers.csv", ("contrast", "N"), NUMBERS)
    work = [(c, N) for N in MESHES for c in CONTRASTS if not ledger.find(c, N)]
    for contrast, N in progress(world, work, "numbers"):
        found = attempt(world, [*material(upper=contrast), *divisions(3 * N, N), "method.compliance=direct"])
        counted = [count[purpose] for count in found.count for purpose in PURPOSES]
        dirichlet = found.n_A - sum(counted)  # nothing else is counted, so nothing else is solved
        ledger.add(dict(zip(NUMBERS, (contrast, N, found.certified, found.iterations, found.n_A, dirichlet,
                                      found.seconds, *counted), strict=True)))
    return numbers_table(ledger.rows)


def comparison(world: MPI.Comm, folder: Path) -> list[str]:
    ledger = Ledger(world, folder / "methods.csv", ("case", "method"), COMPARISON)
    settings = dict(comparison_cases())
    work = [(case, method) for case in settings for method in METHODS if not ledger.find(case, method)]
    for case, method in progress(world, work, "methods"):
        found = attempt(world, settings[case] + method_settings(method))
        ledger.add(dict(zip(COMPARISON, (case, method, found.outcome, found.iterations, found.n_A, found.seconds),
                            strict=True)))
    return comparison_table(ledger.rows)


def locking(world: MPI.Comm, folder: Path) -> list[str]:
    ledger = Ledger(world, folder / "locking.csv", ("poisson", "order", "N"), LOCKING)
    work = [(nu, order, N) for order, meshes in LOCKING_MESHES.items() for N in meshes for nu in POISSONS
            if not ledger.find(nu, order, N)]
    for nu, order, N in progress(world, work, "locking"):
        found = attempt(world, [*material(poisson=(nu, nu)), *divisions(3 * N, N), f"body.upper.mesh.order={order}"])
        ledger.add(dict(zip(LOCKING, (nu, order, N, found.outcome, found.iterations, found.n_A, found.energy,
                                      found.tangential_force, found.corner_x), strict=True)))
    return locking_table(ledger.rows)


TABLES = {"extremes": extremes, "numbers": numbers, "methods": comparison, "locking": locking}


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--output", type=Path, default=Path("results/extremes"), metavar="DIR")
    parser.add_argument("--tables", nargs="+", default=list(TABLES), choices=TABLES, metavar="TABLE",
                        help="which of %(choices)s (default: all)")
    options = parser.parse_args()

    lines = ["# The default method at the extremes", "",
             "Generated by `scripts/extremes.py`; what it means is in [robustness.md](robustness.md). Default method, "
             "tolerance 1e-8, variations of `configs/pinched_blocks.toml`. n_A: all multiplications by A⁻¹ of both "
             "bodies. Seconds are of two ranks on two shared cores, mesh and factorization included: an aside.", ""]
    for name in options.tables:
        lines += TABLES[name](world, options.output)
    if world.rank == 0:
        text = "\n".join(lines)
        for folder in [options.output] + [ROOT / "docs"] * (list(options.tables) == list(TABLES)):
            (folder / PAGE).write_text(text, encoding="utf-8")
        print(text)


if __name__ == "__main__":
    main()
