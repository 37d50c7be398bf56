"""A body's QP in the published iteration: which forces its role bounds, and what its contact is moved by."""

from types import SimpleNamespace

import numpy as np
import pytest

from ddmpi.interface.law import CoulombLaw
from ddmpi.published.published import PublishedIteration, Subproblem

INF = np.inf
LAW = CoulombLaw(2, np.arange(2), 1, np.full(2, 0.3))


def subproblem(role: int, asked: list, algorithm: str = "original") -> Subproblem:
    interface = SimpleNamespace(m=2, size=4, law=LAW, gap=np.array([0.5, 0.25]))
    found = Subproblem(SimpleNamespace(C=None, h=np.arange(4.0)), interface, role, algorithm)

    def solve(qp, s, Cs, *_):
        asked.append(qp.d)
        return SimpleNamespace(s=s, Cs=Cs, steps={})

    found.solver = SimpleNamespace(solve=solve)
    return found


@pytest.mark.parametrize(
    ("algorithm", "role", "lower", "upper"),
    [
        ("original", 1, [-INF] * 4, [INF] * 4),
        ("original", 2, [0.0, 0.0, -1.0, -2.0], [INF, INF, 1.0, 2.0]),
        ("modified", 1, [-INF, -INF, -1.0, -2.0], [INF, INF, 1.0, 2.0]),
        ("modified", 2, [0, 0, -INF, -INF], [INF] * 4),
    ],
)
def test_each_role_has_the_bounds_of_the_algorithm(algorithm, role, lower, upper):
    box = subproblem(role, [], algorithm).constraints(np.array([1.0, 2.0]))
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
