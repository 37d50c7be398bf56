"""The picture of load steps: loops of the forces, energies, and contact stresses at the ends of legs."""

from __future__ import annotations

from typing import Any

import numpy as np

from ddmpi.results.tables import Columns, Results

LOOPS = 3
"""At most so many contacts, those with the largest forces, have their loop and their stresses drawn."""

CURVES = 8
"""Of more ends of legs than this, so many are drawn, from the first to the last."""


def draw_steps(results: Results, title: str) -> Any:
    """Tangential forces over the factor of the history that varies most, energies over time, stresses; a figure.

    The solid curves of energies are states and sums since time 0; what friction dissipates and what time stepping and
    closing gaps take besides are parts of the interface work. Not collective.
    """
    import matplotlib.pyplot as plt

    steps, summary = results.steps, results.summary
    largest = {name: np.abs(steps["normal_force"][steps["contact"] == name]).max(initial=0.0)
               for name in results.contacts}
    shown = sorted(largest, key=lambda name: -largest[name])[:LOOPS]
    figure, grid = plt.subplots(len(shown) + 1, 2, figsize=(9.6, 2.9 * (len(shown) + 1)), squeeze=False)
    loop, energies = grid[0]
    label, driver = _driver(summary, results.energy["time"])
    for name in shown:
        own = steps["contact"] == name
        loop.plot(driver, np.append(0.0, steps["tangential_force"][own]), marker=".", label=name)
    unit = summary["units"]["force"]
    loop.set(xlabel=label, ylabel=f"tangential force ({unit})", title="loops")
    _draw_energies(energies, results.energy, unit, summary["units"]["length"])
    for axes, name in zip(grid[1:], shown, strict=True):
        _draw_stresses(axes, name, results.legs[name], summary["units"])
    for axes in (loop, energies):
        axes.axhline(0.0, color="black", linewidth=0.6)
        axes.legend(fontsize=8)
    figure.suptitle(f"{title}{len(results.energy['time'])} load steps")
    return figure


def _driver(summary: dict, times: np.ndarray) -> tuple[str, np.ndarray]:
    """The factor, at time 0 and at all `times`, of the history that goes the longest way after it first rests or turns;
    of the only one, if there is one; or time itself."""
    best: tuple[float, str, np.ndarray] | None = None
    points = np.concatenate([[0.0], times])
    for name, history in summary["scene"]["history"].items():
        factors = np.interp(points, history["times"], history["factors"])
        turns = float(np.abs(np.diff(factors)).sum() - abs(factors[-1] - factors[0]))
        if best is None or turns > best[0]:
            best = turns, f"factor of history {name}", factors
    return (best[1], best[2]) if best and best[0] > 0.0 else ("time", points)


def _draw_energies(axes: Any, energy: Columns, force: str, length: str) -> None:
    time = np.append(0.0, energy["time"])
    lost = energy["interface_work"] - energy["dissipated"]
    for name, values in {"external work": energy["external_work"], "strain energy": energy["strain_energy"],
                         "dissipated by friction": energy["dissipated"], "other interface work": lost}.items():
        axes.plot(time, np.append(0.0, values), marker=".", label=name)
    axes.set(xlabel="time", ylabel=f"energy ({force}·{length})", title="energies")


def _draw_stresses(axes: Any, name: str, legs: Columns, units: dict) -> None:
    """Normal and tangential stress along a contact at the ends of legs."""
    import matplotlib as mpl

    times = np.unique(legs["time"])
    chosen = times[np.unique(np.linspace(0, len(times) - 1, min(CURVES, len(times))).round().astype(int))]
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.9, len(chosen)))
    for kind, axis in zip(("normal", "tangential"), axes, strict=True):
        for time, colour in zip(chosen, colours, strict=True):
            own = legs["time"] == time
            arc = np.append(0.0, np.cumsum(np.hypot(np.diff(legs["x"][own]), np.diff(legs["y"][own]))))
            axis.plot(arc, legs[f"{kind}_stress"][own], color=colour, linewidth=1.2, label=f"time {time:g}")
        axis.axhline(0.0, color="black", linewidth=0.6)
        axis.set(xlabel=f"along {name} ({units['length']})", ylabel=f"{kind} stress ({units['stress']})")
    axes[1].legend(fontsize=7)
