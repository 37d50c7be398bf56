"""One run from a scene to results: compose the rooms, in the order of the work."""

from __future__ import annotations

import contextlib
import gc
import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ddmpi.body.estimate import DiscretizationError, estimate_error, nodal_stress, sum_errors
from ddmpi.body.stress import stress, von_mises
from ddmpi.coupling.assembly import NO_SIZES, Assembly, Body, prepare
from ddmpi.coupling.ranks import on_working_ranks
from ddmpi.errors import InputError, NotConvergedError, OutputError, SolverError, naming
from ddmpi.judge.accuracy import MeshLadder, demand, refine_scene
from ddmpi.judge.diagnosis import diagnose
from ddmpi.judge.plausible import doubt_answer, doubt_cells, doubt_mesh, doubt_shape, doubt_stress
from ddmpi.mesh.refine import Sizes
from ddmpi.petsc.events import event
from ddmpi.petsc.versions import free_garbage
from ddmpi.results.fields import Datasets, Fields, contact_fields, write_fields, write_surface, write_xdmf
from ddmpi.results.folder import Staging, choose_folder
from ddmpi.results.summary import plain, write_mechanism, write_summary
from ddmpi.results.tables import ENERGY, HISTORY, write_contact, write_legs, write_sides, write_steps, write_table
from ddmpi.run.checkpoint import Checkpoints, continue_from, identify
from ddmpi.run.equilibrium import undetermined_motions
from ddmpi.run.gather import StepLog, forces_by_group, gather_summary
from ddmpi.run.report import describe_files, log_end, log_plan, log_step, log_warnings
from ddmpi.run.solve import Solution, recover
from ddmpi.run.steps import solve_scene
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agreed, gathered, merged
from ddmpi.system.clock import Clock
from ddmpi.system.files import contact_files
from ddmpi.system.provenance import has_matplotlib, versions

log = logging.getLogger("ddmpi")

DRAWERS = 2
"""So many ranks share the pictures, if they are on one host: files of another one may come late."""


@dataclass(frozen=True)
class Solved:
    """A scene on one mesh, solved, as one rank holds it; fields of its bodies by name. All but `steps` is of the last
    load step."""

    assembly: Assembly
    solution: Solution
    fields: dict[str, Fields]
    summary: dict
    steps: StepLog


def run(world: MPI.Comm, scene: Settled, scene_path: str, output: str | None, figures: bool,
        restart: str | None = None) -> None:
    """Solve `scene` and write its results. Collective on `world`.

    Parameters
    ----------
    scene_path : the scene's file; mesh files are looked for beside it first
    output : folder for the results, or None for that of `restart` or a new one under results/
    figures : whether pictures are drawn, if matplotlib is installed
    restart : folder with the checkpoint to go on from, or None

    Raises
    ------
    InputError, SolverError, NotConvergedError, OutputError, InterruptionError
        the same on all ranks. After NotConvergedError the results are there, marked as not converged; after
        the last two a checkpoint is, as far as one could be written.
    """
    on_working_ranks(world, scene, lambda part: _run(part, scene, scene_path, output, figures, restart))


def _run(world: MPI.Comm, scene: Settled, scene_path: str, output: str | None, figures: bool,
         restart: str | None) -> None:
    """`run` on the ranks that hold bodies."""
    clock = Clock()
    folder, held = None, contextlib.ExitStack()
    with agreed(world):
        if world.rank == 0:
            folder = held.enter_context(choose_folder(output, restart, scene_path))
    log.info("%s", scene.title or scene_path)
    with held:
        solved, ladder = compute(world, scene, scene_path, clock, folder, figures, restart)
    solution, outer = solved.solution, solved.solution.outer
    statuses = None if solution.certified else solution.statuses.whole()
    with agreed(world):
        if solution.given and solution.unbalanced:
            raise NotConvergedError(f"{solution.reason} (the certificate fails: {', '.join(solution.violations)})")
        if solution.mechanism or solution.drift:
            raise NotConvergedError(solution.reason)
        if statuses:
            raise NotConvergedError(diagnose(solution.reason, solution.stopped, solution.violations, scene.method,
                                             outer.history, statuses, scene.able))
        if ladder.missed:
            raise NotConvergedError(ladder.missed)


def compute(world: MPI.Comm, scene: Settled, scene_path: str, clock: Clock, folder: Path | None = None,
            figures: bool = False, restart: str | None = None, write: bool = True) -> tuple[Solved, MeshLadder]:
    """Solve `scene` on the meshes that its accuracy target takes, and write the results of the last one. Collective.

    Parameters
    ----------
    folder : of the results and checkpoints, on rank 0; None on the others
    write : whether results and checkpoints are wanted

    Other parameters and what is raised as for `run`.
    """
    identity = {} if world.rank else identify(scene, PETSc.Options().getAll(), versions())
    ladder = MeshLadder(scene)
    state = continue_from(world, restart, identity, ladder) if restart else None
    checkpoints = Checkpoints(world, folder, identity, scene.checkpoint, clock, ladder, state)
    told: list[str] = []

    def attempt() -> Solved | None:
        """Solve on the ladder's present mesh and write the results; None if the ladder goes on to another mesh."""
        assembly = prepare_scene(world, refine_scene(scene, ladder.factor), scene_path, clock, ladder.factor,
                                 ladder.sizes)
        log_plan(assembly, figures)
        log_warnings(assembly.warnings, told)
        solution, steps = solve_scene(assembly, log_step, checkpoints if write else None, clock)
        error = _estimate(assembly, solution, clock)
        if _refine(ladder, assembly, solution, error):
            return None
        solved = _finish(assembly, solution, steps, error, ladder, told, clock)
        if write:
            _write(solved, folder, clock, figures, checkpoints)
        return solved

    with checkpoints.kept():
        if ladder.levels:
            log.info("continuing with %s", ladder.meshes)
        while True:
            try:
                solved = attempt()
                if solved:
                    return solved, ladder
            except (InputError, SolverError) as failure:
                refused = isinstance(failure, InputError) and checkpoints.continuing  # the checkpoint
                if refused or not failure.agreed or not _fall_back(ladder, str(failure)):
                    raise
            checkpoints.leave()
            gc.collect()  # the next mesh needs the memory
            free_garbage()


def _refine(ladder: MeshLadder, assembly: Assembly, solution: Solution, error: DiscretizationError) -> bool:
    """Whether to go on with another mesh. Collective."""
    if not solution.certified:
        return _fall_back(ladder, solution.reason)
    dofs = assembly.world.allreduce(sum(body.mesh.points.size for body in assembly.bodies))
    drawn = {body.spec.name: (body.mesh, error.own[body.spec.name].squares) for body in assembly.bodies
             if body.spec.mesh.geometry}
    rate = ladder.rate(error.relative)
    demands = merged(assembly.world, {name: demand(squares, rate, mesh.dimension)
                                      for name, (mesh, squares) in drawn.items()})
    refinement = ladder.proceed(assembly.n, error.relative, dofs, demands)
    if refinement:
        ladder.draw(drawn)
        log.info("estimated discretization error %.2g, at most %.2g is asked for: going on with %s", error.relative,
                 ladder.goal, ladder.meshes)
    return bool(refinement)


def _fall_back(ladder: MeshLadder, reason: str) -> bool:
    """Whether to solve once more on the last mesh that had a certified answer. Its factors were not kept."""
    failed = ladder.meshes
    possible = ladder.fall_back(reason)
    if possible:
        log.info("no certified answer on %s (%s): back to %s", failed, reason, ladder.meshes)
    return possible


def _estimate(assembly: Assembly, solution: Solution, clock: Clock) -> DiscretizationError:
    """The discretization error of all bodies. Collective."""
    with clock.phase("estimate"):
        own = {body.spec.name: estimate_error(body.mesh, body.material, solution.displacements[body.spec.name],
                                              body.member.elasticity.acting.heated)
               for body in assembly.bodies}
        numbers = {name: (each.total, each.energy, each.area) for name, each in own.items()}
        bodies = gathered(assembly.world, numbers)
        return sum_errors(bodies, own, assembly.world.bcast(np.sum(list(bodies.values()), axis=0)))


def _finish(assembly: Assembly, solution: Solution, steps: StepLog, error: DiscretizationError,
            ladder: MeshLadder, told: list[str], clock: Clock) -> Solved:
    """The fields that are asked for, and on the first rank the summary. Collective."""
    with clock.phase("recover"), agreed(assembly.world), event("Stress"):
        fields = {body.spec.name: _fields(assembly, body, solution.displacements[body.spec.name], error)
                  for body in assembly.bodies}
    free = [] if solution.mechanism else undetermined_motions(assembly, solution.states)
    warnings = [*assembly.warnings, *(body.locking for body in assembly.scene.body if body.locking)]
    if solution.certified:
        doubts = doubt_answer(assembly, solution.displacements, solution.states, solution.contacts)
        warnings += [*doubts, *steps.doubts_beside([*doubts, *free]),
                     *(() if assembly.world.rank else doubt_mesh(assembly.scene.body, error)),
                     *doubt_stress(assembly, {name: each.von_mises for name, each in fields.items()})]
    else:  # there is no answer to doubt, but meshes may be why
        thin = gathered(assembly.world, {body.spec.name: [doubt(body.mesh, body.spec.name) for doubt in
                                                          (doubt_cells, doubt_shape)] for body in assembly.bodies})
        warnings += [doubt for body in assembly.scene.body for doubt in thin.get(body.name, ()) if doubt]
        warnings += steps.doubts_beside(())  # those of legs that have an answer
    summary = gather_summary(assembly, solution, error, fields, ladder, warnings, free, clock.started, steps)
    if summary:
        log_end(summary, solution)
        log_warnings(warnings, told)
    return Solved(assembly, solution, fields, summary, steps)


def _fields(assembly: Assembly, body: Body, u: np.ndarray, error: DiscretizationError | None = None) -> Fields:
    """The fields of a body that moves by `u` (nv, 2), as far as they are asked for. Not collective."""
    mesh, output = body.mesh, assembly.scene.output
    density = error.density(body.spec.name) if error and output.error else None
    if not output.stress:
        return Fields(mesh.points, mesh.triangles, u, error=density)
    heat = body.member.elasticity.acting.heated
    sigma = stress(mesh, body.material, u, heat)
    return Fields(mesh.points, mesh.triangles, u, sigma, von_mises(sigma), density,
                  error.own[body.spec.name].stress if error else nodal_stress(mesh, body.material, u, heat))


def check_cut(ends: Sequence[np.ndarray], scene: Settled) -> None:
    """Raise InputError if the pictures' cut meets none of the bodies between their `ends`, corners (2, d) (m)."""
    from ddmpi.pictures.views import View

    View(np.concatenate(ends), scene.resolved()["output"])


def prepare_scene(world: MPI.Comm, scene: Settled, scene_path: str, clock: Clock | None = None,
                  refinement: int = 1, sizes: Mapping[str, Sizes] = NO_SIZES, factor: bool = True) -> Assembly:
    """`prepare`, with the scene's file named in what is wrong with it, as with a cut of pictures. Collective."""
    with naming(scene_path):
        assembly = prepare(world, scene, Path(scene_path).parent, clock, refinement, sizes, factor)
        if scene.output.cut:
            ends = merged(world, {body.number: np.array([body.mesh.points.min(axis=0), body.mesh.points.max(axis=0)])
                                  for body in assembly.bodies})
            with agreed(world):
                check_cut([*ends.values()], scene)
    return assembly


def _write(solved: Solved, folder: Path | None, clock: Clock, figures: bool, checkpoints: Checkpoints) -> None:
    """Write all result files; they appear together or not at all, and the checkpoint goes. Collective."""
    world, bodies, summary = solved.assembly.world, solved.assembly.bodies, solved.summary
    staging, picture_error = Staging(folder) if folder else None, None
    path = world.bcast(staging.path if staging else None)
    scene = solved.assembly.scene
    try:
        with clock.phase("output"):
            surfaces = {name: contact_fields(state) for name, state in solved.solution.states.items()}
            with event("WriteFields"):
                parts = write_fields(path, {body.number: solved.fields[body.spec.name] for body in bodies}, surfaces,
                                     world)
            times = _write_steps(path, solved)
            with agreed(world), event("WriteTables"):
                _write_contacts(path, solved, surfaces)
                if staging:
                    write_xdmf(path, times, {body.name: parts[number] for number, body in enumerate(scene.body)},
                               {contact.name: parts[contact.name] for contact in scene.contact})
                    write_table(path / "history.csv", HISTORY, solved.steps.iterations)
                    write_steps(path, summary["steps"])
                    if scene.time:
                        write_table(path / "energy.csv", ENERGY, solved.steps.energies)
                    if solved.solution.mechanism:
                        write_mechanism(path, solved.solution.mechanism)
                    if figures:  # they show it
                        write_summary(path, summary)
            if figures:
                hosts = world.allgather(MPI.Get_processor_name())
                near = [rank for rank, host in enumerate(hosts) if host == hosts[0]][:DRAWERS]
                with agreed(world), event("Figures"):
                    picture_error = _draw(path, near.index(world.rank), len(near)) if world.rank in near else None
        seconds = clock.largest(world)
        with agreed(world):
            if staging:
                write_summary(path, summary | {"seconds": seconds})
                files = staging.publish(name for each in scene.contact for name in contact_files(each.name))
                log.info("results in %s: %s (%.1f s in all)", folder, describe_files([f.name for f in files]),
                         seconds["total"])
        checkpoints.remove()
        with agreed(world):
            if picture_error:
                raise picture_error
    finally:
        if staging:
            staging.discard()


def _write_steps(path: Path, solved: Solved) -> list[float]:
    """Write the fields of the load steps that are kept, computed anew from their forces; their times. The summary has
    the forces of each by body and group. Collective."""
    assembly, times, steps = solved.assembly, [], solved.steps
    world, joint = assembly.world, assembly.joint
    told = {step["time"]: step for step in solved.summary.get("steps", ())}  # on the first rank
    for number, (time, s, alpha, *values) in enumerate(steps.kept):
        times.append(time)
        if time == solved.solution.time:  # the last one is there
            if told:
                told[time]["bodies"] = {name: {key: body[key] for key in ("reaction", "loads", "reactions")}
                                        for name, body in solved.summary["bodies"].items()}
            continue
        assembly.act(time)
        parts, fields, forces, factors = joint.exchange.spread(s), {}, {}, assembly.scene.factors(time)
        with agreed(world):
            for body, part in zip(assembly.bodies, parts, strict=True):
                u, *_ = recover(body.member, part, alpha[joint.slices[body.spec.name]], steps.most["sizes"])
                fields[body.number] = _fields(assembly, body, u)
                forces[body.spec.name] = plain(forces_by_group(body, u, part, factors))
            surfaces = {name: contact_fields(state, own) for (name, state), own in zip(
                solved.solution.states.items(), values, strict=True)}
        forces = gathered(world, forces)
        if told:
            told[time]["bodies"] = {name: forces[name] for name in solved.summary["bodies"]}
        with event("WriteFields"):
            write_fields(path, fields, surfaces, world, number)
    return times or ([solved.solution.time] if solved.solution.time is not None else [])


def _write_contacts(path: Path, solved: Solved, surfaces: Mapping[str, Datasets]) -> None:
    """Write the tables and `surfaces` of the contacts that this rank owns. Not collective."""
    for k, (name, state) in enumerate(solved.solution.states.items()):
        write_contact(path, name, state)
        write_sides(path, name, state)
        if solved.assembly.scene.time:
            write_legs(path, name, state, [(time, values[k]) for time, _, _, *values in solved.steps.kept])
        write_surface(path, name, surfaces[name])


def _draw(path: Path, number: int, drawers: int) -> OutputError | None:
    """Draw this rank's share of the pictures, where matplotlib is installed; its error waits for the numbers."""
    from ddmpi.pictures.draw import draw_all

    if not has_matplotlib():
        return None
    try:
        draw_all(path, number, drawers)
    except Exception as error:  # matplotlib raises what it likes
        return OutputError(f"the pictures could not be drawn ({type(error).__name__}: {error}); the other results "
                           "are complete")
    return None
