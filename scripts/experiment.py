"""What the scripts beside this one share: the paper's scene and variants, a table that outlives
interruptions, a progress bar.

The paper: J. Haslinger, R. Kučera, T. Sassi, J. Riton, "A Domain Decomposition Algorithm for Contact
Problems with Coulomb's Friction", slides, International Symposium on Modern Mathematics and
Mechanics, Olomouc, June 23-27, 2014.
"""

from __future__ import annotations

import csv
import dataclasses
import functools
import gc
import sys
import time
from collections.abc import Iterable, Iterator
from pathlib import Path

import msgspec
from mpi4py import MPI

from ddmpi.coupling.assembly import Problem, prepare
from ddmpi.interface.law import friction_at
from ddmpi.scene.method import Method
from ddmpi.scene.reader import read_scene_file
from ddmpi.scene.scene import Scene

ROOT = Path(__file__).resolve().parents[1]
LAWS = ("tresca", "coulomb")
ALGORITHMS = ("original", "modified")
SPLITTINGS = ("none", "step1", "step2", "step1+2")
VARIANTS = [(algorithm, splitting) for algorithm in ALGORITHMS for splitting in SPLITTINGS]
SIZES = (6, 22, 38, 54, 70, 86)
"""N of the paper: bodies 3 x 1, cut into squares of side 1/N."""

INNER_PRECISION = 0.02
"""η of all runs unless they study it. At the program's default of 0.1, which is cheaper, rounding errors
decide in some variants in which iteration the update falls below the tolerance (inner_precision.py)."""


def pinched_blocks(law: str, N: int, *settings: str) -> Scene:
    """The scene of configs/ with squares of side 1/N, and other `settings` (KEY=VALUE)."""
    divisions = f"mesh.divisions=[{3 * N}, {N}]"
    return read_scene_file(ROOT / "configs" / f"pinched_blocks_{law}.toml",
                           [f"body.upper.{divisions}", f"body.lower.{divisions}", *settings])


def prepare_laws(world: MPI.Comm, N: int, laws: Iterable[str] = LAWS,
                 settings: Iterable[str] = ()) -> dict[str, Problem]:
    """The problems of several friction laws on one mesh, factored once. Collective."""
    scenes = {law: pinched_blocks(law, N, *settings) for law in laws}
    first = prepare(world, next(iter(scenes.values())))
    return {law: dataclasses.replace(first, scene=scene,
                                     friction=friction_at(scene.contact[0].friction, first.interface))
            for law, scene in scenes.items()}


def variant(scene: Scene, algorithm: str, splitting: str, **changes) -> Method:
    """The scene's method with another variant of the published iteration, and other `changes`."""
    return msgspec.structs.replace(scene.method, outer="relaxation", algorithm=algorithm, splitting=splitting,
                                   **{"inner_precision": INNER_PRECISION} | changes)


class Ledger:
    """Rows in a CSV file, each written as soon as it is known; a new start finds and keeps them.

    All ranks hold the same rows; rank 0 writes.

    Parameters
    ----------
    path : the file
    key : the columns that tell rows apart
    columns : all columns
    """

    def __init__(self, world: MPI.Comm, path: Path, key: tuple[str, ...], columns: tuple[str, ...]) -> None:
        self.world, self.path, self.key, self.columns = world, path, key, columns
        self.rows: list[dict] = []
        error = None
        if world.rank == 0:
            path.parent.mkdir(parents=True, exist_ok=True)
            if path.exists():
                with open(path, newline="", encoding="utf-8") as file:
                    header, *lines = list(csv.reader(file)) or [[]]
                if tuple(header) != columns:
                    error = f"{path} has other columns than this script writes; move it away"
                complete = [line for line in lines if len(line) == len(columns)]  # the last one may be torn
                self.rows = [dict(zip(columns, map(_value, line), strict=True)) for line in complete]
        error = world.bcast(error)
        if error:
            sys.exit(error if world.rank == 0 else 1)
        self.rows = world.bcast(self.rows)
        if world.rank == 0:
            with open(path, "w", newline="", encoding="utf-8") as file:
                writer = csv.DictWriter(file, columns)
                writer.writeheader()
                writer.writerows(self.rows)

    def find(self, *key) -> dict | None:
        """The row with this key, or None."""
        return next((row for row in self.rows if tuple(row[name] for name in self.key) == key), None)

    def add(self, row: dict) -> None:
        self.rows.append(row)
        if self.world.rank == 0:
            with open(self.path, "a", newline="", encoding="utf-8") as file:
                csv.DictWriter(file, self.columns).writerow(row)


def _value(text: str) -> int | float | bool | str:
    if text in ("True", "False"):
        return text == "True"
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


def progress(world: MPI.Comm, work: list, label: str = "") -> Iterator:
    """Iterate over `work`, with a bar on rank 0's stderr."""
    start = time.perf_counter()
    for done, item in enumerate([*work, None]):
        if world.rank == 0 and work:
            spent = time.perf_counter() - start
            left = f", {spent / done * (len(work) - done):.0f} s left" if 0 < done < len(work) else ""
            bar = "#" * (30 * done // len(work))
            what = " ".join(map(str, item)) if isinstance(item, tuple) else ""
            print(f"\r{label} [{bar:30}] {done}/{len(work)}  {spent:.0f} s{left}  {what:40.40}",
                  end="\n" if item is None else "", file=sys.stderr, flush=True)
        if item is not None:
            yield item


def on_two_ranks(main):
    """Decorator for a script's main(world): refuses other numbers of ranks, and lets PETSc's objects
    go before PETSc."""
    @functools.wraps(main)
    def guarded() -> None:
        world = MPI.COMM_WORLD
        if world.size != 2:
            sys.exit(f"start this as a command, {Path(sys.argv[0]).name}: it starts mpirun -n 2 itself")
        main(world)
        gc.collect()
    return guarded
