"""Keys of a scene as users write them: KEY=VALUE after ``--set``, entries of lists by name or number."""

from __future__ import annotations

import tomllib
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


def normalise(data: dict, key: str) -> str:
    """The one spelling of a key of `data`: entries of lists by number, PETSc options lower case without a dash.

    Parts of the key that `data` does not have stay as they are.
    """
    table: Any = data
    parts: list[str] = []
    for part in key.strip().split("."):
        if isinstance(table, list):
            try:
                part = str(_index(table, part, key))
            except InputError:  # `override` reports it
                table = None
        elif parts == ["petsc"]:
            part = part.lstrip("-").lower()
        parts.append(part)
        table = table[int(part)] if isinstance(table, list) else table.get(part) if isinstance(table, dict) else None
    return ".".join(parts)


def parse_value(text: str) -> Any:
    """The meaning of the text after ``KEY=``: a TOML value, or else a plain string."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except tomllib.TOMLDecodeError:
        return text.strip()


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
