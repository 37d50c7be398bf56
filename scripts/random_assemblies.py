#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Random assemblies, seed by seed: every one certified and verified by an independent check, or reported.

`scripts/study random_assemblies --help` and `scripts/study random_solids --help` say more. Each prints a line for each
seed, then a table of families, and ends with 1 if a verdict is among `WRONG`.
"""

import argparse
import functools
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from inspect import cleandoc
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from experiment import by_family, seeds, start  # isort: skip, with which the helpers of the tests can be imported

import assemblies
import assembly_scenes
import scenes
import solid_assemblies

WRONG = {"missed", "failed", "violated"}

STEPS, PRODUCTS = 40, 400
"""Seeds that take more of either are named."""


def products(summary: dict[str, Any]) -> float:
    """Multiplications by a body's compliance in the iteration, over the number of bodies."""
    made = [body["n_A_by_purpose"].get("newton", 0) for body in summary["bodies"].values()]
    return sum(made) / len(made)


def solve(scene: dict[str, Any], comm: Any) -> SimpleNamespace:
    """The package's answer with all bodies, on all ranks. Collective."""
    import ddmpi
    from ddmpi.errors import DdmpiError

    try:
        answer = ddmpi.solve(scenes.to_toml(scene), comm)
    except DdmpiError as error:
        return SimpleNamespace(certified=False, reason=f"{type(error).__name__}: {error}", steps=0, products=0.0)
    bodies = {}
    for part in comm.allgather({name: (body.points, body.displacement) for name, body in answer.bodies.items()}):
        bodies |= {name: SimpleNamespace(points=points, displacement=u) for name, (points, u) in part.items()}
    return SimpleNamespace(certified=answer.certified, reason=answer.reason, bodies=bodies,
                           steps=answer.summary.get("outer_iterations", 0), products=products(answer.summary))


def judge(scene: dict[str, Any], answer: SimpleNamespace, tolerance: float) -> tuple[str, str]:
    """The verdict on an answer to a plane scene, and what to say about it."""
    assembly = assemblies.Assembly(scene)
    certain = assemblies.imbalance(assembly) > assemblies.INFEASIBLE
    if not answer.certified:
        if "no equilibrium" not in answer.reason:
            return ("missed" if answer.steps else "failed"), answer.reason
        return "reported" if certain else "finding" if "found" in answer.reason else "missed", answer.reason
    worst = assemblies.violation(assembly, answer)
    return "violated" if certain or worst > tolerance else "verified", f"largest violation {worst:.1e}"


def described(study: Callable[[], None]) -> argparse.ArgumentParser:
    """A parser of arguments that says what the study is."""
    return argparse.ArgumentParser(description=cleandoc(study.__doc__ or ""),
                                   formatter_class=argparse.RawDescriptionHelpFormatter)


def random_assemblies() -> None:
    """Random assemblies in the plane: every one certified and verified from its displacements, or reported.

        scripts/study random_assemblies --seeds 0:300                 # on one rank
        mpirun -n 3 python scripts/random_assemblies.py random_assemblies --seeds 7  # on several
        scripts/study random_assemblies --write DIR --seeds 0:50      # only the scenes' TOML files

    What ddmpi answers is checked without anything of the program's (tests/support/assemblies.py). Products are
    multiplications by a body's compliance over the number of bodies. Verdicts:

    verified    certified, and displacements obey equilibrium, clamps and all laws of contacts within --tolerance
    reported    no equilibrium, and a linear program over the nodes of the contacts agrees
    finding     no equilibrium found, though the linear program has forces: the iteration drifts, and with friction
                elastic bodies may not find these
    violated    certified, and some law is not obeyed, or no forces can hold the bodies
    missed      ended for another reason, or "no equilibrium" is said to be certain and is not
    failed      ended with an error
    """
    from mpi4py import MPI

    parser = described(random_assemblies)
    parser.add_argument("--seeds", type=seeds, default=seeds("0:300"), help="A:B, or seeds with commas")
    parser.add_argument("--tolerance", type=float, default=1e-7, help="of violations, see tests/support/assemblies.py")
    parser.add_argument("--write", type=Path, help="folder for the scenes' TOML files; nothing is solved")
    arguments = parser.parse_args()
    comm, tally, taken = MPI.COMM_WORLD, Counter[tuple[str, str]](), {}
    for seed in arguments.seeds:
        scene, start = assembly_scenes.random_scene(seed), time.perf_counter()
        if arguments.write:
            arguments.write.mkdir(parents=True, exist_ok=True)
            scenes.write_scene(scene, arguments.write / f"random_{seed}.toml")
            continue
        answer = solve(scene, comm)
        if comm.rank == 0:
            verdict, words = judge(scene, answer, arguments.tolerance)
            tally[scene["title"].split(",")[0], verdict] += 1
            taken[seed] = answer.steps, answer.products
            print(f"{scene['title']:42s} {answer.steps:3d} steps {answer.products:6.0f} products "
                  f"{time.perf_counter() - start:5.1f} s  {verdict:9s} {words}", flush=True)
    if taken:
        steps, made = (sum(each[k] for each in taken.values()) for k in (0, 1))
        above = [f"{seed} ({k}, {p:.0f})" for seed, (k, p) in taken.items() if k > STEPS or p > PRODUCTS]
        print(f"\n{steps} steps and {made:.0f} products a body; above {STEPS} or {PRODUCTS}: "
              f"{', '.join(above) or 'none'}", *by_family(tally), sep="\n")
    sys.exit(any(verdict in WRONG for _, verdict in tally))


def judge_solids(seed: int, folder: Path, tolerance: float, command: Callable[..., scenes.Run]) -> tuple[str, str]:
    """The verdict on the scene of a seed, and what to say about it; what the run writes is left in the folder.

    ``command(path, results, "--no-figures")`` runs the scene.
    """
    scene = solid_assemblies.random_scene(seed)
    path = scenes.write_scene(scene, folder / "scene.toml")
    try:
        run = command(path, folder / "results", "--no-figures")
    except AssertionError as late:
        return "failed", str(late)
    if not (folder / "results" / "summary.json").exists():
        return "failed", run.output.strip()[-300:]
    reason = run.summary["reason"]
    if "no equilibrium" in reason and run.code == 3:
        if not solid_assemblies.feasible(scene):
            return "reported", reason
        certain = solid_assemblies.feasible(scene, -solid_assemblies.REACH)
        return "finding" if "found" in reason else "missed" if certain else "edge", reason
    if run.code != 0 or not run.summary["converged"]:
        return "missed", f"exit code {run.code}: {reason}"
    found = solid_assemblies.violations(scene, folder / "results")
    law, worst = max(found.items(), key=lambda item: item[1])
    said = f"{run.summary['outer_iterations']:3d} steps, largest violation {worst:.1e} ({law})"
    if not solid_assemblies.feasible(scene, solid_assemblies.REACH):
        return "violated", f"{said}; no forces can hold the bodies"
    return "violated" if worst > tolerance else "verified" if solid_assemblies.feasible(scene) else "edge", said


def random_solids() -> None:
    """Random assemblies of solids: every one certified and verified from its result files, or reported.

        scripts/study random_solids --seeds 0:300          # one to four ranks, by seed
        scripts/study random_solids --seeds 7 --ranks 3 --keep DIR

    Each scene is solved by the command. What it writes is checked without anything of the program's that computed it
    (tests/support/solid_assemblies.py): the equilibrium of bodies as wholes and at their nodes, and all laws of all
    contacts. Verdicts:

    verified    certified, and all violations below --tolerance
    reported    no equilibrium, and a linear program over the corners of the contacts agrees
    edge        the linear program disagrees, unless contacts are smaller or larger by a part of a cell: meshes that do
                not match bear up to their nodes, not up to the edge of a contact
    finding     no equilibrium found, though the linear program has forces: the iteration drifts, and with friction
                elastic bodies may not find these
    violated    certified, and some law is not obeyed, or no forces can hold the bodies
    missed      ended for another reason, or "no equilibrium" is said to be certain and is not
    failed      ended with an error, or not within --limit seconds
    """
    parser = described(random_solids)
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
            verdict, words = judge_solids(seed, folder, options.tolerance, functools.partial(
                scenes.run_command, ranks=ranks, limit=options.limit))
        title = solid_assemblies.random_scene(seed)["title"]
        tally[title.split()[0], verdict] += 1
        spent = time.perf_counter() - start
        print(f"{seed:4d} {title:34s} {ranks} ranks {spent:5.1f} s  {verdict:9s} {words}", flush=True)
    print("", *by_family(tally), sep="\n")
    sys.exit(any(verdict in WRONG for _, verdict in tally))


if __name__ == "__main__":
    start(random_assemblies, random_solids)
