"""What a deck says of meshes: nodes, elements, sets and surfaces, of all parts or of one."""

from __future__ import annotations

import re
from collections.abc import Iterable, Iterator
from pathlib import Path

import numpy as np

from ddmpi.decks.cards import SHAPELESS, Card, DeckError, Instance, along, element, face, integer, numbers, read_cards

GENERATING = ("NGEN", "NFILL", "NCOPY", "NMAP", "ELGEN", "ELCOPY", "SYSTEM")
"""Keywords that make nodes or elements from others, or move them; they are not read."""

WITHIN = ("PART", "INSTANCE", "ASSEMBLY")
"""Keywords that are ended by END and their name."""

MOST = 10**8
"""Largest number of members of a generated set."""

STRIDE = 10**12
"""Numbers of nodes and elements of the k-th instance are raised by k times this, as each counts for itself."""

Entry = int | tuple[str, str]
"""A member of a set: a number, or the name of another set and the instance in which it is looked up first."""


class Deck:
    """Nodes, elements, sets and surfaces of an Abaqus or CalculiX deck.

    Parts stand in an assembly, moved or turned. Internal sets are no groups. Names are alike whatever their case. Any
    method may raise DeckError with the reason, or InputError with the line as well, and OSError.

    Attributes
    ----------
    cards : all keywords, those of parts once for each instance
    points : coordinates (m) by number
    blocks : meshio's name of elements, their numbers and nodes (k, 1 + n), and the keyword
    odd : keywords of elements that have no shape, or whose type is not known
    """

    def __init__(self, path: Path) -> None:
        self.cards, instances = _flattened(path)
        if len(instances) == 1 and not instances[0].part:  # a mesh outside of parts is that of the only instance
            self.cards = [card._replace(scope=instances[0].name) for card in self.cards]
        self.places = {instance.name.lower(): instance for instance in instances}
        self._first = {name: STRIDE * k for k, name in enumerate(["", *self.places])}
        self.points: dict[int, list[float]] = {}
        self.blocks: list[tuple[str, np.ndarray, Card]] = []
        self.odd: list[Card] = []
        self.sets: dict[str, dict[str, list[Entry]]] = {"NSET": {}, "ELSET": {}, "NODES": {}}  # surfaces of nodes
        self.surfaces: dict[str, list[tuple[Entry, str]]] = {}
        self.names: dict[tuple[str, str], str] = {}  # of sets that are not internal, as they are written
        for card in self.cards:
            with card.reading():
                self._take(card)
        counted = np.unique(np.concatenate([np.empty(0, int), *(block[:, 0] for _, block, _ in self.blocks)]),
                            return_counts=True)
        if (counted[1] > 1).any():
            raise DeckError(f"it has the element {counted[0][counted[1] > 1][0] % STRIDE} twice")

    def _take(self, card: Card) -> None:
        """Note what one keyword says."""
        word, given, rows, own = card.word, card.given, card.rows, self._first[card.scope.lower()]
        if word in GENERATING:
            raise DeckError("it is not supported; write all nodes and elements")
        if word == "NODE":
            if given.get("SYSTEM", "R").upper() != "R":
                raise DeckError("its SYSTEM is not supported; write coordinates along x, y and z")
            for row in rows:
                self.points[own + integer(row[0])] = numbers([*row[1:], "", "", ""][:3])
            if "NSET" in given:  # of all nodes as a rule, and no group
                self._set("NSET", given["NSET"], card, [own + integer(row[0]) for row in rows], False)
        elif word == "ELEMENT":
            try:
                if given["TYPE"].upper().startswith(SHAPELESS):
                    raise DeckError
                kind, count = element(given["TYPE"])
            except DeckError:
                self.odd.append(card)
                return
            given_rows = [[own + integer(word) for word in row if word] for row in rows]
            if given_rows and min(map(len, given_rows)) > 1 + count:  # with nodes inside, of incompatible modes
                given_rows = [row[:1 + count] for row in given_rows]
            entries = np.array([entry for row in given_rows for entry in row], np.int64)
            if len(entries) % (1 + count):
                raise DeckError(f"it has {len(entries)} numbers, and {given['TYPE']} takes {1 + count} each; is the "
                                "file cut off?")
            self.blocks.append((kind, entries.reshape(-1, 1 + count), card))
            if "ELSET" in given:
                self._set("ELSET", given["ELSET"], card, self.blocks[-1][1][:, 0].tolist())
        elif word in ("NSET", "ELSET"):
            if "GENERATE" in given:
                bounds = [(integer(row[0]), integer(row[1]), integer([*row, "1"][2] or "1")) for row in rows]
                if min((by for *_, by in bounds), default=1) < 1:
                    raise DeckError("numbers are generated by steps of 1 or more")
                runs = [range(first, last + 1, by) for first, last, by in bounds]
                if max(map(len, runs), default=0) > MOST:
                    raise DeckError(f"the set {given[word]} has more than {MOST} members")
                rows = [list(map(str, run)) for run in runs]
            self._set(word, given[word], card, self._entries(card, (entry for row in rows for entry in row if entry)))
            if word == "NSET" and "ELSET" in given:
                some = np.fromiter(self.chosen(card, "ELSET", given["ELSET"]), np.int64)
                self._set(word, given[word], card, np.unique(np.concatenate(
                    [block[np.isin(block[:, 0], some), 1:].ravel() for _, block, _ in self.blocks])).tolist())
        elif word == "SURFACE" and given.get("TYPE", "").upper() == "NODE":
            self._set("NODES", given["NAME"], card, self._entries(card, (row[0] for row in rows)))
        elif word == "SURFACE":
            name = self._named("SURFACE", given["NAME"], card)
            self.surfaces.setdefault(name, []).extend(
                (entry, [*row, ""][1].upper()) for row in rows for entry in self._entries(card, row[:1]))

    def _named(self, kind: str, name: str, card: Card, group: bool = True) -> str:
        """The key of a set or surface that `card` defines: its name, with that of the instance within one."""
        key = f"{card.scope}.{name}".lower() if card.scope else name.lower()
        if group and "INTERNAL" not in card.given:
            self.names.setdefault((kind, key), f"{card.scope}.{name}" if card.scope else name)
        return key

    def _set(self, kind: str, name: str, card: Card, entries: list, group: bool = True) -> None:
        self.sets[kind].setdefault(self._named(kind, name, card, group), []).extend(entries)

    def _entries(self, card: Card, words: Iterable[str]) -> list[Entry]:
        scope = card.given.get("INSTANCE", card.scope).lower()
        if scope not in self._first:
            raise DeckError(f"there is no instance {scope}")
        return [self._first[scope] + integer(word) if word.isdigit() else (scope, word.strip('"')) for word in words]

    def members(self, kind: str, what: Entry, within: tuple[str, ...] = ()) -> set[int]:
        """The numbers in a set and in the sets that it names, or the number itself. Raises DeckError."""
        if isinstance(what, int):
            return {what}
        scope, word = what
        inside, _, last = word.lower().rpartition(".")
        if last.isdigit() and inside in self._first:  # a node of an instance
            return {self._first[inside] + integer(last)}
        keys = (f"{scope}.{word}".lower(), word.lower(), last)
        name = next((key for key in keys if key in self.sets[kind]), None)
        if name is None or name in within:
            raise DeckError(f"there is no set {word}" if name is None else f"the set {word} contains itself")
        of = "NSET" if kind == "NODES" else kind  # a surface may have the name of its set
        within = (*within, name) if of == kind else ()
        return set().union(*(self.members(of, member, within) for member in self.sets[kind][name]))

    def chosen(self, card: Card, kind: str, word: str) -> set[int]:
        """The numbers of nodes or elements that a data line of `card` names, by set or number. Raises DeckError where
        there are none."""
        if not word:
            raise DeckError("the name of a set is missing")
        found = set().union(*(self.members(kind, entry) for entry in self._entries(card, [word])))
        if not found:
            raise DeckError(f"the set {word} is empty")
        return found

    def ends(self, card: Card, name: str) -> Iterator[tuple[int, int]]:
        """The elements of a surface of element faces, and the numbers of their faces. Raises DeckError."""
        key = next((key for key in (f"{card.scope}.{name}".lower(), name.lower()) if key in self.surfaces), None)
        if key is None:
            raise DeckError(f"there is no surface {name} of element faces")
        for what, where in self.surfaces[key]:
            if not re.fullmatch(r"[SE]\d", where):
                raise DeckError(f"the surface {name} has a side {where or '(none)'} that is no face S1 to S6")
            for one in sorted(self.members("ELSET", what)):
                yield one, int(where[1])

    def faces(self, key: str, name: str) -> Iterator[tuple[int, np.ndarray, np.ndarray]]:
        """Of the surface `key`, by its lines and blocks of elements: the block, elements (k,), corners (k, c)."""
        for what, where in self.surfaces[key]:
            some = np.fromiter(self.members("ELSET", what), np.int64)
            for k, (kind, entries, _) in enumerate(self.blocks):
                rows = np.flatnonzero(np.isin(entries[:, 0], some))
                if len(rows):
                    yield k, rows, entries[rows][:, 1 + np.array(face(kind, where, name))]

    def placed(self) -> tuple[np.ndarray, np.ndarray]:
        """All numbers of nodes (n,), ascending, and their points (n, 3) where instances have them (m)."""
        from scipy.spatial.transform import Rotation

        nodes = np.array(sorted(self.points), np.int64)
        points = np.array([self.points[number] for number in nodes.tolist()]).reshape(-1, 3)
        for name, instance in self.places.items():
            own, place = nodes // STRIDE == self._first[name] // STRIDE, [numbers(r) for r in instance.place]
            for row in place[:1]:
                points[own] += [*row, 0.0, 0.0][:3]  # of a plane part two coordinates will do
            if len(place) > 1 and len(place[1]) < 7:
                raise DeckError(f"the instance {instance.name} is turned by 7 numbers, and has {len(place[1])}")
            for row in place[1:2]:
                start = np.array(row[:3])
                turn = Rotation.from_rotvec(np.radians(row[6]) * np.array(along((row[3:6] - start).tolist())))
                points[own] = start + turn.apply(points[own] - start)
        return nodes, points

    def _scope(self, part: str | None) -> str | None:
        """The key of the instance that `part` names, or of the only one; None where it is a set. Raises DeckError."""
        several = len(self.places) > 1
        if part is not None and part.lower() in self.places:
            return part.lower()
        of = [name for name, place in self.places.items() if part is not None and place.part.lower() == part.lower()]
        if len(of) > 1:
            raise DeckError(f"the part {part} stands in it {len(of)} times; name the instance by part = "
                             + " or ".join(f'"{self.places[name].name}"' for name in of))
        if several and part is None:
            raise DeckError("it has several parts; name the one of this body by part = "
                             + " or ".join(f'"{place.name}"' for place in self.places.values()))
        return of[0] if of else None if several else next(iter(self.places), "")

    def mesh(self, part: str | None = None):
        """All of it as a mesh of meshio; surfaces are elements between corners. Of several parts the `part` alone, by
        the name of its instance or its own; its elements are a set of that name, too."""
        import meshio

        if self.odd and part is None:
            for card in self.odd:
                if not card.given["TYPE"].upper().startswith(SHAPELESS):
                    element(card.given["TYPE"])
        scope = self._scope(part)
        only = scope if self.places else None  # the instance whose elements are taken
        numbers, points = self.placed()
        if only is not None:
            own = numbers // STRIDE == self._first[only] // STRIDE
            numbers, points = numbers[own], points[own]
        taken = [k for k, (*_, card) in enumerate(self.blocks) if only in (None, card.scope.lower())]
        blocks = [self.blocks[k][1] for k in taken]
        cells, nothing = [], np.empty(0, int)
        for k in taken:
            kind, entries, _ = self.blocks[k]
            lost = np.setdiff1d(entries[:, 1:], numbers)
            if len(lost):
                raise DeckError(f"an element has node {lost[0] % STRIDE}, which is not there")
            cells.append((kind, np.searchsorted(numbers, entries[:, 1:])))

        def label(name: str) -> str:  # within its own instance a set goes by its name alone
            return name[len(only) + 1:] if only and name.lower().startswith(f"{only}.") else name

        groups, node_sets = dict[str, list[np.ndarray]](), dict[str, np.ndarray]()
        if part is not None and only and part.lower() in (only, self.places[only].part.lower()):
            groups[part] = [np.arange(len(entries)) for entries in blocks]
        for (kind, key), name in self.names.items():
            if kind == "SURFACE":
                continue
            members = np.fromiter(self.members(kind, ("", key)), np.int64)
            some = [np.flatnonzero(np.isin(among, members)) for among in
                    ([entries[:, 0] for entries in blocks] if kind == "ELSET" else [numbers])]
            if self.places and not any(map(len, some)):  # of another instance, or of the assembly alone
                continue
            if kind == "ELSET":
                before = groups.get(label(name), some)
                groups[label(name)] = [np.union1d(*pair) for pair in zip(some, before, strict=True)]
            else:
                node_sets[label(name)] = np.union1d(some[0], node_sets.get(label(name), nothing))
        for (kind, key), name in self.names.items():
            for k, _, corners in self.faces(key, name) if kind == "SURFACE" else ():
                if k in taken:
                    before = groups.get(label(name), [])
                    groups[label(name)] = [*before, *[nothing] * (len(cells) - len(before)), np.arange(len(corners))]
                    facet = ("line", "triangle", "quad")[corners.shape[1] - 2]
                    cells.append((facet, np.searchsorted(numbers, corners)))
        return meshio.Mesh(points, cells, cell_sets={name: [*some, *[nothing] * (len(cells) - len(some))]
                                                     for name, some in groups.items()}, point_sets=node_sets)


def _flattened(path: Path) -> tuple[list[Card], list[Instance]]:
    """The keywords of a deck, those of a part once for each instance of it; and the instances, none without parts.

    Raises the errors of `read_cards`, and DeckError for an instance of a part that is not there.
    """
    parts: dict[str, list[Card]] = {}
    names: dict[str, str] = {}
    cards, instances, scopes = list[Card](), list[Instance](), [("", "")]
    for place, read in enumerate(read_cards(path)):
        card = read._replace(place=place)
        if card.word in WITHIN:
            name = card.given.get("NAME", card.given.get("INSTANCE", ""))
            scopes.append((card.word, name))
            if card.word == "PART":
                parts[name.lower()], names[name.lower()] = [], name
            elif card.word == "INSTANCE":
                part = card.given.get("PART", "")
                if part and part.lower() not in parts:
                    raise DeckError(f"the instance {name} is of a part {part}, which is not there")
                instances.append(Instance(name, part, card.rows))
                cards += [one._replace(scope=name) for one in parts.get(part.lower(), [])]
        elif card.word.startswith("END") and card.word[3:] in WITHIN:
            scopes = scopes[:-1] or scopes
        elif scopes[-1][0] == "PART":
            parts[scopes[-1][1].lower()].append(card)
        else:
            cards.append(card._replace(scope=scopes[-1][1] if scopes[-1][0] == "INSTANCE" else ""))
    if parts and not instances:  # a part that nothing places stands where it was drawn
        instances = [Instance(name, name, []) for name in names.values()]
        cards = [one._replace(scope=name) for key, name in names.items() for one in parts[key]] + cards
    return cards, instances
