"""Bodies that move far against closed forms, as `scripts/study far` has them on finer meshes.

More of them are problems of the verification, which test_verification solves.
"""

import far
import pytest
from problems.moving import sliding


def test_the_normal_force_of_a_sliding_block_ripples_little():
    """As nodes pass the cells of the other body, by less than 0.5 % of it."""
    assert 1e-6 < far.ripple(far.forces(far.summary_of(sliding(1, 20))[0], 1.0)) < 5e-3


def test_a_pin_is_pushed_into_a_hub():
    """The force at full depth is μ times Lamé's pressure times the bore, within what its ends add; away from them the
    pressure is Lamé's, and the force grows as strip theory says."""
    rows, (least, most, lame), apart = far.pin(steps=20)
    forces, strips = (dict(zip(rows[:, 0], rows[:, column], strict=True)) for column in (1, 2))
    assert forces[20.0] == pytest.approx(rows[-1, 3], rel=0.01)
    assert forces[16.0] - forces[12.0] == pytest.approx(strips[16.0] - strips[12.0], rel=0.03)
    assert lame == pytest.approx(78.75) and apart < 0.05 and 0.98 * lame < least < most < 1.04 * lame
