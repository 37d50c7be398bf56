"""Pictures of a sweep: any column of its table against any other, drawn from the table only."""

from __future__ import annotations

import io
import itertools
import json
import math
import statistics
from pathlib import Path
from typing import Any

from ddmpi.errors import InputError
from ddmpi.results.pictures import COLOURS, STYLE, identity
from ddmpi.sweep.cases import Case
from ddmpi.sweep.table import RESULTS, columns, find_column, read_table
from ddmpi.system.files import TABLE, write_atomically

MOST_CURVES = 12
"""So many curves a legend can tell apart."""

WIDE = 30.0
"""An axis whose positive values span more than this factor is logarithmic."""

SPREAD = 20.0
"""Below this factor values of a key stay on a linear axis, whatever their spacing."""

LENGTHS, STRESSES = ("displacement_max", "x", "y"), ("young", "slip_bound")

PLAIN_UNITS = {"seconds": "s", "memory_mib": "MiB", "energy": "J/m", "normal_force": "N/m", "tangential_force": "N/m",
               "certificate": "–", "discretization_error": "–", "eff": "–", "theta": "–", "poisson": "–",
               "coefficient": "–", "tolerance": "–", "inner_precision": "–"}
"""Units by a part of a column's name; forces and energies are per metre of depth, in SI scenes."""

TEXTS = ("status", "reason", "started", "folder")
"""Columns that hold no numbers."""

PHYSICAL = ("contact", "displacement_max", "energy")
"""Results, by the first part of their column, that mean nothing without a certificate."""

WORDS = {"n_A": "n$_A$", "outer_iterations": "outer iterations", "eff": "n$_A$ / 2m", "theta": "θ",
         "n": "n unknowns", "m": "m contact nodes", "displacement_max": "largest displacement",
         "energy_norm": "discretization error in the energy norm",
         "coefficient": "friction coefficient", "young": "Young's modulus", "poisson": "Poisson's ratio"}

GROUPS = {"seconds": "{} time", "certificate": "certificate: {}", "contact": "contact: {}",
          "energy": "strain energy of body {}", "memory_mib": "memory of rank {}"}


def check_plots(plots: list[str], cases: list[Case]) -> None:
    """InputError unless every RESULT:KEY names two columns of the table of these cases that can be drawn.

    How many curves there are is known beforehand where the key is a varied one. Not collective.
    """
    for plot in plots:
        result, key = _columns_of(plot, columns(cases))
        if result in TEXTS:
            raise InputError(f"--plot {result}:{key}: {result} is not a number")
        if key in cases[0].settings:
            rows = [{name: str(value) for name, value in case.values.items()} for case in cases]
            others = _independent(rows, [name for name in rows[0] if name != key], key)
            _refuse_many(len({tuple(row[name] for name in others) for row in rows}), result, key, others)


def draw_plots(folder: Path, plots: list[str]) -> list[Path]:
    """Draw each RESULT:KEY of `plots` from the table in `folder`, as RESULT-KEY.png beside it.

    Not collective. Raises InputError where there is no table, no such column or nothing to draw,
    OutputError where a picture cannot be written.
    """
    if not plots:
        return []
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    rows = read_table(folder / TABLE)
    if not rows:
        raise InputError(f"{folder / TABLE}: the table is empty")
    summary, drawn = _summary_of_first(folder, rows), []
    with plt.rc_context(STYLE):
        for plot in plots:
            result, key = _columns_of(plot, rows[0])
            path = folder / f"{result}-{key}.png"
            figure, picture = draw_curves(rows, result, key, summary), io.BytesIO()
            figure.savefig(picture, format="png", metadata=identity(summary))
            plt.close(figure)
            write_atomically(path, picture.getvalue())
            drawn.append(path)
    return drawn


def draw_curves(rows: list[dict[str, Any]], result: str, key: str, summary: dict):
    """`result` against `key`, a curve for each combination of the other varied keys; a figure.

    Cases without a certified answer are hollow and off the curve; of forces, displacements and energies they
    are left out. Words stand beside each other in the order of the table. Raises InputError where there is
    nothing to draw, or too much.
    """
    import matplotlib.pyplot as plt
    from matplotlib.lines import Line2D

    known = [row for row in rows if row[result] is not None and row[key] is not None]
    points = [row for row in known if row["status"] == "certified" or result.split(".")[0] not in PHYSICAL]
    if not points or not all(isinstance(row[result], int | float) for row in points):
        reason = f"{result} is not a number" if points else "no case has both" if not known else "no case is certified"
        raise InputError(f"--plot {result}:{key}: {reason}")
    varied = _varied(rows)
    others = _independent(rows, [name for name in varied if name != key], key)
    varied = [key, *others]
    curves: dict[tuple, list[dict]] = {}
    for row in points:
        curves.setdefault(tuple(row[name] for name in others), []).append(row)
    _refuse_many(len(curves), result, key, others)
    told = [_tell_all([combination[k] for combination in curves]) for k in range(len(others))]
    curves = {combination: curves[combination] for combination in sorted(curves, key=_order)}
    figure, axes = plt.subplots(figsize=(7.2 if len(curves) == 1 else 8.6, 4.6))
    words, handles = _words(points, key), []
    for k, (combination, own) in enumerate(curves.items()):
        above = (len(curves) - 1 - k) / max(len(curves) - 1, 1)  # curves below are broader: equal ones stay visible
        line = {"color": plt.get_cmap("viridis")(0.9 * (1 - above)) if len(curves) > 1 else COLOURS["normal"],
                "linestyle": "none" if words else "-", "linewidth": 1.3 + 2.2 * above,
                "marker": "o", "markersize": 4.5 + 4.5 * above}
        own = [(words.index(str(row[key])) if words else row[key], row[result], row["status"]) for row in own]
        certified = sorted((x, y) for x, y, status in own if status == "certified")
        axes.plot(*zip(*certified, strict=True), **line) if certified else None
        hollow = [(x, y) for x, y, status in own if status != "certified"]
        if hollow:
            axes.plot(*zip(*hollow, strict=True), **line | {"linestyle": "none"}, markerfacecolor="white")
        handles.append(Line2D([], [], label=", ".join(
            texts[value] for texts, value in zip(told, combination, strict=True)), **line))
    if len(curves) > 1:
        axes.legend(handles=handles, title=", ".join(_label(name, varied, summary, rows) for name in others),
                    loc="upper left", bbox_to_anchor=(1.0, 1.0), alignment="left")
    if words:
        axes.set_xticks(range(len(words)), words, rotation=0 if sum(map(len, words)) < 60 else 30)
        axes.set_xlim(-0.5, len(words) - 0.5)
    elif _is_geometric([row[key] for row in points]):
        axes.set_xscale("log")
    values = [row[result] for row in points]
    if _is_wide(values):
        axes.set_yscale("log")
    elif 0 <= min(values) < 0.5 * max(values):
        axes.set_ylim(0, 1.06 * max(values))
    axes.grid(True, which="major", color="#e3e3e3")
    axes.set(xlabel=_label(key, varied, summary, rows), ylabel=_label(result, list(rows[0]), summary, rows))
    hollow = sum(row["status"] != "certified" for row in points)
    notes = [f"{len(points)} cases", *([f"{hollow} of them not certified (hollow)"] if hollow else []),
             *([f"{len(rows) - len(points)} without a certified answer left out"] if len(points) < len(rows) else [])]
    title = summary["title"].replace("$", r"\$")  # no formula
    axes.set_title("\n".join([*([title] if title else []), ", ".join(notes)]))
    return figure


def _columns_of(plot: str, names) -> tuple[str, str]:
    result, separator, key = plot.partition(":")
    if not (separator and result and key):
        raise InputError(f"--plot {plot}: expected RESULT:KEY, two columns of the table, as in n_A:theta")
    try:
        return find_column(result, names), find_column(key, names)
    except InputError as error:
        raise InputError(f"--plot {plot}: {error}") from None


def _summary_of_first(folder: Path, rows: list[dict[str, Any]]) -> dict:
    """The summary of the first case that has one, for title, units and identity. Raises InputError."""
    for row in rows:
        path = folder / str(row["folder"]) / "summary.json"
        if row["n_A"] is not None:
            try:
                return json.loads(path.read_text(encoding="utf-8"))
            except (OSError, ValueError) as error:
                raise InputError(f"{path}: cannot be read: {error}") from None
    raise InputError(f"{folder / TABLE}: no case has results; there is nothing to draw")


def _varied(rows: list[dict[str, Any]]) -> list[str]:
    """The varied keys: the columns between case and status."""
    names = list(rows[0])
    return names[1:names.index("status")]


def _independent(rows: list[dict[str, Any]], names: list[str], key: str) -> list[str]:
    """Those of `names` that tell cases of one `key` apart; of keys that vary together the first."""
    chosen: list[str] = []
    for name in names:
        if len({str(row[name]) for row in rows}) > 1 and not any(_together(rows, name, c) for c in [key, *chosen]):
            chosen.append(name)
    return chosen


def _together(rows: list[dict[str, Any]], one: str, other: str) -> bool:
    """Whether each value of either key goes with one value of the other."""
    pairs = {(str(row[one]), str(row[other])) for row in rows}
    return len(pairs) == len({a for a, _ in pairs}) == len({b for _, b in pairs})


def _words(points: list[dict[str, Any]], key: str) -> list[str]:
    """The values of a key that is not a number, in the order of the table; else nothing."""
    values = [row[key] for row in points]
    if all(isinstance(value, int | float) for value in values):
        return []
    return list(dict.fromkeys(map(str, values)))


def _is_wide(values: list) -> bool:
    return all(isinstance(v, int | float) and v > 0 for v in values) and max(values) > WIDE * min(values)


def _is_geometric(values: list) -> bool:
    """Whether positive numbers stand more evenly on a logarithmic axis; fewer than three, if they are far apart."""
    distinct = sorted(set(values))
    if len(distinct) < 3 or not 0 < SPREAD * distinct[0] < distinct[-1]:
        return _is_wide(values)

    def unevenness(places: list[float]) -> float:
        gaps = [b - a for a, b in itertools.pairwise(places)]
        return statistics.pstdev(gaps) / statistics.mean(gaps)
    return unevenness([math.log(value) for value in distinct]) < unevenness(distinct)


def _order(combination: tuple) -> tuple:
    """Sorts combinations of values: numbers by size, and all else in the order of the table, behind them."""
    return tuple(value if isinstance(value, int | float) else math.inf for value in combination)


def _tell_all(values: list) -> dict[Any, str]:
    """Each value in words; numbers all with as many digits as they need, and with or without powers of ten."""
    numbers = [float(value) for value in values if isinstance(value, int | float)]
    sizes = [abs(value) for value in numbers if value]
    powers = bool(sizes) and not 1e-3 <= min(sizes) <= max(sizes) < 1e5
    return {value: _tell(float(value), powers) if isinstance(value, int | float) else str(value) for value in values}


def _tell(value: float, powers: bool) -> str:
    if not (powers and value):
        return f"{value:.12g}"
    mantissa, power = f"{value:.11e}".split("e")
    factor = mantissa.rstrip("0").rstrip(".") + r" \times "
    return f"${'' if float(mantissa) == 1 else factor}10^{{{int(power)}}}$"


def _refuse_many(number: int, result: str, key: str, others: list[str]) -> None:
    if number > MOST_CURVES:
        raise InputError(f"--plot {result}:{key}: that would be {number} curves, one for each combination of "
                         f"{', '.join(others)}; {MOST_CURVES} is the limit")


def _short(name: str, names: list[str]) -> str:
    """The shortest end of a dotted name that no other name has."""
    parts = name.split(".")
    for k in range(len(parts) - 1, 0, -1):
        end = ".".join(parts[k:])
        if sum(other == end or other.endswith(f".{end}") for other in names) == 1:
            return end
    return name


def _label(name: str, names: list[str], summary: dict, rows: list[dict[str, Any]]) -> str:
    """A column's name and unit; keys of bodies with the name of the body, or of all that they vary in alike."""
    parts = name.split(".")
    output = summary["scene"]["output"]
    units = PLAIN_UNITS if (output["length_unit"], output["stress_unit"]) == ("m", "Pa") else {
        part: unit for part, unit in PLAIN_UNITS.items() if unit in ("–", "s", "MiB")}
    found = [units[part] for part in parts if part in units]
    if parts[-1] in STRESSES:
        found = [output["stress_unit"]]
    elif parts[-1] in LENGTHS:
        found = [output["length_unit"]]
    unit = f" ({found[0]})" if found else ""
    if parts[0] == "body" and len(parts) > 2:
        bodies = [body["name"] for body in summary["scene"]["body"]]
        alike = [key.split(".")[1] for key in _varied(rows) if key.startswith("body.")
                 and key.split(".")[2:] == parts[2:] and all(row[key] == row[name] for row in rows)]
        whose = ", ".join(bodies[int(part)] if part not in bodies else part for part in alike).replace("$", r"\$")
        tails = {".".join(other.split(".")[2:]) for other in names if other.startswith("body.")}
        return f"{whose}: {_word(_short('.'.join(parts[2:]), list(tails)))}{unit}"
    return _word(name if name in RESULTS else _short(name, names)) + unit


def _word(name: str) -> str:
    """A column's name as it is read on an axis."""
    group, _, last = name.rpartition(".")
    return GROUPS.get(group, f"{group}: {{}}" if group else "{}").format(WORDS.get(last, last.replace("_", " ")))
