"""The derivatives of an answer, from one load step to the next.

A load step takes from those before it where slip begins, and the slip bounds at its beginning for the work of friction:
their derivatives are all that goes on. Everything is collective.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import Any, Protocol

import numpy as np

from ddmpi.body.elasticity import LoadCase
from ddmpi.coupling.assembly import Assembly
from ddmpi.derive.entries import Entry, determined, entries_of
from ddmpi.derive.parameters import Parameter, parameter
from ddmpi.errors import naming
from ddmpi.interface.law import Law
from ddmpi.interface.state import Answered, ContactState, slip_start_change
from ddmpi.methods.linear import PURPOSE
from ddmpi.methods.newton import Newton
from ddmpi.methods.outer import Outer
from ddmpi.sets import magnitude
from ddmpi.system.agreement import agreed
from ddmpi.system.numbers import divisor

DRIVEN = "it drives a motion that nothing but the errors of meshes resists"

Derived = dict[str, np.ndarray]
"""Of each parameter p: forces ``s`` (p, size), relative displacements less gaps ``closed`` (p, size), motions ``alpha``
(p, rigid.size), work of friction so far ``dissipated`` (p, nc) at the contacts of this rank, how far the parameter may
fall and rise ``until`` (p, 2) a status changes, and the largest ``residual`` (p,) so far; the forces ``unseen``
(p, size) that no equation determines (`Linearisation.unseen`), and whether the work of friction ever depended on such
forces, ``vague`` (p, nc), 0 or 1."""


class Mark(Protocol):
    """The end of a load step: time, forces (size,), relative displacements less gaps (size,), their derivatives."""

    time: float
    s: np.ndarray
    derived: Derived

    @property
    def closed(self) -> np.ndarray: ...


class Chain:
    """The derivatives of the answers of an assembly by some valid `keys` of its scene, maybe none.

    `driving` has, by key whose load drives a motion that is held, why there is no derivative. Construction raises
    InputError, on all ranks, where a clamp cannot change alone.
    """

    def __init__(self, assembly: Assembly, keys: list[str]) -> None:
        self.assembly, self.parameters, self.driving = assembly, list[Parameter](), dict[str, str]()
        with agreed(assembly.world):
            for key in keys:
                with naming(f"output.derivatives: {key}"):
                    self.parameters.append(parameter(assembly, key))

    def first(self, time: float = 0.0) -> Derived:
        """Before the first load step, at time 0; empty without keys."""
        space, number = self.assembly.space, len(self.parameters)
        if not number:
            return {}
        factors = self.assembly.scene.factors(time)
        return {
            "s": np.zeros((number, space.size)),
            "closed": np.array([-factors[one.history] * one.opening for one in self.parameters]),
            "alpha": np.zeros((number, self.assembly.joint.rigid.size)),
            "dissipated": np.zeros((number, len(space.interfaces))),
            "residual": np.zeros(number),
            "unseen": np.zeros((number, space.size)),
            "vague": np.zeros((number, len(space.interfaces))),
            "until": np.tile([-np.inf, np.inf], (number, 1)),
        }

    def advance(
        self,
        time: float,
        outer: Outer,
        answer: Answered,
        now: Mark | None = None,
        before: Mark | None = None,
        drawn: float | None = None,
    ) -> Derived:
        """The derivatives at the end of a load step, of the `answer` of `outer`. `now` and `before` are the beginnings
        of the step and of the step before; None without load steps. `drawn` is its time in the histories, if another.
        """
        space = self.assembly.space
        joint = self.assembly.joint
        since = now.derived if now else self.first(time)
        if not since:
            return {}
        assert isinstance(outer, Newton)
        factors = self.assembly.scene.factors(time if drawn is None else drawn)
        equations = outer.linearisation()
        s, former = equations.point.s, now.s if now else np.zeros(space.size)
        unseen, _ = equations.unseen()
        rows = list[dict[str, Any]]()
        for k, one in enumerate(self.parameters):
            start = self._start(k, time, now, before) if now and before else np.zeros(space.size)
            rho, de = self._changes(k, factors, answer.displacements)
            drives = joint.stays.drives(de)
            if drives:
                self.driving[one.key] = DRIVEN
            bounds, former_bounds = (one.bounds(self.assembly, forces) for forces in (s, former))
            # motions that stay are those of the step before, and so are their derivatives
            kept = since["alpha"][k] - joint.stays.moving(since["alpha"][k])
            changed = equations.direct(
                rho + joint.rigid.spread(kept) - start,
                joint.stays.moving(de),
                equations.along_slip(bounds),
            )
            fall, rise = equations.until(changed, bounds)
            work = [
                _rubbed(
                    answer.states[interface.name],
                    interface.law,
                    changed.r[part],
                    _follows(interface.law, s[part], changed.s[part]) + bound,
                    _follows(interface.law, former[part], since["s"][k, part]) + former_bound,
                )
                for (interface, part), bound, former_bound in zip(
                    space.with_slices(), bounds, former_bounds, strict=True
                )
            ]
            vague = self._vague(answer, (s, unseen), (former, since["unseen"][k]))
            rows.append(
                {
                    "s": changed.s,
                    "unseen": unseen,
                    "vague": np.maximum(vague, since["vague"][k]),
                    "closed": start - changed.r,
                    "alpha": changed.alpha + kept,
                    "dissipated": since["dissipated"][k] + np.array(work),
                    "residual": np.inf if drives else max(changed.residual, since["residual"][k]),
                    "until": [max(fall, since["until"][k, 0]), min(rise, since["until"][k, 1])],
                }
            )
        return {name: np.array([row[name] for row in rows]) for name in since}

    def entries(
        self, time: float, derived: Derived, answer: Answered
    ) -> tuple[dict[str, Entry | None], dict[str, Entry], dict[str, str]]:
        """The derivatives of results as `entries_of` has them, empty without keys; and `driving`."""
        if not derived:
            return {}, {}, {}
        entries = entries_of(
            self.assembly,
            self.parameters,
            derived,
            self.assembly.scene.factors(time),
            answer.displacements,
            answer.states,
        )
        return *entries, self.driving

    def _vague(self, answer: Answered, *forces: tuple[np.ndarray, np.ndarray]) -> list[bool]:
        """`_vague` of each contact of this rank, with its parts of `forces`, pairs of (size,)."""
        return [
            _vague(
                answer.states[interface.name],
                interface.law,
                *((s[part], unseen[part]) for s, unseen in forces),
            )
            for interface, part in self.assembly.space.with_slices()
        ]

    @cached_property
    def _responses(self) -> list[tuple[np.ndarray, np.ndarray]]:
        """Of each parameter `_response` at the factor 1 of its history; zero where it is no load or clamp."""
        return [
            self._response({} if one.case is None else {one.body: one.case})
            for one in self.parameters
        ]

    def _response(self, cases: Mapping[str, LoadCase]) -> tuple[np.ndarray, np.ndarray]:
        """h (size,) in metres and e (rigid.size,) in newtons of load cases of this rank's bodies by name."""
        joint = self.assembly.joint
        parts = [(np.zeros(member.size), np.zeros(len(member.e))) for member in joint.members]
        with joint.exchange.deferred():
            parts = [
                member.response_to(cases[member.name], PURPOSE) if member.name in cases else none
                for member, none in zip(joint.members, parts, strict=True)
            ]
        h = joint.exchange.total([part for part, _ in parts], "load of a derivative")
        return h, joint.of_all(
            [e for _, e in parts], [np.zeros(len(each.push)) for each in joint.driven]
        )

    def _changes(
        self, k: int, factors: Mapping[str | None, float], u: Mapping[str, np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """ρ (size,) in metres and de (rigid.size,) in newtons of the k-th parameter, at these factors by history and
        displacements of this rank's bodies."""
        one, (h, e) = self.parameters[k], self._responses[k]
        factor = factors[one.history]
        rho, de = factor * (h + one.driven - one.opening), factor * (e + one.force)
        if one.young is not None:  # its load follows from the answer
            rho = rho + self._response(one.load(self.assembly, u, factor))[0]
        return rho, de

    def _start(self, k: int, time: float, now: Mark, before: Mark) -> np.ndarray:
        """The derivative (size,) of where slip begins in the step to `time`, by the k-th parameter (m)."""
        span = now.time - before.time  # zero at a turning point
        share = (time - now.time) / span if span else 0.0
        closed = np.stack([now.closed, now.derived["closed"][k]])
        rate = closed - [before.closed, before.derived["closed"][k]]
        start = np.zeros(len(now.s))
        for interface, part in self.assembly.space.with_slices():
            start[part] = slip_start_change(
                interface.law, now.s[part], closed[:, part], rate[:, part], share
            )
        return start


def _follows(law: Law, s: np.ndarray, ds: np.ndarray) -> np.ndarray:
    """The changes (mt,) of slip bounds that follow the forces s (size,) (N)."""
    return (
        law.slope(np.maximum(s[: law.m], 0.0))
        * np.where(s[: law.m] > 0.0, ds[: law.m], 0.0)[law.sliding]
    )


def _vague(state: ContactState, law: Law, *forces: tuple[np.ndarray, np.ndarray]) -> bool:
    """Whether the work of friction depends on forces that no equation determines: (s, unseen), each (size,), now and at
    the beginning of the step."""
    slips = np.asarray(state.status)[law.sliding] == "slip"
    weights = np.where(slips, magnitude(state.slip[law.sliding]), 0.0)
    return any(not determined(weights * _follows(law, s, unseen)) for s, unseen in forces)


def _rubbed(
    state: ContactState, law: Law, dr: np.ndarray, dnew: np.ndarray, dold: np.ndarray
) -> float:
    """The derivative of `ContactState.dissipated`, the sum of ½ (g_n + g_n−1) |u_t| over the nodes that slip, from
    those of r (size,) in metres and of the bounds (mt,) in newtons."""
    slip = state.slip[law.sliding]
    resistance = np.broadcast_to(state.resistance, state.gap.shape)[law.sliding]
    size, rubs = magnitude(slip), resistance > 0.0
    longer = (slip * -law.split(dr)[1]).sum(axis=1) / divisor(size)
    return float((resistance * longer + 0.5 * (dnew + dold) * size)[rubs].sum())
