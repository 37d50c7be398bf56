"""Positions of bodies and rigid partners in pictures, and the magnification of displacements."""

from collections.abc import Collection, Iterator, Mapping
from typing import Any

import msgspec
import numpy as np
from scipy.spatial import ConvexHull

from ddmpi.mesh.elements import normals
from ddmpi.pictures.sheet import COLOURS, MARGIN, by_value, filled, round_down
from ddmpi.pictures.views import Surface, View, in_space
from ddmpi.results.fields import linear_parts, owners, vectors
from ddmpi.results.histories import frames_at
from ddmpi.results.summary import factor_at, motion_at
from ddmpi.results.tables import Columns, Results
from ddmpi.scene.contacts import Rigid
from ddmpi.sets import magnitude
from ddmpi.surface.side import dot, frames, nodal, unit
from ddmpi.system.numbers import RigidMotion

DRAWN = 0.08  # displacements and shifts are drawn as at most this fraction of the bodies' extent
INVISIBLE = 0.002  # errors of at most this fraction of the bodies' extent cannot be seen in a picture: two pixels
FLAT = 0.05  # a cell is drawn with at least this fraction of its size
FARTHEST = 100.0  # largest drawn displacement over the bodies' extent, whatever the magnification

FACING, STRAIGHT = 0.4, 0.02
"""A contact faces one way if the mean of its normals is longer than the first, and goes around an axis if the mean
square of their parts along it is at most the second. Directions whose cosine differs from 1 by less than the second are
those of x, y or z."""

OPENED = 0.45  # how far contacts are drawn open, over the root of their areas with holes filled: one sees into rings
PRESSED = 0.98  # fraction of the area under pressure at which colours of pressures end: edges have few, and high, ones
ABOVE = 1e-3  # how far colours are drawn above the bodies that bear them, over the bodies' extent
AROUND = 1.25  # size of a drawn rigid surface in space over that of the part that bodies may touch


def magnify(results: Results, largest: float = 0.0) -> tuple[float, np.ndarray]:
    """The magnification F and a shift (nv, d) in metres: a node at x that moves by u is drawn at x + shift + F u.

    Each body is shifted as a whole, around an axis and in sectors of a wheel along the axis, by F − 1 times the initial
    gap of its contact, negative for an overlap. Gaps are then drawn F times as wide as they are, and closed nodes touch.
    Where initial gaps vary, as in rings, this holds for their mean alone; F is so small that errors at closed nodes and
    overlaps at others are invisible, and no cell is turned inside out. A scene that gives
    ``output.magnification`` gets it, up to FARTHEST. `largest` is a displacement of an earlier load step that F has to
    suit as well (m). Not collective.
    """
    moved = magnitude(results.fields["displacement"])
    owner = owners(results)
    names = list(results.summary["bodies"])
    contacts = results.scene["contact"]
    tables = [results.contacts[contact["name"]] for contact in contacts]
    gaps = [_initially(results, contact) for contact in contacts]
    mobile, apart = np.zeros(len(names)), np.zeros((len(tables), len(names)))
    distances = np.zeros((len(tables), results.dimension))
    np.maximum.at(mobile, owner, moved)
    for k, (contact, table, gap) in enumerate(zip(contacts, tables, gaps, strict=True)):
        touching = table["status"] != "open"
        distances[k] = gap[touching if touching.any() else slice(None)].mean(axis=0)
        # A rigid partner is no body and does not shift.
        bodies = [names.index(name) for name in contact["bodies"] if name in names]
        if len({*contact["bodies"]}) == 2:  # both sides of one body shift alike
            apart[k, bodies] = (-1.0, 1.0)[: len(bodies)]
    distances = distances @ _shiftable(results)
    shifts = np.zeros((len(names), results.dimension))
    if distances.any():
        # least squares: shifts of two bodies differ by the gaps of their contacts, weighted by their displacements
        # By the weights, the body that moves most shifts most.
        shifts = mobile[:, None] * (np.linalg.pinv(apart * mobile) @ distances)
    extent, size = results.extent, max(moved.max(), largest, np.abs(shifts).max())
    limits = [
        limit
        for table, gap, shift in zip(tables, gaps, apart @ shifts, strict=True)
        for limit in _limits(table, gap - shift, INVISIBLE * extent)
    ]
    chosen = round_down(min([DRAWN * extent / size, *limits])) if size else 1.0
    chosen = _unfolded(results, chosen)
    asked = results.output.get("magnification")
    factor = min(asked, FARTHEST * extent / size if size else asked) if asked else max(chosen, 1.0)
    return factor, (factor - 1.0) * shifts[owner]


def _shiftable(results: Results) -> np.ndarray:
    """(d, d) the projection onto shifts of bodies: around an axis, and of sectors of a wheel, along the axis alone. Off it
    a shaft would have a bore, and sectors would part."""
    d = results.dimension
    images = [contact.get("image") or {} for contact in results.scene["contact"]]
    axes = [image["axis"] for image in images if image.get("turn")]
    if results.axisymmetric:
        axes = [[0.0, 1.0]]
    if not axes:
        return np.eye(d)
    axis = np.array(axes[0] or np.zeros(d))
    return np.outer(axis, axis) / ((axis @ axis) or 1.0)


def _unfolded(results: Results, factor: float) -> float:
    """The largest of 1, 2, 5 times a power of ten up to `factor` at which each cell keeps a part FLAT of its size."""
    cells = linear_parts(results.fields["cells"], results.dimension)[0]
    drawn, moved = (
        values[cells[:, 1:]] - values[cells[:, :1]]
        for values in (results.points, results.displacement())
    )
    size = np.linalg.det(drawn)
    least = FLAT * np.abs(size)
    while factor > 1.0 and (np.linalg.det(drawn + factor * moved) * np.sign(size) < least).any():
        factor = round_down(0.99 * factor)
    return factor


def _initially(results: Results, contact: dict) -> np.ndarray:
    """(l, d) from the first to the second body along the normal, undeformed (m): the gap without displacements."""
    table, given = results.contacts[contact["name"]], contact.get("gap")
    history = given.get("history") if isinstance(given, dict) else None
    factor = factor_at(results.summary, history, results.time)
    return factor * table["initial_gap"][:, None] * vectors(table, "n")


def _limits(table: Columns, left: np.ndarray, visible: float) -> Iterator[float]:
    """The largest magnifications F at which errors are not `visible` (m). A gap is drawn as F times itself less (F − 1)
    `left` (l, d)."""
    gap = table["gap"]
    wrong = magnitude(left[table["status"] != "open"]).max(initial=0.0)
    if wrong:
        yield 1.0 + visible / wrong
    into = dot(left, vectors(table, "n"))
    overlapping = into > gap
    # the drawn overlap (F − 1) into − F gap is visible from this F on
    yield from (visible + into[overlapping]) / (into - gap)[overlapping]


def rigid_parts(
    results: Results,
    factor: float = 0.0,
    time: float | None = None,
    going: Mapping[str, RigidMotion] | None = None,
) -> list[Surface]:
    """The parts of rigid partners that bodies may touch; in the plane lines, with the bodies on their left.

    They are moved by `factor` times their displacement at `time`, by default that of the results, or times the
    velocities `going` of a mechanism.
    """
    points, names, owner = results.points, list(results.summary["bodies"]), owners(results)
    scene, surfaces, where = results.scene, list[Surface](), frames_at(results, time)
    for rigid in _surfaces(scene):
        contacts = [contact for contact in scene["contact"] if contact["bodies"][1] == rigid.name]
        now = results.time if time is None else time
        moved = motion_at(results.summary, rigid, now) if going is None else going.get(rigid.name)
        if not contacts or moved is None:
            continue
        if results.dimension > 2:
            shapes = (
                _around(
                    rigid,
                    results.surfaces[contact["name"]]["points"],
                    results.cells(contact["name"]),
                )
                for contact in contacts
            )
            surfaces += [
                Surface(at + factor * moved.at(at), facets, filled("patch"), edges=COLOURS["still"])
                for at, facets in shapes
                if len(facets)
            ]
            continue
        touched = np.concatenate(
            [vectors(results.contacts[contact["name"]]) for contact in contacts]
        )
        bodies = points[np.isin(owner, [names.index(contact["bodies"][0]) for contact in contacts])]
        frame = where.get(rigid.name)
        if frame:
            touched, bodies = frame.undone.at(touched), frame.undone.at(bodies)
        at = rigid.outline(touched, bodies, MARGIN * results.extent)
        at = frame.at(at) if frame else at
        if results.axisymmetric:
            # One line, which begins after the gap on the left of the axis.
            right = np.flatnonzero(at[:, 0] >= 0.0)
            at = np.roll(
                at[right], -1 - np.argmax(np.diff(right, append=right[-1] + 2) > 1), axis=0
            )
        surfaces.append(Surface(at + factor * moved.at(at), np.zeros((0, 3), int), filled("patch")))
    return surfaces


def _surfaces(scene: Mapping[str, Any]) -> list[Rigid]:
    """The rigid partners of a scene that have a surface."""
    every = msgspec.convert(scene.get("rigid", ()), list[Rigid])
    return [rigid for rigid in every if rigid.surface]


def _around(rigid: Rigid, at: np.ndarray, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The part of a rigid surface near bodies, as facets and points, from their facets (f, 3) and points (k, 3)."""
    at = at.mean(axis=0) + AROUND * (at - at.mean(axis=0))
    normal, distance = rigid.facing(at)
    at, facets = at - distance[:, None] * normal, facets[:, ::-1]
    if np.isinf(rigid.bend):
        hull = ConvexHull(at @ frames(normal[:1])[0, 1:].T).vertices
        facets = np.stack([np.full(len(hull) - 2, hull[0]), hull[1:-1], hull[2:]], axis=1)
    return at, facets


def apart(results: Results, view: View) -> dict[str, np.ndarray]:
    """Shifts (3,) of bodies and rigid partners, by name, that open contacts so that both sides can be seen (m).

    Two that face each other move apart along the mean normal, by OPENED times the root of the area, holes filled; one
    that is around the other is drawn off along the axis, towards the eye, unless others part them.
    """
    scene, names = results.scene, results.parts
    rows, aims = np.zeros((len(scene["contact"]), len(names))), np.zeros((len(scene["contact"]), 3))
    for row, aim, contact in zip(rows, aims, scene["contact"], strict=True):
        table = results.contacts[contact["name"]]
        points = results.surfaces[contact["name"]]["points"]
        if not table["area"].any():
            continue
        mean, least, axes = directions(vectors(table, "n"), table["area"])
        weight = 1.0
        if results.axisymmetric:
            mean = mean * (0.0, 1.0)  # rings move along their axis
        if np.linalg.norm(mean) > FACING:
            across = (points - points[0])[:, : len(mean)] @ frames(unit(mean[None]))[0, 1:].T
            # The hull of a flat contact is in a plane, and its volume an area.
            wide = np.sqrt(ConvexHull(across).volume) if view.solid else np.ptp(across)
            aim[: len(mean)] = -OPENED * wide * unit(mean)
        elif not view.solid:  # rings in the plane, and around an axis
            k = int(results.axisymmetric)
            aim[k], weight = 1.1 * np.ptp(points[:, k]), 1e-3
        elif least[0] <= STRAIGHT and least[1] > STRAIGHT:
            aim[:] = (
                1.1
                * np.ptp(points @ axes[:, 0])
                * axes[:, 0]
                * (1.0 if axes[:, 0] @ view.axes[2] > 0.0 else -1.0)
            )
            weight = 1e-3  # others come first
        row[[names.index(name) for name in contact["bodies"]]] = weight, -weight
        aim *= weight
    return dict(zip(names, np.linalg.pinv(rows) @ aims, strict=True))


def painted_by(
    results: Results,
    names: Collection[str],
    shifts: Mapping[str, np.ndarray],
    image: Any,
    factor: float,
) -> Iterator[tuple[Surface, np.ndarray]]:
    """The surfaces of some contacts as they lie on either side, shifted with it; their pressures (n,) over `factor`."""
    view = View(results.points, results.output)
    off = ABOVE * results.extent
    for contact in (each for each in results.scene["contact"] if each["name"] in names):
        points, _, outward, faces = covered(results, contact)
        pressure = np.nan_to_num(results.surfaces[contact["name"]]["pressure"]) / factor
        for body, sign, facets in faces:
            yield (
                Surface(
                    points + sign * off * outward + shifts[body],
                    facets,
                    by_value(pressure[facets], image),
                    view.beyond(points),
                    plain=True,
                    edges="",
                ),
                pressure,
            )


def pressed(results: Results) -> list[dict]:
    """The contacts of the scene whose pressures are drawn: those that are not bonded, or all if all are."""
    contacts = results.scene["contact"]
    return [contact for contact in contacts if contact.get("kind") != "bonded"] or contacts


def covered(
    results: Results, contact: dict
) -> tuple[np.ndarray, np.ndarray, np.ndarray, list[tuple[str, float, np.ndarray]]]:
    """What a contact covers: points (n, 3), cells (c, d), unit normals (n, 3) at the points; and its faces: each body,
    whether normals point out of it (1) or into it (−1), and the cells as they are seen from outside of it."""
    points, cells = results.surfaces[contact["name"]]["points"], results.cells(contact["name"])
    of_slave, of_other = (1.0, cells), (-1.0, cells[:, ::-1])
    order = (
        (of_slave, of_other)
        if results.summary["contacts"][contact["name"]]["slave"] in (None, contact["bodies"][0])
        else (of_other, of_slave)
    )
    return (
        points,
        cells,
        outward(points, cells),
        [(body, *face) for body, face in zip(contact["bodies"], order, strict=True)],
    )


def outward(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """Unit normals (n, 3) at the points (n, 3) of cells (c, d), which are lines in the plane."""
    d = cells.shape[1]
    across = in_space(normals(points[cells][..., :d]))
    return unit(nodal(across[:, None].repeat(d, axis=1), cells, len(points)))


def directions(normal: np.ndarray, area: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of the normals (l, 3) of a contact at nodes with areas (l,) the mean; and along which axes (3, 3), the columns,
    they have the mean squares (3,), the least first."""
    return (
        area @ normal / area.sum(),
        *np.linalg.eigh(np.einsum("l,li,lj->ij", area, normal, normal) / area.sum()),
    )
