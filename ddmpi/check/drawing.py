"""Pictures of an unsolved scene: meshes, groups, loads and clamps; contacts with their pairing and gaps; numbers of the
faces of drawings."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from itertools import islice
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import cKDTree

from ddmpi.body.loads import VOLUME
from ddmpi.check.nearby import Boundary, Missing
from ddmpi.interface.interface import Interface
from ddmpi.mesh.boundary import creases, segments
from ddmpi.mesh.elements import facet_shares
from ddmpi.mesh.mesh import Mesh
from ddmpi.pictures.bodies import middles, skin_of
from ddmpi.pictures.moved import rigid_parts
from ddmpi.pictures.sheet import (
    COLOURS,
    FILLED,
    NAMED,
    PIXELS,
    STYLE,
    Sheet,
    above,
    colours_of,
    rounded,
    save,
    start_drawing,
)
from ddmpi.pictures.views import Paint, Skin, Surface, View, in_space
from ddmpi.results.tables import Results, together
from ddmpi.scene.scene import Settled
from ddmpi.surface.side import nodal
from ddmpi.system.files import LONGEST, writing
from ddmpi.system.numbers import scaled_unit

PLACES = 16
"""Approximate number of loads and clamps along the bodies' extent."""

ARROW = 0.08
"""The length of the longest arrow over it."""

GROUPS = ("#7fa8d1", "#e3b272", "#c4a8dc", "#d9cf7a", "#a9b8c6", "#c9a184", "#8f9bd9", "#e6b3cf")
"""Colours of groups, by name: none is near the green of clamps or the red of loads."""

MARKERS = "s^>DoPv*ph"  # markers of the kinds of supports
HELD = "#1f6f4a"  # colour of clamps
MISSING = "#e00000"  # colour of missing contacts
SPACED = 4.0  # edges of cells are drawn if on all bodies half of them are so many pixels from the opposite corner
DRAWN = 24  # the numbers are not drawn of more bodies, as each takes two pictures
EDGEWISE = 0.1  # facets are not numbered whose normal points less to the eye


@dataclass(frozen=True)
class Looked:
    """A body with the data of its pictures and words."""

    mesh: Mesh
    boundary: Boundary
    loads: list[
        tuple[str, np.ndarray]
    ]  # nodal loads (nv, d) by group (N), that of the volume force is VOLUME
    supports: list[tuple[str, np.ndarray]]  # clamps and foundations in words, and their nodes
    acting: list[tuple[str, str]]  # the groups of supports and loads, with both in words
    memory: float  # bytes of its factors or of multigrid, beside its matrix; an estimate
    words: list[str]  # lines of the page
    doubt: str  # a warning of its mesh, or nothing


Bodies = Mapping[str, Looked]
"""What is looked at, by name."""


class Plan(Sheet):
    """A picture of bodies as they are drawn, with words and marks on them."""

    def label(self, text: str, at: np.ndarray, offset: Sequence[float] = (0.0, 0.0)) -> None:
        """Write a text at a place (d,), or an offset in points from it."""
        self.axes.annotate(
            text,
            self.place(at)[:2],
            offset,
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=7,
            zorder=8,
            bbox={"boxstyle": "round,pad=0.15", "facecolor": "#ffffffb0", "edgecolor": "none"},
        )

    def show_groups(self, bodies: Bodies, most: float = np.inf) -> list[str]:
        """Draw meshes with their groups in colours by name, and write the names, with those of `bodies` that have one,
        unless there are more than `most`. The groups whose names are not seen.

        A name stands at the visible facet that is farthest from the rim of its group, and from the names so far.
        """
        groups = [
            (called, name, body.boundary, some)
            for called, body in bodies.items()
            for name, some in body.boundary.groups.items()
            if some.any()
        ]
        names = dict.fromkeys(name for body in bodies.values() for name in body.boundary.groups)
        colours = {name: GROUPS[k % len(GROUPS)] for k, name in enumerate(names)}
        self.show(meshed(self, list(bodies.values()), colours))
        far = np.full(2, 1e3 * max(np.abs(body.mesh.points).max() for body in bodies.values()))
        hidden = list[str]()
        taken = [far]
        for called, name, boundary, some in groups:
            points = bodies[called].mesh.points
            middle = boundary.at[some].mean(axis=1)
            normal = boundary.normal[some]
            if not self.view.solid:
                self.lines(
                    points[segments(boundary.facets[some])],
                    colors=colours[name],
                    linewidth=2.4,
                    zorder=4,
                )
            if len(groups) > most:
                continue
            facing = (
                np.where(self.shows(middle), self.place(normal)[:, 2], 0.0)
                if self.view.solid
                else np.ones(len(middle))
            )
            seen = np.flatnonzero(facing > max(EDGEWISE, facing.max() / 2.0))
            if not len(seen):
                hidden.append(name)
                continue
            flat = self.place(middle[seen])[:, :2]
            rim = creases(points, boundary.facets[some][:, : points.shape[1]], normal).rim
            away = cKDTree(np.vstack([*taken, self.place(points[rim].mean(axis=1))[:, :2]])).query(
                flat
            )[0]
            k = seen[np.argmax(away)]
            taken.append(self.place(middle[k])[:2])
            self.label(
                f"{called}." * bool(called and self.view.solid) + name,
                middle[k],
                *(() if self.view.solid else (-9.0 * normal[k],)),
            )
        return hidden

    def mark(self, at: np.ndarray, marker: str) -> None:
        """Draw markers at places (k, d) that are not hidden."""
        self.axes.plot(
            *self.place(at[self.shows(at)])[:, :2].T, marker, color=HELD, markersize=4.0, zorder=7
        )


def seen_from(results: Results, behind: bool, **output: Any) -> Results:
    """Results that are drawn as their scene asks for, with other entries of its `output`, or from the opposite side
    `behind`."""
    scene = results.scene
    asked = scene["output"] | output
    if behind:
        x, y, z = -View(results.points, asked).axes[2]
        asked = asked | {"view": np.rad2deg([np.arctan2(y, x), np.arcsin(z)]).tolist()}
    return replace(results, summary=results.summary | {"scene": scene | {"output": asked}})


def _plan(results: Results, behind: bool = False) -> Plan:
    """A plan of all bodies, with rigid partners and room for arrows; from the opposite side `behind`."""
    results = seen_from(results, behind)
    room = ARROW * results.extent * np.eye(results.dimension)
    return Plan(
        results,
        np.vstack([results.points + step for step in (*room, *-room)]),
        rigid_parts(results),
    )


def draw(
    folder: Path,
    scene: Settled,
    bodies: Bodies,
    interfaces: Sequence[Interface],
    missing: Sequence[Missing],
    number: int = 0,
    drawers: int = 1,
) -> list[str]:
    """Write the pictures, or a share of them for several `drawers`; all names. Not collective. Raises OutputError."""
    plt = start_drawing()
    results = as_results(scene, bodies, interfaces)
    pictures: dict[str, Callable[[], Any]] = {"bodies.png": lambda: draw_bodies(results, bodies)}
    if scene.dimension > 2:
        pictures["bodies_behind.png"] = lambda: draw_bodies(results, bodies, behind=True)
    if scene.contact or missing:
        pictures["contacts.png"] = lambda: draw_contacts(results, interfaces, missing)
    copies = {body.name for body in scene.body if body.copy}  # with the numbers of their originals
    numbered = {
        name: body for name, body in bodies.items() if body.mesh.faces and name not in copies
    }
    for k, (name, body) in enumerate(numbered.items()):  # of solids from both sides
        for behind in range(scene.dimension - 1) if len(numbered) <= DRAWN else ():
            file = (
                f"faces_{name if len(name.encode()) < LONGEST - 20 else k}{'_behind' * behind}.png"
            )
            pictures[file] = partial(
                draw_faces, as_results(scene, {name: body}, []), name, body, bool(behind)
            )
    with plt.rc_context(STYLE):
        for name, make in islice(pictures.items(), number, None, drawers):
            with writing(folder / name):
                save(make(), folder / name)
        plt.close("all")
    return list(pictures)


def as_results(scene: Settled, bodies: Bodies, interfaces: Sequence[Interface]) -> Results:
    """Bodies and contacts at rest, in the form of results, for the pictures of a run."""
    meshes = [body.mesh for body in bodies.values()]
    plain_scene = scene.resolved()
    starts = np.cumsum([0, *(len(mesh.points) for mesh in meshes)])
    points = np.concatenate([mesh.points for mesh in meshes])
    tables = {}
    surfaces = {}
    for interface in interfaces:
        lines = interface.lines
        outline = interface.drawing.outline
        at = dict(zip("xyz", lines.xy.T, strict=False))
        normal = dict(zip(("nx", "ny", "nz"), interface.normal[lines.row].T, strict=False))
        tables[interface.name] = at | normal | {"area": lines.area}
        surfaces[interface.name] = {
            "points": in_space(outline.xy),
            "cells": outline.cells,
            "gap": outline.shares @ interface.gap,
        }
    return Results(
        {
            "title": scene.title,
            "bodies": dict.fromkeys(bodies),
            "contacts": {interface.name: {"slave": interface.slave} for interface in interfaces},
            "scene": plain_scene,
            "steps": [],
            "units": scene.units,
        },
        tables,
        {},
        {},
        {},
        {
            "points": points,
            "displacement": np.zeros_like(points),
            "cells": together(
                [mesh.triangles + start for mesh, start in zip(meshes, starts, strict=False)]
            ),
            "body": np.repeat(np.arange(len(meshes)), [len(mesh.triangles) for mesh in meshes]),
        },
        surfaces=surfaces,
    )


def draw_bodies(results: Results, bodies: Bodies, behind: bool = False) -> Any:
    """Meshes with their groups, loads and clamps; a figure."""
    plan = _plan(results, behind)
    looked = list(bodies.values())
    plan.show_groups(bodies, NAMED)
    inside = middles(results)
    words = _point_loads(plan, looked, results.units["stress"])
    words |= _point_weights(plan, looked, inside)
    ways = _mark_supports(plan, looked)
    _explain(plan, words, ways)
    if not plan.view.solid or sum(len(body.boundary.groups) for body in looked) > NAMED:
        plan.write(list(bodies), inside)
    plan.figure.suptitle(f"{results.heading()}bodies as drawn{', from behind' * behind}")
    return plan.figure


def _point_loads(plan: Plan, looked: Sequence[Looked], unit: str) -> dict[str, str]:
    """Draw loads on groups as arrows; by their colour the words of the legend, with the largest, in a `unit`."""
    arrows = load_arrows(looked, plan.size, unit)
    if arrows is None:
        return {}
    seen = plan.shows(arrows.tail)
    plan.arrows(arrows.tail[seen], arrows.along[seen], COLOURS["force"], width=0.0025)
    return {COLOURS["force"]: arrows.words}


def _point_weights(
    plan: Plan, looked: Sequence[Looked], inside: Sequence[np.ndarray]
) -> dict[str, str]:
    """Draw volume forces as arrows of one length at places `inside` of bodies; the words of the legend."""
    words = {}
    for at, body in zip(inside, looked, strict=True):
        for force in (f.sum(axis=0) for on, f in body.loads if on == VOLUME):
            length = ARROW * plan.size / (np.linalg.norm(force) or 1.0)
            plan.arrows(at[None], length * force[None], COLOURS["moved"])
            words = {COLOURS["moved"]: "volume forces"}
    return words


def _mark_supports(plan: Plan, looked: Sequence[Looked]) -> dict[str, str]:
    """Draw clamps and foundations; the marker of each kind."""
    markers: dict[str, str] = {}
    for body in looked:
        for how, nodes in body.supports:
            at, _ = thinned(body.mesh.points[nodes], plan.size / PLACES)
            plan.mark(at, markers.setdefault(how, MARKERS[len(markers) % len(MARKERS)]))
    return markers


def _explain(plan: Plan, words: Mapping[str, str], markers: Mapping[str, str]) -> None:
    """The legend, by colours of arrows and markers of supports."""
    from matplotlib.lines import Line2D

    arrows = [
        Line2D([], [], color=colour, marker=">", label=what) for colour, what in words.items()
    ]
    supports = [
        Line2D([], [], linestyle="", marker=marker, color=HELD, markersize=5, label=how)
        for how, marker in markers.items()
    ]
    above(plan.axes, [*arrows, *supports])


def draw_faces(results: Results, name: str, body: Looked, behind: bool) -> Any:
    """A body with the numbers of its faces; a figure. `results` are of this body alone."""
    numbered = replace(
        body.boundary, groups={face: body.boundary.groups[face] for face in body.mesh.faces}
    )
    plan = Plan(seen_from(results, behind, cut=None), results.points)
    hidden = plan.show_groups({"": replace(body, boundary=numbered)})
    what = ("curves", "faces")[body.mesh.dimension - 2]
    plan.figure.suptitle(
        f"{results.heading()}{name}: numbered {what}{', from behind' * behind}"
        + f"\nnot seen: {', '.join(hidden)}" * bool(hidden)
    )
    return plan.figure


def draw_contacts(
    results: Results, interfaces: Sequence[Interface], missing: Sequence[Missing]
) -> Any:
    """Contacts with their pairing and gaps, and missing ones; a figure."""
    from matplotlib.lines import Line2D

    plan = _plan(results)
    skin = skin_of(results)
    plan.rigid = []  # they would hide contacts
    gaps = np.concatenate(
        [np.zeros(int(not interfaces)), *(interface.gap for interface in interfaces)]
    )
    factor, unit_of = scaled_unit(np.abs(gaps).max(), results.units["length"])
    image = colours_of(
        gaps.min() / factor,
        gaps.max() / factor if gaps.any() else 1.0,
        "viridis" if gaps.any() else "Blues_r",
    )
    image.cmap = image.cmap.with_extremes(bad=MISSING)
    plan.outline(skin.extended(results.points), skin.facets, skin.beyond)
    parts = [
        (outline.xy, outline.cells, outline.shares @ interface.gap / factor)
        for interface in interfaces
        for outline in [interface.drawing.outline]
    ]
    for lack in missing:
        at = lack.facets.reshape(-1, lack.facets.shape[-1])
        parts.append(
            (at, np.arange(len(at)).reshape(lack.facets.shape[:2]), np.full(len(at), np.nan))
        )
    plan.facets(parts, image)
    for interface in interfaces:
        plan.lines(
            np.stack([plan.place(at)[:, :2] for at in interface.geometry.at], axis=1),
            colors=COLOURS["rigid"],
            linewidth=0.5,
            zorder=4,
        )
        if len(interfaces) <= NAMED:
            at = interface.lines.xy
            plan.label(interface.name, at[np.argmin(np.linalg.norm(at - at.mean(axis=0), axis=1))])
    if gaps.any():
        plan.colours(image, f"gap, negative where bodies overlap ({unit_of})")
    if missing:
        words = f"close enough to touch, in no contact ({len(missing)})"
        above(plan.axes, [Line2D([], [], color=MISSING, label=words)])
    plan.figure.suptitle(
        f"{results.heading()}contacts as drawn{', all touching' * (not gaps.any())}"
    )
    return plan.figure


def meshed(plan: Plan, bodies: Sequence[Looked], colours: Mapping[str, str]) -> list[Surface]:
    """The visible surfaces of bodies, in space in the colours of their groups; with the edges of cells, if these are
    SPACED on all bodies."""
    surfaces, heights = zip(*(_meshed(plan, body, colours) for body in bodies), strict=True)
    if any(len(height) and np.median(height) <= SPACED for height in heights):
        return list(surfaces)
    return [
        replace(surface, paint=_lined(surface.paint, height))
        for surface, height in zip(surfaces, heights, strict=True)
    ]


def _lined(paint: Paint, height: np.ndarray) -> Paint:
    """The colours with the edges of facets, whose corners are `height` (f, 3) away from the opposite edge (pixels)."""
    return lambda face, weights: (
        paint(face, weights)
        * np.where((height[face] * weights < 1.0).any(axis=1), 0.8, 1.0)[:, None]
    )


def _meshed(plan: Plan, body: Looked, colours: Mapping[str, str]) -> tuple[Surface, np.ndarray]:
    """The visible surface of a body, and how far (f, 3) the corners of facets are from the opposite edges (pixels)."""
    from matplotlib.colors import to_rgb

    skin = Skin(plan.view, body.mesh.points, body.mesh.triangles)
    paint = np.tile(to_rgb(FILLED["still"]), (len(skin.facets), 1))
    for name, some in body.boundary.groups.items() if plan.view.solid else ():
        paint[np.append(some, False)[skin.of]] = to_rgb(colours[name])  # nothing of a cut
    points = skin.extended(body.mesh.points)
    at = plan.place(points)[:, :2][skin.facets]
    sides = np.roll(at, 1, axis=1) - np.roll(at, -1, axis=1)  # opposite of the corners
    double = np.abs(sides[:, 0, 0] * sides[:, 1, 1] - sides[:, 0, 1] * sides[:, 1, 0])
    height = double[:, None] / np.linalg.norm(sides, axis=2).clip(1e-300) * PIXELS / plan.size
    return Surface(points, skin.facets, lambda face, _: paint[face], skin.beyond), height


def thinned(
    at: np.ndarray, size: float, *values: np.ndarray
) -> tuple[np.ndarray, list[np.ndarray]]:
    """Means (j, d) of the places (k, d) in cubes of a size, and the sums of values (k, …) there."""
    _, cube, count = np.unique(
        np.round((at - at.min(axis=0)) / size), axis=0, return_inverse=True, return_counts=True
    )
    sums = []
    for array in (at, *values):
        sums.append(np.zeros((len(count), *array.shape[1:])))
        np.add.at(sums[-1], cube.ravel(), array)
    return sums[0] / count[:, None], sums[1:]


def stresses(
    body: Looked, on: str, f: np.ndarray, size: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (k, d) on the group `on`, its load at them (Pa), and outward vectors; from nodal loads (nv, d)."""
    some = body.boundary.groups[on]
    facets = body.boundary.facets[some]
    normal = body.boundary.normal[some]
    nodes = np.unique(facets)
    area = nodal(facet_shares(body.mesh.points[facets], body.mesh.axisymmetric), facets, len(f))
    outward = nodal(np.repeat(normal[:, None], facets.shape[1], axis=1), facets, len(f))
    at, (force, around, outward) = thinned(
        body.mesh.points[nodes], size, f[nodes], area[nodes], outward[nodes]
    )
    return at, force / np.where(around > 0.0, around, np.inf)[:, None], outward


class Arrows(NamedTuple):
    """Arrows of loads.

    Attributes
    ----------
    words : what they are, with the largest
    tail, along : (k, d) where they begin, and vectors from there (m)
    owner : (k,) the numbers of their bodies
    """

    words: str
    tail: np.ndarray
    along: np.ndarray
    owner: np.ndarray


def load_arrows(looked: Sequence[Looked], extent: float, unit: str) -> Arrows | None:
    """Arrows of the loads on groups, to places where they point inward, else from these, beside an `extent` of bodies
    (m); None where there are no loads. The largest one is told in a `unit`."""
    loads = [
        (k, *stresses(body, on, f, extent / PLACES))
        for k, body in enumerate(looked)
        for on, f in body.loads
        if on != VOLUME
    ]
    if not loads:
        return None
    at, stress, outward = (np.vstack([each[i] for each in loads]) for i in (1, 2, 3))
    owner = np.concatenate([np.full(len(at), k) for k, at, *_ in loads])
    largest = np.linalg.norm(stress, axis=1).max()
    factor, unit = scaled_unit(largest, unit)
    along = ARROW * extent / (largest or 1.0) * stress
    inward = np.einsum("kd,kd->k", along, outward) < 0.0
    tail = at - np.where(inward, 1.0, 0.0)[:, None] * along
    return Arrows(f"loads, up to {rounded(largest / factor)} {unit}", tail, along, owner)
