"""Reading a scene: TOML text and ``--set`` to a settled scene, or one InputError with file and key; and writing it."""

from __future__ import annotations

import json
import os
import re
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ddmpi.errors import InputError
from ddmpi.scene.keys import explain, explain_syntax, override
from ddmpi.scene.scene import FileKind, Scene, Settled

DEEP = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){100}""")
"""A key of a hundred parts; tomllib's time grows with the square of their number."""


def read_data(path: str, text: str, settings: Sequence[str] = ()) -> dict:
    """The data of TOML `text` with ``KEY=VALUE`` settings, not yet checked; parameters and errors of `read_scene`."""
    if DEEP.search(text):
        raise InputError(f"{path}: is nested too deeply")
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {explain_syntax(error, text)}") from None
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply") from None
    except ValueError as error:  # an integer of too many digits
        raise InputError(f"{path}: not valid TOML: {str(error).split(';')[0]}") from None
    for setting in settings:
        override(data, setting)
    return data


def read_scene(path: str, text: str, settings: Sequence[str] = (), file_kind: FileKind | None = None) -> Settled:
    """Check a scene of TOML text and ``KEY=VALUE`` settings, and fill in what it leaves out.

    Parameters
    ----------
    path : the file's name, for messages only
    text : its contents
    settings : as after ``--set``; applied in order, before validation
    file_kind : gives dimension and order of a body's mesh file; without it, files count as plane and linear

    Raises InputError, the same on every rank, that names file and key. Not collective.
    """
    data = read_data(path, text, settings)
    try:
        return msgspec.convert(data, Scene).settled(file_kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {explain(str(error), data, Scene)}") from None
    except (ValueError, InputError) as error:
        raise InputError(f"{path}: {error}") from None


def read_scene_file(path: str | Path, settings: Sequence[str] = (), file_kind: FileKind | None = None) -> Settled:
    """`read_scene` on a file. Not collective."""
    return read_scene(str(path), read_text(path), settings, file_kind)


def read_text(path: str | Path) -> str:
    """The text of a scene file, or an InputError that names it."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8") from None


def write_toml(scene: dict) -> str:
    """A resolved scene, `Settled.resolved`, as TOML text that is read as this scene again. Not collective."""
    plain = {key: value for key, value in scene.items() if not _is_table(value)}
    lines = [f"{_key(key)} = {write_value(value)}\n" for key, value in plain.items() if value not in (None, [], {})]
    for key, value in scene.items():
        if isinstance(value, list) and key not in plain:
            lines += [f"\n[[{_key(key)}]]\n{_entries(each)}" for each in value]
        elif key not in plain and all(_is_table(each) for each in value.values()):
            lines += [f"\n[{_key(key)}.{_key(name)}]\n{_entries(each)}" for name, each in value.items()]
        elif key not in plain:
            lines.append(f"\n[{_key(key)}]\n{_entries(value)}")
    return "".join(lines)


def _is_table(value: Any) -> bool:
    """Whether `value` is a table that holds something, or a list of tables."""
    return bool(value) and (isinstance(value, dict) or (isinstance(value, list) and isinstance(value[0], dict)))


def _entries(table: dict) -> str:
    """A line for each key that has a value."""
    return "".join(f"{_key(key)} = {write_value(value)}\n" for key, value in table.items()
                   if value not in (None, [], {}))


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else write_value(key)


def write_table(table: Mapping[str, Any]) -> str:
    """A table as TOML text, a line per key; errors and None as in `write_value`. Not collective."""
    return "".join(f"{line}\n" for line in _lines(table))


def _lines(table: Mapping[str, Any]) -> list[str]:
    return [f"{_key(str(key))} = {write_value(value)}" for key, value in table.items() if value is not None]


def write_value(value: Any) -> str:
    """A value as TOML text, on one line but for lists of several tables; entries of tables that are None are left out.

    Raises InputError where TOML has no such value. Not collective.
    """
    if isinstance(value, np.generic | np.ndarray):
        value = value.tolist()
    if isinstance(value, Mapping):
        inside = ", ".join(_lines(value))
        return f"{{ {inside} }}" if inside else "{}"
    if isinstance(value, list | tuple):
        several = len(value) > 1 and _is_table(value)
        start, between, end = ("[\n    ", ",\n    ", ",\n]") if several else ("[", ", ", "]")
        return start + between.join(map(write_value, value)) + end
    if isinstance(value, str | bool | os.PathLike):  # JSON's words and strings are TOML's
        word = value if isinstance(value, bool) else os.fspath(value)
        return json.dumps(word, ensure_ascii=False).replace("\x7f", "\\u007f")
    if isinstance(value, int | float):
        return repr(value)
    raise InputError(f"{value!r} is no value of a scene; give numbers, words, lists or tables")
