"""Errors over the processor seconds that they have taken: the meshes of a run, the forecast of half the bars, targets."""

from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.ticker import NullFormatter

from ddmpi.pictures.sheet import COLOURS
from ddmpi.results.summary import quantity_of
from ddmpi.results.tables import Results
from ddmpi.scene.results import with_letters

MOST = 7
"""Most results in the picture, those with targets and with the largest bars over their values."""


def has_levels(summary: dict) -> bool:
    """Whether there is a bar to draw."""
    return any(entry["bar"] and entry["value"] for entry in summary.get("errors", {}).values())


def draw_levels(results: Results) -> Any:
    """Bars over values of each mesh over processor seconds from the first mesh on, and the error in the energy norm; of a
    single result also its value with the bar; a figure."""
    summary = results.summary
    levels, errors = summary["discretization_error"]["levels"], summary["errors"]
    told = {name: entry for name, entry in errors.items() if entry["bar"] and entry["value"]}
    asked = {with_letters(result) for result in results.scene["method"].get("target", {})}
    sizes = {name: entry["bar"] / abs(entry["value"]) for name, entry in told.items()}
    names = sorted(told, key=lambda name: (name not in asked, -sizes[name]))[:MOST]
    seconds = np.cumsum([level["seconds"] for level in levels])
    alone = len(errors) == 1
    figure, rows = plt.subplots(
        1 + alone, 1, sharex=True, squeeze=False, figsize=(7.6, 4.6 + 2.2 * alone)
    )
    axes = rows[-1, 0]
    norms = np.array([level["error"] for level in levels], float)
    axes.plot(seconds, norms, ".-", color=COLOURS["bound"], label="energy norm")
    for number, name in enumerate(names):
        _draw_result(axes, summary, name, seconds, f"C{number}")
    for at, level in zip(seconds, levels, strict=True):
        place = {"xy": (at, 0.02), "xycoords": axes.get_xaxis_transform(), "xytext": (3, 0)}
        style = {"textcoords": "offset points", "rotation": 90, "fontsize": 7}
        axes.annotate(f"{level['n']:,} unknowns", **place, **style)
    axes.set(yscale="log", xlabel="processor seconds", ylabel="bar over value (–)")
    axes.set_xlim(left=0.0)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(NullFormatter())
    axes.grid(True, which="major", color="#e3e3e3")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.16), ncols=2, fontsize=8)
    if alone and names:
        _draw_value(rows[0, 0], summary, names[0], seconds)
    figure.suptitle(
        f"{results.heading()}errors by the mesh; open: forecast of half the bar, dashed: asked for"
    )
    return figure


def _draw_result(axes: Any, summary: dict, name: str, seconds: np.ndarray, colour: str) -> None:
    """Draw the bars of a result, its forecast and its target."""
    entry, levels = summary["errors"][name], summary["discretization_error"]["levels"]
    bars = [
        (level["results"][name]["bar"] or np.nan) / abs(level["results"][name]["value"] or np.nan)
        for level in levels
    ]
    axes.plot(seconds, bars, "o-", color=colour, label=name)
    if half := entry["half"]:
        ahead = [seconds[-1], half["seconds"]], [bars[-1], 0.5 * bars[-1]]
        axes.plot(*ahead, "o:", color=colour, fillstyle="none")
    targets = summary["scene"]["method"].get("target", {})
    for result, target in targets.items():
        if with_letters(result) == name:
            most = target["within"] / abs(entry["value"]) if isinstance(target, dict) else target
            axes.axhline(most, color=colour, linestyle="--", linewidth=1)


def _draw_value(axes: Any, summary: dict, name: str, seconds: np.ndarray) -> None:
    """Draw the value of a result on each mesh with its bar."""
    told = [level["results"][name] for level in summary["discretization_error"]["levels"]]
    values, bars = (np.array([entry[key] for entry in told], float) for key in ("value", "bar"))
    axes.errorbar(seconds, values, bars, fmt="o", capsize=4, color=COLOURS["normal"])
    axes.set(ylabel=f"{name} ({summary['units'][quantity_of(name)]})")
