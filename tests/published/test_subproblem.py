"""A body's QP in the published iteration: which forces its role bounds, and what its contact is moved by."""

from types import SimpleNamespace

import numpy as np
import pytest

from ddmpi.interface.law import CoulombLaw
from ddmpi.published.published import PublishedIteration
from ddmpi.published.subproblem import Subproblem
from ddmpi.sets import Box, Discs

INF = np.inf
LAW = CoulombLaw(2, np.arange(2), 1, np.full(2, 0.3))


def subproblem(role: int, asked: list) -> Subproblem:
    interface = SimpleNamespace(m=2, size=4, law=LAW, gap=np.array([0.5, 0.25]))
    found = Subproblem(SimpleNamespace(C=None, h=np.arange(4.0)), interface, role)

    def solve(qp, s, Cs, *_):
        asked.append(qp.d)
        return SimpleNamespace(s=s, Cs=Cs, steps={})

    found.solver = SimpleNamespace(solve=solve)
    return found


@pytest.mark.parametrize(("algorithm", "role", "lower", "upper"), [
    ("original", 1, [-INF] * 4, [INF] * 4), ("original", 2, [0.0, 0.0, -1.0, -2.0], [INF, INF, 1.0, 2.0]),
    ("modified", 1, [-INF, -INF, -1.0, -2.0], [INF, INF, 1.0, 2.0]), ("modified", 2, [0, 0, -INF, -INF], [INF] * 4)])
def test_each_role_has_the_bounds_of_the_algorithm(algorithm, role, lower, upper):
    box = subproblem(role, []).constraints(np.array([1.0, 2.0]), algorithm)
    assert (box.lower.tolist(), box.upper.tolist()) == (lower, upper)


def test_forces_follow_the_way_that_both_bodies_ask_for():
    """λ moves by θ (w₁ + w₂), not at all where the displacements of both Neumann problems are opposite."""
    iteration, w = SimpleNamespace(method=SimpleNamespace(theta=0.25)), np.array([4.0, -8.0])
    assert PublishedIteration.advance(iteration, w, np.zeros(2)).tolist() == [1.0, -2.0]
    assert PublishedIteration.advance(iteration, np.zeros(2), w).tolist() == [1.0, -2.0]
    assert not PublishedIteration.advance(iteration, w, -w).any()


def test_the_second_role_takes_the_gap():
    """Role 1 is moved by −λ, role 2 by λ less the gap."""
    asked: list[np.ndarray] = []
    for role in (1, 2):
        subproblem(role, asked).solve(np.full(4, 10.0), np.ones(2), 1e-8)
    assert [d.tolist() for d in asked] == [[-10.0, -9.0, -8.0, -7.0], [9.5, 10.75, 12.0, 13.0]]


def test_in_space_friction_is_a_disc_for_one_role_and_nothing_for_the_other():
    """Splitting holds the pressures while both tangential components of a node move in their disc."""
    asked: list[np.ndarray] = []
    law = CoulombLaw(2, np.arange(2), 2, np.full(2, 0.3))
    for algorithm, role in (("original", 2), ("modified", 1), ("original", 1), ("modified", 2)):
        body = subproblem(role, asked)
        body.interface.law = law
        allowed, s = body.constraints(np.array([1.0, 2.0]), algorithm), np.array([5.0, 6.0, 30.0, 40.0, 0.3, 0.4])
        assert (allowed.lower[:2] == (0.0 if role == 2 else -INF)).all()
        whole, tangential = allowed.holding(s, slice(None)), allowed.holding(s, slice(2, None))
        bounded = role == (2 if algorithm == "original" else 1)
        assert isinstance(whole, Discs) == isinstance(tangential, Discs) == bounded
        assert tangential.project(s + 1.0) == pytest.approx(
            [5.0, 6.0, *(np.array([31.0, 41.0]) / np.hypot(31.0, 41.0) if bounded else (31.0, 41.0)), 1.3, 1.4])
        normal = allowed.holding(s, slice(0, 2))
        assert type(normal) is Box
        assert normal.project(s - 7.0).tolist() == [*([0.0, 0.0] if role == 2 else [-2.0, -1.0]), *s[2:]]


def test_splitting_in_space_sweeps_over_pressures_then_over_discs():
    sets: list = []
    body = subproblem(2, [])
    body.interface = SimpleNamespace(m=2, size=6, law=CoulombLaw(2, np.arange(2), 2, np.full(2, 0.3)),
                                     gap=np.zeros(2))
    body.member, body.s, body.Cs = SimpleNamespace(C=None, h=np.zeros(6)), np.zeros(6), np.zeros(6)

    def solve(qp, s, Cs, *_):
        sets.append(type(qp.constraints))
        return SimpleNamespace(s=s, Cs=Cs, steps={})

    body.solver = SimpleNamespace(solve=solve)
    body.solve(np.zeros(6), np.ones(2), 1e-8, split=True)
    body.solve(np.zeros(6), np.ones(2), 1e-8)
    assert sets == [Box, Discs, Discs]
