"""How the command ends."""

import itertools
import os
import re
import subprocess
import sys
import threading

import pytest
import scenes

from ddmpi.cli import main as cli
from ddmpi.cli.arguments import build_parser
from ddmpi.cli.commands import COMMANDS, _figures
from ddmpi.errors import InputError


class World:
    """Notes what mpirun, which reads `pipe`, has not read when a rank aborts."""

    rank, size = 1, 2

    def __init__(self, pipe: int) -> None:
        self.pipe = pipe

    def Abort(self, code: int) -> None:
        os.set_blocking(self.pipe, False)
        try:
            self.unread = os.read(self.pipe, 100)
        except BlockingIOError:
            self.unread = b""
        self.code = code


@pytest.mark.parametrize("reads", [True, False])
def test_an_abort_waits_for_the_message_to_be_read(monkeypatch, reads):
    """But not for ever. MPICH's mpirun drops what it has not read by then."""
    pipe, end = os.pipe()
    world = World(pipe)
    with os.fdopen(end, "w") as stderr:
        monkeypatch.setattr(sys, "stderr", stderr)
        print("the message", file=stderr, flush=True)
        mpirun = threading.Timer(0.2, os.read, (pipe, 100))
        if reads:
            mpirun.start()
        # Time stands still until the message is read, or flies.
        monkeypatch.setattr(
            cli.time, "monotonic", (lambda: 0.0) if reads else itertools.count().__next__
        )
        cli._abort(world, 3)
    os.close(pipe)
    assert world.code == 3
    assert world.unread == (b"" if reads else b"the message\n")


@pytest.mark.parametrize("name", ["info", "schema"])
def test_commands_without_arguments(name):
    """They take none, and are there."""
    assert build_parser().parse_args([name]).command == name


@pytest.mark.slow
def test_a_reader_that_stops_early_does_not_end_the_check(tmp_path):
    """As in ddmpi check SCENE.toml | head: one warning, no pages of PETSc, and the exit code of the check."""
    read, write = os.pipe()
    os.close(read)
    scene = scenes.write_scene(scenes.pinched_blocks(2), tmp_path / "scene.toml")
    command = [
        sys.executable,
        "-m",
        "ddmpi",
        "check",
        str(scene),
        "--no-figures",
        "--output",
        str(tmp_path / "out"),
    ]
    try:
        job = subprocess.run(
            command,
            stdout=write,
            stderr=subprocess.PIPE,
            text=True,
            cwd=scenes.ROOT,
            env=scenes.clean_environment(),
            check=False,
        )
    finally:
        os.close(write)
    assert (
        job.returncode == 0
        and len(job.stderr.splitlines()) == 1
        and "cannot be printed any more" in job.stderr
    )


def test_two_cuts_are_refused():
    """The second would replace the first without a word."""
    command = ["figures", "results", "--cut", "x=0.5"]
    assert build_parser().parse_args(command).cut == [{"x": 0.5}]
    with pytest.raises(InputError, match=r"--cut.*given twice"):
        _figures(build_parser().parse_args([*command, "--cut", "y=0.5"]))


def test_the_script_knows_all_commands():
    """scripts/run.sh takes any other first word for a scene."""
    line = re.search(
        r"\n    (run \|.*)\) ;;", (scenes.ROOT / "scripts" / "run.sh").read_text(encoding="utf-8")
    )
    assert set(COMMANDS) <= set(line[1].split(" | "))
