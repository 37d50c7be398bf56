"""The same scenes by ddmpi, by other programs of Debian and PyPI, and by hand: time, answer, what it took.

All get the same nodes and triangles, and run in turns, never two at once: each as a process of its own, timed from
start to end, on one thread or process and on two. Writes to the folder --output peers.csv (a line per run, written at
once, so that an interrupted comparison continues) and peers.md; once all scenes and sizes are done, the page is also
written to docs/tables/. What is not installed is named and left out.
"""

from __future__ import annotations

import glob
import importlib.util
import json
import math
import os
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import peers
from experiment import ROOT, Ledger, Row, arguments, processor, publish, table, where
from mpi4py import MPI
from peers import Answer, Case, read_answer
from problems import draw
from scenes import clean_environment, pinched_blocks, to_toml, tower

from ddmpi.mesh.boundary import boundary_group
from ddmpi.mesh.build import build_mesh
from ddmpi.scene.reader import read_scene
from ddmpi.system.provenance import versions

PROGRAMS = ROOT / "scripts" / "peers"


# Scenes, as ddmpi reads them, and, from its own meshes, as a Case for everybody else

RADIUS, LOAD, YOUNG, POISSON = 50.0, 17500.0, 210e3, 0.3
"""Half of a steel roller: mm, N/mm, MPa."""

WIDTH = float(np.sqrt(8 * LOAD * RADIUS * (1 - POISSON**2) / np.pi / YOUNG))
"""Hertz's half width of the contact with a rigid plane (mm)."""

SUMMIT = 4 * LOAD / np.pi / WIDTH
"""Hertz's largest pressure (MPa)."""


def frictionless(N: int, folder: Path) -> dict:
    return pinched_blocks(N, "none")


def blocks(N: int, folder: Path) -> dict:
    return pinched_blocks(N)


def hertz(N: int, folder: Path) -> dict:
    """N/2 nodes on the half width; the plane is rigid, so that nodes meet points."""
    size = f"{2 * WIDTH / N} + 0.25 * Max(0, Sqrt(x * x + y * y) - {2 * WIDTH})"
    mesh = draw(folder / "roller.msh", {"o": (0.0, 0.0), "b": (RADIUS, RADIUS), "c": (0.0, RADIUS)},
                {"rim": ("o", "c", "b"), "cut": ("b", "c"), "axis": ("c", "o")}, size, 1)
    return {"title": f"Roller on a rigid plane, {N} sides on the half width twice",
            "rigid": [{"name": "plane", "shape": "plane", "point": [0.0, 0.0], "normal": [0.0, 1.0]}],
            "body": [{"name": "roller", "mesh": mesh, "material": {"young": YOUNG, "poisson": POISSON},
                      "clamp": [{"on": "axis", "x": 0.0}],
                      "traction": [{"on": "cut", "value": [0.0, -LOAD / RADIUS]}]}],
            "contact": [{"bodies": ["roller", "plane"], "on": ["rim"]}]}


def stack(N: int, folder: Path) -> dict:
    """Pushed so hard that its lower joints open and slide in part; nothing but contacts holds the upper three."""
    scene = tower(4, N // 2)
    scene["body"][-1]["traction"] = [{"on": "top", "value": [1.0e7, -6.0e7]}]
    return scene


SCENES: dict[str, tuple[Callable[[int, Path], dict], tuple[float, float]]] = {
    "frictionless": (frictionless, (3.0, 2.0)), "blocks": (blocks, (3.0, 2.0)), "hertz": (hertz, (0.0, RADIUS)),
    "stack": (stack, (3.0, 4.0))}
"""By name: the scene on a mesh, and the point whose displacement is compared (m, of the roller mm)."""


def write_case(name: str, N: int, folder: Path) -> Case:
    """scene.toml for ddmpi and the same as a Case, both in the folder."""
    make, watched = SCENES[name]
    scene = make(N, folder)
    (folder / "scene.toml").write_text(to_toml(scene), encoding="utf-8")
    case = case_of(scene, watched)
    case.save(folder)
    return case


def case_of(scene: dict, watched: tuple[float, float]) -> Case:
    """The Case of a scene of straight contacts whose nodes match, or of one with the rigid plane y = 0."""
    meshes = {body.name: build_mesh(body) for body in read_scene("a scene of peers", to_toml(scene)).body}
    counts = [len(mesh.points) for mesh in meshes.values()]
    starts = dict(zip(meshes, np.cumsum([0, *counts[:-1]]), strict=True))
    points = np.concatenate([mesh.points for mesh in meshes.values()])

    def edges_of(name: str, group: str) -> tuple[np.ndarray, np.ndarray]:
        """The edges (k, 2) of a group and their lengths."""
        edges = starts[name] + boundary_group(meshes[name], group, "mesh")
        return edges, np.linalg.norm(points[edges[:, 1]] - points[edges[:, 0]], axis=1)

    clamped, load = [], np.zeros((len(points), 2))
    for body in scene["body"]:
        for clamp in body["clamp"]:
            clamp = {"on": clamp, "x": 0.0, "y": 0.0} if isinstance(clamp, str) else clamp
            nodes = np.unique(edges_of(body["name"], clamp["on"])[0])
            clamped += [2 * nodes + c for c, component in enumerate("xy") if component in clamp]
        for traction in body["traction"]:
            edges, lengths = edges_of(body["name"], traction["on"])
            for ends in edges.T:
                np.add.at(load, ends, lengths[:, None] / 2 * np.array(traction["value"]))
    held = np.unique(np.concatenate(clamped))

    parts = []
    for number, contact in enumerate(scene["contact"]):
        (first, second), on = contact["bodies"], contact["on"]
        edges, lengths = edges_of(first, on[0])
        nodes = np.unique(edges)
        nodes = nodes[np.argsort(points[nodes, 0])]
        length = np.bincount(edges.ravel(), np.repeat(lengths / 2, 2), len(points))[nodes]
        partner = np.full(len(nodes), -1)
        if second in meshes:
            facing = np.unique(edges_of(second, on[1])[0])
            partner = facing[np.argsort(points[facing, 0])]
            if np.abs(points[nodes] - points[partner]).max() > 1e-9:
                raise ValueError(f"the nodes of {first} and {second} do not match")
        pairs = np.column_stack([nodes, partner])
        moves = ~(np.isin(2 * pairs, held) & np.isin(2 * pairs + 1, held)).all(axis=1)
        gap = np.where(partner < 0, points[nodes, 1], 0.0)
        parts.append([each[moves] for each in (pairs, gap, length, np.full(len(nodes), number))])
    pairs, gap, length, numbers = (np.concatenate(each) for each in zip(*parts, strict=True))
    material, friction = scene["body"][0]["material"], scene["contact"][0].get("friction", {})
    return Case(points, np.concatenate([starts[name] + mesh.triangles for name, mesh in meshes.items()]),
                np.repeat(np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes.values()]),
                material["young"], material["poisson"], held, load.ravel(), pairs,
                np.tile([0.0, -1.0], (len(pairs), 1)), gap, length, numbers, friction.get("coefficient", 0.0),
                int(np.linalg.norm(points - watched, axis=1).argmin()))


# One run of one peer: a process with a time limit

LAUNCH = """
import json, os, subprocess, sys, time
start = time.perf_counter()
child = subprocess.Popen(sys.argv[2:], stdin=subprocess.DEVNULL)
_, status, usage = os.wait4(child.pid, 0)
found = {"seconds": time.perf_counter() - start, "memory": usage.ru_maxrss / 1024,
         "code": os.waitstatus_to_exitcode(status)}
with open(sys.argv[1], "w") as file:
    json.dump(found, file)
"""
"""Runs a command; writes its seconds, the peak memory (MiB) of its largest process and its exit code to a file.

A small process of its own, because Linux counts the memory of a process that starts another one as that one's.
"""


@dataclass(frozen=True)
class Peer:
    """A program, or a way to write one.

    Attributes
    ----------
    title : what the tables call it
    scenes : that it can do
    missing : what is not there, or None
    command : from folder and number of processes or threads
    write : its input; not timed
    read : its answer
    processes : whether two means processes, not threads
    """

    title: str
    scenes: Collection[str]
    missing: Callable[[], str | None]
    command: Callable[[Path, int], list[str]]
    read: Callable[[Case, Path], Answer]
    write: Callable[[Case, Path], object] = lambda case, folder: None
    processes: bool = False


@dataclass(frozen=True)
class Result:
    """Seconds, peak memory of the largest process (MiB), and the answer or why there is none."""

    seconds: float
    memory: float
    answer: Answer | None
    failure: str = ""


def measure(peer: Peer, case: Case, folder: Path, count: int, limit: float,
            environment: Mapping[str, str]) -> Result:
    """Run a peer on `count` processes or threads, for at most `limit` seconds."""
    peer.write(case, folder)
    threads = str(1 if peer.processes else count)
    environment = {**environment, "OMP_NUM_THREADS": threads, "OPENBLAS_NUM_THREADS": threads}
    command = [sys.executable, "-S", "-c", LAUNCH, "found.json", *peer.command(folder, count)]
    with open(folder / "output.txt", "w+", encoding="utf-8", errors="replace") as output:
        child = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True, stdout=output,
                                 stderr=subprocess.STDOUT)
        try:
            child.wait(limit)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)  # the session that it leads
            child.wait()
            return Result(limit, math.nan, None, f"more than {limit:.0f} s")
        found = json.loads((folder / "found.json").read_text(encoding="utf-8"))
        seconds, memory = found["seconds"], found["memory"]
        if found["code"]:
            output.seek(0)
            last = [line.strip() for line in output if line.strip()][-1:] or [f"exit code {found['code']}"]
            return Result(seconds, memory, None, last[0][:200].replace("|", "/"))
    try:
        return Result(seconds, memory, peer.read(case, folder))
    except (OSError, ValueError, RuntimeError) as error:
        return Result(seconds, memory, None, str(error)[:200])


# The comparison

SIZES = {22: 3, 86: 3, 160: 2}
"""N, and how often it is measured."""

LIMIT = 600.0
"""Seconds after which a run is given up, and on finer meshes not tried."""

KEY = ("scene", "N", "peer", "count", "repetition")
MEASURED = ("unknowns", "pairs", "seconds", "memory", "iterations", "normal", "tangential", "pressure", "x", "y",
            "failure")
PLUGINS = glob.glob("/usr/lib/freefem++/MUMPS_seq.so") + glob.glob("/usr/lib/*/freefem++/MUMPS_seq.so")
HELD = ("frictionless", "blocks")
"""Scenes whose bodies are held by clamps, so that each has a regular stiffness matrix."""


# Who takes part

def lacks_module(name: str) -> str | None:
    return None if importlib.util.find_spec(name) else f"no Python module {name}"


def lacks_program(name: str) -> str | None:
    return None if shutil.which(name) else f"no program {name}"


def lacks_freefem() -> str | None:
    return lacks_program("FreeFem++") or (None if PLUGINS else "FreeFem++ is there, but not its MUMPS (libfreefem++)")


def script(name: str, *words: str):
    return lambda folder, count: [sys.executable, "-m", f"peers.{name}", str(folder), *words]


def by_hand(title: str, kind: str, scenes=tuple(SCENES), missing=lambda: lacks_module("skfem"), **more) -> Peer:
    return Peer(title, scenes, missing, more.pop("command", script("active_set", kind)),
                lambda case, folder: read_answer(folder), **more)


PEERS = {
    "ddmpi": Peer("ddmpi", tuple(SCENES), lambda: None, peers.ddmpi_command, peers.read_ddmpi,
                   peers.clear_ddmpi, True),
    "petsc-dense": by_hand(
        "by hand, dense, PETSc's MUMPS", "petsc-dense", HELD, processes=True,
        command=lambda folder, count: ["mpirun", "-n", str(count), *script("active_set", "petsc-dense")(folder, 1)]),
    "petsc": by_hand("by hand, sparse, PETSc's MUMPS", "petsc"),
    "scipy-dense": by_hand("by hand, dense, SciPy's SuperLU", "scipy-dense", HELD),
    "scipy": by_hand("by hand, sparse, SciPy's SuperLU", "scipy"),
    "getfem": Peer("GetFEM", tuple(SCENES), lambda: lacks_module("getfem"), script("getfem_peer"),
                   lambda case, folder: read_answer(folder)),
    "freefem": Peer("FreeFEM", tuple(SCENES), lacks_freefem, peers.freefem_command, peers.read_freefem,
                    peers.write_freefem),
    "calculix": Peer("CalculiX", tuple(SCENES), lambda: lacks_program("ccx"), peers.calculix_command,
                     peers.read_calculix, peers.write_calculix),
}


# Measurements

def environment() -> dict[str, str]:
    found = clean_environment()
    found["PYTHONPATH"] = f"{PROGRAMS.parent}:{found['PYTHONPATH']}"
    if PLUGINS:
        found["FF_LOADPATH"] = f"{Path(PLUGINS[0]).parent};;"
    return found


def row_of(case: Case, result: Result) -> Row:
    nothing = (math.nan,) * 2
    answer = result.answer
    normal, tangential = answer.force if answer else nothing
    x, y = answer.displacement if answer else nothing
    return {"unknowns": case.load.size - case.clamped.size, "pairs": len(case.pairs),
            "seconds": round(result.seconds, 4), "memory": round(result.memory, 1),
            "iterations": answer.iterations if answer else 0, "normal": float(normal), "tangential": float(tangential),
            "pressure": answer.pressure if answer else math.nan, "x": float(x), "y": float(y),
            "failure": result.failure}


class Runs:
    """Runs peers in turns; a peer that has failed on a scene is not asked again, nor for finer meshes of it."""

    def __init__(self, rows: list[Row], folder: Path, limit: float) -> None:
        self.rows, self.folder, self.limit, self.cases = rows, folder, limit, {}

    def __call__(self, scene: str, N: int, peer: str, count: int, repetition: int) -> Row:
        place = self.folder / f"{scene}{N}"
        if (scene, N) not in self.cases:
            place.mkdir(exist_ok=True)
            self.cases = {(scene, N): write_case(scene, N, place)}  # one at a time
        case = self.cases[scene, N]
        before = [row for row in where(self.rows, scene=scene, peer=peer, count=count)
                  if row["failure"] and (row["N"] == N or (row["N"] < N and "more than" in row["failure"]))]
        if before:
            return row_of(case, Result(math.nan, math.nan, None, before[0]["failure"]))
        (place / "answer.npz").unlink(missing_ok=True)
        return row_of(case, measure(PEERS[peer], case, place, count, self.limit, environment()))


def best(rows: list[Row]) -> Row | None:
    """The repetition with the smallest time, with the largest memory of all."""
    done = [row for row in rows if not row["failure"]]
    if not done:
        return None
    return min(done, key=lambda row: row["seconds"]) | {"memory": max(row["memory"] for row in done)}


def difference(row: Row, other: Row) -> float:
    """The largest of those in force, pressure and displacement, each relative to its size in `row`."""
    return max(math.dist([other[name] for name in names], [row[name] for name in names])
               / math.hypot(*(row[name] for name in names))
               for names in (("normal", "tangential"), ("pressure",), ("x", "y")))


# The page

TITLES = {"frictionless": "Two blocks without friction", "blocks": "Two blocks with Coulomb friction 0.3",
          "hertz": "A roller on a rigid plane", "stack": "A stack of four blocks with Coulomb friction 0.3"}
WORDS = {
    "frictionless": "`configs/pinched_blocks.toml` with squares of side 1/N. Displacement of the point (3, 2).",
    "blocks": "`configs/pinched_blocks.toml` with squares of side 1/N: a part of the contact is open, a part slips, a "
              "part sticks. Displacement of the point (3, 2).",
    "hertz": "Half of a steel roller of radius 50 mm under 35 kN/mm, linear triangles of which N/2 lie on Hertz's half "
             f"width. Hertz's largest pressure is {SUMMIT:.1f} MPa; the largest one of the nodes depends on the "
             "triangles in the corner. mm, N, MPa. Nothing but its contact holds the roller in y.",
    "stack": "Four blocks of 3 m × 1 m on each other, squares of side 2/N, pushed at the top by a sixth of what "
             "presses them. Only the lowest is clamped. The force is that of the lowest contact; displacement of the "
             "upper right corner.",
}


def seconds(row: Row | None) -> str:
    return "–" if row is None else f"{row['seconds']:.2f}"


def scene_table(rows: list[Row], scene: str, N: int) -> list[str]:
    own = best(where(rows, scene=scene, N=N, peer="ddmpi"))
    lines = []
    for name, peer in PEERS.items():
        runs = where(rows, scene=scene, N=N, peer=name)
        if not runs:
            continue
        one, two = (best(where(runs, count=count)) for count in (1, 2))
        row = one or two
        if row is None:
            lines.append([peer.title, *["–"] * 6, f"**{runs[0]['failure']}**", "–"])
            continue
        apart = "" if name == "ddmpi" else "–" if own is None else f"{difference(own, row):.0e}"
        lines.append([peer.title, seconds(one), seconds(two), f"{row['memory']:.0f}", row["iterations"],
                      f"{row['normal']:.7g}", f"{row['tangential']:.7g}",
                      f"{row['pressure']:.6g}; ({row['x']:.5g}, {row['y']:.5g})", apart])
    known = where(rows, scene=scene, N=N)[0]
    return [f"### N = {N}: {known['unknowns']:,} unknowns, {known['pairs']} pairs of nodes", "",
            *table(["", "one (s)", "two (s)", "MiB", "iterations", "normal force", "tangential force",
                    "largest pressure; displacement", "difference to ddmpi"], lines)]


def lines_of(path: Path, *comments: str) -> int:
    """Lines of a file that are not empty and no comment."""
    return sum(bool(line.strip()) and not line.strip().startswith(comments)
               for line in path.read_text(encoding="utf-8").splitlines())


def own_deck() -> int:
    """Lines of CalculiX's deck that are no tables of nodes, elements, sides, clamps and loads."""
    with tempfile.TemporaryDirectory() as folder:
        text = peers.deck(write_case("blocks", 2, Path(folder)))
    tables = ("*NODE, ", "*ELEMENT", "*NSET, NSET=B", "*BOUNDARY", "*SURFACE, ", "*CLOAD")
    return sum(1 if ("*" + part).startswith(tables) else len(part.splitlines()) for part in text.split("*")[1:])


def effort_table(left_out: dict[str, str]) -> list[str]:
    own = lines_of(ROOT / "configs" / "pinched_blocks.toml", "#")
    hand, getfem = lines_of(PROGRAMS / "active_set.py", "#"), lines_of(PROGRAMS / "getfem_peer.py", "#")
    free = lines_of(PROGRAMS / "freefem_contact.edp", "//")
    rows = [
        ["ddmpi", f"a scene of {own} lines", "none"],
        ["by hand", f"{hand} lines of Python for all four variants, on scikit-fem's matrices; matching nodes and "
         "linear triangles only", "the scale of the active set, E/(2 (1 − ν²)); the dense variants "
         "need bodies that clamps hold"],
        ["GetFEM", f"{getfem} lines of Python: matrices of the pairs for its nodal contact brick; bodies moved apart "
         "in one mesh, because it merges nodes at the same place", "the augmentation parameter r = E; units in which "
         "E = 1, because its residual adds newtons and metres and else is met after one step, with a wrong answer; a "
         "first guess of the contact forces, without which the stack, which friction holds, does not converge"],
        ["FreeFEM", f"{free} lines of its language: it has no contact, so that the script is the active set; "
         "`FF_LOADPATH` for its MUMPS; bodies moved apart in one mesh", "the scale of the active set"],
        ["CalculiX", f"a deck of {own_deck()} lines without its tables; sides of elements for both surfaces; "
         "resultants are taken from its clamps, because it numbers the contact nodes anew",
         "three numbers, found in some twenty runs with the answer known: stiffness of the springs "
         f"{peers.STIFFNESS:g} E/h and the same while they stick, h the least nodal length; tension of open "
         f"springs {peers.TENSION:g} E: with its own one the blocks with friction at N = 22 move 5 % differently"],
    ]
    lines = ["## What it took", "", *table(["", "to write", "to choose"], rows)]
    if left_out:
        lines += ["Left out: " + "; ".join(f"{PEERS[name].title} ({why})" for name, why in left_out.items()) + ".", ""]
    return [*lines, "Code_Aster is not in Debian.", ""]


def page(rows: list[Row], left_out: dict[str, str], remark: str) -> str:
    have = versions()
    parts = []
    for scene in SCENES:
        sizes = sorted({row["N"] for row in where(rows, scene=scene)})
        if sizes:
            parts += [f"## {TITLES[scene]}", "", WORDS[scene], "",
                      *(line for N in sizes for line in scene_table(rows, scene, N))]
    most = max(row["N"] for row in rows)
    least = max(row["repetition"] for row in where(rows, N=most)) + 1
    return "\n".join([
        "# Peers", "", *([f"**{remark}**", ""] if remark else []),
        "Generated by `scripts/study peers`: the same nodes and triangles by ddmpi, by other programs, and by "
        "hand. Seconds are of the whole process from start to end, the smallest of up to "
        f"{max(row['repetition'] for row in rows) + 1} repetitions (N = {most}: {least}), in turns. ddmpi also makes "
        "the mesh of the blocks, estimates the discretization error, certifies its answer and writes its results; the "
        "others read a mesh, and writing their input is not timed. `one` is one process on one thread; `two` is two "
        "processes for ddmpi and the dense method on MUMPS, where each has a body, and two threads for the others. "
        "MiB: the largest process, on one. `difference to ddmpi` is the largest of those in force, pressure and "
        "displacement, each relative to its size.", "",
        f"{processor()}, {os.cpu_count()} cores, PETSc {have['petsc']}, {have['mpi']}.", "",
        "All but CalculiX solve the same discrete problem, so that their answers differ by rounding and by ddmpi's "
        "tolerance of 1e-8. CalculiX has contact springs, and large rotations wherever there is contact: at a "
        "hundredth of the load its blocks differ from ddmpi's by 4e-4. At N = 22 ddmpi's seconds are mostly the "
        "start of Python, MPI and PETSc; others start faster.", "",
        *effort_table(left_out), *parts])


def main() -> None:
    parser = arguments(__doc__, "peers")
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES), help="default: all")
    parser.add_argument("--sizes", nargs="+", type=int, default=list(SIZES), metavar="N", help="default: %(default)s")
    parser.add_argument("--peers", nargs="+", choices=list(PEERS), default=list(PEERS), help="default: all")
    parser.add_argument("--repetitions", type=int, metavar="R", help="default: 2 or 3, by size")
    parser.add_argument("--limit", type=float, default=LIMIT, metavar="S", help="seconds of a run (%(default)s)")
    parser.add_argument("--remark", default="", metavar="TEXT", help="a line under the title of the page")
    options = parser.parse_args()
    left_out = {name: why for name, peer in PEERS.items() if (why := peer.missing())}
    for name, why in left_out.items():
        print(f"{PEERS[name].title} is left out: {why}", file=sys.stderr)

    def part(names: Iterable[str], scenes: Iterable[str]) -> list[tuple[str, str]]:
        return [(scene, name) for scene in scenes for name in names
                if name not in left_out and scene in PEERS[name].scenes]

    ledger = Ledger(MPI.COMM_WORLD, options.output / "peers.csv", KEY, MEASURED)
    with tempfile.TemporaryDirectory() as folder:
        rows = ledger.fill([(scene, N, name, count, k) for N in options.sizes for each in options.scenes
                            for k in range(options.repetitions or SIZES.get(N, 2))
                            for scene, name in part(options.peers, [each]) for count in (1, 2)],
                           Runs(ledger.rows, Path(folder), options.limit))
    text = page(rows, left_out, options.remark)
    complete = all(where(rows, scene=scene, N=N, peer=name) for N in SIZES for scene, name in part(PEERS, SCENES))
    publish("peers.md", text, options.output, complete)
    print(text)


if __name__ == "__main__":
    main()
