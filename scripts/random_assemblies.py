#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Random assemblies, solids, slits and images: each is certified and verified from its result files, or reported.

Each scene is solved by the command. What it writes is checked without anything of the program's that computed it
(result_check.py or image_check.py of tests/support/). Prints a line for each seed, a table of families, and what ddmpi
took: products are multiplications by a body's compliance over the number of bodies. Exit code 1 if one is violated,
missed or failed; docs/studies/assemblies.md explains these verdicts.
"""

import functools
import json
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from typing import Any

from experiment import arguments, table  # isort: skip, with which the helpers of the tests can be imported

import assembly_scenes
import image_check
import image_scenes
import result_check
import scenes
import solid_assemblies

WRONG = {"missed", "failed", "violated"}

STEPS, PRODUCTS = 40, 400
"""Seeds that take more of either are named."""


def products(summary: dict[str, Any]) -> float:
    """Multiplications by a body's compliance in the iteration, over the number of bodies."""
    made = [body["n_A_by_purpose"].get("newton", 0) for body in summary["bodies"].values()]
    return sum(made) / len(made)


def seeds(text: str) -> list[int]:
    """Seeds as A, A:B (B left out), or several of these with commas."""
    parts = [part.partition(":") for part in text.split(",")]
    return [
        seed for first, _, end in parts for seed in range(int(first), int(end or int(first) + 1))
    ]


def judge(
    scene: dict[str, Any],
    folder: Path,
    tolerance: float,
    command: Callable[..., scenes.Run],
    check: Any = result_check,
) -> tuple[str, str]:
    """The verdict on what the command makes of a scene, and what to say about it; what it writes is left in the folder.

    ``command(path, results, "--no-figures")`` runs the scene.
    """
    path = scenes.write_scene(scene, folder / "scene.toml")
    try:
        run = command(path, folder / "results", "--no-figures")
    except AssertionError as late:
        return "failed", str(late)
    if not (folder / "results" / "summary.json").exists():
        return "failed", run.output.strip()[-300:]
    reason = run.summary["reason"]
    if "no equilibrium" in reason and run.code == 3:
        if not check.feasible(scene):
            return "reported", reason
        certain = check.feasible(scene, -check.REACH)
        return "finding" if "found" in reason else "missed" if certain else "edge", reason
    if run.code != 0 or not run.summary["converged"]:
        return "missed", f"exit code {run.code}: {reason}"
    law, worst = max(check.violations(scene, folder / "results").items(), key=lambda item: item[1])
    said = f"largest violation {worst:.1e} ({law})"
    if not check.feasible(scene, check.REACH):
        return "violated", f"{said}; no forces can hold the bodies"
    return "violated" if worst > tolerance else "verified" if check.feasible(
        scene
    ) else "edge", said


def main() -> None:
    kinds: dict[str, tuple[Callable[[int, Path], dict], Any]] = {
        "random_assemblies": (lambda seed, _: assembly_scenes.random_scene(seed), result_check),
        "random_solids": (lambda seed, _: solid_assemblies.random_scene(seed), result_check),
        "random_images": (image_scenes.random_scene, image_check),
    }
    random_scene, check = kinds[sys.argv.pop(1)]
    parser = arguments(__doc__)
    parser.add_argument(
        "--seeds", type=seeds, default=seeds("0:300"), help="A:B, or seeds with commas"
    )
    parser.add_argument(
        "--bricks",
        action="store_true",
        help="mesh with quadrilaterals or hexahedra, those of order 1 with incompatible modes",
    )
    parser.add_argument("--ranks", type=int, help="left out, 1 to 4 by seed")
    parser.add_argument(
        "--tolerance",
        type=float,
        default=1e-5,
        help="of violations, over the largest of their kind",
    )
    parser.add_argument(
        "--keep", type=Path, metavar="DIR", help="folder for scenes and results, one folder each"
    )
    options = parser.parse_args()
    tally, taken = Counter[tuple[str, str]](), dict[int, tuple[int, float]]()
    for seed in options.seeds:
        ranks, start = options.ranks or 1 + seed % 7 % 4, time.perf_counter()
        with tempfile.TemporaryDirectory() as scratch:
            folder = options.keep / str(seed) if options.keep else Path(scratch)
            folder.mkdir(parents=True, exist_ok=True)
            scene = random_scene(seed, folder)
            for body in scene["body"] if options.bricks else ():
                if "divisions" in body["mesh"]:
                    body["mesh"] |= {"elements": "bricks"}
            command = functools.partial(scenes.run_command, ranks=ranks)
            verdict, words = judge(scene, folder, options.tolerance, command, check)
            if verdict != "failed":
                summary = json.loads(
                    (folder / "results" / "summary.json").read_text(encoding="utf-8")
                )
                taken[seed] = summary["outer_iterations"], products(summary)
        for family in (scene["title"].replace(",", " ").split()[0], "all"):
            tally[family, verdict] += 1
        print(
            f"{seed:4d} {scene['title']:42s} {ranks} ranks {time.perf_counter() - start:5.1f} s  "
            f"{taken.get(seed, (0, 0.0))[0]:3d} steps {taken.get(seed, (0, 0.0))[1]:6.0f} products  "
            f"{verdict:9s} {words}",
            flush=True,
        )
    steps, made = (sum(each[k] for each in taken.values()) for k in (0, 1))
    above = [
        f"{seed} ({k}, {p:.0f})" for seed, (k, p) in taken.items() if k > STEPS or p > PRODUCTS
    ]
    verdicts = sorted({verdict for _, verdict in tally})
    families = sorted({family for family, _ in tally}, key=lambda family: (family == "all", family))
    print(
        f"\n{steps} steps and {made:.0f} products a body; above {STEPS} or {PRODUCTS}: "
        f"{', '.join(above) or 'none'}",
        *table(
            ["family", *verdicts],
            ([family, *(tally[family, verdict] for verdict in verdicts)] for family in families),
        ),
        sep="\n",
    )
    sys.exit(any(verdict in WRONG for verdict in verdicts))


if __name__ == "__main__":
    main()
