"""The files of a sweep: its identity sweep.json, the records of cases, and the table.

The first process of a sweep writes sweep.json. Every other one, at the same time or later, compares it with its own
and refuses to work in the folder of another sweep. A case is finished when its results are there.
"""

import contextlib
import csv
import hashlib
import io
import json
import math
import os
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.errors import InputError, nearest
from ddmpi.mesh.build import locate_mesh
from ddmpi.results.tables import reading
from ddmpi.scene.keys import differences, flatten
from ddmpi.sweep.cases import Case
from ddmpi.system.files import RECORD, SUMMARY, SWEEP, TABLE, write_atomically
from ddmpi.system.provenance import optional

RESULTS = ("outer_iterations", "inner_iterations", "n_A", "eff", "n", "m", "displacement_max")
"""Columns of the table that are numbers of summary.json."""

GROUPS = ("contacts", "certificate", "discretization_error", "bodies", "seconds")
LEVELS = "discretization_error.levels."
"""Tables of summary.json whose numbers have columns, and the beginning of those that have none."""

STATUS = {
    None: "unfinished",
    0: "certified",
    2: "refused",
    3: "not converged",
    4: "solver failed",
    5: "not written",
    6: "interrupted",
}
"""Status by exit code; none while a process is at work, or when it was killed."""

PATIENCE = 5.0  # seconds to wait for a sweep.json that another process is just writing


@dataclass(frozen=True)
class Outcome:
    """The outcome of a case so far: exit code, first line of the message, results."""

    status: str
    exit: int | None = None
    reason: str = ""
    summary: dict | None = None

    @property
    def warnings(self) -> list[str]:
        """Warnings about the answer, as in summary.json."""
        return (self.summary or {}).get("warnings", [])


def identify(scene: dict, petsc: list[str], cases: list[Case], scene_folder: Path) -> dict:
    """The identity of a sweep, without its --vary: the scene's data, PETSc options of the command line, mesh files.

    A mesh file that cannot be read is left to the runs of its cases. Not collective.
    """
    meshes = {}
    named = {
        body.mesh.file or body.mesh.geometry: body
        for case in cases
        for body in case.scene.body
        if not body.mesh.shape
    }
    for name, body in named.items():
        with contextlib.suppress(InputError, OSError):
            meshes[name] = hashlib.sha256(locate_mesh(body, scene_folder).read_bytes()).hexdigest()
    return {"scene": scene, "PETSc options": petsc, "mesh files": meshes}


def claim_sweep(folder: Path, identity: dict, cases: list[Case]) -> None:
    """Claim `folder` for the sweep with this identity, unless it has it already. Not collective.

    Raises InputError where it is the folder of another sweep, or cannot be written.
    """
    try:
        folder.mkdir(parents=True, exist_ok=True)
        if not any(os.path.lexists(folder / case.folder) for case in cases):
            with (
                contextlib.suppress(FileExistsError),
                open(folder / SWEEP, "x", encoding="utf-8") as file,
            ):
                json.dump(identity, file, indent=2, ensure_ascii=False)
    except OSError as error:
        raise InputError(f"--output {folder}: cannot be written: {error.strerror}") from None
    check_sweep(folder, identity)


def check_sweep(folder: Path, identity: dict) -> None:
    """InputError unless `folder` is that of the sweep with this identity, saying what differs. Not collective.

    Mesh files count that both have: more values of a sweep may bring more of them.
    """
    theirs = _read_json(folder / SWEEP, PATIENCE)
    if theirs is None:
        raise InputError(
            f"--output {folder}: there is no {SWEEP}, so it is not the folder of a sweep; name another"
        )
    with reading(folder / SWEEP, "the record of a sweep"):
        common = identity["mesh files"].keys() & theirs["mesh files"].keys()
        differing = differences(
            *(
                {**side, "mesh files": {name: side["mesh files"][name] for name in common}}
                for side in (identity, theirs)
            )
        )
    if differing:
        raise InputError(
            f"--output {folder}: belongs to another sweep: {differing}; name another folder, or remove "
            "this one"
        )


def record_case(folder: Path, case: Case, code: int | None, reason: str) -> None:
    """Write the record of a case: at its start without an exit code, at its end with it. Raises OutputError."""
    record = {"case": case.number, "values": case.values, "exit": code, "reason": reason}
    write_atomically(
        folder / RECORD, json.dumps(record, indent=2, ensure_ascii=False).encode() + b"\n"
    )


def read_outcome(folder: Path) -> Outcome:
    """The outcome of the case in `folder`, from its files. Raises InputError if they cannot be read."""
    with reading(folder):
        summary = _read_json(folder / SUMMARY)
        record = (
            {"exit": 0 if summary["converged"] else 3, "reason": summary["reason"]}
            if summary
            else _read_json(folder / RECORD)
        )
        if record is None:
            return Outcome("not run")
        outcome = Outcome(
            STATUS.get(record["exit"], "failed"), record["exit"], record["reason"], summary
        )
        " ".join(outcome.warnings)  # which are words
        return outcome


def numbers(summary: dict) -> dict[str, float]:
    """The numbers of a summary that have columns, by their dotted names; those of a vector end with .x, .y, .z."""
    columns: dict[str, float] = {}
    for name, value in (
        *flatten({name: summary.get(name) for name in (*RESULTS, *GROUPS)}),
        *_beside(summary),
    ):
        if (
            isinstance(value, list)
            and len(value) <= 3
            and all(entry is None or isinstance(entry, float) for entry in value)
        ):
            columns |= {
                _along(name, axis): entry for axis, entry in zip("xyz", value, strict=False)
            }
        elif type(value) in (int, float) and not name.startswith(LEVELS):
            columns[name] = value
    return columns


def _beside(summary: dict) -> Iterator[tuple[str, Any]]:
    """The derivatives and error bars of results, by the names of their columns."""
    for key, entry in (summary.get("derivatives") or {}).items():
        for name, value in flatten(entry or {}):
            if name != "until":
                yield f"d {name} / d {key}", value
    for name, entry in (summary.get("errors") or {}).items():
        yield f"± {name}", entry["bar"]


def _along(name: str, axis: str) -> str:
    """The column of a component: "force.x", "d force.x / d gap"."""
    result, by, key = name.partition(" / d ")
    return f"{result}.{axis}{by}{key}"


def gather(folder: Path, cases: list[Case]) -> Path:
    """Write the table of `cases` from their files; its path. Raises OutputError, InputError. Not collective."""
    outcomes = [read_outcome(folder / case.folder) for case in cases]
    results = [numbers(outcome.summary or {}) for outcome in outcomes]
    names = dict.fromkeys([*RESULTS, *(name for result in results for name in result)])
    rows = [
        {
            "case": case.number,
            **case.values,
            "status": outcome.status,
            "exit": outcome.exit,
            "reason": outcome.reason,
            **{name: result.get(name) for name in names},  # what is missing is an empty field
            "started": (outcome.summary or {}).get("started"),
            "folder": case.folder,
            "warnings": " | ".join(outcome.warnings),
        }
        for case, outcome, result in zip(cases, outcomes, results, strict=True)
    ]
    text = io.StringIO()
    writer = csv.DictWriter(text, rows[0], lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)
    write_atomically(folder / TABLE, text.getvalue().encode())
    return folder / TABLE


def read_table(path: Path) -> list[dict[str, Any]]:
    """The rows of a table; numbers as numbers, empty fields as None. Raises InputError."""
    with reading(path, "the table of a sweep"), open(path, newline="", encoding="utf-8") as file:
        return [{name: _number(text) for name, text in row.items()} for row in csv.DictReader(file)]


def varied(rows: Sequence[dict[str, Any]]) -> list[str]:
    """The varied keys, by the rows of a table."""
    names = list(rows[0])
    return names[1 : names.index("status")]


def to_xarray(folder: str | Path) -> Any:
    """The table of a sweep as a `xarray.Dataset`, a variable for each column of numbers, NaN where a case has none.

    Its dimensions are the varied keys, if all combinations of their values were run, else "case", along which they are
    coordinates. Not collective. Raises InputError where there is no table or no xarray.
    """
    rows = read_table(Path(folder) / TABLE)
    xarray = optional("xarray", "to_xarray")
    return xarray.Dataset(*as_variables(rows))


def as_variables(rows: Sequence[dict[str, Any]]) -> tuple[dict[str, Any], dict[str, Any]]:
    """Variables and coordinates of the rows of a table, by name with their dimensions and arrays."""
    names, settings = list(rows[0]), varied(rows)
    columns = {name: [row[name] for row in rows] for name in names}
    values = {key: list(dict.fromkeys(columns[key])) for key in settings}
    cells = [tuple(values[key].index(row[key]) for key in settings) for row in rows]
    shape = tuple(map(len, values.values()))
    dimensions: tuple[str, ...] = tuple(settings)
    coordinates: dict[str, Any] = {key: (key, values[key]) for key in settings}
    if not len(set(cells)) == len(rows) == math.prod(shape):
        dimensions, shape, cells = ("case",), (len(rows),), [(k,) for k in range(len(rows))]
        coordinates = {key: ("case", columns[key]) for key in settings}
    variables = {}
    for name in names:
        numbers = dict(zip(cells, map(_as_number, columns[name]), strict=True))
        if name not in settings and not np.isnan([*numbers.values()]).all():
            array = np.empty(shape)
            for cell, number in numbers.items():
                array[cell] = number
            variables[name] = dimensions, array
    return variables, coordinates


def _as_number(entry: Any) -> float:
    return float(entry) if isinstance(entry, int | float) else math.nan


def find_column(word: str, names: Sequence[str], what: str) -> str:
    """The column called `word`, or the one that ends with it after a dot. Raises InputError that begins with `what`."""
    fits = [name for name in names if name == word] or [
        name for name in names if name.endswith(f".{word}")
    ]
    if len(fits) == 1:
        return fits[0]
    if fits:
        raise InputError(f"{what}: {word!r} may be {' or '.join(fits)}; say which")
    last = [name.rpartition(".")[2] for name in names]
    raise InputError(
        f"{what}: the table has no column {word!r}{nearest(word, [*names, *last])} "
        f"(columns: {', '.join(names)})"
    )


def _read_json(path: Path, patience: float = 0.0) -> dict | None:
    """A table in a file, once it is whole; None where there is no file."""
    end = time.monotonic() + patience
    if path.exists() and not path.is_file():
        raise InputError(f"{path}: is no file; remove it, or name another --output")
    while True:
        try:
            return json.loads(path.read_text(encoding="utf-8"))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, RecursionError) as error:
            if not isinstance(error, ValueError) or time.monotonic() > end:
                raise InputError(
                    f"{path}: cannot be read ({error}); remove it, or name another --output"
                ) from None
        time.sleep(0.1)


def _number(text: str | None) -> Any:
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text or "")
    return text or None
