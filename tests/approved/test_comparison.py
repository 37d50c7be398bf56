"""Whether a transcript tells what has changed: a number, a word, a line that comes or goes."""

import numpy as np
import pytest
import transcripts
from transcripts import fold


def test_weights_tell_an_exchange_and_a_sign():
    x = np.array([3.0, -1.0, 0.4, 0.0])
    sums = [fold(values) for values in (x, -x, x[::-1], 1.001 * x, np.append(x, 0.0), x[:3])]
    assert len(set(np.round(sums[:4], 4))) == 4 and sums[4] == pytest.approx(sums[0]) == sums[5]
    assert fold(1e-10 * x) == 0.0  # rounding


@pytest.mark.parametrize(
    ("old", "new", "same"),
    [
        ("force (1.234, 5) N", "force (1.235, 5) N", True),  # one in the last digit
        ("force (1.234, 5) N", "force (1.236, 5) N", False),
        ("force (1.234, 5) N", "force (1.234, 6) N", False),
        ("3 open nodes", "3 closed nodes", False),
        ("gap: 1.0001 2e-6", "gap: 1.0002 4e-5", True),  # beside the largest
        ("gap: 1.0001 2e-6", "gap: 1.0004 2e-6", False),
        ("gap: 1.0 2.0", "gap: 1.0 2.0 3.0", False),
        ("off by ~ of it", "off by 7 of it", True),
        ("residual 3e-14", "residual 0.0", True),
    ],
)
def test_a_transcript_tells_words_and_numbers(old, new, same):
    told = transcripts.differences([new, "end"], [old, "end"])
    assert (told == []) is same
    assert same or told == [f"- {old}", f"+ {new}"]


def test_lines_that_come_and_go_are_told():
    assert transcripts.differences(["a", "c 1"], ["a", "b", "c 1"]) == ["- b"]
    assert transcripts.merged("t", ["x 1.5 of 3"], ["x 1.7 of 3"]) == ["x ~ of 3"]
    with pytest.raises(SystemExit, match="words hang on rounding"):
        transcripts.merged("t", ["x 1"], ["y 1"])
