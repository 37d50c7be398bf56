"""Keys of a scene as users write them: KEY=VALUE after ``--set``, and entries of lists by name or number."""

import tomllib
from collections.abc import Iterator
from typing import Any

from ddmpi.errors import InputError, nearest
from ddmpi.scene.contacts import LAWS, default_name


def override(data: dict, key: str, value: Any, where: str = "--set ") -> None:
    """Set one key of `data`, as after ``--set``. Raises InputError, which begins with `where` and the key."""
    *parents, last = key.strip().split(".")
    key = f"{where}{key}"
    table: Any = data
    for depth, part in enumerate(parents):
        table = (
            table[_index(table, part, key)]
            if isinstance(table, list)
            else table.setdefault(part, {})
        )
        if not isinstance(table, dict | list):
            raise InputError(f"{key}: {'.'.join(parents[: depth + 1])} is a value, not a table")
    table[_index(table, last, key) if isinstance(table, list) else last] = value
    if last == "law" and isinstance(value, str) and value in LAWS:  # what other laws need goes
        for name in set(table) - LAWS[value]:
            del table[name]


def looked_up(data: dict, key: str, where: str = "--set ") -> Any:
    """The value of a key of `data`. Raises InputError, which begins with `where` and the key."""
    value: Any = data
    for part in key.strip().split("."):
        if isinstance(value, list):
            value = value[_index(value, part, f"{where}{key}")]
        elif isinstance(value, dict) and part in value:
            value = value[part]
        else:
            known = list(value) if isinstance(value, dict) else []
            raise InputError(
                f"{where}{key}: the scene has no {part!r} there{nearest(part, known)} "
                f"(there: {', '.join(known) or 'a value'})"
            )
    return value


def parse_value(text: str) -> Any:
    """The meaning of the text after ``KEY=``: a TOML value, or else a plain string."""
    try:
        return tomllib.loads(f"value = {text}")["value"]
    except (ValueError, RecursionError):
        return text.strip()


def flatten(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested tables with their keys."""
    if (
        isinstance(value, list | tuple)
        and value
        and all(isinstance(entry, dict) for entry in value)
    ):
        value = {name_of(entry) or str(k): entry for k, entry in enumerate(value)}
    if isinstance(value, dict):
        for name, entry in value.items():
            yield from flatten(entry, f"{key}.{name}" if key else name)
    else:
        yield key, value


def differences(ours: dict, theirs: dict) -> str:
    """The differences of two nested tables, in words: the first three keys with both values. Empty for equal ones."""

    def word(table: dict, key: str) -> str:
        return repr(table[key]) if key in table else "not set"

    mine = dict(flatten(ours))
    others = dict(flatten(theirs))
    differing = [key for key in mine | others if mine.get(key) != others.get(key)]
    words = [f"{key} is {word(mine, key)} here, {word(others, key)} there" for key in differing[:3]]
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
    raise InputError(f"{key}: there is no entry {part!r}{nearest(part, named)} (entries: {known})")


def name_of(entry: Any) -> str | None:
    """The name that keys may use for an entry of a list in a scene's data; None if it has no name."""
    name, bodies = (
        (entry.get("name"), entry.get("bodies")) if isinstance(entry, dict) else (None, None)
    )
    if name is None and isinstance(bodies, list) and all(isinstance(body, str) for body in bodies):
        name = default_name(bodies)
    return name if isinstance(name, str) and name else None
