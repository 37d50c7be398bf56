"""Pictures of a run, drawn from its files only."""

from __future__ import annotations

import functools
import itertools
import json
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ddmpi.errors import InputError
from ddmpi.interface.law import law_of
from ddmpi.results import solids
from ddmpi.results.fields import areas_at_nodes, both_halves, coloured, linear_triangles, middles
from ddmpi.results.frame import (
    ABOVE,
    AT_REST,
    BESIDE,
    COLOURS,
    FILLED,
    MOVED,
    RESOLVED,
    STYLE,
    TURNED_BY,
    WEAK,
    draw_colours,
    draw_outline,
    fill,
    is_wide,
    magnify,
    map_of,
    owners,
    rounded,
    start_drawing,
    surfaces,
    write_names,
)
from ddmpi.results.histories import animate, at_step, draw_steps
from ddmpi.results.tables import Columns, Results, chains, drawn_rows, read_results, reading, velocities_in
from ddmpi.scene.contacts import Friction
from ddmpi.scene.method import METHODS
from ddmpi.system.files import MECHANISM, contact_files, writing
from ddmpi.system.numbers import scaled_unit
from ddmpi.system.provenance import identity

ZONES = {"open": "#e4e7ec", "slip": "#fbe3cf", "stick": "#d3e6d3"}

LINES = {"open": "#9aa0a8", "slip": "#e08a3c", "stick": "#4d9a4d"}
"""Zones drawn as lines."""

EACH = 6
"""Of at most so many contacts each has a picture of its own; of more, all share one only."""

WIDEST = 0.3
"""Half a resultant is drawn as at most this part of a body's size, the root of its area, pressures as 0.8 of it."""

MARKED = 100
"""Curves of at most this many nodes have a marker at each."""


def draw_all(folder: str | Path, number: int = 0, drawers: int = 1, time: float | None = None,
             into: Path | None = None) -> list[Path]:
    """Draw all pictures of the results in `folder` into it, or this one's share if several `drawers` do; their paths.

    Those of bodies and contacts are of the load step at `time`, by default as `at_step` chooses it. `into` another
    folder go pictures without the animation.

    bodies.png, contact.png (of several contacts contacts.png, and contact_NAME.png of each if there are not more than
    EACH), convergence.png, steps.png if there are load steps, animation.gif if the scene wants it, and error.png if the
    results have the estimated error. Without equilibrium mechanism.png alone, unless a `time` is given.
    Not collective. Raises InputError without results or matplotlib, or where results of an earlier version lack what
    pictures need; OutputError if a picture cannot be written.
    """
    with reading(folder):
        plt = start_drawing()
        folder, last, drawn = Path(folder), read_results(folder), []
        if last.facets.keys() != last.contacts.keys():
            version = last.summary.get("versions", {}).get("ddmpi", "of unknown number")
            raise InputError(f"{folder}: ddmpi {version} wrote these results without what this version draws pictures "
                             "from; draw them with that version, or run the scene again")
        results = at_step(last, folder, time)
        with plt.rc_context(STYLE):
            figures = _figures(results, last, None if time is not None else folder / MECHANISM)
            for name, draw in itertools.islice(figures, number, None, drawers):
                figure = draw()
                drawn.append((into or folder) / name)
                try:
                    with writing(drawn[-1]):
                        drawn[-1].unlink(missing_ok=True)  # it may be a link
                        figure.savefig(drawn[-1], metadata=identity(results.summary))
                finally:
                    plt.close(figure)
            animated = not into and number == drawers - 1 and results.summary["scene"]["output"].get("animation")
            if animated and len(results.energy.get("time", ())):
                drawn.append(animate(results, folder, results.heading()))
        return drawn


def _figures(results: Results, last: Results, mechanism: Path | None = None) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Each picture's file name and what draws its figure, the longest work first; errors are of the `last` step.

    Where there is the file of a `mechanism`, it is the only picture.
    """
    mechanisms, bodies, contacts, contact, error = (draw_mechanism, draw_bodies, draw_contacts, draw_contact,
                                                    draw_error) if results.dimension == 2 else solids.DRAWN
    if mechanism and mechanism.exists():
        yield "mechanism.png", lambda: mechanisms(last, json.loads(mechanism.read_text(encoding="utf-8")))
        return
    yield "bodies.png", lambda: bodies(results)
    yield "convergence.png", lambda: draw_convergence(results)
    several = len(results.contacts) > 1
    if several:
        yield "contacts.png", lambda: contacts(results)
    for name in results.contacts if len(results.contacts) <= EACH else ():
        yield contact_files(name).picture if several else "contact.png", functools.partial(contact, results, name)
    if len(results.energy.get("time", ())):
        yield "steps.png", lambda: draw_steps(results, results.heading())
    if "error" in results.fields:
        yield "error.png", lambda: error(last)


def draw_bodies(results: Results) -> Any:
    """The deformed bodies, coloured by von Mises stress, or by displacement if there is no stress; a figure."""
    fields, length_unit = results.fields, results.summary["units"]["length"]
    (scale, shift), u, cells = magnify(results), fields["displacement"][:, :2], linear_triangles(fields["cells"])[0]
    points, moved = fields["points"][:, :2] + shift, np.linalg.norm(u, axis=1)
    values, quantity, unit = coloured(results, fields)
    low, top = ((0.0, np.percentile(values, 99.5))  # stresses are singular in corners, which must not set the scale
                if "von_mises" in fields else (values.min(), values.max()))
    factor, unit = scaled_unit(values.max(), unit)
    at, rigid = points + scale * u, list(surfaces(results, scale))
    if results.summary["scene"]["output"].get("mirrored"):
        cells, values, at, points = both_halves(cells, values, at, points)
        rigid += [(line * (-1.0, 1.0), normal * (-1.0, 1.0)) for line, normal in rigid]
    figure, axes = map_of(results, at, rigid)
    draw_outline(axes, at, cells)
    draw_outline(axes, points, cells, color=COLOURS["still"], linewidth=0.7, zorder=1)
    image = axes.tripcolor(*at.T, cells, values / factor, shading="gouraud", cmap="viridis",
                           vmin=low / factor, vmax=top / factor or 1.0, rasterized=True, zorder=2)
    draw_colours(figure, axes, image, f"{quantity} ({unit})", "max" if values.max() > top else "neither")
    factor, unit = scaled_unit(moved.max(), length_unit)
    figure.suptitle(f"{results.heading(True)}displacement × {scale:g}, largest {rounded(moved.max() / factor)} {unit}")
    return figure


def draw_mechanism(results: Results, mechanism: dict[str, Any]) -> Any:
    """The bodies as they stand, and as the `mechanism`, the content of mechanism.json, would move them; a figure."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    points, names = results.fields["points"][:, :2], list(results.summary["bodies"])
    (cells, part), owner = linear_triangles(results.fields["cells"]), owners(results)
    centres = np.array(middles(points, cells, owner))
    velocities, going = velocities_in(mechanism, names, centres)
    turned = (points - centres[owner])[:, ::-1] * (-1.0, 1.0)
    u = velocities[owner, :2] + velocities[owner, 2:] * turned
    speed = np.linalg.norm(u, axis=1)
    turning, fastest = np.abs(velocities[:, 2]).max(), max([speed.max(), *map(np.linalg.norm, going.values())])
    step = min(MOVED * np.ptp(points, axis=0).max() / fastest, TURNED_BY / max(turning, 1e-300))
    moves = np.bincount(owner, speed > AT_REST * fastest) > 0
    own = cells[moves[results.fields["body"][part]]]
    rigid = [*surfaces(results), *surfaces(results, step, going=going)]
    figure, axes = map_of(results, np.vstack([points, points + step * u]), rigid)
    for at, some, kind in ((points, cells, "still"), (points + step * u, own, "moved"))[:2 if len(own) else 1]:
        fill(axes, at, some, FILLED[kind])
        draw_outline(axes, at, some, color=COLOURS[kind], linewidth=0.9)
    arrows = step * velocities[:, :2]
    axes.quiver(*centres[moves].T, *arrows[moves].T, angles="xy", scale_units="xy", scale=1.0, width=0.004, zorder=5,
                color=COLOURS["force"])
    write_names(axes, names, centres + np.where(moves[:, None], arrows, 0.0), below=True)
    legend: list[Any] = [Patch(facecolor=FILLED[kind], edgecolor=COLOURS[kind], label=words) for kind, words in (
        ("still", "as the bodies stand"), ("moved", "as they would move, not to scale"))]
    if rigid:
        legend.append(Line2D([], [], color=COLOURS["rigid"], linewidth=1.4, label="rigid"))
    axes.legend(handles=legend, ncols=3, **ABOVE)
    figure.suptitle(results.heading() + "\n".join(textwrap.wrap(mechanism["reason"], int(11 * figure.get_figwidth())))
                    .replace("$", r"\$"))
    return figure


def draw_contacts(results: Results) -> Any:
    """All contacts where the bodies stand: their zones as lines, pressures as areas on them, resultants; a figure.

    A pressure is drawn into the contact's first body, tension into the second. A resultant is drawn along its line of
    action, its middle at the contact, unless it passes the contact by.
    """
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    points, units = results.fields["points"][:, :2], results.summary["units"]
    cells, owner = linear_triangles(results.fields["cells"])[0], owners(results)
    figure, axes = map_of(results, points, surfaces(results))
    fill(axes, points, cells, FILLED["still"])
    draw_outline(axes, points, cells)
    bodies = results.summary["bodies"]
    area = np.bincount(owner, areas_at_nodes(points, cells), len(bodies))
    size = WIDEST * float(np.median(np.sqrt(area)))
    entries = [(*drawn_rows(table, results.facets[name]), results.summary["contacts"][name])
               for name, table in results.contacts.items()]
    top = max(np.abs(table["normal_stress"]).max() for table, *_ in entries)
    kind = "normal stress" if any((table["normal_stress"] < 0.0).any() for table, *_ in entries) else "pressure"
    largest = max(float(np.hypot(*contact["force"])) for *_, contact in entries)
    sizes = [np.hypot(table["normal_force"], table["tangential_force"]) for table, *_ in entries]
    weak = max(WEAK * largest, RESOLVED * max(each.sum() for each in sizes))
    areas, rims, zones, forces, colours = [], [], [], [], []
    for (table, facets, contact), weight in zip(entries, sizes, strict=True):
        xy, normal = (np.column_stack([table[a], table[b]]) for a, b in (("x", "y"), ("nx", "ny")))
        stress = 0.8 * table["normal_stress"] / (top or 1.0)
        for chain in chains(facets):
            at, ends = xy[chain], xy[chain] - size * stress[chain, None] * normal[chain]
            areas.append(np.vstack([at, ends[::-1]]))
            rims.append(ends if chain[0] == chain[-1] else np.vstack([at[:1], ends, at[-1:]]))
            edges = np.vstack([at[:1], (at[1:] + at[:-1]) / 2, at[-1:]])
            zones += [edges[[k, k + 1]] for k in range(len(chain))]
            colours += [LINES[status] for status in table["status"][chain]]
        force = np.array(contact["force"], float)
        if np.hypot(*force) > weak:
            centre = weight @ xy / weight.sum()
            arm = contact["moment"] - (centre[0] * force[1] - centre[1] * force[0]) * (not results.axisymmetric)
            at = centre + arm * np.array([force[1], -force[0]]) / (force @ force)
            if np.linalg.norm(at - centre) <= np.ptp(xy, axis=0).max() + size:
                forces.append(at + np.outer((-1.0, 1.0), size / largest * force))
    shade = {"facecolor": COLOURS["normal"] + "60", "edgecolor": COLOURS["normal"]}
    axes.add_collection(PolyCollection(areas, **shade | {"edgecolor": "none"}, zorder=4))
    axes.add_collection(PolyCollection(rims, closed=False, **shade | {"facecolor": "none"}, linewidth=0.6, zorder=4))
    axes.add_collection(LineCollection(zones, colors=colours, linewidth=2.2, capstyle="butt", zorder=5))
    axes.add_collection(LineCollection(forces, colors=COLOURS["force"], linewidth=1.4, zorder=6))
    axes.autoscale_view()
    write_names(axes, list(bodies), middles(points, cells, owner))
    (factor, unit), (times, of_force) = scaled_unit(top, units["stress"]), scaled_unit(largest, units["force"])
    legend: list[Any] = [Patch(**shade, label=f"{kind}, largest {rounded(top / factor)} {unit}")]
    if largest > weak:
        legend.append(Line2D([], [], color=COLOURS["force"],
                             label=f"resultants, largest {rounded(largest / times)} {of_force}"))
    counts = {zone: sum(contact[zone] for *_, contact in entries) for zone in LINES}
    legend += [Line2D([], [], color=LINES[zone], linewidth=2.2, label=_counted(zone, number))
               for zone, number in counts.items() if number]
    figure.set_figheight(figure.get_figheight() + 0.5)  # for the legend
    axes.legend(handles=legend, ncols=2 + is_wide(points), **ABOVE)
    figure.suptitle(f"{results.heading(True)}contact forces")
    return figure


def draw_error(results: Results) -> Any:
    """The estimated discretization error of each triangle; a figure."""
    from matplotlib.colors import LogNorm

    points, (cells, owner) = results.fields["points"][:, :2], linear_triangles(results.fields["cells"])
    values = results.fields["error"][owner]
    top = values.max() or 1.0
    figure, axes = map_of(results, points)
    draw_outline(axes, points, cells)
    image = axes.tripcolor(*points.T, cells, facecolors=np.maximum(values, 1e-3 * top), cmap="magma_r",
                           rasterized=True, norm=LogNorm(1e-3 * top, top))
    draw_colours(figure, axes, image, "estimated error, over the mean (energy norm per area)", "min")
    figure.suptitle(f"{results.heading()}estimated discretization error "
                    f"{results.summary['discretization_error']['energy_norm']:.2g} of the energy norm")
    return figure


def draw_contact(results: Results, name: str) -> Any:
    """Stresses, gap and slip along the contact `name`, with its zones shaded; a figure.

    With quadratic elements the curves of the stresses are means over sides, and dots are the nodes' stresses.
    """
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    (nodes, facets), sides = drawn_rows(results.contacts[name], results.facets[name]), results.sides.get(name)
    units, breaks = results.summary["units"], np.array([chain[0] for chain in chains(facets)[1:]], int)
    contact = next(each for each in results.summary["scene"]["contact"] if each["name"] == name)
    friction, frictional = contact["friction"], contact["friction"]["law"] != "none"
    position, along = _position(nodes)
    shown, place, apart, extent = nodes, position, breaks, ""
    if sides:  # the middle of a side is a node
        at = dict(zip(zip(nodes["x"], nodes["y"], strict=True), range(len(position)), strict=True))
        rows = np.array([at[point] for point in zip(sides["x"], sides["y"], strict=True)])
        apart = 1 + np.flatnonzero((np.diff(rows) != 2) | np.diff(np.searchsorted(breaks, rows, "right")).astype(bool))
        shown, place, extent = sides, position[rows], ",\nmean over sides"
    figure, (stresses, motion) = plt.subplots(2, 1, sharex=True, figsize=(8.6, 6.0),
                                              gridspec_kw={"height_ratios": (3, 2)})
    factor, unit = scaled_unit(np.abs(nodes["normal_stress"]).max(), units["stress"])
    for kind, label in {"normal": "normal (pressure)", "tangential": "tangential"}.items():
        if kind == "normal" or frictional or contact.get("kind") == "bonded":
            if sides:
                stresses.plot(position, nodes[f"{kind}_stress"] / factor, ".", markersize=2, alpha=0.45,
                              color=COLOURS[kind])
            _curve(stresses, place, shown[f"{kind}_stress"] / factor, apart, color=COLOURS[kind], label=label + extent)
    bound = _slip_bound(shown, friction) if frictional else None
    if bound is not None:
        for sign, label in ((1, "± slip bound"), (-1, "")):
            _curve(stresses, place, sign * bound / factor, apart, marker="", color=COLOURS["bound"], linestyle="--",
                   linewidth=1, label=label)
    stresses.set_ylabel(f"contact stress ({unit})")
    of_one = f" of {name}" if len(results.contacts) > 1 else ""
    stresses.set_title(f"{results.heading(True)}contact stresses{of_one}")

    largest = max(np.abs(nodes["gap"]).max(), np.abs(nodes["slip"]).max())
    visible = RESOLVED * results.summary["displacement_max"]
    factor, unit = scaled_unit(max(largest, visible), units["length"])
    if 0 < largest < visible:  # rounding, not motion
        motion.set_ylim(-visible / factor, visible / factor)
    _curve(motion, position, nodes["gap"] / factor, breaks, color=COLOURS["normal"], label="gap")
    if frictional:
        _curve(motion, position, nodes["slip"] / factor, breaks, color=COLOURS["tangential"], label="slip")
    motion.set(xlabel=f"{along} ({units['length']})", ylabel=f"{'gap, slip' if frictional else 'gap'} ({unit})")

    for axes in (stresses, motion):
        axes.axhline(0.0, color="black", linewidth=0.6)
        _shade(axes, position, nodes["status"], breaks)
    handles, counts = stresses.get_legend_handles_labels()[0], results.summary["contacts"][name]
    handles += [Patch(facecolor=colour, edgecolor="#b5b5b5", label=_counted(zone, counts[zone]))
                for zone, colour in ZONES.items() if counts[zone]]
    stresses.legend(handles=handles, **BESIDE)
    motion.legend(**BESIDE)
    return figure


def draw_convergence(results: Results) -> Any:
    """Update and residual over the outer iterations, load step after load step; a figure."""
    import matplotlib.pyplot as plt

    history, summary = results.history, results.summary
    figure, axes = plt.subplots(figsize=(7.2, 4.4))
    k, starts = np.arange(1.0, len(history["iteration"]) + 1), 1 + np.flatnonzero(np.diff(history["step"]))
    x, what = METHODS[summary["outer"]].curves
    curves = {"update": ("normal", "o", f"update  ‖{x}$_k$ − {x}$_{{k-1}}$‖ / ‖{x}$_k$‖"),
              "residual": ("tangential", "s", f"residual: {what}")}
    for column, (colour, marker, label) in curves.items():
        positive = np.where(history[column] > 0, history[column], np.nan)
        axes.semilogy(*(np.insert(values, starts, np.nan) for values in (k, positive)), color=COLOURS[colour],
                      marker=marker, markersize=3, label=label)
    tolerance = summary["scene"]["method"]["tolerance"]
    axes.axhline(tolerance, color=COLOURS["bound"], linestyle="--", linewidth=1, label=f"tolerance {tolerance:g}")
    axes.grid(True, which="major", color="#e3e3e3")
    axes.xaxis.get_major_locator().set_params(integer=True)
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:.0e}".replace("e-0", "e-").replace("e+00", ""))
    axes.set(xlabel="outer iteration k", ylabel="relative change (–)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    axes.set_title(f"{results.heading()}{summary['outer_iterations']} outer iterations, n$_A$ = {summary['n_A']}, "
                   f"{summary['reason']}", wrap=True)
    return figure


def _counted(zone: str, number: int) -> str:
    return f"{zone} ({number} node{'s' * (number > 1)})"


def _position(nodes: Columns) -> tuple[np.ndarray, str]:
    """The coordinate (m,) over which a contact is drawn, and its name: x or y of a straight one, else arc length."""
    x, y = nodes["x"], nodes["y"]
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    for own, other, name in ((x, y, "x"), (y, x, "y")):
        if np.ptp(other) <= 1e-9 * arc[-1]:
            return own, name
    return arc, "arc length along the contact"


def _curve(axes: Any, x: np.ndarray, y: np.ndarray, breaks: np.ndarray, **style: Any) -> None:
    """Draw a curve that is not joined to the points at `breaks`; long curves mark lone points only."""
    lone = np.isin(np.arange(len(x)), [0, *breaks]) & np.isin(np.arange(1, len(x) + 1), [*breaks, len(x)])
    marked = np.insert(lone | (len(x) <= MARKED), breaks, False)
    axes.plot(*(np.insert(values, breaks, np.nan) for values in (x, y)),
              **{"marker": "o" if marked.any() else "", "markersize": 2.5, "markevery": marked.tolist()} | style)


def _shade(axes: Any, position: np.ndarray, statuses: np.ndarray, breaks: np.ndarray) -> None:
    """Shade the zones of equal status; two zones meet halfway between their nodes, and none crosses the `breaks`."""
    for x, status in zip(np.split(position, breaks), np.split(statuses, breaks), strict=True):
        edges = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
        first = np.flatnonzero(np.concatenate([[True], status[1:] != status[:-1]]))
        for a, b in zip(first, [*first[1:], len(x)], strict=True):
            axes.axvspan(edges[a], edges[b], color=ZONES[status[a]], linewidth=0, zorder=0)
    if len(position) > 1:
        axes.set_xlim(position.min(), position.max())


def _slip_bound(table: Columns, friction: dict) -> np.ndarray | None:
    """The bound on the tangential stress at nodes or sides, if numbers set it and it is worth drawing."""
    if any(isinstance(value, dict) for value in friction.values()):
        return None
    one, xy = np.ones(len(table["x"])), np.column_stack([table["x"], table["y"]])
    law = law_of(msgspec.convert(friction, Friction), xy, one, one, np.arange(len(one)))
    bound = law.slip_bound(table["normal_stress"])
    return bound if law.largest_slope or bound.max() <= 3 * np.abs(table["tangential_stress"]).max() else None
