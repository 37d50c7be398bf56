"""Where bodies run through each other, themselves or rigid partners, although no contact keeps them apart.

A body is a set of simplices of any dimension. It runs into another where points of its boundary lie in simplices of it.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from mpi4py import MPI
from scipy.spatial import cKDTree

from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactTotals
from ddmpi.mesh.mesh import Mesh, boundary_facets
from ddmpi.scene.contacts import Rigid
from ddmpi.system.agreement import gathered
from ddmpi.system.numbers import across, in_words, nearest_in

RESOLVED = 1e-3
"""Overlaps below this part of the largest displacement, of a body with itself of a cell, are not reported."""

DRAWN = 1e-6
"""Overlaps in the drawing below this part of the distance between nodes are not reported."""

CORNER = 0.5
"""A boundary is curved where a facet turns by less than this angle (rad) from the mean of its neighbours."""

INWARD = 0.25
"""Bodies with a common boundary are looked into at this part of the way from a facet to its cell's other corner."""

STEPS = 16
"""At most so many positions on the way from the drawing to the answer are looked at."""

ROUNDING = 32 * float(np.finfo(float).eps)
"""Relative error of coordinates after a few operations."""

WIDEN, ADD = "name the whole boundary that may touch in `on`", "add a [[contact]] between them"
"""What helps where bodies run through each other that a contact names, and those that none does."""

PAIRS = 2**20
"""So many pairs of points and facets at a time."""

FLATTEST = 1e-3
"""Extents of facets below this part of the largest count as this part, where facets near points are looked for."""

BESIDE = 1e-9
"""Overlaps with a rigid partner below this part of the body's size are rounding."""

BETWEEN = 0.25
"""A rigid partner may lie so deep between two contact nodes, as a part of their distance or of its radius."""


@dataclass(frozen=True)
class Solid:
    """A body as drawn and in the answer.

    Attributes
    ----------
    at, moved : (n, d) its nodes (m)
    cells : (c, d + 1) simplices between them
    facets : (f, d + 1) on its boundary, each followed by the other node of its cell
    numbers : (n,) of the nodes in the body's mesh, ascending
    """

    at: np.ndarray
    moved: np.ndarray
    cells: np.ndarray
    facets: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh, u: np.ndarray) -> Solid:
        """A body of this mesh that moved by `u` (n, d); cells are cut into linear ones."""
        d, cells, (facets, owner) = mesh.dimension, mesh.triangles, mesh.boundary
        if len(mesh.cell.parts) > 1:
            cells = cells[:, mesh.cell.parts].reshape(-1, d + 1)
            facets, owner = boundary_facets(cells)
        other = cells[owner].sum(axis=1) - facets.sum(axis=1)
        return cls(mesh.points, mesh.points + u, cells, np.column_stack([facets, other]), np.arange(len(mesh.points)))

    def box(self) -> tuple[np.ndarray, np.ndarray]:
        """The corners of the box around its boundary, as drawn and in the answer."""
        nodes = np.unique(self.facets)
        both = np.vstack([self.at[nodes], self.moved[nodes]])
        return both.min(axis=0), both.max(axis=0)

    def part(self, low: np.ndarray, high: np.ndarray) -> Solid:
        """The boundary and the cells that may meet the box from `low` to `high` (d,)."""
        beyond = np.hstack([np.maximum(self.at, self.moved) < low, np.minimum(self.at, self.moved) > high])
        cells = self.cells[np.bitwise_and.reduce(np.packbits(beyond, axis=1)[self.cells.T, 0]) == 0]
        nodes = np.unique(np.concatenate([cells.ravel(), self.facets.ravel()]))
        return Solid(self.at[nodes], self.moved[nodes], np.searchsorted(nodes, cells),
                     np.searchsorted(nodes, self.facets), self.numbers[nodes])

    def sizes(self) -> np.ndarray:
        """(f,) of the facets as drawn (m)."""
        ends = self.at[self.facets[:, :-1]]
        return np.linalg.norm(ends.max(axis=1) - ends.min(axis=1), axis=1)

    def gradient(self) -> float:
        """The largest strain or rotation of a side of a facet."""
        i, j = self.facets[:, :1], self.facets[:, 1:-1]
        apart, moved = self.at[j] - self.at[i], self.moved[j] - self.moved[i]
        return float((np.linalg.norm(moved - apart, axis=2) / np.linalg.norm(apart, axis=2)).max())

    def sagittas(self) -> np.ndarray:
        """(f,) how far at most the true boundary lies inside of the body's facets (m), which it does where hollow."""
        ends = self.at[self.facets[:, :-1]]
        middle = ends.mean(axis=1)
        normal = across(middle - self.at[self.facets[:, -1]], ends)[0]
        normal /= np.linalg.norm(normal, axis=1)[:, None]
        mean = np.zeros_like(self.at)
        np.add.at(mean, self.facets[:, :-1], normal[:, None])
        mean = mean[self.facets[:, :-1]]
        mean /= np.maximum(np.linalg.norm(mean, axis=2), np.finfo(float).tiny)[:, :, None]
        smooth = np.einsum("fkd,fd->fk", mean, normal) > np.cos(CORNER)
        inward = np.einsum("fkd,fkd->fk", mean - normal[:, None], middle[:, None] - ends)
        return np.where(smooth, np.maximum(inward, 0.0), 0.0).max(axis=1)  # twice those of a circle


class Overlap(NamedTuple):
    """The deepest point of one body in another: its distance to the nearest boundary of that one (m), and its place."""

    depth: float
    place: np.ndarray


def doubt_overlaps(assembly: Assembly, displacements: Mapping[str, np.ndarray],
                   contacts: Mapping[str, ContactTotals]) -> list[str]:
    """Warnings, on the first rank, where bodies run through each other or rigid partners outside their contacts.

    `contacts` are all on the first rank, on others those of their bodies. The first rank tells whose boxes overlap. Of
    two such bodies on two ranks one sends what is near. Collective.
    """
    world, names, unit = assembly.world, [body.name for body in assembly.scene.body], assembly.scene.units["length"]
    own = {body.number: Solid.of(body.mesh, displacements[body.spec.name]) for body in assembly.bodies}
    boxes = gathered(world, {number: (world.rank, each.box()) for number, each in own.items()})
    near = world.scatter(_pairs_by_rank(boxes, world.size) if world.rank == 0 else None)
    depths = _deepest(assembly, contacts)
    sending = [world.isend((own[b].part(*box), depths[names[b]]), there, b) for (a, b), there, (box, _) in near
               if b in own and a not in own]
    at_hand = {(a, b): (own[a].part(*other), *((own[b].part(*box), depths[names[b]]) if b in own else
                                               world.recv(None, there, b)))
               for (a, b), there, (box, other) in near if a in own}
    MPI.Request.waitall(sending)
    interfaces, found = {body.number: body.member.interfaces for body in assembly.bodies}, {}
    for number, each in own.items():
        place = through_itself(each)
        found[number, number] = [] if place is None else [
            f"body.{names[number]} runs through itself, as at {in_words(place, 4)}, where nothing keeps "
            "its sides apart; for sides that touch make two bodies of it, bonded where they hang together"]
    for (a, b), (one, other, beside) in at_hand.items():
        pair, solids = (names[a], names[b]), (one, other)
        kept = [np.isin(solid.numbers, _kept(interfaces[a], *ends)) for solid, ends in
                zip(solids, (pair, pair[::-1]), strict=True)]
        overlap, drawn = run_through(*solids, kept, _between(pair, depths[pair[0]], beside))
        if overlap:
            touch = any(set(contact.bodies) == set(pair) for contact in assembly.scene.contact)
            found[a, b] = [f"body.{pair[0]} and body.{pair[1]} run through each other by {overlap.depth:.3g} {unit}"
                           + f" ({drawn:.3g} {unit} as drawn)" * (drawn > 0.0)
                           + f", as at {in_words(overlap.place, 4)}, where no contact keeps them apart; "
                           + (WIDEN if touch else ADD)]
    found = gathered(world, {key: warnings for key, warnings in found.items() if warnings})
    return [*(warning for _, warnings in sorted(found.items()) for warning in warnings),
            *_doubt_rigid(assembly, displacements, contacts, own)]


def _pairs_by_rank(boxes: Mapping[int, tuple[int, tuple[np.ndarray, np.ndarray]]],
                   ranks: int) -> list[list[tuple[tuple[int, int], int, tuple]]]:
    """For each rank the pairs of bodies one of which it has and whose bounding boxes overlap: numbers, the other's
    rank, and the boxes. `boxes` are the ranks and bounding boxes of all bodies. Not collective."""
    numbers = sorted(boxes)
    low, high = np.array([boxes[number][1] for number in numbers]).transpose(1, 0, 2)
    found: list[list] = [[] for _ in range(ranks)]
    for k, a in enumerate(numbers):
        meets = ((low[k + 1:] <= high[k]) & (low[k] <= high[k + 1:])).all(axis=1)
        for b in (numbers[k + 1 + other] for other in np.flatnonzero(meets)):
            (here, box), (there, other) = boxes[a], boxes[b]
            found[here].append(((a, b), there, (box, other)))
            if there != here:
                found[there].append(((a, b), here, (box, other)))
    return found


def _deepest(assembly: Assembly, contacts: Mapping[str, ContactTotals]) -> dict[str, dict[str, float]]:
    """By body of this rank, how deep it and each of its partners lie in each other in their contacts (m)."""
    found: dict[str, dict[str, float]] = {body.spec.name: {} for body in assembly.bodies}
    for each in contacts.values():
        first, second = each.bodies
        for name, partner in (first, second), (second, first):
            if name in found:
                found[name][partner] = max(each.deepest, found[name].get(partner, -np.inf))
    return found


def _between(pair: tuple[str, str], first: Mapping[str, float], second: Mapping[str, float]) -> float:
    """By how much two bodies may overlap beside their contacts, or where they meet at a corner of others: as these do.
    The overlap of a contact between its nodes is an error of the discretization, which has a warning of its own.
    `first` and `second` are what `_deepest` has of the two."""
    return first.get(pair[1], 0.0) + sum(each[body] for each in (first, second) for body in first.keys() & second)


def _kept(interfaces: Sequence[Interface], body: str, other: str) -> np.ndarray:
    """The nodes (k,) of a body that its contacts with another one, or with a rigid partner, keep apart from it."""
    return np.concatenate([np.empty(0, int), *(
        nodes[each.side(body)] for each in interfaces if set(each.bodies) == {body, other}
        for nodes in (each.nodes, each.fixed.nodes))])


def through_itself(body: Solid) -> np.ndarray | None:
    """Where (d,) the boundary of a body lies in one of its cells in the answer, but not as drawn; None if nowhere."""
    facets, u = body.facets[:, :-1], (body.moved - body.at).T.copy()
    if not 0.0 < np.abs(u).max() <= np.ptp(body.at.T.copy(), axis=1).max():  # or is no number
        return None
    cells = body.cells[_reached(body, float(np.linalg.norm(np.ptp(u, axis=1))))]
    inside = _depth_in_cell(body.moved[facets].mean(axis=1), body.moved[cells]) > RESOLVED
    if inside.any():
        inside[inside] = _depth_in_cell(body.at[facets[inside]].mean(axis=1), body.at[body.cells]) <= RESOLVED
    return body.moved[facets[inside][0]].mean(axis=0) if inside.any() else None


def _reached(body: Solid, way: float) -> np.ndarray | slice:
    """The cells of a body that its boundary can get into on a `way` (m) past others: those at the boundary, or all. The
    way to the others is at least that on which the function falls from 1 to 0 that is 1 at boundary nodes."""
    outer = np.zeros(len(body.at), bool)
    outer[body.facets[:, :-1]] = True
    cells = np.flatnonzero(np.logical_or.reduce(outer[body.cells.T]))
    edges, values = body.at[body.cells[cells]], outer[body.cells[cells]].astype(float)
    edges, values = edges[:, 1:] - edges[:, :1], values[:, 1:] - values[:, :1]
    full = np.linalg.det(edges) != 0.0
    steepest = np.linalg.norm(np.linalg.solve(edges[full], values[full, :, None]), axis=1).max(initial=0.0)
    return cells if way * steepest < 1.0 else slice(None)


def run_through(first: Solid, second: Solid, kept: Sequence[np.ndarray], slack: float = 0.0,
                ) -> tuple[Overlap | None, float]:
    """The deepest overlap beyond rounding, curvature and second-order effects, and how deep the drawing has one.

    Parameters
    ----------
    kept : (n,) of each body, which of its nodes contacts keep from the other one
    slack : overlaps of the answer below this do not count (m)

    The answer's overlaps are looked for on the way from the drawing, so that a body which has passed a thin one is
    found. If there are none, those of the drawing count.
    """
    spacing = np.concatenate([first.sizes(), second.sizes()])
    rounding = ROUNDING * float(max(np.abs(each.at).max() for each in (first, second)))
    bows = first.sagittas(), second.sagittas()

    def deepest(x: np.ndarray, y: np.ndarray, least: float) -> Overlap | None:
        sides = (first, x, kept[0], bows[0]), (second, y, kept[1], bows[1])
        found = [*deepest_in(*sides[0], *sides[1], least), *deepest_in(*sides[1], *sides[0], least)]
        return max(found, key=_depth, default=None)

    drawn = deepest(first.at, second.at, rounding)
    deep = _depth(drawn)
    drawn = drawn if deep > DRAWN * np.median(spacing) else None
    u, v = first.moved - first.at, second.moved - second.at
    motions = np.concatenate([u[np.unique(first.facets)], v[np.unique(second.facets)]])
    size = max(np.ptp(each.at, axis=0).max() for each in (first, second))
    if not 0.0 < np.abs(motions).max() <= size:  # or is no number
        return drawn, _depth(drawn)
    largest = float(np.linalg.norm(motions - motions.mean(axis=0), axis=1).max())
    least = rounding + slack + (0.0 if drawn else deep)
    least += max(RESOLVED, first.gradient(), second.gradient()) * largest  # of second order in the displacement
    steps = int(np.clip(np.ceil(largest / spacing.min()), 1, STEPS))
    now = max((deepest(first.at + way * u, second.at + way * v, least) for way in np.linspace(1 / steps, 1.0, steps)),
              key=_depth)
    return now or drawn, _depth(drawn)


def _depth(overlap: Overlap | None) -> float:
    return overlap.depth if overlap else 0.0


def deepest_in(a: Solid, x: np.ndarray, kept: np.ndarray, bows: np.ndarray, b: Solid, y: np.ndarray,
               kept_of_b: np.ndarray, bows_of_b: np.ndarray, least: float) -> list[Overlap]:
    """Where the boundary of `a` at `x` lies deepest in the body `b` at `y`, if deeper than `least` and the sagittas.

    Boundary nodes are looked at, the middles of facets, and places a little inside of these. Those which contacts keep
    apart do not count where the boundary of `b` is nearest that they face; the others must lie deeper than these.
    """
    ends, middle = a.facets[:, :-1], x[a.facets[:, :-1]].mean(axis=1)
    nodes, facet = np.unique(ends, return_index=True)
    points = np.concatenate([x[nodes], middle, middle + INWARD * (x[a.facets[:, -1]] - middle)])
    held = np.concatenate([kept[nodes], *2 * [kept[ends].all(axis=1)]])
    slack = np.concatenate([bows[facet // ends.shape[1]], bows, bows])
    inside = np.flatnonzero(_depth_in_cell(points, y[b.cells]) >= -ROUNDING)
    if not len(inside):
        return []
    depth, nearest = distance_to(points[inside], y[b.facets[:, :-1]])
    held = held[inside] & kept_of_b[b.facets[nearest, :-1]].all(axis=1)
    excess = depth - slack[inside] - bows_of_b[nearest] - least - depth[held].max(initial=0.0)
    k = int(np.argmax(np.where(held, 0.0, excess)))
    return [Overlap(float(depth[k]), points[inside[k]])] if excess[k] > 0.0 and not held[k] else []


def _doubt_rigid(assembly: Assembly, displacements: Mapping[str, np.ndarray],
                 contacts: Mapping[str, ContactTotals], solids: Mapping[int, Solid]) -> list[str]:
    """Warnings, on the first rank, where a body runs through a rigid partner outside its contact with it; `solids` are
    the bodies of this rank. Collective."""
    moved = assembly.world.bcast({each.bodies[1]: each.rigid for each in contacts.values() if each.rigid is not None})
    found: dict[tuple[int, int], list[str]] = {}
    unit = assembly.scene.units["length"]
    for body in assembly.bodies:
        facets = solids[body.number].facets[:, :-1]
        for k, rigid in enumerate(assembly.scene.rigid):
            U = moved.get(rigid.name, np.array(rigid.displacement or np.zeros(body.mesh.dimension)))
            found[body.number, k] = _in_partner(body, facets, displacements[body.spec.name], U, rigid, unit)
    found = gathered(assembly.world, {key: warnings for key, warnings in found.items() if warnings})
    return [warning for _, warnings in sorted(found.items()) for warning in warnings]


def _in_partner(body: Body, facets: np.ndarray, u: np.ndarray, U: np.ndarray, rigid: Rigid, unit: str) -> list[str]:
    """A warning where a body lies in a rigid partner between the nodes of its contacts with it, or beside these.

    Beside them, a partner through which the body is drawn is left out if it may be meant to end before: a bore may be a
    piece of a socket, and a plane need not go on where no contact of the body names it. `facets` (f, d) are those of
    the body's boundary, `u` (nv, d) and `U` (d,) how far the two have moved (m).
    """
    name, mesh = body.spec.name, body.mesh
    own = [interface for interface in body.member.interfaces if interface.bodies[1] == rigid.name]
    touching = np.isin(facets, _kept(own, name, rigid.name))
    ends, between = (mesh.points + u - U)[facets], touching.all(axis=1)
    places, at_ends = rigid.deepest(ends), rigid.depth(ends)
    depth = rigid.depth(places)
    size = np.minimum(np.linalg.norm(ends.max(axis=1) - ends.min(axis=1), axis=1), rigid.bend)
    sunk = np.where(between, depth - np.maximum(at_ends.max(axis=1), 0.0) - BETWEEN * size, 0.0)
    k = int(np.argmax(sunk))
    if sunk[k] > 0.0:
        return [f"contact.{own[0].name}: {rigid.name} is small beside the distance of nodes of {name}, and lies "
                f"{depth[k]:.3g} {unit} deep between two of them, as at {in_words(places[k] + U, 4)}; a finer mesh "
                "there would be right"]
    if rigid.may_end(bool(own)) and (
            rigid.depth(mesh.points[facets[~touching]]).max(initial=0.0) > BESIDE * mesh.extent):
        return []
    beside, overlap = np.where(between, 0.0, depth), float(at_ends[touching].max(initial=0.0))
    k = int(np.argmax(beside))
    if not beside[k] > overlap + BESIDE * mesh.extent + RESOLVED * float(np.abs(u).max()):
        return []
    where = f"contact.{own[0].name}: beside the contact" if own else "no contact keeps them apart:"
    return [f"{where} {name} runs through {rigid.name} by {depth[k]:.3g} {unit}, as at "
            f"{in_words(places[k] + U, 4)}; {WIDEN if own else ADD}{rigid.crossed}"]


def _depth_in_cell(points: np.ndarray, cells: np.ndarray) -> np.ndarray:
    """The least barycentric coordinate (k,) of points (k, d) in the cell (c, d + 1, d) of which each is most inside. It
    is −∞ for points that are near no cell. Flat cells are near to few points where they are stretched to round ones."""
    best = np.full(len(points), -np.inf)
    if not len(cells):
        return best
    stretch = 1.0 / np.ptp(cells, axis=1).mean(axis=0)
    points, cells = stretch * points, stretch * cells
    centre, tree = cells.mean(axis=1), cKDTree(points)
    reach = np.sqrt(((cells - centre[:, None]) ** 2).sum(axis=2).max(axis=1))
    close = np.flatnonzero(tree.query(centre, distance_upper_bound=reach.max(initial=0.0))[0] <= reach)
    close = close[np.linalg.det(cells[close, 1:] - cells[close, :1]) != 0.0]
    found = tree.query_ball_point(centre[close], reach[close])
    cell, point = np.repeat(close, [len(each) for each in found]), np.concatenate([*found, []]).astype(int)
    base = cells[cell, 0]
    part = np.linalg.solve((cells[cell, 1:] - base[:, None]).transpose(0, 2, 1), (points[point] - base)[:, :, None])
    np.maximum.at(best, point, np.minimum(part.min(axis=(1, 2)), 1.0 - part.sum(axis=(1, 2))))
    return best


def distance_to(points: np.ndarray, facets: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The distance of each point (k, d) to the nearest of the facets (f, d, d), and the number of that one.

    Facets are looked at whose boxes, all as large as the largest extents, reach as near as one nearby.
    """
    half = np.ptp(facets, axis=1).max(axis=0)
    half = np.maximum(half, FLATTEST * half.max())
    middle = facets.mean(axis=1) / half
    tree = cKDTree(middle)
    number = tree.query(points / half)[1]
    radius = np.linalg.norm(nearest_in(points, facets[number]) - points, axis=1) * (1.0 + DRAWN) / half.min()
    distance = np.full(len(points), np.inf)
    for block in np.array_split(np.arange(len(points)), len(points) * len(facets) // PAIRS + 1):
        found = tree.query_ball_point(points[block] / half, 1.0 + radius[block], p=np.inf)
        point, facet = np.repeat(block, [len(each) for each in found]), np.concatenate([*found, []]).astype(int)
        away = np.linalg.norm(nearest_in(points[point], facets[facet]) - points[point], axis=1)
        order = np.lexsort((away, point))
        first = order[np.searchsorted(point[order], block)]
        distance[block], number[block] = away[first], facet[first]
    return distance, number
