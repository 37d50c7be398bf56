"""The cases of a sweep: ``--vary KEY=VALUES`` turned into scenes, all checked before the first one runs."""

from __future__ import annotations

import hashlib
import itertools
import math
import re
import tomllib
from collections.abc import Hashable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.scene.keys import normalise, override, parse_value
from ddmpi.scene.reader import read_scene
from ddmpi.scene.scene import Scene

LARGEST_SWEEP = 10_000
"""Most cases of one sweep; more than that is a slip of the finger."""

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
    scene: Scene

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
    first: dict[Hashable, str] = {}
    for value in values:
        meant = parse_value(value)
        if isinstance(meant, str) and any(key.startswith("petsc.") for key in keys):
            meant = parse_value(meant)  # to PETSc "200" and 200 are the same
        meaning = _meaning(meant)
        if meaning in first:
            other = f" (as {first[meaning]}, too)" if first[meaning] != value else ""
            raise InputError(f"--vary {text}: gives {value} more than once{other}")
        first[meaning] = value
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
        naming key and value that are not valid, or that are no value of their case because another --vary
        overrides it, and cases that would share a folder. Not collective: the same on every rank.
    """
    if not varied:
        raise InputError(f"a sweep needs --vary {_RANGE}")
    axes = tuple(parse_axis(each) for each in varied)
    data = _raw(text, settings)
    spellings: dict[str, list[str]] = {}
    for key in (key for axis in axes for key in axis.keys):
        spellings.setdefault(normalise(data, key), []).append(key)
    for keys in spellings.values():
        if len(keys) > 1:
            what = "are the same key" if len(set(keys)) > 1 else "is varied more than once"
            raise InputError(f"--vary: {' and '.join(dict.fromkeys(keys))} {what}")
    number = math.prod(len(axis.values) for axis in axes)
    if number > LARGEST_SWEEP:
        raise InputError(f"--vary: these are {number} cases; {LARGEST_SWEEP} is the limit of one sweep")
    cases = []
    for k, values in enumerate(itertools.product(*(axis.values for axis in axes))):
        chosen = {key: value for axis, value in zip(axes, values, strict=True) for key in axis.keys}
        cases.append(Case(k, chosen, axes, _read(path, text, settings, chosen)))
        _check_values(cases[-1])
    places: dict[str, Case] = {}
    for case in cases:
        other = places.setdefault(case.folder, case)
        if other is not case:
            raise InputError(f"--vary: the cases {other.label} and {case.label} would have the same folder, "
                             f"{case.folder}")
    return cases


def choose(cases: list[Case], index: str | None) -> list[Case]:
    """The cases that ``--index`` names: number I, or ``I/N``, every N-th one from number I on.

    Raises InputError. Not collective.
    """
    if index is None:
        return cases
    match = re.fullmatch(r"(\d+)(?:/(\d+))?", index, re.ASCII)
    if not match:
        raise InputError(f"--index {index}: expected a case's number, or I/N for every N-th case from I on")
    first, step = int(match[1]), match[2]
    if step is not None and int(step) == 0:
        raise InputError(f"--index {index}: there must be at least one share, as in 0/1")
    if step is not None and not first < int(step):
        raise InputError(f"--index {index}: the shares of {step} are 0/{step} to {int(step) - 1}/{step}")
    if step is None and first >= len(cases):
        raise InputError(f"--index {index}: there are {len(cases)} cases, 0 to {len(cases) - 1}")
    return cases[first::int(step)] if step else [cases[first]]


def _raw(text: str, settings: list[str]) -> dict:
    """The scene's data before anything is varied; empty where it is not valid, which `read_scene` says better."""
    try:
        data = tomllib.loads(text)
        for setting in settings:
            override(data, setting)
    except (tomllib.TOMLDecodeError, InputError):
        return {}
    return data


def _meaning(value: Any) -> Hashable:
    """The same for values that are the same, however they are written."""
    if isinstance(value, list):
        return tuple(map(_meaning, value))
    if isinstance(value, dict):
        return frozenset((key, _meaning(entry)) for key, entry in value.items())
    return (bool, value) if isinstance(value, bool) else value  # True == 1


def _check_values(case: Case) -> None:
    """InputError unless each varied value stands in the case's scene."""
    scene = case.scene.resolved()
    scene["petsc"] = _undashed(scene["petsc"])
    for key, value in case.values.items():
        one, there = normalise(scene, key), scene
        try:
            for part in one.split("."):
                there = there[int(part)] if isinstance(there, list | tuple) else there[part]
        except (LookupError, TypeError, ValueError):
            there = None
        if not _stands(_undashed(value) if one == "petsc" else value, there):
            raise InputError(f"--vary {key}={case.settings[key]}: comes to nothing, another --vary makes it {there!r}")


def _undashed(options: dict[str, Any]) -> dict[str, Any]:
    """PETSc's options by the names that `normalise` gives them."""
    return {name.lstrip("-").lower(): value for name, value in options.items()}


def _stands(value: Any, there: Any) -> bool:
    """Whether what was asked for is what is there; a table may have further entries."""
    if isinstance(value, dict):
        return isinstance(there, dict) and all(name in there and _stands(entry, there[name])
                                               for name, entry in value.items())
    if isinstance(value, list):
        return isinstance(there, list | tuple) and len(value) == len(there) and all(map(_stands, value, there))
    return value == there


def _read(path: str, text: str, settings: list[str], chosen: dict[str, str]) -> Scene:
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
    return isinstance(value, int | float) and not isinstance(value, bool) and bool(np.isfinite(value))


def _split(text: str, at: str) -> list[str]:
    """Split where no bracket, brace or quotation mark is open."""
    parts, depth, quote = [""], 0, ""
    for character in text:
        if quote:
            quote = "" if character == quote else quote
        elif character in "'\"":
            quote = character
        elif character in "[{":
            depth += 1
        elif character in "]}":
            depth -= 1
        if character == at and not quote and depth == 0:
            parts.append("")
        else:
            parts[-1] += character
    return [part.strip() for part in parts]
