"""What pictures share: colours, axes, colour bars, names; where they draw bodies and rigid partners, how enlarged."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from typing import Any

import msgspec
import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.boundary import SHARPEST
from ddmpi.mesh.mesh import boundary_facets
from ddmpi.results.summary import displacement_at, factor_at
from ddmpi.results.tables import Columns, Results
from ddmpi.scene.contacts import Rigid
from ddmpi.surface.side import unit
from ddmpi.system.numbers import spans
from ddmpi.system.provenance import NO_MATPLOTLIB, has_matplotlib

STYLE = {"font.size": 10, "axes.titlesize": 11, "figure.titlesize": 11, "axes.spines.top": False,
         "axes.spines.right": False, "legend.frameon": False, "figure.constrained_layout.use": True,
         "savefig.dpi": 160, "axes.axisbelow": True}

COLOURS = {"normal": "#1b4f8f", "tangential": "#c8501e", "bound": "#7a7a7a", "rigid": "#404040", "still": "#9aa0a8",
           "moved": "#c8501e", "force": "#8c1a3a", "patch": "#cdd2d8"}

FILLED = {"still": "#f4f5f7", "moved": "#f6dfd4"}
"""The insides of bodies."""

ABOVE: dict[str, Any] = {"loc": "lower center", "bbox_to_anchor": (0.5, 1.0), "fontsize": 8}
"""Legends above the axes."""

BESIDE: dict[str, Any] = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
"""Legends to the right of the axes."""

NAMED = 40
"""Names are written on at most this many bodies."""

DRAWN = 0.08
"""Displacements and shifts are drawn as at most this fraction of the bodies' extent."""

INVISIBLE = 0.002
"""Errors of at most this fraction of the bodies' extent cannot be seen in a picture: two pixels."""

MARGIN = 0.04
"""A rigid surface is drawn longer at both ends than where bodies may touch it, by this fraction of the extent."""

WEAK = 0.01
"""Resultants below this part of the largest one are not drawn."""

RESOLVED = 1e-6
"""Gaps and slips below this fraction of the largest displacement are drawn as none, and so are resultants below this
fraction of the sum of the nodes' forces."""

MOVED, TURNED_BY = 0.1, 0.3
"""In the picture of a mechanism no node moves by more than this part of the bodies' extent, and no body turns by more
than this angle."""

AT_REST = 1e-3
"""A body whose velocity is below this part of the largest one is not drawn moved."""

TURNED, RAISED = np.deg2rad(-60.0), np.deg2rad(24.0)
"""From where solids are seen: angles of the line of sight about z, from x on, and above the plane of x and y. What is
longer along y than along x is seen from half the angle."""

CHUNK = 2_000_000
"""Pixels that facets of solids may cover are looked at by so many at a time."""

Paint = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""The colours (p, 3 or 4) of places on facets (p,), with barycentric coordinates (p, 3)."""


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

    rigid, radius = list(rigid), "radius " * results.axisymmetric
    everything = np.vstack([at, *(line for line, _ in rigid)])
    near = results.axisymmetric and at[:, 0].min() <= np.ptp(at, axis=0).max()
    if near:
        everything = np.vstack([everything, everything * (0.0, 1.0)])
    width, height = np.ptp(everything, axis=0)
    size = (8.6, 1.4 + 8.0 * height / width) if is_wide(everything) else (1.8 + 6.2 * width / height, 6.4)
    figure, axes = plt.subplots(figsize=np.clip(size, (4.8, 3.0), (10.0, 8.0)), layout="compressed")
    draw_rigid(axes, rigid, float(np.ptp(at, axis=0).max()))
    unit = results.summary["scene"]["output"]["length_unit"]
    axes.set(aspect="equal", xlabel=f"{radius}x ({unit})", ylabel=f"y ({unit})")
    if near:
        axes.axvline(0.0, color=COLOURS["rigid"], linewidth=0.8, linestyle="-.", zorder=1)
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


def rounded(value: float) -> str:
    """Three digits, without an exponent below a million."""
    return f"{float(f'{value:.3g}'):g}"


def magnify(results: Results, largest: float = 0.0) -> tuple[float, np.ndarray]:
    """The magnification F and a shift (nv, d) in metres: a node at x that moves by u is drawn at x + shift + F u.

    Each body is shifted as a whole, by F − 1 times the gap that its contact had at first; negative for an overlap.
    Nodes are then drawn F times as far apart as they are, and touch where they touch. If gaps vary, as in rings, this
    holds for their mean only. F is then so small that no error at touching nodes, and no overlap at others, is visible;
    at F = 1 there are none. A scene that gives ``output.magnification`` accepts what it does. `largest` is a
    displacement of an earlier load step that F has to suit as well (m). Not collective.
    """
    points, moved = results.points, np.linalg.norm(results.fields["displacement"], axis=1)
    owner, names, contacts = owners(results), list(results.summary["bodies"]), results.summary["scene"]["contact"]
    tables = [results.contacts[each["name"]] for each in contacts]
    tables = [table | {"initial_gap": factor_at(results.summary, _follows(each), results.time) * table["initial_gap"]}
              for each, table in zip(contacts, tables, strict=True)]
    mobile, apart = np.zeros(len(names)), np.zeros((len(tables), len(names)))
    distances = np.zeros((len(tables), results.dimension))
    np.maximum.at(mobile, owner, moved)
    for k, (contact, table) in enumerate(zip(contacts, tables, strict=True)):
        touching = table["status"] != "open"
        distances[k] = _initially(table)[touching if touching.any() else slice(None)].mean(axis=0)
        bodies = [names.index(name) for name in contact["bodies"] if name in names]  # a rigid partner is none
        apart[k, bodies] = (-1.0, 1.0)[:len(bodies)]
    shifts = np.zeros((len(names), results.dimension))
    if distances.any():
        shifts = mobile[:, None] * (np.linalg.pinv(apart * mobile) @ distances)  # mostly of the body that moves most
    extent, size = np.ptp(points, axis=0).max(), max(moved.max(), largest, np.abs(shifts).max())
    limits = [limit for table, shift in zip(tables, apart @ shifts, strict=True)
              for limit in _limits(table, shift, INVISIBLE * extent)]
    chosen = round_down(min([DRAWN * extent / size, *limits])) if size else 1.0
    factor = results.summary["scene"]["output"].get("magnification") or max(chosen, 1.0)
    return factor, (factor - 1.0) * shifts[owner]


def _initially(table: Columns) -> np.ndarray:
    """(l, d) from the first to the second body along the normal, undeformed (m): the gap without displacements."""
    return table["initial_gap"][:, None] * vectors(table, "n")


def vectors(table: Columns, name: str = "") -> np.ndarray:
    """(l, d) of the columns of a contact's table whose names are `name` before x, y and z; the places, by default."""
    return np.column_stack([table[f"{name}{axis}"] for axis in "xyz" if f"{name}{axis}" in table])


def _limits(table: Columns, shift: np.ndarray, visible: float) -> Iterator[float]:
    """The largest magnifications at which errors are not `visible` (m), `shift` being per unit of F − 1.

    The nodes are drawn F times as far apart as they are, but for (F − 1) `left`.
    """
    left, gap = _initially(table) - shift, table["gap"]
    wrong = np.linalg.norm(left[table["status"] != "open"], axis=1).max(initial=0.0)
    if wrong:
        yield 1.0 + visible / wrong
    into = np.einsum("ld,ld->l", left, vectors(table, "n"))
    overlapping = into > gap
    yield from (visible + into[overlapping]) / (into - gap)[overlapping]


def owners(results: Results) -> np.ndarray:
    """(nv,) the number of the body that each node belongs to."""
    found = np.zeros(len(results.fields["points"]), int)
    found[results.fields["cells"]] = results.fields["body"][:, None]
    return found


def surfaces(results: Results, factor: float = 0.0, time: float | None = None,
             going: Mapping[str, np.ndarray] | None = None) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Points (k, 2) along each rigid surface that bodies may touch, and its unit normals there, towards the bodies.

    In the plane. Drawn where it has gone to at `time`, else at that of the results, its displacement times `factor`.
    """
    points, names, owner = results.points, list(results.summary["bodies"]), owners(results)
    for rigid, contacts, moved in partners(results, time, going):
        touched = np.concatenate([vectors(results.contacts[each["name"]]) for each in contacts])
        bodies = points[np.isin(owner, [names.index(each["bodies"][0]) for each in contacts])]
        at = rigid.outline(touched, bodies, MARGIN * np.ptp(points, axis=0).max())
        if results.axisymmetric:
            right = np.flatnonzero(at[:, 0] >= 0.0)
            at = np.roll(at[right], -1 - np.argmax(np.diff(right, append=right[-1] + 2) > 1), axis=0)
        yield at + factor * moved, rigid.facing(at)[0]


def partners(results: Results, time: float | None = None,
             going: Mapping[str, np.ndarray] | None = None) -> Iterator[tuple[Rigid, list[dict], np.ndarray]]:
    """Each rigid partner that bodies may touch, its contacts, and its displacement (d,) at `time`, else at that of the
    results (m); or those of a mechanism, with the velocities with which they are `going`."""
    scene = results.summary["scene"]
    for rigid in msgspec.convert(scene.get("rigid", ()), list[Rigid]):
        contacts = [each for each in scene["contact"] if each["bodies"][1] == rigid.name]
        now = results.time if time is None else time
        moved = displacement_at(results.summary, rigid, now) if going is None else going.get(rigid.name)
        if contacts and moved is not None:
            yield rigid, contacts, moved


def _follows(contact: dict) -> str | None:
    """The name of the history that the gap of a contact in the summary follows."""
    gap = contact.get("gap")
    return gap.get("history") if isinstance(gap, dict) else None


def round_down(factor: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed `factor`."""
    power = 10.0 ** np.floor(np.log10(factor))
    return float(power * max(d for d in (1, 2, 5) if d * power <= factor * (1 + 1e-12)))


class View:
    """How places in space are drawn, without perspective.

    Attributes
    ----------
    axes : (3, 3) unit vectors to the right, upwards, and towards the eye
    """

    def __init__(self, extent: np.ndarray) -> None:
        """For what has this extent (3,)."""
        turned = TURNED if extent[0] >= extent[1] else TURNED / 2
        (c, s), (low, high) = ((np.cos(angle), np.sin(angle)) for angle in (turned, RAISED))
        self.axes = np.array([[-s, c, 0.0], [-c * high, -s * high, low], [c * low, s * low, high]])

    def place(self, at: np.ndarray) -> np.ndarray:
        """Places (…, 3) to the right, upwards, and towards the eye."""
        return at @ self.axes.T


def rasterise(corners: np.ndarray, shape: tuple[int, int]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The facet nearest to the eye at each pixel of an image (h, w), −1 where there is none; barycentric coordinates
    (h, w, 3) there; and how near it is (h, w).

    Parameters
    ----------
    corners : (f, 3, 3) of the facets; x to the right, y upwards, in pixels from the image's corner, z towards the eye
    """
    face, weights = np.full(shape[0] * shape[1], -1), np.zeros((shape[0] * shape[1], 3))
    nearest = np.full(shape[0] * shape[1], -np.inf)
    first = np.ceil(corners[..., :2].min(axis=1) - 0.5).astype(int)
    size = np.maximum(np.floor(corners[..., :2].max(axis=1) - 0.5).astype(int) + 1 - first, 0)
    ends = np.cumsum(size.prod(axis=1))
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    double = one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0]
    for some in np.split(np.arange(len(corners)), np.searchsorted(ends, np.arange(CHUNK, ends[-1:].sum(), CHUNK))):
        own, place = spans(np.zeros(len(some), int), size[some].prod(axis=1))
        own = some[own]
        row, column = np.divmod(place, size[own, 0])
        pixel = first[own] + np.column_stack([column, row])
        off = pixel + 0.5 - corners[own, 0, :2]
        b = (off[:, 0] * two[own, 1] - off[:, 1] * two[own, 0]) / double[own]
        c = (one[own, 0] * off[:, 1] - one[own, 1] * off[:, 0]) / double[own]
        inside = np.flatnonzero((b >= -1e-9) & (c >= -1e-9) & (b + c <= 1.0 + 1e-9))
        own, b, c = own[inside], b[inside], c[inside]
        z = corners[own, 0, 2] + b * one[own, 2] + c * two[own, 2]
        at = pixel[inside, 1] * shape[1] + pixel[inside, 0]
        order = np.lexsort((z, at))
        last = order[np.diff(at[order], append=-1) != 0]  # at each pixel
        last = last[z[last] > nearest[at[last]]]
        face[at[last]], nearest[at[last]] = own[last], z[last]
        weights[at[last]] = np.column_stack([1.0 - b - c, b, c])[last]
    return face.reshape(shape), weights.reshape(*shape, 3), nearest.reshape(shape)


def outlines(at: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Edges (e, 2) of facets (f, 3) that are drawn, see `draw_surfaces`; `at` (k, 3) as placed by a view."""
    normal = unit(np.cross(at[facets[:, 1]] - at[facets[:, 0]], at[facets[:, 2]] - at[facets[:, 0]]))
    pairs = np.sort(facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    key = pairs[:, 0] * len(at) + pairs[:, 1]
    order = np.argsort(key, kind="stable")
    _, first, count = np.unique(key[order], return_index=True, return_counts=True)
    a, b = (normal[order[np.minimum(first + k, len(order) - 1)] // 3] for k in (0, 1))
    drawn = (count != 2) | ((a * b).sum(axis=1) < np.cos(SHARPEST)) | ((a[:, 2] > 0.0) != (b[:, 2] > 0.0))
    return pairs[order[first[drawn]]]


def unhidden(edges: np.ndarray, depth: np.ndarray) -> np.ndarray:
    """The parts (s, 2, 2) of edges (e, 2, 3) in front of what an image shows at `depth` (h, w), all in pixels."""
    from scipy.ndimage import minimum_filter

    number = np.ceil(np.abs(np.diff(edges[..., :2], axis=1)).max(axis=(1, 2))).astype(int) + 2
    own, place = spans(np.zeros(len(edges), int), number)
    t = (place / (number[own] - 1))[:, None]
    at = (1.0 - t) * edges[own, 0] + t * edges[own, 1]
    column, row = np.clip(at[:, :2].astype(int), 0, np.array(depth.shape)[::-1] - 1).T
    shown = at[:, 2] >= minimum_filter(depth, 3, mode="constant", cval=-np.inf)[row, column] - 1.0
    begins = shown & ~np.append(False, shown[:-1] & (own[1:] == own[:-1]))
    stops = shown & ~np.append(shown[1:] & (own[1:] == own[:-1]), False)
    return np.stack([at[begins, :2], at[stops, :2]], axis=1)


def draw_edges(axes: Any, at: np.ndarray, facets: np.ndarray, **style: Any) -> None:
    """Draw the `outlines` of facets, hidden ones as well, by default as thin grey lines below everything."""
    from matplotlib.collections import LineCollection

    axes.add_collection(LineCollection(at[outlines(at, facets), :2], **{
        "colors": COLOURS["still"], "linewidth": 0.7, "zorder": 1} | style))


def colours_of(low: float, top: float, colours: str, logarithmic: bool = False) -> Any:
    """What colours values from `low` to `top`, as draw_colours takes it."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm, Normalize

    return ScalarMappable((LogNorm if logarithmic else Normalize)(low, top), colours)


def by_value(values: np.ndarray, image: Any) -> Paint:
    """Colours of values (f, 3) at the corners of facets, with norm and colour map of an `image`."""
    return lambda face, weights: image.to_rgba((values[face] * weights).sum(axis=1))


def plain(colour: str) -> Paint:
    """One colour."""
    from matplotlib.colors import to_rgb

    return lambda face, _: np.tile(to_rgb(colour), (len(face), 1))
