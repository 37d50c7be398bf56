"""Many small bodies: processor seconds by phase, steps and products of stacks of loose blocks and of a wall of bricks.

    scripts/study many_bodies                                  # stacks of 300 and 1,000, a wall of 28 x 36 bricks
    scripts/study many_bodies --stacks 300 --walls             # one stack
    scripts/study many_bodies --stacks --walls 6x4 --profile wall.prof   # for python -m pstats wall.prof

A stack has a clamped block below and loose ones of eight triangles above it, pressed and pushed at the top. A wall has
bricks of eight triangles in running bond, the lowest course clamped, under their weight. Each scene runs once, on one
rank and in this process. Writes many_bodies.csv and many_bodies.md, and with the default sizes also to docs/tables/.
"""

import contextlib
import cProfile
import os
import tempfile
import time
from itertools import pairwise
from pathlib import Path
from types import SimpleNamespace
from unittest import mock

from experiment import Ledger, Row, arguments, processor, publish, table
from mpi4py import MPI
from scenes import run_here, tower, write_scene

import ddmpi
from ddmpi.system import clock

STACKS, WALLS = (300, 1000), ("28x36",)
PHASES = ("outer", "assemble", "factor", "recover", "estimate", "doubt", "output")
"""Those that have columns of their own; all others are in the total."""

FOUND = ("bodies", "contacts", *PHASES, "total", "steps", "products", "converged", "source")
SOURCE = f"version {ddmpi.__version__}, {processor()}, {os.cpu_count()} cores"
BRICK = 2.0, 1.0
"""Width and height (m)."""


def stack(blocks: int) -> dict:
    """So many loose blocks of eight triangles on a clamped one, each 3 × 1 m, pressed and pushed at the top."""
    scene = tower(blocks + 1, 1)
    for body in scene["body"]:
        body["mesh"]["divisions"] = [2, 2]
    # the line of thrust ends 0.75 m beside the middle of the lowest joint, which opens at one side
    scene["body"][-1]["traction"] = [{"on": "top", "value": [4.5e7 / blocks, -6e7]}]
    return scene | {"title": f"stack of {blocks} loose blocks"}


def wall(columns: int, courses: int) -> dict:
    """So many bricks in a course, two halves among them in every other one."""
    width, height = BRICK
    layers: list[list[tuple[float, float, str]]] = []
    for row in range(courses):
        inner = [width * (k + 0.5 * (row % 2)) for k in range(columns)]
        ends = sorted({0.0, *inner, width * columns})
        layers.append(
            [(left, right, f"brick{row}-{k}") for k, (left, right) in enumerate(pairwise(ends))]
        )
    bodies = [
        {
            "name": name,
            "clamp": [] if row else ["bottom"],
            "mesh": {
                "shape": "rectangle",
                "origin": [left, row * height],
                "size": [right - left, height],
                "divisions": [2, 2],
            },
            "material": {"young": 2e10, "poisson": 0.2},
            "volume_force": [0.0, -2e4],
        }
        for row, layer in enumerate(layers)
        for left, right, name in layer
    ]
    beds = [
        (upper, lower, ["bottom", "top"])
        for below, above in pairwise(layers)
        for left, right, upper in above
        for start, end, lower in below
        if min(right, end) > max(left, start)
    ]
    joints = [
        (one[2], other[2], ["right", "left"]) for layer in layers for one, other in pairwise(layer)
    ]
    return {
        "title": f"wall of {columns} x {courses} bricks",
        "body": bodies,
        "contact": [
            {"bodies": [one, other], "on": on, "friction": {"law": "coulomb", "coefficient": 0.5}}
            for one, other, on in beds + joints
        ],
    }


def measure(scene: dict, profile: str | None) -> Row:
    """One run of a scene, with processor seconds by phase; `profile` is a file for cProfile's statistics of it."""
    # the clock of a run has seconds of the wall, which other work on this machine lengthens
    processor_time = SimpleNamespace(perf_counter=time.process_time, process_time=time.process_time)
    profiler = cProfile.Profile() if profile else contextlib.nullcontext()
    with tempfile.TemporaryDirectory() as place, mock.patch.object(clock, "time", processor_time):
        path = write_scene(scene, Path(place) / "scene.toml")
        start = time.process_time()
        with profiler:
            run = run_here(path, Path(place) / "results", "--no-figures")
        total = time.process_time() - start
        if run.code:
            raise SystemExit(f"{scene['title']}: {run.stderr}")
        summary = run.summary
    if isinstance(profiler, cProfile.Profile):
        profiler.dump_stats(profile)
    return {
        "bodies": len(scene["body"]),
        "contacts": len(scene["contact"]),
        "total": round(total, 3),
        "steps": summary["outer_iterations"],
        "products": summary["n_A"],
        "converged": summary["converged"],
        "source": SOURCE,
        **{phase: round(summary["seconds"].get(phase, 0.0), 3) for phase in PHASES},
    }


def main() -> None:
    parser = arguments(__doc__, "many_bodies")
    parser.add_argument("--stacks", nargs="*", type=int, default=STACKS, help="loose blocks")
    parser.add_argument("--walls", nargs="*", default=WALLS, help="COLUMNSxCOURSES of bricks")
    parser.add_argument(
        "--profile", metavar="FILE", help="for cProfile's statistics of the last run"
    )
    options = parser.parse_args()
    keys = [("stack", str(blocks)) for blocks in options.stacks]
    keys += [("wall", size) for size in options.walls]

    def run(kind: str, size: str) -> Row:
        if kind == "stack":
            return measure(stack(int(size)), options.profile)
        columns, courses = size.split("x")
        return measure(wall(int(columns), int(courses)), options.profile)

    path = options.output / "many_bodies.csv"
    rows = Ledger(MPI.COMM_SELF, path, ("kind", "size"), FOUND).fill(keys, run)
    cells = [
        [
            f"{row['kind']} {row['size']}",
            row["bodies"],
            row["contacts"],
            *(f"{row[phase]:.2f}" for phase in (*PHASES, "total")),
            row["steps"],
            row["products"],
            row["converged"],
        ]
        for row in rows
    ]
    header = ("scene", "bodies", "contacts", *PHASES, "total", "steps", "products", "converged")
    complete = (tuple(options.stacks), tuple(options.walls)) == (STACKS, WALLS)
    facts = {"Measured: .*": f"Measured: {'; '.join({row['source']: 0 for row in rows})}."}
    lines = table(header, cells)
    publish("many_bodies.md", {"Processor seconds": lines}, options.output, complete, facts)
    print("\n".join(lines))


if __name__ == "__main__":
    main()
