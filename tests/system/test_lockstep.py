"""Ranks that part are noticed: a debug mode compares where in the program each rank calls a collective."""

import numpy as np
import pytest
from lockstep import Lockstep, LockstepError
from mpi4py import MPI

from ddmpi.coupling.space import Space
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
    assert "rank 0: Allreduce, system/agreement.py" in str(told.value) and " agree" in str(told.value)
    assert "rank 1: allgather, system/agreement.py" in str(told.value) and " merged" in str(told.value)


@two_ranks
def test_a_rank_that_leaves_a_loop_alone_is_noticed(comm):
    """The sizes of the messages, the call and its caller's caller agree; the line of the program does not."""
    space = Space([], comm)
    with pytest.raises(LockstepError, match="norm"):
        for _ in range(2 + comm.rank):
            space.norm(np.ones(3))
        space.any(np.ones(3))


@two_ranks
def test_arrays_of_different_types_are_noticed(comm):
    """A sum over the contacts of a rank that has none is an integer, whose bits MPI would take for those of a number.
    Vectors of interfaces are numbers, whatever they are made of."""
    values = np.array([0.5] if comm.rank else [1])
    with pytest.raises(LockstepError, match="float64"):
        comm.Allreduce(values, np.empty_like(values))
    assert Space([], comm).add(values)[0] == 1.5


@two_ranks
def test_communicators_of_the_same_ranks_compare_on_one(comm):
    """A rank that has gone on to another communicator, as PETSc's copies are, is noticed."""
    other = in_lockstep(MPI.Intracomm(comm).Dup())
    with pytest.raises(LockstepError):
        agree(other, None) if comm.rank else merged(comm, {})


@two_ranks
def test_nothing_is_compared_without_being_asked_for(comm, monkeypatch):
    """A run pays for it only where the environment says so; alone, a rank has nobody to compare with."""
    assert isinstance(comm, Lockstep)
    assert in_lockstep(MPI.COMM_SELF) is MPI.COMM_SELF
    if comm.rank == 0:  # a rank on another host may not have it
        monkeypatch.delenv(LOCKSTEP)
    assert in_lockstep(MPI.COMM_WORLD) is MPI.COMM_WORLD
