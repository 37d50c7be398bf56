"""What pictures share: colours, the axes around bodies and rigid partners, colour bars, names and legends."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import boundary_facets
from ddmpi.results.fields import at_nodes, linear_triangles
from ddmpi.results.tables import Results
from ddmpi.system.provenance import NO_MATPLOTLIB, has_matplotlib

STYLE = {"font.size": 10, "axes.titlesize": 11, "figure.titlesize": 11, "axes.spines.top": False,
         "axes.spines.right": False, "legend.frameon": False, "figure.constrained_layout.use": True,
         "savefig.dpi": 160, "axes.axisbelow": True}

COLOURS = {"normal": "#1b4f8f", "tangential": "#c8501e", "bound": "#7a7a7a", "rigid": "#404040", "still": "#9aa0a8",
           "moved": "#c8501e", "force": "#8c1a3a"}

FILLED = {"still": "#f4f5f7", "moved": "#f6dfd4"}
"""The insides of bodies."""

ABOVE: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "fontsize": 8}
"""Legends above the axes."""

BESIDE: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
"""Legends to the right of the axes."""

NAMED = 40
"""Names are written on at most this many bodies."""


def start_drawing() -> Any:
    """matplotlib.pyplot, to draw into files. Not collective. Raises InputError where matplotlib is not installed."""
    if not has_matplotlib():
        raise InputError(f"no pictures can be drawn; {NO_MATPLOTLIB}")
    import matplotlib

    matplotlib.use("agg")
    from matplotlib import pyplot

    return pyplot


def map_of(results: Results, at: np.ndarray, rigid: Iterable[tuple[np.ndarray, np.ndarray]] = ()) -> tuple[Any, Any]:
    """A figure and axes of a size that suits what lies `at` (k, 2), in the scene's unit of length.

    Surfaces that are `rigid`, points and normals, are drawn as by `draw_rigid`.
    """
    import matplotlib.pyplot as plt

    rigid = list(rigid)
    everything = np.vstack([at, *(line for line, _ in rigid)])
    width, height = np.ptp(everything, axis=0)
    size = (8.6, 1.4 + 8.0 * height / width) if is_wide(everything) else (1.8 + 6.2 * width / height, 6.4)
    figure, axes = plt.subplots(figsize=np.clip(size, (4.8, 3.0), (10.0, 8.0)), layout="compressed")
    draw_rigid(axes, rigid, float(np.ptp(at, axis=0).max()))
    unit = results.summary["scene"]["output"]["length_unit"]
    axes.set(aspect="equal", xlabel=f"x ({unit})", ylabel=f"y ({unit})")
    return figure, axes


def is_wide(at: np.ndarray) -> bool:
    """Whether what lies `at` (k, 2) has its colour bar below it."""
    width, height = np.ptp(at, axis=0)
    return bool(width > 1.4 * height)


def draw_rigid(axes: Any, rigid: Iterable[tuple[np.ndarray, np.ndarray]], extent: float) -> None:
    """Draw rigid surfaces, points (k, 2) and normals, hatched on the side that the normals do not point to.

    The `extent` of the bodies sets the length of the hatches (m).
    """
    from matplotlib.collections import LineCollection

    for line, normal in rigid:
        axes.plot(*line.T, color=COLOURS["rigid"], linewidth=1.4, zorder=2.5)
        steps = np.linalg.norm(np.diff(line, axis=0), axis=1).cumsum()
        hatched = np.unique(np.searchsorted(steps, np.arange(0.0, steps[-1], 0.02 * extent)))
        along = np.column_stack([normal[:, 1], -normal[:, 0]])
        hatches = np.stack([line, line - 0.015 * extent * (normal + along)], axis=1)[hatched]
        axes.add_collection(LineCollection(hatches, colors=COLOURS["rigid"], linewidth=0.7, zorder=2.5))


def draw_outline(axes: Any, at: np.ndarray, cells: np.ndarray, **style: Any) -> None:
    """Draw the boundary of triangles (nt, 3) with nodes `at` (nv, 2), by default as a thin black line on top."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(at[boundary_facets(cells)[0]], capstyle="round",
                                       **{"color": "black", "linewidth": 0.6, "zorder": 3} | style))


def fill(axes: Any, at: np.ndarray, cells: np.ndarray, colour: str) -> None:
    """Fill triangles (nt, 3) with nodes `at` (nv, 2) with one colour."""
    from matplotlib.colors import ListedColormap

    axes.tripcolor(*at.T, cells, np.zeros(len(cells)), cmap=ListedColormap([colour]), zorder=0)


def write_names(axes: Any, names: Sequence[str], at: Sequence[np.ndarray], below: bool = False) -> None:
    """Write the names of bodies at places (2,), or a little `below` them, unless there are more than NAMED."""
    from matplotlib.patheffects import withStroke

    for name, place in zip(names, at, strict=True) if len(names) <= NAMED else ():
        axes.annotate(name, place, (0, -9 * below), textcoords="offset points", ha="center", va="center", fontsize=7,
                      color="#50555c", zorder=7, path_effects=[withStroke(linewidth=2, foreground="#ffffffc0")])


def draw_colours(figure: Any, axes: Any, image: Any, label: str, extend: str) -> None:
    """Draw the colour bar of an image, below what is wide."""
    wide = is_wide(np.column_stack([axes.get_xlim(), axes.get_ylim()]))
    figure.colorbar(image, ax=axes, label=label, extend=extend, shrink=0.85, aspect=40 if wide else 25,
                    orientation="horizontal" if wide else "vertical")


def coloured(results: Results, fields: dict[str, np.ndarray]) -> tuple[np.ndarray, str, str]:
    """What colours bodies, at their nodes (nv,): von Mises stress, or displacement if there is no stress; its name and
    unit."""
    output, u = results.summary["scene"]["output"], fields["displacement"][:, :2]
    if "von_mises" not in fields:
        return np.linalg.norm(u, axis=1), "displacement", output["length_unit"]
    cells, owner = linear_triangles(results.fields["cells"])
    return (at_nodes(fields["von_mises"][owner], results.fields["points"][:, :2], cells), "von Mises stress",
            output["stress_unit"])


def rounded(value: float) -> str:
    """Three digits, without an exponent below a million."""
    return f"{float(f'{value:.3g}'):g}"
