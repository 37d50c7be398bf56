"""view.html: the results of a run, to be turned in a browser. One file without references to a network.

Its script shows whatever the head and the arrays of a page say; `ddmpi.check.page` writes others."""

import base64
import json
import string
import zlib
from collections.abc import Sequence
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ddmpi import __version__
from ddmpi.errors import InputError
from ddmpi.pictures.bodies import largest_of, sectors_of
from ddmpi.pictures.moved import ABOVE, apart, covered, magnify, pressed
from ddmpi.pictures.scales import pressure_ends, stress_end
from ddmpi.pictures.script import view_template
from ddmpi.pictures.views import Skin, View, angles_of, in_space, sharp_edges
from ddmpi.results.fields import by_kind, owners
from ddmpi.results.histories import at_step, load_steps, placed
from ddmpi.results.tables import Columns, Results, read_results, reading
from ddmpi.sets import magnitude
from ddmpi.system.files import MECHANISM, write_page
from ddmpi.system.numbers import Frame, scaled_unit

COLOURS = {
    name: [f"#{colour}" for colour in colours.split()]
    for name, colours in {
        "stress": "440154 472d7b 3b528b 2c728e 21918c 28ae80 5ec962 addc30 fde725",
        "pressure": "ffffcc ffeda0 fed976 feb24c fd8d3c fc4e2a e31a1c bd0026 800026",
    }.items()
}
"""Colours from the lowest to the highest value: viridis and YlOrRd of matplotlib."""

TITLES = {
    "von_mises": ("von Mises stress", "stress"),
    "pressure": ("contact pressure", "stress"),
    "displacement": ("displacement", "length"),
}
"""Words and quantities of what colours stand for; the first one is shown at first."""

MOST_CELLS, MOST_NUMBERS = 600_000, 4_000_000
"""Most tetrahedra that a view has, to show stresses on a cut, and most displacements and stresses of all load steps."""

RIBBON = 0.012  # width of contacts in the plane over the bodies' extent


class Arrays:
    """Arrays as integers in one block of bytes; `places` says of each where it is and between which ends."""

    def __init__(self) -> None:
        self.places = dict[str, dict[str, Any]]()
        self._blocks, self._size = list[bytes](), 0

    def put(self, name: str, values: np.ndarray) -> None:
        """Add integers as they are, and other numbers in 65,536 steps from the least to the largest."""
        values, ends = np.asarray(values).ravel(), {}
        if values.dtype.kind == "f":
            low, high = float(values.min(initial=0.0)), float(values.max(initial=0.0))
            values = np.round((values - low) * (65535.0 / ((high - low) or 1.0)))
            ends = {"low": low, "high": high}
        width = 2 if ends else 1 if values.max(initial=0) < 256 else 4
        block = values.astype(f"<u{width}").tobytes()
        self.places[name] = {"at": self._size, "size": len(values), "type": f"u{width}"} | ends
        self._blocks.append(block + bytes(-len(block) % 4))
        self._size += len(self._blocks[-1])

    def packed(self) -> str:
        return base64.b64encode(zlib.compress(b"".join(self._blocks), 6)).decode()


def write_view(folder: str | Path, output: str | None = None) -> Path:
    """Write the view of a run, by default as view.html into its `folder`; its path. Not collective.

    A view is overwritten, any other file is not. Raises InputError where the folder has no results that a view can
    show, or the file is no view; OutputError where it cannot be written.
    """
    folder = Path(folder)
    path = Path(output) if output else folder / "view.html"
    with reading(folder):
        if (folder / MECHANISM).exists():
            raise InputError(
                f"{folder}: the run has found no equilibrium, so there is nothing to turn; mechanism.png "
                "shows how the bodies would move"
            )
        page = _page(placed(at_step(read_results(folder), folder)), folder)
    return write_page(path, page, "view")


def _page(results: Results, folder: Path) -> str:
    if results.surfaces.keys() != results.contacts.keys():
        raise InputError(
            f"{folder}: an earlier version of ddmpi wrote these results, without the surfaces of contacts "
            "that a view shows; run the scene again"
        )
    scene = Scenery(results)
    most = max(1, int(MOST_NUMBERS / (5 * len(scene.nodes))))
    shown = "von_mises", "nodal_von_mises"
    for k, (time, fields, surfaces) in enumerate(load_steps(results, folder, most, shown)):
        scene.put(k, time, fields, surfaces)
    scene.tops["pressure"] = pressure_ends(results)[1]
    if "nodal_von_mises" in results.fields:
        scene.tops["von_mises"] = stress_end(results, folder)
    return page_of(results, scene.head(), scene.arrays)


def page_of(results: Results, head: dict[str, Any], arrays: Arrays, kind: str = "view") -> str:
    """A page of a `kind` that `write_page` knows, which shows `arrays` as its `head` says."""
    return string.Template(view_template()).substitute(
        version=__version__,
        kind=kind,
        title=escape(results.summary["title"] or ", ".join(results.summary["bodies"])),
        head=json.dumps(head).replace("<", "\\u003c"),
        data=arrays.packed(),
    )


class Scenery:
    """What a view shows, as arrays: the bodies, and step by step their contacts and fields.

    A node is drawn at x + (F − 1) s + F u, with `magnify`: as x − s moved by F (u + s), whatever F is.

    Attributes
    ----------
    arrays : all numbers
    nodes : (k,) those of the bodies that are shown
    low, high : (3,) corners of the box of all that is shown (m)
    times, tops, marks : of the load steps; ends of colours by field; by field and step the largest value and its place
    """

    def __init__(self, results: Results) -> None:
        d, output = results.dimension, results.output
        asked = {"view": output["view"]} if d > 2 and output.get("view") else {}
        self._scale, shift = magnify(results)
        self._sectors = sectors_of(results)
        shift = np.vstack([shift @ frame.turned.T for frame in self._sectors])
        results = replace(
            results,
            fields=_whole(self._sectors, results.fields),
            surfaces=self._whole_surfaces(results.surfaces),
        )
        self._results, self._view = results, View(results.points, asked)
        skin, self._owner = (
            Skin(self._view, results.points, results.fields["cells"]),
            owners(results),
        )
        # solids keep the nodes inside, too, for cuts, unless there are too many
        cells = skin.facets[:0]
        if d > 2:
            kinds = by_kind(results.fields["cells"], d)
            cells = np.concatenate([kind.straight.split(nodes) for kind, _, nodes in kinds])
        if len(cells) > MOST_CELLS:
            cells = skin.facets[:0]
        self.nodes = np.unique(np.concatenate([skin.facets.ravel(), cells.ravel()]))
        self._number = np.zeros(len(self._owner), int)
        self._number[self.nodes] = np.arange(len(self.nodes))
        self._s = in_space(shift / (self._scale - 1.0) if self._scale > 1.0 else 0.0 * shift)
        self.arrays, points = Arrays(), in_space(results.points)
        self.arrays.put("points", (points - self._s)[self.nodes])
        self.arrays.put("facets", self._number[skin.facets])
        self.arrays.put("edges", self._number[sharp_edges(points, skin.facets)])
        self.arrays.put("cells", self._number[cells])
        self.arrays.put("owner", self._owner[self.nodes])
        self._painted = self._paint(results, points)
        self.low, self.high = points[self.nodes].min(axis=0), points[self.nodes].max(axis=0)
        self.times, self.tops = list[float](), dict.fromkeys(TITLES, 0.0)
        self.marks = {name: list[tuple[float, int]]() for name in TITLES}

    def _paint(self, results: Results, points: np.ndarray, step: int | str = "") -> dict[str, Any]:
        """Put the surfaces of contacts of bodies with these `points` (nv, 3)."""
        painted = painted_on(results, points, self._owner, pressed(results))
        painted["surface"] -= self._s[painted["nearest"]]
        for name in "surface", "above", "painted", "bearer", *["rims"] * results.axisymmetric:
            self.arrays.put(f"{name}{step}", painted[name])
        return painted

    def _whole_surfaces(self, surfaces: dict[str, Columns]) -> dict[str, Columns]:
        """What contacts cover in all sectors."""
        return {name: _whole(self._sectors, each) for name, each in surfaces.items()}

    def put(self, k: int, time: float, fields: Columns, surfaces: dict[str, Columns]) -> None:
        """Put the k-th load step."""
        results, nodes = self._results, self.nodes
        fields, surfaces = _whole(self._sectors, fields), self._whole_surfaces(surfaces)
        u = in_space(fields["displacement"][:, : results.dimension]) + self._s
        if results.frames:  # contacts then have other surfaces in each step
            at = (fields["points"] - self._s)[nodes]
            self.low = np.minimum(self.low, at.min(axis=0))
            self.high = np.maximum(self.high, at.max(axis=0))
            self.arrays.put(f"at{k}", at)
            self._painted = self._paint(replace(results, surfaces=surfaces), fields["points"], k)
        values = {"displacement": magnitude(u - self._s)[nodes]}
        if len(self._painted["painted"]) or (
            results.frames and surfaces
        ):  # steps without contact, too
            pressures = [
                np.nan_to_num(surfaces[name]["pressure"])[rows]
                for name, rows in self._painted["rows"]
            ]
            values["pressure"] = np.concatenate(pressures)
        if "nodal_von_mises" in fields:
            values["von_mises"] = fields["nodal_von_mises"][nodes]
        self.times.append(time)
        self.arrays.put(f"moved{k}", u[nodes])
        self.arrays.put(f"lifted{k}", u[self._painted["nearest"]])
        for name, value in values.items():
            self.arrays.put(f"{name}{k}", np.maximum(value, 0.0))
            self.tops[name] = max(self.tops[name], value.max(initial=0.0))
            place = int(value.argmax()) if len(value) else 0
            self.marks[name].append((float(value.max(initial=0.0)), place))
        if "nodal_von_mises" in fields:  # that of a cell, as in the summary: nodes extrapolate it
            most, node = largest_of(results.fields | fields)
            self.marks["von_mises"][-1] = most, int(self._number[node])

    def _fields(self) -> list[dict[str, Any]]:
        """What colours can stand for; their arrays change to the units that are shown."""
        shown = []
        for name, (title, quantity) in TITLES.items():
            if not self.marks[name]:
                continue
            largest = max(most for most, _ in self.marks[name])
            factor, words = scaled_unit(largest, self._results.units[quantity])
            for k in range(len(self.times)):
                self.arrays.places[f"{name}{k}"]["high"] /= factor
            pressure = name == "pressure"
            shown.append(
                {
                    "name": name,
                    "title": title,
                    "unit": words,
                    "painted": pressure,
                    "colours": COLOURS["pressure" if pressure else "stress"],
                    "low": 0.0,
                    "high": self.tops[name] / factor or 1.0,
                    "marks": [(most / factor, k) for most, k in self.marks[name]],
                }
            )
        return shown

    def head(self) -> dict[str, Any]:
        """All but the arrays themselves, as the page reads it. To be called once, after the last step."""
        results, low, high = self._results, self.low, self.high
        turned = results.axisymmetric  # the page turns the section around y
        eye = self._view.axes[2]
        if turned:  # all around; seen into the quarter that is left out
            low[[0, 2]], high[[0, 2]] = -high[0], high[0]
            eye = np.array([0.43, -0.75, 0.5])
        cuts = (results.output.get("cut") or {}).items()
        shifts = apart(results, self._view) if self._view.solid else {}
        return {
            "fields": self._fields(),
            "times": self.times,
            "timed": results.time is not None,
            "flat": not (self._view.solid or turned),
            "turned": turned,
            "cut": next(([axis, at] for axis, at in cuts if at is not None), None),
            "scale": self._scale,
            "low": low.tolist(),
            "high": high.tolist(),
            "arrays": self.arrays.places,
            "view": angles_of(eye),
            "shifts": [shifts.get(name, np.zeros(3)).tolist() for name in results.parts],
        }


def _whole(sectors: list[Frame], fields: Columns) -> Columns:
    """Fields of a sector, or of what a contact covers, as those of all: points and displacements turn, cells have nodes of
    their own, and all other values are the same."""
    d, count = len(sectors[0].shift), len(fields["points"])
    whole = {name: np.concatenate([values] * len(sectors)) for name, values in fields.items()}
    for k, frame in enumerate(sectors):
        own = slice(k * count, (k + 1) * count)
        whole["points"][own, :d] = frame.at(fields["points"][:, :d])
        if "displacement" in fields:
            whole["displacement"][own, :d] = fields["displacement"][:, :d] @ frame.turned.T
        cells = fields["cells"]
        start = k * len(cells)
        whole["cells"][start : start + len(cells)] = np.where(cells < 0, cells, cells + k * count)
    return whole


def painted_on(
    results: Results, points: np.ndarray, owner: np.ndarray, contacts: Sequence[dict]
) -> dict[str, Any]:
    """The surfaces of some contacts on both sides: places `surface` (n, 3), how far they are drawn `above` (n, 3) the part
    that bears them, and the triangles `painted` (f, 3) between them; the number `bearer` (n,) of that part, the
    `nearest` (n,) node, which they move with; the lines `rims` (r, 2) of contacts in the plane; and by
    contact the `rows` of its surface that they stand for."""
    extent, bodies = np.ptp(points, axis=0).max(), list(results.summary["bodies"])
    trees = {name: cKDTree(points[owner == k]) for k, name in enumerate(bodies)}
    places, above, triangles = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros((0, 3), int)]
    rims = [np.empty(0, int).reshape(-1, 2)]
    bearers, nearest, rows, first = [], [], list[tuple[str, np.ndarray]](), 0
    for contact in contacts:
        at, cells, outward, faces = covered(results, contact)
        for body, sign, facets in faces:
            some = np.arange(len(at))
            if cells.shape[1] == 2:  # ribbons into the part
                some = np.concatenate([some, some])
                place = np.concatenate([at, at - sign * RIBBON * extent * outward])
                lift = np.array([0.0, 0.0, ABOVE * extent]).repeat(len(place)).reshape(3, -1).T
                rims.append(cells + first)
                a, b = cells.T
                facets = np.concatenate(
                    [np.stack([a, b, b + len(at)], 1), np.stack([a, b + len(at), a + len(at)], 1)]
                )
            else:
                place, lift = at, sign * ABOVE * extent * outward
            mover = body if body in trees else contact["bodies"][0]
            own_nodes = np.flatnonzero(owner == bodies.index(mover))
            places.append(place)
            above.append(lift)
            triangles.append(facets + first)
            bearers.append(np.full(len(place), results.parts.index(body)))
            nearest.append(own_nodes[trees[mover].query(at)[1]][some])
            rows.append((contact["name"], some))
            first += len(place)
    return {
        "surface": np.vstack(places),
        "above": np.vstack(above),
        "painted": np.vstack(triangles),
        "rows": rows,
        "rims": np.vstack(rims),
        "bearer": np.concatenate([np.zeros(0, int), *bearers]),
        "nearest": np.concatenate([np.zeros(0, int), *nearest]),
    }
