"""Where bodies penetrate each other, themselves or rigid partners, although no contact keeps them apart.

A body is a set of simplices, and penetrates another one where points of its boundary lie in cells of that one.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple, Self

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.interface.interface import Interface
from ddmpi.interface.state import ContactTotals
from ddmpi.mesh.elements import cell_with, normals
from ddmpi.mesh.mesh import Mesh
from ddmpi.scene.contacts import Rigid
from ddmpi.surface.near import distance_to, most_inside
from ddmpi.surface.seams import Skin
from ddmpi.system.agreement import gathered
from ddmpi.system.doubts import Doubt
from ddmpi.system.numbers import ALIKE, SAME, Frame, RigidMotion, in_words

RESOLVED = 1e-3  # do not warn of overlaps below this fraction of the largest displacement

WIDEN, ADD = "name the whole boundary that may touch in `on`", "add a [[contact]] between them"
"""What helps where bodies overlap that a contact names, and those that none does."""

Box = tuple[
    np.ndarray, np.ndarray
]  # its corners (d,) of the least and of the largest coordinates (m)


Warnings = dict[tuple[bool, int, int], str]
"""Of overlaps, in their order: of rigid partners or not, the number of a body, and of the other one or of the partner."""


@dataclass(frozen=True)
class Solid:
    """A body as drawn and in the answer.

    Attributes
    ----------
    at, moved : (n, d) its nodes (m)
    cells : (c, k) nodes of its cells, linear or quadratic
    facets : (f, d + 1) linear facets of its boundary, each followed by a corner of its cell that is not on it
    numbers : (n,) of the nodes in the body's mesh, ascending
    """

    at: np.ndarray
    moved: np.ndarray
    cells: np.ndarray
    facets: np.ndarray
    numbers: np.ndarray

    @classmethod
    def of(cls, mesh: Mesh, u: np.ndarray) -> Self:
        """A body of this mesh that moved by `u` (n, d)."""
        still = mesh.once(as_drawn)
        body = cls(mesh.points, mesh.points + u, still.cells, still.facets, still.numbers)
        known = ("outer", "height", "within")
        vars(body).update({name: getattr(still, name) for name in known})
        return body

    @cached_property
    def outer(self) -> np.ndarray:
        """The nodes on its boundary."""
        return np.unique(self.facets[:, :-1])

    @cached_property
    def size(self) -> float:
        """Twice the largest distance from its middle as drawn, however it lies (m)."""
        return _spread(self.at[self.outer])

    @cached_property
    def height(self) -> np.ndarray:
        """(f,) of the cells over the facets, as drawn (m)."""
        normal = normals(self.at[self.facets[:, :-1]])
        inward = self.at[self.facets[:, 0]] - self.at[self.facets[:, -1]]
        return np.abs((normal * inward).sum(axis=1)) / np.linalg.norm(normal, axis=1)

    @cached_property
    def gradient(self) -> float:
        """The largest strain or rotation of an edge of a facet."""
        i, j = self.facets[:, :1], self.facets[:, 1:-1]
        drawn, turned = self.at[j] - self.at[i], self.moved[j] - self.moved[i]
        return float((np.linalg.norm(turned - drawn, axis=2) / np.linalg.norm(drawn, axis=2)).max())

    @cached_property
    def sagitta(self) -> np.ndarray:
        """(f,) by how much the true boundary may lie inside of a facet (m), as it does where it is hollow, and once more
        as much for what is not known of its curvature."""
        return 2.0 * Skin(self.at, self.facets[:, :-1]).hollow

    @cached_property
    def within(self) -> np.ndarray:
        """(f,) how deep the middles of facets lie in cells over other facets, as drawn; see `most_inside`."""
        corners = self.facets[:, :-1]
        middles = self.at[corners].mean(axis=1)
        return most_inside(middles, self.at[self.facets.T], (corners, self.facets))[0]

    def placed(self, fraction: float) -> np.ndarray:
        """Its nodes (n, d) after a `fraction` of their displacements (m)."""
        return self.at + fraction * (self.moved - self.at) if fraction else self.at

    def box(self) -> Box:
        """The corners of the box around it, as drawn and in the answer."""
        both = np.stack([self.at, self.moved])
        return both.min(axis=(0, 1)), both.max(axis=(0, 1))

    def near(self, low: np.ndarray, high: np.ndarray, *at: np.ndarray) -> np.ndarray:
        """Its cells that may meet the box from `low` to `high` with nodes at all `at` (n, d) or between these."""
        beyond = np.hstack([np.maximum.reduce(at) < low, np.minimum.reduce(at) > high])
        sides = np.packbits(beyond, axis=1)[
            :, 0
        ]  # a bit for each side of the box; no cell may have one in common
        return self.cells[np.bitwise_and.reduce(sides[self.cells.T]) == 0]

    def near_box(self, low: np.ndarray, high: np.ndarray) -> Self:
        """Its boundary, and the cells that may meet a box between the drawing and the answer, for another rank."""
        cells = self.near(low, high, self.at, self.moved)
        nodes = np.unique(np.concatenate([cells.ravel(), self.facets.ravel()]))
        return type(self)(
            self.at[nodes],
            self.moved[nodes],
            np.searchsorted(nodes, cells),
            np.searchsorted(nodes, self.facets),
            self.numbers[nodes],
        )


def _spread(vectors: np.ndarray) -> float:
    """Twice the largest distance of vectors (n, d) from their mean."""
    return 2.0 * float(np.hypot.reduce(vectors - vectors.mean(axis=0), axis=1).max())


def as_drawn(mesh: Mesh) -> Solid:
    """A body of this mesh that has not moved. Not collective."""
    (facets, owner), facet = mesh.boundary, mesh.cell.facet
    corners = mesh.corners[owner]
    on_facet = (corners[:, :, None] == facets[:, None, : facet.corners]).any(axis=2)
    opposite = corners[np.arange(len(corners)), on_facet.argmin(axis=1)]  # one that is not on it
    outer = np.column_stack([facet.split(facets), np.tile(opposite, len(facet.parts))])
    return Solid(mesh.points, mesh.points, mesh.triangles, outer, np.arange(len(mesh.points)))


class Overlap(NamedTuple):
    """The deepest point of a body in another: its distance to the nearest boundary of that one (m), and its place."""

    depth: float = 0.0
    place: np.ndarray = np.zeros(0)


def doubt_overlaps(
    assembly: Assembly,
    displacements: Mapping[str, np.ndarray],
    contacts: Mapping[str, ContactTotals],
) -> list[str]:
    """Warnings, on the first rank, where bodies penetrate each other or rigid partners outside their contacts.

    `contacts` are all on the first rank, which finds the pairs of bodies whose boxes overlap. Where the two are on two
    ranks, that of the second sends the cells near the first. Collective.
    """
    world = assembly.world
    solids = {
        body.number: Solid.of(body.mesh, displacements[body.spec.name]) for body in assembly.bodies
    }
    interfaces = {body.number: body.member.interfaces for body in assembly.bodies}
    boxes = gathered(world, {number: (world.rank, solid.box()) for number, solid in solids.items()})
    pairs = list(_meeting(boxes)) if world.rank == 0 else []
    near = world.scatter(
        [[pair for pair in pairs if rank in pair[1]] for rank in range(world.size)]
    )
    depths = world.bcast(_depths(contacts))
    sending = [
        world.isend(solids[b].near_box(*box), ranks[0], b)
        for (a, b), ranks, box in near
        if b in solids and a not in solids
    ]
    warnings = Warnings()
    for number, solid in solids.items():
        warnings |= _doubt_itself(assembly, number, solid, interfaces[number])
    for (a, b), ranks, _ in near:
        if a in solids:
            second = solids[b] if b in solids else world.recv(None, ranks[1], b)
            warnings |= _doubt_pair(assembly, (a, b), (solids[a], second), interfaces[a], depths)
    MPI.Request.waitall(sending)
    warnings |= _doubt_rigid(assembly, contacts, solids)
    return [warning for _, warning in sorted(gathered(world, warnings).items())]


def _doubt_itself(
    assembly: Assembly, number: int, body: Solid, interfaces: Sequence[Interface]
) -> Warnings:
    """The warning, if any, of a body that penetrates itself, by (False, body, body). Not collective."""
    name, unit = assembly.scene.body[number].name, assembly.scene.units["length"]
    own = penetrates_itself(body, np.isin(body.numbers, _kept(interfaces, name, name)))
    if not own.depth:
        return {}
    words = (
        f"body.{name} penetrates itself by {own.depth:.3g} {unit} or more, as at {in_words(own.place, 4)}, where no contact "
        f'keeps its sides apart; if they may touch, add a contact with bodies = ["{name}", "{name}"]'
    )
    return {(False, number, number): Doubt(words, "itself", own.depth, f"body.{name}")}


def _doubt_pair(
    assembly: Assembly,
    numbers: tuple[int, int],
    solids: tuple[Solid, Solid],
    interfaces: Sequence[Interface],
    depths: Mapping[str, Mapping[str, float]],
) -> Warnings:
    """The warning, if any, of two bodies that penetrate each other, by (False, first, second). `interfaces` are those of
    the first body, `depths` as of `_depths`. Not collective."""
    scene, unit = assembly.scene, assembly.scene.units["length"]
    pair = scene.body[numbers[0]].name, scene.body[numbers[1]].name
    kept = [
        np.isin(solid.numbers, _kept(interfaces, *ends))
        for solid, ends in zip(solids, (pair, pair[::-1]), strict=True)
    ]
    overlap, drawn = penetration(*solids, kept, _between(*pair, depths))
    if not overlap.depth:
        return {}
    touch = any(set(contact.bodies) == set(pair) for contact in scene.contact)
    as_drawn = f" ({drawn:.3g} {unit} as drawn)" * (drawn > 0.0)
    words = (
        f"body.{pair[0]} and body.{pair[1]} penetrate each other by {overlap.depth:.3g} {unit}{as_drawn}, as at "
        f"{in_words(overlap.place, 4)}, where no contact keeps them apart; {WIDEN if touch else ADD}"
    )
    subject = f"body.{pair[0]}-{pair[1]}"
    return {(False, *numbers): Doubt(words, "penetrate", overlap.depth, subject)}


def _meeting(
    boxes: Mapping[int, tuple[int, Box]],
) -> Iterator[tuple[tuple[int, int], tuple[int, int], Box]]:
    """The pairs of bodies whose boxes overlap: their numbers, their ranks, and the box of the first. `boxes` are the
    ranks and boxes of all bodies. Not collective."""
    numbers = sorted(boxes)
    low, high = np.array([boxes[number][1] for number in numbers]).transpose(1, 0, 2)
    for k, a in enumerate(numbers):
        meets = ((low[k + 1 :] <= high[k]) & (low[k] <= high[k + 1 :])).all(axis=1)
        for b in (numbers[k + 1 + other] for other in np.flatnonzero(meets)):
            yield (a, b), (boxes[a][0], boxes[b][0]), boxes[a][1]


def _depths(contacts: Mapping[str, ContactTotals]) -> dict[str, dict[str, float]]:
    """By body and partner how deep they overlap between the nodes of their contacts (m)."""
    depths: dict[str, dict[str, float]] = {}
    for contact in contacts.values():
        for name, partner in (contact.bodies, contact.bodies[::-1]):
            of_body = depths.setdefault(name, {})
            of_body[partner] = max(contact.deepest, of_body.get(partner, -np.inf))
    return depths


def _between(first: str, second: str, depths: Mapping[str, Mapping[str, float]]) -> float:
    """How deep two bodies may overlap (m): as their contacts do between nodes, and those with a common neighbour.
    Overlaps between contact nodes are errors of the discretization, of which `_overlap_between` warns."""
    one, other = depths.get(first, {}), depths.get(second, {})
    return one.get(second, 0.0) + sum(one[body] + other[body] for body in one.keys() & other)


def _kept(interfaces: Sequence[Interface], body: str, other: str) -> np.ndarray:
    """The nodes (k,) of a body that its contacts with another one, or with a rigid partner, keep apart from it."""
    return np.concatenate(
        [
            np.empty(0, int),
            *(
                nodes[side]
                for interface in interfaces
                if set(interface.bodies) == {body, other}
                for nodes in (interface.rows.nodes, interface.fixed.nodes)
                for side in interface.sides(body)
            ),
        ]
    )


def _positions(way: float, height: float) -> Iterable[float]:
    """Fractions of the displacements at which overlaps are looked for, 16 at most, so that no point passes a cell of
    this `height` on its `way` (m) unseen."""
    count = int(np.clip(np.ceil(way / height), 1, 16))
    return np.arange(1, count + 1) / count


def penetrates_itself(body: Solid, kept: np.ndarray | None = None) -> Overlap:
    """Where the middle of a facet lies in a boundary cell in the answer or on the way there, deeper than as drawn; if it
    does, the deepest place in the answer. Where two cells both have nodes that contacts of the body with itself have
    `kept` (n,) apart, this does not count.

    A boundary cell is the simplex of a facet and the opposite corner of its cell. Those with a node of the facet do not
    count: a quadratic facet that bends leaves the simplex beside it. Nor do places that lie in a boundary cell as drawn,
    and up to a fraction RESOLVED of a cell what curvature and small-strain theory explain, as in `penetration`.
    """
    way = _spread((body.moved - body.at)[body.outer])
    height, corners = body.height, body.facets[:, :-1]
    rounding = 32.0 * float(np.spacing(np.abs(body.at).max()))
    least = max(RESOLVED, body.gradient) * way
    if not 0.0 < way <= body.size:  # or is no number
        return Overlap()
    drawn = body.within
    closed = np.zeros(len(corners), bool) if kept is None else kept[body.facets].any(axis=1)
    open_facets = np.flatnonzero(~closed)
    looked = [
        (np.flatnonzero((drawn <= RESOLVED) & ~closed), np.arange(len(corners))),
        (np.flatnonzero((drawn <= RESOLVED) & closed), open_facets),
    ]
    for fraction in _positions(way, float(height.min())):
        x = body.placed(fraction)
        for some, cells in looked:
            if not len(some) or not len(cells):
                continue
            middle, facets = x[corners[some]].mean(axis=1), body.facets[cells]
            share, nearest = most_inside(middle, x[facets.T], (corners[some], facets))
            cell = cells[nearest]
            depth = share * height[cell]
            before = np.maximum(drawn[some], 0.0) * height[cell]
            excess = depth - before - rounding
            if not (excess > 0.0).any():
                continue
            explained = least + body.sagitta[some] + body.sagitta[cell]
            excess = excess - np.minimum(explained, RESOLVED * height[cell])
            k = int(np.argmax(excess))
            if excess[k] > 0.0:
                found = Overlap(float(depth[k]), middle[k])
                return max(
                    found, _deepest_in_itself(body, corners[~closed]), key=lambda at: at.depth
                )
    return Overlap()


def _deepest_in_itself(body: Solid, corners: np.ndarray) -> Overlap:
    """The deepest middle of the facets with these `corners` (f, d) in a cell with other nodes, in the answer. Its depth is
    that of the place in this cell as drawn, where no side of the body is in another one."""
    middle = body.moved[corners].mean(axis=1)
    cells = cell_with(body.cells.shape[1], body.at.shape[1]).split(body.cells)
    share, number = most_inside(middle, body.moved[cells.T], (corners, cells))
    inside = np.flatnonzero(share > 0.0)
    if not len(inside):
        return Overlap()
    nodes = cells[number[inside]]
    moved, drawn = body.moved[nodes], body.at[nodes]
    ways = (moved[:, 1:] - moved[:, :1]).swapaxes(1, 2)
    parts = np.linalg.solve(ways, (middle[inside] - moved[:, 0])[:, :, None])[:, :, 0]
    places = drawn[:, 0] + np.einsum("kj,kjd->kd", parts, drawn[:, 1:] - drawn[:, :1])
    depth = distance_to(places, body.at[body.facets[:, :-1]])[0]
    k = int(np.argmax(depth))
    return Overlap(float(depth[k]), middle[inside[k]])


def penetration(
    first: Solid, second: Solid, kept: Sequence[np.ndarray], slack: float = 0.0
) -> tuple[Overlap, float]:
    """The deepest overlap of two bodies in the answer, or else in the drawing, and how deep the drawing has one.

    The answer is looked at at several positions on the way from the drawing, so that a body which has passed a thin one
    is found. What rounding, curvature and small-strain theory explain, and in the answer the drawing, does not count.

    Parameters
    ----------
    kept : (n,) of each body, which of its nodes contacts keep from the other one
    slack : overlaps of the answer below this do not count (m)
    """

    def deepest(fraction: float, least: float) -> Overlap:
        return max(
            deepest_in(first, second, kept[0], kept[1], fraction, least),
            deepest_in(second, first, kept[1], kept[0], fraction, least),
            key=lambda overlap: overlap.depth,
        )

    rounding = 32.0 * float(np.spacing(max(np.abs(solid.at).max() for solid in (first, second))))
    heights = np.concatenate([first.height, second.height])
    drawn, least = deepest(0.0, rounding), rounding + slack
    if drawn.depth <= SAME * np.median(heights):
        drawn, least = Overlap(), least + drawn.depth
    motions = np.concatenate([(solid.moved - solid.at)[solid.outer] for solid in (first, second)])
    if not 0.0 < np.hypot.reduce(motions, axis=1).max() <= max(first.size, second.size):
        return drawn, drawn.depth  # nothing moved, or the displacements are no numbers
    largest = float(np.linalg.norm(motions - motions.mean(axis=0), axis=1).max())
    # Small-strain theory neglects products of displacements with strains and rotations.
    least += max(RESOLVED, first.gradient, second.gradient) * largest
    answer = max(
        (deepest(fraction, least) for fraction in _positions(largest, float(heights.min()))),
        key=lambda overlap: overlap.depth,
    )
    return (answer if answer.depth else drawn), drawn.depth


def deepest_in(
    a: Solid, b: Solid, kept: np.ndarray, kept_of_b: np.ndarray, fraction: float, least: float
) -> Overlap:
    """Where the boundary of `a` lies deepest in `b`, if deeper than `least` and the sagittas, after a `fraction` of
    the displacements.

    Points are boundary nodes, middles of facets, and places a little inside of these, as bodies may have a common
    boundary. Points of contact nodes do not count where the nearest boundary of `b` is of the contact, too; the others
    must lie deeper than these.
    """
    x, at = a.placed(fraction), b.placed(fraction)
    low, high = at[b.outer].min(axis=0) + least, at[b.outer].max(axis=0) - least
    cells = x[a.facets.T]
    facets = np.flatnonzero(((cells.max(axis=0) > low) & (cells.min(axis=0) < high)).all(axis=1))
    corners, middle = a.facets[facets, :-1], cells[:-1, facets].mean(axis=0)
    nodes, first = np.unique(corners, return_index=True)
    points = np.concatenate([x[nodes], middle, 0.75 * middle + 0.25 * cells[-1, facets]])
    facet = np.concatenate([facets[first // corners.shape[1]], facets, facets])
    closed = np.concatenate([kept[nodes], *2 * [kept[corners].all(axis=1)]])
    some = ((points > low) & (points < high)).all(axis=1)
    if not some.any():
        return Overlap()
    points, facet, closed = points[some], facet[some], closed[some]
    near = b.near(points.min(axis=0), points.max(axis=0), at)
    near = cell_with(near.shape[1], at.shape[1]).split(near)

    def inside(some: np.ndarray, cells: np.ndarray) -> np.ndarray:
        """Which points, of some (k,) bool, lie in cells, up to rounding where two of these meet."""
        return np.flatnonzero(some)[most_inside(points[some], at[cells.T])[0] > -1e-12]

    # What is closed lies in cells at the contact, up to small errors: most contacts need no distances. It may have come
    # there through a facet beside the contact.
    of_contact = kept_of_b[b.facets[:, :-1]].all(axis=1)
    at_contact, beside = np.zeros((2, len(at)), bool)
    at_contact[b.facets[of_contact, :-1]] = True
    beside[b.facets[~of_contact, :-1]] = True
    entered = ~at_contact[near].any(axis=1) | (beside[near].sum(axis=1) >= at.shape[1])
    free = np.concatenate([inside(~closed, near), inside(closed, near[entered])])
    boundary = at[b.facets[:, :-1]]
    if not len(free) or distance_to(points[free], boundary, least)[0].max() <= least:
        return Overlap()
    some = inside(np.ones(len(points), bool), near)
    depth, nearest = distance_to(points[some], boundary)
    facing = closed[some] & kept_of_b[b.facets[nearest, :-1]].all(axis=1)
    excess = (
        depth - least - a.sagitta[facet[some]] - b.sagitta[nearest] - depth[facing].max(initial=0.0)
    )
    k = int(np.argmax(excess))
    return Overlap(float(depth[k]), points[some[k]]) if excess[k] > 0.0 else Overlap()


def _doubt_rigid(
    assembly: Assembly, contacts: Mapping[str, ContactTotals], solids: Mapping[int, Solid]
) -> Warnings:
    """Warnings where a body of this rank, one of the `solids`, penetrates a rigid partner outside its contact with it,
    by (True, body, partner). Collective."""
    moved = assembly.world.bcast(
        {
            contact.bodies[1]: contact.rigid
            for contact in contacts.values()
            if contact.rigid is not None
        }
    )
    warnings = Warnings()
    for body in assembly.bodies:
        for k, rigid in enumerate(assembly.scene.rigid):
            still = RigidMotion(np.array(rigid.displacement or np.zeros(body.mesh.dimension)))
            solid, frame = solids[body.number], assembly.frames.get(rigid.name)
            if frame:  # in the frame of the partner, whose shape is given there
                solid = replace(
                    solid, at=frame.undone.at(solid.at), moved=frame.undone.at(solid.moved)
                )
            if warning := _in_partner(
                body,
                solid,
                moved.get(rigid.name, still),
                rigid,
                assembly.scene.units["length"],
                frame,
            ):
                warnings[True, body.number, k] = warning
    return warnings


def _in_partner(
    body: Body,
    solid: Solid,
    motion: RigidMotion,
    rigid: Rigid,
    unit: str,
    frame: Frame | None,
) -> str:
    """A warning where a body lies in a rigid partner, after its `motion`, between contact nodes or beside contacts.

    Beside them, a partner through which the body is drawn is left out if it may be meant to end before: a bore may be a
    piece of a socket, and a plane need not go on where no contact of the body names it.
    """
    name, extent, facets = body.spec.name, body.mesh.extent, solid.facets[:, :-1]
    contacts = [
        interface for interface in body.member.interfaces if interface.bodies[1] == rigid.name
    ]
    touching = np.isin(facets, _kept(contacts, name, rigid.name))
    ends, between = motion.undone(solid.moved)[facets], touching.all(axis=1)
    places, at_ends = rigid.deepest(ends), rigid.depth(ends)
    depth, moved = rigid.depth(places), places + motion.at(places)
    moved = frame.at(moved) if frame else moved
    # Between two contact nodes it may lie as deep as a quarter of their distance, or of its radius.
    size = np.minimum(np.linalg.norm(np.ptp(ends, axis=1), axis=1), rigid.bend)
    sunk = np.where(between, depth - np.maximum(at_ends.max(axis=1), 0.0) - 0.25 * size, 0.0)
    k = int(np.argmax(sunk))
    if sunk[k] > 0.0:
        return Doubt(
            f"contact.{contacts[0].name}: {rigid.name} is small beside the distance of nodes of {name}, and "
            f"penetrates it by {depth[k]:.3g} {unit} between two of them, as at {in_words(moved[k], 4)}; refine "
            "the mesh there",
            "small",
            depth[k],
        )
    least = ALIKE * extent
    if (
        rigid.may_end(bool(contacts))
        and rigid.depth(solid.at[facets[~touching]]).max(initial=0.0) > least
    ):
        return ""
    least += float(at_ends[touching].max(initial=0.0)) + RESOLVED * float(
        np.abs(solid.moved - solid.at).max()
    )
    beside = np.where(between, 0.0, depth)
    k = int(np.argmax(beside))
    where = (
        f"contact.{contacts[0].name}: beside the contact"
        if contacts
        else "no contact keeps them apart:"
    )
    if not beside[k] > least:
        return ""
    return Doubt(
        f"{where} {name} penetrates {rigid.name} by {depth[k]:.3g} {unit}, as at {in_words(moved[k], 4)}; "
        f"{WIDEN if contacts else ADD}{rigid.crossed}",
        "through",
        depth[k],
        f"body.{name}-{rigid.name}",
    )
