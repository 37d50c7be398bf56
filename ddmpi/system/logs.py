"""Messages: rank 0 prints them on the screen and appends them, with time stamps, to a log file."""

from __future__ import annotations

import contextlib
import logging
import os
import re
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import IO

from ddmpi.errors import InputError, OutputError

_logger = logging.getLogger("ddmpi")

PROGRESS = "ddmpi.progress"
"""Who logs what a long phase works at."""

ESCAPED = "backslashreplace"
"""What becomes of bytes of a file's name that are no text."""


class _LogFile(logging.FileHandler):
    """Appends messages, each line with a time stamp (UTC)."""

    def format(self, record: logging.LogRecord) -> str:
        stamp = utc(record.created)
        return "\n".join(
            f"{stamp}  {line}".rstrip() for line in printable(super().format(record)).split("\n")
        )

    def handleError(self, record: logging.LogRecord | None) -> None:
        _give_up(
            self, f"the log {self.baseFilename} cannot be written any more ({sys.exc_info()[1]})"
        )

    def close(self) -> None:
        try:
            super().close()
        except OSError:  # closing tries to write the buffer once more
            self.handleError(None)


class _Screen(logging.StreamHandler):
    def format(self, record: logging.LogRecord) -> str:
        return encodable(printable(super().format(record)), self.stream)

    def handleError(self, record: logging.LogRecord) -> None:
        leave_stdout()
        _give_up(self, f"messages cannot be printed any more ({sys.exc_info()[1]})")


def _give_up(handler: logging.Handler, message: str) -> None:
    """Silence a handler that cannot write, with one warning; the run goes on."""
    if handler.level <= logging.CRITICAL:
        handler.setLevel(logging.CRITICAL + 1)
        with contextlib.suppress(OSError):  # stderr may be closed, too
            print(f"ddmpi: warning: {message}; the run goes on", file=sys.stderr, flush=True)


def printable(text: str) -> str:
    """The text with characters that control a screen, such as NUL, or turn words round in words; lines stay."""
    controls = r"[\x00-\x09\x0b-\x1f\x7f-\x9f\u202a-\u202e\u2066-\u2069]"
    return re.sub(controls, lambda match: repr(match[0])[1:-1], text)


def encodable(text: str, stream: IO[str]) -> str:
    """The text with what the stream has no letters for, as after PYTHONIOENCODING=ascii, in escapes."""
    encoding = getattr(stream, "encoding", None) or "utf-8"
    return text.encode(encoding, ESCAPED).decode(encoding)


def leave_stdout() -> None:
    """Discard all further output: at its end Python would try to write the buffer once more."""
    nowhere = os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, sys.stdout.fileno())
    os.close(nowhere)


def utc(seconds: float | None = None) -> str:
    """A time since the epoch, or now, as ISO 8601 in UTC, to the second."""
    return time.strftime("%Y-%m-%dT%H:%M:%SZ", time.gmtime(seconds))


def configure(rank: int, quiet: bool = False, file: str | None = None, heading: str = "") -> None:
    """Print messages on rank 0's screen, warnings on stderr; with `quiet` only these; other ranks are silent.

    The log `file` gets the line `heading`, "ddmpi VERSION on …", and then all messages with time stamps, also those
    that `quiet` keeps off the screen, and errors of other ranks. An existing log is continued. Not collective. Raises
    InputError, on rank 0, where the file cannot be written or is no log.
    """
    close()
    _logger.propagate = False
    _logger.setLevel(logging.CRITICAL + 1 if rank else logging.INFO)
    if rank:
        _logger.handlers = (
            [_LogFile(file, encoding="utf-8", delay=True, errors=ESCAPED)] if file else []
        )
        return
    _logger.handlers = _on_screen(quiet)
    if file:
        try:
            former = Path(file).read_bytes() if os.path.isfile(file) else b""  # and no device
            if former and not re.match(rb"[\d-]{10}T[\d:]{8}Z  ddmpi \S+ on ", former):
                raise InputError(
                    f"--log {file}: is there already, and no log of ddmpi; name another file"
                )
            Path(file).parent.mkdir(parents=True, exist_ok=True)
            _logger.addHandler(log := _LogFile(file, encoding="utf-8", errors=ESCAPED))
        except OSError as error:
            raise InputError(f"--log {file}: cannot be written: {error.strerror}") from None
        log.handle(logging.makeLogRecord({"msg": heading}))


def _on_screen(quiet: bool = False) -> list[logging.Handler]:
    screen, warnings = _Screen(sys.stdout), _Screen(sys.stderr)
    screen.setLevel(logging.ERROR if quiet else logging.INFO)
    screen.addFilter(lambda record: record.levelno < logging.WARNING)
    warnings.setLevel(logging.WARNING)
    warnings.setFormatter(logging.Formatter("ddmpi: warning: %(message)s"))
    return [screen, warnings]


@contextlib.contextmanager
def told_by_first(rank: int, printed: bool) -> Iterator[None]:
    """Within the block only rank 0 has messages, `printed` as by a command, or left to `logging`."""
    before = _logger.handlers, _logger.level, _logger.propagate
    if rank:
        _logger.setLevel(logging.CRITICAL + 1)
    elif printed:
        _logger.handlers, _logger.propagate = _on_screen(), False
        _logger.setLevel(logging.INFO)
    try:
        yield
    finally:
        _logger.handlers, _logger.propagate = before[0], before[2]
        _logger.setLevel(before[1])


def close() -> None:
    """Close the log file, and print nothing more."""
    for handler in _logger.handlers:
        handler.close()
    _logger.handlers = []


def is_open(path: Path) -> bool:
    """Whether `path` is a log to which this process writes. Not collective."""
    return any(handler.baseFilename == os.path.abspath(path) for handler in _log_files())


@contextlib.contextmanager
def diverted(path: Path | None) -> Iterator[None]:
    """Within the block, append all messages to the file `path` instead, if there is one; what a long phase works at stays
    on the screen, too. Raises OutputError."""
    before = _logger.handlers
    screens = [handler for handler in before if isinstance(handler, _Screen)]
    try:
        if path and path.is_symlink():
            raise OutputError(f"{path}: is a link, and nothing is written elsewhere")
        if path:
            _logger.handlers = [_LogFile(path, encoding="utf-8", errors=ESCAPED), *screens]
            for screen in screens:
                screen.addFilter(_is_progress)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
    try:
        yield
    finally:
        if path:
            close()
            for screen in screens:
                screen.removeFilter(_is_progress)
            _logger.handlers = before


def _is_progress(record: logging.LogRecord) -> bool:
    return record.name == PROGRESS


def report_error(message: str) -> None:
    """Print an error on stderr and append it to the log; any rank may do so on its own."""
    with contextlib.suppress(OSError):  # the exit code says it, too
        sys.stderr.write(
            encodable(f"{printable(message)}\n", sys.stderr)
        )  # a whole line: Open MPI 5.0 mixes pieces of lines of both streams
        sys.stderr.flush()
    for handler in _log_files():
        with contextlib.suppress(OSError):  # the message is on the screen
            handler.handle(logging.makeLogRecord({"msg": message}))


def _log_files() -> list[_LogFile]:
    return [handler for handler in _logger.handlers if isinstance(handler, _LogFile)]
