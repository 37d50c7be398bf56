"""Plots of a sweep: any column of its table against any other, drawn from the table only."""

from __future__ import annotations

import io
import json
import math
import statistics
from pathlib import Path
from typing import Any

from ddmpi.errors import InputError
from ddmpi.results.pictures import COLOURS, STYLE, identity
from ddmpi.sweep.cases import Case
from ddmpi.sweep.table import columns, find_column, read_table
from ddmpi.system.files import SUMMARY, TABLE, write_atomically

MOST_CURVES = 12
"""Most curves that a legend can tell apart."""

WIDE = 20.0
"""Positive values that span more than this factor may stand on a logarithmic axis."""

TEXTS = ("status", "reason", "started", "folder")
"""Columns that hold no numbers."""

MEASURES = frozenset({"case", "exit", "n", "m", "n_A", "eff", "outer_iterations", "inner_iterations", "memory_mib",
                      "seconds", "certificate"})
"""Parts of the names of results that mean something without a certificate."""

UNITS = {"seconds": "s", "memory_mib": "MiB", "energy": "J/m", "dissipated": "J/m", "normal_force": "N/m",
         "tangential_force": "N/m", "force": "N/m", "reaction": "N/m", "moment": "N", "certificate": "–",
         "discretization_error": "–", "eff": "–", "theta": "–", "poisson": "–", "coefficient": "–", "tolerance": "–",
         "inner_precision": "–"}
"""Units of SI scenes by a part of a column's name; forces and energies are per metre of depth."""

LENGTHS, STRESSES = ("displacement_max", "x", "y"), ("young", "slip_bound", "von_mises_max", "pressure_max")
"""Parts of the names of what is measured in the units that a scene names."""

GROUPED = ("seconds", "certificate", "discretization_error")
"""Results that stand on an axis with the name of their group."""

WORDS = {"n_A": "n$_A$", "outer_iterations": "outer iterations", "eff": "n$_A$ / 2m", "theta": "θ",
         "n": "n unknowns", "m": "m contact nodes", "displacement_max": "largest displacement",
         "normal_force": "normal force", "tangential_force": "tangential force", "memory_mib": "memory",
         "energy_norm": "energy norm", "force_mismatch": "force mismatch",
         "coefficient": "friction coefficient", "young": "Young's modulus", "poisson": "Poisson's ratio",
         "inner_iterations": "inner iterations", "inner_precision": "inner precision"}
"""What stands on an axis instead of the last part of a column's name."""


def check_plots(plots: list[str], cases: list[Case]) -> None:
    """InputError where a RESULT:KEY can be seen to be wrong before the cases run. Not collective.

    The columns of bodies and contacts are not known before.
    """
    for plot in plots:
        result, key = _split(plot)
        key = _column(plot, key, columns(cases))
        if result in TEXTS:
            raise InputError(f"--plot {plot}: {result} is not a number")
        if key in cases[0].settings:
            rows = [{name: str(value) for name, value in case.values.items()} for case in cases]
            _curves(rows, _others(rows, list(rows[0]), key), plot)


def draw_plots(folder: Path, plots: list[str]) -> list[Path]:
    """Draw each RESULT:KEY of `plots` from the table in `folder`, as RESULT-KEY.png beside it.

    Not collective. Raises InputError where there is no table, no such column or nothing to draw, OutputError where a
    picture cannot be written.
    """
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    rows = read_table(folder / TABLE)
    summary, drawn = _first_summary(folder, rows), []
    with plt.rc_context(STYLE):
        for plot in plots:
            result, key = (_column(plot, word, rows[0]) for word in _split(plot))
            figure, picture = draw_curves(rows, result, key, summary), io.BytesIO()
            figure.savefig(picture, format="png", metadata=identity(summary))
            plt.close(figure)
            drawn.append(folder / f"{result}-{key}.png")
            write_atomically(drawn[-1], picture.getvalue())
    return drawn


def draw_curves(rows: list[dict[str, Any]], result: str, key: str, summary: dict):
    """`result` against `key`, a curve for each combination of the other varied keys; a figure.

    Cases without a certified answer are hollow and off the curve. Where the result means nothing without a certificate
    they are left out. Words stand beside each other in the order of the table. Raises InputError where there is nothing
    to draw, or too much.
    """
    import matplotlib.pyplot as plt

    plot = f"{result}:{key}"
    parts = [part for k, part in enumerate(result.split(".")) if k != 1]  # without the name of a body or contact
    known = [row for row in rows if row[result] is not None and row[key] is not None]
    points = [row for row in known if row["status"] == "certified" or MEASURES.intersection(parts)]
    if not points or not all(isinstance(row[result], int | float) for row in points):
        reason = f"{result} is not a number" if points else "no case has both" if not known else "no case is certified"
        raise InputError(f"--plot {plot}: {reason}")
    names = list(rows[0])
    others = _others(rows, names[1:names.index("status")], key)
    curves = _curves(points, others, plot)
    texts = not all(isinstance(row[key], int | float) for row in points)
    words = list(dict.fromkeys(str(row[key]) for row in points)) if texts else []
    figure, axes = plt.subplots(figsize=(7.2 if len(curves) == 1 else 8.6, 4.6))
    for k, (combination, own) in enumerate(curves.items()):
        share = k / max(len(curves) - 1, 1)
        line = {"color": plt.get_cmap("viridis")(0.9 * share) if len(curves) > 1 else COLOURS["normal"], "marker": "o",
                "markersize": 9.0 - 4.5 * share, "linewidth": 3.5 - 2.2 * share}  # those below show behind equal ones
        for certified in (True, False):
            at = sorted((words.index(str(row[key])) if words else row[key], row[result]) for row in own
                        if (row["status"] == "certified") == certified)
            if at:
                axes.plot(*zip(*at, strict=True), **line, linestyle="-" if certified and not words else "none",
                          markerfacecolor=line["color"] if certified else "white")
        axes.plot([], [], **line, label=", ".join(map(_word, combination)))
    if len(curves) > 1:
        axes.legend(title=", ".join(_label(name, [key, *others], summary) for name in others), loc="upper left",
                    bbox_to_anchor=(1.0, 1.0), alignment="left")
    if words:
        axes.set_xticks(range(len(words)), words, rotation=0 if sum(map(len, words)) < 60 else 30)
        axes.set_xlim(-0.5, len(words) - 0.5)
    elif _is_geometric([row[key] for row in points]):
        axes.set_xscale("log")
    values = [row[result] for row in points]
    if _is_geometric(values):
        axes.set_yscale("log")
    elif 0 <= min(values) < 0.5 * max(values):
        axes.set_ylim(0, 1.06 * max(values))
    axes.grid(True, which="major", color="#e3e3e3")
    axes.set(xlabel=_label(key, [key, *others], summary), ylabel=_label(result, names, summary))
    hollow, missing = sum(row["status"] != "certified" for row in points), len(rows) - len(points)
    notes = (f"{len(points)} cases" + f", {hollow} of them not certified (hollow)" * (hollow > 0)
             + f", {missing} without a certified answer left out" * (missing > 0))
    title = summary["title"].replace("$", r"\$")  # no formula
    axes.set_title(f"{title}\n{notes}" if title else notes)
    return figure


def _split(plot: str) -> tuple[str, str]:
    result, _, key = plot.partition(":")
    if not (result and key):
        raise InputError(f"--plot {plot}: expected RESULT:KEY, two columns of the table, as in n_A:theta")
    return result, key


def _column(plot: str, word: str, names) -> str:
    try:
        return find_column(word, names)
    except InputError as error:
        raise InputError(f"--plot {plot}: {error}") from None


def _first_summary(folder: Path, rows: list[dict[str, Any]]) -> dict:
    """The summary of the first case that has one, for title, units and identity. Raises InputError."""
    for row in rows:
        path = folder / str(row["folder"]) / SUMMARY
        if row["n_A"] is not None:
            try:
                return json.loads(path.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise InputError(f"{path}: cannot be read: {error}") from None
    raise InputError(f"{folder / TABLE}: no case has results; there is nothing to draw")


def _others(rows: list[dict[str, Any]], names: list[str], key: str) -> list[str]:
    """Those of `names` that tell cases of one `key` apart; of keys that vary together the first."""
    chosen = [key]
    for name in names:
        values = {str(row[name]) for row in rows}
        together = any(len({(str(row[name]), str(row[other])) for row in rows})
                       == len(values) == len({str(row[other]) for row in rows}) for other in chosen)
        if len(values) > 1 and not together:
            chosen.append(name)
    return chosen[1:]


def _curves(rows: list[dict[str, Any]], others: list[str], plot: str) -> dict[tuple, list[dict]]:
    """Rows by their values of `others`; numbers by size, words in the order of the table. Raises InputError."""
    curves: dict[tuple, list[dict]] = {}
    for row in rows:
        curves.setdefault(tuple(row[name] for name in others), []).append(row)
    if len(curves) > MOST_CURVES:
        raise InputError(f"--plot {plot}: that would be {len(curves)} curves, one for each combination of "
                         f"{', '.join(others)}; {MOST_CURVES} is the limit")
    return dict(sorted(curves.items(), key=lambda item: [
        value if isinstance(value, int | float) else math.inf for value in item[0]]))


def _is_geometric(values: list[float]) -> bool:
    """Whether numbers are far apart and crowd towards the small ones, as they do not on a logarithmic axis."""
    low, high = min(values), max(values)
    return 0 < WIDE * low < high and statistics.median_low(set(values)) < (low + high) / 4


def _word(value: Any) -> str:
    """A value as the legend says it; of a number the shorter of two ways that lose nothing."""
    if not isinstance(value, int | float):
        return str(value)
    return min((text for text in (f"{value:.6g}", f"{value:.17g}", str(value)) if float(text) == value), key=len)


def _label(name: str, names: list[str], summary: dict) -> str:
    """A column's name, as far as it is needed to tell it from the other `names`, and its unit."""
    parts, output = name.split("."), summary["scene"]["output"]
    length, stress = output["length_unit"], output["stress_unit"]
    units = {part: unit for part, unit in UNITS.items() if unit in ("–", "s", "MiB") or (length, stress) == ("m", "Pa")}
    units |= dict.fromkeys(STRESSES, stress)
    if not {"force", "reaction"}.intersection(parts):
        units |= dict.fromkeys(LENGTHS, length)
    unit = next((f" ({units[part]})" for part in parts if part in units), "")
    ends = [".".join(parts[k:]) for k in range(len(parts) - 1, 0, -1)] if parts[0] not in GROUPED else []
    end = next((end for end in ends if sum(f".{other}".endswith(f".{end}") for other in names) == 1), name)
    *where, last = end.split(".")
    return ": ".join([*(part.replace("$", r"\$") for part in where), WORDS.get(last, last)]) + unit
