"""Checkpoints: the state of a run at points that take few numbers to describe, and the file that continues it.

The points are the ends of load steps, of meshes, of iterations of the published method, and of the last iteration, from
which the results follow. A load step that is interrupted within Newton's method is repeated: it takes seconds.

At a point each rank notes the `state()` of its objects, so that all ranks have a state of the same point, whatever
ends the work later. Rank 0 gathers these states into one HDF5 file, which begins with a digest of
the rest (in HDF5's user block), so that damage is noticed before HDF5 sees it.
"""

import contextlib
import hashlib
import io
import json
import logging
import os
import re
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Protocol

import numpy as np
from mpi4py import MPI

from ddmpi.coupling.assembly import Assembly
from ddmpi.errors import InputError, InterruptionError, OutputError, TakenError
from ddmpi.judge.accuracy import MeshLadder
from ddmpi.results.tables import reading
from ddmpi.scene.keys import differences
from ddmpi.scene.output import Checkpoint
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agreed
from ddmpi.system.clock import Clock
from ddmpi.system.files import CHECKPOINT, write_atomically
from ddmpi.system.hdf5 import read_apart, read_tree

log = logging.getLogger("ddmpi")

FORMAT, BLOCK = b"ddmpi checkpoint 20 sha256 ", 512
"""The beginning of HDF5's user block, before the digest of the rest; the block's size, the smallest that HDF5 has."""

KIND = "a checkpoint of this version of ddmpi"

MAY_DIFFER = ("title", "output", "checkpoint", "petsc")
"""Keys of a scene that no iterate depends on; [petsc] is compared as the options it sets."""

ONLY_PRINT = r"(^|_)(view|monitor|log|info|reason|left|table|malloc|memory|help|version|citations|statistics)(_|$)"
"""PETSc options that print, and change no number."""


class Stateful(Protocol):
    """An object whose state is numbers, words, arrays, and lists and tables of these."""

    def state(self) -> dict[str, Any]: ...

    def restore(self, state: dict[str, Any]) -> None: ...


def identify(
    scene: Settled, options: dict[str, str | None], versions: dict[str, str]
) -> dict[str, dict]:
    """What a checkpoint and the run that continues it must share: scene, PETSc options, versions. Not collective."""
    data = scene.resolved()
    for key in MAY_DIFFER:
        del data[key]
    del data["method"]["max_iterations"]
    if scene.time:  # load steps take derivatives over from those before
        data["derivatives"] = scene.output.derivatives
    identity = {
        "scene": data,
        "PETSc options": {
            key: value for key, value in options.items() if not re.search(ONLY_PRINT, key)
        },
        "versions": {name: versions[name] for name in ("ddmpi", "petsc", "numpy", "scipy")},
    }
    return json.loads(json.dumps(identity))  # as it comes out of a file


def continue_from(
    world: MPI.Comm, folder: str, identity: dict[str, dict], ladder: MeshLadder | None = None
) -> dict[str, Any]:
    """This rank's state in the checkpoint of `folder`; a `ladder` is restored. Collective.

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
                        log.warning(
                            "%s: the answer will be as good, but not the same to the last digit",
                            message,
                        )
                if len(states) != world.size:
                    raise InputError(
                        f"{path}: was written on {len(states)} ranks that hold bodies, this run has "
                        f"{world.size}; continue it with mpirun -n {len(states)}"
                    )
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

    def __init__(
        self,
        world: MPI.Comm,
        folder: Path | None,
        identity: dict[str, dict],
        spec: Checkpoint,
        clock: Clock,
        ladder: MeshLadder,
        state: dict[str, Any] | None = None,
    ) -> None:
        self.world, self.folder, self.identity, self.spec, self.clock = (
            world,
            folder,
            identity,
            spec,
            clock,
        )
        self._begin, self._ladder = state or {}, ladder
        self.continuing = "outer" in self._begin
        self._followed: dict[str, Stateful] = {}
        self._mesh = ""
        self._now: dict[
            str, Any
        ] = {}  # the last state that was noted; empty where there is nothing to go on from
        self._at = self._written = (
            0  # the iterations so far at this state, and at the one in the file
        )
        self._last = time.monotonic()
        if folder:
            import h5py  # noqa: F401  loading takes time, and a signal may leave only a second

    def follow(self, assembly: Assembly, **objects: Stateful) -> None:
        """Take the state of `objects` in every `note` from now on; restore them from the state to go on from, if any.

        Collective. Raises InputError on all ranks when the checkpoint is of other meshes.
        """
        self._followed = objects | {"ladder": self._ladder, "exchange": assembly.exchange}
        factored = [body.member.body for body in assembly.bodies]
        self._followed |= {f"compliance of {body.name}": body.C for body in factored}
        self._mesh = _digest(assembly)
        if self.continuing:
            with agreed(assembly.world):
                if self._begin["mesh"] != self._mesh:
                    names = " or ".join(repr(body.spec.name) for body in assembly.bodies)
                    raise InputError(f"the checkpoint is of another mesh of body {names}")
                with reading(CHECKPOINT, KIND):
                    for name, followed in self._followed.items():
                        followed.restore(self._begin[name])
                    self._at = self._written = int(self._begin["iterations"])
            log.info("continuing after iteration %d", self._at)

    def note(self, iteration: int) -> None:
        """Note the state of all objects after this iteration of the run, and write it when it is due. Collective."""
        self._hold(
            iteration,
            {name: followed.state() for name, followed in self._followed.items()}
            | {"mesh": self._mesh, "iterations": iteration},
        )

    def forget(self) -> None:
        """Drop the state that was noted: the run goes on from it in a way that it does not describe."""
        self._now = {}

    def leave(self) -> None:
        """Leave the present mesh for another one; of the state, only the ladder is kept. Collective."""
        self.continuing, self._written = False, -1
        self._hold(0, {"ladder": self._ladder.state()})
        self._written = 0

    def _hold(self, iteration: int, state: dict[str, Any]) -> None:
        """Keep a state, and write it when it is due. Collective."""
        self._at, self._now = iteration, state
        due = 0 < self.spec.iterations <= iteration - self._written
        if self.spec.seconds:
            due = self.world.bcast(due or time.monotonic() - self._last >= self.spec.seconds)
        if due and iteration != self._written:
            try:
                self._write()
            except (
                OutputError
            ) as error:  # on rank 0 alone; the run is worth more than its checkpoint
                log.warning("%s; going on without", error)

    @contextlib.contextmanager
    def kept(self) -> Iterator[None]:
        """An error that ends the block, a signal or results that cannot be written, leaves a checkpoint. Collective."""
        try:
            yield
        except (InterruptionError, OutputError) as error:
            if not error.agreed or not self._now:
                raise
            by_signal, world = isinstance(error, InterruptionError), self.world
            restart = f"--restart {world.bcast(str(self.folder))}" + " --output OTHER" * isinstance(
                error, TakenError
            )
            try:
                with agreed(world):
                    self._write()
            except OutputError as failure:
                former = world.bcast(self.folder and os.path.exists(self.folder / CHECKPOINT))
                failure.args = (
                    f"{error.kind if by_signal else error}; {failure}"
                    + f"; {restart} goes on from the checkpoint before" * bool(former),
                )
                raise failure from None
            kept = f"the state after iteration {self._at} is kept, {restart} goes on from there"
            if "outer" not in self._now:
                kept = f"{restart} begins with {self._ladder.meshes}"
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
                assert len({state.get("iterations") for state in states}) == 1, (
                    "states of different iterations"
                )
                write(self.folder / CHECKPOINT, self.identity, states)


def _digest(assembly: Assembly) -> str:
    """A digest of this rank's meshes and interfaces."""
    meshes, interfaces = [body.mesh for body in assembly.bodies], assembly.space.interfaces
    arrays = [array for mesh in meshes for array in (mesh.points, mesh.triangles)]
    arrays += [array for interface in interfaces for array in (interface.xy, interface.gap)]
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
    if path.exists() and not path.is_file():
        raise InputError(f"--restart {path.parent}: {path} is no file")
    try:
        data = path.read_bytes()
    except FileNotFoundError:
        raise InputError(
            f"--restart {path.parent}: there is no {path.name}, so nothing to go on from"
        ) from None
    except OSError as error:
        raise InputError(
            f"--restart {path.parent}: {path} cannot be read: {error.strerror}"
        ) from None
    if data[:BLOCK] != _head(data[BLOCK:]):
        raise InputError(f"{path}: damaged, or not {KIND}")
    with reading(path, KIND):
        content = read_apart(path, read_tree, f"{path}: not {KIND}: ")
        return content["identity"], [content[f"rank {rank}"] for rank in range(len(content) - 1)]


def _put(group: Any, table: dict[str, Any]) -> None:
    for name, value in table.items():
        first = value[0] if isinstance(value, list) and value else value
        if isinstance(value, dict):
            _put(group.create_group(name, track_order=True), value)
        elif (
            first is not value
            and isinstance(first, np.ndarray)
            and len({each.shape for each in value}) > 1
        ):
            group[name] = np.concatenate(value)  # load steps with rows of their own
            group[name].attrs["ends"] = np.cumsum([len(each) for each in value])
        elif isinstance(first, np.ndarray):
            group[name] = np.asarray(value)
        else:
            group[name] = json.dumps(value, default=np.generic.item)
