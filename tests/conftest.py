"""Fixtures that several test modules share, and what pytest-isolate-mpi leaves to be mended."""

import os
import re
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

SUPPORT = Path(__file__).resolve().with_name("support")
os.environ["DDMPI_LOCKSTEP"] = str(SUPPORT / "lockstep.py")
"""A rank that leaves the others is an error in every test, instead of a hang."""

sys.path += [str(SUPPORT), str(SUPPORT.parents[1] / "scripts")]  # what the studies share is tested, too


class Quiet(int):
    """The verbosity of -q. Because it is false, pytest-isolate-mpi does not hand it on to its ranks, as "-"."""

    def __bool__(self) -> bool:
        return False


def pytest_configure(config: pytest.Config) -> None:
    """One time limit for all tests on several ranks; -q works."""
    from scenes import LIMIT

    config.option.mpi_default_test_timeout = config.option.mpi_default_test_timeout or LIMIT
    if config.option.verbose < 0:
        config.option.verbose = Quiet(config.option.verbose)
    config.addinivalue_line("markers", "hosts: runs on several hosts, which scripts/local_hosts.sh makes")


def pytest_sessionstart(session: pytest.Session) -> None:
    """What ranks report gets the test's own name, which can be pasted back, and --lf and the progress know.

    Failures come last, as a rank that passes would make --lf forget one that does not.
    """
    def named(report: pytest.TestReport) -> pytest.TestReport:
        path, line, name = report.location
        if rank := re.search(r"\[rank=(\d+)\]$", report.nodeid):
            report.nodeid = report.nodeid.removesuffix(rank[0])
            report.location = path, line, name.removesuffix(rank[0])
            report.sections.append((f"on rank {rank[1]}", ""))
        return report

    for plugin in session.config.pluginmanager.get_plugins():
        if ranks := getattr(plugin, "_mpi_runtestprotocol", None):
            plugin._mpi_runtestprotocol = lambda item, ranks=ranks: [
                named(report) for report in sorted(ranks(item), key=lambda report: report.failed)]


@pytest.fixture(scope="session")
def comm(comm):
    """All ranks; their collectives are compared."""
    from ddmpi.system.agreement import in_lockstep

    return in_lockstep(comm)


@pytest.fixture(autouse=True)
def figures() -> Iterator[None]:
    """Closes what a test has drawn."""
    yield
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


@pytest.fixture
def petsc_options() -> Iterator[Callable[..., None]]:
    """Sets PETSc options for one test: ``petsc_options(body_ksp_type="cg")``; afterwards they are gone."""
    from petsc4py import PETSc

    options, names = PETSc.Options(), set()

    def put(**values: object) -> None:
        for name, value in values.items():
            names.add(name)
            options.setValue(name, value)

    yield put
    for name in names:
        options.delValue(name)
