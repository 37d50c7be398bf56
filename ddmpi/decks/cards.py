"""The keywords of an Abaqus or CalculiX deck, with their parameters and data lines; parts stand where they are used."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import NamedTuple

from ddmpi.decks.words import DeckError

WITHIN = ("PART", "INSTANCE", "ASSEMBLY")
"""Keywords that are ended by END and their name."""


class Card(NamedTuple):
    """One keyword of a deck.

    Attributes
    ----------
    word : the keyword in capitals without blanks, such as SOLIDSECTION
    given : its parameters, names in capitals without blanks, values as written
    rows : the entries of its data lines
    line : its number in `path`
    path : the file, which may be an included one
    name : the keyword in capitals, with single blanks
    scope : name of the instance to which it belongs; empty outside of instances
    place : its number in the deck with all that this includes
    """

    word: str
    given: Mapping[str, str]
    rows: list[list[str]]
    line: int
    path: Path
    name: str
    scope: str = ""
    place: int = 0

    def tells(self, what: object) -> str:
        """A message about this keyword, with its line and file."""
        return f"line {self.line} of {self.path.name}: *{self.name}: {what}"


class Notes:
    """What became of the keywords: taken, changed and lost. By keyword and reason: the lines by their places in the
    deck."""

    def __init__(self, main: Path) -> None:
        self.main = main
        self.taken: dict[tuple[str, str], dict[int, str]] = {}
        self.changed: dict[tuple[str, str], dict[int, str]] = {}
        self.lost: dict[tuple[str, str], dict[int, str]] = {}

    def add(self, where: dict[tuple[str, str], dict[int, str]], card: Card, reason: str) -> None:
        line = f"{card.line}" if card.path == self.main else f"{card.line} of {card.path.name}"
        where.setdefault((card.name, reason), {})[card.place] = line

    def words(self, where: dict[tuple[str, str], dict[int, str]]) -> Iterator[str]:
        """A line of text for each entry, in the order of the deck. A keyword that is lost, if only in part, is not
        listed as taken."""
        hidden = {place for lines in self.lost.values() for place in lines} if where is self.taken else set()
        entries = [(sorted(lines.keys() - hidden), key, lines) for key, lines in where.items()]
        for places, (name, reason), lines in sorted((entry for entry in entries if entry[0]), key=lambda e: e[0]):
            some = ", ".join(lines[place] for place in places[:6]) + f" and {len(places) - 6} more" * (len(places) > 6)
            yield f"line{'s' * (len(places) > 1)} {some}: *{name}: {reason}"


class Instance(NamedTuple):
    """A part as it stands in the assembly: names, and the rows that shift and turn it."""

    name: str
    part: str
    place: list[list[str]]


def read_cards(path: Path, within: tuple[Path, ...] = ()) -> Iterator[Card]:
    """Each keyword of a deck and of what it includes. Raises DeckError where a file includes
    itself or has none, and OSError."""
    if path in within:
        raise DeckError(f"{path} includes itself")
    text = path.read_text(encoding="utf-8", errors="replace").splitlines()
    lines = [(number, line.strip()) for number, line in enumerate(text, 1)]
    lines = [(number, line) for number, line in lines if line and not line.startswith("**")]
    starts = [k for k, (_, line) in enumerate(lines) if line.startswith("*")]
    if not starts:
        raise DeckError(f"it has no keyword, such as *NODE{f' in {path}' * bool(within)}")
    for start, end in zip(starts, [*starts, len(lines)][1:], strict=True):
        (number, head), first = lines[start], start + 1
        while head.endswith(",") and first < end and (first == start + 1 or "=" in lines[first][1]):
            head, first = head + lines[first][1], first + 1
        word, *rest = head[1:].split(",")
        parts = [entry.partition("=") for entry in rest]
        given = {"".join(name.split()).upper(): value.strip().strip('"') for name, _, value in parts}
        name = " ".join(word.split()).upper()
        if (word := name.replace(" ", "")) == "INCLUDE":
            if "INPUT" not in given:
                raise DeckError(f"line {number} of {path.name}: *{name}: it lacks INPUT")
            yield from read_cards(path.parent / given["INPUT"], (*within, path))
        else:
            rows = [[entry.strip() for entry in line.rstrip(", ").split(",")] for _, line in lines[first:end]]
            yield Card(word, given, rows, number, path, name)


def flattened(path: Path) -> tuple[list[Card], list[Instance]]:
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
