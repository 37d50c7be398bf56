"""Phases of a run."""

import logging
import threading
import time

import pytest
from scenes import LIMIT

from ddmpi.system import clock, logs
from ddmpi.system.clock import Clock, now_at


@pytest.fixture(autouse=True)
def heard(caplog, monkeypatch):
    """What is told after some seconds, which nobody waits for."""
    caplog.set_level(logging.INFO, "ddmpi")
    monkeypatch.setattr(clock, "_works", [])  # no thread sees them


def after(seconds: float) -> None:
    clock.tell(time.perf_counter() + seconds)


def told(caplog) -> list[str]:
    return [record.getMessage() for record in caplog.records]


def test_a_long_phase_is_told(caplog):
    """After 5 s, and after each time twice as long; afterwards nothing is."""
    at_work = Clock()
    with at_work.phase("factor"):
        for seconds in (4.0, 5.0, 6.0, 9.0, 10.0, 19.0, 20.0):
            after(seconds)
    after(100.0)
    words = "factorizations of bodies, and their compliances: at work for"
    assert told(caplog) == [f"{words} {seconds} s" for seconds in (5, 10, 20)]
    assert at_work.seconds["factor"] > 0.0


@pytest.mark.parametrize("phase", ["mesh", "checkpoint"])
def test_other_phases_are_not(caplog, phase):
    """gmsh tells its own, and who waits for it."""
    with Clock().phase(phase):
        after(10.0)
    assert not told(caplog)


def test_a_phase_that_fails_is_not_told(caplog):
    with pytest.raises(ValueError, match="lost"), Clock().phase("factor"):
        raise ValueError("lost")
    after(10.0)
    assert not told(caplog)


def test_a_long_phase_tells_its_part(caplog):
    """The present one; what has said something itself is silent until it takes long again."""
    now_at("nothing")  # without a phase
    with Clock().phase("outer"):
        now_at("iteration 1")
        after(6.0)
        with Clock().phase("recover"):
            now_at("another phase")
        now_at("iteration 2")
        after(10.0)
        now_at("iteration 3", said=True)
        after(4.0)
        after(5.0)
    words = "iterations: at work for"
    assert told(caplog) == [
        f"{words} {seconds} s, now at iteration {k}" for seconds, k in ((5, 1), (10, 2), (5, 3))
    ]


def test_a_thread_tells_while_others_work(caplog, monkeypatch):
    """One for all phases, and none where nobody listens: it takes longer to start than a small scene."""
    monkeypatch.undo()
    watches = [thread for thread in threading.enumerate() if thread.name == clock.__name__]
    monkeypatch.setattr(clock, "LONG", 0.02)
    with Clock().phase("factor"), Clock().phase("estimate"):
        until = time.monotonic() + LIMIT
        while not told(caplog) and time.monotonic() < until:
            time.sleep(0.02)
    assert told(caplog)[0] == "the estimated error: at work for 0.02 s"
    after_it = [thread for thread in threading.enumerate() if thread.name == clock.__name__]
    assert len(after_it) == 1 and watches in ([], after_it)
    caplog.set_level(logging.WARNING, "ddmpi")
    with Clock().phase("factor"):
        assert not clock._works


def test_progress_of_a_case_is_on_the_screen_too(tmp_path, capsys):
    """Other messages of a case of a sweep are in its file alone."""
    logger = logging.getLogger("ddmpi")
    before = logger.handlers, logger.level, logger.propagate
    try:
        logs.configure(0)
        with logs.diverted(tmp_path / "run.log"):
            logger.info("of the case")
            with Clock().phase("factor"):
                now_at("body.upper, multigrid")
                after(5.0)
        logger.info("after it")
    finally:
        logger.handlers, logger.level, logger.propagate = before
    words = "compliances: at work for 5 s, now at body.upper, multigrid"
    screen, file = capsys.readouterr().out, (tmp_path / "run.log").read_text()
    assert words in screen and words in file
    assert "of the case" in file and "of the case" not in screen
    assert "after it" in screen and "after it" not in file
