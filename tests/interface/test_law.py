"""Laws of contact and friction on plain arrays: what forces they allow, and their linearisation."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import scipy.sparse as sparse

from ddmpi.interface.law import BondedLaw, CoulombLaw, Law, TrescaLaw, law_of
from ddmpi.interface.laws import Laws
from ddmpi.methods.krylov import Linearised
from ddmpi.scene.contacts import Coulomb, NoFriction, Tresca

SLIDING = np.array([0, 2, 3])
LAWS = {
    "none": Law(4, np.empty(0, int), 1),
    "coulomb": CoulombLaw(4, SLIDING, 1, np.array([0.3, 0.5, 2.0])),
    "tresca": TrescaLaw(4, SLIDING, 1, np.array([0.4, 1.0, 0.0])),
    "coulomb in space": CoulombLaw(4, SLIDING, 2, np.array([0.3, 0.5, 2.0])),
}
every_law = pytest.mark.parametrize("law", LAWS.values(), ids=LAWS)


def points(law: Law) -> np.ndarray:
    return np.random.default_rng(1).standard_normal((20, law.size))


@every_law
def test_projected_forces_obey_the_law_and_none_is_nearer(law):
    for q in points(law):
        s = law.project(q)
        normal, tangential = law.split(s)
        bound = law.bound_at(s)
        assert (normal >= 0.0).all()
        assert (np.linalg.norm(tangential, axis=1) <= bound * (1 + 1e-14)).all()
        assert law.project(s) == pytest.approx(s)
        inside = np.linalg.norm(law.split(q)[1], axis=1) <= bound
        assert tangential[inside] == pytest.approx(law.split(q)[1][inside])


@every_law
def test_the_linearised_law_is_the_tangent_of_the_equations(law):
    """A change that obeys the linearised law leaves s = P(s − c r) to second order, in space with friction that turns.

    Of gaps the law wants r = 0 along the unknown forces, and along those that turn the friction −κ/c of their change.
    """
    rng, c, step = np.random.default_rng(4), 2.0, 1e-6
    for q in points(law):
        s = law.project(q)
        r = (s - q) / c
        linear = Linearised.of(law.linearise(law.active_set(q)))
        assert linear.move(s) == pytest.approx(np.zeros(law.size), abs=1e-14)
        assert linear.restrict(r) == pytest.approx(
            -(linear.spring / c)[linear.unknown] * linear.restrict(s), abs=1e-14
        )
        y = rng.standard_normal(linear.number)
        dr = rng.standard_normal(law.size)
        dr -= linear.basis @ (linear.restrict(dr) + (linear.spring / c)[linear.unknown] * y)
        s, r = s + step * linear.expand(y), r + step * dr
        assert np.abs(s - law.project(s - c * r)).max() < 1e-3 * step


def test_friction_turns_in_space_only():
    """A node that slips has one unknown force in space and none in the plane; without a bound it has none at all."""
    for components, unknown in ((1, 0), (2, 1), (3, 2)):
        law = CoulombLaw(2, np.arange(2), components, np.full(2, 0.5))
        q = np.concatenate([[2.0, -1.0], np.full(2 * components, 7.0)])
        linear = Linearised.of(law.linearise(law.active_set(q)))
        assert linear.number == 1 + unknown and (linear.spring[2 : 2 + components] > 0.0).all() == (
            unknown > 0
        )
        assert (linear.basis.T @ linear.basis).toarray() == pytest.approx(np.eye(linear.number))
        friction = law.project(q)[2 : 2 + components]
        assert linear.basis.toarray()[2 : 2 + components].T @ friction == pytest.approx(
            np.zeros(linear.number)
        )


@every_law
def test_settled_forces_lie_on_their_bounds(law):
    for q in points(law):
        active = law.active_set(q)
        s = law.settle(q, active)
        normal, tangential = law.split(s)
        assert (normal[~active.closed] == 0.0).all() and (normal >= 0.0).all()
        size, slips = np.linalg.norm(tangential, axis=1), active.slip.any(axis=1)
        assert size[slips] == pytest.approx(law.bound_at(s)[slips])
        assert (size <= law.bound_at(s) * (1 + 1e-14)).all()
        assert law.cone(law.bound_at(s)).project(s) == pytest.approx(s)


def test_cones_of_laws_with_boxes_and_discs():
    """The product of cones projects each part, in the plane and in space."""
    together = Laws(
        [LAWS["coulomb in space"], BondedLaw(2, np.arange(2), 2), Law(3, SLIDING[:0], 2)]
    )
    for q in np.random.default_rng(5).standard_normal((10, together.size)):
        found = together.cone(together.bound_at(q)).project(q)
        assert found == pytest.approx(together.project(q))
        assert together.cone(together.bound_at(q)).project(found) == pytest.approx(found)


def test_laws_together_are_each_by_itself():
    """Laws of one class are one law of all their nodes; nothing that they say changes, in the plane and in space."""
    rng = np.random.default_rng(6)
    for components in (1, 2):
        shapes = [(4, SLIDING), (3, np.arange(3)), (2, np.arange(0)), (4, SLIDING[1:])]
        laws: list[Law] = [
            CoulombLaw(m, sliding, components, rng.random(len(sliding))) for m, sliding in shapes
        ]
        laws += [Law(3, SLIDING[:0], components), BondedLaw(2, np.arange(2), components)]
        laws += [replace(laws[0], live=rng.random(laws[0].size) < 0.7), *laws[:2]]
        together = Laws(laws)
        q = rng.standard_normal(together.size)
        parts = [(law, vector) for law, vector in zip(laws, split(q, laws), strict=True)]
        active = together.active_sets(q)
        found = together.linearise(active), together.project(q), together.settle(q, active)
        tangent, bound = found[0], together.bound_at(q)
        assert found[1].tolist() == joined(law.project(x) for law, x in parts)
        assert found[2].tolist() == joined(law.settle(x, law.active_set(x)) for law, x in parts)
        assert bound.tolist() == joined(law.bound_at(x) for law, x in parts)
        each = [law.linearise(law.active_set(x)) for law, x in parts]
        for name in ("unknown", "coupling", "given", "spring"):
            assert getattr(tangent, name).tolist() == joined(getattr(one, name) for one in each)
        begins = np.cumsum([0, *(law.size for law in laws)])
        assert tangent.source.tolist() == joined(
            one.source + begin for one, begin in zip(each, begins, strict=False)
        )
        turns = [np.eye(len(one.given)) if one.turn is None else one.turn for one in each]
        turned = np.eye(together.size) if tangent.turn is None else tangent.turn.toarray()
        assert turned.tolist() == sparse.block_diag(turns).toarray().tolist()
        assert (tangent.turn is None) == (components == 1)
        nodes = [np.arange(law.m) % 2 == 0 for law in laws]
        stick = together.linearise(together.sticking(np.concatenate(nodes)))
        assert stick.unknown.tolist() == joined(
            law.linearise(law.sticking(closed, ~closed & closed)).unknown
            for law, closed in zip(laws, nodes, strict=True)
        )


def split(x: np.ndarray, laws: list[Law]) -> list[np.ndarray]:
    """The parts of a vector by law."""
    return np.split(x, np.cumsum([law.size for law in laws])[:-1])


def joined(arrays) -> list:
    """Arrays one after the other."""
    return np.concatenate(list(arrays)).tolist()


def test_a_slip_bound_is_a_stress_and_a_coefficient_a_number():
    """Tresca's bound is multiplied with the nodal areas, Coulomb's coefficient is not."""
    xy, arc = np.column_stack([np.arange(4.0), np.zeros(4)]), np.arange(4.0)
    area = np.array([0.5, 1.0, 2.0, 4.0])
    pressure = np.array([1.0, 2.0, 3.0, 4.0])
    assert law_of(Tresca(slip_bound=3.0), xy, arc, area, SLIDING).slip_bound(pressure).tolist() == [
        1.5,
        6.0,
        12.0,
    ]
    coulomb = law_of(Coulomb(coefficient=0.5), xy, arc, area, SLIDING)
    assert coulomb.slip_bound(pressure).tolist() == [0.5, 1.5, 2.0]
    assert coulomb.slope(pressure).tolist() == [0.5, 0.5, 0.5]
    assert law_of(NoFriction(), xy, arc, area, SLIDING[:0]).size == 4


@dataclass(frozen=True)
class Cohesive(CoulombLaw):
    """A law that nothing else knows: Coulomb's, with a part of the bound that needs no pressure, up to a limit."""

    name = "cohesive"

    def slip_bound(self, pressure: np.ndarray) -> np.ndarray:
        return np.minimum(super().slip_bound(pressure) + np.array([0.5, 0.0, 0.25]), 4.0)


@pytest.mark.parametrize("components", [1, 2])
def test_open_nodes_stick_at_first_where_the_law_holds_them(components):
    """Which way the others slide is not known before they are pressed."""
    law = Cohesive(4, SLIDING, components, np.array([0.3, 0.0, 2.0]))
    active = law.sticking(np.zeros(4, bool), np.ones(4, bool))
    assert active.slip.any(axis=1).tolist() == [False, True, False]


def test_gaps_that_the_law_allows_miss_it_by_nothing():
    """No sign of the zero, which would be told."""
    law = CoulombLaw(2, np.arange(2), 1, np.full(2, 0.3))
    for gap in ([0.0, 1.0], [0.5, 1.0], []):
        assert str(law.misfit(np.array(gap))) == "0.0"
    assert law.misfit(np.array([-0.25, 1.0])) == 0.25
