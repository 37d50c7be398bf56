"""The folder of a run's results: claimed when the run starts, filled when it ends.

A run claims a folder by putting the hidden folder `.unfinished` into it, complete with a folder named after its host
and process, which the system lets one run do only. In there it writes its files. At the end it moves all of them into
place, the summary last: results are complete or absent, and where the summary is, the rest is.
"""

from __future__ import annotations

import contextlib
import errno
import os
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path

from ddmpi.errors import InputError, OutputError, TakenError
from ddmpi.system import logs
from ddmpi.system.files import CHECKPOINT, RECORD, SUMMARY, UNFINISHED, write_atomically
from ddmpi.system.provenance import whereabouts

MOVED = ".moved"
"""A file that lists the results while they are moved into place: what to remove if the run is killed just then."""


@contextlib.contextmanager
def choose_folder(wanted: str | None, restart: str | None, scene: str) -> Iterator[Path]:
    """Claim the folder for the results: `wanted`, that of the checkpoint to go on from, or the first new one of
    results/SCENE, results/SCENE-2, …

    The folder is new, or empty but for the run's log and a sweep's record, or the one of the checkpoint. What a killed
    run has left in it is removed. At the end the claim goes, and with it a folder that was made and is empty.

    Raises
    ------
    InputError
        where the folder holds anything else, where another run is at work, and where nothing can be written
    OutputError
        where the disk is full

    Not collective.
    """
    folder = Path(wanted or restart or Path("results") / Path(scene).stem)
    stem, k, made = folder, 1, _make(folder)
    while wanted is None and restart is None and not made:
        k += 1
        folder = stem.with_name(f"{stem.name}-{k}")
        made = _make(folder)
    with contextlib.ExitStack() as stack:
        if made:
            stack.callback(_remove_empty, folder)
        try:
            here = restart is not None and os.path.exists(restart) and os.path.samefile(folder, restart)
            _claim(folder, known=here or os.path.exists(folder / RECORD))
            stack.callback(Staging(folder).discard)
            _refuse_taken(folder, here)
        except OSError as error:
            kind = OutputError if error.errno in (errno.ENOSPC, errno.EDQUOT) else InputError
            raise kind(f"--output {folder}: cannot write there: {error.strerror}") from None
        yield folder


def _make(folder: Path) -> bool:
    """Make the folder; whether it was not there. Raises InputError."""
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        if not os.path.isdir(folder):
            raise InputError(f"--output {folder}: cannot be made: {error.strerror}") from None
        return False
    return True


def _remove_empty(folder: Path) -> None:
    with contextlib.suppress(OSError):  # it holds something, or is gone
        folder.rmdir()


def running(folder: Path, known: bool = True) -> str:
    """Host and process of another run that has claimed `folder`; nothing where there is none, or it has ended.

    A process on another host counts as ended where its run is `known`, as that of a checkpoint or of a sweep, or is of
    the same batch job. Not collective. Raises OSError.
    """
    ours, _, *our_job = whereabouts().split()
    for claim in (folder / UNFINISHED).glob("*"):
        host, process, *job = claim.name.split()
        alive = _is_alive(int(process)) if host == ours else not (known or job == our_job != [])
        if alive and claim.name != whereabouts():
            return claim.name
    return ""


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
        state = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
    except ProcessLookupError:
        return False
    except OSError:  # another user's process, or no /proc
        return True
    return state not in "ZX"  # dead, but its parent has not asked how it died


def _claim(folder: Path, known: bool) -> None:
    """Claim the folder, and remove what a killed run has left. Raises OSError, InputError where another run has it."""
    claim, ours = folder / UNFINISHED, folder / f"{UNFINISHED}-{whereabouts()}"
    owner = running(folder, known)
    if not owner:
        _clear(claim)
        for left in folder.glob(f"{UNFINISHED}-*"):
            if not left.is_dir():
                left.unlink(missing_ok=True)
        (ours / whereabouts()).mkdir(parents=True)
        try:
            ours.rename(claim)
            return
        except OSError as error:
            shutil.rmtree(ours)
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST):
                raise
        owner = running(folder, known)
    raise InputError(f"--output {folder}: another run is at work there ({owner}); name another folder, or, if that run "
                     f"was killed, remove {claim}")


def _refuse_taken(folder: Path, here: bool) -> None:
    """InputError where the folder holds what a run that does not go on from `here` cannot have made. Raises OSError."""
    present = sorted(os.listdir(folder))
    if SUMMARY in present:
        raise InputError(f"--output {folder}: there are results already ({SUMMARY}); nothing is overwritten, so name "
                         "another folder or remove them")
    if here:
        return
    if CHECKPOINT in present:
        raise InputError(f"--output {folder}: there is the checkpoint of a run that was not completed; go on "
                         f"from it with --restart {folder}, name another folder, or remove {CHECKPOINT}")
    others = [name for name in present
              if not (name.startswith(".") or name == RECORD or logs.is_open(folder / name))]
    if others:
        raise InputError(f"--output {folder}: is not empty (it holds {others[0]}); name a new folder")


def _clear(claim: Path) -> None:
    """Remove a claim and, unless the results are complete, the files that were moved out of it. Raises OSError."""
    if not os.path.lexists(claim):
        return
    for moved in claim.glob(f"*/{MOVED}") if not os.path.lexists(claim.parent / SUMMARY) else ():
        for name in moved.read_text(encoding="utf-8").split("\n"):
            (claim.parent / name).unlink(missing_ok=True)
    shutil.rmtree(claim)


class Staging:
    """The hidden folder in which this process makes the results of `folder`; `publish` moves them into place."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / UNFINISHED / whereabouts()

    def create(self) -> None:
        """See that the hidden folder is still there. Raises OutputError."""
        _guarded(self.path.stat, self.path)

    def publish(self) -> list[Path]:
        """Move all files that were written into the folder of the results, the summary last; their new paths.

        Hidden files stay behind. Raises OutputError, and TakenError where a file of one of these names is there
        already; after both, `discard` leaves no result behind.
        """
        def move() -> list[Path]:
            names = [name for name in os.listdir(self.path) if not name.startswith(".")]
            names.sort(key=lambda name: (name == SUMMARY, name))
            taken = [name for name in names if os.path.lexists(self.folder / name)]
            if taken:
                raise TakenError(f"{self.folder / taken[0]}: is there already, and nothing is overwritten")
            write_atomically(self.path / MOVED, "\n".join(names).encode())
            for name in names:
                os.rename(self.path / name, self.folder / name)
            return [self.folder / name for name in names]
        files = _guarded(move, self.folder)
        self.discard()
        return files

    def discard(self) -> None:
        """Remove the hidden folder and, unless the results are complete, what was moved out of it."""
        with contextlib.suppress(OSError):  # the run ends with an error, or its results are there
            if self.path.exists():  # else it is not this run's any more
                _clear(self.path.parent)


def _guarded(action: Callable, path: Path):
    """Run a file operation on `path`; an OSError becomes an OutputError."""
    try:
        return action()
    except OSError as error:
        raise OutputError(f"results could not be written: {error.filename or path}: "
                          f"{error.strerror or error}") from None
