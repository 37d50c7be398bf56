"""PETSc's options: a scene's options as arguments, and the names of unused ones."""

from __future__ import annotations

import contextlib
import ctypes
import logging
import os
import re
import tempfile
from collections.abc import Iterable, Iterator
from pathlib import Path

log = logging.getLogger("ddmpi")

_SOURCE = re.compile(r" # \(source: [\w ]+\)$")
"""What PETSc prints behind an option from 3.19 on."""


def as_arguments(table: dict[str, str | int | float | bool]) -> list[str]:
    """A scene's [petsc] table as arguments of petsc4py.init, to be put before the command line's, which win."""
    pairs = ((f"-{name}", value) for name, value in _plain(table).items())
    return [word for pair in pairs for word in pair if word is not None]


def instead_of_here() -> list[str]:
    """Arguments by which PETSc reads the options in the home, and none in the current folder, which may be anybody's:
    they load libraries. Empty where there are none. Not collective."""
    here, home = Path.cwd(), Path.home() / ".petscrc"
    found = [
        here / name
        for name in (".petscrc", "petscrc")
        if os.path.lexists(here / name) and here / name != home
    ]
    if not found:
        return []
    log.warning(
        "%s is not read: options of the current folder may be anybody's; give them on the command line, in "
        "PETSC_OPTIONS or in %s",
        found[0],
        home,
    )
    return ["-skip_petscrc", *(["-options_file", str(home)] if home.is_file() else [])]


def forget(name: str) -> None:
    """Remove an option, as if it had not been given. Not collective."""
    from petsc4py import PETSc

    PETSc.Options().delValue(name)


def _plain(table: dict[str, str | int | float | bool]) -> dict[str, str | None]:
    """Names without a dash, and values as PETSc reads them; true becomes an option without a value."""
    return {
        name.lstrip("-"): None if value is True else "false" if value is False else str(value)
        for name, value in table.items()
    }


def in_force() -> dict[str, str | None]:
    """All options of PETSc by name, less a dash; None for one without a value. Not collective.

    From the table that PETSc prints, with an option a line: petsc4py's `getAll` splits a line of all of them at blanks,
    and so takes a value such as "b -x 3" for two options.
    """
    from petsc4py import PETSc  # only after petsc4py.init, which takes the arguments

    options = PETSc.Options()
    if not options.getAll():
        return {}
    with open(_file_without_name(), encoding="utf-8", errors="surrogateescape") as page:
        viewer = PETSc.Viewer().createASCII(f"/dev/fd/{page.fileno()}", comm=PETSc.COMM_SELF)
        options.view(viewer)
        viewer.destroy()
        page.seek(0)
        lines = [_SOURCE.sub("", line) for line in page.read().split("\n") if line.startswith("-")]
    return {
        name: value if blank else None
        for name, blank, value in (line[1:].partition(" ") for line in lines)
    }


def _file_without_name() -> int:
    """The descriptor of a new file: in memory, where the system has such files (Linux)."""
    if hasattr(os, "memfd_create"):
        return os.memfd_create("options")
    number, name = tempfile.mkstemp()
    os.unlink(name)
    return number


class RunOptions:
    """PETSc's options for several runs of one process: those of the scene of a run and of the command line.

    Construct it after petsc4py.init. Not collective, but all ranks must do the same.
    """

    def __init__(self) -> None:
        self._given = in_force()
        self._used = set(self._given) - set(unused_options())  # by PetscInitialize

    def given(self, name: str) -> bool:
        """Whether petsc4py.init was given this option, or has found it; PETSc ignores case."""
        return name.lstrip("-").lower() in {known.lower() for known in self._given}

    def use(self, table: dict[str, str | int | float | bool]) -> None:
        """Set the options of the scene's [petsc] `table`, and those given to petsc4py.init, which win."""
        scene = {name: value for name, value in _plain(table).items() if not self.given(name)}
        _replace(scene | self._given)
        ask(self._used)


def unused_options() -> list[str]:
    """Names of options that no object has asked for so far. Not collective."""
    from petsc4py import PETSc

    library, used, left = (
        ctypes.CDLL(PETSc.__file__),
        ctypes.c_int(),
        [],
    )  # petsc4py 3.18 does not wrap it
    for name in in_force():
        if library.PetscOptionsUsed(None, os.fsencode(name), ctypes.byref(used)):
            raise RuntimeError("PetscOptionsUsed failed")
        left += [] if used.value else [name]
    return left


def unused_words(names: list[str]) -> list[str]:
    """The warning of options that no object has asked for, if there are any."""
    told = "PETSc options that nothing used: {} (solvers have those with the prefixes body_, newton_ and qp_)"
    return [told.format(", ".join(names))] if names else []


def conditions() -> list[tuple[str, str | None]]:
    """The options that matter to a body alone: all but those of outer methods. Not collective."""
    return sorted(pair for pair in in_force().items() if not pair[0].startswith(("newton_", "qp_")))


@contextlib.contextmanager
def asked_for() -> Iterator[set[str]]:
    """The options that the block asks for, known at its end. Not collective."""
    names, given = set[str](), in_force()
    before = set(given) - set(unused_options())
    if before:
        _replace(given)  # a value that is set anew has not been asked for
    yield names
    names |= set(given) - set(unused_options())
    ask(before)


def _replace(values: dict[str, str | None]) -> None:
    """Make these all options, none of them asked for."""
    from petsc4py import PETSc

    options = PETSc.Options()
    for name in in_force():
        options.delValue(f"-{name}")
    for name, value in values.items():
        options.setValue(f"-{name}", value)


def ask(names: Iterable[str]) -> None:
    """Note that these options are of use. Not collective."""
    from petsc4py import PETSc

    for name in names:
        PETSc.Options().hasName(f"-{name}")


def silence_left() -> None:
    """Keep PETSc from listing unused options at its end, unless the user asks for it: the run has reported them."""
    from petsc4py import PETSc

    options = PETSc.Options()
    if not options.hasName("options_left"):
        options.setValue("options_left", False)
