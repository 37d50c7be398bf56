"""Steps of the published iteration and of its acceleration, on one rank, by dense matrices where all nodes stick."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import prepare_scene, rectangle

from ddmpi.methods.outer import Step
from ddmpi.published.anderson import AndersonIteration
from ddmpi.published.published import PublishedIteration
from ddmpi.run.solve import solve
from ddmpi.scene.method import Method


def pressed(young: float = 3e9) -> dict:
    """Two blocks that are pressed together, with a bound on friction that no node reaches; the first one `young`."""
    top = [{"on": "top", "x": 2e-4, "y": -6e-3}]
    upper = rectangle("upper", (0.0, 1.0), (1.5, 1.0), (3, 2), young=young, clamp=top)
    lower = rectangle("lower", (0.0, 0.0), (1.5, 1.0), (3, 2), young=1e9, clamp=["bottom"])
    upper["traction"] = [{"on": "right", "value": [2e5, -1e5]}]
    friction = {"law": "tresca", "slip_bound": 1e9}
    contact = {"bodies": ["upper", "lower"], "on": ["bottom", "top"], "friction": friction}
    return {"body": [upper, lower], "contact": [contact]}


def dense(iteration: PublishedIteration) -> tuple[list[np.ndarray], list[np.ndarray]]:
    """Compliances and free displacements of both roles."""
    members = [body.member for body in sorted(iteration.subproblems, key=lambda one: one.role)]
    found = []
    for member in members:
        columns = []
        for unit in np.eye(len(member.h)):
            column = np.empty(len(unit))
            member.C.mult(unit, column, "newton")
            columns.append(column)
        found.append(np.array(columns).T)
    return found, [member.h for member in members]


def pushed(C: np.ndarray, d: np.ndarray, m: int) -> np.ndarray:
    """The forces with C s = d, whose m normal ones push: nodes that would pull are open, and their gaps are none."""
    for number in range(2**m):
        shut = np.append([number >> k & 1 == 0 for k in range(m)], np.ones(len(d) - m, bool))
        s = np.zeros(len(d))
        s[shut] = np.linalg.solve(C[np.ix_(shut, shut)], d[shut])
        if (s[:m] >= 0.0).all() and ((C @ s - d)[~shut] >= 0.0).all():
            return s
    raise AssertionError("there is always one")


def test_a_step_is_that_of_dense_matrices():
    """C₁ s₁ = h₁ − λ, C₂ s₂ = h₂ + λ where it pushes, and λ moves by ½ θ (C₁ + C₂) (s₁ − s₂)."""
    given = Method(outer="relaxation", tolerance=1e-8, theta=0.2, inner_precision="fixed")
    answer = solve(prepare_scene(MPI.COMM_SELF, pressed()), given)
    assert answer.certified
    outer = answer.outer
    assert type(outer) is PublishedIteration
    (C1, C2), (h1, h2) = dense(outer)
    lam, told = np.zeros(len(h1)), []
    for k in range(len(outer.history)):
        s1, s2 = np.linalg.solve(C1, h1 - lam), pushed(C2, h2 + lam, outer.interface.m)
        update = 0.1 * (C1 + C2) @ (s1 - s2)
        lam = lam + update
        mismatch = np.linalg.norm(s1 - s2) / np.linalg.norm(s2) if s2.any() else 1.0
        told.append((k + 1, np.linalg.norm(update) / np.linalg.norm(lam), mismatch))
    steps = np.array([step[:3] for step in outer.history])
    assert len(steps) > 10
    assert steps[:8] == pytest.approx(np.array(told)[:8], rel=1e-5)
    assert steps[-1, 1] <= 1e-8 < steps[-2, 1]
    products = [step.n_A for step in outer.history]
    assert products == sorted(products) and products[-1] <= answer.outer.inner_steps["cg"] * 9
    exact = np.linalg.solve(C1 + C2, h1 + h2)
    assert outer.forces == pytest.approx(exact, abs=1e-6 * np.abs(exact).max())
    assert outer.lam == pytest.approx(h1 - C1 @ exact, abs=1e-7 * np.abs(lam).max())
    assert np.abs(outer.mismatch).max() <= 1e-6 * np.abs(exact).max()


@pytest.mark.parametrize("young", [3e9, 0.2e9])
def test_accelerated_steps_end_as_soon_as_the_linear_map_allows(young):
    """The stiffer body takes the first role; steps of a linear map are no more than its unknowns and a few."""
    assembly = prepare_scene(MPI.COMM_SELF, pressed(young))
    answer = solve(assembly, Method(outer="anderson", tolerance=1e-8))
    outer = answer.outer
    assert answer.certified and type(outer) is AndersonIteration
    first = next(body for body in outer.subproblems if body.role == 1)
    assert first.member.name == ("upper" if young > 1e9 else "lower")
    (C1, C2), (h1, h2) = dense(outer)
    exact = np.linalg.solve(C1 + C2, h1 + h2)
    assert outer.forces == pytest.approx(exact, abs=1e-6 * np.abs(exact).max())
    plain = solve(assembly, Method(outer="relaxation", theta=0.2, tolerance=1e-8))
    assert len(outer.history) <= min(len(exact) + 2, len(plain.outer.history) - 1)


def test_the_acceleration_minimises_the_residual_of_earlier_steps():
    """Of a linear map in two unknowns the third step is where the residual vanishes; a residual that grows twofold, or
    more, makes the memory begin anew."""
    iteration = object.__new__(AndersonIteration)
    iteration._weights, iteration._lams, iteration._residuals = (0.3, 0.7), [], []
    iteration._smallest, iteration.lam = np.inf, np.zeros(2)
    A, b = np.array([[0.9, 0.2], [-0.1, 0.4]]), np.array([1.0, -2.0])

    def step() -> np.ndarray:
        """Weights and the factor 4 make the residual b − A λ of both displacements."""
        f = b - A @ iteration.lam
        w1 = 0.25 * f / 0.3**2
        update = iteration.advance(0.4 * w1, 0.6 * w1 * 0.3**2 / 0.7**2)
        iteration.lam = iteration.lam + update
        return f

    first = step()
    assert iteration.lam == pytest.approx(0.5 * b)
    step()
    step()
    assert np.linalg.norm(b - A @ iteration.lam) < 1e-10 * np.linalg.norm(first)
    assert len(iteration._lams) == 3
    iteration.lam = np.array([50.0, 70.0])
    far = b - A @ iteration.lam
    step()
    assert len(iteration._lams) == 1 and iteration._smallest == pytest.approx(np.linalg.norm(far))
    assert iteration.lam == pytest.approx([50.0, 70.0] + 0.5 * far)


def test_an_iteration_goes_on_from_its_state():
    """With the forces, the memory and the steps that were kept."""
    assembly = prepare_scene(MPI.COMM_SELF, pressed())
    done = solve(assembly, Method(outer="anderson", tolerance=1e-8)).outer
    state = done.state()
    assert state["history"] == tuple(done.history) and len(state["lams"]) > 1
    other = solve(assembly, Method(outer="anderson", tolerance=1e-2)).outer
    assert len(other.history) < len(done.history)
    other.restore(state)
    assert other.history == done.history and type(other.history[0]) is Step
    for name in ("lam", "s1", "s2", "_bound", "_lams", "_residuals"):
        assert np.array_equal(getattr(other, name), getattr(done, name)), name
    assert other._smallest == done._smallest and other._step_size == done._step_size
