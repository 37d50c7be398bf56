"""Reading a scene: TOML text and ``--set`` to a settled scene, or one InputError with file and key; and writing it."""

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
from ddmpi.scene.copies import expanded
from ddmpi.scene.keys import name_of, override, parse_value
from ddmpi.scene.meshes import GEOMETRIES
from ddmpi.scene.mistakes import explain, explain_syntax
from ddmpi.scene.petsc import code_of, refuse_reaching
from ddmpi.scene.scene import FileKind, Scene, Settled

DEEP = re.compile(r"""(?<![\w"'-])(?:[\w"'-]++\s*+\.\s*+){100}""")
"""A key of a hundred parts; the time of tomllib grows with the square of their number."""

MESHES = {"file": (".inp", ".msh", ".med", ".vtu", ".vtk"), "geometry": GEOMETRIES}
"""Endings of files of meshes and drawings, by the key that names such a file in a scene."""

NESTED = 100
"""Deepest nesting of tables and lists in the data of a program, which may contain themselves."""


def read_data(path: str, scene: str | Mapping[str, Any], settings: Sequence[str] = ()) -> dict:
    """The data of a scene with ``KEY=VALUE`` settings, not yet checked; parameters and errors of `read_scene`."""
    try:
        if isinstance(scene, str) and DEEP.search(scene):
            raise RecursionError
        data = tomllib.loads(scene) if isinstance(scene, str) else as_data(scene, path)
    except tomllib.TOMLDecodeError as error:
        raise InputError(
            _no_scene(path) or f"{path}: not valid TOML: {explain_syntax(error, str(scene))}"
        ) from None
    except RecursionError:
        raise InputError(f"{path}: is nested too deeply") from None
    except ValueError as error:  # an integer of too many digits
        raise InputError(f"{path}: not valid TOML: {str(error).split(';')[0]}") from None
    named = refuse_reaching(path, data) if isinstance(scene, str) else ""
    _set(data, settings)
    if named and isinstance(method := data["method"], dict) and "outer" not in method:
        raise InputError(f"{path}: {code_of(named)}")
    return data


def _set(data: dict, settings: Sequence[str]) -> None:
    """Put ``KEY=VALUE`` settings into the data. Raises InputError."""
    for setting in settings:
        key, separator, value = setting.partition("=")
        if not separator or not key:
            raise InputError(f"--set {setting}: expected KEY=VALUE, as in method.theta=0.3")
        if re.search(
            "[\ud800-\udfff]", setting
        ):  # how Python keeps bytes of the command line that are no text
            raise InputError(f"--set {setting!a}: not text in UTF-8")
        override(data, key, parse_value(value))


def as_data(value: Any, where: str, *key: str) -> Any:
    """A copy of a program's value of a `key` in the types of TOML; entries of tables that are None are left out.

    Raises InputError, which begins with `where` and the key, for other types.
    """
    if len(key) > NESTED:
        raise InputError(f"{where}: {'.'.join(key[:3])}…: is nested too deeply, or contains itself")
    if (
        isinstance(value, np.generic | np.ndarray) and value.dtype.kind not in "mM"
    ):  # dates may be integers of numpy
        value = value.tolist()
    if isinstance(value, os.PathLike):
        value = os.fspath(value)
    if isinstance(value, Mapping):
        return {
            str(name): as_data(entry, where, *key, str(name))
            for name, entry in value.items()
            if entry is not None
        }
    if isinstance(value, list | tuple):
        return [
            as_data(entry, where, *key, name_of(entry) or str(k)) for k, entry in enumerate(value)
        ]
    if isinstance(
        value, str
    ):  # also of types that are based on these, such as enumerations of words
        if re.search("[\ud800-\udfff]", value):
            raise InputError(f"{where}: {'.'.join(key)}: {value!a} is not text in UTF-8")
        return "".join(value)
    for kind, like in (bool, bool), (int, int), (float, float | np.longdouble):
        if isinstance(value, like):
            return kind(value)
    raise InputError(
        f"{where}: {'.'.join(key)}: {value!r} is no value of a scene; give numbers, words, lists or "
        "tables"
    )


def read_scene(
    path: str,
    scene: str | Mapping[str, Any],
    settings: Sequence[str] = (),
    file_kind: FileKind | None = None,
) -> Settled:
    """A scene of TOML text, or of tables, with ``KEY=VALUE`` settings as after ``--set``: checked, with all defaults.

        >>> scene = read_scene("punch.toml", read_text("configs/punch.toml"), ["contact.0.friction.coefficient=0.5"])
        >>> scene.contact[0].name, scene.contact[0].friction, scene.method.outer
        ('punch-base', Coulomb(coefficient=0.5), 'newton')

    `path` stands in messages. `file_kind` gives dimension and order of a body's mesh file; without it, files count as
    plane and linear. Raises InputError, the same on all ranks, with file and key. Not collective.
    """
    return checked(path, read_data(path, scene, settings), file_kind)


def checked(path: str, data: dict, file_kind: FileKind | None = None) -> Settled:
    """The scene of `read_data`, as of `read_scene`. Not collective."""
    try:
        data = expanded(data)
        return msgspec.convert(data, Scene).settled(file_kind)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {explain(str(error), data, Scene)}") from None
    except (ValueError, InputError) as error:
        raise InputError(f"{path}: {error}") from None


def read_scene_file(
    path: str | Path, settings: Sequence[str] = (), file_kind: FileKind | None = None
) -> Settled:
    """`read_scene` on a file. Not collective."""
    return read_scene(str(path), read_text(path), settings, file_kind)


def read_text(path: str | Path) -> str:
    """The text of a scene file, or an InputError that names it."""
    try:
        return Path(path).read_text(encoding="utf-8-sig")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(_no_scene(path) or f"{path}: not a text file in UTF-8") from None


def _no_scene(path: str | Path) -> str:
    """The error of a file given as a scene that is a mesh or a drawing by its name; else empty."""
    ending = Path(path).suffix.lower()
    key = next((key for key, endings in MESHES.items() if ending in endings), "")
    what = "an Abaqus or CalculiX deck" if ending == ".inp" else f"a {ending[1:].upper()} file"
    return key and (
        f"{path}: {what}, and no scene; a scene is a file in TOML, where a body names this one: "
        f"mesh = {{ {key} = {to_toml(Path(path).name)} }}"
    )


def write_toml(scene: dict) -> str:
    """A resolved scene, `Settled.resolved`, as TOML text that is read as this scene again. Not collective.

    >>> print(write_toml({"title": "A punch", "method": {"tolerance": 1e-8}}), end="")
    title = "A punch"
    <BLANKLINE>
    [method]
    tolerance = 1e-08
    """
    nested = {key: value for key, value in scene.items() if _is_table(value)}
    parts = [_entries({key: value for key, value in scene.items() if key not in nested})]
    for key, value in nested.items():
        if isinstance(value, list):
            parts += [f"[[{_key(key)}]]\n{_entries(entry)}" for entry in value]
        elif all(_is_table(entry) for entry in value.values()):
            parts += [
                f"[{_key(key)}.{_key(name)}]\n{_entries(entry)}" for name, entry in value.items()
            ]
        else:
            parts.append(f"[{_key(key)}]\n{_entries(value)}")
    return "\n\n".join(parts) + "\n"


def write_entry(key: str, value: Any) -> str:
    """A key with a value as TOML. Not collective.

    >>> write_entry("clamp", [7, {"on": "top", "x": 0.0, "y": None}])
    'clamp = [7, { on = "top", x = 0.0 }]'
    """
    return f"{_key(key)} = {to_toml(value)}"


def _is_table(value: Any) -> bool:
    """Whether `value` is a table with entries, or a list of tables."""
    return bool(value) and (
        isinstance(value, dict) or (isinstance(value, list) and isinstance(value[0], dict))
    )


def _entries(table: dict, between: str = "\n") -> str:
    """Those keys of a table that have a value."""
    return between.join(
        write_entry(key, value) for key, value in table.items() if value not in (None, [], {})
    )


def _key(key: str) -> str:
    return key if re.fullmatch(r"[A-Za-z0-9_-]+", key) else to_toml(key)


def to_toml(value: Any) -> str:
    """A value on one line, but for lists of several tables."""
    if isinstance(value, dict):
        return f"{{ {_entries(value, ', ')} }}"
    if isinstance(value, list | tuple):
        several = len(value) > 1 and _is_table(value)
        start, between, end = ("[\n    ", ",\n    ", ",\n]") if several else ("[", ", ", "]")
        return start + between.join(map(to_toml, value)) + end
    if isinstance(value, str | bool):  # JSON's words and strings are TOML's
        return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")
    return repr(value)
