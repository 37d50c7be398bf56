"""Quadratic programs with bounds: MPRGP and PETSc's types against exact solutions; products are counted."""

import numpy as np
import pytest
from scipy.optimize import lsq_linear

from ddmpi.errors import SolverError
from ddmpi.petsc.lanczos import estimate_norm
from ddmpi.published.tao import GRADIENT_ROUNDING, QP, QPResult, QPSolver
from ddmpi.sets import Box


class Dense:
    """A dense operator that counts its products, as `Compliance` does."""

    def __init__(self, matrix: np.ndarray) -> None:
        self.matrix, self.size = matrix, len(matrix)
        self.count = {"program": 0, "norm": 0}
        self._norm = 0.0

    def mult(self, x: np.ndarray, y: np.ndarray, purpose: str, relative: float = 0.0) -> None:
        self.count[purpose] += 1
        y[:] = self.matrix @ x

    def norm(self) -> float:
        if not self._norm:
            self._norm = estimate_norm(lambda x, y: self.mult(x, y, "norm"), self.size)
        return self._norm


def random_matrix(n: int, condition: float, seed: int) -> np.ndarray:
    """Symmetric, eigenvalues from 1 down to 1/condition."""
    Q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(n, n)))
    matrix = (Q * np.logspace(0, -np.log10(condition), n)) @ Q.T
    return (matrix + matrix.T) / 2


def bounds(kind: str, free: np.ndarray, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Bounds of which the unconstrained minimum `free` violates many, but not all."""
    n, rng = len(free), np.random.default_rng(seed)
    lower, upper = np.full(n, -np.inf), np.full(n, np.inf)
    size = np.median(np.abs(free))
    if kind in ("lower", "contact", "mixed"):
        lower[: n // 2 if kind != "lower" else n] = 0.0
    if kind == "upper":
        upper[:] = 0.3 * size
    if kind in ("box", "zero width", "shifted box"):
        upper[:] = size * rng.uniform(0.2, 1.5, n)
        lower[:] = -size * rng.uniform(0.2, 1.5, n)
    if kind in ("contact", "mixed"):
        upper[n // 2 :] = size * rng.uniform(0.2, 1.5, n - n // 2)
        lower[n // 2 :] = -upper[n // 2 :]
    if kind == "mixed":
        lower[::5], upper[::5] = -np.inf, np.inf
        lower[1::5] = upper[1::5] = 0.4 * size
    if kind == "zero width":
        upper[::3] = lower[::3] = 0.1 * size
    if kind == "shifted box":
        lower, upper = lower + 3 * size, upper + 3 * size
    return lower, upper


KINDS = ["none", "lower", "upper", "box", "contact", "mixed", "zero width", "shifted box"]


def program(
    n: int,
    kind: str,
    condition: float = 100.0,
    norm: float = 1.0,
    linear: float = 1.0,
    seed: int = 0,
) -> QP:
    matrix = random_matrix(n, condition, seed)
    d = np.random.default_rng(seed + 1).normal(size=n)
    lower, upper = bounds(kind, np.linalg.solve(matrix, d), seed + 2)
    return QP(
        Dense(norm * matrix), linear * d, Box(lower * (linear / norm), upper * (linear / norm))
    )


def exact(qp: QP) -> np.ndarray:
    """By scipy's active set method for ‖Lᵀ s − L⁻¹ d‖, C = L Lᵀ, free of units, without what is given."""
    norm, size = np.linalg.norm(qp.C.matrix, 2), np.linalg.norm(qp.d)
    C, d = qp.C.matrix / norm, qp.d / size
    lower, upper = qp.constraints.lower * (norm / size), qp.constraints.upper * (norm / size)
    move = lower < upper
    s = np.where(move, 0.0, lower)
    if move.any():
        L = np.linalg.cholesky(C[np.ix_(move, move)])
        b = np.linalg.solve(L, (d - C @ s)[move])
        limits = lower[move], upper[move]
        s[move] = lsq_linear(L.T, b, limits, method="bvls", tol=1e-15, max_iter=1000).x
    return s * (size / norm)


def solve(qp: QP, tolerance: float, start: np.ndarray | None = None) -> QPResult:
    start = np.zeros(qp.C.size) if start is None else start
    return QPSolver().solve(qp, start, qp.C.matrix @ start, tolerance, "program")


def check(qp: QP, result: QPResult, tolerance: float) -> None:
    """Feasible exactly; residual and product as reported; optimal by a gradient computed anew."""
    s, C = result.s, qp.C.matrix
    assert np.all(s >= qp.constraints.lower)
    assert np.all(s <= qp.constraints.upper)
    rounding = 1e-13 * (np.linalg.norm(C, 2) * np.linalg.norm(s) + np.linalg.norm(qp.d))
    assert np.linalg.norm(C @ s - result.Cs) <= rounding
    true_residual = np.linalg.norm(qp.constraints.projected_gradient(C @ s - qp.d, s))
    assert result.residual <= 1.01 * tolerance
    assert true_residual <= 1.01 * tolerance + rounding


@pytest.mark.every(5)
@pytest.mark.parametrize("n", [1, 2, 7, 40])
@pytest.mark.parametrize("kind", KINDS)
def test_random_programs(kind, n):
    for seed in (0, 10, 20):
        qp = program(n, kind, seed=seed)
        tolerance = 1e-10 * np.linalg.norm(qp.d)
        result = solve(qp, tolerance)
        check(qp, result, tolerance)
        reference = exact(qp)
        assert np.linalg.norm(result.s - reference) <= 1e-8 * np.linalg.norm(reference)


@pytest.mark.parametrize("kind", KINDS)
def test_every_product_is_a_step_of_the_solver(kind):
    """A step costs one product; an expansion two, or three where the projected step did not descend."""
    qp = program(40, kind)
    result = solve(qp, 1e-7)
    steps = result.steps
    assert sum(steps.values()) == result.iterations > 0
    least = steps["cg"] + steps["proportioning"] + 2 * steps["expansion"]
    assert least <= qp.C.count["program"] <= least + steps["expansion"]
    if kind == "none":
        assert steps["expansion"] == steps["proportioning"] == 0
    else:
        assert steps["expansion"] > 0


def test_start_that_is_good_enough_costs_nothing():
    qp = program(20, "contact")
    s = solve(qp, 1e-10).s
    before = dict(qp.C.count)
    again = solve(qp, 1e-9, s)
    assert qp.C.count == before
    assert (again.iterations, again.steps) == (0, {})
    assert np.array_equal(again.s, s)


def test_warm_start_is_cheaper_and_start_outside_costs_one_product():
    qp = program(40, "contact")
    cold = solve(qp, 1e-10)
    cost = qp.C.count["program"]
    qp.d *= 1 + 1e-6
    solve(qp, 1e-10, cold.s)
    assert qp.C.count["program"] - cost < 0.7 * cost

    outside = np.where(np.isfinite(qp.constraints.lower), qp.constraints.lower, 0.0) - 1.0
    before = qp.C.count["program"]
    result = solve(qp, 1e6, outside)
    assert qp.C.count["program"] - before == 1
    assert result.iterations == 0
    check(qp, result, 1e6)


@pytest.mark.parametrize("kind", ["none", "lower", "contact", "zero width"])
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_zero_tolerance_is_reached_to_rounding_or_not_at_all(kind):
    qp = program(20, kind)
    for error in (0.0, 1e-12):  # of the products, which no solver can make good
        qp.C.mult = noisy(qp.C, error)
        try:
            s = solve(qp, 0.0).s
        except SolverError as failure:
            assert "subproblem for program" in str(failure) and "needed 0.00e+00" in str(failure)
            continue
        assert error == 0.0
        true = np.linalg.norm(qp.constraints.projected_gradient(qp.C.matrix @ s - qp.d, s))
        assert true <= 2 * GRADIENT_ROUNDING * max(
            np.linalg.norm(qp.d), np.linalg.norm(qp.C.matrix @ s)
        )


def noisy(C: Dense, error: float):
    random = np.random.default_rng(5)

    def mult(x, y, purpose, relative=0.0):
        y[:] = C.matrix @ x
        y += error * np.linalg.norm(y) * random.standard_normal(len(y))

    return mult


def test_iteration_limit_from_the_options(petsc_options):
    petsc_options(qp_tao_max_it=2)
    with pytest.raises(SolverError, match="DIVERGED_MAXITS after 2 iterations"):
        solve(program(20, "contact"), 1e-10)


def test_not_a_number_is_an_error():
    qp = program(10, "contact")
    qp.C.matrix[3, 4] = np.nan
    with pytest.raises(SolverError):
        QPSolver().solve(qp, np.zeros(10), np.zeros(10), 1e-10, "program")


@pytest.mark.parametrize("kind", ["python", "bntr"])
def test_error_in_a_product_comes_through(kind, petsc_options):
    petsc_options(qp_tao_type=kind)
    qp = program(10, "contact")
    qp.C.norm()

    def broken(x, y, purpose, relative=0.0):
        raise SolverError("body 'upper': the solve failed")

    qp.C.mult = broken
    with pytest.raises(SolverError, match="body 'upper': the solve failed"):
        solve(qp, 1e-10)


# The norm


@pytest.mark.parametrize("scale", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize(
    ("n", "condition"), [(1, 1.0), (2, 10.0), (40, 10.0), (40, 1e6), (300, 1e3)]
)
def test_estimate_norm_is_a_little_too_small(n, condition, scale):
    operator = Dense(scale * random_matrix(n, condition, seed=n))
    estimate = operator.norm()
    assert 0.95 * scale <= estimate <= scale * (1 + 1e-12)
    assert operator.count["norm"] <= 30


def test_estimate_norm_where_the_softest_mode_is_orthogonal_to_the_start():
    """A ring: a constant pressure meets 1, the ovalising mode 3."""
    angle = 2 * np.pi * np.arange(48) / 48
    matrix = 0.01 * np.eye(48) + 1 / 48
    for k in range(2, 12):
        for wave in (np.cos(k * angle), np.sin(k * angle)):
            matrix += 3 * (2 / k) ** 2 * np.outer(wave, wave) / (wave @ wave)
    assert 0.95 * 3.01 <= Dense(matrix).norm() <= 3.01 * (1 + 1e-12)


# PETSc's types


@pytest.mark.parametrize("kind", ["python", "bntr"])
def test_what_lies_on_a_bound_lies_there_exactly(kind, petsc_options):
    """Also where scaling there and back would leave it a rounding error away."""
    petsc_options(qp_tao_type=kind)
    for seed in range(5):
        qp = program(10, "shifted box", norm=0.7e-11, linear=1.3e-4, seed=seed)
        result = solve(qp, 1e-10 * np.linalg.norm(qp.d))
        s = exact(qp)
        held = (
            np.minimum(np.abs(s - qp.constraints.lower), np.abs(s - qp.constraints.upper))
            <= 1e-12 * np.abs(s).max()
        )
        assert held.any()
        assert np.all(
            (result.s == qp.constraints.lower) | (result.s == qp.constraints.upper) | ~held
        )


def test_unknown_type_is_a_solver_error(petsc_options):
    petsc_options(qp_tao_type="gpgc")
    with pytest.raises(SolverError, match="gpgc"):
        solve(program(10, "contact"), 1e-9)
