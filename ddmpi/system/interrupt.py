"""Signals that ask a run to end in good order: SIGTERM and SIGUSR1, as batch systems send them, and Ctrl-C.

The handler only notes the signal. The run looks at the note between the phases of the set-up, at every multiplication
by a compliance, and at every exchange, where other ranks learn of it too.
"""

from __future__ import annotations

import contextlib
import os
import signal
from collections.abc import Callable
from pathlib import Path

from ddmpi.errors import InterruptionError

SIGNALS = (signal.SIGTERM, signal.SIGUSR1, signal.SIGINT)

_received: list[str] = []

_handlers: dict[int, Callable | signal.Handlers] = {}


def listen() -> None:
    """From now on signals are noted; they do not end the process. Not collective.

    To be called when the process starts, and again after PETSc's initialisation, which may install its own handler.
    """
    _handle(_note)


def leave() -> None:
    """From now on signals end the process, which has nothing to lose. Not collective."""
    _handle(signal.SIG_DFL)


def ignore() -> None:
    """From now on signals do nothing: the results are there. Not collective."""
    _handle(signal.SIG_IGN)


def _handle(handler: Callable | signal.Handlers) -> None:
    heard = [number for number in SIGNALS if number in _handlers or signal.getsignal(number) != signal.SIG_IGN]
    _handlers.update(dict.fromkeys(heard, handler))  # a shell's job in the background ignores Ctrl-C
    listen_again()


def listen_again() -> None:
    """Install our handlers again after a library has installed its own (the PETSc within gmsh). Not collective."""
    for number, handler in _handlers.items():
        signal.signal(number, handler)


def _note(number: int, _frame: object) -> None:
    name = signal.Signals(number).name
    if number == signal.SIGUSR1:
        with contextlib.suppress(KeyError, OSError):  # scripts/attend.sh hands others on as SIGUSR1, and says which
            name = Path(os.environ["DDMPI_SIGNAL"]).read_text().strip() or name
    _received.append(name)


def interruption() -> InterruptionError | None:
    """The error to raise where this process has received a signal, or None. Not collective."""
    return InterruptionError(_received[0]) if _received else None


def check() -> None:
    """Raise InterruptionError, on this rank alone, where this process has received a signal. Not collective."""
    error = interruption()
    if error:
        raise error
