"""Constant stress through contacts of solids whose meshes do not match: all six components, exact on any mesh."""

import pytest
from mpi4py import MPI
from solid_scenes import CROSS, T_JUNCTION, jittered, patch, patch_errors, two_patches

import ddmpi

EXACT = 1e-10
both_orders = pytest.mark.parametrize("order", [1, 2])
both_kinds = pytest.mark.parametrize("bonded", [False, True], ids=["coulomb", "bonded"])
STRIPS = (0.3, 0.01, 1e-4, 1e-6)
"""How far the other body covers the last facets of the slave, of their width."""


def check(scene, comm=MPI.COMM_SELF, still=float("inf"), amount=0.3):
    with jittered(amount, still):
        answer = ddmpi.solve(scene, comm)
    assert answer.certified, answer.reason
    errors = patch_errors(answer)
    assert errors.displacement <= EXACT
    assert errors.traction <= EXACT


@both_orders
@both_kinds
@pytest.mark.parametrize("slave", ["b0", "b1"])
@pytest.mark.parametrize("divisions", [((3, 4, 3), (4, 3, 3)), ((2, 2, 2), (5, 4, 3))], ids=["3:4", "2:5"])
def test_two_boxes(order, bonded, slave, divisions):
    """Either body may be the slave; nodes move at random on faces and within."""
    check(two_patches(*divisions, order, bonded=bonded, slave=slave))


@both_orders
@both_kinds
@pytest.mark.parametrize("slave", ["b0", "b1"])
@pytest.mark.parametrize("strip", [pytest.param(strip, marks=[] if strip == 1e-4 else pytest.mark.slow)
                                   for strip in STRIPS])
def test_strips(order, bonded, slave, strip):
    """The lower body ends a strip after an edge of the upper one's facets; beyond acts the traction of the stress."""
    check(two_patches((3, 3, 3), (3, 4, 3), order, covered=2 / 3 + strip / 3, bonded=bonded, slave=slave), still=2 / 3)


@both_orders
@both_kinds
def test_a_strip_is_not_covered(order, bonded):
    """The same where all but a strip of a facet is covered."""
    check(two_patches((3, 3, 3), (3, 4, 3), order, covered=1 - 1e-6 / 3, bonded=bonded, slave="b0"), still=2 / 3)


@pytest.mark.slow
@both_orders
@both_kinds
@pytest.mark.parametrize("bodies", [T_JUNCTION, CROSS], ids=["T", "cross"])
def test_contacts_meet_at_an_edge(order, bonded, bodies):
    """Of three bodies, and of four."""
    check(patch(*bodies, order, bonded))


@pytest.mark.slow
@pytest.mark.mpi(ranks=2)
@pytest.mark.parametrize("bodies", [T_JUNCTION, CROSS], ids=["T", "cross"])
def test_on_two_ranks(comm, bodies):
    check(patch(*bodies, 1), comm)


@pytest.mark.slow
@pytest.mark.mpi(ranks=4)
def test_two_bodies_on_four_ranks(comm):
    """Two ranks a body."""
    check(two_patches((3, 4, 3), (4, 3, 3), 2), comm)


def test_a_stress_that_varies_is_not_exact():
    """What these tests measure can fail: a load that is a little larger is seen."""
    scene = two_patches((2, 2, 2), (3, 3, 3), 1)
    scene["body"][0]["traction"][-1]["value"][2] *= 1.0 + 1e-6
    with jittered():
        errors = patch_errors(ddmpi.solve(scene, MPI.COMM_SELF))
    assert errors.traction > 100 * EXACT
