#!/usr/bin/env bash
"exec" "bash" "-c" '. "${0%/*}/setup.sh"; exec "$PYTHON" "$0" "$@"' "$0" "$@"  # to Python, a string

__doc__ = """Memory and time of one body on several ranks, clamped on its left, on a rigid floor.

    scripts/body_ranks.py --divisions 408 --ranks 1 2 4

prints a table: the most memory that a rank has held, seconds by phase, and how far the answer is
from that of one rank. With 408 divisions of its height the body has a million unknowns.
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
from pathlib import Path

PHASES = ("assemble", "factor", "outer", "recover", "estimate", "output", "total")

SCENE = """
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


def run(scene: Path, ranks: int, folder: Path, limit: float) -> dict:
    """The summary of the scene on so many ranks."""
    launcher = os.environ.get("MPIRUN", "mpirun").split()
    command = [*launcher, "-n", str(ranks), sys.executable, "-m", "ddmpi", "run", str(scene), "--output", str(folder),
               "--quiet"]
    subprocess.run(command, check=True, timeout=limit)
    return json.loads((folder / "summary.json").read_text(encoding="utf-8"))


def distance(one: Path, other: Path) -> float:
    """Largest difference of displacements, over the largest displacement."""
    import h5py
    import numpy as np

    found = []
    for folder in (one, other):
        with h5py.File(folder / "result.h5") as file:
            fields: list = []
            file.visititems(lambda name, each, fields=fields: fields.append(each[()])
                            if name.endswith("displacement") else None)
            found.append(np.concatenate(fields))
    return float(np.abs(found[0] - found[1]).max() / np.abs(found[0]).max())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--divisions", type=int, default=60, help="of the block's height (1)")
    parser.add_argument("--ranks", type=int, nargs="+", default=[1, 2, 4])
    parser.add_argument("--compliance", default="explicit", help="explicit, direct or iterative")
    parser.add_argument("--loose", action="store_true", help="clamps leave one rigid motion free")
    parser.add_argument("--limit", type=float, default=900.0, help="seconds for a run")
    options = parser.parse_args()
    print("| ranks | memory of the largest (MiB) | of one rank's | " + " | ".join(PHASES) + " (s) | distance |")
    print("|" + "---|" * (len(PHASES) + 4))
    with tempfile.TemporaryDirectory() as name:
        here = Path(name)
        (here / "scene.toml").write_text(SCENE.format(divisions=options.divisions, along=3 * options.divisions,
                                                      kind=options.compliance, clamp=CLAMPS[options.loose]))
        first = 0.0
        for ranks in options.ranks:
            summary = run(here / "scene.toml", ranks, here / str(ranks), options.limit)
            memory = summary["bodies"]["block"]["memory_mib"]
            first = first or memory
            seconds = " | ".join(f"{summary['seconds'][phase]:.1f}" for phase in PHASES)
            print(f"| {ranks} | {memory:.0f} | {memory / first:.2f} | {seconds} | "
                  f"{distance(here / str(options.ranks[0]), here / str(ranks)):.1e} |", flush=True)


if __name__ == "__main__":
    main()
