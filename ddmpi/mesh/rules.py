"""Rules of quadrature on simplices and their products."""

from collections.abc import Sequence
from itertools import permutations

import numpy as np

Rule = tuple[np.ndarray, np.ndarray]
"""Hats (q, c) of the corners of a cell at points, and their weights (q,), which sum to one."""


def _orbits(dimension: int, *orbits: tuple[float, float, int]) -> Rule:
    """A rule from weights and barycentric coordinates: a value, how often it stands, and equal ones for the rest. All
    permutations of them are points."""
    points = [
        sorted(set(permutations([value] * times + [(1.0 - times * value) / rest] * rest)))
        for _, value, times in orbits
        for rest in [dimension + 1 - times]
    ]
    return np.concatenate(points), np.repeat(
        [weight for weight, *_ in orbits], [len(orbit) for orbit in points]
    )


def _collapsed(dimension: int) -> Rule:
    """Gauss's five points along each edge of a cube mapped to the simplex (Duffy 1982): exact to degree 10 − d."""
    at, weights = (values / 2 for values in np.polynomial.legendre.leggauss(5))
    at = 0.5 + at
    points = np.ones((1, 1))
    weight = np.ones(1)
    # Split off one coordinate at a time: λ_last → λ_last (1 − t), λ_last t. The Jacobian is t^(rest − 1), and the
    # factor `rest` makes the weights sum to one.
    for rest in range(dimension, 0, -1):
        t = np.tile(at, len(points))
        last = points[:, -1].repeat(5)
        points = points[:, :-1].repeat(5, axis=0)
        points = np.column_stack([points, last * (1.0 - t), last * t])
        weight = np.outer(weight, weights * rest * at ** (rest - 1)).ravel()
    return points, weight


FIRST = {
    dimension: (np.full((1, dimension + 1), 1.0 / (dimension + 1)), np.ones(1))
    for dimension in (1, 2, 3)
}
"""The centroid, where the stress of a straight cell is its mean."""

SECOND = {d: _orbits(d, (1.0 / (d + 1), (1.0 - (d + 2) ** -0.5) / (d + 1), d)) for d in (1, 2, 3)}
"""d + 1 points, exact to degree 2."""

RULES = {
    2: _orbits(
        2, (0.223381589678011, 0.445948490915965, 2), (0.109951743655322, 0.091576213509771, 2)
    ),
    3: _orbits(
        3,
        (0.112687925718015851, 0.310885919263300610, 3),
        (0.0734930431163619495, 0.0927352503108912264, 3),
        (0.0425460207770814664, 0.0455037041256496495, 2),
    ),
}
"""Exact to degree 4 in the plane (Dunavant 1985), 5 in space (Walkington 2000). On curved cells ∫ σ : ε(φ_i) of a
constant stress needs degree d and ∫ φ_i degree d + 2, so that constant stresses and volume forces are exact."""

FINE = {dimension: _collapsed(dimension) for dimension in (1, 2, 3)}
"""For loads and measures of curved facets, whose integrands are no polynomials."""


def exact_rule(dimension: int, degree: int) -> Rule:
    """The rule with the fewest points among these that is exact to a degree."""
    rules = [FIRST, FIRST, SECOND, RULES, RULES, *[FINE] * 5][degree]
    return rules.get(dimension, FINE[dimension])


def rules_on(
    factors: Sequence[int], order: int, vertices: np.ndarray
) -> tuple[Rule, Rule, Rule, Rule]:
    """`samples`, `rule`, `quadrature` and `fine` of the cell of an order, a product of simplices of these dimensions
    with `Cell._vertices`: on lines 1 to 3, and 5, of Gauss's points along each."""
    if len(factors) == 1:
        d = factors[0]
        some = exact_rule(d, 2 * order - 2), exact_rule(d, 2 * order)
        return *some, RULES.get(d, FINE[d]), FINE[d]
    samples, rule, fine = (_along(factors, n, vertices) for n in (order, order + 1, 5))
    return samples, rule, rule, fine


def _along(factors: Sequence[int], number: int, vertices: np.ndarray) -> Rule:
    """Gauss's points, this number along each of several lines."""
    at, weights = np.polynomial.legendre.leggauss(number)
    line = np.column_stack([0.5 - at / 2, 0.5 + at / 2])
    chosen = np.indices([number] * len(factors)).reshape(len(factors), -1)
    points = np.concatenate(line[chosen], axis=1)
    return (points[:, None] ** vertices).prod(axis=-1), (weights / 2)[chosen].prod(axis=0)
