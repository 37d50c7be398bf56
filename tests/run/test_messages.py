"""What ranks tell each other: what grows goes to neighbours, and few numbers a body and contact to the first rank."""

import counted
import pytest
import scenes

import ddmpi
from ddmpi.system.agreement import LOCKSTEP

pytestmark = pytest.mark.slow


@pytest.mark.mpi(ranks=4)
def test_what_ranks_other_than_the_first_get_does_not_grow_with_the_bodies(comm, monkeypatch):
    """Of four times the bodies, but for coarse problem, scene and answer; iterations may be twice as many."""
    monkeypatch.setenv(LOCKSTEP, counted.__file__)
    found = []
    for blocks in (4, 16):
        before = counted.counts()
        assert ddmpi.solve(scenes.tower(blocks, 2), comm).certified
        now = counted.counts()
        found.append(
            {kind: [b - a for a, b in zip(before[kind], now[kind], strict=True)] for kind in now}
        )
    few, many = found
    given, got = 0, 1
    assert few[counted.OTHERS][got] > 0 and few[counted.NEIGHBOURS][given] > 0
    if comm.rank:
        assert many[counted.OTHERS][got] <= 2.0 * few[counted.OTHERS][got]
        assert many[counted.NEIGHBOURS][got] <= 2.0 * few[counted.NEIGHBOURS][got]
        assert many[counted.FIRST][given] <= 1.2 * 4 * few[counted.FIRST][given]
        assert many[counted.FIRST][got] <= 1.2 * 4 * few[counted.FIRST][got]


@pytest.mark.mpi(ranks=4)
def test_what_the_first_rank_gets_does_not_grow_with_the_nodes(comm, monkeypatch):
    """It judges, says and writes of contacts as a whole; states at their nodes stay with the ranks that own them."""
    monkeypatch.setenv(LOCKSTEP, counted.__file__)
    got = []
    for n in (3, 12):
        scene = scenes.tower(4, n) | {"time": {"points": [1.0, 2.0]}}
        before = counted.counts()[counted.FIRST][1]
        assert ddmpi.solve(scene, comm).certified
        got.append(counted.counts()[counted.FIRST][1] - before)
    assert got[0] > 0
    if comm.rank == 0:
        assert got[1] <= 1.2 * got[0]
