"""What joins the bodies of a deck: contacts and ties, the sections of bolts, and rigid sets of nodes."""

from __future__ import annotations

import re
from collections.abc import Iterable
from itertools import product
from typing import Any

import numpy as np

from ddmpi.decks.acting import Acts, later
from ddmpi.decks.cards import EXACT, Card, Rigid, number
from ddmpi.decks.pieces import Piece, formula, own_name
from ddmpi.errors import InputError
from ddmpi.system.numbers import ROUNDING


class Joints:
    """What joins the bodies of a deck, as entries of a scene.

    Attributes
    ----------
    clamps, tractions : of rigid sets, by body
    partners, held : rigid partners of rigid sets, and the contacts with them
    """

    def __init__(self, acts: Acts) -> None:
        self.acts, self.notes, self.model, self.deck = acts, acts.notes, acts.model, acts.model.deck
        self.clamps: dict[str, list[dict[str, Any]]] = {piece.name: [] for piece in acts.pieces}
        self.tractions: dict[str, list[dict[str, Any]]] = {piece.name: [] for piece in acts.pieces}
        self.partners: list[dict[str, Any]] = []
        self.held: list[dict[str, Any]] = []
        for rigid in self.model.rigid:
            own, reason = self.acts.at(rigid.nodes), "its nodes are no whole faces of one body"
            free = np.isnan(self._parts("supports", rigid)[0]).all()
            points = len(own) == 1 and not len(own[0][1]) and free
            if len(own) == 1 and own[0][2]:
                reason = self._take(rigid, *own[0][:2])
            elif points:
                patches, _ = own[0][0].patches(np.flatnonzero(own[0][0].within(rigid.nodes)))
                facets = np.unique(np.concatenate([facets for facets, _ in patches] or [own[0][1]]))
                if len(facets):
                    reason = self._take(rigid._replace(spread=True), own[0][0], facets)
                    self.notes.add(
                        "changed",
                        rigid.card,
                        "points alone hold nothing in a solid; the loads on "
                        "them are spread over the faces around them",
                    )
            self.notes.add(
                "lost" if reason else "taken",
                rigid.card,
                reason
                or (
                    "forces spread over a face"
                    if rigid.spread or points
                    else "a face that moves as a rigid one"
                ),
            )

    def _side(self, card: Card, name: str) -> list[tuple[Piece, np.ndarray]]:
        """The facets of a surface, of elements or of nodes, by body. Raises InputError where there is no surface."""
        if self.deck.key("SURFACE", card.scope, name):
            return self.acts.on(self.deck.ends(card, name))
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
        notes, law = self.notes, dict[str, Card]()
        if card.word != "TIE":
            name = card.says("INTERACTION")
            if name not in self.model.interactions:
                raise InputError(card.tells(f"there is no *SURFACE INTERACTION {name}"))
            law = self.model.interactions[name]
        behaviour = law.get("SURFACEBEHAVIOR", card).says("PRESSURE-OVERCLOSURE")
        tied = card.word == "TIE" or behaviour == "TIED"
        coefficient = (
            number(law["FRICTION"].rows[0][0])
            if "FRICTION" in law and law["FRICTION"].rows
            else 0.0
        )
        slaves, masters = (self._side(card, name) for name in (slave_surface, master_surface))
        held = set().union(
            {node for node, _ in self.model.kinds["supports"]},
            *(one.nodes for one in self.model.rigid),
        )
        joined = [
            (slave, on, master, against)
            for (slave, on), (master, against) in product(slaves, masters)
            if slave is not master
        ]
        for slave, on, master, against in joined:
            contact: dict[str, Any] = {
                "bodies": [slave.name, master.name],
                "on": [slave.group(on, slave_surface), master.group(against, master_surface)],
            }
            if tied:
                contact["kind"] = "bonded"
            elif coefficient:
                contact["friction"] = {"law": "coulomb", "coefficient": coefficient}
            if not tied and not held.issuperset(slave.nodes[np.unique(slave.facets[on])].tolist()):
                contact["slave"] = slave.name  # supported or rigid all over it could be none
            clearance, gap = (
                self.model.clearances.get(
                    frozenset((slave_surface.upper(), master_surface.upper()))
                ),
                None,
            )
            if clearance:
                gap = number(clearance.given["VALUE"])
                notes.add("taken", clearance, "gap")
            elif not tied and card.says("ADJUST", "NO") != "NO":
                gap = self._adjusted(card, slave, slave.heights(on, master, against))
            yield contact | ({} if gap is None else {"gap": gap})
        own = {piece.name for piece, _ in slaves} & {piece.name for piece, _ in masters}
        if own:
            notes.add("lost", card, f"contact of {', '.join(sorted(own))} with itself")
        elif not joined:
            notes.add("lost", card, f"{slave_surface} or {master_surface} has no faces on a body")
        if joined:
            notes.add("taken", card, "bonded contact" if tied else "contact")
        for slave, on in slaves if tied else ():
            found = [
                slave.heights(on, master, against)
                for own, _, master, against in joined
                if own is slave
            ]
            if found:
                self._tell_gap(card, slave.points[slave.facets[on][:, :2]], np.concatenate(found))

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
            if len(sides) != 1 or len(others) != 1 or not given or (force and offset):
                self.notes.add(
                    "lost",
                    card,
                    "a section that does not cut a body in two"
                    if given
                    else "a pre-tension whose node has neither a force nor a displacement",
                )
                continue
            ((piece, facets),), ((other, against),) = sides, others
            if force and node in self.model.locked:  # after its last point the offset is kept
                given = force._replace(
                    course=tuple(p for p in force.course if p[0] <= self.model.locked[node])
                )
            value, history = self.acts.factor(given)
            normal = piece.outward(facets)
            if card.rows and normal @ card.values()[: len(normal)] < 0.0:
                value = (
                    -value
                )  # the normal that the card gives points into the elements of the surface
            self.notes.add(
                "taken", card, "a bond with a pretension" if force else "a bond over a gap"
            )
            bond: dict[str, Any] = {"bodies": [piece.name, other.name], "kind": "bonded"}
            yield (
                bond
                | {"on": [piece.group(facets, "section"), other.group(against, "section")]}
                | (
                    {
                        "pretension": {
                            "force": value / self.acts.matter.depth,
                            "along": normal.tolist(),
                        }
                        | later(history)
                    }
                    if force
                    else {"gap": {"value": value} | later(history)}
                )
            )
            if len(around):
                self.notes.add(
                    "changed",
                    card,
                    "the elements at the section are a body of their own, bonded "
                    "to the others, which hang together without it",
                )
                yield bond | {
                    "on": [
                        one.group(one.whole(one.within(around)), "layer") for one in (piece, other)
                    ]
                }

    def _take(self, rigid: Rigid, piece: Piece, facets: np.ndarray) -> str:
        """Write a rigid set that has whole faces of a body; the reason where it is not possible."""
        axes = self.acts.axes
        if len(axes) < 3:
            return "in the plane"
        (held, of_held), (loads, of_loads) = (
            self._parts(kind, rigid) for kind in ("supports", "forces")
        )
        if np.nan_to_num([held[6:], loads[6:]]).any():
            return "a node of rotations has components 1 to 3 alone"
        held, loads = held[:6], loads[:6]
        if len(of_held | of_loads) > 1:
            return "its loads and displacements change in different ways"
        more = later(next(iter(of_held | of_loads), None))
        given, held, loads = ~np.isnan(held), np.nan_to_num(held), np.nan_to_num(loads)
        pivot = np.array(self.model.deck.points[rigid.ref])
        if rigid.spread:
            if given.any():
                return "a distributing coupling whose reference node is held"
            (force, moment), (x, w) = np.split(loads, 2), piece.quadrature(facets, False)
            centre = w @ x / w.sum()
            moment = moment + np.cross(pivot - centre, force)  # about the centre of the faces
            moment[
                np.abs(moment) <= ROUNDING * np.abs(force).max() * np.abs([pivot, centre]).max()
            ] = 0.0
            on = piece.group(facets, "coupled")
            self.tractions[piece.name] += [
                {"on": on, key: value.tolist()} | more
                for key, value in (("force", force), ("moment", moment))
                if value.any()
            ]
            return ""
        if given.all():  # u = u_r + θ × (x − x_r)
            shift, turn = np.split(held, 2)
            slopes = np.cross(turn, np.eye(3))  # row k: ∂u/∂x_k
            self.clamps[piece.name].append(
                {"on": piece.group(facets, "rigid")}
                | {
                    axis: formula(float(shift[k] - slopes[:, k] @ pivot), slopes[:, k], axes)
                    for k, axis in enumerate(axes)
                }
                | more
            )
            return ""
        normal = piece.outward(facets)
        if np.abs(np.abs(piece.normals(facets) @ normal) - 1.0).max() > EXACT:
            return "its faces are not flat"
        if given[3:].any() and (not given[3:].all() or held[3:].any()):
            return "some of its turns are given, and others are free"
        partner: dict[str, Any] = {
            "name": own_name("rigid", [*(one["name"] for one in self.partners), *self.clamps]),
            "shape": "plane",
            "point": piece.points[piece.facets[facets[0], 0]].tolist(),
            "normal": (-normal).tolist(),
            "displacement": held[:3].tolist(),
            "free": [
                axis
                for axis, one, load in zip(axes, given, loads, strict=False)
                if not one and not load
            ],
        }
        partner |= {"force": loads[:3].tolist()} if loads[:3].any() else {}
        if not given[3:].any():
            partner |= {"pivot": pivot.tolist()} | (
                {"moment": loads[3:].tolist()} if loads[3:].any() else {"turns": True}
            )
        self.partners.append({key: value for key, value in partner.items() if value != []} | more)
        self.held.append(
            {
                "bodies": [piece.name, partner["name"]],
                "on": [piece.group(facets, "rigid")],
                "kind": "bonded",
            }
        )
        return ""

    def _parts(self, kind: str, rigid: Rigid) -> tuple[np.ndarray, set[str | None]]:
        """Shifts or forces, and turns or moments of the reference nodes, and what has no meaning (9,), NaN where there
        is none; and the histories of those that are not zero."""
        values, histories = np.full(9, np.nan), set[str | None]()
        for (node, component), acting in self.model.kinds[kind].items():
            if node in (rigid.ref, rigid.turn):
                value, history = self.acts.factor(acting)
                values[component - 1 + 3 * (node == rigid.turn and rigid.turn != rigid.ref)] = value
                histories |= {history} if value else set()
        return values, histories
