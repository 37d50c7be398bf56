"""Laws of contact and friction on plain arrays: what forces they allow, and their linearisation."""

import numpy as np
import pytest

from ddmpi.interface.law import CoulombLaw, Law, Laws, TrescaLaw, law_of
from ddmpi.scene.contacts import Coulomb, NoFriction, Tresca

SLIDING = np.array([0, 2, 3])
LAWS = {"none": Law(4, np.empty(0, int), 1), "coulomb": CoulombLaw(4, SLIDING, 1, np.array([0.3, 0.5, 2.0])),
        "tresca": TrescaLaw(4, SLIDING, 1, np.array([0.4, 1.0, 0.0])),
        "coulomb in space": CoulombLaw(4, SLIDING, 2, np.array([0.3, 0.5, 2.0]))}
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
def test_the_linearised_law_is_the_tangent_of_the_projection(law):
    for q in points(law):
        active = law.active_set(q)
        linear, s, step = law.linearise(active), law.project(q), 1e-7
        assert linear.expand(s[linear.unknown]) + linear.given == pytest.approx(s)
        dq = step * np.where(linear.unknown, 1.0, 0.0)  # sticking and closed entries follow q itself
        assert (law.project(q + dq) - s) / step == pytest.approx(linear.expand(dq[linear.unknown]) / step, abs=1e-6)


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
        box = law.frozen(law.bound_at(s))
        assert ((box.lower <= s) & (s <= box.upper)).all()


def test_laws_of_several_interfaces_are_those_of_each():
    laws = [LAWS["coulomb"], LAWS["none"], LAWS["tresca"]]
    together = Laws(laws)
    rng = np.random.default_rng(2)
    parts = [rng.standard_normal(law.size) for law in laws]
    q = np.concatenate(parts)
    assert together.project(q).tolist() == np.concatenate(
        [law.project(part) for law, part in zip(laws, parts, strict=True)]).tolist()
    assert together.bound_at(q).tolist() == np.concatenate(
        [law.bound_at(part) for law, part in zip(laws, parts, strict=True)]).tolist()
    active = together.active_sets(q)
    linear = together.linearise(active)
    assert linear.expand(together.project(q)[linear.unknown]) + linear.given == pytest.approx(together.project(q))


def test_a_slip_bound_is_a_stress_and_a_coefficient_a_number():
    """Tresca's bound is multiplied with the nodal areas, Coulomb's coefficient is not."""
    xy, arc = np.column_stack([np.arange(4.0), np.zeros(4)]), np.arange(4.0)
    area = np.array([0.5, 1.0, 2.0, 4.0])
    pressure = np.array([1.0, 2.0, 3.0, 4.0])
    assert law_of(Tresca(slip_bound=3.0), xy, arc, area, SLIDING).slip_bound(pressure).tolist() == [1.5, 6.0, 12.0]
    coulomb = law_of(Coulomb(coefficient=0.5), xy, arc, area, SLIDING)
    assert coulomb.slip_bound(pressure).tolist() == [0.5, 1.5, 2.0]
    assert coulomb.slope(pressure).tolist() == [0.5, 0.5, 0.5]
    assert law_of(NoFriction(), xy, arc, area, SLIDING[:0]).size == 4
