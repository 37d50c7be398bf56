"""What a sweep leaves on disk: a record beside each case's results, and the table gathered from all.

    DIR/sweep.csv              the table, a line per case
    DIR/CASE/case.json         which case this is, when it was started, how it ended
    DIR/CASE/run.log           what its run said
    DIR/CASE/summary.json, …   its results

A case is finished when its results are there: they are complete or absent. The record comes first, and is of who
came first: nobody runs, overwrites or gathers a case whose record is of another sweep, or gone.
"""

from __future__ import annotations

import contextlib
import csv
import functools
import hashlib
import io
import json
import os
import socket
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from ddmpi.errors import InputError, OutputError
from ddmpi.mesh.build import locate_mesh
from ddmpi.scene.mistakes import nearest
from ddmpi.sweep.cases import Case
from ddmpi.system.files import RECORD, TABLE, link_new, unfinished, write_atomically
from ddmpi.system.logs import utc

RESULTS = ("outer_iterations", "n_A", "eff", "n", "m", "contact.normal_force", "contact.tangential_force",
           "contact.open", "contact.slip", "contact.stick", "certificate.force_mismatch", "certificate.penetration",
           "certificate.complementarity", "certificate.friction", "certificate.equilibrium",
           "discretization_error.energy_norm", "displacement_max", "energy.0", "energy.1", "seconds.mesh",
           "seconds.assemble", "seconds.factor", "seconds.outer", "seconds.output", "seconds.total", "memory_mib.0",
           "memory_mib.1")
"""Columns of the table that come from summary.json, by their place in it."""

STATUS = {0: "certified", 2: "refused", 3: "not converged", 4: "solver failed", 5: "not written", 6: "interrupted"}
"""Status by exit code; besides "not run", "unfinished" (its process died, or is still at it), "failed", "unreadable"
and "unrecorded" (there are results, but no record)."""


@dataclass(frozen=True)
class Outcome:
    """How a case ended, as far as it did.

    ``exit`` is the exit code of its run or None, ``reason`` the first line of what was said, ``summary``
    the results or None.
    """

    status: str
    exit: int | None = None
    reason: str = ""
    summary: dict | None = None
    identity: dict | None = None

    @property
    def finished(self) -> bool:
        return self.summary is not None


def status_of(code: int) -> str:
    return STATUS.get(code, "failed")


def case_identity(case: Case, petsc: list[str], scene_folder: Path) -> dict:
    """What decides the results of a case: scene, PETSc options of the command line, contents of mesh files."""
    meshes = {}
    for body in case.scene.body:
        if body.mesh.file is not None:
            try:
                path = locate_mesh(body, scene_folder)
                state = path.stat()
                meshes[body.mesh.file] = _digest(path, state.st_mtime_ns, state.st_size)
            except (InputError, OSError):
                meshes[body.mesh.file] = "missing"  # the run will say so
    return json.loads(json.dumps({"scene": case.scene.resolved(), "petsc": petsc, "meshes": meshes}))


@functools.cache
def _digest(path: Path, changed: int, size: int) -> str:
    """Of a file's contents, which are read again when the file has changed."""
    return hashlib.sha256(path.read_bytes()).hexdigest()


def record_case(folder: Path, case: Case, identity: dict, code: int | None = None, reason: str = "",
                started: str | None = None) -> None:
    """Write the record of a case, at its start without, at its end with an exit code.

    Raises InputError where the case in `folder` is one of another sweep, whoever comes first; OutputError.
    """
    record = {"case": case.number, "values": case.values, "exit": code, "reason": reason,
              "started": started or utc(), "host": socket.gethostname(), "process": os.getpid(), **identity}
    data = json.dumps(record, indent=2, ensure_ascii=False).encode() + b"\n"
    outcome = read_outcome(folder)
    refuse_others(folder, outcome, identity)
    if outcome.identity is None:
        if _write_first(folder / RECORD, data):
            return
        refuse_others(folder, read_outcome(folder), identity)
    write_atomically(folder / RECORD, data)


def _write_first(path: Path, data: bytes) -> bool:
    """Write `path` unless it is there; whether it was not. Raises OutputError."""
    made = unfinished(path)
    try:
        made.write_bytes(data)
        link_new(made, path)
    except FileExistsError:
        return False
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror or error}") from None
    finally:
        with contextlib.suppress(OSError):  # whoever removes the folder takes it along
            made.unlink(missing_ok=True)
    return True


def read_outcome(folder: Path) -> Outcome:
    """How the case in `folder` ended, from what is on disk."""
    try:
        record = _read_json(folder / RECORD)
        summary = _read_json(folder / "summary.json")
        if record is None:
            return Outcome("not run") if summary is None else Outcome(
                "unrecorded", None, f"there are results, but no {RECORD} that says of which sweep")
        identity = {key: record[key] for key in ("scene", "petsc", "meshes")}
        if summary is not None:
            code = 0 if summary["converged"] else 3
            return Outcome(status_of(code), code, summary["reason"], summary, identity)
        if record["exit"] is None:
            reason = f"started {record['started']} on {record['host']} as process {record['process']}"
            return Outcome("unfinished", None, reason, None, identity)
        return Outcome(status_of(record["exit"]), record["exit"], record["reason"], None, identity)
    except (OSError, ValueError, KeyError, TypeError) as error:
        return Outcome("unreadable", None, f"{folder}: {type(error).__name__}: {error}")


def foreign(outcome: Outcome, identity: dict) -> str:
    """What makes a case one of another sweep than that of `identity`, in words; nothing where it is none."""
    if outcome.status == "unrecorded":
        return outcome.reason
    if outcome.identity is None:
        return ""
    theirs, ours = outcome.identity, identity
    if outcome.summary and theirs == ours:
        theirs, ours = (_without_refinement(scene) for scene in (outcome.summary["scene"], identity["scene"]))
    what = "results" if outcome.finished else "a case"
    return "" if theirs == ours else f"{what} of another sweep, which differs in {_difference(theirs, ours)}"


def refuse_others(folder: Path, outcome: Outcome, identity: dict) -> None:
    """InputError where the case in `folder` is not that of this `identity`, or what is there cannot be read."""
    if outcome.status == "unreadable":
        raise InputError(f"{outcome.reason}; name another --output, or remove it")
    what = foreign(outcome, identity)
    if what:
        raise InputError(f"{folder}: {what}; name another --output, or remove it")


def _without_refinement(scene: dict) -> dict:
    """A scene without what a run changes in it for ``method.target_error``."""
    left = {"refine", *(["divisions"] if scene["method"]["target_error"] else [])}
    return scene | {"body": [body | {"mesh": {key: value for key, value in body["mesh"].items() if key not in left}}
                             for body in scene["body"]]}


def columns(cases: list[Case]) -> list[str]:
    """All columns of the table of these cases."""
    return ["case", *cases[0].settings, "status", "exit", "reason", *RESULTS, "started", "folder"]


def check_table(folder: Path, cases: list[Case]) -> None:
    """InputError where the table in `folder` has cases that are not among `cases`, and would lose them."""
    path = folder / TABLE
    if not os.path.lexists(path):
        return
    ours = {case.folder for case in cases}
    lost = [row.get("folder") for row in read_table(path)
            if row.get("folder") not in ours and row.get("status") != "not run"]
    if lost:
        raise InputError(f"{path}: is the table of a sweep with {len(lost)} cases that this one has not, {lost[0]} for "
                         "one; vary over their values, too (what is finished is not run again), name another "
                         "--output, or move the table away")


def gather(folder: Path, cases: list[Case]) -> tuple[Path, list[dict]]:
    """Write the table of `cases` out of what is on disk.

    Returns
    -------
    Its path, and its rows; what is not known is None.

    Raises OutputError, also where a table that is there would lose cases. Not collective.
    """
    try:
        check_table(folder, cases)
    except InputError as error:
        raise OutputError(str(error)) from None
    rows = []
    for case in cases:
        outcome = read_outcome(folder / case.folder)
        summary = outcome.summary or {}
        rows.append({"case": case.number, **case.values, "status": outcome.status, "exit": outcome.exit,
                     "reason": outcome.reason, **{name: _at(summary, name) for name in RESULTS},
                     "started": summary.get("started"), "folder": case.folder})
    text = io.StringIO()
    writer = csv.DictWriter(text, columns(cases), lineterminator="\n")
    writer.writeheader()
    writer.writerows(rows)  # None is an empty field
    path = folder / TABLE
    write_atomically(path, text.getvalue().encode())
    return path, rows


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


def _read_json(path: Path) -> dict | None:
    try:
        return json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError:
        return None


def _at(summary: dict, name: str) -> Any:
    """The entry of a nested table or list by its dotted name; None where there is none."""
    value: Any = summary
    for part in name.split("."):
        if isinstance(value, list):
            value = value[int(part)] if int(part) < len(value) else None
        else:
            value = value.get(part) if isinstance(value, dict) else None
    return value


def _number(text: str | None) -> Any:
    if not text:
        return None
    for kind in (int, float):
        try:
            return kind(text)
        except ValueError:
            continue
    return text


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
