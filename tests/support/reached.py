"""A pytest plugin that writes down which lines of the program each test reaches, and its seconds (`-p reached`).

Each process, also a rank under mpirun, writes a JSON file into the folder DDMPI_REACHED. What a fixture of a module
reaches counts for all tests that use it. Lines of a function are looked at in its first calls by each test.
"""

import functools
import json
import os
import pickle
import sys
import time
from collections import defaultdict
from collections.abc import Callable, Generator
from pathlib import Path
from types import CodeType, FrameType
from typing import Any

import pytest

PROGRAM = str(Path(__file__).resolve().parents[2] / "ddmpi") + os.sep

CALLS, LINES = 30, 2000
"""Calls of a function in a test whose lines are looked at, and lines of each of them."""

Reached = dict[CodeType, tuple[set[int], list[int]]]

tests: dict[str, dict[str, Any]] = {}
fixtures: dict[tuple[str, str], Reached] = defaultdict(dict)
here: Reached = {}
"""By function its lines, and how often it was called, of the test or fixture that runs."""


def trace(frame: FrameType, event: str, argument: object) -> Any:
    code = frame.f_code
    if not code.co_filename.startswith(PROGRAM):
        return None
    lines, calls = here.setdefault(code, (set(), [0]))
    calls[0] += 1
    if calls[0] > CALLS:
        return None
    left = LINES

    def each(frame: FrameType, event: str, argument: object) -> Any:
        nonlocal left
        lines.add(frame.f_lineno)
        left -= 1
        frame.f_trace_lines = left > 0
        return each

    return each


def by_file(reached: Reached) -> dict[str, list[int]]:
    found: dict[str, set[int]] = defaultdict(set)
    for code, (lines, _) in reached.items():
        found[code.co_filename.removeprefix(PROGRAM).removesuffix(".py")] |= lines
    return {file: sorted(lines) for file, lines in found.items()}


def forget() -> None:
    """What functions of the program keep for later calls is made anew by each test."""
    for name, module in [*sys.modules.items()]:
        if name.startswith("ddmpi."):
            for value in [*vars(module).values()]:
                if isinstance(value, functools._lru_cache_wrapper):
                    value.cache_clear()


@pytest.hookimpl(hookwrapper=True)
def pytest_runtest_protocol(item: pytest.Item) -> Generator:
    global here
    here = {}
    forget()
    start = time.perf_counter()
    sys.settrace(trace)
    yield
    sys.settrace(None)
    seconds = time.perf_counter() - start
    used = [
        reached
        for (place, name), reached in fixtures.items()
        if name in item.fixturenames and item.nodeid.startswith(place)
    ]
    reached = [by_file(one) for one in (here, *used)]
    files = {file for one in reached for file in one}
    lines = {file: sorted({k for one in reached for k in one.get(file, ())}) for file in files}
    tests[item.nodeid] = {"seconds": seconds, "lines": lines}


@pytest.hookimpl(hookwrapper=True)
def pytest_fixture_setup(fixturedef: Any, request: Any) -> Generator:
    """Of fixtures of a module or more; one within another counts for the outer one, too."""
    global here
    if fixturedef.scope == "function":
        yield
        return
    outer, here = here, fixtures[fixturedef.baseid, fixturedef.argname]
    yield
    for code, (lines, calls) in here.items():
        outer.setdefault(code, (set(), calls))[0].update(lines)
    here = outer


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    if report.failed:
        tests.setdefault(report.nodeid, {})["failed"] = True


def write_apart(work: Callable[[], None]) -> None:
    """Do some `work` in a process of its own, and write down what the test reaches that waits for its answer."""
    answer = pickle.dump

    def noted(*given: Any) -> None:
        sys.settrace(None)
        name = os.environ["PYTEST_CURRENT_TEST"].rpartition(" ")[0]
        tests[name] = {"seconds": 0.0, "lines": by_file(here)}
        pytest_sessionfinish()
        answer(*given)

    pickle.dump = noted
    sys.settrace(trace)
    work()


def pytest_sessionfinish() -> None:
    name = f"{os.getpid()}-{time.time_ns()}.json"
    Path(os.environ["DDMPI_REACHED"], name).write_text(json.dumps(tests), encoding="utf-8")
