"""Checkpoints: the state of a run between two iterations, and the file from which it is continued.

Before every iteration each rank notes what its objects carry from one iteration to the next; they say so
themselves, by a tuple STATE of attribute names, and by GROWS which of these are lists that only grow. So
there is always a whole state of one and the same iteration on both ranks, whatever ends the next one. It is
written when enough time or iterations have passed, when a signal ends the run, and when results cannot be
written: rank 0 gathers both parts, which are vectors of the size of the interface, into one HDF5 file, under
a temporary name that is then renamed.

The file begins with a digest of what follows (in HDF5's user block), so that damage is noticed before HDF5
sees it. It holds the scene, options and versions of its run; a run continues only its like, because only
then are the iterates those of the run that was not interrupted.
"""

from __future__ import annotations

import contextlib
import hashlib
import io
import json
import logging
import os
import re
import time
from collections import Counter, deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from mpi4py import MPI

import ddmpi
from ddmpi.coupling.assembly import Problem
from ddmpi.errors import InputError, InterruptionError, OutputError, TakenError
from ddmpi.judge.accuracy import Course
from ddmpi.methods.outer import Step
from ddmpi.scene.scene import Scene
from ddmpi.system.agreement import agreed
from ddmpi.system.clock import Clock
from ddmpi.system.files import CHECKPOINT, write_atomically

log = logging.getLogger("ddmpi")

FORMAT = b"ddmpi checkpoint 1 sha256 "

BLOCK = 512
"""Size of HDF5's user block, its smallest; FORMAT and the digest of the rest stand in it."""

MAY_DIFFER = ("title", "output", "checkpoint", "petsc", "method.max_iterations")
"""Keys of a scene that no iterate depends on; [petsc] is compared as the options it sets."""

COPIED = {list: list, dict: dict, Counter: dict, deque: deque.copy}
"""What is changed in place, and how it is noted."""

ONLY_TALK = r"(^|_)(view|monitor|log|info|reason|left|table|malloc|memory|help|version|citations|statistics)(_|$)"
"""PETSc options that print, and change no number."""


def identify(scene: Scene, options: dict[str, str], versions: dict[str, str]) -> dict[str, dict]:
    """What must be the same for a run to be continued: the scene, PETSc options, versions. Not collective."""
    def kept(key: str) -> bool:
        return not any(key == other or key.startswith(f"{other}.") for other in MAY_DIFFER)

    sources, package = hashlib.sha256(), Path(ddmpi.__file__).parent
    for path in sorted(package.rglob("*.py")):
        sources.update(path.relative_to(package).as_posix().encode() + b"\0" + path.read_bytes())
    found = {"scene": {key: value for key, value in _flat(scene.resolved()) if kept(key)},
             "PETSc options": {key: value for key, value in options.items() if not re.search(ONLY_TALK, key)},
             "versions": {name: versions[name] for name in ("ddmpi", "petsc", "numpy", "scipy")}
             | {"ddmpi's sources": sources.hexdigest()[:16]}}
    return json.loads(json.dumps(found))  # as it comes out of a file


def continue_from(world: MPI.Comm, folder: str, identity: dict[str, dict]) -> dict[str, Any]:
    """The own part of the state in the checkpoint of `folder`. Collective.

    Raises InputError, on all ranks, when there is none, when it is damaged, or made by another run than
    one of this `identity`.
    """
    states = None
    with agreed(world):
        if world.rank == 0:
            path = Path(folder) / CHECKPOINT
            theirs, states = read(path)
            _refuse_other(path, identity, theirs)
            if len(states) != world.size:
                raise InputError(f"{path}: holds {len(states)} bodies, not {world.size}")
    return world.scatter(states)


@contextlib.contextmanager
def levels_kept(world: MPI.Comm, folder: Path | None, identity: dict[str, dict], course: Course,
                restart: str | None) -> Iterator[None]:
    """A signal in the set-up of a finer mesh leaves a checkpoint of what the coarser ones have led to. Collective.

    Where the checkpoint that the run goes on from, in the folder `restart`, has that already, it says so.
    """
    known = len(course.done)
    try:
        yield
    except InterruptionError as error:
        if not error.agreed or error.kept:
            raise
        if len(course.done) > known:
            with agreed(world):
                if folder:
                    write(folder / CHECKPOINT, identity, [{"course.done": course.done}] * world.size)
            told = world.bcast(str(folder))
            error.args = (f"in the set-up of a finer mesh, which --restart {told} begins with",)
        elif restart:
            error.args = (f"before the first iteration; --restart {restart} goes on from where this run did",)
        raise


class Checkpoints:
    """The checkpoints of one run.

    Parameters
    ----------
    problem : what is solved
    folder : of the results, on rank 0; None on the others
    identity : as `identify` gives it
    clock : times the writing
    state : of this rank, to go on from; None, or one without an iteration, to begin at the beginning
    carried : further parts of the state, by name, beside those of `follow`
    """

    def __init__(self, problem: Problem, folder: Path | None, identity: dict[str, dict], clock: Clock,
                 state: dict[str, Any] | None = None, carried: dict[str, object] | None = None) -> None:
        self.problem, self.folder, self.identity, self.clock = problem, folder, identity, clock
        self.spec = problem.scene.checkpoint
        self._parts, self._carried, self._same = {}, carried or {}, {}
        self._begin, self._now = state if state and "outer.history" in state else None, None
        self._rows: dict[str, np.ndarray] = {}
        self._noted: list[tuple[str, object, str, bool]] = []
        self._written = -1
        self._last = time.monotonic()
        self._needed = True
        if folder:
            import h5py  # noqa: F401  a signal may leave a second, and to load it takes a part of that

    def follow(self, **parts: object) -> None:
        """Keep the state of `parts` from now on, and put them into the state to go on from. Collective.

        One of them is ``outer``, the iteration. Raises InputError on all ranks when the meshes are others.
        """
        exchange = self.problem.exchange
        body = self.problem.body
        self._parts = parts | self._carried | {"body": body, "compliance": body.C, "exchange": exchange}
        self._noted = [(f"{name}.{attribute}", part, attribute, attribute in getattr(part, "GROWS", ()))
                       for name, part in self._parts.items() for attribute in part.STATE]
        self._same = {"mesh": self._mesh(), "compliance": body.C.kind, "h": body.h}
        if self._begin:
            with agreed(self.problem.world):
                self._restore()
            same = self._begin["compliance"] == body.C.kind and np.array_equal(self._begin["h"], body.h)
            if not all(self.problem.world.allgather(same)):
                log.warning("this machine computes otherwise than that of the checkpoint did (another processor, less "
                            "memory): the answer will be as good, but not the same to the last digit")
            log.info("continuing after iteration %d", self._iteration)
            self._written = self._iteration
        parts["outer"].checkpoint = self._keep
        exchange.wants_checkpoint = self._time_has_come

    @property
    def _iteration(self) -> int:
        return len(self._parts["outer"].history)

    def _time_has_come(self) -> bool:
        return bool(self.folder and self.spec.seconds and time.monotonic() - self._last >= self.spec.seconds)

    def _keep(self) -> None:
        """Note the state, and write it when it is due. Collective."""
        exchange, k = self.problem.exchange, self._iteration
        now = {}
        for key, part, attribute, grows in self._noted:
            value = getattr(part, attribute)
            if grows:
                value = _First(value, len(value))
            elif type(value) in COPIED:  # numbers and arrays are never changed, but replaced
                value = COPIED[type(value)](value)
            now[key] = value
        self._now = now | self._same
        by_number = self.spec.iterations > 0 and k > 0 and k % self.spec.iterations == 0
        if k != self._written and (exchange.checkpoint_due or by_number):
            try:
                self._write()
            except OutputError as error:  # on rank 0 alone; the run is worth more than its checkpoint
                log.warning("%s; going on without", error)
        exchange.checkpoint_due = False

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """What ends the block, a signal or results that cannot be written, leaves a checkpoint. Collective."""
        try:
            yield
        except (InterruptionError, OutputError) as error:
            if not (error.agreed and self._now and self._needed):
                raise
            by_signal, world = isinstance(error, InterruptionError), self.problem.world
            folder = world.bcast(str(self.folder))
            try:
                with agreed(world):
                    self._write()
            except OutputError as failure:
                former = world.bcast(self.folder and os.path.exists(self.folder / CHECKPOINT))
                failure.args = (f"{error.kind if by_signal else error}; {failure}"
                                + (f"; --restart {folder} goes on from the checkpoint before" if former else ""),)
                raise failure from None
            k, elsewhere = self._now["outer.history"].number, " --output OTHER" if isinstance(error, TakenError) else ""
            error.args = (f"{'' if by_signal else f'{error}; '}the state after iteration {k} is kept, "
                          f"--restart {folder}{elsewhere} goes on from there",)
            error.kept = True
            raise

    def remove(self) -> None:
        """Remove the file: the results are there. Not collective, but to be called on all ranks."""
        self._needed = False
        if self.folder:
            try:
                (self.folder / CHECKPOINT).unlink(missing_ok=True)
            except OSError as error:
                log.warning("%s could not be removed: %s", self.folder / CHECKPOINT, error.strerror)

    def _write(self) -> None:
        """Gather and write the noted state. Collective; raises OutputError on rank 0 alone."""
        with self.clock.phase("checkpoint"):
            own = {name: self._all_rows(name, value) if isinstance(value, _First) else value
                   for name, value in self._now.items()}
            states = self.problem.world.gather(own)
            self._last = time.monotonic()
            self._written = self._now["outer.history"].number  # or tried to: both ranks must think the same of it
            if self.folder:
                steps = {len(state["outer.history"]) for state in states}
                assert len(steps) == 1, "the ranks' states are of different iterations"
                write(self.folder / CHECKPOINT, self.identity, states)

    def _all_rows(self, name: str, first: _First) -> np.ndarray:
        """The entries as rows; those that have been written before are not made again."""
        done = self._rows.get(name, np.empty(0))
        new = _stored(first.entries[len(done):first.number])
        self._rows[name] = np.concatenate([done, new]) if len(done) and len(new) else new if len(new) else done
        return self._rows[name]

    def _restore(self) -> None:
        state = self._begin
        if state["mesh"] != self._same["mesh"]:
            raise InputError(f"the checkpoint is of another mesh of body {self.problem.body.name!r}")
        for key, part, attribute, _ in self._noted:
            setattr(part, attribute, _like(getattr(part, attribute), state[key]))

    def _mesh(self) -> str:
        digest = hashlib.sha256()
        mesh, interface = self.problem.mesh, self.problem.interface
        for array in (mesh.points, mesh.triangles, interface.xy, interface.gap):
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


class _First(NamedTuple):
    """The first entries of a list that only grows."""

    entries: list
    number: int


def _like(now: Any, value: Any) -> Any:
    """A value out of a file, as an object of the kind that stands there now."""
    if isinstance(now, deque):
        return deque(value, now.maxlen)
    return value if isinstance(now, np.ndarray) else type(now)(value)


def write(path: Path, identity: dict[str, dict], states: list[dict[str, Any]]) -> None:
    """Write the ranks' states, so that `path` holds the old or the new file, whole. Raises OutputError.

    Lists of steps and of arrays become arrays, all else that is no array becomes JSON. Not collective.
    """
    import h5py

    image = io.BytesIO()
    with h5py.File(image, "w", userblock_size=BLOCK) as file:
        file["identity"] = json.dumps(identity)
        for rank, state in enumerate(states):
            group = file.create_group(f"rank {rank}")
            for name, value in state.items():
                group[name] = _stored(value)
    data = image.getvalue()[BLOCK:]
    head = FORMAT + hashlib.sha256(data).hexdigest().encode() + b"\n"
    write_atomically(path, head.ljust(BLOCK, b"\0") + data, durable=True)


def read(path: Path) -> tuple[dict[str, dict], list[dict[str, Any]]]:
    """Identity and states that `write` wrote. Not collective.

    Raises InputError when the file is not there, not whole, or no checkpoint.
    """
    import h5py

    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"--restart {path.parent}: there is no {path.name}, so nothing to go on from") from None
    except OSError as error:
        raise InputError(f"--restart {path.parent}: {path} cannot be read: {error.strerror}") from None
    if not data.startswith(FORMAT):
        raise InputError(f"{path}: not a checkpoint of this version of ddmpi")
    digest = hashlib.sha256(data[BLOCK:]).hexdigest().encode()
    if data[:BLOCK] != (FORMAT + digest + b"\n").ljust(BLOCK, b"\0"):
        raise InputError(f"{path}: damaged; it is not what was written")
    with h5py.File(io.BytesIO(data), "r") as file:
        identity = json.loads(file["identity"].asstr()[()])
        states = [{name: _loaded(name, entry) for name, entry in file[f"rank {rank}"].items()}
                  for rank in range(len(file) - 1)]
    return identity, states


def _stored(value: Any) -> np.ndarray | str:
    if isinstance(value, list | deque):
        value = np.array([[s.iteration, s.update, s.residual, s.inner_precision, *s.n_A] if isinstance(s, Step) else s
                          for s in value])
    return value if isinstance(value, np.ndarray) else json.dumps(value)


def _loaded(name: str, entry: Any) -> Any:
    import h5py

    if h5py.check_string_dtype(entry.dtype):
        return json.loads(entry.asstr()[()])
    value = entry[()]
    if name == "outer.history":
        return [Step(int(k), float(update), float(residual), float(precision), (int(n1), int(n2)))
                for k, update, residual, precision, n1, n2 in value]
    return value


def _refuse_other(path: Path, ours: dict[str, dict], theirs: dict[str, dict]) -> None:
    """InputError, saying what differs, unless the checkpoint is of a run like this one."""
    for what in ("versions", "scene", "PETSc options"):
        differing = [f"{key} is {_word(ours[what], key)} here, {_word(theirs[what], key)} there"
                     for key in sorted(ours[what].keys() | theirs[what].keys())
                     if ours[what].get(key) != theirs[what].get(key)]
        if differing:
            more = f", and {len(differing) - 3} more" if len(differing) > 3 else ""
            raise InputError(f"{path}: is of a run with other {what}: {'; '.join(differing[:3])}{more}; "
                             "only the same run can be continued")


def _word(table: dict, key: str) -> str:
    return repr(table[key]) if key in table else "not set"


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested tables with their keys as after ``--set``."""
    entries = None
    if isinstance(value, dict):
        entries = value.items()
    elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
        entries = ((entry.get("name", str(k)), entry) for k, entry in enumerate(value))
    if entries is None:
        yield key, value
    else:
        for name, entry in entries:
            yield from _flat(entry, f"{key}.{name}" if key else name)
