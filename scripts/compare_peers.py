"""The same solids by ddmpi, by other programs of Debian and PyPI, and by hand: time, answer, what it took.

All get the same nodes and cells, and run in turns, never two at once: each as a process of its own on one thread, timed
from start to end. Writes to the folder --output peers.csv (a line per run, written at once, so that an interrupted
comparison continues) and peers.md; once all scenes and sizes are done, the page is also written to docs/tables/. What
is not installed is named and left out.
"""

from __future__ import annotations

import functools
import importlib.util
import json
import math
import os
import resource
import shutil
import signal
import subprocess
import sys
import tempfile
from collections.abc import Callable, Collection
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import peers
from experiment import ROOT, Ledger, Row, arguments, number, processor, publish, table, where
from mpi4py import MPI
from peers import Answer, Case, read_answer
from peers.scenes import FORCE, MOVED, SCENES, write_case
from scenes import clean_environment
from tradeoff import in_box

from ddmpi.system.provenance import versions

PROGRAMS = ROOT / "scripts" / "peers"


# One run of one peer: a process with a time limit

LAUNCH = """
import json, os, subprocess, sys, time
start = time.perf_counter()
child = subprocess.Popen(sys.argv[2:], stdin=subprocess.DEVNULL)
_, status, usage = os.wait4(child.pid, 0)
found = {"seconds": time.perf_counter() - start, "processor": usage.ru_utime + usage.ru_stime,
         "memory": usage.ru_maxrss / 1024, "code": os.waitstatus_to_exitcode(status)}
with open(sys.argv[1], "w") as file:
    json.dump(found, file)
"""
"""Runs a command; writes its seconds, those of processors, the peak memory (MiB) of its largest process and its exit
code to a file.

A small process of its own, because Linux counts the memory of a process that starts another one as that one's.
"""


@dataclass(frozen=True)
class Peer:
    """A program, or a way to write one.

    Attributes
    ----------
    title : what the tables call it
    needs : the module or program
    command : from the folder
    write : its input; not timed
    read : its answer
    order : of the elements
    scenes : that it can do
    """

    title: str
    needs: str
    command: Callable[[Path], list[str]]
    read: Callable[[Case, Path], Answer]
    write: Callable[[Case, Path], object] = lambda case, folder: None
    order: int = 1
    scenes: Collection[str] = tuple(SCENES)

    @property
    def missing(self) -> bool:
        return not (shutil.which(self.needs) or importlib.util.find_spec(self.needs))


@dataclass(frozen=True)
class Result:
    """Seconds on the clock and of processors, peak memory of the largest process (MiB), and the answer or why there is
    none."""

    seconds: float
    processor: float
    memory: float
    answer: Answer | None
    failure: str = ""


def measure(peer: Peer, case: Case, folder: Path, limit: float) -> Result:
    """Run a peer on one thread, for at most `limit` seconds of processors, 4 `limit` on the clock."""
    peer.write(case, folder)
    environment = clean_environment() | {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1"}
    environment["PYTHONPATH"] = f"{PROGRAMS.parent}:{environment['PYTHONPATH']}"
    command = [sys.executable, "-S", "-c", LAUNCH, "found.json", *peer.command(folder)]
    most = max(math.ceil(limit), 1)
    gone = Result(math.nan, limit, math.nan, None, f"{LATE} {limit:.0f} s")
    with open(folder / "output.txt", "w+", encoding="utf-8", errors="replace") as output:
        child = subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            start_new_session=True,
            stdout=output,
            stderr=subprocess.STDOUT,
            preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most + 5)),
        )
        try:
            child.wait(4 * limit)
        except subprocess.TimeoutExpired:
            os.killpg(child.pid, signal.SIGKILL)  # the session that it leads
            child.wait()
            return gone
        found = json.loads((folder / "found.json").read_text(encoding="utf-8"))
        spent = found["seconds"], found["processor"], found["memory"]
        if found["code"]:
            if found["code"] == -signal.SIGXCPU or found["processor"] > 0.9 * most:
                return gone
            output.seek(0)
            last = [line.strip() for line in output if line.strip()][-1:] or ["no word"]
            return Result(
                *spent, None, f"{last[0][:200].replace('|', '/')} (exit code {found['code']})"
            )
    try:
        return Result(*spent, peer.read(case, folder))
    except (OSError, ValueError, RuntimeError) as error:
        return Result(*spent, None, str(error)[:200])


# The comparison

LIMIT = 600.0
"""Seconds of processors after which a run is given up, and on finer meshes not tried."""

LATE = "not done in"
"""How the failure of a run begins that was given up."""

KEY = ("scene", "N", "peer", "repetition")
MEASURED = (
    "unknowns",
    "pairs",
    "seconds",
    "processor",
    "memory",
    "iterations",
    "normal",
    "tangential",
    "pressure",
    "x",
    "y",
    "z",
    "moved",
    "failure",
)

GRID = np.stack(np.meshgrid(*3 * [np.linspace(0.0, 1.0, 5)]), axis=-1).reshape(-1, 3)
"""The points of a box of side 1 at which displacements are compared, whatever the meshes."""


# Who takes part


def script(name: str) -> dict:
    """How a program of peers/ is started and read."""
    return {
        "command": lambda folder: [sys.executable, "-m", f"peers.{name}", str(folder)],
        "read": lambda case, folder: read_answer(folder),
    }


def calculix(title: str, kind: str, order: int = 1) -> Peer:
    return Peer(
        title, "ccx", peers.calculix_command, peers.read_calculix, peers.write_calculix(kind), order
    )


def ddmpi(title: str, order: int) -> Peer:
    return Peer(title, "ddmpi", peers.ddmpi_command, peers.read_ddmpi, peers.clear_ddmpi, order)


PEERS = {
    "ddmpi": ddmpi("ddmpi", 1),
    "petsc": Peer("by hand, sparse, PETSc's MUMPS", "skfem", **script("active_set")),
    "getfem": Peer("GetFEM", "getfem", **script("getfem_peer")),
    "calculix-faces": calculix("CalculiX, face to face", "SURFACE TO SURFACE"),
    "calculix-mortar": calculix("CalculiX, mortar", "LINMORTAR"),
    "ddmpi-2": ddmpi("ddmpi, order 2", 2),
    "getfem-2": Peer(
        "GetFEM, integral brick, order 2",
        "getfem",
        order=2,
        scenes=[name for name in SCENES if name != "ball"],
        **script("getfem_peer"),
    ),
    "calculix-2": calculix("CalculiX, face to face, order 2", "SURFACE TO SURFACE", 2),
}
"""In the order of the tables."""


# Measurements


def row_of(case: Case, result: Result) -> Row:
    answer = result.answer
    normal, tangential = answer.force if answer else (math.nan,) * 2
    x, y, z = answer.displacement[case.watched] if answer else (math.nan,) * 3
    return {
        "unknowns": case.load.size - case.clamped.size,
        "pairs": len(case.pairs),
        "seconds": round(result.seconds, 4),
        "processor": round(result.processor, 3),
        "memory": round(result.memory, 1),
        "iterations": answer.iterations if answer else 0,
        "normal": float(normal),
        "tangential": float(tangential),
        "pressure": answer.pressure if answer else math.nan,
        "x": float(x),
        "y": float(y),
        "z": float(z),
        "moved": moved(case, answer.displacement) if answer else "",
        "failure": result.failure,
    }


def moved(case: Case, u: np.ndarray) -> str:
    """The displacements (m) at GRID in every body, in words; none of bodies that are no boxes."""
    if case.rigid:
        return ""
    order, found = 1 if case.cells.shape[1] == 4 else 2, []
    for body in range(case.body.max() + 1):
        nodes = np.unique(case.cells[case.body == body])
        low, high = case.points[nodes].min(axis=0), case.points[nodes].max(axis=0)
        found.append(in_box(case.points[nodes], u[nodes], order, low + GRID * (high - low)))
    return " ".join(f"{value:.7g}" for value in np.concatenate(found).ravel())


def best(rows: list[Row]) -> Row | None:
    """The repetition with the smallest time, with the largest memory of all."""
    done = [row for row in rows if not row["failure"]]
    return (
        min(done, key=lambda row: row["processor"]) | {"memory": max(row["memory"] for row in done)}
        if done
        else None
    )


def difference(row: Row, other: Row) -> float:
    """The largest of those that the scene compares, each relative to its size in `row`; of displacements all that
    both have."""

    def values(of: Row, names: tuple[str, ...]) -> list[float]:
        everywhere = names == MOVED and row["moved"] and other["moved"]
        return [*map(float, of["moved"].split())] if everywhere else [of[name] for name in names]

    return max(
        math.dist(values(other, names), values(row, names)) / math.hypot(*values(row, names))
        for names in SCENES[row["scene"]].compared
    )


def fine_answer(rows: list[Row], scene: str) -> Row | None:
    """What errors are measured against."""
    its = SCENES[scene]
    fine = best(where(rows, scene=scene, N=its.fine, peer="ddmpi-2"))
    return fine and fine | its.exact


# The page


def found_in(row: Row) -> list[str]:
    """Cells of a table: forces, pressure and displacement; rounding errors are zero."""

    def shown(names: tuple[str, ...], digits: int) -> list[str]:
        values = [row[name] for name in names if not math.isnan(row[name])]
        return [
            f"{value if abs(value) > 1e-10 * math.hypot(*values) else 0.0:.{digits}g}"
            for value in values
        ]

    return [*shown(FORCE, 7), f"{row['pressure']:.6g}; ({', '.join(shown(MOVED, 5))})"]


def scene_table(rows: list[Row], scene: str, N: int) -> list[str]:
    fine, own = fine_answer(rows, scene), best(where(rows, scene=scene, N=N, peer="ddmpi"))
    lines = []
    for name, peer in PEERS.items():
        runs = where(rows, scene=scene, N=N, peer=name)
        if not runs:
            continue
        row, start = best(runs), [peer.title, f"{runs[0]['unknowns']:,}"]
        if row is None:
            lines.append([*start, *["–"] * 6, f"**{runs[0]['failure']}**", "–", "–"])
            continue
        alike = peer.order == 1 and name != "ddmpi"
        lines.append(
            [
                *start,
                f"{row['processor']:.2f}",
                f"{row['seconds']:.2f}",
                f"{row['memory']:.0f}",
                row["iterations"],
                *found_in(row),
                "" if not alike else "–" if own is None else f"{difference(own, row):.0e}",
                "–" if fine is None else f"{difference(fine, row):.2%}",
            ]
        )
    pairs = max(row["pairs"] for row in where(rows, scene=scene, N=N))
    return [
        f"### N = {N}: {pairs} pairs of nodes at order 1",
        "",
        *table(
            [
                "",
                "unknowns",
                "processor (s)",
                "clock (s)",
                "MiB",
                "iterations",
                "normal force",
                "tangential force",
                "largest pressure; displacement",
                "difference to ddmpi",
                "error",
            ],
            lines,
        ),
    ]


def fine_words(rows: list[Row], scene: str) -> str:
    """What errors are measured against, after "the larger one of"."""
    row = fine_answer(rows, scene)
    if row is None:
        return f"of order 2 with N = {SCENES[scene].fine}, which is not there yet."
    forces, pushed, rest = found_in(row)
    return (
        f"of order 2 with N = {row['N']}, {row['unknowns']:,} unknowns, {row['processor']:.0f} s: {forces}, "
        f"{pushed}; {rest}."
    )


def short_table(rows: list[Row]) -> list[str]:
    """How many times as long as ddmpi peers take in space, at equal unknowns and at equal error."""
    lines = []
    for scene in SCENES:
        fine = fine_answer(rows, scene)
        own = [
            row
            for N in (*SCENES[scene].sizes, *SCENES[scene].between)
            for name in ("ddmpi", "ddmpi-2")
            if (row := best(where(rows, scene=scene, N=N, peer=name)))
        ]
        for name, peer in PEERS.items():
            sizes = [N for N in SCENES[scene].sizes if where(rows, scene=scene, N=N, peer=name)]
            done = max(
                (N for N in sizes if best(where(rows, scene=scene, N=N, peer=name))), default=0
            )
            for N in [N for N in sizes if done <= N][: 2 if done else 1]:
                runs = where(rows, scene=scene, N=N, peer=name)
                same = best(
                    where(rows, scene=scene, N=N, peer="ddmpi-2" if peer.order == 2 else "ddmpi")
                )
                if name in ("ddmpi", "ddmpi-2") or not runs or same is None:
                    continue
                row, start = best(runs), [scene, peer.title, N, f"{runs[0]['unknowns']:,}"]
                if row is None:
                    over = LATE in runs[0]["failure"] and not math.isnan(runs[0]["processor"])
                    lines.append(
                        [
                            *start,
                            runs[0]["failure"],
                            f"> {runs[0]['processor'] / same['processor']:.0f}" if over else "–",
                            "–",
                            "–",
                        ]
                    )
                    continue
                error = math.nan if fine is None else difference(fine, row)
                cheap = min(
                    (
                        each["processor"]
                        for each in own
                        if fine and difference(fine, each) <= 1.02 * error
                    ),
                    default=math.nan,
                )
                lines.append(
                    [
                        *start,
                        f"{row['processor']:.1f}",
                        f"{row['processor'] / same['processor']:.1f}",
                        number(error, ".2%"),
                        number(row["processor"] / cheap, ".1f"),
                    ]
                )
    return table(
        [
            "scene",
            "",
            "N",
            "unknowns",
            "processor (s)",
            "times, equal unknowns",
            "error",
            "times, equal error",
        ],
        lines,
    )


def write_page(rows: list[Row], folder: Path, complete: bool) -> None:
    """docs/tables/peers.md, which has all words."""
    have = versions()
    done = [
        scene
        for scene, its in SCENES.items()
        if any(where(rows, scene=scene, N=N) for N in its.sizes)
    ]
    publish(
        "peers.md",
        {"Solids in short": short_table(rows)}
        | {
            SCENES[scene].title: [
                line
                for N in SCENES[scene].sizes
                if where(rows, scene=scene, N=N)
                for line in scene_table(rows, scene, N)
            ]
            for scene in done
        },
        folder,
        complete,
        {
            ".* cores, PETSc .*": f"{processor()}, {os.cpu_count()} cores, PETSc {have['petsc']}, {have['mpi']}."
        }
        | {
            f"of order 2 with N = {SCENES[scene].fine},.*": fine_words(rows, scene)
            for scene in done
        },
    )


def main() -> None:
    parser = arguments(__doc__, "peers")
    parser.add_argument(
        "--scenes", nargs="+", choices=list(SCENES), default=list(SCENES), help="default: all"
    )
    parser.add_argument(
        "--sizes",
        nargs="+",
        type=int,
        metavar="N",
        help="default: each scene's own, and fine answers",
    )
    parser.add_argument(
        "--peers", nargs="+", choices=list(PEERS), default=list(PEERS), help="default: all"
    )
    options = parser.parse_args()
    for peer in (each for each in PEERS.values() if each.missing):
        print(f"{peer.title} is left out: there is no {peer.needs}", file=sys.stderr)
    runs: list[tuple] = []  # the coarse meshes first
    for scene, its in SCENES.items():
        having = [name for name, peer in PEERS.items() if not peer.missing and scene in peer.scenes]
        runs += [
            (place, scene, N, name, k)
            for place, (N, times) in enumerate(its.sizes.items())
            for k in range(times)
            for name in having
        ]
        runs += [(1, scene, N, "ddmpi-2", 0) for N in (*its.between, its.fine)]
    runs = [rest for _, *rest in sorted(runs, key=lambda each: each[0])]
    wanted = [
        (scene, N, peer, k)
        for scene, N, peer, k in runs
        if scene in options.scenes and N in (options.sizes or [N]) and peer in options.peers
    ]
    ledger = Ledger(MPI.COMM_WORLD, options.output / "peers.csv", KEY, MEASURED)
    with tempfile.TemporaryDirectory() as folder:

        @functools.lru_cache(maxsize=1)
        def written(scene: str, N: int, order: int) -> tuple[Case, Path]:
            place = Path(folder) / f"{scene}{N}-{order}"
            place.mkdir(exist_ok=True)
            return write_case(scene, N, place, order), place

        def run(scene: str, N: int, name: str, repetition: int) -> Row:
            """A peer that has failed on a scene is not asked again, nor for finer meshes of it if it took too long."""
            case, place = written(scene, N, PEERS[name].order)
            before = [
                row
                for row in where(ledger.rows, scene=scene, peer=name)
                if row["failure"] and (row["N"] == N or (row["N"] < N and LATE in row["failure"]))
            ]
            if before:
                return row_of(
                    case, Result(math.nan, math.nan, math.nan, None, before[0]["failure"])
                )
            (place / "answer.npz").unlink(missing_ok=True)
            return row_of(case, measure(PEERS[name], case, place, LIMIT))

        rows = ledger.fill(wanted, run)
    complete = all(where(rows, scene=scene, N=N, peer=name) for scene, N, name, _ in runs)
    write_page(rows, options.output, complete)


if __name__ == "__main__":
    main()
