"""What a run says and where; and that results and pictures lead back to their run."""

import logging
import os
import re
import subprocess
import sys

import numpy as np
import pytest
import scenes
from PIL import Image
from scenes import Run, pinched_blocks

from ddmpi.errors import InputError
from ddmpi.system import logs, provenance

STAMP = r"\d{4}-\d\d-\d\dT\d\d:\d\d:\d\dZ"


@pytest.fixture(scope="module")
def here(tmp_path_factory):
    """A folder with a scene in which three runs have told the same log."""
    folder = tmp_path_factory.mktemp("logs")
    scenes.write_scene(pinched_blocks(2), folder / "scene.toml")
    return folder


@pytest.fixture(scope="module")
def runs(here) -> dict[str, Run]:
    def run(name: str, *arguments: str) -> Run:
        return scenes.run_command(
            "scene.toml", here / name, "--log", "the.log", *arguments, cwd=here
        )

    return {
        "said": run("said"),
        "quiet": run("quiet", "--quiet", "--no-figures"),
        "failed": run("failed", "--quiet", "--no-figures", "--set", "method.max_iterations=1"),
    }


@pytest.fixture(scope="module")
def log(here, runs) -> list[list[str]]:
    """The lines of the log, without stamps, for each run."""
    parts: list[list[str]] = []
    for line in (here / "the.log").read_text().splitlines():
        assert re.match(rf"{STAMP}(  |$)", line), line
        text = line[22:]
        if text.startswith("ddmpi 0"):
            parts.append([])
        parts[-1].append(text)
    return parts


@pytest.mark.slow
def test_the_log_has_what_the_screen_has(runs, log):
    """Also of a quiet run, and of one that fails; each begins with a line that says where and what ran."""
    for (name, run), part in zip(runs.items(), log, strict=True):
        assert (
            re.match(r"ddmpi \d+\.\d+\.\d+ on \S+ \d+: ddmpi run scene\.toml", part[0])
            and name in part[0]
        )
        assert run.code == (3 if name == "failed" else 0)
    warned = [line for line in log[0][1:] if scenes.CLAMP_END in line]
    assert len(warned) == 1 and warned[0] in runs["said"].own_stderr
    rest = [line for line in log[0][1:] if line not in warned]
    assert rest == [line.rstrip() for line in runs["said"].stdout.splitlines()]
    quiet = runs["quiet"]
    assert (quiet.stdout, scenes.beside_clamps(quiet.own_stderr.splitlines())) == ("", [])
    assert any(line.startswith("converged and certified") for line in log[1])
    error = runs["failed"].own_stderr.splitlines()
    assert error[0].startswith("ddmpi: error: ") and log[2][-len(error) :] == [
        line.rstrip() for line in error
    ]


@pytest.mark.slow
def test_a_log_that_cannot_be_written_is_refused_at_once(here, tmp_path):
    (tmp_path / "no").write_text("not a folder")
    run = scenes.run_here(
        here / "scene.toml", tmp_path / "out", "--log", str(tmp_path / "no" / "x.log")
    )
    assert run.code == 2 and "--log" in run.messages[0]
    assert not run.folder.exists()


@pytest.mark.slow
def test_a_log_may_be_in_the_new_folder_of_the_results(here, tmp_path):
    folder = tmp_path / "new" / "out"
    run = scenes.run_here(
        here / "scene.toml", folder, "--log", str(folder / "run.log"), "--no-figures"
    )
    assert run.code == 0, run.output
    assert run.files == scenes.DATA | {"run.log"}
    assert "converged and certified" in (folder / "run.log").read_text()


@pytest.fixture
def free(monkeypatch):
    """The logger as it was, after the test."""
    logger = logging.getLogger("ddmpi")
    before = logger.handlers, logger.propagate, logger.level
    yield logger
    logs.close()
    logger.handlers, logger.propagate = before[:2]
    logger.setLevel(before[2])


def test_ranks_other_than_the_first_tell_errors_to_the_log_alone(tmp_path, free, capfd):
    """Nothing else, nothing on the screen; without a log nothing at all."""
    path = tmp_path / "the.log"
    logs.configure(1, file=str(path), heading="ddmpi 0 on a host")
    free.error("no error of the whole run")
    assert not path.exists()
    free.log(logging.CRITICAL + 1, "an end of this rank")
    assert re.fullmatch(rf"{STAMP}  an end of this rank\n", path.read_text(encoding="utf-8"))
    logs.configure(1)
    assert free.handlers == []
    assert capfd.readouterr() == ("", "")


def test_the_first_rank_tells_the_screen_and_the_log(tmp_path, free, capfd):
    """Quiet: warnings alone on the screen, all in the log, which goes on with a heading of its own."""
    path = tmp_path / "the.log"
    for quiet in (False, True):
        logs.configure(0, quiet, str(path), "ddmpi 0 on a host")
        free.info("a word")
        free.warning("a doubt")
        said = capfd.readouterr()
        assert said.out == ("" if quiet else "a word\n") and "a doubt" in said.err
        logs.close()
    words = [line[22:] for line in path.read_text(encoding="utf-8").splitlines() if line]
    assert [word for word in words if "ddmpi 0 on a host" in word] == ["ddmpi 0 on a host"] * 2
    assert sum("a word" in word for word in words) == sum("a doubt" in word for word in words) == 2


@pytest.mark.parametrize("name", ["scene.toml", "history.csv"])
def test_a_log_is_not_added_to_something_else(tmp_path, monkeypatch, capsys, name):
    from mpi4py import MPI

    from ddmpi.cli import main as cli
    from ddmpi.system import interrupt

    monkeypatch.chdir(tmp_path)
    (tmp_path / name).write_text("iteration,update\n")
    try:
        assert (
            cli._main(
                MPI.COMM_SELF, ["run", "scene.toml", "--log", f"../{tmp_path.name}/{name}"], []
            )
            == 2
        )
    finally:
        interrupt._handlers.clear()
        cli.logs.configure(0)
    said = capsys.readouterr().err.splitlines()
    assert len(said) == 1 and "no log of ddmpi" in said[0]
    assert [path.read_text() for path in tmp_path.iterdir()] == ["iteration,update\n"]


@pytest.mark.slow
@pytest.mark.parametrize(
    "arguments",
    [
        ["run", "s.toml", "--output", ""],
        ["run", "s.toml", "--restart="],
        ["run", "s.toml", "--log", ""],
        ["sweep", "s.toml", "--output", ""],
        ["figures", ""],
    ],
)
def test_empty_names_are_refused(arguments):
    from ddmpi.cli.arguments import build_parser

    with pytest.raises(InputError, match="an empty name"):
        build_parser().parse_args(arguments)


@pytest.mark.parametrize("when", ["write", "flush", "close"])
def test_a_log_that_fills_the_disk_does_not_stop_the_run(tmp_path, capsys, monkeypatch, when):
    import logging

    from ddmpi.system import logs

    logs.configure(0, quiet=True, file=str(tmp_path / "x.log"), heading="h")
    try:
        handler = logging.getLogger("ddmpi").handlers[-1]

        def full(*_text: str) -> None:
            raise OSError(28, "No space left on device")

        monkeypatch.setattr(handler.stream, when, full, raising=False)
        logging.getLogger("ddmpi").info("one")
        logging.getLogger("ddmpi").info("two")
        logs.close()
    finally:
        logs.configure(0)
    assert capsys.readouterr().err.count("No space left on device") == 1


@pytest.mark.slow
def test_results_and_pictures_lead_back_to_their_run(runs):
    """By its name, time, command, folder and versions."""
    summary = runs["said"].summary
    assert (
        re.fullmatch(rf"{STAMP[:-1]}\.\d{{3}}Z \S+ \d+", summary["run"]) and summary["slurm"] == {}
    )
    assert (
        re.fullmatch(STAMP, summary["started"]) and summary["run"] != runs["quiet"].summary["run"]
    )
    assert summary["command"].startswith("ddmpi run scene.toml --output ")
    assert summary["working_folder"] == str(runs["said"].folder.parent)
    assert summary["versions"]["numpy"] == np.__version__
    assert not {"unknown", "not there"} & set(summary["versions"].values())
    assert len(summary["hosts"]) == 2 and all(
        10 < body["memory_mib"] < 4000 for body in summary["bodies"].values()
    )
    seconds = summary["seconds"]
    assert min(seconds.values()) > 0 and seconds["total"] == max(seconds.values())
    assert runs["said"].files == scenes.DATA | {"bodies.png", "contact.png", "convergence.png"}
    for name in ("bodies.png", "contact.png", "convergence.png"):
        with Image.open(runs["said"].folder / name) as picture:
            assert picture.text["Title"] == summary["title"]
            assert picture.text["Description"] == (
                f"run {summary['run']}: {summary['command']}, in {summary['working_folder']}"
            )


@pytest.mark.slow
def test_a_batch_job_is_named(here, tmp_path, monkeypatch):
    for name, value in {
        "JOB_ID": "12",
        "ARRAY_JOB_ID": "10",
        "ARRAY_TASK_ID": "2",
        "JOB_NODELIST": "n1",
    }.items():
        monkeypatch.setenv(f"SLURM_{name}", value)
    from ddmpi.system.provenance import batch_job, whereabouts

    assert batch_job() == {
        "job_id": "12",
        "array_job_id": "10",
        "array_task_id": "2",
        "nodes": "n1",
    }
    assert whereabouts().endswith(" job 10_2")
    monkeypatch.delenv("SLURM_ARRAY_JOB_ID")  # as in a shell that kept the task's number only
    assert whereabouts().endswith(" job 12")


@pytest.mark.slow
@pytest.mark.parametrize("arguments", ["info", "run --help"])
def test_what_cannot_be_printed_is_told(arguments):
    """Without mpirun, which prints what its ranks say."""
    for unbuffered in ("", "1"):
        with open("/dev/full", "w") as full:
            child = subprocess.run(
                [sys.executable, "-m", "ddmpi", *arguments.split()],
                stdout=full,
                text=True,
                stderr=subprocess.PIPE,
                timeout=scenes.LIMIT,
                env=scenes.clean_environment() | {"PYTHONUNBUFFERED": unbuffered},
            )
        assert child.returncode == 5
        assert scenes.own_lines(child.stderr) == (
            "ddmpi: error: what was asked for could not be printed: No space left on device\n"
        )


@pytest.mark.slow
def test_a_run_whose_words_cannot_be_printed_goes_on():
    """A screen that is a file on a full disk."""
    code = """
import logging
from ddmpi.system import logs
logs.configure(0)
for k in range(3):
    logging.getLogger("ddmpi").info("line %d", k)
"""
    with open("/dev/full", "w") as full:
        child = subprocess.run(
            [sys.executable, "-c", code],
            stdout=full,
            stderr=subprocess.PIPE,
            text=True,
            timeout=scenes.LIMIT,
            env=scenes.clean_environment() | {"PYTHONUNBUFFERED": ""},
        )
    assert child.returncode == 0
    ours = scenes.own_lines(child.stderr)
    assert ours.count("\n") == 1 and "No space left on device" in ours


@pytest.mark.slow
def test_info(tmp_path):
    """What is there, said once by two ranks."""
    run = scenes.run_python(["-m", "ddmpi", "info"], 2, cwd=tmp_path)
    assert len(re.findall("^petsc ", run.stdout, re.MULTILINE)) == 1
    assert run.code == 0 and run.own_stderr == ""
    lines = dict(re.split(r" {2,}", line, maxsplit=1) for line in run.stdout.splitlines())
    assert lines.keys() >= {"ddmpi", "petsc", "mpi", "gmsh", "Cholesky factorizations", "machine"}
    assert (
        "petsc" in lines["Cholesky factorizations"]
        and "MPRGP" in lines["contact subproblems (TAO)"]
    )
    assert all(lines.values()) and list(tmp_path.iterdir()) == []


@pytest.mark.slow
def test_options_that_nothing_used_are_named_once(here):
    """By us, and not by PETSc as well when it ends."""
    run = scenes.run_command(
        here / "scene.toml", here / "unused", "--no-figures", "-not_an_option", "1"
    )
    assert run.code == 0 and run.output.count("not_an_option") == 1
    told = "PETSc options that nothing used: not_an_option (solvers have"
    warnings = scenes.beside_clamps(run.summary["warnings"])
    assert [warning.startswith(told) for warning in warnings] == [True]
    assert run.summary["options_unused"] == ["not_an_option"] and run.summary["options"] == {
        "not_an_option": "1"
    }


@pytest.mark.slow
def test_paths_that_cannot_be_read_end_no_run(tmp_path, monkeypatch):
    """Versions are read from what sys.path names, readable or not; other packages may begin with the same name."""
    listdir = os.listdir

    def refuse(folder):
        if folder == str(tmp_path / "closed"):
            raise PermissionError(folder)
        return listdir(folder)

    (tmp_path / "a.zip").touch()
    for name in (
        "closed",
        "a/h5py-3.1.dist-info",
        "a/h5py-stubs-4.0.egg-info",
        "b/h5py-2.0-py3.11.egg-info",
    ):
        (tmp_path / name).mkdir(parents=True)
    monkeypatch.setattr(os, "listdir", refuse)
    monkeypatch.setattr(
        sys, "path", [str(tmp_path / name) for name in ("closed", "a.zip", "none", "a", "b")]
    )
    assert provenance._installed() == {"h5py": "3.1"}
