"""Work in a process of its own."""

import os
import sys

import pytest

from ddmpi.errors import InterruptionError
from ddmpi.system import interrupt

pytestmark = pytest.mark.usefixtures("by_itself")


def test_work_is_done_elsewhere(tmp_path, monkeypatch):
    """The other process has its own folder as current folder and home, and does not know that this one is a rank."""
    monkeypatch.setenv("OMPI_COMM_WORLD_RANK", "1")
    monkeypatch.setenv("PMIX_RANK", "1")
    known = interrupt.apart(tmp_path, dict, [("pid", 1)])
    assert known == {"pid": 1} and interrupt.apart(tmp_path, os.getpid) != os.getpid()
    assert (
        interrupt.apart(tmp_path, os.getcwd)
        == str(tmp_path)
        == interrupt.apart(tmp_path, os.getenv, "HOME")
    )
    assert [
        interrupt.apart(tmp_path, os.getenv, name) for name in ("OMPI_COMM_WORLD_RANK", "PMIX_RANK")
    ] == [None] * 2


@pytest.mark.parametrize(
    ("work", "words"),
    [
        ((os._exit, 3), "exit code 3"),
        ((os._exit, 0), "exit code 0"),
        ((os.abort,), "signal SIGABRT"),
        ((sys.exit, "words"), "exit code 1: words"),
        ((int, "x"), "exit code 1: ValueError: invalid literal for int"),
    ],
)
def test_how_the_other_process_ends_is_told(tmp_path, work, words):
    """An end without a result is an error that says how, whatever ends the process."""
    with pytest.raises(ChildProcessError, match=words):
        interrupt.apart(tmp_path, *work)


def test_a_signal_noted_before_ends_it(tmp_path, monkeypatch):
    """What is noted while the other process works ends it, and is raised."""
    import time

    monkeypatch.setattr(interrupt, "_received", ["SIGTERM"])
    start = time.monotonic()
    with pytest.raises(InterruptionError):
        interrupt.apart(tmp_path, time.sleep, 600.0)
    assert time.monotonic() - start < 300.0
