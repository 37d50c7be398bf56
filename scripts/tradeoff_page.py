"""The page and the figures of tradeoff.py, from its table only."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np

PAGE = "tradeoff_table.md"
TARGETS = (0.1, 0.05, 0.03, 0.02, 0.01, 0.005, 0.001)
"""Errors in the energy norm for which the cheapest way is looked up."""

LOOSEST = 1e-3
"""Tolerances above it are shown, but not recommended: 50 times them is all that the certificate asks for."""

TITLES = {"blocks": "Pinched blocks", "rings": "Rings"}
QUANTITIES = {"energy": "energy norm", "pressure": "contact pressure at nodes", "side_pressure": "its means over sides"}
COLOURS = {1: "#1b4f8f", 2: "#c8501e"}
METHODS = {"newton": "#1b4f8f", "anderson": "#3f8f4f", "relaxation": "#c8501e"}

Row = dict


def pick(rows: list[Row], cases: Iterable[tuple]) -> list[Row]:
    """The rows of the cases that have been run, in the order of the cases."""
    cases = list(cases)
    found = {tuple(row.values())[:len(cases[0])]: row for row in rows}
    return [found[case] for case in cases if case in found]


def trusted(row: Row) -> bool:
    """Whether a run's answer may be used."""
    return row["outcome"] == "certified" and row["tolerance"] <= LOOSEST


def front(rows: list[Row], quantity: str = "energy") -> list[Row]:
    """The trusted rows than which none is both faster and as accurate, within one per cent; the fastest first."""
    best, least = [], np.inf
    for row in sorted(filter(trusted, rows), key=lambda row: row["seconds"]):
        if row[quantity] < 0.99 * least:
            best.append(row)
            least = row[quantity]
    return best


# Words

def percent(value: float) -> str:
    if not np.isfinite(value):
        return "–"
    digits = 2 - int(np.floor(np.log10(100 * value))) - 1 if value > 0 else 0
    return f"{100 * value:.{min(max(digits, 0), 5)}f} %" if value > 1e-7 or value == 0 else f"{100 * value:.0e} %"


def small(value: float) -> str:
    return f"{value:.0e}" if np.isfinite(value) else "–"


def seconds(value: float) -> str:
    return f"{value:.3f}" if value < 1 else f"{value:.2f}"


def millimetres(value: float) -> str:
    return f"{1e3 * value:.1f}" if np.isfinite(value) else "–"


def choice(row: Row) -> str:
    """A case in words, without scene and mesh: what differs from the default."""
    words = [f"order {row['order']}", f"N = {row['N']}"]
    if row["method"] != "newton":
        words.append(row["method"])
    if row["method"] == "relaxation":
        words += [f"{row['algorithm']}, {row['splitting']}", f"θ = {row['theta']}", f"η = {row['inner_precision']}"]
    if row["tolerance"] != 1e-8:
        words.append(f"to {row['tolerance']:.0e}")
    if row["compliance"] != "explicit":
        words.append(row["compliance"])
    return ", ".join(words)


def table(header: list[str], lines: Iterable[list]) -> list[str]:
    return [f"| {' | '.join(header)} |", "|---" * len(header) + "|",
            *(f"| {' | '.join(map(str, line))} |" for line in lines), ""]


def failed(row: Row) -> str:
    """What to say of a run without certificate, else nothing."""
    return "" if row["outcome"] == "certified" else f" ({row['outcome'].split(';')[0]})"


# Tables

def mesh_tables(rows: list[Row]) -> list[str]:
    lines = ["## Mesh and order", "", "Default method, tolerance 1e-8. Side means: of the contact "
             "pressure over the elements' sides; pressure: at the nodes. Ends: of the contact zone and of the stick "
             "zones, in mm, of an interface of 3 m; a mesh has them halfway between two nodes.", ""]
    for scene in TITLES:
        for order in (1, 2):
            own = [row for row in rows if (row["scene"], row["order"]) == (scene, order)]
            header = ["N", "n", "s", "CPU s", "MiB", "k", "n_A", "energy norm", "pressure",
                      "side means", "normal force"]
            columns: list[Callable[[Row], object]] = [
                lambda r: r["N"], lambda r: r["n"], lambda r: seconds(r["seconds"]),
                lambda r: seconds(r["cpu_seconds"]), lambda r: f"{r['memory_mib']:.0f}", lambda r: r["iterations"],
                lambda r: r["n_A"], lambda r: percent(r["energy"]), lambda r: percent(r["pressure"]),
                lambda r: percent(r["side_pressure"]), lambda r: percent(r["normal_force"])]
            if scene == "blocks":
                header += ["tangential stress", "tangential force", "contact end", "stick ends"]
                columns += [lambda r: percent(r["shear"]), lambda r: percent(r["tangential_force"]),
                            lambda r: millimetres(r["contact_end"]), lambda r: millimetres(r["stick_end"])]
            lines += [f"{TITLES[scene]}, order {order}. Rates over the last three meshes: energy norm "
                      f"{rate(own, 'energy'):.2f}, pressure {rate(own, 'pressure'):.2f}, its side means "
                      f"{rate(own, 'side_pressure'):.2f}.", "",
                      *table(header, ([column(row) for column in columns] for row in own))]
    return lines


def rate(rows: list[Row], quantity: str) -> float:
    """Of convergence in N, fitted to the last three meshes; nan for fewer than two."""
    if len(rows) < 2:
        return np.nan
    N, error = np.array([(row["N"], row[quantity]) for row in rows[-3:]]).T
    return -float(np.polyfit(np.log(N), np.log(error), 1)[0])


def effectivity_table(rows: list[Row]) -> list[str]:
    kinds = [(scene, order) for scene in TITLES for order in (1, 2)]
    at = {(row["scene"], row["order"], row["N"]): row for row in rows}

    def cell(row: Row | None) -> str:
        if row is None:
            return ""
        return f"{percent(row['estimated'])} / {percent(row['energy'])} = {row['estimated'] / row['energy']:.2f}"

    return ["## Effectivity of the error estimate", "", "Estimated over true error in the energy norm, both relative.",
            "", *table(["N", *(f"{TITLES[scene].lower()}, order {order}" for scene, order in kinds)],
                       ([N, *(cell(at.get((*kind, N))) for kind in kinds)]
                        for N in sorted({row["N"] for row in rows})))]


def tolerance_tables(rows: list[Row]) -> list[str]:
    lines = ["## Tolerance", "", "k · n_A · seconds of the outer iteration; algebraic error, which is the "
             "distance, relative in the energy norm, from the exact solution on the same mesh; true error. A run goes "
             "on until its certificate holds as well.", ""]
    for scene, order in dict.fromkeys((row["scene"], row["order"]) for row in rows):
        own = [row for row in rows if (row["scene"], row["order"]) == (scene, order)]
        methods = list(dict.fromkeys(row["method"] for row in own))
        at = {(row["method"], row["tolerance"]): row for row in own}

        def cell(row: Row | None) -> str:
            if row is None:
                return "not run"
            return (f"{row['iterations']} · {row['n_A']} · {seconds(row['outer_seconds'])}; {small(row['algebraic'])}; "
                    f"{percent(row['energy'])}{failed(row)}")

        lines += [f"{TITLES[scene]}, order {order}, N = {own[0]['N']}:", "",
                  *table(["tolerance", *methods], ([f"{tolerance:.0e}", *(cell(at.get((method, tolerance)))
                                                                         for method in methods)]
                                                   for tolerance in sorted({row["tolerance"] for row in own})[::-1]))]
    return lines


def plain_table(title: str, text: str, names: list[str], words: Callable[[Row], list], rows: list[Row]) -> list[str]:
    """A table of cases with what they cost and gave."""
    header = [*names, "k", "n_A", "s", "outer iteration, s", "MiB", "algebraic error", "energy norm"]
    lines = ([*words(row), f"{row['iterations']}{failed(row)}", row["n_A"], seconds(row["seconds"]),
              seconds(row["outer_seconds"]), f"{row['memory_mib']:.0f}", small(row["algebraic"]),
              percent(row["energy"])] for row in rows)
    return [f"## {title}", "", text, "", *table(header, lines)]


def cheapest_tables(rows: list[Row]) -> list[str]:
    lines = ["## The cheapest way to an error", "", "Of all certified runs above to 1e-3 or tighter, the fastest whose "
             "true error in the energy norm is at most so large.", ""]
    for scene in TITLES:
        own = [row for row in rows if row["scene"] == scene and trusted(row)]
        body = []
        for target in TARGETS:
            good = [[row for row in own if row["order"] == order and row["energy"] <= target] for order in (1, 2)]
            if any(good):
                body.append([percent(target), *(_cheapest(found) for found in good)])
        lines += [f"{TITLES[scene]}:", "", *table(["error", "order 1", "order 2"], body)]
    lines += ["Fronts: runs than which none is both faster and as accurate, within one per cent.", ""]
    for scene in TITLES:
        for quantity, name in QUANTITIES.items():
            best = front([row for row in rows if row["scene"] == scene], quantity)
            lines += [f"- {TITLES[scene]}, {name}: " + "; ".join(
                f"{choice(row)} ({seconds(row['seconds'])} s, {percent(row[quantity])})" for row in best) + "."]
    return [*lines, ""]


def _cheapest(rows: list[Row]) -> str:
    if not rows:
        return "none"
    best = min(rows, key=lambda row: row["seconds"])
    return (f"{choice(best)}: {seconds(best['seconds'])} s, {percent(best['energy'])}, n_A {best['n_A']}, "
            f"{best['memory_mib']:.0f} MiB")


def statement(own: dict[str, list[Row]]) -> list[str]:
    """What was measured, in words with computed numbers."""
    lines = []
    mesh = {(row["scene"], row["order"], row["N"]): row for row in own["mesh"]}
    for scene, N in (("blocks", 22), ("rings", 16)):
        one, two = mesh.get((scene, 1, 2 * N)), mesh.get((scene, 2, N))
        if one and two:
            lines.append(
                f"- {TITLES[scene]}, {one['n']} unknowns: order 2 takes {seconds(two['seconds'])} s, order 1 on meshes "
                f"twice as fine {seconds(one['seconds'])} s; errors {percent(two['energy'])} against "
                f"{percent(one['energy'])} in the energy norm, {percent(two['pressure'])} against "
                f"{percent(one['pressure'])} in the pressure at the nodes, {percent(two['side_pressure'])} against "
                f"{percent(one['side_pressure'])} in its side means.")
    for method in METHODS:
        found = sorted((row for row in own["tolerance"] if (row["scene"], row["order"], row["method"])
                        == ("blocks", 1, method)), key=lambda row: -row["tolerance"])
        above = [k for k, row in enumerate(found) if row["algebraic"] > 0.1 * row["energy"]]
        loose = next(iter(found[above[-1] + 1 if above else 0:]), None)
        tight = next((row for row in found if row["tolerance"] == 1e-8), None)
        if loose and tight:
            lines.append(
                f"- Tolerance, {method}: from {small(loose['tolerance'])} on the algebraic error is below a tenth of "
                f"the true one (pinched blocks, order 1, N = {loose['N']}). 1e-8 takes {tight['iterations']} outer "
                f"iterations instead of {loose['iterations']}, {tight['n_A']} multiplications instead of "
                f"{loose['n_A']}, {seconds(tight['outer_seconds'])} s instead of {seconds(loose['outer_seconds'])} s.")
    for name, axis, key, base in (("Compliance", "compliance", "compliance", "explicit"),
                                  ("Outer method", "method", "method", "newton")):
        bases = {(row["order"], row["N"]): row for row in own[axis] if row[key] == base}
        for other in dict.fromkeys(row[key] for row in own[axis] if row[key] != base):
            pairs = [(row, bases[row["order"], row["N"]]) for row in own[axis] if row[key] == other
                     and (row["order"], row["N"]) in bases]
            lines.append(f"- {name} {other} against {base}: " + ", ".join(
                f"{words} × {spread([row[column] / least[column] for row, least in pairs])}" for words, column in
                (("outer iteration", "outer_seconds"), ("memory", "memory_mib"), ("multiplications", "n_A"))) + ".")
    for scene in TITLES:
        found = {order: [row["estimated"] / row["energy"] for row in own["mesh"]
                         if (row["scene"], row["order"]) == (scene, order)] for order in (1, 2)}
        parts = ", ".join(f"order {order} {spread(values)}" for order, values in found.items())
        lines.append(f"- Effectivity of the error estimate, {TITLES[scene].lower()}: {parts}.")
    return [*lines, ""]


def spread(values: list[float]) -> str:
    if not values:
        return "–"
    low, high = (f"{value:.2f}" if value < 9.95 else f"{value:.0f}" for value in (min(values), max(values)))
    return low if low == high else f"{low}–{high}"


def preset_table(rows: list[Row]) -> list[str]:
    names = ("fast", "balanced", "accurate")
    body = [[TITLES[row["scene"]].lower(), names[k % 3], choice(row), row["n"], row["n_A"], seconds(row["seconds"]),
             f"{row['memory_mib']:.0f}", percent(row["estimated"]), *(percent(row[key]) for key in (
                 "energy", "pressure", "side_pressure", "normal_force"))] for k, row in enumerate(rows)]
    return ["## Presets", "", "What the presets make of meshes of N = 22 (blocks) and N = 16 (rings); accurate: the "
            "mesh that brings the estimate below 1 %, without the coarser meshes on the way there.", "",
            *table(["scene", "preset", "settings", "n", "n_A", "s", "MiB", "estimated error", "energy norm", "pressure",
                    "side means", "normal force"], body)]


def page(rows: list[Row], axes: dict[str, list[tuple]]) -> str:
    """All tables, as Markdown."""
    own = {axis: pick(rows, cases) for axis, cases in axes.items()}
    most = max((row["runs"] for row in rows if np.isfinite(row["runs"])), default=0)
    lines = ["# Accuracy and its cost", "",
             "Generated by `scripts/tradeoff.py`; what it means is in [tradeoff.md](tradeoff.md). Squares (blocks) of "
             "side 1/N, rings of N × 3N cells. Seconds: mesh, assembly, factorization, outer iteration, displacements "
             f"and error estimate on two ranks, the slower one; the least of up to {most} runs. CPU s: of both ranks, "
             "waiting for the other one included. MiB: peak memory of both ranks above what they hold before. k outer "
             "iterations, n_A multiplications by A⁻¹ of both bodies.", "",
             "![time against error](figures/tradeoff_front.png)", "", "## In short", "", *statement(own),
             *preset_table(own["preset"]),
             *mesh_tables(own["mesh"]), *effectivity_table(own["mesh"]), *tolerance_tables(own["tolerance"]),
             "![errors against the tolerance](figures/tradeoff_tolerance.png)", ""]
    published = "Published iteration"
    for title, text, names, words, axis in (
            ("Inner precision", f"{published}, original algorithm without splitting, θ = 0.2.", ["tolerance", "η"],
             lambda r: [f"{r['tolerance']:.0e}", r["inner_precision"]], "inner precision"),
            ("Compliance", "Newton, tolerance 1e-8.", ["order", "N", "compliance"],
             lambda r: [r["order"], r["N"], r["compliance"]], "compliance"),
            ("Outer method", "Tolerance 1e-6.", ["order", "N", "method"],
             lambda r: [r["order"], r["N"], r["method"]], "method"),
            ("Algorithm and splitting", f"{published}, tolerance 1e-4, η = 0.1.", ["algorithm", "splitting", "θ"],
             lambda r: [r["algorithm"], r["splitting"], r["theta"]], "variant")):
        lines += plain_table(title, text, names, words, own[axis])
    return "\n".join([*lines, *cheapest_tables(rows)])


# Figures

def draw(rows: list[Row], folder: Path) -> None:
    """tradeoff_front.png, time against errors, and tradeoff_tolerance.png, errors against the tolerance."""
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    from ddmpi.results.pictures import STYLE

    folder.mkdir(parents=True, exist_ok=True)
    with plt.rc_context(STYLE):
        for name, figure in (("front", draw_front(rows)), ("tolerance", draw_tolerance(rows))):
            figure.savefig(folder / f"tradeoff_{name}.png", bbox_inches="tight")
            plt.close(figure)


def draw_front(rows: list[Row]):
    """Time against error: trusted runs, those of the mesh axis joined, and the front; a figure."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(TITLES), len(QUANTITIES), figsize=(13.5, 8.0))
    for line, scene in zip(axes, TITLES, strict=True):
        for panel, (quantity, name) in zip(line, QUANTITIES.items(), strict=True):
            own = [row for row in rows if row["scene"] == scene and trusted(row)]
            best = front(own, quantity)
            if best:
                x, y = np.array([(row["seconds"], row[quantity]) for row in best]).T
                panel.step([*x, max(row["seconds"] for row in own)], [*y, y[-1]], where="post", color="#b9bec6",
                           linewidth=5, zorder=1, label="front")
            for method, marker in (("newton", "o"), ("anderson", "^"), ("relaxation", "s")):
                for order in (1, 2):
                    found = [row for row in own if (row["method"], row["order"]) == (method, order)]
                    panel.scatter([row["seconds"] for row in found], [row[quantity] for row in found], s=14,
                                  marker=marker, facecolors="none", edgecolors=COLOURS[order], linewidths=0.7,
                                  alpha=0.6, zorder=2, label=f"order {order}, {method}" if found else None)
            for order in (1, 2):
                meshes = sorted((row for row in own if row["order"] == order and _default(row)),
                                key=lambda row: row["N"])
                panel.plot([row["seconds"] for row in meshes], [row[quantity] for row in meshes], "o-",
                           color=COLOURS[order], markersize=5, zorder=3, label=f"order {order}, default to 1e-8")
                for row in meshes:
                    panel.annotate(f"{row['N']}", (row["seconds"], row[quantity]), textcoords="offset points",
                                   xytext=(4, 4) if order == 1 else (-4, -10), fontsize=7, color=COLOURS[order],
                                   horizontalalignment="left" if order == 1 else "right")
            panel.set(xscale="log", yscale="log", title=f"{TITLES[scene]}: {name}", xlabel="time (s)",
                      ylabel="relative error")
            panel.grid(True, which="major", color="#e3e3e3")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)
    return figure


def _default(row: Row) -> bool:
    return (row["method"], row["tolerance"], row["compliance"]) == ("newton", 1e-8, "explicit")


def draw_tolerance(rows: list[Row]):
    """Algebraic and true error against the tolerance, for the meshes on which it was varied; a figure."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(TITLES), figsize=(10.5, 4.2), sharey=True)
    for panel, scene in zip(axes, TITLES, strict=True):
        own = [row for row in rows if row["scene"] == scene and row["order"] == 1
               and row["compliance"] == "explicit" and (row["inner_precision"], row["theta"], row["splitting"]) in
               ((0.1, 0.2, "none"), ("–", "–", "–")) and row["algorithm"] != "modified"]
        most = max({row["N"] for row in own}, key=lambda N: sum(row["N"] == N for row in own), default=0)
        for method, colour in METHODS.items():
            found = sorted((row for row in own if (row["method"], row["N"]) == (method, most)),
                           key=lambda row: row["tolerance"])
            x = [row["tolerance"] for row in found]
            panel.plot(x, [row["algebraic"] or np.nan for row in found], "o-", color=colour, markersize=4,
                       label=f"{method}, algebraic error")
            panel.plot(x, [row["energy"] for row in found], "--", color=colour, label=f"{method}, true error")
        panel.set(xscale="log", yscale="log", title=f"{TITLES[scene]}, order 1, N = {most}", xlabel="tolerance")
        panel.invert_xaxis()
        panel.grid(True, which="major", color="#e3e3e3")
    axes[0].set_ylabel("relative error, energy norm")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)
    return figure
