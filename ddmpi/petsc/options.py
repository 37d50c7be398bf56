"""PETSc's options: a scene's options as arguments, and the names of unused ones."""

from __future__ import annotations

import contextlib
import ctypes
from collections.abc import Iterable, Iterator


def as_arguments(table: dict[str, str | int | float | bool]) -> list[str]:
    """A scene's [petsc] table as arguments of petsc4py.init, to be put before the command line's, which win."""
    pairs = ((f"-{name}", value) for name, value in _plain(table).items())
    return [word for pair in pairs for word in pair if word is not None]


def _plain(table: dict[str, str | int | float | bool]) -> dict[str, str | None]:
    """Names without a dash, and values as PETSc reads them; true becomes an option without a value."""
    return {name.lstrip("-"): None if value is True else "false" if value is False else str(value)
            for name, value in table.items()}


class RunOptions:
    """PETSc's options for several runs of one process: those of the scene of a run and of the command line.

    Construct it after petsc4py.init. Not collective, but all ranks must do the same.
    """

    def __init__(self) -> None:
        from petsc4py import PETSc

        self._options = PETSc.Options()
        self._given = self._options.getAll()
        self._used = set(self._given) - set(unused_options())  # by PetscInitialize

    def given(self, name: str) -> bool:
        """Whether petsc4py.init was given this option, or has found it; PETSc ignores case."""
        return name.lstrip("-").lower() in {known.lower() for known in self._given}

    def use(self, table: dict[str, str | int | float | bool]) -> None:
        """Set the options of the scene's [petsc] `table`, and those given to petsc4py.init, which win."""
        for name in self._options.getAll():
            self._options.delValue(name)
        scene = {name: value for name, value in _plain(table).items() if not self.given(name)}
        for name, value in (scene | self._given).items():
            self._options.setValue(name, value)
            if name in self._used:
                self._options.hasName(name)  # PETSc notes that it was asked for


def unused_options() -> list[str]:
    """Names of options that no object has asked for so far. Not collective."""
    from petsc4py import PETSc  # only after petsc4py.init, which takes the arguments

    library, used, left = ctypes.CDLL(PETSc.__file__), ctypes.c_int(), []  # petsc4py 3.18 does not wrap it
    for name in PETSc.Options().getAll():
        if library.PetscOptionsUsed(None, name.encode(), ctypes.byref(used)):
            raise RuntimeError("PetscOptionsUsed failed")
        left += [] if used.value else [name]
    return left


def conditions() -> list[tuple[str, str]]:
    """The options that matter to a body alone: all but those of outer methods. Not collective."""
    from petsc4py import PETSc

    return sorted(pair for pair in PETSc.Options().getAll().items() if not pair[0].startswith(("newton_", "qp_")))


@contextlib.contextmanager
def asked_for() -> Iterator[set[str]]:
    """The options that the block asks for, known at its end. Not collective."""
    from petsc4py import PETSc

    options, names = PETSc.Options(), set[str]()
    given = options.getAll()
    before = set(given) - set(unused_options()) if given else set()
    for name, value in given.items() if before else ():  # a value that is set anew has not been asked for
        options.delValue(name)
        options.setValue(name, value)
    yield names
    names |= set(given) - set(unused_options()) if given else set()
    ask(before)


def ask(names: Iterable[str]) -> None:
    """Note that these options are of use. Not collective."""
    from petsc4py import PETSc

    for name in names:
        PETSc.Options().hasName(name)


def silence_left() -> None:
    """Keep PETSc from listing unused options at its end, unless the user asks for it: the run has reported them."""
    from petsc4py import PETSc

    options = PETSc.Options()
    if not options.hasName("options_left"):
        options.setValue("options_left", False)
