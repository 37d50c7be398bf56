"""Are the errors true that are told of results?

All results of the scenes of error_scenes.py, on which the rule was made, and of the verification problems, which it had
not seen, are compared with those of a much finer quadratic mesh: how many bars cover the truth, how wide they are, and
which words were needless. Each problem is also judged by factors that fit the others alone. It writes
docs/tables/errors.md, and takes half an hour; an interrupted study goes on. What is known of each number is kept, and
judged anew by the present rule, so that a change of the rule takes no run.

    scripts/study errors --cost     # what errors take of a run, for the same page
"""

from __future__ import annotations

import json
import logging
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from time import process_time
from types import SimpleNamespace
from typing import Any
from unittest import mock

import numpy as np
import problems
import problems.around_axis
import problems.curved
import problems.flat
import problems.moving
import problems.solids
import problems.supports
from error_scenes import BRICKS, FRESH, PROBLEMS, REDUCED, Problem, of_bricks
from experiment import Ledger, Row, arguments, publish, save_figures, table
from mpi4py import MPI

import ddmpi
from ddmpi.derive.errors import measure_errors
from ddmpi.errors import DdmpiError
from ddmpi.judge.bars import FACTORS, Facts, Measured, bar_of, sums_of
from ddmpi.judge.edges import edges_of, unbounded
from ddmpi.methods.newton import Newton
from ddmpi.results.summary import facts_of, value_of
from ddmpi.run.answer import Answer
from ddmpi.scene.results import ERRORS, POINT, named, results
from ddmpi.system import clock

MADE, NEW, LAST, WHOLE = "rule", "new", "fresh", "bricks"
KNOWN = 2.0
"""A truth is known if it differs from the value by more than this times what the finest answer may be wrong by."""

NEGLIGIBLE = 1e-5
"""Errors over the largest number of the same quantity that are not compared, and below which a number is given by
statics."""

NEEDLESS = 0.1
"""A word is needless if the bar without it covers the truth and is below this part of the value."""

COSTS = (("boxes", 64, 1), ("boxes", 32, 2), ("solids", 10, 1), ("solids", 6, 2), ("hub", 4, 2))
"""Scenes whose errors are timed, with n and order, with explicit and with iterative compliances."""

TURNS = 5
"""Pairs of runs, of one number and of `main`, whose median is taken."""

FIT = 0.97
"""The part of the other problems' numbers that fitted factors cover."""

KINDS = {
    "moment": "moment",
    "pressure_max": "pressure",
    "von_mises_max": "stress",
    "displacement": "displacement",
    "displacement_max": "displacement",
    "energy": "energy",
    "dissipated": "energy",
}


def made(name: str) -> Iterator[tuple[str, Callable[[], Answer | None]]]:
    """The answers of a problem of error_scenes.py by their meshes; the truth is last."""
    yield from answers((PROBLEMS | FRESH)[name])


def answers(problem: Problem) -> Iterator[tuple[str, Callable[[], Answer | None]]]:
    """The answers of a problem by its meshes."""
    scene, meshes, _ = problem
    for mesh in meshes:
        yield (
            " ".join(map(str, mesh)),
            lambda mesh=mesh: ddmpi.solve(scene(*mesh), overrides={"method.tolerance": 1e-9}),
        )


def new(name: str) -> Iterator[tuple[str, Callable[[], Answer | None]]]:
    """The answers of a verification problem by their meshes; the truth is last."""
    its = problems.PROBLEMS[name]
    orders = [order for order in (1, 2) if order in its.orders]
    runs = [(n, order) for order in orders for n in its.meshes[:2]]
    fine = its.meshes[-1] * (1 if its.in_space else 2)

    def solve(n: int, order: int) -> Answer | None:
        with tempfile.TemporaryDirectory() as folder:
            return its.measure(n, order, Path(folder)).answer

    for n, order in [*dict.fromkeys(runs), (fine, 2)]:
        yield f"{n} {order} 0", lambda n=n, order=order: solve(n, order)


def whole(name: str) -> Iterator[tuple[str, Callable[[], Answer | None]]]:
    """The answers of a problem of bricks by their meshes; the truth, of triangles or tetrahedra, is last."""
    *_, truth = made(name.removesuffix(REDUCED))
    yield from [*answers(of_bricks(name))][:-1]
    yield truth


STUDIED = {
    MADE: (made, PROBLEMS),
    NEW: (new, problems.PROBLEMS),
    LAST: (made, FRESH),
    WHOLE: (whole, BRICKS),
}


def numbers_of(answer: Answer | None, only: Sequence[str]) -> list[dict]:
    """What is told of all results of an answer; none where it has no errors."""
    if answer is None or not answer.certified or answer.solved is None:
        return []
    assembly, solution = answer.solved.assembly, answer.solved.solution
    scene, summary = assembly.scene, answer.summary
    if scene.far or scene.output.only or not isinstance(solution.outer, Newton):
        return []
    points = {f"{POINT.format(body.name)}.{axis}" for body in scene.body for axis in "xyz"}
    wanted = [
        result
        for result in results(scene, ERRORS)
        if result not in points
        and (not only or named(result).name in only)
        and value_of(summary, result) is not None
    ]
    factors = scene.factors(1.0 if solution.time is None else solution.time)
    measured = measure_errors(assembly, solution.outer, solution, wanted, factors)
    infinite = unbounded(assembly.in_world(), edges_of(assembly.in_world(), solution.states))
    found = []
    for result, facts in facts_of(summary, measured, infinite).items():
        known = asdict(replace(measured[result], cells={}))
        scale = max(facts.scale, known["terms"])
        found.append({"result": result, "known": known, "facts": [*facts], "scale": scale})
    return found


def judged(row: Row) -> list[dict]:
    """The numbers of a row, each with its bar or word, and what these are made of."""
    numbers = json.loads(row["numbers"])
    for one in numbers:
        known, facts, name = Measured(**one["known"]), Facts(*one["facts"]), named(one["result"])
        bar, value = bar_of(name, known, facts), facts.value
        sums, least, ends = sums_of(name, known, value)
        unsure = max(abs(known.signed), known.stars / 3.0) + known.peak * abs(value) / 3.0
        one |= {"value": value, "order": facts.order, "bar": bar.bar, "word": bar.word}
        one |= {"sums": sums, "least": least, "ends": ends, "floor": bar.floor, "unsure": unsure}
    return numbers


def compared(rows: Sequence[Row], which: str) -> list[dict]:
    """All numbers of a set of problems beside their truths; of equal ones of a run the first."""
    found = []
    for name in STUDIED[which][1]:
        runs = [judged(row) for row in rows if row["problem"] == f"{which} {name}"]
        truths = {one["result"]: one for one in (runs[-1] if runs else ())}
        for numbers in runs[:-1]:
            seen = set()
            for one in numbers:
                if one["result"] not in truths:
                    continue
                truth = truths[one["result"]]
                what = named(one["result"]).what
                one |= {"problem": name, "kind": KINDS.get(what, "force")}
                one["scale"] = max(truth["scale"], one["scale"], np.finfo(float).tiny)
                one["true"] = truth["value"] - one["value"]
                same = (
                    one["kind"],
                    *(f"{abs(one[k]) / one['scale']:.6f}" for k in ("value", "true")),
                )
                if same in seen:
                    continue
                seen.add(same)
                size = abs(one["true"])
                one["known"] = size > max(KNOWN * truth["unsure"], NEGLIGIBLE * one["scale"])
                bare = np.nan_to_num(made_of(one, FACTORS), nan=np.inf)
                covers = bare + truth["unsure"] >= size and bare < NEEDLESS * abs(one["value"])
                one["needless"] = bool(one["word"]) and bool(covers)
                found.append(one)
    return found


def made_of(one: dict, factors: Mapping[int, float]) -> float:
    """The bar of a number by these factors, also where a word stands in its place."""
    return max(max(factors[one["order"]] * one["sums"], one["least"]) + one["ends"], one["floor"])


def ratio(one: dict, factors: Mapping[int, float] | None = None) -> float:
    """A bar over the true error, by these factors."""
    bar = made_of(one, factors) if factors else one["bar"]
    return bar / abs(one["true"])


def fitted(numbers: Iterable[dict]) -> dict[int, float]:
    """The least factors with which the bars of the numbers cover the part FIT, by order."""
    wanted: dict[int, list[float]] = {1: [], 2: []}
    for one in numbers:
        left = abs(one["true"]) - one["ends"]
        enough = left <= one["least"] or not one["sums"]
        wanted[one["order"]].append(0.0 if enough else left / one["sums"])
    return {order: float(np.quantile(each or [0.0], FIT)) for order, each in wanted.items()}


def told_of(numbers: Sequence[dict]) -> list[dict]:
    """The numbers with bars and a known truth."""
    return [one for one in numbers if one["known"] and one["bar"] is not None]


def line(title: object, numbers: Sequence[dict], ratios: Sequence[float] | None = None) -> list:
    """A line of a table."""
    shown = told_of(numbers)
    q = np.array([ratio(one) for one in shown] if ratios is None else ratios)
    words = sum(bool(one["word"]) for one in numbers)
    needless = sum(one["needless"] for one in numbers)
    share = [f"{100 * k / max(len(numbers), 1):.0f} %" for k in (words, needless)]
    if not len(q):
        return [title, len(numbers), *share, 0, "–", "–", "–"]
    middle, wide = np.quantile(q, [0.5, 0.9])
    covered = f"{100 * np.mean(q >= 1.0):.1f} %"
    return [title, len(numbers), *share, len(q), covered, f"{middle:.1f}", f"{wide:.0f}"]


HEAD = ["numbers", "with words", "needless", "known, with bars", "covered", "median", "90 %"]


def by_others(numbers: Sequence[dict]) -> tuple[list[float], list[dict[int, float]]]:
    """The ratios of each problem by the factors that fit the others, and these factors."""
    shown, ratios, factors = told_of(numbers), list[float](), list[dict[int, float]]()
    for name in dict.fromkeys(one["problem"] for one in shown):
        fit = fitted(one for one in shown if one["problem"] != name)
        factors.append(fit)
        ratios += [ratio(one, fit) for one in shown if one["problem"] == name]
    return ratios, factors


def pages(rows: Sequence[Row]) -> dict[str, list[str]]:
    """The tables of the page."""
    sets = {which: compared(rows, which) for which in STUDIED}
    titles = {
        MADE: "problems of the rule",
        NEW: "new problems",
        LAST: "fresh problems",
        WHOLE: "bricks",
    }
    ratios, factors = by_others(sets[MADE])
    overview = [line(titles[which], sets[which]) for which in STUDIED]
    overview.insert(1, line("the same, by factors of the others", sets[MADE], ratios))
    found = [
        [
            order,
            FACTORS[order],
            *(f"{end((fit[order] for fit in factors), default=np.nan):.2f}" for end in (min, max)),
        ]
        for order in (1, 2)
    ]
    kinds = [
        line(f"{kind}, order {order}, {titles[which]}", some)
        for kind in dict.fromkeys(["force", *KINDS.values()])
        for order in (1, 2)
        for which in STUDIED
        if (some := [one for one in sets[which] if one["kind"] == kind and one["order"] == order])
    ]
    single = [
        line(
            name + ", bricks" * (which == WHOLE), [one for one in numbers if one["problem"] == name]
        )
        for which, numbers in sets.items()
        for name in dict.fromkeys(one["problem"] for one in numbers)
    ]
    words = Counter(
        (one["word"], one["needless"]) for each in sets.values() for one in each if one["word"]
    )
    kinds_of_words = [
        [word, words[word, False] + words[word, True], words[word, True]]
        for word in dict.fromkeys(word for word, _ in words)
    ]
    return {
        "": table(["", *HEAD], overview),
        "Factors": table(["order", "factor", "least of the others", "largest"], found),
        "Kinds": table(["kind", *HEAD], kinds),
        "Words": table(["word", "numbers", "needless"], kinds_of_words),
        "Problems": table(["problem", *HEAD], single),
    }


def drawn(rows: Sequence[Row]) -> dict[str, Callable[[], Any]]:
    """The figure of the page: bars beside true errors, of the problems on which the rule was not made."""

    def draw() -> Any:
        import matplotlib.pyplot as plt

        figure, axes = plt.subplots(figsize=(6.4, 4.4))
        ends = np.array([1e-5, 1.0])
        axes.fill_between(ends, 1e-6, ends, color="0.93")
        axes.text(0.02, 1e-3, "not covered")
        axes.plot(ends, ends, color="0.4", linewidth=1)
        for order, colour, mark in ((1, "C1", "o"), (2, "C0", "^")):
            some = [
                one
                for which in (NEW, LAST)
                for one in told_of(compared(rows, which))
                if one["order"] == order
            ]
            error, bar = ([abs(one[key]) / one["scale"] for one in some] for key in ("true", "bar"))
            words = f"{['linear', 'quadratic'][order - 1]} elements, {len(some)} numbers"
            axes.scatter(
                error, bar, 12, color=colour, marker=mark, alpha=0.5, linewidths=0, label=words
            )
        axes.set(
            xscale="log",
            yscale="log",
            xlim=ends,
            ylim=(1e-6, 10.0),
            xlabel="true error over the largest number of its quantity",
            ylabel="error bar over the same number",
            title="Error bars of results against true errors",
        )
        for axis in (axes.xaxis, axes.yaxis):
            axis.set_major_formatter("{x:g}")
        axes.legend(loc="lower right")
        return figure

    return {"errors": draw}


def cost(name: str, n: int, order: int, compliance: str) -> Row:
    """The processor time of a run without errors, and what a first number and each further one take of it."""
    scene, shares = PROBLEMS[name].scene(n, order, 1), []
    contact = scene["contact"][0]["name"]
    for _ in range(TURNS):
        taken, rest = [], []
        for wanted in ([f"contacts.{contact}.normal_force"], "main"):
            more = {"output.errors": wanted, "method.compliance": compliance}
            # the clock of a run has seconds of the wall, which other work on this machine lengthens
            with mock.patch.object(
                clock, "time", SimpleNamespace(perf_counter=process_time, process_time=process_time)
            ):
                summary = ddmpi.solve(scene, overrides=more).summary
            seconds = {**summary["seconds"], "total": 0.0}
            taken.append(seconds.pop("errors"))
            rest.append(sum(seconds.values()))
        run, further = float(np.mean(rest)), len(summary["errors"]) - 1
        shares.append((run, taken[0] / run, (taken[1] - taken[0]) / further / run))
    run, first, each = np.median(shares, axis=0)
    told = {
        "run": f"{run:.2f} s",
        "first": f"{100 * first:.0f} %",
        "further": f"{100 * each:.0f} %",
    }
    return told | {"numbers": further}


def main() -> None:
    parser = arguments(__doc__, "errors")
    every = [f"{which} {name}" for which, (_, names) in STUDIED.items() for name in names]
    parser.add_argument(
        "--only",
        nargs="+",
        metavar="NAME",
        help="of the problems, such as boxes, or sets, such as bricks",
    )
    parser.add_argument("--missed", action="store_true", help="print the bars that do not cover")
    parser.add_argument("--cost", action="store_true", help="time the errors alone")
    options = parser.parse_args()
    logging.getLogger("ddmpi").setLevel(logging.ERROR)
    key, others = ("scene", "n", "order", "compliance"), ("run", "first", "further", "numbers")
    times = []
    if options.cost or not options.only:
        costs = Ledger(MPI.COMM_WORLD, options.output / "errors_cost.csv", key, others)
        keys = [(*each, kind) for each in COSTS for kind in ("explicit", "iterative")]
        times = table([*key, *others], (row.values() for row in costs.fill(keys, cost)))
    if options.cost:
        print("\n".join(times))
        return
    chosen = [one for one in every if not options.only or {*one.split()} & {*options.only}]
    ledger = Ledger(
        MPI.COMM_WORLD, options.output / "errors.csv", ("problem", "mesh"), ("numbers",)
    )
    runs = {}
    for one in chosen:
        which, name = one.split()
        runs |= {(one, mesh): solve for mesh, solve in STUDIED[which][0](name)}

    def measure(problem: str, mesh: str) -> Row:
        which, name = problem.split()
        only = PROBLEMS[name].only if which == MADE else ()
        before = [row["numbers"] for row in ledger.rows if row["problem"] == problem]
        if "[]" in before[:1]:  # far motions, and other methods, have none
            return {"numbers": "[]"}
        try:
            numbers = numbers_of(runs[problem, mesh](), only)
        except DdmpiError:
            numbers = []
        return {"numbers": json.dumps(numbers)}

    rows = [row for row in ledger.fill(runs, measure) if (row["problem"], row["mesh"]) in runs]
    for which in STUDIED if options.missed else ():
        for one in sorted(told_of(compared(rows, which)), key=ratio):
            if ratio(one) < 1.0:
                told = {key: one[key] for key in ("value", "true", "bar", "sums", "ends", "order")}
                print(f"{ratio(one):.2f} {which} {one['problem']} {one['result']} {told}")
    publish(
        "errors.md",
        pages(rows) | ({"Cost": times} if times else {}),
        options.output,
        complete=len(chosen) == len(every),
        draw=lambda folder: save_figures(folder, drawn(rows), dpi=120),
    )


if __name__ == "__main__":
    main()
