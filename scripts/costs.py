#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""What `ddmpi check` says of the costs of a run, against the run.

    scripts/study costs                     # the gallery, and larger bodies
    scripts/study costs --only pinched_blocks --only boxes-20

Each scene is checked and run on one rank, each in a process of its own, by processor time, as other programs may be at
work. Writes costs.csv and costs.md to --output, and with all scenes also to docs/tables/. Started again, it goes on.
"""

import importlib
import json
import os
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, number, processor, publish, table
from gallery import EXHIBITS
from mpi4py import MPI

import ddmpi

OUTER = "method.compliance="
LARGE = {
    **{f"boxes-{N}": ("two_boxes", N, 3, "") for N in (12, 20)},
    "boxes-12, multigrid": ("two_boxes", 12, 3, f"{OUTER}iterative"),
    "boxes-20, multigrid": ("two_boxes", 20, 3, f"{OUTER}iterative"),
    "boxes-12, direct": ("two_boxes", 12, 3, f"{OUTER}direct"),
    "boxes-38": ("two_boxes", 38, 3, ""),
    **{f"blocks-{N}": ("pinched_blocks", N, 2, "") for N in (86, 160, 320)},
}
"""By name a scene with two bodies of 3N × N (× N) cells, N, the dimension, and another setting."""

GALLERY = [exhibit.scene for exhibit in EXHIBITS if not exhibit.refused]
COLUMNS = (
    "unknowns",
    *(f"{what}_{kind}" for what in ("memory", "seconds", "disk") for kind in ("told", "found")),
    *("outer_low", "outer_high", "outer_found", "source"),
)
SOURCE = f"version {ddmpi.__version__}, {processor()}"


def spent() -> float:
    """Processor seconds of this process and those that it has waited for."""
    return time.process_time() + sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])


def child(path: str, settings: list[str], folder: str, run: bool) -> None:
    """Print as JSON what a check tells of a scene, or what its run takes."""
    import petsc4py

    from ddmpi.mesh.build import kind_of_files
    from ddmpi.petsc.options import as_arguments
    from ddmpi.scene.reader import read_scene_file

    scene = read_scene_file(path, settings, kind_of_files(path))
    petsc4py.init([sys.argv[0], *as_arguments(scene.petsc)])
    from ddmpi.check.costs import forecast
    from ddmpi.run.run import compute, prepare_scene
    from ddmpi.system import clock
    from ddmpi.system.provenance import peak_memory

    clock.time = SimpleNamespace(perf_counter=spent, process_time=time.process_time)
    if run:
        start = spent()
        solved = compute(MPI.COMM_SELF, scene, path, clock.Clock(), folder, scene.output.figures)
        files = [each.stat().st_size for each in Path(folder).rglob("*")]
        seconds = json.loads((Path(folder) / "summary.json").read_text())["seconds"]
        print(
            json.dumps(
                {
                    "unknowns": solved.assembly.n,
                    "memory_found": peak_memory() * 2**20,
                    "seconds_found": start + sum(v for k, v in seconds.items() if k != "total"),
                    "disk_found": sum(files),
                    "outer_found": seconds["outer"],
                }
            )
        )
        return
    importlib.import_module("ddmpi.check.check")  # whose memory belongs to a check
    times = clock.Clock()
    assembly = prepare_scene(MPI.COMM_SELF, scene, path, times, factor=False)
    costs = forecast(assembly, times.seconds, scene.output.figures)
    low, high = costs.seconds["outer"][1:]
    told = {"memory_told": costs.memory[0], "seconds_told": costs.total[0], "disk_told": costs.disk}
    print(json.dumps(told | {"outer_low": low, "outer_high": high}))


def measure(name: str) -> Row:
    """The row of a scene."""
    scene, settings = name, list[str]()
    if name in LARGE:
        scene, N, d, more = LARGE[name]
        cells = [3 * N] + [N] * (d - 1)
        settings = [f"body.{k}.mesh.divisions={cells}" for k in (0, 1)] + [more] * bool(more)
    row: Row = {"source": SOURCE}
    for run in (False, True):
        with tempfile.TemporaryDirectory() as folder:
            arguments = [str(ROOT / f"configs/{scene}.toml"), json.dumps(settings), f"{folder}/run"]
            command = [sys.executable, __file__, "--child", *arguments, str(int(run))]
            done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            sys.exit(f"{name}: {done.stderr[-2000:]}")
        row |= json.loads(done.stdout.splitlines()[-1])
    return row


def lines(rows: list[Row]) -> list[str]:
    """The table of some scenes."""

    def pair(row: Row, what: str, scale: float, form: str) -> list[str]:
        told, found = row[f"{what}_told"], row[f"{what}_found"]
        return [number(told / scale, form), number(found / scale, form), f"{told / found:.2f}"]

    return table(
        [
            "scene",
            "unknowns",
            *("memory told (MiB)", "found", "ratio"),
            *("seconds told", "found", "ratio"),
            *("disk told (MB)", "found", "ratio"),
            *("outer told (s)", "found"),
        ],
        [
            [
                f"`{row['scene']}`",
                f"{row['unknowns']:,}",
                *pair(row, "memory", 2**20, ".0f"),
                *pair(row, "seconds", 1.0, ".3g"),
                *pair(row, "disk", 1e6, ".3g"),
                f"{row['outer_low']:.2g} to {row['outer_high']:.2g}",
                f"{row['outer_found']:.2g}",
            ]
            for row in rows
        ],
    )


def worst(rows: list[Row], what: str) -> float:
    """The largest factor between what is told and found."""
    ratios = np.array([row[f"{what}_told"] / row[f"{what}_found"] for row in rows])
    return float(np.maximum(ratios, 1.0 / ratios).max())


def main() -> None:
    if sys.argv[1:2] == ["--child"]:
        path, settings, folder, run = sys.argv[2:]
        child(path, json.loads(settings), folder, run == "1")
        return
    parser = arguments(__doc__, "costs")
    parser.add_argument("--only", action="append", metavar="NAME")
    options = parser.parse_args()
    names = options.only or [*GALLERY, *LARGE]
    rows = Ledger(MPI.COMM_SELF, options.output / "costs.csv", ("scene",), COLUMNS).fill(
        [(name,) for name in names], measure
    )
    shown = [row for row in rows if row["scene"] in GALLERY]
    large = [row for row in rows if row["scene"] in LARGE]
    sources = ", ".join(dict.fromkeys(row["source"] for row in rows))
    facts = {r"(?<=^Measured: ).*": f"{sources}."}
    for of, some in (("the gallery", shown), ("larger bodies", large)):
        if some:
            factors = ", ".join(
                f"{worst(some, what):.2f} of {what}" for what in ("memory", "seconds", "disk")
            )
            facts[rf"(?<=Of {of} the largest factors are ).*?(?=\.$)"] = factors
            print(f"{of}: largest factors of memory, seconds and disk: {factors}")
    publish(
        "costs.md",
        {"Gallery": lines(shown), "Larger bodies": lines(large)},
        options.output,
        len(rows) >= len(GALLERY) + len(LARGE),
        {f"(?m){pattern}": fact for pattern, fact in facts.items()},
    )


if __name__ == "__main__":
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    main()
