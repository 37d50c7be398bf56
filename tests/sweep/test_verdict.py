"""What a sweep ends with, from the records of its cases. No MPI."""

from types import SimpleNamespace

import pytest

from ddmpi.errors import InternalError, NotConvergedError, OutputError
from ddmpi.sweep.sweep import _judge
from ddmpi.sweep.table import read_outcome, record_case


@pytest.mark.parametrize(
    ("exits", "error"),
    [
        ((0, 0, 0), None),
        ((0, 3, 2), NotConvergedError),
        ((0, 5, 3), OutputError),
        ((5, 1, 3), InternalError),
        ((0, None, 0), NotConvergedError),
    ],
)
def test_the_worst_case_decides_how_a_sweep_ends(tmp_path, exits, error):
    """A mistake of the program before results that could not be written, and these before answers that are missing."""
    cases = [SimpleNamespace(number=k, values={}) for k in range(len(exits))]
    places = {case.number: tmp_path / str(case.number) for case in cases}
    for case, code in zip(cases, exits, strict=True):
        places[case.number].mkdir()
        record_case(places[case.number], case, code, "a reason")
        assert read_outcome(places[case.number]).exit == code
    sweep = SimpleNamespace(chosen=cases, folder=tmp_path, place=lambda case: places[case.number])
    if error is None:
        _judge(sweep)
        return
    with pytest.raises(error) as said:
        _judge(sweep)
    assert type(said.value) is error
    assert f"{exits.count(0)} of 3 cases in {tmp_path} have a certified answer; " in str(said.value)
