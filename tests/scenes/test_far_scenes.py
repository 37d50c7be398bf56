"""Bodies that move far against closed forms, as `scripts/study far` has them on finer meshes.

More of them are problems of the verification, which test_verification solves.
"""

import far
from problems.moving import sliding


def test_the_normal_force_of_a_sliding_block_ripples_little():
    """As nodes pass the cells of the other body, by less than 0.5 % of it."""
    assert 1e-6 < far.ripple(far.forces(far.summary_of(sliding(1, 20))[0], 1.0)) < 5e-3
