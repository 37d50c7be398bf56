"""Fixtures that several test modules share, and what pytest-isolate-mpi leaves to be mended."""

import contextlib
import gc
import os
import pickle
import re
import shlex
import shutil
import sys
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Generator, Iterator
from pathlib import Path
from typing import Any

import pytest

SUPPORT = Path(__file__).resolve().with_name("support")
os.environ["DDMPI_LOCKSTEP"] = str(SUPPORT / "lockstep.py")
"""A rank that leaves the others is an error in every test, instead of a hang."""

os.environ |= {"OMPI_MCA_mpi_yield_when_idle": "1"}
"""A rank that waits gives way: on a busy machine this halves the time of tests on several ranks."""

# What the studies share is tested, too.
sys.path += [
    str(SUPPORT),
    str(SUPPORT.parents[1] / "scripts"),
]


class Quiet(int):
    """The verbosity of -q. Because it is false, pytest-isolate-mpi does not hand it on to its ranks, as "-"."""

    def __bool__(self) -> bool:
        return False


def pytest_configure(config: pytest.Config) -> None:
    """One time limit for all tests on several ranks; -q works; temporary folders of this run alone."""
    from scenes import LIMIT

    own_temporary_root(config)

    config.option.mpi_default_test_timeout = config.option.mpi_default_test_timeout or LIMIT
    if config.option.verbose < 0:
        config.option.verbose = Quiet(config.option.verbose)
    if sys.stdout.isatty() and config.option.verbose == 0 and config.getoption("capture") != "no":
        config.pluginmanager.register(Bar(config), "bar")
    config.addinivalue_line("markers", "clarabel: asks whether there is an equilibrium")
    config.addinivalue_line(
        "markers", "hosts: runs on several hosts, which scripts/local_hosts.sh makes"
    )


def own_temporary_root(config: pytest.Config) -> None:
    """A root of temporary folders for this run, its workers and its ranks, which goes with it.

    In the root that a user's sessions share, one with pytest's usual retention takes away folders whose locks are gone,
    and pytest-isolate-mpi uses such folders on.
    """
    if not os.environ.get("PYTEST_DEBUG_TEMPROOT"):
        root = os.environ["PYTEST_DEBUG_TEMPROOT"] = tempfile.mkdtemp(prefix="ddmpi-tests-")
        config.add_cleanup(lambda: os.environ.pop("PYTEST_DEBUG_TEMPROOT", None))
        config.add_cleanup(lambda: shutil.rmtree(root, ignore_errors=True))


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Of the cases of a test that is marked so, the quick suite asks every k-th."""
    seen: Counter[str] = Counter()
    for item in items:
        mark, name = item.get_closest_marker("every"), item.nodeid.partition("[")[0]
        if mark and not item.get_closest_marker("slow"):
            if seen[name] % mark.args[0]:
                item.add_marker("slow")
            seen[name] += 1


def pytest_runtest_setup(item: pytest.Item) -> None:
    """What needs the optional clarabel is skipped without it."""
    if item.get_closest_marker("clarabel"):
        pytest.importorskip("clarabel", reason="needs clarabel")


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config: pytest.Config, log: object) -> object:
    """With -n of pytest-xdist, files are shared out whole, but for tests on as many ranks, which share an mpirun. Others
    whose first parameter is such a number go with them: no harm is done."""
    from xdist.scheduler import LoadScopeScheduling

    class Whole(LoadScopeScheduling):
        def _split_scope(self, nodeid: str) -> str:
            file, _, name = nodeid.partition("::")
            ranks = re.search(r"\[(\d)[-\]]", name)
            return f"on {ranks[1]}" if ranks else file

    return Whole(config, log)


def pytest_sessionstart(session: pytest.Session) -> None:
    """Tests on several ranks share an mpirun and report under their own names."""
    for plugin in session.config.pluginmanager.get_plugins():
        if run := getattr(plugin, "_mpi_runtestprotocol", None):
            plugin._mpi_runtestprotocol = Together(plugin, run)
            plugin._mpi_runtestprococol_inner = Kept(plugin._mpi_runtestprococol_inner)


class Bar:
    """On a terminal, one line that grows in place of letters for tests: what is done, what has failed, where it is."""

    WIDTH = 30

    def __init__(self, config: pytest.Config) -> None:
        self.config, self.total, self.done, self.failed = config, 0, 0, 0

    def pytest_collection_finish(self, session: pytest.Session) -> None:
        self.total = len(session.items)

    @pytest.hookimpl(optionalhook=True)
    def pytest_xdist_node_collection_finished(self, ids: list[str]) -> None:
        self.total = len(ids)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtestloop(self) -> None:
        reporter = self.config.pluginmanager.get_plugin("terminalreporter")
        reporter.showfspath = reporter._show_progress_info = False

    @pytest.hookimpl(hookwrapper=True)
    def pytest_report_teststatus(self) -> Generator:
        """The category alone, without a letter."""
        outcome = yield
        category, _, word = outcome.get_result()
        outcome.force_result((category, "", word))

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        self.failed += report.failed

    def pytest_runtest_logfinish(self, nodeid: str) -> None:
        """Once for each test, on however many ranks."""
        self.done += 1
        self.tell(nodeid.partition("::")[0])

    def tell(self, where: str) -> None:
        """Write the line, with what runs or has ended."""
        part = self.done / max(self.total, 1)
        failed = f", {self.failed} failed" if self.failed else ""
        bar = "#" * round(part * self.WIDTH)
        line = f"[{bar:<{self.WIDTH}}] {part:4.0%} of {self.total}{failed}  {where}"
        end = "\n" if self.done == self.total else ""
        sys.__stdout__.write(f"\r\033[K{line[: shutil.get_terminal_size().columns - 1]}{end}")
        sys.__stdout__.flush()


def pytest_terminal_summary(terminalreporter: pytest.TerminalReporter) -> None:
    """The five files that took longest, with setups, tests on several ranks by all of them."""
    spent: Counter[str] = Counter()
    for reports in terminalreporter.stats.values():
        for report in reports:
            if isinstance(report, pytest.TestReport):
                spent[report.nodeid.partition("::")[0]] += report.duration
    if spent and terminalreporter.verbosity >= 0:
        terminalreporter.section("slowest files")
        for file, seconds in spent.most_common(5):
            terminalreporter.line(f"{seconds:7.1f} s  {file}")


Runner = Callable[[pytest.Item], list[pytest.TestReport]]


class Kept:
    """What runs a test on a rank, for several tests: returns reports of one, and writes those of all so far."""

    GRACE = 5.0
    """Seconds that a rank whose only test has failed leaves the others to report."""

    def __init__(self, run: Runner) -> None:
        self.run = run
        self.reports: list[pytest.TestReport] = []

    def __call__(self, item: pytest.Item) -> list[pytest.TestReport]:
        from mpi4py import MPI

        new = self.run(item)
        self.reports += new
        path = Path(os.environ["PYTEST_MPI_REPORTS_PATH"], str(MPI.COMM_WORLD.rank))
        path.write_bytes(pickle.dumps(self.reports))
        if any(report.failed for report in new):
            if len(item.session.items) > 1:
                MPI.COMM_WORLD.Abort(1)  # the other ranks may wait for this one
            # mpirun ends the others with this one, and some may be about to report.
            start = time.monotonic()
            while (
                len([*path.parent.iterdir()]) < MPI.COMM_WORLD.size
                and time.monotonic() - start < self.GRACE
            ):
                time.sleep(0.05)
        return new


class Together:
    """What starts mpirun for a test: once for all that are to share it, when the first of them is due, and once more for
    those after one that has failed.

    One that fails there, or that does not end on all ranks, is started again alone. If it passes then, it still failed,
    and so did one in which the mpirun ended without a word.
    """

    MANY = 100
    """So many tests have twice the time limit of one."""

    def __init__(self, plugin: Any, run: Runner) -> None:
        self.plugin = plugin
        self.run = run
        self.found: dict[str, list[pytest.TestReport]] = {}
        self.done: set[str] = set()
        self.ended: dict[str, pytest.TestReport] = {}

    def __call__(self, item: pytest.Item) -> list[pytest.TestReport]:
        """What all ranks report. Failures come last: a rank that passes would make --lf forget one that does not."""
        if not self.found.get(item.nodeid) and item.nodeid not in self.ended:
            self.start(
                [
                    each
                    for each in item.session.items
                    if isinstance(each, pytest.Function)
                    and ranks_of(each) == ranks_of(item)
                    and not (self.found.get(each.nodeid) or each.nodeid in self.done)
                ]
            )
        self.done.add(item.nodeid)
        found = self.found.pop(item.nodeid)
        failed = [
            report
            for report in [*found, self.ended.pop(item.nodeid, None)]
            if report and report.failed
        ]
        if failed or sum(report.when == "teardown" for report in found) < ranks_of(item):
            found = [named(report) for report in self.run(item)]
            found += [] if any(report.failed for report in found) else failed[:1]
        return sorted(found, key=lambda report: report.failed)

    def start(self, items: list[pytest.Item]) -> None:
        """Run tests by one mpirun and sort what is reported by test."""
        self.found |= {item.nodeid: [] for item in items}
        options = os.environ.get("PYTEST_ADDOPTS", "")
        with (
            pytest.MonkeyPatch.context() as patch,
            contextlib.suppress(EOFError, pickle.UnpicklingError),
        ):
            patch.setenv("PYTEST_ADDOPTS", f"{options} {shlex.join(item.nodeid for item in items)}")
            limit = self.plugin._mpi_default_test_timeout * (1 + len(items) / self.MANY)
            patch.setattr(self.plugin, "_mpi_default_test_timeout", limit)
            bar = items[0].config.pluginmanager.get_plugin("bar")
            if bar and len(items) > 1:
                bar.tell(f"{len(items)} tests on {ranks_of(items[0])} ranks")
            for report in self.run(items[0]) if len(items) > 1 else []:
                self.found[named(report).nodeid].append(report)
        reports = [report for item in items for report in self.found[item.nodeid]]
        whole = [report.nodeid for report in reports if report.when == "teardown"]
        cut = [item for item in items if whole.count(item.nodeid) < ranks_of(item)]
        if cut and len(items) > 1 and not any(report.failed for report in reports):
            why = "the mpirun that it shares ended in it; alone it passes"
            self.ended[cut[0].nodeid] = pytest.TestReport(
                cut[0].nodeid, cut[0].location, {}, "failed", why, "call"
            )


def ranks_of(item: pytest.Function) -> int:
    """The ranks of a test that runs under mpirun, 0 of another."""
    return item.callspec.params.get("mpi_ranks", 0) if item.get_closest_marker("mpi") else 0


def named(report: pytest.TestReport) -> pytest.TestReport:
    """The report of a rank under the test's own name, which can be pasted back, and --lf and the progress know."""
    path, line, name = report.location
    if rank := re.search(r"\[rank=(\d+)\]$", report.nodeid):
        report.nodeid = report.nodeid.removesuffix(rank[0])
        report.location = path, line, name.removesuffix(rank[0])
        report.sections.append((f"on rank {rank[1]}", ""))
    return report


@pytest.fixture(scope="session")
def comm(comm):
    """All ranks; their collectives are compared."""
    from ddmpi.system.agreement import in_lockstep

    return in_lockstep(comm)


@pytest.fixture(autouse=True, scope="session")
def forked() -> Iterator[Callable]:
    """What is done apart is done by children of one process, which imports gmsh once. Yields what starts a process of its
    own, as the commands do that tests start."""
    from forked import Forked

    from ddmpi.system import interrupt

    start = interrupt._other
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(interrupt, "_other", Forked)
        yield start


@pytest.fixture
def by_itself(forked, monkeypatch) -> None:
    """What is done apart is done by a process of its own, as users start it."""
    from ddmpi.system import interrupt

    monkeypatch.setattr(interrupt, "_other", forked)


@pytest.fixture(autouse=True, scope="module")
def settled() -> None:
    """What there is before a file of tests is no garbage. Each solve collects garbage, and would look at all modules
    and tests every time: most of the time of small ones."""
    gc.collect()
    gc.freeze()


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
