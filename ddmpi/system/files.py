"""Names of files with a fixed meaning, and writing of files that are whole or absent."""

from __future__ import annotations

import contextlib
import io
import math
import os
import re
import socket
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from ddmpi.errors import InputError, OutputError, TakenError
from ddmpi.system.agreement import agreed

SUMMARY, CHECKPOINT, MECHANISM = "summary.json", "checkpoint.h5", "mechanism.json"
"""The summary is the last file of a result: with it all others are complete. The checkpoint has an unfinished run."""

SWEEP, TABLE, RECORD = "sweep.json", "sweep.csv", "case.json"
"""The identity of a sweep, its table, and the record of one of its cases."""

UNFINISHED = ".unfinished"
"""Prefix of unfinished files."""

LONGEST = 255
"""The longest file name that common file systems accept (bytes)."""


class ContactFiles(NamedTuple):
    """The files of a contact in a folder of results; no other file begins with ``contact_``."""

    table: str
    sides: str
    legs: str
    picture: str
    surface: str


def contact_files(name: str) -> ContactFiles:
    """The names of the files of the contact `name`."""
    return ContactFiles(
        f"contact_{name}.csv",
        f"contact_{name}_sides.csv",
        f"contact_{name}_legs.csv",
        f"contact_{name}.png",
        f"contact_{name}.vtu",
    )


class FileOfHDF5(io.FileIO):
    """A file for h5py. It raises the error of a full disk only when it is closed: earlier, HDF5 would crash."""

    _error: OSError | None = None

    def write(self, data: Any) -> int:
        """Accept all of `data`, even on a full disk."""
        view = memoryview(data).cast("B")
        done = 0
        with self._postponed():
            while done < len(view) and not self._error:
                done += super().write(view[done:])
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        with self._postponed():
            return super().truncate(size)
        return self.tell() if size is None else size

    def close(self) -> None:
        """Close the file. Raises the first postponed OSError."""
        super().close()
        error, self._error = self._error, None
        if error:
            raise error

    @contextlib.contextmanager
    def _postponed(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            error.filename = self.name
            self._error = self._error or error


@contextlib.contextmanager
def writing(path: Path) -> Iterator[None]:
    """A context for writing `path`: an OSError becomes an OutputError that names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(
            f"results could not be written: {error.filename or path}: {error.strerror or error}"
        ) from None


def _kinds(head: bytes) -> list[str]:
    """The kinds of page, of those that ddmpi writes, that a file may be by its first lines."""
    found = re.search(rb'<meta name="generator" content="ddmpi [^" ]+ ?(\w*)">', head)
    # until version 0.22 reports had no kind, and pages of checks were views
    former = {"": ["report"], "view": ["view", "page"]}
    return former.get(kind := found[1].decode(), [kind]) if found else []


def write_page(path: Path, page: str, what: str) -> Path:
    """Write a page of HTML, such as a "report"; its path. One of this kind that ddmpi wrote is overwritten, any other
    file is not. Raises InputError, OutputError. Not collective."""
    if path.exists() and not (path.is_file() and what in _kinds(path.read_bytes()[:1000])):
        raise InputError(
            f"--output {path}: is there already, and no {what} of ddmpi; name another file"
        )
    write_atomically(
        path, page.encode(errors="backslashreplace")
    )  # names of folders may be no text
    return path


Part = tuple[Sequence[np.ndarray], Sequence[int], int]
"""Of a dataset pieces of rows (k, …), at least one, the number of rows before each, and of all rows."""


def write_rows(
    target: Path,
    parts: Mapping[str, Part],
    world: MPI.Comm,
    group: str | None = None,
) -> None:
    """Write datasets of an HDF5 file, all ranks at once, each its rows.

    The first rank creates the datasets. Then all ranks write at the offsets that HDF5 reports, without parallel HDF5
    and without taking turns.

    Parameters
    ----------
    parts : by name what this rank has of a dataset; datasets without rows of this rank are left out
    group : None for a new file; a new group of an existing file

    Collective. Raises OutputError, on all ranks.
    """
    shapes = {
        name: ((total, *pieces[0].shape[1:]), np.result_type(*pieces).str)
        for name, (pieces, _, total) in parts.items()
    }
    everyone, shares = world.gather(shapes), None
    with agreed(world):
        if everyone is not None:
            made = _made(
                target, {name: shape for table in everyone for name, shape in table.items()}, group
            )
            shares = [{name: made[name] for name in table} for table in everyone]
    starts = world.scatter(shares)
    with agreed(world):
        placed = []
        for name, (pieces, firsts, total) in parts.items():
            offset, kind = starts[name]
            for first, piece in zip(firsts, pieces, strict=True) if total else ():
                array = np.ascontiguousarray(piece, kind)
                row = array.itemsize * math.prod(array.shape[1:])
                placed.append((offset + first * row, array))
        put(target, placed)


def _made(
    target: Path, shapes: Mapping[str, tuple[tuple[int, ...], str]], group: str | None
) -> dict[str, tuple]:
    """Create datasets with allocated space in an HDF5 file: offsets and types by name; `group` as of `write_rows`. Not
    collective."""
    import h5py

    mode, places = "w" if group is None else "r+", {}
    with (
        writing(target),
        FileOfHDF5(target, f"{mode[0]}+") as storage,
        h5py.File(storage, mode) as file,
    ):
        parent = file.create_group(group) if group else file
        at_once = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        at_once.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        at_once.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        for name, (shape, kind) in shapes.items():
            places[name] = (
                parent.create_dataset(name, shape, kind, dcpl=at_once).id.get_offset(),
                kind,
            )
    return places


def put(target: Path, parts: Sequence[tuple[int, np.ndarray]]) -> None:
    """Write arrays into an existing file, each at its offset. Not collective. Raises OutputError.

    The file is opened for writing only: on NFS a host that had read bytes beside its own would write these back, too.
    """
    with writing(target), open(os.open(target, os.O_WRONLY), "wb") as file:
        for start, piece in parts:
            if file.tell() != start:  # what follows what was written stays in the buffer
                file.seek(start)
            file.write(piece.data)


def refuse_taken(*paths: Path) -> None:
    """Raise TakenError where a file would be overwritten. Not collective."""
    for path in paths:
        if os.path.lexists(path):
            raise TakenError(
                f"{path} is there already; nothing is overwritten; choose another --output"
            )


def write_atomically(path: Path, data: bytes, durable: bool = False) -> None:
    """Write `path` under another name and rename it: a reader finds the old file or the new one, whole.

    The file takes the place of a link. With `durable` it also outlives a power cut once this returns. Raises
    OutputError. Not collective.
    """
    temporary = path.with_name(f"{UNFINISHED}-{socket.gethostname()}-{os.getpid()}-{path.name}")
    try:
        temporary.unlink(missing_ok=True)
        with open(temporary, "xb") as file:
            file.write(data)
            if durable:
                file.flush()
                os.fsync(file.fileno())
        os.replace(temporary, path)
        if durable:
            folder = os.open(path.parent, os.O_RDONLY)
            try:
                os.fsync(folder)
            finally:
                os.close(folder)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):  # the folder may be gone
            temporary.unlink(missing_ok=True)
