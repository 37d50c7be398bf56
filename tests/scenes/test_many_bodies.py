"""Towers of bodies with any compliance."""

import pytest
from elsewhere import assert_same, found
from scenes import tower

pytestmark = pytest.mark.slow


@pytest.mark.mpi(ranks=3)
@pytest.mark.parametrize("kind", ["direct", "iterative"])
def test_a_tower_has_one_answer_with_any_compliance(comm, kind):
    """By solves and by multigrid the answer is that of dense compliances."""
    assert_same(found(tower(3, 3), comm), found(tower(3, 3, compliance=kind), comm), within=1e-7)
