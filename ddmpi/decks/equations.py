"""Equations between nodes of a deck: supports, bonds of faces that match, and faces that move as one."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from ddmpi.decks.acting import Acts
from ddmpi.decks.cards import EXACT, Acting, Card, Rigid
from ddmpi.decks.model import Model
from ddmpi.decks.pieces import Piece, connected

CLOSE = 1e-4
"""Pairs of nodes and their coefficients are alike up to this fraction, as decks have few digits."""


class Row(NamedTuple):
    """The equation v · (u¹, u²) = 0 of the displacements of two nodes, with v (2d,), whose first half is a unit vector."""

    card: Card
    nodes: tuple[int, int]
    v: np.ndarray

    @property
    def swapped(self) -> Row:
        """The same with the other node first."""
        return Row(self.card, self.nodes[::-1], np.roll(self.v, len(self.v) // 2))

    @property
    def dofs(self) -> np.ndarray:
        """(2d,) numbers of the components that it has, −1 of others."""
        numbers = np.array(self.nodes)[:, None] * 3 + np.arange(len(self.v) // 2)
        return np.where(np.abs(self.v) > CLOSE, numbers.ravel(), -1)


class Equations:
    """What equations are in a scene; supports and rigid sets are written into those of the model.

    Attributes
    ----------
    bonds : contacts of matching faces
    """

    def __init__(self, acts: Acts) -> None:
        self.acts, self.notes, self.model = acts, acts.notes, acts.model
        self.supports, self.bonds = acts.kinds["supports"], list[dict[str, Any]]()
        self.ways = list[tuple[np.ndarray, np.ndarray]]()
        self.left, self.own = dict(self.model.equations), acts.rigid_nodes | self.model.bolt_nodes
        while any([self._known(key) for key in [*self.left]]):
            pass
        for _, terms in self.model.equations.values():
            acts.rigid_nodes |= {node for node, *_ in terms} - acts.home.keys()
        self.held = defaultdict[int, list[np.ndarray]](list)
        for (node, k), acting in self.supports.items():
            if node in acts.home and not acting.moves:
                self.held[node].append(acts.way(node, k)[: len(acts.axes)])
        rank, d = np.linalg.matrix_rank, len(acts.axes)
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
        groups, found = defaultdict[int, list[Row]](list), defaultdict[Any, list[Row]](list)
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
            self.notes.add("lost" if reason else "taken", row.card, reason or taken)

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
        self.notes.add("taken", card, "clamps")
        del self.left[key]
        return True

    def _rows(self, card: Card, terms: Sequence[tuple[int, int, float]]) -> list[Row]:
        """The equation of two nodes as a row; none, as it is lost, of others."""
        of = defaultdict[int, Any](float)
        for node, k, c in terms:
            of[node] = of[node] + c * self.acts.way(node, k)[: len(self.acts.axes)]
        moving = [node for node, v in of.items() if v.any()]
        if len(moving) == 2:
            (one, two), size = moving, np.linalg.norm(of[moving[0]])
            return [Row(card, (one, two), np.append(of[one], of[two]) / size)]
        if moving or any(k < 3 for _, k, _ in terms):  # all others are out of the plane
            self.notes.add("lost", card, "an equation of several free displacements")
        return []

    def _as_one(self, rows: Sequence[Row], nodes: frozenset[int]) -> str:
        """Write the rigid set of nodes that move as one along the normal of their flat face, or along all axes; the
        reason where they are none."""
        model, body = self.model, {node for node in nodes if node in self.acts.home}
        sides = np.array([row.v for row in rows]).reshape(len(rows), 2, -1)
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
        faces = [(piece, self._face(piece, body, set())) for piece, *_ in self.acts.at(body)]
        if not faces or any(on is None for _, on in faces):
            return "its nodes are no whole faces"
        flat = only is None or (count == len(faces) == 1 and self._flat(*faces[0], only))
        words = "nodes that move together, not along all axes or the normal of one flat face"
        return "" if flat else words

    def _flat(self, piece: Piece, on: np.ndarray, axis: int) -> bool:
        """Whether a face of a body is flat across an axis."""
        heights = piece.points[np.setdiff1d(piece.facets[on], [-1]), axis]
        return bool(np.ptp(heights) <= 0.5 * EXACT * np.ptp(piece.points, axis=0).max())

    def _face(self, piece: Piece, nodes: set[int], fixed: set[int]) -> Any:
        """The facets (k,) of a body that have some of these nodes, and apart from them `fixed` ones alone; none where
        others have some of the nodes."""
        own = np.append(piece.within(nodes), False)
        free = np.append(~piece.within(nodes | fixed), False)
        on = np.flatnonzero(own[piece.facets].any(axis=1) & ~free[piece.facets].any(axis=1))
        return None if np.setdiff1d(np.flatnonzero(own), piece.facets[on]).size else on

    def _bond(self, first: Piece, second: Piece, left: list[list[Row]]) -> list[list[Row]]:
        """Bond the faces of the pairs that stand to each other as the first one, x¹ = Q x² + t with u¹ = Q u²; the other
        pairs."""
        Q, lead = next(
            ((Q, k) for k, one in enumerate(left) if (Q := _turn(one)) is not None), (None, 0)
        )
        if Q is None:
            words = "pairs whose coefficients are those of no tie, shift or turn"
            self._tell([row for group in left for row in group], words, "")
            return []
        a, b = np.array([one[0].nodes for one in left]).T
        here, there = (
            piece.points[np.searchsorted(piece.nodes, nodes)]
            for piece, nodes in ((first, a), (second, b))
        )
        off, close = here - there @ Q.T, CLOSE * np.ptp(first.points)
        near = np.linalg.norm(off - off[lead], axis=1) <= close
        fits = np.array([at and self._says(one, Q) for one, at in zip(left, near, strict=True)])
        reason, image = _image(*self._way(Q, off[lead], close), close)
        on, against = (
            self._face(first, {*a[fits]}, self.fixed),
            self._face(second, {*b[fits]}, self.fixed),
        )
        if on is None or against is None or len(on) != len(against):
            reason = "pairs of nodes that are no whole faces"
        elif not reason:
            groups = [first.group(on, "tied"), second.group(against, "tied")]
            bond = {"bodies": [first.name, second.name], "on": groups, "kind": "bonded"}
            self.bonds.append(bond | image)
        for k in np.flatnonzero(fits):
            self._tell(left[k], reason, "bonded contact")
        return [left[k] for k in np.flatnonzero(~fits)]

    def _way(self, Q: np.ndarray, t: np.ndarray, close: float) -> tuple[np.ndarray, np.ndarray]:
        """Q and t, or those of a bond before that are the same but for a few digits: a wheel has one turn."""
        for R, r in self.ways:
            if np.abs(R - Q).max() <= CLOSE and np.linalg.norm(r - t) <= close:
                return R, r
        self.ways.append((Q, t))
        return Q, t

    def _says(self, rows: list[Row], Q: np.ndarray) -> bool:
        """Whether rows of two nodes say the same as u¹ = Q u², with the supports of these nodes."""
        one, two = (self.held[node] for node in rows[0].nodes)
        held = [np.append(way, 0.0 * way) for way in one] + [
            np.append(0.0 * way, way) for way in two
        ]
        bond, said = [*np.hstack([np.eye(len(Q)), -Q])], [row.v for row in rows]
        every = (held + said, held + bond, held + said + bond)
        return len({int(np.linalg.matrix_rank(some, CLOSE)) for some in every}) == 1


def _nothing(card: Card, model: Model) -> Acting:
    """A support that stays."""
    return Acting(card, ((model.ends[-1], 0.0),))


def _turn(rows: Sequence[Row]) -> np.ndarray | None:
    """The rotation Q (d, d) of rows that say u¹ = Q u²; None of others."""
    A, B = np.hsplit(np.array([row.v for row in rows]), 2)
    Q = -np.linalg.pinv(A) @ B
    off = np.abs([A @ Q + B, Q @ Q.T - np.eye(len(Q))]) if len(A) == len(Q) else np.ones(1)
    return Q if off.max() <= CLOSE and np.linalg.det(Q) > 0.0 else None


def _image(Q: np.ndarray, t: np.ndarray, close: float) -> tuple[str, dict[str, Any]]:
    """The image at x¹ = Q x² + t as an entry of a contact, none where both are at one place; or why it is none."""
    d, whole = len(t), np.eye(3)
    whole[:d, :d] = Q
    turn = Rotation.from_matrix(whole).as_rotvec(degrees=True)
    angle, pivot = np.linalg.norm(turn), np.linalg.pinv(np.eye(d) - Q, CLOSE) @ t
    if np.abs(Q - np.eye(d)).max() <= CLOSE:
        return "", {"image": {"shift": t.tolist()}} if np.linalg.norm(t) > close else {}
    sectors = round(360.0 / angle)
    if abs(sectors * angle - 360.0) > 0.1 or np.linalg.norm(pivot - Q @ pivot - t) > close:
        return f"a turn by {angle:.6g} degrees that does not close, or a screw", {}
    axis = turn / np.copysign(angle, turn[2])
    entries = np.copysign(360.0 / sectors, turn[2]).item(), pivot.tolist(), axis.tolist()
    return "", {"image": dict(zip(("turn", "pivot", "axis")[:d], entries, strict=False))}
