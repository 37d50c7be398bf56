"""Phases of a run."""

import logging
from threading import Timer

import pytest

from ddmpi.system import clock
from ddmpi.system.clock import Clock


@pytest.fixture
def waiting(monkeypatch, caplog) -> list[Timer]:
    """What waits to tell something: it does so when it is called, whatever time has passed."""
    timers = list[Timer]()

    def wait(timer: Timer) -> None:
        timers.append(timer)

    monkeypatch.setattr(Timer, "start", wait)
    caplog.set_level(logging.INFO, "ddmpi")
    return timers


@pytest.mark.parametrize("phase", ["factor", "outer"])
def test_a_long_phase_is_told(caplog, waiting, phase):
    """One that says nothing by itself; afterwards nothing waits."""
    at_work = Clock()
    with at_work.phase(phase):
        for timer in waiting:
            assert timer.interval == clock.LONG
            assert not timer.finished.is_set()
            timer.function(*timer.args)
    words = "factorizations of bodies, and their compliances: at work for 5 s"
    assert [record.getMessage() for record in caplog.records] == [words] * (phase == "factor")
    assert len(waiting) == (phase == "factor")
    assert all(timer.finished.is_set() for timer in waiting)
    assert at_work.seconds[phase] > 0.0


def test_a_phase_that_fails_is_not_told(waiting):
    with pytest.raises(ValueError, match="lost"), Clock().phase("factor"):
        raise ValueError("lost")
    assert all(timer.finished.is_set() for timer in waiting) and waiting


def test_nothing_waits_where_nobody_listens(caplog, waiting):
    """A thread for each phase takes longer than a small scene."""
    caplog.set_level(logging.WARNING, "ddmpi")
    with Clock().phase("factor"):
        assert not waiting
