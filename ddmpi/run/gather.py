"""The record of a run: its load steps, its summary, gathered from all ranks, and its files."""

import itertools
import logging
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np
from mpi4py import MPI

from ddmpi.body.estimate import DiscretizationError, nodal_stress
from ddmpi.body.stress import stress, von_mises
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.coupling.far import Placement
from ddmpi.coupling.ranks import team_of
from ddmpi.errors import OutputError
from ddmpi.interface.state import ContactState, ContactTotals
from ddmpi.judge.accuracy import MeshLadder
from ddmpi.judge.bars import Bar, Measured
from ddmpi.judge.certificate import Certificate, ContactResiduals
from ddmpi.judge.edges import Edges
from ddmpi.petsc.events import event
from ddmpi.petsc.options import in_force, unused_options, unused_words
from ddmpi.pictures.browser import write_view
from ddmpi.results.checkpoint import Checkpoints
from ddmpi.results.converge import table_of
from ddmpi.results.fields import (
    Datasets,
    Fields,
    contact_fields,
    table_fields,
    write_fields,
)
from ddmpi.results.folder import Staging
from ddmpi.results.histories import write_frames
from ddmpi.results.summary import (
    PRECISION,
    plain,
    rigid_partners,
    summarize,
    whole_of,
    write_json,
    write_mechanism,
    write_summary,
)
from ddmpi.results.tables import (
    HISTORY,
    write_contact,
    write_energies,
    write_legs,
    write_sides,
    write_steps,
    write_table,
)
from ddmpi.results.xdmf import write_surface, write_xdmf
from ddmpi.run.recover import forces_by_group, recover
from ddmpi.run.report import describe_files
from ddmpi.run.solve import Solution
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agreed, gathered
from ddmpi.system.clock import Clock
from ddmpi.system.doubts import Doubt, as_doubt
from ddmpi.system.files import contact_files
from ddmpi.system.numbers import place_of_largest
from ddmpi.system.provenance import has_matplotlib, peak_memory, provenance

log = logging.getLogger("ddmpi")

DRAWERS = 2  # most ranks that share the pictures; all are on one host, as files of another one may come late
COARSE = 0.05  # linear elements with a larger estimated error hear what quadratic ones would cost
LITTLE = 0.1  # frictional work is compared with at least this fraction of the largest energy
FREE = 1e-4  # balances are compared with at least this part of what heat and clamps could store

Leg = tuple[float, dict[str, tuple[ContactState, np.ndarray]]]
"""Time of a kept load step; by contact a state with its nodes, and `leg_values`."""

TABLES = (
    "steps",
    "energies",
    "iterations",
)  # tables of a `StepLog` with a row for each step or iteration


class StepLog:
    """The record of the load steps, in their order. Without [time] there is one.

    Attributes
    ----------
    steps : the entry of that name in the summary
    energies : the lines of energy.csv (J)
    iterations : the lines of history.csv: the load step, fields of `methods.outer.Step`, and numbers of nodes
    kept : of steps whose fields are written time, forces (size,), motions, and `leg_values` of the rank's contacts
    doubts : warnings of answers at the ends of legs before the last one, the first of each kind
    run, change, cycle : cycles begun; change of forces over the last, see `Cycle.until`; the present one, 0 outside
    most : the largest so far: residuals of contacts (nc, 4) and bodies (nb,), `Solution.sizes` (3,), `Solution.confined` (1,)
    derived : the derivatives at the end of the last leg, of results and of arrays, as of
        `ddmpi.derive.entries.entries_of`; and by key why there is none
    places : of bodies that move far, where they are at the end of each step, by time
    """

    def __init__(self) -> None:
        self.doubts, self.places = dict[str, Doubt](), dict[float, Placement]()
        self.derived: tuple[dict[str, Any], ...] = {}, {}, {}
        self.steps, self.energies, self.iterations, self.kept = (list[Any]() for _ in range(4))
        self.run, self.change = 0, math.nan
        self.cycle: int | None = None
        numbers = {"contacts": 1, "bodies": 1, "sizes": 3, "confined": 1}
        self.most = {name: np.zeros(number) for name, number in numbers.items()}

    def judge(self, certificate: Certificate) -> Certificate:
        """Note the residuals of a step; the largest ones so far."""
        contacts, bodies = certificate.contacts, certificate.equilibrium
        self._raise(contacts=[*contacts.values()], bodies=[*bodies.values()])
        residuals = [ContactResiduals(*row) for row in self.most["contacts"].tolist()]
        return Certificate(
            dict(zip(contacts, residuals, strict=True)),
            dict(zip(bodies, self.most["bodies"].tolist(), strict=True)),
        )

    def _raise(self, **values: np.ndarray | Sequence) -> None:
        self.most = self.most | {
            name: np.maximum(self.most[name], sizes) for name, sizes in values.items()
        }

    def note_step(self, time: float, solution: Solution) -> None:
        """Note the end of a step: its iterations and sizes, resultants, and where rigid partners are."""
        self.note_iterations(solution)
        self._raise(sizes=solution.sizes, confined=[solution.confined])
        self.note_contacts(time, len(solution.outer.history), solution.contacts)

    def note_iterations(self, solution: Solution) -> None:
        """Note the iterations of the next step."""
        for step, counts in zip(solution.outer.history, solution.statuses.counts, strict=True):
            self.iterations.append((len(self.steps) + 1, *step[:4], *counts, step.n_A))

    def note_contacts(
        self, time: float, iterations: int, contacts: Mapping[str, ContactTotals]
    ) -> None:
        """Note the resultants of a step, and where rigid partners are."""
        self.steps.append(
            plain(
                {
                    "time": time,
                    "outer_iterations": iterations,
                    "contacts": {name: contact.resultants for name, contact in contacts.items()},
                    "rigid": rigid_partners(contacts.values()),
                }
                | ({} if self.cycle is None else {"cycle": self.cycle})
            )
        )

    def begin_cycle(self, since: float) -> None:
        """Begin another cycle; fields are kept of the last one alone, and of steps before it began first, `since`."""
        self.run += 1
        self.kept = [row for row in self.kept if row[0] <= since]

    @property
    def told(self) -> list[dict]:
        """The steps in summary.json: of cycles those of the last one."""
        return [step for step in self.steps if step.get("cycle", 0) in (0, self.run)]

    def derive(
        self,
        entries: dict[str, Any],
        arrays: dict[str, Any],
        lost: dict[str, str],
        several: bool = True,
    ) -> None:
        """Note the derivatives at the end of the last step; it is that of a leg, if there are `several` steps."""
        self.derived = plain(entries), arrays, lost
        if several and entries:
            self.steps[-1]["derivatives"] = self.derived[0]

    def doubt(self, time: float, warnings: Sequence[str]) -> None:
        """Note the warnings of the answer at the end of a leg; of one kind about one thing, the first."""
        for doubt in map(as_doubt, warnings):
            self.doubts.setdefault(doubt.key, doubt.at_time(time))

    def doubts_beside(self, warnings: Sequence[str]) -> list[str]:
        """The doubts that are not among the `warnings` of the last step, by their kind and what they are about."""
        known = {as_doubt(warning).key for warning in warnings}
        return [doubt for kind, doubt in self.doubts.items() if kind not in known]

    def excess(self, since: dict[str, Any], given: float = 0.0) -> float:
        """By how much friction has dissipated more than the interface work in steps since a `state`, over all
        dissipation.

        The exact value is never positive; a positive one shows that steps are too coarse where slip begins, or a
        contact opens, within one. Another step, in which gaps close, cannot make up for it. The work `given` (J) of an
        overlap that acts at once, in the first step, does not count: no step divides it. Nor does more than friction
        dissipates in a step: this is of rows that change.
        """
        rows, k = np.array([np.zeros(6), *self.energies]), len(since["energies"])
        took, dissipated = np.diff(rows[k:, 3:5], axis=0).T
        size = max(rows[-1, 4], LITTLE * np.abs(rows[:, 1:4]).max())
        more = dissipated - took
        more[:1] += given
        return np.clip(more, 0.0, dissipated).sum() / size if size else 0.0

    def balance(self) -> dict[str, float]:
        """The entry ``energy`` of summary.json: the balance at the end; the worst residual over the largest energy."""
        # ΔW − ΔU − ΔI is rounding; interface work less dissipation goes to interference, closing gaps and errors of time
        # stepping
        rows = np.array(self.energies or np.zeros((1, 6)))
        _, external, strain, interface, dissipated, _ = rows[-1].tolist()
        # what heats and moves freely stores rounding of what it would store if it were held
        size = float(max(np.abs(rows[:, 1:4]).max(), FREE * self.most["confined"][0]))
        return {
            "external_work": external,
            "strain_energy": strain,
            "interface_work": interface,
            "dissipated": dissipated,
            "lost": interface - dissipated,
            "residual": float(np.abs(rows[:, 5]).max()) / size if size else 0.0,
        }

    def state(self) -> dict[str, Any]:
        return (
            {name: tuple(getattr(self, name)) for name in TABLES}
            | self.most
            | {
                "cycles": (self.run, self.change, self.cycle),
                "kept": {
                    str(k): list(column) for k, column in enumerate(zip(*self.kept, strict=True))
                },
                "doubts": tuple(doubt.parts for doubt in self.doubts.values()),
            }
        )

    def restore(self, state: dict[str, Any]) -> None:
        for name in TABLES:
            setattr(self, name, list(state[name]))
        self.kept = [
            (float(time), *row) for time, *row in zip(*state["kept"].values(), strict=True)
        ]
        self.run, self.change, self.cycle = state["cycles"]
        found = [Doubt.of_parts(*parts) for parts in state["doubts"]]
        self.doubts = {doubt.key: doubt for doubt in found}
        self.most = {name: state[name] for name in self.most}


@dataclass(frozen=True)
class Solved:
    """A solved scene on one mesh, as one rank has it; but for `steps`, at the last load step.

    Attributes
    ----------
    error : of the mesh in the energy norm, by body of this rank
    edges : where stresses at contacts are infinite; None without an answer
    fields : of this rank's bodies, by name
    errors, bars : of results, by name
    summary : on the first rank; empty on the others
    """

    assembly: Assembly
    solution: Solution
    steps: StepLog
    error: DiscretizationError
    edges: Edges | None
    fields: Mapping[str, Fields] = field(default_factory=dict)
    errors: Mapping[str, Measured] = field(default_factory=dict)
    bars: Mapping[str, Bar] = field(default_factory=dict)
    summary: dict = field(default_factory=dict)

    @property
    def scene(self) -> Settled:
        return self.assembly.scene

    @property
    def factors(self) -> dict[str | None, float]:
        """Of loads at the last load step, by history."""
        time = self.solution.time
        return self.scene.factors(1.0 if time is None else self.scene.drawn(time, self.steps.run))


def gather_summary(solved: Solved, started: float) -> dict:
    """summary.json without the times and what `conclude` puts there, on the first rank; nothing on the others. Collective.

    `started` is as for `provenance`.
    """
    assembly, solution, steps = solved.assembly, solved.solution, solved.steps
    world, scene = assembly.world, solved.scene
    team = team_of(world)
    memory, hosts = team.do("machine") if team else (peak_memory(), [MPI.Get_processor_name()])
    machine = {"ranks": team.ranks if team else [world.rank], "memory_mib": memory}
    mine = _bodies(solved, machine)
    reused = gathered(world, assembly.reused)
    inner = sum(solution.outer.inner_steps.values())
    of_ranks = world.gather((mine, set(unused_options()), inner, assembly.exchange.state(), hosts))
    quadratic = _quadratic_unknowns(solved)
    if of_ranks is None:
        return {}
    bodies_of_ranks, unused, inners, sent, named = zip(*of_ranks, strict=True)
    hosts, left = list(itertools.chain(*named)), sorted(set.intersection(*unused))
    numbered = sorted(itertools.chain(*bodies_of_ranks), key=lambda body: body[0])
    bodies = {name: entry for _, name, entry in numbered}
    run = {
        "converged": solution.certified,
        "reason": solution.reason,
        "order": scene.body[0].mesh.order,
        "ranks": len(hosts),
        "outer_iterations": len(steps.iterations),
        "inner_iterations": sum(inners) if scene.method.by_body else inners[0],
        "certificate_limit": solution.limit,
        "steps": steps.steps,
        "discretization_error": {
            "energy_norm": solved.error.relative,
            "quadratic_n": quadratic,
            "target": scene.method.target_error,
            "levels": [],
        },
        "warnings": unused_words(left),
        "undetermined": [],
        "held_motions": [motion.entry() for motion in solution.held],
        "exchange": {name: max(counts[name] for counts in sent) for name in sent[0]},
        "reused": {name: reused[name] for name in (*bodies, *solution.contacts) if name in reused},
        "solvers": {"qp": solution.outer.qp_type},
        "options": in_force(),
        "options_unused": left,
        **_of_steps(solved),
    }
    if scene.wheel:
        run["whole"] = whole_of(scene.wheel, scene.dimension, bodies, solution.contacts)
    summary = summarize(scene.resolved(), run, bodies, solution.contacts, solution.certificate)
    return summary | {"steps": steps.told} | provenance(started, hosts)


def conclude(solved: Solved, ladder: MeshLadder, warnings: list[str], free: list[str]) -> None:
    """Put into a summary what is known at the end: the meshes that led here, bars of results, the warnings of scene and
    answer, and motions that no contact resists. Not collective."""
    summary, solution, bars = solved.summary, solved.solution, solved.bars
    missed = solution.certified and ladder.missed
    summary["converged"] = solution.certified and not missed
    summary["reason"] = missed or solution.reason
    summary["warnings"] = [*warnings, *summary["warnings"]]
    summary["undetermined"] = free
    summary["discretization_error"]["levels"] = plain([level.told() for level in ladder.levels])
    if bars:
        summary["errors"] = {
            name: bar.told() | {"half": ladder.price(name, 0.5) if bar.bar else None}
            for name, bar in bars.items()
        }


def _of_steps(solved: Solved) -> dict[str, Any]:
    """The summary's entries of load steps, cycles and derivatives, as far as the scene has these."""
    scene, steps, entries = solved.scene, solved.steps, dict[str, Any]()
    if scene.time:
        entries["energy"] = steps.balance()
    if scene.output.derivatives:
        entries["derivatives"] = steps.derived[0] if solved.solution.certified else {}
    if scene.time and scene.time.cycle:
        entries["cycles"] = {"run": steps.run, "change": steps.change}
    return entries


def _bodies(solved: Solved, machine: dict[str, Any]) -> list[tuple[int, str, dict]]:
    """The number, the name and the summary's entry of each body of this rank, with what it takes of the `machine`. Not
    collective."""
    assembly, solution, entries = solved.assembly, solved.solution, []
    for body, s in zip(assembly.bodies, solution.outer.body_forces(), strict=True):
        u = solution.displacements[body.spec.name]
        forces = forces_by_group(body, u, s, solved.factors, assembly.frames)
        volume = {"volume": float(body.mesh.measures().sum())} if solved.scene.wheel else {}
        entry = _body(solved, body, u) | machine | forces | volume
        entries.append((body.number, body.spec.name, entry))
    return entries


def _quadratic_unknowns(solved: Solved) -> int | None:
    """About how many unknowns quadratic elements have on the same cells, where linear ones have a large error. Collective."""
    if not (solved.error.relative > COARSE and solved.scene.body[0].mesh.order == 1):
        return None
    assembly = solved.assembly
    return round(assembly.world.allreduce(sum(map(_with_middles, assembly.bodies))))


def _with_middles(body: Body) -> float:
    """The unknowns of a body with quadratic elements on its cells. Not collective."""
    mesh, d = body.mesh, body.mesh.dimension
    vertices = len(np.unique(mesh.corners))
    # Each inner facet has two cells. In space vertices − edges + facets − cells are 1, or nearly.
    facets = (len(mesh.cell.facets) * len(mesh.triangles) + len(mesh.boundary[0])) / 2
    edges = facets if d == 2 else vertices + facets - len(mesh.triangles)
    return body.member.elasticity.n * (vertices + edges) / vertices


def _body(solved: Solved, body: Body, u: np.ndarray) -> dict:
    """The summary's entry of a body of this rank, which moves by `u` (nv, d). Not collective."""
    member, name, error = body.member, body.spec.name, solved.error
    estimate = error.estimates.get(name)
    stress = solved.fields[name].von_mises if name in solved.fields else None
    moved, points, displacement = np.linalg.norm(u, axis=1), body.mesh.points, u
    if frame := solved.assembly.frames.get(name):
        points = frame.at(points + u)  # where the body is now
        displacement = points - body.mesh.points
    return {
        "n": member.elasticity.n,
        "held": member.elasticity.supported,
        "displacement_max": float(moved.max()),
        "displacement_max_at": place_of_largest(moved, points),
        "von_mises_max": None if stress is None else float(stress.max()),
        "von_mises_max_at": None
        if stress is None
        else place_of_largest(stress, points[body.mesh.corners].mean(axis=1)),
        "energy": estimate
        and estimate.energy / 2,  # by the stresses: rigid motions add no rounding
        "points": {
            point: {"displacement": displacement[nodes].mean(axis=0)}
            for point, nodes in body.mesh.vertices.items()
        },
        "discretization_error": error.by_body.get(name),
        "n_A_by_purpose": dict(member.C.count),
        "inner_steps": dict(solved.solution.outer.inner_steps),
        "solver": member.C.solver.description,
        "compliance": member.C.kind,
    }


def fields_of(
    assembly: Assembly, body: Body, u: np.ndarray, error: DiscretizationError | None = None
) -> Fields:
    """The fields of a body that moves by `u` (nv, 2), as far as they are asked for. Not collective."""
    mesh, output = body.mesh, assembly.scene.output
    density = error.density(body.spec.name) if error and output.error else None
    fields = Fields(mesh.points, mesh.triangles, u, error=density)
    if output.stress:
        heat = body.member.elasticity.acting.heated
        sigma = stress(mesh, body.material, u, heat)
        known = error and error.estimates[body.spec.name]
        nodal = known.stress if known else nodal_stress(mesh, body.material, u, heat)
        if known and not known.energy:  # strains are rounding
            sigma, nodal = 0.0 * sigma, 0.0 * nodal
        shear = von_mises(sigma)
        if shear.max() <= PRECISION * max(np.abs(sigma).max(), np.abs(nodal).max()):
            shear = 0.0 * shear  # under pure pressure
        fields = replace(fields, stress=sigma, von_mises=shear, nodal_stress=nodal)
    frame = assembly.frames.get(body.spec.name)
    return fields.placed(frame) if frame else fields


def write_files(
    solved: Solved, folder: Path | None, clock: Clock, figures: bool, checkpoints: Checkpoints
) -> None:
    """Write all result files, with output.only the tables and the summary; they appear together or not at all, and the
    checkpoint goes. Collective."""
    world, scene = solved.assembly.world, solved.scene
    staging = Staging(folder) if folder else None
    path = world.bcast(staging.path if staging else None)
    try:
        with clock.phase("output"):
            picture_error = _write_all(path, solved, figures, bool(staging))
        seconds = clock.largest(world)
        with agreed(world):
            if staging:
                write_summary(path, solved.summary | {"seconds": seconds})
                files = staging.publish(
                    name for contact in scene.contact for name in contact_files(contact.name)
                )
                names = describe_files([f.name for f in files])
                log.info("results in %s: %s (%.1f s in all)", folder, names, seconds["total"])
        checkpoints.remove()
        with agreed(world):
            if picture_error:
                raise picture_error
    finally:
        if staging:
            staging.discard()


def _write_all(path: Path, solved: Solved, figures: bool, first: bool) -> OutputError | None:
    """Write all files into the folder `path`, the tables of the whole run on the `first` rank; why pictures could not
    be drawn. Collective."""
    world, scene = solved.assembly.world, solved.scene
    shown = not scene.output.only
    viewed, drawn = shown and scene.output.view is True, shown and figures
    surfaces, spans = _write_last(path, solved) if shown else ({}, {})
    legs = _write_steps(path, solved)
    with agreed(world), event("WriteTables"):
        _write_contacts(path, solved, surfaces, legs)
        if first:
            if shown:
                _describe(path, solved, legs, spans)
            _write_tables(path, solved)
            if drawn or viewed:  # they show it
                write_summary(path, solved.summary)
    picture_error = _draw(path, solved) if drawn else None
    with agreed(world, asleep=True):
        if first and viewed and not solved.solution.mechanism:
            picture_error = _guarded(write_view, path) or picture_error
    return picture_error


def _write_last(path: Path, solved: Solved) -> tuple[dict[str, Datasets], dict]:
    """Write the fields of the last load step; those of the contacts of this rank, and the spans of `write_fields`.
    Collective."""
    assembly, states = solved.assembly, solved.solution.states
    surfaces: dict[str, Datasets] = {name: contact_fields(state) for name, state in states.items()}
    tables = {name: table_fields(state, assembly.scene.far) for name, state in states.items()}
    fields = {body.number: solved.fields[body.spec.name] for body in assembly.bodies}
    with event("WriteFields"):
        return surfaces, write_fields(path, fields, surfaces, assembly.world, tables=tables)


def _describe(
    path: Path, solved: Solved, legs: Sequence[Leg], spans: Mapping[int | str, np.ndarray]
) -> None:
    """Write result.xdmf, on the first rank. Not collective."""
    scene, last = solved.scene, solved.solution.time
    times = [time for time, _ in legs] or ([] if last is None else [last])
    bodies = {body.name: spans[number] for number, body in enumerate(scene.body)}
    write_xdmf(
        path, times, bodies, {contact.name: spans[contact.name] for contact in scene.contact}
    )


def _write_tables(path: Path, solved: Solved) -> None:
    """Write the tables of load steps and of meshes, and mechanism.json, on the first rank. Not collective."""
    scene, steps = solved.scene, solved.steps
    if scene.method.target:
        found = {"converged": solved.summary["converged"], "results": table_of(solved.summary)}
        write_json(path / "converge.json", found)
    write_table(path / "history.csv", HISTORY, steps.iterations)
    write_steps(path, steps.steps)
    if scene.time:
        write_energies(path, steps.energies, steps.steps)
    if (places := steps.places) and steps.steps:
        times = [step["time"] for step in steps.steps]
        write_frames(path, [(time, places[time].frames) for time in times])
    if solved.solution.mechanism:
        write_mechanism(path, solved.solution.mechanism)


def _draw(path: Path, solved: Solved) -> OutputError | None:
    """Draw the pictures on the ranks that share them, where matplotlib is; why they could not be drawn. Collective."""
    world, scene = solved.assembly.world, solved.scene
    # each drawer loads matplotlib, which takes as long as one or two pictures
    near = drawers(world, many=scene.time or len(scene.contact) > 1)
    with agreed(world, asleep=True), event("Figures"):
        if world.rank in near and has_matplotlib():
            from ddmpi.pictures.draw import draw_all

            return _guarded(draw_all, path, near.index(world.rank), len(near))
    return None


def _write_steps(path: Path, solved: Solved) -> list[Leg]:
    """Write the fields of the kept load steps, computed anew from their forces, unless contacts alone are asked for,
    and the forces of each by body and group into the summary; the contacts at these steps. Collective."""
    assembly, steps, legs = solved.assembly, solved.steps, list[Leg]()
    names = solved.summary.get("bodies", {})  # on the first rank
    told = {step["time"]: step for step in solved.summary.get("steps", ())}
    for number, (time, s, alpha, *values) in enumerate(steps.kept):
        states, last = solved.solution.states, time == solved.solution.time
        if steps.places and not last:  # bodies meet elsewhere
            assembly = assembly.meet(steps.places[time])
            states = {
                met.name: replace(states[met.name], interface=met)
                for met in assembly.space.interfaces
            }
        leg = dict(zip(states, zip(states.values(), values, strict=True), strict=True))
        legs.append((time, leg))
        if last:  # its fields are written already
            forces = names
        else:
            assembly.act(assembly.scene.drawn(time, steps.run))
            forces = _write_step(path, solved, assembly, number, (time, s, alpha), leg)
        if told:
            told[time]["bodies"] = {
                name: {key: forces[name][key] for key in ("reaction", "loads", "reactions")}
                for name in names
            }
    return legs


def _write_step(
    path: Path,
    solved: Solved,
    assembly: Assembly,
    number: int,
    kept: tuple[float, np.ndarray, np.ndarray],
    leg: dict[str, tuple[ContactState, np.ndarray]],
) -> dict[str, dict]:
    """Write the fields of a load step before the last one, of its time, forces and motions, unless contacts alone are
    asked for; `forces_by_group` of all bodies, on the first rank. Collective."""
    world, scene, joint = assembly.world, assembly.scene, assembly.joint
    time, s, alpha = kept
    factors = scene.factors(scene.drawn(time, solved.steps.run))
    body_forces, fields, forces = joint.exchange.spread(s), {}, {}
    surfaces, tables = dict[str, Datasets](), dict[str, Datasets]()
    with agreed(world):
        for body, s_body in zip(assembly.bodies, body_forces, strict=True):
            name = body.spec.name
            motions, sizes = alpha[joint.slices[name]], solved.steps.most["sizes"]
            u, *_ = recover(body.member, s_body, motions, sizes)
            forces[name] = plain(forces_by_group(body, u, s_body, factors, assembly.frames))
            if not scene.output.only:
                fields[body.number] = fields_of(assembly, body, u)
        if not scene.output.only:
            surfaces = {name: contact_fields(*at) for name, at in leg.items()}
            tables = {name: table_fields(state, True) for name, (state, _) in leg.items()}
    if not scene.output.only:
        with event("WriteFields"):
            far = tables if assembly.frames else None
            write_fields(path, fields, surfaces, world, number, far)
    return gathered(world, forces)


def _write_contacts(
    path: Path, solved: Solved, surfaces: Mapping[str, Datasets], legs: Sequence[Leg]
) -> None:
    """Write the tables and `surfaces` of the contacts that this rank owns, which are `legs` at the kept load steps;
    with output.only, the first table alone. Not collective."""
    for name, state in solved.solution.states.items():
        write_contact(path, name, state)
        if solved.scene.output.only:
            continue
        write_sides(path, name, state)
        if solved.scene.time:
            write_legs(path, name, state.interface, [(time, *at[name]) for time, at in legs])
        write_surface(path, name, surfaces[name])


def drawers(world: MPI.Comm, many: Any = True) -> list[int]:
    """The ranks that share the pictures if they are `many`; else the first. Collective."""
    hosts = world.allgather(MPI.Get_processor_name())
    return [rank for rank, host in enumerate(hosts) if host == hosts[0]][: DRAWERS if many else 1]


def _guarded(draw: Callable[..., object], *arguments: object) -> OutputError | None:
    """Draw something; its error waits for the numbers."""
    try:
        draw(*arguments)
    except Exception as error:  # matplotlib may raise anything
        return OutputError(
            f"the pictures could not be drawn ({type(error).__name__}: {error}); the other results "
            "are complete"
        )
    return None
