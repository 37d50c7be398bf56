"""Where pictures draw bodies and rigid partners, and the magnification of displacements."""

from __future__ import annotations

from collections.abc import Iterator

import msgspec
import numpy as np

from ddmpi.results.tables import Columns, Results
from ddmpi.scene.contacts import Rigid

DRAWN = 0.08
"""Displacements and shifts are drawn as at most this fraction of the bodies' extent."""

INVISIBLE = 0.002
"""Errors of at most this fraction of the bodies' extent cannot be seen in a picture: two pixels."""

MARGIN = 0.04
"""A rigid surface is drawn longer at both ends than where bodies may touch it, by this fraction of the extent."""


def magnify(results: Results, largest: float = 0.0) -> tuple[float, np.ndarray]:
    """The magnification F and a shift (nv, 2) in metres: a node at x that moves by u is drawn at x + shift + F u.

    Each body is shifted as a whole, by F − 1 times the gap that its contact had at first; negative for an overlap.
    Nodes are then drawn F times as far apart as they are, and touch where they touch. If gaps vary, as in rings, this
    holds for their mean only. F is then so small that no error at touching nodes, and no overlap at others, is visible;
    at F = 1 there are none. A scene that gives ``output.magnification`` accepts what it does. `largest` is a
    displacement of an earlier load step that F has to suit as well (m). Not collective.
    """
    points, moved = results.fields["points"][:, :2], np.linalg.norm(results.fields["displacement"], axis=1)
    owner, names, contacts = owners(results), list(results.summary["bodies"]), results.summary["scene"]["contact"]
    tables = [results.contacts[contact["name"]] for contact in contacts]
    mobile, distances, apart = np.zeros(len(names)), np.zeros((len(tables), 2)), np.zeros((len(tables), len(names)))
    np.maximum.at(mobile, owner, moved)
    for k, (contact, table) in enumerate(zip(contacts, tables, strict=True)):
        touching = table["status"] != "open"
        distances[k] = _initially(table)[touching if touching.any() else slice(None)].mean(axis=0)
        bodies = [names.index(name) for name in contact["bodies"] if name in names]  # a rigid partner is none
        apart[k, bodies] = (-1.0, 1.0)[:len(bodies)]
    shifts = np.zeros((len(names), 2))
    if distances.any():
        shifts = mobile[:, None] * (np.linalg.pinv(apart * mobile) @ distances)  # mostly of the body that moves most
    extent, size = np.ptp(points, axis=0).max(), max(moved.max(), largest, np.abs(shifts).max())
    limits = [limit for table, shift in zip(tables, apart @ shifts, strict=True)
              for limit in _limits(table, shift, INVISIBLE * extent)]
    chosen = _round_down(min([DRAWN * extent / size, *limits])) if size else 1.0
    factor = results.summary["scene"]["output"].get("magnification") or max(chosen, 1.0)
    return factor, (factor - 1.0) * shifts[owner]


def _initially(table: Columns) -> np.ndarray:
    """(l, 2) from the first to the second body along the normal, undeformed (m): the gap that the run began with."""
    return table["initial_gap"][:, None] * np.column_stack([table["nx"], table["ny"]])


def _limits(table: Columns, shift: np.ndarray, visible: float) -> Iterator[float]:
    """The largest magnifications at which errors are not `visible` (m), `shift` being per unit of F − 1.

    The nodes are drawn F times as far apart as they are, but for (F − 1) `left`.
    """
    left, gap = _initially(table) - shift, table["gap"]
    wrong = np.linalg.norm(left[table["status"] != "open"], axis=1).max(initial=0.0)
    if wrong:
        yield 1.0 + visible / wrong
    into = left[:, 0] * table["nx"] + left[:, 1] * table["ny"]
    overlapping = into > gap
    yield from (visible + into[overlapping]) / (into - gap)[overlapping]


def owners(results: Results) -> np.ndarray:
    """(nv,) the number of the body that each node belongs to."""
    found = np.zeros(len(results.fields["points"]), int)
    found[results.fields["cells"]] = results.fields["body"][:, None]
    return found


def surfaces(results: Results, factor: float = 0.0,
             time: float | None = None) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Points (k, 2) along each rigid surface that bodies may touch, and its unit normals there, towards the bodies.

    Drawn where it has gone to at `time`, else at that of the results, its displacement times `factor`.
    """
    fields, scene, names = results.fields, results.summary["scene"], list(results.summary["bodies"])
    extent, owner = np.ptp(fields["points"][:, :2], axis=0).max(), owners(results)
    last = results.energy.get("time", np.zeros(0)).max(initial=0.0)
    time = next(each for each in (time, results.time, last) if each is not None)
    for rigid in msgspec.convert(scene.get("rigid", ()), list[Rigid]):
        near = [each for each in scene["contact"] if each["bodies"][1] == rigid.name]
        if not near:
            continue
        touched = np.concatenate([np.column_stack([table["x"], table["y"]])
                                  for table in (results.contacts[each["name"]] for each in near)])
        bodies = fields["points"][np.isin(owner, [names.index(each["bodies"][0]) for each in near]), :2]
        at = rigid.outline(touched, bodies, MARGIN * extent)
        history = scene.get("history", {}).get(rigid.history)
        share = np.interp(time, history["times"], history["factors"]) if history else 1.0
        yield at + factor * share * np.array(rigid.displacement), rigid.facing(at)[0]


def _round_down(factor: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed `factor`."""
    power = 10.0 ** np.floor(np.log10(factor))
    return float(power * max(d for d in (1, 2, 5) if d * power <= factor * (1 + 1e-12)))
