"""PETSc's options: those of a scene as arguments, and those that nobody used."""

from __future__ import annotations

import ctypes


def as_arguments(table: dict[str, str | int | float | bool]) -> list[str]:
    """A scene's [petsc] table as arguments of petsc4py.init; put before the command line's, which win."""
    arguments = []
    for name, value in table.items():
        arguments.append(f"-{name.lstrip('-')}")
        if value is not True:  # a bare option is a flag that is set
            arguments.append("false" if value is False else str(value))
    return arguments


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
