"""What all pictures share: colours, axes, placement of points and surfaces, colour bars and names."""

import textwrap
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.mesh.elements import normals
from ddmpi.pictures.views import (
    Paint,
    Surface,
    View,
    blocks,
    is_seen,
    outlines,
    rasterise,
    rim,
    unhidden,
)
from ddmpi.results.tables import Results
from ddmpi.surface.side import unit
from ddmpi.system.numbers import scaled_unit
from ddmpi.system.provenance import NO_MATPLOTLIB, has_matplotlib

STYLE = {
    "font.size": 10,
    "axes.titlesize": 11,
    "figure.titlesize": 11,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "legend.frameon": False,
    "figure.constrained_layout.use": True,
    "savefig.dpi": 160,
    "axes.axisbelow": True,
    "text.parse_math": False,  # names of bodies may look like formulas
}

COLOURS = {
    "normal": "#1b4f8f",
    "tangential": "#c8501e",
    "bound": "#7a7a7a",
    "rigid": "#404040",
    "still": "#9aa0a8",
    "moved": "#c8501e",
    "force": "#8c1a3a",
}

FILLED = {
    "still": "#f4f5f7",
    "moved": "#f6dfd4",
    "patch": "#cdd2d8",
}
"""Fill colours of bodies and rigid partners."""
ZONES = {
    "open": "#b4bac2",
    "slip": "#e8954a",
    "stick": "#5fa35f",
}
"""Colours of nodes by their status."""

RESOLVED = 1e-6
"""Gaps and slips below this fraction of the largest displacement are drawn as zero, and so are resultants below this
fraction of the sum of the nodes' forces, as of a shaft in its hub."""

BESIDE: dict[str, Any] = {
    "loc": "upper left",
    "bbox_to_anchor": (1.0, 1.0),
}
"""Legends to the right of the axes."""
ARROW = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0}  # from place to place
NAMED = 40  # largest number of bodies with names in pictures
PIXELS = 1100  # pixels of the longer side of a picture of surfaces
WIDE = 1.4  # pictures wider than this times their height have the colour bar below
MARGIN = 0.04  # margin around bodies, and of rigid surfaces beyond the part that bodies may touch, over the extent
RUNS = 3  # zlib's strategy for runs of equal bytes
LETTERS = 12  # letters of titles for each inch
LAST = 0.6  # words stand left of places beyond this fraction of a picture's width: a colour bar may follow
ARM = 0.18  # length of the axes x, y and z over the picture's longer side

LIGHT, DARKEST, PLAIN = np.array([-0.35, 0.5, 0.8]), 0.8, 0.96
"""Direction of the light on solids (right, up, towards the eye), and the brightness in the shade; of colours that stand
for values, which have to be those of the colour bar."""


def start_drawing() -> Any:
    """matplotlib.pyplot, to draw into files. Not collective. Raises InputError where matplotlib is not installed."""
    if not has_matplotlib():
        raise InputError(f"no pictures can be drawn; {NO_MATPLOTLIB}")
    import matplotlib

    if Path(matplotlib.matplotlib_fname()).resolve().parent == Path.cwd():
        matplotlib.rcdefaults()  # settings of the current folder, which may be anybody's, may start LaTeX
    matplotlib.use("agg")
    from matplotlib import pyplot

    return pyplot


def save(figure: Any, file: Path | IO[bytes], metadata: Mapping[str, str] | None = None) -> None:
    """Write a figure as PNG with text chunks. Not collective.

    It is drawn once: `savefig` draws a figure with a layout twice. Run lengths halve the time of compression, and the
    file is a sixth larger.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from PIL import Image
    from PIL.PngImagePlugin import PngInfo

    dpi, chunks = STYLE["savefig.dpi"], PngInfo()
    for key, text in (metadata or {}).items():
        chunks.add_text(key, text)
    figure.set_dpi(dpi)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    picture = Image.fromarray(np.asarray(canvas.buffer_rgba())).convert("RGB")
    picture.save(file, format="png", pnginfo=chunks, dpi=(dpi, dpi), compress_type=RUNS)


class Sheet:
    """A picture of bodies: figure and axes, the view of the bodies, and how it maps places to the figure.

    Attributes
    ----------
    figure, axes : of matplotlib
    view, place : the view of the bodies, and its method that maps places
    size : extent of the bodies (m)
    rigid : surfaces of rigid partners, in space
    """

    def __init__(
        self,
        results: Results,
        everything: np.ndarray,
        rigid: Sequence[Surface] = (),
        pixels: int = PIXELS,
    ) -> None:
        """For places (k, d) and the surfaces of `rigid_parts`; with `pixels` along the longer side of surfaces. Raises
        InputError where a cut meets no body."""
        self.view = View(results.points, results.output)
        self.place = self.view.place
        self.size = results.extent
        self._pixels = pixels
        self._depth, self._origin, self._pixel = np.zeros((0, 0)), np.zeros(3), 1.0
        at = self.place(np.vstack([everything, *(surface.at for surface in rigid)]))[:, :2]
        self.figure, self.axes = (self._with_arms if self.view.solid else self._with_scales)(
            results, at
        )
        self._fixed = list(self.axes.lines)
        self.meet(rigid)

    def _with_scales(self, results: Results, at: np.ndarray) -> tuple[Any, Any]:
        """Axes with scales for places (k, 2), and the axis of axisymmetric bodies if it is near."""
        near = results.axisymmetric and at[:, 0].min() <= np.ptp(at, axis=0).max()
        if near:
            at = np.vstack([at, at * (0.0, 1.0)])
        margin = MARGIN * np.ptp(at, axis=0).max()
        figure, axes = _figure(at.min(axis=0) - margin, at.max(axis=0) + margin)
        unit_of = results.units["length"]
        axes.set(xlabel=f"{'radius ' * results.axisymmetric}x ({unit_of})", ylabel=f"y ({unit_of})")
        if near:
            axes.axvline(0.0, color=COLOURS["rigid"], linewidth=0.8, linestyle="-.", zorder=1)
        return figure, axes

    def _with_arms(self, results: Results, at: np.ndarray) -> tuple[Any, Any]:
        """Axes without scales for places (k, 2), with arms along x, y and z that show their length."""
        low, high = at.min(axis=0), at.max(axis=0)
        arm, margin = round_down(ARM * (high - low).max()), 0.02 * (high - low).max()
        arms, text = arm * self.view.axes[:2].T, 0.2 * arm
        origin = low - (0.7 * arm, 0.0)
        if (
            (at < origin + arms.max(axis=0) + 2.0 * text).all(axis=1)
        ).any():  # an arm could run into the bodies
            origin = low - (max(arms[:, 0].max(), 0.0) + 1.5 * text, 0.0)
        ends = origin + arms
        below = np.vstack([ends, origin]).min(axis=0) - (text, 3.0 * text)
        low = np.minimum(low, below) - margin
        figure, axes = _figure(low, high + margin)
        axes.set_axis_off()
        for name, end in zip("xyz", ends, strict=True):
            if np.linalg.norm(end - origin) > 0.1 * arm:  # it does not point to the eye
                style = {"linewidth": 0.9, "color": COLOURS["rigid"], "mutation_scale": 7}
                axes.annotate("", end, origin, arrowprops=ARROW | style)
                axes.annotate(
                    name, end + text * unit(end - origin), ha="center", va="center", fontsize=9
                )
        factor, unit_of = scaled_unit(arm, results.units["length"])
        axes.annotate(
            f"arrows x, y, z: {arm / factor:g} {unit_of} long",
            (origin[0], below[1]),
            ha="left",
            va="bottom",
            fontsize=8,
        )
        return figure, axes

    def meet(self, rigid: Sequence[Surface]) -> None:
        """Draw rigid partners in the plane, hatched on the far side; in space they are shown with the next surfaces."""
        from matplotlib.patheffects import withTickedStroke

        self.rigid = rigid if self.view.solid else ()
        for surface in () if self.view.solid else rigid:
            self.axes.plot(
                *surface.at.T,
                color=COLOURS["rigid"],
                linewidth=1.4,
                zorder=2.5,
                path_effects=[withTickedStroke(angle=-135, linewidth=0.7)],
            )

    def show(self, surfaces: Sequence[Surface]) -> None:
        """Draw the visible surfaces and rigid partners, and their `outlines`."""
        if not (some := [*surfaces, *self.rigid]):
            return
        placed = [self.place(surface.at) for surface in some]
        beyond = [
            self.view.beyond(surface.at) if surface.beyond is None else surface.beyond
            for surface in some
        ]
        corners = np.concatenate(
            [
                np.column_stack([at, cut])[surface.facets]
                for at, cut, surface in zip(placed, beyond, some, strict=True)
            ]
        )
        number = [len(surface.facets) for surface in some]
        # normals of facets; those of thin surfaces face the eye, all others away from it are back faces
        across = unit(normals(corners[..., :3]))
        across[np.repeat([surface.thin for surface in some], number) & (across[:, 2] < 0.0)] *= -1.0
        low, high = corners[..., :2].min(axis=(0, 1)), corners[..., :2].max(axis=(0, 1))
        self._pixel = pixel = (high - low).max() / self._pixels
        self._origin = origin = np.append(low - pixel, 0.0)
        width, height = np.ceil((high - low) / pixel).astype(int) + 2
        seen = np.flatnonzero(across[:, 2] > 0.0)
        corners[..., :3] = (corners[..., :3] - origin) / pixel
        face, weights, self._depth = rasterise(corners[seen], (height, width))
        covered = face >= 0
        face = seen[face[covered]]
        ends, light = np.cumsum([0, *number]), np.ones(len(across))
        if self.view.solid:
            darkest = np.repeat([PLAIN if surface.plain else DARKEST for surface in some], number)
            light = darkest + (1.0 - darkest) * np.clip(across @ unit(LIGHT), 0.0, 1.0)
        colours = np.full((len(face), 4), 255, np.uint8)
        for block in blocks(len(face)):
            for surface, start, stop in zip(some, ends[:-1], ends[1:], strict=True):
                pixels = block.start + np.flatnonzero((face[block] >= start) & (face[block] < stop))
                seen_as = surface.paint(face[pixels] - start, weights[pixels])[:, :3]
                colours[pixels, :3] = 255.0 * light[face[pixels]][:, None] * seen_as
        image = np.zeros((height, width, 4), np.uint8)
        image[covered] = colours
        self.axes.imshow(
            image,
            origin="lower",
            interpolation="antialiased",
            zorder=2,
            extent=(origin[0], origin[0] + width * pixel, origin[1], origin[1] + height * pixel),
        )
        for at, cut, surface in zip(placed, beyond, some, strict=True):
            if surface.edges:
                edges = unhidden((outlines(at, surface.facets, cut) - origin) / pixel, self._depth)
                self.lines(
                    edges * pixel + origin[:2], colors=surface.edges, linewidth=0.6, zorder=3
                )

    def outline(self, at: np.ndarray, facets: np.ndarray, beyond: np.ndarray, **style: Any) -> None:
        """Draw the `outlines` of facets (f, 3), hidden ones as well, by default as thin grey lines below everything."""
        self.lines(
            outlines(self.place(at), facets, beyond)[..., :2],
            **{"colors": COLOURS["still"], "linewidth": 0.7, "zorder": 1} | style,
        )

    def facets(
        self, pieces: Sequence[tuple[np.ndarray, np.ndarray, np.ndarray]], image: Any
    ) -> None:
        """Draw facets (f, d) between places (k, d), lines or surfaces, by values (k,) in the colours of an image."""
        if self.view.solid:
            self.show(
                [
                    Surface(
                        at, facets, by_value(values[facets], image), thin=True, plain=True, edges=""
                    )
                    for at, facets, values in pieces
                    if len(facets)
                ]
            )
            for at, facets, _ in pieces:
                ends = (self.place(at)[rim(at, facets)[0]] - self._origin) / self._pixel
                self.lines(
                    unhidden(ends, self._depth) * self._pixel + self._origin[:2],
                    colors="black",
                    linewidth=0.6,
                    zorder=3,
                )
        for at, facets, values in () if self.view.solid else pieces:
            self.lines(
                at[facets],
                colors=image.to_rgba(values[facets].mean(axis=1)),
                linewidth=2.4,
                zorder=5,
            )

    def lines(self, ends: Any, **style: Any) -> None:
        """Draw lines, each through places (·, 2) of the sheet."""
        from matplotlib.collections import LineCollection

        self.axes.add_collection(LineCollection(ends, **{"capstyle": "round"} | style))

    def shows(self, at: np.ndarray, beyond: np.ndarray | None = None) -> np.ndarray:
        """Whether places (k, d) are visible; those `beyond` (k,) the cut, by default as they are drawn, are not."""
        beyond = self.view.beyond(at) if beyond is None else beyond
        return (beyond <= 0.0) & is_seen((self.place(at) - self._origin) / self._pixel, self._depth)

    def arrows(
        self, at: np.ndarray, vectors: np.ndarray, colour: str, width: float = 0.004
    ) -> None:
        """Draw vectors (k, d) as arrows from places (k, d)."""
        ends = (self.place(places)[:, :2].T for places in (at, vectors))
        self.axes.quiver(
            *np.concatenate([*ends]),
            angles="xy",
            scale_units="xy",
            scale=1.0,
            width=width,
            zorder=6,
            color=colour,
        )

    def write(self, names: Sequence[str], at: Sequence[np.ndarray], below: bool = False) -> None:
        """Write the names of bodies at places (d,), or a little `below` them, unless there are more than NAMED."""
        from matplotlib.patheffects import withStroke

        for name, place in zip(names, at, strict=True) if len(names) <= NAMED else ():
            self.axes.annotate(
                name,
                self.place(place)[:2],
                (0, -9 * below),
                textcoords="offset points",
                ha="center",
                va="center",
                fontsize=7,
                color="#50555c",
                zorder=7,
                path_effects=[withStroke(linewidth=2, foreground="#ffffffc0")],
            )

    def colours(self, image: Any, label: str, extend: str = "neither") -> None:
        """Draw the colour bar of an image, below wide pictures."""
        from matplotlib.colors import LogNorm

        wide = np.ptp(self.axes.get_xlim()) > WIDE * np.ptp(self.axes.get_ylim())
        self.figure.colorbar(
            image,
            ax=self.axes,
            label=label,
            format="%g" if isinstance(image.norm, LogNorm) else None,
            extend=extend,
            shrink=0.85,
            aspect=40 if wide else 25,
            orientation="horizontal" if wide else "vertical",
        )

    def title(self, words: str, end: str = "") -> None:
        """Write `words` above the picture; lines that are too long for it are broken after `end`, or where they may."""
        width, lines = int(LETTERS * self.figure.get_figwidth()), []
        for line in words.split("\n"):
            parts = line.split(end) if end and len(line) > width else [line]
            lines += [piece for part in parts for piece in textwrap.wrap(part, width)]
        self.figure.suptitle("\n".join(lines))

    def clear(self) -> None:
        """Remove surfaces and lines, as before the next frame of an animation."""
        for artist in (*self.axes.collections, *self.axes.lines, *self.axes.images):
            if artist not in self._fixed:
                artist.remove()


def _figure(low: np.ndarray, high: np.ndarray) -> tuple[Any, Any]:
    """A figure and axes whose size suits the rectangle between two corners (2,)."""
    import matplotlib.pyplot as plt

    width, height = high - low
    size = (
        (8.6, 1.4 + 8.0 * height / width)
        if width > WIDE * height
        else (1.8 + 6.2 * width / height, 6.4)
    )
    figure, axes = plt.subplots(figsize=np.clip(size, (4.8, 3.0), (10.0, 8.0)), layout="compressed")
    axes.set(aspect="equal", xlim=(low[0], high[0]), ylim=(low[1], high[1]))
    return figure, axes


def colours_of(low: float, top: float, colours: str, logarithmic: bool = False) -> Any:
    """A colour map of values from `low` to `top`, for `Sheet.colours`."""
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import LogNorm, Normalize

    return ScalarMappable((LogNorm if logarithmic else Normalize)(low, top), colours)


def limits(values: np.ndarray, area: np.ndarray, share: float) -> tuple[float, float]:
    """The values (k,) that a `share` of the area (k,) exceeds, and that it does not."""
    order = np.argsort(values)
    covered = np.cumsum(area[order])
    low, high = values[order][
        np.searchsorted(covered, covered[-1] * np.array([1.0 - share, share]))
    ]
    return float(low), float(high)


def signed_colours(low: float, top: float, colours: str) -> Any:
    """`colours_of` values from 0 on; where some are below it, colours of both signs that are white at zero."""
    if low >= 0.0:
        return colours_of(0.0, top or 1.0, colours)
    return colours_of(-max(-low, top), max(-low, top), "PuOr")


def by_value(values: np.ndarray, image: Any) -> Paint:
    """Colours of values (f, 3) at the corners of facets, with norm and colour map of an `image`."""
    return lambda face, weights: image.to_rgba((values[face] * weights).sum(axis=1))


def filled(kind: str) -> Paint:
    """A colour of FILLED."""
    from matplotlib.colors import to_rgb

    return lambda face, _: np.tile(to_rgb(FILLED[kind]), (len(face), 1))


def mark(axes: Any, at: np.ndarray, words: str) -> None:
    """Mark the place (2,) of the largest value, with `words`."""
    from matplotlib.patheffects import withStroke

    axes.plot(
        *at,
        marker="o",
        markersize=5,
        markerfacecolor="none",
        markeredgecolor="black",
        markeredgewidth=1.1,
        zorder=8,
        path_effects=[withStroke(linewidth=2.5, foreground="white")],
    )
    left, right = axes.get_xlim()
    side = "right" if at[0] > left + LAST * (right - left) else "left"  # words end there, or begin
    axes.annotate(
        words,
        at,
        (6 if side == "left" else -6, 6),
        textcoords="offset points",
        ha=side,
        fontsize=8,
        zorder=8,
        bbox={"facecolor": "#ffffffd8", "edgecolor": "none", "pad": 1.2},
    ).set_in_layout(False)


def above(axes: Any, handles: Sequence[Any], columns: int = 3) -> None:
    """A legend above axes."""
    axes.legend(
        handles=handles, ncols=columns, loc="lower center", bbox_to_anchor=(0.5, 1.0), fontsize=8
    )


def zone_legend(counts: Mapping[str, int], **style: Any) -> list[Any]:
    """Entries of a legend for the zones that have nodes."""
    from matplotlib.patches import Patch

    return [
        Patch(
            facecolor=colour,
            label=f"{zone} ({counts[zone]} node{'s' * (counts[zone] > 1)})",
            **style,
        )
        for zone, colour in ZONES.items()
        if counts[zone]
    ]


def rounded(value: float) -> str:
    """Three digits, without an exponent below a million."""
    return f"{float(f'{value:.3g}'):g}"


def round_down(factor: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed `factor`."""
    power = 10.0 ** np.floor(np.log10(factor))
    return float(power * max(d for d in (1, 2, 5) if d * power <= factor * (1 + 1e-12)))
