"""The same solids by ddmpi, by other programs of Debian and PyPI, and by hand: time, answer, what it took.

All get the same nodes and cells, and run in turns, never two at once: each as a process of its own on one thread, timed
from start to end. Writes to the folder --output peers.csv (a line per run, written at once, so that an interrupted
comparison continues) and peers.md; once all scenes and sizes are done, the page is also written to docs/tables/. What
is not installed is named and left out.
"""

from __future__ import annotations

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
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import peers
from experiment import ROOT, Ledger, Row, arguments, processor, publish, table, where
from mpi4py import MPI
from peers import Answer, Case, read_answer
from problems.solids import half_ball
from scenes import clean_environment, to_toml
from scipy.spatial import cKDTree
from solid_scenes import box, two_boxes

from ddmpi.mesh.build import build_mesh
from ddmpi.mesh.elements import facet_shares
from ddmpi.scene.reader import read_scene
from ddmpi.system.provenance import versions

PROGRAMS = ROOT / "scripts" / "peers"


# Scenes, as ddmpi reads them, and, from its own meshes, as a Case for everybody else

POISSON = 0.3
BALL = 0.1
"""Hertz's radius of the contact of a ball of 1 m and 1 Pa with a rigid plane (m)."""

PRESSED = 4 * BALL**3 / 3 / (1 - POISSON**2)
"""The force on it (N)."""


def boxes(N: int, folder: Path, order: int) -> dict:
    """At order 2 with as many nodes, and meshes that do not match."""
    return two_boxes(N) if order == 1 else two_boxes(N // 2, round(0.85 * (N // 2)), 2)


FRICTION = {"law": "coulomb", "coefficient": 0.3}


def tall(N: int, folder: Path, order: int) -> dict:
    """Cubes on each other, pushed along both sides at the top; nothing but contacts holds the upper three."""
    n = N // order
    bodies = [box(f"cube{k}", (0, 0, k), (1, 1, 1), (n, n, n), order, 2.119e11, 0.277) for k in range(4)]
    bodies[0]["clamp"] = ["bottom"]
    bodies[3]["traction"] = [{"on": "top", "value": [5.0e6, 2.5e6, -6.0e7]}]
    return {"body": bodies, "contact": [{"bodies": [f"cube{k + 1}", f"cube{k}"], "on": ["bottom", "top"],
                                         "friction": FRICTION} for k in range(3)]}


def ball(N: int, folder: Path, order: int) -> dict:
    """A quarter of a half ball; N elements of order 1, or as many nodes, on the diameter of the contact."""
    mesh = half_ball(folder / "ball.msh", BALL, 2 * BALL * order / N, 2 if order == 2 else 1)
    return {"rigid": [{"name": "plane", "shape": "plane", "point": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}],
            "body": [{"name": "ball", "mesh": mesh, "material": {"young": 1.0, "poisson": POISSON},
                      "clamp": [{"on": "start", "y": 0.0}, {"on": "end", "x": 0.0}],
                      "traction": [{"on": "top", "force": [0.0, 0.0, -PRESSED / 4]}]}],
            "contact": [{"bodies": ["ball", "plane"], "on": ["contact"]}]}


def wall(N: int, folder: Path, order: int) -> dict:
    """Fourteen bricks in running bond, N cells of order 1 on a quarter of a brick and its open joint."""
    cell, n = 0.03, N // order
    courses = [[(0, 7), (8, 7), (16, 7)], [(0, 3), (4, 7), (12, 7), (20, 3)]] * 2
    bodies, contacts = [], []
    for level, course in enumerate(courses):
        for k, (start, length) in enumerate(course):
            held = {"clamp": ["bottom"]} if level == 0 else {}
            pushed = {"traction": [{"on": "top", "value": [1.5e4, 1.0e4, -5.0e4]}]} if level == 3 else {}
            bodies.append(box(f"brick{level}{k}", (start * cell, 0, 2 * cell * level),
                              (length * cell, 4 * cell, 2 * cell), (length * n, 4 * n, 2 * n), order, 1e10, 0.2,
                              **held, **pushed))
            contacts += [{"bodies": [f"brick{level}{k}", f"brick{level - 1}{below}"], "on": ["bottom", "top"],
                          "friction": FRICTION | {"coefficient": 0.6}}
                         for below, (at, size) in enumerate(courses[level - 1] if level else [])
                         if at < start + length and start < at + size]
    return {"body": bodies, "contact": sorted(contacts, key=lambda contact: contact["bodies"][1])}


@dataclass(frozen=True)
class Scene:
    """A scene by its fineness N.

    Attributes
    ----------
    make : the scene for ddmpi from N, a folder and the order of the elements
    watched : the point whose displacement is compared (m)
    sizes : how often each N is measured
    fine : N of the fine answer of order 2
    compared : groups of columns of which the worst relative difference counts
    exact : known values, of the columns that they name
    contacts : how many contacts make up the force that is compared
    """

    title: str
    words: str
    make: Callable[[int, Path, int], dict]
    watched: tuple[float, float, float]
    sizes: Mapping[int, int]
    fine: int
    compared: Collection[tuple[str, ...]] = (("normal", "tangential"), ("x", "y", "z"))
    exact: Mapping[str, float] = field(default_factory=dict)
    contacts: int = 1


FORCE, MOVED = ("normal", "tangential"), ("x", "y", "z")
WORDS = {FORCE: "force", MOVED: "displacement", ("pressure",): "largest pressure"}
SCENES = {
    "boxes": Scene(
        "Two boxes in space with Coulomb friction 0.3", "`configs/two_boxes.toml` with cubes of side 1/N, each cut "
        "into six tetrahedra; at order 2 cubes of side 2/N and, on the lower box, by 0.85 fewer. A part of the contact "
        "is open, a part sticks, most of it slips. Displacement of the corner (3, 2, 1).", boxes, (3.0, 2.0, 1.0),
        {8: 2, 16: 1, 22: 1}, 28),
    "tall": Scene(
        "A loose stack of four cubes with Coulomb friction 0.3", "Cubes of 1 m on each other, of N cells a side, "
        "pushed sideways at the top; only the lowest is clamped. The force, that of the lowest contact, is decided by "
        "the load. Displacement of the corner (1, 1, 4).", tall, (1.0, 1.0, 4.0), {6: 2, 12: 1, 18: 1}, 24),
    "ball": Scene(
        "A ball on a rigid plane", "A quarter of a half ball, R = 1 m, E = 1 Pa, N elements on the diameter of Hertz's "
        "contact, a = 0.1 m. Nothing but its contact holds the ball in z; no friction. The pressure is compared with "
        "Hertz's, the displacement, of the middle of the cut, with the fine answer's.", ball, (0.0, 0.0, 1.0),
        {10: 2, 20: 1, 40: 1}, 60, (("pressure",), MOVED), {"pressure": 2 * BALL / np.pi / (1 - POISSON**2)}),
    "wall": Scene(
        "A wall of fourteen bricks with Coulomb friction 0.6", "Running bond, 4 courses, 0.69 × 0.12 × 0.24 m, upright "
        "joints open by 30 mm; cells of 30/N mm. Only the lowest course is clamped; the uppermost is pressed and "
        "pushed along and across. The force is that of both contacts of the first brick. Displacement of the corner "
        "(0.69, 0.12, 0.24).", wall, (0.69, 0.12, 0.24), {2: 2, 4: 1}, 6, contacts=2),
}
"""By name."""


def write_case(name: str, N: int, folder: Path, order: int = 1) -> Case:
    """scene.toml for ddmpi and the same as a Case, both in the folder."""
    its = SCENES[name]
    scene = its.make(N, folder, order)
    (folder / "scene.toml").write_text(to_toml(scene), encoding="utf-8")
    case = case_of(scene, its.watched, its.contacts)
    case.save(folder)
    return case


def case_of(scene: dict, watched: tuple[float, float, float], contacts: int) -> Case:
    """The Case of a scene whose contacts are flat and whose nodes match, or of one with the rigid plane through the
    origin across the last axis. At order 2 nodes need not match."""
    meshes = {body.name: build_mesh(body) for body in read_scene("a scene of peers", to_toml(scene)).body}
    counts = [len(mesh.points) for mesh in meshes.values()]
    starts = dict(zip(meshes, np.cumsum([0, *counts[:-1]]), strict=True))
    points = np.concatenate([mesh.points for mesh in meshes.values()])
    order = next(iter(meshes.values())).order

    def facets_of(name: str, group: str) -> np.ndarray:
        return starts[name] + meshes[name].facets(group).nodes

    clamped, load = [], np.zeros(points.shape)
    for body in scene["body"]:
        for clamp in body.get("clamp", []):
            clamp = {"on": clamp} | dict.fromkeys("xyz") if isinstance(clamp, str) else clamp
            nodes = np.unique(facets_of(body["name"], clamp["on"]))
            clamped += [3 * nodes + c for c, component in enumerate("xyz") if component in clamp]
        for traction in body.get("traction", []):
            facets = facets_of(body["name"], traction["on"])
            shares = facet_shares(points[facets])
            value = traction["value"] if "value" in traction else np.array(traction["force"]) / shares.sum()
            np.add.at(load, facets, shares[:, :, None] * np.array(value))
    held = np.unique(np.concatenate(clamped))

    parts, shown = [], []
    for number, contact in enumerate(scene["contact"]):
        sides = [facets_of(name, on) for name, on in zip(contact["bodies"], contact["on"], strict=False)]
        nodes = np.unique(sides[0])
        partner = np.full(len(nodes), -1)
        if len(sides) == 2:  # what matches; at order 2 everything, if nothing does
            facing = np.unique(sides[1])
            away, nearest = cKDTree(points[facing]).query(points[nodes])
            there = away < 1e-9
            covered = [np.isin(side, its).all(axis=1) for side, its in
                       zip(sides, (nodes[there], facing[nearest[there]]), strict=True)]
            if covered[0].any() and covered[1].any():
                sides = [side[its] for side, its in zip(sides, covered, strict=True)]
                there &= np.isin(nodes, sides[0])
            elif order == 1:
                raise ValueError(f"the nodes of {' and '.join(contact['bodies'])} do not match")
            nodes, partner = nodes[there], facing[nearest[there]]
        share = np.bincount(sides[0].ravel(), facet_shares(points[sides[0]]).ravel(), len(points))[nodes]
        pairs = np.column_stack([nodes, partner])[:len(nodes) if order == 1 else 0]
        dofs = 3 * pairs[:, :, None] + np.arange(3)
        moves = ~np.isin(dofs, held).all(axis=(1, 2))
        gap = np.where(partner < 0, points[nodes, -1], 0.0)
        parts.append([pairs[moves], *(each[:len(pairs)][moves] for each in (gap, share, np.full(len(nodes), number)))])
        shown += [(facets, (number, which)) for which, facets in enumerate(sides)]
    pairs, gap, area, numbers = (np.concatenate(each) for each in zip(*parts, strict=True))
    across = -1 if (pairs < 0).any() else int(np.ptp(points[shown[0][0]], axis=(0, 1)).argmin())
    material, friction = scene["body"][0]["material"], scene["contact"][0].get("friction", {})
    return Case(points, np.concatenate([starts[name] + mesh.triangles for name, mesh in meshes.items()]),
                np.repeat(np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes.values()]),
                material["young"], material["poisson"], held, load.ravel(), pairs,
                np.tile(-np.eye(3)[across], (len(pairs), 1)), gap, area, numbers,
                np.concatenate([facets for facets, _ in shown]),
                np.concatenate([np.tile(side, (len(facets), 1)) for facets, side in shown]),
                friction.get("coefficient", 0.0), int(np.linalg.norm(points - watched, axis=1).argmin()), contacts)


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
    missing : what is not there, or None
    command : from the folder
    write : its input; not timed
    read : its answer
    order : of the elements
    scenes : that it can do
    """

    title: str
    missing: Callable[[], str | None]
    command: Callable[[Path], list[str]]
    read: Callable[[Case, Path], Answer]
    write: Callable[[Case, Path], object] = lambda case, folder: None
    order: int = 1
    scenes: Collection[str] = tuple(SCENES)


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
        child = subprocess.Popen(command, cwd=folder, env=environment, start_new_session=True, stdout=output,
                                 stderr=subprocess.STDOUT,
                                 preexec_fn=lambda: resource.setrlimit(resource.RLIMIT_CPU, (most, most + 5)))
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
            return Result(*spent, None, f"{last[0][:200].replace('|', '/')} (exit code {found['code']})")
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
MEASURED = ("unknowns", "pairs", "seconds", "processor", "memory", "iterations", "normal", "tangential", "pressure",
            "x", "y", "z", "failure")


# Who takes part

def lacks_module(name: str) -> str | None:
    return None if importlib.util.find_spec(name) else f"no Python module {name}"


def lacks_program(name: str) -> str | None:
    return None if shutil.which(name) else f"no program {name}"


def script(name: str) -> dict:
    """How a program of peers/ is started and read."""
    return {"command": lambda folder: [sys.executable, "-m", f"peers.{name}", str(folder)],
            "read": lambda case, folder: read_answer(folder)}


def calculix(title: str, kind: str, order: int = 1) -> Peer:
    return Peer(title, lambda: lacks_program("ccx"), peers.calculix_command, peers.read_calculix,
                peers.write_calculix(kind), order)


def ddmpi(title: str, order: int) -> Peer:
    return Peer(title, lambda: None, peers.ddmpi_command, peers.read_ddmpi, peers.clear_ddmpi, order)


PEERS = {
    "ddmpi": ddmpi("ddmpi", 1),
    "petsc": Peer("by hand, sparse, PETSc's MUMPS", lambda: lacks_module("skfem"), **script("active_set")),
    "getfem": Peer("GetFEM", lambda: lacks_module("getfem"), **script("getfem_peer")),
    "calculix-faces": calculix("CalculiX, face to face", "SURFACE TO SURFACE"),
    "calculix-mortar": calculix("CalculiX, mortar", "LINMORTAR"),
    "ddmpi-2": ddmpi("ddmpi, order 2", 2),
    "getfem-2": Peer("GetFEM, integral brick, order 2", lambda: lacks_module("getfem"), order=2,
                     scenes=[name for name in SCENES if name != "ball"], **script("getfem_peer")),
    "calculix-2": calculix("CalculiX, face to face, order 2", "SURFACE TO SURFACE", 2),
}
"""In the order of the tables."""


# Measurements

def row_of(case: Case, result: Result) -> Row:
    answer = result.answer
    normal, tangential = answer.force if answer else (math.nan,) * 2
    x, y, z = answer.displacement if answer else (math.nan,) * 3
    return {"unknowns": case.load.size - case.clamped.size, "pairs": len(case.pairs),
            "seconds": round(result.seconds, 4), "processor": round(result.processor, 3),
            "memory": round(result.memory, 1),
            "iterations": answer.iterations if answer else 0, "normal": float(normal), "tangential": float(tangential),
            "pressure": answer.pressure if answer else math.nan, "x": float(x), "y": float(y),
            "z": float(z), "failure": result.failure}


class Runs:
    """Runs peers in turns; a peer that has failed on a scene is not asked again, nor for finer meshes of it."""

    def __init__(self, rows: list[Row], folder: Path, limit: float) -> None:
        self.rows, self.folder, self.limit, self.cases = rows, folder, limit, {}

    def __call__(self, scene: str, N: int, peer: str, repetition: int) -> Row:
        order = PEERS[peer].order
        place = self.folder / f"{scene}{N}-{order}"
        if (scene, N, order) not in self.cases:
            place.mkdir(exist_ok=True)
            self.cases = {(scene, N, order): write_case(scene, N, place, order)}  # one at a time
        case = self.cases[scene, N, order]
        before = [row for row in where(self.rows, scene=scene, peer=peer)
                  if row["failure"] and (row["N"] == N or (row["N"] < N and LATE in row["failure"]))]
        if before:
            return row_of(case, Result(math.nan, math.nan, math.nan, None, before[0]["failure"]))
        (place / "answer.npz").unlink(missing_ok=True)
        return row_of(case, measure(PEERS[peer], case, place, self.limit))


def best(rows: list[Row]) -> Row | None:
    """The repetition with the smallest time, with the largest memory of all."""
    done = [row for row in rows if not row["failure"]]
    return min(done, key=lambda row: row["processor"]) | {
        "memory": max(row["memory"] for row in done)} if done else None


def difference(row: Row, other: Row) -> float:
    """The largest of those that the scene compares, each relative to its size in `row`."""
    return max(math.dist([other[name] for name in names], [row[name] for name in names])
               / math.hypot(*(row[name] for name in names))
               for names in SCENES[row["scene"]].compared)


def fine_answer(rows: list[Row], scene: str) -> Row | None:
    """What errors are measured against."""
    its = SCENES[scene]
    fine = best(where(rows, scene=scene, N=its.fine, peer="ddmpi-2"))
    return fine and fine | its.exact


# The page

def number(value: float, form: str) -> str:
    return "–" if math.isnan(value) else format(value, form)


def found_in(row: Row) -> list[str]:
    """Cells of a table: forces, pressure and displacement; rounding errors are zero."""
    def shown(names: tuple[str, ...], digits: int) -> list[str]:
        values = [row[name] for name in names if not math.isnan(row[name])]
        return [f"{value if abs(value) > 1e-10 * math.hypot(*values) else 0.0:.{digits}g}" for value in values]

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
        lines.append([*start, f"{row['processor']:.2f}", f"{row['seconds']:.2f}", f"{row['memory']:.0f}",
                      row["iterations"], *found_in(row),
                      "" if not alike else "–" if own is None else f"{difference(own, row):.0e}",
                      "–" if fine is None else f"{difference(fine, row):.1%}"])
    pairs = max(row["pairs"] for row in where(rows, scene=scene, N=N))
    return [f"### N = {N}: {pairs} pairs of nodes at order 1", "",
            *table(["", "unknowns", "processor (s)", "clock (s)", "MiB", "iterations", "normal force",
                    "tangential force", "largest pressure; displacement", "difference to ddmpi", "error"], lines)]


def fine_words(rows: list[Row], scene: str) -> list[str]:
    row = fine_answer(rows, scene)
    if row is None:
        return ["No fine answer yet.", ""]
    forces, pushed, rest = found_in(row)
    what = " and ".join(WORDS[names] for names in SCENES[scene].compared)
    return [f"The error is the larger one of {what} against ddmpi's answer of order 2 with N = {row['N']}, "
            f"{row['unknowns']:,} unknowns, {row['processor']:.0f} s: {forces}, {pushed}; {rest}.", ""]


def short_table(rows: list[Row]) -> list[str]:
    """How many times as long as ddmpi peers take in space, at equal unknowns and at equal error."""
    lines = []
    for scene in SCENES:
        fine = fine_answer(rows, scene)
        own = [row for N in SCENES[scene].sizes for name in ("ddmpi", "ddmpi-2")
               if (row := best(where(rows, scene=scene, N=N, peer=name)))]
        for name, peer in PEERS.items():
            sizes = [N for N in SCENES[scene].sizes if where(rows, scene=scene, N=N, peer=name)]
            done = max((N for N in sizes if best(where(rows, scene=scene, N=N, peer=name))), default=0)
            for N in [N for N in sizes if done <= N][:2 if done else 1]:
                runs = where(rows, scene=scene, N=N, peer=name)
                same = best(where(rows, scene=scene, N=N, peer="ddmpi-2" if peer.order == 2 else "ddmpi"))
                if name in ("ddmpi", "ddmpi-2") or not runs or same is None:
                    continue
                row, start = best(runs), [scene, peer.title, N, f"{runs[0]['unknowns']:,}"]
                if row is None:
                    over = LATE in runs[0]["failure"] and not math.isnan(runs[0]["processor"])
                    lines.append([*start, runs[0]["failure"],
                                  f"> {runs[0]['processor'] / same['processor']:.0f}" if over else "–", "–", "–"])
                    continue
                error = math.nan if fine is None else difference(fine, row)
                cheap = min((each["processor"] for each in own if fine and difference(fine, each) <= 1.02 * error),
                            default=math.nan)
                lines.append([*start, f"{row['processor']:.1f}", f"{row['processor'] / same['processor']:.1f}",
                              number(error, ".1%"), number(row["processor"] / cheap, ".1f")])
    return ["## Solids in short", "", "Processor seconds of peers, and how many times those of ddmpi they are: with "
            "the same nodes, and beside the cheapest run of ddmpi on this page whose error is no larger (by more than "
            "a fiftieth). The finest mesh that a peer has done, and the next one if it has failed there.", "",
            *table(["scene", "", "N", "unknowns", "processor (s)", "times, equal unknowns", "error",
                    "times, equal error"], lines)] if lines else []


def page(rows: list[Row], left_out: dict[str, str], remark: str) -> str:
    have, parts = versions(), []
    names = "; ".join(f"{PEERS[name].title} ({why})" for name, why in left_out.items())
    absent = [f"Left out: {names}.", ""] if names else []
    for scene, its in SCENES.items():
        sizes = [N for N in its.sizes if where(rows, scene=scene, N=N)]
        if sizes:
            parts += [f"## {its.title}", "", its.words, "", *fine_words(rows, scene),
                      *(line for N in sizes for line in scene_table(rows, scene, N))]
    return "\n".join([
        "# Peers", "", *([f"**{remark}**", ""] if remark else []),
        "Generated by `scripts/study peers`: the same nodes and elements by ddmpi, by other programs, and by hand. "
        "Seconds are of the whole process from start to end, runs in turns. ddmpi also makes the mesh of boxes, "
        "estimates the discretization error, certifies its answer and writes its results; the others read a mesh, and "
        "writing their input is not timed. [The plane, and FreeFEM](peers_in_plane.md) were compared earlier; that "
        "page also has what each program took to write.", "",
        "All run as one process on one thread, and processor seconds are compared, because other work shares the "
        "machine; the smallest of up to two repetitions. A run that has not ended after "
        f"{LIMIT:.0f} of these seconds is given up, and its peer is not asked for a finer mesh of the scene. Order 2 "
        "has the same nodes as order 1, or fewer.", "",
        "What limits the comparison:", "",
        "- The program by hand and GetFEM's nodal brick solve ddmpi's discrete problem of order 1: `difference to "
        "ddmpi` is that of force and displacement, each relative to its size. They take matching meshes only. The "
        "wall's upright joints are open because the program by hand has a node in one contact only. Neither says "
        "whether its answer is right.",
        "- CalculiX ends its iterations by its own tolerances, and its contact springs have a finite stiffness. Its "
        "pressures are those that it extrapolates to nodes. Debian's solves with SPOOLES.",
        "- At order 2 each has a contact of its own: ddmpi one force at each corner of the facets, GetFEM linear "
        "stresses, CalculiX springs at integration points. On coarse meshes of the boxes and of the stack GetFEM and "
        "CalculiX come closer to the fine answer.",
        "- Small runs of ddmpi are mostly the start of Python, MPI and PETSc, about half a second.", "",
        f"{processor()}, {os.cpu_count()} cores, PETSc {have['petsc']}, {have['mpi']}.", "",
        *short_table(rows), *absent, *parts])


def main() -> None:
    parser = arguments(__doc__, "peers")
    parser.add_argument("--scenes", nargs="+", choices=list(SCENES), default=list(SCENES), help="default: all")
    parser.add_argument("--sizes", nargs="+", type=int, metavar="N", help="default: each scene's own, and fine answers")
    parser.add_argument("--peers", nargs="+", choices=list(PEERS), default=list(PEERS), help="default: all")
    parser.add_argument("--repetitions", type=int, metavar="R", help="default: 1 to 3, by scene and size")
    parser.add_argument("--limit", type=float, default=LIMIT, metavar="S",
                        help="seconds of processors of a run (%(default)s)")
    parser.add_argument("--remark", default="", metavar="TEXT", help="a line under the title of the page")
    options = parser.parse_args()
    left_out = {name: why for name, peer in PEERS.items() if (why := peer.missing())}
    for name, why in left_out.items():
        print(f"{PEERS[name].title} is left out: {why}", file=sys.stderr)

    def work(scenes: Iterable[str], names: Collection[str]) -> list[tuple]:
        """What there is to run, the coarse meshes first."""
        found = []
        for scene in scenes:
            its = SCENES[scene]
            having = [name for name in names if name not in left_out and scene in PEERS[name].scenes]
            found += [(place, scene, N, name, k) for place, (N, times) in enumerate(its.sizes.items())
                      for k in range(options.repetitions or times) for name in having]
            found += [(1, scene, its.fine, name, 0) for name in having if name == "ddmpi-2"]
        return [rest for _, *rest in sorted(found, key=lambda each: each[0])]

    ledger = Ledger(MPI.COMM_WORLD, options.output / "peers.csv", KEY, MEASURED)
    with tempfile.TemporaryDirectory() as folder:
        wanted = [each for each in work(options.scenes, options.peers) if each[1] in (options.sizes or [each[1]])]
        rows = ledger.fill(wanted, Runs(ledger.rows, Path(folder), options.limit))
    text = page(rows, left_out, options.remark)
    complete = all(where(rows, scene=scene, N=N, peer=name) for scene, N, name, *_ in work(SCENES, PEERS))
    publish("peers.md", text, options.output, complete)
    print(text)


if __name__ == "__main__":
    main()
