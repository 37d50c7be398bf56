"""The page and the figures of tradeoff.py, made from its table alone."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from experiment import Row, save_figures, table, where

PAGE = "tradeoff_table.md"
TARGETS = (0.1, 0.05, 0.03, 0.02, 0.01, 0.005, 0.001)
"""Errors in the energy norm for which the cheapest way is looked up."""

LOOSEST = 1e-3
"""Looser tolerances are shown, but not recommended, because the certificate asks for no more than 50 times them."""

TITLES = {"blocks": "Pinched blocks", "rings": "Rings"}
QUANTITIES = {"energy": "energy norm", "pressure": "contact pressure at nodes", "side_pressure": "its means over sides"}
COLOURS = {1: "#1b4f8f", 2: "#c8501e"}
METHODS = {"newton": "#1b4f8f", "anderson": "#3f8f4f", "relaxation": "#c8501e"}

COST = {"seconds": "s", "cpu_seconds": "CPU s", "memory_mib": "MiB", "iterations": "k", "n_A": "n_A"}
ERRORS = {"energy": "energy norm", "pressure": "pressure", "side_pressure": "side means",
          "normal_force": "normal force"}
OF_FRICTION = {"shear": "tangential stress", "tangential_force": "tangential force", "contact_end": "contact end",
               "stick_end": "stick ends"}
"""Columns of the study and their titles."""


def pick(rows: list[Row], cases: list[tuple]) -> list[Row]:
    """The rows of the cases that have been run, in the order of the cases."""
    found = {tuple(row.values())[:len(cases[0])]: row for row in rows}
    return [found[case] for case in cases if case in found]


def trusted(row: Row) -> bool:
    """Whether a run's answer may be recommended."""
    return row["outcome"] == "certified" and row["tolerance"] <= LOOSEST


def front(rows: list[Row], quantity: str = "energy") -> list[Row]:
    """The trusted rows for which no other is both faster and as accurate, within one per cent; the fastest first."""
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


def failed(row: Row) -> str:
    """The outcome of a run without certificate, else nothing."""
    return "" if row["outcome"] == "certified" else f" ({row['outcome'].split(';')[0]})"


def show(row: Row, column: str) -> str:
    """An entry in words."""
    value = row[column]
    if column.endswith("seconds"):
        return seconds(value)
    if column == "memory_mib":
        return f"{value:.0f}"
    if column == "iterations":
        return f"{value}{failed(row)}"
    if column in ("algebraic", "tolerance"):
        return small(value)
    if column in ("contact_end", "stick_end"):
        return millimetres(value)
    return percent(value) if column in ERRORS or column in OF_FRICTION or column == "estimated" else str(value)


def plain_table(columns: dict[str, str], rows: list[Row]) -> list[str]:
    """A line for every row; `columns` with their titles."""
    return table(columns.values(), ([show(row, column) for column in columns] for row in rows))


# Tables

def mesh_tables(rows: list[Row]) -> list[str]:
    lines = ["## Mesh and order", "", "Default method, tolerance 1e-8. Side means: of the contact "
             "pressure over the elements' sides; pressure: at the nodes. Ends: of the contact zone and of the stick "
             "zones, in mm, of an interface of 3 m; a mesh has them halfway between two nodes.", ""]
    for scene, title in TITLES.items():
        for order in (1, 2):
            own = where(rows, scene=scene, order=order)
            columns = {"N": "N", "n": "n"} | COST | ERRORS | (OF_FRICTION if scene == "blocks" else {})
            lines += [f"{title}, order {order}. Rates over the last three meshes: energy norm "
                      f"{rate(own, 'energy'):.2f}, pressure {rate(own, 'pressure'):.2f}, its side means "
                      f"{rate(own, 'side_pressure'):.2f}.", "", *plain_table(columns, own)]
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

    def cell(found: list[Row]) -> str:
        for row in found:
            return (f"{row['iterations']} · {row['n_A']} · {seconds(row['outer_seconds'])}; {small(row['algebraic'])}; "
                    f"{percent(row['energy'])}{failed(row)}")
        return "not run"

    for scene, order in dict.fromkeys((row["scene"], row["order"]) for row in rows):
        own = where(rows, scene=scene, order=order)
        methods = list(dict.fromkeys(row["method"] for row in own))
        lines += [f"{TITLES[scene]}, order {order}, N = {own[0]['N']}:", "", *table(["tolerance", *methods], (
            [small(tolerance), *(cell(where(own, method=method, tolerance=tolerance)) for method in methods)]
            for tolerance in sorted({row["tolerance"] for row in own}, reverse=True)))]
    return lines


def choice_tables(own: dict[str, list[Row]]) -> list[str]:
    """The tables of the axes that vary a choice on a few meshes."""
    lines, published = [], "Published iteration"
    results = {"iterations": "k", "n_A": "n_A", "seconds": "s", "outer_seconds": "outer iteration, s",
               "memory_mib": "MiB", "algebraic": "algebraic error", "energy": "energy norm"}
    for axis, title, text, names in (
            ("inner precision", "Inner precision", f"{published}, original algorithm without splitting, θ = 0.2.",
             {"tolerance": "tolerance", "inner_precision": "η"}),
            ("compliance", "Compliance", "Newton, tolerance 1e-8.",
             {"order": "order", "N": "N", "compliance": "compliance"}),
            ("method", "Outer method", "Tolerance 1e-6.", {"order": "order", "N": "N", "method": "method"}),
            ("variant", "Algorithm and splitting", f"{published}, tolerance 1e-4, η = 0.1.",
             {"algorithm": "algorithm", "splitting": "splitting", "theta": "θ"})):
        lines += [f"## {title}", "", text, "", *plain_table(names | results, own[axis])]
    return lines


def cheapest_tables(rows: list[Row]) -> list[str]:
    lines = ["## The cheapest way to an error", "", "Of all certified runs above to 1e-3 or tighter, the fastest whose "
             "true error in the energy norm is at most so large.", ""]
    for scene in TITLES:
        own = list(filter(trusted, where(rows, scene=scene)))
        body = []
        for target in TARGETS:
            good = [[row for row in own if row["order"] == order and row["energy"] <= target] for order in (1, 2)]
            if any(good):
                body.append([percent(target), *(_cheapest(found) for found in good)])
        lines += [f"{TITLES[scene]}:", "", *table(["error", "order 1", "order 2"], body)]
    lines += ["Fronts: runs for which no other is both faster and as accurate, within one per cent.", ""]
    for scene in TITLES:
        for quantity, name in QUANTITIES.items():
            best = front(where(rows, scene=scene), quantity)
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
        found = sorted(where(own["tolerance"], scene="blocks", order=1, method=method),
                       key=lambda row: -row["tolerance"])
        above = [k for k, row in enumerate(found) if row["algebraic"] > 0.1 * row["energy"]]
        loose = next(iter(found[above[-1] + 1 if above else 0:]), None)
        if loose:
            (tight,) = where(found, tolerance=1e-8)
            lines.append(
                f"- Tolerance, {method}: from {small(loose['tolerance'])} on the algebraic error is below a tenth of "
                f"the true one (pinched blocks, order 1, N = {loose['N']}). 1e-8 takes {tight['iterations']} outer "
                f"iterations instead of {loose['iterations']}, {tight['n_A']} multiplications instead of "
                f"{loose['n_A']}, {seconds(tight['outer_seconds'])} s instead of {seconds(loose['outer_seconds'])} s.")
    for name, axis, key, base in (("Compliance", "compliance", "compliance", "explicit"),
                                  ("Outer method", "method", "method", "newton")):
        bases = {(row["order"], row["N"]): row for row in where(own[axis], **{key: base})}
        for other in dict.fromkeys(row[key] for row in own[axis] if row[key] != base):
            pairs = [(row, bases[row["order"], row["N"]]) for row in where(own[axis], **{key: other})
                     if (row["order"], row["N"]) in bases]
            lines.append(f"- {name} {other} against {base}: " + ", ".join(
                f"{words} × {spread([row[column] / least[column] for row, least in pairs])}" for words, column in
                (("outer iteration", "outer_seconds"), ("memory", "memory_mib"), ("multiplications", "n_A"))) + ".")
    for scene in TITLES:
        parts = ", ".join(f"order {order} " + spread([row["estimated"] / row["energy"] for row in where(
            own["mesh"], scene=scene, order=order)]) for order in (1, 2))
        lines.append(f"- Effectivity of the error estimate, {TITLES[scene].lower()}: {parts}.")
    return [*lines, ""]


def spread(values: list[float]) -> str:
    if not values:
        return "–"
    low, high = (f"{value:.2f}" if value < 9.95 else f"{value:.0f}" for value in (min(values), max(values)))
    return low if low == high else f"{low}–{high}"


def preset_table(rows: list[Row]) -> list[str]:
    columns = {"n": "n", "n_A": "n_A", "seconds": "s", "memory_mib": "MiB", "estimated": "estimated error"} | ERRORS
    body = [[TITLES[row["scene"]].lower(), ("fast", "balanced", "accurate")[k % 3], choice(row),
             *(show(row, column) for column in columns)] for k, row in enumerate(rows)]
    return ["## Presets", "", "What the presets make of meshes of N = 22 (blocks) and N = 16 (rings); accurate: the "
            "mesh that brings the estimate below 1 %, without the coarser meshes on the way there.", "",
            *table(["scene", "preset", "settings", *columns.values()], body)]


def page(rows: list[Row], axes: dict[str, list[tuple]]) -> str:
    """All tables, as Markdown."""
    own = {axis: pick(rows, cases) for axis, cases in axes.items()}
    most = max((row["runs"] for row in rows if np.isfinite(row["runs"])), default=0)
    return "\n".join([
        "# Accuracy and its cost", "",
        "Generated by `scripts/tradeoff.py`; what it means is in [tradeoff.md](../tradeoff.md). Squares (blocks) of "
        "side 1/N, rings of N × 3N cells. Seconds: mesh, assembly, factorization, outer iteration, displacements "
        f"and error estimate on two ranks, the slower one; the least of up to {most} runs. CPU s: of both ranks, "
        "waiting for the other one included. MiB: peak memory of both ranks above what they hold before. k outer "
        "iterations, n_A multiplications by A⁻¹ of both bodies.", "",
        "![time against error](figures/tradeoff_front.png)", "", "## In short", "", *statement(own),
        *preset_table(own["preset"]), *mesh_tables(own["mesh"]), *effectivity_table(own["mesh"]),
        *tolerance_tables(own["tolerance"]), "![errors against the tolerance](figures/tradeoff_tolerance.png)", "",
        *choice_tables(own), *cheapest_tables(rows)])


# Figures

def draw(rows: list[Row], axes: dict[str, list[tuple]], folder: Path) -> None:
    """Draw tradeoff_front.png, time against errors, and tradeoff_tolerance.png, errors against the tolerance."""
    save_figures(folder, {"tradeoff_front": lambda: draw_front(rows),
                          "tradeoff_tolerance": lambda: draw_tolerance(pick(rows, axes["tolerance"]))})


def draw_front(rows: list[Row]):
    """Time against error: trusted runs, those of the mesh axis joined, and the front; a figure."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(len(TITLES), len(QUANTITIES), figsize=(13.5, 8.0))
    for line, scene in zip(axes, TITLES, strict=True):
        for panel, (quantity, name) in zip(line, QUANTITIES.items(), strict=True):
            own = list(filter(trusted, where(rows, scene=scene)))
            best = front(own, quantity)
            if best:
                x, y = np.array([(row["seconds"], row[quantity]) for row in best]).T
                panel.step([*x, max(row["seconds"] for row in own)], [*y, y[-1]], where="post", color="#b9bec6",
                           linewidth=5, zorder=1, label="front")
            for method, marker in (("newton", "o"), ("anderson", "^"), ("relaxation", "s")):
                for order in (1, 2):
                    found = where(own, method=method, order=order)
                    panel.scatter([row["seconds"] for row in found], [row[quantity] for row in found], s=14,
                                  marker=marker, facecolors="none", edgecolors=COLOURS[order], linewidths=0.7,
                                  alpha=0.6, zorder=2, label=f"order {order}, {method}" if found else None)
            for order in (1, 2):
                meshes = sorted(where(own, order=order, method="newton", tolerance=1e-8, compliance="explicit"),
                                key=lambda row: row["N"])
                panel.plot([row["seconds"] for row in meshes], [row[quantity] for row in meshes], "o-",
                           color=COLOURS[order], markersize=5, zorder=3, label=f"order {order}, default to 1e-8")
                for row in meshes:
                    panel.annotate(f"{row['N']}", (row["seconds"], row[quantity]), textcoords="offset points",
                                   xytext=(4, 4) if order == 1 else (-4, -10), fontsize=7, color=COLOURS[order],
                                   horizontalalignment="left" if order == 1 else "right")
            panel.set(xscale="log", yscale="log", title=f"{TITLES[scene]}: {name}", xlabel="time (s)",
                      ylabel="relative error")
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)
    return figure


def draw_tolerance(rows: list[Row]):
    """Algebraic and true error against the tolerance, for the meshes on which it was varied; a figure."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(TITLES), figsize=(10.5, 4.2), sharey=True)
    for panel, scene in zip(axes, TITLES, strict=True):
        own = where(rows, scene=scene, order=1)
        if not own:
            continue
        for method, colour in METHODS.items():
            found = sorted(where(own, method=method), key=lambda row: row["tolerance"])
            x = [row["tolerance"] for row in found]
            panel.plot(x, [row["algebraic"] or np.nan for row in found], "o-", color=colour, markersize=4,
                       label=f"{method}, algebraic error")
            panel.plot(x, [row["energy"] for row in found], "--", color=colour, label=f"{method}, true error")
        panel.set(xscale="log", yscale="log", title=f"{TITLES[scene]}, order 1, N = {own[0]['N']}", xlabel="tolerance")
        panel.invert_xaxis()
    axes[0].set_ylabel("relative error, energy norm")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="upper center", bbox_to_anchor=(0.5, 0.0), ncols=3)
    return figure
