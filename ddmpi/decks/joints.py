"""What joins the bodies of a deck: contacts and ties, the sections of bolts, and rigid sets of nodes."""

from __future__ import annotations

import re
from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np

from ddmpi.decks.acting import Acts
from ddmpi.decks.cards import EXACT, Card, Pair, Rigid, number
from ddmpi.decks.pieces import Piece, formula, own_name
from ddmpi.errors import InputError

ROUNDING = 1e-12
"""Moments below this fraction of the forces times the coordinates are zero."""

ZERO = 0.0, None

Cut = tuple[Card, set[tuple[int, int]], np.ndarray, np.ndarray]
"""A section of a bolt: its keyword, the faces of elements on one side, the nodes there, and those around the layer of
these elements, where that is a body of its own."""


class Joints:
    """The contacts of a deck, those at the `cuts` through bolts included, as entries of a scene."""

    def __init__(self, acts: Acts, cuts: Sequence[Cut]) -> None:
        self.acts, self.notes, self.model, self.pieces, self.cuts = acts, acts.notes, acts.model, acts.pieces, cuts
        self.deck, self.matter = acts.model.deck, acts.matter

    def _side(self, card: Card, name: str) -> list[tuple[Piece, np.ndarray]]:
        """The facets of a surface, of elements or of nodes, by body. Raises InputError where there is no surface."""
        if self.deck.key("SURFACE", card.scope, name):
            found = defaultdict[str, list[int]](list)
            for end in self.deck.ends(card, name):
                if end in self.acts.where:
                    found[self.acts.where[end][0].name].append(self.acts.where[end][1])
            return [(piece, np.unique(found[piece.name])) for piece in self.pieces if found[piece.name]]
        if not self.deck.key("NODES", card.scope, name):
            raise InputError(card.tells(f"there is no surface {name}"))
        nodes, sides = self.deck.chosen(card, "NODES", name), []
        for piece in self.pieces:
            marked = piece.within(nodes)
            facets = piece.whole(marked)
            if marked.any() and np.setdiff1d(np.flatnonzero(marked), piece.facets[facets]).size:
                self.notes.lost.add(card, f"the surface {name} has nodes without a whole face")
            if len(facets):
                sides.append((piece, facets))
        return sides

    def contacts(self, pair: Pair) -> Iterable[dict[str, Any]]:
        """The contacts of a pair of surfaces, one for each two bodies that they have."""
        card, notes, law = pair.card, self.notes, {}
        tied = card.word == "TIE"
        if not tied:
            name = card.says("INTERACTION")
            if name not in self.model.interactions:
                raise InputError(card.tells(f"there is no *SURFACE INTERACTION {name}"))
            law = self.model.interactions[name]
            behaviour = law.get("SURFACEBEHAVIOR")
            tied = behaviour is not None and behaviour.says("PRESSURE-OVERCLOSURE") == "TIED"
        slaves, masters = (self._side(card, name) for name in (pair.slave, pair.master))
        count, held = 0, set().union({node for node, _ in self.model.kinds["supports"]},
                                     *(rigid.nodes for rigid in self.model.rigid))
        for slave, on in slaves:
            for master, against in masters:
                if slave is master:
                    continue
                contact: dict[str, Any] = {
                    "bodies": [slave.name, master.name],
                    "on": [slave.group(on, pair.slave), master.group(against, pair.master)]}
                coefficient = number(law["FRICTION"].rows[0][0]) if "FRICTION" in law and law["FRICTION"].rows else 0.0
                if tied:
                    contact["kind"] = "bonded"
                elif coefficient:
                    contact["friction"] = {"law": "coulomb", "coefficient": coefficient}
                if not tied and not held.issuperset(slave.nodes[np.unique(slave.facets[on])].tolist()):
                    contact["slave"] = slave.name  # supported or rigid all over it could be none
                gap = self._clearance(pair)
                if gap is not None:
                    contact["gap"] = gap
                elif not tied and (word := card.says("ADJUST", "NO")) != "NO":
                    heights = slave.heights(on, master, against)
                    reach = number(word) if re.fullmatch(r"[\d.]+([ED][+-]?\d+)?", word) else np.nan
                    near = heights <= max(reach, 1e-9 * float(np.ptp(slave.points, axis=0).max()))
                    if near.all() and len(near):
                        contact["gap"] = 0.0
                        notes.changed.add(card, "ADJUST: the surfaces touch, with a gap of 0")
                    elif reach == 0.0 or (reach > 0.0 and not near.any()):
                        notes.changed.add(card, "ADJUST moves nothing: gaps are those of the mesh")
                    else:
                        notes.lost.add(card, "ADJUST that moves some of the nodes only")
                count += 1
                yield contact
        own = {piece.name for piece, _ in slaves} & {piece.name for piece, _ in masters}
        if own:
            notes.lost.add(card, f"contact of {', '.join(sorted(own))} with itself")
        elif not count:
            notes.lost.add(card, f"{pair.slave} or {pair.master} has no faces on a body")
        if count:
            notes.taken.add(card, "bonded contact" if tied else "contact")
            if tied:
                self._tells_gap(pair, slaves, masters)

    def _tells_gap(self, pair: Pair, slaves: Sequence[tuple[Piece, np.ndarray]],
                   masters: Sequence[tuple[Piece, np.ndarray]]) -> None:
        """Note a tie of nodes that are farther apart than its tolerance; without one, than a twentieth of a facet."""
        word = pair.card.given.get("POSITIONTOLERANCE", "")
        for slave, on in slaves:
            facets = slave.facets[on]
            reach = number(word) if word else 0.05 * float(np.median(np.linalg.norm(
                slave.points[facets[:, 0]] - slave.points[facets[:, 1]], axis=1)))
            found = [slave.heights(on, master, against) for master, against in masters if master is not slave]
            far = float(max((heights.max(initial=0.0) for heights in found), default=0.0))
            near = float(min((heights.min(initial=np.inf) for heights in found), default=0.0))
            if word and near > reach:
                self.notes.lost.add(pair.card, f"a tie over a gap of {near:.3g}, beyond its tolerance")
            elif far > reach:
                self.notes.changed.add(pair.card, f"nodes {far:.3g} apart, beyond its tolerance, are tied")

    def _clearance(self, pair: Pair) -> float | None:
        for card in self.model.clearances:
            names = {card.says("SLAVE"), card.says("MASTER")}
            if names == {pair.slave.upper(), pair.master.upper()} and "VALUE" in card.given:
                self.notes.taken.add(card, "gap")
                return number(card.given["VALUE"])
        return None

    def bolts(self) -> Iterable[dict[str, Any]]:
        """The bonded contacts at the sections of bolts, with the force of their reference nodes, or over a gap by which
        these shorten them; and around the layers that had to be taken out."""
        for card, ends, section, around in self.cuts:
            sides = {self.acts.where[end][0].name: self.acts.where[end][0] for end in ends if end in self.acts.where}
            others = [piece for piece in self.pieces if piece.name not in sides and len(
                piece.whole(piece.within(section)))]
            node = self.model.node(card, card.given["NODE"])
            force, offset = (self.model.kinds[kind].get((node, 1)) for kind in ("forces", "supports"))
            given = force or offset
            if len(sides) != 1 or len(others) != 1 or not given or (force and offset):
                self.notes.lost.add(card, "a section that does not cut a body in two" if given else
                                    "a pre-tension whose node has neither a force nor a displacement")
                continue
            (piece,), other = sides.values(), others[0]
            if force and node in self.model.locked:  # after its last point the offset is kept
                given = force._replace(course=tuple(p for p in force.course if p[0] <= self.model.locked[node]))
            value, history = self.acts.factor(given)
            facets = np.unique([self.acts.where[end][1] for end in ends])
            out = piece.points[piece.facets[facets[0], :2]].mean(axis=0) - piece.points.mean(axis=0)
            normal = piece.normals(facets)[0]
            if card.rows and normal @ card.values()[:len(normal)] * (normal @ out) < 0.0:
                value = -value  # the normal that the card gives points into the elements of the surface
            along, later = (normal * np.sign(normal @ out)).tolist(), {"history": history} if history else {}
            self.notes.taken.add(card, "a bond with a pretension" if force else "a bond over a gap")
            bond: dict[str, Any] = {"bodies": [piece.name, other.name], "kind": "bonded"}
            yield bond | {"on": [piece.group(facets, "section"), other.group(
                other.whole(other.within(section)), "section")]} | (
                    {"pretension": {"force": value / self.matter.depth, "along": along} | later} if force else
                    {"gap": {"value": value} | later})
            if len(around):
                self.notes.changed.add(card, "the elements at the section are a body of their own, bonded "
                                       "to the others, which hang together without it")
                yield bond | {"on": [piece.group(piece.whole(piece.within(around)), "layer"),
                                     other.group(other.whole(other.within(around)), "layer")]}


class RigidSets:
    """What the rigid sets of a deck become: clamps and tractions by body, rigid partners, and their contacts."""

    def __init__(self, acts: Acts) -> None:
        self.acts, self.notes, self.model = acts, acts.notes, acts.model
        self.clamps: dict[str, list[dict[str, Any]]] = {piece.name: [] for piece in acts.pieces}
        self.tractions: dict[str, list[dict[str, Any]]] = {piece.name: [] for piece in acts.pieces}
        self.partners: list[dict[str, Any]] = []
        self.contacts: list[dict[str, Any]] = []
        for rigid in self.model.rigid:
            own = [(piece, piece.whole(marked), marked) for piece in acts.pieces
                   if (marked := piece.within(rigid.nodes)).any()]
            points = len(own) == 1 and not len(own[0][1]) and not self._parts("supports", rigid)
            if len(own) == 1 and _covered(*own[0]):
                reason = self._take(rigid, *own[0][:2])
            elif points and (patches := own[0][0].patches(np.flatnonzero(own[0][2]))[0]):
                reason = self._take(rigid._replace(spread=True), own[0][0], np.unique(
                    np.concatenate([patch.facets for patch in patches])))
                self.notes.changed.add(rigid.card, "points alone hold nothing in a solid; the loads on "
                                       "them are spread over the faces around them")
            else:
                reason = "its nodes are no whole faces of one body"
            where = self.notes.lost if reason else self.notes.taken
            where.add(rigid.card, reason or (
                "forces spread over a face" if rigid.spread or points else "a face that moves as a rigid one"))

    def _take(self, rigid: Rigid, piece: Piece, facets: np.ndarray) -> str:
        """Write a rigid set that has whole faces of a body; the reason where it is not possible."""
        axes = self.acts.axes
        if len(axes) < 3:
            return "in the plane"
        held, pushed = self._parts("supports", rigid), self._parts("forces", rigid)
        histories = {history for value, history in [*held.values(), *pushed.values()] if value}
        if len(histories) > 1:
            return "its loads and displacements change in different ways"
        more = {"history": histories.pop()} if histories - {None} else {}
        pivot = np.array(self.model.deck.points[rigid.ref])
        if rigid.spread:
            if held:
                return "a distributing coupling whose reference node is held"
            force, moment = (np.array([pushed.get(k, ZERO)[0] for k in some]) for some in (range(3), range(3, 6)))
            x, w = piece.quadrature(facets, False)
            centre = w @ x / w.sum()
            moment = moment + np.cross(pivot - centre, force)  # about the centre of the faces
            moment[np.abs(moment) <= ROUNDING * np.abs(force).max() * np.abs([pivot, centre]).max()] = 0.0
            on = piece.group(facets, "coupled")
            self.tractions[piece.name] += [{"on": on, key: value.tolist()} | more for key, value in
                                           (("force", force), ("moment", moment)) if np.abs(value).max() > 0.0]
            return ""
        if len(held) == 6:  # u = u_r + θ × (x − x_r)
            shift, turn = (np.array([held[k][0] for k in some]) for some in (range(3), range(3, 6)))
            slopes = np.cross(turn, np.eye(3))  # row k: ∂u/∂x_k
            self.clamps[piece.name].append({"on": piece.group(facets, "rigid")} | {
                axis: formula(float(shift[k] - slopes[:, k] @ pivot), slopes[:, k], axes)
                for k, axis in enumerate(axes)} | more)
            return ""
        normals = piece.normals(facets)
        normal = normals[0] * np.sign((piece.points[piece.facets[facets[0], :3]].mean(axis=0)
                                       - piece.points.mean(axis=0)) @ normals[0])
        if np.abs(np.abs(normals @ normal) - 1.0).max() > EXACT:
            return "its faces are not flat"
        turns = [k for k in range(3, 6) if k in held]
        if turns and (len(turns) < 3 or any(held[k][0] for k in turns)):
            return "some of its turns are given, and others are free"
        partner: dict[str, Any] = {
            "name": own_name("rigid", [*(one["name"] for one in self.partners), *self.clamps]), "shape": "plane",
            "point": piece.points[piece.facets[facets[0], 0]].tolist(), "normal": (-normal).tolist(),
            "displacement": [held.get(k, ZERO)[0] for k in range(3)]}
        partner["free"] = [axes[k] for k in range(3) if k not in held and not pushed.get(k, ZERO)[0]]
        loads = [pushed.get(k, ZERO)[0] for k in range(6)]
        partner |= {"force": loads[:3]} if any(loads[:3]) else {}
        if not turns:
            partner |= {"pivot": pivot.tolist()} | ({"moment": loads[3:]} if any(loads[3:]) else {"turns": True})
        self.partners.append({key: value for key, value in partner.items() if value != []} | more)
        self.contacts.append({"bodies": [piece.name, partner["name"]], "on": [piece.group(facets, "rigid")],
                              "kind": "bonded"})
        return ""

    def _parts(self, kind: str, rigid: Rigid) -> dict[int, tuple[float, str | None]]:
        """Shifts or forces (0 to 2) and turns or moments (3 to 5) of the reference nodes."""
        found: dict[int, tuple[float, str | None]] = {}
        for (node, component), acting in self.model.kinds[kind].items():
            if node in (rigid.ref, rigid.turn):
                k = component - 1 + 3 * (node == rigid.turn and rigid.turn != rigid.ref)
                value, history = self.acts.factor(acting)
                if kind == "supports" or value:
                    found[k] = value, history if value else None
        return found


def _covered(piece: Piece, facets: np.ndarray, marked: np.ndarray) -> bool:
    """Whether facets have all `marked` nodes."""
    return len(facets) > 0 and not np.setdiff1d(np.flatnonzero(marked), piece.facets[facets]).size
