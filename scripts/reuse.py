#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Prepared models: whether cases have the answers of runs by themselves, to the bit, and what they cost.

    scripts/study reuse                                              # 60 pairs on one rank, 100 frictions
    mpirun -n 3 .venv/bin/python scripts/reuse.py --cases 0          # pairs on three ranks, for the same page
    scripts/study reuse --pairs 0 --cases 20                         # times alone

A pair is two cases of random changes of a scene of the gallery or configs/, which one model solves one after the other;
the answer of the second is compared with that of a run by itself: summary, contacts and fields. Scenes of the gallery
have the settings with which its test runs them. Times are processor seconds; runs by themselves are made between the
cases of a model. Writes pairs_RANKS.csv and times_CASES.csv to --output, and reuse.md of all that are there; with the
default numbers also to docs/tables/. Started again, it goes on.
"""

import json
import os
import random
import sys
import time
import tomllib
from collections import Counter
from collections.abc import Callable
from pathlib import Path

import numpy as np
from experiment import ROOT, Ledger, Row, arguments, processor, publish, table, where
from gallery import EXHIBITS
from mpi4py import MPI
from reused import changes, content, differences

import ddmpi
from ddmpi.errors import DdmpiError
from ddmpi.scene.keys import override
from ddmpi.scene.reader import read_scene_file

PAIRS, CASES, EVERY = 60, 100, 10
"""Pairs on each number of ranks; cases of friction, and of these so many of which one runs by itself."""

SCENES = sorted(
    {exhibit.scene for exhibit in EXHIBITS}
    | {path.stem for path in (ROOT / "configs").glob("*.toml")}
)
COARSE = {f"body.{body}.mesh.divisions": [18, 6] for body in ("upper", "lower")}
SETTINGS = {exhibit.scene: exhibit.settings for exhibit in EXHIBITS} | {
    f"pinched_blocks_{law}": COARSE for law in ("coulomb", "frictionless", "tresca")
}
"""Settings by scene; the last ones are by the paper's method."""

ROUNDING = 1e-7
"""On several ranks a body MUMPS adds up in any order: forces then agree up to this part of the largest."""

PAIR = "scene", "pair"
FOUND = "ranks", "changes", "certified", "bytes", "difference", "alike", "unlike", "source"
SPENT = "cases", "fresh", "whole", "contacts", "same", "source"
KEY = "contact.upper-lower.friction.coefficient"
TIMED = {"pinched_blocks": 86, "two_boxes": 16}
SOURCE = f"version {ddmpi.__version__}, {processor()}, {os.cpu_count()} cores"


def scene_of(name: str) -> str:
    return str(ROOT / "configs" / f"{name}.toml")


def compare(name: str, number: int) -> Row:
    """One pair of cases of a scene. Collective."""
    world, path, settings = MPI.COMM_WORLD, scene_of(name), SETTINGS.get(name, {})
    rng = random.Random(f"{name} {number}")
    data = tomllib.loads(Path(path).read_text(encoding="utf-8"))
    for key, value in settings.items():
        override(data, key, value)
    first, second = changes(rng, data), changes(rng, data)
    second = first | second if rng.random() < 0.5 and not first.keys() & second.keys() else second
    answers, ends = [], []
    with ddmpi.prepare(path, world) as model:
        solves: tuple[Callable, ...] = (
            lambda: model.solve(settings | first),
            lambda: model.solve(settings | second),
            lambda: ddmpi.solve(path, world, settings | second),
        )
        for solve in solves:
            try:
                answers.append(solve())
                ends.append(content(answers[-1]))
            except DdmpiError as error:
                answers.append(None)
                ends.append(str(error))
    unlike = [place for own in world.allgather(differences(*ends[1:])) for place in own]
    difference = 0.0 if ends[1] == ends[2] else np.inf
    if answers[1] and answers[2]:
        kinds: tuple[Callable, ...] = (
            lambda answer: np.concatenate(
                [
                    [*contact.force, contact.normal_force.sum()]
                    for contact in answer.contacts.values()
                ]
                or [[0.0]]
            ),
            lambda answer: np.array([answer.summary["displacement_max"]]),
        )
        difference = max(
            float(
                np.abs(of(answers[1]) - of(answers[2])).max()
                / (np.abs(of(answers[2])).max() or 1.0)
            )
            for of in kinds
        )
    return {
        "ranks": world.size,
        "changes": json.dumps([first, second]),
        "certified": bool(answers[2] and answers[2].certified),
        "bytes": not unlike,
        "difference": difference,
        "unlike": json.dumps(unlike[:9]),
        "source": SOURCE,
        "alike": not unlike or (world.size > len(data["body"]) and difference < ROUNDING),
    }


def measure(scene: str, N: int, cases: int) -> Row:
    """Processor seconds of a case of a friction coefficient: of a run by itself, of a model, of contacts alone."""
    path = scene_of(scene)
    mesh = {
        f"body.{body}.mesh.divisions": [3 * N, N] if scene == "pinched_blocks" else [3 * N, N, N]
        for body in ("upper", "lower")
    }
    fresh, same = [], True
    ddmpi.solve(path, overrides=mesh | {KEY: 0.5}, only="contacts")  # loads modules
    spent: dict[str | None, list[float]] = {None: [], "contacts": []}
    for only, seconds in spent.items():
        with ddmpi.prepare(path) as model:
            for k, friction in enumerate(np.linspace(0.1, 1.0, cases).tolist()):
                start = time.process_time()
                answer = model.solve(mesh | {KEY: friction}, only=only)
                seconds.append(time.process_time() - start)
                if k % EVERY == EVERY // 2:
                    start = time.process_time()
                    other = ddmpi.solve(path, overrides=mesh | {KEY: friction})
                    fresh.append(time.process_time() - start)
                    same &= (
                        answer.contacts["upper-lower"].normal_force
                        == other.contacts["upper-lower"].normal_force
                    ).all()
    return {
        "cases": cases,
        "fresh": np.mean(fresh),
        "whole": np.mean(spent[None]),
        "contacts": np.mean(spent["contacts"]),
        "same": bool(same),
        "source": SOURCE,
    }


def write_page(pairs: list[Row], times: list[Row], folder: Path, complete: bool) -> None:
    counts = [
        (
            ranks,
            len(rows),
            *(
                sum(map(bool, kind))
                for kind in (
                    [row["certified"] for row in rows],
                    [row["bytes"] for row in rows],
                    [row["alike"] and not row["bytes"] for row in rows],
                    [not row["alike"] for row in rows],
                )
            ),
        )
        for ranks in sorted({row["ranks"] for row in pairs})
        for rows in [where(pairs, ranks=ranks)]
    ]
    sources = Counter(row["source"] for row in pairs + times).items()
    spent = [
        [
            f"{row['scene']}, N = {row['N']}",
            row["cases"],
            f"{row['fresh']:.3f}",
            *(
                format(value, form)
                for key in ("whole", "contacts")
                for value, form in ((row[key], ".3f"), (row[key] / row["fresh"], ".2f"))
            ),
            row["same"],
        ]
        for row in times
    ]
    publish(
        "reuse.md",
        {
            "Answers": table(
                (
                    "ranks",
                    "pairs",
                    "certified, not refused",
                    "the same to the bit",
                    "the same up to 1e-7, several ranks a body",
                    "unlike",
                ),
                counts,
            ),
            "Times": table(
                (
                    "scene",
                    "cases",
                    "run by itself",
                    "model, all fields",
                    "ratio",
                    "contacts alone",
                    "ratio",
                    "the same forces",
                ),
                spent,
            ),
        },
        folder,
        complete,
        {
            "Measured: .*": f"Measured: {'; '.join(f'{count} by {name}' for name, count in sources)}."
        },
    )


def main() -> None:
    parser = arguments(__doc__, "reuse")
    parser.add_argument("--pairs", type=int, default=PAIRS)
    parser.add_argument("--cases", type=int, default=CASES)
    options = parser.parse_args()
    world = MPI.COMM_WORLD
    # The paper's method takes a rank for each body.
    by_body = {name: read_scene_file(scene_of(name), []).method.by_body for name in SCENES}
    own = sorted(
        (name for name in SCENES if world.size == 2 or not by_body[name]),
        key=lambda name: "drawn" in name,
    )
    mine = Ledger(world, options.output / f"pairs_{world.size}.csv", PAIR, FOUND).fill(
        [(own[k % len(own)], k) for k in range(options.pairs)], compare
    )
    if world.rank:
        return
    pairs = [
        row
        for path in sorted(options.output.glob("pairs_*.csv"))
        for row in Ledger(MPI.COMM_SELF, path, PAIR, FOUND).rows
    ]
    times = Ledger(
        MPI.COMM_SELF, options.output / f"times_{options.cases}.csv", ("scene", "N"), SPENT
    ).fill(
        TIMED.items() if options.cases and world.size == 1 else [],
        lambda scene, N: measure(scene, N, options.cases),
    )
    write_page(
        pairs,
        times,
        options.output,
        len(pairs) >= 3 * PAIRS and len(times) == len(TIMED) and options.cases >= CASES,
    )
    wrong = [row for row in mine if not row["alike"]]
    sys.exit(f"{len(wrong)} pairs differ: {wrong}" if wrong else 0)


if __name__ == "__main__":
    main()
