"""HDF5 files of others, read in another process: libhdf5 may crash on a damaged file, which is then an error there.

This module is loaded by that process and imports neither MPI nor PETSc.
"""

from __future__ import annotations

import contextlib
import json
import resource
import tempfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.errors import InputError
from ddmpi.system.interrupt import apart

INFLATED = 1100
"""More bytes of arrays for one of the file, beyond the most that its compression can save, are no data."""

SECONDS, RATE = 10, 1_000_000
"""Processor time (s) that a file may take, and bytes a second beyond it: libhdf5 may go round in circles."""


def read_apart(path: Path, work: Callable[..., Any], label: str, *more: Any) -> Any:
    """What `work` of a module makes of a file, and of `more`, in another process; 0.2 s. Not collective.

    Raises InputError, which begins with `label`, where reading it ends that process, or of `work`; and what `apart`
    raises.
    """
    try:
        if path.exists() and not path.is_file():
            raise InputError("it is no file")
        seconds = SECONDS + (path.stat().st_size // RATE if path.exists() else 0)
        with tempfile.TemporaryDirectory() as folder:
            return apart(Path(folder).resolve(), _checked, path.resolve(), seconds, work, *more)
    except ChildProcessError as error:
        end = f"ends the process ({error})"
        if "SIGXCPU" in end:
            end = f"takes more than {seconds} s of processor time"
        raise InputError(f"{label}reading it {end}") from None
    except InputError as error:
        raise InputError(f"{label}{error}") from None


def probe(path: Path) -> None:
    """Refuse a file that this process cannot read without a crash, or whose data lie elsewhere; what else is wrong with
    it, its reader says. Not collective. Raises InputError."""
    if path.exists():
        read_apart(path, _walk, f"{path}: not a complete folder of results: ")


def _walk(path: Path) -> None:
    """Read all of a file, as its readers do."""
    import h5py

    with contextlib.suppress(Exception), h5py.File(path, "r") as file:  # raised where it is read
        tree(file)


def _checked(path: Path, seconds: int, work: Callable[..., Any], *more: Any) -> Any:
    """What `work` makes of a file in so many `seconds` of processor time, unless the arrays of this would fill the memory,
    or lie in other files: a folder of results would hand these on. Raises InputError, and what `work` raises."""
    import h5py

    most = resource.getrlimit(resource.RLIMIT_CPU)[1]  # which no process may raise
    most = seconds + 1 if most == resource.RLIM_INFINITY else min(seconds + 1, most)
    # first SIGXCPU, then SIGKILL
    resource.setrlimit(resource.RLIMIT_CPU, (min(seconds, most), most))
    try:
        file = h5py.File(path, "r")
    except OSError:
        return work(path, *more)  # which says what is wrong
    sizes = [0]

    def look(_: str, entry: Any) -> None:
        away = False
        if isinstance(entry, h5py.Dataset):
            sizes.append(entry.nbytes)
            away = entry.is_virtual or bool(entry.external)
        elif isinstance(entry, h5py.Group):
            links = [entry.get(name, getlink=True) for name in entry]
            away = any(isinstance(link, h5py.ExternalLink) for link in links)
        if away:
            raise InputError("its data lie in other files")

    with file:
        try:
            look("", file)
            file.visititems(look)
        except InputError:
            raise
        except Exception as error:
            raise InputError(f"{type(error).__name__} {error}") from None
    if sum(sizes) > INFLATED * path.stat().st_size:
        raise InputError(f"it holds arrays of {sum(sizes):.2g} bytes in {path.stat().st_size}")
    return work(path, *more)


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
            return tree(file)
    except Exception as error:
        why = "there is no" if isinstance(error, KeyError) else type(error).__name__
        raise InputError(f"{why} {error}".partition("\n")[0][:200]) from None
