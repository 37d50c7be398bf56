"""Checkpoints: the state of a run between two iterations, and the file from which it is continued.

Before every iteration each rank notes the `state()` of its objects, so that there is always a whole state of one
and the same iteration on all ranks, whatever ends the next one. It is written when enough time or iterations have
passed, when a signal ends the run, and when results cannot be written: rank 0 gathers the ranks' parts, which are
vectors of the size of the interfaces, into one HDF5 file, under a temporary name that is then renamed.

The file begins with a digest of what follows (in HDF5's user block), so that damage is noticed before HDF5
sees it. It holds the scene, options and versions of its run. A run with another scene or other options is refused;
other versions are a warning, because the answer is then as good, but not the same to the last bit.
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
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly
from ddmpi.errors import InputError, InterruptionError, OutputError, TakenError
from ddmpi.judge.accuracy import MeshLadder
from ddmpi.methods.outer import Outer
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agreed
from ddmpi.system.clock import Clock
from ddmpi.system.files import CHECKPOINT, write_atomically

log = logging.getLogger("ddmpi")

FORMAT = b"ddmpi checkpoint 2 sha256 "
BLOCK = 512
"""Size of HDF5's user block, its smallest; FORMAT and the digest of the rest stand in it."""

MAY_DIFFER = ("title", "output", "checkpoint", "petsc", "method.max_iterations")
"""Keys of a scene that no iterate depends on; [petsc] is compared as the options it sets."""

ONLY_PRINT = r"(^|_)(view|monitor|log|info|reason|left|table|malloc|memory|help|version|citations|statistics)(_|$)"
"""PETSc options that print, and change no number."""


class Part(Protocol):
    """What carries something from one iteration to the next."""

    def state(self) -> dict[str, Any]:
        """Numbers, words, arrays, lists of numbers or of equal rows of them, and tables of all these."""

    def restore(self, state: dict[str, Any]) -> None: ...


def identify(scene: Settled, options: dict[str, str], versions: dict[str, str]) -> dict[str, dict]:
    """What a run is known by: the scene, PETSc options, versions. Not collective."""
    def kept(key: str) -> bool:
        return not any(key == other or key.startswith(f"{other}.") for other in MAY_DIFFER)

    found = {"scene": {key: value for key, value in _flat(scene.resolved()) if kept(key)},
             "PETSc options": {key: value for key, value in options.items() if not re.search(ONLY_PRINT, key)},
             "versions": {name: versions[name] for name in ("ddmpi", "petsc", "numpy", "scipy")}}
    return json.loads(json.dumps(found))  # as it comes out of a file


def continue_from(world: MPI.Comm, folder: str, identity: dict[str, dict]) -> dict[str, Any]:
    """The own part of the state in the checkpoint of `folder`. Collective.

    Raises InputError, on all ranks, when there is no checkpoint, when it is damaged, or made by another run than
    one of this `identity`.
    """
    states: list[dict[str, Any]] = []
    with agreed(world):
        if world.rank == 0:
            path = Path(folder) / CHECKPOINT
            theirs, states = read(path)
            _compare(path, identity, theirs)
            if len(states) != world.size:
                raise InputError(f"{path}: holds {len(states)} bodies, not {world.size}")
    return world.scatter(states)


@contextlib.contextmanager
def levels_kept(world: MPI.Comm, folder: Path | None, identity: dict[str, dict], ladder: MeshLadder,
                restart: str | None) -> Iterator[None]:
    """A signal in the set-up of a finer mesh leaves a checkpoint of what the coarser ones have led to. Collective.

    Where the checkpoint that the run goes on from, in the folder `restart`, has that already, the message says so.
    """
    known = len(ladder.done)
    try:
        yield
    except InterruptionError as error:
        if not error.agreed or error.kept:
            raise
        if len(ladder.done) > known:
            with agreed(world):
                if folder:
                    write(folder / CHECKPOINT, identity, [{"ladder": ladder.state()}] * world.size)
            error.args = (f"in the set-up of a finer mesh, which --restart {world.bcast(str(folder))} begins with",)
        elif restart:
            error.args = (f"before the first iteration; --restart {restart} goes on from where this run did",)
        raise


class Checkpoints:
    """The checkpoints of one run.

    Parameters
    ----------
    assembly : what is solved
    folder : of the results, on rank 0; None on the others
    identity : as `identify` gives it
    clock : times the writing
    state : of this rank, to go on from; None, or one without an iteration, to begin at the beginning
    carried : further parts of the state, by name, beside those of `follow`
    """

    def __init__(self, assembly: Assembly, folder: Path | None, identity: dict[str, dict], clock: Clock,
                 state: dict[str, Any] | None = None, carried: dict[str, Part] | None = None) -> None:
        self.assembly, self.folder, self.identity, self.clock = assembly, folder, identity, clock
        self.spec = assembly.scene.checkpoint
        self._begin = state if state and "outer" in state else None
        self._parts: dict[str, Part] = dict(carried or {})
        self._fixed: dict[str, Any] = {}
        self._now: dict[str, Any] = {}
        self._at = 0
        self._written, self._last, self._needed = -1, time.monotonic(), True
        if folder:
            import h5py  # noqa: F401  a signal may leave a second, and to load it takes a part of that

    def follow(self, outer: Outer, **parts: Part) -> None:
        """Keep the state of the iteration and of other `parts` from now on; restore what there is to go on from.

        Collective. Raises InputError on all ranks when the checkpoint is of other meshes.
        """
        assembly, C = self.assembly, self.assembly.member.C
        self._parts |= parts | {"outer": outer, "compliance": C, "exchange": assembly.exchange}
        self._fixed = {"mesh": self._mesh(), "kind": C.kind, "h": assembly.member.h}
        if self._begin:
            self._restore(self._begin, outer)
        outer.checkpoint = lambda: self._note(len(outer.history))
        assembly.exchange.wants_checkpoint = self._is_due

    def _restore(self, state: dict[str, Any], outer: Outer) -> None:
        with agreed(self.assembly.world):
            if state["mesh"] != self._fixed["mesh"]:
                raise InputError(f"the checkpoint is of another mesh of body {self.assembly.member.name!r}")
        for name, part in self._parts.items():
            part.restore(state[name])
        same = state["kind"] == self._fixed["kind"] and np.array_equal(state["h"], self._fixed["h"])
        if not all(self.assembly.world.allgather(same)):
            log.warning("this machine computes otherwise than that of the checkpoint did (another processor, less "
                        "memory): the answer will be as good, but not the same to the last digit")
        self._written = len(outer.history)
        log.info("continuing after iteration %d", self._written)

    def _is_due(self) -> bool:
        return bool(self.folder and self.spec.seconds and time.monotonic() - self._last >= self.spec.seconds)

    def _note(self, k: int) -> None:
        """Note the state after iteration k, and write it when it is due. Collective."""
        exchange = self.assembly.exchange
        self._at = k
        self._now = {name: part.state() for name, part in self._parts.items()} | self._fixed
        by_number = self.spec.iterations > 0 and k > 0 and k % self.spec.iterations == 0
        if k != self._written and (exchange.checkpoint_due or by_number):
            try:
                self._write()
            except OutputError as error:  # on rank 0 alone; the run is worth more than its checkpoint
                log.warning("%s; going on without", error)
        exchange.checkpoint_due = False

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """An error that ends the block, a signal or results that cannot be written, leaves a checkpoint. Collective."""
        try:
            yield
        except (InterruptionError, OutputError) as error:
            if not (error.agreed and self._now and self._needed):
                raise
            by_signal, world = isinstance(error, InterruptionError), self.assembly.world
            folder = world.bcast(str(self.folder))
            try:
                with agreed(world):
                    self._write()
            except OutputError as failure:
                former = world.bcast(self.folder and os.path.exists(self.folder / CHECKPOINT))
                failure.args = (f"{error.kind if by_signal else error}; {failure}"
                                + (f"; --restart {folder} goes on from the checkpoint before" if former else ""),)
                raise failure from None
            elsewhere = " --output OTHER" if isinstance(error, TakenError) else ""
            error.args = (f"{'' if by_signal else f'{error}; '}the state after iteration {self._at} is kept, "
                          f"--restart {folder}{elsewhere} goes on from there",)
            if isinstance(error, InterruptionError):
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
            states = self.assembly.world.gather(self._now)
            self._last, self._written = time.monotonic(), self._at
            if self.folder and states:
                assert len({len(state["outer"]["history"]) for state in states}) == 1, "states of different iterations"
                write(self.folder / CHECKPOINT, self.identity, states)

    def _mesh(self) -> str:
        """A digest of the own mesh and of the interfaces."""
        digest, mesh = hashlib.sha256(), self.assembly.mesh
        arrays = [mesh.points, mesh.triangles]
        for interface in self.assembly.space.interfaces:
            arrays += [interface.xy, interface.gap]
        for array in arrays:
            digest.update(np.ascontiguousarray(array).tobytes())
        return digest.hexdigest()


# The file


def write(path: Path, identity: dict[str, dict], states: list[dict[str, Any]]) -> None:
    """Write the ranks' states, so that `path` holds the old or the new file, whole. Raises OutputError.

    Tables become groups, arrays and lists become arrays, all else becomes JSON. Not collective.
    """
    import h5py

    image = io.BytesIO()
    with h5py.File(image, "w", userblock_size=BLOCK) as file:
        file["identity"] = json.dumps(identity)
        for rank, state in enumerate(states):
            _put(file.create_group(f"rank {rank}", track_order=True), state)
    data = image.getvalue()[BLOCK:]
    head = (FORMAT + hashlib.sha256(data).hexdigest().encode() + b"\n").ljust(BLOCK, b"\0")
    write_atomically(path, head + data, durable=True)


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
        return _get(file["identity"]), [_get(file[f"rank {rank}"]) for rank in range(len(file) - 1)]


def _put(group: Any, table: dict[str, Any]) -> None:
    for name, value in table.items():
        if isinstance(value, dict):
            _put(group.create_group(name, track_order=True), value)
        else:
            group[name] = np.array(value) if isinstance(value, list | np.ndarray) else json.dumps(value)


def _get(entry: Any) -> Any:
    import h5py

    if isinstance(entry, h5py.Group):
        return {name: _get(value) for name, value in entry.items()}
    return json.loads(entry.asstr()[()]) if h5py.check_string_dtype(entry.dtype) else entry[()]


# Is it the same run?


def _compare(path: Path, ours: dict[str, dict], theirs: dict[str, dict]) -> None:
    """InputError, saying what differs, unless the checkpoint is of a run like this one; a warning for versions."""
    for what in ("scene", "PETSc options", "versions"):
        differing = [f"{key} is {_word(ours[what], key)} here, {_word(theirs[what], key)} there"
                     for key in sorted(ours[what].keys() | theirs[what].keys())
                     if ours[what].get(key) != theirs[what].get(key)]
        if differing:
            more = f", and {len(differing) - 3} more" if len(differing) > 3 else ""
            message = f"{path}: is of a run with other {what}: {'; '.join(differing[:3])}{more}"
            if what != "versions":
                raise InputError(f"{message}; only the same run can be continued")
            log.warning("%s: the answer will be as good, but not the same to the last digit", message)


def _word(table: dict, key: str) -> str:
    return repr(table[key]) if key in table else "not set"


def _flat(value: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """The leaves of nested tables with their keys as after ``--set``."""
    entries: Iterable[tuple[str, Any]] | None = None
    if isinstance(value, dict):
        entries = value.items()
    elif isinstance(value, list | tuple) and value and isinstance(value[0], dict):
        entries = ((entry.get("name", str(k)), entry) for k, entry in enumerate(value))
    if entries is None:
        yield key, value
    else:
        for name, entry in entries:
            yield from _flat(entry, f"{key}.{name}" if key else name)
