"""One run from a scene to results: compose the rooms, in the order of the work."""

from __future__ import annotations

import logging
import resource
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, dataclass, field
from importlib import metadata
from pathlib import Path

import numpy as np
from mpi4py import MPI
from petsc4py import PETSc

import ddmpi
from ddmpi.algorithm import OuterIteration, Step
from ddmpi.body import Body, Friction, friction_at
from ddmpi.certificate import Certificate, ContactState, certificate_limit, certify, contact_state
from ddmpi.elasticity import Elasticity, assemble, stress, von_mises
from ddmpi.errors import InputError, NotConvergedError
from ddmpi.exchange import Exchange, agreed
from ddmpi.interface import Interface, contact_side, displacement_trace, pair
from ddmpi.mesh import Mesh, boundary_group, build_mesh
from ddmpi.petsc_options import unused_options
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
from ddmpi.scene import BodySpec, NoFriction, Scene

log = logging.getLogger("ddmpi")

TIGHTER = 0.1
"""By this the outer tolerance shrinks when the iteration stops but its certificate fails."""


@dataclass
class Clock:
    """Seconds by phase; each phase is also a PETSc log stage, for -log_view."""

    seconds: dict[str, float] = field(default_factory=dict)
    started: float = field(default_factory=time.perf_counter)

    @contextmanager
    def phase(self, name: str) -> Iterator[None]:
        start = time.perf_counter()
        with PETSc.Log.Stage(name):
            yield
        self.seconds[name] = self.seconds.get(name, 0.0) + time.perf_counter() - start

    def largest(self, world: MPI.Comm) -> dict[str, float]:
        """The slowest rank's seconds of each phase, and of the whole. Collective."""
        own = self.seconds | {"total": time.perf_counter() - self.started}
        everyone = world.allgather(own)
        return {name: round(max(each[name] for each in everyone), 6) for name in own}


@dataclass(frozen=True)
class Answer:
    """The end of a run on one rank: displacement of the own body, state of the interface, certificate."""

    reason: str
    displacement: np.ndarray
    state: ContactState
    certificate: Certificate
    energy: tuple[float, float]
    displacement_max: float

    def certified(self, limit: float) -> bool:
        return self.reason == "converged" and not self.certificate.violations(limit)


def run(world: MPI.Comm, scene: Scene, scene_path: str, output: str | None, figures: bool) -> None:
    """Solve `scene` and write its results. Collective on `world`.

    Parameters
    ----------
    scene_path : the scene's file; mesh files are looked for beside it first
    output : folder for the results, or None for a new one under results/
    figures : whether pictures are drawn

    Raises
    ------
    InputError, SolverError, NotConvergedError, OutputError
        the same on all ranks. After NotConvergedError the results are there, marked as not converged.
    """
    clock = Clock()
    with agreed(world):
        if world.size != len(scene.body):
            raise InputError(f"this scene has {len(scene.body)} bodies, each on a rank of its own; start it with "
                             f"mpirun -n {len(scene.body)} (started on {world.size})")
    contact = scene.contact[0]
    names = [body.name for body in scene.body]
    order = [names.index(name) for name in contact.bodies]  # rank of role 1, of role 2
    role = order.index(world.rank) + 1
    spec = scene.body[world.rank]
    exchange = Exchange(world, partner=order[2 - role], role=role)

    folder = None
    with agreed(world):
        folder = choose_folder(output, scene_path) if world.rank == 0 else None
    log.info("%s", scene.title or scene_path)

    mesh, elasticity, interface = _discretise(world, exchange, scene, spec, Path(scene_path).parent, clock)
    friction = friction_at(contact.friction, interface)
    with clock.phase("factor"), agreed(world):
        body = Body(spec.name, role, interface, elasticity)
    n = world.allreduce(elasticity.n)
    _log_plan(scene, body, friction, n, figures)

    with clock.phase("outer"):
        outer = OuterIteration(body, friction, exchange, scene.method, _report_step)
        answer, limit = _solve(world, scene, outer, clock)

    unused = sorted(set.intersection(*map(set, world.allgather(unused_options()))))
    summary = _summary(world, scene, body, outer, answer, limit, n, order, unused)
    _log_end(summary, answer, limit)
    _write(world, scene, folder, clock, summary, mesh, spec, outer, answer, figures)
    with agreed(world):
        if not answer.certified(limit):
            raise NotConvergedError(_diagnosis(answer, outer, limit))


def _discretise(world: MPI.Comm, exchange: Exchange, scene: Scene, spec: BodySpec, folder: Path,
                clock: Clock) -> tuple[Mesh, Elasticity, Interface]:
    """Mesh, matrices and interface of the own body. Collective."""
    contact = scene.contact[0]
    with clock.phase("mesh"), agreed(world):
        mesh = build_mesh(spec, folder)
        edges = boundary_group(mesh, contact.on[exchange.role - 1], "contact.0.on")
    with clock.phase("assemble"):
        with agreed(world):
            elasticity = assemble(mesh, spec)
            side = contact_side(mesh, edges, elasticity.free)
        sides = exchange.swap_objects(side)
        with agreed(world):
            interface = pair(*sides, friction=not isinstance(contact.friction, NoFriction), label="contact.0")
    return mesh, elasticity, interface


def _solve(world: MPI.Comm, scene: Scene, outer: OuterIteration, clock: Clock) -> tuple[Answer, float]:
    """Iterate; where the certificate fails although the iteration stopped, go on more tightly."""
    limit = certificate_limit(scene.method.tolerance)
    tolerance = scene.method.tolerance
    load = sum(world.allgather(float(np.abs(outer.body.elasticity.b.array_r).sum())))
    while True:
        reason = outer.run(tolerance)
        answer = _conclude(outer, reason, load)
        if reason != "converged" or answer.certified(limit) or tolerance < np.finfo(float).eps:
            return answer, limit
        tolerance *= TIGHTER
        log.info("the certificate fails (%s); going on to an update of %.0e",
                 ", ".join(answer.certificate.violations(limit)), tolerance)


def _conclude(outer: OuterIteration, reason: str, load: float) -> Answer:
    """Displacements, contact state and certificate of the forces at hand. Collective."""
    body, exchange, interface = outer.body, outer.exchange, outer.body.interface
    u, residual, energy = np.zeros_like(body.elasticity.prescribed), np.nan, np.nan
    with exchange.deferred():
        u, residual, energy = body.displacement()
    own = displacement_trace(interface, body.role, u)
    largest = float(np.linalg.norm(u, axis=1).max())
    both = exchange.swap(np.append(own, [residual, energy, largest]))
    traces = tuple(vector[:-3] for vector in both)
    (r1, e1, u1), (r2, e2, u2) = (vector[-3:] for vector in both)
    state = contact_state(interface, outer.friction, outer.forces, outer.g, traces)
    certificate = certify(interface, outer.friction, state, (outer.s1, outer.s2), traces, (r1, r2), load)
    return Answer(reason, u, state, certificate, (e1, e2), max(u1, u2))


def _summary(world: MPI.Comm, scene: Scene, body: Body, outer: OuterIteration, answer: Answer, limit: float,
             n: int, order: list[int], unused: list[str]) -> dict:
    """All of summary.json but the times. Collective; bodies in the order of the scene."""
    counts = world.allgather(dict(body.C.count))
    hosts = world.allgather(MPI.Get_processor_name())
    memory = world.allgather(round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024, 1))
    solver = world.allgather(body.solver.description)
    by_body = [sum(count.values()) for count in counts]
    n_A, m, state = sum(by_body), outer.body.interface.m, answer.state
    energy = [answer.energy[order.index(rank)] for rank in range(world.size)]
    return {
        "title": scene.title, "converged": answer.certified(limit), "reason": _reason(answer, limit),
        "algorithm": scene.method.algorithm, "splitting": scene.method.splitting, "friction": outer.friction.law,
        "n": n, "m": m, "ranks": world.size, "outer_iterations": len(outer.history),
        "n_A": n_A, "n_A_by_body": by_body, "n_A_by_purpose": counts, "eff": n_A / (2 * m),
        "contact": {"normal_force": finite_or_none(state.normal_force.sum()),
                    "tangential_force": finite_or_none(state.tangential_force.sum()),
                    **{status: state.count(status) for status in ("open", "slip", "stick")}},
        "certificate": {name: finite_or_none(value) for name, value in asdict(answer.certificate).items()},
        "certificate_limit": limit,
        "displacement_max": finite_or_none(answer.displacement_max), "energy": [finite_or_none(e) for e in energy],
        "seconds": {}, "memory_mib": memory,
        "exchange": {"messages": outer.exchange.messages, "bytes": outer.exchange.bytes},
        "solvers": {"body": solver, "qp": body.qp_solver.type}, "hosts": hosts, "versions": versions(),
        "options": PETSc.Options().getAll(), "options_unused": unused, "scene": scene.resolved(),
    }


def _write(world: MPI.Comm, scene: Scene, folder: Path | None, clock: Clock, summary: dict, mesh: Mesh,
           spec: BodySpec, outer: OuterIteration, answer: Answer, figures: bool) -> None:
    """Write all result files; they appear together or not at all. Collective."""
    staging = Staging(folder) if folder else None
    path = world.bcast(staging.path if staging else None)
    sizes = world.allgather((len(mesh.points), len(mesh.triangles)))
    try:
        with clock.phase("output"):
            with agreed(world):
                if staging:
                    staging.create()
                fields = _fields(scene, spec, mesh, answer)
            for rank in range(world.size):
                with agreed(world):
                    if rank == world.rank:
                        write_fields(path, fields, rank, sizes)
            with agreed(world):
                if staging:
                    write_xdmf(path)
                    write_history(path, outer.history)
                    write_interface(path, outer.body.interface, answer.state)
                    write_summary(path, summary)
                    if figures:
                        from ddmpi.figures import draw_all
                        draw_all(path)
        seconds = clock.largest(world)
        with agreed(world):
            if staging:
                write_summary(path, summary | {"seconds": seconds})
                files = staging.publish()
                log.info("results in %s: %s (%.1f s in all)", folder, ", ".join(f.name for f in files),
                         seconds["total"])
    finally:
        if staging:
            staging.discard()


def _fields(scene: Scene, spec: BodySpec, mesh: Mesh, answer: Answer) -> Fields:
    if not scene.output.stress:
        return Fields(mesh.points, mesh.triangles, answer.displacement)
    sigma = stress(mesh, spec.material, answer.displacement)
    return Fields(mesh.points, mesh.triangles, answer.displacement, sigma, von_mises(sigma))


def versions() -> dict[str, str]:
    """Versions of what a result depends on."""
    found = {"ddmpi": ddmpi.__version__, "python": sys.version.split()[0],
             "petsc": ".".join(str(v) for v in PETSc.Sys.getVersion()),
             "mpi": MPI.Get_library_version().split("\n")[0].split(",")[0].strip("\0 ")}
    for name in ("petsc4py", "mpi4py", "numpy", "scipy", "scikit-fem", "gmsh", "meshio", "h5py"):
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:  # Debian's petsc4py carries no metadata
            found[name] = getattr(sys.modules.get(name), "__version__", "unknown")
    return found


def _log_plan(scene: Scene, body: Body, friction: Friction, n: int, figures: bool) -> None:
    interface, method = body.interface, scene.method
    left_out = []
    if friction.law == "none":
        left_out.append("tangential unknowns (no friction)")
    elif len(interface.sliding) < interface.m:
        left_out.append(f"{interface.m - len(interface.sliding)} tangential unknowns (held by clamps)")
    if interface.dropped:
        left_out.append(f"{interface.dropped} contact nodes (clamped)")
    if not interface.gap.any():
        left_out.append("initial gap (all nodes touch)")
    if not scene.output.stress:
        left_out.append("stress (not asked for)")
    if not figures:
        left_out.append("pictures (not asked for)")
    log.info("n = %d unknowns, m = %d contact nodes, friction: %s; A by %s, subproblems by TAO %s",
             n, interface.m, friction.law, body.solver.description,
             "python (MPRGP)" if body.qp_solver.type == "python" else body.qp_solver.type)
    log.info("%s algorithm, splitting %s, theta = %g, tolerance %g; left out: %s",
             method.algorithm, method.splitting, method.theta, method.tolerance, ", ".join(left_out) or "nothing")
    log.info("%5s  %12s  %14s  %6s", "k", "update of λ", "force mismatch", "n_A")


def _report_step(step: Step) -> None:
    log.info("%5d  %12.3e  %14.3e  %6d", step.iteration, step.update, step.mismatch, sum(step.n_A))


def _log_end(summary: dict, answer: Answer, limit: float) -> None:
    contact = summary["contact"]
    log.info("%s after %d outer iterations, n_A = %d; contact nodes: %d open, %d slip, %d stick",
             summary["reason"], summary["outer_iterations"], summary["n_A"],
             contact["open"], contact["slip"], contact["stick"])
    log.info("certificate (limit %.0e): %s", limit,
             ", ".join(f"{name.replace('_', ' ')} {value:.1e}" for name, value in asdict(answer.certificate).items()))
    if summary["options_unused"]:
        log.warning("PETSc options that nothing used: %s", ", ".join(summary["options_unused"]))


def _reason(answer: Answer, limit: float) -> str:
    if answer.certified(limit):
        return "converged and certified"
    if answer.reason == "converged":
        return "the iteration stopped, but its certificate fails"
    return "diverged" if answer.reason == "diverged" else "not converged: method.max_iterations is reached"


def _diagnosis(answer: Answer, outer: OuterIteration, limit: float) -> str:
    last = outer.history[-1]
    message = f"{_reason(answer, limit)} (iteration {last.iteration}, update {last.update:.1e}"
    violations = answer.certificate.violations(limit)
    if answer.reason == "converged":
        return f"{message}; {', '.join(violations)} above {limit:.0e})"
    return f"{message}, asked for {outer.method.tolerance:.0e}); a smaller method.theta may help"
