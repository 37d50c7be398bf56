"""The box as a constraint set, and MPRGP on a TAO that only PETSc has set up."""

from functools import partial

import numpy as np
import pytest
from petsc4py import PETSc
from test_mprgp import exact, program

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


def gradient_of(H: PETSc.Mat, d: np.ndarray, _tao, X: PETSc.Vec, G: PETSc.Vec) -> None:
    """H x − d."""
    H.mult(X, G)
    G.array[:] -= d


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

    tao.setGradient(partial(gradient_of, H, right), x.duplicate())
    tao.setHessian(lambda *_: None, H)
    tao.setTolerances(gatol=1e-10)
    tao.setFromOptions()
    assert isinstance(tao.getPythonContext(), kind)
    tao.solve()
    assert tao.getConvergedReason() > 0
    assert x.array_r == pytest.approx([1.5, 2.0, 0.5], rel=1e-9)
    tao.destroy()


def test_a_users_own_program_takes_the_same_steps_in_any_units():
    """Powers of two as units of its forces and displacements change no digit, so that all steps have to be alike."""
    qp, found = program(40, "box", condition=1e4), []
    for force, displacement in ((1.0, 1.0), (2.0**11, 2.0**-10), (2.0**-7, 2.0**10)):
        d, matrix = displacement * qp.d, displacement / force * qp.C.matrix
        H = PETSc.Mat().createDense(matrix.shape, array=matrix.copy(), comm=PETSc.COMM_SELF)
        x, lower, upper = (
            PETSc.Vec().createWithArray(force * bound, comm=PETSc.COMM_SELF)
            for bound in (np.zeros(40), qp.constraints.lower, qp.constraints.upper)
        )
        tao = PETSc.TAO().createPython(MPRGP(), comm=PETSc.COMM_SELF)
        tao.setSolution(x)
        tao.setVariableBounds((lower, upper))
        tao.setGradient(partial(gradient_of, H, d), x.duplicate())
        tao.setHessian(lambda *_: None, H)
        tao.setMaximumIterations(1000)
        tao.setTolerances(gatol=1e-9 * displacement)
        tao.solve()
        found.append((tao.getPythonContext().steps, (x.array_r / force).tolist()))
        tao.destroy()
    assert found[0] == found[1] == found[2]
    assert found[0][0]["expansion"] > 0
    s = exact(qp)
    assert found[0][1] == pytest.approx(s.tolist(), abs=1e-7 * np.abs(s).max())
