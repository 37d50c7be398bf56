"""What crosses the ranks: interface vectors, counted, and errors, agreed on."""

import numpy as np
import pytest
import scenes
from scenes import Stack

from ddmpi.coupling.exchange import Exchange
from ddmpi.errors import DdmpiError, InputError, OutputError, SolverError
from ddmpi.system.agreement import agreed

two_ranks = pytest.mark.mpi(ranks=2, timeout=60, unit="s")
WORD = 8
"""Bytes of a double."""

HEADER = 2
"""Words before each vector: whether the sender is well, and what the message is about."""


MESSAGE = ["Isend", "Probe", "Recv"]
"""The MPI calls of one exchange."""


def exchange_on(comm, first: int = 0) -> Exchange:
    """An exchange in which the body of rank `first` is the interface's first."""
    return Exchange(comm, partner=1 - comm.rank, first=comm.rank == first)


class Traffic:
    """Passes everything on to a communicator and notes what was asked of it."""

    def __init__(self, comm) -> None:
        self._comm, self.calls, self.lengths = comm, [], []

    def Isend(self, send, *arguments):
        self.calls.append("Isend")
        self.lengths.append(len(send))
        return self._comm.Isend(send, *arguments)

    def __getattr__(self, name: str):
        value = getattr(self._comm, name)
        if callable(value):
            self.calls.append(name)
        return value


# Vectors


@two_ranks
def test_swap_returns_the_first_bodys_vector_first(comm):
    for first in (0, 1):
        exchange = exchange_on(comm, first)
        mine = np.array([comm.rank, 10.5, -np.inf])
        one, two = exchange.swap(mine, "test")
        assert one.tolist() == [first, 10.5, -np.inf]
        assert two.tolist() == [1 - first, 10.5, -np.inf]
        assert mine.tolist() == [comm.rank, 10.5, -np.inf]

        rng = np.random.default_rng(comm.rank)
        own = rng.standard_normal(1000)
        pair = exchange.swap(own, "test")
        for place, vector in enumerate(pair):
            rank = first if place == 0 else 1 - first
            assert np.array_equal(vector, np.random.default_rng(rank).standard_normal(1000))

        assert [len(vector) for vector in exchange.swap(np.empty(0), "test")] == [0, 0]
        assert all(np.isnan(vector).all() for vector in exchange.swap(np.full(2, np.nan), "test"))

        before = exchange.swap(np.full(3, 1.0 + comm.rank), "test")
        exchange.swap(np.full(3, 7.0), "test")  # must not overwrite what was received
        assert sorted(vector.tolist() for vector in before) == [[1.0] * 3, [2.0] * 3]


@two_ranks
def test_messages_and_bytes_of_vectors_are_counted(comm):
    exchange = exchange_on(comm, first=1)
    assert exchange.swap_objects({"rank": comm.rank}) == ({"rank": 1}, {"rank": 0})
    assert (exchange.messages, exchange.bytes) == (0, 0)
    sizes = [5, 0, 132, 1]
    for number, size in enumerate(sizes, start=1):
        exchange.swap(np.zeros(size), "test")
        assert exchange.messages == number
        assert exchange.bytes == WORD * sum(size + HEADER for size in sizes[:number])


# Errors


@two_ranks
def test_deferred_error_of_one_side_is_raised_on_both(comm):
    for failing in (0, 1):
        for kind in (SolverError, InputError, OutputError):
            exchange, after = exchange_on(comm), False
            with exchange.deferred():
                if comm.rank == failing:
                    raise kind(f"rank {failing} fails")
                after = True
            assert after == (comm.rank != failing)  # nothing is raised yet
            with pytest.raises(kind, match=rf"^rank {failing} fails$") as caught:
                exchange.swap(np.zeros(4), "test")
            assert caught.value.agreed
            assert caught.value.exit_code == kind.exit_code

    exchange = exchange_on(comm)
    with exchange.deferred():
        raise SolverError(f"rank {comm.rank} fails, too")
    with pytest.raises(SolverError, match=r"^rank 0 fails, too$"):
        exchange.swap(np.zeros(1), "test")


@two_ranks
def test_deferred_keeps_nothing_but_our_own_errors(comm):
    """Another exception is a bug: it ends the run at once (test_failures), and is no rank's to agree on."""
    exchange = exchange_on(comm)
    with exchange.deferred():
        value = 1.0 + comm.rank
    with pytest.raises(ZeroDivisionError), exchange.deferred():
        _ = 1 // 0
    assert [v.tolist() for v in exchange.swap(np.array([value]), "test")] == [[1.0], [2.0]]


@two_ranks
def test_agreed_raises_the_first_error_on_all_ranks(comm):
    for failing in (0, 1):
        with pytest.raises(InputError, match=rf"^seen by {failing}$") as caught, agreed(comm):
            if comm.rank == failing:
                raise InputError(f"seen by {failing}")
        assert caught.value.agreed
    with pytest.raises(SolverError, match=r"^of 0$"), agreed(comm):
        raise SolverError(f"of {comm.rank}")
    with pytest.raises(DdmpiError, match=r"^of 0$") as caught, agreed(comm):
        raise (InputError if comm.rank == 0 else SolverError)(f"of {comm.rank}")
    assert isinstance(caught.value, InputError)
    with agreed(comm):  # without an error, nothing happens
        value = comm.rank + 1
    assert comm.allreduce(value) == 3


@two_ranks
def test_ranks_at_different_points_notice_it(comm):
    """Processors that round differently may end an iteration at different steps; the two must not mix."""
    exchange = exchange_on(comm)
    with pytest.raises(SolverError, match="different points") as caught:
        exchange.swap(np.zeros(3), ("forces", "answer")[comm.rank])
    assert caught.value.agreed


@pytest.mark.mpi(ranks=2, timeout=15, unit="s")
def test_ranks_at_different_points_notice_it_whatever_they_send(comm):
    """The vectors of different points have different lengths: one message is longer than the other expects."""
    for longer in (0, 1):
        exchange = exchange_on(comm)
        with pytest.raises(SolverError, match="different points"):
            exchange.swap(np.zeros(7 if comm.rank == longer else 4), ("forces", "answer")[comm.rank])


# Traffic of the iterations


def iterations_of(comm, scene: dict):
    """The assembly of a published iteration, and the iteration at its first step."""
    from ddmpi.methods.published import PublishedIteration

    assembly = scenes.prepare_scene(comm, scene)
    return assembly, PublishedIteration(assembly, assembly.scene.method)


def taller(stack: Stack, rows: int) -> dict:
    """The stack's scene with `rows` rows of elements in each body instead of as many as columns."""
    scene = stack.scene(outer="relaxation", algorithm="original", tolerance=1e-6)
    for body in scene["body"]:
        body["mesh"]["divisions"][1] = rows
    return scene


@two_ranks
def test_an_iteration_moves_interface_vectors_only(comm):
    """Two messages: the forces; the contact displacements and a count of multiplications. Whatever n is."""
    stack, sizes, moved = Stack(6, {"law": "coulomb", "coefficient": 0.3}, shift=1e-3), [], []
    for rows in (2, 24):
        assembly, outer = iterations_of(comm, taller(stack, rows))
        traffic = assembly.exchange.world = Traffic(comm)
        for _ in range(4):
            messages, moved_before = assembly.exchange.messages, assembly.exchange.bytes
            outer.iterate()
            assert assembly.exchange.messages - messages == 2
            moved.append(assembly.exchange.bytes - moved_before)
        assert traffic.calls == MESSAGE * 8
        sizes.append((assembly.space.interfaces[0].m, assembly.n))
    (m, n), (other_m, other_n) = sizes
    assert m == other_m == 7
    assert other_n == 12 * n
    assert set(moved) == {WORD * (2 * (2 * m + HEADER) + 1)}


@two_ranks
def test_newton_moves_interface_vectors_only(comm):
    """One message for each multiplication by the joint compliance; none is longer than the interface."""
    from ddmpi.run.solve import solve
    from ddmpi.scene.method import Method

    stack = Stack(6, {"law": "coulomb", "coefficient": 0.3}, shift=1e-3)
    for rows in (2, 24):
        assembly = scenes.prepare_scene(comm, taller(stack, rows))
        traffic = assembly.exchange.world = Traffic(comm)
        answer = solve(assembly, Method(outer="newton").settled())
        assert answer.certified
        lengths = traffic.lengths
        assert max(lengths) == assembly.space.size + HEADER
        assert traffic.calls == MESSAGE * assembly.exchange.messages
        assert assembly.exchange.bytes == WORD * sum(lengths)


@two_ranks
def test_both_ranks_hold_the_same_contact_displacement(comm):
    stack = Stack(4, {"law": "tresca", "slip_bound": 4e7}, shift=1e-3)
    _, outer = iterations_of(comm, stack.scene(outer="relaxation"))
    for _ in range(3):
        outer.iterate()
        for values in (outer.lam, outer.s1, outer.s2, outer.bound):
            mine, theirs = comm.allgather(values)
            assert np.array_equal(mine, theirs)


@two_ranks
def test_solver_error_of_one_body_is_raised_on_both(comm, monkeypatch):
    _, outer = iterations_of(comm, Stack(3, {"law": "none"}).scene(outer="relaxation"))
    outer.iterate()

    def fail(*_):
        raise SolverError("the lower body gives up")

    if comm.rank == 1:
        monkeypatch.setattr(outer.subproblem, "neumann", fail)
    with pytest.raises(SolverError, match=r"^the lower body gives up$"):
        outer.run(1e-10)
    assert len(outer.history) == 0  # the failed step is no step
