"""The adjoint problem of a result: what loads and gaps everywhere do to it."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ddmpi.body.elasticity import LoadCase
from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.entries import CLEAR, ENOUGH
from ddmpi.derive.parameters import loaded
from ddmpi.derive.results import Functional
from ddmpi.errors import SolverError
from ddmpi.methods.linear import AIM, PURPOSE, Linearisation
from ddmpi.system.agreement import agreed


class VagueError(SolverError):
    """No equation determines the result: contacts share a force at a node."""


class Adjoint(NamedTuple):
    """The answer to the transposed equations, of which dJ = w·ρ + β·de + q·γ.

    Attributes
    ----------
    w, q : (size,) the work of forces on changes of gaps ρ, and what forces γ beyond the law add
    beta : (rigid.size,) motions
    by_forces, along : (size,) and (rigid.size,) the derivatives of the result by contact forces and by motions
    loads : by body of this rank the loads of the result
    """

    w: np.ndarray
    q: np.ndarray
    beta: np.ndarray
    by_forces: np.ndarray
    along: np.ndarray
    loads: dict[str, LoadCase]


def solve_adjoint(
    assembly: Assembly,
    equations: Linearisation,
    wanted: Functional,
    about: str,
    aim: float = AIM,
) -> Adjoint:
    """The adjoint of a result, solved to the relative residual `aim`. Collective. Raises SolverError where GMRES does not
    reach it by far, and where no equation determines the result; `about` begins the message."""
    space, joint = assembly.space, assembly.joint
    a, free = wanted.motions + joint.rigid.sums(wanted.moves), list[np.ndarray]()
    cases = {}
    with joint.exchange.deferred():
        for body in assembly.bodies:
            name, h = body.spec.name, np.zeros(body.member.size)
            load = wanted.loads.get(name, 0.0 * body.mesh.points)
            cases[name] = loaded(body.member.elasticity, load)
            if load.any():  # u = A⁻¹(f − Bᵀ s) + R α
                h, _ = body.member.response_to(cases[name], PURPOSE)
            free.append(h)
    j = wanted.forces
    if space.any(wanted.moves):  # d(closed) = ρ + Z dα − C ds
        j = j - joint.product(wanted.moves, PURPOSE, aim)
    j = j - joint.exchange.total(free, "load of a result")
    along = [body.member.body.push(cases[body.spec.name]) for body in assembly.bodies]
    a = a + joint.of_all(along, [np.zeros(len(each.push)) for each in joint.driven])
    _refuse_vague(equations, j, about)
    z, beta, residual = equations.adjoint(j, a, aim)
    if residual > max(ENOUGH, ENOUGH / AIM * aim):
        raise SolverError(f"{about}: GMRES does not solve the equations to {ENOUGH:.0e}")
    w = z + wanted.moves
    q = j - (joint.product(z, PURPOSE, aim) if space.any(z) else 0.0) - joint.rigid.spread(beta)
    return Adjoint(w, q, beta, wanted.forces, a, cases)


Moved = dict[str, np.ndarray]
"""By body of this rank, (nv, d)."""


def displaced(
    assembly: Assembly, adjoints: Sequence[Adjoint], aim: float = AIM
) -> list[tuple[Moved, Moved]]:
    """Of each adjoint the displacements under its forces, motions and loads, and Bᵀ w with these loads. Collective."""
    joint = assembly.joint
    parts = [joint.exchange.spread(adjoint.w) for adjoint in adjoints]
    found: list[tuple[Moved, Moved]] = [({}, {}) for _ in adjoints]
    with agreed(assembly.world):
        for k, body in enumerate(assembly.bodies if adjoints else ()):
            name, forces = body.spec.name, [of_bodies[k] for of_bodies in parts]
            cases = [adjoint.loads[name] for adjoint in adjoints]
            motions = [adjoint.beta[joint.slices[name]] for adjoint in adjoints]
            member = body.member.loaded_by(cases[0])
            fields = member.displacements(cases, [-w for w in forces], motions, PURPOSE, aim)
            for (of_fields, moved), field, case, w in zip(
                found, fields, cases, forces, strict=True
            ):
                of_fields[name], moved[name] = field, case.f - member.pull(w)
    return found


def _refuse_vague(equations: Linearisation, j: np.ndarray, about: str) -> None:
    """Raise VagueError, on all ranks, for a result whose derivative j (size,) by forces no equation determines.
    Collective."""
    unseen, _ = equations.unseen()
    change, size = equations.joint.space.add(np.array([j @ unseen, np.abs(j) @ np.abs(unseen)]))
    if abs(change) > CLEAR * size:
        raise VagueError(
            f"{about}: it depends on forces of several contacts at one node, of which only the sum is determined"
        )
