"""The files of a run, read back."""

from __future__ import annotations

import csv
import json
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ddmpi.errors import InputError
from ddmpi.results.summary import FORMAT

Columns = dict[str, np.ndarray]
"""A table: the arrays of its columns by name; `status` and `contact` hold words, all others numbers."""

APART = 1.75
"""Consecutive nodes belong to separate pieces if they are farther apart than this times their mean nodal length.

Neighbours are at most 4/3 of it apart on a uniform mesh, at the end of a piece; across one missing node it is 2.
"""


@dataclass(frozen=True)
class Results:
    """All results of a run.

    Attributes
    ----------
    summary : the content of summary.json
    contacts : of each contact contact_NAME.csv
    sides : the same of contact_NAME_sides.csv; empty with linear elements
    history, steps : history.csv and steps.csv
    energy : energy.csv; empty without [time]
    fields : the data of result.h5 of the last load step; `fields["body"]` numbers the bodies as summary["bodies"] lists
        them
    """

    summary: dict
    contacts: dict[str, Columns]
    sides: dict[str, Columns]
    history: Columns
    steps: Columns
    fields: dict[str, np.ndarray]
    energy: Columns = field(default_factory=dict)


def read_results(folder: str | Path) -> Results:
    """Read all results of a run from its folder. Not collective.

    Raises InputError if the results are not complete, or of another format.
    """
    import h5py

    folder = Path(folder)
    try:
        summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
        if summary.get("format", 1) != FORMAT:
            raise InputError(f"{folder}: results in format {summary.get('format', 1)}; this version reads format "
                             f"{FORMAT}")
        tables = {name: folder / f"contact_{name}.csv" for name in summary["contacts"]}
        sides = {name: folder / f"contact_{name}_sides.csv" for name in tables if summary["order"] == 2}
        with h5py.File(folder / "result.h5", "r") as file:
            fields = {name: data[()] for name, data in file.items() if isinstance(data, h5py.Dataset)}
        return Results(summary, {name: _read_csv(path) for name, path in tables.items()},
                       {name: _read_csv(path) for name, path in sides.items() if path.exists()},
                       _read_csv(folder / "history.csv"), _read_csv(folder / "steps.csv"), fields,
                       _read_csv(folder / "energy.csv") if summary["scene"].get("time") else {})
    except (OSError, ValueError, KeyError) as error:
        raise InputError(f"{folder}: not a complete folder of results: {error}") from None


def _read_csv(path: Path) -> Columns:
    with open(path, newline="", encoding="utf-8") as file:
        header, *rows = csv.reader(file)
    columns = zip(*rows, strict=True) if rows else ((),) * len(header)
    return {name: np.array(column, str if name in ("status", "contact") else float)
            for name, column in zip(header, columns, strict=True)}


def starts(table: Columns) -> np.ndarray:
    """Rows of nodes or sides with which another piece of the contact begins."""
    distance, length = np.hypot(np.diff(table["x"]), np.diff(table["y"])), table["length"]
    return 1 + np.flatnonzero(distance > APART * (length[1:] + length[:-1]) / 2)


def pieces(table: Columns) -> list[np.ndarray]:
    """Rows of nodes, piece by piece; a closed contact ends with the node that it begins with."""
    found = np.split(np.arange(len(table["x"])), starts(table))
    distance = np.hypot(table["x"][0] - table["x"][-1], table["y"][0] - table["y"][-1])
    if len(found) == 1 and len(found[0]) > 2 and distance <= APART * table["length"][[0, -1]].mean():
        found[0] = np.append(found[0], 0)
    return found
