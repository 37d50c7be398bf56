"""A report of a run: one HTML file with its verdict, pictures and numbers, made from the files of the run only."""

from __future__ import annotations

import json
import tempfile
from importlib import resources
from pathlib import Path

from ddmpi import __version__
from ddmpi.cli.report_markup import Column, Html, fill, noted, picture, table
from ddmpi.cli.report_run import RunReport
from ddmpi.errors import InputError
from ddmpi.results.histories import at_step
from ddmpi.results.tables import read_results, read_summary, reading
from ddmpi.scene.reader import write_toml
from ddmpi.sweep.table import read_table
from ddmpi.system.files import CHECKPOINT, SUMMARY, SWEEP, TABLE, write_atomically
from ddmpi.system.provenance import has_matplotlib

MARK = '<meta name="generator" content="ddmpi '
"""What a report begins with, and a file that may be overwritten."""


def write_report(folder: str | Path, output: str | None = None, time: float | None = None) -> Path:
    """Write the report of a run or a sweep, by default as report.html into its `folder`; its path. Not collective.

    It shows the load step at `time`, by default as `at_step` chooses it; for a `time` pictures are drawn anew. A report
    is overwritten, any other file is not. Raises InputError where the folder has no results or the file is no report,
    OutputError where it cannot be written.
    """
    folder = Path(folder)
    path = Path(output) if output else folder / "report.html"
    if time is not None and (folder / SWEEP).exists():
        raise InputError(f"{folder}: a sweep has no load steps; --step is for the report of a run")
    template = resources.files("ddmpi.cli").joinpath("report.html").read_text(encoding="utf-8")
    with reading(folder):
        page = _sweep(folder, template) if (folder / SWEEP).exists() else _run(folder, template, time)
    if path.exists() and not (path.is_file() and MARK.encode() in path.read_bytes()[:1000]):
        raise InputError(f"--output {path}: is there already, and no report of ddmpi; name another file")
    write_atomically(path, page.encode())
    return path


def _run(folder: Path, template: str, time: float | None) -> str:
    """The report of a run that shows the load step at `time`. Raises InputError."""
    if (folder / CHECKPOINT).exists() and not (folder / SUMMARY).exists():
        raise InputError(f"{folder}: the run was not completed; go on from its checkpoint with --restart {folder}")
    if not (folder / SUMMARY).exists():
        raise InputError(f"{folder}: not the folder of a run or a sweep: there is no {SUMMARY}")
    steps = time is not None or (folder / "energy.csv").exists()
    results, drawn = at_step(read_results(folder), folder, time) if steps else None, None
    summary = results.summary if results else read_summary(folder)
    try:
        with tempfile.TemporaryDirectory() as place:
            if time is not None and has_matplotlib():
                from ddmpi.pictures.draw import draw_all

                drawn = Path(place)
                draw_all(folder, time=time, into=drawn)
            return RunReport(folder, summary, results.time if results else None, drawn).page(template)
    except KeyError as error:
        raise InputError(f"{folder}: not a complete folder of results: {SUMMARY} has no {error}") from None


def _sweep(folder: Path, template: str) -> str:
    """The report of a sweep. Raises InputError."""
    if not (folder / TABLE).exists():
        raise InputError(f"{folder}: the sweep has no {TABLE} yet; it is written at its end, or by sweep … --gather")
    rows = read_table(folder / TABLE)
    try:
        scene = json.loads((folder / SWEEP).read_text(encoding="utf-8"))["scene"]
    except (ValueError, KeyError) as error:
        raise InputError(f"{folder / SWEEP}: not the record of a sweep: {error}") from None
    if not rows:
        raise InputError(f"{folder / TABLE}: has no cases; sweep … --gather writes it anew")
    names, unit = list(rows[0]), scene.get("output", {}).get("length_unit", "m")
    settings, certified = names[1:names.index("status")], sum(row["status"] == "certified" for row in rows)
    ends = [": ".join(filter(None, (row["status"], _entry(row["reason"]) * (row["status"] != "certified"))))
            for row in rows]
    errors = [row.get("discretization_error.energy_norm") for row in rows]
    warnings = [f"Case {_entry(row['case'])}: {row['warnings']}" for row in rows if row.get("warnings")]
    cases = table("A line for each case; sweep.csv has all results",
                  Column("case", [_entry(row["case"]) for row in rows]),
                  *(Column(name, [_entry(row[name]) for row in rows]) for name in settings), Column("ended", ends),
                  Column("outer iterations", [row["outer_iterations"] for row in rows]),
                  Column("solves", [row["n_A"] for row in rows]),
                  Column("displacement", [row["displacement_max"] for row in rows], unit),
                  Column("estimated error", [error and 100 * error for error in errors], "%"),
                  Column("time", [row.get("seconds.total") for row in rows], "s", decimals=2), digits=3)
    return fill(template, {
        "version": __version__, "kind": "sweep", "title": scene.get("title") or folder.resolve().name,
        "mood": "good" if certified == len(rows) else "bad",
        "verdict": f"{certified} of {len(rows)} cases certified",
        "because": f"Varied: {', '.join(settings)}." + f" Cases that warn: {len(warnings)}." * bool(warnings),
        "warnings": noted(warnings), "cases": cases,
        "plots": Html("".join(picture(path, path.stem) for path in sorted(folder.glob("*.png")))),
        "scene": write_toml(scene), "scene_words": "The scene as it was written, before anything was varied."}, {"run"})


def _entry(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else "" if value is None else str(value)
