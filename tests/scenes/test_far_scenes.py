"""Bodies that move far against closed forms; more of them are problems of the verification."""

import numpy as np
import pytest
from problems.bodies import answer_of
from problems.moving import forces, sliding


@pytest.mark.slow
def test_the_normal_force_of_a_sliding_block_ripples_little():
    """As nodes pass the cells of the other body, by less than 0.5 % of it, about a quartic trend."""
    t, _, N = forces(answer_of(sliding(1, 20)).summary, 1.2).T
    assert 1e-6 < np.ptp(N - np.polyval(np.polyfit(t, N, 4), t)) / N.mean() < 5e-3
