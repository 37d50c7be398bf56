"""Commands and scripts that tests start, with programs that only take notes."""

import signal
import subprocess
import time
from collections.abc import Callable
from pathlib import Path

import scenes


def executable(path: Path, text: str) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_text(f"#!/bin/sh\n{text}\n", encoding="utf-8")
    path.chmod(0o755)
    return path


def without_settings() -> dict[str, str]:
    """The environment of a test without the settings of ddmpi's scripts, but for the folder of the set-up."""
    return {
        key: value
        for key, value in scenes.clean_environment().items()
        if not key.startswith("DDMPI_") or key == "DDMPI_VENV"
    }


def run(*command: str | Path, cwd: Path, code: int = 0, **environment: str) -> str:
    """What a command prints, which must end with this code, without the settings of ddmpi's scripts."""
    done = subprocess.run(
        command,
        cwd=cwd,
        env=without_settings() | environment,
        timeout=scenes.LIMIT,
        text=True,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
    )
    assert done.returncode == code, done.stdout
    return done.stdout


def await_that(happens: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + scenes.LIMIT
    while not happens():
        assert time.monotonic() < end, what
        time.sleep(0.02)


def attended(
    script: str, command: str, name: str, here: Path, **environment: str
) -> tuple[int, str]:
    """Exit code and words of a script which attends to the command, its $1, and gets the signal of that `name` once
    there is a file `ready`."""
    with subprocess.Popen(
        ["bash", "-c", f"set -euo pipefail; {script}", "bash", command],
        cwd=here,
        text=True,
        env=scenes.clean_environment() | environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    ) as job:
        await_that((here / "ready").exists, "it does not start")
        job.send_signal(getattr(signal, f"SIG{name}"))
        said, _ = job.communicate(timeout=scenes.LIMIT)
    return job.returncode, said
