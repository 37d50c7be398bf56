"""Reading a scene: TOML text and ``--set`` to a settled scene, or one InputError with file and key."""

from __future__ import annotations

import tomllib
from collections.abc import Sequence
from pathlib import Path

import msgspec

from ddmpi.errors import InputError
from ddmpi.scene.keys import explain, override
from ddmpi.scene.scene import FileOrder, Scene, Settled


def read_data(path: str, text: str, settings: Sequence[str] = ()) -> dict:
    """The data of TOML `text` with ``KEY=VALUE`` settings, not yet checked; parameters and errors of `read_scene`."""
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(f"{path}: not valid TOML: {error}") from None
    for setting in settings:
        override(data, setting)
    return data


def read_scene(path: str, text: str, settings: Sequence[str] = (), file_order: FileOrder | None = None) -> Settled:
    """Check a scene of TOML text and ``KEY=VALUE`` settings, and fill in what it leaves out.

    Parameters
    ----------
    path : the file's name, for messages only
    text : its contents
    settings : as after ``--set``; applied in order, before validation
    file_order : gives the order of a body's mesh file; without it, files count as linear

    Raises InputError, the same on every rank, that names file and key. Not collective.
    """
    data = read_data(path, text, settings)
    try:
        return msgspec.convert(data, Scene).settled(file_order)
    except msgspec.ValidationError as error:
        raise InputError(f"{path}: {explain(str(error), data, Scene)}") from None
    except (ValueError, InputError) as error:
        raise InputError(f"{path}: {error}") from None


def read_scene_file(path: str | Path, settings: Sequence[str] = (), file_order: FileOrder | None = None) -> Settled:
    """`read_scene` on a file. Not collective."""
    return read_scene(str(path), read_text(path), settings, file_order)


def read_text(path: str | Path) -> str:
    """The text of a scene file, or an InputError that names it."""
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from None
    except UnicodeDecodeError:
        raise InputError(f"{path}: not a text file in UTF-8") from None
