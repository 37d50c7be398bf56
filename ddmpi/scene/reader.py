"""Reading a scene: TOML text and ``--set`` to a settled scene, or one InputError with file and key."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import msgspec

from ddmpi.errors import InputError
from ddmpi.scene.keys import override
from ddmpi.scene.mistakes import explain
from ddmpi.scene.scene import Scene, Settled


def read_scene(path: str, text: str, settings: Sequence[str] = ()) -> Settled:
    """Check a scene of TOML text and ``KEY=VALUE`` settings, and fill in what it leaves out.

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
        return msgspec.convert(data, Scene).settled()
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {explain(str(error), data, Scene)}") from None
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None


def read_scene_file(path: str | Path, settings: Sequence[str] = ()) -> Settled:
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
