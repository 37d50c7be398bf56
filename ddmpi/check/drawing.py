"""Pictures of a scene that is not solved: meshes, groups, loads and clamps; contacts with their pairing and gaps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.body.loads import VOLUME
from ddmpi.check.nearby import Boundary, Missing
from ddmpi.interface.interface import Interface
from ddmpi.mesh.boundary import segments
from ddmpi.mesh.elements import facet_shares
from ddmpi.mesh.mesh import Mesh
from ddmpi.results.fields import drawn_facets, linear_triangles, middles, skin
from ddmpi.results.frame import (
    ABOVE,
    COLOURS,
    FILLED,
    NAMED,
    STYLE,
    View,
    by_value,
    colours_of,
    draw_colours,
    draw_edges,
    draw_outline,
    map_of,
    owners,
    plain,
    rounded,
    start_drawing,
    surfaces,
    write_names,
)
from ddmpi.results.solids import PIXELS, Surface, draw_surfaces, rigid_surfaces, stage
from ddmpi.results.summary import units
from ddmpi.results.tables import Results
from ddmpi.scene.scene import Settled
from ddmpi.surface.side import nodal
from ddmpi.system.files import writing
from ddmpi.system.numbers import scaled_unit

PLACES, ARROW = 16, 0.08
"""Loads and clamps are drawn at about so many places along the bodies' extent, the longest arrow as this part of it."""

GROUPS = ("#7fa8d1", "#e3b272", "#8fc08a", "#c79ac7", "#d98f8f", "#a8a36b", "#79bdbd", "#b59a86")
"""Colours of groups, by name."""

MARKERS = "s^>DoPv*ph"
"""Of the ways in which clamps hold."""

HELD, MISSING = "#1f6f4a", "#e00000"
"""Colours of clamps, and of contacts that are not there."""

SPACED = 4.0
"""Lines between the nodes of cells are drawn if half of them are so many pixels away from the opposite corner."""

TRIED = 8
"""So many facets of a group are tried for a place at which its name is not hidden."""


@dataclass(frozen=True)
class Looked:
    """A body as its rank looks at it.

    Attributes
    ----------
    mesh, boundary : of the body
    loads : nodal loads (nv, d) by group, that of the volume force is VOLUME (N)
    supports : how each clamp and foundation holds its nodes, in words, and these
    memory : bytes of its factors, none for multigrid; an estimate
    words : what there is to say
    doubt : a warning of its mesh, or nothing
    """

    mesh: Mesh
    boundary: Boundary
    loads: list[tuple[str, np.ndarray]]
    supports: list[tuple[str, np.ndarray]]
    memory: float
    words: list[str]
    doubt: str


class Sheet:
    """One picture: its figure and axes, and how places are put on it.

    Attributes
    ----------
    view : from where it is seen; the plane is seen from the front
    size : extent of the bodies (m)
    solid : whether it is of solids
    """

    def __init__(self, results: Results, behind: bool = False) -> None:
        """With rigid partners; solids are seen from a corner, or from the opposite one `behind`."""
        self.solid, self._corners = results.dimension > 2, np.zeros((0, 3, 3))
        self.view, self.size = View(np.ptp(results.points, axis=0)), float(np.ptp(results.points, axis=0).max())
        self.view.axes = np.eye(3) if not self.solid else self.view.axes * [[1.0 - 2.0 * behind], [1.0],
                                                                            [1.0 - 2.0 * behind]]
        self._rigid = rigid_surfaces(results) if self.solid else []
        everything = np.vstack([results.points, *(each.at for each in self._rigid)])
        self.figure, self.axes = stage(results, everything, self.view) if self.solid else map_of(
            results, results.points, surfaces(results))
        at, margin = self.place(everything)[:, :2], ARROW * self.size
        low, high = at.min(axis=0) - margin, at.max(axis=0) + margin
        if self.solid:  # with the arms of coordinates
            low = np.minimum(low, [self.axes.get_xlim()[0], self.axes.get_ylim()[0]])
        self.axes.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]))

    def place(self, at: np.ndarray) -> np.ndarray:
        """Places (…, d) to the right, upwards, and towards the eye."""
        return self.view.place(_padded(at))

    def show(self, some: Sequence[Surface]) -> None:
        """Draw surfaces, and rigid partners with them."""
        some = [*self._rigid, *some]
        draw_surfaces(self.axes, self.view, some)
        corners = np.concatenate([self.place(each.at)[each.facets] for each in some])
        u, v = np.moveaxis(corners[:, 1:] - corners[:, :1], 1, 0)
        self._corners = corners[u[:, 0] * v[:, 1] > u[:, 1] * v[:, 0]]  # those that face the eye

    def shows(self, at: np.ndarray) -> np.ndarray:
        """Which places (k, d) nothing hides."""
        found = np.ones(len(at), bool)
        a, (u, v) = self._corners[:, 0], np.moveaxis(self._corners[:, 1:] - self._corners[:, :1], 1, 0)
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        for k, away in enumerate(self.place(at)[:, None] - a) if self.solid else ():
            b, c = ((away[:, 0] * v[:, 1] - away[:, 1] * v[:, 0]) / area,
                    (u[:, 0] * away[:, 1] - u[:, 1] * away[:, 0]) / area)
            before = b * u[:, 2] + c * v[:, 2] - away[:, 2] > 1e-3 * self.size
            found[k] = not (before & (b > 0.0) & (c > 0.0) & (b + c < 1.0)).any()
        return found

    def write(self, text: str, at: np.ndarray, offset: Sequence[float] = (0.0, 0.0)) -> None:
        """Write a text at a place (d,), or an offset in points from it."""
        self.axes.annotate(text, self.place(at)[:2], offset, textcoords="offset points", ha="center", va="center",
                           fontsize=7, zorder=8, bbox={"boxstyle": "round,pad=0.15", "facecolor": "#ffffffb0",
                                                       "edgecolor": "none"})

    def name(self, group: str, at: np.ndarray, normal: np.ndarray, number: int) -> None:
        """Write the name of a group, the how manieth that is, at one of its facets (f, d) with `normal` that is seen.

        It is the one in the middle; around rings names stand at different places.
        """
        away = np.linalg.norm(at - at.mean(axis=0), axis=1)
        order = np.argsort(away, kind="stable")[np.linspace(0, len(at) - 1, min(len(at), TRIED)).astype(int)]
        seen = order[(self.place(normal[order])[:, 2] > 0.1 * self.solid - 0.05) & self.shows(at[order])]
        ring = away.min() > 0.5 * away.max()
        for k in np.roll(seen, -3 * number * ring)[:1]:
            self.write(group, at[k], *(() if self.solid else (-9.0 * normal[k],)))

    def point(self, at: np.ndarray, vectors: np.ndarray, outward: np.ndarray, colour: str) -> None:
        """Draw vectors (k, d) that are not hidden as arrows: to places where they point inward, else from these."""
        inward = np.einsum("kd,kd->k", vectors, outward) < 0.0
        tail = at - np.where(inward, 1.0, 0.0)[:, None] * vectors
        seen = self.shows(tail)
        ends = (self.place(each[seen])[:, :2].T for each in (tail, vectors))
        self.axes.quiver(*np.concatenate([*ends]), angles="xy", scale_units="xy", scale=1.0, width=0.0025, zorder=6,
                         color=colour)

    def mark(self, at: np.ndarray, marker: str) -> None:
        """Draw markers at places (k, d) that are not hidden."""
        self.axes.plot(*self.place(at[self.shows(at)])[:, :2].T, marker, color=HELD, markersize=4.0, zorder=7)


def draw(folder: Path, scene: Settled, bodies: Mapping[str, Looked], interfaces: Sequence[Interface],
         missing: Sequence[Missing], number: int = 0, drawers: int = 1) -> list[str]:
    """Write the pictures into `folder`, or this one's share if several `drawers` do; the names of all. Not collective.
    Raises OutputError."""
    plt, results = start_drawing(), _as_results(scene, bodies, interfaces)
    pictures = {"bodies.png": lambda: draw_bodies(results, bodies)}
    if scene.dimension > 2:
        pictures["bodies_behind.png"] = lambda: draw_bodies(results, bodies, behind=True)
    pictures["contacts.png"] = lambda: draw_contacts(results, interfaces, missing)
    with plt.rc_context(STYLE):
        for name, make in islice(pictures.items(), number, None, drawers):
            with writing(folder / name):
                make().savefig(folder / name, pil_kwargs={"compress_level": 1})
        plt.close("all")
    return list(pictures)


def _as_results(scene: Settled, bodies: Mapping[str, Looked], interfaces: Sequence[Interface]) -> Results:
    """Bodies and contacts at rest, as the pictures of a run take them."""
    meshes, plain_scene = [each.mesh for each in bodies.values()], scene.resolved()
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    points = np.concatenate([_padded(mesh.points) for mesh in meshes])
    tables = {each.name: dict(zip("xyz", each.shown.xy.T, strict=False)) for each in interfaces}
    return Results({"title": scene.title, "bodies": dict.fromkeys(bodies), "scene": plain_scene, "steps": [],
                    "units": units(plain_scene, scene.dimension)}, tables, {}, {}, {}, {
        "points": points, "displacement": np.zeros_like(points),
        "cells": np.concatenate([mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]),
        "body": np.repeat(np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes])},
        facets={each.name: drawn_facets(each.shown) for each in interfaces})


def draw_bodies(results: Results, bodies: Mapping[str, Looked], behind: bool = False) -> Any:
    """Meshes with their groups, loads and clamps; a figure."""
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    sheet, looked, ways = Sheet(results, behind), list(bodies.values()), dict[str, int]()
    names = dict.fromkeys(group for each in looked for group in each.boundary.groups)
    colours = {name: GROUPS[k % len(GROUPS)] for k, name in enumerate(names)}
    sheet.show([_meshed(sheet, each, colours) for each in looked])
    groups = [(body, name, each, own) for body, each in bodies.items() for name, own in each.boundary.groups.items()
              if own.any()]
    for number, (body, name, each, own) in enumerate(groups):
        if not sheet.solid:
            lines = each.mesh.points[segments(each.boundary.facets[own])]
            sheet.axes.add_collection(LineCollection(lines, colors=colours[name], linewidth=2.4, zorder=4))
        if len(groups) <= NAMED:
            sheet.name(f"{body}.{name}" if sheet.solid else name, each.boundary.at[own].mean(axis=1),
                       each.boundary.normal[own], number)
    arrows = [_stresses(each, on, f, sheet.size / PLACES) for each in looked for on, f in each.loads if on != VOLUME]
    largest = max((np.linalg.norm(stress, axis=1).max() for _, stress, _ in arrows), default=0.0)
    for at, stress, outward in arrows:
        sheet.point(at, ARROW * sheet.size / (largest or 1.0) * stress, outward, COLOURS["force"])
    inside = [each.mesh.points.mean(axis=0) for each in looked] if sheet.solid else middles(
        results.points, linear_triangles(results.fields["cells"])[0], owners(results))
    weights = [(at, f.sum(axis=0)) for at, each in zip(inside, looked, strict=True)
               for on, f in each.loads if on == VOLUME]
    for at, force in weights:
        arrow = ARROW * sheet.size / (np.linalg.norm(force) or 1.0) * force
        sheet.point(at[None], arrow[None], arrow[None], COLOURS["moved"])
    for each in looked:
        for how, nodes in each.supports:
            at, _ = _thinned(each.mesh.points[nodes], sheet.size / PLACES)
            sheet.mark(at, MARKERS[ways.setdefault(how, len(ways)) % len(MARKERS)])
    factor, unit_of = scaled_unit(largest, results.summary["units"]["stress"])
    loads = {COLOURS["force"]: f"loads, up to {rounded(largest / factor)} {unit_of}" * bool(arrows),
             COLOURS["moved"]: "volume forces" * bool(weights)}
    sheet.axes.legend(handles=[
        *(Line2D([], [], color=colour, label=words) for colour, words in loads.items() if words),
        *(Line2D([], [], linestyle="", marker=MARKERS[k % len(MARKERS)], color=HELD, markersize=5, label=how)
          for how, k in ways.items())], ncols=3, **ABOVE)
    if not sheet.solid or len(groups) > NAMED:
        write_names(sheet.axes, list(bodies), [sheet.place(at)[:2] for at in inside])
    sheet.figure.suptitle(f"{results.heading()}bodies as drawn{', from behind' * behind}")
    return sheet.figure


def draw_contacts(results: Results, interfaces: Sequence[Interface], missing: Sequence[Missing]) -> Any:
    """Contacts with their pairing and gaps, and those that bodies are close enough to have; a figure."""
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    sheet, cells = Sheet(results), results.fields["cells"]
    gaps = np.concatenate([each.gap for each in interfaces])
    factor, unit_of = scaled_unit(np.abs(gaps).max(), results.summary["units"]["length"])
    image = colours_of(gaps.min() / factor, gaps.max() / factor or 1.0, "viridis" if gaps.any() else "Blues_r")
    if sheet.solid:
        draw_edges(sheet.axes, sheet.place(results.points), skin(cells)[0])
    else:
        draw_outline(sheet.axes, results.points, linear_triangles(cells)[0])
    shown = []
    for each in interfaces:
        lines, facets = each.shown, drawn_facets(each.shown)
        gap = each.gap[lines.row] / factor
        if sheet.solid:
            facets = facets[facets[:, 0] != facets[:, 1]]
            shown.append(Surface(lines.xy, facets, by_value(gap[facets], image), thin=True))
        else:
            sheet.axes.add_collection(LineCollection(lines.xy[facets], colors=image.to_rgba(gap[facets].mean(axis=1)),
                                                     linewidth=2.4, capstyle="round", zorder=5))
        if each.at is not None:
            sheet.axes.add_collection(LineCollection(np.stack([sheet.place(at)[:, :2] for at in each.at], axis=1),
                                                     colors=COLOURS["rigid"], linewidth=0.5, zorder=4))
        if len(interfaces) <= NAMED:
            sheet.write(each.name, lines.xy[np.argmin(np.linalg.norm(lines.xy - lines.xy.mean(axis=0), axis=1))])
    for lack in missing:
        if sheet.solid:
            corners = np.arange(lack.facets[..., 0].size).reshape(-1, 3)
            shown.append(Surface(lack.facets.reshape(-1, 3), corners, plain(MISSING), thin=True))
        else:
            sheet.axes.add_collection(LineCollection(lack.facets, colors=MISSING, linewidth=1.6, zorder=6))
    if shown:
        draw_surfaces(sheet.axes, sheet.view, shown)
    if gaps.any():
        draw_colours(sheet.figure, sheet.axes, image, f"gap, negative where bodies overlap ({unit_of})", "neither")
    if missing:
        words = f"close enough to touch, in no contact ({len(missing)})"
        sheet.axes.legend(handles=[Line2D([], [], color=MISSING, label=words)], **ABOVE)
    sheet.figure.suptitle(f"{results.heading()}contacts as drawn{', all touching' * (not gaps.any())}")
    return sheet.figure


def _padded(at: np.ndarray) -> np.ndarray:
    """Places (…, d) with three coordinates."""
    return np.pad(at, (*((0, 0),) * (at.ndim - 1), (0, 3 - at.shape[-1])))


def _meshed(sheet: Sheet, body: Looked, colours: Mapping[str, str]) -> Surface:
    """What is seen of a body, with the edges of its cells, and in space in the colours of its groups."""
    from matplotlib.colors import to_rgb

    boundary, mesh = body.boundary, body.mesh
    faces, cell = linear_triangles(boundary.facets if sheet.solid else mesh.triangles)
    paint = np.tile(to_rgb(FILLED["still"]), (len(faces), 1))
    for name, own in boundary.groups.items() if sheet.solid else ():
        paint[own[cell]] = to_rgb(colours[name])
    at = sheet.place(mesh.points)[:, :2][faces]
    sides = np.roll(at, 1, axis=1) - np.roll(at, -1, axis=1)  # opposite of the corners
    double = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    height = double[:, None] / np.linalg.norm(sides, axis=2) * PIXELS / sheet.size
    line = float(np.median(height) > SPACED)

    def colour(face: np.ndarray, weights: np.ndarray) -> np.ndarray:
        return paint[face] * np.where((height[face] * weights < line).any(axis=1), 0.8, 1.0)[:, None]

    return Surface(_padded(mesh.points), faces, colour)


def _thinned(at: np.ndarray, size: float, *values: np.ndarray) -> tuple[np.ndarray, list[np.ndarray]]:
    """Means (j, d) of the places (k, d) in cubes of a size, and the sums of values (k, …) there."""
    _, cube, count = np.unique(np.round((at - at.min(axis=0)) / size), axis=0, return_inverse=True, return_counts=True)
    sums = []
    for each in (at, *values):
        sums.append(np.zeros((len(count), *each.shape[1:])))
        np.add.at(sums[-1], cube.ravel(), each)
    return sums[0] / count[:, None], sums[1:]


def _stresses(body: Looked, on: str, f: np.ndarray, size: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Some places (k, d) on the group `on`, its load there (Pa), and which way is outward; from nodal loads (nv, d)."""
    own = body.boundary.groups[on]
    facets, normal = body.boundary.facets[own], body.boundary.normal[own]
    nodes, area = np.unique(facets), nodal(
        facet_shares(body.mesh.points[facets], body.mesh.axisymmetric), facets, len(f))
    outward = nodal(np.repeat(normal[:, None], facets.shape[1], axis=1), facets, len(f))
    at, (force, around, outward) = _thinned(body.mesh.points[nodes], size, f[nodes], area[nodes], outward[nodes])
    return at, force / np.where(around > 0.0, around, np.inf)[:, None], outward
