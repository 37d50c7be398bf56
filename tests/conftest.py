"""Fixtures that several test modules share."""

import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

sys.path.append(str(Path(__file__).resolve().parents[1] / "scripts"))  # what the studies share is tested, too


def pytest_configure(config: pytest.Config) -> None:
    """One time limit for all tests on several ranks. -q is ignored: pytest-isolate-mpi would break."""
    from scenes import LIMIT

    config.option.mpi_default_test_timeout = config.option.mpi_default_test_timeout or LIMIT
    config.option.verbose = max(config.option.verbose, 0)
    config.addinivalue_line("markers", "hosts: runs on several hosts, which scripts/local_hosts.sh makes")


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
