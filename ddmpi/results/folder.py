"""The folder of a run's results: claimed when the run starts, filled when it ends.

A run claims a folder by putting the hidden folder `.unfinished` into it, which holds a folder named after host and
process; the system lets only one run do so. There it writes its files. At the end it moves them all into place, the
summary last: results are complete or absent, and where the summary is, the rest is.
"""

import contextlib
import errno
import os
import re
import shutil
from collections.abc import Iterable, Iterator
from pathlib import Path

from ddmpi.errors import InputError, OutputError, TakenError
from ddmpi.system import logs
from ddmpi.system.files import CHECKPOINT, RECORD, SUMMARY, UNFINISHED, write_atomically, writing
from ddmpi.system.provenance import whereabouts

MOVED = ".moved"  # lists the results while they are moved into place: what to remove if the run is killed then


@contextlib.contextmanager
def choose_folder(wanted: str | None, restart: str | None, scene: str) -> Iterator[Path]:
    """Claim the folder for the results: `wanted`, that of the checkpoint to go on from, or the first new one of
    results/SCENE, results/SCENE-2, …

    The folder is new, or empty but for the run's log and a sweep's record, or the one of the checkpoint. What a killed
    run has left in it is removed. At the end the claim goes, and with it a folder that was made and is empty. Raises
    InputError where the folder holds anything else, another run is at work there, or nothing can be written;
    OutputError where the disk is full. Not collective.
    """
    if restart and os.path.isfile(restart):
        raise InputError(f"--restart {restart}: is no folder")
    first = folder = Path(wanted or restart or Path("results") / Path(scene).stem)
    k, made = 1, _make(folder)
    while not (made or wanted or restart):
        k += 1
        folder = first.with_name(f"{first.name}-{k}")
        made = _make(folder)
    try:
        try:
            _claim(folder)
            _refuse_taken(folder, restart)
        except OSError as error:
            kind = OutputError if error.errno in (errno.ENOSPC, errno.EDQUOT) else InputError
            raise kind(f"--output {folder}: cannot write there: {error.strerror}") from None
        yield folder
    finally:
        Staging(folder).discard()
        if made:
            with contextlib.suppress(OSError):  # it holds something, or is gone
                folder.rmdir()


def _make(folder: Path) -> bool:
    """Make the folder; whether it is new. Raises InputError."""
    try:
        folder.mkdir(parents=True)
    except OSError as error:
        if not os.path.isdir(folder):
            raise InputError(f"--output {folder}: cannot be made: {error.strerror}") from None
        return False
    return True


def running(folder: Path) -> str:
    """Host and process of another run that has claimed `folder`; empty if there is none, or it has ended.

    On another host, only a run of the same batch job has certainly ended. Not collective. Raises OSError.
    """
    return next(
        (claim.name for claim in (folder / UNFINISHED).glob("*") if not _has_ended(claim.name)), ""
    )


def _has_ended(name: str) -> bool:
    ours, _, *our_job = whereabouts().split()
    if name == whereabouts():  # an earlier run, whose number this process has got
        return True
    if not re.fullmatch(r"\S+ \d{1,9}( job \S+)?", name, re.ASCII):  # nothing of ours
        return False
    host, process, *job = name.split()
    return not _is_alive(int(process)) if host == ours else bool(job) and job == our_job


def _is_alive(process: int) -> bool:
    try:
        os.kill(process, 0)
        state = (
            Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[0]
        )
    except ProcessLookupError:
        return False
    except OSError:  # another user's process, or no /proc
        return True
    return state not in "ZX"  # dead, but its parent has not asked how it died


def _claim(folder: Path) -> None:
    """Claim the folder, and remove the files of a killed run. Raises OSError, InputError where another run has it. Of
    several runs that find the claim of a killed one, the first to rename the folder in it wins."""
    claim, ours = folder / UNFINISHED, folder / f"{UNFINISHED}-{whereabouts()}"
    if claim.is_symlink():
        raise InputError(f"--output {folder}: {claim} is a link; remove it")
    claimants = list(claim.glob("*"))
    if all(_has_ended(left.name) for left in claimants):
        try:
            for left in claimants:
                left.rename(claim / whereabouts())
            if claimants:
                _clear(claim)
            for left in folder.glob(f"{UNFINISHED}-*"):
                if not left.is_dir():
                    left.unlink(missing_ok=True)
            (ours / whereabouts()).mkdir(parents=True)
            ours.rename(claim)
            return
        except OSError as error:
            shutil.rmtree(ours, ignore_errors=True)
            if error.errno not in (errno.ENOTEMPTY, errno.EEXIST, errno.ENOENT):
                raise
    raise InputError(
        f"--output {folder}: another run is at work there ({running(folder)}); name another folder, or, "
        f"if that run was killed, remove {claim}"
    )


def _refuse_taken(folder: Path, restart: str | None) -> None:
    """Raise InputError where the folder holds results or other files. Raises OSError."""
    present = sorted(os.listdir(folder))
    if SUMMARY in present:
        raise InputError(
            f"--output {folder}: there are results already ({SUMMARY}); nothing is overwritten, so name "
            "another folder or remove them"
        )
    if restart is not None and os.path.exists(restart) and os.path.samefile(folder, restart):
        return
    if CHECKPOINT in present:
        raise InputError(
            f"--output {folder}: there is the checkpoint of a run that was not completed; go on "
            f"from it with --restart {folder}, name another folder, or remove {CHECKPOINT}"
        )
    others = [
        name
        for name in present
        if not (name.startswith(".") or name == RECORD or logs.is_open(folder / name))
    ]
    if others:
        raise InputError(
            f"--output {folder}: is not empty (it holds {others[0]}); name a new folder"
        )


def _clear(claim: Path) -> None:
    """Remove a claim and, unless the results are complete, the files that were moved out of it. Raises OSError."""
    if not os.path.lexists(claim):
        return
    if not os.path.lexists(claim.parent / SUMMARY):
        for moved in filter(Path.is_file, claim.glob(f"*/{MOVED}")):
            for name in re.findall(
                r"^[^/\0\n]+$", moved.read_text(encoding="utf-8", errors="replace"), re.M
            ):
                (claim.parent / name).unlink(missing_ok=True)
    shutil.rmtree(claim)


class Staging:
    """The hidden folder in which this process makes the results of `folder`; `publish` moves them into place."""

    def __init__(self, folder: Path) -> None:
        self.folder, self.path = folder, folder / UNFINISHED / whereabouts()

    def publish(self, others: Iterable[str] = ()) -> list[Path]:
        """Move all files that were written into the folder of the results, the summary last; their new paths.

        `others` are files that ranks on another host may have written, which a listing of this host may not have yet.
        Raises OutputError, TakenError where one of these files is there already; `discard` then leaves no result.
        """
        with writing(self.folder):
            written = {
                *os.listdir(self.path),
                *(name for name in others if os.path.lexists(self.path / name)),
            }
            names = [name for name in written if not name.startswith(".")]
            names.sort(key=lambda name: (name == SUMMARY, name))
            taken = [name for name in names if os.path.lexists(self.folder / name)]
            if taken:
                raise TakenError(
                    f"{self.folder / taken[0]}: is there already, and nothing is overwritten"
                )
            write_atomically(self.path / MOVED, "\n".join(names).encode())
            for name in names:
                os.rename(self.path / name, self.folder / name)
        self.discard()
        return [self.folder / name for name in names]

    def discard(self) -> None:
        """Remove the hidden folder and, unless the results are complete, what was moved out of it."""
        with contextlib.suppress(OSError):  # the run ends with an error, or its results are there
            if self.path.exists():  # else it is not this run's any more
                _clear(self.path.parent)
