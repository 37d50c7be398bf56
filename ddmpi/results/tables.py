"""Tables and the summary: history.csv, interface.csv, summary.json."""

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
from ddmpi.results.folder import _guarded


HISTORY_COLUMNS = ("iteration", "update", "residual", "inner_precision", "n_A_1", "n_A_2", "open", "slip", "stick")

INTERFACE_COLUMNS = ("x", "y", "normal_force", "tangential_force", "normal_stress", "tangential_stress",
                     "gap", "slip", "status")

SIDES_COLUMNS = ("x", "y", "length", "normal_stress", "tangential_stress")


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


def _plain(value: object) -> object:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} does not belong into a summary")
