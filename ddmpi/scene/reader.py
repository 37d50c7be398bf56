"""Reading a scene: TOML text and ``--set`` to checked types, or one InputError with file and key."""

from __future__ import annotations

import math
import tomllib
from pathlib import Path
from typing import Any

import msgspec

from ddmpi.errors import InputError
from ddmpi.scene.keys import override
from ddmpi.scene.mistakes import explain
from ddmpi.scene.scene import Scene


def read_scene(path: str, text: str, settings: list[str] = ()) -> Scene:
    """Build a scene from TOML text and ``KEY=VALUE`` overrides.

    Parameters
    ----------
    path : the file's name, for messages only
    text : its contents
    settings : as after ``--set``; applied in order, before validation

    Raises
    ------
    InputError
        naming file and key. Not collective: the same input raises the same error on every rank.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    for setting in settings:
        override(data, setting)
    try:
        scene = msgspec.convert(data, Scene)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {explain(str(error), data, Scene)}") from None
    _refuse_non_finite(path, scene.resolved())
    try:
        return scene.settled()
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def read_scene_file(path: str | Path, settings: list[str] = ()) -> Scene:
    """`read_scene` on a file. Not collective."""
    return read_scene(str(path), read_text(path), settings)


def read_text(path: str | Path) -> str:
    """The text of a scene file, or an InputError that names it."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8") from None


def _refuse_non_finite(path: str, value: Any, key: str = "") -> None:
    """TOML knows nan and inf; no key of a scene does."""
    if isinstance(value, dict):
        for name, entry in value.items():
            _refuse_non_finite(path, entry, f"{key}.{name}" if key else name)
    elif isinstance(value, list | tuple):
        for index, entry in enumerate(value):
            label = entry["name"] if isinstance(entry, dict) and "name" in entry else index
            _refuse_non_finite(path, entry, f"{key}.{label}")
    elif isinstance(value, float) and not math.isfinite(value):
        raise InputError(f"{path}: {key}: must be a finite number (got {value})")
