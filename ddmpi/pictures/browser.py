"""view.html: the results of a run, to be turned in a browser. One file without references to a network."""

import base64
import json
import string
import zlib
from dataclasses import replace
from html import escape
from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial import cKDTree

from ddmpi import __version__
from ddmpi.errors import InputError
from ddmpi.pictures.bodies import BRIGHTEST, largest_of
from ddmpi.pictures.moved import ABOVE, apart, covered, magnify, pressed
from ddmpi.pictures.script import view_template
from ddmpi.pictures.sheet import limits
from ddmpi.pictures.views import Skin, View, sharp_edges
from ddmpi.results.fields import owners
from ddmpi.results.histories import at_step, load_steps, placed
from ddmpi.results.tables import Results, read_results, reading
from ddmpi.system.files import MECHANISM, write_page
from ddmpi.system.numbers import scaled_unit

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
            values, ends = (
                np.round((values - low) * (65535.0 / ((high - low) or 1.0))),
                {"low": low, "high": high},
            )
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
    output, d = results.summary["scene"]["output"], results.dimension
    turned = results.axisymmetric  # the page turns the section around y
    view = View(
        results.points, {key: output[key] for key in ("view",) if output.get(key) and d > 2}
    )
    skin, owner = Skin(view, results.points, results.fields["cells"]), owners(results)
    facets, areas = skin.facets, skin.areas(results.points)
    # solids keep the nodes inside, too, for cuts, unless there are too many
    cells = (
        results.fields["cells"][:, :4]
        if d > 2 and len(results.fields["cells"]) <= MOST_CELLS
        else facets[:0]
    )
    nodes = np.unique(np.concatenate([facets.ravel(), cells.ravel()]))
    number = np.zeros(len(owner), int)
    number[nodes] = np.arange(len(nodes))
    arrays, points = Arrays(), np.pad(results.points, ((0, 0), (0, 3 - d)))
    shifts = apart(results, view) if d > 2 else {}
    # A node is drawn at x + (F − 1) s + F u, with `magnify`: as x − s moved by F (u + s), whatever F is.
    scale, shift = magnify(results)
    s = np.pad(shift / (scale - 1.0) if scale > 1.0 else 0.0 * shift, ((0, 0), (0, 3 - d)))
    arrays.put("points", (points - s)[nodes])
    arrays.put("facets", number[facets])
    arrays.put("edges", number[sharp_edges(points, facets)])
    arrays.put("cells", number[cells])
    arrays.put("owner", owner[nodes])
    far = bool(results.frames)  # contacts then have other surfaces in each step

    def paint(results: Results, points: np.ndarray, step: int | str = "") -> dict[str, Any]:
        painted = _painted(results, points, owner)
        painted["surface"] -= s[painted["nearest"]]
        for name in "surface", "above", "painted", "bearer", *(("rims",) if turned else ()):
            arrays.put(f"{name}{step}", painted[name])
        return painted

    painted = paint(results, points)
    low, high = points[nodes].min(axis=0), points[nodes].max(axis=0)
    times, tops, marks = (
        [],
        dict.fromkeys(TITLES, 0.0),
        {name: list[tuple[float, int]]() for name in TITLES},
    )
    seen = load_steps(
        results,
        folder,
        max(1, int(MOST_NUMBERS / (5 * len(nodes)))),
        ("von_mises", "nodal_von_mises"),
    )
    for k, (time, fields, surfaces) in enumerate(seen):
        u = np.pad(fields["displacement"][:, :d], ((0, 0), (0, 3 - d))) + s
        if far:
            at = (fields["points"] - s)[nodes]
            low, high = np.minimum(low, at.min(axis=0)), np.maximum(high, at.max(axis=0))
            arrays.put(f"at{k}", at)
            painted = paint(replace(results, surfaces=surfaces), fields["points"], k)
        values = {"displacement": np.linalg.norm(u - s, axis=1)[nodes]}
        if len(painted["painted"]) or (far and surfaces):  # steps without contact, too
            values["pressure"] = np.concatenate(
                [np.nan_to_num(surfaces[name]["pressure"])[rows] for name, rows in painted["rows"]]
            )
        if "nodal_von_mises" in fields:
            values["von_mises"] = fields["nodal_von_mises"][nodes]
        times.append(time)
        arrays.put(f"moved{k}", u[nodes])
        arrays.put(f"lifted{k}", u[painted["nearest"]])
        for name, value in values.items():
            arrays.put(f"{name}{k}", np.maximum(value, 0.0))
            some = value > 0.0 if name == "pressure" else areas[nodes] > 0.0
            share = np.ones(some.sum()) if name == "pressure" else areas[nodes][some]
            tops[name] = max(
                tops[name], limits(value[some], share, BRIGHTEST)[1] if some.any() else 0.0
            )
            marks[name].append(
                (float(value.max(initial=0.0)), int(value.argmax()) if len(value) else 0)
            )
        if "nodal_von_mises" in fields:  # that of a cell, as in the summary: nodes extrapolate it
            most, node = largest_of(results.fields | fields)
            marks["von_mises"][-1] = most, int(number[node])
    shown = []
    for name, (title, quantity) in TITLES.items() if times else ():
        if marks[name]:
            factor, words = scaled_unit(
                max(most for most, _ in marks[name]), output[f"{quantity}_unit"]
            )
            for k in range(len(times)):
                arrays.places[f"{name}{k}"]["high"] /= factor
            shown.append(
                {
                    "name": name,
                    "title": title,
                    "unit": words,
                    "painted": name == "pressure",
                    "colours": COLOURS["pressure" if name == "pressure" else "stress"],
                    "low": 0.0,
                    "high": tops[name] / factor or 1.0,
                    "marks": [(most / factor, k) for most, k in marks[name]],
                }
            )
    if turned:  # all around
        low[[0, 2]], high[[0, 2]] = -high[0], high[0]
    eye = (
        np.array([0.43, -0.75, 0.5]) if turned else view.axes[2]
    )  # into the quarter that is left out
    head = {
        "fields": shown,
        "times": times,
        "timed": results.time is not None,
        "flat": d < 3 and not turned,
        "turned": turned,
        "cut": next(
            ([axis, at] for axis, at in (output.get("cut") or {}).items() if at is not None), None
        ),
        "scale": scale,
        "low": low.tolist(),
        "high": high.tolist(),
        "arrays": arrays.places,
        "view": np.degrees(
            [np.arctan2(eye[1], eye[0]), np.arcsin(np.clip(eye[2], -1.0, 1.0))]
        ).tolist(),
        "shifts": [shifts.get(name, np.zeros(3)).tolist() for name in results.parts],
    }
    template = string.Template(view_template())
    return template.substitute(
        version=__version__,
        title=escape(results.summary["title"] or ", ".join(results.summary["bodies"])),
        head=json.dumps(head).replace("<", "\\u003c"),
        data=arrays.packed(),
    )


def _painted(results: Results, points: np.ndarray, owner: np.ndarray) -> dict[str, Any]:
    """The surfaces of contacts on both sides: places `surface` (n, 3), how far they are drawn `above` (n, 3) the part
    that bears them, and the triangles `painted` (f, 3) between them; the number `bearer` (n,) of that part, the
    `nearest` (n,) node, which they move with; the lines `rims` (r, 2) of contacts in the plane; and by
    contact the `rows` of its surface that they stand for."""
    extent, bodies = np.ptp(points, axis=0).max(), list(results.summary["bodies"])
    trees = {name: cKDTree(points[owner == k]) for k, name in enumerate(bodies)}
    places, above, triangles = [np.zeros((0, 3))], [np.zeros((0, 3))], [np.zeros((0, 3), int)]
    rims = [np.empty(0, int).reshape(-1, 2)]
    bearers, nearest, rows, first = [], [], list[tuple[str, np.ndarray]](), 0
    for contact in pressed(results):
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
