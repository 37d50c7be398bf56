"""Clamps, loads and temperatures of the bodies of a deck, and the histories that they follow."""

from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Sequence
from functools import cached_property
from typing import Any

import numpy as np

from ddmpi.decks.cards import EXACT, Acting, Card, Course, End, Entries, axes, number, vector
from ddmpi.decks.material import Matter, table
from ddmpi.decks.pieces import Cut, Piece, Side, formula, linear

KEEPS = 1e-9
"""Factors of one history are equal to this difference."""

NO_WAY = "a direction of *TRANSFORM at a node on its axis, where it has none"

History = str | None
"""The name of a history, if there is one."""

Key = tuple[float, History]
"""The value of a load, and its history."""

Way = int | tuple[Any, ...]
"""An axis, or a direction by numbers or formulas."""

Supported = dict[Way, dict[tuple[bool, History], dict[int, float]]]
"""Values by place: by axis or direction, then whether they are moved and by which history."""


class Acts:
    """What acts on the bodies, as entries of a scene.

    Parameters
    ----------
    timed : whether there are load steps; else the values at the end count
    """

    def __init__(self, matter: Matter, pieces: Sequence[Piece], cuts: Sequence[Cut]) -> None:
        model = matter.model
        self.model = model
        self.notes = model.notes
        self.matter = matter
        self.kinds = model.kinds
        self.pieces = pieces
        self.cuts = cuts
        self.axisymmetric = matter.family == "CAX"
        self.axes = "xyz" if matter.family == "C3D" else "xy"
        self.histories: dict[Course, str] = {}
        self.rigid_nodes = model.rigid_nodes
        self.ways = list[np.ndarray]()  # directions of supports by equations
        self.timed = self._is_timed()
        self.sets = {
            name: np.fromiter(model.deck.members("NSET", ("", key)), np.int64)
            for (kind, key), name in model.deck.names.items()
            if kind == "NSET"
        }
        self.where = {end: (piece, k) for piece in pieces for end, k in piece.at.items()}
        self.home = {node: piece for piece in pieces for node in piece.nodes.tolist()}
        # of the two bodies at the section of a bolt the one without its surface has the forces there, as in CalculiX
        for _, ends, section, around in cuts:
            layer = [piece for piece, _ in self.on(ends)]
            nodes = [*section.tolist(), *around.tolist()]
            for piece in pieces:
                if piece not in layer:
                    self.home |= dict.fromkeys(piece.place.keys() & nodes, piece)

    def _is_timed(self) -> bool:
        """Whether there are load steps. In one step without, note what has another course than a ramp from zero."""
        every = [acting for kind in self.kinds.values() for acting in kind.values()]
        odd = [acting.card for acting in every if not _is_ramp(acting.course)]
        several = len(self.model.ends) > 1 and not self.model.final
        if several or self.model.rubbing or (odd and self.model.friction):
            for card in self.model.jumps:
                self.notes.changed(card, "it jumps, over a thousandth of the step")
            return True
        for card in odd * (not self.model.final):
            self.notes.changed(card, "its amplitude counts at the end of the step")
        return False

    def factor(self, acting: Acting) -> Key:
        """The largest value of a load or support, or that at the end if there is one step, and its history."""
        if not self.timed:
            return acting.course[-1][1], None
        peak, course = _scaled(acting.course)
        return peak, self.histories.setdefault(
            course, f"h{len(self.histories) + 1}"
        ) if peak else None

    def on(self, ends: Iterable[End]) -> list[Side]:
        """The facets (k,) of faces (element, number), by body."""
        found = defaultdict[str, list[int]](list)
        for piece, facet in (self.where[end] for end in ends if end in self.where):
            found[piece.name].append(facet)
        return [
            (piece, np.unique(found[piece.name])) for piece in self.pieces if piece.name in found
        ]

    def at(self, nodes: Iterable[int]) -> list[tuple[Piece, np.ndarray, bool]]:
        """The bodies that have some of these nodes, with the facets (k,) whose corners are among them, and whether
        these facets have all of the nodes."""
        marked = [(piece, piece.within(nodes)) for piece in self.pieces]
        facets = [(piece, piece.whole(some), some) for piece, some in marked if some.any()]
        return [
            (piece, whole, not np.setdiff1d(np.flatnonzero(some), piece.facets[whole]).size)
            for piece, whole, some in facets
        ]

    def _named(self, piece: Piece, places: np.ndarray, name: str) -> str:
        """The set of the nodes at these places, called as in the deck if there is such a set."""
        nodes = piece.nodes[places]
        named = (
            other
            for other, members in self.sets.items()
            if len(members) >= len(nodes)
            and np.array_equal(np.intersect1d(members, piece.nodes), nodes)
        )
        return piece.node_set(places, next(named, name))

    def way(self, node: int, component: int) -> np.ndarray:
        """(3,) the direction of a component of displacements or forces at a node; from 7 on one of `ways`."""
        turned = self.model.transforms.get(node)
        home = self.home.get(node)
        at = home.points[home.place[node]] if home else self.model.deck.points[node]
        own = np.eye(3) if turned is None else axes(turned, at)
        return [*own, *[own[0]] * 3, *self.ways][component - 1]

    def clamps(self, piece: Piece) -> list[Entries]:
        """The supports of a body: by direction sets of nodes with one value, or a linear function of place."""
        at: Supported = defaultdict(lambda: defaultdict(dict))
        zero = Counter(
            node
            for (node, component), acting in self.kinds["supports"].items()
            if component <= len(self.axes) and not acting.moves
        )
        corners = []
        for (node, component), acting in self.kinds["supports"].items():
            if node not in piece.place or node in self.rigid_nodes:
                continue
            place = piece.place[node]
            value, history = self.factor(acting)
            fixed = zero[node] >= len(self.axes)
            way, sign = self._direction(node, component)
            if fixed and component <= len(self.axes):  # directions do not matter
                at[component - 1][False, None][place] = 0.0
                corners.append((way, place))
            elif way is not None:
                at[way][bool(value), history][place] = value * sign
            elif words := self._no_direction(node, component, value):
                self.notes.lost(acting.card, words)
        for way, place in corners:  # that faces of those beside are held as a whole
            if way in at:
                at[way][False, None][place] = 0.0
        return self._together(piece, at)

    def _direction(self, node: int, component: int) -> tuple[Way | None, float]:
        """An axis, with the sense of a component along it, or a direction, which may turn with the place; None where it
        is not in the plane."""
        way = self.way(node, component)[: len(self.axes)]
        if np.linalg.norm(way) < 1.0 - EXACT:
            return None, 1.0
        if node in self.model.transforms and (turning := self._turning(node, component)):
            return turning, 1.0
        if (main := _axis(way)) is not None:
            return main, float(np.sign(way[main]))
        return (*way.tolist(),), 1.0

    def _no_direction(self, node: int, component: int, value: float) -> str:
        """What is lost of a support that has no direction in the plane; empty if nothing is."""
        way = self.way(node, component)
        if not way.any():
            return NO_WAY
        if np.abs(way[: len(self.axes)]).max() > EXACT:
            return "a support aslant to the plane"
        return "a displacement out of the plane" if value else ""

    def _turning(self, node: int, component: int) -> tuple[Any, ...]:
        """The formulas of the direction of a component that turns with the place, about an axis; none of others."""
        card = self.model.transforms[node]
        d = len(self.axes)
        if card.says("TYPE", "R")[:1] != "C" or component > 2:
            return ()
        # (I - t tT) (x - a) or t x (x - a), of the axis t through a
        on = vector(card.values(), 6)[:3]
        along = axes(card, (0.0, 0.0, 0.0))[2]
        across = np.eye(3) - np.outer(along, along)
        turn = (across if component == 1 else np.cross(along, np.eye(3)).T)[:d]
        turn[np.abs(turn) < KEEPS] = 0.0
        offsets = (0.0 - turn @ on).tolist()
        return tuple(formula(*part, self.axes) for part in zip(offsets, turn[:, :d], strict=True))

    def _together(self, piece: Piece, at: Supported) -> list[Entries]:
        """Clamps of values by direction, history and place; along axes those of the same nodes are one."""
        together: dict[tuple[bytes, History, Any], tuple[np.ndarray, Entries]] = {}
        for way in sorted(at, key=lambda way: (isinstance(way, tuple), str(way))):
            for (_, history), held in at[way].items():
                places = np.array(sorted(held))
                values = np.array([held[k] for k in sorted(held)])
                for alike, value in _alike(piece, places, values):
                    entry = (
                        {"along": list(way), "value": value}
                        if isinstance(way, tuple)
                        else {self.axes[way]: value}
                    )
                    for some in piece.parted(alike):
                        key = some.tobytes(), history, isinstance(way, int) or way
                        together.setdefault(key, (some, {}))[1].update(entry)
        return [
            {"on": self._named(piece, some, "fixed")} | entry | later(history)
            for (_, history, _), (some, entry) in together.items()
        ]

    def loads(self) -> dict[str, list[Entries]]:
        """The tractions of all bodies by name: pressures on faces, and forces at nodes spread over faces."""
        found = defaultdict[str, list[Entries]](list)
        for (piece, value, history, way), facets in self._pressed().items():
            load = (
                {"value": [value * x for x in way[: len(self.axes)]]}
                if way
                else {"pressure": value}
            )
            faces = frozenset(map(tuple, piece.owners[facets].tolist()))
            on = piece.group(np.array(facets), self._surfaces.get(faces, "pressed"))
            found[piece.name].append({"on": on} | load | later(history))
        for piece in self.pieces:
            found[piece.name] += self._forces(piece)
        self._tell_nowhere()
        return found

    def _pressed(self) -> dict[tuple[Piece, float, History, tuple], list[int]]:
        """The facets under each pressure, or traction along its direction, by body, value, history and direction."""
        pressed = defaultdict[tuple, list[int]](list)
        for (element, face, way), acting in self.kinds["pressures"].items():
            if len(way) == 1:  # of a fluid at a node
                at = way[0], 2
                if at not in self.kinds["supports"]:
                    self.notes.lost(acting.card, f"a pressure that is not given at node {way[0]}")
                    continue
                acting = self.kinds["supports"][at]
                way = ()
            if (element, face) not in self.where:
                if acting.moves:
                    words = "a pressure on a face that is not on a boundary"
                    words += "; those on the axis are not" * self.axisymmetric
                    self.notes.lost(acting.card, words)
                continue
            piece, facet = self.where[element, face]
            value, history = self.factor(acting)
            if value:
                self._flat(acting.card, np.array(way or (0.0, 0.0, 0.0)))
                pressed[piece, value, history, way].append(facet)
        return pressed

    def _tell_nowhere(self) -> None:
        """Note forces and supports at nodes of no body."""
        model = self.model
        fluid = {way[0] for *_, way in self.kinds["pressures"] if len(way) == 1}
        inside = fluid | self.home.keys() | model.bolt_nodes | self.rigid_nodes
        for (node, _), acting in self.kinds["forces"].items():
            if node not in inside and acting.moves:
                self.notes.lost(acting.card, "a force at a node of no body")
        for (node, _), acting in self.kinds["supports"].items():
            if node not in inside:
                self.notes.changed(acting.card, "a support at a node of no body is left out")

    def _flat(self, card: Card, vector: np.ndarray) -> np.ndarray:
        """A vector (3,) along the axes of the scene (d,); what points out of the plane is lost."""
        if len(self.axes) == 2 and abs(vector[2]) > EXACT * np.abs(vector).max():
            self.notes.lost(card, "a load out of the plane")
        return vector[: len(self.axes)]

    @cached_property
    def _surfaces(self) -> dict[frozenset[End], str]:
        """Names of the deck's surfaces by their elements and faces; of equal ones the first."""
        deck = self.model.deck
        return {
            frozenset(
                (element, int(where[1]))
                for what, where in deck.sets[kind][key]
                if where[1:].isdigit()
                for element in deck.members("ELSET", what)
            ): name
            for (kind, key), name in reversed(deck.names.items())
            if kind == "SURFACE"
        }

    def _forces(self, piece: Piece) -> list[Entries]:
        """Nodal forces as tractions with the same resultant and the same first moments; the parts of them that supports
        take are on whole facets beside others alone."""
        # by node its force, and the part of it that no support takes, (2, d)
        by_history: dict[History, dict[int, np.ndarray]] = defaultdict(dict)
        cards: dict[int, Card] = {}
        for (node, component), acting in self.kinds["forces"].items():
            if self.home.get(node) is not piece or node in self.rigid_nodes:
                continue
            value, history = self.factor(acting)
            if value:
                k = piece.place[node]
                way = self._flat(acting.card, self.way(node, component))
                if not self.way(node, component).any():
                    self.notes.lost(acting.card, NO_WAY)
                free = (node, component) not in self.kinds["supports"]
                force = value * way / self.matter.depth
                before = by_history[history].get(k, 0.0)
                by_history[history][k] = before + np.array([force, force * free])
                cards[k] = acting.card
        found = []
        for history, forces in by_history.items():
            for facets, nodes, some in self._patches(piece, forces, cards):
                self.notes.changed(
                    cards[int(nodes[0])],
                    "forces at nodes are spread over "
                    "the faces around them, with the same resultant and moments",
                )
                on = piece.group(facets, "loaded")
                found += [
                    {"on": piece.again(on) if k else on} | load | later(history)
                    for k, load in enumerate(self._spread(piece, facets, piece.points[nodes], some))
                ]
        return found

    def _patches(
        self, piece: Piece, forces: dict[int, np.ndarray], cards: dict[int, Card]
    ) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Facets that carry the forces (2, d) of nodes, as of `_forces`, these nodes (k,), and what they carry (k, d)."""
        held = {k for k, (_, free) in forces.items() if not free.any()}
        taken = {k for k, (force, free) in forces.items() if (force != free).any()}
        patches, lost = piece.patches(np.array(sorted(forces)), sorted(held))
        for k in lost.tolist():
            self.notes.lost(cards[k], "a force at a node that is not on the boundary")
        for facets, nodes, whole in patches:
            if not held.issuperset(nodes.tolist()):
                taken -= {*nodes.tolist()} if whole else set()
                yield (
                    facets,
                    nodes,
                    np.array([forces[k][0 if whole else 1] for k in nodes.tolist()]),
                )
        for k in taken:
            words = "forces at nodes along displacements that are given change nothing"
            self.notes.changed(cards[k], words)

    def _spread(
        self, piece: Piece, facets: np.ndarray, at: np.ndarray, forces: np.ndarray
    ) -> list[Entries]:
        """The traction t(x) = F / A + S (x − c) with ∫t = Σ F_n and ∫ t ⊗ (x − c) = Σ F_n ⊗ (x_n − c); the second as
        far as the facets reach. S J = that moment, with J = ∫ (x − c) ⊗ (x − c)."""
        x, w = piece.quadrature(facets, self.axisymmetric)
        centre = w @ x / w.sum()
        J = ((x - centre).T * w) @ (x - centre)
        moments = forces.T @ (at - centre)
        total = forces.sum(axis=0)
        size = np.abs(forces).sum() * np.ptp(x, axis=0).max()
        loads: list[Entries] = []
        if np.abs(total).max() > EXACT * np.abs(forces).sum():
            loads.append({"force": [float(value) for value in total]})
        if np.abs(moments).max() > EXACT * size:
            slopes = moments @ np.linalg.pinv(J, rcond=EXACT, hermitian=True)
            if (
                np.abs(slopes).max() * w.sum() * np.ptp(x, axis=0).max()
                > EXACT * np.abs(forces).sum()
            ):
                slopes[np.abs(slopes) < KEEPS * np.abs(slopes).max()] = 0.0
                loads.append(
                    {"value": [formula(float(-row @ centre), row, self.axes) for row in slopes]}
                )
        return loads

    def volume_forces(self, piece: Piece) -> list[Any] | Entries | None:
        """Gravity, centrifugal and other forces per volume of a body, as formulas; all must have one history."""
        # by history: the first keyword, and c and the rows of Sᵀ (1 + d, d) of f = c + S x
        fields: dict[History, tuple[Card, np.ndarray]] = {}
        own = set(piece.elements.tolist())
        d = len(self.axes)
        for (what, scope, label, field), acting in self.kinds["body_forces"].items():
            value, history = self.factor(acting)
            card = acting.card
            some = own.intersection(
                self.model.deck.chosen(card._replace(scope=scope), "ELSET", what)
            )
            if not some or not value:
                continue
            if some != own:
                self.notes.lost(card, f"{label} on a part of a body")
                continue
            field = self._density(piece, label, card) * value * np.reshape(field, (4, 3))
            off = np.abs(field[[0, 2]]).max() > EXACT * np.abs(field).max()
            if label == "CENTRIF" and self.axisymmetric and off:
                self.notes.lost(card, "a rotation about another axis than that of the body")
            flat = np.array([self._flat(card, row) for row in field[: 1 + d]])
            first, before = fields.get(history, (card, 0.0))
            fields[history] = first, before + flat
        if not fields:
            return None
        history, *others = fields
        for other in others:
            self.notes.lost_between_steps(
                fields[other][0], "volume forces that change in different ways"
            )
        constant, *slopes = fields[history][1]
        force = [formula(float(constant[k]), np.array(slopes)[:, k], self.axes) for k in range(d)]
        return {"value": force, "history": history} if history else force

    def _density(self, piece: Piece, label: str, card: Card) -> float:
        """What a volume force is multiplied by: the density of the body, or 1 for a force per volume."""
        if label[0] == "B":
            return 1.0
        densities = set[float]()
        for section in self.matter.sections(piece):
            name = self.model.sections[section][1]
            given = self.model.materials.get(name, {}).get("DENSITY")
            if given is None:
                self.notes.lost(card, f"the material {name} has no *DENSITY")
            values, at = table(given, 1) if given else (np.zeros((1, 1)), np.zeros(1))
            if given and len(at) > 1:
                words = f"density at the mean temperature of {piece.name} at the end"
                self.notes.changed(given, words)
            order = np.argsort(at)
            _, heat = self.model.temperatures(piece.nodes.tolist())
            densities.add(float(np.interp(heat.mean(), at[order], values[order, 0])))
        if len(densities) > 1:
            self.notes.lost(card, f"{label} on a body with several densities")
        return densities.pop()

    def heat(self, piece: Piece) -> tuple[Any, dict[str, np.ndarray]]:
        """The temperature of a body over its initial one, and the expansions (3,) of each of its materials by name.

        The thermal strain is α(T) (T − T_z) − α(T_0) (T_0 − T_z), with the reference T_z of α. Where T varies in place,
        the strain over the first α stands for the temperature.
        """
        own = [node for node in piece.nodes.tolist() if node in self.kinds["heat"]]
        if not own:
            return None, {}
        card = self.kinds["heat"][own[0]].card
        T, history = self._warmed(piece, own)
        names = dict.fromkeys(self.model.sections[k][1] for k in self.matter.sections(piece))
        grown = {name: self._grown(name, T) for name in names}
        fields = [field for field, _ in grown.values() if field is not None]
        expansions = {name: alpha for name, (_, alpha) in grown.items()}
        grows = any(alpha.any() for alpha in expansions.values())
        words = f"no thermal strain of {piece.name}: its material has no *EXPANSION"
        for given, nodes in self.model.heated:
            if not nodes.isdisjoint(own):
                note = self.notes.taken if grows else self.notes.changed
                note(given, "temperature" if grows else words)
        if not grows:
            return None, {}
        if np.ptp(fields, axis=0).max() > KEEPS * np.abs(fields[0]).max():
            self.notes.lost(card, "expansions of several materials that vary with the temperature")
        text = self._field(piece, fields[0], card)
        return (text if not history else {"value": text, "history": history}), expansions

    def _warmed(self, piece: Piece, own: Sequence[int]) -> tuple[np.ndarray, History]:
        """(2, n) temperatures of a body at first and at the end, of which its `own` nodes change, and their history."""
        start, _ = self.model.temperatures(piece.nodes.tolist())
        end = start.copy()
        histories = set[History]()
        for node in own:
            k = piece.place[node]
            rise, history = self.factor(self.kinds["heat"][node])
            end[k] = start[k] + rise
            if rise:
                histories.add(history)
        if len(histories) > 1:
            self.notes.lost_between_steps(
                self.kinds["heat"][own[0]].card,
                "temperatures that change in different ways in one body",
            )
        return np.array([start, end]), next(iter(histories), None)

    def _grown(self, name: str, T: np.ndarray) -> tuple[np.ndarray | None, np.ndarray]:
        """The thermal strain (n,) of a material over its expansions, and these (3,) by its axes; T (2, n) as of
        `_warmed`."""
        expansion = self.model.materials.get(name, {}).get("EXPANSION")
        if expansion is None:
            return None, np.zeros(3)
        width = {"ISO": 1, "ORT": 3}.get(expansion.says("TYPE", "ISO")[:3], 6)
        values, at = table(expansion, width)
        if values[:, 3:].any():
            self.notes.lost(expansion, "shear by heat")
        # the strain along all axes is that along one, times numbers that no temperature changes
        direct = values[:, :3]
        row, most = np.unravel_index(np.abs(direct).argmax(), direct.shape)
        largest = float(direct[row, most])
        along = direct[row] / largest * np.ones(3) if largest else np.ones(3)
        apart = np.abs(direct - direct[:, [most]] * along[:width]).max()
        if apart > KEEPS * abs(largest):
            self.notes.lost(
                expansion,
                "expansions by direction that change with the temperature in different ways",
            )
        if len(values) > 1:
            self.notes.changed(
                expansion,
                "the thermal strain of the table is folded into the expansion and the temperature",
            )
        zero = number(expansion.given.get("ZERO") or "0")
        order = np.argsort(at)
        grown = np.diff(np.interp(T, at[order], direct[order, most]) * (T - zero), axis=0)[0]
        alpha = float(direct[0, most]) or 1.0
        start, end = T[:, 0]
        if not np.ptp(T, axis=1).any() and end != start:
            alpha = float(grown[0] / (end - start))
        return (grown / alpha if alpha else grown), alpha * along

    def _field(self, piece: Piece, values: np.ndarray, card: Card) -> Any:
        """A temperature by nodes as a number or a formula: linear in place, or between layers of nodes."""
        found = linear(piece.points, values, self.axes)
        if found is not None:
            return found
        size = np.abs(values).max()
        for x, axis in zip(piece.points.T, self.axes, strict=True):
            layers, number = np.unique(np.round(x, 9), return_inverse=True)
            means = np.bincount(number, values) / np.bincount(number)
            if len(layers) < 30 and np.abs(values - means[number]).max() < EXACT * size:
                turns = np.diff(np.diff(means) / np.diff(layers), prepend=0.0)
                text = repr(float(means[0])) + "".join(
                    f" + ({turn!r}) * max(0, {axis} - ({layer!r}))"
                    for turn, layer in zip(turns.tolist(), layers.tolist(), strict=False)
                    if abs(turn) * np.ptp(layers) > KEEPS * size
                )
                if len(text) <= 1000:
                    self.notes.changed(card, "temperatures are linear between layers of nodes")
                    return text
        self.notes.lost(card, "temperatures that are no linear function of place")
        return 0.0


def _alike(piece: Piece, places: np.ndarray, values: np.ndarray) -> list[tuple[np.ndarray, Any]]:
    """Nodes with one value; all of them if the values are a linear function of place."""
    different = np.unique(values)
    if len(different) > 1 and len(places) > piece.points.shape[1] + 1:
        found = linear(piece.points[places], values, "xyz"[: piece.points.shape[1]])
        if found is not None:
            return [(places, found)]
    return [(places[values == value], float(value)) for value in different]


def _axis(way: np.ndarray) -> int | None:
    """The axis along which a direction is, in either sense; None where it is along none."""
    main = int(np.abs(way).argmax())
    return main if abs(abs(way[main]) - 1.0) < EXACT else None


def later(history: History) -> Entries:
    """The entry of a history, if there is one."""
    return {"history": history} if history else {}


def _is_ramp(course: Course) -> bool:
    """Whether a course is a straight line from zero."""
    points = _scaled(course)[1]
    return len(points) <= 2 and not points[0][1]


def _scaled(course: Course) -> tuple[float, Course]:
    """The largest value of a course, and the course over it, without points on the lines between their neighbours."""
    peak = max((value for _, value in course), key=abs)
    points = [(time, round(value / (peak or 1.0), 12) + 0.0) for time, value in course]
    return peak, tuple(
        point
        for k, point in enumerate(points)
        if k in (0, len(points) - 1) or not _between(*points[k - 1 : k + 2])
    )


def _between(
    before: tuple[float, float], point: tuple[float, float], after: tuple[float, float]
) -> bool:
    """Whether a point is on the line between its neighbours."""
    share = (point[0] - before[0]) / (after[0] - before[0]) if after[0] > before[0] else 0.0
    return abs(before[1] + share * (after[1] - before[1]) - point[1]) <= KEEPS
