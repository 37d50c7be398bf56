"""Keys of a scene as users write them: KEY=VALUE after ``--set``, entries of lists by name or number."""

from __future__ import annotations

import tomllib
from collections.abc import Iterator
from typing import Any

from ddmpi.errors import InputError
from ddmpi.scene.mistakes import name_of, nearest


def override(data: dict, setting: str) -> None:
    """Apply one ``KEY=VALUE`` to `data`: the value is TOML, or else a plain string. Raises InputError."""
    key, separator, value = setting.partition("=")
    if not separator or not key:
        raise InputError(f"--set {setting}: expected KEY=VALUE, as in method.theta=0.3")
    *parents, last = key.strip().split(".")
    table: Any = data
    for depth, part in enumerate(parents):
        table = table[_index(table, part, key)] if isinstance(table, list) else table.setdefault(part, {})
        if not isinstance(table, dict | list):
            raise InputError(f"--set {key}: {'.'.join(parents[:depth + 1])} is a value, not a table")
    table[_index(table, last, key) if isinstance(table, list) else last] = parse_value(value)


def parse_value(text: str) -> Any:
    """The meaning of the text after ``KEY=``: a TOML value, or else a plain string."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


def flatten(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested tables, each with its key."""
    if isinstance(value, list | tuple) and value and all(isinstance(entry, dict) for entry in value):
        value = {name_of(entry) or str(k): entry for k, entry in enumerate(value)}
    if isinstance(value, dict):
        for name, entry in value.items():
            yield from flatten(entry, f"{key}.{name}" if key else name)
    else:
        yield key, value


def differences(ours: dict, theirs: dict) -> str:
    """How two nested tables differ, in words: the first three keys with both values. Empty where they are the same."""
    def word(table: dict, key: str) -> str:
        return repr(table[key]) if key in table else "not set"

    here, there = dict(flatten(ours)), dict(flatten(theirs))
    differing = [key for key in here | there if here.get(key) != there.get(key)]
    words = [f"{key} is {word(here, key)} here, {word(there, key)} there" for key in differing[:3]]
    return "; ".join(words) + (f", and {len(differing) - 3} more" if len(differing) > 3 else "")


def _index(table: list, part: str, key: str) -> int:
    """Position of an entry of a list, given by name or number."""
    names = [name_of(entry) for entry in table]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(table):
        return int(part)
    named = [name for name in names if name]
    known = ", ".join(named) or (f"0 to {len(table) - 1}" if table else "none, the list is empty")
    raise InputError(f"--set {key}: there is no entry {part!r}{nearest(part, named)} (entries: {known})")
