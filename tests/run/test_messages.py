"""What ranks tell each other: what grows with the number of bodies goes to neighbours and to the first rank alone."""

import counted
import pytest
import scenes

import ddmpi
from ddmpi.system.agreement import LOCKSTEP

pytestmark = pytest.mark.slow


@pytest.mark.mpi(ranks=4)
def test_what_ranks_other_than_the_first_get_does_not_grow_with_the_bodies(comm, monkeypatch):
    """With four times the bodies they get as much in an iteration, but for coarse problem, scene and answer.

    What a rank gives to the first one is of its own bodies. There may be up to twice as many iterations.
    """
    monkeypatch.setenv(LOCKSTEP, counted.__file__)
    found = []
    for blocks in (4, 16):
        before = counted.counts()
        assert ddmpi.solve(scenes.tower(blocks, 2), comm).certified
        now = counted.counts()
        found.append({kind: [b - a for a, b in zip(before[kind], now[kind], strict=True)] for kind in now})
    few, many = found
    given, got = 0, 1
    assert few[counted.OTHERS][got] > 0 and few[counted.NEIGHBOURS][given] > 0
    if comm.rank:
        assert many[counted.OTHERS][got] <= 2.0 * few[counted.OTHERS][got]
        assert many[counted.NEIGHBOURS][got] <= 2.0 * few[counted.NEIGHBOURS][got]
        assert many[counted.FIRST][given] <= 1.2 * 4 * few[counted.FIRST][given]
        assert many[counted.FIRST][got] <= 1.2 * 4 * few[counted.FIRST][got]
