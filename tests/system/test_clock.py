"""Phases of a run."""

import logging
import time

import pytest

from ddmpi.system import clock
from ddmpi.system.clock import Clock


@pytest.mark.parametrize(
    ("phase", "seconds", "told"),
    [("factor", 0.3, True), ("factor", 0.0, False), ("outer", 0.3, False)],
)
def test_a_long_phase_is_told(monkeypatch, caplog, phase, seconds, told):
    """One that takes long and says nothing by itself; of a short one nothing comes later either."""
    monkeypatch.setattr(clock, "LONG", 0.1)
    at_work = Clock()
    with caplog.at_level(logging.INFO, "ddmpi"):
        with at_work.phase(phase):
            time.sleep(seconds)
        time.sleep(0.2)
    assert at_work.seconds[phase] >= seconds
    words = "factorizations of bodies, and their compliances: at work for 0.1 s"
    assert [record.getMessage() for record in caplog.records] == [words] * told


def test_a_phase_that_fails_is_not_told(monkeypatch, caplog):
    monkeypatch.setattr(clock, "LONG", 0.1)
    caplog.set_level(logging.INFO, "ddmpi")
    with pytest.raises(ValueError, match="lost"), Clock().phase("factor"):
        raise ValueError("lost")
    time.sleep(0.2)
    assert not caplog.records
