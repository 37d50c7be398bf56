#!/usr/bin/env bash
"exec" "bash" "-c" '. "${0%/*}/../setup.sh"; exec "$PYTHON" "$0" "$@"' "$0" "$@"  # to Python, a string

__doc__ = """The same scenes by ddmpi, by other programs of Debian and PyPI, and by hand: time, answer, what it took.

All get the same nodes and triangles, and run in turns, never two at once: each as a process of its own, timed from
start to end, on one thread or process and on two. Writes to the folder --output peers.csv (a line per run, written at
once, so that an interrupted comparison continues) and peers.md; once all scenes and sizes are done, the page is also
written to docs/tables/. What is not installed is named and left out.
"""

import glob
import importlib.util
import math
import os
import platform
import shutil
import sys
import tempfile
from collections.abc import Iterable
from pathlib import Path

sys.path.insert(1, str(Path(__file__).resolve().parents[1]))

import calculix
import freefem
import program
from case import Case, read_answer
from experiment import ROOT, Ledger, Row, arguments, publish, table, where
from measure import Peer, Result, measure
from mpi4py import MPI
from scenes_of_peers import SCENES, SUMMIT, write_case

from ddmpi.system.provenance import versions

sys.path.insert(1, str(ROOT / "tests"))

from scenes import clean_environment

HERE = Path(__file__).resolve().parent

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
    return lambda folder, count: [sys.executable, str(HERE / name), str(folder), *words]


def by_hand(title: str, kind: str, scenes=tuple(SCENES), missing=lambda: lacks_module("skfem"), **more) -> Peer:
    return Peer(title, scenes, missing, more.pop("command", script("active_set.py", kind)),
                lambda case, folder: read_answer(folder), **more)


PEERS = {
    "ddmpi": Peer("ddmpi", tuple(SCENES), lambda: None, program.command, program.read_output, program.clear, True),
    "petsc-dense": by_hand(
        "by hand, dense, PETSc's MUMPS", "petsc-dense", HELD, processes=True,
        command=lambda folder, count: ["mpirun", "-n", str(count), *script("active_set.py", "petsc-dense")(folder, 1)]),
    "petsc": by_hand("by hand, sparse, PETSc's MUMPS", "petsc"),
    "scipy-dense": by_hand("by hand, dense, SciPy's SuperLU", "scipy-dense", HELD),
    "scipy": by_hand("by hand, sparse, SciPy's SuperLU", "scipy"),
    "getfem": Peer("GetFEM", tuple(SCENES), lambda: lacks_module("getfem"), script("getfem_peer.py"),
                   lambda case, folder: read_answer(folder)),
    "freefem": Peer("FreeFEM", tuple(SCENES), lacks_freefem, freefem.command, freefem.read_output,
                    freefem.write_input),
    "calculix": Peer("CalculiX", tuple(SCENES), lambda: lacks_program("ccx"), calculix.command, calculix.read_output,
                     calculix.write_input),
}


# Measurements

def environment() -> dict[str, str]:
    found = clean_environment()
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
        text = calculix.deck(write_case("blocks", 2, Path(folder)))
    tables = ("*NODE, ", "*ELEMENT", "*NSET, NSET=B", "*BOUNDARY", "*SURFACE, ", "*CLOAD")
    return sum(1 if ("*" + part).startswith(tables) else len(part.splitlines()) for part in text.split("*")[1:])


def effort_table(left_out: dict[str, str]) -> list[str]:
    own = lines_of(ROOT / "configs" / "pinched_blocks.toml", "#")
    hand, getfem = lines_of(HERE / "active_set.py", "#"), lines_of(HERE / "getfem_peer.py", "#")
    free = lines_of(HERE / "freefem_contact.edp", "//")
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
         f"{calculix.STIFFNESS:g} E/h and the same while they stick, h the least nodal length; tension of open "
         f"springs {calculix.TENSION:g} E: with its own one the blocks with friction at N = 22 move 5 % differently"],
    ]
    lines = ["## What it took", "", *table(["", "to write", "to choose"], rows)]
    if left_out:
        lines += ["Left out: " + "; ".join(f"{PEERS[name].title} ({why})" for name, why in left_out.items()) + ".", ""]
    return [*lines, "Code_Aster is not in Debian.", ""]


def page(rows: list[Row], left_out: dict[str, str], remark: str) -> str:
    have = versions()
    with open("/proc/cpuinfo", encoding="utf-8") as file:
        processor = next((line.split(":")[1].strip() for line in file if line.startswith("model name")),
                         platform.processor())
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
        "Generated by `scripts/peers/compare.py`: the same nodes and triangles by ddmpi, by other programs, and by "
        "hand. Seconds are of the whole process from start to end, the smallest of up to "
        f"{max(row['repetition'] for row in rows) + 1} repetitions (N = {most}: {least}), in turns. ddmpi also makes "
        "the mesh of the blocks, estimates the discretization error, certifies its answer and writes its results; the "
        "others read a mesh, and writing their input is not timed. `one` is one process on one thread; `two` is two "
        "processes for ddmpi and the dense method on MUMPS, where each has a body, and two threads for the others. "
        "MiB: the largest process, on one. `difference to ddmpi` is the largest of those in force, pressure and "
        "displacement, each relative to its size.", "",
        f"{processor}, {os.cpu_count()} cores, PETSc {have['petsc']}, {have['mpi']}.", "",
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
