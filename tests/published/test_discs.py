"""Vectors in discs as a constraint set, and accelerated projected gradients on it against closed forms."""

import logging

import numpy as np
import pytest
from scenes import seldom
from scipy.optimize import brentq
from test_mprgp import Dense, random_matrix

from ddmpi.published.tao import QP, QPResult, QPSolver
from ddmpi.sets import Box, Discs, cone_exit, magnitude


def contact(m: int, radius: np.ndarray) -> Discs:
    """What contact of m nodes in space allows: pressure, and tangential forces in discs."""
    size = 3 * m
    lower = np.where(np.arange(size) < m, 0.0, -np.inf)
    return Discs(lower, np.full(size, np.inf), np.arange(m, size).reshape(m, 2), radius)


def on_discs(
    m: int, condition: float = 100.0, norm: float = 1.0, linear: float = 1.0, seed: int = 0
) -> QP:
    """Some nodes open and some closed, some slip and some stick, one has no friction."""
    matrix, rng = random_matrix(3 * m, condition, seed), np.random.default_rng(seed + 1)
    d = rng.normal(size=3 * m)
    radius = np.median(np.abs(np.linalg.solve(matrix, d))) * rng.uniform(0.05, 1.0, m)
    radius[0] = 0.0
    return QP(Dense(norm * matrix), linear * d, contact(m, radius * (linear / norm)))


def solve(qp: QP, tolerance: float) -> QPResult:
    zero = np.zeros(qp.C.size)
    return QPSolver().solve(qp, zero, zero.copy(), tolerance, "program")


def multipliers(qp: QP, s: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """What the gradient leaves once each bound has taken off what it can hold, and the multipliers of the discs."""
    discs, g = qp.constraints, qp.C.matrix @ s - qp.d
    left = np.where(s <= discs.lower, np.minimum(g, 0.0), g)
    vectors, against = s[discs.entries], -g[discs.entries]
    size = magnitude(vectors)
    on = size >= (1 - 1e-9) * discs.radius
    hold = np.where(
        on & (size > 0),
        np.einsum("kc,kc->k", vectors, against) / np.where(size > 0, size, 1.0) ** 2,
        0.0,
    )
    left[discs.entries] = np.where(
        (discs.radius > 0.0)[:, None], hold[:, None] * vectors - against, 0.0
    )
    return left, hold


def test_projection_is_feasible_to_the_last_bit_and_projects_once():
    rng = np.random.default_rng(0)
    discs = contact(500, rng.uniform(0.0, 1.0, 500))
    for size in (1e-3, 1.0, 1e12):
        x = discs.project(size * rng.normal(size=1500))
        assert np.all(magnitude(x[discs.entries]) <= discs.radius)
        assert np.array_equal(discs.project(x), x)
        assert np.all(x[:500] >= 0.0)


def test_without_a_free_disc_the_set_is_a_box():
    """Where the tangential forces are held, or unbounded, or none: what remains is for all TAO types."""
    x = np.arange(9.0)
    discs = contact(3, np.array([1.0, 2.0, 3.0]))
    assert type(discs.holding(x, slice(0, 3))) is Box
    assert type(contact(3, np.full(3, np.inf)).holding(x, slice(None))) is Box
    assert (
        type(
            Discs(np.zeros(3), np.ones(3), np.empty((0, 2), int), np.empty(0)).holding(
                x[:3], slice(None)
            )
        )
        is Box
    )
    held = discs.holding(x, slice(3, None))
    assert isinstance(held, Discs)
    found = held.project(np.full(9, 7.0))
    assert found[:3].tolist() == [0.0, 1.0, 2.0]
    assert magnitude(found[held.entries]) == pytest.approx([1.0, 2.0, 3.0])


@pytest.mark.parametrize("unit", [1.0, 1e-9, 1e9])
def test_one_disc_in_an_ellipse_of_forces(unit):
    """min ½ sᵀ diag(a, b) s − sᵀ d, |s| ≤ r: s = d / (a + λ, b + λ) with the λ at which |s| = r."""
    a, b, radius, d = 1.0, 0.04, 2.0, np.array([1.0, 3.0])
    lam = brentq(
        lambda lam: np.linalg.norm(d / (np.array([a, b]) + lam)) - radius, 0.0, 100.0, xtol=1e-15
    )
    free = np.full(2, np.inf)
    qp = QP(
        Dense(np.diag([a, b]) / unit),
        d,
        Discs(-free, free, np.array([[0, 1]]), np.array([radius * unit])),
    )
    result = solve(qp, 1e-12)
    assert result.s == pytest.approx(unit * d / (np.array([a, b]) + lam), rel=1e-9)
    assert np.linalg.norm(result.s) == pytest.approx(radius * unit, rel=1e-14)
    qp.constraints.radius[:] = 1e9 * unit
    assert solve(qp, 1e-12).s == pytest.approx(unit * d / [a, b], rel=1e-9)


@pytest.mark.parametrize(
    ("condition", "norm", "linear"), [(10.0, 1.0, 1.0), seldom(1e4, 1e-11, 1e-4), (100.0, 1e6, 1e7)]
)
def test_random_programs_fulfil_the_conditions_of_optimality(condition, norm, linear):
    for seed in range(4):
        qp = on_discs(12, condition, norm, linear, seed)
        tolerance = 1e-9 * linear
        result = solve(qp, tolerance)
        assert result.residual <= 1.01 * tolerance
        assert np.all(magnitude(result.s[qp.constraints.entries]) <= qp.constraints.radius)
        assert np.all(result.s >= qp.constraints.lower)
        left, hold = multipliers(qp, result.s)
        assert np.linalg.norm(left) <= 20 * tolerance
        assert hold.min() >= -1e-6 * norm
        assert 0 < np.count_nonzero(hold) < 12
        assert 0 < np.count_nonzero(result.s[:12]) < 12
        assert np.linalg.norm(qp.C.matrix @ result.s - result.Cs) <= 1e-12 * linear * np.sqrt(36)


def test_a_step_costs_one_product_and_a_start_at_the_answer_none():
    qp = on_discs(20)
    result = solve(qp, 1e-9)
    assert result.iterations == result.steps["gradient"] == qp.C.count["program"] > 0
    again = QPSolver().solve(qp, result.s, result.Cs, 1e-9, "program")
    assert (again.iterations, qp.C.count["program"]) == (0, result.iterations)
    assert np.array_equal(again.s, result.s)


@pytest.mark.parametrize(
    "options",
    [
        {"qp_tao_type": "tron"},
        {"qp_tao_type": "bqpip"},
        {"qp_tao_type": "blmvm"},
        {"qp_tao_type": "python", "qp_tao_python_type": "ddmpi.mprgp.MPRGP"},
        {"qp_tao_type": "python", "qp_tao_python_type": "ddmpi.apg.APG"},
    ],
)
def test_types_that_know_bounds_only_leave_discs_to_projected_gradients(options, petsc_options):
    qp = on_discs(10)
    expected = solve(qp, 1e-9)
    petsc_options(**options)
    found = solve(qp, 1e-9)
    assert found.steps == expected.steps
    assert np.array_equal(found.s, expected.s)


def test_a_long_solve_says_how_far_it_has_come(caplog, monkeypatch):
    monkeypatch.setattr("ddmpi.published.mprgp.TELLING", 10)
    with caplog.at_level(logging.INFO, logger="ddmpi"):
        solve(on_discs(20), 1e-8)
    assert "10 projected gradient steps: residual" in caplog.text


@pytest.mark.parametrize("components", [1, 2])
def test_where_a_step_leaves_the_cone(components):
    """At 1/t the vector has the length of its limit, and it is shorter before; zero where the step stays inside."""
    rng = np.random.default_rng(0)
    limit, more = rng.uniform(0.1, 1.0, (200, 1)), rng.normal(size=(200, 1))
    v, change = rng.normal(size=(200, components)), rng.normal(size=(200, components))
    v *= 0.99 * limit * rng.random((200, 1)) / magnitude(v)[:, None]
    rate = cone_exit(limit, v, more, change)[:, 0]

    def room(t, some):
        return (limit + t * more)[some, 0] - magnitude((v + t * change)[some])

    leaves, t = rate > 0.0, 1.0 / np.where(rate > 0.0, rate, 1.0)[:, None]
    assert 20 < leaves.sum() < 180
    assert np.abs(room(t, leaves) / (1.0 + t[leaves, 0])).max() < 1e-12
    assert (room(0.5 * t, leaves) > 0.0).all() and (room(1e6, ~leaves) > 0.0).all()
