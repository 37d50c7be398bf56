"""Pictures of a run, drawn from its files only."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.results.magnify import magnify
from ddmpi.results.reader import Columns, Results, read_results
from ddmpi.results.tables import writing

STYLE = {"font.size": 10, "axes.titlesize": 11, "figure.titlesize": 11, "axes.spines.top": False,
         "axes.spines.right": False, "legend.frameon": False, "figure.constrained_layout.use": True,
         "savefig.dpi": 160, "axes.axisbelow": True}

COLOURS = {"normal": "#1b4f8f", "tangential": "#c8501e", "bound": "#7a7a7a"}

ZONES = {"open": "#e4e7ec", "slip": "#fbe3cf", "stick": "#d3e6d3"}

RESOLVED = 1e-6
"""Gaps and slips below this fraction of the largest displacement are drawn as none."""

APART = 1.75
"""Consecutive nodes belong to separate pieces if they are farther apart than this times their mean nodal length.

Neighbours are at most 4/3 of it apart on a uniform mesh, at the end of a piece; across one missing node it is 2.
"""

MARKED = 100
"""Curves of at most this many nodes have a marker at each."""

PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


def draw_all(folder: str | Path) -> list[Path]:
    """Draw all pictures of the results in `folder` into it; their paths.

    bodies.png, contact.png (contact_NAME.png of each of several contacts), convergence.png, and error.png if the
    results have the estimated error. Not collective. Raises InputError if the results cannot be read, OutputError
    if a picture cannot be written.
    """
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    results, drawn = read_results(folder), []
    with plt.rc_context(STYLE):
        for name, figure in _figures(results):
            drawn.append(Path(folder) / name)
            try:
                with writing(drawn[-1]):
                    figure.savefig(drawn[-1], metadata=identity(results.summary))
            finally:
                plt.close(figure)
    return drawn


def identity(summary: dict) -> dict[str, str]:
    """Metadata of a picture (PNG text chunks) that name its run. Not collective."""
    version = summary.get("versions", {}).get("ddmpi", "of unknown version")
    run = (f"run {summary['run']}: {summary['command']}, in {summary['working_folder']}" if "run" in summary
           else "unknown run")
    return {"Title": summary["title"], "Software": f"ddmpi {version}", "Description": run}


def _figures(results: Results) -> Iterator[tuple[str, Any]]:
    """Each picture's file name and figure."""
    yield "bodies.png", draw_bodies(results)
    for name in results.contacts:
        yield "contact.png" if len(results.contacts) == 1 else f"contact_{name}.png", draw_contact(results, name)
    yield "convergence.png", draw_convergence(results)
    if "error" in results.fields:
        yield "error.png", draw_error(results)


def draw_bodies(results: Results):
    """The deformed bodies, coloured by von Mises stress, or by displacement if there is no stress; a figure."""
    fields, (length_unit, stress_unit) = results.fields, _units(results)
    (scale, shift), u = magnify(results), fields["displacement"][:, :2]
    points, moved = fields["points"][:, :2] + shift, np.linalg.norm(u, axis=1)
    cells, owner = _linear_triangles(fields["cells"])
    if "von_mises" in fields:
        values, unit, quantity = _at_nodes(fields["von_mises"][owner], points, cells), stress_unit, "von Mises stress"
        low, top = 0.0, np.percentile(values, 99.5)  # stresses are singular in corners, which must not set the scale
    else:
        values, unit, quantity = moved, length_unit, "displacement"
        low, top = values.min(), values.max()
    factor, unit = _scaled_unit(values.max(), unit)
    figure, axes = _axes(points + scale * u, cells, length_unit)
    axes.add_collection(_outline(points, cells, color="#9aa0a8", linewidth=0.7, zorder=1))
    image = axes.tripcolor(*(points + scale * u).T, cells, values / factor, shading="gouraud", cmap="viridis",
                           vmin=low / factor, vmax=top / factor or 1.0, rasterized=True, zorder=2)
    _colour_bar(figure, axes, image, f"{quantity} ({unit})", "max" if values.max() > top else "neither")
    factor, unit = _scaled_unit(moved.max(), length_unit)
    figure.suptitle(f"{_title(results)}displacement × {scale:g}, largest {moved.max() / factor:.3g} {unit}")
    return figure


def draw_error(results: Results):
    """The estimated discretization error of each triangle; a figure."""
    from matplotlib.colors import LogNorm

    points = results.fields["points"][:, :2]
    cells, owner = _linear_triangles(results.fields["cells"])
    values = results.fields["error"][owner]
    top = values.max() or 1.0
    figure, axes = _axes(points, cells, _units(results)[0])
    image = axes.tripcolor(*points.T, cells, facecolors=np.maximum(values, 1e-3 * top), cmap="magma_r",
                           rasterized=True, norm=LogNorm(1e-3 * top, top))
    _colour_bar(figure, axes, image, "estimated error, over the mean (energy norm per area)", "min")
    figure.suptitle(f"{_title(results)}estimated discretization error "
                    f"{results.summary['discretization_error']['energy_norm']:.2g} of the energy norm")
    return figure


def draw_contact(results: Results, name: str):
    """Stresses, gap and slip along the contact `name`, with its zones shaded; a figure.

    With quadratic elements the curves of the stresses are means over sides, and dots are the nodes' stresses.
    """
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    nodes, sides = results.contacts[name], results.sides.get(name)
    length_unit, stress_unit = _units(results)
    friction = next(c["friction"] for c in results.summary["scene"]["contact"] if c["name"] == name)
    frictional = friction["law"] != "none"
    position, along = _position(nodes)
    shown, place, extent = nodes, position, ""
    if sides:  # the middle of a side is a node
        at = dict(zip(zip(nodes["x"], nodes["y"], strict=True), position, strict=True))
        place = np.array([at[point] for point in zip(sides["x"], sides["y"], strict=True)])
        shown, extent = sides, ",\nmean over sides"
    figure, (stresses, motion) = plt.subplots(2, 1, sharex=True, figsize=(8.6, 6.0),
                                              gridspec_kw={"height_ratios": (3, 2)})
    factor, unit = _scaled_unit(np.abs(nodes["normal_stress"]).max(), stress_unit)
    for kind, label in {"normal": "normal (pressure)", "tangential": "tangential"}.items():
        if kind == "normal" or frictional:
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
    stresses.set_title(f"{_title(results)}contact stresses" + (f" of {name}" if len(results.contacts) > 1 else ""))

    largest = max(np.abs(nodes["gap"]).max(), np.abs(nodes["slip"]).max())
    visible = RESOLVED * results.summary["displacement_max"]
    factor, unit = _scaled_unit(max(largest, visible), length_unit)
    if 0 < largest < visible:  # rounding, not motion
        motion.set_ylim(-visible / factor, visible / factor)
    _curve(motion, nodes, position, nodes["gap"] / factor, color=COLOURS["normal"], label="gap")
    if frictional:
        _curve(motion, nodes, position, nodes["slip"] / factor, color=COLOURS["tangential"], label="slip")
    motion.set(xlabel=f"{along} ({length_unit})", ylabel=f"{'gap, slip' if frictional else 'gap'} ({unit})")

    for axes in (stresses, motion):
        axes.axhline(0.0, color="black", linewidth=0.6)
        _shade(axes, position, nodes)
    handles, labels = stresses.get_legend_handles_labels()
    for zone, colour in ZONES.items():
        number = results.summary["contacts"][name][zone]
        if number:
            handles.append(Patch(facecolor=colour, edgecolor="#b5b5b5"))
            labels.append(f"{zone} ({number} node{'s' if number > 1 else ''})")
    stresses.legend(handles, labels, loc="upper left", bbox_to_anchor=(1.0, 1.0))
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
    axes.set(xlabel="outer iteration k", ylabel="relative change (–)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=2)
    axes.set_title(f"{_title(results)}{summary['outer_iterations']} outer iterations, n$_A$ = {summary['n_A']}, "
                   f"{summary['reason']}", wrap=True)
    return figure


def _units(results: Results) -> tuple[str, str]:
    """The units of length and stress."""
    output = results.summary["scene"]["output"]
    return output["length_unit"], output["stress_unit"]


def _scaled_unit(value: float, unit: str) -> tuple[float, str]:
    """A factor and a unit with a prefix in which `value` is easy to read; units other than SI stay as they are."""
    if unit not in ("m", "Pa") or not value or not np.isfinite(value):
        return 1.0, unit
    factor, prefix = next(((f, p) for f, p in PREFIXES if value >= f), (1.0, ""))
    return factor, prefix + unit


def _title(results: Results) -> str:
    title = results.summary["title"].replace("$", r"\$")  # no formula
    return f"{title}\n" if title else ""


def _position(nodes: Columns) -> tuple[np.ndarray, str]:
    """The coordinate (m,) over which a contact is drawn, and its name: x or y of a straight one, else arc length."""
    x, y = nodes["x"], nodes["y"]
    arc = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
    for own, other, name in ((x, y, "x"), (y, x, "y")):
        if np.ptp(other) <= 1e-9 * arc[-1]:
            return own, name
    return arc, "arc length along the contact"


def _starts(table: Columns) -> np.ndarray:
    """Rows of nodes or sides with which another piece of the contact begins."""
    distance, length = np.hypot(np.diff(table["x"]), np.diff(table["y"])), table["length"]
    return 1 + np.flatnonzero(distance > APART * (length[1:] + length[:-1]) / 2)


def _curve(axes, table: Columns, x: np.ndarray, y: np.ndarray, **style) -> None:
    """Draw a curve over the rows of a table that does not join separate pieces; long curves mark lone nodes only."""
    starts = _starts(table)
    lone = np.isin(np.arange(len(x)), [0, *starts]) & np.isin(np.arange(1, len(x) + 1), [*starts, len(x)])
    marked = np.insert(lone | (len(x) <= MARKED), starts, False)
    axes.plot(*(np.insert(values, starts, np.nan) for values in (x, y)),
              **{"marker": "o" if marked.any() else "", "markersize": 2.5, "markevery": marked.tolist()} | style)


def _shade(axes, position: np.ndarray, nodes: Columns) -> None:
    """Shade the zones of equal status; two zones meet halfway between their nodes."""
    for piece in np.split(np.arange(len(position)), _starts(nodes)):
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


def _axes(at: np.ndarray, cells: np.ndarray, unit: str):
    """A figure and axes of a size that suits bodies with nodes at `at` (nv, 2), with their outlines."""
    import matplotlib.pyplot as plt

    width, height = np.ptp(at, axis=0)
    size = (8.6, 1.4 + 8.0 * height / width) if _is_wide(at) else (1.8 + 6.2 * width / height, 6.4)
    figure, axes = plt.subplots(figsize=np.clip(size, (4.8, 3.0), (10.0, 8.0)), layout="compressed")
    axes.add_collection(_outline(at, cells, color="black", linewidth=0.6, zorder=3))
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
    """The edges of triangles with nodes at `at` (nv, 2) that belong to one triangle only, as a collection."""
    from matplotlib.collections import LineCollection

    edges = np.sort(np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]]), axis=1)
    _, index, count = np.unique(edges @ (len(at), 1), return_index=True, return_counts=True)
    return LineCollection(at[edges[index[count == 1]]], capstyle="round", **style)


def _linear_triangles(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells (nt, 3 or 6) as triangles between neighbouring nodes, and the cell that each is part of."""
    parts = [[0, 1, 2]] if cells.shape[1] == 3 else [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]
    return cells[:, parts].reshape(-1, 3), np.repeat(np.arange(len(cells)), len(parts))


def _at_nodes(values: np.ndarray, points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Averages over the triangles around each node, weighted by their areas."""
    (ax, ay), (bx, by) = ((points[cells[:, i]] - points[cells[:, 0]]).T for i in (1, 2))
    area = np.abs(ax * by - ay * bx)
    total = np.bincount(cells.ravel(), np.repeat(area, 3), len(points))
    return np.bincount(cells.ravel(), np.repeat(values * area, 3), len(points)) / np.where(total > 0, total, 1.0)
