"""The ways a run can fail, each with the exit code that scripts see."""

from __future__ import annotations

import contextlib
import difflib
from collections.abc import Collection, Iterator


class DdmpiError(Exception):
    """Base of all errors whose message is meant for the user and needs no traceback.

    ``agreed`` says that all ranks raise this error, so that the run can end in an orderly way; the message
    begins with its ``kind``.
    """

    exit_code = 1
    agreed = False
    kind = "error"


class InternalError(DdmpiError):
    """A mistake of the program itself, where more than one run depends on it: a sweep records it and goes on."""

    kind = "internal error"


class InputError(DdmpiError):
    """Bad input: the scene, a mesh or the command line; one message with file and key, and nothing was computed."""

    exit_code = 2


@contextlib.contextmanager
def naming(place: str) -> Iterator[None]:
    """InputErrors of the block begin with the `place` in the input, a file or a key, that they are about."""
    try:
        yield
    except InputError as error:
        error.args = (f"{place}: {error}",)
        raise


SIMILAR = 0.65
"""Least similarity of a word to a misspelling of it."""


def nearest(word: str, words: list[str]) -> str:
    """The end of a message that proposes the most similar of `words`; empty if none is similar."""
    close = difflib.get_close_matches(word, words, n=1, cutoff=SIMILAR)
    return f"; did you mean {close[0]!r}?" if close else ""


def unknown(word: str, words: Collection[str]) -> str:
    """The end of a message about a word that is none of `words`: the most similar of these, and all that there are."""
    return f"{nearest(word, list(words))} (there: {', '.join(words) or 'none'})"


class NotConvergedError(DdmpiError):
    """Not converged, accuracy not reached, or no equilibrium; results are written, with converged = false."""

    exit_code = 3


class SolverError(DdmpiError):
    """A linear or quadratic solver failed: a subproblem could not be solved to the precision that it needs."""

    exit_code = 4


class OutputError(DdmpiError):
    """Results could not be written; a checkpoint is, where there is room for it."""

    exit_code = 5


class TakenError(OutputError):
    """A file stands where a result is to go."""


class InterruptionError(DdmpiError):
    """Interrupted by Ctrl-C, SIGTERM or SIGUSR1, or by SIGUSR1 to mpirun itself; a checkpoint is written where
    there is something to save, which there is not in the first load step.

    Parameters
    ----------
    signal : its name
    """

    exit_code = 6

    def __init__(self, signal: str) -> None:
        super().__init__("in the first load step or before it; there was nothing to save")
        self.kind = f"interrupted by {signal}"

    def __reduce__(self) -> tuple:
        return type(self), ("",), self.__dict__ | {"args": self.args}
