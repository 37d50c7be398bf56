"""Rigid sets of nodes, and sets over which the forces of a reference node are spread.

Sets with one reference node are one rigid body, whatever keywords and however many bodies they are of.
"""

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from ddmpi.decks.acting import Acts, History, later
from ddmpi.decks.cards import EXACT, Entries, Rigid
from ddmpi.decks.pieces import Piece, Side, formula, own_name
from ddmpi.system.numbers import ROUNDING, crossed, moments

SMALL_TURN = 0.2
"""Largest turn (radians) of a rigid set with NLGEOM: displacements of small turns are 2 % off."""


class RigidSets:
    """What rigid sets are in a scene.

    Attributes
    ----------
    clamps, tractions : by body
    partners, bonds : rigid partners, and the contacts with them
    """

    def __init__(self, acts: Acts) -> None:
        self.acts = acts
        self.notes = acts.notes
        self.model = acts.model
        self.kinds = acts.kinds
        self.clamps: dict[str, list[Entries]] = {piece.name: [] for piece in acts.pieces}
        self.tractions = defaultdict[str, list[Entries]](list)
        self.partners: list[Entries] = []
        self.bonds: list[Entries] = []
        by_node = defaultdict[int, list[Rigid]](list)
        for rigid in self.model.rigid:
            by_node[rigid.ref].append(rigid)
        for sets in by_node.values():
            reason = self._apart(sets) or self._bare(sets) or self._join(sets)
            for one in sets if reason else ():
                self.notes.lost(one.card, reason)

    def _apart(self, sets: Sequence[Rigid]) -> str:
        """Why sets with one reference node are not one rigid body of a scene; empty if they are."""
        first = sets[0]
        nodes = set().union(*(one.nodes for one in sets))
        others = (_crossing(first, nodes, one) for one in self.model.rigid if one.ref != first.ref)
        if reason := next(filter(None, others), ""):
            return reason
        if len(sets) > 1 and any(one.spread for one in sets):
            words = "how its force divides between sets over which it is spread is not known"
            return f"lines {_lines(sets)} have one reference node; {words}"
        if len({one.turn for one in sets}) > 1:
            return "sets with one reference node turn by different nodes"
        if first.ref in self.acts.home and (first.spread or first.ref not in nodes):
            return "its reference node is one of a body, and not one of the set"
        acting = {node for kind in ("supports", "forces") for node, _ in self.kinds[kind]}
        turned = {first.ref, first.turn} & self.model.transforms.keys()
        return "its reference node has a *TRANSFORM" * bool(turned & acting)

    def _bare(self, sets: Sequence[Rigid]) -> str:
        """That one of the sets has no body; empty if all have."""
        bare = any(one.nodes.isdisjoint(self.acts.home) for one in sets)
        return f"of the sets of lines {_lines(sets)} one has no node of a body" * bare

    def _join(self, sets: Sequence[Rigid]) -> str:
        """Write sets with one reference node; the reason where it is not possible."""
        rigid = sets[0]._replace(nodes=set().union(*(one.nodes for one in sets)))
        own = self.acts.at(rigid.nodes)
        faces = [(piece, facets) for piece, facets, _ in own]
        if not own or not all(covered for *_, covered in own):
            facets = self._around(sets, own)
            if facets is None:
                return "its nodes are no whole faces of one body"
            rigid = rigid._replace(spread=True)
            faces = [(own[0][0], facets)]
        if reason := self._take(rigid, faces):
            return reason
        words = "forces spread over a face" if rigid.spread else "a face that moves as a rigid one"
        together = f"{len(sets)} sets with one reference node are one rigid body, as in Abaqus"
        for one in sets:
            self.notes.taken(one.card, words)
            if len(sets) > 1 and one.turn == one.ref:
                self.notes.changed(one.card, f"{together}; CalculiX lets each turn by itself")
        if rigid.spread and not sets[0].spread:
            self.notes.changed(
                rigid.card,
                "points alone hold nothing in a solid; the loads on them are spread over the faces around them",
            )
        return ""

    def _around(
        self, sets: Sequence[Rigid], own: Sequence[tuple[Piece, np.ndarray, bool]]
    ) -> np.ndarray | None:
        """The facets around a set of points of one body that is free to move; None for other sets."""
        if len(sets) > 1 or len(own) != 1 or len(own[0][1]):
            return None
        if not np.isnan(self._parts("supports", sets[0])[0]).all():
            return None
        piece = own[0][0]
        patches, _ = piece.patches(np.flatnonzero(piece.within(sets[0].nodes)))
        return np.unique(np.concatenate([some for some, *_ in patches])) if patches else None

    def _take(self, rigid: Rigid, faces: Sequence[Side]) -> str:
        """Write a rigid set that has whole faces of bodies; the reason where it is not possible."""
        if self.acts.axisymmetric:
            return "around an axis"
        held, of_held = self._parts("supports", rigid)
        loads, of_loads = self._parts("forces", rigid, ~np.isnan(held))
        d = len(self.acts.axes)
        both = np.nan_to_num([held, loads])
        within = [0, 1, 5] if d == 2 else [*range(6)]
        if both[:, 6:].any():
            return "a node of rotations has components 1 to 3 alone"
        if np.delete(both[:, :6], within, axis=1).any():
            return "its reference node is loaded or moved out of the plane"
        held = held[within]
        turn = float(np.linalg.norm(both[0, within[d:]]))
        if self.model.large and turn > SMALL_TURN:
            return f"it turns by {turn:.3g}, and turns are small in a scene"
        by_history = {
            history: some[within] / self.acts.matter.depth for history, some in of_loads.items()
        }
        pivot = np.array(self.model.deck.points[rigid.ref][:d])
        if rigid.spread:
            return self._spread(faces, held, by_history, pivot)
        if len(of_held.keys() | of_loads.keys()) > 1:
            return self._push_apart(rigid, faces, held, [*of_held], by_history, pivot)
        more = later(next(iter(of_held | of_loads), None))
        if np.isnan(held).any():
            loads = both[1, within] / self.acts.matter.depth
            return self._push(rigid, faces, held, loads, pivot, more)
        self._move(faces, held, pivot, more)
        return ""

    def _push_apart(
        self,
        rigid: Rigid,
        faces: Sequence[Side],
        held: np.ndarray,
        moves: Sequence[History],
        loads: dict[History, np.ndarray],
        pivot: np.ndarray,
    ) -> str:
        """Write a rigid partner with the history of its displacements, of `moves` at most one, and its loads by history
        as tractions on a face, which the partner keeps rigid; the reason where that is not possible."""
        if len(moves) > 1 or rigid.only is not None or not np.isnan(held).any():
            words = "its loads and displacements change in different ways"
            if len(self.model.ends) > 1:
                self.notes.lost_between_steps(rigid.card, words)
            return words
        more = later(next(iter(moves), None))
        reason = self._push(rigid, faces, held, np.zeros(len(held)), pivot, more)
        if not reason:
            self._on_faces(faces[0], loads, pivot, "rigid")
        return reason

    def _push(
        self,
        rigid: Rigid,
        faces: Sequence[Side],
        held: np.ndarray,
        loads: np.ndarray,
        pivot: np.ndarray,
        more: Entries,
    ) -> str:
        """Write a rigid partner that moves as forces want, where displacements `held` are not given (NaN)."""
        d = len(pivot)
        given = ~np.isnan(held)
        held = np.nan_to_num(held)
        if given[d:].any() and not given[d:].all():
            return "some of its turns are given, and others are free"
        if held[d:].any():
            return "its turns are given, and some of its displacements are free"
        name = own_name("rigid", [*(one["name"] for one in self.partners), *self.clamps])
        partner: Entries = {"name": name} | self._surface(faces, rigid.only)
        guided = {"kind": "guided", "gap": 0.0}
        law = {"kind": "bonded"} if rigid.only is None else guided
        partner["displacement"] = held[:d].tolist()
        axes = zip(self.acts.axes, given, loads, strict=False)
        partner["free"] = [axis for axis, one, load in axes if not one and not load]
        if loads[:d].any():
            partner["force"] = loads[:d].tolist()
        if not given[d:].any():
            partner["pivot"] = pivot.tolist()
            moment = loads[d:].tolist() if d == 3 else float(loads[d])
            partner |= {"moment": moment} if np.any(moment) else {"turns": True}
        self.partners.append({key: value for key, value in partner.items() if value != []} | more)
        for piece, facets in faces:
            on = [piece.group(facets, "rigid")]
            self.bonds.append({"bodies": [piece.name, name], "on": on} | law)
        return ""

    def _surface(self, faces: Sequence[Side], only: int | None) -> Entries:
        """The surface of a rigid partner: of one flat face in space its plane, which pictures show; else none, as of two
        faces, also parallel ones of one body, of which a plane would meet one alone."""
        (piece, facets), *others = faces
        normal = piece.outward(facets)
        places = piece.facets[facets]
        points = piece.points[places[places >= 0]]
        off = np.abs((points - points[0]) @ normal).max()
        if (
            others
            or (len(normal) < 3 and only is None)
            or off > EXACT * np.ptp(points, axis=0).max()
        ):
            return {"shape": "node"}
        return {"shape": "plane", "point": points[0].tolist(), "normal": (-normal).tolist()}

    def _spread(
        self,
        faces: Sequence[Side],
        held: np.ndarray,
        loads: dict[History, np.ndarray],
        pivot: np.ndarray,
    ) -> str:
        """Write the forces of a reference node as tractions on the faces of a body; the reason where that is not
        possible."""
        if len(faces) > 1:
            return "it spreads forces over several bodies; how they divide is not known"
        if not np.isnan(held).all():
            return "a distributing coupling whose reference node is held"
        self._on_faces(faces[0], loads, pivot, "coupled")
        return ""

    def _on_faces(
        self, face: Side, loads: dict[History, np.ndarray], pivot: np.ndarray, name: str
    ) -> None:
        """Write forces and moments of a reference node, by history, as tractions on a face, of a group like `name`: where
        the face is rigid, any forces with the same resultant about the node move it alike."""
        piece, facets = face
        d = len(self.acts.axes)
        x, w = piece.quadrature(facets, False)
        centre = w @ x / w.sum()
        arm = pivot - centre
        wide = np.abs([pivot, centre]).max()
        on = piece.group(facets, name)
        for history, values in loads.items():
            force, moment = np.split(values, [d])
            # about the centre of the faces
            moment = moment + moments(arm[None], force[None])[0]
            moment[np.abs(moment) <= ROUNDING * np.abs(force).max() * wide] = 0.0
            for key, value in ("force", force), ("moment", moment):
                if value.any():
                    given = float(value[0]) if len(value) == 1 else value.tolist()
                    self.tractions[piece.name].append({"on": on, key: given} | later(history))

    def _move(
        self, faces: Sequence[Side], held: np.ndarray, pivot: np.ndarray, more: Entries
    ) -> None:
        """Write a rigid motion that is given: u = u_r + θ × (x − x_r)."""
        d = len(pivot)
        axes = self.acts.axes
        shift, turn = np.split(held, [d])
        slopes = crossed(turn[None], np.eye(d))  # row k: ∂u/∂x_k
        moved = {
            axis: formula(float(shift[k] - slopes[:, k] @ pivot), slopes[:, k], axes)
            for k, axis in enumerate(axes)
        }
        for piece, facets in faces:
            self.clamps[piece.name].append({"on": piece.group(facets, "rigid")} | moved | more)

    def _parts(
        self, kind: str, rigid: Rigid, given: Sequence[bool] | np.ndarray = (False,) * 9
    ) -> tuple[np.ndarray, dict[History, np.ndarray]]:
        """Shifts or forces, and turns or moments of the reference nodes, and what has no meaning (9,), NaN where there
        is none; and those that are not zero by their histories. Forces along `given` displacements are left out."""
        values = np.full(9, np.nan)
        histories = defaultdict[History, np.ndarray](lambda: np.zeros(9))
        apart = rigid.turn != rigid.ref
        for (node, component), acting in self.kinds[kind].items():
            if node in (rigid.ref, rigid.turn):
                k = component - 1 + 3 * (node == rigid.turn and apart)
                if given[k]:
                    if acting.moves:
                        words = "forces along displacements that are given change nothing"
                        self.notes.changed(rigid.card, words)
                    continue
                value, history = self.acts.factor(acting)
                values[k] = np.nansum([values[k], value]) if kind == "forces" else value
                if value:
                    histories[history][k] += value
        return values, histories


def _lines(sets: Sequence[Rigid]) -> str:
    return ", ".join(str(one.card.line) for one in sets)


def _crossing(first: Rigid, nodes: set[int], other: Rigid) -> str:
    """Why a set with these `nodes` and one of another reference node are no two bodies; empty if they are."""
    line = f"line {other.card.line}"
    if {first.ref, first.turn} & {other.ref, other.turn}:
        return f"its node of rotations is also that of {line}"
    if (
        first.only == other.only
        and not first.spread | other.spread
        and not nodes.isdisjoint(other.nodes)
    ):
        return f"some of its nodes are in the set of {line}, which has another reference node"
    if {other.ref, other.turn} & nodes or {first.ref, first.turn} & other.nodes:
        return f"the reference node of one set is in the other: this one and that of {line}"
    return ""
