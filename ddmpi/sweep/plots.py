"""Plots of a sweep: any column of its table against any other, drawn from the table only."""

import io
import math
import statistics
from pathlib import Path
from typing import Any

from ddmpi.errors import InputError
from ddmpi.pictures.sheet import COLOURS, STYLE, start_drawing
from ddmpi.results.summary import ROWS
from ddmpi.results.tables import reading
from ddmpi.sweep.cases import cut
from ddmpi.sweep.table import find_column, read_outcome, read_table
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
        figure.savefig(picture, format="png", metadata=identity(summary))
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

    plot = f"{result}:{key}"
    points = [
        row for row in rows if row["status"] == "certified" and None not in (row[result], row[key])
    ]
    if not points:
        raise InputError(f"--plot {plot}: no case with a certified answer has both")
    if not all(isinstance(row[result], int | float) for row in points):
        raise InputError(f"--plot {plot}: {result} is not a number")
    names = list(rows[0])
    others = _others(rows, names[1 : names.index("status")], key)
    curves = _curves(points, others, plot)
    words = not all(isinstance(row[key], int | float) for row in points)
    figure, axes = plt.subplots(figsize=(7.2 if len(curves) == 1 else 8.6, 4.6))
    for k, (combination, curve) in enumerate(curves.items()):
        at = [(row[key], row[result]) for row in curve]
        at = [(str(value), number) for value, number in at] if words else sorted(at)
        share = k / (len(curves) - 1) if len(curves) > 1 else 1.0
        colour = plt.get_cmap("viridis")(0.9 * share) if len(curves) > 1 else COLOURS["normal"]
        label = ", ".join(
            f"{value:g}" if isinstance(value, int | float) else str(value) for value in combination
        )
        axes.plot(
            *zip(*at, strict=True),
            "o" if words else "o-",
            color=colour,
            label=label,
            markersize=9.0 - 4.5 * share,
            linewidth=3.5 - 2.2 * share,
        )  # those below show behind equal ones
    if len(curves) > 1:
        axes.legend(
            title="\n".join(_label(name, summary) for name in others),
            loc="upper left",
            bbox_to_anchor=(1.0, 1.0),
            alignment="left",
        )
    if not words and _crowds([row[key] for row in points]):
        axes.set_xscale("log")
    if _crowds([row[result] for row in points]):
        axes.set_yscale("log")
    axes.grid(True, which="major", color="#e3e3e3")
    axes.set(xlabel=_label(key, summary), ylabel=_label(result, summary))
    missing = len(rows) - len(points)
    notes = f"{len(points)} cases" + f", {missing} without a certified answer left out" * (
        missing > 0
    )
    axes.set_title(f"{summary['title']}\n{notes}".strip().replace("$", r"\$"))  # no formula
    return figure


def _others(rows: list[dict[str, Any]], names: list[str], key: str) -> list[str]:
    """The `names` that distinguish cases of one `key`; of keys that vary together the first."""
    patterns: dict[tuple[int, ...], str] = {}
    for name in (key, *names):
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
    return dict(
        sorted(
            curves.items(),
            key=lambda item: [
                value if isinstance(value, int | float) else math.inf for value in item[0]
            ],
        )
    )


def _crowds(values: list[float]) -> bool:
    """Whether positive numbers are far apart, and half of them crowd in the lowest quarter of a linear axis."""
    low, high = min(values), max(values)
    return 0 < WIDE * low < high and statistics.median_low(set(values)) < (low + high) / 4


def _label(name: str, summary: dict) -> str:
    """What a column is, in words, and its unit, in the scene's units."""
    unit = next((UNITS[part] for part in name.split(".") if part in UNITS), "").format_map(
        summary["units"]
    )
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
