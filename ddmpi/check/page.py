"""check.html: the parts of a scene that is not solved, to be turned, taken apart and clicked; shown by view.html's script."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.body.loads import VOLUME
from ddmpi.check.drawing import (
    ARROW,
    GROUPS,
    PLACES,
    Bodies,
    Looked,
    as_results,
    load_arrows,
    thinned,
)
from ddmpi.check.faces import Piece, describe_face, face_of, pieces_of
from ddmpi.check.nearby import Missing
from ddmpi.interface.interface import Interface
from ddmpi.mesh.elements import normals
from ddmpi.pictures.browser import RIBBON, Arrays, page_of, painted_on
from ddmpi.pictures.moved import apart
from ddmpi.pictures.views import View, angles_of, in_space, sharp_edges
from ddmpi.results.fields import linear_parts, owners
from ddmpi.results.tables import Results
from ddmpi.run.report import describe_gap
from ddmpi.scene.reader import to_toml, write_entry
from ddmpi.scene.scene import Settled
from ddmpi.surface.side import nodal, unit
from ddmpi.system.files import write_page
from ddmpi.system.numbers import ALIKE, scaled_unit

MOST = 150_000
"""Most triangles of a page. Where there are more, corners in one cube of a grid become one."""

FINEST = 400.0
"""So many cubes are at first along the bodies' extent."""

ROLES = {
    "free": "#e6e9ed",
    "in a contact": "#7fa8d1",
    "may touch": "#e05050",
    "loaded": "#c97f96",
    "held": "#6fae8f",
}
"""What faces are for, and their colours; the last that fits is shown."""

GAPS = "440154 472d7b 3b528b 2c728e 21918c 28ae80 5ec962 addc30 fde725"
SUPPORTS = "#1f6f4a", "#3f8fb0", "#8a8f2a", "#6a4fa0"
KNOB = 0.007  # size of the marks of supports, and width of arrows, over the bodies' extent


def write_check(
    path: Path,
    scene: Settled,
    bodies: Bodies,
    interfaces: Sequence[Interface],
    missing: Sequence[Missing],
) -> Path:
    """Write the page of a scene. Not collective. Raises OutputError."""
    results = as_results(scene, bodies, interfaces)
    pieces = [piece for name, body in bodies.items() for piece in pieces_of(name, body.boundary)]
    arrays = Arrays()
    scenery = _Scenery(results, bodies, pieces)
    scenery.put(arrays)
    told = _Told(scene, results.scene, bodies, interfaces, missing)
    roles = np.array([0, *(told.role(piece) for piece in pieces)])
    colour = np.arange(len(pieces)) % len(GROUPS) + 1.0
    arrays.put("group0", np.append(0.0, colour)[scenery.face])
    arrays.put("role0", roles[scenery.face].astype(float))
    signs = [sign for sign in _signs(bodies, scenery.extent, scene.units["stress"]) if len(sign.at)]
    for k, sign in enumerate(signs):
        arrays.put(f"sign{k}", sign.triangles)
        arrays.put(f"sign_at{k}", sign.at)
        arrays.put(f"sign_owner{k}", sign.owner)
    fields = [
        _field("role", "what faces are for", list(ROLES.values()), list(ROLES)),
        _field("group", "groups", [ROLES["free"], *GROUPS]),
        *_put_gaps(arrays, results),
    ]
    head = scenery.head() | {
        "fields": fields,
        "arrays": arrays.places,
        "signs": [{"words": sign.words, "colour": sign.colour} for sign in signs],
        "pieces": [told.of(piece) for piece in pieces],
        "names": [contact.name for contact in scene.contact],
        "words": "as drawn; click a face" + scenery.coarsened,
    }
    return write_page(path, page_of(results, head, arrays, "page"), "page")


def _field(name: str, title: str, colours: list[str], labels: Sequence[str] = ()) -> dict[str, Any]:
    """What colours stand for, one for each whole number from 0 on, with words."""
    return {
        "name": name,
        "title": title,
        "unit": "",
        "painted": False,
        "colours": colours,
        "stepped": True,
        "labels": list(labels),
        "low": -0.5,
        "high": len(colours) - 0.5,
        "marks": [(0.0, 0)],
    }


def _put_gaps(arrays: Arrays, results: Results) -> Iterator[dict[str, Any]]:
    """The field of gaps, if there are contacts; their surfaces are put into the arrays in any case."""
    painted = painted_on(
        results, in_space(results.points), owners(results), results.scene["contact"]
    )
    for name in "surface", "above", "painted", "bearer", *["rims"] * results.axisymmetric:
        arrays.put(name, painted[name])
    gap = np.concatenate(
        [np.zeros(0), *(results.surfaces[name]["gap"][rows] for name, rows in painted["rows"])]
    )
    arrays.put("lifted0", np.zeros(3 * len(gap)))
    if not gap.any():  # all that meets touches
        return
    arrays.put("gap0", gap)
    factor, unit_of = scaled_unit(np.abs(gap).max(), results.units["length"])
    arrays.places["gap0"]["high"] /= factor
    arrays.places["gap0"]["low"] /= factor
    low = gap.min() / factor
    high = gap.max() / factor
    yield _field("gap", "gaps, overlaps below 0", [f"#{each}" for each in GAPS.split()]) | {
        "unit": unit_of,
        "painted": True,
        "stepped": False,
        "low": low,
        "high": high if high > low else low + 1.0,
        "marks": [(high, int(gap.argmax()))],
    }


class _Scenery:
    """The triangles of a page, and whose they are.

    Attributes
    ----------
    extent : of the bodies (m)
    face : (k,) of each point its piece, from 1 on; 0 of those inside bodies in the plane
    coarsened : words of what is left out, or nothing
    """

    def __init__(self, results: Results, bodies: Bodies, pieces: Sequence[Piece]) -> None:
        self._results = results
        self._view = View(results.points, _asked(results))
        self.extent = results.extent
        parts = []
        first = 0
        for k, (name, body) in enumerate(bodies.items()):
            number = np.zeros(len(body.boundary.facets), int)
            for j, piece in enumerate(pieces, 1):
                if piece.body == name:
                    number[piece.some] = j
            make = _solid if self._view.solid else _flat
            at, cells, lines, of = make(body, number, RIBBON * self.extent, results.axisymmetric)
            parts.append((at, cells + first, lines + first, of, np.full(len(at), k)))
            first += len(at)
        every = map(np.concatenate, zip(*parts, strict=True))
        self._points, self._triangles, self._edges, self.face, self._owner = every
        drawn = len(self._triangles)
        self._coarsen()
        left = len(self._triangles)
        self.coarsened = f"; coarsened from {drawn:,} to {left:,} triangles" * (left < drawn)
        if self._view.solid:
            self._edges = sharp_edges(self._points, self._triangles)

    def _coarsen(self) -> None:
        """Make corners in one cube of a grid one, if there are more than MOST triangles."""
        cubes = FINEST
        low = self._points.min(axis=0)
        while len(self._triangles) > MOST:
            grid = np.floor((self._points - low) * (cubes / self.extent)).astype(int)
            keys = np.column_stack([self.face, self._owner, grid])
            _, kept, number = np.unique(keys, axis=0, return_index=True, return_inverse=True)
            number = number.ravel()
            triangles = number[self._triangles]
            edges = number[self._edges]
            whole = (triangles != np.roll(triangles, 1, axis=1)).all(axis=1)
            self._triangles = triangles[whole]
            self._edges = edges[edges[:, 0] != edges[:, 1]]
            self._points = self._points[kept]
            self.face = self.face[kept]
            self._owner = self._owner[kept]
            cubes /= 1.5

    def put(self, arrays: Arrays) -> None:
        """Put points, triangles and edges into the arrays."""
        arrays.put("points", self._points)
        arrays.put("facets", self._triangles)
        arrays.put("edges", self._edges)
        arrays.put("owner", self._owner)
        arrays.put("face", self.face)
        arrays.put("cells", np.zeros(0, int))
        arrays.put("moved0", np.zeros(self._points.size))

    def head(self) -> dict[str, Any]:
        """What the script reads of the bodies."""
        results = self._results
        turned = results.axisymmetric
        low = self._points.min(axis=0)
        high = self._points.max(axis=0)
        eye = self._view.axes[2]
        if turned:  # all around; seen into the quarter that is left out
            low[[0, 2]] = -high[0]
            high[[0, 2]] = high[0]
            eye = np.array([0.43, -0.75, 0.5])
        return {
            "times": [0.0],
            "timed": False,
            "flat": not (self._view.solid or turned),
            "turned": turned,
            "cut": None,
            "scale": 0.0,
            "low": low.tolist(),
            "high": high.tolist(),
            "view": angles_of(eye),
            "shifts": _parted(results, self._view).tolist(),
        }


def _asked(results: Results) -> dict[str, Any]:
    """The part of the scene's table `output` that a page heeds."""
    view = results.output.get("view")
    return {"view": view} if View(results.points).solid and view else {}


Drawn = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
"""Points (k, 3), triangles (t, 3), edges (e, 2), and the piece (k,) of each point."""


def _solid(body: Looked, number: np.ndarray, width: float, turned: bool) -> Drawn:
    """Points (k, 3), triangles (t, 3), no edges, and pieces (k,) of the boundary of a solid; pieces share no points."""
    triangles, of = linear_parts(body.boundary.facets, 2)
    key, corners = np.unique(
        np.column_stack([number[of].repeat(3), triangles.ravel()]), axis=0, return_inverse=True
    )
    edges = corners[:0].reshape(-1, 2)  # those that are sharp are found of all bodies at once
    return body.mesh.points[key[:, 1]], corners.reshape(-1, 3), edges, key[:, 0]


def _flat(body: Looked, number: np.ndarray, width: float, turned: bool) -> Drawn:
    """Points (k, 3), triangles (t, 3), edges (e, 2) and pieces (k,) of a body in the plane: its cells, and unless they
    are `turned` around an axis, ribbons of this width along its boundary."""
    mesh = body.mesh
    facets = body.boundary.facets
    cells = linear_parts(mesh.triangles, 2)[0]
    lines, facet = linear_parts(facets, 1)
    of = number[facet]
    key, ends = np.unique(
        np.column_stack([of.repeat(2), lines.ravel()]), axis=0, return_inverse=True
    )
    outer = in_space(mesh.points[key[:, 1]])
    ends = ends.reshape(-1, 2) + len(mesh.points)
    points = [in_space(mesh.points), outer]
    face = [np.zeros(len(mesh.points), int), key[:, 0]]
    if not turned:
        across = normals(mesh.points[lines])[:, None].repeat(2, axis=1)
        inward = -width * in_space(unit(nodal(across, ends - len(mesh.points), len(key))))
        a, b = ends.T
        c, d = ends.T + len(key)
        cells = np.vstack([cells, np.column_stack([a, b, d]), np.column_stack([a, d, c])])
        points.append(outer + inward)
        face.append(key[:, 0])
        for part in points[1:]:
            part[:, 2] += 0.3 * width
    return np.vstack(points), cells, ends, np.concatenate(face)


def _parted(results: Results, view: View) -> np.ndarray:
    """Shifts (parts, 3) that take the parts of the scene apart: `apart` along contacts, others away from the middle, or
    one beyond the other where they have one middle."""
    shifts = apart(results, view)
    points = in_space(results.points)
    owner = owners(results)
    middle = points.mean(axis=0)
    extent = np.ptp(points, axis=0)
    names = list(results.summary["bodies"])
    along = np.eye(3)[2 if view.solid else int(results.axisymmetric)]
    for k, name in enumerate(names):
        if np.linalg.norm(shifts[name]) > ALIKE * extent.max() or len(names) == 1:
            continue
        own = points[owner == k]
        away = (own.min(axis=0) + own.max(axis=0)) / 2.0 - middle
        away = away * along if results.axisymmetric else away
        near = np.linalg.norm(away) < 0.05 * extent.max()
        shifts[name] = k * (extent @ along) * along if near else 0.6 * away
    return np.array([shifts[name] for name in results.parts])


@dataclass(frozen=True)
class _Sign:
    """Marks of one kind: what they mean, their colour, points (k, 3), triangles (t, 3), the body (k,) of each point."""

    words: str
    colour: str
    at: np.ndarray
    triangles: np.ndarray
    owner: np.ndarray


_RING = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])
_NEXT = np.array([[k, (k + 1) % 4] for k in range(4)])

_KNOB = (
    np.vstack([np.insert(_RING, 0, 0.0, axis=1), [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]]),
    np.vstack([np.insert(_NEXT, 2, tip, axis=1) for tip in (4, 5)]),
)
"""Points (6, 3) and triangles (8, 3) of the mark of a support."""

_ARROW = (
    np.vstack(
        [
            np.insert(0.35 * _RING, 0, 0.0, axis=1),
            np.insert(0.35 * _RING, 0, 0.6, axis=1),
            np.insert(1.2 * _RING, 0, 0.6, axis=1),
            [[1.0, 0.0, 0.0]],
        ]
    ),
    np.vstack(
        [
            np.column_stack([_NEXT, _NEXT[:, 0] + 4]),
            np.column_stack([_NEXT + 4, _NEXT[:, 1]]),
            np.insert(_NEXT + 8, 2, 12, axis=1),
            [[8, 9, 10], [8, 10, 11]],
        ]
    ),
)
"""Points (13, 3) and triangles (14, 3) of an arrow from 0 to 1 along the first axis."""


def _signs(bodies: Bodies, extent: float, unit_of: str) -> Iterator[_Sign]:
    """Arrows of loads and weights, and marks of supports, where there are some."""
    looked = list(bodies.values())
    loads = load_arrows(looked, extent, unit_of)
    if loads is not None:
        yield _arrows(loads.words, "#8c1a3a", loads.tail, loads.along, loads.owner, KNOB * extent)
    yield from _weights(looked, extent)
    kinds = dict.fromkeys(how for body in looked for how, _ in body.supports)
    for number, kind in enumerate(kinds):
        yield _supports(looked, kind, SUPPORTS[number % len(SUPPORTS)], extent)


def _weights(looked: Sequence[Looked], extent: float) -> Iterator[_Sign]:
    """An arrow of one length for each volume force, in the middle of its body."""
    weights = [
        (k, body.mesh.points.mean(axis=0), unit(f.sum(axis=0)))
        for k, body in enumerate(looked)
        for on, f in body.loads
        if on == VOLUME
    ]
    if weights:
        owner, at, along = (np.array(each) for each in zip(*weights, strict=True))
        yield _arrows("volume forces", "#c8501e", at, ARROW * extent * along, owner, KNOB * extent)


def _supports(looked: Sequence[Looked], kind: str, colour: str, extent: float) -> _Sign:
    """Marks of the supports of one kind."""
    places = [
        (k, thinned(body.mesh.points[nodes], extent / PLACES)[0])
        for k, body in enumerate(looked)
        for how, nodes in body.supports
        if how == kind
    ]
    at = in_space(np.vstack([at for _, at in places]))
    owner = np.concatenate([np.full(len(at), k) for k, at in places])
    axes = np.broadcast_to(KNOB * extent * np.eye(3), (len(at), 3, 3))
    return _copies(kind, colour, at, axes, owner, _KNOB)


def _arrows(
    words: str, colour: str, at: np.ndarray, along: np.ndarray, owner: np.ndarray, wide: float
) -> _Sign:
    """Arrows from places (k, d) along vectors (k, d), of bodies (k,)."""
    at = in_space(at)
    along = in_space(along)
    first = unit(np.cross(along, np.eye(3)[np.abs(along).argmin(axis=1)]))
    second = unit(np.cross(along, first))
    axes = np.stack([along, wide * first, wide * second], axis=1)
    return _copies(words, colour, at, axes, owner, _ARROW)


def _copies(
    words: str,
    colour: str,
    places: np.ndarray,
    axes: np.ndarray,
    owner: np.ndarray,
    model: tuple[np.ndarray, np.ndarray],
) -> _Sign:
    """Copies of a `model`, its points (j, 3) and triangles (t, 3), at places (k, 3) along axes (k, 3, 3)."""
    points, triangles = model
    at = places[:, None] + points @ axes
    start = len(points) * np.arange(len(places))
    numbers = (triangles + start[:, None, None]).reshape(-1, 3)
    return _Sign(words, colour, at.reshape(-1, 3), numbers, owner.repeat(len(points)))


class _Told:
    """What a page tells of pieces: what they are and do, and lines that may be pasted into the scene."""

    def __init__(
        self,
        scene: Settled,
        plain: Mapping[str, Any],
        bodies: Bodies,
        interfaces: Sequence[Interface],
        missing: Sequence[Missing],
    ) -> None:
        """Of a scene, also as `plain` data."""
        self._units = scene.units
        self._bodies = bodies
        self._plain = {body["name"]: body for body in plain["body"]}
        gaps = [describe_gap(interface, scene.units["length"]) for interface in interfaces]
        self._contacts = list(zip(scene.contact, gaps, strict=True))
        taken = {contact.name for contact in scene.contact}
        self._missing = [(lack, lack.lines(taken) if all(lack.on) else "") for lack in missing]

    def _acting(self, piece: Piece) -> list[str]:
        """Supports and loads of a piece, in words."""
        acting = self._bodies[piece.body].acting
        return [words for on, words in acting if piece.is_of(on)]

    def _touching(self, piece: Piece) -> Iterator[str]:
        """Contacts of a piece, in words."""
        for contact, gap in self._contacts:
            for body, on in zip(contact.bodies, contact.on, strict=False):
                if body == piece.body and piece.is_of(on):
                    yield f"contact {contact.name}: {' and '.join(contact.bodies)}, {gap}"

    def _proposed(self, piece: Piece) -> Iterator[tuple[Missing, str]]:
        """Contacts that may be missing at a piece, with their lines; none where a side has no name."""
        for lack, lines in self._missing:
            for body, on in zip(lack.bodies, lack.on, strict=False):
                if body == piece.body and (
                    piece.is_of(on) or (not on and self._is_at(piece, lack))
                ):
                    yield lack, lines
                    break

    def _is_at(self, piece: Piece, lack: Missing) -> bool:
        """Whether a facet of a piece has all its corners on the facets of a missing contact."""
        at = self._bodies[piece.body].boundary.at[piece.some]
        rows, there = (_as_whole(each.reshape(-1, at.shape[2])) for each in (at, lack.facets))
        return bool(np.isin(rows, there).reshape(at.shape[:2]).all(axis=1).any())

    def role(self, piece: Piece) -> int:
        """The number of its role in ROLES."""
        acting = self._acting(piece)
        loaded = any(words.startswith("load") for words in acting)
        held = any(not words.startswith("load") for words in acting)
        touching = any(self._touching(piece))
        proposed = any(self._proposed(piece))
        return 4 if held else 3 if loaded else 2 if proposed else int(touching)

    def of(self, piece: Piece) -> dict[str, Any]:
        """What the page shows of a piece once it is clicked."""
        body = self._bodies[piece.body]
        boundary = body.boundary
        length = self._units["length"]
        name = piece.names[0] if piece.names else ""
        face = body.mesh.faces.get(name) or face_of(boundary, piece.some)
        size = np.ptp(boundary.at[piece.some], axis=(0, 1))
        size[size < ALIKE * size.max()] = 0.0
        told = [
            describe_face(boundary, piece.some, face, length),
            f"size {' × '.join(f'{each:.4g}' for each in size)} {length}",
            *self._acting(piece),
            *self._touching(piece),
        ]
        if piece.names[1:]:
            told.insert(0, f"also in {', '.join(piece.names[1:])}")
        shown = {"body": piece.body, "told": told, "paste": [], "toml": to_toml(piece.body)}
        if not name:
            told.insert(
                0, "this boundary has no name; give it one in the mesh to clamp, load or join it"
            )
            return shown | {"name": "no name"}
        plain = self._plain[piece.body]
        on = piece.on
        load = [*plain["traction"], {"on": on, "pressure": 1.0}]
        groups = boundary.groups
        same = {each for each in piece.names if (groups[each] == groups[name]).all()} | {str(on)}
        others = [one for one in plain["clamp"] if str(_group(one)) not in same]
        paste = [(f"to load it, in {piece.body}", write_entry("traction", load))]
        if not any(
            self._touching(piece)
        ):  # where all of a contact is clamped, there is nothing to solve
            clamp = write_entry("clamp", [*others, on])
            paste.insert(0, (f"to clamp it, in {piece.body}", clamp))
        for lack, lines in self._proposed(piece):
            low, high = (f"{each:.3g}" for each in lack.gap)
            gap = low if low == high else f"{low} to {high}"
            both = " and ".join(lack.bodies)
            told.append(f"{both} may touch here: {gap} {length} apart, in no contact")
            if lines:
                paste.append((f"for a contact of {both}, at the end", lines))
        return shown | {"name": name, "paste": paste, "on": to_toml(on)}


def _group(clamp: Any) -> Any:
    """The group of a clamp as plain data."""
    return clamp["on"] if isinstance(clamp, dict) else clamp


def _as_whole(rows: np.ndarray) -> np.ndarray:
    """Rows (k, d) as single values (k,), equal where all their numbers are."""
    return np.ascontiguousarray(rows).view([("", rows.dtype)] * rows.shape[1]).ravel()
