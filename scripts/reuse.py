"""Prepared models: whether cases have the files of runs by themselves, and what they cost.

    scripts/study reuse                              # 200 pairs of cases over the gallery and configs/, 100 frictions
    scripts/study reuse --pairs 40 --ranks 1 2       # fewer, on other numbers of ranks
    scripts/study reuse --pairs 0 --cases 20         # times alone

A pair is two cases of random changes of a scene that one model solves one after the other; the files of the second are
compared with those of a run by itself, byte for byte, summary.json without its times, memory and `reused`. Times are
processor seconds; fresh runs are made between the cases of a model, so that the ratio is that of one machine. Scenes of
the gallery have the settings with which its test runs them, which make them cheap. Writes
pairs.csv, times.csv and reuse.md, with the default numbers also to docs/tables/. Started again, it goes on.
"""

import argparse
import json
import os
import random
import shutil
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, processor, publish, table, where
from gallery import EXHIBITS
from mpi4py import MPI
from reused import CHANCE, changes, differences
from scenes import clean_environment

import ddmpi
from ddmpi.errors import DdmpiError
from ddmpi.mesh.build import kind_of_files
from ddmpi.petsc.options import RunOptions
from ddmpi.run.run import Cases, run
from ddmpi.scene.keys import override
from ddmpi.scene.reader import as_data, read_data, read_scene
from ddmpi.system.clock import Clock

PAIRS, RANKS, CASES, EVERY = 200, (1, 2, 3, 4), 100, 10
"""Pairs over all scenes and numbers of ranks; cases of friction, and of these so many of which one runs by itself."""

SCENES = sorted({exhibit.scene for exhibit in EXHIBITS} | {path.stem for path in (ROOT / "configs").glob("*.toml")})
COARSE = {f"body.{body}.mesh.divisions": [18, 6] for body in ("upper", "lower")}
SETTINGS = {exhibit.scene: exhibit.settings for exhibit in EXHIBITS} | {
    f"pinched_blocks_{law}": COARSE for law in ("coulomb", "frictionless", "tresca")}  # by the paper's method

ROUNDING = 1e-7
"""On several ranks a body MUMPS adds up in any order: forces then agree up to this part of the largest."""

TINY = np.finfo(float).tiny
KEY = "contact.upper-lower.friction.coefficient"
TIMED = {"pinched_blocks": 86, "two_boxes": 16}


def main() -> None:
    parser = arguments(__doc__, "reuse")
    parser.add_argument("--pairs", type=int, default=PAIRS)
    parser.add_argument("--ranks", type=int, nargs="+", default=RANKS)
    parser.add_argument("--scenes", nargs="+", default=SCENES)
    parser.add_argument("--cases", type=int, default=CASES)
    parser.add_argument("--worker", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.worker:
        compare_pairs(options)
        return
    options.output.mkdir(parents=True, exist_ok=True)
    for ranks in options.ranks if options.pairs else ():
        launcher = [*os.environ.get("MPIRUN", "mpirun").split(), "-n", str(ranks)] if ranks > 1 else []
        subprocess.run([*launcher, sys.executable, "-m", "mpi4py", __file__, "--worker", "--output", options.output,
                        "--pairs", str(options.pairs), "--ranks", *map(str, options.ranks), "--scenes",
                        *options.scenes], check=True, env=clean_environment())
    pairs = [row for ranks in options.ranks if options.pairs
             for row in Ledger(MPI.COMM_SELF, options.output / f"pairs_{ranks}.csv", PAIR, FOUND).rows]
    times = Ledger(MPI.COMM_SELF, options.output / f"times_{options.cases}.csv", ("scene", "N"), SPENT).fill(
        TIMED.items(), lambda scene, N: measure(scene, N, options.cases)) if options.cases else []
    complete = len(pairs) >= PAIRS and options.cases >= CASES
    publish("reuse.md", page(pairs, times), options.output, complete)
    wrong = [row for row in pairs if not row["alike"]]
    sys.exit(f"{len(wrong)} pairs differ: {wrong}" if wrong else 0)


# Files

PAIR = "scene", "pair"
FOUND = "ranks", "changes", "reused", "certified", "bytes", "difference", "alike", "unlike", "source"


def compare_pairs(options: argparse.Namespace) -> None:
    """Compare this number of ranks' share of the pairs, scene by scene. Collective on all ranks."""
    world, count = MPI.COMM_WORLD, len(options.scenes)
    ledger = Ledger(world, options.output / f"pairs_{world.size}.csv", PAIR, FOUND)
    by_body = {name: settled(ROOT / "configs" / f"{name}.toml", {}).method.by_body for name in options.scenes}
    pairs = [(options.scenes[number % count], number) for number in range(options.pairs)]
    ledger.fill(sorted(((name, number) for name, number in pairs if world.size == (  # the paper's: a rank for each body
        2 if by_body[name] else options.ranks[number // count % len(options.ranks)])),
        key=lambda pair: (by_body[pair[0]], "drawn" in pair[0])), compare)  # the cheap ones first


def original(name: str) -> dict[str, Any]:
    """A scene's data, with the settings of the gallery's test."""
    data = tomllib.loads((ROOT / "configs" / f"{name}.toml").read_text(encoding="utf-8"))
    for key, value in SETTINGS.get(name, {}).items():
        override(data, key, value)
    return data


def compare(name: str, number: int) -> Row:
    """One pair of cases of a scene. Collective."""
    world, path, rng = MPI.COMM_WORLD, ROOT / "configs" / f"{name}.toml", random.Random(f"{name} {number}")
    data = original(name)
    first, second = changes(rng, data), changes(rng, data)
    second = first | second if rng.random() < 0.5 and not first.keys() & second.keys() else second
    folder = Path(world.bcast(tempfile.mkdtemp() if world.rank == 0 else None))
    cases, options, ends = Cases(world), RunOptions(), []
    solves: dict[str, Callable[..., Any]] = {
        "before": lambda scene, place: cases.compute(scene, str(path), Clock(), output=place),
        "kept": lambda scene, place: cases.compute(scene, str(path), Clock(), output=place),
        "fresh": lambda scene, place: run(world, scene, str(path), place, False)}
    for way, solve in solves.items():
        try:
            scene = settled(path, SETTINGS.get(name, {}) | (first if way == "before" else second))
            options.use(scene.petsc)
            solve(scene, str(folder / way))
            ends.append("certified")
        except DdmpiError as error:
            ends.append(str(error))
    options.use({})
    cases.end()
    found: Row = {}
    if world.rank == 0:
        teams = world.size > len(data["body"])
        unlike, difference, reused = unlike_files(folder / "kept", folder / "fresh")
        ends[1:] = [end.replace(str(folder / way), "") for end, way in zip(ends[1:], ("kept", "fresh"), strict=True)]
        same = ends[1] == ends[2] and not unlike
        found = {"ranks": world.size, "changes": json.dumps([first, second]), "reused": reused,
                 "certified": ends[1] == "certified", "bytes": same, "difference": difference,
                 "alike": same or (teams and difference < ROUNDING),
                 "unlike": json.dumps([ends[1:], unlike[:9]] if not same else []), "source": source()}
        shutil.rmtree(folder)
    return world.bcast(found)


def settled(path: Path, overrides: dict[str, Any]) -> Any:
    """The scene with these values by key. Raises InputError."""
    data = read_data(str(path), path.read_text(encoding="utf-8"))
    for key, value in overrides.items():
        override(data, key, as_data(value, "overrides", key))
    return read_scene(str(path), data, file_kind=kind_of_files(path))


def unlike_files(one: Path, other: Path) -> tuple[list[str], float, str]:
    """Files that differ; the largest difference of contact forces over the largest force, or of largest displacements
    over the largest; what the first has reused."""
    names = sorted({path.name for folder in (one, other) if folder.exists() for path in folder.iterdir()})
    unlike, difference, reused = [], 0.0, ""
    for name in names:
        if not ((one / name).exists() and (other / name).exists()):
            return [f"{name} is not in both"], np.inf, reused
        contents = (one / name).read_bytes(), (other / name).read_bytes()
        if name == "summary.json":
            tables = [json.loads(content) for content in contents]
            reused = " ".join(f"{part}: {' '.join(stages)};" for part, stages in tables[0]["reused"].items())
            for summary in tables:
                for key in CHANCE:
                    summary.pop(key, None)
            unlike += differences(*tables)
            # pressures may cancel, as around a shaft
            forces = [np.array([[*contact["force"], contact["normal_force"]] for contact in table["contacts"].values()],
                               float) for table in tables]
            moved = [np.array([body["displacement_max"] for body in table["bodies"].values()]) for table in tables]
            difference = max(float(np.abs(a - b).max(initial=0.0)) / max(float(np.abs(b).max(initial=0.0)), TINY)
                             for a, b in (forces, moved))
        elif contents[0] != contents[1]:
            unlike.append(name)
    return unlike, difference, reused


# Times

SPENT = "cases", "fresh", "whole", "contacts", "same", "source"


def measure(scene: str, N: int, cases: int) -> Row:
    """Processor seconds of a case of a friction coefficient: of a run by itself, of a model, of contacts alone."""
    path = str(ROOT / "configs" / f"{scene}.toml")
    mesh = {f"body.{body}.mesh.divisions": [3 * N, N] if scene == "pinched_blocks" else [3 * N, N, N]
            for body in ("upper", "lower")}
    frictions, fresh, same = np.linspace(0.1, 1.0, cases).tolist(), [], True
    ddmpi.solve(path, overrides=mesh | {KEY: 0.5}, only="contacts")  # loads modules
    spent: dict[str | None, list[float]] = {None: [], "contacts": []}
    for only, seconds in spent.items():
        with ddmpi.prepare(path) as model:
            for k, friction in enumerate(frictions):
                start = time.process_time()
                answer = model.solve(mesh | {KEY: friction}, only=only)
                seconds.append(time.process_time() - start)
                if k % EVERY == EVERY // 2:
                    start = time.process_time()
                    other = ddmpi.solve(path, overrides=mesh | {KEY: friction})
                    fresh.append(time.process_time() - start)
                    same &= (answer.contacts["upper-lower"].normal_force
                             == other.contacts["upper-lower"].normal_force).all()
    return {"cases": cases, "fresh": np.mean(fresh), "whole": np.mean(spent[None]),
            "contacts": np.mean(spent["contacts"]), "same": bool(same), "source": source()}


# Page

def source() -> str:
    """The version of the code, and the machine, that a row of a table is from."""
    return f"version {ddmpi.__version__}, {processor()}, {os.cpu_count()} cores"


def sources(rows: list[Row]) -> str:
    """The versions and machines of rows, with the number of rows of each."""
    return "; ".join(f"{number} by {name}" for name, number in Counter(row["source"] for row in rows).items())


def page(pairs: list[Row], times: list[Row]) -> str:
    lines = ["# Prepared models: the same files, at what cost", "", "Written by `scripts/study reuse`.", ""]
    if pairs:
        ranks, worst = sorted({row["ranks"] for row in pairs}), max(row["difference"] for row in pairs)
        lines += [f"{len(pairs)} random pairs of cases of {len({row['scene'] for row in pairs})} scenes of the gallery "
                  "and configs/: files of the second, after the first in the same model, and of a run by itself. "
                  f"Where bytes differ, forces and displacements agree to {worst:.0e} of the largest. Pairs: "
                  f"{sources(pairs)}.",
                  "",
                  *table(("ranks", "pairs", "certified, not refused", "the same bytes",
                          "the same up to 1e-7, several ranks a body", "unlike"), (
                      (rank, len(rows), sum(row["certified"] for row in rows), sum(row["bytes"] for row in rows),
                       sum(row["alike"] and not row["bytes"] for row in rows), sum(not row["alike"] for row in rows))
                      for rank in ranks for rows in [where(pairs, ranks=rank)]))]
    if times:
        lines += ["Friction coefficients, processor seconds a case, on one rank; the first case of a model, which has "
                  "nothing to take yet, is in the mean. Only ratios count where other work shares the cores. "
                  f"Scenes: {sources(times)}.", "",
                  *table(("scene", "cases", "run by itself", "model, all fields", "ratio", "contacts alone", "ratio",
                          "the same forces"), (
                      (f"{row['scene']}, N = {row['N']}", row["cases"], f"{row['fresh']:.3f}", f"{row['whole']:.3f}",
                       f"{row['whole'] / row['fresh']:.2f}", f"{row['contacts']:.3f}",
                       f"{row['contacts'] / row['fresh']:.2f}", row["same"]) for row in times))]
    return "\n".join(lines).rstrip() + "\n"


if __name__ == "__main__":
    main()
