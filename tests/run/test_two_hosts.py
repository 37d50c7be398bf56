"""One run on two hosts, with TCP between them, and hosts that are lost: those of scripts/local_hosts.sh."""

import json
import shlex
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import fault
import h5py
import numpy as np
import pytest
import scenes
from fault_cases import contents, run_in_one_go
from scenes import Run, pinched_blocks
from solid_scenes import two_boxes
from test_failures import only_message
from test_team import loose_block

from ddmpi.results.checkpoint import read

pytestmark = [pytest.mark.hosts, pytest.mark.slow]

SCRIPTS = scenes.ROOT / "scripts"
MULT = "ddmpi.body.compliance.Compliance.mult"
ENVIRONMENT = [
    name
    for name in scenes.clean_environment()
    if name in ("PYTHONPATH", "PYTHONPYCACHEPREFIX", "OMP_NUM_THREADS")
    or name.startswith("OPENBLAS_")
]
"""What mpirun is to hand on to ranks that it starts by ssh; OpenBLAS's kernels round differently."""

PUBLISHED = pinched_blocks(2, theta=0.2, tolerance=1e-3) | {"checkpoint": {"iterations": 1}}
SCENES = {
    # ranks: scenes by name
    2: {"published": PUBLISHED, "tower": scenes.tower(4, 2), "one body": loose_block()},
    4: {"two solids": two_boxes(2)},
}
SHARED = {(2, "one body"), (4, "two solids")}
"""Here bodies have several ranks, on both hosts, and MUMPS sums in the order in which messages come."""

HOSTS = {"one": "a:4", "two": "a:2,b:2"}


@pytest.fixture(scope="module", autouse=True)
def permitted() -> None:
    tried = subprocess.run(
        [SCRIPTS / "local_hosts.sh", "mpirun", "--version"],
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
    )
    if tried.returncode == 125:
        pytest.skip(tried.stderr.strip())
    assert tried.returncode == 0, tried.stderr
    if "(Open MPI) 4." not in tried.stdout:
        pytest.skip(f"hosts are made for Open MPI 4, this is {tried.stdout.splitlines()[0]}")


# The same answers


@pytest.fixture(scope="module")
def runs(tmp_path_factory) -> dict[tuple[int, str, str], Run]:
    """By number of ranks, scene and hosts; "interrupted" is the published method with a signal on rank 1."""
    here, found = tmp_path_factory.mktemp("hosts"), {}
    given = [word for name in ENVIRONMENT for word in ("-x", name)]
    for ranks, some in SCENES.items():
        for name, scene in some.items():
            scenes.write_scene(scene, here / f"{name}.toml")
        for where, hosts in HOSTS.items():
            launcher = [
                SCRIPTS / "local_hosts.sh",
                "mpirun",
                "--quiet",
                "--host",
                hosts,
                "--map-by",
                "node",
                *given,
            ]
            faults = {
                name: (
                    0,
                    "",
                    0,
                    "",
                    str(here / f"{name} {ranks} {where}"),
                    [str(here / f"{name}.toml")],
                )
                for name in some
            }
            if "published" in some:
                faults["interrupted"] = (
                    1,
                    MULT,
                    60,
                    "SIGUSR1",
                    str(here / f"interrupted {ranks} {where}"),
                    [str(here / "published.toml")],
                )
            with pytest.MonkeyPatch.context() as patch:
                patch.setenv("MPIRUN", " ".join(map(str, launcher)))
                ended = run_in_one_go(list(faults.values()), "run", "--no-figures", ranks=ranks)
            found |= {(ranks, name, where): run for name, run in zip(faults, ended, strict=True)}
    return found


@pytest.mark.parametrize(
    ("ranks", "name"), [(ranks, name) for ranks in SCENES for name in SCENES[ranks]]
)
def test_two_hosts_give_the_results_of_one(runs, ranks, name):
    """Bit for bit; to rounding where a body has several ranks."""
    one, two = (runs[ranks, name, where] for where in HOSTS)
    assert one.code == two.code == 0, one.output + two.output
    assert one.summary["hosts"] == ["a"] * ranks and two.summary["hosts"] == ["a", "b"] * (
        ranks // 2
    )
    assert one.files == two.files
    if (ranks, name) not in SHARED:
        assert contents(one.folder, one.files) == contents(two.folder, two.files)
        return
    with (
        h5py.File(one.folder / "result.h5") as first,
        h5py.File(two.folder / "result.h5") as second,
    ):
        u, v = first["displacement"][:], second["displacement"][:]
    assert np.abs(u - v).max() <= 1e-9 * np.abs(u).max()
    (contact,) = one.summary["contacts"]
    was, now = (run.table(f"contact_{contact}.csv") for run in (one, two))
    assert was["status"].tolist() == now["status"].tolist()


def test_two_hosts_leave_the_checkpoint_of_one(runs):
    """All that is in it; the file itself has times of HDF5, too."""
    one, two = (runs[2, "interrupted", where] for where in HOSTS)
    assert one.code == two.code == 6, one.output + two.output
    assert one.files == two.files == {"checkpoint.h5"}
    np.testing.assert_equal(read(one.folder / "checkpoint.h5"), read(two.folder / "checkpoint.h5"))


# Hosts that are lost


class Hosts:
    """Three hosts, and a shell on the first.

    Parameters
    ----------
    here : folder for files
    """

    def __init__(self, here: Path) -> None:
        self.here, self.scene = here, scenes.write_scene(PUBLISHED, here / "scene.toml")
        environment = scenes.clean_environment() | {
            "OMPI_MCA_mca_base_env_list": ";".join(ENVIRONMENT),
            "OMPI_MCA_orte_default_hostfile": str(here / "hosts"),
            "DDMPI_PYTHON": str(here / "python"),
            "OMPI_MCA_oob_tcp_keepalive_time": "1",
            "OMPI_MCA_oob_tcp_keepalive_intvl": "1",
            "OMPI_MCA_oob_tcp_keepalive_probes": "2",
            "DDMPI_RANKS": "2",
        }
        self.shell = subprocess.Popen(
            [SCRIPTS / "local_hosts.sh", "bash"],
            env=environment,
            text=True,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
        )

    def run(self, hosts: str, folder: Path, *arguments: str, rank: int = 1, kind: str = "") -> Run:
        """scripts/run.sh on a, with its two ranks on `hosts`; with a `kind`, the host of `rank` is lost under way."""
        faulty = [fault.__file__, json.dumps([(rank, MULT, 60, kind, str(folder), [])])]
        program = [sys.executable, *(faulty if kind else ["-m", "ddmpi"])]
        (self.here / "python").write_text(f'#!/bin/sh\nshift 3\nexec {shlex.join(program)} "$@"\n')
        (self.here / "python").chmod(0o755)
        slots = {host: hosts.count(host) for host in hosts}
        (self.here / "hosts").write_text(
            "".join(f"{host} slots={number}\n" for host, number in slots.items())
        )
        out, err = self.here / "stdout", self.here / "stderr"
        command = shlex.join(
            [str(SCRIPTS / "run.sh"), "run", str(self.scene), "--no-figures", *arguments]
        )
        self.shell.stdin.write(
            f"timeout -k 5 {scenes.LIMIT} {command} >{out} 2>{err} </dev/null; echo $?\n"
        )
        self.shell.stdin.flush()
        return Run(int(self.shell.stdout.readline()), out.read_text(), err.read_text(), folder)


@pytest.fixture
def hosts(tmp_path) -> Iterator[Hosts]:
    started = Hosts(tmp_path)
    yield started
    started.shell.communicate(timeout=scenes.LIMIT)


LOST = {
    # name: fault, hosts, on which rank, hosts of the run that goes on
    "a dead host, and another in its place": ("dead host", "ab", 1, "ac"),
    "a host that is cut off, and none in its place": ("cut host", "ab", 1, "aa"),
    "the host of the first rank": ("dead host", "bc", 0, "ac"),
}


@pytest.mark.parametrize("name", LOST)
def test_a_lost_host_ends_the_run_and_restart_goes_on(hosts, runs, tmp_path, name):
    """One message, and on other hosts the results of a run that was not disturbed, bit for bit."""
    kind, before, rank, after = LOST[name]
    lost = hosts.run(before, tmp_path / "out", rank=rank, kind=kind)
    assert lost.code not in (0, 124), lost.output
    assert only_message(lost).startswith("ddmpi: error: the launcher ended the run")
    assert "--restart" in lost.messages[0]
    assert lost.files == {"checkpoint.h5", ".unfinished"}
    if before[0] != after[0]:  # nobody on another host can know that the run has ended
        refused = hosts.run(after, lost.folder, "--restart", str(lost.folder))
        assert refused.code == 2
        claim = lost.folder / ".unfinished"
        assert f"another run is at work there ({before[0]} " in only_message(refused)
        assert f"remove {claim}" in refused.messages[0]
        shutil.rmtree(claim)
    again = hosts.run(after, lost.folder, "--restart", str(lost.folder))
    assert again.code == 0, again.output
    assert "continuing after iteration" in again.stdout
    assert again.summary["hosts"] == list(after)
    expected = runs[2, "published", "one"]
    assert again.files == expected.files
    assert contents(again.folder) == contents(expected.folder)
