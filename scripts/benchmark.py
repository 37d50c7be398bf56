#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""What runs cost: beside plain factorizations, in what ordering, of large bodies, the start, on several ranks a body.

A study is a function of STUDIES, started by its name: scripts/study orderings. Tables are written row by row, so that
an interrupted study continues. Nothing else should run meanwhile.
"""

import argparse
import gc
import json
import math
import os
import re
import resource
import statistics
import subprocess
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
import scipy.sparse as sparse
from experiment import ROOT, Ledger, Row, arguments, processor, publish, save_figures, start, table, where
from experiment import seconds as as_written
from mpi4py import MPI
from petsc4py import PETSc
from scenes import run_command, run_python
from solids import body, box, hold

from ddmpi.body.elasticity import assemble
from ddmpi.body.solver import StiffnessSolver
from ddmpi.coupling.assembly import prepare
from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.read import gmsh_session
from ddmpi.petsc.dissection import elimination_order
from ddmpi.results.tables import read_results
from ddmpi.run.solve import solve
from ddmpi.scene.bodies import Traction
from ddmpi.scene.reader import read_scene_file
from ddmpi.system.agreement import LOCKSTEP
from ddmpi.system.clock import Clock
from ddmpi.system.provenance import versions

# Orderings

MESHES = ("squares:86", "squares:200", "squares:320", "quadratic:86", "gmsh:200", "curved:86")
BOTH = ("lower", "upper")
KINDS = ("schur", "degree", "inverse", "plain")
THROUGH_PETSC = "body_mat_mumps_icntl_10"
"""An option that MUMPS is not called directly with."""

FIGURES = ("wall", "user", "system", "operations", "memory")
ORDERINGS = ("n", "k", "outer", "outer_user", *(f"{kind}_{figure}" for kind in KINDS for figure in FIGURES))


def draw_block(path: Path, bottom: float, size: float, order: int, bend: float) -> None:
    """A block from gmsh, 3 by 1; its lower and upper side are arcs that rise by `bend`."""
    with gmsh_session() as gmsh:
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


def settings(kind: str, size: int, folder: Path) -> list[str]:
    """The settings of the scene that give it these meshes; files are written to `folder`."""
    order = 2 if kind in ("quadratic", "curved") else 1
    if kind in ("squares", "quadratic"):
        return [f"body.{name}.mesh.{key}" for name in BOTH
                for key in (f"divisions=[{3 * size}, {size}]", f"order={order}")]
    for bottom, name in enumerate(BOTH):
        draw_block(folder / f"{name}.msh", bottom, 1 / size, order, 0.3 if kind == "curved" else 0.0)
    return [f'body.{name}.mesh={{file="{folder / name}.msh", order={order}}}' for name in BOTH]


def fastest(rows: list[Row]) -> Row:
    """All figures of each kind from the row in which it took the least time; the least of the others."""
    best = {name: min(row[name] for row in rows) for name in ORDERINGS}
    for kind in KINDS:
        row = min(rows, key=lambda row, kind=kind: row[f"{kind}_wall"])
        best |= {name: row[name] for name in ORDERINGS if name.startswith(kind)}
    return best


def timed(do: Callable[[], Row | None]) -> Row:
    """What it costs to `do`, beside what that returns."""
    spent, start = resource.getrusage(resource.RUSAGE_SELF), time.perf_counter()
    found = do()
    wall, now = time.perf_counter() - start, resource.getrusage(resource.RUSAGE_SELF)
    found = {"user": now.ru_utime - spent.ru_utime, "system": now.ru_stime - spent.ru_stime} | (found or {})
    return found | {"wall": wall}


def factor_and_solve(kind: str, A: PETSc.Mat, b: PETSc.Vec, B: sparse.csr_matrix, points: np.ndarray) -> Row:
    """MUMPS's count of operations, and the megabytes that it took."""
    order, options = elimination_order(A, points) if kind == "schur" else None, PETSc.Options()
    if kind == "inverse":
        options.setValue(THROUGH_PETSC, 0)
    solver = StiffnessSolver(A, kind, None if kind == "plain" else B, order)
    options.delValue(THROUGH_PETSC)
    solver.solve(b, b.duplicate())
    if solver._factors:
        data = solver._factors._data
        found = {"operations": data.rinfog[2], "memory": data.infog[21]}
    else:
        factor = solver.ksp.getPC().getFactorMatrix()
        found = {"operations": factor.getMumpsRinfog(3), "memory": factor.getMumpsInfog(22)}
    solver.destroy()
    return found


def measure_mesh(world: MPI.Comm, turns: int, scene_settings: list[str]) -> dict[str, float]:
    """The columns of a row. Collective."""
    scene = read_scene_file(ROOT / "configs" / "pinched_blocks.toml", scene_settings)
    assembly = prepare(world, scene)
    (own,), member = assembly.bodies, assembly.member
    system = (member.elasticity.A, member.elasticity.b, member.C.B, own.mesh.points[member.elasticity.nodes])

    def iterate() -> None:
        clock = Clock()
        solution = solve(assembly, scene.method, clock=clock)
        if not solution.certified:
            raise RuntimeError(solution.reason)
        row["outer"] = clock.seconds["outer"]

    found = []
    for turn in range(turns):
        row = {"n": system[0].size[0], "k": member.C.size}
        world.Barrier()
        row["outer_user"] = timed(iterate)["user"]
        for kind in KINDS if turn % 2 else KINDS[::-1]:
            world.Barrier()
            spent = timed(lambda kind=kind: factor_and_solve(kind, *system))
            row |= {f"{kind}_{name}": value for name, value in spent.items()}
        slower = np.max(world.allgather([row[name] for name in ORDERINGS]), axis=0)
        found.append(dict(zip(ORDERINGS, slower.tolist(), strict=True)))
    return fastest(found)


def factor_in_turns(mesh: str, turns: int) -> Row:
    with tempfile.TemporaryDirectory() as folder:
        kind, size = mesh.split(":")
        child = run_python(["-m", "mpi4py", __file__, "orderings", "--turns", str(turns), "--measure",
                            *settings(kind, int(size), Path(folder))], limit=1800.0)
    if child.code:
        sys.exit(child.output)
    return {name: round(value, 5) for name, value in json.loads(child.stdout.splitlines()[-1]).items()}


def orderings_page(rows: list[Row], meshes: list[str]) -> str:
    lines, parts = [], []
    for mesh in meshes:
        own = fastest(where(rows, mesh=mesh))
        lines.append([mesh, f"{own['n']:,.0f}", f"{own['k']:.0f}", f"{own['outer']:.3f}",
                      *(f"{own[f'{kind}_operations'] / 1e9:.3g}" for kind in KINDS),
                      *(f"{(own[f'{kind}_{time}'] + own[outer]) / own[f'plain_{time}']:.2f}"
                        for kind in KINDS[:3] for time, outer in (("wall", "outer"), ("user", "outer_user")))])
        parts += [[mesh, kind, *(f"{own[f'{kind}_{name}']:.3f}" for name in ("wall", "user", "system")),
                   f"{own[f'{kind}_memory']:.0f}"] for kind in KINDS]
    return "\n".join([
        "# What a Schur complement costs", "",
        "Generated by `scripts/study orderings`, whose `--help` says what is measured: pinched blocks, a rank each, "
        "the larger figure of both. n and k are the dofs of a body and the rows of its contact; operations are in 10⁹. "
        "The ratios are (factor + outer) / plain. Aims: 1.5 for squares at 86, 1.3 at 200 and 320, 1.35 on other "
        "meshes.", "",
        *table(["mesh", "n", "k", "outer", *(f"operations: {kind}" for kind in KINDS),
                *(f"ratio, {kind}: {time}" for kind in KINDS[:3] for time in ("wall", "user"))], lines),
        "## Seconds and megabytes", "", "The factorization with its solve.", "",
        *table(["mesh", "", "wall", "user", "system", "memory"], parts)])


def orderings() -> None:
    """What a Schur complement costs beside a plain factorization, on meshes of several kinds, and where it goes.

        scripts/study orderings --meshes squares:86 gmsh:200      # these two

    A mesh is KIND:SIZE, both bodies of elements of side 1/SIZE: squares, and quadratic of order 2, are structured;
    gmsh, and curved (bent upwards, of order 2), are not. On two ranks, which hold the two pinched blocks and start
    together:

      schur      a factorization by MUMPS, called directly, with the compliance of the contact, and one solve; in the
                 order of elimination that the program has from 10,000 nodes on
      degree     the same in MUMPS's own order, minimum degree
      inverse    a factorization through PETSc with the inverse of the Schur complement on the contact, and one solve
      plain      a factorization without a Schur complement, by minimum fill, and one solve
      outer      the outer iteration of the default method

    They are done in turns, --turns times, in each of --repeats commands; of each the fastest counts, in the slower
    rank. Seconds are of wall time; user and system are the parts of processor time. The system gives memory that is
    touched first: on a virtual machine that may take as long as all the rest, so compare user times. Operations are
    MUMPS's count. Writes orderings.csv and orderings_table.md; with all meshes also to docs/tables/.
    """
    parser = arguments(orderings.__doc__, "orderings")
    parser.add_argument("--meshes", nargs="+", default=list(MESHES), metavar="KIND:SIZE", help="default: %(default)s")
    parser.add_argument("--repeats", type=int, default=2, help="commands for each mesh; default: %(default)s")
    parser.add_argument("--turns", type=int, default=2, help="within a command; default: %(default)s")
    parser.add_argument("--measure", nargs="+", help=argparse.SUPPRESS)  # for the processes that measure
    options = parser.parse_args()
    if options.measure:
        found = measure_mesh(MPI.COMM_WORLD, options.turns, options.measure)
        print(json.dumps(found) if MPI.COMM_WORLD.rank == 0 else "", end="")
        return
    ledger = Ledger(MPI.COMM_WORLD, options.output / "orderings.csv", ("mesh", "repetition"), ORDERINGS)
    rows = ledger.fill([(mesh, k) for k in range(options.repeats) for mesh in options.meshes],
                       lambda mesh, _: factor_in_turns(mesh, options.turns))
    text = orderings_page(rows, options.meshes)
    publish("orderings_table.md", text, options.output, set(MESHES) <= set(options.meshes))
    print(text)


# Boxes of tetrahedra

BOXES = ("cube:22", "slab:16", "slab2:8", "cube:32")


def system_of(kind: str, size: int) -> tuple[PETSc.Mat, PETSc.Vec, sparse.csr_matrix, np.ndarray]:
    """The system of a box clamped on its left, with a row for each component of each vertex of its bottom."""
    order, length = 2 if kind.endswith("2") else 1, 3 if kind.startswith("slab") else 1
    mesh = box((length * size, size, size), (float(length), 1.0, 1.0), order)
    load = Traction(on="top", value=(0.0, 0.0, -1.0))
    problem = assemble(mesh, body(clamp=[hold("left", 0.0, 0.0, 0.0)], traction=[load]))
    place = np.full(len(mesh.points), -1)
    place[problem.nodes] = np.arange(len(problem.nodes))
    facets = place[mesh.groups["bottom"]]
    first, second = np.repeat(facets[:, :3], facets.shape[1], axis=1).ravel(), np.tile(facets, 3).ravel()
    if order == 1:
        first = second = np.unique(facets)
    free = (first >= 0) & (second >= 0)
    rows, number = np.unique(first[free], return_inverse=True)
    weights = sparse.csr_matrix((np.ones(len(number)), (number, second[free])), (len(rows), len(problem.nodes)))
    B = sparse.kron(weights, sparse.identity(3), "csr")
    return problem.A, problem.b, B, mesh.points[problem.nodes]


def solid_factors() -> None:
    """What the compliance of a box of tetrahedra costs beside a plain factorization; nothing is in contact.

        scripts/study solid_factors --boxes cube:22 slab2:8      # these two

    A box is KIND:SIZE, of SIZE cubes a unit of length: a cube, or a slab of 3 × 1 × 1 whose long face is the contact;
    slab2 and cube2 are of order 2. Each is done as by the study `orderings`, in turns, of which the one that takes the
    least processor time counts. Prints a table; ratios are of processor time, to that of the plain factorization.
    """
    parser = arguments(solid_factors.__doc__)
    parser.add_argument("--boxes", nargs="+", default=list(BOXES), metavar="KIND:SIZE", help="default: %(default)s")
    parser.add_argument("--kinds", nargs="+", default=list(KINDS), help="default: %(default)s")
    parser.add_argument("--turns", type=int, default=2, help="default: %(default)s")
    options = parser.parse_args()
    lines = []
    for name in options.boxes:
        kind, size = name.split(":")
        system, best = system_of(kind, int(size)), {}
        for _ in range(options.turns):
            for way in options.kinds:
                spent = timed(lambda way=way, system=system: factor_and_solve(way, *system))
                spent["processor"] = spent["user"] + spent["system"]
                best[way] = min(spent, best.get(way, spent), key=lambda row: row["processor"])
        lines += [[name, f"{system[0].size[0]:,}", system[2].shape[0], way, f"{row['processor']:.2f}",
                   f"{row['processor'] / best['plain']['processor']:.2f}" if "plain" in best else "–",
                   f"{row['operations'] / 1e9:.3g}", f"{row['memory']:.0f}"] for way, row in best.items()]
    head = ("box", "n", "k", "", "processor time (s)", "ratio", "operations (10⁹)", "memory (MB)")
    print("\n".join(table(head, lines)))


# Large bodies

LARGE_PAGE = "large_bodies.md"
MILLIONS, SOLIDS, RANKS = (0.25, 1.0, 4.0), (0.08, 0.2, 0.6), (2, 4)
COMPLIANCES = ("chosen", "explicit", "direct", "iterative")
SPENT = ("mesh", "assemble", "factor", "outer", "recover", "estimate", "output", "total")
PEAKS = ("assemble", "factor", "outer", "output")
PATIENCE = 2.0
"""So many times the seconds of the program's own choice a kind is waited for."""

SLOWEST = 1800.0
"""Seconds after which the program's own choice is given up."""


UNKNOWN: Row = {"n": 0, "n_A": 0} | dict.fromkeys(
    (*SPENT, *(f"peak_{phase}" for phase in PEAKS), "memory", "in_all"), math.nan)


def measure_large(folder: Path, scene: str, millions: float, ranks: int, kind: str, limit: float) -> Row:
    solid = scene == "two_boxes"  # two bodies of 9 N (N + 1)² unknowns, of 2 (3N + 1) (N + 1) in the plane
    N = round((millions * 1e6 / 18) ** (1 / 3) - 2 / 3) if solid else round(math.sqrt(millions * 1e6 / 12))
    divisions = [3 * N, N, N] if solid else [3 * N, N]
    settings = [f"body.{name}.mesh.divisions={divisions}" for name in ("upper", "lower")]
    settings += [f"method.compliance={kind}"] if kind != "chosen" else []
    with tempfile.TemporaryDirectory(dir=folder) as place, tempfile.TemporaryDirectory() as peaks:
        os.environ |= {LOCKSTEP: str(ROOT / "tests" / "support" / "peaks.py"), "PEAKS": peaks}
        try:
            run = run_command(ROOT / "configs" / f"{scene}.toml", Path(place), "--no-figures",
                              *(word for each in settings for word in ("--set", each)), ranks=ranks, limit=limit)
        except AssertionError:
            return UNKNOWN | {"compliance": f"not done in {limit:.0f} s"}
        if run.code:
            return UNKNOWN | {"compliance": f"exit code {run.code}"}
        summary, held = run.summary, [json.loads(path.read_text(encoding="utf-8")) for path in Path(peaks).iterdir()]
    memory = [body["memory_mib"] for body in summary["bodies"].values()]
    kinds = {body["compliance"] for body in summary["bodies"].values()}
    return {phase: summary["seconds"].get(phase, 0.0) for phase in SPENT} | {
        f"peak_{phase}": max((each.get(phase, math.nan) for each in held), default=math.nan) for phase in PEAKS} | {
        "n": summary["n"], "n_A": summary["n_A"], "compliance": " ".join(sorted(kinds)), "memory": max(memory),
        "in_all": sum(memory)}


def digits_of(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"


def large_bodies() -> None:
    """Two large bodies: seconds and memory by phase, factors against multigrid, and what the program chooses.

        scripts/study large_bodies --millions 0.25 1 4 --solids 0.08 0.2 0.6 --ranks 2 4
        scripts/study large_bodies --millions --solids 2 --ranks 2 --kinds iterative      # two solids of a million each

    The scenes are configs/pinched_blocks.toml and, in space, configs/two_boxes.toml with so many million unknowns in
    all. `chosen` leaves method.compliance out. A kind that takes more than PATIENCE times as long as the chosen one is
    ended. Writes large_bodies.csv and large_bodies.md, and with the default sizes also to docs/tables/.
    """
    parser = arguments(large_bodies.__doc__, "large_bodies")
    parser.add_argument("--millions", nargs="*", type=float, default=MILLIONS, help="of unknowns in all, in the plane")
    parser.add_argument("--solids", nargs="*", type=float, default=SOLIDS, help="the same in space")
    parser.add_argument("--ranks", nargs="+", type=int, default=RANKS)
    parser.add_argument("--kinds", nargs="+", choices=COMPLIANCES, default=COMPLIANCES)
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    ledger = Ledger(MPI.COMM_WORLD, options.output / "large_bodies.csv", ("scene", "millions", "ranks", "kind"),
                    ("n", "n_A", "compliance", "memory", "in_all", *SPENT,
                     *(f"peak_{phase}" for phase in PEAKS)))

    def run(scene: str, millions: float, ranks: int, kind: str) -> Row:
        own = where(ledger.rows, scene=scene, millions=millions, ranks=ranks, kind="chosen")
        limit = PATIENCE * own[0]["total"] + 30 if own else SLOWEST
        return measure_large(options.output, scene, millions, ranks, kind, limit)

    sizes = [("pinched_blocks", each) for each in options.millions] + [("two_boxes", each) for each in options.solids]
    rows = ledger.fill([(*size, ranks, kind) for size in sizes for ranks in options.ranks for kind in options.kinds],
                       run)
    lines = ["# Large bodies", "", "Generated by `scripts/study large_bodies`: configs/pinched_blocks.toml and "
             "configs/two_boxes.toml. Memory is a body's, of the rank that holds most, and of both bodies (MiB). Kinds "
             f"that take more than {PATIENCE:g} times as long as the program's choice are ended. Aim: within 1.3 of "
             f"the best. Peak is the most that a rank has held when {', '.join(PEAKS)} ended (MiB); the rest are "
             "seconds.", ""]
    for scene, millions in sizes:
        for ranks in options.ranks:
            own = where(rows, scene=scene, millions=millions, ranks=ranks)
            best = min((row["total"] for row in own if row["total"] == row["total"]), default=math.nan)
            lines += [f"## {scene}, {millions:g} million unknowns on {ranks} ranks", ""]
            lines += table(("compliance", "became", "n_A", "memory", "in all", "peak", *SPENT, "total / best"),
                           [(row["kind"], row["compliance"], row["n_A"] or "–", *(digits_of(row[name], 0) for name in
                             ("memory", "in_all")), ", ".join(digits_of(row[f"peak_{phase}"], 0) for phase in PEAKS),
                             *(digits_of(row[phase], 2) for phase in SPENT),
                             digits_of(row["total"] / best, 2)) for row in own])
    text = "\n".join(lines)
    whole = all(tuple(given) == default for given, default in ((options.millions, MILLIONS), (options.solids, SOLIDS),
                                                               (options.ranks, RANKS), (options.kinds, COMPLIANCES)))
    publish(LARGE_PAGE, text, options.output, whole)
    print(text)


# The start

PACKAGES = ("ddmpi", "numpy", "scipy", "petsc4py", "mpi4py", "h5py", "msgspec", "gmsh", "meshio", "matplotlib")
SETTINGS = [word for body in (0, 1) for word in ("--set", f"body.{body}.mesh.divisions=[66, 22]")]


def seconds(command: list[str], checkout: Path) -> float:
    """Wall time of a command that must succeed, in `checkout`."""
    variables = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    start = time.perf_counter()
    child = subprocess.run(command, cwd=checkout, env=variables, capture_output=True, text=True, check=False)
    if child.returncode:
        sys.exit(child.stdout + child.stderr)
    return time.perf_counter() - start


def whole_commands(checkouts: dict[str, Path]) -> Row:
    """Seconds of the default command of each checkout, one after another."""
    found = {}
    for when, checkout in checkouts.items():
        with tempfile.TemporaryDirectory() as folder:
            found[when] = round(seconds([str(checkout / "scripts" / "run.sh"), "--output", f"{folder}/out", *SETTINGS],
                                        checkout), 4)
    return found


def imports() -> tuple[Counter[str], Counter[str]]:
    """Seconds and modules by package of a process that solves and writes a scene without pictures."""
    with tempfile.TemporaryDirectory() as folder:
        child = subprocess.run([sys.executable, "-X", "importtime", "-m", "ddmpi", "run",
                                str(ROOT / "configs" / "pinched_blocks.toml"), "--no-figures", "--quiet", "--output",
                                f"{folder}/out", *SETTINGS], capture_output=True, text=True, check=True)
    spent, modules = Counter[str](), Counter[str]()
    for own, name in re.findall(r"^import time:\s+(\d+) \|\s+\d+ \|\s+(\S+)", child.stderr, re.MULTILINE):
        package = name.split(".")[0] if name.split(".")[0] in PACKAGES else "Python's own and the rest"
        spent[package] += int(own) / 1e6
        modules[package] += 1
    return spent, modules


def start_up() -> None:
    """What a small run costs beside its mathematics: the default command on a coarse mesh.

        scripts/study start_up                            # by what the start consists of
        scripts/study start_up --older DIR --times 12     # and in turns with an older checkout

    An older checkout is made by `git worktree add DIR COMMIT`. Whole commands are `scripts/run.sh --output …` on
    N = 22, with pictures, two ranks. Writes start_up.csv and start_up.md.
    """
    parser = arguments(start_up.__doc__, "start_up")
    parser.add_argument("--older", type=Path, metavar="DIR", help="checkout to compare with")
    parser.add_argument("--times", type=int, default=12, help="that the commands are repeated")
    options = parser.parse_args()
    checkouts = {"now": ROOT} | ({"before": options.older.resolve()} if options.older else {})
    whole_commands(checkouts)  # writes bytecode
    rows = Ledger(MPI.COMM_SELF, options.output / "start_up.csv", ("repetition",), tuple(checkouts)).fill(
        [(number,) for number in range(options.times)], lambda _: whole_commands(checkouts))
    lines = ["# The default command at N = 22", "", "Generated by `scripts/study start_up`.", ""]
    taken = {when: [row[when] for row in rows] for when in checkouts}
    lines += table(("whole command (s)", "smallest", "median"),
                   [(when, f"{min(each):.3f}", f"{statistics.median(each):.3f}") for when, each in taken.items()])
    if options.older:
        pairs = statistics.median(row["now"] / row["before"] for row in rows)
        lines += [f"Now / before: {min(taken['now']) / min(taken['before']):.3f} by the smallest, {pairs:.3f} the "
                  "median of pairs.", ""]
    spent, modules = imports()
    lines += table(("imports of one rank", "modules", "seconds"),
                   [(package, modules[package], f"{spent[package]:.3f}") for package, _ in spent.most_common()])
    text = "\n".join(lines)
    (options.output / "start_up.md").write_text(text, encoding="utf-8")
    print(text)


def check() -> None:
    """What a look at a scene costs: `ddmpi check` of two blocks of 100,000 unknowns, in the plane and in space.

        scripts/study check
        scripts/study check --ranks 2

    The whole command, with pictures and without: wall time, and time of the processor, the least of three.
    """
    parser = arguments(check.__doc__, "check")
    parser.add_argument("--ranks", type=int, default=1)
    options = parser.parse_args()
    for scene, divisions in (("pinched_blocks", [273, 91]), ("two_boxes", [48, 18, 18])):
        for figures in ([], ["--no-figures"]):
            taken = []
            for _ in range(3):
                with tempfile.TemporaryDirectory() as folder:
                    before, began = resource.getrusage(resource.RUSAGE_CHILDREN), time.perf_counter()
                    run_python(["-m", "ddmpi", "check", str(ROOT / "configs" / f"{scene}.toml"), *figures, "--set",
                                *(f"body.{name}.mesh.divisions={divisions}" for name in BOTH), "--output",
                                f"{folder}/looked"], options.ranks)
                    wall, now = time.perf_counter() - began, resource.getrusage(resource.RUSAGE_CHILDREN)
                    taken.append((wall, now.ru_utime + now.ru_stime - before.ru_utime - before.ru_stime))
            wall, processor = min(each[0] for each in taken), min(each[1] for each in taken)
            print(f"{scene}, {'without' if figures else 'with'} pictures: {wall:.2f} s, {processor:.2f} s of processor")


# One body on several ranks

RANK_PHASES = ("assemble", "factor", "outer", "recover", "estimate", "output", "total")

BLOCK = """
title = "Block on a rigid floor"
output = {{ figures = false }}
method = {{ compliance = "{kind}" }}
[[body]]
name = "block"
mesh = {{ shape = "rectangle", size = [3.0, 1.0], divisions = [{along}, {divisions}] }}
material = {{ young = 2.0e11, poisson = 0.3 }}
clamp = {clamp}
traction = [{{ on = "top", value = [2.0e6, -1.0e7] }}]
[[rigid]]
name = "floor"
shape = "plane"
point = [0.0, 0.0]
normal = [0.0, 1.0]
[[contact]]
bodies = ["block", "floor"]
on = ["bottom"]
friction = {{ law = "coulomb", coefficient = 0.3 }}
"""

CLAMPS = {False: '["left"]', True: '[{ on = "left", x = 0.0 }]'}


def body_ranks() -> None:
    """Memory and time of one body on several ranks, clamped on its left, on a rigid floor.

        scripts/study body_ranks --divisions 408 --ranks 1 2 4

    prints a table: the most memory that a rank has held, seconds by phase, and how far the answer is from that of the
    first number of ranks. With 408 divisions of its height the body has a million unknowns.
    """
    parser = arguments(body_ranks.__doc__)
    parser.add_argument("--divisions", type=int, default=60, help="of the block's height (1)")
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--compliance", default="explicit", help="explicit, direct or iterative")
    parser.add_argument("--loose", action="store_true", help="clamps leave one rigid motion free")
    parser.add_argument("--limit", type=float, default=900.0, help="seconds for a run")
    options = parser.parse_args()
    print("| ranks | memory of the largest (MiB) | of one rank's | " + " | ".join(RANK_PHASES) + " (s) | distance |")
    print("|" + "---|" * (len(RANK_PHASES) + 4))
    with tempfile.TemporaryDirectory() as name:
        here = Path(name)
        (here / "scene.toml").write_text(BLOCK.format(divisions=options.divisions, along=3 * options.divisions,
                                                      kind=options.compliance, clamp=CLAMPS[options.loose]))
        first, reference = 0.0, np.empty(0)
        for ranks in options.ranks:
            run = run_command(here / "scene.toml", here / str(ranks), ranks=ranks, limit=options.limit)
            if run.code:
                sys.exit(run.output)
            summary, u = run.summary, read_results(here / str(ranks)).fields["displacement"]
            memory = summary["bodies"]["block"]["memory_mib"]
            if not first:
                first, reference = memory, u
            seconds = " | ".join(f"{summary['seconds'][phase]:.1f}" for phase in RANK_PHASES)
            print(f"| {ranks} | {memory:.0f} | {memory / first:.2f} | {seconds} | "
                  f"{np.abs(u - reference).max() / np.abs(reference).max():.1e} |", flush=True)


# The whole command, and one plain factorization of one body

SCENE = ROOT / "configs" / "pinched_blocks.toml"
PAGE = "benchmark_table.md"
SIZES = {22: 5, 54: 5, 86: 5, 140: 3, 200: 3, 320: 2}
"""N, and how often it is measured."""

FITTED = 86
"""From this N on, the growth with the number of unknowns is fitted."""

LIMIT = 900.0
"""Seconds after which two processes are given up."""

PLAIN_ORDERINGS = {"chosen": 7, "least_fill": 2}
"""MUMPS's ICNTL(7)."""

PHASES = ("mesh", "assemble", "factor", "outer", "recover", "estimate", "output")
PLAIN = tuple(f"{ordering}_{step}" for ordering in PLAIN_ORDERINGS for step in ("factor", "solve"))
KEY = ("N", "repetition")
MEASURED = ("n", "m", "iterations", "n_A", "whole", *PHASES, "memory", "pair_assemble", "pair_factor", "pair_outer",
            *PLAIN, *(f"{ordering}_memory" for ordering in PLAIN_ORDERINGS))


# Two processes that measure

def divisions(N: int) -> list[str]:
    return [f"body.{name}.mesh.divisions=[{3 * N}, {N}]" for name in ("upper", "lower")]


def factor_plainly(world: MPI.Comm, A: PETSc.Mat, b: PETSc.Vec, ordering: str) -> tuple[float, float]:
    """Seconds of a plain factorization and of one solve, the slower rank's; both start together. Collective."""
    PETSc.Options().setValue("plain_mat_mumps_icntl_7", PLAIN_ORDERINGS[ordering])
    ksp, u = PETSc.KSP().create(PETSc.COMM_SELF), b.duplicate()
    ksp.setOptionsPrefix("plain_")
    ksp.setOperators(A)
    ksp.setType(PETSc.KSP.Type.PREONLY)
    ksp.getPC().setType(PETSc.PC.Type.CHOLESKY)
    ksp.getPC().setFactorSolverType("mumps")
    ksp.setFromOptions()
    seconds = []
    for step in (ksp.setUp, lambda: ksp.solve(b, u)):
        world.Barrier()
        start = time.perf_counter()
        step()
        seconds.append(world.allreduce(time.perf_counter() - start, MPI.MAX))
    for thing in (ksp, u):
        thing.destroy()
    return tuple(seconds)


def measure_pair(world: MPI.Comm, N: int) -> dict[str, float]:
    scene, clock = read_scene_file(SCENE, divisions(N)), Clock()
    assembly = prepare(world, scene, clock=clock)
    solution = solve(assembly, scene.method, clock=clock)
    if not solution.certified:
        raise RuntimeError(solution.reason)
    found = {f"pair_{phase}": value for phase, value in clock.largest(world).items()
             if phase in ("assemble", "factor", "outer")}
    (body,) = assembly.bodies
    elasticity = assemble(body.mesh, body.spec)  # in the mesh's order, which is the better one here
    A, b = elasticity.A, elasticity.b
    for ordering in PLAIN_ORDERINGS:
        found |= dict(zip((f"{ordering}_factor", f"{ordering}_solve"), factor_plainly(world, A, b, ordering),
                          strict=True))
    return found


def measure_plain(world: MPI.Comm, N: int, ordering: str) -> dict[str, float]:
    body = read_scene_file(SCENE, divisions(N)).body[world.rank]
    elasticity = assemble(build_mesh(body), body)
    factor_plainly(world, elasticity.A, elasticity.b, ordering)
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
    return {f"{ordering}_memory": world.allreduce(peak, MPI.MAX)}


def measure(what: str, N: int, *more: str) -> None:
    """What the two processes do; rank 0 prints the result as JSON."""
    world = MPI.COMM_WORLD
    found = {"pair": measure_pair, "plain": measure_plain}[what](world, N, *more)
    gc.collect()
    if world.rank == 0:
        print(json.dumps(found))


# The process that starts them

def repeat(N: int) -> dict[str, float]:
    """All measurements of one repetition."""
    settings = [word for setting in divisions(N) for word in ("--set", setting)]
    with tempfile.TemporaryDirectory() as folder:
        start = time.perf_counter()
        run = run_command(SCENE, Path(folder), "--no-figures", *settings, limit=LIMIT)
        whole = time.perf_counter() - start
        if run.code:
            sys.exit(run.output)
        summary = run.summary
    found = {"n": summary["n"], "m": summary["m"], "iterations": summary["outer_iterations"], "n_A": summary["n_A"],
             "whole": whole, "memory": max(body["memory_mib"] for body in summary["bodies"].values())}
    found |= {phase: summary["seconds"][phase] for phase in PHASES}
    for what in (["pair", N], *(["plain", N, ordering] for ordering in PLAIN_ORDERINGS)):
        child = run_python(["-m", "mpi4py", __file__, "benchmark", "--measure", *map(str, what)], limit=LIMIT)
        if child.code:
            sys.exit(child.output)
        found |= json.loads(child.stdout.splitlines()[-1])
    return {name: round(value, 7) for name, value in found.items()}


def best(rows: list[Row]) -> dict[int, dict]:
    """By N: the smallest times and the largest memory of all repetitions."""
    found = {}
    for N in sorted({row["N"] for row in rows}):
        same = [row for row in rows if row["N"] == N]
        found[N] = {name: (max if "memory" in name else min)(row[name] for row in same) for name in (*KEY, *MEASURED)}
        found[N]["repetitions"] = len(same)
    return found


# Tables

def times_table(found: dict[int, dict]) -> list[str]:
    rows = [[N, f"{row['n']:,}", row["iterations"], row["n_A"], *(as_written(row[phase]) for phase in PHASES),
             as_written(row["whole"]), f"{row['memory']:.0f}"] for N, row in found.items()]
    return ["## Where the time goes", "",
            "Seconds of the slower rank; `whole` is the command from start to end, start-up of Python and MPI "
            "included. `factor` has the Schur complement, its inverse and the load's displacement, `recover` the "
            "displacement, the certificate and the stress, `estimate` the discretization error. Memory: peak of the "
            "larger rank, MiB.", "",
            *table(["N", "n", "iterations", "n_A", *PHASES, "whole", "memory"], rows)]


def ratios_table(found: dict[int, dict]) -> list[str]:
    rows = []
    for N, row in found.items():
        whole = row["pair_factor"] + row["pair_outer"]
        cells = [N, as_written(row["pair_factor"]), as_written(row["pair_outer"])]
        for ordering in PLAIN_ORDERINGS:
            plain = row[f"{ordering}_factor"] + row[f"{ordering}_solve"]
            cells += [f"{as_written(row[f'{ordering}_factor'])} + {as_written(row[f'{ordering}_solve'])}",
                      f"{whole / plain:.2f}", f"{row['pair_assemble'] / row[f'{ordering}_factor']:.2f}",
                      f"{row['memory'] / row[f'{ordering}_memory']:.2f}"]
        rows.append(cells)
    columns = ["plain factor + solve", "(factor + outer) / plain", "assemble / plain factor", "memory / plain"]
    return ["## Beside one plain factorization and solve of one body", "",
            "Measured in the same two processes, in both at the same time. First with the ordering that MUMPS "
            "chooses, then with the one of least fill (ICNTL(7) = 2), which is faster here; a Schur complement leaves "
            "MUMPS without METIS no choice but AMD. Aims: (factor + outer) / plain at most 2, better 1.5, at N = 86, "
            "200 and 320; outer below 0.1 s at N = 86; assemble / plain factor below 0.5 at N = 320; memory at most "
            "1.5 times; the whole command below 2 s at N = 86 and 10 s at N = 320.", "",
            *table(["N", "factor", "outer", *columns, *(f"{name}, least fill" for name in columns)], rows)]


def growth_table(found: dict[int, dict]) -> list[str]:
    fitted = {N: row for N, row in found.items() if N >= FITTED}
    if len(fitted) < 2:
        return []
    n = np.log([row["n"] for row in fitted.values()])
    names = (*PHASES, "whole", "memory", *PLAIN)
    slopes = [np.polyfit(n, np.log([row[name] for row in fitted.values()]), 1)[0] for name in names]
    return ["## Growth", "",
            f"Exponents p of seconds ~ n^p (memory ~ n^p), fitted from N = {FITTED} on; 1 is linear, 1.5 is what the "
            "operations of a sparse factorization in the plane grow with.", "",
            *table([name.replace("_", " ") for name in names], [[f"{slope:.2f}" for slope in slopes]])]


def page(rows: list[Row]) -> str:
    found, have = best(rows), versions()
    return "\n".join([
        "# What a run costs", "",
        "Generated by `scripts/study benchmark`: `configs/pinched_blocks.toml` (two blocks, Coulomb friction, default "
        "method, tolerance 1e-8) with squares of side 1/N, two ranks. The smallest time of "
        f"{min(r['repetitions'] for r in found.values())} to {max(r['repetitions'] for r in found.values())} "
        f"repetitions. {processor()}, PETSc {have['petsc']}, {have['mpi']}.", "",
        *times_table(found), "![Phases of a run over its size](figures/benchmark_phases.png)", "",
        *ratios_table(found), *growth_table(found)])


def draw_phases(found: dict[int, dict]):
    """The phases of a whole command over the number of unknowns, stacked: in seconds, and as parts; a figure."""
    import matplotlib.pyplot as plt

    n = [row["n"] for row in found.values()]
    phases = {phase: np.array([row[phase] for row in found.values()]) for phase in PHASES}
    whole = np.array([row["whole"] for row in found.values()])
    phases = {"start, checks, the rest": np.maximum(whole - sum(phases.values()), 0.0)} | phases
    figure, (seconds_axes, parts) = plt.subplots(1, 2, figsize=(10.0, 4.0))
    colours = ["#b9bec6", *plt.get_cmap("viridis")(np.linspace(0.0, 0.95, len(PHASES)))]
    seconds_axes.stackplot(n, list(phases.values()), labels=list(phases), colors=colours)
    parts.stackplot(n, [100 * each / whole for each in phases.values()], colors=colours)
    for axes, label in ((seconds_axes, "seconds of the whole command"), (parts, "per cent")):
        axes.margins(x=0)
        axes.set(xscale="log", xlabel="unknowns of both bodies", ylabel=label)
        axes.grid(False)
    parts.set_ylim(0, 100)
    figure.legend(*seconds_axes.get_legend_handles_labels(), loc="upper center", ncols=4, bbox_to_anchor=(0.5, 0.0))
    return figure


def benchmark() -> None:
    """What a run costs, beside one plain factorization and solve of one body.

    Pinched blocks with Coulomb friction, default method, tolerance 1e-8, on meshes of 6072 to 1.2 million unknowns. For
    each mesh, several times over, on two ranks:

      run      the command, without pictures: its time from start to end, its phases, its peak memory
      pair     the same phases and then, in the same two processes and at the same time in both, a plain MUMPS Cholesky
               factorization (no Schur complement) and a solve with the body's stiffness: in the ordering that MUMPS
               chooses, and in that of least fill, which the program uses where it needs no Schur complement
      plain    two processes that mesh, assemble, factor and solve, and do nothing else: their peak memory

    The smallest time and the largest memory of all repetitions count. Writes to the folder --output benchmark.csv (a
    line per repetition, written at once, so that an interrupted study continues) and benchmark_table.md; once all
    meshes are done, the table is also written to docs/tables/.
    """
    parser = arguments(benchmark.__doc__, "benchmark")
    parser.add_argument("--sizes", nargs="+", type=int, default=list(SIZES), metavar="N", help="default: %(default)s")
    parser.add_argument("--repeats", type=int, metavar="R", help="default: 2 to 5, by size")
    parser.add_argument("--measure", nargs="+", help=argparse.SUPPRESS)  # for the processes that measure
    options = parser.parse_args()
    if options.measure:
        what, N, *more = options.measure
        measure(what, int(N), *more)
        return

    ledger = Ledger(MPI.COMM_WORLD, options.output / "benchmark.csv", KEY, MEASURED)
    rows = ledger.fill([(N, k) for N in options.sizes for k in range(options.repeats or SIZES.get(N, 2))],
                       lambda N, _: repeat(N))
    text = page(rows)
    publish(PAGE, text, options.output, set(SIZES) <= {row["N"] for row in rows},
            lambda folder: save_figures(folder, {"benchmark_phases": lambda: draw_phases(best(rows))}, dpi=110))
    print(text)


STUDIES = (benchmark, orderings, solid_factors, large_bodies, start_up, check, body_ranks)

if __name__ == "__main__":
    start(*STUDIES)
