"""Quadrature on simplices."""

from itertools import product
from math import factorial

import numpy as np
import pytest

from ddmpi.mesh.elements import FINE, FIRST, RULES, SECOND


@pytest.mark.parametrize("dimension", [1, 2, 3])
@pytest.mark.parametrize(
    "rules, degree", [(FIRST, 1), (SECOND, 2), (RULES, 4), (FINE, 7)], ids=["1", "2", "rule", "7"]
)
def test_rules_are_exact_to_their_degree(rules, degree, dimension):
    """All monomials of barycentric coordinates; in space the rule for curved cells to degree 5."""
    points, weights = rules.get(dimension, FINE[dimension])
    degree += rules is RULES and dimension == 3
    for powers in product(range(degree + 1), repeat=dimension + 1):
        if sum(powers) == degree:
            exact = (
                factorial(dimension)
                * np.prod([factorial(p) for p in powers])
                / factorial(dimension + degree)
            )
            assert weights @ (points**powers).prod(axis=1) == pytest.approx(exact, rel=1e-13)
    assert (points >= 0.0).all() and (weights > 0.0).all()
