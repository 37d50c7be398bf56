"""A report of a run or a sweep: one HTML file with its verdict, pictures and numbers, made from its files only."""

import functools
import json
import math
import tempfile
from collections.abc import Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from ddmpi.cli.report_markup import (
    CAPTIONS,
    Column,
    Html,
    element,
    fill,
    noted,
    number,
    page,
    picture,
    table,
)
from ddmpi.errors import InputError
from ddmpi.judge.accuracy import price_in_words
from ddmpi.mesh.elements import ORDERS
from ddmpi.pictures.script import our_digest
from ddmpi.results.histories import at_step, evenly
from ddmpi.results.summary import (
    RESIDUALS,
    ROWS,
    count,
    drawn_times,
    friction_in_words,
    held_in_words,
    largest,
    loose_in_words,
    tell,
    where,
    with_bar,
)
from ddmpi.results.tables import read_results, read_summary, reading
from ddmpi.scene.method import method_of
from ddmpi.scene.reader import write_toml
from ddmpi.sweep.table import read_table, varied
from ddmpi.system.files import CHECKPOINT, MECHANISM, SUMMARY, SWEEP, TABLE, write_page
from ddmpi.system.numbers import counted
from ddmpi.system.provenance import has_matplotlib

MOST_STEPS = 24
"""Most load steps in the table: of more steps those at the ends of legs, of more ends an even choice."""

FEW = 3
"""Most contacts with lines of their own in the table of load steps."""

PHASES = {
    "mesh": "making or reading the meshes",
    "assemble": "stiffness, pairing of the contacts",
    "factor": "factorization of the stiffness",
    "outer": "the iteration",
    "recover": "displacements, stresses",
    "estimate": "estimate of the error",
    "doubt": "warnings of the answer",
    "output": "files and pictures",
    "total": "all",
}

RESULTANTS = ["force", "moment", "normal_force", "tangential_force"]

STATES = ["open", "slip", "stick", "dissipated"]

BETWEEN = ("pointwise_penetration", "moment_imbalance", "moment_imbalance_bound")
"""Entries of contacts whose nodes do not match."""


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
    with reading(folder):
        page = _sweep(folder) if (folder / SWEEP).exists() else _run(folder, time)
    return write_page(path, page, "report")


def _run(folder: Path, time: float | None) -> str:
    """The report of a run that shows the load step at `time`. Raises InputError."""
    if (folder / CHECKPOINT).exists() and not (folder / SUMMARY).exists():
        raise InputError(
            f"{folder}: the run was not completed; go on from its checkpoint with --restart {folder}"
        )
    steps = time is not None or (
        (folder / "energy.csv").exists() and (folder / "result.h5").exists()
    )
    results, drawn = at_step(read_results(folder), folder, time) if steps else None, None
    summary = results.summary if results else read_summary(folder)
    with tempfile.TemporaryDirectory() as place:
        if time is not None and has_matplotlib():
            from ddmpi.pictures.draw import draw_all

            drawn = Path(place)
            draw_all(folder, time=time, into=drawn)
        return RunReport(folder, summary, results.time if results else None, drawn).page()


def _sweep(folder: Path) -> str:
    """The report of a sweep. Raises InputError."""
    if not (folder / TABLE).exists():
        raise InputError(
            f"{folder}: the sweep has no {TABLE} yet; it is written at its end, or by sweep … --gather"
        )
    rows = read_table(folder / TABLE)
    with reading(folder / SWEEP, "the record of a sweep"):
        scene = json.loads((folder / SWEEP).read_text(encoding="utf-8"))["scene"]
    if not rows:
        raise InputError(f"{folder / TABLE}: has no cases; sweep … --gather writes it anew")
    settings = varied(rows)
    certified = sum(row["status"] == "certified" for row in rows)
    warnings = [
        f"Case {_entry(row['case'])}: {row['warnings']}" for row in rows if row.get("warnings")
    ]
    plots = [picture(path, path.stem) for path in sorted(folder.glob("*.png"))]
    return fill(
        {
            "kind": "sweep",
            "title": scene.get("title") or folder.resolve().name,
            "mood": "good" if certified == len(rows) else "bad",
            "verdict": f"{certified} of {len(rows)} cases certified",
            "because": f"Varied: {', '.join(settings)}."
            + f" Cases that warn: {len(warnings)}." * bool(warnings),
            "warnings": noted(warnings),
            "cases": _cases(rows, settings, scene.get("output", {}).get("length_unit", "m")),
            "plots": Html("".join(plots)),
            "scene": write_toml(scene),
            "scene_words": "The scene as it was written, before anything was varied.",
        },
        {"run"},
    )


def _cases(rows: Sequence[Mapping[str, Any]], settings: Sequence[str], unit: str) -> Html:
    """The table of the cases of a sweep, with lengths in a unit."""

    def column(head: str, key: str, unit: str = "", decimals: int | None = None) -> Column:
        return Column(head, [row.get(key) for row in rows], unit, decimals)

    return table(
        "A line for each case; sweep.csv has all results",
        Column("case", [_entry(row["case"]) for row in rows]),
        *(Column(name, [_entry(row[name]) for row in rows]) for name in settings),
        Column("ended", [_ended(row) for row in rows]),
        column("outer iterations", "outer_iterations"),
        column("solves", "n_A"),
        column("displacement", "displacement_max", unit),
        column("estimated error", "discretization_error.energy_norm", "%"),
        column("time", "seconds.total", "s", 2),
        digits=3,
    )


def _ended(row: Mapping[str, Any]) -> str:
    """How a case ended, with the reason where it was not certified."""
    if row["status"] == "certified" or not row["reason"]:
        return row["status"]
    return f"{row['status']}: {row['reason']}"


def _entry(value: object) -> str:
    return f"{value:g}" if isinstance(value, float) else "" if value is None else str(value)


class RunReport:
    """The contents of a report of a run: the summary of its `folder` at the load step of a `time`; pictures of this
    step that have been `drawn` into another folder take the place of those there."""

    def __init__(
        self, folder: Path, summary: dict, time: float | None = None, drawn: Path | None = None
    ) -> None:
        self.folder, self.summary, self.drawn = folder, summary, drawn or folder
        self.scene, self.bodies, self.contacts = (
            summary["scene"],
            summary["bodies"],
            summary["contacts"],
        )
        self.refused = (folder / MECHANISM).exists() and not drawn  # then its numbers mean nothing
        self.error, self.stepped = (
            summary["discretization_error"],
            self.scene.get("time") is not None,
        )
        last = time in (None, *(step["time"] for step in summary["steps"][-1:]))
        end = "of the last load step"
        self.of_step = (end if last else f"at time {time:g}") if self.stepped else ""
        self.of_end = end if self.stepped and not last and summary.get("warnings") else ""
        self.axes = "xyz"[: len(next(iter(self.bodies.values()))["reaction"])]
        self.units = summary["units"] | {"": "", "%": "%"}

    def page(self) -> str:
        values = self._run() | self._work() | self._pictures() | self._steps() | self._numbers()
        if not self.refused:
            return fill(
                values
                | self._bars()
                | self._contacts()
                | self._bodies()
                | self._certificate()
                | self._error()
            )
        mechanism = json.loads((self.folder / MECHANISM).read_text(encoding="utf-8"))
        return fill(values | {"imbalance": number(mechanism["imbalance"], 2)}, {"numbers"})

    def _columns(
        self, table: str, keys: Iterable[str | Column], entries: Iterable[Any]
    ) -> Iterator[Column]:
        """The `keys` of `entries` as columns, by the rows that begin with `table`; of vectors one for each axis."""
        entries = list(entries)
        for key in keys:
            if isinstance(key, Column):
                yield key
                continue
            row = ROWS[table + key]
            # results of earlier versions lack some
            values = [functools.reduce(_part, key.split("."), entry) for entry in entries]
            if not any(isinstance(value, list | tuple) for value in values):
                yield Column(row.words, values, self.units[row.quantity])
                continue
            for k, axis in enumerate(self.axes):
                yield Column(
                    f"{row.words} {axis}",
                    [value and value[k] for value in values],
                    self.units[row.quantity],
                )

    def _places(self, of: str, key: str) -> Column:
        """The places of the maxima of bodies or contacts; empty in results of versions before 0.19."""
        return Column("at", [where(entry, key) for entry in self.summary[of].values()])

    def _table(
        self, of: str, caption: str, *keys: str | Column, entries: dict | None = None, **options
    ) -> Html:
        """A table with a line for each of the "bodies" or "contacts", or of `entries` in their place, by name."""
        entries = self.summary[of] if entries is None else entries
        return table(
            caption,
            Column({"bodies": "body", "contacts": "contact"}[of], list(entries)),
            *self._columns(f"{of}.NAME.", keys, entries.values()),
            **options,
        )

    def _run(self) -> dict[str, Any]:
        """The verdict, warnings, provenance and scene, and the numbers of the summary by their names."""
        summary, (verdict, *sentences) = self.summary, self._verdict()
        hosts = ", ".join(dict.fromkeys(summary.get("hosts", ())))
        versions = summary.get("versions", {})
        started = summary.get("started", "").replace("T", " ").replace("Z", " UTC")
        when = [
            f"run of {started}" if started else "",
            f"on {hosts}" if hosts else "",
            f"{summary['ranks']} rank{'s' * (summary['ranks'] != 1)}",
            f"ddmpi {versions.get('ddmpi', 'of unknown version')}",
        ]
        options = " ".join(
            f"-{name} {value}".strip() for name, value in summary.get("options", {}).items()
        )
        return {name: value for name, value in summary.items() if isinstance(value, int | str)} | {
            "kind": "run",
            "title": summary["title"] or self.folder.resolve().name,
            "mood": "good" if summary["converged"] else "bad",
            "verdict": verdict,
            "because": sentences[0],
            "more": " ".join(sentences[1:]),
            "when": ", ".join(filter(None, when)),
            "hosts": hosts,
            "of_end": self.of_end,
            "warnings": noted(
                [
                    *summary.get("warnings", ()),
                    *held_in_words(summary),
                    *loose_in_words(summary),
                ]
            ),
            "slurm": ", ".join(
                f"{name.replace('_', ' ')} {value}"
                for name, value in summary.get("slurm", {}).items()
            ),
            "versions": ", ".join(f"{name} {value}" for name, value in versions.items()),
            "options": options or "none",
            "scene": write_toml(self.scene),
            "scene_words": "The scene as the run has read it, with all that was left out filled in. A file of it can "
            "be run again.",
        }

    def _verdict(self) -> list[str]:
        """How the run ended in a word or two, and the sentences that explain it."""
        summary, warnings = self.summary, len(self.summary.get("warnings", ()))
        limit, estimate = f"{summary['certificate_limit']:.2g}", self.error["energy_norm"]
        if summary["converged"]:
            sentences = [f"All residuals of the coupled problem are below {limit}."]
            if estimate is not None:
                sentences.append(
                    f"The mesh leaves an estimated error of {number(estimate, 2, '%')} in the energy norm."
                )
            if warnings:
                sentences.append(
                    f"There {'are' if warnings > 1 else 'is'} {warnings} warning{'s' * (warnings > 1)}."
                )
            return ["Certified", " ".join(sentences)]
        reason = summary["reason"]
        no_answer = (
            ""
            if self.refused
            else "The numbers below are those of the last iteration, and no answer."
        )
        if reason.startswith("no equilibrium"):
            verdict, _, motion = reason.partition(": ")
            return [verdict.capitalize(), motion, no_answer]
        failing = [
            f"{_words(kind)} {number(value, 2)}"
            for kind, value in summary["certificate"].items()
            if self._fails(value)
        ]
        if not failing:  # an accuracy target is missed
            return ["Accuracy not reached", reason, "The answer on this mesh is certified."]
        return [
            "No certified answer",
            reason,
            f"Above the limit of {limit}: {', '.join(failing)}.",
            no_answer,
            "The messages of the run say what to try.",
        ]

    def _fails(self, value: float | None) -> bool:
        return value is None or value > self.summary["certificate_limit"]

    def _numbers(self) -> dict[str, Any]:
        """The numbers at the top of the report."""
        contacts = self.contacts.values()
        numbers = {
            "m": sum(contact["m"] for contact in contacts) if contacts else "",
            "nodes": count(contacts) if contacts else "",
            "of_step": self.of_step,
            "depth": "depth" if len(self.axes) == 2 and not self.scene.get("axisymmetric") else "",
            "estimate": number(self.error["energy_norm"], 2, "%"),
            "body_number": f"{len(self.bodies)} bod{'ies' if len(self.bodies) > 1 else 'y'}",
            "solves": counted(self.summary["n_A"], "solve"),
            "elements": ORDERS[self.summary["order"]],
        }
        if not {contact["friction"] for contact in contacts} <= {"none", "bonded", "guided"}:
            dissipated = sum(contact["dissipated"] or 0.0 for contact in contacts)
            numbers["dissipated"] = number(dissipated, unit=self.units["energy"])
        numbers |= self._utilised() | self._bolts()
        numbers |= self._largest("displacement", self.bodies, "length")
        numbers |= self._largest("von_mises", self.bodies, "stress")
        return numbers | self._largest("pressure", self.contacts, "stress")

    def _largest(self, name: str, entries: dict[str, dict[str, Any]], unit: str) -> dict[str, str]:
        """The largest value of all bodies or contacts, with its place; nothing where there are none."""
        if not entries:
            return {}
        value, of = largest(entries, f"{name}_max")
        if value is None:
            shown, remark = number(value), "not computed"
        elif value < 0.0:  # bonds, all in tension
            shown, remark = "none", f"{of}: {tell(self.summary, 'contacts', of, 'pressure_max')}"
        else:
            place = where(entries[of], f"{name}_max")
            shown, remark = number(value, unit=self.units[unit]), f"of {of}"
            remark += f", at {place}" * bool(place)
        return {name: shown, f"{name}_of": remark}

    def _utilised(self) -> dict[str, str]:
        """The contact that bears most of its friction."""
        shares = {
            name: entry["utilisation"]
            for name, entry in self.contacts.items()
            if entry.get("utilisation") is not None
        }
        if not shares:
            return {}
        most = max(shares, key=lambda name: shares[name])
        return {"most_utilised": number(shares[most], 3, "%"), "most_utilised_of": f"of {most}"}

    def _bolts(self) -> dict[str, str]:
        """The forces of bolts with their offsets, and the least one."""
        pulled = {name: entry.get("pretension") for name, entry in self.contacts.items()}
        bolts = {name: pull for name, pull in pulled.items() if pull}
        if not bolts:
            return {}
        force, length = self.units["force"], self.units["length"]
        words = {
            name: (number(pull["force"], unit=force), number(pull["offset"], unit=length))
            for name, pull in bolts.items()
        }
        least = min(bolts, key=lambda name: bolts[name]["force"])
        return {
            "bolt": words[least][0],
            "bolt_of": f"of {least}" + f", the least of {len(bolts)}" * (len(bolts) > 1),
            "bolts": " ".join(
                f"{name}: {pull} at the offset {by}." for name, (pull, by) in words.items()
            ),
        }

    def _bars(self) -> dict[str, Any]:
        """The results whose errors were asked for, with their bars or words."""
        errors = self.summary.get("errors")
        if not errors:
            return {}
        last = " of the last load step, given those before" if self.stepped else "alone"
        told = [with_bar(self.summary, result) for result in errors]
        caption = "A value, and half the width of the interval for that of the continuum"
        prices = [entry.get("half") for entry in errors.values()]
        halves = [price_in_words(price) if price else "–" for price in prices]
        rows = table(
            caption,
            Column("result", list(errors)),
            Column("value and error", told),
            Column("half of the error takes", halves),
        )
        return {"bars": rows, "of_errors": last.strip()}

    def _pictures(self) -> dict[str, Any]:
        captions: dict[str, str] = {}
        for file, (plane, solid) in CAPTIONS.items():
            words = solid if len(self.axes) == 3 else plane
            names = [name for name in self.contacts if "/" not in name] if "NAME" in file else [""]
            captions |= {file.replace("NAME", name): words.replace("NAME", name) for name in names}
        if self.refused:
            captions = {"mechanism.png": self.summary["reason"]}
        pictures = Html(
            "".join(
                picture(self.drawn / file, words) or picture(self.folder / file, words)
                for file, words in captions.items()
            )
        )
        hands = (
            "Drag to turn, wheel to zoom, shift and drag to move"
            if len(self.axes) == 3 or self.scene.get("axisymmetric")
            else "Drag to move, wheel to zoom"
        )
        view = page(self.folder / "view.html", f"{hands}. The controls choose what is drawn.")
        allowed = {"view": view, "policy": Html(f"; script-src {our_digest()}")} if view else {}
        return allowed | {"pictures": pictures, "undrawn": "" if pictures else self.folder}

    def _contacts(self) -> dict[str, Any]:
        contacts = self.contacts
        if not contacts:
            return {}
        asked = {contact["name"]: contact for contact in self.scene["contact"]}
        unmatched = [name for name, contact in contacts.items() if contact["slave"]]
        # matching nodes have no such errors
        entries = {
            name: contact if contact["slave"] else contact | dict.fromkeys(BETWEEN)
            for name, contact in contacts.items()
        }
        pairing = [
            f"mortar, nodes of {contact['slave']}" if contact["slave"] else "node to node"
            for contact in contacts.values()
        ]
        slips = {name: friction_in_words(contact) for name, contact in contacts.items()}
        return {
            "utilised": " ".join(
                f"{name}: {words}." for name, words in slips.items() if "slip" in words
            ),
            "contacts": self._table(
                "contacts",
                "Force and moment on the first body, about the origin; normal forces are positive under "
                "pressure",
                *RESULTANTS,
                "pressure_max",
                self._places("contacts", "pressure_max"),
                *STATES,
                "utilisation",
            ),
            "pairing": self._table(
                "contacts",
                "Pairing; directions are those of the first body",
                Column("bodies", [", ".join(asked[name]["bodies"]) for name in contacts]),
                Column("law", [_law(asked[name]) for name in contacts]),
                "m",
                Column("pairing", pairing),
                *(BETWEEN if unmatched else ()),
                entries=entries,
                digits=3,
                minor=True,
            ),
            "unmatched": ", ".join(unmatched[:FEW]) + ", …" * (len(unmatched) > FEW),
        }

    def _bodies(self) -> dict[str, Any]:
        supports = {
            body["name"]: [f"{word}s" for word in ("clamp", "foundation") if body.get(word)]
            for body in self.scene["body"]
        }
        entries = {
            name: body if supports[name] else body | {"reaction": [None] * len(self.axes)}
            for name, body in self.bodies.items()
        }
        supported = [
            " and ".join(supports[name] + ["contacts"] * (not body["held"]))
            for name, body in self.bodies.items()
        ]
        return {
            "groups": self._groups(),
            "bodies": self._table(
                "bodies",
                "Largest displacement and stress; the reaction of clamps and foundations, where there are any",
                "n",
                "displacement_max",
                self._places("bodies", "displacement_max"),
                "von_mises_max",
                self._places("bodies", "von_mises_max"),
                "reaction",
                "energy",
                Column("supported by", supported),
                entries=entries,
            ),
        }

    def _groups(self) -> Html | str:
        rows = [
            (name, group, by, forces)
            for name, body in self.bodies.items()
            for by in ("loads", "reactions")
            for group, forces in body.get(by, {}).items()
        ]
        if not rows:
            return ""
        *names, forces = zip(*rows, strict=True)
        return table(
            "What loads and supports do to bodies, by group; moments are about the origin",
            *(
                Column(head, column)
                for head, column in zip(("body", "group", "of"), names, strict=True)
            ),
            *self._columns("bodies.NAME.loads.GROUP.", ("force", "moment"), forces),
        )

    def _steps(self) -> dict[str, Any]:
        """The load steps, condensed where there are many, and the balance of energy."""
        every = self.summary["steps"]
        if not self.stepped or not every:
            return {"no_steps": "No load step was completed." if self.stepped else ""}
        steps = self._told_steps()
        if len(self.contacts) <= FEW:
            rows = [
                (step, name, contact)
                for step in steps
                for name, contact in step["contacts"].items()
            ]
            caption, keys = "Forces on the first body", [*RESULTANTS, *STATES, "utilisation"]
        else:
            rows = [(step, "all", _all_contacts(step)) for step in steps]
            caption, keys = "Nodes of all contacts", STATES
        if len(steps) < len(every):
            caption += f"; {len(steps)} of {len(every)} steps, steps.csv has all"
        several = 1 < len(self.contacts) <= FEW
        return self._energy() | {
            "step_number": f"{len(every)} load steps to time {every[-1]['time']:g}.",
            "steps": table(
                caption,
                Column("time", [f"{step['time']:g}" for step, *_ in rows]),
                Column("iterations", [step["outer_iterations"] for step, *_ in rows]),
                *([Column("contact", [name for _, name, _ in rows])] * several),
                *self._columns("contacts.NAME.", keys, [contact for *_, contact in rows]),
            ),
        }

    def _told_steps(self) -> list[dict]:
        """All load steps; of many those at the ends of legs, if there are any, evenly."""
        steps = self.summary["steps"]
        if len(steps) <= MOST_STEPS:
            return steps
        points = self.scene["time"]["points"]
        ends = [step for step in steps if drawn_times(self.summary, step["time"]) in points]
        told = ends or steps
        return [told[k] for k in evenly(len(told), MOST_STEPS)]

    def _energy(self) -> dict[str, Any]:
        energy = self.summary.get("energy")
        if not energy:
            return {}
        told = {key: row.words for key in energy if (row := ROWS.get(f"energy.{key}"))}
        return {
            "energy": table(
                "Energy since time 0: the first is the sum of the next two",
                Column("what", list(told.values())),
                Column("energy", [energy[key] for key in told], self.units["energy"]),
            ),
            "imbalance_of_energy": number(energy["residual"], 2),
        }

    def _certificate(self) -> dict[str, Any]:
        entries = [*self.contacts.items(), *self.bodies.items()]
        kinds = {
            kind: value for kind, value in self.summary["certificate"].items() if kind in RESIDUALS
        }
        worst = [
            _worst({name: entry["certificate"].get(kind, 0.0) for name, entry in entries})
            for kind in kinds
        ]
        verdicts = [
            element("span", "fails", kind="fails") if self._fails(value) else "holds"
            for value in kinds.values()
        ]
        of_contacts = [f"certificate.{kind}" for kind in kinds if kind != "equilibrium"]
        return {
            "limit": f"{self.summary['certificate_limit']:.2g}",
            "residuals": table(
                f"The worst of all contacts{', bodies and load steps' if self.stepped else ' and bodies'}",
                Column("residual", [_words(kind) for kind in kinds]),
                Column("value", list(kinds.values())),
                Column("verdict", verdicts),
                Column("worst of", worst),
                Column(
                    "what it is", [element("div", RESIDUALS[kind], kind="words") for kind in kinds]
                ),
                digits=2,
            ),
            "residuals_of_contacts": self._table(
                "contacts", "By contact", *of_contacts, digits=2, minor=True
            )
            if len(self.contacts) > 1
            else "",
            "residuals_of_bodies": self._table(
                "bodies",
                "By body, with its part of the estimated discretization error",
                "certificate.equilibrium",
                "discretization_error",
                digits=2,
                minor=True,
            ),
        }

    def _error(self) -> dict[str, Any]:
        estimate = self.error["energy_norm"]
        target = self.error.get("target")
        levels = self.error.get("levels") or []
        if estimate is None:
            return {
                "no_estimate": self.of_step if self.of_step.startswith("at") else "for this run"
            }
        meshes = table(
            "The meshes on the way",
            Column("mesh", [f"{k}" for k in range(1, len(levels) + 1)]),
            Column("refinement", [level["refinement"] for level in levels]),
            Column("unknowns", [level["n"] for level in levels]),
            Column("estimated error", [level["error"] for level in levels], "%"),
            digits=2,
        )
        return {
            "error": number(estimate, 2, "%"),
            "meshes": meshes if len(levels) > 1 else "",
            "target": f"; {number(target, 2, '%')} was asked for" if target else "",
        }

    def _work(self) -> dict[str, Any]:
        summary, seconds, bodies = self.summary, self.summary["seconds"], self.bodies.values()
        return summary.get("exchange", {}) | {
            "method": method_of(summary["outer"]).title.format_map(self.scene["method"]),
            "tolerance": f"{self.scene['method']['tolerance']:g}",
            "memory": f"{max(body['memory_mib'] for body in bodies):.0f}",
            "convergence": picture(
                self.folder / "convergence.png", "The outer iteration.", "small"
            ),
            "times": table(
                "Time of the slowest rank",
                Column("phase", list(seconds)),
                Column("time", list(seconds.values()), "s", decimals=2),
                Column("what it is", [PHASES.get(name, "") for name in seconds]),
            )
            if seconds
            else "",
            "work_of_bodies": self._table(
                "bodies",
                "By body",
                Column("ranks", [_ranks(body["ranks"]) for body in bodies]),
                "n_A",
                "solver",
                "compliance",
                Column("memory", [round(body["memory_mib"]) for body in bodies], "MiB"),
                minor=True,
            ),
        }


def _all_contacts(step: dict) -> dict[str, float]:
    """The states of all contacts at a load step together."""
    contacts = step["contacts"].values()
    return {key: sum(contact[key] or 0 for contact in contacts) for key in STATES}


def _part(entry: Mapping[str, Any] | None, key: str) -> Any:
    return (entry or {}).get(key)


def _words(kind: str) -> str:
    return kind.replace("_", " ")


def _law(contact: dict) -> str:
    """The law of a contact of the scene: bonded, guided, or its friction law with its numbers."""
    if contact.get("kind", "unilateral") != "unilateral":
        return contact["kind"]
    law, *numbers = contact["friction"].values()
    if not numbers:
        return {"none": "no friction"}.get(law, law)
    words = (f"{value:g}" if isinstance(value, int | float) else "varying" for value in numbers)
    return f"{law.capitalize()} {', '.join(words)}"


def _worst(values: Mapping[str, float | None]) -> Html | str:
    """The name with the largest value, or with None; a dash where all are zero."""
    sizes = {name: math.inf if value is None else value for name, value in values.items()}
    name = max(sizes, key=lambda name: sizes[name], default="")
    return element("span", name, kind="name") if name and sizes[name] else "–"


def _ranks(ranks: Sequence[int]) -> str:
    return f"{ranks[0]} to {ranks[-1]}" if len(ranks) > FEW else ", ".join(map(str, ranks))
