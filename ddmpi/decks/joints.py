"""What joins the bodies of a deck: contacts and ties, and the sections of bolts."""

import re
from collections.abc import Iterable, Sequence
from functools import cached_property
from itertools import product
from typing import Any

import numpy as np

from ddmpi.decks.acting import Acts, later
from ddmpi.decks.cards import (
    Acting,
    Card,
    DeckError,
    Entries,
    called,
    entry,
    number,
    numbers,
    vector,
)
from ddmpi.decks.pieces import Piece, Side
from ddmpi.scene.contacts import Closure
from ddmpi.system.numbers import Frame

Pair = tuple[Piece, np.ndarray, Piece, np.ndarray]
"""Slave and master, each with its facets."""


class Joints:
    """What joins the bodies of a deck, as entries of a scene."""

    def __init__(self, acts: Acts) -> None:
        self.acts = acts
        self.notes = acts.notes
        self.model = acts.model
        self.deck = acts.model.deck
        self.kinds = acts.kinds
        self.cleared = list[Card]()
        self.turned = list[Card]()
        self.met: list[tuple[Card, Entries, dict[str, set[int]]]] = []  # faces in contact so far

    def unmet(self) -> None:
        """Note clearances of surfaces that are in no contact, and cyclic symmetries of no tie."""
        for wheel in self.model.wheels.values():
            if wheel not in self.turned:
                self.notes.lost(wheel, "no *TIE with CYCLIC SYMMETRY has its name")
        for clearance in self.model.clearances.values():
            if clearance not in self.cleared:
                self.notes.lost(clearance, "no *CONTACT PAIR has these surfaces")

    def _again(self, card: Card, law: Entries, pair: Pair) -> bool:
        """Whether a contact of the same faces is there already, in either order. Those that share some of their faces
        on both sides, or differ in their laws, are lost."""
        slave, on, master, against = pair
        sides = {slave.name: set(on.tolist())}
        sides[master.name] = sides.get(master.name, set()) | set(against.tolist())
        for other, before, others in self.met:
            if others.keys() != sides.keys() or any(
                others[name].isdisjoint(sides[name]) for name in sides
            ):
                continue
            if others == sides and before == law:
                return True
            self.notes.lost(
                card, f"a contact beside that of line {other.line}, between the same faces"
            )
        self.met.append((card, law, sides))
        return False

    def _side(self, card: Card, name: str) -> list[Side]:
        """The facets of a surface, of elements or of nodes, by body. Raises DeckError where there is no surface."""
        if self.deck.key("SURFACE", card.scope, name):
            ends = set(self.deck.ends(card, name))
            if inner := len(ends - self.acts.where.keys()):
                self.notes.changed(
                    card,
                    f"faces of the surface {name} that are on no boundary ({inner}) are left out",
                )
            return self.acts.on(ends)
        if not self.deck.key("NODES", card.scope, name):
            raise DeckError(f"there is no surface {name}")
        sides = self.acts.at(self.deck.chosen(card, "NODES", name))
        if not all(covered for *_, covered in sides):
            self.notes.lost(card, f"the surface {name} has nodes without a whole face")
        return [(piece, facets) for piece, facets, _ in sides if len(facets)]

    def contacts(self, card: Card, slave_surface: str, master_surface: str) -> Iterable[Entries]:
        """The contacts of a pair of surfaces, one for each two bodies that they have."""
        law = self._law(card)
        tied = law.get("kind") == "bonded"
        names = slave_surface, master_surface
        with card.reading():
            slaves, masters = (self._side(card, name) for name in names)
        wheel = self._wheel(card)
        joined = self._joined(card, law, slaves, masters, wheel)
        for slave, on, master, against in joined:
            contact: Entries = {
                "bodies": [slave.name, master.name],
                "on": [slave.group(on, slave_surface), master.group(against, master_surface)],
            } | law
            contact |= self._slave(slave, on, master)
            gap = self._clearance(names)
            if wheel:
                contact["image"] = _image(wheel, slave.middle(on), master.middle(against))
            if gap is None and not tied and card.says("ADJUST", "NO") != "NO":
                gap = self._adjusted(card, slave, slave.heights(on, master, against))
            yield contact | ({} if gap is None else {"gap": gap})
        if joined:
            self.notes.taken(card, "bonded contact" if tied else "contact")
        if tied and not wheel:
            self._tell_gaps(card, slaves, joined)

    def _slave(self, slave: Piece, on: np.ndarray, master: Piece) -> dict[str, str]:
        """The entry of the slave; none where it could be none, as it is supported or rigid all over."""
        if self._held.issuperset(slave.nodes[np.unique(slave.facets[on])].tolist()):
            return {}
        return {"slave": "first" if slave is master else slave.name}

    def _wheel(self, card: Card) -> Card | None:
        """The *CYCLIC SYMMETRY MODEL of a tie that says that it is cyclic. Raises InputError where there is none."""
        if "CYCLICSYMMETRY" not in card.given:
            return None
        wheels = self.model.wheels
        found = wheels.get(card.name_of("NAME")) or wheels.get("")
        if not found:
            raise card.error("a cyclic tie without a *CYCLIC SYMMETRY MODEL")
        self.turned.append(found)
        return found

    @cached_property
    def _held(self) -> set[int]:
        """Nodes with supports, and those of rigid sets."""
        supported = {node for node, _ in self.kinds["supports"]}
        return supported.union(*(one.nodes for one in self.model.rigid))

    def _clearance(self, surfaces: Iterable[str]) -> float | None:
        """The gap of these surfaces by *CLEARANCE, if there is one."""
        clearance = self.model.clearances.get(frozenset(map(called, surfaces)))
        if clearance is None:
            return None
        self.cleared.append(clearance)
        self.notes.taken(clearance, "gap")
        return number(clearance.given["VALUE"])

    def _law(self, card: Card) -> Entries:
        """The kind, the softness and the friction of a pair of surfaces, as a contact has them. Raises InputError."""
        if card.word == "TIE":
            return {"kind": "bonded"}
        name = card.name_of("INTERACTION").upper()
        if name not in self.model.interactions:
            raise card.error(f"there is no *SURFACE INTERACTION {name}")
        law = self.model.interactions[name]
        behaviour = law.get("SURFACEBEHAVIOR", card)
        if behaviour.says("PRESSURE-OVERCLOSURE") == "TIED":
            return {"kind": "bonded"}
        friction: Any = number(law["FRICTION"].rows[0][0] or "0") if "FRICTION" in law else 0.0
        if changes := self.model.rubbing.get(name):
            course = [(0.0, friction)]
            for k, end in enumerate(self.model.ends):
                course.append((end, changes.get(k, course[-1][1])))
            friction, history = self.acts.factor(Acting(card, tuple(course)))
            friction = {"value": friction, "history": history} if history else friction
        softness = self._softness(behaviour)
        entries = {"softness": softness} if softness else {}
        if friction:
            entries["friction"] = {"law": "coulomb", "coefficient": friction}
        return entries

    def _softness(self, card: Card) -> Any:
        """The softness of *SURFACE BEHAVIOR; None of a hard one."""
        with card.reading():
            match card.says("PRESSURE-OVERCLOSURE"):
                case "LINEAR":
                    stiffness = number(entry(card.rows[0] if card.rows else [], 0, "0"))
                    if stiffness <= 0.0:
                        raise DeckError("the slope of pressure over overclosure must be positive")
                    return 1.0 / stiffness
                case "TABULAR":
                    rows = [numbers(row[:2]) for row in card.rows]
                    table = {"pressure": [p for p, _ in rows], "closure": [w for _, w in rows]}
                    try:
                        Closure(**table)
                    except ValueError as error:
                        self.notes.lost(card, str(error))
                    return table
        return None

    def _joined(
        self,
        card: Card,
        law: Entries,
        slaves: Sequence[Side],
        masters: Sequence[Side],
        wheel: Card | None,
    ) -> list[Pair]:
        """The sides of a pair of surfaces as `_facing`, without those that are in contact already."""
        found = self._facing(slaves, masters, wheel)
        fresh = [not self._again(card, law, one) for one in found]
        own = {piece.name for piece, _ in slaves} & {piece.name for piece, _ in masters}
        if own and not found:
            self.notes.lost(card, f"contact of {', '.join(sorted(own))} with itself by one surface")
        elif not found:
            self.notes.lost(
                card,
                f"{card.rows and ' or '.join(card.rows[0][:2])} has no faces on a body",
            )
        if not all(fresh):
            self.notes.changed(card, "a contact that is there already is one contact")
        return [one for one, new in zip(found, fresh, strict=True) if new]

    def _facing(
        self, slaves: Sequence[Side], masters: Sequence[Side], wheel: Card | None
    ) -> list[Pair]:
        """The sides of a pair of surfaces by two bodies, or by one that touches itself, or of a wheel its image."""
        alone = wheel is not None or len(slaves) == len(masters) == 1
        found = [
            (*a, *b)
            for a, b in product(slaves, masters)
            if a[0] is not b[0] or _touch(*a, b[1], alone)
        ]
        if wheel:  # each flank is tied to the other one of its own body
            found = [one for one in found if one[0] is one[2]] or found
            self.notes.taken(wheel, "a sector with an image of its flank")
        return found

    def _adjusted(self, card: Card, slave: Piece, heights: np.ndarray) -> float | None:
        """The gap by ADJUST of nodes of a slave with these heights (k,) over the master."""
        word = card.says("ADJUST")
        reach = number(word) if re.fullmatch(r"[\d.]+([ED][+-]?\d+)?", word) else np.nan
        near = heights <= max(reach, 1e-9 * float(np.ptp(slave.points, axis=0).max()))
        if near.all() and len(near):
            self.notes.changed(card, "ADJUST: the surfaces touch, with a gap of 0")
            return 0.0
        if reach == 0.0 or (reach > 0.0 and not near.any()):
            self.notes.changed(card, "ADJUST moves nothing: gaps are those of the mesh")
        else:
            self.notes.lost(card, "ADJUST that moves some of the nodes only")
        return None

    def _tell_gaps(self, card: Card, slaves: Sequence[Side], joined: Sequence[Pair]) -> None:
        """Note ties of nodes beyond their tolerance; without one, beyond a twentieth of the median side of facets."""
        word = card.given.get("POSITIONTOLERANCE", "")
        for slave, on in slaves:
            found = [
                slave.heights(on, master, against)
                for own, _, master, against in joined
                if own is slave
            ]
            if not found:
                continue
            heights = np.concatenate(found)
            reach = number(word) if word else 0.05 * slave.spacing(on)
            near = heights.min(initial=np.inf)
            far = heights.max(initial=0.0)
            if word and near > reach:
                self.notes.lost(card, f"a tie over a gap of {near:.3g}, beyond its tolerance")
            elif far > reach:
                self.notes.changed(card, f"nodes {far:.3g} apart, beyond its tolerance, are tied")

    def bolts(self) -> Iterable[Entries]:
        """The bonded contacts at the sections of bolts, with the force of their reference nodes, or over a gap by which
        these shorten them; and around the layers that had to be taken out."""
        for card, ends, section, around in self.acts.cuts:
            node = self.model.node(card, card.given["NODE"])
            sides = self.acts.on(ends)
            others = [
                (piece, facets)
                for piece, facets, _ in self.acts.at(section)
                if len(facets) and not any(piece is one for one, _ in sides)
            ]
            if reason := self._no_bolt(card, node, [*map(len, (sides, others))] == [1, 1]):
                self.notes.lost(card, reason)
                continue
            ((piece, facets),) = sides
            ((other, against),) = others
            bond: Entries = {"bodies": [piece.name, other.name], "kind": "bonded"}
            on = [piece.group(facets, "section"), other.group(against, "section")]
            yield bond | {"on": on} | self._pulled(card, node, piece.outward(facets))
            if len(around):
                words = "the elements at the section are a body of their own, bonded to the others, which hang together"
                self.notes.changed(card, f"{words} without it")
                layers = [(one, one.whole(one.within(around))) for one in (piece, other)]
                yield bond | {"on": [one.group(facets, "layer") for one, facets in layers]}

    def _pulled(self, card: Card, node: int, normal: np.ndarray) -> Entries:
        """How a bolt is pulled at its section, whose `normal` (d,) points away from the elements of its surface."""
        force = self.kinds["forces"].get((node, 1))
        given = force or self.kinds["supports"][node, 1]
        if force and node in self.model.locked:  # after its last point the offset is kept
            kept = tuple(p for p in force.course if p[0] <= self.model.locked[node])
            given = force._replace(course=kept)
        value, history = self.acts.factor(given)
        if card.rows and normal @ card.values()[: len(normal)] < 0.0:
            value = -value  # its normal points into the elements of the surface
        if not force:
            self.notes.taken(card, "a bond over a gap")
            return {"gap": {"value": value} | later(history)}
        self.notes.taken(card, "a bond with a pretension")
        pull = {"force": value / self.acts.matter.depth, "along": normal.tolist()}
        return {"pretension": pull | later(history)}

    def _no_bolt(self, card: Card, node: int, cuts: bool) -> str:
        """Why a section with this node is no bolt of its own; empty if it is one. It `cuts` a body in two, or not."""
        for one, *_ in self.acts.cuts:
            if one is not card and self.model.node(one, one.given["NODE"]) == node:
                return f"its node is also that of line {one.line}"
        if node in self.acts.rigid_nodes:
            return "its node is the reference node of a rigid set"
        given = [(node, 1) in self.kinds[kind] for kind in ("forces", "supports")]
        if not any(given):
            return "a pre-tension whose node has neither a force nor a displacement"
        return "" if cuts and not all(given) else "a section that does not cut a body in two"


def _touch(piece: Piece, on: np.ndarray, against: np.ndarray, alone: bool) -> bool:
    """Whether two sides of one body touch: they have no faces in common and, unless they are `alone` as of surfaces of
    this body only, some nodes lie as near to the others as to their neighbours."""
    if np.intersect1d(on, against).size:
        return False
    near = piece.heights(on, piece, against).min(initial=np.inf)
    return alone or bool(near <= piece.spacing(on))


def _image(wheel: Card, slave: np.ndarray, master: np.ndarray) -> Entries:
    """The image of the master's flank with this middle (3,) that is at the slave's: a turn by one sector, forwards or
    back. Raises InputError."""
    with wheel.reading():
        place = vector(wheel.values(), 6)
        if len(wheel.values()) < 4 or not np.any(place[3:] != place[:3]):
            raise DeckError("its axis is given by two points in space")
        count = number(wheel.given.get("N", "0"))
        if count < 2 or count % 1:
            raise DeckError("N is a whole number of sectors from 2 on")
    pivot = place[:3]
    axis = place[3:] - place[:3]
    unit = axis / np.linalg.norm(axis)

    def off(turn: float) -> float:
        there = Frame.of(np.zeros(3), turn * unit, pivot).at(master)
        return float(np.linalg.norm(there - slave))

    turn = min((360.0 / count, -360.0 / count), key=off)
    return {"turn": turn, "axis": axis.tolist(), "pivot": pivot.tolist()}
