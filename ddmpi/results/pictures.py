"""Pictures of a run, drawn from its files only."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.results.fields import areas_at_nodes, at_nodes, boundary_edges, linear_triangles, middles
from ddmpi.results.histories import animate, at_step, draw_steps
from ddmpi.results.magnify import magnify, owners, surfaces
from ddmpi.results.tables import Columns, Results, facing_rows, pieces, read_results, starts, writing
from ddmpi.system.files import contact_files
from ddmpi.system.numbers import scaled_unit
from ddmpi.system.provenance import NO_MATPLOTLIB, has_matplotlib, identity

STYLE = {"font.size": 10, "axes.titlesize": 11, "figure.titlesize": 11, "axes.spines.top": False,
         "axes.spines.right": False, "legend.frameon": False, "figure.constrained_layout.use": True,
         "savefig.dpi": 160, "axes.axisbelow": True}

COLOURS = {"normal": "#1b4f8f", "tangential": "#c8501e", "bound": "#7a7a7a", "rigid": "#404040"}

ZONES = {"open": "#e4e7ec", "slip": "#fbe3cf", "stick": "#d3e6d3"}

LINES = {"open": "#9aa0a8", "slip": "#e08a3c", "stick": "#4d9a4d"}
"""Zones drawn as lines."""

EACH = 6
"""Of at most so many contacts each has a picture of its own; of more, all share one only."""

NAMED = 40
"""Names are written on at most this many bodies."""

WIDEST = 0.3
"""Half a resultant is drawn as at most this part of a body's size, the root of its area, pressures as 0.8 of it."""

WEAK = 0.01
"""Resultants below this part of the largest one are not drawn."""

RESOLVED = 1e-6
"""Gaps and slips below this fraction of the largest displacement are drawn as none."""

MARKED = 100
"""Curves of at most this many nodes have a marker at each."""


def start_drawing() -> Any:
    """matplotlib.pyplot, to draw into files. Not collective. Raises InputError where matplotlib is not installed."""
    if not has_matplotlib():
        raise InputError(f"no pictures can be drawn; {NO_MATPLOTLIB}")
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    return pyplot


def draw_all(folder: str | Path, number: int = 0, drawers: int = 1, time: float | None = None,
             into: Path | None = None) -> list[Path]:
    """Draw all pictures of the results in `folder` into it, or this one's share if several `drawers` do; their paths.

    Those of bodies and contacts are of the load step at `time`, by default as `at_step` chooses it. `into` another
    folder go pictures without the animation.

    bodies.png, contact.png (of several contacts contacts.png, and contact_NAME.png of each if there are not more than
    EACH), convergence.png, steps.png if there are load steps, animation.gif if the scene wants it, and error.png if the
    results have the estimated error.
    Not collective. Raises InputError without results or matplotlib, OutputError if a picture cannot be written.
    """
    plt = start_drawing()
    last, drawn = read_results(folder), []
    results = at_step(last, Path(folder), time)
    with plt.rc_context(STYLE):
        for turn, (name, draw) in enumerate(_figures(results, last)):
            if number not in (turn % (2 * drawers), 2 * drawers - 1 - turn % (2 * drawers)):  # there and back
                continue
            figure = draw()
            drawn.append((into or Path(folder)) / name)
            try:
                with writing(drawn[-1]):
                    drawn[-1].unlink(missing_ok=True)  # it may be a link
                    figure.savefig(drawn[-1], metadata=identity(results.summary))
            finally:
                plt.close(figure)
        animated = not into and number == drawers - 1 and results.summary["scene"]["output"].get("animation")
        if animated and len(results.energy.get("time", ())):
            drawn.append(animate(results, Path(folder), results.heading()))
    return drawn


def _figures(results: Results, last: Results) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Each picture's file name and what draws its figure, the longest work first; errors are of the `last` step."""
    yield "bodies.png", lambda: draw_bodies(results)
    yield "convergence.png", lambda: draw_convergence(results)
    several = len(results.contacts) > 1
    if several:
        yield "contacts.png", lambda: draw_contacts(results)
    for name in results.contacts if len(results.contacts) <= EACH else ():
        yield contact_files(name).picture if several else "contact.png", functools.partial(draw_contact, results, name)
    if len(results.energy.get("time", ())):
        yield "steps.png", lambda: draw_steps(results, results.heading())
    if "error" in results.fields:
        yield "error.png", lambda: draw_error(last)


def draw_bodies(results: Results):
    """The deformed bodies, coloured by von Mises stress, or by displacement if there is no stress; a figure."""
    fields, (length_unit, stress_unit) = results.fields, _units(results)
    (scale, shift), u = magnify(results), fields["displacement"][:, :2]
    points, moved = fields["points"][:, :2] + shift, np.linalg.norm(u, axis=1)
    cells, owner = linear_triangles(fields["cells"])
    if "von_mises" in fields:
        values, unit, quantity = at_nodes(fields["von_mises"][owner], points, cells), stress_unit, "von Mises stress"
        low, top = 0.0, np.percentile(values, 99.5)  # stresses are singular in corners, which must not set the scale
    else:
        values, unit, quantity = moved, length_unit, "displacement"
        low, top = values.min(), values.max()
    factor, unit = scaled_unit(values.max(), unit)
    rigid = list(surfaces(results, scale))
    figure, axes = _axes(points + scale * u, cells, length_unit, rigid)
    axes.add_collection(_outline(points, cells, color="#9aa0a8", linewidth=0.7, zorder=1))
    image = axes.tripcolor(*(points + scale * u).T, cells, values / factor, shading="gouraud", cmap="viridis",
                           vmin=low / factor, vmax=top / factor or 1.0, rasterized=True, zorder=2)
    _colour_bar(figure, axes, image, f"{quantity} ({unit})", "max" if values.max() > top else "neither")
    factor, unit = scaled_unit(moved.max(), length_unit)
    figure.suptitle(f"{results.heading(True)}displacement × {scale:g}, largest {_number(moved.max() / factor)} {unit}")
    return figure


def draw_contacts(results: Results):
    """All contacts where the bodies stand: their zones as lines, pressures as areas on them, resultants; a figure.

    A pressure is drawn into the contact's first body, tension into the second. A resultant is drawn along its line of
    action, its middle at the contact, unless it passes the contact by.
    """
    from matplotlib.collections import LineCollection, PolyCollection
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch
    from matplotlib.patheffects import withStroke

    points, (length_unit, stress_unit) = results.fields["points"][:, :2], _units(results)
    cells, owner = linear_triangles(results.fields["cells"])[0], owners(results)
    figure, axes = _axes(points, cells, length_unit, list(surfaces(results)), inside="#f4f5f7")
    bodies = results.summary["bodies"]
    area = np.bincount(owner, areas_at_nodes(points, cells), len(bodies))
    size = WIDEST * float(np.median(np.sqrt(area)))
    entries = [(facing_rows(table), results.summary["contacts"][name]) for name, table in results.contacts.items()]
    top = max(np.abs(table["normal_stress"]).max() for table, _ in entries)
    kind = "normal stress" if any((table["normal_stress"] < 0.0).any() for table, _ in entries) else "pressure"
    largest = max(float(np.hypot(*contact["force"])) for _, contact in entries)
    areas, rims, zones, forces, colours = [], [], [], [], []
    for table, contact in entries:
        xy, normal = (np.column_stack([table[a], table[b]]) for a, b in (("x", "y"), ("nx", "ny")))
        stress = 0.8 * table["normal_stress"] / (top or 1.0)
        for piece in pieces(table):
            ends = xy[piece] - size * stress[piece, None] * normal[piece]
            areas.append(np.vstack([xy[piece], ends[::-1]]))
            rims.append(ends if piece[0] == piece[-1] else np.vstack([xy[piece[:1]], ends, xy[piece[-1:]]]))
            middle = (xy[piece][1:] + xy[piece][:-1]) / 2
            edges = np.vstack([xy[piece][:1], middle, xy[piece][-1:]])
            zones += [edges[[k, k + 1]] for k in range(len(piece))]
            colours += [LINES[status] for status in table["status"][piece]]
        force = np.array(contact["force"], float)
        if np.hypot(*force) > WEAK * largest:
            weight = np.hypot(table["normal_force"], table["tangential_force"])
            centre = weight @ xy / weight.sum()
            arm = contact["moment"] - (centre[0] * force[1] - centre[1] * force[0])
            at = centre + arm * np.array([force[1], -force[0]]) / (force @ force)
            if np.linalg.norm(at - centre) <= np.ptp(xy, axis=0).max() + size:
                forces.append(at + np.outer((-1.0, 1.0), size / largest * force))
    axes.add_collection(PolyCollection(areas, facecolor=COLOURS["normal"] + "60", edgecolor="none", zorder=4))
    axes.add_collection(PolyCollection(rims, closed=False, facecolor="none", edgecolor=COLOURS["normal"], linewidth=0.6,
                                       zorder=4))
    axes.add_collection(LineCollection(zones, colors=colours, linewidth=2.2, capstyle="butt", zorder=5))
    axes.add_collection(LineCollection(forces, colors="#8c1a3a", linewidth=1.4, zorder=6))
    axes.autoscale_view()
    if len(bodies) <= NAMED:
        for name, at in zip(bodies, middles(points, cells, owner), strict=True):
            axes.annotate(name, at, ha="center", va="center", fontsize=7, color="#50555c", zorder=7,
                          path_effects=[withStroke(linewidth=2, foreground="#ffffffc0")])
    (factor, unit), (times, of_force) = (scaled_unit(*each) for each in (
        (top, stress_unit), (largest, results.summary["units"]["force"])))
    legend: list[Any] = [Patch(facecolor=COLOURS["normal"] + "60", edgecolor=COLOURS["normal"],
                               label=f"{kind}, largest {_number(top / factor)} {unit}"),
                         Line2D([], [], color="#8c1a3a",
                                label=f"resultants, largest {_number(largest / times)} {of_force}")]
    counts = {zone: sum(contact[zone] for _, contact in entries) for zone in LINES}
    legend += [Line2D([], [], color=LINES[zone], linewidth=2.2, label=f"{zone} ({number} node{'s' * (number > 1)})")
               for zone, number in counts.items() if number]
    figure.set_figheight(figure.get_figheight() + 0.5)  # for the legend
    axes.legend(handles=legend, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=8, ncols=2 + _is_wide(points))
    figure.suptitle(f"{results.heading(True)}contact forces")
    return figure


def draw_error(results: Results):
    """The estimated discretization error of each triangle; a figure."""
    from matplotlib.colors import LogNorm

    points, (cells, owner) = results.fields["points"][:, :2], linear_triangles(results.fields["cells"])
    values = results.fields["error"][owner]
    top = values.max() or 1.0
    figure, axes = _axes(points, cells, _units(results)[0])
    image = axes.tripcolor(*points.T, cells, facecolors=np.maximum(values, 1e-3 * top), cmap="magma_r",
                           rasterized=True, norm=LogNorm(1e-3 * top, top))
    _colour_bar(figure, axes, image, "estimated error, over the mean (energy norm per area)", "min")
    figure.suptitle(f"{results.heading()}estimated discretization error "
                    f"{results.summary['discretization_error']['energy_norm']:.2g} of the energy norm")
    return figure


def draw_contact(results: Results, name: str):
    """Stresses, gap and slip along the contact `name`, with its zones shaded; a figure.

    With quadratic elements the curves of the stresses are means over sides, and dots are the nodes' stresses.
    """
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    nodes, sides = facing_rows(results.contacts[name]), results.sides.get(name)
    length_unit, stress_unit = _units(results)
    contact = next(each for each in results.summary["scene"]["contact"] if each["name"] == name)
    friction, frictional = contact["friction"], contact["friction"]["law"] != "none"
    position, along = _position(nodes)
    shown, place, extent = nodes, position, ""
    if sides:  # the middle of a side is a node
        at = dict(zip(zip(nodes["x"], nodes["y"], strict=True), position, strict=True))
        place = np.array([at[point] for point in zip(sides["x"], sides["y"], strict=True)])
        shown, extent = sides, ",\nmean over sides"
    figure, (stresses, motion) = plt.subplots(2, 1, sharex=True, figsize=(8.6, 6.0),
                                              gridspec_kw={"height_ratios": (3, 2)})
    factor, unit = scaled_unit(np.abs(nodes["normal_stress"]).max(), stress_unit)
    for kind, label in {"normal": "normal (pressure)", "tangential": "tangential"}.items():
        if kind == "normal" or frictional or contact.get("kind") == "bonded":
            if sides:
                stresses.plot(position, nodes[f"{kind}_stress"] / factor, ".", markersize=2, alpha=0.45,
                              color=COLOURS[kind])
            _curve(stresses, shown, place, shown[f"{kind}_stress"] / factor, color=COLOURS[kind], label=label + extent)
    bound = _slip_bound(shown, friction)
    if bound is not None:
        for sign, label in ((1, "± slip bound"), (-1, "")):
            _curve(stresses, shown, place, sign * bound / factor, marker="", color=COLOURS["bound"], linestyle="--",
                   linewidth=1, label=label)
    stresses.set_ylabel(f"contact stress ({unit})")
    of_one = f" of {name}" if len(results.contacts) > 1 else ""
    stresses.set_title(f"{results.heading(True)}contact stresses{of_one}")

    largest = max(np.abs(nodes["gap"]).max(), np.abs(nodes["slip"]).max())
    visible = RESOLVED * results.summary["displacement_max"]
    factor, unit = scaled_unit(max(largest, visible), length_unit)
    if 0 < largest < visible:  # rounding, not motion
        motion.set_ylim(-visible / factor, visible / factor)
    _curve(motion, nodes, position, nodes["gap"] / factor, color=COLOURS["normal"], label="gap")
    if frictional:
        _curve(motion, nodes, position, nodes["slip"] / factor, color=COLOURS["tangential"], label="slip")
    motion.set(xlabel=f"{along} ({length_unit})", ylabel=f"{'gap, slip' if frictional else 'gap'} ({unit})")

    for axes in (stresses, motion):
        axes.axhline(0.0, color="black", linewidth=0.6)
        _shade(axes, position, nodes)
    handles, counts = stresses.get_legend_handles_labels()[0], results.summary["contacts"][name]
    handles += [Patch(facecolor=colour, edgecolor="#b5b5b5", label=f"{zone} ({number} node{'s' * (number > 1)})")
                for zone, colour in ZONES.items() if (number := counts[zone])]
    stresses.legend(handles=handles, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    motion.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure


def draw_convergence(results: Results):
    """Update and residual over the outer iterations, load step after load step; a figure."""
    import matplotlib.pyplot as plt

    history, summary = results.history, results.summary
    figure, axes = plt.subplots(figsize=(7.2, 4.4))
    k, starts = np.arange(1.0, len(history["iteration"]) + 1), 1 + np.flatnonzero(np.diff(history["step"]))
    x, what = (("s", "contact equations") if summary["outer"] == "newton" else
               ("λ", "force mismatch  ‖s$_1$ − s$_2$‖ / ‖s‖"))
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


def _units(results: Results) -> tuple[str, str]:
    """The units of length and stress."""
    output = results.summary["scene"]["output"]
    return output["length_unit"], output["stress_unit"]


def _number(value: float) -> str:
    """Three digits, without an exponent below a million."""
    return f"{float(f'{value:.3g}'):g}"


def _position(nodes: Columns) -> tuple[np.ndarray, str]:
    """The coordinate (m,) over which a contact is drawn, and its name: x or y of a straight one, else arc length."""
    x, y = nodes["x"], nodes["y"]
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    for own, other, name in ((x, y, "x"), (y, x, "y")):
        if np.ptp(other) <= 1e-9 * arc[-1]:
            return own, name
    return arc, "arc length along the contact"


def _curve(axes, table: Columns, x: np.ndarray, y: np.ndarray, **style) -> None:
    """Draw a curve over the rows of a table that does not join separate pieces; long curves mark lone nodes only."""
    begin = starts(table)
    lone = np.isin(np.arange(len(x)), [0, *begin]) & np.isin(np.arange(1, len(x) + 1), [*begin, len(x)])
    marked = np.insert(lone | (len(x) <= MARKED), begin, False)
    axes.plot(*(np.insert(values, begin, np.nan) for values in (x, y)),
              **{"marker": "o" if marked.any() else "", "markersize": 2.5, "markevery": marked.tolist()} | style)


def _shade(axes, position: np.ndarray, nodes: Columns) -> None:
    """Shade the zones of equal status; two zones meet halfway between their nodes."""
    for piece in np.split(np.arange(len(position)), starts(nodes)):
        x, status = position[piece], nodes["status"][piece]
        edges = np.concatenate([x[:1], (x[1:] + x[:-1]) / 2, x[-1:]])
        first = np.flatnonzero(np.concatenate([[True], status[1:] != status[:-1]]))
        for a, b in zip(first, [*first[1:], len(x)], strict=True):
            axes.axvspan(edges[a], edges[b], color=ZONES[status[a]], linewidth=0, zorder=0)
    if len(position) > 1:
        axes.set_xlim(position.min(), position.max())


def _slip_bound(table: Columns, friction: dict) -> np.ndarray | None:
    """The bound on the tangential stress at nodes or sides, if a single number sets it and it is worth drawing."""
    value = friction.get("coefficient", friction.get("slip_bound"))
    if not isinstance(value, float | int):
        return None
    if friction["law"] == "coulomb":
        return value * table["normal_stress"]
    return np.full(len(table["x"]), float(value)) if value <= 3 * np.abs(table["tangential_stress"]).max() else None


def _axes(at: np.ndarray, cells: np.ndarray, unit: str, rigid: Sequence[tuple[np.ndarray, np.ndarray]] = (),
          inside: str = "none"):
    """A figure and axes of a size that suits bodies with nodes at `at` (nv, 2), with their outlines.

    Rigid surfaces, points and normals, are drawn hatched on the side that the normals do not point to.
    """
    import matplotlib.pyplot as plt
    from matplotlib.collections import LineCollection
    from matplotlib.colors import ListedColormap

    extent = np.ptp(at, axis=0).max()
    everything = np.vstack([at, *(line for line, _ in rigid)])
    width, height = np.ptp(everything, axis=0)
    size = (8.6, 1.4 + 8.0 * height / width) if _is_wide(everything) else (1.8 + 6.2 * width / height, 6.4)
    figure, axes = plt.subplots(figsize=np.clip(size, (4.8, 3.0), (10.0, 8.0)), layout="compressed")
    axes.add_collection(_outline(at, cells, color="black", linewidth=0.6, zorder=3))
    if inside != "none":
        axes.tripcolor(*at.T, cells, np.zeros(len(cells)), cmap=ListedColormap([inside]), zorder=0)
    for line, normal in rigid:
        axes.plot(*line.T, color=COLOURS["rigid"], linewidth=1.4, zorder=2.5)
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum()
        at_ticks = np.unique(np.searchsorted(steps, np.arange(0.0, steps[-1], 0.02 * extent)))
        along = np.column_stack([normal[:, 1], -normal[:, 0]])
        ticks = np.stack([line, line - 0.015 * extent * (normal + along)], axis=1)[at_ticks]
        axes.add_collection(LineCollection(ticks, colors=COLOURS["rigid"], linewidth=0.7, zorder=2.5))
    axes.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    return figure, axes


def _is_wide(at: np.ndarray) -> bool:
    """Whether bodies (nv, 2) have their colour bar below them."""
    width, height = np.ptp(at, axis=0)
    return bool(width > 1.4 * height)


def _colour_bar(figure, axes, image, label: str, extend: str) -> None:
    wide = _is_wide(axes.dataLim.get_points())
    figure.colorbar(image, ax=axes, label=label, extend=extend, shrink=0.85, aspect=40 if wide else 25,
                    orientation="horizontal" if wide else "vertical")


def _outline(at: np.ndarray, cells: np.ndarray, **style):
    """The boundary of triangles with nodes at `at` (nv, 2), as a collection."""
    from matplotlib.collections import LineCollection

    return LineCollection(at[boundary_edges(cells)], capstyle="round", **style)
