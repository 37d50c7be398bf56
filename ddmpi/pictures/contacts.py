"""Pictures of contacts: all of them on the bodies, and each contact of solids as maps of its surface."""

from collections.abc import Mapping, Sequence
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from ddmpi.mesh.mesh import signed_measures
from ddmpi.pictures.bodies import middles, skin_of
from ddmpi.pictures.moved import (
    FACING,
    STRAIGHT,
    apart,
    directions,
    outward,
    painted_by,
    pressed,
    rigid_parts,
)
from ddmpi.pictures.scales import pressure_ends
from ddmpi.pictures.sheet import (
    ARROW,
    COLOURS,
    RESOLVED,
    ZONES,
    Sheet,
    above,
    filled,
    mark,
    rounded,
    signed_colours,
    zone_legend,
)
from ddmpi.pictures.views import Surface, View, rim
from ddmpi.results.fields import linear_parts, owners, vectors
from ddmpi.results.tables import STATUS, Columns, Results, chains, drawn_rows
from ddmpi.sets import magnitude
from ddmpi.surface.side import unit
from ddmpi.system.numbers import QUARTER, crossed, moment, scaled_unit

WIDEST = {2: 0.3, 3: 0.6}
"""Length of half of the largest resultant over a body's size, the root of its area or volume, by dimension; in the
plane the largest pressure has 0.8 of it."""

WEAK = 0.01  # resultants below this fraction of the largest are not drawn
ASIDE = 0.03  # distance of resultants on one line, over the height of the picture

MAPS = {
    "apart": 1e-3,  # flats are apart if they are, over the extent of the contact
    "long": 5.0,  # maps of contacts longer than this times their width are arranged in one column
    "arrows": 16,  # approximate number of arrows of slip along a contact
    "small": 0.5,  # maps of contacts closed over at most this fraction of their extent show that and as much around
}
"""How the surfaces of contacts are laid out."""


def draw_contacts(results: Results) -> Any:
    """All contacts on the undeformed bodies: normal stresses, resultants, and in the plane zones; a figure.

    In the plane a pressure is drawn as an area into the contact's first body, tension into the second. Solids are drawn
    apart, with the pressure painted on either side. A resultant is drawn on its line of action, with its middle at the
    contact, of solids with its end on the first body there, unless the line misses it; one that would cover another
    stands beside it.
    """
    d = results.dimension
    parts, cell = linear_parts(results.fields["cells"], d)
    sizes = np.abs(signed_measures(results.points, parts))
    measure = np.bincount(results.fields["body"][cell], sizes)
    size = WIDEST[d] * float(np.median(measure ** (1.0 / d)))
    forces, largest = _resultants(results, size)
    factor, unit_of = scaled_unit(largest, results.units["force"])
    counted, legend = "", list[Any]()
    if forces:
        words = f"resultants on the first body, largest {rounded(largest / factor)} {unit_of}"
        legend.append(Line2D([], [], color=COLOURS["force"], marker=">", label=words))
    if results.dimension == 2:
        sheet, shade = _draw_profiles(results, size, list(forces.values()))
        contacts = results.summary["contacts"].values()
        counts = {zone: sum(contact[zone] for contact in contacts) for zone in ZONES}
        legend = [shade, *legend, *zone_legend(counts)]
    else:
        sheet, forces, counted = _draw_painted(results, forces)
    width = ASIDE * np.ptp(sheet.axes.get_ylim())
    for ends in _aside([sheet.place(ends)[:, :2] for ends in forces.values()], width):
        style = ARROW | {"linewidth": 1.6, "color": COLOURS["force"]}
        sheet.axes.annotate("", *ends[::-1], annotation_clip=False, zorder=6, arrowprops=style)
    if legend:
        above(sheet.axes, legend, 2 + (sheet.figure.get_figwidth() > sheet.figure.get_figheight()))
    sheet.title(f"{results.heading(True)}contact forces{counted}", ", ")
    return sheet.figure


def _stresses(results: Results, tables: Mapping[str, Columns]) -> tuple[float, str, float, str]:
    """The largest normal stress of contacts, what it is called, and the number and the name of its unit."""
    stresses = np.nan_to_num(np.concatenate([table["normal_stress"] for table in tables.values()]))
    kind = "pressure" if stresses.min(initial=0.0) >= 0.0 else "normal stress"
    top = np.abs(stresses).max(initial=0.0)
    return top, kind, *scaled_unit(top, results.units["stress"])


def _draw_profiles(
    results: Results, size: float, forces: Sequence[np.ndarray]
) -> tuple[Sheet, Patch]:
    """Bodies in the plane with the normal stresses along contacts, the largest 0.8 `size` (m) high, and zones; with room
    for `forces`. The sheet, and what the legend says of the stresses."""
    top, kind, factor, unit_of = _stresses(results, results.contacts)
    areas, rims, zones, colours = _profiles(results, 0.8 * size / (top or 1.0))
    sheet = Sheet(results, np.vstack([results.points, *areas, *forces]), rigid_parts(results))
    sheet.show([Surface(results.points, skin_of(results).facets, filled("still"))])
    edge, face = COLOURS["normal"], COLOURS["normal"] + "60"
    sheet.axes.add_collection(PolyCollection(areas, facecolor=face, edgecolor="none", zorder=4))
    ends = PolyCollection(
        rims, closed=False, facecolor="none", edgecolor=edge, linewidth=0.6, zorder=4
    )
    sheet.axes.add_collection(ends)
    sheet.lines(zones, colors=colours, linewidth=2.2, capstyle="butt", zorder=5)
    sheet.figure.set_figheight(sheet.figure.get_figheight() + 0.5)  # for the legend
    sheet.write(list(results.summary["bodies"]), middles(results))
    words = f"{kind}, largest {rounded(top / factor)} {unit_of}"
    return sheet, Patch(facecolor=face, edgecolor=edge, label=words)


def _draw_painted(
    results: Results, forces: Mapping[str, np.ndarray]
) -> tuple[Sheet, dict[str, np.ndarray], str]:
    """Solids apart, with the pressures painted on both sides of contacts. The sheet, the ends (2, 3) of `forces` on it,
    and what the title says of the largest pressure."""
    skin = skin_of(results)
    shown = {contact["name"]: results.contacts[contact["name"]] for contact in pressed(results)}
    top, kind, factor, unit_of = _stresses(results, shown)
    shifts = apart(results, View(results.points, results.output))
    off = np.array([shifts[name] for name in results.summary["bodies"]])
    at = skin.extended(results.points + off[owners(results)])
    least, most = pressure_ends(results)
    image = signed_colours(least / factor, most / factor, "YlOrRd")
    painted = list(painted_by(results, shown, shifts, image, factor))
    surfaces = [surface for surface, _ in painted]
    sheet = Sheet(results, np.vstack([at[skin.beyond <= 0.0], *(each.at for each in surfaces)]))
    sheet.show([Surface(at, skin.facets, filled("still"), skin.beyond), *surfaces])
    ends = "both" if least < 0.0 else "max"
    sheet.colours(image, f"{kind} ({unit_of})", ends if most < top else "neither")
    first = {contact["name"]: contact["bodies"][0] for contact in results.scene["contact"]}
    # the first body is pushed by an arrow that ends at the contact
    on_first = {
        name: np.stack([ends[0], ends.mean(axis=0)]) + shifts[first[name]]
        for name, ends in forces.items()
    }
    if not top:
        return sheet, on_first, ""
    name = max(shown, key=lambda each: np.nan_to_num(shown[each]["normal_stress"]).max(initial=0.0))
    return sheet, on_first, _mark_largest(sheet, painted, unit_of, name)


def _mark_largest(
    sheet: Sheet, painted: Sequence[tuple[Surface, np.ndarray]], unit_of: str, name: str
) -> str:
    """Mark the largest pressure, which is on the contact `name`, where it is seen; what the title says of it."""
    places = np.vstack([surface.at for surface, _ in painted])
    beyond = np.concatenate([surface.beyond for surface, _ in painted])
    values = np.concatenate([pressures for _, pressures in painted])
    words = f"{rounded(values.max())} {unit_of}"
    seen = np.flatnonzero((values >= values.max()) & sheet.shows(places, beyond))
    if len(seen):
        mark(sheet.axes, sheet.place(places[seen[0]])[:2], words)
    hidden = "" if len(seen) else " (out of sight)"
    return f", largest pressure {words} at {name}{hidden}" * bool(values.max() > 0.0)


def _resultants(results: Results, size: float) -> tuple[dict[str, np.ndarray], float]:
    """By contact the ends (2, d) of resultants, half of the largest as long as `size` (m); the largest (N)."""
    arrows, tables, contacts = {}, results.contacts, results.summary["contacts"]
    largest = max(float(np.linalg.norm(contact["force"])) for contact in contacts.values())
    sizes = {
        name: np.hypot(table["normal_force"], table["tangential_force"])
        for name, table in tables.items()
    }
    weak = max(WEAK * largest, RESOLVED * max(values.sum() for values in sizes.values()))
    for name, table in tables.items():
        force = np.array(contacts[name]["force"], float)
        if np.linalg.norm(force) > weak:
            xy = vectors(table)
            # the line of action: r × F = M, nearest to the centre c at c + F × (M − c × F)/F·F
            centre = sizes[name] @ xy / sizes[name].sum()
            left = np.atleast_1d(
                contacts[name]["moment"] - moment(centre[None], force[None], results.axisymmetric)
            )
            at = centre - crossed(left[None], force[None])[0] / (force @ force)
            if np.linalg.norm(at - centre) <= np.ptp(xy, axis=0).max() + size:
                arrows[name] = at + np.outer((-1.0, 1.0), size / largest * force)
    return arrows, largest


def _aside(arrows: list[np.ndarray], width: float) -> list[np.ndarray]:
    """Arrows (2, 2) from place to place; those that would lie on earlier ones, moved sideways by `width` or more."""
    drawn: list[np.ndarray] = []
    for ends in arrows:
        along = unit(ends[1] - ends[0])
        across = along @ QUARTER
        across *= 1.0 if tuple(along) > (0.0, 0.0) else -1.0  # the same of opposite arrows
        on = [
            other
            for other in drawn
            if (other @ along).min() < (ends @ along).max()
            and (ends @ along).min() < (other @ along).max()
        ]
        while any((np.abs((other - ends[0]) @ across) < 0.9 * width).all() for other in on):
            ends = ends + width * across
        drawn.append(ends)
    return drawn


def _profiles(
    results: Results,
    scale: float,
) -> tuple[list[np.ndarray], list[np.ndarray], list[np.ndarray], list[str]]:
    """Normal stresses along contacts in the plane as areas (·, 2), `scale` (m) for each unit, and their rims; the part
    (3, 2) of a contact that is each node's, and its colour by status."""
    areas, rims, zones, colours = [], [], [], []
    for name in results.contacts:
        table, facets = drawn_rows(results.contacts[name], results.facets[name])
        for chain in chains(facets):
            at = vectors(table)[chain]
            heights = scale * np.nan_to_num(table["normal_stress"])[chain, None]
            ends = at - heights * vectors(table, "n")[chain]
            edges = np.vstack([at[:1], (at[1:] + at[:-1]) / 2, at[-1:]])
            areas.append(np.vstack([at, ends[::-1]]))
            rims.append(ends if chain[0] == chain[-1] else np.vstack([at[:1], ends, at[-1:]]))
            zones += [edges[[k, k + 1]] for k in range(len(chain))]
            colours += [ZONES[status] for status in table["status"][chain]]
    return areas, rims, zones, colours


def draw_maps(results: Results, name: str) -> Any:
    """Pressure, zones, friction with arrows of slip and over its bound, and gap, if there is any, on a contact; a
    figure."""
    surface, cells, units = results.surfaces[name], results.cells(name), results.units
    table, visible = results.contacts[name], RESOLVED * results.summary["displacement_max"]
    lie = directions(vectors(table, "n"), table["area"])
    at, labels, along = flatten(surface["points"], cells, *lie)
    gaps, slips = (np.abs(surface[what]).max(initial=0.0) > visible for what in ("gap", "slip"))
    maps = _maps(results, name, gaps)
    edges, owner = rim(surface["points"], cells)
    ends = at[owner[:, None], (cells[owner, None] == edges[:, :, None]).argmax(axis=2)]
    low, high = _shown(at, surface["status"][cells] != STATUS.index("open"))
    near = ((at >= low) & (at <= high)).all(axis=2).any(axis=1)
    at, cells = at[near], cells[near]
    figure, grid = _grid(len(maps), *(high - low))
    for axes in grid.ravel()[len(maps) :]:
        axes.remove()
    for axes, panel in zip(grid.ravel(), maps, strict=False):
        if panel:
            what, field, quantity, colours = panel
            span, most = _ends_of(results, name, field)
            factor, unit_of = scaled_unit(
                most or results.summary["displacement_max"], units.get(quantity, quantity)
            )
            values = surface[field][cells].ravel() / factor
            scale = np.array(span) / factor, colours
            _draw_values(axes, at, values, scale, f"{what} ({unit_of})", unit_of)
            if what == "friction" and slips:
                _draw_slip(axes, at, along, cells, surface, units["length"])
        else:
            _draw_zones(axes, at, surface["status"][cells], results.summary["contacts"][name])
        axes.add_collection(LineCollection(ends, colors=COLOURS["still"], linewidth=0.7))
        axes.set(
            aspect="equal",
            xlabel=f"{labels[0]} ({units['length']})",
            ylabel=f"{labels[1]} ({units['length']})",
            xlim=(low[0], high[0]),
            ylim=(low[1], high[1]),
        )
        axes.label_outer()
    columns = grid.shape[1]
    if len(maps) % columns:  # there is none below
        grid.ravel()[len(maps) - columns].xaxis.set_tick_params(labelbottom=True)
    of_one = f" of {name}" if len(results.contacts) > 1 else ""
    bears = np.any(surface["pressure"])
    figure.suptitle(f"{results.heading(True)}contact{of_one}{'' if bears else ': open everywhere'}")
    return figure


def _maps(results: Results, name: str, gaps: bool) -> list[tuple[str, str, str, str] | None]:
    """The maps of a contact: words, field, quantity and colours of each; None for that of zones."""
    surface = results.surfaces[name]
    stress = surface["pressure"]
    tension = -stress.min(initial=0.0) > RESOLVED * np.abs(stress).max(initial=0.0)
    maps: list[tuple[str, str, str, str] | None] = []
    if np.any(stress):
        maps.append(("normal stress" if tension else "pressure", "pressure", "stress", "YlOrRd"))
    maps.append(None)
    if np.any(surface["friction"]):
        kinds = {contact["name"]: contact.get("kind") for contact in results.scene["contact"]}
        what = "tangential stress" if kinds[name] == "bonded" else "friction"
        maps.append((what, "friction", "stress", "Blues"))
        if np.any(surface.get("utilisation", 0.0)):  # none in earlier results
            maps.append(("friction / bound", "utilisation", "%", "Purples"))
    if gaps:
        maps.append(("gap", "gap", "length", "Greens"))
    return maps


def _grid(number: int, width: float, height: float) -> tuple[Any, np.ndarray]:
    """A figure and axes for a `number` of maps that are so wide and so high (m)."""
    long = width > MAPS["long"] * height or (width > 2.5 * height and number < 4)
    columns = 1 if long or number == 1 else 2
    columns += number == 3 and width < 0.8 * height
    rows = -(-number // columns)
    tall = np.clip((9.6 / columns - 1.6) * height / width, 0.8, 4.2) + 0.55
    return plt.subplots(
        rows,
        columns,
        figsize=(9.6, rows * tall + 0.5),
        sharex=True,
        sharey=True,
        layout="compressed",
        squeeze=False,
    )


def _ends_of(results: Results, name: str, field: str) -> tuple[tuple[float, float], float]:
    """Where the colours of a field begin and end in the maps of all `pressed` contacts, or of all others if this one is
    bonded; and its largest size in them."""
    shown = {contact["name"] for contact in pressed(results)}
    alike = [each for each in results.surfaces if (each in shown) == (name in shown)]
    values = np.concatenate([np.zeros(1), *(results.surfaces[each][field] for each in alike)])
    most = float(np.nanmax(np.abs(values)))
    if field == "pressure" and name in shown:
        return pressure_ends(results), most
    least = float(np.nanmin(values))
    return (least if least < -RESOLVED * most else 0.0, float(np.nanmax(values))), most


def _draw_values(
    axes: Any,
    at: np.ndarray,
    values: np.ndarray,
    scale: tuple[np.ndarray, str],
    label: str,
    unit_of: str,
) -> None:
    """Colour cells (c, 3, 2) by values (3 c,) at their corners, with a bar, and mark the largest; `scale` are the ends of
    colours and their name."""
    (low, top), places = scale[0], at.reshape(-1, 2)
    image = signed_colours(low, top, scale[1])
    extend = ("neither", "max", "both")[bool(values.max() > top) * (1 + (low < 0.0))]
    axes.tripcolor(
        *places.T,
        np.arange(len(values)).reshape(-1, 3),
        values,
        shading="gouraud",
        norm=image.norm,
        cmap=image.cmap,
        rasterized=True,
    )
    axes.figure.colorbar(image, ax=axes, label=label, aspect=15, pad=0.02, extend=extend)
    mark(axes, places[np.argmax(values)], f"{rounded(values.max())} {unit_of}")


def _shown(at: np.ndarray, closed: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Corners (2,) of what maps show of facets (f, 3, 2) that are `closed` (f, 3) at some corners: all, or if these are
    a small part, them with their surroundings."""
    low, high = at.min(axis=(0, 1)), at.max(axis=(0, 1))
    margin = 0.03 * (high - low).max()
    if closed.any():
        least, most = at[closed].min(axis=0), at[closed].max(axis=0)
        if (most - least <= MAPS["small"] * (high - low)).all():
            margin = max((most - least).max(), margin)
            low, high = np.maximum(low, least - margin), np.minimum(high, most + margin)
            margin *= 0.06
    return low - margin, high + margin


def flatten(
    points: np.ndarray, cells: np.ndarray, mean: np.ndarray, least: np.ndarray, axes: np.ndarray
) -> tuple[np.ndarray, tuple[str, str], np.ndarray]:
    """Where the corners of cells (c, 3) between `points` (n, 3) are drawn (c, 3, 2) (m), what the two coordinates are,
    and unit vectors (n, 2, 3) along them at the points. The contact's normals have `directions`.

    What faces one way by and large is seen along its mean normal. Flats that face each other's back stand side by side.
    What goes around an axis is unrolled, and cut where the contact has its largest hole.
    """
    if np.linalg.norm(mean) > FACING or least[0] > STRAIGHT or least[2] > 1.0 - STRAIGHT:
        front = unit(mean) if np.linalg.norm(mean) > FACING else axes[:, 2]
        k = int(np.abs(front).argmax())
        if abs(front[k]) > 1.0 - STRAIGHT:
            along = np.delete(np.eye(3), k, axis=0)
            names = "xyz".replace("xyz"[k], "")
        else:
            upwards = [0.0, 0.0, 1.0] if abs(front[2]) < 0.9 else [0.0, 1.0, 0.0]
            right = unit(np.cross(upwards, front))
            along, names = np.stack([right, np.cross(front, right)]), ""
        labels = list(names) or [
            "along\n({:g}, {:g}, {:g})".format(*(np.round(vector, 2) + 0.0)) for vector in along
        ]
        at = (points @ along.T)[cells]
        # as seen along the normal those at the back stand under those in front
        if np.linalg.norm(mean) <= FACING:
            level = np.round(
                (points @ front)[cells].mean(axis=1)
                / (MAPS["apart"] * np.ptp(points, axis=0).max())
            )
            heights, floor = np.unique(level, return_inverse=True)
            at[..., 0] += (1.2 * np.ptp(at[..., 0]) * floor)[:, None]
            labels[0] += " (side by side)" if len(heights) > 1 else ""
        return at, (labels[0], labels[1]), np.broadcast_to(along, (len(points), 2, 3))
    normal = outward(points, cells)
    axis = axes[:, 0] * np.sign(axes[np.abs(axes[:, 0]).argmax(), 0])
    # distances from its normal
    planes = np.eye(3) - normal[:, :, None] * normal[:, None, :] - np.outer(axis, axis)
    right = np.einsum("lij,lj->i", planes, points)
    middle = np.linalg.lstsq(planes.sum(axis=0), right, rcond=None)[0]
    first = unit(np.cross(axis, np.eye(3)[np.abs(axis).argmin()]))
    away = points - middle
    angle = np.arctan2(away @ np.cross(axis, first), away @ first)
    order = np.sort(angle)
    holes = np.diff(order, append=order[0] + 2.0 * np.pi)
    angle = np.mod(angle - order[(holes.argmax() + 1) % len(order)] + 1e-9, 2.0 * np.pi)[cells]
    behind = np.ptp(angle, axis=1) > np.pi
    angle[behind] += np.where(angle[behind] < np.pi, 2.0 * np.pi, 0.0)
    radial = away - np.outer(away @ axis, axis)
    radius = float(magnitude(radial).mean())
    name = "xyz"[np.abs(axis).argmax()] if np.abs(axis).max() > 1.0 - STRAIGHT else "along the axis"
    return (
        np.stack([radius * angle, (points @ axis)[cells]], axis=2),
        ("around the axis", name),
        np.stack([np.cross(axis, unit(radial)), np.broadcast_to(axis, points.shape)], axis=1),
    )


def _draw_zones(axes: Any, at: np.ndarray, status: np.ndarray, counts: dict) -> None:
    """Colour the parts of cells (c, 3, 2) that are nearest to their corners by the status (c, 3) of these."""
    after, before = np.roll(at, -1, axis=1), np.roll(at, 1, axis=1)
    middle = np.broadcast_to(at.mean(axis=1, keepdims=True), at.shape)
    quarters = np.stack([at, (at + after) / 2, middle, (at + before) / 2], axis=2)
    colours = [ZONES[STATUS[value]] for value in status.ravel().astype(int)]
    axes.add_collection(
        PolyCollection(
            quarters.reshape(-1, 4, 2),
            facecolors=colours,
            edgecolors="face",
            linewidth=0.3,
            rasterized=True,
        )
    )
    above(axes, zone_legend(counts))


def _draw_slip(
    axes: Any, at: np.ndarray, along: np.ndarray, cells: np.ndarray, surface: Columns, length: str
) -> None:
    """Draw the slip of some points that slip as arrows; see `flatten`."""
    nodes, first = np.unique(cells, return_index=True)
    place, slip = at.reshape(-1, 2)[first], surface["slip_vector"][nodes]
    slips = surface["status"] == STATUS.index("slip")
    arrows = np.einsum("lci,li->lc", along[nodes], slip)
    size = np.ptp(place, axis=0).max() / MAPS["arrows"]
    cell = np.round((place - place.min(axis=0)) / size).astype(int)
    off = magnitude(place - place.min(axis=0) - size * cell)
    order = np.lexsort((off, *cell.T, ~slips[nodes]))
    _, some = np.unique(cell[order], axis=0, return_index=True)
    some = order[some]
    some = some[slips[nodes[some]]]
    if not len(some):
        return
    longest = magnitude(arrows[some]).max()
    axes.quiver(
        *place[some].T,
        *arrows[some].T,
        angles="xy",
        scale_units="xy",
        scale=longest / size,
        width=0.003,
        color=COLOURS["rigid"],
        zorder=4,
        clip_on=False,
    ).set_in_layout(False)
    factor, length = scaled_unit(longest, length)
    axes.set_title(f"arrows: slip, up to {rounded(longest / factor)} {length}", fontsize=8)
