"""Signals that ask a run to end in good order: SIGTERM and SIGUSR1, as batch systems send them.

The handler only takes note. The run looks at the note where it can stop: when the arguments have been read,
between the phases of the set-up, at every multiplication by a compliance and at every exchange, where the other
rank learns of it too.
"""

from __future__ import annotations

import signal
from collections.abc import Callable

from ddmpi.errors import InterruptionError

SIGNALS = (signal.SIGTERM, signal.SIGUSR1)

_received: list[str] = []

_handlers: dict[int, Callable | signal.Handlers] = {}


def listen() -> None:
    """From now on the signals are noted, where they would end the process.

    To be called at once, and again after PETSc's initialisation, which with some MPIs takes SIGTERM for itself; in
    the main thread. Not collective.
    """
    _handle(_note)


def leave() -> None:
    """From now on the signals end the process: it has nothing to lose. Not collective."""
    _handle(signal.SIG_DFL)


def ignore() -> None:
    """From now on the signals come too late, also while the interpreter ends, which takes a note of nothing any more.

    Not collective.
    """
    _handle(signal.SIG_IGN)


def _handle(handler: Callable | signal.Handlers) -> None:
    _handlers.update(dict.fromkeys(SIGNALS, handler))
    listen_again()


def listen_again() -> None:
    """Put our handlers back, if there are any, after a library that has its own (the PETSc within gmsh)."""
    for number, handler in _handlers.items():
        signal.signal(number, handler)


def _note(number: int, _frame: object) -> None:
    _received.append(signal.Signals(number).name)


def interruption() -> InterruptionError | None:
    """The error that is due because a signal came to this process, or None. Not collective."""
    return InterruptionError(_received[0]) if _received else None


def check() -> None:
    """Raise the InterruptionError that is due, if there is one, on this rank alone. Not collective."""
    error = interruption()
    if error:
        raise error
