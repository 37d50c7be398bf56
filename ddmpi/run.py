"""One run from a scene to results: compose the rooms, in the order of the work."""

from __future__ import annotations

import contextlib
import logging
import resource
from dataclasses import asdict
from pathlib import Path

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

from ddmpi.algorithm import OuterIteration, Step
from ddmpi.checkpoint import Checkpoints, continue_from, identify
from ddmpi.coupled import check_size, solve_coupled
from ddmpi.diagnosis import diagnose
from ddmpi.elasticity import stress, von_mises
from ddmpi.errors import DdmpiError, InputError, NotConvergedError, OutputError
from ddmpi.estimate import ErrorEstimate, estimate_error, relative_error
from ddmpi.exchange import agreed
from ddmpi.petsc_options import unused_options
from ddmpi.problem import Clock, Problem, check_ranks, prepare
from ddmpi.provenance import provenance, versions
from ddmpi.results import (
    Fields,
    Staging,
    choose_folder,
    finite_or_none,
    write_fields,
    write_history,
    write_interface,
    write_summary,
    write_xdmf,
)
from ddmpi.scene import Method, Scene
from ddmpi.solution import Answer, solve

log = logging.getLogger("ddmpi")

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
    folder = None
    with agreed(world):
        folder = choose_folder(output, restart, scene_path) if world.rank == 0 else None
    log.info("%s", scene.title or scene_path)
    try:
        identity = identify(scene, PETSc.Options().getAll(), versions())
        state = continue_from(world, restart, identity) if restart else None
        problem = _prepare(world, scene, scene_path, clock)
        _log_plan(problem, figures)
        checkpoints = Checkpoints(problem, folder, identity, clock, state)
        with checkpoints.kept():
            with clock.phase("outer"):
                answer, outer = solve(problem, scene.method, _report_step, checkpoints)
            with clock.phase("estimate"):
                estimate = estimate_error(problem.mesh, problem.spec.material, answer.displacement)
            summary = _summary(problem, outer, answer, estimate) | provenance(world, clock.started)
            _log_end(summary, answer)
            _write(problem, folder, clock, summary, outer, answer, figures, checkpoints)
    except DdmpiError:
        if folder:
            with contextlib.suppress(OSError):  # there is something in it
                folder.rmdir()
        raise
    with agreed(world):
        if not answer.certified:
            raise NotConvergedError(diagnose(answer.reason, answer.stopped, answer.violations, scene.method,
                                             outer.history, answer.statuses, problem.interface, problem.friction))


def _prepare(world: MPI.Comm, scene: Scene, scene_path: str, clock: Clock | None = None) -> Problem:
    """`prepare`, with the scene's file named in what is wrong with it. Collective."""
    try:
        return prepare(world, scene, Path(scene_path).parent, clock)
    except InputError as error:
        error.args = (f"{scene_path}: {error}",)
        raise


def verify(world: MPI.Comm, scene: Scene, scene_path: str) -> None:
    """Solve `scene`, and again as the coupled problem by brute force; compare the two. Collective.

    Writes nothing. Raises what `run` raises, and NotConvergedError when the answers differ by more than
    the certificate promises.
    """
    check_ranks(world, scene)
    problem = _prepare(world, scene, scene_path)
    with agreed(world):
        check_size(problem.interface)
    _log_plan(problem, figures=False)
    answer, outer = solve(problem, scene.method, _report_step)
    exact = solve_coupled(problem.body, problem.friction, problem.exchange)
    size = np.linalg.norm(exact)
    distance = float(np.linalg.norm(outer.forces - exact) / size) if size else float(np.linalg.norm(outer.forces))
    log.info("%s; contact forces differ from those of the coupled problem by %.1e, relatively", answer.reason, distance)
    with agreed(world):
        if not (answer.certified and distance <= answer.limit):
            raise NotConvergedError(f"{answer.reason}, and the contact forces differ from those of the coupled problem "
                                    f"by {distance:.1e}; {answer.limit:.0e} is the limit")


def _summary(problem: Problem, outer: OuterIteration, answer: Answer, estimate: ErrorEstimate) -> dict:
    """All of summary.json but the times. Collective; bodies in the order of the scene."""
    world, scene, body, order = problem.world, problem.scene, problem.body, problem.order
    counts = world.allgather(dict(body.C.count))
    memory = world.allgather(round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1))
    solver = world.allgather(body.C.solver.description)
    steps = world.allgather(body.steps)
    unused = sorted(set.intersection(*map(set, world.allgather(unused_options()))))
    by_body = [sum(count.values()) for count in counts]
    n_A, m, state = sum(by_body), problem.interface.m, answer.state
    energy = [answer.energy[order.index(rank)] for rank in range(world.size)]
    errors, sizes = zip(*world.allgather((estimate.total, estimate.energy)), strict=True)
    everything = sum(sizes) + sum(errors)
    return {
        "title": scene.title, "converged": answer.certified, "reason": answer.reason,
        "outer": scene.method.outer, "algorithm": scene.method.algorithm or scene.method.outer,
        "splitting": scene.method.splitting or "none", "friction": outer.friction.law,
        "n": problem.n, "m": m, "ranks": world.size, "outer_iterations": len(outer.history),
        "n_A": n_A, "n_A_by_body": by_body, "n_A_by_purpose": counts, "inner_steps": steps, "eff": n_A / (2 * m),
        "contact": {"normal_force": finite_or_none(state.normal_force.sum()),
                    "tangential_force": finite_or_none(state.tangential_force.sum()),
                    **{status: state.count(status) for status in ("open", "slip", "stick")}},
        "certificate": {name: finite_or_none(value) for name, value in asdict(answer.certificate).items()},
        "certificate_limit": answer.limit,
        "discretization_error": {
            "energy_norm": finite_or_none(relative_error(sum(errors), sum(sizes))),
            "by_body": [finite_or_none(relative_error(error, everything - error)) for error in errors]},
        "displacement_max": finite_or_none(answer.displacement_max), "energy": [finite_or_none(e) for e in energy],
        "seconds": {}, "memory_mib": memory,
        "exchange": {"messages": outer.exchange.messages, "bytes": outer.exchange.bytes},
        "solvers": {"body": solver, "compliance": body.C.kind,
                    "qp": "none" if scene.method.outer == "newton" else body.qp_solver.type},
        "options": PETSc.Options().getAll(), "options_unused": unused, "scene": scene.resolved(),
    }


def _write(problem: Problem, folder: Path | None, clock: Clock, summary: dict, outer: OuterIteration, answer: Answer,
           figures: bool, checkpoints: Checkpoints) -> None:
    """Write all result files; they appear together or not at all, and the checkpoint goes. Collective."""
    world, mesh = problem.world, problem.mesh
    staging, picture_error = Staging(folder) if folder else None, None
    path = world.bcast(staging.path if staging else None)
    sizes = world.allgather((len(mesh.points), len(mesh.triangles)))
    try:
        with clock.phase("output"):
            with agreed(world):
                if staging:
                    staging.create()
                fields = _fields(problem, answer)
            for rank in range(world.size):
                with agreed(world):
                    if rank == world.rank:
                        write_fields(path, fields, rank, sizes)
            with agreed(world):
                if staging:
                    write_xdmf(path)
                    write_history(path, outer.history, answer.statuses.counts)
                    write_interface(path, problem.interface, answer.state)
                    write_summary(path, summary)
                    picture_error = _draw(path) if figures else None
        seconds = clock.largest(world)
        with agreed(world):
            if staging:
                write_summary(path, summary | {"seconds": seconds})
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
    from ddmpi.figures import draw_all

    try:
        draw_all(path)
    except Exception as error:  # matplotlib raises what it likes
        return OutputError(f"the pictures could not be drawn ({type(error).__name__}: {error}); the other results "
                           "are complete")
    return None


def _fields(problem: Problem, answer: Answer) -> Fields:
    mesh = problem.mesh
    if not problem.scene.output.stress:
        return Fields(mesh.points, mesh.triangles, answer.displacement)
    sigma = stress(mesh, problem.spec.material, answer.displacement)
    return Fields(mesh.points, mesh.triangles, answer.displacement, sigma, von_mises(sigma))


def _log_plan(problem: Problem, figures: bool) -> None:
    """Say what is solved, how, and what is left out because the scene does not need it. Collective."""
    scene, body, interface, friction = problem.scene, problem.body, problem.interface, problem.friction
    left_out = []
    if friction.law == "none":
        left_out.append("tangential unknowns (no friction)")
    elif len(interface.sliding) < interface.m:
        left_out.append(f"{interface.m - len(interface.sliding)} tangential unknowns (held by clamps)")
    if interface.dropped:
        left_out.append(f"{interface.dropped} contact nodes (clamped)")
    if not interface.gap.any():
        left_out.append("initial gap (all nodes touch)")
    loaded = problem.world.allgather(body.elasticity.b.norm() > 0.0)
    left_out += [f"loads of {spec.name} (there are none)" for spec, acts in zip(scene.body, loaded, strict=True)
                 if not acts]
    if not scene.output.stress:
        left_out.append("stress (not asked for)")
    if not figures:
        left_out.append("pictures (not asked for)")
    log.info("n = %d unknowns, m = %d contact nodes, friction: %s; A by %s, compliance %s",
             problem.n, interface.m, friction.law, body.C.solver.description, body.C.kind)
    qp = "" if scene.method.outer == "newton" else body.qp_solver.type.replace("python", "python (MPRGP)")
    log.info("%s; left out: %s", _describe(scene.method, qp), ", ".join(left_out) or "nothing")
    log.info("%5s  %10s  %10s  %6s", "k", "update", "residual", "n_A")


def _report_step(step: Step) -> None:
    log.info("%5d  %10.3e  %10.3e  %6d", step.iteration, step.update, step.residual, sum(step.n_A))


def _describe(method: Method, qp: str) -> str:
    if method.outer == "relaxation":
        return (f"published iteration: {method.algorithm} algorithm, splitting {method.splitting}, "
                f"theta = {method.theta:g}, update below {method.tolerance:g}; subproblems by TAO {qp}")
    if method.outer == "anderson":
        return f"Anderson acceleration of the weighted published map, update below {method.tolerance:g}"
    return f"semi-smooth Newton, GMRES with half-plane preconditioner, residual below {method.tolerance:g}"


def _log_end(summary: dict, answer: Answer) -> None:
    contact = summary["contact"]
    log.info("%s after %d outer iterations, n_A = %d; contact nodes: %d open, %d slip, %d stick",
             summary["reason"], summary["outer_iterations"], summary["n_A"],
             contact["open"], contact["slip"], contact["stick"])
    log.info("certificate (limit %.0e): %s", answer.limit,
             ", ".join(f"{name.replace('_', ' ')} {value:.1e}" for name, value in asdict(answer.certificate).items()))
    error = summary["discretization_error"]["energy_norm"]
    if error is not None:
        log.info("estimated discretization error: %.2g of the energy norm", error)
    if summary["options_unused"]:
        log.warning("PETSc options that nothing used: %s", ", ".join(summary["options_unused"]))
