"""Checkpoints: the state of a run between two iterations, and the file from which it is continued.

Before every iteration each rank notes the `state()` of its objects, so there is always a whole state of one iteration
on all ranks, whatever ends the next one. Rank 0 gathers these states into one HDF5 file, which begins with a digest of
the rest (in HDF5's user block), so that damage is noticed before HDF5 sees it.
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
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly
from ddmpi.errors import InputError, InterruptionError, OutputError, TakenError
from ddmpi.judge.accuracy import MeshLadder
from ddmpi.methods.outer import Outer
from ddmpi.results.tables import reading
from ddmpi.scene.keys import differences
from ddmpi.scene.method import Checkpoint
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agreed
from ddmpi.system.clock import Clock
from ddmpi.system.files import CHECKPOINT, write_atomically

log = logging.getLogger("ddmpi")

FORMAT, BLOCK = b"ddmpi checkpoint 15 sha256 ", 512
"""What stands in HDF5's user block, before the digest of the rest; its size, the smallest that HDF5 has."""

KIND = "a checkpoint of this version of ddmpi"

MAY_DIFFER = ("title", "output", "checkpoint", "petsc")
"""Keys of a scene that no iterate depends on; [petsc] is compared as the options it sets."""

ONLY_PRINT = r"(^|_)(view|monitor|log|info|reason|left|table|malloc|memory|help|version|citations|statistics)(_|$)"
"""PETSc options that print, and change no number."""


class Part(Protocol):
    """What carries numbers, words, arrays, lists and tables of them from one iteration to the next."""

    def state(self) -> dict[str, Any]: ...

    def restore(self, state: dict[str, Any]) -> None: ...


def identify(scene: Settled, options: dict[str, str], versions: dict[str, str]) -> dict[str, dict]:
    """What a run is known by: the scene, PETSc options, versions. Not collective."""
    data = scene.resolved()
    for key in MAY_DIFFER:
        del data[key]
    del data["method"]["max_iterations"]
    found = {"scene": data,
             "PETSc options": {key: value for key, value in options.items() if not re.search(ONLY_PRINT, key)},
             "versions": {name: versions[name] for name in ("ddmpi", "petsc", "numpy", "scipy")}}
    return json.loads(json.dumps(found))  # as it comes out of a file


def continue_from(world: MPI.Comm, folder: str, identity: dict[str, dict],
                  ladder: MeshLadder | None = None) -> dict[str, Any]:
    """The own part of the state in the checkpoint of `folder`; a `ladder` is restored. Collective.

    Raises InputError, on all ranks, when there is no checkpoint, or it is damaged, or of a run of another `identity`.
    """
    states: list[dict[str, Any]] = []
    with agreed(world):
        if world.rank == 0:
            path = Path(folder) / CHECKPOINT
            theirs, states = read(path)
            with reading(path, KIND):
                for what, ours in identity.items():
                    differing = differences(ours, theirs[what])
                    message = f"{path}: is of a run with other {what}: {differing}"
                    if differing and what != "versions":
                        raise InputError(f"{message}; only the same run can be continued")
                    if differing:
                        log.warning("%s: the answer will be as good, but not the same to the last digit", message)
                if len(states) != world.size:
                    raise InputError(f"{path}: was written on {len(states)} ranks that hold bodies, this run has "
                                     f"{world.size}; continue it with mpirun -n {len(states)}")
    state = world.scatter(states)
    with agreed(world), reading(folder, KIND):
        if ladder:
            ladder.restore(state["ladder"])
    return state


class Checkpoints:
    """The checkpoints of one run, on one mesh after the other.

    Parameters
    ----------
    folder : of the results, on rank 0; None on the others
    identity : as `identify` gives it
    spec : when they are written
    ladder : the meshes
    state : of this rank, to go on from; None, or one without an iteration, to begin at the beginning

    Attributes
    ----------
    continuing : whether the run goes on from an iteration on the present mesh
    """

    def __init__(self, world: MPI.Comm, folder: Path | None, identity: dict[str, dict], spec: Checkpoint, clock: Clock,
                 ladder: MeshLadder, state: dict[str, Any] | None = None) -> None:
        self.world, self.folder, self.identity, self.spec, self.clock = world, folder, identity, spec, clock
        self._begin, self._ladder, self._known = state or {}, ladder, len(ladder.levels)
        self.continuing = "outer" in self._begin
        self._parts: dict[str, Part] = {}
        self._fixed: dict[str, Any] = {}
        self._now: dict[str, Any] = {}
        self._at = 0
        self._written, self._last = -1, time.monotonic()
        if folder:
            import h5py  # noqa: F401  a signal may leave a second, and to load it takes a part of that

    def follow(self, assembly: Assembly, outer: Outer, before: Callable[[], int] = int, **parts: Part) -> None:
        """Keep the state of the iteration and of other `parts` from now on; restore what there is to go on from.

        `before` says how many iterations the load steps before the present one have taken.
        Collective. Raises InputError on all ranks when the checkpoint is of other meshes.
        """
        exchange, bodies = assembly.exchange, assembly.bodies

        def count() -> int:
            return len(outer.history) + before()

        self._parts = parts | {"ladder": self._ladder, "outer": outer, "exchange": exchange}
        self._parts |= {f"compliance of {body.spec.name}": body.member.C for body in bodies}
        self._fixed = {"mesh": _digest(assembly), "kind": ", ".join(body.member.C.kind for body in bodies),
                       "h": np.concatenate([body.member.h for body in bodies])}
        if self.continuing:
            with agreed(assembly.world):
                if self._begin["mesh"] != self._fixed["mesh"]:
                    names = " or ".join(repr(body.spec.name) for body in bodies)
                    raise InputError(f"the checkpoint is of another mesh of body {names}")
                with reading(CHECKPOINT, KIND):
                    for name, part in self._parts.items():
                        part.restore(self._begin[name])
            same = (self._begin["kind"] == self._fixed["kind"]
                    and np.array_equal(self._begin["h"], self._fixed["h"]))
            if not all(assembly.world.allgather(same)):
                log.warning("this machine computes otherwise than that of the checkpoint did (another processor, less "
                            "memory): the answer will be as good, but not the same to the last digit")
            self._written = count()
            log.info("continuing after iteration %d", self._written)
        outer.checkpoint = lambda: self._note(count())

    def _note(self, k: int) -> None:
        """Note the state after iteration k, and write it when it is due. Collective."""
        self._at = k
        self._now = {name: part.state() for name, part in self._parts.items()} | self._fixed
        due = self.spec.iterations > 0 and k > 0 and k % self.spec.iterations == 0
        if self.spec.seconds:
            due = self.world.bcast(due or time.monotonic() - self._last >= self.spec.seconds)
        if due and k != self._written:
            try:
                self._write()
            except OutputError as error:  # on rank 0 alone; the run is worth more than its checkpoint
                log.warning("%s; going on without", error)

    def leave(self) -> None:
        """Keep nothing of the present mesh any more."""
        self._now, self.continuing, self._written = {}, False, -1

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """An error that ends the block, a signal or results that cannot be written, leaves a checkpoint. Collective.

        In the set-up of a finer mesh it holds what the coarser ones have led to.
        """
        try:
            yield
        except (InterruptionError, OutputError) as error:
            between = not self._now and len(self._ladder.levels) > self._known and isinstance(error, InterruptionError)
            if not error.agreed or not (self._now or between):
                raise
            by_signal, world = isinstance(error, InterruptionError), self.world
            restart = f"--restart {world.bcast(str(self.folder))}" + " --output OTHER" * isinstance(error, TakenError)
            self._now = self._now or {"ladder": self._ladder.state()}
            try:
                with agreed(world):
                    self._write()
            except OutputError as failure:
                former = world.bcast(self.folder and os.path.exists(self.folder / CHECKPOINT))
                failure.args = (f"{error.kind if by_signal else error}; {failure}"
                                + f"; {restart} goes on from the checkpoint before" * bool(former),)
                raise failure from None
            kept = f"the state after iteration {self._at} is kept, {restart} goes on from there"
            if between:
                kept = f"in the set-up of a finer mesh, which {restart} begins with"
            error.args = (kept if by_signal else f"{error}; {kept}",)
            raise

    def remove(self) -> None:
        """Remove the file: the results are there. Not collective, but to be called on all ranks."""
        self._now = {}
        if self.folder:
            try:
                (self.folder / CHECKPOINT).unlink(missing_ok=True)
            except OSError as error:
                log.warning("%s could not be removed: %s", self.folder / CHECKPOINT, error.strerror)

    def _write(self) -> None:
        """Gather and write the noted state. Collective; raises OutputError on rank 0 alone."""
        with self.clock.phase("checkpoint"):
            states = self.world.gather(self._now)
            self._last, self._written = time.monotonic(), self._at
            if self.folder and states:
                assert len({len(state["outer"]["history"]) for state in states if "outer" in state}) < 2, (
                    "states of different iterations")
                write(self.folder / CHECKPOINT, self.identity, states)


def _digest(assembly: Assembly) -> str:
    """A digest of the own meshes and interfaces."""
    meshes, interfaces = [body.mesh for body in assembly.bodies], assembly.space.interfaces
    arrays = [array for mesh in meshes for array in (mesh.points, mesh.triangles)]
    arrays += [array for each in interfaces for array in (each.xy, each.gap)]
    return hashlib.sha256(b"".join(array.tobytes() for array in arrays)).hexdigest()


def write(path: Path, identity: dict[str, dict], states: list[dict[str, Any]]) -> None:
    """Write the ranks' states: tables as groups, arrays and lists of like arrays as arrays, all else as JSON.

    `path` holds the old or the new file, whole. Raises OutputError. Not collective.
    """
    import h5py

    image = io.BytesIO()
    with h5py.File(image, "w", userblock_size=BLOCK) as file:
        file["identity"] = json.dumps(identity)
        for rank, state in enumerate(states):
            _put(file.create_group(f"rank {rank}", track_order=True), state)
    data = image.getvalue()[BLOCK:]
    write_atomically(path, _head(data) + data, durable=True)


def _head(data: bytes) -> bytes:
    return (FORMAT + hashlib.sha256(data).hexdigest().encode() + b"\n").ljust(BLOCK, b"\0")


def read(path: Path) -> tuple[dict[str, dict], list[dict[str, Any]]]:
    """Identity and states that `write` wrote. Raises InputError where the file is not whole. Not collective."""
    import h5py

    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(f"--restart {path.parent}: there is no {path.name}, so nothing to go on from") from None
    except OSError as error:
        raise InputError(f"--restart {path.parent}: {path} cannot be read: {error.strerror}") from None
    if data[:BLOCK] != _head(data[BLOCK:]):
        raise InputError(f"{path}: damaged, or not {KIND}")
    with reading(path, KIND), h5py.File(io.BytesIO(data), "r") as file:
        return _get(file["identity"]), [_get(file[f"rank {rank}"]) for rank in range(len(file) - 1)]


def _put(group: Any, table: dict[str, Any]) -> None:
    for name, value in table.items():
        first = value[0] if isinstance(value, list) and value else value
        if isinstance(value, dict):
            _put(group.create_group(name, track_order=True), value)
        elif isinstance(first, np.ndarray):
            group[name] = np.asarray(value)
        else:
            group[name] = json.dumps(value, default=np.generic.item)


def _get(entry: Any) -> Any:
    import h5py

    if isinstance(entry, h5py.Group):
        return {name: _get(value) for name, value in entry.items()}
    return json.loads(entry.asstr()[()]) if h5py.check_string_dtype(entry.dtype) else entry[()]
