"""Names of the files that have a meaning of their own, and files that are whole or absent."""

from __future__ import annotations

import contextlib
import io
import os
import socket
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

from ddmpi.errors import OutputError

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
