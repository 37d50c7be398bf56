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

from ddmpi.algorithm import Step
from ddmpi.certificate import ContactState
from ddmpi.errors import HeldError, InputError, OutputError, TakenError
from ddmpi.files import CHECKPOINT, FileOfHDF5, clear_unfinished, link_new, locked, publishing, unfinished
from ddmpi.files import RESULTS as NAMES
from ddmpi.interface import Interface

HISTORY_COLUMNS = ("iteration", "update", "residual", "inner_precision", "n_A_1", "n_A_2", "open", "slip", "stick")
INTERFACE_COLUMNS = ("x", "y", "normal_force", "tangential_force", "normal_stress", "tangential_stress",
                     "gap", "slip", "status")
SIDES_COLUMNS = ("x", "y", "length", "normal_stress", "tangential_stress")

XDMF = """<?xml version="1.0"?>
<!DOCTYPE Xdmf SYSTEM "Xdmf.dtd" []>
<Xdmf Version="3.0" xmlns:xi="http://www.w3.org/2001/XInclude">
  <Domain>
    <Grid Name="mesh" GridType="Uniform">
      <Geometry GeometryType="XYZ">
        <DataItem DataType="Float" Precision="8" Format="HDF" Dimensions="{nv} 3">result.h5:/points</DataItem>
      </Geometry>
      <Topology TopologyType="{topology}" NumberOfElements="{nt}" NodesPerElement="{k}">
        <DataItem DataType="Int" Precision="8" Format="HDF" Dimensions="{nt} {k}">result.h5:/cells</DataItem>
      </Topology>
    </Grid>
    <Grid Name="steps" GridType="Collection" CollectionType="Temporal">
      <Grid Name="step">
        <xi:include xpointer="xpointer(//Grid[@Name=&quot;mesh&quot;]/*[self::Topology or self::Geometry])"/>
        <Time Value="0.0"/>
{attributes}
      </Grid>
    </Grid>
  </Domain>
</Xdmf>
"""
ATTRIBUTE = """        <Attribute Name="{name}" AttributeType="{kind}" Center="{center}">
          <DataItem DataType="{type}" Precision="8" Format="HDF" Dimensions="{dimensions}">result.h5:/{name}</DataItem>
        </Attribute>"""
TOPOLOGY = {3: "Triangle", 6: "Triangle_6"}
KIND = {1: "Scalar", 3: "Vector", 6: "Tensor6"}


@dataclass(frozen=True)
class Fields:
    """Fields of one body; stress, von Mises and error are None where no one asked for them.

    points (nv, 2) m, triangles (nt, 3 or 6), displacement (nv, 2) m, stress (nt, 4) as
    `elasticity.stress` and von_mises (nt,) in Pa.
    """

    points: np.ndarray
    triangles: np.ndarray
    displacement: np.ndarray
    stress: np.ndarray | None = None
    von_mises: np.ndarray | None = None
    error: np.ndarray | None = None


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


def write_fields(path: Path, fields: Fields, body: int, sizes: Sequence[tuple[int, int]]) -> None:
    """Write the part of body number `body` into result.h5; body 0 creates the file.

    `sizes` holds the numbers of nodes and triangles of all bodies. Not collective: the caller
    sees to it that bodies write one after another. Raises OutputError.
    """
    import h5py

    nodes = sum(nv for nv, _ in sizes[:body])
    cells = sum(nt for _, nt in sizes[:body])
    parts = {"points": (_padded(fields.points), nodes), "cells": (fields.triangles + nodes, cells),
             "displacement": (_padded(fields.displacement), nodes),
             "body": (np.full(len(fields.triangles), body), cells)}
    if fields.stress is not None:
        xx, yy, zz, xy = fields.stress.T
        zero = np.zeros_like(xx)
        parts["stress"] = (np.column_stack([xx, xy, zero, yy, zero, zz]), cells)
        parts["von_mises"] = (fields.von_mises, cells)
    if fields.error is not None:
        parts["error"] = (fields.error, cells)

    def write() -> None:
        mode = "w" if body == 0 else "r+"
        with FileOfHDF5(path / "result.h5", f"{mode[0]}+") as storage, h5py.File(storage, mode) as file:
            for name, (part, start) in parts.items():
                if body == 0:
                    total = sum(size[0 if name in ("points", "displacement") else 1] for size in sizes)
                    file.create_dataset(name, (total, *part.shape[1:]), dtype=part.dtype)
                file[name][start:start + len(part)] = part
    _guarded(write, path / "result.h5")


def write_xdmf(path: Path) -> None:
    """Write result.xdmf, a time series of one step, which describes result.h5. Raises OutputError."""
    import h5py

    def write() -> None:
        with h5py.File(path / "result.h5", "r") as file:
            nv, (nt, k) = len(file["points"]), file["cells"].shape
            attributes = [ATTRIBUTE.format(
                name=name, kind=KIND[data.shape[1] if data.ndim > 1 else 1],
                center="Node" if name == "displacement" else "Cell",
                type="Int" if data.dtype.kind == "i" else "Float",
                dimensions=" ".join(str(d) for d in data.shape))
                for name, data in file.items() if name not in ("points", "cells")]
        (path / "result.xdmf").write_text(XDMF.format(
            nv=nv, nt=nt, k=k, topology=TOPOLOGY[k], attributes="\n".join(attributes)))
    _guarded(write, path / "result.xdmf")


def write_history(path: Path, history: Iterable[Step], counts: Iterable[Sequence[int]]) -> None:
    """Write history.csv, a line per outer iteration; `counts` are of open, slipping and sticking nodes.

    Raises OutputError.
    """
    _write_csv(path / "history.csv", HISTORY_COLUMNS,
               ((s.iteration, s.update, s.residual, s.inner_precision, *s.n_A, *nodes)
                for s, nodes in zip(history, counts, strict=True)))


def write_interface(path: Path, interface: Interface, state: ContactState) -> None:
    """Write interface.csv, a line per contact node, ordered along the interface. Raises OutputError."""
    rows = zip(*interface.xy.T, state.normal_force, state.tangential_force, state.normal_force / interface.length,
               state.tangential_force / interface.length, state.gap, state.slip, state.status, strict=True)
    _write_csv(path / "interface.csv", INTERFACE_COLUMNS, rows)


def write_sides(path: Path, interface: Interface, state: ContactState) -> None:
    """Write interface_sides.csv: means of the stresses over quadratic elements' sides, by Simpson's rule.

    Between corners and middles nodal stresses swing where the interface is curved or ends; their means over
    sides do not. A line per side whose three nodes carry forces, with its middle and its length; no file in
    order 1. Raises OutputError.
    """
    k = interface.middles
    if len(k) == 0:
        return

    def mean(force: np.ndarray) -> np.ndarray:
        stress = force / interface.length
        return (stress[k - 1] + 4 * stress[k] + stress[k + 1]) / 6

    rows = zip(*interface.xy[k].T, np.linalg.norm(interface.xy[k + 1] - interface.xy[k - 1], axis=1),
               mean(state.normal_force), mean(state.tangential_force), strict=True)
    _write_csv(path / "interface_sides.csv", SIDES_COLUMNS, rows)


def write_summary(path: Path, summary: dict) -> None:
    """Write summary.json. Raises OutputError."""
    text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False, default=_plain) + "\n"
    _guarded(lambda: (path / "summary.json").write_text(text, encoding="utf-8"), path / "summary.json")


def finite_or_none(value: float) -> float | None:
    """JSON has no NaN and no infinity; null says that there is no number."""
    return float(value) if np.isfinite(value) else None


def _write_csv(path: Path, columns: Sequence[str], rows: Iterable[Sequence]) -> None:
    def write() -> None:
        with open(path, "w", newline="", encoding="utf-8") as file:
            writer = csv.writer(file, lineterminator="\n")
            writer.writerow(columns)
            writer.writerows([repr(float(v)) if isinstance(v, float | np.floating) else v for v in row] for row in rows)
    _guarded(write, path)


def _guarded(action: Callable, path: Path):
    """Run a file operation on `path`; what the system refuses is an OutputError."""
    try:
        return action()
    except OSError as error:
        raise OutputError(f"results could not be written: {error.filename or path}: "
                          f"{error.strerror or error}") from None


def _padded(array: np.ndarray) -> np.ndarray:
    return np.column_stack([array, np.zeros(len(array))])


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} does not belong into a summary")
