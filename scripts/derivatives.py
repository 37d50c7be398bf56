#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Derivatives of answers against central differences and gradients, on random scenes of all kinds.

    scripts/study derivatives                      # the table docs/tables/derivatives.md, about ten minutes
    scripts/study derivatives --only steps         # the scenes of one kind, to the screen

Every scene is solved to a relative residual of 1e-12, unless that has no certified answer, and differentiated by some
of its keys. The table has for each kind the largest difference of any result from central differences, over the largest
derivative in the same unit, the same of gradients and derivatives, and how many products with compliances a derivative
takes, over those of the solve. One rank takes dense factors where it can; with more than 500 unknowns, as of the large
blocks, and on several ranks derivatives take GMRES.
Where nodes belong to several contacts, forces there are not unique: of these scenes, which stand in lines of their own,
only the reactions of clamps are compared.
"""

import sys
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np

from experiment import arguments, publish, table  # isort: skip, with which the helpers of the tests can be imported

import assembly_scenes
import differences
import scenes
import solid_assemblies
import solid_scenes

import ddmpi
from ddmpi.errors import DdmpiError, SolverError
from ddmpi.scene.keys import derivable

Scene = dict[str, Any]
KEYS = 4
"""Keys that a scene is differentiated by, but for those whose results cannot change."""

AIMS = 1e-5, 1e-9, 0.25
"""Of differences, of gradients, and of products of supported bodies."""


def blocks(rng: np.random.Generator) -> Scene:
    """Two supported blocks, matching or not, with any friction, a gap and unlike moduli."""
    N, law = int(rng.integers(8, 17)), str(rng.choice(["coulomb", "coulomb", "tresca"]))
    scene = scenes.pinched_blocks(N, law)
    if rng.random() < 0.5:
        scene["body"][1]["mesh"]["divisions"] = [3 * N - 2, N - 1]
    key = "coefficient" if law == "coulomb" else "slip_bound"
    value = float(rng.uniform(0.1, 0.6) if law == "coulomb" else rng.uniform(4e6, 3e7))
    profile = {"along": "x", "points": [0.0, 3.0], "values": [0.5 * value, value]}
    scene["contact"][0] |= {"friction": {"law": law, key: profile if rng.random() < 0.4 else value},
                            "gap": float(rng.choice([-1.0, 1.0]) * rng.uniform(5e-6, 2e-5))}
    scene["body"][0]["material"]["young"] *= float(10 ** rng.uniform(-0.7, 0.7))
    return scene


def large(rng: np.random.Generator) -> Scene:
    """Blocks of more unknowns than dense factors are for."""
    scene = scenes.pinched_blocks(int(rng.integers(86, 92)))
    scene["contact"][0]["friction"]["coefficient"] = float(rng.uniform(0.1, 0.6))
    return scene


def axis(rng: np.random.Generator) -> Scene:
    """A heated ring on a shaft."""
    scene = differences.ring(float(rng.uniform(5.0, 60.0)))
    scene["contact"][0]["friction"]["coefficient"] = float(rng.uniform(0.1, 0.5))
    return scene


def boxes(rng: np.random.Generator) -> Scene:
    """Two supported boxes."""
    N = int(rng.integers(2, 4))
    return solid_scenes.two_boxes(N, None if rng.random() < 0.5 else N + 1, law={
        "law": "coulomb", "coefficient": float(rng.uniform(0.1, 0.6))})


def steps(rng: np.random.Generator) -> Scene:
    """A pad that is pressed and rubbed in load steps."""
    scene = differences.rubbed(steps=int(rng.integers(1, 4)))
    scene["contact"][0]["friction"]["coefficient"] = float(rng.uniform(0.1, 0.8))
    scene["history"]["rub"]["factors"] = [0.0, 0.0, *rng.uniform(-1.0, 1.0, 2).tolist()]
    return scene


def loose(rng: np.random.Generator) -> Scene:
    """A block between rigid partners, of which one is pushed."""
    scene = differences.vice()
    for contact in scene["contact"]:
        contact["friction"] = {"law": "coulomb", "coefficient": float(rng.uniform(0.25, 0.6))}
    scene["body"][0]["traction"][0]["value"][1] *= float(rng.uniform(0.1, 1.0))
    return scene


def assemblies(rng: np.random.Generator) -> Scene:
    """`scripts/study random_assemblies`."""
    return assembly_scenes.random_scene(int(rng.integers(10_000)))


def solids(rng: np.random.Generator) -> Scene:
    """`scripts/study random_solids`."""
    return solid_assemblies.random_scene(int(rng.integers(10_000)))


KINDS: dict[str, tuple[Callable[[np.random.Generator], Scene], int]] = {
    "blocks": (blocks, 15), "axis": (axis, 6), "boxes": (boxes, 6), "steps": (steps, 9), "loose": (loose, 6),
    "assemblies": (assemblies, 12), "solids": (solids, 6), "large blocks": (large, 4)}
"""The kinds of scenes, and how many of each."""


def keys_of(scene: Scene, rng: np.random.Generator) -> list[str]:
    """Some keys, of those that are not zero."""
    data = differences.plain(scene)
    able = []
    for key in derivable(data):
        changed, value = differences.changed(data, key, 1e-3)
        if value and changed != data:
            able.append(key)
    return [str(key) for key in rng.choice(able, min(KEYS, len(able)), replace=False)]


def compare(scene: Scene, rng: np.random.Generator) -> tuple[float, float, float, bool, str] | None:
    """The largest differences from central differences and of a gradient, products of a derivative over those of the
    solve, whether nodes belong to several contacts, and what differs most; None without an answer."""
    scene = differences.plain(scene)
    keys = keys_of(scene, rng)
    plain = ddmpi.solve(scene, overrides=differences.TIGHT)
    if not plain.certified:
        return None
    answer = ddmpi.solve(differences.with_derivatives(scene, keys), overrides=differences.TIGHT)
    before, after = plain.summary["n_A"], answer.summary["n_A"]
    shared = bool(answer.solved.assembly.joint.shared().any())
    worst, what = 0.0, ""
    for key in keys:
        entry = answer.summary["derivatives"][key]
        if entry is None:
            worst, what = np.inf, f"{key}: null"
            continue
        found, name = differences.difference(scene, key, entry, only="reaction" * shared)
        worst, what = max((worst, what), (found, f"{key}: {name}"))
    off = 0.0
    if not scene.get("time"):
        result = f"contacts.{scene['contact'][0]['name']}.force.x"
        try:
            gradient = answer.gradient(result)
        except SolverError:  # which is right where forces are not unique
            gradient = {}
        for key in keys if gradient or not shared else ():
            if entry := answer.summary["derivatives"][key]:
                direct = entry["contacts"][scene["contact"][0]["name"]]["force"][0]
                # forces that do not change are rounding
                size = max(max(np.abs(contact["force"]).max(), 1e-3 * np.abs(forces["force"]).max()
                               / abs(differences.changed(scene, key, None)[1]))
                           for contact, forces in zip(entry["contacts"].values(), answer.summary["contacts"].values(),
                                                      strict=True))
                off = max(off, abs(gradient[key] - direct) / size)
    return worst, off, (after - before) / len(keys) / before, shared, what


def rows(only: str) -> Iterator[tuple[str, list[tuple[float, float, float]], int]]:
    """For each kind, apart with and without shared nodes, what `compare` says, and how many have no answer."""
    for number, (kind, (make, count)) in enumerate(KINDS.items()):
        found: dict[bool, list[tuple[float, float, float]]] = {False: [], True: []}
        missing = 0
        for seed in range(3 * count) if only in kind else ():
            if sum(map(len, found.values())) == count:
                break
            rng = np.random.default_rng([number, seed])
            try:
                said = compare(make(rng), rng)
            except DdmpiError as error:
                print(f"{kind} {seed}: {error}")
                said = None
            if said is None:
                missing += 1
                continue
            *numbers, shared, what = said
            found[shared].append(tuple(numbers))
            print(f"{kind:10s} {seed:2d}  differences {numbers[0]:.1e}  gradient {numbers[1]:.1e}  products "
                  f"{numbers[2]:.2f}  {what}{' (shared nodes)' * shared}", flush=True)
        for shared, values in found.items():
            if values:
                yield kind + ", nodes of several contacts" * shared, values, missing * (not shared)


def main() -> int:
    parser = arguments(__doc__, "derivatives")
    parser.add_argument("--only", default="", help="a word in the names of the kinds")
    options = parser.parse_args()
    lines, missed = [], False
    for kind, values, missing in rows(options.only):
        worst, off, products = np.array(values).T
        missed |= "several" not in kind and (max(worst) > AIMS[0] or max(off) > AIMS[1])
        lines.append((kind, f"{len(values)}", f"{missing}", f"{max(worst):.0e}", f"{np.median(worst):.0e}",
                      f"{max(off):.0e}" if max(off) else "–", f"{np.median(products):.2f}", f"{max(products):.2f}"))
    page = "\n".join([
        "# Derivatives against differences", "", "Generated by `scripts/study derivatives`, whose code describes the "
        "scenes. Differences are relative to the largest derivative in the same unit, products those of one "
        "derivative over those of the solve. Forces at nodes of several contacts are not unique, nor are their "
        "derivatives. Of these scenes only the reactions of clamps are compared; where their equations contradict each "
        "other an entry is null (inf).",
        "", *table(("scenes", "number", "without an answer", "largest difference", "median",
                    "gradient against derivatives", "products, median", "largest"), lines), ""])
    print(page)
    options.output.mkdir(parents=True, exist_ok=True)
    publish("derivatives.md", page, options.output, not options.only)
    return int(missed)


if __name__ == "__main__":
    sys.exit(main())
