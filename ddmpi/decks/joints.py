"""What joins the bodies of a deck: contacts and ties, and the sections of bolts."""

from __future__ import annotations

import re
from collections.abc import Iterable, Sequence
from itertools import product
from typing import Any

import numpy as np

from ddmpi.decks.acting import Acts, later
from ddmpi.decks.cards import Acting, Card, called, number
from ddmpi.decks.pieces import Piece
from ddmpi.errors import InputError

Side = tuple[Piece, np.ndarray]
"""A body, and its facets of a surface."""


class Joints:
    """What joins the bodies of a deck, as entries of a scene."""

    def __init__(self, acts: Acts) -> None:
        self.acts, self.notes, self.model, self.deck = acts, acts.notes, acts.model, acts.model.deck
        self.cleared: list[Card] = []
        self.met: list[
            tuple[Card, tuple[bool, float], dict[str, set[int]]]
        ] = []  # faces in contact so far

    def unmet(self) -> None:
        """Note clearances of surfaces that are in no contact."""
        for clearance in self.model.clearances.values():
            if clearance not in self.cleared:
                self.notes.add("lost", clearance, "no *CONTACT PAIR has these surfaces")

    def _again(
        self,
        card: Card,
        laws: tuple[bool, float],
        slave: Piece,
        on: np.ndarray,
        master: Piece,
        against: np.ndarray,
    ) -> bool:
        """Whether a contact of the same faces is there already, in either order. Those that share some of their faces
        on both sides, or differ in their laws, are lost."""
        sides = {slave.name: set(on.tolist()), master.name: set(against.tolist())}
        for other, law, others in self.met:
            if others.keys() != sides.keys() or any(
                others[name].isdisjoint(sides[name]) for name in sides
            ):
                continue
            if others == sides and law == laws:
                return True
            self.notes.add(
                "lost", card, f"a contact beside that of line {other.line}, between the same faces"
            )
        self.met.append((card, laws, sides))
        return False

    def _side(self, card: Card, name: str) -> list[tuple[Piece, np.ndarray]]:
        """The facets of a surface, of elements or of nodes, by body. Raises InputError where there is no surface."""
        if self.deck.key("SURFACE", card.scope, name):
            ends = set(self.deck.ends(card, name))
            if inner := len(ends - self.acts.where.keys()):
                self.notes.add(
                    "changed",
                    card,
                    f"faces of the surface {name} that are on no boundary ({inner}) are left out",
                )
            return self.acts.on(ends)
        if not self.deck.key("NODES", card.scope, name):
            raise InputError(card.tells(f"there is no surface {name}"))
        sides = self.acts.at(self.deck.chosen(card, "NODES", name))
        if not all(covered for *_, covered in sides):
            self.notes.add("lost", card, f"the surface {name} has nodes without a whole face")
        return [(piece, facets) for piece, facets, _ in sides if len(facets)]

    def contacts(
        self, card: Card, slave_surface: str, master_surface: str
    ) -> Iterable[dict[str, Any]]:
        """The contacts of a pair of surfaces, one for each two bodies that they have."""
        tied, friction = self._law(card)
        slaves, masters = (self._side(card, name) for name in (slave_surface, master_surface))
        held = set().union(
            {node for node, _ in self.model.kinds["supports"]},
            *(one.nodes for one in self.model.rigid),
        )
        joined = self._joined(card, (tied, friction), slaves, masters)
        for slave, on, master, against in joined:
            contact: dict[str, Any] = {
                "bodies": [slave.name, master.name],
                "on": [slave.group(on, slave_surface), master.group(against, master_surface)],
            }
            if tied:
                contact["kind"] = "bonded"
            elif friction:
                contact["friction"] = {"law": "coulomb", "coefficient": friction}
            if not held.issuperset(slave.nodes[np.unique(slave.facets[on])].tolist()):
                contact["slave"] = slave.name  # supported or rigid all over it could be none
            pair, gap = frozenset(map(called, (slave_surface, master_surface))), None
            if clearance := self.model.clearances.get(pair):
                gap = number(clearance.given["VALUE"])
                self.cleared.append(clearance)
                self.notes.add("taken", clearance, "gap")
            elif not tied and card.says("ADJUST", "NO") != "NO":
                gap = self._adjusted(card, slave, slave.heights(on, master, against))
            yield contact | ({} if gap is None else {"gap": gap})
        if joined:
            self.notes.add("taken", card, "bonded contact" if tied else "contact")
        for slave, on in slaves if tied else ():
            found = [
                slave.heights(on, master, against)
                for own, _, master, against in joined
                if own is slave
            ]
            if found:
                self._tell_gap(card, slave.points[slave.facets[on][:, :2]], np.concatenate(found))

    def _law(self, card: Card) -> tuple[bool, float]:
        """Whether a pair of surfaces is tied, and its coefficient of friction. Raises InputError."""
        law = dict[str, Card]()
        if card.word != "TIE":
            name = card.name_of("INTERACTION").upper()
            if name not in self.model.interactions:
                raise InputError(card.tells(f"there is no *SURFACE INTERACTION {name}"))
            law = self.model.interactions[name]
        behaviour = law.get("SURFACEBEHAVIOR", card).says("PRESSURE-OVERCLOSURE")
        friction = number(law["FRICTION"].rows[0][0] or "0") if "FRICTION" in law else 0.0
        return card.word == "TIE" or behaviour == "TIED", friction

    def _joined(
        self, card: Card, law: tuple[bool, float], slaves: Sequence[Side], masters: Sequence[Side]
    ) -> list[tuple[Piece, np.ndarray, Piece, np.ndarray]]:
        """The sides of a pair of surfaces by two bodies, without those that are in contact already."""
        found = [(*a, *b) for a, b in product(slaves, masters) if a[0] is not b[0]]
        fresh = [not self._again(card, law, *one) for one in found]
        own = {piece.name for piece, _ in slaves} & {piece.name for piece, _ in masters}
        if own:
            self.notes.add("lost", card, f"contact of {', '.join(sorted(own))} with itself")
        elif not found:
            words = f"{card.rows and ' or '.join(card.rows[0][:2])} has no faces on a body"
            self.notes.add("lost", card, words)
        if not all(fresh):
            self.notes.add("changed", card, "a contact that is there already is one contact")
        return [one for one, new in zip(found, fresh, strict=True) if new]

    def _adjusted(self, card: Card, slave: Piece, heights: np.ndarray) -> float | None:
        """The gap by ADJUST of nodes of a slave with these heights (k,) over the master."""
        word = card.says("ADJUST")
        reach = number(word) if re.fullmatch(r"[\d.]+([ED][+-]?\d+)?", word) else np.nan
        near = heights <= max(reach, 1e-9 * float(np.ptp(slave.points, axis=0).max()))
        if near.all() and len(near):
            self.notes.add("changed", card, "ADJUST: the surfaces touch, with a gap of 0")
            return 0.0
        if reach == 0.0 or (reach > 0.0 and not near.any()):
            self.notes.add("changed", card, "ADJUST moves nothing: gaps are those of the mesh")
        else:
            self.notes.add("lost", card, "ADJUST that moves some of the nodes only")
        return None

    def _tell_gap(self, card: Card, sides: np.ndarray, heights: np.ndarray) -> None:
        """Note a tie of nodes with `heights` (k,) beyond its tolerance; without one, beyond a twentieth of the median
        of `sides` (f, 2, d) of facets."""
        word = card.given.get("POSITIONTOLERANCE", "")
        reach = (
            number(word)
            if word
            else 0.05 * float(np.median(np.linalg.norm(sides[:, 0] - sides[:, 1], axis=1)))
        )
        near, far = heights.min(initial=np.inf), heights.max(initial=0.0)
        if word and near > reach:
            self.notes.add("lost", card, f"a tie over a gap of {near:.3g}, beyond its tolerance")
        elif far > reach:
            self.notes.add(
                "changed", card, f"nodes {far:.3g} apart, beyond its tolerance, are tied"
            )

    def bolts(self) -> Iterable[dict[str, Any]]:
        """The bonded contacts at the sections of bolts, with the force of their reference nodes, or over a gap by which
        these shorten them; and around the layers that had to be taken out."""
        for card, ends, section, around in self.acts.cuts:
            sides = self.acts.on(ends)
            others = [
                (piece, facets)
                for piece, facets, _ in self.acts.at(section)
                if len(facets) and not any(piece is one for one, _ in sides)
            ]
            node = self.model.node(card, card.given["NODE"])
            force, offset = (
                self.model.kinds[kind].get((node, 1)) for kind in ("forces", "supports")
            )
            given = force or offset
            cuts = len(sides) == len(others) == 1 and not (force and offset)
            reason = self._shared(card, node) or _incomplete(given, cuts)
            if reason or not given:
                self.notes.add("lost", card, reason)
                continue
            ((piece, facets),), ((other, against),) = sides, others
            if force and node in self.model.locked:  # after its last point the offset is kept
                kept = tuple(p for p in force.course if p[0] <= self.model.locked[node])
                given = force._replace(course=kept)
            value, history = self.acts.factor(given)
            normal = piece.outward(facets)
            if card.rows and normal @ card.values()[: len(normal)] < 0.0:
                value = -value  # its normal points into the elements of the surface
            words = "a bond with a pretension" if force else "a bond over a gap"
            self.notes.add("taken", card, words)
            bond: dict[str, Any] = {"bodies": [piece.name, other.name], "kind": "bonded"}
            on = [piece.group(facets, "section"), other.group(against, "section")]
            pull = {"force": value / self.acts.matter.depth, "along": normal.tolist()}
            how = {"pretension": pull} if force else {"gap": {"value": value}}
            yield bond | {"on": on} | {key: entry | later(history) for key, entry in how.items()}
            if len(around):
                words = "the elements at the section are a body of their own, bonded to the others, which hang together"
                self.notes.add("changed", card, f"{words} without it")
                yield bond | {
                    "on": [
                        one.group(one.whole(one.within(around)), "layer") for one in (piece, other)
                    ]
                }

    def _shared(self, card: Card, node: int) -> str:
        """Why the node of a section cannot be that of this section alone; empty if it can."""
        for one, *_ in self.acts.cuts:
            if one is not card and self.model.node(one, one.given["NODE"]) == node:
                return f"its node is also that of line {one.line}"
        return "its node is the reference node of a rigid set" * (node in self.acts.rigid_nodes)


def _incomplete(given: Acting | None, cuts: bool) -> str:
    """Why a section is no bolt; empty if it is one."""
    if not given:
        return "a pre-tension whose node has neither a force nor a displacement"
    return "" if cuts else "a section that does not cut a body in two"
