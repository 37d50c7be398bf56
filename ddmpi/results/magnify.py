"""By which factor a picture enlarges deformations, and where it draws bodies and rigid partners, so that what touches
touches."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ddmpi.results.tables import Columns, Results

DRAWN = 0.08
"""Displacements and shifts are drawn as at most this fraction of the bodies' extent."""

INVISIBLE = 0.002
"""Errors of at most this fraction of the bodies' extent cannot be seen in a picture: two pixels."""

MARGIN = 0.04
"""A rigid surface is drawn longer at both ends than where bodies may touch it, by this fraction of the extent."""

WHOLE = 1.5
"""A rigid circle that bodies may touch over more than this angle is drawn as a whole."""


@dataclass(frozen=True)
class _Pairs:
    """The nodes of one contact.

    Attributes
    ----------
    bodies : numbers of the first and, unless it is rigid, the second body
    before : (m, 2) from the first to the second body along the normal, undeformed (m): the initial gap of the run,
        which a scene may give in place of the drawn one
    normal : (m, 2) of the first body
    gap : (m,) deformed (m)
    touching : (m,) bool
    """

    bodies: list[int]
    before: np.ndarray
    normal: np.ndarray
    gap: np.ndarray
    touching: np.ndarray

    def distance(self) -> np.ndarray:
        """(2,) mean distance of the undeformed nodes that will touch; of all nodes if none will."""
        return self.before[self.touching if self.touching.any() else slice(None)].mean(axis=0)

    def limits(self, shift: np.ndarray, visible: float) -> Iterator[float]:
        """The largest magnifications at which errors are not `visible` (m), `shift` being per unit of F − 1.

        The nodes are drawn F times as far apart as they are, but for (F − 1) `left`.
        """
        left = self.before - shift
        wrong = np.linalg.norm(left[self.touching], axis=1).max(initial=0.0)
        if wrong:
            yield 1.0 + visible / wrong
        into = np.einsum("ij,ij->i", left, self.normal)
        overlapping = into > self.gap
        yield from (visible + into[overlapping]) / (into - self.gap)[overlapping]


def magnify(results: Results, largest: float = 0.0) -> tuple[float, np.ndarray]:
    """The magnification F and a shift (nv, 2) in metres: a node at x that moves by u is drawn at x + shift + F u.

    Each body is shifted as a whole, by F − 1 times the gap that its contact had at first; negative for an overlap.
    Nodes are then drawn F times as far apart as they are, and touch where they touch. If gaps vary, as in rings, this
    holds for their mean only. F is then so small that no error at touching nodes, and no overlap at others, is visible;
    at F = 1 there are none. A scene that gives ``output.magnification`` accepts what it does. `largest` is a
    displacement of an earlier load step that F has to suit as well (m). Not collective.
    """
    points, u = results.fields["points"][:, :2], results.fields["displacement"][:, :2]
    owner = owners(results)
    names = list(results.summary["bodies"])
    pairs = [_pairs(results.contacts[contact["name"]], [names.index(name) for name in contact["bodies"]
                                                        if name in names])
             for contact in results.summary["scene"]["contact"]]
    apart = np.zeros((len(pairs), len(names)))
    for row, each in zip(apart, pairs, strict=True):
        row[each.bodies] = (-1.0, 1.0)[:len(each.bodies)]
    moved, mobile = np.linalg.norm(u, axis=1), np.zeros(len(names))
    np.maximum.at(mobile, owner, moved)
    distances = np.array([each.distance() for each in pairs]).reshape(-1, 2)
    shifts = np.zeros((len(names), 2))
    if distances.any():
        shifts = mobile[:, None] * (np.linalg.pinv(apart * mobile) @ distances)  # mostly of the body that moves most
    extent, size = np.ptp(points, axis=0).max(), max(moved.max(), largest, np.abs(shifts).max())
    limits = [limit for each, shift in zip(pairs, apart @ shifts, strict=True)
              for limit in each.limits(shift, INVISIBLE * extent)]
    chosen = _round_down(min([DRAWN * extent / size, *limits])) if size else 1.0
    factor = results.summary["scene"]["output"].get("magnification") or max(chosen, 1.0)
    return factor, (factor - 1.0) * shifts[owner]


def owners(results: Results) -> np.ndarray:
    """(nv,) the number of the body that each node belongs to."""
    found = np.zeros(len(results.fields["points"]), int)
    found[results.fields["cells"]] = results.fields["body"][:, None]
    return found


def _rigid(results: Results, time: float | None = None) -> dict[str, dict]:
    """Rigid partners by name, with their displacement at `time`, else at that of the results."""
    scene, histories = results.summary["scene"], results.summary["scene"].get("history", {})
    time = results.time if time is None else time
    if time is None and "time" in results.energy:
        time = results.energy["time"].max(initial=0.0)

    def factor(name: str | None) -> float:
        return 1.0 if name is None else float(np.interp(time or 0.0, histories[name]["times"],
                                                        histories[name]["factors"]))

    return {each["name"]: each | {"displacement": factor(each.get("history")) * np.array(each["displacement"])}
            for each in scene.get("rigid", ())}


def surfaces(results: Results, factor: float = 0.0,
             time: float | None = None) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Points (k, 2) along each rigid surface that bodies may touch, and its unit normals there, towards the bodies.

    Drawn where it has gone to at `time`, else at that of the results, its displacement times `factor`.
    """
    fields, contacts = results.fields, results.summary["scene"]["contact"]
    extent, owner = np.ptp(fields["points"][:, :2], axis=0).max(), owners(results)
    names = list(results.summary["bodies"])
    for name, rigid in _rigid(results, time).items():
        near = [each for each in contacts if each["bodies"][1] == name]
        if not near:
            continue
        touched = np.concatenate([np.column_stack([table["x"], table["y"]])
                                  for table in (results.contacts[each["name"]] for each in near)])
        if rigid["shape"] == "plane":
            normal = np.array(rigid["normal"]) / np.linalg.norm(rigid["normal"])
            along, point = np.array([normal[1], -normal[0]]), np.array(rigid["point"])
            bodies = fields["points"][np.isin(owner, [names.index(each["bodies"][0]) for each in near]), :2]
            ends = (bodies - point) @ along
            t = np.linspace(ends.min() - MARGIN * extent, ends.max() + MARGIN * extent, 200)
            at, normals = point + t[:, None] * along, np.tile(normal, (len(t), 1))
        else:
            center, radius = np.array(rigid["center"]), rigid["radius"]
            angle = np.sort(np.arctan2(*(touched - center).T[::-1]))
            holes = np.diff(angle, append=angle[0] + 2 * np.pi)  # the largest one is not touched
            k = int(np.argmax(holes))
            begin, length = angle[(k + 1) % len(angle)], 2 * np.pi - holes[k]
            margin = MARGIN * extent / radius
            if length + 2 * margin >= WHOLE:
                begin, length, margin = 0.0, 2 * np.pi, 0.0
            t = np.linspace(begin - margin, begin + length + margin, 400)
            outward = np.column_stack([np.cos(t), np.sin(t)])
            at, normals = center + radius * outward, -outward if rigid["inside"] else outward
        yield at + factor * rigid["displacement"], normals


def _pairs(nodes: Columns, bodies: list[int]) -> _Pairs:
    normal = np.column_stack([nodes["nx"], nodes["ny"]])
    return _Pairs(bodies, nodes["initial_gap"][:, None] * normal, normal, nodes["gap"], nodes["status"] != "open")


def _round_down(factor: float) -> float:
    """The largest of 1, 2, 5 times a power of ten that does not exceed `factor`."""
    power = 10.0 ** np.floor(np.log10(factor))
    return float(power * max(d for d in (1, 2, 5) if d * power <= factor * (1 + 1e-12)))
