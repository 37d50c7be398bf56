"""Keys of a scene as users write them: KEY=VALUE after ``--set``, and messages that name the key."""

from __future__ import annotations

import tomllib
from typing import Any

from ddmpi.errors import InputError
from ddmpi.scene.mistakes import nearest


def override(data: dict, setting: str) -> None:
    """Apply one ``KEY=VALUE``: the value is TOML, or else a plain string."""
    key, separator, value = setting.partition("=")
    if not separator or not key:
        raise InputError(f"--set {setting}: expected KEY=VALUE, as in method.theta=0.3")
    value = parse_value(value)
    *parents, last = key.strip().split(".")
    table: Any = data
    for depth, part in enumerate(parents):
        table = table[_index(table, part, key)] if isinstance(table, list) else table.setdefault(part, {})
        if not isinstance(table, dict | list):
            raise InputError(f"--set {key}: {'.'.join(parents[:depth + 1])} is a value, not a table")
    if isinstance(table, list):
        table[_index(table, last, key)] = value
    else:
        table[last] = value


def normalise(data: dict, key: str) -> str:
    """The one spelling of a key of `data`: entries of lists by number, PETSc's options without dash or capitals.

    From where it leads to nothing, it stays as it is.
    """
    table, parts = data, []
    for part in key.strip().split("."):
        if isinstance(table, list):
            try:
                part = str(_index(table, part, key))
            except InputError:  # whoever sets it says so
                table = None
        elif parts == ["petsc"]:
            part = part.lstrip("-").lower()
        parts.append(part)
        table = table[int(part)] if isinstance(table, list) else table.get(part) if isinstance(table, dict) else None
    return ".".join(parts)


def parse_value(text: str) -> Any:
    """What stands after KEY= on the command line: a TOML value, or else a plain string."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


def _index(table: list, part: str, key: str) -> int:
    """Position in an array of tables, by number or by the entry's name."""
    names = [entry["name"] for entry in table if isinstance(entry, dict) and "name" in entry]
    if part in names:
        return names.index(part)
    if part.isdecimal() and int(part) < len(table):
        return int(part)
    known = names or [f"0 to {len(table) - 1}" if table else "none, the list is empty"]
    raise InputError(f"--set {key}: there is no entry {part!r}; there are {', '.join(known)}{nearest(part, names)}")
