"""Pictures of solids: bodies as seen from a corner, without what is hidden, and contacts as seen from the front."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from ddmpi.results.fields import coloured, skin
from ddmpi.results.frame import (
    ABOVE,
    AT_REST,
    COLOURS,
    FILLED,
    MOVED,
    RESOLVED,
    TURNED_BY,
    WEAK,
    Paint,
    View,
    by_value,
    colours_of,
    draw_colours,
    draw_edges,
    magnify,
    map_of,
    outlines,
    owners,
    partners,
    plain,
    rasterise,
    round_down,
    rounded,
    unhidden,
    vectors,
    write_names,
)
from ddmpi.results.tables import Columns, Results, velocities_in
from ddmpi.surface.side import frames, unit
from ddmpi.system.numbers import scaled_unit

LIGHT, DARKEST = np.array([-0.35, 0.5, 0.8]), 0.8
"""Where light comes from, as the picture has right, up and towards the eye; and what is left in the shade."""

PIXELS = 1200
"""Of the longer side of a picture."""

ARM = 0.15
"""The arms along x, y and z are at most this part of the picture's longer side."""

AROUND = 1.25
"""A rigid surface is drawn beyond what may touch it, by this factor."""

FORCE = 0.15
"""Half of the largest resultant is drawn as this part of the bodies' extent."""

FACING, STRAIGHT = 0.4, 0.02
"""A contact is seen from the front if the mean of its normals is longer than the first, and is unrolled about an axis
if the mean square of their parts along it is at most the second. Directions whose cosine differs from 1 by less than
the second are those of x, y or z."""

LONG = 5.0
"""Contacts longer than this times their width are drawn one below the other."""

ARROWS = 16
"""Slip is drawn as about so many arrows along a contact."""

ZONES = {"open": "#e4e7ec", "slip": "#f0a860", "stick": "#7fb87f"}


@dataclass(frozen=True)
class Surface:
    """Triangles that a picture shows.

    Attributes
    ----------
    at : (k, 3) places (m)
    facets : (f, 3) of them, counter-clockwise as seen from outside
    paint : their colours
    thin : whether they are seen from inside, too
    edges : colour of their outlines
    """

    at: np.ndarray
    facets: np.ndarray
    paint: Paint
    thin: bool = False
    edges: str = "black"


def stage(results: Results, everything: np.ndarray, view: View) -> tuple[Any, Any]:
    """A figure and axes that suit places (k, 3), with arms along x, y and z that show their length."""
    at = view.place(everything)[:, :2]
    low, high = at.min(axis=0), at.max(axis=0)
    arm = round_down(ARM * (high - low).max())
    origin, margin = low - (0.7 * arm, 0.0), 0.02 * (high - low).max()
    ends = origin + arm * view.axes[:2].T
    low = np.minimum(low, np.vstack([ends, origin]).min(axis=0)) - margin - 0.35 * arm
    figure, axes = map_of(results, np.vstack([low, high + margin]))
    axes.set_axis_off()
    axes.set(xlim=(low[0], high[0] + margin), ylim=(low[1], high[1] + margin))
    for name, end in zip("xyz", ends, strict=True):
        axes.annotate("", end, origin, arrowprops={"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "linewidth": 0.9,
                                                   "color": COLOURS["rigid"], "mutation_scale": 7})
        axes.annotate(name, origin + 1.22 * (end - origin), ha="center", va="center", fontsize=9)
    factor, unit_of = scaled_unit(arm, results.summary["units"]["length"])
    axes.annotate(f"{arm / factor:g} {unit_of}", origin - (0.0, 0.35 * arm), ha="center", va="center", fontsize=8)
    return figure, axes


def draw_surfaces(axes: Any, view: View, surfaces: Sequence[Surface]) -> None:
    """Draw surfaces without what is hidden, and their outlines: edges between facets that meet at more than SHARPEST,
    those at the end of a surface, and those where it turns away from the eye."""
    from matplotlib.collections import LineCollection

    placed = [view.place(each.at) for each in surfaces]
    corners = np.concatenate([at[each.facets] for at, each in zip(placed, surfaces, strict=True)])
    number = [len(each.facets) for each in surfaces]
    across = unit(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    thin = np.repeat([each.thin for each in surfaces], number)
    across[thin & (across[:, 2] < 0.0)] *= -1.0
    low, high = corners[..., :2].min(axis=(0, 1)), corners[..., :2].max(axis=(0, 1))
    pixel = (high - low).max() / PIXELS
    origin = np.append(low - pixel, 0.0)
    width, height = np.ceil((high - low) / pixel).astype(int) + 2
    seen = np.flatnonzero(across[:, 2] > 0.0)
    face, weights, depth = rasterise((corners[seen] - origin) / pixel, (height, width))
    there = face >= 0
    face, weights = seen[face[there]], weights[there]
    colours, ends = np.zeros((len(face), 3)), np.cumsum([0, *number])
    for each, start, stop in zip(surfaces, ends[:-1], ends[1:], strict=True):
        own = (face >= start) & (face < stop)
        colours[own] = each.paint(face[own] - start, weights[own])[:, :3]
    light = np.clip(across[face] @ unit(LIGHT), 0.0, 1.0)
    image = np.zeros((height, width, 4))
    image[there] = np.column_stack([colours * (DARKEST + (1.0 - DARKEST) * light)[:, None], np.ones(len(face))])
    limits = axes.get_xlim(), axes.get_ylim()
    axes.imshow(image, origin="lower", interpolation="antialiased", zorder=2, extent=(
        origin[0], origin[0] + width * pixel, origin[1], origin[1] + height * pixel))
    axes.set(xlim=limits[0], ylim=limits[1])
    for at, each in zip(placed, surfaces, strict=True):
        lines = unhidden((at[outlines(at, each.facets)] - origin) / pixel, depth) * pixel + origin[:2]
        axes.add_collection(LineCollection(lines, colors=each.edges, linewidth=0.6, capstyle="round", zorder=3))


def rigid_surfaces(results: Results, scale: float = 0.0, time: float | None = None,
                   going: Mapping[str, np.ndarray] | None = None) -> list[Surface]:
    """Parts of rigid partners around what may touch them, as `frame.surfaces` in the plane."""
    found = []
    for rigid, contacts, moved in partners(results, time, going):
        for contact in contacts:
            at, facets = vectors(results.contacts[contact["name"]]), results.triangles(contact["name"])
            at = at.mean(axis=0) + AROUND * (at - at.mean(axis=0))
            normal, distance = rigid.facing(at)
            at, facets = at - distance[:, None] * normal, facets[:, ::-1]
            if np.isinf(rigid.bend):
                hull = ConvexHull(at @ frames(normal[:1])[0, 1:].T).vertices
                facets = np.stack([np.full(len(hull) - 2, hull[0]), hull[1:-1], hull[2:]], axis=1)
            found.append(Surface(at + scale * moved, facets, plain(COLOURS["patch"]), edges=COLOURS["still"]))
    return [each for each in found if len(each.facets)]


def draw_bodies(results: Results) -> Any:
    """The deformed bodies, coloured by von Mises stress, or by displacement if there is no stress; a figure."""
    (scale, shift), (facets, _) = magnify(results), skin(results.fields["cells"])
    values, quantity, unit_of = coloured(results, results.fields)
    own, moved = values[np.unique(facets)], np.linalg.norm(results.displacement(), axis=1).max()
    low, top = (0.0, np.percentile(own, 99.5)) if "von_mises" in results.fields else (own.min(), own.max())
    factor, unit_of = scaled_unit(own.max(), unit_of)
    still = results.points + shift
    at, partner = still + results.displacement(scale), rigid_surfaces(results, scale)
    view = View(np.ptp(at, axis=0))
    figure, axes = stage(results, np.vstack([still, at, *(each.at for each in partner)]), view)
    image = colours_of(low / factor, top / factor or 1.0, "viridis")
    draw_edges(axes, view.place(still), facets)
    draw_surfaces(axes, view, [*partner, Surface(at, facets, by_value(values[facets] / factor, image))])
    draw_colours(figure, axes, image, f"{quantity} ({unit_of})", "max" if own.max() > top else "neither")
    factor, unit_of = scaled_unit(moved, results.summary["units"]["length"])
    figure.suptitle(f"{results.heading(True)}displacement × {scale:g}, largest {rounded(moved / factor)} {unit_of}")
    return figure


def draw_error(results: Results) -> Any:
    """The estimated discretization error of the tetrahedra at the boundaries of bodies; a figure."""
    (facets, cell), errors = skin(results.fields["cells"]), results.fields["error"]
    top, view = errors.max() or 1.0, View(np.ptp(results.points, axis=0))
    figure, axes = stage(results, results.points, view)
    image = colours_of(1e-3 * top, top, "magma_r", logarithmic=True)
    values = np.maximum(errors[cell], 1e-3 * top)[:, None].repeat(3, axis=1)
    draw_surfaces(axes, view, [Surface(results.points, facets, by_value(values, image))])
    draw_colours(figure, axes, image, "estimated error, over the mean (energy norm per volume)", "min")
    figure.suptitle(f"{results.heading()}estimated discretization error "
                    f"{results.summary['discretization_error']['energy_norm']:.2g} of the energy norm")
    return figure


def draw_mechanism(results: Results, mechanism: dict[str, Any]) -> Any:
    """The bodies as they stand, and as the `mechanism`, the content of mechanism.json, would move them; a figure."""
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    points, names, owner = results.points, list(results.summary["bodies"]), owners(results)
    facets = skin(results.fields["cells"])[0]
    centres = np.array([points[owner == k].mean(axis=0) for k in range(len(names))])
    velocities, going = velocities_in(mechanism, names, centres)
    u = velocities[owner, :3] + np.cross(velocities[owner, 3:], points - centres[owner])
    speed = np.linalg.norm(u, axis=1)
    turning, fastest = np.linalg.norm(velocities[:, 3:], axis=1).max(), max([speed.max(), *map(np.linalg.norm,
                                                                                                going.values())])
    step = min(MOVED * np.ptp(points, axis=0).max() / fastest, TURNED_BY / max(turning, 1e-300))
    moves = (np.bincount(owner, speed > AT_REST * fastest) > 0)[owner[facets[:, 0]]]
    at, partner = points + step * u, [*rigid_surfaces(results), *rigid_surfaces(results, step, going=going)]
    view = View(np.ptp(points, axis=0))
    figure, axes = stage(results, np.vstack([points, at, *(each.at for each in partner)]), view)
    draw_surfaces(axes, view, [*partner, *(Surface(at, facets[some], plain(FILLED[kind])) for some, kind in (
        (~moves, "still"), (moves, "moved")) if some.any())])
    draw_edges(axes, view.place(points), facets[moves], zorder=4)
    arrows = view.place(np.stack([centres, centres + step * velocities[:, :3]]))[..., :2]
    axes.quiver(*arrows[0].T, *(arrows[1] - arrows[0]).T, angles="xy", scale_units="xy", scale=1.0, width=0.004,
                zorder=5, color=COLOURS["force"])
    write_names(axes, names, arrows[1], below=True)
    axes.legend(handles=[Line2D([], [], color=COLOURS["still"], linewidth=0.9, label="as the bodies stand"),
                         Patch(facecolor=FILLED["moved"], edgecolor="black", label="as they would move, not to scale")],
                ncols=2, **ABOVE)
    figure.suptitle(results.heading() + "\n".join(textwrap.wrap(mechanism["reason"], int(11 * figure.get_figwidth())))
                    .replace("$", r"\$"))
    return figure


def draw_contacts(results: Results) -> Any:
    """All contacts where the bodies stand, of which edges are drawn: pressures as colours, and resultants; a figure."""
    from matplotlib.collections import LineCollection
    from matplotlib.lines import Line2D

    view, units = View(np.ptp(results.points, axis=0)), results.summary["units"]
    figure, axes = stage(results, results.points, view)
    draw_edges(axes, view.place(results.points), skin(results.fields["cells"])[0])
    contacts = results.summary["contacts"]
    pressures = {name: table["normal_stress"] for name, table in results.contacts.items()}
    low, top = (extreme([extreme(each, initial=0.0) for each in pressures.values()]) for extreme in (np.min, np.max))
    factor, unit_of = scaled_unit(max(top, -low), units["stress"])
    image = colours_of(low / factor, top / factor or 1.0, "Blues" if low >= 0.0 else "PuOr")
    shown = {name: found for name in pressures if len(found := results.triangles(name))}
    draw_surfaces(axes, view, [Surface(vectors(results.contacts[name]), found, by_value(
        pressures[name][found] / factor, image), thin=True) for name, found in shown.items()])
    largest = max(float(np.linalg.norm(contact["force"])) for contact in contacts.values())
    size, lines = FORCE * np.ptp(results.points, axis=0).max(), []
    for name, table in results.contacts.items():
        force, weight = np.array(contacts[name]["force"], float), np.abs(table["normal_force"])
        if weight.any() and np.linalg.norm(force) > WEAK * largest:
            at = weight @ vectors(table) / weight.sum()
            lines.append(view.place(at + np.outer((-1.0, 1.0), size / largest * force))[:, :2])
    axes.add_collection(LineCollection(lines, colors=COLOURS["force"], linewidth=1.6, zorder=6))
    times, of_force = scaled_unit(largest, units["force"])
    if lines:
        words = f"resultants through the middles of pressures, largest {rounded(largest / times)} {of_force}"
        axes.legend(handles=[Line2D([], [], color=COLOURS["force"], label=words)], **ABOVE)
    draw_colours(figure, axes, image, f"{'pressure' if low >= 0.0 else 'normal stress'} ({unit_of})", "neither")
    counts = (f"{sum(contact[zone] for contact in contacts.values())} {zone}" for zone in ("open", "slip", "stick"))
    figure.suptitle(f"{results.heading(True)}contact forces; nodes: {', '.join(counts)}")
    return figure


def draw_contact(results: Results, name: str) -> Any:
    """Pressure, friction with arrows of slip, zones, and gap or slip on the contact `name`, seen from the front; a
    figure."""
    import matplotlib.pyplot as plt
    from matplotlib.collections import LineCollection

    table, facets, summary = results.contacts[name], results.triangles(name), results.summary
    at, labels, along = flatten(table, facets)
    asked = next(each for each in summary["scene"]["contact"] if each["name"] == name)
    visible = RESOLVED * summary["displacement_max"]
    gaps, slips = (np.abs(table[what]).max(initial=0.0) > visible for what in ("gap", "slip"))
    holds = asked["friction"]["law"] != "none" or asked.get("kind") == "bonded"
    maps = [("pressure", table["normal_stress"], "stress", "Blues"), None,
            *([("friction", table["tangential_stress"], "stress", "Oranges")] if holds else []),
            ("slip", table["slip"], "length", "Purples") if slips and holds and not gaps else
            ("gap", gaps * table["gap"], "length", "Greens")]
    width, height = np.ptp(at.reshape(-1, 2), axis=0)
    columns = 1 if width > LONG * height or (width > 2.0 * height and not holds) else 2 if holds else 3
    rows = len(maps) // columns
    tall = np.clip((9.6 / columns - 1.4) * height / width, 0.8, 4.2) + 0.8
    figure, grid = plt.subplots(rows, columns, figsize=(9.6, rows * tall + 0.5), sharex=True, sharey=True,
                                layout="compressed", squeeze=False)
    ends = boundary_of(at, facets)
    for axes, each in zip(grid.ravel(), maps, strict=True):
        if each:
            what, values, quantity, colours = each
            factor, unit_of = scaled_unit(np.abs(values).max(initial=0.0) or summary["displacement_max"],
                                          summary["units"][quantity])
            values = values[facets].ravel() / factor
            image = colours_of(min(values.min(initial=0.0), 0.0), values.max(initial=0.0) or 1.0,
                               "PuOr" if (values < -RESOLVED * np.abs(values).max(initial=0.0)).any() else colours)
            axes.tripcolor(*at.reshape(-1, 2).T, np.arange(len(values)).reshape(-1, 3), values, shading="gouraud",
                           norm=image.norm, cmap=image.cmap, rasterized=True)
            figure.colorbar(image, ax=axes, label=f"{what} ({unit_of})", aspect=15, pad=0.02)
            if what == "friction" and slips:
                _draw_slip(axes, at, along, facets, table, summary["units"]["length"])
        else:
            _draw_zones(axes, at, table["status"][facets], summary["contacts"][name])
        axes.add_collection(LineCollection(ends, colors=COLOURS["still"], linewidth=0.7))
        axes.set(aspect="equal", xlabel=f"{labels[0]} ({summary['units']['length']})",
                 ylabel=f"{labels[1]} ({summary['units']['length']})")
        axes.margins(0.03)
        axes.label_outer()
    of_one = f" of {name}" if len(results.contacts) > 1 else ""
    figure.suptitle(f"{results.heading(True)}contact{of_one}")
    return figure


def flatten(table: Columns, facets: np.ndarray) -> tuple[np.ndarray, tuple[str, str], np.ndarray]:
    """Where the corners of facets (f, 3) are drawn (f, 3, 2) (m), what the two coordinates are, and unit vectors
    (l, 2, 3) along them at the nodes.

    What faces one way by and large is seen along its mean normal. What goes around an axis is unrolled, and cut where
    the contact has its largest hole.
    """
    at, normal, area = vectors(table), vectors(table, "n"), table["area"]
    mean = area @ normal / area.sum()
    second = np.einsum("l,li,lj->ij", area, normal, normal) / area.sum()
    least, axes = np.linalg.eigh(second)
    if np.linalg.norm(mean) > FACING or least[0] > STRAIGHT:
        front = unit(mean) if mean.any() else axes[:, 2]
        k = int(np.abs(front).argmax())
        if abs(front[k]) > 1.0 - STRAIGHT:
            along = np.delete(np.eye(3), k, axis=0)
            names = "xyz".replace("xyz"[k], "")
        else:
            right = unit(np.cross([0.0, 0.0, 1.0], front)) if abs(front[2]) < 0.9 else unit(np.cross(
                [0.0, 1.0, 0.0], front))
            along, names = np.stack([right, np.cross(front, right)]), ""
        labels = names or ["along ({:.2g}, {:.2g}, {:.2g})".format(*(each + 0.0)) for each in along]
        return (at @ along.T)[facets], (labels[0], labels[1]), np.broadcast_to(along, (len(at), 2, 3))
    axis = axes[:, 0] * np.sign(axes[np.abs(axes[:, 0]).argmax(), 0])
    across = np.eye(3) - normal[:, :, None] * normal[:, None, :] - np.outer(axis, axis)  # distances from its normal
    middle = np.linalg.lstsq(across.sum(axis=0), np.einsum("lij,lj->i", across, at), rcond=None)[0]
    first = unit(np.cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    away = at - middle
    angle = np.arctan2(away @ np.cross(axis, first), away @ first)
    order = np.sort(angle)
    holes = np.diff(order, append=order[0] + 2.0 * np.pi)
    angle = np.mod(angle - order[(holes.argmax() + 1) % len(order)] + 1e-9, 2.0 * np.pi)[facets]
    behind = np.ptp(angle, axis=1) > np.pi
    angle[behind] += np.where(angle[behind] < np.pi, 2.0 * np.pi, 0.0)
    radial = away - np.outer(away @ axis, axis)
    radius = float(np.linalg.norm(radial, axis=1).mean())
    name = "xyz"[np.abs(axis).argmax()] if np.abs(axis).max() > 1.0 - STRAIGHT else "along the axis"
    return (np.stack([radius * angle, (at @ axis)[facets]], axis=2), ("around the axis", name),
            np.stack([np.cross(axis, unit(radial)), np.broadcast_to(axis, at.shape)], axis=1))


def boundary_of(at: np.ndarray, facets: np.ndarray) -> np.ndarray:
    """Edges (e, 2, 2) that belong to one facet (f, 3) only, where their corners are drawn (f, 3, 2)."""
    pairs = facets[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2)
    _, number, count = np.unique(np.sort(pairs, axis=1), axis=0, return_inverse=True, return_counts=True)
    ends = np.stack([at, np.roll(at, -1, axis=1)], axis=2).reshape(-1, 2, 2)
    return ends[count[number.ravel()] == 1]


def _draw_zones(axes: Any, at: np.ndarray, status: np.ndarray, counts: dict) -> None:
    """Colour the parts of facets (f, 3, 2) that are nearest to their corners by the status (f, 3) of these."""
    from matplotlib.collections import PolyCollection
    from matplotlib.patches import Patch

    after, before, middle = np.roll(at, -1, axis=1), np.roll(at, 1, axis=1), at.mean(axis=1, keepdims=True)
    parts = np.stack([at, (at + after) / 2, np.broadcast_to(middle, at.shape), (at + before) / 2], axis=2)
    axes.add_collection(PolyCollection(parts.reshape(-1, 4, 2), facecolors=[ZONES[each] for each in status.ravel()],
                                       edgecolors="face", linewidth=0.3, rasterized=True))
    axes.legend(handles=[Patch(facecolor=colour, edgecolor="#b5b5b5", label=f"{zone} ({counts[zone]})")
                         for zone, colour in ZONES.items() if counts[zone]], ncols=3, **ABOVE)


def _draw_slip(axes: Any, at: np.ndarray, along: np.ndarray, facets: np.ndarray, table: Columns, length: str) -> None:
    """Draw the slip of some nodes that slip as arrows; see `flatten`."""
    nodes, first = np.unique(facets, return_index=True)
    place, slip = at.reshape(-1, 2)[first], vectors(table, "slip_")[nodes]
    arrows = np.einsum("lci,li->lc", along[nodes], slip)
    size = np.ptp(place, axis=0).max() / ARROWS
    cell = np.round((place - place.min(axis=0)) / size).astype(int)
    off = np.linalg.norm(place - place.min(axis=0) - size * cell, axis=1)
    order = np.lexsort((off, *cell.T, table["status"][nodes] != "slip"))
    _, some = np.unique(cell[order], axis=0, return_index=True)
    some = order[some]
    some = some[table["status"][nodes[some]] == "slip"]
    if not len(some):
        return
    longest = np.linalg.norm(arrows[some], axis=1).max()
    axes.quiver(*place[some].T, *arrows[some].T, angles="xy", scale_units="xy", scale=longest / size, width=0.003,
                color=COLOURS["rigid"], zorder=4, clip_on=False).set_in_layout(False)
    factor, length = scaled_unit(longest, length)
    axes.set_title(f"arrows: slip, up to {rounded(longest / factor)} {length}", fontsize=8)


DRAWN = (draw_mechanism, draw_bodies, draw_contacts, draw_contact, draw_error)
