"""The batch scripts on a real Slurm: a cluster of one node, started and stopped by scripts/slurm/local_cluster.sh.

All jobs are submitted at once; each test waits for its own.
"""

import csv
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
import time
from dataclasses import dataclass
from pathlib import Path

import pytest
import scenes
from commands import attended, executable, run
from scenes import pinched_blocks

from ddmpi.results.summary import write_summary

pytestmark = pytest.mark.slow

SLURM = scenes.ROOT / "scripts" / "slurm"
COEFFICIENT = "contact.0.friction.coefficient"


@dataclass
class Cluster:
    """How to talk to the cluster; jobs by name."""

    environment: dict[str, str]
    folder: Path
    jobs: dict[str, str]

    def submit(
        self,
        name: str,
        script: str,
        *arguments: str,
        options: tuple[str, ...] = (),
        **environment: str,
    ) -> str:
        command = [
            "sbatch",
            "--parsable",
            f"--output={self.folder}/{name}-%a.out",
            *options,
            str(SLURM / script),
            *arguments,
        ]
        self.jobs[name] = self.ask(*command, **environment).strip()
        return self.jobs[name]

    def ask(self, *command: str, **environment: str) -> str:
        done = subprocess.run(
            command,
            env=self.environment | environment,
            cwd=scenes.ROOT,
            capture_output=True,
            text=True,
            timeout=scenes.LIMIT,
        )
        assert done.returncode == 0, f"{command}: {done.stderr}"
        return done.stdout

    def wait(self, name: str, state: str = "COMPLETED", code: str = "0:0") -> list[dict[str, str]]:
        """What Slurm knows of the job, or of each task of an array, once it has ended as it should."""
        end = time.monotonic() + scenes.LIMIT
        while True:
            text = self.ask("scontrol", "show", "job", "--oneliner", self.jobs[name])
            tasks = [dict(re.findall(r"(\w+)=(\S*)", line)) for line in text.splitlines() if line]
            if all(
                task["JobState"] in ("COMPLETED", "FAILED", "CANCELLED", "TIMEOUT")
                for task in tasks
            ):
                assert {(task["JobState"], task["ExitCode"]) for task in tasks} == {
                    (state, code)
                }, self.said(name)
                return tasks
            assert time.monotonic() < end, f"{name}: {text}\n{self.said(name)}"
            time.sleep(0.2)

    def said(self, name: str) -> str:
        """What the job and its tasks have printed."""
        return "\n".join(path.read_text() for path in sorted(self.folder.glob(f"{name}-*.out")))


@pytest.fixture(scope="module")
def cluster(tmp_path_factory):
    places = os.environ["PATH"] + ":/usr/sbin:/sbin"
    missing = [
        name
        for name in ("munged", "slurmctld", "slurmd", "sbatch")
        if not shutil.which(name, path=places)
    ]
    if missing:
        pytest.skip(
            f"no Slurm here ({', '.join(missing)} not found); on Debian, as root: "
            "apt-get install --no-install-recommends slurm-wlm munge libpmix-dev"
        )
    folder = tmp_path_factory.mktemp("slurm")
    environment = scenes.clean_environment() | {
        "DDMPI_SLURM": str(folder / "cluster"),
        "DDMPI_PYTHON": sys.executable,
    }
    environment = {
        name: value for name, value in environment.items() if not name.startswith("SLURM_")
    }
    for name in ("MPIRUN", "PYTHON"):
        environment.pop(name, None)
    started = subprocess.run(
        [SLURM / "local_cluster.sh", "start"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
    )
    assert started.returncode == 0, started.stderr
    environment["SLURM_CONF"] = re.fullmatch(r"export SLURM_CONF='(.*)'\n", started.stdout)[1]
    yield Cluster(environment, folder, {})
    subprocess.run(
        [SLURM / "local_cluster.sh", "stop"], env=environment, check=True, timeout=scenes.LIMIT
    )
    after = subprocess.run(
        [SLURM / "local_cluster.sh", "status"],
        env=environment,
        capture_output=True,
        text=True,
        timeout=scenes.LIMIT,
    )
    assert after.returncode == 1 and "does not run" in after.stdout


@pytest.fixture(scope="module")
def jobs(cluster) -> Cluster:
    """The cluster with everything submitted."""
    here = cluster.folder
    small = str(scenes.write_scene(pinched_blocks(2), here / "small.toml"))
    long = str(scenes.write_scene(pinched_blocks(2, outer="relaxation"), here / "long.toml"))
    held = shlex.join([sys.executable, f"{scenes.ROOT}/tests/support/held.py"])
    python = executable(here / "python", f'exec {held} "$@"')
    cluster.submit(
        "preempted",
        "run.sbatch",
        long,
        "--no-figures",
        "--output",
        str(here / "preempted"),
        DDMPI_PYTHON=str(python),
    )
    cluster.submit("mpirun", "run.sbatch", small, f"--output={here / 'mpirun'}", "--no-figures")
    cluster.submit(
        "srun",
        "run.sbatch",
        small,
        "--output",
        str(here / "srun"),
        "--no-figures",
        DDMPI_LAUNCH="srun",
    )
    cluster.submit(
        "bad", "run.sbatch", small, "--output", str(here / "bad"), "--set", "method.thetta=1"
    )
    sweep = [small, "--vary", f"{COEFFICIENT}=0.1:0.5:5", "--output", str(here / "sweep")]
    array = cluster.submit("array", "sweep.sbatch", *sweep, options=("--array=1-2",))
    cluster.submit(
        "gather",
        "sweep.sbatch",
        *sweep,
        "--plot",
        "n_A:coefficient",
        options=(f"--dependency=afterany:{array}",),
    )
    return cluster


@pytest.mark.slurm
@pytest.mark.parametrize("launch", ["mpirun", "srun"])
def test_run(jobs, launch):
    jobs.wait(launch)
    summary = json.loads((jobs.folder / launch / "summary.json").read_text())
    assert summary["converged"] and summary["ranks"] == 2
    assert summary["slurm"]["job_id"] == jobs.jobs[launch] and summary["run"].endswith(
        f" job {jobs.jobs[launch]}"
    )
    assert "converged and certified" in jobs.said(launch)


@pytest.mark.slurm
def test_the_exit_code_reaches_slurm(jobs):
    jobs.wait("bad", "FAILED", "2:0")
    assert jobs.said("bad").count("ddmpi: error:") == 1 and not (jobs.folder / "bad").exists()


@pytest.mark.slurm
def test_array(jobs):
    assert len(jobs.wait("array")) == 2
    assert jobs.said("array").count("certified, ") == 5
    summaries = [
        json.loads(path.read_text()) for path in (jobs.folder / "sweep").glob("*/summary.json")
    ]
    assert sorted(summary["slurm"]["array_task_id"] for summary in summaries) == [
        "1",
        "1",
        "1",
        "2",
        "2",
    ]


@pytest.mark.slurm
def test_the_job_after_the_array_gathers(jobs):
    jobs.wait("gather")
    assert "0 to run, 5 finished" in jobs.said("gather")
    with open(jobs.folder / "sweep" / "sweep.csv", newline="") as file:
        assert [row["status"] for row in csv.DictReader(file)] == ["certified"] * 5
    assert (jobs.folder / "sweep" / f"n_A-{COEFFICIENT}.png").stat().st_size > 0


@pytest.mark.slurm
def test_a_job_whose_time_is_up_goes_back_and_continues(jobs, tmp_path):
    (job,) = jobs.wait("preempted")
    said = jobs.said("preempted")
    assert job["Restarts"] == "1", said
    assert "interrupted by SIGUSR1" in said and "back into the queue" in said
    assert (
        said.index("start number 2")
        < said.index("continuing after iteration")
        < said.index("converged and")
    )
    whole = scenes.run_command(jobs.folder / "long.toml", tmp_path / "whole", "--no-figures")
    assert whole.code == 0, whole.output
    for name in ("contact_upper-lower.csv", "history.csv"):
        assert (jobs.folder / "preempted" / name).read_bytes() == (whole.folder / name).read_bytes()
    assert not (jobs.folder / "preempted" / "checkpoint.h5").exists()


# What needs no Slurm: the script that all of them source, with a scontrol that takes notes


ENDS = {
    # what the command does: (signal, exit code of the job, requeued); it has gone back once, but with # # 50 times
    "mkdir out; trap 'touch out/checkpoint.h5; exit 6' USR1": ("USR1", 6, True),
    "trap 'exit 6' USR1": ("USR1", 6, False),  # nothing is saved, nor would it be the next time
    "trap 'exit 3' USR1": ("USR1", 3, False),  # it had ended otherwise just then
    "trap 'exit 6' USR1 #": ("TERM", 6, False),  # cancelled; it gets SIGUSR1 all the same
    "trap - USR1": ("USR1", 138, True),  # it did not listen yet
    "mkdir out; touch out/summary.json": ("USR1", 138, False),  # nor any more
    "trap - USR1 #": ("TERM", 138, False),
    "trap - USR1 # #": ("USR1", 138, False),
}


@pytest.mark.parametrize("command", ENDS)
def test_signals_are_handed_on(tmp_path, command):
    name, code, requeued = ENDS[command]
    executable(tmp_path / "scontrol", 'echo "$@" >>"$0.calls"')
    (tmp_path / "scripts").mkdir()
    (tmp_path / "scripts" / "setup.sh").write_text("")
    ended, said = attended(
        f'. "{SLURM}/job.sh"; output=out; attend bash -c "$1"; requeue_or_exit',
        f"{command}\ntouch ready; while :; do sleep 0.05; done",
        name,
        tmp_path,
        PATH=f"{tmp_path}:{os.environ['PATH']}",
        ROOT=str(tmp_path),
        SLURM_SUBMIT_DIR=str(tmp_path),
        SLURM_JOB_ID="7",
        SLURM_JOB_NODELIST="n",
        SLURM_RESTART_COUNT="50" if "# #" in command else "1",
    )
    assert ended == code, said
    calls = tmp_path / "scontrol.calls"
    assert (calls.read_text() if calls.exists() else "") == ("requeue 7\n" if requeued else "")


def start_job(here: Path, code: int, *arguments: str, **environment: str) -> list[str]:
    """What run.sbatch, which must end with this code, gives to a launcher that ends with 9."""
    (here / "scripts" / "slurm").mkdir(parents=True)
    (here / "scripts" / "setup.sh").write_text("MPIRUN=./mpirun PYTHON=python\n")
    shutil.copy(SLURM / "job.sh", here / "scripts" / "slurm")
    shutil.copy(SLURM.parent / "attend.sh", here / "scripts")
    executable(here / "mpirun", "printf '%s\\n' \"$@\" >calls\nexit 9")
    run(
        "bash",
        SLURM / "run.sbatch",
        "scene.toml",
        *arguments,
        cwd=here,
        code=code,
        DDMPI_ROOT=str(here),
        SLURM_SUBMIT_DIR=str(here),
        SLURM_JOB_ID="7",
        SLURM_JOB_NODELIST="n",
        **environment,
    )
    calls = here / "calls"
    return calls.read_text().split("\n")[:-1] if calls.exists() else []


RESULTS = {
    # what the folder holds, whether this is a later start of the job: exit code, whether ddmpi is started
    ("", True): (9, True),
    ("ours", False): (9, True),
    ("ours", True): (0, False),
    ("ours, not converged", True): (3, False),
    ("another's", True): (9, True),
}


@pytest.mark.parametrize(("holds", "again"), RESULTS)
def test_results_end_a_job_only_if_it_is_the_one_that_made_them(tmp_path, holds, again):
    """Else it is ddmpi's business, which has exit code 9 here."""
    if holds:
        write_summary(
            tmp_path,
            {
                "title": 'a\n  "converged": true',
                "converged": holds != "ours, not converged",
                "slurm": {"job_id": "7" if holds.startswith("ours") else "70"},
            },
        )
    code, starts = RESULTS[holds, again]
    environment = {"SLURM_RESTART_COUNT": "1"} if again else {}
    assert bool(start_job(tmp_path, code, "--output", str(tmp_path), **environment)) == starts


@pytest.mark.parametrize(
    ("environment", "ranks"),
    [({"SLURM_NTASKS": "8"}, "8"), ({"SLURM_NTASKS": "8", "DDMPI_RANKS": "3"}, "3")],
)
def test_a_job_has_the_ranks_that_slurm_gives_it(tmp_path, environment, ranks):
    """sbatch --ntasks, or else DDMPI_RANKS, says how many ranks a job has."""
    assert start_job(tmp_path, 9, "--output", "out", **environment)[:2] == ["-n", ranks]


def start_task(root: Path, code: int, **variables: int) -> str:
    """What sweep.sbatch says as a task of an array, up to the command that it would launch."""
    (root / "scripts" / "slurm").mkdir(parents=True)
    (root / "scripts" / "slurm" / "job.sh").write_text(
        'launch() { echo "$@"; }\nrequeue_or_exit() { :; }\n'
    )
    return run(
        "bash",
        SLURM / "sweep.sbatch",
        "s.toml",
        "--output",
        "D",
        cwd=root,
        code=code,
        DDMPI_ROOT=str(root),
        **{f"SLURM_ARRAY_TASK_{name}": str(value) for name, value in variables.items()},
    )


ARRAYS = {
    # --array: (its tasks, the step that Slurm tells)
    "0-9": (range(10), 1),
    "1-2": (range(1, 3), 1),
    "3-11:4": (range(3, 12, 4), 4),
    "7": ([7], 1),
    "1,2,7": ([1, 2, 7], 1),
    "0,2,4": ([0, 2, 4], 1),
    "0-6:2,7": ([0, 2, 4, 6, 7], 2),
    "0-4:2,1": ([0, 1, 2, 4], 2),
}


@pytest.mark.parametrize("array", ARRAYS)
def test_tasks_of_an_array_have_each_a_share_or_are_refused(tmp_path, array):
    tasks, step = ARRAYS[array]
    said = [
        start_task(
            tmp_path / str(task),
            2 if "," in array else 0,
            ID=task,
            MIN=min(tasks),
            MAX=max(tasks),
            STEP=step,
            COUNT=len(tasks),
        )
        for task in tasks
    ]
    if "," in array:
        for each in said:
            assert (
                f"the {len(tasks)} tasks" in each
                and f"--array=0-{len(tasks) - 1}" in each
                and "-m" not in each
            )
    else:
        assert said == [
            f"-m ddmpi sweep s.toml --output D --index {k}/{len(tasks)}\n"
            for k in range(len(tasks))
        ]


@pytest.mark.parametrize(
    ("folder", "code"), [("ours", 0), ("empty", 0), ("theirs", 1), ("copied", 1)]
)
def test_a_cluster_removes_only_what_it_has_made(tmp_path, folder, code):
    """It starts in a folder of its own and leaves there what it does not know, and in no folder of another Slurm."""
    for name in ("munged", "slurmctld", "slurmd", "sbatch", "sinfo"):
        executable(tmp_path / name, "echo idle")
    place = tmp_path / folder
    place.mkdir()

    def start(code: int) -> None:
        run(
            SLURM / "local_cluster.sh",
            "start",
            cwd=tmp_path,
            code=code,
            DDMPI_SLURM=str(place),
            PATH=f"{tmp_path}:{os.environ['PATH']}",
        )

    if folder == "ours":
        start(0)
    files = (
        {}
        if folder == "empty"
        else {"slurm.conf": "ClusterName=ours\n", "thesis.txt": "years of work"}
    )
    if folder == "copied":
        files["slurm.conf"] = "# Written by local_cluster.sh for /elsewhere\n"
    for name in files if folder != "ours" else ["thesis.txt"]:
        (place / name).write_text(files[name])
    start(code)
    known = {path.name: path.read_text() for path in place.iterdir() if path.name in files}
    assert known == files if code else known.get("thesis.txt") == files.get("thesis.txt")
