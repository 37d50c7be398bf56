"""Warnings as values: those of one kind become one line that says how many there are, which is the worst, and where."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any, Self

from ddmpi.system.numbers import SAME

MOST = 4
"""Most subjects that a line names; of more the first two and the last one."""


class Doubt(str):
    """A warning: a text, with what is needed to put it together with others of its kind.

    Attributes
    ----------
    worst : the text of the worst one
    kind : what the warnings that become one line have in common
    size : how bad the worst one is, whatever the unit; the larger, the worse
    number : of warnings that are in the line
    of : what they are about, such as "body.pin" and "contact.pin-lug", each once, in the order of the scene
    """

    worst: str
    kind: str
    size: float
    number: int
    of: tuple[str, ...]

    def __new__(cls, text: str, kind: str = "", size: float = 0.0, of: str = "") -> Self:
        subject = of or _subject(text)
        return cls.of_parts(
            text, kind or kind_of(text), float(size), 1, (subject,) if subject else ()
        )

    @classmethod
    def of_parts(cls, worst: str, kind: str, size: float, number: int, of: Iterable[str]) -> Self:
        """A line of several warnings, by its attributes."""
        of = tuple(of)
        line = worst if number == 1 else f"{worst}; the worst of {number} such warnings{_named(of)}"
        doubt = super().__new__(cls, line)
        doubt.worst, doubt.kind, doubt.size, doubt.number, doubt.of = worst, kind, size, number, of
        return doubt

    def __reduce__(self) -> tuple[Any, ...]:
        return self.of_parts, self.parts

    @property
    def key(self) -> str:
        """By which two warnings of load steps are told apart: their kind, and what they are about."""
        return f"{self.kind} {' '.join(self.of)}"

    @property
    def parts(self) -> tuple[str, str, float, int, tuple[str, ...]]:
        """What `of_parts` makes the same one of, as a checkpoint keeps it."""
        return self.worst, self.kind, self.size, self.number, self.of

    def with_(self, other: Doubt) -> Doubt:
        """Both in one line, in which `other` comes later; of equally bad ones this one is told."""
        worse = other if other.size - self.size > SAME * abs(self.size) else self
        of = tuple(dict.fromkeys((*self.of, *other.of)))
        number = self.number + other.number
        return self.of_parts(worse.worst, self.kind, worse.size, number, of)

    def at_time(self, time: float) -> Doubt:
        """The same of a load step."""
        return self.of_parts(
            f"{self.worst} (at time {time:g})", self.kind, self.size, self.number, self.of
        )


def as_doubt(warning: str) -> Doubt:
    """A warning with its kind and what it is about, which its words tell of a plain text."""
    return warning if isinstance(warning, Doubt) else Doubt(warning)


def condensed(warnings: Iterable[str]) -> list[str]:
    """One line for each kind of warning, in the order of their first mention; equal lines count once.

    >>> condensed(
    ...     [
    ...         Doubt("body.a: moves by 1 m", "motion", 1.0),
    ...         Doubt("body.b: has no load", "load"),
    ...         Doubt("body.c: moves by 3 m", "motion", 3.0),
    ...     ]
    ... )
    ['body.c: moves by 3 m; the worst of 2 such warnings: body.a, body.c', 'body.b: has no load']

    The result may be condensed again, with more warnings.
    """
    by_kind = dict[str, Doubt]()
    for doubt in map(as_doubt, dict.fromkeys(warnings)):
        known = by_kind.get(doubt.kind)
        by_kind[doubt.kind] = known.with_(doubt) if known else doubt
    return list(by_kind.values())


def kind_of(warning: str) -> str:
    """A warning without its subject and its numbers; those in names stay."""
    rest = warning.removeprefix(_subject(warning))
    return re.sub(r"(?<![\w-])-?\d+(\.\d*)?(e[-+]?\d+)?", "#", rest)


def _subject(warning: str) -> str:
    """What a warning begins with: the body or contact that it is about; empty if it names none."""
    found = re.match(r"(?:body|contact|rigid|history)\.[^\s:]+", warning)
    return found[0] if found else ""


def _named(of: tuple[str, ...]) -> str:
    """The subjects in words, of many the first two and the last one."""
    if not of:
        return ""
    return ": " + (
        ", ".join(of) if len(of) <= MOST else f"{of[0]}, {of[1]}, … {of[-1]} ({len(of)} in all)"
    )
