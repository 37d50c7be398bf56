"""The joint operator on stand-ins for body and exchange: free gaps, sums, and how precise a product is."""

import contextlib
from types import SimpleNamespace

import numpy as np
import pytest

from ddmpi.coupling.joint import STEERING, Joint


def joint(asked: list[float]) -> Joint:
    """Of two bodies that are alike: each multiplies by 2, and notes the precision that it is asked for."""
    def mult(x, y, purpose, relative):
        asked.append(relative)
        y[:] = 2.0 * x

    space = SimpleNamespace(size=3, gap=np.array([0.25, 0.0, 0.0]), norm=lambda x: float(np.linalg.norm(x)))
    exchange = SimpleNamespace(total=lambda mine, about: 2.0 * mine, deferred=contextlib.nullcontext)
    return Joint(SimpleNamespace(h=np.ones(3), C=SimpleNamespace(mult=mult)), exchange, space)


def test_products_and_free_gaps_are_sums_over_the_bodies():
    operator = joint([])
    assert operator.d.tolist() == [1.75, 2.0, 2.0]
    assert operator.product(np.array([1.0, 2.0, 3.0]), "newton").tolist() == [4.0, 8.0, 12.0]


def test_a_product_that_is_kept_is_as_precise_as_matters():
    """The error may be what is neglected, over the forces; it is never larger than what steers GMRES."""
    asked: list[float] = []
    operator, x = joint(asked), np.array([6.0, 8.0, 0.0])
    operator.neglected = 1e-3
    operator.product(x, "newton")
    operator.product(1e-5 * x, "newton")
    operator.product(0.0 * x, "newton")
    operator.product(x, "newton", 0.5)
    assert asked == [pytest.approx(1e-4), STEERING, 0.0, 0.5]
