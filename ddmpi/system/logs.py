"""Where the story of a run goes: the screen, and a file with time stamps; rank 0 tells it."""

from __future__ import annotations

import contextlib
import logging
import os
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path

from ddmpi.errors import InputError, OutputError
from ddmpi.system.files import RESERVED

_logger = logging.getLogger("ddmpi")

_file: Path | None = None


class _LogFile(logging.FileHandler):
    """Appends lines with time stamps (UTC). Where the file can no longer be written, says so once and goes on:
    a log is not worth a run."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, encoding="utf-8")
        self.setFormatter(_Stamped())

    def handleError(self, record: logging.LogRecord) -> None:
        self._give_up(sys.exc_info()[1])

    def close(self) -> None:
        """Raises nothing: what could not be written is tried once more here."""
        try:
            super().close()
        except OSError as error:
            self._give_up(error)

    def _give_up(self, error: BaseException | None) -> None:
        if self.level <= logging.CRITICAL:
            self.setLevel(logging.CRITICAL + 1)
            _warn(f"the log {self.baseFilename} cannot be written any more ({error}); the run goes on")


class _Screen(logging.StreamHandler):
    """Prints lines as they are. Where that is no longer possible (a file on a full disk), says so once and goes on."""

    def handleError(self, record: logging.LogRecord) -> None:
        error = sys.exc_info()[1]
        self.setLevel(logging.CRITICAL + 1)
        leave_stdout()
        _warn(f"what the run says cannot be printed any more ({error}); the run goes on")


class _Stamped(logging.Formatter):
    """A stamp before every line, also of a message that has several."""

    def format(self, record: logging.LogRecord) -> str:
        stamp = utc(record.created)
        return "\n".join(f"{stamp}  {line}".rstrip() for line in super().format(record).split("\n"))


def leave_stdout() -> None:
    """Print nothing any more; what waits in the buffer would be tried, and told of, again when the process ends."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def _warn(message: str) -> None:
    with contextlib.suppress(OSError):  # there is nowhere left to say it
        print(f"ddmpi: warning: {message}", file=sys.stderr, flush=True)


def utc(seconds: float | None = None) -> str:
    """A time since the epoch, or now, as ISO 8601 in UTC, to the second."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds))


def configure(rank: int, quiet: bool = False, file: str | None = None, heading: str = "") -> None:
    """Say everything on rank 0's screen, or nothing but errors where it is to be `quiet`; other ranks are silent.

    `file` gets the same lines with time stamps, also those that `quiet` keeps off the screen, after the line
    `heading`, "ddmpi VERSION on …"; the log that it holds already stays, so that a job that was requeued goes on with
    it. Its folder is made. Not collective. Raises InputError, on rank 0, where the file cannot be written, holds
    something else, or has the name of a file of results. When no rank has refused it, `accept` the file.
    """
    accept(None)
    close()
    _logger.propagate = False
    _logger.setLevel(logging.INFO if rank == 0 else logging.ERROR)
    if rank:
        _logger.handlers = [logging.NullHandler()]
        return
    screen = _Screen(sys.stdout)
    screen.setFormatter(logging.Formatter("%(message)s"))
    screen.setLevel(logging.ERROR if quiet else logging.INFO)
    _logger.handlers = [screen]
    if file:
        path = Path(file)
        try:
            _refuse_other(path)
            path.parent.mkdir(parents=True, exist_ok=True)
            _logger.addHandler(_LogFile(path))
        except OSError as error:
            raise InputError(f"--log {file}: cannot be written: {error.strerror}") from None
        _logger.handlers[-1].handle(_record(logging.INFO, heading))


def accept(file: str | None) -> None:
    """From now on this rank, too, adds its errors to the log `file`, if there is one. Not collective."""
    global _file
    _file = Path(file) if file else None


def _refuse_other(file: Path) -> None:
    """InputError where to append to `file` would spoil something. Raises OSError."""
    if file.name in RESERVED:
        raise InputError(f"--log {file}: a file of that name is part of the results; name another one")
    if os.path.isfile(file):  # and no device
        with open(file, "rb") as former:
            line = former.readline(200)
        if line and not re.match(rb"[\d-]{10}T[\d:]{8}Z  ddmpi \S+ on ", line):
            raise InputError(f"--log {file}: is there already, and no log of ddmpi; name another file, or remove it")


def close() -> None:
    """Let go of the file."""
    for handler in _logger.handlers:
        handler.close()
    _logger.handlers = []


@contextlib.contextmanager
def diverted(path: Path | None) -> Iterator[None]:
    """Meanwhile everything goes to the file `path` (appended to) instead; rank 0 gives one, others None.

    Raises OutputError where the file cannot be opened.
    """
    before = _logger.handlers
    try:
        _logger.handlers = [_LogFile(path) if path else logging.NullHandler()]
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        yield
    finally:
        close()
        _logger.handlers = before


def tell_error(message: str) -> None:
    """Print an error on stderr and add it to the log file; by any rank, on its own.

    Lines are written whole: a piece of one may come out on stdout with Open MPI 5.0, which keeps it in the
    same place for both.
    """
    with contextlib.suppress(OSError):  # the exit code says it, too
        sys.stderr.write(f"{message}\n")
        sys.stderr.flush()
    files = [handler for handler in _logger.handlers if isinstance(handler, _LogFile)]
    if not files and _file:  # of a rank that keeps no log
        with contextlib.suppress(OSError):  # the message is on the screen
            files = [_LogFile(_file)]
    for handler in files:
        handler.handle(_record(logging.ERROR, message))


def _record(level: int, message: str) -> logging.LogRecord:
    return _logger.makeRecord(_logger.name, level, "", 0, message, (), None)
