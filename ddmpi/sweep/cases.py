"""The cases of a sweep: ``--vary KEY=VALUES`` turned into scenes, all checked before the first one runs."""

from __future__ import annotations

import hashlib
import itertools
import math
import re
import tomllib
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.scene.keys import normalise, override, parse_value
from ddmpi.scene.reader import read_scene
from ddmpi.scene.scene import Settled

LARGEST_SWEEP = 10_000
"""Most cases of one sweep; more than that is a typing error."""

LONGEST_NAME = 150
"""Longest name of a case's folder before it is cut (file systems allow 255 bytes)."""

_RANGE = "KEY=first:last:number, with :log at the end for equal ratios, or KEY=value,value,…"


@dataclass(frozen=True)
class Axis:
    """One --vary: `keys` that take the same value, and the `values` they take, as written after KEY=."""

    keys: tuple[str, ...]
    values: tuple[str, ...]


@dataclass(frozen=True)
class Case:
    """One scene of a sweep.

    Attributes
    ----------
    number : position in the sweep, from 0
    settings : value by key, as written on the command line
    scene : with these settings
    """

    number: int
    settings: dict[str, str]
    axes: tuple[Axis, ...]
    scene: Settled

    @property
    def values(self) -> dict[str, Any]:
        """Value by varied key; numbers as numbers."""
        return {key: parse_value(text) for key, text in self.settings.items()}

    @property
    def label(self) -> str:
        """The settings in words, keys that vary together once."""
        return ", ".join(f"{axis.keys[0]}={self.settings[axis.keys[0]]}" for axis in self.axes)

    @property
    def folder(self) -> str:
        """Name of the folder with the case's results: its settings, in characters that no shell minds.

        It does not depend on the other cases, so that a sweep can be extended by more values.
        """
        parts = [f"{axis.keys[0]}={_plain(self.settings[axis.keys[0]])}" for axis in self.axes]
        safe = ",".join(re.sub(r"[^\w.+=-]", "_", part, flags=re.ASCII) for part in parts)
        if safe == ",".join(parts) and len(safe) <= LONGEST_NAME:
            return safe
        return f"{safe[:LONGEST_NAME]}-{hashlib.sha256(self.label.encode()).hexdigest()[:8]}"


def _plain(text: str) -> str:
    """A value for the name of a folder; a list as in 66x22."""
    value = parse_value(text)
    return "x".join(map(str, value)) if isinstance(value, list) else str(value) if isinstance(value, str) else text


def parse_axis(text: str) -> Axis:
    """One --vary: ``KEY=a:b:n``, ``KEY=a:b:n:log`` or ``KEY=v1,v2``; ``KEY,KEY=…`` vary together.

    Raises InputError. Not collective.
    """
    left, separator, right = text.partition("=")
    keys = tuple(key.strip() for key in left.split(","))
    if not separator or not all(keys):
        raise InputError(f"--vary {text}: expected {_RANGE}")
    pieces = _split(right, ":")
    values = _spaced(pieces, text) if len(pieces) > 1 and _is_number(pieces[0]) else _split(right, ",")
    if not all(values):
        raise InputError(f"--vary {text}: a value is missing; expected {_RANGE}")
    first: dict[str, str] = {}
    for value in values:
        other = first.get(_meaning(value))
        if other is not None:
            raise InputError(f"--vary {text}: gives {value} more than once"
                             f"{f' (as {other}, too)' * (other != value)}")
        first[_meaning(value)] = value
    return Axis(keys, tuple(values))


def build_cases(path: str, text: str, settings: list[str], varied: list[str]) -> list[Case]:
    """The cases of a sweep: all combinations, the last --vary running fastest.

    Parameters
    ----------
    path, text, settings : of the scene, as for `read_scene`
    varied : as after --vary

    Raises
    ------
    InputError
        naming a key or value that is not valid, a key that is varied twice, one that another --vary overrides, and
        cases that would share a folder. Not collective: the same on every rank.
    """
    if not varied:
        raise InputError(f"a sweep needs --vary {_RANGE}")
    axes = tuple(parse_axis(each) for each in varied)
    _refuse_overridden(base_scene(text, settings), [key for axis in axes for key in axis.keys])
    number = math.prod(len(axis.values) for axis in axes)
    if number > LARGEST_SWEEP:
        raise InputError(f"--vary: these are {number} cases; {LARGEST_SWEEP} is the limit of one sweep")
    places: dict[str, Case] = {}
    for k, values in enumerate(itertools.product(*(axis.values for axis in axes))):
        chosen = {key: value for axis, value in zip(axes, values, strict=True) for key in axis.keys}
        case = Case(k, chosen, axes, _read(path, text, settings, chosen))
        other = places.setdefault(case.folder, case)
        if other is not case:
            raise InputError(f"--vary: the cases {other.label} and {case.label} would have the same folder, "
                             f"{case.folder}")
    return list(places.values())


def choose(cases: list[Case], index: str | None) -> list[Case]:
    """The cases that ``--index`` names: number I, or ``I/N``, every N-th one from number I on.

    Raises InputError. Not collective.
    """
    if index is None:
        return cases
    match = re.fullmatch(r"(\d+)(?:/(\d+))?", index, re.ASCII)
    if not match:
        raise InputError(f"--index {index}: expected a case's number, or I/N for every N-th case from I on")
    first, step = int(match[1]), int(match[2] or len(cases))
    if first >= step:
        raise InputError(f"--index {index}: there are {step} {'shares' if match[2] else 'cases'}, numbered from 0 "
                         f"to {step - 1}")
    return cases[first::step]


def base_scene(text: str, settings: list[str]) -> dict:
    """The scene's data before anything is varied; empty where it is not valid, which `read_scene` reports better."""
    try:
        data = tomllib.loads(text)
        for setting in settings:
            override(data, setting)
    except (tomllib.TOMLDecodeError, InputError):
        return {}
    return data


def _refuse_overridden(data: dict, keys: list[str]) -> None:
    """InputError where two `keys` of the scene `data` are the same, or a later one is a table with an earlier one."""
    before: dict[str, str] = {}
    for key in keys:
        one = normalise(data, key)
        for other, spelling in before.items():
            if other == one:
                raise InputError(f"--vary: {key} is varied more than once" if key == spelling else
                                 f"--vary: {spelling} and {key} are the same key")
            if other.startswith(f"{one}."):
                raise InputError(f"--vary {spelling}: would be overridden by --vary {key}, which comes later; exchange "
                                 "the two")
        before[one] = key


def _meaning(text: str) -> str:
    """The same for values that are the same number, however they are written."""
    value = parse_value(text)
    return repr(float(value)) if type(value) in (int, float) else repr(value)


def _read(path: str, text: str, settings: list[str], chosen: dict[str, str]) -> Settled:
    """The scene of one case; an error names the --vary that made it, unless the scene itself is wrong."""
    try:
        return read_scene(path, text, [*settings, *(f"{key}={value}" for key, value in chosen.items())])
    except InputError as error:
        message = str(error)
        try:
            read_scene(path, text, settings)
        except InputError as own:
            if str(own) == message:
                raise
        label = " ".join(f"{key}={value}" for key, value in chosen.items())
        raise InputError(f"--vary {label}: {message.removeprefix('--set ')}") from None


def _spaced(pieces: list[str], text: str) -> list[str]:
    """Equally spaced numbers, or numbers in equal ratios, the ends as they are written; whole ones are integers."""
    kind = pieces[3:] or ["linear"]
    if len(pieces) not in (3, 4) or kind not in (["linear"], ["log"]):
        raise InputError(f"--vary {text}: expected {_RANGE}")
    first, last = pieces[:2]
    if not _is_number(last):
        raise InputError(f"--vary {text}: {last!r} is not a number; expected {_RANGE}")
    if not (re.fullmatch(r"\d+", pieces[2], re.ASCII) and int(pieces[2]) >= 2):
        raise InputError(f"--vary {text}: {pieces[2]!r} is not a number of values, two or more")
    number, a, b = int(pieces[2]), float(parse_value(first)), float(parse_value(last))
    if number > LARGEST_SWEEP:
        raise InputError(f"--vary {text}: {number} values; {LARGEST_SWEEP} is the limit of one sweep")
    if kind == ["log"] and not (a > 0 and b > 0):
        raise InputError(f"--vary {text}: both ends of a log spacing must be positive")
    if a == b:
        raise InputError(f"--vary {text}: both ends are the same")
    spaced = np.geomspace(a, b, number) if kind == ["log"] else np.linspace(a, b, number)
    between = [f"{value:.12g}" for value in spaced[1:-1]]  # 0.3 rather than 0.30000000000000004
    return [first, *between, last]


def _is_number(text: str) -> bool:
    value = parse_value(text)
    return type(value) in (int, float) and math.isfinite(value)


def _split(text: str, at: str) -> list[str]:
    """Split where no bracket, brace or quotation mark is open."""
    parts, depth = [""], 0
    for piece in re.findall(r"'[^']*'?|\"[^\"]*\"?|.", text, re.DOTALL):
        depth += (piece in "[{") - (piece in "]}")
        if piece == at and depth == 0:
            parts.append("")
        else:
            parts[-1] += piece
    return [part.strip() for part in parts]
