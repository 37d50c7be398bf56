"""PETSc's options: those of a scene as arguments, and those that nobody used."""

from __future__ import annotations

import ctypes


def as_arguments(table: dict[str, str | int | float | bool]) -> list[str]:
    """A scene's [petsc] table as arguments of petsc4py.init; put before the command line's, which win."""
    arguments = []
    for name, value in _plain(table).items():
        arguments += [f"-{name}"] if value is None else [f"-{name}", value]
    return arguments


def _plain(table: dict[str, str | int | float | bool]) -> dict[str, str | None]:
    """Names without a dash and values as PETSc reads them; a bare option is a flag that is set."""
    return {name.lstrip("-"): None if value is True else "false" if value is False else str(value)
            for name, value in table.items()}


class RunOptions:
    """PETSc's options for several runs of one process: each sees its scene's and the command line's, and
    nothing that an earlier run has set or used.

    To be made after petsc4py.init. Not collective; all ranks do the same.
    """

    def __init__(self) -> None:
        from petsc4py import PETSc

        self._options = PETSc.Options()
        self._given = self._options.getAll()
        self._consumed = set(self._given) - set(unused_options())  # by PetscInitialize, and so used

    def overrides(self, table: dict[str, str | int | float | bool]) -> dict[str, str | None]:
        """Those of `table` that were given to petsc4py.init, or found by it, with other values, and these values."""
        given = {name.lower(): value for name, value in self._given.items()}  # as PETSc, which minds no capitals
        return {name: given[name.lower()] for name, value in _plain(table).items()
                if name.lower() in given and given[name.lower()] != value}

    def use(self, table: dict[str, str | int | float | bool]) -> None:
        """Options from now on: those of the scene's [petsc] `table`, and those given to petsc4py.init, which win."""
        self.reset()
        given = {name.lower() for name in self._given}
        for name, value in _plain(table).items():
            if name.lower() not in given:
                self._options.setValue(name, value)

    def reset(self) -> None:
        """Back to those given to petsc4py.init, as fresh as they were then."""
        for name in self._options.getAll():
            self._options.delValue(name)
        for name, value in self._given.items():
            self._options.setValue(name, value)
            if name in self._consumed:
                self._options.hasName(name)  # PETSc notes that it was asked for


def unused_options() -> list[str]:
    """Names of options that no object has asked for so far. Not collective.

    petsc4py wraps PetscOptionsLeftGet in no version, so it is called through ctypes.
    """
    from petsc4py import PETSc  # not before petsc4py.init has had the arguments

    library = ctypes.CDLL(PETSc.__file__)
    count = ctypes.c_int64 if PETSc.IntType().itemsize == 8 else ctypes.c_int32
    number, names, values = count(), ctypes.POINTER(ctypes.c_char_p)(), ctypes.POINTER(ctypes.c_char_p)()
    library.PetscOptionsLeftGet.argtypes = [ctypes.c_void_p] + [ctypes.c_void_p] * 3
    references = [ctypes.byref(x) for x in (number, names, values)]
    if library.PetscOptionsLeftGet(None, *references):
        raise RuntimeError("PetscOptionsLeftGet failed")
    left = [names[i].decode() for i in range(number.value)]
    library.PetscOptionsLeftRestore.argtypes = library.PetscOptionsLeftGet.argtypes
    library.PetscOptionsLeftRestore(None, *references)
    return left


def silence_left() -> None:
    """Keep PETSc from listing unused options when it ends, as newer versions do: they have been named by then.

    Whoever sets -options_left gets the list all the same. Not collective.
    """
    from petsc4py import PETSc

    options = PETSc.Options()
    if not options.hasName("options_left"):
        options.setValue("options_left", False)
