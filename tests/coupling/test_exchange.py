"""What crosses the ranks: interface vectors, counted, between neighbours only; and errors, agreed on by all ranks."""

import signal
import zlib
from types import SimpleNamespace

import numpy as np
import pytest
import scenes
from scenes import Stack

from ddmpi.coupling.exchange import Ends, Exchange
from ddmpi.errors import DdmpiError, InputError, InterruptionError, OutputError, SolverError
from ddmpi.system import interrupt
from ddmpi.system.agreement import agreed

pytestmark = pytest.mark.slow

two_ranks = pytest.mark.mpi(ranks=2)
three_ranks = pytest.mark.mpi(ranks=3)
one_to_four_ranks = pytest.mark.mpi(ranks=[1, 2, 3, 4])
WORD = 8
"""Bytes of a double."""

CONTACTS = {
    "ab": ("a", "b", 3),
    "bd": ("b", "d", 2),
    "again": ("b", "a", 4),
    "floor": ("a", None, 5),
    "empty": ("d", "c", 0),
    "ca": ("c", "a", 1),
    "wall": ("d", None, 2),
}
"""First and second body, None for a rigid partner, and the size of the interface's vectors."""

CHAIN = {"ab": ("a", "b", 3), "bc": ("b", "c", 5), "cd": ("c", "d", 7)}


class Bodies:
    """The bodies a, b, c, d in turn on the ranks of a communicator, with contacts between them, and their exchange.

    Attributes
    ----------
    mine : of this rank, with the part of the body's vector and its side by contact
    owned : contacts that this rank owns, with the part of its vectors
    """

    def __init__(self, comm, contacts: dict = CONTACTS) -> None:
        homes = {name: k % comm.size for k, name in enumerate("abcd")}
        here = {name: homes[name] == comm.rank for name in homes} | {None: False}
        self.contacts = {
            key: each for key, each in contacts.items() if here[each[0]] or here[each[1]]
        }
        self.mine = {
            name: self._parts(
                {
                    key: (each[2], each.index(name))
                    for key, each in contacts.items()
                    if name in each[:2]
                }
            )
            for name in homes
            if here[name]
        }
        self.owned = {
            key: part
            for key, (part, _) in self._parts(
                {key: (each[2], 0) for key, each in contacts.items() if here[each[0]]}
            ).items()
        }
        self.size = max((part.stop for part in self.owned.values()), default=0)
        self.exchange = Exchange(
            comm,
            [
                Ends(key, homes[first], homes.get(second, homes[first]))
                for key, (first, second, _) in self.contacts.items()
            ],
        )
        self.exchange.connect(
            SimpleNamespace(size=self.size, parts=self.owned), list(self.mine.values())
        )

    @staticmethod
    def _parts(sizes: dict[str, tuple[int, int]]) -> dict[str, tuple[slice, int]]:
        parts, start = {}, 0
        for key, (size, side) in sizes.items():
            parts[key] = slice(start, start + size), side
            start += size
        return parts

    def vector(self, seed: int = 0) -> np.ndarray:
        """A vector of the owned interfaces that is random, but known to all."""
        return np.concatenate(
            [
                np.empty(0),
                *(known(key, part.stop - part.start, seed) for key, part in self.owned.items()),
            ]
        )

    def of_bodies(self) -> list[np.ndarray]:
        """Vectors of the bodies of this rank that are random, but known to all."""
        return [
            np.concatenate(
                [
                    np.empty(0),
                    *(known(key, part.stop - part.start, name) for key, (part, _) in parts.items()),
                ]
            )
            for name, parts in self.mine.items()
        ]


def known(contact: str, size: int, salt: object) -> np.ndarray:
    return np.random.default_rng(zlib.crc32(f"{contact} {salt}".encode())).standard_normal(size)


class Traffic:
    """Passes everything on to a communicator and notes what was asked of it."""

    def __init__(self, comm) -> None:
        self._comm, self.calls, self.lengths, self.partners = comm, [], [], set()

    def Isend(self, send, rank, *arguments):
        self.calls.append("Isend")
        self.lengths.append(len(send))
        self.partners.add(rank)
        return self._comm.Isend(send, rank, *arguments)

    def Irecv(self, receive, rank, *arguments):
        self.calls.append("Irecv")
        self.partners.add(rank)
        return self._comm.Irecv(receive, rank, *arguments)

    def __getattr__(self, name: str):
        value = getattr(self._comm, name)
        if callable(value):
            self.calls.append(name)
        return value


@pytest.fixture(autouse=True)
def no_signal_yet(monkeypatch):
    monkeypatch.setattr(interrupt, "_received", [])


# Vectors


@one_to_four_ranks
def test_each_body_sees_its_part_of_every_interface(comm):
    """A vector of the owned interfaces reaches both bodies of each, whichever ranks these live on."""
    bodies = Bodies(comm)
    x = bodies.vector()
    parts = bodies.exchange.spread(x)
    assert np.array_equal(x, bodies.vector())
    bodies.exchange.spread(bodies.vector(seed=1))  # must not overwrite what was received
    for found, (name, own) in zip(parts, bodies.mine.items(), strict=True):
        assert len(found) == sum(size for _, _, size in (CONTACTS[key] for key in own)), name
        for key, (part, _) in own.items():
            assert np.array_equal(found[part], known(key, CONTACTS[key][2], 0)), (name, key)


@one_to_four_ranks
def test_both_bodies_contributions_come_to_the_owner(comm):
    """The first body's, the second's; a rigid partner contributes nothing; the total is their sum."""
    bodies = Bodies(comm)
    mine = bodies.of_bodies()
    first, second = bodies.exchange.collect(mine, "test")
    assert all(
        np.array_equal(one, other) for one, other in zip(mine, bodies.of_bodies(), strict=True)
    )
    assert len(first) == len(second) == bodies.size
    for key, part in bodies.owned.items():
        one, other, size = CONTACTS[key]
        assert np.array_equal(first[part], known(key, size, one)), key
        assert np.array_equal(second[part], known(key, size, other) if other else np.zeros(size)), (
            key
        )
    assert np.array_equal(bodies.exchange.total(mine, "test"), first + second)


@one_to_four_ranks
def test_objects_of_both_bodies_come_to_both_ranks(comm):
    """By contact, the first body's first; None for a rigid partner's."""
    bodies = Bodies(comm)
    both = bodies.exchange.swap_objects(
        {
            (key, side): (key, name)
            for name, own in bodies.mine.items()
            for key, (_, side) in own.items()
        }
    )
    assert both == {
        key: ((key, first), (key, second) if second else None)
        for key, (first, second, _) in bodies.contacts.items()
    }


@pytest.mark.mpi(ranks=4)
def test_messages_and_bytes_of_vectors_are_counted(comm):
    """One message to each neighbour and back, with the vectors of all common interfaces; objects do not count. Ranks
    without a common contact talk of errors only, all together."""
    bodies = Bodies(comm)
    exchange = bodies.exchange
    exchange.swap_objects(
        {(key, side): None for own in bodies.mine.values() for key, (_, side) in own.items()}
    )
    exchange.meet("test")
    assert exchange.state() == {
        "messages": 0,
        "bytes": 0,
        "reductions": 1,
        "reduced_bytes": 24,
    }  # of `meet`
    lent = {
        rank: [
            each
            for each in CONTACTS.values()
            if each[0] == "abcd"[comm.rank] and each[1] == "abcd"[rank]
        ]
        for rank in range(4)
    }
    borrowed = {
        rank: [
            each
            for each in CONTACTS.values()
            if each[1] == "abcd"[comm.rank] and each[0] == "abcd"[rank]
        ]
        for rank in range(4)
    }
    messages = sent = 0
    traffic = exchange.world = Traffic(comm)
    for _ in range(2):
        for work, vectors in (
            (lambda: exchange.spread(bodies.vector()), lent),
            (lambda: exchange.collect(bodies.of_bodies(), "test"), borrowed),
        ):
            work()
            messages += sum(len(each) > 0 for each in vectors.values())
            sent += WORD * sum(size for each in vectors.values() for _, _, size in each)
            assert (exchange.sent["messages"], exchange.sent["bytes"]) == (messages, sent)
    assert comm.allreduce(messages) == 2 * 10
    assert (
        traffic.partners
        == {rank for rank in range(4) if lent[rank] or borrowed[rank]}
        == {
            "abcd".index(name)
            for name in {"a": "bc", "b": "ad", "c": "ad", "d": "bc"}["abcd"[comm.rank]]
        }
    )
    assert sorted(set(traffic.calls)) == ["Allreduce", "Irecv", "Isend"]
    assert traffic.calls.count("Allreduce") == 2 and traffic.calls.count("Isend") == messages


@two_ranks
def test_swap_returns_the_first_bodys_vector_first(comm):
    for first in (0, 1):
        exchange = exchange_of_two(comm, first)
        mine = np.array([comm.rank, 10.5, -np.inf])
        one, two = exchange.swap(mine, "test")
        assert one.tolist() == [first, 10.5, -np.inf]
        assert two.tolist() == [1 - first, 10.5, -np.inf]
        assert mine.tolist() == [comm.rank, 10.5, -np.inf]
        assert [len(vector) for vector in exchange.swap(np.empty(0), "test")] == [0, 0]
        assert all(np.isnan(vector).all() for vector in exchange.swap(np.full(2, np.nan), "test"))
        before = exchange.swap(np.full(3, 1.0 + comm.rank), "test")
        exchange.swap(np.full(3, 7.0), "test")  # must not overwrite what was received
        assert sorted(vector.tolist() for vector in before) == [[1.0] * 3, [2.0] * 3]


def exchange_of_two(comm, first: int = 0) -> Exchange:
    """An exchange in which the body of rank `first` is the interface's first."""
    return Exchange(comm, [Ends("ab", first, 1 - first)])


# Errors

WAYS = {
    "collect": lambda bodies, about: bodies.exchange.collect(bodies.of_bodies(), about),
    "meet": lambda bodies, about: bodies.exchange.meet(about),
}


@three_ranks
@pytest.mark.parametrize("way", WAYS)
def test_deferred_error_of_one_rank_is_raised_on_all(comm, way):
    """Also on a rank that has no contact with the failing one."""
    for failing in range(3):
        for kind in (SolverError, InputError, OutputError):
            bodies, after = Bodies(comm, CHAIN), False
            with bodies.exchange.deferred():
                if comm.rank == failing:
                    raise kind(f"rank {failing} fails")
                after = True
            assert after == (comm.rank != failing)  # nothing is raised yet
            bodies.exchange.spread(bodies.vector())  # nor here, in the midst of a product
            with pytest.raises(kind, match=rf"^rank {failing} fails$") as caught:
                WAYS[way](bodies, "test")
            assert caught.value.agreed
            assert caught.value.exit_code == kind.exit_code

    bodies = Bodies(comm, CHAIN)
    with bodies.exchange.deferred():
        raise SolverError(f"rank {comm.rank} fails, too")
    with pytest.raises(SolverError, match=r"^rank 0 fails, too$"):
        WAYS[way](bodies, "test")


@three_ranks
def test_a_signal_to_one_rank_is_raised_on_all(comm):
    for hit in range(3):
        interrupt._received.clear()
        bodies = Bodies(comm, CHAIN)
        bodies.exchange.meet("test")
        if comm.rank == hit:
            interrupt._note(signal.SIGTERM, None)
        with pytest.raises(InterruptionError) as caught:
            bodies.exchange.total(bodies.of_bodies(), "test")
        assert caught.value.agreed and caught.value.kind == "interrupted by SIGTERM"


@two_ranks
def test_deferred_keeps_nothing_but_our_own_errors(comm):
    """Another exception is a bug: it ends the run at once (test_failures), and is no rank's to agree on."""
    exchange = exchange_of_two(comm)
    with exchange.deferred():
        value = 1.0 + comm.rank
    with pytest.raises(ZeroDivisionError), exchange.deferred():
        _ = 1 // 0
    assert [v.tolist() for v in exchange.swap(np.array([value]), "test")] == [[1.0], [2.0]]
    exchange.meet("test")


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


@three_ranks
@pytest.mark.parametrize("way", WAYS)
def test_ranks_at_different_points_notice_it(comm, way):
    """Processors that round differently may end an iteration at different steps; their vectors must not mix."""
    for astray in range(3):
        bodies = Bodies(comm, CHAIN)
        WAYS[way](bodies, "forces")
        with pytest.raises(SolverError, match="different points") as caught:
            WAYS[way](bodies, "answer" if comm.rank == astray else "forces")
        assert caught.value.agreed


# Traffic of the iterations


def taller(stack: Stack, rows: int) -> dict:
    """The stack's scene with `rows` rows of elements in each body instead of as many as columns."""
    scene = stack.scene(outer="relaxation", algorithm="original", tolerance=1e-6)
    for body in scene["body"]:
        body["mesh"]["divisions"][1] = rows
    return scene


@two_ranks
def test_newton_moves_interface_vectors_only(comm):
    """Two bodies: one message each for a multiplication by the joint compliance; none is longer than the interface."""
    from ddmpi.methods.newton import Newton

    stack = Stack(6, {"law": "coulomb", "coefficient": 0.3}, shift=1e-3)
    for rows in (2, 24):
        assembly = scenes.prepare_scene(comm, taller(stack, rows))
        newton, exchange, size = Newton(assembly.joint, 500), assembly.exchange, 2 * assembly.m
        messages, sent = exchange.sent["messages"], exchange.sent["bytes"]
        traffic = exchange.world = Traffic(comm)
        assert newton.run(1e-8) == "converged"
        products, counts = assembly.member.C.count["newton"], len(newton.history)
        assert products > 10
        assert traffic.lengths == [size] * products
        assert traffic.calls.count("Allreduce") == products
        assert len(traffic.calls) == 3 * products + counts
        assert exchange.sent["messages"] - messages == len(traffic.lengths)
        assert exchange.sent["bytes"] - sent == WORD * sum(traffic.lengths)
