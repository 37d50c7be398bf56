#!/usr/bin/env bash
"exec" "bash" "-c" '. "${0%/*}/setup.sh"; exec "$PYTHON" "$0" "$@"' "$0" "$@"  # to Python, a string

__doc__ = """What a Schur complement costs beside a plain factorization, on meshes of several kinds, and where it goes.

    scripts/orderings.py --meshes squares:86 gmsh:200      # these two

A mesh is KIND:SIZE, both bodies of elements of side 1/SIZE: squares, and quadratic of order 2, are structured; gmsh,
and curved (bent upwards, of order 2), are not. On two ranks, which hold the two pinched blocks and start together:

  schur      a factorization with the inverse of the Schur complement on the contact, and one solve; rows as in the mesh
  farthest   the same, rows by falling distance from the contact, as the program has them from 10,000 nodes on
  plain      a factorization without a Schur complement, by minimum fill, and one solve
  outer      the outer iteration of the default method

They are done in turns, --turns times, in each of --repeats commands; of each the fastest counts, in the slower rank.
Seconds are of wall time; user and system are the parts of processor time. The system gives memory that is touched
first: on a virtual machine that may take as long as all the rest, so compare user times. Operations are MUMPS's count.

Writes to the folder --output orderings.csv (a line per command, written at once, so that an interrupted study
continues) and orderings_table.md; with all meshes also to docs/tables/. Nothing else should run meanwhile.
"""

import argparse
import json
import resource
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, publish, table, where
from mpi4py import MPI
from petsc4py import PETSc

from ddmpi.body.elasticity import assemble
from ddmpi.body.solver import StiffnessSolver
from ddmpi.coupling.assembly import prepare
from ddmpi.run.solve import solve
from ddmpi.scene.reader import read_scene_file
from ddmpi.system.clock import Clock

sys.path.insert(0, str(ROOT / "tests"))

from scenes import run_python

MESHES = ("squares:86", "squares:200", "squares:320", "quadratic:86", "gmsh:200", "curved:86")
BODIES = ("lower", "upper")
KINDS = ("schur", "farthest", "plain")
EVENTS = {"analysis": "MatCholFctrSym", "numeric": "MatCholFctrNum", "solve": "MatSolve"}
FIGURES = ("wall", "user", "system", "operations", *EVENTS)
MEASURED = ("n", "k", "outer", *(f"{kind}_{figure}" for kind in KINDS for figure in FIGURES))


def draw(path: Path, bottom: float, size: float, order: int, bend: float) -> None:
    """A block from gmsh, 3 by 1; its lower and upper side are arcs that rise by `bend`."""
    import gmsh

    gmsh.initialize(interruptible=False)
    gmsh.option.setNumber("General.Terminal", 0)
    geo = gmsh.model.geo
    corners = [geo.addPoint(x, bottom + y, 0, size) for x, y in ((0, 0), (3, 0), (3, 1), (0, 1))]
    lines = [geo.addLine(*corners[1:3]), geo.addLine(corners[3], corners[0])]
    for y, ends in ((0, corners[:2]), (1, corners[2:])):
        middle = geo.addPoint(1.5, bottom + y + bend / 2 - 1.5**2 / (2 * bend), 0) if bend else None
        lines.append(geo.addCircleArc(ends[0], middle, ends[1]) if bend else geo.addLine(*ends))
    right, left, lower, upper = lines
    surface = geo.addPlaneSurface([geo.addCurveLoop([lower, right, upper, left])])
    geo.synchronize()
    for name, line in {"right": right, "left": left, "bottom": lower, "top": upper}.items():
        gmsh.model.addPhysicalGroup(1, [line], name=name)
    gmsh.model.addPhysicalGroup(2, [surface], name="block")
    gmsh.model.mesh.generate(2)
    gmsh.model.mesh.setOrder(order)
    gmsh.write(str(path))
    gmsh.finalize()


def settings(kind: str, size: int, folder: Path) -> list[str]:
    """The settings of the scene that give it these meshes; files are written to `folder`."""
    order = 2 if kind in ("quadratic", "curved") else 1
    if kind in ("squares", "quadratic"):
        return [f"body.{name}.mesh.{key}" for name in BODIES
                for key in (f"divisions=[{3 * size}, {size}]", f"order={order}")]
    for bottom, name in enumerate(BODIES):
        draw(folder / f"{name}.msh", bottom, 1 / size, order, 0.3 if kind == "curved" else 0.0)
    return [f'body.{name}.mesh={{file="{folder / name}.msh", order={order}}}' for name in BODIES]


def fastest(rows: list[Row]) -> Row:
    """All figures of each kind from the row in which it took the least time; the least of the others."""
    best = {name: min(row[name] for row in rows) for name in MEASURED}
    for kind in KINDS:
        row = min(rows, key=lambda row, kind=kind: row[f"{kind}_wall"])
        best |= {name: row[name] for name in MEASURED if name.startswith(kind)}
    return best


def timed(do: Callable[[], float]) -> dict[str, float]:
    """What it costs to `do`, which returns the count of operations."""
    spent = resource.getrusage(resource.RUSAGE_SELF)
    events = {name: PETSc.Log.Event(event).getPerfInfo()["time"] for name, event in EVENTS.items()}
    start = time.perf_counter()
    operations = do()
    found = {"wall": time.perf_counter() - start, "operations": operations}
    now = resource.getrusage(resource.RUSAGE_SELF)
    found |= {"user": now.ru_utime - spent.ru_utime, "system": now.ru_stime - spent.ru_stime}
    return found | {name: PETSc.Log.Event(event).getPerfInfo()["time"] - events[name] for name, event in EVENTS.items()}


def measure(world: MPI.Comm, turns: int, scene_settings: list[str]) -> dict[str, float]:
    """The columns of a row. Collective."""
    PETSc.Log.begin()
    scene = read_scene_file(ROOT / "configs" / "pinched_blocks.toml", scene_settings)
    assembly = prepare(world, scene)
    (body,), C, nodes = assembly.bodies, assembly.member.C, assembly.member.elasticity.nodes
    dofs = np.unique(C.B.indices[C.B.data != 0.0])
    nodes, component = nodes[dofs // 2], dofs % 2
    systems = {}
    for kind in KINDS:
        elasticity = assemble(body.mesh, body.spec, last=nodes if kind == "farthest" else None)
        place = np.empty(len(body.mesh.points), int)
        place[elasticity.nodes] = np.arange(len(elasticity.nodes))
        systems[kind] = elasticity.A, elasticity.b, None if kind == "plain" else np.sort(2 * place[nodes] + component)

    def factor_and_solve(kind: str) -> float:
        A, b, contact = systems[kind]
        solver = StiffnessSolver(A, kind, contact)
        solver.solve(b, b.duplicate())
        return solver.ksp.getPC().getFactorMatrix().getMumpsRinfog(1)

    found = []
    for turn in range(turns):
        clock = Clock()
        world.Barrier()
        solution = solve(assembly, scene.method, clock=clock)
        if not solution.certified:
            raise RuntimeError(solution.reason)
        row = {"n": systems["plain"][0].size[0], "k": len(dofs), "outer": clock.seconds["outer"]}
        for kind in KINDS if turn % 2 else KINDS[::-1]:
            world.Barrier()
            row |= {f"{kind}_{name}": value for name, value in timed(lambda kind=kind: factor_and_solve(kind)).items()}
        slower = np.max(world.allgather([row[name] for name in MEASURED]), axis=0)
        found.append(dict(zip(MEASURED, slower.tolist(), strict=True)))
    return fastest(found)


def run(mesh: str, turns: int) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        kind, size = mesh.split(":")
        child = run_python(["-m", "mpi4py", __file__, "--turns", str(turns), "--measure",
                            *settings(kind, int(size), Path(folder))], limit=1800.0)
    if child.code:
        sys.exit(child.output)
    return {name: round(value, 5) for name, value in json.loads(child.stdout.splitlines()[-1]).items()}


def page(rows: list[Row], meshes: list[str]) -> str:
    lines, parts = [], []
    for mesh in meshes:
        own = fastest(where(rows, mesh=mesh))
        lines.append([mesh, f"{own['n']:,.0f}", f"{own['k']:.0f}", f"{own['outer']:.3f}",
                      *(f"{own[f'{kind}_operations'] / 1e9:.3g}" for kind in KINDS),
                      *(f"{(own[f'{kind}_{time}'] + own['outer']) / own[f'plain_{time}']:.2f}"
                        for kind in KINDS[:2] for time in ("wall", "user"))])
        parts += [[mesh, kind, *(f"{own[f'{kind}_{name}']:.3f}" for name in ("wall", "user", "system", *EVENTS))]
                  for kind in KINDS]
    return "\n".join([
        "# What a Schur complement costs", "",
        "Generated by `scripts/orderings.py`, which says what is measured: pinched blocks, a rank each, the larger "
        "figure of both. n and k are the dofs of a body and those at its contact; operations are in 10⁹. The ratios "
        "are (factor + outer) / plain. Aims: 1.8 for squares at 86, 1.55 at 200 and 320, 1.4 on other meshes.", "",
        *table(["mesh", "n", "k", "outer", *(f"operations: {kind}" for kind in KINDS),
                *(f"ratio, {kind}: {time}" for kind in KINDS[:2] for time in ("wall", "user"))], lines),
        "## Where the seconds go", "", "The factorization with its solve, in all; and wall time of three parts.", "",
        *table(["mesh", "", "wall", "user", "system", *EVENTS], parts)])


def main() -> None:
    parser = arguments(__doc__, "orderings")
    parser.add_argument("--meshes", nargs="+", default=list(MESHES), metavar="KIND:SIZE", help="default: %(default)s")
    parser.add_argument("--repeats", type=int, default=2, help="commands for each mesh; default: %(default)s")
    parser.add_argument("--turns", type=int, default=2, help="within a command; default: %(default)s")
    parser.add_argument("--measure", nargs="+", help=argparse.SUPPRESS)  # for the processes that measure
    options = parser.parse_args()
    if options.measure:
        found = measure(MPI.COMM_WORLD, options.turns, options.measure)
        print(json.dumps(found) if MPI.COMM_WORLD.rank == 0 else "", end="")
        return
    ledger = Ledger(MPI.COMM_WORLD, options.output / "orderings.csv", ("mesh", "repetition"), MEASURED)
    rows = ledger.fill([(mesh, k) for k in range(options.repeats) for mesh in options.meshes],
                       lambda mesh, _: run(mesh, options.turns))
    publish("orderings_table.md", page(rows, options.meshes), options.output, set(MESHES) <= set(options.meshes))
    print(page(rows, options.meshes))


if __name__ == "__main__":
    main()
