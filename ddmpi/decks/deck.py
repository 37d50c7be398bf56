"""What a deck says of meshes: nodes, elements, sets and surfaces, of all parts or of one."""

import re
from collections import defaultdict
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import cached_property
from itertools import accumulate, chain, product
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.decks.cards import (
    EVERY,
    FAMILIES,
    SIDES,
    Block,
    Card,
    DeckError,
    End,
    Instance,
    along,
    called,
    corners,
    element,
    entry,
    face,
    faces,
    integer,
    numbers,
    read_cards,
    shape,
    vector,
)
from ddmpi.system.numbers import Frame

GENERATING = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")
"""Keywords that make nodes or elements from others, or move them; they are not read."""

WITHIN = ("PART", "INSTANCE", "ASSEMBLY")
"""Keywords that are ended by END and their name."""

MOST = 10**8
"""Largest number of members of a generated set."""

STRIDE = 10**12
"""Numbers of nodes and elements of the k-th instance are raised by k times this, as each counts for itself."""

Entry = int | tuple[str, str] | tuple[str, str, int | None]
"""A member of a set: a number, or the name of another set and the instance in which it is looked up first, and how
many entries of that one count, if not all: those that it has so far."""


def all_faces(blocks: Sequence[Block]) -> tuple[np.ndarray, np.ndarray]:
    """The nodes (f, 8) of all faces of elements, corners in the first four columns, then middles of the sides, −1 where
    there are fewer; and the element and the number of each face (f, 2)."""
    found = [np.empty((0, 8), int)]
    owners = [np.array([], int).reshape(-1, 2)]
    for block in blocks:
        nodes = block.entries[:, 1:]
        number = corners(block.kind)
        sides = {frozenset(side): number + k for k, side in enumerate(SIDES[shape(block.kind)])}
        for k, side in enumerate(faces(block.kind), 1):
            around = list(zip(side, side[1:] + side[:1], strict=True)) if len(side) > 2 else [side]
            middles = [sides[frozenset(side)] for side in around] if nodes.shape[1] > number else []
            rows = np.full((len(nodes), 8), -1)
            rows[:, : len(side)] = nodes[:, list(side)]
            rows[:, 4 : 4 + len(middles)] = nodes[:, middles]
            found.append(rows)
            owners.append(np.column_stack([block.entries[:, 0], np.full(len(nodes), k)]))
    return np.concatenate(found), np.concatenate(owners)


def nodes_of_faces(blocks: Sequence[Block], ends: set[End]) -> np.ndarray:
    """The nodes (f, 8), as of `all_faces`, of the faces `ends` (element, number)."""
    rows, owners = all_faces(blocks)
    return rows[[end in ends for end in map(tuple, owners.tolist())]]


def are_free(rows: np.ndarray) -> np.ndarray:
    """(f,) bool, which of all faces of elements, with these nodes (f, 8), no other element has."""
    ends = np.sort(rows[:, :4], axis=1)
    _, number, count = np.unique(ends, axis=0, return_inverse=True, return_counts=True)
    return count[number.ravel()] == 1


class Deck:
    """Nodes, elements, sets and surfaces of an Abaqus or CalculiX deck.

    Parts stand in an assembly, moved or turned. Internal sets are no groups. Names are alike whatever their case. Any
    method may raise DeckError with the reason, or InputError with the line as well, and OSError.

    Attributes
    ----------
    cards : all keywords, those of parts once for each instance
    points : coordinates (m) by number, where instances have them
    blocks : elements
    odd : keywords of elements that have no shape, or whose type is not known
    sets : entries by kind and key: sets of nodes and of elements, surfaces of nodes, and of elements with their sides
    names : of sets and surfaces that are not internal, by kind and key, as they are written
    elements : all numbers of elements
    told : keywords that add to a set or a surface, and what is said of them
    """

    def __init__(self, path: Path) -> None:
        self.cards, instances = flattened(path)
        if (
            len(instances) == 1 and not instances[0].part
        ):  # a mesh outside of parts is that of the only instance
            self.cards = [card._replace(scope=instances[0].name) for card in self.cards]
        self.places = {called(instance.name): instance for instance in instances}
        if len(self.places) < len(instances):
            raise DeckError("two of its instances have one name")
        self._first = {name: STRIDE * k for k, name in enumerate(["", *self.places])}
        self.points: dict[int, list[float]] = {}
        self.blocks: list[Block] = []
        self.odd: list[Card] = []
        self.sets: dict[str, dict[str, list[Any]]] = {
            kind: {} for kind in ("NSET", "ELSET", "NODES", "SURFACE")
        }
        self.names: dict[tuple[str, str], str] = {}
        self.unsorted = set[str]()  # keys of sets whose order counts
        self._surfaces: dict[str, Card] = {}
        self.elements = set[int]()
        self.told: list[tuple[Card, str]] = []
        self._taken: dict[
            tuple[str, str], Card
        ] = {}  # the first keyword that takes a set, by kind and key
        self._listed: list[tuple[Card, str, list[Any]]] = []  # numbers that sets and surfaces name
        for card in self.cards:
            with card.reading():
                self._take(card)
        self._place()
        number, count = np.unique(
            np.concatenate([np.empty(0, int), *(block.entries[:, 0] for block in self.blocks)]),
            return_counts=True,
        )
        self.sets["ELSET"][EVERY] = number.tolist()
        if (count > 1).any():
            raise DeckError(f"it has the element {number[count > 1][0] % STRIDE} twice")

    def _take(self, card: Card) -> None:
        """Note what one keyword says."""
        own = self._first[called(card.scope)]
        if card.word in GENERATING:
            raise DeckError("it is not supported; write all nodes and elements")
        if card.word == "NODE":
            self._take_nodes(card, own)
        elif card.word == "ELEMENT":
            self._take_elements(card, own)
        elif card.word in ("NSET", "ELSET"):
            self._take_set(card)
        elif card.word == "SURFACE":
            self._take_surface(card)

    def _take_nodes(self, card: Card, own: int) -> None:
        if card.says("SYSTEM", "R") != "R":
            raise DeckError("its SYSTEM is not supported; write coordinates along x, y and z")
        nodes = [own + integer(row[0]) for row in card.rows]
        for node, row in zip(nodes, card.rows, strict=True):
            at = vector(numbers(row[1:])).tolist()
            if self.points.setdefault(node, at) != at:
                raise DeckError(f"the node {node % STRIDE} is there twice, at two places")
        if "NSET" in card.given:
            self._set("NSET", card, nodes)

    def _take_elements(self, card: Card, own: int) -> None:
        name = card.given["TYPE"]
        try:
            kind, count = element(name)
        except DeckError:
            kind = ""
        if not kind:
            self.odd.append(card)
            odd = [own + int(row[0]) for row in card.rows if row[0].isdigit()]
            self.elements.update(odd)
            if "ELSET" in card.given:
                self._set("ELSET", card._replace(given=card.given | {"INTERNAL": ""}), odd)
            return
        rows = [[own + integer(word) for word in row if word] for row in card.rows]
        if rows and min(map(len, rows)) > 1 + count:  # with nodes inside, of incompatible modes
            rows = [row[: 1 + count] for row in rows]
        entries = np.array([*chain(*rows)], np.int64)
        if len(entries) % (1 + count):
            raise DeckError(
                f"it has {len(entries)} numbers, and {name} takes {1 + count} each; is the file cut off?"
            )
        self.blocks.append(Block(kind, entries.reshape(-1, 1 + count), card))
        found = self.blocks[-1].entries[:, 0].tolist()
        self.elements.update(found)
        if "ELSET" in card.given:
            self._set("ELSET", card, found)

    def _take_set(self, card: Card) -> None:
        if "UNSORTED" in card.given:
            self.unsorted.add(called(f"{card.scope}.{card.given[card.word]}").lstrip("."))
        words = _generated(card) if "GENERATE" in card.given else chain(*card.rows)
        self._set(card.word, card, self._entries(card, card.word, filter(None, words)))
        if card.word == "NSET" and "ELSET" in card.given:
            some = self.chosen(card, "ELSET", card.given["ELSET"])
            nodes = [rows[np.isin(rows[:, 0], some), 1:].ravel() for _, rows, _ in self.blocks]
            self._set("NSET", card, np.unique(np.concatenate(nodes)).tolist())

    def _take_surface(self, card: Card) -> None:
        name = card.given["NAME"]
        kind = "NODES" if card.says("TYPE") == "NODE" else "SURFACE"
        other = self._surfaces.setdefault(called(f"{card.scope}.{name}"), card)
        if (other.says("TYPE") == "NODE") != (kind == "NODES"):
            raise DeckError(f"there is a surface {name} on line {other.line} already")
        if other.place != card.place:
            self.told.append((card, f"adds to that of line {other.line}, as in CalculiX"))
        of = "NSET" if kind == "NODES" else "ELSET"
        found: list[Any] = self._entries(card, of, (row[0] for row in card.rows))
        if kind == "SURFACE":
            sides = [entry(row, 1).upper() for row in card.rows]
            found = [*zip(found, sides, strict=True)]
        self._set(kind, card, found)

    def _set(self, kind: str, card: Card, entries: list) -> None:
        """Add to a set or surface that `card` defines; within an instance it has the name of this before its own."""
        name = card.given["NAME" if card.word == "SURFACE" else kind]
        name = f"{card.scope}.{name}" if card.scope else name
        if card.word != "NODE" and "INTERNAL" not in card.given:
            self.names.setdefault((kind, called(name)), name)
        members = self.sets[kind].setdefault(called(name), [])
        before = self._taken.get((kind, called(name)))
        if before and not set(entries) <= set(members):
            words = f"line {before.line} has the set as it is there, without these"
            self.told.append((card, f"{words}, as in Abaqus and CalculiX"))
        members.extend(entries)

    def _entries(self, card: Card, kind: str, words: Iterable[str]) -> list[Entry]:
        """Members that a keyword names: numbers, and sets of this kind as they are there, as in Abaqus and CalculiX."""
        scope = called(card.given.get("INSTANCE", card.scope))
        if scope not in self._first:
            raise DeckError(f"there is no instance {scope}")
        found: list[Entry] = []
        for word in words:
            if word.isdigit():
                found.append(self._first[scope] + integer(word))
                continue
            key = self.key(kind, scope, word)
            if key is not None:
                self._taken.setdefault((kind, key), card)
            so_far = None if key is None else len(self.sets[kind][key])
            found.append((scope, word, so_far))
        if card.word in ("NSET", "ELSET", "SURFACE"):
            self._listed.append((card, kind, [one for one in found if isinstance(one, int)]))
        return found

    @cached_property
    def outside(self) -> list[Card]:
        """The keywords that stand in no step."""
        words = (card.word for card in self.cards)
        within = accumulate((word == "STEP") - (word == "ENDSTEP") for word in words)
        return [card for card, inside in zip(self.cards, within, strict=True) if not inside]

    def lost(self) -> Iterator[tuple[Card, str]]:
        """Keywords of sets and surfaces that name nodes or elements that are not there, and these in words."""
        for card, kind, named in self._listed:
            known = self.points.keys() if kind == "NSET" else self.elements
            if missing := sorted(set(named) - known):
                what = "node" if kind == "NSET" else "element"
                more = f" and {len(missing) - 1} more" * (len(missing) > 1)
                yield card, f"there is no {what} {missing[0] % STRIDE}{more}"

    def key(self, kind: str, scope: str, name: str) -> str | None:
        """The key of a set or surface that is named within the instance `scope`: its own one, or one of the assembly."""
        keys = called(f"{scope}.{name}"), called(name)
        return next((key for key in keys if key in self.sets[kind]), None)

    def members(self, kind: str, what: Entry) -> set[int]:
        """The numbers in a set and in the sets that it names, or the number itself. Raises DeckError."""
        return set(self._members(kind, what))

    def _members(self, kind: str, what: Entry, within: tuple[str, ...] = ()) -> list[int]:
        """The same, each number as often as it is there."""
        if isinstance(what, int):
            return [what]
        scope, word, *so_far = what
        inside, _, last = called(word).rpartition(".")
        if last.isdigit() and inside in self._first:  # a node of an instance
            return [self._first[inside] + integer(last)]
        name = self.key(kind, scope, word)
        if name is None or name in within:
            raise DeckError(
                f"there is no set {word}" if name is None else f"the set {word} contains itself"
            )
        of = "NSET" if kind == "NODES" else kind  # a surface may have the name of its set
        within = (*within, name) if of == kind else ()
        entries = self.sets[kind][name][: so_far[0] if so_far else None]
        return [*chain(*(self._members(of, member, within) for member in entries))]

    def chosen(self, card: Card, kind: str, word: str) -> list[int]:
        """The numbers of nodes or elements that a data line of `card` names, by set or number, and that are there, each
        as often as it is in the set. Raises DeckError where there are none."""
        if not word:
            raise DeckError("the name of a set is missing")
        known = self.elements if kind == "ELSET" else self.points.keys()
        named = self._members(kind, self._entries(card, kind, [word])[0])
        found = [number for number in named if number in known]
        if not found:
            what = "element" if kind == "ELSET" else "node"
            one = word.rpartition(".")[2].isdigit()
            raise DeckError(f"there is no {what} {word}" if one else f"the set {word} is empty")
        return found

    def ends(self, card: Card, name: str) -> list[End]:
        """The elements of a surface of element faces, and the numbers of their faces, as often as they are there. Raises
        DeckError where it has none."""
        key = self.key("SURFACE", card.scope, name)
        if key is None:
            raise DeckError(f"there is no surface {name} of element faces")
        found: list[End] = []
        for what, where in self.sets["SURFACE"][key]:
            if where and not re.fullmatch(r"[SE]\d", where):
                raise DeckError(f"the surface {name} has a side {where} that is no face S1 to S6")
            some = [one for one in self._members("ELSET", what) if one in self.elements]
            sides = [int(where[1])] if where else range(1, 7)
            found += [end for end in product(some, sides) if where or end in self._free]
        if not found:
            raise DeckError(f"the surface {name} is empty")
        return found

    @cached_property
    def _free(self) -> set[End]:
        """The faces of elements that a scene may have, and no other element has."""
        own = [block for block in self.blocks if FAMILIES.match(block.card.says("TYPE"))]
        rows, owners = all_faces(own)
        return set(map(tuple, owners[are_free(rows)].tolist()))

    def stands(self, card: Card) -> Card:
        """A card of directions or of an axis, such as *ORIENTATION, as it is where its instance stands. Raises
        DeckError."""
        place = self.places[called(card.scope)].place if card.scope else []
        if not place or not card.rows:
            return card
        frame = _frame(place)
        ends = vector(card.values(), 6).reshape(2, 3)
        round_axis = card.word == "CYCLICSYMMETRYMODEL" or (
            (card.says("TYPE") or card.says("SYSTEM", "R"))[:1] != "R"
        )
        moved = frame.at(ends) if round_axis else frame.along(ends)
        row = [*map(repr, moved.ravel().tolist()), *card.rows[0][6:]]
        return card._replace(rows=[row, *card.rows[1:]])

    def placed(self) -> tuple[np.ndarray, np.ndarray]:
        """All numbers of nodes (n,), ascending, and their points (n, 3) (m)."""
        nodes = np.array(sorted(self.points), np.int64)
        return nodes, np.array([self.points[node] for node in nodes.tolist()]).reshape(-1, 3)

    def _place(self) -> None:
        """Put the nodes of instances where these stand. Raises DeckError."""
        owned = defaultdict[int, list[int]](list)
        for node in self.points:
            owned[node // STRIDE * STRIDE].append(node)
        for name, instance in self.places.items():
            own = owned[self._first[name]]
            if instance.place and own:
                points = _frame(instance.place).at(np.array([self.points[node] for node in own]))
                self.points |= zip(own, points.tolist(), strict=True)

    def _scope(self, part: str | None) -> str | None:
        """The key of the instance that `part` names, or of the only one; None where it is a set. Raises DeckError."""
        name = "" if part is None else called(part)
        if name in self.places:
            return name
        of = [
            key for key, place in self.places.items() if part is None or called(place.part) == name
        ]
        if len(of) > 1:
            raise DeckError(
                (
                    "it has several parts; name the one of this body"
                    if part is None
                    else f"the part {part} stands in it {len(of)} times; name the instance"
                )
                + " by part = "
                + " or ".join(f'"{self.places[key].name}"' for key in of)
            )
        return of[0] if of else None if len(self.places) > 1 else next(iter(self.places), "")

    def mesh(self, part: str | None = None):
        """All of it as a mesh of meshio; surfaces are elements between corners. Of several parts the `part` alone, by
        the name of its instance or its own; its elements are a set of that name, too."""
        import meshio

        for card in self.odd if part is None else ():
            element(card.given["TYPE"])
        scope = self._scope(part)
        only = scope if self.places else None  # the instance whose elements are taken
        numbers, points, blocks = self._own(only)
        cells = [(block.kind, block.entries[:, 1:]) for block in blocks]
        sets = self._sets(("NSET", "NODES"), [numbers], only)
        elements = [block.entries[:, 0] for block in blocks]
        groups = self._sets(("ELSET",), elements, only)
        if part and only and called(part) in (only, called(self.places[only].part)):
            groups[part] = {k: np.arange(len(entries)) for k, entries in enumerate(elements)}
        for label, facets in self._facets(blocks, only):
            groups[label][len(cells)] = np.arange(len(facets))
            cells.append((("line", "triangle", "quad")[facets.shape[1] - 2], facets))
        nothing = np.empty(0, int)
        return meshio.Mesh(
            points,
            [(kind, np.searchsorted(numbers, nodes)) for kind, nodes in cells],
            point_sets={name: some[0] for name, some in sets.items()},
            cell_sets={
                name: [some.get(k, nothing) for k in range(len(cells))]
                for name, some in groups.items()
            },
        )

    def _own(self, only: str | None) -> tuple[np.ndarray, np.ndarray, Sequence[Block]]:
        """Numbers of nodes, their points, and elements; those of the instance `only`, if it is one. Raises DeckError
        where elements have other nodes."""
        numbers, points = self.placed()
        blocks = self.blocks
        if only is not None:
            own = numbers // STRIDE == self._first[only] // STRIDE
            numbers = numbers[own]
            points = points[own]
            blocks = [block for block in blocks if called(block.card.scope) == only]
        for block in blocks:
            refuse_lost(block.entries, numbers)
        return numbers, points, blocks

    def _sets(
        self, kinds: Sequence[str], among: Sequence[np.ndarray], only: str | None
    ) -> dict[str, dict[int, np.ndarray]]:
        """Which of the numbers in each array of `among` are in sets: by their names, then by the array."""
        found = defaultdict[str, dict[int, np.ndarray]](dict)
        for kind, key, label in self._labels(kinds, only):
            members = np.fromiter(self.members(kind, ("", key)), np.int64)
            own = [np.flatnonzero(np.isin(numbers, members)) for numbers in among]
            # others are of another instance, or of the assembly alone
            if not self.places or any(map(len, own)):
                before = found.setdefault(label, dict(enumerate(own)))
                if not all(np.array_equal(before[k], some) for k, some in enumerate(own)):
                    raise DeckError(
                        f"the set {label} and the surface of this name have different nodes; "
                        "rename one of them"
                    )
        return found

    def _facets(
        self, blocks: Sequence[Block], only: str | None
    ) -> Iterator[tuple[str, np.ndarray]]:
        """Names of surfaces, and the nodes at the corners (k, n) of their faces on each of these blocks."""
        for kind, key, label in self._labels(("SURFACE",), only):
            for what, where in self.sets[kind][key]:
                some = list(self.members("ELSET", what))
                for block in blocks:
                    rows = block.entries[np.isin(block.entries[:, 0], some)]
                    if len(rows):
                        at = np.array(face(block.kind, where, self.names[kind, key]))
                        yield label, rows[:, 1 + at]

    def _labels(self, kinds: Sequence[str], only: str | None) -> Iterator[tuple[str, str, str]]:
        """Kind and key of sets and surfaces, and their names; of those of the instance `only` the names in its part,
        unless one of the whole assembly that has members there is called so."""
        for (kind, key), name in self.names.items():
            if kind not in kinds:
                continue
            if only and key.startswith(f"{only}."):
                own = name[len(self.places[only].name) + 1 :]
                name = name if self._reaches(kind, called(own), only) else own
            yield kind, key, name

    def _reaches(self, kind: str, key: str, only: str) -> bool:
        """Whether there is a set or surface with this key that has members in the instance `only`."""
        if (kind, key) not in self.names:
            return False
        if kind == "SURFACE":
            entries = [what for what, _ in self.sets[kind][key]]
            members = set().union(*(self.members("ELSET", what) for what in entries))
        else:
            members = self.members(kind, ("", key))
        return any(number // STRIDE == self._first[only] // STRIDE for number in members)


def _frame(place: list[list[str]]) -> Frame:
    """Where an instance stands, by the rows that shift it and then turn it. Raises DeckError."""
    shift, *turns = map(numbers, place[:2])
    frame = Frame.of(vector(shift))  # of a plane part two coordinates will do
    for turn in turns:
        if len(turn) < 7:
            raise DeckError(f"an instance is turned by 7 numbers, and one has {len(turn)}")
        start, end = np.reshape(turn[:6], (2, 3))
        axis = along((end - start).tolist())
        frame = Frame.of(np.zeros(3), turn[6] * axis, start).after(frame)
    return frame


def refuse_lost(entries: np.ndarray, numbers: np.ndarray) -> None:
    """Raise DeckError where elements (n, 1 + k), by number and nodes, have nodes that are none of these `numbers`."""
    lost = ~np.isin(entries[:, 1:], numbers)
    if lost.any():
        k, j = np.argwhere(lost)[0]
        node = entries[k, 1 + j] - STRIDE * round(entries[k, 1 + j] / STRIDE)
        raise DeckError(
            f"the element {entries[k, 0] % STRIDE} has node {node}, which is not there; is the file cut off?"
        )


def _generated(card: Card) -> Iterator[str]:
    """The numbers of a set by their first, their last and their step. Raises DeckError."""
    for row in card.rows:
        first = integer(row[0])
        last = integer(row[1])
        by = integer(entry(row, 2, "1"))
        if by < 1:
            raise DeckError("numbers are generated by steps of 1 or more")
        if last < first:
            raise DeckError(f"it generates numbers from {first} to {last}")
        if last - first >= MOST * by:
            raise DeckError(f"the set {card.given[card.word]} has more than {MOST} members")
        yield from map(str, range(first, last + 1, by))


def flattened(path: Path) -> tuple[list[Card], list[Instance]]:
    """The keywords of a deck, those of a part once for each instance of it; and the instances, none without parts.

    Raises the errors of `read_cards`, InputError for two parts of one name, and DeckError for an instance of a part
    that is not there.
    """
    parts: dict[str, tuple[str, list[Card]]] = {}  # by key: name and keywords
    cards = list[Card]()
    instances = list[Instance]()
    scopes = [("", "")]
    for place, read in enumerate(read_cards(path)):
        card = read._replace(place=place)
        within, scope = scopes[-1]
        name = card.given.get("NAME", card.given.get("INSTANCE", ""))
        if card.word in WITHIN:
            scopes.append((card.word, name))
        if card.word == "PART":
            if called(name) in parts:
                raise card.error(f"there are two of the name {name}")
            parts[called(name)] = name, []
        elif card.word == "INSTANCE":
            instances.append(Instance(name, card.given.get("PART", ""), card.rows))
            cards += _of_part(instances[-1], parts)
        elif card.word.startswith("END") and card.word[3:] in WITHIN:
            scopes = scopes[:-1] or scopes
        elif within == "PART":
            parts[called(scope)][1].append(card)
        elif card.word not in WITHIN:
            cards.append(card._replace(scope=scope * (within == "INSTANCE")))
    if parts and not instances:  # a part that nothing places stands where it was drawn
        instances = [Instance(name, name, []) for name, _ in parts.values()]
        cards = [*chain(*(_of_part(one, parts) for one in instances)), *cards]
    return cards, instances


def _of_part(instance: Instance, parts: Mapping[str, tuple[str, list[Card]]]) -> list[Card]:
    """The keywords of an instance, which are those of its part. Raises DeckError."""
    key = called(instance.part)
    if key and key not in parts:
        raise DeckError(
            f"the instance {instance.name} is of a part {instance.part}, which is not there"
        )
    return [card._replace(scope=instance.name) for card in parts[key][1]] if key else []
