"""Constant stress through contacts of solids whose meshes do not match: all six components, exact on any mesh."""

import numpy as np
import pytest
from mpi4py import MPI
from scenes import seldom
from solid_scenes import (
    CROSS,
    HELD,
    T_JUNCTION,
    between_planes,
    box,
    jittered,
    patch,
    patch_errors,
    two_patches,
)

import ddmpi

EXACT = 1e-10
both_orders = pytest.mark.parametrize("order", [1, pytest.param(2, marks=pytest.mark.slow)])
both_kinds = pytest.mark.parametrize("bonded", [False, True], ids=["coulomb", "bonded"])
kinds_and_slaves = pytest.mark.parametrize(
    "bonded, slave", [(False, "b0"), (True, "b1"), (False, "b1")]
)
STRIPS = (0.01, 1e-4, 1e-6)
"""How far the other body covers the last facets of the slave, of their width."""


def check(scene, comm=MPI.COMM_SELF, still=float("inf"), amount=0.3):
    with jittered(amount, still):
        answer = ddmpi.solve(scene, comm)
    assert answer.certified, answer.reason
    errors = patch_errors(answer)
    assert errors.displacement <= EXACT
    assert errors.traction <= EXACT


@pytest.mark.every(5)
@both_orders
@kinds_and_slaves
@pytest.mark.parametrize(
    "divisions", [((3, 4, 3), (4, 3, 3)), ((2, 2, 2), (5, 4, 3))], ids=["3:4", "2:5"]
)
def test_two_boxes(order, bonded, slave, divisions):
    """Either body may be the slave; nodes move at random on faces and within."""
    check(two_patches(*divisions, order, bonded=bonded, slave=slave))


@both_orders
@kinds_and_slaves
@pytest.mark.parametrize(
    "strip",
    [pytest.param(strip, marks=[] if strip == 1e-4 else pytest.mark.slow) for strip in STRIPS],
)
def test_strips(order, bonded, slave, strip):
    """The lower body ends a strip after an edge of the upper one's facets; beyond acts the traction of the stress."""
    check(
        two_patches(
            (3, 3, 3), (3, 4, 3), order, covered=2 / 3 + strip / 3, bonded=bonded, slave=slave
        ),
        still=2 / 3,
    )


@both_orders
@both_kinds
def test_a_strip_is_not_covered(order, bonded):
    """The same where all but a strip of a facet is covered."""
    check(
        two_patches((3, 3, 3), (3, 4, 3), order, covered=1 - 1e-6 / 3, bonded=bonded, slave="b0"),
        still=2 / 3,
    )


ONE_PLANE = np.array([[3.0, 0.0, 0.0], [0.0, -5.0, 0.6], [0.0, 0.6, -4.0]])
PLANES = {
    "between two": (ONE_PLANE, ("left", "right")),
    "at an edge": (np.diag([3.0, -5.0, -4.0]), ("left", "front")),
}
"""Stress (MPa) that planes of symmetry, groups of boxes, may have."""
TURNED = np.linalg.qr(np.array([[2.0, 1.0, 0.3], [-1.0, 2.0, 0.5], [0.1, -0.7, 2.0]]))[0]
"""An orthogonal matrix with no axis along another one."""


@pytest.mark.every(3)
@pytest.mark.parametrize(
    ("kind", "slave", "order"),
    [
        ("coulomb", "upper", 1),
        seldom("bonded", "lower", 2),
        seldom("coulomb", "upper", 2),
        seldom("bonded", "lower", 1),
    ],
)
@pytest.mark.parametrize("planes", [seldom("between two"), "at an edge"])
@pytest.mark.parametrize(
    "Q", [np.eye(3), TURNED * np.linalg.det(TURNED)], ids=["rollers", "normal clamps"]
)
def test_planes_of_symmetry(order, kind, slave, planes, Q):
    """Contacts with friction and bonds have the rows of frictionless ones on planes of symmetry, and are exact."""
    stress, groups = PLANES[planes]
    law = (
        {"kind": "bonded"}
        if kind == "bonded"
        else {"friction": {"law": "coulomb", "coefficient": 0.3}}
    )
    with jittered(0.3 if np.array_equal(Q, np.eye(3)) else 0.0):  # nodes stay on the planes
        answer, smooth = (
            ddmpi.solve(
                between_planes(
                    stress,
                    groups,
                    Q,
                    [(3, 4, 3), (4, 3, 3)],
                    order,
                    slave=slave,
                    pairing="mortar",
                    **more,
                ),
                MPI.COMM_SELF,
            )
            for more in (law, {})
        )
    assert answer.certified, answer.reason
    errors = patch_errors(answer, Q @ (stress * 1e6) @ Q.T)
    assert errors.displacement <= EXACT
    assert errors.traction <= EXACT
    assert answer.summary["m"] == smooth.summary["m"]


@pytest.mark.every(3)
@both_orders
@both_kinds
@pytest.mark.parametrize("held", ["x", "xy"])
def test_shear_along_edges_that_are_held_along_themselves(order, bonded, held):
    """Faces whose clamps move with a constant shear are no planes of symmetry: it goes through their edges exactly."""
    slope, strain, cells = 0.02, 0.1, ((3, 3, 2), (4, 4, 2))
    sides = [
        {"on": on}
        | {axis: value for axis, value in (("x", f"{slope} * z"), ("y", 0.0)) if axis in held}
        for on in ("front", "back")
    ]
    ends = [{"on": "bottom"} | HELD, {"on": "top", "x": 2 * slope, "y": 0.0, "z": -2 * strain}]
    shear = [
        {"on": on, "value": [0.0, 0.0, sign * 0.5 * slope]}
        for on, sign in (("left", -1.0), ("right", 1.0))
    ]
    bodies = [
        box(
            name,
            (0, 0, z),
            (1, 1, 1),
            n,
            order,
            young=1.0,
            poisson=0.0,
            clamp=[end, *sides],
            traction=shear,
        )
        for name, z, n, end in zip(("lower", "upper"), (0, 1), cells, ends, strict=True)
    ]
    law = {"kind": "bonded"} if bonded else {"friction": {"law": "coulomb", "coefficient": 0.5}}
    answer = ddmpi.solve(
        {
            "body": bodies,
            "contact": [
                {"bodies": ["lower", "upper"], "on": ["top", "bottom"], "pairing": "mortar"} | law
            ],
            "method": {"tolerance": 1e-12},
        }
    )
    assert answer.certified, answer.reason
    for body in answer.bodies.values():
        z = body.points[:, 2]
        assert body.displacement == pytest.approx(
            np.column_stack([slope * z, 0.0 * z, -strain * z]), abs=1e-8
        )


@pytest.mark.slow
@both_orders
@both_kinds
@pytest.mark.parametrize("bodies", [T_JUNCTION, CROSS], ids=["T", "cross"])
def test_contacts_meet_at_an_edge(order, bonded, bodies):
    """Of three bodies, and of four."""
    check(patch(*bodies, order, bonded))
