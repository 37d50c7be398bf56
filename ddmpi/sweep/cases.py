"""The cases of a sweep: ``--vary KEY=VALUES`` turned into scenes, all checked before the first one runs."""

import hashlib
import itertools
import math
import re
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.scene.keys import parse_value
from ddmpi.scene.reader import read_scene
from ddmpi.scene.scene import FileKind, Settled

LARGEST_SWEEP = 10_000  # largest number of cases of a sweep; more is a typing error
LONGEST_NAME = 150  # longest name of a case's folder, or of a plot, before it is cut, in bytes (file systems allow 255)

_RANGE = "KEY=first:last:number, with :log at the end for equal ratios (of positive numbers), or KEY=value,value,…"


@dataclass(frozen=True)
class Case:
    """One scene of a sweep."""

    number: int  # position in the sweep, from 0
    settings: dict[str, str]  # value by key, as written on the command line
    named: dict[str, str]  # the same, with only the first of keys that vary together
    scene: Settled  # with these settings

    @property
    def values(self) -> dict[str, Any]:
        """Value by varied key; numbers as numbers."""
        return {key: parse_value(text) for key, text in self.settings.items()}

    @property
    def label(self) -> str:
        return ", ".join(f"{key}={text}" for key, text in self.named.items())

    @property
    def folder(self) -> str:
        """Name of the case's folder: its settings, whatever the other cases are, in characters that no shell minds."""
        parts = [f"{key}={_plain(text)}" for key, text in self.named.items()]
        safe = ",".join(re.sub(r"[^\w.+=-]", "_", part, flags=re.ASCII) for part in parts)
        return cut(safe, self.label, safe != ",".join(parts))


def cut(name: str, label: str, changed: bool = False) -> str:
    """The name of a file or folder, not too long; one that is cut, or was `changed`, ends with a hash of its label."""
    short = name.encode()[:LONGEST_NAME].decode(errors="ignore")
    return (
        name
        if name == short and not changed
        else f"{short}-{hashlib.sha256(label.encode()).hexdigest()[:8]}"
    )


def _plain(text: str) -> str:
    """A value for the name of a folder; a list as in 66x22."""
    value = parse_value(text)
    return (
        "x".join(map(str, value))
        if isinstance(value, list)
        else str(value)
        if isinstance(value, str)
        else text
    )


def parse_axis(text: str) -> tuple[list[str], list[str]]:
    """Keys and values of one --vary: ``KEY=a:b:n``, ``KEY=a:b:n:log`` or ``KEY=v1,v2``; ``KEY,KEY=…`` vary together.

    Raises InputError. Not collective.
    """
    left, _, right = text.partition("=")
    keys = [key.strip() for key in left.split(",")]
    first, colon, _ = right.partition(":")
    values = _spaced(right) if colon and _is_number(first) else _split(right)
    if not values or not all([*keys, *values]):
        raise InputError(f"--vary {text}: expected {_RANGE}")
    return keys, values


def _spaced(text: str) -> list[str]:
    """The numbers of first:last:number[:log], both ends as they are written; none where it is not valid."""
    match = re.fullmatch(r"(.+?):(.+?):(\d{1,5})(:log)?", text, re.ASCII)
    if not match or not _is_number(match[2]):
        return []
    first, last, number, log = match.groups()
    a, b = float(parse_value(first)), float(parse_value(last))
    if int(number) < 2 or (log and min(a, b) <= 0):
        return []
    spaced = np.geomspace(a, b, int(number)) if log else np.linspace(a, b, int(number))
    # Twelve digits give 0.3, not 0.30000000000000004.
    return [
        first,
        *(f"{value:.12g}" for value in spaced[1:-1]),
        last,
    ]


def _is_number(text: str) -> bool:
    value = parse_value(text)
    return type(value) in (int, float) and math.isfinite(value)


def _split(text: str) -> list[str]:
    """Split at commas where no bracket, brace or quotation mark is open."""
    parts, depth = [""], 0
    for piece in re.findall(r"'[^']*'?|\"[^\"]*\"?|.", text, re.DOTALL):
        depth += (piece in "[{") - (piece in "]}")
        if piece == "," and depth == 0:
            parts.append("")
        else:
            parts[-1] += piece
    return [part.strip() for part in parts]


def build_cases(
    path: str, scene: dict, varied: list[str], file_kind: FileKind | None = None
) -> list[Case]:
    """The cases of a sweep: all combinations of the `varied` keys, the last --vary running fastest.

    `path`, `scene` and `file_kind` are as for `read_scene`. Raises InputError, the same on every rank, that names a
    key or value that is not valid, a bolt without a force, or two cases that are the same. Not collective.
    """
    if not varied:
        raise InputError(f"a sweep needs --vary {_RANGE}")
    axes = [parse_axis(text) for text in varied]
    number = math.prod(len(values) for _, values in axes)
    if number > LARGEST_SWEEP:
        raise InputError(
            f"--vary: these are {number} cases; {LARGEST_SWEEP} is the limit of one sweep"
        )
    cases: list[Case] = []
    known: dict[str, Case] = {}
    for chosen in itertools.product(*(values for _, values in axes)):
        settings = {
            key: value for (keys, _), value in zip(axes, chosen, strict=True) for key in keys
        }
        named = {keys[0]: settings[keys[0]] for keys, _ in axes}
        varying = [f"{key}={value}" for key, value in settings.items()]
        try:
            case = Case(len(cases), settings, named, read_scene(path, scene, varying, file_kind))
            case.scene.refuse_forceless()
        except InputError as error:
            raise InputError(
                f"--vary {' '.join(varying)}: {str(error).removeprefix('--set ')}"
            ) from None
        cases.append(case)
        for mark in (
            case.folder,
            repr(case.scene),
        ):  # a value given twice, or a key that another --vary sets
            other = known.setdefault(mark, case)
            if other is not case:
                raise InputError(f"--vary: the cases {other.label} and {case.label} are the same")
    return cases


def choose(cases: list[Case], index: str | None) -> list[Case]:
    """The cases of ``--index``: I, or ``I/N``, every N-th from I on. Raises InputError. Not collective."""
    if index is None:
        return cases
    match = re.fullmatch(r"(\d+)(?:/(\d+))?", index, re.ASCII)
    step = int(match[2] or len(cases)) if match else 0
    if not match or int(match[1]) >= step:
        raise InputError(
            f"--index {index}: expected the number of a case, 0 to {len(cases) - 1}, or I/N with I < N "
            "for every N-th case from I on"
        )
    return cases[int(match[1]) :: step]
