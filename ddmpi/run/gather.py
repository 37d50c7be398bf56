"""The summary of a run, gathered from all ranks."""

from __future__ import annotations

import numpy as np
from petsc4py import PETSc

from ddmpi.body.estimate import DiscretizationError
from ddmpi.coupling.assembly import Assembly
from ddmpi.judge.accuracy import MeshLadder
from ddmpi.petsc.options import unused_options
from ddmpi.results.fields import Fields
from ddmpi.results.summary import BodyResult, ContactResult, RunResult, summarize
from ddmpi.run.solve import Solution
from ddmpi.system.provenance import peak_memory, provenance


def gather_summary(assembly: Assembly, solution: Solution, error: DiscretizationError, fields: Fields,
                   ladder: MeshLadder, warnings: list[str], started: float) -> dict:
    """All of summary.json but the times, on every rank. Collective.

    Parameters
    ----------
    error, fields : of the rank's own body
    ladder : the meshes that led here
    warnings : of the scene and of the answer
    started : as for `provenance`
    """
    world, scene, outer = assembly.world, assembly.scene, solution.outer
    everyone = world.allgather(_body(assembly, solution, error, fields))
    bodies = [body for body, _ in everyone]
    unused = sorted(set.intersection(*(set(left) for _, left in everyone)))
    inner = [sum(body.inner_steps.values()) for body in bodies]
    published = scene.method.outer != "newton"
    rescued = any(body.n_A_by_purpose.get("approximation") for body in bodies)
    run = RunResult(
        converged=solution.certified and not ladder.missed,
        reason=(solution.certified and ladder.missed) or solution.reason, order=assembly.spec.mesh.order,
        ranks=world.size, outer_iterations=len(outer.history), inner_iterations=sum(inner) if published else inner[0],
        certificate_limit=solution.limit, energy_norm=error.relative,
        levels=[level._asdict() for level in ladder.levels],
        exchange=assembly.exchange.state(), qp=outer.qp_type if published or rescued else "none",
        options=PETSc.Options().getAll(), options_unused=unused, warnings=warnings)
    contacts = [ContactResult(state, solution.certificate.of_contact(name))
                for name, state in solution.contacts.items()]
    return summarize(scene.resolved(), run, bodies, contacts) | provenance(world, started)


def _body(assembly: Assembly, solution: Solution, error: DiscretizationError, fields: Fields,
          ) -> tuple[BodyResult, list[str]]:
    """What there is to say of the own body, and the PETSc options that its rank has not used. Collective."""
    member, name = assembly.member, assembly.spec.name
    memory = peak_memory(assembly.world)
    contact = sum((state.force if state.interface.side(name) == 0 else -state.force
                   for state in solution.contacts.values() if name in state.interface.bodies), np.zeros(2))
    place = assembly.world.rank
    return BodyResult(
        name=name, n=member.elasticity.n, ranks=[place], held=True,
        displacement_max=solution.displacement_max[name],
        von_mises_max=None if fields.von_mises is None else float(fields.von_mises.max()),
        energy=error.own.energy / 2,  # of the stresses: free of what moves the body without strain
        reaction=-(member.elasticity.resultant + contact), discretization_error=error.by_body[place],
        equilibrium=solution.certificate.equilibrium[name], n_A_by_purpose=dict(member.C.count),
        inner_steps=dict(solution.outer.inner_steps), solver=member.C.solver.description, compliance=member.C.kind,
        memory_mib=memory[place]), unused_options()
