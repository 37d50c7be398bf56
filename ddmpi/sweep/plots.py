"""Plots of a sweep: any column of its table against any other, drawn from the table only."""

import io
import math
import statistics
from pathlib import Path
from typing import Any

from ddmpi.errors import InputError
from ddmpi.pictures.sheet import COLOURS, STYLE, save, start_drawing
from ddmpi.results.summary import ROWS
from ddmpi.results.tables import reading
from ddmpi.sweep.cases import cut
from ddmpi.sweep.table import find_column, read_outcome, read_table, varied
from ddmpi.system.files import TABLE, write_atomically
from ddmpi.system.provenance import identity

MOST_CURVES = 12  # that a legend can tell apart

WIDE = 20.0  # positive values that span more than this factor may stand on a logarithmic axis

WORDS = {
    "n_A": "solves with stiffnesses",
    "seconds.total": "time",
    "displacement_max": "largest displacement",
    "discretization_error.energy_norm": "estimated error",
    "m": "contact nodes",
    "n": "unknowns",
}
"""Words of columns that have none in the summary."""

UNITS = {"seconds": "s", "memory_mib": "MiB", "young": "{stress}", "slip_bound": "{stress}"} | {
    key.rpartition(".")[2]: f"{{{row.quantity}}}"
    for key, row in ROWS.items()
    if row.quantity not in ("", "%", "angle")
}
"""Units by a part of a column's name, as keys of the summary's units."""


def draw_plot(folder: Path, plot: str) -> Path:
    """Draw RESULT:KEY from the table in `folder`, as RESULT-KEY.png beside it; its path. A long name is cut.

    Not collective. Raises InputError where there is no such column, nothing to draw or no matplotlib, OutputError where
    the picture cannot be written.
    """
    plt = start_drawing()
    with reading(folder, "the folder of a sweep"), plt.rc_context(STYLE):
        rows = read_table(folder / TABLE)
        summary = next(
            filter(None, (read_outcome(folder / str(row["folder"])).summary for row in rows)), None
        )
        if not summary:
            raise InputError(f"--plot {plot}: no case has results")
        result, _, key = plot.partition(":")
        if not (result and key):
            raise InputError(
                f"--plot {plot}: expected RESULT:KEY, two columns of the table, as in n_A:theta"
            )
        result, key = (find_column(word, list(rows[0]), f"--plot {plot}") for word in (result, key))
        figure, picture = draw_curves(rows, result, key, summary), io.BytesIO()
        save(figure, picture, identity(summary))
        plt.close(figure)
    name = f"{result}-{key}".replace("/", "_")
    path = folder / f"{cut(name, name)}.png"
    write_atomically(path, picture.getvalue())
    return path


def draw_curves(rows: list[dict[str, Any]], result: str, key: str, summary: dict):
    """`result` against `key`, a curve for each combination of the other varied keys; a figure.

    Only cases with a certified answer are drawn. Words stand beside each other. Raises InputError where there is
    nothing to draw, or too much.
    """
    import matplotlib.pyplot as plt
    from matplotlib.ticker import LogFormatter

    plot = f"{result}:{key}"
    points = _points(rows, result, key, plot)
    others = _others(rows, key)
    curves = _curves(points, others, plot)
    words = not all(_is_number(row[key]) for row in points)
    several = len(curves) > 1
    figure, axes = plt.subplots(figsize=(8.6 if several else 7.2, 4.6))
    for k, (combination, curve) in enumerate(curves.items()):
        share = k / (len(curves) - 1) if several else 1.0
        colour = plt.get_cmap("viridis")(0.9 * share) if several else COLOURS["normal"]
        axes.plot(
            *_ordered([(row[key], row[result]) for row in curve], words),
            "o" if words else "o-",
            color=colour,
            label=", ".join(map(_short, combination)),
            # those below show behind equal ones
            markersize=9.0 - 4.5 * share,
            linewidth=3.5 - 2.2 * share,
        )
    if several:
        axes.legend(
            title="\n".join(_label(name, summary) for name in others),
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            alignment="left",
        )
    for name, scale, axis in (
        (key, axes.set_xscale, axes.xaxis),
        (result, axes.set_yscale, axes.yaxis),
    ):
        if not (words and name == key) and _crowds([row[name] for row in points]):
            scale("log")
            axis.set_major_formatter("{x:g}")
            axis.set_minor_formatter(LogFormatter())
    axes.grid(True, which="major", color="#e3e3e3")
    axes.set(xlabel=_label(key, summary), ylabel=_label(result, summary))
    missing = len(rows) - len(points)
    left_out = f", {missing} without a certified answer left out" * bool(missing)
    title = f"{summary['title']}\n{len(points)} cases{left_out}"
    axes.set_title(title.strip())
    return figure


def _points(rows: list[dict[str, Any]], result: str, key: str, plot: str) -> list[dict[str, Any]]:
    """The rows with certified answers that have both columns. Raises InputError without one."""
    certified = [row for row in rows if row["status"] == "certified"]
    points = [row for row in certified if None not in (row[result], row[key])]
    if not points:
        raise InputError(f"--plot {plot}: no case with a certified answer has both")
    if not all(_is_number(row[result]) for row in points):
        raise InputError(f"--plot {plot}: {result} is not a number")
    return points


def _ordered(at: list[tuple[Any, float]], words: bool) -> tuple[list[Any], ...]:
    """The two columns of places: `words` in the order of the table, numbers by size."""
    if not words:
        return tuple(map(list, zip(*sorted(at), strict=True)))
    return [str(value) for value, _ in at], [number for _, number in at]


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float)


def _short(value: Any) -> str:
    return f"{value:g}" if _is_number(value) else str(value)


def _others(rows: list[dict[str, Any]], key: str) -> list[str]:
    """The varied keys that distinguish cases of one `key`; of keys that vary together the first."""
    patterns: dict[tuple[int, ...], str] = {}
    for name in (key, *varied(rows)):
        first: dict[str, int] = {}  # the row in which a value comes first
        patterns.setdefault(
            tuple(first.setdefault(str(row[name]), k) for k, row in enumerate(rows)), name
        )
    return [name for pattern, name in patterns.items() if any(pattern) and name != key]


def _curves(rows: list[dict[str, Any]], others: list[str], plot: str) -> dict[tuple, list[dict]]:
    """Rows by their values of `others`; numbers by size, words in the order of the table. Raises InputError."""
    curves: dict[tuple, list[dict]] = {}
    for row in rows:
        curves.setdefault(tuple(row[name] for name in others), []).append(row)
    if len(curves) > MOST_CURVES:
        raise InputError(
            f"--plot {plot}: that would be {len(curves)} curves, one for each combination of "
            f"{', '.join(others)}; {MOST_CURVES} is the limit"
        )
    sizes = {
        values: [value if _is_number(value) else math.inf for value in values] for values in curves
    }
    return {values: curves[values] for values in sorted(curves, key=sizes.__getitem__)}


def _crowds(values: list[float]) -> bool:
    """Whether positive numbers are far apart, and half of them crowd in the lowest quarter of a linear axis."""
    low, high = min(values), max(values)
    return 0 < WIDE * low < high and statistics.median_low(set(values)) < (low + high) / 4


def _label(name: str, summary: dict) -> str:
    """What a column is, in words, and its unit, in the scene's units."""
    pattern = next((UNITS[part] for part in name.split(".") if part in UNITS), "")
    unit = pattern.format_map(summary["units"])
    head, *rest = name.split(".")
    words = name
    if head in ("body", "bodies", "contact", "contacts", "rigid", "history") and len(rest) > 1:
        row = ROWS.get(".".join([head, "NAME", *rest[1:]]))
        *places, last = rest[1:]  # numbers of places in lists go, but for that of a component
        last = "xyz"[int(last)] if last in ("0", "1", "2") else last
        names = [*(part for part in places if not part.isdecimal()), last]
        words = f"{row.words if row else ' '.join(names)} of {rest[0]}"
    elif head not in ("k", "method"):
        row = ROWS.get(name)
        words = row.words if row else WORDS.get(name, " ".join(name.split(".")))
    words = words.replace("_", " ")
    return f"{words} ({unit})" if unit else words
