"""What a deck says beside its mesh: materials, contacts, and loads and supports over the time of its steps."""

import re
from collections import defaultdict, deque
from collections.abc import Callable, Iterable, Sequence
from itertools import chain, product
from typing import Any

import numpy as np

from ddmpi.decks.cards import (
    BEFORE_STEPS,
    EVERY,
    EXACT,
    OF_STEPS,
    PARAMETERS,
    PERTURBATIONS,
    REFUSED,
    SILENT,
    SUDDEN,
    WITHOUT_EFFECT,
    Acting,
    Card,
    DeckError,
    End,
    Notes,
    Rigid,
    along,
    called,
    component,
    entry,
    factors,
    held,
    integer,
    number,
    numbers,
    vector,
)
from ddmpi.decks.deck import STRIDE, Deck, nodes_of_faces
from ddmpi.errors import InputError

TAKEN = {
    "ELASTIC": "elastic constants",
    "EXPANSION": "thermal expansion",
    "DENSITY": "density",
    "FRICTION": "coefficient of friction",
    "SOLIDSECTION": "material of elements",
    "CHANGESOLIDSECTION": "material of elements",
    "CLOAD": "forces",
    "INITIALCONDITIONS": "initial temperature",
}
"""Keywords that are in a scene unless they are lost, and as what."""


class Model:
    """Materials, contacts, loads and supports of a deck. Raises InputError, with the line, for what cannot be read.

    Parameters
    ----------
    changing : what cannot change from step to step as it does in a scene

    Attributes
    ----------
    materials : by name (capitals): keyword → its rows and parameters
    sections : elements, material, thickness, orientation, of each section
    pairs : keyword, slave and master of surfaces in contact or tied
    rubbing : coefficients of friction that change, by interaction and number of the step
    interactions : keywords by name; clearances : of contacts by their surfaces; wheels : cyclic symmetry by the name of
        its tie, empty where it is that of the only one
    supports, forces : by node and component
    pressures : by element and face: pressure, or with the components of TRVEC a traction
    body_forces : by set, instance, kind, and the constant and slopes (12,) of the force over its value
    heat : by node the temperatures over the initial ones
    heated : *TEMPERATURE and its nodes, of each data line
    start : initial temperatures by node
    equations : by the node and component of their first term: keyword, and node, component and coefficient of all terms
    ends : times of the ends of the steps
    jumps : keywords of loads and supports that jump
    final : whether the model changes between the steps, so that only the state at the end is computed
    """

    def __init__(
        self,
        deck: Deck,
        notes: Notes,
        amplitudes: Iterable[str] = (),
        changing: Iterable[tuple[Card, str]] = (),
    ) -> None:
        self.deck = deck
        self.notes = notes
        self.materials: dict[str, dict[str, Card]] = {}
        self.sections: list[tuple[set[int], str, float, str, Card]] = []
        self.pairs: list[tuple[Card, str, str]] = []
        self.interactions: dict[str, dict[str, Card]] = {}
        self.clearances: dict[frozenset[str], Card] = {}
        self.wheels: dict[str, Card] = {}
        self.rubbing: dict[str, dict[int, float]] = {}
        self.kinds: dict[str, dict[Any, Acting]] = {
            kind: {} for kind in ("supports", "forces", "pressures", "body_forces", "heat")
        }
        self.heated: list[tuple[Card, set[int]]] = []
        self.start: dict[int, float] = {}
        self.ends: list[float] = []
        self.jumps: list[Card] = []
        self.changing = [*changing]  # what differs from step to step, and is no load
        self._named = self._by_name("AMPLITUDE")
        for text in amplitudes:  # NAME=time,factor,…
            name, _, values = text.partition("=")
            if called(name) not in self._named:
                raise InputError(f"--amplitude {text}: it has no *AMPLITUDE {name}")
            card = self._named[called(name)]
            self._named[called(name)] = card._replace(given={}, rows=[values.split(",")])
            notes.changed(card, "its times and factors are those of --amplitude")
        self.orientations = {
            name: self._standing(card) for name, card in self._by_name("ORIENTATION").items()
        }
        self.transforms: dict[int, Card] = {}
        self._turn_nodes()
        self.large = False  # whether a step has NLGEOM
        self.left_out = set[int]()  # places of the cards of steps that leave the state as it is
        self.rigid: list[Rigid] = []
        self.equations: dict[tuple[int, int], tuple[Card, list[tuple[int, int, float]]]] = {}
        self.bolts = [
            self._standing(card) for card in deck.outside if card.word == "PRE-TENSIONSECTION"
        ]
        self.bolt_nodes = {
            node for card in self.bolts for node in self._nodes(card, card.given.get("NODE", ""))
        }
        self.locked: dict[int, float] = {}  # bolts whose offset is kept from this time on
        self._refs = {
            node
            for card in deck.outside
            for key in ("REFNODE", "ROTNODE")
            if key in card.given
            for node in self._nodes(card, card.given[key])
        }
        self.rigid_nodes = set[int]()  # reference nodes of rigid sets, and their nodes of rotations
        self._coupling: Rigid | None = None  # a *COUPLING before its second keyword
        # the material or interaction whose keywords follow
        self._within = ""
        self._inside = dict[str, Card]()
        self._fresh: dict[str, dict[Any, tuple[Card, float]]] = {kind: {} for kind in self.kinds}
        self._renewed: set[str] = set()
        self._since = 0  # place of the first card of this step
        self._at_once = False  # whether loads without an amplitude jump at its beginning
        self._changed = ""  # the interaction of which a step changes something
        self._opened: dict[str, Card] = {}  # the first card of each kind in a step
        self._read()

    def _by_name(self, word: str) -> dict[str, Card]:
        """The cards of a keyword by their names, which within an instance begin with it. Raises InputError."""
        found: dict[str, Card] = {}
        for card in self.deck.cards:
            if card.word == word:
                scope = f"{called(card.scope)}." if card.scope and word == "ORIENTATION" else ""
                with card.reading():
                    name = card.given["NAME"]
                    other = found.setdefault(scope + called(name), card)
                    if other.place != card.place:
                        raise DeckError(
                            f"there is one of the name {name} on line {other.line} already"
                        )
        return found

    def _standing(self, card: Card) -> Card:
        with card.reading():
            return self.deck.stands(card)

    def _turn_nodes(self) -> None:
        """Note the directions of *TRANSFORM for its nodes. Raises InputError where nodes have others already."""

        def way(card: Card) -> tuple[Any, str]:
            return card.rows, card.says("TYPE", "R")[:1]

        for card in self.deck.outside:
            if card.word == "TRANSFORM":
                standing = self._standing(card)
                for node in self._nodes(card, card.given.get("NSET", "")):
                    other = self.transforms.setdefault(node, standing)
                    if way(other) != way(standing):
                        words = f"the node {node % STRIDE} has another *TRANSFORM on line"
                        raise card.error(f"{words} {other.line}")

    @property
    def friction(self) -> bool:
        """Whether any contact has friction."""
        return bool(self.rubbing) or any("FRICTION" in law for law in self.interactions.values())

    def temperatures(self, nodes: Sequence[int]) -> tuple[np.ndarray, np.ndarray]:
        """(n,) the temperatures of nodes at first and at the end."""
        first = [self.start.get(node, 0.0) for node in nodes]
        heat = self.kinds["heat"]
        return np.array(first), np.array(
            [
                before + heat[node].course[-1][1] if node in heat else before
                for node, before in zip(nodes, first, strict=True)
            ]
        )

    def _nodes(self, card: Card, what: str) -> set[int]:
        """The nodes of a set, or of a number, that a keyword names. Raises InputError."""
        with card.reading():
            return set(self.deck.chosen(card, "NSET", what))

    def node(self, card: Card, what: str) -> int:
        """The only node of a set, or the one with this number."""
        nodes = self._nodes(card, what)
        if len(nodes) != 1:
            raise card.error(f"{what} has {len(nodes)} nodes; one is needed")
        return nodes.pop()

    def _read(self) -> None:
        for card in self.deck.outside:
            if card.word == "MPC":  # before the loads on its nodes of rotations
                with card.reading():
                    self._constrain(card)
        steps = [(step, self._way(step)) for step in self._steps()]
        static = [k for k, (_, way) in enumerate(steps) if way.word == "STATIC"]
        if not static:
            what = " (is it cut off?)"
            if steps:
                step, way = steps[0]
                what = f"; its first step, on line {step[0].line}, is *{way.name}"
            raise InputError(f"it has no *STATIC step{what}; ddmpi computes static equilibrium")
        for k, (step, way) in enumerate(steps):
            if way.word == "STATIC":
                with way.reading():
                    self._follow(step, way)
            elif k > static[-1] and any(card.word in PERTURBATIONS for card in step):
                words = "this step is left out, as are its loads and supports; the scene is that "
                self.notes.changed(way, words + "of the *STATIC steps before")
                self.left_out |= {card.place for card in step}
            else:
                self.notes.lost(way, "only *STATIC steps are computed")
        self.rigid_nodes = {node for rigid in self.rigid for node in (rigid.ref, rigid.turn)}
        self._tell_changes()

    def _way(self, step: list[Card]) -> Card:
        """The keyword of what a step computes: its first one that static steps do not have, if it is not static. Raises
        InputError for two different ones."""
        odd = [card for card in step if not self._known(card.word)]
        way = [*(card for card in step if card.word == "STATIC"), *odd, step[0]][0]
        others = [card.line for card in step if card.word == way.word and card.rows != way.rows]
        if others:
            raise way.error(f"line {others[0]} gives the same step other times")
        return way

    def _steps(self) -> list[list[Card]]:
        """The keywords of each step; those outside of steps are taken. Raises InputError."""
        steps: list[list[Card]] = []
        inside = None
        early = list[Card]()
        for card in self.deck.cards:
            if card.word == "STEP":
                if inside is not None:
                    raise inside.error("the step does not end before the next one begins")
                inside = card
                steps.append([])
            if inside is not None:
                steps[-1].append(card)
            elif card.word == "ENDSTEP":
                raise card.error("no *STEP begins before it")
            else:
                if card.word in OF_STEPS:
                    early.append(card)
                self._take(card)
            inside = None if card.word == "ENDSTEP" else inside
        if inside is not None:
            raise inside.error("the step that begins here does not end; is the deck cut off?")
        for card in early:
            if steps and card.place < steps[-1][0].place:
                self.notes.changed(
                    card,
                    "it stands in no *STEP, and counts from the beginning of the next one",
                )
            else:
                self.notes.lost(card, "it stands after the last *STEP")
        return steps

    def _tell_changes(self) -> None:
        """Note what changes from step to step. Elastic bodies without friction forget the way to a state, unless the
        offset of a bolt is kept."""
        forgets = not self.locked and not self.friction
        self.final = forgets and bool(self.changing)
        words = ": only the state at the end of the last step is computed"
        for card, what in self.changing:
            if forgets:
                self.notes.changed(card, what + words)
            else:
                self.notes.lost_between_steps(card, what)

    def _follow(self, cards: list[Card], way: Card) -> None:
        """Take the cards of a step, and follow all loads and supports to its end."""
        begin = self.ends[-1] if self.ends else 0.0
        end = begin + ([*way.values(), 0.0, 0.0][1] or 1.0)
        if end <= begin:
            raise DeckError("the time of a step is not positive")
        if cards[0].says("NLGEOM", "NO") != "NO":
            self.large = True
            self.notes.changed(
                cards[0], "warning: NLGEOM: displacements and strains are small here"
            )
        self._at_once = cards[0].says("AMPLITUDE") == "STEP"
        self._renewed = set()
        self._opened = {}
        self._since = cards[0].place
        for card in cards:
            if card.word in BEFORE_STEPS:
                self.notes.lost(card, "it stands in a *STEP, and not before the first one")
            self._take(card)
        for kind, acting in self.kinds.items():
            fresh = self._fresh[kind]
            self._fresh[kind] = {}
            for key in dict.fromkeys([*acting, *fresh]):
                nothing = Acting(way, ((0.0, 0.0), (begin, 0.0))[: 1 + bool(begin)])
                if kind == "supports" and self.ends and key not in acting:
                    words = "a support that begins in a later step"
                    self.changing.append((fresh[key][0], words))
                old = acting.get(key, nothing)
                first = self.start.get(key, 0.0) if kind == "heat" else 0.0
                if (new := self._followed(kind, old, fresh.get(key), begin, end, first)) is None:
                    del acting[key]
                else:
                    acting[key] = new
        self.ends.append(end)

    def _followed(
        self,
        kind: str,
        old: Acting,
        fresh: tuple[Card, float] | None,
        begin: float,
        end: float,
        first: float,
    ) -> Acting | None:
        """A load or support to the end of a step, which gives it a `fresh` value or none, as what is over the `first`
        one of a temperature; None for a support that ends with OP=NEW."""
        card, value = fresh or (old.card, old.value)
        on: Sequence[tuple[float, float]] = ()
        if fresh or (kind not in self._renewed and self._goes_on(card)):
            given = self._course(card, value, begin, end)
            on = [(time, one - first) for time, one in given]
        elif kind in self._renewed and kind == "supports":
            self.changing.append((card, "a support that ends before a later step"))
            return None
        elif kind in self._renewed:
            value = 0.0
            on = self._course(card._replace(given={}), value, begin, end)
        before = old.course[-1][1]
        then = self._jumped(card, before, on) if on else [(end, before)]  # or it stays
        return Acting(card, (*old.course, *then), value)

    def _jumped(
        self, card: Card, before: float, on: Sequence[tuple[float, float]]
    ) -> list[tuple[float, float]]:
        """The values of a load in a step after its value `before`, from which it may jump at the beginning."""
        (begin, first), *then = on
        if not then:
            return [*on]
        if abs(first - before) <= EXACT * max(abs(value) for _, value in on):
            return then
        self.jumps.append(card)
        soon = min(begin + SUDDEN * (then[-1][0] - begin), 0.5 * (begin + then[0][0]))
        return [(soon, first), *then]

    def _goes_on(self, card: Card) -> bool:
        """Whether a load follows an amplitude of the total time, in later steps too."""
        amplitude = self._named.get(card.name_of("AMPLITUDE"))
        return amplitude is not None and "TOTAL" in amplitude.says("TIME")

    def _course(
        self, card: Card, value: float, begin: float, end: float
    ) -> list[tuple[float, float]]:
        """The values of a load of a step: that at the end of a ramp, or all of an amplitude from the beginning on."""
        name = card.says("AMPLITUDE")
        if not name:
            if "TIMEDELAY" in card.given:
                self.notes.lost(card, "TIME DELAY without an AMPLITUDE")
            return [(begin, value)] * self._at_once + [(end, value)]
        if called(name) not in self._named:
            raise card.error(f"there is no *AMPLITUDE {name}")
        given = self._named[called(name)]
        way = given.says("DEFINITION", "TABULAR")
        form = given.says("VALUE")
        if way != "TABULAR" or "USER" in given.given or form == "ABSOLUTE":
            self.notes.lost(
                card,
                f"the amplitude {name} is no table of factors; --amplitude {name}=0,0,1,1 "
                "gives times and factors",
            )
            return []
        if number(given.given.get("SMOOTH") or "0"):
            self.notes.changed(given, "SMOOTH is dropped: it is straight between its times")
        table = factors(given)
        times = (
            number(card.given.get("TIMEDELAY", "0"))
            + (0.0 if self._goes_on(card) else begin)
            + table[:, 0]
        )
        for k in np.flatnonzero(np.diff(times) == 0.0).tolist():
            if begin < times[k] <= end:
                self.jumps.append(card)
            last = times[k - 1] if k else -np.inf
            times[k] = max(times[k] - SUDDEN * (end - begin), 0.5 * (last + times[k]))
        inner = np.unique(times[(times > begin) & (times < end)]).tolist()
        return [
            (time, value * float(np.interp(time, times, table[:, 1])))
            for time in (begin, *inner, end)
        ]

    def _take(self, card: Card) -> None:
        """Note what one keyword says. Raises InputError."""
        if self._coupling and card.word not in ("KINEMATIC", "DISTRIBUTING"):
            raise self._coupling.card.error("neither *KINEMATIC nor *DISTRIBUTING follows it")
        if card.word in WITHOUT_EFFECT:
            self.notes.changed(card, f"left out: {WITHOUT_EFFECT[card.word]}")
        elif card.word in REFUSED:
            self.notes.lost(card, f"{REFUSED[card.word]}: not possible")
            self._within = "CHANGED" if card.word.startswith("CHANGE") else self._within
        elif not self._known(card.word):
            self.notes.lost(card, "this keyword is not known")
        elif method := self._method(card.word):
            with card.reading():
                method(card)
            if card.word in TAKEN:
                self.notes.taken(card, TAKEN[card.word])

    def _method(self, word: str) -> Callable[[Card], None] | None:
        """What reads a keyword beyond meshes."""
        return getattr(self, f"_on_{word.lower().replace('-', '_')}", None)

    def _known(self, word: str) -> bool:
        known = (SILENT, PARAMETERS, REFUSED, WITHOUT_EFFECT)
        return self._method(word) is not None or any(word in words for words in known)

    def _on_material(self, card: Card) -> None:
        of = self.materials if card.word == "MATERIAL" else self.interactions
        name = called(card.given["NAME"]).upper()
        self._within = card.word
        self._inside = of.setdefault(name, {card.word: card})
        other = self._inside[card.word]
        if other.place != card.place:
            raise DeckError(
                f"there are two of the name {card.says('NAME')}; the other is on line {other.line}"
            )

    _on_surfaceinteraction = _on_material

    def _keep(self, card: Card, within: str = "MATERIAL") -> None:
        if self._within == "CHANGED":  # in a step; that this changes is lost
            return
        if self._within == "CHANGESURFACEBEHAVIOR":
            other = self._inside.get(card.word, card)
            if other.place >= self._since and (other.rows, other.given) != (card.rows, card.given):
                raise DeckError(
                    f"line {other.line} gives this interaction another law in this step"
                )
            self._inside[card.word] = card
            return
        if self._within != within.replace(" ", ""):
            raise DeckError(f"it does not follow *{within}")
        other = self._inside.setdefault(card.word, card)
        if other.place != card.place and (other.rows, other.given) != (card.rows, card.given):
            raise DeckError(f"there is one of this *{within} on line {other.line} already")

    _on_elastic = _on_expansion = _on_density = _keep

    def _on_surfacebehavior(self, card: Card) -> None:
        self._keep(card, "SURFACE INTERACTION")
        law = card.says("PRESSURE-OVERCLOSURE", "HARD")
        if "NOSEPARATION" in card.given:
            self.notes.lost(card, "contact that never opens")
        elif law == "TIED":
            self.notes.changed(card, "tied contact: bonded, without stiffness")
        elif law in ("LINEAR", "TABULAR"):
            self.notes.taken(card, "a soft joint, without tension")
        elif law != "HARD":
            self.notes.changed(card, f"{law}: hard contact, the stiffness is dropped")

    def _on_friction(self, card: Card) -> None:
        if self._within != "CHANGEFRICTION":
            self._keep(card, "SURFACE INTERACTION")
        if not card.rows or (coefficient := number(entry(card.rows[0], 0, "0"))) < 0.0:
            raise DeckError("it needs a coefficient of friction, which is not negative")
        if len(card.rows) > 1:
            self.notes.lost(card, "friction other than Coulomb's with one coefficient")
        if any(card.values()[1:2]):
            self.notes.changed(card, "the stick slope is dropped: nodes stick without slip")
        if self._within == "CHANGEFRICTION":
            if coefficient != self.rubbing[self._changed].setdefault(len(self.ends), coefficient):
                raise DeckError(
                    "another coefficient of this interaction stands before it in this step"
                )
            self.notes.changed(card, "friction goes to this coefficient over the step")

    def _on_changefriction(self, card: Card) -> None:
        """The keyword after it gives what changes of an interaction, over this step."""
        self._changed = card.name_of("INTERACTION").upper()
        self._within = card.word
        if self._changed not in self.interactions:
            raise DeckError(f"there is no *SURFACE INTERACTION {self._changed}")
        self._inside = self.interactions[self._changed]
        if card.word == "CHANGEFRICTION":
            self.rubbing.setdefault(self._changed, {})
        else:
            self.changing.append((card, "a contact law that changes"))

    _on_changesurfacebehavior = _on_changefriction

    def _on_solidsection(self, card: Card) -> None:
        self.sections.append(
            (
                set(self.deck.chosen(card, "ELSET", card.given["ELSET"])),
                called(card.given["MATERIAL"]).upper(),
                [*card.values(), 0.0][0] or 1.0,
                card.name_of("ORIENTATION"),
                card,
            )
        )

    def _on_changesolidsection(self, card: Card) -> None:
        self._on_solidsection(card)
        self.changing.append((card, "a material that changes"))

    def _on_modelchange(self, card: Card) -> None:
        if card.says("TYPE") != "CONTACT PAIR" or "REMOVE" not in card.given:
            return self.notes.lost(
                card, "parts that are removed or added, or contacts that are added"
            )
        ends = [tuple(map(called, row[:2])) for row in card.rows]
        there = [tuple(map(called, pair[1:])) for pair in self.pairs]
        for end in ends:
            if end not in there:
                self.notes.lost(card, f"there is no *CONTACT PAIR of {' and '.join(end)}")
        self.pairs = [pair for pair, end in zip(self.pairs, there, strict=True) if end not in ends]
        self.changing.append((card, "a contact that is removed"))

    def _on_contactpair(self, card: Card) -> None:
        self.pairs += [(card, row[0], row[1]) for row in card.rows or [[]]]

    _on_tie = _on_contactpair

    def _on_cyclicsymmetrymodel(self, card: Card) -> None:
        if card.name_of("TIE") in self.wheels:
            raise DeckError("a second cyclic symmetry of this tie")
        self.wheels[card.name_of("TIE")] = self._standing(card)

    def _on_clearance(self, card: Card) -> None:
        if "VALUE" not in card.given:
            self.notes.lost(card, "a clearance without one VALUE")
        else:
            pair = frozenset((card.name_of("SLAVE"), card.name_of("MASTER")))
            other = self.clearances.setdefault(pair, card)
            if number(other.given["VALUE"]) != number(card.given["VALUE"]):
                raise DeckError(f"line {other.line} gives another clearance of these surfaces")

    def _renew(self, kind: str, card: Card) -> None:
        """OP=NEW, once a step, removes what acted before."""
        if card.says("OP") == "NEW" and kind not in self._renewed:
            if self._opened.get(kind):
                self.notes.lost(
                    card,
                    f"OP=NEW after line {self._opened[kind].line} of this step, which has not",
                )
            words = {acting.card.word for acting in self.kinds[kind].values()} | {card.word}
            if {"DLOAD", "DSLOAD"} <= words:
                self.notes.lost(
                    card,
                    "OP=NEW beside *DLOAD and *DSLOAD, of which programs remove one or both",
                )
            self._renewed.add(kind)
            if not self.ends:
                self._fresh[kind] = {}
        self._opened.setdefault(kind, card)

    def _add(self, kind: str, key: Any, card: Card, value: float) -> None:
        """A load, which adds to those of the same step at the same place."""
        other, before = self._fresh[kind].get(key, (card, 0.0))
        self._fresh[kind][key] = card, before + value
        if other.place != card.place:
            self.notes.taken(
                card,
                f"added to line {other.line} where places are the same, as in CalculiX",
            )
        if _timing(other) != _timing(card):
            self.notes.lost(card, "a load beside another one of this step with another amplitude")

    def _on_boundary(self, card: Card) -> None:
        self._renew("supports", card)
        fixed = set().union(*(self._nodes(card, row[0]) for row in card.rows))
        if "FIXED" in card.given and fixed <= self.bolt_nodes and self.ends:
            self.locked |= dict.fromkeys(fixed, self.ends[-1])
            return
        if {"SUBMODEL", "USER", "FIXED"} & card.given.keys() or card.says("TYPE", "D")[0] != "D":
            self.notes.lost(
                card, "displacements of another model, a routine, or of the step before"
            )
            return
        for row in card.rows:
            for node in self._nodes(card, row[0]):
                self._hold(card, node, *held(row))
        self.notes.taken(card, "clamps")

    def _hold(self, card: Card, node: int, components: Sequence[int], value: float) -> None:
        """A support of a node; the last one of a step counts."""
        most = 6 if node in self._refs else 3
        for k in (k for k in components if k <= most):
            other, before = self._fresh["supports"].get((node, k), (card, value))
            other_way = before != value or (value and _timing(other) != _timing(card))
            if other_way and other.place >= self._since:
                words = f"line {other.line} gives another displacement of the same nodes"
                self.notes.changed(card, f"{words}; the last one counts, as in CalculiX")
            self._fresh["supports"][node, k] = card, value
        if components[-1] > 6 or (components[-1] > most and value):
            self.notes.lost(card, f"component {components[-1]} of the displacement")
        elif components[0] > most:
            self.notes.changed(
                card, "nodes of solids have no turns: components 4 to 6 have no effect"
            )

    def _on_cload(self, card: Card) -> None:
        self._renew("forces", card)
        for row in card.rows:
            for node in self._once(card, self.deck.chosen(card, "NSET", row[0])):
                k = component(row[1])
                if k > (6 if node in self._refs else 3):
                    if number(entry(row, 2, "0")):
                        self.notes.lost(card, "moments at nodes")
                elif node in self.bolt_nodes and k > 1 and number(row[2]):
                    self.notes.lost(card, "a pre-tension has the component 1 alone")
                else:
                    self._add("forces", (node, k), card, number(row[2]))

    def _on_dload(self, card: Card) -> None:
        surface = card.word == "DSLOAD"
        for kind in ("pressures", "body_forces")[: 2 - surface]:
            self._renew(kind, card)
        before = self._pulled()
        for row in card.rows:
            what = row[0]
            label = row[1].upper()
            values = numbers(row[2:])
            way: tuple[float, ...] = ()
            ends: Iterable[End] = ()
            if surface and label in ("P", "TRVEC"):
                ends = self._once(card, self.deck.ends(card, what))
                words = "pressure on a surface"
                way = (*along(values[1:4]).tolist(),) if label == "TRVEC" else ()
            elif not surface and re.fullmatch(r"P\d(NP)?", label):
                elements = self._once(card, self.deck.chosen(card, "ELSET", what))
                ends = product(elements, [int(label[1])])
                words = "pressure"
                if label[2:]:  # P1NP is that of a fluid at a node, the second component there
                    way = (self.node(card, row[2]),)
                    values = [0.0]
            elif not surface and label in ("GRAV", "CENTRIF", "BX", "BY", "BZ"):
                words = "volume force"
                self._body_force(card, what or EVERY * (label == "GRAV"), label, values)
            else:
                self.notes.lost(card, f"the load {label}")
                continue
            for element, face in ends:
                if len(way) == 3 and before.get((element, face), way) != way:
                    words = "TRVEC in another direction than in the step before; OP=NEW would replace that"
                    self.notes.lost(card, words)
                self._add("pressures", (element, face, way), card, values[0])
            self.notes.taken(card, words)

    def _once(self, card: Card, members: list[Any]) -> list[Any]:
        """Each of the members of a set or surface that a load is on, which may have some of them several times."""
        once = [*dict.fromkeys(members)]
        if len(once) < len(members):
            words = "a set or surface has members several times, and they have the load once"
            self.notes.changed(card, f"{words}; CalculiX adds it each time")
        return once

    def _pulled(self) -> dict[End, tuple[float, ...]]:
        """The directions of TRVEC of the steps before, by element and face, unless OP=NEW ends them."""
        acting = {} if "pressures" in self._renewed else self.kinds["pressures"]
        return {key[:2]: key[2] for key, one in acting.items() if len(key[2]) == 3 and one.value}

    def _body_force(self, card: Card, what: str, label: str, values: list[float]) -> None:
        """A load on the volume of elements, which adds to others of its kind in another direction."""
        members = set(self.deck.chosen(card, "ELSET", what))
        slopes = np.zeros((3, 3))
        if label == "CENTRIF":  # ω² times the distance from the axis through a place
            slopes = np.eye(3) - np.outer(along(values[4:7]), along(values[4:7]))
            constant = -slopes @ vector(values[1:4])
        elif label == "GRAV":
            constant = along(values[1:4])
        else:
            constant = np.eye(3)["XYZ".index(label[1])]
        way = (*constant, *slopes.ravel())
        key = (called(what), card.scope, label)
        acting = {} if "body_forces" in self._renewed else self.kinds["body_forces"]
        fresh = self._fresh["body_forces"] if label == "CENTRIF" else {}
        old = [other for other, load in acting.items() if load.value]
        for one in dict.fromkeys([*old, *fresh]):  # in the order of the deck
            there = self.deck.chosen(card._replace(scope=one[1]), "ELSET", one[0])
            if one[2] != label or members.isdisjoint(there):
                continue
            off = np.abs(np.subtract(one[3], way)).max()
            if one[:3] == key and off <= EXACT * np.abs(way).max():
                way = one[3]  # the same but for rounding
            elif label == "GRAV":
                apart = "direction or axis" if one[:3] == key else "set"
                words = f"GRAV adds to that of the step before, which has another {apart}"
                self.notes.changed(card, f"{words}, as in CalculiX; OP=NEW would replace it")
            else:
                words = f"{label} on elements that have one of another set or axis"
                self.notes.lost(card, f"{words}: programs take one or both")
        self._add("body_forces", (*key, way), card, values[0])

    _on_dsload = _on_dload

    def _on_rigidbody(self, card: Card) -> None:
        nodes = set().union(
            *(
                self._nodes(card, card.given[key])
                for key in ("NSET", "TIENSET")
                if key in card.given
            )
        )
        ref = self.node(card, card.given["REFNODE"])
        turn = self.node(card, card.given.get("ROTNODE", card.given["REFNODE"]))
        if {"ELSET", "PINNSET", "ANALYTICALSURFACE"} & card.given.keys() or not nodes:
            self.notes.lost(card, "rigid bodies that are no set of nodes")
        else:
            self.rigid.append(Rigid(card, nodes, ref, turn))

    def _on_coupling(self, card: Card) -> None:
        ref = self.node(card, card.given["REFNODE"])
        name = card.given["SURFACE"]
        if self.deck.key("NODES", card.scope, name):
            nodes = set(self.deck.chosen(card, "NODES", name))
        else:
            ends = set(self.deck.ends(card, name))
            faces = nodes_of_faces(self.deck.blocks, ends)
            if len(faces) < len(ends):
                raise DeckError(f"the surface {name} has faces that its elements do not have")
            nodes = set(faces[:, :4].ravel().tolist()) - {-1}
        self._coupling = Rigid(card, nodes, ref, ref)

    def _on_kinematic(self, card: Card) -> None:
        if self._coupling is None:
            raise DeckError("it does not follow *COUPLING")
        nodes = self._coupling
        spread = card.word == "DISTRIBUTING"
        self.rigid.append(nodes._replace(spread=spread))
        self._coupling = None
        if card.says("WEIGHTINGMETHOD", "UNIFORM") != "UNIFORM":
            self.notes.lost(card, "weights that are not uniform")
        ranges = [
            (integer(row[0]), integer(entry(row, 1, row[0])))
            for row in card.rows
            if row[0].isdigit()
        ]
        solid = any(block.card.says("TYPE").startswith("C3D") for block in self.deck.blocks)
        needed = {1, 2, 3} if solid else {1, 2}
        if card.rows and not needed <= {
            k for first, last in ranges for k in range(first, last + 1)
        }:
            self.notes.lost(card, "a coupling of some components only")

    _on_distributing = _on_kinematic

    def _on_equation(self, card: Card) -> None:
        words = deque(chain(*card.rows))
        while words:
            if (count := integer(words.popleft())) < 1:
                raise DeckError("an equation has one term or more")
            terms = [[words.popleft() for _ in range(3)] for _ in range(count)]
            self._equate(card, [(what, component(k), number(c)) for what, k, c in terms])

    def _equate(self, card: Card, terms: Sequence[tuple[str, int, float]]) -> None:
        """An equation between single nodes, or one for each node of sets of equally many."""
        nodes = [self._in_order(card, what) for what, *_ in terms]
        most = max(map(len, nodes))
        if {*map(len, nodes)} - {1, most}:
            raise DeckError("it has sets of different sizes")
        if max(way for _, way, _ in terms) > 3 or not terms[0][2]:
            raise DeckError("its nodes have the components 1 to 3 alone, and the first one counts")
        for k in range(most):
            one = [
                (some[k % len(some)], *term[1:]) for some, term in zip(nodes, terms, strict=True)
            ]
            other, first = self.equations.setdefault(one[0][:2], (card, one))
            if first is not one or len({term[:2] for term in one}) < len(one):
                raise DeckError(
                    f"a component of node {one[0][0] % STRIDE} twice, also on line {other.line}"
                )

    def _in_order(self, card: Card, what: str) -> list[int]:
        """The nodes of a set, or of a number, ascending, or as they are given in a set that is UNSORTED."""
        found = self._nodes(card, what)
        key = self.deck.key("NSET", card.scope, what)
        if key is None or key not in self.deck.unsorted:
            return sorted(found)
        given = dict.fromkeys(self.deck.sets["NSET"][key])
        if given.keys() != found:
            raise DeckError(f"the set {what} is UNSORTED and has other sets, whose order counts")
        return [*given]

    def _constrain(self, card: Card) -> None:
        beams = defaultdict[int, set[int]](set)
        for row in card.rows:
            kind, what = row[0], row[1]
            if kind.upper() in ("TIE", "PIN"):
                for k in (1, 2, 3):
                    self._equate(card, [(what, k, 1.0), (row[2], k, -1.0)])
            elif kind.upper() == "BEAM":
                beams[self.node(card, row[2])] |= self._nodes(card, what)
            else:
                self.notes.lost(card, f"{kind.upper()}: of these BEAM, PIN and TIE are read")
        self.rigid += [Rigid(card, nodes, ref, ref) for ref, nodes in beams.items()]
        self._refs |= beams.keys()

    def _on_temperature(self, card: Card) -> None:
        self._renew("heat", card)
        if "FILE" in card.given or "USER" in card.given:
            self.notes.lost(card, "temperatures of a file or a routine")
            return
        for row in card.rows:
            nodes = self._nodes(card, row[0])
            before = [self._fresh["heat"][node] for node in nodes & self._fresh["heat"].keys()]
            lines = [other.line for other, value in before if value != number(row[1])]
            if lines:
                words = f"line {min(lines)} gives another temperature of the same nodes"
                self.notes.changed(card, f"{words}; the last one counts, as in CalculiX")
            self._fresh["heat"] |= dict.fromkeys(nodes, (card, number(row[1])))
            self.heated.append((card, nodes))

    def _on_initialconditions(self, card: Card) -> None:
        if card.says("TYPE") != "TEMPERATURE" or "FILE" in card.given:
            self.notes.lost(card, f"initial {card.given['TYPE'].lower()}")
            return
        for row in card.rows:
            nodes = self._nodes(card, row[0])
            if {self.start[node] for node in nodes & self.start.keys()} - {number(row[1])}:
                words = "some of its nodes have another initial temperature before"
                self.notes.changed(card, f"{words}; the last one counts, as in CalculiX")
            self.start |= dict.fromkeys(nodes, number(row[1]))


def _timing(card: Card) -> tuple[str, float]:
    """The amplitude of a load or support, and its delay."""
    return card.name_of("AMPLITUDE"), number(card.given.get("TIMEDELAY") or "0")
