"""The summary of a run, gathered from all ranks."""

from __future__ import annotations

import itertools

import numpy as np
from petsc4py import PETSc

from ddmpi.body.estimate import DiscretizationError
from ddmpi.coupling.assembly import Assembly, Body
from ddmpi.coupling.ranks import team_of
from ddmpi.judge.accuracy import MeshLadder
from ddmpi.petsc.options import unused_options
from ddmpi.results.fields import Fields
from ddmpi.results.summary import BodyResult, ContactResult, RunResult, summarize
from ddmpi.run.solve import Solution
from ddmpi.system.provenance import peak_memory, provenance


def gather_summary(assembly: Assembly, solution: Solution, error: DiscretizationError, fields: dict[str, Fields],
                   ladder: MeshLadder, warnings: list[str], started: float) -> dict:
    """All of summary.json but the times, on every rank. Collective.

    Parameters
    ----------
    error, fields : of the rank's own bodies
    ladder : the meshes that led here
    warnings : of the scene and of the answer
    started : as for `provenance`
    """
    world, scene, outer = assembly.world, assembly.scene, solution.outer
    team = team_of(world)
    ranks = team.ranks if team else [world.rank]
    memory = team.do("peak") if team else peak_memory()
    own = [(body.number, _body(assembly, body, solution, error, fields[body.spec.name], ranks, memory))
           for body in assembly.bodies]
    everyone = world.allgather((own, unused_options(), sum(outer.inner_steps.values()), assembly.exchange.state()))
    bodies = [body for _, body in sorted(itertools.chain(*(each for each, *_ in everyone)), key=lambda pair: pair[0])]
    unused = sorted(set.intersection(*(set(left) for _, left, *_ in everyone)))
    inner = [steps for _, _, steps, _ in everyone]
    sent = [counts for *_, counts in everyone]
    published = scene.method.outer != "newton"
    rescued = any(body.n_A_by_purpose.get("approximation") for body in bodies)
    run = RunResult(
        converged=solution.certified and not ladder.missed,
        reason=(solution.certified and ladder.missed) or solution.reason, order=scene.body[0].mesh.order,
        ranks=world.allreduce(len(ranks)), outer_iterations=len(outer.history),
        inner_iterations=sum(inner) if published else inner[0],
        certificate_limit=solution.limit, energy_norm=error.relative,
        levels=[level._asdict() for level in ladder.levels],
        exchange={name: max(counts[name] for counts in sent) for name in sent[0]},
        qp=outer.qp_type if published or rescued else "none",
        options=PETSc.Options().getAll(), options_unused=unused, warnings=warnings,
        undetermined=solution.undetermined)
    contacts = [ContactResult(state, solution.certificate.of_contact(name))
                for name, state in solution.contacts.items()]
    return summarize(scene.resolved(), run, bodies, contacts) | provenance(world, started)


def _body(assembly: Assembly, body: Body, solution: Solution, error: DiscretizationError, fields: Fields,
          ranks: list[int], memory: float) -> BodyResult:
    """What there is to say of a body of this rank; its `ranks` have held up to `memory` MiB. Not collective."""
    member, name = body.member, body.spec.name
    contact = sum((state.force if state.interface.side(name) == 0 else -state.force
                   for state in solution.contacts.values() if name in state.interface.bodies), np.zeros(2))
    return BodyResult(
        name=name, n=member.elasticity.n, ranks=ranks, held=member.elasticity.held,
        displacement_max=solution.displacement_max[name],
        von_mises_max=None if fields.von_mises is None else float(fields.von_mises.max()),
        energy=error.own[name].energy / 2,  # of the stresses: free of what moves the body without strain
        reaction=-(member.elasticity.resultant + contact), discretization_error=error.by_body[name],
        equilibrium=solution.certificate.equilibrium[name], n_A_by_purpose=dict(member.C.count),
        inner_steps=dict(solution.outer.inner_steps), solver=member.C.solver.description, compliance=member.C.kind,
        memory_mib=memory)
