"""What a sweep leaves on disk, besides its plots.

    DIR/sweep.json             what the sweep is: scene, PETSc options, digests of mesh files
    DIR/sweep.csv              the table, a line per case
    DIR/CASE/case.json         the record of a case: its values, when it was started, how it ended
    DIR/CASE/run.log           the messages of its run
    DIR/CASE/summary.json, …   its results

The first process of a sweep writes sweep.json. Every other one, at the same time or later, compares it with its own
and refuses to work in the folder of another sweep. A case is finished when its results are there.
"""

from __future__ import annotations

import contextlib
import csv
import hashlib
import io
import json
import os
import socket
import time
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ddmpi.errors import InputError, OutputError
from ddmpi.mesh.build import locate_mesh
from ddmpi.scene.mistakes import nearest
from ddmpi.sweep.cases import Case
from ddmpi.system.files import RECORD, SUMMARY, SWEEP, TABLE, write_atomically

RESULTS = ("outer_iterations", "inner_iterations", "n_A", "eff", "n", "m", "displacement_max")
"""Columns of the table that are numbers of summary.json."""

GROUPS = ("contacts", "certificate", "discretization_error", "bodies", "seconds")
"""Tables of summary.json all of whose numbers have columns."""

STATUS = {0: "certified", 2: "refused", 3: "not converged", 4: "solver failed", 5: "not written", 6: "interrupted"}
"""Status by exit code; besides "not run", "unfinished" (its process has ended early, or is still at work), "failed"."""

PATIENCE = 5.0
"""Seconds to wait for a sweep.json that another process is just writing."""


@dataclass(frozen=True)
class Outcome:
    """How a case has ended, as far as it has.

    ``exit`` is the exit code of its run or None, ``reason`` the first line of its message, ``summary`` the results or
    None.
    """

    status: str
    exit: int | None = None
    reason: str = ""
    summary: dict | None = None

    @property
    def finished(self) -> bool:
        return self.summary is not None


def status_of(code: int) -> str:
    return STATUS.get(code, "failed")


def identify(scene: dict, petsc: list[str], cases: list[Case], scene_folder: Path) -> dict:
    """What a sweep is, but for its --vary: the data of the scene, PETSc options of the command line, mesh files.

    A mesh file that cannot be read is left to the runs of its cases. Not collective.
    """
    meshes = {}
    for body in {body.mesh.file: body for case in cases for body in case.scene.body if body.mesh.file}.values():
        with contextlib.suppress(InputError, OSError):
            meshes[body.mesh.file] = hashlib.sha256(locate_mesh(body, scene_folder).read_bytes()).hexdigest()
    return {"scene": scene, "PETSc options": petsc, "mesh files": meshes}


def claim_sweep(folder: Path, identity: dict, cases: list[Case]) -> None:
    """Make `folder` that of the sweep with this identity, or see that it is. Not collective.

    Raises InputError where it is the folder of another sweep, or cannot be made; OutputError where sweep.json cannot be
    written.
    """
    path = folder / SWEEP
    try:
        folder.mkdir(parents=True, exist_ok=True)
        taken = next((case.folder for case in cases if os.path.lexists(folder / case.folder)), None)
    except OSError as error:
        raise InputError(f"--output {folder}: cannot be made: {error.strerror}") from None
    if not taken:
        try:
            with open(path, "x", encoding="utf-8") as file:
                json.dump(identity, file, indent=2, ensure_ascii=False)
            return
        except FileExistsError:
            pass
        except OSError as error:
            path.unlink(missing_ok=True)
            raise OutputError(f"{path}: cannot be written: {error.strerror}") from None
    check_sweep(folder, identity)


def check_sweep(folder: Path, identity: dict) -> None:
    """InputError unless `folder` is that of the sweep with this identity, saying what differs first. Not collective.

    Mesh files count that both have: more values of a sweep may bring more of them.
    """
    path, end = folder / SWEEP, time.monotonic() + PATIENCE
    while (theirs := _read_json(path, unfinished=time.monotonic() < end)) == {}:
        time.sleep(0.1)
    if theirs is None:
        raise InputError(f"--output {folder}: there is no {SWEEP}, so it is not the folder of a sweep; name another")
    ours = json.loads(json.dumps(identity))
    for meshes, others in ((theirs["mesh files"], ours["mesh files"]), (ours["mesh files"], theirs["mesh files"])):
        for name in meshes.keys() - others.keys():
            del meshes[name]
    if theirs != ours:
        raise InputError(f"--output {folder}: belongs to another sweep, which differs in {_difference(theirs, ours)}; "
                         "name another folder, or remove this one")


def record_case(folder: Path, case: Case, code: int | None, reason: str, started: str) -> None:
    """Write the record of a case: at its start with None, at its end with the exit code. Raises OutputError."""
    record = {"case": case.number, "values": case.values, "exit": code, "reason": reason, "started": started,
              "host": socket.gethostname(), "process": os.getpid()}
    write_atomically(folder / RECORD, json.dumps(record, indent=2, ensure_ascii=False).encode() + b"\n")


def read_outcome(folder: Path) -> Outcome:
    """How the case in `folder` has ended, from what is on disk. Raises InputError where that cannot be read."""
    summary = _read_json(folder / SUMMARY)
    if summary is not None:
        code = 0 if summary["converged"] else 3
        return Outcome(status_of(code), code, summary["reason"], summary)
    record = _read_json(folder / RECORD)
    if record is None:
        return Outcome("not run")
    if record["exit"] is None:
        return Outcome("unfinished", None, f"started {record['started']} on {record['host']} as process "
                                           f"{record['process']}")
    return Outcome(status_of(record["exit"]), record["exit"], record["reason"])


def columns(cases: list[Case], summaries: Iterable[dict] = ()) -> list[str]:
    """All columns of the table of these cases, which have these results."""
    found = dict.fromkeys([*RESULTS, *(name for summary in summaries for name in numbers(summary))])
    return ["case", *cases[0].settings, "status", "exit", "reason", *found, "started", "folder"]


def numbers(summary: dict) -> dict[str, float]:
    """The numbers of a summary that have columns, by their dotted names; those of a vector end with .x, .y, .z."""
    found: dict[str, float] = {}
    for name in (*RESULTS, *GROUPS):
        found |= _flat(summary.get(name), name)
    return found


def _flat(value: Any, name: str) -> dict[str, float]:
    if isinstance(value, list) and len(value) <= 3 and all(isinstance(entry, float) for entry in value):
        value = dict(zip("xyz", value, strict=False))
    if isinstance(value, dict):
        return {key: number for part, entry in value.items() for key, number in _flat(entry, f"{name}.{part}").items()}
    return {name: value} if type(value) in (int, float) else {}


def check_table(folder: Path, cases: list[Case]) -> None:
    """InputError where the table in `folder` has cases that are not among `cases`, and would lose them."""
    path, ours = folder / TABLE, {case.folder for case in cases}
    lost = [row.get("folder") for row in (read_table(path) if os.path.lexists(path) else ())
            if row.get("folder") not in ours and row.get("status") != "not run"]
    if lost:
        raise InputError(f"{path}: has {len(lost)} cases that this sweep has not, {lost[0]} for one; vary over their "
                         "values, too (what is finished is not run again), or move the table away")


def gather(folder: Path, cases: list[Case]) -> Path:
    """Write the table of `cases` out of what is on disk; its path. Raises OutputError, InputError. Not collective."""
    outcomes = [read_outcome(folder / case.folder) for case in cases]
    text = io.StringIO()
    names = columns(cases, [outcome.summary for outcome in outcomes if outcome.summary])
    writer = csv.DictWriter(text, names, lineterminator="\n")
    writer.writeheader()
    for case, outcome in zip(cases, outcomes, strict=True):  # what is missing is an empty field
        summary = outcome.summary or {}
        writer.writerow({"case": case.number, **case.values, "status": outcome.status, "exit": outcome.exit,
                         "reason": outcome.reason, **numbers(summary), "started": summary.get("started"),
                         "folder": case.folder})
    write_atomically(folder / TABLE, text.getvalue().encode())
    return folder / TABLE


def read_table(path: Path) -> list[dict[str, Any]]:
    """The rows of a table; numbers as numbers, empty fields as None. Raises InputError."""
    try:
        with open(path, newline="", encoding="utf-8") as file:
            return [{name: _number(text) for name, text in row.items()} for row in csv.DictReader(file)]
    except (OSError, ValueError, csv.Error) as error:
        raise InputError(f"{path}: not the table of a sweep: {error}") from None


def find_column(word: str, names: Iterable[str]) -> str:
    """The column called `word`, or the one that ends with it after a dot. Raises InputError."""
    names = list(names)
    fits = [name for name in names if name == word] or [name for name in names if name.endswith(f".{word}")]
    if len(fits) == 1:
        return fits[0]
    if fits:
        raise InputError(f"{word!r} may be {' or '.join(fits)}; say which")
    last = {name.rpartition(".")[2]: name for name in names}
    raise InputError(f"the table has no column {word!r}{nearest(word, [*names, *last])} "
                     f"(columns: {', '.join(names)})")


def _read_json(path: Path, unfinished: bool = False) -> dict | None:
    """A table in a file; None where there is no file, {} where it is only being written and may be `unfinished`."""
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None
    except (OSError, ValueError) as error:
        if unfinished and isinstance(error, ValueError):
            return {}
        raise InputError(f"{path}: cannot be read ({error}); remove it, or name another --output") from None


def _number(text: str | None) -> Any:
    for kind in (int, float):
        with contextlib.suppress(ValueError):
            return kind(text or "")
    return text or None


def _difference(before: Any, now: Any, key: str = "") -> str:
    """The first key whose value differs, and both values."""
    if isinstance(before, dict) and isinstance(now, dict):
        for name in [*before, *(name for name in now if name not in before)]:
            if before.get(name) != now.get(name):
                return _difference(before.get(name), now.get(name), f"{key}.{name}".removeprefix("."))
    if isinstance(before, list) and isinstance(now, list) and len(before) == len(now):
        for index, pair in enumerate(zip(before, now, strict=True)):
            if pair[0] != pair[1]:
                return _difference(*pair, f"{key}.{index}")
    return f"{key.removeprefix('scene.')} ({before!r} there, {now!r} now)"
