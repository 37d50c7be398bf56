"""Numbers and names in words."""

import numpy as np
import pytest

from ddmpi.system.logs import printable
from ddmpi.system.numbers import in_words


@pytest.mark.parametrize(
    ("point", "words"),
    [
        ([1.133e-15, 4.0, 9.6], "(0, 4, 9.6)"),
        ([-1e-16, 2e-3], "(0, 0.002)"),
        ([1e-9, 1.0], "(1e-09, 1)"),
        ([0.0, 0.0], "(0, 0)"),
        ([np.nan, 1.0], "(nan, 1)"),
    ],
)
def test_rounding_is_no_coordinate(point, words):
    assert in_words(np.array(point), 4) == words


def test_messages_have_no_characters_that_control_a_screen():
    assert printable("no file a\0b\x1b[31m\r.msh\nnext") == "no file a\\x00b\\x1b[31m\\r.msh\nnext"
