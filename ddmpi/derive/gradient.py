"""The gradient of one result by all that a scene can be differentiated by, and by the gap at every node, from one
solve of the transposed equations."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from contextlib import suppress

import numpy as np
from mpi4py import MPI

from ddmpi.body.elasticity import LoadCase
from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.adjoint import displaced, solve_adjoint
from ddmpi.derive.entries import CLEAR, Entry
from ddmpi.derive.parameters import Parameter, parameter
from ddmpi.derive.results import functional
from ddmpi.errors import InputError, nearest
from ddmpi.interface.state import Answered
from ddmpi.methods.newton import Newton
from ddmpi.scene.derivable import derivable
from ddmpi.scene.results import GRADIENTS, Named, named, results, with_letters
from ddmpi.scene.scene import Settled
from ddmpi.system.agreement import agreed, merged


def gradient(assembly: Assembly, outer: Newton, answer: Answered, result: str) -> Entry:
    """The derivatives of a `result`, such as "contacts.fit.normal_force", by key, and under "gap" by the gap at every
    node (m,) of each contact; of an answer in one load step. By a key None, by a gap NaN, where the answer does not
    follow: where a load drives a motion that is held, or contacts that stick at one node stand against the change.

    Collective. Raises InputError for an unknown result, and SolverError where the equations are not solved precisely.
    """
    world = assembly.world
    if assembly.scene.time:
        raise InputError(
            f"gradient({result!r}): not possible with load steps; set output.derivatives instead"
        )
    with agreed(world):
        given = _named(assembly.scene, result)
    wanted = functional(assembly, answer.states, answer.displacements, given)
    equations = outer.linearisation()
    adjoint = solve_adjoint(assembly, equations, wanted, f"gradient({result!r})")
    w, q, ((fields, moved),) = adjoint.w, adjoint.q, displaced(assembly, [adjoint])
    barred, _ = equations.unseen(transposed=True)
    hindered = _hindered(assembly, barred)
    found, known = list[float](), list[str]()
    pulls, stops = list[np.ndarray](), list[np.ndarray]()
    for one in _parameters(assembly):
        known.append(one.key)
        # what γ and changes of bounds add at given forces; around loads and motions, the work of w
        along = equations.along_slip(one.bounds(assembly, equations.point.s))
        total = float(q @ along + w @ (one.driven - one.opening))
        for name in wanted.bounds.keys() & one.law.keys():
            law, s = one.law[name], equations.point.s[assembly.space.parts[name]]
            total += float(wanted.bounds[name] @ (law.bound_at(s) + law.bound_at(0.0 * s)))
        cases = one.load(assembly, answer.displacements, 1.0)
        for name, case in cases.items():
            loads, moves = case.f + case.heat, moved[name] * case.prescribed
            total += float((fields[name] * (loads - case.taken) + moves).sum())
            if name == wanted.body:
                total -= float(loads[:, wanted.axis].sum())
        if world.rank == 0:
            total += float(adjoint.beta @ one.force)
            if one.moved and one.moved[0] == wanted.partner:
                total += float(one.moved[1][wanted.axis])
        found.append(total)
        pulls.append(_pull(assembly, one, cases))
        stops.append(hindered(one, cases))
    gaps = _by_gaps(assembly, w, barred)
    told = zip(known, _told(assembly, found, pulls, stops), strict=True)
    return Entry(told, gap=Entry(merged(world, gaps)))


def _told(
    assembly: Assembly, found: list[float], pulls: list[np.ndarray], stops: list[np.ndarray]
) -> list[float | None]:
    """The sums of derivatives over the ranks, None where loads drive a motion that is held, and where contacts stand
    against a change. Collective."""
    world, stays = assembly.world, assembly.joint.stays
    totals = world.allreduce(np.array(found)).tolist()
    works, sizes = world.allreduce(np.array(stops).reshape(-1, 2)).T
    barred = np.abs(works) > CLEAR * sizes
    if stays.held.size:
        driving = world.allreduce(np.array(pulls))
        barred |= np.array([bool(stays.drives(pull)) for pull in driving], bool)
    return [None if no else total for no, total in zip(barred, totals, strict=True)]


def _pull(assembly: Assembly, one: Parameter, cases: Mapping[str, LoadCase]) -> np.ndarray:
    """The change (rigid.size,) of loads along rigid motions by a parameter with these load cases by body, this rank's
    part (N). Not collective."""
    pull, slices = np.where(assembly.world.rank == 0, 1.0, 0.0) * one.force, assembly.joint.slices
    for body in assembly.bodies:
        if body.spec.name in cases:
            pull[slices[body.spec.name]] += body.member.body.push(cases[body.spec.name])
    return pull


def _parameters(assembly: Assembly) -> Iterator[Parameter]:
    """By what the answer can be differentiated, but for clamps that cannot change alone. Collective."""
    for key in derivable(assembly.scene.resolved()):
        one = None
        with suppress(InputError):
            one = parameter(assembly, key)
        if assembly.world.allreduce(one is not None, MPI.LAND):
            assert one is not None
            yield one


def _by_gaps(assembly: Assembly, w: np.ndarray, barred: np.ndarray) -> dict[str, np.ndarray]:
    """By contact of this rank the derivatives (m,) by the gaps of its nodes, of which those `barred` have none."""
    return {
        met.name: np.where(barred[part] == 0.0, -met.scale * w[part], np.nan)[: met.m]
        for met, part in assembly.space.with_slices()
    }


def _hindered(
    assembly: Assembly, barred: np.ndarray
) -> Callable[[Parameter, Mapping[str, LoadCase]], np.ndarray]:
    """The work of the forces `barred` (size,) on the motions of a parameter with its load cases by body, and the size of
    its terms (2,), of this rank. Where the first is not zero, contacts that stick at one node stand against the change,
    and the answer does not follow it. Not collective, but for the construction."""
    parts = assembly.joint.exchange.spread(barred)
    pulls = {
        body.spec.name: body.member.pull(part)
        for body, part in zip(assembly.bodies, parts, strict=True)
    }

    def hindered(one: Parameter, cases: Mapping[str, LoadCase]) -> np.ndarray:
        terms = [barred * (one.driven - one.opening)]
        for name, case in cases.items():
            terms.append((pulls[name] * case.prescribed).ravel())
        return np.array(
            [sum(term.sum() for term in terms), sum(np.abs(term).sum() for term in terms)]
        )

    return hindered


def _named(scene: Settled, result: str) -> Named:
    """The parts of the name of a result. Raises InputError where it has no gradient."""
    same, able = with_letters(result), list(results(scene, GRADIENTS))
    if same in able:
        return named(same)
    if same.startswith("bodies") and scene.axisymmetric and same.endswith(".reaction.x"):
        raise InputError(
            f"gradient({result!r}): radial reactions of axisymmetric bodies have none; take y"
        )
    near = nearest(same, able) or f" (such as {able[0]!r})"
    raise InputError(f"gradient({result!r}): there is no such result{near}")
