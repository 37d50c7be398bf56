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


@pytest.mark.parametrize("name, kind", [("ddmpi.mprgp.MPRGP", MPRGP), ("ddmpi.apg.APG", APG)])
def test_our_types_take_the_variable_bounds_of_any_tao(name, kind, petsc_options):
    """``-tao_python_type ddmpi.mprgp.MPRGP`` solves a TAO of the user's own, within its variable bounds."""
    petsc_options(tao_type="python", tao_python_type=name)
    matrix = np.array([[2.0, -1.0, 0.0], [-1.0, 2.0, -1.0], [0.0, -1.0, 2.0]])
    right = np.array([1.0, 4.0, -1.0])
    H = PETSc.Mat().createDense((3, 3), array=matrix, comm=PETSc.COMM_SELF)
    x, lower, upper = (
        PETSc.Vec().createWithArray(np.full(3, v), comm=PETSc.COMM_SELF) for v in (0.0, 0.0, 2.0)
    )
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
