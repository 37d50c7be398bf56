#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Random assemblies, seed by seed: in the plane against a reference, solids checked from their result files.

`scripts/study random_assemblies --help` and `scripts/study random_solids --help` say more. Each prints a line for each
seed, then a table of families, and ends with 1 if a verdict is among `WRONG`.
"""

import functools
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from experiment import arguments, by_family, seeds, start  # isort: skip, with which the helpers of the tests can be imported

import assemblies
import assembly_scenes
import scenes
import solid_assemblies
from mpi4py import MPI

import ddmpi
from ddmpi.errors import DdmpiError

WRONG = {"differs", "missed", "unreported", "failed", "violated"}

STEPS, PRODUCTS = 40, 400
"""Seeds that take more of either are named."""

SOLUTION = 1e-5
"""Violation (`assemblies.violation`) up to which displacements count as a solution."""


def solve(scene: dict[str, Any], comm: Any) -> SimpleNamespace:
    """The package's answer with all bodies, on all ranks. Collective."""
    try:
        answer = ddmpi.solve(scenes.to_toml(scene), comm)
    except DdmpiError as error:
        return SimpleNamespace(error=f"{type(error).__name__}: {error}")
    bodies = {}
    for part in comm.allgather({name: (body.points, body.displacement) for name, body in answer.bodies.items()}):
        bodies |= {name: SimpleNamespace(points=points, displacement=u) for name, (points, u) in part.items()}
    return SimpleNamespace(error="", certified=answer.certified, reason=answer.reason, bodies=bodies,
                           steps=answer.summary.get("outer_iterations", 0), products=products(answer.summary))


def products(summary: dict[str, Any]) -> float:
    """Multiplications by a body's compliance in the iteration, over the number of bodies."""
    made = [body["n_A_by_purpose"].get("newton", 0) for body in summary["bodies"].values()]
    return sum(made) / len(made)


def reason_word(reference: assemblies.Solution) -> str:
    """What a reference without a solution knows."""
    return "none" if "no equilibrium" in reference.reason else "undecided"


def judge(reference: assemblies.Solution, answer: SimpleNamespace, tolerance: float) -> tuple[str, str]:
    """The verdict, and what to say about it."""
    if answer.error:
        reported = "no equilibrium" in answer.error
        if reported and not reference.converged:
            return "reported" if reason_word(reference) == "none" else "undecided", ""
        return "failed", answer.error
    if reason_word(reference) == "none":
        reported = not answer.certified and "no equilibrium" in answer.reason
        return ("reported" if reported else "unreported"), "" if reported else answer.reason
    if not answer.certified:
        return ("missed" if reference.converged else "undecided"), answer.reason
    if reference.converged:
        far = assemblies.distance(reference, answer)
        if far <= tolerance:
            return "agrees", f"{far:.1e}"
        excess = assemblies.violation(reference, answer)
        return ("another" if excess <= SOLUTION else "differs"), f"distance {far:.1e}, violation {excess:.1e}"
    excess = assemblies.violation(reference, answer)
    return ("found" if excess <= SOLUTION else "differs"), f"violation {excess:.1e}"


def random_assemblies() -> None:
    """Random assemblies: ddmpi against the brute-force reference of the tests, seed by seed.

        scripts/study random_assemblies --seeds 0:300                 # ddmpi on one rank
        mpirun -n 3 python scripts/random_assemblies.py random_assemblies --seeds 7  # on several
        scripts/study random_assemblies --no-reference --seeds 0:600  # only steps and products of ddmpi; two minutes

    A line for each seed, then a table of families, and what ddmpi took: products are multiplications by a body's
    compliance over the number of bodies. Verdicts:

    agrees        certified, displacement within --tolerance of the reference's
    another       certified, displacement elsewhere but a solution, too: friction need not leave one only
    differs       certified, and no solution
    missed        not certified, though the reference has a solution
    reported      no equilibrium by linear program, and ddmpi says so
    unreported    no equilibrium by linear program, but ddmpi certifies an answer or ends for another reason
    undecided     the reference finds neither a solution nor a proof that there is none, and ddmpi certifies none; by
                  the reference "drift": bodies slide at a steady imbalance, so that there is hardly an equilibrium
    found         the same, but ddmpi certifies an answer, which is a solution
    failed        ddmpi raised an error
    """
    parser = arguments(random_assemblies.__doc__)
    parser.add_argument("--seeds", type=seeds, default=seeds("0:300"), help="A:B, or seeds with commas")
    parser.add_argument("--tolerance", type=float, default=1e-6, help="of displacements, over the largest one")
    parser.add_argument("--no-reference", action="store_true")
    options = parser.parse_args()
    comm = MPI.COMM_WORLD
    first = comm.rank == 0
    tally: Counter[tuple[str, str]] = Counter()
    attempts: Counter[str] = Counter()
    taken: dict[int, tuple[int, float]] = {}
    if first:
        print("seed family         N law        dofs rows  reference        steps    s  verdict     ddmpi: steps    s")
    for seed in options.seeds:
        scene = assembly_scenes.random_scene(seed)
        start = time.perf_counter()
        reference = assemblies.solve(scene) if first and not options.no_reference else None
        between = time.perf_counter()
        answer = solve(scene, comm)
        end = time.perf_counter()
        if not first:
            continue
        if not answer.error:
            taken[seed] = answer.steps, answer.products
        if reference is None:
            print(f"{seed:4d} {scene['title']:42s} {taken.get(seed, (0, 0.0))[0]:3d} steps "
                  f"{taken.get(seed, (0, 0.0))[1]:6.0f} products  {answer.error or answer.reason}", flush=True)
            continue
        verdict, words = judge(reference, answer, options.tolerance)
        family, _, N, law = scene["title"].split(", ")
        how = reference.how or "no equilibrium"
        attempts[how] += 1
        tally[family, verdict] += 1
        dofs = sum(body.b.size for body in reference.assembly.bodies.values())
        print(f"{seed:4d} {family:13s} {N[4:]:>2s} {law:9s} {dofs:6d} {len(reference.assembly.gap):4d}  {how:15s} "
              f"{reference.steps:5d} {between - start:5.1f}  {verdict:10s} "
              f"{getattr(answer, 'steps', 0):13d} {end - between:4.1f}  {words}", flush=True)
    if not first:
        return
    if taken:
        steps, made = (sum(each[k] for each in taken.values()) for k in (0, 1))
        above = [f"{seed} ({k}, {p:.0f})" for seed, (k, p) in taken.items() if k > STEPS or p > PRODUCTS]
        print(f"\nddmpi: {steps} steps and {made:.0f} products a body; above {STEPS} or {PRODUCTS}: "
              f"{', '.join(above) or 'none'}")
    print("", *by_family(tally), sep="\n")
    print("\nreference by: " + ", ".join(f"{how} {count}" for how, count in attempts.most_common()))
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
    parser = arguments(random_solids.__doc__)
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
