"""The box as a constraint set, and MPRGP on a TAO that only PETSc has set up."""

import numpy as np
import pytest
from petsc4py import PETSc

from ddmpi.mprgp import MPRGP
from ddmpi.published.apg import APG
from ddmpi.sets import Box

BOX = Box(np.array([0.0, -1.0, -np.inf, 2.0, 0.0]), np.array([np.inf, 1.0, np.inf, 2.0, 3.0]))


def points() -> list[np.ndarray]:
    """Feasible points, some of whose components lie on bounds."""
    rng = np.random.default_rng(0)
    return [BOX.project(size * rng.normal(size=5)) for size in (0.5, 1.0, 3.0) for _ in range(20)]


def test_gradient_is_split_by_what_the_bounds_hold():
    """Free and chopped gradient sum to the projected one, and a short step along it stays feasible."""
    rng = np.random.default_rng(1)
    for x in points():
        g = rng.normal(size=5)
        free, chopped = BOX.split(g, x)
        projected = BOX.projected_gradient(g, x)
        assert np.array_equal(free + chopped, projected)
        assert not (free * chopped).any()
        assert np.array_equal(free != 0.0, (x > BOX.lower) & (x < BOX.upper))
        step = x - 1e-9 * projected
        assert np.array_equal(BOX.project(step), step)
        held = g != projected
        assert np.array_equal(BOX.project(x - 1e-9 * g)[held], x[held])


def test_longest_step_ends_on_a_bound():
    """The longest feasible step reaches a bound and a longer one leaves the box; it is infinite if no step leaves."""
    rng = np.random.default_rng(2)
    for x in points():
        p = BOX.split(rng.normal(size=5), x)[0]
        longest = BOX.longest_step(x, p)
        if np.isfinite(longest):
            outside = x - (1 + 1e-9) * longest * p
            assert BOX.project(x - longest * p) == pytest.approx(x - longest * p, rel=1e-14, abs=1e-14)
            assert (outside < BOX.lower).any() or (outside > BOX.upper).any()
        else:
            assert np.array_equal(BOX.project(x - 1e9 * p), x - 1e9 * p)
        reduced = BOX.reduced(p, x, 0.7)
        assert x - 0.7 * reduced == pytest.approx(BOX.project(x - 0.7 * p), rel=1e-14, abs=1e-14)


def test_scaling_there_and_back_keeps_what_lies_on_bounds():
    """A component on a bound of the scaled box, or within the given distance, lies on the bound itself, exactly."""
    unit = 0.7e11
    box = Box(unit * BOX.lower / 3, unit * BOX.upper / 3)
    for x in points():
        x = x / 3
        back = box.unscaled(x + 1e-13, unit, 1e-12)
        assert back == pytest.approx(unit * x, rel=1e-11, abs=1e-1)
        on = np.isclose(x, BOX.lower / 3, rtol=0, atol=1e-14) | np.isclose(x, BOX.upper / 3, rtol=0, atol=1e-14)
        assert np.array_equal(on, (back == box.lower) | (back == box.upper))


@pytest.mark.parametrize("name, kind", [("ddmpi.mprgp.MPRGP", MPRGP), ("ddmpi.apg.APG", APG)])
def test_our_types_take_the_variable_bounds_of_any_tao(name, kind, petsc_options):
    """``-tao_python_type ddmpi.mprgp.MPRGP`` solves a TAO of the user's own, within its variable bounds."""
    petsc_options(tao_type="python", tao_python_type=name)
    matrix = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    right = np.array([1.0, 4.0, -1.0])
    H = PETSc.Mat().createDense((3, 3), array=matrix, comm=PETSc.COMM_SELF)
    x, lower, upper = (PETSc.Vec().createWithArray(np.full(3, v), comm=PETSc.COMM_SELF) for v in (0.0, 0.0, 2.0))
    tao = PETSc.TAO().create(PETSc.COMM_SELF)
    tao.setSolution(x)
    tao.setVariableBounds((lower, upper))

    def gradient(_tao, X, G):
        H.mult(X, G)
        G.array[:] -= right

    tao.setGradient(gradient, x.duplicate())
    tao.setHessian(lambda *_: None, H)
    tao.setTolerances(gatol=1e-10)
    tao.setFromOptions()
    assert isinstance(tao.getPythonContext(), kind)
    tao.solve()
    assert tao.getConvergedReason() > 0
    assert x.array_r == pytest.approx([1.5, 2.0, 0.5], rel=1e-9)
    tao.destroy()
