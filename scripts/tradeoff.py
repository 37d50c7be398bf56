"""What accuracy costs: time, multiplications and memory against true errors.

Two scenes, pinched blocks with Coulomb friction and two rings with a closed form (true_errors.py), along
axes that each vary one choice: mesh and order, tolerance, inner precision, compliance, outer method, algorithm and
splitting. The time is that of mesh, assembly, factorization, outer iteration, displacements and error estimate, of the
slower rank, the least of several runs where they are short; start-up and files are left out.

Writes to the folder --output: tradeoff.csv (a line per case, written at once, so that an interrupted study continues),
tradeoff_table.md and figures; once all axes are done with the usual reference, page and figures are also written to
docs/tables/. In space: `scripts/study tradeoff_in_space`.
"""

import ctypes
import functools
import gc
import time
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
import scipy.sparse as sparse
from experiment import (
    VARIANTS,
    Ledger,
    Row,
    arguments,
    on_two_ranks,
    pinched_blocks,
    publish,
    save_figures,
    seconds,
    start,
    table,
    where,
)
from mpi4py import MPI
from problems.solids import PLANES, half_ball, hertz_values, tube
from scenes import to_toml
from solid_scenes import two_boxes
from true_errors import (
    ClosedForm,
    Errors,
    FineSolution,
    Rings,
    difference,
    energy,
    own_body,
    relative,
    solve_reference,
)

import ddmpi
from ddmpi.body.estimate import estimate_error, relative_error
from ddmpi.coupling.assembly import Assembly, prepare
from ddmpi.errors import SolverError
from ddmpi.petsc.versions import free_garbage
from ddmpi.run.answer import Answer
from ddmpi.run.solve import Solution, solve
from ddmpi.scene.scene import Settled
from ddmpi.system.clock import Clock

REFERENCE = 176
"""Squares of the reference solution, of order 2, have sides of 1/176 m; all others have a multiple of that."""

TIGHT, REFERENCE_TOLERANCE = 1e-12, 1e-10
"""Tolerances of the solutions with which algebraic errors are measured, and of the reference solution."""

REPEATS, ENOUGH = 7, 2.0
"""A case is timed so many times, unless option --repeats says how many, or until that many seconds are spent on it."""

NONE = "–"
"""The value of a choice that a method does not have."""

PHASES = ("mesh", "assemble", "factor", "outer", "recover", "estimate")


class Case(NamedTuple):
    """All choices of a run."""

    scene: str
    N: int
    order: int = 1
    method: str = "newton"
    algorithm: str = NONE
    splitting: str = NONE
    theta: float | str = NONE
    inner_precision: float | str = NONE
    tolerance: float = 1e-8
    compliance: str = "explicit"

    @property
    def settings(self) -> list[str]:
        """As a user would write them after --set."""
        chosen = {"outer": self.method, "algorithm": self.algorithm, "splitting": self.splitting, "theta": self.theta,
                  "inner_precision": self.inner_precision, "tolerance": self.tolerance, "compliance": self.compliance}
        words = ", ".join(f"{key} = {f'{value!r}'.replace(chr(39), chr(34))}" for key, value in chosen.items()
                          if value != NONE)
        return [f"method={{ {words} }}"]


def relaxation(scene: str, N: int, order: int = 1, algorithm: str = "original", splitting: str = "none",
               theta: float = 0.2, inner_precision: float | str = 0.1, tolerance: float = 1e-4) -> Case:
    """The published iteration."""
    return Case(scene, N, order, "relaxation", algorithm, splitting, theta, inner_precision, tolerance)


def by_method(method: str, scene: str, N: int, order: int, tolerance: float) -> Case:
    if method == "relaxation":
        return relaxation(scene, N, order, tolerance=tolerance)
    return Case(scene, N, order, method, tolerance=tolerance)


OUTER = ("newton", "anderson", "relaxation")
MESHES = {("blocks", 1): (4, 8, 11, 16, 22, 44, 88, 176), ("blocks", 2): (4, 8, 11, 16, 22, 44, 88),
          ("rings", 1): (4, 8, 16, 32, 64, 128), ("rings", 2): (4, 8, 16, 32, 64)}
MIDDLE = {"blocks": 44, "rings": 32}
"""The mesh on which the choices other than the mesh are varied."""

TOLERANCES = tuple(float(f"1e-{k}") for k in range(1, 11))

AXES = {
    "mesh": [Case(scene, N, order) for (scene, order), meshes in MESHES.items() for N in meshes],
    "tolerance": [by_method(method, scene, N, order, tolerance) for scene, N in MIDDLE.items() for order in (1, 2)
                  for method in (OUTER if order == 1 else OUTER[:1]) for tolerance in TOLERANCES],
    "inner precision": [relaxation("blocks", MIDDLE["blocks"], inner_precision=eta, tolerance=tolerance)
                        for tolerance in (1e-4, 1e-6) for eta in (1.0, 0.3, 0.1, 0.03, 0.01, "fixed")],
    "compliance": [Case("blocks", N, order, compliance=kind) for order, meshes in ((1, (22, 44, 88)), (2, (22, 44)))
                   for N in meshes for kind in ("explicit", "direct", "iterative")
                   if kind != "iterative" or N * order <= 44],
    "method": [by_method(method, "blocks", N, order, 1e-6) for order, N in ((1, 22), (1, 88), (2, 22))
               for method in OUTER],
    "variant": [relaxation("blocks", MIDDLE["blocks"], 1, *kind) for kind in VARIANTS]
    + [relaxation("blocks", MIDDLE["blocks"], 1, *kind, theta=0.4) for kind in VARIANTS if kind[1] == "step1+2"],
    "preset": [Case("blocks", 22, 1, tolerance=1e-4), Case("blocks", 22, 2, tolerance=1e-6), Case("blocks", 88, 2),
               Case("rings", 16, 1, tolerance=1e-4), Case("rings", 16, 2, tolerance=1e-6), Case("rings", 16, 2)],
}
"""Cases by the choice that varies. Presets: what fast, balanced and accurate (to 1 %) make of meshes of N = 22, 16."""

MEASURED = ("n", "m", "outcome", "iterations", "n_A", "seconds", "cpu_seconds",
            *(f"{phase}_seconds" for phase in PHASES), "memory_mib", "runs", "estimated", "algebraic",
            *Errors.__dataclass_fields__)


# Runs

def run_once(world: MPI.Comm, scene: Settled) -> tuple[Row, Assembly, Solution]:
    """Solve a scene; the row has times of the slower rank, CPU time and memory as sums of both. Collective."""
    gc.collect()
    free_garbage()
    resting = restart_peak()
    world.Barrier()
    cpu, clock = time.process_time(), Clock()
    assembly = prepare(world, scene, clock=clock)
    solution = solve(assembly, scene.method, clock=clock)
    with clock.phase("estimate"):
        estimate = estimate_error(*own_body(assembly, solution))
    cpu = time.process_time() - cpu
    seconds = clock.largest(world)
    row = {f"{phase}_seconds": seconds[phase] for phase in PHASES} | {
        "seconds": seconds["total"], "cpu_seconds": world.allreduce(cpu),
        "memory_mib": world.allreduce(resident("VmHWM") - resting),
        "estimated": relative_error(world.allreduce(estimate.total), world.allreduce(estimate.energy))}
    return row, assembly, solution


def restart_peak() -> float:
    """Free unused memory and reset the peak of the resident memory (Linux); returns what is held now (MiB)."""
    try:
        ctypes.CDLL(None).malloc_trim(0)
        Path("/proc/self/clear_refs").write_text("5")
    except (OSError, AttributeError):
        return np.nan
    return resident("VmRSS")


def resident(name: str) -> float:
    """An entry of /proc/self/status in MiB; nan where there is none."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return np.nan
    return next((float(line.split()[1]) / 1024 for line in lines if line.startswith(f"{name}:")), np.nan)


class Study:
    """The scenes, their exact solutions, and the measurements.

    Parameters
    ----------
    folder : for the meshes of the rings
    reference : N of the reference solution
    repeats : a case is timed so many times, or until ENOUGH seconds are spent on it
    """

    def __init__(self, world: MPI.Comm, folder: Path, reference: int, repeats: int = REPEATS) -> None:
        self.world, self.folder, self.reference, self.repeats = world, folder, reference, repeats
        self.rings = Rings()
        self._tight: tuple[tuple, np.ndarray] = (), np.empty(0)

    def scene(self, case: Case) -> Settled:
        """Collective: rank 0 writes the meshes of the rings."""
        if case.scene == "rings":
            if self.world.rank == 0:
                self.rings.write_meshes(self.folder / "meshes", case.N)
            self.world.Barrier()
            return self.rings.scene(self.folder / "meshes", case.N, case.order, *case.settings)
        orders = [f"body.{name}.mesh.order={case.order}" for name in ("upper", "lower")]
        return pinched_blocks("coulomb", case.N, *orders, *case.settings)

    @functools.cached_property
    def fine(self) -> FineSolution:
        """The reference solution of the blocks. Collective."""
        return solve_reference(self.world, self.scene(Case("blocks", self.reference, 2, tolerance=REFERENCE_TOLERANCE)))

    def measure(self, case: Case) -> Row:
        """A line of the table. Collective."""
        exact, scene = ClosedForm(self.rings) if case.scene == "rings" else self.fine, self.scene(case)
        best, runs, spent = None, 0, 0.0
        try:
            while runs < self.repeats and spent < ENOUGH:
                run = run_once(self.world, scene)
                runs, spent = runs + 1, spent + run[0]["seconds"]
                if best is None or run[0]["seconds"] < best[0]["seconds"]:
                    best = run
                del run
        except SolverError as error:  # the same on both ranks, or the study has to end
            if not error.agreed:
                raise
            return dict.fromkeys(MEASURED, np.nan) | {"outcome": f"failed: {str(error).splitlines()[0]}"}
        row, assembly, solution = best
        return row | asdict(exact.errors(assembly, solution)) | {
            "n": assembly.n, "m": assembly.m, "outcome": "certified" if solution.certified else solution.reason,
            "iterations": len(solution.outer.history), "n_A": self.world.allreduce(assembly.member.C.count.total()),
            "runs": runs, "algebraic": self._algebraic(case, assembly, solution)}

    def _algebraic(self, case: Case, assembly: Assembly, solution: Solution) -> float:
        """Distance, relative in the energy norm, from the exact solution on the same mesh. Collective."""
        mesh = case[:3]
        if self._tight[0] != mesh:
            scene = self.scene(Case(*mesh, tolerance=TIGHT))
            tight = prepare(self.world, scene)
            self._tight = mesh, own_body(tight, solve(tight, scene.method))[2]
        own, material, u = own_body(assembly, solution)
        distance, size = (self.world.allreduce(energy(own, material, v)) for v in (u - self._tight[1], self._tight[1]))
        return float(np.sqrt(distance / size))


# The page and its figures, made from the table alone

PAGE = "tradeoff_table.md"
TARGETS = (0.1, 0.05, 0.03, 0.02, 0.01, 0.005, 0.001)
"""Errors in the energy norm for which the cheapest way is looked up."""

LOOSEST = 1e-3
"""Looser tolerances are shown, but not recommended, because the certificate asks for no more than 50 times them."""

TITLES = {"blocks": "Pinched blocks", "rings": "Rings"}
QUANTITIES = {"energy": "energy norm", "pressure": "contact pressure at nodes", "side_pressure": "its means over sides"}
COLOURS = {1: "#1b4f8f", 2: "#c8501e"}
METHOD_COLOURS = {"newton": "#1b4f8f", "anderson": "#3f8f4f", "relaxation": "#c8501e"}

COST = {"seconds": "s", "cpu_seconds": "CPU s", "memory_mib": "MiB", "iterations": "k", "n_A": "n_A"}
ERRORS = {"energy": "energy norm", "pressure": "pressure", "side_pressure": "side means",
          "normal_force": "normal force"}
OF_FRICTION = {"shear": "tangential stress", "tangential_force": "tangential force", "contact_end": "contact end",
               "stick_end": "stick ends"}
"""Columns of the study and their titles."""


def pick(rows: list[Row], cases: list[tuple]) -> list[Row]:
    """The rows of the cases that have been run, in the order of the cases."""
    found = {tuple(row.values())[:len(cases[0])]: row for row in rows}
    return [found[case] for case in cases if case in found]


def trusted(row: Row) -> bool:
    """Whether a run's answer may be recommended."""
    return row["outcome"] == "certified" and row["tolerance"] <= LOOSEST


def front(rows: list[Row], quantity: str = "energy") -> list[Row]:
    """The trusted rows for which no other is both faster and as accurate, within one per cent; the fastest first."""
    best, least = [], np.inf
    for row in sorted(filter(trusted, rows), key=lambda row: row["seconds"]):
        if row[quantity] < 0.99 * least:
            best.append(row)
            least = row[quantity]
    return best


# Words

def percent(value: float) -> str:
    if not np.isfinite(value):
        return "–"
    digits = 2 - int(np.floor(np.log10(100 * value))) - 1 if value > 0 else 0
    return f"{100 * value:.{min(max(digits, 0), 5)}f} %" if value > 1e-7 or value == 0 else f"{100 * value:.0e} %"


def small(value: float) -> str:
    return f"{value:.0e}" if np.isfinite(value) else "–"


def millimetres(value: float) -> str:
    return f"{1e3 * value:.1f}" if np.isfinite(value) else "–"


def choice(row: Row) -> str:
    """A case in words, without scene and mesh: what differs from the default."""
    words = [f"order {row['order']}", f"N = {row['N']}"]
    if row["method"] != "newton":
        words.append(row["method"])
    if row["method"] == "relaxation":
        words += [f"{row['algorithm']}, {row['splitting']}", f"θ = {row['theta']}", f"η = {row['inner_precision']}"]
    if row["tolerance"] != 1e-8:
        words.append(f"to {row['tolerance']:.0e}")
    if row["compliance"] != "explicit":
        words.append(row["compliance"])
    return ", ".join(words)


def failed(row: Row) -> str:
    """The outcome of a run without certificate, else nothing."""
    return "" if row["outcome"] == "certified" else f" ({row['outcome'].split(';')[0]})"


def show(row: Row, column: str) -> str:
    """An entry in words."""
    value = row[column]
    if column.endswith("seconds"):
        return seconds(value)
    if column == "memory_mib":
        return f"{value:.0f}"
    if column == "iterations":
        return f"{value}{failed(row)}"
    if column in ("algebraic", "tolerance"):
        return small(value)
    if column in ("contact_end", "stick_end"):
        return millimetres(value)
    return percent(value) if column in ERRORS or column in OF_FRICTION or column == "estimated" else str(value)


def plain_table(columns: dict[str, str], rows: list[Row]) -> list[str]:
    """A line for every row; `columns` with their titles."""
    return table(columns.values(), ([show(row, column) for column in columns] for row in rows))


# Tables

def mesh_tables(rows: list[Row]) -> list[str]:
    lines = ["## Mesh and order", "", "Default method, tolerance 1e-8. Side means: of the contact "
             "pressure over the elements' sides; pressure: at the nodes. Ends: of the contact zone and of the stick "
             "zones, in mm, of an interface of 3 m; a mesh has them halfway between two nodes.", ""]
    for scene, title in TITLES.items():
        for order in (1, 2):
            own = where(rows, scene=scene, order=order)
            columns = {"N": "N", "n": "n"} | COST | ERRORS | (OF_FRICTION if scene == "blocks" else {})
            lines += [f"{title}, order {order}. Rates over the last three meshes: energy norm "
                      f"{rate(own, 'energy'):.2f}, pressure {rate(own, 'pressure'):.2f}, its side means "
                      f"{rate(own, 'side_pressure'):.2f}.", "", *plain_table(columns, own)]
    return lines


def rate(rows: list[Row], quantity: str) -> float:
    """Of convergence in N, fitted to the last three meshes; nan for fewer than two."""
    if len(rows) < 2:
        return np.nan
    N, error = np.array([(row["N"], row[quantity]) for row in rows[-3:]]).T
    return -float(np.polyfit(np.log(N), np.log(error), 1)[0])


def effectivity_table(rows: list[Row]) -> list[str]:
    kinds = [(scene, order) for scene in TITLES for order in (1, 2)]
    at = {(row["scene"], row["order"], row["N"]): row for row in rows}

    def cell(row: Row | None) -> str:
        if row is None:
            return ""
        return f"{percent(row['estimated'])} / {percent(row['energy'])} = {row['estimated'] / row['energy']:.2f}"

    return ["## Effectivity of the error estimate", "", "Estimated over true error in the energy norm, both relative.",
            "", *table(["N", *(f"{TITLES[scene].lower()}, order {order}" for scene, order in kinds)],
                       ([N, *(cell(at.get((*kind, N))) for kind in kinds)]
                        for N in sorted({row["N"] for row in rows})))]


def tolerance_tables(rows: list[Row]) -> list[str]:
    lines = ["## Tolerance", "", "k · n_A · seconds of the outer iteration; algebraic error, which is the "
             "distance, relative in the energy norm, from the exact solution on the same mesh; true error. A run goes "
             "on until its certificate holds as well.", ""]

    def cell(found: list[Row]) -> str:
        for row in found:
            return (f"{row['iterations']} · {row['n_A']} · {seconds(row['outer_seconds'])}; {small(row['algebraic'])}; "
                    f"{percent(row['energy'])}{failed(row)}")
        return "not run"

    for scene, order in dict.fromkeys((row["scene"], row["order"]) for row in rows):
        own = where(rows, scene=scene, order=order)
        methods = list(dict.fromkeys(row["method"] for row in own))
        lines += [f"{TITLES[scene]}, order {order}, N = {own[0]['N']}:", "", *table(["tolerance", *methods], (
            [small(tolerance), *(cell(where(own, method=method, tolerance=tolerance)) for method in methods)]
            for tolerance in sorted({row["tolerance"] for row in own}, reverse=True)))]
    return lines


def choice_tables(own: dict[str, list[Row]]) -> list[str]:
    """The tables of the axes that vary a choice on a few meshes."""
    lines, published = [], "Published iteration"
    results = {"iterations": "k", "n_A": "n_A", "seconds": "s", "outer_seconds": "outer iteration, s",
               "memory_mib": "MiB", "algebraic": "algebraic error", "energy": "energy norm"}
    for axis, title, text, names in (
            ("inner precision", "Inner precision", f"{published}, original algorithm without splitting, θ = 0.2.",
             {"tolerance": "tolerance", "inner_precision": "η"}),
            ("compliance", "Compliance", "Newton, tolerance 1e-8.",
             {"order": "order", "N": "N", "compliance": "compliance"}),
            ("method", "Outer method", "Tolerance 1e-6.", {"order": "order", "N": "N", "method": "method"}),
            ("variant", "Algorithm and splitting", f"{published}, tolerance 1e-4, η = 0.1.",
             {"algorithm": "algorithm", "splitting": "splitting", "theta": "θ"})):
        lines += [f"## {title}", "", text, "", *plain_table(names | results, own[axis])]
    return lines


def cheapest_tables(rows: list[Row]) -> list[str]:
    lines = ["## The cheapest way to an error", "", "Of all certified runs above to 1e-3 or tighter, the fastest whose "
             "true error in the energy norm is at most so large.", ""]
    for scene in TITLES:
        own = list(filter(trusted, where(rows, scene=scene)))
        body = []
        for target in TARGETS:
            good = [[row for row in own if row["order"] == order and row["energy"] <= target] for order in (1, 2)]
            if any(good):
                body.append([percent(target), *(_cheapest(found) for found in good)])
        lines += [f"{TITLES[scene]}:", "", *table(["error", "order 1", "order 2"], body)]
    lines += ["Fronts: runs for which no other is both faster and as accurate, within one per cent.", ""]
    for scene in TITLES:
        for quantity, name in QUANTITIES.items():
            best = front(where(rows, scene=scene), quantity)
            lines += [f"- {TITLES[scene]}, {name}: " + "; ".join(
                f"{choice(row)} ({seconds(row['seconds'])} s, {percent(row[quantity])})" for row in best) + "."]
    return [*lines, ""]


def _cheapest(rows: list[Row]) -> str:
    if not rows:
        return "none"
    best = min(rows, key=lambda row: row["seconds"])
    return (f"{choice(best)}: {seconds(best['seconds'])} s, {percent(best['energy'])}, n_A {best['n_A']}, "
            f"{best['memory_mib']:.0f} MiB")


def statement(own: dict[str, list[Row]]) -> list[str]:
    """What was measured, in words with computed numbers."""
    lines = []
    mesh = {(row["scene"], row["order"], row["N"]): row for row in own["mesh"]}
    for scene, N in (("blocks", 22), ("rings", 16)):
        one, two = mesh.get((scene, 1, 2 * N)), mesh.get((scene, 2, N))
        if one and two:
            lines.append(
                f"- {TITLES[scene]}, {one['n']} unknowns: order 2 takes {seconds(two['seconds'])} s, order 1 on meshes "
                f"twice as fine {seconds(one['seconds'])} s; errors {percent(two['energy'])} against "
                f"{percent(one['energy'])} in the energy norm, {percent(two['pressure'])} against "
                f"{percent(one['pressure'])} in the pressure at the nodes, {percent(two['side_pressure'])} against "
                f"{percent(one['side_pressure'])} in its side means.")
    for method in METHOD_COLOURS:
        found = sorted(where(own["tolerance"], scene="blocks", order=1, method=method),
                       key=lambda row: -row["tolerance"])
        above = [k for k, row in enumerate(found) if row["algebraic"] > 0.1 * row["energy"]]
        loose = next(iter(found[above[-1] + 1 if above else 0:]), None)
        if loose:
            (tight,) = where(found, tolerance=1e-8)
            lines.append(
                f"- Tolerance, {method}: from {small(loose['tolerance'])} on the algebraic error is below a tenth of "
                f"the true one (pinched blocks, order 1, N = {loose['N']}). 1e-8 takes {tight['iterations']} outer "
                f"iterations instead of {loose['iterations']}, {tight['n_A']} multiplications instead of "
                f"{loose['n_A']}, {seconds(tight['outer_seconds'])} s instead of {seconds(loose['outer_seconds'])} s.")
    for name, axis, key, base in (("Compliance", "compliance", "compliance", "explicit"),
                                  ("Outer method", "method", "method", "newton")):
        bases = {(row["order"], row["N"]): row for row in where(own[axis], **{key: base})}
        for other in dict.fromkeys(row[key] for row in own[axis] if row[key] != base):
            pairs = [(row, bases[row["order"], row["N"]]) for row in where(own[axis], **{key: other})
                     if (row["order"], row["N"]) in bases]
            lines.append(f"- {name} {other} against {base}: " + ", ".join(
                f"{words} × {spread([row[column] / least[column] for row, least in pairs])}" for words, column in
                (("outer iteration", "outer_seconds"), ("memory", "memory_mib"), ("multiplications", "n_A"))) + ".")
    for scene in TITLES:
        parts = ", ".join(f"order {order} " + spread([row["estimated"] / row["energy"] for row in where(
            own["mesh"], scene=scene, order=order)]) for order in (1, 2))
        lines.append(f"- Effectivity of the error estimate, {TITLES[scene].lower()}: {parts}.")
    return [*lines, ""]


def spread(values: list[float]) -> str:
    if not values:
        return "–"
    low, high = (f"{value:.2f}" if value < 9.95 else f"{value:.0f}" for value in (min(values), max(values)))
    return low if low == high else f"{low}–{high}"


def preset_table(rows: list[Row]) -> list[str]:
    columns = {"n": "n", "n_A": "n_A", "seconds": "s", "memory_mib": "MiB", "estimated": "estimated error"} | ERRORS
    body = [[TITLES[row["scene"]].lower(), ("fast", "balanced", "accurate")[k % 3], choice(row),
             *(show(row, column) for column in columns)] for k, row in enumerate(rows)]
    return ["## Presets", "", "What the presets make of meshes of N = 22 (blocks) and N = 16 (rings); accurate: the "
            "mesh that brings the estimate below 1 %, without the coarser meshes on the way there.", "",
            *table(["scene", "preset", "settings", *columns.values()], body)]


def page(rows: list[Row], axes: dict[str, list[tuple]]) -> str:
    """All tables, as Markdown."""
    own = {axis: pick(rows, cases) for axis, cases in axes.items()}
    most = max((row["runs"] for row in rows if np.isfinite(row["runs"])), default=0)
    return "\n".join([
        "# Accuracy and its cost", "",
        "Generated by `scripts/study tradeoff`; what it means is in [tradeoff.md](../understand/tradeoff.md). Squares "
        "(blocks) of side 1/N, rings of N × 3N cells. Seconds: mesh, assembly, factorization, outer iteration, "
        "displacements and error estimate on two ranks, the slower one; the least of up to "
        f"{most} runs. CPU s: of both ranks, waiting for the other one included. MiB: peak memory of both ranks above "
        "what they hold before. k outer iterations, n_A multiplications by A⁻¹ of both bodies.", "",
        "![time against error](figures/tradeoff_front.png)", "", "## In short", "", *statement(own),
        *preset_table(own["preset"]), *mesh_tables(own["mesh"]), *effectivity_table(own["mesh"]),
        *tolerance_tables(own["tolerance"]), "![errors against the tolerance](figures/tradeoff_tolerance.png)", "",
        *choice_tables(own), *cheapest_tables(rows)])


# Figures

def draw(rows: list[Row], axes: dict[str, list[tuple]], folder: Path) -> None:
    """Draw tradeoff_front.png, time against errors, and tradeoff_tolerance.png, errors against the tolerance."""
    save_figures(folder, {"tradeoff_front": lambda: draw_front(rows),
                          "tradeoff_tolerance": lambda: draw_tolerance(pick(rows, axes["tolerance"]))})


def draw_front(rows: list[Row]):
    """Time against error: trusted runs, those of the mesh axis joined, and the front; a figure."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(TITLES), len(QUANTITIES), figsize=(13.5, 8.0))
    for line, scene in zip(axes, TITLES, strict=True):
        for panel, (quantity, name) in zip(line, QUANTITIES.items(), strict=True):
            own = list(filter(trusted, where(rows, scene=scene)))
            best = front(own, quantity)
            if best:
                x, y = np.array([(row["seconds"], row[quantity]) for row in best]).T
                panel.step([*x, max(row["seconds"] for row in own)], [*y, y[-1]], where="post", color="#b9bec6",
                           linewidth=5, zorder=1, label="front")
            for method, marker in (("newton", "o"), ("anderson", "^"), ("relaxation", "s")):
                for order in (1, 2):
                    found = where(own, method=method, order=order)
                    panel.scatter([row["seconds"] for row in found], [row[quantity] for row in found], s=14,
                                  marker=marker, facecolors="none", edgecolors=COLOURS[order], linewidths=0.7,
                                  alpha=0.6, zorder=2, label=f"order {order}, {method}" if found else None)
            for order in (1, 2):
                meshes = sorted(where(own, order=order, method="newton", tolerance=1e-8, compliance="explicit"),
                                key=lambda row: row["N"])
                panel.plot([row["seconds"] for row in meshes], [row[quantity] for row in meshes], "o-",
                           color=COLOURS[order], markersize=5, zorder=3, label=f"order {order}, default to 1e-8")
                for row in meshes:
                    panel.annotate(f"{row['N']}", (row["seconds"], row[quantity]), textcoords="offset points",
                                   xytext=(4, 4) if order == 1 else (-4, -10), fontsize=7, color=COLOURS[order],
                                   horizontalalignment="left" if order == 1 else "right")
            panel.set(xscale="log", yscale="log", title=f"{TITLES[scene]}: {name}", xlabel="time (s)",
                      ylabel="relative error")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)
    return figure


def draw_tolerance(rows: list[Row]):
    """Algebraic and true error against the tolerance, for the meshes on which it was varied; a figure."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(TITLES), figsize=(10.5, 4.2), sharey=True)
    for panel, scene in zip(axes, TITLES, strict=True):
        own = where(rows, scene=scene, order=1)
        if not own:
            continue
        for method, colour in METHOD_COLOURS.items():
            found = sorted(where(own, method=method), key=lambda row: row["tolerance"])
            x = [row["tolerance"] for row in found]
            panel.plot(x, [row["algebraic"] or np.nan for row in found], "o-", color=colour, markersize=4,
                       label=f"{method}, algebraic error")
            panel.plot(x, [row["energy"] for row in found], "--", color=colour, label=f"{method}, true error")
        panel.set(xscale="log", yscale="log", title=f"{TITLES[scene]}, order 1, N = {own[0]['N']}", xlabel="tolerance")
        panel.invert_xaxis()
    axes[0].set_ylabel("relative error, energy norm")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)
    return figure


# In space

SPACE = "tradeoff_in_space.md"
FINE = 8
"""Cells along the short sides of the boxes of the reference solution, of order 2; N of the others divides it."""

STEPS = 32
"""Load steps of each leg of the history that the others are compared with."""


class SolidCase(NamedTuple):
    """All choices of a run in space. `N`: cells along a short side, elements on the radius of contact or across a wall;
    `shape`: "curved", or "straight" quadratic elements on curved boundaries; `steps`: of each leg, or a tolerance."""

    scene: str
    N: int
    order: int = 1
    pairing: str = NONE
    shape: str = NONE
    tolerance: float = 1e-8
    steps: float | str = NONE


SHAPES = ((1, NONE), (2, "straight"), (2, "curved"))
SOLIDS = [*(SolidCase("boxes", N, order, pairing) for order, meshes in ((1, (2, 4, 8)), (2, (2, 4))) for N in meshes
            for pairing in (("nodes", "mortar", "unlike") if order == 1 else ("mortar", "unlike"))),
          *(SolidCase("boxes", 4, 1, "nodes", tolerance=tolerance) for tolerance in (1e-2, 1e-3, 1e-4, 1e-6)),
          *(SolidCase("ball", N, order, shape=shape) for order, shape in SHAPES for N in (3, 5)),
          *(SolidCase("tubes", N, order, shape=shape) for order, shape in SHAPES for N in (2, 4)),
          *(SolidCase("history", 4, steps=steps) for steps in (1, 2, 4, 8, 16, 0.1, 0.02))]
SOLID_ERRORS = {"boxes": {"one": "energy norm", "two": "normal force", "three": "tangential force",
                          "four": "displacement of a corner"},
                "ball": {"one": "greatest pressure", "two": "radius of contact"},
                "tubes": {"one": "mean pressure", "two": "pressure at nodes, L2"},
                "history": {"one": "tangential force at the end", "two": "dissipated energy"}}
"""What the columns of errors are, by the scene."""

SOLID_TITLES = {"boxes": "Two boxes with Coulomb friction", "ball": "A ball on a rigid plane",
                "tubes": "Two tubes with interference", "history": "Boxes pressed, sheared and sheared back"}
SOLID_COLUMNS = ("n", "outcome", "iterations", "n_A", "cpu_seconds", "estimated", "one", "two", "three", "four")


def solid_scene(case: SolidCase, folder: Path) -> dict:
    """The scene of a case."""
    method = {"method": {"tolerance": case.tolerance}}
    if case.scene in ("boxes", "history"):
        other = {"pairing": case.pairing} if case.pairing in ("nodes", "mortar") else {}
        scene = two_boxes(case.N, case.N + 1 if case.pairing == "unlike" else None, case.order, **other)
        if case.scene == "history":
            upper, lower = scene["body"]
            upper["traction"] = [{"on": "back", "value": [0.0, -6e7, 0.0], "history": "press"},
                                 {"on": "right", "value": [2e7, 0.0, 2e7], "history": "shear"}]
            lower["traction"] = []
            scene["history"] = {"press": {"times": [0.0, 1.0], "factors": [0.0, 1.0]},
                                "shear": {"times": [1.0, 2.0, 3.0], "factors": [0.0, 1.0, -1.0]}}
            way = {"tolerance": case.steps} if case.steps < 1 else {"steps": int(case.steps)}
            scene["time"] = {"points": [1.0, 2.0, 3.0]} | way
        return scene | method
    drawn = 1 if case.shape == "straight" else case.order
    if case.scene == "ball":
        mesh = half_ball(folder / "ball.msh", 0.1, 0.088 / case.N, drawn) | {"order": case.order}
        floor = {"name": "floor", "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}
        return {"body": [{"name": "ball", "mesh": mesh, "material": {"young": 1.0, "poisson": 0.3},
                          "clamp": [*PLANES, {"on": "top", "z": -0.0075}]}],
                "rigid": [floor], "contact": [{"bodies": ["ball", "floor"], "on": ["contact"]}]} | method
    ends = [*PLANES, {"on": "bottom", "z": 0.0}, {"on": "top", "z": 0.0}]
    walls = {"inner": (0.3, 0.6 + FIT, 0.3 / case.N), "outer": (0.6, 0.9, 0.24 / case.N)}
    return {"body": [{"name": name, "material": {"young": 2e11, "poisson": 0.3}, "clamp": ends, "mesh": tube(
        folder / f"{name}.msh", *wall, drawn) | {"order": case.order}} for name, wall in walls.items()],
            "contact": [{"bodies": ["inner", "outer"], "on": ["outer", "inner"]}]} | method


SHORT = 0.5
"""Runs of less processor time are repeated (s)."""

FIT = 6e-5
"""Interference of the tubes (m)."""


class Space:
    """The measurements in space, and the solutions with which they are compared; meshes go into the folder."""

    def __init__(self, folder: Path, finest: int) -> None:
        self.folder, self.finest = folder / "meshes", finest
        self.folder.mkdir(parents=True, exist_ok=True)

    def solved(self, case: SolidCase) -> tuple[Answer, float]:
        """The answer on this rank alone, and the processor time that it took; the least of up to three runs."""
        text, least = to_toml(solid_scene(case, self.folder)), np.inf
        for _ in range(3):
            start = time.process_time()
            answer = ddmpi.solve(text, MPI.COMM_SELF)
            least = min(least, time.process_time() - start)
            if least > SHORT:
                break
        return answer, least

    def measure(self, case: SolidCase) -> Row:
        """A line of the table."""
        answer, least = self.solved(case)
        summary = answer.summary
        errors = {"boxes": self.of_boxes, "ball": self.of_ball, "tubes": self.of_tubes,
                  "history": self.of_history}[case.scene](answer)
        named = dict(zip(("one", "two", "three", "four"), errors, strict=False))
        return dict.fromkeys(SOLID_COLUMNS, np.nan) | named | {
            "n": summary["n"], "outcome": "certified" if answer.certified else answer.reason, "cpu_seconds": least,
            "iterations": sum(step["outer_iterations"] for step in summary["steps"]), "n_A": summary["n_A"],
            "estimated": (summary["discretization_error"] or {}).get("energy_norm") or np.nan}

    @functools.cached_property
    def fine(self) -> Answer:
        return self.solved(SolidCase("boxes", self.finest, 2, "mortar"))[0]

    @property
    def own(self) -> float:
        """The estimated error of the fine solution, in the energy norm."""
        return self.fine.summary["discretization_error"]["energy_norm"]

    @functools.cached_property
    def stiffness(self) -> sparse.csr_matrix:
        """Of one of the two boxes of the fine solution, which are alike."""
        from by_skfem import stiffness_of

        body = self.fine.solved.assembly.bodies[0]
        return stiffness_of(body.mesh, body.spec.material)

    def of_boxes(self, answer: Answer) -> list[float]:
        """Errors against the fine solution, whose own estimated error is added in squares to the first one."""
        far, whole = np.zeros(2)
        for name, fine in self.fine.bodies.items():
            mesh = next(each.mesh for each in answer.solved.assembly.bodies if each.spec.name == name)
            coarse = in_box(mesh.points, answer.bodies[name].displacement, mesh.order, fine.points)
            for k, v in enumerate((fine.displacement - coarse, fine.displacement)):
                part = v.ravel() @ (self.stiffness @ v.ravel())
                far, whole = (far + part, whole) if k == 0 else (far, whole + part)
        contacts = [each.summary["contacts"]["upper-lower"] for each in (answer, self.fine)]
        ends = [each.bodies["upper"].displacement[np.argmax(each.bodies["upper"].points.sum(axis=1))]
                for each in (answer, self.fine)]
        return [float(np.hypot(np.sqrt(far / whole), self.own)),
                *(relative(*(each[key] for each in contacts)) for key in ("normal_force", "tangential_force")),
                float(np.linalg.norm(ends[0] - ends[1]) / np.linalg.norm(ends[1]))]

    def of_ball(self, answer: Answer) -> list[float]:
        values, _ = hertz_values(answer.contacts["ball-floor"], 4, 1.0 / (1.0 - 0.09), 1.0, (1.0, 1.0))
        return [abs(value.error) for value in values.values()]

    def of_tubes(self, answer: Answer) -> list[float]:
        a, b, c, E, nu = 0.3, 0.6, 0.9, 2e11, 0.3
        young, poisson = E / (1 - nu**2), nu / (1 - nu)
        exact = FIT * young / b / ((b**2 + a**2) / (b**2 - a**2) - poisson + (c**2 + b**2) / (c**2 - b**2) + poisson)
        state = answer.contacts["inner-outer"]
        area = state.interface.area
        return [relative(float(state.normal_force.sum() / area.sum()), exact),
                difference(state.pressure, np.full(len(area), exact), area)]

    @functools.cached_property
    def many_steps(self) -> dict:
        return self.solved(SolidCase("history", 4, steps=STEPS))[0].summary["contacts"]["upper-lower"]

    def of_history(self, answer: Answer) -> list[float]:
        found, exact = answer.summary["contacts"]["upper-lower"], self.many_steps
        off = np.subtract(found["force"], exact["force"])[[0, 2]]
        return [float(np.linalg.norm(off) / np.linalg.norm(np.array(exact["force"])[[0, 2]])),
                relative(found["dissipated"], exact["dissipated"])]


def in_box(points: np.ndarray, u: np.ndarray, order: int, at: np.ndarray) -> np.ndarray:
    """The displacement u (n, 3) of a box's nodes `points` (n, 3), cells of a grid cut after Kuhn, at others (k, 3).

    In a cell the corners on the way from the least to the greatest go along the axes in the order of the coordinates.
    """
    low, size = points.min(axis=0), np.ptp(points, axis=0)
    number = np.array([len(np.unique(np.round(points[:, k] / size[k] * 1e6))) - 1 for k in range(3)]) // order
    place = np.full(2 * number + 1, -1)
    place[tuple(np.round((points - low) / size * 2 * number).astype(int).T)] = np.arange(len(points))
    x = (at - low) / size * number
    cell = np.clip(np.floor(x + 1e-9), 0, number - 1)
    inside = np.clip(x - cell, 0.0, 1.0)
    axes = np.argsort(-inside, axis=1, kind="stable")
    down = np.take_along_axis(inside, axes, axis=1)
    part = -np.diff(np.column_stack([np.ones(len(at)), down, np.zeros(len(at))]), axis=1)
    corner = cell[:, None] + np.concatenate([np.zeros((len(at), 1, 3)), np.cumsum(np.eye(3)[axes], axis=1)], axis=1)
    twice = np.round(2 * corner).astype(int)

    def of(nodes: np.ndarray) -> np.ndarray:
        return u[place[tuple(nodes.T)]]

    if order == 1:
        return sum(part[:, i, None] * of(twice[:, i]) for i in range(4))
    found = sum((part[:, i] * (2 * part[:, i] - 1))[:, None] * of(twice[:, i]) for i in range(4))
    return found + sum((4 * part[:, i] * part[:, j])[:, None] * of((twice[:, i] + twice[:, j]) // 2)
                       for i in range(4) for j in range(i))


def solid_choice(row: Row) -> str:
    """A case in words, without its scene."""
    words = {"nodes": "pairs", "mortar": "mortar", "unlike": "meshes that do not match"}
    if row["scene"] == "history":
        return f"tolerance {row['steps']:g}" if row["steps"] < 1 else f"{row['steps']} steps a leg"
    more = [words.get(row["pairing"], ""), row["shape"] if row["shape"] != NONE else "",
            f"to {row['tolerance']:.0e}" if row["tolerance"] != 1e-8 else ""]
    return ", ".join([f"order {row['order']}", f"N = {row['N']}", *filter(None, more)])


def space_page(rows: list[Row], own: float) -> str:
    """The tables of space, as Markdown; `own` is the error of the reference of the boxes."""
    lines = ["# Accuracy and its cost in space", "",
             "Generated by `scripts/study tradeoff_in_space`; what it means is in "
             "[tradeoff.md](../understand/tradeoff.md). CPU s: processor time of one rank for all but start-up and "
             "files, the least of up to three runs. N: cells along the short sides of boxes (3 m × 1 m × 1 m), "
             "elements on the radius of contact, or across a wall. k: outer iterations. Boxes are compared with a "
             f"solution of order 2 with N = {FINE}, whose own estimated error is {percent(own)} of the energy norm and "
             f"is counted in, the history with {STEPS} steps "
             "a leg on the same mesh.", "", "## The cheapest way to an error", "",
             "Of the certified runs below to 1e-3 or tighter.", ""]
    body = []
    for scene, errors in SOLID_ERRORS.items():
        own = [row for row in where(rows, scene=scene) if row["outcome"] == "certified" and row["tolerance"] <= LOOSEST]
        for key, words in errors.items():
            found = [[row for row in own if row[key] <= target] for target in (0.1, 0.05, 0.02, 0.01)]
            best = [min(some, key=lambda row: row["cpu_seconds"]) if some else None for some in found]
            body.append([SOLID_TITLES[scene], words, *(
                f"{solid_choice(row)}: {row['cpu_seconds']:.2g} s" if row else "–" for row in best)])
    lines += table(["scene", "error of", "10 %", "5 %", "2 %", "1 %"], body)
    for scene, errors in SOLID_ERRORS.items():
        lines += [f"## {SOLID_TITLES[scene]}", "", *table(
            ["choice", "n", "k", "n_A", "CPU s", *errors.values(), "estimated"],
            ([solid_choice(row) + failed(row), row["n"], row["iterations"], row["n_A"], f"{row['cpu_seconds']:.2g}",
              *(percent(row[key]) for key in errors), percent(row["estimated"])] for row in where(rows, scene=scene)))]
    return "\n".join(lines)


def tradeoff_in_space() -> None:
    """What accuracy costs in space: processor time and multiplications against true errors.

    Two boxes with Coulomb friction against a fine solution, a ball on a plane and tubes with interference against
    closed forms, a load and its way back against many load steps: meshes and orders, pairs or mortar, straight or
    curved elements, tolerances, load steps. On one rank.

    Writes to the folder --output: solids.csv (a line per case, written at once, so that an interrupted study continues)
    and tradeoff_in_space.md, which is also written to docs/tables/ once all scenes are done.
    """
    parser = arguments(tradeoff_in_space.__doc__, "tradeoff_in_space")
    parser.add_argument("--scenes", nargs="+", default=list(SOLID_TITLES), choices=SOLID_TITLES, metavar="SCENE",
                        help="which of %(choices)s (default: all)")
    parser.add_argument("--finest", type=int, default=FINE, metavar="N",
                        help="mesh of the boxes' reference; cases with a larger N, and boxes of which it is no "
                             "multiple, are left out (default: %(default)s)")
    options = parser.parse_args()
    space = Space(options.output, options.finest)
    cases = [case for case in SOLIDS if case.scene in options.scenes and options.finest >= case.N
             and (case.scene != "boxes" or options.finest % case.N == 0)]
    rows = Ledger(MPI.COMM_SELF, options.output / "solids.csv", SolidCase._fields, SOLID_COLUMNS).fill(
        cases, lambda *key: space.measure(SolidCase(*key)))
    complete = (options.finest, options.scenes) == (FINE, list(SOLID_TITLES))
    publish(SPACE, space_page(rows, space.own if "boxes" in options.scenes else np.nan), options.output, complete)
    print(f"The page is in {options.output}")


@on_two_ranks
def tradeoff(world: MPI.Comm) -> None:
    parser = arguments(__doc__, "tradeoff")
    parser.add_argument("--axes", nargs="+", default=list(AXES), choices=AXES, metavar="AXIS",
                        help="which of %(choices)s (default: all)")
    parser.add_argument("--reference", type=int, default=REFERENCE, metavar="N",
                        help="mesh of the reference solution; cases on finer meshes, and blocks on meshes of which it "
                             "is no multiple, are left out (default: %(default)s)")
    parser.add_argument("--repeats", type=int, default=REPEATS, metavar="R",
                        help="a case is timed so many times (default: %(default)s)")
    options = parser.parse_args()

    study = Study(world, options.output, options.reference, options.repeats)
    finest = options.reference
    cases = {case for axis in options.axes for case in AXES[axis]
             if finest >= case.N and (case.scene == "rings" or finest % case.N == 0)}
    run_once(world, study.scene(Case("blocks", 4)))  # imports what is imported where it is used
    ledger = Ledger(world, options.output / "tradeoff.csv", Case._fields, MEASURED)
    rows = ledger.fill(sorted(cases, key=lambda case: (case[:3], str(case))), lambda *case: study.measure(Case(*case)))
    if world.rank == 0:
        complete = (options.axes, options.reference, options.repeats) == (list(AXES), REFERENCE, REPEATS)
        publish(PAGE, page(rows, AXES), options.output, complete, functools.partial(draw, rows, AXES))
        print(f"Page and figures are in {options.output}")


if __name__ == "__main__":
    start(tradeoff, tradeoff_in_space)
