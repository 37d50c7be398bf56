"""Pictures of a run, drawn from its saved results only."""

from __future__ import annotations

import csv
import json
from pathlib import Path
import numpy as np
from ddmpi.errors import InputError, OutputError



STYLE = {"font.size": 10, "axes.titlesize": 11, "axes.spines.top": False, "axes.spines.right": False,
         "legend.frameon": False, "figure.constrained_layout.use": True, "savefig.dpi": 160, "axes.axisbelow": True}

COLOURS = {"normal": "#1b4f8f", "tangential": "#c8501e", "bound": "#7a7a7a"}

ZONES = {"open": "#e4e7ec", "slip": "#fbe3cf", "stick": "#d3e6d3"}

RESOLVED = 1e-6
"""Gaps and slips below this fraction of the largest displacement are drawn as none."""

PREFIXES = ((1e9, "G"), (1e6, "M"), (1e3, "k"), (1.0, ""), (1e-3, "m"), (1e-6, "µ"), (1e-9, "n"), (1e-12, "p"))


def draw_all(folder: str | Path) -> list[Path]:
    """Draw bodies.png, contact.png, convergence.png, and error.png if it was asked for, in a folder of results.

    Not collective. Raises InputError where there are no results, OutputError where nothing can be
    written.
    """
    import matplotlib

    matplotlib.use("agg")
    import matplotlib.pyplot as plt

    folder = Path(folder)
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        interface, history = _read_csv(folder / "interface.csv"), _read_csv(folder / "history.csv")
        sides = _read_csv(folder / "interface_sides.csv") if (folder / "interface_sides.csv").exists() else {}
        fields = _read_fields(folder / "result.h5")
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{folder}: not a complete folder of results: {error}") from None
    drawn = []
    with plt.rc_context(STYLE):
        figures = [("bodies.png", draw_bodies(fields, summary)),
                   ("contact.png", draw_contact(interface, sides, summary)),
                   ("convergence.png", draw_convergence(history, summary))]
        if "error" in fields:
            figures.append(("error.png", draw_error(fields, summary)))
        for name, figure in figures:
            try:
                figure.savefig(folder / name, metadata=identity(summary))
            except OSError as error:
                raise OutputError(f"{folder / name}: cannot be written: {error.strerror}") from None
            finally:
                plt.close(figure)
            drawn.append(folder / name)
    return drawn


def identity(summary: dict) -> dict[str, str]:
    """Metadata of a picture (PNG text chunks) that lead back to its run. Not collective."""
    version = summary.get("versions", {}).get("ddmpi", "of unknown version")
    told = [f"run {summary['run']}: {summary['command']}, in {summary['working_folder']}"] if "run" in summary else []
    return {"Title": summary["title"], "Software": f"ddmpi {version}", "Description": "".join(told) or "unknown run"}


def draw_bodies(fields: dict[str, np.ndarray], summary: dict):
    """Deformed bodies with von Mises stress (displacement where there is no stress); a figure."""
    import matplotlib.pyplot as plt

    points, u = fields["points"][:, :2], fields["displacement"][:, :2]
    cells, owner = _linear_triangles(fields["cells"])
    bodies = fields["body"][owner]
    length_unit, stress_unit = _units(summary)
    width, height = np.ptp(points, axis=0)
    largest = np.linalg.norm(u, axis=1).max()
    scale = _round_scale(0.08 * max(width, height) / largest) if largest else 1.0
    at = points + scale * u
    factor, unit = _scaled_unit(np.ptp(at), length_unit, prefixes=False)
    at, original = at / factor, points / factor
    box = np.ptp(at, axis=0)
    horizontal = _lies(box)
    figure, axes = plt.subplots(figsize=_size(box))
    for body in np.unique(bodies):
        for edge in _outline(cells[bodies == body]):
            axes.plot(*original[edge].T, color="#9aa0a8", linewidth=0.7, zorder=1)
    if "von_mises" in fields:
        values = _at_nodes(fields["von_mises"][owner], points, cells)
        factor, value_unit = _scaled_unit(values.max(), stress_unit)
        values /= factor
        top = np.percentile(values, 99.5)  # corners are singular; they must not wash the rest out
        image = axes.tripcolor(*at.T, cells, values, shading="gouraud", cmap="viridis", vmin=0.0, vmax=top or 1.0,
                               rasterized=True, zorder=2)
        label, extend = f"von Mises stress ({value_unit})", "max" if values.max() > top else "neither"
    else:
        factor, value_unit = _scaled_unit(largest, length_unit)
        image = axes.tripcolor(*at.T, cells, np.linalg.norm(u, axis=1) / factor, shading="gouraud", cmap="viridis",
                               rasterized=True, zorder=2)
        label, extend = f"displacement ({value_unit})", "neither"
    for body in np.unique(bodies):
        for edge in _outline(cells[bodies == body]):
            axes.plot(*at[edge].T, color="black", linewidth=0.6, zorder=3)
    figure.colorbar(image, ax=axes, label=label, extend=extend, shrink=0.85,
                    orientation="horizontal" if horizontal else "vertical", aspect=40 if horizontal else 25)
    axes.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    factor, u_unit = _scaled_unit(largest, length_unit)
    axes.set_title(f"{_title(summary)}displacement × {scale:g}, largest {largest / factor:.3g} {u_unit}")
    return figure


def draw_error(fields: dict[str, np.ndarray], summary: dict):
    """The estimated discretization error of each triangle; a figure."""
    import matplotlib.pyplot as plt
    from matplotlib.colors import LogNorm

    cells, owner = _linear_triangles(fields["cells"])
    factor, unit = _scaled_unit(np.ptp(fields["points"]), _units(summary)[0], prefixes=False)
    at = fields["points"][:, :2] / factor
    values = fields["error"][owner]
    top = values.max() or 1.0
    figure, axes = plt.subplots(figsize=_size(np.ptp(at, axis=0)))
    image = axes.tripcolor(*at.T, cells, facecolors=np.maximum(values, 1e-3 * top), cmap="magma_r", rasterized=True,
                           norm=LogNorm(1e-3 * top, top))
    for body in np.unique(fields["body"]):
        for edge in _outline(cells[fields["body"][owner] == body]):
            axes.plot(*at[edge].T, color="black", linewidth=0.6)
    wide = _lies(np.ptp(at, axis=0))
    figure.colorbar(image, ax=axes, label="estimated error, over the mean (energy norm per area)", shrink=0.85,
                    extend="min", orientation="horizontal" if wide else "vertical", aspect=40 if wide else 25)
    axes.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    axes.set_title(f"{_title(summary)}estimated discretization error "
                   f"{summary['discretization_error']['energy_norm']:.2g} of the energy norm")
    return figure


def draw_contact(interface: dict[str, np.ndarray], sides: dict[str, np.ndarray], summary: dict):
    """Contact stresses, gap and slip along the interface, with zones shaded; a figure.

    Where there are means over `sides`, they are the curve, and what stands at the nodes are dots.
    """
    import matplotlib.pyplot as plt
    from matplotlib.patches import Patch

    length_unit, stress_unit = _units(summary)
    xy = np.column_stack([interface["x"], interface["y"]])
    arc = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(xy, axis=0), axis=1))])
    straight = np.allclose(xy[:, 1], xy[0, 1], atol=1e-9 * max(arc[-1], 1e-300))
    position = xy[:, 0] if straight else arc
    shown, place, extent = interface, position, ""
    if sides:  # their middles are nodes
        at = dict(zip(map(tuple, xy.tolist()), position, strict=True))
        place = np.array([at[point] for point in zip(sides["x"].tolist(), sides["y"].tolist(), strict=True)])
        shown, extent = sides, ",\nmean over sides"
    frictional = summary["friction"] != "none"
    figure, (stresses, motion) = plt.subplots(2, 1, sharex=True, figsize=(8.6, 6.0),
                                              gridspec_kw={"height_ratios": (3, 2)})
    factor, unit = _scaled_unit(np.abs(interface["normal_stress"]).max(), stress_unit)
    marker = {"marker": "o", "markersize": 2.5} if len(arc) <= 100 else {}
    kinds = {"normal": "normal (pressure)"} | ({"tangential": "tangential"} if frictional else {})
    for kind, label in kinds.items():
        if sides:
            stresses.plot(position, interface[f"{kind}_stress"] / factor, ".", markersize=2, alpha=0.45,
                          color=COLOURS[kind])
        stresses.plot(place, shown[f"{kind}_stress"] / factor, color=COLOURS[kind], label=label + extent, **marker)
    if frictional:
        bound = _slip_bound(shown, summary)
        if bound is not None:
            for sign in (1, -1):
                stresses.plot(place, sign * bound / factor, color=COLOURS["bound"], linestyle="--", linewidth=1,
                              label="± slip bound" if sign > 0 else None)
    stresses.axhline(0.0, color="black", linewidth=0.6)
    stresses.set_ylabel(f"contact stress ({unit})")
    largest = max(np.abs(interface["gap"]).max(), np.abs(interface["slip"]).max())
    visible = RESOLVED * summary["displacement_max"]
    factor, unit = _scaled_unit(max(largest, visible), length_unit)
    if 0 < largest < visible:  # rounding, not motion
        motion.set_ylim(-visible / factor, visible / factor)
    motion.plot(position, interface["gap"] / factor, color=COLOURS["normal"], label="gap", **marker)
    if frictional:
        motion.plot(position, interface["slip"] / factor, color=COLOURS["tangential"], label="slip", **marker)
    motion.axhline(0.0, color="black", linewidth=0.6)
    motion.set_ylabel(f"gap, slip ({unit})")
    motion.set_xlabel(f"{'x' if straight else 'arc length along the interface'} ({length_unit})")
    present = _shade(stresses, position, interface["status"])
    _shade(motion, position, interface["status"])
    handles, labels = stresses.get_legend_handles_labels()
    counts = summary["contact"]
    handles += [Patch(facecolor=ZONES[z], edgecolor="#b5b5b5") for z in present]
    labels += [f"{z} ({counts[z]} nodes)" for z in present]
    stresses.legend(handles, labels, ncols=1, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    motion.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0))
    stresses.set_title(f"{_title(summary)}contact stresses")
    return figure


def draw_convergence(history: dict[str, np.ndarray], summary: dict):
    """Update and force mismatch over the outer iterations; a figure."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(figsize=(7.2, 4.4))
    k = history["iteration"]
    newton = summary["outer"] == "newton"
    x, what = ("s", "contact equations") if newton else ("λ", "force mismatch  ‖s$_1$ − s$_2$‖ / ‖s‖")
    axes.semilogy(k, _positive(history["update"]), color=COLOURS["normal"], marker="o", markersize=3,
                  label=f"update  ‖{x}$_k$ − {x}$_{{k-1}}$‖ / ‖{x}$_k$‖")
    axes.semilogy(k, _positive(history["residual"]), color=COLOURS["tangential"], marker="s", markersize=3,
                  label=f"residual: {what}")
    tolerance = summary["scene"]["method"]["tolerance"]
    axes.axhline(tolerance, color=COLOURS["bound"], linestyle="--", linewidth=1, label=f"tolerance {tolerance:g}")
    axes.grid(True, which="major", color="#e3e3e3")
    axes.set(xlabel="outer iteration k", ylabel="relative change (–)")
    axes.legend()
    axes.set_title(f"{_title(summary)}{summary['outer_iterations']} outer iterations, n$_A$ = {summary['n_A']}, "
                   f"{summary['reason']}", wrap=True)
    return figure


def _read_csv(path: Path) -> dict[str, np.ndarray]:
    with open(path, newline="", encoding="utf-8") as file:
        rows = list(csv.reader(file))
    columns = zip(*rows[1:], strict=True)
    return {name: np.array(column) if name == "status" else np.array(column, float)
            for name, column in zip(rows[0], columns, strict=True)}


def _read_fields(path: Path) -> dict[str, np.ndarray]:
    import h5py

    with h5py.File(path, "r") as file:
        return {name: data[()] for name, data in file.items()}


def _units(summary: dict) -> tuple[str, str]:
    output = summary["scene"]["output"]
    return output["length_unit"], output["stress_unit"]


def _scaled_unit(value: float, unit: str, prefixes: bool = True) -> tuple[float, str]:
    """A factor and a unit with a prefix, so that `value` reads well; other units than SI stay."""
    if not prefixes or unit not in ("m", "Pa") or not value or not np.isfinite(value):
        return 1.0, unit
    factor, prefix = next(((f, p) for f, p in PREFIXES if value >= f), (1.0, ""))
    return factor, prefix + unit


def _round_scale(scale: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed `scale`."""
    power = 10.0 ** np.floor(np.log10(scale))
    return float(power * max(d for d in (1, 2, 5) if d * power <= scale * (1 + 1e-12)))


def _title(summary: dict) -> str:
    title = summary["title"].replace("$", r"\$")  # no formula
    return f"{title}\n" if title else ""


def _positive(values: np.ndarray) -> np.ndarray:
    return np.where(values > 0, values, np.nan)


def _slip_bound(contact: dict[str, np.ndarray], summary: dict) -> np.ndarray | None:
    """The bound on the tangential stress at nodes or sides, where one number or the pressure gives it."""
    friction = summary["scene"]["contact"][0]["friction"]
    value = friction.get("coefficient", friction.get("slip_bound"))
    if not isinstance(value, float | int):
        return None
    if friction["law"] == "coulomb":
        return value * contact["normal_stress"]
    largest = np.abs(contact["tangential_stress"]).max()
    return np.full(len(contact["x"]), float(value)) if value <= 3 * largest else None


def _lies(box: np.ndarray) -> bool:
    """Whether a box (2,) is so wide that its colour bar goes below it."""
    return bool(box[0] > 1.4 * box[1])


def _size(box: np.ndarray) -> tuple[float, float]:
    """Size of a picture of bodies in a box (2,), in inches."""
    width, height = (8.6, 1.4 + 8.0 * box[1] / box[0]) if _lies(box) else (1.8 + 6.2 * box[0] / box[1], 6.4)
    return min(max(width, 4.8), 10), min(max(height, 3.0), 8)


def _shade(axes, position: np.ndarray, status: np.ndarray) -> list[str]:
    """Shade the zones of equal status from halfway to halfway between nodes; the zones present."""
    middle = (position[1:] + position[:-1]) / 2
    edges = np.concatenate([position[:1], middle, position[-1:]])
    start = 0
    for k in range(1, len(status) + 1):
        if k == len(status) or status[k] != status[start]:
            axes.axvspan(edges[start], edges[k], color=ZONES[status[start]], linewidth=0, zorder=0)
            start = k
    if len(position) > 1:
        axes.set_xlim(position[0], position[-1])
    return [zone for zone in ZONES if (status == zone).any()]


def _linear_triangles(cells: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cells (nt, 3 or 6) as triangles between neighbouring nodes, with the cell that each is part of."""
    parts = [[0, 1, 2]] if cells.shape[1] == 3 else [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]]
    return cells[:, parts].reshape(-1, 3), np.repeat(np.arange(len(cells)), len(parts))


def _at_nodes(values: np.ndarray, points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Averages over the triangles around each node, weighted with their areas."""
    (ax, ay), (bx, by) = ((points[cells[:, i]] - points[cells[:, 0]]).T for i in (1, 2))
    area = np.abs(ax * by - ay * bx)
    total = np.bincount(cells.ravel(), np.repeat(area, 3), len(points))
    return np.bincount(cells.ravel(), np.repeat(values * area, 3), len(points)) / np.where(total > 0, total, 1.0)


def _outline(cells: np.ndarray) -> list[np.ndarray]:
    """Closed boundary polygons of a set of triangles, as arrays of nodes."""
    edges = np.concatenate([cells[:, [0, 1]], cells[:, [1, 2]], cells[:, [2, 0]]])
    key = edges.min(axis=1) * (edges.max() + 1) + edges.max(axis=1)
    _, index, count = np.unique(key, return_index=True, return_counts=True)
    follow = dict(edges[index[count == 1]].tolist())
    loops = []
    while follow:
        start, node = next(iter(follow.items()))
        loop = [start]
        del follow[start]
        while node in follow:
            loop.append(node)
            node = follow.pop(node)
        loops.append(np.array([*loop, start]))
    return loops
