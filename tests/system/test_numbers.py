"""Rows of numbers that grow."""

import numpy as np

from ddmpi.system.numbers import Rows


def test_rows_grow_and_leave_what_was_read_as_it_is():
    """What was read stays as it is while rows are added and cut off; rows take at most twice their numbers."""
    rows = Rows()
    for k in range(20):
        rows.append([k, -k])
    before = rows.all
    rows.shorten(3)
    for _ in range(10_000):
        rows.append((7.0, 8.0))
    assert np.array_equal(before, np.column_stack([np.arange(20.0), -np.arange(20.0)]))
    assert len(rows) == 10_003 and rows.all[[2, 3, -1]].tolist() == [[2.0, -2.0], [7.0, 8.0], [7.0, 8.0]]
    assert rows.all.base.nbytes <= 2 * 10_003 * 2 * 8
    again = Rows(rows.all)
    again.append([1.0, 2.0])
    assert len(again) == 10_004 and len(rows) == 10_003
