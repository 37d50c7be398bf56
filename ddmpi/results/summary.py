"""summary.json: everything about a run that is not an array, by the names of bodies and contacts."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from ddmpi.interface.state import ContactState
from ddmpi.results.tables import FORMAT, writing

BY_CONTACT = ("force_mismatch", "penetration", "complementarity", "friction")
"""The residuals that a certificate has for each contact."""


@dataclass(frozen=True, kw_only=True)
class BodyResult:
    """What the summary says of one body.

    Attributes
    ----------
    n : degrees of freedom that no clamp holds
    ranks : that the body lives on
    held : whether its clamps alone prevent every rigid motion
    displacement_max : largest displacement (m)
    von_mises_max : largest von Mises stress (Pa); None if stresses were not computed
    energy : strain energy (J per metre of depth)
    reaction : resultant of the forces of its clamps (N per metre of depth)
    discretization_error : its part of the estimated error, relative to the energy norm of all bodies; nan where
        there is none
    equilibrium : relative residual of its equilibrium
    n_A_by_purpose : multiplications by A⁻¹
    inner_steps : steps of its quadratic subproblems, by kind
    solver, compliance : how A is solved with and how C is applied
    memory_mib : the most memory that its ranks have held
    """

    name: str
    n: int
    ranks: Sequence[int]
    held: bool
    displacement_max: float
    von_mises_max: float | None
    energy: float
    reaction: Sequence[float]
    discretization_error: float
    equilibrium: float
    n_A_by_purpose: dict[str, int]
    inner_steps: dict[str, int]
    solver: str
    compliance: str
    memory_mib: float

    @property
    def n_A(self) -> int:
        """Multiplications by A⁻¹ for all purposes."""
        return sum(self.n_A_by_purpose.values())


@dataclass(frozen=True)
class ContactResult:
    """What the summary says of one contact.

    Attributes
    ----------
    state : the last one
    certificate : its residuals, named as in BY_CONTACT
    total : frictional work of all load steps (J per metre of depth); None where there is one
    """

    state: ContactState
    certificate: dict[str, float]
    total: float | None = None

    @property
    def dissipated(self) -> float:
        """Frictional work of all load steps (J per metre of depth)."""
        return self.state.dissipated if self.total is None else self.total

    def step(self) -> dict:
        """Resultants, numbers of nodes and dissipation of the load step."""
        state = self.state
        return {"force": state.force, "moment": state.moment, "normal_force": state.normal_force.sum(),
                "tangential_force": state.tangential_force.sum(),
                **{status: state.count(status) for status in ("open", "slip", "stick")},
                "dissipated": state.dissipated}


@dataclass(frozen=True, kw_only=True)
class RunResult:
    """What the summary says of the run as a whole.

    Attributes
    ----------
    order : of the elements
    ranks : their number
    inner_iterations : of all inner solves, GMRES or quadratic subproblems
    certificate_limit : the largest residual of a certified answer
    energy_norm : estimated discretization error, relative to the energy norm of all bodies; nan where there is none
    levels : for each mesh that was solved on, its refinement, unknowns and error
    exchange : the most that a rank has sent: messages and bytes of interface vectors to its neighbours; reductions over
        all ranks, of flags, scalars and coarse problems, and reduced_bytes, what it gave to them; without PETSc's own
        in Krylov methods
    qp : TAO type of the quadratic subproblems, or "none"
    undetermined : rigid motions that no contact resists, in words
    steps : what is said of each load step, and energy : of the balance of energy; None where there is one step
    """

    converged: bool
    reason: str
    order: int
    ranks: int
    outer_iterations: int
    inner_iterations: int
    certificate_limit: float
    energy_norm: float
    levels: Sequence[dict]
    exchange: dict
    qp: str
    options: dict[str, str]
    options_unused: Sequence[str]
    warnings: Sequence[str] = ()
    undetermined: Sequence[str] = ()
    steps: Sequence[dict] | None = None
    energy: dict[str, float] | None = None


def summarize(scene: dict, run: RunResult, bodies: Sequence[BodyResult], contacts: Sequence[ContactResult]) -> dict:
    """The content of summary.json but for provenance and times, as plain data. Not collective.

    Numbers that are not finite become None, JSON's null. Residuals of the certificate at the top are the worst of
    all contacts and bodies.

    Parameters
    ----------
    scene : resolved
    bodies, contacts : in the order of the scene
    """
    method = scene["method"]
    by_contact = {contact.state.interface.name: contact for contact in contacts}
    interfaces = [contact.state.interface for contact in contacts]
    n_A, m = sum(body.n_A for body in bodies), sum(interface.m for interface in interfaces)
    summary: dict = _plain({
        "format": FORMAT, "title": scene["title"], "converged": run.converged, "reason": run.reason,
        "outer": method["outer"], "algorithm": method.get("algorithm") or method["outer"],
        "splitting": method.get("splitting") or "none",
        "friction": ", ".join(dict.fromkeys(interface.law.name for interface in interfaces)),
        "order": run.order, "n": sum(body.n for body in bodies), "m": m, "ranks": run.ranks,
        "outer_iterations": run.outer_iterations, "inner_iterations": run.inner_iterations, "n_A": n_A,
        "eff": n_A / (2 * m) if m else None,
        "bodies": {body.name: _body(body) for body in bodies},
        "contacts": {name: _contact(contact) for name, contact in by_contact.items()},
        "certificate": {
            **{name: _worst([contact.certificate[name] for contact in contacts]) for name in BY_CONTACT},
            "equilibrium": _worst([body.equilibrium for body in bodies])},
        "certificate_limit": run.certificate_limit,
        "steps": run.steps if run.steps is not None else [
                  {"time": 1.0, "outer_iterations": run.outer_iterations,
                   "contacts": {name: contact.step() for name, contact in by_contact.items()}}],
        **({} if run.energy is None else {"energy": run.energy}),
        "discretization_error": {"energy_norm": run.energy_norm, "target": method.get("target_error"),
                                 "levels": run.levels},
        "displacement_max": _worst([body.displacement_max for body in bodies]), "units": _units(scene["output"]),
        "warnings": run.warnings, "undetermined": run.undetermined,
        "seconds": {}, "exchange": run.exchange, "solvers": {"qp": run.qp},
        "options": run.options, "options_unused": run.options_unused, "scene": scene})
    return summary


def write_summary(path: Path, summary: dict) -> None:
    """Write summary.json into the folder `path`. Not collective. Raises OutputError."""
    text = json.dumps(summary, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
    with writing(path / "summary.json"):
        (path / "summary.json").write_text(text, encoding="utf-8")


def _units(output: dict) -> dict[str, str]:
    """The units of all lengths, stresses and forces; forces are per unit of depth, stress times length."""
    length, stress = output["length_unit"], output["stress_unit"]
    product = f"{stress}·{length}"
    return {"length": length, "stress": stress, "force": {"Pa·m": "N/m", "MPa·mm": "N/mm"}.get(product, product)}


def _body(body: BodyResult) -> dict:
    entry = {"n": body.n, "ranks": body.ranks, "n_A": body.n_A} | vars(body)
    del entry["name"]
    return entry | {"certificate": {"equilibrium": entry.pop("equilibrium")}}


def _contact(contact: ContactResult) -> dict:
    state = contact.state
    slave, (imbalance, bound) = state.interface.slave, state.moment_imbalance
    return {"m": state.interface.m, "pairing": "mortar" if slave else "nodes", "slave": slave,
            "friction": state.interface.law.name, **contact.step(), "dissipated": contact.dissipated,
            "pressure_max": state.pressure.max(),
            "certificate": contact.certificate, "pointwise_penetration": state.deepest, "moment_imbalance": imbalance,
            "moment_imbalance_bound": bound}


def _worst(values: Sequence[float]) -> float:
    """The largest value, or the one that is not a number; zero of none."""
    return float(np.max(values)) if len(values) else 0.0


def _plain(value: Any) -> Any:
    """The value as JSON has it: lists for arrays, None for numbers that are not finite."""
    if isinstance(value, dict):
        return {key: _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple | np.ndarray):
        return [_plain(entry) for entry in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value
