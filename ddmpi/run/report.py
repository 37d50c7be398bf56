"""What a run logs: its plan, its progress, its end."""

from __future__ import annotations

import logging
from collections.abc import Iterable

import numpy as np

from ddmpi.coupling.assembly import Assembly
from ddmpi.interface.interface import Interface
from ddmpi.methods.outer import Step
from ddmpi.qp.tao import QPSolver
from ddmpi.run.solve import Solution
from ddmpi.scene.method import PRESETS, SettledMethod
from ddmpi.scene.scene import Settled

log = logging.getLogger("ddmpi")


def log_plan(assembly: Assembly, figures: bool) -> None:
    """Log what is solved, how, and what is left out because the scene does not need it. Collective."""
    scene, member = assembly.scene, assembly.member
    interfaces = assembly.space.interfaces
    log.info("n = %d unknowns (%s triangles), m = %d contact nodes, friction: %s", assembly.n,
             ("linear", "quadratic")[assembly.spec.mesh.order - 1], assembly.space.m,
             ", ".join(dict.fromkeys(interface.law.name for interface in interfaces)))
    for interface in interfaces:
        log.info("%s: %s", interface.name, _describe_gap(interface))
    own = f"A by {member.C.solver.description}, compliance {member.C.kind} ({member.C.reason})"
    bodies = assembly.world.allgather((own, member.elasticity.b.norm() > 0.0))
    for spec, (way, _) in zip(scene.body, bodies, strict=True):
        log.info("%s: %s", spec.name, way)
    unloaded = [spec.name for spec, (_, acts) in zip(scene.body, bodies, strict=True) if not acts]
    left_out = [*_contact_left_out(assembly), *(f"loads of {name} (there are none)" for name in unloaded)]
    if not scene.output.stress:
        left_out.append("stress in the files (not asked for)")
    if not figures:
        left_out.append("pictures (not asked for)")
    left_out += _target_left_out(scene)
    log.info("%s; left out: %s", _describe(scene.method), ", ".join(left_out) or "nothing")
    log.info("%5s  %10s  %10s  %6s", "k", "update", "residual", "n_A")


def log_warnings(found: Iterable[str], told: list[str]) -> None:
    """Log the warnings that have not been `told`, and note that they are. Not collective."""
    for warning in found:
        if warning not in told:
            log.warning("%s", warning)
            told.append(warning)


def _contact_left_out(assembly: Assembly) -> list[str]:
    found = []
    for interface in assembly.space.interfaces:
        where = f" of {interface.name}" if len(assembly.space.interfaces) > 1 else ""
        held = interface.m - len(interface.sliding)
        if interface.law.name == "none":
            found.append(f"tangential unknowns{where} (no friction)")
        elif held:
            found.append(f"{held} tangential unknowns{where} (held by clamps)")
        if interface.dropped:
            found.append(f"{interface.dropped} contact nodes{where} (clamped)")
        if not interface.gap.any():
            found.append(f"initial gap{where} (all nodes touch)")
    return found


def _target_left_out(scene: Settled) -> list[str]:
    """That a preset's target is not applied, because meshes are given."""
    target = PRESETS.get(scene.method.preset or "", {}).get("target_error")
    given = [body.name for body in scene.body if not body.mesh.refinable]
    if not (target and given and scene.method.target_error is None):
        return []
    return [f'the target of {scene.method.preset}, {target:g} (the mesh of {" and of ".join(given)} is given, and not '
            'refined unless mesh.refine = "as needed")']


def _describe_gap(interface: Interface) -> str:
    """How far the sides are apart at first, and what a load on them means."""
    gap = np.concatenate([interface.gap, interface.fixed.gap])
    if not gap.any():
        return "all nodes touch at first"
    return f"initial gap up to {max(gap.max(), 0.0):.3g}, initial overlap up to {max(-gap.min(), 0.0):.3g}"


def log_step(step: Step) -> None:
    log.info("%5d  %10.3e  %10.3e  %6d", step.iteration, step.update, step.residual, step.n_A)


def _describe(method: SettledMethod) -> str:
    if method.outer == "relaxation":
        qp = QPSolver().type.replace("python", "python (MPRGP)")
        return (f"published iteration: {method.algorithm} algorithm, splitting {method.splitting}, "
                f"theta = {method.theta:g}, update below {method.tolerance:g}; subproblems by TAO {qp}")
    if method.outer == "anderson":
        return f"Anderson acceleration of the weighted published map, update below {method.tolerance:g}"
    return f"semi-smooth Newton, GMRES with half-plane preconditioner, residual below {method.tolerance:g}"


def log_end(summary: dict, solution: Solution) -> None:
    """Log how the run ended, and what a user looks at first. Not collective."""
    log.info("%s (%d outer iterations, n_A = %d)", summary["reason"], summary["outer_iterations"], summary["n_A"])
    for name, contact in summary["contacts"].items():
        first = solution.contacts[name].interface.bodies[0]
        log.info("%s: %d open, %d slip, %d stick nodes; force %s on %s, largest pressure %.4g", name, contact["open"],
                 contact["slip"], contact["stick"], _vector(contact["force"]), first, _number(contact["pressure_max"]))
    for name, body in summary["bodies"].items():
        stress = body["von_mises_max"]
        log.info("%s: reaction of its clamps %s, largest displacement %.4g%s", name, _vector(body["reaction"]),
                 _number(body["displacement_max"]), "" if stress is None else f", von Mises stress {stress:.4g}")
    log.info("certificate (limit %.0e): %s", solution.limit,
             ", ".join(f"{kind.replace('_', ' ')} {value:.1e}"
                       for kind, (value, _) in solution.certificate.worst().items()))
    error = summary["discretization_error"]["energy_norm"]
    if error is not None:
        log.info("estimated discretization error: %.2g of the energy norm", error)
    if summary["options_unused"]:
        log.warning("PETSc options that nothing used: %s", ", ".join(summary["options_unused"]))


def _number(value: float | None) -> float:
    return np.nan if value is None else value


def _vector(components: list[float | None]) -> str:
    return "(" + ", ".join(f"{_number(component):.4g}" for component in components) + ")"
