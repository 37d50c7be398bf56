"""What a run says: its plan, its progress, its end, and all of it again in summary.json."""

from __future__ import annotations

import logging
from dataclasses import asdict

from petsc4py import PETSc

from ddmpi.body.estimate import DiscretizationError
from ddmpi.coupling.assembly import Problem
from ddmpi.judge.accuracy import Course
from ddmpi.methods.newton import InterfaceNewton
from ddmpi.methods.outer import Step
from ddmpi.methods.published import OuterIteration
from ddmpi.petsc.options import unused_options
from ddmpi.results.tables import finite_or_none
from ddmpi.run.solve import Answer
from ddmpi.scene.method import PRESETS, Method
from ddmpi.scene.scene import Scene
from ddmpi.system.provenance import peak_memory

log = logging.getLogger("ddmpi")


def tell_plan(problem: Problem, figures: bool) -> None:
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
        left_out.append("stress in the files (not asked for)")
    if not figures:
        left_out.append("pictures (not asked for)")
    left_out += _target_left_out(scene)
    log.info("n = %d unknowns (%s triangles), m = %d contact nodes, friction: %s", problem.n,
             ("linear", "quadratic")[problem.spec.mesh.order - 1], interface.m, friction.law)
    ways = problem.world.allgather(f"A by {body.C.solver.description}, compliance {body.C.kind} ({body.C.reason})")
    for spec, way in zip(scene.body, ways, strict=True):
        log.info("%s: %s", spec.name, way)
    qp = "" if scene.method.outer == "newton" else body.qp_solver.type.replace("python", "python (MPRGP)")
    log.info("%s; left out: %s", _describe(scene.method, qp), ", ".join(left_out) or "nothing")
    log.info("%5s  %10s  %10s  %6s", "k", "update", "residual", "n_A")


def _target_left_out(scene: Scene) -> list[str]:
    """That a preset's target is not applied, because meshes are given."""
    target = PRESETS.get(scene.method.preset, {}).get("target_error")
    given = [body.name for body in scene.body if not body.mesh.refinable]
    if not (target and given and scene.method.target_error is None):
        return []
    return [f'the target of {scene.method.preset}, {target:g} (the mesh of {" and of ".join(given)} is given, and not '
            'refined unless mesh.refine = "as needed")']


def tell_step(step: Step) -> None:
    log.info("%5d  %10.3e  %10.3e  %6d", step.iteration, step.update, step.residual, sum(step.n_A))


def _describe(method: Method, qp: str) -> str:
    if method.outer == "relaxation":
        return (f"published iteration: {method.algorithm} algorithm, splitting {method.splitting}, "
                f"theta = {method.theta:g}, update below {method.tolerance:g}; subproblems by TAO {qp}")
    if method.outer == "anderson":
        return f"Anderson acceleration of the weighted published map, update below {method.tolerance:g}"
    return f"semi-smooth Newton, GMRES with half-plane preconditioner, residual below {method.tolerance:g}"


def tell_end(summary: dict, answer: Answer) -> None:
    contact = summary["contact"]
    log.info("%s (%d outer iterations, n_A = %d); contact nodes: %d open, %d slip, %d stick",
             summary["reason"], summary["outer_iterations"], summary["n_A"],
             contact["open"], contact["slip"], contact["stick"])
    log.info("certificate (limit %.0e): %s", answer.limit,
             ", ".join(f"{name.replace('_', ' ')} {value:.1e}" for name, value in asdict(answer.certificate).items()))
    error = summary["discretization_error"]["energy_norm"]
    if error is not None:
        log.info("estimated discretization error: %.2g of the energy norm", error)
    if summary["options_unused"]:
        log.warning("PETSc options that nothing used: %s", ", ".join(summary["options_unused"]))


def _qp_type(problem: Problem, counts: list[dict]) -> str:
    """The TAO type that solved programs, if one did."""
    if problem.scene.method.outer != "newton":
        return problem.body.qp_solver.type
    return "python" if any(count.get("approximation") for count in counts) else "none"


def summarize(problem: Problem, outer: OuterIteration | InterfaceNewton, answer: Answer, error: DiscretizationError,
              course: Course) -> dict:
    """All of summary.json but the times. Collective; bodies in the order of the scene."""
    world, scene, body = problem.world, problem.scene, problem.body
    counts = world.allgather(dict(body.C.count))
    solver = world.allgather(body.C.solver.description)
    kinds = world.allgather(body.C.kind)
    steps = world.allgather(body.steps)
    unused = sorted(set.intersection(*map(set, world.allgather(unused_options()))))
    by_body = [sum(count.values()) for count in counts]
    n_A, m, state = sum(by_body), problem.interface.m, answer.state
    energy = world.allgather(error.own.energy / 2)  # of the stresses: free of what moves the body without strain
    return {
        "title": scene.title, "converged": answer.certified and not course.missed,
        "reason": course.missed or answer.reason,
        "outer": scene.method.outer, "algorithm": scene.method.algorithm or scene.method.outer,
        "splitting": scene.method.splitting or "none", "friction": outer.friction.law, "order": problem.spec.mesh.order,
        "n": problem.n, "m": m, "ranks": world.size, "outer_iterations": len(outer.history),
        "n_A": n_A, "n_A_by_body": by_body, "n_A_by_purpose": counts, "inner_steps": steps, "eff": n_A / (2 * m),
        "contact": {"normal_force": finite_or_none(state.normal_force.sum()),
                    "tangential_force": finite_or_none(state.tangential_force.sum()),
                    **{status: state.count(status) for status in ("open", "slip", "stick")}},
        "certificate": {name: finite_or_none(value) for name, value in asdict(answer.certificate).items()},
        "certificate_limit": answer.limit,
        "discretization_error": {
            "energy_norm": finite_or_none(error.relative), "by_body": [finite_or_none(e) for e in error.by_body],
            "target": scene.method.target_error, "levels": [level._asdict() for level in course.levels]},
        "displacement_max": finite_or_none(answer.displacement_max), "energy": [finite_or_none(e) for e in energy],
        "seconds": {}, "memory_mib": peak_memory(world),
        "exchange": {"messages": outer.exchange.messages, "bytes": outer.exchange.bytes},
        "solvers": {"body": solver, "compliance": kinds,
                    "qp": _qp_type(problem, counts)},
        "options": PETSc.Options().getAll(), "options_unused": unused, "scene": scene.resolved(),
    }
