"""A communicator that counts what a rank gives and gets, by what it is for.

    answer = ddmpi.solve(scene, Counted(MPI.COMM_WORLD))
    COUNTED=FOLDER DDMPI_LOCKSTEP=tests/support/counted.py mpirun -n 16 python -m ddmpi run SCENE.toml

The second way writes RANK.json into the folder. PETSc's own messages are not counted.
"""

from __future__ import annotations

import atexit
import functools
import json
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

import ddmpi

NEIGHBOURS, FIRST, COARSE, SCENE, OTHERS = KINDS = (
    "neighbours",
    "to the first rank",
    "coarse problem",
    "scene, and in Python the answer",
    "the same for any number of bodies",
)

TO_NEIGHBOURS = ("isend", "Isend", "recv", "Irecv")
TO_FIRST = ("gather", "scatter")
OTHER = ("allgather", "Allgather", "allreduce", "Allreduce", "bcast", "Bcast", "Reduce")

OF_MOTIONS = ("gather_motions", "of_all", "first_closed", "sums", "correct", "CoarseSystem")
"""Functions that give and get something for each rigid motion: the coarse problem's share."""

_PACKAGE = str(Path(ddmpi.__file__).parent) + os.sep

GIVEN, GOT = 0, 1
_found: dict[str, Counter[int]] = defaultdict(Counter)


class Counted(MPI.Intracomm):
    """A communicator whose messages are counted in `counts`."""


def counts() -> dict[str, tuple[int, int]]:
    """The bytes that this rank has given and got so far, by kind."""
    return {kind: (_found[kind][GIVEN], _found[kind][GOT]) for kind in KINDS}


def _size(what: Any, plain: bool) -> int:
    if what is None or what is MPI.IN_PLACE:
        return 0
    return np.asarray(what).nbytes if plain else len(MPI.pickle.dumps(what))


def _kind(name: str) -> str:
    frame, functions = sys._getframe(2), list[str]()
    while frame:
        if frame.f_code.co_filename.startswith(_PACKAGE):
            functions.append(getattr(frame.f_code, "co_qualname", frame.f_code.co_name))
            own = frame.f_locals.get("self")
            functions.append(type(own).__name__)
        frame = frame.f_back  # type: ignore[assignment]
    if name in TO_NEIGHBOURS:
        return NEIGHBOURS
    if not {each.rpartition(".")[2] for each in functions}.isdisjoint(OF_MOTIONS):
        return COARSE
    if name in TO_FIRST:
        return FIRST
    return OTHERS if "compute" in functions else SCENE


def _counted(name: str) -> Callable[..., Any]:
    """The method `name` of a communicator, which notes what is given and got."""
    plain, arrays = getattr(MPI.Intracomm, name), name[0].isupper()

    @functools.wraps(plain)
    def call(self: Counted, *arguments: Any, **named: Any) -> Any:
        result, kind = plain(self, *arguments, **named), _kind(name)
        given = arguments[0] if arguments and name not in ("recv", "Irecv") else None
        if name in ("bcast", "Bcast", "scatter") and self.rank:
            given = None
        _found[kind][GIVEN] += _size(given, arrays)
        if name in ("allgather", "gather"):
            _found[kind][GOT] += sum(_size(each, arrays) for each in result or ())
        elif name in ("isend", "Isend") or (
            name in ("Reduce", "Bcast", "bcast") and (self.rank == 0) == (name != "Reduce")
        ):
            pass
        else:
            _found[kind][GOT] += _size(
                arguments[min(name[1:] in ("llreduce", "llgather", "educe"), len(arguments) - 1)]
                if arrays
                else result,
                arrays,
            )
        return result

    return call


for _name in (*TO_NEIGHBOURS, *TO_FIRST, *OTHER):
    setattr(Counted, _name, _counted(_name))


def compared(comm: MPI.Comm) -> Counted:
    """The communicator as a `Counted`; if COUNTED names a folder, what was counted is written there in the end."""
    if "COUNTED" in os.environ:
        path = Path(os.environ["COUNTED"]) / f"{MPI.COMM_WORLD.rank}.json"
        atexit.register(lambda: path.write_text(json.dumps(counts()), encoding="utf-8"))
    return Counted(comm)
