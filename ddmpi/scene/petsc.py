"""What a scene may ask for of PETSc and of Python: options and code that reach beyond it are refused."""

from pathlib import Path

from ddmpi.errors import InputError
from ddmpi.petsc.harmless import check_petsc
from ddmpi.scene.values import Number

PETScOptions = dict[str, str | int | Number | bool]
"""PETSc options of solvers by name without the dash."""


def refuse_reaching(path: str, data: dict) -> str:
    """Refuse what a scene may not ask for, as whoever starts a run may: PETSc's options that reach beyond it, and code.

    Returns the class that the scene names as method.outer, which is taken out of the data; empty if there is none.
    Raises InputError for the options, and for a folder of meshes elsewhere.
    """
    method = data.get("method")
    options = data.get("petsc")
    output = data.get("output")
    cache = output.get("cache") if isinstance(output, dict) else None
    if isinstance(cache, str) and not cache.isprintable():
        raise InputError(f"{path}: output.cache: {cache!r} has control characters")
    if isinstance(cache, str) and (Path(cache).is_absolute() or ".." in Path(cache).parts):
        raise InputError(
            f"{path}: output.cache: a scene may name a folder beside its results alone, without ..; for the folder "
            f"{cache!r} start with --set output.cache={cache}"
        )
    try:
        check_petsc(options if isinstance(options, dict) else {})
    except ValueError as error:
        raise InputError(f"{path}: {error}") from None
    named = method.get("outer") if isinstance(method, dict) else None
    return (
        method.pop("outer")
        if isinstance(method, dict) and isinstance(named, str) and ":" in named
        else ""
    )


def code_of(named: str) -> str:
    """What to say of a scene that names a class as method.outer."""
    return (
        f'method.outer: "{named}" is code from outside ddmpi, which no scene may start; if you trust it, leave the '
        f"line out and start with --set method.outer={named}, in Python with outer=…"
    )
