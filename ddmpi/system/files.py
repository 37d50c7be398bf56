"""Files that are whole or absent: made under another name, and renamed."""

from __future__ import annotations

import contextlib
import errno
import fcntl
import io
import os
import shutil
import socket
from collections.abc import Iterator
from pathlib import Path

from ddmpi.errors import OutputError

RESULTS = ("result.h5", "result.xdmf", "history.csv", "interface.csv", "interface_sides.csv", "summary.json",
           "bodies.png", "error.png", "contact.png", "convergence.png")
"""All files of a result; the summary comes last, so where it is, the rest is."""

CHECKPOINT, TABLE, RECORD = "checkpoint.h5", "sweep.csv", "case.json"
"""The state of a run that was not completed, the table of a sweep, the record of one of its cases."""

RESERVED = frozenset({*RESULTS, CHECKPOINT, TABLE, RECORD})
"""Names that mean something in a folder of results."""

_MARK = ".unfinished-"

NO_LOCKS = {errno.ENOLCK, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EBADF, errno.EINVAL}
"""What file systems say that have no locks on folders: NFS EBADF, Lustre without its option ENOSYS."""

NO_LINKS = {errno.EPERM, errno.EACCES, errno.ENOSYS, errno.ENOTSUP, errno.EOPNOTSUPP, errno.EMLINK, errno.EXDEV}
"""What those say that have no second names for a file."""


@contextlib.contextmanager
def locked(folder: Path) -> Iterator[None]:
    """Meanwhile no other process can have `folder` locked.

    The lock is on the folder itself and goes with the process, so that nothing is left behind. Where the file system
    has no locks there is none. Raises BlockingIOError where another process has it, OSError where the folder cannot
    be read.
    """
    descriptor = os.open(folder, os.O_RDONLY | os.O_DIRECTORY)
    try:
        try:
            fcntl.flock(descriptor, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except OSError as error:
            if error.errno not in NO_LOCKS:
                raise
        if not os.path.samestat(os.fstat(descriptor), os.stat(folder)):  # removed, and made anew
            raise BlockingIOError(errno.EAGAIN, "another process is at it", str(folder))
        yield
    finally:
        os.close(descriptor)


def is_locked(folder: Path) -> bool:
    """Whether another process has `folder` locked, if it is there."""
    try:
        with locked(folder):
            return False
    except BlockingIOError:
        return True
    except OSError:
        return False


def link_new(source: Path, target: Path) -> None:
    """Give the file `source` the name `target`, too; where there can be one name only, instead.

    Raises FileExistsError where `target` is there: nothing is overwritten, whoever else is at it.
    """
    try:
        os.link(source, target)
    except OSError as error:
        if error.errno not in NO_LINKS:
            raise
        if os.path.lexists(target):
            raise FileExistsError(errno.EEXIST, os.strerror(errno.EEXIST), str(target)) from None
        os.rename(source, target)


class FileOfHDF5(io.FileIO):
    """A file for h5py to write through, which tells of a full disk only when it is closed.

    Told at once, HDF5 can close its objects no more, and crashes when the process ends.
    """

    _error: OSError | None = None

    def write(self, data: bytes | memoryview) -> int:
        """Take all of `data`, whether there is room or not."""
        view = memoryview(data).cast("B")
        done = 0
        with self._kept():
            while done < len(view) and not self._error:
                done += super().write(view[done:])
        return len(view)

    def truncate(self, size: int | None = None) -> int:
        with self._kept():
            return super().truncate(size)
        return self.tell() if size is None else size

    def close(self) -> None:
        """Raises the first OSError that was met."""
        super().close()
        error, self._error = self._error, None
        if error:
            raise error

    @contextlib.contextmanager
    def _kept(self) -> Iterator[None]:
        try:
            yield
        except OSError as error:
            error.filename = self.name
            self._error = self._error or error


def unfinished(path: Path) -> Path:
    """The name under which this process makes `path`, in the same folder."""
    return path.with_name(f"{_MARK}{socket.gethostname()}-{os.getpid()}-{path.name}")


def publishing(folder: Path) -> list[str]:
    """What of results that are being put into `folder` there is, by whomever. Raises OSError."""
    return sorted(path.name for path in folder.glob(f"{_MARK}*-results"))


def clear_unfinished(folder: Path) -> None:
    """Remove what processes of this host have left in `folder` that were killed at it. Raises OSError."""
    mark = f"{_MARK}{socket.gethostname()}-"
    for left in folder.glob(f"{mark}*"):
        process = left.name.removeprefix(mark).partition("-")[0]
        if process.isdecimal() and not _runs(int(process)):
            shutil.rmtree(left) if left.is_dir() else left.unlink()


def _runs(process: int) -> bool:
    try:
        os.kill(process, 0)
        state = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except ProcessLookupError:
        return False
    except OSError:  # somebody else's, or there is no /proc
        return True
    return state not in "ZX"  # dead, and nobody has asked how it died


def write_atomically(path: Path, data: bytes, durable: bool = False) -> None:
    """Write `path` so that whoever reads it finds all of it or what was there before; raises OutputError.

    `durable`: when this returns it outlives a power cut, too.
    """
    temporary = unfinished(path)
    try:
        with open(temporary, "wb") as file:
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
        with contextlib.suppress(OSError):  # whoever removes the folder takes it along
            temporary.unlink(missing_ok=True)
