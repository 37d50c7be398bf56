"""Result files: complete or absent. They are written under temporary names and get their own at the end.

Each body's ranks write their own part of the fields, in turn, so that nothing of the size of a body
crosses ranks.
"""

from __future__ import annotations

import contextlib
import csv
import json
import os
import shutil
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
import numpy as np
from ddmpi.methods.outer import Step
from ddmpi.interface.state import ContactState
from ddmpi.errors import HeldError, InputError, OutputError, TakenError
from ddmpi.system.files import CHECKPOINT, FileOfHDF5, clear_unfinished, link_new, locked, publishing, unfinished
from ddmpi.system.files import RESULTS as NAMES
from ddmpi.interface.interface import Interface



@contextlib.contextmanager
def choose_folder(wanted: str | None, restart: str | None, scene: str) -> Iterator[Path]:
    """The folder for the results: `wanted`, that of the run to go on from, or the first free one of
    results/SCENE, results/SCENE-2, …; meanwhile no other run can have it.

    Raises InputError where results or another run's checkpoint stand already or nothing can be written, HeldError
    where another run is at it. Not collective; creates the folder, and removes it at the end if nothing is in it.
    Removes what a run that was killed while it wrote has left.
    """
    with contextlib.ExitStack() as held:
        if wanted is None and restart is None:
            stem, k = Path("results") / Path(scene).stem, 1
            folder = stem
            while not _take(folder, held, new=True):
                k += 1
                folder = stem.with_name(f"{stem.name}-{k}")
        else:
            folder = Path(restart if wanted is None else wanted)
            if not _take(folder, held):
                raise HeldError(f"--output {folder}: another run is writing there; wait for its end, or name another "
                                "folder")
        torn = _refuse_taken(folder, restart)
        try:
            probe = folder / f".writable-{os.getpid()}"
            probe.touch()
            probe.unlink()
            clear_unfinished(folder)
            if torn and publishing(folder):  # no lock tells whether it still runs
                raise HeldError(f"--output {folder}: another run is writing there; if it was killed on another host, "
                                f"remove {', '.join(publishing(folder))}")
            for name in torn:
                (folder / name).unlink()
        except OSError as error:
            raise InputError(f"--output {folder}: cannot write there: {error.strerror}") from None
        yield folder


def _take(folder: Path, held: contextlib.ExitStack, new: bool = False) -> bool:
    """Make the folder and lock it as long as `held` lasts; whether no other run has it, nor, as a `new` one, had it."""
    try:
        folder.mkdir(parents=True)
        made = True
    except OSError as error:
        if new and isinstance(error, FileExistsError):
            return False
        if not os.path.isdir(folder):
            raise InputError(f"--output {folder}: cannot be made: {error.strerror}") from None
        made = False
    try:
        held.enter_context(locked(folder))
    except BlockingIOError:
        return False
    except OSError as error:
        raise InputError(f"--output {folder}: cannot write there: {error.strerror}") from None
    if made:
        held.callback(_remove_empty, folder)
    return True


def _remove_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):  # there is something in it
        folder.rmdir()


def _refuse_taken(folder: Path, restart: str | None) -> list[str]:
    """InputError where results or a checkpoint are in the way; names of files of a run that was killed between two
    of their appearances.
    """
    present = [name for name in NAMES if os.path.lexists(folder / name)]
    checkpoint = os.path.lexists(folder / CHECKPOINT)
    here = checkpoint and restart is not None and os.path.exists(restart) and os.path.samefile(folder, restart)
    if present and not (here and "summary.json" not in present):
        raise InputError(f"--output {folder}: there are results already ({', '.join(present)}); "
                         "nothing is overwritten, so name another folder or remove them")
    if checkpoint and not here:
        raise InputError(f"--output {folder}: there is the checkpoint of a run that was not completed; go on "
                         f"from it with --restart {folder}, name another folder, or remove {CHECKPOINT}")
    return present


class Staging:
    """A folder beside the results in which they are made; `publish` moves them into place."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, unfinished(folder / "results")

    def create(self) -> None:
        _guarded(self.path.mkdir, self.path)

    def publish(self) -> list[Path]:
        """Give all files their names in the result folder, the summary last, over no file that is there.

        Raises TakenError where one is, OutputError; then none of ours is there.
        """
        def link() -> list[Path]:
            names = [name for name in NAMES if (self.path / name).exists()]
            done: list[Path] = []
            try:
                for name in sorted(names, key=lambda name: name == "summary.json"):
                    link_new(self.path / name, self.folder / name)
                    done.append(self.folder / name)
            except OSError as error:
                for path in done:
                    path.unlink(missing_ok=True)
                if isinstance(error, FileExistsError):
                    raise TakenError(f"{self.folder}: another run has put its results there meanwhile ({name}); "
                                     "nothing is overwritten") from None
                raise
            return [self.folder / name for name in names]
        files = _guarded(link, self.folder)
        self.discard()
        return files

    def discard(self) -> None:
        """Remove what was made so far."""
        shutil.rmtree(self.path, ignore_errors=True)


def _guarded(action: Callable, path: Path):
    """Run a file operation on `path`; what the system refuses is an OutputError."""
    try:
        return action()
    except OSError as error:
        raise OutputError(f"results could not be written: {error.filename or path}: "
                          f"{error.strerror or error}") from None
