"""Bonded contacts: what they hold, where, and that nothing opens or slips in them."""

import numpy as np
import pytest
from boundaries import (
    body_side,
    compliance,
    elastic,
    held_beside,
    pair,
    rectangle,
    respond,
    side,
    touch,
    uncovered_profile,
)

from ddmpi.coupling.space import Laws, Space
from ddmpi.interface.law import NO_BOUND, BondedLaw, CoulombLaw, Law
from ddmpi.interface.state import contact_state
from ddmpi.interface.trace import trace
from ddmpi.judge.diagnosis import StatusLog
from ddmpi.methods.krylov import Linearised
from ddmpi.scene.bodies import Clamp
from ddmpi.scene.contacts import Coulomb, NoFriction, Plane
from ddmpi.scene.values import Profile

LAW = BondedLaw(4, np.array([0, 2, 3]), 1)


def points(size: int) -> np.ndarray:
    return np.random.default_rng(3).standard_normal((10, size))


def blocks(gap: float = 0.0, order: int = 1):
    return rectangle((6, 2), (3.0, 1.0), (0.0, 1.0 + gap), order), rectangle((6, 3), (3.0, 1.0), order=order)


def bonded(upper, lower, **arguments):
    return pair(upper, lower, NoFriction(), "seam", kind="bonded", **arguments)


# The law

def test_all_nodes_are_closed_and_stick_whatever_the_forces():
    """s − P(s − c r) = c r: whatever the forces, the gaps must vanish; none reaches a bound."""
    for s, r in zip(points(7), points(7)[::-1], strict=True):
        assert s - LAW.project(s - 2.0 * r) == pytest.approx(2.0 * r)
        active = LAW.active_set(s)
        assert active.closed.all() and not active.slip.any() and LAW.closed(s, 0.5).all()
        assert LAW.settle(s, active).tolist() == s.tolist() and active.pressure.tolist() == s[:4].tolist()
        linear = Linearised.of([LAW.linearise(active)])
        assert linear.number == 7 and not linear.given.any() and linear.expand(s).tolist() == s.tolist()
    for s in (np.zeros(7), np.full(7, 1e300), -np.full(7, 1e300)):
        assert not LAW.reaches_bound(s, LAW.bound_at(s)).any()
    box = LAW.cone(LAW.bound_at(np.zeros(7)))
    assert not np.isfinite([box.lower, box.upper]).any() and len(box.lower) == 7


def test_gap_slip_and_tension():
    """An opening is as wrong as an overlap, all slip is wrong, tension is not."""
    gap, slip = np.array([0.0, 3.0, -2.0, 0.0]), np.array([[0.0], [-4.0], [1.0]])
    assert LAW.misfit(gap) == LAW.misfit(-gap) == 3.0
    assert Law(4, np.empty(0, int), 1).misfit(gap) == 2.0
    assert LAW.violation(np.ones(7), slip, 0.5) == 2.0
    assert LAW.complementarity(-np.ones(4), gap) == (0.0, 0.0)
    assert Law(4, np.empty(0, int), 1).complementarity(np.array([-1.0, 2.0, 3.0, -4.0]), gap) == (12.0, 4.0)


def test_bonded_and_other_laws_mix():
    """Each part keeps its law; differences of bounds are numbers, also where there is no bound."""
    laws = [CoulombLaw(3, np.array([1, 2]), 1, np.array([0.5, 0.3])), LAW, Law(2, np.empty(0, int), 1)]
    together = Laws(laws)
    parts = [slice(0, 5), slice(5, 12), slice(12, 14)]
    for q, other in zip(points(14), points(14)[::-1], strict=True):
        active = together.active_sets(q)
        for law, part in zip(laws, parts, strict=True):
            assert together.project(q)[part].tolist() == law.project(q[part]).tolist()
        settled, linear = together.settle(q, active), Linearised.of(together.linearise(active))
        assert settled[5:12].tolist() == q[5:12].tolist() and (settled[12:] >= 0.0).all()
        unknown = np.diff(linear.basis.indptr) > 0
        assert unknown[5:12].all() and unknown[12:].tolist() == (q[12:] > 0.0).tolist()
        bound = together.bound_at(q)
        assert bound[2:].tolist() == [NO_BOUND] * 3
        change = together.bound_at(other) - bound
        assert np.isfinite(np.linalg.norm(change)) and (change[2:] == 0.0).all()
        box = together.cone(bound + 0.5 * change)
        assert np.isinf(box.lower[5:12]).all() and np.isinf(box.upper[5:12]).all()
        assert (box.lower[[0, 1, 2, 12, 13]] == 0.0).all() and np.isfinite(box.upper[3:5]).all()
    assert together.largest_slope == 0.5


# The interface

def test_a_bond_holds_along_the_contact_too():
    """All nodes carry tangential unknowns without a friction law, but those that clamps hold."""
    upper, lower = blocks()
    contact = bonded(side(upper, "bottom"), side(lower, "top"))
    assert (contact.m, contact.size, contact.law.name) == (7, 14, "bonded")
    left = {"where": lambda x, y: x == 0.0, "x": True}
    contact = bonded(side(upper, "bottom", **left), side(lower, "top", **left))
    assert contact.sliding.tolist() == [1, 2, 3, 4, 5, 6]
    left["y"] = True
    contact = bonded(side(upper, "bottom", **left), side(lower, "top", **left))
    assert (contact.m, contact.size, len(contact.fixed.gap)) == (6, 12, 1)


def test_a_roller_along_the_normal_does_not_break_the_bond():
    """A node that both bodies hold along the normal may still slide; a bond holds it, friction cannot."""
    upper, lower = blocks()
    sides = [side(mesh, group, where=lambda x, y: x == 0.0, y=True) for mesh, group in ((upper, "bottom"),
                                                                                        (lower, "top"))]
    assert (bonded(*sides).m, len(bonded(*sides).fixed.gap)) == (7, 0)
    assert held_beside(bonded(*sides)) == pytest.approx(0.0, abs=1e-12)
    assert pair(*sides, Coulomb(coefficient=0.3), "seam").m == 6


@pytest.mark.parametrize("kind", ["unilateral", "bonded"])
def test_a_given_gap_takes_the_place_of_the_measured_one(kind):
    """A number or a profile with signs, at nodes without unknowns as well."""
    upper, lower = blocks(1e-3)
    left = {"where": lambda x, y: x == 0.0, "x": True, "y": True}
    sides = side(upper, "bottom", **left), side(lower, "top", **left)
    profile = Profile(along="x", points=[0.0, 3.0], values=[-3e-4, 3e-4])
    contact = pair(*sides, NoFriction(), "seam", gap=profile, kind=kind)
    assert contact.gap == pytest.approx(-3e-4 + 2e-4 * contact.xy[:, 0])
    assert contact.fixed.gap == pytest.approx([-3e-4])
    assert pair(*sides, NoFriction(), "seam", gap=-1e-5, kind=kind).gap.tolist() == [-1e-5] * 6
    assert pair(*sides, NoFriction(), "seam", gap=0.0, kind=kind).gap.tolist() == [0.0] * 6
    assert uncovered_profile(contact, NoFriction(), profile) == []
    short = Profile(along="x", points=[0.0, 2.0], values=[0.0, 1e-4])
    assert "contact.seam.gap: the profile covers x from 0 to 2" in uncovered_profile(contact, NoFriction(), short)[0]


def test_bonded_nodes_stick_under_tension():
    upper, lower = blocks()
    contact = bonded(side(upper, "bottom"), side(lower, "top"))
    s = np.concatenate([[3.0, -2.0, 0.0, 1.0, -5.0, 0.0, 0.0], np.linspace(-9.0, 9.0, 7)])
    state = contact_state(contact, s, contact.law.bound_at(s), np.zeros(14))
    assert state.status.tolist() == ["stick"] * 7
    assert state.force == pytest.approx([0.0, -3.0], abs=1e-12)
    log = StatusLog(Space([contact, pair(side(upper, "bottom"), side(lower, "top"), NoFriction(), "other")]))
    s = np.concatenate([s, [1.0, 1.0, -1.0, 0.0, 1.0, 1.0, 1.0]])
    log.record(s, contact.law.bound_at(s))
    log.record(-s, contact.law.bound_at(s))
    assert log.counts == [(2, 5, 7), (6, 1, 7)]
    assert (log.unsettled() >= 7).all()


# Mechanics

def test_a_body_bonded_to_a_moving_floor_moves_as_if_clamped_to_it():
    """The displacement of a rigid partner acts like a prescribed one of the body's nodes, sign and all."""
    mesh, (ux, uy) = rectangle((4, 3), (2.0, 1.0)), (3e-3, -2e-3)
    expected = respond(elastic(mesh, ["top", Clamp(on="bottom", x=ux, y=uy)]))
    body = elastic(mesh, ["top"])
    floor = Plane(name="floor", point=(0.0, 0.0), normal=(0.0, 1.0), displacement=(ux, uy))
    contact = touch(body_side(mesh, body, "bottom"), floor, NoFriction(), "seam", kind="bonded")
    B = trace(contact, 0, body).toarray()
    assert not contact.gap.any()
    s = np.linalg.solve(compliance(body, B), contact.prescribed)
    assert respond(body, -B.T @ s) == pytest.approx(expected, abs=1e-10 * np.abs(expected).max())
