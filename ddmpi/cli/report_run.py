"""The report of one run: what it says, part by part, out of summary.json, mechanism.json and the pictures."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ddmpi import __version__
from ddmpi.cli.report_markup import (
    Column,
    Html,
    code,
    element,
    facts,
    folded_if_long,
    noted,
    number,
    pairs,
    percent,
    picture,
    scene_section,
    section,
    table,
)
from ddmpi.results.summary import moment_unit
from ddmpi.scene.reader import write_toml
from ddmpi.system.files import contact_files

MOST_STEPS = 24
"""Of more load steps those at the ends of legs are listed, and of more of these so many."""

FEW = 3
"""Of at most so many contacts each has its lines in the table of load steps."""

RESIDUALS = {
    "force_mismatch": ("force mismatch", "How far the contact forces of the two bodies are from cancelling, over the "
                       "forces."),
    "penetration": ("penetration", "The largest overlap at the nodes, or opening where bonded, over the size of the "
                    "contact displacements."),
    "complementarity": ("complementarity", "Force across open nodes, and tension."),
    "friction": ("friction", "How far tangential forces are from the friction law, over the largest force."),
    "equilibrium": ("equilibrium", "What is left of the balance of forces in a body, over its loads.")}
"""Name and meaning of each residual of the certificate."""

PHASES = {"mesh": "making or reading the meshes", "assemble": "stiffness, pairing of the contacts",
          "factor": "factorization of the stiffness", "outer": "the iteration", "recover": "displacements, stresses",
          "estimate": "estimate of the error", "output": "files and pictures", "total": "all"}

ENERGIES = {"external_work": "work of loads, clamps and rigid partners", "strain_energy": "strain energy",
            "interface_work": "work of the contact forces", "dissipated": "of it dissipated by friction",
            "lost": "of it taken by interference, closing gaps and time stepping"}


class RunReport:
    """The summary of a run, and the parts of its report.

    Attributes
    ----------
    refused : whether the run has found a mechanism, so that its numbers mean nothing
    at : the time of the load step that numbers of contacts and bodies are of, in words; nothing for the last one
    drawn : a folder with pictures of this step, in place of those in `folder`
    """

    def __init__(self, folder: Path, summary: dict, time: float | None = None, drawn: Path | None = None) -> None:
        self.folder, self.summary, self.drawn = folder, summary, drawn or folder
        self.scene, self.bodies, self.contacts = summary["scene"], summary["bodies"], summary["contacts"]
        self.title = summary["title"] or folder.resolve().name
        self.refused = (folder / "mechanism.json").exists() and not drawn
        self.at = "" if time in (None, *(step["time"] for step in summary["steps"][-1:])) else f" at time {time:g}"
        units = summary["units"]
        self.length, self.stress, self.force = units["length"], units["stress"], units["force"]
        self.moment = moment_unit(units)
        self.energy = {"N/m": "J/m", "N/mm": "mJ/mm"}.get(self.force, f"{self.force}·{self.length}")

    def parts(self) -> list[Html]:
        """The parts of the page, in order."""
        found = [self._mechanism(), self._steps()] if self.refused else [
            self._numbers(), self._pictures(), self._contacts(), self._bodies(), self._steps(), self._certificate(),
            self._error()]
        scene = scene_section(write_toml(self.scene), "The scene as the run has read it, with all that was left out "
                              "filled in. A file of it can be run again.")
        parts = [self._head(), self._warnings(), *found, self._work(), self._provenance(), scene]
        return [part for part in parts if part]

    def _head(self) -> Html:
        summary = self.summary
        kind = f"verdict {'good' if summary['converged'] else 'bad'}"
        when = [f"run of {summary['started'].replace('T', ' ').replace('Z', ' UTC')}"] if "started" in summary else []
        when += [f"on {', '.join(dict.fromkeys(summary['hosts']))}"] if summary.get("hosts") else []
        when += [f"{summary['ranks']} rank{'s' * (summary['ranks'] != 1)}",
                 f"ddmpi {summary.get('versions', {}).get('ddmpi', 'of unknown version')}"]
        verdict, *sentences = self._verdict()
        return element("header", element("p", "Report of a run of ddmpi", kind="over"), element("h1", self.title),
                       element("div", element("strong", verdict), *(element("p", each) for each in sentences if each),
                               kind=kind), element("p", ", ".join(when), kind="under"))

    def _verdict(self) -> list[str]:
        """How the run ended in a word or two, and the sentences that explain it."""
        summary, warnings = self.summary, len(self.summary.get("warnings", ()))
        limit = f"{summary['certificate_limit']:.2g}"
        if summary["converged"]:
            found = [f"All residuals of the coupled problem are below {limit}."]
            if self._estimate is not None:
                found.append(f"The mesh leaves an estimated error of {percent(self._estimate)} in the energy norm.")
            if warnings:
                found.append(f"The run warns of {warnings} thing{'s' * (warnings > 1)}.")
            return ["Certified", " ".join(found)]
        reason = summary["reason"]
        no_answer = "" if self.refused else "The numbers below are those of the last iteration, and no answer."
        if reason.startswith("no equilibrium"):
            found, _, motion = reason.partition(": ")
            return [found.capitalize(), motion, no_answer]
        failing = [f"{RESIDUALS[kind][0]} {number(value, 2)}" for kind, value in summary["certificate"].items()
                   if self._fails(value)]
        if not failing:  # an accuracy target is missed
            return ["Accuracy not reached", reason, "The answer on this mesh is certified."]
        return ["No certified answer", reason, f"Above the limit of {limit}: {', '.join(failing)}. {no_answer} The run "
                "has printed what it saw, and what to try."]

    @property
    def _estimate(self) -> float | None:
        return self.summary["discretization_error"]["energy_norm"]

    def _fails(self, value: float | None) -> bool:
        return value is None or value > self.summary["certificate_limit"]

    def _warnings(self) -> Html | None:
        summary = self.summary
        unused = summary.get("options_unused", [])
        found = [*summary.get("warnings", ()), *(f"{motion}; the position nearest to where it was is taken"
                                                 for motion in summary.get("undetermined", ())),
                 *([f"PETSc options that nothing used: {', '.join(unused)}"] if unused else [])]
        if not found:
            return None
        return section("warnings", "Warnings", noted(found))

    def _mechanism(self) -> Html:
        content = json.loads((self.folder / "mechanism.json").read_text(encoding="utf-8"))
        words = element("p", "No contact forces within the laws of contact and friction balance the loads: the least "
                        f"imbalance is {number(content['imbalance'], 2)} of the loads. So there are no forces and "
                        "stresses to report. Clamps, contacts or friction may hold the bodies.")
        path = self.folder / "mechanism.png"
        return section("mechanism", "How the bodies would move", words, picture(
            path, "The bodies as they stand and as they would move, not to scale.", f"Mechanism: {content['reason']}")
            if path.exists() else self._undrawn())

    def _undrawn(self) -> Html:
        return element("p", "The run has drawn no pictures. ", code(f"python -m ddmpi figures {self.folder}"), " draws "
                       "them; write the report again after that.", kind="note")

    def _numbers(self) -> Html:
        """The numbers that are looked at first."""
        summary, (nodes, counts) = self.summary, _counts(self.contacts)
        entries = [
            ("largest displacement", *self._largest(self.bodies, "displacement_max", self.length)),
            ("largest von Mises stress", *self._largest(self.bodies, "von_mises_max", self.stress)),
            ("largest contact pressure", *self._largest(self.contacts, "pressure_max", self.stress)),
            ("contact nodes", nodes, counts),
            ("friction dissipates", number(sum(each["dissipated"] or 0.0 for each in self.contacts.values()),
                                           unit=self.energy), "in all load steps" if self._has_steps else ""),
            ("estimated error", percent(self._estimate), "of the energy norm, by the mesh"),
            ("unknowns", summary["n"], f"{('linear', 'quadratic')[summary['order'] - 1]} elements, "
             f"{len(self.bodies)} bod{'y' if len(self.bodies) == 1 else 'ies'}"),
            ("outer iterations", summary["outer_iterations"], f"{summary['n_A']} solves with a body's stiffness")]
        if {contact["friction"] for contact in self.contacts.values()} <= {"none", "bonded"}:
            del entries[4]
        when = (f" Numbers of contacts and bodies are those{self.at or ' of the last load step'}; report --step TIME "
                "shows another one.") * self._has_steps
        return section("numbers", "At a glance", facts(entries), element(
            "p", f"Forces, moments and energies are per unit of depth.{when}"))

    def _largest(self, entries: dict, key: str, unit: str) -> tuple[str, str]:
        """The largest value of a key, and of what it is."""
        known = {name: entry[key] for name, entry in entries.items() if entry[key] is not None}
        best = max(known, key=lambda name: known[name], default="")
        return (number(known[best], unit=unit), f"of {best}") if known else ("–", "not computed")

    def _pictures(self) -> Html:
        stress = "von Mises stress" if self.scene["output"].get("stress", True) else "displacement"
        bodies, contacts = ", ".join(list(self.bodies)[:FEW]), ", ".join(list(self.contacts)[:FEW])
        known = {
            "bodies.png": ("Deformed bodies, displacements enlarged as the title says; the outlines are undeformed.",
                           f"Deformed bodies coloured by {stress}: {bodies}"),
            "contacts.png": ("All contacts: pressures as areas, zones as lines, resultants.",
                             f"Contact forces of all contacts: {contacts}"),
            "contact.png": ("Stresses, gap and slip along the contact.", f"Contact stresses of {contacts}"),
            **{contact_files(name).picture: (f"Stresses, gap and slip along {name}.", f"Contact stresses of {name}")
               for name in self.contacts},
            "steps.png": ("Load steps: loops of the tangential force, energies, contact stresses.",
                          "Loops of forces, energies and contact stresses over the load steps"),
            "animation.gif": ("The load steps, played.", "Animation of the deformed bodies"),
            "error.png": ("Where the estimated discretization error is.", "Estimated error of each triangle")}
        places = {name: self.folder / name for name in known} | {path.name: path for path in self.drawn.glob("*.png")}
        found = [picture(places[name], *words) for name, words in known.items() if places[name].exists()]
        return section("pictures", "Pictures", *(found or [self._undrawn()]))

    def _contacts(self) -> Html:
        names, contacts = list(self.contacts), list(self.contacts.values())
        asked = {each["name"]: each for each in self.scene["contact"]}
        paired = [Column("contact", names), Column("bodies", [", ".join(asked[name]["bodies"]) for name in names]),
                  Column("law", [_law(asked[name]) for name in names]),
                  Column("nodes", [contact["m"] for contact in contacts]),
                  Column("pairing", [f"mortar, nodes of {contact['slave']}" if contact["slave"] else "node to node"
                                     for contact in contacts])]
        words = ""
        if any(contact["slave"] for contact in contacts):
            keys = {"overlap": ("pointwise_penetration", self.length), "moment left": ("moment_imbalance", self.moment),
                    "at most": ("moment_imbalance_bound", self.moment)}
            paired += [Column(head, [contact[key] if contact["slave"] else None for contact in contacts], unit)
                       for head, (key, unit) in keys.items()]
            words = element("p", "Where nodes do not match, the gap obeys the law in the mean around each node. The "
                            "overlap between nodes, and the moment that forces on nodes standing apart leave, are "
                            "errors of the mesh; the certificate does not limit them.")
        return section("contacts", "Contacts", table(
            f"Force and moment on the first body{self.at}, about the origin; normal forces are positive under pressure",
            Column("contact", names), *self._resultants(contacts),
            Column("pressure, largest", [contact["pressure_max"] for contact in contacts], self.stress),
            *self._states(contacts)), folded_if_long("How they are paired", len(names), table(
                "Pairing; directions are those of the first body", *paired, digits=3)), words)

    def _resultants(self, contacts: Sequence[dict]) -> list[Column]:
        return [Column("force x", [contact["force"][0] for contact in contacts], self.force),
                Column("force y", [contact["force"][1] for contact in contacts], self.force),
                Column("moment", [contact["moment"] for contact in contacts], self.moment),
                Column("normal", [contact["normal_force"] for contact in contacts], self.force),
                Column("tangential", [contact["tangential_force"] for contact in contacts], self.force)]

    def _states(self, contacts: Sequence[dict]) -> list[Column]:
        return [*(Column(status, [contact[status] for contact in contacts]) for status in ("open", "slip", "stick")),
                Column("dissipated", [contact["dissipated"] for contact in contacts], self.energy)]

    def _bodies(self) -> Html:
        names, bodies = list(self.bodies), list(self.bodies.values())
        clamped = {each["name"] for each in self.scene.get("body", ()) if each["clamp"]}
        reactions = [body["reaction"] if name in clamped else (None, None) for name, body in self.bodies.items()]
        return section("bodies", "Bodies", table(
            f"Largest displacement and stress{self.at}; the reaction of the clamps, where there are any",
            Column("body", names), Column("unknowns", [body["n"] for body in bodies]),
            Column("displacement", [body["displacement_max"] for body in bodies], self.length),
            Column("von Mises", [body["von_mises_max"] for body in bodies], self.stress),
            *(Column(f"reaction {x}", [each[k] for each in reactions], self.force) for k, x in enumerate("xy")),
            Column("strain energy", [body["energy"] for body in bodies], self.energy),
            Column("held by", ["clamps" if body["held"] else "clamps and contacts" if name in clamped else "contacts"
                               for name, body in self.bodies.items()])))

    @property
    def _has_steps(self) -> bool:
        return self.scene.get("time") is not None

    def _steps(self) -> Html | None:
        """The load steps, condensed where there are many, and the balance of energy."""
        if not self._has_steps:
            return None
        every = self.summary["steps"]
        if not every:
            return section("steps", "Load steps", element("p", "No load step was completed."))
        steps = every
        if len(every) > MOST_STEPS:
            steps = _some([step for step in every if step["time"] in self.scene["time"]["points"]] or every)
        if len(self.contacts) <= FEW:
            rows = [(step, name, contact) for step in steps for name, contact in step["contacts"].items()]
            contacts = [contact for *_, contact in rows]
            caption, columns = "Forces on the first body", self._resultants(contacts) + self._states(contacts)
            if len(self.contacts) > 1:
                columns.insert(0, Column("contact", [name for _, name, _ in rows]))
        else:
            rows = [(step, "all", {key: sum(contact[key] or 0 for contact in step["contacts"].values())
                                   for key in ("open", "slip", "stick", "dissipated")}) for step in steps]
            caption, columns = "Nodes of all contacts", self._states([total for *_, total in rows])
        caption += f"; {len(steps)} of {len(every)} steps, steps.csv has all" * (len(steps) < len(every))
        inside = [element("p", f"{len(every)} load steps to time {every[-1]['time']:g}. Friction has a memory: a step "
                          "starts from the slip of the one before."), table(
            caption, Column("time", [f"{step['time']:g}" for step, *_ in rows]),
            Column("iterations", [step["outer_iterations"] for step, *_ in rows]), *columns)]
        energy = self.summary.get("energy")
        if energy:
            inside += [table("Energy since time 0: the first is the sum of the next two",
                             Column("what", list(ENERGIES.values())),
                             Column("energy", [energy[key] for key in ENERGIES], self.energy)),
                       element("p", f"No step's balance misses by more than {number(energy['residual'], 2)} of the "
                               "largest of these energies.")]
        return section("steps", "Load steps", *inside)

    def _certificate(self) -> Html:
        summary, limit = self.summary, self.summary["certificate_limit"]
        of_contacts = {kind: {name: each["certificate"][kind] for name, each in self.contacts.items()}
                       for kind in RESIDUALS if kind != "equilibrium"}
        worst = of_contacts | {"equilibrium": {name: each["certificate"]["equilibrium"]
                                               for name, each in self.bodies.items()}}
        kinds = {kind: value for kind, value in summary["certificate"].items() if kind in RESIDUALS}
        verdicts = [element("span", "fails", kind="fails") if self._fails(value) else "holds"
                    for value in kinds.values()]
        columns = [Column(RESIDUALS[kind][0], list(values.values())) for kind, values in of_contacts.items()]
        shares = [None if (share := body["discretization_error"]) is None else 100 * share
                  for body in self.bodies.values()]
        return section("certificate", "Certificate", element(
            "p", "Residuals of the coupled problem, computed afresh from the final forces and displacements, without "
            f"units. All must lie below {limit:.2g}. They say how well the discrete problem is solved, not how good "
            "the mesh is."), table(
                f"The worst of all contacts{', bodies and load steps' if self._has_steps else ' and bodies'}",
                Column("residual", [RESIDUALS[kind][0] for kind in kinds]), Column("value", list(kinds.values())),
                Column("verdict", verdicts), Column("worst of", [_worst(worst[kind]) for kind in kinds]),
                Column("what it is", [element("div", RESIDUALS[kind][1], kind="words") for kind in kinds]), digits=2),
            "" if len(self.contacts) < 2 else folded_if_long("By contact", len(self.contacts), table(
                "By contact", Column("contact", list(self.contacts)), *columns, digits=2)),
            folded_if_long("By body", len(self.bodies), table(
                "By body, with its part of the estimated discretization error", Column("body", list(self.bodies)),
                Column("equilibrium", list(worst["equilibrium"].values())), Column("estimated error", shares, "%"),
                digits=2)))

    def _error(self) -> Html:
        error = self.summary["discretization_error"]
        target, levels = error.get("target"), error.get("levels") or []
        inside: list[Any] = [element(
            "p", f"The mesh is off by about {percent(self._estimate)} of the energy norm" +
            (f"; {percent(target)} was asked for. " if target else ". ") + "This is an estimate, by patch recovery of "
            "the stress, and no bound: it has been found too small by a fifth with linear elements, by a tenth with "
            "quadratic ones.")
            if self._estimate is not None else element("p", f"There is no estimate{self.at or ' for this run'}.")]
        if len(levels) > 1:
            inside.append(table("The meshes on the way", Column("mesh", [f"{k}" for k in range(1, len(levels) + 1)]),
                                Column("refinement", [level["refinement"] for level in levels]),
                                Column("unknowns", [level["n"] for level in levels]),
                                Column("estimated error", [percent(level["error"]) for level in levels])))
        return section("error", "Estimated discretization error", *inside)

    def _work(self) -> Html:
        """Times, memory, messages, and how each body was solved with."""
        summary, seconds, exchange = self.summary, self.summary["seconds"], self.summary.get("exchange", {})
        bodies = list(self.bodies.values())
        method = {"newton": "semi-smooth Newton", "anderson": "Anderson acceleration of the published iteration",
                  "relaxation": f"published iteration, {summary.get('algorithm')} algorithm, splitting "
                  f"{summary.get('splitting')}"}
        lines = [("method", f"{method[summary['outer']]}, to {self.scene['method']['tolerance']:g}"),
                 ("iterations", f"{summary['outer_iterations']} outer, {summary['inner_iterations']} inner"),
                 ("solves", f"{summary['n_A']} with the stiffness of a body (n_A)"),
                 ("memory", f"at most {max(body['memory_mib'] for body in bodies):.0f} MiB on a rank"),
                 ("messages", f"at most {exchange.get('messages', 0)} with {exchange.get('bytes', 0) / 1024:.1f} KiB "
                  f"from a rank, {exchange.get('reductions', 0)} reductions")]
        path = self.folder / "convergence.png"
        inside = [picture(path, "The outer iteration.", "Update and residual over the outer iterations", "small")
                  ] if path.exists() else []
        if seconds:
            inside.append(table("Time of the slowest rank", Column("phase", list(seconds)),
                                Column("time", list(seconds.values()), "s", decimals=2),
                                Column("what it is", [PHASES.get(name, "") for name in seconds])))
        return section("work", "Work", pairs(lines), *inside, folded_if_long("By body", len(bodies), table(
            "By body", Column("body", list(self.bodies)), Column("ranks", [_ranks(body["ranks"]) for body in bodies]),
            Column("solves", [body["n_A"] for body in bodies]), Column("solver", [body["solver"] for body in bodies]),
            Column("compliance", [body["compliance"] for body in bodies]),
            Column("memory", [round(body["memory_mib"]) for body in bodies], "MiB"))))

    def _provenance(self) -> Html:
        summary = self.summary
        job = ", ".join(f"{name.replace('_', ' ')} {value}" for name, value in summary.get("slurm", {}).items())
        versions = ", ".join(f"{name} {value}" for name, value in summary.get("versions", {}).items())
        options = [f"-{name} {value}".strip() for name, value in summary.get("options", {}).items()]
        lines = [("run", summary.get("run", "unknown")), ("command", code(summary.get("command", "unknown"))),
                 ("in", code(summary.get("working_folder", "unknown"))),
                 ("hosts", ", ".join(dict.fromkeys(summary.get("hosts", []))) or "unknown"), ("batch job", job),
                 ("versions", versions or "unknown"), ("PETSc options", code(" ".join(options)) if options else "none"),
                 ("report", f"by ddmpi {__version__}")]
        return section("run", "Which run it was", pairs(line for line in lines if line[1]))


def _counts(contacts: Mapping[str, dict]) -> tuple[int, str]:
    """The number of contact nodes, and how many of them are open, slip and stick."""
    counts = {status: sum(contact[status] for contact in contacts.values()) for status in ("open", "slip", "stick")}
    return sum(contact["m"] for contact in contacts.values()), ", ".join(f"{k} {name}" for name, k in counts.items())


def _law(contact: dict) -> str:
    """What holds in a contact of the scene: bonded, or its friction law with the number, if it is one."""
    if contact.get("kind") == "bonded":
        return "bonded"
    law, *numbers = contact["friction"].values()
    if not numbers:
        return {"none": "no friction"}.get(law, law)
    return law.capitalize() + (f" {numbers[0]:g}" if isinstance(numbers[0], int | float) else ", varying")


def _worst(values: Mapping[str, float | None]) -> Html | str:
    """The name with the largest value, or with one that is no number; a dash where all are zero."""
    sizes = {name: math.inf if value is None else value for name, value in values.items()}
    name = max(sizes, key=lambda name: sizes[name], default="")
    return element("span", name, kind="name") if name and sizes[name] else "–"


def _ranks(ranks: Sequence[int]) -> str:
    return f"{ranks[0]} to {ranks[-1]}" if len(ranks) > FEW else ", ".join(map(str, ranks))


def _some(steps: list[dict]) -> list[dict]:
    """At most MOST_STEPS of the steps, evenly chosen from the first to the last."""
    return [steps[k] for k in sorted({round(k * (len(steps) - 1) / (MOST_STEPS - 1)) for k in range(MOST_STEPS)})]
