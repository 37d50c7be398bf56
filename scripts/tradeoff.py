#!/usr/bin/env bash
"exec" "${0%/*}/on_two_ranks.sh" "$0" "$@"  # to Python, a string

__doc__ = """What accuracy costs: time, multiplications and memory against true errors.

Two scenes, pinched blocks with Coulomb friction and two rings with a closed form (true_errors.py, rings.py), along
axes that each vary one choice: mesh and order, tolerance, inner precision, compliance, outer method, algorithm and
splitting. The time is that of mesh, assembly, factorization, outer iteration, displacements and error estimate, of the
slower rank, the least of several runs where they are short; start-up and files are left out.

Writes to the folder --output: tradeoff.csv (a line per case, written at once, so that an interrupted study continues),
tradeoff_table.md and figures; once all axes are done with the usual reference, page and figures are also written to
docs/tables/.
"""

import ctypes
import functools
import gc
import time
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

import numpy as np
from experiment import VARIANTS, Ledger, Row, arguments, on_two_ranks, pinched_blocks, publish
from mpi4py import MPI
from rings import Rings
from tradeoff_page import PAGE, draw, page
from true_errors import ClosedForm, Errors, FineSolution, energy, own_body, solve_reference

from ddmpi.body.estimate import estimate_error, relative_error
from ddmpi.coupling.assembly import Assembly, prepare
from ddmpi.errors import SolverError
from ddmpi.petsc.versions import free_garbage
from ddmpi.run.solve import Solution, solve
from ddmpi.scene.scene import Settled
from ddmpi.system.clock import Clock

REFERENCE = 176
"""Squares of the reference solution, of order 2, have sides of 1/176 m; all others have a multiple of that."""

TIGHT, REFERENCE_TOLERANCE = 1e-12, 1e-10
"""Tolerances of the solutions with which algebraic errors are measured, and of the reference solution."""

REPEATS, ENOUGH = 7, 2.0
"""A case is timed so many times, or until that many seconds are spent on it."""

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


METHODS = ("newton", "anderson", "relaxation")
MESHES = {("blocks", 1): (4, 8, 11, 16, 22, 44, 88, 176), ("blocks", 2): (4, 8, 11, 16, 22, 44, 88),
          ("rings", 1): (4, 8, 16, 32, 64, 128), ("rings", 2): (4, 8, 16, 32, 64)}
MIDDLE = {"blocks": 44, "rings": 32}
"""The mesh on which the choices other than the mesh are varied."""

TOLERANCES = tuple(float(f"1e-{k}") for k in range(1, 11))

AXES = {
    "mesh": [Case(scene, N, order) for (scene, order), meshes in MESHES.items() for N in meshes],
    "tolerance": [by_method(method, scene, N, order, tolerance) for scene, N in MIDDLE.items() for order in (1, 2)
                  for method in (METHODS if order == 1 else METHODS[:1]) for tolerance in TOLERANCES],
    "inner precision": [relaxation("blocks", MIDDLE["blocks"], inner_precision=eta, tolerance=tolerance)
                        for tolerance in (1e-4, 1e-6) for eta in (1.0, 0.3, 0.1, 0.03, 0.01, "fixed")],
    "compliance": [Case("blocks", N, order, compliance=kind) for order, meshes in ((1, (22, 44, 88)), (2, (22, 44)))
                   for N in meshes for kind in ("explicit", "direct", "iterative")
                   if kind != "iterative" or N * order <= 44],
    "method": [by_method(method, "blocks", N, order, 1e-6) for order, N in ((1, 22), (1, 88), (2, 22))
               for method in METHODS],
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
    """

    def __init__(self, world: MPI.Comm, folder: Path, reference: int) -> None:
        self.world, self.folder, self.reference = world, folder, reference
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
            while runs < REPEATS and spent < ENOUGH:
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


@on_two_ranks
def main(world: MPI.Comm) -> None:
    parser = arguments(__doc__, "tradeoff")
    parser.add_argument("--axes", nargs="+", default=list(AXES), choices=AXES, metavar="AXIS",
                        help="which of %(choices)s (default: all)")
    parser.add_argument("--reference", type=int, default=REFERENCE, metavar="N",
                        help="mesh of the reference solution; cases on finer meshes, and blocks on meshes of which it "
                             "is no multiple, are left out (default: %(default)s)")
    options = parser.parse_args()

    study = Study(world, options.output, options.reference)
    finest = options.reference
    cases = {case for axis in options.axes for case in AXES[axis]
             if finest >= case.N and (case.scene == "rings" or finest % case.N == 0)}
    run_once(world, study.scene(Case("blocks", 4)))  # imports what is imported where it is used
    ledger = Ledger(world, options.output / "tradeoff.csv", Case._fields, MEASURED)
    rows = ledger.fill(sorted(cases, key=lambda case: (case[:3], str(case))), lambda *case: study.measure(Case(*case)))
    if world.rank == 0:
        complete = options.axes == list(AXES) and options.reference == REFERENCE
        publish(PAGE, page(rows, AXES), options.output, complete, functools.partial(draw, rows, AXES))
        print(f"Page and figures are in {options.output}")


main()
