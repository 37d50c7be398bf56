"""Names of the files that have a meaning of their own, and files that are whole or absent."""

from __future__ import annotations

import contextlib
import io
import math
import os
import socket
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

from ddmpi.errors import OutputError
from ddmpi.system.agreement import agreed

SUMMARY, CHECKPOINT, MECHANISM = "summary.json", "checkpoint.h5", "mechanism.json"
"""The last file of a result: where it is, the others are. The state of a run that was not completed."""

SWEEP, TABLE, RECORD = "sweep.json", "sweep.csv", "case.json"
"""What identifies a sweep, its table, and the record of one of its cases."""

UNFINISHED = ".unfinished"
"""Names of what a run has not finished begin like this."""

LONGEST = 255
"""The longest name of a file that common file systems take, in bytes."""


class ContactFiles(NamedTuple):
    """The files that a contact may have in a folder of results; nothing else there begins with ``contact_``."""

    table: str
    sides: str
    legs: str
    picture: str
    surface: str


def contact_files(name: str) -> ContactFiles:
    """The names of the files of the contact `name`."""
    return ContactFiles(f"contact_{name}.csv", f"contact_{name}_sides.csv", f"contact_{name}_legs.csv",
                        f"contact_{name}.png", f"contact_{name}.vtu")


class FileOfHDF5(io.FileIO):
    """A file for h5py. It raises the error of a full disk only when it is closed: earlier, HDF5 would crash."""

    _error: OSError | None = None

    def write(self, data: Any) -> int:
        """Take all of `data`, whether there is room or not."""
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
        """Close the file. Raises the first OSError that was met."""
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
    """A context in which `path` is written: an error of the system becomes an OutputError that names the file."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"results could not be written: {error.filename or path}: "
                          f"{error.strerror or error}") from None


def write_rows(target: Path, parts: Mapping[str, Sequence[np.ndarray]], places: Mapping[str, tuple[int, int]],
               world: MPI.Comm, group: str | None = None) -> None:
    """Write datasets of an HDF5 file, all ranks at once, each its rows.

    The first rank makes the datasets. Then each rank writes to where HDF5 has them in the file: HDF5 with MPI is not
    needed, and nobody waits for a turn.

    Parameters
    ----------
    parts : by name the rows (k, …) of this rank, at least one, in pieces that follow each other; datasets of which it
        has none are left out
    places : by name how many rows are before these, and how many there are in all
    group : None for a new file; a new group of one that is there, or its root for ""

    Collective. Raises OutputError, on all ranks.
    """
    shapes = {name: ((places[name][1], *pieces[0].shape[1:]), np.result_type(*pieces).str)
              for name, pieces in parts.items()}
    everyone, shares = world.gather(shapes), None
    with agreed(world):
        if everyone is not None:
            made = _made(target, {name: shape for each in everyone for name, shape in each.items()}, group)
            shares = [{name: made[name] for name in each} for each in everyone]
    starts = world.scatter(shares)
    with agreed(world):
        own = {name: [np.ascontiguousarray(piece, starts[name][1]) for piece in pieces]
               for name, pieces in parts.items()}
        put(target, [(starts[name][0] + places[name][0] * pieces[0].itemsize * math.prod(pieces[0].shape[1:]), pieces)
                     for name, pieces in own.items() if places[name][1]])


def _made(target: Path, shapes: Mapping[str, tuple[tuple[int, ...], str]], group: str | None) -> dict[str, tuple]:
    """Make datasets with their room in an HDF5 file: by name where they begin and of what they are; `group` as of
    `write_rows`. Not collective."""
    import h5py

    mode, found = "w" if group is None else "r+", {}
    with writing(target), FileOfHDF5(target, f"{mode[0]}+") as storage, h5py.File(storage, mode) as file:
        parent = file.create_group(group) if group else file
        at_once = h5py.h5p.create(h5py.h5p.DATASET_CREATE)
        at_once.set_alloc_time(h5py.h5d.ALLOC_TIME_EARLY)
        at_once.set_fill_time(h5py.h5d.FILL_TIME_NEVER)
        for name, (shape, kind) in shapes.items():
            found[name] = parent.create_dataset(name, shape, kind, dcpl=at_once).id.get_offset(), kind
    return found


def put(target: Path, parts: Sequence[tuple[int, Sequence[np.ndarray]]]) -> None:
    """Write arrays into a file that is there, some after each other from a byte on. Not collective. Raises OutputError.

    It is opened for writing only: a host that had read what is beside its bytes, on NFS, would write that, too.
    """
    with writing(target), open(os.open(target, os.O_WRONLY), "wb") as file:
        for start, pieces in parts:
            file.seek(start)
            for piece in pieces:
                file.write(piece.data)


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
