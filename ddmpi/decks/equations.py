"""Equations between nodes of a deck: supports, bonds of faces that match, and faces that move as one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial import KDTree
from scipy.spatial.transform import Rotation

from ddmpi.decks.acting import Acts
from ddmpi.decks.cards import EXACT, Acting, Card, Entries, Rigid
from ddmpi.decks.model import Model
from ddmpi.decks.pieces import Piece, Side, connected

CLOSE = 1e-4
"""Pairs of nodes and their coefficients are alike up to this fraction, as decks have few digits."""


class Row(NamedTuple):
    """The equation v · (u¹, u²) = c g of the displacements of two nodes, with v (2d,), whose first half is a unit vector,
    and the displacement g of another node that is `given`, if there is one."""

    card: Card
    nodes: tuple[int, int]
    v: np.ndarray
    given: Acting | None = None
    c: float = 0.0

    @property
    def swapped(self) -> Row:
        """The same with the other node first."""
        return self._replace(nodes=self.nodes[::-1], v=np.roll(self.v, len(self.v) // 2))

    @property
    def dofs(self) -> np.ndarray:
        """(2d,) numbers of the components that it has, −1 of others."""
        numbers = np.array(self.nodes)[:, None] * 3 + np.arange(len(self.v) // 2)
        return np.where(np.abs(self.v) > CLOSE, numbers.ravel(), -1)


Difference = tuple[Acting | None, np.ndarray]
"""The displacement g of a node that is given, if one is, and a (d,), of u¹ = Q u² + g a."""


class Tie(NamedTuple):
    """What pairs of nodes say: u¹ = Q u² + g a with the displacement g of a node that is given, or that along one
    direction alone.

    Attributes
    ----------
    lead : the number of the pair that says so
    Q : (d, d)
    rows : (k, 2d) of (u¹, u²)
    given, apart : its course of g, None if the sides move alike, and a (d,)
    """

    lead: int
    Q: np.ndarray
    rows: np.ndarray
    given: Acting | None
    apart: np.ndarray

    @classmethod
    def of(cls, pairs: Sequence[Sequence[Row]]) -> Tie | None:
        """That of the first pair that says all, or else of the first that has one row; None if there is none."""
        for lead, rows in enumerate(pairs):
            if (Q := _turn(rows)) is not None:
                return cls(lead, Q, np.hstack([np.eye(len(Q)), -Q]), *_difference(rows))
        for lead, rows in enumerate(pairs):
            a, b = np.split(rows[0].v, 2)
            if len(rows) == 1 and np.abs(a + b).max() <= CLOSE:
                return cls(lead, np.eye(len(a)), np.append(a, -a)[None], *_difference(rows))
        return None

    @property
    def kind(self) -> str:
        """That of the contact."""
        return "bonded" if len(self.rows) == len(self.Q) else "guided"


class Equations:
    """What equations are in a scene; supports and rigid sets are written into those of the model.

    Attributes
    ----------
    bonds : contacts of matching faces
    """

    def __init__(self, acts: Acts) -> None:
        self.acts = acts
        self.notes = acts.notes
        self.model = acts.model
        self.supports = acts.kinds["supports"]
        self.bonds = list[Entries]()
        self.ways = list[tuple[np.ndarray, np.ndarray]]()
        self.left = dict(self.model.equations)
        self.own = acts.rigid_nodes | self.model.bolt_nodes
        while any([self._known(key) for key in [*self.left]]):
            pass
        for _, terms in self.model.equations.values():
            acts.rigid_nodes |= {node for node, *_ in terms} - acts.home.keys()
        self.held = defaultdict[int, list[np.ndarray]](list)
        for (node, k), acting in self.supports.items():
            if node in acts.home and not acting.moves:
                self.held[node].append(acts.way(node, k)[: len(acts.axes)])
        rank = np.linalg.matrix_rank
        d = len(acts.axes)
        self.fixed = {node for node, ways in self.held.items() if rank(ways) == d}
        pairs = defaultdict[Any, list[list[Row]]](list)
        for nodes, group in self._groups().items():
            if len(nodes) == 2 and nodes <= acts.home.keys():
                pairs[tuple(acts.home[node] for node in group[0].nodes)].append(group)
            else:
                self._tell(group, self._as_one(group, nodes), "a face that moves as one")
        for (first, second), left in pairs.items():
            while left:
                left = self._bond(first, second, left)

    def _groups(self) -> dict[frozenset[int], list[Row]]:
        """The rows that hang together by their components, by their nodes."""
        rows = [row for one in self.left.values() for row in self._rows(*one)]
        groups = defaultdict[int, list[Row]](list)
        found = defaultdict[Any, list[Row]](list)
        for number, row in zip(connected(np.array([row.dofs for row in rows])), rows, strict=True):
            groups[number].append(row)
        for group in groups.values():
            some = found[frozenset(node for row in group for node in row.nodes)]
            for row in group:
                swapped = bool(some) and row.nodes != some[0].nodes
                some.append(row.swapped if swapped else row)
        return found

    def _tell(self, rows: Sequence[Row], reason: str, taken: str) -> None:
        for row in rows:
            note = self.notes.lost if reason else self.notes.taken
            note(row.card, reason or taken)

    def _known(self, key: tuple[int, int]) -> bool:
        """Whether an equation has one node alone that its supports leave free; then it is a support of that one."""
        card, terms = self.left[key]
        free = [term for term in terms if term[:2] not in self.supports]
        given = [(self.supports[term[:2]], term[2]) for term in terms if term not in free]
        moved = [one for one in given if one[0].moves]
        if len({node for node, *_ in free}) > 1 or len(moved) > bool(free):
            return False
        if free:
            (node, k, size), *others = free
            if others:
                way = np.sum([c * self.acts.way(node, k) for _, k, c in free], axis=0)
                if not (size := float(np.linalg.norm(way))):  # on the axis of its directions
                    return False
                self.acts.ways.append(way / size)
                k = 6 + len(self.acts.ways)
            acting, c = moved[0] if moved else (_nothing(card, self.model), 0.0)
            course = tuple((time, 0.0 - c / size * value) for time, value in acting.course)
            self.supports[node, k] = Acting(card, course)
        self.notes.taken(card, "clamps")
        del self.left[key]
        return True

    def _rows(self, card: Card, terms: Sequence[tuple[int, int, float]]) -> list[Row]:
        """The equation of two nodes as a row; none, as it is lost, of others."""
        of = defaultdict[int, Any](float)
        others = list[tuple[Acting, float]]()
        free = {node for node, k, _ in terms if (node, k) not in self.supports}
        for node, k, c in terms:
            if len(free) == 2 and node not in free:
                others.append((self.supports[node, k], c))
            else:
                of[node] = of[node] + c * self.acts.way(node, k)[: len(self.acts.axes)]
        moving = [node for node, v in of.items() if v.any()]
        moved = [x for x in others if x[0].moves]
        if len(moving) == 2 and len(moved) < 2:
            one, two = moving
            size = np.linalg.norm(of[moving[0]])
            row = Row(card, (one, two), np.append(of[one], of[two]) / size)
            return [row._replace(given=given, c=float(-c / size)) for given, c in moved] or [row]
        if moving or any(k < 3 for _, k, _ in terms):  # all others are out of the plane
            self.notes.lost(card, "an equation of several free displacements")
        return []

    def _as_one(self, rows: Sequence[Row], nodes: frozenset[int]) -> str:
        """Write the rigid set of nodes that move as one along the normal of their flat face, or along all axes; the
        reason where they are none."""
        model = self.model
        body = {node for node in nodes if node in self.acts.home}
        sides = np.array([row.v for row in rows]).reshape(len(rows), 2, -1)
        if any(row.given for row in rows):
            return "displacements that differ by a given one, of no pairs"
        along = {int(k) for k in np.abs(sides[:, 0]).argmax(axis=1)}
        if np.abs(sides.sum(axis=1)).max() > CLOSE or np.abs(sides).max(axis=2).min() < 1.0 - CLOSE:
            return "displacements that are not equal along one axis"
        if len(rows) != len(along) * (len(nodes) - 1) or len(nodes - body) > 1 or nodes & self.own:
            return "nodes that do not all move together"
        only = None if len(along) == len(self.acts.axes) else min(along)
        if reason := self._no_face(body, only, len(along)):
            return reason
        ref = next(iter(nodes - body), -len(model.rigid) - 1)
        model.deck.points.setdefault(ref, [0.0, 0.0, 0.0])
        self.acts.rigid_nodes.add(ref)
        for k in {*range(6)} - along:
            self.supports.setdefault((ref, k + 1), _nothing(rows[0].card, model))
        model.rigid.append(Rigid(rows[0].card, body, ref, ref, only=only))
        return ""

    def _no_face(self, body: set[int], only: int | None, count: int) -> str:
        """Why nodes are no faces, or no flat one of one body with the normal along the `only` axis; empty if they are."""
        faces = [(piece, _faces(piece, body, set())) for piece, *_ in self.acts.at(body)]
        if not faces or not all(_covers(*side, [*body]) for side in faces):
            return "its nodes are no whole faces"
        flat = only is None or (count == len(faces) == 1 and self._flat(*faces[0], only))
        words = "nodes that move together, not along all axes or the normal of one flat face"
        return "" if flat else words

    def _flat(self, piece: Piece, on: np.ndarray, axis: int) -> bool:
        """Whether a face of a body is flat across an axis."""
        heights = piece.points[np.setdiff1d(piece.facets[on], [-1]), axis]
        return bool(np.ptp(heights) <= 0.5 * EXACT * np.ptp(piece.points, axis=0).max())

    def _bond(self, first: Piece, second: Piece, left: list[list[Row]]) -> list[list[Row]]:
        """Bond the faces of the pairs that stand to each other as the first one of a `Tie`, x¹ = Q x² + t; the other pairs."""
        tie = Tie.of(left)
        if tie is None:
            self._tell(
                [row for group in left for row in group],
                "pairs whose coefficients are those of no tie, shift or turn",
                "",
            )
            return []
        a, b = np.array([one[0].nodes for one in left]).T
        here = first.points[np.searchsorted(first.nodes, a)]
        there = second.points[np.searchsorted(second.nodes, b)]
        off = here - there @ tie.Q.T
        close = CLOSE * np.ptp(first.points, axis=0).max()
        near = np.linalg.norm(off - off[tie.lead], axis=1) <= close
        fits = np.array(
            [at and self._says(one, tie) for one, at in zip(left, near, strict=True)], bool
        )
        reason, entries = _image(*self._way(tie.Q, off[tie.lead], close), close)
        on, against = _facing(
            (first, _faces(first, {*a[fits]}, self.fixed)),
            (second, _faces(second, {*b[fits]}, self.fixed)),
            tie.Q,
            off[tie.lead],
            close,
        )
        if not (_covers(first, on, a[fits]) and _covers(second, against, b[fits])):
            reason = "pairs of nodes that are no whole faces"
        elif not reason:
            reason, gap = self._along(tie, left[tie.lead], first, on)
            entries |= gap
        if not reason:
            groups = [first.group(on, "tied"), second.group(against, "tied")]
            bond = {"bodies": [first.name, second.name], "on": groups, "kind": tie.kind}
            self.bonds.append(bond | entries)
        for k in np.flatnonzero(fits):
            self._tell(left[k], reason, f"{tie.kind} contact")
        return [left[k] for k in np.flatnonzero(~fits)]

    def _along(
        self, tie: Tie, lead: list[Row], first: Piece, on: np.ndarray
    ) -> tuple[str, Entries]:
        """Why the first side, with these facets, has no such tie, as it is not along their normal; and the gap of a bond
        whose first side goes farther than the second by a displacement that is given in the `lead`."""
        normals = first.normals(on)

        def across(v: np.ndarray) -> bool:
            return bool(np.abs(normals @ v).min() >= (1.0 - CLOSE**2) * np.linalg.norm(v))

        if tie.kind == "guided" and not across(tie.rows[0, : len(tie.Q)]):
            return "pairs of no tie, shift or turn", {}
        if tie.given is None:
            return "", {}
        if len({row.given.course for row in lead if row.given}) > 1:
            return "differences that are given by several nodes", {}
        if not across(tie.apart):
            return "a given difference that is not along the normal of a flat face", {}
        size = float(first.outward(on) @ tie.apart)
        course = tuple((time, size * value) for time, value in tie.given.course)
        gap, history = self.acts.factor(tie.given._replace(course=course))
        return "", {"gap": {"value": gap, "history": history} if history else gap}

    def _way(self, Q: np.ndarray, t: np.ndarray, close: float) -> tuple[np.ndarray, np.ndarray]:
        """Q and t, or those of a bond before that are the same but for a few digits: a wheel has one turn."""
        for R, r in self.ways:
            if np.abs(R - Q).max() <= CLOSE and np.linalg.norm(r - t) <= close:
                return R, r
        self.ways.append((Q, t))
        return Q, t

    def _says(self, rows: list[Row], tie: Tie) -> bool:
        """Whether rows of two nodes say the same as a tie, with the supports of these nodes."""
        if not _alike(_difference(rows), (tie.given, tie.apart)):
            return False
        one, two = (self.held[node] for node in rows[0].nodes)
        held = [np.append(way, 0.0 * way) for way in one] + [
            np.append(0.0 * way, way) for way in two
        ]
        bond = [*tie.rows]
        said = [row.v for row in rows]
        every = (held + said, held + bond, held + said + bond)
        return len({int(np.linalg.matrix_rank(some, CLOSE)) for some in every}) == 1


def _faces(piece: Piece, nodes: set[int], fixed: set[int]) -> np.ndarray:
    """The facets (k,) of a body that have some of these nodes, and apart from them `fixed` ones alone."""
    own = np.append(piece.within(nodes), False)
    free = np.append(~piece.within(nodes | fixed), False)
    return np.flatnonzero(own[piece.facets].any(axis=1) & ~free[piece.facets].any(axis=1))


def _covers(piece: Piece, facets: np.ndarray, nodes: Sequence[int] | np.ndarray) -> bool:
    """Whether facets of a body have all of those `nodes` that it has."""
    own = np.flatnonzero(piece.within(nodes))
    return not np.setdiff1d(own, piece.facets[facets]).size


def _facing(
    one: Side, other: Side, Q: np.ndarray, t: np.ndarray, close: float
) -> tuple[np.ndarray, np.ndarray]:
    """Of the facets (k,) of two sides the pairs whose middles are at x¹ = Q x² + t: in a layer of one element those
    between the faces have such nodes, too."""
    (first, on), (second, against) = one, other
    image = second.middles(against) @ Q.T + t
    distance, place = KDTree(first.middles(on)).query(image)
    near = distance <= close
    return on[place[near]], against[near]


def _nothing(card: Card, model: Model) -> Acting:
    """A support that stays."""
    return Acting(card, ((model.ends[-1], 0.0),))


def _difference(rows: Sequence[Row]) -> Difference:
    """The displacement that is given of rows that say u¹ = Q u² + g a, if one is, and a (d,)."""
    A = np.array([row.v for row in rows])[:, : len(rows[0].v) // 2]
    given = next((row.given for row in rows if row.given), None)
    return given, np.linalg.pinv(A) @ [row.c for row in rows]


def _alike(one: Difference, other: Difference) -> bool:
    """Whether two differences are the same."""
    courses = [given and given.course for given, _ in (one, other)]
    size = max(np.abs(a).max() for _, a in (one, other))
    return courses[0] == courses[1] and bool(np.abs(one[1] - other[1]).max() <= CLOSE * size)


def _turn(rows: Sequence[Row]) -> np.ndarray | None:
    """The rotation Q (d, d) of rows that say u¹ = Q u²; None of others."""
    A, B = np.hsplit(np.array([row.v for row in rows]), 2)
    Q = -np.linalg.pinv(A) @ B
    off = np.abs([A @ Q + B, Q @ Q.T - np.eye(len(Q))]) if len(A) == len(Q) else np.ones(1)
    return Q if off.max() <= CLOSE and np.linalg.det(Q) > 0.0 else None


def _image(Q: np.ndarray, t: np.ndarray, close: float) -> tuple[str, Entries]:
    """The image at x¹ = Q x² + t as an entry of a contact, none where both are at one place; or why it is none."""
    d = len(t)
    whole = np.eye(3)
    whole[:d, :d] = Q
    turn = Rotation.from_matrix(whole).as_rotvec(degrees=True)
    angle = np.linalg.norm(turn)
    pivot = np.linalg.pinv(np.eye(d) - Q, CLOSE) @ t
    if np.abs(Q - np.eye(d)).max() <= CLOSE:
        return "", {"image": {"shift": t.tolist()}} if np.linalg.norm(t) > close else {}
    sectors = round(360.0 / angle)
    if abs(sectors * angle - 360.0) > 0.1 or np.linalg.norm(pivot - Q @ pivot - t) > close:
        return f"a turn by {angle:.6g} degrees that does not close, or a screw", {}
    axis = turn / np.copysign(angle, turn[2])
    entries = np.copysign(360.0 / sectors, turn[2]).item(), pivot.tolist(), axis.tolist()
    return "", {"image": dict(zip(("turn", "pivot", "axis")[:d], entries, strict=False))}
