"""Results at a load step and along a line. Pictures of load steps: loops of the forces, energies, contact stresses at
the ends of legs; an animation."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.body.stress import principal, von_mises
from ddmpi.errors import InputError
from ddmpi.mesh.elements import cell_with
from ddmpi.results.fields import coloured, group_of, linear_triangles, skin
from ddmpi.results.frame import (
    ABOVE,
    BESIDE,
    View,
    by_value,
    colours_of,
    draw_colours,
    draw_outline,
    draw_rigid,
    magnify,
    map_of,
    owners,
    surfaces,
)
from ddmpi.results.solids import ZONES, Surface, draw_surfaces, rigid_surfaces, stage
from ddmpi.results.tables import PATH, Columns, Results, drawn_rows, leg_columns
from ddmpi.system.files import writing
from ddmpi.system.numbers import in_words

ROUNDING = 1e-6
"""Resultants below this part of the normal force are none, as of a shaft in its hub."""

LOOPS = 3
"""At most so many contacts, those with the largest forces, have their loop and their stresses drawn."""

FRAMES, SECONDS, SLOWEST, FASTEST = 200, 6.0, 2.0, 20.0
"""An animation has at most so many frames, and takes about so long, within these limits of frames a second."""

CURVES = 8
"""Of more ends of legs than this, so many are drawn, from the first to the last."""

INSIDE, OUTSIDE = -1e-6, -0.05
"""A place is in a cell if no barycentric coordinate is below the first, hardly outside if none is below the second."""

NEWTON = 8
"""Steps to the barycentric coordinates of a place; straight cells need one."""


def step_times(folder: Path) -> list[float]:
    """The ends of the load steps whose fields are in the `folder`; none without [time]."""
    from xml.etree import ElementTree

    return [float(each.attrib["Value"]) for each in ElementTree.parse(folder / "result.xdmf").findall(
        "Domain/Grid/Grid/Time")]


def at_step(results: Results, folder: Path, asked: float | None = None) -> Results:
    """The results of a load step whose fields are in the `folder`: that at the time `asked` for, by default the one
    of the largest load, the last one if there are several.

    The load is the sum of the factors of all histories, without signs, each over its largest one.

    What the summary has of the last step alone is None: strain energies, estimated errors, overlaps between nodes. The
    certificate and what friction dissipates stay those of all steps. Without load steps, or without an answer,
    `results` are as they were read. Not collective. Raises InputError where there are no fields of the time `asked`
    for.
    """
    import h5py

    complete = results.energy and all("gap" in legs for legs in results.legs.values())  # no run of version 0.6 is
    times = np.array(step_times(folder) if complete else [])
    if asked is None:
        if len(times) == 0 or not results.summary["converged"]:
            return results
        loads = np.zeros(len(times))
        for history in results.summary["scene"].get("history", {}).values():
            loads += np.abs(np.interp(times, history["times"], history["factors"])) / (
                np.abs(history["factors"]).max() or 1.0)
        asked = times[loads >= loads.max() - 1e-9][-1]
    there = np.flatnonzero(np.abs(times - asked) <= 1e-9 * abs(asked))
    if len(there) == 0:
        raise InputError(f"{folder}: there are no fields of time {asked:g}; the times that have some: "
                         f"{', '.join(f'{time:g}' for time in times) or 'none'}")
    time = float(times[there[0]])
    with h5py.File(folder / "result.h5", "r") as file:
        if group_of(there[0]) not in file:  # it is the last step
            return replace(results, time=time)
        fields = results.fields | {name: data[()] for name, data in file[group_of(there[0])].items()}
    contacts = {}
    for name, legs in results.legs.items():
        table = results.contacts[name] | {column: legs[column][legs["time"] == time]
                                          for column in leg_columns(results.dimension)}
        area = table["length"] if "length" in table else table["area"]
        contacts[name] = table | {f"{kind}_force": table[f"{kind}_stress"] * area for kind in ("normal", "tangential")}
    entry = next(each for each in results.summary["steps"] if each["time"] == time)
    step, rigid, forces = entry["contacts"], entry.get("rigid", {}), entry.get("bodies", {})
    moved, owner = np.linalg.norm(fields["displacement"], axis=1), owners(results)
    unknown: dict[str, Any] = {"energy": None, "reaction": (None,) * results.dimension, "discretization_error": None,
                               "loads": {}, "reactions": {}}
    bodies = {name: entry | unknown | forces.get(name, {}) | {"displacement_max": float(moved[owner == k].max())} | (
        {"von_mises_max": float(fields["von_mises"][fields["body"] == k].max())} if "von_mises" in fields else {})
        for k, (name, entry) in enumerate(results.summary["bodies"].items())}
    unknown = dict.fromkeys(("pointwise_penetration", "moment_imbalance", "moment_imbalance_bound"))
    summary = results.summary | {
        "displacement_max": float(moved.max()), "bodies": bodies, "rigid": rigid,
        "discretization_error": results.summary["discretization_error"] | {"energy_norm": None},
        "contacts": {name: entry | unknown | step[name] | {"dissipated": entry["dissipated"],
                                                           "pressure_max": float(contacts[name]["normal_stress"].max())}
                     for name, entry in results.summary["contacts"].items()}}
    return replace(results, summary=summary, contacts=contacts, fields=fields, time=time,
                   sides={name: _means(table, contacts[name]) for name, table in results.sides.items()})


def _means(sides: Columns, nodes: Columns) -> Columns:
    """The table of sides with means of the stresses at their three `nodes`, by Simpson's rule."""
    row = {place: k for k, place in enumerate(zip(nodes["x"], nodes["y"], strict=True))}
    middle = np.array([row[place] for place in zip(sides["x"], sides["y"], strict=True)], int)
    after = (middle + 1) % len(row)
    return sides | {column: (nodes[column][middle - 1] + 4 * nodes[column][middle] + nodes[column][after]) / 6
                    for column in ("normal_stress", "tangential_stress")}


def along(results: Results, start: Sequence[float], end: Sequence[float], number: int) -> Columns:
    """The columns PATH at so many places, evenly from `start` to `end` (d,), by shape functions from the nodes.

    A place in no body has no line, unless it is hardly outside, as where a body's curved side is a chord in the mesh;
    one at which bodies touch has a line for each. Places are those before the bodies move. Not collective. Raises
    InputError.
    """
    d, (first, last) = results.dimension, (np.array(each) for each in (start, end))
    if {len(first), len(last)} != {d} or not 0.0 < np.linalg.norm(last - first) < np.inf or number < 2:
        raise InputError(f"a path has two different ends with {d} coordinates each, and 2 points at least")
    length, share = np.linalg.norm(last - first), np.linspace(0.0, 1.0, number)
    places = first + share[:, None] * (last - first)
    place, cell, at = _located(results.points, results.fields["cells"], results.fields["body"], places)
    if len(place) == 0:
        raise InputError(f"the path from {in_words(first)} to {in_words(last)} meets no body")
    nodes = results.fields["cells"][cell]
    shapes = cell_with(d, nodes.shape[1]).shapes(at)

    def there(values: np.ndarray) -> np.ndarray:
        return np.einsum("pk,pkc->pc", shapes, values[nodes])

    axes, found = "xyz"[:d], {"distance": length * share[place]}
    found |= zip(axes, places[place].T, strict=True)
    found["body"] = np.array(list(results.summary["bodies"]))[results.fields["body"][cell]]
    found |= zip((f"displacement_{axis}" for axis in axes), there(results.displacement()).T, strict=True)
    if "nodal_stress" in results.fields:
        sigma = there(results.fields["nodal_stress"])[:, [0, 3, 5, 1, 4, 2][:2 * d]]
        for kind, values in ("stress", sigma), ("principal", principal(sigma)):
            found |= zip((name for name in PATH if name.startswith(kind)), values.T, strict=False)
        found["von_mises"] = von_mises(sigma)
    return found


def _located(points: np.ndarray, cells: np.ndarray, body: np.ndarray, places: np.ndarray,
             ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Which of some `places` lies in which cell, the best of each body (nt,), and its barycentric coordinates there."""
    low, high = (extreme.reduce([points[node] for node in cells.T]) for extreme in (np.minimum, np.maximum))
    low, high = low + OUTSIDE * (high - low), high - OUTSIDE * (high - low)
    near = np.flatnonzero(((low <= places.max(axis=0)) & (high >= places.min(axis=0))).all(axis=1))
    pairs = [near[((low[near] <= each) & (high[near] >= each)).all(axis=1)] for each in places]
    place, cell = np.repeat(np.arange(len(places)), [len(each) for each in pairs]), np.concatenate(pairs)
    kind, nodes = cell_with(points.shape[1], cells.shape[1]), points[cells[cell]]
    at = np.full((len(cell), points.shape[1] + 1), 1.0 / (points.shape[1] + 1))
    for _ in range(NEWTON):
        off = places[place] - np.einsum("pk,pkd->pd", kind.shapes(at), nodes)
        step = np.linalg.solve(np.einsum("apk,pkd->pda", kind.derivatives(at), nodes), off[:, :, None])[:, :, 0]
        inner = np.clip(at[:, 1:] + step, -1.0, 2.0)
        at = np.column_stack([1.0 - inner.sum(axis=1), inner])
    inside = at.min(axis=1)
    kept = inside >= INSIDE
    kept |= (inside >= OUTSIDE) & ~np.isin(place, place[kept])
    order = np.lexsort((-inside, body[cell], place))
    order = order[kept[order]]
    order = order[np.unique(np.column_stack([place, body[cell]])[order], axis=0, return_index=True)[1]]
    return place[order], cell[order], at[order]


def draw_steps(results: Results, title: str) -> Any:
    """Tangential forces over the factor of the history that varies most, energies over time, stresses; a figure.

    Of solids forces along x, y and z and numbers of nodes in the place of stresses, which have no line to be drawn on.

    Energies count from time 0. Friction dissipates one part of the interface work; interference, closing gaps and time
    stepping take the other. Not collective.
    """
    import matplotlib.pyplot as plt

    steps, summary = results.steps, results.summary
    largest = {name: np.abs(steps["normal_force"][steps["contact"] == name]).max(initial=0.0)
               for name in results.contacts}
    bonded = {contact["name"] for contact in summary["scene"]["contact"] if contact.get("kind") == "bonded"}
    loops = [name for name in largest if name not in bonded] or largest
    shown = sorted(loops, key=lambda name: -largest[name])[:LOOPS]
    figure, grid = plt.subplots(len(shown) + 1, 2, figsize=(9.6, 2.9 * (len(shown) + 1)), squeeze=False)
    loop, energies = grid[0]
    label, driver = _driver(summary, results.energy["time"])
    for name in shown:
        own = steps["contact"] == name
        loop.plot(driver, np.append(0.0, steps["tangential_force"][own]), marker=".", label=name)
    loop.set(xlabel=label, ylabel=f"tangential force ({summary['units']['force']})")
    _draw_energies(energies, results.energy, summary["units"]["energy"])
    for axes, name in zip(grid[1:], shown, strict=True):
        (_draw_stresses if results.dimension == 2 else _draw_course)(axes, name, results, summary["units"])
    for axes in (loop, energies):
        axes.axhline(0.0, color="black", linewidth=0.6)
        axes.legend(ncols=2, **ABOVE)
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


def _draw_energies(axes: Any, energy: Columns, unit: str) -> None:
    time = np.append(0.0, energy["time"])
    lost = energy["interface_work"] - energy["dissipated"]
    for name, values in {"external work": energy["external_work"], "strain energy": energy["strain_energy"],
                         "dissipated by friction": energy["dissipated"], "other interface work": lost}.items():
        axes.plot(time, np.append(0.0, values), marker=".", label=name)
    axes.set(xlabel="time", ylabel=f"energy ({unit})")


def _draw_stresses(axes: Any, name: str, results: Results, units: dict) -> None:
    """Normal and tangential stress along a contact at the ends of legs."""
    import matplotlib as mpl

    legs = results.legs[name]
    times = np.unique(legs["time"])
    chosen = times[np.unique(np.linspace(0, len(times) - 1, min(CURVES, len(times))).round().astype(int))]
    colours = mpl.colormaps["viridis"](np.linspace(0.0, 0.9, len(chosen)))
    for kind, axis in zip(("normal", "tangential"), axes, strict=True):
        for time, colour in zip(chosen, colours, strict=True):
            step = {column: values[legs["time"] == time] for column, values in legs.items()}
            step, _ = drawn_rows(step, results.facets[name])
            arc = np.append(0.0, np.cumsum(np.hypot(np.diff(step["x"]), np.diff(step["y"]))))
            axis.plot(arc, step[f"{kind}_stress"], color=colour, linewidth=1.2, label=f"time {time:g}")
        axis.axhline(0.0, color="black", linewidth=0.6)
        axis.set(xlabel=f"along {name} ({units['length']})", ylabel=f"{kind} stress ({units['stress']})")
    axes[1].legend(fontsize=7, **BESIDE)


def _draw_course(axes: Any, name: str, results: Results, units: dict) -> None:
    """Force on the first body along x, y and z, or where there is none its moment, and nodes by status, over time."""
    own = results.steps["contact"] == name
    steps = {column: values[own] for column, values in results.steps.items()}
    time, forces = np.append(0.0, steps["time"]), np.array([steps[f"force_{axis}"] for axis in "xyz"])
    what = "force" if np.abs(forces).max() > ROUNDING * steps["normal_force"].max() else "moment"
    for axis in "xyz":
        axes[0].plot(time, np.append(0.0, steps[f"{what}_{axis}"]), marker=".", label=axis)
    axes[0].axhline(0.0, color="black", linewidth=0.6)
    axes[0].set(xlabel="time", ylabel=f"{what} of {name} ({units[what]})")
    counts = (np.insert(steps[zone], 0, steps[zone][:1]) for zone in ZONES)
    axes[1].stackplot(time, *counts, labels=list(ZONES), colors=list(ZONES.values()))
    axes[1].set(xlabel="time", ylabel=f"nodes of {name}", xlim=(0.0, time[-1]))
    for each in axes:
        each.legend(fontsize=7, **BESIDE)


def animate(results: Results, folder: Path, title: str) -> Path:
    """Write animation.gif: the deformed bodies at the load steps whose fields are in the `folder`; its path.

    Colours are von Mises stress, or displacement if there is no stress. All frames have the same colours, limits and
    magnification: the one that suits the largest displacement of all. Not collective. Raises OutputError.
    """
    import matplotlib.pyplot as plt
    from matplotlib.animation import PillowWriter

    largest = max(np.linalg.norm(fields["displacement"], axis=1).max() for _, fields in _frames(folder))
    factor, shift = magnify(results, largest)
    still, dimension = results.points + shift, results.dimension
    top, number, low, high = 0.0, 0, np.full(dimension, np.inf), np.full(dimension, -np.inf)
    for _, fields in _frames(folder):
        at = still + factor * fields["displacement"][:, :dimension]
        low, high = np.minimum(low, at.min(axis=0)), np.maximum(high, at.max(axis=0))
        values, quantity, unit = coloured(results, fields)
        top, number = max(top, float(np.percentile(values, 99.5))), number + 1
    margin = 0.03 * np.ptp(results.points, axis=0).max()
    figure, axes, draw = (_in_the_plane if dimension == 2 else _in_space)(results, low - margin, high + margin)
    axes.set_title("time")
    image = colours_of(0.0, top or 1.0, "viridis")
    draw_colours(figure, axes, image, f"{quantity} ({unit})", "max")
    figure.suptitle(title.strip())
    path, writer = folder / "animation.gif", PillowWriter(fps=float(np.clip(number / SECONDS, SLOWEST, FASTEST)))
    with writing(path):
        path.unlink(missing_ok=True)  # it may be a link
    with writing(path), writer.saving(figure, path, dpi=80):
        for time, fields in _frames(folder):
            for artist in (*axes.collections, *axes.lines, *axes.images):
                artist.remove()
            at = still + factor * fields["displacement"][:, :dimension]
            draw(at, coloured(results, fields)[0], image, factor, time)
            axes.set_title(f"time {time:.4g}, displacement × {factor:g}")
            figure.canvas.draw()
            figure.set_layout_engine("none")  # as the first frame has it
            writer.grab_frame()
    plt.close(figure)
    return path


def _in_the_plane(results: Results, low: np.ndarray, high: np.ndarray) -> tuple[Any, Any, Callable[..., None]]:
    """A figure and axes from the corner `low` (2,) to `high`, and what draws bodies into them: their nodes (nv, 2),
    values (nv,), what colours these, the magnification, and the time."""
    figure, axes = map_of(results, np.vstack([low, high]))
    axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    cells = linear_triangles(results.fields["cells"])[0]

    def draw(at: np.ndarray, values: np.ndarray, image: Any, factor: float, time: float) -> None:
        axes.tripcolor(*at.T, cells, values, shading="gouraud", norm=image.norm, cmap=image.cmap)
        draw_outline(axes, at, cells)
        draw_rigid(axes, surfaces(results, factor, time), float(np.ptp(results.points, axis=0).max()))

    return figure, axes, draw


def _in_space(results: Results, low: np.ndarray, high: np.ndarray) -> tuple[Any, Any, Callable[..., None]]:
    """The same for the box from `low` (3,) to `high`."""
    view, facets = View(high - low), skin(results.fields["cells"])[0]
    figure, axes = stage(results, np.array(list(itertools.product(*zip(low, high, strict=True)))), view)

    def draw(at: np.ndarray, values: np.ndarray, image: Any, factor: float, time: float) -> None:
        draw_surfaces(axes, view, [*rigid_surfaces(results, factor, time),
                                   Surface(at, facets, by_value(values[facets], image))])

    return figure, axes, draw


def _frames(folder: Path) -> Iterator[tuple[float, dict[str, np.ndarray]]]:
    """Time, and the fields that differ from step to step, of what an animation shows of the series result.xdmf."""
    import h5py

    times = step_times(folder)
    with h5py.File(folder / "result.h5", "r") as file:
        for k in np.unique(np.linspace(0, len(times) - 1, min(FRAMES, len(times))).round().astype(int)):
            fields = file.get(group_of(k), file)
            yield times[k], {name: fields[name][()] for name in ("displacement", "von_mises") if name in fields}
