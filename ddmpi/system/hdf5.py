"""HDF5 files of others, read in another process: libhdf5 may crash on a damaged file, which is then an error there.

This module is loaded by that process and imports neither MPI nor PETSc.
"""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.system.interrupt import apart

INFLATED = 1100
"""More bytes of arrays for one of the file, beyond the most that its compression can save, are no data."""


def read_apart(path: Path, work: Callable[..., Any], label: str, *more: Any) -> Any:
    """What `work` of a module makes of a file, and of `more`, in another process; 0.2 s. Not collective.

    Raises InputError, which begins with `label`, where reading it ends that process, or of `work`; and what `apart`
    raises.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError("it is no file")
        with tempfile.TemporaryDirectory() as folder:
            return apart(Path(folder).resolve(), work, path.resolve(), *more)
    except ChildProcessError as error:
        raise InputError(f"{label}reading it ends the process ({error})") from None
    except InputError as error:
        raise InputError(f"{label}{error}") from None


def probe(path: Path) -> None:
    """Refuse a file that this process cannot read without a crash; what else is wrong with it, its reader says. Not
    collective. Raises InputError."""
    if path.exists():
        read_apart(path, _walk, f"{path}: not a complete folder of results: ")


def _walk(path: Path) -> None:
    """Read all of a file, as its readers do. Raises InputError."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            refuse_inflated(file, path)
            tree(file)
    except InputError:
        raise
    except Exception:  # raised again where it is read
        return


def refuse_inflated(file: Any, path: Path) -> None:
    """Raise InputError where a small file stands for arrays that would fill the memory."""
    import h5py

    sizes = [0]
    file.visititems(
        lambda _, entry: sizes.append(entry.nbytes) if isinstance(entry, h5py.Dataset) else None
    )
    if sum(sizes) > INFLATED * path.stat().st_size:
        raise InputError(f"it holds arrays of {sum(sizes):.2g} bytes in {path.stat().st_size}")


def tree(entry: Any) -> Any:
    """The groups of a file as tables, what `checkpoint.write` has written as what it was."""
    import h5py

    if isinstance(entry, h5py.Group):
        return {name: tree(value) for name, value in entry.items()}
    if h5py.check_string_dtype(entry.dtype):
        return json.loads(entry.asstr()[()])
    return np.split(entry[()], entry.attrs["ends"][:-1]) if "ends" in entry.attrs else entry[()]


def read_tree(path: Path) -> Any:
    """`tree` of a file; for another process. Raises InputError."""
    import h5py

    try:
        with h5py.File(path, "r") as file:
            refuse_inflated(file, path)
            return tree(file)
    except InputError:
        raise
    except Exception as error:
        why = "there is no" if isinstance(error, KeyError) else type(error).__name__
        raise InputError(f"{why} {error}".partition("\n")[0][:200]) from None
