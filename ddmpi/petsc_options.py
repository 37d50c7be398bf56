"""PETSc's options database: fill it from the scene, and ask what nobody used."""

from __future__ import annotations

import ctypes

from petsc4py import PETSc


def insert_options(table: dict[str, str | int | float | bool]) -> None:
    """Put a scene's [petsc] table into the database; what stands there already (command line) wins."""
    options = PETSc.Options()
    for name, value in table.items():
        name = name.lstrip("-")
        if not options.hasName(name):
            options.setValue(name, str(value).lower() if isinstance(value, bool) else str(value))


def unused_options() -> list[str]:
    """Names of options that no object has asked for so far. Not collective.

    petsc4py wraps PetscOptionsLeftGet in no version, so it is called through ctypes.
    """
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
