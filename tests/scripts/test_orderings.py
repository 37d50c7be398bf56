"""scripts/study orderings: which figures count, and what its table says of them."""

import benchmark
import pytest


def test_orderings_take_the_fastest_of_each_kind():
    """Figures of a kind are of one turn, the fastest; the ratio has the outer iteration in it."""
    one = {name: 1.0 for name in benchmark.ORDERINGS} | {"mesh": "squares:9", "n": 180, "outer": 0.5}
    slow = one | {"schur_wall": 3.0, "schur_user": 0.1, "plain_wall": 0.8, "plain_user": 7.0, "outer": 0.25}
    found = benchmark.fastest([one, slow])
    assert (found["schur_wall"], found["schur_user"], found["plain_wall"], found["plain_user"]) == (1, 1, 0.8, 7)
    assert found["outer"] == 0.25
    (line,) = [line for line in benchmark.orderings_page([one, slow], ["squares:9"]).splitlines() if "| 180 |" in line]
    assert float(line.split("|")[-7]) == pytest.approx((1.0 + 0.25) / 0.8, abs=0.006)
