"""Curves: stresses, gap and slip along contacts in the plane, iterations, and load steps."""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import matplotlib.pyplot as plt
import msgspec
import numpy as np
from matplotlib.ticker import LogFormatter

from ddmpi.interface.law import law_of
from ddmpi.pictures.sheet import BESIDE, COLOURS, RESOLVED, ZONES, above, zone_legend
from ddmpi.results.histories import evenly
from ddmpi.results.summary import drawn_times
from ddmpi.results.tables import Columns, Results, chains, drawn_rows
from ddmpi.scene.contacts import Friction
from ddmpi.scene.method import method_of
from ddmpi.system.numbers import counted, scaled_unit

MARKED = 100  # curves of at most this many nodes have a marker at each
SHADE = 0.35  # opacity of zones behind curves
LOOPS = 3  # largest number of contacts, those with the largest forces, with loops and stresses in pictures
ALIKE = 0.01
"""Forces of two contacts that differ by less than this, over the largest, are drawn as one."""

CURVES = 8  # largest number of ends of legs in a picture, from the first to the last


def draw_contact(results: Results, name: str) -> Any:
    """Stresses, gap and slip along the contact `name`, with its zones shaded; a figure.

    With quadratic elements the curves of the stresses are means over sides, and dots are the nodes' stresses.
    """
    nodes, facets = drawn_rows(results.contacts[name], results.facets[name])
    breaks = np.array([chain[0] for chain in chains(facets)[1:]], int)
    scene = results.scene
    contact = next(contact for contact in scene["contact"] if contact["name"] == name)
    frictional = contact["friction"]["law"] != "none"
    position, along = _position(nodes)
    figure, (stresses, motion) = plt.subplots(
        2, 1, sharex=True, figsize=(8.6, 6.0), gridspec_kw={"height_ratios": (3, 2)}
    )
    unit = _draw_along(stresses, results, contact, nodes, breaks)
    stresses.set_ylabel(f"contact stress ({unit})")
    of_one = f" of {name}" if len(results.contacts) > 1 else ""
    stresses.set_title(f"{results.heading(True)}contact stresses{of_one}")

    length = results.units["length"]
    shown = ["gap", "slip"] if frictional else ["gap"]
    largest = max(np.abs(nodes["gap"]).max(), np.abs(nodes["slip"]).max())
    visible = RESOLVED * results.summary["displacement_max"]
    factor, unit = scaled_unit(max(largest, visible), length)
    if 0 < largest < visible:  # rounding, not motion
        motion.set_ylim(-visible / factor, visible / factor)
    for what, kind in zip(shown, ("normal", "tangential"), strict=False):
        values = nodes[what] / factor
        _curve(motion, position, values, breaks, color=COLOURS[kind], label=what)
    motion.set(xlabel=f"{along} ({length})", ylabel=f"{', '.join(shown)} ({unit})")

    for axes in (stresses, motion):
        axes.axhline(0.0, color="black", linewidth=0.6)
        _shade(axes, position, nodes["status"], breaks)
    handles, counts = stresses.get_legend_handles_labels()[0], results.summary["contacts"][name]
    handles += zone_legend(counts, alpha=SHADE)
    stresses.legend(handles=handles, **BESIDE)
    motion.legend(**BESIDE)
    return figure


def _draw_along(
    axes: Any, results: Results, contact: dict, nodes: Columns, breaks: np.ndarray
) -> str:
    """Draw the stresses along a contact, tangential ones where it carries shear, and the slip bound; their unit."""
    sides, (position, _) = results.sides.get(contact["name"]), _position(nodes)
    shown, place, apart, extent = nodes, position, breaks, ""
    if sides:
        rows = _rows_of_sides(nodes, sides)
        piece = np.searchsorted(breaks, rows, "right")
        apart = 1 + np.flatnonzero((np.diff(rows) != 2) | np.diff(piece).astype(bool))
        shown, place, extent = sides, position[rows], ",\nmean over sides"
    factor, unit = scaled_unit(np.abs(nodes["normal_stress"]).max(), results.units["stress"])
    labels = {"normal": "normal (pressure)"}
    if contact["friction"]["law"] != "none" or contact.get("kind") == "bonded":
        labels["tangential"] = "tangential"
    for kind, label in labels.items():
        colour = COLOURS[kind]
        if sides:
            of_nodes = nodes[f"{kind}_stress"] / factor
            axes.plot(position, of_nodes, ".", markersize=4, alpha=0.6, color=colour)
        values = shown[f"{kind}_stress"] / factor
        _curve(axes, place, values, apart, color=colour, label=label + extent)
    bound = _slip_bound(shown, contact["friction"])
    style = {"marker": "", "color": COLOURS["bound"], "linestyle": "--", "linewidth": 1}
    if bound is not None:
        for sign, label in ((1, "± slip bound"), (-1, "")):
            _curve(axes, place, sign * bound / factor, apart, **style, label=label)
    return unit


def _rows_of_sides(nodes: Columns, sides: Columns) -> np.ndarray:
    """The rows of the middles of quadratic sides, which are nodes."""
    at = {point: k for k, point in enumerate(zip(nodes["x"], nodes["y"], strict=True))}
    return np.array([at[point] for point in zip(sides["x"], sides["y"], strict=True)])


def draw_convergence(results: Results) -> Any:
    """Update and residual over the outer iterations, load step after load step; a figure."""
    history, summary = results.history, results.summary
    figure, axes = plt.subplots(figsize=(7.2, 4.4))
    k = np.arange(1.0, len(history["iteration"]) + 1)
    starts = 1 + np.flatnonzero(np.diff(history["step"]))
    x, what = method_of(summary["outer"]).curves
    curves = {
        "update": ("normal", "o", f"update  ‖{x}ₖ − {x}ₖ₋₁‖ / ‖{x}ₖ‖"),
        "residual": ("tangential", "s", f"residual: {what}"),
    }
    for column, (colour, marker, label) in curves.items():
        positive = np.where(history[column] > 0, history[column], np.nan)
        axes.semilogy(
            *(np.insert(values, starts, np.nan) for values in (k, positive)),
            color=COLOURS[colour],
            marker=marker,
            markersize=3,
            label=label,
        )
    tolerance = results.scene["method"]["tolerance"]
    axes.axhline(
        tolerance,
        color=COLOURS["bound"],
        linestyle="--",
        linewidth=1,
        label=f"tolerance {tolerance:g}",
    )
    axes.grid(True, which="major", color="#e3e3e3")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.yaxis.set_major_formatter(
        lambda value, _: f"{value:.0e}".replace("e-0", "e-").replace("e+00", "")
    )
    axes.set(xlabel="outer iteration k", ylabel="relative change (–)")
    axes.yaxis.set_minor_formatter(LogFormatter())
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    axes.set_title(
        f"{results.heading()}{counted(summary['outer_iterations'], 'outer iteration')}, n_A = {summary['n_A']}, "
        f"{summary['reason']}",
        wrap=True,
    )
    return figure


def _position(nodes: Columns) -> tuple[np.ndarray, str]:
    """The coordinate (m,) over which a contact is drawn, and its name: x or y of a straight one, else arc length."""
    x, y, arc = nodes["x"], nodes["y"], _arc(nodes)
    for axis, other, name in ((x, y, "x"), (y, x, "y")):
        if np.ptp(other) <= 1e-9 * arc[-1]:
            return axis, name
    return arc, "arc length along the contact"


def _arc(nodes: Columns) -> np.ndarray:
    """The arc length (m,) from the first node."""
    return np.append(0.0, np.cumsum(np.hypot(np.diff(nodes["x"]), np.diff(nodes["y"]))))


def _curve(axes: Any, x: np.ndarray, y: np.ndarray, breaks: np.ndarray, **style: Any) -> None:
    """Draw a curve that is not joined to the points at `breaks`; long curves mark lone points only."""
    lone = np.isin(np.arange(len(x)), [0, *breaks]) & np.isin(
        np.arange(1, len(x) + 1), [*breaks, len(x)]
    )
    marked = np.insert(lone | (len(x) <= MARKED), breaks, False)
    axes.plot(
        *(np.insert(values, breaks, np.nan) for values in (x, y)),
        **{"marker": "o" if marked.any() else "", "markersize": 2.5, "markevery": marked.tolist()}
        | style,
    )


def _shade(axes: Any, position: np.ndarray, statuses: np.ndarray, breaks: np.ndarray) -> None:
    """Shade the zones of equal status; two zones meet halfway between their nodes, and none crosses the `breaks`."""
    for x, status in zip(np.split(position, breaks), np.split(statuses, breaks), strict=True):
        edges = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
        first = np.flatnonzero(np.concatenate([[True], status[1:] != status[:-1]]))
        for a, b in zip(first, [*first[1:], len(x)], strict=True):
            axes.axvspan(
                edges[a], edges[b], color=ZONES[status[a]], alpha=SHADE, linewidth=0, zorder=0
            )
    if len(position) > 1:
        axes.set_xlim(position.min(), position.max())


def _slip_bound(table: Columns, friction: dict) -> np.ndarray | None:
    """The bound on the tangential stress at nodes or sides, if numbers set it and it is worth drawing."""
    if friction["law"] == "none" or any(isinstance(value, dict) for value in friction.values()):
        return None
    one, xy = np.ones(len(table["x"])), np.column_stack([table["x"], table["y"]])
    law = law_of(msgspec.convert(friction, Friction), xy, one, one, np.arange(len(one)))
    bound = law.slip_bound(table["normal_stress"])
    return (
        bound
        if law.largest_slope or bound.max() <= 3 * np.abs(table["tangential_stress"]).max()
        else None
    )


def draw_steps(results: Results) -> Any:
    """Tangential forces over the factor of the history that varies most, energies over time, stresses; a figure.

    Of solids forces along x, y and z and numbers of nodes in the place of stresses, which have no line to be drawn on;
    moments where there are no forces, as of a shaft in its hub.

    Energies count from time 0. Friction dissipates one part of the interface work; interference, closing gaps and time
    stepping take the other. Not collective.
    """
    of = results.steps["contact"]
    steps = {
        name: {column: values[of == name] for column, values in results.steps.items()}
        for name in results.contacts
    }
    largest = {
        name: np.abs(table["normal_force"]).max(initial=0.0) for name, table in steps.items()
    }
    tied = {
        contact["name"]
        for contact in results.scene["contact"]
        if contact.get("kind") in ("bonded", "guided")
    }
    loops = [name for name in largest if name not in tied] or largest
    names = _without_doubles(
        {name: steps[name] for name in sorted(loops, key=lambda name: -largest[name])}
    )
    shown = list(names)[:LOOPS]
    beside = _drawn_beside(shown, steps, results)
    rows = len(beside) + 1
    figure, grid = plt.subplots(rows, 2, figsize=(9.6, 2.9 * rows), squeeze=False)
    loop, energies = grid[0]
    words: dict[str, None] = {}
    label, driver = _driver(results)
    for name in shown:
        what, column, of_one = _resultant(steps[name]), "tangential_force", names[name]
        if what == "moment":
            column = max(
                (component for component in steps[name] if component.startswith("moment")),
                key=lambda component: np.ptp(steps[name][component]),
            )
            of_one = f"{names[name]}, {column.replace('_', ' ')}"
        loop.plot(driver, np.append(0.0, steps[name][column]), marker=".", label=of_one)
        words[f"{'tangential ' * (what == 'force')}{what} ({results.units[what]})"] = None
    loop.set(xlabel=label, ylabel=", ".join(words))
    _draw_energies(energies, results.energy, results.units["energy"])
    for axes, (name, draw) in zip(grid[1:], beside.items(), strict=True):
        draw(axes)
        if names[name] != name:  # several, longer than an axis is high
            axes[0].set_title(names[name], fontsize=8, loc="left")
    for axes in (loop, energies):
        axes.axhline(0.0, color="black", linewidth=0.6)
        above(axes, axes.get_legend_handles_labels()[0], 2)
    figure.suptitle(f"{results.heading()}{len(results.energy['time'])} load steps")
    return figure


def _drawn_beside(
    contacts: Sequence[str], steps: Mapping[str, Columns], results: Results
) -> dict[str, Callable[[Any], None]]:
    """What draws the courses of contacts, in the plane the stresses: at the ends of legs, of which there is none where
    the first one fails."""
    if results.dimension == 2:
        return {
            name: partial(_draw_stresses, name=name, results=results)
            for name in contacts
            if len(results.legs[name]["time"])
        }
    return {
        name: partial(_draw_course, name=name, steps=steps[name], units=results.units)
        for name in contacts
    }


def _without_doubles(steps: Mapping[str, Columns]) -> dict[str, str]:
    """Those of the contacts whose forces need curves of their own, each with all that have the same, in words. In space
    contacts in a row, as of a bolt and its washer, have the same forces; in the plane their stresses differ."""
    found, words = dict[str, np.ndarray](), dict[str, list[str]]()
    for name, table in steps.items():
        curves = np.abs([values for column, values in table.items() if column.startswith("force_")])
        same = next(
            (
                other
                for other, of in found.items()
                if "force_z" in table and np.abs(curves - of).max() <= ALIKE * of.max()
            ),
            name,
        )
        found.setdefault(same, curves)
        words.setdefault(same, []).append(name)
    return {name: ", ".join(alike) for name, alike in words.items()}


def _driver(results: Results) -> tuple[str, np.ndarray]:
    """The factor, at time 0 and at all load steps, of the history that varies most after it first rests or turns, or of
    the only history; else time itself."""
    best: tuple[float, str, np.ndarray] | None = None
    points = np.append(0.0, results.energy["time"])
    for name, history in results.scene["history"].items():
        factors = np.interp(
            drawn_times(results.summary, points), history["times"], history["factors"]
        )
        turns = float(np.abs(np.diff(factors)).sum() - abs(factors[-1] - factors[0]))
        if best is None or turns > best[0]:
            best = turns, f"factor of history {name}", factors
    return (best[1], best[2]) if best and best[0] > 0.0 else ("time", points)


def _draw_energies(axes: Any, energy: Columns, unit: str) -> None:
    time = np.append(0.0, energy["time"])
    lost = energy["interface_work"] - energy["dissipated"]
    for name, values in {
        "external work": energy["external_work"],
        "strain energy": energy["strain_energy"],
        "dissipated by friction": energy["dissipated"],
        "other interface work": lost,
    }.items():
        axes.plot(time, np.append(0.0, values), marker=".", label=name)
    axes.set(xlabel="time", ylabel=f"energy ({unit})")


def _draw_stresses(axes: Any, name: str, results: Results) -> None:
    """Normal and tangential stress along a contact at the ends of legs."""
    legs, units = results.legs[name], results.units
    times = np.unique(legs["time"])
    chosen = times[evenly(len(times), CURVES)]
    colours = plt.get_cmap("viridis")(np.linspace(0.0, 0.9, len(chosen)))
    for kind, axis in zip(("normal", "tangential"), axes, strict=True):
        factor, unit = scaled_unit(np.abs(legs[f"{kind}_stress"]).max(), units["stress"])
        for time, colour in zip(chosen, colours, strict=True):
            step = {column: values[legs["time"] == time] for column, values in legs.items()}
            if not results.frames:  # rows of bodies that move far differ from step to step
                step, _ = drawn_rows(step, results.facets[name])
            axis.plot(
                _arc(step),
                step[f"{kind}_stress"] / factor,
                color=colour,
                linewidth=1.2,
                label=f"time {time:g}",
            )
        axis.axhline(0.0, color="black", linewidth=0.6)
        axis.set(xlabel=f"along {name} ({units['length']})", ylabel=f"{kind} stress ({unit})")
    axes[1].legend(fontsize=7, **BESIDE)


def _resultant(steps: Columns) -> str:
    """The resultant of a contact in pictures: force, or the moment where there is no force, as of a shaft in its hub."""
    forces = [
        np.abs(values).max() for column, values in steps.items() if column.startswith("force_")
    ]
    return "moment" if max(forces) <= RESOLVED * steps["normal_force"].max() else "force"


def _draw_course(axes: Any, name: str, steps: Columns, units: dict) -> None:
    """Force on the first body along x, y and z, or its moment without a force, and nodes by status, over time."""
    time = np.append(0.0, steps["time"])
    what = _resultant(steps)
    for axis in "xyz":
        axes[0].plot(time, np.append(0.0, steps[f"{what}_{axis}"]), marker=".", label=axis)
    axes[0].axhline(0.0, color="black", linewidth=0.6)
    axes[0].set(xlabel="time", ylabel=f"{what} of {name} ({units[what]})")
    counts = (np.insert(steps[zone], 0, steps[zone][:1]) for zone in ZONES)
    axes[1].stackplot(time, *counts, labels=list(ZONES), colors=list(ZONES.values()), alpha=SHADE)
    axes[1].set(xlabel="time", ylabel=f"nodes of {name}", xlim=(0.0, time[-1]))
    for ax in axes:
        ax.legend(fontsize=7, **BESIDE)
