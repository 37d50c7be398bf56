"""summary.json: everything about a run that is not an array, by the names of bodies and contacts."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import msgspec
import numpy as np

from ddmpi.interface.state import ContactTotals
from ddmpi.judge.certificate import Certificate, ContactResiduals
from ddmpi.judge.equilibrium import Mechanism, describe
from ddmpi.results.tables import FORMAT, STATUS
from ddmpi.scene.contacts import Rigid
from ddmpi.scene.method import Cycle, units
from ddmpi.system.files import MECHANISM, writing
from ddmpi.system.numbers import RigidMotion, moment

PRECISION = 1e-8
"""Components of a force below this fraction of it are told as zero: they are errors of rounding and iterations."""


class Row(str):
    """The meaning of an entry that the log and the report have as well.

    Attributes
    ----------
    words : the entry's name there
    quantity : of its unit, a key of `units`, "angle" or "%"; empty for counts and names
    """

    words: str
    quantity: str

    def __new__(cls, words: str, quantity: str = "", meaning: str | None = None) -> Row:
        row = super().__new__(cls, words if meaning is None else meaning)
        row.words, row.quantity = words, quantity
        return row


RESIDUALS = {
    "force_mismatch": "difference of the contact forces of the two bodies, over the forces",
    "penetration": "the largest overlap at the nodes, or opening where bonded or guided, over the size of the contact "
                   "displacements",
    "complementarity": "force across open nodes, and tension",
    "friction": "distance of tangential forces from the friction law, over the largest force",
    "equilibrium": "imbalance of the forces in a body, over its loads"}
"""What each residual of the certificate means."""

SUMMARY = {
    "format": "version of the layout of all files; names and meanings of one format stay, entries may be added",
    "title": "the scene's",
    "converged": "whether there is a certified answer, and the accuracy target, if any, is met",
    "reason": "how the run ended, in words",
    "outer": "the method's", "algorithm": "the method's", "splitting": "the method's",
    "friction": "the laws of all contacts",
    "order": "of the elements",
    "n": "unknowns of all bodies: degrees of freedom that no clamp constrains",
    "m": "contact nodes",
    "ranks": "their number",
    "outer_iterations": "of all load steps",
    "inner_iterations": "of GMRES, or of the QPs of the published iteration",
    "n_A": "multiplications by A⁻¹ of all bodies",
    "eff": "n_A / (2 m)",
    "bodies.NAME.n": Row("unknowns", "", "its unknowns"),
    "bodies.NAME.ranks": "that it lives on",
    "bodies.NAME.n_A": Row("solves", "", "multiplications by A⁻¹"),
    "bodies.NAME.held": "whether its clamps and foundations alone prevent every rigid motion",
    "bodies.NAME.displacement_max": Row("largest displacement", "length"),
    "bodies.NAME.von_mises_max": Row("von Mises stress", "stress", "largest von Mises stress; null if stresses were "
        "not asked for, and with output.only"),
    "bodies.NAME.energy": Row("strain energy", "energy", "strain energy, without that of foundations; null with "
        "output.only"),
    "bodies.NAME.reaction": Row("reaction", "force", "[x, y], in space [x, y, z]: resultant of the forces of its "
        "clamps and foundations; around an axis, as all forces, [radial sum, axial force] of the whole circumference"),
    "bodies.NAME.loads.GROUP.force": Row("force", "force", "[x, y], in space [x, y, z]: resultant of the tractions on "
        "a boundary group; that of the volume force is under the name volume_force"),
    "bodies.NAME.loads.GROUP.moment": Row("moment", "moment", "x F_y − y F_x of the same forces, in space [x, y, z], "
        "about the origin"),
    "bodies.NAME.reactions.GROUP.force": "resultant of the forces of clamps and foundations on a group. Where groups "
        "share nodes, the force on a node is split along the clamped directions; each counts for one clamp, the last "
        "one in the scene that constrains it; all reactions together are reaction",
    "bodies.NAME.reactions.GROUP.moment": "of the same forces about the origin",
    "bodies.NAME.discretization_error": Row("estimated error", "%", "its part of the estimated error, relative to the "
        "energy norm of all bodies"),
    "bodies.NAME.n_A_by_purpose": "n_A by what the multiplications were for",
    "bodies.NAME.inner_steps": "steps of inner solvers, by kind",
    "bodies.NAME.solver": Row("solver", "", "how systems with A are solved"),
    "bodies.NAME.compliance": Row("compliance", "", "how C = B A⁻¹ Bᵀ is applied: explicit, direct or iterative"),
    "bodies.NAME.memory_mib": "the largest memory of its ranks, MiB",
    "bodies.NAME.certificate.equilibrium": Row("equilibrium", "", RESIDUALS["equilibrium"]),
    "contacts.NAME.m": Row("nodes", "", "its nodes"),
    "contacts.NAME.pairing": "nodes or mortar",
    "contacts.NAME.slave": "the body whose nodes carry the forces; null with pairing by nodes",
    "contacts.NAME.friction": "its law",
    "contacts.NAME.force": Row("force", "force", "[x, y], in space [x, y, z]: resultant on the first body, −Σ "
        "(normal_force · n + tangential_force · t)"),
    "contacts.NAME.moment": Row("moment", "moment", "x F_y − y F_x of the same forces, in space [x, y, z], about the "
        "origin, on the first body's nodes. That of the lines of contact_NAME.csv is the same; where the second body "
        "is the slave it differs by moment_imbalance. Around an axis all moments are 0"),
    "contacts.NAME.normal_force": Row("normal force", "force", "sum over the nodes"),
    "contacts.NAME.tangential_force": Row("tangential force", "force", "sum over the nodes; in space the length of the "
        "sum of their vectors"),
    "contacts.NAME.open": Row("open", "", "number of open nodes"),
    "contacts.NAME.slip": Row("slip", "", "number of slipping nodes"),
    "contacts.NAME.stick": Row("stick", "", "number of sticking nodes"),
    "contacts.NAME.dissipated": Row("dissipated", "energy", "frictional work of all load steps"),
    "contacts.NAME.pretension.force": "of a bond with a pretension: the force on the first body along its direction",
    "contacts.NAME.pretension.offset": "by how much the first side is pulled along it, past the second",
    "contacts.NAME.pressure_max": Row("largest pressure", "stress", "largest normal stress of a node"),
    **{f"contacts.NAME.certificate.{kind}": Row(kind.replace("_", " "), "", RESIDUALS[kind])
       for kind in ContactResiduals._fields},
    "contacts.NAME.pointwise_penetration": Row("penetration between nodes up to", "length", "largest overlap at any "
        "point, also between the nodes; warned of"),
    "contacts.NAME.moment_imbalance": Row("moment imbalance", "moment", "where nodes do not match: by how much the "
        "moments of the two bodies' forces differ, because they act on different nodes; without a limit"),
    "contacts.NAME.moment_imbalance_bound": Row("bound", "moment", "the bound on it"),
    "rigid.NAME.displacement": Row("displacement", "length", "[x, y], in space [x, y, z]: of a rigid partner that "
        "bodies may touch"),
    "rigid.NAME.force": Row("force of bodies", "force", "resultant of the bodies' forces on it; where it is pushed, "
        "against the force that pushes it"),
    "rigid.NAME.turn": Row("turn", "angle", "of a partner that turns: its turn about the pivot (rad), in space [x, y, "
        "z]; displacement is that of the pivot"),
    "rigid.NAME.moment": Row("moment of bodies", "moment", "of a partner that turns: of the same forces about the "
        "pivot, against the moment that turns it"),
    "certificate.force_mismatch": "the worst of all contacts and load steps; so are the next three",
    "certificate.penetration": "", "certificate.complementarity": "", "certificate.friction": "",
    "certificate.equilibrium": "the worst of all bodies, pushed partners and load steps",
    "certificate_limit": "the largest residual of a certified answer: 50 times the tolerance, but at most 0.05",
    "steps": "load steps in the order of time: time, outer_iterations, and contacts by name with force, moment, "
        "normal_force, tangential_force, open, slip, stick and dissipated, of the step, pretension and rigid as above; "
        "with free frames passes, in which they settled; "
        "of cycles those of the last one; in summary.json, where the fields of the step are written, bodies with "
        "reaction, loads and reactions",
    "cycles.run": "with [time] cycle: cycles run, one that failed included",
    "cycles.change": "change of the forces over the last cycle that has ended, over the largest force of a node; null "
        "if there is none",
    "derivatives.KEY.until": "with output.derivatives, for the derivatives by a number KEY, or by a factor on the load "
        "or motion KEY: [from, to] between which no node changes its status, by a linear forecast; null where none is "
        "foreseen. All of KEY is null, with a warning, where the derivatives are not precise",
    "derivatives.KEY.contacts.NAME": "derivatives of force, moment, normal_force, tangential_force, pressure_max and "
        "dissipated, in the unit of the result over that of the number. With load steps those at the end; steps has "
        "those at the ends of legs, in derivatives",
    "derivatives.KEY.bodies.NAME": "of reaction, and of the displacements at physical points of the mesh, in points",
    "derivatives.KEY.rigid.NAME": "of displacement and force",
    "energy.external_work": Row("work of loads, clamps and rigid partners", "energy", "with load steps: the last line "
        "of energy.csv; so are the next three"),
    "energy.strain_energy": Row("strain energy", "energy", ""),
    "energy.interface_work": Row("work of the contact forces", "energy", ""),
    "energy.dissipated": Row("of it dissipated by friction", "energy", ""),
    "energy.lost": Row("of it taken by interference, closing gaps and time stepping", "energy", "interface work less "
        "dissipation: what interference, closing gaps and time stepping take"),
    "energy.residual": "the largest residual of a step over the largest energy",
    "discretization_error.energy_norm": "estimated, relative to the energy norm of all bodies; null where there is no "
        "estimate",
    "discretization_error.target": "method.target_error",
    "discretization_error.levels": "for each mesh that was solved on: refinement, unknowns n, estimated error, and "
        "dofs, clamped ones included",
    "displacement_max": "largest displacement of all bodies",
    "units": "labels of lengths, stresses, forces, moments and energies; in the plane the last three are per unit of "
        "depth",
    "warnings": "each once, in words",
    "undetermined": "rigid motions that no contact resists, in words",
    "seconds": "by phase, of the slowest rank",
    "exchange": "the most that a rank has sent: messages and bytes of interface vectors to its neighbours; reductions "
        "over all ranks, of flags, scalars and coarse problems, and reduced_bytes, its contribution to them; without "
        "those of PETSc in Krylov methods",
    "reused": "what of each body and contact earlier cases of a sweep or a prepared model have left: mesh, stiffness, "
        "factors, compliance; rows; empty in a run by itself",
    "solvers": "qp: TAO type of the quadratic subproblems, or none; in space those with friction have discs, and "
        "python (APG) solves them whatever it is",
    "options": "PETSc's",
    "options_unused": "those that nothing has used",
    "scene": "with every default filled in",
    "run": "its name: start, host, process, batch job",
    "started": "UTC",
    "command": "command line",
    "working_folder": "where it was given",
    "slurm": "the batch job as Slurm describes it",
    "hosts": "of all ranks",
    "versions": "of the software that a result depends on"}
"""What each entry of summary.json means, by its dotted name; NAME is that of a body or contact.
docs/reference/results.md shows this."""


def tell(summary: Mapping[str, Any], table: str, name: str, key: str, digits: int = 4) -> str:
    """An entry of a body, contact or rigid partner in words: "3 open", "largest pressure 64.42 MPa", "force (3, −4) N".
    """
    row, value = SUMMARY[f"{table}.NAME.{key}"], summary[table][name][key]
    assert isinstance(row, Row)
    if not row.quantity:
        return f"{value} {row.words}"
    unit = "rad" if row.quantity == "angle" else summary["units"][row.quantity]
    if not isinstance(value, list):
        return f"{row.words} {as_float(value):.{digits}g} {unit}"
    components = np.array([as_float(component) for component in value])
    components[np.abs(components) < PRECISION * np.linalg.norm(components)] = 0.0
    return f"{row.words} ({', '.join(f'{component:.{digits}g}' for component in components)}) {unit}"


def count(contacts: Iterable[Mapping[str, Any]]) -> str:
    """The nodes of some contacts by their status, in words: "3 open, 4 slip, 3 stick"."""
    contacts = list(contacts)
    return ", ".join(f"{sum(contact[status] for contact in contacts)} {status}" for status in STATUS)


def largest(entries: Mapping[str, Mapping], key: str) -> tuple[float | None, str]:
    """The largest value of the `entries`, and its name; None, and the first name, if all are None."""
    name = max(entries, default="", key=lambda name: -math.inf if entries[name][key] is None else entries[name][key])
    return entries[name][key] if name else None, name


def as_float(value: float | None) -> float:
    """A number of a summary, NaN for None."""
    return math.nan if value is None else value


def summarize(scene: dict, run: Mapping[str, Any], bodies: Mapping[str, dict], contacts: Mapping[str, ContactTotals],
              certificate: Certificate) -> dict:
    """The content of summary.json but for provenance and times, as plain data. Not collective.

    Numbers that are not finite become None, JSON's null.

    Parameters
    ----------
    scene : resolved
    run : the entries in SUMMARY that do not follow from the others
    bodies : by name, in the order of the scene, the entries in SUMMARY but for certificate and n_A, which are added
    contacts : at the end by name, in the order of the scene
    """
    dimension = len(next(iter(bodies.values()))["reaction"])
    method = scene["method"]
    entries = {name: body | {"n_A": sum(body["n_A_by_purpose"].values()),
                             "certificate": {"equilibrium": certificate.equilibrium[name]}}
               for name, body in bodies.items()}
    n_A, m = sum(entry["n_A"] for entry in entries.values()), sum(contact.m for contact in contacts.values())
    summary = plain({
        "format": FORMAT, "title": scene["title"],
        "outer": method["outer"], "algorithm": method.get("algorithm") or method["outer"],
        "splitting": method.get("splitting") or "none",
        "friction": ", ".join(dict.fromkeys(contact.law for contact in contacts.values())),
        "n": sum(body["n"] for body in bodies.values()), "m": m, "n_A": n_A,
        "eff": n_A / (2 * m) if m else None, "bodies": entries,
        "contacts": {name: _contact(contact) | {
            "certificate": certificate.contacts[name]._asdict(),
            "dissipated": np.sum(np.array([step["contacts"][name]["dissipated"] for step in run["steps"]], float))}
            for name, contact in contacts.items()},
        "rigid": rigid_partners(contacts.values()),
        "certificate": {kind: value for kind, (value, _) in certificate.worst().items()},
        "displacement_max": np.max([body["displacement_max"] for body in bodies.values()]),
        "units": units(scene, dimension), "seconds": {}, "scene": scene, **run})
    return {name: summary[name] for name in dict.fromkeys(key.partition(".")[0] for key in SUMMARY) if name in summary}


def rigid_partners(contacts: Iterable[ContactTotals]) -> dict[str, dict[str, np.ndarray]]:
    """Displacement (m) and force (N) (d,) of each rigid partner that bodies may touch, by its name; of one that turns
    also its turn (rad) and the moment about its pivot (N m)."""
    partners: dict[str, dict[str, np.ndarray]] = {}
    for contact in contacts:
        if contact.rigid is not None:
            moved, turn, pivot = contact.rigid
            entry = partners.setdefault(contact.bodies[1], {"displacement": moved, "force": np.zeros(len(moved))})
            entry["force"] = entry["force"] - contact.force
            if len(turn):
                about = moment(np.atleast_2d(pivot), contact.force[None])
                entry["turn"] = turn if len(turn) > 1 else turn[0]
                entry["moment"] = entry.get("moment", 0.0) - contact.moment + about
    return partners


def drawn_times(summary: dict, times: Any) -> Any:
    """The times in the histories of the scene of the `times` of load steps, as cycles repeat some and delay others."""
    cycle = (summary["scene"].get("time") or {}).get("cycle")
    return msgspec.convert(cycle, Cycle).drawn(times, summary["cycles"]["run"]) if cycle else times


def factor_at(summary: dict, name: str | None, time: float | None) -> float:
    """The factor of the history `name` at `time`, by default at the last load step; 1 without a history."""
    history = summary["scene"].get("history", {}).get(name)
    if not history:
        return 1.0
    last = max([0.0, *(step["time"] for step in summary.get("steps", ()))])
    drawn = drawn_times(summary, last if time is None else time)
    return float(np.interp(drawn, history["times"], history["factors"]))


def motion_at(summary: dict, rigid: Rigid, time: float | None) -> RigidMotion:
    """The motion of a rigid partner at `time`, by default at the last load step."""
    still = np.array(rigid.displacement)
    if not rigid.yields:
        return RigidMotion(factor_at(summary, rigid.history, time) * still)
    at = {0.0: np.zeros(len(still) + rigid.turns_by)} | {
        step["time"]: np.append(*(step["rigid"][rigid.name].get(key, []) for key in ("displacement", "turn")))
        for step in summary.get("steps", ())}
    now = max(at) if time is None else time
    moved = np.array([np.interp(now, list(at), component) for component in zip(*at.values(), strict=True)])
    return RigidMotion(moved[:len(still)], moved[len(still):], np.array(rigid.pivot or still))


def write_summary(path: Path, summary: dict) -> None:
    """Write summary.json into the folder `path`. Not collective. Raises OutputError."""
    _write_json(path / "summary.json", summary)


def write_mechanism(path: Path, mechanism: Mechanism) -> None:
    """Write mechanism.json into the folder `path`: the loose bodies, their centres (m) and their velocities about them.

    A velocity is (v_x, v_y, ω), in space (v_x, v_y, v_z, ω_x, ω_y, ω_z), such that the fastest node has velocity 1.
    Not collective. Raises OutputError.
    """
    _write_json(path / MECHANISM, plain({
        "reason": describe(mechanism), "imbalance": mechanism.imbalance,
        "bodies": [{"name": body.name, "centre": body.centre, "velocity": velocity}
                   for body, velocity in zip(mechanism.bodies, mechanism.velocities, strict=True)]}))


def _write_json(path: Path, content: dict) -> None:
    with writing(path):
        path.write_text(json.dumps(content, indent=2, ensure_ascii=False, allow_nan=False) + "\n", encoding="utf-8",
                        errors="backslashreplace")  # names of folders may have bytes that are no text


def _contact(totals: ContactTotals) -> dict:
    imbalance, bound = totals.moment_imbalance
    return {"m": totals.m, "pairing": "mortar" if totals.slave else "nodes", "slave": totals.slave,
            "friction": totals.law, **plain(totals.resultants), "pressure_max": totals.pressure_max,
            "pointwise_penetration": totals.deepest, "moment_imbalance": imbalance, "moment_imbalance_bound": bound}


def plain(value: Any) -> Any:
    """The value as JSON has it: lists for arrays, None for numbers that are not finite."""
    if isinstance(value, dict):
        return {key: plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
