"""Ranks that part are noticed: a debug mode compares where in the program each rank calls a collective."""

import pytest
from lockstep import Lockstep, LockstepError
from mpi4py import MPI

from ddmpi.system.agreement import LOCKSTEP, agree, in_lockstep, merged

two_ranks = pytest.mark.mpi(ranks=2)


@two_ranks
def test_ranks_at_different_collectives_are_told_where_they_are(comm):
    """One rank has an error to agree on, the other goes on to merge tables: both learn of it, with both places."""
    with pytest.raises(LockstepError) as told:
        if comm.rank:
            merged(comm, {})
        else:
            agree(comm, None)
    assert "rank 0: Allreduce, system/agreement.py" in str(told.value) and " agree" in str(
        told.value
    )
    assert "rank 1: allgather, system/agreement.py" in str(told.value) and " merged" in str(
        told.value
    )


@two_ranks
def test_nothing_is_compared_without_being_asked_for(comm, monkeypatch):
    """A run pays for it only where the environment says so; alone, a rank has nobody to compare with."""
    assert isinstance(comm, Lockstep)
    assert in_lockstep(MPI.COMM_SELF) is MPI.COMM_SELF
    if comm.rank == 0:  # a rank on another host may not have it
        monkeypatch.delenv(LOCKSTEP)
    assert in_lockstep(MPI.COMM_WORLD) is MPI.COMM_WORLD
