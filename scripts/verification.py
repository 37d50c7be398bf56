#!/usr/bin/env -S bash -c 'exec "${0%/*}/study" "$0" "$@"'
"""Contacts verified: closed forms, published benchmarks and fine solutions, on three meshes and both orders.

Writes verification.md and its figures to the folder --output and, once all problems are solved, to docs/tables/. The
problems stand in problems/; tests run them on their coarsest meshes. Ends with exit code 1 if a value is farther from
the exact one than its problem allows. One rank; 10 minutes.
"""

import logging
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from dataclasses import replace
from fnmatch import fnmatchcase
from pathlib import Path

import numpy as np
import problems.around_axis
import problems.bricks
import problems.curved
import problems.flat
import problems.images
import problems.moving
import problems.solids
import problems.supports
from experiment import arguments, publish, save_figures, table
from problems import Found, Order, Problem, Value

from ddmpi.mesh.boundary import boundary_facets, segments
from ddmpi.results.fields import linear_parts

PROBLEMS = {
    name: each
    for module in (
        problems.flat,
        problems.curved,
        problems.supports,
        problems.images,
        problems.around_axis,
        problems.moving,
        problems.solids,
        problems.bricks,
    )
    for name, each in problems.PROBLEMS.items()
    if each.measure.__module__ == module.__name__
}
"""By name, in the order of the page."""

Runs = dict[tuple[str, int, Order], Found]
"""What was found, by problem, mesh and order."""


# The table of aims

BALLS = ("p₀*", "a (m)")
AIMS: list[tuple[str, int | None, Order | None, str, float]] = [
    *(
        (name, None, None, "*", 1e-8)
        for name in (
            "patch",
            "el-abbasi-bathe",
            "cgs-1",
            "cgs-1-turned",
            "cone-patch",
            "ring-on-cone",
            "sheared-solids",
            "cubes",
            "remote-moment",
            "bolted-joint",
            "brick-bolt",
        )
    ),
    *((name, None, None, "*", 1e-9) for name in ("sliding-block", "turned-pair")),
    ("skew-roller", None, None, "*", 1e-12),
    ("soft-joint", None, None, "*", 1e-9),
    ("crack", None, None, "displacement where it sticks*", 1e-9),
    ("crack", 40, 2, "K_II*", 0.01),
    *(("split-ring", None, None, value, 1e-9) for value in ("worst force*", "worst gap*")),
    ("split-ring", None, None, "normal force*", 1e-3),
    ("rotating-sector", None, None, "worst*", 1e-9),
    ("bolted-sector", None, None, "*", 1e-9),
    ("wave", None, 1, "worst force*", 1e-9),
    ("wave", 64, None, "largest pressure*", 0.01),
    *(("rolling-disc", None, None, value, 1e-9) for value in ("N/W", "T/W")),
    ("rolling-disc", 4, None, "turn*", 0.02),
    ("carter", 8, 2, "creep", 0.03),
    ("carter", 8, 2, "p₀", 0.005),
    ("turned-solid", 2, None, "moment*", 0.01),
    ("spur-gears", None, None, "stiffness*", 0.06),
    ("spur-gears", None, None, "loss*", 0.1),
    *(("hertz", 8, order, value, 0.01) for order in (1, 2) for value in ("p₀*", "a (mm)")),
    *(
        ("hertz", 16, 2, f"pressure, {words}", 0.01)
        for words in ("side means", "nodes", "nodes: greatest of five meshes")
    ),
    *(
        ("rings", 48, order, f"*side means*{words}*", aim)
        for order, aims in ((1, (3e-3, 3e-3)), ("2 straight", (5e-4, 5e-4)), (2, (5e-5, 1e-5)))
        for words, aim in zip(("gap measured", "gap given"), aims, strict=True)
    ),
    *((name, 8, 2, value, 0.015) for name in ("hertz-solid", "two-balls") for value in BALLS),
    ("cattaneo-mindlin", 8, None, "*stick radius*", 0.08),
    ("cattaneo-mindlin", 8, None, "*loop of energy*", 0.05),
    ("twisted-balls", 8, 2, "*torque*", 0.01),
    ("twisted-balls", 8, 2, "*stick radius*", 0.08),
    *((name, 10, 2, "*mean pressure*", 0.005) for name in ("tubes", "spheres")),
    *(
        (name, 8, 2, value, 0.01)
        for name in ("hertz-turned", "two-balls-turned")
        for value in BALLS
    ),
    *((name, None, 2, "*mean pressure*", 0.002) for name in ("tubes-turned", "spheres-turned")),
    *(
        (name, None, order, "error over that of simplices*", 1.0)
        for name in ("brick-rings", "brick-hertz", "brick-tubes")
        for order in (1, 2)
    ),
]
"""Problem, mesh, order (None: all of them), pattern of the names of values, and the largest error that is aimed at."""


def aims(runs: Runs) -> Iterator[list[str]]:
    """Rows: what is aimed at, the aim, what is seen, and whether it is met; none of what was not solved."""
    for name, mesh, order, pattern, aim in AIMS:
        errors = [
            abs(value.error)
            for (of, n, kind), found in runs.items()
            for key, value in found.values.items()
            if of == name
            and mesh in (None, n)
            and order in (None, kind)
            and fnmatchcase(key, pattern)
        ]
        if errors:
            words = [
                PROBLEMS[name].title,
                described(order) if order else "",
                f"{mesh} {PROBLEMS[name].unit}" if mesh else "",
                pattern.strip("*").replace("*", ", ") or "every value",
            ]
            yield [
                ", ".join(filter(None, words)),
                f"≤ {aim:g}",
                f"{max(errors):.1e}",
                "yes" if max(errors) <= aim else "**no**",
            ]


def described(order: Order) -> str:
    return {"2 straight": "order 2, straight sides"}.get(str(order), f"order {order}")


# The page


def cell(value: Value | None) -> str:
    if value is None:
        return "–"
    mark = "" if value.met else " **!**"
    if value.exact == 0.0:
        return f"{value.computed:.1e}{mark}"
    return f"{number(value.computed)} ({percent(value.error)}){mark}"


def number(value: float) -> str:
    return f"{value:.5g}" if 1e-3 <= abs(value) < 1e5 or value == 0.0 else f"{value:.4e}"


def percent(error: float) -> str:
    if abs(error) < 1e-6:
        return "exact"
    return f"{100 * error:+.2f} %" if abs(error) >= 1e-4 else f"{100 * error:+.1e} %"


def section(its: Problem, runs: Runs) -> list[str]:
    """The table of a problem."""
    columns = [
        (order, n) for order in its.orders for n in its.meshes if (its.name, n, order) in runs
    ]
    names = dict.fromkeys(name for order, n in columns for name in runs[its.name, n, order].values)
    rows = []
    for name in names:
        values = [runs[its.name, n, order].values.get(name) for order, n in columns]
        exact = next(value.exact for value in values if value)
        same = all(value is None or value.exact == exact for value in values)
        rows.append(
            [name.replace("|", "\\|"), number(exact) if same else "varies", *map(cell, values)]
        )
    return table(["", "exact", *(f"{described(order)}: {n}" for order, n in columns)], rows)


# Pictures


def picture(its: Problem, runs: Runs) -> Callable:
    """The bodies on the coarsest mesh with von Mises stress, and the contact on all meshes of the highest order."""

    def draw():
        import matplotlib.pyplot as plt

        order = its.orders[-1]
        n = next(n for n in its.meshes if (its.name, n, order) in runs)
        figure, (left, right) = plt.subplots(1, 2, figsize=(8.4, 3.2), width_ratios=(1.0, 1.25))
        answer = runs[its.name, n, order].answer
        assert answer is not None
        bodies = answer.bodies
        top = max(np.percentile(each.von_mises, 99.5) for each in bodies.values())
        if its.in_space:
            state = next(iter(answer.contacts.values()))
            shown = left.tripcolor(
                *state.interface.xy[:, :2].T,
                state.interface.lines.facets,
                state.pressure,
                vmin=min(state.pressure.min(), 0.0),
                cmap="viridis",
            )
            figure.colorbar(shown, ax=left)
        for each in () if its.in_space else bodies.values():
            corners, cell = linear_parts(each.cells, 2)
            # The body is drawn where it is.
            points = each.points if each.in_frame is None else each.points + each.displacement
            left.tripcolor(
                *points.T, corners, each.von_mises[cell], vmin=0.0, vmax=top, cmap="viridis"
            )
            if len(corners) < 3000:
                left.triplot(*points.T, corners, color="white", linewidth=0.3, alpha=0.6)
            around = points[segments(boundary_facets(each.cells, 2)[0])]
            left.plot(*around.transpose(2, 1, 0), color="black", linewidth=0.7)
        if its.view:
            left.set(xlim=its.view[:2], ylim=its.view[2:])
        left.set_aspect("equal")
        left.grid(False)
        left.set_title("pressure, seen along z" if its.in_space else "von Mises stress", fontsize=9)
        shown = [
            (each, runs[its.name, each, order].curve)
            for each in its.meshes
            if (its.name, each, order) in runs
        ]
        for (each, curve), colour in zip(shown, ("#c8501e", "#1b4f8f", "#4d9a4d"), strict=False):
            right.plot(
                curve.x,
                curve.computed,
                ".",
                color=colour,
                markersize=5 - 1.2 * its.meshes.index(each),
                label=f"{each}",
            )
        curve = shown[-1][1]
        if len(curve.exact):
            right.plot(
                curve.exact_x,
                curve.exact,
                color="black",
                linewidth=0.8,
                label=curve.known,
                zorder=0,
            )
            if np.ptp(curve.exact) < 1e-6 * abs(curve.exact).max():
                deviation = max(np.abs(c.computed - curve.exact[0]).max() for _, c in shown)
                half = max(1.5 * deviation, 1e-2 * abs(curve.exact[0]))
                right.set_ylim(curve.exact[0] - half, curve.exact[0] + half)
        right.set(xlabel=curve.xlabel, ylabel=curve.ylabel)
        right.legend(title=described(order), fontsize=8, title_fontsize=8)
        return figure

    return draw


def main() -> None:
    parser = arguments(__doc__, "verification")
    parser.add_argument(
        "--only",
        nargs="+",
        choices=PROBLEMS,
        default=list(PROBLEMS),
        metavar="NAME",
        help=f"of the problems {', '.join(PROBLEMS)}",
    )
    parser.add_argument(
        "--coarse",
        action="store_true",
        help="the coarsest meshes only; nothing goes to docs/tables/",
    )
    options = parser.parse_args()
    # Only errors are printed: what is small enough to warn of is meant here.
    logging.getLogger("ddmpi").setLevel(logging.ERROR)
    runs: Runs = {}
    wrong, start = [], time.perf_counter()
    for name in options.only:
        its, begun = PROBLEMS[name], time.perf_counter()
        for n in its.meshes[: 1 if options.coarse else None]:
            for order in its.orders:
                with tempfile.TemporaryDirectory() as folder:
                    found = its.measure(n, order, Path(folder))
                # Answers that are not drawn go: their factors are 15 GB in all.
                drawn = n == its.meshes[0] and order == its.orders[-1]
                runs[name, n, order] = found if drawn else replace(found, answer=None)
                wrong += [
                    f"{name}, n = {n}, {described(order)}: {key} is {value.computed:g}, exact {value.exact:g}"
                    for key, value in found.values.items()
                    if not value.met
                ]
        print(f"{name}: {time.perf_counter() - begun:.0f} s", file=sys.stderr, flush=True)
    complete = not options.coarse and set(options.only) == set(PROBLEMS)
    figures = {f"verification_{name}": picture(PROBLEMS[name], runs) for name in options.only}
    publish(
        "verification.md",
        {"Aims": table(["what", "aim", "seen", "met"], aims(runs))}
        | {PROBLEMS[name].title: section(PROBLEMS[name], runs) for name in options.only},
        options.output,
        complete,
        {r"took \d+ minutes": f"took {(time.perf_counter() - start) / 60:.0f} minutes"},
        lambda folder: save_figures(folder, figures, dpi=84),
    )
    print("\n".join(wrong), end="\n" if wrong else "")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
