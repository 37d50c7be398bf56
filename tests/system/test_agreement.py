"""Errors that all ranks raise alike."""

import time

import numpy as np
import pytest
from mpi4py import MPI

from ddmpi.errors import InternalError, SolverError
from ddmpi.system.agreement import agree_on_mistake, agreed, explained


@pytest.mark.parametrize(
    ("work", "words"),
    [
        (lambda: 1e300**2, "numbers out of the range of double precision .*choose other units"),
        (
            lambda: np.linalg.svd(np.full((2, 2), np.nan)),
            r"numbers out of the range of double precision \(SVD",
        ),
        (lambda: np.empty(2**55), "not enough memory: Unable to allocate 256. PiB"),
    ],
)
def test_what_is_too_large_is_an_error_of_the_solver(work, words):
    """Numbers and arrays that no machine holds have a message and an exit code, wherever they come up."""
    with pytest.raises(SolverError, match=words), explained():
        work()
    with pytest.raises(SolverError, match=words) as error, agreed(MPI.COMM_SELF):
        work()
    assert error.value.agreed


@pytest.mark.mpi(ranks=2)
def test_ranks_that_wait_asleep_take_no_processor_time(comm):
    """An error of the rank that others wait for is theirs, too."""
    before = time.process_time()
    with pytest.raises(SolverError, match="late"), agreed(MPI.COMM_WORLD, asleep=True):
        if comm.rank:
            time.sleep(0.4)
            raise SolverError("late")
    assert time.process_time() - before < 0.2


@pytest.mark.mpi(ranks=2)
def test_a_mistake_at_the_same_line_of_all_ranks_is_agreed_on(comm):
    """Then they can go on with another case; ranks with other mistakes, or at other lines, cannot."""
    beside, found = MPI.COMM_WORLD.Dup(), []

    def caught(*mistakes: Exception) -> InternalError | None:
        try:
            raise mistakes[comm.rank]
        except Exception as error:
            return agree_on_mistake(beside, error)

    found.append(caught(KeyError("a"), KeyError("b")))
    found.append(caught(KeyError("a"), IndexError("a")))
    try:
        if comm.rank:
            raise KeyError("a")
        raise KeyError("a")
    except KeyError as error:
        found.append(agree_on_mistake(beside, error))
    beside.Free()
    assert isinstance(found[0], InternalError) and "KeyError" in str(found[0])
    assert found[1:] == [None, None]
