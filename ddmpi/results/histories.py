"""Results at a load step and along a line."""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import ElementTree

import msgspec
import numpy as np

from ddmpi.body.stress import principal, von_mises
from ddmpi.errors import InputError
from ddmpi.mesh.elements import Cell
from ddmpi.results.fields import IN_FILES, by_kind, group_of, owners, vectors
from ddmpi.results.summary import drawn_times, place_of_all, plain
from ddmpi.results.tables import (
    PATH,
    Columns,
    Results,
    datasets,
    leg_columns,
    read_lines,
    read_surfaces,
    side_means,
    write_table,
)
from ddmpi.scene.time import History, most_loaded
from ddmpi.surface.near import contained
from ddmpi.system.numbers import Frame, in_words, place_of_largest

INSIDE, OUTSIDE = -1e-6, -0.05
"""A place is in a cell if its barycentric coordinates are above INSIDE, hardly outside if they are above OUTSIDE."""

MOST, FARTHEST = (
    100_000,
    1e150,
)  # of a path most points, and the largest coordinate (m), whose square does not overflow
NEWTON = 8  # Newton steps to the barycentric coordinates of a place; straight cells need one

FRAMES_IN = {
    2: ("time", "body", "shift_x", "shift_y", "turn"),
    3: ("time", "body", "shift_x", "shift_y", "shift_z", "turn_x", "turn_y", "turn_z"),
}
"""The columns of frames.csv by dimension: what was drawn at X is at shift + Q X, without its displacement in the frame;
turns are those of Q, in space along its axis (degrees)."""


def write_frames(path: Path, steps: Iterable[tuple[float, Mapping[str, Frame]]]) -> None:
    """Write frames.csv into the folder `path`: a line for each load step and each body or rigid partner that moves far.
    Not collective. Raises OutputError."""
    lines = [
        (time, name, *frame.shift, *frame.turn)
        for time, frames in steps
        for name, frame in frames.items()
    ]
    columns = next(columns for columns in FRAMES_IN.values() if len(columns) == len(lines[0]))
    write_table(path / "frames.csv", columns, lines)


def frames_at(results: Results, time: float | None = None) -> dict[str, Frame]:
    """Where the frames of bodies and rigid partners are at the end of a load step, by name, by default that of the
    results; empty where nothing moves far. Not collective."""
    table, d = results.frames, results.dimension
    if not table:
        return {}
    time = results.time if time is None else time
    rows = np.flatnonzero(table["time"] == (table["time"][-1] if time is None else time))
    values = np.column_stack([table[name][rows] for name in FRAMES_IN[d][2:]])
    return {
        str(body): Frame.of(value[:d]).after(Frame.of((0.0,) * d, value[d:]))
        for body, value in zip(table["body"][rows], values, strict=True)
    }


def placed(results: Results, time: float | None = None, fields: Columns | None = None) -> Results:
    """The results as pictures take them, at the end of the load step that they, or these `fields`, are of: bodies that
    move far are drawn where their frames are, and displacements are those in the frames. Not collective."""
    frames, fields = frames_at(results, time), results.fields | (fields or {})
    if not frames:
        return replace(results, fields=fields)
    drawn = fields.get("drawn", fields["points"])
    points, u, owner = drawn.copy(), fields["displacement_in_frame"].copy(), owners(results)
    for k, name in enumerate(results.summary["bodies"]):
        frame, mine = frames[name], owner == k
        d = len(frame.shift)
        points[mine, :d], u[mine, :d] = frame.at(drawn[mine, :d]), frame.along(u[mine, :d])
    return replace(results, fields=fields | {"drawn": drawn, "points": points, "displacement": u})


def step_times(folder: Path) -> list[float]:
    """The ends of the load steps whose fields are in the `folder`; none without [time]."""
    document = ElementTree(file=folder / "result.xdmf")
    return [float(element.attrib["Value"]) for element in document.findall("Domain/Grid/Grid/Time")]


def evenly(number: int, most: int) -> np.ndarray:
    """At most so many of the places 0, …, `number` − 1: the last one, the first one, and others evenly between."""
    return np.unique(np.linspace(number - 1, 0, min(most, number)).round().astype(int))


def load_steps(
    results: Results,
    folder: Path,
    most: int,
    shown: Collection[str] = (),
) -> Iterator[tuple[float, Columns, dict[str, Columns]]]:
    """Time, fields as they are drawn, and surfaces of contacts, of at most so many of the load steps whose fields are
    in the `folder`, or of the only one. Of the fields, displacements and those to be `shown` are of the load step."""
    import h5py

    read = {"displacement", "displacement_in_frame", *shown}
    times = (step_times(folder) if results.energy else []) or [1.0]
    with h5py.File(folder / "result.h5", "r") as file:
        for k in evenly(len(times), most):
            fields = file.get(group_of(k), file)  # the last step has no group
            drawn = {name: fields[name][()] for name in read if name in fields}
            yield (
                times[k],
                placed(results, times[k], drawn).fields,
                read_surfaces(file, group_of(k)),
            )


def at_step(results: Results, folder: Path, asked: float | None = None) -> Results:
    """The results of a load step whose fields are in the `folder`: that at the time `asked` for, by default the one
    of the largest load, the last one if there are several.

    The load is the sum of the factors of all histories, without signs, each over its largest one.

    Entries of the summary that are known for the last step alone are None: strain energies, estimated errors, overlaps
    between nodes. The certificate and the dissipation stay those of all steps. Without load steps, or without an
    answer, `results` are as they were read. Not collective. Raises InputError where the time `asked` for has no fields.
    """
    import h5py

    # no run of version 0.6 has complete tables
    complete = results.energy and all("gap" in legs for legs in results.legs.values())
    times = np.array(step_times(folder) if complete else [])
    if asked is None:
        if len(times) == 0 or not results.summary["converged"]:
            return results
        histories = msgspec.convert(results.scene.get("history", {}), dict[str, History])
        drawn = drawn_times(results.summary, times)
        asked = float(times[most_loaded(histories.values(), drawn)])
    number = _number_of(asked, times, folder)
    time, group = float(times[number]), group_of(number)
    with h5py.File(folder / "result.h5", "r") as file:
        if group not in file:  # it is the last step
            return replace(results, time=time)
        fields = results.fields | {name: data[()] for name, data in datasets(file[group]).items()}
        # where bodies move far, contacts have rows of their own in each step
        surfaces, (rows, facets) = read_surfaces(file, group), read_lines(file, group)
    contacts = {
        name: _contact_at(results, name, time, rows.get(name) if rows else None)
        for name in results.legs
    }
    sides = {
        name: _means(table, contacts[name], results.axisymmetric)
        for name, table in results.sides.items()
    }
    return replace(
        results,
        summary=_summary_at(results, time, fields, contacts),
        contacts=contacts,
        fields=fields,
        time=time,
        sides=sides,
        surfaces=surfaces,
        facets=facets or results.facets,
    )


def _number_of(asked: float, times: np.ndarray, folder: Path) -> int:
    """Which of the times is the one that is `asked` for. Raises InputError where none is."""
    matching = np.flatnonzero(np.abs(times - asked) <= 1e-9 * abs(asked))
    if len(matching) == 0:
        raise InputError(
            f"{folder}: there are no fields of time {asked:g}; the times that have some: "
            f"{', '.join(f'{time:g}' for time in times) or 'none'}"
        )
    return int(matching[0])


def _contact_at(results: Results, name: str, time: float, rows: Columns | None) -> Columns:
    """The table of a contact at a load step, with the `rows` that it has there where bodies move far."""
    legs = results.legs[name]
    now = legs["time"] == time
    own = {column: values[now] for column, values in legs.items() if column != "time"}
    if rows is None:
        changed = {
            column: own[column] for column in leg_columns(results.dimension) if column in own
        }
        table = results.contacts[name] | changed
    else:
        table = own | rows
    area = table["length"] if "length" in table else table["area"]
    forces = {f"{kind}_force": table[f"{kind}_stress"] * area for kind in ("normal", "tangential")}
    return table | forces


def _summary_at(
    results: Results, time: float, fields: Columns, contacts: Mapping[str, Columns]
) -> dict[str, Any]:
    """The summary of a load step with these `fields` and tables of `contacts`."""
    summary = results.summary
    step = next(step for step in summary["steps"] if step["time"] == time)
    forces, moved, owner = step.get("bodies", {}), _moved(fields), owners(results)
    unknown: dict[str, Any] = {
        "energy": None,
        "reaction": (None,) * results.dimension,
        "discretization_error": None,
        "loads": {},
        "reactions": {},
    }
    bodies = {
        name: entry | unknown | forces.get(name, {}) | _extremes(results, fields, moved, owner, k)
        for k, (name, entry) in enumerate(summary["bodies"].items())
    }
    return summary | {
        "displacement_max": float(moved.max()),
        "displacement_max_at": plain(place_of_all(bodies.values(), "displacement_max")),
        "bodies": bodies,
        "rigid": step.get("rigid", {}),
        "discretization_error": summary["discretization_error"] | {"energy_norm": None},
        "contacts": {
            name: _totals_at(entry, step["contacts"][name], contacts[name])
            for name, entry in summary["contacts"].items()
        },
    }


def _totals_at(entry: dict, totals: dict, table: Columns) -> dict:
    """The summary's entry of a contact at a load step with these `totals` and this `table`."""
    pressure = table["normal_stress"]
    unknown = dict.fromkeys(("pointwise_penetration", "moment_imbalance", "moment_imbalance_bound"))
    own = {
        "dissipated": entry["dissipated"],
        # None where the contact has no rows, or no area, and stresses are NaN
        "pressure_max": plain(pressure.max(initial=-np.inf)),
        "pressure_max_at": plain(place_of_largest(pressure, vectors(table))),
    }
    return entry | unknown | totals | own


def _moved(fields: Columns) -> np.ndarray:
    """(nv,) sizes of displacements, of bodies that move far in their frames (m)."""
    displaced = "displacement_in_frame" if "displacement_in_frame" in fields else "displacement"
    return np.linalg.norm(fields[displaced], axis=1)


def _extremes(
    results: Results, fields: Columns, moved: np.ndarray, owner: np.ndarray, k: int
) -> dict[str, Any]:
    """Largest displacement and stress of the k-th body, with their places; `moved` (nv,) are sizes of displacements."""
    mine = owner == k
    far = fields["displacement"] if "displacement_in_frame" in fields else 0.0
    points = (fields["points"] + far)[:, : results.dimension]  # where bodies that move far are now
    found = {
        "displacement_max": float(moved[mine].max()),
        "displacement_max_at": plain(place_of_largest(moved[mine], points[mine])),
    }
    if "von_mises" in fields:
        own = fields["body"] == k
        stress, ((cell, _, nodes),) = (
            fields["von_mises"][own],
            by_kind(fields["cells"][own], results.dimension),
        )
        places = points[nodes[:, : cell.corners]].mean(axis=1)
        found |= {
            "von_mises_max": float(stress.max()),
            "von_mises_max_at": plain(place_of_largest(stress, places)),
        }
    return found


def _means(sides: Columns, nodes: Columns, axisymmetric: bool) -> Columns:
    """The table of sides with means of the stresses at their three `nodes`, of which the table has the middle one."""
    row = {place: k for k, place in enumerate(zip(nodes["x"], nodes["y"], strict=True))}
    # the nodes of a quadratic side are neighbours in the table; in a closed contact the first row follows the last one
    middle = np.array([row[place] for place in zip(sides["x"], sides["y"], strict=True)], int)
    three = np.stack([middle - 1, (middle + 1) % len(row), middle], axis=1)
    return sides | {
        column: side_means(nodes[column][three], vectors(nodes)[three], axisymmetric)
        for column in ("normal_stress", "tangential_stress")
    }


def along(results: Results, start: Sequence[float], end: Sequence[float], number: int) -> Columns:
    """The columns PATH at `number` places, evenly from `start` to `end` (d,), by shape functions from the nodes.

    A place outside all bodies has no line, unless it is hardly outside, as where the mesh has a chord for a curved
    side; where bodies touch, each has a line. Places are undeformed. Not collective. Raises InputError.
    """
    d, (first, last) = results.dimension, (np.array(point) for point in (start, end))
    alike = {len(first), len(last)} == {d} and np.abs([first, last]).max() < FARTHEST
    if not alike or not np.linalg.norm(last - first) or not 2 <= number <= MOST:
        raise InputError(
            f"a path has two different ends with {d} coordinates each, and 2 to {MOST} points"
        )
    length, share = np.linalg.norm(last - first), np.linspace(0.0, 1.0, number)
    places = first + share[:, None] * (last - first)
    place, cell, shapes = _located(
        results.points, results.fields["cells"], results.fields["body"], places
    )
    if len(place) == 0:
        raise InputError(f"the path from {in_words(first)} to {in_words(last)} meets no body")
    nodes = np.maximum(results.fields["cells"][cell], 0)  # whose shape functions are zero

    def interpolated(values: np.ndarray) -> np.ndarray:
        return np.einsum("pk,pkc->pc", shapes, values[nodes])

    axes, columns = "xyz"[:d], {"distance": length * share[place]}
    columns |= zip(axes, places[place].T, strict=True)
    columns["body"] = np.array(list(results.summary["bodies"]))[results.fields["body"][cell]]
    columns |= zip(
        (f"displacement_{axis}" for axis in axes),
        interpolated(results.displacement()).T,
        strict=True,
    )
    if "nodal_stress" in results.fields:
        sigma = interpolated(results.fields["nodal_stress"])[:, IN_FILES[: 2 * d]]
        for kind, values in ("stress", sigma), ("principal", principal(sigma)):
            columns |= zip((name for name in PATH if name.startswith(kind)), values.T, strict=False)
        columns["von_mises"] = von_mises(sigma)
    return columns


def _located(
    points: np.ndarray,
    cells: np.ndarray,
    body: np.ndarray,
    places: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The numbers of `places` that are in a cell, the best cell of each `body` (nt,), and the shape functions of its
    nodes (·, width) there."""
    found = []
    for kind, some, nodes in by_kind(cells, points.shape[1]):
        place, cell, inside, shapes = _located_in(kind, points[nodes], places)
        wide = np.pad(shapes, ((0, 0), (0, cells.shape[1] - len(kind.nodes))))
        found.append((place, some[cell], inside, wide))
    place, cell, inside, shapes = map(np.concatenate, zip(*found, strict=True))
    # hardly outside counts where a place is in no cell; of each place and body the cell that it is deepest in
    kept = inside >= INSIDE
    kept |= (inside >= OUTSIDE) & ~np.isin(place, place[kept])
    order = np.lexsort((-inside, body[cell], place))
    order = order[kept[order]]
    order = order[
        np.unique(np.column_stack([place, body[cell]])[order], axis=0, return_index=True)[1]
    ]
    return place[order], cell[order], shapes[order]


def _located_in(
    kind: Cell, nodes: np.ndarray, places: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """The numbers of `places` and of cells of one kind, with `nodes` (nt, k, d), in whose boxes they are; the least
    barycentric coordinate there, and the shape functions (·, k)."""
    low, high = nodes.min(axis=1), nodes.max(axis=1)
    place, cell = contained(places, low + OUTSIDE * (high - low), high - OUTSIDE * (high - low))
    nodes = nodes[cell]
    at = np.tile(kind.parameters(kind.middle), (len(cell), 1))
    # x(λ) = Σ φ_k(λ) x_k for λ, by Newton's method from the centroid
    for _ in range(1 if kind.simplex and kind.linear else NEWTON):
        hats = kind.hats_at(kind.coordinates(at))
        off = places[place] - np.einsum("pk,pkd->pd", kind.shapes(hats), nodes)
        tangents = np.einsum("apk,pkd->pda", kind.derivatives(hats), nodes)
        at = np.clip(at + np.linalg.solve(tangents, off[:, :, None])[:, :, 0], -1.0, 2.0)
    coordinates = kind.coordinates(at)
    return place, cell, coordinates.min(axis=1), kind.shapes(kind.hats_at(coordinates))
