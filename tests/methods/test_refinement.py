"""Gaps of slender bodies, whose dense compliances are rounded more than what contacts deform."""

import numpy as np
import pytest
from scenes import COULOMB, certified, rectangle

import ddmpi


def layer(thickness: float, n: int = 60) -> dict:
    """A loose quadratic layer, 1 m long, between two stiff blocks, pressed and sheared."""
    steel = {"young": 2.1e11, "order": 2}
    bodies = [
        rectangle("b", (0, 0), (1, 0.5), (n, 4), **steel, clamp=["bottom"]),
        rectangle("s", (0, 0.5), (1, thickness), (n, 1), 2, young=1e9, poisson=0.45),
        rectangle(
            "t",
            (0, 0.5 + thickness),
            (1, 0.5),
            (n, 4),
            **steel,
            traction=[{"on": "top", "value": [5e5, -1e7]}],
        ),
    ]
    contacts = [
        {"bodies": [*pair], "on": ["bottom", "top"], "friction": COULOMB} for pair in ("sb", "ts")
    ]
    return {"body": bodies, "contact": contacts}


@pytest.mark.slow
def test_a_thin_layer_is_certified():
    """Where a dense compliance loses gaps in rounding, they are found by solves: 1 : 250 is certified as it is."""
    answer = certified(layer(0.004))
    certificate = answer.summary["certificate"]
    assert max(certificate.values()) < 5e-7
    # nearly uniaxial strain between stiff blocks: the pressure is that of the load
    pressure = answer.contacts["s-b"].pressure
    assert np.median(pressure) == pytest.approx(1e7, rel=0.02)


def test_products_by_solves_are_those_of_the_dense_compliance():
    """The two differ by rounding alone, and the dense one serves again afterwards."""
    answer = ddmpi.solve(layer(0.1, 6))
    joint = answer.solved.assembly.joint
    s = np.random.default_rng(1).standard_normal(joint.size)
    dense, solved = joint.product(s, "test"), joint.solved(s, "test")
    assert solved == pytest.approx(dense, rel=1e-7, abs=1e-9 * np.abs(dense).max())
    assert (solved != dense).any()
    assert (joint.product(s, "test") == dense).all()
