"""One run from a scene to results: compose the rooms, in the order of the work."""

from __future__ import annotations

import contextlib
import gc
import logging
from dataclasses import dataclass
from pathlib import Path

from mpi4py import MPI
from petsc4py import PETSc

from ddmpi.body.estimate import DiscretizationError, estimate_error, sum_errors
from ddmpi.body.stress import stress, von_mises
from ddmpi.coupling.assembly import Problem, prepare
from ddmpi.coupling.ranks import check_ranks
from ddmpi.errors import InputError, NotConvergedError, OutputError
from ddmpi.judge.accuracy import Course, refine_scene
from ddmpi.judge.diagnosis import diagnose
from ddmpi.methods.newton import InterfaceNewton
from ddmpi.methods.published import OuterIteration
from ddmpi.petsc.events import event
from ddmpi.petsc.versions import free_garbage
from ddmpi.results.fields import Fields, write_fields, write_xdmf
from ddmpi.results.folder import Staging, choose_folder
from ddmpi.results.tables import write_history, write_interface, write_sides, write_summary
from ddmpi.run.checkpoint import Checkpoints, continue_from, identify, levels_kept
from ddmpi.run.report import summarize, tell_end, tell_plan, tell_step
from ddmpi.run.solve import Answer, solve
from ddmpi.scene.scene import Scene
from ddmpi.system.agreement import agreed
from ddmpi.system.clock import Clock
from ddmpi.system.provenance import peak_memory, provenance, versions

log = logging.getLogger("ddmpi")


@dataclass(frozen=True)
class _Solved:
    """A scene on one mesh, solved, as one rank holds it."""

    problem: Problem
    answer: Answer
    outer: OuterIteration | InterfaceNewton
    error: DiscretizationError


def run(world: MPI.Comm, scene: Scene, scene_path: str, output: str | None, figures: bool,
        restart: str | None = None) -> None:
    """Solve `scene` and write its results. Collective on `world`.

    Parameters
    ----------
    scene_path : the scene's file; mesh files are looked for beside it first
    output : folder for the results, or None for that of `restart` or a new one under results/
    figures : whether pictures are drawn
    restart : folder with the checkpoint to go on from, or None

    Raises
    ------
    InputError, SolverError, NotConvergedError, OutputError, InterruptionError
        the same on all ranks. After NotConvergedError the results are there, marked as not converged; after
        the last two a checkpoint is, as far as one could be written.
    """
    clock = Clock()
    check_ranks(world, scene)
    folder, held = None, contextlib.ExitStack()
    with agreed(world):
        if world.rank == 0:
            folder = held.enter_context(choose_folder(output, restart, scene_path))
    log.info("%s", scene.title or scene_path)
    with held:
        identity = identify(scene, PETSc.Options().getAll(), versions())
        state = continue_from(world, restart, identity) if restart else None
        course = Course(scene, state["course.done"] if state else [])
        with levels_kept(world, folder, identity, course, restart):
            refinement = course.refinement
            if course.done:
                log.info("continuing with meshes %d times as fine as given", refinement)
            while refinement:
                problem = _prepare(world, refine_scene(scene, refinement), scene_path, clock)
                tell_plan(problem, figures)
                checkpoints = Checkpoints(problem, folder, identity, clock, state, {"course": course})
                with checkpoints.kept():
                    solved = _solve(problem, clock, checkpoints)
                    refinement = _proceed(course, solved)
                    if refinement:
                        del problem, solved, state  # their memory is needed
                        checkpoints, state = None, None
                        gc.collect()
                        free_garbage()
                        continue
                    summary = summarize(problem, solved.outer, solved.answer, solved.error, course)
                    summary |= provenance(world, clock.started)
                    tell_end(summary, solved.answer)
                    _write(solved, folder, clock, summary, figures, checkpoints)
    with agreed(world):
        if not solved.answer.certified:
            answer, outer = solved.answer, solved.outer
            raise NotConvergedError(diagnose(answer.reason, answer.stopped, answer.violations, scene.method,
                                             outer.history, answer.statuses, problem.interface, problem.friction))
        if course.missed:
            raise NotConvergedError(course.missed)


def _proceed(course: Course, solved: _Solved) -> int | None:
    """The refinement of the meshes to go on with, None to stay with these. Collective."""
    problem, error = solved.problem, solved.error.relative
    dofs = problem.world.allreduce(problem.mesh.points.size)
    if not solved.answer.certified:
        return None
    refinement = course.proceed(problem.n, error, dofs)
    if refinement:
        log.info("estimated discretization error %.2g, at most %.2g is asked for: going on with meshes %d times as "
                 "fine as given", error, course.goal, refinement)
    return refinement


def _solve(problem: Problem, clock: Clock, checkpoints: Checkpoints) -> _Solved:
    """Iterate, certify, and estimate the discretization error. Collective."""
    answer, outer = solve(problem, problem.scene.method, tell_step, checkpoints, clock)
    with clock.phase("estimate"):
        estimate = estimate_error(problem.mesh, problem.spec.material, answer.displacement)
        error = sum_errors(problem.world.allgather((estimate.total, estimate.energy, estimate.area)), estimate)
    return _Solved(problem, answer, outer, error)


def _prepare(world: MPI.Comm, scene: Scene, scene_path: str, clock: Clock | None = None) -> Problem:
    """`prepare`, with the scene's file named in what is wrong with it. Collective."""
    try:
        return prepare(world, scene, Path(scene_path).parent, clock)
    except InputError as error:
        error.args = (f"{scene_path}: {error}",)
        raise


def _write(solved: _Solved, folder: Path | None, clock: Clock, summary: dict, figures: bool,
           checkpoints: Checkpoints) -> None:
    """Write all result files; they appear together or not at all, and the checkpoint goes. Collective."""
    problem = solved.problem
    world, mesh = problem.world, problem.mesh
    staging, picture_error = Staging(folder) if folder else None, None
    path = world.bcast(staging.path if staging else None)
    sizes = world.allgather((len(mesh.points), len(mesh.triangles)))
    try:
        with clock.phase("recover"), agreed(world), event("Stress"):
            fields = _fields(solved)
        with clock.phase("output"):
            with agreed(world):
                if staging:
                    staging.create()
            for rank in range(world.size):
                with agreed(world), event("WriteFields"):
                    if rank == world.rank:
                        write_fields(path, fields, rank, sizes)
            with agreed(world), event("WriteTables"):
                if staging:
                    write_xdmf(path)
                    write_history(path, solved.outer.history, solved.answer.statuses.counts)
                    write_interface(path, problem.interface, solved.answer.state)
                    write_sides(path, problem.interface, solved.answer.state)
                    write_summary(path, summary)
            if figures:
                with agreed(world), event("Figures"):
                    picture_error = _draw(path) if staging else None
        seconds, memory = clock.largest(world), peak_memory(world)
        with agreed(world):
            if staging:
                write_summary(path, summary | {"seconds": seconds, "memory_mib": memory})
                files = staging.publish()
                log.info("results in %s: %s (%.1f s in all)", folder, ", ".join(f.name for f in files),
                         seconds["total"])
        checkpoints.remove()
        with agreed(world):
            if picture_error:
                raise picture_error
    finally:
        if staging:
            staging.discard()


def _draw(path: Path) -> OutputError | None:
    """Draw the pictures; what goes wrong there is told after the numbers are safe."""
    from ddmpi.results.pictures import draw_all

    try:
        draw_all(path)
    except Exception as error:  # matplotlib raises what it likes
        return OutputError(f"the pictures could not be drawn ({type(error).__name__}: {error}); the other results "
                           "are complete")
    return None


def _fields(solved: _Solved) -> Fields:
    """What is asked for of the own body; the rest is not computed."""
    mesh, u, output = solved.problem.mesh, solved.answer.displacement, solved.problem.scene.output
    sigma = stress(mesh, solved.problem.spec.material, u) if output.stress else None
    return Fields(mesh.points, mesh.triangles, u, sigma, von_mises(sigma) if output.stress else None,
                  solved.error.density() if output.error else None)
