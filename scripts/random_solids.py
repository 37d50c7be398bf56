#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Random assemblies of solids: every one certified and verified from its result files, or reported.

    scripts/study random_solids --seeds 0:300          # one to four ranks, by seed
    scripts/study random_solids --seeds 7 --ranks 3 --keep DIR

Each scene is solved by the command. What it writes is checked without anything of the program's that computed it
(tests/support/random_solids.py): the equilibrium of bodies as wholes and at their nodes, and all laws of all contacts.
A line for each seed, then a table. Ends with 1 if a verdict is among `WRONG`. Verdicts:

verified    certified, and all violations below --tolerance
reported    no equilibrium, and a linear program over the corners of the contacts agrees
edge        the linear program disagrees, unless contacts are smaller or larger by a part of a cell: meshes that do not
            match bear up to their nodes, not up to the edge of a contact
finding     no equilibrium found, though the linear program has forces: the iteration drifts, and with friction elastic
            bodies may not find these
violated    certified, and some law is not obeyed, or no forces can hold the bodies
missed      ended for another reason, or "no equilibrium" is said to be certain and is not
failed      ended with an error, or not within --limit seconds
"""

import argparse
import sys
import tempfile
import time
from collections import Counter
from pathlib import Path

from experiment import by_family, seeds  # with which the helpers of the tests can be imported

from scenes import run_command, write_scene  # isort: skip
from solid_assemblies import REACH, feasible, random_scene, violations  # isort: skip

WRONG = {"violated", "missed", "failed"}


def judge(seed: int, ranks: int, folder: Path, tolerance: float, limit: float) -> tuple[str, str]:
    """The verdict on the scene of a seed, and what to say about it; what the run writes is left in the folder."""
    scene = random_scene(seed)
    path = write_scene(scene, folder / "scene.toml")
    try:
        run = run_command(path, folder / "results", "--no-figures", ranks=ranks, limit=limit)
    except AssertionError as late:
        return "failed", str(late)
    if not (folder / "results" / "summary.json").exists():
        return "failed", run.output.strip()[-300:]
    reason = run.summary["reason"]
    if "no equilibrium" in reason and run.code == 3:
        if not feasible(scene):
            return "reported", reason
        return "finding" if "found" in reason else "missed" if feasible(scene, -REACH) else "edge", reason
    if run.code != 0 or not run.summary["converged"]:
        return "missed", f"exit code {run.code}: {reason}"
    found = violations(scene, folder / "results")
    law, worst = max(found.items(), key=lambda item: item[1])
    said = f"{run.summary['outer_iterations']:3d} steps, largest violation {worst:.1e} ({law})"
    if not feasible(scene, REACH):
        return "violated", f"{said}; no forces can hold the bodies"
    return "violated" if worst > tolerance else "verified" if feasible(scene) else "edge", said


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=seeds, default=seeds("0:300"), help="A:B, or seeds with commas")
    parser.add_argument("--ranks", type=int, help="left out, 1 to 4 by seed")
    parser.add_argument("--tolerance", type=float, default=1e-5, help="of violations, over the largest of their kind")
    parser.add_argument("--limit", type=float, default=600.0, help="seconds of a run")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="folder for scenes and results, one folder each")
    options = parser.parse_args()
    tally: Counter[tuple[str, str]] = Counter()
    for seed in options.seeds:
        ranks, start = options.ranks or 1 + seed % 7 % 4, time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            folder = options.keep / str(seed) if options.keep else Path(scratch)
            folder.mkdir(parents=True, exist_ok=True)
            verdict, words = judge(seed, ranks, folder, options.tolerance, options.limit)
        title = random_scene(seed)["title"]
        tally[title.split()[0], verdict] += 1
        spent = time.perf_counter() - start
        print(f"{seed:4d} {title:34s} {ranks} ranks {spent:5.1f} s  {verdict:9s} {words}", flush=True)
    print("", *by_family(tally), sep="\n")
    return int(any(verdict in WRONG for _, verdict in tally))


if __name__ == "__main__":
    sys.exit(main())
