"""Errors that all ranks raise alike."""

import numpy as np
import pytest
from mpi4py import MPI

from ddmpi.errors import SolverError
from ddmpi.system.agreement import agreed, explained


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
