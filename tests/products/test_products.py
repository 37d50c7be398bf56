"""Every feature in every kind of scene: what the program promises of them, by statics, closed forms and Hooke's law."""

import gc

import numpy as np
import pytest
from kinds import Kind
from promises import FEATURES
from scenes import assert_refused, certified

NAMES = ("strain", "stress", "plate", "axis", "space")


def combinations() -> list:
    """Each feature in each kind of scene with both orders, one of them in one load step and the other in several.

    One order of each feature is asked in the quick suite, in the kinds by turns with and without steps.
    """
    found = []
    for name in FEATURES:
        for j, kind in enumerate(NAMES):
            for order in (1, 2):
                quick = order == 1 + len(name) % 2
                one = Kind(kind, order, (order + j + len(name) // 2) % 2 == 0)
                found.append(pytest.param(name, one, marks=[] if quick else pytest.mark.slow))
    return found


@pytest.fixture(scope="module", autouse=True)
def little_garbage():
    """What other tests have left is not looked at after each scene."""
    gc.freeze()
    yield
    gc.unfreeze()


@pytest.mark.parametrize(("name", "kind"), combinations(), ids=str)
def test_a_feature_in_a_kind_of_scene(name, kind):
    """A scene is refused in words, or certified with the forces, displacements and energies that are told."""
    case = FEATURES[name](kind)
    if case.refused:
        assert_refused(case.scene, case.refused)
        return
    answer = certified(case.scene)
    for key, (value, size) in case.told.items():
        found = answer.summary
        for part in key.split("."):
            found = found[part]
        expected = np.atleast_1d(value(answer.summary) if callable(value) else value)
        asked = ~np.isnan(expected)
        assert np.atleast_1d(found)[asked] == pytest.approx(
            expected[asked], rel=1e-6, abs=1e-7 * size
        ), key
    for body, exact in case.fields.items():
        fields = answer.bodies[body]
        expected = exact(fields.points)
        known = ~np.isnan(expected)
        size = np.abs(expected[known]).max()
        assert fields.displacement[known] == pytest.approx(expected[known], abs=1e-7 * size), body
    if kind.steps:
        energy = answer.summary["energy"]
        largest = max(abs(energy["external_work"]), abs(energy["strain_energy"]))
        # where heat stores nothing both energies are rounding, and so is what is left between them
        assert energy["residual"] * largest < 1e-8 * max(largest, case.joules)
        if case.stored is not None:
            assert energy["strain_energy"] == pytest.approx(
                case.stored, rel=1e-6, abs=1e-9 * case.joules
            )
